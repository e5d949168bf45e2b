//! What a session is told by whoever runs it.

use granita_base::{Environment, Supervisor};
use granita_plugin::PluginRules;
use std::path::PathBuf;
use std::sync::Arc;

/// An image in addition to the scene's own (`-o`).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExtraOutput {
    /// File name; its extension names the format unless `format` does. In the format "iv", the name of the picture.
    pub name: String,
    /// Image format; `None` for the one that the extension belongs to.
    pub format: Option<String>,
    /// "rgba", "first" for what the scene's first output shows, "all" for what each of them shows (written beside
    /// each other, as `name-1.ext`; in the format "iv" as pictures of their own names), or anything that `Output` takes.
    pub data: String,
}

/// The suite's own tools, all in one program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OwnTools {
    /// Runs any of them as `program --as NAME ARGUMENT ...`.
    pub program: PathBuf,
    /// Names that mean this program rather than whatever `PATH` has under them.
    pub names: Vec<String>,
}

/// Finds a viewer for pictures of the format "iv": its address, or why there is none.
pub type FindViewer = dyn Fn() -> Result<String, String> + Send + Sync;

/// Where pictures of the format "iv" go that do not say so themselves. Asked when the first one is made.
#[derive(Clone, Default)]
pub struct Viewer(pub Option<Arc<FindViewer>>);

impl std::fmt::Debug for Viewer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Viewer").field(&self.0.is_some()).finish()
    }
}

/// Everything that a session takes from outside.
#[derive(Clone, Debug, Default)]
pub struct SessionOptions {
    /// Variables: `GELATOHOME`, `HOME`, `PYG_...`, and whatever search paths name.
    pub environment: Environment,
    /// Variables that programs started by the scene get in addition to those of this process.
    pub program_environment: Vec<(String, String)>,
    /// Standard output belongs to somebody else: what programs started by the scene print goes to standard error.
    pub programs_print_to_stderr: bool,
    /// The suite's own tools: what their names mean when a scene runs a program.
    pub own_tools: Option<OwnTools>,
    /// Threads to render with; 0 leaves it to the scene ("limits:threads").
    pub threads: usize,
    /// The number of files that the process may have open at once; `None` when there is no limit. Textures leave some of
    /// them for everything else.
    pub open_files: Option<usize>,
    /// Fixes the verbosity; `None` leaves it to the scene.
    pub verbosity: Option<u8>,
    /// Least "statistics:level".
    pub statistics: i32,
    /// Replaces the crop window of every camera.
    pub crop: Option<[f32; 4]>,
    /// Preview mode of every camera, when not 0: stands for "shadingquality".
    pub preview: f32,
    /// Replaces "shadertype" of every camera.
    pub shadertype: Option<String>,
    /// Images in addition to the scene's.
    pub extra_outputs: Vec<ExtraOutput>,
    /// Where pictures of the format "iv" go; without it, to one that listens on the usual port of this machine.
    pub viewer: Viewer,
    /// Do not read `$GELATOHOME/.gelato.pyg` and `$HOME/.gelato.pyg` first.
    pub no_startup_files: bool,
    /// For scenes from strangers: refuses scripts, programs and plugins, reads beneath the folders of the scene files, of
    /// `$GELATOHOME` and of the user's search paths only, and writes beneath one folder only (see
    /// [`granita_base::Confinement`]).
    pub safe: bool,
    /// Plugins that the user named: libraries, and folders of them (`-plugins`).
    pub plugins: Vec<PathBuf>,
    /// Generators and shader functions that a scene names are also taken from relative folders of search paths.
    pub plugins_from_current_folder: bool,
    /// The folder for what a scene writes under `safe`; by default one beside the scene, `a.out` for `a.pyg`.
    pub safe_output: Option<PathBuf>,
    /// Knows what the session is busy with, and the processes that it started.
    pub supervisor: Supervisor,
    /// Scene files as the user named them, for messages.
    pub scene_files: Vec<String>,
    /// Machines that share the work on each frame ("net:workers"), "local" for this one; empty leaves it to the scene.
    pub net_workers: Vec<String>,
    /// The command line of `gelato`, without what concerns the net, from which a worker gets the same scene; `None` when
    /// it cannot get it, as from a pipe.
    pub net_arguments: Option<Vec<String>>,
}

impl SessionOptions {
    /// Which plugins may be loaded.
    pub(crate) fn plugin_rules(&self) -> PluginRules {
        PluginRules {
            none: self.safe,
            named: self.plugins.clone(),
            current_folder: self.plugins_from_current_folder,
        }
    }
}
