//! The inputs of shading from outside of the scene.

use granita_base::{Reporter, SearchPath};
use granita_gsl::ValidModule;
use granita_image::FormatRegistry;
use granita_sdb::Databases;
use granita_shade::{NativeCompiler, Shadeop};
use granita_trace::Accelerator;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Finds compiled shaders by name.
pub trait ShaderLibrary: Send + Sync {
    /// Returns the shader called `name` (without extension).
    ///
    /// # Errors
    /// See [`NoShader`].
    fn load(&self, name: &str) -> Result<ValidModule, NoShader>;

    /// Returns the C++ function that a shader calls. `text` is the description that the compiler left for it
    /// (`granita_gsl::ShadeopCall`).
    ///
    /// # Errors
    /// Returns the reason why the function is not available.
    fn shadeop(&self, text: &str) -> Result<Arc<dyn Shadeop>, String> {
        Err(format!("shadeop {text}: this program loads no shadeops"))
    }

    /// Returns the compiler for code through which many points run. By default there is none.
    fn native(&self) -> Option<&dyn NativeCompiler> {
        None
    }

    /// Returns the processor that traces large batches of rays for the shaders. By default it is the CPU alone.
    fn accelerator(&self) -> Option<Arc<dyn Accelerator>> {
        None
    }
}

/// The reason why a name has no usable shader.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NoShader {
    /// No shader has that name. The text lists the searched places, as in `looked in a, b`. The caller reports it
    /// to the user.
    Missing(String),
    /// The shader exists, but it cannot be read or compiled. The error was already reported to the user.
    Broken,
}

/// Compiled shaders in memory, by name.
impl ShaderLibrary for BTreeMap<String, ValidModule> {
    fn load(&self, name: &str) -> Result<ValidModule, NoShader> {
        self.get(name).cloned().ok_or_else(|| NoShader::Missing("no folder was searched".to_owned()))
    }
}

/// All inputs of shading from outside of the scene.
#[derive(Clone)]
pub struct ShadingEnvironment {
    /// The image formats of textures.
    pub registry: FormatRegistry,
    /// The library of compiled shaders.
    pub shaders: Arc<dyn ShaderLibrary>,
    /// The search path of textures and databases.
    pub texture_path: SearchPath,
    /// Receives messages.
    pub reporter: Reporter,
    /// The number of threads that build ray structures. 0 takes "limits:threads" of the scene.
    pub threads: usize,
    /// The number of files that the process may have open at once; `None` when there is no limit.
    pub open_files: Option<usize>,
    /// Set by the caller to stop all shaders. Their results are then discarded.
    pub stop: Arc<AtomicBool>,
    /// The spatial databases. Records saved in one frame are available in the next one.
    pub databases: Arc<Databases>,
}
