//! Options of `make` beyond the reference's: types, colours, broken values, content, memory.
#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use granita_base::{Filter, Param};
use granita_color::Config;
use granita_image::{ImageSpec, PixelType, Pixels};
use granita_texture::TextureKind;
use granita_texture::make::{
    BrokenValues, Bump, BumpFormat, ColorConvert, Conventions, FlatOptions, LevelFilter, Made, MakeOptions,
    Mode,
};
use std::sync::Arc;
use support::{Folder, random};

fn options() -> MakeOptions {
    MakeOptions::default()
}

fn exr() -> MakeOptions {
    MakeOptions { format: "OpenEXR".to_owned(), ..options() }
}

fn notes(made: Made) -> Vec<String> {
    match made {
        Made::Written { notes, .. } => notes,
        Made::UpToDate => Vec::new(),
    }
}

/// Levels of bytes are means of bytes, correctly rounded, for any number of levels.
#[test]
fn levels_of_bytes_are_correctly_rounded_means() {
    let folder = Folder::new();
    folder.image_of("a.tif", ImageSpec::new(256, 256, 3, PixelType::U8), |x, y, c| {
        (random(x + 256 * y, c as u32) * 255.0).floor() / 255.0
    });
    folder.make(&["a.tif"], "a.tx", &options()).unwrap();
    let file = folder.registry.open(&folder.path("a.tx")).unwrap();
    let Pixels::U8(first) = file.read_level(0, 0).unwrap() else { panic!() };
    for level in 0..9 {
        let (n, step) = (256_usize >> level, 1_usize << level);
        let Pixels::U8(got) = file.read_level(0, level).unwrap() else { panic!() };
        for (i, v) in got.iter().enumerate() {
            let (c, x, y) = (i % 3, i / 3 % n, i / 3 / n);
            let mut sum = 0_u32;
            for sy in 0..step {
                for sx in 0..step {
                    sum += u32::from(first[((y * step + sy) * 256 + x * step + sx) * 3 + c]);
                }
            }
            let count = (step * step) as u32;
            assert_eq!(u32::from(*v), (2 * sum + count) / (2 * count), "level {level} texel {x} {y} {c}");
        }
    }
}

#[test]
fn pixel_types_are_stored_or_replaced_with_a_note() {
    let folder = Folder::new();
    folder.image_of("a.tif", ImageSpec::new(16, 16, 1, PixelType::U8), |x, _, _| x as f32 / 15.0);
    let stored = |o: MakeOptions| {
        let told = notes(folder.make(&["a.tif"], "a.tx", &o).unwrap());
        let file = folder.registry.open(&folder.path("a.tx")).unwrap();
        let values = file.read_level(0, 0).unwrap().to_floats();
        for (i, v) in values.iter().enumerate() {
            assert!((v - (i % 16) as f32 / 15.0).abs() < 1e-3);
        }
        (file.spec(0, 0).unwrap().pixel_type, told)
    };
    for t in [PixelType::U8, PixelType::U16, PixelType::Half, PixelType::Float] {
        assert_eq!(stored(MakeOptions { pixel_type: Some(t), ..options() }), (t, vec![]));
    }
    for t in [PixelType::Half, PixelType::Float] {
        assert_eq!(stored(MakeOptions { pixel_type: Some(t), ..exr() }), (t, vec![]));
    }
    let (t, told) = stored(MakeOptions { pixel_type: Some(PixelType::U8), ..exr() });
    assert_eq!((t, told.len()), (PixelType::Half, 1));
    assert!(told[0].contains("half, not uint8"), "{told:?}");
    // Without the option the type is that of the reference for the format.
    assert_eq!(stored(options()).0, PixelType::U8);
    assert_eq!(stored(exr()).0, PixelType::Half);
}

/// Returns the conversion from one colour space to another, with levels in linear light.
fn converted(from: &str, to: &str) -> Arc<ColorConvert> {
    let config = Config::built_in();
    let linear = config.linear_for(to).unwrap();
    Arc::new(ColorConvert {
        inputs: config.processor(from, linear).unwrap(),
        outputs: config.processor(linear, to).unwrap(),
        same: from == to,
        ..ColorConvert::default()
    })
}

