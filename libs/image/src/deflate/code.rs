//! Blocks of deflate whose bytes are all literals, with a code of their own (RFC 1951, section 3.2).

/// The length of the longest code. Four codes fit into a word beside the bits of an incomplete byte.
const LONGEST: usize = 12;

/// The symbol that ends a block.
const END: usize = 256;

/// The order of the lengths of the code of lengths.
const ORDER: [usize; 19] = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];

/// The code of a symbol, with the bit first that is written first, and its number of bits.
#[derive(Clone, Copy, Default)]
struct Code {
    bits: u16,
    len: u16,
}

/// A symbol of the code of lengths, the value of the bits that follow it, and their number.
#[derive(Clone, Copy)]
struct Token {
    symbol: u8,
    value: u8,
    extra: u8,
}

/// The code for the bytes of a piece.
pub(super) struct LiteralCode {
    codes: [Code; END + 1],
    /// The description of the code: its lengths, and the code in which they are written.
    tokens: Vec<Token>,
    token_codes: [Code; 19],
    /// The number of bits of the block.
    bits: u64,
}

impl LiteralCode {
    /// Returns the shortest code for bytes of these counts, which [`histogram`] returns.
    pub(super) fn of(counts: &[u32; END + 1]) -> Self {
        let lengths = lengths::<{ END + 1 }>(counts, LONGEST);
        let codes = canonical(&lengths);
        // No distance occurs. Some decoders require a complete code of distances, which two codes of one bit are.
        let tokens = tokens(lengths.iter().copied().chain([1, 1]));
        let mut token_counts = [0; 19];
        tokens.iter().for_each(|t| token_counts[usize::from(t.symbol)] += 1);
        let token_codes = canonical(&self::lengths::<19>(&token_counts, 7));
        let mut bits = 3 + 14 + 3 * used(&token_codes) as u64;
        bits += tokens
            .iter()
            .map(|t| u64::from(token_codes[usize::from(t.symbol)].len) + u64::from(t.extra))
            .sum::<u64>();
        bits += counts.iter().zip(&codes).map(|(n, c)| u64::from(*n) * u64::from(c.len)).sum::<u64>();
        Self { codes, tokens, token_codes, bits }
    }

    /// Returns the number of bits of the block.
    pub(super) fn bits(&self) -> u64 {
        self.bits
    }

    /// Writes `bytes`, which the code was made for, as a block. They are fewer than 65536, and are stored where the
    /// code does not shorten them.
    pub(super) fn write(&self, bytes: &[u8], last: bool, out: &mut Bits) {
        if self.bits >= 8 * bytes.len() as u64 {
            return out.stored(bytes, last);
        }
        out.put(u64::from(last) | 2 << 1, 3);
        // 257 codes of literals, 2 of distances, and the lengths of the code of lengths.
        let used = used(&self.token_codes);
        out.put(1 << 5 | (used as u64 - 4) << 10, 14);
        ORDER[..used].iter().for_each(|i| out.put(u64::from(self.token_codes[*i].len), 3));
        for token in &self.tokens {
            let code = self.token_codes[usize::from(token.symbol)];
            out.put(u64::from(code.bits), u32::from(code.len));
            out.put(u64::from(token.value), u32::from(token.extra));
        }
        let (four, rest) = bytes.as_chunks::<4>();
        for &[a, b, c, d] in four {
            let code = |byte: u8| {
                let code = self.codes[usize::from(byte)];
                (u64::from(code.bits), u32::from(code.len))
            };
            let ((a, a_len), (b, b_len), (c, c_len), (d, d_len)) = (code(a), code(b), code(c), code(d));
            let (ab, cd) = (a | b << a_len, c | d << c_len);
            out.put(ab | cd << (a_len + b_len), a_len + b_len + c_len + d_len);
        }
        for symbol in rest.iter().map(|b| usize::from(*b)).chain([END]) {
            out.put(u64::from(self.codes[symbol].bits), u32::from(self.codes[symbol].len));
        }
    }
}

/// Returns the number of each byte, and 1 for the end.
pub(super) fn histogram(bytes: &[u8]) -> [u32; END + 1] {
    // Equal bytes in a row are counted in different tables, which do not wait for each other.
    let mut tables = [[0u32; 256]; 4];
    let (four, rest) = bytes.as_chunks::<4>();
    for four in four {
        for (table, byte) in tables.iter_mut().zip(four) {
            table[usize::from(*byte)] += 1;
        }
    }
    rest.iter().for_each(|b| tables[0][usize::from(*b)] += 1);
    let mut counts = [1; END + 1];
    for (i, count) in counts[..256].iter_mut().enumerate() {
        *count = tables.iter().map(|t| t[i]).sum();
    }
    counts
}

