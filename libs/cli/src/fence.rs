//! Restrictions by the kernel for a run of an untrusted scene.

use granita_base::{Files, Rules};

/// The extent to which the kernel enforces the rules of a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fence {
    /// Files outside of the rules cannot be opened, and no program can be started.
    Whole,
    /// The kernel supports only a part of this.
    Partial,
    /// The system does not support such restrictions, or they are switched off.
    None,
}

/// Makes the kernel (Linux: Landlock) enforce the rules of `files` for the calling thread and all threads that it
/// starts from now on. This protects against errors in the suite's own checks. It is called before threads are
/// started. Folders of files that the user named are accessible as a whole, because files are created there. Without
/// rules it has no effect.
///
/// # Errors
/// The kernel's error, when it supports the restrictions and refuses them.
pub fn fence(files: &Files) -> Result<Fence, String> {
    match files.rules() {
        Some(rules) => lay(&rules),
        None => Ok(Fence::None),
    }
}

/// The files and folders that the process itself reads: the number of processors, names of machines, and the
/// libraries for looking these up.
#[cfg(target_os = "linux")]
const SYSTEM: [&str; 13] = [
    "/proc/self",
    "/sys/fs/cgroup",
    "/sys/devices/system",
    "/dev/urandom",
    "/etc/hosts",
    "/etc/resolv.conf",
    "/etc/nsswitch.conf",
    "/etc/host.conf",
    "/etc/gai.conf",
    "/etc/ld.so.cache",
    "/lib",
    "/lib64",
    "/usr/lib",
];

#[cfg(target_os = "linux")]
fn lay(rules: &Rules) -> Result<Fence, String> {
    use landlock::{
        ABI, Access, AccessFs, BitFlags, PathBeneath, PathFd, Ruleset, RulesetAttr, RulesetCreated,
        RulesetCreatedAttr, RulesetError, RulesetStatus,
    };
    use std::path::Path;

    // This is the first version that supports renaming across folders and truncation.
    let abi = ABI::V3;
    let reading = AccessFs::ReadFile | AccessFs::ReadDir;
    // The process makes no devices, sockets or links, and removes no folders.
    let writing = reading
        | AccessFs::WriteFile
        | AccessFs::Truncate
        | AccessFs::MakeReg
        | AccessFs::MakeDir
        | AccessFs::RemoveFile
        | AccessFs::Refer;
    let allow = |set: RulesetCreated, path: &Path, access: BitFlags<AccessFs>| match PathFd::new(path) {
        Ok(handle) => {
            let access = if path.is_dir() { access } else { access & AccessFs::from_file(abi) };
            set.add_rule(PathBeneath::new(handle, access))
        }
        // A path that does not exist needs no rule.
        Err(_) => Ok(set),
    };
    // A rule needs an existing folder.
    if let Some(write) = &rules.write
        && let Err(error) = std::fs::create_dir(write)
        && error.kind() != std::io::ErrorKind::AlreadyExists
    {
        return Err(format!("{}: {error}", write.display()));
    }
    let lay = || -> Result<RulesetStatus, RulesetError> {
        let mut set = Ruleset::default().handle_access(AccessFs::from_all(abi))?.create()?;
        for path in SYSTEM.iter().map(Path::new).chain(rules.read.iter().map(|path| path.as_path())) {
            set = allow(set, path, reading)?;
        }
        for path in &rules.inputs {
            set = allow(set, path, AccessFs::ReadFile.into())?;
        }
        set = allow(set, Path::new("/dev/null"), AccessFs::ReadFile | AccessFs::WriteFile)?;
        if let Some(write) = &rules.write {
            set = allow(set, write, writing)?;
        }
        for file in &rules.outputs {
            let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
            set = allow(set, folder.unwrap_or(Path::new(".")), writing)?;
        }
        Ok(set.restrict_self()?.ruleset)
    };
    match lay() {
        Ok(RulesetStatus::FullyEnforced) => Ok(Fence::Whole),
        Ok(RulesetStatus::PartiallyEnforced) => Ok(Fence::Partial),
        Ok(RulesetStatus::NotEnforced) => Ok(Fence::None),
        Err(error) => Err(error.to_string()),
    }
}

#[cfg(not(target_os = "linux"))]
fn lay(_: &Rules) -> Result<Fence, String> {
    Ok(Fence::None)
}
