//! Ray requests, and the surfaces that rays leave.

use crate::RayObject;
use granita_trace::Ray;

/// The tessellated surface that a ray leaves. The origin of the ray may lie slightly off the tessellation.
///
/// Hits of this object that are nearer than the margin are ignored. Hits of other objects count from the ray's own
/// `tmin` on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Leaving {
    /// The address of the object; 0 for none.
    object: usize,
    /// The margin in world units, as the bits of an `f32`.
    margin: u32,
}

impl Leaving {
    /// Returns the surface of `object`, with a margin in world units.
    pub fn new<O: RayObject>(object: &O, margin: f32) -> Self {
        Self { object: std::ptr::from_ref(object).addr(), margin: margin.max(0.0).to_bits() }
    }

    /// Returns words that tell surfaces and margins apart, as long as their objects exist.
    pub fn words(self) -> [u32; 3] {
        let object = self.object as u64;
        [object as u32, (object >> 32) as u32, self.margin]
    }

    /// The distance from the origin, in world units, within which hits of the object are ignored.
    pub fn margin(self) -> f32 {
        f32::from_bits(self.margin)
    }

    /// True when a hit of `object` at distance `t` (world units) is ignored.
    pub fn hides<O: RayObject>(self, object: &O, t: f32) -> bool {
        t < self.margin() && std::ptr::from_ref(object).addr() == self.object
    }
}

/// A ray to be traced. Its direction is a unit vector, so that distances are in world units.
#[derive(Clone, Copy, Debug)]
pub struct RayRequest {
    /// The lane of the shader that traces the ray.
    pub lane: u32,
    /// The seed of all random choices at the hits of this ray.
    pub name: u32,
    /// The origin, direction, range and time of the ray.
    pub ray: Ray,
    /// The surface that the ray leaves.
    pub leaving: Leaving,
    /// The width of the ray at its origin, in world units.
    pub width: f32,
    /// The growth of the width per world unit of distance.
    pub spread: f32,
}

impl RayRequest {
    /// Returns the width at the origin and its growth per unit of distance.
    pub fn widths(&self) -> [f32; 2] {
        [self.width, self.spread]
    }
}
