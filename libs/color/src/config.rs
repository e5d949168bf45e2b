//! Configurations, and the names in them.

mod compile;
mod looks;
mod rules;

use crate::engine::{Conversion, Engine};
use crate::error::ColorError;
use crate::model::{ColorSpace, Model, NamedTransform, View};
use crate::processor::Processor;
use crate::read;
use compile::Compiler;
use granita_base::{Environment, suggestion};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The names of built-in configurations that `ocio://NAME` accepts. All name the same one, which has the spaces of all
/// of them.
pub const BUILT_IN: [&str; 13] = [
    "default",
    "cg-config-latest",
    "cg-config-v1.0.0_aces-v1.3_ocio-v2.1",
    "cg-config-v2.1.0_aces-v1.3_ocio-v2.3",
    "cg-config-v2.2.0_aces-v1.3_ocio-v2.4",
    "cg-config-v4.0.0_aces-v2.0_ocio-v2.5",
    "cg-config-v5.0.0_aces-v2.1_ocio-v2.6",
    "studio-config-latest",
    "studio-config-v1.0.0_aces-v1.3_ocio-v2.1",
    "studio-config-v2.1.0_aces-v1.3_ocio-v2.3",
    "studio-config-v2.2.0_aces-v1.3_ocio-v2.4",
    "studio-config-v4.0.0_aces-v2.0_ocio-v2.5",
    "studio-config-v5.0.0_aces-v2.1_ocio-v2.6",
];

const BUILT_IN_TEXT: &str = include_str!("built_in.ocio");

/// The space that a view names to mean the one with the name of its display.
const DISPLAY_NAME: &str = "<USE_DISPLAY_NAME>";

/// A configuration: colour spaces, roles, displays, views, looks and rules for files.
#[derive(Clone, Debug)]
pub struct Config {
    model: Model,
    /// The name in messages.
    place: String,
    /// The folder of relative names of files.
    folder: PathBuf,
    /// The variables that names of files may contain, and the opener of files.
    environment: Environment,
    /// The library for transforms that this crate does not have.
    engine: Option<Arc<dyn Engine>>,
}

fn misuse<T>(what: String) -> Result<T, ColorError> {
    Err(ColorError::Misuse { what })
}

/// Compares names as configurations do, without regard to upper and lower case.
fn same(a: &str, b: &str) -> bool {
    a.eq_ignore_ascii_case(b)
}

impl Config {
    /// Returns the built-in configuration. It has the colour spaces, aliases and roles of the published configurations
    /// "cg-config" and "studio-config" for ACES of all versions, and their displays with the views "Un-tone-mapped",
    /// "Video (colorimetric)", "Raw", and "ACES 1.0 - SDR Video" or "ACES 1.0 - SDR Cinema" where the range is
    /// standard.
    pub fn built_in() -> Self {
        let model = read::read(BUILT_IN_TEXT, "the built-in configuration");
        Self {
            model: model.expect("the text is tested"),
            place: "the built-in configuration".to_owned(),
            folder: PathBuf::new(),
            environment: Environment::default(),
            engine: None,
        }
    }

    /// Returns the configuration of a name: `ocio://NAME` is a built-in one ([`BUILT_IN`]), anything else is a file.
    /// The environment opens the file and the files that it names, and has the variables that these names may contain.
    ///
    /// # Errors
    /// Returns an error for a name that is not known, and for a file that cannot be read or is damaged.
    pub fn open(name: &str, environment: &Environment) -> Result<Self, ColorError> {
        match name.strip_prefix("ocio://") {
            Some(built_in) if BUILT_IN.contains(&built_in) => Ok(Self::built_in()),
            Some(_) => misuse(format!(
                "\"{name}\" is not a built-in configuration; these are ocio://default, ocio://cg-config-latest, ocio://studio-config-latest, and those of their versions"
            )),
            None => Self::from_file(Path::new(name), environment),
        }
    }

