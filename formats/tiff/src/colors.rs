//! Converts colours that are not stored as red, green and blue.

use crate::directory::Directory;
use crate::tags;
use granita_image::color::{cmyk_to_rgb, lab_to_srgb};
use granita_image::{FileSource, PixelType, Pixels, Result};

/// The conversion of the first channels of a pixel to a colour. Further channels stay as they are.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Colors {
    /// Four inks, where 0 is no ink.
    Cmyk,
    /// CIE L*a*b* with signed a* and b* (TIFF 6.0, section 23).
    CieLab,
    /// CIE L*a*b* as in ICC profiles, with an offset of a* and b* (Adobe's technical notes of 2002).
    IccLab,
    /// Luminance and colour differences.
    YCbCr(YCbCr),
}

/// The tags of TIFF 6.0, sections 20 and 21.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct YCbCr {
    /// The weights of red, green and blue in the luminance.
    luma: [f32; 3],
    /// The values of black and white in each channel.
    reference: [f32; 6],
    /// The numbers of pixels across and down that share one pair of differences: 1, 2 or 4.
    pub(crate) block: (usize, usize),
}

impl Colors {
    /// Returns the conversion from the tags of a directory; `None` when the channels are returned as they are stored.
    pub(crate) fn of(
        source: &FileSource,
        directory: &Directory,
        photometric: u64,
        (pixel_type, bits, samples): (PixelType, u64, u64),
    ) -> Result<Option<Self>> {
        let (colors, name, stored) = match photometric {
            5 if samples >= 4 && directory.number(source, tags::INK_SET, 1)? == 1 => {
                (Self::Cmyk, "CMYK", samples)
            }
            6 => (Self::YCbCr(YCbCr::of(source, directory)?), "YCbCr", 3),
            8 => (Self::CieLab, "CIE L*a*b*", 3),
            9 => (Self::IccLab, "ICC L*a*b*", 3),
            10 => return Err(source.unsupported("TIFF in ITU L*a*b* colours is not supported")),
            32844 | 32845 => return Err(source.unsupported("TIFF in LogLuv colours is not supported")),
            _ => return Ok(None),
        };
        if samples < stored {
            return Err(source.malformed(format!("{name} colours in {samples} channels")));
        }
        let fits = match (&colors, pixel_type) {
            (Self::YCbCr(_), _) => bits == 8 && pixel_type == PixelType::U8,
            (_, PixelType::U8 | PixelType::U16) => matches!(bits, 8 | 16),
            (Self::Cmyk, PixelType::Float) => true,
            _ => false,
        };
        if !fits {
            let what = format!("TIFF in {name} colours of {bits}-bit {pixel_type:?} values is not supported");
            return Err(source.unsupported(what));
        }
        Ok(Some(colors))
    }

    /// Returns the number of channels that define the colour.
    fn inks(&self) -> usize {
        if *self == Self::Cmyk { 4 } else { 3 }
    }

    /// Returns the number of channels of a converted pixel, for the number of stored channels.
    pub(crate) fn channels(&self, samples: usize) -> usize {
        samples - self.inks() + 3
    }

    /// Converts pixels of `samples` stored values each to red, green and blue and the further channels, of the same
    /// type.
    pub(crate) fn to_rgb(&self, stored: &Pixels, samples: usize) -> Pixels {
        let values = stored.floats();
        let mut out = Vec::with_capacity(values.len() / samples * self.channels(samples));
        // The integer that was stored. Floats hold integers of 16 bits exactly.
        let top = if stored.pixel_type() == PixelType::U8 { 255.0 } else { 65535.0 };
        for pixel in values.chunks_exact(samples) {
            let (color, rest) = pixel.split_at(self.inks());
            let whole = |i: usize| (color[i] * top).round();
            out.extend(match self {
                Self::Cmyk => cmyk_to_rgb([color[0], color[1], color[2], color[3]]),
                Self::CieLab => {
                    let signed = |n: f32| if n > top / 2.0 { n - top - 1.0 } else { n };
                    let unit = (top + 1.0) / 256.0;
                    lab_to_srgb([color[0] * 100.0, signed(whole(1)) / unit, signed(whole(2)) / unit])
                }
                Self::IccLab => {
                    // 100 is 255 in 8 bits, and 65280 in 16.
                    let unit = (top + 1.0) / 256.0;
                    let [l, a, b] = [0, 1, 2].map(|i| whole(i) / unit);
                    lab_to_srgb([l / 2.55, a - 128.0, b - 128.0])
                }
                Self::YCbCr(tags) => tags.rgb([0, 1, 2].map(|i| color[i] * 255.0)),
            });
            out.extend_from_slice(rest);
        }
        Pixels::from_floats(stored.pixel_type(), &out)
    }
}

