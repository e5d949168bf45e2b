//! A session in this process, and the images that it makes.

use granita_base::Reporter;
use granita_session::{Outcome, Session, SessionOptions};
use granita_tests::Image;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A part of a message that is expected: edits replace lights, also several times before one frame.
const REPLACED: &str = "is declared again";

/// The images of a frame by the names of their files.
pub(crate) type Images = BTreeMap<String, Image>;

/// A session that receives a scene and its edits.
pub(crate) struct Player {
    session: Session,
    /// Returns the errors and warnings so far, without those that are expected.
    messages: Box<dyn Fn() -> Vec<String>>,
    /// The number of messages that were forgotten.
    forgotten: usize,
    folder: PathBuf,
}

impl Player {
    /// Returns a session whose files are in a folder.
    pub(crate) fn new(folder: &Path, threads: usize, rerenders_anew: bool) -> Self {
        let (reporter, kept) = Reporter::collecting();
        let options =
            SessionOptions { no_startup_files: true, threads, rerenders_anew, ..SessionOptions::default() };
        let messages = Box::new(move || {
            let all = kept.lock().iter().map(ToString::to_string).collect::<Vec<_>>();
            all.into_iter().filter(|text| !text.contains(REPLACED)).collect()
        });
        Self {
            session: Session::new(options, reporter, Default::default()),
            messages,
            forgotten: 0,
            folder: folder.to_owned(),
        }
    }

    /// Executes calls. "@" stands for the folder.
    ///
    /// # Errors
    /// Returns the messages about the calls.
    fn play(&mut self, text: &str) -> Result<(), String> {
        let placed = text.replace('@', &self.folder.to_string_lossy());
        let bytes = std::io::Cursor::new(placed.into_bytes());
        self.session.read_stream("<edits>", Box::new(bytes)).map_err(|error| error.to_string())?;
        let said = (self.messages)().split_off(self.forgotten);
        if said.is_empty() { Ok(()) } else { Err(said.join("\n")) }
    }

    /// Executes calls that render a frame, and returns its images.
    ///
    /// # Errors
    /// Returns the messages about the calls.
    pub(crate) fn frame(&mut self, text: &str) -> Result<Images, String> {
        self.play(text)?;
        let mut images = Images::new();
        for entry in std::fs::read_dir(self.folder.join("out")).map_err(|e| e.to_string())? {
            let path = entry.map_err(|e| e.to_string())?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            images.insert(name, Image::read(&path)?);
            std::fs::remove_file(&path).map_err(|e| e.to_string())?;
        }
        Ok(images)
    }

    /// Returns a flag that ends the current frame.
    pub(crate) fn stop(&self) -> Arc<AtomicBool> {
        self.session.stop()
    }

    /// Forgets the messages so far, which a frame that is ended early may have.
    pub(crate) fn forget_messages(&mut self) {
        self.forgotten = (self.messages)().len();
    }

    /// Ends the session, and returns the records of its frames.
    pub(crate) fn finish(self) -> Outcome {
        self.session.finish()
    }
}

/// Renders a scene without any message.
pub(crate) fn render(text: &str) {
    let mut player = Player::new(Path::new(""), 1, false);
    player.play(text).unwrap();
    let outcome = player.session.finish();
    assert!(outcome.complete && outcome.images.len() == 1, "{text}");
}
