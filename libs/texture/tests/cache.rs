//! Results do not depend on memory, files, threads or order.
#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use granita_image::{CreateOptions, Format, ImageError, ImageInput, ImageOutput, ImageSpec, Limits, Pixels};
use granita_texture::make::MakeOptions;
use granita_texture::{CacheOptions, Lookup, TextureCache, Wrap};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use support::{Folder, bits, random};

const FILES: u32 = 5;

fn folder() -> Folder {
    let folder = Folder::new();
    for i in 0..FILES {
        folder.image("n.tif", (200 + i, 150), 3, |x, y, c| random(x + 1000 * y, c as u32 + 10 * i));
        let o = MakeOptions { swrap: Wrap::Periodic, resize: i % 2 == 0, ..MakeOptions::default() };
        folder.make(&["n.tif"], &format!("{i}.tx"), &o).unwrap();
    }
    folder
}

fn lookup(i: u32) -> Lookup {
    let r = |k| random(i, k);
    let scale = 0.5_f32.powf(10.0 * r(2));
    Lookup {
        s: r(0),
        t: r(1),
        dsdx: (r(3) - 0.5) * scale,
        dtdx: (r(4) - 0.5) * scale,
        dsdy: (r(5) - 0.5) * scale,
        dtdy: (r(6) - 0.5) * scale,
        ..Lookup::default()
    }
}

fn answer(cache: &TextureCache, i: u32) -> Vec<u32> {
    let id = cache.find(&format!("{}.tx", i % FILES)).unwrap();
    let mut out = [0.0; 4];
    cache.texture(id, &lookup(i), &mut out);
    bits(&out)
}

const N: u32 = 2000;

#[test]
fn lookups_do_not_depend_on_memory_and_file_limits() {
    let folder = folder();
    let all = folder.cache(CacheOptions { memory_bytes: 1 << 30, ..CacheOptions::default() });
    let expected: Vec<_> = (0..N).map(|i| answer(&all, i)).collect();
    let tile = 64 * 64 * 3 * 4;
    for memory_bytes in [0, tile, 3 * tile + 5, 40 * tile] {
        for max_files in [1, 3] {
            let cache = folder.cache(CacheOptions { memory_bytes, max_files, ..CacheOptions::default() });
            // The lookups run backwards, because the order must not matter either.
            for i in (0..N / 10).rev() {
                assert_eq!(answer(&cache, i), expected[i as usize], "{memory_bytes} {max_files} {i}");
            }
            let s = cache.statistics();
            assert!(s.peak_bytes <= memory_bytes, "{s:?}");
            assert!(s.peak_files_open <= max_files as u64, "{s:?}");
            assert!(s.tiles_read >= all.statistics().tiles_read.min(100));
        }
    }
}

#[test]
fn lookups_do_not_depend_on_threads() {
    let folder = folder();
    let one = folder.cache(CacheOptions::default());
    let expected: Vec<_> = (0..N).map(|i| answer(&one, i)).collect();
    for memory_bytes in [64 * 64 * 3 * 4 * 4, 1 << 30] {
        let many = folder.cache(CacheOptions { memory_bytes, max_files: 2, ..CacheOptions::default() });
        std::thread::scope(|scope| {
            for thread in 0..8 {
                let (many, expected) = (&many, &expected);
                scope.spawn(move || {
                    for k in 0..N / 4 {
                        let i = (k * 7 + thread * 31) % N;
                        assert_eq!(answer(many, i), expected[i as usize]);
                    }
                });
            }
        });
        let s = many.statistics();
        assert!(s.peak_bytes <= memory_bytes && s.peak_files_open <= 2, "{s:?}");
    }
}

#[test]
fn only_needed_tiles_are_read() {
    let folder = Folder::new();
    folder.image("big.tif", (512, 512), 1, |x, _, _| x as f32);
    folder.make(&["big.tif"], "big.tx", &MakeOptions::default()).unwrap();
    let (cache, id) = folder.open("big.tx");
    assert_eq!(cache.statistics().tiles_read, 0);
    let mut out = [0.0];
    cache.texture(id, &support::at(100.5 / 512.0, 100.5 / 512.0), &mut out);
    assert_eq!(out[0], 100.0);
    let s = cache.statistics();
    assert_eq!((s.tiles_read, s.tile_bytes, s.files, s.files_opened), (1, 64 * 64 * 4, 1, 1));
}

