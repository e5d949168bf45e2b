//! Tests that no run hangs or leaves a process behind, however it ends.

#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_tests::{Tools, copy_first};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// A command line of a child process and its own child. They write their numbers to files, and run for ever.
const ENDLESS: &str = "sh -c 'echo $$ > inner; mv inner inner.pid; exec sleep 1000' & echo $$ > outer; mv outer outer.pid; wait";

/// Returns ways to start children that run for ever: a name, the scene, and the activity that is reported at the time
/// limit.
fn scenes() -> Vec<(&'static str, String, &'static str)> {
    let quoted = ENDLESS.replace('"', "\\\"");
    let mut all = vec![
        ("shell", format!("Command (\"system {quoted}\")\nWorld ()\nRender ()\n"), "running \"sh -c"),
        (
            "background",
            format!(
                "Command (\"system\", \"string[3] command\", (\"sh\", \"-c\", \"{quoted}\"), \"int wait\", 0)\n\
                 Command (\"system sleep 1000\")\n"
            ),
            "running \"sleep 1000\"",
        ),
        ("shell's background", format!("Command (\"system ({quoted}) &\")\nCommand (\"system sleep 1000\")\n"), "running \"sleep 1000\""),
        ("generator", format!("World ()\nInput (\"pyg < {quoted}\")\nRender ()\n"), "running \"sh -c"),
        (
            "worker",
            "Attribute (\"string net:workers\", \"local\")\nAttribute (\"string net:workercmd\", \"./fake\")\n\
             Output (\"never.tif\", \"tiff\", \"rgba\", \"camera\")\nWorld ()\nSphere (1, -1, 1, 360)\nRender ()\n"
                .to_owned(),
            "rendering frame 1, rendering with local",
        ),
    ];
    if granita_needs::has("python3") {
        let script = format!(
            "import subprocess\nsubprocess.Popen(['sh', '-c', \"\"\"{ENDLESS}\"\"\"])\nwhile True: pass\n"
        );
        all.push(("script", script, "running the script scene.pyg"));
    }
    all
}

fn start(tools: &Tools, place: &Path, words: &[&str]) -> Child {
    start_tool("gelato", tools, place, words)
}

