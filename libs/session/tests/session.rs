//! Tests scenes from their text to the written files.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::{Environment, Reporter};
use granita_image::Limits;
use granita_inputs::RunOptions;
use granita_pyg::frames::{Frame, framed, put_text, receive};
use granita_session::{Connection, ExtraOutput, Outcome, Session, SessionError, SessionOptions};
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};

const SCENE: &str = r#"
Output ("IMAGE", "tiff", "rgba", "main", "int[4] quantize", (0, 0, 0, 0), "float dither", 0)
Attribute ("int[2] resolution", (32, 24))
Camera ("main")
World ()
Translate (0, 0, 3)
Shader ("surface", "constant")
Attribute ("color C", (0.25, 0.5, 1))
Sphere (1, -1, 1, 360)
Render ()
"#;

fn options() -> SessionOptions {
    SessionOptions { no_startup_files: true, ..SessionOptions::default() }
}

fn run(scene: &str, options: SessionOptions) -> (Outcome, Vec<String>) {
    let (reporter, kept) = Reporter::collecting();
    let mut session = Session::new(options, reporter, Default::default());
    let result = session.read_stream("<test>", Box::new(std::io::Cursor::new(scene.to_owned().into_bytes())));
    assert!(matches!(result, Ok(()) | Err(SessionError::Exit)), "{result:?}");
    let outcome = session.finish();
    let said = kept.lock().iter().map(ToString::to_string).collect();
    (outcome, said)
}

/// Returns the width and the height in pixels, and the channels of the middle pixel.
fn middle(path: &Path) -> (u32, u32, Vec<f32>) {
    let image = granita_plugin::bundled_formats(Limits::default()).open(path).unwrap();
    let spec = image.spec(0, 0).unwrap().clone();
    let pixels = image.read_level(0, 0).unwrap().to_floats();
    let n = spec.nchannels();
    let at = ((spec.height / 2) * spec.width + spec.width / 2) as usize * n;
    (spec.width, spec.height, pixels[at..at + n].to_vec())
}

fn scene(folder: &Path) -> (String, std::path::PathBuf) {
    let image = folder.join("image.tif");
    (SCENE.replace("IMAGE", image.to_str().unwrap()), image)
}

#[test]
fn a_scene_is_rendered_to_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let (text, image) = scene(folder.path());
    let (outcome, said) = run(&text, options());
    assert!(outcome.rendered && outcome.complete && outcome.errors == 0, "{said:?}");
    assert_eq!(outcome.images, std::slice::from_ref(&image));
    assert_eq!(middle(&image), (32, 24, vec![0.25, 0.5, 1.0, 1.0]));
}

#[test]
fn a_named_camera_is_rendered_alone_if_it_has_images() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let text = |named: &str| {
        let output = |name: &str, camera: &str, more: &str| {
            let data = if more.is_empty() { "rgba" } else { "z" };
            format!("Output (\"{}\", \"tiff\", \"{data}\", \"{camera}\"{more})\n", file(name).display())
        };
        let cameras = ["a", "b", "bare", "lamp"].map(|name| format!("Camera (\"{name}\")\n")).concat();
        let outputs = output("a.tif", "a", "") + &output("b.tif", "b", "");
        let lamp = output("lamp.tif", "lamp", ", \"int dynamic\", 1");
        format!(
            "Attribute (\"int[2] resolution\", (8, 8))\n{cameras}{outputs}{lamp}World ()\nTranslate (0, 0, 3)\n\
             Sphere (1, -1, 1, 360)\nRender ({named})\n"
        )
    };
    let (a, b) = (file("a.tif"), file("b.tif"));
    for (named, wanted) in [
        ("\"b\"", vec![b.clone()]),
        ("\"a\"", vec![a.clone()]),
        // Exporters name their main camera in passes in which it has no image, or no image that is a file.
        ("\"bare\"", vec![a.clone(), b.clone()]),
        ("\"lamp\"", vec![a.clone(), b.clone()]),
        ("", vec![a, b]),
    ] {
        let (outcome, said) = run(&text(named), options());
        assert_eq!(outcome.images, wanted, "Render ({named}): {said:?}");
    }
}

