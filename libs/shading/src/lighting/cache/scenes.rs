//! Tests indirect light and occlusion over scenes with closed forms.

use crate::fixture::{Finish as _, Fixture, flat_grid, param};
use crate::{ShaderThread, ShadingContext};
use granita_base::{Color, Params, ShapeDesc, Vec3};
use granita_scene::{AttributeSet, Primitive};
use granita_shade::{Grid, Lanes3, Topology};
use std::f32::consts::PI;
use std::sync::atomic::Ordering;

const CONSTANT: &str = "surface constant () { C *= opacity; }";

/// Returns a shader that calls `occlusion ()` with these options.
fn occlusion(options: &str) -> String {
    format!(
        "surface ask () {{ vector open = 0; float o = occlusion (\"walls\", P, N, M_PI_2, open{options}); \
         C = o; opacity = (color) open; }}"
    )
}

/// Returns a shader that calls `indirect ()` with these options.
fn indirect(options: &str) -> String {
    format!("surface ask () {{ C = indirect (\"walls\", P, N{options}); }}")
}

/// The result of a shader on a grid.
struct Found {
    grid: Grid,
    records: u64,
    rays: u64,
}

fn run(f: &Fixture, asked: &Primitive, mut grid: Grid) -> Found {
    let (scene, camera, environment) = f.finish();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    let object = frame.object(asked);
    ShaderThread::new(&frame).shade(&object, &mut grid, &[]);
    let count = |n: &std::sync::atomic::AtomicU64| n.load(Ordering::Relaxed);
    let (records, rays) = (count(&frame.light_cache.records), count(&frame.light_cache.rays));
    Found { grid, records, rays }
}

/// Adds the floor z = 0, whose shader gathers. It is in no set.
fn floor(f: &mut Fixture) -> std::sync::Arc<Primitive> {
    let attributes = f.attributes("ask", &[], &[]);
    f.rectangle([-50.0; 2], [50.0; 2], 0.0, attributes)
}

fn wall(f: &mut Fixture, corners: [[f32; 3]; 4], color: Option<f32>) {
    let shape = ShapeDesc::Mesh { subdivide: false, nverts: [4].into(), verts: [0, 1, 2, 3].into() };
    let params = Params(vec![param("vertex point P", corners.as_flattened())]);
    let color: Vec<_> = color.map(|c| param("color C", &[c; 3][..])).into_iter().collect();
    let attributes = f.attributes("constant", &["walls"], &color);
    f.add(shape, params, attributes);
}

/// Adds a disc of radius `r` at height `h`, with 96 corners.
fn disc(f: &mut Fixture, r: f32, h: f32, color: f32) {
    let shape = ShapeDesc::Mesh { subdivide: false, nverts: [96].into(), verts: (0..96).collect() };
    let corner = |k: usize| {
        let a = k as f32 / 48.0 * PI;
        [r * a.cos(), r * a.sin(), h]
    };
    let corners: Vec<f32> = (0..96).flat_map(corner).collect();
    let attributes = f.attributes("constant", &["walls"], &[param("color C", &[color; 3][..])]);
    f.add(shape, Params(vec![param("vertex point P", &corners[..])]), attributes);
}

/// Returns a uniform grid of the plane z = 0.
fn even(nu: usize, nv: usize, lo: [f32; 2], hi: [f32; 2]) -> Grid {
    let at = |k: usize, n: usize, c: usize| lo[c] + (hi[c] - lo[c]) * k as f32 / (n - 1) as f32;
    let points: Vec<[f32; 2]> = (0..nu * nv).map(|i| [at(i % nu, nu, 0), at(i / nu, nv, 1)]).collect();
    let mut grid = flat_grid(&points);
    grid.topology = Topology::Rect { nu, nv };
    grid.u = (0..nu * nv).map(|i| 0.1 + (i % nu) as f32 * 0.01).collect();
    grid.v = (0..nu * nv).map(|i| 0.1 + (i / nu) as f32 * 0.01).collect();
    grid
}

const FAR: f32 = 5000.0;

