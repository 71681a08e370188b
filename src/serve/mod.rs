//! Shows a folder of tiles in a browser on this machine: a small server of files, and a page.
//!
//! ```text
//! browser ── GET /, /….js, /tiles/… ──▶ 127.0.0.1 ──▶ the page, which is part of the program; files of the folder
//! ```
//! In: a folder. Out: bytes to whoever asks on this machine. Invariant: nothing is read but regular files in and below the
//! folder, links followed; nothing is written; other machines and pages of other origins are refused.
//!
//! # Memory
//! For each of 16 connections a request (8 KiB) and a part of a file (64 KiB).

mod connection;
mod request;

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::Builder;
use std::time::Duration;

use self::connection::Connection;
use self::request::{Request, RequestTarget};
use crate::base::error::escape_path;
use crate::base::{Error, Progress, Result};
use crate::tile::TILESET;

/// Connections at once; further ones wait.
const CONNECTIONS_MAX: usize = 16;
/// Time that a client may take for a request, and for an answer of no length.
const PATIENCE: Duration = Duration::from_secs(10);
/// Bytes of an answer for which a client may take a second more.
const SLOWEST_BYTES: u64 = 256 << 10;
/// Time between two looks for a connection, and for a signal to stop.
const LOOK_INTERVAL: Duration = Duration::from_millis(20);
/// Bytes of a file that are sent at once.
const PART_BYTES: usize = 1 << 16;

/// Bytes of a refused request that are read and forgotten.
const UNREAD_BYTES_MAX: u64 = 1 << 20;

const PAGE: &str = include_str!("page.html");
const SCRIPT: &str = include_str!("page.js");
const DECODER: &str = include_str!("meshopt.js");
const SCRIPT_TYPE: &str = "text/javascript; charset=utf-8";

/// A server that listens on this machine.
#[derive(Debug)]
pub struct TileServer {
    listener: TcpListener,
    /// The folder, all links followed.
    folder: PathBuf,
    /// [`PATIENCE`], but in tests.
    patience: Duration,
}

impl TileServer {
    /// Listens on a port of 127.0.0.1; port 0 is any that is free.
    ///
    /// # Errors
    /// [`Error::Usage`] if the folder holds no tileset, or the port is taken.
    pub fn listen(folder: &Path, port: u16) -> Result<Self> {
        let shown = escape_path(folder);
        if !folder.join(TILESET).is_file() {
            return Err(Error::Usage(format!("{shown}: holds no {TILESET}, so there is nothing to look at")));
        }
        let folder = folder.canonicalize().map_err(|error| Error::io(folder, "open", error))?;
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port));
        let listener =
            listener.map_err(|error| Error::Usage(format!("`port: {port}`: {error}; choose another one")))?;
        listener.set_nonblocking(true).map_err(|error| Error::io(&folder, "serve", error))?;
        Ok(Self { listener, folder, patience: PATIENCE })
    }

    /// Where it listens.
    ///
    /// # Errors
    /// If the system does not tell.
    pub fn address(&self) -> Result<SocketAddr> {
        self.listener.local_addr().map_err(|error| Error::io(&self.folder, "serve", error))
    }

    /// Answers until the job is stopped. Reports the first of several connections in a row that fail.
    ///
    /// # Errors
    /// [`Error::Stopped`] in the end.
    pub fn run(self, progress: &dyn Progress) -> Result<()> {
        let (open, folder, patience) = (Arc::new(AtomicUsize::new(0)), Arc::new(self.folder), self.patience);
        let mut is_failing = false;
        loop {
            progress.check_stopped()?;
            if open.load(Ordering::Acquire) >= CONNECTIONS_MAX {
                std::thread::sleep(LOOK_INTERVAL);
                continue;
            }
            match self.listener.accept() {
                Ok((stream, _)) => {
                    is_failing = false;
                    let (open, folder) = (Arc::clone(&open), Arc::clone(&folder));
                    open.fetch_add(1, Ordering::AcqRel);
                    let counted = Arc::clone(&open);
                    let answer = move || {
                        // A client that goes away ends its own connection alone.
                        let _ = Connection::new(stream, patience).and_then(|stream| answer(stream, &folder));
                        open.fetch_sub(1, Ordering::AcqRel);
                    };
                    if Builder::new().spawn(answer).is_err() {
                        counted.fetch_sub(1, Ordering::AcqRel);
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => std::thread::sleep(LOOK_INTERVAL),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                // A client that went away meanwhile, or as many files as the system lets be open: it passes.
                Err(error) => {
                    if !std::mem::replace(&mut is_failing, true) {
                        progress.tell(&format!("a connection failed: {error}"));
                    }
                    std::thread::sleep(LOOK_INTERVAL);
                }
            }
        }
    }
}

/// Answers the request of a connection, and closes it.
fn answer(mut stream: Connection, folder: &Path) -> std::io::Result<()> {
    let request = match Request::read(&mut stream)? {
        Ok(request) => request,
        Err(status) => {
            refuse(&mut stream, status)?;
            // Were the rest left unread, the client might lose the answer.
            stream.end_answer()?;
            return std::io::copy(&mut stream.take(UNREAD_BYTES_MAX), &mut std::io::sink()).map(drop);
        }
    };
    match request.wanted {
        RequestTarget::Page => send(&mut stream, "text/html; charset=utf-8", PAGE.as_bytes()),
        RequestTarget::Script => send(&mut stream, SCRIPT_TYPE, SCRIPT.as_bytes()),
        RequestTarget::Decoder => send(&mut stream, SCRIPT_TYPE, DECODER.as_bytes()),
        RequestTarget::File(name) => match open(folder, &name) {
            Some((mut file, bytes)) => {
                head(&mut stream, "200 OK", media_type(&name), bytes)?;
                let mut part = vec![0; PART_BYTES];
                let mut left = bytes;
                while left > 0 {
                    let count = file.read(&mut part[..PART_BYTES.min(left as usize)])?;
                    if count == 0 {
                        break;
                    }
                    stream.write_all(&part[..count])?;
                    left -= count as u64;
                }
                Ok(())
            }
            None => refuse(&mut stream, "404 Not Found"),
        },
    }
}

/// A regular file in or below the folder, and its size.
fn open(folder: &Path, name: &Path) -> Option<(File, u64)> {
    let path = folder.join(name).canonicalize().ok().filter(|path| path.starts_with(folder))?;
    path.metadata().ok().filter(std::fs::Metadata::is_file)?;
    let file = File::open(path).ok()?;
    let bytes = file.metadata().ok()?.len();
    Some((file, bytes))
}

fn media_type(name: &Path) -> &'static str {
    match name.extension().and_then(|ending| ending.to_str()) {
        Some("json") => "application/json",
        Some("glb") => "model/gltf-binary",
        _ => "application/octet-stream",
    }
}

