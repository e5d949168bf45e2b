// tidy: long: one measure finds the rates of a piece, and each of its rules bounds the others
//! Computes how finely a piece is diced, and whether it must be split first.

use super::motion::{Placement, pixels_at, precise_point, shows};
use crate::camera::{CameraView, MAX_QUALITY, Projection};
use granita_base::{DVec3, Vec3};
use granita_geom::{Dice, DiceData, Piece, SidePart, SidePoints, SplitDirection, Surface};
use granita_scene::{AttributeSet, Scene, attr};
use std::sync::Arc;

/// The number of points, along each parameter, of the lattice on which a piece is measured.
const LATTICE: usize = 5;

/// The deepest nesting of splits: groups of parts, then 50 halvings in both directions.
const MAX_DEPTH: u32 = 160;

/// The largest number of points along one direction of a grid, whatever the grid size.
const MAX_POINTS: usize = 1 << 12;

/// A measured length is exact enough when the rounding is less than this fraction of it.
const ROUNDING_PART: f32 = 1e-4;

/// The coarseness up to which motion blur hides the loss of detail, per pixel of motion along a line.
const DETAIL_PER_MOTION: f32 = 0.25;

/// The largest distance between a curved edge and its segments, in pixels at shading quality 1. The boundary edges of
/// grids cover it.
const SAG_PX: f32 = 0.02;

/// With a limit on the deviation from the surface, segments that are shorter than this many times the limit are not
/// divided for their turning angle alone.
const SHORT_FOR_RAYS: f32 = 10.0;

/// A line is straight when the cosine of its turning angle is at least this.
const STRAIGHT: f32 = 1.0 - 4.0 * f32::EPSILON;

/// The dicing attributes of the whole scene (reference 4.3.4).
#[derive(Clone, Debug, PartialEq)]
pub struct SceneDicing {
    /// The attribute "limits:gridsize".
    gridsize: i32,
    /// The attribute "limits:primitivepoints"; 0 for no limit.
    most_points: i32,
    /// The attribute "trimcurve:quality".
    pub trim_quality: f32,
    /// The attributes "dice:fixeduname" and "dice:fixedvname".
    fixed_names: [Arc<str>; 2],
    /// The factor by which surfaces have more points along each side than their attributes say.
    pub finer: f32,
}

impl SceneDicing {
    /// Returns the attributes of a scene.
    pub fn new(scene: &Scene) -> Self {
        Self {
            gridsize: scene.get(attr::LIMITS_GRIDSIZE),
            most_points: scene.get(attr::LIMITS_PRIMITIVEPOINTS),
            trim_quality: scene.get(attr::TRIMCURVE_QUALITY),
            fixed_names: [attr::DICE_FIXEDUNAME, attr::DICE_FIXEDVNAME].map(|key| scene.get(key)),
            finer: 1.0,
        }
    }
}

impl SceneDicing {
    /// Returns the largest number of points into which a primitive may be diced. The attribute is for surfaces that are
    /// as fine as the scene says.
    pub fn most_points(&self) -> u64 {
        let most = f64::from(self.most_points) * f64::from(self.finer.max(1.0)).powi(2);
        if self.most_points > 0 { most as u64 } else { u64::MAX }
    }
}

/// The attribute "dice:fixed": numbers of segments per unit of two parameters of the surface.
#[derive(Clone, Debug, PartialEq)]
pub struct FixedDicing {
    /// The numbers of segments per unit.
    rate: [f32; 2],
    /// The primitive variables that replace u and v. The names "u" and "v", and variables that a primitive lacks,
    /// stand for the surface parameters.
    names: [Arc<str>; 2],
}

/// The dicing attributes of one object (reference 4.4.4, 4.4.5).
#[derive(Clone, Debug, PartialEq)]
pub struct DiceSettings {
    /// The number of shading samples per raster unit, above 0.
    pub quality: f32,
    /// The largest number of points of a grid, at least 4.
    pub gridsize: usize,
    /// The turning angle in radians that adds a segment, unless micropolygons are very small.
    pub curvature: f32,
    /// The turning angle in radians that always adds a segment.
    pub highcurvature: f32,
    /// True when the numbers of segments are rounded up to powers of two.
    pub binary: bool,
    /// True when a piece is measured as seen from the camera, false when it is measured as if turned towards it.
    pub rasterorient: bool,
    /// The factor by which moving objects are diced more coarsely along their motion; 0 for no effect.
    pub motionfactor: f32,
    /// True when a piece is split wherever its spline has a crease.
    pub keepcreases: bool,
    /// Curves thinner than this, in pixels, have one segment across.
    pub thincurve_px: f32,
    /// The fixed rates; `None` for adaptive dicing.
    pub fixed: Option<FixedDicing>,
}

