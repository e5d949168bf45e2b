//! Vectors of eight numbers with operators.

use granita_machine::simd::{Simd, WIDE};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// The number of lanes.
pub(super) const LANES: usize = WIDE;

/// One number for each of eight samples, in a vector of the machine. Compilers would combine numbers of different
/// arrays in one vector, or leave them in none.
#[derive(Clone, Copy)]
pub(super) struct Lanes<S: Simd> {
    simd: S,
    lanes: S::F8,
}

impl<S: Simd> Lanes<S> {
    #[inline(always)]
    pub(super) fn splat(simd: S, v: f32) -> Self {
        Self { simd, lanes: simd.splat8(v) }
    }

    #[inline(always)]
    pub(super) fn new(simd: S, numbers: &[f32; LANES]) -> Self {
        Self { simd, lanes: simd.load8(numbers) }
    }

    /// Loads the numbers from index `at` on.
    #[inline(always)]
    pub(super) fn load(simd: S, list: &[f32], at: usize) -> Self {
        Self::new(simd, list[at..at + LANES].first_chunk().unwrap_or(&[0.0; LANES]))
    }

    /// Loads numbers from their bits.
    #[inline(always)]
    pub(super) fn from_bits(simd: S, bits: &[u32; LANES]) -> Self {
        Self { simd, lanes: simd.bits8(bits) }
    }

    /// Returns the numbers.
    #[inline(always)]
    pub(super) fn numbers(self) -> [f32; LANES] {
        self.simd.store8(self.lanes)
    }

    #[inline(always)]
    fn with(self, lanes: S::F8) -> Self {
        Self { lanes, ..self }
    }

    /// Returns the lesser number of each lane. A NaN of `b` stays.
    #[inline(always)]
    pub(super) fn min(self, b: Self) -> Self {
        self.with(self.simd.min8(self.lanes, b.lanes))
    }

    /// Returns the greater number of each lane. A NaN of `b` stays.
    #[inline(always)]
    pub(super) fn max(self, b: Self) -> Self {
        self.with(self.simd.max8(self.lanes, b.lanes))
    }

    /// Returns the number of a lane.
    #[inline(always)]
    pub(super) fn lane(self, lane: usize) -> f32 {
        self.numbers()[lane]
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
        let mut lanes = self.numbers();
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
        self.with(self.simd.choose8(self.lanes, a.lanes, b.lanes))
    }

    /// Returns the square roots.
    #[inline(always)]
    pub(super) fn root(self) -> Self {
        self.with(self.simd.sqrt8(self.lanes))
    }

    /// Returns 1 in lanes that are 0 or above, and -1 in the others.
    #[inline(always)]
    pub(super) fn sign(self) -> Self {
        self.choose(Self::splat(self.simd, 1.0), Self::splat(self.simd, -1.0))
    }

    /// Returns the lanes below those of `b` as bits, without those with NaN.
    #[inline(always)]
    pub(super) fn below(self, b: Self) -> u32 {
        self.simd.lt8(self.lanes, b.lanes)
    }

    /// Returns the lanes above 0 as bits.
    #[inline(always)]
    pub(super) fn positive(self) -> u32 {
        Self::splat(self.simd, 0.0).below(self)
    }

    /// Returns the lanes that are 0 or above as bits.
    #[inline(always)]
    pub(super) fn not_negative(self) -> u32 {
        self.simd.le8(self.simd.splat8(0.0), self.lanes)
    }

    /// Moves the lanes whose bits are set in `mask` to the front, in order. The other lanes have any values.
    #[inline(always)]
    pub(super) fn pack(self, mask: u32) -> Self {
        self.with(self.simd.pack8(self.lanes, mask))
    }
}

/// Returns the first `n` lanes as bits.
#[inline(always)]
pub(super) fn first_lanes(n: usize) -> u32 {
    if n >= LANES { (1 << LANES) - 1 } else { (1 << n) - 1 }
}

macro_rules! operator {
    ($trait:ident, $name:ident, $of_lanes:ident) => {
        impl<S: Simd> $trait for Lanes<S> {
            type Output = Self;
            #[inline(always)]
            fn $name(self, b: Self) -> Self {
                self.with(self.simd.$of_lanes(self.lanes, b.lanes))
            }
        }
        impl<S: Simd> $trait<f32> for Lanes<S> {
            type Output = Self;
            #[inline(always)]
            fn $name(self, b: f32) -> Self {
                self.with(self.simd.$of_lanes(self.lanes, self.simd.splat8(b)))
            }
        }
    };
}

operator!(Add, add, add8);
operator!(Sub, sub, sub8);
operator!(Mul, mul, mul8);
operator!(Div, div, div8);

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.with(self.simd.neg8(self.lanes))
    }
}

/// A point or direction in each lane.
#[derive(Clone, Copy)]
pub(super) struct Points<S: Simd> {
    pub(super) x: Lanes<S>,
    pub(super) y: Lanes<S>,
    pub(super) z: Lanes<S>,
}

impl<S: Simd> Points<S> {
    /// Returns the same point in all lanes.
    #[inline(always)]
    pub(super) fn splat(simd: S, p: granita_base::Vec3) -> Self {
        Self { x: Lanes::splat(simd, p.x), y: Lanes::splat(simd, p.y), z: Lanes::splat(simd, p.z) }
    }

    /// Returns the points with these x, y and z.
    #[inline(always)]
    pub(super) fn new(simd: S, [x, y, z]: &[[f32; LANES]; 3]) -> Self {
        Self { x: Lanes::new(simd, x), y: Lanes::new(simd, y), z: Lanes::new(simd, z) }
    }

    /// Returns itself in lanes in which `which` is 0 or above, and `other` in the others.
    #[inline(always)]
    pub(super) fn or(&self, which: Lanes<S>, other: &Self) -> Self {
        Self {
            x: which.choose(self.x, other.x),
            y: which.choose(self.y, other.y),
            z: which.choose(self.z, other.z),
        }
    }

    /// Returns the lesser coordinates.
    #[inline(always)]
    pub(super) fn min(&self, b: &Self) -> Self {
        Self { x: self.x.min(b.x), y: self.y.min(b.y), z: self.z.min(b.z) }
    }

    /// Returns the greater coordinates.
    #[inline(always)]
    pub(super) fn max(&self, b: &Self) -> Self {
        Self { x: self.x.max(b.x), y: self.y.max(b.y), z: self.z.max(b.z) }
    }

    /// Returns the point of a lane.
    #[inline(always)]
    pub(super) fn lane(&self, lane: usize) -> granita_base::Vec3 {
        granita_base::Vec3::new(self.x.lane(lane), self.y.lane(lane), self.z.lane(lane))
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
    pub(super) fn dot(&self, b: &Self) -> Lanes<S> {
        self.x * b.x + self.y * b.y + self.z * b.z
    }
}
