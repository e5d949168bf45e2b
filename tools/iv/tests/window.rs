//! Tests of the window, under Xvfb with software rendering, controlled by scripts. The tests are skipped with a notice
//! where Xvfb is not installed, or where no driver can draw.

#![cfg(feature = "window")]
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use granita_image::{CreateOptions, FormatRegistry, ImageSpec, Limits, PixelType, Pixels};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

fn formats() -> FormatRegistry {
    granita_plugin::bundled_formats(Limits::default())
}

/// A screen of 1024 x 768 pixels.
struct Screen {
    server: Child,
    name: String,
}

impl Drop for Screen {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

impl Screen {
    fn start() -> Option<Self> {
        if !granita_needs::has("Xvfb") {
            return None;
        }
        // The server prints the number of its display on standard output.
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "1024x768x24", "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let mut line = String::new();
        std::io::BufRead::read_line(&mut std::io::BufReader::new(server.stdout.take()?), &mut line).ok()?;
        Some(Self { server, name: format!(":{}", line.trim()) })
    }

    /// Runs a script in `folder`. Returns `None` when no driver can draw here.
    fn run(&self, folder: &Path, files: &[&str], script: &str) -> Option<String> {
        std::fs::write(folder.join("script.txt"), script).unwrap();
        let out = Command::new(env!("CARGO_BIN_EXE_iv"))
            .current_dir(folder)
            .env("DISPLAY", &self.name)
            .env_remove("WAYLAND_DISPLAY")
            .args(["-window", "800", "600", "-script", "script.txt"])
            .args(files)
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&out.stdout).into_owned();
        let error = String::from_utf8_lossy(&out.stderr).into_owned();
        if error.contains("the window cannot be opened") {
            granita_needs::skip(&format!("driver (under Xvfb: {error})"));
            return None;
        }
        assert!(out.status.success(), "{}: {text}{error}", out.status);
        Some(text)
    }
}

fn write(path: PathBuf, spec: &ImageSpec, value: impl Fn(u32, u32, usize) -> f32) {
    let n = spec.nchannels();
    let format = path.extension().unwrap().to_str().unwrap().to_owned();
    let values: Vec<f32> = (0..spec.width as usize * spec.height as usize * n)
        .map(|i| {
            let (pixel, c) = (i / n, i % n);
            value((pixel % spec.width as usize) as u32, (pixel / spec.width as usize) as u32, c)
        })
        .collect();
    let mut file = formats().create(&path, &format, &CreateOptions::new(spec, 1)).unwrap();
    file.write_rows(&Pixels::from_floats(spec.pixel_type, &values)).unwrap();
    file.close().unwrap();
}

/// Makes a folder with images of 400 x 300 pixels.
fn images() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let spec = ImageSpec::new(400, 300, 3, PixelType::U8);
    write(folder.path().join("a.png"), &spec, |x, y, c| [x as f32 / 400.0, y as f32 / 300.0, 0.5][c]);
    write(folder.path().join("b.png"), &spec, |x, y, c| [x as f32 / 400.0, y as f32 / 300.0, 0.25][c]);
    let mut layers = ImageSpec::new(400, 300, 4, PixelType::Float).tiled(64, 64);
    layers.channels = ["R", "G", "B", "Z"].map(str::to_owned).to_vec();
    write(folder.path().join("c.exr"), &layers, |x, y, c| match c {
        3 => 10.0 + y as f32,
        _ if (x, y) == (10, 10) => f32::NAN,
        _ => 0.25 * c as f32 + 0.25,
    });
    folder
}

/// Returns red, green and blue of a pixel of a file that the window wrote.
fn pixel(path: &Path, x: u32, y: u32) -> [u8; 3] {
    let input = formats().open(path).unwrap();
    let width = input.spec(0, 0).unwrap().width;
    let Pixels::U8(v) = input.read_rows(0, 0, y, y + 1).unwrap() else { panic!("{}", path.display()) };
    assert!(x < width);
    let at = 3 * x as usize;
    [v[at], v[at + 1], v[at + 2]]
}

