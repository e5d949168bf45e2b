//! Tests clients and servers over real sockets of this machine.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use granita_base::Param;
use granita_display::packet::{Channel, EDIT_BYTES, GREETING, VERSION};
use granita_display::{
    Client, Ending, IvFormat, Listener, Packet, PacketLimits, Patience, ServerLimits, Sink, listen_address,
    server_address,
};
use granita_image::{
    CreateOptions, Format, ImageError, ImageOutput, ImageSpec, PixelRect, PixelType, Pixels, Request,
};
use parking_lot::Mutex;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

/// The calls that a sink received.
#[derive(Debug, PartialEq)]
enum Told {
    Packet(Packet),
    Trouble(String),
    Gone(Ending),
}

/// Passes all calls on.
struct Passed {
    to: Mutex<Sender<Told>>,
    clients: Mutex<Vec<Arc<Client>>>,
}

impl Passed {
    fn tell(&self, told: Told) {
        let _ = self.to.lock().send(told);
    }
}

impl Sink for Passed {
    fn packet(&self, client: &Arc<Client>, packet: Packet) -> Result<(), String> {
        let mut clients = self.clients.lock();
        if !clients.iter().any(|c| c.id() == client.id()) {
            clients.push(client.clone());
        }
        drop(clients);
        if let Packet::ReloadImage { .. } = packet {
            return Err("not here".to_owned());
        }
        self.tell(Told::Packet(packet));
        Ok(())
    }

    fn trouble(&self, _: &Client, what: &str) {
        self.tell(Told::Trouble(what.to_owned()));
    }

    fn gone(&self, _: &Client, ending: &Ending) {
        self.tell(Told::Gone(ending.clone()));
    }
}

fn listen(limits: ServerLimits) -> (Listener, Receiver<Told>, Arc<Passed>) {
    let (to, from) = channel();
    let sink = Arc::new(Passed { to: Mutex::new(to), clients: Mutex::default() });
    let listener = Listener::bind(([127, 0, 0, 1], 0).into(), limits, sink.clone()).unwrap();
    (listener, from, sink)
}

fn next(from: &Receiver<Told>) -> Told {
    from.recv_timeout(Duration::from_secs(30)).expect("somebody says something")
}

/// Creates an image that is sent to a server.
fn create(format: &IvFormat, name: &str, to: SocketAddr, sides: [u32; 2]) -> Box<dyn ImageOutput> {
    try_create(format, name, to, sides).unwrap()
}

fn try_create(
    format: &IvFormat,
    name: &str,
    to: SocketAddr,
    sides: [u32; 2],
) -> Result<Box<dyn ImageOutput>, ImageError> {
    let mut spec = ImageSpec::new(sides[0], sides[1], 4, PixelType::Float);
    spec.attributes.set(Param::declared("string display", to.to_string().as_str()).unwrap());
    spec.attributes.set(Param::declared("int zoom", 2).unwrap());
    format.create(Path::new(name), &CreateOptions::new(&spec, 1))
}

fn quick() -> Patience {
    Patience { stall: Duration::from_millis(400), ..Patience::default() }
}

