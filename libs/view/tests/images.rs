//! Tests files of real formats, from opening to the screen.

#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use granita_image::{CreateOptions, FormatRegistry, ImageSpec, Limits, PixelRect, PixelType, Pixels};
use granita_texture::make::{MakeOptions, Mode, make};
use granita_view::{
    Around, Arrangement, Background, Display, Image, Mix, Shown, StoreLimits, TILE, TileStore, View, ascii,
    draw, save_canvas, save_pixels, statistics, suited, thumbnail,
};
use std::path::{Path, PathBuf};

fn formats() -> FormatRegistry {
    granita_plugin::bundled_formats(Limits::default())
}

/// Writes an image of the values `value(x, y, channel)`.
fn write(path: &Path, format: &str, spec: &ImageSpec, value: impl Fn(u32, u32, usize) -> f32) {
    let n = spec.nchannels();
    let at = |i: usize| {
        let (pixel, c) = (i / n, i % n);
        value((pixel % spec.width as usize) as u32, (pixel / spec.width as usize) as u32, c)
    };
    let values: Vec<f32> = (0..spec.width as usize * spec.height as usize * n).map(at).collect();
    let mut file = formats().create(path, format, &CreateOptions::new(spec, 1)).unwrap();
    file.write_rows(&Pixels::from_floats(spec.pixel_type, &values)).unwrap();
    file.close().unwrap();
}

/// Draws all of the first page, with one screen pixel for each of its pixels.
fn look(image: &Image, display: &Display) -> granita_view::Canvas {
    let page = &image.pages[0];
    let sheet = page.sheet(page.arrangement(), 0);
    let [left, top, right, bottom] = sheet.bounds;
    let view = View {
        width: (right - left) as u32,
        height: (bottom - top) as u32,
        center: ((left + right) / 2.0, (top + bottom) / 2.0),
        zoom: 1.0,
        around: None,
    };
    let shown = Shown { page, sheet: &sheet, layer: 0, display };
    shown.load(&view).unwrap();
    let canvas = draw(shown, None, Mix::First, &view).unwrap();
    assert!(canvas.complete);
    canvas
}

fn open(path: &Path) -> Image {
    Image::open(path, &formats(), &TileStore::default()).unwrap()
}

#[test]
fn every_format_shows_its_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let value = |x: u32, y: u32, c: usize| ((x * 7 + y * 3 + c as u32 * 50) % 256) as f32 / 255.0;
    for (format, tiled) in [
        ("png", None),
        ("tiff", None),
        ("tiff", Some(64)),
        ("tiff", Some(96)),
        ("tiff", Some(304)),
        ("bmp", None),
        ("tga", None),
        ("pnm", None),
        ("sgi", None),
        ("iff", None),
        ("dds", None),
        ("dpx", None),
        ("jpegxl", None),
        ("qoi", None),
        ("webp", None),
    ] {
        let path = folder.path().join(format!("a{tiled:?}.{format}"));
        let mut spec = ImageSpec::new(301, 203, 3, PixelType::U8);
        if let Some(side) = tiled {
            spec = spec.tiled(side, side);
        }
        write(&path, format, &spec, value);
        let canvas = look(&open(&path), &Display::default());
        for (x, y) in [(0, 0), (127, 127), (128, 128), (300, 202), (95, 96), (17, 200)] {
            let wanted = [0, 1, 2].map(|c| (value(x, y, c) * 255.0).round() as u8);
            assert_eq!(canvas.at(x, y), wanted, "{format} {tiled:?} at {x} {y}");
        }
    }
    for format in ["exr", "pfm", "hdr"] {
        let path = folder.path().join(format!("a.{format}"));
        write(&path, format, &ImageSpec::new(150, 140, 3, PixelType::Float), |x, y, _| ((x + y) % 2) as f32);
        let canvas = look(&open(&path), &Display::default());
        assert_eq!((canvas.at(3, 3), canvas.at(149, 138)), ([0; 3], [255; 3]), "{format}");
    }
}

