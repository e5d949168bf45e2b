//! Scanned film and video: DPX and Cineon files that are made by hand, bit by bit.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::Param;
use granita_image::{CreateOptions, Format, ImageInput, ImageSpec, Limits, PixelType, Pixels};
use granita_raster::formats;
use std::path::Path;
use std::sync::Arc;

fn format(name: &str) -> Arc<dyn Format> {
    formats().into_iter().find(|f| f.name() == name).unwrap()
}

/// Opens a file of these bytes. The folder exists as long as the file is read.
fn open(name: &str, bytes: &[u8]) -> granita_image::Result<(tempfile::TempDir, Box<dyn ImageInput>)> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("a.{name}"));
    std::fs::write(&path, bytes).unwrap();
    let input = format(name).open(&path, &Limits::default())?;
    Ok((folder, input))
}

fn pixels(name: &str, bytes: &[u8]) -> granita_image::Result<Pixels> {
    open(name, bytes)?.1.read_level(0, 0)
}

fn error(name: &str, bytes: &[u8]) -> String {
    pixels(name, bytes).unwrap_err().to_string()
}

/// A DPX file with one element.
#[derive(Clone)]
struct Dpx {
    big: bool,
    size: [u32; 2],
    orientation: u16,
    descriptor: u8,
    bits: u8,
    packing: u16,
    encoding: u16,
    sign: u32,
    body: Vec<u8>,
}

impl Dpx {
    fn new(width: u32, height: u32, descriptor: u8, bits: u8) -> Self {
        let size = [width, height];
        let (packing, encoding, sign) = (1, 0, 0);
        Self { big: true, size, orientation: 0, descriptor, bits, packing, encoding, sign, body: Vec::new() }
    }

    fn words(mut self, words: &[u32]) -> Self {
        let bytes = words.iter().flat_map(|w| if self.big { w.to_be_bytes() } else { w.to_le_bytes() });
        self.body = bytes.collect();
        self
    }

    fn bytes(&self) -> Vec<u8> {
        let mut file = vec![0xff; 2048];
        let long = |v: u32| if self.big { v.to_be_bytes() } else { v.to_le_bytes() };
        let short = |v: u16| if self.big { v.to_be_bytes() } else { v.to_le_bytes() };
        file[..4].copy_from_slice(if self.big { b"SDPX" } else { b"XPDS" });
        file[8..13].copy_from_slice(b"V2.0\0");
        for (at, v) in
            [(4, 2048), (772, self.size[0]), (776, self.size[1]), (780, self.sign), (808, u32::MAX)]
        {
            file[at..at + 4].copy_from_slice(&long(v));
        }
        for (at, v) in [(768, self.orientation), (770, 1), (804, self.packing), (806, self.encoding)] {
            file[at..at + 2].copy_from_slice(&short(v));
        }
        [file[800], file[801], file[802], file[803]] = [self.descriptor, 3, 1, self.bits];
        [file, self.body.clone()].concat()
    }
}

/// Returns 16 bits whose high bits are repeated as the low ones.
fn wide(v: u32, bits: u32) -> u16 {
    (v << (16 - bits) | v >> (2 * bits - 16)) as u16
}

#[test]
fn dpx_of_ten_bits_is_read_in_every_packing() {
    let expected = Pixels::U16([1, 2, 3, 1020, 512, 0].map(|v| wide(v, 10)).to_vec());
    for big in [true, false] {
        let rgb = Dpx { big, ..Dpx::new(2, 1, 50, 10) };
        let method_a = rgb.clone().words(&[1 << 22 | 2 << 12 | 3 << 2, 1020 << 22 | 512 << 12]);
        assert_eq!(pixels("dpx", &method_a.bytes()).unwrap(), expected);
        let method_b =
            Dpx { packing: 2, ..rgb.clone() }.words(&[1 << 20 | 2 << 10 | 3, 1020 << 20 | 512 << 10]);
        assert_eq!(pixels("dpx", &method_b.bytes()).unwrap(), expected);
        // The fourth value continues in the second word.
        let all = 1_u64 | 2 << 10 | 3 << 20 | 1020 << 30 | 512 << 40;
        let packed = Dpx { packing: 0, ..rgb.clone() }.words(&[all as u32, (all >> 32) as u32]);
        assert_eq!(pixels("dpx", &packed.bytes()).unwrap(), expected);
        // Of one channel the first value has the lowest bits.
        let grey = Dpx { big, ..Dpx::new(6, 1, 6, 10) };
        let grey = grey.words(&[3 << 22 | 2 << 12 | 1 << 2, 512 << 12 | 1020 << 2]);
        assert_eq!(pixels("dpx", &grey.bytes()).unwrap(), expected);
        let (_folder, input) = open("dpx", &grey.bytes()).unwrap();
        assert_eq!(input.spec(0, 0).unwrap().attributes.int("BitsPerSample"), Some(10));
        assert_eq!(input.spec(0, 0).unwrap().string("dpx:Transfer"), Some("Logarithmic"));
        assert_eq!(input.spec(0, 0).unwrap().string("dpx:Colorimetric"), Some("Printing density"));
    }
}

