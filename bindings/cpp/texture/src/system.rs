//! A system: a cache of textures, the handles of names, and messages.

use crate::failure::Failure;
use crate::info::Described;
use crate::types::Settings;
use granita_base::report::Message;
use granita_base::{Reporter, SearchPath, Severity};
use granita_image::Limits;
use granita_plugin::{PluginRules, Plugins, bundled_formats};
use granita_texture::{CacheOptions, TextureCache, TextureId};
use parking_lot::{Mutex, RwLock};
use std::collections::{HashMap, VecDeque};
use std::ffi::c_int;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The default bound of the memory of tiles, in bytes.
const MEMORY: u64 = 256 << 20;

/// The default number of open files.
const FILES: usize = 1000;

/// The number of messages that are kept. Older ones are dropped.
const MOST_MESSAGES: usize = 1000;

/// The type `granita_texture_system`.
pub struct System {
    /// Lookups share it. It is changed only to forget files.
    cache: RwLock<TextureCache>,
    threads: AtomicUsize,
    handles: RwLock<Handles>,
    messages: Arc<Mutex<VecDeque<String>>>,
    /// The data of textures by their handles, as they are returned to callers.
    described: Mutex<HashMap<u32, Arc<Described>>>,
    /// Data of files that have changed. Callers may still have pointers to them.
    old: Mutex<Vec<Arc<Described>>>,
}

/// The names of textures. The handle of a name is its index plus 1.
#[derive(Default)]
struct Handles {
    names: Vec<Arc<str>>,
    of: HashMap<Arc<str>, u32>,
}

/// Returns the folders and files of a path that a caller passed.
fn parse(path: &str) -> SearchPath {
    SearchPath::parse(&path.replace(';', ":"), &SearchPath::default(), &std::env::vars_os().collect())
}

/// Returns the number of threads that a caller means.
fn threads(n: c_int) -> Result<usize, Failure> {
    match n {
        0 => Ok(1),
        -1 => Ok(std::thread::available_parallelism().map_or(1, usize::from)),
        _ => usize::try_from(n).map_err(|_| {
            Failure::Misuse(format!("{n} threads, where -1 (all processors), 0 (one) or more are possible"))
        }),
    }
}

impl System {
    /// Returns a system without textures.
    pub(crate) fn new(
        settings: &Settings,
        search: Option<&str>,
        plugins: Option<&str>,
    ) -> Result<Self, Failure> {
        let threads = threads(settings.threads)?;
        let max_files = match usize::try_from(settings.files) {
            Ok(0) => FILES,
            Ok(n) => n,
            Err(_) => {
                return Err(Failure::Misuse(format!(
                    "{} open files, where 1 or more are possible",
                    settings.files
                )));
            }
        };
        let options = CacheOptions {
            memory_bytes: if settings.memory == 0 { MEMORY } else { settings.memory },
            max_files,
            automipmap: settings.no_automipmap == 0,
            ..CacheOptions::default()
        };
        let messages = Arc::new(Mutex::new(VecDeque::new()));
        let kept = messages.clone();
        let reporter = Reporter::new(Box::new(move |message: &Message| {
            let word = if message.severity >= Severity::Error { "error" } else { "warning" };
            let line = message.text.trim_end().replace('\n', " ");
            let mut kept = kept.lock();
            if kept.len() == MOST_MESSAGES {
                kept.pop_front();
            }
            kept.push_back(format!("{word}: {line}"));
        }));
        let mut formats = bundled_formats(Limits::default());
        if let Some(path) = plugins.filter(|path| !path.is_empty()) {
            let rules = PluginRules { named: parse(path).folders().to_vec(), ..PluginRules::default() };
            formats.find_with(Arc::new(Plugins::new(reporter.clone(), rules)));
        }
        let search = parse(search.filter(|path| !path.is_empty()).unwrap_or("."));
        Ok(Self {
            cache: RwLock::new(TextureCache::new(formats, search, options, reporter)),
            threads: AtomicUsize::new(threads),
            handles: RwLock::default(),
            messages,
            described: Mutex::default(),
            old: Mutex::default(),
        })
    }

