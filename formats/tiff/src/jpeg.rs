//! Strips and tiles that are JPEG images (TIFF Technical Note 2).

use granita_image::contained;
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

/// Fills `out` with `size` pixels of `samples` values from `data`, which needs the quantization and Huffman tables in
/// `tables` unless it has its own. With `ycc`, colours are stored as luminance and differences, and are converted to
/// RGB. Others are not converted. `Err` describes the error in the data.
pub(crate) fn decode(
    tables: Option<&[u8]>,
    data: &[u8],
    out: &mut [u8],
    size: (usize, usize),
    samples: usize,
    ycc: bool,
) -> Result<(), String> {
    // The tables are an image without pixels. Its end mark is removed, and so is the start mark of the data.
    let stream = match tables {
        Some([front @ .., 0xff, 0xd9]) if data.starts_with(&[0xff, 0xd8]) => [front, &data[2..]].concat(),
        Some(_) => return Err("its tables or its beginning are not JPEG data".to_owned()),
        None => data.to_vec(),
    };
    contained(|| decode_stream(&stream, out, size, samples, ycc))?
}

fn decode_stream(
    stream: &[u8],
    out: &mut [u8],
    (width, height): (usize, usize),
    samples: usize,
    ycc: bool,
) -> Result<(), String> {
    let fault = |e: zune_jpeg::errors::DecodeErrors| format!("JPEG data: {e:?}");
    let limits = DecoderOptions::default().set_max_width(1 << 16).set_max_height(1 << 16);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(stream), limits);
    decoder.decode_headers().map_err(fault)?;
    let info = decoder.info().ok_or("JPEG data without an image")?;
    let (w, h, n) = (usize::from(info.width), usize::from(info.height), usize::from(info.components));
    // The last strip may be as high as the others.
    if w != width || h < height || n != samples || w * h * n > out.len().saturating_mul(64) {
        return Err(format!(
            "a JPEG of {w} x {h} pixels with {n} channels where {width} x {height} with {samples} are needed"
        ));
    }
    let stored = decoder.input_colorspace().unwrap_or(ColorSpace::Unknown);
    let wanted = if ycc && samples == 3 { ColorSpace::RGB } else { stored };
    decoder.set_options(limits.jpeg_set_out_colorspace(wanted));
    let pixels = decoder.decode().map_err(fault)?;
    match pixels.get(..out.len()) {
        Some(part) if pixels.len() == w * h * n => {
            out.copy_from_slice(part);
            Ok(())
        }
        _ => Err(format!("{} bytes in a JPEG of {w} x {h} x {n}", pixels.len())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_jpeg_data_is_refused() {
        let mut out = [0; 12];
        for data in [&b""[..], b"\xff\xd8", b"\xff\xd8\xff\xd9", b"\0\0\0\0\0\0"] {
            for tables in [None, Some(&b"\xff\xd8\xff\xd9"[..]), Some(b"x")] {
                assert!(decode(tables, data, &mut out, (2, 2), 3, true).is_err());
            }
        }
    }
}
