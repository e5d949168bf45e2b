//! Measures shading: the cost of the executor per point, compared with the same formulas written in Rust over the same
//! lanes, the time of compiling, and the statistics of the noises.

#![allow(clippy::print_stdout, reason = "prints a table")]

use granita_base::{Environment, Param, Params, Reporter, Severity, Supervisor, Transform, Vec3};
use granita_gsl::ir::ValueType;
use granita_gsl::{CompileOptions, ValidModule, compile};
use granita_machine::widest;
use granita_plugin::NativeShaders;
use granita_shade::*;
use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The number of points of each side of a grid.
const SIDE: usize = 16;
const N: usize = SIDE * SIDE;

/// A host without textures, lights and rays. It may have a compiler.
struct Nothing<'a>(Option<&'a dyn NativeCompiler>);

impl Spaces for Nothing<'_> {
    fn to_common(&mut self, _: &str, _: usize) -> Option<Transform> {
        Some(Transform::IDENTITY)
    }

    fn unit_scale(&mut self, _: &str, _: &str) -> Option<f32> {
        Some(1.0)
    }
}

impl Textures for Nothing<'_> {
    fn texture(&mut self, _: &TextureQuery<'_>, _: &mut LookupResult) {}

    fn environment(&mut self, _: &EnvironmentQuery<'_>, _: &mut LookupResult) {}

    fn shadow(&mut self, _: &ShadowQuery<'_>, _: &mut Lanes3) {}

    fn texture_info(&mut self, _: &str, _: &str) -> Option<Param> {
        None
    }
}

impl Lights for Nothing<'_> {
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

impl Rays for Nothing<'_> {}

impl Databases for Nothing<'_> {}

impl Messages for Nothing<'_> {
    fn say(&mut self, _: Severity, text: &str) {
        panic!("{text}");
    }
}

impl Recall for Nothing<'_> {}

impl Host for Nothing<'_> {
    fn attribute(&mut self, _: &str) -> Option<Param> {
        None
    }

    fn native(&mut self) -> Option<&dyn NativeCompiler> {
        self.0
    }
}

fn module(source: &str) -> ValidModule {
    let compiled = compile(source, "bench.gsl", &CompileOptions::default());
    compiled.unwrap_or_else(|list| panic!("{list:#?}")).module
}

fn group(source: &str, optimize: bool) -> Group {
    let params = Params::new();
    let layer = LayerSource { module: module(source), params: &params, name: None };
    Group::link_with(&[layer], &[], LinkOptions { optimize }, &mut |_, text| panic!("{text}"))
        .expect("a group")
}

/// Returns a wavy patch.
fn patch() -> Grid {
    let mut grid = Grid::new(Topology::Rect { nu: SIDE, nv: SIDE });
    for k in 0..N {
        let (u, v) = ((k % SIDE) as f32 / 15.0, (k / SIDE) as f32 / 15.0);
        grid.u[k] = u;
        grid.v[k] = v;
        grid.p.set(k, Vec3::new(u * 2.0, v * 2.0, 0.3 * (4.0 * u).sin()));
        grid.n.set(k, Vec3::new(-0.6 * (4.0 * u).cos(), 0.1 * v, -1.0));
        grid.i.set(k, Vec3::new(u - 0.5, v - 0.5, 3.0));
    }
    grid.ng = grid.n.clone();
    grid
}

/// Returns the nanoseconds per point of the fastest of many runs.
fn per_point(mut f: impl FnMut()) -> f64 {
    let mut best = f64::INFINITY;
    for _ in 0..40 {
        let start = Instant::now();
        for _ in 0..50 {
            f();
        }
        best = best.min(start.elapsed().as_secs_f64());
    }
    best * 1e9 / (50.0 * N as f64)
}

fn shader_cost(source: &str, optimize: bool) -> (f64, Lanes3) {
    cost_with(source, optimize, None)
}

/// True when two results are equal to the bit. Results of functions outside of their domains are NaN.
fn same_bits(a: &Lanes3, b: &Lanes3) -> bool {
    let bits = |lanes: &Lanes3| lanes.xyz.clone().map(|x| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>());
    bits(a) == bits(b)
}

