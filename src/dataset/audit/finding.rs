//! Findings of an audit.

use serde::{Deserialize, Serialize};

/// Severity of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The dataset is wrong and should not be used for training.
    Error,
    /// The dataset can be used with care.
    Warning,
}

impl Severity {
    /// Returns the word in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Error => "error",
            Self::Warning => "warning",
        }
    }
}

/// Largest number of rows that a finding lists.
pub const EXAMPLES: usize = 20;

/// A fault of a dataset, with the rows that have it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// Name of the check.
    pub check: String,
    /// Its severity.
    pub severity: Severity,
    /// Number of rows; 1 for the dataset as a whole.
    pub count: u64,
    /// Numbers of the first rows; empty for the dataset as a whole.
    pub examples: Vec<u64>,
    /// Description for users.
    pub message: String,
    /// Numbers of all its rows. They are an array of the artifact and not part of its findings.
    #[serde(skip)]
    pub all: Vec<u64>,
}

impl Finding {
    /// Creates a finding about rows.
    #[must_use]
    pub fn rows(check: &str, severity: Severity, rows: &[usize], message: impl Into<String>) -> Self {
        Self {
            check: check.to_owned(),
            severity,
            count: rows.len() as u64,
            examples: rows.iter().take(EXAMPLES).map(|&row| row as u64).collect(),
            message: message.into(),
            all: rows.iter().map(|&row| row as u64).collect(),
        }
    }

    /// Creates a finding about the dataset as a whole.
    #[must_use]
    pub fn whole(check: &str, severity: Severity, message: impl Into<String>) -> Self {
        Self {
            check: check.to_owned(),
            severity,
            count: 1,
            examples: Vec::new(),
            message: message.into(),
            all: Vec::new(),
        }
    }
}

/// Sorts errors before warnings and keeps the order of the checks otherwise.
pub fn sort(findings: &mut [Finding]) {
    findings.sort_by_key(|finding| finding.severity);
}
