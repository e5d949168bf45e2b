//! Images and attributes that the command line adds or replaces.

use crate::desk::coarse::Coarse;
use crate::looking::Looking;
use crate::{ExtraOutput, SessionOptions};
use granita_base::{BaseType, Location, MotionTransform, Param, ParamType, Reporter};
use granita_image::FormatRegistry;
use granita_scene::{AttributeSet, Camera, LightSet, Output, Scene, ShaderGroup, ShaderInstance, attr};
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// The images of a frame that go to the program.
#[derive(Clone, Debug, Default)]
pub(crate) struct Requested {
    /// Their camera; `None` for the first one.
    pub(crate) camera: Option<Arc<str>>,
    /// The data of each, as in `Output`. Its format is its number, from 1, as an address of the program.
    pub(crate) data: Vec<Arc<str>>,
}

/// The images of the current frame that go to the program. Clones share them.
pub(crate) type RequestedImages = Arc<Mutex<Requested>>;

impl Requested {
    /// True when the camera `name` has any of the images.
    pub(crate) fn is_of(&self, name: &str) -> bool {
        !self.data.is_empty() && self.camera.as_deref() == Some(name)
    }

    /// Returns the images as outputs of a scene.
    fn outputs(&self, scene: &Scene) -> Vec<Output> {
        let named = self.camera.as_ref().and_then(|name| scene.cameras.iter().find(|c| c.name == *name));
        let Some(camera) = named.or(scene.cameras.first()) else { return Vec::new() };
        let output = |(i, data): (usize, &Arc<str>)| Output {
            name: format!("<{data}>").into(),
            format: format!("{:#x}", i + 1).into(),
            data: data.clone(),
            camera: camera.name.clone(),
            params: granita_base::Params::new(),
        };
        self.data.iter().enumerate().map(output).collect()
    }
}

/// The largest "spatialquality" of coarse frames of a desk, along each axis. The other qualities are at most its
/// square.
const COARSE_QUALITY: i32 = 2;

/// The part of "rerender:memory" that is for coarse frames of a desk, as a divisor.
const COARSE_MEMORY: i32 = 8;

/// How a frame of the desk differs from one of the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct DeskFrame {
    /// True for a coarse image with few samples.
    pub(crate) coarse: bool,
    /// The crop window of the camera; `None` for that of the scene.
    pub(crate) crop: Option<[f32; 4]>,
}

/// The images of a frame besides those of the scene and the command line.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Special<'a> {
    /// Those that go to the program.
    pub(crate) requested: &'a Requested,
    /// The frame of a look whose images they are.
    pub(crate) looking: Option<(&'a Looking, u32)>,
    /// The frame of a desk for lighting that it is.
    pub(crate) desk: Option<DeskFrame>,
}

/// Returns the scene with the session's own outputs, those of the program, and camera attributes. Images are those of
/// the frame of a look, if there is one.
pub(crate) fn amended(
    scene: &Arc<Scene>,
    options: &SessionOptions,
    Special { requested, looking, desk }: Special<'_>,
    registry: &FormatRegistry,
    reporter: &Reporter,
) -> Arc<Scene> {
    let changes_cameras = options.preview > 0.0 || options.shadertype.is_some();
    let proxy = |scene: &Scene| scene.cameras.first().and_then(proxy_shader);
    let more = !options.extra_outputs.is_empty()
        || !requested.data.is_empty()
        || looking.is_some()
        || desk.is_some();
    if !more && !changes_cameras && proxy(scene).is_none() {
        return scene.clone();
    }
    let mut scene: Scene = (**scene).clone();
    for camera in &mut scene.cameras {
        if options.preview > 0.0 {
            let ty = ParamType::of(BaseType::Float);
            camera.params.set(Param { name: "preview".into(), ty, data: options.preview.into() });
        }
        if let Some(name) = &options.shadertype {
            let ty = ParamType::of(BaseType::String);
            camera.params.set(Param { name: "shadertype".into(), ty, data: name.as_str().into() });
        }
    }
    // Shading uses the first camera, so its "shadertype" is used (reference 7.7).
    if let Some(surface) = proxy(&scene) {
        shade_plainly(&mut scene, surface);
    }
    if let Some(frame) = desk {
        for_desk(&mut scene, frame, options);
        let of_program = requested.outputs(&scene);
        scene.outputs.extend(of_program);
        return Arc::new(scene);
    }
    let own: Vec<Output> = scene.outputs.clone();
    if let Some((looking, frame)) = looking {
        scene.outputs.iter_mut().for_each(|output| rename(output, looking, frame));
    }
    // With an output of the command line or of the program, the automatic output of a scene without any is not needed.
    // An image in a viewer is not a file, so the automatic one is kept then.
    let has_files = options.extra_outputs.iter().any(|extra| !is_iv(extra));
    let is_looked_at = looking.is_some() && !options.extra_outputs.is_empty();
    if (has_files || is_looked_at || !requested.data.is_empty()) && is_automatic(&own, &scene) {
        scene.outputs.clear();
    }
    if options.only_extra_outputs {
        scene.outputs.retain(|output| output.get(attr::DYNAMIC));
    }
    let of_program = requested.outputs(&scene);
    scene.outputs.extend(of_program);
    for extra in &options.extra_outputs {
        let mut outputs = extra_outputs(extra, &own, &scene, registry, reporter);
        if let Some((looking, frame)) = looking {
            outputs.iter_mut().for_each(|output| look_alike(output, looking, frame));
        }
        // The user named these files, or the files that their names derive from.
        for path in outputs.iter().map(|output| Path::new(&*output.name)) {
            registry.files().grant_output(path);
            if options.keep_partial {
                registry.files().grant_output(&granita_render::partial_path(path));
            }
        }
        scene.outputs.extend(outputs);
    }
    Arc::new(scene)
}

