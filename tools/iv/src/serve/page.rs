//! The messages between the server and a page in a browser. Text is JSON. Pixels are binary.
//!
//! The page sends `{"show": ID, "channels": [c ...]}` (at most four channels), `{"probe": [x, y]}`, and `{"detail": ID,
//! "scale": s, "rect": [x, y, width, height]}` for its visible part, see [`detail`](super::detail).
//!
//! For a desk for lighting it also sends `{"panel": ID}`, to receive the panel of an image, and `{"edit": {...},
//! "image": ID}`, which goes to the sender of the image unless this page only watches.
//!
//! The page receives text:
//!
//! - `{"images": [{id, name, width, height, channels, note, live, panel, edits} ...], "shown": ID}` whenever the list
//!   changes
//! - `{"image": ID, "scale": s, "width": w, "height": h, "channels": [c ...], "colors": text, "managed": m}` before the
//!   first pixels of an image. The text says what is assumed of its colours. With `"managed": true` its pixels are
//!   colours of linear light, else values as stored
//! - `{"marks": [[x, y, w, h] ...]}`
//! - `{"drawing": [[step, number ...] ...]}` with the steps of a canvas ("moveTo" ...)
//! - `{"probe": [x, y], "values": ["v" ...]}`
//! - `{"panel": ID, "all": a, "parts": {name: text ...}}` with the changed parts of a panel, which are JSON in a text,
//!   or null for parts that are gone. With `"all": true`, these are all parts
//!
//! The choice of a display and of a view, and their table, are described in [`look`](super::look).
//!
//! Pixels are little endian: `u32` id, `u32` 0 for floats or 1 for halves, `u32` x, y, width, height, `u32` number of
//! channels, `u32` scale, then the values row by row with interleaved channels. An image of more than
//! [`MOST_SIDE`](super::blocks::MOST_SIDE) pixels a side is sent in reduced form. Each of its pixels is then the mean
//! of `scale x scale` pixels, and positions and sizes are in the reduced pixels. Pixels of a smaller scale than the
//! image's are detail.

use super::blocks::{BLOCK, RECTS, blocks, parts, reduction};
use super::detail::Detail;
use super::look::{Look, are_colors, shown_channels};
use super::message::Message;
use granita_image::{Draw, PixelRect};
use granita_view::{Live, LiveInfo, Panel};
use half::f16;
use serde_json::{Value, json};
use std::sync::Arc;

/// The number of bytes of pixels after which messages of the page are read again.
const ROUND_BYTES: usize = 4 << 20;
/// The number of bytes before the values of a message of pixels.
const HEAD: usize = 32;

/// The state of a page.
pub(super) struct Page {
    live: Live,
    /// The version of the [`Live`] at the last update; `None` before the first one.
    version: Option<u64>,
    /// The id of the selected image; 0 before one is selected.
    chosen: u64,
    channels: Vec<usize>,
    /// The id and the generation of the image whose pixels were sent.
    known: Option<(u64, u64)>,
    /// The rectangles that must be sent.
    pending: Vec<PixelRect>,
    /// The visible part, where the image was sent in less than the full resolution.
    detail: Option<Detail>,
    marks: Vec<PixelRect>,
    drawing: Arc<Vec<Draw>>,
    list: Value,
    /// True when edits of the page are passed on.
    may_edit: bool,
    /// The id of the image whose panel the page shows, and the panel that it has; 0 for none.
    paneled: u64,
    panel: Option<Arc<Panel>>,
    look: Look,
}

impl Page {
    /// Returns a page with these colours. Its edits are passed on if `may_edit` is true.
    pub(super) fn new(live: Live, may_edit: bool, look: Look) -> Self {
        Self {
            live,
            version: None,
            chosen: 0,
            channels: Vec::new(),
            known: None,
            pending: Vec::new(),
            detail: None,
            marks: Vec::new(),
            drawing: Arc::default(),
            list: Value::Null,
            may_edit,
            paneled: 0,
            panel: None,
            look,
        }
    }