/// Measures a shader, and returns its colours. With a compiler it first runs until its code is compiled.
fn cost_with(source: &str, optimize: bool, native: Option<&NativeShaders>) -> (f64, Lanes3) {
    let group = group(source, optimize);
    let mut executor = Executor::new();
    let mut grid = patch();
    let mut host = Nothing(native.map(|native| native as &dyn NativeCompiler));
    executor.run(&group, &mut grid, &mut host, &[]);
    let colors = grid.c.clone();
    if let Some(native) = native {
        (0..300).for_each(|_| drop(executor.run(&group, &mut grid, &mut host, &[])));
        native.wait(Duration::from_secs(100));
    }
    let cost = per_point(|| {
        black_box(executor.run(&group, black_box(&mut grid), &mut host, &[]));
    });
    assert!(same_bits(&grid.c, &colors), "each run gives the same values");
    (cost, colors)
}

/// A shader with turbulence, a spline through colours, and a highlight.
const PROCEDURAL: &str = "surface procedural (float freq = 2) {
    float turbulence = 0, f = freq;
    for (float k = 0; k < 4; ++k) {
        turbulence += abs ((float) snoise (P * f)) / f;
        f *= 2;
    }
    color base = spline (turbulence * 2, color (0.1, 0.05, 0), color (0.1, 0.05, 0), color (0.5, 0.2, 0.1),
                         color (0.9, 0.7, 0.4), color (1, 1, 0.9), color (1, 1, 0.9));
    vector Nf = faceforward (normalize (N), I, N);
    vector V = -normalize (I);
    vector Ln = normalize (vector (1, 2, -3));
    vector H = normalize (Ln + V);
    float kd = max (0, dot (Nf, Ln));
    float ks = pow (max (0, dot (Nf, H)), 20);
    C = base * (0.1 + 0.9 * kd) + 0.5 * ks;
}";

/// A shader that only does arithmetic.
const ARITHMETIC: &str = "surface arithmetic (float a = 0.25, float b = 3) {
    float x = u * b - a;
    float y = v * b + a;
    float r = x * x + y * y;
    float q = sqrt (r + 1);
    float s = (x * y - r) / q;
    float t = clamp (s * 0.5 + 0.5, 0, 1);
    float w = t * t * (3 - 2 * t);
    float m = min (x, y) + max (q, s) * a;
    float d = mix (m, w, t) - abs (x - y);
    float e = d > 0 ? d * b : -d;
    vector g = vector (x, y, q) * e + P;
    C = color (w, e, length (g)) * (1 / (1 + r)) + m * 0.125;
}";

fn main() {
    // cargo passes "--bench". Any other argument restricts the measurements to those whose names contain it.
    let only: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let wanted = |name: &str| only.is_empty() || only.iter().any(|o| name.contains(o.as_str()));
    if wanted("speed") {
        speed("");
    } else if wanted("arithmetic") {
        speed("arithmetic");
    }
    if wanted("functions") {
        functions();
    }
    if wanted("compile") {
        compiling();
    }
    if wanted("noise") {
        noise_statistics();
    }
}

/// Returns a compiler, whose files are in a folder of its own, where the system has one.
fn compiler(folder: &tempfile::TempDir) -> NativeShaders {
    let mut environment = Environment::empty();
    environment.set("XDG_CACHE_HOME", folder.path().to_string_lossy());
    let print = Reporter::new(Box::new(|message| println!("{message}")));
    NativeShaders::new(&environment, &Supervisor::default(), &print)
}

/// Measures the shaders whose names contain `only`.
fn speed(only: &str) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let native = compiler(&folder);
    println!("{N}-point grids, ns per point      unoptimised  optimised  native   Rust  Rust, wide");
    type ByHand = fn(&Grid, &mut Lanes3);
    let all: [(&str, &str, ByHand, ByHand); 2] = [
        ("procedural", PROCEDURAL, by_hand::procedural, |grid, out| widest!(by_hand::procedural(grid, out))),
        ("arithmetic", ARITHMETIC, by_hand::arithmetic, |grid, out| widest!(by_hand::arithmetic(grid, out))),
    ];
    for (name, source, by_hand, wide) in all.into_iter().filter(|(name, ..)| name.contains(only)) {
        let (plain, _) = shader_cost(source, false);
        let (better, colors) = shader_cost(source, true);
        let (compiled, _) = cost_with(source, true, Some(&native));
        let grid = patch();
        let mut out = Lanes3::zeros(N);
        let [rust, wide] = [by_hand, wide].map(|f| per_point(|| f(black_box(&grid), black_box(&mut out))));
        for k in 0..N {
            let difference = (out.get(k) - colors.get(k)).abs().max_element();
            assert!(difference < 1e-3, "{name} point {k}: {} and {}", out.get(k), colors.get(k));
        }
        println!("{name:<32} {plain:>12.2} {better:>10.2} {compiled:>7.2} {rust:>6.2} {wide:>11.2}");
    }
}

