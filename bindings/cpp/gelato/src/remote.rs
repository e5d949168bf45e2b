//! The renderer that works while its program continues (reference 2.3). It is another process, which is found and
//! started here.

use crate::live::Host;
use crate::object;
use granita_base::{Environment, Supervisor};
use granita_plugin::{InterfaceObject, Messages, PluginRules, Plugins};
use granita_session::{Remote, RemoteEnds};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Returns a renderer in another process.
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

/// Returns the path of the tool. It is beside the library, or else in the installation, or else on the search path.
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

/// Returns the file of this library.
#[cfg(unix)]
fn library() -> Option<PathBuf> {
    use std::ffi::{CStr, OsStr};
    use std::os::unix::ffi::OsStrExt;
    let mut found = std::mem::MaybeUninit::<libc::Dl_info>::zeroed();
    let address: *const std::ffi::c_void = (crate::gelato_create_renderer as *const ()).cast();
    // SAFETY: the address belongs to this library, and `found` has space for the result, all of whose bits may be zero.
    let found = unsafe {
        if libc::dladdr(address, found.as_mut_ptr()) == 0 {
            return None;
        }
        found.assume_init()
    };
    if found.dli_fname.is_null() {
        return None;
    }
    // SAFETY: the string is valid while the library is loaded.
    let name = unsafe { CStr::from_ptr(found.dli_fname) };
    std::fs::canonicalize(OsStr::from_bytes(name.to_bytes())).ok()
}

#[cfg(not(unix))]
fn library() -> Option<PathBuf> {
    None
}

/// The longest silence of the process, in seconds, unless `GELATO_REMOTE_TIMEOUT` gives another number.
const PATIENCE: f32 = 60.0;

/// Returns the longest silence of the process, in seconds, from the environment.
fn patience() -> f32 {
    let text = std::env::var("GELATO_REMOTE_TIMEOUT").ok();
    text.and_then(|text| text.trim().parse().ok())
        .filter(|seconds: &f32| seconds.is_finite())
        .unwrap_or(PATIENCE)
}

/// Starts the process with a socket for both directions. Writing to a socket with a closed other end raises no signal,
/// unlike a pipe.
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

/// A writer that raises no signal when the other end is closed.
#[cfg(unix)]
struct Quiet(std::os::unix::net::UnixStream);

#[cfg(unix)]
impl std::io::Write for Quiet {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        use std::os::fd::AsRawFd;
        #[cfg(any(target_os = "linux", target_os = "android"))]
        const FLAGS: libc::c_int = libc::MSG_NOSIGNAL;
        // On other systems the standard library sets an option of the socket instead.
        #[cfg(not(any(target_os = "linux", target_os = "android")))]
        const FLAGS: libc::c_int = 0;
        // SAFETY: the socket is open, and the bytes are those of a slice.
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
