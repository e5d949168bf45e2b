//! Folds expressions of constants to constants.

use crate::hir::{Expr, ExprKind, Link, Operator};
use crate::ir::{ConstValue, OpCode, SymbolType, ValueType};
use crate::source::Pos;
use std::sync::Arc;

pub(crate) fn number(value: f32, pos: Pos) -> Expr {
    let kind = ExprKind::Const(ConstValue::Floats([value].into()));
    Expr { ty: SymbolType::of(ValueType::Float), kind, pos }
}

pub(crate) fn floats(expr: &Expr) -> Option<&[f32]> {
    match &expr.kind {
        ExprKind::Const(ConstValue::Floats(v)) => Some(v),
        _ => None,
    }
}

/// Converts where [`conversion`] permits it. Point-like types stay unchanged.
pub(crate) fn convert(value: Expr, ty: ValueType) -> Expr {
    if value.ty.value.components() == ty.components() || value.ty.array.is_some() {
        return value;
    }
    let pos = value.pos;
    fold(Expr { ty: SymbolType::of(ty), kind: ExprKind::Convert(Box::new(value)), pos })
}

/// Spreads `n` floats over the components of a type. A single one is replicated, or fills a diagonal.
pub(crate) fn spread(v: &[f32], ty: ValueType) -> Option<Vec<f32>> {
    let n = ty.components();
    match v.len() {
        len if len == n => Some(v.to_vec()),
        1 if ty == ValueType::Matrix => Some((0..16).map(|i| if i % 5 == 0 { v[0] } else { 0.0 }).collect()),
        1 => Some(vec![v[0]; n]),
        _ => None,
    }
}

/// Returns an expression of constants as a constant.
pub(crate) fn fold(expr: Expr) -> Expr {
    let ty = expr.ty.value;
    let value: Option<Vec<f32>> = match &expr.kind {
        ExprKind::Unary(OpCode::Neg, a) => floats(a).map(|a| a.iter().map(|x| -x).collect()),
        ExprKind::Convert(a) => floats(a).and_then(|a| spread(a, ty)),
        ExprKind::Construct { space: None, parts } => {
            let parts: Option<Vec<f32>> = parts.iter().map(|p| floats(p).map(|v| v[0])).collect();
            parts.and_then(|p| spread(&p, ty))
        }
        ExprKind::Chain(a, links) if ty != ValueType::Matrix => match &links[..] {
            [Link { left: None, operator: Operator::Op(op), right, .. }] => {
                floats(a).zip(floats(right)).and_then(|(a, b)| arithmetic(*op, a, b, ty))
            }
            _ => None,
        },
        _ => None,
    };
    match value {
        Some(v) => Expr { kind: ExprKind::Const(ConstValue::Floats(Arc::from(v))), ..expr },
        None => expr,
    }
}

/// Returns `a op b`, component by component; `None` for a result that is not finite, which the executor reports.
fn arithmetic(op: OpCode, a: &[f32], b: &[f32], ty: ValueType) -> Option<Vec<f32>> {
    let f = match op {
        OpCode::Add => |a, b| a + b,
        OpCode::Sub => |a, b| a - b,
        OpCode::Mul => |a, b| a * b,
        OpCode::Div => |a: f32, b: f32| a / b,
        _ => return None,
    };
    let (a, b) = spread(a, ty).zip(spread(b, ty))?;
    let all: Vec<f32> = a.iter().zip(&b).map(|(a, b)| f(*a, *b)).collect();
    all.iter().all(|x| x.is_finite()).then_some(all)
}
