//! Deep pixels, which have any number of samples at different depths, flattened to pixels of one sample.
//!
//! The layout of chunks is that of "OpenEXR File Layout". Samples are combined as "Interpreting OpenEXR Deep Pixels"
//! demands: volumes that overlap are split where others begin and end, coincident samples are merged, and the results
//! are composited front to back.

use crate::zip;
use exr::compression::Compression;
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use granita_image::Pixels;
use half::f16;

/// The largest number of volumetric samples of a pixel that are split where they overlap. More of them are composited
/// in the order of their depths.
const MOST_SPLIT: usize = 1024;

/// The largest number of bytes that one packed byte may become.
const MOST_RATIO: u64 = 1100;

/// The role of a channel of a deep image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    /// The depth of a sample, or where a volume begins.
    Front,
    /// Where a volume ends.
    Back,
    Alpha,
    /// A value that is composited as colours are.
    Color,
    /// A number, of which the nearest one is taken.
    Number,
}

/// The channels of a deep part.
#[derive(Clone, Debug)]
pub(crate) struct DeepChannels {
    types: Vec<SampleType>,
    roles: Vec<Role>,
}

/// The samples of a chunk.
pub(crate) struct DeepChunk<'a> {
    channels: &'a DeepChannels,
    /// The numbers of pixels across and down.
    size: (usize, usize),
    /// For each row: for each of its pixels, the number of samples of the row up to and including it.
    ends: Vec<u32>,
    data: Vec<u8>,
}

/// The sizes in the head of a chunk.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DeepSizes {
    /// The bytes of the table of samples, packed.
    pub(crate) table: u64,
    /// The bytes of the samples, packed.
    pub(crate) data: u64,
    /// The bytes of the samples.
    pub(crate) unpacked: u64,
}

impl DeepSizes {
    /// Returns the sizes from the 24 bytes of the head of a chunk.
    pub(crate) fn new(bytes: &[u8; 24]) -> Self {
        let (words, _) = bytes.as_chunks::<8>();
        let word = |k: usize| words.get(k).map_or(0, |bytes| u64::from_le_bytes(*bytes));
        Self { table: word(0), data: word(1), unpacked: word(2) }
    }

    /// Checks that a chunk may have these sizes. `pixels` is the number of pixels of a whole block or tile, because
    /// OpenEXR's library stores uncompressed tables of that size also at the edges of an image.
    pub(crate) fn check(&self, pixels: usize) -> Result<(), String> {
        let table = pixels as u64 * 4;
        if self.table > table {
            return Err(format!("a table of {} bytes for {pixels} pixels", self.table));
        }
        if self.unpacked > self.data.saturating_mul(MOST_RATIO) || self.data > self.unpacked {
            return Err(format!("{} bytes of samples in {} bytes", self.unpacked, self.data));
        }
        Ok(())
    }
}

impl DeepChannels {
    /// Returns the channels of a header, in its order.
    pub(crate) fn new(header: &Header, names: &[String]) -> Self {
        let types: Vec<SampleType> = header.channels.list.iter().map(|c| c.sample_type).collect();
        let role = |(name, ty): (&String, &SampleType)| match (&**name, ty) {
            ("Z", _) => Role::Front,
            ("ZBack", _) => Role::Back,
            ("A", _) => Role::Alpha,
            (_, SampleType::U32) => Role::Number,
            _ => Role::Color,
        };
        let roles = names.iter().zip(&types).map(role).collect();
        Self { types, roles }
    }

    /// True for the channels that the flat image has. The far ends of volumes have no meaning in it.
    pub(crate) fn is_shown(&self, channel: usize) -> bool {
        self.roles.get(channel).is_some_and(|role| *role != Role::Back)
    }

    /// The number of bytes of a sample.
    fn bytes(&self) -> usize {
        self.types.iter().map(|ty| ty.bytes_per_sample()).sum()
    }

    fn find(&self, role: Role) -> Option<usize> {
        self.roles.iter().position(|r| *r == role)
    }
}

impl<'a> DeepChunk<'a> {
    /// Unpacks a chunk of `size` pixels.
    ///
    /// # Errors
    /// Returns what is wrong with a damaged chunk.
    pub(crate) fn new(
        channels: &'a DeepChannels,
        compression: Compression,
        size: (usize, usize),
        (table, data, unpacked): (&[u8], &[u8], u64),
    ) -> Result<Self, String> {
        let (width, height) = size;
        let table =
            unpack(compression, table, width * height * 4).ok_or("its table of samples is damaged")?;
        let ends: Vec<u32> =
            table.as_chunks::<4>().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect();
        if !ends.chunks_exact(width.max(1)).all(|row| row.is_sorted()) {
            return Err("its table of samples is not increasing".to_owned());
        }
        let row_ends = || ends.chunks_exact(width.max(1)).filter_map(|row| row.last());
        let samples: u64 = row_ends().map(|end| u64::from(*end)).sum();
        let bytes = samples.saturating_mul(channels.bytes() as u64);
        if bytes != unpacked {
            return Err(format!("{samples} samples have {bytes} bytes, and it has {unpacked}"));
        }
        let len = usize::try_from(bytes).map_err(|_| format!("{samples} samples"))?;
        let data = unpack(compression, data, len).ok_or("its samples are damaged")?;
        Ok(Self { channels, size, ends, data })
    }

