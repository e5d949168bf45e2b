//! The keys, in a table with one row for each. The window, its help and the manual use this table.

use eframe::egui::{Key, Modifiers};
use granita_view::Channels;

/// The possible actions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Action {
    Next(isize),
    First,
    Last,
    Other,
    KeepOther,
    Page(isize),
    Layer(isize),
    Level(isize),
    Face(isize),
    Around,
    Fit,
    Zoom(f64),
    ZoomBy(f64),
    Pan(f64, f64),
    FullScreen,
    Exposure(f32),
    Gamma(f32),
    ResetLook,
    Show(Channels),
    FalseColor,
    FalseColorLog,
    Normalize,
    Marks,
    Background,
    ScreenEncoding,
    ColorView(isize),
    ColorDisplay(isize),
    FileEncoding,
    Wipe,
    WipeDirection,
    Difference,
    DifferenceGain(f32),
    Over,
    FlipMap,
    Reload,
    SaveView,
    SavePixels,
    List,
    Histogram,
    Help,
    Theme,
    Abort,
    Escape,
    Quit,
}

/// One or several keys with their action.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    /// The names of the keys, separated by ", ".
    pub(crate) keys: &'static str,
    pub(crate) action: Action,
    /// The description. Rows with an empty text share the description of the row before.
    pub(crate) text: &'static str,
}

const fn row(keys: &'static str, action: Action, text: &'static str) -> Row {
    Row { keys, action, text }
}

/// The table in sections.
pub(crate) const SECTIONS: [(&str, &[Row]); 6] = [
    (
        "Images",
        &[
            row("PageDown, Space", Action::Next(1), "next image"),
            row("PageUp, Backspace", Action::Next(-1), "previous image"),
            row("Home", Action::First, "first image"),
            row("End", Action::Last, "last image"),
            row("T", Action::Other, "show the other image: the previous one, or the one kept by Shift+T"),
            row("Shift+T", Action::KeepOther, "keep this image as the other one"),
            row("Period", Action::Page(1), "next image of the file"),
            row("Comma", Action::Page(-1), "previous image of the file"),
            row("L", Action::Layer(1), "next layer"),
            row("Shift+L", Action::Layer(-1), "previous layer"),
            row("M", Action::Level(1), "next smaller MIP level"),
            row("Shift+M", Action::Level(-1), "next larger MIP level"),
            row("K", Action::Face(1), "cube: cross, as stored, each face"),
            row("Shift+K", Action::Face(-1), "cube: the same in reverse order"),
            row("O", Action::Around, "panorama or cube: look around, on or off"),
            row("F5", Action::Reload, "read the file again (this also happens when it changes)"),
        ],
    ),
    (
        "View",
        &[
            row("F", Action::Fit, "fit into the window"),
            row("1", Action::Zoom(1.0), "100 %: one pixel of the screen for each pixel"),
            row("2", Action::Zoom(2.0), "200 %"),
            row("4", Action::Zoom(4.0), "400 %"),
            row("8", Action::Zoom(8.0), "800 %"),
            row("Plus, Equals", Action::ZoomBy(std::f64::consts::SQRT_2), "zoom in (wheel: at the pointer)"),
            row("Minus", Action::ZoomBy(std::f64::consts::FRAC_1_SQRT_2), "zoom out"),
            row("ArrowLeft", Action::Pan(64.0, 0.0), "move (drag: with the pointer)"),
            row("ArrowRight", Action::Pan(-64.0, 0.0), ""),
            row("ArrowUp", Action::Pan(0.0, 64.0), ""),
            row("ArrowDown", Action::Pan(0.0, -64.0), ""),
            row("F11, Enter", Action::FullScreen, "full screen on or off"),
        ],
    ),
    (
        "Looks",
        &[
            row("CloseBracket, E", Action::Exposure(0.5), "half a stop brighter"),
            row("OpenBracket, Shift+E", Action::Exposure(-0.5), "half a stop darker"),
            row("Y", Action::Gamma(0.1), "more gamma"),
            row("Shift+Y", Action::Gamma(-0.1), "less gamma"),
            row("0", Action::ResetLook, "reset exposure, gamma, range and colours"),
            row("C", Action::Show(Channels::Color), "colour"),
            row("R", Action::Show(Channels::Red), "red alone, or the first channel of the layer"),
            row("G", Action::Show(Channels::Green), "green alone, or the second"),
            row("B", Action::Show(Channels::Blue), "blue alone, or the third"),
            row("A", Action::Show(Channels::Alpha), "alpha alone"),
            row("U", Action::Show(Channels::Luminance), "luminance"),
            row("V", Action::FalseColor, "false colours: each map in turn, then none"),
            row("Shift+V", Action::FalseColorLog, "false colours by ratio, or by difference"),
            row("N", Action::Normalize, "black at the smallest and white at the largest value, on or off"),
            row("X", Action::Marks, "mark NaN and infinite values; also negative ones; none"),
            row(
                "J",
                Action::Background,
                "background of images with alpha: none, black, grey, white, checker",
            ),
            row("I", Action::ScreenEncoding, "encode for an sRGB screen, or show linear values"),
            row("Z", Action::ColorView(1), "next view of the display, of a colour configuration"),
            row("Shift+Z", Action::ColorDisplay(1), "next display of the configuration"),
            row("Shift+I", Action::FileEncoding, "read integers as encoded colours, or as linear light"),
            row("H", Action::Histogram, "histogram, numbers and metadata"),
        ],
    ),
    (
        "Comparing with the other image",
        &[
            row("W", Action::Wipe, "wipe; the edge follows the pointer while Shift is down, or is dragged"),
            row("Shift+W", Action::WipeDirection, "wipe from above, or from the left"),
            row("D", Action::Difference, "difference"),
            row("Shift+CloseBracket, Shift+D", Action::DifferenceGain(2.0), "difference twice as strong"),
            row("Shift+OpenBracket", Action::DifferenceGain(0.5), "half as strong"),
            row("S", Action::FlipMap, "map of the perceived difference (FLIP)"),
            row("P", Action::Over, "composite this image over the other by its alpha"),
        ],
    ),
    (
        "Live images",
        &[row(
            "Delete",
            Action::Abort,
            "end the render (Shift+click: continue here; Ctrl+drag: render this part first)",
        )],
    ),
    (
        "Others",
        &[
            row("Ctrl+S", Action::SaveView, "save the image as shown"),
            row("Ctrl+Shift+S", Action::SavePixels, "save the values of the layer, in any format"),
            row("Tab", Action::List, "list of images"),
            row("F2", Action::Theme, "dark or light theme"),
            row("Questionmark, F1", Action::Help, "these keys"),
            row("Escape", Action::Escape, "close panels, end a comparison, remove the probe"),
            row("Q, Ctrl+Q", Action::Quit, "quit"),
        ],
    ),
];

