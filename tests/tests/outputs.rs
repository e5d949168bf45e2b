//! Results that cannot be written are known before the work begins, and no tool writes over what it reads.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_tests::Tools;

fn scene(outputs: &str) -> String {
    format!(
        "Camera (\"c\", \"int[2] resolution\", (16, 12))\n{outputs}World ()\nTranslate (0, 0, 3)\n\
         Sphere (1, -1, 1, 360)\nRender ()\n"
    )
}

#[test]
fn outputs_that_cannot_be_written_are_found_before_the_first_bucket() {
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

#[test]
fn no_tool_writes_over_what_it_reads() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let shader = "surface s () { C = 1; }\n";
    let image = "P3\n2 1\n255\n1 2 3 4 5 6\n";
    for (tool, name, text, arguments) in [
        ("gslc", "s.gsl", shader, &["-o", "s.gsl", "s.gsl"][..]),
        ("gslc", "s.gsl", shader, &["-o", "./s.gsl", "s.gsl"]),
        ("maketx", "i.ppm", image, &["i.ppm", "-o", "i.ppm"]),
        ("topyg", "t.pyg", "World ()\n", &["-o", "t.pyg", "t.pyg"]),
    ] {
        std::fs::write(folder.path().join(name), text).unwrap();
        let ran = tools.run(folder.path(), tool, arguments).unwrap();
        assert!(ran.status == 2 && ran.stderr.contains("not overwritten"), "{tool}: {}", ran.stderr);
        assert_eq!(std::fs::read_to_string(folder.path().join(name)).unwrap(), text, "{tool}");
    }
}
