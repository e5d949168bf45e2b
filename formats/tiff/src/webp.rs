//! Decodes strips and tiles that are WebP images.

use granita_image::contained;
use image_webp::WebPDecoder;
use std::io::Cursor;

/// Fills `out` with `size` pixels of `samples` values from `data`. An image without alpha becomes opaque where four
/// values are needed. `Err` describes the error in the data.
pub(crate) fn decode(
    data: &[u8],
    out: &mut [u8],
    size: (usize, usize),
    samples: usize,
) -> Result<(), String> {
    contained(|| decode_image(data, out, size, samples))?
}

fn decode_image(
    data: &[u8],
    out: &mut [u8],
    (width, height): (usize, usize),
    samples: usize,
) -> Result<(), String> {
    let fault = |e: image_webp::DecodingError| format!("WebP data: {e}");
    let mut decoder = WebPDecoder::new(Cursor::new(data)).map_err(fault)?;
    let (w, h) = decoder.dimensions();
    let n = if decoder.has_alpha() { 4 } else { 3 };
    // The size is declared by the header of the data, and the decoder allocates memory for it.
    if (w as usize, h as usize) != (width, height) || n > samples || samples > 4 {
        return Err(format!(
            "a WebP image of {w} x {h} pixels with {n} channels where {width} x {height} with {samples} are needed"
        ));
    }
    if n == samples {
        return decoder.read_image(out).map_err(fault);
    }
    let mut opaque = vec![0; width * height * n];
    decoder.read_image(&mut opaque).map_err(fault)?;
    for (to, from) in out.chunks_exact_mut(4).zip(opaque.chunks_exact(3)) {
        to[..3].copy_from_slice(from);
        to[3] = 255;
    }
    Ok(())
}
