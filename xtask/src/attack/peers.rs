//! Tests processes and connections that are silent, stop, or send invalid data, at each place where a tool listens to
//! another.

use super::mutate::{Random, mutated};
use super::run::{Bounds, MEMORY_KIB, Place, Started, end, marked};
use super::{Attack, Failure, Tally, first_line, scenes};
use std::fs;
use std::io::{self, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::process::Stdio;
use std::time::{Duration, Instant};

/// The processor time for a frame whose worker or viewer fails, in seconds of a release build.
const SECONDS: f64 = 20.0;

/// A case: its name, and the function that returns its error.
type Case = (&'static str, fn(&Peers<'_>) -> io::Result<Option<String>>);

const CASES: [Case; 19] = [
    ("net-silent", |p| p.net("sleep 1000", true)),
    ("net-absent", |p| p.net("exit 3", true)),
    ("net-garbage", |p| p.net("head -c 100000 /dev/urandom; sleep 1000", true)),
    ("net-stopped-at-start", |p| p.net("kill -STOP $$; exec \"$GELATO\" \"$@\"", true)),
    ("net-stopped-later", |p| {
        p.net("\"$GELATO\" \"$@\" & child=$!; sleep 0.4; kill -STOP $child; sleep 1000", true)
    }),
    ("net-absurd-counts", |p| {
        p.net("echo granita-worker 0.1.0/3 4; head -c 64 /dev/zero | tr '\\0' '\\377'; sleep 1000", true)
    }),
    ("net-wrong-pixels-count", |p| {
        p.net("echo granita-worker 0.1.0/3 2; printf 'P\\14\\0\\0\\0\\0\\0\\0\\0\\1\\0\\0\\0\\5\\0\\0\\0'; sleep 1000", true)
    }),
    ("viewer-silent", |p| p.display(|_| ())),
    ("viewer-garbage", |p| {
        p.display(|socket| {
            let _ = socket.write_all(&[0xff; 65536]);
        })
    }),
    ("viewer-half-packet", |p| {
        p.display(|socket| {
            let _ = socket.write_all(&[200, 0, 0, 0, 100, 1]);
        })
    }),
    ("viewer-hangs-up", |p| {
        p.display(|socket| {
            let _ = socket.shutdown(std::net::Shutdown::Both);
        })
    }),
    ("listen-silent", |p| p.iv(|p, at| p.many_silent(at.listen))),
    ("listen-garbage", |p| p.iv(|p, at| p.packets(at.listen))),
    ("serve-half-requests", |p| p.iv(|p, at| p.many_silent(at.serve))),
    ("serve-garbage", |p| p.iv(|p, at| p.requests(at.serve))),
    ("remote-ends-early", |p| p.input("gelato -remote", b"T\xff\xff\xff\x7fAttribute")),
    ("remote-garbage", |p| p.input("gelato -remote", &[0xa5; 70_000])),
    ("stream-ends-early", |p| p.input("gelato -stream", b"F\x04\0\0\0a.pyC\xff\xff\xff\x7f")),
    ("worker-garbage", |p| {
        p.input("gelato -worker x.pyg", &b"bucket 99999999999\nframe -1\n\xff\n".repeat(2000))
    }),
];

/// Runs all cases.
pub(crate) fn run(attack: &Attack) -> Result<Tally, String> {
    let mut tally = Tally::new("peers");
    let told = |e: io::Error| format!("peers: {e}");
    let place = Place::new(attack.scratch.join("peers")).map_err(told)?;
    for (name, case) in CASES {
        if !attack.is_wanted("peers", name) {
            continue;
        }
        if attack.is_over() {
            println!("attack: peers: the time is over");
            break;
        }
        place.clear().map_err(told)?;
        let mark = format!("{}-{name}", std::process::id());
        let peers = Peers { attack, place: &place, mark };
        fs::write(place.work().join("x.pyg"), scenes::frame("", scenes::BALL)).map_err(told)?;
        let mut wrong = case(&peers).map_err(|e| format!("peers/{name}: {e}"))?;
        // Child processes must end with their parent.
        std::thread::sleep(Duration::from_millis(300));
        let alive = marked(&peers.mark);
        if !alive.is_empty() {
            end(&alive);
            let names: Vec<String> = alive.iter().map(|(_, name)| name.clone()).collect();
            let left = format!("left running: {}", names.join(" "));
            wrong = Some(wrong.map_or(left.clone(), |wrong| format!("{wrong}; {left}")));
        }
        let failure = match wrong {
            None => None,
            Some(what) => {
                let kept = attack.keep("peers", name, &place, &["gelato x.pyg".to_owned()]).map_err(told)?;
                Some(Failure { name: name.to_owned(), what, kept: Some(kept) })
            }
        };
        tally.add(failure);
    }
    place.clear().map_err(told)?;
    Ok(tally)
}

