//! Tests of `gelato -relight`, with a viewer in the test in the place of `iv`.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use granita_display::{Client, Ending, Listener, Packet, ServerLimits, Sink};
use granita_image::Limits;
use parking_lot::{Condvar, Mutex};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

const SCENE: &str = r#"
Attribute ("int[2] resolution", (48, 32))
Attribute ("int[2] limits:bucketsize", (16, 16))
Output ("out.tif", "tiff", "rgba", "main", "int[4] quantize", (0, 0, 0, 0), "float dither", 0)
Camera ("main", "float fov", 40)
World ()
Translate (0, 0, 4)
PushTransform ()
Translate (-2, 2, -2)
Light ("key", "pointlight", "float intensity", 6)
PopTransform ()
Attribute ("string name", "ball")
Shader ("surface", "plastic")
Sphere (1, -1, 1, 360)
Render ()
"#;

const PATIENCE: Duration = Duration::from_secs(60);

/// The image, the panel and the client, as packets make them.
#[derive(Default)]
struct Seen {
    client: Option<Arc<Client>>,
    panel: BTreeMap<String, Value>,
    pixels: Vec<f32>,
    names: Vec<String>,
    /// The number of coarse frames that were reported.
    coarse_frames: usize,
    /// The number of edits that were sent. It is also the number of the last of them.
    edits: u64,
}

#[derive(Default)]
struct Viewer {
    seen: Mutex<Seen>,
    changed: Condvar,
}

impl Sink for Viewer {
    fn packet(&self, client: &Arc<Client>, packet: Packet) -> Result<(), String> {
        let mut seen = self.seen.lock();
        match packet {
            Packet::CreateImage { name, width, height, channels, .. } => {
                if seen.names.is_empty() {
                    seen.pixels = vec![f32::NAN; width as usize * height as usize * channels.len()];
                }
                seen.names.push(name);
            }
            Packet::UpdateImage { name, rect, values, channels, .. } if seen.names.first() == Some(&name) => {
                for k in 0..rect.width() * rect.height() {
                    let (x, y) = (rect.x0 as usize + k % rect.width(), rect.y0 as usize + k / rect.width());
                    for (c, channel) in channels.iter().enumerate() {
                        let value = values[channel.offset as usize + k * channel.stride as usize];
                        seen.pixels[(y * 48 + x) * 4 + c] = value;
                    }
                }
            }
            Packet::Panel { part, text, .. } => {
                let value: Value = serde_json::from_str(&text).unwrap_or(Value::Null);
                seen.coarse_frames += usize::from(value["status"] == "coarse");
                seen.panel.insert(part, value);
            }
            _ => (),
        }
        seen.client = Some(client.clone());
        drop(seen);
        self.changed.notify_all();
        Ok(())
    }

    fn trouble(&self, _: &Client, what: &str) {
        panic!("{what}");
    }

    fn gone(&self, _: &Client, ending: &Ending) {
        assert_eq!(*ending, Ending::Closed);
    }
}

impl Viewer {
    fn send(&self, mut edit: Value) {
        let mut seen = self.seen.lock();
        let client = seen.client.clone().unwrap();
        seen.edits += 1;
        edit["number"] = json!(seen.edits);
        drop(seen);
        assert!(client.send(Packet::Edit { name: "scene.pyg".to_owned(), text: edit.to_string() }));
    }

    /// Waits until a condition holds. Returns its value.
    fn until<T>(&self, what: &str, condition: impl Fn(&Seen) -> Option<T>) -> T {
        let end = Instant::now() + PATIENCE;
        let mut seen = self.seen.lock();
        loop {
            if let Some(found) = condition(&seen) {
                return found;
            }
            assert!(!self.changed.wait_until(&mut seen, end).timed_out(), "{what}: {:?}", seen.panel);
        }
    }

    /// Waits until the final image shows all edits that were sent.
    fn shows_edits(&self, what: &str) {
        self.until(what, |seen| {
            let image = &seen.panel.get("state")?["image"];
            (image["edit"] == seen.edits && image["coarse"] == false).then_some(())
        });
    }
}

