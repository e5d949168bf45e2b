//! What shaders need from the renderer around them.
//!
//! The executor knows no texture, ray, light or scene. It calls these batch methods over the **active
//! lanes** of a grid; the renderer implements them, tests use doubles. Methods with a default body are
//! those a renderer may do without; the default says so by its result.

use crate::{Lanes3, Message, Primvar};
use granita_base::{Color, Location, Param, Severity, Transform, Vec3};
use granita_gsl::Func;
use granita_gsl::ir::ValueType;
use std::sync::Arc;

/// A float per lane, or one for all.
#[derive(Clone, Copy, Debug)]
pub struct Lane<'a> {
    /// Values; a single one when uniform.
    pub values: &'a [f32],
    /// 1 when there is a value per lane, 0 when uniform.
    pub stride: usize,
}

impl Lane<'_> {
    /// Value of lane `i`.
    pub fn get(&self, i: usize) -> f32 {
        self.values[i * self.stride]
    }
}

/// A triple per lane, or one for all.
#[derive(Clone, Copy, Debug)]
pub struct Lane3<'a> {
    /// x, y, z.
    pub xyz: [Lane<'a>; 3],
}

impl<'a> Lane3<'a> {
    /// Value of lane `i`.
    pub fn get(&self, i: usize) -> Vec3 {
        Vec3::new(self.xyz[0].get(i), self.xyz[1].get(i), self.xyz[2].get(i))
    }

    /// Over varying arrays.
    pub fn over(lanes: &'a Lanes3) -> Self {
        Self { xyz: std::array::from_fn(|c| Lane { values: &lanes.xyz[c], stride: 1 }) }
    }
}

/// What every batch call carries.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// Lanes of the grid.
    pub lanes: usize,
    /// Active lanes, increasing. Results go to these; others stay as they are.
    pub active: &'a [u32],
    /// Layer of the running group, for "shader" space.
    pub layer: usize,
}

/// Options of a lookup, by the names of reference 5.8.10; `None` when not given.
#[derive(Clone, Copy, Debug, Default)]
#[allow(missing_docs, reason = "fields carry the option names of the reference")]
pub struct LookupOptions<'a> {
    pub sblur: Option<Lane<'a>>,
    pub tblur: Option<Lane<'a>>,
    pub swidth: Option<Lane<'a>>,
    pub twidth: Option<Lane<'a>>,
    pub swrap: Option<&'a str>,
    pub twrap: Option<&'a str>,
    pub firstchannel: Option<Lane<'a>>,
    pub fill: Option<Lane<'a>>,
    pub angle: Option<Lane<'a>>,
    pub kr: Option<Lane<'a>>,
    pub space: Option<&'a str>,
    pub radius: Option<Lane<'a>>,
    pub up: Option<&'a str>,
    pub samples: Option<Lane<'a>>,
    /// Which of the samples: the map is not looked up along `r`, but in a direction drawn by its light.
    pub sample: Option<Lane<'a>>,
    pub bias: Option<Lane<'a>>,
    pub maxhitdist: Option<Lane<'a>>,
    pub shade: Option<Lane<'a>>,
    pub adaptive: Option<Lane<'a>>,
    pub maxerror: Option<Lane<'a>>,
    pub maxpixeldist: Option<Lane<'a>>,
    pub falloff: Option<Lane<'a>>,
    pub falloffmode: Option<Lane<'a>>,
    pub filename: Option<&'a str>,
    pub filemode: Option<&'a str>,
}

