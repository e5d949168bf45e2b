//! Tests rays against closed forms, and the options of the functions that trace them.

use super::*;
use std::f32::consts::{FRAC_PI_4, PI};

/// Shades points as [`grid_at`] has them. Also returns the counts of the frame.
fn shade_at(f: &Fixture, primitive: &Primitive, points: &[[Vec3; 3]]) -> (Grid, ShadingStatistics) {
    shade_grid(f, primitive, grid_at(points))
}

fn white() -> Param {
    param("color C", &[1.0_f32; 3][..])
}

#[test]
fn a_ray_between_mirrors_is_attenuated_equally_at_each() {
    // Two mirrors of reflectance r face each other, with a wall beyond their end. A ray that climbs 1 over a
    // distance of t hits as many mirrors as fit, and returns r to that power.
    let mirror = "surface mirror (color r = color (0.9, 0.8, 0.5)) {
        C = r * environment (\"box\", reflect (normalize (I), normalize (N)));
    }";
    let mut f = Fixture::new(&[CONSTANT, mirror]);
    f.global("int ray:maxdepth", 40);
    let own = f.attributes("mirror", &["box"], &[]);
    let floor = f.rectangle([-2.0, -2.0], [10.0, 2.0], 0.0, own.clone());
    f.rectangle([-2.0, -2.0], [10.0, 2.0], 1.0, own);
    let wall = f.attributes("constant", &["box"], &[param("color C", &[1.0_f32, 0.5, 0.25][..])]);
    let at = |y: f32, z: f32| Vec3::new(11.0, y, z);
    quad(&mut f, [at(-9.0, -40.0), at(9.0, -40.0), at(9.0, 40.0), at(-9.0, 40.0)], wall);
    let slopes = [30.0, 8.1, 4.3, 2.7, 1.37, 0.97, 0.61, 0.43];
    let points = slopes.map(|t| [Vec3::new(0.05, 0.1, 0.0), Vec3::Z, Vec3::new(t, 0.0, -1.0)]);
    let (grid, _) = shade_at(&f, &floor, &points);
    for (k, t) in slopes.into_iter().enumerate() {
        // Mirrors are hit at x = 0.05 + k t, up to x = 10.
        let met = ((10.0 - 0.05) / t).floor() as i32 + 1;
        let expected = Color::new(1.0, 0.5, 0.25) * Color::new(0.9, 0.8, 0.5).powf(met as f32);
        assert!((grid.c.get(k) - expected).abs().max_element() < 1e-5, "{t}: {met} {}", grid.c.get(k));
    }
    assert_eq!(f.complaints(), Vec::<String>::new());
}

