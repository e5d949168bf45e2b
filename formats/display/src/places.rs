//! The number of connections that a server holds, and the choice of the connection that is closed for a new one.
//!
//! Connections that have not yet sent a whole packet must never block others. When all places are taken, or those of
//! one address, the oldest such connection is closed in favour of the new one. Connections that have sent a packet keep
//! their places, and the new one is refused.

use parking_lot::{Mutex, MutexGuard};
use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, Shutdown, SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The connections of one server.
#[derive(Debug)]
pub struct Places {
    total: usize,
    per_address: usize,
    ending: AtomicBool,
    /// The connections by an increasing id. The first is the oldest.
    taken: Mutex<BTreeMap<u64, Taken>>,
}

#[derive(Debug)]
struct Taken {
    origin: IpAddr,
    socket: TcpStream,
    /// True when it has sent a whole packet.
    heard: bool,
}

/// The place of one connection. Dropping it frees the place.
#[derive(Debug)]
pub struct Place {
    places: Arc<Places>,
    id: u64,
}

/// The reason why a connection has no place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// All places are taken by connections that have sent a whole packet. The value is the number of places.
    Full(usize),
    /// All places for one address are taken in the same way. The value is their number.
    FullOfAddress(usize),
    /// The system cannot duplicate the socket, for example when no more files may be open.
    NoSocket,
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Full(count) => write!(f, "more than {count} connections"),
            Self::FullOfAddress(count) => write!(f, "more than {count} connections from one address"),
            Self::NoSocket => f.write_str("no more files may be open"),
        }
    }
}

impl Places {
    /// Returns places for `total` connections, of which `per_address` may come from one address. For IPv6 an address is
    /// a network of 64 bits, because one machine can choose any address of it.
    pub fn new(total: usize, per_address: usize) -> Arc<Self> {
        let (ending, taken) = (AtomicBool::new(false), Mutex::default());
        Arc::new(Self { total, per_address, ending, taken })
    }

    /// Gives a place to `socket`, which comes from `address`.
    ///
    /// # Errors
    /// Returns an error when there is no place, and none could be freed.
    pub fn take(
        self: &Arc<Self>,
        id: u64,
        socket: &TcpStream,
        address: SocketAddr,
    ) -> Result<Place, Refusal> {
        let socket = socket.try_clone().map_err(|_| Refusal::NoSocket)?;
        let origin = origin(address.ip());
        let mut taken = self.taken();
        if taken.values().filter(|t| t.origin == origin).count() >= self.per_address
            && !close_oldest_silent(&mut taken, |t| t.origin == origin)
        {
            return Err(Refusal::FullOfAddress(self.per_address));
        }
        if taken.len() >= self.total && !close_oldest_silent(&mut taken, |_| true) {
            return Err(Refusal::Full(self.total));
        }
        taken.insert(id, Taken { origin, socket, heard: false });
        Ok(Place { places: self.clone(), id })
    }

    /// The number of places that are taken.
    pub fn count(&self) -> usize {
        self.taken().len()
    }

    /// True after [`Places::close`].
    pub fn is_ending(&self) -> bool {
        self.ending.load(Ordering::SeqCst)
    }

    /// Ends all connections, and the thread that accepts them at `address`. That thread waits for a connection, so one
    /// is made. The thread then finds that the server [is ending](Places::is_ending).
    pub fn close(&self, address: SocketAddr) {
        self.ending.store(true, Ordering::SeqCst);
        for taken in self.taken().values() {
            let _ = taken.socket.shutdown(Shutdown::Both);
        }
        let _ = TcpStream::connect_timeout(&reachable(address), Duration::from_millis(200));
    }

    fn taken(&self) -> MutexGuard<'_, BTreeMap<u64, Taken>> {
        self.taken.lock()
    }
}

impl Place {
    /// Records that a whole packet was received. This place is no longer given to others.
    pub fn heard(&self) {
        if let Some(taken) = self.places.taken().get_mut(&self.id) {
            taken.heard = true;
        }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.places.taken().remove(&self.id);
    }
}

/// Closes the oldest connection that has not sent a whole packet, among those for which `may` is true. Returns false
/// when there is none.
fn close_oldest_silent(taken: &mut BTreeMap<u64, Taken>, may: impl Fn(&Taken) -> bool) -> bool {
    let oldest = taken.iter().find(|(_, t)| !t.heard && may(t)).map(|(id, _)| *id);
    let Some(closed) = oldest.and_then(|id| taken.remove(&id)) else { return false };
    let _ = closed.socket.shutdown(Shutdown::Both);
    true
}

