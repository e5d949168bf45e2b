//! Mathematical functions (reference 5.8.2) and steps.

use super::{binary, compute, ternary, unary};
use crate::run::kernel::map3;
use crate::run::machine::Machine;
use granita_gsl::Func;
use granita_gsl::ir::Op;

/// Functions of numbers, component by component. The rules of IEEE hold where the reference says
/// nothing: `sqrt (-1)` is NaN, `log (0)` minus infinity.
pub(super) fn run(m: &mut Machine<'_>, func: Func, op: &Op) {
    match func {
        Func::Radians => unary(m, op, f32::to_radians),
        Func::Degrees => unary(m, op, f32::to_degrees),
        Func::Sin => unary(m, op, f32::sin),
        Func::Cos => unary(m, op, f32::cos),
        Func::Tan => unary(m, op, f32::tan),
        // clamp keeps NaN.
        Func::Asin => unary(m, op, |x| x.clamp(-1.0, 1.0).asin()),
        Func::Acos => unary(m, op, |x| x.clamp(-1.0, 1.0).acos()),
        Func::Atan if op.args.len() > 1 => binary(m, op, f32::atan2),
        Func::Atan => unary(m, op, f32::atan),
        Func::Sinh => unary(m, op, f32::sinh),
        Func::Cosh => unary(m, op, f32::cosh),
        Func::Tanh => unary(m, op, f32::tanh),
        Func::Pow => binary(m, op, f32::powf),
        Func::Exp => unary(m, op, f32::exp),
        Func::Log if op.args.len() > 1 => binary(m, op, |x, base| x.ln() / base.ln()),
        Func::Log => unary(m, op, f32::ln),
        Func::Log2 => unary(m, op, f32::log2),
        Func::Log10 => unary(m, op, f32::log10),
        Func::Sqrt => unary(m, op, f32::sqrt),
        Func::InverseSqrt => unary(m, op, |x| 1.0 / x.sqrt()),
        Func::Hypot if op.args.len() > 2 => ternary(m, op, |x, y, z| x.hypot(y).hypot(z)),
        Func::Hypot => binary(m, op, f32::hypot),
        Func::Abs | Func::Fabs => unary(m, op, f32::abs),
        Func::Sign => unary(m, op, |x| f32::from(x > 0.0) - f32::from(x < 0.0)),
        Func::Floor => unary(m, op, f32::floor),
        Func::Ceil => unary(m, op, f32::ceil),
        Func::Round => unary(m, op, f32::round),
        Func::Trunc => unary(m, op, f32::trunc),
        Func::Mod => binary(m, op, |a, b| a - b * (a / b).floor()),
        Func::Min => binary(m, op, |a, b| if b < a { b } else { a }),
        Func::Max => binary(m, op, |a, b| if b > a { b } else { a }),
        Func::Clamp => clamp(m, op),
        Func::Mix => mix(m, op),
        Func::IsNan => unary(m, op, |x| f32::from(x.is_nan())),
        Func::IsInf => unary(m, op, |x| f32::from(x == f32::INFINITY) - f32::from(x == f32::NEG_INFINITY)),
        Func::Finite => unary(m, op, |x| f32::from(x.is_finite())),
        Func::Erf => unary(m, op, libm::erff),
        Func::Erfc => unary(m, op, libm::erfcf),
        Func::Step => binary(m, op, |edge, x| f32::from(x >= edge)),
        Func::SmoothStep => ternary(m, op, smoothstep),
        _ => {
            m.missing(func.word());
            super::zero(m, op);
        }
    }
}

/// 0 up to `e0`, 1 from `e1`, a cubic between.
pub(super) fn smoothstep(e0: f32, e1: f32, x: f32) -> f32 {
    if x <= e0 {
        0.0
    } else if x >= e1 {
        1.0
    } else {
        let t = (x - e0) / (e1 - e0);
        t * t * (3.0 - 2.0 * t)
    }
}

/// `min (max (x, low), high)`.
fn clamp(m: &mut Machine<'_>, op: &Op) {
    ternary(m, op, |x, low, high| {
        let x = if low > x { low } else { x };
        if high < x { high } else { x }
    });
}

/// `x (1 - alpha) + y alpha`, of matrices too.
fn mix(m: &mut Machine<'_>, op: &Op) {
    let Some(ty) = super::result_type(m, op) else { return };
    compute(m, op, ty.components(), |m, out, _| {
        let (x, y, alpha) = (m.view(op.args[0]), m.view(op.args[1]), m.view(op.args[2]).lane(0));
        for c in 0..ty.components() {
            let (x, y) = (super::component(&x, c, ty), super::component(&y, c, ty));
            map3(out.part(c), x, y, alpha, |x, y, a| x * (1.0 - a) + y * a);
        }
    });
}
