//! Which part of a dataset a pattern belongs to.
//!
//! The split is a function of the orbit, so all eight images of one pattern stay on one side: a mirrored training
//! pattern in the test set would flatter every metric.

use deaflow_base::{OrbitId, Stream};

/// A part of a dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Split {
    /// The network learns from it (80 %).
    Train,
    /// Chooses the epoch that is kept (10 %).
    Validation,
    /// Measured once, at the end (10 %).
    Test,
}

impl Split {
    /// All parts.
    pub const ALL: [Self; 3] = [Self::Train, Self::Validation, Self::Test];

    /// The part of an orbit under a seed.
    #[must_use]
    pub fn of(orbit: &OrbitId, seed: u64) -> Self {
        let word = u64::from_le_bytes(orbit.as_bytes()[..8].try_into().expect("a digest has 32 bytes"));
        match Stream::new(seed, "split", word).uniform() {
            u if u < 0.8 => Self::Train,
            u if u < 0.9 => Self::Validation,
            _ => Self::Test,
        }
    }

    /// The word that stands in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Validation => "validation",
            Self::Test => "test",
        }
    }

    /// The part that a word names.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|split| split.name() == name)
    }
}
