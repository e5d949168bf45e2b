//! How finely a piece is diced, and whether it must be split first.

use super::Placement;
use crate::{CameraView, Projection};
use granita_base::{Transform, Vec3};
use granita_geom::{SplitDirection, Surface};
use granita_scene::AttributeSet;

/// Points of the lattice that a piece is measured on, along each parameter.
const LATTICE: usize = 5;

/// Deepest nesting of splits: enough to halve a piece a million times over in both directions.
const MAX_DEPTH: u32 = 40;

/// Most points along one direction of a grid, whatever the grid size.
const MAX_POINTS: usize = 1 << 12;

/// Dicing attributes of one object (reference 4.4.4, 4.4.5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DiceSettings {
    /// Shading samples per raster unit, above 0.
    pub(crate) quality: f32,
    /// Most points of a grid, at least 4.
    pub(crate) gridsize: usize,
    /// Turning angle (radians) that forces another segment while micropolygons are not tiny.
    pub(crate) curvature: f32,
    /// Turning angle that always forces another segment.
    pub(crate) highcurvature: f32,
    /// Round segments up to powers of two.
    pub(crate) binary: bool,
    /// Measure as seen from the camera; otherwise as if turned towards it.
    pub(crate) rasterorient: bool,
    /// Segments per unit of u and v; `None` when adaptive.
    pub(crate) fixed: Option<[f32; 2]>,
}

impl DiceSettings {
    /// From the attributes of an object; `camera` for its preview mode.
    pub(crate) fn new(attributes: &AttributeSet, gridsize: i32, camera: &CameraView) -> Self {
        let preview = camera.preview > 0.0;
        let positive = |v: f32, default: f32| if v.is_finite() && v > 0.0 { v } else { default };
        let quality = if preview { camera.preview } else { attributes.float("shadingquality") };
        let curvature_deg =
            if preview { camera.preview_dicecurvature_deg } else { attributes.float("dice:curvature") };
        let fixed = attributes.floats("dice:fixed");
        Self {
            quality: positive(quality, 1.0).clamp(1e-4, 1e3),
            gridsize: if gridsize > 0 { (gridsize as usize).clamp(4, 1 << 16) } else { 256 },
            curvature: positive(curvature_deg, 10.0).to_radians(),
            highcurvature: positive(attributes.float("dice:highcurvature"), 120.0).to_radians(),
            binary: attributes.int("dice:binary") != 0,
            rasterorient: attributes.int("dice:rasterorient") != 0,
            fixed: match fixed[..] {
                [u, v] if u > 0.0 && v > 0.0 => Some([u, v]),
                _ => None,
            },
        }
    }
}

/// What to do with a piece.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Plan {
    /// Dice it into `nu x nv` points.
    Dice {
        /// Points along u, at least 2.
        nu: usize,
        /// Points along v, at least 2.
        nv: usize,
    },
    /// Split it along this direction.
    Split(SplitDirection),
}

/// Measures pieces as the dicing camera sees them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Measure<'a> {
    camera: &'a CameraView,
    to_camera: Transform,
    /// Pixels per camera space unit at distance 1.
    pixels: f32,
    /// Measure by distance from the camera only: for what rays see.
    by_distance: bool,
}

impl<'a> Measure<'a> {
    /// As seen on the raster of `camera`.
    pub(crate) fn on_raster(camera: &'a CameraView) -> Self {
        let s = camera.raster_scale(1.0);
        Self {
            camera,
            to_camera: camera.world_to_camera.at(camera.shading_time()),
            pixels: s.x.abs().max(s.y.abs()),
            by_distance: false,
        }
    }

    /// As if every piece were turned towards `camera`, also behind and beside it.
    pub(crate) fn by_distance(camera: &'a CameraView) -> Self {
        Self { by_distance: true, ..Self::on_raster(camera) }
    }

    /// Decides about a piece that has been split `depth` times.
    pub(crate) fn plan(
        &self,
        piece: &dyn Surface,
        placement: &Placement,
        settings: &DiceSettings,
        depth: u32,
    ) -> Plan {
        let may_split = piece.is_splittable() && depth < MAX_DEPTH;
        let [mu, mv] = self.segments(piece, placement, settings);
        let longer = if mu >= mv { SplitDirection::U } else { SplitDirection::V };
        if piece.must_split() && may_split {
            return Plan::Split(longer);
        }
        let round = |m: f32| {
            let n = (m.min(MAX_POINTS as f32).ceil() as usize).max(1);
            if settings.binary { n.next_power_of_two() } else { n }
        };
        let (mut u, mut v) = (round(mu), round(mv));
        let too_large = |u: usize, v: usize| (u + 1) * (v + 1) > settings.gridsize.max(4);
        if too_large(u, v) {
            if may_split {
                return Plan::Split(longer);
            }
            // What cannot be split is diced as finely as the limit allows.
            while too_large(u, v) && (u > 1 || v > 1) {
                if u >= v { u = u.div_ceil(2) } else { v = v.div_ceil(2) }
            }
        }
        Plan::Dice { nu: u + 1, nv: v + 1 }
    }

