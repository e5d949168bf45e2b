//! Tests of the desk for lighting, `gelato -relight`, in a page and in a window. The page needs a browser, and the
//! window needs Xvfb and a driver. Both need the gelato beside the iv of this build. Tests that lack one are skipped
//! with a notice.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

mod browser;

use browser::{PATIENCE, Page, Running, browser};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const SCENE: &str = r#"
Attribute ("int[2] resolution", (240, 160))
Output ("out.tif", "tiff", "rgba", "main")
Camera ("main", "float fov", 40)
World ()
Translate (0, 0, 4)
PushTransform ()
Translate (-0.8, 0.8, -1)
Light ("key", "spotlight", "float intensity", 3)
PopTransform ()
Attribute ("string name", "ball")
Shader ("surface", "plastic")
Sphere (1, -1, 1, 360)
Render ()
"#;

/// Returns the gelato beside the iv of this build.
fn program() -> Option<PathBuf> {
    let program = Path::new(env!("CARGO_BIN_EXE_iv")).with_file_name("gelato");
    if !program.is_file() {
        granita_needs::skip("gelato (build it first: cargo build -p gelato)");
        return None;
    }
    Some(program)
}

fn place() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.pyg"), SCENE).unwrap();
    folder
}

fn gelato(program: &Path, folder: &Path, words: &[&str]) -> Running {
    let mut command = Command::new(program);
    command
        .current_dir(folder)
        .args(words)
        .env("HOME", folder)
        .env_remove("GELATOHOME")
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::inherit());
    Running(command.spawn().unwrap())
}

impl Page {
    /// Returns the value of an expression of the page.
    fn value(&mut self, code: &str) -> Value {
        let result = self.call("Runtime.evaluate", json!({"expression": code, "returnByValue": true}));
        assert!(result.get("exceptionDetails").is_none(), "{code}: {result}");
        result["result"]["value"].clone()
    }

    /// Waits until an expression of the page is true.
    fn until(&mut self, code: &str) {
        let begin = Instant::now();
        // The page may not be loaded yet.
        let tried = format!("(() => {{ try {{ return !!({code}); }} catch {{ return false; }} }})()");
        while self.value(&tried) != json!(true) {
            assert!(begin.elapsed() < PATIENCE, "{code}");
            std::thread::sleep(Duration::from_millis(30));
        }
    }

    fn mouse(&mut self, kind: &str, [x, y]: [f64; 2]) {
        let buttons = u8::from(kind != "mouseReleased");
        let event =
            json!({"type": kind, "x": x, "y": y, "button": "left", "buttons": buttons, "clickCount": 1});
        self.call("Input.dispatchMouseEvent", event);
    }

    fn drag(&mut self, from: [f64; 2], to: [f64; 2]) {
        self.mouse("mousePressed", from);
        for k in 1..=6 {
            let part = f64::from(k) / 6.0;
            self.mouse("mouseMoved", [0, 1].map(|i| from[i] + (to[i] - from[i]) * part));
        }
        self.mouse("mouseReleased", to);
    }

    /// Returns the middle of the first element of a selector.
    fn middle(&mut self, selector: &str) -> [f64; 2] {
        let code = format!(
            "(() => {{ const r = document.querySelector({selector:?}).getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]; }})()"
        );
        let value = self.value(&code);
        [0, 1].map(|i| value[i].as_f64().unwrap())
    }

    fn click(&mut self, selector: &str) {
        let at = self.middle(selector);
        self.mouse("mousePressed", at);
        self.mouse("mouseReleased", at);
    }
}