#[test]
fn extra_outputs_and_crops_of_the_options_are_applied() {
    let folder = tempfile::tempdir().unwrap();
    let (text, image) = scene(folder.path());
    let extra = folder.path().join("extra.png");
    let add = |name: &Path, data: &str| ExtraOutput {
        name: name.to_str().unwrap().to_owned(),
        format: None,
        data: data.to_owned(),
    };
    let more = SessionOptions {
        extra_outputs: vec![add(&extra, "rgba"), add(Path::new("x.nosuch"), "rgba")],
        crop: Some([0.25, 0.75, 0.25, 0.75]),
        ..options()
    };
    let (outcome, said) = run(&text, more);
    assert_eq!(outcome.images, [image.clone(), extra.clone()]);
    assert!(said.iter().any(|s| s.contains("nosuch")), "{said:?}");
    let (w, h, rgba) = middle(&image);
    assert_eq!((w, h, rgba[2]), (16, 12, 1.0));
    assert_eq!(middle(&extra).0, 16);

    // Without outputs of its own, the scene makes only the extra one.
    let plain = text.lines().filter(|l| !l.starts_with("Output")).collect::<Vec<_>>().join("\n");
    let only = SessionOptions { extra_outputs: vec![add(&extra, "first")], ..options() };
    let (outcome, said) = run(&plain, only);
    assert_eq!(outcome.images, [extra], "{said:?}");
}

#[test]
fn inputs_are_found_on_the_path_in_text_and_in_programs() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("ball.pyg"), "Sphere (1, -1, 1, 360)\n").unwrap();
    let (text, image) = scene(folder.path());
    for input in
        ["ball.pyg", "pyg ball.pyg", "pyg << Sphere (1, -1, 1, 360)", "pyg < echo 'Sphere (1, -1, 1, 360)'"]
    {
        let path = format!("Attribute (\"string path:input\", \"{}:&\")\n", folder.path().display());
        let text = path + &text.replace("Sphere (1, -1, 1, 360)", &format!("Input (\"{input}\")"));
        let (outcome, said) = run(&text, options());
        assert!(outcome.complete && outcome.errors == 0, "{input}: {said:?}");
        assert_eq!(middle(&image).2[3], 1.0, "{input}");
    }
    let (outcome, said) = run(&text.replace("Sphere (1, -1, 1, 360)", "Input (\"absent.pyg\")"), options());
    assert_eq!(outcome.errors, 1);
    assert!(said[0].contains("<test>:9") && said[0].contains("absent.pyg"), "{said:?}");
}

#[test]
fn users_shaders_come_before_bundled_ones() {
    let folder = tempfile::tempdir().unwrap();
    let source = "surface constant () { C = color (1, 0, 0); }";
    std::fs::write(folder.path().join("constant.gsl"), source).unwrap();
    let (text, image) = scene(folder.path());
    let path = format!("Attribute (\"string path:shader\", \"{}\")\n", folder.path().display());
    let (_, said) = run(&(path.clone() + &text), options());
    assert_eq!(middle(&image).2, [1.0, 0.0, 0.0, 1.0], "{said:?}");

    let blue = "surface constant () { C = color (0, 0, 1); }";
    let module = granita_gsl::compile(blue, "constant.gsl", &Default::default()).unwrap().module;
    std::fs::write(folder.path().join("constant.gso"), granita_gsl::gso::write(&module, false)).unwrap();
    let (_, said) = run(&(path + &text), options());
    assert_eq!(middle(&image).2, [0.0, 0.0, 1.0, 1.0], "{said:?}");

    let (outcome, said) = run(&text.replace("\"constant\"", "\"nosuchshader\""), options());
    assert!(outcome.complete && said.iter().any(|s| s.contains("nosuchshader")), "{said:?}");
}