#[test]
fn a_corner_of_walls_occludes_three_quarters() {
    let mut f = Fixture::new(&[CONSTANT, &occlusion(", \"samples\", 1024, \"adaptive\", 0")]);
    let asked = floor(&mut f);
    wall(&mut f, [[0.0, -FAR, 0.0], [0.0, FAR, 0.0], [0.0, FAR, FAR], [0.0, -FAR, FAR]], None);
    wall(&mut f, [[-FAR, 0.0, 0.0], [FAR, 0.0, 0.0], [FAR, 0.0, FAR], [-FAR, 0.0, FAR]], None);
    let found = run(&f, &asked, even(9, 9, [0.2, 0.2], [2.0, 2.0]));
    for i in 0..81 {
        assert!((found.grid.c.get(i).x - 0.75).abs() < 0.01, "{i}: {}", found.grid.c.get(i).x);
        // A quarter of the hemisphere is left: (4, 4, 2 pi) over 3 pi, normalised.
        let open = Vec3::new(4.0, 4.0, 2.0 * PI).normalize();
        assert!(found.grid.opacity.get(i).distance(open) < 0.03, "{i}: {}", found.grid.opacity.get(i));
    }
    assert!(found.records < 30, "{}", found.records);
    assert_eq!(f.complaints(), Vec::<String>::new());
}

#[test]
fn a_half_plane_occludes_half_under_its_edge_and_all_inside() {
    let mut f = Fixture::new(&[CONSTANT, &occlusion(", \"samples\", 1024")]);
    let asked = floor(&mut f);
    wall(&mut f, [[-FAR, -FAR, 1.0], [0.0, -FAR, 1.0], [0.0, FAR, 1.0], [-FAR, FAR, 1.0]], None);
    let found = run(&f, &asked, even(33, 5, [-3.0, 0.0], [3.0, 1.0]));
    for i in 0..33 * 5 {
        // A half plane at height 1 whose edge is at elevation phi: (1 - cos phi) / 2 from the side that it covers.
        let x = found.grid.p.get(i).x;
        let due = 0.5 * (1.0 - x / (x * x + 1.0).sqrt());
        assert!((found.grid.c.get(i).x - due).abs() < 0.015, "{x}: {} for {due}", found.grid.c.get(i).x);
    }
    assert!(found.records < 33 * 5 / 2, "{}", found.records);
}

#[test]
fn a_dome_occludes_all_and_falls_off_by_the_falloff_mode() {
    let at_centre = |options: &str| {
        let mut f = Fixture::new(&[CONSTANT, &occlusion(&format!(", \"samples\", 64{options}"))]);
        let asked = floor(&mut f);
        let dome = f.attributes("constant", &["walls"], &[]);
        f.sphere(Vec3::ZERO, 2.0, dome);
        let grid = run(&f, &asked, flat_grid(&[[0.0, 0.0]])).grid;
        (grid.c.get(0).x, grid.opacity.get(0))
    };
    assert_eq!(at_centre(""), (1.0, Vec3::Z));
    assert_eq!(at_centre(", \"maxerror\", 0").0, 1.0);
    assert_eq!(at_centre(", \"maxhitdist\", 1.5").0, 0.0);
    assert_eq!(at_centre(", \"bias\", 3").0, 0.0);
    let near = |a: f32, b: f32| assert!((a - b).abs() < 2e-3, "{a} is not {b}");
    for full in ["", ", \"maxerror\", 0"] {
        near(at_centre(&format!(", \"falloff\", 0.5{full}")).0, (-1.0_f32).exp());
        near(at_centre(&format!(", \"falloff\", 2, \"falloffmode\", 1, \"maxhitdist\", 8{full}")).0, 0.5625);
    }
}

