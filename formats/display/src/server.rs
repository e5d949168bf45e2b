//! Receives images from renderers.

use crate::packet::{DEFAULT_PORT, GREETING, PacketLimits, VERSION, rest_of};
use crate::places::{Place, Places, Sparingly};
use crate::{DisplayError, Packet, Result};
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// The limits of clients on a server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServerLimits {
    /// The limits of a packet.
    pub packet: PacketLimits,
    /// The largest number of clients at once.
    pub clients: usize,
    /// The largest number of clients at once of one address.
    pub clients_of_address: usize,
    /// The longest time until a client has sent its first whole packet. A client whose place is needed for another one
    /// ends sooner.
    pub first_packet: Duration,
    /// The longest silence in the middle of a packet. A packet also ends its client when it arrives slower than
    /// [`ServerLimits::bytes_per_second`] after that time. Between packets a client may be silent without limit,
    /// because a bucket may take any time.
    pub silence: Duration,
    /// The lowest rate at which the bytes of a packet must arrive.
    pub bytes_per_second: u32,
    /// The number of invalid or refused packets after which a client is disconnected.
    pub mistakes: u32,
}

impl Default for ServerLimits {
    /// Returns 64 clients, 48 of one address, 120 s for the first packet (renderers connect before they read their
    /// scene), 30 s of silence, 1024 bytes per second, 100 errors.
    fn default() -> Self {
        Self {
            packet: PacketLimits::default(),
            clients: 64,
            clients_of_address: 48,
            first_packet: Duration::from_secs(120),
            silence: Duration::from_secs(30),
            bytes_per_second: 1024,
            mistakes: 100,
        }
    }
}

/// The reason why a client ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// The client closed the connection after a whole packet.
    Closed,
    /// The connection ended otherwise. The value is the reason.
    Broken(String),
}

/// Receives the packets of clients. It is called from one thread for each client.
pub trait Sink: Send + Sync {
    /// Receives a packet. Any client may send types up to vector graphics. Clients that support the extension also
    /// send [`Packet::Hello`] (once, when that is established), [`Packet::Mark`], [`Packet::Wish`],
    /// [`Packet::Panel`] and [`Packet::Finished`].
    ///
    /// # Errors
    /// Returns the reason when the packet is refused. The client stays connected.
    fn packet(&self, client: &Arc<Client>, packet: Packet) -> std::result::Result<(), String>;

    /// Reports a refusal, once for each client and cause.
    fn trouble(&self, client: &Client, what: &str);

    /// Reports that a client is disconnected.
    fn gone(&self, client: &Client, ending: &Ending);
}

/// A sender of images.
#[derive(Debug)]
pub struct Client {
    id: u64,
    address: SocketAddr,
    /// The channel to the thread that sends. It does not exist before the client requested the extension.
    replies: OnceLock<SyncSender<Packet>>,
}

impl Client {
    /// Returns the id, which differs for all clients of a listener.
    pub fn id(&self) -> u64 {
        self.id
    }

    /// Returns the address of the client.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// True when the client supports the extension.
    pub fn is_two_way(&self) -> bool {
        self.replies.get().is_some()
    }

    /// Sends a packet of the extension, without blocking. Returns `false` when the client does not support it, does
    /// not read it, or is disconnected.
    pub fn send(&self, packet: Packet) -> bool {
        self.replies.get().is_some_and(|replies| replies.try_send(packet).is_ok())
    }
}

struct Shared {
    limits: ServerLimits,
    sink: Arc<dyn Sink>,
    places: Arc<Places>,
}

/// A listener, which accepts clients until it is dropped.
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
    /// Accepts clients at `address`. Port 0 is any free port.
    ///
    /// # Errors
    /// Returns [`DisplayError::Io`], for example when another process listens there.
    pub fn bind(address: SocketAddr, limits: ServerLimits, sink: Arc<dyn Sink>) -> Result<Self> {
        let failed = |source| DisplayError::Io { what: format!("cannot listen on {address}"), source };
        let listener = TcpListener::bind(address).map_err(failed)?;
        let local = listener.local_addr().map_err(failed)?;
        let places = Places::new(limits.clients, limits.clients_of_address);
        let shared = Arc::new(Shared { limits, sink, places });
        let own = shared.clone();
        std::thread::Builder::new()
            .name("display listener".to_owned())
            .spawn(move || accept(&own, &listener))
            .map_err(failed)?;
        Ok(Self { address: local, shared })
    }

    /// Returns the address on which it listens, with the assigned port.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Returns the number of connected clients.
    pub fn clients(&self) -> usize {
        self.shared.places.count()
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        self.shared.places.close(self.address);
    }
}

fn accept(shared: &Arc<Shared>, listener: &TcpListener) {
    let mut refusals = Sparingly::new(1, Duration::from_secs(60));
    for id in 1.. {
        let accepted = listener.accept();
        if shared.places.is_ending() {
            return;
        }
        let Ok((socket, address)) = accepted else {
            // For example, the limit of open files is reached. A later attempt may succeed.
            std::thread::sleep(Duration::from_millis(50));
            continue;
        };
        let client = Arc::new(Client { id, address, replies: OnceLock::new() });
        let place = match shared.places.take(id, &socket, address) {
            Ok(place) => place,
            Err(refusal) => {
                if let Some(text) = refusals.say(Instant::now(), &refusal.to_string()) {
                    shared.sink.trouble(&client, &text);
                }
                continue;
            }
        };
        let own = shared.clone();
        // When no thread can be created, the connection is closed.
        let _ = std::thread::Builder::new().name("display client".to_owned()).spawn(move || {
            let ending = converse(&own, &client, socket, &place);
            drop(place);
            own.sink.gone(&client, &ending);
        });
    }
}