#[test]
fn a_damaged_tile_is_black_and_reported_once() {
    let folder = Folder::new();
    folder.image("d.tif", (128, 128), 1, |x, y, _| random(x, y));
    folder.make(&["d.tif"], "d.tx", &MakeOptions::default()).unwrap();
    let path = folder.path("d.tx");
    let mut bytes = std::fs::read(&path).unwrap();
    // The tiles are stored before the directories.
    let end = bytes.len() / 2;
    bytes[64..end].fill(0xff);
    std::fs::write(&path, bytes).unwrap();
    let (cache, id) = folder.open("d.tx");
    let mut out = [1.0];
    for _ in 0..2 {
        cache.texture(id, &support::at(0.2, 0.2), &mut out);
        assert!(out[0].is_finite());
    }
    let errors = folder.texts().into_iter().filter(|t| t.contains("cannot be read")).count();
    assert_eq!(errors, 1, "{:?}", folder.texts());
}

#[test]
fn information_about_textures_is_returned() {
    let folder = Folder::new();
    folder.image("i.tif", (64, 32), 3, |_, _, _| 0.5);
    folder.make(&["i.tif"], "i.tx", &MakeOptions::default()).unwrap();
    let (cache, _) = folder.open("i.tx");
    let floats = |what| cache.info("i.tx", what).and_then(|p| p.data.to_floats()).map(|v| v.to_vec());
    assert_eq!(floats("resolution"), Some(vec![64.0, 32.0]));
    assert_eq!(floats("channels"), Some(vec![3.0]));
    assert_eq!(cache.info("i.tx", "type").unwrap().data, "texture".into());
    assert_eq!(cache.info("i.tx", "textureformat").unwrap().data, "Plain Texture".into());
    assert!(cache.info("i.tx", "viewingmatrix").is_none());
    assert!(cache.info("i.tx", "colour").is_none());
    assert!(cache.info("no.tx", "type").is_none());
}

/// Some files have headers that declare far more data than the file holds. Their texels are black, they need hardly any
/// time or memory, and one message reports each.
#[test]
fn a_truncated_file_of_any_claimed_size_is_black() {
    const SIDE: u16 = 65535;
    let folder = Folder::new();
    let row = vec![7_u8; 3 * usize::from(SIDE)];
    let sgi = {
        let mut head =
            [&[1, 218, 0, 1, 0, 3][..], &SIDE.to_be_bytes(), &SIDE.to_be_bytes(), &[0, 3]].concat();
        head.resize(512, 0);
        head
    };
    let files = [
        ("a.ppm", [format!("P6 {SIDE} {SIDE} 255\n").as_bytes(), &row].concat()),
        ("b.sgi", sgi),
        ("c.png", {
            let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\xff\xff\0\0\xff\xff\x08\x02\0\0\0".to_vec();
            png.extend(png_sum(&png[12..]));
            // The data is long enough that the image could be complete. No block of deflate begins with these bytes.
            let data = [&b"IDAT\x78\x9c"[..], &[0xff; 600_000]].concat();
            png.extend((data.len() as u32 - 4).to_be_bytes());
            png.extend(&data);
            png.extend(png_sum(&data));
            png
        }),
    ];
    for (name, bytes) in files {
        std::fs::write(folder.path(name), bytes).unwrap();
        let (cache, id) = folder.open(name);
        let mut reader = cache.reader();
        for i in 0..200 {
            let mut out = [1.0; 3];
            reader.texture(id, &lookup(i), &mut out);
            assert_eq!(out, [0.0; 3], "{name}");
        }
        drop(reader);
        let s = cache.statistics();
        assert!(s.automipmap_bytes < 1 << 20 && s.files_opened == 2, "{name}: {s:?}");
        // Only the first lookup filters.
        assert!(s.tile_requests < 20 && s.probes < 200, "{name}: {s:?}");
        let texts = std::mem::take(&mut *folder.messages.lock());
        assert_eq!(texts.len(), 1, "{texts:?}");
    }
}

/// Returns the check sum of a chunk of PNG.
fn png_sum(bytes: &[u8]) -> [u8; 4] {
    let mut sum = u32::MAX;
    for byte in bytes {
        sum ^= u32::from(*byte);
        for _ in 0..8 {
            sum = if sum & 1 == 1 { sum >> 1 ^ 0xedb8_8320 } else { sum >> 1 };
        }
    }
    (!sum).to_be_bytes()
}

/// Levels made in memory are always kept, so a thread that reads two of them keeps both.
#[test]
fn levels_in_memory_do_not_evict_each_other() {
    let folder = Folder::new();
    for name in ["a.tif", "b.tif"] {
        folder.image(name, (600, 600), 3, |x, y, _| random(x, y));
    }
    let cache = folder.cache(CacheOptions::default());
    let ids = ["a.tif", "b.tif"].map(|name| cache.find(name).unwrap());
    let mut reader = cache.reader();
    for i in 0..100 {
        for id in ids {
            reader.texture(id, &support::at(random(i, 1), random(i, 2)), &mut [0.0; 3]);
        }
    }
    drop(reader);
    assert_eq!(cache.statistics().tile_requests, 2);
}

