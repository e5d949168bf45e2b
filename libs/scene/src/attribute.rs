// tidy: table
//! The attribute table: one row per attribute of reference chapter 4. Defaults, types and scopes
//! come from here and from nowhere else.

use granita_base::{BaseType, Param, ParamData, ParamType};
use rustc_hash::FxHashMap;
use std::sync::{Arc, LazyLock};

/// What an attribute belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Scope {
    /// A camera (4.1): parameter of `Camera`, or `Attribute` before the next one.
    Camera,
    /// An image (4.2): parameter of `Output`.
    Output,
    /// The whole scene (4.3): `Attribute` before `World`.
    Global,
    /// Each object (4.4): `Attribute` at any time, saved and restored with the state.
    Object,
    /// Controls writers of scene files (4.3.12), ignored by a renderer; `Attribute` at any time.
    Writer,
    /// Can be asked for, not set (4.3.10, 4.4.1).
    ReadOnly,
}

/// Default value of an attribute.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DefaultValue {
    /// None: the attribute is absent until set.
    Unset,
    /// Floats, also of colours.
    Floats(&'static [f32]),
    /// Integers.
    Ints(&'static [i32]),
    /// A string.
    Text(&'static str),
}

/// What comes of setting an attribute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// What the reference says.
    Full,
    /// Nothing yet: who sets it to something else than its default is told so.
    NotYet,
    /// Nothing, and nothing is missing: it tunes how the work is done, and this renderer needs no tuning there.
    Hint,
}

/// One attribute.
#[derive(Clone, Copy, Debug)]
pub struct AttributeRow {
    /// Its name, without a declaration.
    pub name: &'static str,
    /// Its type; values of any numeric type are converted to it.
    pub ty: ParamType,
    /// Its value when nobody sets it.
    pub default: DefaultValue,
    /// What it belongs to.
    pub scope: Scope,
    /// Section of the reference.
    pub section: &'static str,
    /// What it does, in one line.
    pub help: &'static str,
    /// The strings that it may take; empty for any.
    pub words: &'static [&'static str],
    /// What comes of setting it.
    pub effect: Effect,
}

impl AttributeRow {
    /// The default as a parameter; `None` when there is none.
    pub fn default_param(&self) -> Option<Param> {
        let data = match self.default {
            DefaultValue::Unset => return None,
            DefaultValue::Floats(v) => ParamData::from(v),
            DefaultValue::Ints(v) => ParamData::from(v),
            DefaultValue::Text(v) => ParamData::from(v),
        };
        Some(Param { name: self.name.into(), ty: self.ty, data })
    }

    /// Whether it takes a list of strings that grows with every call.
    pub fn is_list(&self) -> bool {
        self.name.starts_with("spatialdb:")
    }

    /// What to tell somebody who sets it to `value`: `None` when it has the effect that they expect.
    pub fn caveat(&self, value: &ParamData) -> Option<String> {
        let is_default = || self.default_param().is_some_and(|d| d.data == *value);
        match self.effect {
            Effect::NotYet if !is_default() => Some(format!("\"{}\" is not supported yet", self.name)),
            _ => None,
        }
    }

    /// The same row, of an attribute without effect.
    #[allow(dead_code, reason = "as soon as a row needs it")]
    const fn not_yet(self) -> Self {
        Self { effect: Effect::NotYet, ..self }
    }

    /// The same row, of an attribute that this renderer has no use for.
    const fn hint(self) -> Self {
        Self { effect: Effect::Hint, ..self }
    }

    /// The declaration, as `"int[2] resolution"`.
    pub fn declaration(&self) -> String {
        format!("{} {}", self.ty, self.name)
    }
}

const FLOAT: ParamType = ParamType::of(BaseType::Float);
const FLOAT2: ParamType = ParamType::array(BaseType::Float, 2);
const FLOAT4: ParamType = ParamType::array(BaseType::Float, 4);
const INT: ParamType = ParamType::of(BaseType::Int);
const INT2: ParamType = ParamType::array(BaseType::Int, 2);
const INT4: ParamType = ParamType::array(BaseType::Int, 4);
const STRING: ParamType = ParamType::of(BaseType::String);
const COLOR: ParamType = ParamType::of(BaseType::Color);
const MATRIX: ParamType = ParamType::of(BaseType::Matrix);