impl DiceSettings {
    /// Returns the attributes of an object. `camera` provides the preview mode.
    pub fn new(attributes: &AttributeSet, scene: &SceneDicing, camera: &CameraView) -> Self {
        let preview = camera.preview > 0.0;
        let positive = |v: f32, default: f32| if v.is_finite() && v > 0.0 { v } else { default };
        let quality = if preview { camera.preview } else { attributes.get(attr::SHADINGQUALITY) };
        let curvature_deg =
            if preview { camera.preview_dicecurvature_deg } else { attributes.get(attr::DICE_CURVATURE) };
        let fixed = attributes.get(attr::DICE_FIXED);
        let gridsize = scene.gridsize;
        let not_negative = |v: f32| if v.is_finite() { v.max(0.0) } else { 0.0 };
        Self {
            quality: (positive(quality, 1.0) * scene.finer).clamp(1e-4, MAX_QUALITY),
            gridsize: if gridsize > 0 { (gridsize as usize).clamp(4, 1 << 16) } else { 256 },
            curvature: positive(curvature_deg, 10.0).to_radians(),
            highcurvature: positive(attributes.get(attr::DICE_HIGHCURVATURE), 120.0).to_radians(),
            binary: attributes.get(attr::DICE_BINARY),
            rasterorient: attributes.get(attr::DICE_RASTERORIENT),
            motionfactor: not_negative(attributes.get(attr::DICE_MOTIONFACTOR)),
            keepcreases: attributes.get(attr::DICE_KEEPCREASES),
            thincurve_px: not_negative(attributes.get(attr::DICE_THINCURVE)),
            fixed: match fixed[..] {
                [u, v] if u > 0.0 && v > 0.0 && u.is_finite() && v.is_finite() => Some(FixedDicing {
                    rate: [u, v].map(|rate| rate * scene.finer),
                    names: scene.fixed_names.clone(),
                }),
                _ => None,
            },
        }
    }
}

impl DiceSettings {
    /// Rounds a requested number of segments.
    fn round(&self, asked: f32) -> usize {
        let n = (asked.min(MAX_POINTS as f32).ceil() as usize).max(1);
        if self.binary { n.next_power_of_two() } else { n }
    }

    /// Returns the largest number of segments of a part of a side that is not halved. It is the number along a square
    /// grid, so that sides are mostly halved where their pieces are split.
    fn longest_part(&self) -> f32 {
        ((self.gridsize as f32).sqrt() - 1.0).max(1.0)
    }
}

/// The next step for a piece.
#[derive(Clone, Debug, PartialEq)]
pub enum Plan {
    /// Dice the piece.
    Dice(Rates),
    /// Split the piece along this direction. The number of steps of each side that is short enough is settled.
    Split(SplitDirection, [Option<u32>; 4]),
}

/// The lattice into which a piece is diced.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rates {
    /// The number of points along u, at least 2.
    pub nu: usize,
    /// The number of points along v, at least 2.
    pub nv: usize,
    /// The positions of the points on the sides.
    pub sides: [SidePoints; 4],
}

/// The requested numbers of segments along the lines of a piece, as real numbers.
struct Asked {
    u: f32,
    v: f32,
    /// The numbers for the sides, in the order of [`Surface::side`]; 0 for a side that is a single point. `None` when
    /// the rates are fixed.
    sides: Option<[f32; 4]>,
}

/// The camera space positions of some points of a piece.
struct Points {
    p_cam: Vec<Vec3>,
    /// True when rounding to single precision is visible for at least some of the points. A part of them must then be
    /// measured again.
    rounds: bool,
}

/// Measures pieces as seen by the dicing camera.
#[derive(Clone, Copy, Debug)]
pub struct Measure<'a> {
    camera: &'a CameraView,
    /// The number of pixels per camera space unit at distance 1.
    pixels: f32,
    /// The largest ratio of the raster length to the length as seen from the eye, inside of the view.
    stretch: f32,
    /// True when pieces are measured by their distance from the camera only, for ray tracing.
    by_distance: bool,
    /// The largest deviation from the surface in pixels. When set, it replaces the limit on the size of
    /// micropolygons.
    flatness_px: Option<f32>,
}

impl<'a> Measure<'a> {
    /// Returns the measure for the raster of `camera`.
    pub fn on_raster(camera: &'a CameraView) -> Self {
        let s = camera.raster_scale(1.0);
        let stretch = match camera.widest_tangent() {
            // The bound is slightly larger than the image, because filters and lenses reach beyond its sides.
            Some(tangent) => 1.01 * (1.0 + (1.25 * tangent).powi(2)),
            None => f32::INFINITY,
        };
        Self { camera, pixels: s.x.abs().max(s.y.abs()), stretch, by_distance: false, flatness_px: None }
    }

