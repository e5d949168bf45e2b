//! The tokens of RIB, in the text form and in the binary encoding, which may be mixed (RenderMan interface 3.2,
//! appendix C).

use crate::names::begins_request;
use granita_base::number::{Number, scan_number};
use std::io::{self, Read};

/// The largest number of bytes of a word or a string.
const MAX_TEXT: usize = 1 << 24;
/// The largest number of bytes of a number in text.
const MAX_NUMBER: usize = 512;
/// The largest number of strings that a file may define for later use.
const MAX_DEFINED: usize = 1 << 16;

/// One token.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Token {
    /// The name of a request.
    Word(String),
    /// A string, either in quotes or encoded.
    String(String),
    /// A number without point and exponent that fits into 32 bits.
    Int(i32),
    /// Any other number.
    Float(f32),
    /// An encoded array of this number of floats follows in the stream. [`Lexer::float`] reads them.
    Floats(u32),
    /// `[`.
    Open,
    /// `]`.
    Close,
    /// A description of bytes that do not belong to a token.
    Garbage(String),
    /// A string that ends with its line or with the source, and not with a quote.
    Unclosed,
    /// The end of the source.
    End,
}

/// Cuts a source into tokens.
pub(crate) struct Lexer {
    input: Box<dyn Read>,
    buffer: Vec<u8>,
    at: usize,
    filled: usize,
    line: u32,
    /// The names of encoded requests.
    requests: Vec<Option<String>>,
    strings: Vec<Option<String>>,
}

impl Lexer {
    /// Returns a lexer of a source that is not compressed.
    pub(crate) fn new(input: Box<dyn Read>) -> Self {
        Self {
            input,
            buffer: vec![0; 1 << 16],
            at: 0,
            filled: 0,
            line: 1,
            requests: Vec::new(),
            strings: Vec::new(),
        }
    }

    /// Returns the current line, counted from 1.
    pub(crate) fn line(&self) -> u32 {
        self.line
    }

    #[inline]
    fn peek(&mut self) -> io::Result<Option<u8>> {
        if self.at == self.filled {
            self.at = 0;
            self.filled = loop {
                match self.input.read(&mut self.buffer) {
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => (),
                    other => break other?,
                }
            };
            if self.filled == 0 {
                return Ok(None);
            }
        }
        Ok(Some(self.buffer[self.at]))
    }

    #[inline]
    fn next(&mut self) -> io::Result<Option<u8>> {
        let byte = self.peek()?;
        if let Some(byte) = byte {
            self.at += 1;
            if byte == b'\n' {
                self.line += 1;
            }
        }
        Ok(byte)
    }

    /// Reads a big-endian number of `n` bytes, at most 8.
    fn big_endian(&mut self, n: usize) -> io::Result<u64> {
        (0..n).try_fold(0, |sum, _| Ok(sum << 8 | u64::from(self.raw()?)))
    }

    /// Reads a byte that is not text. It does not end a line.
    fn raw(&mut self) -> io::Result<u8> {
        let byte = self.peek()?.ok_or(io::ErrorKind::UnexpectedEof)?;
        self.at += 1;
        Ok(byte)
    }

    /// Reads the next token.
    pub(crate) fn token(&mut self) -> io::Result<Token> {
        loop {
            let Some(byte) = self.peek()? else { return Ok(Token::End) };
            match byte {
                b' ' | b'\t' | b'\n' | b'\r' | 0x0b | 0x0c | 0 => _ = self.next()?,
                b'#' => {
                    while !matches!(self.peek()?, None | Some(b'\n' | b'\r' | 0xff)) {
                        self.next()?;
                    }
                }
                b'[' | b']' => {
                    self.next()?;
                    return Ok(if byte == b'[' { Token::Open } else { Token::Close });
                }
                b'"' => return Ok(self.quoted()?.map_or(Token::Unclosed, Token::String)),
                b'+' | b'-' | b'.' | b'0'..=b'9' => return self.number(),
                b'a'..=b'z' | b'A'..=b'Z' | b'_' => return self.word().map(Token::Word),
                0x80..=0xff => {
                    if let Some(token) = self.encoded(byte)? {
                        return Ok(token);
                    }
                }
                _ => {
                    self.next()?;
                    return Ok(Token::Garbage(char::from(byte).to_string()));
                }
            }
        }
    }

