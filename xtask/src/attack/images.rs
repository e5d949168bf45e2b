//! Images whose headers declare far more than the files contain.

/// Returns the header of a PPM file of `width` x `height` pixels.
pub(crate) fn ppm(width: u32, height: u32) -> Vec<u8> {
    format!("P6\n{width} {height}\n255\nab").into_bytes()
}

/// Returns the same header of a PPM file in text.
pub(crate) fn text_ppm() -> Vec<u8> {
    b"P3\n65535 65535\n255\n1 2 3\n".to_vec()
}

/// Returns the header of a PAM file with the largest number of channels.
pub(crate) fn pam() -> Vec<u8> {
    b"P7\nWIDTH 65535\nHEIGHT 65535\nDEPTH 4\nMAXVAL 65535\nTUPLTYPE RGB_ALPHA\nENDHDR\nab".to_vec()
}

/// Returns the header of a PFM file.
pub(crate) fn pfm() -> Vec<u8> {
    b"PF\n65535 65535\n-1.0\nabcd".to_vec()
}

/// Returns the beginning of a Radiance HDR file.
pub(crate) fn hdr() -> Vec<u8> {
    b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 65535 +X 65535\n\x02\x02\xff\xff".to_vec()
}

/// Returns the beginning of a run-length encoded Targa file.
pub(crate) fn tga() -> Vec<u8> {
    let mut bytes = vec![0, 0, 10, 0, 0, 0, 0, 0, 0, 0, 0, 0, 255, 255, 255, 255, 24, 0];
    bytes.extend([255, 1, 2, 3]);
    bytes
}

/// Returns a GIF file with one pixel of data.
pub(crate) fn gif() -> Vec<u8> {
    let mut bytes = b"GIF89a\xff\xff\xff\xff\x80\0\0".to_vec();
    bytes.extend([0, 0, 0, 255, 255, 255]);
    bytes.extend(b",\0\0\0\0\xff\xff\xff\xff\0\x02\x02\x44\x01\0;");
    bytes
}

/// Returns a GIF file with a small screen and a far larger image.
pub(crate) fn gif_of_small_screen() -> Vec<u8> {
    let mut bytes = b"GIF89a\x20\0\x18\0\x80\0\0".to_vec();
    bytes.extend([0, 0, 0, 255, 255, 255]);
    bytes.extend(b",\0\0\0\0\xa7\xae\xb5\xa8\0\x02\x02\x44\x01\0;");
    bytes
}

/// Returns the beginning of a QOI file.
pub(crate) fn qoi() -> Vec<u8> {
    let mut bytes = b"qoif\0\0\xff\xff\0\0\xff\xff\x04\0".to_vec();
    bytes.extend([0xfd, 0xfd, 0, 0, 0, 0, 0, 0, 0, 1]);
    bytes
}

/// Returns the header of a run-length encoded SGI file, whose tables alone would be large.
pub(crate) fn sgi() -> Vec<u8> {
    let mut bytes = vec![1, 218, 1, 1, 0, 3, 255, 255, 255, 255, 0, 4];
    bytes.resize(512, 0);
    bytes
}

/// Returns the beginning of a BMP file.
pub(crate) fn bmp() -> Vec<u8> {
    let mut bytes = b"BM".to_vec();
    let words: [u32; 3] = [58, 0, 54];
    words.iter().for_each(|word| bytes.extend(word.to_le_bytes()));
    let words: [u32; 3] = [40, 65535, 65535];
    words.iter().for_each(|word| bytes.extend(word.to_le_bytes()));
    bytes.extend([1, 0, 24, 0]);
    bytes.resize(54, 0);
    bytes.extend([1, 2, 3, 0]);
    bytes
}

/// Returns the header of a DDS file without compression.
pub(crate) fn dds() -> Vec<u8> {
    let mut words = [0_u32; 32];
    words[0] = u32::from_le_bytes(*b"DDS ");
    (words[1], words[2], words[3], words[4]) = (124, 0x100f, 65535, 65535);
    (words[19], words[20], words[22]) = (32, 0x41, 32);
    (words[23], words[24], words[25], words[26], words[27]) = (0xff, 0xff00, 0xff_0000, 0xff00_0000, 0x1000);
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// Returns a PNG file with an empty stream of pixels.
pub(crate) fn png() -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut header = Vec::new();
    header.extend(65535_u32.to_be_bytes());
    header.extend(65535_u32.to_be_bytes());
    header.extend([16, 6, 0, 0, 0]);
    // A stream of zlib with one stored byte.
    let stream = [0x78, 1, 1, 1, 0, 0xfe, 0xff, 0, 0, 1, 0, 1];
    for (kind, content) in [(b"IHDR", &header[..]), (b"IDAT", &stream), (b"IEND", &[])] {
        bytes.extend((content.len() as u32).to_be_bytes());
        let from = bytes.len();
        bytes.extend(kind);
        bytes.extend(content);
        let sum = crc32(&bytes[from..]);
        bytes.extend(sum.to_be_bytes());
    }
    bytes
}

