//! Queries to the renderer, and their results.

use super::handle::MapHandle;
use super::lanes::{Batch, Lane, Lane3};
use super::options::{EnvironmentOptions, GatherOptions, ShadowOptions, TextureOptions, TraceOptions};
use crate::{Lanes3, Message, Primvar};
use granita_gsl::ir::ValueType;
use std::sync::Arc;

/// A query of `texture ()`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct TextureQuery<'a> {
    pub batch: Batch<'a>,
    pub name: &'a str,
    /// The handle that keeps the map, when the name is a constant.
    pub handle: Option<&'a MapHandle>,
    pub s: Lane<'a>,
    pub t: Lane<'a>,
    pub dsdx: Lane<'a>,
    pub dtdx: Lane<'a>,
    pub dsdy: Lane<'a>,
    pub dtdy: Lane<'a>,
    /// The requested number of channels, 1 or 3.
    pub channels: usize,
    pub options: TextureOptions<Lane<'a>, &'a str>,
}

/// A query of `texture3d ()`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct Texture3dQuery<'a> {
    pub batch: Batch<'a>,
    pub name: &'a str,
    /// The handle that keeps the map, when the name is a constant.
    pub handle: Option<&'a MapHandle>,
    pub p: Lane3<'a>,
    /// Differences of `p` between neighbouring points.
    pub dpdx: Lane3<'a>,
    pub dpdy: Lane3<'a>,
    /// The requested number of channels, 1 or 3.
    pub channels: usize,
    pub options: TextureOptions<Lane<'a>, &'a str>,
}

/// A query of `environment ()`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct EnvironmentQuery<'a> {
    pub batch: Batch<'a>,
    /// A map file or a geometry set.
    pub name: &'a str,
    /// The handle that keeps the map, when the name is a constant.
    pub handle: Option<&'a MapHandle>,
    pub p: Lane3<'a>,
    pub r: Lane3<'a>,
    pub drdx: Lane3<'a>,
    pub drdy: Lane3<'a>,
    /// Differentials of `p` between neighbouring points, for ray footprints.
    pub dpdx: Lane3<'a>,
    pub dpdy: Lane3<'a>,
    pub channels: usize,
    pub options: EnvironmentOptions<Lane<'a>, &'a str>,
    /// The messages and parameters of the shader for the shaders that its rays hit, in the order of
    /// [`Grid::parent`](crate::Grid::parent). Empty unless they [query](super::Rays::queries_parent) them.
    pub messages: &'a [Primvar],
}

/// The results of a lookup for every lane, component by component.
#[derive(Clone, Debug, Default)]
pub struct LookupResult {
    /// `channels` arrays of the grid's length.
    pub value: Vec<Vec<f32>>,
    /// The channel after them, or the opacity of the ray hits.
    pub alpha: Vec<f32>,
    /// The mean distance of hits, or 1e38. Only ray-traced environments fill it; else empty.
    pub hitdist: Vec<f32>,
    /// Mean position of hits; empty when not traced.
    pub p_hit: Lanes3,
    /// Mean normal of hits; empty when not traced.
    pub n_hit: Lanes3,
    /// The sampled unit directions; empty when none were sampled.
    pub direction: Lanes3,
}

/// A query of `shadow ()`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct ShadowQuery<'a> {
    pub batch: Batch<'a>,
    /// A map file or a geometry set.
    pub name: &'a str,
    /// The handle that keeps the map, when the name is a constant.
    pub handle: Option<&'a MapHandle>,
    pub p: Lane3<'a>,
    pub dpdx: Lane3<'a>,
    pub dpdy: Lane3<'a>,
    /// The direction from `p` to the light inside `emit`. Rays end there (or continue when `light_infinite`).
    pub to_light: Lane3<'a>,
    pub light_infinite: bool,
    pub options: ShadowOptions<Lane<'a>, &'a str>,
    /// The messages and parameters of the shader for the shaders that its rays hit, in the order of
    /// [`Grid::parent`](crate::Grid::parent). Empty unless they [query](super::Rays::queries_parent) them.
    pub messages: &'a [Primvar],
}

