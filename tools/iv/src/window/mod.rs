//! The window.
//!
//! [`model::Model`] holds what is shown and how, and draws it. The whole image is one bitmap of the size of the window,
//! which needs no graphics hardware. [`app::App`] connects the model to the screen.

mod app;
mod blit;
mod desk;
mod entries;
mod keys;
mod latency;
mod lighting;
mod lost;
mod model;
mod panels;
mod script;
mod steps;
mod tasks;
mod update;

use crate::args::Args;
use crate::listen::Wanted;
use app::App;
use blit::Blit;
use eframe::egui;
use eframe::egui_wgpu::{WgpuSetup, WgpuSetupExisting};
use granita_base::Reporter;
use granita_cli::Status;
use granita_image::FormatRegistry;
use granita_view::{Live, StoreLimits, TileStore, Viewing, expand};
use model::Model;
use parking_lot::Mutex;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::time::Instant;

/// The exit status of the window, which is that of its script.
type Outcome = Arc<Mutex<Status>>;

/// Returns the graphics libraries to try, in order, with their names.
fn renderers(name: &str) -> &'static [(&'static str, wgpu::Backends)] {
    const VULKAN: (&str, wgpu::Backends) = ("vulkan", wgpu::Backends::PRIMARY);
    const GL: (&str, wgpu::Backends) = ("gl", wgpu::Backends::GL);
    match name {
        "vulkan" => &[VULKAN],
        "gl" => &[GL],
        _ => &[VULKAN, GL],
    }
}

/// Returns the result of a future that never waits; `None` when it would wait.
fn ready<T>(future: impl Future<Output = T>) -> Option<T> {
    let mut context = std::task::Context::from_waker(std::task::Waker::noop());
    match std::pin::pin!(future).poll(&mut context) {
        std::task::Poll::Ready(value) => Some(value),
        std::task::Poll::Pending => None,
    }
}

/// Returns the device that is most likely the right one, without a window; `None` where there is none or only a window
/// can find one.
fn early_device(setup: &WgpuSetup) -> Option<WgpuSetupExisting> {
    let WgpuSetup::CreateNew(new) = setup else { return None };
    if new.instance_descriptor.backends.contains(wgpu::Backends::GL) {
        return None;
    }
    let instance = ready(setup.new_instance())?;
    let adapter = ready(instance.request_adapter(&wgpu::RequestAdapterOptions {
        power_preference: new.power_preference,
        ..wgpu::RequestAdapterOptions::default()
    }))?
    .ok()?;
    let (device, queue) = ready(adapter.request_device(&(new.device_descriptor)(&adapter)))?.ok()?;
    Some(WgpuSetupExisting { instance, adapter, device, queue })
}

/// Returns the size of the window, in points.
fn size(args: &Args) -> (f32, f32) {
    match args.window.window[..] {
        [w, h] => (w as f32, h as f32),
        _ => (1280.0, 800.0),
    }
}

/// Returns a context as the window would make it, with several passes and with viewports as windows of the system.
fn context() -> egui::Context {
    let context = egui::Context::default();
    context.set_embed_viewports(false);
    context.options_mut(|o| o.max_passes = std::num::NonZeroUsize::MIN.saturating_add(1));
    context
}

fn native_options(args: &Args, backends: wgpu::Backends) -> eframe::NativeOptions {
    let (width, height) = size(args);
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

/// Opens the window and waits until it is closed. `live` holds the images that may arrive. `wanted` receives the
/// requests of clients to open files.
pub(crate) fn run(
    args: &Args,
    viewing: Option<Viewing>,
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
    let renderers = renderers(&args.window.renderer);
    // Drivers are slow to start. Meanwhile the first image is opened and its tiles are requested.
    let early = {
        let setup = native_options(args, renderers[0].1).wgpu_options.wgpu_setup;
        std::thread::spawn(move || early_device(&setup))
    };
    let ctx = context();
    let mut model = Some({
        let limits = StoreLimits { others: args.window.memory << 20, ..StoreLimits::default() };
        let ctx = ctx.clone();
        let wake = move || ctx.request_repaint();
        let files = expand(&args.files, formats);
        let store = TileStore::new(limits);
        let mut model = Model::new(formats.clone(), files, live.clone(), display, store, wake);
        model.wanted = Some(wanted);
        model.entries.see_through(viewing);
        let (width, height) = size(args);
        model.foresee(width as u32, (height - panels::STATUS).max(1.0) as u32);
        model
    });
    // When the thread of a device panicked, the device is not usable.
    let early = early.join().ok().flatten().map(WgpuSetup::Existing);
    let tries = early.map(|setup| (renderers[0], Some(setup)));
    lost::watch(reporter);
    for ((library, backends), setup) in tries.into_iter().chain(renderers.iter().map(|b| (*b, None))) {
        let (taken, steps, outcome_inside) = (&mut model, steps.clone(), outcome.clone());
        let creator: eframe::AppCreator<'_> = Box::new(move |context| {
            let model = taken.take().ok_or("the window was closed")?;
            let blit = context.wgpu_render_state.as_ref().and_then(Blit::new);
            Ok(Box::new(App::new(model, steps, outcome_inside, started, blit, &context.egui_ctx)))
        });
        let mut options = native_options(args, backends);
        if let Some(setup) = setup {
            options.wgpu_options.wgpu_setup = setup;
        }
        match eframe::run_native_ext("iv", options, Some(ctx.clone()), creator) {
            Ok(()) => return *outcome.lock(),
            // There was a window, because the model was moved into it.
            Err(_) if model.is_none() && !lost::is_there() => {
                lost::say(reporter);
                return Status::Failed;
            }
            // Without a screen no library can draw.
            Err(eframe::Error::Winit(_) | eframe::Error::WinitEventLoop(_)) => {
                faults = vec!["no connection to a screen (is DISPLAY or WAYLAND_DISPLAY set?)".to_owned()];
                break;
            }
            Err(eframe::Error::Wgpu(_)) => {
                faults.push(format!("{library}: no driver can draw in a window here"));
            }
            Err(error) => faults.push(format!("{library}: {error}")),
        }
        if model.is_none() {
            break;
        }
    }
    reporter.error(format!("the window cannot be opened: {}", faults.join("; ")));
    Status::Failed
}
