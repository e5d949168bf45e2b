//! Finds which samples hit which micropolygons.

use super::blurred::Scratch;
use super::hit::{Hit, Raster, Sink, before, spans};
use super::lanes::{LANES, Lanes, Signs, first_lanes};
use super::visible::pixels_of;
use granita_base::{Vec2, Vec3};
use granita_dicing::PixelRect;
use granita_machine::simd::{Kernel, Simd, dispatch};

/// [`Raster::find`], compiled for a kind of vectors.
struct EachHit<'r, 'a, 'h, K> {
    raster: &'r Raster<'a>,
    sink: &'h mut K,
}

impl<K: Sink> Kernel for EachHit<'_, '_, '_, K> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        self.raster.find(simd, self.sink);
    }
}

/// One edge of a triangle in raster space. Its function `(x - ox) * a + (y - oy) * b` is positive inside.
#[derive(Clone, Copy)]
struct Edge {
    a: f32,
    b: f32,
    ox: f32,
    oy: f32,
    /// A sample is inside of the edge above this value.
    least: f32,
    /// A sample is inside of the widened boundary edge above this value.
    least_rim: f32,
    /// The vector from the start to the end of the edge.
    d: Vec2,
}

impl Edge {
    /// Returns the edge from `p` to `q`. `sign` is the sign of the triangle's area. The arithmetic does not depend on
    /// the direction, so that two triangles that share an edge agree about every sample.
    #[inline(always)]
    fn new(p: Vec2, q: Vec2, sign: f32, widen: f32) -> Self {
        let swapped = (q.x, q.y) < (p.x, p.y);
        let (p, q, sign) = if swapped { (q, p, -sign) } else { (p, q, sign) };
        let d = q - p;
        // A sample exactly on the edge belongs to the triangle for which the edge runs forward.
        let least = if sign > 0.0 { -f32::MIN_POSITIVE } else { 0.0 };
        let least_rim = if widen > 0.0 { -widen * d.length() } else { least };
        Self { a: -d.y * sign, b: d.x * sign, ox: p.x, oy: p.y, least, least_rim, d }
    }

    /// True when a point is beside the edge and not beyond its ends.
    fn spans(&self, x: f32, y: f32, pad: f32) -> bool {
        spans(self.d, Vec2::new(x - self.ox, y - self.oy), pad)
    }

    #[inline(always)]
    fn lanes(&self, x: Lanes, y: Lanes) -> Lanes {
        (x - self.ox) * self.a + (y - self.oy) * self.b
    }
}

