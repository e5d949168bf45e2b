//! All databases of a session, with their modes of reading and writing.

use crate::error::{Result, SdbError};
use crate::file::{Spool, read_with};
use crate::image::{ImageOptions, LARGEST, image};
use crate::{Key, Packed, Schema};
use granita_base::{Files, Location, Reporter, SearchPath, Severity};
use granita_image::{CreateOptions, Format, FormatRegistry, ImageSpec, PixelType, Pixels};
use parking_lot::Mutex;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The mode of a database's file, from an option "filemode" or from the attributes (reference 4.3.9, 5.8.13).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Mode {
    /// True when queries see the file's records ("r", "rw", "ro").
    pub read: bool,
    /// True when the file is written after the frame ("w", "rw", "wo").
    pub write: bool,
    /// True when queries always succeed ("ro").
    pub readonly: bool,
    /// True when queries do not see saved records ("wo").
    pub writeonly: bool,
}

impl Mode {
    /// Returns the mode of an option's word. The empty word gives the default mode. `None` for other words.
    pub fn from_word(word: &str) -> Option<Self> {
        let none = Self::default();
        Some(match word {
            "" => none,
            "r" => Self { read: true, ..none },
            "w" => Self { write: true, ..none },
            "rw" => Self { read: true, write: true, ..none },
            "ro" => Self { read: true, readonly: true, ..none },
            "wo" => Self { write: true, writeonly: true, ..none },
            _ => return None,
        })
    }
}

/// The database names of the attributes "spatialdb:read" and so on.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attributes {
    /// The databases whose files queries see.
    pub read: Vec<String>,
    /// The databases that are written.
    pub write: Vec<String>,
    /// The databases whose queries always succeed.
    pub readonly: Vec<String>,
    /// The databases that are written and not queried.
    pub writeonly: Vec<String>,
}

impl Attributes {
    /// Returns the mode of a database: that of the option when it gives one, or else that of the attributes.
    pub fn mode(&self, name: &str, option: Mode) -> Mode {
        if option != Mode::default() {
            return option;
        }
        let has = |list: &[String]| list.iter().any(|n| n == name);
        let (readonly, writeonly) = (has(&self.readonly), has(&self.writeonly));
        Mode {
            read: has(&self.read) || readonly,
            write: (has(&self.write) || writeonly) && !readonly,
            readonly,
            writeonly,
        }
    }
}

/// The result of [`Databases::finish`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Finished {
    /// The files that were written, in the order of their names.
    pub written: Vec<PathBuf>,
    /// The number of records in them.
    pub records: u64,
}

/// The largest number of floats that are kept in memory for one database before they go to a file: 256 MiB.
const IN_MEMORY: usize = 64 << 20;

/// Databases by name.
///
/// Any number of threads save and query at once. A query sees the records from **before the frame**: those of the
/// file, when the mode is to read it, or else those of earlier frames of this session that were not written. Records
/// that a frame saves are visible from [`Databases::finish`] on. Results therefore do not depend on the order of
/// threads.
#[derive(Debug)]
pub struct Databases {
    formats: FormatRegistry,
    reporter: Reporter,
    in_memory: usize,
    /// Locked to find a database, and not while a database is used.
    entries: Mutex<BTreeMap<String, Arc<Mutex<Entry>>>>,
    saves: AtomicU64,
}

/// The state of one database.
#[derive(Debug, Default)]
struct Entry {
    /// The records of this frame.
    saved: Option<Spool>,
    write: bool,
    /// True when the records are added to those of the file ("rw").
    adds: bool,
    image: ImageOptions,
    /// The number of records that were left out because they are not finite.
    broken: u64,
    /// The error by which some records of this frame were lost.
    lost: Option<ErrorKind>,
    /// The records of earlier frames.
    memory: Option<Arc<Packed>>,
    /// The result of the search for the file, if it was searched for.
    file: Option<Option<Arc<Packed>>>,
}

impl Databases {
    /// Returns an empty set of databases. Images are written in a format of `formats`.
    pub fn new(formats: FormatRegistry, reporter: Reporter) -> Self {
        Self { formats, reporter, in_memory: IN_MEMORY, entries: Mutex::default(), saves: AtomicU64::new(0) }
    }

    /// Sets the largest number of floats that are kept in memory per database during a frame.
    pub fn with_memory(self, numbers: usize) -> Self {
        Self { in_memory: numbers, ..self }
    }

    /// Returns the mode of an option's word for a database. An invalid word is reported once and treated as empty.
    pub fn mode(&self, attributes: &Attributes, name: &str, word: &str) -> Mode {
        let option = Mode::from_word(word).unwrap_or_else(|| {
            let text = format!("spatial database \"{name}\": no file mode \"{word}\" (r, w, rw, ro, wo)");
            self.tell(name, Severity::Error, text);
            Mode::default()
        });
        attributes.mode(name, option)
    }

