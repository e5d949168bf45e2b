//! The list of images, which are files and live images. Files are opened when they are shown.

use granita_image::{FormatRegistry, Request};
use granita_view::{
    Arrangement, Display, Group, Image, Live, LiveInfo, LivePage, Page, Sheet, Shown, Stamp, TileStore,
    Viewing, groups,
};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

/// The largest number of files that are open at once.
const OPEN: usize = 24;

/// The selected part of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Choice {
    pub(crate) page: usize,
    pub(crate) layer: usize,
    pub(crate) level: usize,
    /// The arrangement; `None` for the one that suits the page.
    pub(crate) arrangement: Option<Arrangement>,
    /// True when the values of the layer are stretched from black to white.
    pub(crate) normalize: bool,
    /// True when integers are encoded colours; `None` for what the page declares.
    pub(crate) encoded: Option<bool>,
}

impl Choice {
    pub(crate) const FIRST: Self =
        Self { page: 0, layer: 0, level: 0, arrangement: None, normalize: false, encoded: None };
}

/// The drawn part of an entry.
#[derive(Clone, Debug)]
pub(crate) struct Seen {
    pub(crate) page: Arc<Page>,
    pub(crate) sheet: Sheet,
    pub(crate) layer: usize,
    pub(crate) display: Display,
}

impl Seen {
    pub(crate) fn shown(&self) -> Shown<'_> {
        Shown { page: &self.page, sheet: &self.sheet, layer: self.layer, display: &self.display }
    }
}

enum Opened {
    Not,
    File(Image),
    Live(LivePage),
    /// The error, and the stamp of the file at the time of the error.
    Failed(String, Stamp),
}

struct Entry {
    /// The path of the file, or the name of the live image.
    path: PathBuf,
    live: bool,
    opened: Opened,
    choice: Choice,
}

/// The list of images.
pub(crate) struct Entries {
    list: Vec<Entry>,
    pub(crate) current: usize,
    /// The indices of open files, in the order in which they were opened.
    open: VecDeque<usize>,
    live: Live,
    live_version: u64,
    /// The id of the live image that was last requested to be shown.
    live_shown: u64,
    changes: u64,
    /// The view of a display through which files are seen; `None` for the encoding of sRGB.
    viewing: Option<Viewing>,
    /// The list in groups, and its length when they were made. The list only grows.
    groups: RefCell<(usize, Rc<Vec<Group>>)>,
}

/// Opens a file, to be seen through a view of a display.
fn open_image(
    path: &Path,
    formats: &FormatRegistry,
    store: &TileStore,
    viewing: Option<&Viewing>,
) -> granita_view::Result<Image> {
    let mut image = Image::open(path, formats, store)?;
    if viewing.is_some() {
        image.see_through(viewing);
    }
    Ok(image)
}

impl Entries {
    pub(crate) fn new(files: Vec<PathBuf>, live: Live) -> Self {
        let mut entries = Self {
            list: Vec::new(),
            current: 0,
            open: VecDeque::new(),
            live,
            live_version: u64::MAX,
            live_shown: 0,
            changes: 0,
            viewing: None,
            groups: RefCell::default(),
        };
        entries.add(files);
        entries
    }

    /// Returns the view of a display through which files are seen.
    pub(crate) fn viewing(&self) -> Option<&Viewing> {
        self.viewing.as_ref()
    }

    /// Sees all files through a view of a display.
    pub(crate) fn see_through(&mut self, viewing: Option<Viewing>) {
        for entry in &mut self.list {
            if let Opened::File(image) = &mut entry.opened {
                image.see_through(viewing.as_ref());
            }
        }
        self.viewing = viewing;
        self.changes += 1;
    }

    /// Adds files at the end of the list.
    pub(crate) fn add(&mut self, files: Vec<PathBuf>) {
        self.list.extend(files.into_iter().map(|path| Entry {
            path,
            live: false,
            opened: Opened::Not,
            choice: Choice::FIRST,
        }));
    }

    pub(crate) fn len(&self) -> usize {
        self.list.len()
    }

    /// Returns a number that grows when a live image is added to the list or the content of an entry changes, except by
    /// tiles that the loader reads.
    pub(crate) fn changes(&self) -> u64 {
        self.changes
    }

    /// Returns the name of an entry, without the folder.
    pub(crate) fn name(&self, entry: usize) -> String {
        let Some(e) = self.list.get(entry) else { return String::new() };
        if e.live {
            return e.path.display().to_string();
        }
        e.path.file_name().map_or_else(|| e.path.display().to_string(), |n| n.to_string_lossy().into_owned())
    }

    /// Returns the index of the file with this path.
    pub(crate) fn find(&self, path: &Path) -> Option<usize> {
        self.list.iter().position(|e| !e.live && e.path == path)
    }

    /// Returns the images that arrive.
    pub(crate) fn live(&self) -> &Live {
        &self.live
    }