/// Measures shaders that apply one function repeatedly.
fn functions() {
    println!("\nfunction                ns per point and call");
    for call in [
        "sin (x)",
        "cos (x)",
        "tan (x)",
        "asin (x)",
        "acos (x)",
        "atan (x)",
        "atan (x, v)",
        "exp (x)",
        "log (x)",
        "pow (x, v)",
        "tanh (x)",
        "erf (x)",
        "sqrt (x)",
        "floor (x)",
        "mod (x, v)",
        "noise (x)",
        "noise (x, v)",
        "noise (P)",
        "noise (P, x)",
        "cnoise (P)",
        "pnoise (P, point (3, 4, 5))",
        "smoothstep (0, 1, x)",
        "spline (x, 0, 1, 2, 1, 0, 1)",
        "length (P)",
        "length (normalize (N))",
        "luminance ((color) noise (P))",
        "filterwidth (x)",
    ] {
        let cost = |times: usize| {
            let body = format!("y = {call};").repeat(times);
            shader_cost(&format!("surface t () {{ float x = 0.3 + u * 1.5, y = 0; {body} C = y; }}"), false).0
        };
        println!("{call:<32} {:>8.2}", (cost(11) - cost(1)) / 10.0);
    }
}

fn compiling() {
    let mut source =
        String::from("surface lengthy (float a = 1, float b = 2) {\n    float x = u, y = v; color c = 0;\n");
    for k in 0..62 {
        source += &format!(
            "    float f{k} (float q) {{\n        return q * {k} + noise (P * q);\n    }}\n    if (x > {k} / 62) {{\n        \
             y += f{k} (x) * a;\n    }} else {{\n        c += color (x, y, {k}) * smoothstep (0, b, y);\n    }}\n"
        );
    }
    source += "    C = c + x + y;\n}\n";
    let lines = source.lines().count();
    let best = (0..10).map(|_| {
        let start = Instant::now();
        black_box(module(&source));
        start.elapsed().as_secs_f64()
    });
    println!("\ncompiling {lines} lines: {:.2} ms", best.fold(f64::INFINITY, f64::min) * 1e3);
    let best = (0..10).map(|_| {
        let compiled = module(&source);
        let params = Params::new();
        let start = Instant::now();
        let layer = LayerSource { module: compiled, params: &params, name: None };
        black_box(Group::link(&[layer], &[], &mut |_, _| {}).expect("a group"));
        start.elapsed().as_secs_f64()
    });
    println!("linking and optimising it: {:.2} ms", best.fold(f64::INFINITY, f64::min) * 1e3);
}

/// Returns the values of an expression of P at given points.
fn values(expression: &str, points: &[Vec3]) -> Vec<f32> {
    let group = group(&format!("surface t (output float r = 0) {{ r = {expression}; }}"), true);
    let mut executor = Executor::new();
    let mut all = Vec::with_capacity(points.len());
    for chunk in points.chunks(N) {
        let mut grid = Grid::new(Topology::Scattered { n: chunk.len() });
        grid.p = Lanes3::from_points(chunk);
        let wanted = [("r", ValueType::Float)];
        all.extend(
            executor.run(&group, &mut grid, &mut Nothing(None), &wanted).remove(0).expect("an output"),
        );
    }
    all
}

