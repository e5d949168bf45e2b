//! Tests that moving micropolygons are seen by the samples whose rays hit them, and by no others.

use super::candidates::{Candidate, Candidates};
use super::hit::{Hit, Raster, Sink};
use super::lanes::LANES;
use super::rays::Polygon;
use super::{SampleGrid, SamplePattern, ShadedGrid, ViewedGrid};
use granita_base::{MotionTransform, Params, Reporter, Vec2, Vec3, hash};
use granita_dicing::{CameraView, PixelRect};
use granita_machine::simd::Portable;
use granita_scene::Camera;
use std::collections::BTreeSet;

/// A sink of any type. The search for hits takes long to compile, so that tests have it once.
struct Any<'a>(&'a mut dyn Sink);

impl Sink for Any<'_> {
    fn hides(&mut self, rect: &PixelRect, z: f32) -> bool {
        self.0.hides(rect, z)
    }

    fn limits(&self) -> Option<&[f32]> {
        self.0.limits()
    }

    fn hit(&mut self, hit: Hit) {
        self.0.hit(hit);
    }
}

/// Finds all hits of a grid on samples.
fn each_hit(samples: &SampleGrid, grid: &ShadedGrid, sink: &mut dyn Sink) {
    let raster = Raster { samples, grid, view: &grid.views[0] };
    raster.each_hit(&mut crate::blurred::Scratch::default(), &mut Any(sink));
}

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
                let p = if case % 3 == 0 { Vec3::new(p.y, p.x, p.z) } else { p };
                // Every fifth case goes far away between the first and the last key, and comes back.
                let away = if case % 5 == 4 && t > 0.0 && t < 1.0 { t } else { 0.0 };
                p + 20.0 * away * Vec3::new(random(7), 0.2 * random(8), random(9))
            };
            let times: &[f32] = if case % 2 == 0 { &[0.0, 1.0] } else { &[0.0, 0.3, 0.37, 1.0] };
            let grid = grid(&camera, times, &at);
            let raster = Raster { samples: &samples, grid: &grid, view: &grid.views[0] };
            let mut found = All::default();
            each_hit(&samples, &grid, &mut found);
            let mut all = All::default();
            let scale = raster.view.scale;
            for (j, i) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let at = j * 3 + i;
                let polygon = Polygon {
                    corners: raster.corners([at, at + 1, at + 4, at + 3]),
                    rim: [j == 0, i == 1, j == 1, i == 0],
                    pixel: Vec2::new(1.0 / scale.x, 1.0 / scale.y),
                };
                let mut candidates = Candidates::default();
                for sample in 0..samples.len() {
                    let (pixel, k) = (sample / samples.per_pixel, sample % samples.per_pixel);
                    let lens = samples.lenses.get(pixel).map(|first| *first as usize + k);
                    let lens = |of: &[f32]| lens.map_or(0.0, |lens| of[lens]);
                    let one = Candidate {
                        x: samples.x[sample],
                        y: samples.y[sample],
                        time: samples.time(sample),
                        lens_x: lens(&samples.tables.lens_x),
                        lens_y: lens(&samples.tables.lens_y),
                    };
                    candidates.push(sample, one);
                }
                for first in (0..candidates.len()).step_by(LANES) {
                    raster.rays(Portable, &polygon, (&candidates, first), &mut |sample, z, u, v, beside| {
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

/// Returns the hits of a grid on the samples of some pixels: raster positions, micropolygons and depths.
fn hits(grid: &ShadedGrid, samples: &SampleGrid) -> BTreeSet<[u32; 4]> {
    let mut found = All::default();
    each_hit(samples, grid, &mut found);
    let place = |s: usize| [samples.x[s].to_bits(), samples.y[s].to_bits()];
    found.0.iter().map(|&(s, at, z)| [place(s)[0], place(s)[1], at, z]).collect()
}

#[test]
fn parts_of_an_image_have_the_hits_of_the_whole() {
    let whole = PixelRect { x0: 0, y0: 0, x1: 64, y1: 48 };
    for (lens, moving) in [(false, false), (false, true), (true, false)] {
        let camera = camera(lens);
        let pattern = SamplePattern::new(&camera, moving);
        let samples_of = |rect: PixelRect| SampleGrid::new(rect, &pattern, &camera, &[whole]);
        let all = samples_of(whole);
        let mut seen = 0;
        for case in 0..60_u32 {
            let random = |k: u32| hash::unit(hash::words(&[case, k])) * 2.0 - 1.0;
            let size = 10.0_f32.powf(1.5 * random(0) - 0.5);
            let at = |u: f32, v: f32, t: f32| {
                let (x, y) = (5.0 * random(1) + size * u, 4.0 * random(2) + size * v);
                Vec3::new(x + t * random(3) + 0.3 * v, y, 6.0 + 2.0 * random(4) + u * random(5))
            };
            let grid = grid(&camera, if moving { &[0.0, 1.0] } else { &[0.0] }, &at);
            assert_eq!(grid.views[0].raster.is_empty(), lens || moving);
            let expected = hits(&grid, &all);
            seen += expected.len();
            let mut found = BTreeSet::new();
            for (x, y) in (0..8).flat_map(|x| (0..6).map(move |y| (8 * x, 8 * y))) {
                found.extend(hits(&grid, &samples_of(PixelRect { x0: x, y0: y, x1: x + 8, y1: y + 8 })));
            }
            assert!(found == expected, "case {case}, lens {lens}, moving {moving}");
        }
        assert!(seen > 3000, "{seen} hits");
    }
}

/// Takes the nearest hit of each sample, and needs no hits behind it.
struct Nearest(Vec<f32>, Vec<Option<[u32; 3]>>);

impl Sink for Nearest {
    fn hides(&mut self, _: &PixelRect, _: f32) -> bool {
        false
    }

    fn limits(&self) -> Option<&[f32]> {
        Some(&self.0)
    }

    fn hit(&mut self, hit: Hit) {
        if hit.beside.is_none() && hit.z < self.0[hit.sample] {
            self.0[hit.sample] = hit.z;
            self.1[hit.sample] = Some([hit.at, hit.u.to_bits(), hit.v.to_bits()]);
        }
    }
}

#[test]
fn hits_that_are_not_needed_change_nothing() {
    let rect = PixelRect { x0: 0, y0: 0, x1: 64, y1: 48 };
    for (lens, moving) in [(false, false), (true, true)] {
        let camera = camera(lens);
        let samples = SampleGrid::new(rect, &SamplePattern::new(&camera, moving), &camera, &[rect]);
        let far = || vec![f32::INFINITY; samples.len() + SampleGrid::PADDING];
        let mut nearest = Nearest(far(), vec![None; samples.len()]);
        let mut expected = nearest.1.clone();
        let mut depths = far();
        for case in 0..40_u32 {
            let random = |k: u32| hash::unit(hash::words(&[case, k])) * 2.0 - 1.0;
            let at = |u: f32, v: f32, t: f32| {
                let (x, y) = (2.0 * random(1) + 3.0 * (u - 0.5), 2.0 * random(2) + 3.0 * (v - 0.5));
                Vec3::new(x + t * random(3), y, 6.0 + 2.0 * random(4) + 3.0 * u * random(5))
            };
            let grid = grid(&camera, if moving { &[0.0, 1.0] } else { &[0.0] }, &at);
            each_hit(&samples, &grid, &mut nearest);
            let mut all = Every::default();
            each_hit(&samples, &grid, &mut all);
            for hit in all.0.iter().filter(|hit| hit.beside.is_none()) {
                if hit.z < depths[hit.sample] {
                    depths[hit.sample] = hit.z;
                    expected[hit.sample] = Some([hit.at, hit.u.to_bits(), hit.v.to_bits()]);
                }
            }
        }
        let same = nearest.1.iter().zip(&expected).filter(|(a, b)| a == b && a.is_some()).count();
        assert!(same > 2000, "{same} samples");
        assert!(nearest.1 == expected, "lens {lens}, moving {moving}");
    }
}

/// Records all hits in order.
#[derive(Default)]
struct Every(Vec<Hit>);

impl Sink for Every {
    fn hides(&mut self, _: &PixelRect, _: f32) -> bool {
        false
    }

    fn limits(&self) -> Option<&[f32]> {
        None
    }

    fn hit(&mut self, hit: Hit) {
        self.0.push(hit);
    }
}
