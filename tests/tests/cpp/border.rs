//! Tests the errors of programs and plugins, and several renderers at once.

use crate::support::*;

/// Writes every call of the scene interface as Pyg, and reports invalid calls.
#[test]
fn every_call_works_from_cpp() {
    let folder = tempfile::tempdir().unwrap();
    let source = own(folder.path(), "calls.cpp");
    for compiler in compilers() {
        let made = program(compiler, &source, "gelato");
        let ran = run(&made, folder.path(), &[]);
        let said = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.success(), "{said}");
        let written = std::fs::read_to_string(folder.path().join("calls.pyg")).unwrap();
        if std::env::var_os("BLESS").is_some() {
            std::fs::write(granita_tests::repository().join("tests/cpp/calls.pyg"), &written).unwrap();
        }
        let golden = granita_tests::repository().join("tests/cpp/calls.pyg");
        assert_eq!(written, std::fs::read_to_string(golden).unwrap());
        for mistake in [
            "Mesh: unknown interpolation \"spline\"",
            "Patch: -2 is not a valid count",
            "parameter \"P\" has no data (NULL)",
            "\"x\" needs a type",
            "cannot read declaration \"quux y\"",
            "the generator is NULL",
            "the generator's run threw an exception: no such luck",
        ] {
            assert!(said.contains(mistake), "{mistake}: {said}");
        }
    }
}

/// A patch may have two bases, one along u and one along v.
#[test]
fn patches_with_two_bases_work_from_cpp() {
    let folder = tempfile::tempdir().unwrap();
    let source = own(folder.path(), "patches.cpp");
    let ran = run(&program(compilers()[0], &source, "gelato"), folder.path(), &[]);
    let said = String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success() && said.contains("Patch: unknown interpolation \"spline\""), "{said}");
    let written = std::fs::read_to_string(folder.path().join("patches.pyg")).unwrap();
    assert_eq!(written.matches("Patch (").count(), 16, "{written}");
    let bases = ["linear", "bezier", "bspline", "catmull-rom"];
    for (u, v) in bases.iter().flat_map(|u| bases.map(|v| (*u, v))) {
        let words = if u == v { u.to_owned() } else { format!("{u},{v}") };
        assert!(written.contains(&format!("Patch (\"{words}\", 4, 4")), "{words}: {written}");
    }
}

/// Compiles a program of the tests with each compiler and runs it, also under valgrind. These plugins are in its
/// folder.
fn works(source: &str, plugins: &[(&str, &str)]) {
    let folder = tempfile::tempdir().unwrap();
    let source = own(folder.path(), source);
    for compiler in compilers() {
        for (source, name) in plugins {
            plugin(compiler, &own(folder.path(), source), name, &[]);
        }
        let made = program(compiler, &source, "gelato");
        let ran = run(&made, folder.path(), &[]);
        assert!(ran.status.success(), "{compiler}: {}", String::from_utf8_lossy(&ran.stderr));
        if compiler == "g++" {
            valgrind(&made, folder.path());
        }
    }
}

/// Two renderers take calls in turns and keep their messages apart. One of them renders while the program continues.
#[test]
fn two_renderers_in_one_program_are_independent() {
    works("two.cpp", &[]);
}

/// A renderer in another process returns its results and messages. Its end does not end the program.
#[test]
#[cfg(target_os = "linux")]
fn a_remote_renderer_returns_results_and_messages() {
    works("remote.cpp", &[]);
}

/// Programs read and write images through plugins and bundled formats.
#[test]
fn programs_read_and_write_images_through_plugins() {
    works("images.cpp", &[("chest.cpp", "chest.imageio.so")]);
}

/// Each invalid plugin causes one message that names the file, and the work continues.
#[test]
fn invalid_plugins_are_reported_and_skipped() {
    let folder = tempfile::tempdir().unwrap();
    let source = own(folder.path(), "bad.cpp");
    let render = |format: &str| {
        let scene = format!(
            "Attribute (\"int[2] resolution\", (8, 6))\nOutput (\"out\", \"{format}\", \"rgb\", \"c\")\n\
             Output (\"good.tif\", \"tiff\", \"rgb\", \"c\")\nWorld ()\nTranslate (0, 0, 3)\n\
             Sphere (1, -1, 1, 360)\nRender ()\n"
        );
        std::fs::write(folder.path().join("a.pyg"), scene).unwrap();
        let _ = std::fs::remove_file(folder.path().join("good.tif"));
        let (status, _, err) = tool("gelato", folder.path(), &["a.pyg"]);
        assert!(status == 1 && folder.path().join("good.tif").is_file(), "{format}: {status} {err}");
        err
    };
    for (define, wanted) in [
        ("VERSION", "its imageio_version is 2, and this suite takes 3"),
        ("NOVERSION", "it has no symbol imageio_version"),
        ("NOCREATE", "it has neither of the symbols bad_output_imageio_create and bad_input_imageio_create"),
        ("UNDEFINED", "it cannot be loaded: undefined symbol: nobody_has_this"),
        ("NULLOBJECT", "its create function gave no ImageOutput (NULL)"),
        ("THROWS_CREATE", "its create function threw an exception: not today"),
        ("THROWS_OPEN", "open threw an exception: not today"),
        ("FAILS_OPEN", "open failed: no room for out"),
        ("FAILS_WRITE", "write_scanline failed without a reason (row 0)"),
        ("THROWS_WRITE", "write_scanline threw an exception: something that is no std::exception"),
        ("THROWS_CLOSE", "close threw an exception: not today"),
    ] {
        let file = plugin(compilers()[0], &source, "bad.imageio.so", &[&format!("-D{define}")]);
        let err = render("bad");
        assert!(err.contains(wanted) && err.contains("bad.imageio.so"), "{define}: {err}");
        assert_eq!(err.matches("bad.imageio.so").count(), 1, "{define}: {err}");
        std::fs::remove_file(file).unwrap();
    }
    std::fs::write(folder.path().join("bad.imageio.so"), "no library").unwrap();
    let err = render("bad");
    assert!(err.contains("bad.imageio.so is not used: it cannot be loaded"), "{err}");
    let err = render("0x1234");
    assert!(err.contains("is not an ImageOutput of the program"), "{err}");
}

