//! SGI's logarithmic luminance in 24 bits: ten of the luminance, and fourteen that number squares of equal colour (Greg
//! Ward Larson, "LogLuv Encoding for Full-Gamut, High-Dynamic Range Images", Journal of Graphics Tools 3:1, 1998).

use crate::logluv::rgb_of;

/// The side of a square, in u' and v' of CIE 1976.
const SIDE: f32 = 0.0035;

/// The v' of the lower edge of the first row.
const FIRST_V: f32 = 0.016_94;

/// The number of squares.
const SQUARES: usize = 16_289;

/// The rows of squares, from the lowest v' on: the u' of the left edge of the first square in millionths, and the
/// number of squares.
#[rustfmt::skip]
const ROWS: [(u32, u16); 163] = [
    (247663, 4), (243779, 6), (241684, 7), (237874, 9), (235906, 10), (232153, 12), (228352, 14),
    (226259, 15), (222371, 17), (220410, 18), (214710, 21), (212714, 22), (210721, 23), (204976, 26),
    (202986, 27), (199245, 29), (195525, 31), (193560, 32), (189878, 34), (186216, 36), (186216, 36),
    (182592, 38), (179003, 40), (175466, 42), (172001, 44), (172001, 44), (168612, 46), (168612, 46),
    (163575, 49), (158642, 52), (158642, 52), (158642, 52), (153815, 55), (153815, 55), (149097, 58),
    (149097, 58), (142746, 62), (142746, 62), (142746, 62), (138270, 65), (138270, 65), (138270, 65),
    (132166, 69), (132166, 69), (126204, 73), (126204, 73), (126204, 73), (120381, 77), (120381, 77),
    (120381, 77), (120381, 77), (112962, 82), (112962, 82), (112962, 82), (107450, 86), (107450, 86),
    (107450, 86), (107450, 86), (100343, 91), (100343, 91), (100343, 91), (95126, 95), (95126, 95),
    (95126, 95), (95126, 95), (88276, 100), (88276, 100), (88276, 100), (88276, 100), (81523, 105),
    (81523, 105), (81523, 105), (81523, 105), (74861, 110), (74861, 110), (74861, 110), (74861, 110),
    (68290, 115), (68290, 115), (68290, 115), (68290, 115), (63573, 119), (63573, 119), (63573, 119),
    (63573, 119), (57219, 124), (57219, 124), (57219, 124), (57219, 124), (50985, 129), (50985, 129),
    (50985, 129), (50985, 129), (50985, 129), (44859, 134), (44859, 134), (44859, 134), (44859, 134),
    (40571, 138), (40571, 138), (40571, 138), (40571, 138), (36339, 142), (36339, 142), (36339, 142),
    (36339, 142), (32139, 146), (32139, 146), (32139, 146), (32139, 146), (27947, 150), (27947, 150),
    (27947, 150), (23739, 154), (23739, 154), (23739, 154), (23739, 154), (19504, 158), (19504, 158),
    (19504, 158), (16976, 161), (16976, 161), (16976, 161), (16976, 161), (12639, 165), (12639, 165),
    (12639, 165), (9991, 168), (9991, 168), (9991, 168), (9016, 170), (9016, 170), (9016, 170), (6217, 173),
    (6217, 173), (5097, 175), (5097, 175), (5097, 175), (3909, 177), (3909, 177), (2340, 177), (2389, 170),
    (1068, 164), (1653, 157), (717, 150), (1614, 143), (270, 136), (484, 129), (1103, 123), (1242, 115),
    (1188, 109), (1011, 103), (709, 97), (301, 89), (2416, 82), (3251, 76), (3246, 69), (4141, 62),
    (5963, 55), (8839, 47), (10490, 40), (16994, 31), (23659, 21),
];

