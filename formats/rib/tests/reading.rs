// tidy: tests
//! Tests of the reader with text as input and calls and messages as output.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use granita_base::{CurveBasis, Interp, Location, Param, ParamData, Params, Reporter, ShapeDesc};
use granita_scene::{Call, Generator, GeneratorError, GeneratorSource, SceneSink, Stop};
use proptest::prelude::*;
use std::io::Write;
use std::sync::Arc;

/// Records calls, and tracks the world like a graphics state.
#[derive(Default)]
struct Recorder {
    calls: Vec<Call>,
    world: bool,
    rendered: bool,
    several: bool,
}

impl SceneSink for Recorder {
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
        assert!(at.is_known());
        match call {
            Call::World => self.world = true,
            Call::Render { .. } => self.rendered = true,
            _ => (),
        }
        self.calls.push(call);
        Ok(())
    }

    fn in_world(&self) -> bool {
        self.world
    }

    fn new_frame(&mut self) -> bool {
        let new = self.several && self.rendered;
        if new {
            self.world = false;
        }
        new
    }
}

fn rib() -> Arc<dyn Generator> {
    granita_rib::generators().remove(0)
}

fn run(bytes: &[u8], sink: &mut Recorder) -> (Result<(), GeneratorError>, Vec<String>) {
    let (reporter, kept) = Reporter::collecting();
    let source = GeneratorSource::bytes("t.rib", bytes);
    let result = rib().run(&source, sink, &reporter);
    let said = kept.lock().iter().map(ToString::to_string).collect();
    (result, said)
}

/// Returns the calls of a scene whose world contains `text`, without those of the camera, and the messages.
fn world(text: &str) -> (Vec<Call>, Vec<String>) {
    let mut sink = Recorder::default();
    let (result, said) = run(format!("WorldBegin\n{text}\nWorldEnd").as_bytes(), &mut sink);
    result.unwrap();
    let from = sink.calls.iter().position(|c| *c == Call::World).unwrap() + 1;
    let to = sink.calls.len() - 1;
    assert!(matches!(&sink.calls[to], Call::Render { camera: Some(c) } if &**c == "camera"));
    (sink.calls[from..to].to_vec(), said)
}

/// Returns the calls of [`world`], which must not report any messages.
fn clean(text: &str) -> Vec<Call> {
    let (calls, said) = world(text);
    assert!(said.is_empty(), "{text}: {said:?}");
    calls
}

fn names(calls: &[Call]) -> String {
    calls.iter().map(Call::name).collect::<Vec<_>>().join(" ")
}

fn only(calls: &[Call]) -> (&ShapeDesc, &Params) {
    let shapes: Vec<_> = calls
        .iter()
        .filter_map(|c| match c {
            Call::Shape { shape, params } => Some((&**shape, params)),
            _ => None,
        })
        .collect();
    assert_eq!(shapes.len(), 1, "{calls:?}");
    shapes[0]
}

fn floats(param: Option<&Param>) -> Vec<f32> {
    param.and_then(|p| p.data.to_floats()).map(|v| v.to_vec()).unwrap_or_default()
}

fn attribute(calls: &[Call], name: &str) -> Option<Param> {
    calls.iter().rev().find_map(|c| match c {
        Call::Attribute(p) if &*p.name == name => Some(p.clone()),
        _ => None,
    })
}

/// Returns the positions of `n` vertices.
fn p(n: usize) -> String {
    format!("\"P\" [{}]", (0..3 * n).map(|i| i.to_string()).collect::<Vec<_>>().join(" "))
}

#[test]
fn options_become_a_camera() {
    let mut sink = Recorder::default();
    let text = "##RenderMan RIB-Structure 1.0\nversion 3.03\nFrameBegin 1\nFormat 200 400 1\n\
        Projection \"perspective\" \"fov\" [30]\nClipping 1 100\nShutter 0 .5\nPixelSamples 3 2\n\
        DepthOfField 2.8 .05 4\nExposure 1.5 2.2\nQuantize \"rgba\" 255 0 255 .25\nPixelFilter \"box\" 1 1\n\
        Display \"a.tif\" \"file\" \"rgb\"\nDisplay \"+a.z\" \"zfile\" \"z\"\n\
        Option \"limits\" \"integer[2] bucketsize\" [16 8]\nOption \"searchpath\" \"shader\" [\"shaders:@\"]\n\
        CropWindow 0 .5 .25 1\nTranslate 0 0 5\nWorldBegin\nWorldEnd\nFrameEnd\n";
    let (result, said) = run(text.as_bytes(), &mut sink);
    assert!(result.is_ok() && said.is_empty(), "{said:?}");
    let get = |name: &str| floats(attribute(&sink.calls, name).as_ref());
    assert_eq!(get("resolution"), [200.0, 400.0]);
    assert_eq!(get("fov"), [30.0]);
    assert_eq!(get("screen"), [-1.0, 1.0, -2.0, 2.0], "the narrow side is 1");
    assert_eq!((get("near"), get("far")), (vec![1.0], vec![100.0]));
    assert_eq!(get("shutter"), [0.0, 0.5]);
    assert_eq!(get("spatialquality"), [3.0, 2.0]);
    assert_eq!((get("fstop"), get("focaldistance")), (vec![2.8], vec![4.0]));
    assert_eq!((get("limits:bucketsize"), get("crop")), (vec![16.0, 8.0], vec![0.0, 0.5, 0.25, 1.0]));
    assert_eq!(attribute(&sink.calls, "path:shader").unwrap().data, ParamData::from("shaders:&"));
    let outputs: Vec<_> = sink
        .calls
        .iter()
        .filter_map(|c| match c {
            Call::Output { name, format, data, params, .. } => Some((&**name, &**format, &**data, params)),
            _ => None,
        })
        .collect();
    assert_eq!(outputs.len(), 2);
    let (name, format, data, params) = outputs[0];
    assert_eq!((name, format, data), ("a.tif", "tiff", "rgb"));
    assert_eq!(floats(params.get("quantize")), [0.0, 255.0, 0.0, 255.0]);
    assert_eq!((floats(params.get("gain")), floats(params.get("gamma"))), (vec![1.5], vec![2.2]));
    assert_eq!(floats(params.get("filterwidth")), [1.0, 1.0]);
    let (name, format, data, params) = outputs[1];
    assert_eq!((name, format, data), ("a.z", "shadow", "z"));
    assert_eq!(floats(params.get("quantize")), [0.0; 4]);
    assert_eq!(names(&sink.calls[sink.calls.len() - 3..]), "Translate World Render");
}

