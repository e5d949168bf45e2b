// tidy: table
//! The rows of the attribute table. Each row is a key in [`attr`](super::attr).
//!
//! The form is `KEY: scope, type in programs = section of the reference, name, default, help`, followed by marks:
//! `, Hint` for an attribute whose setting has no effect and needs none, and `, Rerender` for one that may change
//! between the frames of re-rendering mode (reference 11.1).

use super::key::{AttributeValue, Key, scope};
use super::{AttributeRow, DefaultValue, Effect, Mark, Scope};
use DefaultValue::{Floats, Ints, OneOf, Text, Unset};
use granita_base::Color;
use std::sync::Arc;

/// Makes a key for each row, and the table of all rows.
macro_rules! attributes {
    ($($key:ident: $scope:ident, $value:ty =
        $section:literal, $name:literal, $default:expr, $help:literal $(, $mark:ident)*;)*) => {
        $(
            #[doc = concat!("`", $name, "` (reference ", $section, "): ", $help, ".")]
            pub const $key: Key<scope::$scope, $value> = {
                const ROW: AttributeRow = AttributeRow {
                    name: $name,
                    ty: <$value as AttributeValue>::TYPE,
                    default: $default,
                    scope: Scope::$scope,
                    section: $section,
                    help: $help,
                    effect: Effect::Full,
                    rerender: false,
                }
                .marked(&[$(Mark::$mark),*]);
                Key::new(&ROW)
            };
        )*

        /// All attributes, in the order of the reference.
        pub const TABLE: &[AttributeRow] = &[$(*$key.row()),*];
    };
}

