//! Figures and summaries of finished runs.

mod audit;
mod course;
mod designs;
mod drawing;
mod evaluation;
mod evaluators;
pub mod export;
pub mod figures;
mod format;
mod gather;
mod html;
mod page;
mod rounds;
mod summary;
mod takeaway;
mod training;
mod warnings;

pub use audit::{audited, audits};
pub use course::{Course, Origin, StageFacts};
pub use designs::{Aim, Compared, Design, Found, Role, Wanted, designs};
pub use evaluation::{AreaError, Coverage, Evaluation, ObjectiveCoverage, Predicted, evaluations};
pub use evaluators::{Candidate, Evaluators, evaluators};
pub use gather::{Made, ReportError, draw_figures};
pub use html::{Column, Page};
pub use format::{bytes, seconds};
pub use rounds::{BestOfTarget, RoundSummary, RoundsSummary, by_round, draw_by_round};
pub use summary::{RowSummary, Summary, summarise};
pub use takeaway::{COLUMNS, Written, write_report};
pub use training::{TrainingSummary, trainings};
pub use warnings::warnings;

#[cfg(test)]
mod tests;
