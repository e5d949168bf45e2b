//! The names in parts of a source that the parser skipped after errors.
//!
//! The rest of the source is checked. What it says about such names may be right with the skipped part, so that
//! messages about them would mislead.

use crate::token::{Token, TokenKind, is_keyword};
use std::collections::BTreeSet;
use std::sync::Arc;

/// The names in skipped parts.
#[derive(Debug, Default)]
pub(crate) struct Lost {
    declared: BTreeSet<Arc<str>>,
    mentioned: BTreeSet<Arc<str>>,
    /// True when braces are missing or too many, so that the scopes of variables are not known.
    braces: bool,
    /// True when skipped text is not tokens, so that the uses of variables are not known.
    text: bool,
}

impl Lost {
    /// Adds the names in skipped tokens. A name counts as declared when a type or another name is in front of it, as in
    /// `colour x`, or when it follows such a name in a list.
    pub(crate) fn add(&mut self, tokens: &[Token]) {
        let mut before: Option<&TokenKind> = None;
        let (mut depth, mut list) = (0_i32, None);
        for token in tokens {
            match &token.kind {
                TokenKind::Word(word) if !is_keyword(word) => {
                    let is_declared = match before {
                        Some(TokenKind::Word(type_name)) => !is_statement(type_name),
                        Some(TokenKind::Mark(",")) => list == Some(depth),
                        _ => false,
                    };
                    if is_declared {
                        list = Some(depth);
                        self.declared.insert(word.clone());
                    }
                    self.mentioned.insert(word.clone());
                }
                TokenKind::Mark("(" | "[" | "{") => depth += 1,
                TokenKind::Mark(")" | "]" | "}") => depth -= 1,
                TokenKind::Mark(";") => list = None,
                TokenKind::Bad => self.text = true,
                _ => (),
            }
            before = Some(&token.kind);
        }
    }

    /// Records that braces are missing or too many.
    pub(crate) fn lose_braces(&mut self) {
        self.braces = true;
    }

    /// True when the scopes of variables are not known.
    pub(crate) fn has_lost_braces(&self) -> bool {
        self.braces
    }

    /// True when skipped text may use any variable.
    pub(crate) fn has_lost_text(&self) -> bool {
        self.text
    }

    /// Adds a name that a skipped part declares.
    pub(crate) fn declare(&mut self, name: &Arc<str>) {
        self.declared.insert(name.clone());
    }

    /// True when a skipped part may declare the name, so that its type is not known.
    pub(crate) fn declares(&self, name: &str) -> bool {
        self.declared.contains(name)
    }

    /// True when a skipped part may declare, read or write the variable.
    pub(crate) fn mentions(&self, name: &str) -> bool {
        self.braces || self.mentioned.contains(name) || self.declares(name)
    }
}

/// True for keywords that a name follows without being declared.
fn is_statement(word: &str) -> bool {
    matches!(word, "return" | "else" | "do" | "if" | "while" | "for" | "emit" | "lights" | "trace")
}