#[test]
fn lights_are_edited_in_the_page() {
    let Some(program) = program() else { return };
    let Some(browser) = browser() else {
        granita_needs::skip("chromium (or another browser)");
        return;
    };
    let folder = place();
    let mut running = gelato(&program, folder.path(), &["-relight", "scene.pyg"]);
    let mut lines = BufReader::new(running.0.stdout.take().unwrap()).lines().map(Result::unwrap);
    let url = lines.find_map(|line| line.strip_prefix("gelato: the desk is at ").map(str::to_owned)).unwrap();
    let profile = folder.path().join("profile");
    std::fs::create_dir(&profile).unwrap();
    let mut page = Page::open(&browser, &profile, &url, [1000, 700]);
    page.until("desk.parts.state && state().status === 'idle' && lightOf('key')");
    let idle = "state().status === 'idle'";
    // A click opens the light, and a drag of its first slider is one step.
    page.click(".lamp > header .name");
    page.until("document.querySelector('.lamp.open')");
    let slider = page.middle(".lamp.open input[type=range]");
    page.drag(slider, [slider[0] + 40.0, slider[1]]);
    page.until("lightOf('key').layers[0].params[0].value > 3.5 && state().undo === 'key: intensity'");
    page.until(idle);
    // The light is dragged in the image.
    let handle = page.middle(".handle.chosen");
    page.drag(handle, [handle[0] + 60.0, handle[1] + 10.0]);
    page.until("state().undo === 'key: position' && lightOf('key').position[0] > -0.7");
    page.until(idle);
    // It is aimed at a point of the ball.
    page.click(".lamp.open .row button");
    page.until("desk.mode === 'aim'");
    let view = page.middle("#view");
    page.mouse("mousePressed", view);
    page.mouse("mouseReleased", view);
    page.until("state().undo === 'key: aim' && desk.mode === null");
    page.until(idle);
    // The wipe shows the image before.
    page.click("#before");
    page.until(
        "compare.tiles && compare.tiles.list.every(t => t.store) && !document.getElementById('wipe').hidden",
    );
    page.click("#before");
    // Off, and back by undo.
    page.click(".lamp > header button");
    page.until("lightOf('key').lit === false");
    page.click("#undo");
    page.until("lightOf('key').lit === true && state().redo === 'key: off'");
    page.value("edit({do: 'set', light: 'key', param: 'intensity', value: 'x'})");
    page.until("document.getElementById('deskmessage').textContent.includes('is a float')");
    page.click("#save");
    page.until("state().saved");
    page.value("edit({do: 'quit'})");
    assert!(running.0.wait().unwrap().success());
    let saved = std::fs::read_to_string(folder.path().join("scene.lights.pyg")).unwrap();
    assert!(saved.contains("Light (\"key\", \"spotlight\""), "{saved}");
}

#[cfg(feature = "window")]
#[test]
fn lights_are_edited_in_the_window() {
    let Some(program) = program() else { return };
    if !granita_needs::has("Xvfb") {
        return;
    }
    let mut server = Command::new("Xvfb");
    server.args(["-displayfd", "1", "-screen", "0", "1024x768x24", "-nolisten", "tcp"]);
    let mut server = Running(server.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap());
    let mut line = String::new();
    BufReader::new(server.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let folder = place();
    // The image has 240 x 160 pixels in an area of 470 x 576, so it is shown at 100 %.
    let script = "sleep 12
wait
expect desk: idle
expect desk: key lit
screenshot first.png
key R
drag X Y X2 Y
frames 20
sleep 5
wait
expect desk: key lit edited
screenshot second.png
quit
";
    // Where the light is, by the camera: x = -0.8, y = 0.8, z = 3, with a field of view of 40 degrees.
    let scale = 160.0 / (2.0 * 20f64.to_radians().tan() * 3.0);
    let (x, y) = (235.0 - 0.8 * scale, 288.0 - 0.8 * scale);
    let script = script.replace("X2", &format!("{:.0}", x + 50.0)).replace('X', &format!("{x:.0}"));
    std::fs::write(folder.path().join("script.txt"), script.replace('Y', &format!("{y:.0}"))).unwrap();
    let mut iv = Command::new(env!("CARGO_BIN_EXE_iv"));
    iv.current_dir(folder.path())
        .env("DISPLAY", format!(":{}", line.trim()))
        .env_remove("WAYLAND_DISPLAY")
        .args(["-window", "800", "600", "-listen", "0", "-script", "script.txt"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let mut iv = Running(iv.spawn().unwrap());
    let mut lines = BufReader::new(iv.0.stdout.take().unwrap()).lines().map(Result::unwrap);
    let listens = lines.find_map(|line| line.strip_prefix("iv: listening on ").map(str::to_owned));
    let Some(address) = listens else { panic!("iv does not listen") };
    let _gelato = gelato(&program, folder.path(), &["-relight", "-display", &address, "scene.pyg"]);
    let said: Vec<String> = lines.collect();
    let mut errors = String::new();
    std::io::Read::read_to_string(&mut iv.0.stderr.take().unwrap(), &mut errors).unwrap();
    if errors.contains("the window cannot be opened") {
        granita_needs::skip(&format!("driver (under Xvfb: {errors})"));
        return;
    }
    assert!(iv.0.wait().unwrap().success(), "{said:?} {errors}");
}
