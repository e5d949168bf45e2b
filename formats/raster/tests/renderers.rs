//! Files of older renderers that are made by hand: RLA and Softimage PIC.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_image::{Format, ImageInput, Limits, PixelType, Pixels};
use granita_raster::formats;
use std::sync::Arc;

fn open(name: &str, bytes: &[u8]) -> granita_image::Result<(tempfile::TempDir, Box<dyn ImageInput>)> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    std::fs::write(&path, bytes).unwrap();
    let format: Arc<dyn Format> = formats().into_iter().find(|f| f.name() == name).unwrap();
    assert!(format.recognizes(&bytes[..bytes.len().min(64)]));
    let input = format.open(&path, &Limits::default())?;
    Ok((folder, input))
}

fn pixels(name: &str, bytes: &[u8]) -> Pixels {
    open(name, bytes).unwrap().1.read_level(0, 0).unwrap()
}

fn error(name: &str, bytes: &[u8]) -> String {
    open(name, bytes).and_then(|(_folder, input)| input.read_level(0, 0)).unwrap_err().to_string()
}

/// The channels of an RLA file: their number, type and bits, of colours, mattes and auxiliary ones.
type Groups = [[i16; 3]; 3];

const RGB: Groups = [[3, 0, 8], [0; 3], [0; 3]];

/// Returns an RLA image that begins at `at` of its file. `rows` are its encoded rows from the lowest on.
fn rla(at: u32, width: i16, rows: &[Vec<u8>], groups: Groups, next: u32) -> Vec<u8> {
    let mut file = vec![0; 740];
    let mut short = |at: usize, v: i16| file[at..at + 2].copy_from_slice(&v.to_be_bytes());
    for (at, v) in [(2, 99), (6, 49), (8, 10), (10, 9 + width), (12, 5), (14, 4 + rows.len() as i16), (16, 7)]
    {
        short(at, v);
    }
    for ([count, kind, bits], places) in groups.iter().zip([[20, 18, 658], [22, 660, 662], [24, 664, 666]]) {
        places.iter().zip([count, kind, bits]).for_each(|(at, v)| short(*at, *v));
    }
    short(26, -2);
    file[272..277].copy_from_slice(b"a car");
    file[736..740].copy_from_slice(&next.to_be_bytes());
    let mut place = at + 740 + 4 * rows.len() as u32;
    for row in rows {
        file.extend(place.to_be_bytes());
        place += row.len() as u32;
    }
    file.extend(rows.concat());
    file
}

/// Returns a channel of a row with its length.
fn record(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u16).to_be_bytes()[..], bytes].concat()
}

#[test]
fn rla_rows_run_upward_and_are_unpacked() {
    let low = [record(&[1, 5]), record(&[254, 6, 7]), record(&[255, 8, 0, 9])].concat();
    let high = [record(&[1, 1]), record(&[1, 2]), record(&[1, 3])].concat();
    let (_folder, input) = open("rla", &rla(0, 2, &[low, high], RGB, 0)).unwrap();
    assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U8(vec![1, 2, 3, 1, 2, 3, 5, 6, 8, 5, 7, 9]));
    assert_eq!(input.read_rows(0, 0, 1, 2).unwrap(), Pixels::U8(vec![5, 6, 8, 5, 7, 9]));
    let spec = input.spec(0, 0).unwrap();
    // The window is 100 x 50, and its lowest row is 0. The image has its rows 5 and 6.
    assert_eq!((spec.x, spec.y, spec.full_width, spec.full_height), (10, 43, 100, 50));
    assert_eq!(
        (spec.string("ImageDescription"), spec.attributes.int("rla:FrameNumber")),
        (Some("a car"), Some(7))
    );
}