/// The properties of a light that are available without running it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LightInfo {
    /// True when its shader has no `emit`.
    pub ambient: bool,
    /// The value of its `__category` parameter, empty without one.
    pub category: Arc<str>,
}

/// A query of the light at positions.
#[derive(Clone, Copy, Debug)]
pub struct IlluminateQuery<'a> {
    /// The lanes.
    pub batch: Batch<'a>,
    /// Positions, `Ps` of the light shader.
    pub ps: Lane3<'a>,
    /// Axis, `Ns` of the light shader; any length.
    pub ns: Lane3<'a>,
    /// Points on the light, `Pl` of the shader of an area light; `None` for other lights.
    pub pl: Option<Lane3<'a>>,
    /// Normals there, `Nl`.
    pub nl: Option<Lane3<'a>>,
    /// Positions in the unit square that select the direction of a broad solar light (`emit` with a spread) for
    /// this run. With `None`, the central direction represents all.
    pub cone: Option<[Lane<'a>; 2]>,
    /// True when only light from within 90 degrees of the axis counts. Other light is not used.
    pub in_front: bool,
    /// True when the shader queries messages and parameters of lights, so that the result must contain them.
    pub asks: bool,
    /// The messages and parameters of the shader that gathers, for a light that
    /// [queries](super::Lights::light_asks) them.
    pub messages: &'a [Message],
}

impl<'a> IlluminateQuery<'a> {
    /// Returns a query of all light that arrives at these positions, without other data.
    pub fn new(batch: Batch<'a>, ps: Lane3<'a>, ns: Lane3<'a>) -> Self {
        Self { batch, ps, ns, pl: None, nl: None, cone: None, in_front: false, asks: false, messages: &[] }
    }
}

/// The light that arrives from one sample of one light, for every lane of the grid.
#[derive(Clone, Debug, Default)]
pub struct LightSample {
    /// Vectors from `Ps` to the light, of any length.
    pub l: Lanes3,
    /// Light colour.
    pub cl: Lanes3,
    /// Position of the light.
    pub pl: Lanes3,
    /// Normal of the light (area lights).
    pub nl: Lanes3,
    /// True for lanes that `emit` reached.
    pub lit: Vec<bool>,
}

/// All light of one light on a grid.
#[derive(Clone, Debug, Default)]
pub struct LightResult {
    /// One sample per executed `emit` body and area sample; empty for ambient lights.
    pub samples: Vec<LightSample>,
    /// `Cl` at the end of an ambient light's shader, for every lane.
    pub ambient: Option<Lanes3>,
    /// Value of `__nondiffuse` per lane; empty without the parameter.
    pub nondiffuse: Vec<f32>,
    /// Value of `__nonspecular` per lane; empty without the parameter.
    pub nonspecular: Vec<f32>,
    /// True when some `emit` had a spread and sent light from the direction of [`IlluminateQuery::cone`]. Other
    /// values of `cone` then give other light.
    pub broad: bool,
    /// Its parameters and, after them, its messages after the run, for `getmessage ("light", ...)`: one value per
    /// lane of the grid or one for all. Among entries of one name the last of the right type counts. Empty unless
    /// the query [requests](IlluminateQuery::asks) them.
    pub messages: Vec<Primvar>,
}

/// A query of the rays of a `trace` loop.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct TraceQuery<'a> {
    pub batch: Batch<'a>,
    pub set: &'a str,
    pub p: Lane3<'a>,
    pub axis: Lane3<'a>,
    /// The half angle in radians.
    pub angle: Lane<'a>,
    pub samples: Lane<'a>,
    /// The index of the sample of this iteration, from 0.
    pub sample: u32,
    pub options: TraceOptions<Lane<'a>, &'a str>,
    /// The variables of the hit surface that the body of the loop requests.
    pub wanted: &'a [(Arc<str>, ValueType)],
    /// The messages and parameters of the shader for the shaders that its rays hit, in the order of
    /// [`Grid::parent`](crate::Grid::parent). Empty unless they [query](super::Rays::queries_parent) them.
    pub messages: &'a [Primvar],
}