#[test]
fn options_default_to_those_of_the_interface() {
    let mut sink = Recorder::default();
    run(b"WorldBegin WorldEnd", &mut sink).0.unwrap();
    let get = |name: &str| floats(attribute(&sink.calls, name).as_ref());
    assert_eq!(get("resolution"), [640.0, 480.0]);
    assert_eq!(get("spatialquality"), [2.0, 2.0]);
    assert!((get("screen")[1] - 4.0 / 3.0).abs() < 1e-6);
    assert_eq!(attribute(&sink.calls, "projection").unwrap().data, ParamData::from("orthographic"));
    let mut sink = Recorder::default();
    run(b"Projection \"perspective\" WorldBegin WorldEnd", &mut sink).0.unwrap();
    assert_eq!(floats(attribute(&sink.calls, "fov").as_ref()), [90.0]);
}

#[test]
fn attributes_and_transformations_become_calls() {
    let calls = clean(
        "AttributeBegin Color 1 0.5 0 Opacity [.5 .5 .5] Sides 1 Matte 1 ReverseOrientation ShadingRate 4\n\
         Attribute \"identifier\" \"name\" [\"ball\"] Attribute \"displacementbound\" \"sphere\" [2]\n\
         Attribute \"user\" \"uniform float weight\" [3]\n\
         TransformBegin Rotate 90 0 0 1 Scale 1 2 3 Identity ConcatTransform [1 0 0 0 0 1 0 0 0 0 1 0 4 5 6 1]\n\
         CoordinateSystem \"here\" CoordSysTransform \"world\" TransformEnd AttributeEnd",
    );
    let attributes = ["Attribute"; 10].join(" ");
    assert_eq!(
        names(&calls),
        format!(
            "PushAttributes {attributes} PushTransform Rotate Scale SetTransform AppendTransform SaveAttributes \
             SetTransform PopTransform PopAttributes"
        )
    );
    assert_eq!(floats(attribute(&calls, "shadingquality").as_ref()), [0.5]);
    assert_eq!(floats(attribute(&calls, "C").as_ref()), [1.0, 0.5, 0.0]);
    assert_eq!(floats(attribute(&calls, "twosided").as_ref()), [0.0]);
    assert_eq!(floats(attribute(&calls, "user:weight").as_ref()), [3.0]);
}

#[test]
fn shaders_and_lights_become_calls() {
    let calls = clean(
        "Declare \"bumps\" \"uniform float[2]\"\n\
         Surface \"plastic\" \"Kd\" .7 \"specularcolor\" [1 0 0] \"bumps\" [1 2] \"varying color tint\" [1 1 1]\n\
         Displacement \"dented.sl\" Atmosphere \"fog\" \"distance\" 10\n\
         LightSource \"pointlight\" 1 \"intensity\" 20 \"from\" [1 2 3]\nLightSource \"spotlight\" \"key\"\n\
         Illuminate 1 0 AreaLightSource \"arealight\" 3 \"intensity\" [2]",
    );
    let Call::Shader { usage, name, params, .. } = &calls[0] else { panic!() };
    assert_eq!((&**usage, name.as_deref()), ("surface", Some("plastic")));
    let declared: Vec<String> = params.iter().map(Param::declaration).collect();
    assert_eq!(declared, ["float Kd", "color specularcolor", "float[2] bumps", "color tint"]);
    let Call::Shader { usage, name, .. } = &calls[1] else { panic!() };
    assert_eq!((&**usage, name.as_deref()), ("displacement", Some("dented")));
    assert!(matches!(&calls[2], Call::Shader { usage, .. } if &**usage == "volume"));
    let Call::Light { id, params, .. } = &calls[3] else { panic!() };
    assert_eq!(
        (&**id, params.float("falloff")),
        ("1", None),
        "the shader falls off with the square by itself"
    );
    let Call::Light { id, params, .. } = &calls[4] else { panic!() };
    assert_eq!((&**id, params.0.len()), ("key", 0));
    assert!(matches!(&calls[5], Call::LightSwitch { id, on: false } if &**id == "1"));
    let Call::Light { params, .. } = &calls[6] else { panic!() };
    assert_eq!(params.string("geometry").map(|s| &**s), Some("arealight1"));
    assert!(matches!(&calls[7], Call::Attribute(p) if p.data == ParamData::from("+arealight1")));
}