    /// Returns the system of a caller.
    ///
    /// # Safety
    /// `system` must be NULL or a system that exists while the result is used.
    pub(crate) unsafe fn of<'a>(system: *const Self) -> Result<&'a Self, Failure> {
        // SAFETY: it is a system or NULL, by the contract.
        unsafe { system.as_ref() }
            .ok_or_else(|| Failure::Misuse("there is no texture system (NULL)".to_owned()))
    }

    pub(crate) fn set_threads(&self, n: c_int) -> Result<(), Failure> {
        self.threads.store(threads(n)?, Ordering::Relaxed);
        Ok(())
    }

    /// Returns the number of threads of one call with many points.
    pub(crate) fn threads(&self) -> usize {
        self.threads.load(Ordering::Relaxed)
    }

    /// Returns the messages since the last call, one a line.
    pub(crate) fn take_messages(&self) -> Option<String> {
        let lines = std::mem::take(&mut *self.messages.lock());
        (!lines.is_empty()).then(|| lines.into_iter().collect::<Vec<_>>().join("\n"))
    }

    /// Returns the handle of a texture that can be used.
    pub(crate) fn open(&self, name: &str) -> Result<u32, Failure> {
        self.cache.read().try_find(name).map_err(Failure::Unusable)?;
        if let Some(handle) = self.handles.read().of.get(name) {
            return Ok(*handle);
        }
        let mut handles = self.handles.write();
        if let Some(handle) = handles.of.get(name) {
            return Ok(*handle);
        }
        let name: Arc<str> = name.into();
        handles.names.push(name.clone());
        let handle = u32::try_from(handles.names.len())
            .map_err(|_| Failure::Misuse("there are too many textures".to_owned()))?;
        handles.of.insert(name, handle);
        Ok(handle)
    }

    /// Returns the name of a handle.
    fn name(&self, handle: u32) -> Result<Arc<str>, Failure> {
        let at = (handle as usize).checked_sub(1);
        let name = at.and_then(|at| self.handles.read().names.get(at).cloned());
        name.ok_or_else(|| Failure::Misuse(format!("{handle} is not a texture of this system")))
    }

    /// Calls `f` with the cache and a texture of it.
    pub(crate) fn with<T>(
        &self,
        handle: u32,
        f: impl FnOnce(&TextureCache, TextureId) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let name = self.name(handle)?;
        let cache = self.cache.read();
        let id = cache.try_find(&name).map_err(Failure::Unusable)?;
        f(&cache, id)
    }

    /// Calls `f` with the cache.
    pub(crate) fn with_cache<T>(&self, f: impl FnOnce(&TextureCache) -> T) -> T {
        f(&self.cache.read())
    }

    /// Returns the data of a texture, which live as long as the system.
    pub(crate) fn described(&self, handle: u32) -> Result<Arc<Described>, Failure> {
        // While the cache is read, no data can be those of an older file.
        self.with(handle, |cache, id| {
            if let Some(known) = self.described.lock().get(&handle) {
                return Ok(known.clone());
            }
            let made = Arc::new(Described::read(cache, id).map_err(Failure::Unusable)?);
            Ok(self.described.lock().entry(handle).or_insert(made).clone())
        })
    }

    /// Forgets a texture, or all of them, once the lookups that run are done.
    pub(crate) fn invalidate(&self, name: Option<&str>) {
        let mut cache = self.cache.write();
        match name {
            Some(name) => cache.invalidate(name),
            None => cache.invalidate_all(),
        }
        let mut described = self.described.lock();
        let gone: Vec<u32> = match name {
            Some(name) => self.handles.read().of.get(name).copied().into_iter().collect(),
            None => {
                let mut all: Vec<u32> = described.keys().copied().collect();
                all.sort_unstable();
                all
            }
        };
        self.old.lock().extend(gone.iter().filter_map(|handle| described.remove(handle)));
    }
}
