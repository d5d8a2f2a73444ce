//! Figures and summaries of finished runs.

mod audit;
mod evaluation;
mod evaluators;
pub mod export;
pub mod figures;
mod gather;
mod html;
mod rounds;
mod summary;
mod training;
mod warnings;

pub use audit::{audited, audits};
pub use evaluation::{AreaError, Coverage, Evaluation, ObjectiveCoverage, Predicted, evaluations};
pub use evaluators::{Candidate, Evaluators, evaluators};
pub use gather::{Made, ReportError, draw_figures};
pub use html::Page;
pub use rounds::{BestOfTarget, RoundSummary, RoundsSummary, by_round, draw_by_round};
pub use summary::{RowSummary, Summary, summarise};
pub use training::{TrainingSummary, trainings};
pub use warnings::warnings;

#[cfg(test)]
mod tests;
