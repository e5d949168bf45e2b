// tidy: long: the state of an image and all that changes it are in one file
//! Images that arrive while they are rendered.
//!
//! Receivers of pixels (a listener to renderers, a test) create images and update them. Viewers (a window, a page in a
//! browser) query the changes and read them. Any thread may do either. Coordinates are those of the data window, whose
//! upper left pixel is (0, 0).

use crate::{Result, ViewError};
use granita_image::{Draw, ImageSpec, PixelRect, Request, Wishes};
use parking_lot::{Condvar, Mutex, MutexGuard, RwLock};
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// The limits of the memory that senders may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LiveLimits {
    /// The largest width or height in pixels.
    pub dimension: u32,
    /// The largest number of bytes of all images together, at 4 for each channel of each pixel.
    pub bytes: u64,
    /// The largest number of channels of an image.
    pub channels: usize,
    /// The largest number of images at once.
    pub images: usize,
    /// The largest number of bytes of the name of an image or of a channel, and of a note.
    pub name_bytes: usize,
    /// The largest number of bytes of the panel of an image.
    pub panel_bytes: usize,
    /// The largest number of parts of a panel.
    pub panel_parts: usize,
}

impl Default for LiveLimits {
    /// Returns limits of 64 Ki pixels per side, 8 GiB in all, 256 channels, 256 images, 1 KiB per name, and 16 MiB in
    /// 16 Ki parts per panel.
    fn default() -> Self {
        Self {
            dimension: 1 << 16,
            bytes: 8 << 30,
            channels: 256,
            images: 256,
            name_bytes: 1024,
            panel_bytes: 16 << 20,
            panel_parts: 16 << 10,
        }
    }
}

/// Sends requests to the sender of an image.
#[derive(Clone)]
pub struct RequestSender(Arc<dyn Fn(Request) -> bool + Send + Sync>);

impl RequestSender {
    /// Returns a sender that calls `deliver`, which must not block and returns true when there is a receiver.
    pub fn new(deliver: impl Fn(Request) -> bool + Send + Sync + 'static) -> Self {
        Self(Arc::new(deliver))
    }

    /// Sends a request. Returns `false` when there is no receiver any more.
    pub fn send(&self, request: Request) -> bool {
        (self.0)(request)
    }
}

impl std::fmt::Debug for RequestSender {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("RequestSender")
    }
}

/// Sends the edits of users to the sender of an image.
#[derive(Clone)]
pub struct EditSender(Arc<dyn Fn(&str) -> bool + Send + Sync>);

impl EditSender {
    /// Returns a sender that calls `deliver` with JSON. `deliver` must not block and returns true when there is a
    /// receiver.
    pub fn new(deliver: impl Fn(&str) -> bool + Send + Sync + 'static) -> Self {
        Self(Arc::new(deliver))
    }

    /// Sends an edit, which is JSON. Returns `false` when there is no receiver any more.
    pub fn send(&self, edit: &str) -> bool {
        (self.0)(edit)
    }
}

impl std::fmt::Debug for EditSender {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("EditSender")
    }
}

/// The parts of a panel, which are JSON, by name.
pub type Panel = BTreeMap<String, Arc<str>>;

/// The properties of a live image without its pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct LiveInfo {
    /// An id that is unique for every image that was ever created, also under the same name.
    pub id: u64,
    /// Its name, as the list shows it.
    pub name: String,
    /// The width in pixels.
    pub width: u32,
    /// The height in pixels.
    pub height: u32,
    /// The names of the channels, in order.
    pub channels: Vec<String>,
    /// Increases with every change of pixels, marks, note or display settings.
    pub generation: u64,
    /// The rectangles in progress.
    pub marks: Vec<PixelRect>,
    /// The end state of the sender; `None` as long as it may send more.
    pub note: Option<String>,
    /// The drawing over it.
    pub drawing: Arc<Vec<Draw>>,
    /// The display settings that the sender requested.
    pub wishes: Wishes,
    /// True when requests have a receiver.
    pub takes_requests: bool,
    /// The controls beside the image, which its sender describes. It is empty for images without a panel.
    pub panel: Arc<Panel>,
    /// The description of the file from which the image was read, whose values are those of the file as fractions;
    /// `None` for other images.
    pub spec: Option<Arc<ImageSpec>>,
}

