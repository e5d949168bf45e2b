//! Which samples hit which micropolygons.

use super::SampleGrid;
use super::visible::{ShadedGrid, pixels_of};
use crate::PixelRect;
use granita_base::{Vec2, Vec3};

/// A grid over samples.
pub(super) struct Raster<'a> {
    pub(super) samples: &'a SampleGrid,
    pub(super) grid: &'a ShadedGrid,
}

/// Called with sample, depth, lower left point of the micropolygon, place in it, and whether that is on the rim.
type Hit<'h> = dyn FnMut(usize, f32, u32, f32, f32, bool) + 'h;

/// One edge of a raster triangle: `(x - ox) * a + (y - oy) * b`, positive inside.
#[derive(Clone, Copy)]
struct Edge {
    a: f32,
    b: f32,
    ox: f32,
    oy: f32,
    /// A sample is inside above this.
    least: f32,
}

impl Edge {
    /// From `p` to `q`; `sign` is that of the triangle's area. The arithmetic does not depend on the direction, so
    /// that two triangles that share an edge agree about every sample.
    fn new(p: Vec2, q: Vec2, sign: f32, widen: f32) -> Self {
        let swapped = (q.x, q.y) < (p.x, p.y);
        let (p, q, sign) = if swapped { (q, p, -sign) } else { (p, q, sign) };
        let d = q - p;
        // A sample on the edge belongs to the triangle for which the edge runs forward.
        let least = match widen > 0.0 {
            true => -widen * d.length(),
            false if sign > 0.0 => -f32::MIN_POSITIVE,
            false => 0.0,
        };
        Self { a: -d.y * sign, b: d.x * sign, ox: p.x, oy: p.y, least }
    }

    fn at(&self, x: f32, y: f32) -> f32 {
        (x - self.ox) * self.a + (y - self.oy) * self.b
    }
}

