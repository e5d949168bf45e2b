//! Takes pictures from renderers.

use crate::packet::{DEFAULT_PORT, GREETING, PacketLimits, VERSION, rest_of};
use crate::{DisplayError, Packet, Result};
use std::collections::BTreeMap;
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// What clients may take of a server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServerLimits {
    /// What a packet may hold.
    pub packet: PacketLimits,
    /// Most clients at once.
    pub clients: usize,
    /// Longest silence in the middle of a packet. Between packets a client may be silent for ever.
    pub silence: Duration,
    /// Packets without sense, or that fit nothing, until a client is sent away.
    pub mistakes: u32,
}

impl Default for ServerLimits {
    /// 64 clients, 30 s, 100 mistakes.
    fn default() -> Self {
        Self { packet: PacketLimits::default(), clients: 64, silence: Duration::from_secs(30), mistakes: 100 }
    }
}

/// How a client ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// It closed the connection after a whole packet.
    Closed,
    /// Otherwise: why.
    Broken(String),
}

/// Is told what clients say. Called from a thread for each client.
pub trait Sink: Send + Sync {
    /// Takes a packet: types up to vector graphics from anybody, and of clients that know our own packets also
    /// [`Packet::Hello`] (once, when that is known), [`Packet::Mark`], [`Packet::Wish`] and [`Packet::Finished`].
    ///
    /// # Errors
    /// Why it is refused: the client goes on.
    fn packet(&self, client: &Arc<Client>, packet: Packet) -> std::result::Result<(), String>;

    /// Something was refused: told once for each client and cause.
    fn trouble(&self, client: &Client, what: &str);

    /// A client is gone.
    fn gone(&self, client: &Client, ending: &Ending);
}

/// Whoever sends pictures.
#[derive(Debug)]
pub struct Client {
    id: u64,
    address: SocketAddr,
    /// To the thread that sends; there is none before the client asked for it.
    replies: OnceLock<SyncSender<Packet>>,
}

impl Client {
    /// Differs for all clients of a listener.
    pub fn id(&self) -> u64 {
        self.id
    }

    /// Where it is.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Whether it knows our own packets.
    pub fn is_two_way(&self) -> bool {
        self.replies.get().is_some()
    }

    /// Sends one of our own packets, without waiting. `false` when the client does not know them, does not read them, or is
    /// gone.
    pub fn send(&self, packet: Packet) -> bool {
        self.replies.get().is_some_and(|replies| replies.try_send(packet).is_ok())
    }
}

struct Shared {
    limits: ServerLimits,
    sink: Arc<dyn Sink>,
    ending: AtomicBool,
    next_id: AtomicU64,
    /// To end their conversations.
    sockets: Mutex<BTreeMap<u64, TcpStream>>,
}

impl Shared {
    fn sockets(&self) -> MutexGuard<'_, BTreeMap<u64, TcpStream>> {
        self.sockets.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Listens until it is dropped.
pub struct Listener {
    address: SocketAddr,
    shared: Arc<Shared>,
}

impl std::fmt::Debug for Listener {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Listener").field("address", &self.address).finish_non_exhaustive()
    }
}

impl Listener {
    /// Takes clients at `address`; port 0 is any that is free.
    ///
    /// # Errors
    /// [`DisplayError::Io`], as when somebody else listens there.
    pub fn bind(address: SocketAddr, limits: ServerLimits, sink: Arc<dyn Sink>) -> Result<Self> {
        let failed = |source| DisplayError::Io { what: format!("cannot listen on {address}"), source };
        let listener = TcpListener::bind(address).map_err(failed)?;
        let local = listener.local_addr().map_err(failed)?;
        let shared = Arc::new(Shared {
            limits,
            sink,
            ending: AtomicBool::new(false),
            next_id: AtomicU64::new(1),
            sockets: Mutex::default(),
        });
        let own = shared.clone();
        std::thread::Builder::new()
            .name("display listener".to_owned())
            .spawn(move || accept(&own, &listener))
            .map_err(failed)?;
        Ok(Self { address: local, shared })
    }