#[test]
fn polygons_become_meshes() {
    let square = "\"P\" [0 0 0 1 0 0 1 1 0 0 1 0]";
    let text = format!("Polygon {square} \"Cs\" [1 0 0 1 0 0 1 0 0 1 0 0] \"uniform float k\" [2]");
    let calls = clean(&text);
    let (shape, params) = only(&calls);
    let ShapeDesc::Mesh { subdivide: false, nverts, verts } = shape else { panic!() };
    assert_eq!((&nverts[..], &verts[..]), (&[4][..], &[0, 1, 2, 3][..]));
    assert_eq!(params.get("C").unwrap().ty.interp, Interp::Vertex);
    assert_eq!(params.get("k").unwrap().ty.interp, Interp::PerPiece);
    let st = "\"facevarying float[2] st\" [0 0 1 0 1 1 0 0 1 1 0 1]";
    let calls = clean(&format!("PointsPolygons [3 3] [0 1 2 0 2 3] {square} {st}"));
    let (_, params) = only(&calls);
    assert_eq!(params.get("s").unwrap().ty.interp, Interp::Linear);
    assert_eq!(floats(params.get("t")), [0.0, 0.0, 1.0, 0.0, 1.0, 1.0]);
    // A hole becomes a cut. The polygon has eight corners and two more.
    let calls = clean(
        "GeneralPolygon [4 4] \"P\" [0 0 0 9 0 0 9 9 0 0 9 0  3 3 0 6 3 0 6 6 0 3 6 0]\n\
         \"facevarying float f\" [0 1 2 3 4 5 6 7]",
    );
    let (shape, params) = only(&calls);
    let ShapeDesc::Mesh { nverts, verts, .. } = shape else { panic!() };
    assert_eq!(nverts[..], [10]);
    let f: Vec<i32> = floats(params.get("f")).iter().map(|f| *f as i32).collect();
    assert_eq!(f[..], verts[..], "values go with their corners");
    let calls = clean(&format!(
        "SubdivisionMesh \"catmull-clark\" [4] [0 1 2 3] [\"interpolateboundary\" \"hole\"] [0 0 1 0] [0] [] {square}\n\
         \"varying float w\" [1 2 3 4]"
    ));
    let (shape, params) = only(&calls);
    assert!(matches!(shape, ShapeDesc::Mesh { subdivide: true, .. }));
    assert_eq!((params.int("border"), floats(params.get("holes"))), (Some(1), vec![0.0]));
    assert_eq!(params.get("w").unwrap().ty.interp, Interp::Linear);
}

#[test]
fn patches_and_patch_meshes_become_patches() {
    let calls = clean(&format!("Patch \"bilinear\" {} \"st\" [0 0 1 0 0 1 1 1]", p(4)));
    let (shape, params) = only(&calls);
    assert!(matches!(shape, ShapeDesc::Patch { nu: 2, nv: 2, .. }));
    assert_eq!(floats(params.get("s")), [0.0, 1.0, 0.0, 1.0]);
    let mesh =
        "Basis \"b-spline\" 1 \"b-spline\" 1 PatchMesh \"bicubic\" 5 \"nonperiodic\" 4 \"nonperiodic\"";
    let calls = clean(&format!("{mesh} {}", p(20)));
    assert!(matches!(only(&calls).0, ShapeDesc::Patch { u: CurveBasis::BSpline, nu: 5, nv: 4, .. }));
    // With values at the corners of the patches, it becomes Bezier patches. Their inner values lie on straight lines.
    let calls = clean(&format!("{mesh} {} \"varying float k\" [0 3 6 9 12 15]", p(20)));
    let (shape, params) = only(&calls);
    assert!(matches!(shape, ShapeDesc::Patch { u: CurveBasis::Bezier, nu: 7, nv: 4, .. }));
    let k = floats(params.get("k"));
    assert_eq!((k.len(), &k[..7]), (28, &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0][..]));
    assert_eq!((params.get("k").unwrap().ty.interp, k[27]), (Interp::Vertex, 15.0));
    let calls = clean(&format!("PatchMesh \"bilinear\" 3 \"periodic\" 2 \"nonperiodic\" {}", p(6)));
    let (shape, params) = only(&calls);
    assert!(matches!(shape, ShapeDesc::Patch { nu: 4, nv: 2, .. }));
    let points = floats(params.get("P"));
    assert_eq!(points[..3], points[9..12]);
    let trim = "TrimCurve [1] [2] [0 0 1 2 3 3] [0] [3] [4] [.1 .9 .5 .1] [.1 .1 .9 .1] [1 1 1 1]";
    let nurbs = format!("NuPatch 4 4 [0 0 0 0 1 1 1 1] 0 1 2 2 [0 0 1 1] 0 1 {}", p(8));
    let calls = clean(&format!("{trim} {nurbs} TrimCurve [] [] [] [] [] [] [] [] []"));
    assert!(matches!(&calls[0], Call::TrimCurve(Some(t)) if t.uvw.len() == 12));
    assert!(matches!(only(&calls).0, ShapeDesc::Nurbs { u, v } if u.n == 4 && v.order == 2));
    assert_eq!(calls[2], Call::TrimCurve(None));
}

#[test]
fn curves_and_points_become_shapes() {
    let calls = clean(&format!(
        "Curves \"linear\" [2 3 3] \"nonperiodic\" {} \"uniform float id\" [7 8 9]\n\
         \"varying float width\" [1 2 3 4 5 6 7 8]",
        p(8)
    ));
    assert_eq!(names(&calls), "Curves Curves");
    let Call::Shape { shape, params } = &calls[1] else { panic!() };
    assert!(matches!(**shape, ShapeDesc::Curves { ncurves: 2, nverts: 3, .. }));
    assert_eq!(floats(params.get("id")), [8.0, 9.0]);
    assert_eq!(floats(params.get("width")), [3.0, 4.0, 5.0, 6.0, 7.0, 8.0]);
    // Seven vertices are two Bezier segments with widths at three ends.
    let calls = clean(&format!("Curves \"cubic\" [7] \"nonperiodic\" {} \"width\" [0 3 0]", p(7)));
    assert_eq!(floats(only(&calls).1.get("width")), [0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0]);
    let calls = clean(&format!("Curves \"cubic\" [4] \"nonperiodic\" {} \"constantwidth\" [.1]", p(4)));
    assert!(matches!(only(&calls).0, ShapeDesc::Curves { basis: CurveBasis::Bezier, nverts: 4, .. }));
    let calls = clean(&format!("Points {} \"varying float width\" [1 2 3]", p(3)));
    let (shape, params) = only(&calls);
    assert_eq!(
        (shape, params.get("width").unwrap().ty.interp),
        (&ShapeDesc::Points { n: 3 }, Interp::Vertex)
    );
}

