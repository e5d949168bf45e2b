//! `MakeImageOutput`, `MakeImageInput` and `ImageIOErrorMessage`.

use crate::string;
use granita_base::{Reporter, SearchPath};
use granita_plugin::{PluginRules, Plugins};
use std::cell::RefCell;
use std::ffi::{CString, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};

thread_local! {
    /// Why the last of these calls in this thread failed.
    static ERROR: RefCell<CString> = RefCell::default();
}

/// The plugins along a path of the caller, who may name relative folders.
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

/// See `gelato_c.h`.
///
/// # Safety
/// The arguments are NULL or strings.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn gelato_make_image_output(
    file: *const c_char,
    format: *const c_char,
    path: *const c_char,
) -> *mut c_void {
    // SAFETY: strings or NULL, by the contract.
    let (file, format, path) = unsafe { (string(file), string(format), string(path)) };
    made(|| plugins(&path).make_image_output(&file, Some(&format)))
}

/// See `gelato_c.h`.
///
/// # Safety
/// The arguments are NULL or strings.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn gelato_make_image_input(
    file: *const c_char,
    path: *const c_char,
) -> *mut c_void {
    // SAFETY: strings or NULL, by the contract.
    let (file, path) = unsafe { (string(file), string(path)) };
    made(|| plugins(&path).make_image_input(&file))
}

/// See `gelato_c.h`. Valid until the next of these calls in this thread.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn gelato_image_error() -> *const c_char {
    // The string lies on the heap, and stays until it is replaced.
    ERROR.with_borrow(|text| text.as_ptr())
}