#[test]
fn occlusion_is_a_share_of_rays_and_indirect_light_is_irradiance() {
    // A disc above fills a cone of 45 degrees around the axis. It blocks half of the rays that are distributed by
    // the cosine, and 1 - cos 45 degrees of the solid angle.
    let blocked = |distribution: &str| {
        let options = format!(", \"samples\", 4096, \"adaptive\", 0, \"maxerror\", 0{distribution}");
        let mut f = Fixture::new(&[CONSTANT, &occlusion(&options)]);
        let asked = floor(&mut f);
        disc(&mut f, 1.0, 1.0, 1.0);
        run(&f, &asked, flat_grid(&[[0.0, 0.0]])).grid.c.get(0).x
    };
    assert!((blocked("") - 0.5).abs() < 0.01);
    assert!((blocked(", \"distribution\", \"cosine\"") - 0.5).abs() < 0.01);
    assert!((blocked(", \"distribution\", \"uniform\"") - (1.0 - 0.5_f32.sqrt())).abs() < 0.01);
    // A sky of 1 all around is a light of colour 1.
    let mut f = Fixture::new(&[CONSTANT, &indirect(", \"samples\", 256")]);
    let asked = floor(&mut f);
    let sky = f.attributes("constant", &["walls"], &[]);
    f.sphere(Vec3::ZERO, 20.0, sky);
    let light = run(&f, &asked, flat_grid(&[[0.0, 0.0]])).grid.c.get(0);
    assert!((light - Vec3::ONE).abs().max_element() < 1e-3, "{light}");
}

#[test]
fn light_between_discs_equals_their_form_factor() {
    // Two parallel discs of radii 1 and 1.5, 2 apart: X = 1 + (1 + R2^2) / R1^2 with radii over the distance.
    let (r1, r2) = (0.5_f32, 0.75_f32);
    let x = 1.0 + (1.0 + r2 * r2) / (r1 * r1);
    let due = 0.5 * (x - (x * x - 4.0 * (r2 / r1) * (r2 / r1)).sqrt());
    for options in [", \"samples\", 1024, \"adaptive\", 0", ", \"samples\", 256, \"maxerror\", 0"] {
        let mut f = Fixture::new(&[CONSTANT, &indirect(options)]);
        let asked = floor(&mut f);
        disc(&mut f, 1.5, 2.0, 3.0);
        // Rings of equal area.
        let points: Vec<[f32; 2]> = (0..400)
            .map(|i| {
                let (r, a) = (((i / 20) as f32 + 0.5) / 20.0, (i % 20) as f32 * 0.05 * 2.0 * PI);
                [r.sqrt() * a.cos(), r.sqrt() * a.sin()]
            })
            .collect();
        let mut grid = flat_grid(&points);
        grid.topology = Topology::Rect { nu: 20, nv: 20 };
        let found = run(&f, &asked, grid);
        let mean = found.grid.c.xyz[0].iter().sum::<f32>() / 400.0 / 3.0;
        assert!((mean / due - 1.0).abs() < 0.01, "{options}: {mean} for {due}");
        assert_eq!(found.records == 400, options.contains("maxerror"), "{}", found.records);
    }
}

#[test]
fn a_wall_tilts_the_mean_open_direction_away() {
    let mut f = Fixture::new(&[CONSTANT, &occlusion(", \"samples\", 1024")]);
    let asked = floor(&mut f);
    wall(&mut f, [[0.0, -FAR, 0.0], [0.0, FAR, 0.0], [0.0, FAR, FAR], [0.0, -FAR, FAR]], None);
    let grid = run(&f, &asked, flat_grid(&[[0.5, 0.0]])).grid;
    let due = Vec3::new(4.0 / (3.0 * PI), 0.0, 2.0 / 3.0).normalize();
    assert!(grid.opacity.get(0).distance(due) < 0.03, "{} for {due}", grid.opacity.get(0));
    assert!((grid.c.get(0).x - 0.5).abs() < 0.01);
}

#[test]
fn adaptive_sampling_traces_fewer_rays_where_they_agree() {
    let rays = |options: &str| {
        let mut f = Fixture::new(&[CONSTANT, &occlusion(&format!(", \"samples\", 256{options}"))]);
        let asked = floor(&mut f);
        wall(&mut f, [[60.0, -FAR, 0.0], [60.0, FAR, 0.0], [60.0, FAR, 10.0], [60.0, -FAR, 10.0]], None);
        run(&f, &asked, even(5, 5, [-0.1, -0.1], [0.1, 0.1])).rays
    };
    let (full, usual, none) =
        (rays(", \"adaptive\", 0"), rays(""), rays(", \"adaptive\", 0, \"maxerror\", 0"));
    // 9 rings of 28 each; a quarter: 4 rings of 16.
    assert_eq!(full, 4 * 252);
    assert_eq!(usual, 4 * 64);
    assert_eq!(none, 25 * 252);
}

