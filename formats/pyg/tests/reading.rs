// tidy: tests
//! Tests of the reader: spellings, positions of errors, and scripts.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use granita_base::{Location, Param, ParamData, Params, Reporter, ShapeDesc};
use granita_pyg::{Chunking, PygError, PygOptions, PygSource, read};
use granita_scene::{Call, SceneSink, Stop};
use std::path::PathBuf;

#[derive(Default)]
struct Recorder {
    calls: Vec<(u32, Call)>,
    stop_at: Option<usize>,
}

impl SceneSink for Recorder {
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
        self.calls.push((at.line, call));
        if self.stop_at == Some(self.calls.len()) { Err(Stop::Exit) } else { Ok(()) }
    }

    fn attribute(&self, declaration: &str) -> Option<Param> {
        match declaration {
            "int[2] resolution" => Some(Param::declared(declaration, &[640, 480][..]).unwrap()),
            "float fov" => Some(Param::declared(declaration, 45.5).unwrap()),
            "string name" => Some(Param::declared(declaration, "b\u{e9}ta").unwrap()),
            _ => None,
        }
    }
}

struct Outcome {
    calls: Vec<(u32, Call)>,
    told: Vec<String>,
    error: Option<PygError>,
}

impl Outcome {
    fn lines(&self) -> Vec<(u32, &'static str)> {
        self.calls.iter().map(|(line, call)| (*line, call.name())).collect()
    }

    fn error(&self) -> String {
        self.error.as_ref().unwrap().to_string()
    }
}

fn read_with(text: &[u8], options: &PygOptions) -> Outcome {
    let (reporter, messages) = Reporter::collecting();
    let mut recorder = Recorder::default();
    let source = PygSource::Bytes { name: "t.pyg".into(), bytes: text.to_vec() };
    let error = read(source, &mut recorder, options, &reporter).err();
    let told = messages.lock().iter().map(ToString::to_string).collect();
    Outcome { calls: recorder.calls, told, error }
}

/// Reads flat text that must not cause messages.
fn flat(text: &str) -> Vec<Call> {
    let got = read_with(text.as_bytes(), &PygOptions { always_pyglet: true, ..PygOptions::default() });
    assert!(got.error.is_none() && got.told.is_empty(), "{:?} {:?}", got.told, got.error);
    got.calls.into_iter().map(|(_, c)| c).collect()
}

/// True when scripts can be tested here.
fn has_python() -> bool {
    granita_needs::has("python3")
}

fn script(text: &str) -> Option<Outcome> {
    has_python().then(|| read_with(text.as_bytes(), &PygOptions::default()))
}

#[test]
fn all_spellings_of_a_call_are_read_alike() {
    let want = flat("Translate (1, 2, 3)");
    for text in [
        "Translate(1,2,3)",
        "Translate ((1, 2, 3))",
        "Translate ([1.0, 2.0, 3e0])",
        "Translate (1,\n  2, # two\n  3,\n)",
        "Translate \\\n  (1, 2, 3);",
        "GelatoRenderer.Translate (1, 2, 3)",
        "gelato . Translate (+1, 4/2, 1.5*2)",
        "  Translate ((0.5 + 0.5), 3 - 1, -(-3))",
        "\u{feff}Translate (1, 2, 3)",
        "from gelato import *\nimport gelato\nTranslate (1, 2, 3)\r\n",
        "\"\"\"A scene.\n\"\"\"\n\npass\nTranslate ([1], (2, [3]))",
        "\t# c\n\n;Translate (0x1, 2, 3)",
    ] {
        assert_eq!(flat(text), want, "{text:?}");
    }
    let want = flat("Attribute ('float[4] x', (0, 0, 1.5, 1.5))");
    assert_eq!(flat("Attribute ('float[4] x', [0]*2 + 2*[1.5])"), want);
    let want = flat("Attribute (\"string name\", 'it\\'s\\ta \\\\')");
    for text in [
        "Attribute ('string name', \"it's\ta \\\\\")",
        "Attribute (\"string name\", r\"it's\" '\\x09' \"a \\134\")",
        "Attribute ('''string \\\nname''', \"\"\"it's\ta \\u005c\"\"\")",
    ] {
        assert_eq!(flat(text), want, "{text:?}");
    }
}

