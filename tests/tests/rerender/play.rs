//! Plays a sequence of edits in sessions, and compares their images.

use crate::edits::{Frame, Random, edit};
use crate::files;
use crate::model::{Stage, Value};
use crate::player::{Images, Player};
use crate::scenes;
use tempfile::TempDir;

/// Compares the images of two frames.
///
/// # Errors
/// Returns the first difference.
pub(crate) fn compare(got: &Images, expected: &Images) -> Result<(), String> {
    let names = |images: &Images| images.keys().cloned().collect::<Vec<_>>();
    if names(got) != names(expected) {
        return Err(format!("the images are {:?} and should be {:?}", names(got), names(expected)));
    }
    if expected.is_empty() {
        return Err("there are no images".to_owned());
    }
    for (name, image) in expected {
        let got = &got[name];
        if (got.x, got.y) != (image.x, image.y) {
            return Err(format!(
                "{name} begins at {:?} and should at {:?}",
                (got.x, got.y),
                (image.x, image.y)
            ));
        }
        got.identical(image).map_err(|what| format!("{name} (re-rendered, anew): {what}"))?;
    }
    Ok(())
}

/// The folder of a sequence, with the files of its scene.
pub(crate) struct Place {
    folder: TempDir,
    /// The number of files that were put there.
    count: u64,
}

impl Place {
    /// Returns a folder with the files of a scene.
    pub(crate) fn new(stage: &Stage) -> Self {
        let mut place = Self { folder: tempfile::tempdir().unwrap(), count: 0 };
        std::fs::create_dir(place.folder.path().join("out")).unwrap();
        for (name, text) in &stage.texts {
            std::fs::write(place.folder.path().join(name), text).unwrap();
        }
        stage.files.iter().for_each(|file| place.put(file.name, file.version));
        place
    }

    /// Puts a version of a file there.
    pub(crate) fn put(&mut self, name: &str, version: usize) {
        self.count += 1;
        files::place(name, version, self.folder.path(), self.count);
    }

    /// Returns a session that keeps what it can between frames.
    pub(crate) fn keeping(&self, threads: usize) -> Player {
        Player::new(self.folder.path(), threads, false)
    }

    /// Returns a session that renders each frame anew.
    pub(crate) fn anew(&self, threads: usize) -> Player {
        Player::new(self.folder.path(), threads, true)
    }
}

/// The frame of calls in both sessions, and its images where they are equal.
///
/// # Errors
/// Returns the messages of a session, or the first difference.
pub(crate) fn both(keeping: &mut Player, anew: &mut Player, text: &str) -> Result<Images, String> {
    let got = keeping.frame(text).map_err(|what| format!("the re-rendering session reports: {what}"))?;
    let expected =
        anew.frame(text).map_err(|what| format!("the session without re-rendering reports: {what}"))?;
    compare(&got, &expected)?;
    Ok(expected)
}

/// The result of a sequence.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Played {
    /// The number of compared frames.
    pub(crate) frames: usize,
    /// The number of edits.
    pub(crate) edits: usize,
    /// The number of frames that differ from the frame before them.
    pub(crate) changes: usize,
}

/// Plays the sequence of a seed: two to ten edits of one scene, with a frame after each or after some of them.
///
/// # Errors
/// Returns the calls so far and the first difference.
pub(crate) fn sequence(seed: u32) -> Result<Played, String> {
    let mut random = Random::new(seed);
    // Consecutive seeds take all scenes.
    let mut stage = scenes::scene(seed as usize);
    let first = stage.clone();
    let mut place = Place::new(&stage);
    let threads = 1 + random.below(2);
    let (mut keeping, mut anew) = (place.keeping(threads), place.anew(3 - threads));
    let mut script = first.pyg() + "Render ()\n";
    let about = |what: String, script: &str| {
        format!(
            "seed {seed}, scene \"{}\", {threads} threads and {}:\n{script}{what}\n\
             `cargo xtask rerender --sequences 1 --seed {seed}` repeats it",
            first.name,
            3 - threads
        )
    };
    let mut last = both(&mut keeping, &mut anew, &script).map_err(|what| about(what, &script))?;
    let mut frames: Vec<Frame> = Vec::new();
    let mut changes = 0;
    let count = 2 + random.below(9);
    let mut left = count;
    while left > 0 {
        let mut frame = Frame::default();
        for _ in 0..(1 + random.below(5) / 3).min(left) {
            edit(&mut stage, &mut random, &mut frame);
            left -= 1;
        }
        frame.files.iter().for_each(|(name, version)| place.put(name, *version));
        let text = frame.pyg();
        script += &format!("\n# Frame {}: {}\n{text}", frames.len() + 2, frame.names.join(", "));
        let images = both(&mut keeping, &mut anew, &text).map_err(|what| about(what, &script))?;
        changes += usize::from(compare(&images, &last).is_err());
        last = images;
        frames.push(frame);
    }
    let got = at_once(&place, &first, &stage, &frames, threads).and_then(|got| compare(&got, &last));
    got.map_err(|what| about(format!("all edits at once: {what}"), &script))?;
    Ok(Played { frames: frames.len() + 2, edits: count, changes })
}

/// Renders a scene once, with crops of a few pixels, and then the last frame with all edits before it.
fn at_once(
    place: &Place,
    first: &Stage,
    last: &Stage,
    frames: &[Frame],
    threads: usize,
) -> Result<Images, String> {
    let mut small = first.clone();
    for camera in small.cameras.iter_mut() {
        camera.params.set("float[4] crop", Value::from([0.45, 0.5, 0.5, 0.6]));
    }
    let mut session = place.keeping(threads);
    session.frame(&(small.pyg() + "Render ()\n"))?;
    // The last state of each camera, after the edits.
    let mut text: String = frames.iter().map(|frame| frame.before_world.as_str()).collect();
    for camera in &last.cameras {
        let mut camera = camera.clone();
        if camera.params.0.iter().all(|(name, _)| *name != "float[4] crop") {
            camera.params.set("float[4] crop", [0.0, 1.0, 0.0, 1.0].into());
        }
        text += &camera.pyg();
    }
    text += "World ()\n";
    frames.iter().for_each(|frame| text += &frame.after_world);
    if let Some(frame) = frames.last() {
        text += &frame.render();
    }
    session.frame(&text)
}
