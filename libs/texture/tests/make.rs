//! Tests of the files that `make` writes.
#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use granita_base::Filter;
use granita_image::{CreateOptions, Format, ImageInput, ImageOutput, ImageSpec, Limits, PixelType, Pixels};
use granita_texture::Wrap;
use granita_texture::make::{Made, MakeOptions};
use parking_lot::Mutex;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use support::{Folder, matrix, random};

fn options() -> MakeOptions {
    MakeOptions::default()
}

#[test]
fn textures_have_levels_tiles_and_attributes() {
    let folder = Folder::new();
    let mut spec = ImageSpec::new(300, 100, 3, PixelType::U8);
    let m: [f32; 16] = std::array::from_fn(|i| i as f32);
    spec.attributes.set(matrix("worldtocamera", &m));
    folder.image_of("a.tif", spec, |x, _, _| x as f32 / 300.0);
    let o = MakeOptions { swrap: Wrap::Periodic, twrap: Wrap::Mirror, ..options() };
    let made = folder.make(&["a.tif"], "a.tx", &o).unwrap();
    assert_eq!(made, Made::Written { width: 512, height: 128, levels: 10, notes: vec![] });
    let file = folder.registry.open(&folder.path("a.tx")).unwrap();
    assert_eq!((file.images(), file.levels(0)), (1, 10));
    for level in 0..10 {
        let s = file.spec(0, level).unwrap();
        assert_eq!((s.width, s.height), (512 >> level, (128_u32 >> level).max(1)));
        assert_eq!((s.pixel_type, s.nchannels()), (PixelType::U8, 3));
        assert!(s.tile_width.is_power_of_two() && s.tile_width <= 64 && s.tile_width >= 16);
    }
    let s = file.spec(0, 0).unwrap();
    assert_eq!(s.string("textureformat"), Some("Plain Texture"));
    assert_eq!(s.string("wrapmodes"), Some("periodic,mirror"));
    assert_eq!(s.matrix("worldtocamera"), Some(m));
    // Matrices of the options replace those of the input.
    let id = granita_base::Transform::IDENTITY.to_rows();
    folder.make(&["a.tif"], "b.tx", &MakeOptions { mcamera: Some(id), ..options() }).unwrap();
    let file = folder.registry.open(&folder.path("b.tx")).unwrap();
    assert_eq!(file.spec(0, 0).unwrap().matrix("worldtocamera"), Some(id));
}

#[test]
fn noresize_keeps_the_size_and_the_texels() {
    let folder = Folder::new();
    let f = |x: u32, y: u32, c: usize| random(x + 100 * y, c as u32);
    folder.image("a.tif", (77, 33), 5, f);
    for separate in [false, true] {
        for tile in [16, 32, 128] {
            let o = MakeOptions { resize: false, separate, tile_size: (tile, tile), ..options() };
            folder.make(&["a.tif"], "a.tx", &o).unwrap();
            let file = folder.registry.open(&folder.path("a.tx")).unwrap();
            let s = file.spec(0, 0).unwrap();
            assert_eq!((s.width, s.height, s.nchannels(), file.levels(0)), (77, 33, 5, 7));
            let values = file.read_level(0, 0).unwrap().to_floats();
            for (i, v) in values.iter().enumerate() {
                let (c, x, y) = (i % 5, i / 5 % 77, i / 5 / 77);
                assert_eq!(*v, f(x as u32, y as u32, c));
            }
        }
    }
}

/// With the box filter every level of an image whose sizes are powers of two has the mean of the first.
#[test]
fn levels_keep_the_mean() {
    let folder = Folder::new();
    folder.image("a.tif", (128, 64), 1, |x, y, _| random(x + 128 * y, 0) * 10.0);
    folder.make(&["a.tif"], "a.tx", &options()).unwrap();
    let file = folder.registry.open(&folder.path("a.tx")).unwrap();
    let mean = |level| {
        let v = file.read_level(0, level).unwrap().to_floats();
        v.iter().map(|v| f64::from(*v)).sum::<f64>() / v.len() as f64
    };
    for level in 1..8 {
        assert!((mean(level) - mean(0)).abs() < 1e-5);
    }
}

