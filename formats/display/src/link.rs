//! A connection to a viewer, with a queue, and threads that send and receive.
//!
//! The renderer only appends to the queue. One thread connects and sends. When the viewer reads nothing for some time,
//! or the queue exceeds its limit, the connection is closed, and the next send returns the reason. Another thread
//! receives the packets of the viewer, if it sends any.

use crate::packet::{GREETING, PacketLimits, Update, VERSION, rest_of};
use crate::{DisplayError, Packet, Result};
use granita_image::Request;
use parking_lot::{Condvar, Mutex, MutexGuard};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpStream, ToSocketAddrs};
use std::ops::Range;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The limits of a sender.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// The longest time until the viewer accepts the connection.
    pub connect: Duration,
    /// The longest time in which the viewer reads nothing of the data.
    pub stall: Duration,
    /// The time to wait for the answer to the greeting. A later answer is valid as well, but the images have started
    /// by then.
    pub answer: Duration,
    /// The largest number of bytes of pixels that wait to be sent.
    pub queue_bytes: usize,
}

impl Default for Patience {
    /// Returns 3 s to connect, 5 s without reading, 0.25 s for an answer, and 256 MiB.
    fn default() -> Self {
        Self {
            connect: Duration::from_secs(3),
            stall: Duration::from_secs(5),
            answer: Duration::from_millis(250),
            queue_bytes: 256 << 20,
        }
    }
}

/// The interval at which a thread that waits for the system checks whether it should end.
const TICK: Duration = Duration::from_millis(50);
/// The time during which small packets are collected before they are sent together. It is too short to be visible, and
/// waking a thread for each bucket would take more time of the render than all other work for the viewer. Parts of a
/// panel are not delayed, because a user waits for them and the pixels before them.
const COLLECT: Duration = Duration::from_millis(20);
/// The approximate number of bytes that are passed to the system at once.
const CHUNK_BYTES: usize = 256 << 10;
/// The number of buffers that are kept for further chunks.
const SPARE: usize = 8;
/// The time that a viewer has to close its side.
const FAREWELL: Duration = Duration::from_millis(500);
/// The largest number of requests for one image that are kept until they are fetched.
const REQUESTS: usize = 64;
/// The largest number of edits of one image that are kept until they are fetched.
const EDITS: usize = 1024;

/// Packets that follow each other, as bytes.
#[derive(Default)]
struct Chunk {
    bytes: Vec<u8>,
    /// The ranges in `bytes` of the packets that are sent only to viewers that answered the greeting.
    ours: Vec<Range<usize>>,
}

#[derive(Default)]
struct State {
    /// The bytes to be sent.
    queue: VecDeque<Chunk>,
    bytes: usize,
    /// The buffers of sent chunks, which are kept for the next ones.
    spare: Vec<Vec<u8>>,
    /// True when a packet was taken from the queue and is not sent yet.
    busy: bool,
    connected: bool,
    /// True when the viewer supports the extension.
    two_way: bool,
    /// True when the queue has a packet that is sent at once, with all packets before it.
    urgent: bool,
    /// True while a caller waits until all is sent.
    hurried: bool,
    /// True when nothing more will be queued.
    ending: bool,
    /// The reason why nothing more is sent.
    broken: Option<String>,
    /// True when the viewer closed its side.
    silent: bool,
    names: BTreeSet<String>,
    requests: BTreeMap<String, Vec<Request>>,
    edits: BTreeMap<String, Vec<String>>,
}

struct Shared {
    address: (String, u16),
    patience: Patience,
    state: Mutex<State>,
    changed: Condvar,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock()
    }

    fn wait(&self, state: &mut MutexGuard<'_, State>, longest: Duration) {
        self.changed.wait_for(state, longest);
    }

    /// Ends sending for this reason, unless it ended before. Discards the queue.
    fn give_up(&self, what: impl Into<String>) {
        let mut state = self.state();
        if state.broken.is_none() {
            state.broken = Some(what.into());
        }
        state.queue.clear();
        state.bytes = 0;
        self.changed.notify_all();
    }
}

