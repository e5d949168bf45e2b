//! Functions that are written elsewhere, as in C++ (reference 14): what they are given, and what they may ask.

use crate::RayKind;
use granita_base::{Param, Vec3};
use granita_gsl::ir::ValueType;
use std::sync::Arc;

/// A function that shaders call for a whole grid.
pub trait Shadeop: Send + Sync {
    /// Runs it for the active points.
    ///
    /// # Errors
    /// What went wrong; it is told once, and what was written until then stays.
    fn run(&self, context: &mut dyn ShadeopContext) -> Result<(), String>;
}

/// Values of an argument, point after point, each with all its components.
#[derive(Clone, Debug, PartialEq)]
pub enum ShadeopData {
    /// Numbers.
    Floats(Vec<f32>),
    /// Strings.
    Strings(Vec<Arc<str>>),
}

/// One argument, or a variable of the shader that was asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadeopArg {
    /// Type of an element.
    pub value: ValueType,
    /// Length of an array.
    pub array: Option<u32>,
    /// Whether each point has a value of its own; otherwise there is one for all.
    pub varying: bool,
    /// Whether it is taken back when the function is done.
    pub output: bool,
    /// The values.
    pub data: ShadeopData,
}

impl ShadeopArg {
    /// Numbers or strings of one point.
    pub fn width(&self) -> usize {
        self.value.components() * self.array.unwrap_or(1) as usize
    }

    /// Gives each of `points` points a value of its own.
    pub fn spread(&mut self, points: usize) {
        if self.varying {
            return;
        }
        self.varying = true;
        match &mut self.data {
            ShadeopData::Floats(v) => *v = v.repeat(points),
            ShadeopData::Strings(v) => *v = std::iter::repeat_n(&*v, points).flatten().cloned().collect(),
        }
    }
}

/// A value of an option of a lookup.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OptionValue<'a> {
    /// A number.
    Number(f32),
    /// A string.
    Text(&'a str),
}

/// A point of a lookup for directions or positions, with its differences to the neighbours.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spot {
    /// The point or direction.
    pub at: Vec3,
    /// Difference along x.
    pub dx: Vec3,
    /// Difference along y.
    pub dy: Vec3,
}

/// A run of a function: its arguments, the active points, and the shader around it.
pub trait ShadeopContext {
    /// Points of the grid.
    fn points(&self) -> usize;

    /// The active points, increasing; at least one.
    fn active(&self) -> &[u32];

    /// Why the grid is shaded.
    fn ray(&self) -> RayKind;

    /// The arguments: the result first, if there is one; variables that were asked for behind.
    fn args(&mut self) -> &mut Vec<ShadeopArg>;

    /// Puts a parameter or global of the shader behind the arguments, and gives its number; `None` when the shader names
    /// none such.
    fn symbol(&mut self, name: &str) -> Option<usize>;

    /// An attribute of the renderer.
    fn attribute(&mut self, name: &str) -> Option<Param>;

    /// Data about a texture file.
    fn texture_info(&mut self, texture: &str, name: &str) -> Option<Param>;

    /// A message of the function, said once for its words.
    fn complain(&mut self, what: &str);

    /// A filtered lookup at (s, t), with the differences dsdx, dtdx, dsdy, dtdy, into as many channels as `out` has.
    fn texture(&mut self, name: &str, at: [f32; 6], options: &[(&str, OptionValue<'_>)], out: &mut [f32]);

    /// An environment, at the grid's own position of the point whose turn it is.
    fn environment(&mut self, name: &str, at: Spot, options: &[(&str, OptionValue<'_>)], out: &mut [f32]);

    /// A shadow map or set: 0 open, 1 blocked.
    fn shadow(&mut self, name: &str, at: Spot, options: &[(&str, OptionValue<'_>)], out: &mut [f32]);
}

/// Whether an option takes a string.
pub fn is_text_option(name: &str) -> bool {
    matches!(name, "wrap" | "swrap" | "twrap" | "space" | "up" | "distribution" | "filename" | "filemode")
}
