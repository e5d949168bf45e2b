//! Matrix functions (reference 5.8.5) and products. A singular matrix has no inverse. The identity replaces it, and
//! an error is reported once.

use super::{compute, math};
use crate::program::Op;
use crate::run::machine::Machine;
use crate::run::store::{Out, View};
use granita_base::{Transform, Vec3};
use granita_gsl::Func;
use granita_gsl::ir::SymbolId;
use std::cell::Cell;

/// Returns the matrix of lane `i`.
pub(super) fn matrix_of(view: &View<'_>, i: usize) -> Transform {
    Transform::from_rows(&view.matrix_at(i))
}

/// Stores the matrix of lane `i`.
pub(super) fn set_matrix(out: &mut Out, i: usize, value: &Transform) {
    for (c, x) in value.to_rows().into_iter().enumerate() {
        out.set(c, i, x);
    }
}

/// Computes `a b`, or `a` times the inverse of `b`.
pub(super) fn product(m: &mut Machine<'_>, op: &Op, inverted: bool) {
    let singular = Cell::new(false);
    compute(m, op, 16, |m, out, work| {
        let (a, b) = (m.view(op.args[0]), m.view(op.args[1]));
        work.each(|i| {
            let right = matrix_of(&b, i);
            let right = if inverted { inverse(&right, &singular) } else { right };
            set_matrix(out, i, &matrix_of(&a, i).then(&right));
        });
    });
    if singular.get() {
        m.complain(op.at, "a singular matrix has no inverse");
    }
}

/// Returns the inverse, or the identity and sets `singular`.
pub(super) fn inverse(matrix: &Transform, singular: &Cell<bool>) -> Transform {
    matrix.try_inverse().unwrap_or_else(|| {
        singular.set(true);
        Transform::IDENTITY
    })
}

/// Returns a rotation about an axis, counter-clockwise seen against it (Rodrigues' formula), with sines that are
/// the same on every machine. Without an axis it is the identity.
pub(super) fn rotation(angle_rad: f32, axis: Vec3) -> Transform {
    let [x, y, z] = axis.to_array().map(f64::from);
    let length = (x * x + y * y + z * z).sqrt();
    // NaN is not an axis either.
    if !(length > 0.0 && length.is_finite()) {
        return Transform::IDENTITY;
    }
    let [x, y, z] = [x / length, y / length, z / length];
    let (s, c) = (libm::sin(f64::from(angle_rad)), libm::cos(f64::from(angle_rad)));
    let d = 1.0 - c;
    let rows = [
        [c + x * x * d, x * y * d + z * s, x * z * d - y * s, 0.0],
        [x * y * d - z * s, c + y * y * d, y * z * d + x * s, 0.0],
        [x * z * d + y * s, y * z * d - x * s, c + z * z * d, 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ];
    let mut list = [0.0; 16];
    for (to, from) in list.iter_mut().zip(rows.as_flattened()) {
        *to = *from as f32;
    }
    Transform::from_rows(&list)
}

/// Runs functions of matrices. The new transformation applies first, as those of the scene interface do.
pub(super) fn run(m: &mut Machine<'_>, func: Func, op: &Op) {
    match func {
        Func::Determinant => compute(m, op, 1, |m, out, work| {
            let a = m.view(op.args[0]);
            work.each(|i| out.set(0, i, matrix_of(&a, i).determinant()));
        }),
        Func::Transpose => prepend(m, op, |a, _, _| a.transpose()),
        Func::Translate => prepend(m, op, |a, t, _| Transform::translate(t).then(a)),
        Func::Scale => prepend(m, op, |a, t, _| Transform::scale(t).then(a)),
        // rotate (M, angle, axis)
        Func::Rotate => {
            let axis = op.args[2];
            prepend_with(m, op, axis, |a, axis, angle| rotation(angle, axis).then(a));
        }
        _ => math::run(m, func, op),
    }
}

/// Computes a matrix from a matrix and the triple after it.
fn prepend(m: &mut Machine<'_>, op: &Op, f: impl Fn(&Transform, Vec3, f32) -> Transform) {
    let triple = op.args[op.args.len().min(2) - 1];
    prepend_with(m, op, triple, f);
}

/// Computes a matrix from a matrix, a triple, and the second operand as a float.
fn prepend_with(
    m: &mut Machine<'_>,
    op: &Op,
    triple: SymbolId,
    f: impl Fn(&Transform, Vec3, f32) -> Transform,
) {
    compute(m, op, 16, |m, out, work| {
        let a = m.view(op.args[0]);
        let (t, x) = (m.view(triple).triple(), m.view(op.args[op.args.len().min(2) - 1]));
        work.each(|i| set_matrix(out, i, &f(&matrix_of(&a, i), t.get(i), x.get(i))));
    });
}
