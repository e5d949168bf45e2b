//! Compression schemes and predictors of one strip or tile.

use granita_image::{Content, DeflateLevel, Pixels, contained, zlib_compress};
use half::f16;
use std::io::Read;

/// The compression of strips and tiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Compression {
    None,
    Lzw,
    Deflate,
    PackBits,
    /// This compression is only read.
    Zstd,
    /// This compression is only read, by [`crate::jpeg`].
    Jpeg,
    /// This compression is only read, by [`crate::webp`].
    WebP,
    /// This compression is only read, by [`crate::strip_file`].
    Group4,
    /// This compression is only read, by [`crate::fax`].
    Runs,
    /// This compression is only read, by [`crate::fax`].
    Group3,
    /// This compression is only read, by [`crate::logluv`].
    SgiLog,
    /// This compression is only read, by [`crate::logluv24`].
    SgiLog24,
    /// This compression is only read.
    Lzma,
}

impl Compression {
    /// Converts the number in the file. `Err` is the name of a compression that is not supported.
    pub(crate) fn from_code(code: u64) -> Result<Self, String> {
        Err(match code {
            1 => return Ok(Self::None),
            5 => return Ok(Self::Lzw),
            8 | 32946 => return Ok(Self::Deflate),
            32773 => return Ok(Self::PackBits),
            7 => return Ok(Self::Jpeg),
            50000 => return Ok(Self::Zstd),
            50001 => return Ok(Self::WebP),
            2 => return Ok(Self::Runs),
            3 => return Ok(Self::Group3),
            4 => return Ok(Self::Group4),
            6 => "old-style JPEG (of 1992)".into(),
            34676 => return Ok(Self::SgiLog),
            34677 => return Ok(Self::SgiLog24),
            34712 => "JPEG 2000".into(),
            34887 => "LERC".into(),
            34925 => return Ok(Self::Lzma),
            other => format!("number {other}"),
        })
    }

    /// Returns the number in the file.
    pub(crate) fn code(self) -> u16 {
        match self {
            Self::None => 1,
            Self::Lzw => 5,
            Self::Deflate => 8,
            Self::PackBits => 32773,
            Self::Jpeg => 7,
            Self::Zstd => 50000,
            Self::WebP => 50001,
            Self::Group4 => 4,
            Self::Runs => 2,
            Self::Group3 => 3,
            Self::SgiLog => 34676,
            Self::SgiLog24 => 34677,
            Self::Lzma => 34925,
        }
    }

    /// Converts the value of the attribute `compression` (reference 7.4.1), which may contain the level of deflate:
    /// "zip:9". `Err` says why the value is not possible.
    pub(crate) fn from_word(word: &str) -> Result<(Self, DeflateLevel), String> {
        let lower = word.to_ascii_lowercase();
        let (name, level) = DeflateLevel::split(&lower)?;
        Ok(match (name, level) {
            ("zip" | "deflate", level) => (Self::Deflate, level.unwrap_or_default()),
            ("none", None) => (Self::None, DeflateLevel::default()),
            ("lzw", None) => (Self::Lzw, DeflateLevel::default()),
            ("packbits", None) => (Self::PackBits, DeflateLevel::default()),
            _ => return Err(format!("TIFF compression \"{word}\" is not supported")),
        })
    }

    /// Returns the value of the attribute.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Lzw => "lzw",
            Self::Deflate => "zip",
            Self::PackBits => "packbits",
            Self::Zstd => "zstd",
            Self::Jpeg => "jpeg",
            Self::WebP => "webp",
            Self::Group4 => "group4",
            Self::Runs => "ccitt",
            Self::Group3 => "group3",
            Self::SgiLog => "sgilog",
            Self::SgiLog24 => "sgilog24",
            Self::Lzma => "lzma",
        }
    }

    /// Fills `out` from `data`. `Err` describes the error in the data.
    pub(crate) fn decode(self, data: &[u8], out: &mut [u8]) -> Result<(), String> {
        let (got, fault) = match self {
            Self::None => {
                let n = data.len().min(out.len());
                out[..n].copy_from_slice(&data[..n]);
                (n, None)
            }
            Self::Lzw => decode_lzw(data, out),
            Self::Deflate => decode_deflate(data, out),
            Self::Zstd => decode_zstd(data, out),
            Self::Lzma => decode_lzma(data, out),
            Self::Jpeg
            | Self::WebP
            | Self::Group4
            | Self::Runs
            | Self::Group3
            | Self::SgiLog
            | Self::SgiLog24 => (0, Some("it is decoded elsewhere".to_owned())),
            Self::PackBits => decode_packbits(data, out),
        };
        match fault {
            _ if got == out.len() => Ok(()),
            Some(fault) => Err(format!("{} data after {got} of {} bytes: {fault}", self.word(), out.len())),
            None => Err(format!("{} data holds {got} of {} bytes", self.word(), out.len())),
        }
    }

    /// Compresses `data`, which has rows of `row_bytes`. `content` and `level` are those of deflate.
    pub(crate) fn encode(
        self,
        data: &[u8],
        row_bytes: usize,
        content: Content,
        level: DeflateLevel,
    ) -> std::io::Result<Vec<u8>> {
        match self {
            Self::None => Ok(data.to_vec()),
            Self::Lzw => weezl::encode::Encoder::with_tiff_size_switch(weezl::BitOrder::Msb, 8)
                .encode(data)
                .map_err(std::io::Error::other),
            Self::Deflate => Ok(zlib_compress(data, content, level)),
            // `from_word` returns none of these.
            Self::Zstd
            | Self::Jpeg
            | Self::WebP
            | Self::Group4
            | Self::Runs
            | Self::Group3
            | Self::SgiLog
            | Self::SgiLog24
            | Self::Lzma => Err(std::io::ErrorKind::Unsupported.into()),
            Self::PackBits => {
                // Runs must not cross rows (TIFF 6.0, section 9).
                let mut out = Vec::with_capacity(data.len() + data.len() / 64);
                data.chunks(row_bytes.max(1)).for_each(|row| encode_packbits(row, &mut out));
                Ok(out)
            }
        }
    }
}

