// tidy: long: the parameters of an Output call and their consequences are decided in one place
//! The images of a frame: their content, and how they are written (reference 4.2, 7.3).

mod features;
mod filters;
mod settings;

use super::cryptomatte::{MatteKind, MatteLayer, Mattes, RANKS};
use super::parts::Part;
use super::writer::{ImageWriter, Shown};
use crate::{CameraView, RenderError};
pub(crate) use features::FEATURES;
use features::of_denoiser;
use filters::{filter_spec, wrong_layer_filter};
use granita_base::{
    BaseType, Color, Files, Location, Param, ParamData, ParamType, Params, Reporter, Severity,
};
use granita_gsl::ir::ValueType;
use granita_hider::film::{FilterSpec, PixelFilter};
use granita_hider::{Wanted, WantedVariable};
use granita_image::{CreateOptions, Format, FormatRegistry, ImageSpec, PixelType, Placement, Quantize};
use granita_scene::attribute::{Scope, TABLE};
use granita_scene::{Output, Scene, attr};
pub(crate) use settings::ImagePasses;
use settings::{of_passes, settings};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Returns the parameters of `Output` that the renderer itself interprets. All others go to the format.
fn own_parameters() -> impl Iterator<Item = &'static str> {
    TABLE.iter().filter(|row| row.scope == Scope::Output).map(|row| row.name)
}

/// The largest number of bytes of the pixels of one image while the frame is rendered.
const MAX_IMAGE_BYTES: u64 = 1 << 37;

/// The content of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Data {
    Color {
        alpha: bool,
    },
    Depth {
        middle: bool,
    },
    /// The noise of each pixel of the colours, of an image of passes.
    Error,
    /// Opacity against depth, with this number of thresholds.
    Volume {
        depths: usize,
    },
    /// The objects or materials with their coverages, an even number of them.
    Mattes {
        kind: MatteKind,
        ranks: usize,
    },
    /// A shader variable. For an array there is one name per element: `name[0]` and so on.
    Variable {
        names: Vec<Arc<str>>,
        ty: ValueType,
    },
}

impl Data {
    /// Returns the name by which a parameter selects the layer; `None` for a volume shadow.
    fn layer_name(&self) -> Option<&str> {
        match self {
            Self::Color { alpha: false } => Some("rgb"),
            Self::Color { alpha: true } => Some("rgba"),
            Self::Depth { middle: false } => Some("z"),
            Self::Depth { middle: true } => Some("avgz"),
            Self::Error => Some("error"),
            Self::Volume { .. } => None,
            Self::Mattes { kind, .. } => Some(kind.word()),
            Self::Variable { names, .. } => {
                names.first().map(|name| name.split_once('[').map_or(&**name, |(name, _)| name))
            }
        }
    }

    /// Returns the names of its channels, which begin with the name of the variable when `is_one_of` several layers is
    /// true.
    fn channel_names(&self, is_one_of: bool) -> Vec<String> {
        let strings = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
        let (elements, ty) = match self {
            Self::Color { alpha: false } | Self::Error => return strings(&["R", "G", "B"]),
            Self::Color { alpha: true } => return strings(&["R", "G", "B", "A"]),
            Self::Depth { middle: true } if is_one_of => return strings(&["avgz"]),
            Self::Depth { .. } => return strings(&["Z"]),
            Self::Volume { depths } => {
                let depths = (0..*depths).map(|i| format!("z{i}"));
                return strings(&["zopaque", "alpha"]).into_iter().chain(depths).collect();
            }
            Self::Mattes { kind, ranks } => return kind.channel_names(*ranks),
            Self::Variable { names, ty } => (names, *ty),
        };
        let n = ty.components();
        if n == 1 {
            return elements.iter().map(|name| name.to_string()).collect();
        }
        if elements.len() == 1 && !is_one_of {
            return if n == 3 { strings(&["R", "G", "B"]) } else { ImageSpec::default_channels(n) };
        }
        let part = |c: usize| match n {
            3 if is_one_of && ty != ValueType::Color => ["X", "Y", "Z"][c].to_owned(),
            3 => ["R", "G", "B"][c].to_owned(),
            _ => c.to_string(),
        };
        elements.iter().flat_map(|e| (0..n).map(move |c| format!("{e}.{}", part(c)))).collect()
    }
}

/// The largest number of elements of an array that an image can show.
const MAX_ELEMENTS: u32 = 1024;

/// The files of the images of a frame.
#[derive(Debug, Default)]
pub(crate) struct WrittenFiles(BTreeMap<PathBuf, PathBuf>);

impl WrittenFiles {
    /// Returns the name of an earlier image that is written to the same file under another name. An image of the
    /// same name is the other view of a stereo camera.
    pub(crate) fn taken_by(&mut self, image: &OutputImage) -> Option<PathBuf> {
        let path = &image.path;
        if image.is_shown || path.metadata().is_ok_and(|m| !m.is_file()) {
            return None;
        }
        let parent = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let place = parent.canonicalize().unwrap_or_else(|_| parent.to_owned());
        let place = place.join(path.file_name()?);
        let other = self.0.entry(place).or_insert_with(|| path.clone());
        // The names are compared as text, because paths that differ only in a "./" are equal otherwise.
        (other.as_os_str() != path.as_os_str()).then(|| other.clone())
    }
}

