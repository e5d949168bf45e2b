//! All databases of a session: which are read, which are written, and when.

use crate::error::{Result, SdbError};
use crate::file::{Spool, read_with};
use crate::picture::{LARGEST, PictureOptions, picture};
use crate::{Key, Packed, Schema};
use granita_base::{Files, Location, Reporter, SearchPath, Severity};
use granita_image::{CreateOptions, Format, FormatRegistry, ImageSpec, PixelType, Pixels};
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What may be done with a database's file: an option "filemode", or what the attributes say (reference 4.3.9, 5.8.13).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Mode {
    /// Queries see the file's records ("r", "rw", "ro").
    pub read: bool,
    /// The file is written after the frame ("w", "rw", "wo").
    pub write: bool,
    /// Queries always succeed ("ro").
    pub readonly: bool,
    /// What is saved is not seen by queries ("wo").
    pub writeonly: bool,
}

impl Mode {
    /// From the word of an option; the empty one is no mode. `None` for other words.
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

/// Names of the attributes "spatialdb:read" and so on.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Attributes {
    /// Databases that queries see the files of.
    pub read: Vec<String>,
    /// Databases that are written.
    pub write: Vec<String>,
    /// Databases whose queries always succeed.
    pub readonly: Vec<String>,
    /// Databases that are written and not asked.
    pub writeonly: Vec<String>,
}

impl Attributes {
    /// The mode of a database: that of the option when it gives one, or what the attributes say.
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

/// What [`Databases::finish`] did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Finished {
    /// Files written, in the order of their names.
    pub written: Vec<PathBuf>,
    /// Records in them.
    pub records: u64,
}

/// Numbers of records that are kept in memory for one database before they go to a file: 256 MiB of them.
const IN_MEMORY: usize = 64 << 20;

/// Databases by name.
///
/// Any number of threads save and ask at once. A query sees what was there **before the frame**: the file, when the mode
/// says to read it, or else the records of earlier frames of this session that were not written. What a frame saves is
/// seen from [`Databases::finish`] on. So answers do not depend on who came first.
#[derive(Debug)]
pub struct Databases {
    formats: FormatRegistry,
    reporter: Reporter,
    in_memory: usize,
    entries: Mutex<BTreeMap<String, Entry>>,
    saves: AtomicU64,
}

/// One database.
#[derive(Debug, Default)]
struct Entry {
    /// Of this frame.
    saved: Option<Spool>,
    write: bool,
    /// To what the file holds ("rw").
    adds: bool,
    picture: PictureOptions,
    /// Records that were left out because they are not finite.
    broken: u64,
    /// Why some of this frame are not kept.
    lost: Option<ErrorKind>,
    /// Of earlier frames.
    memory: Option<Arc<Packed>>,
    /// Looked for already; with what was found.
    file: Option<Option<Arc<Packed>>>,
}

