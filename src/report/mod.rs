//! Figures and summaries of finished runs.

pub mod figures;
mod gather;
mod summary;
mod warnings;

pub use gather::{Made, ReportError, draw_figures};
pub use summary::{CaseSummary, Summary, summarise};
pub use warnings::warnings;

#[cfg(test)]
mod tests;
