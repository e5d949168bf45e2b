//! Transformations (reference 2.5), alone or as the keys of a motion block.

use super::current::Edit;
use super::{Phase, Saved1, State};
use crate::interface::SET_TRANSFORM;
use crate::{Call, TransformTarget};
use granita_base::{Location, MotionTransform, Severity, Transform, Vec3};

/// The change that a transformation call requests.
pub(super) enum Change {
    /// Prepend to the current transformation.
    Append(Transform),
    /// Replace the current transformation.
    Set(MotionTransform),
}

impl State {
    /// Handles one transformation call.
    pub(super) fn transform(&mut self, call: Call, at: &Location) {
        let name = call.name();
        let change = match call {
            Call::Translate(t) => Change::Append(Transform::translate(t.into())),
            Call::Scale(s) => Change::Append(Transform::scale(s.into())),
            Call::Rotate { angle_deg, axis } => {
                let axis = Vec3::from(axis);
                if axis == Vec3::ZERO && angle_deg != 0.0 {
                    self.report_object(Severity::Error, at, name, "Rotate about an axis of length zero");
                }
                // A rotation about an axis that is not finite would be the identity.
                let known = axis.is_finite();
                let rotation = Transform::rotate(angle_deg.to_radians(), axis);
                Change::Append(if known { rotation } else { Transform::scale(axis) })
            }
            Call::AppendTransform(m) => Change::Append(Transform::from_rows(&m)),
            Call::SetTransform(TransformTarget::Matrix(m)) => Change::Set(Transform::from_rows(&m).into()),
            Call::SetTransform(TransformTarget::Named(space)) => match self.named_space(&space) {
                Some(m) => Change::Set(m),
                None => {
                    let known = SET_TRANSFORM.words("space").iter().copied();
                    let names = known.chain(self.saved.keys().map(|k| &**k));
                    let hint = hint(granita_base::suggestion(&space, names));
                    let text = format!("SetTransform: no coordinate system \"{space}\"{hint}");
                    self.report(Severity::Error, at, name, text);
                    Change::Append(Transform::IDENTITY)
                }
            },
            _ => return,
        };
        let finite = match &change {
            Change::Append(m) => m.is_finite(),
            Change::Set(m) => m.keys().iter().all(|(_, m)| m.is_finite()),
        };
        let change = if finite {
            change
        } else {
            let text = format!("{name} with numbers that are not finite: the call is ignored");
            self.report_object(Severity::Error, at, name, text);
            Change::Append(Transform::IDENTITY)
        };
        if self.motion.is_some() {
            return self.motion_transform(name, change, at);
        }
        self.edit_sets(Edit::Call(name, at), |set| match &change {
            Change::Append(m) => set.to_world.prepend(m),
            Change::Set(m) => set.to_world = m.clone(),
        });
    }

    /// Returns the transformation from a named space to the space that the current transformation leads to.
    fn named_space(&self, name: &str) -> Option<MotionTransform> {
        if let Some(saved) = self.saved.get(name).and_then(|s| s.transform()) {
            return Some(saved.clone());
        }
        let projected = |f: fn(&crate::Camera) -> Transform| {
            let camera = self.cameras.first()?;
            Some(camera.world_to_camera.then(&f(camera).into()).inverse())
        };
        match name {
            "world" | "common" => Some(Transform::IDENTITY.into()),
            // Before World the frame begins in camera space unless a camera was placed.
            "camera" => Some(
                self.cameras.first().map_or_else(MotionTransform::default, |c| c.world_to_camera.inverse()),
            ),
            "screen" => projected(crate::Camera::camera_to_screen),
            "NDC" => projected(crate::Camera::camera_to_ndc),
            "raster" => projected(crate::Camera::camera_to_raster),
            _ => None,
        }
    }

    /// Handles `PopTransform`.
    pub(super) fn pop_transform(&mut self, at: &Location) {
        match self.stack.last().map(|p| &p.what) {
            Some(Saved1::Transform(_)) => {}
            Some(Saved1::Attributes(_)) => {
                let text = "PopTransform inside a PushAttributes that came later than PushTransform: the call is ignored";
                return self.report_imbalance(Severity::Error, at, text.to_owned());
            }
            None => {
                let text = "PopTransform without PushTransform: the call is ignored";
                return self.report_imbalance(Severity::Error, at, text.to_owned());
            }
        }
        if let Some(super::Push { what: Saved1::Transform(saved), .. }) = self.stack.pop() {
            self.current.edit().to_world = saved;
        }
    }

    /// Handles `PopAttributes`.
    pub(super) fn pop_attributes(&mut self, at: &Location) {
        let Some(depth) = self.stack.iter().rposition(|p| matches!(p.what, Saved1::Attributes(_))) else {
            let text = "PopAttributes without PushAttributes: the call is ignored";
            return self.report_imbalance(Severity::Error, at, text.to_owned());
        };
        // Transformations that were pushed inside of the block end with it.
        for push in self.stack.split_off(depth + 1) {
            self.report_imbalance(Severity::Error, &push.at, "PushTransform without PopTransform".to_owned());
        }
        self.leave_modify_above(depth);
        if let Some(super::Push { what: Saved1::Attributes(saved), .. }) = self.stack.pop() {
            self.current = *saved;
        }
    }

    /// Returns the transform from world to the first camera, when it is determined.
    pub(super) fn shading_camera(&self) -> Option<Transform> {
        let known = self.phase != Phase::Options || !self.cameras.is_empty();
        self.cameras.first().filter(|_| known).map(|c| *c.world_to_camera.first())
    }
}

/// Returns `; did you mean ...`, or an empty string.
pub(super) fn hint(suggestion: Option<&str>) -> String {
    suggestion.map(|s| format!("; did you mean \"{s}\"?")).unwrap_or_default()
}
