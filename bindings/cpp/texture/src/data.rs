//! The functions of the interface that return data about textures.

use crate::failure::{Failure, guarded, guarded_or, text};
use crate::info::{Info, Metadatum};
use crate::owned;
use crate::system::System;
use std::ffi::{c_char, c_int};

/// Implements `granita_texture_get_info`.
///
/// # Safety
/// `system` must be NULL or a system. `info` must be NULL or point to space.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn granita_texture_get_info(
    system: *const System,
    texture: u32,
    info: *mut Info,
) -> c_int {
    guarded(|| {
        // SAFETY: it is a system or NULL, by the contract.
        let described = unsafe { System::of(system) }?.described(texture)?;
        if info.is_null() {
            return Err(Failure::Misuse("there is no space for data (NULL)".to_owned()));
        }
        // SAFETY: there is space by the contract.
        unsafe { info.write(described.info) };
        Ok(())
    })
}

/// Implements `granita_texture_get_metadatum`.
///
/// # Safety
/// `system` must be NULL or a system, `name` NULL or a string, and `datum` NULL or point to space.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn granita_texture_get_metadatum(
    system: *const System,
    texture: u32,
    name: *const c_char,
    index: usize,
    datum: *mut Metadatum,
) -> c_int {
    guarded(|| {
        // SAFETY: they are a system and a string, or NULL, by the contract.
        let (system, name) = unsafe { (System::of(system)?, text(name)) };
        let found = system.described(texture)?.metadatum(name.as_deref(), index);
        let found = found.ok_or_else(|| {
            Failure::Absent(match &name {
                Some(name) => format!("the texture has no metadatum \"{name}\""),
                None => format!("the texture has no metadatum {index}"),
            })
        })?;
        if datum.is_null() {
            return Err(Failure::Misuse("there is no space for the metadatum (NULL)".to_owned()));
        }
        // SAFETY: there is space by the contract.
        unsafe { datum.write(found) };
        Ok(())
    })
}

/// Implements `granita_texture_info_json`.
///
/// # Safety
/// `system` must be NULL or a system.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn granita_texture_info_json(
    system: *const System,
    texture: u32,
) -> *mut c_char {
    guarded_or(std::ptr::null_mut(), || {
        // SAFETY: it is a system or NULL, by the contract.
        let described = unsafe { System::of(system) }?.described(texture)?;
        Ok(owned(&described.json))
    })
}
