//! Estimates the smooth surface that the interpolated normals of flat faces describe.
//!
//! Shading with interpolated normals lights points on a face that is turned away from a light, while the face itself
//! blocks the light. Shadow rays that begin on faces therefore make the terminator of a mesh jagged. They begin on a
//! smooth surface instead, as in Johannes Hanika, "Hacking the Shadow Terminator", chapter 4 of Ray Tracing Gems II
//! (Apress, 2021). A point is projected to the tangent planes at the corners of its face where these lie above it,
//! and the results are weighted by the weights of the corners.

use granita_base::Vec3;
use granita_shade::{Grid, Lanes3, Topology};
use std::sync::Arc;

/// The corners (0,0), (1,0), (0,1) and (1,1) of a face, with their normals of any length.
#[derive(Clone, Copy, Debug)]
pub struct SmoothFace {
    /// The positions in "common" space.
    pub p: [Vec3; 4],
    /// The normals in "common" space.
    pub n: [Vec3; 4],
}

impl SmoothFace {
    /// Returns the vector from a point of the face, given with the weights of its corners, to the estimated smooth
    /// surface. The vector points to the side of the normals for a positive `side`, else to the other side, and never
    /// through the face.
    pub fn lift(&self, p: Vec3, weights: [f32; 4], side: f32) -> Vec3 {
        let mut sum = Vec3::ZERO;
        for (k, weight) in weights.into_iter().enumerate() {
            let n = self.n[k].normalize_or_zero() * side;
            let above = (p - self.p[k]).dot(n);
            if above < 0.0 {
                sum -= n * (above * weight);
            }
        }
        if sum.is_finite() { sum } else { Vec3::ZERO }
    }

    /// Returns the vectors to both sides, that of the normals first.
    pub fn lifts(&self, p: Vec3, weights: [f32; 4]) -> [Vec3; 2] {
        [self.lift(p, weights, 1.0), self.lift(p, weights, -1.0)]
    }
}

/// Returns the bilinear weights of the corners for a place in a face.
pub(crate) fn bilinear(u: f32, v: f32) -> [f32; 4] {
    [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v]
}

/// Returns [`Grid::lift`] of a rectangle of points on a flat face, whose parameters run from 0 to 1 over it. The
/// corners of the face follow from those of the rectangle, because position and normal are bilinear.
pub(crate) fn of_face(grid: &Grid) -> Option<Arc<[Lanes3; 2]>> {
    let Topology::Rect { nu, nv } = grid.topology else { return None };
    let lanes = [0, nu - 1, (nv - 1) * nu, nu * nv - 1];
    let [u0, u1, v0, v1] = [grid.u[lanes[0]], grid.u[lanes[3]], grid.v[lanes[0]], grid.v[lanes[3]]];
    let (du, dv) = (u1 - u0, v1 - v0);
    if du == 0.0 || dv == 0.0 {
        return None;
    }
    let corner = |of: &Lanes3, k: usize| {
        let (u, v) = (((k & 1) as f32 - u0) / du, ((k >> 1) as f32 - v0) / dv);
        let weights = bilinear(u, v);
        (0..4).map(|k| of.get(lanes[k]) * weights[k]).sum::<Vec3>()
    };
    let face = SmoothFace {
        p: [0, 1, 2, 3].map(|k| corner(&grid.p, k)),
        n: [0, 1, 2, 3].map(|k| corner(&grid.n, k)),
    };
    let mut both = [Lanes3::zeros(nu * nv), Lanes3::zeros(nu * nv)];
    for lane in 0..nu * nv {
        let lifts = face.lifts(grid.p.get(lane), bilinear(grid.u[lane], grid.v[lane]));
        for (lanes, lift) in both.iter_mut().zip(lifts) {
            lanes.set(lane, lift);
        }
    }
    Some(Arc::new(both))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a square patch of a sphere of radius 1 around the z axis, with half side `half`.
    fn of_sphere(half: f32) -> SmoothFace {
        let p = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]
            .map(|[x, y]: [f32; 2]| Vec3::new(x * half, y * half, (1.0 - 2.0 * half * half).sqrt()));
        SmoothFace { p, n: p }
    }

    #[test]
    fn the_middle_of_a_face_is_lifted_towards_the_sphere() {
        for half in [0.05, 0.1, 0.3] {
            let face = of_sphere(half);
            let middle = Vec3::new(0.0, 0.0, face.p[0].z);
            let lift = face.lift(middle, [0.25; 4], 1.0);
            // Tangent planes lie above the sphere. The lift is at least the gap to the sphere, and slightly more than
            // twice the gap at most.
            let gap = 1.0 - middle.z;
            assert!(lift.z >= gap * 0.99 && lift.z < 2.2 * gap, "{half}: {lift} {gap}");
            assert!(lift.truncate().length() < 1e-6);
            // Seen from inside, the smooth surface lies behind the face.
            assert_eq!(face.lift(middle, [0.25; 4], -1.0), Vec3::ZERO);
            // The corners lie on the smooth surface.
            assert!(face.lift(face.p[1], [0.0, 1.0, 0.0, 0.0], 1.0).length() < 1e-6);
        }
    }

    #[test]
    fn a_flat_face_is_not_lifted() {
        let p = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::ONE - Vec3::Z];
        let face = SmoothFace { p, n: [Vec3::Z; 4] };
        let at = Vec3::new(0.25, 0.5, 0.0);
        assert_eq!(face.lifts(at, bilinear(0.25, 0.5)), [Vec3::ZERO; 2]);
        let face = SmoothFace { p, n: [Vec3::NAN; 4] };
        assert_eq!(face.lifts(at, bilinear(0.25, 0.5)), [Vec3::ZERO; 2]);
    }

    #[test]
    fn parts_of_a_face_are_lifted_like_the_whole() {
        // The grids are the whole face in 5 x 5 points, and the part of it from its middle on.
        let whole = of_sphere(0.3);
        let grid = |from: f32| {
            let mut grid = Grid::new(Topology::Rect { nu: 5, nv: 5 });
            for lane in 0..25 {
                let at = |k: usize| from + (1.0 - from) * k as f32 / 4.0;
                let (u, v) = (at(lane % 5), at(lane / 5));
                let weights = bilinear(u, v);
                let mix = |list: &[Vec3; 4]| (0..4).map(|k| list[k] * weights[k]).sum::<Vec3>();
                (grid.u[lane], grid.v[lane]) = (u, v);
                grid.p.set(lane, mix(&whole.p));
                grid.n.set(lane, mix(&whole.n));
            }
            of_face(&grid).unwrap()
        };
        let (all, part) = (grid(0.0), grid(0.5));
        for (of_all, of_part) in [(12, 0), (14, 4), (22, 20), (18, 12)] {
            let (a, b) = (all[0].get(of_all), part[0].get(of_part));
            // Lane 18 is at three quarters of the face, where the middle of the part is.
            assert!((a - b).length() < 1e-5, "{of_all}: {a} {b}");
        }
    }
}
