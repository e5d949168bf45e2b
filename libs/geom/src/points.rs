//! Particles (reference 2.8.3), which are disks that face the viewer; see [`crate::Dice::facing`].
//!
//! A particle that is diced to two by two points is a square of the disk's area. With more points it follows the
//! disk's outline.

use crate::GeomError;
use crate::dice::{Dice, Facing, View};
use crate::key::ShapeKey;
use crate::net::rounded_out;
use crate::order::spatial_order;
use crate::range::Range;
use crate::surface::{Piece, SplitDirection, Surface};
use crate::vars::{Control, Counts, Report, Vars, control, take_normals, vertex_count};
use crate::width::{WidthCounts, Widths};
use granita_base::{Bound, Severity, Vec3};
use std::sync::Arc;

const CALL: &str = "Points";

/// Half the side of a square with the area of the unit disk, which is half the square root of pi.
const SQUARE: f32 = 0.886_226_9;

struct Points {
    times: Vec<f32>,
    control: Control,
    vars: Vars,
    /// The widths for each key.
    widths: Vec<Widths>,
    /// True when the widths are in pixels.
    raster: bool,
    /// The indices of the particles that can be drawn, ordered so that neighbours are together.
    order: Vec<u32>,
}

struct PointsPiece {
    all: Arc<Points>,
    /// The positions in the order.
    particles: std::ops::Range<usize>,
    range: [Range; 2],
    bounds: Vec<Bound>,
    raster_width: f32,
}

