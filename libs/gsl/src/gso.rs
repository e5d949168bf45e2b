//! `.gso` files, each with one complete compiled shader.
//!
//! All numbers are little-endian. A file begins with 8 bytes of magic (as in PNG, which detects a transfer as text),
//! version, flags, length of the header, length of the body (32 bits each), and a 64-bit checksum of all that follows
//! the magic except itself. Then follow the header (kind, name, metadata, parameters with defaults) and the body
//! (symbols, code). The header is always plain. With flag 1 the body is combined with a key stream, which only prevents
//! casual reading (reference 8.2.1, `-x`).
//!
//! The same module always has the same bytes. Reading returns a [`ValidModule`], in which every symbol exists and the
//! operands of every operation have permitted types.

use crate::codec::{Decoder, Encoder, FuncTable};
use crate::error::GslError;
use crate::ir::Module;
use crate::valid::ValidModule;
use granita_base::hash;

const MAGIC: [u8; 8] = [0x89, b'G', b'S', b'O', b'\r', b'\n', 0x1a, b'\n'];
const VERSION: u32 = 1;
const FLAG_OBFUSCATED: u32 = 1;
/// The length in bytes of magic, version, flags, two lengths and checksum.
const FRONT: usize = 8 + 4 * 4 + 8;

/// Returns a module as the bytes of a `.gso` file. With `encrypt` its code is not readable in the file.
pub fn write(module: &Module, encrypt: bool) -> Vec<u8> {
    let mut header = Encoder::default();
    header.header(module);
    let mut body = Encoder::default();
    body.body(module);
    let (header, mut body) = (header.bytes, body.bytes);
    if encrypt {
        mix(&mut body, &header);
    }
    let flags = if encrypt { FLAG_OBFUSCATED } else { 0 };
    let mut out = Vec::with_capacity(FRONT + header.len() + body.len());
    out.extend_from_slice(&MAGIC);
    for number in [VERSION, flags, header.len() as u32, body.len() as u32] {
        out.extend_from_slice(&number.to_le_bytes());
    }
    let sum = checksum(&out[8..], &header, &body);
    out.extend_from_slice(&sum.to_le_bytes());
    out.extend_from_slice(&header);
    out.extend_from_slice(&body);
    out
}

/// Reads the bytes of a `.gso` file. `file` names it in messages.
///
/// # Errors
/// Returns an error when it is not a `.gso` file, has another version, or is truncated or altered.
pub fn read(bytes: &[u8], file: &str) -> Result<ValidModule, GslError> {
    let malformed = |what: String| GslError::Malformed { what, at: file.to_owned() };
    let parts = open(bytes, file)?;
    let mut body = parts.body.to_vec();
    if parts.flags & FLAG_OBFUSCATED != 0 {
        mix(&mut body, parts.header);
    }
    let mut module = read_header(&parts).map_err(malformed)?;
    let mut decoder = Decoder::new(&body);
    let functions = FuncTable::read(&mut decoder).map_err(malformed)?;
    decoder.body(&mut module, &functions).map_err(malformed)?;
    decoder.end().map_err(malformed)?;
    ValidModule::check(module, file)
}

/// Reads only the header, for parameter queries. The module has no code, and its only symbols are the parameters.
pub(crate) fn read_interface(bytes: &[u8], file: &str) -> Result<Module, GslError> {
    let parts = open(bytes, file)?;
    read_header(&parts).map_err(|what| GslError::Malformed { what, at: file.to_owned() })
}

struct Parts<'a> {
    flags: u32,
    header: &'a [u8],
    body: &'a [u8],
}

fn read_header(parts: &Parts<'_>) -> Result<Module, String> {
    let mut decoder = Decoder::new(parts.header);
    let module = decoder.header()?;
    decoder.end()?;
    Ok(module)
}

/// Checks the front and cuts the file into its parts.
fn open<'a>(bytes: &'a [u8], file: &str) -> Result<Parts<'a>, GslError> {
    let at = || file.to_owned();
    let malformed = |what: &str| GslError::Malformed { what: what.to_owned(), at: at() };
    if bytes.get(..8) != Some(&MAGIC) {
        let source = bytes.iter().take(200).all(|b| b.is_ascii_graphic() || b.is_ascii_whitespace());
        return Err(malformed(if source && !bytes.is_empty() {
            "it is not a compiled shader; it may be source text"
        } else {
            "it is not a compiled shader"
        }));
    }
    let number = |i: usize| {
        let at = 8 + 4 * i;
        bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes)
    };
    let (Some(version), Some(flags), Some(header), Some(body)) = (number(0), number(1), number(2), number(3))
    else {
        return Err(malformed("the file ends too early"));
    };
    if version != VERSION {
        let what = format!(
            "version {version} of compiled shaders is not supported, only {VERSION}; compile it again"
        );
        return Err(GslError::Unsupported { what, at: at() });
    }
    let (header, body) = (header as usize, body as usize);
    let length = FRONT.saturating_add(header).saturating_add(body);
    if bytes.len() < length {
        let what = format!("the file ends too early: {} bytes of {length}", bytes.len());
        return Err(GslError::Malformed { what, at: at() });
    }
    if bytes.len() > length {
        let what = format!("the file is too long: {} bytes instead of {length}", bytes.len());
        return Err(GslError::Malformed { what, at: at() });
    }
    let stored = bytes[24..FRONT].try_into().map(u64::from_le_bytes).unwrap_or_default();
    let (header, body) = bytes[FRONT..].split_at(header);
    if checksum(&bytes[8..24], header, body) != stored {
        return Err(malformed("the file was altered: its checksum does not match"));
    }
    if flags & !FLAG_OBFUSCATED != 0 {
        return Err(GslError::Unsupported { what: format!("unknown flags {flags:#x}"), at: at() });
    }
    Ok(Parts { flags, header, body })
}

fn checksum(front: &[u8], header: &[u8], body: &[u8]) -> u64 {
    let mut all = Vec::with_capacity(24);
    for part in [front, header, body] {
        all.extend_from_slice(&hash::bytes64(part).to_le_bytes());
    }
    hash::bytes64(&all)
}

/// Mixes bytes with a key stream made from the header. Applying it twice restores the bytes.
fn mix(bytes: &mut [u8], header: &[u8]) {
    let seed = hash::bytes64(header);
    let (low, high) = (seed as u32, (seed >> 32) as u32);
    for (i, chunk) in bytes.chunks_mut(4).enumerate() {
        let key = hash::words(&[low, high, i as u32, 0x6772_616e]).to_le_bytes();
        for (byte, k) in chunk.iter_mut().zip(key) {
            *byte ^= k;
        }
    }
}
