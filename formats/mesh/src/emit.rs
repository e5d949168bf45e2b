//! Calls in the making: parameters, points and curves that mesh files have no width for.

use granita_base::{BaseType, CurveBasis, Interp, Location, Param, ParamData, ParamType, Params, ShapeDesc};
use granita_scene::{Call, SceneSink, Stop};
use std::sync::Arc;

/// The width in pixels of a particle of a file that does not give its size.
pub(crate) const POINT_PIXELS: f32 = 2.0;
/// Width of lines, as a part of the diagonal of the box around them.
const LINE_PART: f32 = 0.002;

/// The receiver, and the name of the file for its calls.
pub(crate) struct Emit<'a> {
    sink: &'a mut dyn SceneSink,
    file: Arc<str>,
}

impl<'a> Emit<'a> {
    pub(crate) fn new(sink: &'a mut dyn SceneSink, file: Arc<str>) -> Self {
        Self { sink, file }
    }

    pub(crate) fn call(&mut self, call: Call, line: u32) -> Result<(), Stop> {
        self.sink.call(call, &Location::line(&self.file, line))
    }

    pub(crate) fn attribute(&mut self, param: Param, line: u32) -> Result<(), Stop> {
        self.call(Call::Attribute(param), line)
    }

    pub(crate) fn shape(&mut self, shape: ShapeDesc, params: Params, line: u32) -> Result<(), Stop> {
        self.call(Call::Shape { shape: Box::new(shape), params }, line)
    }

    pub(crate) fn in_world(&self) -> bool {
        self.sink.in_world()
    }

    /// True when the scene enables materials, lights or cameras of files. `Attribute ("int user:NAME", 0)` disables
    /// them.
    pub(crate) fn wants(&self, name: &str) -> bool {
        let set = self.sink.attribute(&format!("user:{name}"));
        set.and_then(|p| p.data.to_ints()?.first().copied()).is_none_or(|v| v != 0)
    }
}

/// Varying floats.
pub(crate) fn floats(name: &str, base: BaseType, interp: Interp, values: impl Into<Arc<[f32]>>) -> Param {
    Param {
        name: name.into(),
        ty: ParamType::of(base).with_interp(interp),
        data: ParamData::Float(values.into()),
    }
}

/// One float.
pub(crate) fn float(name: &str, value: f32) -> Param {
    Param { name: name.into(), ty: ParamType::of(BaseType::Float), data: value.into() }
}

/// One colour.
pub(crate) fn color(name: &str, value: [f32; 3]) -> Param {
    Param { name: name.into(), ty: ParamType::of(BaseType::Color), data: ParamData::from(&value[..]) }
}

/// One string.
pub(crate) fn string(name: &str, value: &str) -> Param {
    Param { name: name.into(), ty: ParamType::of(BaseType::String), data: value.into() }
}

/// The name of an object, for messages and `Modify`.
pub(crate) fn object_name(name: &str) -> Param {
    string("name", name)
}

/// Positions `P`, three numbers each.
pub(crate) fn positions(values: impl Into<Arc<[f32]>>) -> Param {
    floats("P", BaseType::Point, Interp::Vertex, values)
}

/// `Points` of `P`, and the size that they have where the file gives none.
pub(crate) fn points(p: Vec<f32>) -> (ShapeDesc, Params) {
    let shape = ShapeDesc::Points { n: p.len() / 3 };
    (shape, Params(vec![positions(p), float("rasterwidth", POINT_PIXELS)]))
}

/// Straight lines through `nverts` points each, which `p` holds one curve behind the other.
pub(crate) fn lines(p: Vec<f32>, nverts: usize) -> (ShapeDesc, Params) {
    let ncurves = p.len() / 3 / nverts.max(1);
    let mut min = [f32::INFINITY; 3];
    let mut max = [f32::NEG_INFINITY; 3];
    for (i, x) in p.iter().enumerate() {
        min[i % 3] = min[i % 3].min(*x);
        max[i % 3] = max[i % 3].max(*x);
    }
    let diagonal = (0..3).map(|i| f64::from(max[i]) - f64::from(min[i])).map(|d| d * d).sum::<f64>().sqrt();
    let width = float("width", (diagonal as f32) * LINE_PART);
    let shape = ShapeDesc::Curves { basis: CurveBasis::Linear, ncurves, nverts };
    (shape, Params(vec![positions(p), width]))
}

/// The name under which the texture system finds an image that a file names. Relative names are not searched along
/// paths.
pub(crate) fn texture_path(path: &std::path::Path) -> String {
    let name = path.to_string_lossy();
    if path.is_absolute() || name.starts_with("./") || name.starts_with("../") {
        name.into_owned()
    } else {
        format!("./{name}")
    }
}

/// True when the bytes of images of this name are, by custom, encoded for a screen (sRGB) and not linear light.
pub(crate) fn is_screen_picture(name: &str) -> bool {
    let ending = name.rsplit('.').next().unwrap_or("").to_ascii_lowercase();
    matches!(ending.as_str(), "png" | "jpg" | "jpeg" | "tga" | "bmp" | "gif" | "webp" | "qoi")
}
