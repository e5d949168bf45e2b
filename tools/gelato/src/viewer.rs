//! The viewer that shows images while they are rendered.

use parking_lot::Mutex;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{ChildStdin, Command, Stdio};
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::time::Duration;

/// The text before the address in the line that `iv` prints when it is ready for images.
const LISTENS: &str = "iv: listening on ";

/// The text before the address of the page in the line that `iv -serve` prints after it.
const SERVES: &str = "iv: serving ";

/// The longest time until `iv` prints that line.
const STARTING: Duration = Duration::from_secs(20);

/// The value of `-display`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Display {
    /// A viewer that listens at `HOST[:PORT]`.
    Viewer(String),
    /// A screen of X that replaces `$DISPLAY` (reference 6.1), as `[HOST]:NUMBER[.SCREEN]`.
    Screen(String),
}

impl std::str::FromStr for Display {
    type Err = std::convert::Infallible;

    /// Parses the value. A screen has a number below 100, or a number that contains a point. Ports of viewers are
    /// larger.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let is_screen = screen(text).is_some_and(|(_, number)| {
            number.contains('.') || number.parse::<u32>().is_ok_and(|number| number < 100)
        });
        Ok(if is_screen { Self::Screen(text.to_owned()) } else { Self::Viewer(text.to_owned()) })
    }
}

/// Returns the host and the number of a screen. The number may contain a point.
fn screen(text: &str) -> Option<(&str, &str)> {
    let (host, number) = text.rsplit_once(':')?;
    let digits = |part: &str| !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit());
    let (first, second) = number.split_once('.').unwrap_or((number, "0"));
    (digits(first) && digits(second) && !host.contains(char::is_whitespace)).then_some((host, number))
}

/// Returns the machine of a screen and the screen's name on that machine; `None` for a screen of this machine.
fn remote(text: &str) -> Option<(&str, String)> {
    let (host, number) = screen(text)?;
    let own = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let own = own.trim();
    let is_here = matches!(host, "" | "unix" | "localhost" | "::1" | "[::1]")
        || host.starts_with("127.")
        || host.contains('/')
        || host == own
        || own.split_once('.').is_some_and(|(first, _)| host == first);
    (!is_here).then(|| (host, format!(":{number}")))
}

/// Returns the address to which images are sent: that of `given`, or of an `iv` that is started for them. The `iv` uses
/// a free port, so that the images of one user are not shown in the window of another.
///
/// `variable` is `$DISPLAY`. An `iv` for a screen of another machine runs there (reference 6.4), through `ssh`, which
/// also carries the images. With `layers` it opens the images that outputs name as "foreground" and "background". When
/// `own` is true, this program contains `iv`.
pub(crate) fn find(
    given: Option<&Display>,
    variable: Option<&str>,
    layers: bool,
    own: bool,
) -> Result<String, String> {
    let screen = match given {
        Some(Display::Viewer(address)) => return Ok(address.clone()),
        Some(Display::Screen(screen)) => Some(&**screen),
        None => variable,
    };
    match screen.and_then(remote) {
        Some((host, screen)) => start_there(Path::new("ssh"), host, &screen, layers),
        None => start(viewer(own), screen, layers),
    }
}

/// Returns the command for the `iv` of this program when `own` is true. Otherwise it is the one beside this program, or
/// else the one on the search path.
fn viewer(own: bool) -> Command {
    let program = std::env::current_exe().ok();
    if let (Some(program), true) = (&program, own) {
        let mut command = Command::new(program);
        command.args(["-as", "iv"]);
        return command;
    }
    let name = format!("iv{}", std::env::consts::EXE_SUFFIX);
    let beside = program.and_then(|program| Some(program.parent()?.join(&name)));
    Command::new(beside.filter(|path| path.is_file()).unwrap_or_else(|| name.into()))
}

/// Returns the options of an `iv` that is started.
fn options(port: u16, layers: bool) -> Vec<String> {
    let mut words = vec!["-listen".to_owned(), port.to_string()];
    words.extend(layers.then(|| "-allowlayers".to_owned()));
    words
}

/// Starts an `iv` on this machine. Returns the address on which it listens.
fn start(mut command: Command, screen: Option<&str>, layers: bool) -> Result<String, String> {
    let program = Path::new(command.get_program()).display().to_string();
    let failed = |what: String| format!("{program} cannot be started as a viewer: {what}");
    command.args(options(0, layers));
    command.envs(screen.map(|screen| ("DISPLAY", screen)));
    // Standard error of `iv` stays that of this program, because `iv` outlives it.
    listening(command, LISTENS).map(|found| found.address).map_err(failed)
}

