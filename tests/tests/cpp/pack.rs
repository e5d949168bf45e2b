//! Tests of packed scenes with plugins (`gelato -pack`).

use crate::support::{BUILT, compilers, plugin};
use granita_tests::{Image, repository};
use std::path::{Path, PathBuf};
use std::process::Command;

/// A folder with a scene, "shot", and one with its plugins, "plugins".
struct Show {
    folder: tempfile::TempDir,
}

impl Show {
    fn new(scene: &str) -> Self {
        let show = Self { folder: tempfile::tempdir().unwrap() };
        for name in ["show/shot", "show/plugins", "show/compiled"] {
            std::fs::create_dir_all(show.path(name)).unwrap();
        }
        let compiler = compilers()[0];
        for (source, name) in
            [("spiral.cpp", "spiral.generator.so"), ("fmap.cpp", "fmap.imageio.so"), ("fbm.cpp", "fbm.so")]
        {
            let to = show.path("show/plugins").join(source);
            std::fs::copy(repository().join("examples/cpp").join(source), &to).unwrap();
            plugin(compiler, &to, name, &[]);
        }
        let shader = repository().join("examples/cpp/marble.gsl");
        std::fs::copy(shader, show.path("show/compiled/marble.gsl")).unwrap();
        // The compiled shader names the library of its function, and its source is gone.
        let plugins = show.path("show/plugins");
        let mut command = Command::new(BUILT.program("gslc"));
        command.current_dir(show.path("show/compiled")).arg("-plugins").arg(plugins).arg("marble.gsl");
        assert!(command.status().unwrap().success());
        std::fs::remove_file(show.path("show/compiled/marble.gsl")).unwrap();
        let scene = scene.replace("SHOW/", &format!("{}/", show.path("show").display()));
        std::fs::write(show.path("show/shot/shot.pyg"), scene).unwrap();
        show
    }

    fn path(&self, name: &str) -> PathBuf {
        std::fs::canonicalize(self.folder.path()).unwrap().join(name)
    }

    /// Runs gelato, which must have nothing to report, and returns its standard output.
    fn run(&self, folder: &Path, words: &[&str]) -> String {
        let mut command = Command::new(BUILT.program("gelato"));
        command.current_dir(folder).args(words).env_remove("GELATOHOME").env("HOME", self.path("none"));
        let ran = command.output().unwrap();
        let said = String::from_utf8_lossy(&ran.stderr).into_owned();
        assert!(ran.status.success() && said.is_empty(), "{words:?}: {said}");
        String::from_utf8_lossy(&ran.stdout).into_owned()
    }

    /// Renders the scene, packs it, and renders the pack where there is nothing else.
    fn check(&self, options: &[&str]) {
        let shot = self.path("show/shot");
        let words = |more: &[&'static str]| [more, options, &["shot.pyg"][..]].concat();
        let before = |name: &str| std::fs::read(shot.join(name)).unwrap();
        self.run(&shot, &words(&[]));
        let (tiff, fmap) = (Image::read(&shot.join("plugins.tif")).unwrap(), before("plugins.fmap"));
        let list: serde_json::Value = serde_json::from_str(&self.run(&shot, &words(&["-assets"]))).unwrap();
        let kinds = list["files"].as_array().unwrap().iter().filter(|file| file["kind"] == "plugin");
        assert_eq!(kinds.count(), 3, "{list:#}");
        self.run(&shot, &words(&["-pack", "../../packed"]));
        std::fs::rename(self.path("show"), self.path("gone")).unwrap();
        let packed = self.path("packed");
        let plugins = packed.join("files").join(self.path("show/plugins").strip_prefix("/").unwrap());
        for name in ["spiral.generator.so", "fmap.imageio.so", "fbm.so"] {
            assert!(plugins.join(name).is_file(), "{name}");
        }
        // Plugins that the user named need not be named again.
        for workers in [&[][..], &["-net", "local"]] {
            self.run(self.folder.path(), &[&["-cwd", "packed"], workers, &["shot.pyg"]].concat());
            assert!(Image::read(&packed.join("plugins.tif")).unwrap() == tiff, "other pixels");
            assert!(std::fs::read(packed.join("plugins.fmap")).unwrap() == fmap, "other pixels");
        }
    }
}

const SCENE: &str = "PATHSAttribute (\"string path:shader\", \"../compiled:&\")\n\
    Attribute (\"int[2] resolution\", (64, 48))\nAttribute (\"float fov\", 40)\n\
    Output (\"plugins.fmap\", \"fmap\", \"rgb\", \"main\")\nOutput (\"plugins.tif\", \"tiff\", \"rgba\", \"main\")\n\
    World ()\nTranslate (0, 0, 4)\nInput (\"spiral 60 0.12\")\nShader (\"surface\", \"marble\")\n\
    Translate (0, 0, 1.5)\nSphere (1, -1, 1, 360)\nRender ()\n";

#[test]
fn plugins_on_search_paths_are_packed() {
    let paths = ["generator", "imageio", "shader"]
        .map(|kind| format!("Attribute (\"string path:{kind}\", \".:SHOW/plugins:&\")\n"));
    Show::new(&SCENE.replace("PATHS", &paths.concat())).check(&[]);
}

#[test]
fn plugins_of_the_command_line_are_packed() {
    Show::new(&SCENE.replace("PATHS", "")).check(&["-plugins", "../plugins"]);
}