fn start_tool(tool: &str, tools: &Tools, place: &Path, words: &[&str]) -> Child {
    let mut command = Command::new(tools.program(tool));
    command.current_dir(place).args(words).env_remove("GELATOHOME").stdin(Stdio::null());
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

fn prepare(place: &Path, scene: &str) {
    std::fs::write(place.join("scene.pyg"), scene).unwrap();
    granita_needs::write_script(&place.join("fake"), ENDLESS);
}

fn soon(what: &str, mut done: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !done() {
        assert!(begin.elapsed() < Duration::from_secs(20), "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// True when a process runs. A process that has ended may stay in the table until its parent waits for it.
fn runs(pid: &str) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit_once(')').is_some_and(|(_, rest)| !rest.trim_start().starts_with('Z'))
}

/// Returns the numbers of the child and of its child, once both run.
fn children(what: &str, place: &Path) -> [String; 2] {
    ["outer.pid", "inner.pid"].map(|name| {
        let path = place.join(name);
        soon(&format!("{what}: no child was started"), || path.exists());
        std::fs::read_to_string(path).unwrap().trim().to_owned()
    })
}

fn kill(signal: &str, process: &Child) {
    assert!(Command::new("kill").args(["-s", signal, &process.id().to_string()]).status().unwrap().success());
}

fn ended(process: Child) -> (Output, String) {
    let output = process.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (output, said)
}

/// True when this process ignores Ctrl-C, like a process in the background of a shell. Its children then ignore it,
/// too.
fn ignores_interrupts() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).unwrap();
    u64::from_str_radix(mask.trim(), 16).unwrap() & 2 != 0
}

#[test]
fn a_killed_run_leaves_no_process() {
    let tools = Tools::build().unwrap();
    std::thread::scope(|scope| {
        for (what, scene, _) in scenes() {
            for (signal, number) in [("TERM", 15), ("INT", 2), ("KILL", 9)] {
                if number == 2 && ignores_interrupts() {
                    continue;
                }
                let (tools, scene) = (&tools, scene.clone());
                scope.spawn(move || {
                    let what = format!("{what}, {signal}");
                    let folder = tempfile::tempdir().unwrap();
                    prepare(folder.path(), &scene);
                    let process = start(tools, folder.path(), &["scene.pyg"]);
                    let pids = children(&what, folder.path());
                    kill(signal, &process);
                    // A guard that still runs must not hold a stream of the run.
                    let (output, said) = ended(process);
                    assert_eq!(output.status.signal(), Some(number), "{what}: {said}");
                    assert!(said.is_empty(), "{what}: {said}");
                    for pid in pids {
                        soon(&format!("{what}: a child lives on"), || !runs(&pid));
                    }
                });
            }
        }
    });
}

#[test]
fn a_time_limit_ends_running_programs() {
    let tools = Tools::build().unwrap();
    std::thread::scope(|scope| {
        for (what, scene, running) in scenes() {
            let tools = &tools;
            scope.spawn(move || {
                let folder = tempfile::tempdir().unwrap();
                prepare(folder.path(), &scene);
                let process = start(tools, folder.path(), &["-timeout", "1.5", "scene.pyg"]);
                let pids = children(what, folder.path());
                let (output, said) = ended(process);
                assert_eq!(output.status.code(), Some(1), "{what}: {said}");
                assert!(
                    said.starts_with("gelato: error: -timeout: the limit of 1.5 s was exceeded while "),
                    "{what}: {said}"
                );
                assert!(said.contains(running) && said.lines().count() == 1, "{what}: {said}");
                for pid in pids {
                    soon(&format!("{what}: a child lives on"), || !runs(&pid));
                }
            });
        }
    });
}

#[test]
fn a_killed_conversion_ends_its_programs() {
    let tools = Tools::build().unwrap();
    let words = ["-r", "1", "-o", "out.pyg", "scene.pyg"];
    std::thread::scope(|scope| {
        for (what, scene, running) in scenes().into_iter().filter(|s| matches!(s.0, "script" | "generator")) {
            for signal in ["TERM", "KILL", ""] {
                let (tools, scene) = (&tools, scene.clone());
                scope.spawn(move || {
                    let what = format!("{what}, {signal}");
                    let folder = tempfile::tempdir().unwrap();
                    prepare(folder.path(), &scene);
                    let limit: &[&str] = if signal.is_empty() { &["-timeout", "1.5"] } else { &[] };
                    let process = start_tool("topyg", tools, folder.path(), &[limit, &words].concat());
                    let pids = children(&what, folder.path());
                    if !signal.is_empty() {
                        kill(signal, &process);
                    }
                    let (output, said) = ended(process);
                    match signal {
                        "" => {
                            assert_eq!(output.status.code(), Some(1), "{what}: {said}");
                            let limit = "topyg: error: -timeout: the limit of 1.5 s was exceeded while ";
                            assert!(said.starts_with(limit) && said.contains(running), "{what}: {said}");
                        }
                        _ => assert!(output.status.signal().is_some() && said.is_empty(), "{what}: {said}"),
                    }
                    for pid in pids {
                        soon(&format!("{what}: a child lives on"), || !runs(&pid));
                    }
                    let left: Vec<_> =
                        std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
                    assert!(
                        !left.iter().any(|name| name.to_string_lossy().contains("out.pyg")),
                        "{what}: {left:?}"
                    );
                });
            }
        }
    });
}

#[test]
fn a_time_limit_ends_frames_and_reading() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    copy_first(place).unwrap();
    assert!(Command::new("mkfifo").arg(place.join("fifo")).status().unwrap().success());
    std::fs::write(
        place.join("large.pyg"),
        "Attribute (\"int[2] resolution\", (4000, 3000))\nAttribute (\"float[2] spatialquality\", (16, 16))\n\
         Output (\"never.tif\", \"tiff\", \"rgba\", \"camera\")\nTranslate (0, 0, 3)\nWorld ()\n\
         Shader (\"surface\", \"defaultsurface\")\nSphere (1, -1, 1, 360)\nRender ()\nRender ()\n",
    )
    .unwrap();
    for (scene, running) in [("large.pyg", "rendering frame 1"), ("pyg < cat fifo", "reading < cat fifo")] {
        let begin = Instant::now();
        let (output, said) = ended(start(&tools, place, &["-timeout", "1", "-verbosity", "0", scene]));
        assert_eq!(output.status.code(), Some(1), "{scene}: {said}");
        assert!(said.contains(running) && said.lines().count() == 1, "{scene}: {said}");
        assert!(begin.elapsed() < Duration::from_secs(6), "{scene}: {:?}", begin.elapsed());
        let left: Vec<_> =
            std::fs::read_dir(place).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        let partial = |name: &std::ffi::OsString| name.to_string_lossy().starts_with(".granita");
        assert!(!left.iter().any(|name| partial(name) || name == "never.tif"), "{scene}: {left:?}");
    }
    // A limit that is not reached has no effect.
    let (output, said) = ended(start(&tools, place, &["-timeout", "1000", "examples/first/first.pyg"]));
    assert!(output.status.success() && said.is_empty(), "{said}");
    for bad in ["0", "nan", "inf", "soon"] {
        let (output, said) = ended(start(&tools, place, &["-timeout", bad, "examples/first/first.pyg"]));
        assert_eq!(output.status.code(), Some(2), "{bad}: {said}");
        assert!(said.contains("expected a number of seconds, more than 0"), "{bad}: {said}");
    }
}

