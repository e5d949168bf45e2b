//! Tests that results that cannot be written are reported before the work begins, and that no tool overwrites its
//! input.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on fails")]

use granita_image::{CreateOptions, ImageSpec, Limits, PixelType, Pixels};
use granita_tests::Tools;

fn scene(outputs: &str) -> String {
    format!(
        "Camera (\"c\", \"int[2] resolution\", (16, 12))\n{outputs}World ()\nTranslate (0, 0, 3)\n\
         Sphere (1, -1, 1, 360)\nRender ()\n"
    )
}

#[test]
fn unwritable_outputs_are_reported_before_the_first_bucket() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let run = |outputs: &str| {
        std::fs::write(folder.path().join("s.pyg"), scene(outputs)).unwrap();
        let ran = tools.run(folder.path(), "gelato", &["-statistics-json", "s.json", "s.pyg"]).unwrap();
        (ran.status, ran.stderr, std::fs::read_to_string(folder.path().join("s.json")).unwrap())
    };
    let missing = "Output (\"no/such/a.tif\", \"tiff\", \"rgb\", \"c\")\n";
    let unfit = "Output (\"a.jpg\", \"jpeg\", \"rgba,z,N,P\", \"c\")\n";
    std::fs::create_dir(folder.path().join("b.tif")).unwrap();
    let taken = "Output (\"b.tif\", \"tiff\", \"rgb\", \"c\")\n";
    for bad in [missing, taken] {
        let (status, said, done) = run(bad);
        assert_eq!(status, 1, "{said}");
        assert_eq!(said.matches("gelato: error").count(), 1, "{said}");
        assert!(!done.contains("buckets"), "nothing is rendered for nothing: {done}");
        let (status, said, done) = run(&format!("{bad}Output (\"good.tif\", \"tiff\", \"rgb\", \"c\")\n"));
        assert!(status == 1 && said.matches("gelato: error").count() == 1, "{said}");
        assert!(done.contains("good.tif") && folder.path().join("good.tif").is_file(), "{done}");
        std::fs::remove_file(folder.path().join("good.tif")).unwrap();
    }
    let (status, said, _) = run(unfit);
    assert!(status != 0 && said.contains("a.jpg"), "{said}");
    let names =
        std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.collect();
    names.sort();
    assert_eq!(names, ["b.tif", "s.json", "s.pyg"], "nothing else is left");
}

/// Returns the bytes of a PNG image of 2 x 1 pixels.
fn png() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.png");
    let spec = ImageSpec::new(2, 1, 3, PixelType::U8);
    let formats = granita_plugin::bundled_formats(Limits::default());
    let mut file = formats.create(&path, "png", &CreateOptions::new(&spec, 1)).unwrap();
    file.write_rows(&Pixels::U8(vec![1, 2, 3, 4, 5, 6])).unwrap();
    file.close().unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn no_tool_overwrites_its_input() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let shader = "surface s () { C = 1; }\n";
    let image = "P3\n2 1\n255\n1 2 3 4 5 6\n";
    let png = png();
    for (tool, name, text, arguments) in [
        ("gslc", "s.gsl", shader.as_bytes(), &["-o", "s.gsl", "s.gsl"][..]),
        ("gslc", "s.gsl", shader.as_bytes(), &["-o", "./s.gsl", "s.gsl"]),
        ("maketx", "i.ppm", image.as_bytes(), &["i.ppm", "-o", "i.ppm"]),
        ("maketx", "x.png", &png, &["x.png", "-o", "x.png"]),
        ("maketx", "x.png", &png, &["x.png", "-o", "./x.png"]),
        ("topyg", "t.pyg", b"World ()\n", &["-o", "t.pyg", "t.pyg"]),
    ] {
        std::fs::write(folder.path().join(name), text).unwrap();
        let ran = tools.run(folder.path(), tool, arguments).unwrap();
        let said = &ran.stderr;
        assert!(
            ran.status == 2 && said.lines().count() == 1 && said.contains("not overwritten"),
            "{tool}: {said}"
        );
        assert_eq!(std::fs::read(folder.path().join(name)).unwrap(), text, "{tool}");
    }
}