/// One row of the table, read as columns.
const fn row(
    scope: Scope,
    section: &'static str,
    (ty, name): (ParamType, &'static str),
    default: DefaultValue,
    help: &'static str,
) -> AttributeRow {
    AttributeRow { name, ty, default, scope, section, help, words: &[], effect: Effect::Full }
}

/// A row whose value is one of some words; the first is the default.
const fn choice(
    scope: Scope,
    section: &'static str,
    name: &'static str,
    words: &'static [&'static str],
    help: &'static str,
) -> AttributeRow {
    AttributeRow {
        name,
        ty: STRING,
        default: DefaultValue::Text(words[0]),
        scope,
        section,
        help,
        words,
        effect: Effect::Full,
    }
}

/// Camera attributes (4.1).
const fn camera(decl: (ParamType, &'static str), default: DefaultValue, help: &'static str) -> AttributeRow {
    row(Scope::Camera, "4.1", decl, default, help)
}

/// Output attributes (4.2).
const fn output(decl: (ParamType, &'static str), default: DefaultValue, help: &'static str) -> AttributeRow {
    row(Scope::Output, "4.2", decl, default, help)
}

use DefaultValue::{Floats, Ints, Text, Unset};
use Scope::{Camera, Global, Object, Output, ReadOnly, Writer};

/// All attributes, in the order of the reference.
pub const TABLE: &[AttributeRow] = &[
    // 4.1 Camera attributes
    choice(Camera, "4.1", "projection", &["perspective", "orthographic"], "kind of projection"),
    camera((FLOAT, "fov"), Floats(&[90.0]), "vertical field of view of a perspective camera, in degrees"),
    camera((FLOAT4, "screen"), Unset, "xmin xmax ymin ymax of the part of the plane z = 1 that is the image"),
    camera((INT2, "resolution"), Ints(&[640, 480]), "width and height of the full image in pixels"),
    camera(
        (FLOAT, "pixelaspect"),
        Floats(&[1.0]),
        "width of a pixel over its height, for the readers of files",
    ),
    camera(
        (FLOAT4, "crop"),
        Floats(&[0.0, 1.0, 0.0, 1.0]),
        "xmin xmax ymin ymax of the pixels to make, in NDC",
    ),
    camera((FLOAT, "near"), Floats(&[0.1]), "near clipping plane, along z of the camera"),
    camera((FLOAT, "far"), Floats(&[1.0e6]), "far clipping plane, along z of the camera"),
    camera((FLOAT2, "shutter"), Floats(&[0.0, 0.0]), "times at which the shutter opens and closes"),
    camera((FLOAT, "fstop"), Floats(&[1.0e30]), "focal length over lens diameter; 1e30 is a pinhole"),
    camera((FLOAT, "focallength"), Unset, "focal length of the lens in units of the camera's space"),
    camera((FLOAT, "focaldistance"), Unset, "distance of sharp focus in units of the camera's space"),
    camera((INT2, "spatialquality"), Ints(&[4, 4]), "least number of regions per pixel against jagged edges"),
    camera((INT, "temporalquality"), Ints(&[16]), "least number of times sampled for motion blur"),
    camera((INT, "dofquality"), Ints(&[16]), "least number of lens positions sampled for depth of field"),
    camera((INT2, "limits:bucketsize"), Ints(&[32, 32]), "size of a bucket in pixels"),
    choice(
        Camera,
        "4.1",
        "bucketorder",
        &["horizontal", "vertical", "spiral"],
        "order in which buckets are made: \"horizontal\", \"vertical\" or \"spiral\"; images of more than 256 MiB come from the top",
    ),
    camera(
        (INT, "limits:bucketblocksize"),
        Ints(&[2]),
        "buckets along each side of the clusters that are done one after the other",
    ),
    camera((INT, "limits:autopassreduction"), Ints(&[1]), "take fewer samples where nothing blurs"),
    camera((FLOAT, "preview"), Floats(&[0.0]), "shading quality of preview mode; 0 is no preview"),
    camera((INT2, "preview:spatialquality"), Ints(&[1, 1]), "spatialquality in preview mode"),
    camera((INT, "preview:temporalquality"), Ints(&[1]), "temporalquality in preview mode"),
    camera((INT, "preview:dofquality"), Ints(&[1]), "dofquality in preview mode"),
    camera((INT2, "preview:bucketsize"), Ints(&[2048, 2048]), "limits:bucketsize in preview mode"),
    camera((FLOAT, "preview:dicecurvature"), Floats(&[90.0]), "dice:curvature in preview mode"),
    camera((INT, "preview:thincurves"), Ints(&[10]), "in preview mode, draw one of so many curves"),
    camera((INT, "preview:thinpoints"), Ints(&[10]), "in preview mode, draw one of so many points"),
    camera(
        (FLOAT, "preview:limitpixelsize"),
        Floats(&[0.0]),
        "in preview mode, objects that cover fewer pixels are drawn as boxes",
    ),
    camera(
        (FLOAT, "preview:limitdistance"),
        Floats(&[1.0e38]),
        "in preview mode, objects farther away are boxes",
    ),
    choice(Camera, "4.1", "hider", &["default"], "hidden surface method"),
    choice(Camera, "4.1", "shadertype", &["gsl", "defaultsurface", "keyfillrim"], "shading system"),
    camera((FLOAT, "stereo:separation"), Floats(&[0.0]), "distance of the two views along x; 0 is no stereo"),
    camera((FLOAT, "stereo:convergence"), Floats(&[0.0]), "depth at which the two views coincide"),
    choice(
        Camera,
        "4.1",
        "stereo:projection",
        &["off-axis", "parallel", "toe-in"],
        "how the two views converge",
    ),
    choice(Camera, "4.1", "stereo:shade", &["center", "left", "right"], "view from which stereo is shaded"),
    // 4.2 Output attributes
    choice(
        Output,
        "4.2",
        "filter",
        &[
            "gaussian",
            "box",
            "triangle",
            "catmull-rom",
            "sinc",
            "blackman-harris",
            "mitchell",
            "b-spline",
            "min",
            "max",
            "average",
        ],
        "pixel filter; min, max and average for depths only",
    ),
    output((FLOAT2, "filterwidth"), Floats(&[2.0, 2.0]), "width of the pixel filter in pixels, x and y"),
    output((FLOAT, "gamma"), Floats(&[1.0]), "exponent 1/gamma is applied to colours"),
    output((FLOAT, "gain"), Floats(&[1.0]), "colours are multiplied by it before gamma"),
    output(
        (INT4, "quantize"),
        Ints(&[0, 255, 0, 255]),
        "integers of 0 and of 1, and their limits; all 0: floats",
    ),
    output((FLOAT, "dither"), Floats(&[0.5]), "amplitude of the noise added before rounding"),
    choice(
        Output,
        "4.2",
        "pixeltype",
        &["half", "float"],
        "numbers in formats of halves (OpenEXR): \"half\" or \"float\"",
    ),
    output((STRING, "stereo:left"), Text(""), "file name of the left view"),
    output((STRING, "stereo:right"), Text(""), "file name of the right view"),
    output((INT, "zchannels"), Ints(&[3]), "depths per pixel of a volume shadow, 2 or more"),
    output(
        (FLOAT, "opaquewidth"),
        Floats(&[0.05]),
        "depth range that counts as one opaque object in a volume shadow",
    ),
    output((INT, "dynamic"), Ints(&[0]), "the image is made on demand and not written"),
    // 4.3 Scene-wide attributes
    row(Global, "4.3.1", (STRING, "pass"), Text(""), "name of the rendering pass"),
    choice(
        Global,
        "4.3.2",
        "units:length",
        &["", "mm", "cm", "m", "km", "in", "ft", "mi"],
        "physical unit of \"common\" space",
    ),
    row(
        Global,
        "4.3.2",
        (FLOAT, "units:lengthscale"),
        Floats(&[1.0]),
        "physical units in one unit of \"common\" space",
    ),
    row(Global, "4.3.2", (FLOAT, "units:fps"), Floats(&[24.0]), "frames per second"),
    choice(Global, "4.3.2", "units:time", &["", "s", "frames"], "unit of the times of Motion and shutter"),
    row(
        Global,
        "4.3.2",
        (FLOAT, "units:timescale"),
        Floats(&[1.0]),
        "seconds or frames in one unit of the times of Motion and shutter",
    ),
    row(Global, "4.3.3", (INT, "rerender"), Ints(&[0]), "allow changes and further calls of Render"),
    row(
        Global,
        "4.3.3",
        (INT, "rerender:memory"),
        Ints(&[0]),
        "memory for re-rendering in KB; 0 for what there is",
    )
    .hint(),
    row(
        Global,
        "4.3.3",
        (INT, "rerender:reshaderays"),
        Ints(&[1]),
        "shade rays anew when what they see changed",
    )
    .hint(),
    row(
        Global,
        "4.3.3",
        (STRING, "rerender:filepattern"),
        Text(".*"),
        "files to look at again before re-rendering",
    )
    .hint(),
    row(Global, "4.3.4", (INT, "limits:threads"), Ints(&[1]), "threads that work on the frame"),
    row(Global, "4.3.4", (INT, "limits:gridsize"), Ints(&[256]), "most points shaded at once"),
    row(
        Global,
        "4.3.4",
        (INT, "limits:primitivepoints"),
        Ints(&[250_000_000]),
        "most points that a primitive may be diced into in a frame; 0 for any number",
    ),
    row(Global, "4.3.4", (INT, "limits:texturememory"), Ints(&[20480]), "size of the texture cache in KB"),
    row(Global, "4.3.4", (INT, "limits:texturefiles"), Ints(&[1000]), "texture files open at once"),
    row(Global, "4.3.4", (FLOAT, "trimcurve:quality"), Floats(&[1.0]), "scale on the quality of trim curves"),
    row(
        Global,
        "4.3.4",
        (INT, "limits:trimcurvememory"),
        Ints(&[10240]),
        "size of the trim curve cache in KB; none is needed: curves become polygons once",
    )
    .hint(),
    row(
        Global,
        "4.3.4",
        (INT, "limits:transparentlayers"),
        Ints(&[-1]),
        "most transparent layers of a pixel; -1 for any",
    ),
    row(
        Global,
        "4.3.4",
        (COLOR, "limits:opacitythreshold"),
        Floats(&[1.0, 1.0, 1.0]),
        "opacity that counts as fully opaque",
    ),
    row(
        Global,
        "4.3.4",
        (COLOR, "shadow:opacitythreshold"),
        Floats(&[1.0, 1.0, 1.0]),
        "opacity from which a surface appears in shadow maps",
    ),
    row(
        Global,
        "4.3.4",
        (INT, "limits:transparentgrids"),
        Ints(&[32]),
        "layers of transparent grids done at once; there are no batches to tune",
    )
    .hint(),
    row(
        Global,
        "4.3.4",
        (STRING, "dice:fixeduname"),
        Text("u"),
        "variable that fixed dicing along u is measured by",
    ),
    row(
        Global,
        "4.3.4",
        (STRING, "dice:fixedvname"),
        Text("v"),
        "variable that fixed dicing along v is measured by",
    ),
    row(Global, "4.3.5", (INT, "ray:maxdepth"), Ints(&[2]), "most bounces of a reflected ray"),
    row(
        Global,
        "4.3.5",
        (COLOR, "ray:maxdepthcolor"),
        Floats(&[0.0, 0.0, 0.0]),
        "colour seen by rays beyond the last bounce",
    ),
    row(
        Global,
        "4.3.6",
        (STRING, "path:input"),
        Text(".:$GELATOHOME/inputs"),
        "where scene files are looked for",
    ),
    row(
        Global,
        "4.3.6",
        (STRING, "path:texture"),
        Text(".:$GELATOHOME/textures"),
        "where textures are looked for",
    ),
    row(
        Global,
        "4.3.6",
        (STRING, "path:shader"),
        Text(".:$GELATOHOME/shaders"),
        "where shaders are looked for",
    ),
    row(
        Global,
        "4.3.6",
        (STRING, "path:generator"),
        Text(".:$GELATOHOME/lib"),
        "where generators are looked for",
    ),
    row(
        Global,
        "4.3.6",
        (STRING, "path:imageio"),
        Text(".:$GELATOHOME/lib"),
        "where image plugins are looked for",
    ),
    row(
        Global,
        "4.3.7",
        (INT, "verbosity"),
        Ints(&[1]),
        "how much is told: 0 errors, 1 warnings, 2 everything",
    ),
    row(
        Global,
        "4.3.7",
        (STRING, "error:filename"),
        Text(""),
        "file for messages; standard error when empty",
    ),
    row(Global, "4.3.7", (INT, "statistics:level"), Ints(&[0]), "how many statistics are told"),
    row(
        Global,
        "4.3.7",
        (STRING, "statistics:filename"),
        Text(""),
        "file for statistics; standard output when empty",
    ),
    row(Global, "4.3.7", (INT, "debug:dso"), Ints(&[0]), "tell about every plugin looked at"),
    row(Global, "4.3.7", (STRING, "debug:filesread"), Text(""), "file for the names of all files read"),
    row(Global, "4.3.7", (INT, "debug:shadernan"), Ints(&[0]), "look for NaN in running shaders"),
    row(Global, "5.8.6", (INT, "random:seed"), Ints(&[0]), "seed of random () and randomgrid () in shaders"),
    row(Global, "4.3.7", (STRING, "griddump:filename"), Text(""), "file for all shaded grids, as Pyg"),
    row(Global, "4.3.7", (INT, "griddump:binary"), Ints(&[0]), "write the grids as binary Pyg"),
    row(Global, "4.3.8", (STRING, "texture:substtexture"), Text(""), "texture that stands for all textures"),
    row(Global, "4.3.8", (STRING, "texture:substenv"), Text(""), "map that stands for all environment maps"),
    row(Global, "4.3.8", (INT, "texture:automipmap"), Ints(&[1]), "make a mip-map of textures that are none"),
    row(Global, "4.3.9", (STRING, "spatialdb:write"), Unset, "spatial databases written after rendering"),
    row(Global, "4.3.9", (STRING, "spatialdb:read"), Unset, "spatial databases loaded when first asked"),
    row(
        Global,
        "4.3.9",
        (STRING, "spatialdb:readonly"),
        Unset,
        "spatial databases loaded and never added to",
    ),
    row(Global, "4.3.9", (STRING, "spatialdb:writeonly"), Unset, "spatial databases written and never asked"),
    row(ReadOnly, "4.3.10", (STRING, "renderer:name"), Text("Granita"), "name of the renderer"),
    row(ReadOnly, "4.3.10", (INT4, "renderer:version"), Unset, "major, minor, release and patch number"),
    row(
        ReadOnly,
        "4.3.10",
        (STRING, "renderer:versionstring"),
        Unset,
        "the four numbers of the version, as \"2.1.0.0\"",
    ),
    row(
        ReadOnly,
        "4.3.10",
        (FLOAT, "render:progress"),
        Floats(&[0.0]),
        "part of the frame that is done; 1 is all",
    ),
    row(ReadOnly, "4.3.10", (INT, "render:success"), Ints(&[0]), "whether the last frame was finished"),
    row(
        Global,
        "4.3.11",
        (STRING, "net:workers"),
        Text(""),
        "machines that share the work, as `gelato -net`; \"local\" is this one",
    ),
    row(
        Global,
        "4.3.11",
        (STRING, "net:workercmd"),
        Text(""),
        "how `gelato` is called on them; empty is by that name",
    ),
    row(
        Global,
        "4.3.11",
        (FLOAT, "net:timeout"),
        Floats(&[60.0]),
        "seconds of silence, at least 2, after which others do the part of one that has work to do",
    ),
    row(Global, "4.3.11", (INT, "net:tint"), Ints(&[0]), "tint buckets by worker, with this seed"),
    row(Writer, "4.3.12", (INT, "pyg:binary"), Ints(&[0]), "write large arrays in binary"),
    row(Writer, "4.3.12", (INT, "pyg:separateparams"), Ints(&[0]), "write parameters as calls of their own"),
    row(Writer, "4.3.12", (INT, "pyg:indent"), Ints(&[0]), "blanks added to the indentation"),
    row(Writer, "4.3.12", (INT, "limits:inputlevels"), Ints(&[0]), "levels of Input that are expanded"),
    // 4.4 Per-object attributes
    row(ReadOnly, "4.4.1", (MATRIX, "transform"), Unset, "object space to world when the shutter opens"),
    row(Object, "4.4.2", (STRING, "name"), Text(""), "name of the object, for messages and Modify"),
    row(
        Object,
        "4.4.3",
        (STRING, "geometryset"),
        Text("camera"),
        "geometry sets, with + and - to change the list",
    ),
    row(Object, "4.4.4", (COLOR, "C"), Floats(&[1.0, 1.0, 1.0]), "surface colour"),
    row(Object, "4.4.4", (COLOR, "opacity"), Floats(&[1.0, 1.0, 1.0]), "surface opacity"),
    row(Object, "4.4.4", (INT, "holdout"), Ints(&[0]), "0 ordinary, 1 holdout matte, 2 shaded holdout matte"),
    choice(
        Object,
        "4.4.4",
        "orientation",
        &["outside", "inside", "lh", "rh", "reverse"],
        "which way normals point; faces whose own normals are all on the other side follow these",
    ),
    row(Object, "4.4.4", (INT, "twosided"), Ints(&[1]), "visible from both sides"),
    row(Object, "4.4.4", (FLOAT, "shadingquality"), Floats(&[1.0]), "shading points per pixel distance"),
    row(Object, "4.4.5", (INT, "dice:binary"), Ints(&[0]), "dice by powers of two"),
    row(
        Object,
        "4.4.5",
        (FLOAT, "dice:curvature"),
        Floats(&[10.0]),
        "angle in degrees that forces finer dicing",
    ),
    row(
        Object,
        "4.4.5",
        (FLOAT, "dice:highcurvature"),
        Floats(&[120.0]),
        "angle in degrees that forces finer dicing at any size",
    ),
    row(
        Object,
        "4.4.5",
        (FLOAT, "dice:motionfactor"),
        Floats(&[1.0]),
        "how much coarser moving objects are diced",
    ),
    row(
        Object,
        "4.4.5",
        (INT, "dice:keepcreases"),
        Ints(&[0]),
        "split curves at every crease; pieces of patches and meshes always end there",
    ),
    row(
        Object,
        "4.4.5",
        (INT, "dice:rasterorient"),
        Ints(&[1]),
        "dice by the size in the image, seen as it lies",
    ),
    row(
        Object,
        "4.4.5",
        (FLOAT2, "dice:fixed"),
        Floats(&[0.0, 0.0]),
        "facets per unit of u and v; 0 0 is off",
    ),
    row(
        Object,
        "4.4.5",
        (FLOAT, "dice:thincurve"),
        Floats(&[1.0]),
        "curves thinner than this in pixels are simplified",
    ),
    row(Object, "4.4.5", (INT, "cull:occlusion"), Ints(&[1]), "do not shade what is hidden"),
    row(Object, "4.4.6", (FLOAT, "displace:maxradius"), Floats(&[0.0]), "largest displacement"),
    row(
        Object,
        "4.4.6",
        (STRING, "displace:maxspace"),
        Text("common"),
        "space in which displace:maxradius is measured",
    ),
    choice(Object, "4.4.7", "shading:view", &["camera", "outside", "inside"], "what I is on camera grids"),
    choice(
        Object,
        "4.4.8",
        "trimcurve:sense",
        &["inside", "outside"],
        "which side of trim curves is discarded",
    ),
    row(
        Object,
        "4.4.8",
        (FLOAT, "trimcurve:curvature"),
        Floats(&[10.0]),
        "angle in degrees that forces more segments of trim curves",
    ),
    row(Object, "2.4", (INT, "light:nsamples"), Ints(&[1]), "samples of an area light"),
    row(
        Object,
        "4.4.9",
        (INT, "ray:opaqueshadows"),
        Ints(&[0]),
        "opaque to shadow rays without asking the shader",
    ),
    row(Object, "4.4.9", (INT, "ray:motion"), Ints(&[0]), "rays from it see motion blur"),
    row(Object, "4.4.9", (INT, "ray:displace"), Ints(&[1]), "rays see true displacement"),
    row(Object, "4.4.9", (FLOAT, "shadow:bias"), Floats(&[0.01]), "bias of shadow maps and rays"),
    row(
        Object,
        "4.4.10",
        (FLOAT, "indirect:maxerror"),
        Floats(&[0.25]),
        "largest error of interpolated indirect light",
    ),
    row(
        Object,
        "4.4.10",
        (FLOAT, "indirect:maxpixeldist"),
        Floats(&[20.0]),
        "largest distance in pixels of indirect samples",
    ),
    row(
        Object,
        "4.4.10",
        (INT, "indirect:minsamples"),
        Ints(&[3]),
        "least number of indirect samples interpolated",
    ),
    row(
        Object,
        "4.4.10",
        (STRING, "indirect:spatialdb"),
        Text("indirect.sdb"),
        "spatial database of indirect light",
    ),
    row(
        Object,
        "4.4.11",
        (FLOAT, "occlusion:maxerror"),
        Floats(&[0.25]),
        "largest error of interpolated occlusion",
    ),
    row(
        Object,
        "4.4.11",
        (FLOAT, "occlusion:maxpixeldist"),
        Floats(&[20.0]),
        "largest distance in pixels of occlusion samples",
    ),
    row(
        Object,
        "4.4.11",
        (INT, "occlusion:minsamples"),
        Ints(&[3]),
        "least number of occlusion samples interpolated",
    ),
    row(
        Object,
        "4.4.11",
        (STRING, "occlusion:spatialdb"),
        Text("occlusion.sdb"),
        "spatial database of occlusion",
    ),
    row(Object, "4.4.12", (INT, "rerender:locked"), Ints(&[0]), "keeps its shading when re-rendering").hint(),
    row(
        Object,
        "4.4.12",
        (INT, "rerender:cachelights"),
        Ints(&[1]),
        "lights keep their results when re-rendering",
    )
    .hint(),
];

/// Other spellings in use, and the row that each means.
const ALIASES: &[(&str, &str)] = &[
    ("ray:opaquesadows", "ray:opaqueshadows"),
    ("texture:subtexture", "texture:substtexture"),
    ("format:binary", "pyg:binary"),
    ("renderer", "renderer:name"),
    ("version", "renderer:version"),
    ("versionstring", "renderer:versionstring"),
];

/// What is known of a row beside the table: its name and default, to be shared.
#[derive(Clone, Debug)]
pub(crate) struct Known {
    /// The row.
    pub(crate) row: &'static AttributeRow,
    /// Its name.
    pub(crate) name: Arc<str>,
    /// Its default, if it has one.
    pub(crate) default: Option<Param>,
}

static INDEX: LazyLock<FxHashMap<&'static str, Known>> = LazyLock::new(|| {
    let known = |row: &'static AttributeRow| {
        let default = row.default_param();
        let name = default.as_ref().map_or_else(|| row.name.into(), |d| d.name.clone());
        (row.name, Known { row, name, default })
    };
    let mut rows: FxHashMap<_, _> = TABLE.iter().map(known).collect();
    for (other, name) in ALIASES {
        if let Some(found) = rows.get(name).cloned() {
            rows.insert(*other, found);
        }
    }
    rows
});