impl<'a> LookupOptions<'a> {
    /// Sets an option by its name, from the number or the text of its value, where an empty text and "default" are
    /// as good as none. Whether a lookup takes such an option.
    pub(crate) fn set(&mut self, name: &str, number: Option<Lane<'a>>, text: Option<&'a str>) -> bool {
        let text = text.filter(|t| !t.is_empty() && *t != "default");
        match name {
            "blur" => (self.sblur, self.tblur) = (number, number),
            "sblur" => self.sblur = number,
            "tblur" => self.tblur = number,
            "width" => (self.swidth, self.twidth) = (number, number),
            "swidth" => self.swidth = number,
            "twidth" => self.twidth = number,
            "wrap" => (self.swrap, self.twrap) = (text, text),
            "swrap" => self.swrap = text,
            "twrap" => self.twrap = text,
            "firstchannel" => self.firstchannel = number,
            "fill" => self.fill = number,
            "angle" => self.angle = number,
            "Kr" => self.kr = number,
            "space" => self.space = text,
            "radius" => self.radius = number,
            "up" => self.up = text,
            "samples" => self.samples = number,
            "sample" => self.sample = number,
            "bias" => self.bias = number,
            "maxhitdist" => self.maxhitdist = number,
            "shade" => self.shade = number,
            "adaptive" => self.adaptive = number,
            "maxerror" => self.maxerror = number,
            "maxpixeldist" => self.maxpixeldist = number,
            "falloff" => self.falloff = number,
            "falloffmode" => self.falloffmode = number,
            "filename" => self.filename = text,
            "filemode" => self.filemode = text,
            _ => return false,
        }
        true
    }
}

/// `texture ()`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct TextureQuery<'a> {
    pub batch: Batch<'a>,
    pub name: &'a str,
    pub s: Lane<'a>,
    pub t: Lane<'a>,
    pub dsdx: Lane<'a>,
    pub dtdx: Lane<'a>,
    pub dsdy: Lane<'a>,
    pub dtdy: Lane<'a>,
    /// 1 or 3 channels are wanted.
    pub channels: usize,
    pub options: LookupOptions<'a>,
}

/// `environment ()`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct EnvironmentQuery<'a> {
    pub batch: Batch<'a>,
    /// A map file or a geometry set.
    pub name: &'a str,
    pub p: Lane3<'a>,
    pub r: Lane3<'a>,
    pub drdx: Lane3<'a>,
    pub drdy: Lane3<'a>,
    /// Differentials of `p` between neighbouring points, for ray footprints.
    pub dpdx: Lane3<'a>,
    pub dpdy: Lane3<'a>,
    pub channels: usize,
    pub options: LookupOptions<'a>,
}

/// Results of a lookup for every lane; component by component.
#[derive(Clone, Debug, Default)]
pub struct LookupResult {
    /// `channels` arrays of the grid's length.
    pub value: Vec<Vec<f32>>,
    /// The channel after them, or the opacity of what rays hit.
    pub alpha: Vec<f32>,
    /// Mean distance of hits, or 1e38. Filled by ray-traced environments only; else empty.
    pub hitdist: Vec<f32>,
    /// Mean position of hits; empty when not traced.
    pub p_hit: Lanes3,
    /// Mean normal of hits; empty when not traced.
    pub n_hit: Lanes3,
    /// Directions that were drawn, of length 1; empty when none were.
    pub direction: Lanes3,
}

/// `shadow ()`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct ShadowQuery<'a> {
    pub batch: Batch<'a>,
    /// A map file or a geometry set.
    pub name: &'a str,
    pub p: Lane3<'a>,
    pub dpdx: Lane3<'a>,
    pub dpdy: Lane3<'a>,
    /// Direction from `p` to the light inside `emit`: rays end there (or run on when `light_infinite`).
    pub to_light: Lane3<'a>,
    pub light_infinite: bool,
    pub options: LookupOptions<'a>,
}

/// What is known of a light without running it.
#[derive(Clone, Debug, Default)]
pub struct LightInfo {
    /// Its shader has no `emit`.
    pub ambient: bool,
    /// Value of its `__category` parameter, empty without one.
    pub category: Arc<str>,
}

/// Where light is gathered.
#[derive(Clone, Copy, Debug)]
pub struct IlluminateQuery<'a> {
    /// Lanes.
    pub batch: Batch<'a>,
    /// Positions, `Ps` of the light shader.
    pub ps: Lane3<'a>,
    /// Axis, `Ns` of the light shader; any length.
    pub ns: Lane3<'a>,
    /// Points on the light, `Pl` of the shader of an area light; `None` for other lights.
    pub pl: Option<Lane3<'a>>,
    /// Normals there, `Nl`.
    pub nl: Option<Lane3<'a>>,
    /// Places in the unit square: which direction of a broad solar light (`emit` with a spread) this run stands for. `None`: the middle one,
    /// for all.
    pub cone: Option<[Lane<'a>; 2]>,
    /// Only light that comes from within 90 degrees of the axis counts; what else is sent is for nothing.
    pub in_front: bool,
    /// The shader asks lights for their messages and parameters: the result must hold them.
    pub asks: bool,
    /// Messages and parameters of the shader that gathers, for a light that [asks](Services::light_asks) for them.
    pub messages: &'a [Message],
}

