//! Maya's image files (Autodesk, "Maya File Formats": image file format), which are tiles of RGBA and depth in chunks.

use crate::rows::{Rows, RowsInput};
use crate::whole::WholeOutput;
use granita_base::{BaseType, Param, ParamType};
use granita_image::{
    AtomicFile, CreateOptions, FileSource, Format, ImageError, ImageInput, ImageOutput, ImageSpec, Limits,
    PixelType, Pixels, Result,
};
use parking_lot::Mutex;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// The format "iff" (reference 7.4.6).
///
/// Reading supports 8 and 16-bit integers and floats, RGB, RGBA, one channel of alpha, depth, and tiles of any position
/// and size, run-length encoded or not. An image with depth is returned in floats, with colours as fractions, and then
/// "Z" as it is stored. Writing supports 8 and 16 bits, RGB and RGBA. Floats are written only with a last channel "Z",
/// and colours then have 16 bits. `compression` is "rle" (the default) or "none". `Artist` and `DateTime` are kept.
///
/// Tiles of 16-bit RGBA are run-length encoded only where both bytes of every alpha are the same. Some programs store
/// the two planes of alpha in another order than the rest, so that others would be misread.
#[derive(Clone, Copy, Debug, Default)]
pub struct IffFormat;

/// The side of the written tiles, in pixels.
const TILE: usize = 64;
/// The flags of the header.
const RGB: u32 = 1;
const ALPHA: u32 = 2;
const DEPTH: u32 = 4;

impl Format for IffFormat {
    fn name(&self) -> &'static str {
        "iff"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["iff", "tdi"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        matches!(head, [b'F', b'O', b'R', b'4' | b'M', _, _, _, _, b'C', b'I', b'M', b'G', ..])
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        let source = FileSource::open(path, "Maya IFF", &limits.files)?;
        let (spec, rows) = read_chunks(&source, limits)?;
        Ok(Box::new(RowsInput::new("iff", "Maya IFF", source, limits, vec![vec![spec]], rows)?))
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "u16" | "alpha")
    }

    fn has_fixed_levels(&self) -> bool {
        true
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        let spec = options.spec;
        let n = spec.nchannels();
        let depth = spec.channels.last().is_some_and(|c| c == "Z");
        let fits = match spec.pixel_type {
            PixelType::U8 | PixelType::U16 => matches!(n, 3 | 4) && !depth,
            PixelType::Float => matches!(n, 4 | 5) && depth,
            PixelType::U32 | PixelType::Half => false,
        };
        let side = spec.width.max(spec.height);
        let fault = if !fits {
            let names = spec.channels.join(" ");
            format!(
                "Maya IFF holds RGB or RGBA of 8 or 16 bits, or floats with a last channel Z, not {:?} of {names}",
                spec.pixel_type
            )
        } else if side > 1 << 16 {
            format!("Maya IFF holds sides of up to 65536, not {side}")
        } else if !matches!(spec.string("compression"), None | Some("rle" | "none")) {
            let word = spec.string("compression").unwrap_or_default();
            format!("Maya IFF compression \"{word}\" is not supported")
        } else {
            return Ok(Box::new(WholeOutput::create(path, options, encode)?));
        };
        Err(ImageError::Unsupported { path: path.to_owned(), what: fault })
    }
}

/// A tile of the file.
#[derive(Clone, Copy, Debug)]
struct Tile {
    depth: bool,
    /// The column and row of the lower left pixel. Rows count from the bottom.
    at: (u32, u32),
    size: (u32, u32),
    /// The offset and the length of its data.
    place: (u64, u64),
}

struct IffRows {
    tiles: Vec<Tile>,
    /// The type of the colours, and the number of their channels.
    stored: PixelType,
    colors: usize,
    /// The number of rows that are decoded together, which is that of the highest tile.
    together: u32,
    /// The rows decoded last, with the index of the first of them, because rows are often read one by one.
    last: Mutex<Option<(u32, Arc<Pixels>)>>,
}

/// The head of a chunk.
struct Chunk {
    /// The offset of the head in the file.
    at: u64,
    mark: [u8; 4],
    /// The number of bytes after the head.
    size: u64,
}

impl Chunk {
    fn read(source: &FileSource, at: u64) -> Result<Self> {
        let b = source.read_vec(at, 8, "a chunk")?;
        let size = u64::from(u32::from_be_bytes([b[4], b[5], b[6], b[7]]));
        Ok(Self { at, mark: [b[0], b[1], b[2], b[3]], size })
    }

