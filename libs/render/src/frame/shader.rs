//! What a frame needs of shaders.

use granita_base::{NoiseSource, PassNumbers};
use granita_gsl::ir::ValueType;
use granita_scene::{Holdout, Primitive};
use granita_shade::Grid;
use granita_shading::Memo;
use std::sync::Arc;

/// The properties of an object that the frame needs without running its shaders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ObjectTraits {
    /// True when the object is opaque whatever its shaders compute.
    pub(crate) opaque: bool,
    /// True when it counts as opaque where only depths are shown. That is when it is opaque, or when
    /// "ray:opaqueshadows" is set (reference 10.1.1).
    pub(crate) opaque_in_depth: bool,
    /// "holdout".
    pub(crate) holdout: Holdout,
    /// True when a displacement shader runs.
    pub(crate) displaces: bool,
    /// The bound of the displacement in world units.
    pub(crate) max_displacement_world: f32,
    /// True when the scene has no bound of the displacement and a shader moves points, so that the bound is
    /// measured.
    pub(crate) measures: bool,
    /// True for a preshaded grid, whose vertices are its points.
    pub(crate) preshaded: bool,
    /// True when small grids may be batched without a change of results.
    pub(crate) may_batch: bool,
    /// True when shading saves data, so that grids that are not visible must not be shaded.
    pub(crate) saves: bool,
}

/// Shades grids. The frame does not depend on shaders, so tests shade with closures of their own.
pub(crate) trait FrameShader: Sync {
    /// The state of an object, shared by the primitives that have it.
    type Object: Send + Sync;
    /// The data that one thread keeps from grid to grid.
    type Thread<'a>
    where
        Self: 'a;

    /// Returns the state of a primitive's object.
    fn object(&self, primitive: &Primitive) -> Arc<Self::Object>;
    /// Returns the properties of an object.
    fn traits(&self, object: &Self::Object) -> ObjectTraits;
    /// Returns the state of a new thread.
    fn thread(&self) -> Self::Thread<'_>;
    /// Returns the state of a new thread of a frame without colours, whose shaders need no light (reference
    /// 10.1.1).
    fn unlit_thread(&self) -> Self::Thread<'_> {
        self.thread()
    }
    /// Returns the state of a new thread of a frame whose surfaces show their albedo. Its shaders print and save
    /// nothing.
    fn albedo_thread(&self) -> Self::Thread<'_> {
        self.thread()
    }
    /// Makes the shaders of a thread print and save nothing, for grids that are shaded again, or turns that off.
    fn mute(&self, thread: &mut Self::Thread<'_>, mute: bool) {
        let _ = (thread, mute);
    }
    /// Begins a pass of an image that is the sum of passes. Random numbers of different passes are independent.
    fn begin_pass(&self, numbers: PassNumbers) {
        let _ = numbers;
    }
    /// Sets the factor of the tolerance of what shading interpolates, above 0; 1 is what the scene says.
    fn set_tolerance(&self, factor: f32) {
        let _ = factor;
    }
    /// Sets a factor of all numbers of samples that shading draws, above 0; 1 is what the scene says.
    fn set_samples(&self, factor: f32) {
        let _ = factor;
    }
    /// Sets whether points trace all of their rays, also where the first of them agree.
    fn set_all_rays(&self, all: bool) {
        let _ = all;
    }
    /// Returns the noise sources that drew random numbers so far.
    fn noise_sources(&self) -> Vec<NoiseSource> {
        Vec::new()
    }
    /// Returns a number that grows when shading saves anything for later frames.
    fn saves(&self) -> u64 {
        0
    }
    /// Returns the number of the frame. A re-render has a larger one than the frames before.
    fn frame(&self) -> u64 {
        0
    }
    /// Returns the numbers of lights, files and objects that changed since the last frame; `None` when nothing of it is
    /// left.
    fn changes(&self) -> Option<[usize; 3]> {
        None
    }
    /// True when the object of a primitive, by its number in the scene, keeps its colours.
    fn is_locked(&self, primitive: u32) -> bool {
        let _ = primitive;
        false
    }
    /// True when something changed after the frame `since` that the results of a memo depend on.
    fn is_stale(&self, memo: &Memo, since: u64) -> bool {
        let _ = (memo, since);
        false
    }
    /// Drops the answers of a memo that depend on something that changed after the frame `since`.
    fn forget(&self, memo: &mut Memo, since: u64) {
        let _ = (memo, since);
    }
    /// Displaces a grid.
    fn displace(&self, thread: &mut Self::Thread<'_>, object: &Self::Object, grid: &mut Grid);
    /// Shades a grid. Returns the requested variables, component by component.
    fn shade(
        &self,
        thread: &mut Self::Thread<'_>,
        object: &Self::Object,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
    ) -> Vec<Option<Vec<f32>>>;
    /// Does the same as [`FrameShader::shade`], with answers of a memo where it has them, and keeps answers there.
    fn shade_keeping(
        &self,
        thread: &mut Self::Thread<'_>,
        object: &Self::Object,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
        memo: &mut Memo,
    ) -> Vec<Option<Vec<f32>>> {
        let _ = memo;
        self.shade(thread, object, grid, wanted)
    }
}