#[test]
fn matrices_are_read_with_and_without_nested_brackets() {
    let numbers = "1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, -6, 4.6, 1.0";
    let want = flat(&format!("SetTransform (({numbers}))"));
    assert_eq!(flat(&format!("SetTransform ({numbers})")), want);
    assert_eq!(flat("SetTransform ([[1,0,0,0],[0,1,0,0],[0,0,1,0],[5,-6,4.6,1]])"), want);
}

#[test]
fn layer_names_and_parameters_are_told_apart() {
    let shader = |text: &str| match &flat(text)[0] {
        Call::Shader { name, layer, params, .. } | Call::Light { shader: name, layer, params, .. } => {
            (name.as_deref().map(str::to_owned), layer.as_deref().map(str::to_owned), params.0.len())
        }
        other => panic!("{other:?}"),
    };
    let some = |s: &str| Some(s.to_owned());
    assert_eq!(shader("Shader ('surface')"), (None, None, 0));
    assert_eq!(shader("Shader ('surface', 'plastic')"), (some("plastic"), None, 0));
    assert_eq!(shader("Shader ('surface', 'plastic', 'l1')"), (some("plastic"), some("l1"), 0));
    assert_eq!(shader("Shader ('surface', 'plastic', 'float Kd', 1)"), (some("plastic"), None, 1));
    assert_eq!(shader("Shader ('surface', 'p', 'l1', 'float Kd', 1, 'Ks', 2)"), (some("p"), some("l1"), 2));
    assert_eq!(shader("Light ('key', 'spot', 'l1', 'float i', 1)"), (some("spot"), some("l1"), 1));
    assert_eq!(shader("Light ('key', 'null')"), (None, None, 0));
    assert_eq!(shader("Light ('key', None)"), (None, None, 0));
}

#[test]
fn undeclared_values_take_their_type_from_the_literal() {
    let data = |text: &str| match &flat(text)[0] {
        Call::Attribute(p) => p.data.clone(),
        other => panic!("{other:?}"),
    };
    assert_eq!(data("Attribute ('float a', 1)"), ParamData::from(1.0));
    assert_eq!(data("Attribute ('a', 1)"), ParamData::from(1));
    assert_eq!(data("Attribute ('a', 1.0)"), ParamData::from(1.0));
    assert_eq!(data("Attribute ('a', (1, 2.5))"), ParamData::from(&[1.0, 2.5][..]));
    assert_eq!(data("Attribute ('a', True)"), ParamData::from(1));
    assert_eq!(data("Attribute ('a', 4294967296)"), ParamData::from(4_294_967_296.0_f32));
    assert_eq!(data("Attribute ('string[1] a', ('x',))"), ParamData::from("x"));
    // Large integers keep their values in a sequence of integers.
    assert_eq!(data("Attribute ('a', (16777217, 1))"), ParamData::from(&[16_777_217, 1][..]));
    assert_eq!(data("Attribute ('float a', 1e999)"), ParamData::from(f32::INFINITY));
}

#[test]
fn binary_arrays_are_read_in_both_byte_orders() {
    let mut text = b"Attribute (\"float[2] a\", ".to_vec();
    text.extend([0x82, 2, 0, 0, 0]);
    text.extend(1.5f32.to_le_bytes());
    // The data contains a line end and a bracket.
    text.extend([0x0a, 0x29, 0x0a, 0x41]);
    text.extend(b")\nAttribute ('int[1] b', [");
    text.extend([0x81, 0, 0, 0, 1, 0xff, 0xff, 0xff, 0xfe]);
    text.extend(b"])\nWrold ()");
    let got = read_with(&text, &PygOptions { always_pyglet: true, ..PygOptions::default() });
    let data: Vec<_> = got.calls.iter().map(|(_, c)| c.clone()).collect();
    let second = f32::from_le_bytes([0x0a, 0x29, 0x0a, 0x41]);
    assert_eq!(data[0], Call::Attribute(Param::declared("float[2] a", &[1.5, second][..]).unwrap()));
    assert_eq!(data[1], Call::Attribute(Param::declared("int[1] b", -2).unwrap()));
    assert_eq!(got.told, ["t.pyg:3: error: unknown call \"Wrold\"; did you mean \"World\"?"]);
    for cut in [5, 27, 30, 34] {
        let got = read_with(&text[..cut], &PygOptions { always_pyglet: true, ..PygOptions::default() });
        assert!(got.error.is_some(), "{cut}");
    }
}

