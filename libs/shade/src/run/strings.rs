//! Strings as numbers: 0 is the empty string, then those of the linked group, then those made while
//! running. Numbers are exact in a float, so strings live in registers like everything else.

use regex::Regex;
use std::collections::HashMap;
use std::sync::Arc;

/// Strings known when a group is linked.
#[derive(Clone, Debug)]
pub(crate) struct Strings {
    list: Vec<Arc<str>>,
    ids: HashMap<Arc<str>, u32>,
}

impl Default for Strings {
    fn default() -> Self {
        let empty: Arc<str> = Arc::from("");
        Self { list: vec![empty.clone()], ids: HashMap::from([(empty, 0)]) }
    }
}

impl Strings {
    /// The number of a text.
    pub(crate) fn intern(&mut self, text: &Arc<str>) -> f32 {
        if let Some(&id) = self.ids.get(text) {
            return id as f32;
        }
        let id = self.list.len() as u32;
        self.list.push(text.clone());
        self.ids.insert(text.clone(), id);
        id as f32
    }

    /// The text of a number.
    pub(crate) fn text(&self, id: f32) -> Option<&Arc<str>> {
        self.list.get(id as usize)
    }
}

/// The longest string that a shader can make, in bytes.
pub(crate) const MAX_TEXT: usize = 1 << 16;
/// What all strings that one run makes may take. Numbers of strings are exact in a float well beyond what fits.
pub(crate) const MAX_BYTES: usize = 64 << 20;
/// What a string takes beside its text.
const ENTRY_BYTES: usize = 64;
/// The longest regular expression, in bytes.
const MAX_PATTERN: usize = 4096;

/// Strings made by one run.
#[derive(Debug, Default)]
pub(crate) struct StringTable {
    list: Vec<Arc<str>>,
    ids: HashMap<Arc<str>, u32>,
    bytes: usize,
}

/// Cuts a text that is too long, between two characters; whether it was.
pub(crate) fn cut(text: &mut String) -> bool {
    let is_long = text.len() > MAX_TEXT;
    if is_long {
        text.truncate(text.floor_char_boundary(MAX_TEXT));
    }
    is_long
}

impl StringTable {
    /// Forgets everything, for the next run.
    pub(crate) fn reset(&mut self) {
        self.list.clear();
        self.ids.clear();
        self.bytes = 0;
    }

    /// The number of a text, beside those of a group; `None` when there is no room for it.
    pub(crate) fn intern(&mut self, known: &Strings, text: &str) -> Option<f32> {
        if let Some(&id) = known.ids.get(text).or_else(|| self.ids.get(text)) {
            return Some(id as f32);
        }
        let bytes = self.bytes + text.len() + ENTRY_BYTES;
        if bytes > MAX_BYTES {
            return None;
        }
        self.bytes = bytes;
        let id = (known.list.len() + self.list.len()) as u32;
        let text: Arc<str> = Arc::from(text);
        self.list.push(text.clone());
        self.ids.insert(text, id);
        Some(id as f32)
    }

    /// The text of a number; the empty string for what is no string.
    pub(crate) fn text<'s>(&'s self, known: &'s Strings, id: f32) -> &'s Arc<str> {
        known
            .text(id)
            .or_else(|| self.list.get((id as usize).checked_sub(known.list.len())?))
            .unwrap_or(&known.list[0])
    }
}

/// Compiled regular expressions by pattern.
#[derive(Debug, Default)]
pub(crate) struct Regexes {
    by_pattern: HashMap<Arc<str>, Result<Regex, String>>,
}

/// More patterns than any shader writes; only a pattern computed per point makes as many.
const MAX_PATTERNS: usize = 256;

impl Regexes {
    /// Whether `subject` contains a match of a Unix regular expression.
    ///
    /// Errors: the pattern is no regular expression.
    pub(crate) fn matches(&mut self, pattern: &Arc<str>, subject: &str) -> Result<bool, String> {
        if pattern.len() > MAX_PATTERN {
            let (n, max) = (pattern.len(), MAX_PATTERN);
            return Err(format!("a regular expression of {n} bytes is longer than {max}"));
        }
        if self.by_pattern.len() >= MAX_PATTERNS && !self.by_pattern.contains_key(pattern) {
            self.by_pattern.clear();
        }
        let regex = self.by_pattern.entry(pattern.clone()).or_insert_with(|| {
            regex::RegexBuilder::new(&translate(pattern))
                .dot_matches_new_line(true)
                .size_limit(1 << 20)
                .build()
                .map_err(|_| format!("\"{pattern}\" is not a regular expression"))
        });
        regex.as_ref().map(|r| r.is_match(subject)).map_err(Clone::clone)
    }
}

/// A POSIX extended regular expression in the syntax of the `regex` crate, which differs inside
/// brackets (nested classes, `&&`, `--`, `~~`, escapes) and for braces that are no repetition.
fn translate(pattern: &str) -> String {
    let chars: Vec<char> = pattern.chars().collect();
    let mut out = String::with_capacity(pattern.len() + 8);
    let mut i = 0;
    while i < chars.len() {
        match chars[i] {
            '\\' => {
                match chars.get(i + 1) {
                    // An escaped letter or digit without meaning stands for itself.
                    Some(&c) if c.is_alphanumeric() && !"wWsSbBdD".contains(c) => out.push(c),
                    Some(&c) => out.extend(['\\', c]),
                    None => out.push_str("\\\\"),
                }
                i += 2;
            }
            '[' => i = bracket(&chars, i, &mut out),
            '{' if !is_repetition(&chars[i..]) => {
                out.push_str("\\{");
                i += 1;
            }
            '}' if !out.contains('{') => {
                out.push_str("\\}");
                i += 1;
            }
            // A repetition with nothing to repeat stands for itself.
            c @ ('*' | '+' | '?')
                if i == 0 || matches!(chars[i - 1], '(' | '|') && !escaped(&chars, i - 1) =>
            {
                out.extend(['\\', c]);
                i += 1;
            }
            c => {
                out.push(c);
                i += 1;
            }
        }
    }
    out
}

