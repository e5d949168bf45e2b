//! The desk for lighting: the panel of an image whose sender describes one, and the lights in the image.
//!
//! The page of `iv -serve` has the same controls (`serve/desk.js`). The words of edits are those of the desk of the
//! renderer.

use super::entries::Entries;
use eframe::egui;
use egui::{Color32, Pos2, RichText, Stroke, Ui};
use granita_view::Panel;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The distance in points within which a light is grabbed.
const GRAB: f32 = 12.0;
/// The time for which a control keeps its own value, until the renderer has taken it.
pub(super) const ECHO: Duration = Duration::from_millis(400);

/// What is dragged in the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pointing {
    /// The position of the chosen light.
    Move,
    /// The end of its axis.
    Aim,
}

/// The state of the desk.
#[derive(Default)]
pub(crate) struct Desk {
    /// The name of the live image with the panel.
    pub(super) image: Option<String>,
    panel: Arc<Panel>,
    parts: BTreeMap<String, Value>,
    /// The id of the light whose controls are open.
    pub(super) chosen: Option<String>,
    /// What the next drag in the image does.
    mode: Option<Pointing>,
    /// True while edits belong to one step.
    pub(super) dragging: bool,
    /// The values of controls that the renderer may not have taken yet.
    pub(super) own: BTreeMap<String, (Value, Instant)>,
    /// The texts that are being entered, and the fields that take text.
    texts: BTreeMap<String, String>,
    pub(super) fields: Vec<egui::Id>,
    shader: String,
    pub(super) edits: Vec<Value>,
}

impl Desk {
    /// Takes the panel of the current image, or of the first image that has one.
    pub(super) fn refresh(&mut self, entries: &Entries) {
        let live = entries.live();
        let names = std::iter::once(entries.name(entries.current)).chain(live.names());
        let found = names.filter_map(|name| live.info(&name)).find(|info| !info.panel.is_empty());
        let Some(info) = found else {
            *self = Self::default();
            return;
        };
        if self.image.as_ref() != Some(&info.name) {
            *self = Self { image: Some(info.name.clone()), ..Self::default() };
        }
        if Arc::ptr_eq(&self.panel, &info.panel) {
            return;
        }
        for (part, text) in info.panel.iter() {
            if self.panel.get(part) != Some(text) {
                // A sender of another kind may send anything.
                let value = serde_json::from_str(text).unwrap_or(Value::Null);
                self.parts.insert(part.clone(), value);
            }
        }
        self.parts.retain(|part, _| info.panel.contains_key(part));
        self.panel = info.panel;
    }

    /// True when an image has a panel.
    pub(crate) fn is_open(&self) -> bool {
        self.image.is_some()
    }

    /// True when the user enters text into a field of the desk.
    pub(crate) fn is_typing(&self, ctx: &egui::Context) -> bool {
        ctx.memory(|m| m.focused()).is_some_and(|id| self.fields.contains(&id))
    }

    pub(super) fn part(&self, name: &str) -> &Value {
        self.parts.get(name).unwrap_or(&Value::Null)
    }

    fn lights(&self) -> Vec<Value> {
        let ids = self.part("state")["lights"].as_array().into_iter().flatten();
        ids.filter_map(|id| self.parts.get(&format!("light/{}", id.as_str()?)).cloned()).collect()
    }

    pub(super) fn light(&self, id: &str) -> &Value {
        self.part(&format!("light/{id}"))
    }

    /// Adds an edit. While a button of the pointer is pressed, it belongs to a drag.
    fn edit(&mut self, ctx: &egui::Context, edit: Value) {
        if ctx.input(|i| i.pointer.any_down()) && !self.dragging {
            self.dragging = true;
            self.edits.push(json!({"do": "begin"}));
        }
        self.edits.push(edit);
    }

