//! Fields of fixed headers that are metadata, one row of a table for each, for DPX and Cineon.

use granita_base::{BaseType, Param, ParamData, ParamType, Params};

/// The kind of a field. Undefined fields have all bits set, and undefined texts are empty.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Kind {
    /// A text of fewer than so many bytes, which a NUL ends. Some programs omit the NUL.
    Text(usize),
    /// A text of exactly so many bytes.
    Characters(usize),
    /// A date of 24 bytes, "yyyy:mm:dd:hh:mm:ss" and a time zone. Its attribute is "yyyy:mm:dd hh:mm:ss".
    Date,
    /// An unsigned number of 8 bits.
    Byte,
    /// An unsigned number of 32 bits.
    Long,
    /// A float of 32 bits.
    Real,
    /// A time of four bytes, each with two decimal digits. Its attribute is "hh:mm:ss:ff".
    TimeCode,
    /// A number of 8 bits that selects a word.
    Word(&'static [&'static str]),
}

/// A field of a header.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Field {
    /// The name of the attribute.
    pub(crate) name: &'static str,
    /// The offset in bytes.
    pub(crate) at: usize,
    pub(crate) kind: Kind,
}

impl Field {
    pub(crate) const fn new(name: &'static str, at: usize, kind: Kind) -> Self {
        Self { name, at, kind }
    }
}

/// The fields of a header in memory.
pub(crate) struct Header {
    bytes: Vec<u8>,
    big_endian: bool,
}

impl Header {
    pub(crate) fn new(bytes: Vec<u8>, big_endian: bool) -> Self {
        Self { bytes, big_endian }
    }

    pub(crate) fn is_big_endian(&self) -> bool {
        self.big_endian
    }

    pub(crate) fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// Returns `len` bytes, or fewer at the end of the header.
    fn slice(&self, at: usize, len: usize) -> &[u8] {
        let end = at.saturating_add(len).min(self.bytes.len());
        self.bytes.get(at..end).unwrap_or_default()
    }

    /// Returns a number of 8 bits. It is undefined beyond the end of the header.
    pub(crate) fn byte(&self, at: usize) -> u8 {
        self.bytes.get(at).copied().unwrap_or(u8::MAX)
    }

    /// Returns a number of 16 bits. It is undefined beyond the end of the header.
    pub(crate) fn short(&self, at: usize) -> u16 {
        let Ok(bytes) = self.slice(at, 2).try_into() else { return u16::MAX };
        if self.big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) }
    }

    /// Returns a number of 32 bits. It is undefined beyond the end of the header.
    pub(crate) fn long(&self, at: usize) -> u32 {
        let Ok(bytes) = self.slice(at, 4).try_into() else { return u32::MAX };
        if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
    }

    /// Returns a text of at most `len` bytes; `None` for an undefined one.
    pub(crate) fn text(&self, at: usize, len: usize) -> Option<String> {
        let text = self.slice(at, len).split(|b| *b == 0).next().unwrap_or_default();
        let defined = text.first().is_some_and(|b| *b != u8::MAX);
        defined.then(|| String::from_utf8_lossy(text).trim_end().to_owned()).filter(|t| !t.is_empty())
    }

    /// Stores a number of 32 bits.
    pub(crate) fn set_long(&mut self, at: usize, value: u32) {
        let bytes = if self.big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
        self.bytes[at..at + 4].copy_from_slice(&bytes);
    }

    /// Stores a number of 16 bits.
    pub(crate) fn set_short(&mut self, at: usize, value: u16) {
        let bytes = if self.big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
        self.bytes[at..at + 2].copy_from_slice(&bytes);
    }

    /// Stores the first `len` bytes of a text, up to a whole character, and fills the rest with NUL.
    pub(crate) fn set_text(&mut self, at: usize, len: usize, text: &str) {
        let end = (0..=len.min(text.len())).rev().find(|i| text.is_char_boundary(*i)).unwrap_or(0);
        self.bytes[at..at + len].fill(0);
        self.bytes[at..at + end].copy_from_slice(&text.as_bytes()[..end]);
    }

    /// Stores a number of 8 bits.
    pub(crate) fn set_byte(&mut self, at: usize, value: u8) {
        self.bytes[at] = value;
    }

    /// Adds an attribute for each defined field of a table.
    pub(crate) fn read(&self, table: &[Field], attributes: &mut Params) {
        for field in table {
            if let Some(data) = self.value(field) {
                attributes.set(param(field.name, data));
            }
        }
    }

    fn value(&self, field: &Field) -> Option<ParamData> {
        let at = field.at;
        Some(match field.kind {
            Kind::Text(len) | Kind::Characters(len) => self.text(at, len)?.as_str().into(),
            Kind::Date => {
                let text = self.text(at, 24)?;
                match (text.get(..10), text.get(10..11), text.get(11..19)) {
                    (Some(day), Some(":" | " "), Some(time)) => format!("{day} {time}").as_str().into(),
                    _ => text.as_str().into(),
                }
            }
            Kind::Byte => i32::from(Some(self.byte(at)).filter(|v| *v != u8::MAX)?).into(),
            Kind::Long => i32::try_from(self.long(at)).ok()?.into(),
            Kind::Real => Some(f32::from_bits(self.long(at))).filter(|v| v.is_finite())?.into(),
            Kind::TimeCode => {
                let [h, m, s, f] = Some(self.long(at)).filter(|v| *v != u32::MAX)?.to_be_bytes();
                format!("{h:02x}:{m:02x}:{s:02x}:{f:02x}").as_str().into()
            }
            Kind::Word(words) => (*words.get(usize::from(self.byte(at)))?).into(),
        })
    }

    /// Stores the attributes of a table that are there.
    pub(crate) fn write(&mut self, table: &[Field], attributes: &Params) {
        for Field { name, at, kind } in table {
            let Some(name) = attributes.iter().rev().find(|p| p.name.eq_ignore_ascii_case(name)) else {
                continue;
            };
            let name = &name.name;
            let text = attributes.string(name).map(|t| &**t);
            let int = attributes.int(name);
            match *kind {
                Kind::Text(len) => text.into_iter().for_each(|text| self.set_text(*at, len - 1, text)),
                Kind::Characters(len) => text.into_iter().for_each(|text| self.set_text(*at, len, text)),
                Kind::Date => {
                    let parts = text.and_then(|t| Some((t.get(..10)?, t.get(11..19)?)));
                    if let Some((day, time)) = parts {
                        self.set_text(*at, 24, &format!("{day}:{time}"));
                    }
                }
                Kind::Byte => {
                    int.and_then(|v| u8::try_from(v).ok()).into_iter().for_each(|v| self.set_byte(*at, v));
                }
                Kind::Long => {
                    int.and_then(|v| u32::try_from(v).ok()).into_iter().for_each(|v| self.set_long(*at, v));
                }
                Kind::Real => {
                    let value = attributes.float(name).or_else(|| int.map(|v| v as f32));
                    value.into_iter().for_each(|v| self.set_long(*at, v.to_bits()));
                }
                Kind::TimeCode => {
                    let digits: String = text.unwrap_or_default().split([':', ';']).collect();
                    if let (8, Ok(code)) = (digits.len(), u32::from_str_radix(&digits, 16)) {
                        self.set_long(*at, code);
                    }
                }
                Kind::Word(words) => {
                    let word = |text: &str| words.iter().position(|w| w.eq_ignore_ascii_case(text));
                    text.and_then(word).into_iter().for_each(|i| self.set_byte(*at, i as u8));
                }
            }
        }
    }
}

