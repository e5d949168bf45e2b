//! Jobs for Slurm: a batch script for each step, which is an array of tasks.

use crate::job::{Job, Step, Work};

/// The words of `sbatch` before the name of the script. `after` are the numbers that Slurm gave to the steps before, in
/// the order of [`Step::after`]. Where one of them fails, the step is not run, and is removed.
pub fn sbatch(after: &[String]) -> Vec<String> {
    let mut words = vec!["sbatch".to_owned(), "--parsable".to_owned()];
    if !after.is_empty() {
        words.push(format!("--dependency=afterok:{}", after.join(":")));
        words.push("--kill-on-invalid-dep=yes".to_owned());
    }
    words
}

/// Returns the batch script of a step. `gelato` is the program on the nodes.
pub fn script(job: &Job, step: &Step, gelato: &str) -> String {
    let mut text = format!(
        "#!/bin/sh\n#SBATCH --job-name={}.{}\n#SBATCH --array=0-{}\n#SBATCH --output={}.{}.%a.log\n#SBATCH --requeue\n",
        job.name,
        step.name,
        step.tasks() - 1,
        job.name,
        step.name
    );
    if step.cores > 0 {
        text += &format!("#SBATCH --cpus-per-task={}\n", step.cores);
    }
    if step.memory_mb > 0 {
        text += &format!("#SBATCH --mem={}M\n", step.memory_mb);
    }
    text += "set -e\n";
    match &step.work {
        Work::Frames { .. } => {
            let words = step.command(gelato, "$SLURM_ARRAY_TASK_ID").unwrap_or_default();
            text +=
                &format!("exec {}\n", words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" "));
        }
        Work::Commands(commands) => {
            text += "case $SLURM_ARRAY_TASK_ID in\n";
            for (number, command) in commands.iter().enumerate() {
                let words = command.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ");
                text += &format!("    {number}) exec {words} ;;\n");
            }
            text += "esac\n";
        }
    }
    text
}

/// Returns a word for a shell. The variable of the task stays one.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,%+@".contains(c);
    match word {
        "$SLURM_ARRAY_TASK_ID" => word.to_owned(),
        _ if !word.is_empty() && word.chars().all(is_plain) => word.to_owned(),
        _ => format!("'{}'", word.replace('\'', "'\\''")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_arrays_of_tasks() {
        let job = Job::read(
            r#"{"name": "shot", "steps": [
                {"name": "maps", "commands": [["maketx", "it's.exr"], ["maketx", "b.exr", "-o", "$b.tx"]], "cores": 2, "memory_mb": 512},
                {"name": "frames", "after": ["maps"], "frames": "1-10", "chunk": 4, "scene": ["shot.####.pyg"]}
            ]}"#,
        )
        .unwrap();
        assert_eq!(
            script(&job, &job.steps[0], "gelato"),
            "#!/bin/sh\n#SBATCH --job-name=shot.maps\n#SBATCH --array=0-1\n#SBATCH --output=shot.maps.%a.log\n\
             #SBATCH --requeue\n#SBATCH --cpus-per-task=2\n#SBATCH --mem=512M\nset -e\n\
             case $SLURM_ARRAY_TASK_ID in\n    0) exec maketx 'it'\\''s.exr' ;;\n    1) exec maketx b.exr -o '$b.tx' ;;\nesac\n"
        );
        let frames = script(&job, &job.steps[1], "/opt/granita/bin/gelato");
        assert!(frames.contains("#SBATCH --array=0-2\n"), "{frames}");
        assert!(
            frames.ends_with(
                "exec /opt/granita/bin/gelato -frames 1-10 -chunk 4 -task $SLURM_ARRAY_TASK_ID 'shot.####.pyg'\n"
            ),
            "{frames}"
        );
        let words = sbatch(&["12".to_owned(), "13".to_owned()]).join(" ");
        assert_eq!(words, "sbatch --parsable --dependency=afterok:12:13 --kill-on-invalid-dep=yes");
        assert_eq!(sbatch(&[]).join(" "), "sbatch --parsable");
    }
}
