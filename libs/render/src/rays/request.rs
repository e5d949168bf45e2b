//! Rays to be traced, and what they leave.

use crate::object::ObjectState;
use granita_trace::Ray;

/// The rough surface that a ray leaves: one that is tessellated for rays, and so not quite where the ray begins.
///
/// Hits of that very object nearer than a margin do not count. Those of other objects do, from the ray's own `tmin` on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct Leaving {
    /// Address of its state, which is one for all of the object; 0 for none.
    object: usize,
    /// World units, as bits.
    margin: u32,
}

impl Leaving {
    /// From an object, with a margin in world units.
    pub(crate) fn new(object: &ObjectState, margin: f32) -> Self {
        Self { object: std::ptr::from_ref(object).addr(), margin: margin.max(0.0).to_bits() }
    }

    /// How far from the origin the object does not count, world units.
    pub(crate) fn margin(self) -> f32 {
        f32::from_bits(self.margin)
    }

    /// Whether a hit of an object at distance `t` does not count.
    pub(crate) fn hides(self, object: &ObjectState, t: f32) -> bool {
        t < self.margin() && std::ptr::from_ref(object).addr() == self.object
    }
}

/// A ray to be traced. The direction is of length 1, so that distances are world units.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayRequest {
    /// Lane of the shader that traces.
    pub(crate) lane: u32,
    /// Names the ray: what is random about its hits.
    pub(crate) name: u32,
    /// Where, which way, how far.
    pub(crate) ray: Ray,
    /// What it leaves.
    pub(crate) leaving: Leaving,
    /// Width at the origin.
    pub(crate) width: f32,
    /// Growth of the width per unit of distance.
    pub(crate) spread: f32,
}

impl RayRequest {
    /// Width at the origin, and its growth per unit of distance.
    pub(crate) fn widths(&self) -> [f32; 2] {
        [self.width, self.spread]
    }
}

/// Whether a shader of the object may ask the shader whose ray meets it.
pub(crate) fn asks_parent(object: &ObjectState) -> bool {
    let bumps = object.displacement.as_ref().filter(|_| !object.displaces_rays());
    [Some(&object.surface), object.volume.as_ref(), bumps]
        .into_iter()
        .flatten()
        .any(|s| s.group.asks_parent())
}
