//! Tests of the options of the tool, one by one, on a scene that renders quickly.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

mod folder;

use folder::Folder;
use std::process::{Command, Stdio};

const SCENE: &str = r#"
Attribute ("int[2] resolution", (24, 16))
Output ("out.tif", "tiff", "rgba", "main")
Output ("normals.tif", "tiff", "normal N", "main", "int[4] quantize", (0, 0, 0, 0), "float dither", 0)
Camera ("main")
World ()
Light ("sun", "distantlight")
Translate (0, 0, 4)
Shader ("surface", "plastic")
Sphere (1, -1, 1, 360)
Render ()
"#;

/// Makes a folder with the scene in it.
fn place() -> Folder {
    Folder::with(&[("scene.pyg", SCENE)])
}

#[test]
fn statistics_are_printed_and_written_as_json() {
    let place = place();
    let ran = place.run(&["-statistics", "-statistics-json", "out.json", "scene.pyg"]);
    assert_eq!(ran.status, 0, "{}", ran.said);
    assert!(ran.said.contains("Statistics of camera \"main\"") && ran.said.contains("texture files"));
    let json = place.json("out.json");
    assert_eq!(json["schema"], "granita-statistics-1");
    assert_eq!((&json["exit_status"], &json["messages"]["errors"]), (&0.into(), &0.into()));
    assert_eq!(json["scenes"], serde_json::json!(["scene.pyg"]));
    assert_eq!(json["files_read"], serde_json::json!(["scene.pyg"]));
    assert_eq!(json["images"], serde_json::json!(["out.tif", "normals.tif"]));
    let frame = &json["frames"][0];
    assert_eq!(frame["complete"], true);
    let camera = &frame["cameras"][0];
    assert_eq!(
        (&camera["name"], &camera["primitives"], &camera["buckets"]),
        (&"main".into(), &1.into(), &1.into())
    );
    assert!(camera["points_shaded"].as_u64().unwrap() > 10);
    assert!(camera["seconds"]["frame"].as_f64().unwrap() > 0.0);
    assert!(frame["seconds"].as_f64().unwrap() >= camera["seconds"]["frame"].as_f64().unwrap());
    assert_eq!(frame["shading"]["rays"], 0);
    assert!(place.is_clean());

    // The file is also written by a run that failed.
    let ran = place.run(&["-statistics-json", "failed.json", "nosuch.pyg"]);
    let json = place.json("failed.json");
    assert_eq!((ran.status, &json["exit_status"], &json["frames"]), (2, &2.into(), &serde_json::json!([])));
    let ran = place.run(&["-statistics-json", "no/folder/out.json", "scene.pyg"]);
    assert!(ran.status == 2 && ran.said.contains("no folder no/folder"), "{}", ran.said);
}

#[test]
fn attributes_for_file_lists_and_logs_write_files() {
    let place = place();
    place.write("other.gsl", "#include \"part.h\"\nsurface other () { C = GREY; }\n");
    place.write("part.h", "#define GREY 0.5\n");
    place.write("ball.pyg", "Sphere (1, -1, 1, 360)\n");
    let scene = SCENE.replace("\"plastic\"", "\"other\"").replace("Sphere", "Input (\"ball.pyg\")\nSphere");
    let front = r#"
Attribute ("string error:filename", "errors.log")
Attribute ("string debug:filesread", "files.txt")
Attribute ("int statistics:level", 2)
Attribute ("string statistics:filename", "statistics.txt")
Command ("fileread", "string name", "plugin data")
Attribute ("float opactiy", 1)
"#;
    place.write("scene.pyg", &format!("{front}{scene}"));
    let ran = place.run(&["scene.pyg"]);
    assert_eq!((ran.status, ran.said.as_str()), (0, ""));
    let log = place.read("errors.log");
    assert!(
        log.starts_with("scene.pyg:7: warning: unknown attribute \"opactiy\"; did you mean \"opacity\"?\n"),
        "{log}"
    );
    assert_eq!(place.read("files.txt"), "ball.pyg\nother.gsl\npart.h\nplugin data\nscene.pyg\n");
    let statistics = place.read("statistics.txt");
    assert!(
        statistics.contains("Statistics of camera") && statistics.contains("plugin data"),
        "{statistics}"
    );
    assert!(place.is_clean());

    // A file that cannot be written is reported where messages went before.
    place.write(
        "scene.pyg",
        &SCENE.replace("World", "Attribute (\"string error:filename\", \"no/such/log\")\nWorld"),
    );
    let ran = place.run(&["scene.pyg"]);
    assert!(ran.status == 1 && ran.said.contains("no/such/log"), "{}", ran.said);
}