/// A connection to a viewer. Dropping it waits until the viewer has read all data, as long as it keeps reading.
pub(crate) struct Link {
    shared: Arc<Shared>,
    sender: Option<JoinHandle<()>>,
}

impl Link {
    /// Begins to connect.
    ///
    /// # Errors
    /// Returns an error when the system cannot create a thread.
    pub(crate) fn new(address: (String, u16), patience: Patience) -> Result<Self> {
        let what = format!("{}:{}", address.0, address.1);
        let shared = Arc::new(Shared { address, patience, state: Mutex::default(), changed: Condvar::new() });
        let own = shared.clone();
        let sender = std::thread::Builder::new()
            .name("display".to_owned())
            .spawn(move || {
                if let Err(what) = send(&own) {
                    own.give_up(what);
                }
            })
            .map_err(|source| DisplayError::Io { what, source })?;
        Ok(Self { shared, sender: Some(sender) })
    }

    /// Returns a name that no other image of this connection has, and true when it is the first one.
    pub(crate) fn name(&self, wanted: &str) -> (String, bool) {
        let mut state = self.shared.state();
        let mut name = wanted.to_owned();
        let mut number = 2;
        while !state.names.insert(name.clone()) {
            name = format!("{wanted} ({number})");
            number += 1;
        }
        let first = state.names.len() == 1;
        (name, first)
    }

    /// Queues a packet. A packet of the extension is left out when the viewer turns out not to support it.
    ///
    /// # Errors
    /// Returns the reason why nothing more is sent.
    pub(crate) fn push(&self, packet: &Packet) -> std::result::Result<(), String> {
        let bytes = match packet {
            Packet::UpdateImage { values, .. } => values.len() * 4,
            _ => 0,
        };
        self.append(bytes, is_ours(packet), |out| packet.encode(out))?;
        if matches!(packet, Packet::Panel { .. }) {
            self.shared.state().urgent = true;
            self.shared.changed.notify_all();
        }
        Ok(())
    }

    /// Does the same for an update with borrowed data.
    ///
    /// # Errors
    /// The errors are those of [`Link::push`].
    pub(crate) fn push_update(&self, update: &Update<'_>) -> std::result::Result<(), String> {
        self.append(update.values.len() * 4, false, |out| update.encode(out))
    }

    /// Appends a packet to the queue. `bytes` is its approximate size.
    fn append(
        &self,
        bytes: usize,
        ours: bool,
        encode: impl FnOnce(&mut Vec<u8>) -> Result<()>,
    ) -> std::result::Result<(), String> {
        let mut state = self.shared.state();
        if let Some(what) = &state.broken {
            return Err(what.clone());
        }
        if state.bytes + bytes > self.shared.patience.queue_bytes {
            let behind = state.bytes >> 20;
            drop(state);
            let what = format!("the viewer is {behind} MiB behind and receives nothing more");
            self.shared.give_up(what.clone());
            return Err(what);
        }
        let first = state.queue.is_empty();
        if state.queue.back().is_none_or(|chunk| chunk.bytes.len() + bytes > CHUNK_BYTES) {
            let bytes = state.spare.pop().unwrap_or_default();
            state.queue.push_back(Chunk { bytes, ours: Vec::new() });
        }
        let chunk = state.queue.back_mut().expect("invariant: there is one, or one was added");
        let from = chunk.bytes.len();
        let done = encode(&mut chunk.bytes);
        let to = chunk.bytes.len();
        if ours {
            chunk.ours.push(from..to);
        }
        state.bytes += to - from;
        if first {
            self.shared.changed.notify_all();
        }
        drop(state);
        done.map_err(|error| {
            let what = error.to_string();
            self.shared.give_up(what.clone());
            what
        })
    }

    /// Returns the requests for an image since the last call.
    pub(crate) fn requests(&self, name: &str) -> Vec<Request> {
        self.shared.state().requests.get_mut(name).map(std::mem::take).unwrap_or_default()
    }

    /// Returns the edits of the panel of an image since the last call.
    pub(crate) fn edits(&self, name: &str) -> Vec<String> {
        self.shared.state().edits.get_mut(name).map(std::mem::take).unwrap_or_default()
    }

