//! Executes `Command` (reference 4.5).

use crate::SessionOptions;
use granita_base::{Location, ParamData, Params, Reporter, Severity};
use granita_inputs::{prepare, program, shell};
use granita_render::{PixelRect, Priority};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Runs one command. Returns true when the command exists.
pub(crate) fn run(
    name: &str,
    params: &Params,
    at: &Location,
    options: &SessionOptions,
    context: &CommandContext,
) -> bool {
    let name = name.trim();
    let (word, rest) = name.split_once(char::is_whitespace).unwrap_or((name, ""));
    let command = Running { params, at, options, context };
    match word {
        "system" if !rest.trim().is_empty() => command.shell(rest.trim()),
        "system" => command.program(),
        "mkdir" => command.file("mkdir", |path| match std::fs::create_dir(path) {
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => Ok(()),
            other => other,
        }),
        "unlink" => command.file("unlink", |path| std::fs::remove_file(path)),
        "return" => context.stop.store(true, Ordering::Relaxed),
        // A blocking renderer is never in the middle of a frame when a scene's command arrives, so there is nothing
        // to wait for.
        "wait" => (),
        "bucketpriority" => command.priority(),
        "fileread" => match params.string("name") {
            Some(name) => context.reporter.file_read(Path::new(&**name)),
            None => {
                let text = "Command \"fileread\" needs the parameter \"string name\"";
                context.reporter.say(Severity::Error, at, text);
            }
        },
        _ => return false,
    }
    true
}

/// Returns a command as one line of text: its name, and the words of its parameter "command" or "name".
pub(crate) fn text(name: &str, params: &Params) -> String {
    let words = params.get("command").or_else(|| params.get("name")).map(|param| &param.data);
    let Some(ParamData::String(words)) = words else { return name.trim().to_owned() };
    std::iter::once(name.trim()).chain(words.iter().map(|word| &**word)).collect::<Vec<_>>().join(" ")
}

/// The state that commands act on.
pub(crate) struct CommandContext {
    /// Receives messages.
    pub(crate) reporter: Reporter,
    /// Ends the frame.
    pub(crate) stop: Arc<AtomicBool>,
    /// The priority of buckets of the frame that is being rendered. It is reset when a frame begins.
    pub(crate) priority: Arc<Priority>,
}

/// The request of `Command ("bucketpriority")`, in pixels of the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PriorityRequest {
    /// Continues around this pixel.
    Center([i32; 2]),
    /// Renders these pixels first, from the first up to and including the last one: xmin, ymin, xmax, ymax.
    Rectangle([i32; 4]),
}

impl PriorityRequest {
    /// Reads the parameters of the command.
    pub(crate) fn of(params: &Params) -> Result<Self, &'static str> {
        let ints = |name: &str| params.get(name).and_then(|p| p.data.to_ints());
        let (center, rectangle) = (ints("center"), ints("rectangle"));
        match (center.as_deref(), rectangle.as_deref()) {
            (Some([x, y]), None) => Ok(Self::Center([*x, *y])),
            (None, Some([x0, y0, x1, y1])) => Ok(Self::Rectangle([*x0, *y0, *x1, *y1])),
            _ => Err(
                "Command \"bucketpriority\" needs the parameter \"int[2] center\" or \"int[4] rectangle\"",
            ),
        }
    }

    /// Changes the order of the waiting buckets.
    pub(crate) fn apply(self, priority: &Priority) {
        match self {
            Self::Center([x, y]) => priority.center(x, y),
            Self::Rectangle([x0, y0, x1, y1]) => {
                let (x1, y1) = (x1.saturating_add(1), y1.saturating_add(1));
                priority.rectangle(PixelRect { x0, y0, x1, y1 });
            }
        }
    }

    /// Returns its numbers for a connection.
    pub(crate) fn to_bytes(self) -> Vec<u8> {
        let numbers = match &self {
            Self::Center(center) => &center[..],
            Self::Rectangle(rectangle) => &rectangle[..],
        };
        numbers.iter().flat_map(|n| n.to_le_bytes()).collect()
    }

    /// Reads the result of [`PriorityRequest::to_bytes`].
    pub(crate) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (numbers, rest) = bytes.as_chunks::<4>();
        let numbers: Vec<i32> = numbers.iter().map(|n| i32::from_le_bytes(*n)).collect();
        match numbers[..] {
            [x, y] if rest.is_empty() => Some(Self::Center([x, y])),
            [x0, y0, x1, y1] if rest.is_empty() => Some(Self::Rectangle([x0, y0, x1, y1])),
            _ => None,
        }
    }
}