    /// Returns the offset of the bytes after the head.
    fn body(&self) -> u64 {
        self.at + 8
    }
}

/// The content of the chunks of a file.
struct Chunks {
    /// The image without its channels.
    header: Option<ImageSpec>,
    /// The flags of the header.
    flags: u32,
    /// The type of the colours.
    stored: PixelType,
    tiles: Vec<Tile>,
}

/// Reads the heads of all chunks.
fn read_chunks(source: &FileSource, limits: &Limits) -> Result<(ImageSpec, IffRows)> {
    let head = source.read_vec(0, 12, "the header")?;
    if !IffFormat.recognizes(&head) {
        return Err(source.malformed("it does not begin like one"));
    }
    let mut chunks = Chunks { header: None, flags: 0, stored: PixelType::U8, tiles: Vec::new() };
    // The first chunk begins after the mark, the size and the kind of the file.
    let mut at: u64 = 12;
    while at + 8 <= source.len() {
        let chunk = Chunk::read(source, at)?;
        match &chunk.mark {
            b"TBHD" => chunks.read_header(source, &chunk)?,
            b"AUTH" => chunks.read_text(source, &chunk, "Artist")?,
            b"DATE" => chunks.read_text(source, &chunk, "DateTime")?,
            // The chunk is a group, whose own chunks follow after its kind.
            b"FOR4" | b"FORM" => {
                at = chunk.body() + 4;
                continue;
            }
            b"RGBA" | b"ZBUF" => chunks.read_tile(source, &chunk, limits)?,
            _ => {}
        }
        at = chunk.body() + chunk.size.next_multiple_of(4);
    }
    chunks.finish(source)
}

impl Chunks {
    fn read_header(&mut self, source: &FileSource, chunk: &Chunk) -> Result<()> {
        if self.header.is_some() {
            // The tiles before it were checked against the first one.
            return Err(source.malformed(format!("there is a second header at byte {}", chunk.at)));
        }
        let b = source.read_vec(chunk.body(), 24, "the header of the image")?;
        let long = |i: usize| u32::from_be_bytes([b[i], b[i + 1], b[i + 2], b[i + 3]]);
        self.flags = long(12);
        self.stored = match u16::from_be_bytes([b[16], b[17]]) {
            0 => PixelType::U8,
            1 => PixelType::U16,
            3 => PixelType::Float,
            n => return Err(source.unsupported(format!("Maya IFF of type {n} is not supported"))),
        };
        if long(20) > 1 {
            let what = format!("Maya IFF compression number {} is not supported", long(20));
            return Err(source.unsupported(what));
        }
        let pixel_type = if self.flags & DEPTH == 0 { self.stored } else { PixelType::Float };
        let mut spec = ImageSpec::new(long(0), long(4), 1, pixel_type);
        let compression = if long(20) == 1 { "rle" } else { "none" };
        spec.attributes.set(word("compression", compression));
        self.header = Some(spec);
        Ok(())
    }

    /// Reads a text, which becomes an attribute of this name.
    fn read_text(&mut self, source: &FileSource, chunk: &Chunk, name: &str) -> Result<()> {
        let text = source.read_vec(chunk.body(), chunk.size.min(1 << 12), "a text")?;
        let text = text.split(|b| *b == 0).next().unwrap_or_default();
        if let Some(spec) = &mut self.header {
            spec.attributes.set(word(name, &String::from_utf8_lossy(text)));
        }
        Ok(())
    }

    fn read_tile(&mut self, source: &FileSource, chunk: &Chunk, limits: &Limits) -> Result<()> {
        let Chunk { at, mark, size } = chunk;
        let b = source.read_vec(chunk.body(), 8, "a tile")?;
        let short = |i: usize| u32::from(u16::from_be_bytes([b[i], b[i + 1]]));
        let (x0, y0, x1, y1) = (short(0), short(2), short(4), short(6));
        let inside = self.header.as_ref().is_some_and(|s| x1 < s.width && y1 < s.height);
        if x0 > x1 || y0 > y1 || !inside || *size < 8 {
            let what = format!("the tile at byte {at} is {size} bytes at {x0} {y0} to {x1} {y1}");
            return Err(source.malformed(what));
        }
        limits.within(source.path(), "number of tiles", self.tiles.len() as u64, 1 << 24)?;
        self.tiles.push(Tile {
            depth: mark[0] == b'Z',
            at: (x0, y0),
            size: (x1 - x0 + 1, y1 - y0 + 1),
            place: (chunk.body() + 8, size - 8),
        });
        Ok(())
    }

