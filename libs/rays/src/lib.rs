//! Traces rays against the geometry sets of a scene.
//!
//! A [`RayWorld`] holds the geometry sets of a scene. A [`RayScene`] is one of them. Its surfaces are tessellated
//! into triangles when the first ray needs them ([`mesh`]). A [`TessellationCache`] keeps the triangles within a
//! limit of bytes. The input is batches of [`RayRequest`]s. The output is [`SetHit`]s, distances, or visibility.
//! [`RayScene::locate`] and [`grid_of`] turn hits into grids that can be shaded.
//!
//! This crate does not depend on how shaders run. Displaced surfaces are tessellated through [`GridShader`]. The
//! state of an object is a type that implements [`RayObject`].
//!
//! ```
//! use granita_base::{Color, MotionTransform, Params, Reporter, ShapeDesc, Vec3};
//! use granita_dicing::CameraView;
//! use granita_rays::{GridShader, GridShaders, RayDisplacement, RayFrame, RayObject, RayRequest, RayWorld};
//! use granita_scene::{AttributeSet, Camera, Primitive, Scene, ShapeKey};
//! use granita_shade::Grid;
//! use granita_trace::Ray;
//! use std::sync::Arc;
//!
//! /// A grey object without shaders.
//! struct Plain(Arc<AttributeSet>, Arc<str>);
//!
//! impl RayObject for Plain {
//!     fn name(&self) -> &Arc<str> { &self.1 }
//!     fn attributes(&self) -> &AttributeSet { &self.0 }
//!     fn color_and_opacity(&self) -> [Color; 2] { [Color::splat(0.5), Color::ONE] }
//!     fn is_opaque_to_shadows(&self) -> bool { true }
//!     fn displacement(&self) -> RayDisplacement { RayDisplacement::None }
//!     fn queries_parent(&self) -> bool { false }
//! }
//!
//! struct Frame { scene: Scene, camera: CameraView, reporter: Reporter, world: RayWorld<Plain> }
//! struct Thread<'f>(&'f Frame);
//!
//! impl<'f> GridShader<'f, Plain> for Thread<'f> {
//!     fn ray_frame(&self) -> RayFrame<'f> {
//!         let Frame { scene, camera, reporter, world } = self.0;
//!         RayFrame { scene, camera, eye: camera.position_world(), reporter, cache: &world.cache }
//!     }
//!     fn displace_for_rays(&mut self, _: &Plain, _: &mut Grid) {}
//! }
//!
//! impl GridShaders<Plain> for Frame {
//!     fn ray_frame(&self) -> RayFrame<'_> { Thread(self).ray_frame() }
//!     fn thread(&self) -> Box<dyn GridShader<'_, Plain> + '_> { Box::new(Thread(self)) }
//!     fn object(&self, primitive: &Primitive) -> Arc<Plain> {
//!         Arc::new(Plain(primitive.attributes.clone(), primitive.attributes.name()))
//!     }
//! }
//!
//! let attributes = AttributeSet { geometry_sets: [Arc::from("things")].into(), ..AttributeSet::default() };
//! let ball = Primitive {
//!     id: 0,
//!     shape: ShapeDesc::Sphere { radius: 1.0, zmin: -1.0, zmax: 1.0, thetamax_deg: 360.0 },
//!     keys: vec![ShapeKey { time: 0.0, params: Params::new() }],
//!     attributes: Arc::new(attributes),
//!     at: Default::default(),
//! };
//! let camera = Camera { name: "main".into(), world_to_camera: MotionTransform::default(), params: Params::new() };
//! let reporter = Reporter::silent();
//! let camera = CameraView::new(&camera, &reporter);
//! let scene = Scene { primitives: vec![Arc::new(ball)], ..Scene::default() };
//! let frame = Frame { world: RayWorld::new(&scene, 1), scene, camera, reporter };
//!
//! let things = frame.world.scene("things", &frame).unwrap();
//! let along_z = |x: f32| {
//!     let ray = Ray { origin: Vec3::new(x, 0.0, -5.0), tmin: 0.0, dir: Vec3::Z, tmax: f32::INFINITY, time: 0.0 };
//!     RayRequest::new(ray)
//! };
//! let hits = things.closest(&mut Thread(&frame), &[along_z(0.0), along_z(2.0)]);
//! assert!((hits[0].t - 4.0).abs() < 1e-3);
//! assert!(!hits[1].is_hit());
//! ```
//!
//! # Invariants
//!
//! A hit depends on the ray and the scene alone. It does not depend on what was tessellated, cached or evicted
//! before.

