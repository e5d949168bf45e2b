//! Shaders that show their albedo.

use super::*;

/// Shades points of the plane z = 0 as their albedo.
fn albedo(f: &Fixture, primitive: &Primitive, points: &[[f32; 2]]) -> Grid {
    let (scene, camera, environment) = f.finish();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    let object = frame.object(primitive);
    let mut grid = flat_grid(points);
    grid.c = Lanes3::splat(object.color, grid.len());
    grid.opacity = Lanes3::splat(object.opacity, grid.len());
    let mut thread = ShaderThread::new(&frame);
    thread.shows_albedo = true;
    thread.shade(&object, &mut grid, &[]);
    assert_eq!((frame.statistics().rays, frame.statistics().ray_structures_built), (0, 0));
    grid
}

/// Returns a scene with a lamp in the shadow of a lid, and a floor with this surface shader.
fn scene(shader: &str) -> (Fixture, Arc<Primitive>) {
    let mut f = Fixture::new(&[shader, CONSTANT, POINT]);
    let params = [param("string shadowname", "all"), param("float intensity", 500.0)];
    f.light("pointlight", &params, Transform::translate(Vec3::Z * 2.0));
    let color = [param("color C", &[0.8, 0.4, 0.2][..])];
    let floor = f.attributes("shown", &["all"], &color);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    let lid = f.attributes("constant", &["all"], &[]);
    f.rectangle([-2.0; 2], [2.0; 2], 1.0, lid);
    (f, floor)
}

#[test]
fn the_albedo_is_the_colour_that_light_is_multiplied_by() {
    for (body, factor) in [
        ("C *= diffuse (normalize (N));", 1.0),
        ("C *= 0.5 * diffuse (N) + specular (normalize (N), -normalize (I), 0.1);", 0.5),
        (
            "color sum = 0; lights (P, N, PI / 2) sum += Cl * dot (normalize (N), normalize (L)); C *= sum;",
            1.0,
        ),
        ("C *= 1 - occlusion (\"all\", P, N, PI / 2);", 1.0),
        ("C *= 0.25 * indirect (\"all\", P, N);", 0.25),
        ("C *= environment (\"all\", reflect (I, N));", 1.0),
        ("C *= environment (\"no.env\", N, \"samples\", 4);", 1.0),
        ("C *= 1 - shadow (\"all\", P, N, N);", 1.0),
    ] {
        let (f, floor) = scene(&format!("surface shown () {{ {body} }}"));
        let grid = albedo(&f, &floor, &[[0.0, 0.0], [3.0, -2.0], [8.0, 8.0]]);
        for i in 0..grid.len() {
            near(grid.c.get(i), factor * Vec3::new(0.8, 0.4, 0.2));
        }
        assert_eq!(f.complaints(), Vec::<String>::new(), "{body}");
    }
}

#[test]
fn shaders_see_their_lights_again_when_no_albedo_is_wanted() {
    let (f, floor) = scene("surface shown () { C *= diffuse (normalize (N)); }");
    let points = [[0.0, 0.0], [8.0, 8.0]];
    let lit = shade(&f, &floor, &points);
    assert_eq!(lit.c.get(0), Vec3::ZERO, "it is in the shadow of the lid");
    assert!(lit.c.get(1).x > 0.0);
    near(albedo(&f, &floor, &points).c.get(0), Vec3::new(0.8, 0.4, 0.2));
}
