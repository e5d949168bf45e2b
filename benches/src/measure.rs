//! Measures wall clock time, processor time and peak memory of a child process.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The cost of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// The wall clock time from start to exit.
    pub wall: Duration,
    /// The processor time of all threads of the process and of its own children; `None` where the system does not
    /// provide it.
    pub processor: Option<Duration>,
    /// The largest resident size that was seen, in bytes; `None` where the system does not provide it.
    pub peak_bytes: Option<u64>,
}

/// Runs `command` `times` times without its standard output, and returns the cost of the fastest run.
///
/// # Errors
/// Returns a message when a run cannot be started or fails.
pub fn measure(times: usize, mut command: impl FnMut() -> Command) -> Result<Cost, String> {
    let mut best: Option<Cost> = None;
    for _ in 0..times.max(1) {
        let cost = once(command(), Stdio::null())?;
        best = Some(best.filter(|b| b.wall <= cost.wall).unwrap_or(cost));
    }
    best.ok_or_else(|| "no run".to_owned())
}

/// Runs `command` once and writes its standard output to a file.
///
/// # Errors
/// Returns the errors of [`measure`], and a message when the file cannot be created.
pub fn measure_into(file: &Path, command: Command) -> Result<Cost, String> {
    let file = std::fs::File::create(file).map_err(|e| format!("{}: {e}", file.display()))?;
    once(command, file.into())
}

fn once(mut command: Command, stdout: Stdio) -> Result<Cost, String> {
    let before = children_time();
    let start = Instant::now();
    let mut child = command
        .stdout(stdout)
        .spawn()
        .map_err(|e| format!("{}: {e}", command.get_program().to_string_lossy()))?;
    let status_file = PathBuf::from(format!("/proc/{}/status", child.id()));
    let mut peak_bytes = None;
    loop {
        // The high-water mark only grows. The last value before the end is therefore the peak, except for the last
        // milliseconds.
        peak_bytes = high_water(&status_file).max(peak_bytes);
        if let Some(status) = child.try_wait().map_err(|e| e.to_string())? {
            let wall = start.elapsed();
            return match status.success() {
                true => {
                    let processor = children_time().zip(before).map(|(after, before)| after - before);
                    Ok(Cost { wall, processor, peak_bytes })
                }
                false => Err(format!("{command:?}: {status}")),
            };
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Returns the processor time of all children that have ended.
fn children_time() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The name of the program, in brackets, may contain any character. After it come the state and numbers. The user
    // and system time of children are the fields 16 and 17, in hundredths of a second.
    let fields: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks: u64 = fields.get(13..15)?.iter().map(|f| f.parse::<u64>().unwrap_or(0)).sum();
    Some(Duration::from_millis(ticks * 10))
}

fn high_water(status_file: &Path) -> Option<u64> {
    let text = std::fs::read_to_string(status_file).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}

/// Returns the root of the checkout.
pub fn repository() -> PathBuf {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest.parent().unwrap_or(manifest).to_owned()
}

/// Builds one of our tools for release and returns its path.
///
/// # Errors
/// Returns the message of cargo when it cannot build the tool.
pub fn release_tool(name: &str) -> Result<PathBuf, String> {
    let own = std::env::current_exe().map_err(|e| e.to_string())?;
    let folder = own.parent().ok_or("a program outside a target folder")?;
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let built = Command::new(cargo)
        .current_dir(repository())
        .args(["build", "--quiet", "--release", "--package", name, "--bins"])
        .output()
        .map_err(|e| format!("cargo build: {e}"))?;
    match built.status.success() {
        true => Ok(folder.join(format!("{name}{}", std::env::consts::EXE_SUFFIX))),
        false => Err(String::from_utf8_lossy(&built.stderr).into_owned()),
    }
}

/// Copies the files of a folder, without its folders, into a folder that is made when it is missing.
///
/// # Errors
/// Returns a message when a file cannot be copied.
pub fn copy_files(from: &Path, to: &Path) -> Result<(), String> {
    let failed = |path: &PathBuf, e: std::io::Error| format!("{}: {e}", path.display());
    std::fs::create_dir_all(to).map_err(|e| e.to_string())?;
    for entry in std::fs::read_dir(from).map_err(|e| failed(&from.to_owned(), e))? {
        let path = entry.map_err(|e| e.to_string())?.path();
        if let Some(name) = path.file_name().filter(|_| path.is_file()) {
            std::fs::copy(&path, to.join(name)).map_err(|e| failed(&path, e))?;
        }
    }
    Ok(())
}

/// Returns the path of a program on the search path.
pub fn find_program(name: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).map(|folder| folder.join(name)).find(|file| file.is_file())
}