/// The common arguments of the cases.
struct Peers<'a> {
    attack: &'a Attack,
    place: &'a Place,
    mark: String,
}

/// The addresses on which a viewer listens.
struct At {
    listen: SocketAddr,
    serve: SocketAddr,
    /// The path of its page.
    path: String,
}

impl Peers<'_> {
    fn bounds(&self) -> Bounds {
        Bounds { seconds: self.attack.seconds(SECONDS), memory_kib: MEMORY_KIB, files: None }
    }

    fn start(&self, line: &str, input: Stdio) -> io::Result<Started> {
        let mut words = line.split(' ').map(str::to_owned);
        let program = self.attack.program(&words.next().unwrap_or_default());
        self.place.start(&program, &words.collect::<Vec<_>>(), &self.bounds(), input, Some(&self.mark))
    }

    /// Runs a command line to its end. Returns the error. The image must exist.
    fn renders(&self, line: &str) -> io::Result<Option<String>> {
        let started = self.start(line, Stdio::null())?;
        let outcome = started.wait(Duration::from_secs_f64(self.bounds().seconds))?;
        if let Some(fault) = outcome.fault() {
            return Ok(Some(fault));
        }
        if outcome.code() == Some(2) || !self.place.work().join("out.exr").exists() {
            return Ok(Some(format!("no image: {}", first_line(&outcome.stderr))));
        }
        Ok(None)
    }

    /// Renders a frame whose worker is this script.
    fn net(&self, script: &str, is_local: bool) -> io::Result<Option<String>> {
        let work = self.place.work();
        let worker = work.join("worker");
        let gelato = self.attack.program("gelato");
        fs::write(&worker, format!("GELATO={}\n{script}\n", gelato.display()))?;
        let settings = format!("Attribute (\"string net:workercmd\", \"sh {}\")\n", worker.display());
        fs::write(work.join("x.pyg"), scenes::frame(&settings, scenes::BALL))?;
        // Without this attribute, frames wait for workers without limit.
        let short = work.join("short.pyg");
        fs::write(short, "Attribute (\"float net:timeout\", 2)\n")?;
        let server = if is_local { "local" } else { "there" };
        self.renders(&format!("gelato -net {server} short.pyg x.pyg"))
    }

    /// Renders a frame that is shown by a viewer with this behaviour.
    fn display(&self, viewer: fn(&mut TcpStream)) -> io::Result<Option<String>> {
        let listener = TcpListener::bind("127.0.0.1:0")?;
        let at = listener.local_addr()?;
        let thread = std::thread::spawn(move || {
            let Ok((mut socket, _)) = listener.accept() else { return };
            viewer(&mut socket);
            // The viewer reads nothing, and keeps the connection open for a while.
            std::thread::sleep(Duration::from_secs(20));
        });
        let wrong = self.renders(&format!("gelato -display {at} x.pyg"));
        // The viewer's thread ends by itself.
        drop(thread);
        wrong
    }

    /// Runs a program with these bytes as its standard input.
    fn input(&self, line: &str, bytes: &[u8]) -> io::Result<Option<String>> {
        let mut started = self.start(line, Stdio::piped())?;
        if let Some(mut input) = started.child.stdin.take() {
            // The program may have closed its input.
            let _ = input.write_all(bytes);
            std::thread::sleep(Duration::from_millis(200));
        }
        let outcome = started.wait(Duration::from_secs_f64(self.attack.seconds(10.0)))?;
        Ok(outcome.fault())
    }

    /// Attacks a viewer without a window. A valid sender and a valid browser must work afterwards.
    fn iv(&self, attack: fn(&Self, &At) -> io::Result<Vec<TcpStream>>) -> io::Result<Option<String>> {
        let viewer = self.start("iv -serve 0 -listen 0", Stdio::null())?;
        let at = match addresses(&viewer) {
            Ok(at) => at,
            Err(error) => {
                viewer.signal("KILL");
                return Err(error);
            }
        };
        let open = attack(self, &at);
        let sent = self.renders_beside(&at);
        let page = get(&at);
        let clients = open.map(drop);
        let mut viewer = viewer;
        let died = viewer.is_over();
        viewer.signal("KILL");
        let said = viewer.wait(Duration::from_secs(5))?.stderr;
        clients?;
        if died {
            return Ok(Some(format!("the viewer died: {}", first_line(&said))));
        }
        if said.lines().count() > 200 {
            return Ok(Some(format!("the viewer printed {} lines", said.lines().count())));
        }
        Ok(sent?.or(page.err()))
    }

    /// Renders with the files of a second place, because the viewer writes its output into this one.
    fn renders_beside(&self, at: &At) -> io::Result<Option<String>> {
        let place = Place::new(self.attack.scratch.join("peers-sender"))?;
        fs::write(place.work().join("x.pyg"), scenes::frame("", scenes::BALL))?;
        let bounds = Bounds { seconds: self.attack.seconds(20.0), ..self.bounds() };
        let outcome = self.attack.run(&place, &format!("gelato -display {} x.pyg", at.listen), &bounds)?;
        let said = outcome.stderr.trim();
        let refused = (!said.is_empty()).then(|| format!("a sender is kept out: {}", first_line(said)));
        Ok(outcome.fault().or(refused))
    }

    /// Opens 128 connections, which send nothing or the beginning of a request.
    fn many_silent(&self, to: SocketAddr) -> io::Result<Vec<TcpStream>> {
        let mut open = Vec::new();
        for number in 0..128 {
            let mut socket = TcpStream::connect(to)?;
            // Every other connection sends half of a request.
            let _ = socket.write_all(if number % 2 == 0 { b"GET /" } else { b"" });
            open.push(socket);
        }
        std::thread::sleep(Duration::from_millis(200));
        Ok(open)
    }

    /// Sends changed packets, in pieces.
    fn packets(&self, to: SocketAddr) -> io::Result<Vec<TcpStream>> {
        let folder = self.attack.root.join("fuzz").join("corpus").join("display");
        let mut seeds = Vec::new();
        for entry in fs::read_dir(folder)? {
            seeds.push(fs::read(entry?.path())?);
        }
        seeds.sort();
        for number in 0..300 {
            let mut random = Random::new(self.attack.seed, number);
            let seed = &seeds[random.below(seeds.len())];
            let other = &seeds[random.below(seeds.len())];
            let bytes = mutated(seed, other, &mut random);
            let mut socket = TcpStream::connect(to)?;
            for part in bytes.chunks(1 + random.below(4000)) {
                if socket.write_all(part).is_err() {
                    break;
                }
            }
        }
        Ok(Vec::new())
    }

    /// Sends invalid requests.
    fn requests(&self, to: SocketAddr) -> io::Result<Vec<TcpStream>> {
        let long = format!("GET /{} HTTP/1.1\r\n\r\n", "a".repeat(1 << 20));
        let headers = format!("GET / HTTP/1.1\r\n{}\r\n", "A: b\r\n".repeat(100_000));
        let texts: [&[u8]; 7] = [
            b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 99999999999999999999\r\n\r\n",
            b"GET / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 18446744073709551615\r\n\r\n",
            b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n",
            b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03",
            b"\0\xff\0\xff\r\n\r\n",
            long.as_bytes(),
            headers.as_bytes(),
        ];
        for text in texts {
            let mut socket = TcpStream::connect(to)?;
            let _ = socket.write_all(text);
            socket.set_read_timeout(Some(Duration::from_secs(1)))?;
            let _ = socket.read(&mut [0; 64]);
        }
        let seed = b"GET /0123456789/live HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nSec-WebSocket-Key: AAAA\r\n\r\n";
        for number in 0..200 {
            let mut random = Random::new(self.attack.seed, number);
            let mut socket = TcpStream::connect(to)?;
            let _ = socket.write_all(&mutated(seed, texts[0], &mut random));
        }
        Ok(Vec::new())
    }
}

