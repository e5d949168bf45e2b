//! Tests shading as a whole: shaders, lights and rays over small scenes with known results.

use crate::fixture::{Finish as _, Fixture, flat_grid, param, shader};
use crate::{ShaderThread, ShadingContext, ShadingStatistics};
use granita_base::{Color, Param, Params, ShapeDesc, Transform, Vec3};
use granita_scene::{AttributeSet, Primitive};
use granita_shade::{Grid, Lanes3};
use std::sync::Arc;

mod maps;

const MATTE: &str = "surface matte () { C *= diffuse (normalize (N)); C *= opacity; }";
const CONSTANT: &str = "surface constant () { C *= opacity; }";
const MIRROR: &str = "surface mirror (string envname = \"reflection\", float blur = 0, float samples = 1)
{
    C = environment (envname, reflect (normalize (I), normalize (N)), \"blur\", blur, \"samples\", samples);
}";
const POINT: &str = "light pointlight (float intensity = 1, string shadowname = \"\", float samples = 1)
{
    emit (point (\"shader\", 0, 0, 0)) {
        Cl = intensity / dot (L, L);
        if (shadowname) Cl *= 1 - (color) shadow (shadowname, Ps, \"samples\", samples);
    }
}";

mod albedo;
mod deep;
mod furnace;
mod numbers;
mod rays;

/// Shades a grid with the state of a primitive. Also returns the counts of the frame.
fn shade_grid(f: &Fixture, primitive: &Primitive, mut grid: Grid) -> (Grid, ShadingStatistics) {
    let (scene, camera, environment) = f.finish();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    let object = frame.object(primitive);
    grid.c = Lanes3::splat(object.color, grid.len());
    grid.opacity = Lanes3::splat(object.opacity, grid.len());
    ShaderThread::new(&frame).shade(&object, &mut grid, &[]);
    (grid, frame.statistics())
}

/// Shades points of the plane z = 0 with the state of a primitive.
fn shade(f: &Fixture, primitive: &Primitive, points: &[[f32; 2]]) -> Grid {
    shade_grid(f, primitive, flat_grid(points)).0
}

/// Returns a grid of points, each with a position, a normal and a view direction.
fn grid_at(points: &[[Vec3; 3]]) -> Grid {
    let mut grid = flat_grid(&vec![[0.0; 2]; points.len()]);
    for (k, [p, n, i]) in points.iter().enumerate() {
        grid.p.set(k, *p);
        grid.n.set(k, *n);
        grid.ng.set(k, *n);
        grid.i.set(k, *i);
    }
    grid
}

fn with_surface(attributes: AttributeSet, name: &str, params: &[Param]) -> AttributeSet {
    AttributeSet { surface: Some(shader(name, params, Transform::IDENTITY)), ..attributes }
}

/// Adds a rectangle with corners a, b, c, d in order.
fn quad(f: &mut Fixture, corners: [Vec3; 4], attributes: AttributeSet) -> Arc<Primitive> {
    let p: Vec<f32> = corners.iter().flat_map(|p| p.to_array()).collect();
    let shape = ShapeDesc::Mesh { subdivide: false, nverts: [4].into(), verts: [0, 1, 2, 3].into() };
    f.add(shape, Params(vec![param("vertex point P", &p[..])]), attributes)
}

fn near(a: Color, b: Color) {
    assert!((a - b).abs().max_element() <= 1e-5 * b.abs().max_element().max(1.0), "{a} is not {b}");
}

#[test]
fn irradiance_falls_off_with_squared_distance_and_cosine() {
    let mut f = Fixture::new(&[MATTE, POINT]);
    f.light("pointlight", &[param("float intensity", 5.0)], Transform::translate(Vec3::Z * 2.0));
    let floor = f.attributes("matte", &[], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    let points = [[0.0, 0.0], [1.0, 0.0], [0.0, -3.0], [2.0, 2.0]];
    let grid = shade(&f, &floor, &points);
    for (i, [x, y]) in points.into_iter().enumerate() {
        let r = (x * x + y * y + 4.0_f32).sqrt();
        near(grid.c.get(i), Color::splat(5.0 * 2.0 / (r * r * r)));
    }
    assert_eq!(f.complaints(), Vec::<String>::new());
}

#[test]
fn a_shadow_ends_at_the_projected_edge() {
    let mut f = Fixture::new(&[MATTE, CONSTANT, POINT]);
    let params = [param("string shadowname", "shadow")];
    f.light("pointlight", &params, Transform::translate(Vec3::Z * 2.0));
    let floor = f.attributes("matte", &["shadow"], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    // A square of half side 1 half way up casts a shadow of half side 2.
    let lid = f.attributes("constant", &["shadow"], &[]);
    f.rectangle([-1.0; 2], [1.0; 2], 1.0, lid);
    let points = [[0.0, 0.0], [1.999, 0.0], [-1.999, 1.999], [2.001, 0.0], [0.0, -2.001], [4.0, 4.0]];
    let grid = shade(&f, &floor, &points);
    for i in 0..3 {
        assert_eq!(grid.c.get(i), Color::ZERO, "{i}");
    }
    for (i, [x, y]) in points.into_iter().enumerate().skip(3) {
        let r = (x * x + y * y + 4.0_f32).sqrt();
        near(grid.c.get(i), Color::splat(2.0 / (r * r * r)));
    }
    assert_eq!(f.complaints(), Vec::<String>::new());
}

#[test]
fn shadows_of_transparent_objects_are_coloured() {
    let mut f = Fixture::new(&[MATTE, CONSTANT, POINT]);
    let params = [param("string shadowname", "shadow")];
    f.light("pointlight", &params, Transform::translate(Vec3::Z * 2.0));
    let floor = f.attributes("matte", &[], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    let glass = [param("color opacity", &[0.25_f32, 0.5, 1.0][..])];
    let first = f.attributes("constant", &["shadow"], &glass);
    f.rectangle([-1.0; 2], [1.0; 2], 1.0, first);
    let second = f.attributes("constant", &["shadow"], &glass);
    f.rectangle([-1.0; 2], [0.0; 2], 0.5, second);
    // The blocking opacity is twice as large at (-0.2, -0.2).
    let grid = shade(&f, &floor, &[[0.2, 0.2], [-0.2, -0.2]]);
    let open = 2.0 / (0.08_f32 + 4.0).powf(1.5);
    near(grid.c.get(0), Color::new(0.75, 0.5, 0.0) * open);
    near(grid.c.get(1), Color::new(0.75 * 0.75, 0.25, 0.0) * open);
}

#[test]
fn a_mirror_shows_the_exact_colour_of_the_reflected_surface() {
    let mut f = Fixture::new(&[CONSTANT, MIRROR]);
    let floor = f.attributes("mirror", &["reflection"], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    let ball = f.attributes("constant", &["reflection"], &[param("color C", &[0.2_f32, 0.5, 0.8][..])]);
    f.sphere(Vec3::Z * 3.0, 1.0, ball);
    let grid = shade(&f, &floor, &[[0.0, 0.0], [0.9, 0.0], [1.1, 0.0], [0.0, -5.0]]);
    for i in 0..2 {
        assert_eq!(grid.c.get(i), Color::new(0.2, 0.5, 0.8));
    }
    for i in 2..4 {
        assert_eq!(grid.c.get(i), Color::ZERO);
    }
    assert_eq!(f.complaints(), Vec::<String>::new());
}

#[test]
fn mirrors_in_mirrors_end_with_the_colour_of_the_maximum_depth() {
    let mut f = Fixture::new(&[MIRROR]);
    f.global("int ray:maxdepth", 3);
    f.global("color ray:maxdepthcolor", &[0.1_f32, 0.2, 0.3][..]);
    let floor = f.attributes("mirror", &["reflection"], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    let ceiling = f.attributes("mirror", &["reflection"], &[]);
    f.rectangle([-9.0; 2], [9.0; 2], 1.0, ceiling);
    let grid = shade(&f, &floor, &[[0.1, 0.2]]);
    near(grid.c.get(0), Color::new(0.1, 0.2, 0.3));
}

#[test]
fn a_reflected_surface_is_seen_through_transparent_ones() {
    let mut f = Fixture::new(&[CONSTANT, MIRROR]);
    let floor = f.attributes("mirror", &["reflection"], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    let veil = [param("color C", &[1.0_f32, 0.0, 0.0][..]), param("color opacity", &[0.25_f32; 3][..])];
    let veil = f.attributes("constant", &["reflection"], &veil);
    f.rectangle([-9.0; 2], [9.0; 2], 1.0, veil);
    let wall = f.attributes("constant", &["reflection"], &[param("color C", &[0.0_f32, 1.0, 0.0][..])]);
    f.rectangle([-9.0; 2], [9.0; 2], 2.0, wall);
    let grid = shade(&f, &floor, &[[0.3, 0.4]]);
    near(grid.c.get(0), Color::new(0.25, 0.75, 0.0));
}

#[test]
fn hits_carry_the_variables_of_their_faces() {
    let mut f = Fixture::new(&[CONSTANT, MIRROR]);
    let floor = f.attributes("mirror", &["reflection"], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    // Two faces lie side by side at height 1. Each has its own colour.
    let p =
        [-1.0, -1.0, 1.0, 0.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0_f32];
    let shape =
        ShapeDesc::Mesh { subdivide: false, nverts: [4, 4].into(), verts: [0, 1, 4, 3, 1, 2, 5, 4].into() };
    let colors = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0_f32];
    let params = Params(vec![param("vertex point P", &p[..]), param("perpiece color C", &colors[..])]);
    let pair = f.attributes("constant", &["reflection"], &[]);
    f.add(shape, params, pair);
    let grid = shade(&f, &floor, &[[-0.5, 0.0], [0.5, 0.3]]);
    assert_eq!(grid.c.get(0), Color::X);
    assert_eq!(grid.c.get(1), Color::Z);
}

#[test]
fn occlusion_is_one_under_an_infinite_plane_and_zero_in_the_open() {
    let source = "surface occ () { C = occlusion (\"lid\", P, N, 1.2, \"samples\", 64); }";
    let mut f = Fixture::new(&[CONSTANT, source]);
    let floor = f.attributes("occ", &[], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    let lid = f.attributes("constant", &["lid"], &[]);
    f.rectangle([-1000.0, -1000.0], [0.0, 1000.0], 0.5, lid);
    let grid = shade(&f, &floor, &[[-50.0, 0.0], [50.0, 0.0], [0.0, 0.0]]);
    assert_eq!(grid.c.get(0), Color::ONE);
    assert_eq!(grid.c.get(1), Color::ZERO);
    // Under the edge the value is one half, apart from noise.
    assert!((grid.c.get(2).x - 0.5).abs() < 0.1, "{}", grid.c.get(2));
}

#[test]
fn indirect_light_in_a_white_furnace_is_one() {
    let source = "surface gather () { C = indirect (\"room\", P, N, \"samples\", 16); }";
    let mut f = Fixture::new(&[CONSTANT, source]);
    let floor = f.attributes("gather", &[], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    let room = f.attributes("constant", &["room"], &[]);
    f.sphere(Vec3::ZERO, 20.0, room);
    let grid = shade(&f, &floor, &[[0.0, 0.0], [3.0, -4.0]]);
    near(grid.c.get(0), Color::ONE);
    near(grid.c.get(1), Color::ONE);
}

#[test]
fn missing_shaders_are_reported_once_with_their_object() {
    let mut f = Fixture::new(&[CONSTANT]);
    f.light("nolight", &[], Transform::IDENTITY);
    let named = [param("string name", "ball")];
    let first = f.attributes("nosuch", &[], &named);
    let first = f.sphere(Vec3::ZERO, 1.0, first);
    let second = f.attributes("nosuch", &[], &named);
    let second = f.sphere(Vec3::X, 1.0, second);
    let grid = shade(&f, &first, &[[0.0, 0.0]]);
    shade(&f, &second, &[[0.0, 0.0]]);
    assert_eq!(grid.c.get(0), Color::ONE);
    let said = f.complaints();
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(said[0].contains("light \"light0\"") && said[0].contains("\"nolight\" is missing"), "{said:?}");
    assert!(said[1].contains("object \"ball\"") && said[1].contains("\"defaultsurface\""), "{said:?}");
}

#[test]
fn a_missing_texture_is_reported_once_and_gives_the_fill_value() {
    let source = "surface tex () { C = (color) texture (\"no.tx\", u, v, \"fill\", 0.25); }";
    let mut f = Fixture::new(&[source]);
    let floor = f.attributes("tex", &[], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    for _ in 0..2 {
        let grid = shade(&f, &floor, &[[0.0, 0.0], [1.0, 0.0]]);
        assert_eq!(grid.c.get(1), Color::splat(0.25));
    }
    let said = f.complaints();
    assert!(!said.is_empty() && said.iter().all(|s| s.contains("no.tx")), "{said:?}");
}

#[test]
fn random_rays_do_not_depend_on_threads() {
    let mut f = Fixture::new(&[MATTE, POINT, MIRROR]);
    f.light("pointlight", &[], Transform::translate(Vec3::Z * 4.0));
    let mirror = f.attributes("", &["reflection"], &[]);
    let blurred = granita_scene::AttributeSet {
        surface: Some(crate::fixture::shader(
            "mirror",
            &[param("float blur", 0.3), param("float samples", 5.0)],
            Transform::IDENTITY,
        )),
        ..mirror
    };
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, blurred);
    for k in 0..5 {
        let ball = f.attributes("matte", &["reflection"], &[]);
        f.sphere(Vec3::new(k as f32 - 2.0, 0.3, 2.0), 0.6, ball);
    }
    let points: Vec<[f32; 2]> = (0..40).map(|i| [i as f32 * 0.1 - 2.0, 0.1]).collect();
    let reference = shade(&f, &floor, &points);
    assert!(reference.c.xyz[0].iter().any(|c| *c > 0.0));
    let (scene, camera, environment) = f.finish();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                let object = frame.object(&floor);
                let mut thread = ShaderThread::new(&frame);
                for _ in 0..3 {
                    let mut grid = flat_grid(&points);
                    thread.shade(&object, &mut grid, &[]);
                    assert_eq!(grid.c, reference.c);
                }
            });
        }
    });
    assert_eq!(frame.rays.built(), (1, 1));
}

#[test]
fn sets_without_rays_are_not_built() {
    let mut f = Fixture::new(&[CONSTANT]);
    let floor = f.attributes("constant", &["camera", "reflection", "shadow"], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    let (scene, camera, environment) = f.finish();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    let object = frame.object(&floor);
    assert!(object.opaque);
    ShaderThread::new(&frame).shade(&object, &mut flat_grid(&[[0.0, 0.0]]), &[]);
    // The set has two names but one membership, and is not built. The camera's set is not a ray set.
    assert_eq!(frame.rays.built(), (0, 1));
    assert!(frame.rays.is_set("shadow") && !frame.rays.is_set("camera") && !frame.rays.is_set("cam"));
}

#[test]
fn rays_hit_displaced_surfaces_where_they_moved_to() {
    let lift = "displacement lift () { displace (1); }";
    let probe = "surface probe () {
        float d = 0; vector n = 0;
        color c = environment (\"reflection\", vector (0, 0, 1), \"hitdist\", d, \"Nhit\", n);
        C = color (d, n[2], c[0]);
    }";
    for truly in [1, 0] {
        let mut f = Fixture::new(&[CONSTANT, lift, probe]);
        let floor = f.attributes("probe", &[], &[]);
        let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
        let lid = f.attributes("constant", &["reflection"], &[param("int ray:displace", truly)]);
        let displacement = Some(crate::fixture::shader("lift", &[], Transform::IDENTITY));
        f.rectangle([-1.0; 2], [1.0; 2], 1.0, granita_scene::AttributeSet { displacement, ..lid });
        let grid = shade(&f, &floor, &[[0.0, 0.0]]);
        near(grid.c.get(0), Color::new(if truly == 1 { 2.0 } else { 1.0 }, 1.0, 1.0));
    }
}

#[test]
fn shaders_transform_between_named_spaces() {
    let source = "surface where (string space = \"object\") { C = (color) (vector) transform (space, P); }";
    let ask = |space: &str| {
        let mut f = Fixture::new(&[source]);
        f.scene
            .coordinate_systems
            .insert("place".into(), Transform::translate(Vec3::new(0.0, 2.0, 0.0)).into());
        let floor = granita_scene::AttributeSet {
            surface: Some(crate::fixture::shader(
                "where",
                &[param("string space", space)],
                Transform::scale(Vec3::splat(0.5)),
            )),
            to_world: Transform::translate(Vec3::X).into(),
            ..Default::default()
        };
        let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
        shade(&f, &floor, &[[3.0, 1.0]]).c.get(0)
    };
    near(ask("common"), Vec3::new(3.0, 1.0, 0.0));
    near(ask("world"), Vec3::new(3.0, 1.0, 0.0));
    near(ask("object"), Vec3::new(2.0, 1.0, 0.0));
    near(ask("shader"), Vec3::new(6.0, 2.0, 0.0));
    near(ask("place"), Vec3::new(3.0, -1.0, 0.0));
    near(ask("camera"), Vec3::new(3.0, 1.0, 10.0));
    near(ask("cam"), Vec3::new(3.0, 1.0, 10.0));
    // At 90 degrees, 640 x 480 and distance 10, the image is 20 high.
    assert!((ask("screen") - Vec3::new(0.3, 0.1, 0.0)).truncate().length() < 1e-5);
    let ndc = ask("NDC");
    assert!((ndc.truncate() - granita_base::Vec2::new(0.5 + 0.3 * 0.375, 0.45)).length() < 1e-4, "{ndc}");
    let raster = ask("raster");
    assert!((raster.truncate() - granita_base::Vec2::new(392.0, 216.0)).length() < 0.05, "{raster}");
}

#[test]
fn a_distant_light_has_cosine_falloff_and_parallel_shadows() {
    let sun = "light sun (string shadowname = \"\") {
        emit (vector (\"shader\", 0, 0, -1), 0) {
            Cl = 1;
            if (shadowname) Cl *= 1 - (color) shadow (shadowname, Ps);
        }
    }";
    let mut f = Fixture::new(&[MATTE, CONSTANT, sun]);
    let tilt = Transform::rotate(std::f32::consts::FRAC_PI_3, Vec3::Y);
    f.light("sun", &[param("string shadowname", "shadow")], tilt);
    let floor = f.attributes("matte", &[], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    let lid = f.attributes("constant", &["shadow"], &[]);
    f.rectangle([-1.0; 2], [1.0; 2], 1.0, lid);
    // The rotated axis (0, 0, -1) casts the lid's shadow sideways by tan 60.
    let axis = tilt.vector(-Vec3::Z);
    let shift = -axis.x / axis.z;
    let points = [[shift, 0.0], [shift + 0.999, 0.0], [shift + 1.001, 0.0], [shift - 1.001, 0.0]];
    let grid = shade(&f, &floor, &points);
    assert_eq!((grid.c.get(0), grid.c.get(1)), (Color::ZERO, Color::ZERO));
    near(grid.c.get(2), Color::splat(0.5));
    near(grid.c.get(3), Color::splat(0.5));
}

#[test]
fn shaders_read_ambient_light_attributes_and_holdouts() {
    let ambient = "light sky () { Cl = 0.25; }";
    let asks = "surface asks () {
        float bias = 0, weight = 0; string who = \"\";
        float a = getattribute (\"shadow:bias\", bias);
        float b = getattribute (\"user:weight\", weight);
        float c = getattribute (\"user:nothing\", weight);
        C = ambient () * color (a + bias, b * weight, c);
    }";
    let mut f = Fixture::new(&[ambient, asks]);
    f.light("sky", &[], Transform::IDENTITY);
    let floor = f.attributes("asks", &[], &[param("float user:weight", 8.0)]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    let grid = shade(&f, &floor, &[[0.0, 0.0]]);
    near(grid.c.get(0), Color::new(0.25 * 1.01, 2.0, 0.0));
    let matte = f.attributes("asks", &[], &[param("int holdout", 1)]);
    let matte = f.rectangle([-9.0; 2], [9.0; 2], 0.0, matte);
    let grid = shade(&f, &matte, &[[0.0, 0.0]]);
    assert_eq!((grid.c.get(0), grid.opacity.get(0)), (Color::ZERO, Color::ZERO));
}

#[test]
fn a_trace_loop_counts_what_it_hits() {
    let source = "surface counts () {
        float hits = 0, far = 0;
        color sum = 0;
        trace (\"set\", P, N, 0.5, 32) {
            float hit = 0, dist = 0; color c = 0;
            getmessage (\"trace\", \"hit\", hit);
            getmessage (\"trace\", \"hitdist\", dist);
            getmessage (\"trace\", \"Cl\", c);
            hits += hit;
            sum += c;
            if (dist > 5) far += 1;
        }
        C = color (hits, far, sum[0]);
    }";
    let mut f = Fixture::new(&[CONSTANT, source]);
    let floor = f.attributes("counts", &[], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    let lid = f.attributes("constant", &["set"], &[param("color C", &[0.5_f32; 3][..])]);
    f.rectangle([-100.0, -100.0], [0.0, 100.0], 2.0, lid);
    let grid = shade(&f, &floor, &[[-50.0, 0.0], [50.0, 0.0]]);
    near(grid.c.get(0), Color::new(32.0, 0.0, 16.0));
    near(grid.c.get(1), Color::new(0.0, 32.0, 0.0));
}

#[test]
fn hits_read_messages_of_the_shader_that_traced_the_ray() {
    let listens = "surface listens () {
        float x = -1; color k = 0; string who = \"\";
        float got = getmessage (\"parent\", \"x\", x) + 10 * getmessage (\"parent\", \"k\", k)
            + 100 * getmessage (\"parent\", \"who\", who) + 1000 * getmessage (\"parent\", \"none\", x);
        C = color (got, x, k[1]);
        if (who != \"floor\") C = 0;
    }";
    let tells = |rays: &str| {
        format!(
            "surface tells (color k = color (0.1, 0.25, 0.3)) {{
                setmessage (\"x\", 0); setmessage (\"who\", \"floor\");
                if (P[0] > 0) setmessage (\"x\", P[0]);
                C = 0; {rays}
            }}"
        )
    };
    for rays in [
        "trace (\"set\", P, N, 0, 1) { getmessage (\"trace\", \"Cl\", C); }",
        "C = environment (\"set\", N);",
        "C = indirect (\"set\", P, N, \"samples\", 1);",
        // Only messages that are set before the rays are traced have an effect.
        "C = environment (\"set\", N, \"samples\", 4); setmessage (\"x\", 77);",
    ] {
        let source = tells(rays);
        let mut f = Fixture::new(&[&source, listens]);
        let floor = f.attributes("tells", &[], &[]);
        let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
        let lid = f.attributes("listens", &["set"], &[]);
        f.rectangle([-500.0; 2], [500.0; 2], 2.0, lid);
        let grid = shade(&f, &floor, &[[-3.0, 0.0], [2.0, 0.0], [5.0, 1.0]]);
        for (lane, x) in [0.0, 2.0, 5.0].into_iter().enumerate() {
            assert!(
                (grid.c.get(lane) - Color::new(111.0, x, 0.25)).length() < 1e-3,
                "{rays} {lane}: {}",
                grid.c.get(lane)
            );
        }
        // The shader was not called by a ray, so it finds nothing.
        let lid = f.scene.primitives[1].clone();
        let grid = shade(&f, &lid, &[[0.0, 0.0]]);
        near(grid.c.get(0), Color::ZERO);
    }
}

#[test]
fn lit_surfaces_do_not_shadow_themselves() {
    // A matte ball is lit from the camera's side. No point that faces the light is in the ball's own shadow.
    let mut f = Fixture::new(&[MATTE, POINT]);
    let params = [param("string shadowname", "shadow")];
    f.light("pointlight", &params, Transform::translate(Vec3::Z * 8.0));
    let ball = f.attributes("matte", &["shadow"], &[]);
    let ball = f.sphere(Vec3::ZERO, 2.0, ball);
    let (scene, camera, environment) = f.finish();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    let object = frame.object(&ball);
    let places: Vec<Vec3> = (0..400)
        .map(|i| {
            let (u, v) = granita_base::sample::square(i, 11);
            let (z, turn) = (0.4 + 0.6 * u, v * std::f32::consts::TAU);
            Vec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z)
        })
        .collect();
    let mut grid = flat_grid(&vec![[0.0; 2]; places.len()]);
    for (i, n) in places.iter().enumerate() {
        grid.p.set(i, *n * 2.0);
        grid.n.set(i, *n);
        grid.ng.set(i, *n);
    }
    ShaderThread::new(&frame).shade(&object, &mut grid, &[]);
    for (i, n) in places.iter().enumerate() {
        let to = Vec3::Z * 8.0 - *n * 2.0;
        near(grid.c.get(i), Color::splat(n.dot(to) / to.length().powi(3)));
    }
}

#[test]
fn an_area_light_emits_from_its_surface() {
    // A small rectangle that faces down shines like a point. A light of many samples is their mean.
    let source = "light panel (string geometry = \"\") {
        point from = Pl;
        vector facing = normalize (Nl);
        emit (from) { Cl = max (0, -dot (L, facing) / length (L)) / dot (L, L); }
    }";
    for samples in [1, 16] {
        let mut f = Fixture::new(&[MATTE, CONSTANT, source]);
        f.light("panel", &[param("string geometry", "lamp")], Transform::IDENTITY);
        let light = std::sync::Arc::make_mut(&mut f.scene.lights[0]);
        let attributes = std::sync::Arc::make_mut(&mut light.attributes);
        let count = param("int light:nsamples", samples);
        std::sync::Arc::make_mut(&mut attributes.values).insert(count.name.clone(), count);
        let floor = f.attributes("matte", &[], &[]);
        let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
        let lamp = f.attributes("constant", &["lamp"], &[]);
        let lamp = granita_scene::AttributeSet { flip_normals: true, ..lamp };
        f.rectangle([-1e-3; 2], [1e-3; 2], 2.0, lamp);
        let grid = shade(&f, &floor, &[[0.0, 0.0], [2.0, 0.0]]);
        for (i, x) in [(0, 0.0_f32), (1, 2.0)] {
            // The product of the cosines at both ends, divided by the squared distance.
            let r2 = x * x + 4.0;
            let expected = 4.0 / r2 / r2;
            assert!((grid.c.get(i) - Color::splat(expected)).length() < 2e-3 * expected, "{}", grid.c.get(i));
        }
        assert_eq!(f.complaints(), Vec::<String>::new());
    }
}

#[test]
fn samples_of_an_area_light_use_different_random_numbers() {
    // Under the edge of a wall a wide shadow ray is blocked or not. Sixteen of them rarely agree.
    let source = "light panel (string geometry = \"\") {
        point from = Pl;
        emit (from) { Cl = 1 - (color) shadow (\"wall\", Ps, \"blur\", 0.6, \"samples\", 1); }
    }";
    let mut f = Fixture::new(&[MATTE, CONSTANT, source]);
    f.light("panel", &[param("string geometry", "lamp")], Transform::IDENTITY);
    let light = std::sync::Arc::make_mut(&mut f.scene.lights[0]);
    let attributes = std::sync::Arc::make_mut(&mut light.attributes);
    let count = param("int light:nsamples", 16);
    std::sync::Arc::make_mut(&mut attributes.values).insert(count.name.clone(), count);
    let floor = f.attributes("matte", &[], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    let lamp = f.attributes("constant", &["lamp"], &[]);
    f.rectangle([-1e-3; 2], [1e-3; 2], 2.0, lamp);
    let wall = f.attributes("constant", &["wall"], &[]);
    f.rectangle([-1.02, -9.0], [9.0, 9.0], 1.0, wall);
    let (scene, camera, environment) = f.finish();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    let object = frame.object(&floor);
    for named in [false, true] {
        let mut grid = flat_grid(&[[-2.0, 0.5]; 50]);
        grid.names = if named { (0..50).map(|i| i * 7 + 1).collect() } else { Vec::new() };
        ShaderThread::new(&frame).shade(&object, &mut grid, &[]);
        // At points that are not shadowed the value is the cosine, 0.7.
        let mixed = grid.c.xyz[0].iter().filter(|c| (0.04..0.64).contains(*c)).count();
        assert!(mixed > 45, "{named}: {mixed} of 50, {:?}", &grid.c.xyz[0][..5]);
    }
}
