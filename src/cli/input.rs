//! Inputs of a command: files, folders, and patterns of files to leave out.

use std::path::PathBuf;

use clap::Args;

use super::flags::heading;
use crate::read::InputChoice;

/// Arguments of commands that read a mesh.
#[derive(Debug, Args)]
pub struct InputArguments {
    /// OBJ and PLY files, or folders: every OBJ and PLY in and below them; all join one mesh
    #[arg(required = true, value_name = "INPUT")]
    input: Vec<PathBuf>,
    /// Leave out files and folders of an input folder whose name, or path from that folder on, matches; may be repeated
    ///
    /// Patterns such as '*_lod*', backup, 'old/*.obj'
    #[arg(long, value_name = "GLOB", hide_short_help = true, help_heading = heading::INPUT)]
    exclude: Vec<String>,
}

impl InputArguments {
    /// Inputs that the user named.
    pub fn choice(&self) -> InputChoice {
        InputChoice { paths: self.input.clone(), exclude: self.exclude.clone() }
    }
}