    /// Returns the image and its rows.
    fn finish(self, source: &FileSource) -> Result<(ImageSpec, IffRows)> {
        let Self { header, flags, stored, tiles } = self;
        let Some(mut spec) = header else { return Err(source.malformed("there is no image in it")) };
        let names: &[&str] = match (flags & RGB != 0, flags & ALPHA != 0) {
            (true, true) => &["R", "G", "B", "A"],
            (true, false) => &["R", "G", "B"],
            (false, true) => &["A"],
            (false, false) => &[],
        };
        spec.channels = names.iter().map(|s| (*s).to_owned()).collect();
        if flags & DEPTH != 0 {
            spec.channels.push("Z".to_owned());
        }
        // Tiles that overlap would be decoded needlessly, as often as the file contains them.
        let area = |(width, height): (u32, u32)| u64::from(width) * u64::from(height);
        let (held, most) =
            (tiles.iter().map(|t| area(t.size)).sum::<u64>(), 4 * area((spec.width, spec.height)));
        if held > most {
            let what = format!("its tiles hold {held} pixels, of which the image has at most {most}");
            return Err(source.malformed(what));
        }
        let together = tiles.iter().map(|t| t.size.1).max().unwrap_or(0).max(TILE as u32);
        Ok((spec, IffRows { tiles, stored, colors: names.len(), together, last: Mutex::new(None) }))
    }
}

fn word(name: &str, value: &str) -> Param {
    Param { name: name.into(), ty: ParamType::of(BaseType::String), data: value.into() }
}

impl Rows for IffRows {
    fn rows(
        &self,
        source: &FileSource,
        spec: &ImageSpec,
        _at: (usize, usize),
        y0: u32,
        y1: u32,
    ) -> Result<Pixels> {
        let values = spec.width as usize * spec.nchannels();
        let cut = |first: u32, held: &Pixels| {
            let mut out = Pixels::zeros(spec.pixel_type, (y1 - y0) as usize * values);
            let n = out.len();
            out.copy_from(0, held, (y0 - first) as usize * values, n);
            out
        };
        // The value is replaced as a whole, so it is consistent even after a panic in another thread.
        let last = || self.last.lock();
        if let Some((first, held)) = &*last()
            && *first <= y0
            && (y1 - first) as usize * values <= held.len()
        {
            return Ok(cut(*first, held));
        }
        // Few rows are extended to whole rows of tiles, which count from the bottom. Many rows are not held.
        let tile = self.together;
        let keep = y1 - y0 < tile;
        let (mut top, mut bottom) = (y0, y1);
        if keep {
            top = spec.height - (spec.height - y0).next_multiple_of(tile).min(spec.height);
            bottom = spec.height - (spec.height - y1) / tile * tile;
        }
        let bytes = u64::from(bottom - top) * (values * spec.pixel_type.bytes()) as u64;
        Limits::check_memory(source.path(), bytes.saturating_mul(3))?;
        let mut band = Pixels::zeros(spec.pixel_type, (bottom - top) as usize * values);
        for tile in &self.tiles {
            // The range of rows of the tile, from the top of the image.
            let (first, end) = (spec.height - tile.at.1 - tile.size.1, spec.height - tile.at.1);
            if end <= top || first >= bottom {
                continue;
            }
            let (count, pixel_type) =
                if tile.depth { (1, PixelType::Float) } else { (self.colors, self.stored) };
            let channel = if tile.depth { self.colors } else { 0 };
            if count == 0 || channel + count > spec.nchannels() {
                continue;
            }
            let pixels = decode_tile(source, tile, count, pixel_type)?.converted(spec.pixel_type);
            let width = tile.size.0 as usize;
            for y in first.max(top)..end.min(bottom) {
                let from = (end - 1 - y) as usize * width * count;
                let to = (y - top) as usize * values + tile.at.0 as usize * spec.nchannels() + channel;
                let n = spec.nchannels();
                // A run contains all channels of a row where the tile has all channels.
                let (run, runs) = if count == n { (width * n, 1) } else { (count, width) };
                for x in 0..runs {
                    band.copy_from(to + x * n, &pixels, from + x * count, run);
                }
            }
        }
        if !keep {
            return Ok(band);
        }
        let band = Arc::new(band);
        *last() = Some((top, band.clone()));
        Ok(cut(top, &band))
    }

