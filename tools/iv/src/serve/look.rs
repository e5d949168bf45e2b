//! The colours of a page: the display and the view of a configuration through which it shows images, and the conversion
//! of their values to the linear light to which the page applies exposure and gamma.
//!
//! A page of a server with a configuration receives text, `{"look": {"displays": [{"name", "views": [...]} ...],
//! "display", "view", "error"}}`, and a table from linear light to its screen. It chooses another one by `{"display":
//! NAME, "view": NAME}`. Without a view, the display's first one is chosen.
//!
//! A table is binary, in little endian: `u32` 0 where messages of pixels have an id, `u32` number of entries of an edge
//! of the cube, or 0, and of the curves, then as `f32` the first matrix row by row, the last one, the
//! offset, the ranges of the cube and of the curves, the scale of the cube, the curves and the cube (see
//! [`ScreenTable`]).

use super::message::Message;
use granita_color::Processor;
use granita_image::{ImageSpec, PixelType};
use granita_view::screen_table::{CUBE, CURVES, SMALL};
use granita_view::{Colors, LiveInfo, ScreenTable, Viewing};
use serde_json::{Value, json};

/// The colours of a page.
pub(super) struct Look {
    /// `None` without a configuration, where screens have the encoding of sRGB.
    viewing: Option<Viewing>,
    /// True when the page does not have the state yet.
    is_new: bool,
    /// Why the last choice was not possible.
    error: Option<String>,
    /// The id of an image, what is assumed of its colours, and their conversion.
    input: Option<(u64, String, Processor)>,
}

/// True when channels of an image are a colour or grey.
pub(super) fn are_colors(info: &LiveInfo, channels: &[usize]) -> bool {
    let names: Vec<&str> = channels.iter().map(|c| &*info.channels[*c]).collect();
    are_names_of_colors(&names)
}

fn are_names_of_colors(names: &[&str]) -> bool {
    matches!(names, ["R", "G", "B"] | ["R", "G", "B", "A"] | ["R" | "G" | "B" | "Y"])
}

impl Look {
    pub(super) fn new(viewing: Option<Viewing>) -> Self {
        let is_new = viewing.is_some();
        Self { viewing, is_new, error: None, input: None }
    }

    /// Chooses the display and the view that a page names. Returns false when the message names none.
    pub(super) fn choose(&mut self, value: &Value) -> bool {
        let (Some(display), Some(viewing)) = (value["display"].as_str(), &self.viewing) else { return false };
        match viewing.with_view(display, value["view"].as_str()) {
            Ok(next) => (self.viewing, self.error) = (Some(next), None),
            Err(error) => self.error = Some(error.to_string()),
        }
        (self.is_new, self.input) = (true, None);
        true
    }

    /// Returns the state and the table, when the page does not have them.
    pub(super) fn news(&mut self) -> Vec<Message> {
        let Some(viewing) = self.viewing.as_ref().filter(|_| self.is_new) else { return Vec::new() };
        self.is_new = false;
        let config = viewing.config();
        let entry = |name: &&str| json!({"name": name, "views": config.views(name)});
        let displays: Vec<Value> = config.displays().iter().map(entry).collect();
        let look = json!({"displays": displays, "display": viewing.display(), "view": viewing.view(),
            "error": self.error});
        vec![Message::Text(json!({"look": look}).to_string()), Message::Pixels(packed(&viewing.table()))]
    }

    /// Returns what is assumed of the colours of an image.
    pub(super) fn text(&mut self, info: &LiveInfo) -> &str {
        &self.of(info).1
    }

    /// Converts values of channels that are colours to linear light.
    pub(super) fn convert(&mut self, info: &LiveInfo, channels: &[usize], values: &mut [f32]) {
        if are_colors(info, channels) {
            self.of(info).2.apply(values, channels.len());
        }
    }

    fn of(&mut self, info: &LiveInfo) -> &(u64, String, Processor) {
        let (viewing, old) = (self.viewing.as_ref(), self.input.take().filter(|input| input.0 == info.id));
        self.input.insert(old.unwrap_or_else(|| {
            let floats = || ImageSpec::new(info.width, info.height, info.channels.len(), PixelType::Float);
            let spec = info.spec.as_deref().map_or_else(floats, Clone::clone);
            let (text, processor) = Colors::to_linear(&spec, viewing, &info.name);
            (info.id, text, processor)
        }))
    }
}

