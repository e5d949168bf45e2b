//! Jobs for the engines of render farms (`-submit`).

use crate::{Options, frames};
use granita_base::Reporter;
use granita_cli::{Given, Status};
use granita_farm::{Job, openjd, slurm};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Writes the job of the options, and submits it.
pub(crate) fn run(options: &Options, given: &[Given], reporter: &Reporter) -> Status {
    match submitted(options, given) {
        Ok(lines) => {
            // A reader that is gone has the job all the same.
            let _ = std::io::stdout().write_all(lines.as_bytes());
            Status::Done
        }
        Err(what) => {
            reporter.error(format!("-submit: {what}"));
            Status::Failed
        }
    }
}

fn submitted(options: &Options, given: &[Given]) -> Result<String, String> {
    if let Some(folder) = &options.cwd {
        std::env::set_current_dir(folder).map_err(|error| format!("-cwd {}: {error}", folder.display()))?;
    }
    let job = job(options, given)?;
    let program = std::env::current_exe().map_err(|error| error.to_string())?;
    let gelato = program.to_string_lossy();
    match options.submit.as_deref() {
        Some("slurm") => submit_to_slurm(&job, &gelato),
        _ => write_openjd(&job, &gelato),
    }
}

/// Returns the job of a file, or of frames.
fn job(options: &Options, given: &[Given]) -> Result<Job, String> {
    let file = options.files.first().ok_or("name a job file, or -frames and the files of a scene")?;
    let Some(range) = &options.frames else {
        if options.files.len() > 1 || !file.ends_with(".json") {
            return Err("a scene needs -frames; a job is one file of JSON".to_owned());
        }
        let text = std::fs::read_to_string(file).map_err(|error| format!("{file}: {error}"))?;
        return Job::read(&text).map_err(|error| format!("{file}: {error}"));
    };
    let mut words = Vec::new();
    for word in frames::words(options, given, None) {
        words.push(word.into_string().map_err(|word| format!("{}: no text", word.to_string_lossy()))?);
    }
    let name = Path::new(file).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Job::of_frames(&name, range.clone(), options.chunk.unwrap_or(1) as usize, words))
}

/// Writes a batch script for each step, and submits them in their order.
fn submit_to_slurm(job: &Job, gelato: &str) -> Result<String, String> {
    let mut ids: Vec<String> = Vec::new();
    let mut lines = String::new();
    for step in &job.steps {
        let path = PathBuf::from(format!("{}.{}.sh", job.name, step.name));
        write(&path, &slurm::script(job, step, gelato))?;
        let after: Vec<String> = step.after.iter().map(|at| ids[*at].clone()).collect();
        let words = slurm::sbatch(&after);
        let ran = Command::new(&words[0]).args(&words[1..]).arg(&path).output();
        let ran = ran.map_err(|error| format!("{}: {error}; {} was written", words[0], path.display()))?;
        if !ran.status.success() {
            let said = String::from_utf8_lossy(&ran.stderr);
            let said: Vec<&str> = said.lines().map(|line| line.trim_start_matches("sbatch: ")).collect();
            return Err(format!("step \"{}\": sbatch: {}", step.name, said.join("; ")));
        }
        // The number may be followed by the name of a cluster.
        let id = String::from_utf8_lossy(&ran.stdout);
        let id = id.trim().split(';').next().unwrap_or_default().to_owned();
        lines += &format!("{} {id} {} tasks\n", step.name, step.tasks());
        ids.push(id);
    }
    Ok(lines)
}

/// Writes a template of Open Job Description, which has no queue of its own.
fn write_openjd(job: &Job, gelato: &str) -> Result<String, String> {
    let template = openjd::template(job, gelato)?;
    let path = PathBuf::from(format!("{}.openjd.json", job.name));
    let text = serde_json::to_string_pretty(&template).map_err(|error| error.to_string())?;
    write(&path, &(text + "\n"))?;
    Ok(format!("{}\n", path.display()))
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    std::fs::write(path, text).map_err(|error| format!("{}: {error}", path.display()))
}