/// Builds `n` particles.
pub(crate) fn build(keys: &[ShapeKey<'_>], n: usize, report: Report<'_>) -> Result<Vec<Piece>, GeomError> {
    if n == 0 {
        return Ok(Vec::new());
    }
    vertex_count(CALL, keys, report)?;
    let counts = Counts { vertex: Some(n), linear: Some(n), perpiece: Some(n) };
    let vars = Vars::collect(CALL, keys[0].params, counts, report);
    let control = control(CALL, keys, n, &vars, report)?.divided();
    let counts = WidthCounts { perpiece: n, linear: n, vertex: n };
    let raster = Widths::collect(CALL, keys, "rasterwidth", counts, report);
    let is_raster = raster.is_some();
    let widths = raster
        .or_else(|| Widths::collect(CALL, keys, "width", counts, report))
        .unwrap_or_else(|| vec![Widths::Constant(1.0); keys.len()]);
    let good: Vec<u32> = (0..n).filter(|&i| control.is_finite(i)).map(|i| i as u32).collect();
    if good.len() < n {
        let text = format!(
            "{CALL}: {} of {n} points have positions that are not finite and are left out",
            n - good.len()
        );
        report(Severity::Warning, text);
    }
    if good.is_empty() {
        return Ok(Vec::new());
    }
    let centres: Vec<Vec3> = good.iter().map(|&i| control.position(i as usize, 0)).collect();
    let order: Vec<u32> = spatial_order(&centres).into_iter().map(|i| good[i as usize]).collect();
    let times = keys.iter().map(|k| k.time).collect();
    let particles = 0..order.len();
    let all = Arc::new(Points { times, control, vars, widths, raster: is_raster, order });
    Ok(vec![Box::new(PointsPiece::new(all, particles, [Range::whole(1); 2]))])
}

impl Points {
    fn width(&self, key: usize, i: usize) -> f32 {
        match &self.widths[key] {
            Widths::Constant(w) => *w,
            Widths::PerPiece(list) | Widths::Linear(list) | Widths::Vertex(list) => list[i],
        }
    }
}

/// Maps the square [-1, 1]^2 to the unit disk (Shirley and Chiu, "A Low Distortion Map Between Disk and Square",
/// Journal of Graphics Tools 2(3), 1997).
fn disk(x: f64, y: f64) -> [f64; 2] {
    const EIGHTH: f64 = std::f64::consts::FRAC_PI_4;
    if x == 0.0 && y == 0.0 {
        return [0.0, 0.0];
    }
    let (r, angle) = if x.abs() > y.abs() { (x, EIGHTH * y / x) } else { (y, EIGHTH * (2.0 - x / y)) };
    [r * libm::cos(angle), r * libm::sin(angle)]
}

impl PointsPiece {
    fn new(all: Arc<Points>, particles: std::ops::Range<usize>, range: [Range; 2]) -> Self {
        let mut piece = Self { all, particles, range, bounds: Vec::new(), raster_width: 0.0 };
        let all = &*piece.all;
        let list = || all.order[piece.particles.clone()].iter().map(|&i| i as usize);
        let corner = SQUARE * std::f32::consts::SQRT_2;
        let bound_at = |key: usize| {
            let around = |i: usize| {
                let p = all.control.position(i, key);
                let radius = if all.raster { 0.0 } else { all.width(key, i) * 0.5 * corner };
                Bound::around([p]).padded(radius)
            };
            rounded_out(list().map(around).fold(Bound::EMPTY, Bound::union))
        };
        let bounds = (0..all.times.len()).map(bound_at).collect();
        let widest = (0..all.times.len()).flat_map(|key| list().map(move |i| all.width(key, i)));
        let raster_width = if all.raster { widest.fold(0.0, f32::max) * corner } else { 0.0 };
        piece.bounds = bounds;
        piece.raster_width = raster_width;
        piece
    }

    fn key(&self, key: usize) -> usize {
        key.min(self.bounds.len() - 1)
    }
}

impl Surface for PointsPiece {
    fn key_times(&self) -> &[f32] {
        &self.all.times
    }

    fn bound(&self, key: usize) -> Bound {
        self.bounds[self.key(key)]
    }

    fn positions(&self, key: usize, nu: usize, nv: usize, out: &mut Vec<Vec3>) {
        *out = std::mem::take(&mut self.dice(nu, nv).p[self.key(key)]);
    }

    fn positions_towards(
        &self,
        key: usize,
        nu: usize,
        nv: usize,
        view: &dyn Fn(usize, Vec3) -> View,
        out: &mut Vec<Vec3>,
    ) {
        let mut dice = self.dice(nu, nv);
        dice.turn(view);
        *out = std::mem::take(&mut dice.p[self.key(key)]);
    }

    fn domain(&self) -> [f32; 4] {
        let (u, v) = (self.range[0].ends(), self.range[1].ends());
        [u.0 as f32, u.1 as f32, v.0 as f32, v.1 as f32]
    }

    fn is_splittable(&self) -> bool {
        // Where one parameter can no longer be divided, the width is so large that dividing the other parameter would
        // give equally wide parts.
        self.must_split() || self.range.iter().all(|r| r.halves().is_some())
    }

    fn is_group(&self) -> bool {
        self.particles.len() > 1
    }

    fn must_split(&self) -> bool {
        self.is_group()
    }

    fn split(&self, direction: SplitDirection) -> Vec<Piece> {
        let piece = |particles, range| -> Piece { Box::new(Self::new(self.all.clone(), particles, range)) };
        if self.must_split() {
            let middle = self.particles.start + self.particles.len() / 2;
            let halves = [self.particles.start..middle, middle..self.particles.end];
            return halves.map(|half| piece(half, self.range)).into();
        }
        let mut axis = usize::from(direction == SplitDirection::V);
        if self.range[axis].halves().is_none() {
            axis = 1 - axis;
        }
        let Some((left, right)) = self.range[axis].halves() else { return Vec::new() };
        let with = |half| {
            let mut range = self.range;
            range[axis] = half;
            piece(self.particles.clone(), range)
        };
        vec![with(left), with(right)]
    }

    fn dice(&self, nu: usize, nv: usize) -> Dice {
        let (nu, nv) = (nu.max(2), nv.max(2));
        let (all, n) = (&*self.all, nu * nv);
        let particle = all.order[self.particles.start] as usize;
        let square = nu == 2 && nv == 2 && self.range.iter().all(Range::is_whole);
        let along = |axis: usize, n: usize| -> Vec<f64> {
            (0..n).map(|i| self.range[axis].place(i, n)).map(|p| p.b - p.a).collect()
        };
        let (us, vs) = (along(0, nu), along(1, nv));
        let offset: Vec<[f32; 2]> = (0..n)
            .map(|i| {
                let (x, y) = (us[i % nu], vs[i / nu]);
                if square { [x as f32 * SQUARE, y as f32 * SQUARE] } else { disk(x, y).map(|x| x as f32) }
            })
            .collect();
        let mut dice = Dice { nu, nv, face: particle as u32, ..Dice::default() };
        dice.u = offset.iter().map(|o| o[0] * 0.5 + 0.5).collect();
        dice.v = offset.iter().map(|o| o[1] * 0.5 + 0.5).collect();
        dice.primvars = all.vars.uniform(particle);
        dice.primvars.extend(all.vars.at_vertex(particle));
        dice.n = take_normals(n, &mut dice.primvars);
        let keys = 0..all.times.len();
        dice.facing = Some(Facing {
            centre: keys.clone().map(|key| vec![all.control.position(particle, key); n]).collect(),
            tangent: Vec::new(),
            width: keys.map(|key| vec![all.width(key, particle); n]).collect(),
            raster: all.raster,
            offset,
        });
        dice.turn(&|_, _| View { toward: Vec3::Z, pixel: 1.0 });
        dice
    }

    fn is_facing(&self) -> bool {
        true
    }

    fn raster_width(&self) -> f32 {
        self.raster_width
    }
}
