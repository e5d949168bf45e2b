//! Database files (extension `.sdb`).
//!
//! All numbers are little endian. The header has 128 bytes:
//!
//! | byte | type | what |
//! |---|---|---|
//! | 0 | 8 bytes | `89 G S D B 0d 0a 1a` |
//! | 8 | u32 | version: 1 |
//! | 12 | u32 | keys: 0 (s, t), 1 points, 2 points and normals |
//! | 16 | u32 | values: 0 float, 1 color, 2 point, 3 vector, 4 normal |
//! | 20 | u32 | records under one box: 16 |
//! | 24 | u64 | number of records |
//! | 32 | u64 | bytes after the header |
//! | 40 | u32 | CRC-32 of these bytes |
//! | 44 | 80 bytes | 0 |
//! | 124 | u32 | CRC-32 of bytes 0 to 123 |
//!
//! Then all numbers follow as 32-bit floats: the records (numbers of the key, then of the value) in the order of a
//! Morton curve, the boxes around the keys of each 16 of them (lowest corner, highest corner), the boxes around each
//! 16 boxes, and so on to one box. Files are mapped into memory and searched there.

use crate::error::{Result, SdbError};
use crate::order::{Extent, by_bits, place, sort};
use crate::packed::{Boxes, FAN, layout};
use crate::{Key, Packed, Schema, Value};
use granita_base::{AtomicFile, Files};
use granita_machine::memory::Map;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const MAGIC: [u8; 8] = [0x89, b'G', b'S', b'D', b'B', 0x0d, 0x0a, 0x1a];
const HEADER: usize = 128;
const KEYS: [Key; 3] = [Key::Surface, Key::Point, Key::Oriented];

fn header(schema: Schema, count: u64, bytes: u64, sum: u32) -> [u8; HEADER] {
    let mut out = [0; HEADER];
    out[..8].copy_from_slice(&MAGIC);
    let key = KEYS.iter().take_while(|k| **k != schema.key).count() as u32;
    let value = Value::ALL.iter().take_while(|v| **v != schema.value).count() as u32;
    for (i, word) in [1, key, value, FAN as u32].into_iter().enumerate() {
        out[8 + 4 * i..][..4].copy_from_slice(&word.to_le_bytes());
    }
    out[24..32].copy_from_slice(&count.to_le_bytes());
    out[32..40].copy_from_slice(&bytes.to_le_bytes());
    out[40..44].copy_from_slice(&sum.to_le_bytes());
    let own = crc32fast::hash(&out[..124]);
    out[124..].copy_from_slice(&own.to_le_bytes());
    out
}

/// Reads a database. The checksums of the records are checked, but the records are not copied.
///
/// # Errors
/// [`SdbError::Io`]; [`SdbError::Malformed`] for a file that is not a database, has a wrong length, or was altered;
/// [`SdbError::Unsupported`] for later versions.
pub fn read(path: &Path) -> Result<Packed> {
    read_with(path, &Files::default())
}

/// Does the same as [`read`] for a file that `files` opens.
pub(crate) fn read_with(path: &Path, files: &Files) -> Result<Packed> {
    let io = |source| SdbError::Io { path: path.to_owned(), source };
    let bad = |what: String| SdbError::Malformed { path: path.to_owned(), what };
    let file = files.open(path).map_err(io)?;
    let length = file.metadata().map_err(io)?;
    if !length.is_file() {
        return Err(bad("it is not a file".to_owned()));
    }
    if length.len() < HEADER as u64 {
        return Err(bad(format!(
            "it is not a spatial database: {} bytes are fewer than a header has",
            length.len()
        )));
    }
    let map = Map::open(&file).map_err(io)?;
    let head = &map.bytes()[..HEADER];
    if head[..8] != MAGIC {
        return Err(bad("it is not a spatial database: it begins with other bytes".to_owned()));
    }
    let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
    if word(8) != 1 {
        return Err(SdbError::Unsupported { path: path.to_owned(), version: word(8) });
    }
    if word(124) != crc32fast::hash(&head[..124]) {
        return Err(bad("the header was altered: its checksum does not match".to_owned()));
    }
    let (Some(&key), Some(&value)) = (KEYS.get(word(12) as usize), Value::ALL.get(word(16) as usize)) else {
        return Err(bad(format!("records of unknown kinds {} and {}", word(12), word(16))));
    };
    let schema = Schema { key, value };
    let laid = usize::try_from(long(24)).ok().and_then(|count| layout(schema, count));
    let Some((levels, numbers)) = laid.filter(|_| word(20) == FAN as u32) else {
        return Err(bad(format!("{} records with {} under each box are not valid", long(24), word(20))));
    };
    let due = numbers as u64 * 4;
    let there = map.bytes().len() as u64 - HEADER as u64;
    if due != long(32) || there != due {
        return Err(bad(format!("{there} bytes of records where {due} are needed")));
    }
    if crc32fast::hash(&map.bytes()[HEADER..]) != word(40) {
        return Err(bad("the records were altered: their checksum does not match".to_owned()));
    }
    let count = long(24) as usize;
    if cfg!(target_endian = "big") {
        let floats: Vec<f32> = map.bytes()[HEADER..]
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
            .collect();
        return Ok(Packed::new(schema, &floats[..count * schema.numbers()]));
    }
    let map = map.at(HEADER).ok_or_else(|| bad("its numbers are not aligned".to_owned()))?;
    Ok(Packed::mapped(schema, count, levels, map))
}

