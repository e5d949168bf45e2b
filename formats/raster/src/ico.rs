//! Icons that are PNG images. Others are read by the `image` crate, which takes only PNG with alpha of 8 bits.

use crate::whole::Place;
use granita_image::Result;
use std::io::{Read, Seek, SeekFrom};

/// The number of bytes of an entry of the directory.
const ENTRY: usize = 16;

/// Returns the PNG file of the icon that the `image` crate selects: the one with the most bits, and of these the
/// largest. `None` when it is another kind of image, or not there.
pub(crate) fn png(place: &Place) -> Result<Option<Place>> {
    let mut file = place.source()?;
    let mut head = [0; 6];
    if file.read_exact(&mut head).is_err() {
        return Ok(None);
    }
    let count = usize::from(u16::from_le_bytes([head[4], head[5]]));
    let mut entries = vec![[0; ENTRY]; count];
    if file.read_exact(entries.as_flattened_mut()).is_err() {
        return Ok(None);
    }
    // A side of 256 is stored as 0.
    let side = |v: u8| if v == 0 { 256 } else { u32::from(v) };
    let score = |e: &[u8; ENTRY]| (u16::from_le_bytes([e[6], e[7]]), side(e[0]) * side(e[1]));
    // Of equal ones the last is taken.
    let Some(entry) = entries.iter().enumerate().max_by_key(|(i, e)| (score(e), *i)).map(|(_, e)| e) else {
        return Ok(None);
    };
    let long = |at: usize| u32::from_le_bytes([entry[at], entry[at + 1], entry[at + 2], entry[at + 3]]);
    let (len, at) = (u64::from(long(8)), u64::from(long(12)));
    let mut bytes = Vec::new();
    file.seek(SeekFrom::Start(at)).map_err(|e| place.io(e))?;
    file.take(len.min(place.limits.bytes)).read_to_end(&mut bytes).map_err(|e| place.io(e))?;
    Ok(bytes.starts_with(b"\x89PNG\r\n\x1a\n").then(|| place.holding(bytes)))
}
