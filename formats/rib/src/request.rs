//! Requests, which consist of a name and its arguments.

use crate::lex::{Lexer, Token};
use std::io;
use std::sync::Arc;

/// The largest number of values of one request.
const MAX_VALUES: usize = 1 << 27;

const UNCLOSED: &str = "a string without its end";

/// One argument.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Arg {
    /// One integer as it is written.
    Int(i32),
    /// One number.
    Float(f32),
    /// One string.
    String(Arc<str>),
    /// An array of integers, or an empty one.
    Ints(Arc<[i32]>),
    /// An array of numbers of which some are not integers.
    Floats(Arc<[f32]>),
    /// An array of strings.
    Strings(Arc<[Arc<str>]>),
}

impl Arg {
    /// Returns the numbers of a single number or an array; `None` for strings.
    pub(crate) fn floats(&self) -> Option<Arc<[f32]>> {
        match self {
            Self::Int(i) => Some([*i as f32].into()),
            Self::Float(f) => Some([*f].into()),
            Self::Ints(v) => Some(v.iter().map(|i| *i as f32).collect()),
            Self::Floats(v) => Some(v.clone()),
            Self::String(_) | Self::Strings(_) => None,
        }
    }

    /// Returns the integers of a single number or an array; `None` when a number has a fraction.
    pub(crate) fn ints(&self) -> Option<Arc<[i32]>> {
        let whole = |f: f32| (f.fract() == 0.0 && f.abs() < 2.0e9).then_some(f as i32);
        match self {
            Self::Int(i) => Some([*i].into()),
            Self::Float(f) => Some([whole(*f)?].into()),
            Self::Ints(v) => Some(v.clone()),
            Self::Floats(v) => v.iter().map(|f| whole(*f)).collect(),
            Self::String(_) | Self::Strings(_) => None,
        }
    }

    /// Returns the strings of a single string or an array; `None` for numbers.
    pub(crate) fn strings(&self) -> Option<Arc<[Arc<str>]>> {
        match self {
            Self::String(s) => Some([s.clone()].into()),
            Self::Strings(v) => Some(v.clone()),
            Self::Ints(v) if v.is_empty() => Some([].into()),
            _ => None,
        }
    }

    /// Returns the kind of the argument, for messages.
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::Int(_) => "an integer",
            Self::Float(_) => "a number",
            Self::String(_) => "a string",
            Self::Ints(_) | Self::Floats(_) => "an array of numbers",
            Self::Strings(_) => "an array of strings",
        }
    }
}

/// A request.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Request {
    /// Its name.
    pub(crate) name: String,
    /// All arguments in order.
    pub(crate) args: Vec<Arg>,
    /// The line in which it begins.
    pub(crate) line: u32,
    /// The first error in its text. The rest of the arguments is kept.
    pub(crate) mistake: Option<String>,
}

/// Combines tokens to requests.
pub(crate) struct Requests {
    lexer: Lexer,
    /// The name of the next request and its line.
    next: Option<(String, u32)>,
    started: bool,
}

/// The array that is being read.
enum Array {
    Empty,
    Ints(Vec<i32>),
    Floats(Vec<f32>),
    Strings(Vec<Arc<str>>),
}

impl Array {
    fn push(&mut self, token: &Token) -> bool {
        match (&mut *self, token) {
            (Self::Empty, Token::Int(i)) => *self = Self::Ints(vec![*i]),
            (Self::Empty, Token::Float(f)) => *self = Self::Floats(vec![*f]),
            (Self::Empty, Token::String(s)) => *self = Self::Strings(vec![s.as_str().into()]),
            (Self::Ints(v), Token::Int(i)) => v.push(*i),
            (Self::Ints(v), Token::Float(f)) => {
                let mut floats: Vec<f32> = v.iter().map(|i| *i as f32).collect();
                floats.push(*f);
                *self = Self::Floats(floats);
            }
            (Self::Floats(v), Token::Int(i)) => v.push(*i as f32),
            (Self::Floats(v), Token::Float(f)) => v.push(*f),
            (Self::Strings(v), Token::String(s)) => v.push(s.as_str().into()),
            _ => return false,
        }
        true
    }

    fn finish(self) -> Arg {
        match self {
            Self::Empty => Arg::Ints([].into()),
            Self::Ints(v) => Arg::Ints(v.into()),
            Self::Floats(v) => Arg::Floats(v.into()),
            Self::Strings(v) => Arg::Strings(v.into()),
        }
    }
}

impl Requests {
    pub(crate) fn new(lexer: Lexer) -> Self {
        Self { lexer, next: None, started: false }
    }

    /// Returns the current line.
    pub(crate) fn line(&self) -> u32 {
        self.lexer.line()
    }

