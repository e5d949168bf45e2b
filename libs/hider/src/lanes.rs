//! Vectors of eight numbers that compilers turn into vector instructions.

#![allow(clippy::needless_range_loop, reason = "loops of a fixed length become vector instructions")]

use granita_machine::simd::{Simd, WIDE};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// The number of lanes.
pub(super) const LANES: usize = WIDE;

/// Comparisons that return one bit for each lane, which compilers do not vectorise by themselves. Comparisons with
/// NaN are false.
pub(super) trait Signs: Simd {
    /// Returns the lanes above 0 as bits.
    #[inline(always)]
    fn positive(self, v: Lanes) -> u32 {
        self.lt8(self.splat8(0.0), self.load8(&v.0))
    }

    /// Returns the lanes that are 0 or above as bits.
    #[inline(always)]
    fn not_negative(self, v: Lanes) -> u32 {
        self.le8(self.splat8(0.0), self.load8(&v.0))
    }

    /// Moves the lanes whose bits are set in `mask` to the front, in order. The other lanes have any values.
    #[inline(always)]
    fn pack(self, v: Lanes, mask: u32) -> Lanes {
        Lanes(self.store8(self.pack8(self.load8(&v.0), mask)))
    }
}

impl<S: Simd> Signs for S {}

/// One number for each of eight samples.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(32))]
pub(super) struct Lanes(pub(super) [f32; LANES]);

impl Lanes {
    #[inline(always)]
    pub(super) fn splat(v: f32) -> Self {
        Self([v; LANES])
    }

    /// Loads the numbers from index `at` on.
    #[inline(always)]
    pub(super) fn load(list: &[f32], at: usize) -> Self {
        let list = &list[at..at + LANES];
        let mut out = [0.0; LANES];
        out.copy_from_slice(list);
        Self(out)
    }

    // These are loops instead of `map`, because compilers turn loops into vector instructions.
    #[inline(always)]
    fn each(self, f: impl Fn(f32) -> f32) -> Self {
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            out[i] = f(self.0[i]);
        }
        Self(out)
    }

    #[inline(always)]
    fn zip(self, b: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            out[i] = f(self.0[i], b.0[i]);
        }
        Self(out)
    }

    /// Returns the lesser number of each lane. A NaN of `b` stays.
    #[inline(always)]
    pub(super) fn min(self, b: Self) -> Self {
        self.zip(b, |a, b| if a < b { a } else { b })
    }

    /// Returns the greater number of each lane. A NaN of `b` stays.
    #[inline(always)]
    pub(super) fn max(self, b: Self) -> Self {
        self.zip(b, |a, b| if a > b { a } else { b })
    }

    /// Returns the least number of all lanes, except for NaN.
    #[inline(always)]
    pub(super) fn least(self) -> f32 {
        self.reduce(f32::min)
    }

    /// Returns the greatest number of all lanes, except for NaN.
    #[inline(always)]
    pub(super) fn most(self) -> f32 {
        self.reduce(f32::max)
    }

    #[inline(always)]
    fn reduce(self, f: impl Fn(f32, f32) -> f32) -> f32 {
        let mut lanes = self.0;
        for half in [4, 2, 1] {
            for i in 0..half {
                lanes[i] = f(lanes[i], lanes[i + half]);
            }
        }
        lanes[0]
    }

    /// Returns `a` in lanes that are 0 or above, and `b` in the others.
    #[inline(always)]
    pub(super) fn choose(self, a: Self, b: Self) -> Self {
        let mut out = b.0;
        for i in 0..LANES {
            out[i] = if self.0[i] >= 0.0 { a.0[i] } else { b.0[i] };
        }
        Self(out)
    }

    /// Returns the square roots.
    #[inline(always)]
    pub(super) fn root(self) -> Self {
        self.each(f32::sqrt)
    }

    /// Returns 1, or -1 for numbers below 0.
    #[inline(always)]
    pub(super) fn sign(self) -> Self {
        self.each(|v| if v < 0.0 { -1.0 } else { 1.0 })
    }
}

/// Returns the first `n` lanes as bits.
#[inline(always)]
pub(super) fn first_lanes(n: usize) -> u32 {
    if n >= LANES { (1 << LANES) - 1 } else { (1 << n) - 1 }
}

macro_rules! operator {
    ($trait:ident, $name:ident, $op:tt) => {
        impl $trait for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $name(self, b: Self) -> Self {
                self.zip(b, |a, b| a $op b)
            }
        }
        impl $trait<f32> for Lanes {
            type Output = Self;
            #[inline(always)]
            fn $name(self, b: f32) -> Self {
                self.zip(Self::splat(b), |a, b| a $op b)
            }
        }
    };
}

operator!(Add, add, +);
operator!(Sub, sub, -);
operator!(Mul, mul, *);
operator!(Div, div, /);

impl Neg for Lanes {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.each(|v| -v)
    }
}

/// A point or direction in each lane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Points {
    pub(super) x: Lanes,
    pub(super) y: Lanes,
    pub(super) z: Lanes,
}

impl Points {
    /// Returns the same point in all lanes.
    #[inline(always)]
    pub(super) fn splat(p: granita_base::Vec3) -> Self {
        Self { x: Lanes::splat(p.x), y: Lanes::splat(p.y), z: Lanes::splat(p.z) }
    }

    #[inline(always)]
    pub(super) fn cross(&self, b: &Self) -> Self {
        Self {
            x: self.y * b.z - b.y * self.z,
            y: self.z * b.x - b.z * self.x,
            z: self.x * b.y - b.x * self.y,
        }
    }

    #[inline(always)]
    pub(super) fn dot(&self, b: &Self) -> Lanes {
        self.x * b.x + self.y * b.y + self.z * b.z
    }
}
