//! Ray requests, and the surfaces that rays leave.

use crate::RayObject;
use granita_base::Vec3;
use granita_shade::RayPath;
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
        t < self.margin() && self.is_of(object)
    }

    /// True when all hits of `object` up to distance `t` (world units) are ignored. One at the margin itself is found
    /// by the ray that begins there.
    pub fn hides_up_to<O: RayObject>(self, object: &O, t: f32) -> bool {
        t <= self.margin() && self.is_of(object)
    }

    fn is_of<O: RayObject>(self, object: &O) -> bool {
        std::ptr::from_ref(object).addr() == self.object
    }
}

/// The surface that reflected rays leave. Convex surfaces are not hit again by rays that leave them outward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Departure {
    /// The id of the primitive.
    pub primitive: u32,
    /// The point of the surface, in world space.
    pub p: Vec3,
    /// The axis of the cone of rays, in world space.
    pub axis: Vec3,
    /// The position from which the point is seen, in world space. `None` when it is not known.
    pub viewer: Option<Vec3>,
}

impl Departure {
    /// Returns words that tell departures apart.
    pub fn words(&self) -> [u32; 11] {
        let ([px, py, pz], [x, y, z]) = (self.p.to_array(), self.axis.to_array());
        let [vx, vy, vz] = self.viewer.unwrap_or_default().to_array();
        let [a, b, c, d, e, f, g, h, i] = [px, py, pz, x, y, z, vx, vy, vz].map(f32::to_bits);
        [self.primitive, u32::from(self.viewer.is_some()), a, b, c, d, e, f, g, h, i]
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
    /// How it leaves that surface, for reflected rays.
    pub departure: Option<Departure>,
    /// The path of rays that ends with this one.
    pub path: RayPath,
    /// The width of the ray at its origin, in world units.
    pub width: f32,
    /// The growth of the width per world unit of distance.
    pub spread: f32,
}

impl RayRequest {
    /// Returns a ray that leaves no surface, of width 0, for lane 0.
    pub fn new(ray: Ray) -> Self {
        let (leaving, path) = (Leaving::default(), RayPath::default());
        Self { lane: 0, name: 0, ray, leaving, departure: None, path, width: 0.0, spread: 0.0 }
    }

    /// Returns the width at the origin and its growth per unit of distance.
    pub fn widths(&self) -> [f32; 2] {
        [self.width, self.spread]
    }
}
