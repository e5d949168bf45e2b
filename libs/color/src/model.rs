//! The parts of a configuration.

use crate::transform::Directed;
use regex::Regex;

/// The space that colour spaces are described against.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reference {
    /// Light of a scene.
    #[default]
    Scene,
    /// Light of a display.
    Display,
}

/// A colour space.
#[derive(Clone, Debug, Default)]
pub struct ColorSpace {
    /// The name.
    pub name: String,
    /// Other names.
    pub aliases: Vec<String>,
    /// The family, for menus.
    pub family: String,
    /// A description.
    pub description: String,
    /// The encoding, such as "scene-linear", "log", "sdr-video" or "data"; empty where it is not given.
    pub encoding: String,
    /// The categories, for menus.
    pub categories: Vec<String>,
    /// Spaces of one group that is not empty have the same colours.
    pub equality_group: String,
    /// True for values that are not colours, which are never converted.
    pub is_data: bool,
    /// The reference.
    pub reference: Reference,
    pub(crate) to_reference: Option<Directed>,
    pub(crate) from_reference: Option<Directed>,
    pub(crate) line: usize,
}

impl ColorSpace {
    /// True for linear light of a scene or of a display.
    pub fn is_linear(&self) -> bool {
        matches!(&*self.encoding, "scene-linear" | "display-linear")
    }
}

/// A transform with a name that can stand for a colour space.
#[derive(Clone, Debug)]
pub(crate) struct NamedTransform {
    pub(crate) name: String,
    pub(crate) aliases: Vec<String>,
    pub(crate) forward: Option<Directed>,
    pub(crate) backward: Option<Directed>,
}

/// A look.
#[derive(Clone, Debug)]
pub(crate) struct Look {
    pub(crate) name: String,
    pub(crate) process_space: String,
    pub(crate) forward: Option<Directed>,
    pub(crate) backward: Option<Directed>,
}

/// A transform from a reference to that of displays.
#[derive(Clone, Debug)]
pub(crate) struct ViewTransform {
    pub(crate) name: String,
    pub(crate) reference: Reference,
    pub(crate) from_reference: Option<Directed>,
    pub(crate) to_reference: Option<Directed>,
}

/// A view of a display.
#[derive(Clone, Debug)]
pub(crate) struct View {
    pub(crate) name: String,
    /// The colour space, or `<USE_DISPLAY_NAME>`.
    pub(crate) space: String,
    pub(crate) transform: Option<String>,
    pub(crate) looks: String,
    pub(crate) line: usize,
}

/// A display.
#[derive(Clone, Debug)]
pub(crate) struct Display {
    pub(crate) name: String,
    pub(crate) views: Vec<View>,
    pub(crate) shared: Vec<String>,
}

/// A rule that finds the colour space of a file.
#[derive(Clone, Debug)]
pub(crate) struct FileRule {
    pub(crate) space: String,
    pub(crate) kind: RuleKind,
}

#[derive(Clone, Debug)]
pub(crate) enum RuleKind {
    Glob { pattern: String, extension: String },
    Regex(Regex),
    NameInPath,
    Default,
}

/// The content of a configuration.
#[derive(Clone, Debug, Default)]
pub(crate) struct Model {
    pub(crate) major: u32,
    pub(crate) name: String,
    pub(crate) search_path: Vec<String>,
    pub(crate) variables: Vec<(String, String)>,
    pub(crate) roles: Vec<(String, String)>,
    pub(crate) file_rules: Vec<FileRule>,
    pub(crate) shared_views: Vec<View>,
    pub(crate) displays: Vec<Display>,
    pub(crate) active_displays: Vec<String>,
    pub(crate) active_views: Vec<String>,
    pub(crate) inactive: Vec<String>,
    pub(crate) looks: Vec<Look>,
    pub(crate) default_view_transform: String,
    pub(crate) view_transforms: Vec<ViewTransform>,
    pub(crate) spaces: Vec<ColorSpace>,
    pub(crate) named: Vec<NamedTransform>,
}