#![forbid(unsafe_code)]

mod areas;
mod cache;
mod convex;
pub mod mesh;
mod request;
pub mod sampling;
mod scene;
mod world;

#[cfg(test)]
mod fixture;

pub use cache::{CACHE_BYTES, CacheCounts, TessellationCache};
pub use mesh::{HitShading, MeshHit, RayMesh, grid_of};
pub use request::{Departure, Leaving, RayRequest};
pub use scene::{Located, RayBuild, RayScene, SetHit, mesh_hit};
pub use world::{RayCounts, RayLimits, RayWorld};

use granita_base::{Color, Reporter, Vec3};
use granita_dicing::CameraView;
use granita_scene::{AttributeSet, Primitive, Scene};
use granita_shade::Grid;
use std::sync::Arc;

/// The effect of the displacement of an object on rays.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum RayDisplacement {
    /// The object has no displacement.
    #[default]
    None,
    /// The displacement changes the shading normals of hits. The surface stays where it is.
    Bumps,
    /// The surface is tessellated at its displaced positions.
    Moves {
        /// The largest displacement, in world units. 0 when the scene does not specify it.
        bound_world: f32,
    },
}

/// The state of an object that tracing and tessellation read.
pub trait RayObject: Send + Sync {
    /// Returns the name of the object, for messages.
    fn name(&self) -> &Arc<str>;

    /// Returns the attributes of the object.
    fn attributes(&self) -> &AttributeSet;

    /// Its attributes "C" and "opacity".
    fn color_and_opacity(&self) -> [Color; 2];

    /// True when shadow rays treat the object as opaque.
    fn is_opaque_to_shadows(&self) -> bool;

    /// Returns how the displacement of the object shows to rays.
    fn displacement(&self) -> RayDisplacement;

    /// True when a shader that runs at hits of the object queries the shader that traced the ray.
    fn queries_parent(&self) -> bool;
}

/// The state of a frame that tessellation reads.
#[derive(Clone, Copy)]
pub struct RayFrame<'f> {
    /// The scene.
    pub scene: &'f Scene,
    /// The camera that dices and shades.
    pub camera: &'f CameraView,
    /// The position of the camera in "common" space.
    pub eye: Vec3,
    /// Receives messages.
    pub reporter: &'f Reporter,
    /// The tessellations of all sets.
    pub cache: &'f TessellationCache,
}

impl RayFrame<'_> {
    /// Returns the size of a pixel of the camera at the distance of a point, in units of "common" space.
    #[inline]
    pub fn pixel(&self, p: Vec3) -> f32 {
        let distance = self.eye.distance(p).max(self.camera.near);
        1.0 / self.camera.raster_scale(distance).abs().max_element()
    }
}

/// Runs shaders on the grids of tessellations, on one thread.
pub trait GridShader<'f, O> {
    /// The frame.
    fn ray_frame(&self) -> RayFrame<'f>;

    /// Runs the displacement shaders of the object, if any. They move points, normals and tangents. Shaders see no
    /// rays here, and their printed and saved output is discarded.
    fn displace_for_rays(&mut self, object: &O, grid: &mut Grid);
}

/// Runs shaders on the grids of tessellations, on several threads.
pub trait GridShaders<O>: Sync {
    /// The frame.
    fn ray_frame(&self) -> RayFrame<'_>;

    /// Returns the shading state of one thread.
    fn thread(&self) -> Box<dyn GridShader<'_, O> + '_>;

    /// Returns the state of a primitive's object.
    fn object(&self, primitive: &Primitive) -> Arc<O>;
}
