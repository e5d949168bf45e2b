// tidy: long: one type holds what the window shows, with a short method for each action of the user
//! The state of the window. It holds what is shown and how, independent of the window system.

use super::entries::{Choice, Entries, Seen};
use super::keys::Action;
use super::tasks::{Answers, Asked, Tasks};
use crate::listen::Wanted;
use granita_image::{FormatRegistry, PixelRect, Request, Wishes};
use granita_view::{
    Around, Arrangement, Background, Canvas, Channels, ColorMap, Display, FalseColor, Live, Loader, Marks,
    Mix, Needs, Shown, TileStore, View, Viewing, draw_into, needs, paint, pixel_under,
};
use parking_lot::Mutex;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

/// The answer to keys of displays and views without a configuration.
const NO_CONFIGURATION: &str = "there is no colour configuration (-colorconfig)";

/// The interval at which files are checked for changes.
const WATCH: Duration = Duration::from_millis(500);

/// An action that the application executes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Command {
    FullScreen,
    Theme,
    Quit,
    /// Opens a prompt for a file name.
    Save {
        pixels: bool,
    },
}

/// The number of the page, its layer, its display, the places of its patches and its finest level.
type SideKey = (u64, usize, Display, Vec<[f64; 4]>, usize);

/// All inputs of the drawn image.
#[derive(Clone, Debug, PartialEq)]
struct Key {
    view: View,
    mix: Mix,
    sides: Vec<SideKey>,
    arrivals: u64,
    changes: u64,
}

/// The state of the window.
pub(crate) struct Model {
    pub(crate) formats: FormatRegistry,
    pub(crate) store: TileStore,
    pub(crate) loader: Loader,
    pub(crate) entries: Entries,
    pub(crate) tasks: Tasks,
    /// The entry that was shown before the current one, or was kept for comparison.
    pub(crate) other: Option<usize>,
    keep_other: bool,
    pub(crate) display: Display,
    first_display: Display,
    pub(crate) view: View,
    /// True when the image is fitted again after the size of the window changes.
    pub(crate) fitted: bool,
    pub(crate) mix: Mix,
    pub(crate) canvas: Canvas,
    drawn: Option<Key>,
    pub(crate) list_open: bool,
    pub(crate) side_open: bool,
    pub(crate) help_open: bool,
    /// The measured area, in pixels of level 0 of the page.
    pub(crate) probe: Option<PixelRect>,
    pub(crate) message: Option<(String, Instant)>,
    watched: Instant,
    /// The requests of clients to open files.
    pub(crate) wanted: Option<Arc<Mutex<Receiver<Wanted>>>>,
    /// The requests about live images that were already applied, with the ids of the images.
    fulfilled: Vec<(u64, Wishes)>,
    /// An action for the application that was not requested by a key.
    pub(crate) pending: Option<Command>,
    /// True when the whole visible part is loaded.
    pub(crate) complete: bool,
    /// The direction of the last step through the list, which is 1 or -1.
    heading: isize,
}

