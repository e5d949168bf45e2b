//! The flat subset. It has one call with constant arguments per statement (reference 3.6), and binary arrays (3.7).

use crate::bytes::{Bytes, KEPT};
use crate::value::{Seq, Value};
use granita_base::{Number, scan_number};
use std::io;

/// The largest depth of nested sequences.
const MAX_DEPTH: usize = 64;
/// The largest number of values that `sequence * n` may make.
const MAX_REPEAT: usize = 1 << 28;
/// The number of values of a binary array that are read at once.
const PIECE: usize = 1 << 16;

/// The item at the current position.
#[derive(Debug)]
pub(crate) enum Statement {
    /// The end of the source.
    End,
    /// An item without an effect, such as an import of the interface, `pass` or a string alone.
    Nothing,
    /// A call with constant arguments.
    Call { name: String, args: Vec<Value>, line: u32 },
    /// An item that only Python can execute. The position is unchanged.
    Python { line: u32, why: Why },
    /// An item that cannot be parsed, and after which nothing can be decoded.
    Broken(Why),
}

/// The reason why a statement is not flat.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Why {
    pub(crate) what: String,
    pub(crate) line: u32,
}

/// The reason why a statement cannot be read as a flat one.
#[derive(Debug)]
pub(crate) enum NotFlat {
    Why(Why),
    /// The statement is not Python either.
    Broken(Why),
    Io(io::Error),
}

impl From<io::Error> for NotFlat {
    fn from(e: io::Error) -> Self {
        Self::Io(e)
    }
}

/// True when a byte begins neither an ASCII character nor another UTF-8 character.
fn is_no_text(byte: u8) -> bool {
    matches!(byte, 0x80..=0xc1 | 0xf5..=0xff)
}

pub(crate) type Flat<T> = Result<T, NotFlat>;

/// Reads flat statements from a window of bytes.
pub(crate) struct Parser {
    pub(crate) bytes: Bytes,
    /// The start of the last statement.
    start: (usize, u32),
    /// True when the beginning of a long statement may be dropped. The reader then never returns to it.
    pub(crate) may_drop: bool,
}

impl Parser {
    pub(crate) fn new(bytes: Bytes) -> Self {
        Self { bytes, start: (0, 1), may_drop: true }
    }

    /// Reads the next statement. Blank lines and comments before it are skipped. Calls of names for which `is_flat`
    /// returns false are left to Python.
    pub(crate) fn statement(&mut self, is_flat: &dyn Fn(&str) -> bool) -> io::Result<Statement> {
        loop {
            self.bytes.forget();
            let start = self.bytes.mark();
            self.start = start;
            self.blanks(true)?;
            match self.bytes.peek()? {
                None => return Ok(Statement::End),
                Some(b';') => {
                    self.bytes.advance();
                    continue;
                }
                Some(_) => {}
            }
            let line = self.bytes.line();
            self.bytes.let_drop(self.may_drop);
            let read = self.simple(line, is_flat);
            self.bytes.let_drop(false);
            return match read {
                Ok(statement) => Ok(statement),
                Err(NotFlat::Why(why)) if self.bytes.has_dropped() => {
                    let text = format!(
                        "line {}: {} in a statement of more than {} MB; a statement of this length must be flat",
                        why.line,
                        why.what,
                        KEPT >> 20
                    );
                    Err(io::Error::new(io::ErrorKind::InvalidData, text))
                }
                Err(NotFlat::Io(e)) => Err(e),
                Err(NotFlat::Broken(why)) => Ok(Statement::Broken(why)),
                Err(NotFlat::Why(why)) => {
                    // Python needs the indentation, so the position returns to the beginning of the line.
                    self.bytes.back_to(start);
                    self.blank_lines()?;
                    Ok(Statement::Python { line: self.bytes.line(), why })
                }
            };
        }
    }

    /// Returns to the beginning of the statement that was read last.
    pub(crate) fn again(&mut self) {
        self.bytes.back_to(self.start);
    }

