//! External functions, as in C++ (reference 14), and the context that they run in.

use crate::RayKind;
use granita_base::{Param, Vec3};
use granita_gsl::ir::ValueType;
use std::sync::Arc;

/// A function that shaders call for a whole grid.
pub trait Shadeop: Send + Sync {
    /// Runs the function for the active points.
    ///
    /// # Errors
    /// Returns a description of the error, which is reported once. Values written before the error are kept.
    fn run(&self, context: &mut dyn ShadeopContext) -> Result<(), String>;
}

/// The values of an argument, point after point, each with all its components.
#[derive(Clone, Debug, PartialEq)]
pub enum ShadeopData {
    /// Numbers.
    Floats(Vec<f32>),
    /// Strings.
    Strings(Vec<Arc<str>>),
}

/// One argument, or a variable of the shader that was requested.
#[derive(Clone, Debug, PartialEq)]
pub struct ShadeopArg {
    /// The type of an element.
    pub value: ValueType,
    /// The length of an array.
    pub array: Option<u32>,
    /// True when each point has its own value. Otherwise there is one for all.
    pub varying: bool,
    /// True when its values are stored after the call.
    pub output: bool,
    /// The values.
    pub data: ShadeopData,
}

impl ShadeopArg {
    /// Returns the number of values of one point.
    pub fn width(&self) -> usize {
        self.value.components() * self.array.unwrap_or(1) as usize
    }

    /// Copies the value so that each of `points` points has its own.
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

/// The value of an option of a lookup.
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

/// The context of a run of a function: its arguments, the active points, and the calling shader.
pub trait ShadeopContext {
    /// Returns the number of points of the grid.
    fn points(&self) -> usize;

    /// Returns the active points, increasing; at least one.
    fn active(&self) -> &[u32];

    /// Returns the ray that the grid is shaded for.
    fn ray(&self) -> RayKind;

    /// Returns the arguments: the result first, if there is one, and requested variables last.
    fn args(&mut self) -> &mut Vec<ShadeopArg>;

    /// Appends a parameter or global of the shader to the arguments, and returns its index; `None` when the shader
    /// has no such name.
    fn symbol(&mut self, name: &str) -> Option<usize>;

    /// Returns an attribute of the renderer.
    fn attribute(&mut self, name: &str) -> Option<Param>;

    /// Returns data about a texture file.
    fn texture_info(&mut self, texture: &str, name: &str) -> Option<Param>;

    /// Reports an error of the function, once for each text.
    fn complain(&mut self, what: &str);

    /// Looks up a texture at (s, t), filtered with the differences dsdx, dtdx, dsdy, dtdy, into as many channels as
    /// `out` has.
    fn texture(&mut self, name: &str, at: [f32; 6], options: &[(&str, OptionValue<'_>)], out: &mut [f32]);

    /// Looks up an environment. The position is that of the grid's current point.
    fn environment(&mut self, name: &str, at: Spot, options: &[(&str, OptionValue<'_>)], out: &mut [f32]);

    /// Looks up a shadow map or set: 0 open, 1 blocked.
    fn shadow(&mut self, name: &str, at: Spot, options: &[(&str, OptionValue<'_>)], out: &mut [f32]);
}

/// True when an option takes a string.
pub fn is_text_option(name: &str) -> bool {
    matches!(name, "wrap" | "swrap" | "twrap" | "space" | "up" | "distribution" | "filename" | "filemode")
}
