//! The `ErrorManager` of C++, which is a [`Reporter`] behind the table of `gelato_c.h`.

use crate::ffi::{self, ABI, Errors, ErrorsCalls, Text};
use granita_base::report::{Message, VERBOSITY_INFO};
use granita_base::{Reporter, Severity};
use std::cell::Cell;
use std::ffi::{CString, c_char, c_int, c_void};
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicPtr, Ordering};

/// The target of a C++ `ErrorManager *`.
#[repr(C)]
pub struct ErrorManager {
    head: Errors,
    reporter: Reporter,
    /// The `ErrorHandler`; null for standard error.
    handler: Arc<AtomicPtr<c_void>>,
    /// True when the reporter was made for the handler.
    own: bool,
}

thread_local! {
    /// True while this thread is in a handler. Its messages then go to standard error, because the handler is busy.
    static HANDLING: Cell<bool> = const { Cell::new(false) };
}

// SAFETY: a reporter may be used from any thread, the table never changes, and the handler is an atomic pointer to an
// object that, by its interface, takes messages from any thread.
unsafe impl Send for ErrorManager {}
// SAFETY: as above.
unsafe impl Sync for ErrorManager {}

impl std::fmt::Debug for ErrorManager {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "ErrorManager({:?})", self.reporter)
    }
}

static CALLS: ErrorsCalls =
    ErrorsCalls { abi: ABI, say, verbosity, set_verbosity, handler, set_handler, summary, finish, release };

impl ErrorManager {
    /// Returns a manager that passes messages to `reporter`.
    pub fn over(reporter: Reporter) -> Self {
        let handler = Arc::default();
        Self { head: Errors { calls: &raw const CALLS }, reporter, handler, own: false }
    }

    /// Returns a manager with a C++ `ErrorHandler`, or with null for standard error.
    pub fn with_handler(handler: *mut c_void, verbosity: u8) -> Self {
        let handler = Arc::new(AtomicPtr::new(handler));
        let kept = handler.clone();
        let reporter = Reporter::new(Box::new(move |message| hand(kept.load(Ordering::Acquire), message)));
        reporter.set_verbosity(verbosity.min(VERBOSITY_INFO));
        Self { head: Errors { calls: &raw const CALLS }, reporter, handler, own: true }
    }

    /// Returns the receiver of its messages.
    pub fn reporter(&self) -> &Reporter {
        &self.reporter
    }

    /// Returns the pointer for C++.
    pub fn as_errors(&self) -> *mut Errors {
        (&raw const self.head).cast_mut()
    }

    /// Converts a C++ `ErrorManager *`; `None` for null and for one of another version.
    ///
    /// # Safety
    /// `errors` is null, or was made by this library or another copy of it, and lives as long as the result.
    pub unsafe fn from_errors<'a>(errors: *const Errors) -> Option<&'a Self> {
        // SAFETY: by the contract, it is null or points to a live manager, whose table is static.
        let same = unsafe { errors.as_ref().is_some_and(|e| e.calls == &raw const CALLS) };
        // SAFETY: it has this library's table, so it was made here, and its head is the first field.
        same.then(|| unsafe { &*errors.cast::<Self>() })
    }
}

/// The owner of the messages of an interface.
#[derive(Clone, Debug)]
pub enum Messages {
    /// A manager that the program made and ends after its renderers, and the receiver of its messages.
    Program(*mut Errors, Reporter),
    /// A manager that lives as long as it is needed.
    Own(Arc<ErrorManager>),
}

// SAFETY: the manager behind the pointer may be used from any thread, as `ErrorManager` may.
unsafe impl Send for Messages {}
// SAFETY: as above.
unsafe impl Sync for Messages {}

impl Messages {
    /// Returns the receiver of the messages.
    pub fn reporter(&self) -> &Reporter {
        match self {
            Self::Program(_, reporter) => reporter,
            Self::Own(manager) => manager.reporter(),
        }
    }

    /// Returns the `ErrorManager` for C++.
    pub(crate) fn as_errors(&self) -> *mut Errors {
        match self {
            Self::Program(errors, _) => *errors,
            Self::Own(manager) => manager.as_errors(),
        }
    }
}