#[test]
fn a_pipe_without_a_reader_fails_only_its_own_image() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    assert!(Command::new("mkfifo").arg(place.join("pipe.ppm")).status().unwrap().success());
    let scene = "Output (\"pipe.ppm\", \"ppm\", \"rgb\", \"camera\")\nOutput (\"good.ppm\", \"ppm\", \"rgb\", \"camera\")\n\
                 Attribute (\"int[2] resolution\", (16, 16))\nWorld ()\nSphere (1, -1, 1, 360)\nRender ()\n";
    std::fs::write(place.join("scene.pyg"), scene).unwrap();
    let begin = Instant::now();
    let (output, said) = ended(start(&tools, place, &["-timeout", "15", "scene.pyg"]));
    assert!(begin.elapsed() < Duration::from_secs(10) && output.status.code() == Some(1), "{said}");
    assert!(said.contains("pipe.ppm: no program reads from this pipe"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    assert!(place.join("good.ppm").exists());
}

#[test]
fn background_programs_continue_after_a_normal_run() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (_, scene, _) = scenes().swap_remove(1);
    let scene = scene.replace("sleep 1000\")\n", "true\")\n");
    prepare(folder.path(), &scene);
    let mut command = Command::new(tools.program("gelato"));
    command.current_dir(folder.path()).arg("scene.pyg").env_remove("GELATOHOME");
    assert_ne!(command.status().unwrap().code(), None);
    for pid in children("background", folder.path()) {
        assert!(runs(&pid));
        assert!(Command::new("kill").args(["-9", &pid]).status().unwrap().success());
    }
}

#[test]
fn programs_do_not_read_the_standard_input_of_the_scene() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let text = "Command (\"system cat > eaten\")\nCommand (\"system echo read > on\")\n";
    std::fs::write(folder.path().join("scene.pyg"), text).unwrap();
    let ran = Command::new("sh")
        .args(["-c", "cat scene.pyg | \"$0\" -"])
        .arg(tools.program("gelato"))
        .current_dir(folder.path())
        .env_remove("GELATOHOME")
        .output()
        .unwrap();
    assert!(ran.status.code().is_some(), "{ran:?}");
    assert_eq!(std::fs::read_to_string(folder.path().join("eaten")).unwrap(), "");
    assert!(folder.path().join("on").exists());
}