#[test]
fn smaller_levels_are_means_for_rows_and_tiles() {
    let folder = tempfile::tempdir().unwrap();
    let value = |x: u32, y: u32, _| if (x / 4 + y / 4).is_multiple_of(2) { 0.25 } else { 0.75 };
    for (name, spec) in [
        ("rows.exr", ImageSpec::new(1024, 512, 3, PixelType::Half)),
        ("tiles.exr", ImageSpec::new(1024, 512, 3, PixelType::Half).tiled(64, 64)),
    ] {
        let path = folder.path().join(name);
        write(&path, "exr", &spec, value);
        let image = open(&path);
        let display = Display { srgb: false, ..Display::default() };
        let canvas = thumbnail(&image.pages[0], 0, &display, 128).unwrap();
        assert_eq!((canvas.width, canvas.height), (128, 64));
        assert!(canvas.bytes.chunks(4).all(|p| p[..3] == [128; 3]), "{name}: {:?}", canvas.at(64, 32));
    }
}

#[test]
fn tiles_do_not_depend_on_threads_or_earlier_reads() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let value = |x: u32, y: u32, c: usize| (x as f32 * 0.01).sin() + y as f32 * 0.003 + c as f32;
    write(&path, "exr", &ImageSpec::new(700, 500, 4, PixelType::Float).tiled(32, 32), value);
    let image = |store: &TileStore| Image::open(&path, &formats(), store).unwrap();
    let shot = |image: &Image, threads: usize| {
        let page = &image.pages[0];
        let sheet = page.sheet(Arrangement::Stored, 0);
        let mut view = View::fit(333, 222, sheet.bounds);
        view.zoom_at(100.0, 30.0, 0.77);
        let display = Display { exposure: -1.0, background: Background::Checker, ..Display::default() };
        let shown = Shown { page, sheet: &sheet, layer: 0, display: &display };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            shown.load(&view).unwrap();
            draw(shown, None, Mix::First, &view).unwrap()
        })
    };
    let roomy = image(&TileStore::default());
    let narrow = image(&TileStore::new(StoreLimits { others: 1 << 20, spare: 0 }));
    statistics(&roomy.pages[0], 0, PixelRect::at(0, 0, 700, 500)).unwrap();
    let first = shot(&roomy, 1);
    assert_eq!(first, shot(&roomy, 4));
    assert_eq!(first.bytes, shot(&image(&TileStore::default()), 3).bytes);
    let little = shot(&narrow, 2);
    assert!(!little.complete || little.bytes == first.bytes);
}

#[test]
fn nan_pixels_are_visible_at_any_zoom() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let spec = ImageSpec::new(1000, 1000, 3, PixelType::Float);
    write(&path, "exr", &spec, |x, y, _| if (x, y) == (700, 300) { f32::NAN } else { 0.5 });
    let image = open(&path);
    let canvas = thumbnail(&image.pages[0], 0, &Display::default(), 100).unwrap();
    assert!(canvas.bytes.chunks(4).any(|p| p == [255, 0, 255, 255]));
    let s = statistics(&image.pages[0], 0, PixelRect::at(0, 0, 1000, 1000)).unwrap();
    assert_eq!((s[0].nan, s[0].count, s[0].mean), (1, 999_999, 0.5));
    let s = statistics(&image.pages[0], 0, PixelRect::at(699, 299, 3, 3)).unwrap();
    assert_eq!((s[2].nan, s[2].count), (1, 8));
    let s = statistics(&image.pages[0], 0, PixelRect::at(-50, 990, 60, 500)).unwrap();
    assert_eq!(s[1].count, 100, "only what is inside counts");
}