/// Decodes pixels of three bytes to red, green and blue. `Err` describes the error in the data.
pub(crate) fn decode(data: &[u8], size: (usize, usize)) -> Result<Vec<f32>, String> {
    let pixels = size.0 * size.1;
    let Some(data) = data.get(..3 * pixels) else {
        return Err(format!("sgilog24 data holds {} of {} bytes", data.len(), 3 * pixels));
    };
    let squares = squares();
    let pixel = |[a, b, c]: &[u8; 3]| {
        let bits = u32::from_be_bytes([0, *a, *b, *c]);
        // An index without a square is white.
        let (u, v) = squares.get((bits & 0x3fff) as usize).copied().unwrap_or((4.0 / 19.0, 9.0 / 19.0));
        rgb_of(luminance(bits >> 14), u, v)
    };
    Ok(data.as_chunks::<3>().0.iter().flat_map(pixel).collect())
}

/// Returns the luminance of ten bits: 64 times the logarithm of base 2, increased by 12.
fn luminance(bits: u32) -> f32 {
    if bits == 0 { 0.0 } else { libm::exp2f((bits as f32 + 0.5) / 64.0 - 12.0) }
}

/// Returns u' and v' of the centre of each square.
fn squares() -> Vec<(f32, f32)> {
    let mut all = Vec::with_capacity(SQUARES);
    for (row, (start, count)) in ROWS.iter().enumerate() {
        let v = FIRST_V + (row as f32 + 0.5) * SIDE;
        let start = *start as f32 / 1e6;
        all.extend((0..*count).map(|i| (start + (f32::from(i) + 0.5) * SIDE, v)));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Returns the bytes of a pixel.
    fn bytes(luminance: u32, square: u32) -> [u8; 3] {
        let [_, a, b, c] = (luminance << 14 | square).to_be_bytes();
        [a, b, c]
    }

    /// Returns the index of the square that contains u' and v'.
    fn square(u: f32, v: f32) -> u32 {
        let near = |(a, b): &(f32, f32)| (a - u).abs().max((b - v).abs()) <= SIDE / 2.0;
        squares().iter().position(near).unwrap() as u32
    }

    #[test]
    fn the_rows_have_all_squares() {
        assert_eq!(squares().len(), SQUARES);
        assert!(ROWS.iter().all(|(_, count)| *count > 0));
    }

    #[test]
    fn white_has_equal_channels_and_red_its_chromaticity() {
        let white = decode(&bytes(12 * 64, square(4.0 / 19.0, 9.0 / 19.0)), (1, 1)).unwrap();
        // The side of a square is three hundredths of the channels of white.
        assert!(white.iter().all(|v| (v - 1.0).abs() < 0.04), "{white:?}");
        // The red primary (0.640, 0.330) has u' 0.4507 and v' 0.5229.
        let red = decode(&bytes(12 * 64, square(0.4507, 0.5229)), (1, 1)).unwrap();
        assert!(red[0] > 3.0 && red[1].abs() < 0.1 * red[0] && red[2].abs() < 0.1 * red[0], "{red:?}");
        // A luminance of 0 is black, and each 64 steps double it.
        assert_eq!(decode(&bytes(0, 5), (1, 1)).unwrap(), [0.0; 3]);
        let [one, two] = [11, 12].map(|power| decode(&bytes(power * 64, 9000), (1, 1)).unwrap());
        assert!(one.iter().zip(&two).all(|(a, b)| (2.0 * a - b).abs() <= 1e-5 * b.abs()), "{one:?} {two:?}");
        // Beyond the last square is white.
        assert_eq!(
            decode(&bytes(900, 16_289), (1, 1)).unwrap(),
            decode(&bytes(900, 16_383), (1, 1)).unwrap()
        );
    }

    #[test]
    fn short_data_is_an_error() {
        assert!(decode(&[0; 5], (2, 1)).unwrap_err().contains("5 of 6 bytes"));
    }

    proptest! {
        #[test]
        fn any_pixel_has_finite_channels(luminance in 0u32..1024, square in 0u32..16_384) {
            let rgb = decode(&bytes(luminance, square), (1, 1)).unwrap();
            prop_assert!(rgb.iter().all(|v| v.is_finite()), "{:?}", rgb);
        }
    }
}
