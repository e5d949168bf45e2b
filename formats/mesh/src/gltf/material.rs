//! Materials, which become attributes and the shader `gltfsurface`.

use super::buffers::path_of_uri;
use super::document::{Document, Items, Material, Sampler, TextureRef, TextureTransform, item};
use crate::emit::{self, Emit, color, float, is_screen_image, string};
use crate::faults::Faults;
use granita_base::{Color, Param, Params};
use granita_scene::{Call, Stop, attr};
use serde_json::Value;
use std::path::PathBuf;

/// The properties of a material that affect the parameters of a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Look {
    /// The index of the set of texture coordinates, if a texture uses one.
    pub(super) texcoord: Option<u32>,
    /// The transformation of the texture coordinates.
    pub(super) transform: TextureTransform,
    /// The factor of the colours and the alpha of vertices.
    pub(super) base: [f32; 4],
    /// True when alpha has an effect.
    pub(super) blends: bool,
    /// True when there is a normal map.
    pub(super) has_normals: bool,
}

/// The properties without a material.
pub(super) const PLAIN: Look = Look {
    texcoord: Some(0),
    transform: TextureTransform { offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2], tex_coord: None },
    base: [1.0; 4],
    blends: false,
    has_normals: false,
};

/// The image of a texture.
struct Texture {
    /// The name for the texture system.
    path: String,
    /// True when its colours are encoded for a screen.
    screen: bool,
    sampler: Sampler,
}

/// The materials of a document.
pub(super) struct Materials<'a> {
    pub(super) document: &'a Document,
    pub(super) folder: Option<PathBuf>,
    /// The path of the file itself, for the images in it.
    pub(super) file: Option<PathBuf>,
}

