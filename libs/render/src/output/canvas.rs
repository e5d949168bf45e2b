//! The pixels of one image while a frame is rendered.
//!
//! A small image is kept until the frame is done. For a large image only the rows that have started and are not
//! finished are kept. They are written as soon as all rows above them are. That bounds memory when buckets are
//! rendered in rows from the top, as they are for large images, whatever "bucketorder" is. An image that is shown
//! while it is rendered is not kept. Its buckets go to the viewer as they arrive. Images that are denoised are kept
//! whatever they are, because that needs all pixels.

use crate::bucket::Buckets;
use crate::output::partial::{Partial, PartialPixels, RowCopies};
use crate::output::plan::OutputImage;
use crate::output::writer::ImageWriter;
use crate::{CameraView, PixelRect};
use granita_base::Files;
use granita_image::{FormatRegistry, Request};
use std::io;
use std::path::Path;

/// Images with more bytes are written while they are rendered.
const LARGE_BYTES: usize = 1 << 28;

/// The pixels of one image. The module describes how they are kept.
pub(crate) struct Canvas {
    crop: PixelRect,
    channels: usize,
    /// The number of pixels that were rendered.
    rendered: usize,
    state: State,
}

enum State {
    /// The pixels of the crop window, with interleaved channels.
    Kept(Vec<f32>),
    Written(Bands),
    Shown(Viewer),
}

/// The viewer of an image that is shown while it is rendered.
struct Viewer {
    /// The file; `None` after it failed.
    file: Option<ImageWriter>,
    /// The error, until it is reported.
    trouble: Option<String>,
    /// The pixels of the crop window, of an image that is denoised at the end; else empty.
    pixels: Vec<f32>,
}

/// Rows of buckets.
struct Bands {
    /// The first pixel row of each band, and the end.
    rows: Vec<i32>,
    bands: Vec<Band>,
    /// The first band that is not written.
    next: usize,
    file: Result<ImageWriter, String>,
    /// The copies of the written bands; `None` when no partial image is requested.
    copies: Option<io::Result<RowCopies>>,
}

struct Band {
    /// The pixels; empty before its first bucket and after it was written.
    pixels: Vec<f32>,
    /// The number of buckets that have not arrived.
    missing: usize,
}

/// The result of an image.
pub(crate) enum Finished {
    /// Its pixels, which must be written.
    Kept(Vec<f32>),
    /// It was written, or the reason why it was not.
    Written(Result<(), String>),
    /// It was shown completely, if there is a viewer left. The pixels are there if the image is denoised.
    Shown(Option<ImageWriter>, Vec<f32>),
}

impl Canvas {
    /// True when an image of `camera` is written while it is rendered and therefore needs its buckets from the top.
    pub(crate) fn is_large(image: &OutputImage, camera: &CameraView) -> bool {
        !image.is_shown && !image.is_denoised && Self::bytes(image, camera) > LARGE_BYTES
    }

    fn bytes(image: &OutputImage, camera: &CameraView) -> usize {
        let pixels = camera.crop.width().saturating_mul(camera.crop.height());
        pixels.saturating_mul(image.channels() * size_of::<f32>())
    }

    /// Makes a canvas for an image of `camera`. The file of a large image is opened at once. Without `registry`, all
    /// images are kept.
    pub(crate) fn new(
        image: &OutputImage,
        camera: &CameraView,
        buckets: &Buckets,
        registry: Option<&FormatRegistry>,
    ) -> Self {
        Self::with_limit(image, camera, buckets, registry, LARGE_BYTES)
    }

    fn with_limit(
        image: &OutputImage,
        camera: &CameraView,
        buckets: &Buckets,
        registry: Option<&FormatRegistry>,
        large_bytes: usize,
    ) -> Self {
        let (crop, channels) = (camera.crop, image.channels());
        let values = crop.width() * crop.height() * channels;
        if let Some(registry) = registry.filter(|_| image.is_shown) {
            let (file, trouble) = match image.open(camera, registry) {
                Ok(file) => (Some(file), None),
                Err(error) => (None, Some(error.to_string())),
            };
            let pixels = if image.is_denoised { vec![0.0; values] } else { Vec::new() };
            let viewer = Viewer { file, trouble, pixels };
            return Self { crop, channels, rendered: 0, state: State::Shown(viewer) };
        }
        let is_large = !image.is_denoised && Self::bytes(image, camera) > large_bytes;
        let state = match registry.filter(|_| is_large) {
            None => State::Kept(vec![0.0; values]),
            Some(registry) => {
                let (rows, columns) = buckets.rows();
                let band = |_| Band { pixels: Vec::new(), missing: columns };
                State::Written(Bands {
                    rows: rows.to_vec(),
                    bands: (1..rows.len()).map(band).collect(),
                    next: 0,
                    file: image.open(camera, registry).map_err(|e| e.to_string()),
                    copies: None,
                })
            }
        };
        Self { crop, channels, rendered: 0, state }
    }