impl<'a> IlluminateQuery<'a> {
    /// Asks for all light that arrives at these places, and for nothing else.
    pub fn new(batch: Batch<'a>, ps: Lane3<'a>, ns: Lane3<'a>) -> Self {
        Self { batch, ps, ns, pl: None, nl: None, cone: None, in_front: false, asks: false, messages: &[] }
    }
}

/// Light that arrives from one sample of one light, for every lane of the grid.
#[derive(Clone, Debug, Default)]
pub struct LightSample {
    /// From `Ps` to the light; any length.
    pub l: Lanes3,
    /// Light colour.
    pub cl: Lanes3,
    /// Position of the light.
    pub pl: Lanes3,
    /// Normal of the light (area lights).
    pub nl: Lanes3,
    /// Lanes that `emit` reached.
    pub lit: Vec<bool>,
}

/// All that one light sends to a grid.
#[derive(Clone, Debug, Default)]
pub struct LightResult {
    /// One per executed `emit` body and area sample; empty for ambient lights.
    pub samples: Vec<LightSample>,
    /// `Cl` at the end of an ambient light's shader, for every lane.
    pub ambient: Option<Lanes3>,
    /// Value of `__nondiffuse` per lane; empty without the parameter.
    pub nondiffuse: Vec<f32>,
    /// Value of `__nonspecular` per lane; empty without the parameter.
    pub nonspecular: Vec<f32>,
    /// Some `emit` had a spread and sent light from the direction that [`IlluminateQuery::cone`] says: other places give other light.
    pub broad: bool,
    /// Its parameters and, behind them, its messages after the run, for `getmessage ("light", ...)`: one value per lane
    /// of the grid or one for all. Of one name the last of the right type counts. Empty unless the query
    /// [asks](IlluminateQuery::asks) for them.
    pub messages: Vec<Primvar>,
}

/// Rays of a `trace` loop or of a probing function.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct TraceQuery<'a> {
    pub batch: Batch<'a>,
    pub set: &'a str,
    pub p: Lane3<'a>,
    pub axis: Lane3<'a>,
    /// Half angle in radians.
    pub angle: Lane<'a>,
    pub samples: Lane<'a>,
    /// Sample number of this iteration, from 0.
    pub sample: u32,
    /// "cosine" or "uniform".
    pub distribution: &'a str,
    pub options: LookupOptions<'a>,
    /// Variables of the surface hit that the body of the loop asks for.
    pub wanted: &'a [(Arc<str>, ValueType)],
}

/// What one ray per lane found.
#[derive(Clone, Debug, Default)]
#[allow(missing_docs, reason = "fields carry the message names of reference 5.5.5")]
pub struct TraceResult {
    pub hit: Vec<bool>,
    pub hitdist: Vec<f32>,
    pub l: Lanes3,
    pub ps: Lanes3,
    pub cl: Lanes3,
    pub ol: Lanes3,
    pub p: Lanes3,
    /// One for each that was wanted, in their order, or none at all.
    pub others: Vec<HitValues>,
}

/// A message, parameter or global of the shaders that rays met.
#[derive(Clone, Debug, Default)]
pub struct HitValues {
    /// By lane: whether the shader of what its ray met has one of the name and type.
    pub there: Vec<bool>,
    /// Its value, component after component over all lanes.
    pub values: Vec<f32>,
}

/// Where a record of a spatial database lies.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub enum DatabaseKey<'a> {
    /// A place on a surface.
    Surface { s: Lane<'a>, t: Lane<'a> },
    /// A point, in "common" space.
    Point { p: Lane3<'a> },
    /// A point and a direction, in "common" space.
    Oriented { p: Lane3<'a>, n: Lane3<'a> },
}

