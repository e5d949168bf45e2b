//! The API calls as data, the attribute state, the finished scene.

mod attribute;
mod call;
mod scene;

pub use call::{Call, Matrix, SceneSink, Stop, TransformTarget};
pub use scene::{
    AttributeSet, Camera, Connection, Light, LightId, Output, Primitive, Scene, ShaderGroup, ShaderInstance,
    ShaderUsage, ShapeKey,
};