#[test]
fn quadrics_become_shapes_with_texture_coordinates() {
    let calls =
        clean("TextureCoordinates 0 0 2 0 0 3 2 3 Sphere 1 -1 1 360 \"Cs\" [1 0 0 0 1 0 0 0 1 1 1 1]");
    let (shape, params) = only(&calls);
    assert_eq!(*shape, ShapeDesc::Sphere { radius: 1.0, zmin: -1.0, zmax: 1.0, thetamax_deg: 360.0 });
    assert_eq!(floats(params.get("t")), [0.0, 0.0, 3.0, 3.0]);
    let all = [
        "Cone 1 1 360",
        "Cylinder 1 -1 1 360",
        "Disk 0 1 360",
        "Torus 2 1 0 360 360",
        "Paraboloid 1 0 1 90",
        "Hyperboloid 1 0 0 1 1 1 [180]",
    ];
    for text in all {
        assert!(matches!(only(&clean(text)).0, ShapeDesc::Nurbs { .. }), "{text}");
    }
}

#[test]
fn motion_blocks_become_motion_calls() {
    let calls = clean("MotionBegin [0 1] Translate 0 0 0 Translate 1 0 0 MotionEnd");
    assert_eq!(names(&calls), "Motion Translate Translate");
    let calls = clean("MotionBegin [0 .5] Sphere 1 -1 1 360 Sphere 2 -2 2 360 MotionEnd");
    assert_eq!(names(&calls), "Motion Patch Patch", "a sphere that grows is a patch at each time");
    let calls = clean(&format!("MotionBegin [0 1] Polygon {} Polygon {} MotionEnd", p(3), p(3)));
    assert_eq!(names(&calls), "Motion Mesh Mesh");
    let (calls, said) = world("MotionBegin [0 1] Color 1 0 0 Color 0 1 0 MotionEnd Sphere 1 -1 1 360");
    assert_eq!((names(&calls).as_str(), said.len()), ("Attribute Sphere", 1));
    let (calls, said) = world("MotionBegin [0 1] Translate 1 0 0 MotionEnd");
    assert_eq!((names(&calls).as_str(), said.len()), ("Translate", 1));
}

#[test]
fn object_instances_repeat_the_calls_of_the_object() {
    let calls =
        clean("ObjectBegin 5 Translate 1 0 0 Sphere 1 -1 1 360 ObjectEnd ObjectInstance 5 ObjectInstance 5");
    let one = "PushAttributes Translate Sphere PopAttributes";
    assert_eq!(names(&calls), format!("{one} {one}"));
    let (calls, said) = world("ObjectInstance \"x\" ObjectBegin 1 ObjectInstance 1 ObjectEnd");
    assert_eq!((calls.len(), said.len()), (0, 2), "{said:?}");
}

#[test]
fn options_and_state_are_restored_after_each_frame() {
    let text = "Format 8 8 1 Display \"all.tif\" \"file\" \"rgb\" Surface \"matte\"\n\
        FrameBegin 1 Display \"one.tif\" \"file\" \"rgb\" Translate 0 0 1 WorldBegin Sphere 1 -1 1 360 WorldEnd FrameEnd\n\
        MakeTexture \"one.tif\" \"one.tx\" \"periodic\" \"clamp\" \"gaussian\" 2 2\n\
        FrameBegin 2 Translate 0 0 2 WorldBegin WorldEnd FrameEnd";
    let mut sink = Recorder { several: true, ..Recorder::default() };
    let (result, said) = run(text.as_bytes(), &mut sink);
    assert!(result.is_ok() && said.is_empty(), "{said:?}");
    let short: Vec<&str> = sink.calls.iter().map(Call::name).filter(|n| *n != "Attribute").collect();
    assert_eq!(
        short.join(" "),
        "Output Shader Translate World Sphere Render Command Output Shader Translate World Render"
    );
    let translations: Vec<_> = sink.calls.iter().filter(|c| matches!(c, Call::Translate(_))).collect();
    assert_eq!(translations, [&Call::Translate([0.0, 0.0, 1.0]), &Call::Translate([0.0, 0.0, 2.0])]);
    let command = sink.calls.iter().find_map(|c| match c {
        Call::Command { params, .. } => params.get("argv").map(|p| p.data.clone()),
        _ => None,
    });
    let Some(ParamData::String(words)) = command else { panic!() };
    assert_eq!(words.join(" "), "maketx -smode periodic -tmode clamp one.tif -o one.tx");
    // A receiver of only one frame gets the first one.
    let mut sink = Recorder::default();
    let (_, said) = run(text.as_bytes(), &mut sink);
    assert_eq!(said.len(), 1);
    assert_eq!(sink.calls.iter().filter(|c| **c == Call::World).count(), 1);
}

#[test]
fn files_that_are_read_after_world_add_objects_only() {
    let mut sink = Recorder { world: true, ..Recorder::default() };
    let (_, said) = run(b"Translate 1 0 0 Color 1 0 0 Sphere 1 -1 1 360", &mut sink);
    assert!(said.is_empty());
    assert_eq!(names(&sink.calls), "Translate Attribute Sphere");
    let mut sink = Recorder { world: true, ..Recorder::default() };
    let text = b"Format 9 9 1 Translate 1 0 0 Color 1 0 0 WorldBegin Sphere 1 -1 1 360 WorldEnd";
    let (_, said) = run(text, &mut sink);
    assert_eq!(said.len(), 1);
    assert_eq!(names(&sink.calls), "PushAttributes Attribute Sphere PopAttributes");
}

