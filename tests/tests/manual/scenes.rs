//! The scenes of the manual. Blocks of "pyg" are rendered, and no message is expected. A part of a scene gets `World`
//! and `Render`. Blocks of "pyg,calls" are read only. Blocks of "pyg,rerender" are further frames of the first scene of
//! their page.

use crate::pages::{Block, pages};
use granita_base::report::Message;
use granita_base::{Reporter, Severity};
use granita_needs::has;
use granita_session::{Session, SessionError, SessionOptions};
use granita_tests::repository;
use parking_lot::Mutex;
use std::sync::OnceLock;
use tempfile::TempDir;

/// The settings before each scene, so that rendering takes no time.
const SMALL: &str = "Attribute (\"int[2] resolution\", (8, 6))\n";

/// Moves this process to a folder of its own, where the scenes write their images, with the files that they read.
fn leave() {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let suite = |file: &str| std::fs::read_to_string(repository().join("tests").join(file)).unwrap();
        let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
        write("bunny.obj", suite("suite/render/mesh-files/roof.obj"));
        write("room.gltf", suite("suite/render/gltf-scene/room.gltf").replace("\"eye\"", "\"Camera\""));
        write("grids.pyg", suite("ref/render/grid-dump-text.grids-pyg.txt"));
        std::env::set_current_dir(folder.path()).unwrap();
        folder
    });
}

/// Renders a part of a scene in the world. Returns its warnings and errors.
pub(crate) fn messages(part: &str) -> Vec<Message> {
    let world = if part.contains("World (") { "" } else { "World ()\n" };
    let render = if part.contains("Render (") { "" } else { "\nRender ()\n" };
    read(&format!("{SMALL}{world}{part}{render}"))
}

/// Reads a scene, and renders its frames. Returns its warnings and errors.
fn read(scene: &str) -> Vec<Message> {
    // Scenes without outputs write the same image.
    static TURN: Mutex<()> = Mutex::new(());
    let _turn = TURN.lock();
    leave();
    // A few pixels in the middle are enough for scenes with a resolution of their own.
    let crop = Some([0.46, 0.54, 0.46, 0.54]);
    let options = SessionOptions { no_startup_files: true, crop, ..SessionOptions::default() };
    let (reporter, kept) = Reporter::collecting();
    let mut session = Session::new(options, reporter, Default::default());
    let text = scene.as_bytes().to_vec();
    let result = session.read_stream("<manual>", Box::new(std::io::Cursor::new(text)));
    assert!(matches!(result, Ok(()) | Err(SessionError::Exit)), "{scene}\n{result:?}");
    session.finish();
    let kept = kept.lock();
    kept.iter().filter(|m| !matches!(m.severity, Severity::Info | Severity::Message)).cloned().collect()
}

/// True when a block needs Python.
fn is_script(block: &Block) -> bool {
    ["GetAttribute", "CreateRenderer", "for ", "def ", "import "].iter().any(|word| block.text.contains(word))
}

/// Returns the messages of a block. A part of a scene stands where it causes the fewest: in the world, or before it.
fn messages_of(block: &Block) -> Vec<Message> {
    let text = block.text.replace("room.glb", "room.gltf");
    if block.info == "pyg,calls" {
        return read(&format!("Camera (\"main\")\n{text}"));
    }
    let inside = messages(&text);
    if inside.is_empty() || text.contains("World (") {
        return inside;
    }
    let before = messages(&format!("{text}\nWorld ()\n"));
    if before.len() < inside.len() { before } else { inside }
}

#[test]
fn scenes_cause_no_messages() {
    let (mut faults, mut n) = (String::new(), 0);
    for page in pages() {
        let blocks = page.blocks();
        let first = blocks.iter().find(|block| block.info == "pyg").map_or("", |block| block.text.as_str());
        for block in &blocks {
            if !matches!(&*block.info, "pyg" | "pyg,calls" | "pyg,rerender")
                || is_script(block) && !has("python3")
            {
                continue;
            }
            n += 1;
            let messages = match &*block.info {
                "pyg,rerender" => read(&format!("{first}{}", block.text)),
                _ => messages_of(block),
            };
            for message in messages {
                faults += &format!("{}:{}: {message}\n", page.name, block.line);
            }
        }
    }
    assert!(faults.is_empty() && n > 50, "{n} scenes\n{faults}");
}
