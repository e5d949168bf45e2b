//! Tests of `lights`, `emit`, illumination functions and `trace` (reference 5.5.5, 5.8.11).

use crate::fixture::*;
use granita_base::{Params, Vec3};
use granita_gsl::ir::ValueType;

const POINT: &str = "light p () { emit (point (0, 0, -2)) { Cl = 4 / dot (L, L); } }";
const SUN: &str =
    "light s (string __category = \"key,sun\") { emit (vector (0, 0, 1), 0) { Cl = color (1, 0.5, 0.25); } }";
const BEHIND: &str = "light b () { emit (vector (0, 0, -1), 0) { Cl = 100; } }";
const AMBIENT: &str = "light a (float intensity = 0.125) { Cl = intensity; }";

/// Returns `r` at the corner u = v = 0, which is the origin.
fn corner(lights: &[&str], body: &str) -> f32 {
    floats_with(body, &mut Double::with_lights(lights))[0]
}

#[test]
fn lights_emit_with_their_direction_and_colour() {
    assert_eq!(corner(&[POINT], "r = 0; lights (P) { r += Cl[0]; }"), 1.0);
    assert_eq!(corner(&[POINT], "r = 0; lights (P) { r += L[2] * 10 + Pl[2]; }"), -22.0);
    assert_eq!(corner(&[SUN], "r = 0; lights (P) { r += L[2] * 10 + Cl[1]; }"), -9.5);
    // The point is in the cone, beside it, and on its rim.
    let spot = |angle: &str| {
        format!("light s () {{ emit (point (1, 0, -1), vector (0, 0, 1), {angle}) {{ Cl = 1; }} }}")
    };
    assert_eq!(corner(&[&spot("0.5")], "r = 0; lights (P) { r += 1; }"), 0.0);
    assert_eq!(corner(&[&spot("0.8")], "r = 0; lights (P) { r += 1; }"), 1.0);
    // The reflection is straight back.
    let mirror = "light m () { emit () { Cl = 1; } }";
    assert_eq!(corner(&[mirror], "r = 0; lights (P) { r += L[2]; }"), -1.0);
    // Every emission is a sample. Emissions start black.
    let two = "light t () { emit (point (0, 0, -1)) { Cl = 1; } emit (point (0, 0, -1)) { if (Ps[0] < 0.1) Cl = 2; } }";
    assert_eq!(
        floats_with("r = 0; lights (P) { r += Cl[0]; }", &mut Double::with_lights(&[two]))[..2],
        [3.0, 1.0]
    );
}

#[test]
fn lights_read_the_globals_of_the_surface_and_the_query() {
    let asks = "light q () { emit (point (0)) { Cl = color (Ps[0], Ns[1], N[2]); } }";
    let body = "r = 0; lights (P + vector (5, 0, 0), vector (0, 7, 0), PI) { r = Cl[0] * 100 + Cl[1] * 10 + Cl[2]; }";
    assert_eq!(corner(&[asks], body), 569.0);
    assert_eq!(corner(&[asks], "r = 0; lights (P) { r = Cl[1]; }"), 0.0);
}

#[test]
fn cones_and_categories_choose_lights() {
    let all = [POINT, SUN, BEHIND, AMBIENT];
    let count = |head: &str| corner(&all, &format!("r = 0; lights ({head}) {{ r += 1; }}"));
    assert_eq!(count("P"), 3.0);
    assert_eq!(count("P, N, PI / 2"), 2.0);
    assert_eq!(count("P, -N, PI / 2"), 1.0);
    assert_eq!(count("\"sun\", P"), 1.0);
    assert_eq!(count("\"sun&!key\", P"), 0.0);
    assert_eq!(count("\"-*\", P"), 2.0);
    assert_eq!(count("\"key\", P, N, 0.1"), 1.0);
}