#[test]
fn a_mirror_box_darkens_to_the_colour_of_the_deepest_ray() {
    let mirror =
        "surface mirror () { C = 0.75 * environment (\"box\", reflect (normalize (I), normalize (N))); }";
    for depth in [0, 1, 2, 5, 9] {
        let mut f = Fixture::new(&[mirror]);
        f.global("int ray:maxdepth", depth);
        f.global("color ray:maxdepthcolor", &[1.0_f32, 0.5, 0.25][..]);
        let mut floor = None;
        for axis in 0..3 {
            for side in [-1.0_f32, 1.0] {
                let own = f.attributes("mirror", &["box"], &[]);
                let corner = |a: f32, b: f32| {
                    let mut p = Vec3::ZERO;
                    p[axis] = side;
                    p[(axis + 1) % 3] = a;
                    p[(axis + 2) % 3] = b;
                    p
                };
                quad(
                    &mut f,
                    [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
                    own,
                );
                floor = f.scene.primitives.last().cloned();
            }
        }
        let points = [[0.3, 0.1], [-0.7, 0.55], [0.05, -0.91]]
            .map(|[x, y]| [Vec3::new(x, y, 1.0), -Vec3::Z, Vec3::new(0.31 + y, 0.17, 0.83)]);
        let (grid, _) = shade_at(&f, &floor.unwrap(), &points);
        for k in 0..points.len() {
            near(grid.c.get(k), Color::new(1.0, 0.5, 0.25) * 0.75_f32.powi(depth + 1));
        }
    }
}

#[test]
fn deep_reflections_do_not_overflow_the_stack() {
    // Two mirrors face each other, and a ray is reflected between them without end.
    let mirror = "surface mirror (float r = 0.999) {
        C = r * environment (\"box\", reflect (normalize (I), normalize (N))) + r * 0.001;
    }";
    for depth in [130, 999, 1000, 1001, 10_000] {
        let mut f = Fixture::new(&[mirror]);
        f.global("int ray:maxdepth", depth);
        f.global("color ray:maxdepthcolor", &[1.0_f32; 3][..]);
        let own = f.attributes("mirror", &["box"], &[param("string name", "looking glass")]);
        let floor = f.rectangle([-2.0; 2], [2.0; 2], 0.0, own.clone());
        f.rectangle([-2.0; 2], [2.0; 2], 1.0, own);
        let points = [[Vec3::ZERO, Vec3::Z, -Vec3::Z], [Vec3::X, Vec3::Z, -Vec3::Z]];
        // The default stack of a thread is enough.
        let grid = std::thread::scope(|s| s.spawn(|| shade_at(&f, &floor, &points).0).join().unwrap());
        let levels = depth.min(1000) + 1;
        let expected = (0..levels).fold(1.0_f32, |sum, _| sum * 0.999 + 0.000999);
        for k in 0..2 {
            assert!(
                (grid.c.get(k) - expected).abs().max_element() < 1e-4,
                "{depth}: {} {expected}",
                grid.c.get(k)
            );
        }
        let said = f.complaints();
        if depth <= 1000 {
            assert_eq!(said, Vec::<String>::new());
        } else {
            let text = format!(
                "warning: object \"looking glass\": rays are followed 1000 levels deep only \
                 (\"ray:maxdepth\" is {depth})"
            );
            assert_eq!(said, [text]);
        }
    }
}

#[test]
fn rays_end_when_the_frame_is_stopped() {
    // Each hit traces two rays, which would be 2 to the power of 60 rays in all.
    let glass = "surface glass () {
        C = environment (\"box\", reflect (normalize (I), normalize (N))) + environment (\"box\", -normalize (I)) + 1;
    }";
    let mut f = Fixture::new(&[glass]);
    f.global("int ray:maxdepth", 60);
    let own = f.attributes("glass", &["box"], &[]);
    let floor = f.rectangle([-2.0; 2], [2.0; 2], 0.0, own.clone());
    f.rectangle([-2.0; 2], [2.0; 2], 1.0, own);
    let (scene, camera, environment) = f.finish();
    let frame = ShadingContext::new(&scene, &camera, &environment);
    let object = frame.object(&floor);
    let mut grid = flat_grid(&[[0.1, 0.1]]);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(std::time::Duration::from_millis(100));
            environment.stop.store(true, std::sync::atomic::Ordering::Relaxed);
        });
        ShaderThread::new(&frame).shade(&object, &mut grid, &[]);
    });
    assert!(frame.statistics().ray_hits_shaded > 60);
}

#[test]
fn a_glass_ball_refracts_rays_by_snells_law() {
    // A ray that hits a ball of index n at height b turns by asin (b) - asin (b / n) at each side.
    let bends = "surface bends (float eta = 1.5) {
        vector V = normalize (I);
        normal Nf = faceforward (normalize (N), I);
        float ratio = dot (N, I) < 0 ? 1 / eta : eta;
        C = environment (\"all\", refract (V, Nf, ratio), \"bias\", 1e-4);
    }";
    let shows = "surface shows () { C = 0.5 + 0.5 * (color) normalize (vector (P)); }";
    let mut f = Fixture::new(&[bends, shows]);
    f.global("int ray:maxdepth", 5);
    let own = f.attributes("bends", &["all"], &[]);
    let ball = f.sphere(Vec3::ZERO, 1.0, own);
    let sky = f.attributes("shows", &["all"], &[]);
    f.sphere(Vec3::ZERO, 1000.0, sky);
    let heights: Vec<f32> = (0..19).map(|k| k as f32 * 0.05).collect();
    let points: Vec<[Vec3; 3]> = heights
        .iter()
        .map(|b| {
            let p = Vec3::new(*b, 0.0, (1.0 - b * b).sqrt());
            [p, p, -Vec3::Z]
        })
        .collect();
    let (grid, _) = shade_at(&f, &ball, &points);
    for (k, b) in heights.iter().enumerate() {
        let turn = 2.0 * (b.asin() - (b / 1.5).asin());
        let expected = Vec3::new(-turn.sin(), 0.0, -turn.cos());
        let found = (grid.c.get(k) * 2.0 - 1.0).normalize();
        // The tessellation of the ball is off by a thousandth, and so is its normal at the far side.
        assert!(found.dot(expected) > 1.0 - 5e-5, "{b}: {found} {expected}");
    }
}

