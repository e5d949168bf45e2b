//! Tests that calls written as text read back to the same calls. Further tests give the reader text that is not a
//! scene.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use granita_base::shape::KnotSpan;
use granita_base::{
    BaseType, CurveBasis, Interp, Location, Param, ParamData, ParamType, Params, Reporter, ShapeDesc,
    TrimDesc,
};
use granita_pyg::{PygOptions, PygSource, Writer, WriterOptions, read};
use granita_scene::{
    Call, FoundInput, FrameRenderer, InputPaths, Scene, SceneSink, State, Stop, TransformTarget,
};
use proptest::prelude::*;
use std::sync::Arc;

/// Records all calls.
#[derive(Default)]
struct Recorder(Vec<Call>);

impl SceneSink for Recorder {
    fn call(&mut self, call: Call, _: &Location) -> Result<(), Stop> {
        self.0.push(call);
        Ok(())
    }
}

fn read_back(text: Vec<u8>) -> (Vec<Call>, Vec<String>) {
    let (reporter, messages) = Reporter::collecting();
    let mut recorder = Recorder::default();
    let options = PygOptions { always_pyglet: true, ..PygOptions::default() };
    let source = PygSource::Bytes { name: "<test>".into(), bytes: text };
    let result = read(source, &mut recorder, &options, &reporter);
    let mut told: Vec<String> = messages.lock().iter().map(ToString::to_string).collect();
    told.extend(result.err().map(|e| e.to_string()));
    (recorder.0, told)
}

fn written(calls: &[Call], options: WriterOptions) -> Vec<u8> {
    let mut writer = Writer::with_options(Vec::new(), options);
    calls.iter().for_each(|c| writer.call(c.clone(), &Location::default()).unwrap());
    writer.into_inner().unwrap()
}

/// Generates any float except NaN, including infinite and denormal ones.
fn float() -> impl Strategy<Value = f32> {
    prop_oneof![
        any::<u32>().prop_map(f32::from_bits).prop_filter("NaN is not equal to itself", |f| !f.is_nan()),
        (-1000i32..1000).prop_map(|i| i as f32),
        (-1000i32..1000).prop_map(|i| i as f32 / 64.0),
    ]
}

fn text() -> impl Strategy<Value = Arc<str>> {
    prop_oneof![
        "[a-zA-Z0-9_:./]{0,12}".prop_map(Arc::from),
        // "null" is not expected here, because it is another way to write that there is none.
        any::<String>().prop_map(Arc::from),
    ]
}

fn floats(len: impl Into<prop::collection::SizeRange>) -> impl Strategy<Value = Arc<[f32]>> {
    prop::collection::vec(float(), len).prop_map(Arc::from)
}

fn ints(len: impl Into<prop::collection::SizeRange>) -> impl Strategy<Value = Arc<[i32]>> {
    prop::collection::vec(any::<i32>(), len).prop_map(Arc::from)
}

fn param() -> impl Strategy<Value = Param> {
    let name = "[a-zA-Z_][a-zA-Z0-9_:]{0,10}".prop_filter("no declaration", |n| {
        BaseType::from_word(n).is_none()
            && !["vertex", "linear", "perpiece", "constant"].contains(&n.as_str())
    });
    let base = prop_oneof![
        Just(BaseType::Unknown),
        Just(BaseType::Float),
        Just(BaseType::Int),
        Just(BaseType::String),
        Just(BaseType::Color),
        Just(BaseType::HPoint),
        Just(BaseType::Matrix),
    ];
    let interp = prop_oneof![
        Just(Interp::Constant),
        Just(Interp::PerPiece),
        Just(Interp::Linear),
        Just(Interp::Vertex)
    ];
    (name, base, interp, prop::option::of(1u32..9), 1usize..40, any::<u64>()).prop_flat_map(
        |(name, base, interp, array, n, kind)| {
            let array = array.filter(|_| base != BaseType::Unknown);
            let ty = ParamType { base, array, interp };
            let data = match (base, kind % 3) {
                (BaseType::Int, _) | (BaseType::Unknown, 0) => ints(n).prop_map(ParamData::Int).boxed(),
                (BaseType::String, _) | (BaseType::Unknown, 1) => {
                    prop::collection::vec(text(), n).prop_map(|v| ParamData::String(v.into())).boxed()
                }
                _ => floats(n).prop_map(ParamData::Float).boxed(),
            };
            data.prop_map(move |data| Param { name: name.as_str().into(), ty, data })
        },
    )
}

