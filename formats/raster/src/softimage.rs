//! Softimage PIC ("Softimage .PIC File Format"), which is read.

use crate::fields::{Field, Header, Kind, param};
use crate::whole::{Decoded, Place, WholeInput};
use granita_image::{Format, ImageInput, ImageSpec, Limits, PixelType, Pixels, Result};
use std::io::{ErrorKind, Read};
use std::path::Path;

/// The format "softimage", which is only read: RGB and RGBA of 8 and 16 bits.
#[derive(Clone, Copy, Debug, Default)]
pub struct SoftimageFormat;

/// The length of the header, which the descriptions of packets follow.
const HEADER: usize = 104;

impl Format for SoftimageFormat {
    fn name(&self) -> &'static str {
        "softimage"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["pic"]
    }

    fn recognizes(&self, head: &[u8]) -> bool {
        head.starts_with(&[0x53, 0x80, 0xf6, 0x34])
    }

    fn open(&self, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
        let place = Place::new(path, "Softimage PIC", limits);
        let (spec, _) = read_header(&place, &mut place.source()?)?;
        place.limits.check(path, place.format, &spec)?;
        // Each packet of a row takes at least two bytes. A file that ends early must have a sixteenth of them.
        let ratio = 16 * u64::from(spec.width) * (spec.nchannels() * spec.pixel_type.bytes()) as u64;
        Ok(Box::new(WholeInput::new("softimage", place, spec, decode, ratio)?))
    }
}

/// A part of each row: some channels in one encoding.
struct Packet {
    encoding: Encoding,
    /// The indices of the channels.
    channels: Vec<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    Verbatim,
    /// Each pixel has a count of repetitions.
    Runs,
    /// Runs, and pixels without repetition.
    MixedRuns,
}

fn read_header(place: &Place, file: &mut impl Read) -> Result<(ImageSpec, Vec<Packet>)> {
    let io = |e| place.io(e);
    let mut head = vec![0; HEADER];
    file.read_exact(&mut head).map_err(io)?;
    if !SoftimageFormat.recognizes(&head) || head[88..92] != *b"PICT" {
        return Err(place.malformed("it does not begin like one"));
    }
    let header = Header::new(head, true);
    let (width, height) = (header.short(92), header.short(94));
    let mut packets = Vec::new();
    let mut sizes = Vec::new();
    let mut all = 0;
    loop {
        let mut packet = [0; 4];
        file.read_exact(&mut packet).map_err(io)?;
        let [more, size, kind, mask] = packet;
        let encoding = match kind {
            0 => Encoding::Verbatim,
            1 => Encoding::Runs,
            2 => Encoding::MixedRuns,
            _ => return Err(place.unsupported(format!("Softimage PIC of type {kind:#x} is not supported"))),
        };
        if mask == 0 || mask & 0x0f != 0 || mask & all != 0 {
            return Err(place.malformed(format!("a packet of channels {mask:#x} after those of {all:#x}")));
        }
        all |= mask;
        sizes.push(size);
        // The highest bit is red.
        packets.push(Packet { encoding, channels: (0..4).filter(|c| mask & (0x80 >> c) != 0).collect() });
        if more == 0 {
            break;
        }
    }
    let pixel_type = match sizes[0] {
        8 => PixelType::U8,
        16 => PixelType::U16,
        bits => return Err(place.unsupported(format!("Softimage PIC of {bits} bits is not supported"))),
    };
    if sizes.iter().any(|size| *size != sizes[0]) {
        return Err(place.unsupported("Softimage PIC with channels of different sizes is not supported"));
    }
    let present: Vec<usize> = (0..4).filter(|c| all & (0x80 >> c) != 0).collect();
    let mut spec = ImageSpec::new(width.into(), height.into(), 1, pixel_type);
    spec.channels = present.iter().map(|c| ["R", "G", "B", "A"][*c].to_owned()).collect();
    for packet in &mut packets {
        packet.channels.iter_mut().for_each(|c| *c = present.iter().filter(|p| **p < *c).count());
    }
    header.read(&[Field::new("ImageDescription", 8, Kind::Text(80))], &mut spec.attributes);
    let aspect = f32::from_bits(header.long(96));
    if aspect.is_finite() && aspect > 0.0 && aspect != 1.0 {
        spec.attributes.set(param("pixelaspect", aspect.into()));
    }
    Ok((spec, packets))
}

fn decode(place: &Place, spec: &ImageSpec) -> Result<Decoded> {
    let mut file = place.source()?;
    let (again, packets) = read_header(place, &mut file)?;
    if again != *spec {
        return Err(place.malformed("the file changed while it was read"));
    }
    let (size, n) = (spec.pixel_type.bytes(), spec.nchannels());
    let row = spec.width as usize * n * size;
    let mut bytes = vec![0; row * spec.height as usize];
    for (y, row) in bytes.chunks_exact_mut(row).enumerate() {
        for packet in &packets {
            match packet.read(&mut file, row, (n, size)) {
                Ok(true) => {}
                Ok(false) => {
                    return Err(place.malformed(format!("the runs of row {y} do not fit {}", spec.width)));
                }
                Err(error) if error.kind() == ErrorKind::UnexpectedEof && y > 0 => {
                    let what = format!("the file ends early: {y} of {} rows are there", spec.height);
                    let pixels = Pixels::from_bytes(spec.pixel_type, bytes, true);
                    return Ok(Decoded { pixels, missing: Some((y as u32, what)) });
                }
                Err(error) => return Err(place.io(error)),
            }
        }
    }
    Ok(Decoded::whole(Pixels::from_bytes(spec.pixel_type, bytes, true)))
}

impl Packet {
    /// Fills the channels of a row, whose pixels have `n` values of `size` bytes. Returns `Ok (false)` when runs exceed
    /// the row.
    fn read(&self, file: &mut impl Read, row: &mut [u8], (n, size): (usize, usize)) -> std::io::Result<bool> {
        let mut pixels = row.chunks_exact_mut(n * size);
        let mut value = [0; 8];
        let value = &mut value[..self.channels.len() * size];
        let set = |pixel: &mut [u8], value: &[u8]| {
            for (c, value) in self.channels.iter().zip(value.chunks_exact(size)) {
                pixel[c * size..(c + 1) * size].copy_from_slice(value);
            }
        };
        while pixels.len() > 0 {
            let mut code = [128];
            if self.encoding != Encoding::Verbatim {
                file.read_exact(&mut code)?;
            }
            let (count, repeated) = match (self.encoding, code[0]) {
                (Encoding::Verbatim, _) => (pixels.len(), false),
                (Encoding::Runs, count) => (usize::from(count), true),
                (Encoding::MixedRuns, count @ 0..=127) => (usize::from(count) + 1, false),
                (Encoding::MixedRuns, 128) => {
                    let mut long = [0; 2];
                    file.read_exact(&mut long)?;
                    (usize::from(u16::from_be_bytes(long)), true)
                }
                (Encoding::MixedRuns, count) => (usize::from(count) - 127, true),
            };
            if count == 0 || count > pixels.len() {
                return Ok(false);
            }
            if repeated {
                file.read_exact(value)?;
            }
            for pixel in pixels.by_ref().take(count) {
                if !repeated {
                    file.read_exact(value)?;
                }
                set(pixel, value);
            }
        }
        Ok(true)
    }
}