/// Parses a key with its modifiers, such as `Ctrl+Shift+S`.
pub(crate) fn parse(text: &str) -> Option<(Key, Modifiers)> {
    let mut modifiers = Modifiers::NONE;
    let mut rest = text;
    loop {
        if let Some(r) = rest.strip_prefix("Ctrl+") {
            (modifiers.ctrl, modifiers.command, rest) = (true, true, r);
        } else if let Some(r) = rest.strip_prefix("Shift+") {
            (modifiers.shift, rest) = (true, r);
        } else if let Some(r) = rest.strip_prefix("Alt+") {
            (modifiers.alt, rest) = (true, r);
        } else {
            break;
        }
    }
    let name = match rest {
        "ArrowLeft" => "Left",
        "ArrowRight" => "Right",
        "ArrowUp" => "Up",
        "ArrowDown" => "Down",
        other => other,
    };
    Key::from_name(rest).or_else(|| Key::from_name(name)).map(|key| (key, modifiers))
}

/// Returns the action of a key.
pub(crate) fn action_of(key: Key, modifiers: Modifiers) -> Option<Action> {
    // Characters that need Shift on some keyboards only are matched without it.
    let itself = matches!(key, Key::Questionmark | Key::Plus | Key::Equals | Key::Minus);
    let rows = SECTIONS.iter().flat_map(|s| s.1);
    for row in rows {
        for text in row.keys.split(", ") {
            let Some((k, m)) = parse(text) else { continue };
            if k == key
                && (m.shift == modifiers.shift || itself)
                && (m.ctrl || m.command) == (modifiers.ctrl || modifiers.command)
                && m.alt == modifiers.alt
            {
                return Some(row.action);
            }
        }
    }
    None
}

/// Returns the names of keys as they are shown to the user.
pub(crate) fn written(keys: &str) -> String {
    let mut text = keys.to_owned();
    for (name, sign) in [
        ("CloseBracket", "]"),
        ("OpenBracket", "["),
        ("Questionmark", "?"),
        ("Period", "."),
        ("Comma", ","),
        ("Plus", "+"),
        ("Equals", "="),
        ("Minus", "-"),
        ("Arrow", ""),
        (", ", " "),
    ] {
        // The separator ", " is replaced last, because a comma is also a key.
        text = text.replace(name, sign);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_has_one_action() {
        let mut seen: Vec<(Key, Modifiers)> = Vec::new();
        for row in SECTIONS.iter().flat_map(|s| s.1) {
            for text in row.keys.split(", ") {
                let key = parse(text).unwrap_or_else(|| panic!("{text} is no key"));
                assert!(!seen.contains(&key), "{text} twice");
                assert_eq!(action_of(key.0, key.1), Some(row.action), "{text}");
                seen.push(key);
            }
        }
        assert_eq!(action_of(Key::Questionmark, Modifiers::SHIFT), Some(Action::Help));
        assert_eq!(action_of(Key::F9, Modifiers::NONE), None);
        assert_eq!(written("Shift+CloseBracket, Comma"), "Shift+] ,");
    }

    #[test]
    fn the_manual_lists_all_keys() {
        let manual = include_str!("../../../../docs/iv.md");
        for row in SECTIONS.iter().flat_map(|s| s.1).filter(|r| !r.text.is_empty()) {
            let keys =
                row.keys.split(", ").map(|k| format!("`{}`", written(k))).collect::<Vec<_>>().join(" ");
            let line = format!("| {keys} | {} |", row.text);
            assert!(manual.contains(&line), "docs/iv.md lacks: {line}");
        }
    }
}
