//! The tables and structures of `bindings/cpp/include/gelato_c.h` in Rust, field by field in the same order.

use std::ffi::{c_char, c_int, c_uint, c_void};

/// The value of `GELATO_C_ABI`.
pub(crate) const ABI: c_int = 2;

/// The structure `gelato_message`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Message {
    pub(crate) text: *mut c_char,
    pub(crate) size: usize,
}

/// The structure `gelato_errors_calls`.
#[repr(C)]
pub(crate) struct ErrorsCalls {
    pub(crate) abi: c_int,
    pub(crate) say: extern "C" fn(*mut Errors, c_int, *const c_char),
    pub(crate) verbosity: extern "C" fn(*const Errors) -> c_int,
    pub(crate) set_verbosity: extern "C" fn(*mut Errors, c_int),
    pub(crate) handler: extern "C" fn(*const Errors) -> *mut c_void,
    pub(crate) set_handler: extern "C" fn(*mut Errors, *mut c_void),
    pub(crate) summary: extern "C" fn(*mut Errors) -> *mut c_char,
    pub(crate) finish: extern "C" fn(*mut Errors),
    pub(crate) release: extern "C" fn(*mut Errors),
}

/// The structure `gelato_errors`, which is the beginning of [`crate::ErrorManager`].
#[repr(C)]
pub struct Errors {
    pub(crate) calls: *const ErrorsCalls,
}

/// The structure `gelato_knots`.
#[repr(C)]
pub(crate) struct Knots {
    pub(crate) n: c_int,
    pub(crate) order: c_int,
    pub(crate) knot: *const f32,
    pub(crate) min: f32,
    pub(crate) max: f32,
}

/// The structure `gelato_calls`.
#[repr(C)]
pub(crate) struct Calls {
    pub(crate) abi: c_int,
    pub(crate) words:
        extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char, *const c_char, *const c_char),
    pub(crate) numbers: extern "C" fn(*mut c_void, c_int, c_int, *const f32, *const c_char),
    pub(crate) value: extern "C" fn(*mut c_void, c_int, *const c_char, c_uint, c_int, *const c_void),
    pub(crate) get_attribute: extern "C" fn(*mut c_void, *const c_char, c_int, *mut c_void) -> c_int,
    pub(crate) light_switch: extern "C" fn(*mut c_void, *const c_char, c_int),
    pub(crate) points: extern "C" fn(*mut c_void, c_int),
    pub(crate) curves: extern "C" fn(*mut c_void, *const c_char, c_int, c_int),
    pub(crate) nurbs_curves: extern "C" fn(*mut c_void, c_int, *const Knots),
    pub(crate) patch: extern "C" fn(*mut c_void, *const c_char, c_int, c_int),
    pub(crate) nurbs_patch: extern "C" fn(*mut c_void, *const Knots, *const Knots),
    pub(crate) mesh: extern "C" fn(*mut c_void, *const c_char, c_int, *const c_int, *const c_int),
    pub(crate) trim_curve: extern "C" fn(
        *mut c_void,
        c_int,
        *const c_int,
        *const c_int,
        *const c_int,
        *const f32,
        *const f32,
        *const f32,
        *const f32,
    ),
    pub(crate) input_generator: extern "C" fn(*mut c_void, *mut c_void, *const f32),
    pub(crate) errors: extern "C" fn(*mut c_void) -> *mut Errors,
    pub(crate) destroy: Option<extern "C" fn(*mut c_void)>,
}

/// The structure `gelato_generator`.
#[repr(C)]
pub(crate) struct GeneratorTable {
    pub(crate) abi: c_int,
    pub(crate) extensions: *const *const c_char,
    pub(crate) bound: Option<unsafe extern "C" fn(*const c_char, *mut f32) -> c_int>,
    pub(crate) run:
        Option<unsafe extern "C" fn(*const Calls, *mut c_void, *const c_char, *mut c_char, usize) -> c_int>,
}

/// The structure `gelato_image_spec`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Spec {
    pub(crate) x: c_int,
    pub(crate) y: c_int,
    pub(crate) z: c_int,
    pub(crate) width: c_int,
    pub(crate) height: c_int,
    pub(crate) depth: c_int,
    pub(crate) full_width: c_int,
    pub(crate) full_height: c_int,
    pub(crate) full_depth: c_int,
    pub(crate) tile_width: c_int,
    pub(crate) tile_height: c_int,
    pub(crate) tile_depth: c_int,
    pub(crate) nchannels: c_int,
    pub(crate) format: c_int,
    pub(crate) channelnames: *const *const c_char,
}

/// The structure `gelato_image_parameter`.
#[repr(C)]
pub(crate) struct ImageParameter {
    pub(crate) name: *const c_char,
    pub(crate) ty: c_int,
    pub(crate) nvalues: c_int,
    pub(crate) value: *const c_void,
}

/// The bit of `gelato_image_feature` for tiles.
pub(crate) const TILES: c_int = 1;
/// The bit of `gelato_image_feature` for several images in one file.
pub(crate) const MULTIIMAGE: c_int = 4;
/// The bit of `gelato_image_feature` for rectangles.
pub(crate) const RECTANGLES: c_int = 64;

/// The `gelato_status` of success.
pub(crate) const OK: c_int = 0;
/// The `gelato_status` of an exception.
pub(crate) const THREW: c_int = 2;

