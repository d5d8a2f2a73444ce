//! Figures, summaries and pages of finished runs. Each stage kind has a presenter; `presenter.rs` holds the table of them.

mod ahead;
mod artifacts;
mod designs;
pub mod drawing;
mod error;
mod evaluation;
mod evaluators;
pub mod export;
mod figure_files;
pub mod figures;
mod format;
mod headline;
mod history;
mod html;
mod in_time;
mod intervals;
mod kinds;
mod page;
mod presenter;
mod remembered;
mod research_object;
mod results;
mod rounds;
mod rows;
mod runs;
mod summary;
mod tables;
mod warnings;
mod write_report;

pub use ahead::FiguresAhead;
pub use artifacts::{Made, RunArtifacts, Source};
pub use error::ReportError;
pub use figure_files::{FigureFile, figures_of, remove_figures};
pub use format::{bytes, error, file_name, number, seconds, uncertainty};
pub use headline::{Headline, headlines};
pub use history::{History, Origin, StageFacts};
pub use html::{Column, Page};
pub use kinds::PRESENTERS;
pub use kinds::audit::audited;
pub use page::{Layout, STAGE_HEIGHT, layout};
pub use presenter::{DrawFigure, Presenter, Results};
pub use research_object::{CrateFile, CrateStage, METADATA, ResearchObject};
pub use results::{RunResults, draw_figures, figure_files};
pub use rows::{RowColumn, RowSource, Rows, RowsError};
pub use runs::{Gone, run_document};
pub use tables::{Collected, table};
pub use write_report::{COLUMNS, Written, write_report};

#[cfg(test)]
mod tests;
