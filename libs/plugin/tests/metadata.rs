//! Metadata of cameras, archives and editors is carried from format to format.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::{Param, ParamData, Params};
use granita_image::{CreateOptions, ImageSpec, Limits, PixelType, Pixels};
use granita_plugin::bundled_formats;
use std::path::Path;

/// What every format with Exif holds.
fn exif() -> Vec<Param> {
    let floats = |v: &[f32]| ParamData::from(v);
    [
        ("string Make", "Acme".into()),
        ("string Model", "One".into()),
        ("string DateTime", "2026:11:27 04:00:00".into()),
        ("float ExposureTime", 0.008.into()),
        ("float FNumber", 2.8.into()),
        ("int Exif:PhotographicSensitivity", 400.into()),
        ("string Exif:LensModel", "50 mm".into()),
        ("string Exif:ExifVersion", "0232".into()),
        ("float Exif:ExposureBiasValue", (-0.5).into()),
        ("string Exif:UserComment", "sch\u{f6}n".into()),
        ("string GPS:LatitudeRef", "N".into()),
        ("float[3] GPS:Latitude", floats(&[48.0, 51.0, 12.5])),
    ]
    .into_iter()
    .map(|(declaration, data)| Param::declared(declaration, data).unwrap())
    .collect()
}

fn texts(names: &[(&str, &str)]) -> Vec<Param> {
    let param = |(name, text): &(&str, &str)| Param::declared(&format!("string {name}"), *text).unwrap();
    names.iter().map(param).collect()
}

fn iptc() -> Vec<Param> {
    texts(&[("IPTC:Keywords", "one; two"), ("IPTC:City", "K\u{f6}ln"), ("IPTC:Headline", "news")])
}

const XMP: &str = "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><a>\u{3b1}</a></x:xmpmeta>";

/// Returns a profile with a description, larger than a segment of JPEG.
fn profile() -> Vec<u8> {
    let mut bytes = vec![0; 128];
    bytes.extend(1_u32.to_be_bytes());
    bytes.extend(b"desc");
    bytes.extend(144_u32.to_be_bytes());
    bytes.extend(16_u32.to_be_bytes());
    bytes.extend(b"desc\0\0\0\0\0\0\0\x04ours");
    bytes.extend((0..150_000_u32).map(|i| (i.wrapping_mul(i) >> 7) as u8));
    bytes
}

fn given(pixel_type: PixelType) -> ImageSpec {
    let mut spec = ImageSpec::new(16, 8, 3, pixel_type);
    let others =
        texts(&[("ImageDescription", "a wall"), ("Artist", "somebody"), ("copyright", "all"), ("XMP", XMP)]);
    spec.attributes.extend(exif().into_iter().chain(iptc()).chain(others));
    spec.set_icc_profile(profile());
    spec
}

/// Writes an image of this description, whose storage is that of another file, and returns the description that is
/// read.
fn through(folder: &Path, format: &str, name: &str, spec: &ImageSpec) -> ImageSpec {
    let formats = bundled_formats(Limits::default());
    let pixel_type = if format == "exr" { PixelType::Half } else { PixelType::U8 };
    let mut spec = ImageSpec { pixel_type, ..spec.clone() };
    spec.attributes.0.retain(|p| !["compression", "planarconfig", "rowsperstrip"].contains(&&*p.name));
    let path = folder.join(name);
    let mut output = formats.create(&path, format, &CreateOptions::new(&spec, 1)).unwrap();
    output.write_rows(&Pixels::from_floats(pixel_type, &vec![0.5; 16 * 8 * 3])).unwrap();
    output.close().unwrap();
    let input = formats.open(&path).unwrap();
    input.read_level(0, 0).unwrap();
    input.spec(0, 0).unwrap().clone()
}

fn holds(got: &Params, expected: &[Param], what: &str) {
    for param in expected {
        assert_eq!(got.get(&param.name).map(|p| &p.data), Some(&param.data), "{what}: {}", param.name);
    }
}

