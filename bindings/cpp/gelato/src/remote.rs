//! The renderer that works while its program continues (reference 2.3): another process, found and started.

use crate::live::Host;
use crate::object;
use granita_base::{Environment, Supervisor};
use granita_plugin::{InterfaceObject, Messages, PluginRules, Plugins};
use granita_session::{Remote, RemoteEnds};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A renderer in a process of its own.
pub(crate) fn renderer(manager: &Messages) -> Result<InterfaceObject<'static>, String> {
    let program = program(&std::env::vars_os().collect()).ok_or(
        "there is no program gelato beside the library, in $GELATOHOME/bin or on the search path to do the work",
    )?;
    let ends = start(&program).map_err(|e| format!("{}: {e}", program.display()))?;
    let plugins = Plugins::new(manager.reporter().clone(), PluginRules::default());
    let (remote, meanwhile) = Remote::new(ends, manager.reporter(), plugins.clone())
        .map_err(|what| format!("{}: {what}", program.display()))?;
    Ok(object(Box::new(remote), Box::new(Host(plugins)), manager, Some(meanwhile)))
}

/// The path of the tool: beside the library, else in the installation, else along the search path.
fn program(environment: &Environment) -> Option<PathBuf> {
    let name = format!("gelato{}", std::env::consts::EXE_SUFFIX);
    let library = library();
    let here = library.as_deref().and_then(Path::parent);
    let beside = here.into_iter().flat_map(|here| [here.join("../bin"), here.to_owned()]);
    let home =
        environment.get("GELATOHOME").filter(|home| !home.is_empty()).map(|home| Path::new(home).join("bin"));
    let path = environment.get("PATH").map(|path| std::env::split_paths(path).collect::<Vec<_>>());
    let mut folders = beside.chain(home).chain(path.into_iter().flatten());
    folders.find_map(|folder| Some(folder.join(&name)).filter(|program| program.is_file()))
}

/// The file of this library.
#[cfg(unix)]
fn library() -> Option<PathBuf> {
    use std::ffi::{CStr, OsStr};
    use std::os::unix::ffi::OsStrExt;
    let mut found = std::mem::MaybeUninit::<libc::Dl_info>::zeroed();
    let address: *const std::ffi::c_void = (crate::gelato_create_renderer as *const ()).cast();
    // SAFETY: an address of this library's own, and room for the answer, all of whose bits may be zero.
    let found = unsafe {
        if libc::dladdr(address, found.as_mut_ptr()) == 0 {
            return None;
        }
        found.assume_init()
    };
    if found.dli_fname.is_null() {
        return None;
    }
    // SAFETY: a string that stays as long as the library is loaded.
    let name = unsafe { CStr::from_ptr(found.dli_fname) };
    std::fs::canonicalize(OsStr::from_bytes(name.to_bytes())).ok()
}

#[cfg(not(unix))]
fn library() -> Option<PathBuf> {
    None
}

/// The longest silence of the process, in seconds, unless `GELATO_REMOTE_TIMEOUT` gives another number.
const PATIENCE: f32 = 60.0;

/// The longest silence that the environment gives.
fn patience() -> f32 {
    let text = std::env::var("GELATO_REMOTE_TIMEOUT").ok();
    text.and_then(|text| text.trim().parse().ok())
        .filter(|seconds: &f32| seconds.is_finite())
        .unwrap_or(PATIENCE)
}

/// Both directions are a socket: writing to one whose other end is gone raises no signal, which pipes would.
#[cfg(unix)]
fn start(program: &Path) -> std::io::Result<RemoteEnds> {
    use std::os::fd::OwnedFd;
    use std::os::unix::net::UnixStream;
    let (here, there) = UnixStream::pair()?;
    let mut command = Command::new(program);
    command
        .arg("-remote")
        .stdin(Stdio::from(OwnedFd::from(there.try_clone()?)))
        .stdout(Stdio::from(OwnedFd::from(there)));
    let process = Supervisor::unguarded().spawn(&mut command, "rendering in another process")?;
    let (from, to) = (Box::new(here.try_clone()?), Box::new(Quiet(here)));
    Ok(RemoteEnds { from, to, process, patience: patience() })
}

/// Writes without a signal.
#[cfg(unix)]
struct Quiet(std::os::unix::net::UnixStream);

#[cfg(unix)]
impl std::io::Write for Quiet {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        use std::os::fd::AsRawFd;
        #[cfg(any(target_os = "linux", target_os = "android"))]
        const FLAGS: libc::c_int = libc::MSG_NOSIGNAL;
        // Elsewhere the standard library sets the socket's own option.
        #[cfg(not(any(target_os = "linux", target_os = "android")))]
        const FLAGS: libc::c_int = 0;
        // SAFETY: an open socket, and the bytes of a slice.
        let sent = unsafe { libc::send(self.0.as_raw_fd(), bytes.as_ptr().cast(), bytes.len(), FLAGS) };
        usize::try_from(sent).map_err(|_| std::io::Error::last_os_error())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[cfg(not(unix))]
fn start(program: &Path) -> std::io::Result<RemoteEnds> {
    let mut command = Command::new(program);
    command.arg("-remote").stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut process = Supervisor::unguarded().spawn(&mut command, "rendering in another process")?;
    let (Some(to), Some(from)) = (process.take_stdin(), process.take_stdout()) else {
        return Err(std::io::Error::other("the renderer has no pipes"));
    };
    Ok(RemoteEnds { from: Box::new(from), to: Box::new(to), process, patience: patience() })
}