#[test]
fn the_server_receives_what_the_client_sends() {
    let (listener, from, sink) = listen(ServerLimits::default());
    let format = IvFormat::default();
    let mut image = create(&format, "a", listener.address(), [8, 4]);
    let rect = PixelRect::at(2, 1, 2, 2);
    image.begin_rectangle(&rect);
    let values: Vec<f32> = (0..16).map(|v| v as f32 / 3.0).collect();
    image.write_rectangle(&rect, &Pixels::Float(values.clone())).unwrap();
    assert_eq!(next(&from), Told::Packet(Packet::Hello { version: VERSION }));
    assert!(
        matches!(next(&from), Told::Packet(Packet::CreateImage { name, focus: true, width: 8, .. }) if name == "a")
    );
    assert!(matches!(next(&from), Told::Packet(Packet::Wish { wishes, .. }) if wishes.zoom == 2));
    assert_eq!(next(&from), Told::Packet(Packet::Mark { name: "a".to_owned(), rect }));
    match next(&from) {
        Told::Packet(Packet::UpdateImage { channels, rect, values: got, .. }) => {
            let names: Vec<&str> = channels.iter().map(|c| &*c.name).collect();
            assert_eq!((names, rect, got), (vec!["R", "G", "B", "A"], rect, values));
        }
        other => panic!("{other:?}"),
    }
    // A second image shares the connection, and gets its own name.
    let second = create(&format, "a", listener.address(), [1, 1]);
    assert!(
        matches!(next(&from), Told::Packet(Packet::CreateImage { name, focus: false, .. }) if name == "a (2)")
    );
    assert_eq!(listener.clients(), 1);
    drop(second);
    assert!(matches!(next(&from), Told::Packet(Packet::Wish { .. })));
    assert_eq!(next(&from), Told::Packet(Packet::Finished { name: "a (2)".to_owned(), complete: false }));
    // Requests reach their image.
    let client = sink.clients.lock()[0].clone();
    let name = || "a".to_owned();
    assert!(
        client.send(Packet::Request { name: "nosuch".to_owned(), request: Request::Center { x: 1, y: 1 } })
    );
    assert!(client.send(Packet::Request { name: name(), request: Request::Center { x: -5, y: 3 } }));
    assert!(
        client.send(Packet::Request { name: name(), request: Request::Priority(PixelRect::at(1, 2, 3, 4)) })
    );
    assert!(client.send(Packet::Request { name: name(), request: Request::Abort }));
    let mut requests = Vec::new();
    let begin = Instant::now();
    while requests.len() < 3 && begin.elapsed() < Duration::from_secs(20) {
        requests.extend(image.requests());
    }
    let rectangle = Request::Priority(PixelRect::at(1, 2, 3, 4));
    assert_eq!(requests, [Request::Center { x: -5, y: 3 }, rectangle, Request::Abort]);
    image.close().unwrap();
    assert_eq!(next(&from), Told::Packet(Packet::Finished { name: name(), complete: true }));
    assert_eq!(next(&from), Told::Gone(Ending::Closed));
}

#[test]
fn rows_and_tiles_are_sent_as_rectangles() {
    let (listener, from, _) = listen(ServerLimits::default());
    let format = IvFormat::default();
    let mut spec = ImageSpec::new(5, 3, 1, PixelType::U8);
    spec.attributes.set(Param::declared("string display", listener.address().to_string().as_str()).unwrap());
    let options = CreateOptions::new(&spec, 1);
    let mut image = format.create(Path::new("rows"), &options).unwrap();
    image.write_rows(&Pixels::U8(vec![255; 10])).unwrap();
    image.write_rows(&Pixels::U8(vec![0; 5])).unwrap();
    assert!(image.write_rows(&Pixels::U8(vec![0; 5])).is_err(), "there are no more rows");
    image.close().unwrap();
    (spec.tile_width, spec.tile_height) = (4, 2);
    let mut image = format.create(Path::new("tiles"), &CreateOptions::new(&spec, 1)).unwrap();
    image.write_tile(1, 1, &Pixels::U8(vec![51; 8])).unwrap();
    assert!(image.write_tile(2, 0, &Pixels::U8(vec![0; 8])).is_err());
    image.close().unwrap();
    let mut updates = Vec::new();
    while updates.len() < 3 {
        if let Told::Packet(Packet::UpdateImage { rect, channels, values, .. }) = next(&from) {
            updates.push((rect, channels[0].stride, values));
        }
    }
    // A rectangle of equal pixels is sent as one pixel.
    assert_eq!(updates[0], (PixelRect::at(0, 0, 5, 2), 0, vec![1.0]));
    assert_eq!(updates[1], (PixelRect::at(0, 2, 5, 1), 0, vec![0.0]));
    assert_eq!(updates[2], (PixelRect::at(4, 2, 1, 1), 0, vec![0.2]));
}

