//! The image of the desk: a format that collects the pixels of frames in one image, and shows it in a viewer.
//!
//! Each frame, also one of a part of the image, is drawn into the same live image, which stays open between frames. A
//! frame that is stopped leaves the earlier pixels where it did not come to.

use super::coarse::Coarse;
use granita_image::{
    CreateOptions, Format, FormatRegistry, ImageError, ImageInput, ImageOutput, ImageSpec, Limits, PixelRect,
    PixelType, Pixels, Request, Result,
};
use parking_lot::{Condvar, Mutex, MutexGuard};
use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The interval at which the edits of users are fetched.
const TICK: Duration = Duration::from_millis(8);
/// The number of ticks after which the viewer is tested.
const TEST_TICKS: u32 = 64;
/// The largest number of edits that wait.
const EDITS: usize = 4096;

/// The images of a frame, by the number in their format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// The image that is shown.
    Color,
    /// The depths of the first surfaces.
    Depth,
}

/// The pixels of one image of the frames.
#[derive(Clone, Debug, Default)]
pub(crate) struct Plane {
    /// The number of channels.
    pub(crate) channels: usize,
    /// The values, row by row with interleaved channels.
    pub(crate) values: Vec<f32>,
}

#[derive(Default)]
struct State {
    /// The window of the image within the full image of the camera; `None` before the first frame.
    window: Option<PixelRect>,
    color: Plane,
    depth: Plane,
    spec: Option<ImageSpec>,
    image: Option<Box<dyn ImageOutput>>,
    before: Option<Box<dyn ImageOutput>>,
    /// The parts of the panel that the viewer has.
    panel: BTreeMap<String, String>,
    /// The pixels that the frame renders first, in the window.
    priority: Option<PixelRect>,
    edits: VecDeque<String>,
    /// True when one of the waiting edits stops the current frame.
    interrupted: bool,
    /// The coarse image that the frame is, and the pixels of the window in which it is shown.
    coarse: Option<(Coarse, PixelRect)>,
    /// True when the image of the frame is complete.
    complete: bool,
    /// True while the pixels of the frame are discarded.
    hidden: bool,
    /// The reason why the viewer receives nothing more.
    gone: Option<String>,
    /// The number of ticks since the viewer was last tested.
    ticks: u32,
}

struct Shared {
    registry: FormatRegistry,
    /// The name of the image, and the address of the viewer.
    name: String,
    address: String,
    state: Mutex<State>,
    changed: Condvar,
    /// Stops the current frame.
    stop: Arc<AtomicBool>,
    ended: AtomicBool,
    /// Returns true when an edit stops the current frame.
    interrupts: Box<dyn Fn(&str) -> bool + Send + Sync>,
}

/// The image of the desk and its viewer. Clones share them.
#[derive(Clone)]
pub(crate) struct Screen(Arc<Shared>);

impl Screen {
    /// Returns an image called `name` for the viewer at `address`. Edits for which `interrupts` returns true set
    /// `stop`.
    pub(crate) fn new(
        registry: FormatRegistry,
        name: &str,
        address: &str,
        stop: Arc<AtomicBool>,
        interrupts: impl Fn(&str) -> bool + Send + Sync + 'static,
    ) -> Self {
        let screen = Self(Arc::new(Shared {
            registry,
            name: name.to_owned(),
            address: address.to_owned(),
            state: Mutex::default(),
            changed: Condvar::new(),
            stop,
            ended: AtomicBool::new(false),
            interrupts: Box::new(interrupts),
        }));
        let weak = Arc::downgrade(&screen.0);
        let fetch = move || {
            while let Some(shared) = weak.upgrade().filter(|shared| !shared.ended.load(Ordering::Relaxed)) {
                Self(shared).fetch();
                std::thread::sleep(TICK);
            }
        };
        // Without the thread the image is shown, and edits have no effect.
        let _ = std::thread::Builder::new().name("desk edits".to_owned()).spawn(fetch);
        screen
    }

    /// Returns the image format of the frames. Number 1 is the image, number 2 the depths.
    pub(crate) fn format(&self, number: usize) -> Arc<dyn Format> {
        let kind = if number == 2 { Kind::Depth } else { Kind::Color };
        Arc::new(DeskFormat { screen: self.clone(), kind })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.state.lock()
    }

