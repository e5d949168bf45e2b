//! SGI images (Paul Haeberli, "The SGI Image File Format", version 1.00), which are planes of rows from the bottom.

use crate::rows::{Rows, RowsInput};
use crate::whole::WholeOutput;
use granita_base::{BaseType, Param, ParamType};
use granita_image::{
    AtomicFile, CreateOptions, FileSource, Format, ImageError, ImageInput, ImageOutput, ImageSpec, Limits,
    PixelType, Pixels, Result,
};
use std::io::Write;
use std::path::Path;

/// The format "sgi", with 8 and 16 bits and any number of channels, run-length encoded or verbatim.
///
/// The attribute `compression` is "rle" (the default) or "none". Up to 79 bytes of `ImageDescription` are kept as the
/// name of the image.
#[derive(Clone, Copy, Debug, Default)]
pub struct SgiFormat;

/// The number of bytes before the pixels or the tables of rows.
const HEADER: usize = 512;

impl Format for SgiFormat {
    fn name(&self) -> &'static str {
        "sgi"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["sgi", "rgb", "rgba", "bw", "int", "inta"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        matches!(head, [0x01, 0xda, 0 | 1, 1 | 2, ..])
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        let source = FileSource::open(path, "SGI", &limits.files)?;
        let (spec, rows) = read_header(&source, limits)?;
        Ok(Box::new(RowsInput::new("sgi", "SGI", source, limits, vec![vec![spec]], rows)?))
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "u16" | "alpha" | "channels")
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        let spec = options.spec;
        let side = spec.width.max(spec.height).max(spec.nchannels() as u32);
        let fault = if !matches!(spec.pixel_type, PixelType::U8 | PixelType::U16) {
            format!("SGI holds 8 or 16-bit integers, not {:?}", spec.pixel_type)
        } else if side > u32::from(u16::MAX) {
            format!("SGI holds sides of up to 65535, not {side}")
        } else if !matches!(spec.string("compression"), None | Some("rle" | "none")) {
            format!("SGI compression \"{}\" is not supported", spec.string("compression").unwrap_or_default())
        } else {
            return Ok(Box::new(WholeOutput::create(path, options, encode)?));
        };
        Err(ImageError::Unsupported { path: path.to_owned(), what: fault })
    }
}

/// The offset and length in bytes of every row, plane after plane, each from the bottom; `None` in a verbatim file.
struct SgiRows(Option<Vec<[u32; 2]>>);

fn read_header(source: &FileSource, limits: &Limits) -> Result<(ImageSpec, SgiRows)> {
    let head = source.read_vec(0, HEADER as u64, "the header")?;
    let short = |at: usize| u32::from(u16::from_be_bytes([head[at], head[at + 1]]));
    if !SgiFormat.recognizes(&head) {
        return Err(source.malformed("it does not begin like one"));
    }
    let (rle, pixel_type) = (head[2] == 1, if head[3] == 1 { PixelType::U8 } else { PixelType::U16 });
    let (width, mut height, mut planes) = (short(6), short(8), short(10));
    match short(4) {
        1 => (height, planes) = (1, 1),
        2 => planes = 1,
        3 => {}
        n => return Err(source.malformed(format!("an image of {n} dimensions"))),
    }
    let map = u32::from_be_bytes([head[104], head[105], head[106], head[107]]);
    if map != 0 {
        return Err(source.unsupported(format!("SGI with colour map {map} is not supported")));
    }
    limits.within(source.path(), "number of channels", u64::from(planes), u64::from(limits.channels))?;
    let mut spec = ImageSpec::new(width, height, planes as usize, pixel_type);
    let word = |name: &str, value: &str| Param {
        name: name.into(),
        ty: ParamType::of(BaseType::String),
        data: value.into(),
    };
    spec.attributes.set(word("compression", if rle { "rle" } else { "none" }));
    let name = head[24..104].split(|b| *b == 0).next().unwrap_or_default();
    if !name.is_empty() {
        spec.attributes.set(word("ImageDescription", &String::from_utf8_lossy(name)));
    }
    if !rle {
        return Ok((spec, SgiRows(None)));
    }
    let rows = u64::from(height) * u64::from(planes);
    let bytes = source.read_vec(HEADER as u64, rows * 8, "the table of rows")?;
    let longs: Vec<u32> = bytes.as_chunks::<4>().0.iter().map(|b| u32::from_be_bytes(*b)).collect();
    let (starts, lengths) = longs.split_at(rows as usize);
    let table = starts.iter().zip(lengths).map(|(s, l)| [*s, *l]).collect();
    Ok((spec, SgiRows(Some(table))))
}

