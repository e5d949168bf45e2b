//! Tests of many frames (`gelato -frames`), of jobs for engines (`-submit`), and of the files of a scene (`-assets`).

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_tests::{Image, Tools};
use std::path::Path;

/// A scene whose image and colour depend on the frame. Frame 13 has an error.
const SCENE: &str = "Attribute (\"int[2] resolution\", (16, 16))\n\
    Output (\"out/a.$frame4.tif\", \"tiff\", \"rgb\", \"camera\", \"int[4] quantize\", (0, 0, 0, 0))\n\
    Translate (0, 0, 1)\nWorld ()\nAttribute (\"string name\", \"of ${frame}\")\n\
    Attribute (\"color C\", (0.$frame2, 0, 0))\nShader (\"surface\", \"constant\")\nSphere (9, -9, 9, 360)\nRender ()\n";

fn place() -> (Tools, tempfile::TempDir) {
    let (tools, folder) = (Tools::build().unwrap(), tempfile::tempdir().unwrap());
    for number in 11..=14 {
        // The number in a number is in the name of the file here: only texts of a scene have marks.
        let scene = SCENE.replace("$frame2", &number.to_string());
        let scene = if number == 13 { scene.replace("Sphere (9", "Sphere (9, 9, 9") } else { scene };
        std::fs::write(folder.path().join(format!("a.00{number}.pyg")), scene).unwrap();
    }
    std::fs::create_dir(folder.path().join("out")).unwrap();
    (tools, folder)
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort_unstable();
    names
}

#[test]
fn frames_of_a_range_are_rendered_one_after_the_other() {
    let (tools, folder) = place();
    let out = folder.path().join("out");
    let words = ["-progress", "percent", "-frames", "12-11,14", "-o", "out/b.#.png", "a.####.pyg"];
    let ran = tools.run(folder.path(), "gelato", &words).unwrap();
    assert!(ran.status == 0 && ran.stderr.is_empty(), "{}", ran.stderr);
    assert_eq!(names(&out), ["a.0011.tif", "a.0012.tif", "a.0014.tif", "b.11.png", "b.12.png", "b.14.png"]);
    for number in [11, 12, 14] {
        let image = Image::read(&out.join(format!("a.00{number}.tif"))).unwrap();
        assert_eq!(image.pixel(8, 8).unwrap()[0], number as f32 / 100.0);
    }
    let steps: Vec<f64> = ran
        .stdout
        .lines()
        .map(|line| line.strip_prefix("progress: ").unwrap().strip_suffix(" %").unwrap().parse().unwrap())
        .collect();
    assert!(steps.is_sorted() && steps.last() == Some(&100.0), "{}", ran.stdout);
    // A task renders its part only.
    std::fs::remove_dir_all(&out).unwrap();
    std::fs::create_dir(&out).unwrap();
    let task = |task: &str| {
        tools.run(
            folder.path(),
            "gelato",
            &["-frames", "11,12,14", "-chunk", "2", "-task", task, "a.####.pyg"],
        )
    };
    assert_eq!(task("1").unwrap().status, 0);
    assert_eq!(names(&out), ["a.0014.tif"]);
    let ran = task("2").unwrap();
    assert_eq!(ran.status, 2);
    assert!(ran.stderr.contains("-task 2: there are 2 tasks"), "{}", ran.stderr);
}

#[test]
fn a_frame_with_errors_costs_no_other() {
    let (tools, folder) = place();
    let ran = tools.run(folder.path(), "gelato", &["-frames", "12-15", "a.####.pyg"]).unwrap();
    assert_eq!(ran.status, 1);
    assert!(ran.stderr.contains("a.0013.pyg") && ran.stderr.contains("a.0015.pyg"), "{}", ran.stderr);
    assert!(ran.stderr.contains("2 of 4 frames have errors"), "{}", ran.stderr);
    let out = names(&folder.path().join("out"));
    assert!(out.contains(&"a.0012.tif".to_owned()) && out.contains(&"a.0014.tif".to_owned()), "{out:?}");
    let ran = tools.run(folder.path(), "gelato", &["-frames", "1-x", "a.####.pyg"]).unwrap();
    assert!(ran.status == 2 && ran.stderr.contains("is no range of frames"), "{}", ran.stderr);
}

