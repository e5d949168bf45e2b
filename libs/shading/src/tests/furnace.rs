//! Tests white furnaces. Where light is the same everywhere, a white surface that conserves energy is invisible.

use super::*;
use crate::fixture::shader;
use granita_base::Param;
use granita_scene::AttributeSet;

/// The bundled surface shaders whose result is not reflected light. It is a parameter, a normal, the effect of a light,
/// or the content of a file.
const NO_SURFACES: [&str; 18] = [
    "ambocclude",
    "bakediffuse",
    "keyfillrim",
    "movephotons",
    "nullsurface",
    "pretexture",
    "raygoggles",
    "shootphotons",
    "showN",
    "showdudv",
    "showfacing",
    "showgrids",
    "shownormals",
    "showst",
    "showuv",
    "subsurflayer",
    "dispmap",
    "envlight",
];

const AMBIENT: &str = "light everywhere () { Cl = 1; }";

/// The share of a white light that a surface reflects.
#[derive(Clone, Copy, PartialEq)]
enum Kept {
    All,
    AtMost,
    Share(f32),
}
use Kept::{All, AtMost, Share};

/// Bundled surfaces, their parameters, and the share of an ambient light of 1 that is reflected with a surface
/// colour of 1.
fn surfaces() -> Vec<(&'static str, Vec<Param>, Kept)> {
    let f = |name: &str, x: f32| param(&format!("float {name}"), x);
    vec![
        ("matte", vec![], All),
        ("matte", vec![f("Ka", 0.5)], Share(0.5)),
        ("plastic", vec![], All),
        ("metal", vec![], All),
        ("paintedplastic", vec![], All),
        ("texmap", vec![], All),
        ("mtlsurface", vec![], All),
        ("gltfsurface", vec![f("metallic", 1.0)], All),
        ("gltfsurface", vec![f("metallic", 0.0)], All),
        ("gltfsurface", vec![f("metallic", 0.3), f("roughness", 0.4)], All),
        ("gltfsurface", vec![f("unlit", 1.0)], All),
        ("plasticss", vec![], All),
        ("shiny", vec![], All),
        ("shinymetal", vec![], All),
        ("shinyplastic", vec![], All),
        ("screen", vec![f("density", 1.0)], All),
        ("screen", vec![], AtMost),
        ("constant", vec![], All),
        ("envsurf", vec![], All),
        // The surface has its own light at the eye.
        ("defaultsurface", vec![], AtMost),
        // The surface is grey by design.
        ("clay", vec![], Share(0.7)),
        // The surface is transparent and shows what is behind.
        ("glass", vec![], AtMost),
        // The surface has its own colours.
        ("oak", vec![], AtMost),
        ("greenmarble", vec![], AtMost),
        ("studioback", vec![], AtMost),
        // The surface shows shadows only.
        ("studiofloor", vec![], AtMost),
    ]
}

fn source(name: &str) -> &'static str {
    granita_bundled::shader(name).unwrap_or_else(|| panic!("no {name}"))
}

/// Returns colours of points with the normal +z, seen from 0, 40 and 75 degrees.
fn seen(f: &Fixture, primitive: &Primitive) -> Vec<(Color, Color)> {
    let (scene, camera, environment) = f.finish();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    let object = frame.object(primitive);
    let angles = [0.0_f32, 40.0, 75.0];
    let mut grid = flat_grid(&[[0.013, 0.0], [0.02, 0.017], [0.0, 0.011]]);
    for (k, angle) in angles.into_iter().enumerate() {
        let (sin, cos) = angle.to_radians().sin_cos();
        grid.i.set(k, Vec3::new(sin, 0.0, -cos));
    }
    grid.c = granita_shade::Lanes3::splat(object.color, 3);
    grid.opacity = granita_shade::Lanes3::splat(object.opacity, 3);
    ShaderThread::new(&frame).shade(&object, &mut grid, &[]);
    (0..3).map(|k| (grid.c.get(k), grid.opacity.get(k))).collect()
}

fn check(what: &str, seen: &[(Color, Color)], kept: Kept) {
    for (k, (c, _)) in seen.iter().enumerate() {
        assert!(c.min_element() >= 0.0 && c.max_element() <= 1.001, "{what}, view {k}: {c}");
        let expected = match kept {
            All => 1.0,
            Share(x) => x,
            AtMost => continue,
        };
        assert!((*c - expected).abs().max_element() < 1e-3, "{what}, view {k}: {c}");
    }
}

fn surface_of(f: &Fixture, name: &str, params: &[Param], sets: &[&str]) -> AttributeSet {
    let white = param("color C", &[1.0_f32; 3][..]);
    let surface = Some(shader(name, params, Transform::IDENTITY));
    AttributeSet { surface, ..f.attributes("", sets, &[white]) }
}