#[test]
fn each_invalid_call_is_reported_with_its_reason() {
    let table = [
        ("Sphere (1, -1, 1)", "Sphere is called without thetamax"),
        ("Sphere (1, -1, 1, 'a')", "Sphere wants a number for thetamax"),
        ("Sphere (1, -1, 1, 360, 'float a')", "parameter \"float a\" has no value"),
        ("Sphere (1, -1, 1, 360, 5, 6)", "wants the name of a parameter where a value stands"),
        ("World (1)", "World has 1 arguments too many"),
        ("Points (-1)", "wants a count for n, not -1"),
        ("Points (1.5)", "wants an integer"),
        ("Mesh ('linear', (3,), (0, 1))", "Mesh has 2 vertex indices where its faces have 3"),
        ("Mesh ('catmul-clark', (3,), (0, 1, 2))", "did you mean \"catmull-clark\"?"),
        ("Patch ('bezeir', 4, 4)", "did you mean \"bezier\"?"),
        ("Patch (4, 3, (0, 1), 0, 1, 2, 2, (0, 0, 1, 1), 0, 1)", "has 2 knots where 4 + 3 are needed"),
        ("Attribute ('flaot x', 1)", "unknown type"),
        ("Attribute ('x', None)", "has no value"),
        ("SetTransform (1, 2)", "wants 16 numbers for matrix, not 2"),
        ("Input ('a', (1, 2))", "wants 6 numbers for bound, not 2"),
        ("TrimCurve ((1,))", "TrimCurve is called without n"),
    ];
    for (text, expected) in table {
        let got = read_with(format!("\n{text}\nWorld ()").as_bytes(), &PygOptions::default());
        assert_eq!(got.told.len(), 1, "{text}: {:?}", got.told);
        assert!(
            got.told[0].starts_with("t.pyg:2: error: ") && got.told[0].contains(expected),
            "{:?}",
            got.told
        );
        assert_eq!(got.lines(), [(3, "World")]);
    }
}

#[test]
fn calls_have_the_lines_where_they_begin() {
    let text =
        "World ()\n\nMotion (0,\n 1)\n\"\"\"\n\n\"\"\"\n# c\nScale (1, 1, 1); Scale \\\n(1, 1, 1)\nRender ()";
    let got = read_with(text.as_bytes(), &PygOptions::default());
    assert_eq!(got.lines(), [(1, "World"), (3, "Motion"), (9, "Scale"), (9, "Scale"), (11, "Render")]);
}

#[test]
fn scripts_are_refused_without_permission_or_an_interpreter() {
    let text = b"World ()\nx = 3\n";
    let flat_only = PygOptions { always_pyglet: true, ..PygOptions::default() };
    let got = read_with(text, &flat_only);
    assert_eq!(
        got.error(),
        "t.pyg:2: an assignment to \"x\" is not part of a flat scene, and only flat scenes are to be read"
    );
    assert_eq!(got.lines(), [(1, "World")]);
    let safe = PygOptions { safe: true, ..PygOptions::default() };
    assert!(read_with(text, &safe).error().contains("scripts are not to be run"));
    let none = PygOptions { python: Some(PathBuf::from("/nonexistent/python3")), ..PygOptions::default() };
    let told = read_with(text, &none).error();
    assert!(told.starts_with("t.pyg:2: an assignment to \"x\" makes this a Python script, but /nonexistent/python3 cannot be started"), "{told}");
    // This program is not an interpreter.
    let wrong = PygOptions { python: Some(PathBuf::from("/bin/false")), ..PygOptions::default() };
    assert!(read_with(text, &wrong).error.is_some());
    assert!(matches!(
        read(
            PygSource::Path("/nonexistent.pyg".into()),
            &mut Recorder::default(),
            &safe,
            &Reporter::silent()
        ),
        Err(PygError::Io { .. })
    ));
}

