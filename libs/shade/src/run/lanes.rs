//! The computations of the loops over lanes, by name. There is one function per shape of loop, so that each is
//! compiled once for every machine and once for wide vectors (see [`super::simd`]), with the same results.

use super::approx;
use super::kernel::{map1, map2, map3};
use crate::Lane;

/// Functions of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "each is the function of its name")]
pub(crate) enum Unary {
    Copy,
    Neg,
    Radians,
    Degrees,
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sinh,
    Cosh,
    Tanh,
    Exp,
    Log,
    Log2,
    Log10,
    Sqrt,
    InverseSqrt,
    /// One divided by a positive number; 0 for all others.
    Reciprocal,
    Abs,
    Sign,
    Floor,
    Ceil,
    Round,
    Trunc,
    IsNan,
    IsInf,
    Finite,
    Erf,
    Erfc,
}

/// Functions of two numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Binary {
    Add,
    Sub,
    Mul,
    Div,
    Lt,
    Le,
    Gt,
    Ge,
    Atan2,
    Pow,
    LogBase,
    Hypot,
    Mod,
    Min,
    Max,
    Step,
    /// 1 where both are equal, else 0.
    Eq,
}

/// Functions of three numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Ternary {
    Hypot,
    Clamp,
    Mix,
    SmoothStep,
    /// The second where the first is not 0, else the third.
    Select,
    /// `a b + c`, each rounded.
    MulAdd,
    /// `a b - c`, each rounded.
    MulSub,
    /// `c - a b`, each rounded.
    SubMul,
    /// `a b c`, from the left.
    MulMul,
}

/// Computes all lanes with `near`, then those that it does not support again with `far`.
#[inline(always)]
fn with_far(
    out: &mut [f32],
    a: Lane<'_>,
    known: impl Fn(f32) -> bool,
    near: impl Fn(f32) -> f32,
    far: impl Fn(f32) -> f32,
) {
    if a.stride == 0 {
        let x = a.values[0];
        return out.fill(if known(x) { near(x) } else { far(x) });
    }
    let mut all = true;
    for (o, &x) in out.iter_mut().zip(a.values) {
        *o = near(x);
        all &= known(x);
    }
    if !all {
        for (o, &x) in out.iter_mut().zip(a.values) {
            if !known(x) {
                *o = far(x);
            }
        }
    }
}

/// Does the same as [`with_far`] for two numbers.
#[inline(always)]
fn with_far2(
    out: &mut [f32],
    a: Lane<'_>,
    b: Lane<'_>,
    known: impl Fn(f32, f32) -> bool,
    near: impl Fn(f32, f32) -> f32,
    far: impl Fn(f32, f32) -> f32,
) {
    map2(out, a, b, &near);
    let n = if a.stride + b.stride == 0 { 1 } else { out.len() };
    let all = (0..n).fold(true, |all, i| all & known(a.get(i), b.get(i)));
    if all {
        return;
    }
    for (i, o) in out.iter_mut().enumerate() {
        let (x, y) = (a.get(i), b.get(i));
        if !known(x, y) {
            *o = far(x, y);
        }
    }
}

/// `out = f (a)` over all lanes.
#[inline(always)]
pub(crate) fn unary(f: Unary, out: &mut [f32], a: Lane<'_>) {
    use approx as x;
    match f {
        Unary::Copy => map1(out, a, |x| x),
        Unary::Neg => map1(out, a, |x| -x),
        Unary::Radians => map1(out, a, f32::to_radians),
        Unary::Degrees => map1(out, a, f32::to_degrees),
        Unary::Sin => with_far(out, a, x::turns_are_few, x::sin_near, libm::sinf),
        Unary::Cos => with_far(out, a, x::turns_are_few, x::cos_near, libm::cosf),
        Unary::Tan => with_far(out, a, x::turns_are_few, x::tan_near, libm::tanf),
        // clamp keeps NaN.
        Unary::Asin => map1(out, a, |v| x::asin_inside(v.clamp(-1.0, 1.0))),
        Unary::Acos => map1(out, a, |v| x::acos_inside(v.clamp(-1.0, 1.0))),
        Unary::Atan => map1(out, a, x::atan),
        Unary::Sinh => with_far(out, a, x::exp_is_near, x::sinh_near, libm::sinhf),
        Unary::Cosh => with_far(out, a, x::exp_is_near, x::cosh_near, libm::coshf),
        Unary::Tanh => map1(out, a, x::tanh),
        Unary::Exp => with_far(out, a, x::exp_is_near, x::exp_near, libm::expf),
        Unary::Log => with_far(out, a, x::is_ordinary, x::ln_ordinary, libm::logf),
        Unary::Log2 => with_far(out, a, x::is_ordinary, x::log2_ordinary, libm::log2f),
        Unary::Log10 => with_far(out, a, x::is_ordinary, x::log10_ordinary, libm::log10f),
        Unary::Sqrt => map1(out, a, f32::sqrt),
        Unary::InverseSqrt => map1(out, a, |v| 1.0 / v.sqrt()),
        Unary::Reciprocal => map1(out, a, |v| if v > 0.0 { 1.0 / v } else { 0.0 }),
        Unary::Abs => map1(out, a, f32::abs),
        Unary::Sign => map1(out, a, |v| f32::from(v > 0.0) - f32::from(v < 0.0)),
        Unary::Floor => map1(out, a, x::floor),
        Unary::Ceil => map1(out, a, |v| -x::floor(-v)),
        // Halves round away from zero. Adding a half to the number below a half would give 1.
        Unary::Round => map1(out, a, f32::round),
        Unary::Trunc => map1(out, a, |v| x::floor(v.abs()).copysign(v)),
        Unary::IsNan => map1(out, a, |v| f32::from(v.is_nan())),
        Unary::IsInf => map1(out, a, |v| f32::from(v == f32::INFINITY) - f32::from(v == f32::NEG_INFINITY)),
        Unary::Finite => map1(out, a, |v| f32::from(v.is_finite())),
        Unary::Erf => map1(out, a, x::erf),
        Unary::Erfc => map1(out, a, x::erfc),
    }
}

