//! The state that all lookups of a cache share: files, tiles, open handles, counters.

use crate::file::{Source, TextureFile};
use crate::files::Files;
use crate::made::{MadeShadow, TileMaker};
use crate::squares::Squares;
use crate::statistics::{Counters, add};
use crate::tile_cache::{Cell, Origin, TileCache, TileKey};
use crate::tiles::Tile;
use crate::udim::UdimName;
use crate::volume::EMPTY;
use crate::{CacheOptions, TextureId};
use granita_base::{Location, Lru, Reporter, SearchPath, Severity};
use granita_image::{FormatRegistry, ImageError, ImageInput, Pixels};
use parking_lot::{Condvar, Mutex, MutexGuard};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering, fence};

/// The state of a [`crate::TextureCache`].
#[derive(Debug)]
pub(crate) struct Shared {
    registry: FormatRegistry,
    search: SearchPath,
    pub(crate) options: CacheOptions,
    reporter: Reporter,
    pub(crate) counters: Counters,
    tiles: TileCache,
    pub(crate) files: Files,
    open: Mutex<Open>,
    /// The condition that is notified when a file was closed, when a file that stays open was opened, and when a read
    /// ends while a thread waits.
    opened: Condvar,
    /// The number of threads that wait for `opened`.
    waiting: AtomicUsize,
    /// The files that cannot be used and that no lookup has needed so far, with the reason.
    unusable: Mutex<BTreeMap<String, String>>,
    /// The number of entries in `unusable`.
    untold: AtomicUsize,
    /// The reason for each name that cannot be used.
    reasons: Mutex<BTreeMap<String, String>>,
}

/// The files that are open.
#[derive(Default)]
struct Open {
    /// The inputs of files that are read by tiles, by the index of the file. An input is idle while this is its only
    /// owner.
    files: Lru<u32, Arc<dyn ImageInput>>,
    /// The number of files that are being opened, or read as a whole.
    more: usize,
    /// The largest permitted number of open files. It is the option, or less after the system refused to open one more.
    most: usize,
}

impl std::fmt::Debug for Open {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Open({} files of {})", self.files.len() + self.more, self.most)
    }
}

impl Open {
    /// Closes the file that was read from longest ago, among those that no thread reads from. Returns true when there
    /// was one.
    fn close_oldest(&mut self) -> bool {
        self.files.evict(|_, input| Arc::strong_count(input) == 1).is_some()
    }
}

/// The permission to have one more file open.
struct Leave<'a>(&'a Shared);

/// A file that is open for one reader.
pub(crate) struct Whole<'a> {
    input: Box<dyn ImageInput>,
    _leave: Leave<'a>,
}

impl std::ops::Deref for Whole<'_> {
    type Target = dyn ImageInput;

    fn deref(&self) -> &Self::Target {
        &*self.input
    }
}

impl Drop for Leave<'_> {
    fn drop(&mut self) {
        self.0.open().more -= 1;
        self.0.opened.notify_all();
    }
}

/// A file from which one thread reads tiles. It is not closed meanwhile.
struct Reading<'a> {
    shared: &'a Shared,
    /// The input. It is `None` only while this is dropped.
    input: Option<Arc<dyn ImageInput>>,
}

impl Reading<'_> {
    fn tile(&self, key: TileKey) -> granita_image::Result<Pixels> {
        let input = self.input.as_ref().expect("invariant: the input is there until it is dropped");
        input.read_tile(0, key.level as usize, key.tx, key.ty)
    }
}

impl Drop for Reading<'_> {
    fn drop(&mut self) {
        self.input = None;
        // Either the waiting thread finds that the input is idle, or this one finds that a thread waits.
        fence(Ordering::SeqCst);
        if self.shared.waiting.load(Ordering::Relaxed) > 0 {
            // Because of the lock, the other thread either has checked all files and sleeps, or has not checked yet.
            let _open = self.shared.open();
            self.shared.opened.notify_all();
        }
    }
}

/// True when the system refused to open a file because too many are open.
fn too_many_files(error: &ImageError) -> bool {
    /// The error numbers `ENFILE` and `EMFILE`, for the system and for the process, which are the same on all Unix
    /// systems, and the number of this error on Windows.
    const CODES: &[i32] = if cfg!(windows) { &[4] } else { &[23, 24] };
    matches!(error, ImageError::Io { source, .. } if source.raw_os_error().is_some_and(|code| CODES.contains(&code)))
}

