//! Fast and correctly rounded conversion of text to numbers, for readers of text formats.

/// A number as written in a text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Number {
    /// A number of digits alone, within 64 bits.
    Int(i64),
    /// A number with a point or an exponent, or one that is too large for an integer.
    Float(f64),
}

impl Number {
    /// Returns the value as a float.
    #[inline]
    pub fn to_f64(self) -> f64 {
        match self {
            Self::Int(i) => i as f64,
            Self::Float(f) => f,
        }
    }
}

/// The powers of ten that are exact in double precision.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18,
    1e19, 1e20, 1e21, 1e22,
];

/// Reads a decimal (or `0x`) number at the beginning of `text`. Returns its value and its length in bytes; `None`
/// when there is none. A leading `+`, `nan` and `inf` are not accepted.
///
/// Up to 2^53 and exponents to 22 one exact multiplication or division gives the correctly rounded result (Clinger
/// 1990). All other numbers are converted by the standard library.
pub fn scan_number(text: &[u8]) -> Option<(Number, usize)> {
    let mut at = 0;
    let negative = text.first() == Some(&b'-');
    if negative {
        at = 1;
    }
    if text.get(at) == Some(&b'0') && matches!(text.get(at + 1), Some(b'x' | b'X')) {
        let digits = text[at + 2..].iter().take_while(|c| c.is_ascii_hexdigit()).count();
        let word = std::str::from_utf8(&text[at + 2..at + 2 + digits]).ok()?;
        let value = i64::from_str_radix(word, 16).ok()?;
        return Some((Number::Int(if negative { -value } else { value }), at + 2 + digits));
    }
    let start = at;
    let mut mantissa: u64 = 0;
    let mut digits = 0;
    let mut scale = 0i32;
    let mut exact = true;
    let mut take = |c: u8, digits: &mut i32| {
        if *digits < 19 {
            mantissa = mantissa * 10 + u64::from(c - b'0');
        } else {
            exact = false;
        }
        if mantissa != 0 {
            *digits += 1;
        }
    };
    let mut seen = false;
    while let Some(c @ b'0'..=b'9') = text.get(at) {
        take(*c, &mut digits);
        seen = true;
        at += 1;
    }
    let mut float = false;
    if text.get(at) == Some(&b'.') {
        float = true;
        at += 1;
        while let Some(c @ b'0'..=b'9') = text.get(at) {
            take(*c, &mut digits);
            scale -= 1;
            seen = true;
            at += 1;
        }
    }
    if !seen {
        return None;
    }
    let mut exponent_large = false;
    if matches!(text.get(at), Some(b'e' | b'E')) {
        let sign = matches!(text.get(at + 1), Some(b'+' | b'-'));
        let from = at + 1 + usize::from(sign);
        let n = text[from.min(text.len())..].iter().take_while(|c| c.is_ascii_digit()).count();
        if n > 0 {
            float = true;
            let value = text[from..from + n]
                .iter()
                .fold(0i32, |e, c| e.saturating_mul(10).saturating_add(i32::from(c - b'0')));
            let value = if text[at + 1] == b'-' { -value } else { value };
            exponent_large = value.abs() > 400;
            scale = scale.saturating_add(value);
            at = from + n;
        }
    }
    if !float {
        if exact && mantissa <= i64::MAX as u64 {
            let value = mantissa as i64;
            return Some((Number::Int(if negative { -value } else { value }), at));
        }
        let value: f64 = std::str::from_utf8(&text[start..at]).ok()?.parse().ok()?;
        return Some((Number::Float(if negative { -value } else { value }), at));
    }
    let value = if exact && !exponent_large && mantissa <= 1 << 53 && scale.unsigned_abs() <= 22 {
        let power = POWERS[scale.unsigned_abs() as usize];
        if scale < 0 { mantissa as f64 / power } else { mantissa as f64 * power }
    } else {
        std::str::from_utf8(&text[start..at]).ok()?.parse().ok()?
    };
    Some((Number::Float(if negative { -value } else { value }), at))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_agree_with_the_standard_library() {
        let texts = [
            "0",
            "-0.0",
            "1",
            "-17",
            "0.1",
            ".5",
            "5.",
            "1e10",
            "1E-10",
            "2.5e+3",
            "1e22",
            "1e23",
            "1e-22",
            "1e-23",
            "123456789012345678901234567890",
            "0.000000000000000000000000000001234",
            "9007199254740993.0",
            "3.4028235e38",
            "1e400",
            "1e-400",
            "4.9e-324",
            "0.30000000000000004",
            "1e99999999999",
            "9223372036854775807",
            "9223372036854775808",
            "0000000000000000000000000001.5",
        ];
        for text in texts {
            let (number, len) = scan_number(text.as_bytes()).unwrap();
            assert_eq!(len, text.len(), "{text}");
            let want: f64 = text.parse().unwrap();
            match number {
                Number::Int(i) => assert_eq!(i.to_string(), text),
                Number::Float(f) => assert_eq!(f.to_bits(), want.to_bits(), "{text}"),
            }
        }
        for bad in ["", "-", ".", "e5", "abc", "-.e3"] {
            assert!(scan_number(bad.as_bytes()).is_none(), "{bad}");
        }
        assert_eq!(scan_number(b"0x1F,"), Some((Number::Int(31), 4)));
        assert_eq!(scan_number(b"1e,"), Some((Number::Int(1), 1)));
    }
}