fn textures(folder: &Path, mode: Mode, format: &str) -> PathBuf {
    let (source, out) = (folder.join("ll.exr"), folder.join(format!("{mode:?}.{format}")));
    // Every direction has its own colour.
    let spec = ImageSpec::new(256, 128, 3, PixelType::Float);
    write(&source, "exr", &spec, |x, y, c| {
        let (s, t) = ((x as f32 + 0.5) / 256.0, (y as f32 + 0.5) / 128.0);
        let (phi, theta) = ((s - 0.5) * std::f32::consts::TAU, t * std::f32::consts::PI);
        [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()][c] * 0.5 + 0.5
    });
    let options = MakeOptions { mode, format: format.to_owned(), ..MakeOptions::default() };
    make(&[source], &out, &options, &formats(), &|_, _| ()).unwrap();
    out
}

#[test]
fn environment_crosses_and_panoramas_show_the_directions() {
    let folder = tempfile::tempdir().unwrap();
    let display = Display { srgb: false, ..Display::default() };
    let mut ahead = Vec::new();
    for (mode, format) in [(Mode::EnvCube, "tiff"), (Mode::EnvCube, "exr"), (Mode::EnvLatLong, "exr")] {
        let image = open(&textures(folder.path(), mode, format));
        let page = &image.pages[0];
        assert!(page.is_panorama());
        if mode == Mode::EnvCube {
            let size = page.layout.unwrap().face_size(page.spec()).unwrap().0;
            let canvas = look(&image, &display);
            assert_eq!((canvas.width, canvas.height), (4 * size, 3 * size));
            // Colours continue across each edge of the cross.
            let close = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= 8);
            for i in 0..size {
                for column in 1..4 {
                    let x = column * size;
                    let (a, b) = (canvas.at(x - 1, size + i), canvas.at(x, size + i));
                    assert!(close(a, b), "{format}: edge {column} row {i}: {a:?} {b:?}");
                }
                for row in 1..3 {
                    let y = row * size;
                    let (a, b) = (canvas.at(size + i, y - 1), canvas.at(size + i, y));
                    assert!(close(a, b), "{format}: edge below {row} column {i}: {a:?} {b:?}");
                }
            }
        }
        let sheet = page.sheet(page.arrangement(), 0);
        let shown = Shown { page, sheet: &sheet, layer: 0, display: &display };
        let view = |yaw_deg, pitch_deg| View {
            around: Some(Around { yaw_deg, pitch_deg, fov_deg: 60.0 }),
            ..View::fit(65, 65, sheet.bounds)
        };
        let middle = |yaw, pitch| {
            let view = view(yaw, pitch);
            shown.load(&view).unwrap();
            let canvas = draw(shown, None, Mix::First, &view).unwrap();
            assert!(canvas.complete, "{mode:?} {format}");
            canvas.at(32, 32)
        };
        ahead.push([middle(0.0, 0.0), middle(0.0, 89.9), middle(180.0, 0.0)]);
    }
    // The directions ahead, up and back show the same in the panorama and in the cross.
    for seen in &ahead[1..] {
        for (a, b) in seen.iter().zip(&ahead[2]) {
            assert!(a.iter().zip(b).all(|(a, b)| a.abs_diff(*b) <= 6), "{ahead:?}");
        }
    }
}

#[test]
fn single_faces_equal_their_part_of_the_cross() {
    let folder = tempfile::tempdir().unwrap();
    let image = open(&textures(folder.path(), Mode::EnvCube, "tiff"));
    let page = &image.pages[0];
    let size = page.layout.unwrap().face_size(page.spec()).unwrap().0;
    let cross = look(&image, &Display::default());
    let sheet = page.sheet(Arrangement::Face(4), 0);
    let view = View { zoom: 1.0, ..View::fit(size, size, sheet.bounds) };
    let display = Display::default();
    let shown = Shown { page, sheet: &sheet, layer: 0, display: &display };
    let face = draw(shown, None, Mix::First, &view).unwrap();
    assert_eq!(face.at(5, 7), cross.at(size + 5, size + 7));
    assert_eq!(sheet.pixel_at(5.5, 7.5, 0), Some((2 * size + 5, 7)), "pz is the third of the upper row");
    assert_eq!(sheet.pixel_at(-1.0, 0.0, 0), None);
}