#[test]
fn every_bundled_surface_has_a_furnace_test() {
    let list = surfaces();
    for name in granita_bundled::shader_names() {
        let is_surface = source(name).lines().any(|line| line.starts_with("surface "));
        let known = list.iter().any(|s| s.0 == name) || NO_SURFACES.contains(&name);
        assert!(!is_surface || known, "{name}");
    }
}

/// Functions of whole grids would have each grid of a few points shaded alone, which takes much longer.
#[test]
fn small_grids_of_bundled_surfaces_are_shaded_together() {
    let surfaces = granita_bundled::shader_names()
        .filter(|name| source(name).lines().any(|line| line.starts_with("surface ")));
    let mut alone = Vec::new();
    for name in surfaces {
        let mut f = Fixture::new(&[source(name)]);
        let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, surface_of(&f, name, &[], &[]));
        let (scene, camera, environment) = f.finish();
        if !ShadingContext::new(&scene, &camera, &environment).object(&floor).may_batch {
            alone.push(name);
        }
    }
    // One shows grids, and the other sends photons from the middle of each.
    assert_eq!(alone, ["shootphotons", "showgrids"]);
}

#[test]
fn surfaces_reflect_ambient_light_unchanged() {
    for (name, params, kept) in surfaces() {
        let mut f = Fixture::new(&[AMBIENT, source(name)]);
        f.light("everywhere", &[], Transform::IDENTITY);
        let own = surface_of(&f, name, &params, &[]);
        let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, own);
        check(&format!("{name} {params:?}"), &seen(&f, &floor), kept);
        assert_eq!(f.complaints(), Vec::<String>::new());
    }
}

#[test]
fn surfaces_under_a_dome_of_lights_reflect_no_more_than_it_emits() {
    // The lights are distributed over the upper half sphere with equal brightness. Their cosines sum to 1.
    let lamp = "light lamp (float bright = 1) { emit (vector (\"shader\", 0, 0, -1), 0) { Cl = bright; } }";
    let count = 400;
    let place = |k: usize| {
        let z = (k as f32 + 0.5) / count as f32;
        (z, k as f32 * 2.399_963)
    };
    let cosines: f32 = (0..count).map(|k| place(k).0).sum();
    for (name, params, kept) in surfaces() {
        let mut f = Fixture::new(&[lamp, source(name)]);
        for k in 0..count {
            let (z, turn) = place(k);
            let way = Transform::rotate(turn, Vec3::Z).then(&Transform::IDENTITY);
            let way = Transform::rotate(z.acos(), Vec3::Y).then(&way);
            f.light("lamp", &[param("float bright", 1.0 / cosines)], way);
        }
        let own = surface_of(&f, name, &params, &[]);
        let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, own);
        // The other part of the light is lost. Only a matte surface reflects all of it.
        let diffuse = ["matte", "texmap", "mtlsurface", "constant", "envsurf"].contains(&name) && kept == All;
        check(&format!("{name} {params:?}"), &seen(&f, &floor), if diffuse { All } else { AtMost });
    }
}

#[test]
fn uniform_surroundings_are_reflected_and_refracted_unchanged() {
    let f = |name: &str, x: f32| param(&format!("float {name}"), x);
    let all = || param("string envname", "all");
    let cases: [(&str, Vec<Param>, Kept); 8] = [
        ("glass", vec![all()], All),
        ("glass", vec![all(), f("eta", 2.4)], All),
        ("shiny", vec![all(), f("Kr", 1.0)], All),
        ("shiny", vec![all()], Share(0.5)),
        ("shinymetal", vec![all()], All),
        ("shinymetal", vec![all(), f("blur", 0.3), f("samples", 16.0)], All),
        ("shinyplastic", vec![all()], AtMost),
        ("envsurf", vec![all()], All),
    ];
    for (name, params, kept) in cases {
        let mut fixture = Fixture::new(&[CONSTANT, source(name)]);
        fixture.global("int ray:maxdepth", 6);
        // Rays beyond the maximal depth return the furnace's colour, too.
        fixture.global("color ray:maxdepthcolor", &[1.0_f32; 3][..]);
        let own = surface_of(&fixture, name, &params, &["all"]);
        // The seen points are at the top of a ball.
        let ball = fixture.sphere(-Vec3::Z, 1.0, own);
        let white = param("color C", &[1.0_f32; 3][..]);
        let sky = fixture.attributes("constant", &["all"], &[white]);
        fixture.sphere(Vec3::ZERO, 50.0, sky);
        check(&format!("{name} {params:?}"), &seen(&fixture, &ball), kept);
    }
}
