//! Tests with clients that are written byte by byte from the published description of the protocol.

use super::*;
use granita_display::packet::VERSION;
use granita_image::{Draw, Request};
use granita_view::LiveLimits;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

fn listening(live: &Live, open: Option<Box<OpenFile>>) -> (Listener, Arc<Mutex<Vec<String>>>) {
    let messages = Arc::new(Mutex::new(Vec::new()));
    let kept = messages.clone();
    let reporter = Reporter::new(Box::new(move |m| kept.lock().push(m.to_string())));
    (start(([127, 0, 0, 1], 0).into(), live, &reporter, open, false).unwrap(), messages)
}

/// Waits until another thread has done something.
fn until(what: &str, mut done: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !done() {
        assert!(begin.elapsed() < Duration::from_secs(20), "{what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Returns a packet. It consists of its length including these four bytes, its type and its content.
fn packet(kind: u8, content: &[&[u8]]) -> Vec<u8> {
    let content = content.concat();
    [&(content.len() as u32 + 5).to_le_bytes()[..], &[kind], &content].concat()
}

fn create(name: &str, width: i32, height: i32, channels: &[&str]) -> Vec<u8> {
    let names: Vec<u8> = channels.iter().flat_map(|c| [c.as_bytes(), b"\0"].concat()).collect();
    let count = (channels.len() as i32).to_le_bytes();
    let (width, height) = (width.to_le_bytes(), height.to_le_bytes());
    packet(4, &[b"\x01", name.as_bytes(), b"\0", &width, &height, &count, &names])
}

/// Returns a packet with a tile of interleaved channels.
fn tile(name: &str, channels: &[&str], [x, y, w, h]: [i32; 4], values: &[f32]) -> Vec<u8> {
    let n = channels.len();
    let names: Vec<u8> = channels.iter().flat_map(|c| [c.as_bytes(), b"\0"].concat()).collect();
    let place: Vec<u8> = [x, y, w, h].iter().flat_map(|v| v.to_le_bytes()).collect();
    let offsets: Vec<u8> = (0..n as i64).flat_map(i64::to_le_bytes).collect();
    let strides: Vec<u8> = (0..n).flat_map(|_| (n as i64).to_le_bytes()).collect();
    let values: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let count = (n as i32).to_le_bytes();
    packet(6, &[b"\0", name.as_bytes(), b"\0", &count, &names, &place, &offsets, &strides, &values])
}

#[test]
fn a_client_written_from_the_description_shows_its_pixels() {
    let live = Live::default();
    let (listener, messages) = listening(&live, None);
    assert_eq!(*messages.lock(), [format!("iv: listening on {}\n", listener.address())]);
    let mut client = TcpStream::connect(listener.address()).unwrap();
    // The image is sent in tiles of 128 pixels, like tev's own client for Python does. The last ones are smaller.
    let (width, height, names) = (200, 150, ["R", "G", "B", "A"]);
    let value = |x: i32, y: i32, c: i32| ((y * width + x) * 4 + c) as f32 * 0.37 - 1.0;
    client.write_all(&create("pic", width, height, &names)).unwrap();
    for y in (0..height).step_by(128) {
        for x in (0..width).step_by(128) {
            let (w, h) = (128.min(width - x), 128.min(height - y));
            let values: Vec<f32> = (y..y + h)
                .flat_map(|j| (x..x + w).flat_map(move |i| (0..4).map(move |c| value(i, j, c))))
                .collect();
            client.write_all(&tile("pic", &names, [x, y, w, h], &values)).unwrap();
        }
    }
    // When this image has arrived, all packets before it were processed.
    client.write_all(&create("end", 1, 1, &["Y"])).unwrap();
    until("both are there", || live.names() == ["pic", "end"]);
    let (info, pixels) = live.snapshot("pic").unwrap();
    assert_eq!(
        (info.width, info.height, info.channels, info.note),
        (200, 150, names.map(str::to_owned).to_vec(), None)
    );
    let expected: Vec<f32> =
        (0..height).flat_map(|y| (0..width).flat_map(move |x| (0..4).map(move |c| value(x, y, c)))).collect();
    assert!(pixels == expected);
    // The channels are sent one after the other, as by pbrt, and as planes.
    let place: Vec<u8> = [1_i32, 2, 2, 1].iter().flat_map(|v| v.to_le_bytes()).collect();
    let two: Vec<u8> = [5.0_f32, 6.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    client.write_all(&packet(3, &[b"\0pic\0G\0", &place, &two])).unwrap();
    let four: Vec<u8> = [1.0_f32, 2.0, 3.0, 4.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    client.write_all(&packet(5, &[b"\0pic\0", &2_i32.to_le_bytes(), b"A\0B\0", &place, &four])).unwrap();
    // Another connection finds the image by its name, as scripts expect.
    let mut second = TcpStream::connect(listener.address()).unwrap();
    second.write_all(&packet(2, &[b"end\0"])).unwrap();
    until("it is closed", || live.names() == ["pic"]);
    let rect = PixelRect::at(1, 2, 2, 1);
    let want = [value(1, 2, 0), 5.0, 3.0, 1.0, value(2, 2, 0), 6.0, 4.0, 2.0];
    until("the channels came", || live.read("pic", rect, &[0, 1, 2, 3]).unwrap() == want);
    // Nothing was sent to these clients, because they do not support the extension.
    client.set_nonblocking(true).unwrap();
    assert!(client.read(&mut [0; 1]).is_err_and(|e| e.kind() == std::io::ErrorKind::WouldBlock));
    // The connection is closed without an end of the image, as such programs do. The image counts as complete.
    drop(client);
    until("the client is gone", || listener.clients() == 1);
    assert_eq!(live.info("pic").unwrap().note, None);
}

#[test]
fn invalid_packets_are_refused_and_the_client_stays_connected() {
    let live = Live::new(LiveLimits { bytes: 1 << 20, ..LiveLimits::default() });
    let (listener, messages) = listening(&live, None);
    let mut client = TcpStream::connect(listener.address()).unwrap();
    for bytes in [
        create("a", 10_000, 10_000, &["R"]),
        create("a", 1, 1, &["R", "R"]),
        tile("a", &["R"], [0, 0, 1, 1], &[1.0]),
        create("a", 4, 4, &["R"]),
        tile("a", &["G"], [0, 0, 1, 1], &[1.0]),
        tile("a", &["R"], [3, 3, 2, 1], &[1.0, 1.0]),
        tile("a", &["R"], [-1, 0, 1, 1], &[1.0]),
        packet(7, &[b"\x01/etc/passwd\0\0"]),
        packet(1, &[b"\x01a\0"]),
        packet(8, &[b"\0a\0\0", &2_i32.to_le_bytes(), b"\x08\x02", &[0; 8]]),
        tile("a", &["R"], [3, 3, 1, 1], &[9.0]),
    ] {
        client.write_all(&bytes).unwrap();
    }
    until("the good one came", || live.read("a", PixelRect::at(3, 3, 1, 1), &[0]).is_ok_and(|v| v == [9.0]));
    assert_eq!(live.info("a").unwrap().drawing.to_vec(), [Draw::BeginPath, Draw::MoveTo([0.0, 0.0])]);
    let said = messages.lock()[1..].concat();
    for text in [
        "bytes of all images 400000000 exceeds the limit of 1048576",
        "two channels are called \"R\"",
        "there is no image \"a\"",
        "\"a\" has no channel \"G\"",
        "pixels x 3..5 y 3..4 of the 4 x 4 of \"a\"",
        "files are not opened for clients (see -allowopen)",
    ] {
        assert!(said.contains(text), "{text} is not in {said}");
    }
    assert_eq!(said.matches("files are not").count(), 1);
    // The image of a client that breaks off stays, with a note.
    client.write_all(&[200, 0, 0, 0, 6, 0]).unwrap();
    drop(client);
    until("there is a note", || live.info("a").unwrap().note.is_some());
    assert!(live.info("a").unwrap().note.unwrap().contains("in the middle of a packet"));
}

#[test]
fn files_are_opened_only_if_allowed() {
    let live = Live::default();
    let wanted = Arc::new(Mutex::new(Vec::new()));
    let kept = wanted.clone();
    let open = move |file: Wanted| {
        kept.lock().push(file);
        Ok(())
    };
    let (listener, _) = listening(&live, Some(Box::new(open)));
    let mut client = TcpStream::connect(listener.address()).unwrap();
    client.write_all(&packet(0, &[b"\x01a.exr:z\0"])).unwrap();
    client.write_all(&packet(1, &[b"\0a.exr\0"])).unwrap();
    until("both came", || wanted.lock().len() == 2);
    let expected = [
        Wanted::Open { path: "a.exr".to_owned(), selector: "z".to_owned(), focus: true },
        Wanted::Reload { name: "a.exr".to_owned(), focus: false },
    ];
    assert_eq!(*wanted.lock(), expected);
}

/// A client that sends packets of the extension, which are also made byte by byte.
struct Ours(TcpStream);

impl Ours {
    fn new(listener: &Listener) -> Self {
        let mut socket = TcpStream::connect(listener.address()).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        socket.write_all(&packet(2, &[b"\x01granita hello\0"])).unwrap();
        let mut hello = [0; 9];
        socket.read_exact(&mut hello).unwrap();
        assert_eq!(hello, [9, 0, 0, 0, 100, VERSION as u8, 0, 0, 0]);
        Self(socket)
    }

    fn send(&mut self, bytes: &[u8]) {
        self.0.write_all(bytes).unwrap();
    }

    fn hear(&mut self, count: usize) -> Vec<u8> {
        let mut bytes = vec![0; count];
        self.0.read_exact(&mut bytes).unwrap();
        bytes
    }
}

/// A viewer that was started for a render opens the layers that an image names, and no other files.
#[test]
fn layers_are_opened_only_if_allowed() {
    for layers in [false, true] {
        let live = Live::default();
        let (reporter, _) = Reporter::collecting();
        let listener = start(([127, 0, 0, 1], 0).into(), &live, &reporter, None, layers).unwrap();
        let mut client = Ours::new(&listener);
        client.send(&create("a", 8, 8, &["R"]));
        client.send(&packet(102, &[b"a\0\0", &3_i32.to_le_bytes(), b"over\0under\0"]));
        until("the wish", || live.info("a").is_some_and(|info| info.wishes.zoom == 3));
        let wishes = live.info("a").unwrap().wishes;
        let expected = if layers { ("over", "under") } else { ("", "") };
        assert_eq!((&*wishes.foreground, &*wishes.background), expected);
    }
}

#[test]
fn renders_of_one_name_are_separate_images_with_requests() {
    let live = Live::default();
    let (listener, _) = listening(&live, None);
    let (mut first, mut second) = (Ours::new(&listener), Ours::new(&listener));
    first.send(&create("a", 8, 8, &["R"]));
    until("the first", || live.requests("a").is_some());
    second.send(&create("a", 4, 4, &["R"]));
    until("the second", || live.requests("a (2)").is_some());
    assert_eq!(live.shown(), live.info("a (2)").unwrap().id);
    let ints = |values: &[i32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    second.send(&packet(101, &[b"a\0", &ints(&[0, 0, 2, 2])]));
    second.send(&packet(102, &[b"a\0\x01", &ints(&[3]), b"over\0\0"]));
    until("the wish", || live.info("a (2)").unwrap().wishes.zoom == 3);
    let info = live.info("a (2)").unwrap();
    assert_eq!((info.marks, info.wishes.foreground), (vec![PixelRect::at(0, 0, 2, 2)], String::new()));
    assert!(live.info("a").unwrap().marks.is_empty());
    // Commands reach the sender of the image, under its own name.
    let requests = live.requests("a (2)").unwrap();
    assert!(requests.send(Request::Center { x: 3, y: -1 }));
    assert!(requests.send(Request::Priority(PixelRect::at(1, 2, 3, 4))));
    assert!(requests.send(Request::Abort));
    assert_eq!(second.hear(15), packet(110, &[b"a\0", &ints(&[3, -1])]));
    assert_eq!(second.hear(23), packet(111, &[b"a\0", &ints(&[1, 2, 3, 4])]));
    assert_eq!(second.hear(7), packet(112, &[b"a\0"]));
    // One image is completed, one is stopped, and one sender disappears.
    let mut third = Ours::new(&listener);
    third.send(&create("b", 4, 4, &["R"]));
    second.send(&packet(103, &[b"a\0\x01"]));
    first.send(&packet(103, &[b"a\0\0"]));
    until("the third", || live.requests("b").is_some());
    drop((first, second, third));
    until("they are gone", || listener.clients() == 0 && live.requests("b").is_none());
    let note = |name: &str| live.info(name).unwrap().note;
    assert_eq!(note("a (2)"), None);
    assert_eq!(note("a").unwrap(), "the render was stopped before it was complete");
    assert_eq!(note("b").unwrap(), "the sender disconnected before the image was complete");
    // Their names are free again.
    let mut again = Ours::new(&listener);
    again.send(&create("a", 2, 2, &["R"]));
    until("it replaces the first", || live.info("a").unwrap().width == 2);
}
