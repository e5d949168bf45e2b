//! The services of the renderer that shaders need.
//!
//! The executor has no code for textures, rays, lights or scenes. It calls these batch methods over the **active
//! lanes** of a grid. The renderer implements them, and tests use doubles. They are split into traits. Methods with
//! a default body are optional for a renderer, and the result of the default shows that the feature is missing.
//!
//! Every call carries all of its parameters. No state is set for later calls.

mod handle;
mod lanes;
mod options;
mod parts;
mod queries;

pub use handle::MapHandle;
pub use lanes::{Batch, Lane, Lane3};
pub use options::{EnvironmentOptions, GatherOptions, ShadowOptions, TextureOptions, TraceOptions};
pub(crate) use options::{
    OptionTable, QueryOptions, SaveOptions, StepOptions, SubsurfaceOptions, is_lookup_option,
};
pub(crate) use parts::KeptValue;
pub use parts::PartValues;
pub use queries::{
    DatabaseKey, DatabaseQuery, DatabaseSave, EnvironmentQuery, GatherQuery, HitValues, IlluminateQuery,
    LightInfo, LightResult, LightSample, LookupResult, ShadowQuery, SubsurfaceQuery, Texture3dQuery,
    TextureQuery, TraceQuery, TraceResult,
};

use crate::Lanes3;
use granita_base::{Color, Location, Param, Severity, Transform};
use granita_gsl::Func;
use std::sync::Arc;

/// All services that a running shader may request. Types that implement the parts implement it.
pub trait Services: Spaces + Textures + Lights + Rays + Databases + Messages + Host + Recall {}

impl<S: Spaces + Textures + Lights + Rays + Databases + Messages + Host + Recall> Services for S {}

/// Coordinate systems and units.
pub trait Spaces {
    /// Returns the matrix from a named space to "common"; "shader" is the space of `layer`. Returns `None` when it
    /// is unknown.
    fn to_common(&mut self, space: &str, layer: usize) -> Option<Transform>;

    /// Returns the factor that converts a measure in `from` units to `to` units (reference 5.8.3 `transformu`), for
    /// names that are units ("mm", "s", "common" ...). The executor handles spaces.
    fn unit_scale(&mut self, from: &str, to: &str) -> Option<f32>;
}