#[test]
fn dpx_of_other_sizes_is_read_in_both_byte_orders() {
    for big in [true, false] {
        let of = |descriptor, bits, packing, body: Vec<u8>| {
            let file = Dpx { big, packing, body, ..Dpx::new(2, 1, descriptor, bits) };
            pixels("dpx", &file.bytes()).unwrap()
        };
        let shorts = |v: &[u16]| -> Vec<u8> {
            v.iter().flat_map(|v| if big { v.to_be_bytes() } else { v.to_le_bytes() }).collect()
        };
        let twelve = Pixels::U16(vec![wide(0x123, 12), wide(0xfed, 12)]);
        assert_eq!(of(6, 12, 1, shorts(&[0x1230, 0xfed0])), twelve);
        assert_eq!(of(6, 12, 2, shorts(&[0x0123, 0x0fed])), twelve);
        let word = 0x123_u32 | 0xfed << 12;
        assert_eq!(of(6, 12, 0, if big { word.to_be_bytes() } else { word.to_le_bytes() }.to_vec()), twelve);
        assert_eq!(of(6, 16, 0, shorts(&[7, 65535])), Pixels::U16(vec![7, 65535]));
        assert_eq!(of(6, 8, 0, vec![7, 255]), Pixels::U8(vec![7, 255]));
        let floats = [0.5_f32, -3.25];
        let real = |v: &f32| if big { v.to_be_bytes() } else { v.to_le_bytes() };
        assert_eq!(of(8, 32, 0, floats.iter().flat_map(real).collect()), Pixels::Float(floats.to_vec()));
        let double = |v: &f32| if big { f64::from(*v).to_be_bytes() } else { f64::from(*v).to_le_bytes() };
        assert_eq!(of(8, 64, 0, floats.iter().flat_map(double).collect()), Pixels::Float(floats.to_vec()));
    }
}

#[test]
fn dpx_channels_are_arranged_by_their_descriptor() {
    let of = |descriptor, width, body: &[u8]| {
        let file = Dpx { body: body.to_vec(), packing: 0, ..Dpx::new(width, 1, descriptor, 8) };
        let (_folder, input) = open("dpx", &file.bytes()).unwrap();
        (input.spec(0, 0).unwrap().channels.join(" "), input.read_level(0, 0).unwrap())
    };
    let abgr = of(52, 2, &[4, 3, 2, 1, 8, 7, 6, 5]);
    assert_eq!(abgr, ("R G B A".to_owned(), Pixels::U8(vec![1, 2, 3, 4, 5, 6, 7, 8])));
    // Two pixels share a colour difference. The last pair of an odd row is complete.
    let pairs = of(100, 3, &[1, 2, 3, 4, 5, 6, 7, 8]);
    assert_eq!(pairs, ("Cb Y Cr".to_owned(), Pixels::U8(vec![1, 2, 3, 1, 4, 3, 5, 6, 7])));
    let pairs = of(101, 2, &[1, 2, 3, 4, 5, 6]);
    assert_eq!(pairs, ("Cb Y Cr A".to_owned(), Pixels::U8(vec![1, 2, 4, 3, 1, 5, 4, 6])));
    assert_eq!(of(102, 1, &[1, 2, 3]).0, "Cb Y Cr");
    assert_eq!(of(151, 1, &[1, 2, 3]).0, "channel0 channel1 channel2");
    assert_eq!(of(4, 1, &[1]).0, "A");
}

