//! The panels around and over the image. They show the status, the list, the measured values and the keys.

use super::app::App;
use super::keys;
use super::model::Model;
use crate::{info, still};
use eframe::egui;
use egui::{Align2, Color32, FontId, Pos2, RichText, Stroke, StrokeKind};
use granita_image::Pixels;
use granita_view::{Arrangement, Channels, ColorMap, Histogram, Mix};

/// The height of the status line, in points.
pub(crate) const STATUS: f32 = 24.0;

/// Returns a value as it is stored, and the value that it represents.
fn value_text(pixels: &Pixels, c: usize) -> String {
    match pixels {
        Pixels::U8(v) => format!("{} ({:.4})", v[c], pixels.get(c)),
        Pixels::U16(v) => format!("{} ({:.5})", v[c], pixels.get(c)),
        Pixels::U32(v) => v[c].to_string(),
        Pixels::Half(_) | Pixels::Float(_) => still::number(f64::from(pixels.get(c))),
    }
}

/// Returns the values under the pointer, as text.
fn readout(app: &mut App, ppp: f32) -> Option<String> {
    let pos = app.pointer.filter(|p| app.area.contains(*p))?;
    let (x, y) = app.in_area(pos, ppp);
    let (seen, level, px, py) = app.model.pixel_under(x, y)?;
    let spec = seen.page.spec();
    let place = if level == 0 {
        format!("{} {}", i64::from(px) + i64::from(spec.x), i64::from(py) + i64::from(spec.y))
    } else {
        format!("{px} {py} of level {level}")
    };
    // Values are read from memory only, so that the pointer does not wait for files.
    let tile = granita_view::TILE;
    let held = seen.page.pyramid.held(level, px / tile, py / tile)?;
    let at = ((py % tile) * held.width + px % tile) as usize * held.channels;
    let mut pixels = Pixels::zeros(held.pixels.pixel_type(), held.channels);
    pixels.copy_from(0, &held.pixels, at, held.channels);
    let layer = &seen.page.layers[seen.layer];
    let values: Vec<String> = layer
        .channels
        .iter()
        .map(|c| {
            let name = spec.channels[*c].rsplit('.').next().unwrap_or_default();
            format!("{name} {}", value_text(&pixels, *c))
        })
        .collect();
    Some(format!("[{place}]  {}", values.join("  ")))
}

/// Returns the text of the status line.
pub(crate) fn status(app: &mut App, ppp: f32) -> String {
    let pointer = readout(app, ppp);
    let model = &mut app.model;
    let (current, count) = (model.entries.current, model.entries.len());
    if count == 0 {
        return "no images: give files, or drop some here; ? lists the keys".to_owned();
    }
    let mut parts = vec![format!("{}/{count} {}", current + 1, model.entries.name(current))];
    if let Some(error) = model.entries.error(current) {
        parts.push(error.to_owned());
    }
    if let Some((pages, page)) = model.entries.page(current) {
        let spec = page.spec();
        let choice = model.entries.choice(current);
        parts.push(format!("{} x {} {}", spec.width, spec.height, spec.pixel_type.word()));
        if pages > 1 {
            let name = if page.name.is_empty() { String::new() } else { format!(" {}", page.name) };
            parts.push(format!("image {}/{pages}{name}", choice.page + 1));
        }
        let layer = choice.layer.min(page.layers.len() - 1);
        parts.push(page.layers[layer].title(&spec.channels));
        if !page.colors.text.is_empty() {
            parts.push(page.colors.text.clone());
        }
        if page.pyramid.stored_levels() > 1 {
            parts.push(format!("level {}/{}", choice.level, page.pyramid.stored_levels()));
        }
        if page.layout.is_some() {
            parts.push(match choice.arrangement.unwrap_or(page.arrangement()) {
                Arrangement::Stored => "as stored".to_owned(),
                Arrangement::Cross => "cross".to_owned(),
                Arrangement::Face(face) => {
                    format!("face {}", granita_texture::FACE_NAMES.get(face).unwrap_or(&"?"))
                }
            });
        }
        if page.fault().is_some() {
            parts.push("not all of it could be read".to_owned());
        }
    }
    let view = &model.view;
    parts.push(match view.around {
        Some(a) => format!("to {:.0} {:.0}, {:.0} degrees", a.yaw_deg, a.pitch_deg, a.fov_deg),
        None => {
            format!("{:.4}", view.zoom * 100.0).trim_end_matches('0').trim_end_matches('.').to_owned() + " %"
        }
    });
    let d = &model.display;
    if d.exposure != 0.0 {
        parts.push(format!("{:+} EV", d.exposure));
    }
    if d.gamma != 1.0 {
        parts.push(format!("gamma {:.1}", d.gamma));
    }
    if d.channels != Channels::Color {
        parts.push(format!("{:?}", d.channels).to_lowercase());
    }
    if let Some(f) = d.false_color {
        parts.push(f.map.word().to_owned());
    }
    match model.mix {
        Mix::First => {}
        Mix::Second => parts.push("the other".to_owned()),
        Mix::Wipe { .. } => parts.push("wipe".to_owned()),
        Mix::Difference { gain } => parts.push(format!("difference x{gain}")),
        Mix::Over => parts.push("over".to_owned()),
        Mix::Flip => parts.push("FLIP map".to_owned()),
    }
    if let Some(note) = model.entries.live_info(current).and_then(|i| i.note.clone()) {
        parts.push(note);
    }
    parts.extend(pointer);
    parts.join("  \u{b7}  ")
}

