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

/// Returns the main results of a run, and the number of further lines of the same kinds. All warnings are among the
/// lines.
///
/// # Errors
/// If an artifact cannot be read or does not have the content of its kind.
pub fn headlines(run: &RunArtifacts<'_>) -> Result<(Vec<Headline>, usize), ReportError> {
    let mut found: Vec<Headline> = Vec::new();
    for kind in ORDER {
        // Less important kinds are not read.
        if found.len() >= MAX_LINES {
            break;
        }
        let presenters = PRESENTERS.iter().filter(|presenter| presenter.kind() == *kind);
        for presenter in presenters {
            found.extend(presenter.headlines(run)?);
        }
    }
    let mut place = 0;
    let all = found.len();
    found.retain(|line| {
        place += 1;
        place <= MAX_LINES || !line.is_good
    });
    let more = all - found.len();
    Ok((found, more))
}
