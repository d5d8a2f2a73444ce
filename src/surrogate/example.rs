//! What a network learns from.

use crate::dataset::Split;
use crate::field::Field;
use crate::pattern::Pattern;

/// A pattern with its simulated field.
#[derive(Clone, Debug)]
pub struct Example {
    /// The pattern.
    pub pattern: Pattern,
    /// Its displacement in mm.
    pub field: Field,
    /// The family it was sampled from: metrics are kept apart by it.
    pub family: String,
    /// The part of the dataset it belongs to.
    pub split: Split,
}
