//! The part with Slurm: a job on one node and on three, and a frame on three, of which one is killed.

use super::cluster::Cluster;
use super::local::{References, compare_large};
use super::place::{CHUNK, LARGE, Place, Running, compare, images, output, wait};
use std::path::Path;
use std::time::Duration;

/// The number of nodes.
const NODES: usize = 3;

/// The number of tasks of the job.
const TASKS: usize = 1 + 3 + 6;

/// Runs the part.
pub(super) fn run(place: &Place, references: &References) -> Result<(), String> {
    let cores = std::thread::available_parallelism().map_or(1, Into::into);
    {
        let cluster = Cluster::start(place, "one-node", 1, cores)?;
        let folder = place.job("one")?;
        submit(&cluster, &folder)?;
        finish(&cluster)?;
        compare(&format!("a job on one node of {cores} cores"), &images(&folder)?, &references.job)?;
    }
    let mut cluster = Cluster::start(place, "three-nodes", NODES, 1)?;
    let folder = place.job("three")?;
    submit(&cluster, &folder)?;
    killed_node(&mut cluster, &folder)?;
    finish(&cluster)?;
    compare("a job on three nodes, of which one was killed", &images(&folder)?, &references.job)?;
    workers(&mut cluster, &folder, references)
}

fn submit(cluster: &Cluster<'_>, folder: &Path) -> Result<(), String> {
    let mut command = cluster.command_in("gelato", folder);
    command.args(["-submit", "slurm", "job.json"]);
    output(command).map(|_| ())
}

fn finish(cluster: &Cluster<'_>) -> Result<(), String> {
    match cluster.finish()? {
        TASKS => Ok(()),
        other => Err(format!("{other} tasks completed; expected {TASKS}")),
    }
}

/// Kills a node while its task is in its second frame, and starts it again.
fn killed_node(cluster: &mut Cluster<'_>, folder: &Path) -> Result<(), String> {
    let node = NODES - 1;
    let mut task = None;
    wait("a task of a node", || {
        task = cluster.task_on(node, "shot.frames")?;
        Ok(task.is_some_and(|task| {
            let first = task * CHUNK + 1;
            folder.join(format!("out/shot.{first:04}.tif")).is_file()
        }))
    })?;
    cluster.kill_node(node);
    println!("farm: node {} was killed in task {}", node + 1, task.unwrap_or_default());
    // Slurm takes some seconds to notice it.
    std::thread::sleep(Duration::from_secs(12));
    cluster.start_node(node)
}

/// Renders the large frame with a worker on each node, and kills a node meanwhile.
fn workers(cluster: &mut Cluster<'_>, folder: &Path, references: &References) -> Result<(), String> {
    let render = |cluster: &Cluster<'_>| {
        let mut command = cluster.command_in("gelato", folder);
        command.args(["-silent", "-threads", "1", "-net", &format!("slurm:{NODES}"), LARGE]);
        command.spawn().map(Running).map_err(|error| format!("gelato: {error}"))
    };
    let wait_for = |mut running: Running, what: &str| {
        let status = running.0.wait().map_err(|error| error.to_string())?;
        if status.success() {
            compare_large(what, folder, references)
        } else {
            Err(format!("{what}: {status}"))
        }
    };
    wait_for(render(cluster)?, "a frame on three nodes")?;
    let image = folder.join("out/large.tif");
    std::fs::remove_file(&image).map_err(|error| format!("{}: {error}", image.display()))?;
    let running = render(cluster)?;
    std::thread::sleep(Duration::from_millis(1500) + references.large_time / 8);
    let is_early = !image.exists();
    cluster.kill_node(0);
    if !is_early {
        println!("farm: the frame was complete before the node was killed");
    }
    wait_for(running, "a frame on three nodes, of which one was killed")
}
