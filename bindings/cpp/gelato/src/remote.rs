//! The renderer that works while its program goes on (reference 2.3): another process, found and started.

use crate::live::Host;
use crate::object;
use granita_base::Environment;
use granita_plugin::{InterfaceObject, Messages, Plugins};
use granita_session::{Remote, RemoteEnds};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// A renderer in a process of its own.
pub(crate) fn renderer(manager: &Messages) -> Result<InterfaceObject<'static>, String> {
    let program = program(&std::env::vars_os().collect()).ok_or(
        "there is no program gelato beside the library, in $GELATOHOME/bin or on the search path to do the work",
    )?;
    let ends = start(&program).map_err(|e| format!("{}: {e}", program.display()))?;
    let plugins = Plugins::new(manager.reporter().clone(), true);
    let (remote, meanwhile) = Remote::new(ends, manager.reporter(), plugins.clone())
        .map_err(|what| format!("{}: {what}", program.display()))?;
    Ok(object(Box::new(remote), Box::new(Host(plugins)), manager, Some(meanwhile)))
}

/// The tool of this suite: where it lies beside the library, else where an installation is said to be, else along the path.
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

/// How a process ended.
fn ended(mut child: Child) -> Box<dyn FnOnce() -> String + Send> {
    Box::new(move || child.wait().map_or_else(|e| e.to_string(), |status| status.to_string()))
}

/// Both directions are a socket: writing to one whose other end is gone raises no signal, which pipes would.
#[cfg(unix)]
fn start(program: &Path) -> std::io::Result<RemoteEnds> {
    use std::os::fd::OwnedFd;
    use std::os::unix::net::UnixStream;
    let (here, there) = UnixStream::pair()?;
    let child = Command::new(program)
        .arg("-remote")
        .stdin(Stdio::from(OwnedFd::from(there.try_clone()?)))
        .stdout(Stdio::from(OwnedFd::from(there)))
        .spawn()?;
    Ok(RemoteEnds { from: Box::new(here.try_clone()?), to: Box::new(Quiet(here)), ended: ended(child) })
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
    let mut child =
        Command::new(program).arg("-remote").stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
    let (Some(to), Some(from)) = (child.stdin.take(), child.stdout.take()) else {
        return Err(std::io::Error::other("the renderer has no pipes"));
    };
    Ok(RemoteEnds { from: Box::new(from), to: Box::new(to), ended: ended(child) })
}