#[test]
fn statements_longer_than_the_limit_are_errors() {
    let options = PygOptions { statement_limit: 1 << 20, always_pyglet: true, ..PygOptions::default() };
    let long = format!("Attribute ('float[9] x', ({}))", "1, ".repeat(1_000_000));
    assert!(matches!(read_with(long.as_bytes(), &options).error, Some(PygError::Io { .. })));
    // The limit does not apply to many short statements.
    let many = "Sphere (1, -1, 1, 360)\n".repeat(100_000);
    assert_eq!(read_with(many.as_bytes(), &options).calls.len(), 100_000);
    // The depth of nesting also has a limit.
    let deep = format!("Attribute ('x', {})", "(".repeat(100_000));
    assert!(read_with(deep.as_bytes(), &options).told[0].contains("a bracket without its end"));
    let deep = format!("Attribute ('x', {}{})", "(".repeat(100_000), ")".repeat(100_000));
    assert!(read_with(deep.as_bytes(), &options).error.is_some());
    let minus = format!("Attribute ('x', {}1)", "-".repeat(100_000));
    assert!(read_with(minus.as_bytes(), &options).error.is_some());
}

#[test]
fn statements_too_long_for_python_are_read_if_flat() {
    // The statement is longer than what is kept for Python. It can be read when it is flat. A name in it is an error
    // with its line.
    let mut text = b"Points (1800000, \"vertex point P\", (\n".to_vec();
    text.extend(b"0.5,1,-2,\n".repeat(1_800_000));
    let good = [&text, &b"))\nScale (1, 2, 3)\n"[..]].concat();
    let outcome = read_with(&good, &PygOptions::default());
    assert_eq!(outcome.lines(), [(1, "Points"), (1_800_003, "Scale")]);
    let bad = [&text, &b"x))\n"[..]].concat();
    let error = read_with(&bad, &PygOptions::default()).error();
    assert!(error.contains("line 1800002: the name \"x\""), "{error}");
    assert!(error.contains("must be flat"), "{error}");
}

#[test]
fn scripts_run_in_batches_and_keep_their_line_numbers() {
    // Every statement is passed to Python, in batches. The lines are those of the file.
    let mut text = "# a scene\n\n".to_owned();
    for _ in 0..20_000 {
        text += "Scale (1, 2,\n  3) # comment\n\n";
    }
    text += "def f ():\n    Scale (4, 5, 6)\n\nf ()\n";
    if !has_python() {
        return;
    }
    let options = PygOptions { never_pyglet: true, ..PygOptions::default() };
    let outcome = read_with(text.as_bytes(), &options);
    let lines = outcome.lines();
    assert_eq!(lines.len(), 20_001);
    assert_eq!((lines[0].0, lines[19_999].0, lines[20_000].0), (3, 60_000, 60_004));
}

#[test]
fn the_sink_can_stop_the_reader() {
    let mut recorder = Recorder { stop_at: Some(2), ..Recorder::default() };
    let source = PygSource::Bytes { name: "t".into(), bytes: b"World ()\nWorld ()\nWorld ()".to_vec() };
    let result = read(source, &mut recorder, &PygOptions::default(), &Reporter::silent());
    assert!(matches!(result, Err(PygError::Stopped(Stop::Exit))));
    assert_eq!(recorder.calls.len(), 2);
}

#[test]
fn scripts_and_flat_statements_keep_their_order() {
    let text = "Scale (1, 1, 1)\nfor i in range(3):\n    Translate (i, 0, 0)\n\n    # c\nScale (2, 2, 2)\ndef twice(n):\n    for _ in (1, 2):\n        Rotate(n, (0, 0, 1))\ntwice (10)\nScale (3, 3, 3)\n";
    let Some(got) = script(text) else { return };
    assert!(got.error.is_none(), "{:?}", got.error);
    let want = [
        (1, "Scale"),
        (3, "Translate"),
        (3, "Translate"),
        (3, "Translate"),
        (6, "Scale"),
        (9, "Rotate"),
        (9, "Rotate"),
        (11, "Scale"),
    ];
    assert_eq!(got.lines(), want);
    // The other ways of execution give the same calls.
    for options in [
        PygOptions { chunking: Chunking::Never, ..PygOptions::default() },
        PygOptions { never_pyglet: true, ..PygOptions::default() },
    ] {
        let again = read_with(text.as_bytes(), &options);
        assert_eq!(again.calls, got.calls);
    }
}