/// A query of `indirect ()` or `occlusion ()`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct GatherQuery<'a> {
    pub batch: Batch<'a>,
    pub set: &'a str,
    pub p: Lane3<'a>,
    pub axis: Lane3<'a>,
    /// The half angle in radians.
    pub angle: Lane<'a>,
    /// The number of samples from the options, or 1.
    pub samples: Lane<'a>,
    pub options: GatherOptions<Lane<'a>, &'a str>,
    /// The messages, as [`EnvironmentQuery::messages`].
    pub messages: &'a [Primvar],
}

/// The results of one ray per lane.
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
    /// The values of each requested variable, in their order, or none at all.
    pub others: Vec<HitValues>,
}

/// A message, parameter or global of the shaders at the hits of rays.
#[derive(Clone, Debug, Default)]
pub struct HitValues {
    /// By lane, true when the shader at the hit has a value of the name and type.
    pub there: Vec<bool>,
    /// Its value, component after component over all lanes.
    pub values: Vec<f32>,
}

/// The key of a record of a spatial database.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub enum DatabaseKey<'a> {
    /// A position on a surface.
    Surface { s: Lane<'a>, t: Lane<'a> },
    /// A point, in "common" space.
    Point { p: Lane3<'a> },
    /// A point and a direction, in "common" space.
    Oriented { p: Lane3<'a>, n: Lane3<'a> },
}

/// A query of `spatialdbsave ()`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct DatabaseSave<'a> {
    /// The points. With "interpolate" they are facets, whose records are the means of their corners.
    pub batch: Batch<'a>,
    pub name: &'a str,
    pub key: DatabaseKey<'a>,
    /// One or three components.
    pub data: &'a [Lane<'a>],
    /// The type of the data.
    pub value_type: ValueType,
    /// The mode: "w", "rw", "wo"; empty for that of the attributes.
    pub filemode: &'a str,
    /// The resolution in pixels of the image that a database over surfaces may become.
    pub resolution: Option<[f32; 2]>,
    /// The format: "8", "16", "half", "float" or empty.
    pub filedataformat: &'a str,
    /// The filter width in pixels of that image.
    pub writefilterwidth: f32,
}

/// A query of `spatialdbquery ()`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct DatabaseQuery<'a> {
    pub batch: Batch<'a>,
    pub name: &'a str,
    pub key: DatabaseKey<'a>,
    /// The requested type of the data.
    pub value_type: ValueType,
    pub maxerror: Lane<'a>,
    pub maxdist: Lane<'a>,
    pub minsamples: Lane<'a>,
    /// The filter: "value" or "areadensity".
    pub filter: &'a str,
    /// The mode: "r", "rw", "ro"; empty for that of the attributes.
    pub filemode: &'a str,
}

/// A query of `subsurface ()`.
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs, reason = "fields carry the argument names of the reference")]
pub struct SubsurfaceQuery<'a> {
    pub batch: Batch<'a>,
    /// The database with the baked light.
    pub name: &'a str,
    pub p: Lane3<'a>,
    pub n: Lane3<'a>,
    /// The reduced scattering coefficient in 1/mm.
    pub scattering: Lane3<'a>,
    /// The absorption coefficient in 1/mm.
    pub absorption: Lane3<'a>,
    /// The index of refraction.
    pub eta: Lane<'a>,
    pub maxsolidangle: Lane<'a>,
    /// The diffusion model: "dipole" (also when empty) or "beam".
    pub model: &'a str,
}
