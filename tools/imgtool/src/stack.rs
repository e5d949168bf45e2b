//! The stack of images, and what else steps share.

use crate::parse::Given;
use granita_base::{Environment, Location, Reporter, Severity};
use granita_color::{ColorError, Config};
use granita_edit::{DiffLimits, EditError, File, Image, Verdict, WriteOptions};
use granita_image::FormatRegistry;
use granita_plugin::PluginRules;
use std::path::PathBuf;

/// The reason why a command line was not carried out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Fault {
    pub(crate) what: String,
    /// True when two images of different sizes were compared.
    pub(crate) is_size: bool,
}

impl From<EditError> for Fault {
    fn from(error: EditError) -> Self {
        Self::from(error.to_string())
    }
}

impl From<ColorError> for Fault {
    fn from(error: ColorError) -> Self {
        Self::from(error.to_string())
    }
}

impl From<String> for Fault {
    fn from(what: String) -> Self {
        Self { what, is_size: false }
    }
}

impl From<&str> for Fault {
    fn from(what: &str) -> Self {
        Self::from(what.to_owned())
    }
}

pub(crate) type Done<T = ()> = Result<T, Fault>;

/// An image on the stack.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    pub(crate) image: Image,
    /// The name of the file, or the word that made the image.
    pub(crate) name: String,
    /// The file, its image and its level, as long as the image is that of the file.
    pub(crate) file: Option<(File, usize, usize)>,
}

/// What applies to the whole command line.
#[derive(Clone, Debug, Default)]
pub(crate) struct Settings {
    pub(crate) memory_bytes: u64,
    pub(crate) dry_run: bool,
    pub(crate) update: bool,
    pub(crate) no_clobber: bool,
    pub(crate) create_folder: bool,
    /// True to print more.
    pub(crate) verbose: bool,
    /// The configuration of colours: a file, or a built-in one.
    pub(crate) colorconfig: Option<String>,
    /// The variables of the system, and the files that may be opened.
    pub(crate) environment: Environment,
    /// The plugins that may be loaded.
    pub(crate) rules: PluginRules,
}

/// The state between two steps.
pub(crate) struct Machine<'a> {
    pub(crate) formats: &'a FormatRegistry,
    pub(crate) reporter: &'a Reporter,
    pub(crate) settings: &'a Settings,
    pub(crate) stack: Vec<Entry>,
    /// An option that waits for images.
    pub(crate) pending: Option<Given>,
    pub(crate) write: WriteOptions,
    pub(crate) limits: DiffLimits,
    /// The files that were read.
    pub(crate) inputs: Vec<PathBuf>,
    pub(crate) info: Option<bool>,
    pub(crate) stats: bool,
    /// The number of files that were written or skipped.
    pub(crate) outputs: usize,
    /// True when something was printed on request.
    pub(crate) printed: bool,
    pub(crate) verdict: Option<Verdict>,
    config: Option<Config>,
}

impl<'a> Machine<'a> {
    pub(crate) fn new(formats: &'a FormatRegistry, reporter: &'a Reporter, settings: &'a Settings) -> Self {
        Self {
            formats,
            reporter,
            settings,
            stack: Vec::new(),
            pending: None,
            write: WriteOptions::default(),
            limits: DiffLimits::default(),
            inputs: Vec::new(),
            info: None,
            stats: false,
            outputs: 0,
            printed: false,
            verdict: None,
            config: None,
        }
    }

    /// Returns the configuration of colours, which is read once.
    pub(crate) fn config(&mut self) -> Done<Config> {
        if self.config.is_none() {
            let settings = self.settings;
            let engine = granita_plugin::color_engine(&settings.environment, settings.rules.clone());
            let config = Config::of_tool(settings.colorconfig.as_deref(), &settings.environment, engine)?;
            self.config = Some(config);
        }
        self.config.clone().ok_or_else(|| Fault::from("there is no configuration"))
    }

    /// Prints a text on request.
    pub(crate) fn say(&mut self, text: String) {
        self.printed = true;
        self.reporter.say(Severity::Message, &Location::default(), text);
    }

    /// Computes the last image once, when it fits into an eighth of the permitted memory and at most 64 MiB.
    pub(crate) fn hold_top(&mut self) -> Done {
        let most = (self.settings.memory_bytes / 8).min(64 << 20);
        if let Some(top) = self.stack.last_mut() {
            top.image = top.image.held(most)?;
        }
        Ok(())
    }

    /// Returns the last image.
    pub(crate) fn top(&self) -> Done<&Image> {
        self.stack.last().map(|entry| &entry.image).ok_or_else(|| Fault::from("there is no image"))
    }

    /// Replaces the last `count` images by one. Its name is that of the first of them.
    pub(crate) fn replace(&mut self, count: usize, image: Image) {
        let kept = self.stack.len().saturating_sub(count);
        let name = self.stack.get(kept).map(|entry| entry.name.clone()).unwrap_or_default();
        self.stack.truncate(kept);
        self.stack.push(Entry { image, name, file: None });
    }
}