    /// Skips whole lines that are blank or comments. Stops at the beginning of the next line.
    fn blank_lines(&mut self) -> io::Result<()> {
        loop {
            let start = self.bytes.mark();
            while matches!(self.bytes.peek()?, Some(b' ' | b'\t' | b'\r' | 0x0c)) {
                self.bytes.advance();
            }
            match self.bytes.peek()? {
                Some(b'#') => self.comment()?,
                Some(b'\n') => {}
                _ => {
                    self.bytes.back_to(start);
                    return Ok(());
                }
            }
            if self.bytes.peek()?.is_none() {
                return Ok(());
            }
            self.bytes.advance();
        }
    }

    fn simple(&mut self, line: u32, is_flat: &dyn Fn(&str) -> bool) -> Flat<Statement> {
        let Some(first) = self.bytes.peek()? else { return Ok(Statement::End) };
        if matches!(first, b'"' | b'\'') {
            self.string(false)?;
            self.end_of_statement()?;
            return Ok(Statement::Nothing);
        }
        let mut name = self.word()?;
        match name.as_str() {
            "pass" => {
                self.end_of_statement()?;
                return Ok(Statement::Nothing);
            }
            "from" | "import" => return self.import(&name),
            "" => {
                let c = char::from(first);
                if is_no_text(first) {
                    return self.broken(format!("the binary code {first} where a statement is expected"));
                }
                return self.fail(format!("\"{c}\""));
            }
            _ => {}
        }
        self.blanks(false)?;
        if self.bytes.peek()? == Some(b'.') && matches!(name.as_str(), "GelatoRenderer" | "gelato") {
            self.bytes.advance();
            self.blanks(false)?;
            name = self.word()?;
            self.blanks(false)?;
        }
        if self.bytes.peek()? != Some(b'(') {
            const WORDS: [&str; 12] = [
                "assert", "class", "def", "del", "for", "global", "if", "lambda", "raise", "try", "while",
                "with",
            ];
            let what = match self.bytes.peek()? {
                Some(b'=') => format!("an assignment to \"{name}\""),
                _ if WORDS.contains(&name.as_str()) => format!("\"{name}\""),
                _ => format!("\"{name}\" without arguments"),
            };
            return self.fail(what);
        }
        if !is_flat(&name) {
            return self.fail(format!("\"{name}\""));
        }
        self.bytes.advance();
        let args = self.arguments()?;
        self.end_of_statement()?;
        Ok(Statement::Call { name, args, line })
    }

    /// Reads an import such as `import gelato` or `from gelato import *`. It has no effect, because all names exist
    /// already.
    fn import(&mut self, first: &str) -> Flat<Statement> {
        let mut words = vec![first.to_owned()];
        loop {
            self.blanks(false)?;
            let word = self.word()?;
            if !word.is_empty() {
                words.push(word);
            } else if self.bytes.peek()? == Some(b'*') {
                self.bytes.advance();
                words.push("*".into());
            } else {
                break;
            }
        }
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let known = matches!(words[..], ["import", "gelato"] | ["from", "gelato", "import", ..]);
        if !known || words.contains(&"as") {
            return self.fail(format!("\"{}\"", words.join(" ")));
        }
        self.end_of_statement()?;
        Ok(Statement::Nothing)
    }

    /// Reads the arguments up to the closing parenthesis.
    fn arguments(&mut self) -> Flat<Vec<Value>> {
        let mut args = Vec::new();
        loop {
            self.blanks(true)?;
            if self.bytes.peek()? == Some(b')') {
                self.bytes.advance();
                return Ok(args);
            }
            args.push(self.expression(0)?);
            self.blanks(true)?;
            match self.bytes.peek()? {
                Some(b',') => self.bytes.advance(),
                Some(b')') => {}
                Some(b'=') => return self.fail("a keyword argument".into()),
                None => return self.fail("the end of the file inside of parentheses".into()),
                Some(_) => return self.fail("an argument that is not constant".into()),
            }
        }
    }

    /// Reads a constant, or simple arithmetic between constants.
    fn expression(&mut self, depth: usize) -> Flat<Value> {
        let mut left = self.term(depth)?;
        loop {
            self.blanks(true)?;
            let op = match self.bytes.peek()? {
                Some(op @ (b'+' | b'-')) => op,
                _ => return Ok(left),
            };
            self.bytes.advance();
            let right = self.term(depth)?;
            left = self.combine(left, op, right)?;
        }
    }

