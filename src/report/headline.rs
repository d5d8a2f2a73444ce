//! The few lines that matter most of what a run found: its result, and how far that is to be trusted.

use serde::{Deserialize, Serialize};

use super::artifacts::RunArtifacts;
use super::error::ReportError;
use super::kinds::PRESENTERS;

/// Lines that a run ends with of what it found.
const MOST: usize = 2;

/// The kinds whose results matter most, in this order: what others were made for comes first.
const ORDER: &[&str] = &[
    "verify", "table", "evaluate", "design", "train", "audit", "solve", "import",
];

/// A line of what a run found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Headline {
    /// What was found.
    pub text: String,
    /// Whether there is nothing to be warned of.
    pub is_good: bool,
}

impl Headline {
    /// What is as it should be.
    #[must_use]
    pub fn good(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            is_good: true,
        }
    }

    /// What whoever reads it should heed.
    #[must_use]
    pub fn bad(text: impl Into<String>) -> Self {
        Self {
            text: text.into(),
            is_good: false,
        }
    }
}

/// The lines that matter most of a run, and how many more there are of the kinds that these are of. All that is to be heeded is among them.
///
/// # Errors
/// When an artifact cannot be read or does not hold what its kind promises.
pub fn headlines(run: &RunArtifacts<'_>) -> Result<(Vec<Headline>, usize), ReportError> {
    let mut found: Vec<Headline> = Vec::new();
    for kind in ORDER {
        // What is less important is not read.
        if found.len() >= MOST {
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
        place <= MOST || !line.is_good
    });
    let more = all - found.len();
    Ok((found, more))
}
