//! The subset of HTTP that one page and its socket need.

use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, TcpStream};
use std::time::{Duration, Instant};

/// The largest number of bytes of a request.
const HEAD_BYTES: usize = 16 << 10;
/// The largest number of headers of a request.
const HEADERS: usize = 100;
/// The longest time for reading a request, and for a write of an answer.
const PATIENCE: Duration = Duration::from_secs(10);

/// A request without a body.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Request {
    pub(super) method: String,
    /// The path without the part from a question mark on.
    pub(super) path: String,
    /// Pairs of name and value. Names are in lower case.
    headers: Vec<(String, String)>,
}

impl Request {
    /// Returns the value of a header, given its name in lower case.
    pub(super) fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str())
    }

    /// Parses a request. Returns it and the number of its bytes; `Ok(None)` when the bytes are only its beginning.
    ///
    /// # Errors
    /// Returns an error when the bytes are not a request, or when the request has content.
    fn parse(bytes: &[u8]) -> Result<Option<(Self, usize)>, ()> {
        let mut headers = [httparse::EMPTY_HEADER; HEADERS];
        let mut request = httparse::Request::new(&mut headers);
        let httparse::Status::Complete(length) = request.parse(bytes).map_err(drop)? else { return Ok(None) };
        let (method, target) = (request.method.ok_or(())?, request.path.ok_or(())?);
        if !target.starts_with('/') {
            return Err(());
        }
        let header = |header: &httparse::Header<'_>| {
            let value = std::str::from_utf8(header.value).map_err(drop)?;
            Ok((header.name.to_ascii_lowercase(), value.trim().to_owned()))
        };
        let headers = request.headers.iter().map(header).collect::<Result<Vec<_>, ()>>()?;
        // Requests have no content here. Content would be mistaken for messages of the web socket.
        let brings = |(name, value): &(String, String)| match &**name {
            "content-length" => value != "0",
            "transfer-encoding" => true,
            // Two Host headers would be ambiguous.
            "host" => headers.iter().filter(|(name, _)| name == "host").count() > 1,
            _ => false,
        };
        if headers.iter().any(brings) {
            return Err(());
        }
        let path = target.split('?').next().unwrap_or_default().to_owned();
        Ok(Some((Self { method: method.to_owned(), path, headers }, length)))
    }

    /// Reads a request and the bytes after it. Returns `None` when the bytes are not a request, or when it takes too
    /// long.
    pub(super) fn read(socket: &mut TcpStream) -> Option<(Self, Vec<u8>)> {
        let begin = Instant::now();
        socket.set_read_timeout(Some(Duration::from_secs(1))).ok()?;
        let mut bytes = Vec::new();
        let mut part = [0; 2048];
        while bytes.len() < HEAD_BYTES && begin.elapsed() <= PATIENCE {
            match socket.read(&mut part) {
                Ok(0) => return None,
                Ok(count) => {
                    bytes.extend_from_slice(&part[..count]);
                    if let Some((request, length)) = Self::parse(&bytes).ok()? {
                        bytes.drain(..length);
                        return Some((request, bytes));
                    }
                }
                Err(e)
                    if matches!(
                        e.kind(),
                        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                    ) => {}
                Err(_) => return None,
            }
        }
        None
    }
}

/// The hosts that browsers may request.
///
/// A page of another origin can make a browser request this server under a name of its own ("DNS rebinding"), and
/// then counts as the server's own page. Addresses and the names of this machine cannot be taken over in that way.
#[derive(Debug)]
pub(super) struct Hosts {
    /// The address on which the server listens.
    address: IpAddr,
    /// Further names of the server, in lower case.
    names: Vec<String>,
}

impl Hosts {
    /// Returns the hosts of a server that listens on `address` and also has `names`.
    pub(super) fn new(address: IpAddr, names: &[String]) -> Self {
        let bare = |name: &String| name.trim_end_matches('.').to_ascii_lowercase();
        Self { address, names: names.iter().map(bare).collect() }
    }

