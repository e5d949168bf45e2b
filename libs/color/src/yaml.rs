//! YAML as a tree whose nodes know their lines.

use crate::error::ColorError;
use saphyr_parser::{Event, Parser};
use std::collections::BTreeMap;

/// The number of nodes of a file, those behind aliases counted each time.
const MAX_NODES: usize = 1 << 20;
/// The depth of nested lists and maps.
const MAX_DEPTH: usize = 64;

/// The content of a node.
#[derive(Clone, Debug)]
pub(crate) enum Content {
    Scalar(String),
    List(Vec<Node>),
    Map(Vec<(String, Node)>),
}

/// A node.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    /// The line, from 1.
    pub(crate) line: usize,
    /// The name of its tag, without `!<` and `>`; empty where there is none.
    pub(crate) tag: String,
    pub(crate) content: Content,
    /// The number of nodes in it.
    size: usize,
}

impl Node {
    /// Returns the text of a scalar.
    pub(crate) fn text(&self) -> Option<&str> {
        match &self.content {
            Content::Scalar(text) => Some(text),
            _ => None,
        }
    }

    /// Returns the nodes of a list.
    pub(crate) fn list(&self) -> Option<&[Self]> {
        match &self.content {
            Content::List(nodes) => Some(nodes),
            _ => None,
        }
    }

    /// Returns the entries of a map.
    pub(crate) fn map(&self) -> Option<&[(String, Self)]> {
        match &self.content {
            Content::Map(entries) => Some(entries),
            _ => None,
        }
    }

    /// Returns the value of a key.
    pub(crate) fn get(&self, key: &str) -> Option<&Self> {
        self.map()?.iter().find(|(name, _)| name == key).map(|(_, node)| node)
    }
}

/// Parses the first document of a text. `place` names it in errors.
pub(crate) fn parse(text: &str, place: &str) -> Result<Node, ColorError> {
    let mut builder =
        Builder { parser: Parser::new_from_str(text), place, anchors: BTreeMap::new(), nodes: 0 };
    loop {
        let (event, line) = builder.next()?;
        match event {
            Event::StreamStart | Event::DocumentStart(_) | Event::Nothing => {}
            Event::StreamEnd | Event::DocumentEnd => {
                return Err(builder.malformed(line, "the file is empty"));
            }
            other => return builder.node(other, line, 0),
        }
    }
}

struct Builder<'a, P: Iterator> {
    parser: P,
    place: &'a str,
    anchors: BTreeMap<usize, Node>,
    nodes: usize,
}

