//! Cuts statements that are not flat calls out of the source, for Python to execute.

use crate::bytes::Bytes;
use std::io;

/// The part that a statement lacks.
const STRING: &str = "a string without its end";
const BRACKET: &str = "a bracket without its end";

/// The words that continue a compound statement at the same indentation.
const CONTINUED: [&[u8]; 4] = [b"else", b"elif", b"except", b"finally"];

/// Takes the next statement, which is one logical line and the indented block that belongs to it.
///
/// The text is unchanged, except that binary arrays (reference 3.7) become lists. Returns the missing part when its
/// first line cannot be Python because a string or a bracket has no end.
pub(crate) fn take_statement(bytes: &mut Bytes, out: &mut Vec<u8>) -> io::Result<Option<&'static str>> {
    let mut decorated = bytes.peek()? == Some(b'@');
    let missing = take_logical_line(bytes, out)?;
    if missing.is_some() {
        return Ok(missing);
    }
    loop {
        // Blank lines and comments belong to the block only if the block continues after them.
        let start = bytes.mark();
        let blank = take_blank_lines(bytes)?;
        let next = bytes.peek()?;
        let goes_on = match next {
            None => false,
            Some(b' ' | b'\t') => true,
            Some(b'@') => decorated,
            Some(_) => decorated || continues(bytes)?,
        };
        if !goes_on {
            bytes.back_to(start);
            return Ok(None);
        }
        out.extend(std::iter::repeat_n(b'\n', blank));
        if !matches!(next, Some(b' ' | b'\t' | b'@')) {
            decorated = false;
        }
        take_logical_line(bytes, out)?;
    }
}

/// Skips the line that begins here and all others up to one that begins with a call of the scene interface.
pub(crate) fn skip_to_call(bytes: &mut Bytes) -> io::Result<()> {
    loop {
        while let Some(c) = bytes.peek()? {
            bytes.advance();
            if c == b'\n' {
                break;
            }
        }
        if bytes.peek()?.is_none() || begins_with_call(bytes.ahead(64)?) {
            return Ok(());
        }
    }
}

/// True when a statement begins with the name of a call and a parenthesis.
pub(crate) fn begins_with_call(statement: &[u8]) -> bool {
    let statement = &statement[..statement.len().min(64)];
    let end = statement.iter().position(|c| !c.is_ascii_alphanumeric() && *c != b'_').unwrap_or(0);
    let next = statement[end..].iter().find(|c| !matches!(c, b' ' | b'\t'));
    next == Some(&b'(') && std::str::from_utf8(&statement[..end]).is_ok_and(crate::names::is_call)
}

/// Takes the rest of the source.
pub(crate) fn take_rest(bytes: &mut Bytes, out: &mut Vec<u8>) -> io::Result<()> {
    while bytes.peek()?.is_some() {
        take_logical_line(bytes, out)?;
    }
    Ok(())
}

/// True when one of the continuing words comes next.
fn continues(bytes: &mut Bytes) -> io::Result<bool> {
    let ahead = bytes.ahead(16)?;
    Ok(CONTINUED.iter().any(|word| {
        let ends = !ahead.get(word.len()).is_some_and(|c| c.is_ascii_alphanumeric() || *c == b'_');
        ahead.starts_with(word) && ends
    }))
}

/// Skips lines that are blank or comments. Returns their number.
fn take_blank_lines(bytes: &mut Bytes) -> io::Result<usize> {
    let mut lines = 0;
    loop {
        let start = bytes.mark();
        while matches!(bytes.peek()?, Some(b' ' | b'\t' | b'\r' | 0x0c)) {
            bytes.advance();
        }
        if bytes.peek()? == Some(b'#') {
            while !matches!(bytes.peek()?, None | Some(b'\n')) {
                bytes.advance();
            }
        }
        match bytes.peek()? {
            Some(b'\n') => {
                bytes.advance();
                lines += 1;
            }
            None => return Ok(lines),
            Some(_) => {
                bytes.back_to(start);
                return Ok(lines);
            }
        }
    }
}

/// Takes one line with all lines that brackets, long strings and backslashes join to it. Returns the missing part when
/// it cannot be Python.
fn take_logical_line(bytes: &mut Bytes, out: &mut Vec<u8>) -> io::Result<Option<&'static str>> {
    let mut depth = 0usize;
    let mut missing = None;
    // True when a line inside of brackets begins with a call. If anything is missing, it is then the bracket before
    // that line.
    let mut runs_over = false;
    while let Some(c) = bytes.peek()? {
        match c {
            0x80..=0x83 => {
                take_binary(bytes, out)?;
                continue;
            }
            0xc2..=0xf4 => {
                // The character has several bytes. The following ones are not binary codes.
                let n = if c >= 0xf0 {
                    4
                } else if c >= 0xe0 {
                    3
                } else {
                    2
                };
                for _ in 0..n {
                    if let Some(b) = bytes.peek()? {
                        out.push(b);
                        bytes.advance();
                    }
                }
                continue;
            }
            b'"' | b'\'' => {
                if !take_string(bytes, out)? {
                    // This is an error, whatever follows. The statement ends with this line.
                    missing = Some(if runs_over { BRACKET } else { STRING });
                    depth = 0;
                }
                continue;
            }
            b'#' => {
                while !matches!(bytes.peek()?, None | Some(b'\n')) {
                    bytes.advance();
                }
                continue;
            }
            b'(' | b'[' | b'{' => depth += 1,
            b')' | b']' | b'}' => depth = depth.saturating_sub(1),
            b'\\' => {
                out.push(c);
                bytes.advance();
                if let Some(b @ (b'\n' | b'\r')) = bytes.peek()? {
                    out.push(b);
                    bytes.advance();
                    if b == b'\r' && bytes.peek()? == Some(b'\n') {
                        out.push(b'\n');
                        bytes.advance();
                    }
                }
                continue;
            }
            _ => {}
        }
        out.push(c);
        bytes.advance();
        if c == b'\n' && depth == 0 {
            return Ok(missing);
        }
        runs_over |= c == b'\n' && begins_with_call(bytes.ahead(64)?);
    }
    Ok(missing.or((depth > 0).then_some(BRACKET)))
}

