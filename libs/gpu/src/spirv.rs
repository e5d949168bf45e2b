//! A pass over modules of SPIR-V, after which drivers keep to the arithmetic that is written.
//!
//! Without it drivers fold `(x + b) - b` to `x`, contract products and sums to fused operations, and may flush denormal
//! numbers. Each arithmetic instruction is decorated with `NoContraction`. Entry points get the execution modes of the
//! extension `SPV_KHR_float_controls` that the adapter supports. The numbers are those of the SPIR-V specification,
//! version 1.6.

use crate::native::FloatModes;

/// The number of words before the first instruction.
const HEADER: usize = 5;

// Opcodes.
const EXTENSION: u32 = 10;
const MEMORY_MODEL: u32 = 14;
const ENTRY_POINT: u32 = 15;
const EXECUTION_MODE: u32 = 16;
const CAPABILITY: u32 = 17;
const TYPE_FLOAT: u32 = 22;
const DECORATE: u32 = 71;

/// The arithmetic instructions on floating point numbers: negation, sum, difference, product, quotient, remainders and
/// products of vectors and matrices.
const ARITHMETIC: [u32; 14] = [127, 129, 131, 133, 136, 140, 141, 142, 143, 144, 145, 146, 147, 148];

/// The decoration `NoContraction`.
const NO_CONTRACTION: u32 = 42;

/// The numbers of an execution mode and of its capability.
struct Mode {
    mode: u32,
    capability: u32,
}

const DENORM_PRESERVE: Mode = Mode { mode: 4459, capability: 4464 };
const SIGNED_ZERO_INF_NAN_PRESERVE: Mode = Mode { mode: 4461, capability: 4466 };
const ROUNDING_MODE_RTE: Mode = Mode { mode: 4462, capability: 4467 };

/// Returns the instructions of a module: opcode and operands.
fn instructions(words: &[u32]) -> impl Iterator<Item = &[u32]> {
    let mut at = HEADER;
    std::iter::from_fn(move || {
        let length = (*words.get(at)? >> 16) as usize;
        let instruction = words.get(at..at + length.max(1))?;
        at += length.max(1);
        Some(instruction)
    })
}

fn opcode(instruction: &[u32]) -> u32 {
    instruction[0] & 0xffff
}

/// Returns an instruction.
fn instruction(opcode: u32, operands: &[u32]) -> Vec<u32> {
    let mut out = vec![(operands.len() as u32 + 1) << 16 | opcode];
    out.extend(operands);
    out
}