/// A TIFF format whose files can be opened only a few at once.
struct Scarce {
    inner: Arc<dyn Format>,
    open: Arc<AtomicUsize>,
    most: usize,
}

struct ScarceInput(Box<dyn ImageInput>, Arc<AtomicUsize>);

impl Drop for ScarceInput {
    fn drop(&mut self) {
        self.1.fetch_sub(1, Ordering::SeqCst);
    }
}

impl ImageInput for ScarceInput {
    fn format_name(&self) -> &'static str {
        self.0.format_name()
    }
    fn levels(&self, image: usize) -> usize {
        self.0.levels(image)
    }
    fn spec(&self, image: usize, level: usize) -> Option<&ImageSpec> {
        self.0.spec(image, level)
    }
    fn read_rows(&self, image: usize, level: usize, y0: u32, y1: u32) -> granita_image::Result<Pixels> {
        self.0.read_rows(image, level, y0, y1)
    }
    fn read_tile(&self, image: usize, level: usize, tx: u32, ty: u32) -> granita_image::Result<Pixels> {
        self.0.read_tile(image, level, tx, ty)
    }
    fn bytes_read(&self) -> u64 {
        self.0.bytes_read()
    }
}

impl Format for Scarce {
    fn name(&self) -> &'static str {
        self.inner.name()
    }
    fn extensions(&self) -> &'static [&'static str] {
        self.inner.extensions()
    }
    fn recognizes(&self, head: &[u8]) -> bool {
        self.inner.recognizes(head)
    }
    fn open(&self, path: &Path, limits: &Limits) -> granita_image::Result<Box<dyn ImageInput>> {
        if self.open.fetch_add(1, Ordering::SeqCst) >= self.most {
            self.open.fetch_sub(1, Ordering::SeqCst);
            let source = std::io::Error::from_raw_os_error(24);
            return Err(ImageError::Io { path: path.to_owned(), source });
        }
        Ok(Box::new(ScarceInput(self.inner.open(path, limits)?, self.open.clone())))
    }
    fn supports(&self, feature: &str) -> bool {
        self.inner.supports(feature)
    }
    fn create(
        &self,
        path: &Path,
        options: &CreateOptions<'_>,
    ) -> granita_image::Result<Box<dyn ImageOutput>> {
        self.inner.create(path, options)
    }
}

/// Where the system refuses to open more files than the option permits, others are closed. Results stay the same, and
/// there is no message.
#[cfg(unix)]
#[test]
fn files_that_the_system_refuses_to_open_are_opened_later() {
    let mut folder = folder();
    let one = folder.cache(CacheOptions::default());
    let expected: Vec<_> = (0..N / 4).map(|i| answer(&one, i)).collect();
    for most in [1, 2, 4] {
        let open = Arc::new(AtomicUsize::new(0));
        let inner = granita_plugin::bundled_formats(Limits::default()).by_name("tiff").unwrap();
        folder.registry.register(Arc::new(Scarce { inner, open, most }));
        let many =
            folder.cache(CacheOptions { memory_bytes: 64 * 64 * 3 * 4 * 4, ..CacheOptions::default() });
        // There are as many threads as files. A thread whose request is refused while all files are in use has to wait.
        std::thread::scope(|scope| {
            for thread in 0..most.max(2) as u32 {
                let (many, expected) = (&many, &expected);
                scope.spawn(move || {
                    for k in 0..N / 4 {
                        let i = (k * 7 + thread * 31) % (N / 4);
                        assert_eq!(answer(many, i), expected[i as usize]);
                    }
                });
            }
        });
        assert!(folder.texts().is_empty(), "{most}: {:?}", folder.texts());
    }
}

/// A texture that a lookup needs and that does not exist is an error, once. A query about it is not an error.
#[test]
fn a_missing_texture_is_an_error_for_lookups_but_not_queries() {
    let folder = Folder::new();
    let cache = folder.cache(CacheOptions::default());
    for _ in 0..3 {
        assert!(cache.info("nosuch.tx", "resolution").is_none());
        assert!(cache.info("asked.tx", "type").is_none());
    }
    assert_eq!((folder.texts().len(), folder.reporter.errors()), (2, 0), "{:?}", folder.texts());
    assert!(folder.texts()[0].contains("warning: texture \"nosuch.tx\" not found"), "{:?}", folder.texts());
    for _ in 0..3 {
        assert!(cache.find("nosuch.tx").is_none() && cache.find("other.tx").is_none());
        assert!(cache.info("other.tx", "type").is_none());
    }
    assert_eq!((folder.texts().len(), folder.reporter.errors()), (4, 2), "{:?}", folder.texts());
    assert!(folder.texts()[2].contains("error: texture \"nosuch.tx\" not found"), "{:?}", folder.texts());
}
