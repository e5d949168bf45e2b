//! Expressions of `IfBegin` and `ElseIf`, and the conditionals that are being read.
//!
//! They are not part of the interface 3.2, but exporters of its time write them: `IfBegin "$user:pass == 'shadow'"`.
//! Expressions have numbers, strings in single quotes, `$name` or `${name}` (an option or attribute `user`, or
//! `Frame`), `defined (name)`, `!`, `*`, `/`, `+`, `-`, comparisons (`=~` matches a pattern of the shell), `&&`, `||`
//! and parentheses.

/// A value. An undefined value is neither a number nor a string, and is false.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    Nothing,
    Number(f64),
    Text(String),
}

impl Value {
    fn number(&self) -> Option<f64> {
        match self {
            Self::Number(x) => Some(*x),
            Self::Text(text) => text.trim().parse().ok(),
            Self::Nothing => None,
        }
    }

    fn is_true(&self) -> bool {
        match self {
            Self::Nothing => false,
            Self::Number(x) => *x != 0.0,
            Self::Text(text) => self.number().map_or(!text.is_empty(), |x| x != 0.0),
        }
    }

    fn text(&self) -> String {
        match self {
            Self::Nothing => String::new(),
            Self::Number(x) => x.to_string(),
            Self::Text(text) => text.clone(),
        }
    }
}

/// The largest depth of nested parentheses and signs.
const MAX_DEPTH: usize = 64;

/// True when an expression holds. `lookup` returns the values of names.
///
/// # Errors
/// Returns a text when the expression cannot be read.
pub(crate) fn is_true(text: &str, lookup: &dyn Fn(&str) -> Option<Value>) -> Result<bool, String> {
    let mut parser = Parser { rest: text, lookup, depth: 0 };
    let value = parser.level(0)?;
    match parser.rest.trim_start() {
        "" => Ok(value.is_true()),
        rest => Err(format!("\"{}\" in the condition is not understood", head(rest))),
    }
}

fn head(text: &str) -> String {
    text.chars().take(20).collect()
}

/// The operators by precedence, the lowest first. An operator comes before those that are its beginning.
const LEVELS: [&[&str]; 6] =
    [&["||"], &["&&"], &["==", "!=", "=~"], &["<=", ">=", "<", ">"], &["+", "-"], &["*", "/"]];

struct Parser<'a> {
    rest: &'a str,
    lookup: &'a dyn Fn(&str) -> Option<Value>,
    depth: usize,
}

impl Parser<'_> {
    fn take(&mut self, token: &str) -> bool {
        let rest = self.rest.trim_start();
        match rest.strip_prefix(token) {
            Some(after) => {
                self.rest = after;
                true
            }
            None => false,
        }
    }

    fn level(&mut self, level: usize) -> Result<Value, String> {
        let Some(operators) = LEVELS.get(level) else { return self.single() };
        let mut left = self.level(level + 1)?;
        while let Some(operator) = operators.iter().find(|o| self.take(o)) {
            let right = self.level(level + 1)?;
            left = apply(operator, &left, &right);
        }
        Ok(left)
    }

    fn single(&mut self) -> Result<Value, String> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err("the condition is nested too deep".to_owned());
        }
        let value = self.operand();
        self.depth -= 1;
        value
    }

    fn operand(&mut self) -> Result<Value, String> {
        if self.take("!") {
            return Ok(Value::Number(f64::from(u8::from(!self.single()?.is_true()))));
        }
        if self.take("-") {
            return Ok(self.single()?.number().map_or(Value::Nothing, |x| Value::Number(-x)));
        }
        if self.take("(") {
            let value = self.level(0)?;
            return if self.take(")") {
                Ok(value)
            } else {
                Err("\"(\" without \")\" in the condition".to_owned())
            };
        }
        for quote in ["'", "\""] {
            if self.take(quote) {
                let (text, rest) =
                    self.rest.split_once(quote).ok_or("a string without its end in the condition")?;
                self.rest = rest;
                return Ok(Value::Text(text.to_owned()));
            }
        }
        if self.take("$") {
            let name = if self.take("{") {
                let (name, rest) = self.rest.split_once('}').ok_or("\"{\" without \"}\" in the condition")?;
                self.rest = rest;
                name.trim().to_owned()
            } else {
                self.word()
            };
            return Ok((self.lookup)(&name).unwrap_or(Value::Nothing));
        }
        let before = self.rest;
        let word = self.word();
        if word == "defined" && self.take("(") {
            let _ = self.take("$");
            let name = self.word();
            if !self.take(")") {
                return Err("\"(\" without \")\" in the condition".to_owned());
            }
            return Ok(Value::Number(f64::from(u8::from((self.lookup)(&name).is_some()))));
        }
        if let Ok(number) = word.parse::<f64>() {
            return Ok(Value::Number(number));
        }
        match word.as_str() {
            "" => match head(before.trim_start()) {
                rest if rest.is_empty() => Err("the condition ends early".to_owned()),
                rest => Err(format!("\"{rest}\" in the condition is not understood")),
            },
            "true" => Ok(Value::Number(1.0)),
            "false" => Ok(Value::Number(0.0)),
            _ => Ok(Value::Text(word)),
        }
    }

    /// Takes a word of letters, digits and the other characters of names and numbers.
    fn word(&mut self) -> String {
        let rest = self.rest.trim_start();
        let end = rest.find(|c: char| !(c.is_alphanumeric() || matches!(c, '_' | ':' | '.')));
        let (word, after) = rest.split_at(end.unwrap_or(rest.len()));
        self.rest = after;
        word.to_owned()
    }
}