impl Rows for SgiRows {
    fn rows(
        &self,
        source: &FileSource,
        spec: &ImageSpec,
        _at: (usize, usize),
        y0: u32,
        y1: u32,
    ) -> Result<Pixels> {
        let (width, n) = (spec.width as usize, spec.nchannels());
        let rows = (y1 - y0) as usize;
        let mut out = Pixels::zeros(spec.pixel_type, width * rows * n);
        let bytes_per_row = (width * spec.pixel_type.bytes()) as u64;
        for plane in 0..n {
            let mut values = Pixels::zeros(spec.pixel_type, width * rows);
            let from_bottom = |y: u32| plane * spec.height as usize + (spec.height - 1 - y) as usize;
            for y in y0..y1 {
                let row = match &self.0 {
                    None => {
                        let at = HEADER as u64 + from_bottom(y) as u64 * bytes_per_row;
                        let bytes = source.read_vec(at, bytes_per_row, "a row")?;
                        Pixels::from_bytes(spec.pixel_type, bytes, true)
                    }
                    Some(table) => {
                        let [start, length] = table[from_bottom(y)];
                        // The longest encoding of a row has a count for every value, and the end.
                        let longest = bytes_per_row * 2 + 4;
                        let length = u64::from(length).min(longest);
                        let packed = source.read_vec(u64::from(start), length, "a row")?;
                        unpack(packed, spec.pixel_type, width).ok_or_else(|| {
                            source.malformed(format!("row {y} of channel {plane} is not {width} values"))
                        })?
                    }
                };
                values.copy_from((y - y0) as usize * width, &row, 0, width);
            }
            out.set_plane(plane, n, &values);
        }
        Ok(out)
    }
}

/// Decodes a run-length encoded row of `width` values. The low seven bits of a value are the number of values that
/// follow (high bit set), or of repetitions of the one that follows. A count of 0 ends the row.
fn unpack(packed: Vec<u8>, pixel_type: PixelType, width: usize) -> Option<Pixels> {
    fn run<T: Copy + Into<u32>>(packed: &[T], width: usize) -> Option<Vec<T>> {
        let mut out = Vec::with_capacity(width);
        let mut rest = packed.iter();
        while let Some(&code) = rest.next() {
            let code: u32 = code.into();
            let count = (code & 0x7f) as usize;
            if count == 0 || out.len() + count > width {
                break;
            }
            if code & 0x80 != 0 {
                out.extend(rest.as_slice().get(..count)?);
                rest = rest.as_slice()[count..].iter();
            } else {
                let value = *rest.next()?;
                out.resize(out.len() + count, value);
            }
        }
        (out.len() == width).then_some(out)
    }
    Some(match Pixels::from_bytes(pixel_type, packed, true) {
        Pixels::U16(v) => Pixels::U16(run(&v, width)?),
        Pixels::U8(v) => Pixels::U8(run(&v, width)?),
        // The header permits no other type.
        _ => return None,
    })
}

/// Does the inverse of [`unpack`], and returns big-endian bytes.
fn pack(row: &Pixels) -> Vec<u8> {
    fn run<T: Copy + PartialEq + From<u8>>(row: &[T]) -> Vec<T> {
        let same = |from: usize| row[from..].iter().take(127).take_while(|v| **v == row[from]).count();
        let mut out: Vec<T> = Vec::new();
        let mut at = 0;
        while at < row.len() {
            let mut n = same(at);
            if n >= 3 {
                out.extend([T::from(n as u8), row[at]]);
                at += n;
                continue;
            }
            while at + n < row.len() && n < 127 && same(at + n) < 3 {
                n += 1;
            }
            out.push(T::from(0x80 | n as u8));
            out.extend_from_slice(&row[at..at + n]);
            at += n;
        }
        out.push(T::from(0));
        out
    }
    match row {
        Pixels::U8(v) => run(v),
        Pixels::U16(v) => run(v).iter().flat_map(|v| v.to_be_bytes()).collect(),
        // `create` refuses other types.
        _ => Vec::new(),
    }
}

