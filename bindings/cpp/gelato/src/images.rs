//! Implements `MakeImageOutput`, `MakeImageInput` and `ImageIOErrorMessage`.

use crate::string;
use granita_base::{Reporter, SearchPath};
use granita_plugin::{PluginRules, Plugins};
use std::cell::RefCell;
use std::ffi::{CString, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};

thread_local! {
    /// The message of the last of these calls that failed in this thread.
    static ERROR: RefCell<CString> = RefCell::default();
}

/// Returns the plugins on a path of the caller, which may have relative folders.
fn plugins(path: &str) -> Plugins {
    let environment = std::env::vars_os().collect();
    let own = SearchPath::parse(&path.replace(';', ":"), &SearchPath::default(), &environment);
    let rules = PluginRules { named: own.folders().to_vec(), ..PluginRules::default() };
    let plugins = Plugins::new(Reporter::silent(), rules);
    if path.is_empty() {
        plugins.set_image_path(SearchPath::parse("$GELATOHOME/lib", &SearchPath::default(), &environment));
    }
    plugins
}

fn made(f: impl FnOnce() -> Result<*mut c_void, String>) -> *mut c_void {
    let what = match catch_unwind(AssertUnwindSafe(f)) {
        Ok(Ok(object)) => return object,
        Ok(Err(what)) => what,
        Err(_) => "the image cannot be made".to_owned(),
    };
    ERROR.set(CString::new(what.replace('\0', " ")).unwrap_or_default());
    std::ptr::null_mut()
}

/// Implements `gelato_make_image_output` of `gelato_c.h`.
///
/// # Safety
/// The arguments must be NULL or strings.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn gelato_make_image_output(
    file: *const c_char,
    format: *const c_char,
    path: *const c_char,
) -> *mut c_void {
    // SAFETY: the arguments are strings or NULL, by the contract.
    let (file, format, path) = unsafe { (string(file), string(format), string(path)) };
    made(|| plugins(&path).make_image_output(&file, Some(&format)))
}

/// Implements `gelato_make_image_input` of `gelato_c.h`.
///
/// # Safety
/// The arguments must be NULL or strings.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn gelato_make_image_input(
    file: *const c_char,
    path: *const c_char,
) -> *mut c_void {
    // SAFETY: the arguments are strings or NULL, by the contract.
    let (file, path) = unsafe { (string(file), string(path)) };
    made(|| plugins(&path).make_image_input(&file))
}

/// Implements `gelato_image_error` of `gelato_c.h`. The result is valid until the next of these calls in this thread.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn gelato_image_error() -> *const c_char {
    // The string is on the heap, and stays there until it is replaced.
    ERROR.with_borrow(|text| text.as_ptr())
}
