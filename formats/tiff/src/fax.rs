//! CCITT run lengths and group 3 (ITU-T T.4, TIFF 6.0 sections 10 and 11), with the tables of codes of the crate `fax`.
//! Group 4 is decoded in [`crate::strip_file`].

use fax::maps::{Mode, black, mode, white};
use fax::{BitReader, slice_reader};

/// The arrangement of rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rows {
    /// Rows begin at whole bytes.
    Aligned,
    /// Rows begin with a mark.
    Marked {
        /// True when a bit behind the mark says whether the row is coded by its differences to the row above.
        two_dimensional: bool,
    },
}

/// Decodes rows of `width` bits into `out`, where 1 is black. `Err` describes the error in the data.
pub(crate) fn decode(data: &[u8], out: &mut [u8], width: usize, rows: Rows) -> Result<(), String> {
    /// Codes are looked up in up to 13 bits, also at the end of the data.
    const PADDING: [u8; 4] = [0; 4];
    let data = [data, &PADDING].concat();
    let mut bits = slice_reader(&data);
    // The positions where the colour of the row above changes, from white on.
    let mut above: Vec<usize> = Vec::new();
    for (y, row) in out.chunks_exact_mut(width.div_ceil(8).max(1)).enumerate() {
        let marked = rows != Rows::Aligned && skip_mark(&mut bits);
        let differences = match rows {
            Rows::Marked { two_dimensional: true } if marked => {
                let tag = bits.peek(1);
                let _ = bits.consume(1);
                tag == Some(0)
            }
            _ => false,
        };
        let changes =
            if differences { differences_of(&mut bits, &above, width) } else { runs_of(&mut bits, width) };
        above = changes.ok_or_else(|| format!("row {y} is not {width} pixels of runs"))?;
        paint(&above, row, width);
        if rows == Rows::Aligned {
            let rest = bits.bits_to_byte_boundary();
            let _ = bits.consume(rest);
        }
    }
    Ok(())
}

/// Skips the mark at the beginning of a row (at least eleven zeros, and a one). False when there is none.
fn skip_mark(bits: &mut impl BitReader) -> bool {
    if bits.peek(11) != Some(0) {
        return false;
    }
    loop {
        match bits.peek(1) {
            Some(0) if bits.consume(1).is_ok() => {}
            Some(1) => return bits.consume(1).is_ok(),
            _ => return false,
        }
    }
}

/// Returns the length of a run, which is the sum of codes up to the first one below 64.
fn run(bits: &mut impl BitReader, is_black: bool) -> Option<usize> {
    let mut sum = 0;
    loop {
        let code = usize::from(if is_black { black::decode(bits)? } else { white::decode(bits)? });
        sum += code;
        if code < 64 {
            return Some(sum);
        }
    }
}

/// Returns the changes of a row of runs. `None` when these do not fit the row.
fn runs_of(bits: &mut impl BitReader, width: usize) -> Option<Vec<usize>> {
    let (mut changes, mut at, mut is_black) = (Vec::new(), 0, false);
    while at < width {
        at += run(bits, is_black)?;
        changes.push(at);
        is_black = !is_black;
    }
    (at == width).then_some(changes)
}

/// Returns the changes of a row that is coded by its differences to the row above (T.4, 4.2).
fn differences_of(bits: &mut impl BitReader, above: &[usize], width: usize) -> Option<Vec<usize>> {
    let mut changes: Vec<usize> = Vec::new();
    // `None` is the place before the first pixel.
    let mut at: Option<usize> = None;
    while at.is_none_or(|at| at < width) {
        let is_black = changes.len() % 2 == 1;
        // The first change above, right of here, to the other colour, and the one after it.
        let right = |i: usize| at.is_none_or(|at| above[i] > at) && (i % 2 == 1) == is_black;
        let next = (0..above.len()).find(|i| right(*i)).unwrap_or(above.len());
        let change = |i: usize| above.get(i).copied().unwrap_or(width);
        match mode::decode(bits)? {
            Mode::Pass => at = Some(change(next + 1)),
            Mode::Horizontal => {
                let first = at.unwrap_or(0) + run(bits, is_black)?;
                let second = first + run(bits, !is_black)?;
                changes.extend([first, second]);
                at = Some(second);
            }
            Mode::Vertical(offset) => {
                let place = change(next).checked_add_signed(isize::from(offset))?;
                changes.push(place);
                // Changes do not run backward.
                at = Some(place).filter(|place| at.is_none_or(|at| *place >= at));
                at?;
            }
            Mode::Extension | Mode::EOF => return None,
        }
    }
    changes.iter().all(|place| *place <= width).then_some(changes)
}

/// Sets the bits of black pixels in a row of zeros.
fn paint(changes: &[usize], row: &mut [u8], width: usize) {
    for black in
        changes.chunks(2).filter_map(|pair| Some(*pair.first()?..pair.get(1).copied().unwrap_or(width)))
    {
        for x in black.start.min(width)..black.end.min(width) {
            row[x / 8] |= 0x80 >> (x % 8);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Returns the bytes of bits that are written as text.
    fn bytes(text: &str) -> Vec<u8> {
        let bits: Vec<u8> = text.bytes().filter(|b| *b != b' ').map(|b| b - b'0').collect();
        bits.chunks(8).map(|byte| byte.iter().enumerate().fold(0, |n, (i, bit)| n | bit << (7 - i))).collect()
    }

    #[test]
    fn codes_of_the_standard_are_decoded() {
        // White 2 (0111), black 3 (10), white 3 (1000), twice, each row in whole bytes.
        let row = "0111 10 1000 000000";
        let mut out = [0; 2];
        decode(&bytes(&[row, row].concat()), &mut out, 8, Rows::Aligned).unwrap();
        assert_eq!(out, [0b0011_1000; 2]);
        // The same with marks. The second row repeats the changes of the first, one of them a pixel later.
        let mark = "000000000001";
        let data = [mark, "1 0111 10 1000", mark, "0 1 011 1"].concat();
        let mut out = [0; 2];
        decode(&bytes(&data), &mut out, 8, Rows::Marked { two_dimensional: true }).unwrap();
        assert_eq!(out, [0b0011_1000, 0b0011_1100]);
        // A black pixel at the very left begins with a white run of 0 (00110101).
        let mut out = [0];
        decode(&bytes("00110101 010 0011 0"), &mut out, 2, Rows::Aligned).unwrap_err();
        decode(&bytes("00110101 010 000111"), &mut out, 2, Rows::Aligned).unwrap();
        assert_eq!(out, [0x80]);
    }

    proptest! {
        #[test]
        fn decoding_random_data_ends_without_panic(data in prop::collection::vec(any::<u8>(), 0..200), width in 1usize..100) {
            for rows in [Rows::Aligned, Rows::Marked { two_dimensional: false }, Rows::Marked { two_dimensional: true }] {
                let _ = decode(&data, &mut vec![0; width.div_ceil(8) * 9], width, rows);
            }
        }
    }
}
