//! The files that a scene needs, found without rendering it.

use granita_base::{Environment, Files, Param, ParamData, Params, Reporter, SearchPath};
use granita_gsl::ShadeopCall;
use granita_gsl::ir::{ConstValue, SymbolKind};
use granita_image::FormatRegistry;
use granita_inputs::Input;
use granita_plugin::Plugins;
use granita_render::ShaderLibrary;
use granita_scene::{Scene, ShaderGroup, attr};
use granita_texture::UdimName;
use parking_lot::Mutex;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What comes before the name of an input among commands.
pub(crate) const INPUT: &str = "Input ";

/// The longest text that may be the name of a file.
const LONGEST: usize = 4096;

/// The endings of names that are surely names of files.
const ENDINGS: [&str; 13] =
    ["tx", "tex", "env", "shd", "sm", "vsm", "sdb", "exr", "tif", "tiff", "png", "jpg", "hdr"];

/// The files that a scene reads and writes.
///
/// Scenes, shaders, their included files, and plugins are complete. Files that programs and plugins open are known
/// where a command line or an argument names them, and those of scripts where they are opened in the frame. Textures,
/// maps and databases are found by texts: every text of a shader, of its parameters, and of attributes and primitives
/// that is the name of a file on "path:texture" counts. A name that a shader computes is not found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Assets {
    /// The files that are read, and what they are.
    pub read: BTreeMap<PathBuf, AssetKind>,
    /// The texts that are names of textures, maps and databases by their ending, but of no file that exists.
    pub missing: BTreeSet<String>,
    /// The images that are written, as the scene names them.
    pub written: BTreeSet<PathBuf>,
    /// The commands of the scene, which were not run, and the inputs that are the output of a program, as "Input NAME".
    pub commands: Vec<String>,
}

impl Assets {
    /// Adds an input to the commands when it is the output of a program.
    pub(crate) fn add_program(&mut self, command: &str, input: &Input) {
        let line = format!("{INPUT}{}", command.trim());
        if input.program().is_some() && !self.commands.contains(&line) {
            self.commands.push(line);
        }
    }

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
    /// A library of image formats, generators or functions of shaders.
    Plugin,
    /// A file or a module that a script of the scene opened by itself.
    Script,
    /// A program of the scene, or another file that the line of a command names.
    Program,
    /// A texture, a map, a database, or another file that shaders name.
    Texture,
}

impl AssetKind {
    /// Returns the name of the kind.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scene => "scene",
            Self::Shader => "shader",
            Self::Plugin => "plugin",
            Self::Script => "script",
            Self::Program => "program",
            Self::Texture => "texture",
        }
    }
}

/// The list of the files of a scene, when they are listed instead of rendered.
pub(crate) type Listing = Arc<Mutex<Option<Listed>>>;

/// A list of files, and what belongs to it.
#[derive(Clone)]
pub(crate) struct Listed {
    pub(crate) assets: Arc<Mutex<Assets>>,
    /// True when inputs are read that no frame needs, because their files must exist.
    pub(crate) all_inputs: bool,
}

/// What the files of a frame are found with.
pub(crate) struct Sources<'a> {
    pub(crate) shaders: &'a dyn ShaderLibrary,
    /// The folders of "path:texture".
    pub(crate) textures: &'a SearchPath,
    pub(crate) registry: &'a FormatRegistry,
    pub(crate) plugins: &'a Plugins,
    pub(crate) variables: &'a Environment,
    pub(crate) reporter: &'a Reporter,
    /// The files that scripts opened.
    pub(crate) opened: Vec<PathBuf>,
}

/// Adds the files of a frame. The files that were read so far are those of the scene.
pub(crate) fn collect(scene: &Scene, sources: Sources<'_>, assets: &mut Assets) {
    let Sources { shaders, textures, registry, plugins, variables, reporter, opened } = sources;
    let files = variables.files();
    // A program may be read as a scene as well. What is known first counts.
    let words: Vec<PathBuf> = assets.commands.iter().flat_map(|line| named_files(line, variables)).collect();
    for file in words {
        assets.read.entry(file).or_insert(AssetKind::Program);
    }
    for file in opened.into_iter().filter(|file| files.is_file(file)) {
        assets.read.entry(file).or_insert(AssetKind::Script);
    }
    let add_plugins = |assets: &mut Assets| {
        for file in plugins.loaded() {
            assets.read.insert(plain(&file), AssetKind::Plugin);
        }
    };
    add_plugins(assets);
    for file in reporter.files_read() {
        assets.read.entry(file).or_insert(AssetKind::Scene);
    }
    for output in &scene.outputs {
        let is_file = &*output.format != "iv" && !output.name.is_empty() && !output.get(attr::DYNAMIC);
        if is_file {
            assets.written.insert(PathBuf::from(&*output.name));
            // This loads the plugin of the format. An unknown format is reported by frames.
            let _ = registry.by_name(&output.format);
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
                // This loads the library. A function that is missing is reported by frames.
                let functions = texts.iter().filter(|text| ShadeopCall::parse(text).is_some());
                functions.for_each(|text| drop(shaders.shadeop(text)));
            }
        }
    }
    for file in found.files.iter().filter(|file| files.is_file(file)) {
        load_reader(file, registry);
    }
    add_plugins(assets);
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

/// Returns a name as files that are read are listed.
fn plain(path: &Path) -> PathBuf {
    path.strip_prefix(".").unwrap_or(path).to_owned()
}

/// Loads the plugin that reads an image, if one does.
fn load_reader(file: &Path, registry: &FormatRegistry) {
    let ending = file.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    if ending != "sdb" && registry.by_name(&ending).is_none() {
        // Only its contents may say which plugin it is. One that no plugin reads is reported by frames.
        let _ = registry.open(file);
    }
}

/// Returns the files that the words of a command line name, with their variables replaced.
fn named_files(line: &str, variables: &Environment) -> Vec<PathBuf> {
    // The words of an input are those of a generator. A program follows "<".
    let line =
        line.strip_prefix(INPUT).map_or(line, |input| input.split_once('<').map_or("", |(_, line)| line));
    let line = variables.expand(line);
    let words = line.split(|c: char| c.is_whitespace() || "\"'`;|&<>()=,".contains(c));
    let words = words.filter(|word| !word.is_empty() && word.len() <= LONGEST);
    let files = words.map(|word| plain(Path::new(word)));
    files.filter(|file| !file.starts_with("/dev") && variables.files().is_file(file)).collect()
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
