//! The current attribute state, which is edited in place, frozen on demand, and shared until it changes.

use crate::{AttributeSet, attr};
use granita_base::{Location, Param, Transform};
use std::sync::Arc;

/// The state that the next primitive gets.
#[derive(Clone, Debug)]
pub(super) struct Current {
    /// The attributes. Their `flip_normals` is stale until the state is frozen.
    pub(super) set: AttributeSet,
    frozen: Option<Arc<AttributeSet>>,
}

impl Default for Current {
    fn default() -> Self {
        let set = AttributeSet { geometry_sets: [Arc::from("camera")].into(), ..AttributeSet::default() };
        Self { set, frozen: None }
    }
}

impl Current {
    /// Returns the state for a change.
    pub(super) fn edit(&mut self) -> &mut AttributeSet {
        self.frozen = None;
        &mut self.set
    }

    /// Returns the state that a primitive keeps. It is the same `Arc` until the state changes.
    pub(super) fn freeze(&mut self, world_to_camera: Option<&Transform>) -> Arc<AttributeSet> {
        if let Some(frozen) = &self.frozen {
            return frozen.clone();
        }
        self.set.flip_normals = flips_normals(&self.set, world_to_camera);
        let frozen = Arc::new(self.set.clone());
        self.frozen = Some(frozen.clone());
        frozen
    }
}

/// A change of attribute states, for the rules of re-rendering.
#[derive(Clone, Copy, Debug)]
pub(super) enum Edit<'a> {
    /// A change that objects may have in a re-render.
    Allowed,
    /// Another attribute: its name, and the location of the call.
    Attribute(&'a str, &'a Location),
    /// Another call: its name and location.
    Call(&'a str, &'a Location),
}

/// True when the geometric normal, measured in world coordinates, must be negated to comply with "orientation"
/// (reference 4.4.4).
///
/// "outside" follows the handedness of object space, so that normals stay on the same side of an object when it is
/// mirrored. "lh" and "rh" apply to camera space, whatever the transformation.
pub(super) fn flips_normals(set: &AttributeSet, world_to_camera: Option<&Transform>) -> bool {
    let to_world = set.to_world.first();
    let outside = to_world.flips_handedness();
    let left_handed = || {
        let to_camera = match world_to_camera {
            Some(m) => to_world.then(m),
            None => *to_world,
        };
        if to_camera.flips_handedness() { !outside } else { outside }
    };
    match orientation(set) {
        "inside" => !outside,
        "lh" => left_handed(),
        "rh" => !left_handed(),
        _ => outside,
    }
}

/// Returns the effective "orientation", which is never "reverse".
pub(super) fn orientation(set: &AttributeSet) -> &'static str {
    let word = set.get(attr::ORIENTATION);
    ["inside", "lh", "rh"].into_iter().find(|w| *w == &*word).unwrap_or("outside")
}

/// Returns the first string of a parameter.
pub(super) fn string(p: &Param) -> Option<&str> {
    match &p.data {
        granita_base::ParamData::String(v) => v.first().map(|s| &**s),
        _ => None,
    }
}
