//! Runs shaders over grids of points in structure-of-arrays lanes.
//!
//! A renderer [links](Group::link) compiled shaders with their instance's parameters and connections into
//! a [`Group`], fills a [`Grid`] with points, and lets an [`Executor`] run the one over the other. What a
//! shader asks of its surroundings (textures, lights, rays, spaces, attributes) goes through [`Services`],
//! in batches of the active lanes.
//!
//! How it works:
//! - every value is an array over the lanes of the grid, or one number for all as long as it is the same:
//!   uniform values are computed and stored once, and become varying when they are written from a varying
//!   value or in some of the lanes only;
//! - an operation is one pass over contiguous floats. The interpreter's overhead is paid per operation and
//!   grid, not per point;
//! - control flow narrows a mask of lanes; nothing is ever branched per point.
//!
//! Invariants:
//! - results depend on the group, the grid and the services only, to the bit: the same when an input is
//!   given as uniform or as varying, in whatever executor, after whatever other run;
//! - lanes that are not active influence nothing;
//! - no NaN, no infinity and no mistake of a shader stops a run. Mistakes are reported once per group and
//!   place, and the documented substitute is used.
//!
//! Deliberately absent: any knowledge of files, textures, rays, lights or scenes; a second way to run
//! (a ray hit is a small grid); a compiler to machine code (a [`NativeCompiler`] can be given).
//!
//! ```
//! use granita_shade::*;
//! use std::sync::Arc;
//! # struct Nothing;
//! # impl Spaces for Nothing {
//! #     fn to_common(&mut self, _: &str, _: usize) -> Option<granita_base::Transform> { None }
//! #     fn unit_scale(&mut self, _: &str, _: &str) -> Option<f32> { None }
//! # }
//! # impl Textures for Nothing {
//! #     fn texture(&mut self, _: &TextureQuery<'_>, _: &mut LookupResult) {}
//! #     fn environment(&mut self, _: &EnvironmentQuery<'_>, _: &mut LookupResult) {}
//! #     fn shadow(&mut self, _: &ShadowQuery<'_>, _: &mut Lanes3) {}
//! #     fn texture_info(&mut self, _: &str, _: &str) -> Option<granita_base::Param> { None }
//! # }
//! # impl Lights for Nothing {
//! #     fn light_count(&mut self) -> usize { 0 }
//! #     fn light_info(&mut self, _: usize) -> LightInfo { LightInfo::default() }
//! #     fn illuminate(&mut self, _: usize, _: &IlluminateQuery<'_>) -> Arc<LightResult> { Arc::default() }
//! # }
//! # impl Rays for Nothing {}
//! # impl Databases for Nothing {}
//! # impl Messages for Nothing {
//! #     fn say(&mut self, _: granita_base::Severity, _: &str) {}
//! # }
//! # impl Host for Nothing {
//! #     fn attribute(&mut self, _: &str) -> Option<granita_base::Param> { None }
//! # }
//! # impl Recall for Nothing {}
//! let source = "surface show_u () { C = u; }";
//! let module = granita_gsl::compile(source, "show_u.gsl", &Default::default()).unwrap().module;
//! let params = granita_base::Params::new();
//! let layer = LayerSource { module, params: &params, name: None };
//! let group = Group::link(&[layer], &[], &mut |_, text| panic!("{text}"))?;
//! let mut grid = Grid::new(Topology::Rect { nu: 3, nv: 1 });
//! grid.u = vec![0.0, 0.5, 1.0];
//! Executor::new().run(&group, &mut grid, &mut Nothing, &[]);
//! assert_eq!(grid.c.get(1), granita_base::Vec3::splat(0.5));
//! # Ok::<(), ShadeError>(())
//! ```
//!
//! Only what the validator has checked can be linked ([`ValidModule`](granita_gsl::ValidModule)). A module that
//! somebody put together or changed is none until it is checked:
//!
//! ```compile_fail,E0308
//! # let compiled = granita_gsl::compile("surface s () { }", "s.gsl", &Default::default()).unwrap();
//! let changed: granita_gsl::Module = (*compiled.module).clone();
//! let params = granita_base::Params::new();
//! let layer = granita_shade::LayerSource { module: changed, params: &params, name: None };
//! ```

#![forbid(unsafe_code)]

mod call;
mod differences;
mod error;
mod grid;
mod join;
mod link;
mod native;
mod ops;
mod program;
mod run;
mod services;
mod shadeop;
mod tape;

pub use error::ShadeError;
pub use grid::{Grid, Lanes3, Message, Primvar, PrimvarData, RayKind, RayPath, Rect, Topology, Uneven};
pub use link::{ConnectionSource, Group, LayerSource, LinkOptions};
pub use native::{NativeCode, NativeCompiler, NativeDone, NativeSource, NativeStrip};
pub use ops::{NoiseForm, noise_at};
pub use run::approx;
pub use run::executor::Executor;
pub use services::{
    Batch, DatabaseKey, DatabaseQuery, DatabaseSave, Databases, EnvironmentOptions, EnvironmentQuery,
    GatherOptions, GatherQuery, HitValues, Host, IlluminateQuery, Lane, Lane3, LightInfo, LightResult,
    LightSample, Lights, LookupResult, MapHandle, Messages, PartValues, Rays, Recall, Services,
    ShadowOptions, ShadowQuery, Spaces, SubsurfaceQuery, Texture3dQuery, TextureOptions, TextureQuery,
    Textures, TraceOptions, TraceQuery, TraceResult,
};
pub use shadeop::{OptionValue, Shadeop, ShadeopArg, ShadeopContext, ShadeopData, Spot, is_text_option};
