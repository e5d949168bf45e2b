//! Tests kinds of TIFF files that are only read. The values are correct, and damage is an error.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

mod hand;

use granita_image::{Format, Limits, PixelType, Pixels};
use granita_tiff::TiffFormat;
use hand::{File, RATIONAL};
use std::path::{Path, PathBuf};

fn corpus(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/tiff").join(name)
}

/// Returns the channels and pixels of the first image.
fn read(path: &Path) -> granita_image::Result<(Vec<String>, Pixels)> {
    let limits = Limits { dimension: 4096, pixels: 1 << 22, bytes: 16 << 20, ..Limits::default() };
    let input = TiffFormat.open(path, &limits)?;
    let pixels = input.read_level(0, 0)?;
    Ok((input.spec(0, 0).unwrap().channels.clone(), pixels))
}

thread_local! {
    /// The folder of a test. A folder for each file would take most of the time.
    static FOLDER: tempfile::TempDir = tempfile::tempdir().unwrap();
}

fn read_bytes(bytes: &[u8]) -> granita_image::Result<(Vec<String>, Pixels)> {
    FOLDER.with(|folder| {
        let path = folder.path().join("a.tif");
        // Some disks synchronise a file that is overwritten.
        let _ = std::fs::remove_file(&path);
        std::fs::write(&path, bytes).unwrap();
        read(&path)
    })
}

/// Returns a file in every layout that its values permit.
fn layouts(file: &File, predictors: &[u64]) -> Vec<File> {
    let mut all = Vec::new();
    for big_endian in [false, true] {
        for tile in [None, Some((8, 4)), Some((16, 16))] {
            for separate in [false, true] {
                for compression in [1, 5, 8, 50000] {
                    for &predictor in predictors {
                        all.push(File { big_endian, tile, separate, compression, predictor, ..file.clone() });
                    }
                }
            }
        }
    }
    all
}

/// Returns numbers with different bits, including the extreme ones.
fn numbers(n: usize, bits: usize) -> Vec<u64> {
    let top = u64::MAX >> (64 - bits);
    (0..n as u64)
        .map(|i| match i {
            0 => 0,
            1 => top,
            2 => top / 2,
            3 => top / 2 + 1,
            _ => i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> (64 - bits),
        })
        .collect()
}

#[test]
fn signed_and_long_integers_keep_their_values() {
    for (bits, format) in [(8, 2), (16, 2), (32, 2), (64, 2), (64, 1)] {
        for samples in [1, 3, 5] {
            let values = numbers(19 * 7 * samples, bits);
            let expected: Vec<f32> = values
                .iter()
                .map(|&n| match (bits, format) {
                    (8, 2) => f32::from(n as u8 as i8),
                    (16, 2) => f32::from(n as u16 as i16),
                    (32, 2) => n as u32 as i32 as f32,
                    (64, 2) => n as i64 as f32,
                    _ => n as f32,
                })
                .collect();
            let file = File::new((19, 7), samples, bits).with(339, &vec![format; samples]);
            for file in layouts(&file, &[1, 2]) {
                let (channels, pixels) = read_bytes(&file.of_numbers(&values)).unwrap();
                assert_eq!(channels.len(), samples);
                assert_eq!(pixels.pixel_type(), if bits == 8 { PixelType::Half } else { PixelType::Float });
                assert!(pixels.to_floats() == expected, "{file:?}");
            }
        }
    }
}

#[test]
fn doubles_are_rounded_to_floats() {
    for samples in [1, 3, 4] {
        let values: Vec<f64> = (0..19 * 7 * samples)
            .map(|i| match i {
                0 => -0.1,
                1 => f64::MAX,
                2 => f64::from(f32::MIN_POSITIVE),
                _ => (i as f64 * 0.7).sin() * 1e5,
            })
            .collect();
        let bits: Vec<u64> = values.iter().map(|v| v.to_bits()).collect();
        let expected = Pixels::Float(values.iter().map(|v| *v as f32).collect());
        let file = File::new((19, 7), samples, 64).with(339, &vec![3; samples]);
        for file in layouts(&file, &[1, 3]) {
            assert!(read_bytes(&file.of_numbers(&bits)).unwrap().1 == expected, "{file:?}");
        }
    }
}

