//! Generators from plugins in `NAME.generator.so` (reference 12), and those of a program.

use crate::dso::{Dso, strings};
use crate::ffi::{self, ABI, GeneratorTable, Text};
use crate::interface::{Borrowed, GeneratorObject, Interface, InterfaceObject, c_string};
use crate::{ErrorManager, Messages};
use granita_base::{Files, Location, Reporter};
use granita_scene::{Generator, GeneratorError, GeneratorSource, SceneSink, Stop};
use std::ffi::c_void;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// The value of `GelatoAPI::API_VERSION`.
const VERSION: i32 = 2;

/// The source of a plugin's calls.
#[derive(Clone, Copy, Debug)]
enum Kind {
    /// The function `NAME_generator_create`.
    Cpp(*mut c_void),
    Table(&'static GeneratorTable),
}

// SAFETY: these are addresses of functions and of a table that never changes.
unsafe impl Send for Kind {}
// SAFETY: as above.
unsafe impl Sync for Kind {}

impl std::fmt::Debug for GeneratorTable {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "GeneratorTable({})", self.abi)
    }
}

/// A plugin's generator.
#[derive(Debug)]
pub(crate) struct PluginGenerator {
    name: &'static str,
    title: String,
    extensions: &'static [&'static str],
    kind: Kind,
}

impl PluginGenerator {
    /// Returns the generator of a library.
    ///
    /// # Errors
    /// Returns the reason why it is not a plugin of this interface.
    pub(crate) fn new(dso: &'static Dso) -> Result<Self, String> {
        let stem = &dso.stem;
        let kind = match (dso.int("generator_version"), dso.int("generator_abi")) {
            (Some(VERSION), _) => {
                let name = format!("{stem}_generator_create");
                Kind::Cpp(dso.symbol(&name).ok_or_else(|| format!("it has no symbol {name}"))?)
            }
            (_, Some(ABI)) => {
                let name = format!("{stem}_generator_c");
                let address = dso.symbol(&name).ok_or_else(|| format!("it has no symbol {name}"))?;
                // SAFETY: the symbol is a function of this form, by the interface whose version the plugin declares.
                let get: extern "C" fn() -> *const GeneratorTable = unsafe { std::mem::transmute(address) };
                // SAFETY: tables of the interface are static, or NULL.
                let table = unsafe { get().as_ref() }.filter(|t| t.abi == ABI && t.run.is_some());
                Kind::Table(table.ok_or_else(|| format!("{name} does not return a table of version {ABI}"))?)
            }
            (Some(other), _) => {
                return Err(format!("its generator_version is {other}, and this suite takes {VERSION}"));
            }
            (None, Some(other)) => {
                return Err(format!("its generator_abi is {other}, and this suite takes {ABI}"));
            }
            (None, None) => return Err("it has no symbol generator_version".to_owned()),
        };
        let extensions = dso.extensions(|| {
            let mut list = vec![stem.to_ascii_lowercase()];
            if let Kind::Table(table) = kind {
                // SAFETY: it is an array that ends with NULL, by the interface.
                list.extend(unsafe { strings(table.extensions) });
            }
            list
        });
        let title = format!("plugin {}", dso.path.display());
        Ok(Self { name: &dso.stem, title, extensions, kind })
    }

    /// Returns the C++ object for a command.
    fn object(&self, factory: *mut c_void, params: &str) -> Result<GeneratorObject, String> {
        let command = c_string(&format!("{} {params}", self.name));
        let mut why = Text::new();
        // SAFETY: it is the plugin's factory, of the form that its version declares.
        let made = unsafe { ffi::gelato_shim_generator_create(factory, command.as_ptr(), why.room()) };
        if made.is_null() {
            return Err(match why.get() {
                Some(text) => format!("its create function threw an exception: {text}"),
                None => "its create function gave no Generator (NULL)".to_owned(),
            });
        }
        Ok(GeneratorObject(made))
    }
}