/// The requests of the outputs of one camera to the hider.
#[derive(Clone, Debug, Default)]
pub(crate) struct OutputSet {
    /// The images in order of declaration.
    pub(crate) images: Vec<OutputImage>,
    /// The shader variables to compute.
    pub(crate) variables: Vec<(Arc<str>, ValueType)>,
    /// The requested sample channels.
    pub(crate) wanted: Wanted,
    /// True when any image shows colours or variables, so that surfaces must be shaded.
    pub(crate) needs_shading: bool,
    /// True when surfaces behind the first one count.
    pub(crate) needs_second_surface: bool,
    /// True when colours are the albedo of surfaces.
    pub(crate) shows_albedo: bool,
}

/// Channels of an image that are filtered together.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ImageLayer {
    /// The name by which parameters select it.
    pub(crate) name: Arc<str>,
    pub(crate) filter: FilterSpec,
    /// The sample channels that are filtered into its channels.
    pub(crate) channels: Vec<usize>,
    /// True when gain and gamma apply, except to its alpha.
    pub(crate) is_color: bool,
    /// The Cryptomatte that it is, whose values are not filtered samples.
    pub(crate) mattes: Option<MatteLayer>,
}

/// One image to make.
#[derive(Clone, Debug)]
pub(crate) struct OutputImage {
    /// The file name.
    pub(crate) path: PathBuf,
    format: String,
    /// At least one layer.
    pub(crate) layers: Vec<ImageLayer>,
    names: Vec<String>,
    params: Params,
    /// The filtered pixels of the crop window, with interleaved channels, when the frame is done.
    pub(crate) pixels: Vec<f32>,
    /// True when it is shown while it is rendered, by a format of "rectangles".
    pub(crate) is_shown: bool,
    /// The viewer that showed it, when the frame is done.
    pub(crate) shown: Shown,
    /// The result of an image that was written while the frame was rendered.
    pub(crate) written: Option<Result<(), String>>,
    /// "opaquewidth" of an image whose pixels are texels of a volume shadow map and not filtered samples.
    pub(crate) opaque_width: Option<f32>,
    /// True for an image of the noise of the colours that its passes have.
    pub(crate) is_error: bool,
    /// True when the noise of its colours is removed.
    pub(crate) is_denoised: bool,
    /// The name of the library that removed its noise.
    pub(crate) denoised_by: Option<String>,
    /// The part of a file that it becomes; `None` for a file of its own.
    pub(crate) part: Option<Part>,
    /// The attribute "render:samples" of the scene.
    samples: f32,
    /// The passes whose sum it is; `None` for a frame of its own.
    pub(crate) passes: Option<ImagePasses>,
}

impl OutputSet {
    /// Plans the outputs of one camera. Those that cannot be made are reported and left out.
    pub(crate) fn new(
        outputs: &[&Output],
        camera: &CameraView,
        registry: &FormatRegistry,
        reporter: &Reporter,
    ) -> Result<Self, RenderError> {
        let mut set = Self::default();
        let mut datas = Vec::new();
        for output in outputs {
            if let Some(of_layers) = accepted(output, registry, reporter) {
                of_layers.iter().for_each(|data| set.ask_for(data));
                datas.push((*output, of_layers));
            }
        }
        let mut offset = 0;
        for (_, ty) in &set.variables {
            let width = ty.components();
            let is_color = *ty == ValueType::Color;
            set.wanted.variables.push(WantedVariable { offset, width, is_color });
            offset += width;
        }
        for (output, of_layers) in datas {
            let image = set.image(output, &of_layers, camera, registry, reporter)?;
            let name = |image: &OutputImage| image.part.as_ref().map(|part| part.name.clone());
            if let Some(part) = name(&image)
                && set
                    .images
                    .iter()
                    .any(|other| other.path == image.path && name(other).as_ref() == Some(&part))
            {
                let what = format!("two images are the part \"{part}\"; the second one is left out");
                report(output, reporter, Severity::Error, what);
                continue;
            }
            set.images.push(image);
        }
        Ok(set)
    }

    /// Adds what a layer needs to what the samples must hold.
    fn ask_for(&mut self, data: &Data) {
        match data {
            Data::Color { .. } | Data::Error => self.needs_shading = true,
            Data::Volume { .. } => (),
            // The mattes follow with the scene.
            Data::Mattes { .. } => self.needs_shading = true,
            Data::Depth { middle } => {
                self.wanted.depths = true;
                self.needs_second_surface |= *middle;
            }
            Data::Variable { names, ty } => {
                self.needs_shading = true;
                for name in names {
                    if !self.variables.iter().any(|(n, t)| n == name && t == ty) {
                        self.variables.push((name.clone(), *ty));
                    }
                }
            }
        }
    }