impl Materials<'_> {
    /// Returns the properties of material `index` that affect the parameters of a mesh.
    pub(super) fn look(&self, index: Option<usize>) -> Look {
        let Some(material) = index.and_then(|i| item(&self.document.materials, i)) else { return PLAIN };
        let texture = first_texture(material);
        let transform = texture.map(transform).unwrap_or(PLAIN.transform);
        Look {
            texcoord: texture.map(|t| transform.tex_coord.unwrap_or(t.tex_coord)).or(PLAIN.texcoord),
            transform,
            base: material.pbr_metallic_roughness.base_color_factor,
            blends: matches!(material.alpha_mode.as_str(), "MASK" | "BLEND"),
            has_normals: material.normal_texture.is_some(),
        }
    }

    /// Makes material `index` the material of the following shapes.
    pub(super) fn emit(
        &self,
        index: usize,
        emit: &mut Emit<'_>,
        faults: &mut Faults<'_>,
    ) -> Result<(), Stop> {
        let Some(m) = item(&self.document.materials, index) else {
            faults.error("material", 0, || {
                format!("there is no material {index}: the current attributes are used")
            });
            return Ok(());
        };
        let pbr = &m.pbr_metallic_roughness;
        let finite = |x: f32, instead: f32| if x.is_finite() { x } else { instead };
        let [r, g, b, a] = pbr.base_color_factor.map(|x| finite(x, 1.0));
        let (mode, alpha) = match m.alpha_mode.as_str() {
            "" | "OPAQUE" => ("opaque", 1.0),
            "MASK" => ("mask", a),
            "BLEND" => ("blend", a),
            other => {
                faults
                    .warning("alpha mode", 0, || format!("material {index}: unknown alpha mode \"{other}\""));
                ("opaque", 1.0)
            }
        };
        emit.attribute(attr::COLOR.param(Color::new(r, g, b)), 0)?;
        emit.attribute(attr::OPACITY.param(Color::splat(alpha)), 0)?;
        emit.attribute(attr::TWOSIDED.param(m.double_sided), 0)?;
        let strength =
            m.extensions.get("KHR_materials_emissive_strength").and_then(|e| e.get("emissiveStrength"));
        let strength = strength.and_then(Value::as_f64).unwrap_or(1.0) as f32;
        let mut params = vec![
            float("metallic", finite(pbr.metallic_factor, 1.0).clamp(0.0, 1.0)),
            float("roughness", finite(pbr.roughness_factor, 1.0).clamp(0.0, 1.0)),
        ];
        let emission = m.emissive_factor.map(|x| finite(x * strength, 0.0));
        if emission != [0.0; 3] {
            params.push(color("emission", emission));
        }
        if mode != "opaque" {
            params.push(string("alphamode", mode));
        }
        if mode == "mask" {
            params.push(float("alphacutoff", finite(m.alpha_cutoff.unwrap_or(0.5), 0.5)));
        }
        if m.extensions.contains_key("KHR_materials_unlit") {
            params.push(float("unlit", 1.0));
        }
        self.textures(index, m, &mut params, faults);
        let shader = Call::Shader {
            usage: "surface".into(),
            name: Some("gltfsurface".into()),
            layer: None,
            params: Params(params),
        };
        emit.call(shader, 0)
    }

    /// True when nothing of the material lets light through, so that rays of shadows need not run its shader.
    pub(super) fn is_opaque(&self, index: usize) -> bool {
        item(&self.document.materials, index).is_some_and(|m| match m.alpha_mode.as_str() {
            "MASK" | "BLEND" => {
                let pbr = &m.pbr_metallic_roughness;
                pbr.base_color_texture.is_none() && pbr.base_color_factor[3] >= 1.0
            }
            _ => true,
        })
    }

    fn textures(&self, index: usize, m: &Material, params: &mut Vec<Param>, faults: &mut Faults<'_>) {
        let pbr = &m.pbr_metallic_roughness;
        let first = first_texture(m);
        let all = [
            (&pbr.base_color_texture, "texturename"),
            (&m.emissive_texture, "emissionname"),
            (&pbr.metallic_roughness_texture, "metalroughname"),
            (&m.normal_texture, "normalname"),
        ];
        let mut wraps = None;
        for (texture, param) in all {
            let Some(texture) = texture else { continue };
            let agrees =
                first.is_some_and(|f| (transform(f), f.tex_coord) == (transform(texture), texture.tex_coord));
            if !agrees {
                faults.warning("texture coordinates", 0, || {
                    format!("material {index}: textures with different coordinates are not supported: one is left out")
                });
                continue;
            }
            let Some(Texture { path, screen, sampler }) = self.texture_of(texture, index, faults) else {
                continue;
            };
            if param == "texturename" && screen {
                params.push(float("texturesrgb", 1.0));
            }
            if param == "emissionname" && screen {
                params.push(float("emissionsrgb", 1.0));
            }
            if param == "normalname" && texture.scale != 1.0 && texture.scale.is_finite() {
                params.push(float("normalscale", texture.scale));
            }
            params.push(string(param, &path));
            wraps.get_or_insert((sampler.wrap_s, sampler.wrap_t));
        }
        if let Some((s, t)) = wraps {
            for (name, wrap) in [("swrap", s), ("twrap", t)] {
                match wrap {
                    33071 => params.push(string(name, "clamp")),
                    33648 => params.push(string(name, "mirror")),
                    _ => {}
                }
            }
        }
    }

    /// Returns the image and the sampler of a texture.
    fn texture_of(&self, texture: &TextureRef, material: usize, faults: &mut Faults<'_>) -> Option<Texture> {
        let document = self.document;
        let source = item(&document.textures, texture.index);
        let number = source.and_then(|t| t.source);
        let image = number.and_then(|i| Some((i, item(&document.images, i)?)));
        let (Some(source), Some((number, image))) = (source, image) else {
            faults.error("texture", 0, || {
                let number = texture.index;
                format!("material {material}: texture {number} has no image that can be read: left out")
            });
            return None;
        };
        let sampler = source.sampler.and_then(|s| copy(&document.samplers, s)).unwrap_or_default();
        match &image.uri {
            Some(uri) if !uri.starts_with("data:") => match path_of_uri(uri, self.folder.as_ref()) {
                Ok(path) => {
                    let path = emit::texture_path(&path);
                    let screen = is_screen_image(&path);
                    Some(Texture { path, screen, sampler })
                }
                Err(why) => {
                    faults.error("image", 0, || format!("material {material}: the image {why}: left out"));
                    None
                }
            },
            // The image is inside of the file. Its format is one for screens.
            _ => match &self.file {
                Some(file) => {
                    let path = format!("{}#{number}", emit::texture_path(file));
                    Some(Texture { path, screen: true, sampler })
                }
                None => {
                    faults.warning("embedded", 0, || {
                        format!(
                            "material {material}: its image is inside of the file, which is no file on the disk: left out"
                        )
                    });
                    None
                }
            },
        }
    }
}

fn copy(samplers: &Items<Sampler>, index: usize) -> Option<Sampler> {
    item(samplers, index).map(|s| Sampler { wrap_s: s.wrap_s, wrap_t: s.wrap_t })
}

/// Returns the texture whose coordinates are used.
fn first_texture(m: &Material) -> Option<&TextureRef> {
    let pbr = &m.pbr_metallic_roughness;
    let all =
        [&pbr.base_color_texture, &m.emissive_texture, &pbr.metallic_roughness_texture, &m.normal_texture];
    all.into_iter().find_map(|t| t.as_ref())
}

fn transform(texture: &TextureRef) -> TextureTransform {
    let value = texture.extensions.get("KHR_texture_transform");
    let read = value.and_then(|v| serde_json::from_value::<TextureTransform>(v.clone()).ok());
    read.unwrap_or(PLAIN.transform)
}

impl TextureTransform {
    /// Transforms texture coordinates as the extension requires. They are scaled, rotated and translated.
    pub(super) fn apply(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        if *self == PLAIN.transform {
            return [u, v];
        }
        let (sin, cos) = libm::sincosf(self.rotation);
        let (u, v) = (u * self.scale[0], v * self.scale[1]);
        [u * cos + v * sin + self.offset[0], v * cos - u * sin + self.offset[1]]
    }
}
