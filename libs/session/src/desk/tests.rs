//! Tests of edits, of the calls that they become, and of patches, with a viewer that only reads.

use super::*;
use crate::patches::is_patch;
use crate::{Session, SessionOptions};
use granita_base::report::Message;
use granita_base::{Reporter, Vec3};
use granita_image::Limits;
use serde_json::{Value, json};
use std::io::Read;
use std::net::TcpListener;
use std::sync::atomic::AtomicBool;
use tempfile::TempDir;

const SCENE: &str = r#"
Attribute ("int[2] resolution", (48, 36))
Attribute ("int[2] limits:bucketsize", (16, 16))
Attribute ("int[2] spatialquality", (3, 3))
Output ("IMAGE", "tiff", "rgba", "main", "int[4] quantize", (0, 0, 0, 0), "float dither", 0)
Translate (0, 1.9, -6)
Rotate (20, 1, 0, 0)
Camera ("main", "float fov", 40)
World ()
Attribute ("string name", "rig")
Attribute ("float shadow:bias", 0.02)
PushAttributes ()
Attribute ("string name", "lamps")
Attribute ("float shadow:bias", 0.005)
Translate (-2, 3, -2)
Rotate (40, 1, 0, 0)
Light ("key", "spotlight", "float intensity", 12, "float coneangle", 0.9, "string shadowname", "all")
PopAttributes ()
PushAttributes ()
ShaderGroupBegin ()
Translate (3, 2, -1)
Light ("fill", "pointlight", "base", "float intensity", 4)
Translate (0, 1, 0)
Light ("fill", "pointlight", "top", "float intensity", 2, "color lightcolor", (1, 0.5, 0.25))
ShaderGroupEnd ()
PopAttributes ()
LightSwitch ("key", 1)
LightSwitch ("fill", 1)
Light ("ambience", "ambientlight", "float intensity", 0.05)
Attribute ("string geometryset", "+all")
Shader ("surface", "plastic")
PushAttributes ()
Attribute ("string name", "ball")
Sphere (1, -1, 1, 360)
PopAttributes ()
PushAttributes ()
LightSwitch ("fill", 0)
Translate (1.6, 0, 0.5)
Sphere (0.5, -0.5, 0.5, 360)
PopAttributes ()
Attribute ("string name", "floor")
Patch ("linear", 2, 2, "P", (-4, -1, 4, 4, -1, 4, -4, -1, -4, 4, -1, -4))
Render ()
"#;

type Kept = Arc<Mutex<Vec<Message>>>;

/// A desk of a scene, in a folder of its own.
struct Fixture {
    folder: TempDir,
    session: Session,
    desk: Desk,
    kept: Kept,
}

fn session() -> (Session, Kept) {
    let (reporter, kept) = Reporter::collecting();
    let options = SessionOptions { no_startup_files: true, default_threads: 2, ..SessionOptions::default() };
    (Session::new(options, reporter, Default::default()), kept)
}

/// Starts a viewer that reads everything and answers nothing. Returns its address.
fn viewer() -> String {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = server.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        for socket in server.incoming() {
            let mut socket = socket.unwrap();
            std::thread::spawn(move || socket.read_to_end(&mut Vec::new()));
        }
    });
    address
}

impl Fixture {
    fn new() -> Self {
        Self::sized([48, 36])
    }

    /// Returns the desk of an image of this width and height.
    fn sized([width, height]: [u32; 2]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let text = SCENE.replace("IMAGE", folder.path().join("image.tif").to_str().unwrap());
        let text = text.replace("(48, 36)", &format!("({width}, {height})"));
        let scene = folder.path().join("scene.pyg");
        std::fs::write(&scene, text).unwrap();
        let (mut session, kept) = session();
        let options = DeskOptions {
            name: "scene.pyg".to_owned(),
            address: viewer(),
            data: "rgba".to_owned(),
            file: "scene.lights.pyg".to_owned(),
        };
        let mut desk = Desk::prepare(&mut session, &options).unwrap();
        session.read_file(scene.to_str().unwrap()).unwrap();
        desk.start(&session).unwrap();
        Self { folder, session, desk, kept }
    }

    fn edit(&mut self, edit: Value) {
        self.desk.screen.push_edit(edit.to_string());
        self.desk.turn(&mut self.session).unwrap();
    }

    /// Renders until the image shows the lights. Returns its pixels.
    fn image(&mut self) -> Vec<f32> {
        while self.desk.next_frame().is_some() {
            self.desk.turn(&mut self.session).unwrap();
        }
        self.desk.screen.color().values
    }