#[test]
fn bodies_of_light_loops_skip_lanes_that_have_left() {
    let two = [SUN, SUN];
    let body = "r = 0; lights (P) { r += 1; if (u > 0.7) exit (); } r += 10;";
    assert_eq!(floats_with(body, &mut Double::with_lights(&two))[..3], [12.0, 12.0, 1.0]);
    let source = "float f (float x) { lights (P) { if (x > 0.7) return 5; } return 6; } \
                  surface t (output float r = 0) { r = f (u); }";
    let group = link(&[(source, Params::new())], &[]);
    let r = output(&group, &mut square(3, 1), &mut Double::with_lights(&two), "r", ValueType::Float);
    assert_eq!(r, [6.0, 6.0, 5.0]);
    // A loop inside a loop restores the light of the outer one.
    let nested = "r = 0; lights (\"sun\", P) { lights (\"-*\", P) { r += 1; } r += Cl[1] * 100; }";
    assert_eq!(corner(&[SUN, POINT], nested), 51.0);
}

#[test]
fn diffuse_specular_and_ambient_sum_the_lights() {
    let near = |a: f32, b: f32| assert!((a - b).abs() < 1e-6, "{a} {b}");
    near(corner(&[SUN, BEHIND, AMBIENT], "color c = diffuse (N); r = c[1];"), 0.5);
    near(corner(&[SUN], "color c = diffuse (normalize (N + vector (0, 1, 0))); r = c[0];"), 0.5_f32.sqrt());
    near(corner(&[SUN, AMBIENT, AMBIENT], "color c = ambient (); r = c[2];"), 0.25);
    near(corner(&[SUN], "color c = ambient () + 1; r = c[2];"), 1.0);
    near(corner(&[], "color c = ambient () + diffuse (N) + specular (N, N, 0.1); r = c[2];"), 0.0);
    near(corner(&[SUN], "color c = specular (N, -I, 0.1); r = c[1];"), 0.5);
    // H differs from the normal by 22.5 degrees.
    let body = "vector V = normalize (vector (0, 1, -1)); color c = specular (N, V, 0.5); r = c[0];";
    near(corner(&[SUN], body), (std::f32::consts::PI / 8.0).cos().powi(16));
    near(corner(&[], "color c = specularbrdf (-I, N, -I, 0.1); r = c[0];"), 1.0);
    // The result is that of the reference's definition.
    let own = "color c = 0; lights (P, N, PI / 2) c += Cl * max (0, dot (normalize (L), N)); \
               color d = diffuse (N); r = c[0] - d[0];";
    near(corner(&[SUN, POINT, BEHIND], own), 0.0);
}

#[test]
fn lights_may_exclude_themselves_from_diffuse_and_specular() {
    let partly = "light p (output float __nondiffuse = 0.25, float __nonspecular = 1) { emit (vector (0, 0, 1), 0) { Cl = 1; } }";
    assert_eq!(corner(&[partly], "color c = diffuse (N); r = c[0];"), 0.75);
    assert_eq!(corner(&[partly], "color c = specular (N, -I, 0.1); r = c[0];"), 0.0);
    // The value is written in the body, per point.
    let later = "light p (output float __nondiffuse = 0) { emit (vector (0, 0, 1), 0) { Cl = 1; } __nondiffuse = Ps[0]; }";
    let d = floats_with("color c = diffuse (N); r = c[0];", &mut Double::with_lights(&[later]));
    assert_eq!(d[..3], [1.0, 0.5, 0.0]);
}

#[test]
fn lights_run_for_the_active_lanes_only() {
    let says = "light s () { emit (point (0, 0, -1)) { Cl = 1; printf (\"%g\", Ps[0]); } }";
    let mut services = Double::with_lights(&[says]);
    let r = floats_with("r = 0; if (u > 0.2) lights (P) { r += Cl[0]; }", &mut services);
    assert_eq!(r[..3], [0.0, 1.0, 1.0]);
    assert_eq!(services.printed(), ["0.5", "1", "0.5", "1"]);
}