/// The server never answers, like other viewers. Only packets of types up to 8 may reach it.
#[test]
fn a_viewer_that_does_not_answer_receives_only_standard_packets() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = server.local_addr().unwrap();
    let hearing = std::thread::spawn(move || {
        let mut all = Vec::new();
        server.accept().unwrap().0.read_to_end(&mut all).unwrap();
        all
    });
    let format = IvFormat::default();
    let mut image = create(&format, "pic", address, [1100, 500]);
    let rect = PixelRect::at(0, 0, 1100, 500);
    image.begin_rectangle(&rect);
    let values: Vec<f32> = (0..1100 * 500 * 4).map(|v| v as f32).collect();
    image.write_rectangle(&rect, &Pixels::Float(values.clone())).unwrap();
    assert!(image.requests().is_empty());
    image.close().unwrap();
    drop(format);
    let all = hearing.join().unwrap();
    let (mut rest, mut got) = (&all[..], Vec::new());
    let mut kinds = Vec::new();
    while let Some(length) = rest.first_chunk::<4>() {
        let (packet, after) = rest.split_at(u32::from_le_bytes(*length) as usize);
        kinds.push(packet[4]);
        match Packet::decode(packet, &PacketLimits::default()).unwrap() {
            Packet::CloseImage { name } => assert_eq!(name, GREETING),
            Packet::UpdateImage { values, .. } => got.extend(values),
            Packet::CreateImage { width: 1100, height: 500, .. } => (),
            other => panic!("{other:?}"),
        }
        rest = after;
    }
    assert_eq!(kinds, [2, 4, 6, 6, 6], "large areas come in parts");
    assert!(got == values);
}

#[test]
fn a_viewer_that_reads_nothing_does_not_block_the_writer() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let format = IvFormat::new(quick());
    let mut image = create(&format, "pic", server.local_addr().unwrap(), [512, 512]);
    let _socket = server.accept().unwrap();
    let rect = PixelRect::at(0, 0, 512, 512);
    let pixels = Pixels::Float((0..512 * 512 * 4).map(|v| v as f32).collect());
    let mut slowest = Duration::ZERO;
    let begin = Instant::now();
    let refused = loop {
        let now = Instant::now();
        let result = image.write_rectangle(&rect, &pixels);
        slowest = slowest.max(now.elapsed());
        if let Err(error) = result {
            break error.to_string();
        }
        assert!(begin.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(20));
    };
    assert!(refused.contains("the viewer"), "{refused}");
    assert!(slowest < Duration::from_millis(300), "one write took {slowest:?}");
    assert!(image.close().is_err());
}

#[test]
fn the_queue_of_unsent_pixels_is_bounded() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let format = IvFormat::new(Patience { queue_bytes: 1 << 20, ..quick() });
    let mut image = create(&format, "pic", server.local_addr().unwrap(), [512, 512]);
    let rect = PixelRect::at(0, 0, 512, 128);
    let pixels = Pixels::Float((0..512 * 128 * 4).map(|v| v as f32).collect());
    let results: Vec<_> = (0..40).map(|_| image.write_rectangle(&rect, &pixels)).collect();
    assert!(results[39].as_ref().unwrap_err().to_string().contains("the viewer"));
}

#[test]
fn a_missing_viewer_is_reported_without_delay() {
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let format = IvFormat::default();
    let begin = Instant::now();
    // The connection may exist before the image does.
    let ended = try_create(&format, "pic", free, [4, 4]).and_then(|image| image.close());
    let error = ended.unwrap_err().to_string();
    assert!(error.contains("no connection to the viewer"), "{error}");
    assert!(begin.elapsed() < Duration::from_secs(5));
    let mut spec = ImageSpec::new(1, 1, 1, PixelType::Float);
    spec.attributes.set(Param::declared("string display", "some where:99").unwrap());
    assert!(format.create(Path::new("a"), &CreateOptions::new(&spec, 1)).is_err());
}

