//! Shaders as machine code: the C that `granita-shade` prints, compiled by the compiler of the system.
//!
//! One thread compiles one source after the other, as rendering goes on. Compiled code is kept in a folder of the
//! user, under a hash of the source, the compiler and its options, and is found there by later runs. See [`cache`] for
//! the rules of that folder.

mod cache;

use crate::dso::Dso;
use granita_base::{Environment, Reporter, Supervisor};
use granita_shade::{NativeCode, NativeCompiler, NativeDone, NativeSource, NativeStrip};
use parking_lot::{Condvar, Mutex};
use sha1::{Digest, Sha1};
use std::collections::HashMap;
use std::ffi::{c_int, c_long};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The function of a source.
type Function = unsafe extern "C" fn(*const *const f32, *const f32, *const *mut f32, c_long, c_long) -> c_int;

/// The longest time for which the compiler may run.
const MOST_TIME: Duration = Duration::from_secs(60);

/// The largest number of arrays that a function reads or writes.
const MOST_ARRAYS: usize = 256;

/// Compiles shaders in the background. The bits of results do not depend on it.
///
/// It never fails a run. The first reason why code cannot be compiled is a warning, and shaders then run without it.
#[derive(Debug)]
pub struct NativeShaders {
    /// `None` once the compiler ends.
    jobs: Mutex<Option<Sender<Job>>>,
    shared: Arc<Shared>,
    worker: Option<JoinHandle<()>>,
}

/// A source to compile, and its key.
struct Job {
    key: String,
    source: NativeSource,
}

/// The state that the compiling thread shares.
#[derive(Debug, Default)]
struct Shared {
    entries: Mutex<HashMap<String, Entry>>,
    /// Notified when an entry changes.
    changed: Condvar,
    /// True when nothing more is compiled, and a running compiler is ended.
    ends: AtomicBool,
}

/// What is known about a source.
enum Entry {
    /// It is being compiled.
    Waiting(Vec<NativeDone>),
    /// The code; `None` when it cannot be compiled.
    Ended(Option<Arc<Compiled>>),
}

impl std::fmt::Debug for Entry {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Waiting(_) => "Waiting",
            Self::Ended(Some(_)) => "Ended",
            Self::Ended(None) => "Failed",
        })
    }
}

impl NativeShaders {
    /// Returns a compiler that finds the variables `PATH`, `CC`, `XDG_CACHE_HOME` and `HOME` in `environment`. Its
    /// child processes belong to `supervisor`.
    pub fn new(environment: &Environment, supervisor: &Supervisor, reporter: &Reporter) -> Self {
        let (jobs, receiver) = channel();
        let shared = Arc::<Shared>::default();
        let tool = Tool {
            environment: environment.clone(),
            supervisor: supervisor.clone(),
            shared: shared.clone(),
            ready: OnceLock::new(),
        };
        let reporter = reporter.clone();
        let work = move || work(&receiver, &tool, &reporter);
        // Without the thread nothing is compiled.
        let worker = std::thread::Builder::new().name("native".to_owned()).spawn(work).ok();
        Self { jobs: Mutex::new(Some(jobs)), shared, worker }
    }

    /// Waits until all sources so far are compiled, or `most` has passed. Returns the number of functions that are
    /// ready.
    pub fn wait(&self, most: Duration) -> usize {
        let mut entries = self.shared.entries.lock();
        let waits = |entries: &mut HashMap<String, Entry>| {
            entries.values().any(|entry| matches!(entry, Entry::Waiting(_)))
        };
        self.shared.changed.wait_while_for(&mut entries, waits, most);
        entries.values().filter(|entry| matches!(entry, Entry::Ended(Some(_)))).count()
    }
}

impl NativeCompiler for NativeShaders {
    fn compile(&self, source: NativeSource, done: NativeDone) {
        let key = hash(&[&source.text]);
        let mut entries = self.shared.entries.lock();
        match entries.get_mut(&key) {
            Some(Entry::Waiting(list)) => list.push(done),
            Some(Entry::Ended(Some(code))) => {
                let code = code.clone();
                drop(entries);
                done(code);
            }
            Some(Entry::Ended(None)) => {}
            None => {
                let job = Job { key: key.clone(), source };
                if self.jobs.lock().as_ref().is_some_and(|jobs| jobs.send(job).is_ok()) {
                    entries.insert(key, Entry::Waiting(vec![done]));
                }
            }
        }
    }
}