#[test]
fn colours_are_averaged_in_linear_light() {
    let folder = Folder::new();
    folder.image_of("a.tif", ImageSpec::new(4, 4, 4, PixelType::U8), |x, _, c| {
        if c == 3 { 1.0 } else { (x % 2) as f32 }
    });
    let first = |from, to| {
        let o = MakeOptions { color_convert: Some(converted(from, to)), ..options() };
        folder.make(&["a.tif"], "a.tx", &o).unwrap();
        let file = folder.registry.open(&folder.path("a.tx")).unwrap();
        let Pixels::U8(v) = file.read_level(0, 1).unwrap() else { panic!() };
        [v[0], v[1], v[2], v[3]]
    };
    assert_eq!(first("linear", "linear"), [128, 128, 128, 255]);
    // Half the light of white is 188 in sRGB.
    assert_eq!(first("srgb", "srgb"), [188, 188, 188, 255]);
    assert_eq!(first("srgb", "linear"), [128, 128, 128, 255]);
    assert_eq!(first("linear", "acescg"), [128, 128, 128, 255]);
}

/// The profile describes the stored colours, and is lost with them. Other metadata is kept.
#[test]
fn profiles_are_carried_unless_colours_are_converted() {
    let folder = Folder::new();
    let mut spec = ImageSpec::new(16, 16, 3, PixelType::U8);
    spec.set_icc_profile(vec![7; 200]);
    spec.attributes.set(Param::declared("string Exif:LensModel", "50 mm").unwrap());
    folder.image_of("a.tif", spec, |x, _, _| x as f32 / 15.0);
    for (o, kept) in [
        (options(), true),
        (exr(), true),
        (MakeOptions { mode: Mode::EnvLatLong, ..options() }, true),
        (MakeOptions { color_convert: Some(converted("srgb", "srgb")), ..options() }, true),
        (MakeOptions { color_convert: Some(converted("srgb", "linear")), ..options() }, false),
        (MakeOptions { ingamma: 2.2, ..options() }, false),
    ] {
        folder.make(&["a.tif"], "a.tx", &o).unwrap();
        let file = folder.registry.open(&folder.path("a.tx")).unwrap();
        let spec = file.spec(0, 0).unwrap();
        assert_eq!(spec.icc_profile.as_deref(), kept.then_some(&[7; 200][..]), "{o:?}");
        assert_eq!(spec.string("ICCProfile"), kept.then_some("200 bytes"));
        assert_eq!(spec.string("Exif:LensModel"), Some("50 mm"));
        // The directories of the levels of TIFF do not repeat it.
        assert!(o == exr() || file.spec(0, 1).unwrap().icc_profile.is_none());
    }
}

/// Colours that are not multiplied by alpha are multiplied as linear light. The file no longer declares that they are
/// not.
#[test]
fn unassociated_alpha_is_multiplied_in() {
    let folder = Folder::new();
    let mut spec = ImageSpec::new(2, 2, 4, PixelType::Float);
    spec.attributes.set(Param::declared("int unassociatedalpha", 1).unwrap());
    folder.image_of("a.tif", spec, |x, _, c| match (c, x) {
        (3, 0) => 0.0,
        (3, _) => 0.5,
        _ => 1.0,
    });
    folder.make(&["a.tif"], "a.tx", &options()).unwrap();
    let file = folder.registry.open(&folder.path("a.tx")).unwrap();
    assert_eq!(file.read_level(0, 0).unwrap().to_floats()[..8], [0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.5, 0.5]);
    assert_eq!(file.read_level(0, 1).unwrap().to_floats(), [0.25; 4]);
    assert_eq!(file.spec(0, 0).unwrap().attributes.int("unassociatedalpha").unwrap_or(0), 0);
}

