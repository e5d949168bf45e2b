//! Options and attributes of RIB.

use crate::basis::Basis;
use crate::condition::Value;
use crate::declare::Given;
use crate::frame::{Display, Projection};
use crate::reader::{Done, Fault, Reader, plain};
use crate::request::{Arg, Request};
use granita_base::{BaseType, Color, Filter, ParamData};
use granita_scene::attribute::{Key, scope};
use granita_scene::{Call, attr};
use std::sync::Arc;

/// Returns all numbers among the arguments, in order, up to the first string.
pub(crate) fn numbers(args: &[Arg]) -> Vec<f32> {
    args.iter().map_while(Arg::floats).flat_map(|f| f.to_vec()).collect()
}

/// Returns exactly `N` numbers.
pub(crate) fn exactly<const N: usize>(request: &Request) -> Result<[f32; N], Fault> {
    let all = numbers(&request.args);
    let n = all.len();
    all.try_into().map_err(|_| Fault::Mistake(format!("needs {N} numbers, not {n}")))
}

/// Returns the string of the argument with an index.
pub(crate) fn string(request: &Request, at: usize) -> Result<Arc<str>, Fault> {
    let found = request.args.get(at).and_then(|a| a.strings()?.first().cloned());
    found.ok_or_else(|| Fault::Mistake(format!("argument {} should be a string", at + 1)))
}

/// The groups and names of `Option` that may be set without a declaration.
const OPTIONS: [(&str, &str); 10] = [
    ("searchpath", "shader"),
    ("searchpath", "texture"),
    ("searchpath", "archive"),
    ("searchpath", "procedural"),
    ("limits", "bucketsize"),
    ("limits", "gridsize"),
    ("limits", "texturememory"),
    ("limits", "threads"),
    ("statistics", "endofframe"),
    ("trace", "maxdepth"),
];

/// The groups and names of `Attribute` that may be set without a declaration.
const ATTRIBUTES: [(&str, &str); 19] = [
    ("identifier", "name"),
    ("displacementbound", "sphere"),
    ("displacementbound", "coordinatesystem"),
    ("visibility", "camera"),
    ("visibility", "transmission"),
    ("visibility", "diffuse"),
    ("visibility", "specular"),
    ("visibility", "trace"),
    ("visibility", "photon"),
    ("cull", "hidden"),
    ("dice", "binary"),
    ("dice", "rasterorient"),
    ("trimcurve", "sense"),
    ("light", "samples"),
    ("light", "nsamples"),
    ("trace", "bias"),
    ("shadow", "bias"),
    ("trace", "displacements"),
    ("trace", "samplemotion"),
];

