//! Tests that moving micropolygons are seen by the samples whose rays hit them, and by no others.

use super::hit::{Hit, Raster, Sink};
use super::lanes::LANES;
use super::rays::Polygon;
use super::streaks::Candidate;
use super::{SampleGrid, SamplePattern, ShadedGrid, ViewedGrid};
use granita_base::{MotionTransform, Params, Reporter, Vec2, Vec3, hash};
use granita_dicing::{CameraView, PixelRect};
use granita_machine::simd::Portable;
use granita_scene::Camera;
use std::collections::BTreeSet;

/// Records all hits.
#[derive(Default)]
struct All(BTreeSet<(usize, u32, u32)>);

impl Sink for All {
    fn hides(&mut self, _: &PixelRect, _: f32) -> bool {
        false
    }

    fn limits(&self) -> Option<&[f32]> {
        None
    }

    fn hit(&mut self, hit: Hit) {
        let new = self.0.insert((hit.sample, hit.at, hit.z.to_bits()));
        assert!(new, "{hit:?} comes twice");
    }
}

fn param(declaration: &str, data: impl Into<granita_base::ParamData>) -> granita_base::Param {
    granita_base::Param::declared(declaration, data).unwrap()
}

pub(crate) fn camera(lens: bool) -> CameraView {
    let mut params = Params::new();
    params.set(param("string projection", "perspective"));
    let mut set = |name: &str, values: &[f32]| params.set(param(name, values));
    set("int[2] resolution", &[32.0, 24.0]);
    set("int[2] spatialquality", &[3.0, 3.0]);
    set("float fov", &[60.0]);
    set("float near", &[1e-3]);
    set("float[2] shutter", &[0.0, 1.0]);
    if lens {
        set("float fstop", &[2.0]);
        set("float focallength", &[0.3]);
        set("float focaldistance", &[5.0]);
    }
    let seen = Camera { name: "main".into(), world_to_camera: MotionTransform::default(), params };
    CameraView::new(&seen, &Reporter::silent())
}

/// Returns a grid of 3 x 3 points that moves by the function `at`.
fn grid(camera: &CameraView, times: &[f32], at: &dyn Fn(f32, f32, f32) -> Vec3) -> ShadedGrid {
    let key = |t: &f32| (0..9).map(|i| at((i % 3) as f32 * 0.5, (i / 3) as f32 * 0.5, *t)).collect();
    let p_cam: Vec<Vec<Vec3>> = times.iter().map(key).collect();
    let view = ViewedGrid { rim_px: 0.02, ..ViewedGrid::new(camera, 3, times.to_vec(), p_cam, true) };
    ShadedGrid { opaque: true, ..ShadedGrid::new(3, 3, view) }
}

#[test]
fn the_bounds_of_moving_grids_miss_no_hit() {
    for lens in [false, true] {
        let camera = camera(lens);
        let pattern = SamplePattern::new(&camera, true);
        let rect = PixelRect { x0: 0, y0: 0, x1: 64, y1: 48 };
        let samples = SampleGrid::new(rect, &pattern, &camera, &[rect]);
        let mut seen = 0;
        for case in 0..150_u32 {
            let random = |k: u32| hash::unit(hash::words(&[case, k])) * 2.0 - 1.0;
            let size = 10.0_f32.powf(2.0 * random(0) - 0.5);
            let aspect = 10.0_f32.powf(2.0 * random(1));
            let (x, z, speed) = (3.0 * random(2), 4.0 + 8.0 * random(3), 12.0 * random(4));
            let (angle, turn) = (3.0 * random(5), 2.0 * random(6));
            let at = |u: f32, v: f32, t: f32| {
                // The grid is ground under the eye that turns and passes by. Every third case is a wall.
                let (a, b) = (x + size * u, z + size * aspect * v - speed * t);
                let (sin, cos) = (angle + turn * t).sin_cos();
                let p = Vec3::new(cos * a - sin * b, -1.0, sin * a + cos * b);
                if case % 3 == 0 { Vec3::new(p.y, p.x, p.z) } else { p }
            };
            let times: &[f32] = if case % 2 == 0 { &[0.0, 1.0] } else { &[0.0, 0.3, 0.37, 1.0] };
            let grid = grid(&camera, times, &at);
            let raster = Raster { samples: &samples, grid: &grid, view: &grid.views[0] };
            let mut found = All::default();
            raster.each_hit(&mut found);
            let mut all = All::default();
            let scale = raster.view.scale;
            for (j, i) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let at = j * 3 + i;
                let polygon = Polygon {
                    corners: [at, at + 1, at + 4, at + 3],
                    rim: [j == 0, i == 1, j == 1, i == 0],
                    pixel: Vec2::new(1.0 / scale.x, 1.0 / scale.y),
                };
                for sample in 0..samples.len() {
                    let (pixel, k) = (sample / samples.per_pixel, (sample % samples.per_pixel) as u32);
                    let one = Candidate {
                        sample: sample as u32,
                        time: samples.times[pixel] + k,
                        lens: samples.lenses.get(pixel).map_or(0, |lens| lens + k),
                    };
                    raster.rays(Portable, &polygon, &[one; LANES], 1, &mut |sample, z, u, v, beside| {
                        all.hit(Hit { sample, z, at: at as u32, u, v, rim: true, beside });
                    });
                }
            }
            seen += all.0.len();
            assert_eq!(found.0, all.0, "case {case}, lens {lens}");
        }
        assert!(seen > 10_000, "{seen} hits");
    }
}