    fn term(&mut self, depth: usize) -> Flat<Value> {
        let mut left = self.constant(depth)?;
        loop {
            self.blanks(true)?;
            let op = match self.bytes.peek()? {
                Some(op @ (b'*' | b'/')) => op,
                _ => return Ok(left),
            };
            if self.bytes.peek_at(1)? == Some(op) {
                return self.fail(format!("\"{0}{0}\"", char::from(op)));
            }
            self.bytes.advance();
            let right = self.constant(depth)?;
            left = self.combine(left, op, right)?;
        }
    }

    /// Applies one operation, as Python 3 does.
    fn combine(&self, left: Value, op: u8, right: Value) -> Flat<Value> {
        use Value::{Float, Int, Seq as List};
        let float = |v: &Value| match v {
            Int(i) => Some(*i as f64),
            Float(f) => Some(*f),
            _ => None,
        };
        Ok(match (op, left, right) {
            (b'*', List(s), Int(n)) | (b'*', Int(n), List(s)) => match s.repeat(n, MAX_REPEAT) {
                Ok(s) => List(s),
                Err(why) => return self.fail(why.into()),
            },
            (b'+', List(mut a), List(b)) => match a.push(List(b)) {
                Ok(()) => List(a),
                Err(why) => return self.fail(why.into()),
            },
            (b'+', Int(a), Int(b)) => a.checked_add(b).map_or(Float(a as f64 + b as f64), Int),
            (b'-', Int(a), Int(b)) => a.checked_sub(b).map_or(Float(a as f64 - b as f64), Int),
            (b'*', Int(a), Int(b)) => a.checked_mul(b).map_or(Float(a as f64 * b as f64), Int),
            (op, a, b) => {
                let (Some(x), Some(y)) = (float(&a), float(&b)) else {
                    return self.fail(format!("\"{}\" between values of these kinds", char::from(op)));
                };
                match op {
                    b'+' => Float(x + y),
                    b'-' => Float(x - y),
                    b'*' => Float(x * y),
                    _ if y == 0.0 => return self.fail("a division by zero".into()),
                    _ => Float(x / y),
                }
            }
        })
    }

    fn constant(&mut self, depth: usize) -> Flat<Value> {
        self.blanks(true)?;
        match self.bytes.peek()? {
            Some(b'"' | b'\'') => Ok(Value::Str(self.strings(false)?)),
            Some(b'(' | b'[') => self.sequence(depth),
            Some(b'0'..=b'9' | b'.') => self.number(false),
            Some(b'-') => {
                self.bytes.advance();
                self.blanks(true)?;
                match self.bytes.peek()? {
                    Some(b'0'..=b'9' | b'.') => self.number(true),
                    _ if depth >= MAX_DEPTH => self.fail("values nested too deep".into()),
                    _ => match self.constant(depth + 1)? {
                        Value::Int(i) => Ok(i.checked_neg().map_or(Value::Float(-(i as f64)), Value::Int)),
                        Value::Float(f) => Ok(Value::Float(-f)),
                        _ => self.fail("\"-\" before something that is not a number".into()),
                    },
                }
            }
            Some(b'+') if depth < MAX_DEPTH => {
                self.bytes.advance();
                match self.constant(depth + 1)? {
                    v @ (Value::Int(_) | Value::Float(_)) => Ok(v),
                    _ => self.fail("\"+\" before something that is not a number".into()),
                }
            }
            Some(0x80..=0x83) => self.binary(),
            Some(c) if c.is_ascii_alphabetic() || c == b'_' => self.named(),
            None => self.fail("the end of the file where a value is expected".into()),
            Some(c) if is_no_text(c) => {
                self.broken(format!("the binary code {c}, which has no meaning, where a value is expected"))
            }
            Some(c) => self.fail(format!("\"{}\" where a value is expected", char::from(c))),
        }
    }

