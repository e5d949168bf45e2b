//! Deflate for tiles and strips: streams of zlib (RFC 1950, 1951) from predicted bytes.
//!
//! Predicted bytes of a photograph are noise around zero, in which repeated strings are short and rare. A code for
//! single bytes stores them in less space than references to earlier strings, and in a quarter of the time. Other data
//! repeats, and is compressed by libdeflate. An estimate of the repeated strings decides between both, piece
//! by piece: the stream begins with pieces of literals, and libdeflate compresses the rest.
//!
//! The stream is a function of the data and the level alone.

mod code;
mod probe;

use code::{Bits, LiteralCode, histogram};
use libdeflater::{CompressionLvl, Compressor, adler32};

/// The effort of compression, from 1 (fast) to 12 (small files). The decompressed bytes are the same for all levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct DeflateLevel(u8);

impl Default for DeflateLevel {
    /// Returns level 6, that of other programs (`docs/formats.md`).
    fn default() -> Self {
        Self(6)
    }
}

impl DeflateLevel {
    /// The first level that always compresses with libdeflate, too, and keeps the shorter stream.
    const BOTH: u8 = 7;

    /// Returns the level of a number from 1 to 12; `None` for other numbers.
    pub fn new(level: u8) -> Option<Self> {
        (1..=12).contains(&level).then_some(Self(level))
    }

    /// Returns the number, from 1 to 12.
    pub fn get(self) -> u8 {
        self.0
    }

    /// Splits the word of a compression into its name and its level: "zip:9". Levels are of "zip", "zips" and "deflate"
    /// only. The names, and numbers of other compressions, are left to the caller: "dwaa:45" is a name.
    ///
    /// # Errors
    /// Returns a text when such a compression has a level other than a number from 1 to 12.
    pub fn split(word: &str) -> Result<(&str, Option<Self>), String> {
        match word.split_once(':') {
            Some((name @ ("zip" | "zips" | "deflate"), level)) => {
                let level = level.parse().ok().and_then(Self::new).ok_or_else(|| {
                    format!("compression \"{word}\": the level of \"{name}\" is a number from 1 to 12")
                })?;
                Ok((name, Some(level)))
            }
            _ => Ok((word, None)),
        }
    }

    /// Returns the compressor of libdeflate with this level.
    fn compressor(self) -> Compressor {
        Compressor::new(CompressionLvl::new(i32::from(self.0)).unwrap_or_default())
    }
}

/// The largest number of bytes that share a code.
const PIECE: usize = 1 << 14;

/// Bytes that are stored with a code of their own.
struct Piece<'a> {
    bytes: &'a [u8],
    code: LiteralCode,
    /// The number of bytes by which the piece repeats more than what is worth a search for references.
    gain: i64,
}

impl<'a> Piece<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        let counts = histogram(bytes);
        Self { bytes, code: LiteralCode::of(&counts), gain: probe::gain(bytes, &counts[..256]) }
    }
}

/// Splits data into pieces of equal length. Their number is even where there are several, because OpenEXR stores the
/// noisy bytes of halves in the first half of a block, and the smooth ones in the second.
fn pieces(data: &[u8]) -> Vec<Piece<'_>> {
    let count = if data.len() <= PIECE { 1 } else { 2 * data.len().div_ceil(2 * PIECE) };
    data.chunks(data.len().div_ceil(count).max(1)).map(Piece::new).collect()
}

/// What the bytes are that are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// Differences of numbers of 8 bits. The estimate of their repeated strings is reliable.
    Bytes,
    /// Differences of the low bytes of halves, and after them of their high bytes, as in blocks of OpenEXR. Low bytes
    /// are mostly noise.
    Halves,
    /// The bytes of other numbers. They depend on each other in other ways, so that libdeflate compresses them all.
    Words,
}

/// Returns the stream of zlib of `data`.
pub fn zlib_compress(data: &[u8], content: Content, level: DeflateLevel) -> Vec<u8> {
    let pieces = pieces(data);
    // Libdeflate compresses the last pieces, those whose gains have the largest sum.
    let (mut split, mut largest, mut sum) = (pieces.len(), 0, 0);
    for (i, piece) in pieces.iter().enumerate().rev() {
        sum += piece.gain;
        if sum > largest {
            (split, largest) = (i, sum);
        }
    }
    if content == Content::Words || content == Content::Halves && split == pieces.len() {
        split = 0;
    }
    let best = assemble(data, &pieces, split, level);
    if level.0 < DeflateLevel::BOTH || split == 0 {
        return best;
    }
    let whole = assemble(data, &pieces, 0, level);
    if whole.len() < best.len() { whole } else { best }
}

/// Returns the stream whose pieces from `split` on are compressed by libdeflate, unless their literals are shorter.
fn assemble(data: &[u8], pieces: &[Piece<'_>], split: usize, level: DeflateLevel) -> Vec<u8> {
    let (literals, rest) = pieces.split_at(split);
    let begin = literals.iter().map(|p| p.bytes.len()).sum();
    let literal_bytes =
        |pieces: &[Piece<'_>]| pieces.iter().map(|p| p.code.bits() / 8 + 1).sum::<u64>() as usize;
    let packed = if rest.is_empty() { None } else { deflate(&data[begin..], level) };
    let packed = packed.filter(|packed| packed.len() < literal_bytes(rest));
    let literals = if packed.is_some() { literals } else { pieces };
    let room = literal_bytes(literals) + packed.as_ref().map_or(0, Vec::len);
    let mut out = Bits::new(room + 32);
    // The method deflate, a window of 32 KiB, and the check bits of both bytes.
    out.bytes(&[0x78, 0x9c]);
    for (i, piece) in literals.iter().enumerate() {
        piece.code.write(piece.bytes, packed.is_none() && i + 1 == literals.len(), &mut out);
    }
    match packed {
        Some(packed) => {
            if !literals.is_empty() {
                // An empty stored block ends at the beginning of a byte.
                out.stored(&[], false);
            }
            out.bytes(&packed);
        }
        None if literals.is_empty() => out.stored(&[], true),
        None => {}
    }
    out.bytes(&adler32(data).to_be_bytes());
    out.finish()
}

/// Returns the blocks of libdeflate; `None` when they are longer than the data.
fn deflate(data: &[u8], level: DeflateLevel) -> Option<Vec<u8>> {
    let mut out = vec![0; data.len()];
    let len = level.compressor().deflate_compress(data, &mut out).ok()?;
    out.truncate(len);
    Some(out)
}

#[cfg(test)]
mod tests;