/// The number of changes that are stored one by one. Older ones count as changes of the whole image.
const CHANGES: usize = 4096;
/// The largest number of steps of a drawing.
const STEPS: usize = 1 << 16;
/// The largest number of marks that are kept.
const MARKS: usize = 1024;

struct State {
    pixels: Vec<f32>,
    generation: u64,
    /// The pixels that changed, and the generation after each change.
    changes: VecDeque<(u64, PixelRect)>,
    marks: Vec<PixelRect>,
    note: Option<String>,
    drawing: Arc<Vec<Draw>>,
    wishes: Wishes,
    requests: Option<RequestSender>,
    panel: Arc<Panel>,
    panel_bytes: usize,
    edits: Option<EditSender>,
    spec: Option<Arc<ImageSpec>>,
}

struct Image {
    id: u64,
    name: String,
    width: u32,
    height: u32,
    channels: Vec<String>,
    state: RwLock<State>,
}

impl Image {
    fn window(&self) -> PixelRect {
        PixelRect::at(0, 0, self.width, self.height)
    }

    fn bytes(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height) * self.channels.len() as u64 * 4
    }

    fn read<T>(&self, f: impl FnOnce(&State) -> T) -> T {
        f(&self.state.read())
    }

    /// Changes the state. `changed` is the rectangle of the pixels that change, if any.
    fn write<T>(&self, changed: Option<PixelRect>, f: impl FnOnce(&mut State) -> T) -> T {
        let mut state = self.state.write();
        let result = f(&mut state);
        state.generation += 1;
        if let Some(rect) = changed {
            let generation = state.generation;
            if state.changes.len() == CHANGES {
                state.changes.pop_front();
            }
            state.changes.push_back((generation, rect));
            state.marks.retain(|mark| !rect.contains(mark));
        }
        result
    }
}

/// A function that is called after every change (see [`Live::watch`]).
type Watcher = Arc<dyn Fn() + Send + Sync>;

struct Shared {
    limits: LiveLimits,
    /// The images in order of creation.
    images: RwLock<Vec<Arc<Image>>>,
    next_id: AtomicU64,
    shown: Mutex<u64>,
    version: Mutex<u64>,
    changed: Condvar,
    watchers: Mutex<Vec<Watcher>>,
}

/// The images that arrive. Clones share them.
#[derive(Clone)]
pub struct Live(Arc<Shared>);

impl Default for Live {
    fn default() -> Self {
        Self::new(LiveLimits::default())
    }
}

impl std::fmt::Debug for Live {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Live").field(&self.names()).finish()
    }
}

impl Live {
    /// Returns an empty list of images.
    pub fn new(limits: LiveLimits) -> Self {
        Self(Arc::new(Shared {
            limits,
            images: RwLock::default(),
            next_id: AtomicU64::new(1),
            shown: Mutex::new(0),
            version: Mutex::new(0),
            changed: Condvar::new(),
            watchers: Mutex::default(),
        }))
    }

    /// Returns its limits.
    pub fn limits(&self) -> &LiveLimits {
        &self.0.limits
    }

