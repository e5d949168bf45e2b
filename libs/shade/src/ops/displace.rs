//! `displace` and `bump` (reference 5.8.12).

use super::derive::normals_of;
use crate::program::Op;
use crate::run::machine::Machine;
use crate::run::store::Out;
use granita_base::{Transform, Vec3};
use granita_gsl::Func;
use granita_gsl::ir::{Global, SymbolId, ValueType};

/// Moves P by an amount along N, or by a vector, and gives N the resulting direction. `bump` changes only N.
///
/// N turns by as much as the geometric normal of the points, so that an interpolated normal stays interpolated and
/// a displacement of zero changes nothing.
pub(super) fn run(m: &mut Machine<'_>, func: Func, op: &Op) {
    let named = m.type_of(op.args[0]) == ValueType::String;
    let Some(&amount) = op.args.get(usize::from(named)) else { return };
    let scale = if named { Scale::of(m, op, op.args[0]) } else { Scale::None };
    let before = m.captured_global(Global::P);
    let old = normals_of(m, &before);
    let mut moved = m.out(true, 3);
    {
        let (p, n) = (before.triple(), m.global(Global::N).triple());
        let by = m.view(amount);
        let along_normal = m.type_of(amount) == ValueType::Float;
        for i in 0..m.n {
            // Inactive lanes keep their place, because their neighbours read them.
            moved.set3(i, p.get(i));
        }
        m.work(true).each(|i| {
            let offset = if along_normal {
                let direction = n.get(i).normalize_or_zero();
                direction * (by.get(i) * scale.along(direction))
            } else {
                by.triple().get(i)
            };
            moved.set3(i, p.get(i) + offset);
        });
    }
    let new = normals_of(m, &moved);
    let turned = turned_normals(m, &old, &new);
    if func == Func::Displace {
        m.commit_global(Global::P, moved);
    } else {
        m.discard(moved);
    }
    m.commit_global(Global::N, turned);
    for out in [before, old, new] {
        m.discard(out);
    }
}

/// Returns N plus the change of the geometric normals, of unit length.
fn turned_normals(m: &mut Machine<'_>, old: &Out, new: &Out) -> Out {
    let mut out = m.out(true, 3);
    let n = m.global(Global::N).triple();
    let (old, new) = (old.triple(), new.triple());
    m.work(true).each(|i| {
        let (before, after) = (old.get(i), new.get(i));
        if before == after {
            out.set3(i, n.get(i));
            return;
        }
        let unit = n.get(i).normalize_or_zero();
        let turned = unit + after.normalize_or_zero() - before.normalize_or_zero();
        out.set3(i, turned.try_normalize().unwrap_or(unit));
    });
    out
}

/// The conversion of an amount in a named space to "common" space.
enum Scale {
    None,
    /// A unit of length.
    Factor(f32),
    /// The transformation from "common" to the space.
    Space(Transform),
}

impl Scale {
    fn of(m: &mut Machine<'_>, op: &Op, name: SymbolId) -> Self {
        let text = m.string(name);
        if &*text == "common" {
            return Self::None;
        }
        let layer = m.layer;
        if let Some(space) = m.services.to_common(&text, layer) {
            return Self::Space(space.inverse());
        }
        if let Some(factor) = m.services.unit_scale(&text, "common") {
            return Self::Factor(factor);
        }
        m.complain(op.at, &format!("there is no coordinate system \"{text}\""));
        Self::None
    }

    /// Returns the length in "common" space of one unit along a unit vector.
    fn along(&self, direction: Vec3) -> f32 {
        match self {
            Self::None => 1.0,
            Self::Factor(factor) => *factor,
            Self::Space(to_space) => {
                let length = to_space.vector(direction).length();
                if length > 0.0 { 1.0 / length } else { 1.0 }
            }
        }
    }
}
