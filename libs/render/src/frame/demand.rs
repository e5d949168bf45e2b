//! A depth map that is rendered tile by tile, when somebody looks at it (reference 10.1.5).
//!
//! A tile is what the buckets of a frame of the same camera would be: which tiles are asked for, in which order and how
//! often, changes none of them. Primitives are built when the first tile is asked for; grids are kept until all tiles that
//! they touch were made, and made again when a tile is asked for once more.

use super::{Frame, FrameOptions, FrameShader, Jobs};
use crate::bucket::BucketOrder;
use crate::output::plan::OutputSet;
use crate::{CameraView, PixelRect};
use granita_base::Reporter;
use granita_scene::Scene;
use std::sync::OnceLock;
use std::sync::atomic::AtomicBool;

/// One map.
pub(crate) struct OnDemand<O> {
    camera: CameraView,
    /// The first image is the map.
    outputs: OutputSet,
    jobs: OnceLock<Jobs<O>>,
    tile: u32,
    never: AtomicBool,
}

/// What all maps of a frame are rendered with.
pub(crate) struct Surroundings<'a, S: FrameShader> {
    pub(crate) scene: &'a Scene,
    pub(crate) shader: &'a S,
    /// The first camera: splits, dicing and shading are as it sees them.
    pub(crate) dicing_camera: &'a CameraView,
    pub(crate) threads: usize,
    pub(crate) reporter: &'a Reporter,
}

impl<O: Send + Sync> OnDemand<O> {
    /// The whole image of a camera in tiles of this size.
    pub(crate) fn new(camera: &CameraView, outputs: OutputSet, tile: u32) -> Self {
        Self {
            camera: camera.uncropped(),
            outputs,
            jobs: OnceLock::new(),
            tile,
            never: AtomicBool::new(false),
        }
    }

    /// The camera, which sees its whole image.
    pub(crate) fn camera(&self) -> &CameraView {
        &self.camera
    }

    /// The pixels of a tile, row by row; `outside` where the image ends.
    pub(crate) fn tile<S: FrameShader<Object = O>>(
        &self,
        around: &Surroundings<'_, S>,
        (tx, ty): (u32, u32),
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
        // Many samples may make buckets smaller than a tile.
        for bucket in frame.buckets.touching(&rect) {
            let index = bucket as usize;
            let part = frame.buckets.order[index];
            let pixels = frame.bucket(jobs, index, thread);
            let Some(pixels) = pixels.first() else { continue };
            for (row, values) in pixels.chunks(part.width()).enumerate() {
                let at = ((part.y0 - y0) as usize + row) * n + (part.x0 - x0) as usize;
                tile[at..at + values.len()].copy_from_slice(values);
            }
        }
        tile
    }
}
