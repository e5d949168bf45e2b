//! Grids are shaded without allocation after the first ones.

#![allow(unsafe_code, reason = "an allocator that counts")]

use granita_base::{Param, Params, Severity, Transform, Vec3};
use granita_gsl::{CompileOptions, compile};
use granita_shade::*;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;

thread_local! {
    /// The number of allocations of this thread. The test runner has other threads.
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

/// The system's allocator, which counts the allocations.
struct Counting;

// SAFETY: all calls are forwarded unchanged to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = COUNT.try_with(|c| c.set(c.get() + 1));
        // SAFETY: the caller guarantees the same conditions.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller guarantees the same conditions.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        let _ = COUNT.try_with(|c| c.set(c.get() + 1));
        // SAFETY: the caller guarantees the same conditions.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

struct Nothing;

impl Spaces for Nothing {
    fn to_common(&mut self, _: &str, _: usize) -> Option<Transform> {
        Some(Transform::IDENTITY)
    }

    fn unit_scale(&mut self, _: &str, _: &str) -> Option<f32> {
        Some(1.0)
    }
}

impl Textures for Nothing {
    fn texture(&mut self, _: &TextureQuery<'_>, _: &mut LookupResult) {}

    fn environment(&mut self, _: &EnvironmentQuery<'_>, _: &mut LookupResult) {}

    fn shadow(&mut self, _: &ShadowQuery<'_>, _: &mut Lanes3) {}

    fn texture_info(&mut self, _: &str, _: &str) -> Option<Param> {
        None
    }
}

impl Lights for Nothing {
    fn light_count(&mut self) -> usize {
        0
    }

    fn light_info(&mut self, _: usize) -> LightInfo {
        LightInfo::default()
    }

    fn illuminate(&mut self, _: usize, _: &IlluminateQuery<'_>) -> Arc<LightResult> {
        Arc::default()
    }
}

impl Rays for Nothing {}

impl Databases for Nothing {}

impl Messages for Nothing {
    fn say(&mut self, _: Severity, text: &str) {
        panic!("{text}");
    }
}

impl Recall for Nothing {}

impl Host for Nothing {
    fn attribute(&mut self, _: &str) -> Option<Param> {
        None
    }
}

const SOURCE: &str =
    "surface t (float freq = 3, color tint = color (1, 0.5, 0.2), float list[4] = { 1, 2, 3, 4 }) {
    float sum = 0, f = freq;
    float twice (float x) { if (x > 2) return 0; return x * 2; }
    for (float k = 0; k < 5; ++k) {
        if (k > 3 + u) break;
        if (snoise (P * f) > 0.2) { sum += (float) noise (P * f) / f; continue; }
        sum -= list[mod (k, 4)] * twice (cnoise (P));
        f *= 2;
    }
    vector Nf = faceforward (normalize (N), I);
    point q = transform (\"shader\", P);
    q[1] = sum;
    color c = spline (sum, color (0), tint, tint * 2, color (1), color (0.5));
    float e = aastep (0.5, u + sum) + filterwidth (q) + length (deltau (P));
    C = c * pow (max (0, dot (Nf, normalize (vector (1, 2, 3)))), 4) + (float) random () * e;
    opacity = mix (color (1), C, smoothstep (0, 1, sin (sum) + exp (-u)));
    N = normalize (N + 0.1 * q);
}";

#[test]
fn shading_a_grid_does_not_allocate() {
    let module = compile(SOURCE, "t.gsl", &CompileOptions::default()).unwrap().module;
    let params = Params::new();
    for optimize in [false, true] {
        let layer = LayerSource { module: module.clone(), params: &params, name: None };
        let group = Group::link_with(&[layer], &[], LinkOptions { optimize }, &mut |_, _| {}).unwrap();
        let grids: Vec<Grid> = (0..6).map(grid).collect();
        let mut executor = Executor::new();
        for round in 0..6 {
            for mut grid in grids.clone() {
                let before = COUNT.with(Cell::get);
                executor.run(&group, &mut grid, &mut Nothing, &[]);
                let made = COUNT.with(Cell::get) - before;
                assert!(
                    round < 3 || made == 0,
                    "{made} allocations in round {round} (optimised: {optimize})"
                );
            }
        }
    }
}

/// Returns a wavy patch, which differs for each number and has one size.
fn grid(number: u32) -> Grid {
    let mut grid = Grid::new(Topology::Rect { nu: 16, nv: 16 });
    for k in 0..256 {
        let (u, v) = ((k % 16) as f32 / 15.0, (k / 16) as f32 / 15.0);
        grid.u[k] = u;
        grid.v[k] = v;
        grid.p.set(k, Vec3::new(u * 2.0 + number as f32, v * 2.0, 0.3 * (4.0 * u).sin()));
        grid.n.set(k, Vec3::new(-0.6 * (4.0 * u).cos(), 0.1 * v, -1.0));
        grid.i.set(k, Vec3::new(u - 0.5, v - 0.5, 3.0));
    }
    grid.ng = grid.n.clone();
    grid
}
