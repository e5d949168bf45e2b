//! Tests of `gelato -gpu`.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use std::path::Path;
use std::process::{Command, Stdio};

/// Runs gelato. Returns its exit status, its output and its messages.
fn gelato(folder: &Path, words: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_gelato"))
        .current_dir(folder)
        .args(words)
        .env("HOME", folder)
        .env_remove("GELATOHOME")
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code().unwrap(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn words_that_choose_nothing_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for word in ["sometimes", "1.5", "selftest:x", "list:2"] {
        let (status, _, said) = gelato(folder.path(), &["-gpu", word, "a.pyg"]);
        assert!(status == 2 && said.contains("the number of an adapter"), "{word}: {status} {said}");
    }
    let (status, _, said) = gelato(folder.path(), &["-safe", "-gpu", "auto", "a.pyg"]);
    assert!(status == 2 && said.contains("safe"), "{said}");
}

#[cfg(not(feature = "gpu"))]
#[test]
fn a_program_without_devices_says_how_to_build_them() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.pyg"), "World ()\nRender ()\n").unwrap();
    for word in ["list", "selftest", "0"] {
        let (status, _, said) = gelato(folder.path(), &["-gpu", word, "a.pyg"]);
        assert!(status == 2 && said.contains("--features gpu"), "{word}: {status} {said}");
    }
    for word in ["auto", "off"] {
        let (status, _, said) = gelato(folder.path(), &["-gpu", word, "a.pyg"]);
        assert!(status == 0 && said.is_empty(), "{word}: {status} {said}");
    }
}

#[cfg(feature = "gpu")]
mod with_devices {
    use super::*;

    /// Returns the number of an adapter that traces rays, hardware before software; `None`, and a notice, without one.
    fn adapter(folder: &Path) -> Option<String> {
        let (status, list, _) = gelato(folder, &["-gpu", "list"]);
        assert_eq!(status, 0);
        let mut found: Vec<(bool, String)> = Vec::new();
        let mut last = (false, String::new());
        for line in list.lines() {
            if !line.starts_with(' ') {
                let number = line.split(':').next().unwrap_or_default().to_owned();
                last = (line.contains("(software"), number);
            } else if line.contains("has: own modules, doubles, 64-bit integers") {
                found.push(last.clone());
            }
        }
        found.sort();
        let first = found.into_iter().next().map(|(_, number)| number);
        if first.is_none() {
            granita_needs::skip("Vulkan (no adapter traces rays)");
        }
        first
    }

    /// A scene of meshes whose points have many rays.
    fn scene() -> String {
        let (n, mut points, mut faces) = (40, Vec::new(), Vec::new());
        for v in 0..=n {
            for u in 0..=n {
                let (x, y) = (u as f32 / n as f32 * 4.0 - 2.0, v as f32 / n as f32 * 4.0 - 2.0);
                points.extend([x, y, 5.0 + 0.4 * (3.0 * x).sin() * (4.0 * y).cos()]);
            }
        }
        for v in 0..n {
            for u in 0..n {
                let a = v * (n + 1) + u;
                faces.extend([a, a + 1, a + n + 2, a + n + 1]);
            }
        }
        let join = |numbers: &[String]| numbers.join(", ");
        let points: Vec<String> = points.iter().map(|x: &f32| x.to_string()).collect();
        let faces: Vec<String> = faces.iter().map(|x: &i32| x.to_string()).collect();
        let counts = vec!["4".to_owned(); faces.len() / 4];
        format!(
            "Attribute (\"int[2] resolution\", (64, 48))\nAttribute (\"string projection\", \"perspective\")\n\
             Attribute (\"float fov\", 45)\nOutput (\"out.tif\", \"tiff\", \"rgb\", \"camera\", \
             \"int[4] quantize\", (0, 0, 0, 0))\nWorld ()\nAttribute (\"string geometryset\", \"+all\")\n\
             Shader (\"surface\", \"ambocclude\", \"string occlusionname\", \"all\", \"float samples\", 64, \
             \"float maxerror\", 0)\nMesh (\"linear\", ({}), ({}), \"vertex point P\", ({}))\nRender ()\n",
            join(&counts),
            join(&faces),
            join(&points)
        )
    }

    #[test]
    fn frames_have_the_same_bytes_with_and_without_a_device() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let Some(number) = adapter(folder) else { return };
        std::fs::write(folder.join("a.pyg"), scene()).unwrap();
        let mut images = Vec::new();
        for (which, threads) in [("off", "2"), (&*number, "1"), (&*number, "2")] {
            let words = ["-gpu", which, "-threads", threads, "-statistics", "a.pyg"];
            let (status, out, said) = gelato(folder, &words);
            assert_eq!(status, 0, "{said}");
            let line = [out, said]
                .concat()
                .lines()
                .find(|line| line.trim_start().starts_with("gpu "))
                .map(str::to_owned);
            assert_eq!(line.is_some(), which != "off");
            let rays = line.and_then(|line| {
                let words: Vec<&str> = line.split_whitespace().collect();
                let at = words.iter().position(|word| *word == "rays")?;
                words[at - 1].parse::<u64>().ok()
            });
            assert!(which == "off" || rays.is_some_and(|n| n > 10_000), "{rays:?}");
            images.push(std::fs::read(folder.join("out.tif")).unwrap());
        }
        assert!(images[0] == images[1] && images[0] == images[2]);
    }

    #[test]
    fn an_adapter_that_is_not_there_is_an_error_before_rendering() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.pyg"), scene()).unwrap();
        let (status, _, said) = gelato(folder.path(), &["-gpu", "999", "a.pyg"]);
        assert!(status == 2 && said.contains("there is no adapter 999"), "{status} {said}");
        assert!(!folder.path().join("out.tif").exists());
    }
}
