//! How good predictors are on labelled patterns, and whether the intervals of calibrations cover.

mod coverage;
mod judge;
mod score;

pub use coverage::{Coverage, OBJECTIVES};
pub use judge::{Judge, Judged};
pub use score::{PatternScore, Score};
