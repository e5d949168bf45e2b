//! JPEG 2000 that OpenJPEG wrote, and damaged files.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_image::{Format, ImageError, ImageInput, Limits, PixelType, Pixels};
use granita_raster::Jpeg2000Format;
use std::path::Path;

fn corpus(name: &str) -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/jpeg2000");
    std::fs::read(folder.join(name)).unwrap()
}

fn open(bytes: &[u8]) -> granita_image::Result<Box<dyn ImageInput>> {
    Jpeg2000Format.open_bytes(Path::new("a.jp2"), bytes.into(), &Limits::default())
}

fn error(bytes: &[u8]) -> String {
    open(bytes).and_then(|input| input.read_level(0, 0)).unwrap_err().to_string()
}

/// Returns the values that the files of the corpus were made from, of so many bits.
fn values(n: u32, bits: u32) -> Vec<u32> {
    let scale = 1 << bits.saturating_sub(8);
    let value = |x: u32, y: u32, c: u32| (x * 13 + y * 7 + c * 50 + x * y % 5) * scale % (1 << bits);
    (0..17).flat_map(|y| (0..23).flat_map(move |x| (0..n).map(move |c| value(x, y, c)))).collect()
}

#[test]
fn files_without_loss_have_the_values_that_they_were_made_from() {
    for (name, channels, bits) in [
        ("rgb8.jp2", "R G B", 8),
        ("tiled.jp2", "R G B", 8),
        ("rgba8.jp2", "R G B A", 8),
        ("rgb10.jp2", "R G B", 10),
        ("grey12.j2k", "Y", 12),
        ("rgba16.jp2", "R G B A", 16),
    ] {
        let input = open(&corpus(name)).unwrap();
        let spec = input.spec(0, 0).unwrap();
        assert_eq!(
            (spec.width, spec.height, spec.channels.join(" ")),
            (23, 17, channels.to_owned()),
            "{name}"
        );
        let values = values(spec.nchannels() as u32, bits);
        let expected = match bits {
            8 => Pixels::U8(values.iter().map(|v| *v as u8).collect()),
            // The high bits are repeated as the low ones.
            _ => {
                Pixels::U16(values.iter().map(|v| (v << (16 - bits) | v >> (2 * bits - 16)) as u16).collect())
            }
        };
        assert_eq!(input.read_level(0, 0).unwrap(), expected, "{name}");
        assert_eq!(spec.attributes.int("unassociatedalpha"), channels.ends_with('A').then_some(1), "{name}");
    }
}

#[test]
fn files_with_loss_are_near() {
    let input = open(&corpus("lossy.j2k")).unwrap();
    let Pixels::U8(got) = input.read_level(0, 0).unwrap() else { panic!() };
    let differences = got.iter().zip(values(3, 8)).map(|(a, b)| (f64::from(*a) - f64::from(b)).abs());
    let mean = differences.sum::<f64>() / got.len() as f64;
    assert!(mean < 30.0, "{mean}");
}

#[test]
fn metadata_of_boxes_is_read() {
    let plain = corpus("rgb8.jp2");
    let uuid = |id: &[u8; 16], content: &[u8]| {
        let len = (content.len() as u32 + 24).to_be_bytes();
        [&len[..], b"uuid", id, content].concat()
    };
    let xmp =
        [0xbe, 0x7a, 0xcf, 0xcb, 0x97, 0xa9, 0x42, 0xe8, 0x9c, 0x71, 0x99, 0x94, 0x91, 0xe3, 0xaf, 0xac];
    let exif = [&b"II\x2a\0\x08\0\0\0\x01\0\x0f\x01\x02\0\x04\0\0\0Acm\0"[..], &[0; 4]].concat();
    let input = open(&[&plain[..], &uuid(&xmp, b"<x:xmpmeta/>"), &uuid(b"JpgTiffExif->JP2", &exif)].concat())
        .unwrap();
    let spec = input.spec(0, 0).unwrap();
    assert_eq!((spec.string("XMP"), spec.string("Make")), (Some("<x:xmpmeta/>"), Some("Acm")));
}

#[test]
fn signed_values_are_numbers() {
    for (name, channels, bits) in [("signed8.jp2", 1, 8), ("signed12.jp2", 3, 12), ("signed16.j2k", 1, 16)] {
        let input = open(&corpus(name)).unwrap();
        let spec = input.spec(0, 0).unwrap();
        assert_eq!(spec.pixel_type, if bits == 8 { PixelType::Half } else { PixelType::Float }, "{name}");
        let half = 1 << (bits - 1);
        let expected: Vec<f32> = values(channels, bits).iter().map(|v| (*v as i32 - half) as f32).collect();
        assert_eq!(input.read_level(0, 0).unwrap().floats().to_vec(), expected, "{name}");
    }
}

