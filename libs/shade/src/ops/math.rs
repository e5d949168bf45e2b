//! Mathematical functions (reference 5.8.2) and steps.

use super::{binary, ternary, unary};
use crate::program::Op;
use crate::run::lanes::{Binary as B, Ternary as T, Unary as U};
use crate::run::machine::Machine;
use granita_gsl::Func;

/// Runs functions of numbers, component by component. The rules of IEEE apply where the reference has none: `sqrt
/// (-1)` is NaN, `log (0)` minus infinity.
pub(super) fn run(m: &mut Machine<'_>, func: Func, op: &Op) {
    match func {
        Func::Radians => unary(m, op, U::Radians),
        Func::Degrees => unary(m, op, U::Degrees),
        Func::Sin => unary(m, op, U::Sin),
        Func::Cos => unary(m, op, U::Cos),
        Func::Tan => unary(m, op, U::Tan),
        Func::Asin => unary(m, op, U::Asin),
        Func::Acos => unary(m, op, U::Acos),
        Func::Atan if op.args.len() > 1 => binary(m, op, B::Atan2),
        Func::Atan => unary(m, op, U::Atan),
        Func::Sinh => unary(m, op, U::Sinh),
        Func::Cosh => unary(m, op, U::Cosh),
        Func::Tanh => unary(m, op, U::Tanh),
        Func::Pow => binary(m, op, B::Pow),
        Func::Exp => unary(m, op, U::Exp),
        Func::Log if op.args.len() > 1 => binary(m, op, B::LogBase),
        Func::Log => unary(m, op, U::Log),
        Func::Log2 => unary(m, op, U::Log2),
        Func::Log10 => unary(m, op, U::Log10),
        Func::Sqrt => unary(m, op, U::Sqrt),
        Func::InverseSqrt => unary(m, op, U::InverseSqrt),
        Func::Hypot if op.args.len() > 2 => ternary(m, op, T::Hypot),
        Func::Hypot => binary(m, op, B::Hypot),
        Func::Abs | Func::Fabs => unary(m, op, U::Abs),
        Func::Sign => unary(m, op, U::Sign),
        Func::Floor => unary(m, op, U::Floor),
        Func::Ceil => unary(m, op, U::Ceil),
        Func::Round => unary(m, op, U::Round),
        Func::Trunc => unary(m, op, U::Trunc),
        Func::Mod => binary(m, op, B::Mod),
        Func::Min => binary(m, op, B::Min),
        Func::Max => binary(m, op, B::Max),
        Func::Clamp => ternary(m, op, T::Clamp),
        Func::Mix => ternary(m, op, T::Mix),
        Func::IsNan => unary(m, op, U::IsNan),
        Func::IsInf => unary(m, op, U::IsInf),
        Func::Finite => unary(m, op, U::Finite),
        Func::Erf => unary(m, op, U::Erf),
        Func::Erfc => unary(m, op, U::Erfc),
        Func::Step => binary(m, op, B::Step),
        Func::SmoothStep => ternary(m, op, T::SmoothStep),
        _ => {
            m.missing(func.word());
            super::zero(m, op);
        }
    }
}