#[test]
fn dpx_orientation_turns_rows_and_columns() {
    for (orientation, expected) in
        [(0, [1, 2, 3, 4]), (1, [2, 1, 4, 3]), (2, [3, 4, 1, 2]), (3, [4, 3, 2, 1])]
    {
        let body = vec![1, 2, 3, 4];
        let file = Dpx { orientation, body, packing: 0, ..Dpx::new(2, 2, 6, 8) };
        assert_eq!(pixels("dpx", &file.bytes()).unwrap(), Pixels::U8(expected.to_vec()), "{orientation}");
    }
    let file = Dpx { orientation: 5, ..Dpx::new(2, 2, 6, 8) };
    assert!(error("dpx", &file.bytes()).contains("orientation 5"));
}

/// Rows begin at whole words where the file has the space. Otherwise they follow each other.
#[test]
fn dpx_rows_are_found_with_and_without_padding() {
    let file = Dpx { packing: 0, body: vec![1, 2, 3, 4, 5, 6], ..Dpx::new(1, 2, 50, 8) };
    assert_eq!(pixels("dpx", &file.bytes()).unwrap(), Pixels::U8(vec![1, 2, 3, 4, 5, 6]));
    let file = Dpx { body: vec![1, 2, 3, 0, 4, 5, 6, 0], ..file };
    assert_eq!(pixels("dpx", &file.bytes()).unwrap(), Pixels::U8(vec![1, 2, 3, 4, 5, 6]));
    let mut padded = Dpx { body: vec![1, 2, 3, 0, 0, 4, 5, 6, 0, 0], ..file }.bytes();
    padded[812..816].copy_from_slice(&2_u32.to_be_bytes());
    assert_eq!(pixels("dpx", &padded).unwrap(), Pixels::U8(vec![1, 2, 3, 4, 5, 6]));
}

#[test]
fn dpx_elements_are_images() {
    let mut file = Dpx { packing: 0, body: vec![1, 2, 9, 8, 7, 6, 5, 4], ..Dpx::new(2, 1, 4, 8) }.bytes();
    file[770..772].copy_from_slice(&2_u16.to_be_bytes());
    file.copy_within(780..852, 852);
    file[852 + 20] = 50;
    file[852 + 28..852 + 32].copy_from_slice(&2050_u32.to_be_bytes());
    let (_folder, input) = open("dpx", &file).unwrap();
    assert_eq!(input.images(), 2);
    assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U8(vec![1, 2]));
    assert_eq!(input.read_level(1, 0).unwrap(), Pixels::U8(vec![9, 8, 7, 6, 5, 4]));
}

#[test]
fn dpx_files_that_are_damaged_or_of_other_kinds_are_refused_by_name() {
    let file = Dpx { packing: 0, body: vec![0; 64], ..Dpx::new(2, 2, 50, 8) };
    for (file, word) in [
        (Dpx { encoding: 1, ..file.clone() }, "run-length"),
        (Dpx { sign: 1, ..file.clone() }, "signed"),
        (Dpx { bits: 1, ..file.clone() }, "1 bits"),
        (Dpx { descriptor: 7, ..file.clone() }, "descriptor 7"),
        (Dpx { size: [0, 2], ..file.clone() }, "0 x 2"),
        (Dpx { size: [u32::MAX, 2], ..file.clone() }, "exceeds"),
        (Dpx { size: [1000, 2], ..file.clone() }, "a row of 3000 bytes"),
        (Dpx { size: [2, 2000], ..file.clone() }, "10 of 2000 rows"),
    ] {
        assert!(error("dpx", &file.bytes()).contains(word), "{}", error("dpx", &file.bytes()));
    }
    assert!(error("dpx", &file.bytes()[..700]).contains("of which the file has 700"));
    let mut elements = file.bytes();
    elements[771] = 9;
    assert!(error("dpx", &elements).contains("9 image elements"));
    elements[771] = 0;
    assert!(error("dpx", &elements).contains("0 image elements"));
    let mut beyond = file.bytes();
    beyond[808..812].copy_from_slice(&0xffff_fff0_u32.to_be_bytes());
    assert!(error("dpx", &beyond).contains("at byte 4294967280"), "{}", error("dpx", &beyond));
}