#[test]
fn fresnel_weights_equal_the_formula() {
    // Inside of glass, reflected and refracted light have these weights. Beyond the critical angle there is only
    // reflection.
    let glass = "surface glass (float eta = 1.5) {
        float kr, kt; vector R, T;
        fresnel (normalize (I), normalize (N), eta, kr, kt, R, T);
        C = kr * environment (\"above\", R);
        if (kt > 0) C += kt * environment (\"below\", T);
    }";
    let mut f = Fixture::new(&[CONSTANT, glass]);
    let own = f.attributes("glass", &[], &[]);
    let face = f.rectangle([-1.0; 2], [1.0; 2], 0.0, own);
    let above = f.attributes("constant", &["above"], &[param("color C", &[1.0_f32, 0.0, 0.0][..])]);
    f.rectangle([-1e4; 2], [1e4; 2], 5.0, above);
    let below = f.attributes("constant", &["below"], &[param("color C", &[0.0_f32, 1.0, 0.0][..])]);
    f.rectangle([-1e4; 2], [1e4; 2], -5.0, below);
    let degrees = [0.0_f32, 10.0, 25.0, 40.0, 41.7, 41.9, 60.0, 80.0];
    let points = degrees.map(|d| {
        let (sin, cos) = d.to_radians().sin_cos();
        [Vec3::ZERO, Vec3::Z, Vec3::new(sin, 0.0, -cos)]
    });
    let (grid, _) = shade_at(&f, &face, &points);
    for (k, d) in degrees.into_iter().enumerate() {
        let (sin, cos) = f64::from(d).to_radians().sin_cos();
        let out = 1.5 * sin;
        let reflected = if out >= 1.0 {
            1.0
        } else {
            let cos_out = (1.0 - out * out).sqrt();
            let s = (1.5 * cos - cos_out) / (1.5 * cos + cos_out);
            let p = (1.5 * cos_out - cos) / (1.5 * cos_out + cos);
            0.5 * (s * s + p * p)
        } as f32;
        let expected = Color::new(reflected, 1.0 - reflected, 0.0);
        assert!((grid.c.get(k) - expected).abs().max_element() < 2e-3, "{d}: {} {expected}", grid.c.get(k));
    }
}

#[test]
fn a_traced_lens_blurs_an_edge_by_its_circle_of_confusion() {
    // A lens of radius a is in focus at distance f. A point at distance d is blurred over a disc of radius a |1 - d
    // / f|.
    let lens = "surface lens (float radius = 0.2, float focus = 4, float rings = 64) {
        point sharp = P - vector (0, 0, focus);
        color sum = 0;
        float n = 0;
        // A sunflower pattern with uniform density.
        for (float k = 0; k < rings * rings; k += 1) {
            float r = radius * sqrt ((k + 0.5) / (rings * rings)), t = k * 2.39996323;
            point from = P + vector (r * cos (t), r * sin (t), 0);
            trace (\"scene\", from, sharp - from, 0, 1) {
                color c = 0;
                getmessage (\"trace\", \"Cl\", c);
                sum += c;
            }
            n += 1;
        }
        C = sum / n;
    }";
    for depth in [2.0_f32, 3.0, 6.0, 12.0] {
        let mut f = Fixture::new(&[CONSTANT, lens]);
        let own = f.attributes("lens", &[], &[]);
        let film = f.rectangle([-1.0; 2], [1.0; 2], 0.0, own);
        let lit = f.attributes("constant", &["scene"], &[white()]);
        f.rectangle([0.0, -50.0], [50.0, 50.0], -depth, lit);
        let radius = 0.2 * (1.0 - depth / 4.0).abs();
        let offsets = [-1.3, -0.8, -0.3, 0.0, 0.45, 0.9, 1.2].map(|x| x * radius);
        let points = offsets.map(|x| [Vec3::new(x, 0.0, 0.0), Vec3::Z, -Vec3::Z]);
        let (grid, _) = shade_at(&f, &film, &points);
        for (k, x) in offsets.into_iter().enumerate() {
            let t = (x / radius).clamp(-1.0, 1.0);
            let expected = 0.5 + (t.asin() + t * (1.0 - t * t).sqrt()) / PI;
            assert!((grid.c.get(k).x - expected).abs() < 2e-3, "{depth} {x}: {} {expected}", grid.c.get(k).x);
        }
    }
}

#[test]
fn cones_of_reflections_and_shadows_cover_their_solid_angle() {
    // A ball of angular radius b in a cone of half angle a covers (1 - cos b) / (1 - cos a) of it.
    let looks = "surface looks (float blur = 0) {
        float alpha = 0;
        environment (\"ball\", N, \"blur\", blur, \"samples\", 4096, \"alpha\", alpha);
        C = alpha;
    }";
    let shades = "surface shades (float blur = 0) {
        lights (P) { C = 1 - Cl; }
    }";
    let sun = |blur: f32| {
        format!(
            "light sun () {{ emit (vector (0, 0, -1), 0) {{
                Cl = 1 - (color) shadow (\"ball\", Ps, \"blur\", {blur}, \"samples\", 4096);
            }} }}"
        )
    };
    for blur in [0.2_f32, 0.5, 1.0] {
        for name in ["looks", "shades"] {
            let mut f = Fixture::new(&[CONSTANT, looks, shades, &sun(blur)]);
            f.light("sun", &[], Transform::IDENTITY);
            let own = with_surface(f.attributes("", &[], &[]), name, &[param("float blur", blur)]);
            let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, own);
            let ball = f.attributes("constant", &["ball"], &[]);
            f.sphere(Vec3::Z * 5.0, 0.5, ball);
            let grid = shade(&f, &floor, &[[0.0, 0.0]]);
            // Blur 1 is a cone of 90 degrees.
            let (ball, cone) = ((0.1_f32).asin(), blur * FRAC_PI_4);
            let expected = (1.0 - ball.cos()) / (1.0 - cone.cos());
            let found = grid.c.get(0).x;
            assert!((found - expected).abs() < 0.03 * expected + 5e-4, "{name} {blur}: {found} {expected}");
        }
    }
}

