//! The API calls as data, the attribute state, the finished scene.

pub mod attribute;
mod call;
mod camera;
mod frame;
mod scene;
mod state;

pub use attribute::{attribute_default, attribute_row, suggestion};
pub use call::{Call, Matrix, SceneSink, Stop, TransformTarget};
pub use frame::{FrameRenderer, InputReader};
pub use scene::{
    AttributeSet, Camera, Connection, Light, LightId, Output, Primitive, Scene, ShaderGroup, ShaderInstance,
    ShaderUsage, ShapeKey,
};
pub use state::State;
