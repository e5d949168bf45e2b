//! The end of a window whose screen is closed.
//!
//! The libraries that draw and that read events panic, each in its own place and thread, when the server of the screen
//! no longer answers. Such a panic is not an error of this program. The program ends with one message and without a
//! trace.

use granita_base::Reporter;
use granita_cli::{Status, leave};
use std::sync::mpsc;
use std::time::Duration;

/// The longest time in which a screen must answer.
const ANSWER: Duration = Duration::from_secs(2);

/// Installs a hook that ends the program with one message when a panic occurs and there is no screen. Other panics are
/// unchanged.
pub(super) fn watch(reporter: &Reporter) {
    let (reporter, before) = (reporter.clone(), std::panic::take_hook());
    std::panic::set_hook(Box::new(move |info| {
        if is_there() {
            return before(info);
        }
        say(&reporter);
        // Unwinding would go through code of other languages, which do not support it.
        leave(Status::Failed);
    }));
}

/// Reports that the connection to the screen is lost.
pub(super) fn say(reporter: &Reporter) {
    reporter.error("the connection to the screen is lost (its server has ended)");
}

/// True when the server of the screen accepts connections. An unknown kind of screen counts as true.
pub(super) fn is_there() -> bool {
    let variable = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
    match (variable("WAYLAND_DISPLAY"), variable("DISPLAY")) {
        (None, Some(display)) => answers(&display),
        _ => true,
    }
}

/// True when an X server accepts connections. The result is unknown for a name that is not an X display.
#[cfg(target_os = "linux")]
fn answers(display: &str) -> bool {
    use x11rb::errors::ConnectError;
    let (display, (sender, receiver)) = (display.to_owned(), mpsc::channel());
    // A connection that is refused for another reason than an I/O error was refused by a server.
    let connect =
        move || sender.send(!matches!(x11rb::connect(Some(&display)), Err(ConnectError::IoError(_))));
    std::thread::spawn(connect);
    receiver.recv_timeout(ANSWER).unwrap_or(false)
}

#[cfg(not(target_os = "linux"))]
fn answers(_: &str) -> bool {
    true
}

#[cfg(test)]
#[cfg(target_os = "linux")]
mod tests {
    use super::*;

    #[test]
    fn display_servers_are_tested_for_an_answer() {
        // No server has such a number.
        assert!(!answers(":50001"));
        assert!(answers("nonsense") && answers(":x") && answers(":50001000"));
        let listener = (0..100).find_map(|n| {
            Some((n, std::net::TcpListener::bind(("127.0.0.1", 6000_u16.checked_add(30_000 + n)?)).ok()?))
        });
        let Some((n, listener)) = listener else { return };
        assert!(!answers(&format!("127.0.0.1:{}", 30_000 + n)), "it says nothing");
        drop(listener);
        assert!(!answers(&format!("127.0.0.1:{}.0", 30_000 + n)));
    }
}
