//! Tests what is left of a frame that is ended early, with `-keeppartial` and without it.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use granita_image::{FormatRegistry, Limits};
use rustix::process::{Pid, Signal, kill_process};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// A frame of many buckets, in the order of their columns. The first columns are done at once.
const SCENE: &str = r#"
Attribute ("int[2] resolution", (128, 96))
Attribute ("int[2] limits:bucketsize", (16, 16))
Attribute ("string bucketorder", "vertical")
Output ("a.tif", "tiff", "rgba", "main", "string ImageDescription", "a ball")
Output ("sub/b.exr", "exr", "z", "main")
Output ("c.png", "png", "rgb", "main")
Camera ("main")
World ()
Translate (0, 0, 4)
Shader ("surface", "endless")
Scale (8, 8, 8)
Patch ("linear", 2, 2, "vertex point P", (-1, 1, 0, 1, 1, 0, -1, -1, 0, 1, -1, 0))
Render ()
"#;

/// A shader that does not end on the right side of the image.
const SHADER: &str = r#"
surface endless () {
    float i = 0;
    point r = transform ("raster", P);
    while (r[0] > 60 && i >= 0) i += 1;
    C = color (0.5, 0.25, 1);
}
"#;

/// The attributes and a pixel of an image.
struct Shown {
    description: Option<String>,
    size: [u32; 2],
    first: Vec<f32>,
    last: Vec<f32>,
}

struct Place(TempDir);

impl Place {
    /// Makes a folder with the scene in it, with more statements before it.
    fn new(more: &str) -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        std::fs::create_dir(place.path().join("sub")).unwrap();
        std::fs::write(place.path().join("scene.pyg"), format!("{more}{SCENE}")).unwrap();
        std::fs::write(place.path().join("endless.gsl"), SHADER).unwrap();
        place
    }

    fn path(&self) -> &Path {
        self.0.path()
    }

    fn start(&self, words: &[&str]) -> Child {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gelato"));
        command.current_dir(self.path()).args(["-verbosity", "2"]).args(words).arg("scene.pyg");
        command.env("HOME", self.path()).env_remove("GELATOHOME").env_remove("GELATOTEMP");
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    }

    /// Returns the files beneath the folder, without those of the scene.
    fn files(&self) -> Vec<String> {
        let mut found = Vec::new();
        for folder in ["", "sub/"] {
            for entry in std::fs::read_dir(self.path().join(folder)).unwrap() {
                found.push(format!("{folder}{}", entry.unwrap().file_name().to_str().unwrap()));
            }
        }
        found.retain(|name| !["scene.pyg", "endless.gsl", "sub"].contains(&name.as_str()));
        found.sort();
        found
    }

    fn image(&self, name: &str) -> Shown {
        let registry: FormatRegistry = granita_plugin::bundled_formats(Limits::default());
        let file = registry.open(&self.path().join(name)).unwrap();
        let spec = file.spec(0, 0).unwrap();
        let channels = spec.nchannels();
        let values = file.read_level(0, 0).unwrap().to_floats();
        Shown {
            description: spec.string("ImageDescription").map(str::to_owned),
            size: [spec.width, spec.height],
            first: values[..channels].to_vec(),
            last: values[values.len() - channels..].to_vec(),
        }
    }
}

/// True when this process ignores a signal, as in the background of a shell. The programs that it starts do so as well.
fn is_ignored(signal: Signal) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    mask >> (signal.as_raw() - 1) & 1 == 1
}

/// Returns SIGTERM, and SIGINT where it is not ignored.
fn signals() -> Vec<Signal> {
    let mut list = vec![Signal::INT, Signal::TERM];
    list.retain(|signal| *signal == Signal::TERM || !is_ignored(*signal));
    list
}

