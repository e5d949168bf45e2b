//! A block of pixel values in their stored type.

use crate::PixelType;
use half::f16;
use half::slice::HalfFloatSliceExt;
use std::borrow::Cow;
use std::ops::Range;

/// The pixel values of a block: rows from the top, pixels from the left, channels interleaved.
#[derive(Clone, Debug, PartialEq)]
pub enum Pixels {
    /// 8-bit unsigned.
    U8(Vec<u8>),
    /// 16-bit unsigned.
    U16(Vec<u16>),
    /// 32-bit unsigned.
    U32(Vec<u32>),
    /// 16-bit float.
    Half(Vec<f16>),
    /// 32-bit float.
    Float(Vec<f32>),
}

/// Runs `$body` with `$v` bound to the vector inside, for every type.
macro_rules! each_type {
    ($pixels:expr, $v:ident => $body:expr) => {
        match $pixels {
            Pixels::U8($v) => $body,
            Pixels::U16($v) => $body,
            Pixels::U32($v) => $body,
            Pixels::Half($v) => $body,
            Pixels::Float($v) => $body,
        }
    };
}

impl Pixels {
    /// Returns `n` zero values.
    pub fn zeros(pixel_type: PixelType, n: usize) -> Self {
        match pixel_type {
            PixelType::U8 => Self::U8(vec![0; n]),
            PixelType::U16 => Self::U16(vec![0; n]),
            PixelType::U32 => Self::U32(vec![0; n]),
            PixelType::Half => Self::Half(vec![f16::ZERO; n]),
            PixelType::Float => Self::Float(vec![0.0; n]),
        }
    }

    /// Returns the stored type.
    pub fn pixel_type(&self) -> PixelType {
        match self {
            Self::U8(_) => PixelType::U8,
            Self::U16(_) => PixelType::U16,
            Self::U32(_) => PixelType::U32,
            Self::Half(_) => PixelType::Half,
            Self::Float(_) => PixelType::Float,
        }
    }

    /// The number of values (pixels times channels).
    pub fn len(&self) -> usize {
        each_type!(self, v => v.len())
    }

    /// True when there are no values.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns value `i` as a float. 8- and 16-bit integers are fractions of their range (correctly rounded, so that
    /// the largest is exactly 1). 32-bit integers become the nearest float.
    pub fn get(&self, i: usize) -> f32 {
        match self {
            Self::U8(v) => f32::from(v[i]) / 255.0,
            Self::U16(v) => f32::from(v[i]) / 65535.0,
            Self::U32(v) => v[i] as f32,
            Self::Half(v) => v[i].to_f32(),
            Self::Float(v) => v[i],
        }
    }

    /// Returns all values as floats; see [`Pixels::get`].
    pub fn to_floats(&self) -> Vec<f32> {
        let mut room = Vec::new();
        match self {
            Self::Float(v) => v.clone(),
            other => {
                other.floats_of(0..other.len(), &mut room);
                room
            }
        }
    }

