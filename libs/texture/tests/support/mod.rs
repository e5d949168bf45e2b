//! A folder with images and textures, for tests.
#![allow(dead_code, unreachable_pub, reason = "each test file uses its part")]

use granita_base::report::Message;
use granita_base::{Environment, Param, ParamData, ParamType, Reporter, SearchPath, Vec3};
use granita_image::{CreateOptions, FormatRegistry, ImageSpec, Limits, PixelType, Pixels};
use granita_texture::make::{Made, MakeOptions, make};
use granita_texture::{CacheOptions, Lookup, TextureCache, TextureError, TextureId};
use parking_lot::Mutex;
use std::path::PathBuf;
use std::sync::Arc;

/// The names of images of the faces of a cube, in the order of reference 9.3.
pub const FACES: [&str; 6] = ["px.tif", "nx.tif", "py.tif", "ny.tif", "pz.tif", "nz.tif"];

/// The directions forward, up and right of each face (reference 9.3).
pub const FRAMES: [[Vec3; 3]; 6] = [
    [Vec3::X, Vec3::Y, Vec3::NEG_Z],
    [Vec3::NEG_X, Vec3::Y, Vec3::Z],
    [Vec3::Y, Vec3::NEG_Z, Vec3::X],
    [Vec3::NEG_Y, Vec3::Z, Vec3::X],
    [Vec3::Z, Vec3::Y, Vec3::X],
    [Vec3::NEG_Z, Vec3::Y, Vec3::NEG_X],
];

pub struct Folder {
    dir: tempfile::TempDir,
    pub registry: FormatRegistry,
    pub reporter: Reporter,
    pub messages: Arc<Mutex<Vec<Message>>>,
}

impl Folder {
    pub fn new() -> Self {
        let (reporter, messages) = Reporter::collecting();
        let registry = granita_plugin::bundled_formats(Limits::default());
        Self { dir: tempfile::tempdir().unwrap(), registry, reporter, messages }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Writes a scanline TIFF of floats.
    pub fn image(&self, name: &str, size: (u32, u32), channels: usize, f: impl Fn(u32, u32, usize) -> f32) {
        self.image_of(name, ImageSpec::new(size.0, size.1, channels, PixelType::Float), f);
    }

    pub fn image_of(&self, name: &str, spec: ImageSpec, f: impl Fn(u32, u32, usize) -> f32) {
        let mut values = Vec::new();
        for y in 0..spec.height {
            for x in 0..spec.width {
                values.extend((0..spec.nchannels()).map(|c| f(x, y, c)));
            }
        }
        let options = CreateOptions::new(&spec, 1);
        let format = if name.ends_with(".exr") { "exr" } else { "tiff" };
        let mut out = self.registry.create(&self.path(name), format, &options).unwrap();
        out.write_rows(&Pixels::from_floats(spec.pixel_type, &values)).unwrap();
        out.close().unwrap();
    }

    /// Makes a texture of images of this folder ("-" stays "-").
    pub fn make(&self, inputs: &[&str], output: &str, options: &MakeOptions) -> Result<Made, TextureError> {
        let inputs: Vec<PathBuf> =
            inputs.iter().map(|n| if *n == "-" { PathBuf::from("-") } else { self.path(n) }).collect();
        make(&inputs, &self.path(output), options, &self.registry, &|_, _| ())
    }

    pub fn cache(&self, options: CacheOptions) -> TextureCache {
        let folder = self.dir.path().to_str().unwrap();
        let search = SearchPath::parse(folder, &SearchPath::default(), &Environment::empty());
        TextureCache::new(self.registry.clone(), search, options, self.reporter.clone())
    }

    /// Returns a cache with default options and one texture in it.
    pub fn open(&self, name: &str) -> (TextureCache, TextureId) {
        let cache = self.cache(CacheOptions::default());
        let id = cache.find(name).unwrap_or_else(|| panic!("{name}: {:?}", self.messages.lock()));
        (cache, id)
    }

    pub fn texts(&self) -> Vec<String> {
        self.messages.lock().iter().map(|m| m.to_string()).collect()
    }
}

/// Returns one channel of one lookup.
pub fn value(cache: &TextureCache, id: TextureId, lookup: &Lookup) -> f32 {
    let mut out = [f32::NAN];
    cache.texture(id, lookup, &mut out);
    out[0]
}

pub fn at(s: f32, t: f32) -> Lookup {
    Lookup { s, t, ..Lookup::default() }
}

/// Returns a lookup with a square footprint, as a fraction of the image.
pub fn wide(s: f32, t: f32, width: f32) -> Lookup {
    Lookup { dsdx: width, dtdy: width, ..at(s, t) }
}

pub fn random(i: u32, seed: u32) -> f32 {
    granita_base::hash::unit(granita_base::hash::words(&[i, seed]))
}

pub fn matrix(name: &str, m: &[f32; 16]) -> Param {
    Param {
        name: name.into(),
        ty: ParamType::of(granita_base::BaseType::Matrix),
        data: ParamData::from(&m[..]),
    }
}

/// Returns the exact bits, for the comparison of runs.
pub fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}
