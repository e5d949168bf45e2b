//! glTF 2. The meshes, materials, lights and cameras of the nodes of a scene become calls.
//!
//! The JSON is held in memory as a whole. Binary data is read as it is needed, one primitive at a time. The shapes of a
//! mesh that several nodes use are made once, and their data is shared.

mod accessor;
mod buffers;
mod compressed;
mod document;
mod images;
mod material;
mod primitive;
mod scene;
mod skin;

use crate::emit::{Emit, color, float, object_name, string};
use crate::faults::Faults;
use crate::source::{Opened, Stream, io_error, open};
use accessor::Reader;
use buffers::Buffers;
use document::{Document, item};
use granita_base::{Params, Reporter, Severity};
use granita_scene::{Call, Generator, GeneratorError, GeneratorSource, SceneSink, attr};
pub use images::GltfImages;
use material::Materials;
use primitive::Built;
use scene::Placed;
use std::collections::BTreeMap;
use std::f32::consts::PI;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::rc::Rc;

/// The largest number of bytes of the JSON, which needs several times as much memory.
const MOST_JSON: u64 = 1 << 31;

/// The geometry set whose objects cast shadows in the light of a file, unless the scene names another one.
const SHADOWS: &str = "shadow";

/// The supported extensions among those that a file may require.
const EXTENSIONS: [&str; 9] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    // A build without their decoders reports them where they are used.
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
    // The extension has no visible effect.
    "KHR_xmp_json_ld",
];

/// Reads `.gltf` files, and binary files with any name.
#[derive(Clone, Copy, Debug, Default)]
pub struct Gltf;

/// The same as [`Gltf`], with the name of binary files. The extension of a file is the name of its generator (reference
/// 2.9).
#[derive(Clone, Copy, Debug, Default)]
pub struct Glb;

impl Generator for Glb {
    fn name(&self) -> &'static str {
        "glb"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["glb"]
    }

    fn bound(&self, source: &GeneratorSource) -> Option<[f32; 6]> {
        Gltf.bound(source)
    }

    fn run(
        &self,
        source: &GeneratorSource,
        sink: &mut dyn SceneSink,
        reporter: &Reporter,
    ) -> Result<(), GeneratorError> {
        Gltf.run(source, sink, reporter)
    }
}

impl Generator for Gltf {
    fn name(&self) -> &'static str {
        "gltf"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["gltf"]
    }

    fn bound(&self, source: &GeneratorSource) -> Option<[f32; 6]> {
        // Errors are reported when the file is read.
        let silent = Reporter::silent();
        let Opened { name, mut stream, size } = open(source).ok()?;
        let mut faults = Faults::new(&silent, name.clone());
        let (json, _) = container(&name, &mut stream, size).ok()?;
        let document = Document::parse(&json, &mut faults).ok()?;
        let nodes = scene::nodes(&document, &mut faults);
        scene::bound(&document, &nodes)
    }

    fn run(
        &self,
        source: &GeneratorSource,
        sink: &mut dyn SceneSink,
        reporter: &Reporter,
    ) -> Result<(), GeneratorError> {
        let Opened { name, mut stream, size } = open(source)?;
        let mut faults = Faults::new(reporter, name.clone());
        let (json, chunk) = container(&name, &mut stream, size)?;
        let document = Document::parse(&json, &mut faults);
        let document = document.map_err(|what| GeneratorError::Malformed(format!("{name}: {what}")))?;
        drop(json);
        let folder = source.folder().map(Path::to_path_buf);
        let file = match source {
            GeneratorSource::File { path, .. } => Some(path.clone()),
            GeneratorSource::Bytes { .. } => None,
        };
        let nodes = scene::nodes(&document, &mut faults);
        let stem =
            Path::new(&*name).file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
        let mut run = Run {
            document: &document,
            emit: Emit::new(sink, name.clone()),
            faults,
            stem,
            reader: Reader::new(
                &document,
                Buffers::new(stream, chunk, folder.clone(), source.files().clone(), reporter.clone()),
            ),
            materials: Materials { document: &document, folder, file },
            shared: BTreeMap::new(),
            casters: None,
        };
        run.check();
        if !run.emit.in_world() && nodes.iter().any(|n| n.node.camera.is_some()) {
            run.cameras(&nodes)?;
            let at = granita_base::Location::line(&name, 0);
            reporter.say(
                Severity::Info,
                &at,
                "cameras are taken before World, and all else by an Input after it",
            );
            return Ok(());
        }
        if run.emit.wants("lights") {
            let set = run.emit.text("shadows").unwrap_or_else(|| SHADOWS.to_owned());
            let lit = nodes.iter().any(|n| n.node.light().is_some());
            run.casters = Some(set).filter(|set| lit && !set.is_empty());
            run.lights(&nodes)?;
        }
        run.meshes(&nodes)
    }
}

