//! Image formats from plugins in `FORMAT.imageio.so` (reference 13), and images in the memory of a program.

mod bundled;
mod input;
mod output;

use crate::dso::Dso;
use crate::ffi::{self, ABI, InputCalls, OutputCalls, Text};
use granita_image::{CreateOptions, Format, ImageError, ImageInput, ImageOutput, Limits, PixelType, Result};
use std::ffi::c_void;
use std::path::Path;

/// The value of `IMAGEIO_VERSION`.
const VERSION: i32 = 3;

/// A table of functions, and the factory of its objects.
struct Made<T: 'static> {
    calls: &'static T,
    /// The plugin's own function; null for tables of C.
    factory: *mut c_void,
}

impl<T> Clone for Made<T> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<T> Copy for Made<T> {}

impl<T> std::fmt::Debug for Made<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Made({:?})", self.factory)
    }
}

// SAFETY: tables never change, and a factory is the address of a function.
unsafe impl<T> Send for Made<T> {}
// SAFETY: as above.
unsafe impl<T> Sync for Made<T> {}

/// The source of writers.
#[derive(Clone, Copy, Debug)]
enum Writer {
    None,
    Made(Made<OutputCalls>),
    /// An `ImageOutput` of the program, at this address.
    Program(usize),
}

/// The format of a plugin.
#[derive(Debug)]
pub(crate) struct PluginFormat {
    name: &'static str,
    /// The name in messages.
    title: String,
    extensions: &'static [&'static str],
    reads: Vec<String>,
    writes: Vec<String>,
    reader: Option<Made<InputCalls>>,
    writer: Writer,
    dso: Option<&'static Dso>,
}

impl PluginFormat {
    /// Returns the format of a library.
    ///
    /// # Errors
    /// Returns the reason why it is not a plugin of this interface.
    pub(crate) fn new(dso: &'static Dso) -> std::result::Result<Self, String> {
        let (reader, writer) = match (dso.int("imageio_version"), dso.int("imageio_abi")) {
            (Some(VERSION), _) => cpp(dso),
            (_, Some(ABI)) => tables(dso)?,
            (Some(other), _) => {
                return Err(format!("its imageio_version is {other}, and this suite takes {VERSION}"));
            }
            (None, Some(other)) => {
                return Err(format!("its imageio_abi is {other}, and this suite takes {ABI}"));
            }
            (None, None) => return Err("it has no symbol imageio_version".to_owned()),
        };
        let stem = &dso.stem;
        if reader.is_none() && matches!(writer, Writer::None) {
            return Err(format!(
                "it has neither of the symbols {stem}_output_imageio_create and {stem}_input_imageio_create"
            ));
        }
        let list = |name: &str| {
            let strings = dso.strings(name).unwrap_or_default();
            strings.iter().map(|s| s.trim_start_matches('.').to_ascii_lowercase()).collect::<Vec<_>>()
        };
        let reads = if reader.is_some() { list(&format!("{stem}_input_extensions")) } else { Vec::new() };
        let writes = match writer {
            Writer::None => Vec::new(),
            _ => list(&format!("{stem}_output_extensions")),
        };
        let extensions = dso.extensions(|| {
            let mut all = vec![stem.to_ascii_lowercase()];
            for extension in writes.iter().chain(&reads) {
                if !all.contains(extension) {
                    all.push(extension.clone());
                }
            }
            all
        });
        let title = format!("plugin {}", dso.path.display());
        Ok(Self { name: &dso.stem, title, extensions, reads, writes, reader, writer, dso: Some(dso) })
    }

    /// Returns the format of an `ImageOutput` in the memory of the program, which exists until the frame is done.
    pub(crate) fn in_program(address: usize) -> Self {
        Self {
            name: "ImageOutput",
            title: format!("ImageOutput at {address:#x}"),
            extensions: &[],
            reads: Vec::new(),
            writes: Vec::new(),
            reader: None,
            writer: Writer::Program(address),
            dso: None,
        }
    }

    /// True when it lists the extension among those that it writes, or among those that it reads.
    pub(crate) fn lists(&self, extension: &str, writes: bool) -> bool {
        let list = if writes { &self.writes } else { &self.reads };
        list.iter().any(|e| e.eq_ignore_ascii_case(extension))
    }

    /// True when it can read.
    pub(crate) fn reads(&self) -> bool {
        self.reader.is_some()
    }

    /// True when there is a function for rectangles. C++ always has one.
    fn takes_rectangles(&self) -> bool {
        match self.writer {
            Writer::None => false,
            Writer::Made(made) => made.calls.write_rectangle.is_some(),
            Writer::Program(_) => true,
        }
    }

