//! Tests of `gelato -iv` with the window that it starts, under Xvfb. The tests are skipped with a notice where Xvfb or
//! gelato is missing, or where no driver can draw. The pixels on the screen are read from the memory of the server.

#![cfg(all(feature = "window", target_os = "linux"))]
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use granita_image::Limits;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The size and depth of the screen. It has room for the default window of 1280 x 800 pixels.
const SIZE: &str = "1280x800x24";

/// A screen of its own, whose memory is a file in `folder`.
struct Screen {
    server: Child,
    name: String,
    folder: tempfile::TempDir,
}

impl Drop for Screen {
    fn drop(&mut self) {
        viewers(&self.name).into_iter().for_each(kill);
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

impl Screen {
    fn start() -> Option<Self> {
        if !granita_needs::has("Xvfb") {
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", SIZE, "-nolisten", "tcp", "-fbdir"])
            .arg(folder.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        std::io::BufRead::read_line(&mut std::io::BufReader::new(server.stdout.take().unwrap()), &mut line)
            .unwrap();
        Some(Self { server, name: format!(":{}", line.trim()), folder })
    }

    /// Returns red, green and blue of a pixel of the screen.
    fn at(&self, shot: &[u8], x: usize, y: usize) -> [u8; 3] {
        // The file has the format of xwd. The words of the header are big endian.
        let word = |i: usize| u32::from_be_bytes(*shot[4 * i..].first_chunk().unwrap()) as usize;
        let start = word(0) + 12 * word(19);
        let (bits, line) = (word(11), word(12));
        assert_eq!((bits, word(7)), (32, 0), "little endian words");
        let at = start + y * line + 4 * x;
        [shot[at + 2], shot[at + 1], shot[at]]
    }

    fn shot(&self) -> Vec<u8> {
        std::fs::read(self.folder.path().join("Xvfb_screen0")).unwrap()
    }

    /// Starts gelato. Its messages go to a file, because the viewer that it starts also writes messages there and
    /// outlives it.
    fn gelato(&self, folder: &Path, words: &[&str]) -> Child {
        let said = std::fs::File::create(folder.join("said.txt")).unwrap();
        Command::new(program())
            .current_dir(folder)
            .args(words)
            .env("DISPLAY", &self.name)
            .env("HOME", folder)
            .env_remove("WAYLAND_DISPLAY")
            .env_remove("GELATOHOME")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(said)
            .spawn()
            .unwrap()
    }
}

/// Returns the path of the gelato beside the iv of this build.
fn program() -> PathBuf {
    Path::new(env!("CARGO_BIN_EXE_iv")).with_file_name("gelato")
}

/// Returns the ids of the processes called iv that use this screen.
fn viewers(screen: &str) -> Vec<u32> {
    let shows = format!("DISPLAY={screen}");
    let processes =
        std::fs::read_dir("/proc").unwrap().filter_map(|e| e.ok()?.file_name().to_str()?.parse().ok());
    processes
        .filter(|pid: &u32| {
            let read = |what: &str| std::fs::read(format!("/proc/{pid}/{what}")).unwrap_or_default();
            read("comm").starts_with(b"iv\n")
                && read("environ").split(|b| *b == 0).any(|v| v == shows.as_bytes())
        })
        .collect()
}

fn kill(pid: u32) {
    let _ = Command::new("kill").args(["-9", &pid.to_string()]).status();
}

/// Waits until a condition holds. Returns false when it does not hold in time.
fn until(mut done: impl FnMut() -> bool) -> bool {
    let begin = Instant::now();
    while begin.elapsed() < Duration::from_secs(40) {
        if done() {
            return true;
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    false
}

/// Makes a folder with a scene of a sphere. Each pixel has `samples` x `samples` samples.
fn place(samples: u32) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let scene = format!(
        r#"
Attribute ("int[2] resolution", (96, 64))
Attribute ("int[2] spatialquality", ({samples}, {samples}))
Attribute ("int[2] limits:bucketsize", (16, 16))
Output ("out.tif", "tiff", "rgba", "main", "int[4] quantize", (0, 0, 0, 0))
Camera ("main")
World ()
Light ("sun", "distantlight")
Translate (0, 0, 2)
Shader ("surface", "plastic")
Sphere (1, -1, 1, 360)
Render ()
"#
    );
    std::fs::write(folder.path().join("scene.pyg"), scene).unwrap();
    folder
}

fn said(folder: &Path) -> String {
    std::fs::read_to_string(folder.join("said.txt")).unwrap()
}

fn file(folder: &Path) -> Vec<f32> {
    let formats = granita_plugin::bundled_formats(Limits::default());
    formats.open(&folder.join("out.tif")).unwrap().read_level(0, 0).unwrap().to_floats()
}

/// Returns a screen, if a window can be shown on it.
fn ready() -> Option<Screen> {
    if !program().is_file() {
        granita_needs::skip(&format!("gelato in {}", program().display()));
        return None;
    }
    let screen = Screen::start()?;
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("quit.txt"), "quit\n").unwrap();
    let ran = Command::new(env!("CARGO_BIN_EXE_iv"))
        .current_dir(folder.path())
        .args(["-script", "quit.txt"])
        .env("DISPLAY", &screen.name)
        .env_remove("WAYLAND_DISPLAY")
        .output()
        .unwrap();
    let error = String::from_utf8_lossy(&ran.stderr).into_owned();
    if error.contains("the window cannot be opened") {
        granita_needs::skip(&format!("driver (under Xvfb: {error})"));
        return None;
    }
    Some(screen)
}

/// Returns the centre of a pixel of an image of 96 x 64, in pixels of the screen. The image is shown with a zoom of 12
/// in 1280 x 776 pixels.
fn on_screen(x: usize, y: usize) -> (usize, usize) {
    (64 + 12 * x + 6, 4 + 12 * y + 6)
}

fn encoded(v: f32) -> u8 {
    let v = v.clamp(0.0, 1.0);
    let v = if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    (255.0 * v + 0.5) as u8
}

/// True when the screen shows these pixels. Every eighth pixel is compared.
fn shows(screen: &Screen, pixels: &[f32]) -> bool {
    let shot = screen.shot();
    (4..64).step_by(8).all(|y| {
        (4..96).step_by(8).all(|x| {
            let (sx, sy) = on_screen(x, y);
            let (got, want) = (screen.at(&shot, sx, sy), &pixels[4 * (y * 96 + x)..][..3]);
            (0..3).all(|c| got[c].abs_diff(encoded(want[c])) <= 2)
        })
    })
}

#[test]
fn the_window_stays_open_after_the_render() {
    let Some(screen) = ready() else { return };
    let folder = place(4);
    let status = screen.gelato(folder.path(), &["-iv", "scene.pyg"]).wait().unwrap();
    assert!(status.success(), "{}", said(folder.path()));
    let pixels = file(folder.path());
    assert!(pixels[4 * (32 * 96 + 48)] > 0.05, "there is something to be seen");
    assert!(until(|| shows(&screen, &pixels)), "the screen does not show the image");
    std::thread::sleep(Duration::from_secs(1));
    assert_eq!(viewers(&screen.name).len(), 1);
    assert!(shows(&screen, &pixels), "the image stays");
}

/// Renders the sphere for a viewer, with an image of 96 x 64 pixels, each of them `color`, as its "background" or
/// "foreground".
fn render_with(screen: &Screen, parameter: &str, color: [u8; 4]) -> tempfile::TempDir {
    let folder = place(4);
    let spec = granita_image::ImageSpec::new(96, 64, 4, granita_image::PixelType::U8);
    let formats = granita_plugin::bundled_formats(Limits::default());
    let options = granita_image::CreateOptions::new(&spec, 1);
    let mut file = formats.create(&folder.path().join("layer.png"), "png", &options).unwrap();
    file.write_rows(&granita_image::Pixels::U8(color.repeat(96 * 64))).unwrap();
    file.close().unwrap();
    let scene = std::fs::read_to_string(folder.path().join("scene.pyg")).unwrap();
    let output = format!(r#"Output ("live", "iv", "rgba", "main", "string {parameter}", "layer.png")"#);
    std::fs::write(folder.path().join("scene.pyg"), scene.replace("Camera", &format!("{output}\nCamera")))
        .unwrap();
    let status = screen.gelato(folder.path(), &["scene.pyg"]).wait().unwrap();
    assert!(status.success(), "{}", said(folder.path()));
    folder
}

/// Tests that the viewer which gelato starts opens the image that an output names as its "background" (reference
/// 7.4.3).
#[test]
fn a_background_is_shown_behind_the_render() {
    let Some(screen) = ready() else { return };
    let folder = render_with(&screen, "background", [200, 10, 10, 255]);
    let pixels = file(folder.path());
    let ((x, y), (u, v)) = (on_screen(4, 4), on_screen(48, 32));
    let sphere = [0, 1, 2].map(|c| encoded(pixels[4 * (32 * 96 + 48) + c]));
    let seen = || {
        let shot = screen.shot();
        (screen.at(&shot, x, y), screen.at(&shot, u, v))
    };
    assert!(
        until(|| seen() == ([200, 10, 10], sphere)),
        "{:?}, not {sphere:?}; {}",
        seen(),
        said(folder.path())
    );
}

/// Tests that the viewer opens the image that an output names as its "foreground" (reference 7.4.3).
#[test]
fn a_foreground_is_shown_over_the_render() {
    let Some(screen) = ready() else { return };
    let folder = render_with(&screen, "foreground", [10, 200, 10, 255]);
    let seen =
        || [(4, 4), (48, 32)].map(|(x, y)| on_screen(x, y)).map(|(x, y)| screen.at(&screen.shot(), x, y));
    assert!(until(|| seen() == [[10, 200, 10]; 2]), "{:?}; {}", seen(), said(folder.path()));
}

/// Renders a scene, and kills the viewer that shows it. Returns true when the render went on afterwards.
fn kills_the_viewer(screen: &Screen, folder: &Path) -> bool {
    let mut render = screen.gelato(folder, &["-threads", "1", "-iv", "scene.pyg"]);
    assert!(until(|| !viewers(&screen.name).is_empty()), "a viewer is started");
    std::thread::sleep(Duration::from_millis(600));
    viewers(&screen.name).into_iter().for_each(kill);
    assert_eq!(render.wait().unwrap().code(), Some(0), "{}", said(folder));
    said(folder).contains("the viewer")
}

#[test]
fn a_killed_viewer_does_not_change_the_render() {
    let Some(screen) = ready() else { return };
    // On a fast machine the render may end before the viewer is killed. Then a longer one is tried.
    let folder = [32, 64, 128, 256]
        .into_iter()
        .find_map(|samples| {
            let folder = place(samples);
            kills_the_viewer(&screen, folder.path()).then_some(folder)
        })
        .expect("no render went on after its viewer was killed");
    let pixels = file(folder.path());
    std::fs::remove_file(folder.path().join("out.tif")).unwrap();
    let mut alone = screen.gelato(folder.path(), &["scene.pyg"]);
    assert!(alone.wait().unwrap().success());
    assert!(file(folder.path()) == pixels, "the file is whole");
}

#[test]
fn a_killed_render_leaves_its_image_with_a_note() {
    let Some(screen) = ready() else { return };
    let folder = place(120);
    let mut render = screen.gelato(folder.path(), &["-threads", "1", "-iv", "scene.pyg"]);
    let lit = || {
        let shot = screen.shot();
        let spots = (0..64).flat_map(|y| (0..96).map(move |x| on_screen(x, y)));
        spots
            .filter(|(x, y)| {
                let [r, g, b] = screen.at(&shot, *x, *y);
                r == g && g == b && r > 60
            })
            .count()
    };
    assert!(until(|| lit() > 50), "a part of the sphere is seen");
    assert!(render.try_wait().unwrap().is_none(), "the render goes on");
    render.kill().unwrap();
    render.wait().unwrap();
    // The note is light text at the top, where the image is black.
    let light = || {
        let shot = screen.shot();
        let spots = (4..34).flat_map(|y| (440..840).map(move |x| (x, y)));
        spots.filter(|(x, y)| screen.at(&shot, *x, *y)[0] > 180).count()
    };
    assert!(until(|| light() > 100), "the note is seen");
    assert!(lit() > 50, "the image stays");
    assert!(!folder.path().join("out.tif").exists(), "no half file");
}