impl YCbCr {
    fn of(source: &FileSource, directory: &Directory) -> Result<Self> {
        /// Returns the numbers of a tag, or the default where it is absent or damaged.
        fn or<const N: usize>(values: &[f32], default: [f32; N]) -> [f32; N] {
            values.try_into().ok().filter(|v: &[f32; N]| v.iter().all(|n| n.is_finite())).unwrap_or(default)
        }
        let luma = directory.floats(source, tags::YCBCR_COEFFICIENTS, 3)?;
        let reference = directory.floats(source, tags::REFERENCE_BLACK_WHITE, 6)?;
        let block = match directory.numbers(source, tags::YCBCR_SUBSAMPLING, 2)?[..] {
            [h @ (1 | 2 | 4), v @ (1 | 2 | 4)] => (h as usize, v as usize),
            [] => (2, 2),
            ref other => {
                return Err(source.malformed(format!("colour differences of blocks of {other:?} pixels")));
            }
        };
        Ok(Self {
            luma: or(&luma, [0.299, 0.587, 0.114]),
            reference: or(&reference, [0.0, 255.0, 128.0, 255.0, 128.0, 255.0]),
            block,
        })
    }

    /// Returns red, green and blue from 0 to 1.
    fn rgb(&self, stored: [f32; 3]) -> [f32; 3] {
        let [r, g, b] = self.luma;
        let full = |i: usize, top: f32| {
            let (black, white) = (self.reference[2 * i], self.reference[2 * i + 1]);
            (stored[i] - black) * top / (white - black)
        };
        let (y, cb, cr) = (full(0, 255.0), full(1, 127.0), full(2, 127.0));
        let (red, blue) = (y + cr * (2.0 - 2.0 * r), y + cb * (2.0 - 2.0 * b));
        [red, (y - b * blue - r * red) / g, blue].map(|v| (v / 255.0).clamp(0.0, 1.0))
    }

    /// Returns the number of bytes of `size` pixels in blocks. A block is its luminances, row by row, and then its two
    /// differences.
    pub(crate) fn block_bytes(&self, size: (usize, usize)) -> usize {
        let (h, v) = self.block;
        size.0.div_ceil(h) * size.1.div_ceil(v) * (h * v + 2)
    }

    /// Returns three values for each of `size` pixels, from blocks. All pixels of a block get its differences.
    pub(crate) fn spread(&self, blocks: &[u8], size: (usize, usize)) -> Vec<u8> {
        let (h, v) = self.block;
        let across = size.0.div_ceil(h).max(1);
        let mut out = vec![0; size.0 * size.1 * 3];
        for (index, block) in blocks.chunks_exact(h * v + 2).enumerate() {
            let (left, top) = (index % across * h, index / across * v);
            for y in top..(top + v).min(size.1) {
                for x in left..(left + h).min(size.0) {
                    let luminance = block[(y - top) * h + x - left];
                    let at = (y * size.0 + x) * 3;
                    out[at..at + 3].copy_from_slice(&[luminance, block[h * v], block[h * v + 1]]);
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cie_and_icc_lab_give_the_same_colour() {
        let (l, a, b) = (54, 80, -70);
        let cie = Pixels::U8(vec![(l as f32 * 2.55) as u8, a as u8, b as u8, 9]);
        let icc = Pixels::U8(vec![(l as f32 * 2.55) as u8, (a + 128) as u8, (b + 128) as u8, 9]);
        assert_eq!(Colors::CieLab.to_rgb(&cie, 4), Colors::IccLab.to_rgb(&icc, 4));
        let cie = Pixels::U16(vec![35000, (a * 256) as u16, (b * 256) as u16]);
        let Pixels::U16(cie) = Colors::CieLab.to_rgb(&cie, 3) else { panic!() };
        let l = (35000.0f32 / 65535.0 * 65280.0).round() as u16;
        let icc = Pixels::U16(vec![l, ((a + 128) * 256) as u16, ((b + 128) * 256) as u16]);
        let Pixels::U16(icc) = Colors::IccLab.to_rgb(&icc, 3) else { panic!() };
        assert!(cie.iter().zip(&icc).all(|(a, b)| a.abs_diff(*b) <= 3), "{cie:?} {icc:?}");
    }

    #[test]
    fn cmyk_becomes_rgb() {
        let inks = Pixels::U8(vec![0, 0, 0, 0, 7, 255, 0, 51, 0, 8, 0, 0, 0, 255, 9]);
        let rgb = Pixels::U8(vec![255, 255, 255, 7, 0, 255, 204, 8, 0, 0, 0, 9]);
        assert_eq!(Colors::Cmyk.to_rgb(&inks, 5), rgb);
    }

    #[test]
    fn colour_differences_are_shared_by_the_pixels_of_a_block() {
        let tags = YCbCr {
            luma: [0.299, 0.587, 0.114],
            reference: [0.0, 255.0, 128.0, 255.0, 128.0, 255.0],
            block: (2, 2),
        };
        assert_eq!(tags.block_bytes((3, 3)), 24);
        let blocks: Vec<u8> = (0..24).collect();
        let out = tags.spread(&blocks, (3, 3));
        assert_eq!(out[..9], [0, 4, 5, 1, 4, 5, 6, 10, 11]);
        assert_eq!(out[9..18], [2, 4, 5, 3, 4, 5, 8, 10, 11]);
        assert_eq!(out[18..], [12, 16, 17, 13, 16, 17, 18, 22, 23]);
        // The colour is pure red, after TIFF 6.0, section 21.
        let rgb = Colors::YCbCr(tags).to_rgb(&Pixels::U8(vec![76, 85, 255]), 3);
        let Pixels::U8(rgb) = rgb else { panic!() };
        assert!(rgb[0] >= 253 && rgb[1] <= 1 && rgb[2] <= 1, "{rgb:?}");
    }
}
