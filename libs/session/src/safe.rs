//! The files that a run with [`SessionOptions::safe`] may open.

use crate::SessionOptions;
use granita_base::{Confinement, Files, SearchPath};
use granita_image::Limits;
use granita_scene::attribute::{Key, scope};
use granita_scene::{State, attr};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Extensions of the textures, shadow maps, databases and logs that scenes write besides images.
const ENDINGS: [&str; 9] = ["tx", "tex", "env", "shd", "sm", "vsm", "sdb", "log", "txt"];

/// Search paths whose folders the user may have set in startup files.
const PATHS: [Key<scope::Global, Arc<str>>; 5] =
    [attr::PATH_INPUT, attr::PATH_TEXTURE, attr::PATH_SHADER, attr::PATH_GENERATOR, attr::PATH_IMAGEIO];

/// Returns the rules for the scene files of `options`. Scenes are read beneath their folders and `$GELATOHOME`. They
/// write beneath [`SessionOptions::safe_output`], or beneath a folder beside the last of them with a derived name, such
/// as `a.out` for `a.pyg`. Files of the command line may be written anywhere.
pub(crate) fn files(options: &SessionOptions) -> Files {
    let scenes: Vec<PathBuf> =
        options.scene_files.iter().map(PathBuf::from).filter(|path| path.is_file()).collect();
    let folder = |file: &Path| match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    };
    let last = scenes.last();
    let (beside, stem) = match last {
        Some(file) => (folder(file), file.file_stem().unwrap_or_default().to_os_string()),
        None => (PathBuf::from("."), "stdin".into()),
    };
    let mut name = stem;
    name.push(".out");
    let scene = last.and_then(|file| std::fs::canonicalize(file).ok());
    let formats = granita_plugin::bundled_formats(Limits::default());
    let written = formats.formats().iter().filter(|format| format.supports("write"));
    let endings = written.flat_map(|format| format.extensions().iter().copied()).chain(ENDINGS);
    let home = options.run.environment.get("GELATOHOME").filter(|home| !home.is_empty()).map(PathBuf::from);
    let moved = options.run.environment.files().moved().cloned();
    let files = Files::confined(Confinement {
        scene: scene
            .map_or("<stdin>".to_owned(), |path| path.to_string_lossy().replace(['\t', '\n', '\r'], "?")),
        read: scenes.iter().map(|file| folder(file)).chain(home).collect(),
        write: Some(absolute(options.safe_output.clone().unwrap_or_else(|| beside.join(name)))),
        extensions: endings.map(str::to_owned).collect(),
    });
    let files = match moved {
        Some(moved) => {
            // All files of a packed scene are in its folder.
            files.add_root(Path::new("."));
            files.with_moved(moved)
        }
        None => files,
    };
    scenes.iter().for_each(|file| files.grant(file));
    options.startup_files.iter().flatten().for_each(|file| files.grant(file));
    for path in options.extra_outputs.iter().map(|output| Path::new(&output.name)) {
        files.grant_output(path);
        if options.keep_partial {
            files.grant_output(&granita_render::partial_path(path));
        }
    }
    for variable in ["GELATOHOME", "HOME"] {
        if let Some(folder) = options.run.environment.get(variable) {
            files.grant(&Path::new(folder).join(".gelato.pyg"));
        }
    }
    files
}

/// Returns the path relative to the root, so that the folder stays the same when the current folder changes.
fn absolute(path: PathBuf) -> PathBuf {
    std::path::absolute(&path).unwrap_or(path)
}

/// Permits scenes to read beneath the absolute folders of the search paths that startup files have set.
pub(crate) fn add_search_paths(options: &SessionOptions, state: &State) {
    let files = options.run.environment.files();
    for key in PATHS {
        let path = SearchPath::parse(&key.ask(state), &SearchPath::default(), &options.run.environment);
        path.folders().iter().filter(|f| f.is_absolute()).for_each(|f| files.add_root(f));
    }
}