#[test]
fn depth_images_are_scaled_to_their_range() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let mut spec = ImageSpec::new(64, 64, 1, PixelType::Float);
    spec.channels = vec!["Z".to_owned()];
    write(&path, "exr", &spec, |x, y, _| if y < 8 { 1e30 } else { 100.0 + x as f32 });
    let image = open(&path);
    let display = suited(&image.pages[0], 0, &Display::default()).unwrap();
    let canvas = look(&image, &display);
    assert_eq!((canvas.at(0, 20)[0], canvas.at(0, 0)[0]), (255, 0));
    let far = canvas.at(63, 20)[0];
    assert!((20..60).contains(&far), "the farthest is dark, not black: {far}");
    // A computed level keeps the nearest depths.
    let small = thumbnail(&image.pages[0], 0, &display, 8).unwrap();
    assert!(small.at(0, 4)[0] > 235, "{:?}", small.at(0, 4));
}

#[test]
fn two_images_are_compared_by_wipe_and_difference() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (folder.path().join("a.exr"), folder.path().join("b.png"));
    write(&a, "exr", &ImageSpec::new(64, 64, 4, PixelType::Half), |x, _, c| match c {
        3 => x as f32 / 64.0,
        _ => x as f32 / 64.0 * 0.5,
    });
    write(&b, "png", &ImageSpec::new(64, 64, 3, PixelType::U8), |_, y, _| if y < 32 { 0.0 } else { 1.0 });
    let (one, two) = (open(&a), open(&b));
    let sheets = [one.pages[0].sheet(Arrangement::Stored, 0), two.pages[0].sheet(Arrangement::Stored, 0)];
    let display = Display { srgb: false, ..Display::default() };
    let shown = |p: usize| Shown {
        page: [&one.pages[0], &two.pages[0]][p],
        sheet: &sheets[p],
        layer: 0,
        display: &display,
    };
    let view = View { zoom: 1.0, ..View::fit(64, 64, sheets[0].bounds) };
    shown(0).load(&view).unwrap();
    shown(1).load(&view).unwrap();
    let mix = |how| draw(shown(0), Some(shown(1)), how, &view).unwrap();
    let (first, second) = (mix(Mix::First), mix(Mix::Second));
    let wipe = mix(Mix::Wipe { at: 0.5, down: false });
    assert_eq!((wipe.at(31, 40), wipe.at(32, 40)), (first.at(31, 40), second.at(32, 40)));
    let wipe = mix(Mix::Wipe { at: 0.25, down: true });
    assert_eq!((wipe.at(5, 15), wipe.at(5, 16)), (first.at(5, 15), second.at(5, 16)));
    let difference = mix(Mix::Difference { gain: 2.0 });
    assert_eq!((difference.at(32, 0)[0], difference.at(32, 40)[0]), (128, 255));
    let over = mix(Mix::Over);
    assert_eq!((over.at(32, 0)[0], over.at(32, 40)[0]), (64, 191));
}

#[test]
fn saved_images_have_the_shown_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let mut spec = ImageSpec::new(200, 150, 5, PixelType::Half);
    spec.channels = ["R", "G", "B", "A", "Z"].map(str::to_owned).to_vec();
    write(&path, "exr", &spec, |x, y, c| (x + y) as f32 / 350.0 + c as f32);
    let image = open(&path);
    let page = &image.pages[0];
    let copy = folder.path().join("b.exr");
    save_pixels(page, None, &copy, &formats()).unwrap();
    let all = |p: &Path| formats().open(p).unwrap().read_level(0, 0).unwrap();
    assert_eq!(all(&path), all(&copy));
    let layer = folder.path().join("c.tif");
    save_pixels(page, Some(1), &layer, &formats()).unwrap();
    assert_eq!(formats().open(&layer).unwrap().spec(0, 0).unwrap().nchannels(), 1);
    assert!(save_pixels(page, None, &folder.path().join("d.png"), &formats()).is_err(), "five channels");
    let png = folder.path().join("e.png");
    let canvas = look(&image, &Display::default());
    save_canvas(&canvas, &png, &formats()).unwrap();
    assert_eq!(look(&open(&png), &Display::default()).bytes, canvas.bytes);
    assert!(save_canvas(&canvas, &folder.path().join("f.nothing"), &formats()).is_err());
    let text = ascii(page, 0, &Display::default(), 20, false).unwrap();
    assert_eq!(text.lines().count(), 8);
    assert!(ascii(page, 0, &Display::default(), 20, true).unwrap().contains("\x1b[38;2;"));
}