    /// Returns the configuration of a tool: the one that its option `-colorconfig` names, else that of `$OCIO`, else
    /// the built-in one. `engine` makes the conversions that this crate does not support.
    ///
    /// # Errors
    /// Returns a message with the option or the variable, for a configuration that cannot be opened.
    pub fn of_tool(
        option: Option<&str>,
        environment: &Environment,
        engine: Arc<dyn Engine>,
    ) -> Result<Self, String> {
        let variable = environment.get("OCIO").filter(|name| !name.is_empty());
        let (name, source) = match (option, variable) {
            (Some(name), _) => (name, "-colorconfig"),
            (None, Some(name)) => (name, "$OCIO"),
            (None, None) => return Ok(Self::built_in()),
        };
        let found = Self::open(name, environment).map_err(|error| format!("{source}: {error}"))?;
        Ok(found.with_engine(engine))
    }

    /// Returns the configuration of a file.
    ///
    /// # Errors
    /// Returns an error for a file that cannot be read or is damaged.
    pub fn from_file(path: &Path, environment: &Environment) -> Result<Self, ColorError> {
        let io = |source| ColorError::Io { path: path.to_owned(), source };
        let text = environment.files().read_to_string(path).map_err(io)?;
        Self::from_text(&text, path, environment)
    }

    /// Returns the configuration of a text. `path` names it in messages, and its folder is that of relative names.
    ///
    /// # Errors
    /// Returns an error for a text that is damaged.
    pub fn from_text(text: &str, path: &Path, environment: &Environment) -> Result<Self, ColorError> {
        let place = path.display().to_string();
        let model = read::read(text, &place)?;
        // With a list of variables, only these are used. Their values are those of the environment, if it has them.
        let mut variables = environment.clone();
        if !model.variables.is_empty() {
            variables = Environment::default();
            variables.set_files(environment.files().clone());
            for (name, default) in &model.variables {
                variables.set(name, environment.get(name).unwrap_or(default));
            }
        }
        let folder = path.parent().map(Path::to_owned).unwrap_or_default();
        Ok(Self { model, place, folder, environment: variables, engine: None })
    }

    /// Returns the configuration with another library, which makes the conversions that have transforms this crate does
    /// not support.
    #[must_use]
    pub fn with_engine(self, engine: Arc<dyn Engine>) -> Self {
        Self { engine: Some(engine), ..self }
    }

    /// Returns the name that the configuration gives itself; empty where it gives none.
    pub fn name(&self) -> &str {
        &self.model.name
    }

    /// Returns the name of the file, or "the built-in configuration".
    pub fn place(&self) -> &str {
        &self.place
    }

    /// Returns the colour spaces, without those that the configuration makes inactive.
    pub fn color_spaces(&self) -> impl Iterator<Item = &ColorSpace> {
        let is_active = |space: &&ColorSpace| !self.model.inactive.iter().any(|name| same(name, &space.name));
        self.model.spaces.iter().filter(is_active)
    }

    /// Returns the colour space of a name, an alias or a role. Upper and lower case do not matter.
    pub fn color_space(&self, name: &str) -> Option<&ColorSpace> {
        let of = |name: &str| {
            let spaces = &self.model.spaces;
            let named = spaces.iter().find(|space| same(&space.name, name));
            named.or_else(|| spaces.iter().find(|space| space.aliases.iter().any(|alias| same(alias, name))))
        };
        of(name).or_else(|| of(self.role(name)?))
    }

    /// Returns the roles and the names of their colour spaces, in the order of the configuration.
    pub fn roles(&self) -> impl Iterator<Item = (&str, &str)> {
        self.model.roles.iter().map(|(role, space)| (role.as_str(), space.as_str()))
    }

    /// Returns the name of the colour space of a role.
    pub fn role(&self, role: &str) -> Option<&str> {
        self.roles().find(|(name, _)| same(name, role)).map(|(_, space)| space)
    }

    /// Returns the name of the colour space of linear light: that of the role "scene_linear".
    pub fn scene_linear(&self) -> Option<&str> {
        self.role("scene_linear")
    }

    /// Returns the name of a space of linear light in which colours of a space are filtered: the space itself where it
    /// is linear, else the first linear one of the same primaries, else that of the role "scene_linear". `None` for a
    /// space that is not known, for data, and where the configuration has no linear space.
    pub fn linear_for(&self, space: &str) -> Option<&str> {
        let space = self.color_space(space).filter(|space| !space.is_data)?;
        if space.is_linear() {
            return Some(&space.name);
        }
        let is_same_gamut = |other: &&ColorSpace| {
            other.is_linear() && self.processor(&space.name, &other.name).is_ok_and(|p| p.is_separable())
        };
        let found = self.model.spaces.iter().find(is_same_gamut).map(|found| found.name.as_str());
        found.or_else(|| self.color_space(self.scene_linear()?).map(|found| found.name.as_str()))
    }