    /// Where it listens, with the port that was found.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Clients that are there.
    pub fn clients(&self) -> usize {
        self.shared.sockets().len()
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        self.shared.ending.store(true, Ordering::SeqCst);
        for socket in self.shared.sockets().values() {
            let _ = socket.shutdown(Shutdown::Both);
        }
        // Somebody must knock, or it waits for the next client. One that listens everywhere is asked here.
        let mut address = self.address;
        if address.ip().is_unspecified() {
            address.set_ip(match address {
                SocketAddr::V4(_) => std::net::Ipv4Addr::LOCALHOST.into(),
                SocketAddr::V6(_) => std::net::Ipv6Addr::LOCALHOST.into(),
            });
        }
        let _ = TcpStream::connect_timeout(&address, Duration::from_millis(200));
    }
}

fn accept(shared: &Arc<Shared>, listener: &TcpListener) {
    loop {
        let accepted = listener.accept();
        if shared.ending.load(Ordering::SeqCst) {
            return;
        }
        let Ok((socket, address)) = accepted else {
            // As when no more files may be open: time helps.
            std::thread::sleep(Duration::from_millis(50));
            continue;
        };
        let id = shared.next_id.fetch_add(1, Ordering::Relaxed);
        let client = Arc::new(Client { id, address, replies: OnceLock::new() });
        if shared.sockets().len() >= shared.limits.clients {
            shared.sink.trouble(&client, &format!("more than {} clients", shared.limits.clients));
            continue;
        }
        let Ok(clone) = socket.try_clone() else { continue };
        shared.sockets().insert(id, clone);
        let own = shared.clone();
        let spawned = std::thread::Builder::new().name("display client".to_owned()).spawn(move || {
            let ending = converse(&own, &client, socket);
            own.sockets().remove(&id);
            own.sink.gone(&client, &ending);
        });
        if spawned.is_err() {
            shared.sockets().remove(&id);
        }
    }
}

/// Hears a client to its end.
fn converse(shared: &Shared, client: &Arc<Client>, mut socket: TcpStream) -> Ending {
    let limits = &shared.limits;
    let tick = (limits.silence / 4).max(Duration::from_millis(1));
    if socket.set_read_timeout(Some(tick)).is_err() {
        return Ending::Broken("the system refuses a time limit".to_owned());
    }
    let mut mistakes = 0;
    let mut told: Vec<String> = Vec::new();
    let mut bytes = Vec::new();
    loop {
        match read_packet(shared, &mut socket, &mut bytes) {
            Ok(true) => (),
            Ok(false) => return Ending::Closed,
            Err(what) => return Ending::Broken(what),
        }
        let taken = match Packet::decode(&bytes, &limits.packet) {
            Ok(Packet::CloseImage { name }) if name == GREETING => answer(shared, client, &socket),
            Ok(packet) => take(shared, client, packet),
            Err(error) => Err(error.to_string()),
        };
        // One large packet is no reason to keep as much for ever.
        if bytes.capacity() > 16 << 20 {
            bytes = Vec::new();
        }
        if let Err(what) = taken {
            mistakes += 1;
            if told.len() < 8 && !told.contains(&what) {
                shared.sink.trouble(client, &what);
                told.push(what);
            }
            if mistakes >= limits.mistakes {
                return Ending::Broken(format!("{mistakes} packets were refused"));
            }
        }
    }
}

/// Passes on what a client may say.
fn take(shared: &Shared, client: &Arc<Client>, packet: Packet) -> std::result::Result<(), String> {
    match packet {
        Packet::Hello { .. } | Packet::Request { .. } => Err("a packet that clients do not send".to_owned()),
        Packet::Mark { .. } | Packet::Wish { .. } | Packet::Finished { .. } if !client.is_two_way() => {
            Err("a packet of our own before a greeting".to_owned())
        }
        packet => shared.sink.packet(client, packet),
    }
}

/// A client would speak our own packets: a thread sends it what it will be told.
fn answer(shared: &Shared, client: &Arc<Client>, socket: &TcpStream) -> std::result::Result<(), String> {
    if client.is_two_way() {
        return Ok(());
    }
    let mut socket = socket.try_clone().map_err(|e| e.to_string())?;
    let (replies, waiting) = sync_channel::<Packet>(64);
    let hello = Packet::Hello { version: VERSION };
    let _ = replies.try_send(hello.clone());
    let _ = client.replies.set(replies);
    let _ = socket.set_nodelay(true);
    let _ = socket.set_write_timeout(Some(Duration::from_secs(1)));
    std::thread::Builder::new()
        .name("display replies".to_owned())
        .spawn(move || {
            let mut bytes = Vec::new();
            // Ends with the client.
            for packet in waiting {
                bytes.clear();
                if packet.encode(&mut bytes).is_ok() && socket.write_all(&bytes).is_err() {
                    break;
                }
            }
        })
        .map_err(|e| e.to_string())?;
    shared.sink.packet(client, hello)
}

