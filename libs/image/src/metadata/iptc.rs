//! IPTC, the metadata of archives and news agencies (IPTC-NAA Information Interchange Model, version 4.2): records of
//! numbered texts.

use super::{param, text, value};
use granita_base::{ParamData, Params};

/// The numbers of texts of the record 2, the names of their attributes, and true for those of which there may be
/// several. Several are one text, separated by "; ".
#[rustfmt::skip]
const TEXTS: [(u8, &str, bool); 36] = [
    (5, "IPTC:ObjectName", false),
    (7, "IPTC:EditStatus", false),
    (10, "IPTC:Urgency", false),
    (12, "IPTC:SubjectReference", true),
    (15, "IPTC:Category", false),
    (20, "IPTC:SupplementalCategories", true),
    (22, "IPTC:FixtureIdentifier", false),
    (25, "IPTC:Keywords", true),
    (26, "IPTC:ContentLocationCode", true),
    (27, "IPTC:ContentLocationName", true),
    (30, "IPTC:ReleaseDate", false),
    (35, "IPTC:ReleaseTime", false),
    (37, "IPTC:ExpirationDate", false),
    (38, "IPTC:ExpirationTime", false),
    (40, "IPTC:Instructions", false),
    (55, "IPTC:DateCreated", false),
    (60, "IPTC:TimeCreated", false),
    (62, "IPTC:DigitalCreationDate", false),
    (63, "IPTC:DigitalCreationTime", false),
    (65, "IPTC:OriginatingProgram", false),
    (70, "IPTC:ProgramVersion", false),
    (80, "IPTC:Creator", true),
    (85, "IPTC:AuthorsPosition", true),
    (90, "IPTC:City", false),
    (92, "IPTC:Sublocation", false),
    (95, "IPTC:State", false),
    (100, "IPTC:CountryCode", false),
    (101, "IPTC:Country", false),
    (103, "IPTC:TransmissionReference", false),
    (105, "IPTC:Headline", false),
    (110, "IPTC:Provider", false),
    (115, "IPTC:Source", false),
    (116, "IPTC:CopyrightNotice", false),
    (118, "IPTC:Contact", true),
    (120, "IPTC:Caption", false),
    (122, "IPTC:CaptionWriter", true),
];

/// Separates several texts of one number.
const SEPARATOR: &str = "; ";

/// The largest number of texts that are read.
const MOST: usize = 1000;

/// The largest number of bytes of a text with a length of 16 bits.
const LONGEST: usize = 32767;

/// The number of the resource of Photoshop that holds IPTC.
const RESOURCE: u16 = 0x0404;