    /// Processes a message of the page. Returns the answer, if there is one. Invalid messages are ignored.
    pub(super) fn hear(&mut self, text: &str) -> Option<Message> {
        let value: Value = serde_json::from_str(text).ok()?;
        if let Some(id) = value["show"].as_u64() {
            let channels = value["channels"].as_array()?;
            let index = |c: &Value| c.as_u64().and_then(|c| usize::try_from(c).ok());
            self.channels = channels.iter().take(4).filter_map(index).collect();
            (self.chosen, self.known, self.detail) = (id, None, None);
            return None;
        }
        if self.look.choose(&value) {
            // All pixels are sent again.
            (self.known, self.detail) = (None, None);
            return None;
        }
        if let Some(id) = value["panel"].as_u64() {
            (self.paneled, self.panel) = (id, None);
            self.version = None;
            return None;
        }
        if value["edit"].is_object() {
            if self.may_edit
                && let Some(info) = self.info(value["image"].as_u64()?)
                && let Some(sender) = self.live.edits(&info.name)
            {
                sender.send(&value["edit"].to_string());
            }
            return None;
        }
        if let Some(id) = value["detail"].as_u64() {
            let (info, before) = (self.chosen().filter(|info| info.id == id), self.detail.take());
            self.detail = info.and_then(|info| Detail::asked(&value, &info, before));
            return None;
        }
        let [x, y] =
            [&value["probe"][0], &value["probe"][1]].map(|v| v.as_i64().and_then(|v| i32::try_from(v).ok()));
        let (x, y, info) = (x?, y?, self.chosen()?);
        let all: Vec<usize> = (0..info.channels.len()).collect();
        let values = self.live.read(&info.name, PixelRect::at(x, y, 1, 1), &all).ok()?;
        // JSON cannot express values that are not finite.
        let values: Vec<String> = values.iter().map(|v| format!("{v}")).collect();
        Some(Message::Text(json!({"probe": [x, y], "values": values}).to_string()))
    }

    /// Returns the selected image, while it exists.
    fn chosen(&self) -> Option<LiveInfo> {
        self.info(self.chosen)
    }

    fn info(&self, id: u64) -> Option<LiveInfo> {
        let infos = self.live.names().into_iter().filter_map(|name| self.live.info(&name));
        infos.into_iter().find(|info| info.id == id)
    }

    /// Returns the changes of the panel that the page shows.
    fn panel_news(&mut self) -> Option<Message> {
        let new = self.info(self.paneled)?.panel;
        if self.panel.as_ref().is_some_and(|old| Arc::ptr_eq(old, &new)) {
            return None;
        }
        let old = self.panel.replace(new.clone());
        let known = old.as_deref();
        let is_new =
            |(part, text): &(&String, &Arc<str>)| known.and_then(|old| old.get(*part)) != Some(*text);
        let mut parts: serde_json::Map<String, Value> =
            new.iter().filter(is_new).map(|(part, text)| (part.clone(), Value::from(&**text))).collect();
        let gone = known.into_iter().flat_map(Panel::keys).filter(|part| !new.contains_key(*part));
        parts.extend(gone.map(|part| (part.clone(), Value::Null)));
        let text = json!({"panel": self.paneled, "all": old.is_none(), "parts": parts}).to_string();
        Some(Message::Text(text))
    }

    /// True when more can be sent at once.
    pub(super) fn is_behind(&self) -> bool {
        !self.pending.is_empty() || self.detail.as_ref().is_some_and(Detail::is_behind)
    }

    /// Returns the version at the last update; 0 before the first one.
    pub(super) fn version(&self) -> u64 {
        self.version.unwrap_or(0)
    }

    /// Returns the pending messages for the page, up to a few megabytes.
    pub(super) fn news(&mut self) -> Vec<Message> {
        let version = self.live.version();
        let mut messages = self.look.news();
        let mut panel = None;
        if self.version != Some(version) {
            self.version = Some(version);
            let list = self.images();
            if list != self.list {
                messages.push(Message::Text(list.to_string()));
                self.list = list;
            }
            panel = self.panel_news();
        }
        self.image_news(&mut messages);
        // The panel was read before the pixels and follows them, so that what it reports of the image is visible. Only
        // of large images more pixels may be pending.
        messages.extend(panel);
        messages
    }