impl Model {
    /// Returns the model. `wake` requests that the window is drawn again.
    pub(crate) fn new(
        formats: FormatRegistry,
        files: Vec<PathBuf>,
        live: Live,
        display: Display,
        store: TileStore,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> Self {
        let wake = Arc::new(wake);
        let threads = std::thread::available_parallelism().map_or(2, usize::from).clamp(2, 8);
        let loader = {
            let wake = wake.clone();
            Loader::new(threads, move || wake())
        };
        live.watch(move || wake());
        Self {
            entries: Entries::new(files, live),
            formats,
            store,
            loader,
            tasks: Tasks::default(),
            other: None,
            keep_other: false,
            display,
            first_display: display,
            view: View::fit(1, 1, [0.0, 0.0, 1.0, 1.0]),
            fitted: true,
            mix: Mix::First,
            canvas: Canvas::default(),
            drawn: None,
            list_open: false,
            side_open: false,
            help_open: false,
            probe: None,
            message: None,
            watched: Instant::now(),
            wanted: None,
            fulfilled: Vec::new(),
            pending: None,
            complete: false,
            heading: 1,
        }
    }

    /// Shows a message to the user.
    pub(crate) fn say(&mut self, text: impl Into<String>) {
        self.message = Some((text.into(), Instant::now()));
    }

    /// Opens an entry if it is not open. Returns what is drawn of it.
    pub(crate) fn seen(&mut self, entry: usize) -> Option<Seen> {
        if let Err(what) = self.entries.open(entry, &self.formats, &self.store) {
            self.say(what);
        }
        let seen = self.entries.seen(entry, &self.display)?;
        let mut display = seen.display;
        let choice = self.entries.choice(entry);
        if (choice.normalize || seen.page.is_depth(seen.layer)) && display.range.is_none() {
            let range = self.tasks.range(&self.loader, &seen.page, seen.layer);
            if let Some((near, far)) = range {
                let far = if far > near { far } else { near + 1.0 };
                if let Some(f) = &mut display.false_color {
                    (f.low, f.high) = (near, far);
                } else if seen.page.is_depth(seen.layer) && !choice.normalize {
                    display.range = Some((far + 0.15 * (far - near), near));
                } else {
                    display.range = Some((near, far));
                }
            }
        }
        Some(Seen { display, ..seen })
    }

    /// Returns the bounds of the current image, in pixels of level 0.
    fn bounds(&mut self) -> Option<[f64; 4]> {
        let current = self.entries.current;
        self.seen(current).map(|s| s.sheet.bounds)
    }

    /// Makes another entry the current one.
    pub(crate) fn show(&mut self, entry: usize) {
        let entry = entry.min(self.entries.len().saturating_sub(1));
        let before = self.entries.current;
        if entry == before {
            return;
        }
        let old = self.bounds();
        if !self.keep_other {
            self.other = Some(before);
        }
        self.entries.follow(before, entry);
        self.entries.current = entry;
        self.probe = None;
        let new = self.bounds();
        self.entries.hurry(entry);
        // The view stays the same between images of one size, so that they can be compared by switching.
        if old.is_none() || new != old {
            self.fitted = true;
            self.fit();
        }
        if self.entries.panorama(entry) != Some(true) {
            self.view.around = None;
        }
    }

    /// Fits the current image into the window.
    pub(crate) fn fit(&mut self) {
        let around = self.view.around.map(|_| Around::default());
        if let Some(bounds) = self.bounds() {
            self.view = View { around, ..View::fit(self.view.width, self.view.height, bounds) };
        }
    }

    fn step(at: usize, by: isize, count: usize) -> usize {
        (at as isize + by).rem_euclid(count.max(1) as isize) as usize
    }

    /// Executes the action of a key or a menu. Returns an action for the application, if any.
    pub(crate) fn act(&mut self, action: Action) -> Option<Command> {
        let count = self.entries.len();
        let current = self.entries.current;
        match action {
            Action::Next(by) => {
                self.heading = by.signum();
                self.show(Self::step(current, by, count));
            }
            Action::First => self.show(0),
            Action::Last => self.show(count.saturating_sub(1)),
            Action::Other => self.show_other(),
            Action::KeepOther => {
                (self.other, self.keep_other) = (Some(current), true);
                self.say("this image is kept as the other one");
            }
            Action::Page(_)
            | Action::Layer(_)
            | Action::Level(_)
            | Action::Face(_)
            | Action::FileEncoding
            | Action::Normalize => self.choose(action),
            Action::Around => self.look_around(),
            Action::Fit => {
                self.fitted = true;
                self.fit();
            }
            Action::Zoom(zoom) => self.zoom_by(zoom / self.view.zoom),
            Action::ZoomBy(factor) => self.zoom_by(factor),
            Action::Pan(x, y) => self.pan(x, y),
            Action::FullScreen => return Some(Command::FullScreen),
            Action::Theme => return Some(Command::Theme),
            Action::Quit => return Some(Command::Quit),
            Action::SaveView => return Some(Command::Save { pixels: false }),
            Action::SavePixels => return Some(Command::Save { pixels: true }),
            Action::Wipe
            | Action::WipeDirection
            | Action::Difference
            | Action::DifferenceGain(_)
            | Action::Over
            | Action::FlipMap => {
                self.compare(action);
            }
            Action::Reload => {
                self.entries.reload(current, &self.formats, &self.store);
                self.say("read again");
            }
            Action::List => self.list_open = !self.list_open,
            Action::Histogram => self.side_open = !self.side_open,
            Action::Help => self.help_open = !self.help_open,
            Action::Abort => {
                if !self.request(Request::Abort) {
                    self.say("this is not a live image, or its sender has ended");
                }
            }
            Action::Escape => self.escape(),
            _ => self.look(action),
        }
        None
    }

    /// Shows the other image, and makes the current one the other.
    fn show_other(&mut self) {
        let current = self.entries.current;
        match self.other.filter(|o| *o < self.entries.len()) {
            Some(other) => {
                self.show(other);
                self.other = Some(current);
            }
            None => self.say("there is no other image yet: show another one, or keep this one with Shift+T"),
        }
    }

    /// Magnifies the image by a factor around the middle of the window.
    fn zoom_by(&mut self, factor: f64) {
        self.fitted = false;
        let (w, h) = (f64::from(self.view.width) / 2.0, f64::from(self.view.height) / 2.0);
        self.view.zoom_at(w, h, factor);
    }

    /// Closes the help, or else removes the measured area, or else ends a comparison, or else removes the panorama and
    /// the message.
    fn escape(&mut self) {
        if self.help_open {
            self.help_open = false;
        } else if self.probe.is_some() {
            self.probe = None;
        } else if self.mix != Mix::First {
            self.mix = Mix::First;
        } else {
            self.view.around = None;
            self.message = None;
        }
    }

    /// Moves the image by a number of screen pixels.
    pub(crate) fn pan(&mut self, x: f64, y: f64) {
        self.fitted = false;
        self.view.pan(x, y);
    }

    /// Selects another part of the file.
    fn choose(&mut self, action: Action) {
        let current = self.entries.current;
        let Some((pages, page)) = self.entries.page(current) else { return };
        let levels = page.pyramid.stored_levels();
        let (layers, has_faces) = (page.layers.len(), page.layout.is_some());
        let suits = page.arrangement();
        let (encoded, integers) = (page.encoded, page.spec().pixel_type.bytes() <= 2);
        let mut choice = self.entries.choice(current);
        match action {
            Action::Page(by) => {
                choice = Choice { page: Self::step(choice.page, by, pages), ..Choice::FIRST };
            }
            Action::Layer(by) => {
                choice.layer = Self::step(choice.layer, by, layers);
                // Another layer has other channels, so the index of a channel is no longer valid.
                if matches!(self.display.channels, Channels::One(_)) {
                    self.display.channels = Channels::Color;
                }
            }
            Action::Level(by) => choice.level = Self::step(choice.level, by, levels),
            Action::Face(by) if has_faces => {
                let all: Vec<Arrangement> = [Arrangement::Cross, Arrangement::Stored]
                    .into_iter()
                    .chain((0..6).map(Arrangement::Face))
                    .collect();
                let now = choice.arrangement.unwrap_or(suits);
                let at = all.iter().position(|a| *a == now).unwrap_or(0);
                choice.arrangement = Some(all[Self::step(at, by, all.len())]);
                self.view.around = None;
            }
            Action::Face(_) => self.say("the image has no cube faces"),
            Action::FileEncoding if integers => {
                choice.encoded = Some(!choice.encoded.unwrap_or(encoded));
                let words =
                    if choice.encoded == Some(true) { "encoded (sRGB)" } else { "in proportion to light" };
                self.say(format!("values of this file are taken as {words}"));
            }
            Action::Normalize => choice.normalize = !choice.normalize,
            _ => {}
        }
        let old = self.bounds();
        self.entries.choose(current, choice);
        let new = self.bounds();
        if new != old {
            self.probe = None;
            self.fitted = true;
            self.fit();
        }
    }

    fn look_around(&mut self) {
        if self.view.around.take().is_some() {
            return;
        }
        if self.entries.panorama(self.entries.current) == Some(true) {
            self.view.around = Some(Around::default());
        } else if self.entries.page(self.entries.current).is_some_and(|(_, p)| {
            // A panorama that is not marked as one has twice as many columns as rows.
            p.spec().width == 2 * p.spec().height
        }) {
            self.entries.as_panorama(self.entries.current, &self.store);
            self.view.around = Some(Around::default());
            self.say("taken as a panorama: it is twice as wide as it is high");
        } else {
            self.say("it is neither a panorama nor a cube");
        }
    }

    /// Changes how values become colours.
    fn look(&mut self, action: Action) {
        let d = &mut self.display;
        match action {
            Action::Exposure(by) => d.exposure = (d.exposure + by).clamp(-40.0, 40.0),
            Action::Gamma(by) => d.gamma = ((d.gamma + by) * 10.0).round().clamp(1.0, 50.0) / 10.0,
            Action::ResetLook => {
                *d = self.first_display;
                let current = self.entries.current;
                let choice = Choice { normalize: false, encoded: None, ..self.entries.choice(current) };
                self.entries.choose(current, choice);
            }
            Action::Show(channels) => d.channels = channels,
            Action::FalseColor => {
                let at = d.false_color.and_then(|f| ColorMap::ALL.iter().position(|m| *m == f.map));
                let next = at.map_or(0, |i| i + 1);
                let before = d.false_color;
                d.false_color = ColorMap::ALL.get(next).map(|map| match before {
                    Some(f) => FalseColor { map: *map, ..f },
                    None => FalseColor { map: *map, low: 0.0, high: 1.0, log: false },
                });
            }
            Action::FalseColorLog => match &mut d.false_color {
                Some(f) if f.log => *f = FalseColor { low: 0.0, high: 1.0, log: false, ..*f },
                Some(f) => *f = FalseColor { low: 1.0 / 256.0, high: 16.0, log: true, ..*f },
                None => self.say("no false colours are shown: V shows them"),
            },
            Action::Marks => {
                d.marks = match d.marks {
                    Marks::Broken => Marks::Negative,
                    Marks::Negative => Marks::Off,
                    Marks::Off => Marks::Broken,
                };
                let text = match d.marks {
                    Marks::Broken => "marked: NaN (magenta), infinite (yellow, green)",
                    Marks::Negative => "marked: NaN, infinite, and negative (blue)",
                    Marks::Off => "nothing is marked",
                };
                self.say(text);
            }
            Action::Background => {
                d.background = match d.background {
                    Background::Ignored => Background::Black,
                    Background::Black => Background::Grey,
                    Background::Grey => Background::White,
                    Background::White => Background::Checker,
                    Background::Checker => Background::Ignored,
                };
                let text = format!("behind: {:?}", d.background).to_lowercase();
                self.say(text);
            }
            Action::ScreenEncoding => d.srgb = !d.srgb,
            Action::ColorView(by) => self.next_view(by),
            Action::ColorDisplay(by) => self.next_display(by),
            _ => {}
        }
    }

    /// Sees files through another view of the same display.
    fn next_view(&mut self, by: isize) {
        let Some(viewing) = self.entries.viewing() else { return self.say(NO_CONFIGURATION) };
        let views = viewing.config().views(viewing.display());
        let at = views.iter().position(|view| view.eq_ignore_ascii_case(viewing.view())).unwrap_or(0);
        let Some(view) = views.get(Self::step(at, by, views.len())) else { return };
        let next = viewing.with_view(viewing.display(), Some(view));
        self.see_through(next);
    }

    /// Sees files through the first view of another display.
    fn next_display(&mut self, by: isize) {
        let Some(viewing) = self.entries.viewing() else { return self.say(NO_CONFIGURATION) };
        let displays = viewing.config().displays();
        let at = displays.iter().position(|name| name.eq_ignore_ascii_case(viewing.display())).unwrap_or(0);
        let Some(display) = displays.get(Self::step(at, by, displays.len())) else { return };
        let next = viewing.with_view(display, None);
        self.see_through(next);
    }

    fn see_through(&mut self, next: Result<Viewing, granita_color::ColorError>) {
        match next {
            Ok(next) => {
                self.say(format!("display {}, view {}", next.display(), next.view()));
                self.entries.see_through(Some(next));
            }
            Err(error) => self.say(error.to_string()),
        }
    }

    /// Begins, changes or ends a comparison.
    fn compare(&mut self, action: Action) {
        if self.other.is_none_or(|o| o >= self.entries.len() || o == self.entries.current) {
            self.say(
                "there is no other image yet: show another one, or keep one with Shift+T and show the next",
            );
            return;
        }
        let down = matches!(self.mix, Mix::Wipe { down: true, .. });
        let gain = if let Mix::Difference { gain } = self.mix { gain } else { 1.0 };
        let off = |on: bool, mix: Mix| if on { Mix::First } else { mix };
        self.mix = match action {
            Action::Wipe => off(matches!(self.mix, Mix::Wipe { .. }), Mix::Wipe { at: 0.5, down: false }),
            Action::WipeDirection => Mix::Wipe { at: 0.5, down: !down },
            Action::Difference => {
                off(matches!(self.mix, Mix::Difference { .. }), Mix::Difference { gain: 1.0 })
            }
            Action::DifferenceGain(by) => Mix::Difference { gain: (gain * by).clamp(1.0 / 1024.0, 65536.0) },
            Action::Over => off(self.mix == Mix::Over, Mix::Over),
            Action::FlipMap => off(self.mix == Mix::Flip, Mix::Flip),
            _ => self.mix,
        };
    }

    /// Sends a message to the sender of the current image. Returns true when it is connected.
    pub(crate) fn request(&self, request: Request) -> bool {
        self.entries.request(self.entries.current, request)
    }

    /// Returns the pixel at a point of the screen, as level, column and row.
    pub(crate) fn pixel_under(&mut self, x: f64, y: f64) -> Option<(Seen, usize, u32, u32)> {
        let current = self.entries.current;
        let seen = self.seen(current)?;
        let (level, px, py) = pixel_under(&seen.page, &seen.sheet, &self.view, x, y)?;
        Some((seen, level, px, py))
    }

    /// Returns the pixel of level 0 at a point of the screen. Beside the image, this is the nearest one.
    pub(crate) fn nearest_pixel(&mut self, x: f64, y: f64) -> Option<(i32, i32)> {
        let current = self.entries.current;
        let seen = self.seen(current)?;
        if self.view.around.is_some() {
            return None;
        }
        let [left, top, right, bottom] = seen.sheet.bounds;
        let (x, y) = self.view.to_sheet(x, y);
        let (x, y) = (x.clamp(left, right - 1e-6), y.clamp(top, bottom - 1e-6));
        let (px, py) = seen.sheet.pixel_at(x, y, 0)?;
        Some((px as i32, py as i32))
    }

    /// Checks for files that changed and images that arrived.
    fn poll(&mut self) {
        if let Some(new) = self.entries.poll_live() {
            let before = self.entries.current;
            self.show(new);
            // The first live image becomes current without a change of the index.
            if before == new {
                self.fitted = true;
            }
        }
        self.fulfil();
        let wanted: Vec<Wanted> = match &self.wanted {
            Some(wanted) => wanted.lock().try_iter().collect(),
            None => Vec::new(),
        };
        wanted.into_iter().for_each(|wanted| self.open_for_client(wanted));
        if self.watched.elapsed() < WATCH {
            return;
        }
        self.watched = Instant::now();
        let shown = [Some(self.entries.current), self.other.filter(|_| self.mix != Mix::First)];
        for entry in shown.into_iter().flatten() {
            if let Some(text) = self.entries.watch(entry, &self.formats, &self.store) {
                self.say(text);
            }
        }
        if self.message.as_ref().is_some_and(|(_, since)| since.elapsed() > Duration::from_secs(6)) {
            self.message = None;
        }
    }

    /// Opens a file, or reads it again, at the request of a client.
    fn open_for_client(&mut self, wanted: Wanted) {
        let (path, focus, again) = match wanted {
            Wanted::Open { path, focus, .. } => (PathBuf::from(path), focus, false),
            Wanted::Reload { name, focus } => (PathBuf::from(name), focus, true),
        };
        let entry = self.add_granted(path);
        if again {
            self.entries.reload(entry, &self.formats, &self.store);
        }
        if focus {
            self.show(entry);
        }
    }

    /// Returns the entry of a file that a client may name. The file is added when the list does not contain it.
    fn add_granted(&mut self, path: PathBuf) -> usize {
        self.formats.files().grant(&path);
        self.entries.find(&path).unwrap_or_else(|| {
            self.entries.add(vec![path]);
            self.entries.len() - 1
        })
    }

    /// Shows a live image as its sender requests, once (reference 7.4.3).
    fn fulfil(&mut self) {
        let current = self.entries.current;
        let Some((id, wishes)) = self.entries.live_info(current).map(|i| (i.id, i.wishes.clone())) else {
            return;
        };
        if wishes == Wishes::default() || self.fulfilled.contains(&(id, wishes.clone())) {
            return;
        }
        self.fulfilled.push((id, wishes.clone()));
        if wishes.fullscreen {
            self.pending = Some(Command::FullScreen);
        }
        if wishes.zoom > 0 {
            self.fit();
            self.act(Action::Zoom(f64::from(wishes.zoom)));
        }
        if !wishes.background.is_empty() {
            self.other = Some(self.add_granted(PathBuf::from(&wishes.background)));
            self.mix = Mix::Over;
        } else if !wishes.foreground.is_empty() {
            let foreground = self.add_granted(PathBuf::from(&wishes.foreground));
            self.show(foreground);
            self.other = Some(current);
            self.mix = Mix::Over;
        }
    }

    /// Begins to read what a window of this size will show.
    pub(crate) fn foresee(&mut self, width: u32, height: u32) {
        let current = self.entries.current;
        self.seen(current);
        self.entries.hurry(current);
        self.ask(width, height);
    }

    /// Returns what is drawn in a window of this size, and requests its tiles.
    fn ask(&mut self, width: u32, height: u32) -> Vec<Seen> {
        if (self.view.width, self.view.height) != (width, height) {
            self.view.resize(width, height);
            if self.fitted {
                self.fit();
            }
        }
        let current = self.entries.current;
        let first = self.seen(current);
        if self.fitted && self.view.around.is_none() {
            // The image may be new, or may have another size now.
            if let Some(s) = &first {
                let fit = View::fit(width, height, s.sheet.bounds);
                self.view = fit;
            }
        }
        let second = match self.mix {
            Mix::First => None,
            _ => self.other.and_then(|other| self.seen(other)),
        };
        let map = match (self.mix, &first, &second) {
            (Mix::Flip, Some(a), Some(b)) => self.flip_map(a, b),
            _ => None,
        };
        let (first, second) = if map.is_some() { (map, None) } else { (first, second) };
        let sides: Vec<Seen> = first.into_iter().chain(second).collect();
        let wanted: Vec<Needs> = sides.iter().map(|s| needs(&s.page, &s.sheet, &self.view)).collect();
        let in_sight: Vec<(u64, u64)> = (sides.iter().zip(&wanted))
            .flat_map(|(s, n)| s.page.pyramid.in_sight(n.level, n.tiles.len() as u64))
            .collect();
        self.store.look_at(&in_sight);
        // The next image is read when the current one is completely loaded.
        let ahead = if self.complete && self.loader.arrivals() > 0 { self.ahead() } else { Vec::new() };
        let (ahead, ahead_wanted): (Vec<Seen>, Vec<Needs>) = ahead.into_iter().unzip();
        let all = sides.iter().zip(&wanted).chain(ahead.iter().zip(&ahead_wanted));
        self.loader.want(all.map(|(s, n)| (&s.page.pyramid, n)));
        sides
    }

    /// Returns the next image of the list and the previous one, with the parts that will be visible, as far as both fit
    /// into the memory for images that are not shown.
    fn ahead(&mut self) -> Vec<(Seen, Needs)> {
        let (current, count) = (self.entries.current, self.entries.len());
        let mut entries = [self.heading, -self.heading].map(|by| Self::step(current, by, count)).to_vec();
        entries.dedup();
        entries.retain(|entry| *entry != current && !self.entries.is_live(*entry));
        let mut room = self.store.limits().others;
        let mut out = Vec::new();
        for entry in entries {
            // The error is reported when the entry is shown.
            let _ = self.entries.open(entry, &self.formats, &self.store);
            let Some(seen) = self.entries.seen(entry, &self.display) else { continue };
            let same = self
                .entries
                .seen(current, &self.display)
                .is_some_and(|s| s.sheet.bounds == seen.sheet.bounds);
            let fit = View::fit(self.view.width, self.view.height, seen.sheet.bounds);
            let view = if same { View { around: None, ..self.view } } else { fit };
            let wanted = needs(&seen.page, &seen.sheet, &view);
            if let Some(rest) = room.checked_sub(seen.page.pyramid.cost(wanted.tiles.len() as u64)) {
                room = rest;
                out.push((seen, wanted));
            }
        }
        out
    }

    /// Brings the canvas up to date for a window of this size. Returns true when it changed.
    pub(crate) fn frame(&mut self, width: u32, height: u32) -> bool {
        self.poll();
        let sides = self.ask(width, height);
        let key = Key {
            view: self.view,
            mix: self.mix,
            sides: sides
                .iter()
                .map(|s| {
                    let places = s.sheet.patches.iter().map(|p| p.place).collect();
                    (s.page.pyramid.number(), s.layer, s.display, places, s.sheet.level)
                })
                .collect(),
            arrivals: self.loader.arrivals(),
            changes: self.entries.changes(),
        };
        if self.drawn.as_ref() == Some(&key) {
            return false;
        }
        let shown: Vec<Shown<'_>> = sides.iter().map(|s| s.shown()).collect();
        let done = match shown[..] {
            [] => false,
            [a] => draw_into(a, None, Mix::First, &self.view, &mut self.canvas).is_ok(),
            [a, b, ..] => draw_into(a, Some(b), self.mix, &self.view, &mut self.canvas).is_ok(),
        };
        if !done {
            self.canvas.clear(width, height);
        }
        self.paint_drawing();
        self.complete = self.canvas.complete;
        self.drawn = Some(key);
        true
    }

    /// Returns the perceived difference of two images, as an image; `None` until it is computed.
    fn flip_map(&mut self, a: &Seen, b: &Seen) -> Option<Seen> {
        let page = match self.tasks.flip_map(&self.loader, a, b, &self.store)? {
            Ok(page) => page,
            Err(what) => {
                self.say(what);
                return None;
            }
        };
        let sheet = page.sheet(Arrangement::Stored, 0);
        let magma = FalseColor { map: ColorMap::Magma, low: 0.0, high: 1.0, log: false };
        let display = Display { false_color: Some(magma), ..Display::default() };
        Some(Seen { page, sheet, layer: 0, display })
    }

    /// Draws the vector graphics that were sent for a live image over it.
    fn paint_drawing(&mut self) {
        if self.view.around.is_some() || self.mix != Mix::First {
            return;
        }
        let Some(info) = self.entries.live_info(self.entries.current) else { return };
        if !info.drawing.is_empty() {
            paint(&mut self.canvas, &self.view, (0.0, 0.0), &info.drawing);
        }
    }

    /// Returns the number of bytes of the tiles that the current image needs in this view.
    pub(crate) fn visible_bytes(&mut self) -> u64 {
        let current = self.entries.current;
        let Some(seen) = self.seen(current) else { return 0 };
        let needs = needs(&seen.page, &seen.sheet, &self.view);
        let tile = u64::from(granita_view::TILE);
        needs.tiles.len() as u64 * tile * tile * seen.page.pyramid.pixel_bytes()
    }

    /// True when all requested data is loaded.
    pub(crate) fn is_settled(&self) -> bool {
        self.loader.is_idle()
    }

    /// Returns the results that are computed in the background: the statistics of the probe, the comparison and the
    /// histogram.
    pub(crate) fn answers(&mut self) -> Answers {
        let current = self.entries.current;
        let Some(seen) = self.seen(current) else { return Answers::default() };
        let second = match self.mix {
            // An image that lies over another one is not compared with it.
            Mix::First | Mix::Over => None,
            _ => self.other.and_then(|other| self.seen(other)),
        };
        let needs = needs(&seen.page, &seen.sheet, &self.view);
        let settled = self.complete;
        let asked = Asked {
            second: second.as_ref(),
            probe: self.probe,
            histogram: Some(&needs).filter(|_| self.side_open && settled),
        };
        self.tasks.answers(&self.loader, &seen, &asked)
    }
}

#[cfg(test)]
#[path = "model_tests.rs"]
mod tests;
