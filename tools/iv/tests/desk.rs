//! Tests of the desk for lighting, `gelato -relight`, in a page and in a window. The page needs a browser, and the
//! window needs Xvfb and a driver. Both need the gelato beside the iv of this build. Tests that lack one are skipped
//! with a notice.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use granita_browser::{Page, Running};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

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

#[test]
fn lights_are_edited_in_the_page() {
    let Some(program) = program() else { return };
    let Some(browser) = granita_browser::find() else {
        granita_needs::skip("chromium (or another browser)");
        return;
    };
    let folder = place();
    let mut running = gelato(&program, folder.path(), &["-relight", "scene.pyg"]);
    let mut lines = BufReader::new(running.0.stdout.take().unwrap()).lines().map(Result::unwrap);
    let url = lines.find_map(|line| line.strip_prefix("gelato: the desk is at ").map(str::to_owned)).unwrap();
    let profile = folder.path().join("profile");
    std::fs::create_dir(&profile).unwrap();
    let mut page = Page::open(&browser, &profile, &url, [1000, 700]).unwrap();
    page.until("desk.parts.state && state().status === 'idle' && lightOf('key')").unwrap();
    let idle = "state().status === 'idle'";
    // A click opens the light, and a drag of its first slider is one step.
    page.click(".lamp > header .name").unwrap();
    page.until("document.querySelector('.lamp.open')").unwrap();
    let slider = page.middle(".lamp.open input[type=range]").unwrap();
    page.drag(slider, [slider[0] + 40.0, slider[1]]).unwrap();
    page.until("lightOf('key').layers[0].params[0].value > 3.5 && state().undo === 'key: intensity'")
        .unwrap();
    page.until(idle).unwrap();
    // The light is dragged in the image.
    let handle = page.middle(".handle.chosen").unwrap();
    page.drag(handle, [handle[0] + 60.0, handle[1] + 10.0]).unwrap();
    page.until("state().undo === 'key: position' && lightOf('key').position[0] > -0.7").unwrap();
    page.until(idle).unwrap();
    // It is aimed at a point of the ball.
    page.click(".lamp.open .row button").unwrap();
    page.until("desk.mode === 'aim'").unwrap();
    let view = page.middle("#view").unwrap();
    page.mouse("mousePressed", view).unwrap();
    page.mouse("mouseReleased", view).unwrap();
    page.until("state().undo === 'key: aim' && desk.mode === null").unwrap();
    page.until(idle).unwrap();
    // The wipe shows the image before.
    page.click("#before").unwrap();
    page.until(
        "compare.tiles && compare.tiles.list.every(t => t.store) && !document.getElementById('wipe').hidden",
    )
    .unwrap();
    page.click("#before").unwrap();
    // Off, and back by undo.
    page.click(".lamp > header button").unwrap();
    page.until("lightOf('key').lit === false").unwrap();
    page.click("#undo").unwrap();
    page.until("lightOf('key').lit === true && state().redo === 'key: off'").unwrap();
    page.value("edit({do: 'set', light: 'key', param: 'intensity', value: 'x'})").unwrap();
    page.until("document.getElementById('deskmessage').textContent.includes('is a float')").unwrap();
    page.click("#save").unwrap();
    page.until("state().saved").unwrap();
    page.value("edit({do: 'quit'})").unwrap();
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
    // The desk prepares drags after an image, so that it is idle some time after the image is complete.
    let script = "wait
desk
expect desk: idle
expect desk: key lit
screenshot first.png
key R
drag X Y X2 Y
latency
wait
desk
expect desk: idle
expect desk: key lit edited
screenshot second.png
light key -40 10
latency
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
    let reports: Vec<&str> = said.iter().filter_map(|line| line.strip_prefix("latency: edits ")).collect();
    let mut errors = String::new();
    std::io::Read::read_to_string(&mut iv.0.stderr.take().unwrap(), &mut errors).unwrap();
    if errors.contains("the window cannot be opened") {
        granita_needs::skip(&format!("driver (under Xvfb: {errors})"));
        return;
    }
    assert!(iv.0.wait().unwrap().success(), "{said:?} {errors}");
    // Each of the two drags moves the light eight times, unless two moves end in the same frame of the window.
    assert_eq!(reports.len(), 2, "{said:?}");
    for report in reports {
        let (edits, last) = report.split_once("; final ").unwrap();
        let times: Vec<f64> = edits.split(' ').chain([last]).map(|time| time.parse().unwrap()).collect();
        assert!(times.len() >= 8 && times.iter().all(|time| (0.0..60_000.0).contains(time)), "{report}");
    }
}