#[test]
fn flat_and_python_pass_the_same_values() {
    if !has_python() {
        return;
    }
    let text = include_bytes!("values.pyg");
    let flat = read_with(text, &PygOptions { always_pyglet: true, ..PygOptions::default() });
    let python = read_with(text, &PygOptions { never_pyglet: true, ..PygOptions::default() });
    assert!(flat.error.is_none() && python.error.is_none(), "{:?} {:?}", flat.error, python.error);
    assert_eq!((flat.told.len(), python.told.len()), (0, 0), "{:?} {:?}", flat.told, python.told);
    assert!(!flat.calls.is_empty());
    for (a, b) in flat.calls.iter().zip(&python.calls) {
        assert_eq!(a, b);
    }
    assert_eq!(flat.calls.len(), python.calls.len());
}

#[test]
fn scripts_query_attributes_and_print() {
    let text = r#"
import math
x, y = GetAttribute ("int[2] resolution")
assert (x, y) == (640, 480)
assert GetAttribute ("float fov") == 45.5 and GetAttribute ("string name") == "b\u00e9ta"
assert GelatoRenderer.GetAttribute ("float nothing") is None
print ("first", x)
print ("no end", end="")
Sphere (math.sqrt (4), -1, 1, 360, "vertex color c", ((i, i, i) for i in xrange (2)))
"#;
    let Some(got) = script(text) else { return };
    assert!(got.error.is_none(), "{:?}", got.error);
    assert_eq!(got.told, ["first 640\n", "no end\n"]);
    let Call::Shape { shape, params } = &got.calls[0].1 else { panic!() };
    assert_eq!(**shape, ShapeDesc::Sphere { radius: 2.0, zmin: -1.0, zmax: 1.0, thetamax_deg: 360.0 });
    let want: Params = [Param::declared("vertex color c", &[0.0, 0.0, 0.0, 1.0, 1.0, 1.0][..]).unwrap()]
        .into_iter()
        .collect();
    assert_eq!(*params, want);
}

#[test]
fn errors_of_scripts_name_their_line() {
    let table = [
        ("import math\nWorld ()\nmath.sqrt (-1)\nWorld ()", "t.pyg:3: error: ValueError: math domain error"),
        (
            "def f():\n    return 1 / 0\n\nf ()",
            "t.pyg:2: error: ZeroDivisionError: division by zero (in f, called from line 4)",
        ),
        ("x = 1\n\n\nif x\n  pass", "t.pyg:4: error: SyntaxError"),
        (
            "x = 1\nSphre (1, -1, 1, 360)",
            "t.pyg:2: error: NameError: name 'Sphre' is not defined; did you mean \"Sphere\"?",
        ),
        ("x = {}\nTranslate (x['a'], 0, 0)", "t.pyg:2: error: KeyError: 'a'"),
        (
            "x = object ()\nTranslate (x, 0, 0)",
            "t.pyg:2: error: TypeError: cannot pass a value of type object",
        ),
        ("import os\nos._exit (7)", "t.pyg:1: error: the interpreter ended early"),
    ];
    for (text, expected) in table {
        for options in every_way() {
            let Some(got) = script_with(&format!("{text}\nRender ()\n"), &options) else { return };
            assert!(got.told[0].starts_with(expected), "{text}: {:?}", got.told);
            assert_eq!(got.told.len(), 1, "{text}: {:?}", got.told);
            assert!(got.error.is_none(), "{text}: {:?}", got.error);
            // The rest of the file is executed, except where one piece contains a statement that ends the interpreter
            // or has invalid syntax.
            let whole = options.chunking == Chunking::Never || options.never_pyglet;
            let lost = whole && (text.contains("_exit") || text.contains("if x"));
            assert!(lost || got.lines().last().is_some_and(|l| l.1 == "Render"), "{text}: {:?}", got.lines());
        }
    }
    for (text, expected) in [
        ("import sys\nsys.exit ('enough')\nRender ()", "t.pyg:2: enough"),
        ("import sys\nsys.exit (3)\nRender ()", "t.pyg:2: the script ended with 3"),
        ("x = 1\nraise KeyboardInterrupt\nRender ()", "t.pyg:2: KeyboardInterrupt: "),
    ] {
        for options in every_way() {
            let Some(got) = script_with(text, &options) else { return };
            assert!(got.error().starts_with(expected), "{text}: {}", got.error());
            assert_eq!(got.lines(), []);
        }
    }
    // Exiting without an error is like the end of the file.
    let Some(got) = script("import sys\nWorld ()\nsys.exit ()\nWorld ()") else { return };
    assert!(got.error.is_none());
    assert_eq!(got.lines(), [(2, "World")]);
    // Errors of single calls do not stop a script. Repetitions of an error are only counted.
    let Some(got) = script("for i in range (2):\n  Sphere (i)\nWorld ()") else { return };
    assert_eq!(got.told.len(), 1);
    assert_eq!(got.lines(), [(3, "World")]);
}