/// Starts an `iv` on another machine through the program `ssh`, with a tunnel to it. Returns the address of the tunnel.
fn start_there(ssh: &Path, host: &str, screen: &str, layers: bool) -> Result<String, String> {
    let failed =
        |what: String| format!("iv cannot be started on {host} for the screen {screen} there: {what}");
    // The tunnel needs a free port here and a port that is most likely free there.
    let here = std::net::TcpListener::bind(("127.0.0.1", 0)).and_then(|listener| listener.local_addr());
    let here = here.map_err(|error| failed(error.to_string()))?.port();
    let there = 20_000 + (std::process::id().wrapping_mul(2_654_435_761) >> 16) as u16 % 40_000;
    let mut command = Command::new(ssh);
    command.args(["-o", "BatchMode=yes", "-o", "ConnectTimeout=10", "-o", "ExitOnForwardFailure=yes"]);
    command.args(["-L", &format!("127.0.0.1:{here}:127.0.0.1:{there}"), "--", host]);
    command.arg(format!("env DISPLAY={screen} iv {}", options(there, layers).join(" ")));
    // The reason why the machine cannot be reached becomes a part of the message.
    command.stderr(Stdio::piped());
    listening(command, LISTENS).map_err(failed)?;
    Ok(format!("127.0.0.1:{here}"))
}

/// A viewer in browsers.
#[derive(Debug)]
pub(crate) struct Pages {
    /// The address to which images are sent.
    pub(crate) address: String,
    /// The address of the page.
    pub(crate) url: String,
    /// The viewer ends when this is dropped.
    _input: Option<ChildStdin>,
}

/// Starts an `iv` that shows images in browsers of this machine until the result is dropped. When `own` is true, this
/// program contains `iv`.
pub(crate) fn pages(own: bool) -> Result<Pages, String> {
    let mut command = viewer(own);
    let program = Path::new(command.get_program()).display().to_string();
    command.args(["-serve", "0", "-listen", "0", "-endwithinput"]).stdin(Stdio::piped());
    let found = listening(command, SERVES);
    found.map_err(|what| format!("{program} cannot be started as a viewer: {what}"))
}

