//! Tokens, and the scanner that splits a text into them. It removes comments and joins continued lines.

use crate::source::Pos;
use std::sync::Arc;

/// A token for the preprocessor, with its spelling for `#` and `##`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Raw {
    pub(crate) kind: RawKind,
    /// The text as written (a string with its quotes).
    pub(crate) text: Arc<str>,
    pub(crate) pos: Pos,
    /// True when white space comes before it.
    pub(crate) spaced: bool,
    /// True when it is the first of its line.
    pub(crate) first: bool,
    /// The macros that may not expand it any more.
    pub(crate) hidden: Option<Arc<Vec<Arc<str>>>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RawKind {
    Word,
    Number,
    Text,
    Mark,
    /// Text that is not a token of the language, with a description of the error.
    Bad(&'static str),
}

impl Raw {
    pub(crate) fn is(&self, mark: &str) -> bool {
        self.kind == RawKind::Mark && &*self.text == mark
    }
}

/// The operators and punctuation, longest first.
const MARKS: &[&str] = &[
    "...", "==", "!=", "<=", ">=", "&&", "||", "++", "--", "+=", "-=", "*=", "/=", "##", "<<", ">>", "[",
    "]", "(", ")", "{", "}", ",", ";", "?", ":", "=", "<", ">", "+", "-", "*", "/", "!", "#", "%", "&", "|",
    "^", "~", ".",
];

/// Splits `text` into tokens. It never fails. Invalid text becomes [`RawKind::Bad`], which is an error only where
/// `#if` does not skip it.
pub(crate) fn scan(text: &str, file: u16) -> Vec<Raw> {
    let mut scanner = Scanner { rest: text, pos: Pos { file, line: 1, column: 1 } };
    let mut out = Vec::new();
    let (mut spaced, mut first) = (false, true);
    loop {
        match scanner.skip_blank() {
            Blank::End => return out,
            Blank::Line => (first, spaced) = (true, false),
            Blank::Space => spaced = true,
            Blank::Unclosed(pos) => {
                let kind = RawKind::Bad("a comment that is never closed");
                out.push(Raw { kind, text: "/*".into(), pos, spaced, first, hidden: None });
                return out;
            }
            Blank::No => {
                let pos = scanner.pos;
                let (kind, text) = scanner.token();
                out.push(Raw { kind, text: text.into(), pos, spaced, first, hidden: None });
                (first, spaced) = (false, false);
            }
        }
    }
}

enum Blank {
    No,
    Space,
    Line,
    End,
    Unclosed(Pos),
}

struct Scanner<'a> {
    rest: &'a str,
    pos: Pos,
}

impl<'a> Scanner<'a> {
    /// Advances by `bytes` and returns them.
    fn take(&mut self, bytes: usize) -> &'a str {
        let (taken, rest) = self.rest.split_at(bytes);
        for c in taken.chars() {
            if c == '\n' {
                self.pos.line += 1;
                self.pos.column = 1;
            } else {
                self.pos.column += 1;
            }
        }
        self.rest = rest;
        taken
    }

    fn skip_blank(&mut self) -> Blank {
        let bytes = self.rest.as_bytes();
        match bytes {
            [] => Blank::End,
            [b'\n', ..] => {
                self.take(1);
                Blank::Line
            }
            [b'\\', b'\n', ..] => {
                self.take(2);
                Blank::Space
            }
            [b'\\', b'\r', b'\n', ..] => {
                self.take(3);
                Blank::Space
            }
            [b'/', b'/', ..] => {
                // A spliced line continues the comment.
                let mut end = 0;
                loop {
                    end += self.rest[end..].find('\n').unwrap_or(self.rest.len() - end);
                    let before = self.rest[..end].trim_end_matches('\r');
                    if !before.ends_with('\\') || end >= self.rest.len() {
                        break;
                    }
                    end += 1;
                }
                self.take(end);
                Blank::Space
            }
            [b'/', b'*', ..] => match self.rest[2..].find("*/") {
                Some(end) => {
                    self.take(end + 4);
                    Blank::Space
                }
                None => Blank::Unclosed(self.pos),
            },
            _ => {
                let n = self.rest.len()
                    - self.rest.trim_start_matches(|c: char| c != '\n' && c.is_whitespace()).len();
                if n == 0 {
                    return Blank::No;
                }
                self.take(n);
                Blank::Space
            }
        }
    }

    /// Returns the next token. The rest must not be empty or blank.
    fn token(&mut self) -> (RawKind, &'a str) {
        let bytes = self.rest.as_bytes();
        let first = bytes[0];
        let digit = |i: usize| bytes.get(i).is_some_and(u8::is_ascii_digit);
        if first.is_ascii_alphabetic() || first == b'_' {
            let n = bytes.iter().take_while(|c| c.is_ascii_alphanumeric() || **c == b'_').count();
            return (RawKind::Word, self.take(n));
        }
        if first.is_ascii_digit() || (first == b'.' && digit(1)) {
            let mut n = 0;
            while let Some(&c) = bytes.get(n) {
                let sign = matches!(c, b'+' | b'-') && matches!(bytes[n - 1], b'e' | b'E');
                if !(c.is_ascii_alphanumeric() || c == b'.' || c == b'_' || sign) {
                    break;
                }
                n += 1;
            }
            return (RawKind::Number, self.take(n));
        }
        if first == b'"' {
            return self.text();
        }
        match MARKS.iter().find(|m| self.rest.starts_with(**m)) {
            Some(mark) => (RawKind::Mark, self.take(mark.len())),
            None => {
                let n = self.rest.chars().next().map_or(1, char::len_utf8);
                (RawKind::Bad("an unexpected character"), self.take(n))
            }
        }
    }

    fn text(&mut self) -> (RawKind, &'a str) {
        let bytes = self.rest.as_bytes();
        let mut n = 1;
        loop {
            match bytes.get(n) {
                None | Some(b'\n') => return (RawKind::Bad("a string that is never closed"), self.take(n)),
                Some(b'"') => return (RawKind::Text, self.take(n + 1)),
                // An escaped character is never the end. A multibyte one is skipped byte by byte.
                Some(b'\\') if bytes.get(n + 1).is_some_and(|c| c.is_ascii() && *c != b'\n') => n += 2,
                Some(_) => n += 1,
            }
        }
    }
}

