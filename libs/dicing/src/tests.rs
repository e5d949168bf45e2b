//! Tests of the dicing rates against the attributes of reference 4.4.5.

use super::*;
use crate::CameraView;
use granita_base::{
    CurveBasis, MotionTransform, Param, ParamData, Params, Reporter, ShapeDesc, Transform, Vec3,
    shape::KnotSpan,
};
use granita_geom::ShapeKey;
use granita_scene::{Camera, Scene};
use std::collections::BTreeMap;
use std::sync::Arc;

fn param(declaration: &str, data: impl Into<ParamData>) -> Param {
    Param::declared(declaration, data).unwrap()
}

/// Returns an orthographic camera with 8 pixels per unit and a shutter that is open from 0 to 1.
fn camera() -> CameraView {
    let mut params = Params::new();
    params.set(param("string projection", "orthographic"));
    params.set(param("int[2] resolution", &[640.0_f32, 480.0][..]));
    params.set(param("float[4] screen", &[-40.0_f32, 40.0, -30.0, 30.0][..]));
    params.set(param("float[2] shutter", &[0.0_f32, 1.0][..]));
    let camera = Camera { name: "main".into(), world_to_camera: MotionTransform::default(), params };
    CameraView::new(&camera, &Reporter::silent())
}

struct Rig {
    camera: CameraView,
    scene: Scene,
    attributes: AttributeSet,
}

impl Rig {
    /// Returns a rig with attributes of the object. Attributes of the scene are recognised by their names.
    fn new(list: &[(&str, ParamData)]) -> Self {
        let mut values = granita_scene::Values::default();
        let mut scene = Scene::default();
        for (declaration, data) in list {
            let p = param(declaration, data.clone());
            if p.name.starts_with("limits:") || p.name.ends_with("name") {
                scene.globals.insert(p.name.clone(), p);
            } else {
                values.insert(p.name.clone(), p);
            }
        }
        let attributes = AttributeSet { values: Arc::new(values), ..AttributeSet::default() };
        Self { camera: camera(), scene, attributes }
    }

    fn leaves(&self, pieces: Vec<Piece>, to_world: &MotionTransform) -> Vec<Leaf> {
        let settings = DiceSettings::new(&self.attributes, &SceneDicing::new(&self.scene), &self.camera);
        let times = pieces[0].key_times().to_vec();
        let placement = Placement::new(to_world, &times, &[], self.camera.shutter);
        let measure = Measure::on_raster(&self.camera);
        let mut leaves = Vec::new();
        let mut stack: Vec<(Piece, u32)> = pieces.into_iter().rev().map(|p| (p, 0)).collect();
        while let Some((piece, depth)) = stack.pop() {
            match measure.plan(&*piece, &placement, &settings, depth) {
                Plan::Dice(rates) => leaves.push(Leaf { piece, rates: Box::new(rates) }),
                Plan::Split(direction, settled) => {
                    let parts = piece.split_settled(direction, settled);
                    stack.extend(parts.into_iter().rev().map(|p| (p, depth + 1)));
                }
            }
        }
        leaves
    }

    /// Returns the numbers of points along u and v of each grid of pieces that do not move.
    fn rates(&self, pieces: Vec<Piece>) -> Vec<[usize; 2]> {
        self.rates_moving(pieces, &Transform::translate(Vec3::Z * 10.0).into())
    }

    fn rates_moving(&self, pieces: Vec<Piece>, to_world: &MotionTransform) -> Vec<[usize; 2]> {
        self.leaves(pieces, to_world).iter().map(|leaf| [leaf.rates.nu, leaf.rates.nv]).collect()
    }
}

fn build(shape: &ShapeDesc, params: &[Param]) -> Vec<Piece> {
    let params = Params(params.to_vec());
    let keys = [ShapeKey { time: 0.0, params: &params }];
    granita_geom::build(shape, &keys, None, &mut |_, text| panic!("{text}")).unwrap()
}