/// `spatialdbsave ()`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct DatabaseSave<'a> {
    /// Points; for "interpolate" facets, whose records are the means of their corners.
    pub batch: Batch<'a>,
    pub name: &'a str,
    pub key: DatabaseKey<'a>,
    /// One or three components.
    pub data: &'a [Lane<'a>],
    /// Type of the data.
    pub value_type: ValueType,
    /// "w", "rw", "wo"; empty for what the attributes say.
    pub filemode: &'a str,
    /// Of the image that a database over surfaces may become.
    pub resolution: Option<[f32; 2]>,
    /// "8", "16", "half", "float" or empty.
    pub filedataformat: &'a str,
    /// In pixels of that image.
    pub writefilterwidth: f32,
}

/// `spatialdbquery ()`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct DatabaseQuery<'a> {
    pub batch: Batch<'a>,
    pub name: &'a str,
    pub key: DatabaseKey<'a>,
    /// Type of the data that is wanted.
    pub value_type: ValueType,
    pub maxerror: Lane<'a>,
    pub maxdist: Lane<'a>,
    pub minsamples: Lane<'a>,
    /// "value" or "areadensity".
    pub filter: &'a str,
    /// "r", "rw", "ro"; empty for what the attributes say.
    pub filemode: &'a str,
}

/// `subsurface ()`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct SubsurfaceQuery<'a> {
    pub batch: Batch<'a>,
    /// The database with the baked light.
    pub name: &'a str,
    pub p: Lane3<'a>,
    pub n: Lane3<'a>,
    /// Reduced scattering coefficient, 1/mm.
    pub scattering: Lane3<'a>,
    /// Absorption coefficient, 1/mm.
    pub absorption: Lane3<'a>,
    /// Index of refraction.
    pub eta: Lane<'a>,
    pub maxsolidangle: Lane<'a>,
    /// How light spreads: "dipole" (also when empty) or "beam".
    pub model: &'a str,
}

/// Everything a running shader may ask of the renderer.
pub trait Services {
    /// The matrix from a named space to "common"; "shader" is the space of `layer`. `None` when unknown.
    fn to_common(&mut self, space: &str, layer: usize) -> Option<Transform>;

    /// Factor that turns a measure in `from` units into `to` units (reference 5.8.3 `transformu`), for
    /// names that are units ("mm", "s", "common" ...); spaces are handled by the executor.
    fn unit_scale(&mut self, from: &str, to: &str) -> Option<f32>;