/// Makes a scene one of a frame of a desk. It writes no files and has no workers, which do not know the edits.
fn for_desk(scene: &mut Scene, frame: DeskFrame, options: &SessionOptions) {
    scene.outputs.retain(|o| o.get(attr::DYNAMIC) && matches!(&*o.data, "z" | "avgz"));
    scene.globals.remove(attr::NET_WORKERS.name());
    // What coarse frames keep and what the others keep are within the limit together.
    let memory_kb = scene.get(attr::RERENDER_MEMORY);
    if memory_kb > 0 {
        let coarse_kb = (memory_kb / COARSE_MEMORY).max(1);
        let own_kb = if frame.coarse { coarse_kb } else { (memory_kb - coarse_kb).max(1) };
        let param = attr::RERENDER_MEMORY.param(own_kb);
        scene.globals.insert(param.name.clone(), param);
    }
    for camera in &mut scene.cameras {
        let crop = frame.crop.or(options.crop);
        if frame.coarse {
            let coarse = Coarse::new(camera.get(attr::RESOLUTION));
            let quality = camera.get(attr::SPATIALQUALITY).map(|n| n.min(COARSE_QUALITY));
            camera.params.set(attr::SPATIALQUALITY.param(quality));
            for quality in [attr::TEMPORALQUALITY, attr::DOFQUALITY] {
                let few = camera.get(quality).min(COARSE_QUALITY * COARSE_QUALITY);
                camera.params.set(quality.param(few));
            }
            camera.params.set(attr::RESOLUTION.param(coarse.resolution()));
            let crop = crop.unwrap_or(camera.get(attr::CROP));
            camera.params.set(attr::CROP.param(coarse.grown_crop(crop)));
        } else if let Some(crop) = crop {
            camera.params.set(attr::CROP.param(crop));
        }
    }
}

/// Makes an image of the command line one of a frame of a look.
fn look_alike(output: &mut Output, looking: &Looking, frame: u32) {
    if matches!(&*output.data, "rgb" | "rgba") && output.params.is_empty() {
        output.params = Looking::params(&output.format);
    }
    rename(output, looking, frame);
}

/// Numbers an image of a turntable.
fn rename(output: &mut Output, looking: &Looking, frame: u32) {
    output.name = looking.name(&output.name, &*output.format != "iv", frame).into();
}

/// Returns the surface shader that replaces all shaders under the camera's "shadertype" (reference 4.1); `None`
/// when the scene's own shaders run.
fn proxy_shader(camera: &Camera) -> Option<&'static str> {
    match &*camera.get(attr::SHADERTYPE) {
        "defaultsurface" => Some("defaultsurface"),
        "keyfillrim" => Some("keyfillrim"),
        _ => None,
    }
}

/// Replaces the shaders of all objects by one surface shader that needs no lights.
fn shade_plainly(scene: &mut Scene, surface: &str) {
    let layer = ShaderInstance {
        shader: surface.into(),
        layer: None,
        params: granita_base::Params::new(),
        to_world: MotionTransform::default(),
        state: "".into(),
        at: Location::default(),
    };
    let group = Arc::new(ShaderGroup { layers: vec![Arc::new(layer)], connections: Vec::new() });
    // Objects that shared a state share the new one.
    let mut plain: BTreeMap<usize, (Arc<AttributeSet>, Arc<AttributeSet>)> = BTreeMap::new();
    for primitive in &mut scene.primitives {
        let old = primitive.attributes.clone();
        let (_, new) = plain.entry(Arc::as_ptr(&old) as usize).or_insert_with(|| {
            let set = AttributeSet {
                surface: Some(group.clone()),
                displacement: None,
                volume: None,
                lights: LightSet::default(),
                ..(*old).clone()
            };
            (old, Arc::new(set))
        });
        Arc::make_mut(primitive).attributes = new.clone();
    }
    scene.lights.clear();
}

/// True when the outputs are only the automatic one of a scene without outputs.
fn is_automatic(outputs: &[Output], scene: &Scene) -> bool {
    let [output] = outputs else { return outputs.is_empty() };
    let Some(camera) = scene.cameras.first() else { return false };
    let name = format!("{}.tif", camera.name);
    *output.name == *name && &*output.data == "rgba" && output.params.is_empty()
}

/// True when it is shown in a viewer and not written to a file.
pub(crate) fn is_iv(extra: &ExtraOutput) -> bool {
    extra.format.as_deref() == Some("iv")
}