    /// Makes a canvas for an image of passes. It is kept until the frame is done, however large it is.
    pub(crate) fn of_passes(
        image: &OutputImage,
        camera: &CameraView,
        buckets: &Buckets,
        registry: Option<&FormatRegistry>,
    ) -> Self {
        Self::with_limit(image, camera, buckets, registry, usize::MAX)
    }

    /// True when a viewer shows the image.
    pub(crate) fn is_shown(&self) -> bool {
        matches!(self.state, State::Shown(_))
    }

    /// Prepares a canvas for [`Canvas::into_partial`]. The rows of a large image are copied to a temporary file.
    pub(crate) fn copying(mut self, files: &Files, path: &Path) -> Self {
        if let State::Written(bands) = &mut self.state {
            bands.copies = Some(RowCopies::new(files, path));
        }
        self
    }

    /// Stores the filtered pixels of a bucket.
    pub(crate) fn store(&mut self, bucket: &PixelRect, values: &[f32]) {
        self.rendered += bucket.width() * bucket.height();
        let n = self.channels;
        let (width, row) = (self.crop.width() * n, bucket.width() * n);
        let column = (bucket.x0 - self.crop.x0) as usize * n;
        let (pixels, top) = match &mut self.state {
            State::Shown(viewer) => {
                if let Some(file) = &mut viewer.file
                    && let Err(error) = file.write_rectangle(bucket, values)
                {
                    (viewer.file, viewer.trouble) = (None, Some(error.to_string()));
                }
                if viewer.pixels.is_empty() {
                    return;
                }
                (&mut viewer.pixels, self.crop.y0)
            }
            State::Kept(pixels) => (pixels, self.crop.y0),
            State::Written(bands) => {
                let k = bands.rows.partition_point(|y| *y <= bucket.y0).saturating_sub(1);
                let (top, height) = (bands.rows[k], bands.height(k));
                let band = &mut bands.bands[k];
                band.pixels.resize(width * height, 0.0);
                band.missing -= 1;
                (&mut band.pixels, top)
            }
        };
        for (j, line) in values.chunks_exact(row).enumerate() {
            let at = ((bucket.y0 - top) as usize + j) * width + column;
            pixels[at..at + row].copy_from_slice(line);
        }
        if let State::Written(bands) = &mut self.state {
            while bands.bands.get(bands.next).is_some_and(|band| band.missing == 0) {
                bands.write(width);
            }
        }
    }

    /// Reports to the viewer that a bucket is started.
    pub(crate) fn begin(&mut self, bucket: &PixelRect) {
        if let State::Shown(Viewer { file: Some(file), .. }) = &mut self.state {
            file.begin(bucket);
        }
    }

    /// Returns the requests of the viewer of the image.
    pub(crate) fn requests(&mut self) -> Vec<Request> {
        match &mut self.state {
            State::Shown(Viewer { file: Some(file), .. }) => file.requests(),
            _ => Vec::new(),
        }
    }

    /// Returns once the reason why the image is not shown any more.
    pub(crate) fn trouble(&mut self) -> Option<String> {
        match &mut self.state {
            State::Shown(viewer) => viewer.trouble.take(),
            _ => None,
        }
    }

    /// Removes all pixels before all buckets are rendered again. It has no effect on images that are written or shown
    /// meanwhile.
    pub(crate) fn restart(&mut self) {
        self.rendered = 0;
        if let State::Kept(pixels) = &mut self.state {
            pixels.fill(0.0);
        }
    }

    /// True when all pixels were rendered.
    pub(crate) fn is_whole(&self) -> bool {
        self.rendered == self.crop.width() * self.crop.height()
    }

    /// Ends the image of a frame that was stopped. Missing buckets are black. Of a large image, only the canvas of
    /// [`Canvas::copying`] has the pixels.
    pub(crate) fn into_partial(self) -> Partial {
        let total = self.crop.width() * self.crop.height();
        let pixels = match self.state {
            State::Kept(pixels) => PartialPixels::Kept(pixels),
            State::Shown(_) => PartialPixels::Shown,
            State::Written(mut bands) => {
                // The file of the whole image is dropped, so that it does not appear.
                bands.file = Err(String::new());
                while bands.next < bands.bands.len() {
                    bands.write(self.crop.width() * self.channels);
                }
                let none = || Err(io::Error::other("its rows were not copied"));
                PartialPixels::Copied(bands.copies.unwrap_or_else(none))
            }
        };
        Partial { rendered: self.rendered, total, pixels }
    }

