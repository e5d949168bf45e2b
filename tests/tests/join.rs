//! Tests of workers that connect to their coordinator (`gelato -net listen`, `gelato -worker -join`).

#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_tests::{Image, Tools, copy_first};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

const SECRET: &str = "a secret of the tests";

/// A folder with a scene, and the port of its coordinator.
struct Place {
    tools: Tools,
    folder: tempfile::TempDir,
    port: u16,
}

/// A child process that is killed when the test is over.
struct Running(Option<Child>);

impl Running {
    /// Waits for its end.
    fn end(mut self) -> Output {
        self.0.take().unwrap().wait_with_output().unwrap()
    }

    fn signal(&self, name: &str) {
        let pid = self.0.as_ref().unwrap().id().to_string();
        assert!(Command::new("kill").args([name, &pid]).status().unwrap().success());
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

impl Place {
    fn new() -> Self {
        let (tools, folder) = (Tools::build().unwrap(), tempfile::tempdir().unwrap());
        copy_first(folder.path()).unwrap();
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let place = Self { tools, folder, port };
        place.write_secret("secret", SECRET, 0o600);
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write_secret(&self, name: &str, text: &str, mode: u32) {
        std::fs::write(self.path(name), text).unwrap();
        std::fs::set_permissions(self.path(name), PermissionsExt::from_mode(mode)).unwrap();
    }

    fn start(&self, folder: &Path, words: &[&str]) -> Running {
        let mut command = Command::new(self.tools.program("gelato"));
        command.current_dir(folder).args(words).env_remove("GELATOHOME").stdin(Stdio::null());
        Running(Some(command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()))
    }

    /// Starts a worker, in another folder than that of the scene.
    fn worker(&self, secret: &str) -> Running {
        self.worker_at(self.port, secret)
    }

    /// Starts a worker that connects to a port.
    fn worker_at(&self, port: u16, secret: &str) -> Running {
        let (address, secret) = (format!("127.0.0.1:{port}"), self.path(secret));
        let words = ["-worker", "-join", &address, "-threads", "1", "-secret", secret.to_str().unwrap()];
        self.start(Path::new("/"), &words)
    }

    /// Starts the coordinator, which writes "out.exr".
    fn coordinator(&self, words: &[&str]) -> Running {
        let listen = format!("listen:127.0.0.1:{}", self.port);
        let net = ["-net", &listen, "-secret", "secret", "examples/first/first.pyg", "-o", "out.exr"];
        self.start(self.folder.path(), &[words, &net].concat())
    }

    /// Waits until the coordinator listens.
    fn connect(&self) -> TcpStream {
        let begin = Instant::now();
        loop {
            match TcpStream::connect(("127.0.0.1", self.port)) {
                Ok(stream) => return stream,
                Err(error) => assert!(begin.elapsed() < Duration::from_secs(30), "{error}"),
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Renders without workers.
    fn alone(&self) -> (Image, Duration) {
        let begin = Instant::now();
        let words = ["-threads", "1", "examples/first/first.pyg", "-o", "alone.exr"];
        let ran = self.start(self.folder.path(), &words).end();
        assert!(ran.status.success(), "{}", text(&ran.stderr));
        (Image::read(&self.path("alone.exr")).unwrap(), begin.elapsed())
    }

    /// Checks the end of a coordinator and its image, and returns its messages.
    fn check(&self, ran: &Output, alone: &Image) -> String {
        let said = text(&ran.stderr);
        assert!(ran.status.success(), "{said}");
        assert!(Image::read(&self.path("out.exr")).unwrap() == *alone, "other pixels");
        said
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn workers_that_join_render_the_same_pixels() {
    let place = Place::new();
    let (alone, _) = place.alone();
    // One worker tries before its coordinator listens.
    let first = place.worker("secret");
    let coordinator = place.coordinator(&["-statistics"]);
    drop(place.connect());
    let second = place.worker("secret");
    let ran = coordinator.end();
    let said = place.check(&ran, &alone);
    // The connection that was dropped above.
    assert_eq!(said.matches("-net: ").count(), 1, "{said}");
    assert!(
        said.contains("a connection from 127.0.0.1 was refused: it does not speak the protocol"),
        "{said}"
    );
    let statistics = text(&ran.stdout);
    assert!(statistics.contains("  worker ") && statistics.contains("buckets and parts"), "{statistics}");
    for worker in [first, second] {
        let ran = worker.end();
        // The second one may come too late.
        let late = text(&ran.stderr).contains("the coordinator refused the connection");
        assert!(ran.status.success() || late, "{}: {}", ran.status, text(&ran.stderr));
    }
}

#[test]
fn strangers_are_refused_and_cost_nothing() {
    let place = Place::new();
    let (alone, _) = place.alone();
    place.write_secret("other", "the secret of another one", 0o600);
    let coordinator = place.coordinator(&[]);
    let mut garbage = place.connect();
    garbage.write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
    garbage.shutdown(Shutdown::Write).unwrap();
    let mut rest = Vec::new();
    let _ = garbage.read_to_end(&mut rest);
    assert!(rest.is_empty());
    // This one says nothing, and stays.
    let silent = place.connect();
    let wrong = place.worker("other").end();
    assert_eq!(wrong.status.code(), Some(2));
    assert!(text(&wrong.stderr).contains("it may have another secret"), "{}", text(&wrong.stderr));
    let worker = place.worker("secret");
    let said = place.check(&coordinator.end(), &alone);
    for part in ["it does not speak the protocol", "it does not know the secret"] {
        assert!(said.contains(&format!("a connection from 127.0.0.1 was refused: {part}")), "{said}");
    }
    assert!(worker.end().status.success());
    drop(silent);
}

#[test]
fn stopped_and_killed_workers_do_not_cost_the_frame() {
    let place = Place::new();
    let (alone, usual) = place.alone();
    let workers = [(); 3].map(|()| place.worker("secret"));
    let begin = Instant::now();
    let coordinator = place.coordinator(&[]);
    drop(place.connect());
    // They join within half a second after that, and the frame takes longer.
    std::thread::sleep(Duration::from_millis(1200));
    workers[0].signal("-STOP");
    workers[1].signal("-KILL");
    let said = place.check(&coordinator.end(), &alone);
    let late = begin.elapsed().saturating_sub(usual);
    assert!(late < Duration::from_secs(10), "{late:?} late: {said}");
    assert!(!said.contains("renders alone"), "{said}");
    let [_, _, last] = workers;
    assert!(last.end().status.success());
}

#[test]
fn workers_that_stop_at_the_start_do_not_cost_the_frame() {
    let place = Place::new();
    let (alone, usual) = place.alone();
    let worker = place.worker("secret");
    let begin = Instant::now();
    let mut coordinator = place.coordinator(&["-verbosity", "2"]);
    // It is stopped before it has read the scene, but after it joined.
    let mut said = BufReader::new(coordinator.0.as_mut().unwrap().stderr.take().unwrap());
    let mut line = String::new();
    while !line.contains(" joins") {
        line.clear();
        assert!(said.read_line(&mut line).unwrap() > 0, "the worker did not join");
    }
    worker.signal("-STOP");
    let rest = std::thread::spawn(move || {
        let mut text = String::new();
        said.read_to_string(&mut text).unwrap();
        text
    });
    let second = place.worker("secret");
    let ran = coordinator.end();
    let said = rest.join().unwrap();
    let late = begin.elapsed().saturating_sub(usual);
    place.check(&ran, &alone);
    assert!(late < Duration::from_secs(10), "{late:?} late: {said}");
    drop(second);
}

#[test]
fn workers_that_stop_after_their_last_bucket_do_not_hold_the_end() {
    let place = Place::new();
    // The command keeps the coordinator from ending.
    let scene = "Attribute (\"int[2] resolution\", (64, 64))\nOutput (\"few.tif\", \"tiff\", \"rgb\", \"camera\")\n\
        Translate (0, 0, 4)\nWorld ()\nSphere (1, -1, 1, 360)\nRender ()\nCommand (\"system sleep 2\")\n";
    std::fs::write(place.path("few.pyg"), scene).unwrap();
    let listen = format!("listen:127.0.0.1:{}", place.port);
    let worker = place.worker("secret");
    let coordinator = place.start(place.folder.path(), &["-net", &listen, "-secret", "secret", "few.pyg"]);
    let begin = Instant::now();
    while !place.path("few.tif").exists() {
        assert!(begin.elapsed() < Duration::from_secs(60));
        std::thread::sleep(Duration::from_millis(20));
    }
    worker.signal("-STOP");
    let begin = Instant::now();
    let ran = coordinator.end();
    assert!(ran.status.success(), "{}", text(&ran.stderr));
    assert!(begin.elapsed() < Duration::from_secs(10), "{:?}", begin.elapsed());
}

/// A network between workers and the coordinator. While it stalls, bytes stay where they are, in both directions.
struct Network {
    port: u16,
    stalls: Arc<AtomicBool>,
}

impl Network {
    /// Forwards connections to a port of this machine, until the test is over.
    fn to(port: u16) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let network = Self { port: listener.local_addr().unwrap().port(), stalls: Arc::default() };
        let stalls = network.stalls.clone();
        std::thread::spawn(move || {
            for worker in listener.incoming() {
                let (worker, coordinator) =
                    (worker.unwrap(), TcpStream::connect(("127.0.0.1", port)).unwrap());
                let ends = [(&worker, &coordinator), (&coordinator, &worker)];
                for (from, to) in ends.map(|(a, b)| (a.try_clone().unwrap(), b.try_clone().unwrap())) {
                    let stalls = stalls.clone();
                    std::thread::spawn(move || forward(from, to, &stalls));
                }
            }
        });
        network
    }

    fn stall(&self, stalls: bool) {
        self.stalls.store(stalls, Ordering::SeqCst);
    }
}

/// Forwards one direction of a connection.
fn forward(mut from: TcpStream, mut to: TcpStream, stalls: &AtomicBool) {
    let mut piece = [0; 1 << 14];
    while let Ok(n) = from.read(&mut piece) {
        while stalls.load(Ordering::SeqCst) {
            std::thread::sleep(Duration::from_millis(20));
        }
        if n == 0 || to.write_all(&piece[..n]).is_err() {
            break;
        }
    }
    let _ = to.shutdown(Shutdown::Write);
}

/// Renders with two workers whose network stalls in mid-frame, for `stalled` or to the end of the frame. Returns the
/// messages of the coordinator, and the statuses of the workers.
fn with_stalled_network(timeout: f32, stalled: Option<Duration>) -> (String, [Option<i32>; 2]) {
    let place = Place::new();
    let (alone, usual) = place.alone();
    let network = Network::to(place.port);
    std::fs::write(place.path("timeout.pyg"), format!("Attribute (\"float net:timeout\", {timeout})\n"))
        .unwrap();
    let mut coordinator = place.coordinator(&["-verbosity", "2", "timeout.pyg"]);
    drop(place.connect());
    let begin = Instant::now();
    let workers = [(); 2].map(|()| place.worker_at(network.port, "secret"));
    let mut said = BufReader::new(coordinator.0.as_mut().unwrap().stderr.take().unwrap());
    let mut text = String::new();
    while text.matches(" joins").count() < 2 {
        assert!(said.read_line(&mut text).unwrap() > 0, "the workers did not join: {text}");
    }
    let rest = std::thread::spawn(move || said.read_to_string(&mut text).map(|_| text).unwrap());
    std::thread::sleep(usual / 4);
    network.stall(true);
    if let Some(stalled) = stalled {
        std::thread::sleep(stalled);
        network.stall(false);
    }
    let ran = coordinator.end();
    let late = begin.elapsed().saturating_sub(usual);
    let said = rest.join().unwrap();
    place.check(&ran, &alone);
    assert!(late < Duration::from_secs(10), "{late:?} late: {said}");
    network.stall(false);
    let begin = Instant::now();
    let statuses = workers.map(|worker| worker.end().status.code());
    assert!(begin.elapsed() < Duration::from_secs(10), "the workers stayed");
    (said, statuses)
}

#[test]
fn a_network_that_stalls_for_seconds_costs_no_worker() {
    let (said, statuses) = with_stalled_network(60.0, Some(Duration::from_millis(6500)));
    assert!(said.contains("is silent; others do its part"), "{said}");
    assert_eq!(statuses, [Some(0), Some(0)], "{said}");
}

#[test]
fn a_network_that_stalls_for_long_does_not_cost_the_frame() {
    let (said, statuses) = with_stalled_network(2.0, None);
    assert_eq!(said.matches("it has been silent for 2 s").count(), 2, "{said}");
    assert_eq!(statuses, [Some(1), Some(1)], "{said}");
}

#[test]
fn workers_end_with_their_coordinator() {
    let place = Place::new();
    let worker = place.worker("secret");
    let coordinator = place.coordinator(&[]);
    drop(place.connect());
    std::thread::sleep(Duration::from_millis(1200));
    coordinator.signal("-KILL");
    let begin = Instant::now();
    let ran = worker.end();
    assert!(begin.elapsed() < Duration::from_secs(10));
    assert_eq!(ran.status.code(), Some(1), "{}", text(&ran.stderr));
    assert!(text(&ran.stderr).contains("the connection to the coordinator is lost"), "{}", text(&ran.stderr));
}

#[test]
fn commands_that_start_workers_end_with_the_coordinator() {
    let place = Place::new();
    // As srun, which waits for the tasks of a lost node.
    let script = "echo $$ > pid\n\"$1\" -worker -join \"$2\" -threads 1\nsleep 1000\n";
    std::fs::write(place.path("start.sh"), script).unwrap();
    let scene = "Output (\"few.tif\", \"tiff\", \"rgb\", \"camera\")\nTranslate (0, 0, 4)\nWorld ()\nSphere (1, -1, 1, 360)\nRender ()\n";
    std::fs::write(place.path("few.pyg"), scene).unwrap();
    let command = format!("cmd:sh start.sh {} %h", place.tools.program("gelato").display());
    let begin = Instant::now();
    let ran = place.start(place.folder.path(), &["-net", &command, "few.pyg"]).end();
    assert!(ran.status.success() && ran.stderr.is_empty(), "{}", text(&ran.stderr));
    assert!(begin.elapsed() < Duration::from_secs(30), "{:?}", begin.elapsed());
    let process = std::fs::read_to_string(place.path("pid")).unwrap();
    assert!(!Path::new("/proc").join(process.trim()).exists(), "the command still runs");
}

#[test]
fn secrets_are_made_checked_and_required() {
    let place = Place::new();
    let run = |words: &[&str]| place.start(place.folder.path(), words).end();
    let listen = format!("listen:127.0.0.1:{}", place.port);
    std::fs::write(place.path("few.pyg"), "World ()\nSphere (1, -1, 1, 360)\nRender ()\n").unwrap();
    let ran = run(&["-net", &listen, "few.pyg"]);
    assert_eq!(ran.status.code(), Some(1));
    assert!(text(&ran.stderr).contains("must know a secret"), "{}", text(&ran.stderr));
    // A file that is missing is made.
    let ran = run(&["-net", "local", "-net", &listen, "-secret", "new", "few.pyg"]);
    assert!(ran.status.success(), "{}", text(&ran.stderr));
    let made = std::fs::metadata(place.path("new")).unwrap();
    assert_eq!(made.permissions().mode() & 0o777, 0o600);
    assert_eq!(std::fs::read_to_string(place.path("new")).unwrap().trim().len(), 64);
    place.write_secret("open", SECRET, 0o644);
    place.write_secret("short", "short", 0o600);
    for (words, part) in [
        (&["-worker", "-join", "localhost"][..], "needs a secret"),
        (&["-worker", "-join", "localhost", "-secret", "none"], "-secret none: "),
        (&["-worker", "-join", "localhost", "-secret", "open"], "others may read it"),
        (&["-worker", "-join", "localhost", "-secret", "short"], "at least 16 characters"),
        (
            &["-worker", "-join", "localhost:1x", "-secret", "secret"],
            "\"localhost:1x\": expected HOST or HOST:PORT",
        ),
    ] {
        let ran = run(words);
        assert_eq!(ran.status.code(), Some(2), "{words:?}");
        assert!(text(&ran.stderr).contains(part), "{words:?}: {}", text(&ran.stderr));
    }
}

#[test]
fn workers_stay_for_the_frames_of_a_range() {
    let place = Place::new();
    // Many buckets, so that the worker gets some of each frame.
    let scene = "Attribute (\"int[2] resolution\", (320, 240))\nAttribute (\"int[2] limits:bucketsize\", (8, 8))\n\
        Attribute (\"int[2] spatialquality\", (6, 6))\nOutput (\"OUT.$frame.tif\", \"tiff\", \"rgb\", \"camera\")\n\
        Translate (0, 0, 2)\nWorld ()\nAttribute (\"string name\", \"of $frame\")\nLight (\"sky\", \"ambientlight\")\n\
        Shader (\"surface\", \"plastic\")\nSphere (1, -1, 1, 360)\nRender ()\n";
    for name in ["alone", "net"] {
        std::fs::write(place.path(&format!("{name}.pyg")), scene.replace("OUT", name)).unwrap();
    }
    let frames = ["-frames", "1-3", "-threads", "1"];
    let ran = place.start(place.folder.path(), &[&frames[..], &["alone.pyg"]].concat()).end();
    assert!(ran.status.success(), "{}", text(&ran.stderr));
    // The name of the file with the secret is relative to the folder of the worker.
    let address = format!("127.0.0.1:{}", place.port);
    let join = ["-worker", "-join", &address, "-threads", "1", "-secret", "secret"];
    let worker = place.start(place.folder.path(), &join);
    let listen = format!("listen:{address}");
    let net = ["-statistics", "-net", &listen, "-secret", "secret", "net.pyg"];
    let ran = place.start(place.folder.path(), &[&frames[..], &net].concat()).end();
    assert!(ran.status.success() && ran.stderr.is_empty(), "{}", text(&ran.stderr));
    let said = text(&ran.stdout);
    assert_eq!(said.matches("  worker ").count(), 3, "one worker in each frame: {said}");
    let ran = worker.end();
    assert!(ran.status.success() && ran.stderr.is_empty(), "{}", text(&ran.stderr));
    for number in 1..=3 {
        let [alone, net] =
            ["alone", "net"].map(|name| Image::read(&place.path(&format!("{name}.{number}.tif"))).unwrap());
        assert!(alone == net, "frame {number} has other pixels");
    }
}
