//! Values in named coordinate systems: transformations, constructors, units (reference 5.8.3).

use super::matrix::{inverse, matrix_of, set_matrix};
use super::{color, compute, compute_as, part_lane};
use crate::program::Op;
use crate::run::kernel::map1;
use crate::run::machine::Machine;
use crate::run::strings::StringId;
use granita_base::{Transform, Vec3};
use granita_gsl::Func;
use granita_gsl::ir::{SourcePos, SymbolId, ValueType};
use std::cell::Cell;

/// The kind of triple that is transformed.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Point,
    Vector,
    Normal,
}

impl Kind {
    fn apply(self, m: &Transform, normals: &Transform, v: Vec3) -> Vec3 {
        match self {
            Self::Point => m.point(v),
            Self::Vector => m.vector(v),
            Self::Normal => normals.vector(v),
        }
    }

    /// Returns the matrix for normals, if needed.
    fn normals(self, m: &Transform) -> Transform {
        if self == Self::Normal { m.normal_matrix() } else { Transform::IDENTITY }
    }
}

impl Machine<'_> {
    /// Returns the matrix from the current layer's "shader" space to "common" space, unless it is the identity.
    pub(crate) fn shader_space(&mut self) -> Option<Transform> {
        let id = self.intern("shader");
        self.space(id).filter(|m| *m != Transform::IDENTITY)
    }

    /// Returns the matrix from a named space to "common", requested once per run.
    fn space(&mut self, name: StringId) -> Option<Transform> {
        let layer = self.layer;
        if let Some(known) = self.st.spaces.iter().find(|(id, l, _)| *id == name && *l == layer) {
            return known.2;
        }
        let text = self.text(name).clone();
        let found = if &*text == "common" {
            Some(Transform::IDENTITY)
        } else {
            self.services.to_common(&text, layer)
        };
        self.st.spaces.push((name, layer, found));
        found
    }

    /// Does the same as [`Machine::space`], but an unknown name is an error and stands for "common".
    fn known_space(&mut self, name: StringId, at: SourcePos) -> Transform {
        self.space(name).unwrap_or_else(|| {
            let text = self.text(name).clone();
            self.complain(at, &format!("there is no coordinate system \"{text}\""));
            Transform::IDENTITY
        })
    }
}

/// Runs `transform`, `transformv`, `transformn` in all their forms.
pub(super) fn transform(m: &mut Machine<'_>, func: Func, op: &Op) {
    let kind = match func {
        Func::TransformV => Kind::Vector,
        Func::TransformN => Kind::Normal,
        _ => Kind::Point,
    };
    let (value, spaces) = op.args.split_last().expect("invariant: linking checked the operands");
    let strings = |m: &Machine<'_>, s: SymbolId| m.type_of(s) == ValueType::String;
    match *spaces {
        // By a matrix.
        [by] if !strings(m, by) => {
            by_matrices(m, op, kind, *value, |_, i, view| matrix_of(&view[0], i), &[by])
        }
        [to] => {
            let to = named(m, to, op.at);
            let singular = Cell::new(false);
            let matrix = inverse(&to, &singular);
            by_one(m, op, kind, *value, &matrix, singular.get());
        }
        [from, to, ..] => match (strings(m, from), strings(m, to)) {
            (true, true) => {
                let (from, to) = (named(m, from, op.at), named(m, to, op.at));
                let singular = Cell::new(false);
                let matrix = from.then(&inverse(&to, &singular));
                by_one(m, op, kind, *value, &matrix, singular.get());
            }
            (true, false) => {
                let from = named(m, from, op.at);
                by_matrices(
                    m,
                    op,
                    kind,
                    *value,
                    move |s, i, v| from.then(&inverse(&matrix_of(&v[0], i), s)),
                    &[to],
                );
            }
            (false, true) => {
                let to = named(m, to, op.at);
                by_matrices(
                    m,
                    op,
                    kind,
                    *value,
                    move |s, i, v| matrix_of(&v[0], i).then(&inverse(&to, s)),
                    &[from],
                );
            }
            (false, false) => by_matrices(
                m,
                op,
                kind,
                *value,
                |s, i, v| matrix_of(&v[0], i).then(&inverse(&matrix_of(&v[1], i), s)),
                &[from, to],
            ),
        },
        [] => {}
    }
}

/// Returns the matrix of a space named by a symbol.
fn named(m: &mut Machine<'_>, space: SymbolId, at: SourcePos) -> Transform {
    let name = m.view(space).string(m.first());
    m.known_space(name, at)
}

/// Transforms all lanes by one matrix.
fn by_one(m: &mut Machine<'_>, op: &Op, kind: Kind, value: SymbolId, matrix: &Transform, singular: bool) {
    if singular {
        m.complain(op.at, "a coordinate system has a singular matrix");
    }
    let Some(dst) = op.dst else { return };
    let varying = m.view(value).varying;
    let normals = kind.normals(matrix);
    compute_as(m, dst, varying, 3, |m, out, work| {
        let v = m.view(value).triple();
        work.each(|i| out.set3(i, kind.apply(matrix, &normals, v.get(i))));
    });
}

