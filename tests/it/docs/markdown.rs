//! As much of Markdown as documentation needs that is run.

use std::collections::{BTreeMap, BTreeSet};

/// A fenced block.
pub struct Block {
    /// Line of the fence, from 1.
    pub line: usize,
    pub language: String,
    pub text: String,
    directives: BTreeMap<String, String>,
}

impl Block {
    /// What a comment before the block says of it.
    pub fn directive(&self, name: &str) -> Option<&str> {
        self.directives.get(name).map(String::as_str)
    }
}

/// All fenced blocks with the comments just before them.
pub fn blocks(text: &str) -> Vec<Block> {
    let mut found: Vec<Block> = Vec::new();
    let mut directives = BTreeMap::new();
    let mut open = false;
    for (number, line) in text.lines().enumerate() {
        if let Some(language) = line.strip_prefix("```") {
            open = !open;
            if open {
                found.push(Block {
                    line: number + 1,
                    language: language.to_owned(),
                    text: String::new(),
                    directives: std::mem::take(&mut directives),
                });
            }
        } else if let (true, Some(block)) = (open, found.last_mut()) {
            block.text += line;
            block.text.push('\n');
        } else if let Some((name, value)) = comment(line) {
            directives.insert(name.to_owned(), value.to_owned());
        } else if !line.trim().is_empty() {
            directives.clear();
        }
    }
    assert!(!open, "a block without end");
    found
}

fn comment(line: &str) -> Option<(&str, &str)> {
    line.strip_prefix("<!-- ")?.strip_suffix(" -->")?.split_once(": ")
}

/// Where links lead, but for those to other sites.
pub fn links(text: &str) -> Vec<&str> {
    let outside_blocks = text.split("```").step_by(2);
    let targets = outside_blocks.flat_map(|part| part.split("](").skip(1));
    targets
        .filter_map(|rest| rest.split_once(')'))
        .map(|(target, _)| target)
        .filter(|target| !target.contains("://"))
        .collect()
}

/// What stands below the heading of an anchor, up to the next heading of its level; all without an anchor.
pub fn section(text: &str, anchor: &str) -> String {
    if anchor.is_empty() {
        return text.to_owned();
    }
    let (mut own, mut open, mut kept) = (None, false, String::new());
    for line in text.lines() {
        open ^= line.starts_with("```");
        let level = line.chars().take_while(|&c| c == '#').count();
        if level > 0 && !open {
            match own {
                Some(started) if level <= started => break,
                None if anchors(line).contains(anchor) => own = Some(level),
                _ => {}
            }
        }
        if own.is_some() {
            kept.push_str(line);
            kept.push('\n');
        }
    }
    kept
}

/// What links can name after `#`.
pub fn anchors(text: &str) -> BTreeSet<String> {
    let headings = text.lines().filter(|line| line.starts_with('#'));
    let kept = |c: &char| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_');
    let anchor = |title: &str| title.trim().to_lowercase().chars().filter(kept).collect::<String>();
    headings
        .map(|line| anchor(line.trim_start_matches('#')).replace(' ', "-"))
        .collect()
}