    /// Returns the measure for pieces as if each were turned towards `camera`, also behind and beside it.
    pub fn by_distance(camera: &'a CameraView) -> Self {
        Self { by_distance: true, ..Self::on_raster(camera) }
    }

    /// Returns a measure like [`Measure::by_distance`], for micropolygons of any size that deviate at most
    /// `flatness_px` pixels from the surface. Facets of flat meshes are not divided.
    pub fn by_flatness(camera: &'a CameraView, flatness_px: f32) -> Self {
        Self { flatness_px: Some(flatness_px), ..Self::by_distance(camera) }
    }

    /// Returns the requested numbers of segments along u and v. They are undefined for a piece that must be split.
    pub fn asked(&self, piece: &dyn Surface, placement: &Placement, settings: &DiceSettings) -> [f32; 2] {
        let asked = self.segments(piece, placement, settings);
        [asked.u, asked.v]
    }

    /// Splits a piece along a direction and settles its sides where possible. Dicing the parts gives the same points
    /// on the sides as dicing the whole.
    pub fn split(
        &self,
        piece: &dyn Surface,
        placement: &Placement,
        settings: &DiceSettings,
        direction: SplitDirection,
    ) -> Vec<Piece> {
        let asked = self.segments(piece, placement, settings);
        let (_, settled) = self.settle(piece, &asked, settings);
        piece.split_settled(direction, settled)
    }

    /// Returns the sides of a piece that are not settled yet, and the number of steps of those that are short enough
    /// to be settled.
    ///
    /// The points on a side are a function of the side alone, so that neighbours agree. A side is halved until its
    /// parts are short, and each part has equal steps. A side that is a single point needs no settling.
    fn settle(
        &self,
        piece: &dyn Surface,
        asked: &Asked,
        settings: &DiceSettings,
    ) -> ([Option<SidePart>; 4], [Option<u32>; 4]) {
        let parts: [Option<SidePart>; 4] = std::array::from_fn(|side| {
            let length = asked.sides?[side];
            if length > 0.0 { piece.side(side) } else { None }
        });
        let settled = std::array::from_fn(|side| {
            let (part, asked) = (parts[side]?, asked.sides?[side]);
            (!part.must_part() && asked <= settings.longest_part()).then(|| settings.round(asked) as u32)
        });
        (parts, settled)
    }

    /// Returns the next step for a piece that has been split `depth` times.
    pub fn plan(
        &self,
        piece: &dyn Surface,
        placement: &Placement,
        settings: &DiceSettings,
        depth: u32,
    ) -> Plan {
        let may_split = piece.is_splittable() && depth < MAX_DEPTH;
        if may_split && piece.is_group() {
            return Plan::Split(SplitDirection::U, [None; 4]);
        }
        let asked = self.segments(piece, placement, settings);
        let longer = if asked.u >= asked.v { SplitDirection::U } else { SplitDirection::V };
        let round = |m: f32| settings.round(m);
        let (parts, settled) = self.settle(piece, &asked, settings);
        if may_split && piece.must_split() {
            return Plan::Split(longer, settled);
        }
        if may_split && settings.keepcreases && piece.has_crease() {
            return Plan::Split(SplitDirection::V, settled);
        }
        let (mut u, mut v) = (round(asked.u), round(asked.v));
        let too_large = |u: usize, v: usize| (u + 1) * (v + 1) > settings.gridsize.max(4);
        if may_split && too_large(u, v) {
            return Plan::Split(longer, settled);
        }
        let mut sides: [SidePoints; 4] = Default::default();
        for (side, points) in sides.iter_mut().enumerate() {
            let steps = match (piece.settled_steps(side), settled[side], parts[side]) {
                (Some(steps), ..) => steps,
                (None, Some(steps), _) => {
                    *points = SidePoints::Steps(steps);
                    steps as usize
                }
                (None, None, Some(part)) => {
                    let mut list = Vec::new();
                    self.halve(piece, &part, placement, settings, &mut list);
                    let steps = list.iter().map(|(_, steps)| *steps as usize).sum();
                    *points = SidePoints::Parts(list.into());
                    steps
                }
                _ => 1,
            };
            let along = if side < 2 { &mut u } else { &mut v };
            *along = steps.max(*along);
        }
        if too_large(u, v) {
            if may_split {
                let longer = if u >= v { SplitDirection::U } else { SplitDirection::V };
                return Plan::Split(longer, settled);
            }
            // A piece that cannot be split is diced as finely as the limit allows.
            while too_large(u, v) && (u > 1 || v > 1) {
                if u >= v { u = u.div_ceil(2) } else { v = v.div_ceil(2) }
            }
        }
        Plan::Dice(Rates { nu: u + 1, nv: v + 1, sides })
    }