/// Returns a rectangle in the xy plane, `[width, height]` around the origin, with further variables.
fn rectangle([w, h]: [f32; 2], more: &[Param]) -> Vec<Piece> {
    use CurveBasis::Linear;
    let (x, y) = (w * 0.5, h * 0.5);
    let p = [-x, -y, 0.0, x, -y, 0.0, -x, y, 0.0, x, y, 0.0];
    let mut params = vec![param("vertex point P", &p[..])];
    params.extend_from_slice(more);
    build(&ShapeDesc::Patch { u: Linear, v: Linear, nu: 2, nv: 2 }, &params)
}

/// Returns a straight curve along y.
fn straight(length: f32, width: f32) -> Vec<Piece> {
    let p = [0.0, 0.0, 0.0, 0.0, length, 0.0];
    let params = [param("vertex point P", &p[..]), param("constant float width", width)];
    build(&ShapeDesc::Curves { basis: CurveBasis::Linear, ncurves: 1, nverts: 2 }, &params)
}

/// Returns the knots of a quadratic curve of two segments, which meet at the double knot 1.
fn two_arcs() -> KnotSpan {
    let knots = [0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 2.0].into();
    KnotSpan { n: 5, order: 3, knots, min: 0.0, max: 2.0 }
}

/// Returns the knots of a linear curve of one segment.
fn one_line() -> KnotSpan {
    KnotSpan { n: 2, order: 2, knots: [0.0, 0.0, 1.0, 1.0].into(), min: 0.0, max: 1.0 }
}

/// Returns half of a cylinder around y, of radius `r` and height `r`.
fn half_pipe(r: f32) -> Vec<Piece> {
    let k = two_arcs();
    let line = one_line();
    let w = std::f32::consts::FRAC_1_SQRT_2;
    let mut pw = Vec::new();
    for y in [0.0, r] {
        let arc = [[-r, 0.0, 1.0], [-r, -r, w], [0.0, -r, 1.0], [r, -r, w], [r, 0.0, 1.0]];
        for [x, z, w] in arc {
            pw.extend([x * w, y * w, z * w, w]);
        }
    }
    build(&ShapeDesc::Nurbs { u: k, v: line }, &[param("vertex hpoint Pw", &pw[..])])
}

fn f(x: f32) -> ParamData {
    x.into()
}

#[test]
fn micropolygons_are_a_pixel_apart_at_quality_one() {
    // The rectangle is 16 by 8 pixels.
    assert_eq!(Rig::new(&[]).rates(rectangle([2.0, 1.0], &[])), [[17, 9]]);
    let finer = Rig::new(&[("float shadingquality", f(1.5))]);
    assert_eq!(finer.rates(rectangle([1.0, 0.5], &[])), [[13, 7]]);
    let coarser = Rig::new(&[("float shadingquality", f(0.25))]);
    assert_eq!(coarser.rates(rectangle([2.0, 1.0], &[])), [[5, 3]]);
    // The sides are straight, 1.4 and 2.6 pixels long. The points are about a pixel apart.
    assert_eq!(Rig::new(&[]).rates(rectangle([0.175, 0.325], &[])), [[2, 4]]);
}

#[test]
fn grids_stay_within_the_grid_size() {
    for size in [16, 100, 256, 1000] {
        let rig = Rig::new(&[("int limits:gridsize", f(size as f32))]);
        let rates = rig.rates(rectangle([20.0, 10.0], &[]));
        assert!(rates.iter().all(|[u, v]| u * v <= size), "{rates:?}");
        let facets: usize = rates.iter().map(|[u, v]| (u - 1) * (v - 1)).sum();
        assert!((160 * 80..160 * 80 * 3 / 2).contains(&facets), "{facets}");
    }
}