struct Running<'a> {
    params: &'a Params,
    at: &'a Location,
    options: &'a SessionOptions,
    context: &'a CommandContext,
}

impl Running<'_> {
    fn say(&self, severity: Severity, text: String) {
        self.context.reporter.say(severity, self.at, text);
    }

    /// Runs the first form, a line for the shell.
    fn shell(&self, line: &str) {
        let mut command = shell(line, &self.options.run);
        self.start(&mut command, line, true);
    }

    /// Runs the second form, a program with arguments. Waits for it unless "wait" is 0.
    fn program(&self) {
        let words = ["command", "argv"].iter().find_map(|name| match &self.params.get(name)?.data {
            ParamData::String(words) if !words.is_empty() => Some(words.clone()),
            _ => None,
        });
        let Some(words) = words else {
            return self.say(
                Severity::Error,
                "Command \"system\" needs a command line, or the parameter \"string[n] command\"".to_owned(),
            );
        };
        let line = words.iter().map(|w| &**w).collect::<Vec<_>>().join(" ");
        let mut command = program(&words[0], &self.options.run);
        command.args(words[1..].iter().map(|w| &**w));
        prepare(&mut command, &self.options.run);
        if self.params.int("echo").is_some_and(|e| e != 0) {
            self.say(Severity::Message, format!("{line}\n"));
        }
        self.start(&mut command, &line, self.params.int("wait") != Some(0));
    }

    fn start(&self, command: &mut Command, line: &str, wait: bool) {
        if self.options.run.safe {
            return self.say(Severity::Error, format!("programs are not allowed: \"{line}\" is not run"));
        }
        let supervisor = &self.options.run.supervisor;
        let ran =
            supervisor.spawn(command, format!("running \"{line}\"")).and_then(|mut process| match wait {
                true => process.wait().map(Some),
                false => {
                    process.detach();
                    Ok(None)
                }
            });
        match ran {
            Ok(None) => (),
            Ok(Some(status)) if status.success() => (),
            // A failure because the program was ended is not reported.
            _ if supervisor.has_ended() => (),
            Ok(Some(status)) => self.say(Severity::Error, format!("\"{line}\" failed: {status}")),
            Err(error) => self.say(Severity::Error, format!("cannot run \"{line}\": {error}")),
        }
    }

    fn priority(&self) {
        match PriorityRequest::of(self.params) {
            Ok(request) => request.apply(&self.context.priority),
            Err(what) => self.say(Severity::Error, what.to_owned()),
        }
    }

    /// Runs "mkdir" and "unlink" with one parameter "name".
    fn file(&self, word: &str, act: impl FnOnce(&str) -> std::io::Result<()>) {
        let Some(name) = self.params.string("name") else {
            return self
                .say(Severity::Error, format!("Command \"{word}\" needs the parameter \"string name\""));
        };
        if self.options.run.safe {
            return self.say(Severity::Error, format!("Command \"{word}\" \"{name}\" is not allowed"));
        }
        if let Err(error) = act(name) {
            self.say(Severity::Error, format!("Command \"{word}\" \"{name}\": {error}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::Param;
    use granita_inputs::{OwnTools, RunOptions};

    fn context() -> (CommandContext, Arc<parking_lot::Mutex<Vec<granita_base::report::Message>>>) {
        let (reporter, kept) = Reporter::collecting();
        (CommandContext { reporter, stop: Arc::default(), priority: Arc::default() }, kept)
    }

    fn command(name: &str, params: Params, options: &SessionOptions) -> (bool, usize) {
        let (context, kept) = context();
        let known = run(name, &params, &Location::default(), options, &context);
        let said = kept.lock().len();
        (known, said)
    }

    #[test]
    fn files_are_made_and_deleted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new");
        let name = || Params(vec![Param::declared("string name", path.to_str().unwrap()).unwrap()]);
        let options = SessionOptions::default();
        assert_eq!(command("mkdir", name(), &options), (true, 0));
        assert!(path.is_dir());
        assert_eq!(command("mkdir", name(), &options), (true, 0), "there already is no error");
        std::fs::remove_dir(&path).unwrap();
        std::fs::write(&path, "x").unwrap();
        assert_eq!(command("unlink", name(), &options), (true, 0));
        assert!(!path.exists());
        assert_eq!(command("unlink", name(), &options).1, 1);
        assert_eq!(command("mkdir", Params::new(), &options).1, 1);
    }

    #[test]
    fn a_priority_is_a_pixel_or_a_rectangle() {
        let options = SessionOptions::default();
        let ints = |declaration: &str, values: &[i32]| Param::declared(declaration, values).unwrap();
        let (center, rectangle) =
            (ints("int[2] center", &[3, 4]), ints("int[4] rectangle", &[0, 0, i32::MAX, -5]));
        for good in [vec![center.clone()], vec![rectangle.clone()]] {
            assert_eq!(command("bucketpriority", Params(good), &options), (true, 0));
        }
        for bad in [vec![], vec![center, rectangle], vec![ints("int[3] center", &[1, 2, 3])]] {
            assert_eq!(command("bucketpriority", Params(bad), &options), (true, 1));
        }
    }

    #[test]
    fn requests_survive_a_connection() {
        for request in [PriorityRequest::Center([-3, i32::MAX]), PriorityRequest::Rectangle([0, -1, 2, 3])] {
            let bytes = request.to_bytes();
            assert_eq!(PriorityRequest::from_bytes(&bytes), Some(request));
            for n in 0..bytes.len() {
                assert!(PriorityRequest::from_bytes(&bytes[..n]).is_none() || n == 8, "{n}");
            }
        }
        assert_eq!(PriorityRequest::from_bytes(&[0; 9]), None);
    }

    #[test]
    fn programs_run_in_both_forms() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("out");
        let options = SessionOptions::default();
        let line = format!("system echo hello > {}", file.display());
        assert_eq!(command(&line, Params::new(), &options), (true, 0));
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "hello\n");
        for name in ["command", "argv"] {
            let words: Arc<[Arc<str>]> = ["touch".into(), file.to_str().unwrap().into()].into();
            std::fs::remove_file(&file).unwrap();
            let ty = granita_base::ParamType::array(granita_base::BaseType::String, 2);
            let params = Params(vec![Param { name: name.into(), ty, data: ParamData::String(words) }]);
            assert_eq!(command("system", params, &options), (true, 0));
            assert!(file.exists(), "{name}");
        }
        assert_eq!(command("system exit 3", Params::new(), &options).1, 1);
        let safe = SessionOptions { run: RunOptions { safe: true, ..options.run }, ..options };
        assert_eq!(command("system true", Params::new(), &safe).1, 1);
    }

    #[cfg(unix)]
    #[test]
    fn the_names_of_our_own_tools_mean_our_own_program() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("it's here");
        let own = OwnTools { program: "/bin/echo".into(), names: vec!["maketx".to_owned()] };
        let run = RunOptions { own_tools: Some(own), ..RunOptions::default() };
        let options = SessionOptions { run, ..SessionOptions::default() };
        let line = format!("system true && maketx 'a  b' c | cat > \"{}\"", file.display());
        assert_eq!(command(&line, Params::new(), &options), (true, 0));
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "--as maketx a  b c\n");
        assert_eq!(command("nosuchcommand", Params::new(), &options), (false, 0));
    }
}