#[test]
fn archives_and_procedurals_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &[u8]| {
        std::fs::write(folder.path().join(name), text).unwrap();
        folder.path().join(name)
    };
    file("ball.rib", b"Surface \"matte\" \"mine\" 3 Sphere 1 -1 1 360\nNonsense 1 2 \"a\"\n");
    file("self.rib", b"ReadArchive \"self.rib\" Sphere 2 -2 2 360");
    let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gz.write_all(b"Disk 0 1 360").unwrap();
    file("disk.rib.gz", &gz.finish().unwrap());
    let main = file(
        "main.rib",
        b"WorldBegin\nDeclare \"mine\" \"float\"\nReadArchive \"ball.rib\"\nReadArchive \"disk.rib.gz\"\n\
          ReadArchive \"self.rib\"\nReadArchive \"absent.rib\"\n\
          Procedural \"DelayedReadArchive\" [\"ball.rib\"] [-1 1 -1 1 -1 1]\n\
          Procedural \"RunProgram\" [\"makehair\" \"it's 3\"] [-1 1 -1 1 -1e38 1e38]\n\
          Procedural \"DynamicLoad\" [\"a.so\" \"b\"] [-1 1 -1 1 -1 1]\nSphere 3 -3 3 360\nWorldEnd",
    );
    let (reporter, kept) = Reporter::collecting();
    let mut sink = Recorder::default();
    rib().run(&GeneratorSource::file(main), &mut sink, &reporter).unwrap();
    let from = sink.calls.iter().position(|c| *c == Call::World).unwrap();
    assert_eq!(names(&sink.calls[from..]), "World Shader Sphere Patch Sphere Input Input Sphere Render");
    let inputs: Vec<_> = sink
        .calls
        .iter()
        .filter_map(|c| match c {
            Call::Input { command, bound } => Some((command.to_string(), *bound)),
            _ => None,
        })
        .collect();
    assert!(
        inputs[0].0.starts_with("rib << Declare \"mine\" \"uniform float\" ReadArchive \""),
        "{inputs:?}"
    );
    assert_eq!(inputs[0].1, Some([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0]));
    assert_eq!(inputs[1], ("rib < printf '%s\\n' '1000000 it'\\''s 3' | makehair".to_owned(), None));
    let said: Vec<String> = kept.lock().iter().map(ToString::to_string).collect();
    assert_eq!(said.len(), 4, "{said:?}");
    assert!(said[0].contains("ball.rib:2: error: unknown request Nonsense"), "{said:?}");
    let itself =
        "self.rib:1: error: ReadArchive: \"self.rib\" would read itself: main.rib -> self.rib -> self.rib";
    assert!(said[1].contains(itself), "{said:?}");
    assert!(said[2].contains("main.rib:6: error: ReadArchive: cannot find \"absent.rib\""));
    assert!(said[3].contains("main.rib:9: warning: Procedural \"DynamicLoad\" is not supported"));
}

#[test]
fn binary_and_compressed_files_are_read() {
    let mut bytes = b"WorldBegin ".to_vec();
    bytes.extend([0xcc, 1, 0x96]);
    bytes.extend(b"Sphere");
    bytes.extend([0xa6, 1, 0x80, 1, 0x80, 0xff, 0x85, 0, 0x80, 0xa4]);
    bytes.extend(90.0_f32.to_be_bytes());
    bytes.extend(b" WorldEnd");
    let mut gz = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    gz.write_all(&bytes).unwrap();
    for bytes in [bytes, gz.finish().unwrap()] {
        let mut sink = Recorder::default();
        let (result, said) = run(&bytes, &mut sink);
        assert!(result.is_ok() && said.is_empty(), "{said:?}");
        let (shape, _) = only(&sink.calls);
        assert_eq!(*shape, ShapeDesc::Sphere { radius: 1.0, zmin: -1.0, zmax: 0.5, thetamax_deg: 90.0 });
    }
}

#[test]
fn an_invalid_request_is_skipped_with_a_message() {
    let bad = [
        ("Sphere 1 2", "Sphere: needs 4 numbers, not 2: the request is left out"),
        ("Polygon \"P\" [0 0 0 1]", "Polygon: parameter \"P\" has 4 values, not a multiple of 3"),
        ("Polygon", "Polygon: no \"P\""),
        ("Color 1 2", "Color: needs 3 numbers"),
        ("Surface 3", "Surface: argument 1 should be a string"),
        ("Surface \"a\" \"b\" 1", "Surface: parameter \"b\" is not declared"),
        ("PointsPolygons [3] \"P\" [1 2 3]", "PointsPolygons: argument 2 should be integers"),
        (
            "PatchMesh \"bicubic\" 5 \"nonperiodic\" 4 \"nonperiodic\" \"P\" [0 0 0]",
            "1 points where 5 x 4 are needed",
        ),
        ("NuPatch 4 4 [0 1] 0 1 4 4 [0 1] 0 1 \"P\" [1 2 3]", "4 vertices of order 4 with 2 knots"),
        ("Curves \"cubic\" [3] \"nonperiodic\" \"P\" [0 0 0]", "3 vertices make no whole curve"),
        ("Basis \"bezier\" 9 \"bezier\" 3", "Basis: needs basis, step, basis, step"),
        ("AttributeEnd", "AttributeEnd: without AttributeBegin"),
        ("AttributeBegin TransformEnd AttributeEnd", "TransformEnd: AttributeBegin of line 3 is still open"),
        ("WorldBegin", "WorldBegin: inside of a world"),
        ("ObjectEnd", "ObjectEnd: without ObjectBegin"),
        ("MotionEnd", "MotionEnd: without MotionBegin"),
        ("Blobby 1 [1] [1] []", "Blobby is not supported"),
        ("Color [1 0", "\"[\" without \"]\""),
        ("{ 1 2 }", "unexpected {"),
        ("Skew 10 1 0 0 1 0 0", "do not define a skew"),
        ("Paraboloid 1 -1 1 360", "it has no surface"),
        ("MakeTexture \"a\"", "MakeTexture: argument 2 should be a string"),
        ("Declare \"x\" \"nothing\"", "\"nothing\" is not a type"),
    ];
    for (text, expected) in bad {
        let (calls, said) = world(&format!("\n{text}\nTranslate 1 2 3"));
        assert!(said.iter().any(|s| s.contains(expected)), "{text}: {said:?}");
        assert!(calls.contains(&Call::Translate([1.0, 2.0, 3.0])), "{text}: the rest is read");
    }
    let mut sink = Recorder::default();
    let (_, said) = run(b"WorldBegin\nAttributeBegin\nSphere 1 -1 1 360", &mut sink);
    assert!(!sink.rendered && said.len() == 2, "{said:?}");
    assert!(said[1].contains("t.rib:1: error: WorldBegin without WorldEnd: the frame is not rendered"));
    let (result, said) = run(b"WorldBegin \"no end", &mut Recorder::default());
    assert!(result.is_ok());
    assert!(said[0].starts_with("t.rib:1: error: WorldBegin: a string without its end"), "{said:?}");
    // A string without its end is an error of its request, at the line where the request begins. A string may contain a
    // line end.
    let text = "\nSurface \"plastic\n  Translate 1 2 3\nAttribute \"identifier\" \"name\" [\"a\nSurface, b\"]\nSpere 1 2";
    let (calls, said) = world(text);
    assert!(calls.contains(&Call::Translate([1.0, 2.0, 3.0])));
    assert_eq!(attribute(&calls, "name").unwrap().data, ParamData::from("a\nSurface, b"));
    let told: Vec<&str> = said.iter().map(String::as_str).collect();
    let unclosed = "t.rib:3: error: Surface: a string without its end: the request is left out";
    let unknown = "t.rib:7: error: unknown request Spere; did you mean \"Sphere\"?: it is left out";
    assert_eq!(told, [unclosed, unknown]);
}

