//! Constant values, which are numbers, strings and sequences of them.

use std::sync::Arc;

/// A value written in the scene file.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    None,
    Int(i64),
    Float(f64),
    Str(Arc<str>),
    Seq(Seq),
}

/// A sequence without nesting. The elements of nested sequences are joined.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Seq {
    Ints(Vec<i32>),
    Floats(Vec<f32>),
    Strings(Vec<Arc<str>>),
}

impl Default for Seq {
    fn default() -> Self {
        Self::Ints(Vec::new())
    }
}

impl Seq {
    pub(crate) fn len(&self) -> usize {
        match self {
            Self::Ints(v) => v.len(),
            Self::Floats(v) => v.len(),
            Self::Strings(v) => v.len(),
        }
    }

    /// Appends an integer. One that does not fit into 32 bits turns the sequence into floats.
    pub(crate) fn push_int(&mut self, i: i64) -> Result<(), &'static str> {
        match (&mut *self, i32::try_from(i)) {
            (Self::Ints(v), Ok(i)) => v.push(i),
            (Self::Floats(v), _) => v.push(i as f32),
            (Self::Ints(_), Err(_)) => return self.push_float(i as f64),
            (Self::Strings(_), _) => return Err("a sequence mixes strings and numbers"),
        }
        Ok(())
    }

    /// Appends a float. Integers before it become floats.
    pub(crate) fn push_float(&mut self, f: f64) -> Result<(), &'static str> {
        match self {
            Self::Floats(v) => v.push(f as f32),
            Self::Ints(v) => {
                let mut floats: Vec<f32> = Vec::with_capacity(v.len() + 1);
                floats.extend(v.iter().map(|&i| i as f32));
                floats.push(f as f32);
                *self = Self::Floats(floats);
            }
            Self::Strings(_) => return Err("a sequence mixes strings and numbers"),
        }
        Ok(())
    }

    fn push_str(&mut self, s: Arc<str>) -> Result<(), &'static str> {
        if self.len() == 0 {
            *self = Self::Strings(vec![s]);
            return Ok(());
        }
        match self {
            Self::Strings(v) => {
                v.push(s);
                Ok(())
            }
            _ => Err("a sequence mixes strings and numbers"),
        }
    }

    /// Appends a value. The elements of a sequence are appended.
    pub(crate) fn push(&mut self, value: Value) -> Result<(), &'static str> {
        match value {
            Value::None => Err("None inside a sequence"),
            Value::Int(i) => self.push_int(i),
            Value::Float(f) => self.push_float(f),
            Value::Str(s) => self.push_str(s),
            Value::Seq(other) => self.join(other),
        }
    }

    fn join(&mut self, other: Self) -> Result<(), &'static str> {
        if self.len() == 0 {
            *self = other;
            return Ok(());
        }
        match (&mut *self, other) {
            (Self::Ints(a), Self::Ints(b)) => a.extend(b),
            (Self::Floats(a), Self::Floats(b)) => a.extend(b),
            (Self::Floats(a), Self::Ints(b)) => a.extend(b.iter().map(|&i| i as f32)),
            (Self::Ints(a), Self::Floats(b)) => {
                let mut all: Vec<f32> = a.iter().map(|&i| i as f32).collect();
                all.extend(b);
                *self = Self::Floats(all);
            }
            (Self::Strings(a), Self::Strings(b)) => a.extend(b),
            (_, other) if other.len() == 0 => {}
            _ => return Err("a sequence mixes strings and numbers"),
        }
        Ok(())
    }

    /// Returns `self` repeated, like `sequence * n` in Python.
    pub(crate) fn repeat(&self, n: i64, limit: usize) -> Result<Self, &'static str> {
        let n = n.max(0) as usize;
        if self.len().checked_mul(n).is_none_or(|total| total > limit) {
            return Err("a repeated sequence is too long");
        }
        Ok(match self {
            Self::Ints(v) => Self::Ints(v.repeat(n)),
            Self::Floats(v) => Self::Floats(v.repeat(n)),
            Self::Strings(v) => Self::Strings(v.iter().cycle().take(v.len() * n).cloned().collect()),
        })
    }
}