/// Returns the checksum of PNG (ISO 3309).
fn crc32(bytes: &[u8]) -> u32 {
    let step = |sum: u32, byte: &u8| {
        (0..8).fold(sum ^ u32::from(*byte), |s, _| if s & 1 == 1 { (s >> 1) ^ 0xedb8_8320 } else { s >> 1 })
    };
    !bytes.iter().fold(!0, step)
}

/// Returns a TIFF file with these sides and without pixels. `next` is the declared offset of the next directory.
pub(crate) fn tiff(width: u32, height: u32, next: u32) -> Vec<u8> {
    let mut bytes = b"II*\0\x08\0\0\0".to_vec();
    bytes.extend(directory(width, height, next));
    bytes
}

/// Returns a TIFF file of `count` directories.
pub(crate) fn many_directories(count: u32) -> Vec<u8> {
    let mut bytes = b"II*\0\x08\0\0\0".to_vec();
    for number in 1..=count {
        let next = bytes.len() as u32 + DIRECTORY_BYTES;
        bytes.extend(directory(1, 1, if number == count { 0 } else { next }));
    }
    bytes
}

const DIRECTORY_BYTES: u32 = 2 + 10 * 12 + 4;

/// Returns a directory for RGB, 8 bits and one strip, which lies in the header of the file.
fn directory(width: u32, height: u32, next: u32) -> Vec<u8> {
    let count_of_strip = width.saturating_mul(height).saturating_mul(3).min(3);
    let entries: [(u16, u16, u32); 10] = [
        (256, 4, width),
        (257, 4, height),
        (258, 3, 8),
        (259, 3, 1),
        (262, 3, 1),
        (273, 4, 4),
        (277, 3, 1),
        (278, 4, height),
        (279, 4, count_of_strip),
        (284, 3, 1),
    ];
    let mut bytes = (entries.len() as u16).to_le_bytes().to_vec();
    for (tag, kind, value) in entries {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(kind.to_le_bytes());
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend(next.to_le_bytes());
    bytes
}

/// Returns an OpenEXR file of 4 x 4 pixels, which are complete, in a display window of this size.
pub(crate) fn exr(width: i32, height: i32) -> Vec<u8> {
    let mut bytes = vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        bytes.extend(name.bytes().chain([0]).chain(kind.bytes()).chain([0]));
        bytes.extend((value.len() as u32).to_le_bytes());
        bytes.extend(value);
    };
    let ints = |values: [i32; 4]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let mut channels = Vec::new();
    for name in *b"BGR" {
        channels.extend([name, 0]);
        channels.extend([1_u32, 0, 1, 1].iter().flat_map(|v| v.to_le_bytes()));
    }
    channels.push(0);
    attribute("channels", "chlist", &channels);
    attribute("compression", "compression", &[0]);
    attribute("dataWindow", "box2i", &ints([0, 0, 3, 3]));
    attribute("displayWindow", "box2i", &ints([0, 0, width - 1, height - 1]));
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("pixelAspectRatio", "float", &1_f32.to_le_bytes());
    attribute("screenWindowCenter", "v2f", &[0; 8]);
    attribute("screenWindowWidth", "float", &1_f32.to_le_bytes());
    bytes.push(0);
    let rows = bytes.len() + 4 * 8;
    (0..4).for_each(|row| bytes.extend(((rows + row * (8 + 24)) as u64).to_le_bytes()));
    for row in 0..4_i32 {
        bytes.extend(row.to_le_bytes());
        bytes.extend(24_u32.to_le_bytes());
        // Each value is the half 1.
        bytes.extend([0, 0x3c].repeat(12));
    }
    bytes
}

/// Returns a PPM file of `side` x `side` different pixels.
pub(crate) fn large_ppm(side: u32) -> Vec<u8> {
    let mut bytes = format!("P6\n{side} {side}\n255\n").into_bytes();
    let rows =
        (0..side).flat_map(|y| (0..side).flat_map(move |x| [(x ^ y) as u8, (x / 7) as u8, (y / 5) as u8]));
    bytes.extend(rows);
    bytes
}
