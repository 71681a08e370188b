//! `drystone serve`: shows a folder of tiles in a browser on this machine.

use std::path::PathBuf;

use clap::Args;

use super::print::print;
use super::progress::stoppable;
use crate::base::{Error, Result};
use crate::os::signals::StopSignal;
use crate::serve::TileServer;

/// Arguments of `drystone serve`.
#[derive(Debug, Args)]
pub struct ServeArguments {
    /// Folder that `drystone tile` wrote
    folder: PathBuf,
    /// Port of 127.0.0.1; 0 for any that is free
    #[arg(long, value_name = "PORT", default_value_t = 8000)]
    port: u16,
}

/// Prints the address of the page, and answers until a signal comes.
///
/// # Errors
/// Those of [`TileServer::listen`] and [`TileServer::run`].
pub fn run(arguments: &ServeArguments) -> Result<u8> {
    let stop = StopSignal::listen()?;
    let told = stoppable(true, stop);
    let server = TileServer::listen(&arguments.folder, arguments.port)?;
    print(&format!("http://{}/\n", server.address()?))?;
    match server.run(&*told) {
        Err(Error::Stopped) => Ok(0),
        outcome => outcome.map(|()| 0),
    }
}