    /// Returns the database of this name, which is empty when it is new.
    fn entry(&self, name: &str) -> Arc<Mutex<Entry>> {
        let mut entries = self.entries.lock();
        match entries.get(name) {
            Some(entry) => entry.clone(),
            None => entries.entry(name.to_owned()).or_default().clone(),
        }
    }

    fn tell(&self, name: &str, severity: Severity, text: String) {
        let cause = format!("spatial database {name}: {text}");
        self.reporter.once(&cause, severity, &Location::default(), text);
    }

    /// Adds records: the numbers of the key and the value, one record after another. Records that are not finite are
    /// left out and reported after the frame. Records of a schema other than the first are refused and reported once.
    pub fn save(
        &self,
        name: &str,
        schema: Schema,
        mode: Mode,
        options: Option<&ImageOptions>,
        records: &[f32],
    ) {
        self.saves.fetch_add(1, Ordering::Relaxed);
        let (finite, broken) = finite(records, schema.numbers());
        let entry = self.entry(name);
        let mut entry = entry.lock();
        entry.write |= mode.write;
        entry.adds |= mode.write && mode.read;
        if let Some(options) = options {
            entry.image = options.clone();
        }
        let is_lost = entry.lost.is_some();
        let spool = entry.saved.get_or_insert_with(|| {
            // Only records for a file may be stored in a temporary file.
            let most = if mode.write { self.in_memory } else { usize::MAX };
            Spool::new(schema, most, name.into(), self.formats.files().clone())
        });
        if spool.schema() != schema {
            let text = format!(
                "spatial database \"{name}\" holds {}: {} is not added",
                spool.schema().words(),
                schema.words()
            );
            drop(entry);
            self.tell(name, Severity::Error, text);
            return;
        }
        if is_lost {
            return;
        }
        let pushed = spool.push(&finite);
        entry.broken += broken;
        if let Err(source) = pushed {
            entry.lost = Some(source.kind());
            let error = SdbError::Io { path: name.into(), source };
            drop(entry);
            self.tell(name, Severity::Error, format!("records cannot be kept: {error}"));
        }
    }

    /// Returns the records of a database that queries see; `None` when there are none. Its file is searched for along
    /// `search`, once per frame.
    pub fn records(&self, name: &str, mode: Mode, search: &SearchPath) -> Option<Arc<Packed>> {
        let entry = self.entry(name);
        let mut entry = entry.lock();
        if !mode.read {
            return entry.memory.clone();
        }
        if entry.file.is_none() {
            entry.file = Some(self.load(name, mode.write, search));
        }
        entry.file.clone().flatten().or_else(|| entry.memory.clone())
    }

    fn load(&self, name: &str, may_lack: bool, search: &SearchPath) -> Option<Arc<Packed>> {
        let Some(path) = search.find(name) else {
            // A file that the frame writes need not exist before the first frame.
            if !may_lack {
                self.tell(name, Severity::Warning, format!("spatial database \"{name}\" not found"));
            }
            return None;
        };
        self.reporter.file_read(&path);
        match read_with(&path, search.files()) {
            Ok(packed) => Some(Arc::new(packed)),
            Err(error) => {
                self.tell(name, Severity::Error, format!("spatial database \"{name}\" is not used: {error}"));
                None
            }
        }
    }

    /// The number of calls of `save` so far, from which callers see whether records were saved.
    pub fn saves(&self) -> u64 {
        self.saves.load(Ordering::Relaxed)
    }

    /// True when queries may see records of earlier frames that were not read from a file. Other processes do not
    /// have these.
    pub fn hold_memory(&self) -> bool {
        self.entries.lock().values().any(|entry| entry.lock().memory.is_some())
    }

    /// Begins a frame. Records of a frame that did not finish are dropped.
    pub fn begin(&self) {
        for entry in self.entries.lock().values() {
            let mut entry = entry.lock();
            (entry.saved, entry.broken, entry.lost, entry.file) = (None, 0, None, None);
        }
    }

    /// Finishes a frame. It writes the files and makes the saved records visible. Files to which "rw" adds are
    /// searched for along `search`.
    ///
    /// # Errors
    /// The errors of each database that could not be written, or of which records were lost. The others are written,
    /// and the previous files stay unchanged.
    pub fn finish(&self, search: &SearchPath) -> std::result::Result<Finished, Vec<SdbError>> {
        let mut finished = Finished::default();
        let mut errors = Vec::new();
        for (name, entry) in &*self.entries.lock() {
            let entry = &mut *entry.lock();
            if entry.broken > 0 {
                let count = std::mem::take(&mut entry.broken);
                let text =
                    format!("spatial database \"{name}\": {count} records are not finite and left out");
                self.tell(name, Severity::Warning, text);
            }
            let Some(saved) = entry.saved.take() else {
                // Another frame may find another file.
                entry.file = None;
                continue;
            };
            match self.finish_one(name, entry, saved, search) {
                Ok(Some((path, records))) => {
                    finished.written.push(path);
                    finished.records += records;
                }
                Ok(None) => {}
                Err(error) => errors.push(error),
            }
        }
        if errors.is_empty() { Ok(finished) } else { Err(errors) }
    }