    /// Returns the number of samples of the chunk, and the largest one of a pixel.
    pub(crate) fn counts(&self) -> (u64, u32) {
        let (mut total, mut most) = (0, 0);
        for row in self.ends.chunks_exact(self.size.0.max(1)) {
            let mut before = 0;
            for end in row {
                most = most.max(end - before);
                before = *end;
            }
            total += u64::from(before);
        }
        (total, most)
    }

    /// Stores the flat pixels in the upper left of `out`, whose rows have `stride` pixels. `order` holds the index of
    /// the stored channel of every channel of `out`.
    pub(crate) fn flatten(&self, order: &[usize], stride: usize, out: &mut Pixels) {
        let mut pixel = FlatPixel::default();
        let (mut row_at, row_pixels) = (0, self.size.0.max(1));
        for (y, row) in self.ends.chunks_exact(row_pixels).enumerate() {
            let of_row = row.last().map_or(0, |end| *end as usize);
            let mut before = 0;
            for (x, end) in row.iter().enumerate() {
                let (first, count) = (before as usize, (end - before) as usize);
                before = *end;
                if count == 0 {
                    continue;
                }
                let value = |channel: usize, sample: usize| {
                    let types = &self.channels.types;
                    let planes: usize = types[..channel].iter().map(|ty| ty.bytes_per_sample()).sum();
                    let (ty, wide) = (types[channel], types[channel].bytes_per_sample());
                    let at = row_at + planes * of_row + (first + sample) * wide;
                    read(ty, &self.data[at..at + wide])
                };
                pixel.flatten(self.channels, count, &value);
                for (to, stored) in order.iter().enumerate() {
                    let at = (y * stride + x) * order.len() + to;
                    match (&mut *out, pixel.values[*stored]) {
                        (Pixels::Half(v), value) => v[at] = f16::from_f64(value),
                        (Pixels::Float(v), value) => v[at] = value as f32,
                        // The numbers of a channel of integers are exact.
                        (Pixels::U32(v), value) => v[at] = value as u32,
                        (Pixels::U8(_) | Pixels::U16(_), _) => {}
                    }
                }
            }
            row_at += of_row * self.channels.bytes();
        }
    }
}

/// Returns a stored number.
fn read(ty: SampleType, bytes: &[u8]) -> f64 {
    match (ty, bytes) {
        (SampleType::F16, &[a, b]) => f16::from_le_bytes([a, b]).to_f64(),
        (SampleType::F32, &[a, b, c, d]) => f64::from(f32::from_le_bytes([a, b, c, d])),
        (SampleType::U32, &[a, b, c, d]) => f64::from(u32::from_le_bytes([a, b, c, d])),
        _ => 0.0,
    }
}

/// Returns the `len` bytes of packed data; `None` when it is damaged.
fn unpack(compression: Compression, packed: &[u8], len: usize) -> Option<Vec<u8>> {
    if packed.len() == len {
        // Data that would not shrink is stored as it is.
        return Some(packed.to_vec());
    }
    match compression {
        // The rest of a table at the edge of an image has no meaning.
        Compression::Uncompressed => packed.get(..len).map(<[u8]>::to_vec),
        Compression::RLE => zip::decompress_runs(packed, len),
        Compression::ZIP1 | Compression::ZIP16 => zip::decompress(packed, len),
        _ => None,
    }
}

/// The pixel that is flattened, with lists that are kept from one to the next.
#[derive(Default)]
struct FlatPixel {
    /// The values of all stored channels.
    values: Vec<f64>,
    pieces: Vec<Piece>,
    /// The values of the channels of the pieces, one piece after the other.
    colors: Vec<f64>,
}

/// A sample, or a part of a volumetric one.
#[derive(Clone, Copy, Debug)]
struct Piece {
    front: f64,
    back: f64,
    alpha: f64,
    /// The index of its colours.
    color: usize,
}