#[test]
fn rla_channels_of_other_types_are_read() {
    // Sixteen bits: the high bytes of both values, then the low ones.
    let sixteen = rla(0, 2, &[record(&[254, 1, 2, 254, 3, 4])], [[1, 1, 16], [0; 3], [0; 3]], 0);
    assert_eq!(pixels("rla", &sixteen), Pixels::U16(vec![0x103, 0x204]));
    let ten = rla(0, 2, &[record(&[254, 3, 0, 254, 255, 0])], [[1, 0, 10], [0; 3], [0; 3]], 0);
    assert_eq!(pixels("rla", &ten), Pixels::U16(vec![65535, 0]));
    let number = rla(0, 1, &[record(&[0, 1, 0, 2, 0, 3, 0, 4])], [[1, 2, 32], [0; 3], [0; 3]], 0);
    assert_eq!(pixels("rla", &number), Pixels::U32(vec![0x1020304]));
    // Colour and alpha of 8 bits with a depth of floats become floats.
    let depth = record(&12.5_f32.to_be_bytes());
    let row = [record(&[0, 255]), record(&[0, 51]), depth].concat();
    let mixed = rla(0, 1, &[row], [[1, 0, 8], [1, 0, 8], [1, 4, 32]], 0);
    let (_folder, input) = open("rla", &mixed).unwrap();
    assert_eq!(input.spec(0, 0).unwrap().channels.join(" "), "Y A Z");
    assert_eq!(input.read_level(0, 0).unwrap(), Pixels::Float(vec![1.0, 0.2, 12.5]));
}

#[test]
fn concatenated_rla_files_are_images() {
    let row = [record(&[1, 5]), record(&[1, 6]), record(&[1, 7])].concat();
    let first = rla(0, 2, std::slice::from_ref(&row), RGB, 0);
    let n = first.len() as u32;
    let file =
        [rla(0, 2, std::slice::from_ref(&row), RGB, n), rla(n, 2, &[row.clone(), row.clone()], RGB, 0)]
            .concat();
    let (_folder, input) = open("rla", &file).unwrap();
    assert_eq!(input.images(), 2);
    assert_eq!(input.read_level(1, 0).unwrap(), Pixels::U8([5, 6, 7].repeat(4)));
    // An image that follows itself would have no end.
    let endless = rla(0, 2, &[row], RGB, 20);
    assert!(error("rla", &endless).contains("the image after that at byte 0 is at byte 20"));
}

#[test]
fn rla_files_that_are_damaged_are_refused() {
    let row = [record(&[1, 5]), record(&[1, 6]), record(&[1, 7])].concat();
    let of = |row: Vec<u8>, groups: Groups| error("rla", &rla(0, 2, &[row], groups, 0));
    assert!(of([record(&[1, 5]), record(&[2, 6]), record(&[1, 7])].concat(), RGB).contains("channel 1"));
    assert!(of([record(&[1, 5]), record(&[1])].concat(), RGB).contains("is not 2 values"));
    assert!(of(record(&[1, 5]), RGB).contains("the length of a row"));
    assert!(of(record(&[0; 7]), [[1, 4, 32], [0; 3], [0; 3]]).contains("is not 2 values"));
    assert!(of(row.clone(), [[3, 0, 8], [1, 9, 8], [0; 3]]).contains("type 9"));
    assert!(of(row.clone(), [[3, 0, 8], [1, 0, 99], [0; 3]]).contains("99 bits"));
    assert!(of(row.clone(), [[3, 0, 8], [0; 3], [300, 0, 8]]).contains("300 channels"));
    assert!(error("rla", &rla(0, 0, &[row], RGB, 0)).contains("0 x 1"));
    assert!(error("rla", &rla(0, 2, &[], RGB, 0)).contains("2 x 0"));
    let tall = rla(0, 2, &[], RGB, 0);
    let tall = [&tall[..14], &30_000_i16.to_be_bytes(), &tall[16..]].concat();
    assert!(error("rla", &tall).contains("the table of rows"));
}

/// Returns a PIC file of these packets (bits, type, channels).
fn pic(size: [u16; 2], packets: &[[u8; 3]], body: &[u8]) -> Vec<u8> {
    let mut file = vec![0x53, 0x80, 0xf6, 0x34, 0, 0, 0, 0];
    file.extend(b"a sphere");
    file.resize(88, 0);
    file.extend(b"PICT");
    size.iter().for_each(|n| file.extend(n.to_be_bytes()));
    file.extend(1_f32.to_be_bytes());
    file.extend([0, 3, 0, 0]);
    for (i, packet) in packets.iter().enumerate() {
        file.push(u8::from(i + 1 < packets.len()));
        file.extend(packet);
    }
    file.extend(body);
    file
}

