//! Conversions of colours by a plugin (`granita_color.h`).

use crate::dso::{Dso, function};
use crate::plugins::Plugins;
use granita_color::{Conversion, Converter, Engine};
use std::ffi::{CStr, CString, c_char, c_int};
use std::sync::{Arc, OnceLock};

/// The version of the interface.
const VERSION: c_int = 1;
/// The room for a message, in bytes.
const ROOM: usize = 4096;

/// A conversion of the plugin, which only its functions look into.
#[repr(C)]
struct Handle {
    _private: [u8; 0],
}

type Version = unsafe extern "C" fn() -> c_int;
type Library = unsafe extern "C" fn() -> *const c_char;
type Open = unsafe extern "C" fn(
    *const c_char,
    c_int,
    *const c_char,
    *const c_char,
    *const c_char,
    c_int,
    *mut c_char,
    usize,
) -> *mut Handle;
type Apply = unsafe extern "C" fn(*const Handle, *mut f32, usize);
type Close = unsafe extern "C" fn(*mut Handle);

/// The functions of a plugin.
#[derive(Clone, Copy, Debug)]
struct Calls {
    library: &'static CStr,
    open: Open,
    apply: Apply,
    close: Close,
}

impl Calls {
    fn new(dso: &'static Dso) -> Result<Self, String> {
        // SAFETY: the types are those of granita_color.h, for these names.
        let (version, library, open, apply, close) = unsafe {
            (
                function::<Version>(dso, "granita_color_version")?,
                function::<Library>(dso, "granita_color_library")?,
                function::<Open>(dso, "granita_color_open")?,
                function::<Apply>(dso, "granita_color_apply")?,
                function::<Close>(dso, "granita_color_close")?,
            )
        };
        // SAFETY: the function takes nothing, by the interface.
        let found = unsafe { version() };
        if found != VERSION {
            return Err(format!("it has version {found} of the interface, {VERSION} is needed"));
        }
        // SAFETY: as above.
        let name = unsafe { library() };
        if name.is_null() {
            return Err("it has no name".to_owned());
        }
        // SAFETY: it is a text that is never freed, by the interface.
        let library = unsafe { CStr::from_ptr(name) };
        Ok(Self { library, open, apply, close })
    }
}

/// A conversion of a plugin.
struct PluginConverter {
    calls: Calls,
    handle: *mut Handle,
}

// SAFETY: by the interface, functions may be called by several threads at once, and a conversion by any thread.
unsafe impl Send for PluginConverter {}
// SAFETY: as above.
unsafe impl Sync for PluginConverter {}

impl std::fmt::Debug for PluginConverter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "PluginConverter({:?})", self.calls.library)
    }
}

impl Converter for PluginConverter {
    fn apply(&self, rgb: &mut [f32]) {
        // SAFETY: the handle is that of an open conversion, and the slice has room for these pixels.
        unsafe { (self.calls.apply)(self.handle, rgb.as_mut_ptr(), rgb.len() / 3) }
    }
}

impl Drop for PluginConverter {
    fn drop(&mut self) {
        // SAFETY: the handle is that of an open conversion, and nothing uses it any more.
        unsafe { (self.calls.close)(self.handle) }
    }
}

/// The plugin for conversions of colours, which is looked for when a conversion needs it.
#[derive(Debug)]
pub(crate) struct PluginEngine {
    plugins: Plugins,
    calls: OnceLock<Result<Calls, String>>,
}

impl PluginEngine {
    pub(crate) fn new(plugins: Plugins) -> Self {
        Self { plugins, calls: OnceLock::new() }
    }

    fn calls(&self) -> Result<Calls, String> {
        let find = || {
            let missing = || "the plugin opencolorio.color.so does it where it is installed".to_owned();
            let file = self.plugins.color_file().ok_or_else(missing)?;
            let calls = Dso::load(&file).and_then(Calls::new);
            calls.map_err(|why| format!("plugin {} is not used: {why}", file.display()))
        };
        self.calls.get_or_init(find).clone()
    }
}

impl Engine for PluginEngine {
    fn conversion(&self, config: &str, conversion: &Conversion<'_>) -> Result<Arc<dyn Converter>, String> {
        let calls = self.calls()?;
        let (kind, texts, inverse) = match *conversion {
            Conversion::Spaces { from, to } => (0, [from, to, ""], false),
            Conversion::View { from, display, view } => (1, [from, display, view], false),
            Conversion::Looks { from, to, looks } => (2, [from, to, looks], false),
            Conversion::File { path, inverse } => (3, [path, "", ""], inverse),
        };
        let text = |text: &str| CString::new(text).map_err(|_| "a name contains a zero".to_owned());
        let (config, a, b, c) = (text(config)?, text(texts[0])?, text(texts[1])?, text(texts[2])?);
        let mut message = [0_u8; ROOM];
        // SAFETY: the texts end with a zero and live during the call, and the message has this room.
        let handle = unsafe {
            (calls.open)(
                config.as_ptr(),
                kind,
                a.as_ptr(),
                b.as_ptr(),
                c.as_ptr(),
                c_int::from(inverse),
                message.as_mut_ptr().cast(),
                ROOM,
            )
        };
        if handle.is_null() {
            let end = message.iter().position(|b| *b == 0).unwrap_or(ROOM);
            let why = String::from_utf8_lossy(&message[..end]).into_owned();
            return Err(format!("{}: {why}", calls.library.to_string_lossy()));
        }
        Ok(Arc::new(PluginConverter { calls, handle }))
    }
}
