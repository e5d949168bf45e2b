//! Finds which samples hit which micropolygons.

use super::blurred::Scratch;
use super::hit::{Hit, Raster, Sink, before, spans};
use super::lanes::{LANES, first_lanes};
use super::visible::pixels_of;
use granita_base::{Vec2, Vec3};
use granita_dicing::PixelRect;
use granita_machine::simd::{Kernel, Simd, dispatch};

/// [`Raster::find`], compiled for a kind of vectors.
struct EachHit<'r, 'a, 'h, K> {
    raster: &'r Raster<'a>,
    room: &'h mut Scratch,
    sink: &'h mut K,
}

impl<K: Sink> Kernel for EachHit<'_, '_, '_, K> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        self.raster.find(simd, self.room, self.sink);
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

    /// Returns the numbers of the edge in all lanes of vectors.
    #[inline(always)]
    fn wide<S: Simd>(&self, simd: S) -> WideEdge<S> {
        let [a, b, ox, oy, least_rim] =
            [self.a, self.b, self.ox, self.oy, self.least_rim].map(|x| simd.splat8(x));
        WideEdge { a, b, ox, oy, least_rim }
    }
}

/// The numbers of an [`Edge`] in all lanes of vectors. They are vectors of the machine instead of [`Lanes`], because
/// compilers would otherwise combine several edges in one vector.
struct WideEdge<S: Simd> {
    a: S::F8,
    b: S::F8,
    ox: S::F8,
    oy: S::F8,
    least_rim: S::F8,
}

impl<S: Simd> WideEdge<S> {
    /// Returns the function of the edge at eight points.
    #[inline(always)]
    fn at(&self, simd: S, x: S::F8, y: S::F8) -> S::F8 {
        let along_x = simd.mul8(simd.sub8(x, self.ox), self.a);
        let along_y = simd.mul8(simd.sub8(y, self.oy), self.b);
        simd.add8(along_x, along_y)
    }
}

/// The pixels in which a grid may be visible.
struct Window {
    pixels: PixelRect,
    /// The sides (x0, y0, x1, y1) of a slightly larger box.
    sides: [f32; 4],
}

impl Window {
    /// Returns the window of these pixels for a grid whose boundary edge is widened by `rim_px` raster pixels.
    fn new(pixels: PixelRect, rim_px: f32) -> Self {
        let PixelRect { x0, y0, x1, y1 } = pixels.grown(1);
        let [x0, y0, x1, y1] = [x0, y0, x1, y1].map(|side| side as f32);
        Self { pixels, sides: [x0 - rim_px, y0 - rim_px, x1 + rim_px, y1 + rim_px] }
    }

    /// True when a raster box touches no pixel of the window. It may be false for a box directly beside it, and it is
    /// false for sides that are NaN.
    #[inline(always)]
    fn is_beside(&self, [x0, y0, x1, y1]: &[f32; 4]) -> bool {
        let sides = &self.sides;
        (*x1 < sides[0]) | (*y1 < sides[1]) | (*x0 > sides[2]) | (*y0 > sides[3])
    }
}

/// One of the two triangles of a micropolygon that does not move, in raster space.
struct Triangle<S: Simd> {
    edges: [Edge; 3],
    wide: [WideEdge<S>; 3],
    /// The third coordinates of its corners; see [`super::ViewedGrid::raster`].
    depths: [f32; 3],
    /// 1 / twice its area.
    inverse: f32,
    /// True for the triangle of the upper left half.
    second: bool,
    /// True when the micropolygon is on the boundary edge of its grid.
    any_rim: bool,
    /// A depth that is not behind any of its hits.
    nearest: f32,
}