    /// Waits until everything is sent, as long as the viewer keeps reading.
    ///
    /// # Errors
    /// Returns the reason why not everything is sent.
    pub(crate) fn flush(&self) -> std::result::Result<(), String> {
        let begin = Instant::now();
        let Patience { connect, stall, .. } = self.shared.patience;
        let mut state = self.shared.state();
        state.hurried = true;
        self.shared.changed.notify_all();
        loop {
            if let Some(what) = &state.broken {
                return Err(what.clone());
            }
            if state.queue.is_empty() && !state.busy {
                state.hurried = false;
                return Ok(());
            }
            // Resolving a name may take any time, and cannot be interrupted.
            if !state.connected && begin.elapsed() > connect + stall {
                drop(state);
                let what = "no connection to the viewer".to_owned();
                self.shared.give_up(what.clone());
                return Err(what);
            }
            self.shared.wait(&mut state, TICK);
        }
    }

    /// Removes the name and the requests of an image that is complete.
    pub(crate) fn forget(&self, name: &str) {
        let mut state = self.shared.state();
        state.names.remove(name);
        state.requests.remove(name);
        state.edits.remove(name);
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.shared.state().ending = true;
        self.shared.changed.notify_all();
        let _ = self.flush();
        let connected = self.shared.state().connected;
        // A thread that is still resolving a name ends with the process.
        if let Some(sender) = self.sender.take()
            && (connected || sender.is_finished())
        {
            let _ = sender.join();
        }
    }
}

/// True for packets that are sent only to viewers that answered the greeting.
fn is_ours(packet: &Packet) -> bool {
    matches!(
        packet,
        Packet::Mark { .. } | Packet::Wish { .. } | Packet::Finished { .. } | Packet::Panel { .. }
    )
}

/// Connects and sends until the end.
fn send(shared: &Arc<Shared>) -> std::result::Result<(), String> {
    let mut socket = connect(shared)?;
    shared.state().connected = true;
    // Tiles are many small packets, and should be visible at once.
    let _ = socket.set_nodelay(true);
    socket.set_write_timeout(Some(TICK)).map_err(|e| e.to_string())?;
    let mut bytes = Vec::new();
    let greeting = Packet::CloseImage { name: GREETING.to_owned() };
    greeting.encode(&mut bytes).map_err(|e| e.to_string())?;
    write(shared, &mut socket, &bytes)?;
    let hearing = socket.try_clone().map_err(|e| e.to_string())?;
    let own = shared.clone();
    let hearer = std::thread::Builder::new()
        .name("display replies".to_owned())
        .spawn(move || hear(&own, hearing))
        .map_err(|e| e.to_string())?;
    let result = send_packets(shared, &mut socket);
    if let Err(what) = &result {
        // The reason is stored before the other thread finds its own.
        shared.give_up(what.clone());
    } else {
        // When data of the viewer has not been read, closing would discard data that the viewer has not read.
        let _ = socket.shutdown(Shutdown::Write);
        let end = Instant::now() + FAREWELL;
        let mut state = shared.state();
        while state.two_way && !state.silent && Instant::now() < end {
            shared.wait(&mut state, TICK);
        }
    }
    let _ = socket.shutdown(Shutdown::Both);
    let _ = hearer.join();
    result
}

fn connect(shared: &Shared) -> std::result::Result<TcpStream, String> {
    let (host, port) = &shared.address;
    let end = Instant::now() + shared.patience.connect;
    let addresses = (&**host, *port).to_socket_addrs().map_err(|e| e.to_string())?;
    let mut last = "the name has no address".to_owned();
    for address in addresses {
        let left = end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            break;
        }
        match TcpStream::connect_timeout(&address, left) {
            Ok(socket) => return Ok(socket),
            Err(error) => last = error.to_string(),
        }
    }
    Err(format!("no connection to the viewer: {last}"))
}

