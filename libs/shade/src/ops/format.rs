//! Formats templates of `printf` (reference 5.8.9).

use crate::run::strings::MAX_TEXT;
use std::fmt::Write as _;

/// A value to be printed.
#[derive(Clone, Debug)]
pub(super) enum Item<'a> {
    /// Components of a float, triple or matrix.
    Numbers(&'a [f32]),
    /// A string.
    Text(&'a str),
}

/// One conversion of a template.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Spec {
    left: bool,
    plus: bool,
    space: bool,
    zero: bool,
    sharp: bool,
    width: usize,
    precision: Option<usize>,
}

/// The largest width of a field. Wider ones are cut, so that a shader cannot allocate gigabytes.
const MAX_FIELD: usize = 4096;

/// Fills a template. `%f`, `%c`, `%p`, `%v`, `%n` and `%m` print the numbers of any numeric value as C's `%f`,
/// separated by blanks. `%e`, `%g`, `%d`, `%i`, `%x` and `%s` are supported too, with flags, width and precision. `%%`
/// is a percent sign. A conversion without a value prints nothing. A value of the wrong type is printed in its own
/// form. The result ends after the first value that makes it longer than [`MAX_TEXT`].
pub(super) fn fill<'a>(template: &str, items: impl IntoIterator<Item = Item<'a>>) -> String {
    let mut items = items.into_iter();
    let mut out = String::with_capacity(template.len() + 16);
    let mut chars = template.chars().peekable();
    while let Some(c) = chars.next() {
        // Text beyond the limit is cut off later.
        if out.len() > MAX_TEXT {
            break;
        }
        if c != '%' {
            out.push(c);
            continue;
        }
        let start = out.len();
        out.push('%');
        let mut spec = Spec::default();
        let number = |chars: &mut std::iter::Peekable<std::str::Chars<'_>>, out: &mut String| {
            let mut n = 0_usize;
            while let Some(d) = chars.peek().and_then(|c| c.to_digit(10)) {
                out.push(chars.next().unwrap_or('0'));
                n = (n * 10 + d as usize).min(MAX_FIELD);
            }
            n
        };
        while let Some(&flag) = chars.peek() {
            match flag {
                '-' => spec.left = true,
                '+' => spec.plus = true,
                ' ' => spec.space = true,
                '0' => spec.zero = true,
                '#' => spec.sharp = true,
                _ => break,
            }
            out.push(flag);
            chars.next();
        }
        spec.width = number(&mut chars, &mut out);
        if chars.peek() == Some(&'.') {
            out.push('.');
            chars.next();
            spec.precision = Some(number(&mut chars, &mut out));
        }
        match chars.next() {
            // A single percent sign at the end is printed as it is.
            None => break,
            Some('%') => {
                out.truncate(start);
                out.push('%');
            }
            Some(kind) if granita_gsl::CONVERSIONS.contains(kind) => {
                out.truncate(start);
                if let Some(item) = items.next() {
                    print(&mut out, spec, kind, &item);
                }
            }
            Some(other) => out.push(other),
        }
    }
    out
}

/// Prints one value.
fn print(out: &mut String, spec: Spec, kind: char, item: &Item<'_>) {
    match item {
        Item::Text(text) => {
            let cut: String = match spec.precision {
                Some(p) if kind == 's' => text.chars().take(p).collect(),
                _ => (*text).to_owned(),
            };
            pad(out, Spec { zero: false, ..spec }, "", &cut);
        }
        Item::Numbers(list) => {
            for (k, &x) in list.iter().enumerate() {
                if k > 0 {
                    out.push(' ');
                }
                let (sign, digits) = number(spec, kind, x);
                let zero = spec.zero && x.is_finite();
                pad(out, Spec { zero, ..spec }, sign, &digits);
            }
        }
    }
}

/// Returns the sign and digits of a number.
fn number(spec: Spec, kind: char, x: f32) -> (&'static str, String) {
    let negative = x.is_sign_negative() && !x.is_nan();
    let sign = match (negative, spec.plus, spec.space) {
        (true, _, _) => "-",
        (_, true, _) => "+",
        (_, _, true) => " ",
        _ => "",
    };
    // C prints doubles, and so does this function.
    let a = f64::from(x.abs());
    if x.is_nan() {
        return ("", "nan".to_owned());
    }
    if a.is_infinite() {
        return (sign, "inf".to_owned());
    }
    let precision = spec.precision.unwrap_or(6);
    let digits = match kind {
        'd' | 'i' => {
            let whole = a.trunc();
            // Minus zero is printed as zero.
            return (if whole == 0.0 && negative { "" } else { sign }, format!("{whole:.0}"));
        }
        'x' => format!("{:x}", a.trunc() as u64),
        'e' | 'E' => exponent(a, precision),
        'g' | 'G' | 's' => general(a, spec.precision.unwrap_or(6), spec.sharp),
        _ => format!("{a:.precision$}"),
    };
    (sign, digits)
}