    /// Returns the sample channels of a layer.
    fn channels(&self, data: &Data) -> Vec<usize> {
        match data {
            Data::Color { alpha } => (0..3 + usize::from(*alpha)).collect(),
            Data::Error => (0..3).collect(),
            Data::Depth { middle } => vec![4 + usize::from(*middle)],
            // There are no channels of samples. These are only counted.
            Data::Volume { .. } | Data::Mattes { .. } => vec![0; data.channel_names(false).len()],
            Data::Variable { names, ty } => {
                let of = |name: &Arc<str>| {
                    let same = |v: &(Arc<str>, ValueType)| v.0 == *name && v.1 == *ty;
                    let index = self.variables.iter().position(same).unwrap_or(0);
                    let first = self.wanted.variable_channel(index);
                    first..first + ty.components()
                };
                names.iter().flat_map(of).collect()
            }
        }
    }

    fn image(
        &self,
        output: &Output,
        of_layers: &[Data],
        camera: &CameraView,
        registry: &FormatRegistry,
        reporter: &Reporter,
    ) -> Result<OutputImage, RenderError> {
        let format = registry.by_name(&output.format);
        let is_shown = format.as_ref().is_some_and(|f| f.supports("rectangles"));
        let (mut layers, mut names) = (Vec::with_capacity(of_layers.len()), Vec::new());
        let is_one_of = of_layers.len() > 1;
        let part = Some(output.part()).filter(|part| !part.is_empty() && !is_shown).map(Part::new);
        for data in of_layers {
            names.extend(data.channel_names(is_one_of));
            let filter = filter_spec(output, data, is_one_of, reporter);
            let is_color = matches!(data, Data::Color { .. } | Data::Variable { ty: ValueType::Color, .. });
            let mattes = match data {
                Data::Mattes { kind, ranks } => Some(MatteLayer::new(*kind, *ranks)),
                _ => None,
            };
            let name = data.layer_name().unwrap_or_default().into();
            layers.push(ImageLayer { name, filter, channels: self.channels(data), is_color, mattes });
        }
        let is_volume = matches!(of_layers, [Data::Volume { .. }]);
        let mut params = params(output, of_layers, is_shown);
        if layers.iter().any(|layer| layer.mattes.is_some()) {
            keep_ids(output, &mut params, reporter);
        }
        let lost = format.and_then(|f| f.leaves_out(std::path::Path::new(&*output.name), names.len()));
        lost.into_iter().for_each(|what| mistake(output, reporter, "left out", what));
        let crop = &camera.crop;
        let values = (crop.width() as u64)
            .checked_mul(crop.height() as u64)
            .and_then(|n| n.checked_mul(names.len() as u64 * 4))
            .unwrap_or(u64::MAX);
        if values > MAX_IMAGE_BYTES {
            return Err(RenderError::Limit {
                what: "size of an image in bytes",
                asked: values,
                max: MAX_IMAGE_BYTES,
            });
        }
        Ok(OutputImage {
            path: match &*output.part() {
                // A viewer shows the parts as images of their own.
                part if is_shown && !part.is_empty() => PathBuf::from(format!("{} {part}", output.name)),
                _ => PathBuf::from(&*output.name),
            },
            format: output.format.to_string(),
            pixels: Vec::new(),
            is_shown,
            shown: Shown::default(),
            written: None,
            layers,
            names,
            params,
            opaque_width: is_volume.then(|| opaque_width(output, reporter)),
            is_error: matches!(of_layers, [Data::Error]),
            is_denoised: false,
            denoised_by: None,
            part,
            samples: 1.0,
            passes: None,
        })
    }

    /// Leaves out the images of errors, which a frame without passes does not have. Returns their file names.
    pub(crate) fn leave_out_errors(&mut self) -> Vec<PathBuf> {
        self.images.extract_if(.., |image| image.is_error).map(|image| image.path).collect()
    }

    /// Sets what images have of a scene: its settings, the filter of those that are denoised, and its mattes if any are
    /// requested.
    pub(crate) fn set_scene(&mut self, scene: &Scene) {
        if scene.get(attr::RENDER_DENOISE) != 0 {
            self.share_no_samples();
        }
        let samples = scene.get(attr::RENDER_SAMPLES);
        self.images.iter_mut().for_each(|image| image.samples = samples);
        let layers = self.images.iter_mut().flat_map(|image| &mut image.layers);
        let mut layers = layers.filter_map(|layer| layer.mattes.as_mut()).peekable();
        if layers.peek().is_none() {
            return;
        }
        let mattes = Mattes::new(scene);
        layers.for_each(|layer| layer.set(&mattes));
        self.wanted.mattes = Some(mattes.of_primitives);
    }