/// Returns the addresses that a viewer prints.
fn addresses(viewer: &Started) -> io::Result<At> {
    let begin = Instant::now();
    loop {
        let printed = viewer.printed();
        let after = |mark: &str| printed.lines().find_map(|line| line.strip_prefix(mark));
        let wrong = |_| io::Error::other(format!("iv printed \"{}\"", first_line(&printed)));
        if let (Some(listen), Some(page)) = (after("iv: listening on "), after("iv: serving http://")) {
            let (serve, path) = page.split_once('/').unwrap_or((page, ""));
            let (listen, serve) = (listen.parse().map_err(wrong)?, serve.parse().map_err(wrong)?);
            return Ok(At { listen, serve, path: format!("/{path}") });
        }
        if begin.elapsed() > Duration::from_secs(20) {
            return Err(io::Error::other(format!("iv does not listen: \"{}\"", first_line(&printed))));
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Requests the page. Returns the error.
fn get(at: &At) -> Result<(), String> {
    let ask = || -> io::Result<String> {
        let mut socket = TcpStream::connect(at.serve)?;
        socket.set_read_timeout(Some(Duration::from_secs(10)))?;
        write!(socket, "GET {} HTTP/1.1\r\nHost: {}\r\n\r\n", at.path, at.serve)?;
        let mut answer = String::new();
        socket.read_to_string(&mut answer)?;
        Ok(answer)
    };
    match ask() {
        Ok(answer) if answer.starts_with("HTTP/1.1 200") => Ok(()),
        Ok(answer) => Err(format!("the page is not served: \"{}\"", first_line(&answer))),
        Err(error) => Err(format!("the page is not served: {error}")),
    }
}
