//! The pages of the manual, with their headings, blocks of code and tables.

use granita_tests::repository;
use std::path::{Path, PathBuf};

/// A page.
pub(crate) struct PageText {
    /// The file name, relative to the repository.
    pub(crate) name: String,
    pub(crate) text: String,
}

/// A block of code.
pub(crate) struct Block {
    /// The words after the opening fence.
    pub(crate) info: String,
    pub(crate) text: String,
    /// The line of the opening fence, from 1.
    pub(crate) line: usize,
    /// The heading that it stands under.
    pub(crate) heading: String,
}

/// Returns all pages, sorted by name.
pub(crate) fn pages() -> Vec<PageText> {
    let mut files = Vec::new();
    find(&repository().join("docs"), &mut files);
    files.sort();
    let page = |path: PathBuf| PageText {
        name: path.strip_prefix(repository()).unwrap().to_string_lossy().replace('\\', "/"),
        text: std::fs::read_to_string(&path).unwrap(),
    };
    files.into_iter().map(page).collect()
}

fn find(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            find(&path, files);
        } else if path.extension().is_some_and(|e| e == "md") {
            files.push(path);
        }
    }
}

impl PageText {
    /// Returns the blocks of code between fences.
    pub(crate) fn blocks(&self) -> Vec<Block> {
        let (mut blocks, mut heading, mut open) = (Vec::new(), String::new(), None::<Block>);
        for (number, line) in self.text.lines().enumerate() {
            match (line.trim_start().strip_prefix("```"), open.take()) {
                (Some(_), Some(block)) => blocks.push(block),
                (Some(info), None) => {
                    let (info, heading) = (info.trim().to_owned(), heading.clone());
                    open = Some(Block { info, text: String::new(), line: number + 1, heading });
                }
                (None, Some(mut block)) => {
                    block.text.push_str(line);
                    block.text.push('\n');
                    open = Some(block);
                }
                (None, None) if line.starts_with('#') => {
                    line.trim_start_matches('#').trim().clone_into(&mut heading);
                }
                (None, None) => {}
            }
        }
        assert!(open.is_none(), "{}: a block of code without its end", self.name);
        blocks
    }

    /// Returns the lines outside of blocks of code, with their numbers from 1.
    pub(crate) fn prose(&self) -> Vec<(usize, &str)> {
        let mut inside = false;
        let lines = self.text.lines().enumerate().filter(|(_, line)| {
            let fence = line.trim_start().starts_with("```");
            inside ^= fence;
            !inside && !fence
        });
        lines.map(|(number, line)| (number + 1, line)).collect()
    }

    /// Returns the headings, in order, with their levels.
    pub(crate) fn headings(&self) -> Vec<(usize, &str)> {
        let level = |line: &str| line.len() - line.trim_start_matches('#').len();
        let prose = self.prose().into_iter().map(|(_, line)| line);
        prose
            .filter(|line| line.starts_with('#'))
            .map(|line| (level(line), line.trim_matches('#').trim()))
            .collect()
    }
}