/// Takes a string. Returns false when the line, or the file, ends before the string does.
fn take_string(bytes: &mut Bytes, out: &mut Vec<u8>) -> io::Result<bool> {
    let quote = bytes.peek()?.unwrap_or(b'"');
    let triple = bytes.peek_at(1)? == Some(quote) && bytes.peek_at(2)? == Some(quote);
    let mut take = |bytes: &mut Bytes, n: usize| -> io::Result<()> {
        for _ in 0..n {
            if let Some(c) = bytes.peek()? {
                out.push(c);
                bytes.advance();
            }
        }
        Ok(())
    };
    take(bytes, if triple { 3 } else { 1 })?;
    while let Some(c) = bytes.peek()? {
        match c {
            b'\\' => take(bytes, 2)?,
            b'\n' if !triple => return Ok(false),
            _ if c == quote && !triple => {
                take(bytes, 1)?;
                return Ok(true);
            }
            _ if c == quote && bytes.peek_at(1)? == Some(quote) && bytes.peek_at(2)? == Some(quote) => {
                take(bytes, 3)?;
                return Ok(true);
            }
            _ => take(bytes, 1)?,
        }
    }
    Ok(false)
}

/// Takes a binary array and appends it as a list. An array that is cut short is left out, which Python then reports as
/// an error.
fn take_binary(bytes: &mut Bytes, out: &mut Vec<u8>) -> io::Result<()> {
    use std::io::Write;
    let code = bytes.peek()?.unwrap_or(0);
    bytes.skip(1);
    let word = |b: &[u8]| {
        let b = [b[0], b[1], b[2], b[3]];
        if code & 1 == 1 { u32::from_be_bytes(b) } else { u32::from_le_bytes(b) }
    };
    let Some(n) = bytes.data(4)?.map(word) else { return Ok(()) };
    let Some(data) = bytes.data((n as usize).saturating_mul(4))? else { return Ok(()) };
    out.push(b'[');
    for w in data.chunks_exact(4).map(word) {
        if code < 0x82 {
            write!(out, "{},", w as i32)?;
        } else {
            let f = f32::from_bits(w);
            if f.is_finite() {
                write!(out, "{f:?},")?;
            } else {
                write!(out, "float('{f}'),")?;
            }
        }
    }
    out.push(b']');
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pieces(text: &[u8]) -> Vec<String> {
        let mut bytes = Bytes::new(Box::new(io::Cursor::new(text.to_vec())), 1 << 20);
        let mut all = Vec::new();
        while bytes.peek().unwrap().is_some() {
            let mut out = Vec::new();
            take_statement(&mut bytes, &mut out).unwrap();
            // A comment alone becomes an empty line.
            if out != b"\n" {
                all.push(String::from_utf8(out).unwrap());
            }
        }
        all
    }

    #[test]
    fn scripts_are_split_between_whole_statements() {
        let text = b"def f(x):\n    a = (1,\n2)\n\n    return x\n# c\nb = 1\nif b:\n  pass\nelse:\n  pass\nelsewhere = 2\n@d\n@e\ndef g(): pass\nz\n";
        let got = pieces(text);
        assert_eq!(got[0], "def f(x):\n    a = (1,\n2)\n\n    return x\n");
        assert_eq!(got[1], "b = 1\n");
        assert_eq!(got[2], "if b:\n  pass\nelse:\n  pass\n");
        assert_eq!(got[3], "elsewhere = 2\n");
        assert_eq!(got[4], "@d\n@e\ndef g(): pass\n");
        assert_eq!(got[5], "z\n");
    }

    #[test]
    fn brackets_in_strings_and_comments_do_not_count() {
        assert_eq!(pieces(b"a = '(' # (\nb = \"\"\"(\n'\"\"\"\nc = '\\'('\n").len(), 3);
        assert_eq!(pieces("é = '\u{80}'\nb\n".as_bytes()).len(), 2);
    }

    #[test]
    fn binary_arrays_become_lists() {
        let mut text = b"x = ".to_vec();
        text.extend([0x83, 0, 0, 0, 2]);
        text.extend(1.5f32.to_be_bytes());
        text.extend((-2.0f32).to_be_bytes());
        text.extend(b"; y = ");
        text.extend([0x80, 1, 0, 0, 0, 10, 0, 0, 0]);
        text.extend(b"\n");
        assert_eq!(pieces(&text), ["x = [1.5,-2.0,]; y = [10,]\n"]);
    }
}