#[test]
fn binary_rates_are_powers_of_two() {
    let rig = Rig::new(&[("int dice:binary", f(1.0))]);
    // The rectangle is 12 by 5 pixels.
    assert_eq!(rig.rates(rectangle([1.5, 0.625], &[])), [[17, 9]]);
    for rates in rig.rates(rectangle([11.3, 7.7], &[])) {
        assert!(rates.iter().all(|n| (n - 1).is_power_of_two()), "{rates:?}");
    }
}

#[test]
fn fixed_rates_hold_at_any_size() {
    let rig = Rig::new(&[("float[2] dice:fixed", (&[12.0_f32, 5.0][..]).into())]);
    for size in [0.001, 1.0, 10.0] {
        assert_eq!(rig.rates(rectangle([size, size], &[])), [[13, 6]]);
    }
    // There are 256 segments per unit, in grids of at most 256 points.
    let rig = Rig::new(&[("float[2] dice:fixed", (&[256.0_f32, 64.0][..]).into())]);
    let leaves = rig.rates(rectangle([1.0, 1.0], &[]));
    assert_eq!(leaves.iter().map(|[u, v]| (u - 1) * (v - 1)).sum::<usize>(), 256 * 64);
    // The value (0, 0) turns fixed dicing off.
    let off = Rig::new(&[("float[2] dice:fixed", (&[0.0_f32, 0.0][..]).into())]);
    assert_eq!(off.rates(rectangle([2.0, 1.0], &[])), [[17, 9]]);
}

#[test]
fn fixed_rates_follow_named_variables() {
    let fixed = ("float[2] dice:fixed", ParamData::from(&[10.0_f32, 4.0][..]));
    let named = |u: &str, v: &str| {
        Rig::new(&[fixed.clone(), ("string dice:fixeduname", u.into()), ("string dice:fixedvname", v.into())])
    };
    // s runs from 0 to 0.5 along u, t from 0 to 2 along v.
    let s = param("linear float s", &[0.0_f32, 0.5, 0.0, 0.5][..]);
    let t = param("vertex float t", &[0.0_f32, 0.0, 2.0, 2.0][..]);
    let along = || rectangle([1.0, 1.0], &[s.clone(), t.clone()]);
    assert_eq!(named("u", "v").rates(along()), [[11, 5]]);
    assert_eq!(named("s", "t").rates(along()), [[6, 9]]);
    assert_eq!(named("s", "v").rates(along()), [[6, 5]]);
    // A primitive without the variables is measured by u and v.
    assert_eq!(named("s", "t").rates(rectangle([1.0, 1.0], &[])), [[11, 5]]);
    assert_eq!(named("q", "t").rates(along()), [[11, 9]]);
    // When s is rotated by a right angle, it runs along v, and its rate applies to v.
    let s = param("linear float s", &[0.0_f32, 0.0, 1.0, 1.0][..]);
    let t = param("linear float t", &[0.0_f32, 1.0, 0.0, 1.0][..]);
    assert_eq!(named("s", "t").rates(rectangle([1.0, 1.0], &[s, t])), [[5, 11]]);
}

#[test]
fn curvature_adds_segments_where_length_needs_few() {
    // A half circle 8 pixels across has an arc of 12.6 pixels. A part of it is seen at a slant.
    let along_u = |list: &[(&str, ParamData)]| {
        Rig::new(list).rates(half_pipe(0.5)).iter().map(|r| r[0] - 1).sum::<usize>()
    };
    let plain = along_u(&[("float dice:curvature", f(180.0))]);
    assert!((8..=16).contains(&plain), "{plain}");
    // 180 degrees are divided into steps of 10 degrees and of 5 degrees.
    let ten = along_u(&[]);
    assert!((18..=22).contains(&ten), "{ten}");
    // Steps of 5 degrees would be smaller than a third of a pixel. There are 24 thirds of a pixel.
    let five = along_u(&[("float dice:curvature", f(5.0))]);
    assert_eq!(five, 24);
}