/// Whether character `i` is escaped.
fn escaped(chars: &[char], i: usize) -> bool {
    chars[..i].iter().rev().take_while(|&&c| c == '\\').count() % 2 == 1
}

/// Translates a bracket expression that starts at `i`; the index after it.
fn bracket(chars: &[char], i: usize, out: &mut String) -> usize {
    let mut j = i + 1;
    let negated = chars.get(j) == Some(&'^');
    j += usize::from(negated);
    let body = j;
    let mut text = String::new();
    while let Some(&c) = chars.get(j) {
        match c {
            ']' if j > body => {
                out.push_str(if negated { "[^" } else { "[" });
                out.push_str(&text);
                out.push(']');
                return j + 1;
            }
            '[' if matches!(chars.get(j + 1), Some(':')) => {
                // [:alpha:] and its like pass as they are.
                let Some(end) =
                    (j + 2..chars.len().saturating_sub(1)).find(|&k| chars[k] == ':' && chars[k + 1] == ']')
                else {
                    text.push_str("\\[");
                    j += 1;
                    continue;
                };
                text.extend(&chars[j..end + 2]);
                j = end + 2;
            }
            '-' if j == body || chars.get(j + 1) == Some(&']') => {
                text.push_str("\\-");
                j += 1;
            }
            '[' | ']' | '\\' | '&' | '~' | '^' => {
                text.extend(['\\', c]);
                j += 1;
            }
            c => {
                text.push(c);
                j += 1;
            }
        }
    }
    // Never closed: an ordinary character.
    out.push_str("\\[");
    i + 1
}

/// Whether a brace starts `{n}`, `{n,}` or `{n,m}`.
fn is_repetition(chars: &[char]) -> bool {
    let Some(end) = chars.iter().position(|&c| c == '}') else { return false };
    let inner: String = chars[1..end].iter().collect();
    let mut parts = inner.splitn(2, ',');
    let first = parts.next().unwrap_or("");
    let second = parts.next().unwrap_or("");
    !first.is_empty()
        && first.chars().all(|c| c.is_ascii_digit())
        && second.chars().all(|c| c.is_ascii_digit())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_texts() {
        let mut known = Strings::default();
        let a = known.intern(&"a".into());
        assert_eq!((known.intern(&"".into()), a, known.intern(&"a".into())), (0.0, 1.0, 1.0));
        let mut made = StringTable::default();
        let b = made.intern(&known, "b").unwrap();
        assert_eq!((made.intern(&known, "a"), b, made.intern(&known, "b")), (Some(1.0), 2.0, Some(2.0)));
        assert_eq!(&**made.text(&known, b), "b");
        for bad in [-1.0, 77.0, f32::NAN, f32::INFINITY] {
            assert_eq!(&**made.text(&known, bad), "", "{bad}");
        }
        made.reset();
        assert_eq!(&**made.text(&known, b), "");
    }

    #[test]
    fn room_for_strings_is_bounded() {
        let (known, mut made) = (Strings::default(), StringTable::default());
        let long = |k: usize| format!("{k} {}", "x".repeat(MAX_TEXT - 8));
        let most = MAX_BYTES / MAX_TEXT;
        let made_before = (0..2 * most).take_while(|k| made.intern(&known, &long(*k)).is_some()).count();
        assert!((most - 1..=most).contains(&made_before), "{made_before}");
        // Those that are there are found, and the next run begins anew.
        assert_eq!(made.intern(&known, &long(7)), Some(8.0));
        assert_eq!(made.intern(&known, &"x".repeat(MAX_TEXT)), None);
        made.reset();
        assert_eq!(made.intern(&known, &long(7)), Some(1.0));
        let mut text = "ä".repeat(MAX_TEXT);
        assert!(cut(&mut text) && text.len() == MAX_TEXT && !cut(&mut text));
        let mut text = format!("a{}", "ä".repeat(MAX_TEXT));
        assert!(cut(&mut text) && text.len() == MAX_TEXT - 1);
    }

    #[test]
    fn unix_regular_expressions() {
        let mut r = Regexes::default();
        let mut m = |p: &str, s: &str| r.matches(&p.into(), s).unwrap();
        for (pattern, subject, expected) in [
            ("foo", "a foo b", true),
            ("^foo", "a foo", false),
            ("foo$", "a foo", true),
            ("^$", "", true),
            ("a.c", "abc", true),
            ("a.c", "a\nc", true),
            ("ab*c", "ac", true),
            ("(ab|cd)+", "xcd", true),
            ("a{2}", "baab", true),
            ("a{2,3}b", "ab", false),
            ("a{x", "a{x", true),
            ("[[:digit:]]+x", "a12x", true),
            ("[^[:space:]]", " \t", false),
            ("[]a]", "]", true),
            ("[^]a]", "]a", false),
            ("[a-c-]", "-", true),
            ("[a\\]", "\\", true),
            ("[a&&b]", "&", true),
            ("[[]", "[", true),
            ("[", "a[b", true),
            ("\\.tx$", "wood.tx", true),
            ("\\.tx$", "woodtx", false),
            ("*a", "*a", true),
            ("", "anything", true),
            ("light[0-9]+", "light12", true),
        ] {
            assert_eq!(m(pattern, subject), expected, "{pattern} {subject}");
        }
        assert!(r.matches(&"(a".into(), "a").is_err());
    }
}
