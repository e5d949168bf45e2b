//! Small scenes for the tests of shading.

use crate::{CameraView, NoShader, RenderEnvironment, ShaderLibrary, Silent};
use granita_base::{
    Environment, Location, MotionTransform, Param, Params, Reporter, SearchPath, ShapeDesc, Transform, Vec3,
};
use granita_gsl::ir::Module;
use granita_image::FormatRegistry;
use granita_scene::{
    AttributeSet, Camera, Light, LightId, Primitive, Scene, ShaderGroup, ShaderInstance, ShapeKey,
};
use granita_sdb::Databases;
use granita_shade::{Grid, Lanes3, Topology};
use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

/// Shaders compiled from text.
#[derive(Default)]
pub(crate) struct Library(BTreeMap<String, Arc<Module>>);

impl ShaderLibrary for Library {
    fn load(&self, name: &str) -> Result<Arc<Module>, NoShader> {
        self.0.get(name).cloned().ok_or_else(|| NoShader::Missing("looked nowhere".to_owned()))
    }
}

/// A scene in the making. The camera looks down from (0, 0, 10).
pub(crate) struct Fixture {
    pub(crate) scene: Scene,
    library: Library,
    reporter: Reporter,
    messages: Arc<Mutex<Vec<String>>>,
    lights: Vec<LightId>,
}

/// A parameter from its declaration.
pub(crate) fn param(declaration: &str, data: impl Into<granita_base::ParamData>) -> Param {
    Param::declared(declaration, data).unwrap()
}

/// A shader by name, with parameters, declared in a space.
pub(crate) fn shader(name: &str, params: &[Param], to_world: Transform) -> Arc<ShaderGroup> {
    let instance = ShaderInstance {
        shader: name.into(),
        layer: None,
        params: Params(params.to_vec()),
        to_world: MotionTransform::from(to_world),
        state: "".into(),
        at: Location::default(),
    };
    Arc::new(ShaderGroup { layers: vec![Arc::new(instance)], connections: Vec::new() })
}

impl Fixture {
    pub(crate) fn new(shaders: &[&str]) -> Self {
        let messages = Arc::new(Mutex::new(Vec::new()));
        let kept = messages.clone();
        let reporter = Reporter::new(Box::new(move |m| kept.lock().unwrap().push(m.to_string())));
        let mut library = Library::default();
        for source in shaders {
            let module = compile(source);
            library.0.insert(module.name.to_string(), module);
        }
        // Looking down: camera x is world x, camera y is world y, camera z is -z from height 10.
        let down = Transform::translate(Vec3::new(0.0, 0.0, -10.0))
            .then(&Transform::scale(Vec3::new(1.0, 1.0, -1.0)));
        let scene = Scene {
            cameras: vec![Camera { name: "cam".into(), world_to_camera: down.into(), params: Params::new() }],
            ..Scene::default()
        };
        Self { scene, library, reporter, messages, lights: Vec::new() }
    }

    /// Sets a scene-wide attribute.
    pub(crate) fn global(&mut self, declaration: &str, data: impl Into<granita_base::ParamData>) {
        let p = param(declaration, data);
        self.scene.globals.insert(p.name.clone(), p);
    }

    /// Adds a light that shines on what comes after it.
    pub(crate) fn light(&mut self, name: &str, params: &[Param], to_world: Transform) {
        let id = LightId(self.scene.lights.len() as u32);
        self.scene.lights.push(Arc::new(Light {
            name: format!("light{}", id.0).into(),
            group: (*shader(name, params, to_world)).clone(),
            attributes: Arc::new(AttributeSet::default()),
        }));
        self.lights.push(id);
    }

    /// Attributes of an object with a surface shader, in geometry sets.
    pub(crate) fn attributes(&self, surface: &str, sets: &[&str], values: &[Param]) -> AttributeSet {
        AttributeSet {
            values: Arc::new(values.iter().map(|v| (v.name.clone(), v.clone())).collect()),
            surface: (!surface.is_empty()).then(|| shader(surface, &[], Transform::IDENTITY)),
            lights: self.lights.iter().copied().collect(),
            geometry_sets: sets.iter().map(|s| Arc::from(*s)).collect(),
            ..AttributeSet::default()
        }
    }