fn noise_statistics() {
    let random = |i: u32, d: u32| granita_base::hash::unit(granita_base::hash::words(&[i, d]));
    let points: Vec<Vec3> =
        (0..200_000).map(|i| Vec3::new(random(i, 0), random(i, 1), random(i, 2)) * 1000.0).collect();
    println!("\nnoise                       mean   deviation       min       max");
    for expression in [
        "noise (P[0])",
        "noise (P[0], P[1])",
        "noise (P)",
        "noise (P, P[0] * 7.3)",
        "snoise (P[0])",
        "snoise (P[0], P[1])",
        "snoise (P)",
        "snoise (P, P[0] * 7.3)",
        "cnoise (P)",
        "pnoise (P, point (7, 8, 9))",
        "psnoise (P, point (7, 8, 9))",
        "random (P)",
    ] {
        let v = values(expression, &points);
        let mean = v.iter().map(|x| f64::from(*x)).sum::<f64>() / v.len() as f64;
        let variance = v.iter().map(|x| (f64::from(*x) - mean).powi(2)).sum::<f64>() / v.len() as f64;
        let (low, high) = v.iter().fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
        println!("{expression:<26} {mean:>7.4} {:>11.4} {low:>9.4} {high:>9.4}", variance.sqrt());
    }
    // Prints the mean square of the change over a short step, along different directions. The values are equal when the
    // noise is isotropic.
    println!("\nsnoise (P): mean square of the change over a step of 0.1, by direction");
    let base = values("snoise (P)", &points);
    for (name, direction) in [
        ("x", Vec3::X),
        ("y", Vec3::Y),
        ("z", Vec3::Z),
        ("x + y", Vec3::new(1.0, 1.0, 0.0)),
        ("x + y + z", Vec3::ONE),
        ("x - 2 y + z", Vec3::new(1.0, -2.0, 1.0)),
    ] {
        let moved: Vec<Vec3> = points.iter().map(|p| *p + direction.normalize() * 0.1).collect();
        let other = values("snoise (P)", &moved);
        let sum: f64 = base.iter().zip(&other).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        println!("{name:<16} {:.5}", sum / base.len() as f64);
    }
    spectrum();
}

/// Prints the power in each octave of frequency along random lines, computed with a plain Fourier transform.
fn spectrum() {
    const M: usize = 512;
    println!("\nsnoise (P) along lines: share of the power by frequency (cycles per unit)");
    let random = |i: u32, d: u32| granita_base::hash::unit(granita_base::hash::words(&[i, d, 5]));
    let mut power = vec![0.0; M / 2];
    for line in 0..24 {
        let origin = Vec3::new(random(line, 0), random(line, 1), random(line, 2)) * 300.0;
        let direction =
            Vec3::new(random(line, 3) - 0.5, random(line, 4) - 0.5, random(line, 5) - 0.5).normalize();
        // The line is 32 units long and has 16 samples per unit.
        let points: Vec<Vec3> = (0..M).map(|i| origin + direction * (i as f32 / 16.0)).collect();
        let v = values("snoise (P)", &points);
        for (k, p) in power.iter_mut().enumerate() {
            let (mut re, mut im) = (0.0, 0.0);
            for (i, x) in v.iter().enumerate() {
                // A window prevents ringing at the ends.
                let window = 0.5 - 0.5 * (std::f64::consts::TAU * i as f64 / M as f64).cos();
                let angle = std::f64::consts::TAU * (k * i) as f64 / M as f64;
                re += f64::from(*x) * window * angle.cos();
                im += f64::from(*x) * window * angle.sin();
            }
            *p += re * re + im * im;
        }
    }
    let total: f64 = power.iter().sum();
    for (low, high) in [(0.0, 0.25), (0.25, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 8.0)] {
        let share: f64 = power
            .iter()
            .enumerate()
            .filter(|(k, _)| (low..high).contains(&(*k as f64 / 32.0)))
            .map(|(_, p)| p)
            .sum();
        println!("{low:>5.2} to {high:<5.2} {:>7.3}", share / total);
    }
}

/// The shaders above, written in Rust for lanes.
mod by_hand {
    use super::{N, Vec3};
    use granita_base::hash::mix32;
    use granita_shade::{Grid, Lanes3};

    fn step(h: u32, i: i32) -> u32 {
        mix32(h ^ i as u32).wrapping_add(0x9e37_79b9)
    }

    fn fade(t: f32) -> f32 {
        t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
    }

    fn lerp(t: f32, a: f32, b: f32) -> f32 {
        a + t * (b - a)
    }

    fn gradient(h: u32, x: f32, y: f32, z: f32) -> f32 {
        let h = mix32(h);
        let sign = |bit: u32, v: f32| if h >> bit & 1 == 0 { v } else { -v };
        match ((h >> 16) * 3) >> 16 {
            0 => sign(1, y) + sign(2, z),
            1 => sign(0, x) + sign(2, z),
            _ => sign(0, x) + sign(1, y),
        }
    }