#[test]
fn conditionals_choose_their_requests() {
    let text = "\
Option \"user\" \"string pass\" [\"shadow\"]
IfBegin \"$user:pass == 'shadow'\"
  Translate 1 0 0
  IfBegin \"0\"
    Translate 2 0 0
  ElseIf \"$user:pass =~ 'sh*'\"
    Translate 3 0 0
  Else
    Translate 4 0 0
  IfEnd
ElseIf \"1\"
  Translate 5 0 0
  IfBegin \"1\"
    Translate 6 0 0
  Else
    Translate 6.5 0 0
  IfEnd
Else
  Translate 7 0 0
IfEnd
Attribute \"user\" \"uniform float n\" [3]
IfBegin \"defined(user:other)\"
  Sphere 1 2
Else
  Translate 8 0 0
IfEnd";
    let moves = |calls: &[Call]| -> Vec<f32> {
        let x = calls.iter().filter_map(|c| if let Call::Translate([x, ..]) = c { Some(*x) } else { None });
        x.collect()
    };
    assert_eq!(moves(&clean(text)), [1.0, 3.0, 8.0]);
    for (text, expected, wanted) in [
        ("IfEnd Translate 1 0 0", "IfEnd: without IfBegin", vec![1.0]),
        ("Else Translate 1 0 0", "Else: without IfBegin", vec![1.0]),
        ("IfBegin \"1 +\" Translate 2 0 0 IfEnd Translate 1 0 0", "the condition ends early", vec![1.0]),
        ("IfBegin \"0\" Else Translate 1 0 0 Else Translate 2 0 0 IfEnd", "behind Else", vec![1.0]),
    ] {
        let (calls, said) = world(text);
        assert!(said.len() == 1 && said[0].contains(expected), "{text}: {said:?}");
        assert_eq!(moves(&calls), wanted, "{text}");
    }
    let (_, said) = run(b"WorldBegin\nIfBegin \"1\"\nWorldEnd", &mut Recorder::default());
    assert_eq!(said, ["t.rib:2: error: IfBegin without IfEnd"]);
}

#[test]
fn the_finest_level_of_detail_is_shown() {
    let text = "\
AttributeBegin
Detail [-1 1 -1 1 -1 1]
DetailRange [0 0 100 200]
Sphere 1 -1 1 360
DetailRange [100 200 1e38 1e38]
Sphere 2 -2 2 360
AttributeEnd
Sphere 3 -3 3 360";
    let (calls, said) = world(text);
    let radii = calls.iter().filter_map(|c| match c {
        Call::Shape { shape, .. } => match **shape {
            ShapeDesc::Sphere { radius, .. } => Some(radius),
            _ => None,
        },
        _ => None,
    });
    assert_eq!(radii.collect::<Vec<_>>(), [2.0, 3.0]);
    assert_eq!(said.len(), 1);
}

#[test]
fn creases_corners_and_holes_become_mesh_parameters() {
    let points = "\"P\" [0 0 0 1 0 0 1 1 0 0 1 0]";
    let text = format!(
        "SubdivisionMesh \"catmull-clark\" [4] [0 1 2 3] [\"crease\" \"corner\" \"crease\" \"hole\"] \
         [3 1 2 1 2 2 1 0] [0 1 2 3 0 2 3 0] [2.5 3 10 20] {points}"
    );
    let said = world(&text).1;
    assert!(said.iter().any(|s| s.contains("a crease of 1 edges with 2 numbers")), "{said:?}");
    let text = format!(
        "SubdivisionMesh \"catmull-clark\" [4] [0 1 2 3] [\"crease\" \"corner\" \"crease\"] [3 1 2 2 3 2] \
         [0 1 2 3 0 1 2 3] [2.5 3 10 1 20] {points}"
    );
    let calls = clean(&text);
    let (_, params) = only(&calls);
    let ints = |name: &str| params.get(name).unwrap().data.to_ints().unwrap().to_vec();
    assert_eq!(ints("creaselengths"), [2, 2, 2, 2]);
    assert_eq!(ints("creaseindices"), [0, 1, 1, 2, 1, 2, 2, 3]);
    assert_eq!(floats(params.get("creasesharpnesses")), [2.5, 2.5, 1.0, 20.0]);
    assert_eq!(ints("cornerindices"), [3, 0]);
    assert_eq!(floats(params.get("cornersharpnesses")), [3.0, 10.0]);
}

