//! Binary PGM, PPM and PAM of 8 and 16 bits, of which a range of rows can be read without the rest.

use crate::rows::{PlainRows, RowsInput, ends_early};
use granita_image::{FileSource, ImageInput, ImageSpec, Limits, PixelType, Result};

/// Opens a file whose rows can be found by position. Returns `None` for a file of another kind (text, one bit per
/// pixel, a maximum value other than 255 and 65535), or for a damaged one, for which the `image` crate returns the
/// error.
pub(crate) fn open(source: FileSource, limits: &Limits) -> Result<Option<Box<dyn ImageInput>>> {
    // Longer comments are left to the `image` crate.
    let head = source.read_vec(0, source.len().min(1024), "the header")?;
    let Some((spec, at)) = header(&head) else { return Ok(None) };
    let bytes = spec.bytes().and_then(|b| b.checked_add(at));
    if bytes.is_none_or(|end| end > source.len()) {
        // The file is refused before anything else, as too large or too short.
        limits.check(source.path(), "PNM", &spec)?;
        ends_early(&source, &spec, at)?;
    }
    let rows = PlainRows { at, big_endian: true, upward: false };
    Ok(Some(Box::new(RowsInput::new("pnm", "PNM", source, limits, vec![vec![spec]], rows)?)))
}

/// Returns the content of a header, and its end.
fn header(head: &[u8]) -> Option<(ImageSpec, u64)> {
    if head.starts_with(b"P7") {
        return arbitrary_map(head);
    }
    let channels = match head.get(..2)? {
        b"P5" => 1,
        b"P6" => 3,
        _ => return None,
    };
    let mut at = 2;
    let mut numbers = [0; 3];
    for number in &mut numbers {
        loop {
            match head.get(at)? {
                b'#' => at += head[at..].iter().position(|b| *b == b'\n')?,
                b if b.is_ascii_whitespace() => at += 1,
                _ => break,
            }
        }
        let digits = head[at..].iter().take_while(|b| b.is_ascii_digit()).count();
        *number = std::str::from_utf8(&head[at..at + digits]).ok()?.parse().ok()?;
        at += digits;
    }
    head.get(at).filter(|b| b.is_ascii_whitespace())?;
    spec(numbers, channels, at + 1)
}

fn arbitrary_map(head: &[u8]) -> Option<(ImageSpec, u64)> {
    let (mut numbers, mut channels) = ([0; 3], 0);
    let mut at = 0;
    loop {
        let end = at + head.get(at..)?.iter().position(|b| *b == b'\n')?;
        let line = std::str::from_utf8(&head[at..end]).ok()?;
        at = end + 1;
        let mut words = line.split_ascii_whitespace();
        let (key, value) = (words.next(), words.next());
        let number = || value?.parse::<u32>().ok();
        match key {
            Some("ENDHDR") => break,
            Some("WIDTH") => numbers[0] = number()?,
            Some("HEIGHT") => numbers[1] = number()?,
            Some("MAXVAL") => numbers[2] = number()?,
            Some("DEPTH") => channels = number()? as usize,
            Some("TUPLTYPE") if value.is_some_and(|v| v.starts_with("BLACKANDWHITE")) => return None,
            _ => {}
        }
    }
    if (1..=4).contains(&channels) { spec(numbers, channels, at) } else { None }
}

fn spec([width, height, max]: [u32; 3], channels: usize, at: usize) -> Option<(ImageSpec, u64)> {
    let pixel_type = match max {
        255 => PixelType::U8,
        65535 => PixelType::U16,
        _ => return None,
    };
    Some((ImageSpec::new(width, height, channels, pixel_type), at as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pnm_headers_are_parsed_or_refused() {
        let (spec, at) = header(b"P6 # a picture\n# of\n3 2\n65535\n....").unwrap();
        assert_eq!((spec.width, spec.height, spec.nchannels(), at), (3, 2, 3, 30));
        assert_eq!(spec.pixel_type, PixelType::U16);
        let (spec, at) = header(b"P7\nWIDTH 3\nHEIGHT 2\nDEPTH 4\nMAXVAL 255\nENDHDR\n").unwrap();
        assert_eq!((spec.width, spec.height, spec.nchannels(), at), (3, 2, 4, 46));
        for other in [&b"P5 3 2 15\n"[..], b"P4 3 2\n", b"P5 3 2", b"P5 x 2 255\n", b"P7\nWIDTH", b"P6"] {
            assert!(header(other).is_none());
        }
    }
}
