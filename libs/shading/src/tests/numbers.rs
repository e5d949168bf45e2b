//! Tests values that are not finite: one message names their source, and finite values replace them.

use super::*;
use crate::fixture::shader;

/// Shades two points of a rectangle with a surface, before another one at z = 1 in the set "box", both under the
/// fixture's lights.
fn shaded(
    f: &mut Fixture,
    surface: &str,
    params: &[granita_base::Param],
    values: &[granita_base::Param],
) -> Grid {
    let named: Vec<_> = values.iter().cloned().chain([param("string name", "plate")]).collect();
    let mut own = f.attributes(surface, &["box"], &named);
    own.surface = Some(shader(surface, params, Transform::IDENTITY));
    let upper = f.attributes("looks", &["box"], &[param("string name", "ceiling")]);
    f.rectangle([-2.0; 2], [2.0; 2], 1.0, upper);
    let plate = f.rectangle([-2.0; 2], [2.0; 2], 0.0, own);
    let (scene, camera, environment) = f.finish();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    let object = frame.object(&plate);
    let mut grid = flat_grid(&[[0.25, 0.25], [0.5, 0.5]]);
    grid.c = granita_shade::Lanes3::splat(object.color, 2);
    grid.opacity = granita_shade::Lanes3::splat(object.opacity, 2);
    ShaderThread::new(&frame).shade(&object, &mut grid, &[]);
    grid
}

const LOOKS: &str = "surface looks () { C = 0.5; }";
const MATT: &str = "surface matt () { C = diffuse (N) + ambient (); }";
const DIFFICULT: &str = "light difficult (float intensity = 1, point from = point (0, 0, 5), float odd = 0) {
    emit (from) Cl = intensity * (odd > 0 && Ps[0] < 0.3 ? log (-1) : 1);
}";
const BRIGHT: &str = "light bright (float intensity = 1) { Cl = intensity; }";

#[test]
fn lights_with_invalid_values_stay_dark_and_are_reported() {
    let text = "warning: light \"light0\": its shader gave a colour or direction that is not a number or is larger than 1e30; 0 is used";
    let odd = [
        param("float intensity", f32::NAN),
        param("float intensity", f32::INFINITY),
        param("float intensity", 1e38),
        param("point from", &[f32::NAN; 3][..]),
        param("point from", &[f32::INFINITY, 0.0, 0.0][..]),
    ];
    for wrong in odd {
        let mut f = Fixture::new(&[LOOKS, MATT, DIFFICULT]);
        f.light("difficult", &[wrong], Transform::IDENTITY);
        f.light("difficult", &[], Transform::IDENTITY);
        let grid = shaded(&mut f, "matt", &[], &[]);
        // The other light still shines.
        assert!((0..2).all(|k| grid.c.get(k).min_element() > 0.5 && grid.c.get(k).max_element() <= 1.0));
        assert_eq!(f.complaints(), [text]);
    }
    // Points with valid light stay unchanged.
    let mut f = Fixture::new(&[LOOKS, MATT, DIFFICULT]);
    f.light("difficult", &[param("float odd", 1.0)], Transform::IDENTITY);
    let grid = shaded(&mut f, "matt", &[], &[]);
    assert_eq!(grid.c.get(0), Color::ZERO);
    assert!(grid.c.get(1).min_element() > 0.5);
    assert_eq!(f.complaints(), [text]);
    let mut f = Fixture::new(&[LOOKS, MATT, BRIGHT]);
    f.light("bright", &[param("float intensity", f32::NAN)], Transform::IDENTITY);
    assert_eq!(shaded(&mut f, "matt", &[], &[]).c.get(0), Color::ZERO);
    assert_eq!(f.complaints(), [text]);
}

#[test]
fn values_of_hits_are_finite() {
    let mirror = "surface mirror () { C = environment (\"box\", vector (0, 0, 1)); opacity = 1; }";
    for (value, what) in [("log (-1)", "colour"), ("1 / (u - u)", "colour"), ("exp (80) * exp (8)", "colour")]
    {
        let looks = format!("surface looks () {{ C = color (0.5, {value}, 0.25); }}");
        let mut f = Fixture::new(&[&looks, mirror]);
        let grid = shaded(&mut f, "mirror", &[], &[]);
        assert_eq!(grid.c.get(0), Color::new(0.5, 0.0, 0.25), "{value}");
        let text = format!(
            "warning: object \"ceiling\": its shader gave a {what} that is not a number or is larger than 1e30; 0 is used"
        );
        assert_eq!(f.complaints(), [text], "{value}");
    }
    // An opacity above 1 hides no more than an opacity of 1.
    let layers = "surface looks () { C = 0.5; opacity = 1e20; }";
    let mut f = Fixture::new(&[layers, mirror]);
    let behind = f.attributes("looks", &["box"], &[]);
    f.rectangle([-2.0; 2], [2.0; 2], 2.0, behind.clone());
    f.rectangle([-2.0; 2], [2.0; 2], 3.0, behind);
    assert_eq!(shaded(&mut f, "mirror", &[], &[]).c.get(0), Color::splat(0.5));
}

#[test]
fn opacities_of_objects_are_clamped_from_0_to_1() {
    let shows = "surface shows () { C = opacity; }";
    for (given, counts) in
        [([1e20_f32, 0.5, -3.0], [1.0_f32, 0.5, 0.0]), ([f32::NAN, 1.0, 0.0], [1.0, 1.0, 0.0])]
    {
        let mut f = Fixture::new(&[LOOKS, shows]);
        let grid = shaded(&mut f, "shows", &[], &[param("color opacity", &given[..])]);
        assert_eq!(grid.c.get(0), Color::from_array(counts));
        let [text] = &f.complaints()[..] else { panic!("{:?}", f.complaints()) };
        assert!(text.starts_with("warning: object \"plate\": \"opacity\" ("), "{text}");
        assert!(text.ends_with(": it must be from 0 to 1"), "{text}");
    }
    let mut f = Fixture::new(&[LOOKS, shows]);
    shaded(&mut f, "shows", &[], &[param("color opacity", &[0.0_f32, 0.5, 1.0][..])]);
    assert_eq!(f.complaints(), Vec::<String>::new());
}