#[test]
fn startup_files_come_first_and_missing_scenes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(".gelato.pyg"), "Attribute (\"int[2] resolution\", (8, 8))\n").unwrap();
    let (text, image) = scene(folder.path());
    let text = text.replace("Attribute (\"int[2] resolution\", (32, 24))\n", "");
    let mut environment = Environment::empty();
    environment.set("HOME", folder.path().to_str().unwrap());
    let run_options = RunOptions { environment, ..RunOptions::default() };
    let with_startup = SessionOptions { run: run_options, ..SessionOptions::default() };
    run(&text, with_startup);
    assert_eq!(middle(&image).0, 8);

    let mut session = Session::new(options(), Reporter::silent(), Default::default());
    let error = session.read_file("nosuchscene.pyg").unwrap_err();
    assert!(matches!(error, SessionError::Missing { .. }));
    assert!(error.to_string().contains("nosuchscene.pyg"));
    assert!(!session.finish().rendered);
}

#[test]
fn the_exit_command_ends_a_scene_before_render() {
    let folder = tempfile::tempdir().unwrap();
    let (text, image) = scene(folder.path());
    let (outcome, _) = run(&text.replace("Render ()", "Command (\"exit\")\nRender ()"), options());
    assert!(!outcome.rendered && !image.exists());
}

#[test]
fn a_shadow_pass_writes_a_shadow_map() {
    let folder = tempfile::tempdir().unwrap();
    let map = folder.path().join("shadow.sm");
    let text = format!(
        r#"
Output ("{}", "shadow", "z", "main")
Attribute ("int[2] resolution", (64, 64))
Camera ("main")
World ()
Translate (0, 0, 3)
Sphere (1, -1, 1, 360)
Render ()
"#,
        map.display()
    );
    let (outcome, said) = run(&text, options());
    assert!(outcome.complete && outcome.errors == 0, "{said:?}");
    let (w, _, z) = middle(&map);
    assert_eq!(w, 64);
    assert!((z[0] - 2.0).abs() < 0.01, "{z:?}");
    let image = granita_plugin::bundled_formats(Limits::default()).open(&map).unwrap();
    let spec = image.spec(0, 0).unwrap();
    assert!(spec.is_tiled());
    let clip = granita_base::Transform::from_rows(&spec.matrix("worldtoscreen").unwrap());
    let p = clip.point(granita_base::Vec3::new(2.0, -1.0, 2.0));
    assert!((p.x - 1.0).abs() < 1e-5 && (p.y + 0.5).abs() < 1e-5, "{p}");
}

#[test]
fn shading_systems_bypass_the_scenes_shaders() {
    let folder = tempfile::tempdir().unwrap();
    let (text, image) = scene(folder.path());
    // Neither the surface nor the light exists, and neither is requested.
    let text = text
        .replace("\"constant\"", "\"nosuchshader\"")
        .replace("World ()", "World ()\nLight (\"a\", \"nosuchlight\")");
    let mut means = Vec::new();
    for name in ["defaultsurface", "keyfillrim"] {
        let by_option = SessionOptions { shadertype: Some(name.to_owned()), ..options() };
        let (outcome, said) = run(&text, by_option);
        assert!(outcome.complete && said.is_empty(), "{said:?}");
        let rgba = middle(&image).2;
        assert!(
            rgba[0] > 0.05 && rgba[3] == 1.0 && (rgba[2] / rgba[0] - 4.0).abs() < 0.9,
            "{name}: {rgba:?}"
        );
        // An attribute in the scene has the same effect.
        let by_attribute = format!("Attribute (\"string shadertype\", \"{name}\")\n{text}");
        run(&by_attribute, options());
        assert_eq!(middle(&image).2, rgba);
        means.push(rgba);
    }
    assert_ne!(means[0], means[1]);
}