    /// Returns the names of the looks.
    pub fn looks(&self) -> impl Iterator<Item = &str> {
        self.model.looks.iter().map(|look| look.name.as_str())
    }

    /// Returns the names of the displays, those that the configuration makes active in its order.
    pub fn displays(&self) -> Vec<&str> {
        ordered(
            self.model.displays.iter().map(|display| display.name.as_str()).collect(),
            &self.model.active_displays,
        )
    }

    /// Returns the first display; an empty name where there is none.
    pub fn default_display(&self) -> &str {
        self.displays().first().copied().unwrap_or_default()
    }

    /// Returns the names of the views of a display, those that the configuration makes active in its order.
    pub fn views(&self, display: &str) -> Vec<&str> {
        let Some(display) = self.model.displays.iter().find(|found| same(&found.name, display)) else {
            return Vec::new();
        };
        let own = display.views.iter().map(|view| view.name.as_str());
        let shared = display.shared.iter().map(String::as_str);
        // Those that a display shares come where the configuration lists them.
        let all: Vec<&str> = match self.model.active_views.is_empty() {
            true if self.is_built_in() => shared.chain(own).collect(),
            _ => own.chain(shared).collect(),
        };
        ordered(all, &self.model.active_views)
    }

    /// True for the built-in configuration.
    pub fn is_built_in(&self) -> bool {
        self.folder.as_os_str().is_empty() && self.place == "the built-in configuration"
    }

    /// Returns the first view of a display; an empty name where there is none.
    pub fn default_view(&self, display: &str) -> &str {
        self.views(display).first().copied().unwrap_or_default()
    }

    /// True when a view of a display shows values as they are stored, because its colour space is one of data.
    pub fn shows_data(&self, display: &str, view: &str) -> bool {
        let Ok(found) = self.need_view(display, view) else { return false };
        let space = if found.space == DISPLAY_NAME { display } else { &*found.space };
        self.color_space(space).is_some_and(|space| space.is_data)
    }

    /// Returns the processor from one colour space to another. Names may be aliases, roles and named transforms. Spaces
    /// of data are not converted.
    ///
    /// # Errors
    /// Returns an error for a name that is not known, for a file that cannot be read, and for transforms that are not
    /// supported.
    pub fn processor(&self, from: &str, to: &str) -> Result<Processor, ColorError> {
        let mut compiler = Compiler::new(self);
        compiler.convert(from, to, true)?;
        self.finish(compiler, &Conversion::Spaces { from, to })
    }

    /// Returns the processor from a colour space to a view of a display, with the looks of the view.
    ///
    /// # Errors
    /// Returns the errors of [`Config::processor`], and one for a display or a view that does not exist.
    pub fn display_processor(&self, from: &str, display: &str, view: &str) -> Result<Processor, ColorError> {
        let mut compiler = Compiler::new(self);
        compiler.display(from, display, view)?;
        self.finish(compiler, &Conversion::View { from, display, view })
    }

    /// Returns the processor of looks, such as "grade, -neutral", from one colour space to another.
    ///
    /// # Errors
    /// Returns the errors of [`Config::processor`], and one for a look that does not exist.
    pub fn look_processor(&self, from: &str, to: &str, looks: &str) -> Result<Processor, ColorError> {
        let mut compiler = Compiler::new(self);
        compiler.look(from, to, looks, false)?;
        self.finish(compiler, &Conversion::Looks { from, to, looks })
    }

    /// Returns the processor of the content of a file of tables or of another transform. The extension of `path` is
    /// that of its format.
    ///
    /// # Errors
    /// Returns an error for a file that is damaged, and for transforms that are not supported.
    pub fn bytes_processor(&self, bytes: &[u8], path: &Path) -> Result<Processor, ColorError> {
        let mut compiler = Compiler::new(self);
        compiler.file(bytes, path, None, None, false)?;
        compiler.finish()
    }