    /// Returns the same images for the left and for the right eye of a stereo camera, with their file names.
    ///
    /// Two images of one name are reported, because the second one replaces the first.
    pub(crate) fn for_eyes(self, reporter: &Reporter) -> Vec<Self> {
        let (mut left, mut right) = (self.clone(), self);
        let eyes = [("left", attr::STEREO_LEFT, &mut left), ("right", attr::STEREO_RIGHT, &mut right)];
        for (side, key, set) in eyes {
            for image in &mut set.images {
                let given = image.params.string(key.name()).filter(|name| !name.is_empty());
                image.path = match (given, &mut image.part) {
                    (Some(name), _) => PathBuf::from(&**name),
                    // Both views are parts of one file.
                    (None, Some(_)) => image.path.clone(),
                    (None, None) => beside(&image.path, side),
                };
                if let Some(part) = &mut image.part {
                    part.view = Some(side);
                }
            }
        }
        let is_lost = |(l, r): &(&OutputImage, &OutputImage)| l.path == r.path && l.part.is_none();
        for (l, _) in left.images.iter().zip(&right.images).filter(is_lost) {
            let path = l.path.display();
            reporter.warning(format!(
                "output \"{path}\": \"stereo:left\" and \"stereo:right\" are the same file; the right view is written"
            ));
        }
        vec![left, right]
    }

    /// Returns the largest margin of all filters in pixels, in x and y.
    pub(crate) fn margin(&self) -> [i32; 2] {
        let layers = self.images.iter().flat_map(|image| &image.layers);
        layers.map(|l| l.filter.margin()).fold([0, 0], |a, b| [a[0].max(b[0]), a[1].max(b[1])])
    }
}

/// Returns `name-side.ext` for `name.ext`.
fn beside(path: &std::path::Path, side: &str) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(format!("-{side}"));
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

fn asks_for_dynamic(output: &Output) -> bool {
    output.get(attr::DYNAMIC)
}

/// True when an image is made on demand for shaders, and not written (reference 10.1.5).
pub(crate) fn is_dynamic(output: &Output) -> bool {
    asks_for_dynamic(output) && matches!(&*output.data, "z" | "avgz") && !output.name.is_empty()
}

/// Returns the content of the layers of an output; `None` (reported) when it cannot be made, or is deleted by the
/// format "null".
fn accepted(output: &Output, registry: &FormatRegistry, reporter: &Reporter) -> Option<Vec<Data>> {
    if output.format.is_empty() || &*output.format == "null" {
        return None;
    }
    let format = match writable(&output.format, registry) {
        Ok(format) => format,
        Err(what) => {
            report(output, reporter, Severity::Error, what);
            return None;
        }
    };
    if asks_for_dynamic(output) && !is_dynamic(output) {
        let what = format!(
            "\"dynamic\" is for \"z\" and \"avgz\", not for \"{}\"; the image is rendered completely",
            output.data
        );
        report(output, reporter, Severity::Warning, what);
    }
    unknown_parameters(output, reporter);
    for (key, least) in [(attr::GAIN, f32::MIN), (attr::GAMMA, f32::MIN_POSITIVE), (attr::DITHER, 0.0)] {
        let (name, v) = (key.name(), output.get(key));
        if !(v.is_finite() && v >= least) {
            mistake(output, reporter, name, format!("\"{name}\" {v} is not valid; the default is used"));
        }
    }
    check_pixel_type(output, &*format, reporter);
    let layers: Result<Vec<Data>, String> =
        output.layers().map(|data| content(data, output, reporter)).collect();
    match layers.and_then(|layers| check_layers(layers, output, &*format)) {
        Ok(layers) => Some(layers),
        Err(what) => {
            report(output, reporter, Severity::Error, what);
            None
        }
    }
}

/// Returns the content that this word or declaration of an output requests.
///
/// # Errors
/// Returns a message when the declaration is not valid or an image cannot show its type.
fn content(data: &str, output: &Output, reporter: &Reporter) -> Result<Data, String> {
    match data {
        "rgb" => Ok(Data::Color { alpha: false }),
        "rgba" => Ok(Data::Color { alpha: true }),
        "error" => Ok(Data::Error),
        "z" => Ok(Data::Depth { middle: false }),
        "avgz" => Ok(Data::Depth { middle: true }),
        "" if &*output.data != data => Err(format!("data \"{}\": a layer has no name", output.data)),
        "volz" => Ok(Data::Volume { depths: volume_depths(output, reporter) }),
        other => match MatteKind::parse(other) {
            Some(kind) => Ok(Data::Mattes { kind: kind?, ranks: ranks(output, reporter) }),
            None => shown_variable(other),
        },
    }
}

