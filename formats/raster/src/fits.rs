//! FITS ("Definition of the Flexible Image Transport System", version 4.0): images of astronomy, which are read.

use crate::fields::param;
use crate::rows::{Rows, RowsInput};
use granita_base::Params;
use granita_image::{FileSource, Format, ImageInput, ImageSpec, Limits, PixelType, Pixels, Result};
use std::path::Path;

/// The format "fits", which is only read.
///
/// Images of the file are the primary one and the extensions `IMAGE`. A third axis is one of channels: three planes
/// are red, green and blue. Rows run upward in the file. Unsigned integers of 8, 16 and 32 bits (with the conventional
/// offset of the last two) keep their type. All other values are floats of the physical values, `BZERO + BSCALE v`, and
/// blank ones NaN. Keywords are attributes with the prefix "fits:".
#[derive(Clone, Copy, Debug, Default)]
pub struct FitsFormat;

/// The length of a block, in whole numbers of which headers and data are stored.
const BLOCK: u64 = 2880;

/// The length of a card, which is a keyword and its value.
const CARD: usize = 80;

/// The largest number of blocks of a header.
const MOST_BLOCKS: u64 = 4096;

/// The largest number of keywords that become attributes.
const MOST_KEYWORDS: usize = 1000;

impl Format for FitsFormat {
    fn name(&self) -> &'static str {
        "fits"
    }

    fn aliases(&self) -> &'static [&'static str] {
        &["fit"]
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["fits", "fit", "fts"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        head.starts_with(b"SIMPLE  =")
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        let source = FileSource::open(path, "FITS", &limits.files)?;
        let images = read(&source, limits)?.into_iter();
        let (images, planes): (Vec<_>, Vec<_>) = images.map(|(spec, planes)| (vec![spec], planes)).unzip();
        Ok(Box::new(RowsInput::new("fits", "FITS", source, limits, images, FitsRows(planes))?))
    }
}

/// The stored form of an image.
struct Stored {
    /// The offset of the lowest row of the first plane.
    at: u64,
    /// The number of bits of a value, negative for floats.
    bits: i64,
    scale: f64,
    zero: f64,
    /// The integer that stands for no value.
    blank: Option<i64>,
}

struct FitsRows(Vec<Stored>);

impl Rows for FitsRows {
    fn rows(
        &self,
        source: &FileSource,
        spec: &ImageSpec,
        (image, _): (usize, usize),
        y0: u32,
        y1: u32,
    ) -> Result<Pixels> {
        let stored = &self.0[image];
        let (width, height, n) = (u64::from(spec.width), u64::from(spec.height), spec.nchannels());
        let row = width * stored.bits.unsigned_abs() / 8;
        let mut out = Pixels::zeros(spec.pixel_type, spec.width as usize * (y1 - y0) as usize * n);
        for c in 0..n {
            let lowest = c as u64 * height + height - u64::from(y1);
            let bytes =
                source.read_vec(stored.at + lowest * row, row * u64::from(y1 - y0), "rows of pixels")?;
            let upward = bytes.chunks_exact(row as usize).rev().flatten().copied().collect();
            out.set_plane(c, n, &stored.values(upward, spec.pixel_type));
        }
        Ok(out)
    }
}

impl Stored {
    /// Returns the type in which values are given out.
    fn pixel_type(&self) -> PixelType {
        let plain = |zero: f64| self.scale == 1.0 && self.zero == zero && self.blank.is_none();
        match self.bits {
            8 if plain(0.0) => PixelType::U8,
            16 if plain(32_768.0) => PixelType::U16,
            32 if plain(2_147_483_648.0) => PixelType::U32,
            _ => PixelType::Float,
        }
    }

    /// Converts stored bytes to values.
    fn values(&self, bytes: Vec<u8>, pixel_type: PixelType) -> Pixels {
        match pixel_type {
            PixelType::U8 => return Pixels::U8(bytes),
            // The offset turns the range of signed numbers into that of unsigned ones. It inverts the highest bit.
            PixelType::U16 => {
                let short = |b: &[u8; 2]| u16::from_be_bytes(*b) ^ 0x8000;
                return Pixels::U16(bytes.as_chunks().0.iter().map(short).collect());
            }
            PixelType::U32 => {
                let long = |b: &[u8; 4]| u32::from_be_bytes(*b) ^ 0x8000_0000;
                return Pixels::U32(bytes.as_chunks().0.iter().map(long).collect());
            }
            PixelType::Half | PixelType::Float => {}
        }
        let whole = |v: i64| match self.blank {
            Some(blank) if blank == v => f32::NAN,
            _ => (self.zero + self.scale * v as f64) as f32,
        };
        let real = |v: f64| (self.zero + self.scale * v) as f32;
        Pixels::Float(match self.bits {
            8 => bytes.iter().map(|b| whole(i64::from(*b))).collect(),
            16 => bytes.as_chunks().0.iter().map(|b| whole(i64::from(i16::from_be_bytes(*b)))).collect(),
            32 => bytes.as_chunks().0.iter().map(|b| whole(i64::from(i32::from_be_bytes(*b)))).collect(),
            64 => bytes.as_chunks().0.iter().map(|b| whole(i64::from_be_bytes(*b))).collect(),
            -32 => bytes.as_chunks().0.iter().map(|b| real(f64::from(f32::from_be_bytes(*b)))).collect(),
            _ => bytes.as_chunks().0.iter().map(|b| real(f64::from_be_bytes(*b))).collect(),
        })
    }
}