attributes! {
    // 4.1 Camera attributes
    PROJECTION: Camera, Arc<str> = "4.1", "projection", OneOf(&["perspective", "orthographic"]),
        "kind of projection";
    FOV: Camera, f32 = "4.1", "fov", Floats(&[90.0]),
        "vertical field of view of a perspective camera, in degrees";
    SCREEN: Camera, Option<[f32; 4]> = "4.1", "screen", Unset,
        "xmin xmax ymin ymax of the part of the plane z = 1 that is the image";
    RESOLUTION: Camera, [i32; 2] = "4.1", "resolution", Ints(&[640, 480]),
        "width and height of the full image in pixels";
    PIXELASPECT: Camera, f32 = "4.1", "pixelaspect", Floats(&[1.0]),
        "width of a pixel over its height, for the readers of files";
    CROP: Camera, [f32; 4] = "4.1", "crop", Floats(&[0.0, 1.0, 0.0, 1.0]),
        "xmin xmax ymin ymax of the pixels to make, in NDC", Rerender;
    NEAR: Camera, f32 = "4.1", "near", Floats(&[0.1]), "near clipping plane, along z of the camera";
    FAR: Camera, f32 = "4.1", "far", Floats(&[1.0e6]), "far clipping plane, along z of the camera";
    SHUTTER: Camera, [f32; 2] = "4.1", "shutter", Floats(&[0.0, 0.0]),
        "opening and closing time of the shutter";
    FSTOP: Camera, f32 = "4.1", "fstop", Floats(&[1.0e30]),
        "focal length divided by the lens diameter; 1e30 is a pinhole";
    FOCALLENGTH: Camera, Option<f32> = "4.1", "focallength", Unset,
        "focal length of the lens in units of the camera's space";
    FOCALDISTANCE: Camera, Option<f32> = "4.1", "focaldistance", Unset,
        "distance in focus in units of the camera's space";
    SPATIALQUALITY: Camera, [i32; 2] = "4.1", "spatialquality", Ints(&[4, 4]),
        "least number of samples per pixel along x and y", Rerender;
    TEMPORALQUALITY: Camera, i32 = "4.1", "temporalquality", Ints(&[16]),
        "least number of time samples for motion blur", Rerender;
    DOFQUALITY: Camera, i32 = "4.1", "dofquality", Ints(&[16]),
        "least number of lens samples for depth of field", Rerender;
    LIMITS_BUCKETSIZE: Camera, [i32; 2] = "4.1", "limits:bucketsize", Ints(&[32, 32]),
        "size of a bucket in pixels";
    BUCKETORDER: Camera, Arc<str> = "4.1", "bucketorder", OneOf(&["horizontal", "vertical", "spiral"]),
        "order in which buckets are made: \"horizontal\", \"vertical\" or \"spiral\"; images of more than 256 MiB are rendered from the top", Rerender;
    LIMITS_BUCKETBLOCKSIZE: Camera, i32 = "4.1", "limits:bucketblocksize", Ints(&[2]),
        "number of buckets along each side of a cluster; clusters are rendered one after the other";
    LIMITS_AUTOPASSREDUCTION: Camera, bool = "4.1", "limits:autopassreduction", Ints(&[1]),
        "reduce the samples where nothing blurs";
    PREVIEW: Camera, f32 = "4.1", "preview", Floats(&[0.0]),
        "shading quality of preview mode; 0 is no preview";
    PREVIEW_SPATIALQUALITY: Camera, [i32; 2] = "4.1", "preview:spatialquality", Ints(&[1, 1]),
        "spatialquality in preview mode";
    PREVIEW_TEMPORALQUALITY: Camera, i32 = "4.1", "preview:temporalquality", Ints(&[1]),
        "temporalquality in preview mode";
    PREVIEW_DOFQUALITY: Camera, i32 = "4.1", "preview:dofquality", Ints(&[1]), "dofquality in preview mode";
    PREVIEW_BUCKETSIZE: Camera, [i32; 2] = "4.1", "preview:bucketsize", Ints(&[2048, 2048]),
        "limits:bucketsize in preview mode";
    PREVIEW_DICECURVATURE: Camera, f32 = "4.1", "preview:dicecurvature", Floats(&[90.0]),
        "dice:curvature in preview mode";
    PREVIEW_THINCURVES: Camera, i32 = "4.1", "preview:thincurves", Ints(&[10]),
        "in preview mode, the number of curves of which one is drawn";
    PREVIEW_THINPOINTS: Camera, i32 = "4.1", "preview:thinpoints", Ints(&[10]),
        "in preview mode, the number of points of which one is drawn";
    PREVIEW_LIMITPIXELSIZE: Camera, f32 = "4.1", "preview:limitpixelsize", Floats(&[0.0]),
        "in preview mode, objects that cover fewer pixels are drawn as boxes";
    PREVIEW_LIMITDISTANCE: Camera, f32 = "4.1", "preview:limitdistance", Floats(&[1.0e38]),
        "in preview mode, objects beyond this distance are drawn as boxes";
    HIDER: Camera, Arc<str> = "4.1", "hider", OneOf(&["default"]), "hidden surface method";
    SHADERTYPE: Camera, Arc<str> = "4.1", "shadertype", OneOf(&["gsl", "defaultsurface", "keyfillrim"]),
        "shading system";
    STEREO_SEPARATION: Camera, f32 = "4.1", "stereo:separation", Floats(&[0.0]),
        "distance of the two views along x; 0 renders one view";
    STEREO_CONVERGENCE: Camera, f32 = "4.1", "stereo:convergence", Floats(&[0.0]),
        "depth at which the two views coincide";
    STEREO_PROJECTION: Camera, Arc<str> = "4.1", "stereo:projection", OneOf(&["off-axis", "parallel", "toe-in"]),
        "method by which the two views converge";
    STEREO_SHADE: Camera, Arc<str> = "4.1", "stereo:shade", OneOf(&["center", "left", "right"]),
        "view from which stereo is shaded";
    // 4.2 Output attributes
    FILTER: Output, Arc<str> = "4.2", "filter",
        OneOf(&["gaussian", "box", "triangle", "catmull-rom", "sinc", "blackman-harris", "mitchell", "b-spline", "min", "max", "average", "closest"]),
        "pixel filter; min, max and average for depths only, closest for values without a mean";
    FILTERWIDTH: Output, [f32; 2] = "4.2", "filterwidth", Floats(&[2.0, 2.0]),
        "width of the pixel filter in pixels, x and y";
    GAMMA: Output, f32 = "4.2", "gamma", Floats(&[1.0]), "exponent 1/gamma is applied to colours", Rerender;
    GAIN: Output, f32 = "4.2", "gain", Floats(&[1.0]), "colours are multiplied by it before gamma", Rerender;
    QUANTIZE: Output, [i32; 4] = "4.2", "quantize", Ints(&[0, 255, 0, 255]),
        "integers of 0 and of 1, and their limits; all 0: floats", Rerender;
    DITHER: Output, f32 = "4.2", "dither", Floats(&[0.5]), "amplitude of the noise added before rounding", Rerender;
    PIXELTYPE: Output, Arc<str> = "4.2", "pixeltype", OneOf(&["half", "float"]),
        "numbers in formats of halves (OpenEXR): \"half\" or \"float\"";
    STEREO_LEFT: Output, Arc<str> = "4.2", "stereo:left", Text(""), "file name of the left view";
    STEREO_RIGHT: Output, Arc<str> = "4.2", "stereo:right", Text(""), "file name of the right view";
    ZCHANNELS: Output, i32 = "4.2", "zchannels", Ints(&[3]), "depths per pixel of a volume shadow, 2 or more";
    OPAQUEWIDTH: Output, f32 = "4.2", "opaquewidth", Floats(&[0.05]),
        "depth range that counts as one opaque object in a volume shadow";
    PART: Output, Arc<str> = "4.2", "part", Text(""),
        "name of the part of the file that the image becomes, in formats of several (OpenEXR)";
    CRYPTOMATTE_RANKS: Output, i32 = "4.2", "cryptomatte:ranks", Ints(&[6]),
        "number of objects or materials per pixel of a Cryptomatte, 2 to 64";
    DENOISE: Output, bool = "4.2", "denoise", Ints(&[1]),
        "0: the image keeps its noise where \"render:denoise\" is 1";
    DYNAMIC: Output, bool = "4.2", "dynamic", Ints(&[0]), "the image is made on demand and not written";
    // 4.3 Scene-wide attributes
    PASS: Global, Arc<str> = "4.3.1", "pass", Text(""), "name of the rendering pass";
    UNITS_LENGTH: Global, Arc<str> = "4.3.2", "units:length", OneOf(&["", "mm", "cm", "m", "km", "in", "ft", "mi"]),
        "physical unit of \"common\" space";
    UNITS_LENGTHSCALE: Global, f32 = "4.3.2", "units:lengthscale", Floats(&[1.0]),
        "physical units in one unit of \"common\" space";
    UNITS_FPS: Global, f32 = "4.3.2", "units:fps", Floats(&[24.0]), "frames per second";
    UNITS_TIME: Global, Arc<str> = "4.3.2", "units:time", OneOf(&["", "s", "frames"]),
        "unit of the times of Motion and shutter";
    UNITS_TIMESCALE: Global, f32 = "4.3.2", "units:timescale", Floats(&[1.0]),
        "seconds or frames in one unit of the times of Motion and shutter";
    RERENDER: Global, bool = "4.3.3", "rerender", Ints(&[0]), "allow changes and further calls of Render";
    RERENDER_MEMORY: Global, i32 = "4.3.3", "rerender:memory", Ints(&[0]),
        "memory limit of re-rendering in KB; 0 for no limit", Rerender;
    RERENDER_RESHADERAYS: Global, bool = "4.3.3", "rerender:reshaderays", Ints(&[1]),
        "shade rays again when a surface that they hit has changed", Rerender;
    RERENDER_FILEPATTERN: Global, Arc<str> = "4.3.3", "rerender:filepattern", Text(".*"),
        "files that are read again before re-rendering", Rerender;
    LIMITS_THREADS: Global, i32 = "4.3.4", "limits:threads", Ints(&[1]),
        "number of threads that render; `gelato` renders with one per core when it is not set";
    LIMITS_GRIDSIZE: Global, i32 = "4.3.4", "limits:gridsize", Ints(&[256]), "largest number of points that are shaded at once";
    LIMITS_PRIMITIVEPOINTS: Global, i32 = "4.3.4", "limits:primitivepoints", Ints(&[250_000_000]),
        "largest number of points of a diced primitive in a frame; 0 for any number";
    LIMITS_TEXTUREMEMORY: Global, i32 = "4.3.4", "limits:texturememory", Ints(&[20480]),
        "size of the texture cache in KB", Rerender;
    LIMITS_TEXTUREFILES: Global, i32 = "4.3.4", "limits:texturefiles", Ints(&[1000]),
        "largest number of open texture files";
    TRIMCURVE_QUALITY: Global, f32 = "4.3.4", "trimcurve:quality", Floats(&[1.0]),
        "factor of the quality of trim curves";
    LIMITS_TRIMCURVEMEMORY: Global, i32 = "4.3.4", "limits:trimcurvememory", Ints(&[10240]),
        "size of the trim curve cache in KB; it has no effect, because curves are converted to polygons once", Hint, Rerender;
    LIMITS_TRANSPARENTLAYERS: Global, i32 = "4.3.4", "limits:transparentlayers", Ints(&[-1]),
        "largest number of transparent layers of a pixel; -1 for any number";
    LIMITS_OPACITYTHRESHOLD: Global, Color = "4.3.4", "limits:opacitythreshold", Floats(&[1.0, 1.0, 1.0]),
        "opacity from which a surface counts as opaque";
    SHADOW_OPACITYTHRESHOLD: Global, Color = "4.3.4", "shadow:opacitythreshold", Floats(&[1.0, 1.0, 1.0]),
        "opacity from which a surface appears in shadow maps";
    LIMITS_TRANSPARENTGRIDS: Global, i32 = "4.3.4", "limits:transparentgrids", Ints(&[32]),
        "mean number of transparent layers that are composited together; numbers above 8 have no effect";
    DICE_FIXEDUNAME: Global, Arc<str> = "4.3.4", "dice:fixeduname", Text("u"),
        "variable that measures fixed dicing along u";
    DICE_FIXEDVNAME: Global, Arc<str> = "4.3.4", "dice:fixedvname", Text("v"),
        "variable that measures fixed dicing along v";
    RAY_MAXDEPTH: Global, i32 = "4.3.5", "ray:maxdepth", Ints(&[2]), "largest number of bounces of a ray";
    RAY_MAXDEPTHCOLOR: Global, Color = "4.3.5", "ray:maxdepthcolor", Floats(&[0.0, 0.0, 0.0]),
        "colour of rays beyond the last bounce";
    RAY_DEEPSAMPLES: Global, f32 = "4.3.5", "ray:deepsamples", Floats(&[1.0]),
        "rays of a reflection after the first bounce, as a multiple of its share of the samples";
    RAY_MINWEIGHT: Global, f32 = "4.3.5", "ray:minweight", Floats(&[0.001]),
        "weight of reflections below which only some of them are traced";
    INDIRECT_MAXDEPTH: Global, i32 = "4.3.5", "indirect:maxdepth", Ints(&[1]),
        "largest number of bounces of indirect light";
    PATH_INPUT: Global, Arc<str> = "4.3.6", "path:input", Text(".:$GELATOHOME/inputs"),
        "search path of scene files", Rerender;
    PATH_TEXTURE: Global, Arc<str> = "4.3.6", "path:texture", Text(".:$GELATOHOME/textures"),
        "search path of textures", Rerender;
    PATH_SHADER: Global, Arc<str> = "4.3.6", "path:shader", Text(".:$GELATOHOME/shaders"),
        "search path of shaders", Rerender;
    PATH_GENERATOR: Global, Arc<str> = "4.3.6", "path:generator", Text(".:$GELATOHOME/lib"),
        "search path of generators", Rerender;
    PATH_IMAGEIO: Global, Arc<str> = "4.3.6", "path:imageio", Text(".:$GELATOHOME/lib"),
        "search path of image plugins", Rerender;
    VERBOSITY: Global, i32 = "4.3.7", "verbosity", Ints(&[1]),
        "level of messages: 0 errors, 1 also warnings, 2 all", Rerender;
    ERROR_FILENAME: Global, Arc<str> = "4.3.7", "error:filename", Text(""),
        "file for messages; standard error when empty";
    STATISTICS_LEVEL: Global, i32 = "4.3.7", "statistics:level", Ints(&[0]), "level of statistics; 0 prints none", Rerender;
    STATISTICS_FILENAME: Global, Arc<str> = "4.3.7", "statistics:filename", Text(""),
        "file for statistics; standard output when empty", Rerender;
    DEBUG_DSO: Global, bool = "4.3.7", "debug:dso", Ints(&[0]), "report every plugin that is tried";
    DEBUG_FILESREAD: Global, Arc<str> = "4.3.7", "debug:filesread", Text(""),
        "file for the names of all files read";
    DEBUG_SHADERNAN: Global, bool = "4.3.7", "debug:shadernan", Ints(&[0]), "report NaN in shaders";
    RANDOM_SEED: Global, i32 = "5.8.6", "random:seed", Ints(&[0]),
        "seed of random () and randomgrid () in shaders";
    GRIDDUMP_FILENAME: Global, Arc<str> = "4.3.7", "griddump:filename", Text(""),
        "file for all shaded grids, as Pyg";
    GRIDDUMP_BINARY: Global, bool = "4.3.7", "griddump:binary", Ints(&[0]), "write the grids as binary Pyg";
    TEXTURE_SUBSTTEXTURE: Global, Arc<str> = "4.3.8", "texture:substtexture", Text(""),
        "texture that replaces all textures";
    TEXTURE_SUBSTENV: Global, Arc<str> = "4.3.8", "texture:substenv", Text(""),
        "map that replaces all environment maps";
    TEXTURE_AUTOMIPMAP: Global, bool = "4.3.8", "texture:automipmap", Ints(&[1]),
        "make MIP maps of images that are used as textures";
    SPATIALDB_WRITE: Global, Option<Arc<[Arc<str>]>> = "4.3.9", "spatialdb:write", Unset,
        "spatial databases written after rendering";
    SPATIALDB_READ: Global, Option<Arc<[Arc<str>]>> = "4.3.9", "spatialdb:read", Unset,
        "spatial databases that are loaded at the first query";
    SPATIALDB_READONLY: Global, Option<Arc<[Arc<str>]>> = "4.3.9", "spatialdb:readonly", Unset,
        "spatial databases that are loaded and never extended";
    SPATIALDB_WRITEONLY: Global, Option<Arc<[Arc<str>]>> = "4.3.9", "spatialdb:writeonly", Unset,
        "spatial databases that are written and never queried";
    RENDERER_NAME: ReadOnly, Arc<str> = "4.3.10", "renderer:name", Text("Granita"), "name of the renderer";
    RENDERER_VERSION: ReadOnly, Option<[i32; 4]> = "4.3.10", "renderer:version", Unset,
        "major, minor, release and patch number";
    RENDERER_VERSIONSTRING: ReadOnly, Option<Arc<str>> = "4.3.10", "renderer:versionstring", Unset,
        "the four numbers of the version, as \"2.1.0.0\"";
    RENDER_PASSES: Global, i32 = "4.3.10", "render:passes", Ints(&[0]),
        "number of passes whose sum the images are; 0 for a frame of its own", Rerender;
    RENDER_FINER: Global, i32 = "4.3.10", "render:finer", Ints(&[1]),
        "how many times as fine surfaces are in passes, without a requested error: 1, 2, 4, 8, 16 or 32", Rerender;
    RENDER_LARGER: Global, [i32; 2] = "4.3.10", "render:larger", Ints(&[1, 1]),
        "how many times the samples of pixels, and of lights and rays, passes have without a requested error: 1, 4 or 16", Rerender;
    RENDER_SECONDS: Global, f32 = "4.3.10", "render:seconds", Floats(&[0.0]),
        "seconds after which a frame takes no more passes; 0 for any time", Rerender;
    RENDER_ERROR: Global, f32 = "4.3.10", "render:error", Floats(&[0.0]),
        "error at which images take no more passes, as a fraction of their mean; 0 for none", Rerender;
    RENDER_SAMPLES: Global, f32 = "4.3.10", "render:samples", Floats(&[1.0]),
        "factor of the numbers of samples of lights, soft shadows, glossy reflections, occlusion and indirect light", Rerender;
    RENDER_CAUSES: Global, bool = "4.3.10", "render:causes", Ints(&[0]),
        "1: measure what the noise of an image of passes comes from", Rerender;
    RENDER_DENOISE: Global, i32 = "4.3.10", "render:denoise", Ints(&[0]),
        "1: remove the noise of images with colours, with Open Image Denoise; 2: the same with the samples and the surfaces as they are", Rerender;
    RENDER_DENOISELIBRARY: Global, Arc<str> = "4.3.10", "render:denoiselibrary", Text(""),
        "library of Open Image Denoise, or its folder; empty for the one that the system finds", Rerender;
    RENDER_PROGRESS: ReadOnly, f32 = "4.3.10", "render:progress", Floats(&[0.0]),
        "finished part of the frame, 0 to 1";
    RENDER_SUCCESS: ReadOnly, bool = "4.3.10", "render:success", Ints(&[0]),
        "1 when the last frame was finished, else 0";
    NET_WORKERS: Global, Arc<str> = "4.3.11", "net:workers", Text(""),
        "machines that share the work, as `gelato -net`; \"local\" is this one";
    NET_WORKERCMD: Global, Arc<str> = "4.3.11", "net:workercmd", Text(""),
        "command that runs `gelato` on them; empty for that name";
    NET_TIMEOUT: Global, f32 = "4.3.11", "net:timeout", Floats(&[60.0]),
        "seconds without an answer, at least 2, after which the work of a machine is given to others";
    NET_TINT: Global, i32 = "4.3.11", "net:tint", Ints(&[0]), "tint buckets by worker, with this seed";
    PYG_BINARY: Writer, bool = "4.3.12", "pyg:binary", Ints(&[0]), "write large arrays in binary";
    PYG_SEPARATEPARAMS: Writer, bool = "4.3.12", "pyg:separateparams", Ints(&[0]),
        "write parameters as separate calls";
    PYG_INDENT: Writer, i32 = "4.3.12", "pyg:indent", Ints(&[0]), "blanks added to the indentation";
    LIMITS_INPUTLEVELS: Writer, i32 = "4.3.12", "limits:inputlevels", Ints(&[0]),
        "number of levels of Input that are expanded";
    // 4.4 Per-object attributes
    TRANSFORM: ReadOnly, Option<[f32; 16]> = "4.4.1", "transform", Unset,
        "object space to world when the shutter opens";
    NAME: Object, Arc<str> = "4.4.2", "name", Text(""), "name of the object, for messages and Modify";
    GEOMETRYSET: Object, Arc<str> = "4.4.3", "geometryset", Text("camera"),
        "geometry sets, with + and - to change the list";
    COLOR: Object, Color = "4.4.4", "C", Floats(&[1.0, 1.0, 1.0]), "surface colour";
    OPACITY: Object, Color = "4.4.4", "opacity", Floats(&[1.0, 1.0, 1.0]), "surface opacity";
    HOLDOUT: Object, i32 = "4.4.4", "holdout", Ints(&[0]),
        "0 visible, 1 holdout matte, 2 shaded holdout matte";
    ORIENTATION: Object, Arc<str> = "4.4.4", "orientation", OneOf(&["outside", "inside", "lh", "rh", "reverse"]),
        "side to which normals point; faces whose given normals are all on the other side follow the given ones";
    TWOSIDED: Object, bool = "4.4.4", "twosided", Ints(&[1]), "visible from both sides";
    SHADINGQUALITY: Object, f32 = "4.4.4", "shadingquality", Floats(&[1.0]),
        "number of shading points per pixel of distance";
    DICE_BINARY: Object, bool = "4.4.5", "dice:binary", Ints(&[0]), "dice by powers of two";
    DICE_CURVATURE: Object, f32 = "4.4.5", "dice:curvature", Floats(&[10.0]),
        "angle in degrees that forces finer dicing";
    DICE_HIGHCURVATURE: Object, f32 = "4.4.5", "dice:highcurvature", Floats(&[120.0]),
        "angle in degrees that forces finer dicing at any size";
    DICE_MOTIONFACTOR: Object, f32 = "4.4.5", "dice:motionfactor", Floats(&[1.0]),
        "factor by which moving objects are diced more coarsely";
    DICE_KEEPCREASES: Object, bool = "4.4.5", "dice:keepcreases", Ints(&[0]),
        "split curves at every crease; patches and meshes are always split there";
    DICE_RASTERORIENT: Object, bool = "4.4.5", "dice:rasterorient", Ints(&[1]),
        "dice by the projected size in the image";
    DICE_FIXED: Object, [f32; 2] = "4.4.5", "dice:fixed", Floats(&[0.0, 0.0]),
        "number of facets per unit of u and v; 0 0 disables fixed dicing";
    DICE_THINCURVE: Object, f32 = "4.4.5", "dice:thincurve", Floats(&[1.0]),
        "width in pixels below which curves are simplified";
    CULL_OCCLUSION: Object, bool = "4.4.5", "cull:occlusion", Ints(&[1]), "cull hidden surfaces before shading";
    DISPLACE_MAXRADIUS: Object, f32 = "4.4.6", "displace:maxradius", Floats(&[0.0]), "largest displacement";
    DISPLACE_MAXSPACE: Object, Arc<str> = "4.4.6", "displace:maxspace", Text("common"),
        "space in which displace:maxradius is measured";
    SHADING_VIEW: Object, Arc<str> = "4.4.7", "shading:view", OneOf(&["camera", "outside", "inside"]),
        "meaning of I on grids that the camera sees";
    TRIMCURVE_SENSE: Object, Arc<str> = "4.4.8", "trimcurve:sense", OneOf(&["inside", "outside"]),
        "side of trim curves that is discarded";
    TRIMCURVE_CURVATURE: Object, f32 = "4.4.8", "trimcurve:curvature", Floats(&[10.0]),
        "angle in degrees that forces more segments of trim curves";
    LIGHT_NSAMPLES: Object, i32 = "2.4", "light:nsamples", Ints(&[1]), "number of samples of an area light";
    RAY_OPAQUESHADOWS: Object, bool = "4.4.9", "ray:opaqueshadows", Ints(&[0]),
        "opaque to shadow rays, whatever the shader computes";
    RAY_MOTION: Object, bool = "4.4.9", "ray:motion", Ints(&[0]), "rays from it see motion blur";
    RAY_DISPLACE: Object, bool = "4.4.9", "ray:displace", Ints(&[1]), "rays hit displaced surfaces instead of bumps";
    SHADOW_BIAS: Object, f32 = "4.4.9", "shadow:bias", Floats(&[0.01]), "bias of shadow maps and rays";
    INDIRECT_MAXERROR: Object, f32 = "4.4.10", "indirect:maxerror", Floats(&[0.25]),
        "largest error of interpolated indirect light";
    INDIRECT_MAXPIXELDIST: Object, f32 = "4.4.10", "indirect:maxpixeldist", Floats(&[20.0]),
        "largest distance in pixels between indirect samples";
    INDIRECT_MINSAMPLES: Object, i32 = "4.4.10", "indirect:minsamples", Ints(&[3]),
        "least number of indirect samples that are interpolated";
    INDIRECT_SPATIALDB: Object, Arc<str> = "4.4.10", "indirect:spatialdb", Text("indirect.sdb"),
        "spatial database of indirect light";
    OCCLUSION_MAXERROR: Object, f32 = "4.4.11", "occlusion:maxerror", Floats(&[0.25]),
        "largest error of interpolated occlusion";
    OCCLUSION_MAXPIXELDIST: Object, f32 = "4.4.11", "occlusion:maxpixeldist", Floats(&[20.0]),
        "largest distance in pixels between occlusion samples";
    OCCLUSION_MINSAMPLES: Object, i32 = "4.4.11", "occlusion:minsamples", Ints(&[3]),
        "least number of occlusion samples that are interpolated";
    OCCLUSION_SPATIALDB: Object, Arc<str> = "4.4.11", "occlusion:spatialdb", Text("occlusion.sdb"),
        "spatial database of occlusion";
    RERENDER_LOCKED: Object, bool = "4.4.12", "rerender:locked", Ints(&[0]),
        "keep the shading of the object when re-rendering", Rerender;
    RERENDER_CACHELIGHTS: Object, bool = "4.4.12", "rerender:cachelights", Ints(&[1]),
        "keep the results of lights when re-rendering";
}