impl Drop for NativeShaders {
    /// Ends a compiler that runs, so that nothing is left of it.
    fn drop(&mut self) {
        self.shared.ends.store(true, Ordering::Relaxed);
        *self.jobs.lock() = None;
        if let Some(worker) = self.worker.take() {
            // Its panic was printed, and has no effect on the run.
            drop(worker.join());
        }
    }
}

/// Compiles sources until there will be no more.
fn work(jobs: &Receiver<Job>, tool: &Tool, reporter: &Reporter) {
    let shared = &*tool.shared;
    let mut has_warned = false;
    while let Ok(Job { key, source }) = jobs.recv() {
        if shared.ends.load(Ordering::Relaxed) {
            return;
        }
        let code = match tool.compile(&source) {
            Ok(code) => Some(Arc::new(code)),
            Err(why) => {
                if !tool.is_ending() && !std::mem::replace(&mut has_warned, true) {
                    reporter.warning(format!("-native: shaders run without native code: {why}"));
                }
                None
            }
        };
        let waiting = shared.entries.lock().insert(key, Entry::Ended(code.clone()));
        if let (Some(Entry::Waiting(list)), Some(code)) = (waiting, code) {
            list.into_iter().for_each(|done| done(code.clone()));
        }
        shared.changed.notify_all();
    }
}

/// Returns the hash of texts, in hexadecimal digits.
fn hash(texts: &[&str]) -> String {
    let mut hasher = Sha1::new();
    for text in texts {
        hasher.update((text.len() as u64).to_le_bytes());
        hasher.update(text);
    }
    hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The compiler of the system.
struct Tool {
    environment: Environment,
    supervisor: Supervisor,
    shared: Arc<Shared>,
    /// Found for the first source.
    ready: OnceLock<Result<Ready, String>>,
}

/// A compiler that answered, and the folder for its results.
struct Ready {
    program: String,
    /// The first line of its answer to `--version`.
    version: String,
    folder: PathBuf,
}

/// Returns the options of the compiler for this machine.
fn options() -> Vec<&'static str> {
    let mut options = vec![
        "-std=gnu99",
        "-O3",
        "-shared",
        "-fPIC",
        "-w",
        // Values are those of single operations, each rounded.
        "-ffp-contract=off",
        // These have no effect on values: nothing reads errno, and no trap is enabled.
        "-fno-math-errno",
        "-fno-trapping-math",
    ];
    #[cfg(target_arch = "x86_64")]
    {
        options.extend(["-msse2", "-mfpmath=sse"]);
        let has_wide = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl");
        if has_wide {
            options.extend([
                "-mavx512f",
                "-mavx512bw",
                "-mavx512dq",
                "-mavx512vl",
                "-mprefer-vector-width=512",
            ]);
        } else if is_x86_feature_detected!("avx2") {
            options.push("-mavx2");
        }
    }
    options
}

impl Tool {
    /// Returns the code of a source, from the folder or from the compiler.
    fn compile(&self, source: &NativeSource) -> Result<Compiled, String> {
        let ready = self.ready.get_or_init(|| self.find()).as_ref().map_err(Clone::clone)?;
        let key = hash(&[&source.text, &ready.program, &ready.version, &options().join(" ")]);
        let file = ready.folder.join(format!("{key}.so"));
        // A file that cannot be loaded, such as one that a full disk cut short, is made again.
        if cache::is_own_file(&file)
            && let Ok(code) = Compiled::load(&file, source)
        {
            return Ok(code);
        }
        self.make(ready, source, &file)?;
        Compiled::load(&file, source)
    }

    /// True when the run ends.
    fn is_ending(&self) -> bool {
        self.shared.ends.load(Ordering::Relaxed) || self.supervisor.has_ended()
    }

    fn find(&self) -> Result<Ready, String> {
        let program = self.environment.get("CC").filter(|name| !name.is_empty()).unwrap_or("cc").to_owned();
        let folder = cache::folder(&self.environment)?;
        let answer = self.run(&program, &["--version".to_owned()], &folder)?;
        let version = answer.lines().next().unwrap_or_default().to_owned();
        Ok(Ready { program, version, folder })
    }

