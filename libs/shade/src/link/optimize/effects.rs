//! Classifies the side effects of operations.

use super::blocks;
use crate::program::{Block, Op, Operation, Stmt};
use granita_gsl::Func;
use granita_gsl::ir::{OpCode, Symbol, SymbolId, SymbolKind, ValueType};

/// How far an operation may be moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Effect {
    /// The result follows from the operands alone.
    Pure,
    /// The result follows from the operands and the grid, at any position in the code.
    Steady,
    /// The result follows from the operands of all active lanes.
    Neighbours,
    /// The operation must run exactly as often and in the order as written.
    Bound,
}

/// Returns the effect of an operation.
pub(crate) fn effect(op: &Op, symbols: &[Symbol]) -> Effect {
    let ty = |s: &SymbolId| symbols[s.0 as usize].ty.value;
    let Operation::Stored(code) = op.code else { return Effect::Pure };
    match code {
        OpCode::Construct => {
            let named = op.args.first().is_some_and(|s| ty(s) == ValueType::String);
            let color = op.dst.is_some_and(|d| ty(&d) == ValueType::Color);
            if named && !color { Effect::Steady } else { Effect::Pure }
        }
        OpCode::Call(func) => call(func, op, &ty),
        _ => Effect::Pure,
    }
}

fn call(func: Func, op: &Op, ty: &dyn Fn(&SymbolId) -> ValueType) -> Effect {
    use Func as F;
    match func {
        F::Radians | F::Degrees | F::Sin | F::Cos | F::Tan | F::Asin | F::Acos | F::Atan | F::Sinh => {
            Effect::Pure
        }
        F::Cosh | F::Tanh | F::Pow | F::Exp | F::Log | F::Log2 | F::Log10 | F::Sqrt => Effect::Pure,
        F::InverseSqrt | F::Hypot | F::Abs | F::Fabs | F::Sign | F::Floor | F::Ceil | F::Round => {
            Effect::Pure
        }
        F::Trunc | F::Mod | F::Min | F::Max | F::Clamp | F::Mix | F::IsNan | F::IsInf => Effect::Pure,
        F::Finite | F::Erf | F::Erfc | F::Dot | F::Cross | F::Length | F::Distance => Effect::Pure,
        F::Normalize | F::Reflect | F::Refract | F::Rotate | F::Luminance | F::TransformC => Effect::Pure,
        F::Determinant | F::Transpose | F::Translate | F::Scale | F::Step | F::SmoothStep => Effect::Pure,
        F::Noise | F::SNoise | F::CNoise | F::PNoise | F::PSNoise | F::PNNoise | F::Spline => Effect::Pure,
        F::Concat | F::Match | F::Substr | F::Format | F::SpecularBrdf => Effect::Pure,
        // Without an argument, it returns the next number of a sequence. Without a reference, it uses the geometric
        // normal.
        F::Random if !op.args.is_empty() => Effect::Pure,
        F::FaceForward if op.args.len() > 2 => Effect::Pure,
        F::Transform | F::TransformV | F::TransformN
            if op.args.iter().all(|s| ty(s) != ValueType::String) =>
        {
            Effect::Pure
        }
        F::Transform | F::TransformV | F::TransformN | F::TransformU => Effect::Steady,
        F::GridN | F::GridNU | F::GridNV | F::GridIndex | F::ArrayLength => Effect::Steady,
        F::RayLevel | F::IsShadowRay | F::IsIndirectRay => Effect::Steady,
        F::FaceForward | F::DeltaU | F::DeltaV | F::FilterWidth | F::SurfaceNormal | F::SampleArea => {
            Effect::Neighbours
        }
        F::AaStep | F::GridAny | F::GridMin | F::GridMax => Effect::Neighbours,
        _ => Effect::Bound,
    }
}

/// True when an operation may report an error for unusual operands.
pub(super) fn may_complain(op: &Op, symbols: &[Symbol]) -> bool {
    let matrix = |s: &SymbolId| symbols[s.0 as usize].ty.value == ValueType::Matrix;
    let Operation::Stored(code) = op.code else { return false };
    match code {
        OpCode::Index | OpCode::IndexSet | OpCode::Component | OpCode::ComponentSet => true,
        OpCode::MatrixComponent | OpCode::MatrixComponentSet => true,
        OpCode::Div => op.args.iter().any(matrix),
        OpCode::Construct => symbols[op.args[0].0 as usize].ty.value == ValueType::String,
        OpCode::Call(func) => matches!(
            func,
            Func::Match
                | Func::Spline
                | Func::TransformC
                | Func::TransformN
                | Func::Transform
                | Func::TransformV
        ),
        _ => false,
    }
}

/// Returns the index of the first operand that a function may write.
pub(crate) fn first_written(op: &Op) -> usize {
    let Some(func) = op.func() else { return usize::MAX };
    match func {
        Func::Fresnel | Func::Texture | Func::Texture3d | Func::Environment | Func::Shadow => 3,
        Func::Occlusion => 4,
        Func::SpatialDbQuery | Func::GetMessage | Func::GetTextureInfo => 2,
        Func::GetAttribute | Func::Shadeop => 1,
        _ => usize::MAX,
    }
}

/// True when a result replaces only a part of the value of its symbol.
pub(crate) fn is_partial(op: &Op, symbols: &[Symbol]) -> bool {
    let elements = |s: &SymbolId| symbols[s.0 as usize].ty.elements();
    let Operation::Stored(code) = op.code else { return false };
    match code {
        OpCode::IndexSet | OpCode::ComponentSet | OpCode::MatrixComponentSet => true,
        OpCode::Assign => op.dst.is_some_and(|d| elements(&d) != elements(&op.args[0])),
        _ => false,
    }
}

/// True when an operation may change globals that are not operands.
pub(super) fn writes_globals(op: &Op) -> bool {
    matches!(op.func(), Some(Func::Displace | Func::Bump))
}

/// Calls `f` for each symbol that a statement or the code inside of it may write.
pub(crate) fn written(stmt: &Stmt, symbols: &[Symbol], f: &mut dyn FnMut(SymbolId)) {
    let mut globals = matches!(stmt, Stmt::Lights { .. } | Stmt::Emit { .. } | Stmt::Trace { .. });
    if let Stmt::Op(op) = stmt {
        op.dst.into_iter().for_each(&mut *f);
        op.args.iter().skip(first_written(op)).for_each(|&s| f(s));
        globals |= writes_globals(op);
    }
    if globals {
        for (k, symbol) in symbols.iter().enumerate() {
            if matches!(symbol.kind, SymbolKind::Global(_)) {
                f(SymbolId(k as u32));
            }
        }
    }
    for block in blocks(stmt) {
        block.iter().for_each(|stmt| written(stmt, symbols, f));
    }
}

/// True when code only computes its own parameters, and neither reports, draws random numbers, queries nor sends
/// messages.
pub(crate) fn is_inert(block: &Block, symbols: &[Symbol]) -> bool {
    block.iter().all(|stmt| match stmt {
        Stmt::Op(op) => {
            let global = |s: &SymbolId| matches!(symbols[s.0 as usize].kind, SymbolKind::Global(_));
            effect(op, symbols) < Effect::Bound && !op.dst.iter().any(global)
        }
        Stmt::Lights { .. } | Stmt::Emit { .. } | Stmt::Trace { .. } => false,
        other => blocks(other).into_iter().all(|b| is_inert(b, symbols)),
    })
}