/// When the server of the screen ends, the program ends with one message and without a trace of a panic.
#[test]
fn a_lost_display_server_is_one_message() {
    let Some(mut screen) = Screen::start() else { return };
    let folder = images();
    for renderer in ["vulkan", "gl"] {
        // This run determines whether a driver can draw here.
        let place = folder.path();
        std::fs::write(place.join("script.txt"), "wait\nquit\n").unwrap();
        let start = |more: &[&str]| {
            let said = std::fs::File::create(place.join("said.txt")).unwrap();
            Command::new(env!("CARGO_BIN_EXE_iv"))
                .current_dir(place)
                .env("DISPLAY", &screen.name)
                .env_remove("WAYLAND_DISPLAY")
                .args(["-renderer", renderer, "-window", "400", "300"])
                .args(more)
                .stdout(Stdio::null())
                .stderr(said)
                .spawn()
                .unwrap()
        };
        let said = || std::fs::read_to_string(place.join("said.txt")).unwrap();
        start(&["-script", "script.txt", "a.png"]).wait().unwrap();
        if said().contains("the window cannot be opened") {
            granita_needs::skip(&format!("driver (under Xvfb: {})", said()));
            continue;
        }
        let mut viewer = start(&["a.png"]);
        std::thread::sleep(std::time::Duration::from_secs(4));
        assert!(viewer.try_wait().unwrap().is_none(), "{}", said());
        screen.server.kill().unwrap();
        screen.server.wait().unwrap();
        let begin = std::time::Instant::now();
        let status = loop {
            if let Some(status) = viewer.try_wait().unwrap() {
                break status;
            }
            if begin.elapsed() > std::time::Duration::from_secs(20) {
                viewer.kill().unwrap();
                panic!("it goes on without a screen: {}", said());
            }
            std::thread::sleep(std::time::Duration::from_millis(50));
        };
        assert!(status.code().is_some_and(|code| code != 0), "{status}: {}", said());
        let said = said();
        // The message is one line of this program or of Xlib, which ends programs by itself. Drivers add warnings about
        // missing features.
        let lines = said.lines().filter(|l| !l.trim().is_empty() && !l.contains("XDG_RUNTIME_DIR"));
        assert!(!said.contains("panicked") && lines.count() <= 2, "{said}");
        let ends = ["the connection to the screen is lost", "fatal IO error", "X connection to"];
        assert!(ends.iter().any(|end| said.contains(end)), "{said}");
        match Screen::start() {
            Some(another) => screen = another,
            None => return,
        }
    }
}

#[test]
fn the_window_opens_zooms_compares_probes_and_saves() {
    let Some(screen) = Screen::start() else { return };
    let folder = images();
    let ran = screen.run(
        folder.path(),
        &["a.png", "b.png", "c.exr"],
        "wait
expect 1/3 a.png
expect 400 x 300 uint8
expect 100 %
canvas one.png
screenshot window.png
key PageDown
wait
expect 2/3 b.png
key W
wait
expect wipe
expect PSNR
canvas wipe.png
key W
key D
wait
expect difference x1
expect 0.25
canvas difference.png
key Escape
scroll 400 288 8
wait
expect 400 %
canvas zoomed.png
key 1
drag 300 200 309 204 Shift+
wait
expect area of 10 x 5 at 100 62
move 400 288
frames 2
expect [200 150]
key Escape
key T
wait
expect 1/3 a.png
key End
wait
expect 3/3 c.exr
expect RGB
canvas marks.png
key L
wait
canvas depth.png
key Ctrl+S
frames 3
key Enter
frames 3
expect saved c.view.png
quit
",
    );
    if ran.is_none() {
        return;
    }
    let at = |name: &str, x, y| pixel(&folder.path().join(name), x, y);
    // The image area has 800 x 576 pixels. The image lies in its centre and begins at (200, 138).
    assert_eq!(at("one.png", 200 + 100, 138 + 150), [64, 128, 128]);
    assert_eq!(at("one.png", 10, 10), [34, 34, 36], "beside the image");
    assert_eq!(at("window.png", 200 + 100, 138 + 150), [64, 128, 128], "the screen shows what was drawn");
    assert_eq!((at("wipe.png", 399, 288)[2], at("wipe.png", 400, 288)[2]), (64, 128));
    assert_eq!(at("difference.png", 300, 200), [0, 0, 64]);
    // The pixel under the pointer stays there.
    assert_eq!(at("zoomed.png", 401, 289), [128, 128, 64]);
    assert_eq!(at("marks.png", 210, 148), [255, 0, 255]);
    let (near, far) = (at("depth.png", 400, 140)[0], at("depth.png", 400, 430)[0]);
    assert!(near > 250 && (20..60).contains(&far), "{near} {far}");
    assert!(folder.path().join("c.view.png").is_file());
}

#[test]
fn files_that_change_are_read_again() {
    let Some(screen) = Screen::start() else { return };
    let folder = images();
    let copy = folder.path().join("a.png");
    let other = folder.path().join("b.png");
    let changer = std::thread::spawn(move || {
        std::thread::sleep(std::time::Duration::from_secs(3));
        std::fs::copy(other, copy).unwrap();
    });
    let script = "wait\ncanvas before.png\nsleep 6\nwait\ncanvas after.png\nquit\n";
    let ran = screen.run(folder.path(), &["a.png"], script);
    changer.join().unwrap();
    if ran.is_some() {
        let blue = |name: &str| pixel(&folder.path().join(name), 300, 200)[2];
        assert_eq!((blue("before.png"), blue("after.png")), (128, 64));
    }
}