impl Reader<'_> {
    /// Executes requests for options of the frame. Returns `None` for other requests.
    pub(crate) fn option_request(&mut self, request: &Request) -> Option<Done> {
        let done = match request.name.as_str() {
            "Format" => exactly::<3>(request).and_then(|[x, y, aspect]| {
                if !(1.0..=1.0e6).contains(&x) || !(1.0..=1.0e6).contains(&y) {
                    return Err(Fault::Mistake(format!("{x} x {y} pixels")));
                }
                self.options.resolution = [x as i32, y as i32];
                self.options.pixel_aspect = if aspect > 0.0 { aspect } else { 1.0 };
                Ok(())
            }),
            "FrameAspectRatio" => {
                exactly::<1>(request).map(|[a]| self.options.frame_aspect = Some(a).filter(|a| *a > 0.0))
            }
            "ScreenWindow" => exactly::<4>(request).map(|w| self.options.screen = Some(w)),
            "CropWindow" => exactly::<4>(request).map(|w| self.options.crop = Some(w)),
            "Clipping" => {
                exactly::<2>(request).map(|[near, far]| self.options.clipping = [near.max(1.0e-6), far])
            }
            "Shutter" => exactly::<2>(request).map(|s| self.options.shutter = s),
            "DepthOfField" if request.args.is_empty() => {
                self.options.lens = None;
                Ok(())
            }
            "DepthOfField" => exactly::<3>(request).map(|l| self.options.lens = Some(l)),
            "PixelSamples" => exactly::<2>(request).map(|s| self.options.samples = s),
            "Exposure" => exactly::<2>(request).map(|e| self.options.exposure = e),
            "Projection" => self.projection(request),
            "PixelFilter" => self.pixel_filter(request),
            "Quantize" => self.quantize(request),
            "Display" => self.display(request),
            "Hider" => self.hider(request),
            "ColorSamples" => self.color_samples(request),
            "Option" => self.option(request),
            "Declare" => string(request, 0).and_then(|name| {
                let declaration = string(request, 1)?;
                if self.declarations.declare(&name, &declaration) {
                    Ok(())
                } else {
                    Err(Fault::Mistake(format!("\"{declaration}\" is not a type")))
                }
            }),
            // These requests have no visible effect.
            "version" | "ErrorHandler" | "PixelVariance" | "RelativeDetail" | "ArchiveRecord" => Ok(()),
            "Imager" => Err(Fault::Unsupported("Imager is not supported".to_owned())),
            _ => return None,
        };
        Some(done)
    }

    fn projection(&mut self, request: &Request) -> Done {
        let name = string(request, 0)?;
        let params = self.params(request, 1);
        let fov = params.iter().find(|p| &*p.name == "fov").and_then(Given::float);
        self.options.projection = match &*name {
            "perspective" => Projection::Perspective(fov.unwrap_or(90.0)),
            "orthographic" => Projection::Orthographic,
            other => return Err(Fault::Mistake(format!("there is no projection \"{other}\""))),
        };
        if self.forget_transforms() {
            self.once("Projection: transformations in front of it are left out".to_owned());
        }
        Ok(())
    }

    fn pixel_filter(&mut self, request: &Request) -> Done {
        let name = string(request, 0)?;
        let width = numbers(request.args.get(1..).unwrap_or_default());
        let [x, y] = width[..] else { return Err(Fault::Mistake("needs two widths".to_owned())) };
        let known = match &*name {
            "bessel" | "disk" | "lanczos" => "gaussian",
            "separable-catmull-rom" => "catmull-rom",
            "bspline" => "b-spline",
            other => other,
        };
        if Filter::from_word(known).is_none() {
            return Err(Fault::Mistake(format!("there is no filter \"{name}\"")));
        }
        if known != &*name && matches!(&*name, "bessel" | "disk" | "lanczos") {
            self.once(format!("PixelFilter: \"{name}\" is not supported; gaussian is used"));
        }
        self.options.filter = (known.to_owned(), [x, y]);
        Ok(())
    }

    fn quantize(&mut self, request: &Request) -> Done {
        let kind = string(request, 0)?;
        let values = numbers(request.args.get(1..).unwrap_or_default());
        let values: [f32; 4] =
            values.try_into().map_err(|_| "needs one, min, max and amplitude".to_owned())?;
        let kind = if &*kind == "rgb" { "rgba" } else { &*kind };
        self.options.quantize.insert(kind.to_owned(), values);
        Ok(())
    }

    fn display(&mut self, request: &Request) -> Done {
        let (name, kind, mode) = (string(request, 0)?, string(request, 1)?, string(request, 2)?);
        let params = self.own_params(request, 3, &|name| matches!(name, "quantize" | "compression"));
        let (name, adds) = match name.strip_prefix('+') {
            Some(name) => (name, true),
            None => (&*name, false),
        };
        let mut kind = kind.to_string();
        if kind == "framebuffer" {
            self.once(format!("Display \"{name}\": there is no frame buffer; a file is written"));
            kind = String::new();
        }
        if !adds {
            self.options.displays.clear();
        }
        // Without an extension the type is the name of the format, and "file" means TIFF.
        if kind == "file" || kind.is_empty() {
            kind = if name.contains('.') { String::new() } else { "tiff".to_owned() };
        }
        self.options.displays.push(Display { name: name.to_owned(), kind, mode: mode.to_string(), params });
        Ok(())
    }

    fn hider(&mut self, request: &Request) -> Done {
        let name = string(request, 0)?;
        for given in self.own_params(request, 1, &|name| name == "depthfilter") {
            match (&*given.name, given.string()) {
                ("depthfilter", Some(filter)) => self.options.depth_filter = filter.to_string(),
                (name, _) => self.once(format!("Hider: parameter \"{name}\" is not supported")),
            }
        }
        match &*name {
            "hidden" | "stochastic" => Ok(()),
            other => {
                Err(Fault::Unsupported(format!("Hider: \"{other}\" is not supported; \"hidden\" is used")))
            }
        }
    }

    /// Sets the number of samples of a colour. Only the matrix that converts them to three numbers is stored.
    fn color_samples(&mut self, request: &Request) -> Done {
        let arrays: Vec<_> = request.args.iter().filter_map(Arg::floats).filter(|f| f.len() > 1).collect();
        let to_rgb = arrays.first().filter(|a| a.len().is_multiple_of(3));
        let to_rgb = to_rgb.ok_or_else(|| "needs two matrices of 3n numbers".to_owned())?;
        self.color_samples =
            (to_rgb.len() != 9 || arrays.len() > 1).then(|| (to_rgb.len() / 3, to_rgb.to_vec()));
        Ok(())
    }

    /// Returns a colour as three numbers.
    pub(crate) fn color(&self, values: &[f32]) -> Result<[f32; 3], Fault> {
        if let Some((n, to_rgb)) = &self.color_samples
            && values.len() == *n
        {
            let sum = |c: usize| values.iter().enumerate().map(|(i, v)| v * to_rgb[3 * i + c]).sum();
            return Ok([sum(0), sum(1), sum(2)]);
        }
        let n = values.len();
        values.try_into().map_err(|_| Fault::Mistake(format!("needs 3 numbers, not {n}")))
    }

    fn option(&mut self, request: &Request) -> Done {
        let group = string(request, 0)?;
        let known = |name: &str| OPTIONS.contains(&(&*group, name));
        for given in self.own_params(request, 1, &known) {
            let name = &*given.name;
            let int = |key: Key<scope::Global, i32>, value: f32| Some(key.param(value as i32));
            let first = given.float().unwrap_or(0.0);
            let param = match (&*group, name) {
                ("searchpath", "shader" | "texture" | "archive" | "procedural") => {
                    let key = match name {
                        "archive" => attr::PATH_INPUT,
                        "procedural" => attr::PATH_GENERATOR,
                        "texture" => attr::PATH_TEXTURE,
                        _ => attr::PATH_SHADER,
                    };
                    let path = given.string().map(|p| p.replace('@', "&")).unwrap_or_default();
                    Some(key.param(path.into()))
                }
                ("limits", "bucketsize") => {
                    if let [x, y] = given.floats()[..] {
                        self.options.bucketsize = Some([x as i32, y as i32]);
                    }
                    continue;
                }
                ("limits", "gridsize") => int(attr::LIMITS_GRIDSIZE, first),
                ("limits", "texturememory") => int(attr::LIMITS_TEXTUREMEMORY, first),
                ("limits", "threads") => int(attr::LIMITS_THREADS, first),
                ("statistics", "endofframe") => int(attr::STATISTICS_LEVEL, first),
                ("trace", "maxdepth") => int(attr::RAY_MAXDEPTH, first),
                ("user", _) => {
                    let value = match given.string() {
                        Some(text) => Value::Text(text.to_string()),
                        None => Value::Number(f64::from(first)),
                    };
                    self.variables.insert(format!("user:{name}"), value);
                    continue;
                }
                _ => {
                    self.once(format!("Option \"{group}\" \"{name}\" is not supported"));
                    continue;
                }
            };
            if let Some(param) = param {
                self.emit(Call::Attribute(param))?;
            }
        }
        Ok(())
    }

    /// Executes requests for attributes. Returns `None` for other requests.
    pub(crate) fn attribute_request(&mut self, request: &Request) -> Option<Done> {
        let done = match request.name.as_str() {
            "Color" | "Opacity" => {
                let key = if request.name == "Color" { attr::COLOR } else { attr::OPACITY };
                self.color(&numbers(&request.args)).and_then(|c| self.attribute(key, Color::from_array(c)))
            }
            "ShadingRate" => exactly::<1>(request).and_then(|[rate]| {
                // The rate is the area of a facet in pixels. The attribute is the number of points along the side of a
                // pixel.
                self.attribute(attr::SHADINGQUALITY, 1.0 / rate.max(1.0e-4).sqrt())
            }),
            "Sides" => exactly::<1>(request).and_then(|[n]| self.attribute(attr::TWOSIDED, n != 1.0)),
            "Matte" => {
                exactly::<1>(request).and_then(|[on]| self.attribute(attr::HOLDOUT, i32::from(on != 0.0)))
            }
            "Orientation" => string(request, 0).and_then(|w| self.attribute(attr::ORIENTATION, w)),
            "ReverseOrientation" => self.attribute(attr::ORIENTATION, "reverse".into()),
            "TextureCoordinates" => exactly::<8>(request).map(|c| self.local.corners = Some(c)),
            "Basis" => self.basis(request),
            "Attribute" => self.set_attribute(request),
            "ShadingInterpolation" | "GeometricApproximation" | "GeometricRepresentation" | "Bound" => Ok(()),
            "Detail" => {
                self.local.detail = true;
                self.once("Detail: only the finest level of detail is shown".to_owned());
                Ok(())
            }
            // The finest level of detail is visible at any size.
            "DetailRange" => exactly::<4>(request).map(|[.., most]| self.local.coarse = most < 1.0e30),
            "Interior" | "Exterior" => Err(Fault::Unsupported(format!("{} is not supported", request.name))),
            _ => return None,
        };
        Some(done)
    }

    fn basis(&mut self, request: &Request) -> Done {
        let mut rest = request.args.iter();
        let mut one = || -> Result<Basis, Fault> {
            let (matrix, step) = (rest.next(), rest.next());
            let step = step.and_then(|s| s.ints()?.first().copied()).and_then(|s| usize::try_from(s).ok());
            let step = step
                .filter(|s| (1..=4).contains(s))
                .ok_or_else(|| "needs basis, step, basis, step".to_owned())?;
            let basis = match matrix.and_then(Arg::strings).and_then(|s| s.first().cloned()) {
                Some(name) => Basis::named(&name).map(|b| b.with_step(step)),
                None => matrix.and_then(Arg::floats).and_then(|m| Basis::of(&m, step)),
            };
            basis.ok_or_else(|| Fault::Mistake("a basis is a name or 16 numbers".to_owned()))
        };
        (self.local.ubasis, self.local.vbasis) = (one()?, one()?);
        Ok(())
    }

    fn set_attribute(&mut self, request: &Request) -> Done {
        let group = string(request, 0)?;
        let known = |name: &str| ATTRIBUTES.contains(&(&*group, name));
        for given in self.own_params(request, 1, &known) {
            let name = &*given.name;
            let first = given.float().unwrap_or(0.0);
            let on = first != 0.0;
            match (&*group, name) {
                ("identifier", "name") => {
                    let text = given.string().cloned().unwrap_or_default();
                    self.attribute(attr::NAME, text)?;
                }
                ("displacementbound", "sphere") => {
                    self.attribute(attr::DISPLACE_MAXRADIUS, first.max(0.0))?;
                    // A coordinate system named in the same request comes later and takes precedence.
                    self.attribute(attr::DISPLACE_MAXSPACE, "object".into())?;
                }
                ("displacementbound", "coordinatesystem") => {
                    let space = given.string().cloned().unwrap_or_else(|| "object".into());
                    self.attribute(attr::DISPLACE_MAXSPACE, space)?;
                }
                (
                    "visibility",
                    set @ ("camera" | "transmission" | "diffuse" | "specular" | "trace" | "photon"),
                ) => {
                    let sign = if on { '+' } else { '-' };
                    self.attribute(attr::GEOMETRYSET, format!("{sign}{set}").into())?;
                }
                ("cull", "hidden") => self.attribute(attr::CULL_OCCLUSION, on)?,
                ("dice", "binary") => self.attribute(attr::DICE_BINARY, on)?,
                ("dice", "rasterorient") => self.attribute(attr::DICE_RASTERORIENT, on)?,
                ("trimcurve", "sense") => {
                    let sense = given.string().cloned().unwrap_or_else(|| "inside".into());
                    self.attribute(attr::TRIMCURVE_SENSE, sense)?;
                }
                ("light", "samples" | "nsamples") => {
                    self.attribute(attr::LIGHT_NSAMPLES, first.max(1.0) as i32)?
                }
                ("trace", "bias") | ("shadow", "bias") => self.attribute(attr::SHADOW_BIAS, first)?,
                ("trace", "displacements") => self.attribute(attr::RAY_DISPLACE, on)?,
                ("trace", "samplemotion") => self.attribute(attr::RAY_MOTION, on)?,
                ("user", _) => {
                    let mut param = given.constant();
                    param.name = format!("user:{name}").into();
                    if matches!(param.ty.base, BaseType::Int) {
                        param.data = param.data.to_ints().map_or(param.data.clone(), ParamData::Int);
                    }
                    self.emit(Call::Attribute(param))?;
                }
                _ => self.once(format!("Attribute \"{group}\" \"{name}\" is not supported")),
            }
        }
        Ok(())
    }

    /// Adds a name to the geometry sets of the following geometry.
    pub(crate) fn add_to_set(&mut self, set: &str) -> Done {
        self.emit(Call::Attribute(plain("geometryset", BaseType::String, format!("+{set}").as_str())))
    }
}