#[test]
fn colors_become_rgb_in_every_layout() {
    // The stored values of one pixel with an alpha of 7, and its colour.
    let lab8 = [138, 81, 70, 7];
    let lab16 = [0x8afd, 0x50ce, 0x45e4, 7];
    for (photometric, bits, stored, rgb) in [
        (8, 8, &lab8[..], [255, 0, 0]),
        (9, 8, &[138, 81 + 128, 70 + 128, 7], [255, 0, 0]),
        (8, 16, &lab16[..], [65535, 0, 0]),
        (9, 16, &[0x8afc * 65280 / 65535, 0xd0ce, 0xc5e4, 7], [65535, 0, 0]),
        (5, 8, &[0, 255, 51, 0, 7], [255, 0, 204]),
        (5, 16, &[0, 65535, 0, 32768, 7], [32767, 0, 32767]),
    ] {
        let values = stored.repeat(19 * 7);
        let mut file = File::new((19, 7), stored.len(), bits).with(262, &[photometric]).with(338, &[1]);
        if photometric == 8 {
            // The tag is written as by libtiff's writers.
            file = file.with(339, &[1, 2, 2, 1]);
        }
        for file in layouts(&file, &[1, 2]) {
            let (channels, pixels) = read_bytes(&file.of_numbers(&values)).unwrap();
            assert_eq!(channels, ["R", "G", "B", "A"]);
            // Integers of L*a*b* are a step from pure red.
            let near = if photometric == 5 { 1.0 } else { 0.01 * f32::from(u16::MAX >> (16 - bits)) };
            let top = f32::from(u16::MAX >> (16 - bits));
            for pixel in pixels.to_floats().chunks(4) {
                let got = [0, 1, 2].map(|i| pixel[i] * top);
                let far = got.iter().zip(rgb).map(|(a, b)| (a - b as f32).abs()).fold(0.0, f32::max);
                assert!(far <= near, "{got:?} {file:?}");
                assert_eq!((pixel[3] * top).round(), 7.0);
            }
        }
    }
}

/// Returns a file of luminance and of colour differences that `block` pixels share.
fn ycbcr(block: (u64, u64), compression: u64) -> Vec<u8> {
    let file = File::new((19, 7), 3, 8).with(262, &[6]).with(530, &[block.0, block.1]);
    let file = File { compression, tile: Some((16, 16)), ..file };
    let (h, v) = (block.0 as usize, block.1 as usize);
    let chunks: Vec<Vec<u8>> = (0..2)
        .map(|tile| {
            (0..16 / h * (16 / v))
                .flat_map(|b| {
                    let luma = (0..h * v).map(move |i| (40 + tile * 50 + b + i) as u8);
                    luma.chain([(100 + b / 4) as u8, (150 - b / 4) as u8])
                })
                .collect()
        })
        .collect();
    file.of_chunks(&chunks)
}