/// Returns the lengths of the best code of at most `longest` bits for symbols of these counts. Symbols that do not
/// occur have length 0. At least two symbols have a code.
fn lengths<const N: usize>(counts: &[u32; N], longest: usize) -> [u8; N] {
    let mut sorted: Vec<(u32, u16)> = (0..N as u16).map(|i| (counts[usize::from(i)], i)).collect();
    sorted.sort_unstable();
    let absent = sorted.partition_point(|s| s.0 == 0).min(N - 2);
    let sorted = &sorted[absent..];
    let n = sorted.len();
    // The tree of Huffman: the leaves, then the inner nodes, both in the order of their weights.
    let mut weights: Vec<u32> = sorted.iter().map(|s| s.0).collect();
    let mut parents = vec![0u16; 2 * n - 1];
    let (mut leaf, mut inner) = (0, n);
    for next in n..2 * n - 1 {
        let mut weight = 0;
        for _ in 0..2 {
            let lightest = if leaf < n && (inner >= next || weights[leaf] <= weights[inner]) {
                &mut leaf
            } else {
                &mut inner
            };
            weight += weights[*lightest];
            parents[*lightest] = next as u16;
            *lightest += 1;
        }
        weights.push(weight);
    }
    let mut depths = vec![0u16; 2 * n - 1];
    for node in (0..2 * n - 2).rev() {
        depths[node] = depths[usize::from(parents[node])] + 1;
    }
    let mut of_length = [0usize; 16];
    depths[..n].iter().for_each(|d| of_length[usize::from(*d).min(longest)] += 1);
    // There may be too many codes after their lengths are limited. Each step makes a shorter code longer by one bit,
    // and gives the bits that this frees to one of the longest codes.
    let mut space: usize = (1..=longest).map(|l| of_length[l] << (longest - l)).sum();
    while space > 1 << longest {
        let Some(shorter) = (1..longest).rev().find(|l| of_length[*l] > 0) else { break };
        of_length[longest] -= 1;
        of_length[shorter] -= 1;
        of_length[shorter + 1] += 2;
        space -= 1;
    }
    let mut lengths = [0; N];
    let descending = (1..=longest).rev().flat_map(|l| std::iter::repeat_n(l as u8, of_length[l]));
    for ((_, symbol), length) in sorted.iter().zip(descending) {
        lengths[usize::from(*symbol)] = length;
    }
    lengths
}

/// Returns the codes of these lengths (RFC 1951, section 3.2.2).
fn canonical<const N: usize>(lengths: &[u8; N]) -> [Code; N] {
    let mut next = [0u16; LONGEST + 2];
    for length in lengths.iter().filter(|l| **l > 0) {
        next[usize::from(*length) + 1] += 1;
    }
    // The first code of each length follows the last one of the length before, with another bit.
    for l in 2..=LONGEST {
        next[l] = (next[l] + next[l - 1]) << 1;
    }
    let mut codes = [Code::default(); N];
    for (code, &len) in codes.iter_mut().zip(lengths).filter(|(_, l)| **l > 0) {
        let value = &mut next[usize::from(len)];
        *code = Code { bits: value.reverse_bits() >> (16 - len), len: u16::from(len) };
        *value += 1;
    }
    codes
}

/// Returns the lengths of a code in the form in which they are written: runs of equal lengths are one token.
fn tokens(lengths: impl Iterator<Item = u8>) -> Vec<Token> {
    let all: Vec<u8> = lengths.collect();
    let mut tokens = Vec::with_capacity(all.len());
    for run in all.chunk_by(|a, b| a == b) {
        let (length, mut left) = (run[0], run.len());
        if length > 0 {
            tokens.push(Token { symbol: length, value: 0, extra: 0 });
            left -= 1;
        }
        while left > 0 {
            let (symbol, extra, first, most) = match (length, left) {
                (_, 1..=2) => (length, 0, 1, 1),
                (0, 3..=10) => (17, 3, 3, 10),
                (0, _) => (18, 7, 11, 138),
                _ => (16, 2, 3, 6),
            };
            let n = left.min(most);
            tokens.push(Token { symbol, value: (n - first) as u8, extra });
            left -= n;
        }
    }
    tokens
}

/// Returns how many lengths of the code of lengths are written, at least 4.
fn used(codes: &[Code; 19]) -> usize {
    (4..=19).rev().find(|n| codes[ORDER[n - 1]].len > 0).unwrap_or(4)
}

/// Bits that are written one after another, the lowest of each byte first.
pub(super) struct Bits {
    out: Vec<u8>,
    /// The number of complete bytes in `out`, which is longer.
    len: usize,
    waiting: u64,
    count: u32,
}

impl Bits {
    /// Returns bits with memory for so many bytes. It grows where they are more.
    pub(super) fn new(bytes: usize) -> Self {
        Self { out: vec![0; bytes + 8], len: 0, waiting: 0, count: 0 }
    }

    /// Appends the lowest `count` bits of a value, at most 56. Its other bits are 0.
    #[inline]
    pub(super) fn put(&mut self, value: u64, count: u32) {
        self.waiting |= value << self.count;
        self.count += count;
        if self.out.len() < self.len + 8 {
            self.out.resize(2 * self.len + 64, 0);
        }
        self.out[self.len..self.len + 8].copy_from_slice(&self.waiting.to_le_bytes());
        self.len += self.count as usize / 8;
        self.waiting >>= self.count & !7;
        self.count &= 7;
    }

    /// Appends bytes, from the next complete byte on.
    pub(super) fn bytes(&mut self, bytes: &[u8]) {
        self.put(0, self.count.wrapping_neg() & 7);
        self.out.truncate(self.len);
        self.out.extend_from_slice(bytes);
        self.len = self.out.len();
    }

    /// Appends a block of bytes as they are, fewer than 65536.
    pub(super) fn stored(&mut self, bytes: &[u8], last: bool) {
        self.put(u64::from(last), 3);
        let len = bytes.len() as u16;
        self.bytes(&[len.to_le_bytes(), (!len).to_le_bytes()].concat());
        self.bytes(bytes);
    }

    /// Returns the bytes. The last one is filled with zeros.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.bytes(&[]);
        self.out
    }
}
