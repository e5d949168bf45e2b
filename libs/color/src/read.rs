//! Reads configurations.

mod transforms;

use crate::error::ColorError;
use crate::model::{
    ColorSpace, Display, FileRule, Look, Model, NamedTransform, Reference, RuleKind, View, ViewTransform,
};
use crate::yaml::{self, Node};

/// Reads a configuration from its text. `place` names it in errors.
///
/// # Errors
/// Returns an error with the line.
pub(crate) fn read(text: &str, place: &str) -> Result<Model, ColorError> {
    let reader = Reader { place };
    let root = yaml::parse(text, place)?;
    reader.model(&root)
}

struct Reader<'a> {
    place: &'a str,
}

impl Reader<'_> {
    fn malformed(&self, node: &Node, what: impl Into<String>) -> ColorError {
        ColorError::Malformed { place: format!("{}:{}", self.place, node.line), what: what.into() }
    }

    fn text<'n>(&self, node: &'n Node) -> Result<&'n str, ColorError> {
        node.text().ok_or_else(|| self.malformed(node, "a text is needed"))
    }

    /// Returns the text of a key; `None` without the key.
    fn text_of<'n>(&self, node: &'n Node, key: &str) -> Result<Option<&'n str>, ColorError> {
        node.get(key).map(|value| self.text(value)).transpose()
    }

    /// Returns the text of a key that has to be there.
    fn needed(&self, node: &Node, key: &str) -> Result<String, ColorError> {
        let text = self.text_of(node, key)?;
        text.map(str::to_owned).ok_or_else(|| self.malformed(node, format!("{key} is missing")))
    }

    /// Returns the texts of a list, or of texts between commas.
    fn texts(&self, node: &Node) -> Result<Vec<String>, ColorError> {
        match node.list() {
            Some(list) => list.iter().map(|node| self.text(node).map(str::to_owned)).collect(),
            None => {
                let parts = self.text(node)?.split([',', ':']).map(str::trim);
                Ok(parts.filter(|part| !part.is_empty()).map(str::to_owned).collect())
            }
        }
    }

    fn texts_of(&self, node: &Node, key: &str) -> Result<Vec<String>, ColorError> {
        node.get(key).map_or(Ok(Vec::new()), |value| self.texts(value))
    }

    fn number(&self, node: &Node) -> Result<f64, ColorError> {
        let text = self.text(node)?;
        let number = text.parse::<f64>().ok().filter(|v| v.is_finite());
        number.ok_or_else(|| self.malformed(node, format!("\"{text}\" is not a number")))
    }

    fn number_of(&self, node: &Node, key: &str) -> Result<Option<f64>, ColorError> {
        node.get(key).map(|value| self.number(value)).transpose()
    }

    /// Returns the numbers of a list, or one number.
    fn numbers(&self, node: &Node) -> Result<Vec<f64>, ColorError> {
        match node.list() {
            Some(list) => list.iter().map(|node| self.number(node)).collect(),
            None => Ok(vec![self.number(node)?]),
        }
    }

    fn exactly<const N: usize>(&self, node: &Node) -> Result<[f64; N], ColorError> {
        let numbers = self.numbers(node)?;
        let found = numbers.len();
        <[f64; N]>::try_from(numbers)
            .map_err(|_| self.malformed(node, format!("{found} numbers, and {N} are needed")))
    }

    /// Returns three numbers; one number counts for all.
    fn three(&self, node: &Node, key: &str, default: f64) -> Result<[f64; 3], ColorError> {
        match node.get(key) {
            None => Ok([default; 3]),
            Some(value) if value.list().is_none() => Ok([self.number(value)?; 3]),
            Some(value) => self.exactly(value),
        }
    }

    /// Returns three numbers and that of alpha; one number counts for the colours.
    fn four(&self, node: &Node, key: &str, default: f64) -> Result<[f64; 4], ColorError> {
        match node.get(key) {
            None => Ok([default; 4]),
            Some(value) if value.list().is_none() => {
                let v = self.number(value)?;
                Ok([v, v, v, default])
            }
            Some(value) => match self.numbers(value)?[..] {
                [r, g, b] => Ok([r, g, b, default]),
                [r, g, b, a] => Ok([r, g, b, a]),
                ref others => {
                    Err(self.malformed(value, format!("{} numbers, and 3 or 4 are needed", others.len())))
                }
            },
        }
    }

    fn flag(&self, node: &Node, key: &str, default: bool) -> Result<bool, ColorError> {
        match self.text_of(node, key)? {
            None => Ok(default),
            Some(text) => match &*text.to_ascii_lowercase() {
                "true" | "yes" | "on" | "1" => Ok(true),
                "false" | "no" | "off" | "0" => Ok(false),
                other => Err(self.malformed(node, format!("{key}: {other}, not true or false"))),
            },
        }
    }

    fn model(&self, root: &Node) -> Result<Model, ColorError> {
        let Some(version) = root.get("ocio_profile_version") else {
            return Err(self.malformed(root, "ocio_profile_version is missing"));
        };
        let major = match self.text(version)?.split('.').next() {
            Some("1") => 1,
            Some("2") => 2,
            _ => return Err(self.malformed(version, "the version is neither 1 nor 2")),
        };
        let mut model = Model { major, ..Model::default() };
        for (key, node) in root.map().unwrap_or_default() {
            match &**key {
                "name" => model.name = self.text(node)?.to_owned(),
                "search_path" => model.search_path = self.search_path(node)?,
                "environment" => {
                    for (name, value) in node.map().unwrap_or_default() {
                        model.variables.push((name.clone(), self.text(value)?.to_owned()));
                    }
                }
                "roles" => {
                    for (role, space) in node.map().unwrap_or_default() {
                        model.roles.push((role.clone(), self.text(space)?.to_owned()));
                    }
                }
                "file_rules" => {
                    let rules = node.list().unwrap_or_default();
                    model.file_rules =
                        rules.iter().map(|rule| self.file_rule(rule)).collect::<Result<_, _>>()?;
                }
                "shared_views" => {
                    let views = node.list().unwrap_or_default();
                    model.shared_views =
                        views.iter().map(|view| self.view(view)).collect::<Result<_, _>>()?;
                }
                "displays" => {
                    for (name, views) in node.map().unwrap_or_default() {
                        let display = self.display(name, views)?;
                        model.displays.push(display);
                    }
                }
                "active_displays" => model.active_displays = self.texts(node)?,
                "active_views" => model.active_views = self.texts(node)?,
                "inactive_colorspaces" => model.inactive = self.texts(node)?,
                "looks" => {
                    for look in node.list().unwrap_or_default() {
                        model.looks.push(self.look(look)?);
                    }
                }
                "default_view_transform" => model.default_view_transform = self.text(node)?.to_owned(),
                "view_transforms" => {
                    for transform in node.list().unwrap_or_default() {
                        model.view_transforms.push(self.view_transform(transform)?);
                    }
                }
                "colorspaces" => self.spaces(node, Reference::Scene, &mut model)?,
                "display_colorspaces" => self.spaces(node, Reference::Display, &mut model)?,
                "named_transforms" => {
                    for transform in node.list().unwrap_or_default() {
                        model.named.push(self.named(transform)?);
                    }
                }
                // Descriptions, the luminance weights and hints for menus do not change colours.
                _ => {}
            }
        }
        Ok(model)
    }

    fn search_path(&self, node: &Node) -> Result<Vec<String>, ColorError> {
        match node.list() {
            Some(list) => list.iter().map(|node| self.text(node).map(str::to_owned)).collect(),
            None => {
                let parts = self.text(node)?.split(':').filter(|part| !part.is_empty());
                Ok(parts.map(str::to_owned).collect())
            }
        }
    }

    /// Returns the transform of the first of several keys.
    fn transform_of(
        &self,
        node: &Node,
        keys: &[&str],
    ) -> Result<Option<crate::transform::Directed>, ColorError> {
        let found = keys.iter().find_map(|key| node.get(key));
        found.map(|node| self.transform(node)).transpose()
    }

    fn spaces(&self, node: &Node, reference: Reference, model: &mut Model) -> Result<(), ColorError> {
        for node in node.list().unwrap_or_default() {
            model.spaces.push(ColorSpace {
                name: self.needed(node, "name")?,
                aliases: self.texts_of(node, "aliases")?,
                family: self.text_of(node, "family")?.unwrap_or_default().to_owned(),
                description: self.text_of(node, "description")?.unwrap_or_default().trim_end().to_owned(),
                encoding: self.text_of(node, "encoding")?.unwrap_or_default().to_owned(),
                categories: self.texts_of(node, "categories")?,
                equality_group: self.text_of(node, "equalitygroup")?.unwrap_or_default().to_owned(),
                is_data: self.flag(node, "isdata", false)?,
                reference,
                to_reference: self
                    .transform_of(node, &["to_reference", "to_scene_reference", "to_display_reference"])?,
                from_reference: self.transform_of(
                    node,
                    &["from_reference", "from_scene_reference", "from_display_reference"],
                )?,
                line: node.line,
            });
        }
        Ok(())
    }

    fn named(&self, node: &Node) -> Result<NamedTransform, ColorError> {
        let found = NamedTransform {
            name: self.needed(node, "name")?,
            aliases: self.texts_of(node, "aliases")?,
            forward: self.transform_of(node, &["transform"])?,
            backward: self.transform_of(node, &["inverse_transform"])?,
        };
        match found.forward.is_none() && found.backward.is_none() {
            true => Err(self.malformed(node, "neither transform nor inverse_transform is given")),
            false => Ok(found),
        }
    }

    fn look(&self, node: &Node) -> Result<Look, ColorError> {
        Ok(Look {
            name: self.needed(node, "name")?,
            process_space: self.needed(node, "process_space")?,
            forward: self.transform_of(node, &["transform"])?,
            backward: self.transform_of(node, &["inverse_transform"])?,
        })
    }

    fn view_transform(&self, node: &Node) -> Result<ViewTransform, ColorError> {
        let scene = self.transform_of(node, &["from_scene_reference", "from_reference"])?;
        let to_scene = self.transform_of(node, &["to_scene_reference", "to_reference"])?;
        let display = self.transform_of(node, &["from_display_reference"])?;
        let to_display = self.transform_of(node, &["to_display_reference"])?;
        let reference =
            if display.is_some() || to_display.is_some() { Reference::Display } else { Reference::Scene };
        let (from_reference, to_reference) = match reference {
            Reference::Scene => (scene, to_scene),
            Reference::Display => (display, to_display),
        };
        Ok(ViewTransform { name: self.needed(node, "name")?, reference, from_reference, to_reference })
    }

    fn view(&self, node: &Node) -> Result<View, ColorError> {
        let space = match self.text_of(node, "display_colorspace")? {
            Some(space) => space.to_owned(),
            None => self.needed(node, "colorspace")?,
        };
        Ok(View {
            name: self.needed(node, "name")?,
            space,
            transform: self.text_of(node, "view_transform")?.map(str::to_owned),
            looks: self.text_of(node, "looks")?.unwrap_or_default().to_owned(),
            line: node.line,
        })
    }

    fn display(&self, name: &str, node: &Node) -> Result<Display, ColorError> {
        let (mut views, mut shared) = (Vec::new(), Vec::new());
        for node in node.list().unwrap_or_default() {
            match &*node.tag {
                "View" => views.push(self.view(node)?),
                "Views" => shared.extend(self.texts(node)?),
                _ => return Err(self.malformed(node, "a display has !<View> and !<Views>")),
            }
        }
        Ok(Display { name: name.to_owned(), views, shared })
    }

    fn file_rule(&self, node: &Node) -> Result<FileRule, ColorError> {
        let name = self.needed(node, "name")?;
        let space = self.text_of(node, "colorspace")?.unwrap_or_default().to_owned();
        let kind = match (self.text_of(node, "regex")?, &*name) {
            (Some(regex), _) => {
                let regex = regex::Regex::new(regex).map_err(|_| {
                    self.malformed(node, format!("\"{regex}\" is not a regular expression that is known"))
                })?;
                RuleKind::Regex(regex)
            }
            (None, "Default") => RuleKind::Default,
            (None, "ColorSpaceNamePathSearch") => RuleKind::NameInPath,
            (None, _) => RuleKind::Glob {
                pattern: self.text_of(node, "pattern")?.unwrap_or("*").to_owned(),
                extension: self.text_of(node, "extension")?.unwrap_or("*").to_owned(),
            },
        };
        Ok(FileRule { space, kind })
    }
}