/// Returns the address at which a server that listens on `address` is reached from its own machine. The wildcard
/// address is replaced by the loopback address of the same family, because only some systems connect to the wildcard
/// address.
fn reachable(mut address: SocketAddr) -> SocketAddr {
    if address.ip().is_unspecified() {
        address.set_ip(match address {
            SocketAddr::V4(_) => Ipv4Addr::LOCALHOST.into(),
            SocketAddr::V6(_) => Ipv6Addr::LOCALHOST.into(),
        });
    }
    address
}

/// Returns the part of an address that counts as one address.
fn origin(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => {
            let [a, b, c, d, ..] = v6.segments();
            Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0).into()
        }
        v4 => v4,
    }
}

/// Passes the first few messages, then one in each interval, and counts those in between.
#[derive(Debug)]
pub struct Sparingly {
    first: u32,
    pause: Duration,
    last: Option<Instant>,
    left_out: u64,
}

impl Sparingly {
    /// Passes `first` messages at once, then one in each `pause`.
    pub fn new(first: u32, pause: Duration) -> Self {
        Self { first, pause, last: None, left_out: 0 }
    }

    /// Returns the text to print at `now`; `None` when it is too early. It contains the number of messages that were
    /// left out before it.
    pub fn say(&mut self, now: Instant, text: &str) -> Option<String> {
        if self.first > 0 {
            self.first -= 1;
        } else if self.last.is_some_and(|last| now.duration_since(last) < self.pause) {
            self.left_out += 1;
            return None;
        }
        self.last = Some(now);
        Some(match std::mem::take(&mut self.left_out) {
            0 => text.to_owned(),
            count => format!("{text} ({count} messages like this were left out)"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;
    use std::net::TcpListener;

    #[test]
    fn a_server_for_all_addresses_is_reached_by_the_loopback_of_its_family() {
        let cases = [
            ("0.0.0.0:14158", "127.0.0.1:14158"),
            ("[::]:14158", "[::1]:14158"),
            ("192.0.2.7:80", "192.0.2.7:80"),
            ("[2001:db8::1]:80", "[2001:db8::1]:80"),
        ];
        for (bound, reached) in cases {
            assert_eq!(reachable(bound.parse().unwrap()), reached.parse().unwrap());
        }
    }

    /// Returns both ends of a connection.
    fn pair(listener: &TcpListener) -> (TcpStream, TcpStream) {
        let client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        client.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
        (client, listener.accept().unwrap().0)
    }

    #[test]
    fn a_silent_connection_is_closed_when_all_places_are_taken() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let places = Places::new(3, 2);
        let from = |text: &str| SocketAddr::new(text.parse().unwrap(), 9);
        let mut clients = Vec::new();
        let mut next = |address: &str| {
            let (client, server) = pair(&listener);
            clients.push(client);
            places.take(clients.len() as u64, &server, from(address))
        };
        let a = next("10.0.0.1").unwrap();
        let b = next("10.0.0.1").unwrap();
        a.heard();
        // There is a third connection of the address, so the silent one of them is closed. Then no connection of this
        // address can be closed for another.
        let c = next("::ffff:10.0.0.1").unwrap();
        c.heard();
        assert_eq!(next("10.0.0.1").unwrap_err(), Refusal::FullOfAddress(2));
        let d = next("fd00::1").unwrap();
        assert_eq!(places.count(), 3);
        // The same network of 64 bits is the same address.
        d.heard();
        assert_eq!(next("10.0.0.2").unwrap_err(), Refusal::Full(3));
        drop(c);
        let e = next("fd00::2").unwrap();
        e.heard();
        assert_eq!(next("fd00::3").unwrap_err(), Refusal::FullOfAddress(2));
        // The place of a connection that was closed before is not freed twice.
        drop(b);
        assert_eq!(places.count(), 3);
        let is_closed = |k: usize| matches!((&clients[k]).read(&mut [0; 1]), Ok(0));
        assert_eq!([0, 1].map(is_closed), [false, true]);
        drop((a, d, e));
        assert_eq!(places.count(), 0);
    }

    #[test]
    fn repeated_messages_are_limited_and_the_omitted_ones_counted() {
        let mut sparingly = Sparingly::new(2, Duration::from_secs(60));
        let begin = Instant::now();
        let mut at = |seconds| sparingly.say(begin + Duration::from_secs(seconds), "x");
        assert_eq!((at(0), at(1), at(2), at(59)), (Some("x".to_owned()), Some("x".to_owned()), None, None));
        assert_eq!(at(61).unwrap(), "x (2 messages like this were left out)");
        assert_eq!((at(120), at(121)), (None, Some("x (1 messages like this were left out)".to_owned())));
    }
}