    fn finish_one(
        &self,
        name: &str,
        entry: &mut Entry,
        mut saved: Spool,
        search: &SearchPath,
    ) -> Result<Option<(PathBuf, u64)>> {
        let io = |source| SdbError::Io { path: name.into(), source };
        let schema = saved.schema();
        if let Some(why) = entry.lost.take() {
            (entry.write, entry.adds) = (false, false);
            return Err(io(std::io::Error::new(why, format!("records are missing: {why}"))));
        }
        if !std::mem::take(&mut entry.write) {
            let mut records = saved.take().map_err(io)?;
            if let Some(old) = entry.memory.take().filter(|old| old.schema() == schema) {
                records.extend_from_slice(old.records());
            }
            entry.memory = Some(Arc::new(Packed::new(schema, &records)));
            return Ok(None);
        }
        let old = entry.file.take();
        if std::mem::take(&mut entry.adds) {
            let old = old.unwrap_or_else(|| self.load(name, true, search));
            if let Some(old) = old.filter(|old| old.schema() == schema) {
                saved.push(old.records()).map_err(io)?;
            }
        }
        entry.memory = None;
        let path = PathBuf::from(name);
        let count = saved.len();
        match self.image_format(&path) {
            Some(format) if schema.key == Key::Surface => {
                let packed = Packed::new(schema, &saved.take().map_err(io)?);
                write_image(&path, &*format, self.formats.files(), &packed, &entry.image)?;
            }
            Some(_) => {
                let what = format!("{} cannot be written as an image: only (s, t) can", schema.words());
                return Err(SdbError::Misuse { name: name.to_owned(), what });
            }
            None => saved.write(&path, self.formats.files())?,
        }
        Ok(Some((path, count)))
    }

    /// Returns the image format of a name's extension.
    fn image_format(&self, path: &Path) -> Option<Arc<dyn Format>> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        let has = |f: &&Arc<dyn Format>| f.extensions().contains(&extension.as_str());
        self.formats.formats().iter().find(has).cloned()
    }
}

/// Returns the records of which all numbers are finite, and the number of the others.
fn finite(records: &[f32], numbers: usize) -> (Cow<'_, [f32]>, u64) {
    let is_finite = |record: &&[f32]| record.iter().all(|x| x.is_finite());
    let whole = records.chunks_exact(numbers);
    let broken = whole.clone().filter(|record| !is_finite(record)).count() as u64;
    match broken {
        0 => (records.into(), 0),
        _ => (whole.filter(is_finite).flatten().copied().collect(), broken),
    }
}

fn write_image(
    path: &Path,
    format: &dyn Format,
    files: &Files,
    packed: &Packed,
    options: &ImageOptions,
) -> Result<()> {
    let [width, height] = options.resolution.map(|n| n.clamp(1, LARGEST));
    let options = ImageOptions { resolution: [width, height], ..options.clone() };
    let wanted = match options.data_format.as_str() {
        "8" => PixelType::U8,
        "16" => PixelType::U16,
        "half" => PixelType::Half,
        _ => PixelType::Float,
    };
    let pixel_type = format.output_type(wanted);
    let spec = ImageSpec::new(width, height, packed.schema().value.numbers(), pixel_type);
    let mut file = format.create(path, &CreateOptions::new(&spec, 1).with_files(files))?;
    file.write_rows(&Pixels::from_floats(pixel_type, &image(packed, &options)))?;
    Ok(file.close()?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Value;

    #[test]
    fn databases_are_locked_independently() {
        let databases = Arc::new(Databases::new(FormatRegistry::default(), Reporter::silent()));
        let schema = Schema { key: Key::Point, value: Value::Float };
        let record = vec![0.5; schema.numbers()];
        // This simulates a thread that writes many records of "a" to a file.
        let a = databases.entry("a");
        let busy = a.lock();
        let (done, over) = std::sync::mpsc::channel();
        let (other, more) = (databases.clone(), record.clone());
        std::thread::spawn(move || {
            other.save("b", schema, Mode::default(), None, &more);
            done.send(other.records("b", Mode::default(), &SearchPath::default()).is_none()).unwrap();
        });
        assert!(over.recv_timeout(std::time::Duration::from_secs(20)).unwrap());
        drop(busy);
        databases.save("a", schema, Mode::default(), None, &record);
        databases.finish(&SearchPath::default()).unwrap();
        for name in ["a", "b"] {
            let records = databases.records(name, Mode::default(), &SearchPath::default()).unwrap();
            assert_eq!(records.records(), record);
        }
    }

    #[test]
    fn records_that_are_not_finite_are_counted() {
        let records = [1.0, 2.0, f32::NAN, 3.0, 4.0, 5.0, 6.0, f32::INFINITY, 7.0];
        let (kept, broken) = finite(&records, 2);
        assert_eq!((&*kept, broken), (&[1.0, 2.0, 4.0, 5.0][..], 2));
        assert!(matches!(finite(&records[..2], 2), (Cow::Borrowed(&[1.0, 2.0]), 0)));
    }
}