#[test]
fn invalid_values_are_refused_or_replaced() {
    let folder = Folder::new();
    folder.image("a.tif", (8, 8), 2, |x, y, c| match (x, y, c) {
        (3, 2, 1) => f32::NAN,
        (7, 7, 0) => f32::NEG_INFINITY,
        _ => x as f32,
    });
    let refuse = MakeOptions { broken_values: BrokenValues::Refuse, ..options() };
    let error = folder.make(&["a.tif"], "a.tx", &refuse).unwrap_err().to_string();
    assert!(error.contains("pixel (3, 2)") && error.contains("NaN"), "{error}");
    assert!(!folder.path("a.tx").exists());
    let fix = MakeOptions { broken_values: BrokenValues::Fix, ..options() };
    for mode in [Mode::Plain, Mode::EnvLatLong] {
        let told = notes(folder.make(&["a.tif"], "a.tx", &MakeOptions { mode, ..fix.clone() }).unwrap());
        assert!(told[0].contains("2 values"), "{told:?}");
        let file = folder.registry.open(&folder.path("a.tx")).unwrap();
        let v = file.read_level(0, 0).unwrap().to_floats();
        assert_eq!(v[(2 * 8 + 3) * 2 + 1], 3.0);
        // At the corner three texels remain: 6, 6 and 7.
        assert!((v[(7 * 8 + 7) * 2] - 19.0 / 3.0).abs() < 1e-5);
    }
    // An image without any finite value becomes 0.
    folder.image("b.tif", (4, 4), 1, |_, _, _| f32::NAN);
    folder.make(&["b.tif"], "b.tx", &fix).unwrap();
    let file = folder.registry.open(&folder.path("b.tx")).unwrap();
    assert!(file.read_level(0, 0).unwrap().to_floats().iter().all(|v| *v == 0.0));
}

#[test]
fn hashes_change_with_the_pixels() {
    let folder = Folder::new();
    let paint = |name: &str, v: f32| {
        folder.image(name, (20, 20), 3, |x, y, _| if (x, y) == (9, 9) { v } else { 0.5 })
    };
    paint("a.tif", 0.1);
    paint("b.tif", 0.2);
    let words = |input: &str, o: MakeOptions| {
        folder.make(&[input], "x.tx", &MakeOptions { hash: true, ..o }).unwrap();
        let file = folder.registry.open(&folder.path("x.tx")).unwrap();
        let s = file.spec(0, 0).unwrap().clone();
        if s.string("oiio:SHA-1").is_some() {
            return format!("{} {}", s.string("oiio:SHA-1").unwrap(), s.string("oiio:AverageColor").unwrap());
        }
        s.string("ImageDescription").unwrap().to_owned()
    };
    let a = words("a.tif", options());
    assert!(a.starts_with("oiio:SHA-1=") && a.contains(" oiio:AverageColor=0.4"), "{a}");
    assert_eq!(a, words("a.tif", MakeOptions { tile_size: (16, 16), separate: true, ..options() }));
    assert_ne!(a, words("b.tif", options()));
    // A texture of a texture has one hash, its own.
    std::fs::rename(folder.path("x.tx"), folder.path("c.tx")).unwrap();
    assert_eq!(words("c.tx", options()).matches("SHA-1").count(), 1);
    assert_ne!(words("a.tif", exr()), words("b.tif", exr()));
    let mode = MakeOptions { mode: Mode::VertCross, ..options() };
    folder.image("v.tif", (12, 16), 1, |x, _, _| x as f32);
    assert!(words("v.tif", mode).contains("SHA-1="));
}

#[test]
fn constant_images_take_one_tile() {
    let folder = Folder::new();
    folder.image("a.tif", (300, 200), 3, |_, _, c| 0.2 + c as f32);
    folder.image("b.tif", (300, 200), 1, |x, y, _| f32::from((x, y) == (299, 199)));
    let o = |mode| MakeOptions { mode, constant_color: true, ..options() };
    for mode in [Mode::Plain, Mode::EnvLatLong] {
        let made = folder.make(&["a.tif"], "a.tx", &o(mode)).unwrap();
        assert_eq!(made, Made::Written { width: 64, height: 64, levels: 7, notes: vec![] });
        let file = folder.registry.open(&folder.path("a.tx")).unwrap();
        for level in 0..7 {
            let values = file.read_level(0, level).unwrap().to_floats();
            assert!(values.chunks(3).all(|p| p == [0.2, 1.2, 2.2]));
        }
        let made = folder.make(&["b.tif"], "b.tx", &o(mode)).unwrap();
        assert!(matches!(made, Made::Written { width: 512, height: 256, .. }));
    }
}

