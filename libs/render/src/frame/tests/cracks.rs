//! Tests that no sample sees through random surfaces that fill the view and are stitched, displaced and moving.

use super::*;
use granita_base::{CurveBasis, hash};
use granita_scene::attr;

/// Generates numbers from a seed.
struct Random(u32, u32);

impl Random {
    /// Returns a number in [0, 1).
    fn next(&mut self) -> f32 {
        self.1 += 1;
        (hash::words(&[self.0, self.1]) >> 8) as f32 / 16_777_216.0
    }

    fn between(&mut self, lo: f32, hi: f32) -> f32 {
        lo + (hi - lo) * self.next()
    }

    fn pick(&mut self, n: usize) -> usize {
        ((self.next() * n as f32) as usize).min(n - 1)
    }
}

/// Displaces grids and keeps their colours.
struct Moved<'a> {
    /// The displacement; `None` when nothing is displaced.
    displace: Option<&'a (dyn Fn(&mut Grid) + Sync)>,
}

impl FrameShader for Moved<'_> {
    type Object = ObjectTraits;
    type Thread<'b>
        = ()
    where
        Self: 'b;

    fn object(&self, primitive: &Primitive) -> Arc<ObjectTraits> {
        Arc::new(ObjectTraits {
            opaque: true,
            opaque_in_depth: true,
            holdout: Holdout::None,
            displaces: self.displace.is_some(),
            max_displacement_world: primitive.attributes.get(attr::DISPLACE_MAXRADIUS),
            measures: false,
            preshaded: false,
            may_batch: false,
            saves: false,
        })
    }
    fn traits(&self, object: &ObjectTraits) -> ObjectTraits {
        *object
    }
    fn thread(&self) {}
    fn displace(&self, (): &mut (), _: &ObjectTraits, grid: &mut Grid) {
        self.displace.iter().for_each(|displace| displace(grid));
    }
    fn shade(
        &self,
        (): &mut (),
        _: &ObjectTraits,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        flat(grid);
        wanted.iter().map(|_| None).collect()
    }
}

/// Returns a height field over [-6, 6] x [-5, 5], which is more than the view, as points of an `nu x nv` lattice.
fn heights(random: &mut Random, nu: usize, nv: usize, rough: f32) -> Vec<Vec3> {
    let mut points = Vec::new();
    for j in 0..nv {
        for i in 0..nu {
            let (x, y) = (i as f32 / (nu - 1) as f32, j as f32 / (nv - 1) as f32);
            let inside = i > 0 && j > 0 && i + 1 < nu && j + 1 < nv;
            let (dx, dy) =
                if inside { (random.between(-0.6, 0.6), random.between(-0.6, 0.6)) } else { (0.0, 0.0) };
            let step = rough / nu.max(nv) as f32;
            points.push(Vec3::new(
                x * 12.0 - 6.0 + dx * step,
                y * 10.0 - 5.0 + dy * step,
                9.0 + random.between(-rough, rough),
            ));
        }
    }
    points
}

fn floats(points: impl IntoIterator<Item = Vec3>) -> Vec<f32> {
    points.into_iter().flat_map(|p| p.to_array()).collect()
}

/// Returns a name for the surface, and shapes that together cover the view, each with its points when the shutter
/// opens.
fn surface(random: &mut Random) -> (&'static str, Vec<(ShapeDesc, Vec<f32>)>) {
    use CurveBasis::{BSpline, Bezier, CatmullRom, Linear};
    let rough = random.between(0.2, 2.0);
    match random.pick(5) {
        0 => {
            // This is one patch of many segments.
            let basis = [Bezier, BSpline, CatmullRom][random.pick(3)];
            let (nu, nv) = match basis {
                Bezier => (7, 4 + 3 * random.pick(2)),
                _ => (6 + random.pick(3), 6 + random.pick(3)),
            };
            let mut points = heights(random, nu, nv, rough);
            // B-splines do not reach their outer points.
            points.iter_mut().for_each(|p| *p = Vec3::new(p.x * 2.2, p.y * 2.2, p.z));
            (
                if basis == Bezier { "patch" } else { "smooth patch" },
                vec![(ShapeDesc::Patch { u: basis, v: basis, nu, nv }, floats(points))],
            )
        }
        1 => {
            // Bezier patches side by side share the vertices of their edges. Random ones are turned around.
            let (cu, cv) = (1 + random.pick(3), 1 + random.pick(3));
            let (nu, nv) = (3 * cu + 1, 3 * cv + 1);
            let points = heights(random, nu, nv, rough);
            let mut shapes = Vec::new();
            for j in 0..cv {
                for i in 0..cu {
                    let turned = random.pick(2) == 1;
                    let place = |k: usize| if turned { 15 - k } else { k };
                    let vertex = |k: usize| points[(3 * j + k / 4) * nu + 3 * i + k % 4];
                    let own = floats((0..16).map(|k| vertex(place(k))));
                    shapes.push((ShapeDesc::Patch { u: Bezier, v: Bezier, nu: 4, nv: 4 }, own));
                }
            }
            ("stitched patches", shapes)
        }
        2 => {
            // Bilinear patches have quite different sizes.
            let (nu, nv) = (2 + random.pick(6), 2 + random.pick(6));
            let points = heights(random, nu, nv, rough);
            let mut shapes = Vec::new();
            for j in 0..nv - 1 {
                for i in 0..nu - 1 {
                    let at = j * nu + i;
                    let own = floats([at, at + 1, at + nu, at + nu + 1].map(|k| points[k]));
                    shapes.push((ShapeDesc::Patch { u: Linear, v: Linear, nu: 2, nv: 2 }, own));
                }
            }
            ("bilinear patches", shapes)
        }
        kind => {
            // A mesh has quadrilaterals, triangles and larger faces. When it is subdivided, it ends at sharp corners.
            let (nu, nv) = (3 + random.pick(5), 3 + random.pick(5));
            let points = heights(random, nu, nv, rough);
            let (mut nverts, mut verts) = (Vec::new(), Vec::new());
            for j in 0..nv - 1 {
                for i in 0..nu - 1 {
                    let [a, b, c, d] = [0, 1, nu + 1, nu].map(|k| (j * nu + i + k) as i32);
                    match random.pick(3) {
                        0 => {
                            nverts.extend([3, 3]);
                            verts.extend([a, b, c, a, c, d]);
                        }
                        _ => {
                            nverts.push(4);
                            verts.extend([a, b, c, d]);
                        }
                    }
                }
            }
            let subdivide = kind == 4;
            let shape = ShapeDesc::Mesh { subdivide, nverts: nverts.into(), verts: verts.into() };
            (if subdivide { "subdivided mesh" } else { "mesh" }, vec![(shape, floats(points))])
        }
    }
}