    /// Appends the changes of the selected image.
    fn image_news(&mut self, messages: &mut Vec<Message>) {
        let Some(info) = self.chosen() else {
            self.pending.clear();
            self.detail = None;
            return;
        };
        self.channels.retain(|c| *c < info.channels.len());
        if self.channels.is_empty() {
            self.channels = shown_channels(&info.channels);
        }
        let scale = reduction(&info);
        if self.known.is_none_or(|(id, _)| id != info.id) {
            let managed = are_colors(&info, &self.channels);
            let colors = if managed { self.look.text(&info) } else { "" };
            let text = json!({"image": info.id, "scale": scale, "channels": self.channels,
                "colors": colors, "managed": managed, "width": info.width.div_ceil(scale), "height": info.height.div_ceil(scale)});
            messages.push(Message::Text(text.to_string()));
            self.pending = blocks(&[PixelRect::at(0, 0, info.width, info.height)], &info, BLOCK);
            self.marks.clear();
            self.drawing = Arc::default();
        } else if let Some((_, generation)) = self.known
            && generation != info.generation
        {
            let changes = self.live.changes_since(&info.name, generation);
            if let Some(detail) = &mut self.detail {
                detail.change(&changes, &info);
            }
            self.pending.extend(changes);
            if self.pending.len() > RECTS {
                self.pending = blocks(&self.pending, &info, BLOCK);
            }
        }
        self.known = Some((info.id, info.generation));
        if info.marks != self.marks {
            let rects: Vec<[i64; 4]> = info
                .marks
                .iter()
                .map(|m| [m.x0.into(), m.y0.into(), m.width() as i64, m.height() as i64])
                .collect();
            messages.push(Message::Text(json!({"marks": rects}).to_string()));
            self.marks = info.marks.clone();
        }
        if !Arc::ptr_eq(&info.drawing, &self.drawing) && info.drawing != self.drawing {
            let steps: Vec<Value> = info.drawing.iter().map(step).collect();
            messages.push(Message::Text(json!({"drawing": steps}).to_string()));
            self.drawing = info.drawing.clone();
        }
        let mut bytes = 0;
        // The visible part comes first, but the rest also progresses in every round.
        while bytes < ROUND_BYTES / 2
            && let Some((part, scale)) = self.detail.as_mut().and_then(Detail::next)
        {
            if let Some(pixels) = self.pixels(&info, part, scale) {
                bytes += pixels.len();
                messages.push(Message::Pixels(pixels));
            }
        }
        while bytes < ROUND_BYTES && !self.pending.is_empty() {
            let rect = self.pending.remove(0);
            for part in parts(&rect, scale, &info) {
                if let Some(pixels) = self.pixels(&info, part, scale) {
                    bytes += pixels.len();
                    messages.push(Message::Pixels(pixels));
                }
            }
        }
    }

    fn images(&self) -> Value {
        let infos = self.live.names().into_iter().filter_map(|name| self.live.info(&name));
        let entry = |info: LiveInfo| {
            let edits = self.may_edit && info.takes_requests;
            json!({"id": info.id, "name": info.name, "width": info.width, "height": info.height,
                "channels": info.channels, "note": info.note, "live": info.takes_requests,
                "panel": !info.panel.is_empty(), "edits": edits})
        };
        json!({"images": infos.map(entry).collect::<Vec<_>>(), "shown": self.live.shown()})
    }

