//! Tests images that are shown while they are rendered.

use super::{CONSTANT, finish};
use crate::{RenderError, Renderer};
use granita_base::Params;
use granita_fixture::{Fixture, param};
use granita_image::{
    CreateOptions, Format, ImageError, ImageInput, ImageOutput, ImageSpec, Limits, PixelRect, Pixels,
    Request, Result,
};
use granita_scene::Output;
use parking_lot::Mutex;
use std::path::Path;
use std::sync::Arc;

/// A viewer that keeps the pixels that it receives. It returns requests after given numbers of rectangles.
#[derive(Default)]
pub(super) struct Viewer {
    asks: Vec<(usize, Request)>,
    fails_after: Option<usize>,
    pub(super) seen: Mutex<Seen>,
}

#[derive(Default)]
pub(super) struct Seen {
    begun: Vec<PixelRect>,
    written: Vec<PixelRect>,
    pub(super) pixels: Vec<f32>,
    asked: usize,
    closed: bool,
}

struct Shown(Arc<Viewer>, ImageSpec);

impl ImageOutput for Shown {
    fn write_rows(&mut self, _: &Pixels) -> Result<()> {
        panic!("a viewer takes rectangles")
    }

    fn write_tile(&mut self, _: u32, _: u32, _: &Pixels) -> Result<()> {
        panic!("a viewer takes rectangles")
    }

    fn write_rectangle(&mut self, rect: &PixelRect, pixels: &Pixels) -> Result<()> {
        let mut seen = self.0.seen.lock();
        if self.0.fails_after == Some(seen.written.len()) {
            return Err(ImageError::Misuse { path: "viewer".into(), what: "it is gone".to_owned() });
        }
        assert!(seen.begun.contains(rect));
        seen.written.push(*rect);
        let n = self.1.nchannels();
        seen.pixels.resize((self.1.width * self.1.height) as usize * n, f32::NAN);
        for (j, line) in pixels.to_floats().chunks_exact(rect.width() * n).enumerate() {
            let at = ((rect.y0 as usize + j) * self.1.width as usize + rect.x0 as usize) * n;
            seen.pixels[at..at + line.len()].copy_from_slice(line);
        }
        Ok(())
    }

    fn begin_rectangle(&mut self, rect: &PixelRect) {
        self.0.seen.lock().begun.push(*rect);
    }

    fn requests(&mut self) -> Vec<Request> {
        let mut seen = self.0.seen.lock();
        let from = seen.asked;
        let due = self.0.asks[from..].iter().take_while(|(after, _)| *after <= seen.written.len());
        let due: Vec<Request> = due.map(|(_, request)| *request).collect();
        seen.asked += due.len();
        due
    }

    fn next_level(&mut self, _: &ImageSpec) -> Result<()> {
        panic!("a viewer shows one level")
    }

    fn close(self: Box<Self>) -> Result<()> {
        self.0.seen.lock().closed = true;
        Ok(())
    }
}

pub(super) struct ViewerFormat(pub(super) Arc<Viewer>);

impl Format for ViewerFormat {
    fn name(&self) -> &'static str {
        "iv"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &[]
    }

    fn recognizes(&self, _: &[u8]) -> bool {
        false
    }

    fn open(&self, path: &Path, _: &Limits) -> Result<Box<dyn ImageInput>> {
        Err(ImageError::Misuse { path: path.to_owned(), what: "no file".to_owned() })
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "rectangles" | "float" | "channels" | "alpha")
    }

    fn create(&self, _: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        Ok(Box::new(Shown(self.0.clone(), options.spec.clone())))
    }
}

