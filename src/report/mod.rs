//! Figures and summaries of finished runs.

pub mod figures;
mod gather;
mod summary;

pub use gather::{Made, ReportError, draw_figures};
pub use summary::{CaseSummary, Summary, summarise};

#[cfg(test)]
mod tests;