impl Raster<'_> {
    /// Finds all hits; order of micropolygons, then of samples.
    pub(super) fn each_hit(&self, hit: &mut Hit<'_>) {
        let grid = self.grid;
        let (mu, mv) = (grid.nu.saturating_sub(1), grid.nv.saturating_sub(1));
        for j in 0..mv {
            for i in 0..mu {
                if grid.kept.get(j * mu + i).is_some_and(|kept| !kept) {
                    continue;
                }
                // Sides at v = 0, u = 1, v = 1, u = 0.
                let rim = [j == 0, i + 1 == mu, j + 1 == mv, i == 0];
                if grid.view.raster.is_empty() {
                    self.moving(j * grid.nu + i, rim, hit);
                } else {
                    self.still(j * grid.nu + i, rim, hit);
                }
            }
        }
    }

    /// Pixels in which the grid may be seen.
    fn window(&self) -> PixelRect {
        self.samples.rect.intersection(&self.grid.rect)
    }

    fn widening(&self, rim: bool) -> f32 {
        if rim { self.grid.rim_px } else { 0.0 }
    }

    /// A micropolygon that does not move, without a lens, all before the camera.
    fn still(&self, at: usize, rim: [bool; 4], hit: &mut Hit<'_>) {
        let (grid, samples) = (self.grid, self.samples);
        let nu = grid.nu;
        let near = grid.view.near.max(grid.z_min);
        let corner = [at, at + 1, at + nu + 1, at + nu].map(|i| grid.view.raster[i]);
        let (lo, hi) =
            corner[1..].iter().fold((corner[0], corner[0]), |(lo, hi), c| (lo.min(*c), hi.max(*c)));
        let any_rim = rim.contains(&true);
        let pad = self.widening(any_rim);
        let rect = pixels_of([lo.x - pad, lo.y - pad, hi.x + pad, hi.y + pad], &self.window());
        if rect.is_empty() {
            return;
        }
        // Triangles (0, 1, 2) and (0, 2, 3); the diagonal is no rim.
        let triangles = [([0, 1, 2], [rim[0], rim[1], false]), ([0, 2, 3], [false, rim[2], rim[3]])];
        for (second, (index, rims)) in triangles.into_iter().enumerate() {
            let p = index.map(|k| corner[k]);
            let q = p.map(Vec3::truncate);
            let area = (q[1] - q[0]).perp_dot(q[2] - q[0]);
            if area == 0.0 || !area.is_finite() {
                continue;
            }
            let sign = area.signum();
            let edges: [Edge; 3] =
                std::array::from_fn(|k| Edge::new(q[k], q[(k + 1) % 3], sign, self.widening(rims[k])));
            let inverse = 1.0 / area.abs();
            for y in rect.y0..rect.y1 {
                for x in rect.x0..rect.x1 {
                    let first = samples.pixel(x, y) * samples.per_pixel;
                    for s in first..first + samples.per_pixel {
                        let (sx, sy) = (samples.x[s], samples.y[s]);
                        let e = [edges[0].at(sx, sy), edges[1].at(sx, sy), edges[2].at(sx, sy)];
                        if !(e[0] > edges[0].least && e[1] > edges[1].least && e[2] > edges[2].least) {
                            continue;
                        }
                        // Edge k lies opposite to corner k + 2.
                        let w = [e[1] * inverse, e[2] * inverse, e[0] * inverse].map(|w| w.clamp(0.0, 1.0));
                        let sum = w[0] + w[1] + w[2];
                        let (z, w) = self.depth(p, w, sum);
                        if !(z >= near && z <= grid.view.far) {
                            continue;
                        }
                        let (u, v) = place(second == 1, w);
                        hit(s, z, at as u32, u, v, any_rim);
                    }
                }
            }
        }
    }

    /// Depth from the third coordinate of the corners, and weights that are right in space, summing to one.
    fn depth(&self, p: [Vec3; 3], w: [f32; 3], sum: f32) -> (f32, [f32; 3]) {
        let third = (w[0] * p[0].z + w[1] * p[1].z + w[2] * p[2].z) / sum;
        if self.grid.view.perspective {
            let z = 1.0 / third;
            (z, std::array::from_fn(|k| w[k] * p[k].z * z / sum))
        } else {
            (third, w.map(|w| w / sum))
        }
    }

    /// Any micropolygon: a ray through each sample's lens point at its time, against the corners where they are then.
    ///
    /// The edge functions are those of homogeneous rasterization (Olano and Greer, Triangle Scan Conversion using
    /// 2D Homogeneous Coordinates, 1997), so that corners behind the camera need no clipping.
    fn moving(&self, at: usize, rim: [bool; 4], hit: &mut Hit<'_>) {
        let (grid, samples) = (self.grid, self.samples);
        let (nu, view) = (grid.nu, &grid.view);
        let near = view.near.max(grid.z_min);
        let corners = [at, at + 1, at + nu + 1, at + nu];
        let any_rim = rim.contains(&true);
        let pad = self.widening(any_rim);
        let (b, _) = view.bound(corners.into_iter());
        let rect = pixels_of([b[0] - pad, b[1] - pad, b[2] + pad, b[3] + pad], &self.window());
        if rect.is_empty() {
            return;
        }
        let pixel = Vec2::new(1.0 / view.scale.x, 1.0 / view.scale.y);
        let through_lens = self.through_lens(corners, pad);
        for y in rect.y0..rect.y1 {
            for x in rect.x0..rect.x1 {
                let first = samples.pixel(x, y) * samples.per_pixel;
                for s in first..first + samples.per_pixel {
                    let on_plane = (Vec2::new(samples.x[s], samples.y[s]) - view.center) * pixel;
                    let (origin, direction) = if !view.perspective {
                        (on_plane.extend(0.0), Vec3::Z)
                    } else {
                        match samples.lens.get(s).filter(|_| view.lens_radius > 0.0) {
                            Some(lens) => {
                                let o = Vec2::from(*lens);
                                let place = Vec2::new(samples.x[s], samples.y[s]);
                                if through_lens.as_ref().is_some_and(|quick| quick.misses(place, o)) {
                                    continue;
                                }
                                (o.extend(0.0), (on_plane - o / view.focus).extend(1.0))
                            }
                            None => (Vec3::ZERO, on_plane.extend(1.0)),
                        }
                    };
                    let (key, next, alpha) = match samples.time.get(s) {
                        Some(time) => crate::dicing::key_at(&view.times, *time),
                        None => (0, 0, 0.0),
                    };
                    let p = corners.map(|i| {
                        let a = view.p_cam[key][i];
                        let p = if alpha == 0.0 { a } else { a.lerp(view.p_cam[next][i], alpha) };
                        p - origin
                    });
                    if let Some((z, u, v)) = self.ray(p, direction, pixel, rim)
                        && z >= near
                        && z <= view.far
                    {
                        hit(s, z, at as u32, u, v, any_rim);
                    }
                }
            }
        }
    }

    /// The quick test of a micropolygon; `None` when it is too close to the camera for one, or there is no lens.
    fn through_lens(&self, corners: [usize; 4], pad: f32) -> Option<ThroughLens> {
        let view = &self.grid.view;
        let mut quick = ThroughLens {
            lo: Vec2::INFINITY,
            hi: Vec2::NEG_INFINITY,
            scale: view.scale,
            near: f32::INFINITY,
            far: f32::NEG_INFINITY,
        };
        for p in view.p_cam.iter().flat_map(|key| corners.map(|i| key[i])) {
            if view.lens_radius == 0.0 || p.z < view.near {
                return None;
            }
            let q = view.project(p);
            (quick.lo, quick.hi) = (quick.lo.min(q - pad), quick.hi.max(q + pad));
            (quick.near, quick.far) = (quick.near.min(p.z), quick.far.max(p.z));
        }
        // Room for rounding.
        let room = 0.01 + 1e-5 * (quick.lo.abs().max(quick.hi.abs()).max_element());
        (quick.lo, quick.hi) = (quick.lo - room, quick.hi + room);
        (quick.near, quick.far) = (1.0 / view.focus - 1.0 / quick.near, 1.0 / view.focus - 1.0 / quick.far);
        Some(quick)
    }

    /// A ray from the origin through the two triangles of a micropolygon; depth along z and place.
    fn ray(&self, p: [Vec3; 4], direction: Vec3, pixel: Vec2, rim: [bool; 4]) -> Option<(f32, f32, f32)> {
        // Normals of the planes through the origin and an edge; exactly opposite for opposite directions.
        let plane = |i: usize, j: usize| p[i].cross(p[j]);
        let diagonal = plane(0, 2);
        let sides = [plane(0, 1), plane(1, 2), plane(2, 3), plane(3, 0)];
        let pad: [f32; 4] = std::array::from_fn(|k| {
            if rim[k] && self.grid.rim_px > 0.0 {
                self.grid.rim_px * (sides[k].truncate() * pixel).length()
            } else {
                0.0
            }
        });
        let e = sides.map(|n| n.dot(direction));
        let d = diagonal.dot(direction);
        let triangles = [
            ([p[0], p[1], p[2]], [e[0], e[1], -d], [pad[0], pad[1], 0.0]),
            ([p[0], p[2], p[3]], [d, e[2], e[3]], [0.0, pad[2], pad[3]]),
        ];
        for (second, (corner, e, pad)) in triangles.into_iter().enumerate() {
            let sum = e[0] + e[1] + e[2];
            let sign = if sum < 0.0 { -1.0 } else { 1.0 };
            if sum == 0.0 || !sum.is_finite() || (0..3).any(|k| e[k] * sign < -pad[k]) {
                continue;
            }
            let w = [e[1], e[2], e[0]].map(|w| (w / sum).clamp(0.0, 1.0));
            let total = w[0] + w[1] + w[2];
            let w = w.map(|w| w / total);
            let z = w[0] * corner[0].z + w[1] * corner[1].z + w[2] * corner[2].z;
            let (u, v) = place(second == 1, w);
            return Some((z, u, v));
        }
        None
    }
}

/// Tells most misses of a lens without intersecting: a point at depth `z`, seen through the lens point `l`, appears
/// `scale * l * (1 / focus - 1 / z)` away from where a pinhole shows it.
struct ThroughLens {
    /// Raster box as a pinhole shows it.
    lo: Vec2,
    hi: Vec2,
    scale: Vec2,
    /// `1 / focus - 1 / z` of the nearest and farthest corner.
    near: f32,
    far: f32,
}

impl ThroughLens {
    /// Whether a sample at `place` through the lens point `lens` surely misses.
    fn misses(&self, place: Vec2, lens: Vec2) -> bool {
        let shift = self.scale * lens;
        let (a, b) = (place - shift * self.near, place - shift * self.far);
        a.max(b).cmplt(self.lo).any() || a.min(b).cmpgt(self.hi).any()
    }
}

/// Place in the micropolygon from the weights in one of its triangles.
fn place(second: bool, w: [f32; 3]) -> (f32, f32) {
    if second { (w[1], (w[1] + w[2]).min(1.0)) } else { ((w[1] + w[2]).min(1.0), w[2]) }
}
