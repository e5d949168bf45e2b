//! Evaluates integer expressions of `#if`.

use crate::source::Pos;
use crate::token::{Raw, RawKind};

/// The largest depth of nested parentheses and operators.
const MAX_DEPTH: usize = 100;

/// An error, and its position if it is at a token.
type Failure = (Option<Pos>, String);

/// Returns the value of an expression whose macros have been replaced. Remaining names count as 0.
pub(crate) fn evaluate(tokens: &[Raw]) -> Result<i64, Failure> {
    let mut parser = Parser { tokens, at: 0, depth: 0 };
    if tokens.is_empty() {
        return Err((None, "there is no expression".into()));
    }
    let value = parser.ternary()?;
    match tokens.get(parser.at) {
        None => Ok(value),
        Some(t) => Err((Some(t.pos), format!("unexpected `{}`", t.text))),
    }
}

/// The binary operators, loosest first.
const LEVELS: &[&[&str]] = &[
    &["||"],
    &["&&"],
    &["|"],
    &["^"],
    &["&"],
    &["==", "!="],
    &["<", "<=", ">", ">="],
    &["<<", ">>"],
    &["+", "-"],
    &["*", "/", "%"],
];

struct Parser<'a> {
    tokens: &'a [Raw],
    at: usize,
    depth: usize,
}

impl Parser<'_> {
    fn eat(&mut self, marks: &[&'static str]) -> Option<&'static str> {
        let token = self.tokens.get(self.at)?;
        let found = marks.iter().find(|m| token.is(m)).copied();
        self.at += usize::from(found.is_some());
        found
    }

    fn here(&self) -> Option<Pos> {
        self.tokens.get(self.at).map(|t| t.pos)
    }

    fn deeper(&mut self) -> Result<(), Failure> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err((self.here(), format!("the expression is nested more than {MAX_DEPTH} deep")));
        }
        Ok(())
    }

    fn ternary(&mut self) -> Result<i64, Failure> {
        self.deeper()?;
        let value = self.binary(0)?;
        let value = if self.eat(&["?"]).is_some() {
            let yes = self.ternary()?;
            if self.eat(&[":"]).is_none() {
                return Err((self.here(), "`?` without `:`".into()));
            }
            let no = self.ternary()?;
            if value != 0 { yes } else { no }
        } else {
            value
        };
        self.depth -= 1;
        Ok(value)
    }

    fn binary(&mut self, level: usize) -> Result<i64, Failure> {
        let Some(marks) = LEVELS.get(level) else { return self.unary() };
        let mut left = self.binary(level + 1)?;
        loop {
            let at = self.here();
            let Some(mark) = self.eat(marks) else { return Ok(left) };
            let right = self.binary(level + 1)?;
            left = apply(mark, left, right).ok_or_else(|| (at, "division by zero".to_owned()))?;
        }
    }

    fn unary(&mut self) -> Result<i64, Failure> {
        self.deeper()?;
        let value = match self.eat(&["!", "-", "+", "~", "("]) {
            Some("!") => i64::from(self.unary()? == 0),
            Some("-") => self.unary()?.wrapping_neg(),
            Some("+") => self.unary()?,
            Some("~") => !self.unary()?,
            Some(_) => {
                let value = self.ternary()?;
                if self.eat(&[")"]).is_none() {
                    return Err((self.here(), "`(` without `)`".into()));
                }
                value
            }
            None => {
                let Some(token) = self.tokens.get(self.at) else {
                    return Err((None, "the expression ends too early".into()));
                };
                self.at += 1;
                match token.kind {
                    RawKind::Word => 0,
                    RawKind::Number => {
                        let digits = token.text.trim_end_matches(['u', 'U', 'l', 'L']);
                        let parsed = match digits.strip_prefix("0x").or(digits.strip_prefix("0X")) {
                            Some(hex) => i64::from_str_radix(hex, 16),
                            None => digits.parse(),
                        };
                        parsed
                            .map_err(|_| (Some(token.pos), format!("`{}` is not an integer", token.text)))?
                    }
                    _ => return Err((Some(token.pos), format!("unexpected `{}`", token.text))),
                }
            }
        };
        self.depth -= 1;
        Ok(value)
    }
}

fn apply(mark: &str, a: i64, b: i64) -> Option<i64> {
    Some(match mark {
        "||" => i64::from(a != 0 || b != 0),
        "&&" => i64::from(a != 0 && b != 0),
        "|" => a | b,
        "^" => a ^ b,
        "&" => a & b,
        "==" => i64::from(a == b),
        "!=" => i64::from(a != b),
        "<" => i64::from(a < b),
        "<=" => i64::from(a <= b),
        ">" => i64::from(a > b),
        ">=" => i64::from(a >= b),
        "<<" => a.wrapping_shl(b as u32),
        ">>" => a.wrapping_shr(b as u32),
        "+" => a.wrapping_add(b),
        "-" => a.wrapping_sub(b),
        "*" => a.wrapping_mul(b),
        "/" => a.checked_div(b)?,
        "%" => a.checked_rem(b)?,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::token::scan;

    #[test]
    fn preprocessor_conditions_are_evaluated() {
        let value = |text: &str| evaluate(&scan(text, 0)).map_err(|e| e.1);
        for (text, expected) in [
            ("1 + 2 * 3 == 7", 1),
            ("(1 + 2) * 3", 9),
            ("!0 && ~0 == -1", 1),
            ("7 / 2 - 7 % 2", 2),
            ("0x10 >> 2 | 1", 5),
            ("1 ? 2 ? 3 : 4 : 5", 3),
            ("unknown_name", 0),
            ("10L - 3 - 2", 5),
        ] {
            assert_eq!(value(text), Ok(expected), "{text}");
        }
        assert_eq!(value("1 / 0"), Err("division by zero".into()));
        assert_eq!(value("1 +"), Err("the expression ends too early".into()));
        assert_eq!(value("(1"), Err("`(` without `)`".into()));
        assert_eq!(value("1 2"), Err("unexpected `2`".into()));
        assert!(value(&"(".repeat(5000)).is_err());
        assert!(value(&"!".repeat(5000)).is_err());
    }
}
