//! Jobs: steps, and what each of them waits for.

use crate::names::unnumbered;
use crate::range::FrameRange;
use serde::Deserialize;
use std::collections::HashSet;

/// A job, read from a file of JSON.
///
/// ```
/// let job = granita_farm::Job::read(r#"{
///     "name": "shot",
///     "steps": [
///         {"name": "maps", "commands": [["maketx", "wall.exr", "-o", "wall.tx"]]},
///         {"name": "frames", "after": ["maps"], "frames": "1-24", "chunk": 4, "scene": ["shot.####.pyg"]}
///     ]
/// }"#).unwrap();
/// assert_eq!(job.steps[1].tasks(), 6);
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Job {
    /// Its name, of letters, digits, "-", "_" and ".".
    pub name: String,
    /// Its steps. Those that a step waits for stand before it.
    pub steps: Vec<Step>,
}

/// A step of a job, of one or more tasks that may run at the same time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Step {
    /// Its name, which no other step has.
    pub name: String,
    /// The numbers of the steps that must be done before.
    pub after: Vec<usize>,
    /// What its tasks do.
    pub work: Work,
    /// The number of cores of a task; 0 leaves it to the engine.
    pub cores: u32,
    /// The memory of a task in MB; 0 leaves it to the engine.
    pub memory_mb: u32,
}

/// What the tasks of a step do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Work {
    /// Each task is a command: the program and its arguments.
    Commands(Vec<Vec<String>>),
    /// Each task renders some frames.
    Frames {
        /// All frames.
        frames: FrameRange,
        /// The number of frames of a task, at least 1.
        chunk: usize,
        /// The options of `gelato`, and the names of the scene files.
        words: Vec<String>,
    },
}

/// The reason why a text is no job.
#[derive(Debug, thiserror::Error)]
pub enum JobError {
    /// It is not the JSON of a job. The text has the line and the column.
    #[error("{0}")]
    Json(#[from] serde_json::Error),
    /// A part of it is wrong.
    #[error("{0}")]
    Wrong(String),
}

/// The JSON of a job.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct JobText {
    name: String,
    steps: Vec<StepText>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StepText {
    name: String,
    #[serde(default)]
    after: Vec<String>,
    #[serde(default)]
    commands: Vec<Vec<String>>,
    #[serde(default)]
    scene: Vec<String>,
    #[serde(default)]
    options: Vec<String>,
    frames: Option<String>,
    #[serde(default)]
    chunk: Option<usize>,
    #[serde(default)]
    cores: u32,
    #[serde(default)]
    memory_mb: u32,
}

impl Step {
    /// Returns the number of its tasks, at least 1.
    pub fn tasks(&self) -> usize {
        match &self.work {
            Work::Commands(commands) => commands.len(),
            Work::Frames { frames, chunk, .. } => frames.chunks(*chunk).len(),
        }
    }

    /// Returns the command of a task. `gelato` is the name of the program, and `task` stands for the number of the
    /// task: a number from 0 on, or what an engine replaces by it. Commands of their own need a number, so that it
    /// returns `None` for another text.
    pub fn command(&self, gelato: &str, task: &str) -> Option<Vec<String>> {
        match &self.work {
            Work::Commands(commands) => commands.get(task.parse::<usize>().ok()?).cloned(),
            Work::Frames { frames, chunk, words } => {
                let frames = frames.to_string();
                let own = [gelato, "-frames", &frames, "-chunk", &chunk.to_string(), "-task", task]
                    .map(str::to_owned);
                Some(own.into_iter().chain(words.iter().cloned()).collect())
            }
        }
    }
}

impl Job {
    /// Reads the JSON of a job.
    ///
    /// # Errors
    /// Returns an error that names the line, or the step that is wrong.
    pub fn read(text: &str) -> Result<Self, JobError> {
        let text: JobText = serde_json::from_str(text)?;
        let wrong = |what: String| Err(JobError::Wrong(what));
        if !is_name(&text.name) {
            return wrong(format!("\"name\": \"{}\" is no name; expected letters, digits, - _ .", text.name));
        }
        if text.steps.is_empty() {
            return wrong("it has no steps".to_owned());
        }
        let mut steps: Vec<Step> = Vec::new();
        let mut names = HashSet::new();
        for step in text.steps {
            let name = step.name.clone();
            if !is_name(&name) || !names.insert(name.clone()) {
                return wrong(format!(
                    "step \"{name}\": its name must be of letters, digits, - _ . and its own"
                ));
            }
            let mut after = Vec::new();
            for other in &step.after {
                match steps.iter().position(|step| step.name == *other) {
                    Some(at) => after.push(at),
                    None => return wrong(format!("step \"{name}\": no step before it is named \"{other}\"")),
                }
            }
            let (cores, memory_mb) = (step.cores, step.memory_mb);
            let work = work(step).map_err(|what| JobError::Wrong(format!("step \"{name}\": {what}")))?;
            steps.push(Step { name, after, work, cores, memory_mb });
        }
        Ok(Self { name: text.name, steps })
    }

