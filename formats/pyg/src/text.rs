//! String literals.

use crate::flat::{Flat, Parser};
use std::sync::Arc;

impl Parser {
    /// Reads string literals. Adjacent ones form one string.
    pub(crate) fn strings(&mut self, raw: bool) -> Flat<Arc<str>> {
        let mut text = self.string(raw)?;
        loop {
            self.blanks(true)?;
            match self.bytes.peek()? {
                Some(b'"' | b'\'') => text.push_str(&self.string(false)?),
                _ => return Ok(text.into()),
            }
        }
    }

    /// Reads one string literal. Escapes are replaced unless `raw`. Bytes that are not UTF-8 are read as Latin-1.
    pub(crate) fn string(&mut self, raw: bool) -> Flat<String> {
        let quote = self.bytes.peek()?.unwrap_or(b'"');
        self.bytes.advance();
        let triple = self.bytes.peek()? == Some(quote) && self.bytes.peek_at(1)? == Some(quote);
        if triple {
            self.bytes.advance();
            self.bytes.advance();
        }
        let mut text: Vec<u8> = Vec::new();
        loop {
            let Some(c) = self.bytes.peek()? else {
                return self.fail("the end of the file inside of a string".into());
            };
            if c == quote {
                if !triple {
                    self.bytes.advance();
                    break;
                }
                if self.bytes.peek_at(1)? == Some(quote) && self.bytes.peek_at(2)? == Some(quote) {
                    (0..3).for_each(|_| self.bytes.advance());
                    break;
                }
            }
            if c == b'\n' && !triple {
                return self.fail("the end of the line inside of a string".into());
            }
            self.bytes.advance();
            if c == b'\\' {
                self.escape(raw, &mut text)?;
            } else {
                text.push(c);
            }
        }
        Ok(String::from_utf8(text)
            .unwrap_or_else(|e| e.into_bytes().iter().map(|&b| char::from(b)).collect()))
    }

    /// Reads the rest of an escape, after the backslash.
    fn escape(&mut self, raw: bool, text: &mut Vec<u8>) -> Flat<()> {
        let Some(c) = self.bytes.peek()? else { return Ok(()) };
        if raw {
            text.push(b'\\');
            text.push(c);
            self.bytes.advance();
            return Ok(());
        }
        self.bytes.advance();
        let plain = match c {
            b'n' => b'\n',
            b't' => b'\t',
            b'r' => b'\r',
            b'a' => 7,
            b'b' => 8,
            b'f' => 12,
            b'v' => 11,
            b'\\' | b'\'' | b'"' => c,
            b'\n' => return Ok(()),
            b'0'..=b'7' => {
                let mut code = u32::from(c - b'0');
                for _ in 0..2 {
                    match self.bytes.peek()? {
                        Some(d @ b'0'..=b'7') => {
                            code = code * 8 + u32::from(d - b'0');
                            self.bytes.advance();
                        }
                        _ => break,
                    }
                }
                return self.character(code, text);
            }
            b'x' => return self.hex(2, text),
            b'u' => return self.hex(4, text),
            b'U' => return self.hex(8, text),
            // Python keeps unknown escapes.
            _ => {
                text.push(b'\\');
                c
            }
        };
        text.push(plain);
        Ok(())
    }

    fn hex(&mut self, digits: usize, text: &mut Vec<u8>) -> Flat<()> {
        let mut code = 0;
        for _ in 0..digits {
            let digit = self.bytes.peek()?.and_then(|d| char::from(d).to_digit(16));
            let Some(digit) = digit else {
                return self.fail("an escape in a string with too few digits".into());
            };
            code = code * 16 + digit;
            self.bytes.advance();
        }
        self.character(code, text)
    }

    fn character(&self, code: u32, text: &mut Vec<u8>) -> Flat<()> {
        let Some(c) = char::from_u32(code) else {
            return self.fail(format!("no character has the code {code:#x}"));
        };
        text.extend(c.encode_utf8(&mut [0; 4]).bytes());
        Ok(())
    }
}
