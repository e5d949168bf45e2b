// tidy: tests
//! Tests of Exif data.

use super::*;
use granita_base::Param;
use proptest::prelude::*;

fn given() -> Params {
    let mut params = Params::new();
    for (declaration, data) in [
        ("string Make", "Acme".into()),
        ("string ImageDescription", "a caf\u{e9}".into()),
        ("float XResolution", 72.5.into()),
        ("string ResolutionUnit", "cm".into()),
        ("float ExposureTime", (1.0 / 125.0).into()),
        ("float FNumber", 2.8.into()),
        ("int Exif:PhotographicSensitivity", 400.into()),
        ("string Exif:ExifVersion", "0231".into()),
        ("float Exif:ExposureBiasValue", (-1.0 / 3.0).into()),
        ("string Exif:UserComment", "\u{3b1}\u{3b2}".into()),
        ("int Exif:FileSource", 3.into()),
        ("float[4] Exif:LensSpecification", ParamData::from(&[24.0, 70.0, 2.8, 4.0][..])),
        ("int[4] GPS:VersionID", ParamData::from(&[2, 3, 0, 0][..])),
        ("string GPS:LatitudeRef", "N".into()),
        ("float[3] GPS:Latitude", ParamData::from(&[48.0, 51.0, 12.345][..])),
    ] {
        params.set(Param::declared(declaration, data).unwrap());
    }
    params
}

#[test]
fn attributes_survive_write_and_read() {
    let given = given();
    let bytes = write(&given, &[]).unwrap();
    for bytes in [bytes.clone(), [&b"Exif\0\0"[..], &bytes].concat()] {
        let mut got = Params::new();
        read(&bytes, &mut got);
        for param in &given {
            assert_eq!(got.get(&param.name), Some(param));
        }
        assert_eq!(got.0.len(), given.0.len());
    }
    // Names that have another place are left out.
    let mut got = Params::new();
    read(&write(&given, &["ImageDescription", "Make"]).unwrap(), &mut got);
    assert_eq!(got.0.len(), given.0.len() - 2);
    assert!(got.get("Make").is_none());
}

#[test]
fn without_attributes_there_is_no_data() {
    assert_eq!(write(&Params::new(), &[]), None);
    let mut other = Params::new();
    other.set(Param::declared("string compression", "zip").unwrap());
    other.set(Param::declared("int orientation", 1).unwrap());
    assert_eq!(write(&other, &[]), None);
    other.set(Param::declared("int orientation", 6).unwrap());
    let mut got = Params::new();
    read(&write(&other, &[]).unwrap(), &mut got);
    assert_eq!(got.int("orientation"), Some(6));
}

#[test]
fn values_that_a_tag_cannot_hold_are_left_out() {
    let mut params = Params::new();
    for (declaration, data) in [
        ("float ExposureTime", ParamData::from(f32::NAN)),
        ("float FNumber", (-2.0).into()),
        ("float Exif:FocalLength", 1e20.into()),
        ("int Exif:Flash", 70_000.into()),
        ("int Exif:MeteringMode", (-1).into()),
        ("int Make", 3.into()),
        ("string Exif:SceneType", "x".into()),
        ("string Exif:FlashPixVersion", "1\u{e9}".into()),
        ("float[0] GPS:Altitude", ParamData::Float([].into())),
    ] {
        params.set(param(declaration.split(' ').nth(1).unwrap(), data));
    }
    assert_eq!(write(&params, &[]), None);
    // The case of a name does not matter, as in images of other programs.
    params.set(param("exif:flash", 1.into()));
    let mut got = Params::new();
    read(&write(&params, &[]).unwrap(), &mut got);
    assert_eq!(got.int("Exif:Flash"), Some(1));
}

#[test]
fn big_endian_data_with_all_kinds_of_numbers_is_read() {
    let entries: [(u16, u16, u32, &[u8]); 6] = [
        (271, 2, 3, b"ab\0\0"),
        (272, 2, 9, &[0, 0, 0, 86]),
        (274, 3, 1, &[0, 8, 0, 0]),
        (282, 5, 1, &[0, 0, 0, 96]),
        (296, 3, 1, &[0, 2, 0, 0]),
        (306, 7, 70_000, &[0, 0, 0, 0]),
    ];
    let mut bytes = b"MM\0\x2a\0\0\0\x08\0\x06".to_vec();
    for (tag, kind, count, field) in entries {
        bytes.extend(tag.to_be_bytes());
        bytes.extend(kind.to_be_bytes());
        bytes.extend(count.to_be_bytes());
        bytes.extend(field);
    }
    bytes.extend([0; 4]);
    bytes.extend(b"abcdefgh\0\0\0\0\0\x03\0\0\0\x02");
    let mut got = Params::new();
    read(&bytes, &mut got);
    assert_eq!(got.string("Make").map(|s| &**s), Some("ab"));
    assert_eq!(got.string("Model").map(|s| &**s), Some("abcdefgh"));
    assert_eq!((got.int("orientation"), got.float("XResolution")), (Some(8), Some(1.5)));
    assert_eq!(got.string("ResolutionUnit").map(|s| &**s), Some("in"));
    assert_eq!(got.0.len(), 5);
}

#[test]
fn a_resolution_without_a_unit_is_one_of_inches() {
    let mut params = Params::new();
    params.set(Param::declared("float XResolution", 72.0).unwrap());
    let mut got = Params::new();
    read(&write(&params, &[]).unwrap(), &mut got);
    assert_eq!(got.string("ResolutionUnit").map(|s| &**s), Some("in"));
}

#[test]
fn fractions_are_simple_and_exact() {
    for (value, expected) in [
        (0.0, (0, 1)),
        (0.5, (1, 2)),
        (1.0 / 125.0, (1, 125)),
        (2.8, (14, 5)),
        (12.345, (2469, 200)),
        (4e9, (4_000_000_000, 1)),
        (-1.0 / 3.0, (-1, 3)),
    ] {
        assert_eq!(fraction(value, value < 0.0), Some(expected), "{value}");
    }
    for bad in [f32::NAN, f32::INFINITY, -1.0, 5e9] {
        assert_eq!(fraction(bad, false), None);
    }
}

#[test]
fn directories_that_link_to_themselves_are_read_once() {
    // The first directory names itself as that of the camera, and of the position.
    let mut bytes = b"II\x2a\0\x08\0\0\0\x02\0".to_vec();
    for tag in [CAMERA_TAG, POSITION_TAG] {
        bytes.extend(tag.to_le_bytes());
        bytes.extend([4, 0, 1, 0, 0, 0, 8, 0, 0, 0]);
    }
    let mut got = Params::new();
    read(&bytes, &mut got);
    assert!(got.is_empty());
}

proptest! {
    #[test]
    fn fractions_are_the_same_float(value in 1e-6f32..4e9) {
        let (n, d) = fraction(value, false).unwrap();
        let back = (n as f64 / d as f64) as f32;
        // The smallest values have no exact fraction of 32 bits.
        prop_assert!((back - value).abs() <= value * 1e-3, "{n}/{d}");
        if value > 1e-2 {
            prop_assert_eq!(back, value);
        }
    }

    #[test]
    fn damaged_data_does_not_panic(
        flips in prop::collection::vec((0usize..1000, any::<u8>()), 0..6),
        len in 0usize..1000,
    ) {
        let mut bytes = write(&given(), &[]).unwrap();
        for (at, byte) in flips {
            let n = bytes.len();
            bytes[at % n] = byte;
        }
        bytes.truncate(len);
        read(&bytes, &mut Params::new());
    }
}