#[test]
fn subsampled_colour_differences_decode_as_in_libtiff() {
    for (h, v) in [(1, 1), (2, 1), (2, 2), (4, 1), (4, 4), (4, 2)] {
        for compression in [1, 5, 8, 50000] {
            let bytes = ycbcr((h, v), compression);
            let (channels, pixels) = read_bytes(&bytes).unwrap();
            assert_eq!(channels, ["R", "G", "B"]);
            // The expected colour of pixel (1, 0) follows the formulas of TIFF 6.0, section 21.
            let block = 1 / h;
            let luma = 40 + block + if h > 1 { 1 } else { 0 };
            let (y, cb, cr) =
                (luma as f32, (100 + block / 4) as f32 - 128.0, (150 - block / 4) as f32 - 128.0);
            let (r, b) = (y + 1.402 * cr, y + 1.772 * cb);
            let g = (y - 0.299 * r - 0.114 * b) / 0.587;
            for (c, expected) in [r, g, b].into_iter().enumerate() {
                let got = pixels.get(3 + c) * 255.0;
                assert!((got - expected.clamp(0.0, 255.0)).abs() < 0.51, "{h} x {v}, {c}: {got} {expected}");
            }
            if compression != 8 || !granita_needs::has("tiff2rgba") {
                continue;
            }
            let folder = tempfile::tempdir().unwrap();
            let (from, to) = (folder.path().join("a.tif"), folder.path().join("b.tif"));
            std::fs::write(&from, &bytes).unwrap();
            let run =
                std::process::Command::new("tiff2rgba").args(["-c", "none"]).args([&from, &to]).output();
            assert!(run.unwrap().status.success());
            let theirs = read(&to).unwrap().1.to_floats();
            let ours = pixels.to_floats();
            for (i, (theirs, ours)) in theirs.chunks(4).zip(ours.chunks(3)).enumerate() {
                // libtiff calculates with integers.
                let far = (0..3).map(|c| (theirs[c] - ours[c]).abs()).fold(0.0, f32::max);
                // libtiff 4.5 reads wrong positions at the right border of tiles of 4 x 4 blocks.
                let lost = (h, v) == (4, 4) && i % 19 >= 16;
                assert!(far < 2.5 / 255.0 || lost, "{h} x {v}, pixel {i}: {theirs:?} {ours:?}");
            }
        }
    }
}

#[test]
fn ycbcr_uses_the_reference_range_of_the_file() {
    let file = File::new((2, 1), 3, 8).with(262, &[6]).with(530, &[1, 1]);
    let mut file = File { tile: Some((16, 16)), ..file };
    let range: Vec<u64> = [16, 235, 128, 240, 128, 240].into_iter().flat_map(|n| [n, 1]).collect();
    file.tags.push((532, RATIONAL, range));
    let (_, pixels) = read_bytes(&file.of_numbers(&[16, 128, 128, 235, 128, 128])).unwrap();
    assert_eq!(pixels, Pixels::U8(vec![0, 0, 0, 255, 255, 255]));
}

/// The files were made by libtiff's tools (`fuzz/corpus/tiff`).
#[test]
fn fax_webp_and_reversed_bits_are_decoded() {
    let (channels, bilevel) = read(&corpus("bilevel.tif")).unwrap();
    assert_eq!(channels, ["Y"]);
    assert!(bilevel.to_floats().contains(&0.0) && bilevel.to_floats().contains(&1.0));
    for name in [
        "group4.tif",
        "group4_reversed.tif",
        "lzw_reversed.tif",
        "ccitt.tif",
        "group3.tif",
        "group3_differences.tif",
        "group3_filled.tif",
    ] {
        assert!(read(&corpus(name)).unwrap().1 == bilevel, "{name}");
    }
    let colors = read(&corpus("colors.tif")).unwrap();
    assert_eq!(read(&corpus("webp_lossless.tif")).unwrap(), colors);
    let tiles = read(&corpus("webp_tiles.tif")).unwrap().1.to_floats();
    let far: f32 = tiles.iter().zip(colors.1.to_floats()).map(|(a, b)| (a - b).abs()).sum();
    assert!(far / (tiles.len() as f32) < 0.04, "{}", far / tiles.len() as f32);
    // The bits of whole bytes are reversed. Such files were once read wrongly without a message.
    let file = File::new((5, 3), 1, 16).with(266, &[2]);
    let values = numbers(15, 16);
    let turned: Vec<u64> = values
        .iter()
        .map(|n| u64::from(u16::from_le_bytes((*n as u16).to_be_bytes()).reverse_bits()))
        .collect();
    let expected = Pixels::U16(values.iter().map(|n| *n as u16).collect());
    assert_eq!(read_bytes(&file.of_numbers(&turned)).unwrap().1, expected);
}

