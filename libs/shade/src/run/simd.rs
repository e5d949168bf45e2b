//! The loops over lanes, compiled for the widest vectors of the machine. All variants do the same arithmetic in the
//! same order, so that the results are the same to the bit. A test compares them. `benches/shading` measures the
//! gain.

use super::gather::Gather;
use super::lanes::{self, Binary, Ternary, Unary};
use super::noise_lanes::{self, NoiseTask};
use crate::tape::{NARROW, Strips, WIDE, strips};
use crate::{Lane, LightSample};
use granita_machine::widest;

/// `out = f (a)`.
#[inline]
pub(crate) fn unary(f: Unary, out: &mut [f32], a: Lane<'_>) {
    widest!(lanes::unary(f, out, a));
}

/// `out = f (a, b)`.
#[inline]
pub(crate) fn binary(f: Binary, out: &mut [f32], a: Lane<'_>, b: Lane<'_>) {
    widest!(lanes::binary(f, out, a, b));
}

/// `out = f (a, b, c)`.
#[inline]
pub(crate) fn ternary(f: Ternary, out: &mut [f32], a: Lane<'_>, b: Lane<'_>, c: Lane<'_>) {
    widest!(lanes::ternary(f, out, a, b, c));
}

/// `out = a . b`.
#[inline]
pub(crate) fn dot(out: &mut [f32], a: [Lane<'_>; 3], b: [Lane<'_>; 3]) {
    widest!(lanes::dot(out, a, b));
}

/// `out = |a|`.
#[inline]
pub(crate) fn length(out: &mut [f32], a: [Lane<'_>; 3]) {
    widest!(lanes::length(out, a));
}

/// Normalises vectors.
#[inline]
pub(crate) fn normalize(out: [&mut [f32]; 3]) {
    widest!(lanes::normalize(out));
}

/// Runs a tape over wide strips.
#[inline]
pub(crate) fn strips_wide(task: &mut Strips<'_>, from: usize, to: usize) {
    widest!(strips::<WIDE>(task, from, to));
}

/// Runs a tape over narrow strips.
#[inline]
pub(crate) fn strips_narrow(task: &mut Strips<'_>, from: usize, to: usize) {
    widest!(strips::<NARROW>(task, from, to));
}

/// Adds the light of a sample to the sums of `diffuse` or `specular`.
#[inline]
pub(crate) fn gather(to: &Gather<'_>, sample: &LightSample, without: &[f32], sums: &mut [&mut [f32]; 3]) {
    widest!(super::gather::gather(to, sample, without, sums));
}

/// Computes noise.
#[inline]
pub(crate) fn noise(task: &NoiseTask<'_>, component: u32, out: &mut [f32]) {
    widest!(noise_lanes::noise(task, component, out));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ordinary numbers and all kinds of others.
    fn numbers() -> Vec<f32> {
        let mut list: Vec<f32> = (0..997).map(|k| (k as f32 - 500.0) * 0.0173).collect();
        list.extend([
            0.0,
            -0.0,
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            1e30,
            -1e30,
            1e-30,
            -1e-40,
            16_777_216.0,
        ]);
        list.extend([0.5, -0.5, 1.0, -1.0, 2.0, 88.9, -104.0, 9000.0, -9000.0, f32::MAX, f32::MIN_POSITIVE]);
        list
    }

    fn bits(v: &[f32]) -> Vec<u32> {
        v.iter().map(|x| if x.is_nan() { u32::MAX } else { x.to_bits() }).collect()
    }

    #[test]
    fn wide_narrow_and_single_lanes_agree_to_the_bit() {
        let x = numbers();
        let y: Vec<f32> = x.iter().rev().copied().collect();
        let z: Vec<f32> = x.iter().map(|v| v * 0.25).collect();
        let lane = |v| Lane { values: v, stride: 1 };
        let one = |v| Lane { values: v, stride: 0 };
        let (mut a, mut b, mut c) = (x.clone(), x.clone(), [0.0]);
        let unaries = [
            Unary::Copy,
            Unary::Neg,
            Unary::Radians,
            Unary::Degrees,
            Unary::Sin,
            Unary::Cos,
            Unary::Tan,
            Unary::Asin,
            Unary::Acos,
            Unary::Atan,
            Unary::Sinh,
            Unary::Cosh,
            Unary::Tanh,
            Unary::Exp,
            Unary::Log,
            Unary::Log2,
            Unary::Log10,
            Unary::Sqrt,
            Unary::InverseSqrt,
            Unary::Reciprocal,
            Unary::Abs,
            Unary::Sign,
            Unary::Floor,
            Unary::Ceil,
            Unary::Round,
            Unary::Trunc,
            Unary::IsNan,
            Unary::IsInf,
            Unary::Finite,
            Unary::Erf,
            Unary::Erfc,
        ];
        for f in unaries {
            unary(f, &mut a, lane(&x));
            lanes::unary(f, &mut b, lane(&x));
            assert_eq!(bits(&a), bits(&b), "{f:?}");
            for (k, v) in x.iter().enumerate() {
                unary(f, &mut c, one(&x[k..=k]));
                assert_eq!(bits(&c), bits(&a[k..=k]), "{f:?} of {v}");
            }
        }
        let binaries = [
            Binary::Add,
            Binary::Sub,
            Binary::Mul,
            Binary::Div,
            Binary::Lt,
            Binary::Le,
            Binary::Gt,
            Binary::Ge,
            Binary::Atan2,
            Binary::Pow,
            Binary::LogBase,
            Binary::Hypot,
            Binary::Mod,
            Binary::Min,
            Binary::Max,
            Binary::Step,
            Binary::Eq,
        ];
        for f in binaries {
            binary(f, &mut a, lane(&x), lane(&y));
            lanes::binary(f, &mut b, lane(&x), lane(&y));
            assert_eq!(bits(&a), bits(&b), "{f:?}");
            for k in 0..x.len() {
                binary(f, &mut c, one(&x[k..=k]), one(&y[k..=k]));
                assert_eq!(bits(&c), bits(&a[k..=k]), "{f:?} of {} {}", x[k], y[k]);
            }
        }
        let ternaries = [
            Ternary::Hypot,
            Ternary::Clamp,
            Ternary::Mix,
            Ternary::SmoothStep,
            Ternary::Select,
            Ternary::MulAdd,
            Ternary::MulSub,
            Ternary::SubMul,
            Ternary::MulMul,
        ];
        for f in ternaries {
            ternary(f, &mut a, lane(&x), lane(&y), lane(&z));
            lanes::ternary(f, &mut b, lane(&x), lane(&y), lane(&z));
            assert_eq!(bits(&a), bits(&b), "{f:?}");
        }
        let v = [lane(&x), lane(&y), lane(&z)];
        length(&mut a, v);
        lanes::length(&mut b, v);
        assert_eq!(bits(&a), bits(&b));
    }
}
