//! Intel's Open Image Denoise, found when the program runs. Versions 1.4 and 2 differ in the names of some functions.

use crate::dso::{Dso, function};
use granita_image::{Denoiser, NoisyImage};
use parking_lot::Mutex;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::path::{Path, PathBuf};
use std::ptr::NonNull;

/// The names of the library where the system looks for libraries, the newest first.
const NAMES: &[&str] = if cfg!(target_os = "macos") {
    &["libOpenImageDenoise.2.dylib", "libOpenImageDenoise.dylib"]
} else if cfg!(windows) {
    &["OpenImageDenoise.dll"]
} else {
    &[
        "libOpenImageDenoise.so.2",
        "libOpenImageDenoise.so.1",
        "libOpenImageDenoise.so.0",
        "libOpenImageDenoise.so",
    ]
};

/// The beginnings of the names of its files: the library, and what it may need beside it.
const LIBRARY: &str = if cfg!(windows) { "OpenImageDenoise." } else { "libOpenImageDenoise." };
const THREADS_LIBRARY: &str = if cfg!(windows) { "tbb" } else { "libtbb." };

/// The device of the CPU.
const CPU: c_int = 1;
/// Three floats.
const FLOAT3: c_int = 3;

type NewDevice = unsafe extern "C" fn(c_int) -> *mut c_void;
type NewFilter = unsafe extern "C" fn(*mut c_void, *const c_char) -> *mut c_void;
type OfObject = unsafe extern "C" fn(*mut c_void);
type SetInt = unsafe extern "C" fn(*mut c_void, *const c_char, c_int);
type SetBool = unsafe extern "C" fn(*mut c_void, *const c_char, bool);
type GetInt = unsafe extern "C" fn(*mut c_void, *const c_char) -> c_int;
type GetError = unsafe extern "C" fn(*mut c_void, *mut *const c_char) -> c_int;
type SetImage =
    unsafe extern "C" fn(*mut c_void, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize);

/// The functions of the library.
#[derive(Clone, Copy, Debug)]
struct Calls {
    new_device: NewDevice,
    commit_device: OfObject,
    release_device: OfObject,
    device_int: SetInt,
    device_bool: SetBool,
    int_of_device: GetInt,
    error: GetError,
    new_filter: NewFilter,
    image: SetImage,
    filter_bool: SetBool,
    commit_filter: OfObject,
    execute_filter: OfObject,
    release_filter: OfObject,
}

impl Calls {
    fn new(dso: &'static Dso) -> Result<Self, String> {
        // SAFETY: the types are those of oidn.h of versions 1.4 and 2, for these names.
        unsafe {
            let is_2 = dso.symbol("oidnSetFilterBool").is_some();
            let named = |new: &'static str, old: &'static str| if is_2 { new } else { old };
            Ok(Self {
                new_device: function(dso, "oidnNewDevice")?,
                commit_device: function(dso, "oidnCommitDevice")?,
                release_device: function(dso, "oidnReleaseDevice")?,
                device_int: function(dso, named("oidnSetDeviceInt", "oidnSetDevice1i"))?,
                device_bool: function(dso, named("oidnSetDeviceBool", "oidnSetDevice1b"))?,
                int_of_device: function(dso, named("oidnGetDeviceInt", "oidnGetDevice1i"))?,
                error: function(dso, "oidnGetDeviceError")?,
                new_filter: function(dso, "oidnNewFilter")?,
                image: function(dso, "oidnSetSharedFilterImage")?,
                filter_bool: function(dso, named("oidnSetFilterBool", "oidnSetFilter1b"))?,
                commit_filter: function(dso, "oidnCommitFilter")?,
                execute_filter: function(dso, "oidnExecuteFilter")?,
                release_filter: function(dso, "oidnReleaseFilter")?,
            })
        }
    }
}

/// Removes noise with Open Image Denoise, on the CPU.
#[derive(Debug)]
pub struct OpenImageDenoise {
    calls: Calls,
    name: String,
    /// Held while the library computes, because it takes all threads.
    turn: Mutex<()>,
}

impl OpenImageDenoise {
    /// Finds the library: in `place`, which is its file or a folder that contains it, or where the system looks for
    /// libraries when it is `None`.
    ///
    /// # Errors
    /// Returns a message when there is none, or when it is not one of Open Image Denoise 1.4 or 2.
    pub fn find(place: Option<&Path>) -> Result<Self, String> {
        let (dso, what) = match place {
            Some(place) => {
                let file = file_in(place)?;
                let dso = load(&file).map_err(|error| format!("{}: {error}", file.display()))?;
                (dso, file.display().to_string())
            }
            None => {
                let found =
                    NAMES.iter().find_map(|name| Some((Dso::of_system(name).ok()?, (*name).to_owned())));
                found.ok_or_else(|| {
                    format!(
                        "the library {} of Open Image Denoise is not installed; \"render:denoiselibrary\" names its file",
                        NAMES[0]
                    )
                })?
            }
        };
        let calls = Calls::new(dso).map_err(|error| format!("{what}: {error}"))?;
        let device = Device::new(&calls, 1).map_err(|error| format!("{what}: {error}"))?;
        // SAFETY: the device exists, and the name is a text.
        let version = unsafe { (calls.int_of_device)(device.at.as_ptr(), c"version".as_ptr()) };
        drop(device);
        let [major, minor, patch] = [version / 10_000, version / 100 % 100, version % 100];
        if (major, minor) < (1, 4) || major > 2 {
            return Err(format!("{what}: version {major}.{minor}.{patch}; 1.4 and 2 are supported"));
        }
        Ok(Self { calls, name: format!("Open Image Denoise {major}.{minor}.{patch}"), turn: Mutex::new(()) })
    }
}