fn lock(entries: &Mutex<BTreeMap<String, Entry>>) -> MutexGuard<'_, BTreeMap<String, Entry>> {
    entries.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Databases {
    /// None yet. Pictures are written in a format of `formats`.
    pub fn new(formats: FormatRegistry, reporter: Reporter) -> Self {
        Self { formats, reporter, in_memory: IN_MEMORY, entries: Mutex::default(), saves: AtomicU64::new(0) }
    }

    /// With another bound on the numbers kept in memory per database while a frame runs.
    pub fn with_memory(self, numbers: usize) -> Self {
        Self { in_memory: numbers, ..self }
    }

    /// The mode that an option's word means for a database; a word that is none is told once and taken as empty.
    pub fn mode(&self, attributes: &Attributes, name: &str, word: &str) -> Mode {
        let option = Mode::from_word(word).unwrap_or_else(|| {
            let text = format!("spatial database \"{name}\": no file mode \"{word}\" (r, w, rw, ro, wo)");
            self.tell(name, Severity::Error, text);
            Mode::default()
        });
        attributes.mode(name, option)
    }

    fn tell(&self, name: &str, severity: Severity, text: String) {
        let cause = format!("spatial database {name}: {text}");
        self.reporter.once(&cause, severity, &Location::default(), text);
    }

    /// Adds records: numbers of the key and the value, one record after another. Those that are not finite are left
    /// out, and told about after the frame. Records of another schema than the first are refused, once.
    pub fn save(
        &self,
        name: &str,
        schema: Schema,
        mode: Mode,
        options: Option<&PictureOptions>,
        records: &[f32],
    ) {
        self.saves.fetch_add(1, Ordering::Relaxed);
        let mut entries = lock(&self.entries);
        let entry = entries.entry(name.to_owned()).or_default();
        entry.write |= mode.write;
        entry.adds |= mode.write && mode.read;
        if let Some(options) = options {
            entry.picture = options.clone();
        }
        let spool = entry.saved.get_or_insert_with(|| {
            // Only what goes to a file can wait in one.
            let most = if mode.write { self.in_memory } else { usize::MAX };
            Spool::new(schema, most, name.into(), self.formats.files().clone())
        });
        if spool.schema() != schema {
            let text = format!(
                "spatial database \"{name}\" holds {}: {} is not added",
                spool.schema().words(),
                schema.words()
            );
            drop(entries);
            self.tell(name, Severity::Error, text);
            return;
        }
        if entry.lost.is_some() {
            return;
        }
        let mut pushed = Ok(());
        for record in records.chunks_exact(schema.numbers()) {
            if record.iter().all(|x| x.is_finite()) {
                pushed = pushed.and(spool.push(record));
            } else {
                entry.broken += 1;
            }
        }
        if let Err(source) = pushed {
            entry.lost = Some(source.kind());
            let error = SdbError::Io { path: name.into(), source };
            drop(entries);
            self.tell(name, Severity::Error, format!("records cannot be kept: {error}"));
        }
    }

    /// The records that queries of a database see; `None` when there are none. Its file is looked for along `search`,
    /// once a frame.
    pub fn records(&self, name: &str, mode: Mode, search: &SearchPath) -> Option<Arc<Packed>> {
        let mut entries = lock(&self.entries);
        let entry = entries.entry(name.to_owned()).or_default();
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
            // What a frame is to write need not be there before the first.
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

    /// How often something was saved so far: for who must know whether something was.
    pub fn saves(&self) -> u64 {
        self.saves.load(Ordering::Relaxed)
    }

    /// Whether queries may see what earlier frames saved without its being read from a file: no other process has that.
    pub fn hold_memory(&self) -> bool {
        lock(&self.entries).values().any(|entry| entry.memory.is_some())
    }

    /// Before a frame: forgets what one that came to no end saved.
    pub fn begin(&self) {
        for entry in lock(&self.entries).values_mut() {
            (entry.saved, entry.broken, entry.lost, entry.file) = (None, 0, None, None);
        }
    }

    /// After a frame: writes what is to be written, and makes what was saved visible. What "rw" adds to is looked for along
    /// `search`.
    ///
    /// # Errors
    /// Of each database that could not be written, or that records were lost of; the others are written all the same, and the
    /// files that were there before stay as they were.
    pub fn finish(&self, search: &SearchPath) -> std::result::Result<Finished, Vec<SdbError>> {
        let mut finished = Finished::default();
        let mut errors = Vec::new();
        let mut entries = lock(&self.entries);
        for (name, entry) in entries.iter_mut() {
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
        match self.picture_format(&path) {
            Some(format) if schema.key == Key::Surface => {
                let packed = Packed::new(schema, &saved.take().map_err(io)?);
                write_picture(&path, &*format, self.formats.files(), &packed, &entry.picture)?;
            }
            Some(_) => {
                let what = format!("{} cannot become a picture: only (s, t) can", schema.words());
                return Err(SdbError::Misuse { name: name.to_owned(), what });
            }
            None => saved.write(&path, self.formats.files())?,
        }
        Ok(Some((path, count)))
    }

    /// The picture format that a name's extension means.
    fn picture_format(&self, path: &Path) -> Option<Arc<dyn Format>> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        let has = |f: &&Arc<dyn Format>| f.extensions().contains(&extension.as_str());
        self.formats.formats().iter().find(has).cloned()
    }
}

fn write_picture(
    path: &Path,
    format: &dyn Format,
    files: &Files,
    packed: &Packed,
    options: &PictureOptions,
) -> Result<()> {
    let [width, height] = options.resolution.map(|n| n.clamp(1, LARGEST));
    let options = PictureOptions { resolution: [width, height], ..options.clone() };
    let wanted = match options.data_format.as_str() {
        "8" => PixelType::U8,
        "16" => PixelType::U16,
        "half" => PixelType::Half,
        _ => PixelType::Float,
    };
    let pixel_type = format.output_type(wanted);
    let spec = ImageSpec::new(width, height, packed.schema().value.numbers(), pixel_type);
    let mut file = format.create(path, &CreateOptions::new(&spec, 1).with_files(files))?;
    file.write_rows(&Pixels::from_floats(pixel_type, &picture(packed, &options)))?;
    Ok(file.close()?)
}
