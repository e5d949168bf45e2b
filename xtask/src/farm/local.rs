//! The part without an engine: tasks and workers that are killed.

use super::place::{
    CHUNK, FRAMES, Images, LARGE, Place, Running, compare, images, output, secret, signal, wait,
};
use std::fs;
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

/// What one process renders.
pub(super) struct References {
    /// The files of the job.
    pub(super) job: Images,
    /// The large frame.
    pub(super) large: Vec<u8>,
    /// The time of the large frame.
    pub(super) large_time: Duration,
}

/// Runs the part. Returns what one process renders.
pub(super) fn run(place: &Place) -> Result<References, String> {
    let folder = place.job("reference")?;
    maps(place, &folder)?;
    let all = format!("1-{FRAMES}");
    output(gelato(place, &folder, &["-frames", &all, "shot.####.pyg"]))?;
    let job = images(&folder)?;
    let begin = Instant::now();
    output(gelato(place, &folder, &[LARGE]))?;
    let large_time = begin.elapsed();
    let large = folder.join("out/large.tif");
    let large = fs::read(&large).map_err(|error| format!("{}: {error}", large.display()))?;
    let expected = job.len();
    println!("farm: one process: {expected} files, and a frame of {:.1} s", large_time.as_secs_f64());
    let references = References { job, large, large_time };
    killed_task(place, &references)?;
    failing_workers(place, &references)?;
    Ok(references)
}

/// Returns the command of `gelato` with one thread.
pub(super) fn gelato(place: &Place, folder: &Path, words: &[&str]) -> Command {
    let mut command = place.command("gelato", folder);
    command.args(["-silent", "-threads", "1"]).args(words);
    command
}

/// Makes the texture and the depth maps.
pub(super) fn maps(place: &Place, folder: &Path) -> Result<(), String> {
    output(gelato(place, folder, &["wood.pyg"]))?;
    let mut command = place.command("maketx", folder);
    command.args(["out/wood.tif", "-o", "out/wood.tx"]);
    output(command)?;
    output(gelato(place, folder, &["-frames", &format!("1-{FRAMES}"), "map.####.pyg"])).map(|_| ())
}

/// Runs the frames in tasks. One of them is killed in its second frame, and runs again as an engine would run it.
fn killed_task(place: &Place, references: &References) -> Result<(), String> {
    let folder = place.job("killed")?;
    maps(place, &folder)?;
    let (all, chunk) = (format!("1-{FRAMES}"), CHUNK.to_string());
    let task = |task: u32| {
        let task = task.to_string();
        gelato(place, &folder, &["-u", "-frames", &all, "-chunk", &chunk, "-task", &task, "shot.####.pyg"])
    };
    let mut killed = Running(task(1).spawn().map_err(|error| format!("gelato: {error}"))?);
    let first = folder.join(format!("out/shot.{:04}.tif", CHUNK + 1));
    wait("the first frame of a task", || Ok(first.is_file()))?;
    let before = first.metadata().and_then(|data| data.modified()).ok();
    // The process of a frame ends with that of its task.
    signal("-KILL", killed.0.id());
    let _ = killed.0.wait();
    for number in 0..FRAMES.div_ceil(CHUNK) {
        output(task(number))?;
    }
    if first.metadata().and_then(|data| data.modified()).ok() != before {
        return Err("a killed task: its complete frame was rendered twice".to_owned());
    }
    compare("a killed task", &images(&folder)?, &references.job)
}

/// Renders the large frame with three workers that join. One is killed, and one is stopped.
fn failing_workers(place: &Place, references: &References) -> Result<(), String> {
    let folder = place.job("workers")?;
    maps(place, &folder)?;
    let secret = secret(&folder)?;
    let free = || TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
    let port = free().map_err(|error| error.to_string())?.port();
    let address = format!("127.0.0.1:{port}");
    let start = |words: &[&str]| {
        let mut command = gelato(place, &folder, &[words, &["-secret", &*secret][..]].concat());
        command.spawn().map(Running).map_err(|error| format!("gelato: {error}"))
    };
    let workers: Result<Vec<Running>, String> =
        (0..3).map(|_| start(&["-worker", "-join", &address])).collect();
    let workers = workers?;
    let begin = Instant::now();
    let mut coordinator = start(&["-net", &format!("listen:{address}"), LARGE])?;
    wait("the coordinator", || Ok(TcpStream::connect(("127.0.0.1", port)).is_ok()))?;
    std::thread::sleep(Duration::from_millis(700) + references.large_time / 8);
    signal("-KILL", workers[0].0.id());
    signal("-STOP", workers[1].0.id());
    let status = coordinator.0.wait().map_err(|error| error.to_string())?;
    let late = begin.elapsed().saturating_sub(references.large_time);
    if !status.success() {
        return Err(format!("a frame with failing workers: {status}"));
    }
    compare_large("a frame with a killed and a stopped worker", &folder, references)?;
    println!("farm: {:.1} s later than one process", late.as_secs_f64());
    if late > Duration::from_secs(10) { Err("that is too late".to_owned()) } else { Ok(()) }
}

/// Compares the large frame.
pub(super) fn compare_large(what: &str, folder: &Path, references: &References) -> Result<(), String> {
    let name = "large.tif".to_owned();
    let mut got = images(folder)?;
    got.retain(|other, _| *other == name);
    compare(what, &got, &[(name, references.large.clone())].into())
}
