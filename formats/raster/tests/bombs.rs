//! Headers that declare far more than their files hold are refused before memory is allocated for it.
#![allow(clippy::unwrap_used, reason = "tests")]

use granita_image::{CreateOptions, Format, ImageError, ImageInput, ImageSpec, Limits, PixelType, Pixels};
use std::path::PathBuf;

/// Opens a file of these bytes and reads all of it.
fn read(name: &str, bytes: &[u8]) -> Result<Pixels, ImageError> {
    let (_folder, input) = open(name, bytes)?;
    let height = input.spec(0, 0).unwrap().height;
    input.read_rows(0, 0, 0, height)
}

/// Opens a file of these bytes. The folder exists as long as the file is read.
fn open(name: &str, bytes: &[u8]) -> Result<(tempfile::TempDir, Box<dyn ImageInput>), ImageError> {
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let ending = path.extension().unwrap().to_str().unwrap();
    let format: std::sync::Arc<dyn Format> =
        granita_raster::formats().into_iter().find(|f| f.extensions().contains(&ending)).unwrap();
    Ok((folder, format.open(&path, &Limits::default())?))
}

fn tga(kind: u8, width: u16, height: u16, bits: u8, body: &[u8]) -> Vec<u8> {
    let mut file = vec![0, 0, kind, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    file.extend([width.to_le_bytes(), height.to_le_bytes()].concat());
    file.extend([bits, 0]);
    file.extend(body);
    file
}

#[test]
fn headers_that_claim_more_pixels_than_the_data_are_refused() {
    let gif =
        [b"GIF89a\xff\xff\xff\x7f\0\0\0," as &[u8], &[0, 0, 0, 0, 1, 0, 1, 0, 0], b"\x02\x02\x44\x01\0;"];
    let bmp = {
        let mut file = b"BM".to_vec();
        let words = [62, 0, 54, 40, 40000, 40000, 24 << 16 | 1, 0, 8, 0, 0, 0, 0_u32];
        file.extend(words.iter().flat_map(|w| w.to_le_bytes()));
        file.extend([0; 8]);
        file
    };
    let files = [
        ("a.gif", gif.concat()),
        ("a.tga", tga(2, 65535, 16000, 32, &[0; 8])),
        ("b.tga", tga(10, 65535, 16000, 32, &[0xff, 1, 2, 3, 4])),
        ("c.tga", tga(3, 65535, 65535, 8, &[0; 8])),
        ("a.bmp", bmp),
        ("a.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 10000\n\x02\x02\x27\x10".to_vec()),
        ("a.pbm", b"P4\n60000 60000\n\0\0\0\0".to_vec()),
        ("b.pgm", b"P2\n60000 60000\n255\n1 2 3".to_vec()),
        ("c.pgm", b"P5\n60000 60000\n254\n\0\0\0".to_vec()),
    ];
    for (name, bytes) in files {
        let error = read(name, &bytes).unwrap_err().to_string();
        assert!(error.contains("claims") || error.contains("exceeds"), "{error}");
    }
}

/// The file of CVE-2026-43996: an index of 32 bits so large that adding the length of a colour to it wraps around. It
/// passed the check, and colours were read beyond the palette. Smaller indices beyond it are wrong as well.
#[test]
fn tga_indices_beyond_the_palette_are_refused() {
    let paletted = |bits: u8, index: &[u8]| {
        let mut file = vec![0, 1, 1, 0, 0, 4, 0, 32, 0, 0, 0, 0, 1, 0, 1, 0, bits, 0x20];
        file.extend([10, 20, 30, 255].repeat(4));
        file.extend(index);
        file
    };
    assert_eq!(read("a.tga", &paletted(8, &[3])).unwrap(), Pixels::U8(vec![30, 20, 10, 255]));
    let indices: [(u8, &[u8]); 6] = [
        (8, &[4]),
        (8, &[255]),
        (16, &[4, 0]),
        (16, &[0xfc, 0xff]),
        (32, &[0xfc, 0xff, 0xff, 0xff]),
        (32, &[0xff, 0xff, 0xff, 0x3f]),
    ];
    for (bits, index) in indices {
        let error = read("a.tga", &paletted(bits, index)).unwrap_err();
        assert!(matches!(error, ImageError::Malformed { .. } | ImageError::Unsupported { .. }), "{error}");
    }
}

/// The screen of the GIF is small, but its image is not. The file is refused before memory is allocated for the image.
#[test]
fn gif_images_larger_than_their_screen_are_refused() {
    let screen: &[u8] = b"GIF89a\x20\0\x18\0\x80\0\0\0\0\0\xff\xff\xff";
    let gif = |width: u16, height: u16| {
        let size = [width.to_le_bytes(), height.to_le_bytes()].concat();
        [screen, b",\0\0\0\0", &size, b"\0\x02\x02\x44\x01\0;"].concat()
    };
    let error = read("a.gif", &gif(44_000, 44_000)).unwrap_err().to_string();
    assert!(error.contains("claims"), "{error}");
    let error = read("a.gif", &gif(40, 30)).map(|_| String::new()).unwrap_or_else(|e| e.to_string());
    assert!(!error.contains("claims"), "{error}");
}

/// Small images may lack any part, so that the available part can be read.
#[test]
fn small_images_open_even_if_data_is_missing() {
    assert!(open("a.tga", &tga(2, 1000, 1000, 32, &[0; 8])).is_ok());
    assert!(open("a.pbm", b"P4\n4000 4000\n\0\0\0\0").is_ok());
}

fn chunk(kind: &[u8; 4], body: &[u8]) -> Vec<u8> {
    let mut sum = crc32fast::Hasher::new();
    sum.update(kind);
    sum.update(body);
    [&(body.len() as u32).to_be_bytes()[..], kind, body, &sum.finalize().to_be_bytes()].concat()
}

/// Texts and colour profiles that unpack to a thousand times their length need neither time nor memory.
#[test]
fn compressed_texts_and_profiles_are_limited() {
    let deflated = |bytes: &[u8]| {
        let mut out = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
        std::io::Write::write_all(&mut out, bytes).unwrap();
        out.finish().unwrap()
    };
    let header = [0, 0, 0, 2, 0, 0, 0, 2, 8, 0, 0, 0, 0];
    let long = deflated(&vec![b'a'; 40 << 20]);
    let png = |texts: &[Vec<u8>]| {
        let front = [b"\x89PNG\r\n\x1a\n".to_vec(), chunk(b"IHDR", &header)].concat();
        let data = chunk(b"IDAT", &deflated(&[0; 6]));
        [front, texts.concat(), data, chunk(b"IEND", b"")].concat()
    };
    let text = |keyword: &[u8], packed: &[u8]| chunk(b"iTXt", &[keyword, b"\0\x01\0\0\0", packed].concat());
    let short = deflated(b"somebody");
    let file = png(&[
        text(b"Title", &long),
        text(b"Author", &short),
        chunk(b"iCCP", &[b"x\0\0", &long[..]].concat()),
    ]);
    let (_folder, input) = open("a.png", &file).unwrap();
    let spec = input.spec(0, 0).unwrap();
    assert_eq!((spec.string("DocumentName"), spec.string("Artist")), (None, Some("somebody")));
    // The name of a profile is not compressed.
    assert_eq!(spec.string("ICCProfile"), Some("x"));
    assert_eq!(input.read_rows(0, 0, 0, 2).unwrap(), Pixels::U8(vec![0; 4]));
}

fn iff(width: u32, height: u32, tiles: &[([u16; 4], &[u8])]) -> Vec<u8> {
    let sized = |kind: &[u8], body: &[u8]| {
        let mut out = [kind, &(body.len() as u32).to_be_bytes(), body].concat();
        out.resize(out.len().next_multiple_of(4), 0);
        out
    };
    let header = [
        &width.to_be_bytes()[..],
        &height.to_be_bytes(),
        &[0, 1, 0, 1, 0, 0, 0, 3, 0, 0],
        &(tiles.len() as u16).to_be_bytes(),
        &[0, 0, 0, 1],
    ];
    let tiles = tiles.iter().map(|(at, body)| {
        let at: Vec<u8> = at.iter().flat_map(|n| n.to_be_bytes()).collect();
        sized(b"RGBA", &[&at[..], body].concat())
    });
    let body =
        [b"CIMG".to_vec(), sized(b"TBHD", &header.concat()), tiles.collect::<Vec<_>>().concat()].concat();
    sized(b"FOR4", &body)
}

#[test]
fn overlapping_tiles_are_refused() {
    let run = [0xff, 9].repeat(4 * 16);
    let tile = |n: usize| vec![([0, 0, 31, 63], run.as_slice()); n];
    let file = iff(32, 64, &tile(1));
    assert_eq!(read("a.iff", &file).unwrap().len(), 32 * 64 * 4);
    let error = read("a.iff", &iff(32, 64, &tile(5))).unwrap_err().to_string();
    assert!(error.contains("its tiles hold 10240 pixels, of which the image has at most 8192"), "{error}");
}

/// A broken file is decoded once. Further requests for its rows do not read it again.
#[test]
fn truncated_files_are_decoded_once() {
    let folder = tempfile::tempdir().unwrap();
    let registry = granita_image::FormatRegistry::new(Limits::default());
    let registry = granita_raster::formats().into_iter().fold(registry, |mut registry, format| {
        registry.register(format);
        registry
    });
    for name in ["png", "webp"] {
        let path = folder.path().join(format!("cut.{name}"));
        let spec = ImageSpec::new(64, 64, 3, PixelType::U8);
        let mut file = registry.create(&path, name, &CreateOptions::new(&spec, 1)).unwrap();
        let noise = (0..64 * 64 * 3_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        file.write_rows(&Pixels::U8(noise)).unwrap();
        file.close().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        let file = registry.open(&path).unwrap();
        assert!(file.read_rows(0, 0, 0, 64).is_err(), "{name}");
        let read = file.bytes_read();
        assert!(file.read_rows(0, 0, 0, 64).is_err() && file.read_rows(0, 0, 60, 64).is_err(), "{name}");
        assert_eq!(file.bytes_read(), read, "{name}");
    }
}

#[test]
fn a_second_header_of_an_iff_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.iff");
    let format = granita_raster::formats().into_iter().find(|f| f.extensions().contains(&"iff")).unwrap();
    let spec = ImageSpec::new(16, 16, 3, PixelType::U8);
    let mut file = format.create(&path, &CreateOptions::new(&spec, 1)).unwrap();
    file.write_rows(&Pixels::U8(vec![9; 16 * 16 * 3])).unwrap();
    file.close().unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let at = bytes.windows(4).position(|w| w == b"TBHD").unwrap();
    // It declares an image of 16 x 4 pixels, below the tile that is there.
    let mut second = bytes[at..at + 32].to_vec();
    second[15] = 4;
    bytes.extend(second);
    let error = read("a.iff", &bytes).unwrap_err().to_string();
    assert!(error.contains("second header"), "{error}");
}