    fn snoise(p: Vec3) -> f32 {
        let floor = p.floor();
        let t = p - floor;
        let [i, j, k] = [floor.x as i32, floor.y as i32, floor.z as i32];
        let h = step(0x736e_6f69, 3 << 8);
        let (h0, h1) = (step(h, i), step(h, i.wrapping_add(1)));
        let (h00, h01) = (step(h0, j), step(h0, j.wrapping_add(1)));
        let (h10, h11) = (step(h1, j), step(h1, j.wrapping_add(1)));
        let k1 = k.wrapping_add(1);
        let (u, v, w) = (fade(t.x), fade(t.y), fade(t.z));
        let (x, y, z) = (t.x, t.y, t.z);
        let a = lerp(w, gradient(step(h00, k), x, y, z), gradient(step(h00, k1), x, y, z - 1.0));
        let b = lerp(w, gradient(step(h01, k), x, y - 1.0, z), gradient(step(h01, k1), x, y - 1.0, z - 1.0));
        let c = lerp(w, gradient(step(h10, k), x - 1.0, y, z), gradient(step(h10, k1), x - 1.0, y, z - 1.0));
        let d = lerp(
            w,
            gradient(step(h11, k), x - 1.0, y - 1.0, z),
            gradient(step(h11, k1), x - 1.0, y - 1.0, z - 1.0),
        );
        lerp(u, lerp(v, a, b), lerp(v, c, d)) / 1.036_354
    }

    fn spline(x: f32, knots: &[Vec3]) -> Vec3 {
        let segments = knots.len() - 3;
        let s = x.clamp(0.0, 1.0) * segments as f32;
        let k = (s as usize).min(segments - 1);
        let t = s - k as f32;
        let [a, b, c, d] = [knots[k], knots[k + 1], knots[k + 2], knots[k + 3]];
        let cubic = 0.5 * (d - a) + 1.5 * (b - c);
        let square = a - 2.5 * b + 2.0 * c - 0.5 * d;
        ((cubic * t + square) * t + 0.5 * (c - a)) * t + b
    }

    #[inline(always)]
    pub(super) fn procedural(grid: &Grid, out: &mut Lanes3) {
        let knots = [
            Vec3::new(0.1, 0.05, 0.0),
            Vec3::new(0.1, 0.05, 0.0),
            Vec3::new(0.5, 0.2, 0.1),
            Vec3::new(0.9, 0.7, 0.4),
            Vec3::new(1.0, 1.0, 0.9),
            Vec3::new(1.0, 1.0, 0.9),
        ];
        let light = Vec3::new(1.0, 2.0, -3.0).normalize();
        for k in 0..N {
            let (p, n, i) = (grid.p.get(k), grid.n.get(k), grid.i.get(k));
            let (mut turbulence, mut f) = (0.0, 2.0);
            for _ in 0..4 {
                turbulence += snoise(p * f).abs() / f;
                f *= 2.0;
            }
            let base = spline(turbulence * 2.0, &knots);
            let unit = n.normalize();
            let nf = if i.dot(n) > 0.0 { -unit } else { unit };
            let h = (light - i.normalize()).normalize();
            let kd = nf.dot(light).max(0.0);
            let ks = nf.dot(h).max(0.0).powf(20.0);
            out.set(k, base * (0.1 + 0.9 * kd) + 0.5 * ks);
        }
    }

    #[inline(always)]
    pub(super) fn arithmetic(grid: &Grid, out: &mut Lanes3) {
        let (a, b) = (0.25_f32, 3.0_f32);
        let [red, green, blue] = &mut out.xyz;
        let (red, green, blue) = (&mut red[..N], &mut green[..N], &mut blue[..N]);
        let [px, py, pz] = [&grid.p.xyz[0][..N], &grid.p.xyz[1][..N], &grid.p.xyz[2][..N]];
        let (u, v) = (&grid.u[..N], &grid.v[..N]);
        for k in 0..N {
            let x = u[k] * b - a;
            let y = v[k] * b + a;
            let r = x * x + y * y;
            let q = (r + 1.0).sqrt();
            let s = (x * y - r) / q;
            let t = (s * 0.5 + 0.5).clamp(0.0, 1.0);
            let w = t * t * (3.0 - 2.0 * t);
            let m = x.min(y) + q.max(s) * a;
            let d = m * (1.0 - t) + w * t - (x - y).abs();
            let e = if d > 0.0 { d * b } else { -d };
            let (gx, gy, gz) = (x * e + px[k], y * e + py[k], q * e + pz[k]);
            let scale = 1.0 / (1.0 + r);
            red[k] = w * scale + m * 0.125;
            green[k] = e * scale + m * 0.125;
            blue[k] = (gx * gx + gy * gy + gz * gz).sqrt() * scale + m * 0.125;
        }
    }
}