impl Raster<'_> {
    /// Finds all hits, in the order of the micropolygons.
    ///
    /// The search uses the widest vector instructions of the machine. They do not change the result.
    pub(super) fn each_hit(&self, room: &mut Scratch, sink: &mut impl Sink) {
        dispatch(EachHit { raster: self, room, sink });
    }

    #[inline(always)]
    fn find(&self, simd: impl Simd, room: &mut Scratch, sink: &mut impl Sink) {
        let grid = self.grid;
        let (mu, mv) = (grid.nu.saturating_sub(1), grid.nv.saturating_sub(1));
        if !self.find_live(simd, &mut room.streaks) {
            return;
        }
        let window = Window::new(self.window(), self.view.rim_px);
        if window.is_beside(&self.view.extent) {
            return;
        }
        for j in 0..mv {
            if self.view.rows.get(j).is_some_and(|row| window.is_beside(row)) {
                continue;
            }
            for i in 0..mu {
                if grid.kept.get(j * mu + i).is_some_and(|kept| !kept) {
                    continue;
                }
                // The sides are in the order v = 0, u = 1, v = 1, u = 0.
                let [s0, s1, s2, s3] = grid.sides;
                let rim = [s0 && j == 0, s1 && i + 1 == mu, s2 && j + 1 == mv, s3 && i == 0];
                if self.view.raster.is_empty() {
                    if window.is_beside(&self.view.boxes[j * mu + i]) {
                        continue;
                    }
                    self.moving(simd, (j * grid.nu + i, j * mu + i), rim, room, sink);
                } else {
                    self.still(simd, (j * grid.nu + i, &window), rim, sink);
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
    fn still<S: Simd>(&self, simd: S, (at, window): (usize, &Window), rim: [bool; 4], sink: &mut impl Sink) {
        let (view, samples) = (self.view, self.samples);
        let nu = self.grid.nu;
        let corner = [at, at + 1, at + nu + 1, at + nu].map(|i| view.raster[i]);
        let (lo, hi) =
            corner[1..].iter().fold((corner[0], corner[0]), |(lo, hi), c| (lo.min(*c), hi.max(*c)));
        if window.is_beside(&[lo.x, lo.y, hi.x, hi.y]) {
            return;
        }
        let any_rim = rim.contains(&true);
        let pad = self.widening(any_rim);
        let rect = pixels_of([lo.x - pad, lo.y - pad, hi.x + pad, hi.y + pad], &window.pixels);
        if rect.is_empty() {
            return;
        }
        let nearest = before(if view.perspective { 1.0 / hi.z } else { lo.z });
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
            let edge = |k: usize| Edge::new(q[k], q[(k + 1) % 3], sign, self.widening(rims[k]));
            let edges = [edge(0), edge(1), edge(2)];
            let triangle = Triangle {
                wide: [edges[0].wide(simd), edges[1].wide(simd), edges[2].wide(simd)],
                edges,
                depths: p.map(|p| p.z),
                inverse: 1.0 / area.abs(),
                second: second == 1,
                any_rim,
                nearest,
            };
            samples.each_run(
                rect,
                #[inline(always)]
                |run| {
                    for first in run.clone().step_by(LANES) {
                        self.eight(simd, (at as u32, &triangle), (first, run.end - first), sink);
                    }
                },
            );
        }
    }

    /// Samples a triangle with the first `used` of the eight samples from the index `first` on.
    #[inline(always)]
    fn eight<S: Simd>(
        &self,
        simd: S,
        (at, triangle): (u32, &Triangle<S>),
        (first, used): (usize, usize),
        sink: &mut impl Sink,
    ) {
        let (view, samples) = (self.view, self.samples);
        let (edges, wide) = (&triangle.edges, &triangle.wide);
        let (x, y) = (eight_at(simd, &samples.x, first), eight_at(simd, &samples.y, first));
        let e = [wide[0].at(simd, x, y), wide[1].at(simd, x, y), wide[2].at(simd, x, y)];
        let slack = |k: usize| simd.sub8(e[k], wide[k].least_rim);
        let least = simd.min8(simd.min8(slack(0), slack(1)), slack(2));
        let mut inside = simd.lt8(simd.splat8(0.0), least);
        if inside == 0 {
            return;
        }
        inside &= first_lanes(used);
        if let Some(limits) = sink.limits() {
            let room = simd.sub8(eight_at(simd, limits, first), simd.splat8(triangle.nearest));
            inside &= simd.lt8(simd.splat8(0.0), room);
        }
        if inside == 0 {
            return;
        }
        // Edge k lies opposite to corner k + 2.
        let (zero, one, inverse) = (simd.splat8(0.0), simd.splat8(1.0), simd.splat8(triangle.inverse));
        let weight = |e: S::F8| simd.min8(one, simd.max8(zero, simd.mul8(e, inverse)));
        let w = [weight(e[1]), weight(e[2]), weight(e[0])];
        let depths = [0, 1, 2].map(|k: usize| simd.splat8(triangle.depths[k]));
        // The depth follows from the third coordinates of the corners, and the weights are correct for the
        // perspective and sum to one.
        let sum = simd.add8(simd.add8(w[0], w[1]), w[2]);
        let term = |k: usize| simd.mul8(w[k], depths[k]);
        let third = simd.div8(simd.add8(simd.add8(term(0), term(1)), term(2)), sum);
        let z = if view.perspective { simd.div8(one, third) } else { third };
        let near = view.near.max(view.z_min);
        inside &= simd.le8(simd.splat8(near), z) & simd.le8(z, simd.splat8(view.far));
        if let Some(limits) = sink.limits() {
            inside &= simd.lt8(z, eight_at(simd, limits, first));
        }
        if inside == 0 {
            return;
        }
        let share = |k: usize| {
            let w = if view.perspective { simd.mul8(term(k), z) } else { w[k] };
            simd.div8(w, sum)
        };
        let (w1, w2) = (share(1), share(2));
        let along = simd.min8(simd.add8(w1, w2), one);
        let (u, v) = if triangle.second { (w1, along) } else { (along, w2) };
        let [z, u, v] = [z, u, v].map(|lanes| simd.store8(lanes));
        let hit = |lane: usize, beside: Option<Vec2>| Hit {
            sample: first + lane,
            z: z[lane],
            at,
            u: u[lane],
            v: v[lane],
            rim: triangle.any_rim,
            beside,
        };
        if !triangle.any_rim {
            // The boundary edge is not widened, so that these samples are inside.
            while inside != 0 {
                let lane = inside.trailing_zeros() as usize;
                inside &= inside - 1;
                sink.hit(hit(lane, None));
            }
            return;
        }
        let [x, y] = [x, y].map(|lanes| simd.store8(lanes));
        let e = e.map(|lanes| simd.store8(lanes));
        while inside != 0 {
            let lane = inside.trailing_zeros() as usize;
            inside &= inside - 1;
            let crossed = (0..3).find(|k| e[*k][lane] <= edges[*k].least);
            let beside = crossed.map(|k| &edges[k]);
            if beside.is_some_and(|edge| !edge.spans(x[lane], y[lane], view.rim_px)) {
                continue;
            }
            sink.hit(hit(lane, beside.map(|edge| Vec2::new(edge.a, edge.b))));
        }
    }
}

/// Loads the numbers from index `at` on.
#[inline(always)]
fn eight_at<S: Simd>(simd: S, list: &[f32], at: usize) -> S::F8 {
    simd.load8(list[at..at + LANES].first_chunk().unwrap_or(&[0.0; LANES]))
}
