//! Messages to a page.

/// A message to the page.
#[derive(Debug, PartialEq)]
pub(super) enum Message {
    Text(String),
    Pixels(Vec<u8>),
}