    /// Fetches the edits of the viewer.
    fn fetch(&self) {
        let mut state = self.state();
        let Some(image) = &mut state.image else { return };
        let edits = image.edits();
        if edits.is_empty() {
            state.ticks += 1;
            if state.ticks >= TEST_TICKS {
                state.ticks = 0;
                // The removal of a part that does not exist changes nothing, but fails when the viewer is gone.
                let shown = state.image.as_mut().map_or(Ok(()), |image| image.show_panel("", ""));
                self.failed(&mut state, shown);
            }
            return;
        }
        let stops = edits.iter().any(|edit| (self.0.interrupts)(edit));
        let room = EDITS.saturating_sub(state.edits.len());
        state.edits.extend(edits.into_iter().take(room));
        if stops {
            // The flag alone may be cleared by a frame that begins at this moment.
            state.interrupted = true;
            self.0.stop.store(true, Ordering::Relaxed);
        }
        self.0.changed.notify_all();
    }

    /// Returns the edits since the last call, waiting for one until `longest`.
    pub(crate) fn edits(&self, longest: Duration) -> Vec<String> {
        let mut state = self.state();
        if state.edits.is_empty() && !longest.is_zero() {
            self.0.changed.wait_for(&mut state, longest);
        }
        state.interrupted = false;
        state.edits.drain(..).collect()
    }

    /// Adds an edit, as if a viewer had sent it.
    #[cfg(test)]
    pub(crate) fn push_edit(&self, edit: String) {
        self.state().edits.push_back(edit);
        self.0.changed.notify_all();
    }

    /// Begins a frame whose pixels `priority`, in the window, are rendered first.
    pub(crate) fn begin_frame(&self, priority: Option<PixelRect>) {
        let mut state = self.state();
        (state.priority, state.complete) = (priority, false);
    }

    /// Makes the next frame one of a coarse image, which is shown in some pixels of the window; `None` for a full one.
    pub(crate) fn be_coarse(&self, coarse: Option<(Coarse, PixelRect)>) {
        self.state().coarse = coarse;
    }

    /// Begins or ends a frame whose pixels are discarded. It leaves the image and its completeness as they are.
    pub(crate) fn hide(&self, hidden: bool) {
        self.state().hidden = hidden;
    }

    /// True when the last frame has all its pixels.
    pub(crate) fn is_complete(&self) -> bool {
        self.state().complete
    }

    /// Returns the window of the image within the full image of the camera; `None` before the first frame.
    pub(crate) fn window(&self) -> Option<PixelRect> {
        self.state().window
    }

    /// Returns the pixels of the image.
    pub(crate) fn color(&self) -> Plane {
        self.state().color.clone()
    }

    /// Returns the depth of the first surface in a pixel of the window, along z of the camera; `None` where nothing is.
    pub(crate) fn depth(&self, [x, y]: [i32; 2]) -> Option<f32> {
        let state = self.state();
        let window = state.window?;
        let (x, y) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
        if x >= window.width() || y >= window.height() {
            return None;
        }
        let depth = *state.depth.values.get((y * window.width() + x) * state.depth.channels)?;
        (depth > 0.0 && depth < 1.0e29).then_some(depth)
    }

    /// Returns the middle one of the depths of all pixels where a surface is.
    pub(crate) fn usual_depth(&self) -> Option<f32> {
        let state = self.state();
        let n = state.depth.channels.max(1);
        let step = (state.depth.values.len() / n / 65_536).max(1) * n;
        let all = state.depth.values.iter().step_by(step).copied();
        let mut depths: Vec<f32> = all.filter(|depth| *depth > 0.0 && *depth < 1.0e29).collect();
        depths.sort_by(f32::total_cmp);
        depths.get(depths.len() / 2).copied()
    }

    /// Shows a part of the panel, if it differs from what the viewer has. An empty text removes it.
    pub(crate) fn show_panel(&self, part: &str, text: String) {
        let mut state = self.state();
        if state.panel.get(part).map_or("", String::as_str) == text {
            return;
        }
        let Some(image) = &mut state.image else { return };
        let shown = image.show_panel(part, &text);
        match text.is_empty() {
            true => _ = state.panel.remove(part),
            false => _ = state.panel.insert(part.to_owned(), text),
        }
        self.failed(&mut state, shown);
    }

    /// Returns the names of the parts of the panel.
    pub(crate) fn parts(&self) -> Vec<String> {
        self.state().panel.keys().cloned().collect()
    }

    /// Returns a part of the panel; an empty text when there is no such part.
    #[cfg(test)]
    pub(crate) fn part(&self, name: &str) -> String {
        self.state().panel.get(name).cloned().unwrap_or_default()
    }

    /// Returns the name of the image of the pixels before the last edit.
    pub(crate) fn before_name(&self) -> String {
        format!("{} before", self.0.name)
    }

    /// Shows the pixels before the last edit, as an image of its own.
    pub(crate) fn show_before(&self, plane: &Plane) {
        let mut state = self.state();
        let (Some(window), Some(spec)) = (state.window, state.spec.clone()) else { return };
        let mut image = match state.before.take() {
            Some(image) => Ok(image),
            None => self.open(&self.before_name(), &spec),
        };
        let shown = image.as_mut().map_or(Ok(()), |image| {
            let all = PixelRect::at(0, 0, window.width() as u32, window.height() as u32);
            image.write_rectangle(&all, &Pixels::Float(plane.values.clone()))
        });
        state.before = image.ok();
        self.failed(&mut state, shown);
    }

