//! Bounds of primitives and their pieces as seen by the eyes of a frame.

use super::job::{Job, Sighting};
use super::{Eye, Frame, FrameShader};
use crate::PixelRect;
use granita_base::{Bound, Transform, Vec3};
use granita_dicing::{Placement, Projection, Viewer, key_at, longest_axis};
use granita_geom::{Piece, Surface};
use granita_hider::{NOWHERE, pixels_of};

/// The bound of a piece as seen by an eye, in raster space.
struct Seen {
    bound_px: [f32; 4],
    z_min: f32,
    is_nearest: bool,
    blurs: bool,
}

impl Seen {
    const NOTHING: Self = Self { bound_px: NOWHERE, z_min: f32::INFINITY, is_nearest: true, blurs: false };

    fn sighting(self, region: &PixelRect) -> Sighting {
        let Self { bound_px, z_min, is_nearest, blurs } = self;
        Sighting { rect: pixels_of(bound_px, region), z_min, is_nearest, blurs }
    }
}

/// The rounding of positions on their way to camera space, relative to the largest coordinate.
const ROUNDING: f32 = 16.0 * f32::EPSILON;

/// The room in pixels around a bound, for rounding and for widened boundary edges.
const ROOM_PX: f32 = 0.3;

/// Motion and defocus below this number of pixels are ignored. It is less than the widening of boundary edges, so that
/// no crack opens beside a surface that blurs slightly more.
const LEAST_BLUR_PX: f32 = 0.01;