    /// Reads one float of an encoded array.
    #[inline]
    pub(crate) fn float(&mut self) -> io::Result<f32> {
        Ok(f32::from_bits(self.big_endian(4)? as u32))
    }

    fn word(&mut self) -> io::Result<String> {
        let mut word = String::new();
        while let Some(byte @ (b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'_' | b':' | b'.' | b'-')) =
            self.peek()?
        {
            too_long(word.len(), MAX_TEXT)?;
            word.push(char::from(byte));
            self.next()?;
        }
        Ok(word)
    }

    fn number(&mut self) -> io::Result<Token> {
        let mut text = Vec::with_capacity(16);
        while let Some(byte @ (b'0'..=b'9' | b'.' | b'+' | b'-' | b'a'..=b'z' | b'A'..=b'Z' | b'_')) =
            self.peek()?
        {
            too_long(text.len(), MAX_NUMBER)?;
            text.push(byte);
            self.next()?;
        }
        let digits = text.strip_prefix(b"+").unwrap_or(&text);
        let word = || Token::Garbage(String::from_utf8_lossy(&text).into_owned());
        Ok(match scan_number(digits) {
            Some((Number::Int(i), n)) if n == digits.len() => match i32::try_from(i) {
                Ok(i) => Token::Int(i),
                Err(_) => Token::Float(i as f32),
            },
            Some((Number::Float(f), n)) if n == digits.len() => Token::Float(f as f32),
            _ => match digits.to_ascii_lowercase().as_slice() {
                b"-inf" | b"-infinity" => Token::Float(f32::NEG_INFINITY),
                b"-nan" => Token::Float(f32::NAN),
                _ => word(),
            },
        })
    }

    /// Returns the next bytes, up to `n`, without taking them.
    fn ahead(&mut self, n: usize) -> io::Result<&[u8]> {
        if self.filled - self.at < n {
            self.buffer.copy_within(self.at..self.filled, 0);
            self.filled -= self.at;
            self.at = 0;
            while self.filled < n {
                match self.input.read(&mut self.buffer[self.filled..]) {
                    Ok(0) => break,
                    Ok(more) => self.filled += more,
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => (),
                    Err(error) => return Err(error),
                }
            }
        }
        Ok(&self.buffer[self.at..self.filled.min(self.at + n)])
    }

    /// Reads a string. Returns `None` when it has no end, because the source ends or the next line begins with a
    /// request.
    fn quoted(&mut self) -> io::Result<Option<String>> {
        self.next()?;
        let mut bytes = Vec::new();
        loop {
            too_long(bytes.len(), MAX_TEXT)?;
            match self.next()? {
                None => return Ok(None),
                Some(b'"') => break,
                Some(b'\n') if begins_request(self.ahead(64)?) => return Ok(None),
                Some(b'\\') => match self.next()? {
                    Some(b'n') => bytes.push(b'\n'),
                    Some(b'r') => bytes.push(b'\r'),
                    Some(b't') => bytes.push(b'\t'),
                    Some(b'b') => bytes.push(8),
                    Some(b'f') => bytes.push(12),
                    Some(b'\n') => (),
                    Some(digit @ b'0'..=b'7') => {
                        let mut value = u32::from(digit - b'0');
                        for _ in 0..2 {
                            let Some(digit @ b'0'..=b'7') = self.peek()? else { break };
                            value = value * 8 + u32::from(digit - b'0');
                            self.next()?;
                        }
                        bytes.push(value as u8);
                    }
                    Some(other) => bytes.push(other),
                    None => (),
                },
                Some(other) => bytes.push(other),
            }
        }
        Ok(Some(text(bytes)))
    }

    /// Reads an encoded string of `n` bytes.
    fn string(&mut self, n: usize) -> io::Result<String> {
        too_long(n, MAX_TEXT)?;
        let mut bytes = Vec::with_capacity(n.min(1 << 12));
        for _ in 0..n {
            bytes.push(self.raw()?);
        }
        Ok(text(bytes))
    }