    /// Returns all values as floats; see [`Pixels::get`]. Values that are floats already are not copied.
    pub fn floats(&self) -> Cow<'_, [f32]> {
        match self {
            Self::Float(v) => Cow::Borrowed(v),
            other => Cow::Owned(other.to_floats()),
        }
    }

    /// Returns the values in `range` as floats; see [`Pixels::get`]. The result uses the memory of `room`, unless the
    /// values are floats already.
    ///
    /// # Panics
    /// Panics when the range is outside, which is an error in the caller's code.
    pub fn floats_of<'a>(&'a self, range: Range<usize>, room: &'a mut Vec<f32>) -> &'a [f32] {
        /// Replaces the contents of `room`.
        fn fill<T: Copy>(room: &mut Vec<f32>, values: &[T], float: impl Fn(T) -> f32) {
            room.clear();
            room.extend(values.iter().map(|v| float(*v)));
        }
        match self {
            Self::U8(v) => fill(room, &v[range], |v| f32::from(v) / 255.0),
            Self::U16(v) => fill(room, &v[range], |v| f32::from(v) / 65535.0),
            Self::U32(v) => fill(room, &v[range], |v| v as f32),
            Self::Half(v) => {
                room.resize(range.len(), 0.0);
                v[range].convert_to_f32_slice(room);
            }
            Self::Float(v) => return &v[range],
        }
        room
    }

    /// Converts floats, as the inverse of [`Pixels::to_floats`]. Integers are rounded (halves away from 0) and
    /// clamped, and NaN becomes 0. Half floats are rounded to nearest even, NaN stays NaN, and values that are too
    /// large become infinite. Converting from 8 bits to any other type and back changes nothing.
    pub fn from_floats(pixel_type: PixelType, values: &[f32]) -> Self {
        match pixel_type {
            PixelType::U8 => Self::U8(values.iter().map(|v| (v * 255.0).round() as u8).collect()),
            PixelType::U16 => Self::U16(values.iter().map(|v| (v * 65535.0).round() as u16).collect()),
            PixelType::U32 => Self::U32(values.iter().map(|v| v.round() as u32).collect()),
            PixelType::Half => {
                let mut halves = vec![f16::ZERO; values.len()];
                halves.convert_from_f32_slice(values);
                Self::Half(halves)
            }
            PixelType::Float => Self::Float(values.to_vec()),
        }
    }

    /// Returns the same pixels in another type. The same type is free.
    pub fn converted(self, pixel_type: PixelType) -> Self {
        if self.pixel_type() == pixel_type { self } else { Self::from_floats(pixel_type, &self.to_floats()) }
    }

    /// Converts the bytes of a file, `big_endian` or little-endian. An incomplete value at the end is dropped.
    pub fn from_bytes(pixel_type: PixelType, bytes: Vec<u8>, big_endian: bool) -> Self {
        /// Returns the complete values of `N` bytes.
        fn values<const N: usize, T>(bytes: &[u8], get: impl Fn([u8; N]) -> T) -> Vec<T> {
            bytes.as_chunks::<N>().0.iter().map(|b| get(*b)).collect()
        }
        match (pixel_type, big_endian) {
            (PixelType::U8, _) => Self::U8(bytes),
            (PixelType::U16, false) => Self::U16(values(&bytes, u16::from_le_bytes)),
            (PixelType::U16, true) => Self::U16(values(&bytes, u16::from_be_bytes)),
            (PixelType::U32, false) => Self::U32(values(&bytes, u32::from_le_bytes)),
            (PixelType::U32, true) => Self::U32(values(&bytes, u32::from_be_bytes)),
            (PixelType::Half, false) => Self::Half(values(&bytes, f16::from_le_bytes)),
            (PixelType::Half, true) => Self::Half(values(&bytes, f16::from_be_bytes)),
            (PixelType::Float, false) => Self::Float(values(&bytes, f32::from_le_bytes)),
            (PixelType::Float, true) => Self::Float(values(&bytes, f32::from_be_bytes)),
        }
    }

    /// Appends the little-endian bytes of all values to `out`.
    pub fn append_le_bytes(&self, out: &mut Vec<u8>) {
        // Written into bytes that are there already, the values are copied as blocks.
        fn append<const N: usize, T: Copy>(out: &mut Vec<u8>, values: &[T], bytes: impl Fn(T) -> [u8; N]) {
            let at = out.len();
            out.resize(at + N * values.len(), 0);
            let places = out[at..].as_chunks_mut::<N>().0;
            places.iter_mut().zip(values).for_each(|(place, v)| *place = bytes(*v));
        }
        match self {
            Self::U8(v) => out.extend_from_slice(v),
            Self::U16(v) => append(out, v, u16::to_le_bytes),
            Self::U32(v) => append(out, v, u32::to_le_bytes),
            Self::Half(v) => append(out, v, f16::to_le_bytes),
            Self::Float(v) => append(out, v, f32::to_le_bytes),
        }
    }

    /// Returns the values of channel `c` of `nchannels`.
    pub fn plane(&self, c: usize, nchannels: usize) -> Self {
        fn pick<T: Copy>(v: &[T], c: usize, n: usize) -> Vec<T> {
            v.iter().skip(c).step_by(n.max(1)).copied().collect()
        }
        match self {
            Self::U8(v) => Self::U8(pick(v, c, nchannels)),
            Self::U16(v) => Self::U16(pick(v, c, nchannels)),
            Self::U32(v) => Self::U32(pick(v, c, nchannels)),
            Self::Half(v) => Self::Half(pick(v, c, nchannels)),
            Self::Float(v) => Self::Float(pick(v, c, nchannels)),
        }
    }

    /// Stores the values of `plane` in channel `c` of `nchannels`. Both have the same type.
    ///
    /// # Panics
    /// Panics when the types differ, which is an error in the caller's code.
    pub fn set_plane(&mut self, c: usize, nchannels: usize, plane: &Self) {
        fn put<T: Copy>(to: &mut [T], c: usize, n: usize, from: &[T]) {
            for (to, from) in to.iter_mut().skip(c).step_by(n.max(1)).zip(from) {
                *to = *from;
            }
        }
        match (self, plane) {
            (Self::U8(d), Self::U8(s)) => put(d, c, nchannels, s),
            (Self::U16(d), Self::U16(s)) => put(d, c, nchannels, s),
            (Self::U32(d), Self::U32(s)) => put(d, c, nchannels, s),
            (Self::Half(d), Self::Half(s)) => put(d, c, nchannels, s),
            (Self::Float(d), Self::Float(s)) => put(d, c, nchannels, s),
            (d, s) => panic!("copy between pixel types {:?} and {:?}", s.pixel_type(), d.pixel_type()),
        }
    }

    /// Keeps the first `n` values.
    pub fn truncate(&mut self, n: usize) {
        each_type!(self, v => v.truncate(n));
    }

    /// Copies `count` values from `source[from..]` to `self[to..]`. Both have the same type.
    ///
    /// # Panics
    /// Panics when the types differ or a range is outside, which are errors in the caller's code.
    pub fn copy_from(&mut self, to: usize, source: &Self, from: usize, count: usize) {
        match (self, source) {
            (Self::U8(d), Self::U8(s)) => d[to..to + count].copy_from_slice(&s[from..from + count]),
            (Self::U16(d), Self::U16(s)) => d[to..to + count].copy_from_slice(&s[from..from + count]),
            (Self::U32(d), Self::U32(s)) => d[to..to + count].copy_from_slice(&s[from..from + count]),
            (Self::Half(d), Self::Half(s)) => d[to..to + count].copy_from_slice(&s[from..from + count]),
            (Self::Float(d), Self::Float(s)) => d[to..to + count].copy_from_slice(&s[from..from + count]),
            (d, s) => panic!("copy between pixel types {:?} and {:?}", s.pixel_type(), d.pixel_type()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_round_trip() {
        let all = Pixels::U8((0..=255).collect());
        assert_eq!(Pixels::from_floats(PixelType::U8, &all.to_floats()), all);
        let all = Pixels::U16((0..=65535).collect());
        assert_eq!(Pixels::from_floats(PixelType::U16, &all.to_floats()), all);
    }

    #[test]
    fn bytes_survive_conversion_to_every_type() {
        let all = Pixels::U8((0..=255).collect());
        for t in [PixelType::U16, PixelType::Half, PixelType::Float] {
            assert_eq!(all.clone().converted(t).converted(PixelType::U8), all, "{t:?}");
        }
        let Pixels::U16(wide) = all.converted(PixelType::U16) else { panic!() };
        assert!(wide.iter().enumerate().all(|(i, v)| usize::from(*v) == i * 257));
        let top = Pixels::U16(vec![65535, 65534]).to_floats();
        assert!(top[0] == 1.0 && top[1] < 1.0);
    }

    #[test]
    fn ranges_convert_to_floats_like_single_values() {
        let values: Vec<f32> = (0..=65535_u16).map(|bits| f16::from_bits(bits).to_f32()).collect();
        let mut room = vec![f32::NAN; 3];
        for t in [PixelType::U8, PixelType::U16, PixelType::U32, PixelType::Half, PixelType::Float] {
            let pixels = Pixels::from_floats(t, &values);
            for range in [0..0, 5..6, 3..20, 31_700..31_800, 64_000..65_536, 0..65_536] {
                let single: Vec<u32> = range.clone().map(|i| pixels.get(i).to_bits()).collect();
                let bits = |v: &[f32]| v.iter().map(|v| v.to_bits()).collect::<Vec<u32>>();
                assert_eq!(bits(pixels.floats_of(range.clone(), &mut room)), single, "{t:?} {range:?}");
                if range.len() == pixels.len() {
                    assert_eq!((bits(&pixels.floats()), bits(&pixels.to_floats())), (single.clone(), single));
                }
            }
        }
    }

    #[test]
    fn halves_are_rounded_alike_singly_and_in_bulk() {
        // The values are between half floats, including ties, from values that underflow to infinite ones.
        let values: Vec<f32> =
            (0..1 << 17).map(|i: u32| f32::from_bits(i.wrapping_mul(0x7fff_0011))).collect();
        let Pixels::Half(all) = Pixels::from_floats(PixelType::Half, &values) else { panic!() };
        for (half, value) in all.iter().zip(&values) {
            let one = f16::from_f32(*value);
            assert!(half.to_bits() == one.to_bits() || half.is_nan() && one.is_nan(), "{value}");
        }
    }

    #[test]
    fn bytes_round_trip() {
        let values = [0.0, 1.0, 0.25, 1.0 / 3.0];
        for t in [PixelType::U8, PixelType::U16, PixelType::U32, PixelType::Half, PixelType::Float] {
            let pixels = Pixels::from_floats(t, &values);
            let mut bytes = Vec::new();
            pixels.append_le_bytes(&mut bytes);
            assert_eq!(Pixels::from_bytes(t, bytes.clone(), false), pixels);
            bytes.as_mut_slice().chunks_mut(t.bytes()).for_each(<[u8]>::reverse);
            assert_eq!(Pixels::from_bytes(t, bytes, true), pixels);
        }
    }

    #[test]
    fn planes_are_taken_and_set() {
        let mut p = Pixels::U8(vec![1, 2, 3, 4, 5, 6]);
        let second = p.plane(1, 3);
        assert_eq!(second, Pixels::U8(vec![2, 5]));
        p.set_plane(0, 3, &second);
        assert_eq!(p, Pixels::U8(vec![2, 2, 3, 5, 5, 6]));
        p.truncate(3);
        assert_eq!(p, Pixels::U8(vec![2, 2, 3]));
    }

    #[test]
    fn floats_beyond_the_range_are_clamped_and_nan_is_zero() {
        let p = Pixels::from_floats(PixelType::U8, &[-1.0, 2.0, f32::NAN, f32::INFINITY]);
        assert_eq!(p, Pixels::U8(vec![0, 255, 0, 255]));
    }
}