    /// Returns the reason why the viewer receives nothing more, if there is one.
    pub(crate) fn gone(&self) -> Option<String> {
        self.state().gone.clone()
    }

    /// Ends the image in the viewer, which keeps it.
    pub(crate) fn end(&self) {
        self.0.ended.store(true, Ordering::Relaxed);
        let mut state = self.state();
        let images = [state.image.take(), state.before.take()];
        drop(state);
        for image in images.into_iter().flatten() {
            // The viewer may have ended before.
            let _ = image.close();
        }
    }

    fn failed(&self, state: &mut State, result: Result<()>) {
        if let Err(error) = result
            && state.gone.is_none()
        {
            state.gone = Some(error.to_string());
            self.0.stop.store(true, Ordering::Relaxed);
            self.0.changed.notify_all();
        }
    }

    fn open(&self, name: &str, spec: &ImageSpec) -> Result<Box<dyn ImageOutput>> {
        let path = Path::new(name);
        let format = self.0.registry.by_name("iv").ok_or_else(|| ImageError::Unsupported {
            path: path.to_owned(),
            what: "there is no format \"iv\"".to_owned(),
        })?;
        let mut spec = spec.clone();
        let ty = granita_base::ParamType::of(granita_base::BaseType::String);
        let data = self.0.address.as_str().into();
        spec.attributes.set(granita_base::Param { name: "display".into(), ty, data });
        format.create(path, &CreateOptions::new(&spec, 1))
    }

    /// Begins an image of a frame. Returns its place in the window.
    fn begin(&self, kind: Kind, spec: &ImageSpec) -> Result<Place> {
        let mut state = self.state();
        if let (Some((coarse, shown)), Some(window)) = (state.coarse, state.window) {
            return Ok(Place::Coarse { coarse, first: [spec.x, spec.y], window, shown });
        }
        let place = PixelRect::at(spec.x, spec.y, spec.width, spec.height);
        if state.window.is_none() && kind == Kind::Color {
            state.window = Some(place);
        }
        let Some(window) = state.window else {
            let what = "the depths came before the image".to_owned();
            return Err(ImageError::Misuse { path: self.0.name.clone().into(), what });
        };
        if !window.contains(&place) {
            let what = format!("the frame of {place:?} is outside of {window:?}");
            return Err(ImageError::Misuse { path: self.0.name.clone().into(), what });
        }
        if kind == Kind::Color && state.image.is_none() && state.gone.is_none() {
            let spec =
                ImageSpec { width: window.width() as u32, height: window.height() as u32, ..spec.clone() };
            match self.open(&self.0.name, &spec) {
                Ok(image) => state.image = Some(image),
                Err(error) => self.failed(&mut state, Err(error)),
            }
            state.spec = Some(spec);
        }
        let plane = match kind {
            Kind::Color => &mut state.color,
            Kind::Depth => &mut state.depth,
        };
        let (n, pixels) = (spec.nchannels(), window.width() * window.height());
        if plane.channels != n || plane.values.len() != n * pixels {
            *plane = Plane { channels: n, values: vec![0.0; n * pixels] };
        }
        Ok(Place::Full([spec.x - window.x0, spec.y - window.y0]))
    }

    /// Draws a rectangle of the window.
    fn draw(&self, kind: Kind, rect: &PixelRect, pixels: &Pixels) {
        let mut state = self.state();
        let Some(window) = state.window.filter(|_| !state.hidden) else { return };
        let values = pixels.floats();
        let plane = match kind {
            Kind::Color => &mut state.color,
            Kind::Depth => &mut state.depth,
        };
        let n = plane.channels;
        for (row, line) in values.chunks_exact((rect.width() * n).max(1)).enumerate() {
            let at = ((rect.y0 as usize + row) * window.width() + rect.x0 as usize) * n;
            if let Some(to) = plane.values.get_mut(at..at + line.len()) {
                to.copy_from_slice(line);
            }
        }
        if kind == Kind::Color {
            let shown = state.image.as_mut().map_or(Ok(()), |image| image.write_rectangle(rect, pixels));
            self.failed(&mut state, shown);
        }
    }
}

/// The format of the images of frames.
struct DeskFormat {
    screen: Screen,
    kind: Kind,
}

