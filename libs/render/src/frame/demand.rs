//! A depth map that is rendered tile by tile, on demand (reference 10.1.5).
//!
//! A tile equals the buckets of a frame of the same camera. The choice, order and number of the requested tiles
//! changes none of them. Primitives are built for the first requested tile. Grids are kept until all tiles that
//! they touch were made, and are made again when a tile is requested again.

use super::{Frame, FrameOptions, FrameShader, Jobs};
use crate::bucket::BucketOrder;
use crate::output::plan::OutputSet;
use crate::{CameraView, PixelRect};
use granita_base::Reporter;
use granita_scene::Scene;
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

/// A depth map of one camera.
pub(crate) struct OnDemand<O> {
    camera: CameraView,
    /// The outputs, whose first image is the map.
    outputs: OutputSet,
    jobs: OnceLock<Jobs<O>>,
    tile: u32,
    never: AtomicBool,
}

/// The options that all maps of a frame share.
pub(crate) struct Surroundings<'a, S: FrameShader> {
    pub(crate) scene: &'a Scene,
    pub(crate) shader: &'a S,
    /// The first camera, which determines splitting, dicing and shading.
    pub(crate) dicing_camera: &'a CameraView,
    pub(crate) threads: usize,
    pub(crate) reporter: &'a Reporter,
}

impl<O: Send + Sync> OnDemand<O> {
    /// Returns a map of the whole image of a camera in tiles of this size in pixels.
    pub(crate) fn new(camera: &CameraView, outputs: OutputSet, tile: u32) -> Self {
        Self {
            camera: camera.uncropped(),
            outputs,
            jobs: OnceLock::new(),
            tile,
            never: AtomicBool::new(false),
        }
    }

    /// Returns the camera, which sees its whole image.
    pub(crate) fn camera(&self) -> &CameraView {
        &self.camera
    }

    /// Returns the pixels of a tile, row by row. Pixels beyond the image are `outside`.
    pub(crate) fn tile<S: FrameShader<Object = O>>(
        &self,
        around: &Surroundings<'_, S>,
        [tx, ty]: [u32; 2],
        outside: f32,
    ) -> Vec<f32> {
        let options = FrameOptions {
            dicing_camera: around.dicing_camera,
            threads: around.threads,
            ..FrameOptions::new(&self.camera, around.reporter, &self.never)
        };
        let size = ([self.tile; 2], BucketOrder::plain("horizontal"));
        let frame =
            Frame { again: true, ..Frame::new(around.scene, around.shader, options, &self.outputs, size) };
        let jobs = self.jobs.get_or_init(|| frame.jobs(around.scene, around.threads));
        let thread = &mut frame.thread();
        let n = self.tile as usize;
        let side = self.tile as i32;
        let (x0, y0) = (tx as i32 * side, ty as i32 * side);
        let rect = PixelRect { x0, x1: x0 + side, y0, y1: y0 + side }.intersection(&self.camera.crop);
        let mut tile = vec![outside; n * n];
        // With many samples, buckets may be smaller than a tile.
        for bucket in frame.buckets.touching(&rect) {
            let index = bucket as usize;
            let part = frame.buckets.order[index];
            let pixels = frame.bucket(jobs, &frame.whole(index), thread);
            let Some(pixels) = pixels.first() else { continue };
            for (row, values) in pixels.chunks(part.width()).enumerate() {
                let at = ((part.y0 - y0) as usize + row) * n + (part.x0 - x0) as usize;
                tile[at..at + values.len()].copy_from_slice(values);
            }
        }
        tile
    }
}