    fn fault(&self, path: &Path, what: impl Into<String>) -> ImageError {
        ImageError::Plugin { path: path.to_owned(), plugin: self.title.clone(), what: what.into() }
    }
}

/// Returns the tables of a C++ plugin.
fn cpp(dso: &Dso) -> (Option<Made<InputCalls>>, Writer) {
    let stem = &dso.stem;
    let reader = dso.symbol(&format!("{stem}_input_imageio_create")).map(|factory| {
        // SAFETY: the shim's table is static.
        Made { calls: unsafe { &*ffi::gelato_shim_input() }, factory }
    });
    let writer = match dso.symbol(&format!("{stem}_output_imageio_create")) {
        // SAFETY: the shim's table is static.
        Some(factory) => Writer::Made(Made { calls: unsafe { &*ffi::gelato_shim_output() }, factory }),
        None => Writer::None,
    };
    (reader, writer)
}

/// Returns the tables of a plugin in C.
fn tables(dso: &Dso) -> std::result::Result<(Option<Made<InputCalls>>, Writer), String> {
    let table = |name: String| {
        let address = dso.symbol(&name)?;
        // SAFETY: the symbol is a function of this form, by the interface whose version the plugin declares.
        let get: extern "C" fn() -> *const c_void = unsafe { std::mem::transmute(address) };
        Some(get()).filter(|table| !table.is_null())
    };
    let factory = std::ptr::null_mut();
    // SAFETY: tables of the interface are static.
    let reader = table(format!("{}_input_imageio_c", dso.stem)).map(|t| unsafe { &*t.cast::<InputCalls>() });
    // SAFETY: as above.
    let writer =
        table(format!("{}_output_imageio_c", dso.stem)).map(|t| unsafe { &*t.cast::<OutputCalls>() });
    let versions = [reader.map(|t| t.abi), writer.map(|t| t.abi)];
    if let Some(other) = versions.into_iter().flatten().find(|abi| *abi != ABI) {
        return Err(format!("a table of it has the version {other}, and this suite takes {ABI}"));
    }
    let reader = reader.map(|calls| Made { calls, factory });
    let writer = writer.map_or(Writer::None, |calls| Writer::Made(Made { calls, factory }));
    Ok((reader, writer))
}

/// An object of a plugin, which is destroyed with this.
struct Object<T: 'static> {
    calls: &'static T,
    this: *mut c_void,
    destroy: Option<unsafe extern "C" fn(*mut c_void)>,
}

// SAFETY: readers are behind a lock and writers have one owner. One thread at a time calls them, as the interface
// guarantees to plugins.
unsafe impl<T> Send for Object<T> {}

impl<T> Drop for Object<T> {
    fn drop(&mut self) {
        if let Some(destroy) = self.destroy {
            // SAFETY: the object came from this table's `create` and ends here. The shim catches exceptions.
            unsafe { destroy(self.this) }
        }
    }
}

/// Returns the text of a call that failed.
fn failure(call: &str, status: i32, text: &Text) -> String {
    match (status, text.get()) {
        (ffi::THREW, Some(text)) => format!("{call} threw an exception: {text}"),
        (ffi::THREW, None) => format!("{call} threw an exception"),
        (_, Some(text)) => format!("{call} failed: {text}"),
        (_, None) => format!("{call} failed without a reason"),
    }
}

impl Format for PluginFormat {
    fn name(&self) -> &'static str {
        self.name
    }

    fn extensions(&self) -> &'static [&'static str] {
        self.extensions
    }

    fn recognizes(&self, _: &[u8]) -> bool {
        // Only its `open` recognizes files.
        false
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        // The plugin opens the file by itself.
        input::open(self, &limits.files.place(path), limits)
    }

    fn supports(&self, feature: &str) -> bool {
        let asks = |bit: i32| output::features(self) & bit != 0;
        match feature {
            "write" => !matches!(self.writer, Writer::None),
            "tiles" => asks(ffi::TILES),
            "rectangles" => self.takes_rectangles() && asks(ffi::RECTANGLES),
            "levels" => asks(ffi::MULTIIMAGE),
            // It receives floats, and stores them in its own type.
            "half" | "float" | "u16" | "channels" | "alpha" => true,
            _ => false,
        }
    }

    fn output_type(&self, quantized: PixelType) -> PixelType {
        quantized
    }

    fn quantizes(&self) -> bool {
        true
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        output::create(self, &options.files.place(path), options)
    }
}