/// `out = f (a, b)` over all lanes.
#[inline(always)]
pub(crate) fn binary(f: Binary, out: &mut [f32], a: Lane<'_>, b: Lane<'_>) {
    use approx as x;
    match f {
        Binary::Add => map2(out, a, b, |x, y| x + y),
        Binary::Sub => map2(out, a, b, |x, y| x - y),
        Binary::Mul => map2(out, a, b, |x, y| x * y),
        Binary::Div => map2(out, a, b, |x, y| x / y),
        Binary::Lt => map2(out, a, b, |x, y| f32::from(x < y)),
        Binary::Le => map2(out, a, b, |x, y| f32::from(x <= y)),
        Binary::Gt => map2(out, a, b, |x, y| f32::from(x > y)),
        Binary::Ge => map2(out, a, b, |x, y| f32::from(x >= y)),
        Binary::Atan2 => with_far2(out, a, b, x::is_plain, x::atan2_plain, libm::atan2f),
        Binary::Pow => with_far2(out, a, b, x::pow_is_ordinary, x::pow_ordinary, libm::powf),
        Binary::LogBase => map2(out, a, b, |x, base| libm::logf(x) / libm::logf(base)),
        Binary::Hypot => map2(out, a, b, libm::hypotf),
        Binary::Mod => map2(out, a, b, |p, q| p - q * x::floor(p / q)),
        Binary::Min => map2(out, a, b, |x, y| if y < x { y } else { x }),
        Binary::Max => map2(out, a, b, |x, y| if y > x { y } else { x }),
        Binary::Step => map2(out, a, b, |edge, x| f32::from(x >= edge)),
        Binary::Eq => map2(out, a, b, |x, y| f32::from(x == y)),
    }
}

/// `out = f (a, b, c)` over all lanes.
#[inline(always)]
pub(crate) fn ternary(f: Ternary, out: &mut [f32], a: Lane<'_>, b: Lane<'_>, c: Lane<'_>) {
    match f {
        Ternary::Hypot => map3(out, a, b, c, |x, y, z| libm::hypotf(libm::hypotf(x, y), z)),
        Ternary::Clamp => map3(out, a, b, c, |x, low, high| {
            let x = if low > x { low } else { x };
            if high < x { high } else { x }
        }),
        Ternary::Mix => map3(out, a, b, c, |x, y, t| x * (1.0 - t) + y * t),
        Ternary::SmoothStep => map3(out, a, b, c, smoothstep),
        Ternary::Select => map3(out, a, b, c, |t, x, y| if t != 0.0 { x } else { y }),
        Ternary::MulAdd => map3(out, a, b, c, |x, y, z| x * y + z),
        Ternary::MulSub => map3(out, a, b, c, |x, y, z| x * y - z),
        Ternary::SubMul => map3(out, a, b, c, |x, y, z| z - x * y),
        Ternary::MulMul => map3(out, a, b, c, |x, y, z| x * y * z),
    }
}

pub(crate) use approx::pow;

/// Returns 0 up to `e0`, 1 from `e1`, and a cubic between.
#[inline(always)]
pub(crate) fn smoothstep(e0: f32, e1: f32, x: f32) -> f32 {
    let t = (x - e0) / (e1 - e0);
    let middle = t * t * (3.0 - 2.0 * t);
    let below = if x >= e1 { 1.0 } else { middle };
    if x <= e0 { 0.0 } else { below }
}

/// `out = |a|` of vectors.
#[inline(always)]
pub(super) fn length(out: &mut [f32], a: [Lane<'_>; 3]) {
    dot(out, a, a);
    out.iter_mut().for_each(|x| *x = x.sqrt());
}

/// The weights of red, green and blue in `luminance`, with the primaries of ITU-R BT.709 and white D65.
pub(crate) const LUMINANCE: [f32; 3] = [0.212_639, 0.715_168_7, 0.072_192_32];

/// `out = a . b`.
#[inline(always)]
pub(super) fn dot(out: &mut [f32], a: [Lane<'_>; 3], b: [Lane<'_>; 3]) {
    let all = |l: &Lane<'_>| l.stride == 1;
    if a.iter().all(all) && b.iter().all(all) {
        let n = out.len();
        let [ax, ay, az] = a.map(|l| &l.values[..n]);
        let [bx, by, bz] = b.map(|l| &l.values[..n]);
        for i in 0..n {
            out[i] = ax[i] * bx[i] + ay[i] * by[i] + az[i] * bz[i];
        }
        return;
    }
    map2(out, a[0], b[0], |x, y| x * y);
    for c in 1..3 {
        super::kernel::fold2(out, a[c], b[c], |o, x, y| o + x * y);
    }
}

/// Normalises vectors. A vector of zero or infinite length becomes zero.
#[inline(always)]
pub(super) fn normalize(out: [&mut [f32]; 3]) {
    let [x, y, z] = out;
    for ((x, y), z) in x.iter_mut().zip(y).zip(z) {
        let length = (*x * *x + *y * *y + *z * *z).sqrt();
        let scale = if length > 0.0 { 1.0 / length } else { 0.0 };
        *x *= scale;
        *y *= scale;
        *z *= scale;
    }
}
