//! Between the desk and the screen: events in, a bitmap and some panels out.

use super::Outcome;
use super::blit::Blit;
use super::desk::{Desk, Errand};
use super::keys;
use super::panels;
use super::script::Step;
use eframe::{egui, egui_wgpu};
use egui::{
    Color32, ColorImage, Event, Key, Modifiers, PointerButton, Pos2, TextureHandle, TextureOptions, Vec2,
};
use granita_cli::Status;
use granita_image::{PixelRect, Request};
use granita_view::{Mix, save_canvas, save_pixels};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A drag that is going on.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Drag {
    Pan,
    Wipe,
    /// From this point of the picture area: the area that is measured.
    Probe(Pos2),
    /// The area that a render is to do first.
    Priority(Pos2),
}

/// A name that is being asked for.
#[derive(Clone, Debug)]
pub(crate) struct Prompt {
    pub(crate) text: String,
    pub(crate) pixels: bool,
}

/// A script that runs.
struct Running {
    steps: VecDeque<Step>,
    /// Events, frame by frame.
    events: VecDeque<Vec<Event>>,
    frames: u32,
    until: Option<Instant>,
    /// Frames in a row in which there was nothing to wait for.
    quiet: u32,
    bench: Option<Bench>,
    screenshot: Option<PathBuf>,
}

struct Bench {
    left: u32,
    frames: u32,
    complete: u32,
    since: Instant,
    direction: f64,
}

type Shot = Arc<Mutex<Option<Arc<ColorImage>>>>;

/// The application, as the window system sees it.
pub(crate) struct Shell {
    pub(crate) desk: Desk,
    texture: Option<TextureHandle>,
    /// What draws the picture instead, and whether it has it.
    blit: Option<Blit>,
    in_blit: bool,
    /// The last frame had something everywhere, or the complete picture, for the first time.
    just_shown: [bool; 2],
    /// Where the picture is, in points.
    pub(crate) area: egui::Rect,
    pub(crate) pointer: Option<Pos2>,
    drag: Option<(Drag, Pos2)>,
    /// Where the button went down.
    pressed: Option<(Pos2, Modifiers)>,
    last_click: Option<(Instant, Pos2)>,
    pub(crate) prompt: Option<Prompt>,
    full_screen: bool,
    script: Option<Running>,
    outcome: Outcome,
    shot: Shot,
    shown_title: String,
    /// The present entry, and since when; of the first one since the program began to make the window.
    since: (usize, Instant),
    /// After how long there was something everywhere of it, and when it was complete.
    first_picture: [Option<Duration>; 2],
}

impl Shell {
    /// `started` is when the program began to make the window; `blit` draws the picture if it is there.
    pub(crate) fn new(
        desk: Desk,
        steps: Option<Vec<Step>>,
        outcome: Outcome,
        started: Instant,
        blit: Option<Blit>,
        ctx: &egui::Context,
    ) -> Self {
        ctx.set_theme(egui::Theme::Dark);
        let script = steps.map(|steps| Running {
            steps: steps.into(),
            events: VecDeque::new(),
            frames: 0,
            until: None,
            quiet: 0,
            bench: None,
            screenshot: None,
        });
        Self {
            desk,
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
            full_screen: false,
            script,
            outcome,
            shot: Shot::default(),
            shown_title: String::new(),
            since: (0, started),
            first_picture: [None; 2],
        }
    }

    /// A point of the window in pixels of the picture area.
    pub(crate) fn in_area(&self, pos: Pos2, ppp: f32) -> (f64, f64) {
        let at = (pos - self.area.min) * ppp;
        (f64::from(at.x), f64::from(at.y))
    }

    fn run(&mut self, errand: Errand, ctx: &egui::Context) {
        match errand {
            Errand::FullScreen => {
                self.full_screen = !self.full_screen;
                ctx.send_viewport_cmd(egui::ViewportCommand::Fullscreen(self.full_screen));
            }
            Errand::Theme => {
                let dark = ctx.theme() == egui::Theme::Dark;
                ctx.set_theme(if dark { egui::Theme::Light } else { egui::Theme::Dark });
            }
            Errand::Quit => ctx.send_viewport_cmd(egui::ViewportCommand::Close),
            Errand::Save { pixels } => {
                let name = self.desk.entries.name(self.desk.entries.current);
                let stem = Path::new(&name).file_stem().map_or("picture".into(), |s| s.to_string_lossy());
                let text = if pixels { format!("{stem}.copy.exr") } else { format!("{stem}.view.png") };
                self.prompt = Some(Prompt { text, pixels });
            }
        }
    }

