//! The text of a statement: quoted strings, numbers and lines of limited length.

use std::fmt::Write as _;

/// The column after which lines are broken.
const WIDTH: usize = 100;

/// The statement that is being written.
#[derive(Debug, Default)]
pub(crate) struct Line {
    pub(crate) text: Vec<u8>,
    /// The index at which the current line of the text begins.
    pub(crate) start: usize,
    /// The number of blanks before the statement.
    pub(crate) indent: usize,
    /// True until the first argument is written.
    pub(crate) first: bool,
    /// The argument that is put next.
    pub(crate) item: String,
}

impl Line {
    /// Appends a word, on a new line if the current one is full.
    pub(crate) fn put(&mut self, word: &str) {
        let column = self.text.len() - self.start;
        // The blank at the end of the full line is removed.
        if column + word.len() > WIDTH && column > self.indent + 16 && self.text.last() == Some(&b' ') {
            self.text.pop();
            self.text.push(b'\n');
            self.start = self.text.len();
            self.text.extend(std::iter::repeat_n(b' ', self.indent + 4));
        }
        self.text.extend(word.as_bytes());
    }

    /// Appends the prepared argument.
    pub(crate) fn put_item(&mut self) {
        let item = std::mem::take(&mut self.item);
        self.put(&item);
        self.item = item;
        self.item.clear();
    }

    /// Appends the blank between two arguments.
    pub(crate) fn gap(&mut self) {
        self.text.push(b' ');
    }

    /// Prepares the fewest digits that read back to the same number.
    pub(crate) fn float(&mut self, f: f32, keep_float: bool) {
        // Writing to a string cannot fail.
        let _ = if f.is_nan() {
            write!(self.item, "1e999-1e999")
        } else if f.is_infinite() {
            write!(self.item, "{}1e999", if f < 0.0 { "-" } else { "" })
        } else if is_whole(f) && !keep_float {
            write!(self.item, "{}", f as i32)
        } else {
            write!(self.item, "{f:?}")
        };
    }

    /// Appends a quoted string, with escapes for everything that is not printable ASCII.
    pub(crate) fn quoted(&mut self, s: &str) {
        self.item.push('"');
        for c in s.chars() {
            // Writing to a string cannot fail.
            let _ = match c {
                '"' => write!(self.item, "\\\""),
                '\\' => write!(self.item, "\\\\"),
                '\n' => write!(self.item, "\\n"),
                '\t' => write!(self.item, "\\t"),
                ' '..='~' => write!(self.item, "{c}"),
                c if (c as u32) < 0x100 => write!(self.item, "\\x{:02x}", c as u32),
                c if (c as u32) < 0x1_0000 => write!(self.item, "\\u{:04x}", c as u32),
                c => write!(self.item, "\\U{:08x}", c as u32),
            };
        }
        self.item.push('"');
        self.put_item();
    }
}

/// True when the number can be written without a point.
pub(crate) fn is_whole(f: f32) -> bool {
    f.fract() == 0.0 && f.abs() < 1.0e9 && (f != 0.0 || f.is_sign_positive())
}