    /// Creates a black image, which replaces one of the same name.
    ///
    /// # Errors
    /// Returns [`ViewError::Limit`], or [`ViewError::Misuse`] for a size of 0, no channels, or two of one name.
    pub fn create(&self, name: &str, width: u32, height: u32, channels: &[String]) -> Result<()> {
        let limits = &self.0.limits;
        let within = |what, asked: u64, max: u64| {
            if asked <= max { Ok(()) } else { Err(ViewError::Limit { what, asked, max }) }
        };
        within("bytes of an image's name", name.len() as u64, limits.name_bytes as u64)?;
        within("pixels of a side", u64::from(width.max(height)), u64::from(limits.dimension))?;
        within("channels", channels.len() as u64, limits.channels as u64)?;
        for channel in channels {
            within("bytes of a channel's name", channel.len() as u64, limits.name_bytes as u64)?;
        }
        if width == 0 || height == 0 || channels.is_empty() {
            return Err(misuse(format!(
                "an image of {width} x {height} pixels with {} channels",
                channels.len()
            )));
        }
        if let Some(twice) = (1..channels.len()).find(|i| channels[..*i].contains(&channels[*i])) {
            return Err(misuse(format!("two channels are called \"{}\"", channels[twice])));
        }
        let values = (u64::from(width) * u64::from(height)).saturating_mul(channels.len() as u64);
        let bytes = values.saturating_mul(4);
        let mut images = self.0.images.write();
        let at = images.iter().position(|p| p.name == name);
        let others = images.iter().filter(|p| p.name != name);
        let (count, used) = others.fold((0, 0_u64), |(n, sum), p| (n + 1, sum.saturating_add(p.bytes())));
        within("images", count + 1, limits.images as u64)?;
        within("bytes of all images", used.saturating_add(bytes), limits.bytes.min(isize::MAX as u64))?;
        let state = State {
            // Untouched pages of zeros take no memory.
            pixels: vec![0.0; usize::try_from(values).unwrap_or(0)],
            generation: 1,
            changes: VecDeque::new(),
            marks: Vec::new(),
            note: None,
            drawing: Arc::default(),
            wishes: Wishes::default(),
            requests: None,
            panel: Arc::default(),
            panel_bytes: 0,
            edits: None,
            spec: None,
        };
        let image = Arc::new(Image {
            id: self.0.next_id.fetch_add(1, Ordering::Relaxed),
            name: name.to_owned(),
            width,
            height,
            channels: channels.to_vec(),
            state: RwLock::new(state),
        });
        match at {
            Some(at) => images[at] = image,
            None => images.push(image),
        }
        drop(images);
        self.tell();
        Ok(())
    }

    /// Sets the pixels of `rect`. Pixel k (row by row) of channel `index` of the image is `values[offset + k *
    /// stride]`, for each `(index, offset, stride)`. The marks inside of `rect` are removed.
    ///
    /// # Errors
    /// Returns [`ViewError::Misuse`] when there is no such image or channel, when `rect` is not inside of it, or
    /// when `values` are too few.
    pub fn update(
        &self,
        name: &str,
        channels: &[(usize, usize, usize)],
        rect: PixelRect,
        values: &[f32],
    ) -> Result<()> {
        let image = self.image(name)?;
        if !image.window().contains(&rect) {
            return Err(misuse(format!(
                "pixels x {}..{} y {}..{} of the {} x {} of \"{name}\"",
                rect.x0, rect.x1, rect.y0, rect.y1, image.width, image.height
            )));
        }
        let (n, width) = (image.channels.len(), image.width as usize);
        let (columns, rows) = (rect.width(), rect.height());
        for (index, offset, stride) in channels {
            let last = (columns * rows - 1).checked_mul(*stride).and_then(|l| l.checked_add(*offset));
            if *index >= n || last.is_none_or(|last| last >= values.len()) {
                return Err(misuse(format!(
                    "channel {index} of {n} of \"{name}\" from {offset} in steps of {stride} of {} values",
                    values.len()
                )));
            }
        }
        // Pixels in the layout of the image are copied as whole rows.
        let as_kept = channels.len() == n
            && channels
                .iter()
                .enumerate()
                .all(|(i, (index, offset, stride))| (*index, *offset, *stride) == (i, channels[0].1 + i, n));
        image.write(Some(rect), |state| {
            for j in 0..rows {
                let to = ((rect.y0 as usize + j) * width + rect.x0 as usize) * n;
                let line = &mut state.pixels[to..to + columns * n];
                if as_kept {
                    let from = channels[0].1 + j * columns * n;
                    line.copy_from_slice(&values[from..from + columns * n]);
                    continue;
                }
                for (index, offset, stride) in channels {
                    let first = offset + j * columns * stride;
                    for (k, to) in line.iter_mut().skip(*index).step_by(n).enumerate() {
                        *to = values[first + k * stride];
                    }
                }
            }
        });
        self.tell();
        Ok(())
    }