/// Returns the ways in which a script can be read.
fn every_way() -> [PygOptions; 4] {
    let default = PygOptions::default;
    [
        default(),
        PygOptions { chunking: Chunking::Never, ..default() },
        PygOptions { never_pyglet: true, ..default() },
        PygOptions { never_pyglet: true, chunking: Chunking::Never, ..default() },
    ]
}

fn script_with(text: &str, options: &PygOptions) -> Option<Outcome> {
    has_python().then(|| read_with(text.as_bytes(), options))
}

#[test]
fn an_exception_skips_only_its_statement() {
    let text = "\
import math
def ball(r):
    Sphere (r, -r, r, 360)
    Sphere (1 / r, -r, r, 360)
# a comment
for r in (1, 0, 2):
    ball (r)
x = [
    1,
    missing ]; y = 3
@nobody
def f(): pass
with open('/nonexistent/file') as file:
    World ()

class C:
    v = math.sqrt (4)
Translate (C.v,
           1, 2)
try:
    ball (0)
except ZeroDivisionError:
    Scale (1, 1, 1)
World ()
z = 3
Translate (z, x, z)
Translate (z, z, z)
Render ()
";
    for options in every_way() {
        let Some(got) = script_with(text, &options) else { return };
        assert!(got.error.is_none(), "{:?}", got.error);
        let ends: Vec<&str> =
            got.told.iter().map(|t| t.split(": the rest").next().unwrap_or_default()).collect();
        assert_eq!(
            ends,
            [
                "t.pyg:4: error: ZeroDivisionError: division by zero (in ball, called from line 7)",
                "t.pyg:10: error: NameError: name 'missing' is not defined",
                "t.pyg:11: error: NameError: name 'nobody' is not defined",
                "t.pyg:13: error: FileNotFoundError: [Errno 2] No such file or directory: '/nonexistent/file'",
                "t.pyg:26: error: NameError: name 'x' is not defined",
            ],
        );
        let names: Vec<&str> = got.lines().iter().map(|l| l.1).collect();
        let wanted =
            ["Sphere", "Sphere", "Sphere", "Translate", "Sphere", "Scale", "World", "Translate", "Render"];
        assert_eq!(names, wanted);
    }
    // Many exceptions are counted. Too many statements that are not Python end the file.
    let Some(got) = script(&"x = []\ny = x[0]\n".repeat(500)) else { return };
    assert_eq!(got.told.len(), 21, "{:?}", got.told);
    assert_eq!(got.told[20], "t.pyg: error: 480 more statements of the script ended with an exception");
    let Some(got) = script(&format!("World ()\n{}", "y = = 1\n".repeat(500))) else { return };
    assert_eq!(got.told.len(), 19, "{:?}", got.told);
    assert!(got.error().contains("SyntaxError") && got.error().contains("after 20 such"), "{}", got.error());
    let Some(got) = script("This is a letter.\n\nIt is not a scene at all.\nWith regards,\nThe author!\n")
    else {
        return;
    };
    assert!(got.told.len() == 2 && got.error().contains("after 3 such"), "{:?} {}", got.told, got.error());
}