#[test]
fn layered_lights_pass_values_between_layers() {
    let layers = [
        ("light a (output float k = 0) { k = 3; }", Params::new()),
        ("light b (float k = 1) { emit (point (0, 0, -1)) { Cl = k; } }", Params::new()),
    ];
    let group = link(&layers, &[["a", "k", "b", "k"]]);
    assert!(group.has_emit());
    let mut services = Double::default();
    services.lights.push((group, granita_shade::LightInfo::default()));
    assert_eq!(floats_with("r = 0; lights (P) { r += Cl[1]; }", &mut services)[0], 3.0);
}

#[test]
fn lights_know_when_only_the_front_hemisphere_counts() {
    // A variable angle may vary on grids that are shaded together and be the same for all points of one of them.
    for (body, expected) in [
        ("color c = diffuse (N); r = c[0];", true),
        ("lights (P, N, M_PI_2) { r = Cl[0]; }", true),
        ("lights (P, N, M_PI) { r = Cl[0]; }", false),
        ("lights (P) { r = Cl[0]; }", false),
        (
            "float a = M_PI_2; if (u > 99) { float k; for (k = 0; k < u; k += 1) a += 1; } lights (P, N, a) { r = Cl[0]; }",
            false,
        ),
    ] {
        let mut services = Double::with_lights(&["light s () { emit (point (0, 0, -2)) { Cl = 1; } }"]);
        floats_with(body, &mut services);
        assert_eq!(services.in_front, [expected], "{body}");
    }
}

#[test]
fn shadow_queries_have_the_position_of_the_light() {
    let shadowed = |emit: &str| format!("light s () {{ {emit} {{ Cl = 1 - shadow (\"set\", Ps); }} }}");
    let mut services = Double::with_lights(&[
        &shadowed("emit (point (0, 0, -2))"),
        &shadowed("emit (vector (0, 0, 1), 0)"),
        &shadowed("emit (vector (0, 0, 1), 0.25)"),
    ]);
    let body = "r = 0; lights (P) { r += Cl[0]; } r += shadow (\"map\", P); \
                color c = shadow (\"map\", P, vector (1), vector (2)); r += c[1] - 0.25;";
    let r = floats_with(body, &mut services);
    assert_eq!(r[0], 2.5);
    assert_eq!(
        services.shadow_queries,
        [
            (Vec3::new(0.0, 0.0, -2.0), false, None),
            (Vec3::new(0.0, 0.0, -1.0), true, None),
            (Vec3::new(0.0, 0.0, -1.0), true, Some(0.125)),
            (Vec3::ZERO, false, None),
            (Vec3::ZERO, false, None),
        ]
    );
}

#[test]
fn trace_loops_and_ray_functions_give_their_results() {
    let body = "r = 0; trace (\"set\", P, N, 0.5, 3) { float h = 0, d = 0; color c = 0; \
                getmessage (\"trace\", \"hit\", h); getmessage (\"trace\", \"hitdist\", d); \
                getmessage (\"trace\", \"Cl\", c); r += h * 100 + d + c[1]; }";
    assert_eq!(corner(&[], body), 207.5);
    // The number of samples may differ from point to point.
    let body = "r = 0; trace (\"set\", P, N, 0.5, 1 + u * 2, \"bias\", 0.1) r += 1;";
    assert_eq!(floats(body)[..3], [1.0, 2.0, 3.0]);
    assert_eq!(corner(&[], "r = 7; trace (\"set\", P, N, 0.5, 0) r += 1;"), 7.0);
    assert_eq!(corner(&[], "float x = 0; r = getmessage (\"trace\", \"hit\", x);"), 0.0);
    assert_eq!(corner(&[], "r = occlusion (\"set\", P, N, 0.5, \"samples\", 16);"), 0.0);
    // No ray hit a surface. The mean open direction is the axis.
    assert_eq!(
        corner(&[], "vector o = 0; r = occlusion (\"set\", P, N, 0.5, o, \"samples\", 16) + o[2];"),
        -1.0
    );
    assert_eq!(corner(&[], "color c = indirect (\"set\", P, N, \"samples\", 16); r = c[0];"), 0.0);
}
