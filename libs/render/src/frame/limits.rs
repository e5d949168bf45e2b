//! Limits of the points of a primitive, and detection of primitives that cannot be placed.

use super::{Frame, FrameShader};
use crate::CameraView;
use granita_base::Severity;
use granita_dicing::Placement;
use granita_geom::Piece;
use granita_scene::Primitive;
use std::sync::atomic::{AtomicU64, Ordering};

/// The number of points that a split counts for, which is that of the smallest grid.
pub(super) const POINTS_OF_A_SPLIT: u64 = 4;

/// The budget of a primitive. Whether it is exceeded does not depend on the order of counting.
pub(super) struct Budget {
    /// The points of grids and the points that splits count for.
    points: AtomicU64,
    most: u64,
}

impl Budget {
    /// Returns a budget of which nothing is spent.
    pub(super) fn new(most: u64) -> Self {
        Self { points: AtomicU64::new(0), most }
    }

    /// Counts the points of a grid, or the points that a split counts for.
    pub(super) fn spend(&self, points: u64) {
        self.points.fetch_add(points, Ordering::Relaxed);
    }

    /// True when the budget is exceeded.
    pub(super) fn is_spent(&self) -> bool {
        self.points.load(Ordering::Relaxed) > self.most
    }
}

impl<S: FrameShader> Frame<'_, S> {
    /// Returns the reason why pieces cannot be placed: a transformation that is not finite, or that divides by zero
    /// somewhere in them.
    pub(super) fn unplaceable(&self, pieces: &[Piece], placement: &Placement) -> Option<String> {
        let bad = |time: f32, camera: &CameraView| {
            let (to_world, to_camera) = (placement.to_world.at(time), camera.world_to_camera.at(time));
            let to_eye = to_world.then(&to_camera);
            if !to_world.is_finite() || !to_eye.is_finite() {
                let (name, space) = (&camera.name, if to_world.is_finite() { "camera" } else { "world" });
                return Some(format!(
                    "its transformation to {space} space has numbers that are not finite, as camera \"{name}\" sees it"
                ));
            }
            if to_eye.is_affine() {
                return None;
            }
            let corners = pieces.iter().flat_map(|p| Placement::object_bound(&**p, time).corners());
            let weights = corners.map(|p| to_eye.hpoint(p.extend(1.0)).w);
            let (least, most) =
                weights.fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), w| (a.min(w), b.max(w)));
            (least <= 0.0 && most >= 0.0).then(|| {
                format!("its transformation divides by numbers from {least} to {most}, which include 0")
            })
        };
        let eyes = || self.eyes.iter().map(|eye| eye.camera).chain([self.options.dicing_camera]);
        placement.times().iter().find_map(|time| eyes().find_map(|eye| bad(*time, eye)))
    }

    /// Reports that a primitive is left out because it exceeds the limit.
    pub(super) fn leave_out<T>(&self, primitive: &Primitive, parts: Vec<T>) -> Vec<T> {
        drop(parts);
        let (name, most) = (primitive.attributes.name(), self.dicing.most_points());
        self.options.reporter.once(
            &format!("points of {name} {}", primitive.id),
            Severity::Error,
            &primitive.at,
            format!(
                "object \"{name}\": its {} needs more than {most} points and is left out; lower \"shadingquality\", or raise \"limits:primitivepoints\"",
                primitive.shape.call_name()
            ),
        );
        Vec::new()
    }
}
