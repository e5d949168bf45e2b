//! String ids, and the tables that hold the texts.

use regex::Regex;
use std::collections::HashMap;
use std::sync::Arc;

/// The id of a string: 0 is the empty one, then follow those of the linked group, then those made while running.
///
/// A register of strings holds the bits of ids. As floats they have no meaning. They are moved and compared bit by
/// bit, and no computation uses them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(crate) struct StringId(pub(crate) u32);

impl StringId {
    /// The empty string.
    pub(crate) const EMPTY: Self = Self(0);

    /// Returns the register value of the id.
    pub(crate) fn to_register(self) -> f32 {
        f32::from_bits(self.0)
    }

    /// Returns the id of a register value.
    pub(crate) fn from_register(held: f32) -> Self {
        Self(held.to_bits())
    }
}

/// The strings that are known when a group is linked.
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
    /// Returns the id of a text, which is added on first use.
    pub(crate) fn intern(&mut self, text: &Arc<str>) -> StringId {
        if let Some(&id) = self.ids.get(text) {
            return StringId(id);
        }
        let id = self.list.len() as u32;
        self.list.push(text.clone());
        self.ids.insert(text.clone(), id);
        StringId(id)
    }

    /// Returns the text of an id.
    pub(crate) fn text(&self, id: StringId) -> Option<&Arc<str>> {
        self.list.get(id.0 as usize)
    }
}

/// The largest length in bytes of a string that a shader makes.
pub(crate) const MAX_TEXT: usize = 1 << 16;
/// The largest number of bytes of all strings that one run makes.
pub(crate) const MAX_BYTES: usize = 64 << 20;
/// The bytes of a string besides its text.
const ENTRY_BYTES: usize = 64;
/// The largest length in bytes of a regular expression.
const MAX_PATTERN: usize = 4096;

/// The strings made by one run.
#[derive(Debug, Default)]
pub(crate) struct StringTable {
    list: Vec<Arc<str>>,
    ids: HashMap<Arc<str>, u32>,
    bytes: usize,
}

/// Cuts a text that is too long, between two characters. Returns true when it was cut.
pub(crate) fn cut(text: &mut String) -> bool {
    let is_long = text.len() > MAX_TEXT;
    if is_long {
        text.truncate(text.floor_char_boundary(MAX_TEXT));
    }
    is_long
}

impl StringTable {
    /// Empties the table for the next run.
    pub(crate) fn reset(&mut self) {
        self.list.clear();
        self.ids.clear();
        self.bytes = 0;
    }

    /// Returns the id of a text, besides those of a group; `None` when the table is full.
    pub(crate) fn intern(&mut self, known: &Strings, text: &str) -> Option<StringId> {
        if let Some(&id) = known.ids.get(text).or_else(|| self.ids.get(text)) {
            return Some(StringId(id));
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
        Some(StringId(id))
    }

    /// Returns the text of an id; the empty string for an unknown id.
    pub(crate) fn text<'s>(&'s self, known: &'s Strings, id: StringId) -> &'s Arc<str> {
        known
            .text(id)
            .or_else(|| self.list.get((id.0 as usize).checked_sub(known.list.len())?))
            .unwrap_or(&known.list[0])
    }
}

/// Compiled regular expressions by pattern.
#[derive(Debug, Default)]
pub(crate) struct Regexes {
    by_pattern: HashMap<Arc<str>, Result<Regex, String>>,
}

/// The largest number of patterns. Only patterns computed per point reach it.
const MAX_PATTERNS: usize = 256;

impl Regexes {
    /// True when `subject` contains a match of a Unix regular expression.
    ///
    /// # Errors
    /// Returns an error when the pattern is not a regular expression.
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

/// Translates a POSIX extended regular expression to the syntax of the `regex` crate, which differs inside brackets
/// (nested classes, `&&`, `--`, `~~`, escapes) and for braces that are not a repetition.
fn translate(pattern: &str) -> String {
    let chars: Vec<char> = pattern.chars().collect();
    let mut out = String::with_capacity(pattern.len() + 8);
    let mut i = 0;
    while i < chars.len() {
        match chars[i] {
            '\\' => {
                match chars.get(i + 1) {
                    // An escaped letter or digit without special meaning matches itself.
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
            // A repetition without an operand matches itself.
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

/// True when character `i` is escaped.
fn escaped(chars: &[char], i: usize) -> bool {
    chars[..i].iter().rev().take_while(|&&c| c == '\\').count() % 2 == 1
}

/// Translates a bracket expression that starts at `i`. Returns the index after it.
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
                // [:alpha:] and similar classes are kept unchanged.
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
    // The bracket is not closed, so it is an ordinary character.
    out.push_str("\\[");
    i + 1
}

/// True when a brace starts `{n}`, `{n,}` or `{n,m}`.
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
    fn strings_are_interned_with_stable_ids() {
        let mut known = Strings::default();
        let a = known.intern(&"a".into());
        assert_eq!(
            (known.intern(&"".into()), a, known.intern(&"a".into())),
            (StringId::EMPTY, StringId(1), StringId(1))
        );
        let mut made = StringTable::default();
        let b = made.intern(&known, "b").unwrap();
        assert_eq!(
            (made.intern(&known, "a"), b, made.intern(&known, "b")),
            (Some(StringId(1)), StringId(2), Some(StringId(2)))
        );
        assert_eq!(&**made.text(&known, b), "b");
        for bad in [3, 1 << 24, u32::MAX].map(StringId) {
            assert_eq!(&**made.text(&known, bad), "", "{bad:?}");
        }
        made.reset();
        assert_eq!(&**made.text(&known, b), "");
    }

    #[test]
    fn the_memory_for_strings_is_limited() {
        let (known, mut made) = (Strings::default(), StringTable::default());
        let long = |k: usize| format!("{k} {}", "x".repeat(MAX_TEXT - 8));
        let most = MAX_BYTES / MAX_TEXT;
        let made_before = (0..2 * most).take_while(|k| made.intern(&known, &long(*k)).is_some()).count();
        assert!((most - 1..=most).contains(&made_before), "{made_before}");
        // Existing strings are found, and the next run starts empty.
        assert_eq!(made.intern(&known, &long(7)), Some(StringId(8)));
        assert_eq!(made.intern(&known, &"x".repeat(MAX_TEXT)), None);
        made.reset();
        assert_eq!(made.intern(&known, &long(7)), Some(StringId(1)));
        let mut text = "ä".repeat(MAX_TEXT);
        assert!(cut(&mut text) && text.len() == MAX_TEXT && !cut(&mut text));
        let mut text = format!("a{}", "ä".repeat(MAX_TEXT));
        assert!(cut(&mut text) && text.len() == MAX_TEXT - 1);
    }

    #[test]
    fn registers_hold_ids_beyond_the_integers_of_floats() {
        // 2^24 + 1 is the first whole number that a float cannot represent.
        for id in [0, 1, 16_777_216, 16_777_217, 16_777_219, u32::MAX].map(StringId) {
            assert_eq!(StringId::from_register(id.to_register()), id);
        }
        let copied: Vec<f32> = [16_777_216, 16_777_217].map(|id| StringId(id).to_register()).to_vec().clone();
        assert_ne!(StringId::from_register(copied[0]), StringId::from_register(copied[1]));
    }

    #[test]
    fn unix_regular_expressions_match() {
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
