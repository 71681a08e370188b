//! A connection with a client that has a limited time.
//!
//! Invariant: no read or write waits beyond the deadline, in however many pieces a client sends or takes.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::time::{Duration, Instant};

/// A connection, first for a request and then for its answer.
pub struct Connection {
    stream: TcpStream,
    /// Time for the request, and for an answer of no length.
    patience: Duration,
    /// When the request, or the answer, has to be through.
    deadline: Instant,
}

impl Connection {
    /// Begins with a request.
    ///
    /// # Errors
    /// If the system does not let the connection wait.
    pub fn new(stream: TcpStream, patience: Duration) -> std::io::Result<Self> {
        stream.set_nonblocking(false)?;
        Ok(Self { stream, patience, deadline: Instant::now() + patience })
    }

    /// An answer follows, which may take this much longer than one of no length.
    pub fn begin_answer(&mut self, longer: Duration) {
        self.deadline = Instant::now() + self.patience + longer;
    }

    /// No more of an answer follows.
    ///
    /// # Errors
    /// If the client is gone.
    pub fn end_answer(&self) -> std::io::Result<()> {
        self.stream.shutdown(Shutdown::Write)
    }

    /// The time until the deadline.
    fn time_left(&self) -> std::io::Result<Option<Duration>> {
        let left = self.deadline.saturating_duration_since(Instant::now());
        if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { Ok(Some(left)) }
    }
}

impl Read for Connection {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        self.stream.set_read_timeout(self.time_left()?)?;
        self.stream.read(bytes)
    }
}

impl Write for Connection {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.stream.set_write_timeout(self.time_left()?)?;
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.stream.flush()
    }
}