/// Waits until buckets are done, ends the run by a signal, and returns its messages.
fn interrupt(mut child: Child, signal: Signal) -> String {
    use std::io::{BufRead, BufReader, Read};
    let mut reader = BufReader::new(child.stderr.take().unwrap());
    let mut said = String::new();
    while !said.contains("% rendered") {
        assert!(reader.read_line(&mut said).unwrap() > 0, "it ended early: {said}");
    }
    kill_process(Pid::from_child(&child), signal).unwrap();
    let begin = Instant::now();
    reader.read_to_string(&mut said).unwrap();
    let status = child.wait().unwrap();
    assert_eq!(std::os::unix::process::ExitStatusExt::signal(&status), Some(signal.as_raw()), "{said}");
    assert!(begin.elapsed() < Duration::from_secs(30), "{said}");
    said
}

const PARTIAL: [&str; 3] = ["a.partial.tif", "c.partial.png", "sub/b.partial.exr"];

#[test]
fn without_the_option_an_interrupted_frame_leaves_nothing() {
    for signal in signals() {
        let place = Place::new("");
        let said = interrupt(place.start(&["-threads", "2"]), signal);
        assert!(place.files().is_empty() && !said.contains("partial"), "{:?} {said}", place.files());
    }
}

#[test]
fn partial_images_have_names_descriptions_and_messages_of_their_own() {
    for (signal, threads) in signals().into_iter().zip(["3", "1"]) {
        let place = Place::new("");
        // An image of an earlier run is not touched.
        std::fs::write(place.path().join("a.tif"), "older").unwrap();
        let said = interrupt(place.start(&["-keeppartial", "-threads", threads]), signal);
        let mut expected = vec!["a.tif"];
        expected.splice(0..0, [PARTIAL[0]]);
        expected.extend(&PARTIAL[1..]);
        assert_eq!(place.files(), expected, "{said}");
        assert_eq!(std::fs::read(place.path().join("a.tif")).unwrap(), b"older");
        for name in PARTIAL {
            let of = format!("\"{name}\" keeps the ");
            assert!(said.contains(&of), "{name}: {said}");
        }
        let image = place.image("a.partial.tif");
        let description = image.description.unwrap();
        let percent = description.strip_prefix("partial image: ").and_then(|rest| rest.split_once(" % "));
        let (percent, rest) = percent.unwrap_or_else(|| panic!("{description}"));
        assert!((1..=50).contains(&percent.parse::<u32>().unwrap()), "{description}");
        assert_eq!(rest, "of the pixels were rendered; a ball");
        assert_eq!(image.size, [128, 96]);
        let close = |value: f32, expected: f32| (value - expected).abs() < 0.01;
        assert!(close(image.first[0], 0.5) && close(image.first[3], 1.0), "{:?}", image.first);
        assert_eq!(image.last, [0.0; 4]);
        let depth = place.image("sub/b.partial.exr");
        assert!(depth.first[0] > 3.9 && depth.first[0] < 4.1 && depth.last == [0.0], "{:?}", depth.first);
        assert!(depth.description.unwrap().starts_with("partial image: "));
        assert!(place.image("c.partial.png").description.unwrap().starts_with("partial image: "));
    }
}

#[test]
fn a_time_limit_and_re_rendering_keep_partial_images() {
    let place = Place::new("Attribute (\"int rerender\", 1)\n");
    let run = place.start(&["-keeppartial", "-timeout", "3", "-threads", "2", "-o", "more.exr"]);
    let ran = run.wait_with_output().unwrap();
    let said = String::from_utf8(ran.stderr).unwrap();
    assert_eq!(ran.status.code(), Some(1), "{said}");
    let mut expected = PARTIAL.to_vec();
    expected.insert(2, "more.partial.exr");
    assert_eq!(place.files(), expected, "{said}");
}

#[test]
fn a_frame_that_is_complete_is_not_partial() {
    let place = Place::new("Attribute (\"float[4] crop\", (0, 0.25, 0, 1))\n");
    let ran = place.start(&["-keeppartial"]).wait_with_output().unwrap();
    let said = String::from_utf8(ran.stderr).unwrap();
    assert_eq!(
        (ran.status.code(), place.files()),
        (Some(0), ["a.tif", "c.png", "sub/b.exr"].map(str::to_owned).to_vec()),
        "{said}"
    );
    assert_eq!(place.image("a.tif").description.as_deref(), Some("a ball"));
}
