//! The options of a frame, and the attributes and outputs that they become.

use crate::declare::{Declared, Given};
use granita_base::{BaseType, Param, ParamData, ParamType, Params};
use granita_scene::{Call, attr};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The name of the camera. RIB has only one.
pub(crate) const CAMERA: &str = "camera";

/// The projection of camera space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Projection {
    Orthographic,
    /// The field of view in degrees.
    Perspective(f32),
}

/// The arguments of `Display`.
#[derive(Clone, Debug)]
pub(crate) struct Display {
    pub(crate) name: String,
    pub(crate) kind: String,
    pub(crate) mode: String,
    pub(crate) params: Vec<Given>,
}

/// The current options, with the defaults of the RenderMan interface.
#[derive(Clone, Debug)]
pub(crate) struct Options {
    pub(crate) resolution: [i32; 2],
    pub(crate) pixel_aspect: f32,
    pub(crate) frame_aspect: Option<f32>,
    pub(crate) screen: Option<[f32; 4]>,
    pub(crate) crop: Option<[f32; 4]>,
    pub(crate) clipping: [f32; 2],
    pub(crate) shutter: [f32; 2],
    pub(crate) projection: Projection,
    pub(crate) lens: Option<[f32; 3]>,
    pub(crate) samples: [f32; 2],
    pub(crate) filter: (String, [f32; 2]),
    pub(crate) depth_filter: String,
    pub(crate) exposure: [f32; 2],
    /// Maps "rgba", "z" or the name of a variable to one, min, max and dither.
    pub(crate) quantize: BTreeMap<String, [f32; 4]>,
    pub(crate) displays: Vec<Display>,
    pub(crate) bucketsize: Option<[i32; 2]>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            resolution: [640, 480],
            pixel_aspect: 1.0,
            frame_aspect: None,
            screen: None,
            crop: None,
            clipping: [1.0e-3, 1.0e6],
            shutter: [0.0, 0.0],
            projection: Projection::Orthographic,
            lens: None,
            samples: [2.0, 2.0],
            filter: ("gaussian".to_owned(), [2.0, 2.0]),
            depth_filter: "min".to_owned(),
            exposure: [1.0, 1.0],
            quantize: BTreeMap::new(),
            displays: Vec::new(),
            bucketsize: None,
        }
    }
}

fn param(declaration: &str, data: impl Into<ParamData>) -> Option<Param> {
    Param::declared(declaration, data).ok()
}

impl Options {
    /// Returns the screen window. If it is not given, its size follows from the aspect ratio of the frame.
    fn screen(&self) -> [f32; 4] {
        if let Some(screen) = self.screen {
            return screen;
        }
        let [x, y] = self.resolution.map(|r| r as f32);
        let aspect = self.frame_aspect.unwrap_or(x * self.pixel_aspect / y);
        if aspect >= 1.0 { [-aspect, aspect, -1.0, 1.0] } else { [-1.0, 1.0, -1.0 / aspect, 1.0 / aspect] }
    }

    /// Returns the calls before `World`. `named` returns the types of variables that displays show. Messages about
    /// features that must be left out go to `wrong`.
    pub(crate) fn calls(
        &self,
        named: &dyn Fn(&str) -> Option<Declared>,
        wrong: &mut dyn FnMut(String),
    ) -> Vec<Call> {
        let (kind, fov) = match self.projection {
            Projection::Orthographic => ("orthographic", 90.0),
            Projection::Perspective(fov) => ("perspective", fov),
        };
        let quality = self.samples.map(|s| (s.round() as i32).max(1));
        let mut params = vec![
            param("string projection", kind),
            param("float fov", fov),
            param("int[2] resolution", &self.resolution[..]),
            param("float pixelaspect", self.pixel_aspect),
            param("float[4] screen", &self.screen()[..]),
            param("float near", self.clipping[0]),
            param("float far", self.clipping[1]),
            param("float[2] shutter", &self.shutter[..]),
            param("int[2] spatialquality", &quality[..]),
        ];
        if let Some(crop) = &self.crop {
            params.push(param("float[4] crop", &crop[..]));
        }
        if let Some([fstop, length, distance]) = self.lens {
            params.push(param("float fstop", fstop));
            params.push(param("float focallength", length));
            params.push(param("float focaldistance", distance));
        }
        if let Some(size) = &self.bucketsize {
            params.push(param(&attr::LIMITS_BUCKETSIZE.row().declaration(), &size[..]));
        }
        let mut calls: Vec<Call> = params.into_iter().flatten().map(Call::Attribute).collect();
        calls.extend(self.displays.iter().filter_map(|d| self.output(d, named, wrong)));
        calls
    }

    /// Returns the `Output` call of a display; `None` (reported) when its variable has no known type.
    fn output(
        &self,
        display: &Display,
        named: &dyn Fn(&str) -> Option<Declared>,
        wrong: &mut dyn FnMut(String),
    ) -> Option<Call> {
        let Display { name, kind, mode, .. } = display;
        let format = format(kind, name).unwrap_or_else(|| {
            wrong(format!("Display: no format belongs to \"{name}\" of type \"{kind}\"; TIFF is written"));
            "tiff".to_owned()
        });
        let depth = mode == "z";
        let data = display.data(named, wrong)?;
        let data = if data.is_empty() { "rgba".to_owned() } else { data };
        let data = if depth && self.depth_filter == "midpoint" { "avgz".to_owned() } else { data };
        let (quantize, dither) = self.quantize(mode);
        let (filter, width) = self.filter(depth);
        let mut params: Params = [
            param("string filter", filter),
            param("float[2] filterwidth", &width[..]),
            param("int[4] quantize", &quantize[..]),
            param("float dither", dither),
        ]
        .into_iter()
        .flatten()
        .collect();
        if !depth {
            let [gain, gamma] = self.exposure;
            [param("float gain", gain), param("float gamma", gamma)]
                .into_iter()
                .flatten()
                .for_each(|p| params.set(p));
        }
        display.set_own(&mut params);
        Some(Call::Output {
            name: name.as_str().into(),
            format: format.into(),
            data: data.into(),
            camera: Arc::from(CAMERA),
            params,
        })
    }