fn gelato(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_gelato"));
    command
        .current_dir(folder)
        .env("HOME", folder)
        .env_remove("GELATOHOME")
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

fn floats(path: &Path) -> Vec<f32> {
    let formats = granita_plugin::bundled_formats(Limits::default());
    formats.open(path).unwrap().read_level(0, 0).unwrap().to_floats()
}

#[test]
fn edits_change_the_image_and_are_saved_as_a_patch_with_its_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    std::fs::write(place.join("scene.pyg"), SCENE).unwrap();
    let viewer = Arc::new(Viewer::default());
    let listener =
        Listener::bind(([127, 0, 0, 1], 0).into(), ServerLimits::default(), viewer.clone()).unwrap();
    let address = listener.address().to_string();
    let running = gelato(place).args(["-relight", "-display", &address, "scene.pyg"]).spawn().unwrap();
    viewer.until("the first image", |seen| seen.panel.get("state").map(|_| ()));
    let first = viewer
        .until("its pixels", |seen| (!seen.pixels.iter().any(|v| v.is_nan())).then(|| seen.pixels.clone()));
    let written = std::fs::metadata(place.join("out.tif")).unwrap().modified().unwrap();
    assert!(first == floats(&place.join("out.tif")) && first.iter().any(|v| *v > 0.1));
    // A drag is coarse, and final in the end.
    viewer.send(json!({"do": "begin"}));
    for value in 7..12 {
        let set = json!({"do": "set", "light": "key", "layer": 0, "param": "intensity", "value": value});
        viewer.send(set);
    }
    viewer.until("a coarse frame", |seen| (seen.coarse_frames > 0).then_some(()));
    viewer.send(json!({"do": "end"}));
    let light = |seen: &Seen| seen.panel["light/key"]["layers"][0]["params"][0]["value"].clone();
    viewer.shows_edits("the drag");
    assert_eq!(light(&viewer.seen.lock()), 11.0);
    viewer.send(json!({"do": "place", "light": "key", "at": [40, 2]}));
    viewer.shows_edits("the place");
    let at = viewer.seen.lock().panel["light/key"]["at"][0].as_f64().unwrap();
    assert!((at - 40.0).abs() < 0.1, "{at}");
    viewer.send(json!({"do": "on", "light": "kee", "value": false}));
    let said =
        viewer.until("a message", |seen| seen.panel["state"]["message"]["text"].as_str().map(str::to_owned));
    assert_eq!(said, "there is no light \"kee\"; did you mean \"key\"?");
    viewer.send(json!({"do": "save", "file": "night.pyg"}));
    viewer.until("saved", |seen| (seen.panel["state"]["saved"] == true).then_some(()));
    assert_eq!(std::fs::metadata(place.join("out.tif")).unwrap().modified().unwrap(), written);
    viewer.until("the image before", |seen| {
        seen.names.iter().any(|name| name == "scene.pyg before").then_some(())
    });
    viewer.send(json!({"do": "quit"}));
    let output = running.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!((output.status.code(), &*said), (Some(0), ""));
    let last = viewer.seen.lock().pixels.clone();
    let ran = gelato(place).args(["scene.pyg", "night.pyg"]).output().unwrap();
    assert_eq!(
        (ran.status.code(), String::from_utf8_lossy(&ran.stderr).into_owned()),
        (Some(0), String::new())
    );
    let patched = floats(&place.join("out.tif"));
    assert!(patched == last && patched != first);
}

#[test]
fn edits_that_were_not_saved_are_kept_when_the_viewer_goes() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    std::fs::write(place.join("scene.pyg"), SCENE).unwrap();
    let viewer = Arc::new(Viewer::default());
    let listener =
        Listener::bind(([127, 0, 0, 1], 0).into(), ServerLimits::default(), viewer.clone()).unwrap();
    let address = listener.address().to_string();
    let running = gelato(place).args(["-relight", "-display", &address, "scene.pyg"]).spawn().unwrap();
    viewer.until("the first image", |seen| seen.panel.get("state").map(|_| ()));
    viewer.send(json!({"do": "on", "light": "key", "value": false}));
    viewer.until("off", |seen| (seen.panel["light/key"]["lit"] == false).then_some(()));
    drop(listener);
    let output = running.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("the edits that were not saved are in scene.lights.unsaved.pyg"), "{said}");
    let kept = std::fs::read_to_string(place.join("scene.lights.unsaved.pyg")).unwrap();
    assert!(kept.contains("LightSwitch (\"key\", 0)"), "{kept}");
}

#[test]
fn a_missing_viewer_is_one_message_that_says_how_to_get_it() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    std::fs::write(place.join("scene.pyg"), SCENE).unwrap();
    // A program of another folder has no iv beside it, and none is on the path.
    let program = place.join("gelato");
    granita_needs::copy_program(Path::new(env!("CARGO_BIN_EXE_gelato")), &program);
    let output = Command::new(&program)
        .current_dir(place)
        .args(["-relight", "scene.pyg"])
        .env("PATH", place)
        .env("HOME", place)
        .env_remove("DISPLAY")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("-relight needs the viewer iv") && said.contains("cargo build -p iv"), "{said}");
    assert!(!place.join("out.tif").exists());
}