fn params() -> impl Strategy<Value = Params> {
    prop::collection::vec(param(), 0..4).prop_map(|list| {
        let mut params = Params::new();
        list.into_iter().for_each(|p| params.set(p));
        params
    })
}

fn basis() -> impl Strategy<Value = CurveBasis> {
    prop_oneof![
        Just(CurveBasis::Linear),
        Just(CurveBasis::Bezier),
        Just(CurveBasis::BSpline),
        Just(CurveBasis::CatmullRom)
    ]
}

fn span() -> impl Strategy<Value = KnotSpan> {
    (1usize..30, 1usize..6)
        .prop_flat_map(|(n, order)| (Just(n), Just(order), floats(n + order), float(), float()))
        .prop_map(|(n, order, knots, min, max)| KnotSpan { n, order, knots, min, max })
}

fn shape() -> impl Strategy<Value = ShapeDesc> {
    let mesh = (any::<bool>(), prop::collection::vec(0i32..7, 0..12)).prop_flat_map(|(subdivide, nverts)| {
        let n: i32 = nverts.iter().sum();
        ints(n as usize).prop_map(move |verts| ShapeDesc::Mesh {
            subdivide,
            nverts: nverts.clone().into(),
            verts,
        })
    });
    prop_oneof![
        (basis(), basis(), 0usize..90, 0usize..90).prop_map(|(u, v, nu, nv)| ShapeDesc::Patch {
            u,
            v,
            nu,
            nv
        }),
        (span(), span()).prop_map(|(u, v)| ShapeDesc::Nurbs { u, v }),
        mesh,
        (0usize..9999).prop_map(|n| ShapeDesc::Points { n }),
        (basis(), 0usize..90, 0usize..90).prop_map(|(basis, ncurves, nverts)| ShapeDesc::Curves {
            basis,
            ncurves,
            nverts
        }),
        (0usize..90, span()).prop_map(|(ncurves, span)| ShapeDesc::NurbsCurves { ncurves, span }),
        (float(), float(), float(), float()).prop_map(|(radius, zmin, zmax, thetamax_deg)| {
            ShapeDesc::Sphere { radius, zmin, zmax, thetamax_deg }
        }),
    ]
}

fn matrix() -> impl Strategy<Value = Box<[f32; 16]>> {
    prop::array::uniform16(float()).prop_map(Box::new)
}

fn trim() -> impl Strategy<Value = TrimDesc> {
    (ints(1..4), ints(0..20), ints(0..4), floats(0..40), floats(0..4), floats(0..4), floats(0..40)).prop_map(
        |(ncurves, n, order, knots, min, max, uvw)| TrimDesc { ncurves, n, order, knots, min, max, uvw },
    )
}