#[test]
fn large_images_in_rows_are_read_in_bands() {
    // The image is large only in size. Its content packs well.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    let (width, height) = (16384_u32, 8448_u32);
    let mut spec = ImageSpec::new(width, height, 4, PixelType::U8);
    spec.attributes.set(granita_base::Param::declared("string compression", "zip:1").unwrap());
    let mut file = formats().create(&path, "tiff", &CreateOptions::new(&spec, 1)).unwrap();
    for y in (0..height).step_by(32) {
        file.write_rows(&Pixels::U8(vec![(y / 256 * 7) as u8; width as usize * 32 * 4])).unwrap();
    }
    file.close().unwrap();
    let store = TileStore::new(StoreLimits { others: 16 << 20, spare: 1 << 20 });
    let image = Image::open(&path, &formats(), &store).unwrap();
    let page = &image.pages[0];
    let sheet = page.sheet(Arrangement::Stored, 0);
    let display = Display::default();
    let shown = Shown { page, sheet: &sheet, layer: 0, display: &display };
    let view = View::fit(256, 132, sheet.bounds);
    let needs = shown.needs(&view);
    store.look_at(&page.pyramid.in_sight(needs.level, needs.tiles.len() as u64));
    shown.load(&view).unwrap();
    let canvas = draw(shown, None, Mix::First, &view).unwrap();
    assert!(canvas.complete);
    assert_eq!((canvas.at(9, 1), canvas.at(100, 130)), ([0; 3], [(8320 / 256 * 7) as u8; 3]));
    let most = store.bytes().1;
    assert!(most < 140 << 20, "{} MiB of {}", most >> 20, (u64::from(width) * u64::from(height) * 4) >> 20);
    assert_eq!(TILE, 128);
}

#[test]
fn coarse_tiles_are_shown_until_fine_ones_arrive() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.exr");
    let spec = ImageSpec::new(2048, 1100, 3, PixelType::Half);
    write(&path, "exr", &spec, |x, y, c| [x as f32 / 2048.0, y as f32 / 1100.0, 0.25][c]);
    let display = Display { srgb: false, ..Display::default() };
    let look = |image: &Image, all: bool| {
        let page = &image.pages[0];
        let sheet = page.sheet(page.arrangement(), 0);
        let view = View::fit(512, 275, sheet.bounds);
        let shown = Shown { page, sheet: &sheet, layer: 0, display: &display };
        if all {
            shown.load(&view).unwrap();
        } else {
            page.pyramid.tile(2, 0, 0).unwrap();
        }
        draw(shown, None, Mix::First, &view).unwrap()
    };
    let plain = open(&path);
    let part = look(&plain, false);
    assert!(!part.complete && !part.covered);
    let whole = look(&plain, true);
    assert!(whole.complete && whole.covered);

    let image = open(&path);
    image.pages[0].pyramid.sketch_first();
    let rough = look(&image, false);
    assert!(rough.covered && !rough.complete);
    for (i, (a, b)) in rough.bytes.iter().zip(&whole.bytes).enumerate() {
        let y = i / 4 / 512;
        // Rows above the first row that was read, and below the last one, equal that row.
        let far = if (18..257).contains(&y) { 4 } else { 20 };
        assert!(a.abs_diff(*b) <= far, "{} {y}: {a} instead of {b}", i / 4 % 512);
    }
    assert!(look(&image, true) == whole, "nothing of it is left");

    // When a part cannot be read, there is no rough image, because missing parts are not invented.
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let cut = open(&path);
    cut.pages[0].pyramid.sketch_first();
    assert!(!look(&cut, false).covered);
}