/// Checks that the layers fit into one image of this format.
fn check_layers(layers: Vec<Data>, output: &Output, format: &dyn Format) -> Result<Vec<Data>, String> {
    let part = output.part();
    if !part.is_empty() && !format.supports("parts") && !format.supports("rectangles") {
        return Err(format!("format \"{}\" does not store the part \"{part}\"; \"exr\" does", output.format));
    }
    let has_mattes = layers.iter().any(|data| matches!(data, Data::Mattes { .. }));
    if has_mattes && !(format.supports("layers") && format.supports("float")) {
        return Err(format!("format \"{}\" does not store a Cryptomatte; \"exr\" does", output.format));
    }
    if layers.len() < 2 {
        return Ok(layers);
    }
    if !format.supports("layers") {
        return Err(format!("format \"{}\" does not store several layers; \"exr\" does", output.format));
    }
    if layers.iter().any(|data| matches!(data, Data::Volume { .. })) {
        return Err("\"volz\" cannot be one of several layers".to_owned());
    }
    if layers.contains(&Data::Error) {
        return Err("\"error\" cannot be one of several layers".to_owned());
    }
    let names: Vec<String> = layers.iter().flat_map(|data| data.channel_names(true)).collect();
    if let Some(twice) = (1..names.len()).find(|k| names[..*k].contains(&names[*k])) {
        return Err(format!("data \"{}\": two layers have the channel \"{}\"", output.data, names[twice]));
    }
    Ok(layers)
}

/// Reports something about an output, once for each output and text.
fn report(output: &Output, reporter: &Reporter, severity: Severity, what: String) {
    reporter.once(
        &format!("output {} {what}", output.name),
        severity,
        &Location::default(),
        format!("output \"{}\": {what}", output.name),
    );
}

/// Returns the format of this name, which supports writing.
///
/// # Errors
/// Returns a message when the format is not known or cannot be written.
fn writable(name: &str, registry: &FormatRegistry) -> Result<Arc<dyn Format>, String> {
    let Some(format) = registry.by_name(name) else {
        if name.starts_with("0x") {
            return Err(format!(
                "format \"{name}\" is not an ImageOutput of the program that makes the calls"
            ));
        }
        let names = registry.names().join(", ");
        return Err(format!("unknown image format \"{name}\" (known: {names})"));
    };
    if !format.supports("write") {
        return Err(format!("format \"{name}\" cannot be written"));
    }
    Ok(format)
}

/// Warns when "pixeltype" is not a known type or its format does not store halves.
fn check_pixel_type(output: &Output, format: &dyn Format, reporter: &Reporter) {
    let Some(asked) = output.given(attr::PIXELTYPE) else { return };
    let what = match &*asked {
        "half" | "float" if format.supports("half") => return,
        "half" | "float" => {
            format!(
                "format \"{}\" does not store halves; \"quantize\" sets the type of the numbers",
                output.format
            )
        }
        other => format!("\"pixeltype\" is \"half\" or \"float\", not \"{other}\"; \"half\" is used"),
    };
    mistake(output, reporter, "pixeltype", what);
}

/// Returns the content of an output with this declaration of a variable as its data.
///
/// # Errors
/// Returns a message when the declaration is not valid or an image cannot show its type.
fn shown_variable(declaration: &str) -> Result<Data, String> {
    let (ty, name) = ParamType::parse(declaration).map_err(|error| error.to_string())?;
    let value = match ty.base {
        BaseType::Float => ValueType::Float,
        BaseType::Color => ValueType::Color,
        BaseType::Point => ValueType::Point,
        BaseType::Vector => ValueType::Vector,
        BaseType::Normal => ValueType::Normal,
        BaseType::Matrix => ValueType::Matrix,
        _ => return Err(format!("data \"{declaration}\" cannot be shown in an image")),
    };
    let names = match ty.array {
        None => vec![name.into()],
        Some(n @ 1..=MAX_ELEMENTS) => (0..n).map(|k| Arc::from(format!("{name}[{k}]"))).collect(),
        Some(n) => {
            return Err(format!("data \"{declaration}\": {n} elements, 1 to {MAX_ELEMENTS} can be shown"));
        }
    };
    Ok(Data::Variable { names, ty: value })
}

/// Replaces a compression that would change the ids of a Cryptomatte.
fn keep_ids(output: &Output, params: &mut Params, reporter: &Reporter) {
    const LOSSY: [&str; 5] = ["pxr24", "b44", "b44a", "dwaa", "dwab"];
    let Some(given) = params.0.iter_mut().rev().find(|p| p.name.eq_ignore_ascii_case("compression")) else {
        return;
    };
    let ParamData::String(words) = &given.data else { return };
    let Some(word) = words.first().cloned() else { return };
    let name = word.split_once(':').map_or(&*word, |(name, _)| name);
    if LOSSY.iter().any(|lossy| name.eq_ignore_ascii_case(lossy)) {
        let what =
            format!("the compression \"{word}\" would change the ids of a Cryptomatte; \"zip\" is used");
        mistake(output, reporter, "compression", what);
        given.data = "zip".into();
    }
}