fn call() -> impl Strategy<Value = Call> {
    let none_is_null = |name: &Option<Arc<str>>| name.as_deref() != Some("null");
    let simple = prop_oneof![
        Just(Call::PushAttributes),
        Just(Call::PopAttributes),
        Just(Call::PushTransform),
        Just(Call::PopTransform),
        Just(Call::World),
        Just(Call::ShaderGroupBegin),
        Just(Call::ShaderGroupEnd),
        Just(Call::TrimCurve(None)),
    ];
    let optional = move || prop::option::of(text()).prop_filter("null is none", none_is_null);
    let named = prop_oneof![
        (text(), prop::option::of(text()))
            .prop_map(|(name, attributes)| Call::SaveAttributes { name, attributes }),
        (text(), prop::option::of(text()))
            .prop_map(|(name, attributes)| Call::RestoreAttributes { name, attributes }),
        text().prop_map(|pattern| Call::Modify { pattern }),
        text().prop_map(|s| Call::SetTransform(TransformTarget::Named(s))),
        prop::option::of(text()).prop_map(|camera| Call::Render { camera }),
        (text(), any::<bool>()).prop_map(|(id, on)| Call::LightSwitch { id, on }),
        (text(), prop::option::of(prop::array::uniform6(float())))
            .prop_map(|(command, bound)| Call::Input { command, bound }),
        (text(), text(), text(), text()).prop_map(|(source_layer, source, target_layer, target)| {
            Call::ConnectShaders { source_layer, source, target_layer, target }
        }),
    ];
    let transforms = prop_oneof![
        matrix().prop_map(|m| Call::SetTransform(TransformTarget::Matrix(m))),
        matrix().prop_map(Call::AppendTransform),
        prop::array::uniform3(float()).prop_map(Call::Translate),
        prop::array::uniform3(float()).prop_map(Call::Scale),
        (float(), prop::array::uniform3(float()))
            .prop_map(|(angle_deg, axis)| Call::Rotate { angle_deg, axis }),
        floats(0..6).prop_map(Call::Motion),
        trim().prop_map(|t| Call::TrimCurve(Some(Box::new(t)))),
    ];
    let with_params = prop_oneof![
        param().prop_map(Call::Parameter),
        param().prop_map(Call::Attribute),
        (text(), params()).prop_map(|(name, params)| Call::Camera { name, params }),
        (text(), params()).prop_map(|(name, params)| Call::Command { name, params }),
        (text(), text(), text(), text(), params()).prop_map(|(name, format, data, camera, params)| {
            Call::Output { name, format, data, camera, params }
        }),
        (text(), prop::option::of(text()), prop::option::of(text()), params())
            .prop_map(|(usage, name, layer, params)| Call::Shader { usage, name, layer, params }),
        (text(), optional(), prop::option::of(text()), params())
            .prop_map(|(id, shader, layer, params)| Call::Light { id, shader, layer, params }),
        (shape(), params()).prop_map(|(shape, params)| Call::Shape { shape: Box::new(shape), params }),
    ];
    prop_oneof![1 => simple, 2 => named, 2 => transforms, 4 => with_params]
}

/// Returns the calls with the parameters of `Parameter` moved into the calls that take them. Parameters that no call
/// takes come at the end.
fn embedded(calls: &[Call]) -> Vec<Call> {
    let (mut pending, mut out) = (Params::new(), Vec::new());
    for call in calls {
        let mut call = call.clone();
        match &mut call {
            Call::Parameter(param) => {
                pending.set(param.clone());
                continue;
            }
            Call::Camera { params, .. }
            | Call::Command { params, .. }
            | Call::Output { params, .. }
            | Call::Shader { params, .. }
            | Call::Light { params, .. }
            | Call::Shape { params, .. }
                if !pending.is_empty() =>
            {
                let own = std::mem::replace(params, std::mem::take(&mut pending));
                own.0.into_iter().for_each(|param| params.set(param));
            }
            _ => {}
        }
        out.push(call);
    }
    out.extend(pending.0.into_iter().map(Call::Parameter));
    out
}

/// A renderer that renders nothing. Its inputs contain a sphere.
struct Blank;

impl FrameRenderer for Blank {
    fn render(&mut self, scene: Arc<Scene>, camera: Option<&str>) -> Result<(), Stop> {
        assert!(!scene.cameras.is_empty() && !scene.outputs.is_empty());
        assert!(camera.is_none_or(|c| scene.cameras.iter().any(|known| &*known.name == c)));
        for primitive in &scene.primitives {
            assert!(primitive.attributes.lights.iter().all(|l| (l.0 as usize) < scene.lights.len()));
            assert!(primitive.keys.windows(2).all(|k| k[0].time < k[1].time) && !primitive.keys.is_empty());
        }
        Ok(())
    }
    fn command(&mut self, _: &str, _: &Params, _: &Location) -> Result<bool, Stop> {
        Ok(false)
    }
    fn input(&mut self, _: &str, _: InputPaths<'_>, _: &Location) -> Result<Option<FoundInput>, Stop> {
        let shape = ShapeDesc::Sphere { radius: 1.0, zmin: -1.0, zmax: 1.0, thetamax_deg: 360.0 };
        let call = Call::Shape { shape: Box::new(shape), params: Params::new() };
        let reader = Box::new(move |sink: &mut dyn SceneSink| sink.call(call, &Location::default()));
        Ok(Some(FoundInput { identity: "sphere".into(), bound: None, reader }))
    }
}

