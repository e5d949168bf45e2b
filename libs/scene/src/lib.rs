//! The scene interface: its calls as data, the attribute state, and the finished scene.
//!
//! Readers, generators and bindings produce [`Call`]s. A receiver of calls is a [`SceneSink`]: the live [`State`],
//! the Pyg writer, or a recorder. [`State`] is the graphics state machine of reference chapter 2. At `Render` it
//! freezes everything into an immutable [`Scene`] and passes it to a [`FrameRenderer`].
//!
//! The invariants of a [`Scene`] are these. All transformations lead to world space. There is at least one camera and
//! one output. Every [`LightId`] is an index into its lights. Positions are finite. Parameters have the data that
//! their types declare (`geom` checks the number of items that a primitive needs). Attribute names and types are
//! those of the table in [`attribute`], the only place that defines defaults. The names and the arguments of calls are
//! those of the table in [`interface`].
//!
//! Errors of a scene are reported once per cause, with file, line and object name. The call is then ignored or
//! applied as far as possible. No sequence of calls panics. File formats, shaders and their parameters, and images
//! are deliberately absent.
//!
//! In re-rendering mode (reference 2.11) the state stays after `Render`, and further frames may change what reference
//! 11.1 allows. The rows of the attribute table say which attributes these are.
//!
//! An `Input` with a bound is deferred. The state at the call is kept, and at `Render` the [`FrameRenderer`]
//! determines which deferred inputs may be needed. These are then read in the place of the call and do not change the
//! state.
//!
//! ```
//! use granita_base::{Location, Param, Params, Reporter, ShapeDesc};
//! use granita_scene::{Call, FoundInput, FrameRenderer, InputPaths, Scene, SceneSink, State, Stop};
//! use std::sync::Arc;
//!
//! struct Count;
//! impl FrameRenderer for Count {
//!     fn render(&mut self, scene: Arc<Scene>, _: Option<&str>) -> Result<(), Stop> {
//!         assert_eq!(scene.primitives.len(), 1);
//!         assert_eq!(scene.primitives[0].attributes.get(granita_scene::attr::SHADINGQUALITY), 0.5);
//!         Ok(())
//!     }
//!     fn command(&mut self, _: &str, _: &Params, _: &Location) -> Result<bool, Stop> {
//!         Ok(false)
//!     }
//!     fn input(&mut self, _: &str, _: InputPaths<'_>, _: &Location) -> Result<Option<FoundInput>, Stop> {
//!         Ok(None)
//!     }
//! }
//!
//! let mut state = State::new(Box::new(Count), Reporter::silent());
//! let at = Location::default();
//! let sphere = ShapeDesc::Sphere { radius: 1.0, zmin: -1.0, zmax: 1.0, thetamax_deg: 360.0 };
//! for call in [
//!     Call::World,
//!     Call::Attribute(Param::declared("float shadingquality", 0.5)?),
//!     Call::Shape { shape: Box::new(sphere), params: Params::new() },
//!     Call::Render { camera: None },
//! ] {
//!     state.call(call, &at)?;
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![forbid(unsafe_code)]

pub mod attribute;
mod call;
mod camera;
mod frame;
mod generator;
pub mod interface;
mod lights;
mod scene;
mod state;
mod values;

pub use attribute::{attr, attribute_default, attribute_row};
pub use call::{Call, Matrix, SceneSink, Stop, TransformTarget};
pub use frame::{DeferredInput, FoundInput, FrameRenderer, InputPaths, InputReader};
pub use generator::{Generator, GeneratorError, GeneratorRegistry, GeneratorSource};
pub use lights::{LightId, LightSet};
pub use scene::{
    AttributeSet, Camera, Connection, Holdout, InputCounts, Light, Output, Primitive, Scene, ShaderGroup,
    ShaderInstance, ShaderUsage, ShapeKey,
};
pub use state::{Checkpoint, State, attribute_from_text, check_pattern, predeclared, version_attribute};
pub use values::Values;
