//! The structs of `granita_texture.h` that callers fill.

use std::ffi::{c_char, c_int};
use std::ptr::null;

/// The type `granita_texture_settings`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Settings {
    pub(crate) abi: c_int,
    pub(crate) threads: c_int,
    pub(crate) memory: u64,
    pub(crate) files: c_int,
    pub(crate) no_automipmap: c_int,
    pub(crate) search_path: *const c_char,
    pub(crate) plugin_path: *const c_char,
}

impl Default for Settings {
    /// Returns the settings for NULL.
    fn default() -> Self {
        Self {
            abi: super::ABI,
            threads: 0,
            memory: 0,
            files: 0,
            no_automipmap: 0,
            search_path: null(),
            plugin_path: null(),
        }
    }
}

/// The type `granita_texture_floats`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Floats {
    data: *const f32,
    step: isize,
    row_step: isize,
}

/// The type `granita_texture_vectors`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Vectors {
    data: *const f32,
    step: isize,
    row_step: isize,
    component_step: isize,
}

/// The position of a point: its column and row.
pub(crate) type At = (isize, isize);

impl Floats {
    /// True when the caller passed numbers.
    pub(crate) fn is_given(&self) -> bool {
        !self.data.is_null()
    }

    /// Returns the number of a point, or `default` for NULL.
    ///
    /// # Safety
    /// The data must be NULL or have a number at this point.
    #[inline(always)]
    pub(crate) unsafe fn at(&self, (x, y): At, default: f32) -> f32 {
        if self.data.is_null() {
            return default;
        }
        // SAFETY: there is a number by the contract. Its address may have any alignment.
        unsafe { number(self.data, x * self.step + y * self.row_step) }
    }
}

impl Vectors {
    /// True when the caller passed vectors.
    pub(crate) fn is_given(&self) -> bool {
        !self.data.is_null()
    }

    /// Returns the vector of a point, or 0 for NULL.
    ///
    /// # Safety
    /// The data must be NULL or have a vector at this point.
    #[inline(always)]
    pub(crate) unsafe fn at(&self, (x, y): At) -> [f32; 3] {
        if self.data.is_null() {
            return [0.0; 3];
        }
        let first = x * self.step + y * self.row_step;
        // SAFETY: there are three numbers by the contract. Their addresses may have any alignment.
        [0, 1, 2].map(|c| unsafe { number(self.data, first + c * self.component_step) })
    }
}

/// Reads the number that lies so many bytes after `data`.
///
/// # Safety
/// There must be a number.
#[inline(always)]
unsafe fn number(data: *const f32, bytes: isize) -> f32 {
    // SAFETY: there is a number by the contract, and it may have any alignment.
    unsafe { data.cast::<u8>().wrapping_offset(bytes).cast::<f32>().read_unaligned() }
}

/// The type `granita_texture_points`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Points {
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    pub(crate) result: *mut f32,
    pub(crate) step: isize,
    pub(crate) row_step: isize,
    pub(crate) channel_step: isize,
    pub(crate) channels: c_int,
    pub(crate) first_channel: c_int,
    pub(crate) fill: Floats,
}

impl Points {
    /// Stores the channels of a point.
    ///
    /// # Safety
    /// The memory of the results must have all channels of this point.
    #[inline(always)]
    pub(crate) unsafe fn store(&self, (x, y): At, values: &[f32]) {
        let mut to = self.result.cast::<u8>().wrapping_offset(x * self.step + y * self.row_step);
        for value in values {
            // SAFETY: there is memory for a number by the contract. Its address may have any alignment.
            unsafe { to.cast::<f32>().write_unaligned(*value) };
            to = to.wrapping_offset(self.channel_step);
        }
    }
}

/// The type `granita_texture_lookup2d`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Lookup2d {
    pub(crate) s: Floats,
    pub(crate) t: Floats,
    pub(crate) dsdx: Floats,
    pub(crate) dtdx: Floats,
    pub(crate) dsdy: Floats,
    pub(crate) dtdy: Floats,
    pub(crate) sblur: Floats,
    pub(crate) tblur: Floats,
    pub(crate) swidth: Floats,
    pub(crate) twidth: Floats,
    pub(crate) swrap: *const c_char,
    pub(crate) twrap: *const c_char,
    pub(crate) filter: c_int,
}

/// The type `granita_texture_lookup3d`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Lookup3d {
    pub(crate) p: Vectors,
    pub(crate) dpdx: Vectors,
    pub(crate) dpdy: Vectors,
    pub(crate) sblur: Floats,
    pub(crate) tblur: Floats,
    pub(crate) swidth: Floats,
    pub(crate) twidth: Floats,
    pub(crate) swrap: *const c_char,
    pub(crate) twrap: *const c_char,
}

/// The type `granita_texture_environment`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Environment {
    pub(crate) r: Vectors,
    pub(crate) drdx: Vectors,
    pub(crate) drdy: Vectors,
    pub(crate) sblur: Floats,
    pub(crate) tblur: Floats,
    pub(crate) swidth: Floats,
    pub(crate) twidth: Floats,
    pub(crate) angle: Floats,
    pub(crate) up: *const c_char,
}

/// The type `granita_texture_shadow`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Shadow {
    pub(crate) p: Vectors,
    pub(crate) dpdx: Vectors,
    pub(crate) dpdy: Vectors,
    pub(crate) sblur: Floats,
    pub(crate) tblur: Floats,
    pub(crate) swidth: Floats,
    pub(crate) twidth: Floats,
    pub(crate) bias: Floats,
    pub(crate) samples: c_int,
    pub(crate) seed: u32,
}