#[test]
fn textures_do_not_depend_on_threads() {
    let folder = Folder::new();
    folder.image("a.tif", (150, 90), 3, |x, y, c| random(x + 150 * y, c as u32));
    let bytes = |threads: usize, filter: Filter| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let o = MakeOptions { filter, ..options() };
        pool.install(|| folder.make(&["a.tif"], "a.tx", &o)).unwrap();
        std::fs::read(folder.path("a.tx")).unwrap()
    };
    for filter in [Filter::Box, Filter::Gaussian] {
        assert_eq!(bytes(1, filter), bytes(7, filter));
    }
}

#[test]
fn levels_are_averaged_in_linear_light_between_the_gammas() {
    let folder = Folder::new();
    folder.image("a.tif", (16, 16), 4, |x, _, c| if c == 3 { 0.5 } else { (x % 2) as f32 });
    let o = MakeOptions { ingamma: 2.2, outgamma: 2.2, ..options() };
    folder.make(&["a.tif"], "a.tx", &o).unwrap();
    let file = folder.registry.open(&folder.path("a.tx")).unwrap();
    let level = |l| file.read_level(0, l).unwrap().to_floats();
    assert_eq!(level(0)[..8], [0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 0.5]);
    // Half the light is written with gamma, and alpha is unchanged.
    let half = 0.5_f32.powf(1.0 / 2.2);
    let first = &level(1)[..4];
    assert!((first[0] - half).abs() < 1e-6 && first[3] == 0.5, "{first:?}");
}

#[test]
fn update_mode_compares_time_stamps() {
    let folder = Folder::new();
    folder.image("a.tif", (8, 8), 1, |_, _, _| 0.5);
    let stamp = SystemTime::now() - Duration::from_secs(5000);
    let touch = |name: &str, time| {
        std::fs::File::options().append(true).open(folder.path(name)).unwrap().set_modified(time).unwrap();
    };
    touch("a.tif", stamp);
    let o = MakeOptions { update: true, ..options() };
    let time = || std::fs::metadata(folder.path("a.tx")).unwrap().modified().unwrap();
    let in_time = || std::fs::metadata(folder.path("a.tif")).unwrap().modified().unwrap();
    assert!(matches!(folder.make(&["a.tif"], "a.tx", &o).unwrap(), Made::Written { .. }));
    assert_eq!(time(), in_time());
    assert_eq!(folder.make(&["a.tif"], "a.tx", &o).unwrap(), Made::UpToDate);
    touch("a.tif", stamp + Duration::from_secs(10));
    assert!(matches!(folder.make(&["a.tif"], "a.tx", &o).unwrap(), Made::Written { .. }));
    // Without update mode the texture is made in any case, and has the current time.
    assert!(matches!(folder.make(&["a.tif"], "a.tx", &options()).unwrap(), Made::Written { .. }));
    assert!(time() > stamp + Duration::from_secs(1000));
}

/// A TIFF format that records the time of each file as it appears.
struct Watched(Arc<dyn Format>, Arc<Mutex<Vec<SystemTime>>>);

struct WatchedOutput(Box<dyn ImageOutput>, PathBuf, Arc<Mutex<Vec<SystemTime>>>);

impl Format for Watched {
    fn name(&self) -> &'static str {
        "watched"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["watched"]
    }

    fn recognizes(&self, _: &[u8]) -> bool {
        false
    }

    fn open(&self, path: &Path, limits: &Limits) -> granita_image::Result<Box<dyn ImageInput>> {
        self.0.open(path, limits)
    }

    fn supports(&self, feature: &str) -> bool {
        self.0.supports(feature)
    }

    fn create(
        &self,
        path: &Path,
        options: &CreateOptions<'_>,
    ) -> granita_image::Result<Box<dyn ImageOutput>> {
        let output = self.0.create(path, options)?;
        Ok(Box::new(WatchedOutput(output, path.to_owned(), self.1.clone())))
    }
}

impl ImageOutput for WatchedOutput {
    fn write_rows(&mut self, pixels: &Pixels) -> granita_image::Result<()> {
        self.0.write_rows(pixels)
    }

    fn write_tile(&mut self, tx: u32, ty: u32, pixels: &Pixels) -> granita_image::Result<()> {
        self.0.write_tile(tx, ty, pixels)
    }

