// tidy: tests
//! Tests what reflections of reflections and further bounces of indirect light cost, and that their mean is right.

use super::*;

/// Shades points of a primitive that lie anywhere. Also returns the counts of the frame.
fn shade_at(f: &Fixture, primitive: &Primitive, points: &[[Vec3; 3]]) -> (Grid, ShadingStatistics) {
    let mut grid = grid_at(points);
    grid.topology = granita_shade::Topology::Scattered { n: points.len() };
    grid.primitives = vec![primitive.id];
    grid.seed = 17;
    let shaded = shade_grid(f, primitive, grid);
    assert_eq!(f.complaints(), Vec::<String>::new());
    shaded
}

/// A blurred mirror of `samples` rays that keeps a part of the light and adds some of its own.
const BLURRED: &str = "surface blurred (float samples = 16, float Kr = 0.5) {
    normal Nf = faceforward (normalize (N), I);
    C = 0.25 * (1 + sin (3 * P[0]) * sin (2 * P[1]))
        + Kr * environment (\"all\", reflect (normalize (I), Nf), \"blur\", 0.5, \"samples\", samples, \"Kr\", Kr);
}";

/// Two large blurred mirrors face each other. Returns the mean colour of points of one of them, the standard deviation
/// of that mean, and the counts.
fn between_mirrors(globals: &[(&str, f32)], params: &[Param]) -> (f32, f32, ShadingStatistics) {
    let mut f = Fixture::new(&[BLURRED]);
    for (name, value) in globals {
        match name.strip_prefix("int ") {
            Some(_) => f.global(name, *value as i32),
            None => f.global(name, *value),
        }
    }
    let own = || with_surface(f.attributes("", &["all"], &[]), "blurred", params);
    let (low, high) = (own(), own());
    let floor = f.rectangle([-900.0; 2], [900.0; 2], 0.0, low);
    f.rectangle([-900.0; 2], [900.0; 2], 1.0, high);
    let points: Vec<[Vec3; 3]> = (0..256)
        .map(|k| [Vec3::new(0.3 + 1e-4 * k as f32, 0.2, 0.0), Vec3::Z, Vec3::new(0.3, 0.4, -1.0)])
        .collect();
    let (grid, counts) = shade_at(&f, &floor, &points);
    let c = &grid.c.xyz[0];
    let n = c.len() as f32;
    let mean = c.iter().sum::<f32>() / n;
    let variance = c.iter().map(|c| (c - mean).powi(2)).sum::<f32>() / n;
    (mean, (variance / n).sqrt(), counts)
}

#[test]
fn blurred_mirrors_that_face_each_other_cost_as_many_rays_at_each_bounce() {
    for depth in [1, 2, 4, 8] {
        let (_, _, counts) = between_mirrors(&[("int ray:maxdepth", depth as f32)], &[]);
        // A few rays leave between the mirrors, at low angles.
        let most = 256 * 16 * depth;
        assert!((most - most / 50..=most).contains(&counts.rays), "{depth}: {} of {most}", counts.rays);
    }
    // All bounces after the first take a part or a multiple of its rays.
    let rays = |deep: f32| {
        between_mirrors(&[("int ray:maxdepth", 3.0), ("float ray:deepsamples", deep)], &[]).2.rays
    };
    assert_eq!(rays(0.0), 256 * (16 + 16 + 16));
    assert_eq!(rays(0.5), 256 * (16 + 16 + 16));
    assert_eq!(rays(2.0), 256 * (16 + 32 + 32));
    assert_eq!(rays(1e9), 256 * (16 + 256 + 4096));
    assert_eq!(rays(-1.0), rays(0.0));
}

#[test]
fn the_first_of_several_rays_takes_all_samples() {
    // One ray from a mirror takes all samples of a blurred mirror that it hits.
    let (_, _, counts) = between_mirrors(&[("int ray:maxdepth", 3.0)], &[param("float samples", 1.0)]);
    assert_eq!(counts.rays, 256 * 3);
    let mirror = "surface mirror () { C = environment (\"all\", reflect (normalize (I), normalize (N))); }";
    let mut f = Fixture::new(&[BLURRED, mirror]);
    let own = with_surface(f.attributes("", &[], &[]), "mirror", &[]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, own);
    let blurred = with_surface(f.attributes("", &["all"], &[]), "blurred", &[]);
    f.rectangle([-9.0; 2], [9.0; 2], 1.0, blurred);
    let (_, counts) = shade_at(&f, &floor, &[[Vec3::ZERO, Vec3::Z, -Vec3::Z]]);
    assert_eq!(counts.rays, 1 + 16);
}