/// A streamed texture does not depend on the permitted memory. The error of any other one names the option.
/// By the conventions of OpenImageIO, most plain textures are made in bands. An option that changes nothing here makes
/// them as a whole.
#[test]
fn textures_that_are_made_in_bands_are_those_made_as_a_whole() {
    let folder = Folder::new();
    let height = || Bump { format: BumpFormat::Height, uv_scale: 2.0, ..Bump::default() };
    let cases: [(usize, PixelType, &str, Option<Bump>); 8] = [
        (3, PixelType::U8, "box", None),
        (4, PixelType::U8, "lanczos3", None),
        (1, PixelType::U16, "mitchell", None),
        (3, PixelType::Half, "box", None),
        (5, PixelType::Float, "catmull-rom", None),
        (1, PixelType::U16, "box", Some(Bump::default())),
        (3, PixelType::U8, "box", Some(Bump::default())),
        (2, PixelType::Half, "gaussian", Some(height())),
    ];
    for (i, (n, pixel_type, filter, bump)) in cases.into_iter().enumerate() {
        // A hash has a part for each 256 rows.
        let size = if i % 2 == 0 { (37, 300) } else { (64, 33) };
        folder.image_of("a.tif", ImageSpec::new(size.0, size.1, n, pixel_type), |x, y, c| {
            random(x + 300 * y, (c + 8 * i) as u32)
        });
        let inputs = Config::built_in().processor("lin_rec709", "srgb").unwrap();
        let encoded = ColorConvert { inputs, ..ColorConvert::default() };
        for colors in [None, Some(Arc::new(encoded))] {
            let flat = FlatOptions {
                conventions: Conventions::OpenImageIo,
                filter: LevelFilter::from_word(filter),
                bump,
                ..FlatOptions::default()
            };
            let bands = MakeOptions { flat, color_convert: colors, resize: false, ..exr() };
            let mut whole = bands.clone();
            whole.flat.drop_opaque = true;
            for format in ["OpenEXR", "tiff"] {
                let made = |options: &MakeOptions, threads: usize| {
                    let options = MakeOptions { format: format.to_owned(), ..options.clone() };
                    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                    pool.install(|| folder.make(&["a.tif"], "a.tx", &options)).unwrap();
                    std::fs::read(folder.path("a.tx")).unwrap()
                };
                let expected = made(&whole, 1);
                assert!(made(&bands, 1) == expected, "{i} {format}");
                assert!(made(&bands, 3) == expected, "{i} {format}, 3 threads");
            }
        }
    }
    // Images of one colour and values that are not finite are treated as a whole, whatever the options.
    folder.image_of("a.tif", ImageSpec::new(300, 200, 1, PixelType::Float), |x, _, _| {
        if x == 7 { f32::NAN } else { 0.5 }
    });
    let flat = FlatOptions { conventions: Conventions::OpenImageIo, ..FlatOptions::default() };
    let fixed = MakeOptions { flat, broken_values: BrokenValues::Fix, resize: false, ..exr() };
    let told = notes(folder.make(&["a.tif"], "a.tx", &fixed).unwrap());
    assert!(told[0].contains("200 pixels with values that are not finite were replaced"), "{told:?}");
}

#[test]
fn a_memory_limit_does_not_change_the_texture() {
    let folder = Folder::new();
    folder.image("a.tif", (700, 900), 3, |x, y, c| random(x + 700 * y, c as u32));
    let bytes = |o: &MakeOptions| {
        folder.make(&["a.tif"], "a.tx", o).unwrap();
        std::fs::read(folder.path("a.tx")).unwrap()
    };
    for o in [
        options(),
        MakeOptions { mode: Mode::EnvLatLong, ..options() },
        MakeOptions { filter: Filter::Mitchell, ..exr() },
    ] {
        assert_eq!(bytes(&MakeOptions { memory_bytes: 1 << 20, ..o.clone() }), bytes(&o));
    }
    folder.image("v.tif", (300, 400), 3, |_, _, _| 0.5);
    let o = MakeOptions { mode: Mode::VertCross, memory_bytes: 1 << 20, ..options() };
    let error = folder.make(&["v.tif"], "v.tx", &o).unwrap_err().to_string();
    assert!(error.contains("-memory") && !folder.path("v.tx").exists(), "{error}");
}

