//! Suggestions for misspelled words.

/// The length of the longest word, in bytes, that is compared with others. The cost of comparing is the product of
/// the lengths.
const LONGEST: usize = 64;

/// Returns the candidate most similar to `word`, if one is near enough; never the word itself.
///
/// A candidate is near when at most a third of its letters (at least one, at most three), and not all of them, are
/// inserted, removed, replaced or exchanged with their neighbour. Case is ignored. Of equally near candidates the
/// first in alphabetical order is returned.
pub fn suggestion<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    if word.len() > LONGEST {
        return None;
    }
    let allowed = (word.chars().count() / 3).clamp(1, 3);
    let word_in_lower_case = word.to_ascii_lowercase();
    candidates
        .into_iter()
        .filter(|candidate| *candidate != word && candidate.len() <= 2 * LONGEST)
        .map(|candidate| {
            (strsim::osa_distance(&word_in_lower_case, &candidate.to_ascii_lowercase()), candidate)
        })
        .filter(|(distance, candidate)| *distance <= allowed && *distance < candidate.chars().count())
        .min()
        .map(|(_, candidate)| candidate)
}

#[cfg(test)]
mod tests {
    use super::suggestion;

    #[test]
    fn similar_words_are_suggested() {
        let names = || ["resolution", "fov", "opacity", "near", "far"];
        assert_eq!(suggestion("resolutoin", names()), Some("resolution"));
        assert_eq!(suggestion("FOV", names()), Some("fov"));
        assert_eq!(suggestion("opacty", names()), Some("opacity"));
        assert_eq!(suggestion("quite different", names()), None);
        // A word is not suggested for itself, because it was rejected for another reason.
        assert_eq!(suggestion("world", ["word", "world"]), Some("word"));
        assert_eq!(suggestion("worl", ["world", "word"]), Some("word"));
        assert_eq!(suggestion("b", ["a"]), None);
        assert_eq!(suggestion("", ["a"]), None);
        assert_eq!(suggestion(&"x".repeat(10_000), names()), None);
    }
}
