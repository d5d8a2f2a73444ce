//! The examples of a training, from rows of datasets.

mod collect;
mod left_out;

pub use collect::{Collector, Examples, LabelledRow, NoExamples, Origin, SPLIT_SEED};
pub use left_out::{LeftOut, Why};