/// Streaming results in the same pixels as the same operations on the whole image, for all filters, wraps and formats.
#[test]
fn levels_are_filtered_over_the_border_by_wrap_mode() {
    let folder = Folder::new();
    folder.image("a.tif", (24, 40), 1, |_, y, _| f32::from(y >= 38));
    for filter in Filter::ALL {
        for (wrap, over) in [("periodic", true), ("clamp", false), ("mirror", false), ("black", false)] {
            let wrap = granita_texture::Wrap::from_word(wrap).unwrap();
            let o = MakeOptions { twrap: wrap, swrap: wrap, filter, resize: false, ..options() };
            folder.make(&["a.tif"], "a.tx", &o).unwrap();
            let file = folder.registry.open(&folder.path("a.tx")).unwrap();
            let top = file.read_level(0, 1).unwrap().get(0);
            let wide = !matches!(filter, Filter::Box | Filter::CatmullRom | Filter::Sinc | Filter::Mitchell);
            assert!(if over && wide { top > 0.0 } else { top < 1e-3 || over }, "{filter:?} {wrap:?}: {top}");
        }
    }
}

/// Every kind of map can be made in every format, for any size of the input. Faces get a side that the format can tile.
#[test]
fn every_mode_works_with_every_format_and_size() {
    let folder = Folder::new();
    let grey = |x: u32, y: u32, _: usize| 0.25 + 0.01 * ((x + y) % 7) as f32;
    for (name, size) in [
        ("square.tif", (75, 75)),
        ("latl.tif", (100, 50)),
        ("cross.tif", (57, 76)),
        ("small.tif", (19, 19)),
        ("odd.tif", (37, 21)),
    ] {
        folder.image(name, size, 3, grey);
    }
    folder.image("z.tif", (37, 37), 1, |_, _, _| 2.0);
    folder.image("vol.tif", (37, 37), 5, |_, _, c| [1e30, 0.5, 1.0, 2.0, 3.0][c]);
    let modes: [(Mode, &[&str]); 10] = [
        (Mode::Plain, &["odd.tif"]),
        (Mode::EnvCube, &["small.tif"; 6]),
        (Mode::EnvCube, &["latl.tif"]),
        (Mode::EnvLatLong, &["odd.tif"]),
        (Mode::EnvLatLong, &["small.tif"; 6]),
        (Mode::LightProbe, &["square.tif"]),
        (Mode::VertCross, &["cross.tif"]),
        (Mode::Shadow, &["z.tif"]),
        (Mode::ShadCube, &["z.tif"; 6]),
        (Mode::VolShad, &["vol.tif"]),
    ];
    for (mode, inputs) in modes {
        for format in ["tiff", "OpenEXR"] {
            for resize in [false, true] {
                for tile in [64, 24] {
                    let o = MakeOptions {
                        mode,
                        format: format.to_owned(),
                        resize,
                        tile_size: (tile, tile),
                        mcamera: Some(IDENTITY),
                        mscreen: Some(IDENTITY),
                        ..options()
                    };
                    let what = format!("{mode:?} {format} resize {resize} tiles {tile}");
                    let made = folder.make(inputs, "map", &o).unwrap_or_else(|e| panic!("{what}: {e}"));
                    let told = notes(made);
                    let (cache, id) = folder.open("map");
                    assert_eq!(cache.kind(id) == TextureKind::Plain, mode == Mode::Plain, "{what}");
                    // A note reports a size that differs from the option.
                    let faces = matches!(mode, Mode::LightProbe | Mode::VertCross) || (mode == Mode::EnvCube);
                    let rounded = faces && !resize && format == "OpenEXR";
                    assert_eq!(told.iter().any(|n| n.contains("power of two")), rounded, "{what}: {told:?}");
                }
            }
        }
    }
}

const IDENTITY: [f32; 16] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
