//! Renders scenes in their own folder and in this process.

use granita_base::Reporter;
use granita_render::{ShadingStatistics, Statistics};
use granita_session::{Outcome, Session, SessionError, SessionOptions};
use granita_tests::Image;
use std::path::PathBuf;
use tempfile::TempDir;

/// An orthographic camera that sees -1..1 by -1..1 with 16 x 16 pixels. Its image "out.tif" has float values and a box
/// filter of one pixel.
pub(crate) const CAMERA: &str = r#"
Attribute ("int[2] resolution", (16, 16))
Attribute ("string projection", "orthographic")
Attribute ("float[4] screen", (-1, 1, -1, 1))
Output ("@/out.tif", "tiff", "rgba", "camera", "int[4] quantize", (0, 0, 0, 0), "float dither", 0,
        "string filter", "box", "float[2] filterwidth", (1, 1))
"#;

/// A square that fills the view of [`CAMERA`], in the plane z = 0.
pub(crate) const SQUARE: &str =
    "Patch (\"linear\", 2, 2, \"vertex point P\", (-1, -1, 0, 1, -1, 0, -1, 1, 0, 1, 1, 0))\n";

/// A folder for the files of a test.
pub(crate) struct Place(TempDir);

/// The result of a scene.
pub(crate) struct Rendered {
    pub(crate) outcome: Outcome,
    /// The messages, in order.
    pub(crate) said: Vec<String>,
}

impl Rendered {
    /// Returns the statistics of the first camera of the first frame.
    pub(crate) fn counts(&self) -> &Statistics {
        &self.outcome.frames[0].cameras[0].1
    }

    /// Returns the statistics of the shading of the first frame.
    pub(crate) fn shading(&self) -> &ShadingStatistics {
        &self.outcome.frames[0].shading
    }
}

impl Place {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// Returns the path of a file of this folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file. `@` in its text stands for this folder.
    pub(crate) fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), self.placed(text)).unwrap();
    }

    pub(crate) fn placed(&self, text: &str) -> String {
        text.replace('@', self.0.path().to_str().unwrap())
    }

    /// Reads a scene, in which `@` stands for this folder, and renders its frames.
    pub(crate) fn render(&self, scene: &str) -> Rendered {
        self.render_with(scene, SessionOptions::default())
    }

    /// Does the same with options.
    pub(crate) fn render_with(&self, scene: &str, options: SessionOptions) -> Rendered {
        let options = SessionOptions { no_startup_files: true, ..options };
        let (reporter, kept) = Reporter::collecting();
        let mut session = Session::new(options, reporter, Default::default());
        let text = std::io::Cursor::new(self.placed(scene).into_bytes());
        let result = session.read_stream("<test>", Box::new(text));
        assert!(matches!(result, Ok(()) | Err(SessionError::Exit)), "{result:?}");
        let outcome = session.finish();
        let said = kept.lock().iter().map(ToString::to_string).collect();
        Rendered { outcome, said }
    }

    /// Renders a scene that must be complete and cause no message.
    pub(crate) fn quiet(&self, scene: &str) -> Rendered {
        let rendered = self.render(scene);
        assert!(
            rendered.said.is_empty() && rendered.outcome.complete,
            "{scene}\n{:?} {:?}",
            rendered.said,
            rendered.outcome
        );
        rendered
    }

    /// Reads an image of this folder.
    pub(crate) fn image(&self, name: &str) -> Image {
        Image::read(&self.path(name)).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Renders a scene of [`CAMERA`] with more before and after `World`, without messages. Returns "out.tif".
    pub(crate) fn seen(&self, before: &str, world: &str) -> Image {
        self.quiet(&scene(before, world));
        self.image("out.tif")
    }
}

/// Returns the text of a scene of [`CAMERA`], with more before and after `World`. The world is five units away.
pub(crate) fn scene(before: &str, world: &str) -> String {
    format!("{CAMERA}{before}\nTranslate (0, 0, 5)\nWorld ()\n{world}\nRender ()\n")
}

/// Writes a surface shader into the folder as "asks.gsl". Returns the text of [`SQUARE`] with this shader.
pub(crate) fn asks(place: &Place, parameters: &str, body: &str) -> String {
    place.write("asks.gsl", &format!("surface asks ({parameters}) {{ {body} }}\n"));
    format!("Shader (\"surface\", \"asks\")\n{SQUARE}")
}

/// A line of a scene that adds the folder to the search path of shaders.
pub(crate) const SHADERS: &str = "Attribute (\"string path:shader\", \"@:&\")\n";

/// Returns the pixel of [`CAMERA`] that contains the point (x, y).
pub(crate) fn at(image: &Image, x: f32, y: f32) -> &[f32] {
    let (w, h) = (image.width as f32, image.height as f32);
    image.pixel(((x + 1.0) * 0.5 * w) as usize, ((1.0 - y) * 0.5 * h) as usize).unwrap()
}

/// Returns the middle of pixel `i` of 16 along an axis of [`CAMERA`].
pub(crate) fn middle(i: usize) -> f32 {
    (i as f32 + 0.5) / 8.0 - 1.0
}

pub(crate) fn assert_near(found: &[f32], wanted: &[f32], tolerance: f32, what: &str) {
    let near = found.len() >= wanted.len()
        && wanted.iter().zip(found).all(|(w, f)| (w - f).abs() <= tolerance || w == f);
    assert!(near, "{what}: {found:?}, not {wanted:?}");
}

/// Returns the number of different values of the alpha of an image.
pub(crate) fn levels_of_alpha(image: &Image) -> usize {
    let mut bits: Vec<u32> = image.values.chunks(4).map(|p| p[3].to_bits()).collect();
    bits.sort_unstable();
    bits.dedup();
    bits.len()
}
