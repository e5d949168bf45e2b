//! What a run takes from its process.

use granita_base::{Environment, Supervisor};
use granita_plugin::PluginRules;
use std::path::PathBuf;

/// The suite's own tools, all in one program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OwnTools {
    /// Runs any of them as `program --as NAME ARGUMENT ...`.
    pub program: PathBuf,
    /// The names that run this program, even when `PATH` contains other programs of these names.
    pub names: Vec<String>,
}

/// What a run takes from its process, and what scenes may use of it.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// The variables: `GELATOHOME`, `HOME`, `PYG_...`, and those of search paths. They hold the object that opens
    /// files.
    pub environment: Environment,
    /// Variables that programs started by the scene get in addition to those of this process.
    pub program_environment: Vec<(String, String)>,
    /// True when standard output has another use. Output of programs that the scene starts then goes to standard
    /// error.
    pub programs_print_to_stderr: bool,
    /// The suite's own tools, which take precedence when a scene runs a program by name.
    pub own_tools: Option<OwnTools>,
    /// True for untrusted scenes. Scripts, programs and plugins are refused. Files are read only beneath the
    /// folders of the scene files, of `$GELATOHOME` and of the user's search paths, and written only beneath one
    /// folder (see [`granita_base::Confinement`]).
    pub safe: bool,
    /// Plugins that the user named (`-plugins`), which are libraries or folders of libraries.
    pub plugins: Vec<PathBuf>,
    /// True when generators and shader functions that a scene names may also come from relative folders of search
    /// paths.
    pub plugins_from_current_folder: bool,
    /// Tracks the work of the run and the processes that it started.
    pub supervisor: Supervisor,
}

impl RunOptions {
    /// Returns the rules for loading plugins.
    pub fn plugin_rules(&self) -> PluginRules {
        PluginRules {
            none: self.safe,
            named: self.plugins.clone(),
            current_folder: self.plugins_from_current_folder,
            files: self.environment.files().clone(),
        }
    }
}
