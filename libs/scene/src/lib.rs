//! The API calls as data, the attribute state, the finished scene.

mod attribute;
mod call;
mod frame;
mod scene;

pub use call::{Call, Matrix, SceneSink, Stop, TransformTarget};
pub use frame::{FrameRenderer, InputReader};
pub use scene::{
    AttributeSet, Camera, Connection, Light, LightId, Output, Primitive, Scene, ShaderGroup, ShaderInstance,
    ShaderUsage, ShapeKey,
};