/// The parameter of a generator. It is the name of a file, or of one that holds the bytes and lives as long as this.
enum Params {
    Text(String),
    File(tempfile::TempPath),
    /// A file without a name, and the path by which this process and its children find it. No file is left when the
    /// process is killed.
    #[cfg(target_os = "linux")]
    Unnamed(#[expect(dead_code, reason = "the file lives as long as it is open")] std::fs::File, String),
}

impl Params {
    fn of(source: &GeneratorSource) -> std::io::Result<Self> {
        match source {
            GeneratorSource::File { path, files } => Ok(Self::Text(placed(path, files))),
            GeneratorSource::Bytes { bytes, files, .. } => {
                let folder = files.temporary_folder();
                #[cfg(target_os = "linux")]
                {
                    use std::os::fd::AsRawFd;
                    let mut file = tempfile::tempfile_in(&folder)?;
                    file.write_all(bytes)?;
                    let name = format!("/proc/{}/fd/{}", std::process::id(), file.as_raw_fd());
                    // Where that folder does not exist, the file needs a name.
                    if std::fs::File::open(&name).is_ok() {
                        return Ok(Self::Unnamed(file, name));
                    }
                }
                let mut file = tempfile::NamedTempFile::new_in(&folder)?;
                file.write_all(bytes)?;
                file.flush()?;
                Ok(Self::File(file.into_temp_path()))
            }
        }
    }

    fn text(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::File(path) => path.to_string_lossy().into_owned(),
            #[cfg(target_os = "linux")]
            Self::Unnamed(_, name) => name.clone(),
        }
    }
}

/// Returns the parameter of a generator that reads a file, which opens the file by itself.
fn placed(path: &Path, files: &Files) -> String {
    files.place(path).to_string_lossy().into_owned()
}

/// Runs `f` with an interface whose calls go to `sink`.
fn through<T>(
    sink: &mut dyn SceneSink,
    reporter: &Reporter,
    name: &str,
    f: impl FnOnce(&InterfaceObject<'_>) -> Result<T, String>,
) -> Result<T, GeneratorError> {
    let errors = Messages::Own(Arc::new(ErrorManager::over(reporter.clone())));
    let at = Location { file: name.into(), ..Location::default() };
    let interface = Interface::new(Box::new(Borrowed(sink)), Box::new(()), errors, at);
    let object = InterfaceObject::new(interface, None);
    let result = f(&object).map_err(GeneratorError::Malformed);
    if object.into_inner().stopped() {
        return Err(GeneratorError::Stopped(Stop::Exit));
    }
    result
}

impl Generator for PluginGenerator {
    fn name(&self) -> &'static str {
        self.name
    }

    fn extensions(&self) -> &'static [&'static str] {
        self.extensions
    }

    fn makes_frames(&self) -> bool {
        // A plugin may make frames.
        true
    }

    fn bound(&self, source: &GeneratorSource) -> Option<[f32; 6]> {
        let params = match source {
            GeneratorSource::File { path, files } => placed(path, files),
            GeneratorSource::Bytes { .. } => return None,
        };
        match self.kind {
            Kind::Cpp(factory) => self.object(factory, &params).ok()?.bound().ok()?,
            Kind::Table(table) => {
                let (params, mut bound) = (c_string(&params), [0.0f32; 6]);
                // SAFETY: it is the plugin's own function, called with a string and room for six floats.
                let known = unsafe { table.bound?(params.as_ptr(), bound.as_mut_ptr()) };
                (known != 0).then_some(bound)
            }
        }
    }

    fn run(
        &self,
        source: &GeneratorSource,
        sink: &mut dyn SceneSink,
        reporter: &Reporter,
    ) -> Result<(), GeneratorError> {
        let name = source.name();
        let params =
            Params::of(source).map_err(|source| GeneratorError::Io { name: name.clone(), source })?;
        through(sink, reporter, &name, |object| {
            match self.kind {
                Kind::Cpp(factory) => {
                    let generator = self.object(factory, &params.text())?;
                    object.run_generator(&generator, &params.text())
                }
                Kind::Table(table) => match table.run {
                    Some(run) => object.run_table(run, &params.text()),
                    None => Ok(()),
                },
            }
            .map_err(|what| what.to_string())
        })
        .map_err(|error| match error {
            GeneratorError::Malformed(what) => {
                GeneratorError::Malformed(format!("{name}: {}: {what}", self.title))
            }
            other => other,
        })
    }
}

/// A generator that a program passed to `Input`, kept until it is needed.
pub(crate) struct ProgramGenerator {
    object: GeneratorObject,
}

impl ProgramGenerator {
    pub(crate) fn new(object: GeneratorObject) -> Self {
        Self { object }
    }
}

impl Generator for ProgramGenerator {
    fn name(&self) -> &'static str {
        "program"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &[]
    }

    fn run(
        &self,
        source: &GeneratorSource,
        sink: &mut dyn SceneSink,
        reporter: &Reporter,
    ) -> Result<(), GeneratorError> {
        through(sink, reporter, &source.name(), |object| object.run_generator(&self.object, "")).map_err(
            |error| match error {
                GeneratorError::Malformed(what) => {
                    GeneratorError::Malformed(format!("the program's generator: {what}"))
                }
                other => other,
            },
        )
    }
}