/// The tags of bits and types do not describe the data, which is logarithmic.
#[test]
fn logarithmic_luminances_become_floats() {
    for (photometric, samples, bits, format) in
        [(32844, 1, 16, 1), (32844, 1, 16, 2), (32845, 3, 16, 2), (32845, 3, 32, 3)]
    {
        let file =
            File::new((5, 4), samples, bits).with(262, &[photometric]).with(339, &vec![format; samples]);
        let file = File { compression: 34676, ..file };
        // Each row is a run of the luminance 2, and of the chromaticity of white.
        let row =
            [&[131, 0x41, 131, 0x00][..], if samples == 3 { &[131, 86, 131, 194] } else { &[] }].concat();
        let (channels, pixels) = read_bytes(&file.of_chunks(&[row.repeat(3), row.clone()])).unwrap();
        assert_eq!(channels.len(), samples);
        assert_eq!((pixels.pixel_type(), pixels.len()), (PixelType::Float, 20 * samples));
        assert!(pixels.to_floats().iter().all(|v| (v - 2.0).abs() < 0.03), "{pixels:?}");
        let error = read_bytes(&file.of_chunks(&[row.clone(), row.clone()])).unwrap_err().to_string();
        assert!(error.contains("row 1 is not 5 pixels"), "{error}");
    }
    let planes = File { compression: 34676, separate: true, ..File::new((5, 4), 3, 16).with(262, &[32845]) };
    assert!(read_bytes(&planes.of_chunks(&vec![vec![0]; 6])).unwrap_err().to_string().contains("in planes"));
}

#[test]
fn logarithms_of_24_bits_become_floats() {
    // libtiff decodes this pixel to X, Y and Z 0.965472, 0.497300 and 0.207504.
    let pixel = [0xaf, 0xf4, 0x30];
    let file = File { compression: 34677, ..File::new((5, 4), 3, 16).with(262, &[32845]) };
    let chunks = [pixel.repeat(15), pixel.repeat(5)];
    let (channels, pixels) = read_bytes(&file.of_chunks(&chunks)).unwrap();
    assert_eq!((channels.len(), pixels.len()), (3, 60));
    let [x, y, z] = [0.965_472_f32, 0.497_3, 0.207_504];
    let rgb = [
        2.690 * x - 1.276 * y - 0.414 * z,
        -1.022 * x + 1.978 * y + 0.044 * z,
        0.061 * x - 0.224 * y + 1.163 * z,
    ];
    for pixel in pixels.to_floats().chunks(3) {
        assert!(pixel.iter().zip(rgb).all(|(a, b)| (a - b).abs() < 1e-3), "{pixel:?} {rgb:?}");
    }
    let error = read_bytes(&file.of_chunks(&[chunks[0].clone(), vec![0; 14]])).unwrap_err().to_string();
    assert!(error.contains("14 of 15 bytes"), "{error}");
}

#[test]
fn lzma_holds_what_other_schemes_hold() {
    // libtiff's `tiffcp -c lzma` made them of files in the same folder, with a predictor and without.
    for (name, from) in [("lzma.tif", "none.tif"), ("lzma_tiled.tif", "tiled.tif")] {
        assert_eq!(read(&corpus(name)).unwrap(), read(&corpus(from)).unwrap(), "{name}");
    }
    let bytes = std::fs::read(corpus("lzma.tif")).unwrap();
    let at = bytes.windows(6).position(|w| w == b"\xfd7zXZ\0").unwrap();
    let mut damaged = bytes.clone();
    damaged[at + 30] ^= 0x55;
    assert!(read_bytes(&damaged).is_err());
    // The second byte of the properties of LZMA2 is the size of the dictionary, 4 GiB at most.
    let mut large = bytes.clone();
    let size = at + large[at..].windows(2).position(|w| w == [0x21, 1]).unwrap() + 2;
    large[size] = 40;
    let error = read_bytes(&large).unwrap_err().to_string();
    assert!(error.contains("lzma data after 0 of"), "{error}");
}

