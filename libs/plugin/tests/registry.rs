//! Tests the bundled formats together, for names, opening by content, and the files of rendered outputs.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::{Param, Params};
use granita_image::{
    CreateOptions, FormatRegistry, ImageError, ImageSpec, Limits, PixelType, Pixels, Placement, Quantize,
};
use granita_plugin::bundled_formats;

fn registry() -> FormatRegistry {
    bundled_formats(Limits::default())
}

#[test]
fn names_of_the_reference_and_extensions_find_formats() {
    let all = registry();
    for (name, format) in [
        ("tiff", "tiff"),
        ("tif", "tiff"),
        ("shadow", "shadow"),
        ("OpenEXR", "exr"),
        ("exr", "exr"),
        ("jpg", "jpeg"),
        ("png", "png"),
        ("bmp", "bmp"),
        ("tga", "tga"),
        ("TIFF", "tiff"),
    ] {
        assert_eq!(all.by_name(name).map(|f| f.name()), Some(format), "{name}");
    }
    assert!(all.by_name("xyz").is_none());
    let mut names = all.names();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), all.formats().len());
}

#[test]
fn images_of_every_format_are_written_and_opened_by_content() {
    let dir = tempfile::tempdir().unwrap();
    let all = registry();
    let values: Vec<f32> = (0..20 * 10 * 3).map(|i| (i % 60) as f32 / 60.0).collect();
    let mut params = Params::new();
    params.set(Param::declared("float dither", 0.0).unwrap());
    for format in all.formats().iter().filter(|f| f.supports("write") && !f.supports("rectangles")) {
        let (quantize, pixel_type) = Quantize::for_output(&**format, &params);
        let expected = match format.name() {
            "shadow" | "hdr" | "pfm" => PixelType::Float,
            "exr" => PixelType::Half,
            _ => PixelType::U8,
        };
        assert_eq!(pixel_type, expected, "{}", format.name());
        let spec = ImageSpec::new(20, 10, 3, pixel_type);
        // Targa has no signature. The other formats are recognized under a wrong extension.
        let name = if format.name() == "tga" { "a.tga" } else { "image.dat" };
        let path = dir.path().join(name);
        let mut out = all.create(&path, format.name(), &CreateOptions::new(&spec, 1)).unwrap();
        let place = Placement { x: 0, y: 0, width: 20, nchannels: 3, alpha: None };
        out.write_rows(&quantize.apply(&values, &place, pixel_type)).unwrap();
        out.close().unwrap();
        let input = all.open(&path).unwrap();
        let read_by = if format.name() == "shadow" { "tiff" } else { format.name() };
        assert_eq!(input.format_name(), read_by);
        let got = input.read_level(0, 0).unwrap();
        for (i, v) in values.iter().enumerate() {
            let d = (got.get(i) - v).abs();
            assert!(d < 0.1, "{}: value {i} is off by {d}", format.name());
        }
    }
}

#[test]
fn unsupported_pixel_types_are_replaced() {
    let all = registry();
    let stored = |format: &str, levels: [i32; 4]| {
        let mut params = Params::new();
        params.set(Param::declared("int[4] quantize", &levels[..]).unwrap());
        let (quantize, pixel_type) = Quantize::for_output(&*all.by_name(format).unwrap(), &params);
        assert!(quantize.pixel_type() == pixel_type || pixel_type == PixelType::Half);
        pixel_type
    };
    assert_eq!(stored("tiff", [0, 65535, 0, 65535]), PixelType::U16);
    assert_eq!(stored("tiff", [0; 4]), PixelType::Float);
    assert_eq!(stored("png", [0; 4]), PixelType::U16);
    assert_eq!(stored("tga", [0, 65535, 0, 65535]), PixelType::U8);
    assert_eq!(stored("shadow", [0, 255, 0, 255]), PixelType::Float);
    assert_eq!(stored("OpenEXR", [0, 255, 0, 255]), PixelType::Half);
}