/// Returns the words of a text: its bytes and at least one zero.
fn text(text: &str) -> Vec<u32> {
    let mut bytes = text.as_bytes().to_vec();
    bytes.resize(bytes.len() / 4 * 4 + 4, 0);
    bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

/// Returns a module whose arithmetic is exact as it is written, with the modes that the adapter supports.
pub(crate) fn exact(words: &[u32], modes: FloatModes) -> Vec<u32> {
    let widths: Vec<u32> =
        instructions(words).filter(|i| opcode(i) == TYPE_FLOAT).filter_map(|i| i.get(2).copied()).collect();
    let entries: Vec<u32> =
        instructions(words).filter(|i| opcode(i) == ENTRY_POINT).filter_map(|i| i.get(2).copied()).collect();
    let mut requested: Vec<(&Mode, u32)> = Vec::new();
    for (mode, there) in [
        (&DENORM_PRESERVE, modes.denormals),
        (&SIGNED_ZERO_INF_NAN_PRESERVE, modes.specials),
        (&ROUNDING_MODE_RTE, modes.nearest),
    ] {
        for (width, there) in [32, 64].into_iter().zip(there) {
            if there && widths.contains(&width) {
                requested.push((mode, width));
            }
        }
    }
    let mut capabilities: Vec<u32> = requested.iter().map(|(mode, _)| mode.capability).collect();
    capabilities.dedup();
    let results: Vec<u32> = instructions(words)
        .filter(|i| ARITHMETIC.contains(&opcode(i)))
        .filter_map(|i| i.get(2).copied())
        .collect();
    let mut out = words[..HEADER.min(words.len())].to_vec();
    let (mut begun, mut extended, mut modes_done, mut decorated) = (false, false, false, false);
    for i in instructions(words) {
        let code = opcode(i);
        // Sections of a module follow in this order: capabilities, extensions, the memory model, entry points,
        // execution modes, names, decorations, types.
        if !begun {
            begun = true;
            capabilities.iter().for_each(|c| out.extend(instruction(CAPABILITY, &[*c])));
        }
        if !extended && code != CAPABILITY {
            extended = true;
            if !requested.is_empty() {
                out.extend(instruction(EXTENSION, &text("SPV_KHR_float_controls")));
            }
        }
        let early = matches!(code, CAPABILITY | EXTENSION | 11 | MEMORY_MODEL | ENTRY_POINT | EXECUTION_MODE);
        if !modes_done && !early {
            modes_done = true;
            for entry in &entries {
                for (mode, width) in &requested {
                    out.extend(instruction(EXECUTION_MODE, &[*entry, mode.mode, *width]));
                }
            }
        }
        // Strings, names and module information precede decorations.
        let named = matches!(code, 2..=8 | 330);
        if !decorated && !early && !named {
            decorated = true;
            for result in &results {
                out.extend(instruction(DECORATE, &[*result, NO_CONTRACTION]));
            }
        }
        out.extend(i);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A module with one sum of two numbers of 32 bits. The types follow the memory model and the entry point.
    fn module() -> Vec<u32> {
        let mut words = vec![0x0723_0203, 0x0001_0300, 0, 20, 0];
        for (code, operands) in [
            (CAPABILITY, &[1_u32][..]),
            (MEMORY_MODEL, &[0, 1]),
            (ENTRY_POINT, &[5, 9, 0x6e69_616d, 0]),
            (EXECUTION_MODE, &[9, 17, 64, 1, 1]),
            (TYPE_FLOAT, &[3, 32]),
            (129, &[3, 10, 11, 12]),
            (133, &[3, 13, 10, 12]),
        ] {
            words.extend(instruction(code, operands));
        }
        words
    }

    #[test]
    fn each_arithmetic_result_is_decorated_once() {
        let out = exact(&module(), FloatModes::default());
        let decorated: Vec<&[u32]> = instructions(&out).filter(|i| opcode(i) == DECORATE).collect();
        assert_eq!(decorated.iter().map(|i| i[1]).collect::<Vec<_>>(), [10, 13]);
        assert!(decorated.iter().all(|i| i[2] == NO_CONTRACTION));
        let order: Vec<u32> = instructions(&out).map(opcode).collect();
        let expected =
            [CAPABILITY, MEMORY_MODEL, ENTRY_POINT, EXECUTION_MODE, DECORATE, DECORATE, TYPE_FLOAT, 129, 133];
        assert_eq!(order, expected);
    }

    #[test]
    fn supported_modes_are_requested_for_the_types_of_the_module() {
        let modes = FloatModes { denormals: [true, true], specials: [true, false], nearest: [false, true] };
        let out = exact(&module(), modes);
        let of = |code: u32| instructions(&out).filter(move |i| opcode(i) == code);
        // The module has no numbers of 64 bits.
        assert_eq!(of(CAPABILITY).map(|i| i[1]).collect::<Vec<_>>(), [4464, 4466, 1]);
        assert_eq!(of(EXECUTION_MODE).map(|i| i[2]).collect::<Vec<_>>(), [17, 4459, 4461]);
        assert_eq!(of(EXTENSION).count(), 1);
    }

    #[test]
    fn words_that_are_no_module_pass_unchanged() {
        for words in [&[][..], &[1, 2, 3], &[1, 2, 3, 4, 5]] {
            assert_eq!(exact(words, FloatModes::default()), words);
        }
    }
}