/// Returns lines with the available results for the probe and the comparison.
pub(crate) fn numbers(model: &mut Model) -> Vec<String> {
    let answers = model.answers();
    let mut lines = Vec::new();
    let current = model.entries.current;
    lines.extend(model.entries.page(current).and_then(|(_, page)| page.fault()));
    if let (Some(found), Some(part), Some((_, page))) =
        (&answers.probe, model.probe, model.entries.page(current))
    {
        let title = format!("area of {} x {} at {} {}", part.width(), part.height(), part.x0, part.y0);
        match found {
            Ok(found) => {
                lines.push(title);
                let table = still::statistics_table(&page.spec().channels, found);
                lines.extend(table.lines().map(str::to_owned));
            }
            Err(what) => lines.push(what.clone()),
        }
    }
    if let Some(found) = &answers.comparison {
        match found {
            Ok(c) => {
                let other = model.other.map(|o| model.entries.name(o)).unwrap_or_default();
                let psnr =
                    if c.psnr.is_finite() { format!("{:.2} dB", c.psnr) } else { "infinite".to_owned() };
                lines.push(format!("against {other}"));
                lines.push(format!(
                    "  RMS {}  PSNR {psnr}  max {}",
                    still::number(c.rms),
                    still::number(c.max.into())
                ));
                if let Some((mean, max)) = c.flip {
                    lines.push(format!("  FLIP {mean:.5} (largest {max:.4})"));
                }
                let pixels = f64::from(c.size.0) * f64::from(c.size.1);
                lines
                    .push(format!("  {:.3} % of the pixels differ", 100.0 * c.pixels_beyond as f64 / pixels));
            }
            Err(what) => lines.push(what.clone()),
        }
    }
    lines
}

fn histogram_plot(ui: &mut egui::Ui, histogram: &Histogram, grey: bool) {
    let size = egui::Vec2::new(ui.available_width().min(256.0), 90.0);
    let (rect, _) = ui.allocate_exact_size(size, egui::Sense::hover());
    let painter = ui.painter();
    painter.rect_filled(rect, 0.0, Color32::from_gray(12));
    let most = histogram.bins.iter().flatten().copied().max().unwrap_or(0).max(1);
    let colors =
        [Color32::from_rgb(230, 70, 60), Color32::from_rgb(80, 200, 80), Color32::from_rgb(80, 120, 255)];
    let planes = if grey { 1 } else { 3 };
    for (bins, color) in histogram.bins.iter().zip(colors).take(planes) {
        let color = if grey { Color32::from_gray(200) } else { color.gamma_multiply(0.7) };
        let width = rect.width() / bins.len() as f32;
        for (i, n) in bins.iter().enumerate().filter(|(_, n)| **n > 0) {
            // The logarithm keeps rare values visible.
            let share = (f64::from(*n).ln_1p() / f64::from(most).ln_1p()) as f32;
            let x = rect.left() + (i as f32 + 0.5) * width;
            let line = [Pos2::new(x, rect.bottom()), Pos2::new(x, rect.bottom() - share * rect.height())];
            painter.line_segment(line, Stroke::new(width.max(1.0), color));
        }
    }
    let low = still::number(f64::from(histogram.low));
    let high = still::number(f64::from(histogram.high));
    let font = FontId::monospace(10.0);
    let text = Color32::from_gray(220);
    painter.text(rect.left_top(), Align2::LEFT_TOP, low, font.clone(), text);
    painter.text(rect.right_top(), Align2::RIGHT_TOP, high, font, text);
}

