//! Transforms of a configuration become the steps of a processor.

use super::{Config, DISPLAY_NAME, looks, same};
use crate::error::ColorError;
use crate::lut;
use crate::model::{ColorSpace, NamedTransform, Reference};
use crate::processor::Processor;
use crate::styles;
use crate::table::Interpolation;
use crate::transform::{Cdl, Directed, Negatives, Transform};
use std::path::Path;
use std::sync::Arc;

/// The depth of transforms that name spaces, which name transforms.
const MAX_DEPTH: usize = 32;

/// A transform that needs no configuration any more.
struct Leaf {
    transform: Transform,
    inverse: bool,
    place: String,
}

/// Collects the transforms of a conversion.
pub(super) struct Compiler<'a> {
    config: &'a Config,
    leaves: Vec<Leaf>,
    depth: usize,
    /// The transforms that are not supported, with their places.
    unsupported: Vec<(String, String)>,
}

impl<'a> Compiler<'a> {
    pub(super) fn new(config: &'a Config) -> Self {
        Self { config, leaves: Vec::new(), depth: 0, unsupported: Vec::new() }
    }

    /// Returns the processor.
    pub(super) fn finish(mut self) -> Result<Processor, ColorError> {
        let mut processor = Processor::default();
        for leaf in &self.leaves {
            if let Err(refused) = processor.push(&leaf.transform, leaf.inverse) {
                self.unsupported.push((leaf.place.clone(), refused.0));
            }
        }
        self.unsupported.dedup();
        let Some(((place, first), more)) = self.unsupported.split_first() else { return Ok(processor) };
        let mut what = first.clone();
        for (place, other) in more {
            what.push_str(&format!("; {place}: {other}"));
        }
        Err(ColorError::Unsupported { place: place.clone(), what })
    }

    fn place(&self, line: usize) -> String {
        match line {
            0 => self.config.place.clone(),
            line => format!("{}:{line}", self.config.place),
        }
    }

    /// Adds the transforms from one colour space to another.
    pub(super) fn convert(&mut self, from: &str, to: &str, data_bypass: bool) -> Result<(), ColorError> {
        let config = self.config;
        let (named_from, named_to) = (config.named_transform(from), config.named_transform(to));
        let is_space = |name: &str| config.color_space(name).is_some();
        let named_from = named_from.filter(|_| !is_space(from));
        let named_to = named_to.filter(|_| !is_space(to));
        if named_from.is_some() || named_to.is_some() {
            // A space beside a named transform is not converted, because the transform is not bound to a reference.
            if named_from.is_none() {
                config.need_space(from)?;
            }
            if named_to.is_none() {
                config.need_space(to)?;
            }
            if let Some(named) = named_from {
                self.named(named, false)?;
            }
            if let Some(named) = named_to {
                self.named(named, true)?;
            }
            return Ok(());
        }
        let (from, to) = (config.need_space(from)?, config.need_space(to)?);
        if data_bypass && (from.is_data || to.is_data) {
            return Ok(());
        }
        if same(&from.name, &to.name)
            || (!from.equality_group.is_empty() && from.equality_group == to.equality_group)
        {
            return Ok(());
        }
        self.add_to_reference(from)?;
        self.between(from.reference, to.reference, to.line)?;
        self.add_from_reference(to)
    }

    fn named(&mut self, named: &NamedTransform, backwards: bool) -> Result<(), ColorError> {
        let (first, second) = match backwards {
            false => (&named.forward, &named.backward),
            true => (&named.backward, &named.forward),
        };
        match (first, second) {
            (Some(found), _) => self.add(found, false),
            (None, Some(found)) => self.add(found, true),
            (None, None) => Ok(()),
        }
    }

    fn add_to_reference(&mut self, space: &ColorSpace) -> Result<(), ColorError> {
        match (&space.to_reference, &space.from_reference) {
            (Some(found), _) => self.add(found, false),
            (None, Some(found)) => self.add(found, true),
            (None, None) => Ok(()),
        }
    }

    fn add_from_reference(&mut self, space: &ColorSpace) -> Result<(), ColorError> {
        match (&space.from_reference, &space.to_reference) {
            (Some(found), _) => self.add(found, false),
            (None, Some(found)) => self.add(found, true),
            (None, None) => Ok(()),
        }
    }