#[test]
fn errors_of_opening_name_the_file_and_the_reason() {
    let dir = tempfile::tempdir().unwrap();
    let all = registry();
    let open = |name: &str, bytes: &[u8]| {
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        match all.open(&path) {
            Ok(_) => panic!("{name}"),
            Err(error) => error.to_string(),
        }
    };
    assert!(open("empty.tif", b"").ends_with("empty.tif: the file is empty"));
    let error = open("scene.pyg", b"Parameter (\"x\")");
    assert!(error.contains("not an image of a known format (tiff, shadow, exr"), "{error}");
    let error = open("text.tif", b"not an image at all");
    assert!(error.contains("text.tif: malformed TIFF"), "{error}");
    for (head, name) in [(b"\0\0\0\x1cftypavif\0\0\0\0", "AVIF"), (b"\0\0\0\x18ftypheic\0\0\0\0", "HEIF")] {
        let error = open("photo.heic", head);
        assert!(
            error.contains(&format!("photo.heic: an image of the format {name}, which only a plugin")),
            "{error}"
        );
    }
    let error = all.open(&dir.path().join("none.tif")).err().unwrap();
    assert!(matches!(error, ImageError::Io { .. }) && error.to_string().contains("none.tif"));
    assert!(all.open(dir.path()).is_err());
    let spec = ImageSpec::new(1, 1, 1, PixelType::U8);
    let options = CreateOptions::new(&spec, 1);
    let error = all.create(&dir.path().join("a"), "xyz", &options).err().unwrap().to_string();
    assert!(error.contains("unknown image format \"xyz\" (known: tiff"), "{error}");
}

#[test]
fn metadata_survives_write_and_read() {
    let dir = tempfile::tempdir().unwrap();
    let all = registry();
    for (format, pixel_type, names) in [
        (
            "tiff",
            PixelType::U8,
            &[
                "ImageDescription",
                "DocumentName",
                "Artist",
                "copyright",
                "software",
                "DateTime",
                "Make",
                "Model",
                "HostComputer",
                "XMP",
            ][..],
        ),
        ("shadow", PixelType::Float, &["ImageDescription", "DocumentName", "Artist", "copyright"]),
        (
            "exr",
            PixelType::Half,
            &["ImageDescription", "DocumentName", "Artist", "copyright", "owner", "software", "Anything"],
        ),
        ("png", PixelType::U16, &["ImageDescription", "DocumentName", "Artist", "copyright", "software"]),
        ("sgi", PixelType::U8, &["ImageDescription"]),
        ("iff", PixelType::U8, &["Artist", "DateTime"]),
        (
            "dpx",
            PixelType::U8,
            &["ImageDescription", "DocumentName", "copyright", "software", "dpx:SlateInfo"],
        ),
    ] {
        let mut spec = ImageSpec::new(4, 3, 3, pixel_type);
        // OpenEXR has one attribute for two of these names, so both have the same text.
        let text = |name: &str| format!("{} of J\u{f6}rg", if name == "owner" { "copyright" } else { name });
        for name in names {
            let param = Param::declared(&format!("string {name}"), text(name).as_str()).unwrap();
            spec.attributes.set(param);
        }
        let path = dir.path().join(format);
        let mut out = all.create(&path, format, &CreateOptions::new(&spec, 1)).unwrap();
        out.write_rows(&Pixels::zeros(pixel_type, 36)).unwrap();
        out.close().unwrap();
        let input = all.open(&path).unwrap();
        let got = input.spec(0, 0).unwrap();
        for name in names {
            assert_eq!(got.string(name), Some(text(name).as_str()), "{format}: {name}");
        }
    }
    // The owner of a TIFF is its copyright.
    let mut spec = ImageSpec::new(1, 1, 1, PixelType::U8);
    spec.attributes.set(Param::declared("string owner", "me").unwrap());
    let path = dir.path().join("owner.tif");
    let mut out = all.create(&path, "tiff", &CreateOptions::new(&spec, 1)).unwrap();
    out.write_rows(&Pixels::U8(vec![1])).unwrap();
    out.close().unwrap();
    assert_eq!(all.open(&path).unwrap().spec(0, 0).unwrap().string("copyright"), Some("me"));
}