/// Draws the colours of the map, from its lower to its upper end.
fn scale(ui: &mut egui::Ui, map: ColorMap) {
    let size = egui::Vec2::new(ui.available_width().min(256.0), 12.0);
    let (rect, _) = ui.allocate_exact_size(size, egui::Sense::hover());
    gradient(ui.painter(), rect, map);
}

/// Draws the colours of a scale from left to right.
fn gradient(painter: &egui::Painter, rect: egui::Rect, map: ColorMap) {
    for i in 0..64 {
        let [r, g, b] = map.at((i as f32 + 0.5) / 64.0);
        let left = rect.left() + rect.width() * i as f32 / 64.0;
        let part = egui::Rect::from_min_size(
            Pos2::new(left, rect.top()),
            egui::Vec2::new(rect.width() / 64.0 + 0.5, rect.height()),
        );
        painter.rect_filled(part, 0.0, Color32::from_rgb(r, g, b));
    }
}

/// Shows the panels at the edges of the window.
pub(crate) fn around(app: &mut App, ui: &mut egui::Ui) {
    let ppp = ui.ctx().pixels_per_point();
    let line = status(app, ppp);
    egui::Panel::bottom("status").exact_size(STATUS).show(ui, |ui| {
        ui.add(egui::Label::new(RichText::new(line).size(12.0)).truncate());
    });
    if app.model.list_open {
        egui::Panel::left("list").default_size(220.0).show(ui, |ui| list(app, ui));
    }
    if app.model.side_open {
        egui::Panel::right("side").default_size(300.0).show(ui, |ui| side(app, ui));
    }
}

fn list(app: &mut App, ui: &mut egui::Ui) {
    let groups = app.model.entries.groups();
    // The rows have equal height. Of thousands of rows, only those in sight are laid out.
    let rows: Vec<Result<usize, &str>> = groups
        .iter()
        .flat_map(|g| {
            let title = if g.title.is_empty() { "." } else { &*g.title };
            std::iter::once(Err(title)).chain((g.first..g.first + g.count).map(Ok))
        })
        .collect();
    let mut chosen = None;
    egui::ScrollArea::vertical().auto_shrink(false).show_rows(ui, 18.0, rows.len(), |ui, range| {
        for row in &rows[range] {
            match row {
                Err(title) => {
                    ui.add(egui::Label::new(RichText::new(*title).size(11.0).weak()).truncate());
                }
                Ok(entry) => {
                    let name = app.model.entries.name(*entry);
                    let live = if app.model.entries.is_live(*entry) { " (live)" } else { "" };
                    let other = if app.model.other == Some(*entry) { " (other)" } else { "" };
                    let text = RichText::new(format!("{name}{live}{other}")).size(12.0);
                    if ui.selectable_label(*entry == app.model.entries.current, text).clicked() {
                        chosen = Some(*entry);
                    }
                }
            }
        }
    });
    if let Some(entry) = chosen {
        app.model.show(entry);
    }
}

fn side(app: &mut App, ui: &mut egui::Ui) {
    let answers = app.model.answers();
    let current = app.model.entries.current;
    egui::ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        if let Some(histogram) = &answers.histogram {
            let one = app.model.display.channels != Channels::Color
                && app.model.display.channels != Channels::Luminance;
            histogram_plot(ui, histogram, one);
            if let Some(f) = app.model.display.false_color {
                scale(ui, f.map);
            }
        }
        for line in numbers(&mut app.model) {
            ui.label(RichText::new(line).monospace().size(10.5));
        }
        if let Some(image) = app.model.entries.image(current) {
            ui.separator();
            ui.label(RichText::new(info::text(image, &[])).monospace().size(10.5));
        }
    });
}

