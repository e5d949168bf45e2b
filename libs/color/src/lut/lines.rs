//! Lines of numbers of text files.

use crate::error::ColorError;
use std::path::Path;

/// The lines of a text, with their numbers.
pub(super) struct Lines<'a> {
    lines: std::iter::Enumerate<std::str::Lines<'a>>,
    path: &'a Path,
    /// The number of the line that was returned last.
    number: usize,
}

impl<'a> Lines<'a> {
    pub(super) fn new(text: &'a str, path: &'a Path) -> Self {
        Self { lines: text.lines().enumerate(), path, number: 0 }
    }

    /// Returns the next line that is neither empty nor a comment.
    pub(super) fn next(&mut self) -> Option<&'a str> {
        for (i, line) in self.lines.by_ref() {
            self.number = i + 1;
            let line = line.trim();
            if !line.is_empty() && !line.starts_with('#') {
                return Some(line);
            }
        }
        None
    }

    /// Returns the next line.
    ///
    /// # Errors
    /// Returns an error at the end of the file.
    pub(super) fn need(&mut self, what: &str) -> Result<&'a str, ColorError> {
        match self.next() {
            Some(line) => Ok(line),
            None => Err(self.malformed(format!("the file ends before {what}"))),
        }
    }

    /// Returns the place of the line that was returned last.
    pub(super) fn place(&self) -> String {
        format!("{}:{}", self.path.display(), self.number)
    }

    pub(super) fn malformed(&self, what: impl Into<String>) -> ColorError {
        ColorError::Malformed { place: self.place(), what: what.into() }
    }

    /// Returns `N` numbers of words, and no more.
    ///
    /// # Errors
    /// Returns an error when there are others.
    pub(super) fn numbers<const N: usize>(&self, words: &str) -> Result<[f32; N], ColorError> {
        let mut found = [0.0; N];
        let mut words = words.split_whitespace();
        for v in &mut found {
            let word = words.next().ok_or_else(|| self.malformed(format!("{N} numbers are needed")))?;
            *v = self.number(word)?;
        }
        match words.next() {
            Some(word) => Err(self.malformed(format!("{N} numbers are needed, and \"{word}\" follows them"))),
            None => Ok(found),
        }
    }

    /// Returns all numbers of words.
    ///
    /// # Errors
    /// Returns an error when a word is not a number.
    pub(super) fn all_numbers(&self, words: &str) -> Result<Vec<f32>, ColorError> {
        words.split_whitespace().map(|word| self.number(word)).collect()
    }

    /// Returns a number, which is finite.
    ///
    /// # Errors
    /// Returns an error for anything else.
    pub(super) fn number(&self, word: &str) -> Result<f32, ColorError> {
        let number = word.parse::<f32>().ok().filter(|v| v.is_finite());
        number.ok_or_else(|| self.malformed(format!("\"{word}\" is not a number")))
    }

    /// Returns a number of entries from 2 to `max`.
    ///
    /// # Errors
    /// Returns an error for anything else.
    pub(super) fn count(&self, word: &str, what: &'static str, max: usize) -> Result<usize, ColorError> {
        let word = word.trim();
        let count: u64 =
            word.parse().map_err(|_| self.malformed(format!("\"{word}\" is not a number of entries")))?;
        if count > max as u64 {
            return Err(ColorError::Limit { place: self.place(), what, asked: count, max: max as u64 });
        }
        if count < 2 {
            return Err(self.malformed(format!("{what}: {count}, and at least 2 are needed")));
        }
        Ok(count as usize)
    }
}