/// A token for the parser.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Token {
    pub(crate) kind: TokenKind,
    pub(crate) pos: Pos,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum TokenKind {
    /// A name or a keyword.
    Word(Arc<str>),
    Number(f32),
    /// A string with its escapes replaced.
    Text(Arc<str>),
    /// An operator or punctuation.
    Mark(&'static str),
    /// Text that is not a token, which was reported.
    Bad,
    End,
}

/// The words that may not be names (reference 5.9, "Reserved Words").
pub(crate) const RESERVED: &[&str] = &[
    "bool",
    "case",
    "char",
    "class",
    "const",
    "default",
    "double",
    "enum",
    "extern",
    "false",
    "friend",
    "inline",
    "int",
    "long",
    "private",
    "protected",
    "public",
    "short",
    "signed",
    "sizeof",
    "static",
    "struct",
    "switch",
    "template",
    "this",
    "true",
    "typedef",
    "uniform",
    "union",
    "unsigned",
    "varying",
    "virtual",
];

/// True when a word is a keyword of the language.
pub(crate) fn is_keyword(word: &str) -> bool {
    KEYWORDS.contains(&word) || RESERVED.contains(&word)
}

/// The words with a meaning (reference 5.9, "Keywords").
pub(crate) const KEYWORDS: &[&str] = &[
    "break", "color", "continue", "do", "else", "emit", "float", "for", "if", "lights", "matrix", "normal",
    "output", "point", "return", "string", "trace", "vector", "void", "while",
];

/// Returns the static spelling of an operator.
pub(crate) fn mark(text: &str) -> Option<&'static str> {
    MARKS.iter().find(|m| **m == text).copied()
}

/// Returns the value of a number as written (C's spelling, with an optional `f`).
pub(crate) fn number(text: &str) -> Option<f32> {
    let digits = text.strip_suffix(['f', 'F']).unwrap_or(text);
    let plain = digits.bytes().all(|c| matches!(c, b'0'..=b'9' | b'.' | b'e' | b'E' | b'+' | b'-'));
    if !plain {
        return None;
    }
    digits.parse::<f32>().ok()
}

/// Replaces escapes inside of a string. The second value is an unknown escape.
pub(crate) fn unescape(inside: &str) -> (String, Option<char>) {
    let mut out = String::with_capacity(inside.len());
    let mut unknown = None;
    let mut chars = inside.chars();
    while let Some(c) = chars.next() {
        if c != '\\' {
            out.push(c);
            continue;
        }
        match chars.next() {
            Some('n') => out.push('\n'),
            Some('r') => out.push('\r'),
            Some('t') => out.push('\t'),
            Some(c @ ('\\' | '"')) => out.push(c),
            Some(c) => {
                unknown = Some(c);
                out.push('\\');
                out.push(c);
            }
            None => out.push('\\'),
        }
    }
    (out, unknown)
}
