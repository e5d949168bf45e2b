//! SGI's logarithmic luminance (Greg Ward Larson, "LogLuv Encoding for Full-Gamut, High-Dynamic Range Images", Journal
//! of Graphics Tools 3:1, 1998; the numbers are those of libtiff).

/// Decodes rows of `size` pixels to luminances (one channel), or to red, green and blue (three). `Err` describes the
/// error in the data.
pub(crate) fn decode(data: &[u8], size: (usize, usize), channels: usize) -> Result<Vec<f32>, String> {
    let planes = if channels == 1 { 2 } else { 4 };
    let mut rest = data;
    let mut out = Vec::with_capacity(size.0 * size.1 * channels);
    let mut row = vec![0_u32; size.0];
    for y in 0..size.1 {
        row.fill(0);
        // The most significant bytes of all pixels come first.
        for _ in 0..planes {
            rest =
                unpack(rest, &mut row).ok_or_else(|| format!("row {y} is not {} pixels of runs", size.0))?;
        }
        for pixel in &row {
            match channels {
                1 => out.push(luminance(*pixel)),
                _ => out.extend(rgb(*pixel)),
            }
        }
    }
    Ok(out)
}

/// Appends a byte to each pixel of a row, and returns the rest of the data. A count from 128 on, less 126, is the
/// number of repetitions of the next byte. A lower one is the number of bytes that follow.
fn unpack<'a>(mut data: &'a [u8], row: &mut [u32]) -> Option<&'a [u8]> {
    let mut at = 0;
    while at < row.len() {
        let (count, rest) = data.split_first()?;
        let count = usize::from(*count);
        let repeated = count >= 128;
        let n = if repeated { count - 126 } else { count };
        let pixels = row.get_mut(at..at + n)?;
        let (values, rest) = rest.split_at_checked(if repeated { 1 } else { n })?;
        for (i, pixel) in pixels.iter_mut().enumerate() {
            *pixel = *pixel << 8 | u32::from(values[if repeated { 0 } else { i }]);
        }
        at += n;
        data = rest;
    }
    Some(data)
}

/// Returns the luminance of 16 bits: a sign, and 256 times the logarithm of base 2, increased by 64.
fn luminance(bits: u32) -> f32 {
    let exponent = bits & 0x7fff;
    if exponent == 0 {
        return 0.0;
    }
    let value = libm::exp2f((exponent as f32 + 0.5) / 256.0 - 64.0);
    if bits & 0x8000 == 0 { value } else { -value }
}

/// Returns red, green and blue, of the primaries of ITU-R BT.709 and equal energies of white, which are proportional to
/// light.
fn rgb(bits: u32) -> [f32; 3] {
    let y = luminance(bits >> 16);
    let [u, v] = [bits >> 8 & 0xff, bits & 0xff].map(|n| (n as f32 + 0.5) / 410.0);
    rgb_of(y, u, v)
}

/// Returns red, green and blue of a luminance and u' and v' of CIE 1976. A luminance of 0 is black.
pub(crate) fn rgb_of(y: f32, u: f32, v: f32) -> [f32; 3] {
    if y <= 0.0 {
        return [0.0; 3];
    }
    // From u' and v' to chromaticities (CIE 1976).
    let scale = 1.0 / (6.0 * u - 16.0 * v + 12.0);
    let (cx, cy) = (9.0 * u * scale, 4.0 * v * scale);
    let (x, z) = (cx / cy * y, (1.0 - cx - cy) / cy * y);
    [2.690 * x - 1.276 * y - 0.414 * z, -1.022 * x + 1.978 * y + 0.044 * z, 0.061 * x - 0.224 * y + 1.163 * z]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn luminances_are_logarithms() {
        // Halves of 1/256 of a power of two are added, so that rounding is unbiased.
        for (bits, value) in
            [(0x4000, 1.0), (0x4100, 2.0), (0xc100, -2.0), (0x3f00, 0.5), (0, 0.0), (0x8000, 0.0)]
        {
            let near = luminance(bits);
            assert!((near - value).abs() <= 0.002 * value.abs(), "{bits:#x}: {near}");
        }
    }

    #[test]
    fn white_has_equal_channels_and_colours_their_chromaticity() {
        // u' and v' of equal energies are 4/19 and 9/19.
        let white = rgb(0x4100_0000 | 86 << 8 | 194);
        assert!(white.iter().all(|v| (v - 2.0).abs() < 0.03), "{white:?}");
        // Those of the red primary (0.640, 0.330).
        let red = rgb(0x4000_0000 | 185 << 8 | 214);
        assert!(red[0] > 3.0 && red[1].abs() < 0.1 * red[0] && red[2].abs() < 0.1 * red[0], "{red:?}");
        assert_eq!(rgb(0x0000_56c2), [0.0; 3]);
    }

    #[test]
    fn runs_fill_exactly_one_row() {
        // Three pixels: the high bytes as a run, the low ones verbatim.
        let values = decode(&[129, 0x41, 3, 0, 0, 0], (3, 1), 1).unwrap();
        assert!(values.iter().all(|v| (v - 2.0).abs() < 0.01), "{values:?}");
        for bad in
            [&[130, 0x41, 3, 0, 0, 0][..], &[129, 0x41, 4, 0, 0, 0, 0], &[129, 0x41, 3, 0], &[129], &[]]
        {
            assert!(decode(bad, (3, 1), 1).is_err(), "{bad:?}");
        }
        // Empty runs do not end a row.
        assert!(decode(&[0; 9], (3, 1), 1).is_err());
    }

    proptest! {
        #[test]
        fn decoding_random_data_ends_without_panic(data in prop::collection::vec(any::<u8>(), 0..300), width in 1usize..40) {
            for channels in [1, 3] {
                let _ = decode(&data, (width, 5), channels);
            }
        }
    }
}