#[test]
fn options_of_environment_set_their_results() {
    // A veil lies at height 1 and a wall at height 3.
    let asks = |options: &str| {
        let source = format!(
            "surface asks () {{
                float alpha = -1, hitdist = -1; point Phit = 7; normal Nhit = 7;
                color c = environment (\"all\", vector (0.6, 0, 0.8), \"alpha\", alpha, \"hitdist\", hitdist, \"Phit\",
                                       Phit, \"Nhit\", Nhit {options});
                C = c;
                opacity = color (alpha, hitdist, Phit[0]);
                N = Nhit;
            }}"
        );
        let mut f = Fixture::new(&[CONSTANT, &source]);
        let own = f.attributes("asks", &[], &[]);
        let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, own);
        let veil = [param("color C", &[1.0_f32, 0.0, 0.0][..]), param("color opacity", &[0.25_f32; 3][..])];
        let veil = f.attributes("constant", &["all"], &veil);
        f.rectangle([-9.0; 2], [9.0; 2], 1.0, veil);
        let wall = f.attributes("constant", &["all"], &[param("color C", &[0.0_f32, 1.0, 0.0][..])]);
        f.rectangle([-9.0; 2], [9.0; 2], 3.0, wall);
        let (grid, counts) = shade_at(&f, &floor, &[[Vec3::ZERO, Vec3::Z, -Vec3::Z]]);
        (grid.c.get(0), grid.opacity.get(0), grid.n.get(0), counts.ray_hits_shaded)
    };
    let (c, [alpha, hitdist, x], n, shaded) = {
        let (c, o, n, s) = asks("");
        (c, o.to_array(), n, s)
    };
    near(c, Color::new(0.25, 0.75, 0.0));
    near(Vec3::new(alpha, hitdist, x), Vec3::new(1.0, 1.25, 0.75));
    assert_eq!((n, shaded), (Vec3::Z, 2));
    // The veil is nearer than the bias, so it is not hit.
    let (c, o, ..) = asks(", \"bias\", 2");
    near(c, Color::Y);
    near(o, Vec3::new(1.0, 3.75, 2.25));
    // The wall is farther than the limit, so it is not hit.
    let (c, o, ..) = asks(", \"maxhitdist\", 2");
    near(c, Color::new(0.25, 0.0, 0.0));
    near(o, Vec3::new(0.25, 1.25, 0.75));
    let (c, o, ..) = asks(", \"maxhitdist\", 1");
    assert_eq!((c, o.x), (Color::ZERO, 0.0));
    assert!(o.y > 1e37, "{o}");
    // Nothing is shaded, and every hit counts as opaque.
    let (c, o, n, shaded) = asks(", \"shade\", 0");
    assert_eq!((c, n, shaded), (Color::ZERO, Vec3::Z, 0));
    near(o, Vec3::new(1.0, 1.25, 0.75));
    // Several rays return their mean.
    let (c, o, ..) = asks(", \"samples\", 16");
    near(c, Color::new(0.25, 0.75, 0.0));
    near(o, Vec3::new(1.0, 1.25, 0.75));
    // The result is multiplied by zero, so no ray is traced.
    assert_eq!(asks(", \"Kr\", 0").3, 0);
}