    /// Reads a string in any form, for a definition.
    fn any_string(&mut self) -> io::Result<Option<String>> {
        while matches!(self.peek()?, Some(b' ' | b'\t' | b'\n' | b'\r')) {
            self.next()?;
        }
        // Definitions do not nest. They are followed by a string.
        match self.peek()? {
            Some(b'"') => self.quoted(),
            Some(byte @ 0x90..=0xa3) => match self.encoded(byte)? {
                Some(Token::String(text)) => Ok(Some(text)),
                _ => Ok(None),
            },
            _ => Ok(None),
        }
    }

    /// Reads the item that begins with a byte. Returns `None` for definitions, which are stored.
    fn encoded(&mut self, byte: u8) -> io::Result<Option<Token>> {
        self.raw()?;
        Ok(Some(match byte {
            // These are integers and fixed-point numbers. Bits 2 and 3 hold the number of bytes after the point.
            0x80..=0x8f => {
                let n = usize::from(byte & 3) + 1;
                let behind = u32::from(byte >> 2 & 3);
                let unsigned = self.big_endian(n)?;
                let shift = 64 - 8 * n as u32;
                let value = (unsigned << shift) as i64 >> shift;
                match i32::try_from(value) {
                    Ok(i) if behind == 0 => Token::Int(i),
                    _ => Token::Float((value as f64 / 256_f64.powi(behind as i32)) as f32),
                }
            }
            0x90..=0x9f => Token::String(self.string(usize::from(byte & 15))?),
            0xa0..=0xa3 => {
                let n = self.big_endian(usize::from(byte & 3) + 1)?;
                Token::String(self.string(n as usize)?)
            }
            0xa4 => Token::Float(self.float()?),
            0xa5 => Token::Float(f64::from_bits(self.big_endian(8)?) as f32),
            0xa6 => {
                let code = self.raw()?;
                match self.requests.get(usize::from(code)) {
                    Some(Some(name)) => Token::Word(name.clone()),
                    _ => Token::Garbage(format!("request number {code}, which is not defined")),
                }
            }
            0xc8..=0xcb => Token::Floats(self.big_endian(usize::from(byte & 3) + 1)? as u32),
            0xcc => {
                let code = usize::from(self.raw()?);
                let name = self.any_string()?;
                keep(&mut self.requests, code, name);
                return Ok(None);
            }
            0xcd | 0xce => {
                let index = self.big_endian(usize::from(byte - 0xcd) + 1)? as usize;
                let text = self.any_string()?;
                keep(&mut self.strings, index, text);
                return Ok(None);
            }
            0xcf | 0xd0 => {
                let index = self.big_endian(usize::from(byte - 0xcf) + 1)? as usize;
                match self.strings.get(index) {
                    Some(Some(text)) => Token::String(text.clone()),
                    _ => Token::Garbage(format!("string number {index}, which is not defined")),
                }
            }
            // A program that writes RIB ends its output with this byte.
            0xff => return Ok(None),
            _ => Token::Garbage(format!("byte {byte:#04x}")),
        }))
    }
}

fn keep(list: &mut Vec<Option<String>>, index: usize, text: Option<String>) {
    if index < MAX_DEFINED {
        if list.len() <= index {
            list.resize(index + 1, None);
        }
        list[index] = text;
    }
}

fn too_long(length: usize, most: usize) -> io::Result<()> {
    if length >= most {
        return Err(io::Error::other(format!("a word, number or string of more than {most} bytes")));
    }
    Ok(())
}

