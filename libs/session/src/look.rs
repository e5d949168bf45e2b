//! Images of objects that come without a frame: a model is shown on a floor, in the light of a studio.
//!
//! [`Session::look`] adds what the files lack, and nothing else: a camera that frames the objects, an image, lights, a
//! surface shader for objects without one. The lights and the floor are the bundled inputs
//! "studiolights.pyg" and "studio.pyg". Files of these names on "path:input" replace them.

mod framing;

use crate::session::stopped;
use crate::{Session, SessionError};
pub use framing::Up;
use framing::{Framing, Lens, Space};
use granita_base::{Color, Location, Param, Params, Severity};
use granita_scene::{Call, Scene, SceneSink, State, Stop, TransformTarget, attr};
use std::path::Path;
use std::sync::Arc;

/// The attribute "name" of everything that the studio adds.
const STUDIO: &str = "studio";
/// The geometry set of the objects, which cast shadows in the studio.
const SET: &str = "studio";
/// The camera, when the files declare none.
const CAMERA: &str = "camera";
/// The vertical field of view in degrees, when the files set none.
const FOV_DEG: f32 = 30.0;
/// The gamma of images for screens.
const GAMMA: f32 = 2.2;
/// The formats of linear light.
const LINEAR: [&str; 3] = ["exr", "hdr", "pfm"];
/// The distance within which nothing casts shadows, relative to the radius of the objects.
const BIAS: f32 = 4.0e-4;
/// The angle in degrees up to which neighbouring faces of meshes without normals are smooth.
const SMOOTH_DEG: f32 = 40.0;
/// The colour of objects without one, in linear light.
const GREY: f32 = 0.62;

/// What the user requests of [`Session::look`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LookOptions {
    /// The number of images of a whole turn; 0 for one image.
    pub turntable: u32,
    /// The axis that points up.
    pub up: Up,
}

/// How the next frame is rendered: once, or in the positions of a turntable.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Looking {
    framing: Framing,
    /// The number of positions; 0 for a single image, which has no number.
    turns: u32,
}

impl Looking {
    /// The number of frames.
    pub(crate) fn frames(&self) -> u32 {
        self.turns.max(1)
    }

    /// Returns the scene of a frame. Its cameras and the studio are turned.
    pub(crate) fn scene(&self, scene: &Arc<Scene>, frame: u32) -> Arc<Scene> {
        if self.turns == 0 {
            return scene.clone();
        }
        let mut scene = (**scene).clone();
        scene.turn_around(STUDIO, &self.framing.turn(frame as f32 / self.turns as f32));
        Arc::new(scene)
    }

    /// Returns the name of an image of a frame: `spin.png` becomes `spin-001.png`. A name without a file, as a viewer
    /// has it, becomes `spin.glb 001`.
    pub(crate) fn name(&self, name: &str, is_file: bool, frame: u32) -> String {
        if self.turns == 0 {
            return name.to_owned();
        }
        let digits = self.turns.to_string().len().max(3);
        let number = frame + 1;
        let path = Path::new(name);
        match (path.extension(), is_file) {
            (_, false) => format!("{name} {number:0digits$}"),
            (Some(extension), true) => {
                let stem = path.with_extension("");
                format!("{}-{number:0digits$}.{}", stem.display(), extension.to_string_lossy())
            }
            (None, true) => format!("{name}-{number:0digits$}"),
        }
    }

    /// Returns the parameters of an image that the user names, in a format.
    pub(crate) fn params(format: &str) -> Params {
        match LINEAR.contains(&format) || format == "iv" {
            true => Params::new(),
            false => Params(vec![attr::GAMMA.param(GAMMA)]),
        }
    }
}

/// Receives the calls of a mesh file that is to be looked at.
pub(crate) struct MeshSink<'a> {
    pub(crate) state: &'a mut State,
    /// True when the cameras of the file are known already.
    pub(crate) is_second_reading: bool,
}

impl SceneSink for MeshSink<'_> {
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
        self.state.call(call, at)
    }

    fn in_world(&self) -> bool {
        self.is_second_reading || self.state.in_world()
    }

    fn new_frame(&mut self) -> bool {
        self.state.new_frame()
    }

    fn attribute(&self, declaration: &str) -> Option<Param> {
        let found = self.state.attribute(declaration);
        if found.is_none() && declaration == "user:smooth" && !self.state.in_world() {
            return Param::declared("float user:smooth", SMOOTH_DEG).ok();
        }
        found
    }
}

impl Session {
    /// Shows the objects that were read, when no `Render` did and the files describe no frame: adds what they lack,
    /// renders, and reports where the image is. Does nothing when something was rendered, or there is no object.
    ///
    /// # Errors
    /// Returns [`SessionError::Exit`] or [`SessionError::Failed`].
    pub fn look(&mut self) -> Result<(), SessionError> {
        let options = self.options().look;
        if self.state_ref().has_rendered() {
            if options.turntable > 0 {
                let text = "-turntable has no effect: the scene has a Render () of its own";
                self.reporter().error(text);
            }
            return Ok(());
        }
        self.read_objects_beside_cameras()?;
        if !self.state_ref().lacks_frame() {
            return Ok(());
        }
        self.state().begin_stage().map_err(stopped)?;
        let Some(framing) = self.framing() else {
            self.reporter().error("nothing was rendered: no object is in the set \"camera\"");
            return Ok(());
        };
        self.frame(&framing)?;
        self.stage(&framing)?;
        self.render_as(Looking { framing, turns: options.turntable });
        self.call(Call::Render { camera: None })?;
        self.report_look();
        Ok(())
    }