    /// True when a browser may request `host`, the value of a header. It is a name or address with or without a port.
    /// The port is not checked, because a tunnel of ssh may change it.
    pub(super) fn accept(&self, host: &str) -> bool {
        let name = match host.strip_prefix('[') {
            Some(rest) => rest.split_once(']').map_or("", |(name, _)| name),
            None => host.split_once(':').map_or(host, |(name, _)| name),
        };
        if let Ok(address) = name.parse::<IpAddr>() {
            return self.address.is_unspecified() || address == self.address || address.is_loopback();
        }
        let name = name.trim_end_matches('.').to_ascii_lowercase();
        name == "localhost" || self.names.contains(&name)
    }
}

/// Sends an answer and closes the connection.
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

/// Accepts the change to a web socket. Returns `None` when the request is not one for a web socket.
pub(super) fn upgrade(socket: &mut TcpStream, request: &Request) -> Option<()> {
    let key = request.header("sec-websocket-key")?;
    let wants = request.header("upgrade")?.eq_ignore_ascii_case("websocket")
        && request.header("sec-websocket-version") == Some("13");
    // Pages of other origins are refused, even with the right address.
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

    fn parse(text: &str) -> Result<Option<(Request, usize)>, ()> {
        Request::parse(text.as_bytes())
    }

    #[test]
    fn request_headers_are_parsed() {
        let text = "GET /a/b?c=d HTTP/1.1\r\nHost:  x:1 \r\nX-Y: z\r\nContent-Length: 0\r\n\r\n";
        let (request, length) = parse(&format!("{text}more")).unwrap().unwrap();
        assert_eq!((&*request.method, &*request.path, length), ("GET", "/a/b", text.len()));
        assert_eq!(
            (request.header("host"), request.header("x-y"), request.header("z")),
            (Some("x:1"), Some("z"), None)
        );
        for part in ["", "GET", "GET /", "GET / HTTP/1.1\r\nA: b\r\n"] {
            assert_eq!(parse(part), Ok(None), "{part}");
        }
        for wrong in [
            "GET / HTTP/2\r\n\r\n",
            "GET / HTTP/1.1 x\r\n\r\n",
            "GET x HTTP/1.1\r\n\r\n",
            "GET / HTTP/1.1\r\nnothing\r\n\r\n",
            "GET / HTTP/1.1\r\nContent-Length: 99999999999999999999\r\n\r\n",
            "GET / HTTP/1.1\r\nContent-Length: 1\r\n\r\nx",
            "GET / HTTP/1.1\r\nContent-Length: 0\r\nContent-Length: 7\r\n\r\n",
            "GET / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
            &format!("GET / HTTP/1.1\r\n{}\r\n", "a: b\r\n".repeat(HEADERS + 1)),
        ] {
            assert_eq!(parse(wrong), Err(()), "{wrong}");
        }
    }

    #[test]
    fn hosts_are_accepted_or_refused() {
        let at = |address: &str, names: &[&str]| {
            let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
            Hosts::new(address.parse().unwrap(), &names)
        };
        let here = at("127.0.0.1", &[]);
        for own in
            ["127.0.0.1:80", "127.0.0.1", "localhost:9", "LocalHost", "localhost.", "[::1]:9", "127.0.0.2"]
        {
            assert!(here.accept(own), "{own}");
        }
        for foreign in
            ["", "evil.example", "evil.example:80", "10.0.0.1:80", "localhost.evil", "[", "[::2]:9"]
        {
            assert!(!here.accept(foreign), "{foreign}");
        }
        let there = at("192.168.1.5", &["Render-Box.lan."]);
        assert!(
            there.accept("192.168.1.5:80") && there.accept("render-box.lan:80") && there.accept("localhost")
        );
        assert!(!there.accept("192.168.1.6") && !there.accept("render-box"));
        // A server that listens everywhere cannot list all its addresses. DNS rebinding needs a name.
        let everywhere = at("0.0.0.0", &[]);
        assert!(everywhere.accept("10.1.2.3:80") && !everywhere.accept("evil.example"));
    }
}