/// Returns the JSON, and the offset and the length of the binary chunk.
#[allow(clippy::type_complexity, reason = "said in the words above")]
fn container(
    name: &str,
    stream: &mut Box<dyn Stream>,
    size: u64,
) -> Result<(Vec<u8>, Option<(u64, u64)>), GeneratorError> {
    let fail = |e| io_error(name, e);
    let malformed = |what: String| GeneratorError::Malformed(format!("{name}: {what}"));
    let mut header = [0; 20];
    stream.read_exact(&mut header[..size.min(20) as usize]).map_err(fail)?;
    stream.seek(SeekFrom::Start(0)).map_err(fail)?;
    let binary = &header[..4] == b"glTF";
    if binary && size < 20 {
        return Err(malformed(format!("the file ends in its header, after {size} bytes")));
    }
    let word = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
    let length = if binary { u64::from(word(12)) } else { size };
    if length > MOST_JSON {
        return Err(malformed(format!("{length} bytes of JSON, of at most {MOST_JSON}")));
    }
    if !binary {
        let mut json = Vec::new();
        stream.take(length).read_to_end(&mut json).map_err(fail)?;
        // Some programs write a byte order mark, which is not JSON.
        if json.starts_with(b"\xef\xbb\xbf") {
            json.drain(..3);
        }
        return Ok((json, None));
    }
    if word(4) != 2 {
        return Err(malformed(format!("glTF of version {}, not 2", word(4))));
    }
    if word(16) != 0x4e4f_534a {
        return Err(malformed("the first chunk is no JSON".into()));
    }
    if length > size - 20 {
        return Err(malformed(format!("the file ends in its JSON, after {} of {length} bytes", size - 20)));
    }
    let mut json = vec![0; length as usize];
    stream.seek(SeekFrom::Start(20)).map_err(fail)?;
    stream.read_exact(&mut json).map_err(fail)?;
    let mut next = 20 + length;
    let mut chunk = None;
    while chunk.is_none() && size - next >= 8 {
        let mut header = [0; 8];
        stream.read_exact(&mut header).map_err(fail)?;
        let length = u64::from(u32::from_le_bytes([header[0], header[1], header[2], header[3]]));
        next += 8;
        // A file that ends early is read up to its end.
        let length = length.min(size - next);
        if &header[4..] == b"BIN\0" {
            chunk = Some((next, length));
        }
        next += length;
        stream.seek(SeekFrom::Start(next)).map_err(fail)?;
    }
    Ok((json, chunk))
}

/// Makes the calls of a document.
struct Run<'a> {
    document: &'a Document,
    emit: Emit<'a>,
    faults: Faults<'a>,
    /// The name of the file without folder and extension.
    stem: String,
    reader: Reader<'a>,
    materials: Materials<'a>,
    /// The shapes of meshes, by mesh and skin, that further nodes will use.
    shared: BTreeMap<(usize, Option<usize>), Rc<Vec<Built>>>,
    /// The geometry set that casts shadows in the light of this file.
    casters: Option<String>,
}