/// Returns the library in a folder, or the file itself.
fn file_in(place: &Path) -> Result<PathBuf, String> {
    if !place.is_dir() {
        return Ok(place.to_owned());
    }
    let files = files_of(place, LIBRARY);
    // The shortest name is a link to the others.
    let file = files.into_iter().min_by_key(|file| file.as_os_str().len());
    file.ok_or_else(|| format!("{}: there is no library {LIBRARY}*", place.display()))
}

/// Returns the files of a folder whose names begin so, in the order of their names.
fn files_of(folder: &Path, beginning: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok);
    let named = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(beginning));
    let mut files: Vec<PathBuf> = named.map(|entry| entry.path()).collect();
    files.sort();
    files
}

/// Loads the library. When the system does not find what it needs, files beside it are loaded before.
fn load(file: &Path) -> Result<&'static Dso, String> {
    Dso::load(file).or_else(|error| {
        let folder = file.parent().unwrap_or(Path::new("."));
        let beside = files_of(folder, THREADS_LIBRARY);
        if beside.iter().filter(|file| Dso::load(file).is_ok()).count() == 0 {
            return Err(error);
        }
        Dso::load(file)
    })
}

/// A device, which is released when it is dropped.
struct Device<'c> {
    calls: &'c Calls,
    at: NonNull<c_void>,
}

impl<'c> Device<'c> {
    fn new(calls: &'c Calls, threads: usize) -> Result<Self, String> {
        // SAFETY: the type is one that the library knows, and the names are texts.
        unsafe {
            let at = NonNull::new((calls.new_device)(CPU)).ok_or("it has no device for the CPU")?;
            let device = Self { calls, at };
            let threads = c_int::try_from(threads).unwrap_or(1).max(1);
            (calls.device_int)(at.as_ptr(), c"numThreads".as_ptr(), threads);
            (calls.device_bool)(at.as_ptr(), c"setAffinity".as_ptr(), false);
            (calls.commit_device)(at.as_ptr());
            device.check()?;
            Ok(device)
        }
    }

    /// Returns the first error since the last call.
    fn check(&self) -> Result<(), String> {
        let mut text: *const c_char = std::ptr::null();
        // SAFETY: the device exists, and `text` is a place for a pointer.
        let code = unsafe { (self.calls.error)(self.at.as_ptr(), &raw mut text) };
        if code == 0 {
            return Ok(());
        }
        if text.is_null() {
            return Err(format!("error {code}"));
        }
        // SAFETY: it is a text of the library, which stays until the next call.
        Err(unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned())
    }
}

impl Drop for Device<'_> {
    fn drop(&mut self) {
        // SAFETY: the device exists, and nothing uses it any more.
        unsafe { (self.calls.release_device)(self.at.as_ptr()) }
    }
}

/// Runs a filter for rendered images. `inputs` are its named images of `3 * width * height` values, and `options` the
/// names of what is true of them.
fn run(
    calls: &Calls,
    device: &Device<'_>,
    [width, height]: [usize; 2],
    inputs: &[(&CStr, &[f32])],
    options: &[&CStr],
) -> Result<Vec<f32>, String> {
    let mut out = vec![0.0_f32; 3 * width * height];
    // SAFETY: the device exists, and the name is that of a filter for rendered images.
    let filter = unsafe { (calls.new_filter)(device.at.as_ptr(), c"RT".as_ptr()) };
    let Some(filter) = NonNull::new(filter) else {
        return device.check().and(Err("it has no filter for rendered images".to_owned()));
    };
    let at = filter.as_ptr();
    let set = |name: &CStr, plane: *mut f32| {
        // SAFETY: the filter exists. The plane has `3 * width * height` floats without gaps, and outlives the filter,
        // which only reads the planes of inputs.
        unsafe { (calls.image)(at, name.as_ptr(), plane.cast(), FLOAT3, width, height, 0, 0, 0) }
    };
    inputs.iter().for_each(|(name, plane)| set(name, plane.as_ptr().cast_mut()));
    set(c"output", out.as_mut_ptr());
    for name in options {
        // SAFETY: the filter exists.
        unsafe { (calls.filter_bool)(at, name.as_ptr(), true) }
    }
    // SAFETY: the filter exists, has its images, and is released once.
    unsafe {
        (calls.commit_filter)(at);
        (calls.execute_filter)(at);
        (calls.release_filter)(at);
    }
    device.check()?;
    Ok(out)
}

impl Denoiser for OpenImageDenoise {
    fn name(&self) -> &str {
        &self.name
    }

    fn denoise(&self, image: &NoisyImage<'_>) -> Result<Vec<f32>, String> {
        let NoisyImage { width, height, color, albedo, normal, .. } = *image;
        let values = width.checked_mul(height).and_then(|pixels| pixels.checked_mul(3));
        if [color, albedo, normal].iter().any(|plane| Some(plane.len()) != values) {
            return Err("its planes do not have the pixels of the image".to_owned());
        }
        let _turn = self.turn.lock();
        let device = Device::new(&self.calls, image.threads)?;
        let run = |inputs: &[(&CStr, &[f32])], options: &[&CStr]| {
            run(&self.calls, &device, [width, height], inputs, options)
        };
        if !image.has_noisy_features {
            return run(&[(c"color", color), (c"albedo", albedo), (c"normal", normal)], &[c"hdr"]);
        }
        let [albedo, normal] = [run(&[(c"albedo", albedo)], &[])?, run(&[(c"normal", normal)], &[])?];
        run(&[(c"color", color), (c"albedo", &albedo), (c"normal", &normal)], &[c"hdr", c"cleanAux"])
    }
}
