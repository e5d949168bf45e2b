//! A worker that connects to its coordinator.

use super::listener::{own_name, with_port};
use super::secure::{Ends, connect};
use super::{GREETING, JOB};
use crate::secret::Secret;
use granita_pyg::frames::{Frame, framed, put_text, receive};
use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The time for which a coordinator that does not listen is tried again. Engines start workers and their coordinator in
/// any order.
const WAIT: Duration = Duration::from_secs(60);

/// The time between two tries.
const PAUSE: Duration = Duration::from_millis(200);

/// The time for one connection to be made.
const CONNECT: Duration = Duration::from_secs(10);

/// The connection to a coordinator, and its work.
pub struct Joined {
    /// The folder that names in `words` are relative to.
    pub folder: PathBuf,
    /// The words of the command line after the name of the program, without "-worker".
    pub words: Vec<String>,
    /// What the coordinator sends.
    pub input: Box<dyn Read + Send>,
    /// What it receives.
    pub output: Box<dyn Write + Send>,
}

impl std::fmt::Debug for Joined {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Joined").field("words", &self.words).finish_non_exhaustive()
    }
}

/// Returns the message with the work of a worker: the folder and the words of the command line.
pub(super) fn job(texts: &[&str]) -> io::Result<Vec<u8>> {
    let mut payload = Vec::new();
    texts.iter().for_each(|text| put_text(text, &mut payload));
    framed(JOB, &[&payload])
}

/// Connects to the coordinator at `HOST[:PORT]`, and receives its work. A coordinator that does not listen or answer is
/// tried again for a minute.
///
/// # Errors
/// Returns the reason why there is no work.
pub fn join(address: &str, secret: &Secret) -> Result<Joined, String> {
    let address = with_port(address).ok_or_else(|| format!("\"{address}\": expected HOST or HOST:PORT"))?;
    let begin = Instant::now();
    let hello = format!("{GREETING}\n{}", own_name());
    let (answer, ends) = loop {
        let error = match dial(&address).map(|stream| connect(stream, secret, hello.as_bytes())) {
            Ok(Ok(connected)) => break connected,
            Ok(Err(error)) => match error.kind() {
                // A network may stall in the middle of a handshake.
                io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock => error,
                // The other side closes the connection of a stranger without a word.
                io::ErrorKind::UnexpectedEof | io::ErrorKind::ConnectionReset => {
                    return Err(format!(
                        "{address}: the coordinator refused the connection; it may have another secret"
                    ));
                }
                _ => return Err(format!("{address}: {error}")),
            },
            Err(error) => error,
        };
        if begin.elapsed() >= WAIT {
            return Err(format!("{address}: {error}"));
        }
        std::thread::sleep(PAUSE);
    };
    if !answer.is_empty() {
        return Err(format!("{address}: the coordinator says: {}", String::from_utf8_lossy(&answer)));
    }
    let Ends { mut reader, writer, .. } = ends;
    let (kind, payload) = receive(&mut reader).map_err(|error| format!("{address}: no work: {error}"))?;
    let mut frame = Frame(&payload);
    let mut texts = Vec::new();
    while !frame.0.is_empty() {
        texts.push(frame.text().ok_or_else(|| format!("{address}: its work is malformed"))?);
    }
    if kind != JOB || texts.is_empty() {
        return Err(format!("{address}: its work is malformed"));
    }
    let words = texts.split_off(1);
    let folder = PathBuf::from(texts.remove(0));
    Ok(Joined { folder, words, input: Box::new(reader), output: Box::new(writer) })
}

/// Connects to the first address of a name that answers.
fn dial(address: &str) -> io::Result<TcpStream> {
    let mut error = io::Error::other("the name has no address");
    for place in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&place, CONNECT) {
            Ok(stream) => return Ok(stream),
            Err(what) => error = what,
        }
    }
    Err(error)
}
