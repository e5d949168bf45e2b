//! The application. It passes events to the model, and shows the image and the panels on the screen.

use super::Outcome;
use super::blit::Blit;
use super::desk::{Desk, Pointing};
use super::keys;
use super::latency::Latency;
use super::model::{Command, Model};
use super::script::{Running, Step};
use eframe::{egui, egui_wgpu};
use egui::{Color32, ColorImage, Event, Modifiers, PointerButton, Pos2, TextureHandle, TextureOptions, Vec2};
use granita_image::{PixelRect, Request};
use granita_view::{Mix, save_canvas, save_pixels};
use parking_lot::Mutex;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A drag that has begun.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Drag {
    Pan,
    Wipe,
    /// Selects the area that is measured, from this point of the window.
    Probe(Pos2),
    /// Selects the area that is rendered first, from this point of the window.
    Priority(Pos2),
    /// Moves or aims a light of the desk.
    Lamp(Pointing),
}

/// A file name that the user is entering.
#[derive(Clone, Debug)]
pub(crate) struct Prompt {
    pub(crate) text: String,
    pub(crate) pixels: bool,
}

pub(super) type Shot = Arc<Mutex<Option<Arc<ColorImage>>>>;

/// The application that the window system runs.
pub(crate) struct App {
    pub(crate) model: Model,
    texture: Option<TextureHandle>,
    /// Draws the image where the processor does the work of graphics hardware.
    blit: Option<Blit>,
    in_blit: bool,
    /// True when the last frame showed something everywhere, or the complete image, for the first time.
    just_shown: [bool; 2],
    /// The rectangle of the image in the window, in points.
    pub(crate) area: egui::Rect,
    pub(crate) pointer: Option<Pos2>,
    drag: Option<(Drag, Pos2)>,
    /// The point at which the button was pressed, and the modifiers.
    pressed: Option<(Pos2, Modifiers)>,
    last_click: Option<(Instant, Pos2)>,
    pub(crate) prompt: Option<Prompt>,
    /// The desk for lighting.
    pub(crate) desk: Desk,
    pub(super) full_screen: bool,
    pub(super) script: Option<Running>,
    pub(super) outcome: Outcome,
    pub(super) shot: Shot,
    pub(super) shown_title: String,
    /// The time of the input of this frame, and what the desk does with its edits.
    pub(super) input: Instant,
    pub(super) latency: Latency,
    /// The index of the current entry and the time at which it became current. For the first entry, this is the time at
    /// which the program began to make the window.
    since: (usize, Instant),
    /// The durations until something of the current entry was shown everywhere, and until it was complete.
    pub(super) first_image: [Option<Duration>; 2],
}

impl App {
    /// Returns the application. `started` is the time at which the program began to make the window. `blit` draws the
    /// image if it exists.
    pub(crate) fn new(
        model: Model,
        steps: Option<Vec<Step>>,
        outcome: Outcome,
        started: Instant,
        blit: Option<Blit>,
        ctx: &egui::Context,
    ) -> Self {
        ctx.set_theme(egui::Theme::Dark);
        let script = steps.map(|steps| Running::new(steps, started));
        Self {
            model,
            texture: None,
            blit,
            in_blit: false,
            just_shown: [false; 2],
            area: egui::Rect::ZERO,
            pointer: None,
            drag: None,
            pressed: None,
            last_click: None,
            prompt: None,
            desk: Desk::default(),
            full_screen: false,
            script,
            outcome,
            shot: Shot::default(),
            shown_title: String::new(),
            input: started,
            latency: Latency::default(),
            since: (0, started),
            first_image: [None; 2],
        }
    }

    /// Converts a point of the window to pixels of the image area.
    pub(crate) fn in_area(&self, pos: Pos2, ppp: f32) -> (f64, f64) {
        let at = (pos - self.area.min) * ppp;
        (f64::from(at.x), f64::from(at.y))
    }

    pub(super) fn run(&mut self, command: Command, ctx: &egui::Context) {
        match command {
            Command::FullScreen => {
                self.full_screen = !self.full_screen;
                ctx.send_viewport_cmd(egui::ViewportCommand::Fullscreen(self.full_screen));
            }
            Command::Theme => {
                let dark = ctx.theme() == egui::Theme::Dark;
                ctx.set_theme(if dark { egui::Theme::Light } else { egui::Theme::Dark });
            }
            Command::Quit => ctx.send_viewport_cmd(egui::ViewportCommand::Close),
            Command::Save { pixels } => {
                let name = self.model.entries.name(self.model.entries.current);
                let stem = Path::new(&name).file_stem().map_or("image".into(), |s| s.to_string_lossy());
                let text = if pixels { format!("{stem}.copy.exr") } else { format!("{stem}.view.png") };
                self.prompt = Some(Prompt { text, pixels });
            }
        }
    }