    fn working_bytes(&self, spec: &ImageSpec) -> u64 {
        spec.decoding_bytes(self.together)
    }
}

/// Returns the pixels of a tile, with rows from the bottom and channels in the usual order.
fn decode_tile(source: &FileSource, tile: &Tile, count: usize, pixel_type: PixelType) -> Result<Pixels> {
    let pixels = tile.size.0 as usize * tile.size.1 as usize;
    let size = pixel_type.bytes();
    let whole = pixels * count * size;
    let (at, len) = tile.place;
    // A run of 128 takes two bytes.
    if len.saturating_mul(64) < whole as u64 {
        return Err(source.malformed(format!("the tile at byte {at} has {len} bytes for {whole}")));
    }
    let data = source.read_vec(at, len.min(whole as u64), "a tile")?;
    let mut big_endian = vec![0; whole];
    if len >= whole as u64 {
        // The channels are stored from the last to the first.
        for (to, from) in big_endian.chunks_exact_mut(count * size).zip(data.chunks_exact(count * size)) {
            for c in 0..count {
                to[c * size..][..size].copy_from_slice(&from[(count - 1 - c) * size..][..size]);
            }
        }
    } else {
        // The data has planes of bytes. The most significant bytes of all channels are first, with channels from the
        // last to the first.
        let mut rest = data.as_slice();
        for byte in 0..size {
            for c in (0..count).rev() {
                let first = c * size + byte;
                rest = unpack(rest, &mut big_endian[first..], count * size, pixels).ok_or_else(|| {
                    source.malformed(format!("the tile at byte {at} ends before its {pixels} pixels"))
                })?;
            }
        }
    }
    Ok(Pixels::from_bytes(pixel_type, big_endian, true))
}

/// Fills every `step`-th byte of `out` with `count` bytes. Returns the data after them.
fn unpack<'a>(mut data: &'a [u8], out: &mut [u8], step: usize, count: usize) -> Option<&'a [u8]> {
    let mut done = 0;
    while done < count {
        let (&code, rest) = data.split_first()?;
        let n = (usize::from(code & 0x7f) + 1).min(count - done);
        let places = out[done * step..].iter_mut().step_by(step).take(n);
        if code & 0x80 != 0 {
            let (&value, rest) = rest.split_first()?;
            places.for_each(|p| *p = value);
            data = rest;
        } else {
            places.zip(rest.get(..n)?).for_each(|(p, v)| *p = *v);
            data = &rest[n..];
        }
        done += n;
    }
    Some(data)
}

/// Does the inverse of [`unpack`], without a step.
fn pack(plane: &[u8], out: &mut Vec<u8>) {
    let same = |from: usize| plane[from..].iter().take(128).take_while(|v| **v == plane[from]).count();
    let mut at = 0;
    while at < plane.len() {
        let mut n = same(at);
        if n >= 3 {
            out.extend([0x80 | (n - 1) as u8, plane[at]]);
            at += n;
            continue;
        }
        while at + n < plane.len() && n < 128 && same(at + n) < 3 {
            n += 1;
        }
        out.push((n - 1) as u8);
        out.extend_from_slice(&plane[at..at + n]);
        at += n;
    }
}

/// Returns the data of a tile of big-endian values, with `count` channels of `size` bytes.
fn encode_tile(big_endian: &[u8], count: usize, size: usize, rle: bool) -> Vec<u8> {
    let pixel = count * size;
    // The documentation of [`IffFormat`] describes the reason.
    let ambiguous = size == 2 && count == 4 && big_endian.chunks_exact(8).any(|p| p[6] != p[7]);
    if rle && !ambiguous {
        let mut out = Vec::new();
        for byte in 0..size {
            for c in (0..count).rev() {
                let plane: Vec<u8> =
                    big_endian.iter().skip(c * size + byte).step_by(pixel).copied().collect();
                pack(&plane, &mut out);
            }
        }
        // Padding must not make the data look unpacked.
        if out.len().next_multiple_of(4) < big_endian.len() {
            return out;
        }
    }
    let mut out = Vec::with_capacity(big_endian.len());
    for p in big_endian.chunks_exact(pixel) {
        (0..count).rev().for_each(|c| out.extend_from_slice(&p[c * size..][..size]));
    }
    out
}

