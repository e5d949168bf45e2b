//! Tests that a full disk, a device without space and a killed program leave no incomplete image under the final name.
#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_image::{CreateOptions, Format, ImageError, ImageSpec, Limits, PixelType, Pixels};
use granita_plugin::bundled_formats;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;

fn writers() -> Vec<Arc<dyn Format>> {
    let registry = bundled_formats(Limits::default());
    registry.formats().iter().filter(|f| f.supports("write") && !f.supports("rectangles")).cloned().collect()
}

/// Writes noise, which does not compress.
fn noise(path: &Path, side: u32) {
    let spec = ImageSpec::new(side, side, 3, PixelType::Float);
    let word = |i: u32| granita_base::hash::words(&[i]) as f32 / u32::MAX as f32;
    let values = (0..side * side * 3).map(word).collect();
    let tiff = bundled_formats(Limits::default());
    let mut out = tiff.create(path, "tiff", &CreateOptions::new(&spec, 1)).unwrap();
    out.write_rows(&Pixels::Float(values)).unwrap();
    out.close().unwrap();
}

/// Returns the example program, which is built with the tests.
fn imagecopy() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    test.parent().unwrap().parent().unwrap().join("examples").join("imagecopy")
}

#[test]
fn a_full_disk_leaves_no_file() {
    let dir = tempfile::tempdir().unwrap();
    let input = dir.path().join("noise.tif");
    noise(&input, 128);
    for format in writers() {
        let folder = dir.path().join(format.name());
        std::fs::create_dir(&folder).unwrap();
        let output = folder.join("out.pic");
        // The system permits files of up to four blocks of 1024 (or 512) bytes.
        let run = Command::new("sh")
            .args(["-c", "trap '' XFSZ; ulimit -f 4; exec \"$0\" \"$@\""])
            .arg(imagecopy())
            .args([&input, &output])
            .arg(format.name())
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(1), "{}: {text}", format.name());
        assert!(text.contains("out.pic") && text.contains("large"), "{}: {text}", format.name());
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 0, "{}", format.name());
        // Without the limit the same file is written.
        let run = Command::new(imagecopy()).args([&input, &output]).arg(format.name()).status().unwrap();
        assert!(run.success() && output.is_file(), "{}", format.name());
    }
}

#[test]
fn a_device_without_room_is_an_error() {
    for format in writers() {
        let spec = ImageSpec::new(64, 64, 3, format.output_type(PixelType::U8));
        let write = || -> granita_image::Result<()> {
            let options = CreateOptions::new(&spec, 1);
            let mut out = format.create(Path::new("/dev/full"), &options)?;
            out.write_rows(&Pixels::zeros(spec.pixel_type, 64 * 64 * 3))?;
            out.close()
        };
        let error = write().unwrap_err();
        assert!(matches!(error, ImageError::Io { .. }), "{}: {error}", format.name());
    }
}

#[test]
fn a_killed_program_leaves_the_old_file() {
    let dir = tempfile::tempdir().unwrap();
    let input = dir.path().join("noise.tif");
    noise(&input, 1024);
    for format in ["tiff", "exr", "png", "sgi"] {
        let folder = dir.path().join(format);
        std::fs::create_dir(&folder).unwrap();
        let output = folder.join("out.pic");
        let old = b"what was there before";
        std::fs::write(&output, old).unwrap();
        let mut run = Command::new(imagecopy())
            .args([&input, &output])
            .arg(format)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        // The file is being written as soon as there is another file beside the old one.
        while std::fs::read_dir(&folder).unwrap().count() < 2 && run.try_wait().unwrap().is_none() {
            std::thread::yield_now();
        }
        run.kill().unwrap();
        run.wait().unwrap();
        let now = std::fs::read(&output).unwrap();
        // The old file is unchanged, or the new one is complete.
        if now != old {
            let registry = bundled_formats(Limits::default());
            registry.open(&output).unwrap().read_level(0, 0).unwrap();
        }
    }
}