fn send_packets(shared: &Shared, socket: &mut TcpStream) -> std::result::Result<(), String> {
    let end = Instant::now() + shared.patience.answer;
    let mut state = shared.state();
    while !state.two_way && Instant::now() < end && state.broken.is_none() {
        shared.wait(&mut state, end.saturating_duration_since(Instant::now()));
    }
    drop(state);
    loop {
        let mut state = shared.state();
        state.busy = false;
        let chunks = loop {
            if let Some(what) = &state.broken {
                return Err(what.clone());
            }
            if !state.queue.is_empty() {
                if !state.ending && !state.hurried && !state.urgent {
                    shared.wait(&mut state, COLLECT);
                }
                state.urgent = false;
                break std::mem::take(&mut state.queue);
            }
            shared.changed.notify_all();
            if state.ending {
                return Ok(());
            }
            shared.wait(&mut state, Duration::from_secs(3600));
        };
        state.busy = true;
        let two_way = state.two_way;
        drop(state);
        for mut chunk in chunks {
            let mut at = 0;
            for ours in chunk.ours.drain(..).filter(|_| !two_way) {
                write(shared, socket, &chunk.bytes[at..ours.start])?;
                at = ours.end;
            }
            write(shared, socket, &chunk.bytes[at..])?;
            // After an error the number of waiting bytes is 0 already.
            let mut state = shared.state();
            state.bytes = state.bytes.saturating_sub(chunk.bytes.len());
            if state.spare.len() < SPARE && chunk.bytes.capacity() <= 2 * CHUNK_BYTES {
                chunk.bytes.clear();
                state.spare.push(chunk.bytes);
            }
        }
    }
}

fn write(shared: &Shared, socket: &mut TcpStream, bytes: &[u8]) -> std::result::Result<(), String> {
    let mut rest = bytes;
    let mut last = Instant::now();
    while !rest.is_empty() {
        match socket.write(rest) {
            Ok(0) => return Err("the viewer is gone".to_owned()),
            Ok(n) => {
                rest = &rest[n..];
                last = Instant::now();
            }
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) =>
            {
                if let Some(what) = &shared.state().broken {
                    return Err(what.clone());
                }
                if last.elapsed() >= shared.patience.stall {
                    let seconds = shared.patience.stall.as_secs_f32();
                    return Err(format!(
                        "the viewer accepted nothing for {seconds} s and receives nothing more"
                    ));
                }
            }
            Err(error) => return Err(format!("the viewer is gone ({error})")),
        }
    }
    Ok(())
}

/// Receives packets of the viewer until it closes its side.
fn hear(shared: &Shared, mut socket: TcpStream) {
    let limits = PacketLimits { packet_bytes: 1 << 16, ..PacketLimits::default() };
    let mut answer = || -> Option<Packet> {
        let mut length = [0; 4];
        socket.read_exact(&mut length).ok()?;
        let mut bytes = length.to_vec();
        let rest = rest_of(length, &limits).ok()?;
        bytes.resize(4 + rest, 0);
        socket.read_exact(&mut bytes[4..]).ok()?;
        // A packet that cannot be decoded does not end the connection.
        Some(Packet::decode(&bytes, &limits).unwrap_or(Packet::Hello { version: 0 }))
    };
    while let Some(packet) = answer() {
        let mut state = shared.state();
        let (name, request) = match packet {
            Packet::Hello { version } => {
                state.two_way |= version >= VERSION;
                shared.changed.notify_all();
                continue;
            }
            Packet::Edit { name, text } => {
                if state.two_way && state.names.contains(&name) {
                    let waiting = state.edits.entry(name).or_default();
                    // A sender that does not fetch its edits must not take memory without limit.
                    if waiting.len() < EDITS {
                        waiting.push(text);
                    }
                }
                continue;
            }
            Packet::Request { name, request } => (name, request),
            _ => continue,
        };
        if state.two_way && state.names.contains(&name) {
            let waiting = state.requests.entry(name).or_default();
            if waiting.len() == REQUESTS {
                waiting.remove(0);
            }
            waiting.push(request);
        }
    }
    // Data from a peer that is not a viewer is read and discarded.
    let mut unread = [0; 4096];
    while matches!(socket.read(&mut unread), Ok(n) if n > 0) {}
    let mut state = shared.state();
    state.silent = true;
    let ended = state.ending && state.queue.is_empty() && !state.busy;
    drop(state);
    shared.changed.notify_all();
    if !ended {
        shared.give_up("the viewer is gone");
    }
}
