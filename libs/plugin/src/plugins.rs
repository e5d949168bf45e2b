//! Finds plugins, and keeps those that were found.

use crate::dso::Dso;
use crate::generator::{PluginGenerator, ProgramGenerator};
use crate::images::PluginFormat;
use crate::interface::GeneratorObject;
use crate::rules::PluginRules;
use granita_base::{Location, Reporter, SearchPath, Severity};
use granita_image::{Format, FormatFinder};
use granita_scene::Generator;
use parking_lot::{Mutex, RwLock};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The kind of plugin in a file, which determines the name of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Image,
    Generator,
    Color,
}

impl Kind {
    fn suffix(self) -> &'static str {
        match self {
            Self::Image => ".imageio",
            Self::Generator => ".generator",
            Self::Color => ".color",
        }
    }
}

/// Returns the extensions of shared libraries, which are "so" everywhere and the system's own extension.
pub(crate) fn endings() -> Vec<&'static str> {
    let own = std::env::consts::DLL_EXTENSION;
    if own == "so" { vec!["so"] } else { vec![own, "so"] }
}

/// The plugins of one session. Clones share the plugins that were found. The search starts when a plugin is first
/// needed.
#[derive(Clone)]
pub struct Plugins(Arc<Inner>);

/// Makes the format of an image at an address of another process.
pub type ProgramImages = Arc<dyn Fn(usize) -> Arc<dyn Format> + Send + Sync>;

struct Inner {
    reporter: Reporter,
    rules: PluginRules,
    debug: AtomicBool,
    image_path: RwLock<SearchPath>,
    images: Mutex<BTreeMap<PathBuf, Option<Arc<PluginFormat>>>>,
    generators: Mutex<BTreeMap<PathBuf, Option<Arc<PluginGenerator>>>>,
    granted: Mutex<BTreeSet<usize>>,
    program_images: RwLock<Option<ProgramImages>>,
    kept: Mutex<BTreeMap<Arc<str>, Arc<dyn Generator>>>,
    loaded: Mutex<BTreeSet<PathBuf>>,
    number: AtomicU64,
}

impl std::fmt::Debug for Plugins {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Plugins({})", self.0.images.lock().len() + self.0.generators.lock().len())
    }
}

impl Plugins {
    /// Returns plugins of which none is found yet. `rules` decide which may be loaded.
    pub fn new(reporter: Reporter, rules: PluginRules) -> Self {
        Self(Arc::new(Inner {
            reporter,
            rules,
            debug: AtomicBool::new(false),
            image_path: RwLock::default(),
            images: Mutex::default(),
            generators: Mutex::default(),
            granted: Mutex::default(),
            program_images: RwLock::default(),
            kept: Mutex::default(),
            loaded: Mutex::default(),
            number: AtomicU64::new(0),
        }))
    }

    /// Sets the folders of image formats ("path:imageio").
    pub fn set_image_path(&self, path: SearchPath) {
        *self.0.image_path.write() = path;
    }

    /// Reports every file that is tried ("debug:dso").
    pub fn set_debug(&self, on: bool) {
        self.0.debug.store(on, Ordering::Relaxed);
    }

    /// Permits `Output` to name the `ImageOutput` at the address of a format like "0x7f00".
    ///
    /// # Safety
    /// There is an `ImageOutput` of `imageio.h`, and it exists until the session ends or renders no more.
    pub unsafe fn grant(&self, format: &str) {
        if let Some(address) = address(format) {
            self.0.granted.lock().insert(address);
        }
    }

    /// Sets the program to be another process. Addresses in an `Output` are then of that process, which decides
    /// what it permits.
    pub fn set_program_images(&self, make: ProgramImages) {
        *self.0.program_images.write() = Some(make);
    }

    /// Revokes the permissions of [`Plugins::grant`].
    pub fn revoke_all(&self) {
        self.0.granted.lock().clear();
    }

    /// Returns the generator `name` if it has precedence over bundled ones. A program passed it, or the user named its
    /// library.
    pub fn preferred_generator(&self, name: &str) -> Option<Arc<dyn Generator>> {
        if let Some(kept) = self.0.kept.lock().get(name) {
            return Some(kept.clone());
        }
        self.generator_in(self.named(Kind::Generator, name)?)
    }

