//! What an audit has found.

use serde::{Deserialize, Serialize};

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The dataset is wrong: nothing should be learned from it.
    Error,
    /// The dataset can be used by somebody who knows.
    Warning,
}

impl Severity {
    /// The word that stands in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Warning => "warning",
        }
    }
}

/// Examples that are named one by one; of more there is only the count.
pub const EXAMPLES: usize = 20;

/// One thing that is wrong, with the rows where it shows.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// Which check found it.
    pub check: String,
    /// How bad it is.
    pub severity: Severity,
    /// In how many rows; 1 where it is the dataset as a whole.
    pub count: u64,
    /// The first rows, by their numbers in the dataset; none where it is the dataset as a whole.
    pub examples: Vec<u64>,
    /// What is wrong, for people.
    pub message: String,
}

impl Finding {
    /// A finding in rows.
    #[must_use]
    pub fn rows(check: &str, severity: Severity, rows: &[usize], message: impl Into<String>) -> Self {
        Self {
            check: check.to_owned(),
            severity,
            count: rows.len() as u64,
            examples: rows.iter().take(EXAMPLES).map(|&row| row as u64).collect(),
            message: message.into(),
        }
    }

    /// A finding about the dataset as a whole.
    #[must_use]
    pub fn whole(check: &str, severity: Severity, message: impl Into<String>) -> Self {
        Self {
            check: check.to_owned(),
            severity,
            count: 1,
            examples: Vec::new(),
            message: message.into(),
        }
    }
}

/// Puts errors first, and within a severity keeps the order of the checks.
pub fn sort(findings: &mut [Finding]) {
    findings.sort_by_key(|finding| finding.severity);
}
