//! Connections between processes that know the same secret.
//!
//! The protocol is that of the Noise Protocol Framework with the pattern NNpsk0 (revision 34, 7.4 and 9): fresh keys
//! for each connection, and a secret that both sides prove to know. After it everything is encrypted and
//! authenticated, in messages of at most 65535 bytes, each after its length of two bytes, the high one first.

use crate::secret::Secret;
use snow::{Builder, HandshakeState, StatelessTransportState};
use std::io::{self, BufReader, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The pattern of the handshake.
const PATTERN: &str = "Noise_NNpsk0_25519_ChaChaPoly_BLAKE2s";

/// The largest message.
const MOST: usize = 65535;

/// The bytes by which encryption makes a message longer.
const TAG: usize = 16;

/// The time for a handshake.
const HANDSHAKE: Duration = Duration::from_secs(10);

/// The time for which the last messages to a process that does not read are kept.
const LAST_WORDS: Duration = Duration::from_secs(2);

/// Both directions of a connection.
pub(crate) struct Ends {
    pub(crate) reader: SecureReader,
    pub(crate) writer: SecureWriter,
    /// The connection itself.
    pub(crate) stream: TcpStream,
}

/// Opens the connection as the side that connects. Sends `hello`, and returns the answer of the other side.
///
/// # Errors
/// Returns an error when the other side does not know the secret, or does not answer within ten seconds.
pub(crate) fn connect(stream: TcpStream, secret: &Secret, hello: &[u8]) -> io::Result<(Vec<u8>, Ends)> {
    let mut pending = Pending::new(stream)?;
    let mut state = state(secret, true)?;
    pending.send(&mut state, hello)?;
    let answer = pending.receive(&mut state)?;
    Ok((answer, pending.finish(state)?))
}

/// Opens the connection as the side that was connected to. `answer` returns the answer to the hello of the other side.
///
/// The other side has proved that it knows the secret when its first message after this is read.
///
/// # Errors
/// Returns an error when the other side does not know the secret, or does not speak within ten seconds.
pub(crate) fn accept(
    stream: TcpStream,
    secret: &Secret,
    answer: impl FnOnce(&[u8]) -> Vec<u8>,
) -> io::Result<Ends> {
    let mut pending = Pending::new(stream)?;
    let mut state = state(secret, false)?;
    let hello = pending.receive(&mut state)?;
    pending.send(&mut state, &answer(&hello))?;
    pending.finish(state)
}

/// Begins a handshake.
fn state(secret: &Secret, connects: bool) -> io::Result<HandshakeState> {
    let pattern = PATTERN.parse().map_err(broken)?;
    let builder = Builder::new(pattern).psk(0, secret.key()).map_err(broken)?;
    if connects { builder.build_initiator() } else { builder.build_responder() }.map_err(broken)
}

/// Returns the error of a message that cannot be decrypted.
fn broken(error: snow::Error) -> io::Error {
    match error {
        snow::Error::Decrypt => {
            io::Error::new(io::ErrorKind::PermissionDenied, "it does not know the secret")
        }
        other => {
            io::Error::new(io::ErrorKind::InvalidData, format!("it does not speak the protocol ({other})"))
        }
    }
}

/// A connection during its handshake, which must be over at a point in time.
struct Pending {
    stream: TcpStream,
    until: Instant,
}

impl Pending {
    fn new(stream: TcpStream) -> io::Result<Self> {
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(HANDSHAKE))?;
        Ok(Self { stream, until: Instant::now() + HANDSHAKE })
    }

    fn send(&mut self, state: &mut HandshakeState, payload: &[u8]) -> io::Result<()> {
        let mut message = vec![0; MOST];
        let n = state.write_message(payload, &mut message).map_err(broken)?;
        write_message(&mut self.stream, &message[..n])
    }

    fn receive(&mut self, state: &mut HandshakeState) -> io::Result<Vec<u8>> {
        let message = read_message(self)?;
        let mut payload = vec![0; MOST];
        let n = state.read_message(&message, &mut payload).map_err(broken)?;
        payload.truncate(n);
        Ok(payload)
    }

    fn finish(self, state: HandshakeState) -> io::Result<Ends> {
        let stream = self.stream;
        stream.set_read_timeout(None)?;
        stream.set_write_timeout(None)?;
        keep_alive(&stream)?;
        let state = Arc::new(state.into_stateless_transport_mode().map_err(broken)?);
        let from = BufReader::with_capacity(MOST + 2, stream.try_clone()?);
        let reader = SecureReader { from, state: state.clone(), number: 0, piece: Vec::new(), at: 0 };
        let writer = SecureWriter { to: stream.try_clone()?, state, number: 0, piece: Vec::new() };
        Ok(Ends { reader, writer, stream })
    }
}

impl Read for Pending {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::Error::new(io::ErrorKind::TimedOut, "it took too long to speak"));
        }
        self.stream.set_read_timeout(Some(left))?;
        self.stream.read(into)
    }
}

/// Has the system find out when the other machine is gone. A network may stall for a minute.
fn keep_alive(stream: &TcpStream) -> io::Result<()> {
    #[cfg(unix)]
    {
        use rustix::net::sockopt;
        sockopt::set_socket_keepalive(stream, true)?;
        #[cfg(target_os = "linux")]
        {
            sockopt::set_tcp_keepidle(stream, Duration::from_secs(15))?;
            sockopt::set_tcp_keepintvl(stream, Duration::from_secs(15))?;
            sockopt::set_tcp_keepcnt(stream, 7)?;
            sockopt::set_tcp_user_timeout(stream, 120_000)?;
        }
    }
    Ok(())
}