    /// Marks pixels as in progress. Pixels outside and unknown images are ignored.
    pub fn mark(&self, name: &str, rect: PixelRect) {
        let Ok(image) = self.image(name) else { return };
        let rect = rect.intersection(&image.window());
        if rect.is_empty() {
            return;
        }
        image.write(None, |state| {
            if state.marks.len() < MARKS && !state.marks.contains(&rect) {
                state.marks.push(rect);
            }
        });
        self.tell();
    }

    /// Draws over an image. `append` keeps the earlier drawing.
    ///
    /// # Errors
    /// Returns [`ViewError::Limit`] for a drawing of more than 65536 steps, and [`ViewError::Misuse`] when there is
    /// no such image.
    pub fn draw(&self, name: &str, append: bool, steps: &[Draw]) -> Result<()> {
        let image = self.image(name)?;
        let drawn = if append { image.read(|state| state.drawing.len()) } else { 0 };
        if drawn + steps.len() > STEPS {
            let asked = (drawn + steps.len()) as u64;
            return Err(ViewError::Limit { what: "steps of a drawing", asked, max: STEPS as u64 });
        }
        image.write(None, |state| {
            if append {
                Arc::make_mut(&mut state.drawing).extend_from_slice(steps);
            } else {
                state.drawing = Arc::new(steps.to_vec());
            }
        });
        self.tell();
        Ok(())
    }

    /// Removes an image.
    pub fn close(&self, name: &str) {
        let mut images = self.0.images.write();
        let before = images.len();
        images.retain(|p| p.name != name);
        let gone = images.len() != before;
        drop(images);
        if gone {
            self.tell();
        }
    }

    /// Records that the sender was lost. The image stays, with a note, without marks, and accepts no requests.
    pub fn lost(&self, name: &str, note: &str) {
        let Ok(image) = self.image(name) else { return };
        let note: String = note.chars().take(self.0.limits.name_bytes / 4).collect();
        image.write(None, |state| {
            state.note = Some(note);
            state.marks.clear();
            (state.requests, state.edits) = (None, None);
        });
        self.tell();
    }

    /// Records that an image is complete. It has no marks and accepts no requests.
    pub fn finish(&self, name: &str) {
        let Ok(image) = self.image(name) else { return };
        image.write(None, |state| {
            state.marks.clear();
            (state.requests, state.edits) = (None, None);
        });
        self.tell();
    }

    /// Requests for the sender that this image is shown.
    pub fn show(&self, name: &str) {
        let Ok(image) = self.image(name) else { return };
        *self.0.shown.lock() = image.id;
        self.tell();
    }

    /// Returns the [`LiveInfo::id`] of the image that a sender last requested to be shown; 0 when none did.
    pub fn shown(&self) -> u64 {
        *self.0.shown.lock()
    }

    /// Sets the display settings that the sender requests for an image.
    pub fn wish(&self, name: &str, wishes: Wishes) {
        let Ok(image) = self.image(name) else { return };
        image.write(None, |state| state.wishes = wishes);
        self.tell();
    }

    /// Sets the receiver of requests to the sender of an image.
    pub fn answer(&self, name: &str, requests: RequestSender) {
        let Ok(image) = self.image(name) else { return };
        image.write(None, |state| state.requests = Some(requests));
        self.tell();
    }

    /// Returns the way to send requests to the sender of an image; `None` when there is no receiver.
    pub fn requests(&self, name: &str) -> Option<RequestSender> {
        self.image(name).ok()?.read(|state| state.requests.clone())
    }