    /// Filtered texture lookup.
    fn texture(&mut self, query: &TextureQuery<'_>, out: &mut LookupResult);

    /// Volume texture lookup at `p`, whose differences between neighbours are `dp`; by default fills with `fill`.
    fn texture3d(
        &mut self,
        query: &TextureQuery<'_>,
        p: Lane3<'_>,
        dp: [Lane3<'_>; 2],
        out: &mut LookupResult,
    ) {
        let _ = (p, dp);
        fill(query.batch, query.channels, query.options.fill, out);
    }

    /// Environment map lookup, or reflection rays.
    fn environment(&mut self, query: &EnvironmentQuery<'_>, out: &mut LookupResult);

    /// Shadow map lookup, or shadow rays: occlusion per lane, 0 open, 1 blocked.
    fn shadow(&mut self, query: &ShadowQuery<'_>, out: &mut Lanes3);

    /// Number of lights that shine on the object.
    fn light_count(&mut self) -> usize;

    /// Of light `index`.
    fn light_info(&mut self, index: usize) -> LightInfo;

    /// True when the shader of light `index` asks the surface or volume shader for messages
    /// ([`Group::listens_to`](crate::Group::listens_to)); queries bring them then.
    fn light_asks(&mut self, index: usize) -> bool {
        let _ = index;
        false
    }

    /// Runs light `index` for the lanes of `query`. Implementations cache: `diffuse` and `specular` of one
    /// shader ask the same question.
    fn illuminate(&mut self, index: usize, query: &IlluminateQuery<'_>) -> Arc<LightResult>;

    /// One ray per active lane; by default nothing is hit.
    fn trace(&mut self, query: &TraceQuery<'_>, out: &mut TraceResult) {
        let n = query.batch.lanes;
        out.hit = vec![false; n];
        out.hitdist = vec![1e30; n];
        for lanes in [&mut out.l, &mut out.ps, &mut out.cl, &mut out.ol, &mut out.p] {
            *lanes = Lanes3::zeros(n);
        }
    }

    /// Fraction of the cone that is blocked, and the mean open direction; by default open.
    fn occlusion(&mut self, query: &TraceQuery<'_>, out: &mut [f32], unoccluded: &mut Lanes3) {
        for &i in query.batch.active {
            out[i as usize] = 0.0;
            unoccluded.set(i as usize, query.axis.get(i as usize));
        }
    }

    /// Irradiance over the hemisphere; by default black.
    fn indirect(&mut self, query: &TraceQuery<'_>, out: &mut Lanes3) {
        for &i in query.batch.active {
            out.set(i as usize, Color::ZERO);
        }
    }

    /// Adds records to a spatial database; by default not supported.
    fn spatialdb_save(&mut self, query: &DatabaseSave<'_>) {
        let _ = query;
        self.unsupported("spatialdbsave");
    }

    /// Looks records up: one list of values per component, and the lanes in which enough was found (none before the
    /// call). By default not supported.
    fn spatialdb_query(&mut self, query: &DatabaseQuery<'_>, values: &mut [Vec<f32>], found: &mut [bool]) {
        let _ = (query, values, found);
        self.unsupported("spatialdbquery");
    }

    /// Light that was scattered inside of a material; black before the call. By default not supported.
    fn subsurface(&mut self, query: &SubsurfaceQuery<'_>, out: &mut Lanes3) {
        let _ = (query, out);
        self.unsupported("subsurface");
    }

    /// A renderer attribute, `user:` ones included.
    fn attribute(&mut self, name: &str) -> Option<Param>;

    /// Data about a texture file (reference table 5.5).
    fn texture_info(&mut self, texture: &str, name: &str) -> Option<Param>;

    /// Whether `environment` (with "sample") or `shadow` (without "samples") of this name look at how places and directions
    /// change between neighbouring points; if not, they get zeros. By default they do.
    fn wants_footprint(&mut self, name: &str, func: Func) -> bool {
        let _ = (name, func);
        true
    }

    /// Whether shaders of a geometry set's objects may ask the shader whose rays meet them
    /// ([`Group::asks_parent`](crate::Group::asks_parent)); by default not.
    fn is_asked_by(&mut self, set: &str) -> bool {
        let _ = set;
        false
    }

    /// What the running shader has to say to those shaders: its messages and parameters, one value per lane or
    /// one for all, in the order of [`Grid::parent`](crate::Grid::parent). Holds for the rays that are traced
    /// next, when [`Services::is_asked_by`] said so.
    fn say_to_rays(&mut self, values: Vec<Primvar>) {
        let _ = values;
    }

    /// `fprintf`: appends text to a file; by default not supported.
    fn append(&mut self, file: &str, text: &str) {
        let _ = (file, text);
        self.unsupported("fprintf");
    }

    /// A function in C++ that shaders call, by the text that the compiler leaves for it.
    ///
    /// # Errors
    /// Why there is none, to be said once.
    fn shadeop(&mut self, text: &str) -> Result<Arc<dyn crate::Shadeop>, String> {
        Err(format!("shadeop {text}: this program loads none"))
    }

    /// Whether the frame is to end early: loops are left then, and what the shader gives is not used.
    fn is_stopped(&mut self) -> bool {
        false
    }

    /// A message for the user: `printf` (as [`Severity::Message`]), `error`, or the executor's own.
    fn say(&mut self, severity: Severity, text: &str);

    /// A message about a running shader, of the program or by `error ()`: the name of the shader, and the place in its
    /// source where that is known. By default said with both.
    fn say_of(&mut self, severity: Severity, shader: &str, at: &Location, text: &str) {
        let place = if at.is_known() { format!("{at}: ") } else { String::new() };
        self.say(severity, &format!("{place}shader \"{shader}\": {text}"));
    }

    /// Said once per name of a feature that this renderer does not have yet.
    fn unsupported(&mut self, feature: &str) {
        self.say(Severity::Warning, &format!("{feature} is not supported yet"));
    }
}

/// Fills a result with the `fill` option (0 by default) and no alpha.
fn fill(batch: Batch<'_>, channels: usize, value: Option<Lane<'_>>, out: &mut LookupResult) {
    out.value.resize(channels, Vec::new());
    for channel in &mut out.value {
        channel.resize(batch.lanes, 0.0);
        for &i in batch.active {
            channel[i as usize] = value.map_or(0.0, |f| f.get(i as usize));
        }
    }
    out.alpha.resize(batch.lanes, 0.0);
}