#[test]
fn pic_packets_of_every_encoding_are_read() {
    let plain = pic([2, 1], &[[8, 0, 0xe0]], &[1, 2, 3, 4, 5, 6]);
    let (_folder, input) = open("softimage", &plain).unwrap();
    assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U8(vec![1, 2, 3, 4, 5, 6]));
    assert_eq!(input.spec(0, 0).unwrap().string("ImageDescription"), Some("a sphere"));
    // Colours are mixed runs, alpha is pure ones.
    let body = [129, 1, 2, 3, 0, 4, 5, 6, 2, 10, 1, 20];
    let both = pic([3, 1], &[[8, 2, 0xe0], [8, 1, 0x10]], &body);
    let (_folder, input) = open("softimage", &both).unwrap();
    assert_eq!(input.spec(0, 0).unwrap().channels.join(" "), "R G B A");
    assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U8(vec![1, 2, 3, 10, 1, 2, 3, 10, 4, 5, 6, 20]));
    let long = pic([300, 1], &[[8, 2, 0xe0]], &[128, 1, 44, 7, 8, 9]);
    assert_eq!(pixels("softimage", &long), Pixels::U8([7, 8, 9].repeat(300)));
    let sixteen = pic([2, 1], &[[16, 1, 0x80], [16, 0, 0x40]], &[2, 1, 2, 0, 3, 0, 4]);
    let (_folder, input) = open("softimage", &sixteen).unwrap();
    assert_eq!(input.spec(0, 0).unwrap().channels.join(" "), "R G");
    assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U16(vec![0x102, 3, 0x102, 4]));
    assert_eq!(input.spec(0, 0).unwrap().pixel_type, PixelType::U16);
}

/// Runs that exceed their row wrote behind the buffer in other readers (CVE-2026-43904). Empty runs would never end.
#[test]
fn pic_runs_that_exceed_their_row_are_refused() {
    for (kind, body) in [
        (1, &[4, 1, 2, 3][..]),
        (1, &[0, 1, 2, 3]),
        (2, &[131, 1, 2, 3]),
        (2, &[3, 1, 2, 3, 1, 2, 3, 1, 2, 3, 1, 2, 3]),
        (2, &[128, 0, 0, 1, 2, 3]),
        (2, &[128, 0xff, 0xff, 1, 2, 3]),
    ] {
        let text = error("softimage", &pic([3, 1], &[[8, kind, 0xe0]], body));
        assert!(text.contains("the runs of row 0 do not fit 3"), "{text}");
    }
}

#[test]
fn pic_files_that_are_damaged_or_of_other_kinds_are_refused_by_name() {
    for (packets, word) in [
        (&[[8, 0x10, 0xe0]][..], "type 0x10"),
        (&[[8, 3, 0xe0]], "type 0x3"),
        (&[[32, 0, 0xe0]], "32 bits"),
        (&[[8, 0, 0xe0], [16, 0, 0x10]], "different sizes"),
        (&[[8, 0, 0xe0], [8, 0, 0x80]], "after those"),
        (&[[8, 0, 0]], "channels 0x0"),
    ] {
        assert!(error("softimage", &pic([1, 1], packets, &[0; 9])).contains(word), "{word}");
    }
    assert!(error("softimage", &pic([0, 1], &[[8, 0, 0xe0]], &[])).contains("0 x 1"));
    assert!(error("softimage", &pic([1, 1], &[[8, 0, 0xe0]], &[])[..90]).contains("the file ends early"));
    assert!(
        error("softimage", &pic([60_000, 60_000], &[[8, 0, 0xe0]], &[1, 2]))
            .contains("claims 10800000000 bytes")
    );
    // Of a file that ends early the first rows can be read.
    let (_folder, input) = open("softimage", &pic([1, 3], &[[8, 0, 0xe0]], &[1, 2, 3, 4, 5])).unwrap();
    assert_eq!(input.read_rows(0, 0, 0, 1).unwrap(), Pixels::U8(vec![1, 2, 3]));
    assert!(input.read_rows(0, 0, 0, 2).unwrap_err().to_string().contains("1 of 3 rows are there"));
}