    /// Reads the next request. Returns `None` at the end. Arguments before the first name form a request without a
    /// name.
    pub(crate) fn next(&mut self) -> io::Result<Option<Request>> {
        let (name, line) = match self.next.take() {
            Some(next) => next,
            None if !self.started => (String::new(), 1),
            None => return Ok(None),
        };
        self.started = true;
        let mut request = Request { name, args: Vec::new(), line, mistake: None };
        let mut values = 0;
        loop {
            let token = self.lexer.token()?;
            values += 1;
            if values > MAX_VALUES {
                return Err(io::Error::other(format!("a request of more than {MAX_VALUES} values")));
            }
            let arg = match token {
                Token::End => break,
                Token::Word(word) => {
                    self.next = Some((word, self.lexer.line()));
                    break;
                }
                Token::Int(i) => Arg::Int(i),
                Token::Float(f) => Arg::Float(f),
                Token::String(s) => Arg::String(s.into()),
                Token::Floats(n) => Arg::Floats(self.floats(n, &mut values)?.into()),
                Token::Open => match self.array(&mut request, &mut values)? {
                    Some(array) => array,
                    None => break,
                },
                Token::Close => {
                    request.mistake.get_or_insert_with(|| "\"]\" without \"[\"".to_owned());
                    continue;
                }
                Token::Garbage(what) => {
                    request.mistake.get_or_insert_with(|| format!("unexpected {what}"));
                    continue;
                }
                Token::Unclosed => {
                    request.mistake.get_or_insert_with(|| UNCLOSED.to_owned());
                    continue;
                }
            };
            request.args.push(arg);
        }
        if request.name.is_empty() && request.args.is_empty() && request.mistake.is_none() {
            return self.next();
        }
        Ok(Some(request))
    }

    fn floats(&mut self, n: u32, values: &mut usize) -> io::Result<Vec<f32>> {
        *values += n as usize;
        if *values > MAX_VALUES {
            return Err(io::Error::other(format!("a request of more than {MAX_VALUES} values")));
        }
        let mut list = Vec::with_capacity((n as usize).min(1 << 12));
        for _ in 0..n {
            list.push(self.lexer.float()?);
        }
        Ok(list)
    }

    /// Reads the rest of an array. Returns `None` when the next request begins before the array ends.
    fn array(&mut self, request: &mut Request, values: &mut usize) -> io::Result<Option<Arg>> {
        let mut array = Array::Empty;
        let mut wrong = |what: String| _ = request.mistake.get_or_insert(what);
        loop {
            let token = self.lexer.token()?;
            *values += 1;
            if *values > MAX_VALUES {
                return Err(io::Error::other(format!("a request of more than {MAX_VALUES} values")));
            }
            match token {
                Token::Close => return Ok(Some(array.finish())),
                Token::End | Token::Word(_) => {
                    wrong("\"[\" without \"]\"".to_owned());
                    if let Token::Word(word) = token {
                        self.next = Some((word, self.lexer.line()));
                    }
                    return Ok(None);
                }
                Token::Floats(n) => {
                    for float in self.floats(n, values)? {
                        array.push(&Token::Float(float));
                    }
                }
                Token::Open => wrong("\"[\" inside of \"[\"".to_owned()),
                Token::Garbage(what) => wrong(format!("unexpected {what}")),
                Token::Unclosed => wrong(UNCLOSED.to_owned()),
                value => {
                    if !array.push(&value) {
                        wrong("numbers and strings in one array".to_owned());
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn requests(text: &str) -> Vec<Request> {
        let mut reader = Requests::new(Lexer::new(Box::new(io::Cursor::new(text.as_bytes().to_vec()))));
        std::iter::from_fn(|| reader.next().unwrap()).collect()
    }

    #[test]
    fn requests_carry_their_arguments_and_line() {
        let all = requests("# first\nSphere 1 -1 1.5 360\nColor [1 0 .5] \"a\" [ \"b\" \"c\" ]\nWorldEnd");
        assert_eq!(all.len(), 3);
        assert_eq!((all[0].name.as_str(), all[0].line, all[0].args.len()), ("Sphere", 2, 4));
        assert_eq!(all[1].args[0].floats().unwrap()[..], [1.0, 0.0, 0.5]);
        assert_eq!(all[1].args[2].strings().unwrap().len(), 2);
        assert!(all.iter().all(|r| r.mistake.is_none()));
        assert_eq!(all[0].args[0].ints().unwrap()[..], [1]);
        assert!(all[0].args[2].ints().is_none());
    }

    #[test]
    fn malformed_arguments_spoil_only_their_request() {
        let all = requests("3 4 Color [1 2 Sphere 1 ] 2 @ 3\nPoints [1 \"a\"]\nEnd");
        let told: Vec<_> = all.iter().map(|r| (r.name.as_str(), r.mistake.is_some())).collect();
        assert_eq!(told, [("", false), ("Color", true), ("Sphere", true), ("Points", true), ("End", false)]);
        assert_eq!(all[2].args.len(), 3);
        assert!(requests("").is_empty() && requests("# nothing").is_empty());
    }
}
