//! What one thread writes to while it shades.

use super::context::ShadingContext;
use granita_scene::attr;
use granita_shade::Executor;
use granita_texture::TextureReader;

/// Levels of rays at most, whatever "ray:maxdepth" says.
///
/// A shader runs at each, and what it takes (some 20 KB of stack, registers, a grid of hits and their rays) is there until
/// the last of them returns. So this bounds what a thread takes.
pub(crate) const MAX_RAY_LEVELS: u32 = 1000;
/// Shaders that run within those, at most: for shadow rays, which have the level of the shader that traces them.
pub(crate) const MORE_NESTED: u32 = 16;
/// Executors that are kept for later.
const MAX_IDLE: usize = 64;

/// Runs shaders on one thread; its memory is kept from grid to grid.
pub(crate) struct ShaderThread<'f> {
    frame: &'f ShadingContext,
    /// Executors that are not running: one is in use for each nested shader (surface, its light, the surface
    /// that a ray of the light hits, ...).
    idle: Vec<Executor>,
    /// Reads texture files, and keeps the tiles that it used last.
    textures: TextureReader<'f>,
    /// Shaders that run on this thread, within each other.
    pub(crate) nested: u32,
    /// Structures for rays are being built by this thread: its shaders see no rays.
    pub(crate) builds_rays: bool,
    /// Depths are being rendered by this thread: its shaders see no lights, and nothing of dynamic shadow maps.
    pub(crate) is_unlit: bool,
    /// Shaders print and save nothing: their grids are shaded again.
    pub(crate) is_mute: bool,
}

impl<'f> ShaderThread<'f> {
    /// With no memory yet.
    pub(crate) fn new(frame: &'f ShadingContext) -> Self {
        let textures = frame.textures.reader();
        Self {
            frame,
            idle: Vec::new(),
            textures,
            nested: 0,
            builds_rays: false,
            is_unlit: false,
            is_mute: false,
        }
    }

    /// The frame.
    pub(crate) fn frame(&self) -> &'f ShadingContext {
        self.frame
    }

    /// Whether what shaders save is kept: not of grids that are shaded again where they are seen.
    pub(crate) fn keeps_saved(&self) -> bool {
        !self.builds_rays && !self.is_mute
    }

    /// Reads texture files, but maps without files.
    pub(crate) fn textures(&mut self) -> &mut TextureReader<'f> {
        &mut self.textures
    }

    /// An executor that nobody uses; give it back with [`ShaderThread::put_executor`].
    pub(crate) fn take_executor(&mut self) -> Executor {
        self.idle.pop().unwrap_or_else(|| {
            let mut executor = Executor::new();
            executor.look_for_nan(self.frame.scene.get(attr::DEBUG_SHADERNAN));
            executor.seed_random(self.frame.scene.get(attr::RANDOM_SEED) as u32);
            executor
        })
    }

    /// Gives an executor back.
    pub(crate) fn put_executor(&mut self, executor: Executor) {
        // What very deep rays needed is given back.
        if self.idle.len() < MAX_IDLE {
            self.idle.push(executor);
        }
    }
}