impl Raster<'_> {
    /// Finds all hits, in the order of the micropolygons.
    ///
    /// The search uses the widest vector instructions of the machine. They do not change the result.
    pub(super) fn each_hit(&self, sink: &mut impl Sink) {
        dispatch(EachHit { raster: self, sink });
    }

    #[inline(always)]
    fn find(&self, simd: impl Simd, sink: &mut impl Sink) {
        let grid = self.grid;
        let (mu, mv) = (grid.nu.saturating_sub(1), grid.nv.saturating_sub(1));
        let mut room = Scratch::default();
        if !self.find_live(&mut room.streaks) {
            return;
        }
        for j in 0..mv {
            for i in 0..mu {
                if grid.kept.get(j * mu + i).is_some_and(|kept| !kept) {
                    continue;
                }
                // The sides are in the order v = 0, u = 1, v = 1, u = 0.
                let [s0, s1, s2, s3] = grid.sides;
                let rim = [s0 && j == 0, s1 && i + 1 == mu, s2 && j + 1 == mv, s3 && i == 0];
                if self.view.raster.is_empty() {
                    self.moving(simd, (j * grid.nu + i, j * mu + i), rim, &mut room, sink);
                } else {
                    self.still(simd, j * grid.nu + i, rim, sink);
                }
            }
        }
    }

    /// Returns the pixels in which the grid may be visible.
    #[inline(always)]
    pub(super) fn window(&self) -> PixelRect {
        self.samples.rect.intersection(&self.view.rect)
    }

    #[inline(always)]
    pub(super) fn widening(&self, rim: bool) -> f32 {
        if rim { self.view.rim_px } else { 0.0 }
    }

    /// Samples a micropolygon that does not move and lies entirely before the camera, without a lens.
    #[inline(always)]
    fn still(&self, simd: impl Simd, at: usize, rim: [bool; 4], sink: &mut impl Sink) {
        let (view, samples) = (self.view, self.samples);
        let nu = self.grid.nu;
        let near = view.near.max(view.z_min);
        let corner = [at, at + 1, at + nu + 1, at + nu].map(|i| view.raster[i]);
        let (lo, hi) =
            corner[1..].iter().fold((corner[0], corner[0]), |(lo, hi), c| (lo.min(*c), hi.max(*c)));
        let any_rim = rim.contains(&true);
        let pad = self.widening(any_rim);
        let rect = pixels_of([lo.x - pad, lo.y - pad, hi.x + pad, hi.y + pad], &self.window());
        if rect.is_empty() {
            return;
        }
        let nearest = Lanes::splat(before(if view.perspective { 1.0 / hi.z } else { lo.z }));
        // The triangles are (0, 1, 2) and (0, 2, 3). The diagonal is not a boundary edge.
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
            for run in samples.runs(rect) {
                for first in run.clone().step_by(LANES) {
                    let (x, y) = (Lanes::load(&samples.x, first), Lanes::load(&samples.y, first));
                    let e = [edges[0].lanes(x, y), edges[1].lanes(x, y), edges[2].lanes(x, y)];
                    let slack = |k: usize| e[k] - edges[k].least_rim;
                    let mut inside = simd.positive(slack(0).min(slack(1)).min(slack(2)));
                    if inside == 0 {
                        continue;
                    }
                    inside &= first_lanes(run.end - first);
                    if let Some(limits) = sink.limits() {
                        inside &= simd.positive(Lanes::load(limits, first) - nearest);
                    }
                    while inside != 0 {
                        let lane = inside.trailing_zeros() as usize;
                        inside &= inside - 1;
                        let e = e.map(|e| e.0[lane]);
                        let crossed = (0..3).find(|k| e[*k] <= edges[*k].least);
                        if crossed.is_some_and(|k| !edges[k].spans(x.0[lane], y.0[lane], pad)) {
                            continue;
                        }
                        let beside = crossed.map(|k| Vec2::new(edges[k].a, edges[k].b));
                        // Edge k lies opposite to corner k + 2.
                        let w = [e[1] * inverse, e[2] * inverse, e[0] * inverse].map(|w| w.clamp(0.0, 1.0));
                        let sum = w[0] + w[1] + w[2];
                        let (z, w) = self.depth(p, w, sum);
                        if !(z >= near && z <= view.far) {
                            continue;
                        }
                        let (u, v) = place(second == 1, w);
                        sink.hit(Hit { sample: first + lane, z, at: at as u32, u, v, rim: any_rim, beside });
                    }
                }
            }
        }
    }

    /// Returns the depth from the third coordinate of the corners, and the perspective-correct weights, which sum to
    /// one.
    #[inline(always)]
    fn depth(&self, p: [Vec3; 3], w: [f32; 3], sum: f32) -> (f32, [f32; 3]) {
        let third = (w[0] * p[0].z + w[1] * p[1].z + w[2] * p[2].z) / sum;
        if self.view.perspective {
            let z = 1.0 / third;
            (z, std::array::from_fn(|k| w[k] * p[k].z * z / sum))
        } else {
            (third, w.map(|w| w / sum))
        }
    }
}

/// Returns the coordinates in the micropolygon from the weights in one of its triangles.
#[inline(always)]
fn place(second: bool, w: [f32; 3]) -> (f32, f32) {
    if second { (w[1], (w[1] + w[2]).min(1.0)) } else { ((w[1] + w[2]).min(1.0), w[2]) }
}
