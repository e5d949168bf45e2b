//! Icons that hold PNG images.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_image::{CreateOptions, Format, ImageInput, ImageSpec, Limits, PixelType, Pixels};
use granita_raster::{PngFormat, formats};
use std::path::Path;
use std::sync::Arc;

/// Returns a PNG of one value.
fn png(size: (u32, u32), channels: usize, pixel_type: PixelType) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let spec = ImageSpec::new(size.0, size.1, channels, pixel_type);
    let mut out = PngFormat.create(&path, &CreateOptions::new(&spec, 1)).unwrap();
    let n = size.0 as usize * size.1 as usize * channels;
    out.write_rows(&Pixels::from_floats(pixel_type, &vec![1.0; n])).unwrap();
    out.close().unwrap();
    std::fs::read(path).unwrap()
}

/// Returns an icon of images with their sides and numbers of bits.
fn icon(images: &[(u8, u16, Vec<u8>)]) -> Vec<u8> {
    let mut file = [[0, 0, 1, 0], [images.len() as u8, 0, 0, 0]].concat();
    file.truncate(6);
    let mut at = 6 + 16 * images.len();
    for (side, bits, bytes) in images {
        file.extend([*side, *side, 0, 0, 1, 0]);
        file.extend(bits.to_le_bytes());
        file.extend((bytes.len() as u32).to_le_bytes());
        file.extend((at as u32).to_le_bytes());
        at += bytes.len();
    }
    images.iter().for_each(|(.., bytes)| file.extend(bytes));
    file
}

fn open(bytes: &[u8]) -> granita_image::Result<Box<dyn ImageInput>> {
    let ico: Arc<dyn Format> = formats().into_iter().find(|f| f.name() == "ico").unwrap();
    assert!(ico.recognizes(bytes));
    ico.open_bytes(Path::new("a.ico"), bytes.into(), &Limits::default())
}

#[test]
fn png_of_every_kind_is_read_from_icons() {
    for pixel_type in [PixelType::U8, PixelType::U16] {
        for channels in 1..=4 {
            let input = open(&icon(&[(16, 32, png((16, 16), channels, pixel_type))])).unwrap();
            let spec = input.spec(0, 0).unwrap();
            assert_eq!((spec.width, spec.nchannels(), spec.pixel_type), (16, channels, pixel_type));
            assert_eq!(input.format_name(), "ico");
            assert!(input.read_level(0, 0).unwrap().to_floats().iter().all(|v| *v == 1.0));
        }
    }
}

#[test]
fn the_largest_icon_of_the_most_bits_is_read() {
    let small = (16, 32, png((16, 16), 3, PixelType::U8));
    // A side of 0 is one of 256.
    let large = (0, 32, png((256, 256), 3, PixelType::U8));
    let poor = (0, 8, png((255, 255), 1, PixelType::U8));
    for images in [[small.clone(), large.clone(), poor.clone()], [poor, large, small]] {
        assert_eq!(open(&icon(&images)).unwrap().spec(0, 0).unwrap().width, 256);
    }
}

#[test]
fn damaged_icons_are_errors() {
    let good = icon(&[(16, 32, png((16, 16), 3, PixelType::U8))]);
    for n in 10..good.len() {
        let result = open(&good[..n]).and_then(|input| input.read_level(0, 0));
        // A PNG ends with two checksums and a mark, of 20 bytes together, which the pixels do not need.
        assert!(result.is_err() || n + 20 >= good.len(), "{n} of {}", good.len());
    }
    // The image begins after the end of the file.
    let mut outside = good.clone();
    outside[18..22].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(open(&outside).is_err());
}