/// A layer may have a blank in its name. Only a type before a name makes it a parameter without a value.
#[test]
fn layer_names_may_contain_blanks() {
    let (back, told) = read_back(b"Shader (\"surface\", \"matte\", \"base \")\n".to_vec());
    assert!(told.is_empty(), "{told:?}");
    assert!(
        matches!(&back[..], [Call::Shader { layer: Some(layer), .. }] if **layer == *"base "),
        "{back:?}"
    );
    let (_, told) = read_back(b"Shader (\"surface\", \"matte\", \"float Kd\")\n".to_vec());
    assert!(told.iter().any(|t| t.contains("\"float Kd\" is given no value")), "{told:?}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn written_text_reads_back_as_the_same_calls(calls in prop::collection::vec(call(), 1..8), indent in 0usize..3) {
        let text = written(&calls, WriterOptions { indent, ..WriterOptions::default() });
        prop_assert!(text.is_ascii());
        let (back, told) = read_back(text.clone());
        prop_assert!(told.is_empty(), "{told:?} in\n{}", String::from_utf8_lossy(&text));
        prop_assert_eq!(&back, &embedded(&calls), "{}", String::from_utf8_lossy(&text));
    }

    #[test]
    fn written_binary_arrays_read_back_as_the_same_calls(calls in prop::collection::vec(call(), 1..8)) {
        let text = written(&calls, WriterOptions { binary: true, ..WriterOptions::default() });
        let (back, told) = read_back(text);
        prop_assert!(told.is_empty(), "{told:?}");
        prop_assert_eq!(&back, &embedded(&calls));
    }

    #[test]
    fn separate_parameters_read_back_as_the_same_calls(calls in prop::collection::vec(call(), 1..8)) {
        let text = written(&calls, WriterOptions { separate_params: true, ..WriterOptions::default() });
        let (back, told) = read_back(text);
        prop_assert!(told.is_empty(), "{told:?}");
        prop_assert_eq!(embedded(&back), embedded(&calls));
    }

    #[test]
    fn random_calls_never_fail_in_the_state(before in prop::collection::vec(call(), 0..12), after in prop::collection::vec(call(), 0..24), again: bool) {
        let mut state = State::new(Box::new(Blank), Reporter::silent());
        let rerender = Call::Attribute(Param::declared("int rerender", i32::from(again)).unwrap());
        let calls = std::iter::once(rerender).chain(before).chain([Call::World]).chain(after);
        for call in calls.chain([Call::Render { camera: None }, Call::World, Call::Render { camera: None }]) {
            // Only `Command ("exit")` stops, and no call here is one.
            state.call(call, &Location::default()).unwrap();
        }
        state.end();
        prop_assert!(state.has_rendered());
    }

    #[test]
    fn random_bytes_do_not_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        read_back(bytes);
    }

    #[test]
    fn random_scene_tokens_do_not_panic(pieces in prop::collection::vec(
        prop::sample::select(vec![
            "Sphere", "Attribute", "Patch", "Mesh", "Shader", "Parameter", "Motion", "TrimCurve", "Input", "Light",
            "(", ")", "[", "]", ",", "\"", "'", "\"\"\"", "\\", "\n", " ", "#", "-", "+", "*", "/", "1", "2.5", "1e9", "0x1f",
            "\"float a\"", "\"vertex point P\"", "\"linear\"", "\"int[3] b\"", "None", "True", "\u{80}", "\u{e9}", ".", "=", ";",
        ]), 0..60)) {
        read_back(pieces.concat().into_bytes());
    }

    #[test]
    fn damaged_scenes_do_not_panic(calls in prop::collection::vec(call(), 1..6), binary: bool,
                                 damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
                                 cut in any::<prop::sample::Index>()) {
        let mut text = written(&calls, WriterOptions { binary, ..WriterOptions::default() });
        for (at, byte) in damage {
            let at = at.index(text.len());
            text[at] = byte;
        }
        text.truncate(cut.index(text.len()) + 1);
        read_back(text);
    }
}