    /// Returns the name of the file that is shown: the last one, since files of settings come first.
    fn look_name(&self) -> String {
        let names = &self.options().scene_files;
        self.objects_name().or_else(|| names.last().map(String::as_str)).unwrap_or("scene").trim().to_owned()
    }

    /// Returns the name of an image of that file, without an ending. The input `pyg << ...` has none of its own.
    fn stem(&self) -> String {
        let name = self.look_name();
        let stem = Path::new(&name).file_stem().map(|stem| stem.to_string_lossy().into_owned());
        stem.filter(|stem| !stem.contains(char::is_whitespace) && stem != "-")
            .unwrap_or_else(|| "scene".into())
    }

    /// Returns the camera and the studio for the objects that wait.
    fn framing(&self) -> Option<Framing> {
        let state = self.state_ref();
        let options = self.options().look;
        let [width, height] = attr::RESOLUTION.ask(state).map(|n| n.max(1) as f32);
        let orthographic = &*attr::PROJECTION.ask(state) == "orthographic";
        let lens = if orthographic { Lens::Orthographic } else { Lens::Perspective(self.half_tangent()) };
        let space = Space { up: options.up, right_handed: self.has_meshes() };
        Framing::new(&state.staged_points(), space, lens, width / height, options.turntable)
    }

    /// Returns the tangent of half the vertical field of view.
    fn half_tangent(&self) -> f32 {
        let state = self.state_ref();
        let fov = if state.is_given("fov") { attr::FOV.ask(state) } else { FOV_DEG };
        (0.5 * fov.clamp(1.0, 150.0)).to_radians().tan()
    }

    /// Declares the camera and the image that the files lack.
    fn frame(&mut self, framing: &Framing) -> Result<(), SessionError> {
        let cameras = self.state_ref().camera_names();
        if cameras.is_empty() {
            let state = self.state_ref();
            let [width, height] = attr::RESOLUTION.ask(state).map(|n| n.max(1) as f32);
            let [near, far] = framing.range;
            let (half, aspect) = (framing.half_height, width / height);
            let mut params = vec![attr::NEAR.param(near), attr::FAR.param(far)];
            if &*attr::PROJECTION.ask(state) == "orthographic" {
                params.push(attr::SCREEN.param(Some([-half * aspect, half * aspect, -half, half])));
            } else {
                params.push(attr::FOV.param(self.half_tangent().atan().to_degrees() * 2.0));
            }
            params.retain(|param| !state.is_given(&param.name));
            let name = CAMERA.into();
            self.call(Call::SetTransform(TransformTarget::Matrix(Box::new(framing.camera))))?;
            self.call(Call::Camera { name, params: Params(params) })?;
        }
        let named = !self.options().extra_outputs.is_empty();
        if !named && !self.state_ref().has_outputs() {
            let camera = cameras.first().cloned().unwrap_or_else(|| CAMERA.into());
            let name = format!("{}-look.png", self.stem()).into();
            let params = Params(vec![attr::GAMMA.param(GAMMA)]);
            self.call(Call::Output { name, format: "png".into(), data: "rgb".into(), camera, params })?;
        }
        Ok(())
    }

    /// Begins the world: the studio, and the objects in it.
    fn stage(&mut self, framing: &Framing) -> Result<(), SessionError> {
        let has_lights = self.state_ref().light_count() > 0;
        self.call(Call::World)?;
        self.call(Call::SetTransform(TransformTarget::Matrix(Box::new(framing.studio))))?;
        self.call(Call::Attribute(attr::SHADOW_BIAS.param(BIAS * framing.radius)))?;
        self.call(Call::Attribute(attr::NAME.param(STUDIO.into())))?;
        let input = |name: &str| Call::Input { command: name.into(), bound: None };
        if !has_lights {
            self.call(input("studiolights.pyg"))?;
        }
        // Simple shading would show the floor and the background as objects.
        if self.options().shadertype.as_deref().is_none_or(|name| name == "gsl") {
            self.call(Call::PushAttributes)?;
            self.call(input("studio.pyg"))?;
            self.call(Call::PopAttributes)?;
        }
        self.call(Call::Attribute(attr::NAME.param("".into())))?;
        self.call(Call::Attribute(attr::COLOR.param(Color::splat(GREY))))?;
        self.call(Call::Attribute(attr::GEOMETRYSET.param(format!("+{SET}").into())))?;
        let [usage, name] = ["surface", "plastic"].map(Arc::from);
        let params = Params(vec![float("Kd", 0.9), float("Ks", 0.25), float("roughness", 0.2)]);
        self.call(Call::Shader { usage, name: Some(name), layer: None, params })?;
        self.state().adopt();
        Ok(())
    }

    /// Reports what was added, and where the images are.
    fn report_look(&self) {
        let reporter = self.reporter();
        let frames = self.frames();
        let images: Vec<String> =
            frames.iter().flat_map(|f| &f.images).map(|path| path.display().to_string()).collect();
        let where_to = match &images[..] {
            [] => return,
            [one] => one.clone(),
            [first, .., last] => format!("{first} to {last}"),
        };
        let text = format!("{}: without Render (), shown in a studio: {where_to}\n", self.look_name());
        if reporter.verbosity() > 0 {
            reporter.say(Severity::Message, &Location::default(), text);
        }
    }
}

fn float(name: &str, value: f32) -> Param {
    Param {
        name: name.into(),
        ty: granita_base::ParamType::of(granita_base::BaseType::Float),
        data: value.into(),
    }
}