#[test]
fn errors_of_images_are_shown_in_the_window() {
    let Some(screen) = Screen::start() else { return };
    let folder = images();
    std::fs::write(folder.path().join("text.txt"), "no image at all").unwrap();
    let cut = folder.path().join("cut.jpg");
    let spec = ImageSpec::new(400, 300, 3, PixelType::U8);
    write(cut.clone(), &spec, |x, y, c| ((x * x + y * (3 + c as u32)) % 97) as f32 / 97.0);
    let bytes = std::fs::read(&cut).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let script = "frames 5\nexpect not an image of a known format\nkey Space\nwait\nexpect b.png\nkey K\nframes 1\nexpect the image has no cube faces\nkey Questionmark\nframes 2\nkey Escape\nkey V\nwait\nexpect helix\nkey O\nframes 2\nexpect neither a panorama\n\
                  file cut.jpg\nwait\nexpect not all of it could be read\nexpect of 300 rows are there\nquit\n";
    screen.run(folder.path(), &["text.txt", "b.png", "none.exr"], script);
}

/// Returns a packet of the protocol of tev, written from its description. It consists of length, type and content.
fn packet(kind: u8, content: &[u8]) -> Vec<u8> {
    let length = 5 + content.len() as u32;
    [&length.to_le_bytes()[..], &[kind], content].concat()
}

#[test]
fn images_of_a_renderer_are_shown_in_the_window() {
    use std::io::{BufRead, BufReader, Write};
    let Some(screen) = Screen::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let script = "frames 10\nsleep 4\nwait\nexpect 1/1 render\nexpect 100 x 80 float\n\
                  key 1\nwait\ncanvas live.png\nscreenshot lines.png\nkey Delete\nframes 1\nexpect this is not a live image\nquit\n";
    std::fs::write(folder.path().join("script.txt"), script).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_iv"))
        .current_dir(folder.path())
        .env("DISPLAY", &screen.name)
        .env_remove("WAYLAND_DISPLAY")
        .args(["-listen", "0", "-window", "800", "600", "-script", "script.txt"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut words = BufReader::new(child.stdout.take().unwrap());
    let mut line = String::new();
    words.read_line(&mut line).unwrap();
    let address = line.trim().rsplit(' ').next().unwrap().to_owned();
    let text = |t: &str| [t.as_bytes(), &[0]].concat();
    let ints = |v: &[i32]| v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    if let Ok(mut wire) = std::net::TcpStream::connect(&address) {
        std::thread::sleep(std::time::Duration::from_millis(1500));
        let names = [text("R"), text("G"), text("B")].concat();
        let create = [&[1][..], &text("render"), &ints(&[100, 80, 3]), &names].concat();
        wire.write_all(&packet(4, &create)).unwrap();
        // The channels of a part of the image are sent one after the other.
        let values: Vec<u8> =
            [1.0_f32, 0.5, 0.0].iter().flat_map(|v| v.to_le_bytes().repeat(20 * 10)).collect();
        let update =
            [&[0][..], &text("render"), &ints(&[3]), &names, &ints(&[30, 40, 20, 10]), &values].concat();
        wire.write_all(&packet(5, &update)).unwrap();
        // The drawing consists of a filled square and a line. Each has a colour, a path and an operation.
        let floats = |v: &[f32]| v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        let point = |kind: u8, x: f32, y: f32| [&[kind][..], &floats(&[x, y])].concat();
        let corners =
            [point(2, 70.0, 10.0), point(3, 90.0, 10.0), point(3, 90.0, 30.0), point(3, 70.0, 30.0)];
        let line = [point(2, 10.0, 70.0), point(3, 90.0, 70.0)].concat();
        let color = |kind: u8, rgba: [f32; 4]| [&[kind][..], &floats(&rgba)].concat();
        let drawing = [
            &[0][..],
            &text("render"),
            &[0],
            &ints(&[12]),
            &[&color(4, [0.0, 1.0, 1.0, 1.0])[..], &[8], &corners.concat(), &[6]].concat(),
            &[&color(5, [1.0, 0.0, 1.0, 1.0])[..], &[8], &line, &[7]].concat(),
        ];
        wire.write_all(&packet(8, &drawing.concat())).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(500));
    }
    let out = child.wait_with_output().unwrap();
    let error = String::from_utf8_lossy(&out.stderr).into_owned();
    if error.contains("the window cannot be opened") {
        granita_needs::skip(&format!("driver (under Xvfb: {error})"));
        return;
    }
    let mut rest = String::new();
    words.read_line(&mut rest).unwrap();
    assert!(out.status.success(), "{rest}{error}");
    // The image lies in the centre of an area of 800 x 576 pixels.
    let at = |x: u32, y: u32| pixel(&folder.path().join("live.png"), 350 + x, 248 + y);
    assert_eq!((at(35, 45), at(10, 10)), ([255, 188, 0], [0, 0, 0]));
    let drawn = ([0, 255, 255], [255, 0, 255]);
    assert_eq!((at(80, 20), at(50, 70)), drawn);
    assert_eq!((at(65, 20), at(50, 67), at(5, 70)), ([0; 3], [0; 3], [0; 3]));
    let lines = folder.path().join("lines.png");
    assert_eq!(
        (pixel(&lines, 350 + 80, 248 + 20), pixel(&lines, 350 + 50, 248 + 70)),
        drawn,
        "on the screen"
    );
}

#[test]
fn perceptual_differences_are_shown() {
    let Some(screen) = Screen::start() else { return };
    let folder = images();
    let compared = Command::new(env!("CARGO_BIN_EXE_iv"))
        .current_dir(folder.path())
        .args(["-compare", "b.png", "a.png"])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&compared.stdout).into_owned();
    let mean: f32 = said.split("FLIP ").nth(1).unwrap().split_whitespace().next().unwrap().parse().unwrap();
    let script = format!(
        "wait\nkey PageDown\nwait\nkey S\nwait\nframes 3\nwait\nexpect FLIP map\nexpect FLIP {mean:.5}\n\
         canvas map.png\nscreenshot key.png\nkey S\nwait\ncanvas plain.png\nquit\n"
    );
    if screen.run(folder.path(), &["a.png", "b.png"], &script).is_none() {
        return;
    }
    let at = |name: &str, x: u32, y: u32| pixel(&folder.path().join(name), x, y);
    // The mean of the values that the colours of the map represent is the printed number.
    let map = granita_view::ColorMap::Magma;
    let value = |color: [u8; 3]| {
        let far = |t: &usize| {
            let c = map.at(*t as f32 / 1000.0);
            (0..3).map(|i| i32::from(c[i].abs_diff(color[i])).pow(2)).sum::<i32>()
        };
        (0..=1000).min_by_key(far).unwrap() as f32 / 1000.0
    };
    let places: Vec<(u32, u32)> =
        (0..300).step_by(10).flat_map(|y| (0..400).step_by(10).map(move |x| (x, y))).collect();
    let sum: f32 = places.iter().map(|(x, y)| value(at("map.png", 200 + x, 138 + y))).sum();
    let seen = sum / places.len() as f32;
    assert!(mean > 0.01 && (seen - mean).abs() < 0.01, "{seen} {mean}");
    assert_eq!(at("plain.png", 300, 200), [64, 53, 64], "the image is back");
    // The key of the colours is at the lower left.
    assert!(at("key.png", 13, 538)[0] < 20 && at("key.png", 210, 538)[0] > 240);
}