    /// Saves the image under the name that the user entered.
    pub(crate) fn save(&mut self, prompt: &Prompt) {
        let path = PathBuf::from(prompt.text.trim());
        let model = &mut self.model;
        let done = if prompt.pixels {
            let current = model.entries.current;
            match model.seen(current) {
                Some(seen) => save_pixels(&seen.page, Some(seen.layer), &path, &model.formats),
                None => return,
            }
        } else {
            save_canvas(&model.canvas, &path, &model.formats)
        };
        match done {
            Ok(()) => model.say(format!("saved {}", path.display())),
            Err(error) => model.say(error.to_string()),
        }
    }

    pub(super) fn handle(&mut self, event: &Event, ppp: f32, ctx: &egui::Context) {
        match event {
            Event::Key { key, pressed: true, modifiers, .. }
                if self.prompt.is_none() && !self.desk.is_typing(ctx) =>
            {
                if let Some(action) = keys::action_of(*key, *modifiers)
                    && let Some(command) = self.model.act(action)
                {
                    self.run(command, ctx);
                }
            }
            Event::PointerMoved(pos) => self.moved(*pos, ppp, ctx),
            Event::PointerGone => self.pointer = None,
            Event::PointerButton {
                pos,
                button: PointerButton::Primary | PointerButton::Middle,
                pressed,
                modifiers,
            } => {
                if *pressed && self.area.contains(*pos) && self.prompt.is_none() {
                    self.press(*pos, *modifiers, ppp, ctx);
                } else if !*pressed {
                    self.release(*pos, ppp);
                }
            }
            Event::MouseWheel { unit, delta, .. } => {
                let Some(pos) = self.pointer.filter(|p| self.area.contains(*p)) else { return };
                let lines = match unit {
                    egui::MouseWheelUnit::Point => delta.y / 50.0,
                    egui::MouseWheelUnit::Line => delta.y,
                    egui::MouseWheelUnit::Page => delta.y * 8.0,
                };
                let (x, y) = self.in_area(pos, ppp);
                self.model.fitted = false;
                self.model.view.zoom_at(x, y, f64::from(lines / 4.0).exp2());
            }
            _ => {}
        }
    }

    /// Returns the position of a wipe's edge in the window, in points, and true when the edge is horizontal.
    fn wipe_edge(&self) -> Option<(f32, bool)> {
        let Mix::Wipe { at, down } = self.model.mix else { return None };
        let place = if down {
            self.area.top() + at * self.area.height()
        } else {
            self.area.left() + at * self.area.width()
        };
        Some((place, down))
    }

    fn wipe_to(&mut self, pos: Pos2) {
        if let Mix::Wipe { down, .. } = self.model.mix {
            let at = if down {
                (pos.y - self.area.top()) / self.area.height()
            } else {
                (pos.x - self.area.left()) / self.area.width()
            };
            self.model.mix = Mix::Wipe { at: at.clamp(0.0, 1.0), down };
        }
    }

    /// Returns the point of the window of the pixels `[x, y, ...]` of a live image.
    pub(crate) fn pixel_point(&self, at: &serde_json::Value, ppp: f32) -> Option<Pos2> {
        let (x, y) = self.model.view.to_screen(at[0].as_f64()?, at[1].as_f64()?);
        self.model.view.around.is_none().then(|| self.area.min + Vec2::new(x as f32, y as f32) / ppp)
    }

    /// Moves or aims the chosen light of the desk at a point of the window.
    fn point_lamp(&mut self, pointing: Pointing, pos: Pos2, ppp: f32, ctx: &egui::Context) {
        let (x, y) = self.in_area(pos, ppp);
        let at = self.model.view.to_sheet(x, y);
        self.desk.point(pointing, at, ctx);
    }

    fn press(&mut self, pos: Pos2, modifiers: Modifiers, ppp: f32, ctx: &egui::Context) {
        self.pressed = Some((pos, modifiers));
        let mut desk = std::mem::take(&mut self.desk);
        let pointing = desk.grabbed(&|at| self.pixel_point(at, ppp), pos);
        self.desk = desk;
        if let Some(pointing) = pointing {
            self.drag = Some((Drag::Lamp(pointing), pos));
            if pointing == Pointing::Aim {
                self.point_lamp(pointing, pos, ppp, ctx);
            }
            return;
        }
        let live = self.model.entries.is_live(self.model.entries.current);
        let near_edge = self
            .wipe_edge()
            .is_some_and(|(place, down)| (if down { pos.y } else { pos.x } - place).abs() * ppp < 10.0);
        let drag = if near_edge {
            Drag::Wipe
        } else if modifiers.command && live {
            Drag::Priority(pos)
        } else if modifiers.shift {
            Drag::Probe(pos)
        } else {
            Drag::Pan
        };
        self.drag = Some((drag, pos));
    }

    fn moved(&mut self, pos: Pos2, ppp: f32, ctx: &egui::Context) {
        let modifiers = ctx.input(|i| i.modifiers);
        self.pointer = Some(pos);
        if let Some((Drag::Lamp(pointing), _)) = self.drag {
            return self.point_lamp(pointing, pos, ppp, ctx);
        }
        match &mut self.drag {
            Some((Drag::Pan, last)) => {
                let by = (pos - *last) * ppp;
                *last = pos;
                self.model.pan(f64::from(by.x), f64::from(by.y));
            }
            Some((Drag::Wipe, _)) => self.wipe_to(pos),
            Some((Drag::Lamp(_), _)) => (),
            Some((Drag::Probe(from) | Drag::Priority(from), _)) => {
                let from = *from;
                // A click is not an area.
                if (pos - from).length() * ppp > 3.0 {
                    self.model.probe = self.rect_between(from, pos, ppp);
                }
            }
            None if modifiers.shift && self.area.contains(pos) => self.wipe_to(pos),
            None => {}
        }
    }

