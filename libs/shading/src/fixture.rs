//! Scenes with shaders for unit tests.

pub(crate) use granita_fixture::{Fixture, flat_grid, param, shader};

use crate::ShadingEnvironment;
use granita_base::SearchPath;
use granita_dicing::CameraView;
use granita_image::FormatRegistry;
use granita_scene::Scene;
use granita_sdb::Databases;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Turns a fixture into the inputs of shading.
pub(crate) trait Finish {
    /// Returns the finished scene, its camera and the inputs of a frame.
    fn finish(&self) -> (Arc<Scene>, CameraView, ShadingEnvironment);
}

impl Finish for Fixture {
    fn finish(&self) -> (Arc<Scene>, CameraView, ShadingEnvironment) {
        let environment = ShadingEnvironment {
            registry: FormatRegistry::default(),
            shaders: Arc::new(self.compiled()),
            texture_path: SearchPath::default(),
            reporter: self.reporter.clone(),
            threads: 2,
            open_files: None,
            stop: Arc::new(AtomicBool::new(false)),
            databases: Arc::new(Databases::new(FormatRegistry::default(), self.reporter.clone())),
        };
        let (scene, camera) = self.view();
        (scene, camera, environment)
    }
}