#[test]
fn all_numbers_of_samples_have_a_factor() {
    for call in [
        "diffuse (normalize (N))",
        "occlusion (\"all\", P, N, PI / 2, \"samples\", 64, \"maxerror\", 0, \"adaptive\", 0)",
        "indirect (\"all\", P, N, \"samples\", 64, \"maxerror\", 0, \"adaptive\", 0)",
        "environment (\"all\", N, \"blur\", 0.5, \"samples\", 64)",
    ] {
        let rays = |factor: f32| {
            let lamp = "light lamp () { emit (vector (0, 0, -1), 0) {
                Cl = 1 - (color) shadow (\"all\", Ps, \"blur\", 0.1, \"samples\", 64);
            } }";
            let mut f = Fixture::new(&[CONSTANT, lamp, &format!("surface asks () {{ C = {call}; }}")]);
            f.light("lamp", &[], Transform::IDENTITY);
            let floor = f.attributes("asks", &[], &[]);
            let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
            let lid = f.attributes("constant", &["all"], &[]);
            f.rectangle([-2.0; 2], [2.0; 2], 1.0, lid);
            let (scene, camera, environment) = f.finish();
            let frame = ShadingContext::new(&scene, &camera, &environment);
            frame.set_samples(factor);
            let object = frame.object(&floor);
            ShaderThread::new(&frame).shade(&object, &mut flat_grid(&[[0.1, 0.2]]), &[]);
            assert_eq!(f.complaints(), Vec::<String>::new(), "{call}");
            let counts = frame.statistics();
            counts.rays + counts.light_rays
        };
        let (all, quarter) = (rays(1.0), rays(0.25));
        assert!(quarter >= 16 && (3 * quarter..6 * quarter).contains(&all), "{call}: {all} {quarter}");
    }
}

