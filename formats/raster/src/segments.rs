//! Segments of JPEG files that hold metadata: Exif, XMP, ICC profiles and IPTC.

use granita_image::ImageSpec;
use granita_image::metadata::{exif, iptc};

/// The largest number of bytes in a segment, without its length.
const MOST: usize = 65533;

/// Returns a JPEG file with the metadata of `spec`, from one without metadata. What does not fit a segment is left out.
pub(crate) fn with_metadata(file: &[u8], spec: &ImageSpec) -> Vec<u8> {
    let mut segments = Vec::new();
    let mut add = |kind: u8, parts: &[&[u8]]| {
        let content = parts.concat();
        if content.len() <= MOST {
            segments.extend([0xff, kind]);
            segments.extend((content.len() as u16 + 2).to_be_bytes());
            segments.extend(content);
        }
    };
    if let Some(exif) = exif::write(&spec.attributes, &[]) {
        add(0xe1, &[b"Exif\0\0", &exif]);
    }
    if let Some(xmp) = spec.string("XMP") {
        add(0xe1, &[b"http://ns.adobe.com/xap/1.0/\0", xmp.as_bytes()]);
    }
    if let Some(profile) = &spec.icc_profile {
        const MARK: &[u8] = b"ICC_PROFILE\0";
        let chunks = profile.chunks(MOST - MARK.len() - 2);
        // The number of chunks has 8 bits.
        if let Ok(count) = u8::try_from(chunks.len()) {
            for (number, chunk) in (1..=count).zip(chunks) {
                add(0xe2, &[MARK, &[number, count], chunk]);
            }
        }
    }
    if let Some(data) = iptc::write(&spec.attributes) {
        add(0xed, &[&iptc::as_resources(&data)]);
    }
    // They follow the mark of the beginning, and the segment of JFIF, which has to be the first one.
    let at = match file {
        [0xff, 0xd8, 0xff, 0xe0, a, b, ..] => 4 + usize::from(u16::from_be_bytes([*a, *b])),
        _ => 2,
    };
    let (front, rest) = file.split_at(at.min(file.len()));
    [front, &segments, rest].concat()
}