/// Renders a sphere in 30 buckets with the viewer. Returns true when the frame is complete, the floats of a file of the
/// same image, and the warnings.
fn render(
    viewer: &Arc<Viewer>,
    threads: usize,
) -> (std::result::Result<bool, RenderError>, Vec<f32>, Vec<String>) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.tif");
    let mut f = Fixture::new(&[CONSTANT]);
    f.scene.cameras[0].params = Params(vec![
        param("int[2] resolution", &[60, 50][..]),
        param("float[4] crop", &[0.0_f32, 1.0, 0.0, 1.0][..]),
        param("int[2] limits:bucketsize", &[10, 10][..]),
    ]);
    f.global("int[2] limits:bucketsize", &[10, 10][..]);
    let attributes = f.attributes("constant", &["camera"], &[]);
    f.sphere(granita_base::Vec3::ZERO, 3.0, attributes);
    let floats = [param("int[4] quantize", &[0, 0, 0, 0][..])];
    for (name, format, params) in
        [("shown", "iv", Vec::new()), (file.to_str().unwrap(), "tiff", floats.to_vec())]
    {
        f.scene.outputs.push(Output {
            name: name.into(),
            format: format.into(),
            data: "rgba".into(),
            camera: "cam".into(),
            params: Params(params),
        });
    }
    let (scene, _, mut environment) = finish(&f);
    environment.registry = granita_plugin::bundled_formats(Limits::default());
    environment.registry.register(Arc::new(ViewerFormat(viewer.clone())));
    environment.threads = threads;
    let result = Renderer::new(environment.clone()).render(&scene, None);
    let read = |path: &Path| environment.registry.open(path).map(|i| i.read_level(0, 0).unwrap().to_floats());
    let images = result.as_ref().map(|r| r.images.len()).unwrap_or(0);
    assert!(images <= 1, "what is shown is no file");
    (result.map(|report| report.complete), read(&file).unwrap_or_default(), f.complaints())
}

#[test]
fn a_viewer_receives_the_pixels_of_the_file() {
    let viewer = Arc::new(Viewer::default());
    let (complete, file, complaints) = render(&viewer, 2);
    assert!(complete.unwrap() && complaints.is_empty(), "{complaints:?}");
    let seen = viewer.seen.lock();
    assert!(seen.pixels == file && file.iter().any(|v| *v > 0.0));
    assert_eq!((seen.written.len(), seen.begun.len(), seen.closed), (30, 30, true));
}

#[test]
fn requests_of_a_viewer_change_the_order_and_no_pixel() {
    let plain = render(&Arc::default(), 1).1;
    let asks = vec![
        (2, Request::Center { x: 55, y: 45 }),
        (4, Request::Priority(PixelRect { x0: -9, y0: 25, x1: 5, y1: 35 })),
        (9, Request::Center { x: -1_000_000, y: i32::MIN }),
    ];
    let viewer = Arc::new(Viewer { asks, ..Viewer::default() });
    let (complete, file, _) = render(&viewer, 1);
    assert!(complete.unwrap() && file == plain);
    let seen = viewer.seen.lock();
    assert!(seen.pixels == plain);
    let corners: Vec<[i32; 2]> = seen.written.iter().map(|a| [a.x0, a.y0]).collect();
    // The order is that of the scene, then around the last corner, the rectangle, around the last corner again, and
    // around the first one.
    assert_eq!(corners[2], [50, 40]);
    let mut first: Vec<_> = corners[4..6].to_vec();
    first.sort_unstable();
    assert_eq!(first, [[0, 20], [0, 30]]);
    assert!(corners[6][0] >= 30 && corners[6][1] >= 20, "{corners:?}");
    assert!(corners[9][0] <= 20 && corners[9][1] <= 20, "{corners:?}");
    let all: std::collections::BTreeSet<_> = corners.iter().collect();
    assert_eq!((corners.len(), all.len()), (30, 30));
}

#[test]
fn a_viewer_can_stop_the_frame() {
    let viewer = Arc::new(Viewer { asks: vec![(3, Request::Abort)], ..Viewer::default() });
    let (result, file, _) = render(&viewer, 1);
    assert!(matches!(result, Err(RenderError::Stopped)) && file.is_empty());
    let seen = viewer.seen.lock();
    assert_eq!((seen.written.len(), seen.closed), (3, false));
}

#[test]
fn a_disconnected_viewer_is_a_warning() {
    let plain = render(&Arc::default(), 1).1;
    let viewer = Arc::new(Viewer { fails_after: Some(3), ..Viewer::default() });
    let (complete, file, complaints) = render(&viewer, 2);
    assert!(complete.unwrap() && file == plain);
    assert_eq!(complaints, ["warning: the image is not shown any more: viewer: it is gone"]);
}