    /// Segments along u and v that the settings ask for, as real numbers.
    fn segments(&self, piece: &dyn Surface, placement: &Placement, settings: &DiceSettings) -> [f32; 2] {
        if let Some([fu, fv]) = settings.fixed {
            let [u0, u1, v0, v1] = piece.domain();
            return [(fu * (u1 - u0)).abs().max(1.0), (fv * (v1 - v0)).abs().max(1.0)];
        }
        let time = placement.times()[0];
        let (key, _, _) = super::motion::key_at(piece.key_times(), time);
        let mut lattice = Vec::with_capacity(LATTICE * LATTICE);
        if piece.is_facing() {
            let viewer = super::Viewer::new(self.camera, placement, piece.key_times());
            piece.positions_towards(key, LATTICE, LATTICE, &|k, p| viewer.view(k, p), &mut lattice);
        } else {
            piece.positions(key, LATTICE, LATTICE, &mut lattice);
        }
        if lattice.len() < LATTICE * LATTICE {
            return [1.0, 1.0];
        }
        let to_camera = placement.to_world.at(time).then(&self.to_camera);
        let p_cam: Vec<Vec3> = lattice.iter().map(|p| to_camera.point(*p)).collect();
        let line = |start: usize, step: usize| {
            let points: [Vec3; LATTICE] = std::array::from_fn(|k| p_cam[start + k * step]);
            self.line(&points, settings)
        };
        let largest = |lines: &mut dyn Iterator<Item = f32>| lines.fold(1.0_f32, f32::max);
        [
            largest(&mut (0..LATTICE).map(|j| line(j * LATTICE, 1))),
            largest(&mut (0..LATTICE).map(|i| line(i, LATTICE))),
        ]
    }

    /// Segments that one line of the lattice asks for.
    fn line(&self, p: &[Vec3; LATTICE], settings: &DiceSettings) -> f32 {
        let mut length_px = 0.0;
        let mut turn = 0.0;
        let mut before: Option<Vec3> = None;
        for pair in p.windows(2) {
            let step = pair[1] - pair[0];
            length_px += self.length(pair[0], pair[1], settings.rasterorient);
            if let Some(direction) = step.try_normalize() {
                if let Some(last) = before {
                    turn += last.dot(direction).clamp(-1.0, 1.0).acos();
                }
                before = Some(direction);
            }
        }
        if !length_px.is_finite() || !turn.is_finite() {
            return 1.0;
        }
        // The lattice sees the turning at its inner points only: a circle's arc turns a little more.
        turn *= LATTICE as f32 / (LATTICE - 1) as f32;
        let by_length = length_px * settings.quality;
        // Micropolygons under a third of a pixel show no curvature.
        let by_curvature = (turn / settings.curvature).min(length_px * 3.0);
        by_length.max(by_curvature).max(turn / settings.highcurvature)
    }

    /// How much coarser what lies at depth `z` may be diced because it is out of focus: detail below a quarter of the
    /// circle of confusion is not seen. Without this, what is close to the camera would be diced as finely as if it
    /// were sharp, and each of its micropolygons would cover the whole image.
    fn coarsening(&self, z: f32) -> f32 {
        if self.camera.dofquality < 2 {
            return 1.0;
        }
        let blur = self.camera.confusion(z).abs();
        1.0 + 0.25 * blur.x.max(blur.y)
    }

    /// Length of a step in pixels.
    fn length(&self, a: Vec3, b: Vec3, rasterorient: bool) -> f32 {
        let perspective = matches!(self.camera.projection, Projection::Perspective { .. });
        let near = self.camera.near;
        if rasterorient && !self.by_distance {
            // What lies before the near plane is measured as if on it.
            let project = |p: Vec3| self.camera.project(Vec3::new(p.x, p.y, p.z.max(near))).truncate();
            let z_far_enough = !perspective || a.z.max(b.z) > near;
            if z_far_enough {
                return project(a).distance(project(b)) / self.coarsening(((a.z + b.z) * 0.5).max(near));
            }
        }
        let distance = if perspective { ((a + b) * 0.5).length().max(near) } else { 1.0 };
        (b - a).length() * self.pixels / distance
    }
}
