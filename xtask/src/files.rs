//! Files and programs, for the chores that build and install.

use std::path::{Path, PathBuf};
use std::process::Command;

/// Returns the root of the checkout.
pub(crate) fn repository() -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest.parent().unwrap_or(manifest).to_owned()
}

/// Returns the folder of build outputs.
pub(crate) fn target() -> PathBuf {
    std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| repository().join("target"), PathBuf::from)
}

/// Runs a program. Its standard streams are those of this one.
pub(crate) fn run(command: &mut Command) -> Result<(), String> {
    let status = command.status().map_err(|e| format!("{command:?}: {e}"))?;
    if status.success() { Ok(()) } else { Err(format!("{command:?}: {status}")) }
}

/// Runs a program and returns its standard output without blanks at its ends. An error has its standard error.
pub(crate) fn answer(command: &mut Command) -> Result<String, String> {
    let output = command.output().map_err(|e| format!("{command:?}: {e}"))?;
    if !output.status.success() {
        let errors = String::from_utf8_lossy(&output.stderr);
        return Err(format!("{command:?}: {}: {}", output.status, errors.trim()));
    }
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Makes a folder, unless it exists, and returns it.
pub(crate) fn made(folder: PathBuf) -> Result<PathBuf, String> {
    std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    Ok(folder)
}

/// Makes an empty folder in the place of what was there.
pub(crate) fn emptied(folder: PathBuf) -> Result<PathBuf, String> {
    match std::fs::remove_dir_all(&folder) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(format!("{}: {e}", folder.display())),
        _ => made(folder),
    }
}

/// Returns the text of a file.
pub(crate) fn read(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))
}

/// Writes a text to a file, whose folder is made.
pub(crate) fn write(path: &Path, text: &str) -> Result<(), String> {
    if let Some(folder) = path.parent() {
        made(folder.to_owned())?;
    }
    std::fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()))
}

/// Copies a file into a folder. An existing file is replaced and not written into, because it may be running.
pub(crate) fn copy(from: &Path, folder: &Path) -> Result<(), String> {
    let to = folder.join(from.file_name().unwrap_or_default());
    let beside = to.with_extension("new");
    let copied = std::fs::copy(from, &beside).and_then(|_| std::fs::rename(&beside, &to));
    copied.map_err(|e| format!("{} to {}: {e}", from.display(), to.display()))
}

/// Copies the files of a folder whose names end with `ending`.
pub(crate) fn copy_all(from: &Path, folder: &Path, ending: &str) -> Result<(), String> {
    let entries = std::fs::read_dir(from).map_err(|e| format!("{}: {e}", from.display()))?;
    for entry in entries {
        let path = entry.map_err(|e| e.to_string())?.path();
        if path.is_file() && path.to_string_lossy().ends_with(ending) {
            copy(&path, folder)?;
        }
    }
    Ok(())
}

/// Makes a link to `target`, which is relative to the folder of the link, in the place of what was there. Systems
/// without links of this kind get a copy.
pub(crate) fn link(target: &str, at: &Path) -> Result<(), String> {
    let folder = made(at.parent().unwrap_or(at).to_owned())?;
    match std::fs::remove_file(at) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(format!("{}: {e}", at.display())),
        _ => (),
    }
    #[cfg(unix)]
    let done = {
        let _ = folder;
        std::os::unix::fs::symlink(target, at)
    };
    #[cfg(not(unix))]
    let done = std::fs::copy(folder.join(target), at).map(|_| ());
    done.map_err(|e| format!("{}: {e}", at.display()))
}
