//! The process of one case: a session that renders a scene and its edits into memory, and prints the times.

use granita_base::Reporter;
use granita_image::{
    CreateOptions, Format, ImageError, ImageInput, ImageOutput, ImageSpec, Limits, PixelType, Pixels, Result,
};
use granita_session::{Session, SessionOptions};
use parking_lot::{Mutex, MutexGuard};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The separator of edits in their file.
pub(crate) const EDIT: &str = "# edit\n";

/// An image that was received.
#[derive(Default)]
struct Received {
    /// The time of its last pixel.
    complete: Option<Instant>,
    spec: Option<ImageSpec>,
    values: Vec<f32>,
}

/// The image of the scene, in the memory of this process.
#[derive(Clone, Default)]
struct Memory(Arc<Mutex<Received>>);

impl Memory {
    fn received(&self) -> MutexGuard<'_, Received> {
        self.0.lock()
    }
}

fn misuse<T>(path: &Path) -> Result<T> {
    Err(ImageError::Misuse { path: path.to_owned(), what: "an image in memory takes rows".to_owned() })
}

impl Format for Memory {
    fn name(&self) -> &'static str {
        "memory"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &[]
    }

    fn recognizes(&self, _: &[u8]) -> bool {
        false
    }

    fn open(&self, path: &Path, _: &Limits) -> Result<Box<dyn ImageInput>> {
        misuse(path)
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "half" | "float" | "u16" | "channels" | "alpha")
    }

    fn output_type(&self, _: PixelType) -> PixelType {
        PixelType::Float
    }

    fn create(&self, _: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        *self.received() = Received { spec: Some(options.spec.clone()), ..Received::default() };
        Ok(Box::new(self.clone()))
    }
}

impl ImageOutput for Memory {
    fn write_rows(&mut self, pixels: &Pixels) -> Result<()> {
        self.received().values.extend(pixels.to_floats());
        Ok(())
    }

    fn write_tile(&mut self, _: u32, _: u32, _: &Pixels) -> Result<()> {
        misuse(Path::new("image"))
    }

    fn next_level(&mut self, _: &ImageSpec) -> Result<()> {
        misuse(Path::new("image"))
    }

    fn close(self: Box<Self>) -> Result<()> {
        self.received().complete = Some(Instant::now());
        Ok(())
    }
}

/// Runs a case. The words are "kept" or "anew", the number of threads, the scene and the file of edits. It prints the
/// times of the first frame and of each edit, of writing the image as OpenEXR, in seconds, and the peak memory in
/// bytes.
///
/// # Errors
/// Returns the messages of the session.
pub(crate) fn run(words: &[String]) -> std::result::Result<(), String> {
    let [mode, threads, scene, edits] = words else { return Err(format!("a child got {words:?}")) };
    let options = SessionOptions {
        no_startup_files: true,
        threads: threads.parse().map_err(|_| format!("{threads} threads"))?,
        rerenders_anew: mode == "anew",
        ..SessionOptions::default()
    };
    let (reporter, messages) = Reporter::collecting();
    let mut session = Session::new(options, reporter, Default::default());
    let memory = Memory::default();
    let format = memory.clone();
    session.plugins().set_program_images(Arc::new(move |_| Arc::new(format.clone())));
    let mut play = |text: String| -> std::result::Result<Duration, String> {
        memory.received().complete = None;
        let begin = Instant::now();
        let read = session.read_stream("<case>", Box::new(std::io::Cursor::new(text.into_bytes())));
        read.map_err(|error| error.to_string())?;
        let complete = memory.received().complete;
        let said: Vec<String> = messages.lock().iter().map(ToString::to_string).collect();
        if said.iter().any(|text| text.contains("error")) {
            return Err(said.join("\n"));
        }
        Ok(complete.ok_or("no image came")?.saturating_duration_since(begin))
    };
    let read = |file: &String| std::fs::read_to_string(file).map_err(|e| format!("{file}: {e}"));
    println!("first {}", play(read(scene)?)?.as_secs_f64());
    for text in read(edits)?.split(EDIT).filter(|text| !text.is_empty()) {
        println!("edit {}", play(text.to_owned())?.as_secs_f64());
    }
    println!("write {}", write(&memory)?.as_secs_f64());
    if let Some(bytes) = peak_bytes() {
        println!("peak {bytes}");
    }
    Ok(())
}

/// Writes the image as OpenEXR and returns the time.
fn write(memory: &Memory) -> std::result::Result<Duration, String> {
    let received = memory.received();
    let mut spec = received.spec.clone().ok_or("no image")?;
    spec.pixel_type = PixelType::Half;
    let formats = granita_plugin::bundled_formats(Limits::default());
    let begin = Instant::now();
    let options = CreateOptions::new(&spec, 1);
    let mut file =
        formats.create(Path::new("written.exr"), "OpenEXR", &options).map_err(|e| e.to_string())?;
    file.write_rows(&Pixels::from_floats(PixelType::Half, &received.values)).map_err(|e| e.to_string())?;
    file.close().map_err(|e| e.to_string())?;
    Ok(begin.elapsed())
}

/// Returns the largest resident size of this process so far; `None` where the system does not provide it.
fn peak_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}