/// Returns the number of pixels of one random case that are not covered, and a description of the case.
fn holes(seed: u32) -> (usize, String) {
    let random = &mut Random(seed, 0);
    let (what, shapes) = surface(random);
    let mut build = Build {
        camera: vec![("int[2] resolution", vec![48.0, 40.0]), ("float fov", vec![38.0])],
        ..Build::default()
    };
    let displaced = random.pick(3) > 0;
    let moves = random.pick(3) == 0;
    // The displacement is along the normal only where all surfaces have the same normal at every edge.
    let smooth = what == "smooth patch" || what == "subdivided mesh";
    let direction = match random.pick(3) {
        0 if smooth => None,
        _ => Some(Vec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), random.between(-1.0, 1.0))),
    };
    // The waves are at least 4 pixels long and at most 3 pixels high.
    let mut wave = || random.between(2.0, 13.0);
    let frequency = Vec3::new(wave(), wave(), wave());
    let amplitude = if displaced { random.between(0.05, 0.4) } else { 0.0 };
    let direction = direction.map(Vec3::normalize_or_zero);
    // The displacement is a wave that depends on the place only, along one direction or along the normal.
    let rough = |grid: &mut Grid| {
        for i in 0..grid.len() {
            let (p, n) = (grid.p.get(i), grid.ng.get(i).normalize_or_zero());
            let wave = (p.x * frequency.x).sin() * (p.y * frequency.y + p.z * frequency.z).cos();
            grid.p.set(i, p + direction.unwrap_or(n) * (wave * amplitude));
        }
    };
    let shader = Moved { displace: displaced.then_some(&rough) };
    if moves {
        build.camera.push(("float[2] shutter", vec![0.0, 1.0]));
    }
    let travel = Vec3::new(random.between(-0.5, 0.5), random.between(-0.5, 0.5), random.between(-0.5, 0.5));
    let quality = [1.0, 1.0, 0.5, 2.0][random.pick(4)];
    for (shape, p) in shapes {
        let set = attributes(
            &[("float displace:maxradius", &[0.5]), ("float shadingquality", &[quality])],
            MotionTransform::default(),
        );
        let mut params = Params(vec![param("vertex point P", &p)]);
        params.set(Param::declared("int border", 1).unwrap());
        build.add(shape, params.clone(), set);
        if moves {
            // All shapes move and stretch in the same way.
            let moved: Vec<f32> =
                p.iter().enumerate().map(|(i, x)| x * 1.1 + travel.to_array()[i % 3]).collect();
            params.set(param("vertex point P", &moved));
            let primitive = build.scene.primitives.last_mut().unwrap();
            Arc::make_mut(primitive).keys.push(ShapeKey { time: 1.0, params });
        }
    }
    let output = ("rgba", &box_filter()[..]);
    let view = build.view(&[]);
    let image = render_with(&build, &view, 1, output, &shader);
    let holes = image.chunks(4).filter(|p| p[3] < 1.0).count();
    let worst = image.chunks(4).map(|p| 1.0 - p[3]).fold(0.0, f32::max);
    let words = format!(
        "seed {seed}: {holes} pixels of a {what}, up to {worst}; displaced {amplitude} along {direction:?} by {frequency}, moving {moves}, quality {quality}"
    );
    (holes, words)
}