/// A name that ends in a slash is a folder, which is created. The textures in it have the names of their inputs.
#[test]
fn maketx_creates_the_output_folder() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("x.png"), png()).unwrap();
    for arguments in
        [&["x.png", "-o", "x.tx"][..], &["x.png", "-o", "new/deep/"], &["-o", "new/deep/", "x.png"]]
    {
        let ran = tools.run(folder.path(), "maketx", arguments).unwrap();
        assert_eq!((ran.status, &*ran.stderr), (0, ""), "{arguments:?}");
    }
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(read("new/deep/x.tx") == read("x.tx"));
    assert_eq!(std::fs::read_dir(folder.path().join("new/deep")).unwrap().count(), 1);
    // A file has the name of the folder.
    let ran = tools.run(folder.path(), "maketx", &["x.png", "-o", "x.png/"]).unwrap();
    assert!(ran.status == 2 && ran.stderr.contains("the folder cannot be made"), "{}", ran.stderr);
}

/// "debug:dso" and `-debugdso` print one line for each file that is tried.
#[test]
fn debugdso_prints_a_line_for_every_plugin() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in [
        ("a.imageio.so", "no library\n"),
        ("b.so", "no library\n"),
        ("s.gsl", "surface s () { C = missing (1); }\n"),
        (
            "s.pyg",
            "Attribute (\"int debug:dso\", 1)\nOutput (\"a.a\", \"a\", \"rgb\", \"c\")\nWorld ()\nRender ()\n",
        ),
    ] {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    std::fs::write(folder.path().join("x.png"), png()).unwrap();
    let maketx = &["-debugdso", "-plugins", ".", "-format", "a", "-o", "x.tx", "x.png"][..];
    for (tool, arguments, expected) in [
        ("maketx", maketx, "dso: ./a.imageio.so: refused: "),
        ("gelato", &["-plugins", ".", "s.pyg"], "dso: ./a.imageio.so: refused: "),
        ("gslc", &["-debugdso", "-plugins", ".", "s.gsl"], "dso: ./b.so: refused: "),
    ] {
        let ran = tools.run(folder.path(), tool, arguments).unwrap();
        let said = ran.stdout + &ran.stderr;
        assert!(said.ends_with('\n'), "{tool}: {said}");
        let line = said.lines().find(|line| line.contains(expected));
        let line = line.unwrap_or_else(|| panic!("{tool}: {said}"));
        assert_eq!(line.matches("dso: ").count(), 1, "{tool}: {said}");
        assert!(line.starts_with("dso: ") || line.starts_with(&format!("{tool}: dso: ")), "{tool}: {said}");
    }
}

#[test]
fn the_name_of_each_written_image_is_shown_on_a_terminal_unless_the_run_is_silent() {
    // `script` of util-linux runs a command in a terminal of its own.
    if !cfg!(target_os = "linux") || !granita_needs::has("script") {
        return;
    }
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let outputs =
        "Output (\"a.tif\", \"tiff\", \"rgb\", \"c\")\nOutput (\"no/b.tif\", \"tiff\", \"z\", \"c\")\n";
    std::fs::write(folder.path().join("s.pyg"), scene(outputs)).unwrap();
    let shown = |options: &str| {
        let line = format!("'{}' {options} s.pyg", tools.program("gelato").display());
        let mut script = std::process::Command::new("script");
        let script =
            script.args(["-qec", &line, "/dev/null"]).current_dir(folder.path()).env("TERM", "xterm");
        String::from_utf8(script.stdin(std::process::Stdio::null()).output().unwrap().stdout).unwrap()
    };
    let text = shown("-o c.png");
    let at = |what: &str| text.find(what).unwrap_or_else(|| panic!("{what}: {text}"));
    assert!(at("wrote a.tif") < at("wrote c.png") && !text.contains("wrote no/b.tif"), "{text}");
    assert!(!shown("-silent").contains("wrote"));
    assert!(!tools.run(folder.path(), "gelato", &["s.pyg"]).unwrap().stdout.contains("wrote"));
}
