//! The structure of a TIFF file: header, chain of directories, entries and their values.

use granita_image::metadata::exif;
use granita_image::{FileSource, Limits, Result};

/// The byte order and the width of offsets of a file, from its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Layout {
    /// True for "MM", and false for "II".
    pub(crate) big_endian: bool,
    /// True for 64-bit offsets.
    pub(crate) big_tiff: bool,
}

impl Layout {
    /// Checks whether these first bytes are those of a TIFF file, and returns its layout.
    pub(crate) fn of(head: &[u8]) -> Option<Self> {
        match head {
            [b'I', b'I', 42, 0, ..] => Some(Self { big_endian: false, big_tiff: false }),
            [b'M', b'M', 0, 42, ..] => Some(Self { big_endian: true, big_tiff: false }),
            [b'I', b'I', 43, 0, ..] => Some(Self { big_endian: false, big_tiff: true }),
            [b'M', b'M', 0, 43, ..] => Some(Self { big_endian: true, big_tiff: true }),
            _ => None,
        }
    }

    /// Returns an unsigned number of `bytes.len()` (at most 8) bytes.
    pub(crate) fn number(self, bytes: &[u8]) -> u64 {
        let fold = |n: u64, b: &u8| n << 8 | u64::from(*b);
        if self.big_endian { bytes.iter().fold(0, fold) } else { bytes.iter().rev().fold(0, fold) }
    }

    /// Returns the bytes of a number of 16 bits.
    pub(crate) fn short(self, n: u16) -> [u8; 2] {
        if self.big_endian { n.to_be_bytes() } else { n.to_le_bytes() }
    }

    /// Returns the bytes of a number of 32 bits.
    pub(crate) fn long(self, n: u32) -> [u8; 4] {
        if self.big_endian { n.to_be_bytes() } else { n.to_le_bytes() }
    }
}

/// One entry of a directory. Its values are read only when they are needed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Entry {
    pub(crate) tag: u16,
    kind: u16,
    /// The number of values.
    pub(crate) count: u64,
    /// The value field, which holds the values themselves if they fit, and otherwise their offset.
    field: [u8; 8],
}

impl Entry {
    /// Returns the number of bytes of one value. It is 0 for unknown kinds.
    fn size(&self) -> u64 {
        match self.kind {
            1 | 2 | 6 | 7 => 1,
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16 | 17 | 18 => 8,
            _ => 0,
        }
    }
}

/// One directory of a file (an "image file directory").
#[derive(Debug)]
pub(crate) struct Directory {
    layout: Layout,
    entries: Vec<Entry>,
}

/// Reads the chain of directories. It follows at most `limits.images` of them, and no loops.
pub(crate) fn read_directories(source: &FileSource, limits: &Limits) -> Result<(Layout, Vec<Directory>)> {
    let head = source.read_vec(0, source.len().min(16), "the header")?;
    let layout = Layout::of(&head).ok_or_else(|| source.malformed("it does not begin like one"))?;
    let mut next = if layout.big_tiff {
        if head.len() < 16 || layout.number(&head[4..6]) != 8 {
            return Err(source.malformed("the header of a file with 64-bit offsets is damaged"));
        }
        layout.number(&head[8..16])
    } else if head.len() >= 8 {
        layout.number(&head[4..8])
    } else {
        return Err(source.malformed("the file ends inside its header"));
    };
    let mut seen = Vec::new();
    let mut directories = Vec::new();
    while next != 0 {
        if seen.contains(&next) {
            return Err(source.malformed(format!("the chain of directories loops back to byte {next}")));
        }
        seen.push(next);
        limits.within(source.path(), "number of images", seen.len() as u64, u64::from(limits.images))?;
        let (directory, following) = Directory::read(source, layout, next)?;
        directories.push(directory);
        next = following;
    }
    if directories.is_empty() {
        return Err(source.malformed("there is no image in it"));
    }
    Ok((layout, directories))
}

impl Directory {
    /// Returns the directory at `offset`, and the offset of the next one.
    fn read(source: &FileSource, layout: Layout, offset: u64) -> Result<(Self, u64)> {
        let (count_bytes, entry_bytes, field_bytes) = if layout.big_tiff { (8, 20, 8) } else { (2, 12, 4) };
        let count = layout.number(&source.read_vec(offset, count_bytes, "a directory")?);
        if count > 65535 {
            return Err(source.malformed(format!("the directory at byte {offset} has {count} entries")));
        }
        let bytes =
            source.read_vec(offset + count_bytes, count * entry_bytes + field_bytes, "a directory")?;
        let (list, next) = bytes.split_at((count * entry_bytes) as usize);
        let mut entries = Vec::with_capacity(count as usize);
        for e in list.chunks_exact(entry_bytes as usize) {
            let (count, field) = e[4..].split_at(field_bytes as usize);
            let mut entry = Entry {
                tag: layout.number(&e[..2]) as u16,
                kind: layout.number(&e[2..4]) as u16,
                count: layout.number(count),
                field: [0; 8],
            };
            entry.field[..field.len()].copy_from_slice(field);
            entries.push(entry);
        }
        Ok((Self { layout, entries }, layout.number(next)))
    }

