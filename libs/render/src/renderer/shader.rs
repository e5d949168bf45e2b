//! The shaders of a frame.

use crate::frame::{FrameShader, ObjectTraits};
use granita_base::{NoiseSource, PassNumbers, Vec3};
use granita_gsl::ir::ValueType;
use granita_scene::{Primitive, attr};
use granita_shade::Grid;
use granita_shading::{Changes, Memo, ObjectState, ShaderThread, ShadingContext};
use std::sync::Arc;

impl FrameShader for ShadingContext {
    type Object = ObjectState;
    type Thread<'a> = ShaderThread<'a>;

    fn object(&self, primitive: &Primitive) -> Arc<ObjectState> {
        ShadingContext::object(self, primitive)
    }

    fn traits(&self, object: &ObjectState) -> ObjectTraits {
        ObjectTraits {
            opaque: object.opaque,
            opaque_in_depth: object.opaque_to_shadows,
            holdout: object.holdout,
            displaces: object.displacement.is_some(),
            max_displacement_world: object.max_displacement_world,
            measures: object.max_displacement_world <= 0.0 && object.moves_points(),
            preshaded: object.preshaded,
            may_batch: object.may_batch,
            saves: object.saves,
        }
    }

    fn thread(&self) -> ShaderThread<'_> {
        ShaderThread::new(self)
    }

    fn unlit_thread(&self) -> ShaderThread<'_> {
        let mut thread = ShaderThread::new(self);
        thread.is_unlit = true;
        thread
    }

    fn albedo_thread(&self) -> ShaderThread<'_> {
        let mut thread = ShaderThread::new(self);
        thread.shows_albedo = true;
        thread.is_mute = true;
        thread
    }

    fn mute(&self, thread: &mut ShaderThread<'_>, mute: bool) {
        thread.is_mute = mute;
    }

    fn begin_pass(&self, numbers: PassNumbers) {
        ShadingContext::begin_pass(self, numbers);
    }

    fn set_all_rays(&self, all: bool) {
        ShadingContext::set_all_rays(self, all);
    }
    fn set_samples(&self, factor: f32) {
        ShadingContext::set_samples(self, factor);
    }
    fn set_tolerance(&self, factor: f32) {
        ShadingContext::set_tolerance(self, factor);
    }

    fn noise_sources(&self) -> Vec<NoiseSource> {
        ShadingContext::noise_sources(self)
    }

    fn saves(&self) -> u64 {
        self.databases.saves()
    }

    fn frame(&self) -> u64 {
        ShadingContext::frame(self)
    }

    fn changes(&self) -> Option<[usize; 3]> {
        ShadingContext::changes(self).map(Changes::counts)
    }

    fn is_locked(&self, primitive: u32) -> bool {
        let primitive = self.scene.primitives.get(primitive as usize);
        primitive.is_some_and(|primitive| primitive.attributes.get(attr::RERENDER_LOCKED))
    }

    fn is_stale(&self, memo: &Memo, since: u64) -> bool {
        ShadingContext::is_stale(self, memo, since)
    }

    fn forget(&self, memo: &mut Memo, since: u64) {
        ShadingContext::forget(self, memo, since);
    }

    fn shade_keeping(
        &self,
        thread: &mut ShaderThread<'_>,
        object: &ObjectState,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
        memo: &mut Memo,
    ) -> Vec<Option<Vec<f32>>> {
        let mut found = thread.shade_keeping(object, grid, wanted, memo);
        place_points(self, wanted, &mut found);
        found
    }

    fn displace(&self, thread: &mut ShaderThread<'_>, object: &ObjectState, grid: &mut Grid) {
        thread.displace(object, grid);
    }

    fn shade(
        &self,
        thread: &mut ShaderThread<'_>,
        object: &ObjectState,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        // Tiles of depth maps are made on demand, in any pass, with the same bits.
        if !thread.is_unlit {
            self.seed_grid(grid);
        }
        let mut found = thread.shade(object, grid, wanted);
        place_points(self, wanted, &mut found);
        found
    }
}

/// Converts the requested positions of a grid to world space.
fn place_points(frame: &ShadingContext, wanted: &[(Arc<str>, ValueType)], found: &mut [Option<Vec<f32>>]) {
    // Images show world space positions of surfaces. The space of other points is defined by the shader alone.
    let origin = frame.camera.common_origin;
    let is_place = |(name, ty): &(Arc<str>, ValueType)| &**name == "P" && *ty == ValueType::Point;
    let points = found.iter_mut().zip(wanted).filter(|(_, wanted)| is_place(wanted));
    for values in points.filter_map(|(values, _)| values.as_mut()).filter(|_| origin != Vec3::ZERO) {
        let n = (values.len() / 3).max(1);
        for (component, from) in values.chunks_exact_mut(n).zip(origin.to_array()) {
            component.iter_mut().for_each(|x| *x += from);
        }
    }
}
