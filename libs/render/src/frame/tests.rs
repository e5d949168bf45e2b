// tidy: tests
//! Tests whole frames with shaders that are Rust functions, for geometry, sampling, filtering and determinism.

mod cracks;
mod displaced;
mod endless;
mod extremes;
mod huge;
mod motion;
mod passes;
mod seams;
mod stereo;
mod summed;
mod timed;

use super::*;
use granita_base::{Color, MotionTransform, Param, Params, ShapeDesc, Transform, Vec3};
use granita_gsl::ir::ValueType;
use granita_image::{CreateOptions, Format, FormatRegistry, ImageInput, ImageOutput, Limits};
use granita_scene::{AttributeSet, Camera, Output, ShapeKey, attr};
use granita_shade::Grid;

use std::path::Path;

/// A format that accepts everything and keeps nothing. The tests read the pixels before they are written.
struct Nowhere;

impl Format for Nowhere {
    fn name(&self) -> &'static str {
        "nowhere"
    }
    fn extensions(&self) -> &'static [&'static str] {
        &[]
    }
    fn recognizes(&self, _: &[u8]) -> bool {
        false
    }
    fn open(&self, path: &Path, _: &Limits) -> granita_image::Result<Box<dyn ImageInput>> {
        Err(granita_image::ImageError::Unsupported { path: path.to_owned(), what: "reading".to_owned() })
    }
    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "float" | "layers")
    }
    fn create(&self, path: &Path, _: &CreateOptions<'_>) -> granita_image::Result<Box<dyn ImageOutput>> {
        Err(granita_image::ImageError::Unsupported { path: path.to_owned(), what: "writing".to_owned() })
    }
}

/// Shades every grid with a function of the grid. The function receives the values of the object's attributes.
///
/// It is one type whatever the function is, because frames are compiled once for each type of shader.
struct Painted<'a> {
    paint: Box<dyn Fn(&mut Grid) + Sync + 'a>,
    displace: Option<f32>,
}

impl<'a> Painted<'a> {
    /// Returns the shader that runs `paint` and moves no point.
    fn new(paint: impl Fn(&mut Grid) + Sync + 'a) -> Self {
        Self { paint: Box::new(paint), displace: None }
    }
}

