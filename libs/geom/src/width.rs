//! Widths of points and curves at each motion key.

use crate::key::ShapeKey;
use crate::vars::Report;
use granita_base::{Interp, ParamData, Params, Severity};
use std::sync::Arc;

/// The largest width of a point or curve. Farther out single precision cannot resolve pixels.
const MOST: f32 = 1e12;

/// The widths at one motion key. Numbers that are negative or not finite become 0, and larger ones become [`MOST`].
#[derive(Clone, Debug)]
pub(crate) enum Widths {
    /// One width for all.
    Constant(f32),
    /// One width for each curve.
    PerPiece(Arc<[f32]>),
    /// One width for each end of each curve.
    Linear(Arc<[f32]>),
    /// One width for each control vertex.
    Vertex(Arc<[f32]>),
}

/// The numbers of values needed for each interpolation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WidthCounts {
    pub(crate) perpiece: usize,
    pub(crate) linear: usize,
    pub(crate) vertex: usize,
}

impl Widths {
    /// Returns the widths called `name` at every key; `None` when the first key has none, or has them in a wrong
    /// number. Keys without widths, or with another kind of widths, use those of the first key. Invalid widths are
    /// reported.
    pub(crate) fn collect(
        call: &str,
        keys: &[ShapeKey<'_>],
        name: &str,
        counts: WidthCounts,
        report: Report<'_>,
    ) -> Option<Vec<Self>> {
        let first = Self::read(keys[0].params, name, counts)?;
        let values = keys[0].params.floats(name)?;
        let bad = |w: &&f32| !(0.0..=MOST).contains(*w);
        if let Some(first) = values.iter().find(bad) {
            let text = format!(
                "{call}: {} of {} values of \"{name}\" are outside 0 to {MOST:e}, the first is {first}",
                values.iter().filter(bad).count(),
                values.len()
            );
            report(Severity::Warning, text);
        }
        let same_kind = |w: &Self| std::mem::discriminant(w) == std::mem::discriminant(&first);
        let others = keys[1..].iter().map(|key| {
            Self::read(key.params, name, counts).filter(same_kind).unwrap_or_else(|| first.clone())
        });
        Some(std::iter::once(first.clone()).chain(others).collect())
    }

    fn read(params: &Params, name: &str, counts: WidthCounts) -> Option<Self> {
        let param = params.get(name)?;
        if param.ty.width() != 1 || matches!(param.data, ParamData::String(_)) {
            return None;
        }
        let raw = param.data.to_floats()?;
        let values: Arc<[f32]> =
            raw.iter().map(|&w| if w.is_finite() { w.clamp(0.0, MOST) } else { 0.0 }).collect();
        let enough = |n: usize| values.len() >= n;
        match param.ty.interp {
            Interp::Constant => values.first().map(|&w| Self::Constant(w)),
            Interp::PerPiece => enough(counts.perpiece).then_some(Self::PerPiece(values)),
            Interp::Linear => enough(counts.linear).then_some(Self::Linear(values)),
            Interp::Vertex => enough(counts.vertex).then_some(Self::Vertex(values)),
        }
    }
}