/// Adds the attributes of IPTC data. What follows damage is left out.
pub fn read(bytes: &[u8], attributes: &mut Params) {
    let mut rest = bytes;
    let mut found: Vec<(&'static str, String)> = Vec::new();
    for _ in 0..MOST {
        let [0x1c, record, number, high, low, ..] = *rest else { break };
        // A length with the highest bit set is the number of bytes of a longer one, which no text needs.
        let len = usize::from(u16::from_be_bytes([high, low]));
        let Some(content) = rest.get(5..5 + len).filter(|_| high < 0x80) else { break };
        rest = &rest[5 + len..];
        let known = TEXTS.iter().find(|(n, ..)| record == 2 && *n == number).copied();
        let (Some((_, name, several)), Some(text)) = (known, text(content)) else { continue };
        match found.iter_mut().find(|(other, _)| *other == name) {
            Some((_, all)) if several => all.extend([SEPARATOR, &text]),
            Some(_) => {}
            None => found.push((name, text)),
        }
    }
    for (name, text) in found {
        attributes.set(param(name, text.as_str().into()));
    }
}

/// Returns IPTC data of the attributes in UTF-8; `None` when there are none.
pub fn write(attributes: &Params) -> Option<Vec<u8>> {
    let mut texts: Vec<(u8, String)> = Vec::new();
    for (number, name, several) in TEXTS {
        let Some(ParamData::String(values)) = value(attributes, name) else { continue };
        for value in values.iter() {
            let parts: Vec<&str> =
                if several { value.split(SEPARATOR.trim_end()).collect() } else { vec![value] };
            let parts = parts.into_iter().map(str::trim).filter(|part| !part.is_empty());
            texts.extend(parts.map(|part| (number, shortened(part).to_owned())));
        }
    }
    if texts.is_empty() {
        return None;
    }
    let dataset = |record: u8, number: u8, content: &[u8]| {
        let len = (content.len() as u16).to_be_bytes();
        [&[0x1c, record, number, len[0], len[1]][..], content].concat()
    };
    // The first record says that texts are UTF-8, and the second begins with its version.
    let mut bytes = [dataset(1, 90, b"\x1b%G"), dataset(2, 0, &[0, 4])].concat();
    for (number, text) in texts {
        bytes.extend(dataset(2, number, text.as_bytes()));
    }
    Some(bytes)
}

/// Returns the longest beginning of a text that fits.
fn shortened(text: &str) -> &str {
    let end = (0..=LONGEST.min(text.len())).rev().find(|i| text.is_char_boundary(*i)).unwrap_or(0);
    &text[..end]
}

/// Returns the IPTC data in a list of Photoshop's resources, as JPEG files have it.
pub fn of_resources(bytes: &[u8]) -> Option<&[u8]> {
    let mut rest = bytes.strip_prefix(b"Photoshop 3.0\0").unwrap_or(bytes);
    for _ in 0..MOST {
        let [b'8', b'B', b'I', b'M', a, b, name, ..] = *rest else { return None };
        // The name and its length have an even number of bytes together, and so has the content.
        let at = 6 + (usize::from(name) + 1).next_multiple_of(2);
        let len = rest.get(at..at + 4)?;
        let len = u32::from_be_bytes([len[0], len[1], len[2], len[3]]) as usize;
        let content = rest.get(at + 4..(at + 4).checked_add(len)?)?;
        if u16::from_be_bytes([a, b]) == RESOURCE {
            return Some(content);
        }
        rest = rest.get(at + 4 + len.checked_next_multiple_of(2)?..)?;
    }
    None
}

/// Returns a list of Photoshop's resources with IPTC data alone, as JPEG files have it.
pub fn as_resources(data: &[u8]) -> Vec<u8> {
    let mut bytes = b"Photoshop 3.0\08BIM".to_vec();
    bytes.extend(RESOURCE.to_be_bytes());
    bytes.extend([0, 0]);
    bytes.extend((data.len() as u32).to_be_bytes());
    bytes.extend(data);
    bytes.resize(bytes.len() + data.len() % 2, 0);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn given() -> Params {
        let mut params = Params::new();
        for (name, text) in [
            ("IPTC:Keywords", "one; two; \u{3b1}"),
            ("IPTC:City", "K\u{f6}ln"),
            ("IPTC:Caption", "a; b is one text"),
            ("IPTC:Creator", "me"),
        ] {
            params.set(param(name, text.into()));
        }
        params
    }

    #[test]
    fn attributes_survive_write_and_read() {
        let bytes = write(&given()).unwrap();
        let mut got = Params::new();
        read(&bytes, &mut got);
        for param in &given() {
            assert_eq!(got.get(&param.name), Some(param));
        }
        assert_eq!(bytes.windows(5).filter(|w| w[..3] == [0x1c, 2, 25]).count(), 3);
        assert_eq!(write(&Params::new()), None);
    }

    #[test]
    fn resources_hold_the_data() {
        for data in [&b"abc"[..], b"abcd"] {
            let bytes = as_resources(data);
            assert_eq!(of_resources(&bytes), Some(data));
            // Another resource precedes it.
            let other = [&b"8BIM\x04\x25\x01a\0\0\0\x03xyz\0"[..], &bytes[14..]].concat();
            assert_eq!(of_resources(&other), Some(data));
            assert_eq!(of_resources(&bytes[..bytes.len() - 4]), None);
        }
        assert_eq!(of_resources(b""), None);
    }

    #[test]
    fn texts_of_old_programs_are_latin_and_damage_ends_the_data() {
        let mut got = Params::new();
        read(b"\x1c\x02\x5a\0\x04K\xf6ln\x1c\x02\x69\0\x09Head", &mut got);
        assert_eq!(got.string("IPTC:City").map(|s| &**s), Some("K\u{f6}ln"));
        assert_eq!(got.0.len(), 1);
        read(b"\x1c\x02\x5a\xff\xff", &mut got);
        assert_eq!(got.0.len(), 1);
    }

    #[test]
    fn long_texts_are_shortened_at_a_character() {
        let mut params = Params::new();
        params.set(param("IPTC:Caption", "\u{20ac}".repeat(20_000).as_str().into()));
        let mut got = Params::new();
        read(&write(&params).unwrap(), &mut got);
        assert_eq!(got.string("IPTC:Caption").unwrap().len(), 32766);
    }

    proptest! {
        #[test]
        fn damaged_data_does_not_panic(
            bytes in prop::collection::vec(any::<u8>(), 0..300),
            cut in 0usize..300,
            at in 0usize..300,
            byte: u8,
        ) {
            read(&bytes, &mut Params::new());
            let _ = of_resources(&bytes);
            let mut changed = as_resources(&write(&given()).unwrap());
            let n = changed.len();
            changed[at % n] = byte;
            changed.truncate(cut);
            if let Some(data) = of_resources(&changed) {
                read(data, &mut Params::new());
            }
        }
    }
}
