//! Where the rays of the points of a grid begin.
//!
//! Other surfaces often end exactly at the boundary edge of a surface (floor and wall). Rays that begin at the edge, or
//! beyond it, pass through them. So the rays of a point on the edge begin slightly inside, and the part of the surface
//! that the point represents ends at the edge.

use super::Run;
use granita_base::Vec3;
use granita_shade::{Batch, Lane, Lane3, Rect};

/// The origins of the rays of one call.
pub(super) struct Origins<'q> {
    p: Lane3<'q>,
    /// For each lane, the origin and the inner neighbours along u and v of a lane on boundary edges. Empty when no
    /// lane is on one.
    moved: Vec<(Vec3, [Option<u32>; 2])>,
}

impl<'q> Origins<'q> {
    /// Returns the origins of a call from the points `p`. They lie 1.5 times the bias inside.
    pub(super) fn new(run: &Run<'_, '_>, batch: Batch<'_>, p: Lane3<'q>, bias: Option<Lane<'_>>) -> Self {
        Self::inside_by(run, batch, p, &|lane| run.bias(bias, lane))
    }

    /// Does the same, at least 1.5 times the distance inside below which hits of the own object do not count.
    pub(super) fn clear(run: &Run<'_, '_>, batch: Batch<'_>, p: Lane3<'q>, bias: Option<Lane<'_>>) -> Self {
        Self::inside_by(run, batch, p, &|lane| run.bias(bias, lane).max(run.frame.ray_margin(p.get(lane))))
    }

    fn inside_by(run: &Run<'_, '_>, batch: Batch<'_>, p: Lane3<'q>, least: &dyn Fn(usize) -> f32) -> Self {
        if run.topology.points() != batch.lanes || !run.rims.iter().flatten().any(|rim| *rim) {
            return Self::at_points(p);
        }
        let mut moved: Vec<_> = (0..batch.lanes).map(|i| (p.get(i), [None; 2])).collect();
        let mut active = batch.active.iter().map(|lane| *lane as usize).peekable();
        for (rect, rims) in run.topology.rects().zip(run.rims.iter()) {
            while let Some(i) = active.next_if(|i| *i < rect.lanes().end) {
                let is_active = |lane: &u32| batch.active.binary_search(lane).is_ok();
                let inner = inner_neighbours(&rect, rims, i).map(|lane| lane.filter(is_active));
                let at = p.get(i);
                let reach = 1.5 * least(i);
                let normal = run.surface.as_ref().map_or(Vec3::ZERO, |surface| surface.ng.get(i));
                let mut origin = at;
                for inner in inner.into_iter().flatten() {
                    let way = p.get(inner as usize) - at;
                    origin += along_surface(way, normal) * (reach / way.length()).min(0.5);
                }
                moved[i] = (if origin.is_finite() { origin } else { at }, inner);
            }
        }
        Self { p, moved }
    }

    /// Returns the points themselves as origins.
    pub(super) fn at_points(p: Lane3<'q>) -> Self {
        Self { p, moved: Vec::new() }
    }

    /// Returns the origin of a lane.
    pub(super) fn at(&self, lane: usize) -> Vec3 {
        self.moved.get(lane).map_or_else(|| self.p.get(lane), |(origin, _)| *origin)
    }

    /// Returns how far the origin of a lane is from its point.
    pub(super) fn inset(&self, lane: usize) -> Vec3 {
        self.moved.get(lane).map_or(Vec3::ZERO, |(origin, _)| *origin - self.p.get(lane))
    }

    /// Returns the sum of the ways along u and along v from the point of a lane to a place beside it. Ways that lead
    /// out of the surface are reversed.
    pub(super) fn inside(&self, lane: usize, ways: [Vec3; 2]) -> Vec3 {
        let inner = self.moved.get(lane).map_or([None; 2], |(_, inner)| *inner);
        let one = |axis: usize| {
            let way = ways[axis];
            let leads_out = |inner: u32| (self.p.get(inner as usize) - self.p.get(lane)).dot(way) < 0.0;
            if inner[axis].is_some_and(leads_out) { -way } else { way }
        };
        one(0) + one(1)
    }
}

/// Returns a way to a neighbour without its part along the normal. On a coarse grid, the way itself leads below a
/// curved surface.
fn along_surface(way: Vec3, normal: Vec3) -> Vec3 {
    let flat = way - normal * (way.dot(normal) / normal.length_squared());
    if flat.is_finite() { flat } else { way }
}

/// Returns the next lanes along u and v of a lane on boundary edges, where `rims` has the sides of the rectangle that
/// are such edges (first and last along u, first and last along v).
fn inner_neighbours(rect: &Rect, rims: &[bool; 4], lane: usize) -> [Option<u32>; 2] {
    let (column, row) = ((lane - rect.first) % rect.nu, (lane - rect.first) / rect.nu);
    let inner = |[first, last]: [bool; 2], at: usize, count: usize, step: usize| match () {
        () if first && at == 0 => Some((lane + step) as u32),
        () if last && at == count - 1 => Some((lane - step) as u32),
        () => None,
    };
    [inner([rims[0], rims[1]], column, rect.nu, 1), inner([rims[2], rims[3]], row, rect.nv, rect.nu)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_along_a_surface_have_no_part_along_its_normal() {
        let way = Vec3::new(3.0, 0.0, -4.0);
        assert_eq!(along_surface(way, Vec3::Z * 7.0), Vec3::X * 3.0);
        assert_eq!(along_surface(way, Vec3::ZERO), way);
    }

    #[test]
    fn lanes_on_boundary_edges_have_inner_neighbours() {
        let rect = Rect { first: 4, nu: 3, nv: 2 };
        let all =
            |rims: [bool; 4]| (4..10).map(|lane| inner_neighbours(&rect, &rims, lane)).collect::<Vec<_>>();
        assert!(all([false; 4]).iter().flatten().all(Option::is_none));
        let both = |u: Option<u32>, v: u32| [u, Some(v)];
        assert_eq!(
            all([true; 4]),
            [
                both(Some(5), 7),
                both(None, 8),
                both(Some(5), 9),
                both(Some(8), 4),
                both(None, 5),
                both(Some(8), 6)
            ]
        );
        let one = [None; 2];
        assert_eq!(all([false, true, false, false]), [one, one, [Some(5), None], one, one, [Some(8), None]]);
    }
}