#[test]
fn conversion_carries_what_each_format_holds() {
    let folder = tempfile::tempdir().unwrap();
    let all =
        texts(&[("ImageDescription", "a wall"), ("Artist", "somebody"), ("copyright", "all"), ("XMP", XMP)]);
    let mut spec = given(PixelType::U8);
    for format in ["jpeg", "tiff", "exr", "jpeg", "png", "exr", "jpeg"] {
        spec = through(folder.path(), format, &format!("a.{format}"), &spec);
        holds(&spec.attributes, &exif(), format);
        holds(&spec.attributes, &all, format);
        assert_eq!(spec.icc_profile.as_deref(), Some(&profile()[..]), "{format}");
        assert_eq!(spec.string("ICCProfile"), Some("ours"), "{format}");
        holds(&spec.attributes, &iptc(), format);
    }
}

#[test]
fn other_formats_hold_a_part() {
    let folder = tempfile::tempdir().unwrap();
    for (format, icc) in [("webp", true), ("jpegxl", false)] {
        let spec = through(folder.path(), format, &format!("a.{format}"), &given(PixelType::U8));
        holds(&spec.attributes, &exif(), format);
        holds(&spec.attributes, &texts(&[("XMP", XMP)]), format);
        assert_eq!(spec.icc_profile.is_some(), icc, "{format}");
    }
}

#[test]
fn images_without_metadata_get_none() {
    let folder = tempfile::tempdir().unwrap();
    let plain = ImageSpec::new(16, 8, 3, PixelType::U8);
    for format in ["jpeg", "png", "webp", "jpegxl", "tiff", "exr"] {
        let spec = through(folder.path(), format, &format!("plain.{format}"), &plain);
        for param in &spec.attributes {
            let storage = ["compression", "planarconfig", "rowsperstrip", "software", "CICP"];
            assert!(storage.contains(&&*param.name), "{format}: {}", param.name);
        }
        assert_eq!(spec.icc_profile, None, "{format}");
    }
}

#[test]
fn an_orientation_turns_jpeg_and_is_kept_by_tiff() {
    let folder = tempfile::tempdir().unwrap();
    let mut spec = ImageSpec::new(16, 8, 3, PixelType::U8);
    spec.attributes.set(Param::declared("int orientation", 6).unwrap());
    let tiff = through(folder.path(), "tiff", "a.tif", &spec);
    assert_eq!(tiff.attributes.int("orientation"), Some(6));
    let jpeg = through(folder.path(), "jpeg", "a.jpg", &tiff);
    assert_eq!((jpeg.width, jpeg.height, jpeg.attributes.int("orientation")), (8, 16, None));
}

#[test]
fn resolutions_and_colours_of_png_are_attributes() {
    let folder = tempfile::tempdir().unwrap();
    let mut spec = ImageSpec::new(16, 8, 3, PixelType::U8);
    let points = [0.3127, 0.329, 0.64, 0.33, 0.3, 0.6, 0.15, 0.06];
    for param in [
        Param::declared("float png:gAMA", 0.5).unwrap(),
        Param::declared("float[8] png:cHRM", &points[..]).unwrap(),
        Param::declared("float XResolution", 300.0).unwrap(),
        Param::declared("float YResolution", 150.0).unwrap(),
        Param::declared("string ResolutionUnit", "in").unwrap(),
    ] {
        spec.attributes.set(param);
    }
    let expected: Vec<Param> = spec.attributes.iter().cloned().collect();
    let png = through(folder.path(), "png", "a.png", &spec);
    holds(&png.attributes, &expected, "png");
    holds(&through(folder.path(), "tiff", "a.tif", &png).attributes, &expected[2..], "tiff");
    let mut spec = ImageSpec::new(16, 8, 3, PixelType::U8);
    spec.attributes.set(Param::declared("int png:sRGB", 1).unwrap());
    let png = through(folder.path(), "png", "b.png", &spec);
    assert_eq!((png.attributes.int("png:sRGB"), png.attributes.get("png:gAMA")), (Some(1), None));
}