    fn next_level(&mut self, spec: &ImageSpec) -> granita_image::Result<()> {
        self.0.next_level(spec)
    }

    fn close(self: Box<Self>) -> granita_image::Result<()> {
        self.0.close()?;
        self.2.lock().push(std::fs::metadata(&self.1).unwrap().modified().unwrap());
        Ok(())
    }
}

#[test]
fn an_updated_texture_has_the_time_of_its_input() {
    let mut folder = Folder::new();
    let times = Arc::new(Mutex::new(Vec::new()));
    let tiff = folder.registry.by_name("tiff").unwrap();
    folder.registry.register(Arc::new(Watched(tiff, times.clone())));
    folder.image("a.tif", (8, 8), 1, |_, _, _| 0.5);
    let stamp = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000);
    std::fs::File::options().append(true).open(folder.path("a.tif")).unwrap().set_modified(stamp).unwrap();
    // The texture is made row by row, and as a whole.
    for filter in [Filter::Box, Filter::Gaussian] {
        let o = MakeOptions { update: true, format: "watched".to_owned(), filter, ..options() };
        folder.make(&["a.tif"], &format!("{filter:?}.tx"), &o).unwrap();
    }
    assert_eq!(*times.lock(), [stamp, stamp]);
}

#[test]
fn invalid_texels_and_changed_tile_sizes_are_noted() {
    let folder = Folder::new();
    folder.image("a.tif", (4, 4), 1, |x, _, _| if x == 0 { f32::NAN } else { f32::INFINITY });
    let o = MakeOptions { tile_size: (8, 8), ..options() };
    let Made::Written { notes, .. } = folder.make(&["a.tif"], "a.tx", &o).unwrap() else { panic!() };
    assert!(notes[0].contains("values that are not numbers: 4"), "{notes:?}");
    assert!(notes[1].contains("16 x 16"), "{notes:?}");
    let file = folder.registry.open(&folder.path("a.tx")).unwrap();
    for level in 0..3 {
        assert!(file.read_level(0, level).unwrap().to_floats().iter().all(|v| v.is_finite()));
    }
}

#[test]
fn a_failed_texture_leaves_no_file() {
    let folder = Folder::new();
    folder.image("a.tif", (4, 4), 1, |_, _, _| 0.0);
    let fails = |o: MakeOptions, what: &str| {
        let error = folder.make(&["a.tif"], "x.tx", &o).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
        assert!(!folder.path("x.tx").exists());
    };
    fails(MakeOptions { format: "png".to_owned(), ..options() }, "png");
    fails(MakeOptions { format: "nonsense".to_owned(), ..options() }, "nonsense");
    fails(MakeOptions { ingamma: 0.0, ..options() }, "ingamma");
    fails(MakeOptions { outgamma: f32::NAN, ..options() }, "outgamma");
    fails(MakeOptions { fov_deg: 180.0, ..options() }, "180");
    fails(MakeOptions { opaque_width: -1.0, ..options() }, "opaquewidth");
    fails(MakeOptions { tile_size: (0, 16), ..options() }, "0 x 16");
    fails(MakeOptions { compression: Some("squeeze".to_owned()), ..options() }, "squeeze");
    fails(MakeOptions { compression: Some("zip:13".to_owned()), ..options() }, "a number from 1 to 12");
}

#[test]
fn texels_do_not_depend_on_the_level_of_compression_nor_the_file_on_threads() {
    let folder = Folder::new();
    folder.image("a.tif", (200, 90), 3, |x, y, c| 0.5 + 0.05 * random(x + 200 * y, c as u32));
    for format in ["tiff", "exr"] {
        let make = |compression: &str, threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let compression = Some(compression.to_owned());
            let o = MakeOptions { format: format.to_owned(), compression, ..options() };
            pool.install(|| folder.make(&["a.tif"], "a.tx", &o)).unwrap();
            let file = folder.registry.open(&folder.path("a.tx")).unwrap();
            let texels: Vec<_> = (0..file.levels(0)).map(|l| file.read_level(0, l).unwrap()).collect();
            (texels, std::fs::read(folder.path("a.tx")).unwrap())
        };
        let (plain, _) = make("none", 2);
        let mut sizes = Vec::new();
        for compression in ["zip:1", "zip", "zip:6", "deflate:7", "zip:12"] {
            let (texels, bytes) = make(compression, 2);
            assert!(texels == plain, "{format} {compression}");
            assert!(bytes == make(compression, 5).1, "{format} {compression}");
            sizes.push(bytes.len());
        }
        assert!(sizes[4] <= sizes[0], "{sizes:?}");
    }
}