fn send(stream: &mut Connection, kind: &str, body: &[u8]) -> std::io::Result<()> {
    head(stream, "200 OK", kind, body.len() as u64)?;
    stream.write_all(body)
}

fn refuse(stream: &mut Connection, status: &str) -> std::io::Result<()> {
    head(stream, status, "text/plain", status.len() as u64)?;
    stream.write_all(status.as_bytes())
}

fn head(stream: &mut Connection, status: &str, kind: &str, bytes: u64) -> std::io::Result<()> {
    stream.begin_answer(Duration::from_secs(bytes / SLOWEST_BYTES));
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {bytes}\r\nConnection: close\r\n\
         Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\n\
         Content-Security-Policy: default-src 'self' blob:; style-src 'self' 'unsafe-inline'\r\n\r\n"
    );
    stream.write_all(head.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpStream;
    use std::time::Instant;

    use crate::base::Silent;

    const PATIENCE_OF_TEST: Duration = Duration::from_millis(500);

    /// Serves a folder with a tileset, and never ends.
    fn serve(folder: &Path) -> SocketAddr {
        std::fs::write(folder.join(TILESET), "{}").unwrap();
        let server = TileServer { patience: PATIENCE_OF_TEST, ..TileServer::listen(folder, 0).unwrap() };
        let address = server.address().unwrap();
        std::thread::spawn(move || server.run(&Silent));
        address
    }

    fn connect(address: SocketAddr) -> TcpStream {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        stream
    }

    #[test]
    fn clients_that_send_byte_by_byte_do_not_keep_others_waiting() {
        let folder = tempfile::tempdir().unwrap();
        let address = serve(folder.path());
        let begin = Instant::now();
        let mut slow: Vec<TcpStream> = (0..CONNECTIONS_MAX).map(|_| connect(address)).collect();
        let sender = std::thread::spawn(move || {
            // As long as one of them is held, and not for ever.
            while !slow.is_empty() && begin.elapsed() < 20 * PATIENCE_OF_TEST {
                slow.retain_mut(|stream| stream.write_all(b"G").is_ok());
                std::thread::sleep(PATIENCE_OF_TEST / 5);
            }
        });
        std::thread::sleep(PATIENCE_OF_TEST / 2);
        let mut other = connect(address);
        other.write_all(b"GET /tiles/tileset.json HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
        let mut text = String::new();
        other.read_to_string(&mut text).unwrap();
        assert!(text.starts_with("HTTP/1.1 200 OK") && text.ends_with("{}"), "{text}");
        assert!(begin.elapsed() < 10 * PATIENCE_OF_TEST, "{:?}", begin.elapsed());
        sender.join().unwrap();
    }
}
