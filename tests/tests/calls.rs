//! Tests that every call of the scene interface, in every form of the reference (3.3), is read from Pyg and written to
//! it.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_base::{Location, Params, Reporter};
use granita_needs::has;
use granita_pyg::{PygOptions, PygSource, Writer, WriterOptions, read};
use granita_scene::attribute::{Scope, TABLE};
use granita_scene::{Call, FoundInput, FrameRenderer, InputPaths, Scene, SceneSink, State, Stop};
use std::fmt::Write as _;
use std::sync::Arc;

/// The statements, one line for each call. Statements with the same meaning stand in one line, separated by `|`.
const CALLS: &str = r#"
Parameter ("float Kd", 0.5) | Parameter ("float Kd", (0.5,)) | Parameter ("float Kd", [0.5])
Parameter ("vertex point P", (0, 0, 0, 1, 0, 0)) | Parameter ("vertex point P", [(0, 0, 0), (1, 0, 0)])
Parameter ("string texturename", "grid.tx")
Attribute ("float fov", 45) | Attribute ("float fov", 45.0)
Attribute ("color C", (1, 0.5, 0.5)) | Attribute ("color C", [1, .5, .5]) | Attribute ("color C", 1, 0.5, 0.5)
Attribute ("string name", "ball")
Attribute ("string[2] user:words", ("a", "b"))
PushAttributes ()
PopAttributes ()
SaveAttributes ("leftarm")
SaveAttributes ("creature_shaders", "shaders,C,opacity")
RestoreAttributes ("creature_shaders")
RestoreAttributes ("leftarm", "C")
Modify ("obj.*") | Modify ('obj.*')
Modify ("") | Modify ()
PushTransform ()
PopTransform ()
SetTransform ((1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1)) | SetTransform (1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1) | SetTransform (((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (3, 0, 0, 1)))
SetTransform ("world")
AppendTransform ([2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1]) | AppendTransform (2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1)
Translate (1, 2, 3) | Translate ((1, 2, 3)) | Translate ([1, 2, 3])
Rotate (30, 0, 0, 1) | Rotate (30, (0, 0, 1))
Scale (1, 2, 3) | Scale ((1, 2, 3))
Motion (0, 0.5, 1) | Motion ((0, 0.5, 1)) | Motion ([0.0, 0.5, 1.0])
Camera ("main")
Camera ("main", "float fov", 30, "int[2] resolution", (64, 48))
Output ("a.tif", "tiff", "rgba", "main")
Output ("a.tif", "tiff", "color Cspec", "main", "int[4] quantize", (0, 65535, 0, 65535), "string note", "x")
Output ("a.tif", "null", "rgba", "main") | Output ("a.tif", None, "rgba", "main")
World ()
Render () | Render (None)
Render ("main")
Command ("return")
Command ("system maketx foo.tif foo.tx")
Command ("system", "string[2] command", ("maketx", "foo.tif"), "int wait", 1, "int echo", 0)
Command ("system", "string[2] argv", ("maketx", "foo.tif"))
Command ("wait", "float time", 2.5)
Command ("mkdir", "string name", "folder")
Command ("bucketpriority", "int[4] rectangle", (0, 0, 63, 63))
Shader ("surface", "plastic")
Shader ("surface", "plastic", "float Ks", 0.5, "float Kd", 0.75)
Shader ("surface", "plastic", "layer2", "float Ks", 0.5)
Shader ("surface", "plastic", "layer2")
Shader ("surface")
ShaderGroupBegin ()
ShaderGroupEnd ()
ConnectShaders ("layer1", "colorvar[1]", "layer2", "floatvar")
Light ("key", "pointlight", "float intensity", 3)
Light ("key", "pointlight", "one", "float intensity", 3)
Light ("key", "null") | Light ("key", None)
LightSwitch ("key", 1) | LightSwitch ("key", True)
LightSwitch ("key", 0) | LightSwitch ("key", False)
Patch ("linear", 2, 2, "vertex point P", (0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0))
Patch ("bspline,linear", 4, 2, "P", (0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0, 0, 1, 0, 1, 1, 0, 2, 1, 0, 3, 1, 0))
Patch (2, 2, (0, 0, 1, 1), 0, 1, 2, 2, (0, 0, 1, 1), 0, 1, "vertex hpoint Pw", (0, 0, 0, 1, 1, 0, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1))
TrimCurve ((1,), (4,), (2,), (0, 0, 1, 2, 3, 3), (0,), (3,), (0, 0, 1, 1, 0, 1, 1, 1, 1, 0, 0, 1))
TrimCurve () | TrimCurve (0, 0, 0, 0, 0, 0, 0) | TrimCurve ((), (), (), (), (), (), ())
Mesh ("linear", (3,), (0, 1, 2), "P", (0, 0, 0, 1, 0, 0, 0, 1, 0))
Mesh ("catmull-clark", (4, 4), (0, 1, 3, 2, 2, 3, 5, 4), "int border", 1, "int[1] holes", (0,), "perpiece string __attributes", ("a", "b"))
Points (2, "P", (0, 0, 0, 1, 0, 0), "float rasterwidth", 3)
Curves ("bezier", 1, 4, "vertex point P", (0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0), "linear float width", (0.1, 0.05))
Curves (1, 4, 2, (0, 0, 1, 2, 3, 3), 0, 3, "perpiece float width", (0.1,))
Sphere (1, -1, 1, 360)
Sphere (1, -1, 1, 360, "color C", (1, 0, 0))
Input ("teapot.pyg")
Input ("pyg << Sphere (2, -2, 2, 360)", (-2, 2, -2, 2, -2, 2)) | Input ("pyg << Sphere (2, -2, 2, 360)", [-2, 2, -2, 2, -2, 2])
Comment ("this is a comment")
"#;

/// The calls of the reference, chapters 2 and 3.3. `GetAttribute` is tested by scripts.
const NAMES: [&str; 34] = [
    "AppendTransform",
    "Attribute",
    "Camera",
    "Command",
    "Comment",
    "ConnectShaders",
    "Curves",
    "Input",
    "Light",
    "LightSwitch",
    "Mesh",
    "Modify",
    "Motion",
    "Output",
    "Parameter",
    "Patch",
    "Points",
    "PopAttributes",
    "PopTransform",
    "PushAttributes",
    "PushTransform",
    "Render",
    "RestoreAttributes",
    "Rotate",
    "SaveAttributes",
    "Scale",
    "SetTransform",
    "Shader",
    "ShaderGroupBegin",
    "ShaderGroupEnd",
    "Sphere",
    "Translate",
    "TrimCurve",
    "World",
];

/// A sink that stores all calls.
#[derive(Default)]
struct Recorder(Vec<Call>);

impl SceneSink for Recorder {
    fn call(&mut self, call: Call, _: &Location) -> Result<(), Stop> {
        self.0.push(call);
        Ok(())
    }
}

fn calls_of(text: &[u8], options: &PygOptions) -> Vec<Call> {
    let (reporter, said) = Reporter::collecting();
    let mut recorder = Recorder::default();
    let source = PygSource::Bytes { name: "<test>".into(), bytes: text.to_vec() };
    read(source, &mut recorder, options, &reporter).unwrap();
    let said: Vec<String> = said.lock().iter().map(ToString::to_string).collect();
    assert!(said.is_empty(), "{}: {said:?}", String::from_utf8_lossy(text));
    recorder.0
}

/// Returns the statements of each line with the call that they all make.
fn table() -> Vec<(Vec<&'static str>, Call)> {
    let flat = PygOptions { always_pyglet: true, ..PygOptions::default() };
    CALLS
        .lines()
        .filter(|l| !l.is_empty())
        .map(|line| {
            let forms: Vec<&'static str> = line.split(" | ").collect();
            let mut calls = calls_of(forms[0].as_bytes(), &flat);
            assert_eq!(calls.len(), 1, "{}", forms[0]);
            (forms, calls.remove(0))
        })
        .collect()
}

#[test]
fn every_spelling_of_every_call_is_read() {
    let flat = PygOptions { always_pyglet: true, ..PygOptions::default() };
    let mut names: Vec<&str> = Vec::new();
    for (forms, call) in table() {
        assert!(forms[0].starts_with(call.name()));
        names.push(call.name());
        for form in forms {
            assert_eq!(calls_of(form.as_bytes(), &flat), std::slice::from_ref(&call), "{form}");
            let by_object = format!("GelatoRenderer.{form}");
            assert_eq!(calls_of(by_object.as_bytes(), &flat), std::slice::from_ref(&call), "{by_object}");
        }
    }
    names.sort_unstable();
    names.dedup();
    assert_eq!(names, NAMES);
}

#[test]
fn python_scripts_make_the_same_calls() {
    if !has("python3") {
        return;
    }
    let python = PygOptions { never_pyglet: true, ..PygOptions::default() };
    let (mut text, mut expected) = (String::new(), Vec::new());
    for (forms, call) in table() {
        for form in forms {
            let _ = writeln!(text, "{form}\nGelatoRenderer.{form}");
            expected.extend([call.clone(), call.clone()]);
        }
    }
    let calls = calls_of(text.as_bytes(), &python);
    for (got, want) in calls.iter().zip(&expected) {
        assert_eq!(got, want);
    }
    assert_eq!(calls.len(), expected.len());
}

#[test]
fn every_call_survives_write_and_read() {
    let flat = PygOptions { always_pyglet: true, ..PygOptions::default() };
    let all: Vec<Call> =
        table().into_iter().map(|(_, call)| call).filter(|c| c.name() != "Comment").collect();
    for binary in [false, true] {
        let options = WriterOptions { binary, separate_params: false, indent: 3 };
        let mut writer = Writer::with_options(Vec::new(), options);
        all.iter().for_each(|c| writer.call(c.clone(), &Location::default()).unwrap());
        assert_eq!(calls_of(&writer.into_inner().unwrap(), &flat), with_parameters_inside(&all));
    }
    // With separate parameters, each call, together with the parameters before it, equals the call that was written.
    for call in all {
        let options = WriterOptions { separate_params: true, ..WriterOptions::default() };
        let mut writer = Writer::with_options(Vec::new(), options);
        writer.call(call.clone(), &Location::default()).unwrap();
        let mut back = calls_of(&writer.into_inner().unwrap(), &flat);
        let mut last = back.pop().unwrap();
        let inline = params(&mut last).map(std::mem::take);
        assert!(inline.is_none_or(|p| p.is_empty()));
        if let Some(place) = params(&mut last) {
            let pending = back.into_iter().map(|c| match c {
                Call::Parameter(p) => p,
                other => panic!("{other:?}"),
            });
            *place = pending.collect();
        }
        assert_eq!(last, call);
    }
}

/// Returns the calls, with the parameters of `Parameter` moved into the next call that takes parameters.
fn with_parameters_inside(calls: &[Call]) -> Vec<Call> {
    let (mut pending, mut out) = (Params::new(), Vec::new());
    for call in calls {
        let mut call = call.clone();
        if let Call::Parameter(param) = call {
            pending.set(param);
            continue;
        }
        if let Some(place) = params(&mut call) {
            let own = std::mem::replace(place, std::mem::take(&mut pending));
            own.0.into_iter().for_each(|param| place.set(param));
        }
        out.push(call);
    }
    assert!(pending.is_empty());
    out
}

/// Returns the parameters of a call, if it takes any.
fn params(call: &mut Call) -> Option<&mut Params> {
    match call {
        Call::Camera { params, .. }
        | Call::Output { params, .. }
        | Call::Command { params, .. }
        | Call::Shader { params, .. }
        | Call::Light { params, .. }
        | Call::Shape { params, .. } => Some(params),
        _ => None,
    }
}

/// A renderer that renders nothing.
struct Nothing;

impl FrameRenderer for Nothing {
    fn render(&mut self, _: Arc<Scene>, _: Option<&str>) -> Result<(), Stop> {
        Ok(())
    }
    fn command(&mut self, _: &str, _: &Params, _: &Location) -> Result<bool, Stop> {
        Ok(true)
    }
    fn input(&mut self, _: &str, _: InputPaths<'_>, _: &Location) -> Result<Option<FoundInput>, Stop> {
        Ok(None)
    }
}

/// Runs a script with the state machine. Returns its output, and the warnings and errors.
fn script(text: &str) -> (String, Vec<String>) {
    let (reporter, said) = Reporter::collecting();
    let mut state = State::new(Box::new(Nothing), reporter.clone());
    let source = PygSource::Bytes { name: "<test>".into(), bytes: text.as_bytes().to_vec() };
    read(source, &mut state, &PygOptions::default(), &reporter).unwrap();
    let said = said.lock();
    let is_print = |m: &&granita_base::report::Message| m.severity == granita_base::Severity::Message;
    let printed = said.iter().filter(is_print).map(ToString::to_string).collect();
    (printed, said.iter().filter(|m| !is_print(m)).map(ToString::to_string).collect())
}

#[test]
fn scripts_read_every_attribute() {
    if !has("python3") {
        return;
    }
    let mut text = String::from(
        "def same (a, b):\n    flat = lambda v: tuple (v) if isinstance (v, (tuple, list)) else (v,)\n    return a is not \
         None and flat (a) == flat (b)\n",
    );
    for row in TABLE.iter().filter(|row| row.scope != Scope::Output) {
        let declaration = row.declaration();
        let name = row.name;
        // Every attribute has a value, also the ones that are read only. Unset ones return None.
        let unset = row.default_param().is_none() && row.scope != Scope::ReadOnly && name != "screen";
        let _ = writeln!(
            text,
            "if (GetAttribute (\"{declaration}\") is None) != {}: print (\"first {name}\")",
            py(unset)
        );
        if row.scope == Scope::ReadOnly {
            continue;
        }
        let n = row.ty.width();
        let value = match row.ty.base {
            granita_base::BaseType::String => {
                format!(
                    "\"{}\"",
                    row.words().get(1).copied().unwrap_or(if name == "hider" {
                        "default"
                    } else if name == "geometryset" {
                        "a,b"
                    } else {
                        "word"
                    })
                )
            }
            granita_base::BaseType::Int => format!("({})", "2, ".repeat(n)),
            _ => format!("({})", "0.25, ".repeat(n)),
        };
        let _ = writeln!(text, "Attribute (\"{declaration}\", {value})");
        for question in [declaration.as_str(), name] {
            let _ = writeln!(
                text,
                "if not same (GetAttribute (\"{question}\"), {value}): print (\"{question} is\", GetAttribute (\"{question}\"))"
            );
        }
    }
    text += "if GetAttribute (\"int fov\") is not None or GetAttribute (\"nothing\") is not None: print (\"wrong\")\n";
    text += "if GetAttribute (\"renderer:name\") != \"Granita\": print (\"name\")\n";
    text +=
        "Translate (1, 2, 3)\nif GetAttribute (\"transform\")[12:] != (1, 2, 3, 1): print (\"transform\")\n";
    text += "World ()\nif GetAttribute (\"fov\") != 0.25: print (\"fov of the camera\")\n";
    let (printed, said) = script(&text);
    assert_eq!(printed, "");
    let other: Vec<_> = said.iter().filter(|s| !s.ends_with("is not supported yet")).collect();
    assert!(other.is_empty(), "{other:?}");
}

fn py(value: bool) -> &'static str {
    if value { "True" } else { "False" }
}
