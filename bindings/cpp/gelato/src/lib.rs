//! `libgelato.so` provides the functions that the C++ headers of `bindings/cpp/include` need from a library.
//!
//! The classes in the headers are thin and inline. All calls cross the C interface of `gelato_c.h`. Every renderer has
//! its own [`granita_session::Session`]. Two renderers in one process share only loaded plugins.

#![allow(unsafe_code, reason = "the C interface is made of pointers; every block says why it is sound")]

mod images;
mod live;
mod remote;

use granita_base::{Location, Param, Reporter, Severity};
use granita_plugin::{Archiving, ErrorManager, Errors, Interface, InterfaceHost, InterfaceObject, Messages};
use granita_pyg::Writer;
use granita_scene::{Call, SceneSink, Stop};
use std::borrow::Cow;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

/// Returns a string of the caller; empty for NULL.
///
/// # Safety
/// `text` must be NULL or end with 0, and must not change while the result lives.
unsafe fn string<'a>(text: *const c_char) -> Cow<'a, str> {
    if text.is_null() {
        return Cow::Borrowed("");
    }
    // SAFETY: the pointer is not NULL, and the string ends with 0 by the contract above.
    unsafe { CStr::from_ptr(text) }.to_string_lossy()
}

/// Implements `gelato_create_errors` of `gelato_c.h`.
#[unsafe(no_mangle)]
pub extern "C" fn gelato_create_errors(handler: *mut c_void, verbosity: c_int) -> *mut Errors {
    let verbosity = u8::try_from(verbosity.clamp(0, 2)).unwrap_or(1);
    // Its head is its first field. It is freed through its table.
    Box::into_raw(Box::new(ErrorManager::with_handler(handler, verbosity))).cast()
}

/// Implements `gelato_create_renderer` of `gelato_c.h`.
///
/// # Safety
/// `kind` must be NULL or a string. `errors` must be NULL or come from [`gelato_create_errors`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gelato_create_renderer(kind: *const c_char, errors: *mut Errors) -> *mut c_void {
    // SAFETY: `kind` is a string or NULL, by the contract.
    let kind = unsafe { string(kind) };
    // SAFETY: `errors` is a manager or NULL, by the contract. A program ends its renderers before their manager.
    let reporter = unsafe { ErrorManager::from_errors(errors) }.map(|manager| manager.reporter().clone());
    let manager = match reporter {
        Some(reporter) => Messages::Program(errors, reporter),
        None => Messages::Own(Arc::new(ErrorManager::with_handler(std::ptr::null_mut(), 1))),
    };
    let made = catch_unwind(AssertUnwindSafe(|| renderer(&kind, &manager)));
    match made {
        Ok(Ok(renderer)) => renderer,
        Ok(Err(what)) => {
            manager.reporter().error(format!("CreateRenderer (\"{kind}\"): {what}"));
            std::ptr::null_mut()
        }
        Err(_) => std::ptr::null_mut(),
    }
}

/// Returns a renderer of a kind (reference 2.3).
fn renderer(kind: &str, manager: &Messages) -> Result<*mut c_void, String> {
    let kind = kind.trim();
    let reporter = manager.reporter();
    let archive = match kind.strip_prefix("pyg") {
        Some("") => Some(String::new()),
        Some(rest) if rest.starts_with(char::is_whitespace) => Some(rest.trim().to_owned()),
        _ if kind.ends_with(".pyg") => Some(kind.to_owned()),
        _ => None,
    };
    let object = match (kind, archive) {
        (_, Some(file)) => {
            let out: Box<dyn Write> = if file.is_empty() {
                Box::new(std::io::stdout())
            } else {
                Box::new(BufWriter::new(File::create(&file).map_err(|e| format!("{file}: {e}"))?))
            };
            let sink = Archive { writer: Some(Writer::new(out)), reporter: reporter.clone() };
            object(Box::new(sink), Box::new(Archiving), manager, None)
        }
        ("", None) => live::renderer(manager),
        ("remote", None) => remote::renderer(manager)?,
        _ => {
            return Err(
                "there is no renderer of this type (known: none, \"pyg\", \"pyg FILE\", \"FILE.pyg\", \
                        \"remote\")"
                    .to_owned(),
            );
        }
    };
    object.into_renderer().ok_or_else(|| "there is not enough memory".to_owned())
}

/// Returns an object whose calls from C++ go to `sink`.
fn object(
    sink: Box<dyn SceneSink>,
    host: Box<dyn InterfaceHost>,
    manager: &Messages,
    meanwhile: Option<Arc<dyn granita_plugin::Meanwhile>>,
) -> InterfaceObject<'static> {
    InterfaceObject::new(Interface::new(sink, host, manager.clone(), Location::default()), meanwhile)
}

/// Implements `gelato_noise` of `gelato_c.h`.
///
/// # Safety
/// The contract is that of [`granita_plugin::noise`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gelato_noise(
    kind: c_int,
    indim: c_int,
    x: *const f32,
    period: *const f32,
    outdim: c_int,
    out: *mut f32,
) {
    // SAFETY: the contract is the same.
    unsafe { granita_plugin::noise(kind, indim, x, period, outdim, out) }
}

/// A sink that writes calls as Pyg. It completes the file when it is dropped.
struct Archive {
    writer: Option<Writer<Box<dyn Write>>>,
    reporter: Reporter,
}

impl SceneSink for Archive {
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
        match &mut self.writer {
            Some(writer) => writer.call(call, at),
            None => Ok(()),
        }
    }

    fn attribute(&self, declaration: &str) -> Option<Param> {
        self.writer.as_ref()?.attribute(declaration)
    }
}

impl Drop for Archive {
    fn drop(&mut self) {
        let end = self.writer.take().map(Writer::into_inner);
        if let Some(Err(error)) = end.map(|out| out.and_then(|mut out| out.flush())) {
            self.reporter.say(Severity::Error, &Location::default(), format!("the archive: {error}"));
        }
    }
}
