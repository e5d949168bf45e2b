//! Random surfaces that fill the view, stitched, displaced and moving: not one sample may see through them.

use super::*;
use granita_base::{CurveBasis, hash};

/// Numbers from a seed.
struct Random(u32, u32);

impl Random {
    /// In [0, 1).
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

/// Moves points by waves that depend on their place only.
struct Rough {
    amplitude: f32,
    /// Waves per unit.
    frequency: Vec3,
    /// Along this direction, or along the normal.
    direction: Option<Vec3>,
}

impl FrameShader for Rough {
    type Object = ObjectTraits;
    type Thread<'a> = ();

    fn object(&self, primitive: &Primitive) -> Arc<ObjectTraits> {
        Arc::new(ObjectTraits {
            opaque: true,
            holdout: Holdout::None,
            displaces: self.amplitude > 0.0,
            max_displacement_world: primitive.attributes.float("displace:maxradius"),
            preshaded: false,
        })
    }
    fn traits(&self, object: &ObjectTraits) -> ObjectTraits {
        *object
    }
    fn thread(&self) {}
    fn displace(&self, (): &mut (), _: &ObjectTraits, grid: &mut Grid) {
        for i in 0..grid.len() {
            let (p, n) = (grid.p.get(i), grid.ng.get(i).normalize_or_zero());
            let wave =
                (p.x * self.frequency.x).sin() * (p.y * self.frequency.y + p.z * self.frequency.z).cos();
            grid.p.set(i, p + self.direction.unwrap_or(n) * (wave * self.amplitude));
        }
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

/// A height field over [-6, 6] x [-5, 5], which is more than the view, as points of an `nu x nv` lattice.
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

/// Shapes that together cover the view, each with its points when the shutter opens.
fn surface(random: &mut Random) -> (&'static str, Vec<(ShapeDesc, Vec<f32>)>) {
    use CurveBasis::{BSpline, Bezier, CatmullRom, Linear};
    let rough = random.between(0.2, 2.0);
    match random.pick(5) {
        0 => {
            // One patch of many segments.
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
            // Bezier patches side by side that share the vertices of their edges, every other one turned around.
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
            // Bilinear patches of quite different sizes.
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
            // A mesh of quadrilaterals, triangles and larger faces; subdivided, it ends at sharp corners.
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

/// Pixels of one random case that are not covered, with words for it.
fn holes(seed: u32) -> (usize, String) {
    let random = &mut Random(seed, 0);
    let (what, shapes) = surface(random);
    let mut build = Build {
        camera: vec![("int[2] resolution", vec![48.0, 40.0]), ("float fov", vec![38.0])],
        ..Build::default()
    };
    let displaced = random.pick(3) > 0;
    let moves = random.pick(3) == 0;
    // Along the normal only where there is one at every edge.
    let smooth = what == "smooth patch" || what == "subdivided mesh";
    let direction = match random.pick(3) {
        0 if smooth => None,
        _ => Some(Vec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), random.between(-1.0, 1.0))),
    };
    // Waves of 4 pixels and more, up to 3 pixels high.
    let mut wave = || random.between(2.0, 13.0);
    let frequency = Vec3::new(wave(), wave(), wave());
    let shader = Rough {
        amplitude: if displaced { random.between(0.05, 0.4) } else { 0.0 },
        frequency,
        direction: direction.map(Vec3::normalize_or_zero),
    };
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
            // All move and stretch alike.
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
        "seed {seed}: {holes} pixels of a {what}, up to {worst}; displaced {} along {:?} by {frequency}, moving {moves}, quality {quality}",
        shader.amplitude, shader.direction
    );
    (holes, words)
}

fn run(seeds: std::ops::Range<u32>) {
    let found: Vec<String> =
        seeds.clone().map(holes).filter(|(holes, _)| *holes > 0).map(|(_, words)| words).collect();
    assert!(found.is_empty(), "{} of {seeds:?} have holes\n{}", found.len(), found.join("\n"));
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