#[test]
fn messages_follow_the_verbosity_and_are_counted() {
    let place = place();
    let twice = "Attribute (\"float opactiy\", 1)\nAttribute (\"string C\", \"red\")\n";
    place.write("scene.pyg", &format!("{twice}{twice}{twice}{SCENE}"));
    let normal = place.run(&["scene.pyg"]);
    assert_eq!(normal.status, 1);
    assert_eq!(normal.said.matches("opactiy").count(), 2, "once, and in the summary: {}", normal.said);
    assert!(
        normal.said.contains("1 error, 1 warning\n  2 times more: scene.pyg:1: warning:"),
        "{}",
        normal.said
    );
    for quiet in [["-silent", "scene.pyg"].as_slice(), &["-verbosity", "0", "scene.pyg"]] {
        let ran = place.run(quiet);
        let lines: Vec<&str> = ran.said.lines().collect();
        assert!(ran.status == 1 && lines.len() == 1 && lines[0].contains("\"C\" needs color"), "{lines:?}");
    }
    let much = place.run(&["-verbosity", "2", "scene.pyg"]);
    assert!(much.said.contains("info: compiling plastic.gsl"), "{}", much.said);
    // The option takes precedence over the scene.
    place.write("scene.pyg", &format!("Attribute (\"int verbosity\", 0)\n{twice}{SCENE}"));
    assert!(!place.run(&["scene.pyg"]).said.contains("opactiy"));
    assert!(place.run(&["-verbosity", "1", "scene.pyg"]).said.contains("opactiy"));
}

#[test]
fn the_working_folder_and_variables_are_set() {
    let place = place();
    std::fs::create_dir(place.path().join("inside")).unwrap();
    let text = SCENE
        .replace("World", "Attribute (\"string path:shader\", \"$WHERE\")\nWorld")
        .replace("plastic", "mine");
    place.write("inside/scene.pyg", &text);
    place.write("mine.gsl", "surface mine () { C = 1; }\n");
    let ran = place.run(&["scene.pyg", "-cwd", "inside", "-env", "WHERE=.."]);
    assert_eq!((ran.status, ran.said.as_str()), (0, ""));
    assert!(place.has("inside/out.tif"));
    // The variable is also set for programs that the scene runs and for its scripts.
    place.write("run.pyg", "Command (\"system test \\\"$WHERE\\\" = here && touch seen\")\n");
    assert_eq!(place.run(&["-env", "WHERE=here", "run.pyg"]).status, 0);
    assert!(place.has("seen"));
    for words in
        [["-cwd", "nowhere", "scene.pyg"], ["-env", "NOEQUALS", "scene.pyg"], ["-env", "=x", "scene.pyg"]]
    {
        let ran = place.run(&words);
        assert!(ran.status == 2 && ran.said.contains(words[1]), "{}", ran.said);
    }
}

#[test]
fn startup_files_are_read_in_order() {
    let place = place();
    std::fs::create_dir(place.path().join("home")).unwrap();
    place.write(
        ".gelato.pyg",
        "Attribute (\"string user:a\", \"site\")\nAttribute (\"int[2] resolution\", (8, 8))\n",
    );
    place.write("home/.gelato.pyg", "Attribute (\"int[2] resolution\", (10, 4))\n");
    place.write("scene.pyg", &SCENE.replace("Attribute (\"int[2] resolution\", (24, 16))\n", ""));
    let mut command = place.command(&["scene.pyg", "-o", "small.png", "-statistics-json", "s.json"]);
    command.env("GELATOHOME", place.path()).env("HOME", place.path().join("home"));
    let ran = Folder::ran(command);
    assert_eq!(ran.status, 0, "{}", ran.said);
    let png = place.bytes("small.png");
    assert_eq!((png[19], png[23]), (10, 4));
    let json = place.json("s.json");
    assert_eq!(json["files_read"].as_array().unwrap().len(), 3);
}

