//! The files of one compilation, and positions in them.

use crate::ir::SourcePos;
use granita_base::Location;
use std::sync::Arc;

/// A position in a file as it was read. Positions are ordered by file, line and column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct Pos {
    /// The index into the files that were read.
    pub(crate) file: u16,
    /// The line, counted from 1.
    pub(crate) line: u32,
    /// The column, counted from 1 in characters.
    pub(crate) column: u32,
}

/// A `#line` directive, which sets the reported position of the line after it.
#[derive(Debug)]
struct Marker {
    after: u32,
    line: u32,
    name: u16,
}

#[derive(Debug)]
struct File {
    name: u16,
    text: Arc<str>,
    markers: Vec<Marker>,
}

/// All files that were read, and the file names and lines of line markers.
#[derive(Debug, Default)]
pub(crate) struct Sources {
    files: Vec<File>,
    names: Vec<Arc<str>>,
}

impl Sources {
    /// Adds a file; `None` when there are too many.
    pub(crate) fn add(&mut self, name: &str, text: &str) -> Option<u16> {
        let index = u16::try_from(self.files.len()).ok()?;
        let name = self.name(name)?;
        self.files.push(File { name, text: text.into(), markers: Vec::new() });
        Some(index)
    }

    fn name(&mut self, name: &str) -> Option<u16> {
        if let Some(found) = self.names.iter().position(|n| **n == *name) {
            return u16::try_from(found).ok();
        }
        let index = u16::try_from(self.names.len()).ok()?;
        self.names.push(name.into());
        Some(index)
    }

    /// From the line after `pos` on, positions are reported as `line` of `name` (or of the same file).
    pub(crate) fn mark(&mut self, pos: Pos, line: u32, name: Option<&str>) {
        let current = self.presumed(pos).file;
        let name = name.and_then(|n| self.name(n)).unwrap_or(current);
        if let Some(file) = self.files.get_mut(pos.file as usize) {
            file.markers.push(Marker { after: pos.line, line, name });
        }
    }

    /// Returns the name of a file as it was opened.
    pub(crate) fn opened(&self, file: u16) -> &str {
        self.files.get(file as usize).map_or("", |f| &self.names[f.name as usize])
    }

    /// Returns the line of `pos`.
    pub(crate) fn line_text(&self, pos: Pos) -> Option<&str> {
        let file = self.files.get(pos.file as usize)?;
        file.text.lines().nth(pos.line.checked_sub(1)? as usize)
    }

    /// Returns the reported position, with line markers applied.
    pub(crate) fn presumed(&self, pos: Pos) -> SourcePos {
        let Some(file) = self.files.get(pos.file as usize) else { return SourcePos::default() };
        match file.markers.iter().rev().find(|m| m.after < pos.line) {
            Some(m) => SourcePos { file: m.name, line: m.line.saturating_add(pos.line - m.after - 1) },
            None => SourcePos { file: file.name, line: pos.line },
        }
    }

    /// Returns a position for messages.
    pub(crate) fn location(&self, pos: Pos) -> Location {
        let at = self.presumed(pos);
        match self.names.get(at.file as usize) {
            Some(name) if pos.line > 0 => Location { file: name.clone(), line: at.line, column: pos.column },
            _ => Location::default(),
        }
    }

    /// Returns the names that [`SourcePos::file`] indexes.
    pub(crate) fn names(&self) -> &[Arc<str>] {
        &self.names
    }
}