    /// Returns a message with the channels of a rectangle that the page requested; `None` when the image was replaced
    /// meanwhile.
    fn pixels(&mut self, info: &LiveInfo, rect: PixelRect, scale: u32) -> Option<Vec<u8>> {
        let mut values = self.live.read(&info.name, rect, &self.channels).ok()?;
        self.look.convert(info, &self.channels, &mut values);
        let n = self.channels.len();
        let values = if scale == 1 { values } else { reduced(&values, &rect, n, scale as usize) };
        // Halves are enough for colours on a screen. Depths and other values are sent as floats.
        let colors = self.channels.iter().all(|c| matches!(&*info.channels[*c], "R" | "G" | "B" | "A" | "Y"));
        let halves = colors && values.iter().all(|v| !v.is_finite() || v.abs() <= 65504.0);
        let size = [rect.width(), rect.height()].map(|side| side.div_ceil(scale as usize) as u32);
        let (x, y) = (rect.x0.cast_unsigned() / scale, rect.y0.cast_unsigned() / scale);
        let mut bytes = Vec::with_capacity(HEAD + values.len() * 4);
        for word in [info.id as u32, u32::from(halves), x, y, size[0], size[1], n as u32, scale] {
            bytes.extend(word.to_le_bytes());
        }
        match halves {
            true => bytes.extend(values.iter().flat_map(|v| f16::from_f32(*v).to_le_bytes())),
            false => bytes.extend(values.iter().flat_map(|v| v.to_le_bytes())),
        }
        Some(bytes)
    }
}

/// Returns a step of a drawing as a call of a canvas. Numbers that are not finite become null.
fn step(step: &Draw) -> Value {
    match step {
        Draw::Save => json!(["save"]),
        Draw::Restore => json!(["restore"]),
        Draw::MoveTo([x, y]) => json!(["moveTo", x, y]),
        Draw::LineTo([x, y]) => json!(["lineTo", x, y]),
        Draw::FillColor(color) => json!(["fillStyle", color]),
        Draw::StrokeColor(color) => json!(["strokeStyle", color]),
        Draw::Fill => json!(["fill"]),
        Draw::Stroke => json!(["stroke"]),
        Draw::BeginPath => json!(["beginPath"]),
    }
}

