//! The bundled shaders run on grids and on hits, and none of their results is NaN.

use crate::fixture::*;
use granita_base::{Params, Vec3};
use granita_gsl::ir::ShaderKind;
use granita_shade::{Batch, Executor, Grid, IlluminateQuery, Lane3, Lanes3, Topology};
use std::path::Path;

/// Returns the name and source of every bundled shader, in alphabetical order.
pub(crate) fn shaders() -> Vec<(String, String)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shaders");
    let mut list: Vec<_> = std::fs::read_dir(folder)
        .expect("the shaders' folder")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|e| e == "gsl"))
        .map(|path| {
            let name = path.file_stem().expect("a name").to_string_lossy().into_owned();
            (name, std::fs::read_to_string(&path).expect("a text"))
        })
        .collect();
    list.sort();
    list
}

/// Returns a piece of a sphere, seen from outside.
fn sphere(nu: usize, nv: usize) -> Grid {
    let mut grid = square(nu, nv);
    for k in 0..nu * nv {
        let (a, b) = (grid.u[k] * 2.0 - 1.0, grid.v[k] * 2.0 - 1.0);
        let n = Vec3::new(a.sin() * b.cos(), b.sin(), -a.cos() * b.cos());
        grid.p.set(k, n);
        grid.n.set(k, n);
        grid.ng.set(k, n);
        grid.i.set(k, n - Vec3::new(0.0, 0.0, -4.0));
    }
    grid
}

fn finite(lanes: &Lanes3) -> bool {
    lanes.xyz.iter().flatten().all(|x| x.is_finite())
}

#[test]
fn every_bundled_shader_runs() {
    let lights = [
        "light p () { emit (point (0, 0, -2)) { Cl = 4 / dot (L, L); } }",
        "light s () { emit (vector (0, 0, 1), 0) { Cl = 1; } }",
        "light a () { Cl = 0.125; }",
    ];
    let mut executor = Executor::new();
    let list = shaders();
    assert!(list.len() > 20, "{} shaders", list.len());
    for (name, source) in list {
        let mut group = link(&[(&source, Params::new())], &[]);
        let usage = group.usage();
        if usage == ShaderKind::Generic {
            group.attach(ShaderKind::Surface).expect("a generic shader");
        }
        let mut services = Double::with_lights(&lights);
        let mut hits = sphere(3, 5);
        hits.topology = Topology::Triplets { n: 5 };
        for mut grid in [sphere(7, 5), hits] {
            services.grid = Some(grid.clone());
            if usage == ShaderKind::Light {
                let active: Vec<u32> = (0..grid.len() as u32).collect();
                let batch = Batch { lanes: grid.len(), active: &active, layer: 0 };
                let query = IlluminateQuery::new(batch, Lane3::over(&grid.p), Lane3::over(&grid.n));
                let result = executor.run_light(&group, &grid, &query, &mut services);
                assert!(result.samples.iter().all(|s| finite(&s.l) && finite(&s.cl)), "{name}");
                assert_eq!(result.ambient.is_some(), !group.has_emit(), "{name}");
                continue;
            }
            executor.run(&group, &mut grid, &mut services, &[]);
            for lanes in [&grid.p, &grid.n, &grid.c, &grid.opacity] {
                assert!(finite(lanes), "{name}: {lanes:?}");
            }
        }
        let mistakes: Vec<_> = services
            .errors()
            .into_iter()
            .filter(|e| !e.ends_with("is not supported yet"))
            .map(str::to_owned)
            .collect();
        assert_eq!(mistakes, Vec::<String>::new(), "{name}");
    }
}

/// Prints the time per point. This is not a benchmark.
#[test]
#[ignore = "prints times"]
fn the_time_per_point_is_printed() {
    let mut executor = Executor::new();
    for (name, source) in shaders() {
        let group = link(&[(&source, Params::new())], &[]);
        if group.usage() == ShaderKind::Light {
            continue;
        }
        let grid = sphere(16, 16);
        let mut services = Double { grid: Some(grid.clone()), ..Double::default() };
        let start = std::time::Instant::now();
        let runs = 200;
        for _ in 0..runs {
            executor.run(&group, &mut grid.clone(), &mut services, &[]);
        }
        let ns = start.elapsed().as_nanos() as f64 / f64::from(runs * 256);
        println!("{name:20} {ns:8.1} ns per point");
    }
}