    /// Returns the lines of the panel for scripts.
    pub(crate) fn lines(&self) -> Vec<String> {
        if self.image.is_none() {
            return Vec::new();
        }
        let state = self.part("state");
        let light = |light: &Value| {
            let params = light["layers"][0]["params"].as_array().into_iter().flatten();
            let set = params.filter(|p| p["set"] == true);
            let set: Vec<String> =
                set.map(|p| format!("{}={}", p["name"].as_str().unwrap_or(""), p["value"])).collect();
            format!(
                "desk: {} {} {}{}",
                light["id"].as_str().unwrap_or(""),
                if light["lit"] == true { "lit" } else { "dark" },
                if light["changed"] == true { "edited " } else { "" },
                set.join(" ")
            )
        };
        let mut lines = vec![format!("desk: {}", state["status"].as_str().unwrap_or("none"))];
        lines.extend(state["message"]["text"].as_str().map(|text| format!("desk: {text}")));
        lines.extend(self.lights().iter().map(light));
        lines
    }
}

impl Desk {
    /// Shows the panel. `wipes` is true while the image before is compared. Returns the name of the image before when
    /// the user begins or ends the comparison.
    pub(super) fn contents(&mut self, wipes: bool, ui: &mut Ui) -> Option<String> {
        let compared = self.header(wipes, ui);
        ui.separator();
        for light in self.lights() {
            self.lamp(&light, ui);
        }
        compared
    }