impl FrameShader for Painted<'_> {
    type Object = ObjectTraits;
    type Thread<'b>
        = ()
    where
        Self: 'b;

    fn object(&self, primitive: &Primitive) -> Arc<ObjectTraits> {
        let attributes = &primitive.attributes;
        Arc::new(ObjectTraits {
            opaque: attributes.get(attr::OPACITY) == Color::ONE,
            opaque_in_depth: attributes.get(attr::OPACITY) == Color::ONE
                || attributes.get(attr::RAY_OPAQUESHADOWS),
            holdout: attributes.holdout(),
            displaces: self.displace.is_some(),
            max_displacement_world: attributes.get(attr::DISPLACE_MAXRADIUS),
            measures: self.displace.is_some() && attributes.get(attr::DISPLACE_MAXRADIUS) == 0.0,
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
        let by = self.displace.unwrap_or(0.0);
        for i in 0..grid.len() {
            grid.p.set(i, grid.p.get(i) + grid.ng.get(i).normalize_or_zero() * by);
        }
    }
    fn shade(
        &self,
        (): &mut (),
        _: &ObjectTraits,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        (self.paint)(grid);
        wanted
            .iter()
            .map(|(name, _)| match &**name {
                "N" => Some(grid.n.xyz.concat()),
                "u" => Some(grid.u.clone()),
                _ => None,
            })
            .collect()
    }
}

/// Premultiplies C by opacity, as surface shaders do.
fn flat(grid: &mut Grid) {
    for i in 0..grid.len() {
        grid.c.set(i, grid.c.get(i) * grid.opacity.get(i));
    }
}

fn param(declaration: &str, values: &[f32]) -> Param {
    Param::declared(declaration, values).unwrap()
}

/// Returns the attributes of an object in the set "camera".
fn attributes(list: &[(&str, &[f32])], to_world: MotionTransform) -> Arc<AttributeSet> {
    let values: granita_scene::Values =
        list.iter().map(|(d, v)| param(d, v)).map(|p| (p.name.clone(), p)).collect();
    let values = Arc::new(values);
    let geometry_sets: Arc<[Arc<str>]> = [Arc::from("camera")].into();
    Arc::new(AttributeSet { values, to_world, geometry_sets, ..AttributeSet::default() })
}

fn at(x: f32, y: f32, z: f32) -> MotionTransform {
    Transform::translate(Vec3::new(x, y, z)).into()
}

fn sphere(radius: f32) -> ShapeDesc {
    ShapeDesc::Sphere { radius, zmin: -radius, zmax: radius, thetamax_deg: 360.0 }
}

/// Returns a square of half side `s` in the xy plane.
fn square(s: f32) -> (ShapeDesc, Params) {
    use granita_base::CurveBasis::Linear;
    let points = [-s, -s, 0.0, s, -s, 0.0, -s, s, 0.0, s, s, 0.0];
    (ShapeDesc::Patch { u: Linear, v: Linear, nu: 2, nv: 2 }, Params(vec![param("vertex point P", &points)]))
}

#[derive(Clone, Default)]
struct Build {
    scene: Scene,
    camera: Vec<(&'static str, Vec<f32>)>,
    world_to_camera: MotionTransform,
}

impl Build {
    fn add(&mut self, shape: ShapeDesc, params: Params, attributes: Arc<AttributeSet>) {
        let id = u32::try_from(self.scene.primitives.len()).unwrap();
        let keys = vec![ShapeKey { time: 0.0, params }];
        let at = Location::default();
        self.scene.primitives.push(Arc::new(Primitive { id, shape, keys, attributes, at }));
    }

    fn sphere(&mut self, radius: f32, list: &[(&str, &[f32])], to_world: MotionTransform) {
        self.add(sphere(radius), Params::new(), attributes(list, to_world));
    }

    fn square(&mut self, half: f32, list: &[(&str, &[f32])], to_world: MotionTransform) {
        let (shape, params) = square(half);
        self.add(shape, params, attributes(list, to_world));
    }

    /// Adds a polygon.
    fn polygon(&mut self, points: &[f32], to_world: MotionTransform) {
        let n = (points.len() / 3) as i32;
        let verts: Vec<i32> = (0..n).collect();
        let shape = ShapeDesc::Mesh { subdivide: false, nverts: [n].into(), verts: verts.into() };
        self.add(shape, Params(vec![param("vertex point P", points)]), attributes(&[], to_world));
    }

    fn view(&self, more: &[(&'static str, Vec<f32>)]) -> CameraView {
        self.view_reporting(more, &Reporter::silent())
    }

    fn view_reporting(&self, more: &[(&'static str, Vec<f32>)], reporter: &Reporter) -> CameraView {
        let mut params = Params::new();
        for (declaration, values) in self.camera.iter().chain(more) {
            params.set(param(declaration, values));
        }
        if self.camera.iter().any(|c| c.0 == "float orthographic") {
            params.set(Param::declared("string projection", "orthographic").unwrap());
        }
        let camera = Camera { name: "main".into(), world_to_camera: self.world_to_camera.clone(), params };
        CameraView::new(&camera, reporter)
    }
}

/// Renders one output of a scene. Returns the pixels of its crop window.
fn render_with<S: FrameShader>(
    build: &Build,
    view: &CameraView,
    threads: usize,
    output: (&str, &[Param]),
    shader: &S,
) -> Vec<f32> {
    render_counted(build, view, threads, output, shader).0
}

/// Returns a set of one image with this data and these parameters, which is not written.
fn one_output(view: &CameraView, (data, params): (&str, &[Param]), reporter: &Reporter) -> OutputSet {
    let mut registry = FormatRegistry::new(Limits::default());
    registry.register(Arc::new(Nowhere));
    let output = Output {
        name: "x".into(),
        format: "nowhere".into(),
        data: data.into(),
        camera: "main".into(),
        params: Params(params.to_vec()),
    };
    OutputSet::new(&[&output], view, &registry, reporter).unwrap()
}

/// Renders one output of a scene. Returns the pixels of its crop window and the statistics of the frame.
fn render_counted<S: FrameShader>(
    build: &Build,
    view: &CameraView,
    threads: usize,
    output: (&str, &[Param]),
    shader: &S,
) -> (Vec<f32>, Statistics) {
    let reporter = Reporter::silent();
    let mut outputs = one_output(view, output, &reporter);
    let stop = AtomicBool::new(false);
    let options = FrameOptions { threads, ..FrameOptions::new(view, &reporter, &stop) };
    let (statistics, complete) =
        render(&build.scene, shader, options, std::slice::from_mut(&mut outputs), None).unwrap();
    assert!(complete);
    (outputs.images.remove(0).pixels, statistics)
}

fn image(build: &Build, data: &str, params: &[Param]) -> Vec<f32> {
    render_with(build, &build.view(&[]), 1, (data, params), &Painted::new(flat))
}

fn box_filter() -> Vec<Param> {
    vec![Param::declared("string filter", "box").unwrap(), param("float[2] filterwidth", &[1.0, 1.0])]
}

/// Returns an orthographic camera that sees -4..4 by -3..3 in 64 x 48 pixels, which is 8 pixels per unit.
fn flat_camera() -> Build {
    Build {
        camera: vec![
            ("float orthographic", vec![1.0]),
            ("int[2] resolution", vec![64.0, 48.0]),
            ("float[4] screen", vec![-4.0, 4.0, -3.0, 3.0]),
        ],
        ..Build::default()
    }
}

fn pixel(image: &[f32], channels: usize, x: usize, y: usize) -> &[f32] {
    &image[(y * 64 + x) * channels..][..channels]
}

/// Returns a scene with overlap, transparency, motion and a displaced sphere.
fn busy() -> Build {
    let mut build = Build {
        camera: vec![
            ("int[2] resolution", vec![61.0, 47.0]),
            ("float fov", vec![50.0]),
            ("float[2] shutter", vec![0.0, 1.0]),
            ("float fstop", vec![2.0]),
            ("float focallength", vec![0.4]),
            ("float focaldistance", vec![5.0]),
        ],
        ..Build::default()
    };
    let moving = MotionTransform::from_keys(vec![
        (0.0, Transform::translate(Vec3::new(-1.0, 0.5, 4.0))),
        (0.5, Transform::translate(Vec3::new(0.0, 0.0, 4.5))),
        (1.0, Transform::translate(Vec3::new(0.5, 0.8, 5.0))),
    ])
    .unwrap();
    build.sphere(1.0, &[("color C", &[1.0, 0.5, 0.2])], at(0.6, -0.4, 5.0));
    build.sphere(0.7, &[("color C", &[0.1, 0.5, 0.9])], moving);
    build.square(
        1.5,
        &[("color C", &[0.2, 0.9, 0.3]), ("color opacity", &[0.5, 0.3, 0.2])],
        at(-0.7, 0.2, 4.2),
    );
    let tilted = Transform::rotate(1.4, Vec3::X).then(&Transform::translate(Vec3::new(0.0, -1.0, 3.0)));
    build.square(8.0, &[("color C", &[0.6, 0.6, 0.5])], tilted.into());
    build
}

fn wavy(grid: &mut Grid) {
    flat(grid);
    for i in 0..grid.len() {
        let wave = 0.5 + 0.5 * (40.0 * grid.u[i]).sin() * (30.0 * grid.v[i]).sin();
        grid.c.set(i, grid.c.get(i) * wave);
    }
}

#[test]
fn pixels_do_not_depend_on_threads_buckets_or_crops() {
    let build = busy();
    let shader = Painted { displace: Some(0.02), ..Painted::new(wavy) };
    let mut plain = build.clone();
    for primitive in &mut plain.scene.primitives {
        let mut set = (*primitive.attributes).clone();
        Arc::make_mut(&mut set.values)
            .insert("displace:maxradius".into(), param("float displace:maxradius", &[0.02]));
        Arc::make_mut(primitive).attributes = Arc::new(set);
    }
    let view = plain.view(&[]);
    let reference = render_with(&plain, &view, 1, ("rgba", &[]), &shader);
    assert!(reference.iter().any(|v| *v > 0.1));
    let sized = |x: f32, y: f32| plain.view(&[("int[2] limits:bucketsize", vec![x, y])]);
    let ordered = |order: &str| CameraView { bucketorder: order.into(), ..plain.view(&[]) };
    for (what, view, threads) in [
        ("three threads", view.clone(), 3),
        ("small buckets", sized(7.0, 5.0), 2),
        ("one bucket", sized(500.0, 500.0), 1),
        ("columns", sized(1.0, 100.0), 2),
        ("vertical", ordered("vertical"), 1),
        ("spiral", ordered("spiral"), 2),
    ] {
        let again = render_with(&plain, &view, threads, ("rgba", &[]), &shader);
        assert!(reference == again, "{what}");
    }
    let crop = plain.view(&[("float[4] crop", vec![0.3, 0.8, 0.2, 0.7])]);
    let part = render_with(&plain, &crop, 2, ("rgba", &[]), &shader);
    let rect = crop.crop;
    assert_eq!(part.len(), rect.width() * rect.height() * 4);
    for (j, row) in part.chunks(rect.width() * 4).enumerate() {
        let from = ((rect.y0 as usize + j) * 61 + rect.x0 as usize) * 4;
        assert!(row == &reference[from..from + row.len()], "row {j} of the crop");
    }
}

#[test]
fn depths_do_not_depend_on_buckets() {
    let build = busy();
    let shader = Painted::new(flat);
    for data in ["z", "avgz", "normal N"] {
        let a = render_with(&build, &build.view(&[]), 1, (data, &[]), &shader);
        let view = build.view(&[("int[2] limits:bucketsize", vec![9.0, 13.0])]);
        let b = render_with(&build, &view, 2, (data, &[]), &shader);
        assert!(a == b, "{data}");
    }
}

#[test]
fn a_sphere_covers_the_area_of_its_silhouette() {
    let mut build = flat_camera();
    build.sphere(2.0, &[], at(0.3, 0.1, 5.0));
    let image = image(&build, "rgba", &box_filter());
    let area: f32 = image.chunks(4).map(|p| p[3]).sum::<f32>() / 64.0;
    let exact = std::f32::consts::PI * 4.0;
    assert!((area / exact - 1.0).abs() < 0.005, "{area} instead of {exact}");
    assert_eq!(pixel(&image, 4, 34, 23), [1.0; 4], "the middle is covered without holes");
}

#[test]
fn there_are_no_holes_between_grids() {
    // The sphere is close, so that it is split into many grids of different rates.
    let mut build = Build { camera: vec![("int[2] resolution", vec![96.0, 96.0])], ..Build::default() };
    build.sphere(1.0, &[], at(0.0, 0.0, 1.6));
    let image = image(&build, "rgba", &box_filter());
    for y in 24..72 {
        for x in 24..72 {
            assert_eq!(image[(y * 96 + x) * 4 + 3], 1.0, "hole at {x} {y}");
        }
    }
}

#[test]
fn a_square_covers_exactly_its_pixels() {
    let mut build = flat_camera();
    // The edges lie on pixel borders. The square has 16 pixels per side, from (24, 16) to (40, 32).
    build.square(1.0, &[("color C", &[0.25, 0.5, 1.0])], at(0.0, 0.0, 3.0));
    let image = image(&build, "rgb", &box_filter());
    assert_eq!(pixel(&image, 3, 32, 24), [0.25, 0.5, 1.0]);
    assert_eq!(pixel(&image, 3, 25, 17), [0.25, 0.5, 1.0]);
    assert_eq!(pixel(&image, 3, 22, 24), [0.0; 3]);
    let sum: f32 = image.chunks(3).map(|p| p[2]).sum();
    assert_eq!(sum, 256.0);
}

/// Returns the mean and the greatest relative error of a covered area, whose exact value is given in square pixels. The
/// places of the shape differ by fractions of a pixel.
fn coverage_error(exact: f64, shape: impl Fn(&mut Build, MotionTransform)) -> (f64, f64) {
    let (mut sum, mut worst) = (0.0, 0.0_f64);
    for k in 0..100 {
        let mut build = flat_camera();
        // There are 8 pixels per unit.
        let offset = |a: f32| (k as f32 * a).fract() / 8.0;
        shape(&mut build, at(offset(0.618_034), offset(0.754_877), 3.0));
        let image = image(&build, "rgba", &box_filter());
        let area: f64 = image.chunks(4).map(|p| f64::from(p[3])).sum();
        let error = area / exact - 1.0;
        sum += error;
        worst = worst.max(error.abs());
    }
    (sum / 100.0, worst)
}

#[test]
fn rendered_areas_have_no_bias() {
    // A triangle that is not aligned with anything.
    let triangle = [-1.3, -0.7, 0.0, 1.1, -1.2, 0.0, 0.2, 1.4, 0.0];
    let exact = 0.5 * ((2.4 * 2.1) - (1.5 * -0.5)) * 64.0;
    let (mean, worst) = coverage_error(exact, |b, at| b.polygon(&triangle, at));
    assert!(mean.abs() < 0.001 && worst < 0.01, "triangle: mean {mean}, worst {worst}");
    // A disk is the silhouette of a sphere. Chords of one pixel lose 0.06 % of it.
    let exact = std::f64::consts::PI * 4.0 * 64.0;
    let (mean, worst) = coverage_error(exact, |b, at| {
        b.sphere(2.0, &[], at);
    });
    assert!(mean.abs() < 0.002 && worst < 0.005, "disk: mean {mean}, worst {worst}");
    // A slanted wire is a quarter of a pixel wide.
    let (dx, dy) = (0.008_f32, 0.8 / 60.0);
    let wire = [
        -2.0 - dx,
        -1.0 + dy,
        0.0,
        -2.0 + dx,
        -1.0 - dy,
        0.0,
        2.0 + dx,
        1.4 - dy,
        0.0,
        2.0 - dx,
        1.4 + dy,
        0.0,
    ];
    let exact = f64::from(2.0 * dx * 2.4 + 2.0 * dy * 4.0) * 64.0;
    let (mean, worst) = coverage_error(exact, |b, at| {
        // The wire is so thin that few samples see it.
        b.camera.push(("int[2] spatialquality", vec![16.0, 16.0]));
        b.polygon(&wire, at);
    });
    assert!(mean.abs() < 0.002 && worst < 0.1, "wire: mean {mean}, worst {worst}");
}

#[test]
fn a_moving_square_is_blurred_to_a_ramp() {
    let mut build = flat_camera();
    build.camera.push(("float[2] shutter", vec![0.0, 1.0]));
    build.camera.push(("int temporalquality", vec![64.0]));
    // The square is 16 pixels wide and moves by 16 pixels to the right. Its coverage is a tent from 16 to 48 over x.
    let moving = MotionTransform::from_keys(vec![
        (0.0, Transform::translate(Vec3::new(-1.0, 0.0, 3.0))),
        (1.0, Transform::translate(Vec3::new(1.0, 0.0, 3.0))),
    ])
    .unwrap();
    build.square(1.0, &[], moving);
    let image = image(&build, "rgba", &box_filter());
    for x in 0..64 {
        let middle = x as f32 + 0.5;
        let exact = (1.0 - (middle - 32.0).abs() / 16.0).max(0.0);
        let mean = (20..28).map(|y| pixel(&image, 4, x, y)[3]).sum::<f32>() / 8.0;
        assert!((mean - exact).abs() < 1.0 / 64.0, "{mean} instead of {exact} at {x}");
    }
}

/// Returns the mean square distance in square pixels from the middle of an image's alpha, along x and along y.
fn spread(image: &[f32], width: usize) -> [f64; 2] {
    let (mut mass, mut first, mut second) = (0.0, [0.0; 2], [0.0; 2]);
    for (k, pixel) in image.chunks(4).enumerate() {
        let alpha = f64::from(pixel[3]);
        mass += alpha;
        for (axis, place) in [(k % width) as f64, (k / width) as f64].into_iter().enumerate() {
            first[axis] += alpha * place;
            second[axis] += alpha * place * place;
        }
    }
    [0, 1].map(|axis| second[axis] / mass - (first[axis] / mass).powi(2))
}

#[test]
fn circles_of_confusion_have_their_radius() {
    const WIDTH: usize = 64;
    // The number of pixels per unit at z = 1.
    let scale = 80.0_f32;
    let (radius, focus) = (0.5, 4.0);
    for z in [2.0_f32, 3.0, 8.0, 40.0] {
        let mut build = Build {
            camera: vec![
                ("int[2] resolution", vec![WIDTH as f32, WIDTH as f32]),
                ("float fov", vec![2.0 * (32.0 / scale).atan().to_degrees()]),
                ("float fstop", vec![1.0]),
                ("float focallength", vec![2.0 * radius]),
                ("float focaldistance", vec![focus]),
                ("int dofquality", vec![1024.0]),
            ],
            ..Build::default()
        };
        // A square of four pixels lies slightly beside the middle.
        build.square(2.0 * z / scale, &[], at(0.1 / scale, 0.06 / scale, z));
        let image = image(&build, "rgba", &box_filter());
        // A disk of radius R spreads by R^2 / 4 along each axis, the square by 16 / 12 and a pixel by 1 / 12.
        let own = (16.0 + 1.0) / 12.0;
        let exact = f64::from(scale * radius * (1.0 / focus - 1.0 / z).abs());
        let [x, y] = spread(&image, WIDTH);
        let found = 2.0 * ((x + y) / 2.0 - own).max(0.0).sqrt();
        assert!((found / exact - 1.0).abs() < 0.01, "{found} instead of {exact} at depth {z}");
        assert!((x / y - 1.0).abs() < 0.02, "{x} along x and {y} along y at depth {z}");
    }
}

#[test]
fn depths_of_a_plane_are_exact() {
    let mut build = flat_camera();
    build.square(2.0, &[], at(0.0, 0.0, 7.25));
    build.square(1.0, &[], at(0.0, 0.0, 3.5));
    let z = image(&build, "z", &[]);
    assert!((pixel(&z, 1, 32, 24)[0] - 3.5).abs() < 1e-5);
    assert!((pixel(&z, 1, 20, 24)[0] - 7.25).abs() < 1e-5);
    assert_eq!(pixel(&z, 1, 2, 2), [granita_hider::film::NO_DEPTH]);
    let average = image(&build, "avgz", &[]);
    assert!((pixel(&average, 1, 32, 24)[0] - 5.375).abs() < 1e-5);
    assert_eq!(pixel(&average, 1, 20, 24), [granita_hider::film::NO_DEPTH], "a single surface is no surface");
}

#[test]
fn perspective_depth_is_exact_on_a_tilted_plane() {
    let mut build = Build { camera: vec![("int[2] resolution", vec![64.0, 64.0])], ..Build::default() };
    let tilted = Transform::rotate(0.9, Vec3::X).then(&Transform::translate(Vec3::new(0.0, 0.0, 6.0)));
    build.square(3.0, &[("float shadingquality", &[0.1])], tilted.into());
    let average = Param::declared("string filter", "average").unwrap();
    let z = image(&build, "z", &[average, param("float[2] filterwidth", &[1.0, 1.0])]);
    // The plane (y, z - 6) . (-sin a, cos a) = 0 with y = z s gives z = 6 / (1 - s tan a).
    for y in [28, 32, 40] {
        let s = 1.0 - (y as f32 + 0.5) / 32.0;
        let exact = 6.0 / (1.0 - s * 0.9_f32.tan());
        let got = z[y * 64 + 32];
        assert!((got / exact - 1.0).abs() < 0.01, "{got} instead of {exact}");
    }
}

#[test]
fn transparent_layers_composite_front_to_back() {
    let mut build = flat_camera();
    let (a, b) = ([0.5, 0.25, 0.75], [0.2, 0.4, 0.6]);
    build.square(2.0, &[("color C", &[1.0, 0.0, 0.0]), ("color opacity", &a)], at(0.0, 0.0, 3.0));
    build.square(2.0, &[("color C", &[0.0, 1.0, 0.0]), ("color opacity", &b)], at(0.0, 0.0, 4.0));
    build.square(2.0, &[("color C", &[0.5, 0.5, 0.5])], at(0.0, 0.0, 5.0));
    let over = image(&build, "rgba", &[]);
    let got = pixel(&over, 4, 32, 24);
    let through = |c: usize| (1.0 - a[c]) * (1.0 - b[c]);
    let expected = [a[0] + through(0) * 0.5, (1.0 - a[1]) * b[1] + through(1) * 0.5, through(2) * 0.5, 1.0];
    for c in 0..4 {
        assert!((got[c] - expected[c]).abs() < 1e-6, "{got:?} instead of {expected:?}");
    }
    // Without the wall behind them, alpha is the mean opacity.
    build.scene.primitives.pop();
    let alpha = pixel(&image(&build, "rgba", &[]), 4, 32, 24)[3];
    let mean = 1.0 - (through(0) + through(1) + through(2)) / 3.0;
    assert!((alpha - mean).abs() < 1e-6, "{alpha} instead of {mean}");
}

#[test]
fn limits_of_transparency_end_the_compositing() {
    let mut build = flat_camera();
    for z in [3.0, 4.0, 5.0] {
        build.square(2.0, &[("color opacity", &[0.5; 3])], at(0.0, 0.0, z));
    }
    let alpha = |build: &Build| pixel(&image(build, "rgba", &[]), 4, 32, 24)[3];
    assert_eq!(alpha(&build), 0.875);
    let mut few = build.clone();
    few.scene
        .globals
        .insert("limits:transparentlayers".into(), param("int limits:transparentlayers", &[2.0]));
    assert_eq!(alpha(&few), 0.75);
    let mut enough = build.clone();
    let threshold = param("color limits:opacitythreshold", &[0.5; 3]);
    enough.scene.globals.insert("limits:opacitythreshold".into(), threshold);
    assert_eq!(alpha(&enough), 0.5);
}

#[test]
fn holdouts_block_the_view() {
    for (mode, expected) in [(1.0, [0.0; 4]), (2.0, [0.5, 0.5, 0.5, 0.5])] {
        let mut build = flat_camera();
        build.square(1.0, &[("int holdout", &[mode]), ("color opacity", &[0.5; 3])], at(0.0, 0.0, 3.0));
        build.square(2.0, &[], at(0.0, 0.0, 5.0));
        let image = image(&build, "rgba", &[]);
        assert_eq!(pixel(&image, 4, 32, 24), expected, "mode {mode}");
        assert_eq!(pixel(&image, 4, 20, 24), [1.0; 4]);
    }
}

#[test]
fn a_filtered_constant_is_constant() {
    let mut build = flat_camera();
    build.square(9.0, &[("color C", &[0.3, 0.6, 0.9])], at(0.0, 0.0, 3.0));
    for filter in granita_base::Filter::ALL {
        let params = [
            Param::declared("string filter", filter.word()).unwrap(),
            param("float[2] filterwidth", &[3.0; 2]),
        ];
        let image = image(&build, "rgb", &params);
        assert!(image.chunks(3).all(|p| p == [0.3, 0.6, 0.9]), "{filter:?}");
    }
}

#[test]
fn clipped_objects_and_those_outside_of_the_set_are_invisible() {
    let mut build = flat_camera();
    build.camera.extend([("float near", vec![2.0]), ("float far", vec![6.0])]);
    build.square(1.0, &[], at(0.0, 0.0, 1.0));
    build.square(1.0, &[], at(0.0, 0.0, 7.0));
    assert!(image(&build, "rgba", &[]).iter().all(|v| *v == 0.0));
    build.square(1.0, &[], at(0.0, 0.0, 4.0));
    assert_eq!(pixel(&image(&build, "rgba", &[]), 4, 32, 24), [1.0; 4]);
    let elsewhere: Arc<[Arc<str>]> = [Arc::from("reflections")].into();
    for primitive in &mut build.scene.primitives {
        let set = AttributeSet { geometry_sets: elsewhere.clone(), ..(*primitive.attributes).clone() };
        Arc::make_mut(primitive).attributes = Arc::new(set);
    }
    assert!(image(&build, "rgba", &[]).iter().all(|v| *v == 0.0));
}

#[test]
fn a_floor_that_passes_under_the_camera_reaches_the_lower_edge() {
    let mut build = Build { camera: vec![("int[2] resolution", vec![64.0, 64.0])], ..Build::default() };
    let floor = Transform::rotate(std::f32::consts::FRAC_PI_2, Vec3::X)
        .then(&Transform::translate(Vec3::new(0.0, -1.0, 0.0)));
    build.square(100.0, &[], floor.into());
    let image = image(&build, "rgba", &box_filter());
    for y in 34..64 {
        for x in 0..64 {
            assert_eq!(pixel(&image, 4, x, y)[3], 1.0, "{x} {y}");
        }
    }
    assert_eq!(pixel(&image, 4, 32, 30)[3], 0.0);
}

#[test]
fn surfaces_are_clipped_at_the_near_plane() {
    // A wall along the axis reaches from z = -2 to z = 6, slightly to the right. The near plane is at 0.5.
    let mut build = Build {
        camera: vec![("int[2] resolution", vec![64.0, 64.0]), ("float near", vec![0.5])],
        ..Build::default()
    };
    let wall = Transform::rotate(std::f32::consts::FRAC_PI_2, Vec3::Y)
        .then(&Transform::translate(Vec3::new(0.2, 0.0, 2.0)));
    build.square(4.0, &[], wall.into());
    let image = image(&build, "rgba", &box_filter());
    // It begins at x = 0.2 / 0.5 = 0.4 of the half width, which is pixel 44.8, and ends at 0.2 / 6, which is pixel
    // 33.07.
    assert_eq!(pixel(&image, 4, 40, 32)[3], 1.0);
    assert_eq!(pixel(&image, 4, 46, 32)[3], 0.0);
    assert_eq!(pixel(&image, 4, 31, 32)[3], 0.0);
}

/// Ground under the eye that is displaced, or moves, is rendered. Its parts beside the image are not diced as finely as
/// the plane of the eye would require. Before, it was left out because it required more points than a primitive may
/// have.
#[test]
fn ground_around_the_eye_is_diced_by_its_visible_part() {
    for moves in [false, true] {
        let mut build = Build {
            camera: vec![
                ("int[2] resolution", vec![64.0, 64.0]),
                ("float near", vec![1e-3]),
                ("float[2] shutter", vec![0.0, f32::from(u8::from(moves))]),
            ],
            ..Build::default()
        };
        let ground = Transform::rotate(std::f32::consts::FRAC_PI_2, Vec3::X)
            .then(&Transform::translate(Vec3::new(0.0, -1.0, 0.0)));
        let turned = ground.then(&Transform::rotate(std::f32::consts::FRAC_PI_2, Vec3::Y));
        let to_world = match moves {
            true => MotionTransform::from_keys(vec![(0.0, ground), (1.0, turned)]).unwrap(),
            false => ground.into(),
        };
        let bound = if moves { 0.0 } else { 2.0 };
        build.square(100.0, &[("float displace:maxradius", &[bound])], to_world);
        let image = image(&build, "rgba", &box_filter());
        // All of it is visible up to the horizon, and so are the parts that turn from behind the eye into view.
        for x in 0..64 {
            assert!(pixel(&image, 4, x, 63)[3] > 0.99 && pixel(&image, 4, x, 36)[3] > 0.99, "{x}");
            assert_eq!(pixel(&image, 4, x, 29)[3], 0.0, "{x}");
        }
    }
}

#[test]
fn depth_of_field_keeps_the_focus_sharp() {
    let mut build = Build {
        camera: vec![
            ("int[2] resolution", vec![64.0, 64.0]),
            ("float fstop", vec![1.0]),
            ("float focallength", vec![1.0]),
            ("float focaldistance", vec![4.0]),
            ("int dofquality", vec![64.0]),
        ],
        ..Build::default()
    };
    build.square(1.0, &[], at(0.0, 0.0, 4.0));
    let sharp = image(&build, "rgba", &box_filter());
    // Half a side of 1 at distance 4 is 8 pixels.
    assert_eq!(pixel(&sharp, 4, 25, 32)[3], 1.0);
    assert_eq!(pixel(&sharp, 4, 22, 32)[3], 0.0);
    let mut far = build.clone();
    far.scene.primitives.clear();
    far.square(2.0, &[], at(0.0, 0.0, 8.0));
    let blurred = image(&far, "rgba", &box_filter());
    // The radius of confusion is 0.5 (1 - 4/8) / 4 * 32 = 2 pixels around the same edge.
    let edge = (0..64).map(|y| pixel(&blurred, 4, 24, y)[3]).fold(0.0, f32::max);
    assert!(edge > 0.3 && edge < 0.9, "{edge}");
    assert_eq!(pixel(&blurred, 4, 20, 32)[3], 0.0);
    assert_eq!(pixel(&blurred, 4, 28, 32)[3], 1.0);
}

#[test]
fn shader_variables_are_written_as_images() {
    let mut build = flat_camera();
    build.square(9.0, &[], at(0.0, 0.0, 3.0));
    let normal = image(&build, "normal N", &[]);
    let n = Vec3::from_slice(pixel(&normal, 3, 32, 24)).normalize();
    assert!((n.z.abs() - 1.0).abs() < 1e-6, "{n}");
    let u = image(&build, "float u", &[]);
    assert!((pixel(&u, 1, 32, 24)[0] - (0.5 + 0.5 / 144.0)).abs() < 1e-3);
    assert!(image(&build, "color absent", &[]).iter().all(|v| *v == 0.0));
}

#[test]
fn a_layer_has_the_pixels_of_an_image_of_its_own() {
    let build = busy();
    let shader = Painted::new(flat);
    let one =
        |data: &str, params: &[Param]| render_with(&build, &build.view(&[]), 2, (data, params), &shader);
    let closest = [Param::declared("string filter", "closest").unwrap()];
    let own = [
        (4, one("rgba", &[])),
        (1, one("z", &[])),
        (3, one("normal N", &[])),
        (3, one("point P", &closest)),
        (1, one("float u", &closest)),
    ];
    let filter = [Param::declared("string filter:u", "closest").unwrap()];
    let layers = one("rgba, z, normal N, point P, float u", &filter);
    assert_eq!(layers.len(), own.iter().map(|(_, pixels)| pixels.len()).sum::<usize>());
    for (k, pixel) in layers.chunks(12).enumerate() {
        let expected: Vec<f32> = own.iter().flat_map(|(n, pixels)| pixels[k * n..][..*n].to_vec()).collect();
        assert_eq!(pixel, expected, "pixel {k}");
    }
}

#[test]
fn degenerate_primitives_give_finite_pixels() {
    let mut build = flat_camera();
    build.sphere(0.0, &[], at(0.0, 0.0, 3.0));
    build.sphere(f32::NAN, &[], at(0.0, 0.0, 3.0));
    build.sphere(1.0, &[], at(f32::INFINITY, 0.0, 3.0));
    build.square(0.0, &[], at(0.0, 0.0, 3.0));
    let flat = Transform::scale(Vec3::new(1.0, 0.0, 1.0)).then(&Transform::translate(Vec3::Z * 3.0));
    build.sphere(1.0, &[], flat.into());
    let image = image(&build, "rgba", &[]);
    assert!(image.iter().all(|v| v.is_finite()));
}

#[test]
fn a_panic_of_a_shader_loses_only_its_bucket() {
    let mut build = flat_camera();
    build.square(9.0, &[], at(0.0, 0.0, 3.0));
    let view = build.view(&[]);
    let (reporter, kept) = Reporter::collecting();
    let mut outputs = one_output(&view, ("rgba", &[]), &reporter);
    let paint = |grid: &mut Grid| {
        let corner = (0..grid.len()).any(|i| grid.u[i] < 0.4 && grid.v[i] < 0.4);
        assert!(!corner, "no such corner");
    };
    let stop = AtomicBool::new(false);
    let files = ["scene.pyg".to_owned()];
    let options =
        FrameOptions { threads: 2, scene_files: &files, ..FrameOptions::new(&view, &reporter, &stop) };
    let shader = Painted::new(paint);
    let (_, complete) =
        render(&build.scene, &shader, options, std::slice::from_mut(&mut outputs), None).unwrap();
    assert!(!complete);
    let kept = kept.lock();
    assert!(!kept.is_empty());
    let text = kept[0].to_string();
    assert!(
        text.contains("no such corner") && text.contains("gelato -crop") && text.ends_with("scene.pyg"),
        "{text}"
    );

    assert_eq!(pixel(&outputs.images[0].pixels, 4, 50, 8), [1.0; 4], "the others are rendered");
}

#[test]
fn hidden_surfaces_are_neither_split_nor_shaded() {
    let shader = Painted::new(flat);
    // There are 20 layers, the nearest one last. The second scene has a hole in all but the farthest one, so that
    // nothing is in front of its right half.
    let layers = |half: f32, n: usize| {
        let mut build = flat_camera();
        for i in (0..n).rev() {
            let x = if i == 19 { 0.0 } else { half - 8.0 };
            build.square(8.0, &[("color C", &[0.1 * i as f32, 0.5, 1.0])], at(x, 0.0, 5.0 + i as f32));
        }
        build
    };
    for threads in [1, 4] {
        let render = |half: f32, n: usize| {
            let build = layers(half, n);
            let view = build.view(&[("int[2] bucketsize", vec![16.0, 16.0])]);
            render_counted(&build, &view, threads, ("rgb", &box_filter()[..]), &shader)
        };
        let ((one, of_one), (all, of_all)) = (render(8.0, 1), render(8.0, 20));
        assert_eq!(one, all);
        assert_eq!((of_all.primitives_built, of_all.primitives_split), (20, 1));
        assert_eq!(of_all.points_shaded, of_one.points_shaded);
        // Every other layer is tested once in each bucket.
        assert_eq!(of_all.primitives_hidden, 19 * of_all.buckets);
        // The farthest one is visible beside the nearest one.
        let (image, counts) = render(0.0, 20);
        assert!(pixel(&image, 3, 10, 10)[0] == 0.0 && (pixel(&image, 3, 50, 10)[0] - 1.9).abs() < 1e-5);
        // The others are shaded only where their border is in one grid with something visible.
        assert!(counts.points_shaded < of_one.points_shaded * 7, "{counts:?}");
    }
}
