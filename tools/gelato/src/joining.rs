//! Workers that connect to their coordinator, and the secret that both know.

use crate::Options;
use granita_base::{Environment, Supervisor};
use granita_cli::{Given, Status, environment, leave, parse_with_given};
use granita_session::{NET_NEXT, NetSecret, join};
use std::ffi::OsString;
use std::fs::OpenOptions;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The option of a worker that has worked for another coordinator before.
const AGAIN: &str = "--again";

/// What is done when a connection ends, with the last words of the other side.
type Ended = Box<dyn FnOnce(Option<String>) + Send>;

/// The connection of a worker.
pub(crate) struct Streams {
    pub(crate) input: Box<dyn Read + Send>,
    pub(crate) output: Box<dyn Write + Send>,
    /// Returns what is done when the connection ends.
    pub(crate) ended: Box<dyn FnOnce(Supervisor) -> Ended>,
}

impl Streams {
    /// Returns standard input and output. Their end is noticed elsewhere.
    pub(crate) fn standard() -> Self {
        let (input, output) = (Box::new(io::stdin()), Box::new(io::stdout()));
        Self { input, output, ended: Box::new(|_| Box::new(|_| ())) }
    }
}

/// Connects a worker with "-join" to its coordinator. Returns the options that the coordinator sends, in place of those
/// of the command line, and the connection. Other runs keep their options.
///
/// # Errors
/// Returns the reason why there is no work.
pub(crate) fn streams(
    options: Options,
    given: Vec<Given>,
) -> Result<(Options, Vec<Given>, Option<Streams>), String> {
    let Some(address) = &options.join else { return Ok((options, given, None)) };
    let secret = secret(&options, &environment())?.ok_or_else(|| {
        format!("-join needs a secret: name a file with it (-secret FILE), or set {}", NetSecret::VARIABLE)
    })?;
    let joined = join(address, secret.key()).map_err(|what| format!("-join {what}"))?;
    // Names of the command line are relative to this folder.
    let own = std::env::current_dir().unwrap_or_default();
    std::env::set_current_dir(&joined.folder)
        .map_err(|error| format!("-join {address}: the folder {}: {error}", joined.folder.display()))?;
    let words = ["gelato", "-worker"].map(str::to_owned).into_iter().chain(joined.words);
    let (mut sent, given): (Options, Vec<Given>) = parse_with_given(words.map(OsString::from).collect());
    // The coordinator's number of threads is for its own machine.
    sent.threads = options.threads;
    let ended =
        move |supervisor| -> Ended { Box::new(move |words| end(&supervisor, words.as_deref(), &own)) };
    Ok((sent, given, Some(Streams { input: joined.input, output: joined.output, ended: Box::new(ended) })))
}

/// Returns the secret that the options or the environment name; `None` where they name none. A coordinator that listens
/// makes the file that it names.
///
/// # Errors
/// Returns a message that names the file or the variable.
pub(crate) fn secret(options: &Options, variables: &Environment) -> Result<Option<NetSecret>, String> {
    let Some(path) = &options.secret else {
        let text = variables.get(NetSecret::VARIABLE).filter(|text| !text.is_empty());
        let named = |what| format!("{}: {what}", NetSecret::VARIABLE);
        return text.map(NetSecret::new).transpose().map_err(named);
    };
    let named = |what: String| format!("-secret {}: {what}", path.display());
    let listens =
        options.net.iter().any(|list| list.split_whitespace().any(|word| word.starts_with("listen")));
    if listens && !path.exists() {
        make(path).map_err(|error| named(error.to_string()))?;
    }
    let text = read(path).map_err(|error| named(error.to_string()))?;
    NetSecret::new(&text).map(Some).map_err(named)
}

/// Writes a new secret to a file that only its owner may read.
fn make(path: &Path) -> io::Result<()> {
    let secret = NetSecret::random().map_err(io::Error::other)?;
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options.open(path)?.write_all(format!("{}\n", secret.text()).as_bytes())
}

/// Reads a secret, of a file that only its owner may read.
fn read(path: &Path) -> io::Result<String> {
    #[cfg(unix)]
    {
        let mode = std::os::unix::fs::MetadataExt::mode(&std::fs::metadata(path)?);
        if mode & 0o077 != 0 {
            return Err(io::Error::other("others may read it; a secret needs chmod 600"));
        }
    }
    std::fs::read_to_string(path)
}

/// Ends the process with the connection, whatever it is doing, or begins anew with the coordinator of the next frame.
/// `folder` is the one in which the process was started.
fn end(supervisor: &Supervisor, words: Option<&str>, folder: &Path) {
    let status = match words {
        Some("") => Status::Done,
        Some(NET_NEXT) => {
            supervisor.end();
            again(folder)
        }
        Some(reason) => {
            let _ = writeln!(io::stderr(), "gelato -worker: the coordinator has no more work: {reason}");
            Status::WithErrors
        }
        None => {
            let _ = writeln!(io::stderr(), "gelato -worker: the connection to the coordinator is lost");
            Status::WithErrors
        }
    };
    supervisor.end();
    leave(status)
}

/// Replaces the process by itself, which connects to the next coordinator. Returns only where that is impossible.
fn again(folder: &Path) -> Status {
    let mut words = std::env::args_os();
    let name = words.next().unwrap_or_default();
    let program = std::env::current_exe().unwrap_or_else(|_| PathBuf::from(&name));
    let mut command = Command::new(program);
    let is_again = std::env::args_os().any(|word| word == AGAIN);
    command.args(words).args((!is_again).then_some(AGAIN)).current_dir(folder);
    #[cfg(unix)]
    let error = {
        use std::os::unix::process::CommandExt;
        command.arg0(name).exec()
    };
    #[cfg(not(unix))]
    let error = match command.status() {
        Ok(status) if status.success() => return Status::Done,
        Ok(_) => return Status::WithErrors,
        Err(error) => error,
    };
    let _ = writeln!(io::stderr(), "gelato -worker: it cannot begin anew: {error}");
    Status::WithErrors
}