/// Reads a packet into `bytes`; `false` at the end between packets.
fn read_packet(
    shared: &Shared,
    socket: &mut TcpStream,
    bytes: &mut Vec<u8>,
) -> std::result::Result<bool, String> {
    bytes.clear();
    let mut length = [0; 4];
    if !read(shared, socket, 4, bytes)? {
        return Ok(false);
    }
    length.copy_from_slice(&bytes[..4]);
    let rest = rest_of(length, &shared.limits.packet).map_err(|e| e.to_string())?;
    read(shared, socket, 4 + rest, bytes)
}

/// Reads until there are `count` bytes; memory grows with what comes, not with what was announced.
fn read(
    shared: &Shared,
    socket: &mut TcpStream,
    count: usize,
    bytes: &mut Vec<u8>,
) -> std::result::Result<bool, String> {
    let mut last = Instant::now();
    while bytes.len() < count {
        let at = bytes.len();
        let part = (count - at).min((at / 2).max(1 << 16));
        bytes.resize(at + part, 0);
        let result = socket.read(&mut bytes[at..]);
        bytes.truncate(at + *result.as_ref().unwrap_or(&0));
        match result {
            Ok(0) if at == 0 => return Ok(false),
            Ok(0) => return Err("it ended in the middle of a packet".to_owned()),
            Ok(_) => last = Instant::now(),
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) =>
            {
                if shared.ending.load(Ordering::Relaxed) {
                    return Ok(false);
                }
                if at > 0 && last.elapsed() >= shared.limits.silence {
                    return Err("it fell silent in the middle of a packet".to_owned());
                }
            }
            Err(error) => return Err(format!("the connection broke ({error})")),
        }
    }
    Ok(true)
}

/// An address to listen on: `PORT` of this machine only, or `ADDR:PORT`, where the address "*" is every one of this machine.
///
/// # Errors
/// [`DisplayError::Misuse`].
pub fn listen_address(text: &str) -> Result<SocketAddr> {
    let wrong = || DisplayError::Misuse { what: format!("\"{text}\" is not [ADDRESS:]PORT") };
    let (host, port) = match text.rsplit_once(':') {
        Some((host, port)) => (host, port),
        None => ("", text),
    };
    let port: u16 = port.parse().map_err(|_| wrong())?;
    let host = host.trim_start_matches('[').trim_end_matches(']');
    match host {
        "" | "localhost" => Ok((std::net::Ipv4Addr::LOCALHOST, port).into()),
        "*" => Ok((std::net::Ipv4Addr::UNSPECIFIED, port).into()),
        host => (host, port).to_socket_addrs().ok().and_then(|mut a| a.next()).ok_or_else(wrong),
    }
}

/// The host and port of a viewer: `HOST`, `HOST:PORT`, `:PORT`; an IPv6 address with a port stands in brackets.
///
/// # Errors
/// [`DisplayError::Misuse`].
pub fn server_address(text: &str) -> Result<(String, u16)> {
    let wrong = || DisplayError::Misuse { what: format!("\"{text}\" is not HOST[:PORT]") };
    let plain = |host: &str| host.trim_start_matches('[').trim_end_matches(']').to_owned();
    // Of several colons none begins a port, unless brackets say where the address ends.
    let (host, port) = match text.rsplit_once(':') {
        Some((host, port)) if !host.contains(':') || host.ends_with(']') => {
            (plain(host), port.parse().map_err(|_| wrong())?)
        }
        _ => (plain(text), DEFAULT_PORT),
    };
    if port == 0 || host.contains(|c: char| c.is_whitespace() || c == '/') {
        return Err(wrong());
    }
    Ok((if host.is_empty() { "localhost".to_owned() } else { host }, port))
}