/// A keyword and its value, as text.
struct Card {
    keyword: String,
    value: String,
    /// True for a text in quotes.
    quoted: bool,
}

impl Card {
    /// Reads a card; `None` for one without a value, such as a comment.
    fn parse(card: &[u8]) -> Option<Self> {
        let keyword = String::from_utf8_lossy(&card[..8]).trim_end().to_owned();
        let rest = card[8..].strip_prefix(b"= ")?;
        let rest = String::from_utf8_lossy(rest);
        let rest = rest.trim_start();
        let Some(text) = rest.strip_prefix('\'') else {
            let value = rest.split('/').next().unwrap_or_default().trim().to_owned();
            return (!keyword.is_empty()).then_some(Self { keyword, value, quoted: false });
        };
        // A quote inside of the text is doubled.
        let mut value = String::new();
        let mut chars = text.chars().peekable();
        while let Some(c) = chars.next() {
            if c == '\'' && chars.next_if_eq(&'\'').is_none() {
                break;
            }
            value.push(c);
        }
        let value = value.trim_end().to_owned();
        (!keyword.is_empty()).then_some(Self { keyword, value, quoted: true })
    }
}

/// The cards of a header.
struct Cards(Vec<Card>);

impl Cards {
    /// Reads the header at `at`, and returns the offset behind it.
    fn read(source: &FileSource, at: u64) -> Result<(Self, u64)> {
        let mut cards = Vec::new();
        for block in 0..MOST_BLOCKS {
            let from = at + block * BLOCK;
            let bytes = source.read_vec(from, BLOCK, "a block of the header")?;
            for card in bytes.chunks_exact(CARD) {
                if card.starts_with(b"END     ") {
                    return Ok((Self(cards), from + BLOCK));
                }
                cards.extend(Card::parse(card));
            }
        }
        Err(source.malformed(format!("the header at byte {at} has no end within {MOST_BLOCKS} blocks")))
    }

    fn get(&self, keyword: &str) -> Option<&str> {
        self.0.iter().find(|card| card.keyword == keyword).map(|card| &*card.value)
    }

    /// Returns an integer; `None` where the keyword is missing.
    fn int(&self, source: &FileSource, keyword: &str) -> Result<Option<i64>> {
        let Some(value) = self.get(keyword) else { return Ok(None) };
        let bad = |_| source.malformed(format!("\"{value}\" of {keyword} is not a valid integer"));
        value.parse().map(Some).map_err(bad)
    }

    /// Returns a number; `default` where the keyword is missing.
    fn real(&self, source: &FileSource, keyword: &str, default: f64) -> Result<f64> {
        let Some(value) = self.get(keyword) else { return Ok(default) };
        // Exponents of double precision are written with a D.
        let number = value.replace(['D', 'd'], "E").parse().ok().filter(|v: &f64| v.is_finite());
        number.ok_or_else(|| source.malformed(format!("\"{value}\" of {keyword} is not a valid number")))
    }

    /// Returns the lengths of the axes.
    fn axes(&self, source: &FileSource) -> Result<Vec<u64>> {
        let count = self.int(source, "NAXIS")?.unwrap_or(0);
        if !(0..=999).contains(&count) {
            return Err(source.malformed(format!("{count} axes")));
        }
        let axis = |i| {
            let length = self.int(source, &format!("NAXIS{i}"))?.unwrap_or(0);
            u64::try_from(length).map_err(|_| source.malformed(format!("an axis of length {length}")))
        };
        (1..=count).map(axis).collect()
    }

    /// Adds what describes the image to `attributes`.
    fn describe(&self, attributes: &mut Params) {
        const STRUCTURE: [&str; 12] = [
            "SIMPLE", "XTENSION", "BITPIX", "NAXIS", "EXTEND", "PCOUNT", "GCOUNT", "GROUPS", "BSCALE",
            "BZERO", "BLANK", "END",
        ];
        let structural =
            |card: &&Card| STRUCTURE.contains(&&*card.keyword) || card.keyword.starts_with("NAXIS");
        for Card { keyword, value, quoted } in
            self.0.iter().filter(|card| !structural(card)).take(MOST_KEYWORDS)
        {
            let name = format!("fits:{keyword}");
            let number = || value.replace(['D', 'd'], "E").parse::<f32>().ok().filter(|v| v.is_finite());
            attributes.set(match value.parse::<i32>() {
                Ok(int) if !quoted => param(&name, int.into()),
                _ => match number().filter(|_| !quoted) {
                    Some(real) => param(&name, real.into()),
                    None => param(&name, value.as_str().into()),
                },
            });
        }
    }
}

