//! Artifacts whose rows are patterns with simulated fields.

use std::ops::Range;

use super::balanced::{Balanced, BalancedView};
use super::designs::{Verification, VerificationView};
use super::kind::ArtifactKind;
use super::solutions::{Solutions, SolutionsView};
use deaflow_pattern::Pattern;
use deaflow_store::{Artifact, StoreError};

/// The view of an artifact with labelled patterns, by the kind of its stage.
pub enum Labelled<'a> {
    /// Solved or imported samples.
    Solved(SolutionsView<'a>),
    /// Rows of a balanced set with their splits.
    Balanced(BalancedView<'a>),
    /// Simulated designs; some have no field.
    Verified(VerificationView<'a>),
}

impl<'a> Labelled<'a> {
    /// Opens an artifact or one of its chunks; `None` if it is of another kind.
    ///
    /// # Errors
    /// If its arrays are inconsistent.
    pub fn open(artifact: &'a Artifact) -> Result<Option<Self>, StoreError> {
        Ok(match ArtifactKind::of(artifact) {
            Some(ArtifactKind::Solve | ArtifactKind::Import) => Some(Self::Solved(Solutions::open(artifact)?)),
            Some(ArtifactKind::Balance) => Some(Self::Balanced(Balanced::open(artifact)?)),
            Some(ArtifactKind::Verify) => Some(Self::Verified(Verification::open(artifact)?)),
            _ => None,
        })
    }

    /// Reads the patterns.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn patterns(&self) -> Result<Vec<Pattern>, StoreError> {
        match self {
            Self::Solved(view) => view.rows().patterns().read(),
            Self::Balanced(view) => view.patterns().read(),
            Self::Verified(view) => view.rows().patterns().read(),
        }
    }

    /// Reads the family of each pattern; `None` for designs.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn families(&self) -> Result<Option<Vec<String>>, StoreError> {
        match self {
            Self::Solved(view) => view.rows().family().read().map(Some),
            Self::Balanced(view) => view.family().read().map(Some),
            Self::Verified(_) => Ok(None),
        }
    }

    /// Returns the number of fields.
    ///
    /// # Errors
    /// If there are no fields.
    pub fn fields(&self) -> Result<usize, StoreError> {
        match self {
            Self::Solved(view) => view.displacement().rows(),
            Self::Balanced(view) => view.displacement().rows(),
            Self::Verified(view) => view.displacement().rows(),
        }
    }

    /// Reads the concatenated values of some fields in mm from an artifact that is not a manifest: displacements from
    /// the state without voltage, if not all sides are held.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn displacement(&self, fields: Range<usize>) -> Result<Vec<f64>, StoreError> {
        match self {
            Self::Solved(view) => view.from_rest(fields),
            Self::Balanced(view) => view.displacement().numbers(fields),
            Self::Verified(view) => view.displacement().numbers(fields),
        }
    }
}