#[test]
fn unreadable_calls_are_skipped_and_reported() {
    // Without Python, strings and brackets without their end are reported.
    let text = "World ()\nTranslate (0, 0,\n# so\nScale (1, 1, 1)\nShader (\"surface\", \"plastic)\nRotate (1, 0, 0, 1)\nSphere (1,";
    let (reporter, said) = Reporter::collecting();
    let mut recorder = Recorder::default();
    let options = PygOptions { python: Some("/nonexistent/python3".into()), ..PygOptions::default() };
    let source = PygSource::Bytes { name: "t.pyg".into(), bytes: text.into() };
    read(source, &mut recorder, &options, &reporter).unwrap();
    let names: Vec<(u32, &str)> = recorder.calls.iter().map(|(line, c)| (*line, c.name())).collect();
    assert_eq!(names, [(1, "World"), (4, "Scale"), (6, "Rotate")]);
    let said: Vec<String> = said.lock().iter().map(ToString::to_string).collect();
    assert_eq!(
        said,
        [
            "t.pyg:2: error: a bracket without its end: the call is ignored (object \"béta\")",
            "t.pyg:5: error: a string without its end: the call is ignored (object \"béta\")",
            "t.pyg:7: error: a bracket without its end: the call is ignored (object \"béta\")",
        ]
    );
    // With Python, other invalid statements are reported too, also between valid ones.
    let text =
        "x = 1\nSphere (x, -1 1)\ny = 2\nSphere (x, -y, y, 360)\nSphere (y 3)\nWorld ()\nz = x +\nWorld ()\n";
    let Some(got) = script(text) else { return };
    assert_eq!(got.lines(), [(4, "Sphere"), (6, "World"), (8, "World")]);
    assert_eq!(got.told.len(), 3);
    assert!(got.told[0].starts_with("t.pyg:2: error: SyntaxError: "), "{:?}", got.told);
    assert!(got.told[1].starts_with("t.pyg:5: error: SyntaxError: "), "{:?}", got.told);
    assert!(got.told[2].starts_with("t.pyg:7: error: SyntaxError: "), "{:?}", got.told);
    assert!(got.error.is_none());
}

#[test]
fn scripts_that_close_their_standard_streams_continue() {
    for close in [
        "import os\nos.close (1)",
        "import sys\nsys.stdout.close ()",
        "import os\nos.close (0)\nos.close (2)",
    ] {
        let Some(got) = script(&format!("{close}\nprint ('still there')\nWorld ()\n")) else { return };
        assert!(got.error.is_none(), "{close}: {:?}", got.error);
        assert_eq!(got.lines().last().map(|l| l.1), Some("World"), "{close}");
    }
    // A script that closes the pipes of the interpreter itself ends the interpreter.
    let Some(got) = script("import os\nos.closerange (3, 64)\nWorld ()\n") else { return };
    assert!(got.told[0].starts_with("t.pyg:1: error: the interpreter ended early"), "{:?}", got.told);
    assert_eq!((got.lines(), got.error.is_none()), (vec![(3, "World")], true));
    // The interpreter is replaced only a few times.
    let text = "import os\nos._exit (1)\nWorld ()\n".repeat(6);
    let Some(got) = script(&text) else { return };
    assert!(got.error().starts_with("t.pyg:10: the interpreter ended early"), "{}", got.error());
    assert_eq!((got.told.len(), got.calls.len()), (3, 3));
}

#[test]
fn scripts_may_redefine_the_names_of_calls() {
    let text = "x = 2\nOld = Sphere\ndef Sphere(r):\n    Old (r, -r, r, 360)\nSphere (1)\nSphere (x)\n";
    let Some(got) = script(text) else { return };
    assert!(got.error.is_none(), "{:?}", got.error);
    assert_eq!(got.lines(), [(4, "Sphere"), (4, "Sphere")]);
}