/// Starts a viewer and returns the addresses that it prints until the line that begins with `last`. An error ends with
/// the last line of its standard error, if that is a pipe.
fn listening(mut command: Command, last: &'static str) -> Result<Pages, String> {
    if last == LISTENS {
        command.stdin(Stdio::null());
    }
    command.stdout(Stdio::piped());
    // Ctrl-C ends the render. The viewer is in a process group of its own and keeps the image.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let mut child = command.spawn().map_err(|error| error.to_string())?;
    let input = child.stdin.take();
    let Some(output) = child.stdout.take() else { return Err("it has no output".to_owned()) };
    let (said, hears) = channel();
    std::thread::spawn(move || {
        let mut address = String::new();
        // The later output is not used, but the pipe must not fill up.
        for line in BufReader::new(output).lines().map_while(Result::ok) {
            if let Some(found) = line.strip_prefix(LISTENS) {
                address = found.trim().to_owned();
            }
            if let Some(url) = line.strip_prefix(last) {
                let _ = said.send((address.clone(), url.trim().to_owned()));
            }
        }
    });
    let last = Arc::new(Mutex::new(String::new()));
    let errors = child.stderr.take().map(|errors| {
        let last = last.clone();
        std::thread::spawn(move || {
            for line in BufReader::new(errors).lines().map_while(Result::ok) {
                if !line.trim().is_empty() {
                    *last.lock() = line;
                }
            }
        })
    });
    match hears.recv_timeout(STARTING) {
        Ok((address, url)) => {
            // The process must be waited for when it ends, or it stays in the table of processes.
            std::thread::spawn(move || child.wait());
            Ok(Pages { address, url, _input: input })
        }
        Err(_) => {
            // The output of a process ends a little before the process does.
            std::thread::sleep(Duration::from_millis(100));
            let ended = match child.try_wait() {
                Ok(Some(status)) => format!("it ended at once ({status})"),
                _ => {
                    let _ = child.kill();
                    let _ = child.wait();
                    "it does not say where it listens".to_owned()
                }
            };
            let _ = errors.map(std::thread::JoinHandle::join);
            let said = last.lock().trim().to_owned();
            Err(if said.is_empty() { ended } else { format!("{ended}: {said}") })
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::path::PathBuf;

    fn script(folder: &std::path::Path, text: &str) -> PathBuf {
        let path = folder.join("iv");
        granita_needs::write_script(&path, text);
        path
    }

    #[test]
    fn a_viewer_says_where_it_listens() {
        let folder = tempfile::tempdir().unwrap();
        let good = script(folder.path(), "echo hello; echo iv: listening on 127.0.0.1:$(($# + 5))");
        assert_eq!(start(Command::new(&good), None, false).unwrap(), "127.0.0.1:7");
        assert_eq!(start(Command::new(&good), None, true).unwrap(), "127.0.0.1:8", "-allowlayers");
        let given = Display::Viewer("box:1414".to_owned());
        assert_eq!(find(Some(&given), Some("workstation:0"), true, false).unwrap(), "box:1414");
        let screened = script(folder.path(), "echo iv: listening on 127.0.0.1:${DISPLAY#:}");
        assert_eq!(start(Command::new(&screened), Some(":93"), false).unwrap(), "127.0.0.1:93");
        let own = viewer(true);
        assert_eq!(own.get_program(), std::env::current_exe().unwrap());
        assert!(own.get_args().eq(["-as", "iv"]));
        assert!(viewer(false).get_args().next().is_none());
        let bad = script(folder.path(), "exit 3");
        let error = start(Command::new(&bad), None, false).unwrap_err();
        assert!(error.contains("it ended at once") && error.contains('3'), "{error}");
        let error = start(Command::new(folder.path().join("nosuch")), None, false).unwrap_err();
        assert!(error.contains("cannot be started as a viewer"), "{error}");
    }

    #[test]
    fn screens_and_viewers_are_told_apart() {
        let is_screen = |text: &str| matches!(text.parse(), Ok(Display::Screen(screen)) if screen == text);
        for screen in [
            ":0",
            ":1.0",
            "workstation:0",
            "workstation:0.0",
            "localhost:10.0",
            "unix:1",
            "box:99",
            "a:2000.1",
        ] {
            assert!(is_screen(screen), "{screen}");
        }
        for viewer in [
            "localhost",
            "box",
            "box:14158",
            "localhost:1024",
            ":14158",
            "[::1]:14158",
            "a b:0",
            "box:",
            "box:x",
            "100",
        ] {
            assert!(!is_screen(viewer), "{viewer}");
        }
        assert_eq!(remote("workstation:0.0"), Some(("workstation", ":0.0".to_owned())));
        for here in [":0", "localhost:10.0", "unix:0", "127.0.0.1:0", "/private/launch-x/org.x:0", "nonsense"]
        {
            assert_eq!(remote(here), None, "{here}");
        }
    }

    #[test]
    fn a_viewer_elsewhere_is_started_through_ssh() {
        let folder = tempfile::tempdir().unwrap();
        // This script prints its arguments as the last line of an error.
        let echo = script(folder.path(), "echo \"$@\" >&2; exit 255");
        let error = start_there(&echo, "workstation", ":0", true).unwrap_err();
        assert!(
            error
                .starts_with("iv cannot be started on workstation for the screen :0 there: it ended at once"),
            "{error}"
        );
        assert_eq!(error.lines().count(), 1);
        let words = error.split_once("-o BatchMode=yes").unwrap().1;
        assert!(
            words.contains("-- workstation env DISPLAY=:0 iv -listen ") && words.ends_with(" -allowlayers"),
            "{error}"
        );
        let ports: Vec<u16> =
            words.split([':', ' ']).filter_map(|w| w.parse().ok()).filter(|port| *port != 0).collect();
        let [_, there, listens] = ports[..] else { panic!("{ports:?} {words}") };
        assert_eq!(there, listens);
        // The address is that of the local end of the tunnel, whatever the other end prints.
        let good = script(folder.path(), "echo iv: listening on 127.0.0.1:5");
        let address = start_there(&good, "workstation", ":0", false).unwrap();
        assert!(address.starts_with("127.0.0.1:") && address != "127.0.0.1:5", "{address}");
        let error = start_there(&folder.path().join("nosuch"), "workstation", ":0", false).unwrap_err();
        assert!(error.contains("No such file"), "{error}");
    }
}