#[test]
fn invalid_replies_are_ignored_and_a_closed_connection_is_an_error() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let format = IvFormat::default();
    let mut image = create(&format, "pic", server.local_addr().unwrap(), [4, 4]);
    let (mut socket, _) = server.accept().unwrap();
    socket.write_all(b"HTTP/1.1 400 Bad Request\r\n\r\n").unwrap();
    socket.write_all(&[0; 100_000]).unwrap();
    std::thread::sleep(Duration::from_millis(400));
    let rect = PixelRect::at(0, 0, 4, 4);
    let pixels = Pixels::Float(vec![0.5; 64]);
    image.write_rectangle(&rect, &pixels).unwrap();
    assert!(image.requests().is_empty());
    drop(socket);
    let begin = Instant::now();
    while image.write_rectangle(&rect, &pixels).is_ok() {
        assert!(begin.elapsed() < Duration::from_secs(20));
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A client that sends the bytes of the protocol directly.
struct Raw(TcpStream);

impl Raw {
    fn new(to: SocketAddr) -> Self {
        let socket = TcpStream::connect(to).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        Self(socket)
    }

    fn send(&mut self, kind: u8, content: &[u8]) {
        let length = u32::try_from(content.len() + 5).unwrap();
        // A failure here is visible at the other side.
        let _ = self.0.write_all(&[&length.to_le_bytes()[..], &[kind], content].concat());
    }

    /// True when the server closed the connection.
    fn is_sent_away(&mut self) -> bool {
        !matches!(self.0.read(&mut [0; 1]), Ok(n) if n > 0)
    }
}

#[test]
fn clients_that_send_malformed_packets_are_disconnected() {
    let limits = ServerLimits {
        silence: Duration::from_millis(300),
        mistakes: 5,
        clients: 3,
        ..ServerLimits::default()
    };
    let (listener, from, _) = listen(limits);
    let to = listener.address();
    let gone = |text: &str| match next(&from) {
        Told::Gone(Ending::Broken(what)) => assert!(what.contains(text), "{what}"),
        other => panic!("{other:?}"),
    };
    // The client is a browser.
    let mut client = Raw::new(to);
    client.0.write_all(b"POST / HTTP/1.1\r\n\r\n").unwrap();
    assert!(client.is_sent_away());
    gone("bytes of a packet 1414745936 exceeds the limit");
    // The length is missing.
    let mut client = Raw::new(to);
    client.0.write_all(&[0; 4]).unwrap();
    assert!(client.is_sent_away());
    gone("its length is 0");
    // One client sends half a packet and then nothing. Another sends half a packet and ends.
    let mut client = Raw::new(to);
    client.0.write_all(&[99, 0, 0, 0, 2]).unwrap();
    assert!(client.is_sent_away());
    gone("stopped in the middle");
    let mut client = Raw::new(to);
    client.0.write_all(&[99, 0, 0, 0, 2]).unwrap();
    drop(client);
    gone("ended in the middle");
    // Errors are reported once, and tolerated up to a number. Packets of the extension need a hello.
    let mut client = Raw::new(to);
    client.send(77, &[]);
    client.send(77, &[]);
    client.send(1, b"\0a\0");
    client.send(101, b"a\0\0\0\0\0\0\0\0\0\x01\0\0\0\x01\0\0\0");
    client.send(2, b"b\0");
    client.send(112, b"a\0");
    assert_eq!(next(&from), Told::Trouble("unknown packet of type 77".to_owned()));
    assert_eq!(next(&from), Told::Trouble("not here".to_owned()));
    assert_eq!(next(&from), Told::Trouble("a packet of the extension before a greeting".to_owned()));
    assert_eq!(next(&from), Told::Packet(Packet::CloseImage { name: "b".to_owned() }));
    assert_eq!(next(&from), Told::Trouble("a packet that clients do not send".to_owned()));
    assert!(client.is_sent_away());
    gone("5 packets were refused");
    // There are too many clients at once.
    let some: Vec<Raw> = (0..3)
        .map(|_| {
            let mut client = Raw::new(to);
            client.send(2, b"d\0");
            assert_eq!(next(&from), Told::Packet(Packet::CloseImage { name: "d".to_owned() }));
            client
        })
        .collect();
    assert!(Raw::new(to).is_sent_away());
    assert_eq!(next(&from), Told::Trouble("more than 3 connections".to_owned()));
    // The message is printed at intervals, for any number of errors.
    assert!((0..20).all(|_| Raw::new(to).is_sent_away()));
    assert_eq!(from.recv_timeout(Duration::from_millis(50)).ok(), None);
    drop(some);
    for _ in 0..3 {
        assert_eq!(next(&from), Told::Gone(Ending::Closed));
    }
    // A client may wait between packets for longer than in the middle of one. It ends with the listener.
    let mut client = Raw::new(to);
    std::thread::sleep(Duration::from_millis(700));
    client.send(2, b"c\0");
    assert_eq!(next(&from), Told::Packet(Packet::CloseImage { name: "c".to_owned() }));
    drop(listener);
    assert!(client.is_sent_away());
    std::thread::sleep(Duration::from_millis(100));
    assert!(TcpStream::connect(to).is_err(), "nobody listens any more");
}

/// There are more clients than places. They send nothing, or a byte at intervals.
#[test]
fn silent_clients_do_not_block_active_ones() {
    let limits = ServerLimits {
        clients: 8,
        clients_of_address: 6,
        first_packet: Duration::from_millis(500),
        silence: Duration::from_millis(300),
        ..ServerLimits::default()
    };
    let (listener, from, _) = listen(limits);
    let to = listener.address();
    let mut silent: Vec<Raw> = (0..64).map(|_| Raw::new(to)).collect();
    // An active client connects at once, works, and stays connected during any silence between packets.
    let mut working = Raw::new(to);
    working.send(2, b"a\0");
    let told = loop {
        match next(&from) {
            Told::Gone(Ending::Closed) => (),
            other => break other,
        }
    };
    assert_eq!(told, Told::Packet(Packet::CloseImage { name: "a".to_owned() }));
    assert!(listener.clients() <= 6);
    // The remaining silent clients are disconnected for their silence.
    assert!(silent.iter_mut().all(Raw::is_sent_away));
    let gone = || loop {
        match next(&from) {
            Told::Gone(Ending::Broken(what)) => break what,
            Told::Gone(Ending::Closed) => (),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!([(); 5].map(|()| gone()), ["it sent nothing"; 5]);
    // Single bytes at intervals do not count as progress.
    let mut dripping = Raw::new(to);
    dripping.0.write_all(&[99, 0, 0, 0, 2]).unwrap();
    let begin = Instant::now();
    while dripping.0.write_all(b"x").is_ok() {
        assert!(begin.elapsed() < Duration::from_secs(20));
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(gone(), "its packet came too slowly");
    working.send(2, b"b\0");
    assert_eq!(next(&from), Told::Packet(Packet::CloseImage { name: "b".to_owned() }));
    drop(listener);
}

/// The client sends random bytes in pieces of every size.
#[test]
fn the_server_survives_random_bytes() {
    let (listener, from, _) = listen(ServerLimits { mistakes: 50, ..ServerLimits::default() });
    let mut seed = 1_u64;
    let mut random = move |below: usize| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as usize % below.max(1)
    };
    let update = Packet::UpdateImage {
        name: "a".to_owned(),
        focus: true,
        channels: vec![Channel { name: "R".to_owned(), offset: 0, stride: 1 }],
        rect: PixelRect::at(0, 0, 4, 4),
        values: vec![1.0; 16],
    };
    for round in 0..60 {
        let mut bytes = Vec::new();
        for _ in 0..4 {
            update.encode(&mut bytes).unwrap();
        }
        for _ in 0..random(12) {
            let at = random(bytes.len());
            bytes[at] = random(256) as u8;
        }
        bytes.truncate(random(bytes.len() + 1));
        let mut client = Raw::new(listener.address());
        for part in bytes.chunks(1 + random(90)) {
            if client.0.write_all(part).is_err() {
                break;
            }
        }
        drop(client);
        while !matches!(next(&from), Told::Gone(_)) {}
        assert_eq!(listener.clients(), 0, "round {round}");
    }
}

#[test]
fn listen_addresses_are_parsed_or_refused() {
    let listen = |text| listen_address(text).map(|a| a.to_string()).map_err(|e| e.to_string());
    assert_eq!(listen("14158").unwrap(), "127.0.0.1:14158");
    assert_eq!(listen(":1").unwrap(), "127.0.0.1:1");
    assert_eq!(listen("localhost:1").unwrap(), "127.0.0.1:1");
    assert_eq!(listen("0.0.0.0:1").unwrap(), "0.0.0.0:1");
    assert_eq!(listen("*:1").unwrap(), "0.0.0.0:1");
    assert_eq!(listen("[::1]:1").unwrap(), "[::1]:1");
    for wrong in ["", "x", "1:", "70000", "127.0.0.1"] {
        assert_eq!(listen(wrong).unwrap_err(), format!("\"{wrong}\" is not [ADDRESS:]PORT"));
    }
    let server = |text| server_address(text).map_err(|e| e.to_string());
    assert_eq!(server("box").unwrap(), ("box".to_owned(), 14158));
    assert_eq!(server("box:5").unwrap(), ("box".to_owned(), 5));
    assert_eq!(server(":5").unwrap(), ("localhost".to_owned(), 5));
    assert_eq!(server("::1").unwrap(), ("::1".to_owned(), 14158));
    assert_eq!(server("[::1]").unwrap(), ("::1".to_owned(), 14158));
    assert_eq!(server("[::1]:5").unwrap(), ("::1".to_owned(), 5));
    for wrong in ["a b", "http://box", "box:", "box:x", "box:99999", ":0"] {
        assert!(server(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn panels_go_to_the_viewer_and_edits_come_back() {
    let (listener, from, sink) = listen(ServerLimits::default());
    let format = IvFormat::default();
    let mut image = create(&format, "a", listener.address(), [8, 4]);
    let long = format!("\"{}\"", "x".repeat(1 << 20));
    for text in ["{\"on\":true}", &long, ""] {
        image.show_panel("light/key", text).unwrap();
    }
    let mut got = Vec::new();
    while got.len() < 3 {
        if let Told::Packet(Packet::Panel { name, part, text }) = next(&from) {
            assert_eq!((&*name, &*part), ("a", "light/key"));
            got.push(text);
        }
    }
    assert_eq!(got, ["{\"on\":true}", &long, ""]);
    let client = sink.clients.lock()[0].clone();
    let edit = |name: &str, text: &str| Packet::Edit { name: name.to_owned(), text: text.to_owned() };
    assert!(client.send(edit("other", "{}")));
    // An edit that is too large is not sent.
    client.send(edit("a", &"x".repeat(EDIT_BYTES + 1)));
    for k in 0..20 {
        assert!(client.send(edit("a", &format!("{{\"do\":{k}}}"))));
    }
    let mut edits = Vec::new();
    let begin = Instant::now();
    while edits.len() < 20 && begin.elapsed() < Duration::from_secs(20) {
        edits.extend(image.edits());
    }
    let expected: Vec<String> = (0..20).map(|k| format!("{{\"do\":{k}}}")).collect();
    assert_eq!(edits, expected);
    image.close().unwrap();
}

#[test]
fn panels_need_a_greeting_and_clients_send_no_edits() {
    let limits = PacketLimits { panel_bytes: 100, ..PacketLimits::default() };
    let (listener, from, _sink) = listen(ServerLimits { packet: limits, ..ServerLimits::default() });
    let mut socket = TcpStream::connect(listener.address()).unwrap();
    let mut send = |packet: &Packet| {
        let mut bytes = Vec::new();
        packet.encode(&mut bytes).unwrap();
        socket.write_all(&bytes).unwrap();
    };
    let panel =
        |text: &str| Packet::Panel { name: "a".to_owned(), part: "p".to_owned(), text: text.to_owned() };
    send(&panel("{}"));
    assert_eq!(next(&from), Told::Trouble("a packet of the extension before a greeting".to_owned()));
    send(&Packet::Edit { name: "a".to_owned(), text: "{}".to_owned() });
    assert_eq!(next(&from), Told::Trouble("a packet that clients do not send".to_owned()));
    send(&Packet::CloseImage { name: GREETING.to_owned() });
    assert_eq!(next(&from), Told::Packet(Packet::Hello { version: VERSION }));
    send(&panel(&"x".repeat(100)));
    assert_eq!(next(&from), Told::Packet(panel(&"x".repeat(100))));
    send(&panel(&"x".repeat(101)));
    assert!(matches!(next(&from), Told::Trouble(what) if what.contains("exceeds the limit of 100")));
}