fn write_message(to: &mut impl Write, message: &[u8]) -> io::Result<()> {
    let length = u16::try_from(message.len()).map_err(|_| io::Error::other("a message is too long"))?;
    to.write_all(&length.to_be_bytes())?;
    to.write_all(message)?;
    to.flush()
}

fn read_message(from: &mut impl Read) -> io::Result<Vec<u8>> {
    let mut length = [0; 2];
    from.read_exact(&mut length)?;
    let mut message = vec![0; u16::from_be_bytes(length).into()];
    from.read_exact(&mut message)?;
    Ok(message)
}

/// The bytes that the other side sent.
pub(crate) struct SecureReader {
    from: BufReader<TcpStream>,
    state: Arc<StatelessTransportState>,
    number: u64,
    piece: Vec<u8>,
    at: usize,
}

impl Read for SecureReader {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        while self.at == self.piece.len() && !into.is_empty() {
            let message = match read_message(&mut self.from) {
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(0),
                message => message?,
            };
            self.piece.resize(MOST, 0);
            let n = self.state.read_message(self.number, &message, &mut self.piece).map_err(broken)?;
            self.number += 1;
            self.piece.truncate(n);
            self.at = 0;
        }
        let n = into.len().min(self.piece.len() - self.at);
        into[..n].copy_from_slice(&self.piece[self.at..self.at + n]);
        self.at += n;
        Ok(n)
    }
}

/// Sends bytes to the other side.
pub(crate) struct SecureWriter {
    to: TcpStream,
    state: Arc<StatelessTransportState>,
    number: u64,
    /// The bytes that were not sent.
    piece: Vec<u8>,
}

impl SecureWriter {
    fn send(&mut self) -> io::Result<()> {
        let mut message = vec![0; self.piece.len() + TAG];
        let n = self.state.write_message(self.number, &self.piece, &mut message).map_err(broken)?;
        self.number += 1;
        self.piece.clear();
        write_message(&mut self.to, &message[..n])
    }

    /// Sends no more. What was sent is still delivered.
    pub(crate) fn close(mut self) {
        // The other side may be gone.
        let _ = self.to.set_write_timeout(Some(LAST_WORDS));
        let _ = self.flush();
        let _ = self.to.shutdown(Shutdown::Write);
    }
}

impl Write for SecureWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let n = bytes.len().min(MOST - TAG - self.piece.len());
        self.piece.extend_from_slice(&bytes[..n]);
        if self.piece.len() == MOST - TAG {
            self.send()?;
        }
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.piece.is_empty() { Ok(()) } else { self.send() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    const SECRET: &str = "a secret of the tests";

    /// Connects two processes with the texts of their secrets. Returns what each side got.
    #[allow(clippy::type_complexity, reason = "both results of a test")]
    fn pair(here: &str, there: &str) -> (io::Result<(Vec<u8>, Ends)>, io::Result<Ends>) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let secret = Secret::new(there).unwrap();
        let other = std::thread::spawn(move || {
            let answer = |hello: &[u8]| [b"heard ", hello].concat();
            accept(listener.accept().unwrap().0, &secret, answer)
        });
        let own = connect(TcpStream::connect(address).unwrap(), &Secret::new(here).unwrap(), b"it is me");
        (own, other.join().unwrap())
    }

    #[test]
    fn both_sides_read_what_the_other_wrote() {
        let (own, other) = pair(SECRET, &format!(" {SECRET}\n"));
        let ((answer, mut own), mut other) = (own.unwrap(), other.unwrap());
        assert_eq!(answer, b"heard it is me");
        let bytes: Vec<u8> = (0..200_000_u32).flat_map(u32::to_le_bytes).collect();
        let sent = bytes.clone();
        let writer = std::thread::spawn(move || {
            own.writer.write_all(&sent).unwrap();
            own.writer.close();
            let mut rest = Vec::new();
            own.reader.read_to_end(&mut rest).unwrap();
            rest
        });
        let mut got = Vec::new();
        other.reader.read_to_end(&mut got).unwrap();
        assert!(got == bytes);
        other.writer.write_all(b"thanks").unwrap();
        other.writer.close();
        assert_eq!(writer.join().unwrap(), b"thanks");
    }

    #[test]
    fn another_secret_opens_no_connection() {
        let (own, other) = pair(SECRET, "a secret of the other tests");
        assert!(own.is_err());
        assert_eq!(other.err().unwrap().to_string(), "it does not know the secret");
    }

    #[test]
    fn changed_and_repeated_messages_are_refused() {
        for change in [0, 1] {
            let (own, other) = pair(SECRET, SECRET);
            let (mut own, mut other) = (own.unwrap().1, other.unwrap());
            let mut message = vec![0; 5 + TAG];
            own.writer.state.write_message(0, b"hello", &mut message).unwrap();
            if change == 0 {
                message[2] ^= 1;
                write_message(&mut own.stream, &message).unwrap();
            } else {
                write_message(&mut own.stream, &message).unwrap();
                write_message(&mut own.stream, &message).unwrap();
                let mut hello = [0; 5];
                other.reader.read_exact(&mut hello).unwrap();
                assert_eq!(&hello, b"hello");
            }
            assert_eq!(other.reader.read(&mut [0]).unwrap_err().kind(), io::ErrorKind::PermissionDenied);
        }
    }

    #[test]
    fn garbage_is_refused() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let secret = Secret::new(SECRET).unwrap();
        for garbage in [&b"GET / HTTP/1.1\r\n\r\n"[..], &[0, 0], &[0, 3, 1, 2, 3], &[0, 60]] {
            let mut stream = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
            stream.write_all(garbage).unwrap();
            stream.shutdown(Shutdown::Write).unwrap();
            assert!(accept(listener.accept().unwrap().0, &secret, |_| Vec::new()).is_err());
        }
    }
}
