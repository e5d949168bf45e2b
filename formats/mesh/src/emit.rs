//! Functions that make calls, with parameters, and with points and curves for which mesh files give no width.

use crate::smooth;
use granita_base::{BaseType, CurveBasis, Interp, Location, Param, ParamData, ParamType, Params, ShapeDesc};
use granita_scene::{Call, SceneSink, Stop};
use std::sync::Arc;

/// The width in pixels of a particle in a file that does not give its size.
pub(crate) const POINT_PIXELS: f32 = 2.0;
/// The width of lines, as a fraction of the diagonal of their bounding box.
const LINE_PART: f32 = 0.002;

/// The receiver of calls, and the name of the file for their positions.
pub(crate) struct Emit<'a> {
    sink: &'a mut dyn SceneSink,
    file: Arc<str>,
    /// The angle in radians up to which faces of meshes without normals are smooth.
    smooth: Option<f32>,
}

impl<'a> Emit<'a> {
    pub(crate) fn new(sink: &'a mut dyn SceneSink, file: Arc<str>) -> Self {
        Self { sink, file, smooth: None }
    }

    /// Gives meshes without normals smooth ones, when the scene sets `Attribute ("float user:smooth", ...)` to an angle
    /// above 0 degrees.
    pub(crate) fn smoothing(mut self) -> Self {
        let set = self.sink.attribute("user:smooth").and_then(|p| p.data.to_floats()?.first().copied());
        self.smooth =
            set.filter(|angle_deg| *angle_deg > 0.0).map(|angle_deg| angle_deg.min(180.0).to_radians());
        self
    }

    pub(crate) fn call(&mut self, call: Call, line: u32) -> Result<(), Stop> {
        self.sink.call(call, &Location::line(&self.file, line))
    }

    pub(crate) fn attribute(&mut self, param: Param, line: u32) -> Result<(), Stop> {
        self.call(Call::Attribute(param), line)
    }

    pub(crate) fn shape(&mut self, shape: ShapeDesc, mut params: Params, line: u32) -> Result<(), Stop> {
        if let Some(values) = self.smooth.and_then(|angle| smooth::normals(&shape, &params, angle)) {
            params.0.push(floats("N", BaseType::Normal, Interp::Linear, values));
        }
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

    /// Returns the text of `Attribute ("string user:NAME", ...)`, if the scene sets it.
    pub(crate) fn text(&self, name: &str) -> Option<String> {
        match self.sink.attribute(&format!("user:{name}"))?.data {
            ParamData::String(texts) => texts.first().map(|text| text.to_string()),
            _ => None,
        }
    }
}

/// Returns a parameter of floats with an interpolation.
pub(crate) fn floats(name: &str, base: BaseType, interp: Interp, values: impl Into<Arc<[f32]>>) -> Param {
    Param {
        name: name.into(),
        ty: ParamType::of(base).with_interp(interp),
        data: ParamData::Float(values.into()),
    }
}

/// Returns a parameter of one float.
pub(crate) fn float(name: &str, value: f32) -> Param {
    Param { name: name.into(), ty: ParamType::of(BaseType::Float), data: value.into() }
}

/// Returns a parameter of one colour.
pub(crate) fn color(name: &str, value: [f32; 3]) -> Param {
    Param { name: name.into(), ty: ParamType::of(BaseType::Color), data: ParamData::from(&value[..]) }
}

/// Returns a parameter of one string.
pub(crate) fn string(name: &str, value: &str) -> Param {
    Param { name: name.into(), ty: ParamType::of(BaseType::String), data: value.into() }
}

/// Returns the name of an object as a parameter, for messages and `Modify`.
pub(crate) fn object_name(name: &str) -> Param {
    string("name", name)
}

/// Returns the positions `P`, with three numbers each.
pub(crate) fn positions(values: impl Into<Arc<[f32]>>) -> Param {
    floats("P", BaseType::Point, Interp::Vertex, values)
}

/// Returns `Points` at `p`, with the width of points in a file that does not give it.
pub(crate) fn points(p: Vec<f32>) -> (ShapeDesc, Params) {
    let shape = ShapeDesc::Points { n: p.len() / 3 };
    (shape, Params(vec![positions(p), float("rasterwidth", POINT_PIXELS)]))
}

/// Returns straight lines through `nverts` points each. `p` holds the points of one curve after the other.
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

/// Returns the name by which the texture system finds an image that a file names. Relative names are not searched along
/// paths.
pub(crate) fn texture_path(path: &std::path::Path) -> String {
    let name = path.to_string_lossy();
    if path.is_absolute() || name.starts_with("./") || name.starts_with("../") {
        name.into_owned()
    } else {
        format!("./{name}")
    }
}

/// True when the colours of images with this name are usually encoded for a screen (sRGB), and are not linear.
pub(crate) fn is_screen_image(name: &str) -> bool {
    let ending = name.rsplit('.').next().unwrap_or("").to_ascii_lowercase();
    matches!(ending.as_str(), "png" | "jpg" | "jpeg" | "tga" | "bmp" | "gif" | "webp" | "qoi")
}