    /// Ends the image after the last bucket. Missing buckets are black.
    pub(crate) fn finish(self) -> Finished {
        match self.state {
            State::Kept(pixels) => Finished::Kept(pixels),
            State::Shown(viewer) => Finished::Shown(viewer.file, viewer.pixels),
            State::Written(mut bands) => {
                while bands.next < bands.bands.len() {
                    bands.write(self.crop.width() * self.channels);
                }
                Finished::Written(bands.file.and_then(|file| file.close().map_err(|e| e.to_string())))
            }
        }
    }
}

impl Bands {
    fn height(&self, k: usize) -> usize {
        (self.rows[k + 1] - self.rows[k]) as usize
    }

    /// Writes the next band. After the first failure nothing more is written.
    fn write(&mut self, width: usize) {
        let height = self.height(self.next);
        let mut pixels = std::mem::take(&mut self.bands[self.next].pixels);
        pixels.resize(width * height, 0.0);
        self.next += 1;
        if let Some(Ok(copies)) = &mut self.copies
            && let Err(error) = copies.write(&pixels)
        {
            self.copies = Some(Err(error));
        }
        if let Ok(file) = &mut self.file
            && let Err(error) = file.write(&pixels)
        {
            self.file = Err(error.to_string());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bucket::BucketOrder;
    use crate::output::plan::OutputSet;
    use granita_base::{Param, Params, Reporter};
    use granita_image::Limits;

    /// Returns the values of a file of an image without one of its buckets. `finish` writes it from the canvas, and
    /// returns its name.
    fn written(
        order: &str,
        limit: usize,
        folder: &Path,
        finish: impl Fn(Canvas, &mut OutputImage, &CameraView, &FormatRegistry) -> std::path::PathBuf,
    ) -> Vec<f32> {
        let registry = granita_plugin::bundled_formats(Limits::default());
        let camera = granita_scene::Camera {
            name: "main".into(),
            world_to_camera: Default::default(),
            params: Params(vec![
                Param::declared("int[2] resolution", &[50, 41][..]).unwrap(),
                Param::declared("float[4] crop", &[0.1_f32, 1.0, 0.2, 1.0][..]).unwrap(),
            ]),
        };
        let camera = CameraView::new(&camera, &Reporter::silent());
        let buckets = Buckets::new(&camera.crop, [16, 7], BucketOrder { word: order, block: 2 }, 16);
        let output = granita_scene::Output {
            name: folder.join(format!("{order}{limit}.tif")).to_str().unwrap().into(),
            format: "tiff".into(),
            data: "rgba".into(),
            camera: "main".into(),
            params: Params::new(),
        };
        let mut set = OutputSet::new(&[&output], &camera, &registry, &Reporter::silent()).unwrap();
        let image = &mut set.images[0];
        let mut canvas = Canvas::with_limit(image, &camera, &buckets, Some(&registry), limit)
            .copying(registry.files(), &image.path);
        for (k, bucket) in buckets.order.iter().enumerate() {
            // One bucket is missing.
            if k == 3 {
                continue;
            }
            let value = |i: usize| ((bucket.x0 * 7 + bucket.y0 * 3) as usize + i) as f32 % 97.0 / 97.0;
            let values: Vec<f32> = (0..bucket.width() * bucket.height() * 4).map(value).collect();
            canvas.store(bucket, &values);
        }
        assert!(!canvas.is_whole());
        let path = finish(canvas, image, &camera, &registry);
        registry.open(&path).unwrap().read_level(0, 0).unwrap().to_floats()
    }

    #[test]
    fn images_written_by_rows_equal_those_written_at_once() {
        let folder = tempfile::tempdir().unwrap();
        for order in ["horizontal", "vertical", "spiral"] {
            let whole = [usize::MAX, 0].map(|limit| {
                written(order, limit, folder.path(), |canvas, image, camera, registry| {
                    match canvas.finish() {
                        Finished::Written(done) => done.unwrap(),
                        Finished::Shown(..) => panic!("a TIFF file is no viewer"),
                        Finished::Kept(pixels) => {
                            image.pixels = pixels;
                            image.write(camera, registry).unwrap();
                        }
                    }
                    image.path.clone()
                })
            });
            let partial = [usize::MAX, 0].map(|limit| {
                written(order, limit, folder.path(), |canvas, image, camera, registry| {
                    let partial = canvas.into_partial();
                    assert!(partial.percent() > 50, "{}", partial.percent());
                    partial.write(image, camera, registry).unwrap().unwrap()
                })
            });
            assert!(whole[0] == whole[1], "{order}");
            assert!(partial[0] == whole[0] && partial[1] == whole[0], "{order}");
        }
        let mut names: Vec<String> = std::fs::read_dir(folder.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        assert_eq!(names.len(), 12, "{names:?}");
        assert!(names.iter().filter(|name| name.contains(".partial.tif")).count() == 6, "{names:?}");
    }
}