fn encode(spec: &ImageSpec, pixels: Pixels, file: &mut AtomicFile) -> Result<()> {
    let (width, height, n) = (spec.width as usize, spec.height as usize, spec.nchannels());
    let rle = spec.string("compression") != Some("none");
    let bytes = spec.pixel_type.bytes();
    let mut head = vec![0x01, 0xda, u8::from(rle), bytes as u8];
    for v in [if n == 1 { 2 } else { 3 }, spec.width, spec.height, n as u32] {
        head.extend((v as u16).to_be_bytes());
    }
    head.extend(0u32.to_be_bytes());
    head.extend(if bytes == 1 { 255u32 } else { 65535 }.to_be_bytes());
    head.extend([0; 4]);
    let name = spec.attributes.iter().rev().find(|p| p.name.eq_ignore_ascii_case("ImageDescription"));
    let name = name.and_then(|p| spec.string(&p.name)).unwrap_or_default();
    // The name is cut at a whole character, with a NUL at the end.
    let end = (0..=79.min(name.len())).rev().find(|i| name.is_char_boundary(*i)).unwrap_or(0);
    head.extend(name.as_bytes()[..end].iter().map(|b| if *b == 0 { b' ' } else { *b }));
    head.resize(HEADER, 0);
    let row_of = |plane: &Pixels, y: usize| {
        let mut row = Pixels::zeros(spec.pixel_type, width);
        row.copy_from(0, plane, (height - 1 - y) * width, width);
        row
    };
    let mut body = Vec::new();
    let (mut starts, mut lengths) = (Vec::new(), Vec::new());
    let first = HEADER + if rle { height * n * 8 } else { 0 };
    for c in 0..n {
        let plane = pixels.plane(c, n);
        for y in 0..height {
            let row = row_of(&plane, y);
            let start = body.len();
            if rle {
                body.extend(pack(&row));
                let place = u32::try_from(first + start).map_err(|_| ImageError::Limit {
                    path: file.path().to_owned(),
                    what: "size of an SGI file",
                    asked: (first + start) as u64,
                    max: u64::from(u32::MAX),
                })?;
                starts.extend(place.to_be_bytes());
                lengths.extend(((body.len() - start) as u32).to_be_bytes());
            } else {
                match row {
                    Pixels::U16(v) => body.extend(v.iter().flat_map(|v| v.to_be_bytes())),
                    other => other.append_le_bytes(&mut body),
                }
            }
        }
    }
    [head, starts, lengths, body]
        .iter()
        .try_for_each(|part| file.write_all(part))
        .map_err(|e| file.io_error(e).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn unpacking_restores_packed_rows(v in prop::collection::vec(0u16..3, 1..400)) {
            let n = v.len();
            let row = Pixels::U16(v.clone());
            prop_assert_eq!(unpack(pack(&row), PixelType::U16, n), Some(row));
            let row = Pixels::U8(v.iter().map(|v| *v as u8).collect());
            prop_assert_eq!(unpack(pack(&row), PixelType::U8, n), Some(row));
        }
    }

    #[test]
    fn damaged_rows_are_refused() {
        assert_eq!(unpack(vec![3, 7, 0], PixelType::U8, 3), Some(Pixels::U8(vec![7; 3])));
        for (bad, width) in
            [(vec![4, 7, 0], 3), (vec![2, 7, 0], 3), (vec![0x83, 1, 2], 3), (vec![3], 3), (vec![], 1)]
        {
            assert_eq!(unpack(bad, PixelType::U8, width), None);
        }
    }
}
