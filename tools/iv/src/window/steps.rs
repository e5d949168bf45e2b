//! The steps of a script, frame by frame.

use super::app::App;
use super::latency::LONGEST;
use super::script::{Bench, Step};
use super::{keys, panels};
use eframe::egui;
use egui::{Event, Modifiers, PointerButton, Pos2, Vec2};
use granita_cli::Status;
use granita_view::save_canvas;
use std::time::{Duration, Instant};

/// The time between two frames of the window while the script waits. More frames would take time from the renderer.
const PAUSE: Duration = Duration::from_millis(250);

impl App {
    fn fail(&self, what: &str) {
        granita_cli::print(&format!("script: {what}\n"));
        *self.outcome.lock() = Status::WithErrors;
    }

    /// True when the script can continue with its next step.
    fn can_go_on(&mut self) -> bool {
        let settled = self.model.complete && self.model.is_settled();
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
        let is_done = match script.steps.front() {
            Some(Step::Desk) => self.desk.is_idle(self.latency.last_edit()),
            Some(Step::Latency) => self.latency.is_done(),
            _ => true,
        };
        is_done || self.input.duration_since(script.since) > LONGEST
    }

    pub(super) fn go_on(&mut self, ctx: &egui::Context) {
        self.take_screenshot();
        self.bench_frame();
        while self.can_go_on() {
            let Some(script) = &mut self.script else { return };
            if script.steps.front() == Some(&Step::Wait) {
                break;
            }
            let Some(step) = script.steps.pop_front() else { break };
            script.since = Instant::now();
            self.step(step, ctx);
        }
        let settled = self.model.is_settled();
        if let Some(script) = &self.script {
            // Data that is read, and images of a renderer, wake the window when they arrive.
            let pause = match script.steps.front() {
                Some(Step::Wait) if !settled => Duration::from_millis(50),
                Some(Step::Desk | Step::Latency) if script.events.is_empty() => PAUSE,
                _ => {
                    let next = if script.events.is_empty() { script.until } else { Some(script.due) };
                    next.map_or(Duration::ZERO, |next| {
                        next.saturating_duration_since(Instant::now()).min(PAUSE)
                    })
                }
            };
            ctx.request_repaint_after(pause);
        }
    }

