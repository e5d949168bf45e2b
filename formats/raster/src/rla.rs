//! RLA (Wavefront, "RLA File Format", revision 3), run-length encoded images of renderers, which are read.

use crate::fields::{Field, Header, Kind, param};
use crate::rows::{Rows, RowsInput};
use granita_image::{FileSource, Format, ImageInput, ImageSpec, Limits, PixelType, Pixels, Result};
use std::path::Path;

/// The format "rla", which is only read.
///
/// Channels are those of the colour, then mattes, of which the first is alpha, then auxiliary ones, of which the first
/// one of 32 bits is the depth `Z`. Where their types differ, all values are floats: integers of up to 16 bits as
/// fractions, and of 32 bits as numbers. Concatenated files are images.
#[derive(Clone, Copy, Debug, Default)]
pub struct RlaFormat;

/// The length of the header, which the table of rows follows.
const HEADER: u64 = 740;

const FIELDS: [Field; 12] = [
    Field::new("rla:Gamma", 28, Kind::Text(16)),
    Field::new("rla:FileName", 144, Kind::Text(128)),
    Field::new("ImageDescription", 272, Kind::Text(128)),
    Field::new("software", 400, Kind::Text(64)),
    Field::new("HostComputer", 464, Kind::Text(32)),
    Field::new("Artist", 496, Kind::Text(32)),
    Field::new("rla:DateCreated", 528, Kind::Text(20)),
    Field::new("rla:Aspect", 548, Kind::Text(24)),
    Field::new("rla:ColorChannel", 580, Kind::Text(32)),
    Field::new("rla:Time", 614, Kind::Text(12)),
    Field::new("rla:Filter", 626, Kind::Text(32)),
    Field::new("rla:AuxData", 668, Kind::Text(32)),
];

impl Format for RlaFormat {
    fn name(&self) -> &'static str {
        "rla"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["rla"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        // Files have no mark. The revision, the type of the channels and their number are as good as one.
        let short = |at: usize| head.get(at..at + 2).map(|b| u16::from_be_bytes([b[0], b[1]]));
        short(26) == Some(0xfffe)
            && short(18).is_some_and(|kind| kind <= 4)
            && short(20).is_some_and(|n| (1..=3).contains(&n))
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        let source = FileSource::open(path, "RLA", &limits.files)?;
        let images = read(&source, limits)?.into_iter();
        let (images, stored): (Vec<_>, Vec<_>) = images.map(|(spec, stored)| (vec![spec], stored)).unzip();
        Ok(Box::new(RowsInput::new("rla", "RLA", source, limits, images, RlaRows(stored))?))
    }
}

/// Channels of one kind.
#[derive(Clone, Copy, Debug)]
struct Group {
    count: usize,
    pixel_type: PixelType,
    /// The number of bits of an integer, of which there may be fewer than those of the type.
    bits: u32,
}

/// The stored form of an image.
struct Stored {
    groups: [Group; 3],
    /// The offset of each row, from the lowest on.
    rows: Vec<u32>,
}

struct RlaRows(Vec<Stored>);

impl Rows for RlaRows {
    fn rows(
        &self,
        source: &FileSource,
        spec: &ImageSpec,
        (image, _): (usize, usize),
        y0: u32,
        y1: u32,
    ) -> Result<Pixels> {
        let Stored { groups, rows } = &self.0[image];
        let (width, n) = (spec.width as usize, spec.nchannels());
        let mut out = Pixels::zeros(spec.pixel_type, width * (y1 - y0) as usize * n);
        for y in y0..y1 {
            let mut at = u64::from(rows[(spec.height - 1 - y) as usize]);
            let mut row = Pixels::zeros(spec.pixel_type, width * n);
            let channels = groups.iter().flat_map(|group| std::iter::repeat_n(group, group.count));
            for (c, group) in channels.enumerate() {
                let len = source.read_vec(at, 2, "the length of a row")?;
                let len = u64::from(u16::from_be_bytes([len[0], len[1]]));
                let bytes = source.read_vec(at + 2, len, "a row")?;
                let values = group.values(&bytes, width).ok_or_else(|| {
                    source.malformed(format!("row {y} of channel {c}, at byte {at}, is not {width} values"))
                })?;
                row.set_plane(c, n, &values.converted(spec.pixel_type));
                at += 2 + len;
            }
            out.copy_from((y - y0) as usize * width * n, &row, 0, width * n);
        }
        Ok(out)
    }
}

