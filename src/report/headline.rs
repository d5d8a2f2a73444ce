//! The main results of a run: the lines that it prints at its end.

use super::artifacts::RunArtifacts;
use super::error::ReportError;
use super::kinds::PRESENTERS;
use super::presenter::Headline;

/// Lines that a run prints.
const MAX_LINES: usize = 2;

/// The kinds in the order of their importance: results come before what they were computed from.
const ORDER: &[&str] = &[
    "verify", "yield", "table", "evaluate", "design", "train", "compare", "fit", "audit", "solve", "import",
];

/// The kind whose first line is always printed: how many devices succeed is another question than how far one moves.
const ALWAYS: &str = "yield";

/// The kind whose warnings are always printed: errors in a dataset reach all that is made of it.
const CHECKS: &str = "audit";

/// Returns the main results of a run, and the number of further lines of the same kinds. All warnings are among the
/// lines.
///
/// # Errors
/// If an artifact cannot be read or does not have the content of its kind.
pub fn headlines(run: &RunArtifacts<'_>) -> Result<(Vec<Headline>, usize), ReportError> {
    let (mut all, mut kept) = (0, Vec::new());
    for kind in ORDER {
        // Less important kinds are not read.
        let is_full = all >= MAX_LINES;
        if is_full && ![ALWAYS, CHECKS].contains(kind) {
            continue;
        }
        let presenters = PRESENTERS.iter().filter(|presenter| presenter.kind() == *kind);
        let lines: Result<Vec<_>, _> = presenters.map(|presenter| presenter.headlines(run)).collect();
        let lines = lines?.into_iter().flatten();
        // What a check did not find is no result that is left out.
        let lines = lines.filter(|line| !is_full || *kind != CHECKS || !line.is_good);
        for (place, line) in lines.enumerate() {
            let is_first = place == 0 && *kind == ALWAYS;
            all += 1;
            if all <= MAX_LINES || is_first || !line.is_good {
                kept.push(line);
            }
        }
    }
    let more = all - kept.len();
    Ok((kept, more))
}
