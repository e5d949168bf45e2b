//! The folder of compiled shaders.
//!
//! Code that is loaded from there runs with the rights of the user. So the folder must be a folder, no link to one,
//! must belong to the user, and must be closed to everybody else. Files in it must belong to the user, too.

use granita_base::Environment;
use std::path::{Path, PathBuf};

/// Returns `$XDG_CACHE_HOME/granita`, or `$HOME/.cache/granita`. It is made when it is missing, for the user alone.
///
/// # Errors
/// Returns the reason why there is no such folder, or why it is not safe.
pub(super) fn folder(environment: &Environment) -> Result<PathBuf, String> {
    // A relative path is not valid (XDG base directory specification).
    let absolute = |name: &str| environment.get(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = absolute("XDG_CACHE_HOME")
        .or_else(|| absolute("HOME").map(|home| home.join(".cache")))
        .ok_or("neither $XDG_CACHE_HOME nor $HOME is the absolute path of a folder")?;
    let folder = base.join("granita");
    std::fs::create_dir_all(&base).map_err(|e| format!("{}: {e}", base.display()))?;
    match make_private(&folder) {
        Err(error) if error.kind() != std::io::ErrorKind::AlreadyExists => {
            return Err(format!("{}: {error}", folder.display()));
        }
        _ => {}
    }
    let is_private = std::fs::symlink_metadata(&folder)
        .map_err(|e| format!("{}: {e}", folder.display()))
        .map(|metadata| metadata.is_dir() && is_own(&metadata) && is_closed(&metadata))?;
    match is_private {
        true => Ok(folder),
        false => Err(format!(
            "{} is not a folder that belongs to the user and is closed to others (mode 700)",
            folder.display()
        )),
    }
}

/// True when a path is a file, no link, that belongs to the user and that nobody else may write.
pub(super) fn is_own_file(path: &Path) -> bool {
    std::fs::symlink_metadata(path).is_ok_and(|m| m.is_file() && is_own(&m) && !is_open_to_write(&m))
}

#[cfg(unix)]
fn make_private(folder: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::DirBuilderExt;
    std::fs::DirBuilder::new().mode(0o700).create(folder)
}

#[cfg(unix)]
fn is_own(metadata: &std::fs::Metadata) -> bool {
    std::os::unix::fs::MetadataExt::uid(metadata) == rustix::process::geteuid().as_raw()
}

#[cfg(unix)]
fn is_closed(metadata: &std::fs::Metadata) -> bool {
    std::os::unix::fs::MetadataExt::mode(metadata) & 0o077 == 0
}

#[cfg(unix)]
fn is_open_to_write(metadata: &std::fs::Metadata) -> bool {
    std::os::unix::fs::MetadataExt::mode(metadata) & 0o022 != 0
}

#[cfg(not(unix))]
fn make_private(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir(folder)
}

#[cfg(not(unix))]
fn is_own(_: &std::fs::Metadata) -> bool {
    // The folder lies in the profile of the user, which others cannot write.
    true
}

#[cfg(not(unix))]
fn is_closed(_: &std::fs::Metadata) -> bool {
    true
}

#[cfg(not(unix))]
fn is_open_to_write(_: &std::fs::Metadata) -> bool {
    false
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::fs::{PermissionsExt, symlink};

    fn environment(cache: &Path) -> Environment {
        let mut environment = Environment::empty();
        environment.set("XDG_CACHE_HOME", cache.to_string_lossy());
        environment
    }

    #[test]
    fn the_folder_is_made_for_the_user_alone() {
        let place = tempfile::tempdir().unwrap();
        let base = place.path().join("a/b");
        let folder = folder(&environment(&base)).unwrap();
        assert_eq!(folder, base.join("granita"));
        assert_eq!(std::fs::metadata(&folder).unwrap().permissions().mode() & 0o777, 0o700);
    }

    #[test]
    fn folders_that_others_may_use_are_refused() {
        let place = tempfile::tempdir().unwrap();
        let granita = place.path().join("granita");
        std::fs::create_dir(&granita).unwrap();
        std::fs::set_permissions(&granita, std::fs::Permissions::from_mode(0o750)).unwrap();
        let refused = folder(&environment(place.path())).unwrap_err();
        assert!(refused.contains("mode 700"), "{refused}");
        std::fs::set_permissions(&granita, std::fs::Permissions::from_mode(0o700)).unwrap();
        assert_eq!(folder(&environment(place.path())), Ok(granita.clone()));
        // A link to a private folder may be changed by whoever made it.
        let (other, linked) = (place.path().join("other"), place.path().join("linked"));
        std::fs::create_dir(&linked).unwrap();
        std::fs::rename(&granita, &other).unwrap();
        symlink(&other, linked.join("granita")).unwrap();
        assert!(folder(&environment(&linked)).is_err());
    }

    #[test]
    fn files_that_others_may_write_are_not_loaded() {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("a.so");
        std::fs::write(&file, "").unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o600)).unwrap();
        assert!(is_own_file(&file));
        symlink(&file, place.path().join("b.so")).unwrap();
        assert!(!is_own_file(&place.path().join("b.so")));
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o620)).unwrap();
        assert!(!is_own_file(&file) && !is_own_file(&place.path().join("c.so")));
    }

    #[test]
    fn relative_paths_are_not_taken() {
        let mut environment = Environment::empty();
        environment.set("XDG_CACHE_HOME", "cache");
        assert!(folder(&environment).unwrap_err().contains("absolute"));
    }
}
