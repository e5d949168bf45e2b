//! Jobs as templates of the Open Job Description specification, version 2023-09.

use crate::job::{Job, Step, Work};
use serde_json::{Value, json};

/// The length of the longest argument of a command in a template.
const LONGEST: usize = 1024;

/// Returns the template of a job, as JSON. `gelato` is the program on the machines. Commands run in the folder of the
/// template, unless the parameter "Folder" names another one.
///
/// # Errors
/// Returns the reason why the specification has no such job.
pub fn template(job: &Job, gelato: &str) -> Result<Value, String> {
    let steps: Result<Vec<Value>, String> = job
        .steps
        .iter()
        .map(|one| step(job, one, gelato).map_err(|what| format!("step \"{}\": {what}", one.name)))
        .collect();
    Ok(json!({
        "specificationVersion": "jobtemplate-2023-09",
        "name": job.name,
        "parameterDefinitions": [{
            "name": "Folder",
            "type": "PATH",
            "objectType": "DIRECTORY",
            "dataFlow": "INOUT",
            "default": ".",
            "description": "The folder of the scene, which names are relative to"
        }],
        "steps": steps?,
    }))
}

fn step(job: &Job, step: &Step, gelato: &str) -> Result<Value, String> {
    let last = step.tasks() - 1;
    let mut value = json!({
        "name": step.name,
        "parameterSpace": {
            "taskParameterDefinitions": [{"name": "Task", "type": "INT", "range": format!("0-{last}")}]
        },
        "script": script(step, gelato)?,
    });
    if !step.after.is_empty() {
        let others: Vec<Value> =
            step.after.iter().map(|at| json!({"dependsOn": job.steps[*at].name})).collect();
        value["dependencies"] = others.into();
    }
    let mut amounts = Vec::new();
    if step.cores > 0 {
        amounts.push(json!({"name": "amount.worker.vcpu", "min": step.cores}));
    }
    if step.memory_mb > 0 {
        amounts.push(json!({"name": "amount.worker.memory", "min": step.memory_mb}));
    }
    if !amounts.is_empty() {
        value["hostRequirements"] = json!({"amounts": amounts});
    }
    Ok(value)
}

/// Returns the script of a step. Commands run in the folder of the job.
fn script(step: &Step, gelato: &str) -> Result<Value, String> {
    let text = match &step.work {
        Work::Frames { .. } => {
            let words = step.command(gelato, "{{Task.Param.Task}}").unwrap_or_default();
            let words = [&words[..1], &["-progress".to_owned(), "openjd".to_owned()], &words[1..]].concat();
            format!("exec {}\n", line(&words)?)
        }
        Work::Commands(commands) => {
            let mut text = "case '{{Task.Param.Task}}' in\n".to_owned();
            for (number, command) in commands.iter().enumerate() {
                text += &format!("    {number}) exec {} ;;\n", line(command)?);
            }
            text + "esac\n"
        }
    };
    let text = format!("#!/bin/sh\nset -e\ncd '{{{{Param.Folder}}}}'\n{text}");
    Ok(json!({
        "actions": {"onRun": {"command": "/bin/sh", "args": ["{{Task.File.Run}}"]}},
        "embeddedFiles": [{"name": "Run", "type": "TEXT", "filename": "run.sh", "data": text}],
    }))
}

/// Returns the words of a command for a shell.
fn line(words: &[String]) -> Result<String, String> {
    let mut quoted = Vec::new();
    for word in words {
        if word.len() > LONGEST {
            return Err(format!("an argument has more than {LONGEST} bytes"));
        }
        // A pair of braces begins an expression of the template, and there is no way to write it otherwise.
        let is_own = word == "{{Task.Param.Task}}";
        if word.contains("{{") && !is_own {
            return Err(format!("\"{word}\" contains \"{{{{\""));
        }
        quoted.push(format!("'{}'", word.replace('\'', "'\\''")));
    }
    Ok(quoted.join(" "))
}

#[cfg(test)]
mod tests {
    use super::*;

    const JOB: &str = r#"{"name": "shot", "steps": [
        {"name": "maps", "commands": [["maketx", "it's.exr"], ["true"]], "cores": 2},
        {"name": "frames", "after": ["maps"], "frames": "1-10", "chunk": 4, "scene": ["shot.####.pyg"], "memory_mb": 2048}
    ]}"#;

    #[test]
    fn steps_have_tasks_and_dependencies() {
        let job = Job::read(JOB).unwrap();
        let value = template(&job, "gelato").unwrap();
        // Names of folders in a template are relative to it.
        assert_eq!(value["parameterDefinitions"][0]["default"], ".");
        assert_eq!(value["steps"][0]["parameterSpace"]["taskParameterDefinitions"][0]["range"], "0-1");
        assert_eq!(value["steps"][1]["dependencies"][0]["dependsOn"], "maps");
        assert_eq!(value["steps"][1]["parameterSpace"]["taskParameterDefinitions"][0]["range"], "0-2");
        assert_eq!(value["steps"][1]["hostRequirements"]["amounts"][0]["min"], 2048);
        let text = value["steps"][1]["script"]["embeddedFiles"][0]["data"].as_str().unwrap();
        assert_eq!(
            text,
            "#!/bin/sh\nset -e\ncd '{{Param.Folder}}'\nexec 'gelato' '-progress' 'openjd' '-frames' '1-10' '-chunk' '4' \
             '-task' '{{Task.Param.Task}}' 'shot.####.pyg'\n"
        );
        let job = Job::of_frames("a", "1".parse().unwrap(), 1, vec!["{{x}}.pyg".to_owned()]);
        assert!(template(&job, "gelato").unwrap_err().contains("contains \"{{\""));
    }

    /// The reference implementation accepts and runs templates, where it is installed.
    #[test]
    fn the_reference_implementation_accepts_and_runs_templates() {
        if !granita_needs::has("openjd") {
            return;
        }
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("job.json");
        let value = template(&Job::read(JOB).unwrap(), "gelato").unwrap();
        std::fs::write(&file, value.to_string()).unwrap();
        let ran = std::process::Command::new("openjd").arg("check").arg(&file).output().unwrap();
        assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stdout));
        let job = r#"{"name": "j", "steps": [{"name": "s", "commands": [["touch", "made"]]}]}"#;
        std::fs::write(&file, template(&Job::read(job).unwrap(), "gelato").unwrap().to_string()).unwrap();
        // It runs from another folder as well.
        let mut run = std::process::Command::new("openjd");
        let ran = run.current_dir("/").arg("run").arg(&file).args(["--step", "s"]).output().unwrap();
        assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stdout));
        assert!(place.path().join("made").is_file());
    }
}
