//! A generator in Rust, against the C interface of `gelato_c.h`: `Input ("steps 12")` makes a stair of boxes' tops.
//!
//!     rustc --edition 2024 --crate-type cdylib -C panic=abort -o steps.generator.so steps.rs

use std::ffi::{CStr, CString, c_char, c_int, c_uint, c_void};

/// The part of `gelato_calls` that is used here. The functions before it must be declared too.
#[repr(C)]
pub struct Calls {
    abi: c_int,
    words: extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char, *const c_char, *const c_char),
    numbers: extern "C" fn(*mut c_void, c_int, c_int, *const f32, *const c_char),
    value: extern "C" fn(*mut c_void, c_int, *const c_char, c_uint, c_int, *const c_void),
    get_attribute: extern "C" fn(*mut c_void, *const c_char, c_int, *mut c_void) -> c_int,
    light_switch: extern "C" fn(*mut c_void, *const c_char, c_int),
    points: extern "C" fn(*mut c_void, c_int),
    curves: extern "C" fn(*mut c_void, *const c_char, c_int, c_int),
    nurbs_curves: extern "C" fn(*mut c_void, c_int, *const c_void),
    patch: extern "C" fn(*mut c_void, *const c_char, c_int, c_int),
}

#[repr(C)]
pub struct Generator {
    abi: c_int,
    extensions: *const *const c_char,
    bound: Option<extern "C" fn(*const c_char, *mut f32) -> c_int>,
    run: extern "C" fn(*const Calls, *mut c_void, *const c_char, *mut c_char, usize) -> c_int,
}

// SAFETY: the table never changes.
unsafe impl Sync for Generator {}

/// `GELATO_C_ABI`.
#[unsafe(no_mangle)]
pub static generator_abi: c_int = 2;

static STEPS: Generator = Generator { abi: 2, extensions: std::ptr::null(), bound: None, run };

/// The description of `steps.generator.so`.
#[unsafe(no_mangle)]
pub extern "C" fn steps_generator_c() -> *const Generator {
    &raw const STEPS
}

/// `GELATO_FLOATS`, and the call `Parameter`.
const FLOATS: c_int = 6;
const PARAMETER: c_int = 0;

extern "C" fn run(
    calls: *const Calls,
    this: *mut c_void,
    params: *const c_char,
    message: *mut c_char,
    size: usize,
) -> c_int {
    // SAFETY: the suite passes a table of the version above, a string, and room for a message.
    let (calls, params) = unsafe { (&*calls, CStr::from_ptr(params)) };
    let Ok(n) = params.to_string_lossy().trim().parse::<u16>() else {
        let text = CString::new("steps: how many? as in \"steps 12\"").unwrap_or_default();
        let bytes = text.as_bytes_with_nul();
        if bytes.len() <= size {
            // SAFETY: the buffer is large enough.
            unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr().cast(), message, bytes.len()) };
        }
        return 1;
    };
    for i in 0..n {
        let (y, z) = (f32::from(i) * 0.2, f32::from(i) * 0.4);
        let p = [-1.0f32, y, z, 1.0, y, z, -1.0, y, z + 0.4, 1.0, y, z + 0.4];
        (calls.value)(this, PARAMETER, c"vertex point P".as_ptr(), 0, FLOATS, p.as_ptr().cast());
        (calls.patch)(this, c"linear".as_ptr(), 2, 2);
    }
    0
}