    fn step(&mut self, step: Step, ctx: &egui::Context) {
        let Some(script) = &mut self.script else { return };
        let ppp = ctx.pixels_per_point();
        match step {
            Step::Wait | Step::Desk => {}
            Step::Frames(n) => script.frames = n,
            Step::Sleep(s) => {
                script.until = Some(Instant::now() + Duration::from_secs_f64(s.clamp(0.0, 60.0)))
            }
            Step::Key(text) => script.events.extend(key_events(&text)),
            Step::Move(x, y) => script.events.push_back(vec![Event::PointerMoved(point([x, y], ppp))]),
            Step::Click(x, y, text) => {
                let (p, m) = (point([x, y], ppp), modifiers(&text));
                script.events.push_back(vec![Event::PointerMoved(p), button(p, true, m)]);
                script.events.push_back(vec![button(p, false, m)]);
            }
            Step::Drag(line, text) => script.events.extend(drag_events(line, ppp, modifiers(&text), 8)),
            Step::Light(id, [dx, dy], seconds) => {
                let place = self.desk.place(&id).and_then(|at| self.pixel_point(at, ppp));
                let Some(place) = place else { return self.fail(&format!("no light \"{id}\" in the image")) };
                self.desk.choose(&id);
                let (x, y) = (place.x * ppp, place.y * ppp);
                let Some(script) = &mut self.script else { return };
                let count = if seconds > 0.0 { (seconds * 30.0).ceil() } else { 8.0 };
                let line = [x, y, x + dx, y + dy];
                script.events.extend(drag_events(line, ppp, Modifiers::NONE, count as usize));
                script.interval = Duration::from_secs_f32(seconds / count);
                script.due = Instant::now();
            }
            Step::Latency => {
                let report = self.latency.report();
                granita_cli::print(&format!("{report}\n"));
            }
            Step::Scroll(x, y, n) => {
                script.events.push_back(vec![Event::PointerMoved(point([x, y], ppp))]);
                script.events.push_back(vec![wheel(n)]);
            }
            Step::Type(text) => script.events.push_back(vec![Event::Text(text)]),
            Step::File(path) => {
                self.model.entries.add(vec![path]);
                let last = self.model.entries.len() - 1;
                self.model.show(last);
            }
            Step::Screenshot(path) => {
                script.screenshot = Some(path);
                let shot = self.shot.clone();
                ctx.request_screenshot(move |image| {
                    *shot.lock() = Some(image);
                });
            }
            Step::Canvas(path) => {
                if let Err(error) = save_canvas(&self.model.canvas, &path, &self.model.formats) {
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

    /// Returns the status line, the side panel, the message and the times as text.
    fn everything_said(&mut self, ppp: f32) -> String {
        let [first, complete] = self.first_image.map(|d| d.map_or(0.0, |d| d.as_secs_f64()));
        let mut lines = vec![panels::status(self, ppp)];
        lines.extend(panels::numbers(&mut self.model));
        lines.extend(self.model.message.as_ref().map(|(text, _)| text.clone()));
        lines.extend(self.desk.lines());
        lines.push(format!("first image after {first:.3} s, complete after {complete:.3} s"));
        lines.join("\n") + "\n"
    }

    fn take_screenshot(&mut self) {
        let image = self.shot.lock().take();
        let Some(image) = image else { return };
        let Some(path) = self.script.as_mut().and_then(|s| s.screenshot.take()) else { return };
        let [width, height] = image.size.map(|side| side as u32);
        let bytes = image.pixels.iter().flat_map(|p| p.to_array()).collect();
        let canvas = granita_view::Canvas::new(width, height, bytes);
        if let Err(error) = save_canvas(&canvas, &path, &self.model.formats) {
            self.fail(&error.to_string());
        }
    }

    /// Processes one frame of the measurement. It pans to the right and down, and back at the edges.
    fn bench_frame(&mut self) {
        let complete = self.model.complete;
        let Some(script) = &mut self.script else { return };
        let Some(bench) = &mut script.bench else { return };
        bench.frames += 1;
        bench.complete += u32::from(complete);
        if bench.left > 0 {
            bench.left -= 1;
            let bounds = {
                let current = self.model.entries.current;
                self.model.seen(current).map(|s| s.sheet.bounds)
            };
            if let Some([left, top, right, bottom]) = bounds {
                let (x, y) = self.model.view.center;
                if x >= right || y >= bottom {
                    bench.direction = -1.0;
                } else if x <= left || y <= top {
                    bench.direction = 1.0;
                }
            }
            let by = -bench.direction;
            self.model.pan(24.0 * by, 14.0 * by);
            return;
        }
        let seconds = bench.since.elapsed().as_secs_f64();
        let (now, most) = self.model.store.bytes();
        let visible = self.model.visible_bytes();
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

/// Returns a point of the window, given in pixels of the screen, in points of egui.
fn point([x, y]: [f32; 2], pixels_per_point: f32) -> Pos2 {
    Pos2::new(x / pixels_per_point, y / pixels_per_point)
}

/// Returns the modifier keys that a text such as "Shift+Ctrl+" names.
fn modifiers(text: &str) -> Modifiers {
    Modifiers {
        shift: text.contains("Shift+"),
        ctrl: text.contains("Ctrl+"),
        command: text.contains("Ctrl+"),
        ..Modifiers::NONE
    }
}

/// Returns the event that the primary button is pressed or released.
fn button(pos: Pos2, pressed: bool, modifiers: Modifiers) -> Event {
    Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers }
}

/// Returns the event that the wheel is turned up by a number of lines.
fn wheel(lines: f32) -> Event {
    Event::MouseWheel {
        unit: egui::MouseWheelUnit::Line,
        delta: Vec2::new(0.0, lines),
        phase: egui::TouchPhase::Move,
        source: egui::MouseWheelSource::Unknown,
        modifiers: Modifiers::NONE,
    }
}

/// Returns for each frame the events of a key that is pressed and released; nothing for an unknown key.
fn key_events(text: &str) -> Vec<Vec<Event>> {
    let Some((key, modifiers)) = keys::parse(text) else { return Vec::new() };
    let event = |pressed| Event::Key { key, physical_key: None, pressed, repeat: false, modifiers };
    vec![vec![event(true)], vec![event(false)]]
}

/// Returns for each frame the events of a drag with the primary button along a line, in pixels of the screen, in a
/// number of steps.
fn drag_events(
    [x0, y0, x1, y1]: [f32; 4],
    pixels_per_point: f32,
    modifiers: Modifiers,
    count: usize,
) -> Vec<Vec<Event>> {
    let (start, end) = (point([x0, y0], pixels_per_point), point([x1, y1], pixels_per_point));
    let mut frames = vec![vec![Event::PointerMoved(start), button(start, true, modifiers)]];
    for i in 1..=count {
        let f = i as f32 / count as f32;
        let p = point([x0 + (x1 - x0) * f, y0 + (y1 - y0) * f], pixels_per_point);
        frames.push(vec![Event::PointerMoved(p)]);
    }
    frames.push(vec![button(end, false, modifiers)]);
    frames
}