/// Receives the packets of a client until it ends.
fn converse(shared: &Shared, client: &Arc<Client>, mut socket: TcpStream, place: &Place) -> Ending {
    let limits = &shared.limits;
    let tick = (limits.silence.min(limits.first_packet) / 4).max(Duration::from_millis(1));
    if socket.set_read_timeout(Some(tick)).is_err() {
        return Ending::Broken("the system refuses a time limit".to_owned());
    }
    let mut mistakes = 0;
    let mut told: Vec<String> = Vec::new();
    let mut bytes = Vec::new();
    let mut patience = Some(limits.first_packet);
    loop {
        match read_packet(shared, &mut socket, patience.take(), &mut bytes) {
            Ok(true) => place.heard(),
            Ok(false) => return Ending::Closed,
            Err(what) => return Ending::Broken(what),
        }
        let taken = match Packet::decode(&bytes, &limits.packet) {
            Ok(Packet::CloseImage { name }) if name == GREETING => answer(shared, client, &socket),
            Ok(packet) => take(shared, client, packet),
            Err(error) => Err(error.to_string()),
        };
        // One large packet does not justify keeping that much memory.
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

/// Passes on the packets that a client may send.
fn take(shared: &Shared, client: &Arc<Client>, packet: Packet) -> std::result::Result<(), String> {
    match packet {
        Packet::Hello { .. } | Packet::Request { .. } | Packet::Edit { .. } => {
            Err("a packet that clients do not send".to_owned())
        }
        Packet::Mark { .. } | Packet::Wish { .. } | Packet::Finished { .. } | Packet::Panel { .. }
            if !client.is_two_way() =>
        {
            Err("a packet of the extension before a greeting".to_owned())
        }
        packet => shared.sink.packet(client, packet),
    }
}

/// Starts a thread that sends packets to a client, which has requested the extension.
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
            // The loop ends with the client.
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

/// Reads a packet into `bytes`. Its first byte must arrive within `patience` where that is given. Returns `false` at
/// the end between packets.
fn read_packet(
    shared: &Shared,
    socket: &mut TcpStream,
    patience: Option<Duration>,
    bytes: &mut Vec<u8>,
) -> std::result::Result<bool, String> {
    bytes.clear();
    let mut clock = Clock { begin: Instant::now(), last: Instant::now(), patience };
    let mut length = [0; 4];
    if !read(shared, socket, 4, &mut clock, bytes)? {
        return Ok(false);
    }
    length.copy_from_slice(&bytes[..4]);
    let rest = rest_of(length, &shared.limits.packet).map_err(|e| e.to_string())?;
    read(shared, socket, 4 + rest, &mut clock, bytes)
}

/// The times of a packet.
struct Clock {
    /// The time at which waiting for the packet began, then the time of its first byte.
    begin: Instant,
    /// The time of the last bytes.
    last: Instant,
    /// The longest wait for the first byte.
    patience: Option<Duration>,
}

impl Clock {
    /// Records that bytes were received, after `count` bytes of the packet.
    fn bytes_came(&mut self, count: usize) {
        self.last = Instant::now();
        if count == 0 {
            self.begin = self.last;
        }
    }

    /// Returns the reason why the client must be disconnected, when `count` bytes of a packet are available.
    fn fault(&self, count: usize, limits: &ServerLimits) -> Option<&'static str> {
        if count == 0 {
            let late = self.patience.is_some_and(|patience| self.begin.elapsed() >= patience);
            return late.then_some("it sent nothing");
        }
        if self.last.elapsed() >= limits.silence {
            return Some("it stopped in the middle of a packet");
        }
        let granted = limits.silence.as_secs_f64() + count as f64 / f64::from(limits.bytes_per_second.max(1));
        (self.begin.elapsed().as_secs_f64() > granted).then_some("its packet came too slowly")
    }
}

/// Reads until there are `count` bytes. Memory grows with the received data, not with the announced length.
fn read(
    shared: &Shared,
    socket: &mut TcpStream,
    count: usize,
    clock: &mut Clock,
    bytes: &mut Vec<u8>,
) -> std::result::Result<bool, String> {
    while bytes.len() < count {
        let at = bytes.len();
        let part = (count - at).min((at / 2).max(1 << 16));
        bytes.resize(at + part, 0);
        let result = socket.read(&mut bytes[at..]);
        bytes.truncate(at + *result.as_ref().unwrap_or(&0));
        match result {
            Ok(0) if at == 0 => return Ok(false),
            Ok(0) => return Err("it ended in the middle of a packet".to_owned()),
            Ok(_) => clock.bytes_came(at),
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) =>
            {
                if shared.places.is_ending() {
                    return Ok(false);
                }
            }
            Err(error) => return Err(format!("the connection broke ({error})")),
        }
        if let Some(fault) = clock.fault(bytes.len(), &shared.limits) {
            return Err(fault.to_owned());
        }
    }
    Ok(true)
}

/// Parses an address to listen on. It is `PORT` of this machine only, or `ADDR:PORT`, where the address "*" is every
/// address of this machine.
///
/// # Errors
/// Returns [`DisplayError::Misuse`] when the text is not such an address.
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

/// Parses the host and port of a viewer: `HOST`, `HOST:PORT` or `:PORT`. An IPv6 address with a port is in brackets.
///
/// # Errors
/// Returns [`DisplayError::Misuse`] when the text is not such an address.
pub fn server_address(text: &str) -> Result<(String, u16)> {
    let wrong = || DisplayError::Misuse { what: format!("\"{text}\" is not HOST[:PORT]") };
    let plain = |host: &str| host.trim_start_matches('[').trim_end_matches(']').to_owned();
    // With several colons none begins a port, unless brackets mark the end of the address.
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