/// Draws over the image.
pub(crate) fn over(app: &mut App, ui: &mut egui::Ui) {
    let ppp = ui.ctx().pixels_per_point();
    let painter = ui.painter_at(app.area);
    let current = app.model.entries.current;
    let seen = app.model.seen(current);
    let area = app.area;
    if let Some(seen) = &seen
        && app.model.view.around.is_none()
    {
        let view = app.model.view;
        let point = |x: f64, y: f64| {
            let (x, y) = view.to_screen(x, y);
            area.min + egui::Vec2::new(x as f32, y as f32) / ppp
        };
        let spec = seen.page.spec();
        // Rectangles of pixels are shown only when the pixels are arranged as they are stored.
        let origin = (f64::from(spec.x), f64::from(spec.y));
        let frame = |x0: f64, y0: f64, x1: f64, y1: f64, color: Color32| {
            let rect = egui::Rect::from_min_max(point(x0, y0), point(x1, y1));
            painter.rect_stroke(rect, 0.0, Stroke::new(1.0, color), StrokeKind::Outside);
        };
        let plain = seen.sheet.patches.len() == 1 && seen.page.layout.is_none();
        let pixels = |r: &granita_image::PixelRect, color: Color32| {
            let (x0, y0) = (origin.0 + f64::from(r.x0), origin.1 + f64::from(r.y0));
            frame(x0, y0, origin.0 + f64::from(r.x1), origin.1 + f64::from(r.y1), color);
        };
        if plain {
            let display = (spec.full_x, spec.full_y, spec.full_width, spec.full_height);
            if display != (spec.x, spec.y, spec.width, spec.height) {
                let (x, y) = (f64::from(display.0), f64::from(display.1));
                let (w, h) = (f64::from(display.2), f64::from(display.3));
                frame(x, y, x + w, y + h, Color32::from_rgb(90, 130, 90));
            }
            if let Some(part) = &app.model.probe {
                pixels(part, Color32::from_rgb(255, 220, 80));
            }
            if let Some(info) = app.model.entries.live_info(current) {
                for mark in &info.marks {
                    pixels(mark, Color32::from_rgb(255, 140, 40));
                }
            }
        }
    }
    if let Mix::Wipe { at, down } = app.model.mix {
        let (a, b) = if down {
            let y = area.top() + at * area.height();
            (Pos2::new(area.left(), y), Pos2::new(area.right(), y))
        } else {
            let x = area.left() + at * area.width();
            (Pos2::new(x, area.top()), Pos2::new(x, area.bottom()))
        };
        painter.line_segment([a, b], Stroke::new(1.0, Color32::from_white_alpha(160)));
    }
    if app.model.mix == Mix::Flip {
        key_of_flip(&painter, area);
    }
    if app.model.view.around.is_none() && app.model.entries.is_live(current) {
        app.desk.paint(&painter, &|at| app.pixel_point(at, ppp));
    }
    boxes(app, &painter);
    help_and_prompt(app, ui);
}

/// Draws the key of the colours of a FLIP map.
fn key_of_flip(painter: &egui::Painter, area: egui::Rect) {
    let place = egui::Rect::from_min_size(
        area.left_bottom() + egui::Vec2::new(12.0, -44.0),
        egui::Vec2::new(200.0, 12.0),
    );
    painter.rect_filled(place.expand2(egui::Vec2::new(8.0, 20.0)), 3.0, Color32::from_black_alpha(190));
    gradient(painter, place, ColorMap::Magma);
    let text = |at: Pos2, anchor: Align2, text: &str| {
        painter.text(at, anchor, text, FontId::monospace(11.0), Color32::from_gray(235));
    };
    text(place.left_bottom() + egui::Vec2::new(0.0, 3.0), Align2::LEFT_TOP, "0 alike");
    text(place.right_bottom() + egui::Vec2::new(0.0, 3.0), Align2::RIGHT_TOP, "1");
    text(place.center_top() - egui::Vec2::new(0.0, 3.0), Align2::CENTER_BOTTOM, "FLIP");
}