/// The file of CVE-2026-43909: ABGR of so many pixels that four times their number does not fit 32 bits. Reordering
/// its channels wrote in front of the buffer.
#[test]
fn dpx_with_more_reversed_pixels_than_fit_32_bits_is_refused() {
    for size in
        [[32_768, 16_385], [65_536, 65_536], [1 << 20, 1 << 20], [0x2000_0001, 1], [u32::MAX, u32::MAX]]
    {
        let file = Dpx { size, packing: 0, body: vec![0; 4096], ..Dpx::new(1, 1, 52, 8) };
        let text = error("dpx", &file.bytes());
        assert!(text.contains("a row of") || text.contains("exceeds"), "{text}");
    }
    // The first row is there. The others are reported as missing, before memory is allocated for them.
    let file = Dpx { size: [32_768, 16_385], packing: 0, body: vec![9; 32_768 * 4], ..Dpx::new(1, 1, 52, 8) };
    let (_folder, input) = open("dpx", &file.bytes()).unwrap();
    assert_eq!(input.read_rows(0, 0, 0, 1).unwrap(), Pixels::U8(vec![9; 32_768 * 4]));
    let text = input.read_rows(0, 0, 0, 16_385).unwrap_err().to_string();
    assert!(text.contains("1 of 16385 rows"), "{text}");
}

fn write(path: &Path, name: &str, spec: &ImageSpec, pixels: &Pixels) {
    let mut out = format(name).create(path, &CreateOptions::new(spec, 1)).unwrap();
    out.write_rows(pixels).unwrap();
    out.close().unwrap();
}

#[test]
fn dpx_of_ten_and_twelve_bits_survives_write_and_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dpx");
    for bits in [10, 12] {
        for n in [1, 3, 4] {
            let mut spec = ImageSpec::new(7, 5, n, PixelType::U16);
            spec.attributes.set(Param::declared("int BitsPerSample", bits).unwrap());
            let value = |i: usize| wide((i as u32 * 37) & ((1 << bits) - 1), bits as u32);
            let pixels = Pixels::U16((0..35 * n).map(value).collect());
            write(&path, "dpx", &spec, &pixels);
            let input = format("dpx").open(&path, &Limits::default()).unwrap();
            assert_eq!(input.read_level(0, 0).unwrap(), pixels, "{bits} {n}");
            assert_eq!(input.spec(0, 0).unwrap().attributes.int("BitsPerSample"), Some(bits));
        }
    }
    let mut spec = ImageSpec::new(7, 5, 3, PixelType::U16);
    spec.attributes.set(Param::declared("int BitsPerSample", 9).unwrap());
    let error = format("dpx").create(&path, &CreateOptions::new(&spec, 1)).err().unwrap().to_string();
    assert!(error.contains("not 9"), "{error}");
}

#[test]
fn dpx_metadata_and_windows_survive_write_and_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.dpx");
    let mut spec = ImageSpec::new(4, 3, 3, PixelType::U8);
    (spec.x, spec.y, spec.full_width, spec.full_height) = (5, 6, 100, 50);
    for (name, text) in [
        ("dpx:Transfer", "Logarithmic"),
        ("dpx:Colorimetric", "Printing density"),
        ("dpx:FilmEdgeCode", "0102030000040005"),
        ("dpx:SlateInfo", "scene 5, take 2"),
        ("dpx:InputDevice", "scanner"),
        ("dpx:TimeCode", "01:02:03:24"),
        ("DateTime", "2024:05:06 07:08:09"),
        ("copyright", "a studio"),
        ("ImageDescription", "a plate"),
        ("software", "a program"),
    ] {
        spec.attributes.set(Param::declared(&format!("string {name}"), text).unwrap());
    }
    spec.attributes.set(Param::declared("int dpx:FramePosition", 17).unwrap());
    spec.attributes.set(Param::declared("float dpx:FrameRate", 24.0).unwrap());
    spec.attributes.set(Param::declared("float dpx:ShutterAngle", 180.0).unwrap());
    spec.attributes.set(Param::declared("float pixelaspect", 2.0).unwrap());
    write(&path, "dpx", &spec, &Pixels::U8((0..36).collect()));
    let input = format("dpx").open(&path, &Limits::default()).unwrap();
    let got = input.spec(0, 0).unwrap();
    for param in &spec.attributes {
        assert_eq!(got.attributes.get(&param.name), Some(param));
    }
    assert_eq!((got.x, got.y, got.full_width, got.full_height), (5, 6, 100, 50));
    assert_eq!(got.attributes.iter().count(), spec.attributes.iter().count());
}