    /// True when an entry is an image that arrives.
    pub(crate) fn is_live(&self, entry: usize) -> bool {
        self.list.get(entry).is_some_and(|e| e.live)
    }

    /// Returns the list in groups, which are sequences, folders and the live images.
    pub(crate) fn groups(&self) -> Rc<Vec<Group>> {
        let mut held = self.groups.borrow_mut();
        if held.0 == self.list.len() {
            return held.1.clone();
        }
        let files: Vec<PathBuf> = self
            .list
            .iter()
            .map(|e| if e.live { Path::new("live").join(&e.path) } else { e.path.clone() })
            .collect();
        *held = (self.list.len(), Rc::new(groups(&files)));
        held.1.clone()
    }

    /// Opens an entry that is not open.
    ///
    /// # Errors
    /// Returns the error of the file, only the first time.
    pub(crate) fn open(
        &mut self,
        entry: usize,
        formats: &FormatRegistry,
        store: &TileStore,
    ) -> Result<(), String> {
        let Some(e) = self.list.get_mut(entry) else { return Ok(()) };
        if !matches!(e.opened, Opened::Not) {
            return Ok(());
        }
        if e.live {
            let page = LivePage::new(&self.live, &e.path.to_string_lossy(), store);
            if let Some(page) = page {
                e.opened = Opened::Live(page);
            }
            return Ok(());
        }
        let stamp = Stamp::of(&e.path);
        match open_image(&e.path, formats, store, self.viewing.as_ref()) {
            Ok(image) => e.opened = Opened::File(image),
            Err(error) => {
                let text = error.to_string();
                e.opened = Opened::Failed(text.clone(), stamp);
                return Err(text);
            }
        }
        self.open.retain(|i| *i != entry);
        self.open.push_back(entry);
        while self.open.len() > OPEN {
            let is_free = |i: &usize| *i != self.current && *i != entry;
            let Some(oldest) = self.open.iter().position(is_free).and_then(|at| self.open.remove(at)) else {
                break;
            };
            self.list[oldest].opened = Opened::Not;
        }
        Ok(())
    }

    /// Requests that a rough image of an open entry is read first, because the user waits for it.
    pub(crate) fn hurry(&self, entry: usize) {
        if let Some(image) = self.image(entry) {
            image.pages.iter().for_each(|page| page.pyramid.sketch_first());
        }
    }

    /// Returns the error of an entry that cannot be opened.
    pub(crate) fn error(&self, entry: usize) -> Option<&str> {
        match &self.list.get(entry)?.opened {
            Opened::Failed(text, _) => Some(text),
            _ => None,
        }
    }

    /// Returns the number of pages of an open entry, and the selected page.
    pub(crate) fn page(&self, entry: usize) -> Option<(usize, Arc<Page>)> {
        let e = self.list.get(entry)?;
        match &e.opened {
            Opened::File(image) => {
                let page = image.pages.get(e.choice.page).or(image.pages.first())?;
                Some((image.pages.len(), page.clone()))
            }
            Opened::Live(live) => Some((1, live.page.clone())),
            Opened::Not | Opened::Failed(..) => None,
        }
    }

    /// Returns the file of an entry, when it is open.
    pub(crate) fn image(&self, entry: usize) -> Option<&Image> {
        match &self.list.get(entry)?.opened {
            Opened::File(image) => Some(image),
            _ => None,
        }
    }

    /// Returns the state of a live image.
    pub(crate) fn live_info(&self, entry: usize) -> Option<&LiveInfo> {
        match &self.list.get(entry)?.opened {
            Opened::Live(live) => Some(live.info()),
            _ => None,
        }
    }

    pub(crate) fn choice(&self, entry: usize) -> Choice {
        self.list.get(entry).map_or(Choice::FIRST, |e| e.choice)
    }

    pub(crate) fn choose(&mut self, entry: usize, choice: Choice) {
        if let Some(e) = self.list.get_mut(entry) {
            e.choice = choice;
        }
    }

    /// True when an open entry shows all directions around a point; `None` when the entry is not open.
    pub(crate) fn panorama(&self, entry: usize) -> Option<bool> {
        self.page(entry).map(|(_, page)| page.is_panorama())
    }

    /// Treats the selected page of a file as a panorama, although it is not marked as one.
    pub(crate) fn as_panorama(&mut self, entry: usize, _store: &TileStore) {
        let Some(e) = self.list.get_mut(entry) else { return };
        let chosen = e.choice.page;
        if let Opened::File(image) = &mut e.opened
            && let Some(page) = image.pages.get_mut(chosen)
        {
            *page = Arc::new(page.as_panorama());
            self.changes += 1;
        }
    }

