//! Secrets that a coordinator and its workers share.

use snow::params::HashChoice;
use snow::resolvers::{CryptoResolver, DefaultResolver};
use std::io;

/// The least number of characters of a secret.
const LEAST_SECRET: usize = 16;

/// The key of a secret, for connections.
#[derive(Clone, PartialEq, Eq)]
pub struct Secret([u8; 32]);

impl std::fmt::Debug for Secret {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Secret")
    }
}

impl Secret {
    /// Returns the secret of a text, whose spaces at both ends do not count.
    ///
    /// # Errors
    /// Returns the reason why the text is none.
    pub fn new(text: &str) -> Result<Self, String> {
        let text = text.trim();
        if text.chars().count() < LEAST_SECRET {
            return Err(format!("a secret has at least {LEAST_SECRET} characters"));
        }
        let Some(mut hash) = DefaultResolver.resolve_hash(&HashChoice::Blake2s) else {
            return Err("the hash of secrets is missing".to_owned());
        };
        hash.input(b"granita worker ");
        hash.input(text.as_bytes());
        let mut key = [0; 32];
        hash.result(&mut key);
        Ok(Self(key))
    }

    /// Returns the bytes of the key.
    pub(crate) fn key(&self) -> &[u8; 32] {
        &self.0
    }

    /// Returns the text of a new secret: 64 hexadecimal digits of the random numbers of the system.
    ///
    /// # Errors
    /// Returns an error when the system has no random numbers.
    pub fn random_text() -> io::Result<String> {
        let mut bytes = [0; 32];
        getrandom::fill(&mut bytes).map_err(|error| io::Error::other(error.to_string()))?;
        Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
    }
}

/// A secret that a coordinator and its workers share, and its text, which is passed to the commands that start workers.
#[derive(Clone)]
pub struct NetSecret {
    pub(crate) text: String,
    pub(crate) key: Secret,
}

impl std::fmt::Debug for NetSecret {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("NetSecret")
    }
}

impl NetSecret {
    /// The environment variable with the secret of workers that connect to their coordinator.
    pub const VARIABLE: &str = "GRANITA_NET_SECRET";

    /// Returns the secret of a text of at least 16 characters. Spaces at its ends do not count.
    ///
    /// # Errors
    /// Returns the reason why the text is none.
    pub fn new(text: &str) -> Result<Self, String> {
        Ok(Self { text: text.trim().to_owned(), key: Secret::new(text)? })
    }

    /// Returns a new secret of the random numbers of the system.
    ///
    /// # Errors
    /// Returns an error when the system has none.
    pub fn random() -> Result<Self, String> {
        Self::new(&Secret::random_text().map_err(|error| error.to_string())?)
    }

    /// Returns the text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Returns the key that connections need.
    pub fn key(&self) -> &Secret {
        &self.key
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn secrets_are_not_short_and_are_not_printed() {
        assert_eq!(Secret::new("  short \n").unwrap_err(), "a secret has at least 16 characters");
        let (one, other) = (Secret::random_text().unwrap(), Secret::random_text().unwrap());
        assert!(one.len() == 64 && one != other);
        assert_eq!(format!("{:?}", Secret::new(&one).unwrap()), "Secret");
    }
}
