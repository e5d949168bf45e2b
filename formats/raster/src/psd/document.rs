//! The header, the resources and the merged image of a document.

use super::cursor::Cursor;
use super::kind::{Document, Mode};
use super::layers::{self, Layer};
use super::planes::{Plane, Size};
use crate::fields::param;
use granita_image::metadata::{exif, iptc};
use granita_image::{FileSource, ImageSpec, Limits, PixelType, Result};

/// An image of a document.
pub(super) struct Image {
    pub(super) spec: ImageSpec,
    pub(super) planes: Vec<Plane>,
}

impl Document {
    /// Returns a document, and its images: the merged one, then layers.
    ///
    /// # Errors
    /// Errors for a damaged file, and for an unsupported kind.
    pub(super) fn read(source: &FileSource, limits: &Limits) -> Result<(Self, Vec<Image>)> {
        let mut file = Cursor::new(source, "the file");
        let (mark, version) = (file.key()?, file.u16()?);
        if mark != *b"8BPS" || !matches!(version, 1 | 2) {
            return Err(source.malformed("it does not begin like one"));
        }
        file.skip(6)?;
        let (channels, height, width) = (file.u16()?, file.u32()?, file.u32()?);
        let (depth, mode) = (file.u16()?, file.u16()?);
        let unsupported =
            || source.unsupported(format!("PSD of colour mode {mode} with {depth} bits is not supported"));
        let mode = match (mode, depth) {
            (0, 1) => Mode::Bitmap,
            // A duotone is stored as grey, and its inks are not specified.
            (1 | 8, 8 | 16 | 32) => Mode::Grey,
            (2, 8) => Mode::Indexed,
            (3, 8 | 16 | 32) => Mode::Rgb,
            (4, 8 | 16) => Mode::Cmyk,
            (7, 8 | 16) => Mode::Multichannel,
            (9, 8 | 16) => Mode::Lab,
            _ => return Err(unsupported()),
        };
        let mut document = Self {
            mode,
            depth,
            wide: version == 2,
            size: (width, height),
            palette: Vec::new(),
            transparent: None,
            merged_alpha: false,
        };
        // The size is checked before any table of its rows is read.
        let n = usize::from(channels);
        limits.check(source.path(), "PSD", &document.spec(width, height, n))?;
        let inks = mode.inks(n);
        if n < inks {
            return Err(source.malformed(format!("{n} channels, of which colours need {inks}")));
        }
        let palette = file.length(false)?;
        let mut palette = file.part(palette, "the palette")?;
        if mode == Mode::Indexed {
            document.palette = palette.bytes(768)?;
        }
        let resources = file.length(false)?;
        let mut common = document.spec(width, height, 1);
        document.read_resources(&mut file.part(resources, "the image resources")?, &mut common)?;
        let layers = file.length(document.wide)?;
        let layers = layers::read(&mut file.part(layers, "the layers")?, &mut document, limits)?;
        let merged = document.merged(&mut file, n, &common)?;
        let mut images = vec![merged];
        images.extend(layers.into_iter().map(|layer| document.layer(layer)));
        Ok((document, images))
    }

    fn pixel_type(&self) -> PixelType {
        match self.depth {
            32 => PixelType::Float,
            16 => PixelType::U16,
            _ => PixelType::U8,
        }
    }

    fn spec(&self, width: u32, height: u32, channels: usize) -> ImageSpec {
        ImageSpec::new(width, height, channels, self.pixel_type())
    }

    /// Returns the channels of the colour, as they are returned.
    fn colors(&self, inks: usize) -> Vec<String> {
        match self.mode {
            Mode::Bitmap | Mode::Grey => ImageSpec::default_channels(1),
            Mode::Multichannel => (0..inks).map(|i| format!("channel{i}")).collect(),
            Mode::Indexed | Mode::Rgb | Mode::Cmyk | Mode::Lab => ImageSpec::default_channels(3),
        }
    }

    /// Reads what is known of profiles and descriptions, and the transparent index.
    fn read_resources(&mut self, part: &mut Cursor<'_>, spec: &mut ImageSpec) -> Result<()> {
        /// The number of bytes of the longest description that is kept.
        const LONGEST: u64 = 1 << 20;
        // Some programs end the section with fewer bytes than a resource has.
        while part.left() >= 12 {
            let (mark, id) = (part.key()?, part.u16()?);
            if !matches!(&mark, b"8BIM" | b"MeSa" | b"AgHg" | b"PHUT" | b"DCSR") {
                break;
            }
            part.pascal(2)?;
            let len = u64::from(part.u32()?);
            let mut content = part.part(len, "an image resource")?;
            part.skip((len % 2).min(part.left()))?;
            match id {
                1047 if len >= 2 => self.transparent = Some(content.u16()?),
                1039 => {
                    let profile = content.bytes(len)?;
                    spec.set_icc_profile(profile);
                }
                1028 if len <= LONGEST => iptc::read(&content.bytes(len)?, &mut spec.attributes),
                1058 if len <= LONGEST => {
                    exif::read(&content.bytes(len)?, &mut spec.attributes);
                    // The pixels are upright.
                    spec.attributes.0.retain(|p| &*p.name != "orientation");
                }
                1060 if len <= LONGEST => {
                    let text = String::from_utf8_lossy(&content.bytes(len)?).into_owned();
                    spec.attributes.set(param("XMP", text.trim_end_matches('\0').into()));
                }
                _ => {}
            }
        }
        Ok(())
    }

    /// Returns the merged image, which is the rest of the file.
    fn merged(&self, file: &mut Cursor<'_>, channels: usize, common: &ImageSpec) -> Result<Image> {
        let (width, height) = self.size;
        let inks = self.mode.inks(channels);
        let size = Size { width, height, depth: self.depth };
        let mut planes = Plane::merged(file, size, channels, self.wide)?;
        let mut spec = ImageSpec { channels: self.colors(inks), ..self.spec(width, height, 1) };
        spec.attributes = common.attributes.clone();
        // Inks and L*a*b* become RGB, whose profile is another one.
        if matches!(self.mode, Mode::Cmyk | Mode::Lab) {
            spec.remove_icc_profile();
        } else {
            spec.icc_profile.clone_from(&common.icc_profile);
        }
        if self.mode == Mode::Indexed {
            // Further channels would have to be of the same type as the palette's colours.
            planes.truncate(1);
            if self.transparent.is_some() {
                spec.channels.push("A".to_owned());
            }
        }
        for i in inks..planes.len() {
            let alpha = i == inks && self.merged_alpha;
            let name = if alpha { "A".to_owned() } else { format!("channel{}", spec.nchannels()) };
            spec.channels.push(name);
        }
        mark_alpha(&mut spec);
        Ok(Image { spec, planes })
    }

    fn layer(&self, layer: Layer) -> Image {
        let (width, height) = layer.size;
        let mut spec = ImageSpec { channels: self.colors(layer.inks), ..self.spec(width, height, 1) };
        if layer.alpha {
            spec.channels.push("A".to_owned());
        }
        (spec.x, spec.y) = layer.position;
        (spec.full_width, spec.full_height) = self.size;
        spec.attributes = layer.attributes;
        mark_alpha(&mut spec);
        Image { spec, planes: layer.planes }
    }
}

/// Marks colours that are not multiplied by alpha.
fn mark_alpha(spec: &mut ImageSpec) {
    if spec.alpha_channel().is_some() {
        spec.attributes.set(param("unassociatedalpha", 1.into()));
    }
}