    /// Adds the transforms from one reference to the other, which are those of the default view transform.
    fn between(&mut self, from: Reference, to: Reference, line: usize) -> Result<(), ColorError> {
        if from == to {
            return Ok(());
        }
        let config = self.config;
        let transforms = &config.model.view_transforms;
        let default = transforms.iter().find(|t| same(&t.name, &config.model.default_view_transform));
        let default = default.or_else(|| transforms.iter().find(|t| t.reference == Reference::Scene));
        let Some(found) = default.filter(|t| t.reference == Reference::Scene) else {
            return Err(ColorError::Malformed {
                place: self.place(line),
                what: "no view transform leads from the scene to displays".to_owned(),
            });
        };
        let (first, second) = match to {
            Reference::Display => (&found.from_reference, &found.to_reference),
            Reference::Scene => (&found.to_reference, &found.from_reference),
        };
        match (first, second) {
            (Some(found), _) => self.add(found, false),
            (None, Some(found)) => self.add(found, true),
            (None, None) => Ok(()),
        }
    }

    /// Adds the transforms from a colour space to a view of a display.
    pub(super) fn display(&mut self, from: &str, display: &str, view: &str) -> Result<(), ColorError> {
        let config = self.config;
        let view = config.need_view(display, view)?;
        let space = if view.space == DISPLAY_NAME { display } else { &*view.space };
        let to = config.need_space(space)?;
        let source = config.need_space(from)?;
        if to.is_data || source.is_data {
            return Ok(());
        }
        let current = self.looks(&source.name, &view.looks)?;
        let source = config.need_space(&current)?;
        let Some(name) = &view.transform else {
            return self.convert(&source.name, &to.name, true);
        };
        let Some(found) = config.model.view_transforms.iter().find(|t| same(&t.name, name)) else {
            return Err(ColorError::Malformed {
                place: self.place(view.line),
                what: format!("there is no view transform \"{name}\""),
            });
        };
        self.add_to_reference(source)?;
        self.between(source.reference, found.reference, view.line)?;
        match (&found.from_reference, &found.to_reference) {
            (Some(found), _) => self.add(found, false)?,
            (None, Some(found)) => self.add(found, true)?,
            (None, None) => {}
        }
        self.between(Reference::Display, to.reference, view.line)?;
        self.add_from_reference(to)
    }

    /// Adds looks to colours of a space. Returns the name of the space of the result.
    fn looks(&mut self, from: &str, text: &str) -> Result<String, ColorError> {
        let mut current = from.to_owned();
        for (look, inverse) in looks::parse(self.config, text)? {
            self.convert(&current, &look.process_space, true)?;
            current.clone_from(&look.process_space);
            let (first, second) = match inverse {
                false => (&look.forward, &look.backward),
                true => (&look.backward, &look.forward),
            };
            match (first, second) {
                (Some(found), _) => self.add(found, false)?,
                (None, Some(found)) => self.add(found, true)?,
                (None, None) => {}
            }
        }
        Ok(current)
    }

    /// Adds looks between two colour spaces.
    pub(super) fn look(&mut self, from: &str, to: &str, looks: &str, stay: bool) -> Result<(), ColorError> {
        let current = self.looks(from, looks)?;
        if stay { Ok(()) } else { self.convert(&current, to, true) }
    }

    /// Adds the transforms of a file.
    pub(super) fn file_transform(&mut self, file: &str, inverse: bool) -> Result<(), ColorError> {
        let transform = Transform::File { src: file.to_owned(), id: None, interpolation: None, clamp: false };
        self.add(&Directed { transform, inverse, line: 0 }, false)
    }

    /// Adds a transform.
    pub(super) fn add(&mut self, directed: &Directed, backwards: bool) -> Result<(), ColorError> {
        if self.depth == MAX_DEPTH {
            return Err(ColorError::Malformed {
                place: self.place(directed.line),
                what: "transforms name each other in a circle".to_owned(),
            });
        }
        self.depth += 1;
        let start = self.leaves.len();
        let inverse = directed.inverse != backwards;
        let result = self.expand(directed);
        self.depth -= 1;
        result?;
        if inverse {
            self.turn(start);
        }
        Ok(())
    }

    /// Inverts all that was added since there were `start` transforms.
    fn turn(&mut self, start: usize) {
        self.leaves[start..].reverse();
        self.leaves[start..].iter_mut().for_each(|leaf| leaf.inverse = !leaf.inverse);
    }

