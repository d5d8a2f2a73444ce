//! The split of a dataset into training, validation and test examples.
//!
//! The split is a function of the orbit, so all images of a pattern are in the same split. An image of a training
//! pattern in the test split would make every metric too good.

use deaflow_base::{OrbitId, Stream, words};

words! {
    /// A split of a dataset.
    pub enum Split {
        /// Training examples (80 %).
        Train = "train",
        /// Examples that select the best epoch (10 %).
        Validation = "validation",
        /// Examples for the final test (10 %).
        Test = "test",
    }
}

impl Split {
    /// Returns the split of an orbit.
    #[must_use]
    pub fn of(orbit: &OrbitId, seed: u64) -> Self {
        let word = u64::from_le_bytes(orbit.as_bytes()[..8].try_into().expect("a digest has 32 bytes"));
        match Stream::new(seed, "split", word).uniform() {
            u if u < 0.8 => Self::Train,
            u if u < 0.9 => Self::Validation,
            _ => Self::Test,
        }
    }
}