#[test]
fn high_curvature_adds_segments_at_any_size() {
    // The half pipe is a thousandth of a pixel across.
    let along_u = |list: &[(&str, ParamData)]| {
        Rig::new(list).rates(half_pipe(1e-4)).iter().map(|r| r[0] - 1).sum::<usize>()
    };
    // Each of the two quarter circles has one segment.
    assert_eq!(along_u(&[]), 2);
    let fine = along_u(&[("float dice:highcurvature", f(15.0))]);
    assert!((12..=14).contains(&fine), "{fine}");
}

#[test]
fn orientation_affects_rates_unless_switched_off() {
    // The rectangle is seen from its edge: 16 pixels wide and 8 pixels deep.
    let turned =
        Transform::rotate(std::f32::consts::FRAC_PI_2, Vec3::X).then(&Transform::translate(Vec3::Z * 10.0));
    let rates = |rig: Rig| rig.rates_moving(rectangle([2.0, 1.0], &[]), &turned.into());
    assert_eq!(rates(Rig::new(&[])), [[17, 2]]);
    assert_eq!(rates(Rig::new(&[("int dice:rasterorient", f(0.0))])), [[17, 9]]);
}

#[test]
fn moving_objects_are_coarser_along_their_motion() {
    let moving = |by: Vec3| {
        let keys = vec![
            (0.0, Transform::translate(Vec3::Z * 10.0)),
            (1.0, Transform::translate(Vec3::Z * 10.0 + by)),
        ];
        MotionTransform::from_keys(keys).unwrap()
    };
    let facets = |list: &[(&str, ParamData)], by: Vec3| {
        Rig::new(list).rates_moving(rectangle([1.5, 1.5], &[]), &moving(by))
    };
    // There are 12 pixels in each direction. 24 pixels of motion give steps of 1 + 24 / 4 pixels along the motion.
    assert_eq!(facets(&[], Vec3::ZERO), [[13, 13]]);
    assert_eq!(facets(&[], Vec3::X * 3.0), [[3, 13]]);
    assert_eq!(facets(&[], Vec3::Y * 3.0), [[13, 3]]);
    // Larger factors coarsen more, smaller ones less, and 0 not at all.
    assert_eq!(facets(&[("float dice:motionfactor", f(4.0))], Vec3::X * 3.0), [[2, 13]]);
    assert_eq!(facets(&[("float dice:motionfactor", f(0.25))], Vec3::X * 3.0), [[6, 13]]);
    assert_eq!(facets(&[("float dice:motionfactor", f(0.0))], Vec3::X * 3.0), [[13, 13]]);
    // Motion towards the camera does not move points on the raster.
    assert_eq!(facets(&[], Vec3::Z * 3.0), [[13, 13]]);
}

/// The ground turns around the eye. Beside the image and before the near plane its raster motion has no bound, and
/// the coarsening once had none either. One segment reached from beside the eye to the horizon and crossed the image
/// as a sliver.
#[test]
fn motion_outside_of_the_image_coarsens_no_more_than_inside() {
    let mut params = Params::new();
    params.set(param("string projection", "perspective"));
    params.set(param("int[2] resolution", &[32.0_f32, 24.0][..]));
    params.set(param("float fov", 60.0));
    params.set(param("float near", 1e-3));
    params.set(param("float[2] shutter", &[0.0_f32, 1.0][..]));
    let seen = Camera { name: "main".into(), world_to_camera: MotionTransform::default(), params };
    let camera = CameraView::new(&seen, &Reporter::silent());
    let rig = Rig { camera: camera.clone(), ..Rig::new(&[]) };
    let ground = Transform::rotate(std::f32::consts::FRAC_PI_2, Vec3::X)
        .then(&Transform::translate(Vec3::new(0.0, -1.0, 0.0)));
    let turned = ground.then(&Transform::rotate(0.5, Vec3::Y));
    let to_world = MotionTransform::from_keys(vec![(0.0, ground), (1.0, turned)]).unwrap();
    let still = Placement::new(&ground.into(), &[0.0], &[], [0.0; 2]);
    let viewer = Viewer::new(&camera, &still, &[0.0]);
    let mut widest_deg = 0.0_f32;
    for leaf in rig.leaves(rectangle([2e4, 2e4], &[]), &to_world) {
        let dice = leaf.rates.dice(&*leaf.piece, &viewer);
        let p: Vec<Vec3> = dice.p[0].iter().map(|p| ground.point(*p)).collect();
        for (i, point) in p.iter().enumerate() {
            let next = [(i + 1, i % dice.nu + 1 < dice.nu), (i + dice.nu, i + dice.nu < p.len())];
            for (k, _) in next.into_iter().filter(|(_, there)| *there) {
                // Parts that turn into the image are seen away from the point under the eye.
                if point.z.hypot(point.x).min(p[k].z.hypot(p[k].x)) > 1.5 {
                    widest_deg = widest_deg.max(point.angle_between(p[k]).to_degrees());
                }
            }
        }
    }
    assert!(widest_deg < 60.0, "{widest_deg} degrees");
}