#[test]
fn both_graphics_libraries_draw() {
    let Some(screen) = Screen::start() else { return };
    for renderer in ["gl", "vulkan"] {
        let folder = images();
        let script = "wait\nexpect 1/1 a.png\ncanvas canvas.png\nscreenshot screen.png\nquit\n";
        if screen.run(folder.path(), &["-renderer", renderer, "a.png"], script).is_some() {
            let at = |name: &str| pixel(&folder.path().join(name), 300, 288);
            assert_eq!((at("canvas.png"), at("screen.png")), ([64, 128, 128], [64, 128, 128]), "{renderer}");
        }
    }
}

#[test]
fn a_missing_driver_or_screen_is_reported() {
    let folder = images();
    let Some(screen) = Screen::start() else { return };
    let ran = |screen: &str, renderer: &str| {
        let none = folder.path().join("none");
        let out = Command::new(env!("CARGO_BIN_EXE_iv"))
            .current_dir(folder.path())
            .envs(
                ["VK_ICD_FILENAMES", "VK_DRIVER_FILES", "__EGL_VENDOR_LIBRARY_FILENAMES"].map(|n| (n, &none)),
            )
            .env("DISPLAY", screen)
            .env_remove("WAYLAND_DISPLAY")
            .args(["-renderer", renderer, "a.png"])
            .output()
            .unwrap();
        (out.status.code(), String::from_utf8_lossy(&out.stderr).into_owned())
    };
    let (code, said) = ran(&screen.name, "vulkan");
    assert!(code == Some(2) && said.contains("vulkan: no driver can draw in a window here"), "{said}");
    let (code, said) = ran(":4711", "auto");
    assert!(code == Some(2) && said.contains("no connection to a screen"), "{said}");
    assert!(!said.contains(".rs:"), "{said}");
}