/// Decodes data of deflate, and returns the decoded length. Valid data is decoded in one call. Otherwise the slower way
/// reports the decoded length, and accepts data that continues beyond the end or has no check sum.
fn decode_deflate(data: &[u8], out: &mut [u8]) -> (usize, Option<String>) {
    if libdeflater::Decompressor::new().zlib_decompress(data, out) == Ok(out.len()) {
        return (out.len(), None);
    }
    let mut inflate = flate2::Decompress::new(true);
    let end = inflate.decompress(data, out, flate2::FlushDecompress::Finish);
    (inflate.total_out() as usize, end.err().map(|e| e.to_string()))
}

fn decode_zstd(data: &[u8], out: &mut [u8]) -> (usize, Option<String>) {
    let mut frame = ruzstd::decoding::FrameDecoder::new();
    // The window size is declared by the data. It is limited to the size of a strip.
    frame.set_max_window_size((out.len() as u64).next_power_of_two().clamp(8 << 20, 128 << 20));
    match ruzstd::decoding::StreamingDecoder::new_with_decoder(data, frame) {
        Ok(reader) => read_all(reader, out),
        Err(e) => (0, Some(e.to_string())),
    }
}

/// Decodes data of LZMA2 in the container of xz, as libtiff writes it.
fn decode_lzma(data: &[u8], out: &mut [u8]) -> (usize, Option<String>) {
    /// The memory of the largest dictionary, which is declared by the data. The largest preset of xz needs half of it.
    const MOST_KIB: u32 = 128 << 10;
    contained(|| read_all(lzma_rust2::XzReader::new_mem_limit(data, false, MOST_KIB), out))
        .unwrap_or_else(|fault| (0, Some(fault)))
}

/// Fills `out`, and returns the number of bytes and the error that ended it.
fn read_all(mut reader: impl Read, out: &mut [u8]) -> (usize, Option<String>) {
    let mut done = 0;
    while done < out.len() {
        match reader.read(&mut out[done..]) {
            Ok(0) => break,
            Ok(n) => done += n,
            Err(e) => return (done, Some(e.to_string())),
        }
    }
    (done, None)
}

fn decode_lzw(mut data: &[u8], mut out: &mut [u8]) -> (usize, Option<String>) {
    let mut lzw = weezl::decode::Decoder::with_tiff_size_switch(weezl::BitOrder::Msb, 8);
    let mut done = 0;
    loop {
        let step = lzw.decode_bytes(data, out);
        data = &data[step.consumed_in..];
        out = &mut out[step.consumed_out..];
        done += step.consumed_out;
        match step.status {
            Ok(weezl::LzwStatus::Ok) if !out.is_empty() => {}
            Ok(_) => return (done, None),
            Err(e) => return (done, Some(e.to_string())),
        }
    }
}

fn decode_packbits(data: &[u8], out: &mut [u8]) -> (usize, Option<String>) {
    let (mut from, mut to) = (0, 0);
    while to < out.len() && from < data.len() {
        let code = data[from] as i8;
        from += 1;
        if code >= 0 {
            let n = (code as usize + 1).min(out.len() - to).min(data.len() - from);
            out[to..to + n].copy_from_slice(&data[from..from + n]);
            from += n;
            to += n;
        } else if code != -128 {
            let Some(&value) = data.get(from) else { break };
            let n = (1 - isize::from(code)).unsigned_abs().min(out.len() - to);
            out[to..to + n].fill(value);
            from += 1;
            to += n;
        }
    }
    (to, None)
}