#[test]
fn each_light_source_adds_a_light() {
    let text = "LightSource \"ambientlight\" 1 \"intensity\" 1\nLightSource \"distantlight\" 1\nIlluminate 1 0\n\
        AttributeBegin LightSource \"pointlight\" \"key\" LightSource \"spotlight\" \"key\" AttributeEnd";
    let ids = |calls: &[Call]| -> Vec<String> {
        let id = |call: &Call| match call {
            Call::Light { id, .. } => Some(id.to_string()),
            Call::LightSwitch { id, on } => Some(format!("{id} {on}")),
            _ => None,
        };
        calls.iter().filter_map(id).collect()
    };
    assert_eq!(ids(&clean(text)), ["1", "1 (2)", "1 (2) false", "key", "key (2)"]);
    // A frame begins with the lights before it, so that it does not depend on earlier frames.
    let text = "LightSource \"ambientlight\" 1 FrameBegin 1 LightSource \"a\" 1 WorldBegin LightSource \"b\" 2 WorldEnd FrameEnd\n\
        FrameBegin 2 WorldBegin LightSource \"b\" 1 LightSource \"b\" 2 WorldEnd FrameEnd";
    let mut sink = Recorder { several: true, ..Recorder::default() };
    let (_, said) = run(text.as_bytes(), &mut sink);
    assert!(said.is_empty(), "{said:?}");
    assert_eq!(ids(&sink.calls), ["1", "1 (2)", "2", "1", "1 (2)", "2"]);
}

#[test]
fn parameters_of_other_renderers_give_warnings() {
    let text = "Attribute \"render\" \"casts_shadows\" [\"opaque\"] \"jitter\" 1\n\
        Attribute \"identifier\" \"shadinggroup\" [\"a\"] \"name\" [\"ball\"] Attribute \"visibility\" \"camera\" [0]\n\
        Attribute \"light\" \"nsamples\" 4";
    let (calls, said) = world(text);
    assert!(said.iter().all(|s| s.contains("warning")), "{said:?}");
    assert_eq!(said.len(), 3, "{said:?}");
    assert!(
        said[0].contains("Attribute: parameter \"casts_shadows\" is not declared: it is left out"),
        "{said:?}"
    );
    assert_eq!(attribute(&calls, "name").unwrap().data, ParamData::from("ball"));
    assert_eq!(attribute(&calls, "geometryset").unwrap().data, ParamData::from("-camera"));
    assert_eq!(attribute(&calls, "light:nsamples").unwrap().data, ParamData::from(4));
    let mut sink = Recorder::default();
    let text = b"Hider \"hidden\" \"jitter\" 1 \"depthfilter\" \"max\" \"uniform float extra\" 1\n\
        Option \"radiosity\" \"steps\" 8 Option \"limits\" \"bucketsize\" [8 4]\n\
        Display \"a.tif\" \"file\" \"rgba\" \"merge\" 0 Display \"+a.z\" \"zfile\" \"z\" WorldBegin WorldEnd";
    let (result, said) = run(text, &mut sink);
    assert!(result.is_ok() && said.iter().all(|s| s.contains("warning")), "{said:?}");
    assert_eq!(said.len(), 4, "{said:?}");
    assert_eq!(floats(attribute(&sink.calls, "limits:bucketsize").as_ref()), [8.0, 4.0]);
    let filter = sink.calls.iter().rev().find_map(|c| match c {
        Call::Output { params, .. } => params.string("filter").map(ToString::to_string),
        _ => None,
    });
    assert_eq!(filter.as_deref(), Some("max"));
    // Values that do not fit, and parameters of shaders, are still errors.
    let (_, said) = world("Attribute \"visibility\" \"int camera\" [\"no\"]\nSurface \"a\" \"b\" 1");
    assert!(said.len() == 2 && said.iter().all(|s| s.contains("error")), "{said:?}");
}

#[test]
fn displays_of_variables_become_outputs_with_their_type() {
    let mut sink = Recorder::default();
    let text = b"Display \"a\" \"tiff\" \"N\" Display \"+b\" \"tiff\" \"Cs\" Display \"+c\" \"tiff\" \"s\" Display \"+d\" \"tiff\" \"Ci\"\n\
        Display \"+e\" \"tiff\" \"varying normal N\" Display \"+f\" \"tiff\" \"varying float depth\" WorldBegin WorldEnd";
    let (_, said) = run(text, &mut sink);
    assert!(said.is_empty(), "{said:?}");
    let data: Vec<&str> = sink
        .calls
        .iter()
        .filter_map(|c| match c {
            Call::Output { data, .. } => Some(&**data),
            _ => None,
        })
        .collect();
    let expected =
        ["normal N", "color primitive:C", "float primitive:s", "color C", "normal N", "float depth"];
    assert_eq!(data, expected);
}