#[test]
fn frames_that_are_up_to_date_are_left_out() {
    let (tools, folder) = place();
    let out = folder.path().join("out/a.0011.tif");
    let changed = || std::fs::metadata(&out).unwrap().modified().unwrap();
    let render = || {
        // Times of files have steps.
        std::thread::sleep(std::time::Duration::from_millis(30));
        let ran = tools.run(folder.path(), "gelato", &["-u", "-frames", "11", "a.####.pyg"]).unwrap();
        assert!(ran.status == 0 && ran.stderr.is_empty(), "{}", ran.stderr);
        changed()
    };
    let first = render();
    assert_eq!(render(), first);
    let scene = folder.path().join("a.0011.pyg");
    std::fs::write(&scene, std::fs::read(&scene).unwrap()).unwrap();
    let second = render();
    assert!(second > first);
    assert_eq!(render(), second);
    // A scene with a command is always rendered.
    let text = std::fs::read_to_string(&scene).unwrap();
    std::fs::write(&scene, format!("Command (\"mkdir\", \"string name\", \"new\")\n{text}")).unwrap();
    let third = render();
    assert!(render() > third);
}

#[test]
fn the_files_of_a_scene_are_listed_without_rendering_it() {
    let (tools, folder) = place();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("wood.gsl"), "#include \"more.h\"\nsurface wood (string grain = \"grain.tx\") { C = (color) texture (grain, u, v) + (color) texture (\"knot.tx\", u, v) + more; }\n").unwrap();
    std::fs::write(at("more.h"), "#define more 0.1\n").unwrap();
    for name in ["grain.tx", "knot.tx", "other.tx", "tile.1001.tx", "tile.1002.tx"] {
        std::fs::write(at(name), "no texture").unwrap();
    }
    std::fs::write(at("part.pyg"), "Attribute (\"string user:map\", \"tile.<UDIM>.tx\")\nShader (\"surface\", \"wood\")\nSphere (1, -1, 1, 360)\n").unwrap();
    std::fs::write(
        at("scene.pyg"),
        "Command (\"system touch ran\")\nAttribute (\"string error:filename\", \"log\")\nOutput (\"never.tif\", \"tiff\", \"rgb\", \"camera\")\n\
         World ()\nInput (\"part.pyg\")\nRender ()\n",
    )
    .unwrap();
    let before = names(folder.path());
    let ran = tools.run(folder.path(), "gelato", &["-assets", "scene.pyg"]).unwrap();
    assert!(ran.status == 0 && ran.stderr.is_empty(), "{}", ran.stderr);
    assert_eq!(names(folder.path()), before, "nothing is written");
    let list: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
    let of = |kind: &str| -> Vec<String> {
        let files = list["files"].as_array().unwrap().iter();
        let name = |file: &serde_json::Value| {
            Path::new(file["path"].as_str().unwrap()).file_name().unwrap().to_string_lossy().into_owned()
        };
        let mut names: Vec<String> = files.filter(|file| file["kind"] == kind).map(name).collect();
        names.sort_unstable();
        names
    };
    assert_eq!(of("scene"), ["part.pyg", "scene.pyg"]);
    assert_eq!(of("shader"), ["more.h", "wood.gsl"]);
    assert_eq!(of("texture"), ["grain.tx", "knot.tx", "tile.1001.tx", "tile.1002.tx"]);
    assert_eq!(list["outputs"][0]["name"], "never.tif");
    assert_eq!(list["commands"][0], "system touch ran");
    let knot = list["files"]
        .as_array()
        .unwrap()
        .iter()
        .find(|file| file["name"].as_str().unwrap().ends_with("knot.tx"));
    // The hash of "no texture".
    assert_eq!(knot.unwrap()["bytes"], 10);
    assert_eq!(knot.unwrap()["sha1"].as_str().unwrap().len(), 40);
}

