//! Evaluation of predictors and calibrations on labelled patterns.

mod coverage;
mod score;
mod scorer;

pub use coverage::{Coverage, OBJECTIVES};
pub use score::{PatternScore, Score};
pub use scorer::{RowScores, Scorer};