#[test]
fn archives_defined_in_the_file_are_read() {
    let text = "ArchiveBegin \"ball\"\nSphere 1 -1 1 360\nColor 1 2\nArchiveBegin \"cone\" Cone 1 1 360 ArchiveEnd\nArchiveEnd\n\
        Translate 1 0 0\nReadArchive \"ball\"\nReadArchive \"cone\" ReadArchive \"cone\"\n\
        Procedural \"DelayedReadArchive\" [\"cone\"] [-1 1 -1 1 -1 1]";
    let (calls, said) = world(text);
    assert_eq!(names(&calls), "Translate Sphere Patch Patch Patch");
    assert_eq!(said.len(), 1, "{said:?}");
    assert!(said[0].starts_with("t.rib:4: error: Color: needs 3 numbers"), "{said:?}");
    for (text, expected) in [
        ("ArchiveEnd", "ArchiveEnd: without ArchiveBegin"),
        ("ArchiveBegin \"a\" ReadArchive \"a\" ArchiveEnd ReadArchive \"a\"", "\"a\" would read itself"),
    ] {
        let (_, said) = world(text);
        assert!(said.len() == 1 && said[0].contains(expected), "{said:?}");
    }
    let (_, said) =
        run(b"WorldBegin WorldEnd\nArchiveBegin \"a\"\nSphere 1 -1 1 360", &mut Recorder::default());
    assert_eq!(said, ["t.rib:2: error: ArchiveBegin without ArchiveEnd"]);
    // Each archive doubles the one before. The number of requests has a limit.
    let mut text = "ArchiveBegin \"a0\" Translate 1 0 0 ArchiveEnd\n".to_owned();
    for k in 1..60 {
        text += &format!("ArchiveBegin \"a{k}\" {0} {0} ArchiveEnd\n", format!("ReadArchive \"a{}\"", k - 1));
    }
    let (calls, said) = world(&format!("{text}ReadArchive \"a12\""));
    assert_eq!((calls.len(), said.len()), (4096, 0));
}

#[test]
fn heights_become_points_over_the_unit_square() {
    // The heights form a plane over the unit square, for any basis.
    let z = |n: usize| (0..n).map(|i| i.to_string()).collect::<Vec<_>>().join(" ");
    let calls =
        clean(&format!("PatchMesh \"bilinear\" 3 \"nonperiodic\" 2 \"nonperiodic\" \"Pz\" [{}]", z(6)));
    let p = floats(only(&calls).1.get("P"));
    assert_eq!(p, [0.0, 0.0, 0.0, 0.5, 0.0, 1.0, 1.0, 0.0, 2.0, 0.0, 1.0, 3.0, 0.5, 1.0, 4.0, 1.0, 1.0, 5.0]);
    let calls = clean(&format!("Patch \"bicubic\" \"Pz\" [{}]", z(16)));
    let p = floats(only(&calls).1.get("P"));
    assert!((p[3] - 1.0 / 3.0).abs() < 1e-6 && (p[13] - 1.0 / 3.0).abs() < 1e-6, "{p:?}");
    let mesh =
        "Basis \"b-spline\" 1 \"b-spline\" 1 PatchMesh \"bicubic\" 5 \"nonperiodic\" 4 \"nonperiodic\"";
    let calls = clean(&format!("{mesh} \"Pz\" [{}]", z(20)));
    let p = floats(only(&calls).1.get("P"));
    let x: Vec<f32> = p.chunks(3).take(5).map(|p| p[0]).collect();
    assert!(x.iter().zip([-0.5, 0.0, 0.5, 1.0, 1.5]).all(|(a, b)| (a - b).abs() < 1e-6), "{x:?}");
    let (_, said) = world(&format!("{mesh} \"Pz\" [1 2 3]"));
    assert!(said[0].contains("3 heights where 5 x 4 are needed"), "{said:?}");
}

#[test]
fn moving_quadrics_have_the_same_vertex_count_at_all_times() {
    for (a, b) in [
        ("Cylinder 1 -1 1 90", "Cylinder 1 -1 1 360"),
        ("Torus 2 1 0 90 30", "Torus 2 1 0 360 360"),
        ("Sphere 1 -1 1 360", "Sphere 1 -.5 0 90"),
        ("Sphere 0 0 0 360", "Sphere 2 -2 2 360"),
        ("Disk 0 1 0", "Disk 0 1 360"),
    ] {
        let calls = clean(&format!("MotionBegin [0 1] {a} {b} MotionEnd"));
        assert_eq!(names(&calls), "Motion Patch Patch", "{a}");
        let [Call::Shape { shape: s, params: p }, Call::Shape { shape: t, params: q }] = &calls[1..] else {
            panic!()
        };
        assert_eq!(s, t, "{a}: the same knots");
        assert_eq!(floats(p.get("Pw")).len(), floats(q.get("Pw")).len());
    }
}

/// Requests and parts of requests.
const PIECES: [&str; 37] = [
    "ArchiveBegin \"a\"",
    "ArchiveEnd",
    "ReadArchive \"a\"",
    "WorldBegin",
    "WorldEnd",
    "FrameBegin 1",
    "FrameEnd",
    "AttributeBegin",
    "AttributeEnd",
    "TransformBegin",
    "TransformEnd",
    "MotionBegin [0 1]",
    "MotionEnd",
    "ObjectBegin 1",
    "ObjectEnd",
    "ObjectInstance 1",
    "Sphere 1 -1 1 360",
    "Cone 1 1 360",
    "PatchMesh \"bicubic\" 4 \"periodic\" 4 \"nonperiodic\"",
    "\"P\"",
    "[0 1 2]",
    "Curves \"cubic\" [4] \"periodic\"",
    "Points",
    "PointsGeneralPolygons [1 2] [3 3 3] [0 1 2]",
    "3",
    "-1",
    "[",
    "]",
    "\"s\"",
    "TrimCurve",
    "NuPatch 2 2 [0 0 1 1] 0 1",
    "SubdivisionMesh \"catmull-clark\" [3] [0 1 2] [\"hole\"] [9 0] [0] []",
    "Translate 1 0 0",
    "Basis [1 2 3] 1 \"hermite\" 2",
    "LightSource \"a\" 1",
    "Illuminate 1 1",
    "Projection \"perspective\"",
];

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn random_requests_do_not_panic(words in proptest::collection::vec(proptest::sample::select(&PIECES[..]), 0..60)) {
        let mut sink = Recorder { several: true, ..Recorder::default() };
        let _ = run(words.join(" ").as_bytes(), &mut sink);
    }
}