    /// Adds a transform that needs no configuration, in its forward direction.
    fn leaf(&mut self, transform: &Transform, place: &str) {
        for transform in self.of_version(transform) {
            self.leaves.push(Leaf { transform, inverse: false, place: place.to_owned() });
        }
    }

    /// Adds a transform in its forward direction.
    fn expand(&mut self, directed: &Directed) -> Result<(), ColorError> {
        let place = self.place(directed.line);
        match &directed.transform {
            Transform::Group(children) => children.iter().try_for_each(|child| self.add(child, false)),
            Transform::ColorSpace { src, dst, data_bypass } => {
                self.placed(directed.line, |this| this.convert(src, dst, *data_bypass))
            }
            Transform::Look { src, dst, looks, skip_conversion } => {
                self.placed(directed.line, |this| this.look(src, dst, looks, *skip_conversion))
            }
            Transform::DisplayView { src, display, view } => {
                self.placed(directed.line, |this| this.display(src, display, view))
            }
            Transform::Builtin(style) => {
                match styles::style(style) {
                    Some(found) => found.iter().try_for_each(|found| self.add(found, false))?,
                    None => {
                        self.unsupported
                            .push((place, format!("the BuiltinTransform of the style \"{style}\"")));
                    }
                }
                Ok(())
            }
            Transform::File { src, id, interpolation, clamp } => {
                let malformed = |what| ColorError::Malformed { place: place.clone(), what };
                let path = self.config.find_file(src).map_err(malformed)?;
                let bytes = self.config.environment.files().read(&path);
                let bytes = bytes.map_err(|source| ColorError::Io { path: path.clone(), source })?;
                let id = id.as_deref().map(|id| self.config.environment.expand(id));
                self.file(&bytes, &path, id.as_deref(), *interpolation, *clamp)
            }
            transform => {
                self.leaf(transform, &place);
                Ok(())
            }
        }
    }

    /// Adds the transforms of the content of a file.
    pub(super) fn file(
        &mut self,
        bytes: &[u8],
        path: &Path,
        id: Option<&str>,
        interpolation: Option<Interpolation>,
        clamp: bool,
    ) -> Result<(), ColorError> {
        let found = match lut::read(bytes, path, id, clamp) {
            Err(ColorError::Unsupported { place, what }) => {
                self.unsupported.push((place, what));
                return Ok(());
            }
            found => found?,
        };
        let place = path.display().to_string();
        for mut part in found {
            if let Some(interpolation) = interpolation {
                interpolate(&mut part.transform, interpolation);
            }
            let start = self.leaves.len();
            self.leaf(&part.transform, &place);
            if part.inverse {
                self.turn(start);
            }
        }
        Ok(())
    }

    /// Runs a part that names spaces, and puts the line before its errors about names.
    fn placed(
        &mut self,
        line: usize,
        part: impl FnOnce(&mut Self) -> Result<(), ColorError>,
    ) -> Result<(), ColorError> {
        part(self).map_err(|error| match error {
            ColorError::Misuse { what } => ColorError::Malformed { place: self.place(line), what },
            other => other,
        })
    }

    /// Returns the transforms that the version of the configuration means. Decision lists of version 1 clamp negative
    /// values only, before their power.
    fn of_version(&self, transform: &Transform) -> Vec<Transform> {
        let cdl = match transform {
            Transform::Cdl(cdl) if self.config.model.major == 1 => cdl,
            other => return vec![other.clone()],
        };
        let ([r, g, b], [x, y, z], [p, q, s]) = (cdl.slope, cdl.offset, cdl.power);
        let scale = [r, 0.0, 0.0, 0.0, 0.0, g, 0.0, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, 0.0, 1.0];
        vec![
            Transform::Matrix(scale, [x, y, z, 0.0]),
            Transform::Exponent([p, q, s, 1.0], Negatives::Clamp),
            Transform::Cdl(Cdl { saturation: cdl.saturation, ..Cdl::default() }),
        ]
    }
}

/// Sets the interpolation of a table. As in OpenColorIO 2, the nearest entry is not used: interpolation is then linear.
fn interpolate(transform: &mut Transform, interpolation: Interpolation) {
    let interpolation = match interpolation {
        Interpolation::Tetrahedral => Interpolation::Tetrahedral,
        _ => Interpolation::Linear,
    };
    match transform {
        Transform::Lut1d(lut) => Arc::make_mut(lut).interpolation = interpolation,
        Transform::Lut3d(lut) => Arc::make_mut(lut).interpolation = interpolation,
        _ => {}
    }
}
