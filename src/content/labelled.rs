//! Artifacts whose rows are patterns with simulated fields.

use std::ops::Range;

use super::balanced::{Balanced, BalancedView};
use super::designs::{Verification, VerificationView};
use super::solutions::{SOLVED, Solutions, SolutionsView};
use deaflow_pattern::Pattern;
use deaflow_store::{Artifact, StoreError};

/// Rows with fields, by the kind of stage that made them.
pub enum Labelled<'a> {
    /// Samples that were solved or imported.
    Solved(SolutionsView<'a>),
    /// Rows of a balanced set, split into parts.
    Balanced(BalancedView<'a>),
    /// Designs that were simulated; some have no field.
    Verified(VerificationView<'a>),
}

impl<'a> Labelled<'a> {
    /// The view of an artifact, or of one of its chunks; none where it is of another kind.
    ///
    /// # Errors
    /// When its arrays do not fit together.
    pub fn open(artifact: &'a Artifact) -> Result<Option<Self>, StoreError> {
        Ok(match artifact.kind() {
            kind if SOLVED.contains(&kind) => Some(Self::Solved(Solutions::open(artifact)?)),
            "balance" => Some(Self::Balanced(Balanced::open(artifact)?)),
            "verify" => Some(Self::Verified(Verification::open(artifact)?)),
            _ => None,
        })
    }

    /// The patterns.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn patterns(&self) -> Result<Vec<Pattern>, StoreError> {
        match self {
            Self::Solved(view) => view.rows().patterns().read(),
            Self::Balanced(view) => view.patterns().read(),
            Self::Verified(view) => view.rows().patterns().read(),
        }
    }

    /// The family of each pattern; none for designs.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn families(&self) -> Result<Option<Vec<String>>, StoreError> {
        match self {
            Self::Solved(view) => view.rows().family().read().map(Some),
            Self::Balanced(view) => view.family().read().map(Some),
            Self::Verified(_) => Ok(None),
        }
    }

    /// How many fields there are.
    ///
    /// # Errors
    /// When there are no fields.
    pub fn fields(&self) -> Result<usize, StoreError> {
        match self {
            Self::Solved(view) => view.displacement().rows(),
            Self::Balanced(view) => view.displacement().rows(),
            Self::Verified(view) => view.displacement().rows(),
        }
    }

    /// The numbers of some fields, end to end, in mm, out of an artifact that is no manifest.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn displacement(&self, fields: Range<usize>) -> Result<Vec<f64>, StoreError> {
        match self {
            Self::Solved(view) => view.displacement().numbers(fields),
            Self::Balanced(view) => view.displacement().numbers(fields),
            Self::Verified(view) => view.displacement().numbers(fields),
        }
    }
}
