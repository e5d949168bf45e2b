//! The statistics of a system by name, as text and as JSON.

use crate::failure::{Failure, guarded, guarded_or, text};
use crate::owned;
use crate::system::System;
use granita_texture::CacheStatistics;
use serde_json::{Map, Value};
use std::ffi::{c_char, c_int};

/// A count: its name, its description, and its value.
type Count = (&'static str, &'static str, fn(&CacheStatistics) -> u64);

/// All counts, in the order of the text.
const COUNTS: [Count; 12] = [
    ("lookups", "lookups", |s| s.lookups),
    ("probes", "filter probes", |s| s.probes),
    ("tile_requests", "tiles that threads requested from the cache", |s| s.tile_requests),
    ("tiles_read", "tiles read", |s| s.tiles_read),
    ("tile_bytes", "bytes of these tiles", |s| s.tile_bytes),
    ("peak_bytes", "largest number of bytes of tiles held at once", |s| s.peak_bytes),
    ("files", "files in use", |s| s.files),
    ("files_opened", "files opened, also again", |s| s.files_opened),
    ("peak_files_open", "largest number of files open at once", |s| s.peak_files_open),
    ("automipmaps", "files whose levels were made in memory", |s| s.automipmaps),
    ("automipmap_bytes", "bytes of these levels", |s| s.automipmap_bytes),
    ("missing", "names that could not be used", |s| s.missing),
];

/// Implements `granita_texture_get_statistic`.
///
/// # Safety
/// `system` must be NULL or a system, `name` NULL or a string, and `value` NULL or point to space.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn granita_texture_get_statistic(
    system: *const System,
    name: *const c_char,
    value: *mut u64,
) -> c_int {
    guarded(|| {
        // SAFETY: they are a system and a string, or NULL, by the contract.
        let (system, name) = unsafe { (System::of(system)?, text(name).unwrap_or_default()) };
        let Some((_, _, of)) = COUNTS.iter().find(|(own, ..)| *own == name) else {
            let known: Vec<&str> = COUNTS.iter().map(|(own, ..)| *own).collect();
            let what = format!("there is no statistic \"{name}\" (known: {})", known.join(", "));
            return Err(Failure::Absent(what));
        };
        if value.is_null() {
            return Err(Failure::Misuse("there is no space for the statistic (NULL)".to_owned()));
        }
        // SAFETY: there is space by the contract.
        unsafe { value.write(of(&system.with_cache(|cache| cache.statistics()))) };
        Ok(())
    })
}

/// Implements `granita_texture_statistics_text`.
///
/// # Safety
/// `system` must be NULL or a system.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn granita_texture_statistics_text(system: *const System) -> *mut c_char {
    guarded_or(std::ptr::null_mut(), || {
        // SAFETY: it is a system or NULL, by the contract.
        let counts = unsafe { System::of(system) }?.with_cache(|cache| cache.statistics());
        let line = |(_, what, of): &Count| format!("{what}: {}\n", of(&counts));
        Ok(owned(&COUNTS.iter().map(line).collect::<String>()))
    })
}

/// Implements `granita_texture_statistics_json`.
///
/// # Safety
/// `system` must be NULL or a system.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn granita_texture_statistics_json(system: *const System) -> *mut c_char {
    guarded_or(std::ptr::null_mut(), || {
        // SAFETY: it is a system or NULL, by the contract.
        let counts = unsafe { System::of(system) }?.with_cache(|cache| cache.statistics());
        let pair = |(name, _, of): &Count| ((*name).to_owned(), Value::from(of(&counts)));
        Ok(owned(&Value::Object(COUNTS.iter().map(pair).collect::<Map<_, _>>()).to_string()))
    })
}