/// Returns a Cineon file of RGB or grey with 10 bits, three in each word.
fn cineon(big: bool, size: [u32; 2], channels: u8, packing: u8, words: &[u32]) -> Vec<u8> {
    let long = |v: u32| if big { v.to_be_bytes() } else { v.to_le_bytes() };
    let mut file = vec![0xff; 2048];
    file[..4].copy_from_slice(&long(0x802a_5fd7));
    file[4..8].copy_from_slice(&long(2048));
    [file[192], file[193]] = [0, channels];
    for c in 0..usize::from(channels) {
        let at = 196 + 28 * c;
        file[at..at + 4].copy_from_slice(&[0, if channels == 1 { 0 } else { 1 + c as u8 }, 10, 0]);
        file[at + 4..at + 8].copy_from_slice(&long(size[0]));
        file[at + 8..at + 12].copy_from_slice(&long(size[1]));
    }
    [file[680], file[681], file[682], file[683]] = [0, packing, 0, 1];
    file[684..688].fill(0);
    file[1072..1076].copy_from_slice(&long(24_f32.to_bits()));
    file[1108..1116].copy_from_slice(b"scene 5\0");
    file.extend(words.iter().flat_map(|w| long(*w)));
    file
}

#[test]
fn cineon_values_are_those_of_the_file() {
    let expected = Pixels::U16([1, 2, 3, 1020, 512, 0].map(|v| wide(v, 10)).to_vec());
    let words = [1 << 22 | 2 << 12 | 3 << 2, 1020 << 22 | 512 << 12];
    for big in [true, false] {
        let (_folder, input) = open("cineon", &cineon(big, [2, 1], 3, 5, &words)).unwrap();
        assert_eq!(input.read_level(0, 0).unwrap(), expected);
        let spec = input.spec(0, 0).unwrap();
        assert_eq!(spec.channels.join(" "), "R G B");
        assert_eq!(spec.attributes.int("BitsPerSample"), Some(10));
        assert_eq!(spec.attributes.float("cineon:FrameRate"), Some(24.0));
        assert_eq!(spec.string("cineon:SlateInfo"), Some("scene 5"));
        assert_eq!(spec.string("cineon:LabelText"), None);
        // The highest bit of the packing is set where cells hold as many values as fit.
        assert_eq!(pixels("cineon", &cineon(big, [2, 1], 3, 0x85, &words)).unwrap(), expected);
        let low = words.map(|w| w >> 2);
        assert_eq!(pixels("cineon", &cineon(big, [2, 1], 3, 6, &low)).unwrap(), expected);
        assert_eq!(pixels("cineon", &cineon(big, [6, 1], 1, 5, &words)).unwrap(), expected);
    }
}

#[test]
fn cineon_files_that_are_damaged_or_of_other_kinds_are_refused_by_name() {
    let file = cineon(true, [2, 1], 3, 5, &[0, 0]);
    let with = |at: usize, value: u8| {
        let mut file = file.clone();
        file[at] = value;
        error("cineon", &file)
    };
    assert!(with(193, 0).contains("0 channels"));
    assert!(with(193, 9).contains("9 channels"));
    assert!(with(192, 4).contains("orientation 4"));
    assert!(with(198, 11).contains("different sizes"));
    assert!(with(680, 1).contains("interleave 1"));
    assert!(with(681, 1).contains("packing 1"));
    assert!(with(682, 1).contains("signed"));
    assert!(with(4, 0xff).contains("but the file ends"));
    assert!(error("cineon", &file[..1000]).contains("of which the file has 1000"));
    assert!(error("cineon", &cineon(true, [0, 1], 3, 5, &[])).contains("0 x 1"));
    assert!(error("cineon", &cineon(true, [u32::MAX, 1], 3, 5, &[])).contains("exceeds"));
    assert!(error("cineon", &cineon(true, [2, 9], 3, 5, &[0, 0])).contains("1 of 9 rows"));
}
