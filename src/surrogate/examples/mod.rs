//! Training examples from rows of datasets.

mod collect;
mod left_out;

pub use collect::{Collector, Examples, LabelledRow, NoExamples, RowKind, SPLIT_SEED};
pub use left_out::{LeftOut, LeftOutReason};