    /// Selects the same part in the entry `to` as in the entry `from`, unless a part of it is already selected.
    pub(crate) fn follow(&mut self, from: usize, to: usize) {
        let choice = self.choice(from);
        if let Some(e) = self.list.get_mut(to)
            && e.choice == Choice::FIRST
        {
            e.choice = Choice { encoded: None, ..choice };
        }
    }

    /// Returns what is drawn of an open entry, with the user's display.
    pub(crate) fn seen(&self, entry: usize, display: &Display) -> Option<Seen> {
        let (_, mut page) = self.page(entry)?;
        let choice = self.choice(entry);
        if let Some(encoded) = choice.encoded.filter(|e| *e != page.encoded) {
            page = Arc::new(page.with_encoding(encoded));
        }
        let layer = choice.layer.min(page.layers.len() - 1);
        let level = choice.level.min(page.pyramid.stored_levels() - 1);
        let arrangement: Arrangement = choice.arrangement.unwrap_or(page.arrangement());
        let sheet = page.sheet(arrangement, level);
        let mut display = *display;
        // The page may not have the selected channel.
        if let granita_view::Channels::One(c) = display.channels
            && c >= page.spec().nchannels()
        {
            display.channels = granita_view::Channels::Color;
        }
        Some(Seen { page, sheet, layer, display })
    }

    /// Opens a file again.
    pub(crate) fn reload(&mut self, entry: usize, formats: &FormatRegistry, store: &TileStore) {
        let Some(e) = self.list.get_mut(entry).filter(|e| !e.live) else { return };
        self.changes += 1;
        let stamp = Stamp::of(&e.path);
        match (open_image(&e.path, formats, store, self.viewing.as_ref()), &e.opened) {
            (Ok(image), _) => e.opened = Opened::File(image),
            // The previous image stays on the screen.
            (Err(_), Opened::File(_)) => {}
            (Err(error), _) => e.opened = Opened::Failed(error.to_string(), stamp),
        }
    }

    /// Opens a file again if it changed or could not be opened before. Returns a message when an image that was shown
    /// has changed.
    pub(crate) fn watch(
        &mut self,
        entry: usize,
        formats: &FormatRegistry,
        store: &TileStore,
    ) -> Option<String> {
        let e = self.list.get_mut(entry).filter(|e| !e.live)?;
        match &mut e.opened {
            Opened::File(image) if image.has_changed() => {
                let now = Stamp::of(&e.path);
                match open_image(&e.path, formats, store, self.viewing.as_ref()) {
                    Ok(new) => *image = new,
                    Err(_) => {
                        // The file is being written. The previous image stays, and the file is opened again when it has
                        // changed once more.
                        image.stamp = now;
                        return None;
                    }
                }
                self.changes += 1;
                Some(format!("{} has changed", e.path.display()))
            }
            Opened::Failed(_, stamp) => {
                let now = Stamp::of(&e.path);
                if now == *stamp || !now.is_there() {
                    return None;
                }
                *stamp = now;
                if let Ok(new) = open_image(&e.path, formats, store, self.viewing.as_ref()) {
                    e.opened = Opened::File(new);
                    self.changes += 1;
                }
                None
            }
            _ => None,
        }
    }

    /// Records the live images that arrived. Returns the entry to show now, if any. This is the image whose sender
    /// requests it, or the first one when the list was empty.
    pub(crate) fn poll_live(&mut self) -> Option<usize> {
        let version = self.live.version();
        if version == self.live_version {
            return None;
        }
        self.live_version = version;
        let nothing = self.list.is_empty();
        for name in self.live.names() {
            let place = self.list.iter().position(|e| e.live && e.path.as_os_str() == &*name);
            let Some(entry) = place else {
                self.list.push(Entry {
                    path: PathBuf::from(&name),
                    live: true,
                    opened: Opened::Not,
                    choice: Choice::FIRST,
                });
                self.changes += 1;
                continue;
            };
            if let Opened::Live(page) = &mut self.list[entry].opened {
                match page.refresh() {
                    Some(changed) => self.changes += u64::from(changed),
                    // The image was removed, or replaced by another one of this name.
                    None => {
                        self.list[entry].opened = Opened::Not;
                        self.changes += 1;
                    }
                }
            }
        }
        let shown = self.live.shown();
        if shown != 0 && shown != self.live_shown {
            self.live_shown = shown;
            let is_it = |e: &Entry| {
                e.live && self.live.info(&e.path.to_string_lossy()).is_some_and(|info| info.id == shown)
            };
            return self.list.iter().position(is_it);
        }
        (nothing && !self.list.is_empty()).then_some(0)
    }

    /// Sends a message to the sender of a live image. Returns true when it is connected.
    pub(crate) fn request(&self, entry: usize, request: Request) -> bool {
        let name = self.list.get(entry).filter(|e| e.live).map(|e| e.path.to_string_lossy().into_owned());
        name.and_then(|name| self.live.requests(&name)).is_some_and(|sender| sender.send(request))
    }
}
