//! Readers of other programs read files of this crate, and this crate reads theirs.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::Param;
use granita_image::{CreateOptions, Format, ImageSpec, Limits, PixelType, Pixels};
use granita_tiff::TiffFormat;
use std::fs::File;
use std::path::Path;
use tiff::decoder::{Decoder, DecodingResult};
use tiff::encoder::{Compression, TiffEncoder, colortype};
use tiff::tags::Tag;

fn ramp(n: usize) -> Vec<f32> {
    (0..n).map(|i| (i % 251) as f32 / 250.0).collect()
}

fn write(path: &Path, spec: &ImageSpec) -> Pixels {
    let n = spec.width as usize * spec.height as usize * spec.nchannels();
    let pixels = Pixels::from_floats(spec.pixel_type, &ramp(n));
    let mut out = TiffFormat.create(path, &CreateOptions::new(spec, 1)).unwrap();
    out.write_rows(&pixels).unwrap();
    out.close().unwrap();
    pixels
}

#[test]
fn the_tiff_crate_reads_our_files() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    for pixel_type in [PixelType::U8, PixelType::U16, PixelType::U32, PixelType::Half, PixelType::Float] {
        for compression in ["none", "lzw", "zip", "packbits"] {
            for (tile, big) in [(0, 0), (32, 0), (32, 1)] {
                let mut spec = ImageSpec::new(53, 47, 3, pixel_type);
                spec.attributes.set(Param::declared("int bigtiff", big).unwrap());
                (spec.tile_width, spec.tile_height) = (tile, tile);
                spec.attributes.set(Param::declared("string compression", compression).unwrap());
                spec.attributes.set(Param::declared("string textureformat", "Plain Texture").unwrap());
                spec.attributes.set(Param::declared("matrix worldtoscreen", &[0.5; 16][..]).unwrap());
                let pixels = write(&path, &spec);
                let mut decoder = Decoder::new(File::open(&path).unwrap()).unwrap();
                assert_eq!(decoder.dimensions().unwrap(), (53, 47));
                let got = match decoder.read_image().unwrap() {
                    DecodingResult::U8(v) => Pixels::U8(v),
                    DecodingResult::U16(v) => Pixels::U16(v),
                    DecodingResult::U32(v) => Pixels::U32(v),
                    DecodingResult::F16(v) => Pixels::Half(v),
                    DecodingResult::F32(v) => Pixels::Float(v),
                    other => panic!("{other:?}"),
                };
                assert!(got == pixels, "{pixel_type:?} {compression} tile {tile}");
                assert_eq!(decoder.get_tag_ascii_string(Tag::Unknown(33302)).unwrap(), "Plain Texture");
                assert_eq!(decoder.get_tag_f32_vec(Tag::Unknown(33305)).unwrap(), [0.5; 16]);
            }
        }
    }
}

#[test]
fn files_of_the_tiff_crate_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    for big in [false, true] {
        for compression in [
            Compression::Uncompressed,
            Compression::Lzw,
            Compression::Deflate(Default::default()),
            Compression::Packbits,
        ] {
            let Pixels::U16(values) = Pixels::from_floats(PixelType::U16, &ramp(40 * 30 * 4)) else {
                panic!()
            };
            let file = File::create(&path).unwrap();
            if big {
                let mut encoder = TiffEncoder::new_big(file).unwrap().with_compression(compression);
                encoder.write_image::<colortype::RGBA16>(40, 30, &values).unwrap();
            } else {
                let mut encoder = TiffEncoder::new(file).unwrap().with_compression(compression);
                encoder.write_image::<colortype::RGBA16>(40, 30, &values).unwrap();
            }
            let input = TiffFormat.open(&path, &Limits::default()).unwrap();
            assert_eq!(input.spec(0, 0).unwrap().channels, ["R", "G", "B", "A"]);
            assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U16(values));
        }
    }
}

/// The files were made by libtiff from one image (`fuzz/corpus/tiff`), with the compressions that are only read.
#[test]
fn compressions_that_are_only_read_are_decoded() {
    let read = |name: &str| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/tiff").join(name);
        let input = TiffFormat.open(&path, &Limits::default()).unwrap();
        (input.spec(0, 0).unwrap().string("compression").map(str::to_owned), input.read_level(0, 0).unwrap())
    };
    let (_, plain) = read("none.tif");
    assert_eq!(read("zstd.tif"), (Some("zstd".to_owned()), plain.clone()));
    // Noise has the largest errors in JPEG. The files have chroma at half the size, and RGB without conversion.
    for (name, most) in [("jpeg.tif", 0.25), ("jpeg_rgb.tif", 0.15)] {
        let (compression, pixels) = read(name);
        assert_eq!(compression.as_deref(), Some("jpeg"));
        let (a, b) = (pixels.to_floats(), plain.to_floats());
        let mean = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum::<f32>() / b.len() as f32;
        assert!(mean < most, "{name}: {mean}");
    }
}

#[test]
fn libtiff_reads_our_files() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.tif");
    let spec = ImageSpec::new(100, 60, 4, PixelType::Half).tiled(64, 64);
    write(&path, &spec);
    if !granita_needs::has("tiffinfo") {
        return;
    }
    let run = std::process::Command::new("tiffinfo").arg("-D").arg(&path).output().unwrap();
    let text = String::from_utf8_lossy(&run.stdout);
    let complaints = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success() && complaints.is_empty(), "{complaints}");
    for line in ["Image Width: 100 Image Length: 60", "Tile Width: 64 Tile Length: 64", "IEEE floating point"]
    {
        assert!(text.contains(line), "{text}");
    }
}