#[test]
fn floats_of_all_exponents_survive_write_and_read() {
    // The values cover all exponents with many mantissas, with both signs.
    let mut values = Vec::new();
    let mut bits = 1u32;
    while bits < 0x7f80_0000 {
        values.extend([f32::from_bits(bits), -f32::from_bits(bits)]);
        bits = bits.wrapping_add(104_729);
    }
    let param = Param::declared("float[40000] x", &values[..]).unwrap();
    let calls = [Call::Attribute(param)];
    let (back, told) = read_back(written(&calls, WriterOptions::default()));
    assert!(told.is_empty());
    assert!(back == calls, "a float changed on the way");
}

#[test]
fn separate_parameters_come_before_their_call() {
    let params: Params = [Param::declared("float Kd", 0.5).unwrap()].into_iter().collect();
    let call = Call::Shader { usage: "surface".into(), name: Some("matte".into()), layer: None, params };
    let text = written(&[call], WriterOptions { separate_params: true, ..WriterOptions::default() });
    assert_eq!(text, b"Parameter (\"float Kd\", 0.5)\nShader (\"surface\", \"matte\")\n");
}

#[test]
fn parameters_are_written_in_their_call_unless_separate_is_set() {
    let param = |name: &str, value: f32| Call::Parameter(Param::declared(name, value).unwrap());
    let set = |value: i32| Call::Attribute(Param::declared("int pyg:separateparams", value).unwrap());
    let own: Params = [Param::declared("float Ks", 2.0).unwrap()].into_iter().collect();
    let shader =
        |params| Call::Shader { usage: "surface".into(), name: Some("m".into()), layer: None, params };
    let calls = [
        param("float Kd", 0.5),
        param("float Ks", 0.25),
        Call::PushAttributes,
        shader(own),
        shader(Params::new()),
        param("float Ka", 1.0),
        set(1),
        shader(Params::new()),
        set(0),
        param("float late", 3.0),
    ];
    let text = String::from_utf8(written(&calls, WriterOptions::default())).unwrap();
    let wanted = "PushAttributes ()\nShader (\"surface\", \"m\", \"float Kd\", 0.5, \"float Ks\", 2)\n\
        Shader (\"surface\", \"m\")\nParameter (\"float Ka\", 1)\nShader (\"surface\", \"m\")\n\
        Parameter (\"float late\", 3)\n";
    assert_eq!(text, wanted);
}

#[test]
fn attributes_control_the_writer() {
    let set = |name: &str, value: i32| Call::Attribute(Param::declared(name, value).unwrap());
    let mut writer = Writer::new(Vec::new());
    let at = Location::default();
    for call in [
        Call::World,
        set("int pyg:indent", 4),
        Call::World,
        Call::Comment("two\nlines".into()),
        set("int pyg:indent", -2),
        set("int pyg:separateparams", 1),
        Call::World,
    ] {
        writer.call(call, &at).unwrap();
    }
    assert_eq!(writer.attribute("int pyg:indent").unwrap().data, ParamData::from(2));
    let text = String::from_utf8(writer.into_inner().unwrap()).unwrap();
    assert_eq!(text, "World ()\n    World ()\n    # two\n    # lines\n  World ()\n");
}

#[test]
fn written_text_equals_the_golden_text() {
    let calls = [
        Call::Comment("a scene".into()),
        Call::Attribute(Param::declared("int[2] resolution", &[640, 480][..]).unwrap()),
        Call::Attribute(Param::declared("string path:shader", "a \"b\"\\\u{e9}").unwrap()),
        Call::Motion([0.0, 1.0 / 48.0].into()),
        Call::Rotate { angle_deg: 50.0, axis: [1.0, 0.0, -0.0] },
        Call::Light {
            id: "key".into(),
            shader: Some("spotlight".into()),
            layer: None,
            params: [Param::declared("color lightcolor", &[1.0, 0.95, 0.9][..]).unwrap()]
                .into_iter()
                .collect(),
        },
        Call::Light { id: "key".into(), shader: None, layer: None, params: Params::new() },
        Call::Shape {
            shape: Box::new(ShapeDesc::Patch { u: CurveBasis::BSpline, v: CurveBasis::Linear, nu: 9, nv: 2 }),
            params: [Param::declared("vertex point P", &[0.25f32; 54][..]).unwrap()].into_iter().collect(),
        },
        Call::TrimCurve(None),
        Call::Render { camera: None },
    ];
    let text = String::from_utf8(written(&calls, WriterOptions::default())).unwrap();
    assert_eq!(text, include_str!("golden.pyg"));
}
