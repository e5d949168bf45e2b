//! The supported part of the JSON of a glTF file. Each item is read separately. An item with an error does not affect
//! others.

use crate::faults::Faults;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// Items by their index; `None` where an item could not be read.
pub(super) type Items<T> = Vec<Option<T>>;

#[derive(Debug, Default)]
pub(super) struct Document {
    pub(super) accessors: Items<Accessor>,
    pub(super) buffer_views: Items<BufferView>,
    pub(super) buffers: Items<Buffer>,
    pub(super) cameras: Items<Camera>,
    pub(super) images: Items<Image>,
    pub(super) lights: Items<Light>,
    pub(super) materials: Items<Material>,
    pub(super) meshes: Items<Mesh>,
    pub(super) nodes: Items<Node>,
    pub(super) samplers: Items<Sampler>,
    pub(super) scenes: Items<Scene>,
    pub(super) skins: Items<Skin>,
    pub(super) textures: Items<Texture>,
    pub(super) scene: Option<usize>,
    pub(super) required: Vec<String>,
    pub(super) has_animations: bool,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<usize>,
    pub(super) byte_offset: u64,
    pub(super) component_type: u32,
    pub(super) normalized: bool,
    pub(super) count: u64,
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) min: Vec<f64>,
    pub(super) max: Vec<f64>,
    pub(super) sparse: Option<Sparse>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Sparse {
    pub(super) count: u64,
    pub(super) indices: SparseIndices,
    pub(super) values: SparseValues,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseIndices {
    pub(super) buffer_view: usize,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) component_type: u32,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseValues {
    pub(super) buffer_view: usize,
    #[serde(default)]
    pub(super) byte_offset: u64,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub(super) buffer: usize,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: Option<u64>,
    #[serde(default)]
    pub(super) extensions: Map<String, Value>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Buffer {
    pub(super) uri: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Camera {
    pub(super) name: String,
    pub(super) perspective: Option<Perspective>,
    pub(super) orthographic: Option<Orthographic>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Perspective {
    pub(super) yfov: f32,
    pub(super) znear: f32,
    pub(super) zfar: Option<f32>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Orthographic {
    pub(super) xmag: f32,
    pub(super) ymag: f32,
    pub(super) znear: f32,
    pub(super) zfar: f32,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Image {
    pub(super) uri: Option<String>,
    pub(super) buffer_view: Option<usize>,
}

/// A light of the extension `KHR_lights_punctual`.
#[derive(Debug, Deserialize)]
pub(super) struct Light {
    #[serde(default)]
    pub(super) name: String,
    #[serde(rename = "type")]
    pub(super) kind: String,
    #[serde(default = "white")]
    pub(super) color: [f32; 3],
    #[serde(default = "one")]
    pub(super) intensity: f32,
    #[serde(default)]
    pub(super) spot: Spot,
}

#[derive(Debug, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Spot {
    pub(super) inner_cone_angle: f32,
    pub(super) outer_cone_angle: f32,
}

impl Default for Spot {
    fn default() -> Self {
        Self { inner_cone_angle: 0.0, outer_cone_angle: std::f32::consts::FRAC_PI_4 }
    }
}

fn one() -> f32 {
    1.0
}

fn white() -> [f32; 3] {
    [1.0; 3]
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Material {
    pub(super) pbr_metallic_roughness: Pbr,
    pub(super) normal_texture: Option<TextureRef>,
    pub(super) emissive_factor: [f32; 3],
    pub(super) emissive_texture: Option<TextureRef>,
    pub(super) alpha_mode: String,
    pub(super) alpha_cutoff: Option<f32>,
    pub(super) double_sided: bool,
    pub(super) extensions: Map<String, Value>,
}

#[derive(Debug, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Pbr {
    pub(super) base_color_factor: [f32; 4],
    pub(super) base_color_texture: Option<TextureRef>,
    pub(super) metallic_factor: f32,
    pub(super) roughness_factor: f32,
    pub(super) metallic_roughness_texture: Option<TextureRef>,
}

impl Default for Pbr {
    fn default() -> Self {
        Self {
            base_color_factor: [1.0; 4],
            base_color_texture: None,
            metallic_factor: 1.0,
            roughness_factor: 1.0,
            metallic_roughness_texture: None,
        }
    }
}

#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextureRef {
    pub(super) index: usize,
    #[serde(default)]
    pub(super) tex_coord: u32,
    /// The strength of a normal map.
    #[serde(default = "one")]
    pub(super) scale: f32,
    #[serde(default)]
    pub(super) extensions: Map<String, Value>,
}

/// The extension `KHR_texture_transform`.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct TextureTransform {
    pub(super) offset: [f32; 2],
    pub(super) rotation: f32,
    pub(super) scale: [f32; 2],
    pub(super) tex_coord: Option<u32>,
}

impl Default for TextureTransform {
    fn default() -> Self {
        Self { offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2], tex_coord: None }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Mesh {
    pub(super) name: String,
    pub(super) primitives: Vec<Primitive>,
    pub(super) weights: Vec<f32>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Primitive {
    pub(super) attributes: BTreeMap<String, usize>,
    pub(super) indices: Option<usize>,
    pub(super) material: Option<usize>,
    pub(super) mode: Option<u32>,
    pub(super) targets: Vec<BTreeMap<String, usize>>,
    pub(super) extensions: Map<String, Value>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub(super) name: String,
    pub(super) camera: Option<usize>,
    pub(super) children: Vec<usize>,
    pub(super) mesh: Option<usize>,
    pub(super) skin: Option<usize>,
    pub(super) matrix: Option<[f64; 16]>,
    pub(super) translation: Option<[f64; 3]>,
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) scale: Option<[f64; 3]>,
    pub(super) weights: Vec<f32>,
    pub(super) extensions: Map<String, Value>,
}

impl Node {
    /// Returns the index of its light of `KHR_lights_punctual`.
    pub(super) fn light(&self) -> Option<usize> {
        let light = self.extensions.get("KHR_lights_punctual")?.get("light")?.as_u64()?;
        usize::try_from(light).ok()
    }
}

#[derive(Debug, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Sampler {
    pub(super) wrap_s: u32,
    pub(super) wrap_t: u32,
}

impl Default for Sampler {
    fn default() -> Self {
        Self { wrap_s: 10497, wrap_t: 10497 }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Scene {
    pub(super) nodes: Vec<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Skin {
    pub(super) inverse_bind_matrices: Option<usize>,
    pub(super) joints: Vec<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct Texture {
    pub(super) sampler: Option<usize>,
    pub(super) source: Option<usize>,
}

impl Document {
    /// Reads the JSON. The error is the message of serde, with line and column.
    pub(super) fn parse(json: &[u8], faults: &mut Faults<'_>) -> Result<Self, String> {
        let mut root = match serde_json::from_slice(json) {
            Ok(Value::Object(root)) => root,
            Ok(_) => return Err("the JSON is no object".into()),
            Err(error) => return Err(error.to_string()),
        };
        let version = root.get("asset").and_then(|a| a.get("version")).and_then(Value::as_str);
        match version {
            Some(v) if v.starts_with("2.") => {}
            Some(v) => return Err(format!("glTF of version \"{v}\", not 2")),
            None => return Err("no glTF file: it has no asset version".into()),
        }
        let mut extensions = match root.remove("extensions") {
            Some(Value::Object(map)) => map,
            _ => Map::new(),
        };
        let mut lights = match extensions.remove("KHR_lights_punctual") {
            Some(Value::Object(map)) => map,
            _ => Map::new(),
        };
        let required = match root.remove("extensionsRequired") {
            Some(list) => serde_json::from_value(list).unwrap_or_default(),
            None => Vec::new(),
        };
        Ok(Self {
            lights: items(&mut lights, "lights", faults),
            accessors: items(&mut root, "accessors", faults),
            buffer_views: items(&mut root, "bufferViews", faults),
            buffers: items(&mut root, "buffers", faults),
            cameras: items(&mut root, "cameras", faults),
            images: items(&mut root, "images", faults),
            materials: items(&mut root, "materials", faults),
            meshes: items(&mut root, "meshes", faults),
            nodes: items(&mut root, "nodes", faults),
            samplers: items(&mut root, "samplers", faults),
            scenes: items(&mut root, "scenes", faults),
            skins: items(&mut root, "skins", faults),
            textures: items(&mut root, "textures", faults),
            scene: root.get("scene").and_then(Value::as_u64).and_then(|s| usize::try_from(s).ok()),
            required,
            has_animations: root.get("animations").and_then(Value::as_array).is_some_and(|a| !a.is_empty()),
        })
    }
}

/// Returns item `index` of a list, if it exists and could be read.
pub(super) fn item<T>(items: &Items<T>, index: usize) -> Option<&T> {
    items.get(index)?.as_ref()
}

fn items<T: DeserializeOwned>(
    from: &mut Map<String, Value>,
    name: &'static str,
    faults: &mut Faults<'_>,
) -> Items<T> {
    let list = match from.remove(name) {
        Some(Value::Array(list)) => list,
        None => return Vec::new(),
        Some(_) => {
            faults.error(name, 0, || format!("\"{name}\" is no list: left out"));
            return Vec::new();
        }
    };
    let mut read = |(i, value)| match serde_json::from_value(value) {
        Ok(item) => Some(item),
        Err(error) => {
            faults.error(name, 0, || format!("{name}[{i}]: {error}: left out"));
            None
        }
    };
    list.into_iter().enumerate().map(&mut read).collect()
}
