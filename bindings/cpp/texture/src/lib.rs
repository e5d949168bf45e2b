//! `libgranita_texture.so` provides the functions of `granita_texture.h`: textures for programs in C, and through
//! `bindings/python/granita/texture` for Python.
//!
//! A [`System`] holds a [`granita_texture::TextureCache`] with the bundled formats. The functions check their
//! arguments, and pass points with any strides to readers of the cache. No panic crosses the border: every function
//! catches it and returns a status.

#![allow(unsafe_code, reason = "the C interface is made of pointers; every block says why it is sound")]

mod data;
mod failure;
mod info;
mod lookups;
mod points;
mod statistics;
mod system;
mod types;

use failure::{Failure, guarded, guarded_or, text};
use std::ffi::{CStr, CString, c_char, c_int};
use system::System;
use types::Settings;

/// The version of the interface, `GRANITA_TEXTURE_ABI` of the header.
const ABI: c_int = 1;

/// The version of the library.
const VERSION: &CStr = match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
    Ok(version) => version,
    Err(_) => c"",
};

/// Implements `granita_texture_version`.
#[unsafe(no_mangle)]
pub extern "C" fn granita_texture_version() -> *const c_char {
    VERSION.as_ptr()
}

/// Implements `granita_texture_abi`.
#[unsafe(no_mangle)]
pub extern "C" fn granita_texture_abi() -> c_int {
    ABI
}

/// Implements `granita_texture_create`.
///
/// # Safety
/// `settings` must be NULL or point to settings whose texts are NULL or strings.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn granita_texture_create(settings: *const Settings) -> *mut System {
    guarded_or(std::ptr::null_mut(), || {
        // SAFETY: the settings exist or are NULL, by the contract.
        let settings = unsafe { settings.as_ref() }.copied().unwrap_or_default();
        if settings.abi != ABI {
            return Err(Failure::Misuse(format!(
                "the settings are of version {}, and this library takes {ABI}",
                settings.abi
            )));
        }
        // SAFETY: the texts are strings or NULL, by the contract.
        let (search, plugins) = unsafe { (text(settings.search_path), text(settings.plugin_path)) };
        let system = System::new(&settings, search.as_deref(), plugins.as_deref())?;
        Ok(Box::into_raw(Box::new(system)))
    })
}

/// Implements `granita_texture_destroy`.
///
/// # Safety
/// `system` must be NULL or a system that no other call uses now or later.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn granita_texture_destroy(system: *mut System) {
    guarded_or((), || {
        if !system.is_null() {
            // SAFETY: it is a box of `granita_texture_create` that no other call uses, by the contract.
            drop(unsafe { Box::from_raw(system) });
        }
        Ok(())
    });
}

/// Implements `granita_texture_error`.
#[unsafe(no_mangle)]
pub extern "C" fn granita_texture_error() -> *const c_char {
    failure::last()
}

/// Implements `granita_texture_messages`.
///
/// # Safety
/// `system` must be NULL or a system.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn granita_texture_messages(system: *const System) -> *mut c_char {
    guarded_or(std::ptr::null_mut(), || {
        // SAFETY: it is a system or NULL, by the contract.
        let system = unsafe { System::of(system) }?;
        Ok(system.take_messages().map_or(std::ptr::null_mut(), |text| owned(&text)))
    })
}

/// Implements `granita_texture_free`.
///
/// # Safety
/// `text` must be NULL or a text that a function of this library returned for this purpose.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn granita_texture_free(text: *mut c_char) {
    guarded_or((), || {
        if !text.is_null() {
            // SAFETY: `owned` made it, by the contract.
            drop(unsafe { CString::from_raw(text) });
        }
        Ok(())
    });
}

/// Implements `granita_texture_set_threads`.
///
/// # Safety
/// `system` must be NULL or a system.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn granita_texture_set_threads(system: *const System, threads: c_int) -> c_int {
    guarded(|| {
        // SAFETY: it is a system or NULL, by the contract.
        unsafe { System::of(system) }?.set_threads(threads)
    })
}

/// Implements `granita_texture_invalidate`.
///
/// # Safety
/// `system` must be NULL or a system. `name` must be NULL or a string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn granita_texture_invalidate(system: *const System, name: *const c_char) -> c_int {
    guarded(|| {
        // SAFETY: they are a system and a string, or NULL, by the contract.
        let (system, name) = unsafe { (System::of(system)?, text(name)) };
        system.invalidate(name.as_deref());
        Ok(())
    })
}

/// Implements `granita_texture_open`.
///
/// # Safety
/// `system` must be NULL or a system. `name` must be NULL or a string.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn granita_texture_open(system: *const System, name: *const c_char) -> u32 {
    guarded_or(0, || {
        // SAFETY: they are a system and a string, or NULL, by the contract.
        let (system, name) = unsafe { (System::of(system)?, text(name)) };
        system.open(&name.ok_or_else(|| Failure::Misuse("no texture is named (NULL)".to_owned()))?)
    })
}

/// Returns a text of the heap, which `granita_texture_free` frees.
fn owned(text: &str) -> *mut c_char {
    failure::c_string(text).into_raw()
}