/// Returns the bytes of a file with correct checksums; `None` for a file that is shorter than a header. It is for
/// tests, which could not pass the checksums otherwise.
pub fn with_checksums(bytes: &[u8]) -> Option<Vec<u8>> {
    let mut out = bytes.to_vec();
    if out.len() < HEADER {
        return None;
    }
    let body = crc32fast::hash(&out[HEADER..]);
    out[40..44].copy_from_slice(&body.to_le_bytes());
    let own = crc32fast::hash(&out[..124]);
    out[124..HEADER].copy_from_slice(&own.to_le_bytes());
    Some(out)
}

/// Collects records for a file. Records that do not fit in memory are stored in a file without a name.
#[derive(Debug)]
pub(crate) struct Spool {
    schema: Schema,
    extent: Extent,
    count: u64,
    memory: Vec<f32>,
    /// The largest number of floats that are kept in memory.
    most: usize,
    /// The path of the database file. The temporary file is in its folder.
    beside: PathBuf,
    files: Files,
    spilled: Option<Spilled>,
}

/// The runs of records in a file.
#[derive(Debug)]
struct Spilled {
    file: File,
    /// The number of floats of each run.
    runs: Vec<usize>,
}

/// Converts numbers to the bytes of a file.
fn to_bytes(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|x| x.to_le_bytes()).collect()
}

fn from_bytes(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

impl Spool {
    /// Returns a spool that keeps at most `most` numbers in memory, but at least a record, and the others in a file
    /// beside `beside`.
    pub(crate) fn new(schema: Schema, most: usize, beside: PathBuf, files: Files) -> Self {
        let most = most.max(schema.numbers());
        Self {
            schema,
            extent: Extent::EMPTY,
            count: 0,
            memory: Vec::new(),
            most,
            beside,
            files,
            spilled: None,
        }
    }

    /// The number of records.
    pub(crate) fn len(&self) -> u64 {
        self.count
    }

    pub(crate) fn schema(&self) -> Schema {
        self.schema
    }

    /// Adds whole, finite records.
    pub(crate) fn push(&mut self, records: &[f32]) -> io::Result<()> {
        let (n, d) = (self.schema.numbers(), self.schema.key.dimensions());
        for record in records.chunks_exact(n) {
            if self.memory.len() + n > self.most {
                self.spill()?;
            }
            self.extent.add(&record[..d]);
            self.memory.extend_from_slice(record);
            self.count += 1;
        }
        Ok(())
    }

    fn spill(&mut self) -> io::Result<()> {
        let spilled = match &mut self.spilled {
            Some(spilled) => spilled,
            none => none.insert(Spilled { file: self.files.scratch(&self.beside)?, runs: Vec::new() }),
        };
        spilled.file.write_all(&to_bytes(&self.memory))?;
        spilled.runs.push(self.memory.len());
        self.memory.clear();
        Ok(())
    }

    /// Returns all records in memory and removes them from the spool.
    pub(crate) fn take(&mut self) -> io::Result<Vec<f32>> {
        let mut all = Vec::new();
        if let Some(mut spilled) = self.spilled.take() {
            spilled.file.seek(SeekFrom::Start(0))?;
            let mut bytes = Vec::new();
            spilled.file.read_to_end(&mut bytes)?;
            all = from_bytes(&bytes);
        }
        all.append(&mut self.memory);
        *self = Self::new(self.schema, self.most, std::mem::take(&mut self.beside), self.files.clone());
        Ok(all)
    }

    /// Writes a database of all records. The bytes do not depend on the order in which the records were added. The
    /// file appears complete, or the previous one stays.
    pub(crate) fn write(mut self, path: &Path, files: &Files) -> Result<()> {
        let io = |source| SdbError::Io { path: path.to_owned(), source };
        let runs = self.sorted_runs().map_err(io)?;
        let mut file = files.create(path)?;
        file.write_all(&[0; HEADER]).map_err(io)?;
        let mut out = Summed { file, sum: crc32fast::Hasher::new(), bytes: 0 };
        let mut boxes = Boxes::new(self.schema);
        merge(self.schema, &self.extent, runs, &mut |record| {
            boxes.add(record);
            out.put(record)
        })
        .map_err(io)?;
        if self.count > 0 {
            out.put(&boxes.finish()).map_err(io)?;
        }
        let Summed { mut file, sum, bytes } = out;
        file.seek(SeekFrom::Start(0)).map_err(io)?;
        file.write_all(&header(self.schema, self.count, bytes, sum.finalize())).map_err(io)?;
        file.commit().map_err(SdbError::from)
    }

    /// Returns each run in the order of the file. The records in memory are one run.
    fn sorted_runs(&mut self) -> io::Result<Vec<Run>> {
        let (own, _) = sort(self.schema, &self.extent, &std::mem::take(&mut self.memory));
        let mut runs = vec![Run::Memory(own, 0)];
        if let Some(mut spilled) = self.spilled.take() {
            let mut from = 0_u64;
            for &numbers in &spilled.runs {
                let mut bytes = vec![0; numbers * 4];
                spilled.file.seek(SeekFrom::Start(from))?;
                spilled.file.read_exact(&mut bytes)?;
                let (sorted, _) = sort(self.schema, &self.extent, &from_bytes(&bytes));
                spilled.file.seek(SeekFrom::Start(from))?;
                spilled.file.write_all(&to_bytes(&sorted))?;
                from += bytes.len() as u64;
            }
            let mut from = 0_u64;
            for &numbers in &spilled.runs {
                let part = Part { file: spilled.file.try_clone()?, at: from, left: numbers as u64 * 4 };
                runs.push(Run::File(BufReader::with_capacity(1 << 16, part)));
                from += numbers as u64 * 4;
            }
        }
        Ok(runs)
    }
}

/// A part of a file. Several parts are read alternately.
#[derive(Debug)]
struct Part {
    file: File,
    at: u64,
    left: u64,
}

impl Read for Part {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // The position in the file is shared with the other parts.
        self.file.seek(SeekFrom::Start(self.at))?;
        let most = usize::try_from(self.left).unwrap_or(usize::MAX).min(buffer.len());
        let n = self.file.read(&mut buffer[..most])?;
        self.at += n as u64;
        self.left -= n as u64;
        Ok(n)
    }
}