    /// Returns a job of one step that renders frames. `name` may have a place for their number, which is left out.
    pub fn of_frames(name: &str, frames: FrameRange, chunk: usize, words: Vec<String>) -> Self {
        let kept = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
        let name: String = unnumbered(name).chars().map(|c| if kept(c) { c } else { '_' }).collect();
        let name = if is_name(&name) { name } else { "job".to_owned() };
        let work = Work::Frames { frames, chunk: chunk.max(1), words };
        let step = Step { name: "frames".to_owned(), after: Vec::new(), work, cores: 0, memory_mb: 0 };
        Self { name, steps: vec![step] }
    }
}

fn work(step: StepText) -> Result<Work, String> {
    if step.scene.is_empty() {
        if step.commands.is_empty() || step.commands.iter().any(Vec::is_empty) {
            return Err(
                "it needs \"commands\", each a list of words, or a \"scene\" with its files".to_owned()
            );
        }
        if step.frames.is_some() || step.chunk.is_some() || !step.options.is_empty() {
            return Err("\"frames\", \"chunk\" and \"options\" belong to a \"scene\"".to_owned());
        }
        return Ok(Work::Commands(step.commands));
    }
    if !step.commands.is_empty() {
        return Err("it has both \"commands\" and a \"scene\"".to_owned());
    }
    let frames = step.frames.ok_or("a \"scene\" needs \"frames\"")?;
    let frames = frames.parse::<FrameRange>().map_err(|error| format!("\"frames\": {error}"))?;
    let chunk = step.chunk.unwrap_or(1);
    if chunk == 0 {
        return Err("\"chunk\" is at least 1".to_owned());
    }
    Ok(Work::Frames { frames, chunk, words: [step.options, step.scene].concat() })
}

/// True for names that every engine and file system accepts.
fn is_name(name: &str) -> bool {
    let first = name.chars().next();
    first.is_some_and(|c| c.is_ascii_alphanumeric())
        && name.len() <= 100
        && name.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrong_jobs_are_refused_with_the_step() {
        let step = |text: &str| format!("{{\"name\": \"j\", \"steps\": [{text}]}}");
        for (text, part) in [
            ("{", "line 1 column 1"),
            ("{\"name\": \"a b\", \"steps\": []}", "\"a b\" is no name"),
            ("{\"name\": \"j\", \"steps\": []}", "it has no steps"),
            (&step("{\"name\": \"s\"}"), "step \"s\": it needs \"commands\""),
            (&step("{\"name\": \"s\", \"commands\": [[]]}"), "step \"s\": it needs \"commands\""),
            (&step("{\"name\": \"s\", \"scene\": [\"a\"]}"), "step \"s\": a \"scene\" needs \"frames\""),
            (
                &step("{\"name\": \"s\", \"scene\": [\"a\"], \"frames\": \"x\"}"),
                "step \"s\": \"frames\": \"x\"",
            ),
            (&step("{\"name\": \"s\", \"scene\": [\"a\"], \"frames\": \"1\", \"chunk\": 0}"), "at least 1"),
            (&step("{\"name\": \"s\", \"commands\": [[\"a\"]], \"chunk\": 1}"), "belong to a \"scene\""),
            (&step("{\"name\": \"s\", \"commands\": [[\"a\"]], \"after\": [\"t\"]}"), "named \"t\""),
            (&step("{\"name\": \"s\", \"commands\": [[\"a\"]], \"typo\": 1}"), "unknown field `typo`"),
        ] {
            let error = Job::read(text).unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    #[test]
    fn commands_of_tasks_name_their_frames() {
        let job = Job::of_frames("a/b shot.pyg", "1-9".parse().unwrap(), 2, vec!["s.#.pyg".to_owned()]);
        assert_eq!(job.name, "a_b_shot.pyg");
        assert_eq!(Job::of_frames("shot.####", "1".parse().unwrap(), 1, Vec::new()).name, "shot");
        assert_eq!(Job::of_frames("####", "1".parse().unwrap(), 1, Vec::new()).name, "job");
        let step = &job.steps[0];
        assert_eq!(step.tasks(), 5);
        let words = step.command("gelato", "$ID").unwrap().join(" ");
        assert_eq!(words, "gelato -frames 1-9 -chunk 2 -task $ID s.#.pyg");
    }
}