    /// Sets a part of the panel of an image. An empty text removes it.
    ///
    /// # Errors
    /// Returns [`ViewError::Limit`] for a panel that is too large, and [`ViewError::Misuse`] when there is no such
    /// image.
    pub fn show_panel(&self, name: &str, part: &str, text: &str) -> Result<()> {
        let limits = &self.0.limits;
        let within = |what, asked: usize, max: usize| match asked <= max {
            true => Ok(()),
            false => Err(ViewError::Limit { what, asked: asked as u64, max: max as u64 }),
        };
        let image = self.image(name)?;
        within("bytes of the name of a part", part.len(), limits.name_bytes)?;
        // Senders do this to learn whether the viewer is still there.
        if text.is_empty() && image.read(|state| !state.panel.contains_key(part)) {
            return Ok(());
        }
        image
            .write(None, |state| {
                let old = state.panel.get(part).map_or(0, |old| old.len() + part.len());
                let new = if text.is_empty() { 0 } else { text.len() + part.len() };
                let bytes = state.panel_bytes - old + new;
                within("bytes of a panel", bytes, limits.panel_bytes)?;
                if old == 0 && new > 0 {
                    within("parts of a panel", state.panel.len() + 1, limits.panel_parts)?;
                }
                let panel = Arc::make_mut(&mut state.panel);
                match text.is_empty() {
                    true => panel.remove(part),
                    false => panel.insert(part.to_owned(), text.into()),
                };
                state.panel_bytes = bytes;
                Ok(())
            })
            .inspect(|()| self.tell())
    }

    /// Sets the receiver of the edits of an image's panel.
    pub fn take_edits(&self, name: &str, edits: EditSender) {
        let Ok(image) = self.image(name) else { return };
        image.write(None, |state| state.edits = Some(edits));
        self.tell();
    }

    /// Returns the way to send edits to the sender of an image; `None` when there is no receiver.
    pub fn edits(&self, name: &str) -> Option<EditSender> {
        self.image(name).ok()?.read(|state| state.edits.clone())
    }

    /// Sets the description of the file from which an image is read. It says what the values are.
    pub fn describe(&self, name: &str, spec: &ImageSpec) {
        let Ok(image) = self.image(name) else { return };
        image.write(None, |state| state.spec = Some(Arc::new(spec.clone())));
        self.tell();
    }

    /// Returns the names of the images, in order of creation.
    pub fn names(&self) -> Vec<String> {
        let images = self.0.images.read();
        images.iter().map(|p| p.name.clone()).collect()
    }

    /// Returns the properties of an image.
    pub fn info(&self, name: &str) -> Option<LiveInfo> {
        let image = self.image(name).ok()?;
        Some(image.read(|state| LiveInfo {
            id: image.id,
            name: image.name.clone(),
            width: image.width,
            height: image.height,
            channels: image.channels.clone(),
            generation: state.generation,
            marks: state.marks.clone(),
            note: state.note.clone(),
            drawing: state.drawing.clone(),
            wishes: state.wishes.clone(),
            takes_requests: state.requests.is_some(),
            panel: state.panel.clone(),
            spec: state.spec.clone(),
        }))
    }

    /// Returns the values of some channels (by their index) in some pixels, row by row with interleaved channels.
    ///
    /// # Errors
    /// Returns [`ViewError::Misuse`] when there is no such image or channel, or when `rect` is not inside of it.
    pub fn read(&self, name: &str, rect: PixelRect, channels: &[usize]) -> Result<Vec<f32>> {
        let image = self.image(name)?;
        let n = image.channels.len();
        if !image.window().contains(&rect) || channels.iter().any(|c| *c >= n) {
            return Err(misuse(format!(
                "pixels x {}..{} y {}..{} of \"{name}\" ({} x {}, {n} channels)",
                rect.x0, rect.x1, rect.y0, rect.y1, image.width, image.height
            )));
        }
        let (width, columns) = (image.width as usize, rect.width());
        let in_order = channels.windows(2).all(|pair| pair[1] == pair[0] + 1);
        let mut values = Vec::with_capacity(columns * rect.height() * channels.len());
        image.read(|state| {
            for y in rect.y0 as usize..rect.y1 as usize {
                let from = (y * width + rect.x0 as usize) * n;
                let line = &state.pixels[from..from + columns * n];
                match channels {
                    [] => (),
                    _ if in_order && channels.len() == n => values.extend_from_slice(line),
                    [first, ..] if in_order => {
                        for pixel in line.chunks_exact(n) {
                            values.extend_from_slice(&pixel[*first..first + channels.len()]);
                        }
                    }
                    _ => {
                        for pixel in line.chunks_exact(n) {
                            values.extend(channels.iter().map(|c| pixel[*c]));
                        }
                    }
                }
            }
        });
        Ok(values)
    }