/// Draws lines of text at the edges and in the centre of the image area.
fn boxes(app: &mut App, painter: &egui::Painter) {
    let write = |at: Pos2, anchor: Align2, text: &str| {
        let font = FontId::monospace(11.5);
        let galley = painter.layout_no_wrap(text.to_owned(), font, Color32::from_gray(235));
        let rect = anchor.anchor_size(at, galley.size());
        painter.rect_filled(rect.expand(5.0), 3.0, Color32::from_black_alpha(190));
        painter.galley(rect.min, galley, Color32::WHITE);
    };
    let area = app.area;
    if !app.model.side_open {
        let lines = numbers(&mut app.model);
        if !lines.is_empty() {
            write(area.left_top() + egui::Vec2::splat(10.0), Align2::LEFT_TOP, &lines.join("\n"));
        }
    }
    let current = app.model.entries.current;
    let error = app.model.entries.error(current).map(str::to_owned);
    if let Some(text) = error {
        write(area.center(), Align2::CENTER_CENTER, &text);
    } else if app.model.entries.len() == 0 {
        write(area.center(), Align2::CENTER_CENTER, "iv  \u{b7}  drop images here  \u{b7}  ? lists the keys");
    }
    if let Some(note) = app.model.entries.live_info(current).and_then(|i| i.note.clone()) {
        write(area.center_top() + egui::Vec2::new(0.0, 10.0), Align2::CENTER_TOP, &note);
    }
    if let Some((text, _)) = &app.model.message {
        write(area.center_bottom() - egui::Vec2::new(0.0, 12.0), Align2::CENTER_BOTTOM, text);
    }
}

fn help_and_prompt(app: &mut App, ui: &mut egui::Ui) {
    let ctx = ui.ctx().clone();
    if app.model.help_open {
        egui::Area::new(egui::Id::unique("help")).anchor(Align2::CENTER_CENTER, egui::Vec2::ZERO).show(
            &ctx,
            |ui| {
                egui::Frame::popup(ui.style()).show(ui, |ui| {
                    let height = (app.area.height() - 60.0).max(80.0);
                    // The area is as high as the keys are, if the window is high enough. By default it would scroll in
                    // half of the window.
                    let scrolled =
                        egui::ScrollArea::vertical().max_height(height).min_scrolled_height(height);
                    scrolled.show(ui, |ui| {
                        ui.spacing_mut().interact_size.y = 0.0;
                        egui::Grid::new("keys").num_columns(4).spacing([14.0, 2.0]).show(ui, |ui| {
                            let rows = help_rows();
                            let half = rows.len().div_ceil(2);
                            for i in 0..half {
                                for row in [rows.get(i), rows.get(half + i)].into_iter().flatten() {
                                    match row {
                                        Ok((keys, text)) => {
                                            ui.label(RichText::new(keys).monospace().size(11.0).strong());
                                            ui.label(RichText::new(*text).size(11.0));
                                        }
                                        Err(title) => {
                                            ui.label("");
                                            ui.label(RichText::new(*title).size(12.0).strong());
                                        }
                                    }
                                }
                                ui.end_row();
                            }
                        });
                    });
                });
            },
        );
    }
    let Some(mut prompt) = app.prompt.take() else { return };
    let mut done = None;
    egui::Area::new(egui::Id::unique("prompt"))
        .anchor(Align2::CENTER_BOTTOM, egui::Vec2::new(0.0, -60.0))
        .show(&ctx, |ui| {
            egui::Frame::popup(ui.style()).show(ui, |ui| {
                ui.label(if prompt.pixels {
                    "save the values of this layer as"
                } else {
                    "save the image as shown, to"
                });
                let edit = ui.add(egui::TextEdit::singleline(&mut prompt.text).desired_width(420.0));
                if ui.input(|i| i.key_pressed(egui::Key::Enter)) {
                    done = Some(true);
                } else if ui.input(|i| i.key_pressed(egui::Key::Escape)) {
                    done = Some(false);
                } else {
                    edit.request_focus();
                }
            });
        });
    match done {
        None => app.prompt = Some(prompt),
        Some(true) => app.save(&prompt),
        Some(false) => {}
    }
}

/// Returns the titles of sections, and the keys with their descriptions.
fn help_rows() -> Vec<Result<(String, &'static str), &'static str>> {
    let mut rows = Vec::new();
    for (title, section) in keys::SECTIONS {
        rows.push(Err(title));
        let mut last: Option<(String, &'static str)> = None;
        for row in section {
            match &mut last {
                Some((keys, _)) if row.text.is_empty() => {
                    keys.push(' ');
                    keys.push_str(&keys::written(row.keys));
                }
                _ => {
                    rows.extend(last.take().map(Ok));
                    last = Some((keys::written(row.keys), row.text));
                }
            }
        }
        rows.extend(last.map(Ok));
    }
    rows
}
