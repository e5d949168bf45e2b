//! Photoshop documents, PSD and PSB (Adobe, "Photoshop File Format Specification" of 2019): the merged image and
//! layers.

mod cursor;
mod document;
mod kind;
mod layers;
mod planes;

use crate::rows::{Rows, RowsInput};
use granita_image::{FileSource, Format, ImageInput, ImageSpec, Limits, PixelType, Pixels, Result, color};
use kind::{Document, Mode};
use planes::Plane;
use std::path::Path;

/// The format "psd", which is only read.
///
/// The first image is the merged one, the others are layers from the lowest on, without groups and others that have no
/// pixels. The name of a layer is the attribute `name`.
///
/// Grey, RGB, indexed, CMYK, L*a*b*, bitmap and duotone (as grey) documents of 1, 8, 16 and 32 bits are read. Colours
/// are not multiplied by alpha (`int unassociatedalpha` 1). Those of the merged image are stored before a white
/// background, which is removed.
#[derive(Clone, Copy, Debug, Default)]
pub struct PsdFormat;

impl Format for PsdFormat {
    fn name(&self) -> &'static str {
        "psd"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["psd", "psb", "pdd"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        matches!(head, [b'8', b'B', b'P', b'S', 0, 1 | 2, ..])
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        let source = FileSource::open(path, "PSD", &limits.files)?;
        let (document, images) = Document::read(&source, limits)?;
        let (specs, planes): (Vec<_>, Vec<_>) = images.into_iter().map(|i| (vec![i.spec], i.planes)).unzip();
        let rows = PsdRows { document, images: planes, limits: limits.clone() };
        Ok(Box::new(RowsInput::new("psd", "PSD", source, limits, specs, rows)?))
    }
}

struct PsdRows {
    document: Document,
    /// The planes of each image: those of the colour, then alpha, then others.
    images: Vec<Vec<Plane>>,
    limits: Limits,
}

impl Rows for PsdRows {
    fn rows(
        &self,
        source: &FileSource,
        spec: &ImageSpec,
        (image, _): (usize, usize),
        y0: u32,
        y1: u32,
    ) -> Result<Pixels> {
        let (width, rows) = (spec.width as usize, (y1 - y0) as usize);
        let planes = &self.images[image];
        let mut out = Pixels::zeros(spec.pixel_type, width * rows * spec.nchannels());
        for y in y0..y1 {
            let mut stored = Pixels::zeros(spec.pixel_type, width * planes.len());
            for (c, plane) in planes.iter().enumerate() {
                let bytes = plane.row(source, &self.limits, y)?;
                let bytes = if self.document.depth == 1 { grey_of_bits(&bytes, width) } else { bytes };
                stored.set_plane(c, planes.len(), &Pixels::from_bytes(spec.pixel_type, bytes, true));
            }
            let mut row = self.colors(stored, planes.len());
            if image == 0
                && self.document.merged_alpha
                && let Some(alpha) = spec.alpha_channel()
            {
                remove_white(&mut row, spec.nchannels(), alpha);
            }
            out.copy_from((y - y0) as usize * width * spec.nchannels(), &row, 0, row.len());
        }
        Ok(out)
    }

    fn working_bytes(&self, spec: &ImageSpec) -> u64 {
        // Compressed layers are kept as long as the file is open.
        spec.bytes().unwrap_or(u64::MAX)
    }
}

impl PsdRows {
    /// Converts the `n` stored values of each pixel to the channels of the image.
    fn colors(&self, stored: Pixels, n: usize) -> Pixels {
        let convert = |inks: usize, rgb: &dyn Fn(&[f32]) -> [f32; 3]| {
            let values = stored.floats();
            let pixels = values.chunks_exact(n);
            let out: Vec<f32> =
                pixels.flat_map(|p| rgb(p).into_iter().chain(p[inks..].iter().copied())).collect();
            Pixels::from_floats(stored.pixel_type(), &out)
        };
        match self.document.mode {
            // Inks are stored inverted.
            Mode::Cmyk => {
                convert(4, &|p| color::cmyk_to_rgb([1.0 - p[0], 1.0 - p[1], 1.0 - p[2], 1.0 - p[3]]))
            }
            Mode::Lab => convert(3, &|p| {
                color::lab_to_srgb([p[0] * 100.0, p[1] * 255.0 - 128.0, p[2] * 255.0 - 128.0])
            }),
            Mode::Indexed => {
                let Pixels::U8(indices) = stored else { return stored };
                let rgb = |i: u8| [0, 256, 512].map(|plane| self.document.palette[plane + usize::from(i)]);
                match self.document.transparent {
                    None => Pixels::U8(indices.into_iter().flat_map(rgb).collect()),
                    Some(clear) => {
                        let alpha = |i: u8| if u16::from(i) == clear { 0 } else { 255 };
                        let rgba = |i: u8| rgb(i).into_iter().chain([alpha(i)]);
                        Pixels::U8(indices.into_iter().flat_map(rgba).collect())
                    }
                }
            }
            Mode::Bitmap | Mode::Grey | Mode::Rgb | Mode::Multichannel => stored,
        }
    }
}

/// Returns a byte for each of `width` bits, of which 1 is black.
fn grey_of_bits(bits: &[u8], width: usize) -> Vec<u8> {
    (0..width).map(|x| if bits[x / 8] >> (7 - x % 8) & 1 == 1 { 0 } else { 255 }).collect()
}

/// Removes the white background from colours in front of it. Where alpha is 0 the colour becomes 0.
fn remove_white(pixels: &mut Pixels, n: usize, alpha: usize) {
    if pixels.pixel_type() == PixelType::U32 {
        return;
    }
    let mut values = pixels.to_floats();
    for pixel in values.chunks_exact_mut(n) {
        let a = pixel[alpha];
        // Further channels follow alpha. They have no background.
        for value in &mut pixel[..alpha] {
            *value = if a > 0.0 { ((*value - (1.0 - a)) / a).max(0.0) } else { 0.0 };
        }
    }
    *pixels = Pixels::from_floats(pixels.pixel_type(), &values);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_become_black_and_white() {
        assert_eq!(
            grey_of_bits(&[0b1010_0000, 0b0100_0000], 10),
            [0, 255, 0, 255, 255, 255, 255, 255, 255, 0]
        );
    }

    #[test]
    fn the_white_background_is_removed_from_colours_alone() {
        // Half of a red in front of white, then nothing, then an opaque colour, each with a further channel.
        let mut pixels = Pixels::U8(vec![255, 127, 127, 128, 7, 255, 255, 255, 0, 8, 1, 2, 3, 255, 9]);
        remove_white(&mut pixels, 5, 3);
        assert_eq!(pixels, Pixels::U8(vec![255, 0, 0, 128, 7, 0, 0, 0, 0, 8, 1, 2, 3, 255, 9]));
    }
}