/// Returns the means of `scale x scale` pixels. At the right and lower edges, only the pixels that exist are averaged.
fn reduced(values: &[f32], rect: &PixelRect, n: usize, scale: usize) -> Vec<f32> {
    let (width, height) = (rect.width(), rect.height());
    let mut out = Vec::with_capacity(width.div_ceil(scale) * height.div_ceil(scale) * n);
    for y in (0..height).step_by(scale) {
        for x in (0..width).step_by(scale) {
            let (x1, y1) = ((x + scale).min(width), (y + scale).min(height));
            for c in 0..n {
                let pixels = (y..y1).flat_map(|j| (x..x1).map(move |i| (j * width + i) * n + c));
                let sum: f32 = pixels.map(|k| values[k]).sum();
                out.push(sum / ((x1 - x) * (y1 - y)) as f32);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|n| (*n).to_owned()).collect()
    }

    /// Updates the size and the values of a page by its messages. Returns the number of messages with pixels.
    fn painted(page: &mut Page, painting: &mut (u32, u32, Vec<f32>)) -> usize {
        let mut count = 0;
        loop {
            for message in page.news() {
                match message {
                    Message::Text(text) => {
                        let value: Value = serde_json::from_str(&text).unwrap();
                        if value["image"].is_u64() {
                            let side = |name: &str| value[name].as_u64().unwrap() as u32;
                            let (w, h) = (side("width"), side("height"));
                            let n = value["channels"].as_array().unwrap().len();
                            *painting = (w, h, vec![f32::NAN; w as usize * h as usize * n]);
                        }
                    }
                    Message::Pixels(bytes) => {
                        count += 1;
                        let word = |i: usize| u32::from_le_bytes(*bytes[i * 4..].first_chunk().unwrap());
                        let [x, y, w, h, n] = [2, 3, 4, 5, 6].map(|i| word(i) as usize);
                        let values: Vec<f32> = match word(1) {
                            0 => bytes[HEAD..].as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
                            _ => bytes[HEAD..]
                                .as_chunks()
                                .0
                                .iter()
                                .map(|b| f16::from_le_bytes(*b).to_f32())
                                .collect(),
                        };
                        for (j, line) in values.chunks(w * n).enumerate() {
                            let at = ((y + j) * painting.0 as usize + x) * n;
                            painting.2[at..at + w * n].copy_from_slice(line);
                        }
                        assert!(h * w * n == values.len());
                    }
                }
            }
            if !page.is_behind() {
                return count;
            }
        }
    }

    #[test]
    fn a_page_receives_the_pixels_of_the_image() {
        let live = Live::default();
        live.create("a", 700, 300, &names(&["R", "G", "B", "A", "Z"])).unwrap();
        let mut page = Page::new(live.clone(), true, Look::new(None));
        let mut painting = (0, 0, Vec::new());
        assert_eq!(painted(&mut page, &mut painting), 0, "nothing is chosen yet");
        let id = live.info("a").unwrap().id;
        assert_eq!(page.hear(&format!("{{\"show\": {id}, \"channels\": []}}")), None);
        assert_eq!(painted(&mut page, &mut painting), 6);
        assert!((painting.0, painting.1) == (700, 300) && painting.2.iter().all(|v| *v == 0.0));
        // A changed tile is sent alone.
        let tile: Vec<f32> = (0..16 * 16 * 4).map(|v| v as f32 / 8.0).collect();
        live.update(
            "a",
            &[(0, 0, 4), (1, 1, 4), (2, 2, 4), (3, 3, 4)],
            PixelRect::at(600, 200, 16, 16),
            &tile,
        )
        .unwrap();
        assert_eq!(painted(&mut page, &mut painting), 1);
        let all = live.read("a", PixelRect::at(0, 0, 700, 300), &[0, 1, 2, 3]).unwrap();
        assert!(painting.2 == all, "these numbers are halves");
        assert_eq!(painted(&mut page, &mut painting), 0);
        // Hundreds of changed tiles are sent as blocks.
        for k in 0..300 {
            live.update("a", &[(4, 0, 0)], PixelRect::at(k, k, 1, 1), &[1e7]).unwrap();
        }
        assert!(painted(&mut page, &mut painting) < 7);
        live.draw("a", false, &[Draw::MoveTo([1.0, f32::NAN]), Draw::StrokeColor([1.0, 0.0, 0.5, 1.0])])
            .unwrap();
        let drawing = r#"{"drawing":[["moveTo",1.0,null],["strokeStyle",[1.0,0.0,0.5,1.0]]]}"#;
        assert_eq!(page.news(), [Message::Text(drawing.to_owned())]);
        assert_eq!(page.news(), []);
        // Depths are sent as floats.
        page.hear(&format!("{{\"show\": {id}, \"channels\": [4, 99]}}"));
        assert_eq!(painted(&mut page, &mut painting), 6);
        assert!(painting.2 == live.read("a", PixelRect::at(0, 0, 700, 300), &[4]).unwrap());
        match page.hear("{\"probe\": [3, 3]}").unwrap() {
            Message::Text(text) => {
                assert_eq!(text, r#"{"probe":[3,3],"values":["0","0","0","0","10000000"]}"#)
            }
            other => panic!("{other:?}"),
        }
        for nonsense in [
            "",
            "{",
            "[]",
            "{\"probe\": [3]}",
            "{\"probe\": [-1, 0]}",
            "{\"show\": -1}",
            "{\"probe\": [1e99, 3]}",
        ] {
            assert_eq!(page.hear(nonsense), None, "{nonsense}");
        }
        live.close("a");
        assert_eq!(painted(&mut page, &mut painting), 0);
    }

    #[test]
    fn large_images_are_sent_reduced() {
        let live = Live::default();
        live.create("a", 9001, 5, &names(&["Y"])).unwrap();
        let all: Vec<f32> = (0..9001 * 5).map(|v| (v % 9001) as f32).collect();
        live.update("a", &[(0, 0, 1)], PixelRect::at(0, 0, 9001, 5), &all).unwrap();
        let mut page = Page::new(live.clone(), true, Look::new(None));
        page.hear(&format!("{{\"show\": {}, \"channels\": [0]}}", live.info("a").unwrap().id));
        let mut painting = (0, 0, Vec::new());
        painted(&mut page, &mut painting);
        assert_eq!((painting.0, painting.1), (3001, 2));
        assert_eq!(
            (painting.2[0], painting.2[1], painting.2[3000], painting.2[3001]),
            (1.0, 4.0, 9000.0, 1.0)
        );
        live.update("a", &[(0, 0, 0)], PixelRect::at(4, 4, 1, 1), &[400.0]).unwrap();
        assert_eq!(painted(&mut page, &mut painting), 1);
        assert_eq!(painting.2[3001 + 1], (3.0 + 5.0 + 400.0 + 12.0) / 6.0);
    }

    #[test]
    fn visible_parts_are_sent_at_full_resolution() {
        let live = Live::default();
        live.create("a", 9001, 40, &names(&["Y"])).unwrap();
        let all: Vec<f32> = (0..9001 * 40).map(|v| (v % 9001) as f32 / 8.0).collect();
        live.update("a", &[(0, 0, 1)], PixelRect::at(0, 0, 9001, 40), &all).unwrap();
        let mut page = Page::new(live.clone(), true, Look::new(None));
        let id = live.info("a").unwrap().id;
        let ask =
            |scale: u32, rect: [i32; 4]| json!({"detail": id, "scale": scale, "rect": rect}).to_string();
        // Returns the heads of the messages with pixels of a smaller scale, and the first value of each.
        let details = |page: &mut Page| {
            let mut found = Vec::new();
            loop {
                for message in page.news() {
                    if let Message::Pixels(bytes) = message {
                        let word = |i: usize| u32::from_le_bytes(*bytes[i * 4..].first_chunk().unwrap());
                        let value = match word(1) {
                            0 => f32::from_bits(word(8)),
                            _ => f16::from_le_bytes([bytes[HEAD], bytes[HEAD + 1]]).to_f32(),
                        };
                        if word(7) != 3 {
                            found.push(([word(7), word(2), word(3), word(4), word(5)], value));
                        }
                    }
                }
                if !page.is_behind() {
                    return found;
                }
            }
        };
        page.hear(&format!("{{\"show\": {id}, \"channels\": [0]}}"));
        assert_eq!(page.hear(&ask(1, [8900, 0, 500, 40])), None);
        assert_eq!(details(&mut page), [([1, 8704, 0, 256, 40], 1088.0), ([1, 8960, 0, 41, 40], 1120.0)]);
        // A change is sent alone, and only where it is visible.
        live.update("a", &[(0, 0, 0)], PixelRect::at(9000, 39, 1, 1), &[-2.0]).unwrap();
        live.update("a", &[(0, 0, 0)], PixelRect::at(0, 0, 90, 40), &[-3.0]).unwrap();
        assert_eq!(details(&mut page), [([1, 9000, 39, 1, 1], -2.0)]);
        // Positions and sizes of reduced detail are in the reduced pixels.
        page.hear(&ask(2, [513, 1, 3, 3]));
        assert_eq!(details(&mut page), [([2, 256, 0, 256, 20], 64.0625)]);
        // A request for another image, or for nothing, ends the detail.
        for other in
            [json!({"detail": id + 1, "scale": 1, "rect": [0, 0, 9, 9]}).to_string(), ask(0, [0, 0, 9, 9])]
        {
            page.hear(&ask(1, [0, 0, 9, 9]));
            page.hear(&other);
            assert_eq!(details(&mut page), []);
        }
        page.hear(&ask(1, [0, 0, 9, 9]));
        page.hear(&format!("{{\"show\": {id}, \"channels\": [0]}}"));
        assert_eq!(details(&mut page), []);
        live.close("a");
        page.hear(&ask(1, [0, 0, 9, 9]));
        assert_eq!((details(&mut page), page.is_behind()), (Vec::new(), false));
    }

    /// Returns the texts of the messages of a page.
    fn texts(page: &mut Page) -> Vec<Value> {
        let text = |message| match message {
            Message::Text(text) => serde_json::from_str(&text).ok(),
            Message::Pixels(_) => None,
        };
        page.news().into_iter().filter_map(text).collect()
    }

    #[test]
    fn panels_follow_the_pixels_that_they_describe() {
        let live = Live::default();
        live.create("a", 4, 4, &names(&["Y"])).unwrap();
        let id = live.info("a").unwrap().id;
        let mut page = Page::new(live.clone(), true, Look::new(None));
        page.hear(&json!({"show": id, "channels": [0]}).to_string());
        page.hear(&json!({"panel": id}).to_string());
        page.news();
        live.update("a", &[(0, 0, 1)], PixelRect::at(0, 0, 4, 4), &[1.0; 16]).unwrap();
        live.show_panel("a", "state", "{\"n\":1}").unwrap();
        let kinds: Vec<bool> = page.news().iter().map(|m| matches!(m, Message::Pixels(_))).collect();
        // The list comes first, because the image has a panel now.
        assert_eq!(kinds, [false, true, false]);
        live.update("a", &[(0, 0, 1)], PixelRect::at(0, 0, 4, 4), &[2.0; 16]).unwrap();
        live.show_panel("a", "state", "{\"n\":2}").unwrap();
        let kinds: Vec<bool> = page.news().iter().map(|m| matches!(m, Message::Pixels(_))).collect();
        assert_eq!(kinds, [true, false]);
    }

    #[test]
    fn panels_are_sent_in_parts_and_edits_are_passed_on() {
        let live = Live::default();
        live.create("a", 4, 4, &names(&["R"])).unwrap();
        let (to, from) = std::sync::mpsc::channel();
        live.take_edits("a", granita_view::EditSender::new(move |text| to.send(text.to_owned()).is_ok()));
        live.answer("a", granita_view::RequestSender::new(|_| true));
        let id = live.info("a").unwrap().id;
        let (mut page, mut watcher) =
            (Page::new(live.clone(), true, Look::new(None)), Page::new(live.clone(), false, Look::new(None)));
        let flags = |page: &mut Page| {
            let list = texts(page).into_iter().find(|m| m["images"].is_array()).unwrap();
            (list["images"][0]["panel"].clone(), list["images"][0]["edits"].clone())
        };
        assert_eq!(flags(&mut page), (json!(false), json!(true)));
        live.show_panel("a", "state", "{\"n\":1}").unwrap();
        live.show_panel("a", "light/key", "{}").unwrap();
        assert_eq!(flags(&mut page), (json!(true), json!(true)));
        assert_eq!(flags(&mut watcher), (json!(true), json!(false)));
        for page in [&mut page, &mut watcher] {
            assert_eq!(page.hear(&json!({"panel": id}).to_string()), None);
            let all = json!({"panel": id, "all": true, "parts": {"state": "{\"n\":1}", "light/key": "{}"}});
            assert_eq!(texts(page), [all]);
            assert!(texts(page).is_empty());
        }
        live.show_panel("a", "state", "{\"n\":2}").unwrap();
        live.show_panel("a", "light/key", "").unwrap();
        let parts = json!({"state": "{\"n\":2}", "light/key": null});
        assert_eq!(texts(&mut page), [json!({"panel": id, "all": false, "parts": parts})]);
        // Edits of pages that only watch, for other images, and of another kind are not passed on.
        let edit = |image: u64| json!({"edit": {"do": "undo"}, "image": image}).to_string();
        watcher.hear(&edit(id));
        page.hear(&edit(id + 1));
        page.hear(&json!({"edit": "undo", "image": id}).to_string());
        assert!(from.try_recv().is_err());
        page.hear(&edit(id));
        assert_eq!(from.recv().unwrap(), "{\"do\":\"undo\"}");
        live.finish("a");
        assert_eq!(page.hear(&edit(id)), None);
    }
}