#[test]
fn every_command_runs() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let text = format!(
        r#"
Command ("mkdir", "string name", "{0}")
Command ("system", "string[2] command", ("touch", "{1}"), "int wait", 1)
Command ("system test -f {1}")
Command ("unlink", "string name", "{1}")
Command ("fileread", "string name", "some file")
Command ("wait", "float time", 1)
Command ("bucketpriority", "int[2] center", (10, 10))
Command ("bucketpriority", "int[4] rectangle", (0, 0, 10, 10))
Command ("return")
Command ("exit")
Command ("never reached")
"#,
        at("made"),
        at("touched")
    );
    let (outcome, said) = run(&text, options());
    assert!(said.is_empty() && outcome.errors == 0, "{said:?}");
    assert!(folder.path().join("made").is_dir() && !folder.path().join("touched").exists());
    let (_, said) = run("Command (\"mkdirr\")", options());
    assert!(said[0].contains("unknown command \"mkdirr\"; did you mean \"mkdir\"?"), "{said:?}");
}

/// The files of a command line count as one that contains them all. Each `Input` is a scene of its own (reference 6.1).
#[test]
fn files_share_the_variables_of_their_scripts() {
    if !granita_needs::has("python3") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let (text, image) = scene(folder.path());
    let inner = file("inner.pyg", "Attribute (\"color C\", (v, v, v))\n");
    let settings = file("settings.pyg", &format!("v = 0.5\ninner = '{inner}'\n"));
    let text = text.replace("(0.25, 0.5, 1)", "(v / 2, v, v * 2)");
    let main = file("main.pyg", &text.replace("Sphere", "Input (inner)\nSphere"));
    let (reporter, kept) = Reporter::collecting();
    let mut session = Session::new(options(), reporter, Default::default());
    session.read_file(&settings).unwrap();
    session.read_file(&main).unwrap();
    assert!(session.finish().rendered);
    assert_eq!(middle(&image), (32, 24, vec![0.25, 0.5, 1.0, 1.0]));
    let said: Vec<String> = kept.lock().iter().map(ToString::to_string).collect();
    assert!(said.len() == 1 && said[0].contains("inner.pyg:1: error: NameError"), "{said:?}");
}

#[test]
fn temporary_files_are_in_the_folder_of_the_variable() {
    let folder = tempfile::tempdir().unwrap();
    let place = |value: Option<&Path>, safe: bool| {
        let mut environment = Environment::empty();
        if let Some(value) = value {
            environment.set("GELATOTEMP", value.to_str().unwrap());
        }
        let (reporter, kept) = Reporter::collecting();
        let run = RunOptions { environment, safe, ..RunOptions::default() };
        let options = SessionOptions { run, ..options() };
        let session = Session::new(options, reporter, Default::default());
        assert_eq!(session.files().is_confined(), safe);
        (session.files().temporary_folder(), kept.lock().len())
    };
    let system = std::env::temp_dir();
    assert_eq!(place(None, false), (system.clone(), 0));
    for safe in [false, true] {
        assert_eq!(place(Some(folder.path()), safe), (folder.path().to_owned(), 0));
    }
    // A folder that does not exist is reported, and is not made.
    let missing = folder.path().join("missing");
    assert_eq!(place(Some(&missing), false), (system, 1));
    assert!(!missing.exists());
}

/// A stream that keeps what is written.
struct Kept(Sender<Vec<u8>>);

