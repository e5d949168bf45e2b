//! Shared libraries that contain plugins.
//!
//! Libraries are never unloaded. Objects of their classes may exist anywhere, and the system keeps one copy of a
//! library per process. The table of libraries is therefore the only state that two renderers of one process share.

use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A loaded library.
#[derive(Debug)]
pub(crate) struct Dso {
    library: libloading::Library,
    /// The absolute file name, or the name of a library that the system found.
    pub(crate) path: PathBuf,
    /// The file name up to the first dot, which is the name of its plugin.
    pub(crate) stem: String,
    extensions: OnceLock<Vec<&'static str>>,
}

static LOADED: Mutex<BTreeMap<PathBuf, &'static Dso>> = Mutex::new(BTreeMap::new());

impl Dso {
    /// Returns the library in a file.
    ///
    /// # Errors
    /// Returns the error of the system, such as a missing symbol.
    pub(crate) fn load(path: &Path) -> Result<&'static Self, String> {
        Self::load_named(std::fs::canonicalize(path).map_err(|e| e.to_string())?)
    }

    /// Returns the library of this name that the system finds.
    ///
    /// # Errors
    /// Returns the error of the system.
    pub(crate) fn of_system(name: &str) -> Result<&'static Self, String> {
        Self::load_named(PathBuf::from(name))
    }

    fn load_named(path: PathBuf) -> Result<&'static Self, String> {
        let mut loaded = LOADED.lock();
        if let Some(dso) = loaded.get(&path) {
            return Ok(dso);
        }
        let library = open(&path).map_err(|e| {
            // The text of the system begins with the path, which messages contain in any case.
            let text = std::error::Error::source(&e).map_or_else(|| e.to_string(), ToString::to_string);
            text.strip_prefix(&format!("{}: ", path.display())).unwrap_or(&text).to_owned()
        })?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let stem = name.split('.').next().unwrap_or_default().to_owned();
        let dso: &'static Self =
            Box::leak(Box::new(Self { library, path: path.clone(), stem, extensions: OnceLock::new() }));
        loaded.insert(path, dso);
        Ok(dso)
    }

    /// Returns the extensions of its files. `find` is called at most once.
    pub(crate) fn extensions(&'static self, find: impl FnOnce() -> Vec<String>) -> &'static [&'static str] {
        self.extensions.get_or_init(|| find().into_iter().map(|e| &*e.leak()).collect())
    }

    /// Returns the address of a symbol.
    pub(crate) fn symbol(&self, name: &str) -> Option<*mut c_void> {
        // SAFETY: only the address is taken, as a pointer. The caller states its type.
        let symbol = unsafe { self.library.get::<*mut c_void>(name.as_bytes()) }.ok()?;
        // SAFETY: the symbol is not used as a value of this type, only its address.
        let address = unsafe { symbol.try_as_raw_ptr() }?;
        (!address.is_null()).then_some(address)
    }

    /// Returns the value of an `int`.
    pub(crate) fn int(&self, name: &str) -> Option<c_int> {
        // SAFETY: the requested symbols are ints by the interface, and live as long as the library.
        self.symbol(name).map(|address| unsafe { *address.cast::<c_int>() })
    }

    /// Returns the strings of an array of `char *` that ends with NULL.
    pub(crate) fn strings(&self, name: &str) -> Option<Vec<String>> {
        // SAFETY: the requested symbols are such arrays by the interface.
        self.symbol(name).map(|address| unsafe { strings(address.cast()) })
    }
}

/// Returns a function of a library.
///
/// # Safety
/// `F` is the type that the interface gives the function.
pub(crate) unsafe fn function<F: Copy>(dso: &Dso, name: &str) -> Result<F, String> {
    let address = dso.symbol(name).ok_or_else(|| format!("it has no function {name}"))?;
    debug_assert_eq!(size_of::<F>(), size_of_val(&address));
    // SAFETY: `F` is a pointer to a function, as the caller states, and pointers have one size here.
    Ok(unsafe { std::mem::transmute_copy(&address) })
}

/// The largest number of strings that are read from an array whose end is missing.
const MAX_STRINGS: usize = 1000;

/// Returns the strings of an array that ends with NULL.
///
/// # Safety
/// `array` is NULL or such an array.
pub(crate) unsafe fn strings(array: *const *const c_char) -> Vec<String> {
    let mut list = Vec::new();
    if array.is_null() {
        return list;
    }
    while list.len() < MAX_STRINGS {
        // SAFETY: no NULL came before, so the array continues.
        let text = unsafe { *array.add(list.len()) };
        if text.is_null() {
            break;
        }
        // SAFETY: it is a string by the interface.
        list.push(unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned());
    }
    list
}

#[cfg(unix)]
fn open(path: &Path) -> Result<libloading::Library, libloading::Error> {
    use libloading::os::unix::{Library, RTLD_LOCAL, RTLD_NOW};
    // SAFETY: the library's initialisers run. Placing a plugin on a search path permits that.
    unsafe { Library::open(Some(path), RTLD_NOW | RTLD_LOCAL) }.map(Into::into)
}

#[cfg(not(unix))]
fn open(path: &Path) -> Result<libloading::Library, libloading::Error> {
    // SAFETY: as above.
    unsafe { libloading::Library::new(path) }
}
