//! Defaults of parameters that are available without running the shader.

use super::constant_list;
use crate::hir::{self, ExprKind, Init};
use crate::ir::{ConstValue, DefaultValue, SymbolType, ValueType};
use std::sync::Arc;

/// Returns the space of a constant, if it is named, and the numbers as they were written.
fn spaced(expr: &hir::Expr) -> Option<(Option<Arc<str>>, Vec<f32>)> {
    match &expr.kind {
        ExprKind::Const(ConstValue::Floats(v)) => Some((None, v.to_vec())),
        ExprKind::Construct { space: Some(space), parts } => {
            let ExprKind::Const(ConstValue::Strings(space)) = &space.kind else { return None };
            let mut numbers = Vec::new();
            for part in parts {
                let ExprKind::Const(ConstValue::Floats(v)) = &part.kind else { return None };
                numbers.push(v[0]);
            }
            if numbers.len() == 1 {
                let n = numbers[0];
                numbers = match expr.ty.value {
                    ValueType::Matrix => (0..16).map(|i| if i % 5 == 0 { n } else { 0.0 }).collect(),
                    other => vec![n; other.components()],
                };
            }
            Some((Some(space[0].clone()), numbers))
        }
        _ => None,
    }
}

/// Returns a default that needs no computation. Elements of an array may be in different spaces.
pub(super) fn default_value(init: &Init, ty: SymbolType) -> DefaultValue {
    let list = match init {
        Init::None => return DefaultValue::Unknown,
        Init::One(expr) => std::slice::from_ref(expr),
        Init::List(list) => list,
    };
    if ty.value == ValueType::String {
        return match constant_list(list) {
            Some(value @ ConstValue::Strings(_)) => DefaultValue::Known { spaces: Vec::new(), value },
            _ if list.is_empty() => {
                DefaultValue::Known { spaces: Vec::new(), value: ConstValue::Strings(Arc::from([])) }
            }
            _ => DefaultValue::Unknown,
        };
    }
    let mut all = Vec::new();
    let mut spaces: Vec<Arc<str>> = Vec::new();
    for expr in list {
        let Some((space, numbers)) = spaced(expr) else { return DefaultValue::Unknown };
        spaces.push(space.unwrap_or_default());
        all.extend(numbers);
    }
    if spaces.windows(2).all(|pair| pair[0] == pair[1]) {
        spaces.truncate(1);
        spaces.retain(|space| !space.is_empty());
    }
    DefaultValue::Known { spaces, value: ConstValue::Floats(all.into()) }
}