    /// Returns the processor of a file of tables or of another transform, which is found on the search path of the
    /// configuration. True for its inverse.
    ///
    /// # Errors
    /// Returns the errors of [`Config::processor`].
    pub fn file_processor(&self, file: &str, inverse: bool) -> Result<Processor, ColorError> {
        let mut compiler = Compiler::new(self);
        compiler.file_transform(file, inverse)?;
        self.finish(compiler, &Conversion::File { path: file, inverse })
    }

    /// Returns the processor of the collected transforms, or of the other library where one is not supported.
    fn finish(&self, compiler: Compiler<'_>, conversion: &Conversion<'_>) -> Result<Processor, ColorError> {
        match (compiler.finish(), &self.engine) {
            (Err(ColorError::Unsupported { place, what }), Some(engine)) if !self.is_built_in() => {
                let found = engine.conversion(&self.place, conversion);
                found.map(Processor::of).map_err(|why| ColorError::Elsewhere { place, what, why })
            }
            (found, _) => found,
        }
    }

    fn named_transform(&self, name: &str) -> Option<&NamedTransform> {
        let is = |found: &&NamedTransform| {
            same(&found.name, name) || found.aliases.iter().any(|alias| same(alias, name))
        };
        self.model.named.iter().find(is)
    }

    /// Returns the colour space of a name.
    fn need_space(&self, name: &str) -> Result<&ColorSpace, ColorError> {
        if let Some(space) = self.color_space(name) {
            return Ok(space);
        }
        let spaces = self.model.spaces.iter();
        let names = spaces.flat_map(|s| std::iter::once(&s.name).chain(&s.aliases)).map(String::as_str);
        let names = names.chain(self.roles().map(|(role, _)| role));
        let near =
            suggestion(name, names).map_or_else(String::new, |near| format!("; did you mean \"{near}\"?"));
        misuse(format!("{} has no colour space \"{name}\"{near}", self.place))
    }

    /// Returns a view of a display.
    fn need_view(&self, display: &str, view: &str) -> Result<&View, ColorError> {
        let Some(found) = self.model.displays.iter().find(|found| same(&found.name, display)) else {
            let names = self.displays().join(", ");
            return misuse(format!("{} has no display \"{display}\"; it has {names}", self.place));
        };
        let own = found.views.iter().find(|found| same(&found.name, view));
        let shared = || {
            let is_shared = found.shared.iter().any(|name| same(name, view));
            self.model.shared_views.iter().find(|found| is_shared && same(&found.name, view))
        };
        if let Some(found) = own.or_else(shared) {
            return Ok(found);
        }
        let names = self.views(display).join(", ");
        let aces = if self.is_built_in() && view.to_ascii_uppercase().starts_with("ACES") {
            "; output transforms of ACES for high dynamic range and of version 2 are not built in"
        } else {
            ""
        };
        misuse(format!("{}: display \"{display}\" has no view \"{view}\"; it has {names}{aces}", self.place))
    }

    /// Returns the file of a name, which is absolute, or on the search path.
    fn find_file(&self, name: &str) -> Result<PathBuf, String> {
        let name = self.environment.expand(name);
        let path = Path::new(&name);
        if path.is_absolute() {
            return Ok(path.to_owned());
        }
        let mut folders: Vec<PathBuf> = Vec::new();
        for folder in &self.model.search_path {
            folders.push(self.folder.join(self.environment.expand(folder)));
        }
        if folders.is_empty() {
            folders.push(self.folder.clone());
        }
        let files = self.environment.files();
        folders.iter().map(|folder| folder.join(path)).find(|path| files.is_file(path)).ok_or_else(|| {
            let folders: Vec<_> = folders
                .iter()
                .map(|folder| {
                    if folder.as_os_str().is_empty() { ".".to_owned() } else { folder.display().to_string() }
                })
                .collect();
            format!("the file \"{name}\" is not found in {}", folders.join(", "))
        })
    }
}

/// Returns the names that a list makes active, in its order; all names where the list is empty or names none of them.
fn ordered<'a>(names: Vec<&'a str>, active: &[String]) -> Vec<&'a str> {
    let found: Vec<&str> =
        active.iter().filter_map(|name| names.iter().copied().find(|found| same(found, name))).collect();
    if found.is_empty() { names } else { found }
}

#[cfg(test)]
mod tests;