/// Returns an attribute with one value.
pub(crate) fn param(name: &str, data: ParamData) -> Param {
    let base = match data {
        ParamData::Float(_) => BaseType::Float,
        ParamData::Int(_) => BaseType::Int,
        ParamData::String(_) => BaseType::String,
    };
    Param { name: name.into(), ty: ParamType::of(base), data }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: [Field; 7] = [
        Field::new("text", 0, Kind::Characters(6)),
        Field::new("date", 6, Kind::Date),
        Field::new("byte", 30, Kind::Byte),
        Field::new("long", 31, Kind::Long),
        Field::new("real", 35, Kind::Real),
        Field::new("time", 39, Kind::TimeCode),
        Field::new("word", 43, Kind::Word(&["none", "linear"])),
    ];

    #[test]
    fn fields_survive_write_and_read_in_both_byte_orders() {
        let mut given = Params::new();
        for (name, data) in [
            ("text", "a\u{f6}\u{f6}\u{f6}".into()),
            ("date", "2001:02:03 04:05:06".into()),
            ("byte", 7.into()),
            ("long", 70_000.into()),
            ("real", 2.5.into()),
            ("time", "01:02:03:24".into()),
            ("word", "Linear".into()),
        ] {
            given.set(param(name, data));
        }
        for big_endian in [false, true] {
            let mut header = Header::new(vec![0xff; 44], big_endian);
            header.write(&TABLE, &given);
            let mut got = Params::new();
            header.read(&TABLE, &mut got);
            // Half of a character is not stored.
            assert_eq!(got.string("text").map(|t| &**t), Some("a\u{f6}\u{f6}"));
            assert_eq!(got.string("date").map(|t| &**t), Some("2001:02:03 04:05:06"));
            assert_eq!(
                (got.int("byte"), got.int("long"), got.float("real")),
                (Some(7), Some(70_000), Some(2.5))
            );
            assert_eq!(got.string("time").map(|t| &**t), Some("01:02:03:24"));
            assert_eq!(got.string("word").map(|t| &**t), Some("linear"));
        }
    }

    #[test]
    fn undefined_and_missing_fields_have_no_attribute() {
        for bytes in [vec![0xff; 44], Vec::new()] {
            let mut got = Params::new();
            Header::new(bytes, true).read(&TABLE, &mut got);
            assert!(got.is_empty(), "{got:?}");
        }
    }
}
