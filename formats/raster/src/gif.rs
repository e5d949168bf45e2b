//! The size of the first image of a GIF, which may differ from that of its screen.

use crate::whole::Place;
use granita_image::Result;
use std::io::{self, Read};

/// Checks the memory for decoding the first image beside the screen. It is compared with the length of the file, of
/// which one byte represents at most `ratio` bytes of pixels, and with the memory that the system grants. A file
/// without an image is left to the decoder.
///
/// # Errors
/// Returns an error for an image that is too large, and errors of reading the file.
pub(crate) fn check_first_image(place: &Place, ratio: u64) -> Result<()> {
    let found = match first_image(&mut place.source()?) {
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => None,
        found => found.map_err(|e| place.io(e))?,
    };
    let Some([width, height]) = found else { return Ok(()) };
    let bytes = u64::from(width) * u64::from(height) * 4;
    place.limits.check_ratio(&place.path, place.format, (bytes, place.len()?), ratio)?;
    granita_image::Limits::check_memory(&place.path, bytes)
}

/// The width and height in pixels; `None` when another block comes first.
fn first_image(file: &mut impl Read) -> io::Result<Option<[u16; 2]>> {
    let mut head = [0; 13];
    file.read_exact(&mut head)?;
    if head[10] & 0x80 != 0 {
        // The bytes are the palette of the screen.
        skip(file, 3 << ((head[10] & 7) + 1))?;
    }
    loop {
        match byte(file)? {
            // An extension is its label, and then blocks of which the last one is empty.
            0x21 => {
                byte(file)?;
                while let length @ 1.. = byte(file)? {
                    skip(file, length.into())?;
                }
            }
            0x2c => {
                let mut image = [0; 8];
                file.read_exact(&mut image)?;
                let [_, _, _, _, w0, w1, h0, h1] = image;
                return Ok(Some([[w0, w1], [h0, h1]].map(u16::from_le_bytes)));
            }
            _ => return Ok(None),
        }
    }
}

fn byte(file: &mut impl Read) -> io::Result<u8> {
    let mut one = [0];
    file.read_exact(&mut one)?;
    Ok(one[0])
}

fn skip(file: &mut impl Read, bytes: u64) -> io::Result<()> {
    match io::copy(&mut file.take(bytes), &mut io::sink())? {
        n if n == bytes => Ok(()),
        _ => Err(io::ErrorKind::UnexpectedEof.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::first_image;

    #[test]
    fn gif_images_are_found_after_palettes_and_extensions() {
        let screen = |flags: u8| [b"GIF89a\x20\0\x18\0" as &[u8], &[flags, 0, 0]].concat();
        let image: &[u8] = b",\x01\0\x02\0\x34\x12\x78\x56\0";
        let extension: &[u8] = b"!\xff\x03abc\x01d\0";
        for file in [
            [&screen(0)[..], image].concat(),
            [&screen(0x81)[..], &[7; 12], extension, extension, image].concat(),
        ] {
            assert_eq!(first_image(&mut &file[..]).unwrap(), Some([0x1234, 0x5678]));
            assert!(first_image(&mut &file[..file.len() - 3]).is_err());
        }
        assert_eq!(first_image(&mut &[&screen(0)[..], b";"].concat()[..]).unwrap(), None);
    }
}
