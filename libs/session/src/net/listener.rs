//! The port at which workers connect by themselves.

use super::connection::Worker;
use super::secure::{Ends, accept};
use super::{GLANCE, GREETING, PORT, Shared};
use crate::patient::Patience;
use crate::secret::Secret;
use granita_base::{Location, Severity};
use std::io;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::JoinHandle;

/// The largest number of connections that have not proved that they know the secret. More are closed.
const MOST_UNKNOWN: usize = 256;

/// A port at which workers connect, until this is dropped.
pub(super) struct Listener {
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    port: u16,
}

/// What a thread needs for accepting a worker.
struct Welcome {
    secret: Secret,
    /// The message with the work.
    job: Vec<u8>,
    patience: Patience,
    shared: Arc<Shared>,
    unknown: AtomicUsize,
}

impl Listener {
    /// Listens at an address of this machine, all of them where `host` is empty, and at a port that the system chooses
    /// where `port` is 0.
    ///
    /// # Errors
    /// The errors of the system.
    pub(super) fn start(
        host: &str,
        port: u16,
        secret: Secret,
        job: Vec<u8>,
        patience: &Patience,
        shared: &Arc<Shared>,
    ) -> io::Result<Self> {
        let listener = match host {
            // Both families of addresses, where the system has the second one.
            "" => TcpListener::bind(("::", port)).or_else(|_| TcpListener::bind(("0.0.0.0", port)))?,
            host => TcpListener::bind((host, port))?,
        };
        listener.set_nonblocking(true)?;
        let port = listener.local_addr()?.port();
        let ends = Arc::new(AtomicBool::new(false));
        let (unknown, patience, shared) = (AtomicUsize::new(0), patience.clone(), shared.clone());
        let welcome = Arc::new(Welcome { secret, job, patience, shared, unknown });
        let is_over = ends.clone();
        let thread = std::thread::Builder::new().name("listener".to_owned()).spawn(move || {
            while !is_over.load(Ordering::Relaxed) {
                match listener.accept() {
                    Ok((stream, address)) => welcome.clone().accept(stream, address),
                    // Nobody connects, or a connection ended before it was accepted.
                    Err(_) => std::thread::sleep(GLANCE / 2),
                }
            }
        })?;
        Ok(Self { ends, thread: Some(thread), port })
    }

    /// Returns the address at which workers connect, with the name of this machine where `host` is empty.
    pub(super) fn address(&self, host: &str) -> String {
        let host = match host {
            "" => own_name(),
            host if host.contains(':') => format!("[{host}]"),
            host => host.to_owned(),
        };
        format!("{host}:{}", self.port)
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        // A panic of the thread was printed, and no more connections are accepted.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Returns the name of this machine.
pub(super) fn own_name() -> String {
    #[cfg(unix)]
    {
        rustix::system::uname().nodename().to_string_lossy().into_owned()
    }
    #[cfg(not(unix))]
    {
        "localhost".to_owned()
    }
}

impl Welcome {
    /// Accepts a connection in a thread of its own.
    fn accept(self: Arc<Self>, stream: TcpStream, address: SocketAddr) {
        if self.unknown.fetch_add(1, Ordering::Relaxed) >= MOST_UNKNOWN {
            self.unknown.fetch_sub(1, Ordering::Relaxed);
            self.refuse(address, "too many others are waiting");
            return;
        }
        std::thread::spawn(move || {
            let worker = self.admit(stream, address);
            self.unknown.fetch_sub(1, Ordering::Relaxed);
            match worker {
                Ok(worker) => {
                    self.shared.reporter.info(format!("-net: the worker on {} joins", worker.name));
                    self.shared.add(worker);
                }
                Err(what) => self.refuse(address, &what),
            }
        });
    }

    fn admit(&self, stream: TcpStream, address: SocketAddr) -> Result<Worker, String> {
        stream.set_nonblocking(false).map_err(|error| error.to_string())?;
        let (mut name, mut refused) = (String::new(), None);
        let answer = |hello: &[u8]| {
            let hello = String::from_utf8_lossy(hello);
            let (greeting, host) = hello.split_once('\n').unwrap_or((&hello, ""));
            let host: String = host.chars().filter(|c| !c.is_control()).take(100).collect();
            name = format!("{host} ({})", address.ip().to_canonical());
            if greeting == GREETING {
                return Vec::new();
            }
            let start: String = greeting.chars().filter(|c| !c.is_control()).take(80).collect();
            let text = format!("it is \"{start}\", and this is \"{GREETING}\"");
            refused = Some(text.clone());
            text.into_bytes()
        };
        let ends: Ends = accept(stream, &self.secret, answer).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => "it does not speak the protocol".to_owned(),
            io::ErrorKind::WouldBlock => "it took too long to speak".to_owned(),
            _ => error.to_string(),
        })?;
        match refused {
            Some(what) => Err(what),
            None => Worker::joined(&name, ends, self.job.clone(), &self.patience),
        }
    }

