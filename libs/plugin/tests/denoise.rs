//! Tests the use of Open Image Denoise, with a library for tests that has its functions, and with the real one where
//! `GRANITA_OIDN` names its folder.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use granita_base::hash;
use granita_image::{Denoiser, NoisyImage};
use granita_plugin::OpenImageDenoise;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Compiles the library for tests into a file. Returns its name.
fn library(folder: &Path, name: &str, words: &[&str]) -> PathBuf {
    let file = folder.join(name);
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/denoiser.c");
    let mut command = Command::new("cc");
    command.args(["-shared", "-fPIC", "-o"]).arg(&file).args(words).arg(source);
    assert!(command.status().unwrap().success());
    file
}

fn image<'a>(color: &'a [f32], albedo: &'a [f32], normal: &'a [f32], width: usize) -> NoisyImage<'a> {
    let height = color.len() / 3 / width;
    NoisyImage { width, height, color, albedo, normal, has_noisy_features: false, threads: 2 }
}

#[test]
fn both_versions_are_called_with_all_planes() {
    if !granita_needs::has("cc") {
        return;
    }
    for (version, words) in [("1.4.3", &[][..]), ("2.5.1", &["-DNEW"][..])] {
        let folder = tempfile::tempdir().unwrap();
        let file = library(folder.path(), "libOpenImageDenoise.so.9", words);
        for place in [folder.path(), &file] {
            let found = OpenImageDenoise::find(Some(place)).unwrap();
            assert_eq!(found.name(), format!("Open Image Denoise {version}"));
            let planes = [1.0, 2.0, 3.0].map(|v| vec![v; 3 * 3 * 2]);
            let clean = found.denoise(&image(&planes[0], &planes[1], &planes[2], 3)).unwrap();
            assert_eq!(clean, vec![0.5 + 0.5 + 0.75; 3 * 3 * 2]);
            // Noisy features are filtered before, and are clean then.
            let noisy =
                NoisyImage { has_noisy_features: true, ..image(&planes[0], &planes[1], &planes[2], 3) };
            assert_eq!(found.denoise(&noisy), Ok(vec![0.5 + 1.5 + 2.0; 3 * 3 * 2]));
            // An error of the library is its text, and the next image is denoised.
            let wrong = vec![-1.0; 3 * 3 * 2];
            assert_eq!(
                found.denoise(&image(&wrong, &planes[1], &planes[2], 3)),
                Err("a colour is -1".to_owned())
            );
            assert!(found.denoise(&image(&planes[0], &planes[1], &planes[2], 3)).is_ok());
            let short = found.denoise(&image(&planes[0], &planes[1][3..], &planes[2], 3));
            assert!(short.unwrap_err().contains("do not have the pixels"));
        }
    }
}

#[test]
fn other_libraries_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |place: &Path| OpenImageDenoise::find(Some(place)).unwrap_err();
    assert!(refused(folder.path()).contains("there is no library libOpenImageDenoise.*"));
    assert!(refused(&folder.path().join("x.so")).contains("x.so: "));
    std::fs::write(folder.path().join("libOpenImageDenoise.so"), "text").unwrap();
    assert!(refused(folder.path()).contains("libOpenImageDenoise.so: "));
    if !granita_needs::has("cc") {
        return;
    }
    for (name, words, what) in [
        ("a.so", &["-DVERSION=10302"][..], "version 1.3.2; 1.4 and 2 are supported"),
        ("b.so", &["-DNEW", "-DVERSION=30000"][..], "version 3.0.0; 1.4 and 2 are supported"),
        ("c.so", &["-DoidnNewFilter=other"][..], "it has no function oidnNewFilter"),
    ] {
        let text = refused(&library(folder.path(), name, words));
        assert!(text.ends_with(&format!("{name}: {what}")), "{text}");
    }
}

#[test]
fn noise_is_removed_and_edges_stay() {
    let Some(place) = std::env::var_os("GRANITA_OIDN") else {
        return granita_needs::skip("OpenImageDenoise (its folder in GRANITA_OIDN)");
    };
    let found = OpenImageDenoise::find(Some(Path::new(&place))).unwrap();
    let (width, height) = (96, 64);
    let edge = |k: usize| if k / 3 % width < 48 { 1.0 } else { 0.25_f32 };
    let noise = |k: usize| 1.0 + 0.4 * (hash::unit(hash::words(&[k as u32])) - 0.5);
    let n = 3 * width * height;
    let color: Vec<f32> = (0..n).map(|k| edge(k) * noise(k)).collect();
    let albedo: Vec<f32> = (0..n).map(edge).collect();
    let clean = found.denoise(&image(&color, &albedo, &vec![0.0; n], width)).unwrap();
    let error = |all: &[f32]| {
        let squares = all.iter().enumerate().map(|(k, v)| f64::from(v - edge(k)).powi(2));
        (squares.sum::<f64>() / n as f64).sqrt()
    };
    assert!(error(&clean) < 0.25 * error(&color), "{} {}", error(&clean), error(&color));
}