    /// Shows the status, undo, the list of shaders and the file.
    fn header(&mut self, wipes: bool, ui: &mut Ui) -> Option<String> {
        let mut compared = None;
        let ctx = ui.ctx().clone();
        let (state, constant) = (self.part("state").clone(), self.part("desk").clone());
        let word = match state["status"].as_str() {
            Some("preparing") => "up to date, preparing drags",
            Some("coarse") => "rendering, coarse",
            Some("final") => "rendering",
            _ => "up to date",
        };
        ui.horizontal(|ui| {
            ui.label(RichText::new(word).weak());
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let before = state["before"].as_str();
                let button = egui::Button::new("Before").selected(wipes);
                if ui.add_enabled(before.is_some(), button).clicked() {
                    compared = before.map(str::to_owned);
                }
            });
        });
        if let Some(text) = state["message"]["text"].as_str() {
            let error = state["message"]["error"] == true;
            let color =
                if error { Color32::from_rgb(255, 150, 140) } else { Color32::from_rgb(150, 220, 160) };
            ui.label(RichText::new(text).color(color));
        }
        ui.horizontal(|ui| {
            for (word, text, name) in [("undo", "Undo", &state["undo"]), ("redo", "Redo", &state["redo"])] {
                let label = name.as_str();
                let button = ui.add_enabled(label.is_some(), egui::Button::new(text));
                if button.on_hover_text(label.unwrap_or_default()).clicked() {
                    self.edit(&ctx, json!({"do": word}));
                }
            }
            let shaders: Vec<String> = constant["shaders"]
                .as_array()
                .into_iter()
                .flatten()
                .filter_map(|name| name.as_str().map(str::to_owned))
                .collect();
            if !shaders.contains(&self.shader) {
                let usual = shaders.iter().find(|name| *name == "spotlight").or(shaders.first());
                self.shader = usual.cloned().unwrap_or_default();
            }
            egui::ComboBox::from_id_salt("shader").width(110.0).selected_text(&*self.shader).show_ui(
                ui,
                |ui| {
                    for name in &shaders {
                        ui.selectable_value(&mut self.shader, name.clone(), name);
                    }
                },
            );
            if ui.button("Add").clicked() {
                self.edit(&ctx, json!({"do": "add", "shader": self.shader}));
            }
        });
        ui.horizontal(|ui| {
            let file = constant["file"].as_str().unwrap_or_default();
            let text = self.texts.entry("file".to_owned()).or_insert_with(|| file.to_owned());
            let field = ui.add(egui::TextEdit::singleline(text).desired_width(190.0));
            let text = text.clone();
            self.fields.push(field.id);
            if ui.button(if state["saved"] == true { "Saved" } else { "Save" }).clicked() {
                self.edit(&ctx, json!({"do": "save", "file": text}));
            }
            if ui.button("End").on_hover_text("Ends the renderer").clicked() {
                self.edit(&ctx, json!({"do": "quit"}));
            }
        });
        compared
    }

    /// Shows a light.
    fn lamp(&mut self, light: &Value, ui: &mut Ui) {
        let Some(id) = light["id"].as_str() else { return };
        let ctx = ui.ctx().clone();
        let open = self.chosen.as_deref() == Some(id);
        ui.horizontal(|ui| {
            let mark = match (light["added"] == true, light["changed"] == true) {
                (true, _) => "  new",
                (_, true) => "  edited",
                _ => "",
            };
            let mut text = RichText::new(format!("{id}{mark}"));
            if light["lit"] != true {
                text = text.weak();
            }
            if ui.selectable_label(open, text.strong()).clicked() {
                self.chosen = if open { None } else { Some(id.to_owned()) };
                self.mode = None;
            }
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                for word in ["solo", "on"] {
                    let is = light[word] == true;
                    if ui.add(egui::Button::new(word).selected(is)).clicked() {
                        self.edit(&ctx, json!({"do": word, "light": id, "value": !is}));
                    }
                }
            });
        });
        if open {
            self.tools(id, light, ui);
            ui.push_id(id, |ui| self.controls(id, light, ui));
            ui.separator();
        }
    }

    /// Shows the buttons of the chosen light.
    fn tools(&mut self, id: &str, light: &Value, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        ui.horizontal(|ui| {
            let modes = [
                ("Aim", Pointing::Aim, light["direction"].is_array()),
                ("Move", Pointing::Move, light["emission"] == "position"),
            ];
            for (text, mode, fits) in modes {
                let on = self.mode == Some(mode);
                if fits && ui.add(egui::Button::new(text).selected(on)).clicked() {
                    self.mode = (!on).then_some(mode);
                }
            }
            for (text, word) in [("Copy", "copy"), ("Restore", "restore"), ("Delete", "delete")] {
                let fits = word != "restore" || light["changed"] == true;
                if fits && ui.button(text).clicked() {
                    self.edit(&ctx, json!({"do": word, "light": id}));
                }
            }
        });
    }

    /// Shows the parameters of a light, its place, and the objects that it illuminates.
    fn controls(&mut self, id: &str, light: &Value, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        for (k, layer) in light["layers"].as_array().into_iter().flatten().enumerate() {
            ui.label(RichText::new(layer["shader"].as_str().unwrap_or_default()).weak());
            if let Some(text) = layer["error"].as_str() {
                ui.label(RichText::new(text).color(Color32::from_rgb(255, 150, 140)));
            }
            egui::Grid::new(("params", k)).num_columns(2).min_col_width(96.0).spacing([8.0, 3.0]).show(
                ui,
                |ui| {
                    for param in layer["params"].as_array().into_iter().flatten() {
                        let Some(name) = param["name"].as_str() else { continue };
                        let label = param["label"].as_str().unwrap_or(name);
                        let mut text = RichText::new(label);
                        if param["set"] != true {
                            text = text.weak();
                        }
                        let sense = egui::Sense::click();
                        let word = ui.add(egui::Label::new(text).truncate().sense(sense));
                        if word.on_hover_text(help(param)).clicked() && param["set"] == true {
                            self.edit(&ctx, json!({"do": "reset", "light": id, "layer": k, "param": name}));
                        }
                        let key = format!("{id}/{k}/{name}");
                        if let Some(value) = self.control(&key, param, ui) {
                            let edit =
                                json!({"do": "set", "light": id, "layer": k, "param": name, "value": value});
                            self.edit(&ctx, edit);
                        }
                        ui.end_row();
                    }
                },
            );
        }
        egui::Grid::new("place").num_columns(2).min_col_width(96.0).spacing([8.0, 3.0]).show(ui, |ui| {
            let mut shown = Vec::new();
            if light["emission"] == "position" {
                shown.push(("position", None));
            }
            if light["direction"].is_array() {
                shown.extend([("direction", Some((0, "around"))), ("direction", Some((1, "above")))]);
            }
            for (word, angle) in shown {
                ui.label(RichText::new(angle.map_or(word, |(_, name)| name)).weak());
                let key = format!("{id}/{word}{angle:?}");
                let all = &light[word];
                let param = match angle {
                    Some((k, _)) => {
                        let most = if k == 0 { 180.0 } else { 90.0 };
                        json!({"type": "float", "value": all[k], "softmin": -most, "softmax": most})
                    }
                    None => json!({"type": "point", "value": all}),
                };
                if let Some(new) = self.control(&key, &param, ui) {
                    let mut value = all.clone();
                    match angle {
                        Some((k, _)) => value[k] = new,
                        None => value = new,
                    }
                    self.edit(&ctx, json!({"do": word, "light": id, "value": value}));
                }
                ui.end_row();
            }
        });
        self.objects(id, light, ui);
    }

    /// Shows the rules of a light for objects.
    fn objects(&mut self, id: &str, light: &Value, ui: &mut Ui) {
        let ctx = ui.ctx().clone();
        let objects = self.part("objects");
        let (lit, count) = (objects["lit"][id].as_u64().unwrap_or(0), objects["count"].as_u64().unwrap_or(0));
        ui.label(RichText::new(format!("Illuminates {lit} of {count} objects")).weak());
        for (index, rule) in light["rules"].as_array().into_iter().flatten().enumerate() {
            ui.horizontal(|ui| {
                let pattern = rule["pattern"].as_str().filter(|p| !p.is_empty()).unwrap_or("(all)");
                ui.monospace(pattern);
                ui.label(if rule["on"] == true { "lit" } else { "unlit" });
                if ui.small_button("\u{d7}").clicked() {
                    self.edit(&ctx, json!({"do": "unlink", "light": id, "index": index}));
                }
            });
        }
        ui.horizontal(|ui| {
            let text = self.texts.entry(format!("pattern/{id}")).or_default();
            let field = ui.add(egui::TextEdit::singleline(text).hint_text("pattern").desired_width(150.0));
            let pattern = text.clone();
            self.fields.push(field.id);
            for (word, value) in [("lit", true), ("unlit", false)] {
                if ui.button(word).clicked() {
                    self.edit(&ctx, json!({"do": "link", "light": id, "pattern": pattern, "value": value}));
                }
            }
        });
    }

    /// Shows a parameter. Returns its new value when the user changed it.
    fn control(&mut self, key: &str, param: &Value, ui: &mut Ui) -> Option<Value> {
        let own = self.own.get(key).map(|(value, _)| value.clone());
        let value = own.unwrap_or_else(|| param["value"].clone());
        let new = match (param["type"].as_str()?, &value) {
            ("float", Value::Number(number)) => self.float(param, number.as_f64()?, ui),
            ("color" | "point" | "vector" | "normal", Value::Array(list)) if list.len() == 3 => {
                self.triple(param["type"] == "color", list, ui)
            }
            (kind, _) => return self.text(key, kind.starts_with("string"), &value, ui),
        }?;
        self.own.insert(key.to_owned(), (new.clone(), Instant::now()));
        Some(new)
    }

    fn float(&mut self, param: &Value, old: f64, ui: &mut Ui) -> Option<Value> {
        let widget = param["widget"].as_str().unwrap_or_default();
        if widget == "bool" {
            let mut on = old != 0.0;
            return ui.checkbox(&mut on, "").changed().then(|| json!(u8::from(on)));
        }
        let mut value = old;
        if let Some(list) = widget.strip_prefix("enum:") {
            let options: Vec<(&str, f64)> = list
                .split(',')
                .enumerate()
                .map(|(i, word)| {
                    let (name, value) = word.split_once('=').unwrap_or((word, ""));
                    (name, value.parse().unwrap_or(i as f64))
                })
                .collect();
            let shown = options.iter().find(|(_, v)| *v == old).map_or("", |(name, _)| name);
            let id = ui.next_auto_id();
            egui::ComboBox::from_id_salt(id).selected_text(shown).show_ui(ui, |ui| {
                for (name, v) in &options {
                    ui.selectable_value(&mut value, *v, *name);
                }
            });
            return (value != old).then(|| json!(value));
        }
        let (low, high) = range(param, old);
        ui.spacing_mut().slider_width = 110.0;
        let mut slider = egui::Slider::new(&mut value, low..=high).clamping(egui::SliderClamping::Never);
        if widget == "int" {
            slider = slider.step_by(1.0);
        }
        let response = ui.add(slider.max_decimals(4));
        self.fields.push(response.id);
        response.changed().then(|| json!(value as f32))
    }

    fn triple(&mut self, is_color: bool, list: &[Value], ui: &mut Ui) -> Option<Value> {
        let mut v = [0, 1, 2].map(|k| list[k].as_f64().unwrap_or(0.0) as f32);
        let mut changed = false;
        ui.horizontal(|ui| {
            if is_color {
                // Colours brighter than the screen keep their brightness.
                let most = v.iter().copied().fold(1.0, f32::max);
                let mut shown = v.map(|v| v / most);
                if ui.color_edit_button_rgb(&mut shown).changed() {
                    v = shown.map(|v| v * most);
                    changed = true;
                }
            }
            for v in &mut v {
                let response = ui.add(egui::DragValue::new(v).speed(0.01).max_decimals(4));
                self.fields.push(response.id);
                changed |= response.changed();
            }
        });
        changed.then(|| json!(v))
    }

    fn text(&mut self, key: &str, is_text: bool, value: &Value, ui: &mut Ui) -> Option<Value> {
        let shown = match value {
            Value::String(text) => text.clone(),
            Value::Array(list) => {
                let words = list.iter().map(|v| v.as_str().map_or_else(|| v.to_string(), str::to_owned));
                words.collect::<Vec<_>>().join(", ")
            }
            other => other.to_string(),
        };
        let text = self.texts.entry(key.to_owned()).or_insert_with(|| shown.clone());
        let field = ui.add(egui::TextEdit::singleline(text).desired_width(190.0));
        self.fields.push(field.id);
        let text = text.clone();
        if field.has_focus() {
            return None;
        }
        self.texts.remove(key);
        if !field.lost_focus() || text == shown {
            return None;
        }
        if !value.is_array() {
            return Some(Value::String(text));
        }
        let words = text.split(',').map(str::trim);
        Some(match is_text {
            true => words.collect(),
            false => words.map(|word| word.parse::<f64>().map_or(Value::Null, |v| json!(v))).collect(),
        })
    }

    /// Returns the pixel at a point of the window, if a drag there is one of the chosen light.
    pub(crate) fn grabbed(&mut self, points: &dyn Fn(&Value) -> Option<Pos2>, pos: Pos2) -> Option<Pointing> {
        if !self.is_open() {
            return None;
        }
        let is_near = |at: &Value| points(at).is_some_and(|p| (p - pos).length() < GRAB);
        if let Some(id) = &self.chosen {
            if is_near(&self.light(id)["toward"]) {
                return Some(Pointing::Aim);
            }
            if self.mode.is_some() {
                return self.mode;
            }
        }
        let near =
            self.lights().into_iter().find(|light| light["emission"] == "position" && is_near(&light["at"]));
        let id = near?["id"].as_str()?.to_owned();
        self.chosen = Some(id);
        Some(Pointing::Move)
    }

    /// Moves or aims the chosen light at pixels of the image.
    pub(crate) fn point(&mut self, pointing: Pointing, at: (f64, f64), ctx: &egui::Context) {
        let Some(id) = self.chosen.clone() else { return };
        let word = match pointing {
            Pointing::Move => "place",
            Pointing::Aim => "aim",
        };
        self.edit(ctx, json!({"do": word, "light": id, "at": [at.0, at.1]}));
    }

    /// Ends a drag in the image.
    pub(crate) fn release(&mut self) {
        if self.mode == Some(Pointing::Aim) {
            self.mode = None;
        }
    }

    /// Draws the lights over the image.
    pub(crate) fn paint(&self, painter: &egui::Painter, points: &dyn Fn(&Value) -> Option<Pos2>) {
        for light in self.lights().iter().filter(|light| light["emission"] == "position") {
            let Some(at) = points(&light["at"]) else { continue };
            let id = light["id"].as_str().unwrap_or_default();
            let chosen = self.chosen.as_deref() == Some(id);
            let blue = Color32::from_rgb(110, 193, 255);
            if let (true, Some(end)) = (chosen, points(&light["toward"])) {
                painter.line_segment([at, end], Stroke::new(4.0, Color32::from_black_alpha(160)));
                painter.line_segment([at, end], Stroke::new(2.0, blue));
                painter.circle(end, 5.0, blue, Stroke::new(1.5, Color32::BLACK));
            }
            let lit = light["lit"] == true;
            let fill = if lit { color(light) } else { Color32::from_black_alpha(120) };
            painter.circle(at, 8.5, fill, Stroke::new(3.5, Color32::BLACK));
            painter.circle_stroke(at, 8.5, Stroke::new(2.0, if chosen { blue } else { Color32::WHITE }));
            if chosen {
                let (anchor, font) = (egui::Align2::LEFT_CENTER, egui::FontId::proportional(12.0));
                let place = at + egui::Vec2::new(14.0, 0.0);
                painter.text(place + egui::Vec2::splat(1.0), anchor, id, font.clone(), Color32::BLACK);
                painter.text(place, anchor, id, font, Color32::WHITE);
            }
        }
    }
}

