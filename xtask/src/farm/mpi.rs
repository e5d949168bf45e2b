//! The part with MPI: a frame with two processes of `mpirun`, one of which is killed.

use super::local::{References, compare_large, gelato, maps};
use super::place::{LARGE, Place, Running, signal, wait};
use std::fs;
use std::time::Duration;

/// The variables with which Open MPI starts processes for root, and more than there are cores.
const ALLOW: [(&str, &str); 3] = [
    ("OMPI_ALLOW_RUN_AS_ROOT", "1"),
    ("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1"),
    ("OMPI_MCA_rmaps_base_oversubscribe", "1"),
];

/// Returns the reason why there is no MPI.
pub(super) fn missing() -> Option<String> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&path).any(|folder| folder.join("mpirun").is_file());
    (!found).then(|| "there is no mpirun (apt-get install openmpi-bin)".to_owned())
}

/// Runs the part.
pub(super) fn run(place: &Place, references: &References) -> Result<(), String> {
    let folder = place.job("mpi")?;
    maps(place, &folder)?;
    let image = folder.join("out/large.tif");
    for kills in [false, true] {
        let what =
            if kills { "a frame with MPI, one of whose workers was killed" } else { "a frame with MPI" };
        let mut command = gelato(place, &folder, &["-net", "mpi:2", LARGE]);
        command.envs(ALLOW);
        let mut coordinator = Running(command.spawn().map_err(|error| format!("gelato: {error}"))?);
        let mut workers = Vec::new();
        wait("the workers of mpirun", || {
            workers = children(coordinator.0.id()).into_iter().flat_map(children).collect();
            Ok(workers.len() == 2)
        })?;
        if kills {
            std::thread::sleep(Duration::from_millis(700) + references.large_time / 8);
            signal("-KILL", workers[0]);
            std::thread::sleep(Duration::from_millis(500));
            if coordinator.0.try_wait().map_err(|error| error.to_string())?.is_some() {
                println!("farm: the frame was complete before the worker was killed");
            } else if !is_running(workers[1]) {
                return Err(format!("{what}: the other worker ended with it"));
            }
        }
        let status = coordinator.0.wait().map_err(|error| error.to_string())?;
        if !status.success() {
            return Err(format!("{what}: {status}"));
        }
        compare_large(what, &folder, references)?;
        fs::remove_file(&image).map_err(|error| format!("{}: {error}", image.display()))?;
    }
    Ok(())
}

/// Returns the status of a process, and the number of its parent.
fn status(process: u32) -> Option<(char, u32)> {
    let text = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // The name may contain blanks and brackets.
    let mut words = text.rsplit_once(')')?.1.split_whitespace();
    Some((words.next()?.chars().next()?, words.next()?.parse().ok()?))
}

/// Returns the children of a process.
fn children(process: u32) -> Vec<u32> {
    let Ok(entries) = fs::read_dir("/proc") else { return Vec::new() };
    let all = entries.filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
    all.filter(|other| status(*other).is_some_and(|(_, parent)| parent == process)).collect()
}

/// True unless a process has ended.
fn is_running(process: u32) -> bool {
    status(process).is_some_and(|(state, _)| state != 'Z')
}