/// Returns the channels that represent the image best, which are its colours or the first one.
pub(super) fn shown_channels(names: &[String]) -> Vec<usize> {
    let find = |name: &str| names.iter().position(|n| n == name);
    match (find("R"), find("G"), find("B")) {
        (Some(r), Some(g), Some(b)) => [Some(r), Some(g), Some(b), find("A")].into_iter().flatten().collect(),
        _ => vec![find("Y").unwrap_or(0)],
    }
}

/// Returns a table as the page receives it.
fn packed(table: &ScreenTable) -> Vec<u8> {
    let edge = if table.cube.is_empty() { 0 } else { CUBE.0 };
    let mut bytes: Vec<u8> = Vec::with_capacity(116 + 12 * (table.curves.len() + table.cube.len()));
    for word in [0, edge as u32, CURVES.0 as u32] {
        bytes.extend(word.to_le_bytes());
    }
    let numbers = [CUBE.1.0, CUBE.1.1, CURVES.1.0, CURVES.1.1, SMALL];
    let numbers = [table.first.as_flattened(), table.last.as_flattened(), &table.offset, &numbers].concat();
    let values = table.curves.as_flattened().iter().chain(table.cube.as_flattened());
    numbers.iter().chain(values).for_each(|v| bytes.extend(v.to_le_bytes()));
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_color::Config;

    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|name| (*name).to_owned()).collect()
    }

    #[test]
    fn pages_choose_displays_and_views_by_name() {
        let mut look = Look::new(Some(Viewing::new(Config::built_in(), None, None, None).unwrap()));
        let news = |look: &mut Look| {
            let mut messages = look.news().into_iter();
            let (Some(Message::Text(text)), Some(Message::Pixels(table))) =
                (messages.next(), messages.next())
            else {
                return None;
            };
            let value: Value = serde_json::from_str(&text).unwrap();
            Some((value["look"].clone(), table[4], table.len()))
        };
        let (state, kind, bytes) = news(&mut look).unwrap();
        assert_eq!((&state["display"], &state["view"]), (&json!("sRGB - Display"), &json!("Un-tone-mapped")));
        assert_eq!(
            (state["displays"][0]["name"].clone(), kind, bytes),
            (json!("sRGB - Display"), 0, 12 + 26 * 4 + CURVES.0 * 12)
        );
        assert!(news(&mut look).is_none());
        assert!(!look.choose(&json!({"show": 1})));
        assert!(look.choose(&json!({"display": "sRGB - Display", "view": "ACES 1.0 - SDR Video"})));
        let (state, kind, bytes) = news(&mut look).unwrap();
        assert_eq!(
            (&state["view"], kind, bytes),
            (&json!("ACES 1.0 - SDR Video"), CUBE.0 as u8, 12 + 26 * 4 + (CURVES.0 + CUBE.0.pow(3)) * 12)
        );
        assert!(look.choose(&json!({"display": "no such"})));
        let (state, ..) = news(&mut look).unwrap();
        assert!(state["error"].as_str().unwrap().contains("no such"));
        assert_eq!(state["view"], json!("ACES 1.0 - SDR Video"));
        // Without a configuration there is nothing to choose.
        let mut plain = Look::new(None);
        assert!(!plain.choose(&json!({"display": "sRGB - Display"})) && news(&mut plain).is_none());
    }

    #[test]
    fn colour_channels_are_found_by_name() {
        assert_eq!(shown_channels(&names(&["A", "B", "G", "R"])), [3, 2, 1, 0]);
        assert_eq!(shown_channels(&names(&["R", "G", "B", "Z"])), [0, 1, 2]);
        assert_eq!((shown_channels(&names(&["Z", "Y"])), shown_channels(&names(&["Z"]))), (vec![1], vec![0]));
    }

    #[test]
    fn colours_are_known_by_their_names() {
        let are = are_names_of_colors;
        assert!(are(&["R", "G", "B"]) && are(&["R", "G", "B", "A"]) && are(&["Y"]) && are(&["G"]));
        assert!(!are(&["A"]) && !are(&["Z"]) && !are(&["B", "G", "R"]) && !are(&["N.X", "N.Y", "N.Z"]));
    }
}
