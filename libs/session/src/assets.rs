//! The files that a scene needs, found without rendering it.

use granita_base::{Files, Param, ParamData, Params, Reporter, SearchPath};
use granita_gsl::ir::{ConstValue, SymbolKind};
use granita_render::ShaderLibrary;
use granita_scene::{Scene, ShaderGroup, attr};
use granita_texture::UdimName;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The longest text that may be the name of a file.
const LONGEST: usize = 4096;

/// The endings of names that are surely names of files.
const ENDINGS: [&str; 13] =
    ["tx", "tex", "env", "shd", "sm", "vsm", "sdb", "exr", "tif", "tiff", "png", "jpg", "hdr"];

/// The files that a scene reads and writes.
///
/// Scenes, shaders and their included files are complete. Textures, maps and databases are found by texts: every text
/// of a shader, of its parameters, and of attributes and primitives that is the name of a file on "path:texture"
/// counts. A name that a shader computes is not found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Assets {
    /// The files that are read, and what they are.
    pub read: BTreeMap<PathBuf, AssetKind>,
    /// The texts that are names of textures, maps and databases by their ending, but of no file that exists.
    pub missing: BTreeSet<String>,
    /// The images that are written, as the scene names them.
    pub written: BTreeSet<PathBuf>,
    /// The commands of the scene, which were not run.
    pub commands: Vec<String>,
}

impl Assets {
    /// Takes the names of images that the scene itself writes out of those of missing files.
    pub fn forget_made(&mut self) {
        let Self { missing, written, .. } = self;
        missing.retain(|name| !written.iter().any(|path| path.ends_with(name)));
    }
}

/// What a file is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum AssetKind {
    /// A scene, an input, or a file that these read.
    Scene,
    /// A shader, or a file that it includes.
    Shader,
    /// A texture, a map, a database, or another file that shaders name.
    Texture,
}

impl AssetKind {
    /// Returns the name of the kind.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scene => "scene",
            Self::Shader => "shader",
            Self::Texture => "texture",
        }
    }
}

/// Adds the files of a frame. The files that were read so far are those of the scene.
pub(crate) fn collect(
    scene: &Scene,
    shaders: &dyn ShaderLibrary,
    textures: &SearchPath,
    reporter: &Reporter,
    assets: &mut Assets,
) {
    for file in reporter.files_read() {
        assets.read.entry(file).or_insert(AssetKind::Scene);
    }
    for output in &scene.outputs {
        let is_file = &*output.format != "iv" && !output.name.is_empty() && !output.get(attr::DYNAMIC);
        if is_file {
            assets.written.insert(PathBuf::from(&*output.name));
        }
    }
    let mut found =
        Found { textures, names: HashSet::new(), files: BTreeSet::new(), missing: BTreeSet::new() };
    let mut names: BTreeSet<Arc<str>> = BTreeSet::new();
    let mut known = HashSet::new();
    let mut group = |group: &ShaderGroup, found: &mut Found<'_>| {
        for layer in &group.layers {
            names.insert(layer.shader.clone());
            found.params(&layer.params);
        }
    };
    for light in &scene.lights {
        group(&light.group, &mut found);
    }
    for primitive in &scene.primitives {
        let attributes = &primitive.attributes;
        let groups = [&attributes.surface, &attributes.displacement, &attributes.volume];
        for one in groups.into_iter().flatten() {
            if known.insert(Arc::as_ptr(one)) {
                group(one, &mut found);
            }
        }
        primitive.keys.iter().for_each(|key| found.params(&key.params));
        attributes.values.iter().for_each(|(_, param)| found.param(param));
    }
    scene.globals.values().for_each(|param| found.param(param));
    for name in &names {
        // A shader that is missing or broken was reported, as in a frame.
        let Ok(module) = shaders.load(name) else { continue };
        for symbol in &module.symbols {
            if let SymbolKind::Const(ConstValue::Strings(texts)) = &symbol.kind {
                texts.iter().for_each(|text| found.text(text));
            }
        }
    }
    for file in reporter.files_read() {
        assets.read.entry(file).or_insert(AssetKind::Shader);
    }
    for file in found.files {
        assets.read.entry(file).or_insert(AssetKind::Texture);
    }
    assets.missing.extend(found.missing);
    // Maps that the scene itself makes need not exist.
    assets.forget_made();
}

/// The files on a search path that texts name.
struct Found<'a> {
    textures: &'a SearchPath,
    /// The texts that were looked for.
    names: HashSet<Arc<str>>,
    files: BTreeSet<PathBuf>,
    missing: BTreeSet<String>,
}

impl Found<'_> {
    fn params(&mut self, params: &Params) {
        params.iter().for_each(|param| self.param(param));
    }

    fn param(&mut self, param: &Param) {
        if let ParamData::String(texts) = &param.data {
            texts.iter().for_each(|text| self.text(text));
        }
    }

    fn text(&mut self, text: &Arc<str>) {
        if text.is_empty() || text.len() > LONGEST || !self.names.insert(text.clone()) {
            return;
        }
        let opener = self.textures.files();
        let found: Vec<PathBuf> = match UdimName::parse(text) {
            Some(set) => {
                set.names(self.textures).values().filter_map(|name| self.textures.find(name)).collect()
            }
            None => {
                self.textures.find(text).filter(|file| opener.place(file).is_file()).into_iter().collect()
            }
        };
        let ending = text.rsplit_once('.').map(|(_, ending)| ending.to_ascii_lowercase());
        let is_name = ending.is_some_and(|ending| ENDINGS.contains(&&*ending)) && !text.contains(['\n', '*']);
        if is_name && found.is_empty() {
            self.missing.insert(text.to_string());
        }
        self.files.extend(found);
    }
}

/// True when every image exists and is newer than every file that is read. A scene that runs commands, and one without
/// images, never is.
pub fn is_up_to_date(assets: &Assets, files: &Files) -> bool {
    let changed = |path: &Path| std::fs::metadata(files.place(path)).and_then(|data| data.modified()).ok();
    let Some(newest) = assets.read.keys().map(|path| changed(path)).collect::<Option<Vec<_>>>() else {
        return false;
    };
    let Some(newest) = newest.into_iter().max() else { return false };
    let is_newer = |path: &PathBuf| changed(path).is_some_and(|time| time > newest);
    assets.commands.is_empty() && !assets.written.is_empty() && assets.written.iter().all(is_newer)
}