fn encode_packbits(row: &[u8], out: &mut Vec<u8>) {
    /// Returns the length of the run of equal bytes at the front, up to 128.
    fn run(bytes: &[u8]) -> usize {
        bytes.iter().take(128).take_while(|b| **b == bytes[0]).count()
    }
    let mut rest = row;
    while !rest.is_empty() {
        let n = run(rest);
        if n >= 2 {
            out.extend([(1 - n as i32) as u8, rest[0]]);
            rest = &rest[n..];
        } else {
            // Literal bytes continue until a run of three. A run of two needs as many bytes when it is literal.
            let mut n = 1;
            while n < rest.len().min(128) && run(&rest[n..]) < 3 {
                n += 1;
            }
            out.push((n - 1) as u8);
            out.extend_from_slice(&rest[..n]);
            rest = &rest[n..];
        }
    }
}

/// Reverses horizontal differencing (predictor 2), so that every value becomes the sum of those to its left. Rows have
/// `width` values and `step` channels. Floats are summed as the integers of their bits, as libtiff does.
pub(crate) fn undo_horizontal(pixels: &mut Pixels, width: usize, step: usize) {
    macro_rules! sum {
        ($v:expr, $add:expr) => {
            for row in $v.chunks_mut(width.max(1)) {
                for i in step..row.len() {
                    row[i] = $add(row[i], row[i - step]);
                }
            }
        };
    }
    match pixels {
        Pixels::U8(v) => sum!(v, u8::wrapping_add),
        Pixels::U16(v) => sum!(v, u16::wrapping_add),
        Pixels::U32(v) => sum!(v, u32::wrapping_add),
        Pixels::Half(v) => {
            sum!(v, |a: f16, b: f16| f16::from_bits(a.to_bits().wrapping_add(b.to_bits())))
        }
        Pixels::Float(v) => {
            sum!(v, |a: f32, b: f32| f32::from_bits(a.to_bits().wrapping_add(b.to_bits())))
        }
    }
}

/// Applies horizontal differencing of integers in place, which is the inverse of [`undo_horizontal`].
pub(crate) fn apply_horizontal(pixels: &mut Pixels, width: usize, step: usize) {
    macro_rules! difference {
        ($v:expr) => {
            for row in $v.chunks_mut(width.max(1)) {
                for i in (step..row.len()).rev() {
                    row[i] = row[i].wrapping_sub(row[i - step]);
                }
            }
        };
    }
    match pixels {
        Pixels::U8(v) => difference!(v),
        Pixels::U16(v) => difference!(v),
        Pixels::U32(v) => difference!(v),
        // Writers use predictor 3 for floats.
        Pixels::Half(_) | Pixels::Float(_) => {}
    }
}

/// Reverses floating-point prediction (predictor 3, TIFF Technical Note 3). `bytes` are rows of `width * size` bytes,
/// with all most significant bytes first. Each byte is the difference to the one `step` before. Returns big-endian
/// values.
pub(crate) fn undo_floating(mut bytes: Vec<u8>, width: usize, step: usize, size: usize) -> Vec<u8> {
    let mut values = vec![0; width * size];
    for row in bytes.chunks_exact_mut((width * size).max(1)) {
        for i in step..row.len() {
            row[i] = row[i].wrapping_add(row[i - step]);
        }
        for (i, value) in values.chunks_exact_mut(size).enumerate() {
            for (k, byte) in value.iter_mut().enumerate() {
                *byte = row[k * width + i];
            }
        }
        row.copy_from_slice(&values);
    }
    bytes
}

/// Applies floating-point prediction to little-endian values, which is the inverse of [`undo_floating`].
pub(crate) fn apply_floating(bytes: &mut [u8], width: usize, step: usize, size: usize) {
    let mut planes = vec![0; width * size];
    for row in bytes.chunks_exact_mut((width * size).max(1)) {
        for (i, value) in row.chunks_exact(size).enumerate() {
            for (k, byte) in value.iter().rev().enumerate() {
                planes[k * width + i] = *byte;
            }
        }
        row.copy_from_slice(&planes);
        for i in (step..row.len()).rev() {
            row[i] = row[i].wrapping_sub(row[i - step]);
        }
    }
}

/// Reverses the bits of every byte (FillOrder 2).
pub(crate) fn reverse_bits(bytes: &mut [u8]) {
    bytes.iter_mut().for_each(|b| *b = b.reverse_bits());
}