/// What is known of an attribute, also by another spelling that is in use.
pub(crate) fn known(name: &str) -> Option<&'static Known> {
    INDEX.get(name)
}

/// The row of an attribute, also by another spelling that is in use.
pub fn attribute_row(name: &str) -> Option<&'static AttributeRow> {
    known(name).map(|known| known.row)
}

/// The default of an attribute as a parameter; `None` for an unknown name or one without a default.
pub fn attribute_default(name: &str) -> Option<Param> {
    known(name)?.default.clone()
}

/// The value of `name` that was set, or its default from the table.
pub(crate) fn lookup(set: Option<&Param>, name: &str) -> Option<Param> {
    set.cloned().or_else(|| attribute_default(name))
}

/// The candidate most like `word`, if one is near enough to be what was meant; never the word itself.
///
/// Near means: at most a third of the letters (at least one, at most three) inserted, removed, replaced or
/// exchanged with their neighbour; case does not count. Of equals the first wins.
pub fn suggestion<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Long words cost the square of their length and are never a misspelling.
    if word.len() > 64 {
        return None;
    }
    let allowed = (word.chars().count() / 3).clamp(1, 3);
    candidates
        .into_iter()
        .filter(|c| *c != word)
        .map(|c| (edit_distance(word, c), c))
        .filter(|(d, _)| *d <= allowed)
        .min_by_key(|(d, _)| *d)
        .map(|(_, c)| c)
}