    /// Returns zero, one, min and max of the integers of an image of a mode, and the amplitude of their dither. All
    /// are 0 when the image has floats.
    fn quantize(&self, mode: &str) -> ([i32; 4], f32) {
        let depth = mode == "z";
        let kind = if depth { "z" } else { "rgba" };
        let default = if depth { [0.0; 4] } else { [255.0, 0.0, 255.0, 0.5] };
        let [one, min, max, dither] =
            *self.quantize.get(mode).or_else(|| self.quantize.get(kind)).unwrap_or(&default);
        let quantize = if one == 0.0 { [0; 4] } else { [0.0, one, min, max].map(|v| v as i32) };
        (quantize, if quantize == [0; 4] { 0.0 } else { dither })
    }

    /// Returns the pixel filter and its width in pixels, of depths or of colours.
    fn filter(&self, depth: bool) -> (&str, [f32; 2]) {
        match depth {
            true if matches!(self.depth_filter.as_str(), "min" | "max" | "average") => {
                (self.depth_filter.as_str(), [1.0; 2])
            }
            true => ("min", [1.0; 2]),
            false => (self.filter.0.as_str(), self.filter.1),
        }
    }
}

impl Display {
    /// Returns the data of the output that shows the mode; `None` (reported) for a variable whose type is not known.
    /// The result may be empty for "az", which has no colours.
    fn data(
        &self,
        named: &dyn Fn(&str) -> Option<Declared>,
        wrong: &mut dyn FnMut(String),
    ) -> Option<String> {
        let Self { name, mode, .. } = self;
        Some(match mode.as_str() {
            "rgb" | "rgba" | "z" => mode.clone(),
            "a" => {
                wrong(format!("Display \"{name}\": opacity alone is not supported; rgba is written"));
                "rgba".to_owned()
            }
            "rgbz" | "rgbaz" | "az" => {
                wrong(format!(
                    "Display \"{name}\": depths come in an image of their own, with a Display of mode \"z\""
                ));
                mode[..mode.len() - 1].replace('a', "").replace("rgb", "rgba")
            }
            variable => match named(variable) {
                Some(declared) => format!("{} {}", declared.base.word(), shown_variable(variable)),
                None => {
                    wrong(format!("Display \"{name}\": the type of \"{variable}\" is not declared"));
                    return None;
                }
            },
        })
    }

    /// Sets the parameters of the display itself, which replace those of the options.
    fn set_own(&self, params: &mut Params) {
        for given in &self.params {
            match &*given.name {
                "quantize" if given.floats().len() == 4 => {
                    let values: Vec<i32> = given.floats().iter().map(|v| *v as i32).collect();
                    param("int[4] quantize", &values[..]).into_iter().for_each(|p| params.set(p));
                }
                "compression" => params.set(given.constant()),
                _ => params.set(Param {
                    name: given.name.clone(),
                    ty: ParamType { base: given.declared.base, ..given.constant().ty },
                    data: given.data.clone(),
                }),
            }
        }
    }
}

/// Returns the name in the scene interface of a variable that a display shows. The variable may have a type.
fn shown_variable(variable: &str) -> &str {
    match variable.split_whitespace().last().unwrap_or(variable) {
        "Ci" => "C",
        "Oi" => "opacity",
        // Cs is the variable of the surface, not of the light that leaves it. In the scene interface s and t are u and
        // v by default.
        "Cs" => "primitive:C",
        "Os" => "primitive:opacity",
        "s" => "primitive:s",
        "t" => "primitive:t",
        other => other,
    }
}

/// Returns the image format of a display type, or else of the extension of a name.
fn format(kind: &str, name: &str) -> Option<String> {
    let known = |word: &str| {
        Some(match word {
            "tiff" | "tif" => "tiff",
            "exr" | "openexr" => "OpenEXR",
            "png" => "png",
            "jpeg" | "jpg" => "jpeg",
            "tga" | "targa" => "targa",
            "bmp" => "bmp",
            "sgi" => "sgi",
            "iff" => "iff",
            "pnm" | "ppm" => "pnm",
            "hdr" => "hdr",
            "shadow" | "zfile" | "shad" => "shadow",
            _ => return None,
        })
    };
    let ending = name.rsplit_once('.').map(|(_, e)| e.to_ascii_lowercase());
    known(&kind.to_ascii_lowercase()).or_else(|| known(ending.as_deref()?)).map(str::to_owned)
}

/// Returns the type of a variable that every surface has.
pub(crate) fn shading_variable(name: &str) -> Option<Declared> {
    let base = match name {
        "Ci" | "Oi" | "Cs" | "Os" => BaseType::Color,
        "P" => BaseType::Point,
        "N" | "Ng" => BaseType::Normal,
        "I" | "dPdu" | "dPdv" => BaseType::Vector,
        "s" | "t" | "u" | "v" => BaseType::Float,
        _ => return None,
    };
    Some(Declared { class: crate::declare::Class::Varying, base, array: None })
}
