//! The renderer that makes images in the calling thread.

use crate::object;
use granita_base::{BaseType, Environment, Location, Param, ParamType, Reporter};
use granita_inputs::{OwnTools, RunOptions};
use granita_plugin::{GeneratorObject, InterfaceHost, InterfaceObject, Meanwhile, Messages, Plugins};
use granita_render::Progress;
use granita_scene::{Call, SceneSink, Stop};
use granita_session::{Session, SessionOptions, SharedProgress};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The progress of a frame.
#[derive(Default)]
struct Done {
    total: AtomicU64,
    done: AtomicU64,
}

impl Progress for Done {
    fn begin(&self, _: &Path, total: u64) {
        self.done.store(0, Ordering::Relaxed);
        self.total.store(total, Ordering::Relaxed);
    }

    fn done(&self, steps: u64) {
        self.done.fetch_max(steps, Ordering::Relaxed);
    }

    fn end(&self) {}
}

/// Provides values and accepts commands while a frame is rendered.
struct During {
    progress: Arc<Done>,
    stop: Arc<AtomicBool>,
}

impl Meanwhile for During {
    fn command(&self, name: &str) -> bool {
        let ends = matches!(name, "return" | "exit");
        if ends {
            self.stop.store(true, Ordering::Relaxed);
        }
        ends
    }

    fn attribute(&self, name: &str) -> Option<Param> {
        if !granita_scene::attr::RENDER_PROGRESS.is_named(name) {
            return None;
        }
        let (done, total) =
            (self.progress.done.load(Ordering::Relaxed), self.progress.total.load(Ordering::Relaxed));
        let part = if total == 0 { 0.0 } else { (done as f32 / total as f32).min(0.999_999) };
        Some(Param { name: name.into(), ty: ParamType::of(BaseType::Float), data: part.into() })
    }
}

/// Returns the session of a program's renderer, and its progress.
fn session(reporter: &Reporter) -> (Session, During) {
    let environment: Environment = std::env::vars_os().collect();
    let tool = environment.get("GELATOHOME").map(|home| Path::new(home).join("bin/gelato"));
    let names = ["gelato", "maketx", "gslc", "gsoinfo", "topyg"];
    let run = RunOptions {
        plugins_from_current_folder: true,
        own_tools: tool
            .filter(|t| t.is_file())
            .map(|program| OwnTools { program, names: names.iter().map(|n| (*n).to_owned()).collect() }),
        environment,
        ..RunOptions::default()
    };
    let current_folder = std::env::current_dir().unwrap_or_default();
    let options = SessionOptions { run, current_folder, ..SessionOptions::default() };
    let progress = Arc::new(Done::default());
    let session = Session::new(options, reporter.clone(), SharedProgress(progress.clone()));
    let during = During { progress, stop: session.stop() };
    (session, during)
}

/// Passes calls to a session, and ends it when it is dropped.
struct Live(Option<Session>);

impl SceneSink for Live {
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
        match &mut self.0 {
            Some(session) => session.state().call(call, at),
            None => Ok(()),
        }
    }

    fn in_world(&self) -> bool {
        self.0.as_ref().is_some_and(|session| session.state_ref().in_world())
    }

    fn attribute(&self, declaration: &str) -> Option<Param> {
        self.0.as_ref()?.state_ref().attribute(declaration)
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        if let Some(session) = self.0.take() {
            session.finish();
        }
    }
}

/// Stores the generators of the program, and the addresses that it may name.
pub(crate) struct Host(pub(crate) Plugins);

impl InterfaceHost for Host {
    fn keep(&mut self, generator: GeneratorObject) -> Result<Arc<str>, GeneratorObject> {
        Ok(self.0.keep_generator(generator))
    }

    fn grant(&mut self, format: &str) {
        // SAFETY: the program itself passed the address of an ImageOutput to Output, as reference 13.7 allows, and
        // keeps it until its renderer is done.
        unsafe { self.0.grant(format) }
    }
}

/// Returns a renderer in the calling thread.
pub(crate) fn renderer(manager: &Messages) -> InterfaceObject<'static> {
    let (session, during) = session(manager.reporter());
    let host = Host(session.plugins().clone());
    object(Box::new(Live(Some(session))), Box::new(host), manager, Some(Arc::new(during)))
}