    /// Appends the parts of a side part that is too long, with their steps.
    fn halve(
        &self,
        piece: &dyn Surface,
        part: &SidePart,
        placement: &Placement,
        settings: &DiceSettings,
        out: &mut Vec<(SidePart, u32)>,
    ) {
        for half in part.halves().into_iter().flatten() {
            let asked = self.along_side(piece, &half, placement, settings);
            let long = half.must_part() || asked > settings.longest_part();
            // A side with more parts than a grid has points is not divided further, because its piece will be split.
            if long && out.len() < settings.gridsize && half.halves().is_some() {
                self.halve(piece, &half, placement, settings, out);
            } else {
                out.push((half, settings.round(asked) as u32));
            }
        }
    }

    /// Returns the numbers of segments along u and v that the settings request, as real numbers.
    fn segments(&self, piece: &dyn Surface, placement: &Placement, settings: &DiceSettings) -> Asked {
        if let Some(fixed) = &settings.fixed {
            let [u, v] = fixed.segments(piece);
            return Asked { u, v, sides: None };
        }
        if self.flatness_px.is_some() && piece.facets() == 1 {
            return Asked { u: 1.0, v: 1.0, sides: None };
        }
        let straight = self.straight(piece, placement, settings);
        if let Some(sides) = straight
            && let [Some(u0), Some(u1), Some(v0), Some(v1)] = sides
        {
            // A line between two straight sides is not longer than the longer side.
            return Asked { u: u0.max(u1).max(1.0), v: v0.max(v1).max(1.0), sides: Some([u0, u1, v0, v1]) };
        }
        let [Some(Points { p_cam: lattice, rounds }), moved] =
            self.at_ends((piece, placement), settings, |time| self.lattice(piece, placement, time))
        else {
            return Asked { u: 1.0, v: 1.0, sides: None };
        };
        let moved_rounds = moved.as_ref().is_some_and(|moved| moved.rounds);
        let moved = moved.map(|moved| moved.p_cam);
        let line = |start: usize, step: usize| {
            let along =
                |points: &[Vec3]| -> [Vec3; LATTICE] { std::array::from_fn(|k| points[start + k * step]) };
            self.line(&along(&lattice), moved.as_deref().map(along).as_ref(), settings)
        };
        let largest = |lines: [f32; LATTICE]| lines.into_iter().fold(1.0_f32, f32::max);
        let rows = |j: usize| j * LATTICE;
        let along: [[f32; LATTICE]; 2] =
            [std::array::from_fn(|j| line(rows(j), 1)), std::array::from_fn(|i| line(i, LATTICE))];
        let [mut u, mut v] = along.map(largest);
        if let Some(flatness_px) = self.flatness_px {
            // A twisted quadrilateral deviates by a quarter of its twist from two triangles.
            let last = LATTICE - 1;
            let (a, b) = (lattice[0], lattice[last]);
            let (c, d) = (lattice[rows(last)], lattice[rows(last) + last]);
            let middle = (a + b + c + d) * 0.25;
            let twist_px = self.length(middle, middle + (a - b - c + d), false);
            let by_twist = (twist_px / (4.0 * flatness_px)).sqrt();
            if by_twist.is_finite() {
                (u, v) = (u.max(by_twist), v.max(by_twist));
            }
        }
        if settings.thincurve_px > 0.0 && piece.is_curve() {
            // The width is measured independently of the orientation, because a ribbon seen from its edge is not
            // thin.
            let width = |j: usize| {
                lattice[rows(j)..rows(j + 1)].windows(2).map(|w| self.length(w[0], w[1], false)).sum::<f32>()
            };
            // A piece of a curve that was split across has a fraction of the curve's width.
            let [u0, u1, ..] = piece.domain();
            let widest = largest_of((0..LATTICE).map(width)) / (u1 - u0).abs().max(1e-6);
            if widest < settings.thincurve_px {
                u = 1.0;
            }
        }
        let last = LATTICE - 1;
        let side = |axis: usize, end: usize| {
            let (start, step) = if axis == 0 { (rows(end), 1) } else { (end, LATTICE) };
            let is_point =
                |points: &Vec<Vec3>| (1..LATTICE).all(|k| points[start + k * step] == points[start]);
            if is_point(&lattice) && moved.iter().all(is_point) { 0.0 } else { along[axis][end].max(1.0) }
        };
        let mut sides = [side(0, 0), side(0, last), side(1, 0), side(1, last)];
        if rounds || moved_rounds {
            // Whether a side is rounded must depend on the side alone, not on the lattice.
            for (k, side) in sides.iter_mut().enumerate() {
                *side = self.whole_side(piece, k, placement, settings).unwrap_or(*side);
            }
        }
        // Neighbours that lie entirely in front of the camera measure the common side as a whole.
        for (side, straight) in sides.iter_mut().zip(straight.into_iter().flatten()) {
            *side = straight.unwrap_or(*side);
        }
        Asked { u, v, sides: Some(sides) }
    }