/// Formats as `d.ddde+XX`.
fn exponent(a: f64, precision: usize) -> String {
    let text = format!("{a:.precision$e}");
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    let mut out = mantissa.to_owned();
    let _ = write!(out, "e{}{:02}", if exponent < 0 { '-' } else { '+' }, exponent.abs());
    out
}

/// Returns the shorter of both forms, without zeros at the end.
fn general(a: f64, precision: usize, keep_zeros: bool) -> String {
    let precision = precision.max(1);
    let rounded = format!("{a:.*e}", precision - 1);
    let exponent10: i32 = rounded.split_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0);
    let trim = |text: String| {
        if keep_zeros || !text.contains('.') {
            text
        } else {
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        }
    };
    if exponent10 < -4 || exponent10 >= precision as i32 {
        let text = exponent(a, precision - 1);
        match text.split_once('e') {
            Some((mantissa, e)) => format!("{}e{e}", trim(mantissa.to_owned())),
            None => text,
        }
    } else {
        let places = (precision as i32 - 1 - exponent10).max(0) as usize;
        trim(format!("{a:.places$}"))
    }
}

/// Pads to the width.
fn pad(out: &mut String, spec: Spec, sign: &str, digits: &str) {
    let missing = spec.width.saturating_sub(sign.len() + digits.chars().count());
    let fill = |out: &mut String, c: char| out.extend(std::iter::repeat_n(c, missing));
    if spec.left {
        out.push_str(sign);
        out.push_str(digits);
        fill(out, ' ');
    } else if spec.zero {
        out.push_str(sign);
        fill(out, '0');
        out.push_str(digits);
    } else {
        fill(out, ' ');
        out.push_str(sign);
        out.push_str(digits);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn format_conversions_print_like_c() {
        let cases: [(&str, &[f32], &str); 26] = [
            ("%f", &[1.0], "1.000000"),
            ("%.2f|", &[-1.005], "-1.00|"),
            ("%8.3f", &[3.25159], "   3.252"),
            ("%-8.3f|", &[3.25159], "3.252   |"),
            ("%08.3f", &[-3.25159], "-003.252"),
            ("%+d", &[7.9], "+7"),
            ("%d", &[-7.9], "-7"),
            ("%i", &[-0.5], "0"),
            ("%3d", &[5.0], "  5"),
            ("%03i", &[5.0], "005"),
            ("%c", &[0.5, 0.25, 1.0], "0.500000 0.250000 1.000000"),
            ("%.1p", &[1.0, 2.0, 3.0], "1.0 2.0 3.0"),
            ("%.1v", &[1.0, 2.0, 3.0], "1.0 2.0 3.0"),
            ("%.0n", &[1.0, 2.0, 3.0], "1 2 3"),
            ("%g", &[0.0001], "0.0001"),
            ("%g", &[1e-5], "1e-05"),
            ("%g", &[100000.0], "100000"),
            ("%g", &[1e6], "1e+06"),
            ("%g", &[0.5], "0.5"),
            ("%.3e", &[12345.0], "1.234e+04"),
            ("%x", &[255.0], "ff"),
            ("%s", &[0.5], "0.5"),
            ("%f", &[f32::NAN], "nan"),
            ("%f", &[f32::NEG_INFINITY], "-inf"),
            ("100%%", &[], "100%"),
            ("% d", &[3.0], " 3"),
        ];
        for (template, values, expected) in cases {
            assert_eq!(fill(template, [Item::Numbers(values)]), expected, "{template}");
        }
    }

    #[test]
    fn format_prints_strings_and_values_of_wrong_types() {
        let text = |t: &str| fill(t, [Item::Text("wood"), Item::Numbers(&[4.0])]);
        assert_eq!(text("%s.%04d.tx"), "wood.0004.tx");
        assert_eq!(text("%6s|%-3d|"), "  wood|4  |");
        assert_eq!(text("%.2s"), "wo");
        // A value of the wrong type is printed in its own form, a missing one as nothing, and an unknown conversion
        // as itself.
        assert_eq!(text("%f %s %d"), "wood 4 ");
        assert_eq!(text("%y%"), "%y%");
        assert_eq!(text("%5"), "%5");
        assert!(fill("%99999999f", [Item::Numbers(&[1.0])]).len() <= MAX_FIELD);
    }
}