/// Returns the images of a file, and their stored form.
fn read(source: &FileSource, limits: &Limits) -> Result<Vec<(ImageSpec, Stored)>> {
    let mut images = Vec::new();
    let mut at = 0;
    let mut refused = None;
    // Blocks behind the last extension are not a header.
    while at < source.len() && (at == 0 || source.read_vec(at, 8, "a header").is_ok_and(|b| b == b"XTENSION"))
    {
        let (cards, data) = Cards::read(source, at)?;
        let axes = cards.axes(source)?;
        let bits = cards.int(source, "BITPIX")?.unwrap_or(0);
        let pixels = axes.iter().try_fold(1_u64, |n, axis| n.checked_mul(*axis)).filter(|_| !axes.is_empty());
        let other = cards.int(source, "PCOUNT")?.unwrap_or(0).max(0) as u64;
        let groups = cards.int(source, "GCOUNT")?.unwrap_or(1).max(1) as u64;
        let is_image = at == 0 || cards.get("XTENSION") == Some("IMAGE");
        if is_image && !axes.is_empty() && axes.iter().all(|axis| *axis > 0) {
            match image(source, limits, &cards, &axes, (bits, data)) {
                Ok(image) => images.push(image),
                Err(error) if images.is_empty() && refused.is_none() => refused = Some(error),
                Err(_) => {}
            }
            limits.within(
                source.path(),
                "number of images",
                images.len() as u64,
                u64::from(limits.images),
            )?;
        }
        // The data of random groups and tables is skipped as well.
        let bytes = if axes.is_empty() { Some(0) } else { pixels.and_then(|n| n.checked_add(other)) };
        let bytes = bytes.and_then(|n| n.checked_mul(groups)?.checked_mul(bits.unsigned_abs() / 8));
        let next = bytes.and_then(|n| n.checked_next_multiple_of(BLOCK)).and_then(|n| n.checked_add(data));
        match next {
            Some(next) if next > at => at = next,
            _ => break,
        }
    }
    match (images.is_empty(), refused) {
        (false, _) => Ok(images),
        (true, Some(error)) => Err(error),
        (true, None) => Err(source.unsupported("FITS without an image (tables are not read)")),
    }
}

fn image(
    source: &FileSource,
    limits: &Limits,
    cards: &Cards,
    axes: &[u64],
    (bits, at): (i64, u64),
) -> Result<(ImageSpec, Stored)> {
    if !matches!(bits, 8 | 16 | 32 | 64 | -32 | -64) {
        return Err(source.malformed(format!("values of {bits} bits")));
    }
    if cards.get("GROUPS") == Some("T") || axes.get(3..).is_some_and(|more| more.iter().any(|axis| *axis > 1))
    {
        return Err(source.unsupported(format!("FITS with {} axes or groups is not supported", axes.len())));
    }
    let axis = |i: usize| axes.get(i).copied().unwrap_or(1);
    for (i, what) in [(0, "image side"), (1, "image side")] {
        limits.within(source.path(), what, axis(i), u64::from(limits.dimension))?;
    }
    limits.within(source.path(), "number of channels", axis(2), u64::from(limits.channels))?;
    let scale = cards.real(source, "BSCALE", 1.0)?;
    let zero = cards.real(source, "BZERO", 0.0)?;
    let blank = if bits > 0 { cards.int(source, "BLANK")? } else { None };
    let stored = Stored { at, bits, scale, zero, blank };
    let n = axis(2) as usize;
    let mut spec = ImageSpec::new(axis(0) as u32, axis(1) as u32, n, stored.pixel_type());
    if !matches!(n, 1 | 3) {
        // Other planes are bands or moments, not alpha.
        spec.channels = (0..n).map(|i| format!("channel{i}")).collect();
    }
    cards.describe(&mut spec.attributes);
    Ok((spec, stored))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn card(text: &str) -> Option<(String, String, bool)> {
        let card = Card::parse(format!("{text:80}").as_bytes())?;
        Some((card.keyword, card.value, card.quoted))
    }

    #[test]
    fn cards_are_keywords_with_values() {
        let of = |keyword: &str, value: &str, quoted| Some((keyword.to_owned(), value.to_owned(), quoted));
        assert_eq!(card("NAXIS1  =                  100 / length"), of("NAXIS1", "100", false));
        assert_eq!(card("OBJECT  = 'Barnard''s / star  ' / name"), of("OBJECT", "Barnard's / star", true));
        assert_eq!(card("EXPTIME =              1.5D+02"), of("EXPTIME", "1.5D+02", false));
        assert_eq!(card("COMMENT   = is not a value"), None);
        assert_eq!(card("HISTORY of the file"), None);
        assert_eq!(card(""), None);
    }
}
