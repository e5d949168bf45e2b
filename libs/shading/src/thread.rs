//! The state that one thread writes to while it shades.

use crate::context::ShadingContext;
use crate::memo::{Dependencies, Dependency, Memo};
use granita_scene::{ShaderUsage, attr};
use granita_shade::Executor;
use granita_texture::TextureReader;

/// The largest number of ray levels, whatever "ray:maxdepth" is.
///
/// A shader runs at each level. Its memory (about 20 KB of stack, registers, a grid of hits and their rays) stays
/// allocated until the last of them returns, so this constant bounds the memory of a thread.
pub(crate) const MAX_RAY_LEVELS: u32 = 1000;
/// The largest number of shaders nested beyond [`MAX_RAY_LEVELS`]. Shadow rays need them, because they have the
/// level of the shader that traces them.
pub(crate) const MORE_NESTED: u32 = 16;
/// The largest number of idle executors that a thread keeps.
const MAX_IDLE: usize = 64;

/// Runs shaders on one thread, and reuses its memory from grid to grid.
pub struct ShaderThread<'f> {
    frame: &'f ShadingContext,
    /// Executors that are not running. Each nested shader (surface, its light, the surface that a ray of the light
    /// hits, ...) uses one.
    idle: Vec<Executor>,
    /// Reads texture files, and keeps the tiles that it used last.
    textures: TextureReader<'f>,
    /// The number of shaders that run on this thread, nested within each other.
    pub(crate) nested: u32,
    /// True while this thread builds ray structures. Its shaders then trace no rays.
    pub(crate) builds_rays: bool,
    /// True while this thread renders depths. Its shaders then see neither lights nor dynamic shadow maps.
    pub is_unlit: bool,
    /// True when shaders show their albedo: the colour of surfaces under white light, without highlights. Volume
    /// shaders then do not run.
    pub shows_albedo: bool,
    /// True when shaders print and save nothing, because their grids are shaded again.
    pub is_mute: bool,
    /// What the running shader's results depend on so far; `None` when that is not asked for.
    pub(crate) notes: Option<Dependencies>,
    /// The answers that are kept for the grid that is shaded.
    pub(crate) memo: Option<Memo>,
}

impl<'f> ShaderThread<'f> {
    /// Returns a thread state without any memory yet.
    pub fn new(frame: &'f ShadingContext) -> Self {
        let textures = frame.textures.reader();
        Self {
            frame,
            idle: Vec::new(),
            textures,
            nested: 0,
            builds_rays: false,
            is_unlit: false,
            shows_albedo: false,
            is_mute: false,
            notes: None,
            memo: None,
        }
    }

    /// Returns the frame.
    pub fn frame(&self) -> &'f ShadingContext {
        self.frame
    }

    /// True when the data that shaders save is kept. It is not kept for grids that are shaded again where the
    /// camera sees them.
    pub(crate) fn keeps_saved(&self) -> bool {
        !self.builds_rays && !self.is_mute
    }

    /// Notes that the running shader's results depend on something.
    pub(crate) fn note(&mut self, one: Dependency) {
        if let Some(notes) = &mut self.notes {
            notes.add(one);
        }
    }

    /// Begins the notes of ray hits. Returns the notes before them.
    pub(crate) fn notes_of_rays(&mut self) -> Option<Dependencies> {
        self.notes.as_mut().map(std::mem::take)
    }

    /// Ends the notes of ray hits. Without "rerender:reshaderays", results do not depend on the lights of what rays
    /// hit.
    pub(crate) fn join_notes(&mut self, outer: Option<Dependencies>) {
        let Some(mut outer) = outer else { return };
        let mut of_rays = self.notes.take().unwrap_or_default();
        if !self.frame.scene.get(attr::RERENDER_RESHADERAYS) {
            of_rays.keep_files();
        }
        outer.add_all(&of_rays);
        self.notes = Some(outer);
    }

    /// Returns the reader of texture files. It does not hold maps without files.
    pub(crate) fn textures(&mut self) -> &mut TextureReader<'f> {
        &mut self.textures
    }

    /// Takes an idle executor for shaders of a usage, or makes one. The caller returns it with
    /// [`ShaderThread::put_executor`].
    pub(crate) fn take_executor(&mut self, usage: ShaderUsage) -> Executor {
        let mut executor = self.idle.pop().unwrap_or_else(|| {
            let mut executor = Executor::new();
            executor.look_for_nan(self.frame.scene.get(attr::DEBUG_SHADERNAN));
            executor
        });
        // Surfaces and maps without light are the same in all passes.
        let varies = usage != ShaderUsage::Displacement && !self.is_unlit && !self.builds_rays;
        executor.seed_random(self.frame.random_seed(varies));
        executor
    }

    /// Returns an executor to the idle ones.
    pub(crate) fn put_executor(&mut self, executor: Executor) {
        // Executors beyond the limit, which very deep rays needed, are freed.
        if self.idle.len() < MAX_IDLE {
            self.idle.push(executor);
        }
    }
}
