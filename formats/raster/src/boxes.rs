//! Boxes of the files of JPEG 2000 and JPEG XL (ISO/IEC 14496-12): a length, four characters that name a kind, and
//! content.

use crate::whole::{Place, Source};
use granita_image::Result;
use std::io::{Read, Seek, SeekFrom};

/// The largest number of boxes of a file that are searched.
const MOST: usize = 1000;

/// A box in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Found {
    pub(crate) kind: [u8; 4],
    /// The offset of its content.
    pub(crate) at: u64,
    /// The number of bytes of its content.
    pub(crate) len: u64,
}

/// Returns the boxes from `at` to `end` of a file. Damage ends the list.
pub(crate) fn list(file: &mut (impl Read + Seek), mut at: u64, end: u64) -> Vec<Found> {
    let mut found = Vec::new();
    while at < end && found.len() < MOST {
        let mut head = [0; 16];
        if file.seek(SeekFrom::Start(at)).is_err() || file.read_exact(&mut head[..8]).is_err() {
            break;
        }
        let short = u32::from_be_bytes([head[0], head[1], head[2], head[3]]);
        let (front, len) = match short {
            // The box is the rest.
            0 => (8, end - at),
            1 if file.read_exact(&mut head[8..]).is_ok() => {
                let [.., a, b, c, d, e, f, g, h] = head;
                (16, u64::from_be_bytes([a, b, c, d, e, f, g, h]))
            }
            len => (8, u64::from(len)),
        };
        if len < front || len > end - at {
            break;
        }
        found.push(Found { kind: [head[4], head[5], head[6], head[7]], at: at + front, len: len - front });
        at += len;
    }
    found
}

/// Returns the content of a box, if it has at most `most` bytes and all of them.
pub(crate) fn content(file: &mut (impl Read + Seek), found: &Found, most: u64) -> Option<Vec<u8>> {
    if found.len > most {
        return None;
    }
    let mut bytes = vec![0; found.len as usize];
    file.seek(SeekFrom::Start(found.at)).ok()?;
    file.read_exact(&mut bytes).ok()?;
    Some(bytes)
}

/// Opens a file and returns its boxes.
pub(crate) fn of_file(place: &Place) -> Result<(Source, Vec<Found>)> {
    let mut file = place.source()?;
    let found = list(&mut file, 0, place.len()?);
    Ok((file, found))
}

/// Returns a box.
pub(crate) fn written(kind: &[u8; 4], content: &[u8]) -> Vec<u8> {
    // Metadata that is written is much shorter than 4 GiB, and so is a file that is encoded in memory.
    [&(content.len() as u32 + 8).to_be_bytes()[..], kind, content].concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    #[test]
    fn boxes_have_their_content() {
        let long = [&[0, 0, 0, 1][..], b"long", &18_u64.to_be_bytes(), b"ab"].concat();
        let bytes = [written(b"one ", b"xyz"), long, [&[0; 4][..], b"lastc"].concat()].concat();
        let mut file = Cursor::new(&bytes);
        let all = list(&mut file, 0, bytes.len() as u64);
        let kinds: Vec<&[u8; 4]> = all.iter().map(|f| &f.kind).collect();
        assert_eq!(kinds, [b"one ", b"long", b"last"]);
        let contents: Vec<_> = all.iter().map(|f| content(&mut file, f, 10).unwrap()).collect();
        assert_eq!(contents, [&b"xyz"[..], b"ab", b"c"]);
        assert_eq!(content(&mut file, &all[0], 2), None);
        // A box that is longer than the file, or shorter than its beginning, ends the list.
        assert_eq!(list(&mut Cursor::new(&bytes[..20]), 0, 20).len(), 1);
        assert!(list(&mut Cursor::new(b"\0\0\0\x07abcdefgh"), 0, 12).is_empty());
    }
}