/// Returns one small file of each kind.
fn samples() -> Vec<(&'static str, Vec<u8>)> {
    let corpus = |name| (name, std::fs::read(corpus(name)).unwrap());
    let small = |file: File| file.of_numbers(&numbers(19 * 7 * file.samples, file.bits));
    let tiled = |file: File| File { tile: Some((16, 16)), ..file };
    vec![
        corpus("group4.tif"),
        corpus("group4_reversed.tif"),
        corpus("ccitt.tif"),
        corpus("group3.tif"),
        corpus("group3_differences.tif"),
        corpus("lzw_reversed.tif"),
        corpus("webp_lossless.tif"),
        corpus("webp_tiles.tif"),
        corpus("lzma.tif"),
        corpus("lzma_tiled.tif"),
        ("sgilog24", {
            let file = File { compression: 34677, ..File::new((19, 7), 3, 16).with(262, &[32845]) };
            file.of_chunks(&[[0xaf, 0xf4, 0x30].repeat(57), [0x80, 0, 9].repeat(57), [0x90, 1, 2].repeat(19)])
        }),
        ("i8", small(File { predictor: 2, compression: 5, ..File::new((19, 7), 3, 8).with(339, &[2; 3]) })),
        ("i16", small(tiled(File { compression: 8, ..File::new((19, 7), 2, 16).with(339, &[2; 2]) }))),
        ("u64", small(File { big_endian: true, ..File::new((19, 7), 1, 64) })),
        (
            "f64",
            small(tiled(File {
                predictor: 3,
                compression: 8,
                ..File::new((19, 7), 3, 64).with(339, &[3; 3])
            })),
        ),
        ("lab", small(File { compression: 5, ..File::new((19, 7), 3, 8).with(262, &[8]) })),
        ("icc lab", small(File { separate: true, ..File::new((19, 7), 3, 16).with(262, &[9]) })),
        ("cmyk", small(tiled(File::new((19, 7), 5, 8).with(262, &[5])))),
        ("ycbcr", ycbcr((2, 2), 8)),
    ]
}

#[test]
fn truncated_files_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in samples() {
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).unwrap();
        read(&path).unwrap();
        let file = std::fs::File::options().write(true).open(&path).unwrap();
        for n in (0..bytes.len()).rev() {
            // The file is shortened, not overwritten, because some disks synchronise each file that is.
            file.set_len(n as u64).unwrap();
            // The last bytes are the offset of the next directory, or the rest of a value.
            assert!(read(&path).is_err() || n + 8 > bytes.len(), "{name}: {n} of {}", bytes.len());
        }
    }
}

/// Checks that reading ends with a value or an error after any changes.
fn survive_changes(per_kind: u32) {
    for (name, bytes) in samples() {
        for salt in 0..per_kind {
            let mut changed = bytes.clone();
            for k in 0..=salt % 4 {
                let word = granita_base::hash::words(&[salt, k, name.len() as u32]);
                let at = word as usize % changed.len();
                match word >> 28 {
                    0..=9 => changed[at] ^= 1 << (word >> 25 & 7),
                    10..=13 => changed[at] = [0, 1, 127, 128, 255][(word >> 20) as usize % 5],
                    _ => changed.truncate(at.max(8)),
                }
            }
            let _ = read_bytes(&changed);
        }
    }
}

#[test]
fn changed_files_do_not_panic() {
    survive_changes(150);
}

#[test]
#[ignore = "a minute; the shorter one runs always"]
fn many_changed_files_do_not_panic() {
    survive_changes(2000);
}

#[test]
fn the_size_claimed_by_embedded_images_is_checked() {
    let bytes = std::fs::read(corpus("webp_lossless.tif")).unwrap();
    // A lossless image begins with its width and height in 14 bits each, after a mark.
    let at = bytes.windows(4).position(|w| w == b"VP8L").unwrap() + 9;
    let mut large = bytes.clone();
    large[at..at + 4].copy_from_slice(&[0xff, 0xdf, 0xff, 0x07]);
    let error = read_bytes(&large).unwrap_err().to_string();
    assert!(error.contains("8192 x 8192 pixels"), "{error}");
}