/// Converts values of 1, 2 or 4 bits to bytes. They are packed in rows of `width` values from the most significant bit.
/// `scale` stretches them to 0..=255. Otherwise they stay as they are.
pub(crate) fn unpack_bits(bytes: &[u8], width: usize, bits: usize, scale: bool) -> Vec<u8> {
    let top = (1u8 << bits) - 1;
    let factor = if scale { 255 / top } else { 1 };
    let mut out = Vec::with_capacity(bytes.len() * 8 / bits);
    for row in bytes.chunks_exact((width * bits).div_ceil(8).max(1)) {
        for i in 0..width {
            let bit = i * bits;
            out.push((row[bit / 8] >> (8 - bits - bit % 8) & top) * factor);
        }
    }
    out
}

/// Converts values of 9 to 15 bits to 16 bits, with their high bits repeated as the low ones. They are packed in rows
/// of `width` values from the most significant bit.
pub(crate) fn unpack_wide(bytes: &[u8], width: usize, bits: usize) -> Vec<u16> {
    let mut out = Vec::with_capacity(bytes.len() * 8 / bits);
    for row in bytes.chunks_exact((width * bits).div_ceil(8).max(1)) {
        for i in 0..width {
            let at = i * bits;
            // A value is in up to three bytes.
            let byte = |k: usize| u32::from(row.get(at / 8 + k).copied().unwrap_or(0));
            let all = byte(0) << 16 | byte(1) << 8 | byte(2);
            let value = all >> (24 - bits - at % 8) & ((1 << bits) - 1);
            out.push((value << (16 - bits) | value >> (2 * bits - 16)) as u16);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ALL: [Compression; 4] =
        [Compression::None, Compression::Lzw, Compression::Deflate, Compression::PackBits];

    proptest! {
        #[test]
        fn decompression_restores_the_bytes(data in prop::collection::vec(prop_oneof![Just(0u8), Just(7), any::<u8>()], 1..600), row in 1usize..70) {
            for c in ALL {
                let packed = c.encode(&data, row, Content::Bytes, DeflateLevel::default()).unwrap();
                let mut out = vec![1; data.len()];
                prop_assert_eq!(c.decode(&packed, &mut out), Ok(()));
                prop_assert_eq!(&out, &data, "{:?}", c);
            }
        }

        #[test]
        fn decompressing_random_data_ends_without_panic(data in prop::collection::vec(any::<u8>(), 0..300), n in 0usize..2000) {
            for c in ALL.into_iter().chain([Compression::Zstd]) {
                let _ = c.decode(&data, &mut vec![0; n]);
            }
        }

        #[test]
        fn floating_point_prediction_is_undone_exactly(v in prop::collection::vec(any::<u32>(), 24)) {
            let bytes: Vec<u8> = v.iter().flat_map(|v| v.to_le_bytes()).collect();
            for (width, step, size) in [(12, 3, 4), (24, 1, 4), (24, 4, 2), (6, 2, 4)] {
                let mut b = bytes.clone();
                apply_floating(&mut b, width, step, size);
                let mut back = undo_floating(b, width, step, size);
                back.chunks_mut(size).for_each(<[u8]>::reverse);
                prop_assert_eq!(&back, &bytes);
            }
        }
    }

    #[test]
    fn the_packbits_example_of_tiff_6_decodes() {
        // The example of TIFF 6.0, section 9 (after Apple's technical note).
        let packed = [0xfe, 0xaa, 2, 0x80, 0, 0x2a, 0xfd, 0xaa, 3, 0x80, 0, 0x2a, 0x22, 0xf7, 0xaa];
        let mut out = [0; 24];
        Compression::PackBits.decode(&packed, &mut out).unwrap();
        assert_eq!(out[..7], [0xaa, 0xaa, 0xaa, 0x80, 0, 0x2a, 0xaa]);
        assert_eq!(out[14..], [0xaa; 10]);
    }

    #[test]
    fn short_data_is_an_error() {
        for c in ALL {
            let packed = c.encode(&[5; 100], 100, Content::Bytes, DeflateLevel::default()).unwrap();
            let fault = c.decode(&packed, &mut [0; 101]).unwrap_err();
            assert!(fault.contains("100 of 101"), "{fault}");
        }
    }

    #[test]
    fn packed_bits_are_unpacked_and_scaled() {
        assert_eq!(unpack_bits(&[0b1010_0000], 3, 1, true), [255, 0, 255]);
        assert_eq!(unpack_bits(&[0x1f, 0x20], 3, 4, false), [1, 15, 2]);
        assert_eq!(unpack_bits(&[0b0001_1011], 4, 2, true), [0, 85, 170, 255]);
        // Two rows of two values, which end with whole bytes.
        let packed = [0xff, 0xc0, 0x10, 0x80, 0x00, 0x00];
        assert_eq!(unpack_wide(&packed, 2, 10), [0xffff, 0x0040, 0x8020, 0]);
        assert_eq!(unpack_wide(&[0xab, 0xcd, 0xef], 2, 12), [0xabca, 0xdefd]);
        assert_eq!(unpack_wide(&[0xff, 0xfe], 1, 15), [0xffff]);
    }
}