#[test]
fn jobs_are_written_and_submitted_in_their_order() {
    let (tools, folder) = place();
    granita_needs::write_script(
        &folder.path().join("sbatch"),
        "echo \"$@\" >> submitted; echo $(($(wc -l < submitted) + 40))",
    );
    let path = format!("PATH={}:{}", folder.path().display(), std::env::var("PATH").unwrap());
    let job = "{\"name\": \"shot\", \"steps\": [{\"name\": \"maps\", \"commands\": [[\"true\"], [\"echo\", \"it's\"]]},\n\
        {\"name\": \"frames\", \"after\": [\"maps\"], \"frames\": \"11-14\", \"chunk\": 2, \"scene\": [\"a.####.pyg\"]}]}";
    std::fs::write(folder.path().join("shot.json"), job).unwrap();
    // The program is started with the path of the test, as an engine's tool would be.
    let mut command = std::process::Command::new(tools.program("gelato"));
    command.current_dir(folder.path()).args(["-submit", "slurm", "shot.json"]);
    let ran = command.env("PATH", path.strip_prefix("PATH=").unwrap()).output().unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    assert_eq!(String::from_utf8_lossy(&ran.stdout), "maps 41 2 tasks\nframes 42 2 tasks\n");
    assert_eq!(
        std::fs::read_to_string(folder.path().join("submitted")).unwrap(),
        "--parsable shot.maps.sh\n--parsable --dependency=afterok:41 --kill-on-invalid-dep=yes shot.frames.sh\n"
    );
    // The scripts run their tasks.
    for (script, task, expected) in [("shot.maps.sh", "1", "it's\n"), ("shot.frames.sh", "1", "")] {
        let mut command = std::process::Command::new("sh");
        command.current_dir(folder.path()).arg(script).env("SLURM_ARRAY_TASK_ID", task);
        let ran = command.output().unwrap();
        assert_eq!(String::from_utf8_lossy(&ran.stdout), expected, "{script}");
    }
    assert!(names(&folder.path().join("out")).contains(&"a.0014.tif".to_owned()));
    let ran =
        tools.run(folder.path(), "gelato", &["-submit", "openjd", "-frames", "11-14", "a.####.pyg"]).unwrap();
    assert!(ran.status == 0 && ran.stdout == "a.openjd.json\n", "{}{}", ran.stdout, ran.stderr);
    let text = std::fs::read_to_string(folder.path().join("a.openjd.json")).unwrap();
    let template: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(template["specificationVersion"], "jobtemplate-2023-09");
    std::fs::write(folder.path().join("wrong.json"), "{\"name\": \"shot\", \"steps\": []}").unwrap();
    let ran = tools.run(folder.path(), "gelato", &["-submit", "slurm", "wrong.json"]).unwrap();
    assert!(ran.status == 2 && ran.stderr.contains("wrong.json: it has no steps"), "{}", ran.stderr);
}

/// An engine may kill the process of a task only.
#[test]
#[cfg(target_os = "linux")]
fn frames_end_with_the_process_of_their_task() {
    let (tools, folder) = place();
    let here = std::fs::canonicalize(folder.path()).unwrap();
    std::fs::write(here.join("long.pyg"), "Command (\"system sleep 100\")\nWorld ()\nRender ()\n").unwrap();
    let mut command = std::process::Command::new(tools.program("gelato"));
    let mut task = command.current_dir(&here).args(["-frames", "1-2", "long.pyg"]).spawn().unwrap();
    let count = || {
        let processes = std::fs::read_dir("/proc").unwrap().filter_map(Result::ok);
        processes
            .filter(|entry| std::fs::read_link(entry.path().join("cwd")).is_ok_and(|cwd| cwd == here))
            .count()
    };
    let wait = |is_over: &dyn Fn() -> bool| {
        let begin = std::time::Instant::now();
        while !is_over() {
            assert!(begin.elapsed().as_secs() < 30, "{} processes", count());
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
    };
    // The task, its frame, and the command.
    wait(&|| count() >= 3);
    task.kill().unwrap();
    task.wait().unwrap();
    wait(&|| count() == 0);
}