#[test]
fn moving_outlines_keep_their_segments() {
    let keys = vec![
        (0.0, Transform::translate(Vec3::Z * 20.0)),
        (1.0, Transform::translate(Vec3::new(8.0, 0.0, 20.0))),
    ];
    let moving = MotionTransform::from_keys(keys).unwrap();
    let along_u = |to_world: &MotionTransform| {
        let leaves = Rig::new(&[]).rates_moving(half_pipe(4.0), to_world);
        leaves.iter().map(|r| (r[0] - 1) * (r[1] - 1)).sum::<usize>()
    };
    let (still, fast) = (along_u(&Transform::translate(Vec3::Z * 20.0).into()), along_u(&moving));
    assert!(fast * 5 < still * 3 && fast * 12 > still, "{fast} instead of {still}");
}

#[test]
fn curves_are_split_at_creases_on_demand() {
    // The curve has two Bezier segments at a right angle, then a straight one.
    let p = [
        0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.2, 0.0, 0.0, 0.3, 0.0, 0.0, 0.3, 0.1, 0.0, 0.3, 0.2, 0.0, 0.3, 0.3,
        0.0, 0.3, 0.4, 0.0, 0.3, 0.5, 0.0, 0.3, 0.6, 0.0,
    ];
    let curve = |p: &[f32], nverts: usize| {
        let params = [param("vertex point P", p), param("constant float width", 0.01)];
        build(&ShapeDesc::Curves { basis: CurveBasis::Bezier, ncurves: 1, nverts }, &params)
    };
    assert_eq!(Rig::new(&[]).rates(curve(&p, 10)).len(), 1, "diced over");
    let to_world = Transform::translate(Vec3::Z * 10.0).into();
    let leaves = Rig::new(&[("int dice:keepcreases", f(1.0))]).leaves(curve(&p, 10), &to_world);
    assert_eq!(leaves.len(), 2);
    let ends: Vec<[f32; 2]> = leaves.iter().map(|l| [l.piece.domain()[2], l.piece.domain()[3]]).collect();
    assert_eq!(ends, [[0.0, 1.0 / 3.0], [1.0 / 3.0, 1.0]]);
    // A curve without creases is not split.
    let smooth: Vec<f32> = (0..10).flat_map(|i| [0.0, 0.1 * i as f32, 0.0]).collect();
    assert_eq!(Rig::new(&[("int dice:keepcreases", f(1.0))]).rates(curve(&smooth, 10)).len(), 1);
}

