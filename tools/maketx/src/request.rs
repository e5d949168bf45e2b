//! A request: the textures to make and how, from the command line of any profile.

use crate::shared::RunArgs;
use granita_base::{Files, Location, Reporter, SearchPath, Severity};
use granita_cli::{Status, environment};
use granita_texture::UdimName;
use granita_texture::make::MakeOptions;
use std::path::{Path, PathBuf};

/// The way in which results are reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Manner {
    /// Errors and warnings go to standard error. The exit status is 1 when some textures failed, and 2 when all did.
    Suite,
    /// As OpenImageIO's program does: errors of making textures go to standard output, and the exit status is 1.
    OpenImageIo,
}

impl Manner {
    /// Reports an error of making a texture.
    pub(crate) fn error(self, what: String, reporter: &Reporter) {
        match self {
            Self::Suite => reporter.error(what),
            Self::OpenImageIo => {
                let text = format!("make_texture ERROR: {what}\n");
                reporter.say(Severity::Message, &Location::default(), text);
            }
        }
    }

    /// Returns the status when nothing was made.
    pub(crate) fn failed(self) -> Status {
        match self {
            Self::Suite => Status::Failed,
            Self::OpenImageIo => Status::WithErrors,
        }
    }
}

/// Returns the name of a set in the first folder of a search path that has files of it.
fn find_set(name: &str, path: &SearchPath) -> Option<PathBuf> {
    let names = UdimName::parse(name)?.names(path);
    let first = path.find(names.first_key_value()?.1)?;
    Some(first.with_file_name(Path::new(name).file_name()?))
}

/// What one command line requests.
pub(crate) struct Request {
    pub(crate) manner: Manner,
    pub(crate) inputs: Vec<String>,
    /// The texture, or the folder of textures.
    pub(crate) output: Option<PathBuf>,
    /// True when an option named the format.
    pub(crate) format_given: bool,
    /// Folders of inputs, separated by colons.
    pub(crate) path: Option<String>,
    /// Skips textures that are newer than their inputs.
    pub(crate) newer: bool,
    /// Filters of the levels of a set use texels of neighbouring images.
    pub(crate) seams: bool,
    pub(crate) threads: Option<usize>,
    pub(crate) stats: bool,
    pub(crate) verbosity: u8,
    pub(crate) run: RunArgs,
    pub(crate) options: MakeOptions,
}

impl Request {
    /// Returns the files that -safe lets the tool read. They lie beneath the folders of the inputs and of the search
    /// path.
    pub(crate) fn readable(&self) -> Files {
        let levels = &self.options.flat.level_files;
        let files =
            Files::reading(self.inputs.iter().map(Path::new).chain(levels.iter().map(PathBuf::as_path)));
        let path =
            SearchPath::parse(self.path.as_deref().unwrap_or(""), &SearchPath::default(), &environment());
        path.folders().iter().for_each(|folder| files.add_root(folder));
        files
    }

    /// Finds the inputs along the search path. Returns `None`, after an error for each, when some are missing.
    pub(crate) fn find_inputs(&self, reporter: &Reporter) -> Option<Vec<PathBuf>> {
        let Some(text) = &self.path else { return Some(self.inputs.iter().map(PathBuf::from).collect()) };
        let path = SearchPath::parse(text, &SearchPath::default(), &environment());
        let find = |name: &String| {
            if name == "-" {
                return Some(PathBuf::from(name));
            }
            let found = path.find(name).or_else(|| find_set(name, &path));
            if found.is_none() {
                reporter.error(format!("{name}: not found along {text}"));
            }
            found
        };
        let found: Vec<Option<PathBuf>> = self.inputs.iter().map(find).collect();
        found.into_iter().collect()
    }
}
