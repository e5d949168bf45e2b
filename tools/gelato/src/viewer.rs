//! The viewer that shows pictures while they are rendered.

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::channel;
use std::time::Duration;

/// What `iv` says when it takes pictures, before the address.
const LISTENS: &str = "iv: listening on ";

/// Longest time until it says so.
const STARTING: Duration = Duration::from_secs(20);

/// Where pictures go: to `given`, or to an `iv` that is started for them. It takes a port that nobody else has, so that what
/// one user renders is not shown in the window of another.
pub(crate) fn find(given: Option<&str>) -> Result<String, String> {
    match given {
        Some(address) => Ok(address.to_owned()),
        None => start(&program()),
    }
}

/// The `iv` beside this program, or the one on the search path.
fn program() -> PathBuf {
    let name = format!("iv{}", std::env::consts::EXE_SUFFIX);
    let beside = std::env::current_exe().ok().and_then(|own| Some(own.parent()?.join(&name)));
    beside.filter(|path| path.is_file()).unwrap_or_else(|| name.into())
}

fn start(program: &std::path::Path) -> Result<String, String> {
    let failed = |what: String| format!("{} cannot be started as a viewer: {what}", program.display());
    let mut command = Command::new(program);
    command.args(["-listen", "0"]).stdin(Stdio::null()).stdout(Stdio::piped());
    // Ctrl-C ends the render: the picture stays.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let mut child = command.spawn().map_err(|error| failed(error.to_string()))?;
    let Some(output) = child.stdout.take() else { return Err(failed("it has no output".to_owned())) };
    let (said, hears) = channel();
    std::thread::spawn(move || {
        // What it says later is nobody's business, but somebody must take it.
        for line in BufReader::new(output).lines().map_while(Result::ok) {
            if let Some(address) = line.strip_prefix(LISTENS) {
                let _ = said.send(address.trim().to_owned());
            }
        }
    });
    let address = hears.recv_timeout(STARTING);
    let ended = |mut child: Child| match child.try_wait() {
        Ok(Some(status)) => format!("it ended at once ({status})"),
        _ => {
            let _ = child.kill();
            let _ = child.wait();
            "it does not say where it listens".to_owned()
        }
    };
    match address {
        Ok(address) => {
            // Somebody must ask for its end, or it stays in the table of processes.
            std::thread::spawn(move || child.wait());
            Ok(address)
        }
        Err(_) => {
            // Its output ends a little before it does.
            std::thread::sleep(Duration::from_millis(100));
            Err(failed(ended(child)))
        }
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    #[allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
    fn script(folder: &std::path::Path, text: &str) -> PathBuf {
        let path = folder.join("iv");
        std::fs::write(&path, format!("#!/bin/sh\n{text}\n")).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).unwrap();
        path
    }

    #[test]
    fn a_viewer_says_where_it_listens() {
        let folder = tempfile::tempdir().unwrap();
        let good = script(folder.path(), "echo hello; echo iv: listening on 127.0.0.1:$(($# + 5))");
        assert_eq!(start(&good).unwrap(), "127.0.0.1:7");
        assert_eq!(find(Some("box:1")).unwrap(), "box:1");
        let bad = script(folder.path(), "exit 3");
        let error = start(&bad).unwrap_err();
        assert!(error.contains("it ended at once") && error.contains('3'), "{error}");
        let error = start(&folder.path().join("nosuch")).unwrap_err();
        assert!(error.contains("cannot be started as a viewer"), "{error}");
    }
}
