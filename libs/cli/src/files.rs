//! The limit of open files of the process.

/// The largest value to which the limit is raised. On systems without a limit, programs that a scene starts would
/// otherwise examine a thousand million file descriptors.
#[cfg(unix)]
const MOST: u64 = 1 << 16;

/// Raises the soft limit of open files to the hard one. Where the system refuses, the limit stays as it is.
#[cfg(unix)]
pub(crate) fn raise_limit() {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let limit = getrlimit(Resource::Nofile);
    let most = limit.maximum.unwrap_or(MOST).min(MOST);
    if limit.current.is_some_and(|now| now < most) {
        // macOS has its own limit below the reported one. The call is not repeated.
        let _ = setrlimit(Resource::Nofile, Rlimit { current: Some(most), ..limit });
    }
}

/// Does nothing, because there is no such limit.
#[cfg(not(unix))]
pub(crate) fn raise_limit() {}

/// The number of files that the process may have open at once. `None` where the system has no such limit.
#[cfg(unix)]
pub fn open_files_limit() -> Option<usize> {
    let limit = rustix::process::getrlimit(rustix::process::Resource::Nofile).current?;
    Some(usize::try_from(limit).unwrap_or(usize::MAX))
}

/// The number of files that the process may have open at once. `None` where the system has no such limit.
#[cfg(not(unix))]
pub fn open_files_limit() -> Option<usize> {
    None
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use rustix::process::{Resource, getrlimit};

    #[test]
    fn the_soft_limit_of_open_files_is_raised_to_the_hard_one() {
        raise_limit();
        let hard = getrlimit(Resource::Nofile).maximum.unwrap_or(MOST).min(MOST);
        assert!(open_files_limit().unwrap() as u64 >= hard);
    }
}
