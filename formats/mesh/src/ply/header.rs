//! The header of a PLY file, which lists the elements and their properties.

use crate::text::Words;

/// The encoding of the values after the header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// A type of values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn from_word(word: &[u8]) -> Option<Self> {
        Some(match word {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    /// Returns the number of bytes of a binary value.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Returns the value that represents 1 in a colour of this type.
    pub(super) fn one(self) -> f32 {
        match self {
            Self::F32 | Self::F64 => 1.0,
            Self::I16 | Self::U16 => 65535.0,
            _ => 255.0,
        }
    }
}

/// One value, or a list with its length before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

/// One property of an element.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
}

/// A kind of element, and the number of elements of this kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// Returns the least number of bytes of one such element.
    pub(super) fn least_bytes(&self, encoding: Encoding) -> u64 {
        let of = |p: &Property| match (encoding, p.kind) {
            // A digit and a separator.
            (Encoding::Ascii, _) => 2,
            (_, Kind::Scalar(ty)) => ty.size() as u64,
            (_, Kind::List { count, .. }) => count.size() as u64,
        };
        self.properties.iter().map(of).sum()
    }

    /// Returns the index of the first property with one of these names.
    pub(super) fn property(&self, names: &[&str]) -> Option<usize> {
        names.iter().find_map(|name| self.properties.iter().position(|p| p.name == *name))
    }
}

/// The whole header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
}

/// The header while its lines are read.
#[derive(Debug, Default)]
pub(super) struct HeaderReader {
    encoding: Option<Encoding>,
    elements: Vec<Element>,
    lines: u32,
}

/// The largest number of lines of a header. Real files have fewer.
const MOST_LINES: u32 = 1 << 16;

impl HeaderReader {
    /// Reads the next line. Returns the header when the line is its end.
    ///
    /// # Errors
    /// Returns the error in the line.
    pub(super) fn line(&mut self, text: &[u8]) -> Result<Option<Header>, String> {
        self.lines += 1;
        if self.lines > MOST_LINES {
            return Err(format!("a header of more than {MOST_LINES} lines"));
        }
        let mut words = Words(text);
        let Some(keyword) = words.word() else { return Ok(None) };
        let show = |word: &[u8]| String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned();
        if self.lines == 1 {
            return if keyword == b"ply" {
                Ok(None)
            } else {
                Err("no PLY file: it does not begin with \"ply\"".into())
            };
        }
        match keyword {
            b"format" => {
                let word = words.word().unwrap_or(b"");
                self.encoding = Some(match word {
                    b"ascii" => Encoding::Ascii,
                    b"binary_little_endian" => Encoding::LittleEndian,
                    b"binary_big_endian" => Encoding::BigEndian,
                    _ => return Err(format!("unknown format \"{}\"", show(word))),
                });
            }
            b"element" => {
                let name = words.word().map(show).ok_or("an element without a name")?;
                let count = words.word().unwrap_or(b"");
                let count = std::str::from_utf8(count).ok().and_then(|w| w.parse().ok());
                let count = count.ok_or_else(|| format!("element \"{name}\" without a number of them"))?;
                self.elements.push(Element { name, count, properties: Vec::new() });
            }
            b"property" => {
                let scalar = |word: Option<&[u8]>| {
                    let word = word.unwrap_or(b"");
                    Scalar::from_word(word)
                        .ok_or_else(|| format!("unknown type \"{}\" of a property", show(word)))
                };
                let kind = match words.word() {
                    Some(b"list") => Kind::List { count: scalar(words.word())?, item: scalar(words.word())? },
                    word => Kind::Scalar(scalar(word)?),
                };
                let name = words.word().map(show).ok_or("a property without a name")?;
                let element = self.elements.last_mut().ok_or("a property before the first element")?;
                element.properties.push(Property { name, kind });
            }
            b"comment" | b"obj_info" => {}
            b"end_header" => {
                let encoding = self.encoding.ok_or("a header without a format")?;
                return Ok(Some(Header { encoding, elements: std::mem::take(&mut self.elements) }));
            }
            _ => return Err(format!("unknown word \"{}\" in the header", show(keyword))),
        }
        Ok(None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Option<Header>, String> {
        let mut reader = HeaderReader::default();
        for line in text.lines() {
            if let Some(header) = reader.line(line.as_bytes())? {
                return Ok(Some(header));
            }
        }
        Ok(None)
    }

    #[test]
    fn a_header() {
        let text = "ply\nformat ascii 1.0\ncomment x\nelement vertex 8\nproperty float x\nproperty float64 y\n\
                    element face 6\nproperty list uint8 int vertex_indices\nend_header\n";
        let header = parse(text).unwrap().unwrap();
        assert_eq!(header.encoding, Encoding::Ascii);
        assert_eq!((header.elements[0].name.as_str(), header.elements[0].count), ("vertex", 8));
        assert_eq!(header.elements[0].properties[1].kind, Kind::Scalar(Scalar::F64));
        let list = Kind::List { count: Scalar::U8, item: Scalar::I32 };
        assert_eq!(header.elements[1].properties[0].kind, list);
        assert_eq!(header.elements[1].property(&["vertex_index", "vertex_indices"]), Some(0));
        assert_eq!(header.elements[0].least_bytes(Encoding::BigEndian), 12);
    }

    #[test]
    fn mistakes() {
        for (text, want) in [
            ("plyx", "no PLY file: it does not begin with \"ply\""),
            ("ply\nformat text 1.0", "unknown format \"text\""),
            ("ply\nelement vertex", "element \"vertex\" without a number of them"),
            ("ply\nelement vertex -1", "element \"vertex\" without a number of them"),
            ("ply\nelement", "an element without a name"),
            ("ply\nproperty float x", "a property before the first element"),
            ("ply\nelement a 1\nproperty half x", "unknown type \"half\" of a property"),
            ("ply\nelement a 1\nproperty list float x", "unknown type \"x\" of a property"),
            ("ply\nelement a 1\nproperty float", "a property without a name"),
            ("ply\nend_header", "a header without a format"),
            ("ply\nhello", "unknown word \"hello\" in the header"),
        ] {
            assert_eq!(parse(text), Err(want.to_owned()), "{text}");
        }
        assert_eq!(parse("ply\nformat ascii 1.0\n"), Ok(None));
    }
}