    fn named(&mut self) -> Flat<Value> {
        let word = self.word()?;
        if matches!(self.bytes.peek()?, Some(b'"' | b'\''))
            && let Some(raw) = string_prefix(&word)
        {
            return Ok(Value::Str(self.strings(raw)?));
        }
        match word.as_str() {
            "True" => Ok(Value::Int(1)),
            "False" => Ok(Value::Int(0)),
            "None" => Ok(Value::None),
            // The printf function of C writes such numbers in this form. The call that receives them reports their
            // position.
            "nan" | "NaN" => Ok(Value::Float(f64::NAN)),
            "inf" | "Inf" => Ok(Value::Float(f64::INFINITY)),
            _ => self.fail(format!("the name \"{word}\"")),
        }
    }

    /// Reads a tuple or a list. A single value in parentheses is that value.
    fn sequence(&mut self, depth: usize) -> Flat<Value> {
        if depth >= MAX_DEPTH {
            return self.fail("sequences nested too deep".into());
        }
        let list = self.bytes.peek()? == Some(b'[');
        let close = if list { b']' } else { b')' };
        self.bytes.advance();
        let mut seq = Seq::default();
        let mut comma = false;
        loop {
            self.blanks(true)?;
            if self.bytes.peek()? == Some(close) {
                self.bytes.advance();
                return Ok(Value::Seq(seq));
            }
            // Nearly all values are plain numbers. They are appended directly to the sequence.
            if let Some(number) = self.plain_number()? {
                let pushed = match number {
                    Number::Int(i) => seq.push_int(i),
                    Number::Float(f) => seq.push_float(f),
                };
                if let Err(why) = pushed {
                    return self.fail(why.into());
                }
                comma = true;
                continue;
            }
            let value = self.expression(depth + 1)?;
            self.blanks(true)?;
            if !list && !comma && seq.len() == 0 && self.bytes.peek()? == Some(b')') {
                self.bytes.advance();
                return Ok(value);
            }
            let pushed = seq.push(value);
            if let Err(why) = pushed {
                return self.fail(why.into());
            }
            self.blanks(true)?;
            match self.bytes.peek()? {
                Some(b',') => {
                    self.bytes.advance();
                    comma = true;
                }
                Some(c) if c == close => {}
                None => return self.fail("the end of the file inside of a sequence".into()),
                Some(_) => return self.fail("a sequence that is not constant".into()),
            }
        }
    }

    /// Takes a number and the comma directly after it, so that no arithmetic can follow. Returns `None`, and takes
    /// nothing, when they are not there.
    fn plain_number(&mut self) -> Flat<Option<Number>> {
        let ahead = self.bytes.ahead(64)?;
        let Some((number, len)) = scan_number(ahead) else { return Ok(None) };
        // A comma must follow directly. A single value in parentheses, or arithmetic, is parsed by the general path.
        if ahead.get(len) != Some(&b',') {
            return Ok(None);
        }
        // The comma is taken, and the blank that usually follows it.
        let blank = ahead.get(len + 1) == Some(&b' ');
        self.bytes.skip(len + 1 + usize::from(blank));
        Ok(Some(number))
    }

    fn number(&mut self, negative: bool) -> Flat<Value> {
        // The limit is far beyond the length of useful numbers. Longer numbers are refused, not misread.
        let ahead = self.bytes.ahead(512)?;
        let Some((number, len)) = scan_number(ahead) else {
            return self.fail("a number that cannot be read".into());
        };
        let next = ahead.get(len).copied();
        if next.is_some_and(|c| c.is_ascii_alphanumeric() || c == b'_' || c == b'.') {
            return self.fail("a number that cannot be read".into());
        }
        self.bytes.skip(len);
        Ok(match (number, negative) {
            (Number::Int(i), false) => Value::Int(i),
            (Number::Int(i), true) => Value::Int(-i),
            (Number::Float(f), false) => Value::Float(f),
            (Number::Float(f), true) => Value::Float(-f),
        })
    }

