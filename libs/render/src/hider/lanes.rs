//! Eight numbers side by side, for compilers to turn into vector instructions.

#![allow(clippy::needless_range_loop, reason = "loops of a fixed length become vector instructions")]

use std::ops::{Add, Div, Mul, Neg, Sub};

/// How many.
pub(super) const LANES: usize = 8;

/// What compilers do not find by themselves: bits of comparisons. Comparisons with NaN are false.
pub(super) trait Machine: Copy {
    /// The lanes, as bits, that are above 0.
    fn positive(self, v: Lanes) -> u32;
    /// The lanes, as bits, that are 0 or above.
    fn not_negative(self, v: Lanes) -> u32;
}

/// Any machine.
#[derive(Clone, Copy)]
pub(super) struct Portable;

impl Machine for Portable {
    #[inline(always)]
    fn positive(self, v: Lanes) -> u32 {
        v.bits(|v| v > 0.0)
    }

    #[inline(always)]
    fn not_negative(self, v: Lanes) -> u32 {
        v.bits(|v| v >= 0.0)
    }
}

#[cfg(target_arch = "x86_64")]
impl Machine for pulp::x86::V3 {
    #[inline(always)]
    fn positive(self, v: Lanes) -> u32 {
        use std::arch::x86_64::_CMP_GT_OQ;
        let avx = self.avx;
        let above = avx._mm256_cmp_ps::<_CMP_GT_OQ>(pulp::cast(v.0), avx._mm256_setzero_ps());
        avx._mm256_movemask_ps(above).cast_unsigned()
    }

    #[inline(always)]
    fn not_negative(self, v: Lanes) -> u32 {
        use std::arch::x86_64::_CMP_GE_OQ;
        let avx = self.avx;
        let above = avx._mm256_cmp_ps::<_CMP_GE_OQ>(pulp::cast(v.0), avx._mm256_setzero_ps());
        avx._mm256_movemask_ps(above).cast_unsigned()
    }
}

/// One number for each of some samples.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(32))]
pub(super) struct Lanes(pub(super) [f32; LANES]);

impl Lanes {
    #[inline(always)]
    pub(super) fn splat(v: f32) -> Self {
        Self([v; LANES])
    }

    /// The numbers from `at` on.
    #[inline(always)]
    pub(super) fn load(list: &[f32], at: usize) -> Self {
        let list = &list[at..at + LANES];
        let mut out = [0.0; LANES];
        out.copy_from_slice(list);
        Self(out)
    }

    /// The numbers at the places that `at` tells of each of some things.
    #[inline(always)]
    pub(super) fn gather<T>(list: &[f32], of: &[T; LANES], at: impl Fn(&T) -> u32) -> Self {
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            out[i] = list[at(&of[i]) as usize];
        }
        Self(out)
    }

    // Loops, not `map`: compilers turn these into vector instructions.
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

    /// The lesser one. A NaN of `b` stays.
    #[inline(always)]
    pub(super) fn min(self, b: Self) -> Self {
        self.zip(b, |a, b| if a < b { a } else { b })
    }

    /// The greater one. A NaN of `b` stays.
    #[inline(always)]
    pub(super) fn max(self, b: Self) -> Self {
        self.zip(b, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn bits(self, f: impl Fn(f32) -> bool) -> u32 {
        let mut bits = 0;
        for i in 0..LANES {
            bits |= u32::from(f(self.0[i])) << i;
        }
        bits
    }

    /// `a` where this is 0 or above, elsewhere `b`.
    #[inline(always)]
    pub(super) fn choose(self, a: Self, b: Self) -> Self {
        let mut out = b.0;
        for i in 0..LANES {
            out[i] = if self.0[i] >= 0.0 { a.0[i] } else { b.0[i] };
        }
        Self(out)
    }

    /// Square roots.
    #[inline(always)]
    pub(super) fn root(self) -> Self {
        self.each(f32::sqrt)
    }

    /// 1, or -1 for numbers below 0.
    #[inline(always)]
    pub(super) fn sign(self) -> Self {
        self.each(|v| if v < 0.0 { -1.0 } else { 1.0 })
    }
}

/// The first `n` lanes, as bits.
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
    /// The same in all lanes.
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