impl FlatPixel {
    /// Flattens the `count` samples of a pixel. `value (c, s)` is channel `c` of sample `s`.
    fn flatten(&mut self, channels: &DeepChannels, count: usize, value: &dyn Fn(usize, usize) -> f64) {
        let n = channels.roles.len();
        let [front, back, alpha] = [Role::Front, Role::Back, Role::Alpha].map(|role| channels.find(role));
        self.pieces.clear();
        self.colors.clear();
        for sample in 0..count {
            // Without depths the samples are in their order.
            let z = front.map_or(sample as f64, |channel| value(channel, sample));
            let end = back.filter(|_| front.is_some()).map_or(z, |channel| value(channel, sample));
            // Without alpha a sample hides what is behind it.
            let opacity = alpha.map_or(1.0, |channel| value(channel, sample));
            let piece = Piece {
                front: z,
                back: if end > z { end } else { z },
                alpha: if opacity.is_nan() { 0.0 } else { opacity.clamp(0.0, 1.0) },
                color: self.colors.len(),
            };
            self.colors.extend((0..n).map(|channel| value(channel, sample)));
            self.pieces.push(piece);
        }
        self.sort();
        let volumes = self.pieces.iter().filter(|piece| piece.back > piece.front).count();
        if volumes > 0 && volumes <= MOST_SPLIT && self.overlap() {
            self.split(&channels.roles);
        }
        self.composite(&channels.roles);
    }

    fn sort(&mut self) {
        let order = |a: &Piece, b: &Piece| a.front.total_cmp(&b.front).then(a.back.total_cmp(&b.back));
        self.pieces.sort_by(order);
    }

    /// True when sorted pieces overlap.
    fn overlap(&self) -> bool {
        let mut end = f64::NEG_INFINITY;
        self.pieces.iter().any(|piece| {
            let overlaps = piece.front < end;
            end = end.max(piece.back);
            overlaps
        })
    }

    /// Splits volumes where other samples begin and end.
    fn split(&mut self, roles: &[Role]) {
        let mut ends: Vec<f64> = self.pieces.iter().flat_map(|piece| [piece.front, piece.back]).collect();
        ends.sort_by(f64::total_cmp);
        ends.dedup();
        let whole = std::mem::take(&mut self.pieces);
        for piece in whole {
            let length = piece.back - piece.front;
            let first = ends.partition_point(|end| *end <= piece.front);
            let inside = ends[first..].iter().copied().take_while(|end| *end < piece.back);
            if length <= 0.0 || !length.is_finite() || inside.clone().next().is_none() {
                self.pieces.push(piece);
                continue;
            }
            let mut front = piece.front;
            for back in inside.chain([piece.back]) {
                let share = (back - front) / length;
                let alpha = -libm::expm1(share * libm::log1p(-piece.alpha));
                let part = if piece.alpha > 0.0 { alpha / piece.alpha } else { share };
                let color = self.colors.len();
                for (k, role) in roles.iter().enumerate() {
                    let value = self.colors[piece.color + k];
                    self.colors.push(if *role == Role::Color { value * part } else { value });
                }
                self.pieces.push(Piece { front, back, alpha, color });
                front = back;
            }
        }
        self.sort();
    }

    /// Merges sorted pieces of the same place, and composites them front to back.
    fn composite(&mut self, roles: &[Role]) {
        self.values.clear();
        self.values.resize(roles.len(), 0.0);
        let (mut through, mut nearest) = (1.0, None);
        let mut merged: Vec<f64> = Vec::with_capacity(roles.len());
        let same = |a: &Piece, b: &Piece| a.front == b.front && a.back == b.back;
        for group in self.pieces.chunk_by(same) {
            let Some(Piece { mut alpha, color, .. }) = group.first().copied() else { continue };
            merged.clear();
            merged.extend(&self.colors[color..color + roles.len()]);
            for piece in &group[1..] {
                let other = &self.colors[piece.color..piece.color + roles.len()];
                for ((value, other), role) in merged.iter_mut().zip(other).zip(roles) {
                    if *role == Role::Color {
                        *value = merge((alpha, *value), (piece.alpha, *other));
                    }
                }
                alpha += piece.alpha - alpha * piece.alpha;
            }
            if nearest.is_none() && alpha > 0.0 {
                nearest = Some(color);
            }
            for ((value, role), of_piece) in self.values.iter_mut().zip(roles).zip(&merged) {
                match role {
                    Role::Color => *value += through * of_piece,
                    Role::Alpha => *value += through * alpha,
                    Role::Front | Role::Back | Role::Number => {}
                }
            }
            through *= 1.0 - alpha;
            if through <= 0.0 {
                break;
            }
        }
        // Depths and numbers have no mean.
        let color = nearest.or_else(|| self.pieces.first().map(|piece| piece.color)).unwrap_or(0);
        for (k, role) in roles.iter().enumerate() {
            if matches!(role, Role::Front | Role::Back | Role::Number) {
                self.values[k] = self.colors.get(color + k).copied().unwrap_or(0.0);
            }
        }
    }
}