    /// Adds a primitive.
    pub(crate) fn add(
        &mut self,
        shape: ShapeDesc,
        params: Params,
        attributes: AttributeSet,
    ) -> Arc<Primitive> {
        let primitive = Arc::new(Primitive {
            id: self.scene.primitives.len() as u32,
            shape,
            keys: vec![ShapeKey { time: 0.0, params }],
            attributes: Arc::new(attributes),
            at: Location::default(),
        });
        self.scene.primitives.push(primitive.clone());
        primitive
    }

    /// Adds a horizontal rectangle, facing up, at height `z`.
    pub(crate) fn rectangle(
        &mut self,
        lo: [f32; 2],
        hi: [f32; 2],
        z: f32,
        attributes: AttributeSet,
    ) -> Arc<Primitive> {
        let p = [lo[0], lo[1], z, hi[0], lo[1], z, hi[0], hi[1], z, lo[0], hi[1], z];
        let shape = ShapeDesc::Mesh { subdivide: false, nverts: [4].into(), verts: [0, 1, 2, 3].into() };
        self.add(shape, Params(vec![param("vertex point P", &p[..])]), attributes)
    }

    /// Adds a sphere.
    pub(crate) fn sphere(&mut self, center: Vec3, radius: f32, attributes: AttributeSet) -> Arc<Primitive> {
        let shape = ShapeDesc::Sphere { radius, zmin: -radius, zmax: radius, thetamax_deg: 360.0 };
        let to_world = MotionTransform::from(Transform::translate(center));
        self.add(shape, Params::new(), AttributeSet { to_world, ..attributes })
    }

    /// The finished scene, its camera, and what a frame is given.
    pub(crate) fn finish(&self) -> (Arc<Scene>, CameraView, RenderEnvironment) {
        let environment = RenderEnvironment {
            registry: FormatRegistry::default(),
            shaders: Arc::new(Library(self.library.0.clone())),
            texture_path: SearchPath::default(),
            variables: Environment::empty(),
            reporter: self.reporter.clone(),
            progress: Arc::new(Silent),
            threads: 2,
            open_files: None,
            stop: Arc::new(AtomicBool::new(false)),
            call_text: |calls, _| Ok(format!("{calls:?}\n").into_bytes()),
            databases: Arc::new(Databases::new(FormatRegistry::default(), self.reporter.clone())),
            scene_files: Vec::new(),
            spread: crate::Spread::Alone,
            priority: Default::default(),
            crop: None,
        };
        let camera = CameraView::new(&self.scene.cameras[0], &self.reporter);
        (Arc::new(self.scene.clone()), camera, environment)
    }

    /// Texts of the warnings and errors so far.
    pub(crate) fn complaints(&self) -> Vec<String> {
        self.messages.lock().unwrap().clone()
    }
}

fn compile(source: &str) -> Arc<Module> {
    let options = granita_gsl::CompileOptions::default();
    match granita_gsl::compile(source, "test.gsl", &options) {
        Ok(compiled) => Arc::new(compiled.module),
        Err(errors) => panic!("{errors:?}\n{source}"),
    }
}

/// Points of the plane z = 0, seen from straight above, normals up.
pub(crate) fn flat_grid(points: &[[f32; 2]]) -> Grid {
    let n = points.len();
    let mut grid = Grid::new(Topology::Rect { nu: n, nv: 1 });
    let p: Vec<Vec3> = points.iter().map(|p| Vec3::new(p[0], p[1], 0.0)).collect();
    grid.p = Lanes3::from_points(&p);
    grid.n = Lanes3::splat(Vec3::Z, n);
    grid.ng = Lanes3::splat(Vec3::Z, n);
    grid.i = Lanes3::splat(-Vec3::Z, n);
    grid.dpdu = Lanes3::splat(Vec3::X, n);
    grid.dpdv = Lanes3::splat(Vec3::Y, n);
    grid.u = (0..n).map(|i| i as f32).collect();
    grid
}
