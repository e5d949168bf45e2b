//! Tests the programs of the reference, which are read from its text at run time. They must compile unchanged, run, and
//! do what the text describes.

use crate::support::*;
use granita_image::Limits;
use std::path::Path;

fn pixels(path: &Path) -> (granita_image::ImageSpec, Vec<f32>) {
    let input = granita_plugin::bundled_formats(Limits::default()).open(path).unwrap();
    (input.spec(0, 0).unwrap().clone(), input.read_level(0, 0).unwrap().to_floats())
}

/// 2.12: a cylinder under two lights, with 640 x 480 pixels.
#[test]
fn the_scene_of_chapter_2_renders() {
    let Some(text) = chapter("02-scene-api.txt") else { return };
    let source = listing(&text, "2.12 Example Scene", "#include <stdio.h>", None);
    let mut first: Option<Vec<f32>> = None;
    for compiler in compilers() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.cpp");
        std::fs::write(&file, &source).unwrap();
        let ran = run(&program(compiler, &file, "gelato"), folder.path(), &[]);
        assert!(ran.status.success() && ran.stderr.is_empty(), "{ran:?}");
        let (spec, values) = pixels(&folder.path().join("test.tif"));
        assert_eq!((spec.width, spec.height, spec.nchannels()), (640, 480, 4));
        let covered = values.chunks(4).filter(|p| p[3] > 0.5).count();
        // The image shows a green cylinder with white highlights.
        assert!((5_000..100_000).contains(&covered), "{covered}");
        let sum = |c: usize| values.chunks(4).map(|p| f64::from(p[c])).sum::<f64>();
        assert!(sum(1) > 1.5 * sum(0) && sum(1) > 1.5 * sum(2), "{} {} {}", sum(0), sum(1), sum(2));
        let first = first.get_or_insert_with(|| values.clone());
        assert_eq!(*first, values, "{compiler}");
    }
}

/// 13.7: the program receives the pixels through its own image class.
#[test]
fn the_callback_of_chapter_13_receives_the_pixels() {
    let Some(text) = chapter("13-imageio-plugins.txt") else { return };
    let source = listing(&text, "13.7 Using ImageIO", "#include <stdio.h>", None);
    for compiler in compilers() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("callback.cpp");
        std::fs::write(&file, &source).unwrap();
        let ran = run(&program(compiler, &file, "gelato"), folder.path(), &[]);
        let said = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.success(), "{said}");
        let rows: Vec<&str> = said.lines().filter(|line| line.starts_with("received pixels")).collect();
        assert!(said.starts_with("Output (0x") && rows.len() == 480, "{} {said}", rows.len());
        // The rows arrive in order, from the top.
        for (y, row) in rows.iter().enumerate() {
            let wanted = format!("{y:3}-{y:3},   0-  0 0x");
            assert!(row.contains(&wanted), "{row} {wanted}");
        }
    }
}

/// 13.6: a JPEG plugin writes and reads files. `maketx` and a render use it.
#[test]
fn the_jpeg_plugin_of_chapter_13_reads_and_writes() {
    let Some(text) = chapter("13-imageio-plugins.txt") else { return };
    if !Path::new("/usr/include/jpeglib.h").is_file() {
        return granita_needs::skip("jpeglib.h");
    }
    let source = listing(&text, "13.6 Example", "#include <assert.h>", Some("13.7 Using"));
    for compiler in compilers() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("jpg.cpp");
        std::fs::write(&file, &source).unwrap();
        plugin(compiler, &file, "jpg.imageio.so", &["-ljpeg"]);
        let scene = "Attribute (\"int[2] resolution\", (40, 30))\nAttribute (\"int debug:dso\", 1)\n\
                     Output (\"a.jpg\", \"jpg\", \"rgb\", \"c\")\n\
                     Output (\"a.tif\", \"tiff\", \"rgb\", \"c\")\nWorld ()\nTranslate (0, 0, 3)\n\
                     Parameter (\"float Kd\", 0.7)\nShader (\"surface\", \"defaultsurface\")\nSphere (1, -1, 1, 360)\n\
                     Render ()\n";
        std::fs::write(folder.path().join("a.pyg"), scene).unwrap();
        let (status, out, err) =
            plain_tool("gelato", folder.path(), &["-plugins", "jpg.imageio.so", "a.pyg"]);
        assert_eq!((status, err.as_str()), (0, ""), "{out}");
        assert!(out.lines().any(|line| line.ends_with("jpg.imageio.so: loaded")), "{out}");
        let (spec, written) = pixels(&folder.path().join("a.jpg"));
        assert_eq!((spec.width, spec.height, spec.nchannels()), (40, 30, 3));
        let (_, exact) = pixels(&folder.path().join("a.tif"));
        let worst = written.iter().zip(&exact).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 0.1, "{worst}");
        // The plugin reads the file that it wrote, and a texture is made of it.
        let (status, _, err) = tool("maketx", folder.path(), &["-o", "a.tx", "a.jpg"]);
        assert_eq!((status, err.as_str()), (0, ""));
        let (spec, texture) = pixels(&folder.path().join("a.tx"));
        assert!(spec.is_tiled() && texture.len() >= written.len());
        let named = ["-plugins", "jpg.imageio.so", "-debugdso", "-o", "b.tx", "a.jpg"];
        let (_, out, _) = plain_tool("maketx", folder.path(), &named);
        assert!(out.lines().any(|line| line.ends_with("jpg.imageio.so: loaded")), "{out}");
        // A library in the folder does not replace a bundled format.
        for ways in [&["-debugdso"][..], &["-debugdso", "-plugins", "."]] {
            let (status, out, _) =
                plain_tool("maketx", folder.path(), &[ways, &["-o", "b.tx", "a.jpg"]].concat());
            assert!(status == 0 && !out.contains("jpg.imageio.so: loaded"), "{out}");
        }
    }
}