fn run(seeds: std::ops::Range<u32>) {
    let found: Vec<String> =
        seeds.clone().map(holes).filter(|(holes, _)| *holes > 0).map(|(_, words)| words).collect();
    assert!(found.is_empty(), "{} of {seeds:?} have holes\n{}", found.len(), found.join("\n"));
}

#[test]
fn surfaces_that_once_had_holes_have_none() {
    // These are subdivided meshes that are displaced along normals that differ from patch to patch.
    let seeds = [
        364, 596, 1131, 2810, 3173, 3428, 3818, 4371, 5358, 6209, 6262, 6461, 7352, 7537, 7986, 8322, 9787,
        9833,
    ];
    seeds.into_iter().for_each(|seed| run(seed..seed + 1));
}

#[test]
fn hundreds_of_surfaces_have_no_holes() {
    run(0..300);
}

#[test]
#[ignore = "takes minutes"]
fn ten_thousand_surfaces_have_no_holes() {
    run(300..10_300);
}

#[test]
#[ignore = "takes minutes"]
fn twenty_thousand_other_surfaces_have_no_holes() {
    run(1_000_000..1_020_000);
}

/// Returns the alpha of a shape in the xy plane, displaced within the plane by at most 1. The image has 64 x 64 pixels
/// about the origin, 10 pixels per unit.
fn displaced_in_plane(
    shape: ShapeDesc,
    points: &[f32],
    quality: f32,
    place: impl Fn(Vec3) -> Vec3 + Sync,
) -> Vec<f32> {
    let mut build = Build {
        camera: vec![
            ("int[2] resolution", vec![64.0, 64.0]),
            ("float orthographic", vec![1.0]),
            ("float[4] screen", vec![-3.2, 3.2, -3.2, 3.2]),
            ("int[2] spatialquality", vec![8.0, 8.0]),
        ],
        ..Build::default()
    };
    let set = attributes(
        &[("float displace:maxradius", &[1.0]), ("float shadingquality", &[quality])],
        at(0.0, 0.0, 5.0),
    );
    build.add(shape, Params(vec![param("vertex point P", points)]), set);
    let displace = |grid: &mut Grid| {
        for i in 0..grid.len() {
            grid.p.set(i, place(grid.p.get(i)));
        }
    };
    let view = build.view(&[]);
    let shader = Moved { displace: Some(&displace) };
    let image = render_with(&build, &view, 1, ("rgba", &box_filter()[..]), &shader);
    image.chunks(4).map(|p| p[3]).collect()
}

/// Checks that `alpha` covers `area` square units, all pixels inside of a region and none outside of it. `distance`
/// returns the distance from the border of the region, which is negative inside.
fn covers(alpha: &[f32], area: f32, what: &str, distance: impl Fn(f32, f32) -> f32) {
    let covered: f32 = alpha.iter().sum::<f32>() / 100.0;
    assert!((covered / area - 1.0).abs() < 0.005, "{what}: covers {covered} instead of {area}");
    for (i, a) in alpha.iter().enumerate() {
        let (x, y) = ((i % 64) as f32 * 0.1 - 3.15, 3.15 - (i / 64) as f32 * 0.1);
        // The limit is the half diagonal of a pixel plus a twentieth of a pixel.
        let d = distance(x, y);
        let right = if d > 0.0757 { *a == 0.0 } else { d > -0.0757 || *a == 1.0 };
        assert!(right, "{what}: alpha {a} at ({x}, {y}), {d} from the border");
    }
}

#[test]
fn displacement_keeps_open_borders_in_place() {
    for quality in [1.0, 3.0] {
        // A sheared square keeps its area.
        let (shape, params) = square(2.0);
        let points = params.get("P").and_then(|p| p.data.to_floats()).unwrap();
        let shift = |y: f32| 0.7 * (2.0 * y).sin();
        let alpha = displaced_in_plane(shape, &points, quality, |p| Vec3::new(p.x + shift(p.y), p.y, p.z));
        covers(&alpha, 16.0, "square", |x, y| {
            // The border slants by up to 1.4 to 1.
            let aside = ((x - shift(y.clamp(-2.0, 2.0))).abs() - 2.0) / 1.4_f32.hypot(1.0);
            aside.max(y.abs() - 2.0)
        });
        // A twisted disk is a polygon of 256 corners whose boundary only turns.
        let n = 256;
        let round = |i: usize| {
            let t = i as f32 / n as f32 * std::f32::consts::TAU;
            [2.5 * t.cos(), 2.5 * t.sin(), 0.0]
        };
        let mut points = vec![0.0; 3];
        points.extend((0..n).flat_map(round));
        let verts: Vec<i32> = (0..n as i32).flat_map(|i| [0, 1 + i, 1 + (i + 1) % n as i32]).collect();
        let shape = ShapeDesc::Mesh { subdivide: false, nverts: vec![3; n].into(), verts: verts.into() };
        let alpha = displaced_in_plane(shape, &points, quality, |p| {
            let (sin, cos) = (0.4 * (3.0 * p.truncate().length()).cos()).sin_cos();
            Vec3::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y, p.z)
        });
        covers(&alpha, std::f32::consts::PI * 6.25, "disk", |x, y| x.hypot(y) - 2.5);
    }
}