/// Converts bytes to text. Strings of old files may have any encoding. Bytes that are not UTF-8 are read as Latin-1.
fn text(bytes: Vec<u8>) -> String {
    String::from_utf8(bytes).unwrap_or_else(|e| e.into_bytes().iter().map(|b| char::from(*b)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lexer(bytes: &[u8]) -> Lexer {
        Lexer::new(Box::new(io::Cursor::new(bytes.to_vec())))
    }

    fn tokens(bytes: &[u8]) -> Vec<Token> {
        let mut lexer = lexer(bytes);
        let mut list = Vec::new();
        loop {
            match lexer.token() {
                Ok(Token::End) | Err(_) => return list,
                Ok(Token::Floats(n)) => {
                    list.extend((0..n).map_while(|_| lexer.float().ok()).map(Token::Float))
                }
                Ok(token) => list.push(token),
            }
        }
    }

    #[test]
    fn text_is_split_into_tokens() {
        let s = |t: &str| Token::String(t.to_owned());
        let w = |t: &str| Token::Word(t.to_owned());
        let all = tokens(
            b"##RenderMan RIB\nFormat 640 +480 -1.5e1 # c\nSphere[.5 1.]\"a\\\"\\101\\n\" \"caf\xe9\"",
        );
        let expected = vec![
            w("Format"),
            Token::Int(640),
            Token::Int(480),
            Token::Float(-15.0),
            w("Sphere"),
            Token::Open,
            Token::Float(0.5),
            Token::Float(1.0),
            Token::Close,
            s("a\"A\n"),
            s("caf\u{e9}"),
        ];
        assert_eq!(all, expected);
        assert_eq!(tokens(b"1x {"), [Token::Garbage("1x".into()), Token::Garbage("{".into())]);
        assert_eq!(lexer(b"\"no end").token().unwrap(), Token::Unclosed);
    }

    #[test]
    fn binary_encodings_become_tokens() {
        let bytes = [
            &[0x80, 0xff][..],                                    // -1 in one byte
            &[0x81, 0x01, 0x00],                                  // 256 in two
            &[0x85, 0x01, 0x80],                                  // 1.5 with one byte behind the point
            &[0x92, b'h', b'i'],                                  // a short string
            &[0xa0, 3, b'a', b'b', b'c'],                         // a long one
            &[0xa4, 0x3f, 0x80, 0, 0],                            // 1.0
            &[0xa5, 0x40, 0, 0, 0, 0, 0, 0, 0],                   // 2.0
            &[0xcc, 7, 0x96, b'S', b'p', b'h', b'e', b'r', b'e'], // request 7
            &[0xa6, 7],
            &[0xcd, 1, b'"', b'K', b'd', b'"'], // string 1
            &[0xcf, 1],
            &[0xc8, 2, 0x3f, 0x80, 0, 0, 0xbf, 0x80, 0, 0], // an array
            &[0xff, 0xa6, 9, 0xd1],
        ]
        .concat();
        let s = |t: &str| Token::String(t.to_owned());
        let expected = vec![
            Token::Int(-1),
            Token::Int(256),
            Token::Float(1.5),
            s("hi"),
            s("abc"),
            Token::Float(1.0),
            Token::Float(2.0),
            Token::Word("Sphere".into()),
            s("Kd"),
            Token::Float(1.0),
            Token::Float(-1.0),
            Token::Garbage("request number 9, which is not defined".into()),
            Token::Garbage("byte 0xd1".into()),
        ];
        assert_eq!(tokens(&bytes), expected);
        // The length is larger than the file.
        assert!(tokens(&[0xa3, 0xff, 0xff, 0xff, 0xff, b'x']).is_empty());
    }

    proptest! {
        #[test]
        fn random_bytes_end_in_at_most_one_token_per_byte(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
            let n = tokens(&bytes).len();
            prop_assert!(n <= bytes.len() + 1);
        }

        #[test]
        fn printed_numbers_are_read_as_the_same_tokens(values in proptest::collection::vec(any::<i32>(), 0..20), f in any::<f32>()) {
            let text: String = values.iter().map(|v| format!("{v} ")).collect();
            let expected: Vec<Token> = values.iter().map(|v| Token::Int(*v)).collect();
            prop_assert_eq!(tokens(text.as_bytes()), expected);
            if f.is_finite() {
                let got = tokens(format!("{f:?}").as_bytes());
                prop_assert_eq!(got, vec![Token::Float(f)]);
            }
        }

        #[test]
        fn printed_words_and_strings_are_read_as_the_same_tokens(word in "[A-Za-z_][A-Za-z0-9_]{0,20}", string in "[ -~]{0,40}") {
            let quoted = string.replace('\\', "\\\\").replace('"', "\\\"");
            let got = tokens(format!("{word} \"{quoted}\"").as_bytes());
            prop_assert_eq!(got, vec![Token::Word(word), Token::String(string)]);
        }
    }
}