    /// Returns the requested numbers of segments of those sides of a facet that have both ends in front of the
    /// camera. The sides are straight, so that their raster length is the distance of their ends. Returns `None` for
    /// a piece that is not a facet, that moves, or that is measured in another way.
    fn straight(
        &self,
        piece: &dyn Surface,
        placement: &Placement,
        settings: &DiceSettings,
    ) -> Option<[Option<f32>; 4]> {
        let moves = settings.motionfactor > 0.0 && placement.times().len() > 1;
        let sharp = !self.camera.has_depth_of_field();
        let by_raster = settings.rasterorient && !self.by_distance;
        if moves || !sharp || !by_raster || self.flatness_px.is_some() || piece.facets() != 1 {
            return None;
        }
        let time = measuring_time(piece, placement);
        let ends = |list: &[usize]| {
            let at_key = |key: usize| {
                let corners = piece.facet(0, key);
                list.iter().map(|k| corners[*k]).collect::<Vec<Vec3>>()
            };
            let precisely = |key: usize| at_key(key).iter().map(|p| p.as_dvec3()).collect();
            self.seen_at(piece, placement, time, at_key, precisely)
        };
        let whole = ends(&[0, 1, 2, 3]);
        let perspective = matches!(self.camera.projection, Projection::Perspective { .. });
        let side = |p: Vec3, q: Vec3| {
            if p == q {
                return Some(0.0);
            }
            if perspective && p.z.min(q.z) <= self.camera.near {
                return None;
            }
            let length_px = self.raster_distance(p, q).min(self.longest(p, q));
            length_px.is_finite().then(|| nearest(length_px * settings.quality, 0.0).max(1.0))
        };
        if whole.rounds {
            // Each side is measured by itself, so that the neighbour gets the same result whatever the size of the
            // facet.
            return Some([[0, 1], [2, 3], [0, 2], [1, 3]].map(|list| match ends(&list).p_cam[..] {
                [p, q] => side(p, q),
                _ => None,
            }));
        }
        let &[a, b, c, d] = &whole.p_cam[..] else { return None };
        Some([side(a, b), side(c, d), side(a, c), side(b, d)])
    }

    /// Returns the requested number of segments of a part of a side.
    fn along_side(
        &self,
        piece: &dyn Surface,
        part: &SidePart,
        placement: &Placement,
        settings: &DiceSettings,
    ) -> f32 {
        let at = |time: f32| {
            let at_key = |key: usize| {
                let mut points = Vec::with_capacity(LATTICE);
                piece.side_positions(key, part, LATTICE, &mut points);
                points
            };
            let precisely = |key: usize| {
                let mut points = Vec::with_capacity(LATTICE);
                piece.precise_side_positions(key, part, LATTICE, &mut points);
                points
            };
            let points = self.seen_at(piece, placement, time, at_key, precisely);
            <[Vec3; LATTICE]>::try_from(points.p_cam).ok()
        };
        match self.at_ends((piece, placement), settings, at) {
            [Some(points), moved] => self.line(&points, moved.as_ref(), settings).max(1.0),
            [None, _] => 1.0,
        }
    }

    /// Evaluates `at` at the time at which the piece is measured, and at the end of its motion when the motion has an
    /// effect on dicing.
    fn at_ends<T>(
        &self,
        (piece, placement): (&dyn Surface, &Placement),
        settings: &DiceSettings,
        at: impl Fn(f32) -> Option<T>,
    ) -> [Option<T>; 2] {
        let times = placement.times();
        let moves = settings.motionfactor > 0.0 && times.len() > 1;
        [at(measuring_time(piece, placement)), moves.then(|| at(times[times.len() - 1])).flatten()]
    }