/// Passes a message to a handler, or to standard error after the word for its severity.
fn hand(handler: *mut c_void, message: &Message) {
    let plain = Message { severity: Severity::Message, ..message.clone() };
    let mut text = String::new();
    if message.at.is_known() && message.severity != Severity::Message {
        text = format!("{}: ", message.at);
    }
    text += &plain.to_string();
    if handler.is_null() {
        let prefix = match message.severity {
            Severity::Message => "",
            Severity::Info => "INFO: ",
            Severity::Warning => "WARNING: ",
            Severity::Error => "ERROR: ",
            Severity::Severe => "SEVERE ERROR: ",
        };
        // An error here cannot be reported.
        let _ = writeln!(std::io::stderr(), "{prefix}{text}");
        return;
    }
    let text = CString::new(text.replace('\0', " ")).unwrap_or_default();
    let mut why = Text::new();
    HANDLING.set(true);
    // SAFETY: the handler is the program's own ErrorHandler, which outlives its manager. The shim catches exceptions.
    let status =
        unsafe { ffi::gelato_shim_handle(handler, message.severity.code(), text.as_ptr(), why.room()) };
    HANDLING.set(false);
    if status == ffi::THREW {
        let why = why.get().unwrap_or_default();
        let _ = writeln!(std::io::stderr(), "ERROR: an error handler threw an exception: {why}");
    }
}

/// Runs `f` with the manager. Returns `nothing` for null, and after a panic, which does not cross the boundary.
fn with<T>(errors: *const Errors, nothing: T, f: impl FnOnce(&ErrorManager) -> T) -> T {
    // SAFETY: the table is called with the manager that it belongs to.
    let Some(manager) = (unsafe { ErrorManager::from_errors(errors) }) else { return nothing };
    catch_unwind(AssertUnwindSafe(|| f(manager))).unwrap_or(nothing)
}

extern "C" fn say(errors: *mut Errors, code: c_int, text: *const c_char) {
    with(errors, (), |manager| {
        // SAFETY: the text is a string by the interface.
        let text = unsafe { ffi::text(text) }.unwrap_or_default();
        if HANDLING.get() {
            let _ = writeln!(std::io::stderr(), "{text}");
            return;
        }
        manager.reporter.say(Severity::from_code(code), &Default::default(), text);
    });
}

extern "C" fn verbosity(errors: *const Errors) -> c_int {
    with(errors, 1, |manager| c_int::from(manager.reporter.verbosity()))
}

extern "C" fn set_verbosity(errors: *mut Errors, verbosity: c_int) {
    with(errors, (), |manager| {
        manager.reporter.set_verbosity(u8::try_from(verbosity.clamp(0, 2)).unwrap_or(1))
    });
}

extern "C" fn handler(errors: *const Errors) -> *mut c_void {
    with(errors, std::ptr::null_mut(), |manager| manager.handler.load(Ordering::Acquire))
}

extern "C" fn set_handler(errors: *mut Errors, handler: *mut c_void) {
    with(errors, (), |manager| {
        manager.handler.store(handler, Ordering::Release);
        if manager.own || HANDLING.get() {
            return;
        }
        let kept = manager.handler.clone();
        drop(manager.reporter.set_sink(Box::new(move |message| hand(kept.load(Ordering::Acquire), message))));
    });
}

extern "C" fn summary(errors: *mut Errors) -> *mut c_char {
    with(errors, std::ptr::null_mut(), |manager| {
        let text = manager.reporter.summary().unwrap_or_default();
        // SAFETY: the memory has room for the text and its end, and is filled exactly.
        unsafe {
            let room = malloc(text.len() + 1).cast::<u8>();
            if !room.is_null() {
                std::ptr::copy_nonoverlapping(text.as_ptr(), room, text.len());
                *room.add(text.len()) = 0;
            }
            room.cast()
        }
    })
}

unsafe extern "C" {
    /// Allocates memory. The caller of `Summary` frees it with C's own `free`.
    fn malloc(size: usize) -> *mut c_void;
}

extern "C" fn finish(_: *mut Errors) {}

extern "C" fn release(errors: *mut Errors) {
    // SAFETY: the table is called with the manager that it belongs to.
    if unsafe { ErrorManager::from_errors(errors) }.is_some() {
        // SAFETY: managers that C++ may delete were made by `Box::into_raw`, and it deletes them once.
        let manager = unsafe { Box::from_raw(errors.cast::<ErrorManager>()) };
        let _ = catch_unwind(AssertUnwindSafe(|| drop(manager)));
    }
}
