//! Names with the number of a frame.

/// Puts the number of a frame into a name. `#`, `##` ... become the number with at least as many digits. So do `%d` and
/// `%04d`, `$frame` and `$frame4` (also `${frame}` and `${frame4}`) for the digits that they name. A negative number
/// has its sign before the digits.
pub fn numbered(name: &str, frame: i32) -> String {
    let mut text = String::with_capacity(name.len() + 8);
    let mut rest = name;
    while let Some((before, digits, after)) = mark(rest) {
        text += before;
        text += &padded(frame, digits);
        rest = after;
    }
    text + rest
}

/// Does the same as [`numbered`] for a text of a scene, in which only `$frame`, `${frame}` and those with digits are
/// marks. Returns `None` when it has none.
pub fn with_frame(text: &str, frame: i32) -> Option<String> {
    let at = text.find('$')?;
    let mut changed = text[..at].to_owned();
    let mut rest = &text[at..];
    let mut is_changed = false;
    while let Some(c) = rest.chars().next() {
        match mark_at(rest).filter(|_| c == '$') {
            Some((digits, length)) => {
                changed += &padded(frame, digits);
                rest = &rest[length..];
                is_changed = true;
            }
            None => {
                changed.push(c);
                rest = &rest[c.len_utf8()..];
            }
        }
    }
    is_changed.then_some(changed)
}

/// Returns a name without the places for the number of a frame, and without dots, `_` and `-` at its ends.
pub fn unnumbered(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    let mut rest = name;
    while let Some((before, _, after)) = mark(rest) {
        text += before;
        rest = after;
    }
    text += rest;
    text.trim_matches(['.', '_', '-']).to_owned()
}

/// True when a name has a place for the number of a frame.
pub fn has_number(name: &str) -> bool {
    mark(name).is_some()
}

fn padded(frame: i32, digits: usize) -> String {
    let sign = if frame < 0 { "-" } else { "" };
    format!("{sign}{:0digits$}", frame.unsigned_abs())
}

/// Returns the text before the first mark, its digits, and the text after it.
fn mark(name: &str) -> Option<(&str, usize, &str)> {
    (0..name.len()).filter(|at| name.is_char_boundary(*at)).find_map(|at| {
        let (digits, length) = mark_at(&name[at..])?;
        Some((&name[..at], digits, &name[at + length..]))
    })
}

/// Returns the digits of the mark that a text begins with, and its length.
fn mark_at(text: &str) -> Option<(usize, usize)> {
    if text.starts_with('#') {
        let count = text.bytes().take_while(|b| *b == b'#').count();
        return Some((count, count));
    }
    if let Some(rest) = text.strip_prefix('%') {
        let (digits, length) = digits(rest);
        return rest[length..].starts_with('d').then_some((digits, length + 2));
    }
    if let Some(rest) = text.strip_prefix("${frame") {
        let (digits, length) = digits(rest);
        return rest[length..].starts_with('}').then_some((digits, length + 8));
    }
    let rest = text.strip_prefix("$frame")?;
    let (digits, length) = digits(rest);
    let is_word = rest[length..].starts_with(|c: char| c == '_' || c.is_alphanumeric());
    (!is_word).then_some((digits, length + 6))
}

/// Returns the number at the beginning of a text, from 1 to 20, and its length.
fn digits(text: &str) -> (usize, usize) {
    let length = text.bytes().take_while(u8::is_ascii_digit).count();
    (text[..length].parse().unwrap_or(1).clamp(1, 20), length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_become_numbers() {
        for (name, expected) in [
            ("shot.####.pyg", "shot.0012.pyg"),
            ("shot.#.pyg", "shot.12.pyg"),
            ("a%04d.b%d", "a0012.b12"),
            ("out/$frame4/$frame.exr", "out/0012/12.exr"),
            ("${frame3}_${frame}x", "012_12x"),
            ("$frames $frame_ 100% %s", "$frames $frame_ 100% %s"),
            ("é#é", "é12é"),
            ("", ""),
        ] {
            assert_eq!(numbered(name, 12), expected);
            assert_eq!(has_number(name), name != expected, "{name}");
        }
        assert_eq!(with_frame("é/$frame4.#.${frame}", 12).as_deref(), Some("é/0012.#.12"));
        assert_eq!(with_frame("$HOME/%d", 12), None);
        assert_eq!(numbered("a.####", -7), "a.-0007");
        assert_eq!(numbered("a.##", 12345), "a.12345");
        for (name, expected) in
            [("shot.####", "shot"), ("a_%04d.b", "a_.b"), ("$frame4", ""), ("wall.a", "wall.a")]
        {
            assert_eq!(unnumbered(name), expected);
        }
    }
}