    /// Compiles a source to a file, which appears as a whole.
    fn make(&self, ready: &Ready, source: &NativeSource, file: &Path) -> Result<(), String> {
        let io = |path: &Path, error: std::io::Error| format!("{}: {error}", path.display());
        let place = tempfile::tempdir_in(&ready.folder).map_err(|e| io(&ready.folder, e))?;
        let (text, made) = (place.path().join("shader.c"), place.path().join("shader.so"));
        std::fs::write(&text, &source.text).map_err(|e| io(&text, e))?;
        let mut words: Vec<String> = options().into_iter().map(str::to_owned).collect();
        words.extend(["-o", "shader.so", "shader.c", "-lm"].map(str::to_owned));
        self.run(&ready.program, &words, place.path())?;
        std::fs::rename(&made, file).map_err(|e| io(file, e))
    }

    /// Runs the compiler in a folder, and returns its output.
    fn run(&self, program: &str, words: &[String], folder: &Path) -> Result<String, String> {
        let mut output = tempfile::tempfile_in(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        let same = |file: &std::fs::File| file.try_clone().map_err(|e| e.to_string());
        let mut command = Command::new(program);
        command.args(words).current_dir(folder).stdin(Stdio::null());
        command.stdout(same(&output)?).stderr(same(&output)?);
        let started = self.supervisor.spawn(&mut command, format!("compiling a shader with {program}"));
        let mut process = started.map_err(|e| format!("the C compiler \"{program}\" does not start: {e}"))?;
        let begin = Instant::now();
        let status = process
            .wait_while(|| begin.elapsed() < MOST_TIME && !self.is_ending())
            .map_err(|e| format!("{program}: {e}"))?;
        let mut text = Vec::new();
        std::io::Seek::rewind(&mut output)
            .and_then(|()| std::io::Read::read_to_end(&mut output, &mut text))
            .map_err(|e| e.to_string())?;
        let text = String::from_utf8_lossy(&text).into_owned();
        match status.success() {
            true => Ok(text),
            false => {
                let first = text.lines().next().unwrap_or_default();
                Err(format!("the C compiler \"{program}\" fails ({status}): {first}"))
            }
        }
    }
}

/// A loaded function. Its library is never unloaded.
#[derive(Debug)]
struct Compiled {
    function: Function,
    inputs: usize,
    scalars: usize,
    outputs: usize,
}

impl Compiled {
    /// Loads the function of a source.
    fn load(file: &Path, source: &NativeSource) -> Result<Self, String> {
        let &NativeSource { inputs, scalars, outputs, .. } = source;
        if inputs.max(outputs) > MOST_ARRAYS {
            return Err(format!("{inputs} inputs and {outputs} outputs: more than {MOST_ARRAYS}"));
        }
        let dso = Dso::load(file).map_err(|e| format!("{}: {e}", file.display()))?;
        let symbol = dso.symbol("granita").ok_or_else(|| format!("{}: no function", file.display()))?;
        // SAFETY: the file was compiled from the source, whose function has this type. Nobody but the user and the
        // compiler can write it (`cache`).
        let function = unsafe { std::mem::transmute::<*mut std::ffi::c_void, Function>(symbol) };
        Ok(Self { function, inputs, scalars, outputs })
    }
}

impl NativeCode for Compiled {
    fn run(&self, strip: &mut NativeStrip<'_, '_>) -> bool {
        let NativeStrip { inputs, scalars, outputs, lanes } = strip;
        let (Ok(from), Ok(to)) = (c_long::try_from(lanes.start), c_long::try_from(lanes.end)) else {
            return false;
        };
        assert!(
            (inputs.len(), scalars.len(), outputs.len()) == (self.inputs, self.scalars, self.outputs)
                && inputs.iter().all(|values| values.len() >= lanes.end)
                && outputs.iter().all(|values| values.len() >= lanes.end),
            "invariant: the arrays are those of the source"
        );
        let mut read = [std::ptr::null(); MOST_ARRAYS];
        let mut written = [std::ptr::null_mut(); MOST_ARRAYS];
        read.iter_mut().zip(&**inputs).for_each(|(to, values)| *to = values.as_ptr());
        written.iter_mut().zip(&mut **outputs).for_each(|(to, values)| *to = values.as_mut_ptr());
        // SAFETY: the function reads and writes the lanes `from..to` of as many arrays as the source states, which was
        // checked, and that many scalars. Arrays that are written are borrowed alone.
        unsafe { (self.function)(read.as_ptr(), scalars.as_ptr(), written.as_ptr(), from, to) == 0 }
    }
}