/// Returns "cryptomatte:ranks", made even.
fn ranks(output: &Output, reporter: &Reporter) -> usize {
    let (least, most) = RANKS;
    let asked = output.get(attr::CRYPTOMATTE_RANKS);
    let used = asked.clamp(least, most);
    if used != asked {
        let what = format!("\"cryptomatte:ranks\" {asked} is outside {least} to {most}; {used} is used");
        mistake(output, reporter, attr::CRYPTOMATTE_RANKS.name(), what);
    }
    usize::try_from(used).unwrap_or(6).next_multiple_of(2)
}

/// The smallest and largest number of depths of a volume shadow's pixel. The first one is the default.
const ZCHANNELS: (i32, i32) = (2, 1024);

/// Returns "zchannels".
fn volume_depths(output: &Output, reporter: &Reporter) -> usize {
    let (least, most) = ZCHANNELS;
    let asked = output.get(attr::ZCHANNELS);
    let used = asked.clamp(least, most);
    if used != asked {
        mistake(
            output,
            reporter,
            "zchannels",
            format!("\"zchannels\" {asked} is outside {least} to {most}; {used} is used"),
        );
    }
    usize::try_from(used).unwrap_or(3)
}

/// Returns "opaquewidth".
fn opaque_width(output: &Output, reporter: &Reporter) -> f32 {
    let asked = output.get(attr::OPAQUEWIDTH);
    if asked.is_finite() && asked >= 0.0 {
        return asked;
    }
    let used = attr::OPAQUEWIDTH.default();
    mistake(
        output,
        reporter,
        "opaquewidth",
        format!("\"opaquewidth\" {asked} is not a valid width; {used} is used"),
    );
    used
}

/// The parameters of bundled formats.
const FORMAT_PARAMETERS: [&str; 19] = [
    "Artist",
    "BitsPerSample",
    "DateTime",
    "DocumentName",
    "HostComputer",
    "ImageDescription",
    "Make",
    "Model",
    "XMP",
    "bigtiff",
    "compression",
    "copyright",
    "owner",
    "planarconfig",
    "quality",
    "rowsperstrip",
    "software",
    "textureformat",
    "tilesize",
];

/// Warns about unused parameters whose spelling is close to that of used ones. Others may be for a plugin.
fn unknown_parameters(output: &Output, reporter: &Reporter) {
    let known = || own_parameters().chain(FORMAT_PARAMETERS);
    for param in &output.params {
        let name = &*param.name;
        if let Some(layer) = name.strip_prefix("filter:") {
            if let Some(what) = wrong_layer_filter(output, layer) {
                mistake(output, reporter, name, what);
            }
            continue;
        }
        let likely = || granita_base::suggestion(name, known());
        if !known().any(|k| k == name)
            && let Some(likely) = likely()
        {
            let what = format!("there is no parameter \"{name}\"; did you mean \"{likely}\"?");
            mistake(output, reporter, name, what);
        }
    }
}

/// Warns about a parameter of an output, once.
fn mistake(output: &Output, reporter: &Reporter, name: &str, what: String) {
    reporter.once(
        &format!("{name} {}", output.name),
        Severity::Warning,
        &Location::default(),
        format!("output \"{}\": {what}", output.name),
    );
}

/// Returns the parameters of an output, with floats for depths and for viewers, unless "quantize" is set.
fn params(output: &Output, of_layers: &[Data], is_shown: bool) -> Params {
    let mut params = output.params.clone();
    if (is_shown || matches!(of_layers, [Data::Depth { .. } | Data::Volume { .. }]))
        && params.get(attr::QUANTIZE.name()).is_none()
    {
        params.set(attr::QUANTIZE.param([0; 4]));
    }
    params
}

impl OutputImage {
    /// True when its filtered pixels equal those of another image, to the bit.
    pub(crate) fn is_filtered_like(&self, other: &Self) -> bool {
        let same = |(a, b): (&ImageLayer, &ImageLayer)| {
            (&a.channels, a.filter, &a.mattes) == (&b.channels, b.filter, &b.mattes)
        };
        self.layers.len() == other.layers.len()
            && self.layers.iter().zip(&other.layers).all(same)
            && self.opaque_width == other.opaque_width
    }

    /// The number of its channels.
    pub(crate) fn channels(&self) -> usize {
        self.names.len()
    }

    /// Returns the pixels of all its layers together, from those of each.
    pub(crate) fn interleaved(&self, mut of_layers: Vec<Vec<f32>>) -> Vec<f32> {
        if of_layers.len() == 1 {
            return of_layers.swap_remove(0);
        }
        let mut pixels = Vec::with_capacity(of_layers.iter().map(Vec::len).sum());
        let widths = || self.layers.iter().map(|layer| layer.channels.len());
        let count = of_layers.iter().zip(widths()).map(|(values, n)| values.len() / n).min().unwrap_or(0);
        for k in 0..count {
            for (values, n) in of_layers.iter().zip(widths()) {
                pixels.extend_from_slice(&values[k * n..][..n]);
            }
        }
        pixels
    }