/// A format in C is written in rectangles, read by other tools, and found through "path:imageio".
#[test]
fn a_format_plugin_in_c_reads_and_writes() {
    let folder = tempfile::tempdir().unwrap();
    let (at, library) = (folder.path(), folder.path().join("lib"));
    std::fs::create_dir(&library).unwrap();
    let source = own(&library, "plain.c");
    for compiler in compilers() {
        let compiler = if compiler == "g++" { "gcc" } else { "clang" };
        // The plugin is also beside the scene. $GELATOHOME/lib is searched without any option.
        plugin(compiler, &source, "plain.imageio.so", &["-Wall", "-Werror"]);
        let absolute = format!("Attribute (\"string path:imageio\", \"nowhere:{}\")\n", library.display());
        for path in [&*absolute, ""] {
            let scene = format!(
                "{path}Attribute (\"int[2] resolution\", (40, 30))\n\
                 Attribute (\"int[2] limits:bucketsize\", (16, 16))\n\
                 Output (\"a.pln\", \"plain\", \"rgba\", \"c\")\nOutput (\"a.exr\", \"exr\", \"rgba\", \"c\")\n\
                 Parameter (\"string pixeltype\", \"float\")\n\
                 World ()\nTranslate (0, 0, 3)\nSphere (1, -1, 1, 360)\nRender ()\n"
            );
            std::fs::write(at.join("a.pyg"), scene).unwrap();
            let _ = std::fs::remove_file(at.join("a.pln"));
            let (status, _, err) = tool("gelato", at, &["a.pyg"]);
            assert_eq!((status, err.as_str()), (0, ""));
            let bytes = std::fs::read(at.join("a.pln")).unwrap();
            assert!(bytes.starts_with(b"PLAIN 40 30 4 R G B A\n"));
            assert!(bytes.ends_with(b"pieces 6\n"), "six buckets, each when it was done");
        }
        let read = |name: &str, output: &str| {
            let (status, _, err) = tool("maketx", at, &["-noresize", "-o", output, name]);
            assert_eq!((status, err.as_str()), (0, ""), "{name}");
            let formats = granita_plugin::bundled_formats(granita_image::Limits::default());
            formats.open(&at.join(output)).unwrap().read_level(0, 0).unwrap().to_floats()
        };
        let (a, b) = (read("a.pln", "a.tx"), read("a.exr", "b.tx"));
        assert!(a.len() == 40 * 30 * 4 && a.iter().any(|v| *v > 0.5));
        let worst = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(a.len() == b.len() && worst < 0.002, "{worst}");
        // A damaged file is reported with the message of the plugin.
        let bytes = std::fs::read(at.join("a.pln")).unwrap();
        std::fs::write(at.join("short.pln"), &bytes[..bytes.len() / 2]).unwrap();
        let (status, _, err) = tool("maketx", at, &["short.pln"]);
        assert!(status != 0 && err.contains("it is cut short") && err.contains("plain.imageio.so"), "{err}");
    }
}

/// A plugin adds a format with tiles and levels. It is found by its list of extensions, and by trying.
#[test]
fn a_format_plugin_in_cpp_reads_and_writes() {
    let folder = tempfile::tempdir().unwrap();
    let source = own(folder.path(), "chest.cpp");
    for compiler in compilers() {
        plugin(compiler, &source, "chest.imageio.so", &[]);
        let scene = "Attribute (\"int[2] resolution\", (40, 30))\nOutput (\"a.chs\", \"chest\", \"rgba\", \"c\")\n\
                     Parameter (\"int[4] quantize\", (0, 0, 0, 0))\nOutput (\"a.tif\", \"tiff\", \"rgba\", \"c\")\n\
                     World ()\nTranslate (0, 0, 3)\nSphere (1, -1, 1, 360)\nRender ()\n";
        std::fs::write(folder.path().join("a.pyg"), scene).unwrap();
        let (status, _, err) = tool("gelato", folder.path(), &["a.pyg"]);
        assert_eq!((status, err.as_str()), (0, ""));
        // The file is found by its extension, and without an extension by trying.
        std::fs::rename(folder.path().join("a.chs"), folder.path().join("nameless")).unwrap();
        for (input, output, format) in
            [("a.tif", "t.chs", "chest"), ("t.chs", "u.tx", "tiff"), ("nameless", "v.tx", "tiff")]
        {
            let (status, _, err) = tool("maketx", folder.path(), &["-format", format, "-o", output, input]);
            assert_eq!((status, err.as_str()), (0, ""), "{input} {output}");
        }
        let read = |name: &str| {
            let formats = granita_plugin::bundled_formats(granita_image::Limits::default());
            let input = formats.open(&folder.path().join(name)).unwrap();
            (input.levels(0), input.read_level(0, 0).unwrap().to_floats())
        };
        let (a, b) = (read("u.tx"), read("v.tx"));
        assert!(a.0 > 3 && a.0 == b.0);
        let worst = a.1.iter().zip(&b.1).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 0.01, "{worst}");
    }
}