/// Transforms by a matrix per lane, computed from operands.
fn by_matrices(
    m: &mut Machine<'_>,
    op: &Op,
    kind: Kind,
    value: SymbolId,
    matrix: impl Fn(&Cell<bool>, usize, &[crate::run::store::View<'_>; 2]) -> Transform,
    operands: &[SymbolId],
) {
    let Some(dst) = op.dst else { return };
    let same = !m.varies(operands);
    let varying = !same || m.view(value).varying;
    let singular = Cell::new(false);
    compute_as(m, dst, varying, 3, |m, out, work| {
        let views = [0, 1].map(|k: usize| m.view(operands[k.min(operands.len() - 1)]));
        let v = m.view(value).triple();
        let uniform = same.then(|| {
            let matrix = matrix(&singular, 0, &views);
            (matrix, kind.normals(&matrix))
        });
        work.each(|i| {
            let (by, normals) = uniform.unwrap_or_else(|| {
                let matrix = matrix(&singular, i, &views);
                (matrix, kind.normals(&matrix))
            });
            out.set3(i, kind.apply(&by, &normals, v.get(i)));
        });
    });
    if singular.get() {
        m.complain(op.at, "a singular matrix has no inverse");
    }
}

/// Runs constructors with a space. The components are in it, and the result is in "common" (colours: "rgb").
pub(super) fn construct(m: &mut Machine<'_>, op: &Op, dst: SymbolId, parts: &[SymbolId]) {
    let ty = m.type_of(dst);
    let varying = m.varies(parts);
    if ty == ValueType::Color {
        let Some(space) = color::named(m, op.args[0], op.at) else { return };
        return compute_as(m, dst, varying, 3, |m, out, work| {
            let lanes: [_; 3] = std::array::from_fn(|c| part_lane(m, parts, c, ty));
            work.each(|i| out.set3(i, color::to_rgb(space, Vec3::from(lanes.map(|l| l.get(i))))));
        });
    }
    let matrix = named(m, op.args[0], op.at);
    if ty == ValueType::Matrix {
        return compute_as(m, dst, varying, 16, |m, out, work| {
            let lanes: [_; 16] = std::array::from_fn(|c| part_lane(m, parts, c, ty));
            work.each(|i| {
                let own = Transform::from_rows(&lanes.map(|l| l.get(i)));
                set_matrix(out, i, &own.then(&matrix));
            });
        });
    }
    let kind = match ty {
        ValueType::Vector => Kind::Vector,
        ValueType::Normal => Kind::Normal,
        _ => Kind::Point,
    };
    let normals = kind.normals(&matrix);
    compute_as(m, dst, varying, 3, |m, out, work| {
        let lanes: [_; 3] = std::array::from_fn(|c| part_lane(m, parts, c, ty));
        work.each(|i| {
            let v = Vec3::from(lanes.map(|l| l.get(i)));
            out.set3(i, kind.apply(&matrix, &normals, v));
        });
    });
}

/// Runs `transformu`, which converts a measure from one unit to another. Units may be lengths, times or coordinate
/// systems. The unit of a coordinate system is the cube root of its volume scale.
pub(super) fn transformu(m: &mut Machine<'_>, op: &Op) {
    let (value, units) = op.args.split_last().expect("invariant: linking checked the operands");
    let text = |m: &Machine<'_>, s: Option<&SymbolId>| s.map(|&s| m.view(s).string(m.first()));
    let common = m.intern("common");
    let to = text(m, units.last()).unwrap_or(common);
    let from = if units.len() > 1 { text(m, units.first()).unwrap_or(common) } else { common };
    let factor = unit_factor(m, from, to).unwrap_or_else(|| {
        let (from, to) = (m.text(from).clone(), m.text(to).clone());
        m.complain(op.at, &format!("cannot convert \"{from}\" to \"{to}\""));
        1.0
    });
    compute(m, op, 1, |m, out, _| map1(out.part(0), m.view(*value).lane(0), |x| x * factor));
}

/// Returns the value of one `from` in `to`.
fn unit_factor(m: &mut Machine<'_>, from: StringId, to: StringId) -> Option<f32> {
    if from == to {
        return Some(1.0);
    }
    let (a, b) = (m.text(from).clone(), m.text(to).clone());
    if let Some(factor) = m.services.unit_scale(&a, &b) {
        return Some(factor);
    }
    // At least one is a coordinate system, which converts by way of "common". The other is then a length.
    if m.space(from).is_none() && m.space(to).is_none() {
        return None;
    }
    let mut is_length = |name: StringId, word: &str| {
        word == "common" || m.space(name).is_some() || m.services.unit_scale(word, "mm").is_some()
    };
    if !(is_length(from, &a) && is_length(to, &b)) {
        return None;
    }
    let mut to_common = |name: StringId, word: &str| -> Option<f32> {
        if word == "common" {
            return Some(1.0);
        }
        if let Some(space) = m.space(name) {
            let scale = linear_scale(&space);
            return (scale > 0.0).then_some(scale);
        }
        m.services.unit_scale(word, "common")
    };
    Some(to_common(from, &a)? / to_common(to, &b)?)
}

/// Returns the cube root of the volume scale.
pub(super) fn linear_scale(m: &Transform) -> f32 {
    let (x, y, z) = (m.vector(Vec3::X), m.vector(Vec3::Y), m.vector(Vec3::Z));
    libm::cbrtf(x.cross(y).dot(z).abs())
}