#[test]
fn opaque_objects_cast_shadows_without_being_shaded() {
    let sheer = "surface sheer () { opacity = 0.25; C *= opacity; }";
    let solid = "surface solid () { opacity = 1; C *= opacity; }";
    // Each case holds the surface, its attributes, the share of light that passes, and the number of shaded hits.
    let cases: [(&str, Vec<Param>, f32, u64); 6] = [
        ("constant", vec![], 0.0, 0),
        ("constant", vec![param("color opacity", &[0.5_f32; 3][..])], 0.5, 1),
        (
            "constant",
            vec![param("color opacity", &[0.5_f32; 3][..]), param("int ray:opaqueshadows", 1)],
            0.0,
            0,
        ),
        ("sheer", vec![], 0.75, 1),
        ("sheer", vec![param("int ray:opaqueshadows", 1)], 0.0, 0),
        // A constant sets the opacity to 1.
        ("solid", vec![], 0.0, 0),
    ];
    for (surface, values, passes, shaded) in cases {
        let mut f = Fixture::new(&[CONSTANT, MATTE, POINT, sheer, solid]);
        let params = [param("string shadowname", "shadow"), param("float intensity", 4.0)];
        f.light("pointlight", &params, Transform::translate(Vec3::Z * 2.0));
        let floor = f.attributes("matte", &[], &[]);
        let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
        let lid = f.attributes(surface, &["shadow"], &values);
        f.rectangle([-1.0; 2], [1.0; 2], 1.0, lid);
        let (grid, counts) = shade_at(&f, &floor, &[[Vec3::ZERO, Vec3::Z, -Vec3::Z]]);
        near(grid.c.get(0), Color::splat(passes));
        assert_eq!((counts.shadow_rays, counts.ray_hits_shaded), (1, shaded), "{surface} {values:?}");
    }
}

#[test]
fn a_wide_sun_casts_a_penumbra() {
    // Rays spread over the cone of the sun. Half of it is behind the edge of a half plane.
    let sun = "light sun (float spread = 0) {
        emit (vector (0, 0, -1), spread) {
            Cl = 1 - (color) shadow (\"edge\", Ps, \"blur\", 2 * spread / 1.5707963, \"width\", 0, \"samples\", 1024);
        }
    }";
    let mut f = Fixture::new(&[MATTE, CONSTANT, sun]);
    let spread = 0.2_f32;
    f.light("sun", &[param("float spread", spread)], Transform::IDENTITY);
    let floor = f.attributes("matte", &[], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, floor);
    let lid = f.attributes("constant", &["edge"], &[]);
    f.rectangle([0.0, -100.0], [100.0, 100.0], 2.0, lid);
    let reach = 2.0 * spread.tan();
    let grid =
        shade(&f, &floor, &[[-1.05 * reach, 0.0], [0.0, 0.0], [1.05 * reach, 0.0], [-0.5 * reach, 0.0]]);
    assert_eq!(grid.c.get(0), Color::ONE);
    assert!((grid.c.get(1).x - 0.5).abs() < 0.01, "{}", grid.c.get(1));
    assert_eq!(grid.c.get(2), Color::ZERO);
    let t = 0.5_f32;
    let expected = 0.5 + (t.asin() + t * (1.0 - t * t).sqrt()) / PI;
    assert!((grid.c.get(3).x - expected).abs() < 0.02, "{} {expected}", grid.c.get(3));
}

