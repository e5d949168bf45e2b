//! Marks the kept parts of a grid, and subdivides grids more finely than they are shaded.
//!
//! A trim curve runs through micropolygons. They are not dropped or kept whole. The grid is cut into cells after it
//! has been shaded, each a piece of the surface of its micropolygon, and the cells are kept or dropped.

use super::job::Job;
use granita_geom::Dice;
use granita_hider::ShadedGrid;
use granita_scene::attr;
use granita_shade::Grid;
use std::ops::{Add, Mul};

/// The cells of a grid.
pub(super) struct Cells {
    /// The number of cells along each side of a micropolygon.
    pub(super) per_side: usize,
    /// True for each cell (u fastest) that is kept.
    pub(super) kept: Vec<bool>,
}

/// Returns the cells that are neither trimmed nor facing away where "twosided" is 0; `None` when all are kept. The
/// points of the grid begin at lane `first`.
pub(super) fn kept<O>(dice: &Dice, job: &Job<O>, grid: &Grid, first: usize) -> Option<Cells> {
    let attributes = &job.primitive.attributes;
    let (mu, mv) = (dice.nu - 1, dice.nv - 1);
    let mut cells = dice.mask.as_ref().map(|mask| {
        let inside = &*attributes.get(attr::TRIMCURVE_SENSE) != "outside";
        Cells { per_side: mask.per_side, kept: mask.outside.iter().map(|m| *m == inside).collect() }
    });
    // Most grids lie on one side of the curves.
    if let Some(whole) = cells.as_mut().filter(|c| c.kept.iter().all(|k| *k == c.kept[0])) {
        *whole = Cells { per_side: 1, kept: vec![whole.kept[0]; mu * mv] };
    }
    if !attributes.get(attr::TWOSIDED) {
        let cells = cells.get_or_insert_with(|| Cells { per_side: 1, kept: vec![true; mu * mv] });
        let away = |i: usize| grid.ng.get(i).dot(grid.i.get(i)) > 0.0;
        let k = cells.per_side;
        for (at, kept) in cells.kept.iter_mut().enumerate() {
            let (i, j) = (at % (mu * k) / k, at / (mu * k) / k);
            let corner = first + j * dice.nu + i;
            let corners = [corner, corner + 1, corner + dice.nu, corner + dice.nu + 1];
            *kept &= !corners.into_iter().all(away);
        }
    }
    cells
}

/// Returns the values of a lattice of `nu` points along u at the corners of cells, `k` along each side of a
/// micropolygon. They are linear over the two triangles of a micropolygon.
pub(super) fn finer<T>(values: &[T], nu: usize, k: usize) -> Vec<T>
where
    T: Copy + PartialEq + Mul<f32, Output = T> + Add<Output = T>,
{
    let (mu, mv) = (nu - 1, values.len() / nu - 1);
    let place = |x: usize, m: usize| {
        let whole = (x / k).min(m - 1);
        (whole, (x - whole * k) as f32 / k as f32)
    };
    let mut out = Vec::with_capacity((mu * k + 1) * (mv * k + 1));
    for y in 0..=mv * k {
        let (j, v) = place(y, mv);
        for x in 0..=mu * k {
            let (i, u) = place(x, mu);
            let at = j * nu + i;
            let [a, b, c, d] = [at, at + 1, at + nu, at + nu + 1].map(|at| values[at]);
            // Equal values at all corners, and the value of the first corner, are reproduced exactly.
            out.push(if (a == b && a == c && a == d) || (u == 0.0 && v == 0.0) {
                a
            } else {
                let w = ShadedGrid::weights(u, v);
                a * w[0] + b * w[1] + c * w[2] + d * w[3]
            });
        }
    }
    out
}