    fn error(&self) -> Option<&str> {
        self.desk.message.as_ref().filter(|(_, is_error)| *is_error).map(|(text, _)| &**text)
    }

    /// Returns the pixels of the scene with the patch of the desk, as files of a run of their own.
    fn patched(&self) -> Vec<f32> {
        let world = self.desk.checkpoint.as_ref().unwrap().world_values();
        let text = patch::text(&self.desk.base, &self.desk.rig, world, &["scene.pyg".to_owned()]).unwrap();
        let files = ["scene.pyg", "patch.pyg"].map(|name| self.folder.path().join(name));
        std::fs::write(&files[1], text).unwrap();
        let names = files.map(|file| file.to_str().unwrap().to_owned());
        let (mut session, kept) = session();
        session.expect_files(&names).unwrap();
        names.iter().for_each(|name| session.read_file(name).unwrap());
        let outcome = session.finish();
        let said: Vec<String> = kept.lock().iter().map(ToString::to_string).collect();
        assert!(outcome.complete && outcome.errors == 0 && outcome.warnings == 0, "{said:?}");
        assert_eq!(outcome.frames.len(), 1, "the Render of the scene is left out");
        let formats = granita_plugin::bundled_formats(Limits::default());
        formats.open(&outcome.images[0]).unwrap().read_level(0, 0).unwrap().to_floats()
    }

    /// Checks that the image is that of the patch, to the bit, and returns it.
    fn checked(&mut self, what: &str) -> Vec<f32> {
        let (image, patched) = (self.image(), self.patched());
        let differ = image.iter().zip(&patched).filter(|(a, b)| a.to_bits() != b.to_bits()).count();
        assert_eq!((image.len(), differ), (patched.len(), 0), "{what}");
        let said: Vec<String> = self.kept.lock().iter().map(ToString::to_string).collect();
        assert_eq!((self.error(), said), (None, Vec::new()), "{what}");
        image
    }
}

#[test]
fn images_are_those_of_the_scene_with_the_patch() {
    let mut f = Fixture::new();
    let first = f.checked("no edit");
    assert!(first.iter().any(|v| *v > 0.2));
    let mut before = first.clone();
    for edit in [
        json!({"do": "set", "light": "key", "layer": 0, "param": "intensity", "value": 20}),
        json!({"do": "set", "light": "fill", "layer": 1, "param": "lightcolor", "value": [0.2, 1, 0.3]}),
        json!({"do": "aim", "light": "key", "at": [30, 24]}),
        json!({"do": "place", "light": "key", "at": [30, 4]}),
        json!({"do": "distance", "light": "key", "value": 0.8}),
        json!({"do": "position", "light": "fill", "value": [-3, 2, 0]}),
        json!({"do": "direction", "light": "key", "value": [10, -70]}),
        json!({"do": "link", "light": "key", "pattern": "^ball$", "value": false}),
        json!({"do": "link", "light": "fill", "pattern": "", "value": true}),
        json!({"do": "add", "shader": "spotlight"}),
        json!({"do": "copy", "light": "spotlight"}),
        json!({"do": "solo", "light": "fill", "value": true}),
        json!({"do": "solo", "light": "fill", "value": false}),
        json!({"do": "unlink", "light": "key", "index": 0}),
        json!({"do": "on", "light": "key", "value": false}),
        json!({"do": "shader", "light": "spotlight2", "layer": 0, "value": "distantlight"}),
        json!({"do": "delete", "light": "fill"}),
        json!({"do": "restore", "light": "fill"}),
        json!({"do": "restore", "light": "key"}),
        json!({"do": "reset", "light": "spotlight", "layer": 0, "param": "intensity"}),
    ] {
        f.edit(edit.clone());
        let image = f.checked(&edit.to_string());
        assert!(image != before, "{edit} changes the image");
        before = image;
    }
    // All edits are undone, and done again.
    let last = f.desk.rig.clone();
    for _ in 0..20 {
        f.edit(json!({"do": "undo"}));
    }
    assert_eq!(f.desk.rig, f.desk.base);
    assert!(f.image() == first);
    f.edit(json!({"do": "undo"}));
    assert_eq!(f.error(), Some("nothing to undo"));
    for _ in 0..20 {
        f.edit(json!({"do": "redo"}));
    }
    assert_eq!(f.desk.rig, last);
    assert!(f.image() == before);
    // The files of the scene were written once, by its own Render.
    assert_eq!(f.session.frames().len(), 1);
}

