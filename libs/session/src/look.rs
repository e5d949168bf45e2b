//! Images of objects that come without a frame: a model is shown on a floor, in the light of a studio.
//!
//! [`Session::look`] adds what the files lack, and nothing else: a camera that frames the objects, an image, lights, a
//! surface shader for objects without one. The lights and the floor are the bundled inputs
//! "studiolights.pyg" and "studio.pyg". Files of these names on "path:input" replace them.

use crate::looking::{FOV_DEG, Framing, GAMMA, Lens, Looking, STUDIO, Space};
use crate::session::stopped;
use crate::{Session, SessionError};
use granita_base::{Color, Location, Param, Params, Severity};
use granita_scene::{Call, TransformTarget, attr};
use std::path::Path;
use std::sync::Arc;

/// The geometry set of the objects, which cast shadows in the studio.
const SET: &str = "studio";
/// The camera, when the files declare none.
const CAMERA: &str = "camera";
/// The distance within which nothing casts shadows, relative to the radius of the objects.
const BIAS: f32 = 4.0e-4;
/// The colour of objects without one, in linear light.
const GREY: f32 = 0.62;

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
        let fov = if state.is_given(attr::FOV.name()) { attr::FOV.ask(state) } else { FOV_DEG };
        libm::tanf((0.5 * fov.clamp(1.0, 150.0)).to_radians())
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
                params.push(attr::FOV.param(libm::atanf(self.half_tangent()).to_degrees() * 2.0));
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