impl<'a, 'b, P> Builder<'a, P>
where
    P: Iterator<Item = Result<(Event<'b>, saphyr_parser::Span), saphyr_parser::ScanError>>,
{
    fn malformed(&self, line: usize, what: &str) -> ColorError {
        ColorError::Malformed { place: format!("{}:{line}", self.place), what: what.to_owned() }
    }

    fn next(&mut self) -> Result<(Event<'b>, usize), ColorError> {
        match self.parser.next() {
            Some(Ok((event, span))) => Ok((event, span.start.line())),
            Some(Err(error)) => Err(self.malformed(error.marker().line(), error.info())),
            None => Err(self.malformed(0, "the file ends too early")),
        }
    }

    /// Returns the node that an event begins.
    fn node(&mut self, event: Event<'b>, line: usize, depth: usize) -> Result<Node, ColorError> {
        if depth > MAX_DEPTH {
            let (asked, max) = (depth as u64, MAX_DEPTH as u64);
            return Err(ColorError::Limit {
                place: format!("{}:{line}", self.place),
                what: "nested lists",
                asked,
                max,
            });
        }
        let name = |tag: Option<std::borrow::Cow<'b, saphyr_parser::Tag>>| {
            tag.map_or_else(String::new, |tag| tag.suffix.trim_start_matches('!').to_owned())
        };
        let before = self.nodes;
        self.count(1, line)?;
        let (anchor, tag, content) = match event {
            Event::Alias(id) => {
                let Some(node) = self.anchors.get(&id).cloned() else {
                    return Err(self.malformed(line, "an alias without its anchor"));
                };
                self.count(node.size, line)?;
                return Ok(Node { line, ..node });
            }
            Event::Scalar(text, _, anchor, tag) => (anchor, name(tag), Content::Scalar(text.into_owned())),
            Event::SequenceStart(anchor, tag) => {
                let mut nodes = Vec::new();
                loop {
                    match self.next()? {
                        (Event::SequenceEnd, _) => break,
                        (event, line) => nodes.push(self.node(event, line, depth + 1)?),
                    }
                }
                (anchor, name(tag), Content::List(nodes))
            }
            Event::MappingStart(anchor, tag) => {
                let mut entries = Vec::new();
                loop {
                    let (event, line) = self.next()?;
                    if matches!(event, Event::MappingEnd) {
                        break;
                    }
                    let key = self.node(event, line, depth + 1)?;
                    let Content::Scalar(key) = key.content else {
                        return Err(self.malformed(line, "a key that is not a text"));
                    };
                    let (event, line) = self.next()?;
                    entries.push((key, self.node(event, line, depth + 1)?));
                }
                (anchor, name(tag), Content::Map(entries))
            }
            _ => return Err(self.malformed(line, "the file ends within a list")),
        };
        let node = Node { line, tag, content, size: self.nodes - before };
        if anchor > 0 {
            self.anchors.insert(anchor, node.clone());
        }
        Ok(node)
    }

    fn count(&mut self, more: usize, line: usize) -> Result<(), ColorError> {
        self.nodes += more;
        if self.nodes > MAX_NODES {
            let (asked, max) = (self.nodes as u64, MAX_NODES as u64);
            return Err(ColorError::Limit {
                place: format!("{}:{line}", self.place),
                what: "values",
                asked,
                max,
            });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_have_tags_and_lines() {
        let text = "a: 1\nb:\n  - !<View> {name: Raw, c: <X>}\n  - !<Views> [x, 'y z']\nc: |\n  l1\n  l2\n";
        let root = parse(text, "f").unwrap();
        assert_eq!(root.get("a").unwrap().text(), Some("1"));
        let b = root.get("b").unwrap().list().unwrap();
        assert_eq!((&*b[0].tag, b[0].line, b[0].get("c").unwrap().text()), ("View", 3, Some("<X>")));
        assert_eq!(b[1].list().unwrap()[1].text(), Some("y z"));
        assert_eq!(root.get("c").unwrap().text(), Some("l1\nl2\n"));
        assert!(root.get("d").is_none() && root.list().is_none() && b[0].text().is_none());
    }

    #[test]
    fn anchors_are_followed_within_limits() {
        let root = parse("a: &x [1, 2]\nb: *x\n", "f").unwrap();
        assert_eq!(root.get("b").unwrap().list().unwrap().len(), 2);
        let mut bomb = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n".to_owned();
        for i in 1..9 {
            let item = format!("*a{}", i - 1);
            bomb.push_str(&format!("a{i}: &a{i} [{}]\n", [&*item; 10].join(", ")));
        }
        assert!(parse(&bomb, "f").unwrap_err().to_string().contains("values: "));
    }

    #[test]
    fn damaged_files_name_the_line() {
        assert_eq!(parse("", "f").unwrap_err().to_string(), "f:1: the file is empty");
        assert!(parse("a: [1, 2\n", "f").unwrap_err().to_string().starts_with("f:"));
        assert!(parse("a: *x\n", "f").unwrap_err().to_string().starts_with("f:1: "));
        assert!(parse("[a]: b\n", "f").unwrap_err().to_string().contains("key"));
        let deep = "[".repeat(200) + &"]".repeat(200);
        assert!(parse(&deep, "f").unwrap_err().to_string().contains("nested lists"));
    }
}
