//! Pieces and grids with coordinates so large relative to their distance from the eye that single precision is
//! visible.
//!
//! Their positions are transformed from object to camera space in double precision. Shaders receive them rounded
//! once.

use super::job::Job;
use super::{Eye, Frame, FrameShader, Sighting};
use crate::{CameraView, PixelRect};
use granita_base::{Bound, DMat4, DVec3, Vec3};
use granita_dicing::longest_axis;
use granita_dicing::{
    GridView, Placement, Rates, Viewpoint, key_at, largest_coordinates, pixels_at, precise_point, shows,
};
use granita_geom::Surface;
use granita_scene::attr;
use granita_shade::Grid;

/// The positions of a grid.
pub(super) struct Precise {
    /// The times of the motion keys.
    key_times: Vec<f32>,
    /// The positions in object space, for each motion key.
    p_object: Vec<Vec<DVec3>>,
}

impl<S: FrameShader> Frame<'_, S> {
    /// True when a box (camera space) may be too loose for the piece in it. Such a box crosses the near plane, where it
    /// is visible everywhere, or its rounding is visible. Only geometry that is large relative to its distance from the
    /// eye is affected.
    pub(super) fn is_loose(
        &self,
        eye: &Eye<'_>,
        piece: &dyn Surface,
        placement: &Placement,
        hull: &Bound,
    ) -> bool {
        // Geometry that turns towards the camera has widths besides its vertices.
        !piece.is_facing()
            && placement.reach().is_some()
            && (!hull.is_finite()
                || hull.min.z < eye.camera.near
                || self.is_coarse(eye.camera, piece, placement, hull.min.z))
    }

    /// True when the rounding to single precision of positions no nearer than `z_min` is visible.
    pub(super) fn is_coarse(
        &self,
        camera: &CameraView,
        piece: &dyn Surface,
        placement: &Placement,
        z_min: f32,
    ) -> bool {
        let Some(reach) = placement.reach() else { return false };
        let largest = largest_coordinates(std::iter::once(piece));
        shows(reach.rounding(largest) * pixels_at(camera, z_min))
    }

    /// Returns the boxes (camera space) around a piece at the times of its placement, including displacement. They are
    /// computed in double precision from the vertices of its hull. Returns `None` where the hull lies beyond one side
    /// of the view of `region`.
    pub(super) fn precise_boxes(
        &self,
        eye: &Eye<'_>,
        piece: &dyn Surface,
        job: &Job<S::Object>,
        region: &PixelRect,
    ) -> Option<Vec<Bound>> {
        let (placement, traits) = (&job.placement, &job.traits);
        let (mut boxes, mut all) = (Vec::with_capacity(placement.times().len()), Vec::new());
        let (mut hull, mut next_hull) = (Vec::new(), Vec::new());
        let mut pad = 0.0_f32;
        for &time in placement.times() {
            let (key, next, alpha) = key_at(piece.key_times(), time);
            piece.hull(key, &mut hull);
            if alpha != 0.0 {
                piece.hull(next, &mut next_hull);
                hull.iter_mut().zip(&next_hull).for_each(|(p, q)| *p = p.lerp(*q, f64::from(alpha)));
            }
            let to_camera = eye.camera.world_to_camera.at(time);
            let radius = traits.max_displacement_world * longest_axis(|v| to_camera.vector(v));
            pad = pad.max(radius);
            let to_eye = placement.precise_to(eye.camera, time);
            let first = all.len();
            all.extend(hull.iter().map(|p| precise_point(&to_eye, *p)));
            let (low, high) = all[first..]
                .iter()
                .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)));
            let (low, high) = (low.as_vec3(), high.as_vec3());
            // The margin covers the rounding of both ends.
            let room = low.abs().max(high.abs()) * f32::EPSILON;
            boxes.push(Bound { min: low - room - radius, max: high + room + radius });
        }
        let room_px = 1.0 + f64::from(piece.raster_width());
        let beyond = eye.projector.is_beyond(all.iter().copied(), f64::from(pad), region, room_px);
        (!beyond).then_some(boxes)
    }

    /// Returns the positions of a piece in double precision where an eye sees the difference.
    pub(super) fn precise(
        &self,
        job: &Job<S::Object>,
        seen: &[Sighting],
        piece: &dyn Surface,
        rates: &Rates,
    ) -> Option<Precise> {
        let shows = |(eye, seen): (&Eye<'_>, &Sighting)| {
            self.is_coarse(eye.camera, piece, &job.placement, seen.z_min)
        };
        if !self.eyes.iter().zip(seen).any(shows) {
            return None;
        }
        let key_times = piece.key_times().to_vec();
        let of_key = |key| piece.precise_between(key, [rates.nu, rates.nv], &rates.sides);
        let p_object = (0..key_times.len()).map(of_key).collect::<Option<Vec<_>>>()?;
        Some(Precise { key_times, p_object })
    }
}

impl Precise {
    /// Returns transformed positions at a time, displaced by `offsets` in object space. Empty `offsets` displace
    /// nothing.
    fn points<'p>(&'p self, to: DMat4, time: f32, offsets: &'p [Vec3]) -> impl Iterator<Item = DVec3> + 'p {
        let (key, next, alpha) = key_at(&self.key_times, time);
        let (first, second) = (&self.p_object[key], &self.p_object[next]);
        first.iter().zip(second).enumerate().map(move |(i, (p, q))| {
            let p = if alpha == 0.0 { *p } else { p.lerp(*q, f64::from(alpha)) };
            precise_point(&to, p + offsets.get(i).map_or(DVec3::ZERO, |d| d.as_dvec3()))
        })
    }

    /// Returns camera space positions at a time, displaced by `offsets` in object space. Empty `offsets` displace
    /// nothing.
    pub(super) fn p_cam(
        &self,
        placement: &Placement,
        camera: &CameraView,
        time: f32,
        offsets: &[Vec3],
    ) -> Vec<Vec3> {
        self.points(placement.precise_to(camera, time), time, offsets).map(|p| p.as_vec3()).collect()
    }

    /// Sets the points of a grid, each rounded once.
    pub(super) fn place<O>(&self, grid: &mut Grid, job: &Job<O>, view: &GridView, camera: &CameraView) {
        let placement = &job.placement;
        // Baking views along the normal.
        let bakes = matches!(&*job.primitive.attributes.get(attr::SHADING_VIEW), "outside" | "inside");
        let looks_from_eye = !bakes && matches!(view.viewpoint, Viewpoint::From(_));
        let at = |time: f32| -> Vec<DVec3> {
            self.points(placement.to_world.precise_at(time), time, &[]).collect()
        };
        let p = at(view.time);
        if p.len() != grid.len() {
            return;
        }
        let eye = camera.world_to_camera.precise_at(view.time).inverse().w_axis.truncate();
        for (i, p) in p.iter().enumerate() {
            grid.p.set(i, p.as_vec3());
            if looks_from_eye {
                grid.i.set(i, (*p - eye).as_vec3());
            }
        }
        if let [first, .., last] = placement.times() {
            let rate = 1.0 / f64::from(last - first);
            for (i, (a, b)) in at(*first).into_iter().zip(at(*last)).enumerate() {
                grid.dpdtime.set(i, ((b - a) * rate).as_vec3());
            }
        }
    }
}
