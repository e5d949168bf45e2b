//! FITS files that are made by hand, card by card.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_image::{Format, ImageInput, Limits, PixelType, Pixels};
use granita_raster::FitsFormat;

fn open(bytes: &[u8]) -> granita_image::Result<(tempfile::TempDir, Box<dyn ImageInput>)> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.fits");
    std::fs::write(&path, bytes).unwrap();
    let input = FitsFormat.open(&path, &Limits::default())?;
    Ok((folder, input))
}

/// Returns a header of these cards in whole blocks.
fn header(cards: &[&str]) -> Vec<u8> {
    let mut out: Vec<u8> =
        cards.iter().chain(&["END"]).flat_map(|card| format!("{card:80}").into_bytes()).collect();
    out.resize(out.len().next_multiple_of(2880), b' ');
    out
}

fn blocks(data: &[u8]) -> Vec<u8> {
    let mut out = data.to_vec();
    out.resize(out.len().next_multiple_of(2880), 0);
    out
}

/// Returns the primary image with two axes and further cards.
fn image(bits: i32, size: [u32; 2], cards: &[&str], data: &[u8]) -> Vec<u8> {
    let bits = format!("BITPIX  = {bits:20}");
    let axes = size.map(|n| format!("{n:20}"));
    let (x, y) = (format!("NAXIS1  = {}", axes[0]), format!("NAXIS2  = {}", axes[1]));
    let first = ["SIMPLE  =                    T", &bits, "NAXIS   =                    2", &x, &y];
    [header(&[&first[..], cards].concat()), blocks(data)].concat()
}

fn pixels(bytes: &[u8]) -> Pixels {
    open(bytes).unwrap().1.read_level(0, 0).unwrap()
}

fn error(bytes: &[u8]) -> String {
    open(bytes).and_then(|(_folder, input)| input.read_level(0, 0)).unwrap_err().to_string()
}

#[test]
fn fits_rows_run_upward_and_types_are_kept_where_they_fit() {
    assert_eq!(pixels(&image(8, [2, 2], &[], &[1, 2, 3, 4])), Pixels::U8(vec![3, 4, 1, 2]));
    let unsigned = ["BZERO   =                32768", "BSCALE  =                  1.0"];
    assert_eq!(pixels(&image(16, [2, 1], &unsigned, &[0x80, 0, 0x7f, 0xff])), Pixels::U16(vec![0, 65535]));
    let unsigned = ["BZERO   =           2147483648"];
    let data = [0x80, 0, 0, 1, 0x7f, 0xff, 0xff, 0xff];
    assert_eq!(pixels(&image(32, [2, 1], &unsigned, &data)), Pixels::U32(vec![1, u32::MAX]));
    assert_eq!(pixels(&image(16, [2, 1], &[], &[0xff, 0xfd, 0, 9])), Pixels::Float(vec![-3.0, 9.0]));
    let scaled = ["BSCALE  =               0.5D+0 / a comment", "BZERO   =                   10"];
    assert_eq!(pixels(&image(8, [2, 1], &scaled, &[4, 9])), Pixels::Float(vec![12.0, 14.5]));
    let long = [(-5_i64).to_be_bytes(), 7_i64.to_be_bytes()].concat();
    assert_eq!(pixels(&image(64, [2, 1], &[], &long)), Pixels::Float(vec![-5.0, 7.0]));
    let real = [0.25_f32.to_be_bytes(), (-1.5_f32).to_be_bytes()].concat();
    assert_eq!(pixels(&image(-32, [1, 2], &[], &real)), Pixels::Float(vec![-1.5, 0.25]));
    let double = [0.25_f64.to_be_bytes(), (-1.5_f64).to_be_bytes()].concat();
    assert_eq!(pixels(&image(-64, [2, 1], &[], &double)), Pixels::Float(vec![0.25, -1.5]));
    let blank = pixels(&image(16, [2, 1], &["BLANK   =                   -1"], &[0xff, 0xff, 0, 2]));
    assert!(blank.get(0).is_nan() && blank.get(1) == 2.0);
}

