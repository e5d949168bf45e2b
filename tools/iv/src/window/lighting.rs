//! The connection of the desk for lighting with the window: where its panel is shown, and where its edits go.

use super::app::App;
use super::desk::{Desk, ECHO};
use eframe::egui;
use egui::Ui;
use granita_view::Mix;
use serde_json::{Value, json};

/// Shows the panel at the right edge of the window, if an image has one.
pub(crate) fn show(app: &mut App, ui: &mut Ui) {
    let mut desk = std::mem::take(&mut app.desk);
    desk.refresh(&app.model.entries);
    if desk.is_open() {
        desk.fields.clear();
        let wipes = matches!(app.model.mix, Mix::Wipe { .. });
        let mut compared = None;
        egui::Panel::right("desk").default_size(330.0).show(ui, |ui| {
            egui::ScrollArea::vertical()
                .auto_shrink(false)
                .show(ui, |ui| compared = desk.contents(wipes, ui));
        });
        if let Some(before) = compared {
            compare(app, &before);
        }
        send(&mut desk, app, ui.ctx());
    }
    app.desk = desk;
}

/// Sends the edits to the renderer.
fn send(desk: &mut Desk, app: &mut App, ctx: &egui::Context) {
    if desk.dragging && !ctx.input(|i| i.pointer.any_down()) {
        desk.dragging = false;
        desk.edits.push(json!({"do": "end"}));
    }
    let edits = std::mem::take(&mut desk.edits);
    let Some(sender) = desk.image.as_ref().and_then(|name| app.model.entries.live().edits(name)) else {
        return;
    };
    let view = app.model.view;
    let ((x0, y0), (x1, y1)) =
        (view.to_sheet(0.0, 0.0), view.to_sheet(f64::from(view.width), f64::from(view.height)));
    for mut edit in edits {
        edit["visible"] = json!([x0, y0, x1 - x0, y1 - y0]);
        edit["number"] = json!(app.latency.sent(app.input, edit["light"].is_string()));
        sender.send(&edit.to_string());
        ctx.request_repaint();
    }
    desk.own.retain(|_, (_, at)| at.elapsed() < ECHO);
}

/// Begins or ends the comparison with the image before the last edit.
fn compare(app: &mut App, before: &str) {
    let entries = &app.model.entries;
    let found = (0..entries.len()).find(|k| entries.is_live(*k) && entries.name(*k) == before);
    let shown = matches!(app.model.mix, Mix::Wipe { .. });
    if let Some(entry) = found.filter(|entry| *entry != entries.current) {
        app.model.other = Some(entry);
        app.model.mix = if shown { Mix::First } else { Mix::Wipe { at: 0.5, down: false } };
    }
}

/// What scripts and measurements use.
impl Desk {
    /// True when an image has a panel, and its sender shows the edits up to this number and renders nothing. A sender
    /// that reports no numbers is idle when it says so.
    pub(super) fn is_idle(&self, sent: u64) -> bool {
        let state = self.part("state");
        let image = &state["image"];
        let is_shown = image["edit"].as_u64().unwrap_or(0) >= sent && image["coarse"] != true;
        state["status"] == "idle" && (image.is_null() || is_shown)
    }

    /// Returns the number of the last edit that the last complete image shows, and true when that image is coarse.
    /// Returns `None` when the sender does not report it.
    pub(super) fn complete_image(&self) -> Option<(u64, bool)> {
        let image = &self.part("state")["image"];
        Some((image["edit"].as_u64()?, image["coarse"].as_bool()?))
    }

    /// Returns the position of a light in the image, in pixels; `None` for a light that is not there.
    pub(super) fn place(&self, id: &str) -> Option<&Value> {
        Some(&self.light(id)["at"]).filter(|at| at.is_array())
    }

    /// Opens the controls of a light.
    pub(super) fn choose(&mut self, id: &str) {
        self.chosen = Some(id.to_owned());
    }
}
