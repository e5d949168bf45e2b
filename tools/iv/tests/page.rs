//! The page of `iv -serve` in a browser without a screen, where one is installed.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use granita_base::Param;
use granita_display::IvFormat;
use granita_image::{Area, CreateOptions, Format, ImageSpec, Limits, PixelType, Pixels};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// Ends a program with the test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn browser() -> Option<PathBuf> {
    let folders = std::env::var_os("PATH")?;
    let names = ["chromium", "chromium-browser", "google-chrome", "chrome"];
    std::env::split_paths(&folders).flat_map(|f| names.map(|n| f.join(n))).find(|path| path.is_file())
}

/// A picture of the page, in levels of its screen: 600 x 400 pixels, three channels side by side.
fn screenshot(browser: &Path, folder: &Path, url: &str) -> Vec<f32> {
    let file = folder.join("shot.png");
    let _ = std::fs::remove_file(&file);
    let output = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"])
        .args(["--hide-scrollbars", "--window-size=600,400", "--force-device-scale-factor=1"])
        .args(["--virtual-time-budget=4000", "--timeout=20000"])
        .arg(format!("--user-data-dir={}", folder.join("profile").display()))
        .arg(format!("--screenshot={}", file.display()))
        .arg(url)
        .output()
        .unwrap();
    assert!(file.is_file(), "{}", String::from_utf8_lossy(&output.stderr));
    let formats = granita_plugin::bundled_formats(Limits::default());
    let input = formats.open(&file).unwrap();
    let spec = input.spec(0, 0).unwrap();
    assert_eq!((spec.width, spec.height), (600, 400));
    let n = spec.nchannels();
    let values = input.read_level(0, 0).unwrap().to_floats();
    values.chunks(n).flat_map(|pixel| pixel[..3].to_vec()).collect()
}

/// Whether a pixel has about this colour of the screen, 0 to 255.
fn is_near(shot: &[f32], [x, y]: [usize; 2], color: [f32; 3]) -> bool {
    let pixel = &shot[(y * 600 + x) * 3..][..3];
    pixel.iter().zip(color).all(|(v, c)| (v * 255.0 - c).abs() <= 2.0)
}

/// The middle of the picture that the page shows: it is fitted into what the list (220 pixels) and the bars leave.
fn middle(shot: &[f32]) -> [usize; 2] {
    let inside = |x: usize, y: usize| !is_near(shot, [x, y], [17.0; 3]);
    let columns: Vec<usize> = (221..600).filter(|x| inside(*x, 200)).collect();
    let x = columns[0].midpoint(columns[columns.len() - 1]);
    let rows: Vec<usize> = (80..360).filter(|y| inside(columns[0] + 1, *y)).collect();
    [x, rows[0].midpoint(rows[rows.len() - 1])]
}

#[test]
fn the_page_shows_what_a_renderer_sends() {
    let Some(browser) = browser() else {
        let _ = std::io::stderr().lock().write_all(b"skipped: no browser is installed\n");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let mut iv = Command::new(env!("CARGO_BIN_EXE_iv"));
    let iv = iv.args(["-serve", "0", "-listen", "0"]).stdout(Stdio::piped()).stdin(Stdio::null());
    let mut iv = Running(iv.spawn().unwrap());
    let mut lines = BufReader::new(iv.0.stdout.take().unwrap()).lines().map(Result::unwrap);
    let mut said = |what: &str| lines.find_map(|line| line.strip_prefix(what).map(str::to_owned)).unwrap();
    let display = said("iv: listening on ");
    let url = said("iv: serving ");
    // Four colours in a picture of 100 x 80; the last one is brighter than the screen, and no number.
    let mut spec = ImageSpec::new(100, 80, 4, PixelType::Float);
    spec.attributes.set(Param::declared("string display", display.as_str()).unwrap());
    let format = IvFormat::default();
    let options = CreateOptions { spec: &spec, levels: 1 };
    let mut picture = format.create(Path::new("four colours"), &options).unwrap();
    for (x, y, color) in [
        (0, 0, [1.0, 0.0, 0.0, 1.0]),
        (50, 0, [0.0, 0.5, 0.0, 1.0]),
        (0, 40, [0.0, 0.0, 0.25, 1.0]),
        (50, 40, [8.0, f32::NAN, 0.0, 1.0]),
    ] {
        let area = Area { x, y, width: 50, height: 40 };
        picture.write_rectangle(&area, &Pixels::Float(color.repeat(50 * 40))).unwrap();
    }
    picture.close().unwrap();
    // Once by the graphics card (or what stands for it), once without.
    for hash in ["", "#plain"] {
        let shot = screenshot(&browser, folder.path(), &format!("{url}{hash}"));
        let [x, y] = middle(&shot);
        // Linear values, as sRGB shows them.
        for (at, color) in [
            ([x - 40, y - 30], [255.0, 0.0, 0.0]),
            ([x + 40, y - 30], [0.0, 188.0, 0.0]),
            ([x - 40, y + 30], [0.0, 0.0, 137.0]),
            ([x + 40, y + 30], [255.0, 0.0, 255.0]),
        ] {
            let got = &shot[(at[1] * 600 + at[0]) * 3..][..3];
            assert!(is_near(&shot, at, color), "{hash} {at:?}: {got:?} instead of {color:?}");
        }
    }
}