    /// Returns the camera space positions of the measuring lattice at a time; `None` when the piece has none.
    fn lattice(&self, piece: &dyn Surface, placement: &Placement, time: f32) -> Option<Points> {
        let viewer = piece.is_facing().then(|| super::Viewer::new(self.camera, placement, piece.key_times()));
        let at_key = |key: usize| {
            let mut lattice = Vec::with_capacity(LATTICE * LATTICE);
            match &viewer {
                Some(viewer) => {
                    let view = |k: usize, p: Vec3| viewer.view(k, p);
                    piece.positions_towards(key, LATTICE, LATTICE, &view, &mut lattice);
                }
                None => piece.positions(key, LATTICE, LATTICE, &mut lattice),
            }
            lattice
        };
        let precisely = |key: usize| {
            if piece.is_facing() {
                return at_key(key).iter().map(|p| p.as_dvec3()).collect();
            }
            let mut lattice = Vec::with_capacity(LATTICE * LATTICE);
            piece.precise_positions(key, LATTICE, LATTICE, &mut lattice);
            lattice
        };
        let lattice = self.seen_at(piece, placement, time, at_key, precisely);
        (lattice.p_cam.len() == LATTICE * LATTICE).then_some(lattice)
    }

    /// Returns the camera space positions at a time of points that are given at each motion key.
    fn seen_at(
        &self,
        piece: &dyn Surface,
        placement: &Placement,
        time: f32,
        at_key: impl Fn(usize) -> Vec<Vec3>,
        precisely: impl Fn(usize) -> Vec<DVec3>,
    ) -> Points {
        let (key, next, alpha) = super::motion::key_at(piece.key_times(), time);
        let mut points = at_key(key);
        if alpha != 0.0 {
            for (p, q) in points.iter_mut().zip(at_key(next)) {
                *p = p.lerp(q, alpha);
            }
        }
        let largest = placement.reach().map(|_| points.iter().map(|p| p.abs()).fold(Vec3::ZERO, Vec3::max));
        let to_camera = placement.to_world.at(time).then(&self.camera.world_to_camera.at(time));
        points.iter_mut().for_each(|p| *p = to_camera.point(*p));
        let (Some(reach), Some(largest)) = (placement.reach(), largest) else {
            return Points { p_cam: points, rounds: false };
        };
        let depth = |p: &Vec3| if self.by_distance { p.length() } else { p.z };
        let nearest = points.iter().map(depth).fold(f32::INFINITY, f32::min);
        let pixels = pixels_at(self.camera, nearest);
        let rounding_px = reach.rounding(largest) * pixels;
        let rounds = shows(rounding_px);
        if rounds {
            // The result is the same to the bit in either order of the points.
            let longest = points.windows(2).map(|w| (w[1] - w[0]).abs().max_element()).fold(0.0, f32::max);
            let right = rounding_px <= ROUNDING_PART * longest * pixels;
            if !right {
                let to_camera = placement.precise_to(self.camera, time);
                let mut precise = precisely(key);
                if alpha != 0.0 {
                    for (p, q) in precise.iter_mut().zip(precisely(next)) {
                        *p = p.lerp(q, f64::from(alpha));
                    }
                }
                points.clear();
                points.extend(precise.into_iter().map(|p| precise_point(&to_camera, p).as_vec3()));
            }
        }
        Points { p_cam: points, rounds }
    }

    /// Returns the requested number of segments of a side, measured by itself. 0 for a point, `None` for a settled
    /// side.
    fn whole_side(
        &self,
        piece: &dyn Surface,
        side: usize,
        placement: &Placement,
        settings: &DiceSettings,
    ) -> Option<f32> {
        let part = piece.side(side)?;
        let mut points = Vec::with_capacity(LATTICE);
        let is_point = (0..piece.key_times().len()).all(|key| {
            piece.precise_side_positions(key, &part, LATTICE, &mut points);
            points.windows(2).all(|w| w[0] == w[1])
        });
        Some(if is_point { 0.0 } else { self.along_side(piece, &part, placement, settings) })
    }