    /// Returns for each channel whether it is red, green or blue, to which gain and gamma apply.
    pub(crate) fn colors(&self) -> Vec<bool> {
        let alpha = |name: &String| name != "A";
        let layers = self.layers.iter().flat_map(|layer| layer.channels.iter().map(|_| layer.is_color));
        layers.zip(&self.names).map(|(is_color, name)| is_color && alpha(name)).collect()
    }

    /// Multiplies the colours of whole pixels.
    pub(crate) fn tint(&self, values: &mut [f32], tint: Color) {
        let colors = self.colors();
        for pixel in values.chunks_exact_mut(self.channels()) {
            let colored = pixel.iter_mut().zip(&colors).filter(|(_, is_color)| **is_color);
            colored.zip(tint.to_array().iter().cycle()).for_each(|((v, _), t)| *v *= t);
        }
    }

    /// True when the program that makes the calls receives the image, which is not a file.
    pub(crate) fn is_for_program(&self) -> bool {
        self.format.starts_with("0x")
    }

    /// Returns the text of a parameter for the format.
    pub(crate) fn format_parameter(&self, name: &str) -> Option<&str> {
        let named = self.params.iter().rev().find(|p| p.name.eq_ignore_ascii_case(name));
        named.and_then(|p| self.params.string(&p.name)).map(|text| &**text)
    }

    /// Returns the same image with another file name and another description, without pixels.
    pub(crate) fn partial(&self, path: &Path, description: &Param) -> Self {
        let mut params = self.params.clone();
        params.0.retain(|p| !p.name.eq_ignore_ascii_case(&description.name));
        params.set(description.clone());
        let Self { format, layers, names, .. } = self;
        Self {
            path: path.to_owned(),
            format: format.clone(),
            layers: layers.clone(),
            names: names.clone(),
            params,
            pixels: Vec::new(),
            shown: Shown::default(),
            written: None,
            part: None,
            denoised_by: None,
            ..*self
        }
    }

    /// True when its file has its name, once the image was written: for parts, when all of them were.
    pub(crate) fn is_written(&self) -> bool {
        let file = self.part.as_ref().and_then(|part| part.place.as_ref());
        file.is_none_or(|(file, _)| file.is_complete())
    }

    /// Returns the name of a file for the image alone: `name.PART.ext` for a part of `name.ext`.
    pub(crate) fn path_alone(&self) -> PathBuf {
        let Some(part) = &self.part else { return self.path.clone() };
        let mut name = self.path.file_stem().unwrap_or_default().to_owned();
        name.push(format!(".{}", part.name.replace(['/', '\\'], "_")));
        if let Some(extension) = self.path.extension() {
            name.push(".");
            name.push(extension);
        }
        self.path.with_file_name(name)
    }

    /// Writes the image. The file appears complete under its name, or not at all.
    pub(crate) fn write(&self, camera: &CameraView, registry: &FormatRegistry) -> Result<(), RenderError> {
        let mut file = self.open(camera, registry)?;
        const ROWS: usize = 64;
        for values in self.pixels.chunks(camera.crop.width() * self.channels() * ROWS) {
            file.write(values)?;
        }
        file.close()
    }

    /// Checks that the format supports the image and that the file can be created. This takes place before hours of
    /// rendering and leaves nothing behind.
    pub(crate) fn check(&self, camera: &CameraView, registry: &FormatRegistry) -> Result<(), RenderError> {
        let exists = self.path.metadata();
        let by_plugin = registry.by_name(&self.format).is_some_and(|format| format.quantizes());
        // Plugins may interpret a name in any way. A pipe or a device is opened only once.
        if self.is_shown || by_plugin || exists.is_ok_and(|m| !m.is_file() && !m.is_dir()) {
            return Ok(());
        }
        match &self.part {
            // The first part checks the file.
            Some(Part { place: Some((_, 1..)), .. }) => Ok(()),
            Some(Part { place: Some((file, _)), .. }) => {
                file.check(&*self.format(registry)?, registry.files())
            }
            _ => self.open(camera, registry).map(drop),
        }
    }

    fn format(&self, registry: &FormatRegistry) -> Result<Arc<dyn Format>, RenderError> {
        registry
            .by_name(&self.format)
            .ok_or_else(|| RenderError::Misuse { what: format!("unknown image format \"{}\"", self.format) })
    }

    /// Returns the description of the image as its file stores it.
    ///
    /// # Errors
    /// Returns an error for a format that is not known.
    pub(crate) fn stored_spec(
        &self,
        camera: &CameraView,
        registry: &FormatRegistry,
    ) -> Result<ImageSpec, RenderError> {
        Ok(self.stored(camera, &*self.format(registry)?).0)
    }

    /// Opens a file of this image.
    pub(crate) fn open(
        &self,
        camera: &CameraView,
        registry: &FormatRegistry,
    ) -> Result<ImageWriter, RenderError> {
        let format = self.format(registry)?;
        let files = registry.files();
        if format.quantizes() {
            return self.open_raw(&*format, camera, files);
        }
        let (spec, quantize) = self.stored(camera, &*format);
        let file = match &self.part {
            Some(Part { place: Some((file, index)), .. }) => file.part(*index, &*format, files)?,
            _ => format.create(&self.path, &CreateOptions::new(&spec, 1).with_files(files))?,
        };
        self.begin(file, &spec, quantize, camera)
    }