/// Merges the colours of two samples of the same place, each with its alpha.
fn merge((a1, c1): (f64, f64), (a2, c2): (f64, f64)) -> f64 {
    match (a1 >= 1.0, a2 >= 1.0) {
        (true, true) => return (c1 + c2) / 2.0,
        (true, false) => return c1,
        (false, true) => return c2,
        (false, false) => {}
    }
    let density = |a: f64| -libm::log1p(-a);
    let (u1, u2) = (density(a1), density(a2));
    let per_alpha = |u: f64, a: f64| if a > 0.0 { u / a } else { 1.0 };
    let (u, a) = (u1 + u2, a1 + a2 - a1 * a2);
    let w = if u > 0.0 { a / u } else { 1.0 };
    (c1 * per_alpha(u1, a1) + c2 * per_alpha(u2, a2)) * w
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Flattens samples of R, A, Z and ZBack.
    fn flat(samples: &[[f64; 4]]) -> [f64; 3] {
        let roles = vec![Role::Color, Role::Alpha, Role::Front, Role::Back];
        let channels = DeepChannels { types: vec![SampleType::F32; 4], roles };
        let mut pixel = FlatPixel::default();
        pixel.flatten(&channels, samples.len(), &|c, s| samples[s][c]);
        [pixel.values[0], pixel.values[1], pixel.values[2]]
    }

    fn is_near(a: [f64; 3], b: [f64; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn samples_are_composited_from_the_nearest_on() {
        let (near, far) = ([0.25, 0.5, 2.0, 2.0], [1.0, 1.0, 3.0, 3.0]);
        for samples in [[near, far], [far, near]] {
            assert_eq!(flat(&samples), [0.75, 1.0, 2.0]);
        }
        assert_eq!(
            flat(&[[0.5, 0.0, 1.0, 1.0], near]),
            [0.75, 0.5, 2.0],
            "light without opacity has no depth"
        );
    }

    #[test]
    fn a_volume_with_a_point_inside_is_split() {
        // A volume of alpha 0.75 from 1 to 3 has 0.5 on each side of an opaque point at 2.
        let seen = flat(&[[0.75, 0.75, 1.0, 3.0], [0.0, 1.0, 2.0, 2.0]]);
        assert!(is_near(seen, [0.5, 1.0, 1.0]), "{seen:?}");
    }

    #[test]
    fn equal_volumes_are_merged() {
        let one = [0.3, 0.5, 1.0, 3.0];
        let two = flat(&[one, one]);
        // Twice the density of one colour: the colour grows with alpha.
        assert!(is_near(two, [0.45, 0.75, 1.0]), "{two:?}");
        let halves = flat(&[[0.3, 0.5, 1.0, 2.0], [0.3, 0.5, 2.0, 3.0]]);
        assert!(is_near(halves, [0.45, 0.75, 1.0]), "{halves:?}");
    }

    #[test]
    fn odd_samples_do_no_harm() {
        for z in [f64::NAN, f64::INFINITY, -1.0, 0.0] {
            let all = flat(&[[1.0, f64::NAN, z, z], [1.0, 2.0, 1.0, z], [0.5, -3.0, z, 4.0]]);
            assert!((0.0..=1.0).contains(&all[1]), "{all:?}");
        }
    }

    #[test]
    fn damaged_chunks_are_refused() {
        let channels = DeepChannels { types: vec![SampleType::F32], roles: vec![Role::Front] };
        let chunk = |ends: &[u32], data: &[u8], unpacked: u64| {
            let table: Vec<u8> = ends.iter().flat_map(|end| end.to_le_bytes()).collect();
            let parts = (&*table, data, unpacked);
            DeepChunk::new(&channels, Compression::Uncompressed, (2, 1), parts).map(|c| c.counts())
        };
        assert_eq!(chunk(&[1, 3], &[0; 12], 12), Ok((3, 2)));
        assert!(chunk(&[3, 1], &[0; 4], 4).is_err());
        assert!(chunk(&[1, 3], &[0; 8], 12).is_err());
        assert!(chunk(&[1, 3], &[0; 8], 8).is_err());
        assert!(chunk(&[1], &[0; 4], 4).is_err());
        assert!(chunk(&[u32::MAX, u32::MAX], &[0; 4], 4).is_err());
        let sizes = |table, data, unpacked| DeepSizes { table, data, unpacked }.check(2).is_ok();
        assert!(sizes(8, 10, 12) && !sizes(9, 10, 12) && !sizes(8, 13, 12) && !sizes(8, 1, 5000));
    }
}