#[test]
fn a_drag_is_coarse_in_the_visible_part_and_one_step() {
    let mut f = Fixture::new();
    let first = f.image();
    let visible = json!([8, 4, 20, 16]);
    f.edit(json!({"do": "begin", "visible": visible}));
    for value in [30, 40] {
        f.edit(
            json!({"do": "set", "light": "key", "param": "intensity", "value": value, "visible": visible}),
        );
        assert_eq!(
            f.desk.next_frame(),
            Some(DeskFrame { coarse: true, crop: f.desk.crop(PixelRect::at(8, 4, 20, 16)) })
        );
        // The image before the drag is sent after the first image of the drag.
        assert_eq!(f.desk.has_before, value == 40);
        f.image();
        assert!(f.desk.has_before);
    }
    let coarse = f.image();
    let changed: Vec<[usize; 2]> = (0..48 * 36)
        .filter(|k| first[k * 4..k * 4 + 4] != coarse[k * 4..k * 4 + 4])
        .map(|k| [k % 48, k / 48])
        .collect();
    assert!(changed.len() > 100 && changed.iter().all(|[x, y]| (8..28).contains(x) && (4..20).contains(y)));
    f.edit(json!({"do": "end", "visible": visible}));
    assert_eq!(f.desk.next_frame(), Some(DeskFrame::default()));
    let last = f.checked("the end of a drag");
    assert!(last != coarse && last != first);
    // The image before is the one before the drag.
    assert!(f.desk.has_before);
    f.edit(json!({"do": "undo"}));
    assert!(f.checked("undo") == first);
    assert_eq!(f.desk.history.redo_label(), Some("key: intensity"));
}

#[test]
fn a_drag_of_a_large_image_shows_fewer_pixels_enlarged() {
    let mut f = Fixture::sized([400, 300]);
    let first = f.image();
    f.desk.turn(&mut f.session).unwrap();
    assert!(f.image() == first, "a drag is prepared unseen");
    let visible = PixelRect::at(40, 50, 201, 151);
    f.edit(json!({"do": "begin", "visible": [40, 50, 201, 151]}));
    f.edit(json!({"do": "set", "light": "key", "param": "intensity", "value": 40}));
    let coarse = f.image();
    let pixel = |image: &[f32], x: i32, y: i32| {
        let at = 4 * (y * 400 + x) as usize;
        image[at..at + 4].to_vec()
    };
    let (mut same, mut changed) = (true, 0);
    for (x, y) in (0..300).flat_map(|y| (0..400).map(move |x| (x, y))) {
        let now = pixel(&coarse, x, y);
        if visible.contains(&PixelRect::at(x, y, 1, 1)) {
            changed += usize::from(now != pixel(&first, x, y));
            let (left, above) = ((x / 2 * 2).max(40), (y / 2 * 2).max(50));
            same &= now == pixel(&coarse, left, above);
        } else {
            assert!(now == pixel(&first, x, y), "{x} {y} is not visible");
        }
    }
    assert!(same && changed > 10_000, "{changed}");
    f.edit(json!({"do": "end", "visible": [40, 50, 201, 151]}));
    f.checked("the end of a drag");
}

#[test]
fn drags_are_prepared_without_a_change_of_the_image() {
    let mut f = Fixture::new();
    let first = f.checked("no edit");
    assert_eq!(f.desk.prepared, None);
    f.desk.turn(&mut f.session).unwrap();
    assert_eq!(f.desk.prepared, Some(None));
    assert!(f.desk.screen.is_complete() && f.desk.next_frame().is_none());
    assert!(f.checked("prepared") == first);
    f.edit(json!({"do": "begin"}));
    f.edit(json!({"do": "set", "light": "key", "param": "intensity", "value": 40}));
    let coarse = f.image();
    // The same drag without the preparation.
    let mut g = Fixture::new();
    g.edit(json!({"do": "begin"}));
    g.edit(json!({"do": "set", "light": "key", "param": "intensity", "value": 40}));
    assert!(g.image() == coarse && coarse != first);
    f.edit(json!({"do": "end"}));
    f.checked("the end of the drag");
}

