//! As much of HTTP as one page and its socket need.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Most bytes of a request.
const HEAD_BYTES: usize = 16 << 10;
/// Longest time that a request may take.
const PATIENCE: Duration = Duration::from_secs(10);

/// A request without a body.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Request {
    pub(super) method: String,
    /// Without what follows a question mark.
    pub(super) path: String,
    /// Names in lower case.
    headers: Vec<(String, String)>,
}

impl Request {
    /// A header by its name in lower case.
    pub(super) fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str())
    }

    /// From the head of a request, up to its empty line.
    fn parse(head: &str) -> Option<Self> {
        let mut lines = head.split("\r\n");
        let mut words = lines.next()?.split(' ');
        let (method, target, version) = (words.next()?, words.next()?, words.next()?);
        if words.next().is_some() || !version.starts_with("HTTP/1.") || !target.starts_with('/') {
            return None;
        }
        let header = |line: &str| {
            let (name, value) = line.split_once(':')?;
            Some((name.to_ascii_lowercase(), value.trim().to_owned()))
        };
        let headers = lines.filter(|line| !line.is_empty()).map(header).collect::<Option<_>>()?;
        let path = target.split('?').next().unwrap_or_default().to_owned();
        Some(Self { method: method.to_owned(), path, headers })
    }

    /// Reads a request; `None` when it is none, or takes too long.
    pub(super) fn read(socket: &mut TcpStream) -> Option<Self> {
        let begin = Instant::now();
        socket.set_read_timeout(Some(Duration::from_secs(1))).ok()?;
        let mut head = Vec::new();
        // Byte by byte at its end: what follows belongs to the socket's next owner.
        let mut byte = [0; 1];
        while !head.ends_with(b"\r\n\r\n") {
            if head.len() >= HEAD_BYTES || begin.elapsed() > PATIENCE {
                return None;
            }
            match socket.read(&mut byte) {
                Ok(1) => head.push(byte[0]),
                Ok(_) => return None,
                Err(e)
                    if matches!(
                        e.kind(),
                        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                    ) => {}
                Err(_) => return None,
            }
        }
        Self::parse(std::str::from_utf8(&head).ok()?)
    }
}

/// Answers and says that nothing follows.
pub(super) fn answer(socket: &mut TcpStream, status: &str, kind: &str, body: &[u8]) -> std::io::Result<()> {
    socket.set_write_timeout(Some(PATIENCE))?;
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\
         Cache-Control: no-store\r\nReferrer-Policy: no-referrer\r\nX-Content-Type-Options: nosniff\r\n\
         X-Frame-Options: DENY\r\nContent-Security-Policy: default-src 'none'; script-src 'unsafe-inline'; \
         style-src 'unsafe-inline'; img-src data: blob:; connect-src 'self' ws: wss:\r\n\r\n",
        body.len()
    );
    socket.write_all(head.as_bytes())?;
    socket.write_all(body)
}

/// Accepts the change to a web socket; `None` when the request asks for none.
pub(super) fn upgrade(socket: &mut TcpStream, request: &Request) -> Option<()> {
    let key = request.header("sec-websocket-key")?;
    let wants = request.header("upgrade")?.eq_ignore_ascii_case("websocket")
        && request.header("sec-websocket-version") == Some("13");
    // Pages of others have no business here, even if they learned the address.
    let host = request.header("host")?;
    let own = request.header("origin").is_none_or(|origin| {
        origin.split_once("://").is_some_and(|(_, rest)| rest.eq_ignore_ascii_case(host))
    });
    if !wants || !own {
        return None;
    }
    let accept = tungstenite::handshake::derive_accept_key(key.as_bytes());
    let head = format!(
        "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {accept}\r\n\r\n"
    );
    socket.set_write_timeout(Some(PATIENCE)).ok()?;
    socket.write_all(head.as_bytes()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heads() {
        let request = Request::parse("GET /a/b?c=d HTTP/1.1\r\nHost:  x:1 \r\nX-Y: z\r\n\r\n").unwrap();
        assert_eq!((&*request.method, &*request.path), ("GET", "/a/b"));
        assert_eq!(
            (request.header("host"), request.header("x-y"), request.header("z")),
            (Some("x:1"), Some("z"), None)
        );
        for wrong in
            ["", "GET /", "GET / HTTP/2", "GET / HTTP/1.1 x", "GET x HTTP/1.1", "GET / HTTP/1.1\r\nnothing"]
        {
            assert_eq!(Request::parse(wrong), None, "{wrong}");
        }
    }
}