#[test]
fn files_do_not_depend_on_the_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let all = registry();
    let values: Vec<f32> = (0..300 * 200 * 4).map(|i| (i % 977 * (i % 13) % 977) as f32 / 977.0).collect();
    for (format, pixel_type) in
        [("tiff", PixelType::U16), ("tiff", PixelType::Float), ("exr", PixelType::Half)]
    {
        for tile in [0, 32] {
            let mut spec = ImageSpec::new(300, 200, 4, pixel_type);
            (spec.tile_width, spec.tile_height) = (tile, tile);
            let pixels = Pixels::from_floats(pixel_type, &values);
            let written = |threads: usize, rows: usize| {
                let path = dir.path().join("a");
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| {
                    let options = CreateOptions::new(&spec, 1);
                    let mut out = all.create(&path, format, &options).unwrap();
                    for first in (0..200).step_by(rows) {
                        let n = rows.min(200 - first) * 1200;
                        let mut part = Pixels::zeros(pixel_type, n);
                        part.copy_from(0, &pixels, first * 1200, n);
                        out.write_rows(&part).unwrap();
                    }
                    out.close().unwrap();
                    assert_eq!(all.open(&path).unwrap().read_level(0, 0).unwrap(), pixels);
                });
                std::fs::read(&path).unwrap()
            };
            let one = written(1, 200);
            assert!(written(4, 200) == one, "{format} {pixel_type:?} {tile}: threads");
            assert!(written(4, 7) == one, "{format} {pixel_type:?} {tile}: rows");
        }
    }
}

/// OpenEXR stores halves unless floats are requested. IFF supports only its own quantization (reference 7.4.4, 7.4.6).
#[test]
fn formats_have_their_own_default_quantization() {
    use granita_image::{PixelType, Quantize};
    let registry = granita_plugin::bundled_formats(granita_image::Limits::default());
    let of = |format: &str, params: &[granita_base::Param]| {
        let params = granita_base::Params(params.to_vec());
        Quantize::for_output(&*registry.by_name(format).unwrap(), &params)
    };
    let param = |declaration: &str, data: granita_base::ParamData| {
        granita_base::Param::declared(declaration, data).unwrap()
    };
    let float = param("string pixeltype", "float".into());
    let half = param("string pixeltype", "half".into());
    let levels = |v: &[i32]| param("int[4] quantize", v.into());
    assert_eq!(of("OpenEXR", &[]).1, PixelType::Half);
    assert_eq!(of("OpenEXR", &[levels(&[0, 65535, 0, 65535])]).1, PixelType::Half, "quantize is ignored");
    assert_eq!(of("OpenEXR", &[half]).1, PixelType::Half);
    assert_eq!(of("OpenEXR", std::slice::from_ref(&float)).1, PixelType::Float);
    assert_eq!(of("exr", &[float.clone(), levels(&[0, 255, 0, 255])]).1, PixelType::Float);
    assert_eq!(of("tiff", &[float]).1, PixelType::U8, "quantize says what TIFF stores");
    let odd = [levels(&[10, 100, 10, 200]), param("float dither", 0.0.into())];
    let (q, stored) = of("iff", &odd);
    assert_eq!((q.zero, q.one, q.min, q.max, q.dither, stored), (0, 255, 0, 255, 0.5, PixelType::U8));
    let (q, stored) = of("iff", &[levels(&[0, 4095, 0, 4095])]);
    assert_eq!((q.one, q.max, stored), (65535, 65535, PixelType::U16));
    let (q, _) = of("tiff", &odd);
    assert_eq!((q.zero, q.one, q.dither), (10, 100, 0.0));
    assert_eq!(of("DevIL", &[levels(&[0, 65535, 0, 65535])]).1, PixelType::U8);
    assert!(registry.formats().iter().all(|f| f.name() != "DevIL"), "a name, not a format");
}