    /// Saves under the name that was given.
    pub(crate) fn save(&mut self, prompt: &Prompt) {
        let path = PathBuf::from(prompt.text.trim());
        let desk = &mut self.desk;
        let done = if prompt.pixels {
            let current = desk.entries.current;
            match desk.seen(current) {
                Some(seen) => save_pixels(&seen.page, Some(seen.layer), &path, &desk.formats),
                None => return,
            }
        } else {
            save_canvas(&desk.canvas, &path, &desk.formats)
        };
        match done {
            Ok(()) => desk.say(format!("saved {}", path.display())),
            Err(error) => desk.say(error.to_string()),
        }
    }

    fn handle(&mut self, event: &Event, ppp: f32, ctx: &egui::Context) {
        match event {
            Event::Key { key, pressed: true, modifiers, .. } if self.prompt.is_none() => {
                if let Some(action) = keys::action_of(*key, *modifiers)
                    && let Some(errand) = self.desk.act(action)
                {
                    self.run(errand, ctx);
                }
            }
            Event::PointerMoved(pos) => self.moved(*pos, ppp, ctx.input(|i| i.modifiers)),
            Event::PointerGone => self.pointer = None,
            Event::PointerButton {
                pos,
                button: PointerButton::Primary | PointerButton::Middle,
                pressed,
                modifiers,
            } => {
                if *pressed && self.area.contains(*pos) && self.prompt.is_none() {
                    self.press(*pos, *modifiers, ppp);
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
                self.desk.fitted = false;
                self.desk.view.zoom_at(x, y, f64::from(lines / 4.0).exp2());
            }
            _ => {}
        }
    }

    /// Where the edge of a wipe is on the screen, and whether it lies across.
    fn wipe_edge(&self) -> Option<(f32, bool)> {
        let Mix::Wipe { at, down } = self.desk.mix else { return None };
        let place = if down {
            self.area.top() + at * self.area.height()
        } else {
            self.area.left() + at * self.area.width()
        };
        Some((place, down))
    }

    fn wipe_to(&mut self, pos: Pos2) {
        if let Mix::Wipe { down, .. } = self.desk.mix {
            let at = if down {
                (pos.y - self.area.top()) / self.area.height()
            } else {
                (pos.x - self.area.left()) / self.area.width()
            };
            self.desk.mix = Mix::Wipe { at: at.clamp(0.0, 1.0), down };
        }
    }

    fn press(&mut self, pos: Pos2, modifiers: Modifiers, ppp: f32) {
        self.pressed = Some((pos, modifiers));
        let live = self.desk.entries.is_live(self.desk.entries.current);
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

    fn moved(&mut self, pos: Pos2, ppp: f32, modifiers: Modifiers) {
        self.pointer = Some(pos);
        match &mut self.drag {
            Some((Drag::Pan, last)) => {
                let by = (pos - *last) * ppp;
                *last = pos;
                self.desk.pan(f64::from(by.x), f64::from(by.y));
            }
            Some((Drag::Wipe, _)) => self.wipe_to(pos),
            Some((Drag::Probe(from) | Drag::Priority(from), _)) => {
                let from = *from;
                // A click is no area.
                if (pos - from).length() * ppp > 3.0 {
                    self.desk.probe = self.rect_between(from, pos, ppp);
                }
            }
            None if modifiers.shift && self.area.contains(pos) => self.wipe_to(pos),
            None => {}
        }
    }

    /// The pixels between two points of the window.
    fn rect_between(&mut self, a: Pos2, b: Pos2, ppp: f32) -> Option<PixelRect> {
        let (a, b) = (self.in_area(a, ppp), self.in_area(b, ppp));
        let (p, q) = (self.desk.nearest_pixel(a.0, a.1)?, self.desk.nearest_pixel(b.0, b.1)?);
        Some(PixelRect { x0: p.0.min(q.0), y0: p.1.min(q.1), x1: p.0.max(q.0) + 1, y1: p.1.max(q.1) + 1 })
    }

    fn release(&mut self, pos: Pos2, ppp: f32) {
        let Some((drag, _)) = self.drag.take() else { return };
        let Some((from, modifiers)) = self.pressed.take() else { return };
        let moved = (pos - from).length() * ppp > 3.0;
        match drag {
            Drag::Priority(from) => {
                let rect = self.rect_between(from, pos, ppp);
                self.desk.probe = None;
                if let Some(rect) = rect.filter(|_| moved) {
                    let told = self.desk.request(Request::Priority(rect));
                    self.desk.say(if told { "these pixels first" } else { "nobody is there to be told" });
                }
            }
            Drag::Probe(_) if !moved && modifiers.shift => {
                let (x, y) = self.in_area(pos, ppp);
                let at = self.desk.nearest_pixel(x, y);
                if let Some((x, y)) = at.filter(|_| self.desk.entries.is_live(self.desk.entries.current)) {
                    let told = self.desk.request(Request::Center { x, y });
                    self.desk.say(if told { "going on from here" } else { "nobody is there to be told" });
                }
            }
            Drag::Pan if !moved => {
                let again = self.last_click.is_some_and(|(t, p)| {
                    t.elapsed() < Duration::from_millis(350) && (p - pos).length() < 6.0
                });
                self.last_click = Some((Instant::now(), pos));
                if again {
                    self.desk.act(keys::Action::Fit);
                }
            }
            _ => {}
        }
    }

    /// Draws the picture and puts it on the screen.
    fn show_picture(&mut self, ui: &mut egui::Ui) {
        let ppp = ui.ctx().pixels_per_point();
        let side = |v: f32| (v * ppp).round().clamp(1.0, 16384.0) as u32;
        let most = ui.input(|i| i.max_texture_side) as u32;
        let (width, height) = (side(self.area.width()).min(most), side(self.area.height()).min(most));
        // By now the frame before is on its way to the screen.
        for (just, time) in self.just_shown.iter_mut().zip(&mut self.first_picture) {
            if std::mem::take(just) {
                *time = Some(self.since.1.elapsed());
            }
        }
        if self.since.0 != self.desk.entries.current {
            self.since = (self.desk.entries.current, Instant::now());
            self.first_picture = [None; 2];
        }
        let changed = self.desk.frame(width, height);
        let corner = [self.area.left(), self.area.top()].map(|v| (v * ppp).round() as i32);
        if changed || self.texture.is_none() && !self.in_blit {
            self.in_blit = self.blit.as_mut().is_some_and(|blit| blit.take(&self.desk.canvas, corner));
            if !self.in_blit {
                self.set_texture(ui.ctx());
            }
        }
        let now = [self.desk.canvas.covered, self.desk.complete];
        for ((just, time), now) in self.just_shown.iter_mut().zip(&self.first_picture).zip(now) {
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
        let canvas = &self.desk.canvas;
        let pixels = canvas.bytes.chunks_exact(4).map(|p| Color32::from_rgb(p[0], p[1], p[2])).collect();
        let image = ColorImage::new([canvas.width as usize, canvas.height as usize], pixels);
        match &mut self.texture {
            Some(texture) => texture.set(image, TextureOptions::NEAREST),
            None => self.texture = Some(ctx.load_texture("picture", image, TextureOptions::NEAREST)),
        }
    }

    // The script.

    fn fail(&self, what: &str) {
        granita_cli::print(&format!("script: {what}\n"));
        *self.outcome.lock().unwrap_or_else(PoisonError::into_inner) = Status::WithErrors;
    }

    /// Whether the script can go on with its next step.
    fn can_go_on(&mut self) -> bool {
        let settled = self.desk.complete && self.desk.is_settled();
        let Some(script) = &mut self.script else { return false };
        if !script.events.is_empty() || script.screenshot.is_some() || script.bench.is_some() {
            return false;
        }
        if script.frames > 0 {
            script.frames -= 1;
            return false;
        }
        if script.until.is_some_and(|t| Instant::now() < t) {
            return false;
        }
        script.until = None;
        if script.steps.front() == Some(&Step::Wait) {
            script.quiet = if settled { script.quiet + 1 } else { 0 };
            if script.quiet < 4 {
                return false;
            }
            script.quiet = 0;
            script.steps.pop_front();
        }
        true
    }

    fn go_on(&mut self, ctx: &egui::Context) {
        self.take_screenshot();
        self.bench_frame();
        while self.can_go_on() {
            let Some(script) = &mut self.script else { return };
            if script.steps.front() == Some(&Step::Wait) {
                break;
            }
            let Some(step) = script.steps.pop_front() else { break };
            self.step(step, ctx);
        }
        let settled = self.desk.is_settled();
        if let Some(script) = &self.script {
            // What is being read has the window drawn again when it is there.
            match script.steps.front() == Some(&Step::Wait) && !settled {
                true => ctx.request_repaint_after(Duration::from_millis(50)),
                false => ctx.request_repaint(),
            }
        }
    }

    fn step(&mut self, step: Step, ctx: &egui::Context) {
        let Some(script) = &mut self.script else { return };
        let ppp = ctx.pixels_per_point();
        let point = |x: f32, y: f32| Pos2::new(x / ppp, y / ppp);
        let modifiers = |text: &str| Modifiers {
            shift: text.contains("Shift+"),
            ctrl: text.contains("Ctrl+"),
            command: text.contains("Ctrl+"),
            ..Modifiers::NONE
        };
        let button = |pos, pressed, modifiers| Event::PointerButton {
            pos,
            button: PointerButton::Primary,
            pressed,
            modifiers,
        };
        match step {
            Step::Wait => {}
            Step::Frames(n) => script.frames = n,
            Step::Sleep(s) => {
                script.until = Some(Instant::now() + Duration::from_secs_f64(s.clamp(0.0, 60.0)))
            }
            Step::Key(text) => {
                if let Some((key, modifiers)) = keys::parse(&text) {
                    let event =
                        |pressed| Event::Key { key, physical_key: None, pressed, repeat: false, modifiers };
                    script.events.extend([vec![event(true)], vec![event(false)]]);
                }
            }
            Step::Move(x, y) => script.events.push_back(vec![Event::PointerMoved(point(x, y))]),
            Step::Click(x, y, text) => {
                let (p, m) = (point(x, y), modifiers(&text));
                script.events.push_back(vec![Event::PointerMoved(p), button(p, true, m)]);
                script.events.push_back(vec![button(p, false, m)]);
            }
            Step::Drag([x0, y0, x1, y1], text) => {
                let m = modifiers(&text);
                script
                    .events
                    .push_back(vec![Event::PointerMoved(point(x0, y0)), button(point(x0, y0), true, m)]);
                for i in 1..=8 {
                    let f = i as f32 / 8.0;
                    let p = point(x0 + (x1 - x0) * f, y0 + (y1 - y0) * f);
                    script.events.push_back(vec![Event::PointerMoved(p)]);
                }
                script.events.push_back(vec![button(point(x1, y1), false, m)]);
            }
            Step::Scroll(x, y, n) => {
                script.events.push_back(vec![Event::PointerMoved(point(x, y))]);
                script.events.push_back(vec![Event::MouseWheel {
                    unit: egui::MouseWheelUnit::Line,
                    delta: Vec2::new(0.0, n),
                    phase: egui::TouchPhase::Move,
                    source: egui::MouseWheelSource::Unknown,
                    modifiers: Modifiers::NONE,
                }]);
            }
            Step::Type(text) => script.events.push_back(vec![Event::Text(text)]),
            Step::File(path) => {
                self.desk.entries.add(vec![path]);
                let last = self.desk.entries.len() - 1;
                self.desk.show(last);
            }
            Step::Screenshot(path) => {
                script.screenshot = Some(path);
                let shot = self.shot.clone();
                ctx.request_screenshot(move |image| {
                    *shot.lock().unwrap_or_else(PoisonError::into_inner) = Some(image);
                });
            }
            Step::Canvas(path) => {
                if let Err(error) = save_canvas(&self.desk.canvas, &path, &self.desk.formats) {
                    self.fail(&error.to_string());
                }
            }
            Step::Print => granita_cli::print(&self.everything_said(ppp)),
            Step::Expect(text) => {
                let said = self.everything_said(ppp);
                if !said.contains(&text) {
                    self.fail(&format!("expected \"{text}\" in:\n{said}"));
                }
            }
            Step::Bench(n) => {
                script.bench =
                    Some(Bench { left: n, frames: 0, complete: 0, since: Instant::now(), direction: 1.0 });
            }
            Step::Quit => {
                self.script = None;
                ctx.send_viewport_cmd(egui::ViewportCommand::Close);
            }
        }
    }

    /// The status line, the side panel and the message as text.
    fn everything_said(&mut self, ppp: f32) -> String {
        let [first, complete] = self.first_picture.map(|d| d.map_or(0.0, |d| d.as_secs_f64()));
        let mut lines = vec![panels::status(self, ppp)];
        lines.extend(panels::numbers(&mut self.desk));
        lines.extend(self.desk.message.as_ref().map(|(text, _)| text.clone()));
        lines.push(format!("first picture after {first:.3} s, complete after {complete:.3} s"));
        lines.join("\n") + "\n"
    }

    fn take_screenshot(&mut self) {
        let image = self.shot.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(image) = image else { return };
        let Some(path) = self.script.as_mut().and_then(|s| s.screenshot.take()) else { return };
        let [width, height] = image.size.map(|side| side as u32);
        let bytes = image.pixels.iter().flat_map(|p| p.to_array()).collect();
        let canvas = granita_view::Canvas::new(width, height, bytes);
        if let Err(error) = save_canvas(&canvas, &path, &self.desk.formats) {
            self.fail(&error.to_string());
        }
    }

    /// One frame of the bench: pans to the right and down, and back at the edges.
    fn bench_frame(&mut self) {
        let complete = self.desk.complete;
        let Some(script) = &mut self.script else { return };
        let Some(bench) = &mut script.bench else { return };
        bench.frames += 1;
        bench.complete += u32::from(complete);
        if bench.left > 0 {
            bench.left -= 1;
            let bounds = {
                let current = self.desk.entries.current;
                self.desk.seen(current).map(|s| s.sheet.bounds)
            };
            if let Some([left, top, right, bottom]) = bounds {
                let (x, y) = self.desk.view.center;
                if x >= right || y >= bottom {
                    bench.direction = -1.0;
                } else if x <= left || y <= top {
                    bench.direction = 1.0;
                }
            }
            let by = -bench.direction;
            self.desk.pan(24.0 * by, 14.0 * by);
            return;
        }
        let seconds = bench.since.elapsed().as_secs_f64();
        let (now, most) = self.desk.store.bytes();
        let visible = self.desk.visible_bytes();
        granita_cli::print(&format!(
            "bench: {} frames in {seconds:.2} s: {:.1} frames/s, {} of them complete; tiles {:.1} MiB, at most {:.1}, in sight {:.1}\n",
            bench.frames,
            f64::from(bench.frames) / seconds,
            bench.complete,
            now as f64 / 1048576.0,
            most as f64 / 1048576.0,
            visible as f64 / 1048576.0,
        ));
        script.bench = None;
    }
}

impl eframe::App for Shell {
    fn raw_input_hook(&mut self, _ctx: &egui::Context, raw_input: &mut egui::RawInput) {
        if let Some(script) = &mut self.script {
            // Nobody else has a hand in it.
            raw_input.events.retain(|e| {
                !matches!(
                    e,
                    Event::PointerMoved(_)
                        | Event::PointerButton { .. }
                        | Event::Key { .. }
                        | Event::PointerGone
                )
            });
            if let Some(events) = script.events.pop_front() {
                for event in &events {
                    if let Event::PointerButton { modifiers, .. } | Event::Key { modifiers, .. } = event {
                        raw_input.events.push(Event::ModifiersChanged(*modifiers));
                    }
                }
                raw_input.events.extend(events);
            }
        }
        let dropped: Vec<PathBuf> = raw_input.dropped_files.iter().map(|f| f.path().to_owned()).collect();
        if !dropped.is_empty() {
            let files = granita_view::expand(&dropped, &self.desk.formats);
            let first = self.desk.entries.len();
            self.desk.entries.add(files);
            self.desk.show(first);
        }
    }

    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        let ctx = ui.ctx().clone();
        let ppp = ctx.pixels_per_point();
        let events = ctx.input(|i| i.events.clone());
        // Tab and the like are keys of the picture, not ways through the panels.
        if self.prompt.is_none() {
            ctx.memory_mut(|m| {
                if let Some(id) = m.focused() {
                    m.surrender_focus(id);
                }
            });
        }
        for event in &events {
            self.handle(event, ppp, &ctx);
        }
        if self.prompt.is_some()
            && events.iter().any(|e| matches!(e, Event::Key { key: Key::Escape, pressed: true, .. }))
        {
            self.prompt = None;
        }
        if !self.full_screen || self.desk.list_open || self.desk.side_open {
            panels::around(self, ui);
        }
        self.area = ui.available_rect_before_wrap();
        self.show_picture(ui);
        panels::over(self, ui);
        if let Some(errand) = self.desk.pending.take() {
            self.run(errand, &ctx);
        }
        let title = format!("{} - iv", self.desk.entries.name(self.desk.entries.current));
        if title != self.shown_title {
            ctx.send_viewport_cmd(egui::ViewportCommand::Title(title.clone()));
            self.shown_title = title;
        }
        // Files are looked at for changes.
        ctx.request_repaint_after(Duration::from_millis(500));
        self.go_on(&ctx);
    }

    fn clear_color(&self, _visuals: &egui::Visuals) -> [f32; 4] {
        [34.0 / 255.0, 34.0 / 255.0, 36.0 / 255.0, 1.0]
    }
}