/// Returns the scene without its own outputs to viewers, which the user did not request.
pub(crate) fn without_viewers(scene: &Arc<Scene>, reporter: &Reporter) -> Arc<Scene> {
    let is_shown = |output: &Output| &*output.format == "iv";
    let Some(shown) = scene.outputs.iter().find(|output| is_shown(output)) else { return scene.clone() };
    reporter.warning(format!(
        "output \"{}\": a viewer is started by -iv or -display, not by the scene (-safe)",
        shown.name
    ));
    let mut scene: Scene = (**scene).clone();
    scene.outputs.retain(|output| !is_shown(output));
    Arc::new(scene)
}

/// Returns true when any image goes to a viewer, and true when one of these does not name its viewer.
pub(crate) fn shows(scene: &Scene, safe: bool) -> (bool, bool) {
    let mut shown = scene.outputs.iter().filter(|output| &*output.format == "iv").peekable();
    let any = shown.peek().is_some();
    (any, shown.any(|output| safe || output.params.get("display").is_none()))
}

/// Returns the scene with `address` for images of the format "iv" that do not name a viewer themselves ("display").
/// Untrusted scenes must not name one.
pub(crate) fn displayed(
    scene: &Arc<Scene>,
    address: Option<&str>,
    safe: bool,
    reporter: &Reporter,
) -> Arc<Scene> {
    let mut scene: Scene = (**scene).clone();
    for output in scene.outputs.iter_mut().filter(|output| &*output.format == "iv") {
        if output.params.get("display").is_some() {
            if !safe {
                continue;
            }
            reporter
                .warning(format!("output \"{}\": scenes may not name a viewer (\"display\")", output.name));
            output.params.0.retain(|param| &*param.name != "display");
        }
        if let Some(address) = address {
            let ty = ParamType::of(BaseType::String);
            output.params.set(Param { name: "display".into(), ty, data: address.into() });
        }
    }
    Arc::new(scene)
}

fn extra_outputs(
    extra: &ExtraOutput,
    own: &[Output],
    scene: &Scene,
    registry: &FormatRegistry,
    reporter: &Reporter,
) -> Vec<Output> {
    let Some(camera) = scene.cameras.first() else { return Vec::new() };
    let path = Path::new(&extra.name);
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let format = match &extra.format {
        Some(format) => format.clone(),
        None => match registry.by_name(extension) {
            Some(format) => format.name().to_owned(),
            None => {
                let known = registry.formats().iter();
                let known = known.filter(|f| f.supports("write") && !f.extensions().is_empty());
                let known: Vec<&str> = known.map(|f| f.name()).collect();
                reporter.error(format!(
                    "{}: the extension \"{extension}\" is of no known image format (known: {})",
                    extra.name,
                    known.join(", ")
                ));
                return Vec::new();
            }
        },
    };
    let plain = Output {
        name: extra.name.as_str().into(),
        format: format.as_str().into(),
        data: extra.data.as_str().into(),
        camera: camera.name.clone(),
        params: granita_base::Params::new(),
    };
    let like = |name: String, output: &Output| {
        let mut output = Output { name: name.into(), format: plain.format.clone(), ..output.clone() };
        if is_iv(extra) {
            // A viewer has its own exposure and takes values of full precision.
            let of_files = ["quantize", "dither", "gain", "gamma"];
            output.params.0.retain(|param| !of_files.contains(&&*param.name));
        }
        output
    };
    let pages: Vec<&Output> = own.iter().filter(|output| !is_iv(extra) || &*output.format != "iv").collect();
    match extra.data.as_str() {
        "first" => match own.first() {
            Some(first) => vec![like(extra.name.clone(), first)],
            None => vec![Output { data: "rgba".into(), ..plain }],
        },
        "all" if is_iv(extra) && !pages.is_empty() => {
            let name = |output: &Output| format!("{} {}", output.name, output.data);
            pages.into_iter().map(|output| like(name(output), output)).collect()
        }
        "all" if own.len() > 1 => {
            let stem = path.with_extension("");
            let name = |i: usize| format!("{}-{}.{extension}", stem.display(), i + 1);
            own.iter().enumerate().map(|(i, output)| like(name(i), output)).collect()
        }
        "all" => vec![Output { data: "rgba".into(), ..plain }],
        _ => vec![plain],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coarse_and_final_frames_of_a_desk_share_the_memory() {
        let kept = |memory_kb: i32, coarse| {
            let mut scene = Scene::default();
            let param = attr::RERENDER_MEMORY.param(memory_kb);
            scene.globals.insert(param.name.clone(), param);
            for_desk(&mut scene, DeskFrame { coarse, crop: None }, &SessionOptions::default());
            scene.get(attr::RERENDER_MEMORY)
        };
        assert_eq!([kept(1000, true), kept(1000, false)], [125, 875]);
        // 0 is no limit, and stays none.
        assert_eq!([kept(0, true), kept(0, false)], [0, 0]);
        assert_eq!([kept(1, true), kept(1, false)], [1, 1]);
    }
}
