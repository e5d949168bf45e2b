//! The functions of the window that the window system calls.

use super::app::App;
use super::{lighting, panels};
use eframe::egui;
use egui::{Event, Key};
use std::path::PathBuf;
use std::time::{Duration, Instant};

impl eframe::App for App {
    fn raw_input_hook(&mut self, _ctx: &egui::Context, raw_input: &mut egui::RawInput) {
        self.input = Instant::now();
        self.latency.begin(self.input);
        if let Some(script) = &mut self.script {
            // Only the script controls the pointer and the keys.
            raw_input.events.retain(|e| {
                !matches!(
                    e,
                    Event::PointerMoved(_)
                        | Event::PointerButton { .. }
                        | Event::Key { .. }
                        | Event::PointerGone
                )
            });
            let events = script.events(self.input);
            for event in &events {
                if let Event::PointerButton { modifiers, .. } | Event::Key { modifiers, .. } = event {
                    raw_input.events.push(Event::ModifiersChanged(*modifiers));
                }
            }
            raw_input.events.extend(events);
        }
        let dropped: Vec<PathBuf> = raw_input.dropped_files.iter().map(|f| f.path().to_owned()).collect();
        if !dropped.is_empty() {
            let files = granita_view::expand(&dropped, &self.model.formats);
            let first = self.model.entries.len();
            self.model.entries.add(files);
            self.model.show(first);
        }
    }

    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        let ctx = ui.ctx().clone();
        let ppp = ctx.pixels_per_point();
        let events = ctx.input(|i| i.events.clone());
        // Keys such as Tab control the image. They do not move the focus in the panels.
        if self.prompt.is_none() && !self.desk.is_typing(&ctx) {
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
        if !self.full_screen || self.model.list_open || self.model.side_open {
            panels::around(self, ui);
        }
        lighting::show(self, ui);
        self.area = ui.available_rect_before_wrap();
        self.show_image(ui);
        if self.latency.drawn(self.desk.complete_image(), self.model.complete) {
            ctx.request_repaint();
        }
        panels::over(self, ui);
        if let Some(command) = self.model.pending.take() {
            self.run(command, &ctx);
        }
        let title = format!("{} - iv", self.model.entries.name(self.model.entries.current));
        if title != self.shown_title {
            ctx.send_viewport_cmd(egui::ViewportCommand::Title(title.clone()));
            self.shown_title = title;
        }
        // The next frame checks files for changes.
        ctx.request_repaint_after(Duration::from_millis(500));
        self.go_on(&ctx);
    }

    fn clear_color(&self, _visuals: &egui::Visuals) -> [f32; 4] {
        [34.0 / 255.0, 34.0 / 255.0, 36.0 / 255.0, 1.0]
    }
}