impl Shared {
    pub(crate) fn new(
        registry: FormatRegistry,
        search: SearchPath,
        options: CacheOptions,
        reporter: Reporter,
    ) -> Self {
        let tiles = TileCache::new(options.memory_bytes);
        let most_files = options.max_files.max(1);
        Self {
            registry,
            search,
            options,
            reporter,
            counters: Counters::default(),
            tiles,
            files: Files::new(),
            open: Mutex::new(Open { most: most_files, ..Open::default() }),
            opened: Condvar::new(),
            waiting: AtomicUsize::new(0),
            unusable: Mutex::default(),
            untold: AtomicUsize::new(0),
            reasons: Mutex::default(),
        }
    }

    fn open(&self) -> MutexGuard<'_, Open> {
        self.open.lock()
    }

    /// Waits until one more file may be open. Closes the file that was read from longest ago, among those that no
    /// thread reads from now.
    fn leave(&self) -> Leave<'_> {
        let mut open = self.open();
        while open.files.len() + open.more >= open.most {
            if !open.close_oldest() {
                self.wait(&mut open);
            }
        }
        open.more += 1;
        self.counters.peak_files_open.fetch_max((open.files.len() + open.more) as u64, Ordering::Relaxed);
        Leave(self)
    }

    /// Sleeps until a file may have become idle.
    fn wait(&self, open: &mut MutexGuard<'_, Open>) {
        self.waiting.fetch_add(1, Ordering::Relaxed);
        fence(Ordering::SeqCst);
        // This is checked once more, because a read that ended before this thread was counted did not notify it.
        if !open.close_oldest() {
            self.opened.wait(open);
        }
        self.waiting.fetch_sub(1, Ordering::Relaxed);
    }

    /// Runs `with_files`, which opens files. Where the system refuses one because too many are open, files of the cache
    /// are closed and it runs again. From then on the cache keeps fewer files open.
    fn retried<T>(&self, with_files: impl Fn() -> granita_image::Result<T>) -> granita_image::Result<T> {
        loop {
            let result = with_files();
            if !result.as_ref().is_err_and(too_many_files) {
                return result;
            }
            let mut open = self.open();
            if open.files.is_empty() {
                return result;
            }
            // From now on other users, such as image files that are written, have some handles left.
            let spare = (open.files.len() / 8).max(2);
            open.most = open.most.min((open.files.len() + open.more).saturating_sub(spare)).max(1);
            while open.files.len() + open.more > open.most && !open.files.is_empty() {
                if !open.close_oldest() {
                    self.wait(&mut open);
                }
            }
        }
    }

    /// Returns the index of the file of this name, whose texels are needed. Reports one error when it cannot be used.
    pub(crate) fn find(&self, name: &str) -> Option<u32> {
        let index = self.look_for(name);
        if index.is_none()
            && self.untold.load(Ordering::Relaxed) > 0
            && let Some(text) = self.unusable().remove(name)
        {
            self.untold.fetch_sub(1, Ordering::Relaxed);
            self.reporter.say(Severity::Error, &Location::default(), text);
        }
        index
    }

    /// Returns the index for a query about the file, for example whether it exists. Reports one warning when it cannot
    /// be used.
    pub(crate) fn find_to_ask(&self, name: &str) -> Option<u32> {
        let index = self.look_for(name);
        if index.is_none()
            && let Some(text) = self.unusable().get(name)
        {
            self.reporter.once(text, Severity::Warning, &Location::default(), text.clone());
        }
        index
    }

    fn unusable(&self) -> MutexGuard<'_, BTreeMap<String, String>> {
        self.unusable.lock()
    }

    /// Returns the reason why the file of a name cannot be used.
    pub(crate) fn reason(&self, name: &str) -> String {
        let reason = self.reasons.lock().get(name).cloned();
        reason.unwrap_or_else(|| format!("texture \"{name}\" cannot be used"))
    }

    /// Forgets that the file of a name cannot be used.
    pub(crate) fn forget_reason(&mut self, name: &str) {
        self.reasons.get_mut().remove(name);
        if self.unusable.get_mut().remove(name).is_some() {
            *self.untold.get_mut() -= 1;
        }
    }

    /// Closes a file and drops its tiles.
    pub(crate) fn close(&mut self, index: u32) {
        self.open.get_mut().files.remove(&index);
        self.tiles.forget(index);
    }

    /// Returns the index of the file of this name, without a message when it cannot be used.
    pub(crate) fn look_for(&self, name: &str) -> Option<u32> {
        let mut opened = None;
        let index = self.files.find(name, |index| {
            let leave = self.leave();
            let (file, input) = self.open_new(index, name)?;
            opened = Some((leave, input));
            Some(file)
        });
        if let (Some((_leave, Some(input))), Some(index)) = (opened, index) {
            self.keep_open(index, input);
        }
        index
    }

    /// Returns the index of a new map without a file; `None` when the name is taken.
    pub(crate) fn declare(&self, name: &str, map: &MadeShadow) -> Option<u32> {
        let mut new = false;
        let index = self.files.find(name, |index| {
            new = true;
            Some(TextureFile::made(index, name, map))
        });
        add(&self.counters.files, u64::from(new));
        index.filter(|_| new)
    }

    /// Keeps a file open that is read by tiles. Returns the input from which to read, which is another one when another
    /// thread has opened the file meanwhile.
    fn keep_open(&self, index: u32, input: Arc<dyn ImageInput>) -> Arc<dyn ImageInput> {
        let files = &mut self.open().files;
        if let Some(input) = files.get(&index) {
            return input.clone();
        }
        files.insert(index, input.clone(), 1);
        input
    }

    /// Opens the file of a name. Returns its input, too, if it is read by tiles.
    fn open_new(&self, index: u32, name: &str) -> Option<(TextureFile, Option<Arc<dyn ImageInput>>)> {
        let refuse = |text: String| {
            add(&self.counters.missing, 1);
            self.reasons.lock().insert(name.to_owned(), text.clone());
            self.unusable().insert(name.to_owned(), text);
            self.untold.fetch_add(1, Ordering::Relaxed);
            None
        };
        // The name may be one image of a file that holds several: `file#2`.
        let part = || {
            let (file, image) = granita_image::split_image_name(name)?;
            let found = self.search.find(file)?;
            Some((format!("{}#{image}", found.display()).into(), found))
        };
        // Or it may be the name of a set, whose first file has its attributes.
        let mut set = None;
        let first = || {
            let names = UdimName::parse(name)?.names(&self.search);
            let found = self.search.find(names.first_key_value()?.1)?;
            set = Some(Squares::new(name, names, index));
            Some((found.clone(), found))
        };
        let plain = || self.search.find(name).map(|path| (path.clone(), path));
        let Some((path, read)) = plain().or_else(part).or_else(first) else {
            let folders: Vec<String> =
                self.search.folders().iter().map(|f| f.display().to_string()).collect();
            let text = format!("texture \"{name}\" not found (searched {})", folders.join(":"));
            return refuse(text);
        };
        let input = match self.retried(|| self.registry.open(&path)) {
            Ok(input) => input,
            Err(error) => return refuse(format!("texture \"{name}\": {error}")),
        };
        add(&self.counters.files_opened, 1);
        self.reporter.file_read(&read);
        let (file, lack) = match TextureFile::open(index, path, &*input) {
            Ok((file, lack)) => (file.nearby(self.options.common_origin), lack),
            Err(what) => return refuse(format!("texture \"{name}\": {what}")),
        };
        if let Some(lack) = lack.filter(|_| !self.options.automipmap) {
            let what = lack.words();
            let text = format!("texture \"{name}\" {what} and is not used (texture:automipmap is 0)");
            return refuse(text);
        }
        add(&self.counters.files, 1);
        let mut file = file;
        file.set = set;
        let tiled = matches!(file.source, Source::Tiles);
        Some((file, tiled.then(|| Arc::from(input))))
    }

    /// Returns the tile of this key, of `file`. Without a file `maker` makes it, and without a maker it is empty.
    pub(crate) fn tile(&self, file: &TextureFile, key: TileKey, maker: Option<&dyn TileMaker>) -> Arc<Cell> {
        match &file.source {
            Source::Memory(_, made) => {
                let levels = made.get_or_init(|| self.make_levels(file));
                levels[key.level as usize].clone()
            }
            Source::Tiles => {
                let bytes = file.tile_bytes(key.level as usize);
                let read = || self.read_tile(file, key);
                self.tiles.get(key, (Origin::File, bytes), &self.counters, read)
            }
            Source::Made => {
                let level = &file.levels[0];
                let size = level.tile_width as usize * level.tile_height as usize;
                let tile = |depths: Vec<f32>| {
                    let depths = if depths.len() == size { depths } else { vec![EMPTY; size] };
                    Tile::new(Pixels::Float(depths), level.tile_width as usize, 1, file.layout_in_memory())
                };
                // A tile that is empty because there is no maker must not be cached for readers that have one.
                let Some(maker) = maker else { return Arc::new(Cell::of(tile(Vec::new()))) };
                let make = || tile(maker.tile(TextureId(file.index), key.tx, key.ty));
                self.tiles.get(key, (Origin::Made, file.tile_bytes(0)), &self.counters, make)
            }
        }
    }

    /// Returns the largest permitted number of bytes of tiles.
    pub(crate) fn bound(&self) -> u64 {
        self.tiles.max_bytes()
    }

    fn make_levels(&self, file: &TextureFile) -> Vec<Arc<Cell>> {
        let black = || file.levels.iter().map(|l| Arc::new(Cell::of(file.black_tile(l)))).collect();
        if file.is_broken() {
            return black();
        }
        let _leave = self.leave();
        let made = self.retried(|| {
            let input = self.registry.open(&file.path)?;
            add(&self.counters.files_opened, 1);
            file.make_levels(&*input)
        });
        let levels = match made {
            Ok(levels) => {
                if let Source::Memory(lack, _) = &file.source {
                    let what = lack.words();
                    self.warn_once(
                        file,
                        &format!("{what}: its levels are made in memory; a file made by maketx takes less time and memory"),
                    );
                }
                levels
            }
            Err(error) => {
                self.failed(file, &error.to_string());
                file.broken.store(true, Ordering::Relaxed);
                black()
            }
        };
        add(&self.counters.automipmaps, 1);
        add(&self.counters.automipmap_bytes, levels.iter().map(|t| t.tile().bytes()).sum());
        levels
    }

    /// Opens a file once more, to be read as a whole.
    pub(crate) fn open_whole(&self, file: &TextureFile) -> Result<Whole<'_>, String> {
        if let Source::Made = file.source {
            return Err("it is not a file".to_owned());
        }
        let leave = self.leave();
        let input = self.retried(|| self.registry.open(&file.path)).map_err(|e| e.to_string())?;
        add(&self.counters.files_opened, 1);
        Ok(Whole { input, _leave: leave })
    }

    fn read_tile(&self, file: &TextureFile, key: TileKey) -> Tile {
        let level = &file.levels[key.level as usize];
        let texels = level.tile_width as usize * level.tile_height as usize;
        if file.is_broken() {
            return file.black_tile(level);
        }
        let result =
            self.reading(file).and_then(|reading| reading.tile(key)).map_err(|error| error.to_string());
        match result {
            Ok(pixels)
                if pixels.len() == texels * file.channels && pixels.pixel_type() == file.pixel_type =>
            {
                Tile::new(pixels, level.tile_width as usize, file.channels, file.layout_in_memory())
            }
            Ok(pixels) => {
                let what = format!(
                    "a tile of {} values ({:?}) where {} ({:?}) are needed",
                    pixels.len(),
                    pixels.pixel_type(),
                    texels * file.channels,
                    file.pixel_type
                );
                self.failed(file, &what);
                file.black_tile(level)
            }
            Err(what) => {
                self.failed(file, &what);
                file.black_tile(level)
            }
        }
    }

    /// Returns the open file, which is opened again if it was closed.
    fn reading(&self, file: &TextureFile) -> granita_image::Result<Reading<'_>> {
        let reading = |input| Reading { shared: self, input: Some(input) };
        if !matches!(file.source, Source::Tiles) {
            return self.registry.open(&file.path).map(Arc::from).map(reading);
        }
        if let Some(input) = self.open().files.get(&file.index) {
            return Ok(reading(input.clone()));
        }
        let _leave = self.leave();
        let input = self.retried(|| self.registry.open(&file.path))?;
        add(&self.counters.files_opened, 1);
        Ok(reading(self.keep_open(file.index, Arc::from(input))))
    }

    fn failed(&self, file: &TextureFile, what: &str) {
        let cause = format!("texture read {}", file.path.display());
        let text = format!("texture {what}: texels that cannot be read are black");
        self.reporter.once(&cause, Severity::Error, &Location::default(), text);
    }

    pub(crate) fn warn(&self, what: String) {
        self.reporter.say(Severity::Warning, &Location::default(), what);
    }

    /// Reports a warning about a file, once per file and text.
    pub(crate) fn warn_once(&self, file: &TextureFile, what: &str) {
        let text = format!("texture {} {what}", file.path.display());
        self.reporter.once(&text.clone(), Severity::Warning, &Location::default(), text);
    }
}