#[test]
fn programs_that_scripts_run_cannot_disturb_the_stream() {
    let text =
        "import os, sys\nos.system ('cat; echo loud 1>&2')\nassert sys.stdin.read () == ''\nWorld ()\n";
    let Some(got) = script(text) else { return };
    assert!(got.error.is_none(), "{:?}", got.error);
    assert_eq!(got.lines(), [(4, "World")]);
}

#[test]
fn scripts_import_modules_from_their_own_folder() {
    if !has_python() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(
        dir.path().join("balls.py"),
        "import gelato\ndef ball(r):\n    gelato.Sphere (r, -r, r, 360)\n",
    )
    .unwrap();
    let main = dir.path().join("main.pyg");
    std::fs::write(&main, "import balls\nballs.ball (3)\n").unwrap();
    let mut recorder = Recorder::default();
    read(PygSource::Path(main), &mut recorder, &PygOptions::default(), &Reporter::silent()).unwrap();
    assert_eq!(recorder.calls[0].0, 2);
}

#[test]
fn the_cylinder_script_of_the_reference_is_read() {
    let Some(got) = script(include_str!("cyl.pyg")) else { return };
    assert!(got.error.is_none() && got.told.is_empty());
    let names: Vec<_> = got.calls.iter().map(|(_, c)| c.name()).collect();
    assert_eq!((names.len(), names[17]), (19, "Patch"));
    let Call::Shape { shape, params } = &got.calls[17].1 else { panic!("{names:?}") };
    assert!(matches!(**shape, ShapeDesc::Nurbs { .. }));
    assert_eq!(params.get("Pw").unwrap().data.len(), 18 * 4);
}

/// Scenes that share their scripts behave like one scene that contains them all. Other scenes do not share definitions.
#[test]
fn scenes_share_definitions_when_they_share_their_scripts() {
    if !has_python() {
        return;
    }
    let shared = PygOptions { scripts: Some(granita_pyg::Scripts::default()), ..PygOptions::default() };
    let named = |name: &str, text: &str, options: &PygOptions| {
        let (reporter, messages) = Reporter::collecting();
        let mut recorder = Recorder::default();
        let source = PygSource::Bytes { name: name.into(), bytes: text.as_bytes().to_vec() };
        let error = read(source, &mut recorder, options, &reporter).err();
        let told = messages.lock().iter().map(ToString::to_string).collect();
        Outcome { calls: recorder.calls, told, error }
    };
    let first = named("a.pyg", "x = 3\ndef move(n):\n    Translate (n, 0, 0)\n", &shared);
    assert!(first.error.is_none() && first.told.is_empty(), "{:?}", first.told);
    // A file that is read without this interpreter leaves it in place.
    let pyglet = PygOptions { always_pyglet: true, ..shared.clone() };
    assert_eq!(named("c.pyg", "Scale (2, 2, 2)\n", &pyglet).lines(), [(1, "Scale")]);
    let second = named("b.pyg", "Scale (2, 2, 2)\n\nmove (x)\nprint (__file__)\nx = 4\n", &shared);
    assert_eq!(second.lines(), [(1, "Scale"), (3, "Translate")], "{:?}", second.told);
    assert_eq!(second.told, ["b.pyg\n"]);
    // Errors have the position in the file that is being read.
    let third = named("c.pyg", "\nnosuch (x)\nTranslate (x, 0, 0)\n", &shared);
    assert_eq!(third.lines(), [(3, "Translate")]);
    assert!(third.told[0].starts_with("c.pyg:2: error: NameError"), "{:?}", third.told);
    // The changed meaning of calls is also shared.
    named("d.pyg", "def Sphere (*a): Scale (9, 9, 9)\n", &shared);
    assert_eq!(named("e.pyg", "Sphere (1, -1, 1, 360)\n", &shared).lines(), [(1, "Scale")]);
    let alone = named("f.pyg", "Translate (x, 0, 0)\n", &PygOptions::default());
    assert!(alone.calls.is_empty() && alone.told[0].contains("NameError"), "{:?}", alone.told);
    // Scenes that may not run scripts do not get the interpreter.
    let safe = PygOptions { safe: true, ..shared.clone() };
    assert!(named("g.pyg", "Translate (x, 0, 0)\n", &safe).calls.is_empty());
}