#[test]
fn a_missing_folder_for_temporary_files_is_an_error() {
    let place = place();
    place.write("dump.pyg", &format!("Attribute (\"string griddump:filename\", \"grids.pyg\"){SCENE}"));
    let ran = |folder: &str| {
        let mut command = place.command(&["dump.pyg"]);
        command.env("GELATOTEMP", folder);
        Folder::ran(command)
    };
    std::fs::create_dir(place.path().join("temporary")).unwrap();
    let known = ran("temporary");
    assert_eq!((known.status, known.said.as_str()), (0, ""));
    let dumped = place.bytes("grids.pyg");
    let missing = ran("no/such");
    let told = missing.said.contains("GELATOTEMP: \"no/such\" is no folder");
    assert!(missing.status == 0 && told, "{}", missing.said);
    assert!(!dumped.is_empty() && place.bytes("grids.pyg") == dumped);
    assert_eq!(std::fs::read_dir(place.path().join("temporary")).unwrap().count(), 0, "nothing is left");
}

#[test]
fn options_add_output_images() {
    let place = place();
    let ran = place.run(&["scene.pyg", "-o", "a.png", "-data", "first"]);
    assert_eq!(ran.status, 0, "{}", ran.said);
    assert!(place.has("a.png") && place.has("out.tif"));
    assert_eq!(place.run(&["scene.pyg", "-o", "b.exr", "-data", "all"]).status, 0);
    assert!(place.has("b-1.exr") && place.has("b-2.exr") && !place.has("b.exr"));
    assert_eq!(place.run(&["scene.pyg", "-o", "z.exr", "-data", "z", "-o", "zz.exr"]).status, 0);
    assert!(place.has("z.exr") && place.has("zz.exr"));
    let ran = place.run(&["scene.pyg", "-o", "x.nosuch"]);
    assert!(ran.status == 1 && ran.said.contains("x.nosuch"), "{}", ran.said);
}

#[test]
fn options_for_quick_renders_change_the_image() {
    let place = place();
    let image = |words: &[&str]| {
        let ran = place.run(&[words, &["scene.pyg"]].concat());
        assert_eq!((ran.status, ran.said.as_str()), (0, ""), "{words:?}");
        place.bytes("out.tif")
    };
    let full = image(&[]);
    let others = [
        image(&["-preview", "0.2"]),
        image(&["-shade", "defaultsurface"]),
        image(&["-shade", "keyfillrim"]),
        image(&["-shade", "keyfillrim", "-preview", "0.2"]),
        image(&["-crop", "0", "0.5", "0", "1"]),
    ];
    for (i, other) in others.iter().enumerate() {
        assert!(*other != full, "{i}");
    }
    assert_eq!(image(&["-threads", "3", "-shade", "gsl", "-preview", "0"]), full);
    for words in
        [["-shade", "nosuch", "scene.pyg"], ["-preview", "-1", "scene.pyg"], ["-threads", "x", "scene.pyg"]]
    {
        assert_eq!(place.run(&words).status, 2, "{words:?}");
    }
}

#[test]
fn scenes_with_safe_run_no_programs() {
    let place = place();
    let programs = "Command (\"system touch seen\")\nInput (\"pyg < touch seen\")\nCommand (\"mkdir\", \"string name\", \"seen\")\n";
    place.write("scene.pyg", &format!("{programs}{SCENE}"));
    let ran = place.run(&["-safe", "scene.pyg"]);
    assert!(ran.status == 1 && !place.has("seen") && place.has("scene.out/out.tif"), "{}", ran.said);
    assert_eq!(ran.said.matches("allowed").count(), 3, "{}", ran.said);
    place.write("scene.pyg", &format!("import os\nos.mkdir ('seen')\n{SCENE}"));
    let ran = place.run(&["-safe", "scene.pyg"]);
    assert!(ran.status == 2 && !place.has("seen") && ran.said.contains("scene.pyg:1"), "{}", ran.said);
}