/// The structure `gelato_image_output_calls`.
#[repr(C)]
pub(crate) struct OutputCalls {
    pub(crate) abi: c_int,
    pub(crate) create: unsafe extern "C" fn(*mut c_void, Message) -> *mut c_void,
    pub(crate) supports: unsafe extern "C" fn(*mut c_void) -> c_int,
    pub(crate) open: unsafe extern "C" fn(
        *mut c_void,
        *const c_char,
        *const Spec,
        c_int,
        *const ImageParameter,
        c_int,
        Message,
    ) -> c_int,
    pub(crate) write_scanline:
        unsafe extern "C" fn(*mut c_void, c_int, c_int, *const f32, c_int, Message) -> c_int,
    pub(crate) write_tile: unsafe extern "C" fn(
        *mut c_void,
        c_int,
        c_int,
        c_int,
        *const f32,
        c_int,
        c_int,
        c_int,
        Message,
    ) -> c_int,
    pub(crate) write_rectangle: Option<
        unsafe extern "C" fn(
            *mut c_void,
            c_int,
            c_int,
            c_int,
            c_int,
            *const f32,
            c_int,
            c_int,
            Message,
        ) -> c_int,
    >,
    pub(crate) close: unsafe extern "C" fn(*mut c_void, Message) -> c_int,
    pub(crate) destroy: unsafe extern "C" fn(*mut c_void),
}

/// The structure `gelato_image_input_calls`.
#[repr(C)]
pub(crate) struct InputCalls {
    pub(crate) abi: c_int,
    pub(crate) create: unsafe extern "C" fn(*mut c_void, Message) -> *mut c_void,
    pub(crate) open: unsafe extern "C" fn(*mut c_void, *const c_char, *mut Spec, Message) -> c_int,
    pub(crate) seek_subimage: unsafe extern "C" fn(*mut c_void, c_int, *mut Spec, Message) -> c_int,
    pub(crate) read_native_scanline:
        unsafe extern "C" fn(*mut c_void, c_int, c_int, *mut c_void, Message) -> c_int,
    pub(crate) read_native_tile:
        unsafe extern "C" fn(*mut c_void, c_int, c_int, c_int, *mut c_void, Message) -> c_int,
    pub(crate) read_scanline:
        Option<unsafe extern "C" fn(*mut c_void, c_int, c_int, *mut f32, c_int, Message) -> c_int>,
    pub(crate) read_tile: Option<
        unsafe extern "C" fn(
            *mut c_void,
            c_int,
            c_int,
            c_int,
            *mut f32,
            c_int,
            c_int,
            c_int,
            Message,
        ) -> c_int,
    >,
    pub(crate) get_parameter:
        Option<unsafe extern "C" fn(*mut c_void, *const c_char, c_uint, *mut c_void, Message) -> c_int>,
    pub(crate) close: unsafe extern "C" fn(*mut c_void, Message) -> c_int,
    pub(crate) destroy: unsafe extern "C" fn(*mut c_void),
}

// These functions are defined in the shim, `cpp/shim.cpp`.
unsafe extern "C" {
    pub(crate) fn gelato_shim_output() -> *const OutputCalls;
    pub(crate) fn gelato_shim_input() -> *const InputCalls;
    /// True when a reader has its own conversion functions. `base` is the inherited one.
    pub(crate) fn gelato_shim_converts(
        reader: *mut c_void,
        base_scanline: *mut c_void,
        base_tile: *mut c_void,
    ) -> c_int;
    pub(crate) fn gelato_shim_renderer(calls: *const Calls, this: *mut c_void) -> *mut c_void;
    pub(crate) fn gelato_shim_generator_create(
        factory: *mut c_void,
        command: *const c_char,
        message: Message,
    ) -> *mut c_void;
    pub(crate) fn gelato_shim_generator_bound(
        generator: *mut c_void,
        bound: *mut f32,
        message: Message,
    ) -> c_int;
    pub(crate) fn gelato_shim_generator_run(
        generator: *mut c_void,
        calls: *const Calls,
        this: *mut c_void,
        params: *const c_char,
        message: Message,
    ) -> c_int;
    pub(crate) fn gelato_shim_generator_destroy(generator: *mut c_void);
    pub(crate) fn gelato_shim_handle(
        handler: *mut c_void,
        code: c_int,
        text: *const c_char,
        message: Message,
    ) -> c_int;
}

/// A buffer for a text that foreign code writes.
pub(crate) struct Text([u8; 1024]);

impl Text {
    pub(crate) fn new() -> Self {
        Self([0; 1024])
    }

    /// Returns the buffer to pass on, valid until the text is read.
    pub(crate) fn room(&mut self) -> Message {
        Message { text: self.0.as_mut_ptr().cast(), size: self.0.len() }
    }

    /// Returns the text that was written, if any.
    pub(crate) fn get(&self) -> Option<String> {
        let end = self.0.iter().position(|b| *b == 0).unwrap_or(self.0.len());
        (end > 0).then(|| String::from_utf8_lossy(&self.0[..end]).trim_end().to_owned())
    }
}

/// Returns a string that may be missing or not valid UTF-8; `None` for NULL.
///
/// # Safety
/// `text` is NULL or ends with 0, and does not change while the result lives.
pub(crate) unsafe fn text<'a>(text: *const c_char) -> Option<std::borrow::Cow<'a, str>> {
    if text.is_null() {
        return None;
    }
    // SAFETY: it is not NULL, and by the contract above it ends with 0.
    Some(unsafe { std::ffi::CStr::from_ptr(text) }.to_string_lossy())
}