    /// Returns the requested number of segments of one line of the lattice. `moved` is the line when the shutter
    /// closes. The result is the same to the bit from either end.
    fn line(&self, p: &[Vec3; LATTICE], moved: Option<&[Vec3; LATTICE]>, settings: &DiceSettings) -> f32 {
        const STEPS: usize = LATTICE - 1;
        let (mut lengths_px, mut seen_px) = ([0.0; STEPS], [0.0; STEPS]);
        let mut turns = [0.0; STEPS];
        let mut before: Option<Vec3> = None;
        for (k, pair) in p.windows(2).enumerate() {
            let step = pair[1] - pair[0];
            lengths_px[k] = self.length(pair[0], pair[1], settings.rasterorient);
            seen_px[k] = match moved {
                Some(moved) => {
                    let along = self.motion_along([pair[0], pair[1]], [moved[k], moved[k + 1]]);
                    lengths_px[k] / (1.0 + DETAIL_PER_MOTION * settings.motionfactor * along)
                }
                None => lengths_px[k],
            };
            if let Some(direction) = step.try_normalize() {
                // The turning angle of a straight line is only rounding.
                if let Some(cos) = before.map(|last| last.dot(direction)).filter(|cos| *cos < STRAIGHT) {
                    turns[k] = libm::acosf(cos.max(-1.0));
                }
                before = Some(direction);
            }
        }
        let sum = |mut list: [f32; STEPS]| -> f32 {
            list.sort_by(f32::total_cmp);
            list.iter().sum()
        };
        let (length_px, seen_px, mut turn) = (sum(lengths_px), sum(seen_px), sum(turns));
        if !length_px.is_finite() || !seen_px.is_finite() || !turn.is_finite() {
            return 1.0;
        }
        // The lattice sees the turning at its inner points only. The arc of a circle turns slightly more.
        turn *= LATTICE as f32 / (LATTICE - 1) as f32;
        let by_curvature = turn / settings.curvature;
        if let Some(flatness_px) = self.flatness_px {
            // An arc of length l that turns by t deviates by l t / (8 n^2) from n equal chords.
            let by_sag = (length_px * turn / (8.0 * flatness_px)).sqrt();
            return by_sag.max(by_curvature.min(length_px / (SHORT_FOR_RAYS * flatness_px)));
        }
        let by_length = nearest(seen_px * settings.quality, turn);
        // On micropolygons smaller than a third of a pixel, curvature is not visible.
        let by_curvature = by_curvature.min(length_px * 3.0);
        // A line that is coarse because it moves must still keep its outline. An arc of length l that turns by t
        // deviates by l t / (8 n^2) from n equal chords.
        let by_sag = if seen_px < length_px {
            (length_px * turn * settings.quality / (8.0 * SAG_PX)).sqrt().min(length_px * settings.quality)
        } else {
            0.0
        };
        by_length.max(by_curvature).max(by_sag).max(turn / settings.highcurvature)
    }

    /// Returns the distance in pixels by which a step moves along itself while the shutter is open. Motion across the
    /// step hides no detail along it.
    fn motion_along(&self, step: [Vec3; 2], moved: [Vec3; 2]) -> f32 {
        let perspective = matches!(self.camera.projection, Projection::Perspective { .. });
        let near = self.camera.near;
        let (from, to) = ((step[0] + step[1]) * 0.5, (moved[0] + moved[1]) * 0.5);
        if perspective && step.iter().chain(&moved).any(|p| p.z < near) {
            // Points before the near plane have no raster position. Steps that pass the eye are measured by their
            // distance.
            let along = (step[1] - step[0]).try_normalize().map_or(0.0, |way| (to - from).dot(way).abs());
            let along_px = along * self.pixels / from.length().max(to.length()).max(near);
            return if along_px.is_finite() { along_px } else { 0.0 };
        }
        let project = |p: Vec3| self.camera.project(p).truncate();
        let [a, b] = step.map(project);
        let [c, d] = moved.map(project);
        let along = (b - a).try_normalize().map_or(0.0, |direction| {
            let travel = ((c + d) - (a + b)) * 0.5;
            travel.dot(direction).abs()
        });
        // Outside of the image raster coordinates, and the motion of points there, have no bound.
        let along = along.min(self.longest(from, to));
        if along.is_finite() { along } else { 0.0 }
    }

    /// Returns the factor by which a step at depth `z` may be diced more coarsely because it is out of focus. Detail
    /// below a quarter of the circle of confusion is not visible. Without this factor, surfaces close to the camera
    /// would be diced as finely as if they were sharp, and each of their micropolygons would cover the whole image.
    fn coarsening(&self, z: f32) -> f32 {
        if !self.camera.has_depth_of_field() {
            return 1.0;
        }
        let blur = self.camera.confusion(z).abs();
        1.0 + 0.25 * blur.x.max(blur.y)
    }

    /// Returns the distance in pixels of two points that are not before the near plane. The result is at most 1e30
    /// where squares of it overflow.
    fn raster_distance(&self, a: Vec3, b: Vec3) -> f32 {
        let [p, q] = [a, b].map(|p| self.camera.project(p).truncate());
        let distance_px = p.distance(q);
        if distance_px.is_finite() || !(a.is_finite() && b.is_finite()) {
            return distance_px;
        }
        let project = |p: Vec3| {
            let scale = self.camera.raster_scale(1.0).as_dvec2();
            let perspective = matches!(self.camera.projection, Projection::Perspective { .. });
            p.truncate().as_dvec2() * scale / if perspective { f64::from(p.z) } else { 1.0 }
        };
        project(a).distance(project(b)).min(1e30) as f32
    }

