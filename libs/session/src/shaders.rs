//! Finds and compiles shaders.

use granita_base::{Location, Reporter, SearchPath};
use granita_gsl::{CompileOptions, Diagnostic, ValidModule, compile};
use granita_plugin::{NativeShaders, Plugins};
use granita_render::{NoShader, ShaderLibrary};
use granita_shade::{NativeCompiler, Shadeop};
use granita_trace::Accelerator;
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A C++ function, or the reason why it is not available.
type FoundShadeop = Result<Arc<dyn Shadeop>, String>;

/// The shaders of one frame. Compiled ones on the path come first, then sources on the path, then the bundled ones.
pub(crate) struct Shaders {
    path: SearchPath,
    plugins: Plugins,
    reporter: Reporter,
    shadeops: Mutex<BTreeMap<String, FoundShadeop>>,
    known: Mutex<BTreeMap<String, Result<ValidModule, NoShader>>>,
    native: Option<Arc<NativeShaders>>,
    accelerator: Option<Arc<dyn Accelerator>>,
}

impl Shaders {
    /// Returns the shaders in the folders of `path`.
    pub(crate) fn new(path: SearchPath, plugins: Plugins, reporter: Reporter) -> Self {
        Self {
            path,
            plugins,
            reporter,
            shadeops: Mutex::default(),
            known: Mutex::default(),
            native: None,
            accelerator: None,
        }
    }

    /// Sets the compiler for code through which many points run.
    pub(crate) fn with_native(self, native: Option<Arc<NativeShaders>>) -> Self {
        Self { native, ..self }
    }

    /// Sets the processor that traces large batches of rays.
    pub(crate) fn with_accelerator(self, accelerator: Option<Arc<dyn Accelerator>>) -> Self {
        Self { accelerator, ..self }
    }

    fn find(&self, name: &str) -> Result<ValidModule, NoShader> {
        // A name may carry the extension of either form.
        let name = name.strip_suffix(".gso").or_else(|| name.strip_suffix(".gsl")).unwrap_or(name);
        if let Some(file) = self.path.find(&format!("{name}.gso")) {
            return self.compiled(&file);
        }
        if let Some(file) = self.path.find(&format!("{name}.gsl")) {
            self.reporter.file_read(&file);
            return match self.path.files().read_to_string(&file) {
                Ok(source) => self.source(&source, &file.to_string_lossy(), file.parent()),
                Err(error) => {
                    self.reporter.error(format!("{}: {error}", file.display()));
                    Err(NoShader::Broken)
                }
            };
        }
        if let Some(source) = granita_bundled::shader(name) {
            return self.source(source, &format!("{name}.gsl"), None);
        }
        let folders: Vec<String> = self.path.folders().iter().map(|f| f.display().to_string()).collect();
        Err(NoShader::Missing(format!("looked in {}, and among the bundled ones", folders.join(", "))))
    }

    fn compiled(&self, file: &Path) -> Result<ValidModule, NoShader> {
        self.reporter.info(format!("shader {}", file.display()));
        self.reporter.file_read(file);
        let bytes = match self.path.files().read(file) {
            Ok(bytes) => bytes,
            Err(error) => {
                self.reporter.error(format!("{}: {error}", file.display()));
                return Err(NoShader::Broken);
            }
        };
        match granita_gsl::gso::read(&bytes, &file.to_string_lossy()) {
            Ok(module) => Ok(module),
            Err(error) => {
                self.reporter.error(error.to_string());
                Err(NoShader::Broken)
            }
        }
    }

    fn source(&self, source: &str, file: &str, folder: Option<&Path>) -> Result<ValidModule, NoShader> {
        self.reporter.info(format!("compiling {file}"));
        let folders: Vec<String> = folder
            .into_iter()
            .map(Path::to_path_buf)
            .chain(self.path.folders().iter().cloned())
            .map(|f: PathBuf| f.to_string_lossy().into_owned())
            .collect();
        let load = |name: &str| match self.path.files().read_to_string(Path::new(name)) {
            Ok(text) => {
                self.reporter.file_read(Path::new(name));
                Ok(Some(text))
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                let base = Path::new(name).file_stem().and_then(|s| s.to_str()).unwrap_or(name);
                Ok(granita_bundled::shader(base).map(str::to_owned))
            }
            Err(error) => Err(error),
        };
        let shadeops = |name: &str| self.plugins.shadeop_forms(name, &self.path);
        let options = CompileOptions {
            include_paths: &folders,
            loader: Some(&load),
            shadeops: Some(&shadeops),
            ..CompileOptions::default()
        };
        match compile(source, file, &options) {
            Ok(compiled) => {
                compiled.warnings.iter().for_each(|warning| self.report(warning));
                Ok(compiled.module)
            }
            Err(diagnostics) => {
                diagnostics.iter().for_each(|diagnostic| self.report(diagnostic));
                Err(NoShader::Broken)
            }
        }
    }
}

impl Shaders {
    /// Reports a message of the compiler at its place in the source, with its severity.
    fn report(&self, diagnostic: &Diagnostic) {
        let severity = diagnostic.severity;
        let text = Diagnostic { at: Location::default(), ..diagnostic.clone() }.to_string();
        let text = text.strip_prefix(&format!("{severity}: ")).unwrap_or(&text).to_owned();
        self.reporter.say(severity, &diagnostic.at, text);
    }
}

impl ShaderLibrary for Shaders {
    fn load(&self, name: &str) -> Result<ValidModule, NoShader> {
        // The lock is held while the shader compiles, so that other threads wait instead of compiling it again.
        let mut known = self.known.lock();
        if let Some(module) = known.get(name) {
            return module.clone();
        }
        let module = self.find(name);
        known.insert(name.to_owned(), module.clone());
        module
    }

    fn shadeop(&self, text: &str) -> Result<Arc<dyn Shadeop>, String> {
        let mut known = self.shadeops.lock();
        if let Some(found) = known.get(text) {
            return found.clone();
        }
        let found = self.plugins.shadeop(text, &self.path);
        known.insert(text.to_owned(), found.clone());
        found
    }

    fn native(&self) -> Option<&dyn NativeCompiler> {
        self.native.as_deref().map(|native| native as &dyn NativeCompiler)
    }

    fn accelerator(&self) -> Option<Arc<dyn Accelerator>> {
        self.accelerator.clone()
    }
}