impl std::io::Write for Kept {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let _ = self.0.send(bytes.to_vec());
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// The kinds and the payloads of frames.
type Frames = Vec<(u8, Vec<u8>)>;

fn frames(kept: &Receiver<Vec<u8>>) -> Frames {
    let bytes = kept.try_iter().collect::<Vec<_>>().concat();
    let mut rest = &bytes[..];
    std::iter::from_fn(|| (!rest.is_empty()).then(|| receive(&mut rest).unwrap())).collect()
}

/// Returns a request for an image: its file, its number and its level, and whether its pixels are sent.
fn reading(path: &Path, image: u32, level: u32, pixels: bool) -> Vec<u8> {
    let mut request = [image.to_le_bytes(), level.to_le_bytes()].concat();
    request.push(u8::from(pixels));
    put_text(path.to_str().unwrap(), &mut request);
    framed(b'I', &[&request]).unwrap()
}

/// Executes frames of a program. Returns what it receives, and the result.
fn served(input: &[u8]) -> (Frames, Result<(), SessionError>, Outcome) {
    let (sender, kept) = channel();
    let connection = Connection::new(Box::new(Kept(sender)));
    let mut session = Session::new(options(), connection.reporter(), Default::default());
    let result = session.serve(&mut &input[..], &connection);
    let outcome = session.finish();
    (frames(&kept), result, outcome)
}

#[test]
fn a_program_receives_the_images_of_a_frame() {
    let folder = tempfile::tempdir().unwrap();
    let (text, image) = scene(folder.path());
    let calls = text.replace("Render ()", "");
    let mut request = 9u32.to_le_bytes().to_vec();
    put_text("main", &mut request);
    request.extend(2u32.to_le_bytes());
    ["rgba", "z"].iter().for_each(|data| put_text(data, &mut request));
    let input = [
        framed(b'T', &[calls.as_bytes()]).unwrap(),
        framed(b'V', &[&request]).unwrap(),
        reading(&image, 0, 0, true),
        reading(&image, 0, 1, true),
        reading(&image, 1, 0, true),
        reading(&folder.path().join("absent.exr"), 0, 0, false),
    ];
    let (sent, result, outcome) = served(&input.concat());
    assert!(result.is_ok() && outcome.complete, "{result:?}");
    let kinds: String = sent.iter().map(|(kind, _)| *kind as char).collect();
    assert_eq!(kinds, "OSLOSLVOSLIIII");
    // The pixels in the middle, and those of the file.
    let pixels = |at: usize| {
        let floats = sent[at].1[4..].as_chunks().0.iter().map(|b| f32::from_le_bytes(*b));
        floats.collect::<Vec<f32>>()
    };
    let at = (12 * 32 + 16) * 4;
    assert_eq!(pixels(1)[at..at + 4], [0.25, 0.5, 1.0, 1.0]);
    assert_eq!(pixels(1), pixels(8));
    assert_eq!(sent[6].1, 0u32.to_le_bytes());
    // The addresses are those of the request.
    for (at, address) in [(0, "0x1"), (3, "0x2"), (7, "0x0")] {
        let mut frame = Frame(&sent[at].1);
        assert_eq!((frame.word().is_some(), frame.text().as_deref()), (true, Some(address)));
    }
    assert_eq!(sent[10].1[0], 1);
    for (at, error) in [(11, "has no level 1"), (12, "there is no image 1"), (13, "absent.exr")] {
        let mut frame = Frame(&sent[at].1);
        assert_eq!(frame.array(), Some([0]));
        let text = frame.text().unwrap();
        assert!(text.contains(error), "{text}");
    }
}

#[test]
fn requests_that_make_no_sense_end_the_stream() {
    for (kind, payload) in [(b'V', &b""[..]), (b'V', &[0; 11]), (b'I', &[0; 8]), (b'Y', b"")] {
        let (sent, result, _) = served(&framed(kind, &[payload]).unwrap());
        let error = result.unwrap_err().to_string();
        assert!(sent.is_empty() && error.contains("malformed"), "{error}");
    }
    // A frame before World is an error of the scene.
    let mut request = 9u32.to_le_bytes().to_vec();
    put_text("", &mut request);
    request.extend(0u32.to_le_bytes());
    let (sent, result, _) = served(&framed(b'V', &[&request]).unwrap());
    assert!(result.is_ok());
    let mut message = Frame(&sent[0].1);
    assert_eq!((sent[0].0, message.word(), message.word()), (b'M', Some(2048), Some(9)));
    assert_eq!(sent[1], (b'V', 1u32.to_le_bytes().to_vec()));
}