    /// Returns the generator `name` in the folders of `path`, for a name that no bundled generator has.
    pub fn generator(&self, name: &str, path: &SearchPath) -> Option<Arc<dyn Generator>> {
        self.generator_in(self.find(Kind::Generator, name, path)?)
    }

    fn generator_in(&self, file: PathBuf) -> Option<Arc<dyn Generator>> {
        if let Some(known) = self.0.generators.lock().get(&file) {
            return known.clone().map(|g| g as Arc<dyn Generator>);
        }
        let made = self.load(&file, PluginGenerator::new, Severity::Error).map(Arc::new);
        self.0.generators.lock().insert(file, made.clone());
        made.map(|g| g as Arc<dyn Generator>)
    }

    /// Reports a file, if that is requested.
    pub(crate) fn tell(&self, file: &Path, what: &str) {
        if self.0.debug.load(Ordering::Relaxed) {
            let text = format!("dso: {}: {what}\n", file.display());
            self.0.reporter.say(Severity::Message, &Location::default(), text);
        }
    }

    pub(crate) fn rules(&self) -> &PluginRules {
        &self.0.rules
    }

    /// Reports that a folder of a search path is skipped.
    pub(crate) fn tell_passed_over(&self, folder: &Path) {
        self.tell(folder, "skipped: a relative folder is used only when -plugins names it");
    }

    /// Keeps a program's generator until it is needed. Returns the name by which [`Plugins::generator`] finds it.
    pub fn keep_generator(&self, object: GeneratorObject) -> Arc<str> {
        self.keep(Arc::new(ProgramGenerator::new(object)))
    }

    fn keep(&self, generator: Arc<dyn Generator>) -> Arc<str> {
        let name: Arc<str> = format!("<generator-{}>", self.0.number.fetch_add(1, Ordering::Relaxed)).into();
        self.0.kept.lock().insert(name.clone(), generator);
        name
    }

    /// Returns the library of the plugin for conversions of colours, in the folders of image formats.
    pub(crate) fn color_file(&self) -> Option<PathBuf> {
        self.find(Kind::Color, "opencolorio", &self.image_path())
    }

    /// Returns the library of a plugin of this name that the user named.
    fn named(&self, kind: Kind, name: &str) -> Option<PathBuf> {
        let ends = endings();
        let is_it = |file: &str| ends.iter().any(|end| file == format!("{name}{}.{end}", kind.suffix()));
        let file = self.0.rules.libraries(is_it).filter(|_| !self.0.rules.none)?;
        self.tell(&file, "named by -plugins");
        Some(file)
    }

    /// Returns the library of a plugin of this name.
    fn find(&self, kind: Kind, name: &str, path: &SearchPath) -> Option<PathBuf> {
        if self.0.rules.none || name.is_empty() || name.contains(['/', '\\', '\0']) {
            return None;
        }
        if let Some(file) = self.named(kind, name) {
            return Some(file);
        }
        for (folder, counts) in self.0.rules.folders(path.folders(), kind == Kind::Generator) {
            if !counts {
                self.tell_passed_over(folder);
                continue;
            }
            for ending in endings() {
                let file = folder.join(format!("{name}{}.{ending}", kind.suffix()));
                if self.0.rules.is_file(&file) {
                    self.tell(&file, "found");
                    return Some(file);
                }
                self.tell(&file, "does not exist");
            }
        }
        None
    }