#[test]
fn fewer_deep_samples_have_the_same_mean() {
    let of = |globals: &[(&str, f32)]| {
        let depth = [("int ray:maxdepth", 3.0), ("float ray:minweight", 0.0)];
        between_mirrors(&[&depth[..], globals].concat(), &[])
    };
    let (exact, least, _) = of(&[("float ray:deepsamples", 1e9)]);
    let (mean, deviation, _) = of(&[]);
    assert!((mean - exact).abs() < 4.0 * (deviation + least), "{mean} +- {deviation}, {exact} +- {least}");
    // A sixteenth of the rays of the second bounce has less than four times the noise, because they are stratified.
    assert!(deviation < 4.0 * least, "{deviation} {least}");
}

#[test]
fn reflections_of_little_weight_are_traced_at_random_with_the_same_mean() {
    let of = |least: f32| {
        let globals =
            [("int ray:maxdepth", 4.0), ("float ray:minweight", least), ("float ray:deepsamples", 4.0)];
        between_mirrors(&globals, &[param("float Kr", 0.3)])
    };
    let (exact, least, all) = of(0.0);
    // Of the 16, 64, 64 and 64 rays of the bounces 16, 0.45 * 64, 0.3 * 28.8 and 0.3 * 8.6 remain: 56 of 208.
    let (mean, deviation, some) = of(0.2);
    assert!((mean - exact).abs() < 4.0 * (deviation + least), "{mean} +- {deviation}, {exact} +- {least}");
    let (all, some) = (all.rays as f32, some.rays as f32);
    assert!((0.24..0.30).contains(&(some / all)), "{some} of {all} rays");
    // At the first bounce, too.
    let (mean, deviation, few) = of(0.6);
    assert!((mean - exact).abs() < 4.0 * (deviation + least), "{mean} +- {deviation}, {exact}");
    assert!((few.rays as f32) < 0.7 * some);
}

/// Points of a sphere of radius 2, seen from an eye outside of it, with those that it hides. `only` selects points.
fn of_ball(eye: Vec3, only: impl Fn(Vec3) -> bool) -> Vec<[Vec3; 3]> {
    let points = (0..400).map(|k| {
        let z = 1.0 - (k as f32 + 0.5) / 200.0;
        let (sin, cos) = (2.4 * k as f32).sin_cos();
        let flat = (1.0 - z * z).sqrt();
        Vec3::new(cos * flat, sin * flat, z)
    });
    points.filter(|n| only(*n)).map(|n| [n * 2.0, n, n * 2.0 - eye]).collect()
}

const BALL_MIRROR: &str = "surface mirror (float blur = 0) {
    normal Nf = faceforward (normalize (N), I);
    C = 0.5 * environment (\"all\", reflect (normalize (I), Nf), \"blur\", blur, \"samples\", 8);
}";

#[test]
fn a_convex_mirror_ball_does_not_hit_itself() {
    // The eye of the fixture's camera.
    let eye = Fixture::new(&[]).view().1.position_world();
    for (blur, depth) in [(0.0, 1), (0.0, 3), (0.3, 3)] {
        let mut f = Fixture::new(&[BALL_MIRROR]);
        f.global("int ray:maxdepth", depth);
        let own = with_surface(f.attributes("", &["all"], &[]), "mirror", &[param("float blur", blur)]);
        let ball = f.sphere(Vec3::ZERO, 2.0, own);
        let points = of_ball(eye, |_| true);
        let (_, counts) = shade_at(&f, &ball, &points);
        assert_eq!((counts.rays, counts.ray_hits_shaded), (400 * 8, 0), "{blur} {depth}");
    }
}

#[test]
fn two_balls_of_one_object_hit_each_other_and_not_themselves() {
    let eye = Fixture::new(&[]).view().1.position_world();
    let mut f = Fixture::new(&[BALL_MIRROR]);
    f.global("int ray:maxdepth", 1);
    let own = with_surface(f.attributes("", &["all"], &[]), "mirror", &[]);
    let ball = f.sphere(Vec3::ZERO, 2.0, own.clone());
    let other = Vec3::X * 4.5;
    f.sphere(other, 2.0, own);
    let front = of_ball(eye, |n| n.dot(n * 2.0 - eye) < 0.0);
    let (_, counts) = shade_at(&f, &ball, &front);
    let expected = |radius: f32| {
        let hits = |[p, n, i]: &[Vec3; 3]| {
            let dir = (*i - *n * (2.0 * i.dot(*n))).normalize();
            let to = other - *p;
            to.dot(dir) > 0.0 && (to - dir * to.dot(dir)).length() < radius
        };
        8 * front.iter().filter(|point| hits(point)).count() as u64
    };
    let (least, most) = (expected(1.96), expected(2.0));
    assert!(
        least > 50 && (least..=most).contains(&counts.ray_hits_shaded),
        "{} {least}",
        counts.ray_hits_shaded
    );
}