#[test]
fn trace_loops_read_values_of_the_hit_surface() {
    let talks = "surface talks (float Kx = 0.25, output color tint = 0) {
        tint = color (0.1, 0.2, Kx);
        setmessage (\"said\", P[0]);
        N = 0.5 * N;
        C = color (0.5, 0, 0);
    }";
    let asks = "surface asks () {
        color tint = 7, c = 7; float said = 7, kx = 7, none = 7; normal n = 7; color opaque = 7;
        trace (\"set\", P, N, 0, 1) {
            float got = getmessage (\"trace\", \"tint\", tint) + 10 * getmessage (\"trace\", \"said\", said)
                + 100 * getmessage (\"trace\", \"Kx\", kx) + 1000 * getmessage (\"trace\", \"none\", none)
                + 10000 * getmessage (\"trace\", \"N\", n) + 100000 * getmessage (\"trace\", \"opacity\", opaque)
                + 1000000 * getmessage (\"trace\", \"C\", c);
            C = color (got, kx, said);
            opacity = color (n[2], tint[2], none + opaque[0] - 1);
            // Inside, other rays are traced. After that, `trace` refers to this ray again.
            float inner = 0, again = 0;
            trace (\"other\", P, N, 0, 1) { getmessage (\"trace\", \"Kx\", inner); }
            getmessage (\"trace\", \"Kx\", again);
            N = vector (inner, again, c[0]);
        }
    }";
    let mut f = Fixture::new(&[CONSTANT, talks, asks]);
    let own = f.attributes("asks", &[], &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, own);
    // Above x > 0 there is a surface with messages, above x < -3 one without, and nothing between.
    let one = f.attributes("talks", &["set"], &[]);
    f.rectangle([0.0, -9.0], [9.0, 9.0], 1.0, one);
    let mute = f.attributes("constant", &["set"], &[]);
    f.rectangle([-9.0, -9.0], [-3.0, 9.0], 1.0, mute);
    let other = with_surface(f.attributes("", &["other"], &[]), "talks", &[param("float Kx", 0.75)]);
    f.rectangle([-9.0; 2], [9.0; 2], 2.0, other);
    let at = |x: f32| [Vec3::new(x, 0.0, 0.0), Vec3::Z, -Vec3::Z];
    let (grid, _) = shade_at(&f, &floor, &[at(2.0), at(5.0), at(-1.0), at(-5.0)]);
    for (k, x) in [(0, 2.0), (1, 5.0)] {
        near(grid.c.get(k), Color::new(1_110_111.0, 0.25, x));
        near(grid.opacity.get(k), Color::new(0.5, 0.25, 7.0));
        near(grid.n.get(k), Vec3::new(0.75, 0.25, 0.5));
    }
    // Nothing was hit, so all values are unchanged.
    near(grid.c.get(2), Color::new(0.0, 7.0, 7.0));
    near(grid.n.get(2), Vec3::new(0.75, 0.0, 7.0));
    // Only globals are read.
    near(grid.c.get(3), Color::new(1_110_000.0, 7.0, 7.0));
    near(grid.opacity.get(3), Color::new(1.0, 7.0, 7.0));
    assert_eq!(f.complaints(), Vec::<String>::new());
}

/// Shadow rays are as wide as the distance of their points, whether a shader sets a number of samples or not.
#[test]
fn shadow_rays_tessellate_curved_objects_by_their_width() {
    let built = |options: &str| {
        let light = format!(
            "light lamp () {{ emit (vector (0, 0, -1), 0) {{ Cl = 1 - (color) shadow (\"set\", Ps{options}); }} }}"
        );
        let mut f = Fixture::new(&[MATTE, CONSTANT, &light]);
        f.light("lamp", &[], Transform::IDENTITY);
        let ball = f.attributes("constant", &["set"], &[]);
        f.sphere(Vec3::Z * 400.0, 300.0, ball);
        let floor = f.attributes("matte", &[], &[]);
        let floor = f.rectangle([-900.0; 2], [900.0; 2], 0.0, floor);
        let (scene, camera, environment) = f.finish();
        let frame = ShadingContext::new(&scene, &camera, &environment);
        let object = frame.object(&floor);
        let points: Vec<[f32; 2]> =
            (0..16).map(|i| [(i % 4) as f32 * 90.0 - 130.0, (i / 4) as f32 * 90.0 - 130.0]).collect();
        let mut grid = flat_grid(&points);
        grid.topology = granita_shade::Topology::Rect { nu: 4, nv: 4 };
        ShaderThread::new(&frame).shade(&object, &mut grid, &[]);
        assert_eq!(f.complaints(), Vec::<String>::new());
        (frame.rays.size().0, grid.c.get(5))
    };
    let (plain, dark) = built("");
    assert_eq!((plain, dark), built(", \"samples\", 1"));
    assert!(plain > 0 && dark == Color::ZERO, "{plain} {dark}");
}
