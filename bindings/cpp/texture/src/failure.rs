//! Failures of functions: their status, and the text of the last one of each thread.

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char, c_int};
use std::panic::{AssertUnwindSafe, catch_unwind};

thread_local! {
    /// The text of the last failure in this thread.
    static LAST: RefCell<CString> = RefCell::default();
}

/// The reason why a function has no result.
#[derive(Debug)]
pub(crate) enum Failure {
    /// An argument is not valid.
    Misuse(String),
    /// The texture cannot be used.
    Unusable(String),
    /// There is no datum of this name.
    Absent(String),
}

impl Failure {
    /// Returns its `granita_texture_status`.
    fn status(&self) -> c_int {
        match self {
            Self::Misuse(_) => 1,
            Self::Unusable(_) => 2,
            Self::Absent(_) => 3,
        }
    }

    fn text(&self) -> &str {
        match self {
            Self::Misuse(text) | Self::Unusable(text) | Self::Absent(text) => text,
        }
    }
}

/// The status after a panic.
const INTERNAL: c_int = 4;

/// Returns the text as a string of C.
pub(crate) fn c_string(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).unwrap_or_default()
}

/// Returns the text of the last failure in this thread. It is on the heap, and stays there until the next failure.
pub(crate) fn last() -> *const c_char {
    LAST.with_borrow(|text| text.as_ptr())
}

/// Runs a function of the interface. Returns its result, or its status with the text of the failure stored.
fn run<T>(f: impl FnOnce() -> Result<T, Failure>) -> Result<T, c_int> {
    let (status, text) = match catch_unwind(AssertUnwindSafe(f)) {
        Ok(Ok(result)) => return Ok(result),
        Ok(Err(failure)) => (failure.status(), failure.text().to_owned()),
        Err(panic) => {
            let told = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
            let told = told.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
            (INTERNAL, format!("a defect of the texture library: {told}"))
        }
    };
    LAST.set(c_string(&text));
    Err(status)
}

/// Runs a function that returns a status.
pub(crate) fn guarded(f: impl FnOnce() -> Result<(), Failure>) -> c_int {
    run(f).err().unwrap_or(0)
}

/// Runs a function that returns `otherwise` after a failure.
pub(crate) fn guarded_or<T>(otherwise: T, f: impl FnOnce() -> Result<T, Failure>) -> T {
    run(f).unwrap_or(otherwise)
}

/// Returns a string of the caller; `None` for NULL.
///
/// # Safety
/// `text` must be NULL or end with 0.
pub(crate) unsafe fn text(text: *const c_char) -> Option<String> {
    // SAFETY: the pointer is not NULL here, and the string ends with 0 by the contract.
    (!text.is_null()).then(|| unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned())
}

#[cfg(test)]
#[allow(clippy::panic, reason = "a panic is tested")]
mod tests {
    use super::*;

    #[test]
    fn a_panic_becomes_a_status_with_a_text() {
        assert_eq!(guarded(|| Ok(())), 0);
        assert_eq!(guarded(|| Err(Failure::Absent("no such datum".to_owned()))), 3);
        // SAFETY: the text is that of this thread, and ends with 0.
        let told = || unsafe { text(last()) }.unwrap_or_default();
        assert_eq!(told(), "no such datum");
        assert_eq!(guarded(|| panic!("of a test")), INTERNAL);
        assert_eq!(told(), "a defect of the texture library: of a test");
        assert_eq!(guarded_or(7, || Err(Failure::Misuse("a\0b".to_owned()))), 7);
        assert_eq!(told(), "a b");
        // Another thread has its own text.
        std::thread::scope(|scope| {
            // SAFETY: as above.
            scope.spawn(|| assert_eq!(unsafe { text(last()) }.as_deref(), Some("")));
        });
    }
}