    /// Returns the largest number of pixels that a step covers inside of the view. A length l at a distance d under
    /// an angle t from the axis is at most l / (d cos^2 t) long in the image plane. Outside of the image and towards
    /// the plane of the eye the projection has no bound. Without this limit, displaced or moving surfaces there would
    /// be diced into billions of points. The result is the same to the bit from either end.
    fn longest(&self, a: Vec3, b: Vec3) -> f32 {
        if self.stretch.is_infinite() {
            return f32::INFINITY;
        }
        let length = (b - a).length();
        // No point of the step is nearer than this.
        let distance = ((a + b) * 0.5).length() - 0.5 * length;
        length * self.pixels * self.stretch / distance.max(self.camera.near)
    }

    /// Returns the length of a step in pixels.
    fn length(&self, a: Vec3, b: Vec3, rasterorient: bool) -> f32 {
        let perspective = matches!(self.camera.projection, Projection::Perspective { .. });
        let near = self.camera.near;
        if rasterorient && !self.by_distance {
            // Points before the near plane are measured as if they were on it.
            let clamped = |p: Vec3| Vec3::new(p.x, p.y, p.z.max(near));
            let z_far_enough = !perspective || a.z.max(b.z) > near;
            if z_far_enough {
                return self.raster_distance(clamped(a), clamped(b)).min(self.longest(a, b))
                    / self.coarsening(((a.z + b.z) * 0.5).max(near));
            }
        }
        let distance = if perspective { ((a + b) * 0.5).length().max(near) } else { 1.0 };
        (b - a).length() * self.pixels / distance
    }
}

/// Returns the time at which a piece is measured. It is the time at which the shutter opens, unless the shape is far
/// smaller then than at another time.
fn measuring_time(piece: &dyn Surface, placement: &Placement) -> f32 {
    let times = placement.times();
    let (first, last) = (times[0], times[times.len() - 1]);
    piece.measured_key().map_or(first, |key| piece.key_times()[key].clamp(first, last))
}

/// Adjusts a requested number of segments, which is rounded up later, so that straight lines get approximately the
/// nearest number. Points are then about a pixel apart instead of never farther apart. Otherwise faces of fine
/// meshes, about as large as a pixel, would be shaded at twice as many points. The adjustment decreases as the line
/// turns (radians), so that lines that are straight except for rounding get nearly the same number from both sides.
fn nearest(segments: f32, turn: f32) -> f32 {
    segments - 0.45 * (1.0 - 10.0 * turn).max(0.0)
}

/// Returns the largest of some numbers, at least 0.
fn largest_of(numbers: impl Iterator<Item = f32>) -> f32 {
    numbers.fold(0.0, f32::max)
}

impl FixedDicing {
    /// Returns the numbers of segments along u and v of a piece, as real numbers.
    ///
    /// Each direction gets the rates of the parameters that change along it. Where the parameters run as u and v do,
    /// one rate applies to u and the other to v. Where they are rotated, both rates apply to both directions.
    fn segments(&self, piece: &dyn Surface) -> [f32; 2] {
        if self.names.iter().zip(["u", "v"]).all(|(name, own)| **name == *own) {
            let [u0, u1, v0, v1] = piece.domain();
            return [(self.rate[0] * (u1 - u0)).abs().max(1.0), (self.rate[1] * (v1 - v0)).abs().max(1.0)];
        }
        let dice = piece.dice(LATTICE, LATTICE);
        let values = [self.values(&dice, 0), self.values(&dice, 1)];
        let line = |start: usize, step: usize| -> f32 {
            let steps = (1..LATTICE).map(|k| {
                let (a, b) = (start + (k - 1) * step, start + k * step);
                let along = |x: usize| self.rate[x] * (values[x][b] - values[x][a]);
                libm::hypotf(along(0), along(1))
            });
            let sum: f32 = steps.sum();
            // Whole numbers are preserved in spite of the rounding of the sum.
            if (sum - sum.round()).abs() < 1e-3 { sum.round() } else { sum }
        };
        let segments = [
            largest_of((0..LATTICE).map(|j| line(j * LATTICE, 1))),
            largest_of((0..LATTICE).map(|i| line(i, LATTICE))),
        ];
        segments.map(|n| if n.is_finite() { n.max(1.0) } else { 1.0 })
    }

    /// Returns the values of the parameter that replaces u (axis 0) or v (axis 1) at the points of a lattice.
    fn values(&self, dice: &Dice, axis: usize) -> Vec<f32> {
        let n = LATTICE * LATTICE;
        let variable = dice.primvars.iter().find(|v| *v.name == *self.names[axis] && v.ty.width() == 1);
        match variable.map(|v| &v.data) {
            Some(DiceData::Floats { values, varying: true }) if values.len() == n => values.clone(),
            _ => [&dice.u, &dice.v][axis].clone(),
        }
    }
}
