//! The names of looks.

use super::{Config, misuse, same};
use crate::error::ColorError;
use crate::model::Look;

/// Returns the looks of a text, and true for those that are applied backwards. Options are separated by `|`, and the
/// first one whose looks all exist is taken. Looks of an option are separated by commas or colons; `-` inverts one.
pub(super) fn parse<'a>(config: &'a Config, text: &str) -> Result<Vec<(&'a Look, bool)>, ColorError> {
    let mut missing = None;
    for option in text.split('|') {
        let mut found = Vec::new();
        let mut complete = true;
        for word in option.split([',', ':']).map(str::trim).filter(|word| !word.is_empty()) {
            let (name, inverse) = match word.strip_prefix('-') {
                Some(name) => (name.trim(), true),
                None => (word.strip_prefix('+').unwrap_or(word).trim(), false),
            };
            match config.model.looks.iter().find(|look| same(&look.name, name)) {
                Some(look) => found.push((look, inverse)),
                None => {
                    complete = false;
                    missing.get_or_insert_with(|| name.to_owned());
                }
            }
        }
        if complete {
            return Ok(found);
        }
    }
    misuse(format!("{} has no look \"{}\"", config.place(), missing.unwrap_or_default()))
}
