//! Reads a request of a browser. Every byte is hostile.

use std::io::Read;
use std::path::{Component, Path, PathBuf};

/// Largest size of a request in bytes.
const REQUEST_BYTES_MAX: usize = 8 << 10;
/// Names of this machine, as a browser writes them before the port.
const OWN_NAMES: [&str; 3] = ["127.0.0.1", "localhost", "[::1]"];

/// A request.
#[derive(Debug, PartialEq, Eq)]
pub struct Request {
    /// What is wanted.
    pub wanted: RequestTarget,
}

/// What a request wants.
#[derive(Debug, PartialEq, Eq)]
pub enum RequestTarget {
    /// The page.
    Page,
    /// Its script.
    Script,
    /// What its script decodes tiles with.
    Decoder,
    /// A file below the folder, by a name without `..`.
    File(PathBuf),
}

/// Status line of a refusal.
type RequestRefusal = &'static str;

impl Request {
    /// Reads a request up to the empty line.
    ///
    /// # Errors
    /// Those of `stream`; inside, the status of a request that is refused.
    pub fn read(stream: &mut impl Read) -> std::io::Result<Result<Self, RequestRefusal>> {
        let mut bytes = Vec::with_capacity(1024);
        let mut part = [0; 1024];
        while !bytes.windows(4).any(|end| end == b"\r\n\r\n") {
            let count = stream.read(&mut part)?;
            if count == 0 || bytes.len() + count > REQUEST_BYTES_MAX {
                return Ok(Err("400 Bad Request"));
            }
            bytes.extend_from_slice(&part[..count]);
        }
        Ok(Self::parse(&bytes))
    }

    fn parse(bytes: &[u8]) -> Result<Self, RequestRefusal> {
        let bad = "400 Bad Request";
        let text = std::str::from_utf8(bytes).map_err(|_| bad)?;
        let mut lines = text.split("\r\n");
        let mut words = lines.next().unwrap_or_default().split(' ');
        let (Some(method), Some(target), Some(version)) = (words.next(), words.next(), words.next()) else {
            return Err(bad);
        };
        if !version.starts_with("HTTP/1.") {
            return Err(bad);
        }
        if method != "GET" {
            return Err("405 Method Not Allowed");
        }
        // A page of another origin may name this machine by a name of its own.
        let host = lines.filter_map(|line| line.split_once(':')).find(|(key, _)| key.eq_ignore_ascii_case("host"));
        let is_own = |host: &str| {
            let name = host.rsplit_once(':').filter(|(_, port)| port.bytes().all(|digit| digit.is_ascii_digit()));
            OWN_NAMES.contains(&name.map_or(host, |(name, _)| name))
        };
        if !host.is_some_and(|(_, host)| is_own(host.trim())) {
            return Err("403 Forbidden");
        }
        let path = target.split(['?', '#']).next().unwrap_or_default();
        Ok(Self {
            wanted: match path {
                "/" => RequestTarget::Page,
                "/page.js" => RequestTarget::Script,
                "/meshopt.js" => RequestTarget::Decoder,
                _ => RequestTarget::File(path.strip_prefix("/tiles/").and_then(name).ok_or("404 Not Found")?),
            },
        })
    }
}

/// The name of a file: plain parts, none of them hidden or with a percent sign.
fn name(path: &str) -> Option<PathBuf> {
    let name = Path::new(path);
    let is_plain =
        |part: Component<'_>| matches!(part, Component::Normal(text) if !text.as_encoded_bytes().starts_with(b"."));
    let is_named = !path.is_empty() && !path.contains(['%', '\\', '\0', ':']);
    (is_named && name.components().all(is_plain)).then(|| name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parsed(first: &str) -> Result<RequestTarget, RequestRefusal> {
        let text = format!("{first}\r\nHost: localhost:8000\r\nAccept: */*\r\n\r\n");
        Request::read(&mut text.as_bytes()).unwrap().map(|request| request.wanted)
    }

    #[test]
    fn what_lies_outside_is_not_found() {
        assert_eq!(parsed("GET / HTTP/1.1"), Ok(RequestTarget::Page));
        assert_eq!(parsed("GET /page.js?a HTTP/1.1"), Ok(RequestTarget::Script));
        assert_eq!(parsed("GET /tiles/0/12.glb HTTP/1.1"), Ok(RequestTarget::File("0/12.glb".into())));
        for path in
            ["/tiles/../a", "/tiles//etc/passwd", "/tiles/%2e%2e/a", "/tiles/.git", "/tiles/", "/a", "/tiles/a\\b"]
        {
            assert_eq!(parsed(&format!("GET {path} HTTP/1.1")), Err("404 Not Found"), "{path}");
        }
        assert_eq!(parsed("POST / HTTP/1.1"), Err("405 Method Not Allowed"));
        assert_eq!(parsed("GET / FTP/1.1"), Err("400 Bad Request"));
        let of_host = |host: &str| {
            let text = format!("GET / HTTP/1.1\r\n{host}\r\n\r\n");
            Request::read(&mut text.as_bytes()).unwrap().is_ok()
        };
        assert!(of_host("host: 127.0.0.1:80") && of_host("Host: [::1]:80") && of_host("Host: localhost"));
        assert!(!of_host("Host: example.org:8000") && !of_host("X: y") && !of_host("Host: localhost.example.org"));
    }

    proptest! {
        #[test]
        fn random_requests_are_answered(bytes in prop::collection::vec(any::<u8>(), 0..300), path in "[ -~]{0,40}") {
            let _ = Request::read(&mut &bytes[..]);
            if let Ok(RequestTarget::File(name)) = parsed(&format!("GET /tiles/{path} HTTP/1.1")) {
                prop_assert!(name.is_relative() && !name.components().any(|part| part == Component::ParentDir));
            }
        }
    }
}