    /// Returns the rectangle of image pixels between two points of the window.
    fn rect_between(&mut self, a: Pos2, b: Pos2, ppp: f32) -> Option<PixelRect> {
        let (a, b) = (self.in_area(a, ppp), self.in_area(b, ppp));
        let (p, q) = (self.model.nearest_pixel(a.0, a.1)?, self.model.nearest_pixel(b.0, b.1)?);
        Some(PixelRect { x0: p.0.min(q.0), y0: p.1.min(q.1), x1: p.0.max(q.0) + 1, y1: p.1.max(q.1) + 1 })
    }

    fn release(&mut self, pos: Pos2, ppp: f32) {
        let Some((drag, _)) = self.drag.take() else { return };
        let Some((from, modifiers)) = self.pressed.take() else { return };
        let moved = (pos - from).length() * ppp > 3.0;
        match drag {
            Drag::Lamp(_) => self.desk.release(),
            Drag::Priority(from) => {
                let rect = self.rect_between(from, pos, ppp);
                self.model.probe = None;
                if let Some(rect) = rect.filter(|_| moved) {
                    let told = self.model.request(Request::Priority(rect));
                    self.model.say(if told {
                        "these pixels are rendered first"
                    } else {
                        "the sender has ended"
                    });
                }
            }
            Drag::Probe(_) if !moved && modifiers.shift => {
                let (x, y) = self.in_area(pos, ppp);
                let at = self.model.nearest_pixel(x, y);
                if let Some((x, y)) = at.filter(|_| self.model.entries.is_live(self.model.entries.current)) {
                    let told = self.model.request(Request::Center { x, y });
                    self.model.say(if told {
                        "rendering continues from here"
                    } else {
                        "the sender has ended"
                    });
                }
            }
            Drag::Pan if !moved => {
                let again = self.last_click.is_some_and(|(t, p)| {
                    t.elapsed() < Duration::from_millis(350) && (p - pos).length() < 6.0
                });
                self.last_click = Some((Instant::now(), pos));
                if again {
                    self.model.act(keys::Action::Fit);
                }
            }
            _ => {}
        }
    }

    /// Draws the image and shows it on the screen.
    pub(super) fn show_image(&mut self, ui: &mut egui::Ui) {
        let ppp = ui.ctx().pixels_per_point();
        let side = |v: f32| (v * ppp).round().clamp(1.0, 16384.0) as u32;
        let most = ui.input(|i| i.max_texture_side) as u32;
        let (width, height) = (side(self.area.width()).min(most), side(self.area.height()).min(most));
        // By now the previous frame is on its way to the screen.
        for (just, time) in self.just_shown.iter_mut().zip(&mut self.first_image) {
            if std::mem::take(just) {
                *time = Some(self.since.1.elapsed());
            }
        }
        if self.since.0 != self.model.entries.current {
            self.since = (self.model.entries.current, Instant::now());
            self.first_image = [None; 2];
        }
        let changed = self.model.frame(width, height);
        let corner = [self.area.left(), self.area.top()].map(|v| (v * ppp).round() as i32);
        if changed || self.texture.is_none() && !self.in_blit {
            self.in_blit = self.blit.as_mut().is_some_and(|blit| blit.take(&self.model.canvas, corner));
            if !self.in_blit {
                self.set_texture(ui.ctx());
            }
        }
        let now = [self.model.canvas.covered, self.model.complete];
        for ((just, time), now) in self.just_shown.iter_mut().zip(&self.first_image).zip(now) {
            if now && time.is_none() {
                *just = true;
                ui.ctx().request_repaint();
            }
        }
        let size = Vec2::new(width as f32, height as f32) / ppp;
        let place = egui::Rect::from_min_size(self.area.min, size);
        if let Some(callback) = self.blit.as_ref().filter(|_| self.in_blit).and_then(Blit::callback) {
            ui.painter().add(egui_wgpu::Callback::new_paint_callback(place, callback));
        } else if let Some(texture) = &self.texture {
            let all = egui::Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            ui.painter().image(texture.id(), place, all, Color32::WHITE);
        }
    }

    fn set_texture(&mut self, ctx: &egui::Context) {
        let canvas = &self.model.canvas;
        let pixels = canvas.bytes.chunks_exact(4).map(|p| Color32::from_rgb(p[0], p[1], p[2])).collect();
        let image = ColorImage::new([canvas.width as usize, canvas.height as usize], pixels);
        match &mut self.texture {
            Some(texture) => texture.set(image, TextureOptions::NEAREST),
            None => self.texture = Some(ctx.load_texture("image", image, TextureOptions::NEAREST)),
        }
    }
}