/// Optimal string alignment distance, case-insensitive.
fn edit_distance(a: &str, b: &str) -> usize {
    let a: Vec<char> = a.chars().map(|c| c.to_ascii_lowercase()).collect();
    let b: Vec<char> = b.chars().map(|c| c.to_ascii_lowercase()).collect();
    let mut rows = vec![vec![0usize; b.len() + 1]; a.len() + 1];
    for (i, r) in rows.iter_mut().enumerate() {
        r[0] = i;
    }
    rows[0] = (0..=b.len()).collect();
    for i in 1..=a.len() {
        for j in 1..=b.len() {
            let replace = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
            let mut best = replace.min(rows[i - 1][j] + 1).min(rows[i][j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                best = best.min(rows[i - 2][j - 2] + 1);
            }
            rows[i][j] = best;
        }
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_consistent() {
        let mut seen = std::collections::BTreeSet::new();
        for row in TABLE {
            assert!(seen.insert(row.name), "{} twice", row.name);
            assert!(!row.help.is_empty() && !row.help.ends_with('.'), "{}", row.name);
            if let Some(p) = row.default_param() {
                assert_eq!(p.data.len(), row.ty.width(), "{}", row.name);
                let string = matches!(p.data, ParamData::String(_));
                assert_eq!(string, row.ty.base == BaseType::String, "{}", row.name);
                let int = matches!(p.data, ParamData::Int(_));
                assert_eq!(int, row.ty.base == BaseType::Int, "{}", row.name);
            }
        }
        for (other, name) in ALIASES {
            assert_eq!(attribute_row(other).unwrap().name, *name);
        }
    }

    #[test]
    fn lookups_give_set_values_then_defaults() {
        let mut set = std::collections::BTreeMap::new();
        assert_eq!(lookup(set.get("shadingquality"), "shadingquality").unwrap().data, ParamData::from(1.0));
        set.insert(Arc::from("shadingquality"), Param::declared("float shadingquality", 2.0).unwrap());
        assert_eq!(lookup(set.get("shadingquality"), "shadingquality").unwrap().data, ParamData::from(2.0));
        assert!(lookup(set.get("screen"), "screen").is_none());
        assert!(lookup(set.get("no such thing"), "no such thing").is_none());
    }

    #[test]
    fn suggestions() {
        let names = || TABLE.iter().map(|r| r.name);
        assert_eq!(suggestion("resolutoin", names()), Some("resolution"));
        assert_eq!(suggestion("FOV", names()), Some("fov"));
        assert_eq!(suggestion("opacty", names()), Some("opacity"));
        assert_eq!(suggestion("quite different", names()), None);
        // A word is no hint for itself: it was not found for another reason.
        assert_eq!(suggestion("world", ["word", "world"]), Some("word"));
        assert_eq!(suggestion("", ["a"]), Some("a"));
        assert_eq!(suggestion(&"x".repeat(10_000), names()), None);
    }
}