#[test]
fn attributes_of_objects_set_the_accuracy() {
    let of = |source: &dyn Fn(&str) -> String, values: &[(&str, f32)], options: &str| {
        let mut f = Fixture::new(&[CONSTANT, &source(&format!(", \"samples\", 16{options}"))]);
        let values: Vec<_> = values
            .iter()
            .map(|(name, v)| match name.starts_with("int") {
                true => param(name, *v as i32),
                false => param(name, *v),
            })
            .collect();
        let attributes = f.attributes("ask", &[], &values);
        let asked = f.rectangle([-50.0; 2], [50.0; 2], 0.0, attributes);
        wall(&mut f, [[60.0, -FAR, 0.0], [60.0, FAR, 0.0], [60.0, FAR, 10.0], [60.0, -FAR, 10.0]], None);
        run(&f, &asked, even(9, 9, [-0.1, -0.1], [0.1, 0.1])).records
    };
    let records = |values: &[(&str, f32)], options: &str| of(&occlusion, values, options);
    assert_eq!(records(&[], ""), 4);
    assert_eq!(records(&[("float occlusion:maxerror", 0.0)], ""), 81);
    assert_eq!(records(&[("float occlusion:maxerror", 0.0)], ", \"maxerror\", 0.25"), 4);
    assert_eq!(records(&[("float occlusion:maxpixeldist", 0.0)], ", \"maxerror\", 0.25"), 81);
    assert!(records(&[("float occlusion:maxpixeldist", 1.0)], "") > 4);
    assert_eq!(records(&[("float occlusion:maxpixeldist", 1.0)], ", \"maxpixeldist\", 20"), 4);
    assert!(records(&[("int occlusion:minsamples", 12.0)], "") >= 12);
    // The records of indirect light have their own parameters.
    assert_eq!(records(&[("float indirect:maxerror", 0.0)], ""), 4);
    let light = |values: &[(&str, f32)], options: &str| of(&indirect, values, options);
    assert_eq!(light(&[], ""), 4);
    assert_eq!(light(&[("float indirect:maxerror", 0.0)], ""), 81);
    assert_eq!(light(&[("float indirect:maxerror", 0.0)], ", \"maxerror\", 0.25"), 4);
    assert_eq!(light(&[("float indirect:maxpixeldist", 0.0)], ""), 81);
    assert!(light(&[("float indirect:maxpixeldist", 1.0)], "") > 4);
    assert!(light(&[("int indirect:minsamples", 12.0)], "") >= 12);
    assert_eq!(light(&[("float occlusion:maxerror", 0.0)], ""), 4);
}

#[test]
fn grids_agree_on_shared_edges_and_share_records() {
    let mut f = Fixture::new(&[CONSTANT, &indirect(", \"samples\", 64")]);
    let asked = floor(&mut f);
    wall(&mut f, [[2.0, -2.0, 0.0], [2.0, 3.0, 0.0], [2.0, 3.0, 3.0], [2.0, -2.0, 3.0]], Some(0.7));
    let (scene, camera, environment) = f.finish();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    let object = frame.object(&asked);
    let mut thread = ShaderThread::new(&frame);
    let mut shade = |mut grid: Grid, seed| {
        grid.seed = seed;
        thread.shade(&object, &mut grid, &[]);
        grid.c
    };
    let left = shade(even(17, 9, [-1.0, 0.0], [0.0, 1.0]), 5);
    let alone = frame.light_cache.records.load(Ordering::Relaxed);
    let right = shade(even(9, 9, [0.0, 0.0], [1.0, 1.0]), 77);
    let both = frame.light_cache.records.load(Ordering::Relaxed);
    for j in 0..9 {
        assert_eq!(left.get(j * 17 + 16), right.get(j * 9), "{j}");
    }
    // On the second run, only the inside is new.
    let again = shade(even(17, 9, [-1.0, 0.0], [0.0, 1.0]), 99);
    let inside = frame.light_cache.records.load(Ordering::Relaxed) - both;
    assert!(inside < alone, "{inside} of {alone}");
    assert_eq!(left, again);
    // Records that are dropped are computed again, to the bit.
    frame.light_cache.set_limit(0);
    for seed in [5, 6] {
        assert_eq!(shade(even(17, 9, [-1.0, 0.0], [0.0, 1.0]), seed), left);
    }
    assert!(frame.light_cache.records.load(Ordering::Relaxed) > both + 2 * inside);
}

