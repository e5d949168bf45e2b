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

    #[inline(always)]
    fn lanes(&self, x: Lanes, y: Lanes) -> Lanes {
        (x - self.ox) * self.a + (y - self.oy) * self.b
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
struct Triangle {
    edges: [Edge; 3],
    /// The third coordinates of its corners; see [`super::ViewedGrid::raster`].
    depths: [f32; 3],
    /// 1 / twice its area.
    inverse: f32,
    /// True for the triangle of the upper left half.
    second: bool,
    /// True when the micropolygon is on the boundary edge of its grid.
    any_rim: bool,
    /// A depth that is not behind any of its hits.
    nearest: Lanes,
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
        if !self.find_live(&mut room.streaks) {
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
    fn still(&self, simd: impl Simd, (at, window): (usize, &Window), rim: [bool; 4], sink: &mut impl Sink) {
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
            let triangle = Triangle {
                edges,
                depths: p.map(|p| p.z),
                inverse: 1.0 / area.abs(),
                second: second == 1,
                any_rim,
                nearest,
            };
            for run in samples.runs(rect) {
                for first in run.clone().step_by(LANES) {
                    self.eight(simd, (at as u32, &triangle), (first, run.end - first), sink);
                }
            }
        }
    }

    /// Samples a triangle with the first `used` of the eight samples from the index `first` on.
    #[inline(always)]
    fn eight(
        &self,
        simd: impl Simd,
        (at, triangle): (u32, &Triangle),
        (first, used): (usize, usize),
        sink: &mut impl Sink,
    ) {
        let (view, samples) = (self.view, self.samples);
        let edges = &triangle.edges;
        let (x, y) = (Lanes::load(&samples.x, first), Lanes::load(&samples.y, first));
        let e = [edges[0].lanes(x, y), edges[1].lanes(x, y), edges[2].lanes(x, y)];
        let slack = |k: usize| e[k] - edges[k].least_rim;
        let mut inside = simd.positive(slack(0).min(slack(1)).min(slack(2)));
        if inside == 0 {
            return;
        }
        inside &= first_lanes(used);
        if let Some(limits) = sink.limits() {
            inside &= simd.positive(Lanes::load(limits, first) - triangle.nearest);
        }
        if inside == 0 {
            return;
        }
        // Edge k lies opposite to corner k + 2.
        let w = [e[1], e[2], e[0]].map(|e| (e * triangle.inverse).unit());
        let (z, w) = self.depth(&triangle.depths, w);
        let near = view.near.max(view.z_min);
        inside &= simd.not_above(Lanes::splat(near), z) & simd.not_above(z, Lanes::splat(view.far));
        if let Some(limits) = sink.limits() {
            inside &= simd.less(z, Lanes::load(limits, first));
        }
        let (u, v) = place(triangle.second, w);
        let hit = |lane: usize, beside: Option<Vec2>| Hit {
            sample: first + lane,
            z: z.0[lane],
            at,
            u: u.0[lane],
            v: v.0[lane],
            rim: triangle.any_rim,
            beside,
        };
        while inside != 0 {
            let lane = inside.trailing_zeros() as usize;
            inside &= inside - 1;
            let crossed = match triangle.any_rim {
                true => (0..3).find(|k| e[*k].0[lane] <= edges[*k].least),
                // The boundary edge is not widened, so that these samples are inside.
                false => None,
            };
            let beside = crossed.map(|k| &edges[k]);
            if beside.is_some_and(|edge| !edge.spans(x.0[lane], y.0[lane], view.rim_px)) {
                continue;
            }
            sink.hit(hit(lane, beside.map(|edge| Vec2::new(edge.a, edge.b))));
        }
    }

    /// Returns the depth from the third coordinates of the corners, and the perspective-correct weights, which sum to
    /// one.
    #[inline(always)]
    fn depth(&self, corners: &[f32; 3], w: [Lanes; 3]) -> (Lanes, [Lanes; 3]) {
        let sum = w[0] + w[1] + w[2];
        let third = (w[0] * corners[0] + w[1] * corners[1] + w[2] * corners[2]) / sum;
        if self.view.perspective {
            let z = Lanes::splat(1.0) / third;
            (z, std::array::from_fn(|k| w[k] * corners[k] * z / sum))
        } else {
            (third, w.map(|w| w / sum))
        }
    }
}

/// Returns the coordinates in the micropolygon from the weights in one of its triangles.
#[inline(always)]
fn place(second: bool, w: [Lanes; 3]) -> (Lanes, Lanes) {
    let along = (w[1] + w[2]).min(Lanes::splat(1.0));
    if second { (w[1], along) } else { (along, w[2]) }
}
