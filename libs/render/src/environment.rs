//! The inputs of a renderer from outside of the scene.

use crate::passes::PassPlan;
use crate::priority::Priority;
use crate::spread::Spread;
use granita_base::{Environment, Reporter, SearchPath};
use granita_image::{Denoiser, FormatRegistry};
use granita_scene::Call;
use granita_sdb::Databases;
use granita_shading::{ShaderLibrary, ShadingEnvironment};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Converts calls to the text of a scene file, with binary arrays when the flag is true.
pub type CallText = fn(Vec<Call>, bool) -> std::io::Result<Vec<u8>>;

/// Receives the progress of a frame. Called from any thread.
pub trait Progress: Send + Sync {
    /// An image of `total` steps starts. `image` is its file name, or that of the first of several images of a camera.
    fn begin(&self, image: &Path, total: u64);
    /// The given number of steps is done. It never decreases.
    fn done(&self, steps: u64);
    /// The image has ended, complete or not.
    fn end(&self);
    /// A file was written. By default nothing happens.
    fn wrote(&self, _: &Path) {}
}

/// Ignores all progress.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _: &Path, _: u64) {}
    fn done(&self, _: u64) {}
    fn end(&self) {}
}

/// All inputs of a frame from outside of the scene.
#[derive(Clone)]
pub struct RenderEnvironment {
    /// The image formats of outputs and textures.
    pub registry: FormatRegistry,
    /// The library of compiled shaders.
    pub shaders: Arc<dyn ShaderLibrary>,
    /// The search path of textures: the resolved "path:texture".
    pub texture_path: SearchPath,
    /// The variables for file names.
    pub variables: Environment,
    /// Receives messages.
    pub reporter: Reporter,
    /// Receives the progress of the frame.
    pub progress: Arc<dyn Progress>,
    /// The number of threads to render with. 0 takes "limits:threads" of the scene.
    pub threads: usize,
    /// The number of files that the process may have open at once; `None` when there is no limit.
    pub open_files: Option<usize>,
    /// Set by the caller to make a running frame end early (`Command ("return")`).
    pub stop: Arc<AtomicBool>,
    /// True when the images of a frame that `stop` ends are kept as partial ones, under [`crate::partial_path`].
    pub keep_partial: bool,
    /// Replaces the "crop" of every camera: xmin, xmax, ymin, ymax, as fractions of the image.
    pub crop: Option<[f32; 4]>,
    /// Writes the calls of "griddump:filename".
    pub call_text: CallText,
    /// The spatial databases. Records saved in one frame are available in the next one.
    pub databases: Arc<Databases>,
    /// The scene files as the user named them, for the command line in messages about failed buckets.
    pub scene_files: Vec<String>,
    /// The processes that render the buckets of frames.
    pub spread: Spread,
    /// The priority of buckets of a running frame (`Command ("bucketpriority")`).
    pub priority: Arc<Priority>,
    /// The passes whose sum the images are; `None` for frames of their own.
    pub passes: Option<PassPlan>,
    /// Removes the noise of images with colours; `None` to leave it. It has no part in re-rendering.
    pub denoiser: Option<Arc<dyn Denoiser>>,
}

impl RenderEnvironment {
    /// Returns the inputs of shading.
    pub(crate) fn shading(&self) -> ShadingEnvironment {
        ShadingEnvironment {
            registry: self.registry.clone(),
            shaders: self.shaders.clone(),
            texture_path: self.texture_path.clone(),
            reporter: self.reporter.clone(),
            threads: self.threads,
            open_files: self.open_files,
            stop: self.stop.clone(),
            databases: self.databases.clone(),
        }
    }
}

impl std::fmt::Debug for RenderEnvironment {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RenderEnvironment")
            .field("registry", &self.registry)
            .field("threads", &self.threads)
            .finish_non_exhaustive()
    }
}