impl Group {
    /// Decodes the values of a row. `None` when there are not exactly `width` values.
    fn values(self, bytes: &[u8], width: usize) -> Option<Pixels> {
        let size = self.pixel_type.bytes();
        if self.pixel_type == PixelType::Float {
            // Floats are not encoded.
            return (bytes.len() == width * size)
                .then(|| Pixels::from_bytes(PixelType::Float, bytes.to_vec(), true));
        }
        // The most significant bytes of all values come first.
        let mut out = vec![0; width * size];
        let mut rest = bytes;
        for byte in 0..size {
            rest = unpack(rest, out.iter_mut().skip(byte).step_by(size), width)?;
        }
        let mut values = Pixels::from_bytes(self.pixel_type, out, true);
        // Integers of fewer bits span the range of their type.
        let most = (1_u64 << self.bits) - 1;
        match &mut values {
            Pixels::U8(v) if self.bits < 8 => {
                v.iter_mut().for_each(|v| *v = (u64::from(*v).min(most) * 255 / most) as u8);
            }
            Pixels::U16(v) if self.bits < 16 => {
                let wide = |v: u16| (u64::from(v).min(most) * 65535 + most / 2) / most;
                v.iter_mut().for_each(|v| *v = wide(*v) as u16);
            }
            _ => {}
        }
        Some(values)
    }
}

/// Decodes runs to `count` bytes, and returns the rest. A count from 0 to 127 is one less than the number of
/// repetitions of the next byte. The negative of another is the number of bytes that follow.
fn unpack<'a, 'b>(
    mut packed: &'a [u8],
    mut out: impl Iterator<Item = &'b mut u8>,
    count: usize,
) -> Option<&'a [u8]> {
    let mut left = count;
    while left > 0 {
        let (code, rest) = packed.split_first()?;
        let n = if *code < 128 { usize::from(*code) + 1 } else { 256 - usize::from(*code) };
        left = left.checked_sub(n)?;
        if *code < 128 {
            let (value, rest) = rest.split_first()?;
            out.by_ref().take(n).for_each(|out| *out = *value);
            packed = rest;
        } else {
            let (values, rest) = rest.split_at_checked(n)?;
            out.by_ref().zip(values).for_each(|(out, value)| *out = *value);
            packed = rest;
        }
    }
    Some(packed)
}

/// Returns the images of a file, and their stored form.
fn read(source: &FileSource, limits: &Limits) -> Result<Vec<(ImageSpec, Stored)>> {
    let mut images = Vec::new();
    let mut at = 0;
    loop {
        let (spec, stored, next) = read_image(source, limits, at)?;
        images.push((spec, stored));
        limits.within(source.path(), "number of images", images.len() as u64, u64::from(limits.images))?;
        if next == 0 {
            return Ok(images);
        }
        if next < at + HEADER {
            return Err(source.malformed(format!("the image after that at byte {at} is at byte {next}")));
        }
        at = next;
    }
}