impl Run<'_> {
    /// Reports unsupported features of the file.
    fn check(&mut self) {
        for name in self.document.required.iter().filter(|n| !EXTENSIONS.contains(&n.as_str())) {
            self.faults.error("extension", 0, || {
                format!(
                    "the file requires the extension {name}, which is not supported: what it says is left out"
                )
            });
        }
        if self.document.has_animations {
            self.faults.warning("animation", 0, || {
                "animations are not supported: all stands as it is at rest".into()
            });
        }
    }

    fn cameras(&mut self, nodes: &[Placed<'_>]) -> Result<(), GeneratorError> {
        let mut names = BTreeMap::new();
        for placed in nodes {
            let Some(index) = placed.node.camera else { continue };
            let Some(camera) = item(&self.document.cameras, index) else {
                self.faults.error("camera", 0, || format!("there is no camera {index}: left out"));
                continue;
            };
            let name = unique(&mut names, &[&placed.node.name, &camera.name], "camera");
            let mut params = Vec::new();
            let mut range = |near: f32, far: Option<f32>| {
                if near > 0.0 && near.is_finite() {
                    params.push(attr::NEAR.param(near));
                }
                params.extend(far.filter(|f| *f > near && f.is_finite()).map(|f| attr::FAR.param(f)));
            };
            if let Some(p) = &camera.perspective {
                range(p.znear, p.zfar);
                params.push(attr::FOV.param(p.yfov.to_degrees()));
            } else if let Some(o) = &camera.orthographic {
                range(o.znear, Some(o.zfar));
                params.push(attr::PROJECTION.param("orthographic".into()));
                let screen = [-o.xmag, o.xmag, -o.ymag, o.ymag];
                params.push(attr::SCREEN.param(Some(screen)));
            }
            let Some(matrix) = placed.looking() else {
                self.faults
                    .error("camera place", 0, || format!("camera \"{name}\" stands nowhere: left out"));
                continue;
            };
            self.emit.call(Call::PushTransform, 0)?;
            self.emit.call(Call::AppendTransform(Box::new(matrix)), 0)?;
            self.emit.call(Call::Camera { name: name.into(), params: Params(params) }, 0)?;
            self.emit.call(Call::PopTransform, 0)?;
        }
        Ok(())
    }

    fn lights(&mut self, nodes: &[Placed<'_>]) -> Result<(), GeneratorError> {
        let mut names = BTreeMap::new();
        for placed in nodes {
            let Some(index) = placed.node.light() else { continue };
            let Some(light) = item(&self.document.lights, index) else {
                self.faults.error("light", 0, || format!("there is no light {index}: left out"));
                continue;
            };
            let name = unique(&mut names, &[&placed.node.name, &light.name], "light");
            let id = format!("{}/{name}", self.stem);
            let (shader, falloff) = match light.kind.as_str() {
                "point" => ("pointlight", 2.0),
                "spot" => ("spotlight", 2.0),
                "directional" => ("distantlight", 0.0),
                kind => {
                    self.faults.error("light kind", 0, || {
                        format!("light \"{name}\" of the unknown type \"{kind}\": left out")
                    });
                    continue;
                }
            };
            // The intensity is in candela or lux. Their effect on a matte surface is divided by pi, which shaders do
            // not do.
            let intensity = light.intensity / PI;
            let finite = intensity.is_finite() && light.color.iter().all(|x| x.is_finite());
            let (true, Some(matrix)) = (finite, placed.looking()) else {
                self.faults.error("light place", 0, || {
                    format!("light \"{name}\" has numbers that are not finite: left out")
                });
                continue;
            };
            let mut params = vec![float("intensity", intensity), color("lightcolor", light.color)];
            if falloff > 0.0 {
                params.push(float("falloff", falloff));
            }
            if shader == "spotlight" {
                let outer = light.spot.outer_cone_angle.clamp(1.0e-3, PI / 2.0);
                let inner = light.spot.inner_cone_angle.clamp(0.0, outer);
                params.push(float("coneangle", outer));
                params.push(float("conedeltaangle", outer - inner));
                params.push(float("beamdistribution", 0.0));
            }
            params.extend(self.casters.iter().map(|set| string("shadowname", set)));
            self.emit.call(Call::PushTransform, 0)?;
            self.emit.call(Call::AppendTransform(Box::new(matrix)), 0)?;
            let call = Call::Light {
                id: id.into(),
                shader: Some(shader.into()),
                layer: None,
                params: Params(params),
            };
            self.emit.call(call, 0)?;
            self.emit.call(Call::PopTransform, 0)?;
        }
        Ok(())
    }

    fn meshes(&mut self, nodes: &[Placed<'_>]) -> Result<(), GeneratorError> {
        let wants_materials = self.emit.wants("materials");
        let mut left: BTreeMap<(usize, Option<usize>), usize> = BTreeMap::new();
        let plain = nodes.iter().filter(|n| n.node.weights.is_empty());
        for (mesh, skin) in plain.filter_map(|n| Some((n.node.mesh?, n.node.skin))) {
            *left.entry((mesh, skin)).or_default() += 1;
        }
        let mut places = vec![None; self.document.nodes.len()];
        nodes.iter().for_each(|placed| places[placed.index] = Some(placed.matrix));
        let mut skins = BTreeMap::new();
        for placed in nodes {
            let Some(index) = placed.node.mesh else { continue };
            let key = (index, placed.node.skin);
            // Nodes that have weights have shapes of their own.
            let own = !placed.node.weights.is_empty();
            let more = left.get_mut(&key).filter(|_| !own).map_or(0, |n| {
                *n -= 1;
                *n
            });
            let Some(mesh) = item(&self.document.meshes, index) else {
                self.faults.error("mesh", 0, || format!("there is no mesh {index}: left out"));
                continue;
            };
            let name = [&placed.node.name, &mesh.name].into_iter().find(|n| !n.is_empty());
            let name = name.cloned().unwrap_or_else(|| format!("mesh{index}"));
            let joints = match placed.node.skin {
                Some(skin) => match &*skins
                    .entry(skin)
                    .or_insert_with(|| skin::joints(self.document, skin, &places, &mut self.reader))
                {
                    Ok(joints) => Some(&joints[..]),
                    Err(why) => {
                        self.faults
                            .error("skin", 0, || format!("{why}: \"{name}\" stands as it was modelled"));
                        None
                    }
                },
                None => None,
            };
            // The joints define the positions of the vertices. The transformation of the node has no effect.
            let here = Placed { index: placed.index, node: placed.node, matrix: scene::IDENTITY };
            let place = if joints.is_some() { &here } else { placed };
            let Some(matrix) = place.rows() else {
                let node = placed.index;
                self.faults
                    .error("matrix", 0, || format!("node {node} (\"{name}\") stands nowhere: left out"));
                continue;
            };
            let built = match self.shared.remove(&key) {
                Some(built) if !own => built,
                kept => {
                    kept.map(|built| self.shared.insert(key, built));
                    let weights = if own { &placed.node.weights } else { &mesh.weights };
                    self.build(index, joints, weights, &name)
                }
            };
            if more > 0 {
                self.shared.insert(key, built.clone());
            }
            for one in built.iter() {
                self.emit.call(Call::PushAttributes, 0)?;
                self.emit.attribute(object_name(&name), 0)?;
                if let Some(set) = &self.casters {
                    self.emit.attribute(attr::GEOMETRYSET.param(format!("+{set}").into()), 0)?;
                }
                self.emit.call(Call::AppendTransform(Box::new(matrix)), 0)?;
                if let Some(material) = one.material.filter(|_| wants_materials) {
                    self.materials.emit(material, &mut self.emit, &mut self.faults)?;
                    if self.materials.is_opaque(material) && one.params.get("opacity").is_none() {
                        self.emit.attribute(attr::RAY_OPAQUESHADOWS.param(true), 0)?;
                    }
                }
                self.emit.shape(one.shape.clone(), one.params.clone(), 0)?;
                self.emit.call(Call::PopAttributes, 0)?;
            }
        }
        Ok(())
    }

    fn build(
        &mut self,
        index: usize,
        joints: Option<&[scene::Matrix]>,
        weights: &[f32],
        name: &str,
    ) -> Rc<Vec<Built>> {
        let mut all = Vec::new();
        let primitives = item(&self.document.meshes, index).map_or(&[][..], |m| &m.primitives[..]);
        for (i, primitive) in primitives.iter().enumerate() {
            let what = format!("mesh {index} (\"{name}\"), primitive {i}");
            let look = self.materials.look(primitive.material);
            let source = primitive::Source { primitive, look, joints, weights, what };
            match source.build(&mut self.reader, &mut self.faults) {
                Ok(built) => all.extend(built),
                Err(why) => {
                    // Each reason is reported once.
                    self.faults
                        .error(format!("primitive {why}"), 0, || format!("{}: {why}: left out", source.what));
                }
            }
        }
        Rc::new(all)
    }
}

/// Returns the first name that is not empty, or `instead`. A number is appended when the name was used before.
fn unique(given: &mut BTreeMap<String, u32>, names: &[&String], instead: &str) -> String {
    let name = names.iter().find(|n| !n.is_empty()).map_or(instead, |n| n.as_str());
    let mut number = given.get(name).copied().unwrap_or(0);
    let free = loop {
        number += 1;
        let candidate = if number == 1 { name.to_owned() } else { format!("{name}{number}") };
        if !given.contains_key(&candidate) {
            break candidate;
        }
    };
    given.insert(free.clone(), 1);
    given.insert(name.to_owned(), number);
    free
}

#[cfg(test)]
mod tests;