/// A run of sorted records.
enum Run {
    Memory(Vec<f32>, usize),
    File(BufReader<Part>),
}

impl Run {
    /// Returns the next record; `None` at the end.
    fn next(&mut self, numbers: usize) -> io::Result<Option<Vec<f32>>> {
        match self {
            Self::Memory(all, at) => {
                let record = all.get(*at..*at + numbers).map(<[f32]>::to_vec);
                *at += numbers;
                Ok(record)
            }
            Self::File(reader) => {
                let mut bytes = vec![0; numbers * 4];
                match reader.read_exact(&mut bytes) {
                    Ok(()) => Ok(Some(from_bytes(&bytes))),
                    Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => Ok(None),
                    Err(e) => Err(e),
                }
            }
        }
    }
}

/// The first remaining record of a run.
struct Head {
    place: u64,
    record: Vec<f32>,
    run: usize,
}

impl PartialEq for Head {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Head {}

impl PartialOrd for Head {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Head {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.place
            .cmp(&other.place)
            .then_with(|| by_bits(&self.record, &other.record))
            .then(self.run.cmp(&other.run))
    }
}

/// Passes the records of all runs in one order.
fn merge(
    schema: Schema,
    extent: &Extent,
    mut runs: Vec<Run>,
    each: &mut dyn FnMut(&[f32]) -> io::Result<()>,
) -> io::Result<()> {
    let (n, d) = (schema.numbers(), schema.key.dimensions());
    let mut heads = BinaryHeap::new();
    let head = |record: Vec<f32>, run| Reverse(Head { place: place(extent, &record[..d]), record, run });
    for (i, run) in runs.iter_mut().enumerate() {
        heads.extend(run.next(n)?.map(|record| head(record, i)));
    }
    while let Some(Reverse(first)) = heads.pop() {
        each(&first.record)?;
        heads.extend(runs[first.run].next(n)?.map(|record| head(record, first.run)));
    }
    Ok(())
}

/// A file whose checksum is computed while it is written.
struct Summed {
    file: AtomicFile,
    sum: crc32fast::Hasher,
    bytes: u64,
}

impl Summed {
    fn put(&mut self, numbers: &[f32]) -> io::Result<()> {
        let bytes = to_bytes(numbers);
        self.sum.update(&bytes);
        self.bytes += bytes.len() as u64;
        self.file.write_all(&bytes)
    }
}
