//! Early ends of a tool: by a signal, by a time limit, or because the program that started it is gone.

use crate::Status;
use std::io;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Calls `action` when a signal requests the end of the process (`SIGINT`, `SIGTERM`, `SIGHUP`). The process then
/// ends by that signal. Signals that the process ignores, as under `nohup`, stay ignored. The action runs in its own
/// thread while all other threads continue. It ends child processes. Unfinished files under hidden names are removed
/// after it.
///
/// On systems other than Unix it has no effect.
///
/// # Errors
/// The errors of the system.
pub fn before_signals(action: impl Fn() + Send + 'static) -> io::Result<()> {
    #[cfg(unix)]
    {
        use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
        let ignored = ignored();
        let signals = [SIGHUP, SIGINT, SIGTERM].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0);
        let mut signals = signal_hook::iterator::Signals::new(signals)?;
        let thread = std::thread::Builder::new().name("signals".to_owned());
        thread.spawn(move || {
            if let Some(signal) = signals.forever().next() {
                action();
                granita_base::files::remove_unfinished();
                // It returns only for signals that do not end a process.
                let _ = signal_hook::low_level::emulate_default_handler(signal);
            }
        })?;
    }
    #[cfg(not(unix))]
    drop(action);
    Ok(())
}

/// Returns a flag that the next signal of [`before_signals`] sets. It is false forever on systems other than Unix.
pub(crate) fn next_signal() -> Arc<AtomicBool> {
    let flag = Arc::new(AtomicBool::new(false));
    #[cfg(unix)]
    {
        use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
        let ignored = ignored();
        for signal in [SIGHUP, SIGINT, SIGTERM].into_iter().filter(|signal| ignored >> (signal - 1) & 1 == 0)
        {
            // Without it, the run ends after a time limit.
            let _ = signal_hook::flag::register(signal, flag.clone());
        }
    }
    flag
}

/// Returns the signals that this process ignores, as bits from signal 1 on; none where the system does not provide
/// them.
#[cfg(unix)]
fn ignored() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
}

/// Calls `action` when the program at the other ends of standard input and output is gone, which closes both. The end
/// of the input alone means that there is no more work, and the end of the output alone means that the program does
/// not read it.
///
/// On systems other than Unix it has no effect.
///
/// # Errors
/// The errors of the system.
pub fn when_caller_is_gone(action: impl FnOnce() + Send + 'static) -> io::Result<()> {
    #[cfg(unix)]
    {
        let thread = std::thread::Builder::new().name("caller".to_owned());
        thread.spawn(move || {
            if hangs_up(rustix::stdio::stdin()) && hangs_up(rustix::stdio::stdout()) {
                action();
            }
        })?;
    }
    #[cfg(not(unix))]
    drop(action);
    Ok(())
}

/// The interval at which the end of the parent is noticed.
const GLANCE: std::time::Duration = std::time::Duration::from_millis(500);

/// Calls `action` when the process that started this one has ended, within half a second.
///
/// On systems other than Unix it has no effect.
///
/// # Errors
/// The errors of the system.
pub(crate) fn when_parent_is_gone(action: impl FnOnce() + Send + 'static) -> io::Result<()> {
    #[cfg(unix)]
    {
        let parent = std::os::unix::process::parent_id();
        std::thread::Builder::new().name("parent".to_owned()).spawn(move || {
            // Another process is the parent of orphans.
            while std::os::unix::process::parent_id() == parent {
                std::thread::sleep(GLANCE);
            }
            action();
        })?;
    }
    #[cfg(not(unix))]
    drop(action);
    Ok(())
}

/// Waits until the other end of a pipe or socket is closed. Returns false when the system cannot detect it.
#[cfg(unix)]
fn hangs_up(end: std::os::fd::BorrowedFd<'_>) -> bool {
    use rustix::event::{PollFd, PollFlags, poll};
    loop {
        // A hang-up is reported without being requested.
        let mut ends = [PollFd::from_borrowed_fd(end, PollFlags::empty())];
        match poll(&mut ends, None) {
            Err(rustix::io::Errno::INTR) => (),
            Err(_) => return false,
            Ok(_) => return ends[0].revents().intersects(PollFlags::HUP | PollFlags::ERR),
        }
    }
}

/// Waits for the thread that a signal woke to end the process. That thread may have ended what the tool was waiting
/// for, and the exit status must be that of the signal.
pub fn wait_for_end() {
    // Ending takes a third of a second. If it fails, the tool ends by itself.
    std::thread::sleep(std::time::Duration::from_secs(5));
}

/// Ends the process at once, whatever its threads are doing.
#[cfg(unix)]
pub fn leave(status: Status) -> ! {
    // Threads that render must not access destroyed statics of libraries.
    signal_hook::low_level::exit(status.code().into())
}

/// Ends the process at once, whatever its threads are doing.
#[cfg(not(unix))]
#[expect(clippy::exit, reason = "the purpose of this function")]
pub fn leave(status: Status) -> ! {
    std::process::exit(status.code().into())
}