    /// Reads a binary array (reference 3.7).
    fn binary(&mut self) -> Flat<Value> {
        let code = self.bytes.peek()?.unwrap_or(0);
        self.bytes.skip(1);
        let big = code & 1 == 1;
        let Some(head) = self.bytes.data(4)? else {
            return self.broken("a binary array without its length".into());
        };
        let word = |b: &[u8]| {
            let b = [b[0], b[1], b[2], b[3]];
            if big { u32::from_be_bytes(b) } else { u32::from_le_bytes(b) }
        };
        let n = word(head);
        let Ok(n) = usize::try_from(n as i32) else {
            return self.broken(format!("a binary array of {} values", n as i32));
        };
        // The values are read in pieces, because the length in the header may be larger than the data.
        let mut seq = if code < 0x82 { Seq::Ints(Vec::new()) } else { Seq::Floats(Vec::new()) };
        let mut left = n;
        while left > 0 {
            let count = left.min(PIECE);
            let Some(data) = self.bytes.data(count * 4)? else {
                return self.broken(format!("a binary array of {n} values, which the file is too short for"));
            };
            let words = data.chunks_exact(4).map(word);
            match &mut seq {
                Seq::Floats(v) => v.extend(words.map(f32::from_bits)),
                Seq::Ints(v) => v.extend(words.map(|w| w as i32)),
                Seq::Strings(_) => {}
            }
            left -= count;
        }
        Ok(Value::Seq(seq))
    }

    /// Reads a name. Returns an empty string when there is none.
    fn word(&mut self) -> Flat<String> {
        let mut word = String::new();
        while let Some(c) = self.bytes.peek()? {
            if !(c.is_ascii_alphanumeric() || c == b'_') || (word.is_empty() && c.is_ascii_digit()) {
                break;
            }
            word.push(char::from(c));
            self.bytes.advance();
            if word.len() > 256 {
                return self.fail("a name without end".into());
            }
        }
        Ok(word)
    }

    /// Skips blanks, comments and line ends after a backslash. With `lines` it also skips other line ends, where a
    /// statement may continue.
    #[inline]
    pub(crate) fn blanks(&mut self, lines: bool) -> io::Result<()> {
        loop {
            match self.bytes.peek()? {
                Some(b' ' | b'\t' | b'\r' | 0x0c) => self.bytes.advance(),
                Some(b'\n') if lines => self.bytes.advance(),
                Some(b'#') => self.comment()?,
                Some(b'\\') => {
                    let crlf = self.bytes.peek_at(1)? == Some(b'\r');
                    let n = if crlf { 2 } else { 1 };
                    if self.bytes.peek_at(n)? != Some(b'\n') {
                        return Ok(());
                    }
                    (0..=n).for_each(|_| self.bytes.advance());
                }
                // This is a byte order mark at the beginning of the file.
                Some(0xef)
                    if self.bytes.mark() == (0, 1)
                        && self.bytes.ahead(3)?.starts_with(&[0xef, 0xbb, 0xbf]) =>
                {
                    self.bytes.skip(3);
                }
                _ => return Ok(()),
            }
        }
    }

    fn comment(&mut self) -> io::Result<()> {
        while !matches!(self.bytes.peek()?, None | Some(b'\n')) {
            self.bytes.advance();
        }
        Ok(())
    }

    /// Reads the end of a statement, which is a line end, a semicolon or the end of the source.
    fn end_of_statement(&mut self) -> Flat<()> {
        self.blanks(false)?;
        match self.bytes.peek()? {
            None => Ok(()),
            Some(b'\n' | b';') => {
                self.bytes.advance();
                Ok(())
            }
            Some(c) if is_no_text(c) => self.broken(format!("the binary code {c} behind a statement")),
            Some(c) => self.fail(format!("\"{}\" behind a statement", char::from(c))),
        }
    }

    fn broken<T>(&self, what: String) -> Flat<T> {
        Err(NotFlat::Broken(Why { what, line: self.bytes.line() }))
    }

    pub(crate) fn fail<T>(&self, what: String) -> Flat<T> {
        Err(NotFlat::Why(Why { what, line: self.bytes.line() }))
    }
}

/// Returns true for a prefix of raw string literals, and false for another prefix; `None` for any other word.
fn string_prefix(word: &str) -> Option<bool> {
    match word {
        "r" | "R" => Some(true),
        "u" | "U" | "b" | "B" => Some(false),
        _ => None,
    }
}
