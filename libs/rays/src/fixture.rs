//! A frame without shaders for unit tests. Its displacement is a function.

use crate::{GridShader, GridShaders, RayDisplacement, RayFrame, RayObject, RayWorld};
use granita_base::{Color, Reporter, Vec3};
use granita_dicing::CameraView;
use granita_fixture::Fixture;
use granita_scene::{AttributeSet, Primitive, Scene, attr};
use granita_shade::Grid;
use std::sync::Arc;

/// A function of the position that returns the displacement along the normal.
pub(crate) type Displace = fn(Vec3) -> f32;

/// An object that is displaced when its attributes have any displacement shader.
pub(crate) struct Object {
    attributes: Arc<AttributeSet>,
    name: Arc<str>,
}

impl RayObject for Object {
    fn name(&self) -> &Arc<str> {
        &self.name
    }

    fn attributes(&self) -> &AttributeSet {
        &self.attributes
    }

    fn color_and_opacity(&self) -> [Color; 2] {
        [self.attributes.get(attr::COLOR), self.attributes.get(attr::OPACITY)]
    }

    fn is_opaque_to_shadows(&self) -> bool {
        true
    }

    fn displacement(&self) -> RayDisplacement {
        match &self.attributes.displacement {
            None => RayDisplacement::None,
            Some(_) => RayDisplacement::Moves { bound_world: self.attributes.get(attr::DISPLACE_MAXRADIUS) },
        }
    }

    fn queries_parent(&self) -> bool {
        false
    }
}

/// The frame of a test.
pub(crate) struct Frame {
    pub(crate) scene: Arc<Scene>,
    pub(crate) rays: RayWorld<Object>,
    camera: CameraView,
    reporter: Reporter,
    displace: Displace,
}

impl Frame {
    pub(crate) fn new(fixture: &Fixture, displace: Displace) -> Self {
        let (scene, camera) = fixture.view();
        let rays = RayWorld::new(&scene, 2);
        Self { scene, rays, camera, reporter: fixture.reporter.clone(), displace }
    }
}

/// The shading state of one thread.
pub(crate) struct Thread<'f>(pub(crate) &'f Frame);

impl<'f> GridShader<'f, Object> for Thread<'f> {
    fn ray_frame(&self) -> RayFrame<'f> {
        let Frame { scene, rays, camera, reporter, .. } = self.0;
        RayFrame { scene, camera, eye: camera.position_world(), reporter, cache: &rays.cache }
    }

    fn displace_for_rays(&mut self, _: &Object, grid: &mut Grid) {
        for i in 0..grid.len() {
            let (p, n) = (grid.p.get(i), grid.n.get(i).normalize_or_zero());
            grid.p.set(i, p + n * (self.0.displace)(p));
        }
    }
}

impl GridShaders<Object> for Frame {
    fn ray_frame(&self) -> RayFrame<'_> {
        Thread(self).ray_frame()
    }

    fn thread(&self) -> Box<dyn GridShader<'_, Object> + '_> {
        Box::new(Thread(self))
    }

    fn object(&self, primitive: &Primitive) -> Arc<Object> {
        let attributes = primitive.attributes.clone();
        Arc::new(Object { name: attributes.name(), attributes })
    }
}