    /// Returns the description of the image as its file stores it, and how its values become those.
    fn stored(&self, camera: &CameraView, format: &dyn Format) -> (ImageSpec, Quantize) {
        let (quantize, stored) = Quantize::for_output(format, &self.params);
        // Depths, positions and numbers of objects need all their bits, also in a format that usually stores halves. A
        // layer of them makes all layers floats.
        let is_precise = self.opaque_width.is_some()
            || self.layers.iter().any(|l| l.filter.filter == PixelFilter::Closest || l.mattes.is_some())
            || self.names.iter().any(|name| matches!(&**name, "Z" | "avgz"));
        let stored = match stored {
            PixelType::Half if is_precise && format.supports("float") => PixelType::Float,
            other => other,
        };
        (self.spec(camera, stored), quantize)
    }

    /// Opens a file in a format that exposes and quantizes by itself. It gets the unchanged values.
    fn open_raw(
        &self,
        format: &dyn Format,
        camera: &CameraView,
        files: &Files,
    ) -> Result<ImageWriter, RenderError> {
        let mut spec = self.spec(camera, PixelType::Float);
        let mut quantize = Quantize::from_params(&self.params);
        if !self.layers.iter().any(|layer| layer.is_color) {
            (quantize.gain, quantize.gamma) = (1.0, 1.0);
        }
        let levels = [quantize.zero, quantize.one, quantize.min, quantize.max];
        let ty = ParamType::array(BaseType::Int, 4);
        spec.attributes.set(Param { name: "quantize".into(), ty, data: levels[..].into() });
        for (name, value) in [("gain", quantize.gain), ("gamma", quantize.gamma), ("dither", quantize.dither)]
        {
            spec.attributes.set(Param {
                name: name.into(),
                ty: ParamType::of(BaseType::Float),
                data: value.into(),
            });
        }
        let file = format.create(&self.path, &CreateOptions::new(&spec, 1).with_files(files))?;
        self.begin(file, &spec, Quantize::FLOAT, camera)
    }

    fn begin(
        &self,
        file: Box<dyn granita_image::ImageOutput>,
        spec: &ImageSpec,
        quantize: Quantize,
        camera: &CameraView,
    ) -> Result<ImageWriter, RenderError> {
        let crop = &camera.crop;
        let at = Placement {
            x: crop.x0,
            y: crop.y0,
            width: crop.width(),
            nchannels: self.channels(),
            alpha: spec.alpha_channel(),
        };
        let colors = self.colors();
        Ok(ImageWriter { file, quantize, colors, stored: spec.pixel_type, at })
    }

    fn spec(&self, camera: &CameraView, stored: PixelType) -> ImageSpec {
        let crop = &camera.crop;
        let [width, height] = [crop.width() as u32, crop.height() as u32];
        let mut spec = ImageSpec::new(width, height, self.channels(), stored);
        (spec.x, spec.y) = (crop.x0, crop.y0);
        (spec.full_width, spec.full_height) = (camera.resolution[0], camera.resolution[1]);
        spec.channels = self.names.clone();
        let software = Param {
            name: "software".into(),
            ty: ParamType::of(BaseType::String),
            data: (&*format!("Granita {}", granita_base::VERSION)).into(),
        };
        spec.attributes.set(software);
        if self.opaque_width.is_some() {
            // Its kind does not follow from its channels.
            spec.attributes.set(Param {
                name: "textureformat".into(),
                ty: ParamType::of(BaseType::String),
                data: granita_texture::TextureKind::VolumeShadow.word().into(),
            });
        }
        let of_mattes = self.layers.iter().filter_map(|layer| Some(layer.mattes.as_ref()?.metadata()));
        let of_frame =
            [camera.metadata(), settings(camera, &self.layers, self.samples), of_passes(self.passes)];
        let error = self.passes.and_then(|passes| passes.denoised);
        let of_denoiser = self.denoised_by.iter().map(|library| of_denoiser(library, error));
        for param in of_mattes.chain(of_frame).chain(of_denoiser).flat_map(|params| params.0) {
            spec.attributes.set(param);
        }
        let is_own = |name: &str| name.starts_with("filter:") || own_parameters().any(|own| own == name);
        for param in self.params.iter().filter(|p| !is_own(&p.name)) {
            spec.attributes.set(param.clone());
        }
        if let Some(part) = &self.part {
            let text = |name: &str, value: &str| Param {
                name: name.into(),
                ty: ParamType::of(BaseType::String),
                data: value.into(),
            };
            spec.attributes.set(text("name", &part.name));
            if let Some(view) = part.view {
                spec.attributes.set(text("view", view));
            }
        }
        spec
    }
}

#[cfg(test)]
mod tests;