fn apply(operator: &str, left: &Value, right: &Value) -> Value {
    let truth = |yes: bool| Value::Number(f64::from(u8::from(yes)));
    let numbers = left.number().zip(right.number());
    let compared = || match numbers {
        Some((a, b)) => a.partial_cmp(&b),
        None => Some(left.text().cmp(&right.text())),
    };
    match operator {
        "||" => truth(left.is_true() || right.is_true()),
        "&&" => truth(left.is_true() && right.is_true()),
        "==" => truth(compared() == Some(std::cmp::Ordering::Equal)),
        "!=" => truth(compared() != Some(std::cmp::Ordering::Equal)),
        "=~" => truth(matches_pattern(left.text().as_bytes(), right.text().as_bytes())),
        "<" => truth(compared().is_some_and(std::cmp::Ordering::is_lt)),
        ">" => truth(compared().is_some_and(std::cmp::Ordering::is_gt)),
        "<=" => truth(compared().is_some_and(std::cmp::Ordering::is_le)),
        ">=" => truth(compared().is_some_and(std::cmp::Ordering::is_ge)),
        _ => match (operator, numbers) {
            ("+", Some((a, b))) => Value::Number(a + b),
            ("-", Some((a, b))) => Value::Number(a - b),
            ("*", Some((a, b))) => Value::Number(a * b),
            ("/", Some((a, b))) => Value::Number(a / b),
            ("+", None) => Value::Text(left.text() + &right.text()),
            _ => Value::Nothing,
        },
    }
}

/// True when a text matches a pattern. `*` matches any text, `?` one byte.
fn matches_pattern(text: &[u8], pattern: &[u8]) -> bool {
    let (mut t, mut p) = (0, 0);
    // The position of the last `*`, and the position in the text at which the rest of the pattern was tried.
    let mut star = None;
    while t < text.len() {
        match pattern.get(p) {
            Some(b'*') => {
                star = Some((p, t));
                p += 1;
            }
            Some(c) if *c == b'?' || *c == text[t] => {
                t += 1;
                p += 1;
            }
            _ => match star {
                Some((at, from)) => {
                    star = Some((at, from + 1));
                    (p, t) = (at + 1, from + 1);
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|c| *c == b'*')
}

/// A conditional that is being read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Branch {
    /// The line of its `IfBegin`.
    pub(crate) line: u32,
    /// True when the current branch is taken.
    pub(crate) taken: bool,
    /// True when a branch was taken, so that no later one is taken.
    pub(crate) done: bool,
    /// True when `Else` was read.
    pub(crate) last: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conditions_are_evaluated_or_refused() {
        let lookup = |name: &str| match name {
            "user:pass" => Some(Value::Text("shadow".into())),
            "user:n" => Some(Value::Number(3.0)),
            "Frame" => Some(Value::Number(12.0)),
            _ => None,
        };
        for good in [
            "1",
            "$user:pass == 'shadow'",
            "$user:pass != \"beauty\" && $user:n > 2",
            "$user:pass =~ 'sh*w'",
            "${user:n} + 1 == 2 * 2",
            "!defined(user:other)",
            "defined ($user:n)",
            "($Frame >= 10) && ($Frame <= 20) || 0",
            "-1 < -0.5",
            "!$user:other",
            "'10' > 9",
            "1 - 1 - 1 == -1",
        ] {
            assert_eq!(is_true(good, &lookup), Ok(true), "{good}");
        }
        for bad in
            ["0", "''", "$user:other", "$user:pass == shade", "$user:pass =~ 's?w'", "1 / 0 - 1 / 0 == 0"]
        {
            assert_eq!(is_true(bad, &lookup), Ok(false), "{bad}");
        }
        let deep = "(".repeat(1000);
        for broken in ["", "1 +", "(1", "1 2", "'a", "${a", "defined(a", "@", &deep, "=="] {
            assert!(is_true(broken, &lookup).is_err(), "{broken}");
        }
    }

    #[test]
    fn wildcard_patterns_match() {
        for (text, pattern) in
            [("", "*"), ("abc", "a*c"), ("abc", "*b*"), ("aXbXc", "a*b?c"), ("a*", "a\u{2a}")]
        {
            assert!(matches_pattern(text.as_bytes(), pattern.as_bytes()), "{text} {pattern}");
        }
        for (text, pattern) in [("abc", "a"), ("abc", "a?"), ("", "?"), ("abcd", "a*c")] {
            assert!(!matches_pattern(text.as_bytes(), pattern.as_bytes()), "{text} {pattern}");
        }
    }
}
