//! A block of pixel values in their stored type.

use crate::PixelType;
use half::f16;

/// Pixel values of a block: rows from the top, pixels from the left, channels interleaved.
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

/// Runs `$body` with `$v` bound to the vector inside, whatever its type.
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
    /// `n` zero values.
    pub fn zeros(pixel_type: PixelType, n: usize) -> Self {
        match pixel_type {
            PixelType::U8 => Self::U8(vec![0; n]),
            PixelType::U16 => Self::U16(vec![0; n]),
            PixelType::U32 => Self::U32(vec![0; n]),
            PixelType::Half => Self::Half(vec![f16::ZERO; n]),
            PixelType::Float => Self::Float(vec![0.0; n]),
        }
    }

    /// The stored type.
    pub fn pixel_type(&self) -> PixelType {
        match self {
            Self::U8(_) => PixelType::U8,
            Self::U16(_) => PixelType::U16,
            Self::U32(_) => PixelType::U32,
            Self::Half(_) => PixelType::Half,
            Self::Float(_) => PixelType::Float,
        }
    }

    /// Number of values (pixels times channels).
    pub fn len(&self) -> usize {
        each_type!(self, v => v.len())
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Value `i` as a float: 8- and 16-bit integers as fractions of their range.
    pub fn get(&self, i: usize) -> f32 {
        match self {
            Self::U8(v) => f32::from(v[i]) * (1.0 / 255.0),
            Self::U16(v) => f32::from(v[i]) * (1.0 / 65535.0),
            Self::U32(v) => v[i] as f32,
            Self::Half(v) => v[i].to_f32(),
            Self::Float(v) => v[i],
        }
    }

    /// All values as floats, as [`Pixels::get`] gives them.
    pub fn to_floats(&self) -> Vec<f32> {
        match self {
            Self::Float(v) => v.clone(),
            _ => (0..self.len()).map(|i| self.get(i)).collect(),
        }
    }

    /// From floats, the inverse of [`Pixels::to_floats`]: integers are rounded and clamped, NaN becomes 0.
    pub fn from_floats(pixel_type: PixelType, values: &[f32]) -> Self {
        match pixel_type {
            PixelType::U8 => Self::U8(values.iter().map(|v| (v * 255.0).round() as u8).collect()),
            PixelType::U16 => Self::U16(values.iter().map(|v| (v * 65535.0).round() as u16).collect()),
            PixelType::U32 => Self::U32(values.iter().map(|v| v.round() as u32).collect()),
            PixelType::Half => Self::Half(values.iter().map(|v| f16::from_f32(*v)).collect()),
            PixelType::Float => Self::Float(values.to_vec()),
        }
    }

    /// The same picture in another type; the same type costs nothing.
    pub fn converted(self, pixel_type: PixelType) -> Self {
        if self.pixel_type() == pixel_type { self } else { Self::from_floats(pixel_type, &self.to_floats()) }
    }

    /// Copies `count` values from `source[from..]` to `self[to..]`; both have the same type.
    ///
    /// # Panics
    /// When the types differ or a range is outside: both are mistakes of the caller's code.
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
    fn clamps_and_survives_nan() {
        let p = Pixels::from_floats(PixelType::U8, &[-1.0, 2.0, f32::NAN, f32::INFINITY]);
        assert_eq!(p, Pixels::U8(vec![0, 255, 0, 255]));
    }
}
