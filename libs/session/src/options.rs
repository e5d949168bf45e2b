//! The options of a session.

use crate::looking::LookOptions;
use crate::passes::PassOptions;
use crate::secret::NetSecret;
use granita_base::Param;
use granita_inputs::RunOptions;
use granita_trace::Accelerator;
use std::path::PathBuf;
use std::sync::Arc;

/// An image in addition to the scene's own (`-o`).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExtraOutput {
    /// The file name, whose extension selects the format unless `format` does. For the format "iv", it is the name of
    /// the image.
    pub name: String,
    /// The image format; `None` for the one of the extension.
    pub format: Option<String>,
    /// The data of the image. "first" takes that of the scene's first output. "all" makes an image for each output,
    /// written as `name-1.ext` and so on, or for the format "iv" as images of their own names. Any other value, such as
    /// "rgba", is data of `Output`.
    pub data: String,
}

/// Finds a viewer for images of the format "iv". Returns its address, or the reason why there is none.
pub type FindViewer = dyn Fn() -> Result<String, String> + Send + Sync;

/// The viewer of images of the format "iv" that do not name one. It is called when the first such image is made.
#[derive(Clone, Default)]
pub struct Viewer(pub Option<Arc<FindViewer>>);

impl std::fmt::Debug for Viewer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Viewer").field(&self.0.is_some()).finish()
    }
}

/// All inputs of a session from outside.
#[derive(Clone, Debug, Default)]
pub struct SessionOptions {
    /// What the session takes from its process.
    pub run: RunOptions,
    /// The current folder for relative names, for workers on other machines; empty when it is not known.
    pub current_folder: PathBuf,
    /// The number of threads to render with. 0 takes "limits:threads" of the scene.
    pub threads: usize,
    /// The number of threads to render with when `threads` is 0 and the scene does not set "limits:threads". 0 counts
    /// as 1.
    pub default_threads: usize,
    /// The number of files that the process may have open at once; `None` when there is no limit. Textures use only
    /// a part of them.
    pub open_files: Option<usize>,
    /// The verbosity; `None` takes that of the scene.
    pub verbosity: Option<u8>,
    /// The lower limit of "statistics:level".
    pub statistics: i32,
    /// Attributes that replace those of the scene, wherever it sets them (see [`granita_scene::attribute_from_text`]).
    pub set: Vec<Param>,
    /// Replaces the crop window of every camera with xmin, xmax, ymin, ymax, as fractions of the image.
    pub crop: Option<[f32; 4]>,
    /// The preview mode of every camera, which replaces "shadingquality" when not 0.
    pub preview: f32,
    /// Replaces "shadertype" of every camera.
    pub shadertype: Option<String>,
    /// Images in addition to the scene's.
    pub extra_outputs: Vec<ExtraOutput>,
    /// True when these are all images. Those that the renderer makes for itself (shadow maps on demand) stay.
    pub only_extra_outputs: bool,
    /// True when the images of frames that are ended early are kept as partial ones (see
    /// [`granita_render::partial_path`]).
    pub keep_partial: bool,
    /// The viewer of images of the format "iv"; by default the one at the standard port of this machine.
    pub viewer: Viewer,
    /// True to skip `$GELATOHOME/.gelato.pyg` and `$HOME/.gelato.pyg`.
    pub no_startup_files: bool,
    /// The files that are read instead of these two, in a packed scene.
    pub startup_files: Option<Vec<PathBuf>>,
    /// True when workers that joined connect again at the end, because another coordinator is going to listen at the
    /// same address.
    pub net_stays: bool,
    /// The folder for files that a scene writes under [`RunOptions::safe`]. The default is a folder beside the scene,
    /// such as `a.out` for `a.pyg`.
    pub safe_output: Option<PathBuf>,
    /// Scene files as the user named them, for messages.
    pub scene_files: Vec<String>,
    /// The number of the frame, which replaces `$frame` in the texts of scene files (see
    /// [`granita_farm::with_frame`]).
    pub number: Option<i32>,
    /// How objects without a frame are shown (see [`crate::Session::look`]).
    pub look: LookOptions,
    /// Lists of machines and ports that share the work on each frame ("net:workers"). Without a list, those of the
    /// scene are taken.
    pub net_workers: Vec<String>,
    /// The secret of workers that connect by themselves; `None` without one.
    pub net_secret: Option<NetSecret>,
    /// The command line of `gelato`, without options of the network, from which a worker gets the same scene;
    /// `None` when that is not possible, as with a pipe.
    pub net_arguments: Option<Vec<String>>,
    /// True to compile code of shaders through which many points run to machine code, with the C compiler of the
    /// system. Pixels do not depend on it.
    pub native: bool,
    /// The processor that traces large batches of rays; `None` for the CPU alone. Pixels do not depend on it.
    pub accelerator: Option<Arc<dyn Accelerator>>,
    /// The passes of frames.
    pub passes: PassOptions,
    /// True when the noise of images is removed ("render:denoise").
    pub denoise: bool,
    /// True when each frame of a scene with "rerender" is rendered anew, so that its pixels can be compared with those
    /// of a re-render.
    pub rerenders_anew: bool,
}
