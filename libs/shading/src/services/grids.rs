//! What services need to know of the grid that a shader runs on.

use crate::ShadingContext;
use granita_gsl::ir::ShaderKind;
use granita_scene::LightId;
use granita_shade::{Grid, Group, Rect};
use std::sync::Arc;

/// Returns the lanes of a grid on sides that are single points (poles, tips of triangles), each with the first lane
/// at that point. They are in increasing order.
pub(super) fn coincident(grid: &Grid) -> Arc<[(u32, u32)]> {
    let place = |lane: usize| grid.p.get(lane).to_array().map(f32::to_bits);
    let mut out = Vec::new();
    for Rect { first, nu, nv } in grid.topology.rects() {
        for (start, step, count) in [(0, 1, nu), ((nv - 1) * nu, 1, nu), (0, nu, nv), (nu - 1, nu, nv)] {
            let lane = |k: usize| first + start + k * step;
            if count > 1 && (1..count).all(|k| place(lane(k)) == place(lane(0))) {
                out.extend((1..count).map(|k| (lane(k) as u32, lane(0) as u32)));
            }
        }
    }
    out.sort_unstable();
    out.dedup_by_key(|twin| twin.0);
    out.into()
}

/// Returns which sides of each rectangle of a grid are boundary edges of its surface: first and last along u, first
/// and last along v.
pub(super) fn rims(grid: &Grid) -> Arc<[[bool; 4]]> {
    let of = |(k, rect): (usize, Rect)| {
        let Rect { first, nu, nv } = rect;
        let ends = |parameter: &[f32], start: usize, step: usize, count: usize| {
            let outside = |x: &f32| *x <= 0.0 || *x >= 1.0;
            (0..count).all(|k| parameter.get(first + start + k * step).is_some_and(outside))
        };
        if nu < 2 || nv < 2 {
            return [false; 4];
        }
        let [a, b, c, d] = grid.seams.get(k).copied().unwrap_or_default();
        [
            !a && ends(&grid.u, 0, nu, nv),
            !b && ends(&grid.u, nu - 1, nu, nv),
            !c && ends(&grid.v, 0, 1, nu),
            !d && ends(&grid.v, (nv - 1) * nu, 1, nu),
        ]
    };
    grid.topology.rects().enumerate().map(of).collect()
}

/// Returns the grid that light shaders read. It has the variables and messages of the surface only when one of the
/// lights may query them.
pub(super) fn seen_by_lights(grid: &Grid, frame: &ShadingContext, lights: &[LightId]) -> Grid {
    let mut seen = without_variables(grid);
    let asked = |of: fn(&Group) -> bool| {
        lights.iter().filter_map(|id| frame.light(*id)).any(|light| of(&light.shaders.group))
    };
    if asked(Group::asks_primitive) {
        seen.primvars = grid.primvars.clone();
    }
    if asked(|group| group.listens_to(ShaderKind::Displacement) || group.listens_to(ShaderKind::Surface)) {
        seen.messages = grid.messages.clone();
    }
    seen
}

/// Returns a copy of a grid without its variables and messages.
fn without_variables(grid: &Grid) -> Grid {
    Grid {
        uneven: grid.uneven.clone(),
        topology: grid.topology.clone(),
        p: grid.p.clone(),
        n: grid.n.clone(),
        ng: grid.ng.clone(),
        i: grid.i.clone(),
        dpdu: grid.dpdu.clone(),
        dpdv: grid.dpdv.clone(),
        dpdtime: grid.dpdtime.clone(),
        seams: grid.seams.clone(),
        lift: None,
        u: grid.u.clone(),
        v: grid.v.clone(),
        time: grid.time,
        dtime: grid.dtime,
        c: grid.c.clone(),
        opacity: grid.opacity.clone(),
        primvars: Vec::new(),
        flip_normals: grid.flip_normals,
        seed: grid.seed,
        names: grid.names.clone(),
        primitives: grid.primitives.clone(),
        ray: grid.ray,
        paths: grid.paths.clone(),
        object: grid.object.clone(),
        messages: Vec::new(),
        parent: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::Vec3;
    use granita_shade::{Lanes3, Topology};

    #[test]
    fn coincident_lanes_share_their_lane_seeds() {
        // A triangle is a rectangle whose first column is one point, here beside a rectangle.
        let tip = Vec3::new(1.0, 2.0, 3.0);
        let p: Vec<Vec3> = (0..12)
            .map(|i| if i < 6 && i % 2 == 0 { tip } else { Vec3::new(i as f32, (i * i) as f32, 0.0) })
            .collect();
        let rects = [Rect { first: 0, nu: 2, nv: 3 }, Rect { first: 6, nu: 3, nv: 2 }];
        let grid = Grid { p: Lanes3::from_points(&p), ..Grid::new(Topology::Rects(Arc::from(&rects[..]))) };
        assert_eq!(*coincident(&grid), [(2, 0), (4, 0)]);
        // All points coincide, so each has an earlier one.
        let grid = Grid { p: Lanes3::from_points(&[tip; 6]), ..Grid::new(Topology::Rect { nu: 3, nv: 2 }) };
        let all = coincident(&grid);
        assert!(all.iter().all(|(lane, of)| of < lane) && all.len() == 5, "{all:?}");
    }
}