fn read_image(source: &FileSource, limits: &Limits, at: u64) -> Result<(ImageSpec, Stored, u64)> {
    let header = Header::new(source.read_vec(at, HEADER, "the header")?, true);
    let short = |at: usize| header.short(at).cast_signed();
    if !matches!(header.short(26), 0xfffe | 0) {
        return Err(source.malformed(format!("revision {:#x}", header.short(26))));
    }
    let [window_left, window_right, window_bottom, window_top] = [0, 2, 4, 6].map(|at| i32::from(short(at)));
    let [left, right, bottom, top] = [8, 10, 12, 14].map(|at| i32::from(short(at)));
    let side = |from: i32, to: i32| u32::try_from(to - from + 1).unwrap_or(0);
    let fields = if short(612) == 0 { 1 } else { 2 };
    let (width, height) = (side(left, right), side(bottom, top) / fields);
    let group = |kind: usize, count: usize, bits: usize, most: i16| {
        let (kind, count, bits) = (short(kind), short(count), short(bits));
        if !(0..=most).contains(&count)
            || !(0..=32).contains(&bits)
            || count > 0 && !matches!(kind, 0 | 1 | 2 | 4)
        {
            return Err(source.malformed(format!("{count} channels of type {kind} with {bits} bits")));
        }
        let bits = if bits == 0 { 8 } else { bits.unsigned_abs().into() };
        let (pixel_type, natural) = match (kind, bits) {
            (4, _) => (PixelType::Float, 32),
            (0, 0..=8) => (PixelType::U8, 8),
            (1, _) | (0, 9..=16) => (PixelType::U16, 16),
            _ => (PixelType::U32, 32),
        };
        Ok(Group { count: count.unsigned_abs().into(), pixel_type, bits: bits.min(natural) })
    };
    let groups = [group(18, 20, 658, 3)?, group(660, 22, 662, 3)?, group(664, 24, 666, 256)?];
    let [color, matte, aux] = groups;
    if color.count == 0 {
        return Err(source.malformed("0 channels of colours"));
    }
    let mut channels = ImageSpec::default_channels(color.count.min(3));
    if color.count == 2 {
        channels = vec!["channel0".to_owned(), "channel1".to_owned()];
    }
    for i in 0..matte.count {
        channels.push(if i == 0 { "A".to_owned() } else { format!("channel{}", channels.len()) });
    }
    for i in 0..aux.count {
        let depth = i == 0 && matches!(aux.pixel_type, PixelType::Float | PixelType::U32);
        channels.push(if depth { "Z".to_owned() } else { format!("channel{}", channels.len()) });
    }
    let mut present = groups.iter().filter(|g| g.count > 0).map(|g| g.pixel_type);
    let same = present.clone().all(|t| t == color.pixel_type);
    let pixel_type = present.next().filter(|_| same).unwrap_or(PixelType::Float);
    let mut spec = ImageSpec { channels, ..ImageSpec::new(width, height, 1, pixel_type) };
    limits.check(source.path(), "RLA", &spec)?;
    let (full_width, full_height) = (side(window_left, window_right), side(window_bottom, window_top));
    if full_width > 0 && full_height > 0 {
        (spec.full_x, spec.full_width, spec.full_height) = (window_left, full_width, full_height);
        // Rows are counted from the bottom there, and from the top here.
        (spec.x, spec.y) = (left, window_top - top);
    }
    header.read(&FIELDS, &mut spec.attributes);
    if short(16) > 0 {
        spec.attributes.set(param("rla:FrameNumber", i32::from(short(16)).into()));
    }
    let aspect = header.text(572, 8).and_then(|text| text.parse::<f32>().ok());
    if let Some(aspect) = aspect.filter(|a| a.is_finite() && *a > 0.0 && *a != 1.0) {
        spec.attributes.set(param("pixelaspect", aspect.into()));
    }
    let table = source.read_vec(at + HEADER, u64::from(height) * 4, "the table of rows")?;
    let rows = table.as_chunks::<4>().0.iter().map(|b| u32::from_be_bytes(*b)).collect();
    Ok((spec, Stored { groups, rows }, u64::from(header.long(736))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_unpacked_to_exactly_one_row() {
        let of = |packed: &[u8], n: usize| {
            let mut out = vec![0; n];
            unpack(packed, out.iter_mut(), n).map(<[u8]>::len).map(|left| (out, left))
        };
        let packed = [1, 7, 253, 1, 2, 3, 9];
        assert_eq!(of(&packed, 5), Some((vec![7, 7, 1, 2, 3], 1)));
        for (bad, n) in [(&packed[..], 4), (&packed[..5], 5), (&[5, 1], 3), (&[1], 2), (&[], 1)] {
            assert_eq!(of(bad, n), None, "{bad:?}");
        }
    }

    #[test]
    fn integers_of_fewer_bits_span_the_range_of_their_type() {
        let group = Group { count: 1, pixel_type: PixelType::U16, bits: 10 };
        let bytes = [254, 0, 3, 254, 0, 255];
        assert_eq!(group.values(&bytes, 2), Some(Pixels::U16(vec![0, 65535])));
        let group = Group { count: 1, pixel_type: PixelType::U8, bits: 4 };
        assert_eq!(group.values(&[254, 15, 5], 2), Some(Pixels::U8(vec![255, 85])));
    }
}