    /// Returns the entry of a tag.
    pub(crate) fn entry(&self, tag: u16) -> Option<&Entry> {
        self.entries.iter().find(|e| e.tag == tag)
    }

    /// Returns the first number of a tag, or `default` when the tag is absent.
    pub(crate) fn number(&self, source: &FileSource, tag: u16, default: u64) -> Result<u64> {
        match self.entry(tag) {
            Some(entry) => Ok(self.layout.numbers(source, entry, 1)?.first().copied().unwrap_or(default)),
            None => Ok(default),
        }
    }

    /// Returns the first `max` numbers of a tag. There are none when it is absent.
    pub(crate) fn numbers(&self, source: &FileSource, tag: u16, max: u64) -> Result<Vec<u64>> {
        self.entry(tag).map_or(Ok(Vec::new()), |e| self.layout.numbers(source, e, max))
    }

    /// Returns the text of a tag, up to its first NUL; `None` when it is absent or not a text.
    pub(crate) fn text(&self, source: &FileSource, tag: u16) -> Result<Option<String>> {
        /// The largest number of bytes of a text. A longer text is cut, because it is probably damaged.
        const LONGEST: u64 = 1 << 20;
        let Some(entry) = self.entry(tag).filter(|e| matches!(e.kind, 1 | 2 | 7)) else { return Ok(None) };
        let bytes = self.layout.values(source, entry, LONGEST)?;
        let text = bytes.split(|b| *b == 0).next().unwrap_or_default();
        Ok(Some(String::from_utf8_lossy(text).into_owned()))
    }

    /// Returns the bytes of a tag; `None` when it is absent or has more than `max`.
    pub(crate) fn bytes(&self, source: &FileSource, tag: u16, max: u64) -> Result<Option<Vec<u8>>> {
        // Some programs declare bytes as numbers of 32 bits.
        let entry = self.entry(tag).filter(|e| matches!(e.kind, 1 | 4 | 7) && e.count <= max);
        entry.map(|e| self.layout.values(source, e, max)).transpose()
    }

    /// Returns the description that a reader of metadata needs.
    pub(crate) fn metadata_source<'a>(
        &self,
        fetch: &'a dyn Fn(u64, u64) -> Option<Vec<u8>>,
    ) -> exif::Source<'a> {
        exif::Source { fetch, big_endian: self.layout.big_endian, big_tiff: self.layout.big_tiff }
    }

    /// Returns the first `max` values of a tag as floats, from floats, doubles, fractions or integers.
    pub(crate) fn floats(&self, source: &FileSource, tag: u16, max: u64) -> Result<Vec<f32>> {
        let Some(entry) = self.entry(tag) else { return Ok(Vec::new()) };
        let layout = self.layout;
        let bits = |b: &[u8]| layout.number(b);
        let bytes = layout.values(source, entry, max)?;
        Ok(match entry.kind {
            11 => bytes.chunks_exact(4).map(|b| f32::from_bits(bits(b) as u32)).collect(),
            12 => bytes.chunks_exact(8).map(|b| f64::from_bits(bits(b)) as f32).collect(),
            5 => bytes.chunks_exact(8).map(|b| bits(&b[..4]) as f32 / bits(&b[4..]) as f32).collect(),
            10 => bytes
                .chunks_exact(8)
                .map(|b| bits(&b[..4]) as u32 as i32 as f32 / bits(&b[4..]) as u32 as i32 as f32)
                .collect(),
            _ => layout.numbers(source, entry, max)?.into_iter().map(|n| n as f32).collect(),
        })
    }
}

impl Layout {
    /// Returns the first `max` values of an entry, as unsigned numbers. Other kinds of values are an error.
    pub(crate) fn numbers(self, source: &FileSource, entry: &Entry, max: u64) -> Result<Vec<u64>> {
        if !matches!(entry.kind, 1 | 3 | 4 | 7 | 13 | 16 | 18) {
            return Err(
                source.malformed(format!("tag {} has values of kind {}, not numbers", entry.tag, entry.kind))
            );
        }
        let bytes = self.values(source, entry, max)?;
        Ok(bytes.chunks_exact(entry.size() as usize).map(|b| self.number(b)).collect())
    }

    /// Returns the bytes of the first `max` values of an entry.
    fn values(self, source: &FileSource, entry: &Entry, max: u64) -> Result<Vec<u8>> {
        let broken = || source.malformed(format!("tag {} has {} values", entry.tag, entry.count));
        let all = entry.count.checked_mul(entry.size()).ok_or_else(broken)?;
        let len = entry.count.min(max) * entry.size();
        let field = if self.big_tiff { &entry.field[..] } else { &entry.field[..4] };
        if all <= field.len() as u64 {
            return Ok(field[..len as usize].to_vec());
        }
        source.read_vec(self.number(field), len, &format!("the value of tag {}", entry.tag))
    }
}
