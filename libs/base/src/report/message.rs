//! Messages: severity, location and text.

use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;

/// The severity of a message (reference 2.10).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Severity {
    /// Requested output, such as that of a shader's `printf`. It is always shown.
    Message,
    /// Information about the progress.
    Info,
    /// A possible error. The work continues as documented.
    Warning,
    /// An error. The work continues with a substitute.
    Error,
    /// An error after which no useful result is possible.
    Severe,
}

impl Severity {
    /// Returns its number in interfaces like that of C++ (reference A.3).
    pub fn code(self) -> i32 {
        match self {
            Self::Info => 512,
            Self::Warning => 1024,
            Self::Error => 2048,
            Self::Severe => 4096,
            Self::Message => 8192,
        }
    }

    /// Returns the severity of a code; [`Severity::Message`] for unknown ones.
    pub fn from_code(code: i32) -> Self {
        [Self::Info, Self::Warning, Self::Error, Self::Severe]
            .into_iter()
            .find(|severity| severity.code() == code)
            .unwrap_or(Self::Message)
    }
}

impl fmt::Display for Severity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Message => "message",
            Self::Info => "info",
            Self::Warning => "warning",
            Self::Error => "error",
            Self::Severe => "severe error",
        })
    }
}

/// A location in the user's input.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Location {
    /// The file name, or its substitute (`<string>`); empty when there is no location.
    pub file: Arc<str>,
    /// The line, counted from 1; 0 when unknown.
    pub line: u32,
    /// The column, counted from 1; 0 when unknown.
    pub column: u32,
}

impl Location {
    /// Returns the location of a line of a file.
    pub fn line(file: &Arc<str>, line: u32) -> Self {
        Self { file: file.clone(), line, column: 0 }
    }

    /// True when the location is known.
    pub fn is_known(&self) -> bool {
        !self.file.is_empty()
    }
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.file)?;
        if self.line > 0 {
            write!(f, ":{}", self.line)?;
            if self.column > 0 {
                write!(f, ":{}", self.column)?;
            }
        }
        Ok(())
    }
}

/// One message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// The severity.
    pub severity: Severity,
    /// The location, which may be unknown.
    pub at: Location,
    /// The text, in lower case, without a full stop.
    pub text: String,
}

impl Message {
    /// Returns a message without characters that terminals and logs would interpret, because names and texts come
    /// from files.
    pub(super) fn new(severity: Severity, at: &Location, text: String) -> Self {
        let clean = match severity {
            Severity::Message => printable(&text),
            _ => one_line(&text),
        };
        let clean = match clean {
            Cow::Borrowed(_) => None,
            Cow::Owned(clean) => Some(clean),
        };
        let mut at = at.clone();
        if let Cow::Owned(file) = shown(&at.file, |_| false) {
            at.file = file.into();
        }
        Self { severity, at, text: clean.unwrap_or(text) }
    }
}

impl fmt::Display for Message {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.severity == Severity::Message {
            return f.write_str(&self.text);
        }
        if self.at.is_known() {
            write!(f, "{}: ", self.at)?;
        }
        write!(f, "{}: {}", self.severity, self.text)
    }
}

/// Returns the text in a form that is safe for a terminal or a log. Control characters, and those that change the
/// direction of writing, become escapes such as `\\u{1b}`. Tabs and ends of lines are kept.
pub fn printable(text: &str) -> Cow<'_, str> {
    shown(text, |_| true)
}

/// Returns the text of a message of one line. Further lines are kept when they are indented by four blanks, like
/// lines that quote a source. No text of a scene can then look like a separate message.
fn one_line(text: &str) -> Cow<'_, str> {
    shown(text, |rest| rest.starts_with("    "))
}

/// Escapes characters that are not printed. `may_end` returns whether a line may end before the rest of the text.
fn shown(text: &str, may_end: impl Fn(&str) -> bool) -> Cow<'_, str> {
    // Bidirectional embeddings, overrides and isolates make text look like another text.
    let is_shown = |at: usize, c: char| match c {
        '\t' => true,
        '\n' => may_end(&text[at + 1..]),
        '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => false,
        other => !other.is_control(),
    };
    if text.char_indices().all(|(at, c)| is_shown(at, c)) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for (at, c) in text.char_indices() {
        if is_shown(at, c) {
            out.push(c);
        } else {
            out.extend(c.escape_default());
        }
    }
    Cow::Owned(out)
}