#[test]
fn signed_numbers_of_a_palette_are_refused() {
    let mut bytes = corpus("signed8.jp2");
    // The boxes "pclr" and "cmap" of two colours follow the header of the image.
    let palette = [&[0, 0, 0, 20][..], b"pclr", &[0, 2, 3, 7, 7, 7, 0, 0, 0, 255, 255, 255]].concat();
    let map = [&[0, 0, 0, 20][..], b"cmap", &[0, 0, 1, 0, 0, 0, 1, 1, 0, 0, 1, 2]].concat();
    let header = bytes.windows(4).position(|w| w == b"jp2h").unwrap() - 4;
    let length = u32::from_be_bytes(bytes[header..header + 4].try_into().unwrap()) as usize;
    let added = [&palette[..], &map].concat();
    bytes[header..header + 4].copy_from_slice(&((length + added.len()) as u32).to_be_bytes());
    bytes.splice(header + length..header + length, added);
    assert!(error(&bytes).contains("palettes"), "{}", error(&bytes));
}

/// Returns the offset of the sizes of the codestream.
fn sizes(bytes: &[u8]) -> usize {
    bytes.windows(4).position(|w| w == b"\xff\x4f\xff\x51").unwrap() + 8
}

#[test]
fn sizes_that_need_too_much_are_refused_before_they_are_decoded() {
    let good = corpus("rgb8.jp2");
    let at = sizes(&good);
    let with = |changes: &[(usize, u32)]| {
        let mut bytes = good.clone();
        for (offset, value) in changes {
            bytes[at + offset..at + offset + 4].copy_from_slice(&value.to_be_bytes());
        }
        bytes
    };
    // Width and height are at 0 and 4, their origin at 8 and 12, the sides of tiles at 16 and 20.
    assert!(error(&with(&[(0, u32::MAX)])).contains("exceeds"));
    assert!(error(&with(&[(0, 1 << 20), (4, 1 << 20)])).contains("exceeds"));
    assert!(error(&with(&[(0, 60_000), (4, 60_000), (16, 1), (20, 1)])).contains("number of tiles"));
    assert!(error(&with(&[(8, 23)])).contains("contradict"));
    assert!(error(&with(&[(16, 0)])).contains("contradict"));
    assert!(error(&with(&[(24, 5)])).contains("contradict"));
    // Only the first component has signed values.
    let mut signed = good.clone();
    signed[at + 34] |= 0x80;
    assert!(error(&signed).contains("signed"), "{}", error(&signed));
    let mut none = good;
    none[at + 32..at + 34].fill(0);
    assert!(error(&none).contains("contradict"));
}

#[test]
fn files_that_were_cut_are_refused() {
    for name in ["rgb8.jp2", "grey12.j2k", "rgba16.jp2", "tiled.jp2", "lossy.j2k", "signed16.j2k"] {
        let whole = corpus(name);
        assert!(open(&whole).unwrap().read_level(0, 0).is_ok(), "{name}");
        for n in (60..whole.len() - 2).step_by(5) {
            let cut = open(&whole[..n]).and_then(|input| input.read_level(0, 0));
            assert!(matches!(cut, Err(ImageError::Malformed { .. } | ImageError::Io { .. })), "{name}: {n}");
        }
        // The mark of the end may be missing.
        if name.ends_with(".j2k") {
            let unmarked = &whole[..whole.len() - 2];
            assert!(open(unmarked).unwrap().read_level(0, 0).is_ok(), "{name}");
        }
    }
}

#[test]
fn boxes_may_follow_a_tile_of_unknown_length() {
    let mut bytes = corpus("rgb8.jp2");
    let part = bytes.windows(4).position(|mark| mark == [0xff, 0x90, 0, 10]).unwrap();
    bytes[part + 6..part + 10].fill(0);
    bytes.extend(b"\0\0\0\x0cfree\0\0\0\0");
    assert!(open(&bytes).unwrap().read_level(0, 0).is_ok());
}

#[test]
fn damaged_files_do_not_panic() {
    for name in ["rgb8.jp2", "grey12.j2k", "rgba16.jp2", "tiled.jp2", "lossy.j2k", "signed12.jp2"] {
        let good = corpus(name);
        let limits = Limits { dimension: 4096, pixels: 1 << 20, bytes: 16 << 20, ..Limits::default() };
        let read = |bytes: Vec<u8>| {
            let input = Jpeg2000Format.open_bytes(Path::new("a.jp2"), bytes.into(), &limits)?;
            input.read_level(0, 0)
        };
        for n in (0..good.len()).step_by(7) {
            let _ = read(good[..n].to_vec());
        }
        for salt in 0..150_u32 {
            let mut bytes = good.clone();
            for k in 0..=salt % 3 {
                let word = granita_base::hash::words(&[salt, k, name.len() as u32]);
                let at = word as usize % bytes.len();
                bytes[at] ^= 1 << (word >> 25 & 7);
            }
            let _ = read(bytes);
        }
        assert!(
            matches!(read(good[..60.min(good.len())].to_vec()), Err(ImageError::Malformed { .. })),
            "{name}"
        );
    }
}

#[test]
fn it_is_not_written() {
    let spec = granita_image::ImageSpec::new(2, 2, 1, PixelType::U8);
    let options = granita_image::CreateOptions::new(&spec, 1);
    let error = Jpeg2000Format.create(Path::new("a.jp2"), &options).err().unwrap();
    assert!(error.to_string().contains("not written"), "{error}");
}