#[test]
fn textures_cover_the_display_window() {
    let folder = Folder::new();
    let mut spec = ImageSpec::new(4, 4, 1, PixelType::Float);
    (spec.x, spec.y, spec.full_width, spec.full_height) = (4, 0, 8, 8);
    folder.image_of("a.tif", spec, |_, _, _| 1.0);
    folder.make(&["a.tif"], "a.tx", &options()).unwrap();
    let file = folder.registry.open(&folder.path("a.tx")).unwrap();
    let v = file.read_level(0, 0).unwrap().to_floats();
    assert_eq!(v.len(), 64);
    for (i, v) in v.iter().enumerate() {
        assert_eq!(*v, f32::from(i % 8 >= 4 && i / 8 < 4));
    }
}

/// The bound `memory_bytes` holds for images that repeat as well. Rows of their other end are read ahead, and the file
/// is the same. Where all rows are needed, no texture is made.
#[test]
fn memory_is_limited_for_repeating_images() {
    let folder = Folder::new();
    let spec = ImageSpec::new(2000, 1100, 3, PixelType::U8);
    folder.image_of("a.tif", spec, |x, y, c| random(x + 5000 * y, c as u32));
    let repeats = |memory_bytes: u64, filter: Filter| MakeOptions {
        swrap: Wrap::Periodic,
        twrap: Wrap::Periodic,
        memory_bytes,
        filter,
        ..options()
    };
    folder.make(&["a.tif"], "a.tx", &repeats(24 << 20, Filter::Box)).unwrap();
    let file = folder.registry.open(&folder.path("a.tx")).unwrap();
    let level = file.read_level(0, 0).unwrap().to_floats();
    // The first row also depends on the last ones.
    let source = folder.registry.open(&folder.path("a.tif")).unwrap().read_level(0, 0).unwrap().to_floats();
    let column = |y: usize| source[y * 2000 * 3..][..2000 * 3].iter().map(|v| f64::from(*v)).sum::<f64>();
    let mean =
        |y: usize| level[y * 2048 * 3..][..2048 * 3].iter().map(|v| f64::from(*v)).sum::<f64>() / 2048.0;
    let scale = 1100.0 / 2048.0;
    for y in [0_i64, 1, 2047] {
        let centre = (y as f64 + 0.5) * scale;
        let taps = (-3..1104_i64).map(|i| {
            let weight = Filter::CatmullRom.weight((i as f64 + 0.5 - centre) as f32, 4.0);
            (f64::from(weight), column(i.rem_euclid(1100) as usize) / 2000.0)
        });
        let (sum, total) = taps.fold((0.0, 0.0), |(s, t), (w, v)| (s + w * v, t + w));
        assert!((sum / total - mean(y as usize)).abs() < 2e-3, "{y}: {} {}", sum / total, mean(y as usize));
    }
    let error =
        folder.make(&["a.tif"], "b.tx", &repeats(24 << 20, Filter::Gaussian)).unwrap_err().to_string();
    assert!(error.contains("-memory") && !folder.path("b.tx").exists(), "{error}");
    folder.make(&["a.tif"], "b.tx", &repeats(1 << 30, Filter::Gaussian)).unwrap();
}

/// A display window far beyond the data is refused.
#[test]
fn display_windows_far_beyond_the_data_are_refused() {
    let folder = Folder::new();
    for (name, (full_width, full_height), what) in [
        ("tall.tif", (64, 16_777_154), "side of the display window 16777154"),
        ("large.tif", (100_000, 100_000), "number of pixels of the display window 10000000000"),
    ] {
        let spec = ImageSpec { full_width, full_height, ..ImageSpec::new(64, 64, 3, PixelType::Half) };
        folder.image_of(name, spec, |_, _, _| 0.5);
        let error = folder.make(&[name], "a.tx", &options()).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    }
}