/// 15.3: `gsoinfo` of the reference prints the same words as ours.
#[test]
fn gsoinfo_of_chapter_15_prints_the_same() {
    let Some(text) = chapter("15-gsoargs.txt") else { return };
    let source = listing(&text, "15.3 Example", "#include <iostream>", None);
    // The scan doubles backslashes.
    let source = source.replace("'\\\\\\'", "'\\\\'").replace("'\\\\\\\"'", "'\\\"'");
    let source = ["n", "t", "v", "b", "r", "f", "a"]
        .iter()
        .fold(source, |s, c| s.replace(&format!("'\\\\{c}'"), &format!("'\\{c}'")));
    // The scan has also lost a letter.
    let source = source.replace("gsinfo (", "gsoinfo (");
    let folder = tempfile::tempdir().unwrap();
    let shader = "surface every [[ string help = \"two\\nlines \\\"quoted\\\"\" ]] (\n\
        float Kd = 0.5 [[ float min = 0, float max = 1 ]], color tint = color (1, 0.5, 0.25),\n\
        point from = point (\"shader\", 1, 2, 3), string map = \"\", float weights[3] = { 1, 2, 3 },\n\
        string names[2] = { \"a\", \"b\" }, float list[] = { 4, 5 }, output color spec = 0,\n\
        float later = Kd * time, matrix m = 1) { C = Kd * tint; spec = later; }\n";
    std::fs::write(folder.path().join("every.gsl"), shader).unwrap();
    let (status, _, err) = tool("gslc", folder.path(), &["every.gsl"]);
    assert_eq!((status, err.as_str()), (0, ""));
    // The program of the reference prints each element of an array of floats on its own line.
    let words = |text: &str| {
        let text = text.replace('[', " [ ").replace(']', " ] ");
        text.split_whitespace().map(str::to_owned).collect::<Vec<_>>()
    };
    for compiler in compilers() {
        let file = folder.path().join("gsoinfo.cpp");
        std::fs::write(&file, &source).unwrap();
        let theirs = program(compiler, &file, "gsoargs");
        for flags in [&["-p", "."][..], &["-v", "-p", "."]] {
            let arguments = [flags, &["every"]].concat();
            let ran = run(&theirs, folder.path(), &arguments);
            assert!(ran.status.success(), "{ran:?}");
            let (_, ours, _) = tool("gsoinfo", folder.path(), &arguments);
            assert_eq!(words(&String::from_utf8_lossy(&ran.stdout)), words(&ours));
        }
        let ran = run(&theirs, folder.path(), &["nosuch"]);
        assert!(
            String::from_utf8_lossy(&ran.stdout).starts_with("ERROR opening shader \"nosuch\""),
            "{ran:?}"
        );
    }
}

/// 12: the skeleton of a generator for "obj" files, with a call added to its `run`.
#[test]
fn the_generator_of_chapter_12_makes_its_calls() {
    let Some(text) = chapter("12-generator-plugins.txt") else { return };
    let source = listing(&text, "So, for example", "class ObjReader", None);
    let source = source.replace("~~", "~");
    // The "};" at the end of the listing is behind its fence.
    let source = format!("#include \"gelatoapi.h\"\n{source}");
    let source = source.replace(
        "// Here we read",
        "renderer->Comment (\"read %s\", filename); renderer->Sphere (1, -1, 1);\n    // Here we read",
    );
    for compiler in compilers() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("obj.cpp");
        std::fs::write(&file, &source).unwrap();
        plugin(compiler, &file, "obj.generator.so", &[]);
        std::fs::write(folder.path().join("a.obj"), "v 0 0 0\n").unwrap();
        for name in ["a.obj", "obj a.obj"] {
            let (status, out, err) =
                plain_tool("topyg", folder.path(), &["-plugins", "obj.generator.so", name]);
            assert_eq!((status, err.as_str()), (0, ""));
            assert!(out.contains("# read ") && out.contains("Sphere (1, -1, 1, 360)"), "{out}");
        }
    }
}