impl<S: FrameShader> Frame<'_, S> {
    /// Returns for each eye where all pieces of a primitive together may be visible in the frame's region.
    pub(super) fn sightings_of_all(&self, job: &Job<S::Object>, pieces: &[Piece]) -> Box<[Sighting]> {
        let sighting = |eye: &Eye<'_>| {
            let mut all = Seen::NOTHING;
            for piece in pieces {
                let seen = self.seen(eye, &**piece, job, &self.region);
                all.bound_px = union(all.bound_px, seen.bound_px);
                all.z_min = all.z_min.min(seen.z_min);
                all.is_nearest &= seen.is_nearest;
                all.blurs |= seen.blurs;
            }
            all.sighting(&self.region)
        };
        self.eyes.iter().map(sighting).collect()
    }

    /// Returns for each eye where a piece may be visible in the pixels of `region`.
    pub(super) fn sightings(
        &self,
        job: &Job<S::Object>,
        piece: &dyn Surface,
        region: &PixelRect,
    ) -> Box<[Sighting]> {
        let sighting = |eye: &Eye<'_>| self.seen(eye, piece, job, region).sighting(region);
        self.eyes.iter().map(sighting).collect()
    }

    /// Bounds a piece as seen by an eye over the whole shutter and lens, including displacement. The bound may leave
    /// out parts beyond the pixels of `region`.
    fn seen(&self, eye: &Eye<'_>, piece: &dyn Surface, job: &Job<S::Object>, region: &PixelRect) -> Seen {
        let placement = &job.placement;
        let world_to_camera = &eye.camera.world_to_camera;
        let displacement =
            |to_camera: &Transform| job.traits.max_displacement_world * longest_axis(|a| to_camera.vector(a));
        let mut boxes: Vec<Bound> = Vec::with_capacity(placement.times().len());
        for &time in placement.times() {
            let to_camera = world_to_camera.at(time);
            let bound = Placement::object_bound(piece, time)
                .transformed(&placement.to_world.at(time).then(&to_camera));
            boxes.push(bound.padded(displacement(&to_camera)));
        }
        let mut hull = boxes.iter().copied().fold(Bound::EMPTY, Bound::union);
        let is_loose = self.is_loose(eye, piece, placement, &hull);
        if is_loose {
            match self.precise_boxes(eye, piece, job, region) {
                Some(precise) => boxes = precise,
                None => return Seen::NOTHING,
            }
            hull = boxes.iter().copied().fold(Bound::EMPTY, Bound::union);
        }
        if !hull.is_finite() || hull.is_empty() {
            return Seen::NOTHING;
        }
        // A piece that crosses the near plane is bounded over all times at once, because its parts cross the plane
        // between the times.
        let bound_px = if hull.min.z < eye.camera.near {
            eye.projector.raster_box(&hull)
        } else {
            boxes.iter().map(|b| eye.projector.raster_box(b)).fold(NOWHERE, union)
        };
        // The bound of a surface that faces the camera is as wide as the surface, even for a small piece of it. When
        // the surface is larger than the image, its turned points are bounded instead, so that the bound shrinks with
        // the pieces.
        let [width, height] = [region.width() as f32, region.height() as f32];
        let wide = piece
            .raster_width()
            .max(bound_px[2] - bound_px[0] - width)
            .max(bound_px[3] - bound_px[1] - height);
        if piece.is_facing() && !piece.must_split() && wide > width + height {
            let turned = |&time: &f32| {
                let to_camera = world_to_camera.at(time);
                let to_eye = placement.to_world.at(time).then(&to_camera);
                self.turned_bound(piece, placement, time)
                    .transformed(&to_eye)
                    .padded(displacement(&to_camera))
            };
            let turned = placement.times().iter().map(turned).fold(Bound::EMPTY, Bound::union);
            if turned.is_finite() && !turned.is_empty() {
                let bound_px = grown(eye.projector.raster_box(&turned), ROOM_PX);
                let seen = self.seen_in(eye, piece, job, &turned, bound_px);
                return Seen { is_nearest: false, ..seen };
            }
        }
        let room = ROOM_PX + piece.raster_width() * 0.5;
        let seen = self.seen_in(eye, piece, job, &hull, grown(bound_px, room));
        Seen { is_nearest: seen.is_nearest && !is_loose, ..seen }
    }

    /// Returns the bound of a piece inside of `hull` (camera space, over the whole shutter) with this raster box.
    fn seen_in(
        &self,
        eye: &Eye<'_>,
        piece: &dyn Surface,
        job: &Job<S::Object>,
        hull: &Bound,
        bound_px: [f32; 4],
    ) -> Seen {
        let room = 1e-5 * hull.min.z.abs() + 1e-6 + eye.camera.rounding();
        let largest = hull.min.abs().max(hull.max.abs()).max_element();
        Seen {
            bound_px,
            z_min: hull.min.z - room,
            is_nearest: ROUNDING * largest <= room,
            blurs: self.blurs(eye, piece, job, hull),
        }
    }

    /// True when a piece inside of `hull` (camera space, over the whole shutter) may be blurred.
    fn blurs(&self, eye: &Eye<'_>, piece: &dyn Surface, job: &Job<S::Object>, hull: &Bound) -> bool {
        let (camera, placement) = (eye.camera, &job.placement);
        if job.existence.is_some() || !job.later.is_empty() {
            return true;
        }
        let moves = placement.times().len() > 1;
        if !moves && !self.pattern.defocus {
            return false;
        }
        if !camera.autopassreduction {
            return true;
        }
        let perspective = matches!(camera.projection, Projection::Perspective { .. });
        if perspective && hull.min.z < camera.near {
            return true;
        }
        let mut blur_px = 0.0;
        if self.pattern.defocus {
            let confusion = |z: f32| camera.confusion(z).abs().max_element();
            blur_px = confusion(hull.min.z).max(confusion(hull.max.z));
        }
        if moves {
            // The box does not bound the motion of points that deform or are displaced, nor does a rounded box.
            if piece.key_times().len() > 1
                || job.traits.displaces
                || self.is_coarse(camera, piece, placement, hull.min.z)
            {
                return true;
            }
            let corners = Placement::object_bound(piece, placement.times()[0]).corners();
            let at = |time: f32| {
                let to_camera = placement.to_world.at(time).then(&camera.world_to_camera.at(time));
                corners.map(|p| to_camera.point(p))
            };
            let start = at(placement.times()[0]);
            // The distance that a point moves is linear in its position, so the corners move farthest.
            let mut path = Vec3::ZERO;
            for time in &placement.times()[1..] {
                for (p, q) in start.iter().zip(at(*time)) {
                    path = path.max((q - p).abs());
                }
            }
            let mut aside = path.truncate();
            if perspective {
                let widest = hull.min.abs().max(hull.max.abs()).truncate();
                aside += widest * (path.z / hull.min.z);
            }
            blur_px += (aside * camera.raster_scale(hull.min.z).abs()).max_element();
        }
        // An unknown blur counts as blur.
        blur_px >= LEAST_BLUR_PX || blur_px.is_nan()
    }

    /// Returns the object space bound at a time of a piece of a point or curve, turned towards the dicing camera.
    fn turned_bound(&self, piece: &dyn Surface, placement: &Placement, time: f32) -> Bound {
        const SIDE: usize = 9;
        let times = piece.key_times();
        let viewer = Viewer::new(self.options.dicing_camera, placement, times);
        let (key, next, alpha) = key_at(times, time);
        let mut points = Vec::new();
        let mut at = |key: usize| {
            piece.positions_towards(key, SIDE, SIDE, &|key, p| viewer.view(key, p), &mut points);
            let bound = Bound::around(points.iter().copied());
            // The outline deviates far less between these points.
            bound.padded((bound.max - bound.min).length() * 0.1)
        };
        let a = at(key);
        if alpha == 0.0 {
            return a;
        }
        let b = at(next);
        Bound { min: a.min.lerp(b.min, alpha), max: a.max.lerp(b.max, alpha) }
    }
}

/// Returns a raster box, grown by a margin on every side.
fn grown([x0, y0, x1, y1]: [f32; 4], margin: f32) -> [f32; 4] {
    [x0 - margin, y0 - margin, x1 + margin, y1 + margin]
}

/// Returns the box around two raster boxes.
fn union(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
}