#[test]
fn scenes_are_read_from_files_generators_and_standard_input() {
    let place = place();
    // Two files count as one, and either may be a generator with arguments.
    let (front, back) = SCENE.split_once("World").unwrap();
    place.write("a.pyg", front);
    place.write("b.pyg", &format!("World{back}"));
    assert_eq!(place.run(&["a.pyg", "b.pyg"]).status, 0);
    let whole = place.bytes("out.tif");
    std::fs::remove_file(place.path().join("out.tif")).unwrap();
    assert_eq!(place.run(&["pyg a.pyg", "pyg < cat b.pyg"]).status, 0);
    assert_eq!(place.bytes("out.tif"), whole);
    for name in ["-", "pyg -"] {
        std::fs::remove_file(place.path().join("out.tif")).unwrap();
        let mut command = place.command(&[name]);
        command.stdin(std::fs::File::open(place.path().join("scene.pyg")).unwrap());
        let ran = Folder::ran(command);
        assert_eq!((ran.status, ran.said.as_str()), (0, ""), "{name}");
        assert_eq!(place.bytes("out.tif"), whole);
    }
    if cfg!(unix) {
        std::fs::remove_file(place.path().join("out.tif")).unwrap();
        let pipe = place.path().join("pipe");
        assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let writer = std::thread::spawn(move || std::fs::write(pipe, SCENE));
        let ran = place.run(&["pipe"]);
        writer.join().unwrap().unwrap();
        assert_eq!((ran.status, ran.said.as_str(), place.bytes("out.tif")), (0, "", whole));
    }
    assert_eq!(place.run(&[]).status, 2);
    assert_eq!(place.run(&["."]).status, 2);
    let ran = place.run(&["a.pyg", "pyg << World (); Sphere (1, -1, 1, 360)"]);
    assert!(ran.said.contains("nothing was rendered: 1 primitives"), "{}", ran.said);
    for (word, status) in [("-help", 0), ("--help", 0), ("-version", 0), ("--version", 0), ("-nosuch", 2)] {
        assert_eq!(place.run(&[word]).status, status, "{word}");
    }
}

#[test]
fn progress_is_printed_in_lines_without_a_terminal() {
    let place = place();
    place.write("small.pyg", &format!("Attribute (\"int[2] limits:bucketsize\", (4, 4))\n{SCENE}"));
    let ran = place.run(&["-verbosity", "2", "small.pyg"]);
    assert_eq!(ran.status, 0, "{}", ran.said);
    let lines = ran.said.lines().filter(|l| l.contains("% rendered")).count();
    assert!((3..=10).contains(&lines), "{}", ran.said);
    assert!(ran.said.contains("gelato: info: rendered in "), "{}", ran.said);
    // No statistics are printed without the option.
    assert_eq!(place.run(&["small.pyg"]).said, "");
}

#[test]
fn indirectly_read_files_are_listed() {
    let place = place();
    place.write("m.mtl", "newmtl red\nKd 1 0 0\n");
    place.write("t.obj", "mtllib m.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    place.write("part.rib", "ReadArchive \"inner.rib\"\n");
    place.write("inner.rib", "Sphere 1 -1 1 360\n");
    let bytes = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].concat();
    let bytes: Vec<u8> = bytes.iter().flat_map(|x| x.to_le_bytes()).collect();
    std::fs::write(place.path().join("t.bin"), bytes).unwrap();
    let gltf = r#"{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 36, "uri": "t.bin"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "nodes": [{"mesh": 0}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]}"#;
    place.write("t.gltf", gltf);
    let inputs = "Input (\"t.obj\")\nInput (\"t.gltf\")\nInput (\"part.rib\")\nRender";
    let scene = SCENE.replace("Render", inputs);
    place.write("all.pyg", &format!("Attribute (\"string debug:filesread\", \"files.txt\")\n{scene}"));
    let ran = place.run(&["all.pyg"]);
    assert_eq!((ran.status, ran.said.as_str()), (0, ""));
    let listed = place.read("files.txt");
    let mut names: Vec<&str> = listed.lines().map(|l| l.rsplit('/').next().unwrap_or(l)).collect();
    names.sort_unstable();
    assert_eq!(names, ["all.pyg", "inner.rib", "m.mtl", "part.rib", "t.bin", "t.gltf", "t.obj"]);
}