impl Format for DeskFormat {
    fn name(&self) -> &'static str {
        "desk"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &[]
    }

    fn recognizes(&self, _: &[u8]) -> bool {
        false
    }

    fn open(&self, path: &Path, _: &Limits) -> Result<Box<dyn ImageInput>> {
        let what = "the image of the desk cannot be read".to_owned();
        Err(ImageError::Unsupported { path: path.to_owned(), what })
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "rectangles" | "float" | "channels" | "layers" | "alpha")
    }

    fn create(&self, _: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        let spec = ImageSpec { pixel_type: PixelType::Float, ..options.spec.clone() };
        let place = self.screen.begin(self.kind, &spec)?;
        let channels = spec.nchannels();
        Ok(Box::new(DeskImage { screen: self.screen.clone(), kind: self.kind, place, channels }))
    }
}

/// The place of an image of a frame in the window.
#[derive(Clone, Copy, Debug)]
enum Place {
    /// The image has pixels of the window, from this one on.
    Full([i32; 2]),
    /// The image has pixels of a coarse image.
    Coarse {
        coarse: Coarse,
        /// Its first pixel in the coarse image.
        first: [i32; 2],
        /// The window in the full image.
        window: PixelRect,
        /// The pixels of the window in which it is shown.
        shown: PixelRect,
    },
}

impl Place {
    /// Returns the pixels of the window that show a rectangle of the image.
    fn in_window(&self, rect: &PixelRect) -> PixelRect {
        match *self {
            Self::Full([x, y]) => rect.moved(x, y),
            Self::Coarse { coarse, first: [x, y], window, shown } => {
                coarse.enlarged(&rect.moved(x, y)).moved(-window.x0, -window.y0).intersection(&shown)
            }
        }
    }

    /// Returns the pixels of the image that a rectangle of the window shows.
    fn in_image(&self, rect: &PixelRect) -> PixelRect {
        match *self {
            Self::Full([x, y]) => rect.moved(-x, -y),
            Self::Coarse { coarse, first: [x, y], window, .. } => {
                coarse.reduced(&rect.moved(window.x0, window.y0)).moved(-x, -y)
            }
        }
    }
}

/// An image of a frame.
struct DeskImage {
    screen: Screen,
    kind: Kind,
    place: Place,
    /// The number of channels.
    channels: usize,
}

impl DeskImage {
    fn misuse<T>(&self) -> Result<T> {
        let path = self.screen.0.name.clone().into();
        Err(ImageError::Misuse { path, what: "the image of the desk takes rectangles".to_owned() })
    }
}

impl ImageOutput for DeskImage {
    fn write_rows(&mut self, _: &Pixels) -> Result<()> {
        self.misuse()
    }

    fn write_tile(&mut self, _: u32, _: u32, _: &Pixels) -> Result<()> {
        self.misuse()
    }

    fn next_level(&mut self, _: &ImageSpec) -> Result<()> {
        self.misuse()
    }

    fn write_rectangle(&mut self, rect: &PixelRect, pixels: &Pixels) -> Result<()> {
        let shown = self.place.in_window(rect);
        let Place::Coarse { coarse, first: [x, y], window, .. } = self.place else {
            self.screen.draw(self.kind, &shown, pixels);
            return Ok(());
        };
        if !shown.is_empty() {
            let (from, to) = (rect.moved(x, y), shown.moved(window.x0, window.y0));
            let values = coarse.enlarge(&from, &pixels.floats(), self.channels, &to);
            self.screen.draw(self.kind, &shown, &Pixels::Float(values));
        }
        Ok(())
    }

    fn begin_rectangle(&mut self, rect: &PixelRect) {
        let mut state = self.screen.state();
        if self.kind == Kind::Color
            && !state.hidden
            && let Some(image) = &mut state.image
        {
            let shown = self.place.in_window(rect);
            if !shown.is_empty() {
                image.begin_rectangle(&shown);
            }
        }
    }

    fn requests(&mut self) -> Vec<Request> {
        if self.kind == Kind::Depth {
            return Vec::new();
        }
        let mut state = self.screen.state();
        let own = state.priority.take().map(Request::Priority);
        let mut requests = state.image.as_mut().map(|image| image.requests()).unwrap_or_default();
        requests.splice(0..0, own);
        requests.extend(state.interrupted.then_some(Request::Abort));
        let inside = |request| match request {
            Request::Center { x, y } => {
                let PixelRect { x0: x, y0: y, .. } = self.place.in_image(&PixelRect::at(x, y, 1, 1));
                Request::Center { x, y }
            }
            Request::Priority(rect) => Request::Priority(self.place.in_image(&rect)),
            Request::Abort => Request::Abort,
        };
        requests.into_iter().map(inside).collect()
    }

    fn close(self: Box<Self>) -> Result<()> {
        let mut state = self.screen.state();
        if self.kind == Kind::Color && !state.hidden {
            state.complete = true;
        }
        Ok(())
    }
}
