//! The window.
//!
//! [`desk::Desk`] knows what is looked at and how, and draws it (the whole picture is one bitmap of the size of the window,
//! which needs no graphics hardware); [`shell::Shell`] is between it and the screen.

mod desk;
mod entries;
mod keys;
mod panels;
mod script;
mod shell;
mod tasks;

use crate::args::Args;
use crate::listen::Wanted;
use desk::Desk;
use eframe::egui;
use granita_base::Reporter;
use granita_cli::Status;
use granita_image::FormatRegistry;
use granita_view::{Live, StoreLimits, TileStore, expand};
use shell::Shell;
use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// How the window ended: what its script found.
type Outcome = Arc<Mutex<Status>>;

/// The graphics libraries to try, in order.
fn renderers(name: &str) -> &'static [wgpu::Backends] {
    const VULKAN: wgpu::Backends = wgpu::Backends::PRIMARY;
    const GL: wgpu::Backends = wgpu::Backends::GL;
    match name {
        "vulkan" => &[VULKAN],
        "gl" => &[GL],
        _ => &[VULKAN, GL],
    }
}

fn native_options(args: &Args, backends: wgpu::Backends) -> eframe::NativeOptions {
    let (width, height) = match args.window.window[..] {
        [w, h] => (w as f32, h as f32),
        _ => (1280.0, 800.0),
    };
    let viewport = egui::ViewportBuilder::default()
        .with_title("iv")
        .with_app_id("granita-iv")
        .with_inner_size([width, height])
        .with_min_inner_size([64.0, 64.0])
        .with_fullscreen(args.window.fullscreen);
    let mut options = eframe::NativeOptions { viewport, dithering: false, ..Default::default() };
    if let eframe::egui_wgpu::WgpuSetup::CreateNew(setup) = &mut options.wgpu_options.wgpu_setup {
        setup.instance_descriptor.backends = backends;
    }
    options
}

/// Opens the window and waits until it is closed. `live` are pictures that may arrive.
///
/// `wanted` are files that those who send pictures want to be opened.
pub(crate) fn run(
    args: &Args,
    live: &Live,
    wanted: Receiver<Wanted>,
    formats: &FormatRegistry,
    reporter: &Reporter,
) -> Status {
    let started = Instant::now();
    let wanted = Arc::new(Mutex::new(wanted));
    let steps = match args.window.script.as_deref().map(script::read).transpose() {
        Ok(steps) => steps,
        Err(what) => {
            reporter.error(what);
            return Status::Failed;
        }
    };
    let display = match args.look.display(&[]) {
        Ok(display) => display,
        Err(what) => {
            reporter.error(what);
            return Status::Failed;
        }
    };
    let outcome: Outcome = Arc::new(Mutex::new(Status::Done));
    let mut faults = Vec::new();
    for backends in renderers(&args.window.renderer) {
        let files = expand(&args.files, formats);
        let (formats, live, outcome_inside) = (formats.clone(), live.clone(), outcome.clone());
        let (steps, wanted) = (steps.clone(), wanted.clone());
        let memory = args.window.memory;
        let creator: eframe::AppCreator<'_> = Box::new(move |context| {
            let limits = StoreLimits { others: memory << 20, ..StoreLimits::default() };
            let store = TileStore::new(limits);
            let ctx = context.egui_ctx.clone();
            let wake = move || ctx.request_repaint();
            let mut desk = Desk::new(formats, files, live, display, store, wake);
            desk.wanted = Some(wanted);
            Ok(Box::new(Shell::new(desk, steps, outcome_inside, started, &context.egui_ctx)))
        });
        match eframe::run_native("iv", native_options(args, *backends), creator) {
            Ok(()) => return *outcome.lock().unwrap_or_else(PoisonError::into_inner),
            Err(error) => faults.push(error.to_string()),
        }
    }
    reporter.error(format!("there can be no window: {}", faults.join("; ")));
    Status::Failed
}
