//! What a renderer is given from outside.

use crate::priority::Priority;
use crate::spread::Spread;
use granita_base::{Environment, Reporter, SearchPath};
use granita_gsl::ir::Module;
use granita_image::FormatRegistry;
use granita_scene::Call;
use granita_sdb::Databases;
use granita_shade::Shadeop;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Finds compiled shaders by name.
pub trait ShaderLibrary: Send + Sync {
    /// The shader called `name` (without extension).
    ///
    /// # Errors
    /// See [`NoShader`].
    fn load(&self, name: &str) -> Result<Arc<Module>, NoShader>;

    /// A function in C++ that a shader calls, by the text that the compiler left for it (`granita_gsl::ShadeopCall`).
    ///
    /// # Errors
    /// Why there is none.
    fn shadeop(&self, text: &str) -> Result<Arc<dyn Shadeop>, String> {
        Err(format!("shadeop {text}: this program loads none"))
    }
}

/// Why a name stands for no shader.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoShader {
    /// There is none of that name: where it was looked for, as in `looked in a, b`. Who needs it tells the user.
    Missing(String),
    /// There is one, but it cannot be read or compiled. The user knows why.
    Broken,
}

/// Calls as the text of a scene file; binary arrays in it where the flag says so.
pub type CallText = fn(Vec<Call>, bool) -> std::io::Result<Vec<u8>>;

/// Is told how far a frame is. Called from any thread.
pub trait Progress: Send + Sync {
    /// A frame of `total` steps begins.
    fn begin(&self, total: u64);
    /// So many steps of it are done; never decreases.
    fn done(&self, steps: u64);
    /// The frame is over, complete or not.
    fn end(&self);
}

/// Tells nobody.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: u64) {}
    fn done(&self, _: u64) {}
    fn end(&self) {}
}

/// Everything that a frame takes from outside the scene.
#[derive(Clone)]
pub struct RenderEnvironment {
    /// Image formats, for outputs and textures.
    pub registry: FormatRegistry,
    /// Compiled shaders.
    pub shaders: Arc<dyn ShaderLibrary>,
    /// Where textures are looked for: the resolved "path:texture".
    pub texture_path: SearchPath,
    /// Variables, for file names.
    pub variables: Environment,
    /// Receives messages.
    pub reporter: Reporter,
    /// Is told how far the frame is.
    pub progress: Arc<dyn Progress>,
    /// Threads to render with; 0 takes "limits:threads" of the scene.
    pub threads: usize,
    /// The number of files that the process may have open at once; `None` when there is no limit.
    pub open_files: Option<usize>,
    /// Set by somebody else to make a running frame end early (`Command ("return")`).
    pub stop: Arc<AtomicBool>,
    /// Replaces the "crop" of every camera: xmin, xmax, ymin, ymax.
    pub crop: Option<[f32; 4]>,
    /// Writes the calls of "griddump:filename".
    pub call_text: CallText,
    /// Spatial databases; what is saved in one frame is there in the next.
    pub databases: Arc<Databases>,
    /// Scene files as the user named them, for the command line in messages about failed buckets.
    pub scene_files: Vec<String>,
    /// Who renders the buckets of frames.
    pub spread: Spread,
    /// What somebody would have first of a running frame (`Command ("bucketpriority")`).
    pub priority: Arc<Priority>,
}

impl std::fmt::Debug for RenderEnvironment {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RenderEnvironment")
            .field("registry", &self.registry)
            .field("threads", &self.threads)
            .finish_non_exhaustive()
    }
}