    /// Reports a connection that was refused, once for each machine and cause.
    fn refuse(&self, address: SocketAddr, what: &str) {
        let text = format!("-net: a connection from {} was refused: {what}", address.ip().to_canonical());
        self.shared.reporter.once(&text, Severity::Warning, &Location::default(), text.clone());
    }
}

/// Completes the address of a coordinator with the port that "listen" waits at. Returns `None` for what is no address:
/// a name must not be empty, and what follows its colon must be a port.
pub(super) fn with_port(address: &str) -> Option<String> {
    let host = address.split_once(':').map_or(address, |(host, _)| host);
    let is_numeric = address.starts_with('[') || address.parse::<std::net::Ipv6Addr>().is_ok();
    let port = address.split_once(':').map(|(_, port)| port.parse::<u16>());
    if !is_numeric && (host.is_empty() || port.is_some_and(|port| port.is_err())) {
        return None;
    }
    let has_port = address.rsplit_once(':').is_some_and(|(host, port)| {
        port.parse::<u16>().is_ok() && (!host.contains(':') || host.ends_with(']'))
    });
    Some(match (has_port, address.contains(':') && !address.starts_with('[')) {
        (true, _) => address.to_owned(),
        (false, true) => format!("[{address}]:{PORT}"),
        (false, false) => format!("{address}:{PORT}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_have_a_port_by_default() {
        for (address, expected) in [
            ("alpha", "alpha:14159"),
            ("alpha:80", "alpha:80"),
            ("10.0.0.1", "10.0.0.1:14159"),
            ("[::1]", "[::1]:14159"),
            ("[::1]:80", "[::1]:80"),
            ("::1", "[::1]:14159"),
        ] {
            assert_eq!(with_port(address).as_deref(), Some(expected));
        }
        for address in ["", ":80", "alpha:", "alpha:1x", "alpha:99999", "alpha:80:80"] {
            assert_eq!(with_port(address), None, "{address}");
        }
    }

    const SECRET: &str = "a secret of the tests";

    /// Starts a listener, and returns it with what is shared, the messages, and its address.
    #[allow(clippy::type_complexity, reason = "the parts of a test")]
    fn listening()
    -> (Listener, Arc<Shared>, Arc<parking_lot::Mutex<Vec<granita_base::report::Message>>>, String) {
        let (reporter, messages) = granita_base::Reporter::collecting();
        let shared = Arc::new(Shared {
            reporter,
            workers: parking_lot::Mutex::default(),
            state: parking_lot::Mutex::default(),
            listens: AtomicBool::new(true),
            launching: AtomicUsize::new(0),
            ends: AtomicBool::new(false),
        });
        let job = super::super::join::job(&["/scene", "a.pyg"]).unwrap();
        let secret = Secret::new(SECRET).unwrap();
        let listener = Listener::start("127.0.0.1", 0, secret, job, &Patience::new(2.0), &shared).unwrap();
        let address = listener.address("127.0.0.1");
        (listener, shared, messages, address)
    }

    #[test]
    fn workers_of_another_version_are_refused_by_name() {
        let (_listener, shared, messages, address) = listening();
        let stream = TcpStream::connect(address).unwrap();
        let hello = b"granita-worker 0.0.1/1\nalpha";
        let (answer, _ends) =
            super::super::secure::connect(stream, &Secret::new(SECRET).unwrap(), hello).unwrap();
        let expected = format!("it is \"granita-worker 0.0.1/1\", and this is \"{GREETING}\"");
        assert_eq!(String::from_utf8_lossy(&answer), expected);
        let begin = std::time::Instant::now();
        while messages.lock().is_empty() && begin.elapsed().as_secs() < 20 {
            std::thread::sleep(GLANCE);
        }
        assert!(messages.lock()[0].text.contains(&expected), "{:?}", messages.lock());
        assert!(shared.workers.lock().is_empty());
    }

    /// The largest length that a message can name, before the connection is secure and after that.
    #[test]
    fn oversized_messages_cost_no_memory() {
        use std::io::{Read, Write};
        let (_listener, shared, messages, address) = listening();
        let mut stranger = TcpStream::connect(&address).unwrap();
        stranger.write_all(&[0xff; 4096]).unwrap();
        stranger.shutdown(std::net::Shutdown::Write).unwrap();
        // The other side closes, or resets what was not read.
        let _ = stranger.read_to_end(&mut Vec::new());
        assert!(shared.workers.lock().is_empty());
        let stream = TcpStream::connect(&address).unwrap();
        let hello = format!("{GREETING}\nalpha");
        let secret = Secret::new(SECRET).unwrap();
        let (_, mut ends) = super::super::secure::connect(stream, &secret, hello.as_bytes()).unwrap();
        // A greeting without an end.
        for _ in 0..64 {
            let sent = ends.writer.write_all(&[b'x'; 1 << 16]).and_then(|()| ends.writer.flush());
            if sent.is_err() {
                break;
            }
        }
        let begin = std::time::Instant::now();
        while messages.lock().len() < 2 && begin.elapsed().as_secs() < 20 {
            std::thread::sleep(GLANCE);
        }
        assert_eq!(messages.lock().len(), 2, "{:?}", messages.lock());
        assert!(shared.workers.lock().is_empty());
    }
}
