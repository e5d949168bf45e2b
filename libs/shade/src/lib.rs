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
//! (a ray hit is a small grid); compilation to machine code.
//!
//! ```
//! use granita_gsl::ir::*;
//! use granita_shade::*;
//! use std::sync::Arc;
//! # struct Nothing;
//! # impl Services for Nothing {
//! #     fn to_common(&mut self, _: &str, _: usize) -> Option<granita_base::Transform> { None }
//! #     fn unit_scale(&mut self, _: &str, _: &str) -> Option<f32> { None }
//! #     fn texture(&mut self, _: &TextureQuery<'_>, _: &mut LookupResult) {}
//! #     fn environment(&mut self, _: &EnvironmentQuery<'_>, _: &mut LookupResult) {}
//! #     fn shadow(&mut self, _: &ShadowQuery<'_>, _: &mut Lanes3) {}
//! #     fn light_count(&mut self) -> usize { 0 }
//! #     fn light_info(&mut self, _: usize) -> LightInfo { LightInfo::default() }
//! #     fn illuminate(&mut self, _: usize, _: &IlluminateQuery<'_>) -> Arc<LightResult> { Arc::default() }
//! #     fn attribute(&mut self, _: &str) -> Option<granita_base::Param> { None }
//! #     fn texture_info(&mut self, _: &str, _: &str) -> Option<granita_base::Param> { None }
//! #     fn say(&mut self, _: granita_base::Severity, _: &str) {}
//! # }
//! // surface show_u () { C = u; }
//! let symbol = |g: Global| Symbol {
//!     name: g.word().into(),
//!     ty: SymbolType::of(g.value_type()),
//!     kind: SymbolKind::Global(g),
//! };
//! let copy = Op {
//!     code: OpCode::Assign,
//!     dst: Some(SymbolId(0)),
//!     args: vec![SymbolId(1)],
//!     at: SourcePos::default(),
//! };
//! let module = Module {
//!     kind: ShaderKind::Surface,
//!     name: "show_u".into(),
//!     metadata: vec![],
//!     params: vec![],
//!     symbols: vec![symbol(Global::C), symbol(Global::u)],
//!     body: vec![Stmt::Op(copy)],
//!     files: vec![],
//!     reads: vec![Global::u],
//!     writes: vec![Global::C],
//!     needs_derivatives: false,
//! };
//! let params = granita_base::Params::new();
//! let layer = LayerSource { module: Arc::new(module), params: &params, name: None };
//! let group = Group::link(&[layer], &[], &mut |_, text| panic!("{text}"))?;
//! let mut grid = Grid::new(Topology::Rect { nu: 3, nv: 1 });
//! grid.u = vec![0.0, 0.5, 1.0];
//! Executor::new().run(&group, &mut grid, &mut Nothing, &[]);
//! assert_eq!(grid.c.get(1), granita_base::Vec3::splat(0.5));
//! # Ok::<(), ShadeError>(())
//! ```

#![deny(unsafe_code)]

mod differences;
mod error;
mod grid;
mod join;
mod link;
mod ops;
mod program;
mod run;
mod services;
mod shadeop;
mod tape;

pub use error::ShadeError;
pub use grid::{Grid, Lanes3, Message, Primvar, PrimvarData, RayKind, Rect, Topology, Uneven};
pub use link::{ConnectionSource, Group, LayerSource, LinkOptions};
pub use ops::{NoiseForm, noise_at};
pub use run::executor::Executor;
pub use services::{
    Batch, DatabaseKey, DatabaseQuery, DatabaseSave, EnvironmentQuery, HitValues, IlluminateQuery, Lane,
    Lane3, LightInfo, LightResult, LightSample, LookupOptions, LookupResult, Services, ShadowQuery,
    SubsurfaceQuery, TextureQuery, TraceQuery, TraceResult,
};
pub use shadeop::{OptionValue, Shadeop, ShadeopArg, ShadeopContext, ShadeopData, Spot, is_text_option};