/// Returns the description of a parameter.
fn help(param: &Value) -> String {
    let text = |word: &str| param[word].as_str().unwrap_or_default();
    let units = if text("units").is_empty() { String::new() } else { format!(" ({})", text("units")) };
    format!("{}{units} [{} {}]", text("help"), text("type"), text("name"))
}

/// Returns the range of a slider: that of the shader, or one around the value.
fn range(param: &Value, value: f64) -> (f64, f64) {
    let number = |words: [&str; 2]| words.iter().find_map(|word| param[*word].as_f64());
    let default = param["default"].as_f64().unwrap_or(0.0);
    let size = value.abs().max(default.abs());
    let size = if size > 0.0 { size } else { 1.0 };
    let angle = param["units"] == "radians";
    let low = number(["softmin", "min"]).unwrap_or(match value < 0.0 || default < 0.0 {
        true if !angle => -2.0 * size,
        _ => 0.0,
    });
    let usual = if angle { std::f64::consts::PI } else { (2.0 * size).log2().ceil().exp2().max(low + 1.0) };
    (low, number(["softmax", "max"]).unwrap_or(usual))
}

/// Returns the first colour of a light, as on the screen.
fn color(light: &Value) -> Color32 {
    let layers = light["layers"].as_array().into_iter().flatten();
    let mut params = layers.flat_map(|layer| layer["params"].as_array().into_iter().flatten());
    let Some(found) = params.find(|p| p["type"] == "color" && p["value"].is_array()) else {
        return Color32::WHITE;
    };
    let v = [0, 1, 2].map(|k| found["value"][k].as_f64().unwrap_or(1.0) as f32);
    let most = v.iter().copied().fold(1.0, f32::max);
    let [r, g, b] = v.map(|v| v / most);
    egui::Rgba::from_rgb(r, g, b).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_contain_the_value() {
        for (param, value, expected) in [
            (json!({"min": 0.0}), 12.0, (0.0, 32.0)),
            (json!({"softmin": -1.0, "softmax": 3.0}), 2.0, (-1.0, 3.0)),
            (json!({"units": "radians"}), 0.5, (0.0, std::f64::consts::PI)),
            (json!({"default": -1.0}), 0.5, (-2.0, 2.0)),
            (json!({}), 0.0, (0.0, 2.0)),
        ] {
            assert_eq!(range(&param, value), expected, "{param}");
        }
    }
}