#[test]
fn patches_always_end_at_creases() {
    // The shape is a roof: a quadratic spline with a double knot at 1.
    let u = two_arcs();
    let v = one_line();
    let row =
        |y: f32| [[0.0, y, 0.0], [0.21, y, 0.2], [0.33, y, 0.37], [0.5, y, 0.2], [0.7, y, 0.0]].concat();
    let p = [row(0.0), row(0.4)].concat();
    for keep in [0.0, 1.0] {
        let rig = Rig::new(&[("int dice:keepcreases", f(keep))]);
        let pieces =
            build(&ShapeDesc::Nurbs { u: u.clone(), v: v.clone() }, &[param("vertex point P", &p[..])]);
        let leaves = rig.leaves(pieces, &Transform::translate(Vec3::Z * 10.0).into());
        let viewer = Viewer::new(
            &rig.camera,
            &Placement::new(&MotionTransform::default(), &[0.0], &[], [0.0; 2]),
            &[0.0],
        );
        let ridge = leaves
            .iter()
            .any(|leaf| leaf.rates.dice(&*leaf.piece, &viewer).p[0].contains(&Vec3::new(0.33, 0.0, 0.37)));
        assert!(ridge && leaves.len() == 2, "{} leaves", leaves.len());
    }
}

#[test]
fn thin_curves_have_one_segment_across() {
    let finest = |rates: Vec<[usize; 2]>| rates.into_iter().map(|r| r[0] - 1).max().unwrap();
    let fine = |thin: f32, width: f32| {
        let list = [("float shadingquality", f(4.0)), ("float dice:thincurve", f(thin))];
        finest(Rig::new(&list).rates(straight(0.5, width)))
    };
    // The curve is 0.8 pixels wide at 4 points per pixel. It is thinner than one pixel, so that its cross section is
    // not visible.
    assert_eq!(fine(1.0, 0.1), 1);
    assert_eq!(fine(0.5, 0.1), 3);
    assert_eq!(fine(0.0, 0.1), 3);
    // The curve is 2 pixels wide.
    assert_eq!(fine(1.0, 0.25), 8);
    assert_eq!(fine(3.0, 0.25), 1);
    // Other primitives are never treated as thin.
    let list = [("float shadingquality", f(4.0))];
    assert_eq!(finest(Rig::new(&list).rates(rectangle([0.1, 0.5], &[]))), 3);
}

#[test]
fn settings_that_are_not_finite_become_the_defaults() {
    let rig =
        Rig::new(&[("float dice:curvature", f(f32::NAN)), ("float dice:motionfactor", f(f32::INFINITY))]);
    assert_eq!(rig.rates(rectangle([2.0, 1.0], &[])), [[17, 9]]);
}

/// Returns the edges on the borders of grids that no other grid has in the opposite direction, for pieces of one
/// orientation.
fn open_edges(rig: &Rig, leaves: &[Leaf]) -> Vec<[Vec3; 2]> {
    let placement = Placement::new(&MotionTransform::default(), &[0.0], &[], [0.0; 2]);
    let viewer = Viewer::new(&rig.camera, &placement, &[0.0]);
    // The counts of edges by their ordered ends: forward minus backward.
    let mut edges: BTreeMap<[[u32; 3]; 2], i32> = BTreeMap::new();
    for leaf in leaves {
        let dice = leaf.rates.dice(&*leaf.piece, &viewer);
        let (nu, nv) = (dice.nu, dice.nv);
        let around = (0..nu)
            .chain((1..nv).map(|j| j * nu + nu - 1))
            .chain((0..nu - 1).rev().map(|i| (nv - 1) * nu + i))
            .chain((0..nv - 1).rev().map(|j| j * nu));
        let points: Vec<Vec3> = around.map(|i| dice.p[0][i] + 0.0).collect();
        for pair in points.windows(2).filter(|pair| pair[0] != pair[1]) {
            let [a, b] = [pair[0], pair[1]].map(|p| p.to_array().map(f32::to_bits));
            if a < b {
                *edges.entry([a, b]).or_default() += 1;
            } else {
                *edges.entry([b, a]).or_default() -= 1;
            }
        }
    }
    let point = |bits: [u32; 3]| Vec3::from(bits.map(f32::from_bits));
    edges.into_iter().filter(|(_, n)| *n != 0).map(|([a, b], _)| [point(a), point(b)]).collect()
}