    /// Returns the plugin of a file. A reason why it cannot be used is reported once.
    pub(crate) fn load<T>(
        &self,
        file: &Path,
        make: impl FnOnce(&'static Dso) -> Result<T, String>,
        severity: Severity,
    ) -> Option<T> {
        match Dso::load(&self.0.rules.files.place(file))
            .map_err(|e| format!("it cannot be loaded: {e}"))
            .and_then(make)
        {
            Ok(made) => {
                self.tell(file, "loaded");
                self.0.reporter.file_read(file);
                self.0.loaded.lock().insert(file.to_owned());
                Some(made)
            }
            Err(why) => {
                self.tell(file, &format!("refused: {why}"));
                let text = format!("plugin {} is not used: {why}", file.display());
                self.0.reporter.once(
                    &format!("plugin {}", file.display()),
                    severity,
                    &Location::default(),
                    text,
                );
                None
            }
        }
    }

    /// Returns the libraries that were loaded so far, by the names under which they were found.
    pub fn loaded(&self) -> Vec<PathBuf> {
        self.0.loaded.lock().iter().cloned().collect()
    }

    fn image(&self, file: &Path, severity: Severity) -> Option<Arc<PluginFormat>> {
        if let Some(known) = self.0.images.lock().get(file) {
            return known.clone();
        }
        let made = self.load(file, PluginFormat::new, severity).map(Arc::new);
        self.0.images.lock().insert(file.to_owned(), made.clone());
        made
    }

    fn image_path(&self) -> SearchPath {
        self.0.image_path.read().clone()
    }

    /// Returns all image plugins, by folder and name.
    fn images(&self) -> Vec<Arc<PluginFormat>> {
        let mut files = Vec::new();
        if !self.0.rules.none {
            let ends: Vec<String> =
                endings().iter().map(|e| format!("{}.{e}", Kind::Image.suffix())).collect();
            let is_image = |path: &&PathBuf| {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                self.0.rules.is_file(path) && ends.iter().any(|end| name.ends_with(end))
            };
            files.extend(self.0.rules.named.iter().filter(is_image).cloned());
            let path = self.image_path();
            for (folder, counts) in self.0.rules.folders(path.folders(), false) {
                if !counts {
                    self.tell_passed_over(folder);
                    continue;
                }
                let Some(entries) = self.0.rules.entries(folder) else {
                    self.tell(folder, "is not a folder that can be read");
                    continue;
                };
                let mut here: Vec<PathBuf> = entries.into_iter().filter(|path| is_image(&path)).collect();
                here.sort();
                files.extend(here);
            }
        }
        files.iter().filter_map(|file| self.image(file, Severity::Warning)).collect()
    }
}

/// Returns the address in a format such as "0x7f00".
fn address(format: &str) -> Option<usize> {
    usize::from_str_radix(format.strip_prefix("0x")?.trim_start_matches("0x"), 16).ok().filter(|a| *a != 0)
}

impl Plugins {
    /// Returns the image plugin of exactly this name.
    pub(crate) fn image_named(&self, name: &str) -> Option<Arc<PluginFormat>> {
        self.image(&self.find(Kind::Image, name, &self.image_path())?, Severity::Error)
    }

    /// Returns the first image plugin that lists the extension.
    pub(crate) fn image_listed(&self, extension: &str, writes: bool) -> Option<Arc<PluginFormat>> {
        self.images().into_iter().find(|f| !extension.is_empty() && f.lists(extension, writes))
    }
}

impl FormatFinder for Plugins {
    fn preferred(&self, name: &str) -> Option<Arc<dyn Format>> {
        let file = self.named(Kind::Image, name)?;
        self.image(&file, Severity::Error).map(|f| f as Arc<dyn Format>)
    }

    fn named(&self, name: &str) -> Option<Arc<dyn Format>> {
        if let Some(address) = address(name) {
            let elsewhere = self.0.program_images.read();
            if let Some(make) = &*elsewhere {
                return Some(make(address));
            }
            let granted = self.0.granted.lock().contains(&address);
            return granted.then(|| Arc::new(PluginFormat::in_program(address)) as Arc<dyn Format>);
        }
        self.image_named(name).map(|f| f as Arc<dyn Format>)
    }

    fn listed(&self, extension: &str, writes: bool) -> Option<Arc<dyn Format>> {
        self.image_listed(extension, writes).map(|f| f as Arc<dyn Format>)
    }

    fn readers(&self) -> Vec<Arc<dyn Format>> {
        self.images().into_iter().filter(|f| f.reads()).map(|f| f as Arc<dyn Format>).collect()
    }
}
