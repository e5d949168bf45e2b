//! A state machine with a renderer that keeps its scenes.

use granita_base::{Location, Param, ParamData, Params, Reporter, ShapeDesc, Vec3};
use granita_scene::{
    Call, FoundInput, FrameRenderer, InputPaths, InputReader, Scene, SceneSink, ShaderGroup, State, Stop,
};
use parking_lot::Mutex;
use std::sync::Arc;

/// The shader that the renderer does not find.
pub(crate) const MISSING: &str = "missing";

/// Stores the scenes that it receives, and the lights that it checks: name, location and search path.
#[derive(Clone, Default)]
pub(crate) struct Keeper(pub(crate) Arc<Mutex<Vec<Rendered>>>, pub(crate) Arc<Mutex<Vec<String>>>);

/// A scene and the requested camera.
pub(crate) type Rendered = (Arc<Scene>, Option<String>);

impl FrameRenderer for Keeper {
    fn render(&mut self, scene: Arc<Scene>, camera: Option<&str>) -> Result<(), Stop> {
        self.0.lock().push((scene, camera.map(str::to_owned)));
        Ok(())
    }
    fn command(&mut self, name: &str, _: &Params, _: &Location) -> Result<bool, Stop> {
        Ok(name.starts_with("system"))
    }
    fn check_light(&mut self, name: &str, group: &ShaderGroup, shader_path: &str, at: &Location) -> bool {
        self.1.lock().push(format!("{name} {at} {shader_path}"));
        group.layers.iter().all(|layer| &*layer.shader != MISSING)
    }
    fn input(
        &mut self,
        command: &str,
        paths: InputPaths<'_>,
        _: &Location,
    ) -> Result<Option<FoundInput>, Stop> {
        assert!(paths.input.starts_with(".") && paths.generator.starts_with("."));
        let found = |reader: InputReader| Some(FoundInput { identity: command.into(), bound: None, reader });
        let again = |command: String| -> InputReader {
            Box::new(move |sink| {
                sink.call(Call::Input { command: command.into(), bound: None }, &Location::default())
            })
        };
        Ok(match command {
            "move" => {
                found(Box::new(|sink| sink.call(Call::Translate([7.0, 0.0, 0.0]), &Location::default())))
            }
            "itself" => found(again("between".to_owned())),
            "between" => found(again("itself".to_owned())),
            number => number.parse::<u32>().ok().and_then(|n| found(again((n + 1).to_string()))),
        })
    }
}

pub(crate) struct Run {
    pub(crate) state: State,
    pub(crate) kept: Keeper,
    pub(crate) messages: Arc<Mutex<Vec<granita_base::report::Message>>>,
    pub(crate) line: u32,
}

impl Run {
    pub(crate) fn new() -> Self {
        let kept = Keeper::default();
        let (reporter, messages) = Reporter::collecting();
        Self { state: State::new(Box::new(kept.clone()), reporter), kept, messages, line: 0 }
    }

    pub(crate) fn calls(&mut self, calls: impl IntoIterator<Item = Call>) -> &mut Self {
        for call in calls {
            self.line += 1;
            self.state.call(call, &Location::line(&"t.pyg".into(), self.line)).unwrap();
        }
        self
    }

    pub(crate) fn messages(&self) -> Vec<String> {
        self.messages.lock().iter().map(ToString::to_string).collect()
    }

    /// Returns the only message.
    pub(crate) fn message(&self) -> String {
        let all = self.messages();
        assert_eq!(all.len(), 1, "{all:?}");
        all[0].clone()
    }

    pub(crate) fn scene(&mut self) -> Arc<Scene> {
        self.calls([Call::Render { camera: None }]);
        self.kept.0.lock().last().unwrap().0.clone()
    }
}

pub(crate) fn attr(declaration: &str, data: impl Into<ParamData>) -> Call {
    Call::Attribute(Param::declared(declaration, data).unwrap())
}

pub(crate) fn sphere() -> Call {
    let shape = ShapeDesc::Sphere { radius: 1.0, zmin: -1.0, zmax: 1.0, thetamax_deg: 360.0 };
    Call::Shape { shape: Box::new(shape), params: Params::new() }
}

pub(crate) fn points(p: &[f32]) -> Call {
    let params = [Param::declared("vertex point P", p).unwrap()].into_iter().collect();
    Call::Shape { shape: Box::new(ShapeDesc::Points { n: p.len() / 3 }), params }
}

pub(crate) fn camera(name: &str) -> Call {
    Call::Camera { name: name.into(), params: Params::new() }
}

pub(crate) fn light(id: &str, shader: Option<&str>) -> Call {
    Call::Light { id: id.into(), shader: shader.map(Into::into), layer: None, params: Params::new() }
}

pub(crate) fn shader(usage: &str, name: &str, layer: Option<&str>) -> Call {
    Call::Shader {
        usage: usage.into(),
        name: Some(name.into()),
        layer: layer.map(Into::into),
        params: Params::new(),
    }
}

pub(crate) fn name(n: &str) -> Call {
    attr("string name", n)
}

pub(crate) fn origin(scene: &Scene, i: usize) -> Vec3 {
    scene.primitives[i].attributes.to_world.first().point(Vec3::ZERO)
}