#[test]
fn a_drag_does_not_stop_its_preparation() {
    let mut f = Fixture::new();
    f.image();
    let (running, ends) = (f.desk.running.clone(), AtomicBool::new(false));
    let set = r#"{"do":"set","light":"key","param":"intensity","value":2}"#;
    let is_kept = std::thread::scope(|scope| {
        let watch = scope.spawn(|| {
            while interrupts(set, &running.lock()) {
                if ends.load(Ordering::Relaxed) {
                    return false;
                }
            }
            true
        });
        // A busy machine may run the other thread only between the preparations.
        for _ in 0..200 {
            f.desk.prepared = None;
            f.desk.turn(&mut f.session).unwrap();
            assert_eq!((f.desk.prepared, f.desk.status), (Some(None), Status::Idle));
            assert!(interrupts(set, &running.lock()), "the preparation has ended");
            if watch.is_finished() {
                break;
            }
        }
        ends.store(true, Ordering::Relaxed);
        watch.join().unwrap()
    });
    assert!(is_kept);
}

#[test]
fn edits_of_a_drag_do_not_stop_its_coarse_frame_at_once() {
    let set = r#"{"do":"set","light":"key","param":"intensity","value":2}"#;
    let now = Instant::now();
    for (until, stops) in [(None, true), (Some(now), true), (Some(now + FIRST_COARSE), false)] {
        // The clock may not have advanced since.
        std::thread::sleep(Duration::from_millis(2));
        let running = Running { coarse_until: until };
        assert_eq!(interrupts(set, &running), stops);
        assert!(interrupts(r#"{"do":"end"}"#, &running) && interrupts(r#"{"do":"undo"}"#, &running));
        assert!(!interrupts(r#"{"do":"begin"}"#, &running) && !interrupts("no edit", &running));
    }
}

#[test]
fn the_panel_reports_the_last_edit_that_the_image_shows() {
    let mut f = Fixture::new();
    let image = |f: &Fixture| {
        let state: Value = serde_json::from_str(&f.desk.screen.part("state")).unwrap();
        state["image"].clone()
    };
    assert_eq!(image(&f), json!({"edit": null, "coarse": false}));
    f.edit(json!({"do": "begin", "number": 1}));
    assert_eq!(image(&f), json!({"edit": 1, "coarse": false}), "it changes nothing");
    f.edit(json!({"do": "set", "light": "key", "param": "intensity", "value": 30, "number": 2}));
    f.edit(json!({"do": "set", "light": "key", "param": "intensity", "value": 40, "number": 3}));
    assert_eq!(image(&f), json!({"edit": 1, "coarse": false}), "it is not rendered yet");
    f.image();
    assert_eq!(image(&f), json!({"edit": 3, "coarse": true}));
    f.edit(json!({"do": "end", "number": 4}));
    assert_eq!(image(&f), json!({"edit": 3, "coarse": true}));
    f.image();
    assert_eq!(image(&f), json!({"edit": 4, "coarse": false}));
    // An edit without a number leaves the number of the one before.
    f.edit(json!({"do": "on", "light": "key", "value": false}));
    f.image();
    assert_eq!(image(&f), json!({"edit": 4, "coarse": false}));
}

#[test]
fn wrong_edits_are_messages_and_change_nothing() {
    let mut f = Fixture::new();
    for (edit, message) in [
        (
            json!({"do": "on", "light": "kee", "value": true}),
            "there is no light \"kee\"; did you mean \"key\"?",
        ),
        (
            json!({"do": "set", "light": "key", "param": "intensty", "value": 1}),
            "has no parameter \"intensty\"; did you mean \"intensity\"?",
        ),
        (
            json!({"do": "set", "light": "key", "param": "intensity", "value": "much"}),
            "\"intensity\" is a float, and \"much\" is not",
        ),
        (
            json!({"do": "set", "light": "key", "param": "intensity", "value": -1}),
            "\"intensity\" is at least 0, and -1 is not",
        ),
        (json!({"do": "set", "light": "key", "param": "from", "value": [1, 2]}), "is a point"),
        (json!({"do": "set", "light": "key", "layer": 3, "param": "from", "value": [1, 2, 3]}), "no layer 3"),
        (json!({"do": "link", "light": "key", "pattern": "[", "value": true}), "regular expression"),
        (json!({"do": "add", "shader": "plastic"}), "\"plastic\" is a surface shader, not a light"),
        (json!({"do": "add", "shader": "nosuch"}), "there is no shader \"nosuch\""),
        (json!({"do": "shader", "light": "key", "value": "nosuch"}), "there is no shader \"nosuch\""),
        (json!({"do": "add", "shader": "spotlight", "light": "key"}), "there is a light \"key\" already"),
        (json!({"do": "place", "light": "ambience", "at": [1, 1]}), "is ambient"),
        (json!({"do": "aim", "light": "key", "at": [1, 0]}), "no surface"),
        (json!({"do": "save", "file": "../a.pyg"}), "without a folder"),
        (json!({"do": "save", "file": "a.txt"}), "ends in .pyg"),
        (json!({"do": "dance"}), "not an edit"),
    ] {
        f.edit(edit.clone());
        assert!(f.error().is_some_and(|text| text.contains(message)), "{edit}: {:?}", f.error());
        assert!(f.desk.rig == f.desk.base && f.desk.next_frame().is_none(), "{edit}");
    }
    // A shader that does not compile.
    let broken = f.folder.path().join("broken.gsl");
    std::fs::write(&broken, "light broken () { Cl = nothing; }").unwrap();
    f.edit(json!({"do": "add", "shader": broken.with_extension("").to_str().unwrap()}));
    assert!(f.error().is_some_and(|text| text.contains("cannot be used")), "{:?}", f.error());
}

#[test]
fn a_patch_holds_what_differs() {
    let mut f = Fixture::new();
    let text = |f: &Fixture| {
        let world = f.desk.checkpoint.as_ref().unwrap().world_values();
        let text = patch::text(&f.desk.base, &f.desk.rig, world, &["a.pyg".to_owned()]).unwrap();
        String::from_utf8(text).unwrap()
    };
    let begin = "# Patch of the lights of a scene\n# gelato a.pyg THIS\nWorld ()\n";
    assert_eq!(text(&f), format!("{begin}Render ()\n"));
    f.edit(json!({"do": "set", "light": "ambience", "param": "intensity", "value": 0.5}));
    f.edit(json!({"do": "link", "light": "key", "pattern": "^ball$", "value": false}));
    f.edit(json!({"do": "delete", "light": "fill"}));
    let expected = r#"Light ("fill", "null")
PushAttributes ()
Modify ("^ball$")
LightSwitch ("key", 0)
PopAttributes ()
PushAttributes ()
Attribute ("float shadow:bias", 0.02)
Attribute ("string name", "rig")
SetTransform ((1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1))
Light ("ambience", "ambientlight", "float intensity", 0.5)
PopAttributes ()
Render ()
"#;
    assert_eq!(text(&f), format!("{begin}{expected}"));
}

#[test]
fn only_patches_are_replaced() {
    let folder = tempfile::tempdir().unwrap();
    let files = granita_base::Files::default();
    let (old, new) = (folder.path().join("scene.pyg"), folder.path().join("new.pyg"));
    std::fs::write(&old, "World ()\n").unwrap();
    let text = patch::text(&Rig::default(), &Rig::default(), &Default::default(), &[]).unwrap();
    assert!(patch::write(&files, &old, &text).unwrap_err().contains("another file"));
    assert_eq!(std::fs::read(&old).unwrap(), b"World ()\n");
    for _ in 0..2 {
        patch::write(&files, &new, &text).unwrap();
        assert!(is_patch(&files, &new) && !is_patch(&files, &old));
    }
}

#[test]
fn the_panel_describes_lights_objects_and_shaders() {
    let mut f = Fixture::new();
    f.desk.show_objects(&f.session);
    f.desk.show_panel(&f.session);
    let parts = f.desk.screen.parts();
    assert_eq!(parts, ["desk", "light/ambience", "light/fill", "light/key", "objects", "state"]);
    let lamp = f.desk.rig.lamp("key").unwrap().clone();
    let light = f.desk.light(&lamp);
    assert_eq!(
        (&light["emission"], &light["on"], &light["lit"]),
        (&json!("position"), &json!(true), &json!(true))
    );
    let param = |name: &str| {
        let params = light["layers"][0]["params"].as_array().unwrap();
        params.iter().find(|p| p["name"] == name).unwrap().clone()
    };
    let intensity = param("intensity");
    assert_eq!(intensity["value"], json!(12.0));
    assert_eq!(
        (&intensity["default"], &intensity["min"], &intensity["set"]),
        (&json!(1.0), &json!(0.0), &json!(true))
    );
    assert_eq!(param("lightcolor")["value"], json!([1.0, 1.0, 1.0]));
    assert_eq!(param("shadowname")["widget"], "shadow");
    // The light is at its place in the image.
    let at: Vec<f32> = light["at"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap() as f32).collect();
    let eye = f.desk.eye.clone().unwrap();
    let position = f.desk.frame(&lamp).unwrap().1;
    assert!((position - Vec3::new(-2.0, 3.0, -2.0)).length() < 1.0e-5, "{position}");
    let [x, y, depth] = eye.project(position).unwrap();
    assert_eq!(at, [x, y, depth]);
}