#[test]
fn points_on_borders_against_walls_receive_their_light() {
    // The floor ends in the walls of a closed white room, and is sampled at its very corner.
    let mut f = Fixture::new(&[CONSTANT, &indirect(", \"samples\", 64")]);
    let asked = floor(&mut f);
    let room = AttributeSet { ..f.attributes("constant", &["walls"], &[]) };
    let p = |k: usize| [(k & 1) as f32 * 4.0, (k >> 1 & 1) as f32 * 4.0, (k >> 2) as f32 * 4.0 - 1e-3];
    let shape = ShapeDesc::Mesh {
        subdivide: false,
        nverts: [4; 6].into(),
        verts: [0, 1, 3, 2, 4, 5, 7, 6, 0, 1, 5, 4, 2, 3, 7, 6, 0, 2, 6, 4, 1, 3, 7, 5].into(),
    };
    let corners: Vec<f32> = (0..8).flat_map(p).collect();
    f.add(shape, Params(vec![param("vertex point P", &corners[..])]), room);
    let mut grid = even(5, 5, [0.0, 0.0], [4.0, 4.0]);
    grid.u = (0..25).map(|i| (i % 5) as f32 / 4.0).collect();
    grid.v = (0..25).map(|i| (i / 5) as f32 / 4.0).collect();
    let found = run(&f, &asked, grid);
    for i in 0..25 {
        assert_eq!(found.grid.c.get(i), Color::ONE, "{i}");
    }
}

#[test]
fn points_without_normal_or_position_receive_nothing() {
    let mut f = Fixture::new(&[CONSTANT, &occlusion(", \"samples\", 16")]);
    let asked = floor(&mut f);
    let dome = f.attributes("constant", &["walls"], &[]);
    f.sphere(Vec3::ZERO, 40.0, dome);
    let mut grid = even(4, 4, [0.0, 0.0], [1.0, 1.0]);
    grid.n.set(5, Vec3::ZERO);
    grid.n.set(6, Vec3::NAN);
    grid.p.set(9, Vec3::INFINITY);
    let found = run(&f, &asked, grid);
    for i in [0, 3, 12, 15] {
        assert_eq!(found.grid.c.get(i), Color::ONE);
    }
    for i in [5, 6, 9] {
        assert_eq!(found.grid.c.get(i), Color::ZERO);
    }
}

#[test]
fn the_rotational_gradient_predicts_light_on_bumps() {
    // Bumps on a floor under half a sky.
    let mut f = Fixture::new(&[CONSTANT, &indirect(", \"samples\", 1024")]);
    let asked = floor(&mut f);
    wall(&mut f, [[-FAR, -FAR, 50.0], [0.0, -FAR, 50.0], [0.0, FAR, 50.0], [-FAR, FAR, 50.0]], Some(1.0));
    let mut grid = even(17, 17, [-0.1, -0.1], [0.1, 0.1]);
    let turned = |i: usize| 0.15 * (i as f32 * 1.3).sin();
    let normals: Vec<Vec3> = (0..289).map(|i| Vec3::new(turned(i).sin(), 0.0, turned(i).cos())).collect();
    grid.n = Lanes3::from_points(&normals);
    let found = run(&f, &asked, grid);
    assert!(found.records < 100, "{}", found.records);
    for i in 0..289 {
        // Half of the sky, for a normal turned by an angle, without the part below the horizon.
        let due = 0.5 * (turned(i).cos() - turned(i).sin());
        assert!((found.grid.c.get(i).x - due).abs() < 0.02, "{i}: {} for {due}", found.grid.c.get(i).x);
    }
}
