//! Rays: what they can meet, and what they bring back.
//!
//! [`world`] knows the geometry sets, [`scene`] is one of them, [`mesh`] its tessellations and [`cache`] what is kept of these.
//! None of them knows how shaders run: displaced surfaces are tessellated through [`GridShader`], which shading implements.
//! [`trace`] shades what rays meet.

mod areas;
pub(crate) mod cache;
pub(crate) mod mesh;
pub(crate) mod request;
pub(crate) mod scene;
pub(crate) mod trace;
pub(crate) mod world;

use crate::CameraView;
use crate::object::ObjectState;
use cache::TessellationCache;
use granita_base::{Reporter, Vec3};
use granita_scene::{Primitive, Scene};
use granita_shade::Grid;
use std::sync::Arc;

/// What tessellating for rays sees of a frame.
#[derive(Clone, Copy)]
pub(crate) struct Seen<'f> {
    /// The scene.
    pub(crate) scene: &'f Scene,
    /// The camera that dices and shades.
    pub(crate) camera: &'f CameraView,
    /// Its place in "common" space.
    pub(crate) eye: Vec3,
    /// Receives messages.
    pub(crate) reporter: &'f Reporter,
    /// Tessellations of all sets.
    pub(crate) cache: &'f TessellationCache,
}

impl Seen<'_> {
    /// Size of a pixel of the camera at the distance of a place, in units of "common" space.
    pub(crate) fn pixel(&self, p: Vec3) -> f32 {
        let distance = self.eye.distance(p).max(self.camera.near);
        1.0 / self.camera.raster_scale(distance).abs().max_element()
    }
}

/// Runs shaders on the grids of tessellations, on one thread.
pub(crate) trait GridShader<'f> {
    /// What there is to see.
    fn seen(&self) -> Seen<'f>;

    /// Runs the displacement shaders, if any: moves points, and normals and tangents with them. Shaders see no rays, and
    /// what they print and save is not kept.
    fn displace_for_rays(&mut self, object: &ObjectState, grid: &mut Grid);
}

/// Runs shaders on the grids of tessellations, on as many threads as ask.
pub(crate) trait GridShaders: Sync {
    /// What there is to see.
    fn seen(&self) -> Seen<'_>;

    /// For one thread.
    fn thread(&self) -> Box<dyn GridShader<'_> + '_>;

    /// The state of a primitive's object.
    fn object(&self, primitive: &Primitive) -> Arc<ObjectState>;
}