/// Lookups in maps, or by rays when a name is that of a geometry set.
pub trait Textures {
    /// Looks up a filtered texture.
    fn texture(&mut self, query: &TextureQuery<'_>, out: &mut LookupResult);

    /// Looks up a filtered volume texture. By default the result is `fill`.
    fn texture3d(&mut self, query: &Texture3dQuery<'_>, out: &mut LookupResult) {
        fill(query.batch, query.channels, query.options.fill, out);
    }

    /// Looks up an environment map, or traces reflection rays.
    fn environment(&mut self, query: &EnvironmentQuery<'_>, out: &mut LookupResult);

    /// Looks up a shadow map, or traces shadow rays. The result is the occlusion per lane: 0 open, 1 blocked.
    fn shadow(&mut self, query: &ShadowQuery<'_>, out: &mut Lanes3);

    /// True when `environment` (with "sample") or `shadow` (without "samples") of this name read the change of
    /// positions and directions between neighbouring points. If not, they get zeros. The default is true.
    fn wants_footprint(&mut self, name: &str, func: Func) -> bool {
        let _ = (name, func);
        true
    }

    /// Returns data about a texture file (reference table 5.5).
    fn texture_info(&mut self, texture: &str, name: &str) -> Option<Param>;
}

/// The lights that shine on the object.
pub trait Lights {
    /// Returns the number of lights that shine on the object.
    fn light_count(&mut self) -> usize;

    /// Returns the properties of light `index`.
    fn light_info(&mut self, index: usize) -> LightInfo;

    /// True when the shader of light `index` queries messages of the surface or volume shader
    /// ([`Group::listens_to`](crate::Group::listens_to)). Queries then contain them.
    fn light_asks(&mut self, index: usize) -> bool {
        let _ = index;
        false
    }

    /// Runs light `index` for the lanes of `query`. Implementations cache the result, because `diffuse` and
    /// `specular` of one shader make the same query.
    fn illuminate(&mut self, index: usize, query: &IlluminateQuery<'_>) -> Arc<LightResult>;
}

/// Rays that shaders trace.
pub trait Rays {
    /// One ray per active lane; by default nothing is hit.
    fn trace(&mut self, query: &TraceQuery<'_>, out: &mut TraceResult) {
        let n = query.batch.lanes;
        out.hit = vec![false; n];
        out.hitdist = vec![1e30; n];
        for lanes in [&mut out.l, &mut out.ps, &mut out.cl, &mut out.ol, &mut out.p] {
            *lanes = Lanes3::zeros(n);
        }
    }

    /// Computes the blocked fraction of the cone and the mean open direction. By default nothing is blocked.
    fn occlusion(&mut self, query: &GatherQuery<'_>, out: &mut [f32], unoccluded: &mut Lanes3) {
        for &i in query.batch.active {
            out[i as usize] = 0.0;
            unoccluded.set(i as usize, query.axis.get(i as usize));
        }
    }

    /// Computes the irradiance over the hemisphere. By default it is black.
    fn indirect(&mut self, query: &GatherQuery<'_>, out: &mut Lanes3) {
        for &i in query.batch.active {
            out.set(i as usize, Color::ZERO);
        }
    }

    /// True when shaders of a geometry set's objects may query the shader whose rays hit them
    /// ([`Group::queries_parent`](crate::Group::queries_parent)). Queries against the set then contain its
    /// messages. The default is false.
    fn queries_parent(&mut self, set: &str) -> bool {
        let _ = set;
        false
    }
}

/// Spatial databases.
pub trait Databases: Messages {
    /// Adds records to a spatial database. By default it is not supported.
    fn spatialdb_save(&mut self, query: &DatabaseSave<'_>) {
        let _ = query;
        self.unsupported("spatialdbsave");
    }

    /// Looks up records. The results are one list of values per component, and the lanes in which enough records
    /// were found (none before the call). By default it is not supported.
    fn spatialdb_query(&mut self, query: &DatabaseQuery<'_>, values: &mut [Vec<f32>], found: &mut [bool]) {
        let _ = (query, values, found);
        self.unsupported("spatialdbquery");
    }

    /// Computes subsurface scattering; black before the call. By default it is not supported.
    fn subsurface(&mut self, query: &SubsurfaceQuery<'_>, out: &mut Lanes3) {
        let _ = (query, out);
        self.unsupported("subsurface");
    }
}

/// Messages for the user, and text for files.
pub trait Messages {
    /// Reports a message for the user: `printf` (as [`Severity::Message`]), `error`, or the executor's own.
    fn say(&mut self, severity: Severity, text: &str);

    /// Reports a message about a running shader, of the program or by `error ()`, with the name of the shader and
    /// the place in its source when it is known. By default the text contains both.
    fn say_of(&mut self, severity: Severity, shader: &str, at: &Location, text: &str) {
        let place = if at.is_known() { format!("{at}: ") } else { String::new() };
        self.say(severity, &format!("{place}shader \"{shader}\": {text}"));
    }

    /// Reports once per name that this renderer does not support a feature.
    fn unsupported(&mut self, feature: &str) {
        self.say(Severity::Warning, &format!("{feature} is not supported yet"));
    }

    /// Appends the text of `fprintf` to a file. By default it is not supported.
    fn append(&mut self, file: &str, text: &str) {
        let _ = (file, text);
        self.unsupported("fprintf");
    }
}

/// The renderer itself.
pub trait Host {
    /// Returns a renderer attribute, `user:` ones included.
    fn attribute(&mut self, name: &str) -> Option<Param>;

    /// Returns the C++ function that shaders call. `text` is the description that the compiler stored for it.
    ///
    /// # Errors
    /// Returns the reason why the function is not available, which is reported once.
    fn shadeop(&mut self, text: &str) -> Result<Arc<dyn crate::Shadeop>, String> {
        Err(format!("shadeop {text}: this program loads no shadeops"))
    }

    /// Returns the compiler for code through which many points run. By default there is none, and tapes run.
    fn native(&mut self) -> Option<&dyn crate::NativeCompiler> {
        None
    }

    /// True when the frame must end early. Loops then end, and the results of the shader are not used.
    fn is_stopped(&mut self) -> bool {
        false
    }
}

/// What is kept of a run for the next one on the same points.
///
/// A shader is divided into parts, by numbers from 0. Each part depends on what its requests depended on, and on the
/// parts that it read values of. A part whose dependencies did not change need not run again. By default nothing is
/// kept, and shaders run as a whole.
pub trait Recall {
    /// True when the values of parts are kept for this run.
    fn keeps_parts(&mut self) -> bool {
        false
    }

    /// True when the values of a part are kept and still right.
    fn is_part_kept(&mut self, part: u32) -> bool {
        let _ = part;
        false
    }

    /// Returns the values of a part that need not run.
    fn recall_part(&mut self, part: u32) -> Option<Arc<PartValues>> {
        let _ = part;
        None
    }

    /// Begins a part. `sees_lights` is true when it may depend on which lights shine on the object.
    fn begin_part(&mut self, sees_lights: bool) {
        let _ = sees_lights;
    }

    /// Ends a part, which read values of the parts `reads`.
    fn end_part(&mut self, part: u32, reads: &[u32], values: &Arc<PartValues>) {
        let _ = (part, reads, values);
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
