//! Writes printed output into the blocks of a page. Lines that still agree keep their text, and `…` keeps its place.

use super::markdown::Block;
use crate::common::compare::{is_empty, is_gap, shows, similarity};

/// Cost of a line that only one side has; a replaced line costs less the more words it keeps.
const ALONE: f64 = 0.6;

/// How a line of the new block comes about.
#[derive(Clone, Copy)]
enum Step {
    Keep,
    Replace,
    Remove,
    Insert,
    /// The gap hides a printed line.
    Hide,
}

/// The shown block with as few changes as make it show what was printed.
pub fn merged(shown: &str, printed: &str) -> String {
    let shown: Vec<&str> = shown.lines().collect();
    let printed: Vec<&str> = printed.lines().collect();
    let mut new = String::new();
    let (mut i, mut j) = (0, 0);
    let plan = plan(&shown, &printed);
    while let Some(step) = plan[i][j].1 {
        match step {
            Step::Keep => {
                new += shown[i];
                new.push('\n');
            }
            Step::Replace => {
                new += &replaced(shown[i], printed[j]);
                new.push('\n');
            }
            Step::Insert => {
                new += printed[j].trim_end();
                new.push('\n');
            }
            Step::Remove | Step::Hide => {}
        }
        let is_alone = i < shown.len() && (is_gap(shown[i]) || is_empty(shown[i]));
        i += usize::from(matches!(step, Step::Keep | Step::Replace | Step::Remove));
        j += usize::from(match step {
            Step::Keep => !is_alone,
            Step::Replace | Step::Insert | Step::Hide => true,
            Step::Remove => false,
        });
    }
    new
}

/// The least cost of bringing the rest of the block to the rest of the output, and the first step of it, for each pair
/// of rests.
fn plan(shown: &[&str], printed: &[&str]) -> Vec<Vec<(f64, Option<Step>)>> {
    let mut plan = vec![vec![(0.0, None); printed.len() + 1]; shown.len() + 1];
    for i in (0..=shown.len()).rev() {
        for j in (0..=printed.len()).rev() {
            let mut best: (f64, Option<Step>) = (f64::INFINITY, None);
            let mut consider = |cost: f64, step| {
                if cost < best.0 {
                    best = (cost, Some(step));
                }
            };
            let line = shown.get(i);
            if let Some(line) = line {
                if is_gap(line) || is_empty(line) {
                    consider(plan[i + 1][j].0, Step::Keep);
                } else if j < printed.len() {
                    match shows(line, printed[j]) {
                        true => consider(plan[i + 1][j + 1].0, Step::Keep),
                        false => {
                            let cost = 1.0 - similarity(line, printed[j]);
                            consider(cost + plan[i + 1][j + 1].0, Step::Replace);
                        }
                    }
                }
                consider(ALONE + plan[i + 1][j].0, Step::Remove);
            }
            if j < printed.len() {
                let is_free = is_empty(printed[j]) || line.is_some_and(|line| is_gap(line));
                match is_free {
                    true => consider(plan[i][j + 1].0, Step::Hide),
                    false => consider(ALONE + plan[i][j + 1].0, Step::Insert),
                }
            }
            if i < shown.len() || j < printed.len() {
                plan[i][j] = best;
            }
        }
    }
    plan
}

/// A printed line in the place of a shown one; if that was cut by `…`, this is cut after as many words.
fn replaced(shown: &str, printed: &str) -> String {
    let Some(start) = shown.strip_suffix('…') else {
        return printed.trim_end().to_owned();
    };
    let count = start.split_whitespace().count();
    let indent = printed.len() - printed.trim_start().len();
    let words: Vec<&str> = printed.split_whitespace().collect();
    match words.len() > count {
        true => format!("{}{} …", &printed[..indent], words[..count].join(" ")),
        false => printed.trim_end().to_owned(),
    }
}

/// A page with the text of some blocks replaced.
pub fn with_blocks(page: &str, replaced: &[(Block, String)]) -> String {
    let mut lines = page.lines().enumerate();
    let mut new = String::new();
    while let Some((number, line)) = lines.next() {
        new += line;
        new.push('\n');
        // A block counts the line of its fence from 1.
        if let Some((block, text)) = replaced.iter().find(|(block, _)| block.line == number + 1) {
            let skipped = block.text.lines().count();
            if skipped > 0 {
                lines.nth(skipped - 1);
            }
            new += text;
        }
    }
    new
}

#[test]
fn a_block_takes_over_new_wording_and_keeps_its_gaps() {
    let shown =
        "one stage is at work: 3 of 5\n…\nsolved   built   1.66 s   a0fee3aeb495\nthe end of it is here, as …\n";
    let printed = "1 running stage: 3 of 5\nsmall  built  0.20 s  123456789abc\n\nsolved  built  2.10 s  0123456789ab\n\
                   ended here, as the table above shows now\n";
    let new = merged(shown, printed);
    assert_eq!(
        new,
        "1 running stage: 3 of 5\n…\nsolved   built   1.66 s   a0fee3aeb495\nended here, as the table above shows …\n"
    );
    let page = format!("# Page\n```text\n{shown}```\nend\n");
    let block = super::blocks(&page).remove(0);
    let updated = with_blocks(&page, &[(block, new.clone())]);
    assert_eq!(updated, format!("# Page\n```text\n{new}```\nend\n"));
}