/// A reader of the messages that has gone does not cost the image.
#[test]
fn a_closed_pipe_drops_messages_but_not_the_image() {
    let place = place();
    place.write("loud.gsl", "surface loud () { printf (\"%f %f\\n\", u, v); }\n");
    place.write("loud.pyg", &SCENE.replace("\"plastic\"", "\"loud\""));
    let mut child =
        place.command(&["loud.pyg"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let ended = child.wait_with_output().unwrap();
    assert_eq!(ended.status.code(), Some(0), "{}", String::from_utf8_lossy(&ended.stderr));
    assert!(place.has("out.tif") && place.has("normals.tif"));
}

#[test]
fn the_option_as_takes_one_dash_or_two() {
    for option in ["-as", "--as"] {
        let ran = |tool: &str| {
            let mut command = Command::new(env!("CARGO_BIN_EXE_gelato"));
            command.args([option, tool, "-version"]).output().unwrap()
        };
        let out = ran("maketx");
        assert!(out.status.success() && out.stdout.starts_with(b"maketx "), "{option}");
        assert_eq!(ran("nosuch").status.code(), Some(2));
    }
}

#[test]
fn errors_without_a_frame_have_a_status_of_their_own() {
    let place = place();
    for (name, text, status) in [
        ("broken.stl", "solid x\nfacet nothing\n", 2),
        ("empty.obj", "v 1 x\nf 1 2\n", 2),
        ("void.obj", "", 2),
        ("invalid.pyg", "Sphre (1)\nFoo ()\n", 2),
        ("invalid.rib", "x y z\n", 2),
        // Commands are an effect.
        ("commands.pyg", "Command (\"nothing of this kind\")\nFoo ()\n", 1),
        ("framed.pyg", "Foo ()\nWorld ()\nSphere (1, -1, 1, 360)\nRender ()\n", 1),
        // A scene without a frame is no error.
        ("silent.pyg", "Attribute (\"float fov\", 30)\n", 0),
    ] {
        place.write(name, text);
        let ran = place.run(&[name]);
        assert_eq!(ran.status, status, "{name}: {}", ran.said);
    }
    let ran = place.run(&["broken.stl"]);
    assert!(ran.said.contains("broken.stl holds no objects that can be drawn"), "{}", ran.said);
    let mut command = place.command(&["-"]);
    command.stdin(std::fs::File::open(place.path().join("invalid.pyg")).unwrap());
    assert_eq!(Folder::ran(command).status, 2);
}

#[test]
fn all_errors_of_a_shader_are_reported_once() {
    let place = place();
    let shader = "surface bad (float a = \"x\")\n{\n    float unused = 1;\n    C = nosuch;\n    P = 0;\n}\n";
    place.write("bad.gsl", shader);
    let ball = "Shader (\"surface\", \"bad\")\nSphere (1, -1, 1, 360)\n";
    place.write(
        "use.pyg",
        &format!("Attribute (\"int[2] resolution\", (8, 6))\nTranslate (0, 0, 5)\nWorld ()\n{ball}{ball}Render ()\n"),
    );
    let ran = place.run(&["use.pyg"]);
    assert_eq!(ran.status, 1, "{}", ran.said);
    for line in [
        "gelato: bad.gsl:1:24: error: cannot convert a `string` to `float`\n",
        "gelato: bad.gsl:3:11: warning: variable `unused` is set but never used\n",
        "gelato: bad.gsl:4:9: error: unknown variable `nosuch`\n",
        "gelato: bad.gsl:5:5: error: a surface shader cannot change `P`\n",
        "warning: surface shader: \"bad\" cannot be used",
    ] {
        assert_eq!(ran.said.matches(line).count(), 1, "{line}{}", ran.said);
    }
    assert!(ran.said.contains("    C = nosuch;\n"), "{}", ran.said);
}

#[test]
fn attributes_are_set_from_the_command_line() {
    let place = place();
    place.write("part.pyg", "Attribute (\"float shadingquality\", 1)\nSphere (1, -1, 1, 360)\n");
    let scene = SCENE
        .replace("Camera (\"main\")", "Camera (\"main\", \"float fov\", 60)")
        .replace("Sphere (1, -1, 1, 360)", "Input (\"part.pyg\")");
    place.write("scene.pyg", &scene);
    let with = |words: &[&str]| {
        let ran = place.run(&[words, &["scene.pyg"]].concat());
        assert_eq!((ran.status, ran.said.as_str()), (0, ""));
        place.bytes("out.tif")
    };
    let plain = with(&[]);
    // The scene has these values already.
    assert!(with(&["-set", "fov=60", "-set", "resolution=24,16"]) == plain);
    // They replace what the camera, the scene and an input set.
    let changed = ["fov=30", "resolution=12,8", "shadingquality=4", "spatialquality=1,1"];
    for set in changed {
        assert!(with(&["-set", set]) != plain, "{set}");
    }
    place.write("fov.pyg", &scene.replace("\"float fov\", 60", "\"float fov\", 30"));
    let ran = place.run(&["fov.pyg"]);
    assert_eq!((ran.status, ran.said.as_str()), (0, ""));
    let narrow = place.bytes("out.tif");
    assert!(with(&["-set", "fov=30"]) == narrow);
    let ran = place.run(&["-set", "shadingqualty=1", "scene.pyg"]);
    assert!(ran.status == 2 && ran.said.contains("did you mean \"shadingquality\"?"), "{}", ran.said);
}
