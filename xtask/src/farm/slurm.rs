//! The part with Slurm: a job on one node and on three, and a frame on three, of which one is killed.

use super::cluster::Cluster;
use super::local::{References, compare_large};
use super::place::{CHUNK, LARGE, Place, Running, compare, images, output, wait};
use std::fs;
use std::path::{Path, PathBuf};
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

/// A coordinator with a worker on each node, and its messages and statistics.
struct Frame {
    coordinator: Running,
    log: PathBuf,
}

impl Frame {
    /// Starts the large frame, and returns when all workers have joined.
    fn start(cluster: &Cluster<'_>, folder: &Path) -> Result<Self, String> {
        let log = folder.join("large.log");
        let told = |error: std::io::Error| format!("{}: {error}", log.display());
        let to = fs::File::create(&log).map_err(told)?;
        let mut command = cluster.command_in("gelato", folder);
        let net = format!("slurm:{NODES}");
        command.args(["-verbosity", "2", "-statistics", "-threads", "1", "-net", &net, LARGE]);
        command.stdout(to.try_clone().map_err(told)?).stderr(to);
        let coordinator = Running(command.spawn().map_err(|error| format!("gelato: {error}"))?);
        let frame = Self { coordinator, log };
        wait("the workers on the nodes", || Ok(frame.count(" joins")? == NODES))?;
        Ok(frame)
    }

    /// Returns how often its messages contain a text.
    fn count(&self, part: &str) -> Result<usize, String> {
        let text =
            fs::read_to_string(&self.log).map_err(|error| format!("{}: {error}", self.log.display()))?;
        Ok(text.matches(part).count())
    }

    /// Waits for its end. All workers but those of `lost` nodes must have stayed.
    fn finish(
        mut self,
        what: &str,
        folder: &Path,
        lost: usize,
        references: &References,
    ) -> Result<(), String> {
        let status = self.coordinator.0.wait().map_err(|error| error.to_string())?;
        if !status.success() {
            return Err(format!("{what}: {status}"));
        }
        compare_large(what, folder, references)?;
        // The statistics have a line for each worker that is left.
        let (left, gone) = (self.count("  worker ")?, self.count(" is gone")?);
        if (left, gone) == (NODES - lost, lost) {
            Ok(())
        } else {
            let text = fs::read_to_string(&self.log).unwrap_or_default();
            Err(format!("{what}: {left} workers are left, and {gone} are gone:\n{text}"))
        }
    }
}

/// Renders the large frame with a worker on each node, and kills a node meanwhile.
fn workers(cluster: &mut Cluster<'_>, folder: &Path, references: &References) -> Result<(), String> {
    Frame::start(cluster, folder)?.finish("a frame on three nodes", folder, 0, references)?;
    let image = folder.join("out/large.tif");
    fs::remove_file(&image).map_err(|error| format!("{}: {error}", image.display()))?;
    let frame = Frame::start(cluster, folder)?;
    std::thread::sleep(references.large_time / 8);
    if image.exists() {
        return Err("the frame was complete before the node was killed".to_owned());
    }
    cluster.kill_node(0);
    frame.finish("a frame on three nodes, of which one was killed", folder, 1, references)
}
