//! Converts the file's layout of a block (rows, in them channels by name, in them pixels) to interleaved pixels in
//! the order of the spec, and back.

use exr::meta::attribute::SampleType;
use granita_image::{PixelType, Pixels};
use half::f16;

/// The storage and the output order of the channels of a part.
#[derive(Clone, Debug)]
pub(crate) struct Order {
    /// The type of every stored channel, in the file's order.
    pub(crate) types: Vec<SampleType>,
    /// The index in the file's order of every output channel.
    pub(crate) order: Vec<usize>,
    /// The output type, which is that of all channels, or floats.
    pub(crate) pixel_type: PixelType,
}

impl Order {
    /// Copies `w x h` pixels of a block into the upper left of `out`, whose rows have `stride` pixels. `data` has
    /// exactly the bytes of the block.
    pub(crate) fn scatter(&self, data: &[u8], w: usize, h: usize, stride: usize, out: &mut Pixels) {
        let n = self.order.len();
        let row_bytes: usize = self.types.iter().map(|t| t.bytes_per_sample() * w).sum();
        for (y, row) in data.chunks_exact(row_bytes.max(1)).take(h).enumerate() {
            let mut at = 0;
            for (stored, kind) in self.types.iter().enumerate() {
                let bytes = &row[at..at + kind.bytes_per_sample() * w];
                at += bytes.len();
                let Some(channel) = self.order.iter().position(|o| *o == stored) else { continue };
                let start = y * stride * n + channel;
                match (&mut *out, kind) {
                    (Pixels::Half(v), SampleType::F16) => {
                        put(&mut v[start..], n, bytes, f16::from_ne_bytes);
                    }
                    (Pixels::U32(v), SampleType::U32) => put(&mut v[start..], n, bytes, u32::from_ne_bytes),
                    (Pixels::Float(v), SampleType::F32) => put(&mut v[start..], n, bytes, f32::from_ne_bytes),
                    (Pixels::Float(v), SampleType::F16) => {
                        put(&mut v[start..], n, bytes, |b| f16::from_ne_bytes(b).to_f32());
                    }
                    (Pixels::Float(v), SampleType::U32) => {
                        put(&mut v[start..], n, bytes, |b| u32::from_ne_bytes(b) as f32);
                    }
                    // Other pairs do not occur, because the output type follows from the stored types.
                    _ => {}
                }
            }
        }
    }

    /// Returns the bytes of a block from the upper left `w x h` pixels of `pixels`, whose rows have `stride` pixels.
    /// All channels have the type of the pixels.
    pub(crate) fn gather(&self, pixels: &Pixels, w: usize, h: usize, stride: usize) -> Vec<u8> {
        let n = self.order.len();
        let mut out = Vec::with_capacity(w * h * n * self.pixel_type.bytes());
        for y in 0..h {
            for stored in 0..n {
                let Some(channel) = self.order.iter().position(|o| *o == stored) else { continue };
                let values = (0..w).map(|x| (y * stride + x) * n + channel);
                match pixels {
                    Pixels::Half(v) => out.extend(values.flat_map(|i| v[i].to_ne_bytes())),
                    Pixels::Float(v) => out.extend(values.flat_map(|i| v[i].to_ne_bytes())),
                    Pixels::U32(v) => out.extend(values.flat_map(|i| v[i].to_ne_bytes())),
                    // The format does not have these types, and `create` refuses them.
                    Pixels::U8(_) | Pixels::U16(_) => {}
                }
            }
        }
        out
    }
}

/// Stores values at every `step`-th index.
fn put<const N: usize, T>(to: &mut [T], step: usize, bytes: &[u8], get: impl Fn([u8; N]) -> T) {
    for (to, from) in to.iter_mut().step_by(step).zip(bytes.as_chunks::<N>().0) {
        *to = get(*from);
    }
}