#[test]
fn fits_planes_are_channels_and_extensions_are_images() {
    let cube = header(&[
        "SIMPLE  =                    T",
        "BITPIX  =                    8",
        "NAXIS   =                    3",
        "NAXIS1  =                    1",
        "NAXIS2  =                    2",
        "NAXIS3  =                    3",
    ]);
    let table = header(&[
        "XTENSION= 'BINTABLE'",
        "BITPIX  =                    8",
        "NAXIS   =                    2",
        "NAXIS1  =                   40",
        "NAXIS2  =                   90",
        "PCOUNT  =                    7",
        "GCOUNT  =                    1",
    ]);
    let second = header(&[
        "XTENSION= 'IMAGE   '",
        "BITPIX  =                    8",
        "NAXIS   =                    1",
        "NAXIS1  =                    2",
    ]);
    let parts = [cube, blocks(&[1, 2, 3, 4, 5, 6]), table, blocks(&[9; 3607]), second, blocks(&[7, 8])];
    let (_folder, input) = open(&parts.concat()).unwrap();
    assert_eq!(input.images(), 2);
    assert_eq!(input.spec(0, 0).unwrap().channels.join(" "), "R G B");
    assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U8(vec![2, 4, 6, 1, 3, 5]));
    assert_eq!(input.read_rows(0, 0, 1, 2).unwrap(), Pixels::U8(vec![1, 3, 5]));
    assert_eq!(input.read_level(1, 0).unwrap(), Pixels::U8(vec![7, 8]));
    // The last image is cut off. The first one can still be read.
    let cut = &parts.concat()[..parts.concat().len() - 2880];
    let (_folder, input) = open(cut).unwrap();
    assert!(input.read_level(0, 0).is_ok());
    assert!(input.read_level(1, 0).unwrap_err().to_string().contains("rows of pixels is 2 bytes"));
}

#[test]
fn fits_keywords_are_attributes() {
    let cards = [
        "OBJECT  = 'M 31    '           / the galaxy",
        "EXPTIME =                120.5",
        "NCOMBINE=                    4",
        "COMMENT not a value",
    ];
    let (_folder, input) = open(&image(8, [1, 1], &cards, &[0])).unwrap();
    let spec = input.spec(0, 0).unwrap();
    assert_eq!(spec.string("fits:OBJECT"), Some("M 31"));
    assert_eq!(spec.attributes.float("fits:EXPTIME"), Some(120.5));
    assert_eq!(spec.attributes.int("fits:NCOMBINE"), Some(4));
    assert_eq!(spec.attributes.iter().count(), 3);
    assert_eq!(spec.pixel_type, PixelType::U8);
}

#[test]
fn fits_files_that_are_damaged_or_without_an_image_are_refused_by_name() {
    let header_of = |cards: &[&str]| header(&[&["SIMPLE  =                    T"], cards].concat());
    for (file, word) in [
        (
            header_of(&["BITPIX  =                    8", "NAXIS   =                    0"]),
            "without an image",
        ),
        (image(12, [1, 1], &[], &[0]), "values of 12 bits"),
        (image(8, [0, 1], &[], &[0]), "without an image"),
        (image(8, [4_000_000_000, 1], &[], &[0]), "exceeds"),
        (image(8, [1, 1], &["BZERO   =                 zero"], &[0]), "\"zero\" of BZERO"),
        (image(8, [1, 1], &["BSCALE  =                  1E999"], &[0]), "\"1E999\" of BSCALE"),
        (header_of(&["NAXIS   =                   -1"]), "-1 axes"),
        (header_of(&["NAXIS   =                    x"]), "\"x\" of NAXIS"),
        (header_of(&["NAXIS   =                    1", "NAXIS1  =                   -5"]), "length -5"),
        (image(8, [1, 1], &[], &[0])[..2000].to_vec(), "a block of the header"),
        (b"SIMPLE  =".repeat(400)[..2880].to_vec(), "a block of the header"),
    ] {
        assert!(error(&file).contains(word), "{word}: {}", error(&file));
    }
    // Products of axes that do not fit 64 bits end the search for further images.
    let axes = ["BITPIX  =                    8", "NAXIS   =                    4"];
    let lengths = [1, 2, 3, 4].map(|i| format!("NAXIS{i}  =   {}", i64::MAX));
    let lengths: Vec<&str> = lengths.iter().map(|s| &**s).collect();
    assert!(error(&header_of(&[&axes[..], &lengths].concat())).contains("4 axes"));
}