    /// Returns all values of an image with its properties.
    ///
    /// # Errors
    /// Returns [`ViewError::Misuse`] when there is no such image.
    pub fn snapshot(&self, name: &str) -> Result<(LiveInfo, Vec<f32>)> {
        let none = || misuse(format!("there is no image \"{name}\""));
        let info = self.info(name).ok_or_else(none)?;
        let all: Vec<usize> = (0..info.channels.len()).collect();
        let values = self.read(name, PixelRect::at(0, 0, info.width, info.height), &all)?;
        Ok((info, values))
    }

    /// Returns a number that increases with every change of an image; 0 when there is none of this name.
    pub fn generation(&self, name: &str) -> u64 {
        self.image(name).map_or(0, |p| p.read(|state| state.generation))
    }

    /// Returns the pixels that may have changed since an image had this generation; the whole image when that was
    /// long ago. An image that was created again under its name has another [`LiveInfo::id`].
    pub fn changes_since(&self, name: &str, generation: u64) -> Vec<PixelRect> {
        let Ok(image) = self.image(name) else { return Vec::new() };
        image.read(|state| match state.changes.front() {
            _ if generation == 0 => vec![image.window()],
            Some((first, _)) if state.changes.len() == CHANGES && *first > generation + 1 => {
                vec![image.window()]
            }
            _ => state.changes.iter().filter(|(g, _)| *g > generation).map(|(_, rect)| *rect).collect(),
        })
    }

    /// Returns a number that increases with every change of any image or of the list.
    pub fn version(&self) -> u64 {
        *self.lock_version()
    }

    /// Waits until [`Live::version`] is no longer `seen`, at most for the time `longest`. Returns the version.
    pub fn wait(&self, seen: u64, longest: Duration) -> u64 {
        self.wait_unless(seen, longest, || false)
    }

    /// Does the same, and also ends when `ends` is true. It is tested at the beginning and after each [`Live::wake`].
    pub fn wait_unless(&self, seen: u64, longest: Duration, ends: impl Fn() -> bool) -> u64 {
        let end = Instant::now() + longest;
        let mut version = self.lock_version();
        while *version == seen && !ends() {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            self.0.changed.wait_for(&mut version, left);
        }
        *version
    }

    /// Wakes the threads in [`Live::wait_unless`], without a change.
    pub fn wake(&self) {
        // With the lock, no thread is between its test and its wait.
        let _version = self.lock_version();
        self.0.changed.notify_all();
    }

    /// Calls `changed` after every change, from the thread that made it. It must be fast and must not change
    /// images.
    pub fn watch(&self, changed: impl Fn() + Send + Sync + 'static) {
        self.0.watchers.lock().push(Arc::new(changed));
    }

    fn lock_version(&self) -> MutexGuard<'_, u64> {
        self.0.version.lock()
    }

    fn image(&self, name: &str) -> Result<Arc<Image>> {
        let images = self.0.images.read();
        let found = images.iter().find(|p| p.name == name).cloned();
        found.ok_or_else(|| misuse(format!("there is no image \"{name}\"")))
    }

    fn tell(&self) {
        *self.lock_version() += 1;
        self.0.changed.notify_all();
        let watchers = self.0.watchers.lock().clone();
        watchers.iter().for_each(|watcher| watcher());
    }
}

fn misuse(what: String) -> ViewError {
    ViewError::Misuse { what }
}

#[cfg(test)]
mod tests;