#[test]
fn a_hemisphere_sees_its_own_inside() {
    // The inside of a half ball, seen through its opening, is a mirror of itself.
    let glows = "surface glows () {
        C = 0.25;
        if (raylevel () == 0)
            C = environment (\"all\", reflect (normalize (I), faceforward (normalize (N), I)), \"samples\", 8);
    }";
    let mut f = Fixture::new(&[glows]);
    let own = with_surface(f.attributes("", &["all"], &[]), "glows", &[]);
    let shape = ShapeDesc::Sphere { radius: 2.0, zmin: -2.0, zmax: 0.0, thetamax_deg: 360.0 };
    let bowl = f.add(shape, Params::new(), own);
    // It is seen from within. Reflected rays that meet the whole sphere again below the opening hit the bowl.
    let eye = Vec3::new(1.0, 0.5, -1.2);
    let again = |n: Vec3| {
        let i = (n * 2.0 - eye).normalize();
        let dir = i - n * (2.0 * i.dot(n));
        (n * 2.0 - dir * (2.0 * dir.dot(n * 2.0))).z
    };
    // At the border, the tessellation decides.
    let points = of_ball(eye, |n| n.z < -0.05 && again(n).abs() > 0.05);
    let (grid, counts) = shade_at(&f, &bowl, &points);
    let hits = points.iter().filter(|[_, n, _]| again(*n) < 0.0).count();
    assert!(hits > 20 && hits + 20 < points.len(), "{hits} of {}", points.len());
    assert_eq!(counts.ray_hits_shaded, hits as u64 * 8);
    for (k, [_, n, _]) in points.iter().enumerate() {
        near(grid.c.get(k), Color::splat(if again(*n) < 0.0 { 0.25 } else { 0.0 }));
    }
    // The outside does not see the inside.
    let eye = Fixture::new(&[]).view().1.position_world();
    let outside: Vec<[Vec3; 3]> =
        of_ball(eye, |n| n.z < -0.1).into_iter().map(|[p, n, _]| [p, n, -n + Vec3::X * 0.2]).collect();
    assert_eq!(shade_at(&f, &bowl, &outside).1.ray_hits_shaded, 0);
}

#[test]
fn refracted_rays_hit_the_far_side_of_a_ball() {
    let enters = "surface enters () {
        C = 0.25;
        if (raylevel () == 0)
            C = environment (\"all\", -normalize (N), \"samples\", 4);
    }";
    let mut f = Fixture::new(&[enters]);
    let own = with_surface(f.attributes("", &["all"], &[]), "enters", &[]);
    let ball = f.sphere(Vec3::ZERO, 2.0, own);
    let eye = Fixture::new(&[]).view().1.position_world();
    let front = of_ball(eye, |n| n.dot(n * 2.0 - eye) < 0.0);
    assert!(front.len() > 100);
    let (grid, counts) = shade_at(&f, &ball, &front);
    assert_eq!(counts.ray_hits_shaded, front.len() as u64 * 4);
    near(grid.c.get(0), Color::splat(0.25));
}

/// A surface that emits 1 and reflects a part of the indirect light.
const GLOW: &str =
    "surface glow (float a = 0.5, float emits = 1) { C = emits + a * diffuse (normalize (N)); }";

const BOUNCE: &str = "light bounce (float samples = 64, float maxpixeldist = -1) {
    emit (-Ns, 0) {
        Cl = indirect (\"room\", Ps, Ns, \"samples\", samples, \"maxpixeldist\", maxpixeldist, \"adaptive\", 0);
    }
}";

/// Adds a box of 4 units around the origin, whose sides are those of `of`: floor, ceiling and walls. Returns the floor.
fn add_box(f: &mut Fixture, of: impl Fn(usize) -> AttributeSet) -> Arc<Primitive> {
    let (l, h) = (-2.0, 2.0);
    let sides: [[[f32; 3]; 4]; 6] = [
        [[l, l, l], [h, l, l], [h, h, l], [l, h, l]],
        [[l, l, h], [l, h, h], [h, h, h], [h, l, h]],
        [[l, l, l], [l, h, l], [l, h, h], [l, l, h]],
        [[h, l, l], [h, l, h], [h, h, h], [h, h, l]],
        [[l, l, l], [l, l, h], [h, l, h], [h, l, l]],
        [[l, h, l], [h, h, l], [h, h, h], [l, h, h]],
    ];
    let made = sides.iter().enumerate().map(|(k, corners)| quad(f, corners.map(Vec3::from_array), of(k)));
    made.collect::<Vec<_>>()[0].clone()
}

/// Returns points of the floor of the box.
fn on_the_floor() -> Vec<[Vec3; 3]> {
    let places = (0..256).map(|k| [(k % 16) as f32 * 0.23 - 1.7, (k / 16) as f32 * 0.23 - 1.7]);
    places.map(|[x, y]| [Vec3::new(x, y, -2.0), Vec3::Z, -Vec3::Z]).collect()
}