fn chunk(mark: &[u8; 4], body: &[u8], out: &mut Vec<u8>) {
    out.extend(mark);
    out.extend((body.len() as u32).to_be_bytes());
    out.extend_from_slice(body);
    out.resize(out.len().next_multiple_of(4), 0);
}

fn encode(spec: &ImageSpec, pixels: Pixels, file: &mut AtomicFile) -> Result<()> {
    let n = spec.nchannels();
    let depth = spec.pixel_type == PixelType::Float;
    let colors = if depth { n - 1 } else { n };
    let rle = spec.string("compression") != Some("none");
    let (width, height) = (spec.width as usize, spec.height as usize);
    let (across, down) = (width.div_ceil(TILE), height.div_ceil(TILE));
    let size = if spec.pixel_type == PixelType::U8 { 1 } else { 2 };
    let mut head = Vec::new();
    head.extend(spec.width.to_be_bytes());
    head.extend(spec.height.to_be_bytes());
    head.extend([0, 1, 0, 1]);
    let flags = RGB | if colors == 4 { ALPHA } else { 0 } | if depth { DEPTH } else { 0 };
    head.extend(flags.to_be_bytes());
    head.extend([0, size as u8 - 1]);
    // A larger number of tiles is not stored, because readers use the chunks.
    head.extend((u16::try_from(across * down).unwrap_or(u16::MAX)).to_be_bytes());
    head.extend(u32::from(rle).to_be_bytes());
    head.extend([0; 8]);
    let mut group = b"CIMG".to_vec();
    chunk(b"TBHD", &head, &mut group);
    for (mark, name) in [(b"AUTH", "Artist"), (b"DATE", "DateTime")] {
        let given = spec.attributes.iter().rev().find(|p| p.name.eq_ignore_ascii_case(name));
        if let Some(text) = given.and_then(|p| spec.string(&p.name)).filter(|t| !t.is_empty()) {
            chunk(mark, &text.as_bytes()[..text.len().min(4096)], &mut group);
        }
    }
    let mut tiles = b"TBMP".to_vec();
    for ty in 0..down {
        for tx in 0..across {
            let (x0, y0) = (tx * TILE, ty * TILE);
            let (x1, y1) = ((x0 + TILE).min(width), (y0 + TILE).min(height));
            let mut body = Vec::new();
            for v in [x0, y0, x1 - 1, y1 - 1] {
                body.extend((v as u16).to_be_bytes());
            }
            let (mut values, mut depths) = (Vec::new(), Vec::new());
            for y in y0..y1 {
                for x in x0..x1 {
                    let at = ((height - 1 - y) * width + x) * n;
                    for c in 0..colors {
                        match &pixels {
                            Pixels::U8(v) => values.push(v[at + c]),
                            Pixels::U16(v) => values.extend(v[at + c].to_be_bytes()),
                            other => {
                                let v = (other.get(at + c) * 65535.0).round() as u16;
                                values.extend(v.to_be_bytes());
                            }
                        }
                    }
                    if depth {
                        depths.extend(pixels.get(at + colors).to_be_bytes());
                    }
                }
            }
            let corner = body.clone();
            body.extend(encode_tile(&values, colors, size, rle));
            chunk(b"RGBA", &body, &mut tiles);
            if depth {
                let mut body = corner;
                body.extend(encode_tile(&depths, 1, 4, rle));
                chunk(b"ZBUF", &body, &mut tiles);
            }
        }
    }
    chunk(b"FOR4", &tiles, &mut group);
    let mut bytes = Vec::new();
    if u32::try_from(group.len()).is_err() {
        return Err(ImageError::Limit {
            path: file.path().to_owned(),
            what: "size of a Maya IFF file",
            asked: group.len() as u64,
            max: u64::from(u32::MAX),
        });
    }
    chunk(b"FOR4", &group, &mut bytes);
    file.write_all(&bytes).map_err(|e| file.io_error(e).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn unpacking_restores_packed_planes(v in prop::collection::vec(0u8..3, 1..600), step in 1usize..5) {
            let mut packed = Vec::new();
            pack(&v, &mut packed);
            packed.push(9);
            let mut out = vec![0; v.len() * step];
            prop_assert_eq!(unpack(&packed, &mut out, step, v.len()), Some(&[9][..]));
            let got: Vec<u8> = out.iter().step_by(step).copied().collect();
            prop_assert_eq!(&got, &v);
            prop_assert_eq!(unpack(&packed[..packed.len() - 3], &mut out, step, v.len()), None);
        }
    }
}
