//! The kernel's own fence around a run for a scene from a stranger.

use granita_base::{Files, Rules};

/// How far the kernel keeps a process within its rules.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fence {
    /// Files outside of the rules cannot be opened, and no program can be started.
    Whole,
    /// The kernel knows a part of that only.
    Partial,
    /// The system has no such fence, or it is switched off.
    None,
}

/// Has the kernel (Linux: Landlock) hold the calling thread, and all threads that it starts from now on, to the rules of
/// `files`: for holes in our own. To be called before threads are started. Folders of files that the user named are within
/// the fence as a whole, since files come into being there. Without rules nothing happens.
///
/// # Errors
/// What the kernel says, when it has the fence and refuses it.
pub fn fence(files: &Files) -> Result<Fence, String> {
    match files.rules() {
        Some(rules) => lay(&rules),
        None => Ok(Fence::None),
    }
}

/// Files and folders that the process itself reads: how many processors there are, names of machines, libraries that
/// look those up.
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

    // The first version that knows renaming across folders and truncation.
    let abi = ABI::V3;
    let reading = AccessFs::ReadFile | AccessFs::ReadDir;
    // Nothing here makes devices, sockets or links, or removes folders.
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
        // What is not there needs no rule.
        Err(_) => Ok(set),
    };
    // Rules need something to be laid on.
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