#[test]
fn indirect_light_in_a_closed_room_is_the_series_of_its_bounces() {
    // Everything emits 1 and reflects a. After n bounces, the radiance is 1 + a + ... + a^n.
    for maxpixeldist in [20.0_f32, 0.0] {
        for bounces in [0, 1, 2, 3, 6] {
            let mut f = Fixture::new(&[GLOW, BOUNCE]);
            f.global("int indirect:maxdepth", bounces);
            f.light("bounce", &[param("float maxpixeldist", maxpixeldist)], Transform::IDENTITY);
            // Walls that are nearer than the bias would not be hit.
            let wall = f.attributes("", &["room"], &[param("float shadow:bias", 1e-5)]);
            let wall = with_surface(wall, "glow", &[param("float a", 0.6)]);
            let floor = add_box(&mut f, |_| wall.clone());
            let (grid, _) = shade_at(&f, &floor, &on_the_floor()[..8]);
            let expected: f32 = (0..=bounces).map(|k| 0.6_f32.powi(k)).sum();
            for k in 0..grid.len() {
                let c = grid.c.get(k);
                let off = (c - expected).abs().max_element();
                assert!(off < 2e-3 * expected, "{maxpixeldist} {bounces}: {c} {expected}");
            }
        }
    }
}

/// A room of walls, of which the ceiling emits. Returns the light of points on the floor, and the counts.
fn in_a_room(bounces: i32, light: &[Param]) -> (f32, ShadingStatistics) {
    let mut f = Fixture::new(&[GLOW, BOUNCE]);
    f.global("int indirect:maxdepth", bounces);
    f.light("bounce", light, Transform::IDENTITY);
    let wall = with_surface(f.attributes("", &["room"], &[]), "glow", &[param("float emits", 0.0)]);
    let lamp = with_surface(f.attributes("", &["room"], &[]), "glow", &[]);
    let floor = add_box(&mut f, |side| if side == 1 { lamp.clone() } else { wall.clone() });
    let points = on_the_floor();
    let (grid, counts) = shade_at(&f, &floor, &points);
    (grid.c.xyz[0].iter().sum::<f32>() / points.len() as f32, counts)
}

#[test]
fn shared_records_of_a_second_bounce_agree_with_rays_and_cost_little() {
    let one = in_a_room(1, &[]);
    for bounces in [2, 3] {
        let exact = in_a_room(bounces, &[param("float maxpixeldist", 0.0), param("float samples", 1024.0)]).0;
        let (found, counts) = in_a_room(bounces, &[]);
        assert!((found / exact - 1.0).abs() < 0.02, "{bounces}: {found} for {exact}");
        // The walls reflect much more than the light of one bounce.
        assert!(found > 1.2 * one.0, "{bounces}: {found} {}", one.0);
        // The room has 96 square units and cells from 1 to 2 units wide.
        assert!(counts.light_records > one.1.light_records, "{bounces}");
        let ratio = counts.light_rays as f32 / one.1.light_rays as f32;
        assert!(ratio < 1.0 + 0.5 * (bounces - 1) as f32, "{bounces}: {ratio} times the rays");
    }
}

#[test]
fn bounces_do_not_depend_on_threads_or_on_what_is_kept() {
    let mut f = Fixture::new(&[GLOW, BOUNCE]);
    f.global("int indirect:maxdepth", 3);
    f.light("bounce", &[param("float samples", 16.0)], Transform::IDENTITY);
    let flip = AttributeSet { flip_normals: true, ..f.attributes("", &["room"], &[]) };
    f.sphere(Vec3::ZERO, 20.0, with_surface(flip, "glow", &[]));
    let own = with_surface(f.attributes("", &["room"], &[]), "glow", &[param("float emits", 0.0)]);
    let floor = f.rectangle([-9.0; 2], [9.0; 2], 0.0, own);
    let points: Vec<[f32; 2]> = (0..20).map(|i| [i as f32 * 0.4 - 4.0, 0.1]).collect();
    let reference = shade(&f, &floor, &points);
    let (scene, camera, environment) = f.finish();
    for bytes in [0, 1 << 29] {
        let frame = ShadingContext::new(&scene, &camera, &environment);
        frame.light_cache.set_limit(bytes);
        std::thread::scope(|scope| {
            for part in points.chunks(7) {
                let (frame, floor, reference, points) = (&frame, &floor, &reference, &points);
                scope.spawn(move || {
                    let object = frame.object(floor);
                    let mut thread = ShaderThread::new(frame);
                    let mut grid = flat_grid(points);
                    thread.shade(&object, &mut grid, &[]);
                    assert_eq!(grid.c, reference.c, "{}", part.len());
                });
            }
        });
    }
}