/// Returns a rough field of `n x n` squares over [-4, 4] x [-3, 3]. Every other square is two triangles.
fn field(n: usize, subdivide: bool) -> Vec<Piece> {
    let random = |k: usize| (granita_base::hash::words(&[k as u32]) >> 8) as f32 / 16_777_216.0 - 0.5;
    let (mut p, mut nverts, mut verts) = (Vec::new(), Vec::new(), Vec::new());
    for j in 0..=n {
        for i in 0..=n {
            let inside = i > 0 && j > 0 && i < n && j < n;
            let k = (j * 17 + i) * 3;
            let off = if inside { [0, 1, 2].map(|c| random(k + c)) } else { [0.0; 3] };
            let place = |i: usize, size: f32, off: f32| ((i as f32 + off) / n as f32 - 0.5) * size;
            p.extend([place(i, 8.0, off[0]), place(j, 6.0, off[1]), 10.0 + off[2] * 3.0]);
        }
    }
    for j in 0..n {
        for i in 0..n {
            let [a, b, c, d] = [0, 1, n + 2, n + 1].map(|k| (j * (n + 1) + i + k) as i32);
            if (i + j) % 2 == 0 {
                nverts.push(4);
                verts.extend([a, b, c, d]);
            } else {
                nverts.extend([3, 3]);
                verts.extend([a, b, c, a, c, d]);
            }
        }
    }
    let shape = ShapeDesc::Mesh { subdivide, nverts: nverts.into(), verts: verts.into() };
    build(&shape, &[param("vertex point P", &p[..]), param("int border", 1.0)])
}

#[test]
fn neighbouring_grids_share_all_edges() {
    let mut camera = camera();
    for perspective in [false, true] {
        if perspective {
            let mut params = Params::new();
            params.set(param("int[2] resolution", &[320.0_f32, 240.0][..]));
            params.set(param("float fov", 50.0));
            let seen = Camera { name: "main".into(), world_to_camera: MotionTransform::default(), params };
            camera = CameraView::new(&seen, &Reporter::silent());
        }
        for (gridsize, binary, quality) in
            [(256.0, 0.0, 1.0), (64.0, 0.0, 0.3), (256.0, 1.0, 1.0), (100.0, 0.0, 1.7)]
        {
            let list = [
                ("int limits:gridsize", f(gridsize)),
                ("int dice:binary", f(binary)),
                ("float shadingquality", f(quality)),
            ];
            let rig = Rig { camera: camera.clone(), ..Rig::new(&list) };
            let still = MotionTransform::default();
            for n in [1, 2, 5, 16] {
                for subdivide in [false, true] {
                    let leaves = rig.leaves(field(n, subdivide), &still);
                    let inside = |[a, b]: &[Vec3; 2]| {
                        (0..2).all(|c| {
                            let outer = [4.0, 3.0][c];
                            !(a[c].abs() > outer - 1e-3 && (a[c] - b[c]).abs() < 1e-3)
                        })
                    };
                    let open: Vec<_> = open_edges(&rig, &leaves).into_iter().filter(inside).collect();
                    assert!(
                        open.is_empty(),
                        "{} edges are open in {} grids, {n} x {n}, subdivided {subdivide}, {list:?}: {:?}",
                        open.len(),
                        leaves.len(),
                        &open[..open.len().min(8)]
                    );
                }
            }
            let sphere = ShapeDesc::Sphere { radius: 3.0, zmin: -3.0, zmax: 3.0, thetamax_deg: 360.0 };
            let away = Transform::translate(Vec3::Z * 10.0).into();
            let leaves = rig.leaves(build(&sphere, &[]), &away);
            let open = open_edges(&rig, &leaves);
            assert!(open.is_empty(), "{} of {} grids of a sphere: {open:?}", open.len(), leaves.len());
        }
    }
}
