//! `cargo xtask farm`: tests that jobs and frames of several processes and machines lose nothing.
//!
//! The parts, in the order in which they run:
//! - without an engine: a job of 24 frames whose task is killed, and a frame with workers that are killed and stopped;
//! - with a network namespace, where the user is root and the system allows it: frames whose network stalls;
//! - with MPI, where `mpirun` is installed: a frame with two processes, one of which is killed;
//! - with Slurm, where its packages are installed and the user is root: the same job on one node and on three nodes,
//!   one of which is killed with its tasks, and a frame on three nodes, one of which is killed.
//!
//! The nodes are processes of this machine, each with its own process numbers, so that all of a node's processes die at
//! once. All images must equal those of one process without an engine, to the bit. Everything is taken down at the end.

mod cluster;
mod local;
mod mpi;
mod place;
mod slurm;
mod stall;

use cluster::Cluster;
use place::Place;
use std::process::Command;
use std::time::Instant;

/// The options of `cargo xtask farm`.
#[derive(clap::Args, Debug)]
pub(crate) struct Options {
    /// Use the tools of the dev profile instead of release.
    #[arg(long)]
    debug: bool,
    /// Run only the parts without Slurm.
    #[arg(long)]
    without_slurm: bool,
    /// Run only the fixed part that `cargo xtask ci` runs.
    #[arg(long, conflicts_with_all = ["debug", "without_slurm"])]
    fixed: bool,
    /// Install the packages of Slurm where they are missing (Debian, as root).
    #[arg(long, conflicts_with_all = ["without_slurm", "fixed"])]
    install: bool,
}

/// Runs all parts.
pub(crate) fn run(options: &Options) -> Result<(), String> {
    let place = Place::new(options.debug || options.fixed, options.fixed)?;
    let begin = Instant::now();
    let references = local::run(&place)?;
    println!("farm: without an engine: {:.0} s", begin.elapsed().as_secs_f64());
    if options.fixed {
        return Ok(());
    }
    part("a network that stalls", stall::missing(), || stall::run(&place, &references))?;
    part("MPI", mpi::missing(), || mpi::run(&place, &references))?;
    if options.without_slurm {
        return Ok(());
    }
    if options.install && Cluster::missing().is_some() {
        install()?;
    }
    part("Slurm", Cluster::missing(), || slurm::run(&place, &references))
}

/// Runs a part, unless something is missing for it.
fn part(name: &str, missing: Option<String>, run: impl FnOnce() -> Result<(), String>) -> Result<(), String> {
    if let Some(what) = missing {
        println!("farm: {name}: skipped, {what}");
        return Ok(());
    }
    let begin = Instant::now();
    run()?;
    println!("farm: {name}: {:.0} s", begin.elapsed().as_secs_f64());
    Ok(())
}

/// Runs the part without Slurm with the tools of the dev profile, for `cargo xtask ci`.
pub(crate) fn fixed() -> Result<(), String> {
    run(&Options { debug: true, without_slurm: true, fixed: true, install: false })
}

/// Installs the packages.
fn install() -> Result<(), String> {
    println!("farm: installing slurm-wlm and munge");
    let mut command = Command::new("apt-get");
    command.args(["install", "-y", "--no-install-recommends", "slurm-wlm", "munge"]);
    let ran = command.env("DEBIAN_FRONTEND", "noninteractive").output();
    match ran {
        Ok(ran) if ran.status.success() => Ok(()),
        Ok(ran) => {
            // What is missing is reported, and the part is skipped.
            println!("farm: apt-get: {}", String::from_utf8_lossy(&ran.stderr).trim());
            Ok(())
        }
        Err(error) => {
            println!("farm: apt-get: {error}");
            Ok(())
        }
    }
}
