//! Tests that the programs and plugins in `examples/cpp` work as their README describes.

use crate::support::*;
use granita_tests::repository;
use std::process::Command;

#[test]
fn the_cpp_examples_give_their_results() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for name in [
        "scene.cpp",
        "callback.cpp",
        "spiral.cpp",
        "fmap.cpp",
        "fbm.cpp",
        "steps.rs",
        "marble.gsl",
        "plugins.pyg",
    ] {
        std::fs::copy(repository().join("examples/cpp").join(name), at.join(name)).unwrap();
    }
    for compiler in compilers() {
        let ran = run(&program(compiler, &at.join("scene.cpp"), "gelato"), at, &[]);
        assert_eq!(
            (String::from_utf8_lossy(&ran.stdout), ran.stderr.len()),
            ("ring.tif is done\n".into(), 0)
        );
        assert!(at.join("ring.tif").is_file());
        let ran = run(&program(compiler, &at.join("callback.cpp"), "gelato"), at, &[]);
        let text = String::from_utf8_lossy(&ran.stdout).into_owned();
        let rows: Vec<&str> = text.lines().collect();
        assert!(rows.len() == 28 && rows.iter().all(|row| row.len() == 64), "{text}");
        assert!(rows[12].contains('@') && rows[0].trim().is_empty(), "{text}");
        for (source, name) in
            [("spiral.cpp", "spiral.generator.so"), ("fmap.cpp", "fmap.imageio.so"), ("fbm.cpp", "fbm.so")]
        {
            plugin(compiler, &at.join(source), name, &["-Wall", "-Werror"]);
        }
        let (status, out, err) = tool("gelato", at, &["plugins.pyg"]);
        assert_eq!((status, out.as_str(), err.as_str()), (0, "", ""));
        // The image of the plugin has the same values as ours, as floats and without alpha.
        let (status, _, err) = tool("maketx", at, &["-noresize", "-o", "a.tx", "plugins.fmap"]);
        assert_eq!((status, err.as_str()), (0, ""));
        let formats = granita_plugin::bundled_formats(granita_image::Limits::default());
        let read = |name: &str| {
            let input = formats.open(&at.join(name)).unwrap();
            (input.spec(0, 0).unwrap().nchannels(), input.read_level(0, 0).unwrap().to_floats())
        };
        let ((n, ours), (m, theirs)) = (read("plugins.tif"), read("a.tx"));
        assert_eq!((n, m, ours.len() / n), (4, 3, theirs.len() / m));
        let worst = ours.chunks(4).zip(theirs.chunks(3)).map(|(a, b)| (a[0] - b[0].clamp(0.0, 1.0)).abs());
        let worst = worst.fold(0.0, f32::max);
        assert!(worst < 0.01, "{worst}");
        // The generator makes one call for each sphere.
        let (_, out, err) = tool("topyg", at, &["spiral 7 0.1"]);
        assert!(out.matches("Sphere (0.1, -0.1, 0.1, 360)").count() == 7 && err.is_empty(), "{out}{err}");
    }
    if !granita_needs::has("rustc") {
        return;
    }
    let made = Command::new("rustc")
        .current_dir(at)
        .args(["--edition", "2024", "--crate-type", "cdylib", "-C", "panic=abort", "-A", "warnings"])
        .args(["-o", "steps.generator.so", "steps.rs"])
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let (_, out, err) = tool("topyg", at, &["steps 12"]);
    assert!(out.matches("Patch (\"linear\", 2, 2").count() == 12 && err.is_empty(), "{out}{err}");
    let (status, _, err) = tool("topyg", at, &["steps many"]);
    assert!(status != 0 && err.contains("steps.generator.so: steps: how many? as in \"steps 12\""), "{err}");
}

/// The plugin over libheif reads what its own program wrote. It needs the library and its headers.
#[test]
fn heif_and_avif_are_read_by_the_example() {
    if !granita_needs::has("heif-enc") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let value = |x: usize, y: usize, c: usize| [x * 4, y * 5, 255 - x * 2 - y][c] as u8;
    let pixels = |y: usize| (0..64).flat_map(move |x| (0..3).map(move |c| value(x, y, c)));
    let formats = granita_plugin::bundled_formats(granita_image::Limits::default());
    let spec = granita_image::ImageSpec::new(64, 48, 3, granita_image::PixelType::U8);
    let options = granita_image::CreateOptions::new(&spec, 1);
    let mut output = formats.create(&at.join("a.png"), "png", &options).unwrap();
    output.write_rows(&granita_image::Pixels::U8((0..48).flat_map(pixels).collect())).unwrap();
    output.close().unwrap();
    std::fs::copy(repository().join("examples/cpp/heif.cpp"), at.join("heif.cpp")).unwrap();
    let compiler = compilers()[0];
    let has_headers = Command::new(compiler)
        .args(["-E", "-include", "libheif/heif.h", "-x", "c++", "/dev/null"])
        .output()
        .is_ok_and(|ran| ran.status.success());
    if !has_headers {
        return granita_needs::skip("libheif-dev");
    }
    for (name, kind) in [("a.avif", &["-A"][..]), ("a.heic", &[])] {
        let mut command = Command::new("heif-enc");
        command.current_dir(at).args(kind).args(["-L", "-p", "chroma=444", "a.png", "-o", name]);
        let made = command.output().unwrap();
        if !made.status.success() {
            granita_needs::skip("heif-enc with the encoders of AV1 and H.265");
            continue;
        }
        let (status, _, err) = plain_tool("maketx", at, &["-noresize", "-o", "a.tx", name]);
        assert!(status != 0 && err.contains("heif.imageio.so"), "{err}");
        plugin(compiler, &at.join("heif.cpp"), "heif.imageio.so", &["-Wall", "-Werror", "-lheif"]);
        let (status, _, err) = tool("maketx", at, &["-noresize", "-o", "a.tx", name]);
        assert_eq!((status, err.as_str()), (0, ""), "{name}");
        let input = formats.open(&at.join("a.tx")).unwrap();
        let granita_image::Pixels::U8(got) = input.read_level(0, 0).unwrap() else { panic!("{name}") };
        let expected: Vec<u8> = (0..48).flat_map(pixels).collect();
        // Colours are stored as luminance and differences, which are rounded.
        let worst = got.iter().zip(&expected).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(got.len() == expected.len() && worst <= Some(1), "{name}: {worst:?}");
        std::fs::remove_file(at.join("heif.imageio.so")).unwrap();
    }
}

/// The program of the manual renders its scene twice.
#[test]
fn the_program_of_the_page_about_rerendering_makes_both_images() {
    let page = std::fs::read_to_string(repository().join("docs/rerender.md")).unwrap();
    let (_, from) = page.split_once("```cpp\n").unwrap();
    let (source, _) = from.split_once("```").unwrap();
    for compiler in compilers() {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        std::fs::write(at.join("twice.cpp"), source).unwrap();
        let ran = run(&program(compiler, &at.join("twice.cpp"), "gelato"), at, &[]);
        assert_eq!(String::from_utf8_lossy(&ran.stderr), "");
        let read = |name: &str| granita_tests::Image::read(&at.join(name)).unwrap();
        let (first, second) = (read("first.tif"), read("second.tif"));
        let mean = |image: &granita_tests::Image| image.mean([0, 0, 64, 48]).unwrap()[0];
        assert!(mean(&second) > 1.2 * mean(&first), "{} {}", mean(&second), mean(&first));
    }
}
