//! Figures, summaries and pages of finished runs. Each stage kind has a presenter; `kinds` has the table of them.

mod artifacts;
mod background_figures;
mod cached_results;
mod designed_for;
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
mod measured;
mod observed;
mod page;
mod presenter;
mod research_object;
mod results;
mod rounds;
mod rows;
mod runs;
mod summary;
mod tables;
mod warned;
mod write_report;

pub use artifacts::{ArtifactReader, RunArtifacts, StageArtifact};
pub use background_figures::BackgroundFigures;
pub use error::ReportError;
pub use figure_files::{FigureFile, figures_of, remove_figures};
pub use format::{bytes, file_name, mm_measured, number, seconds, shell_word, three};
pub use headline::headlines;
pub use history::{Origin, PipelineHistory, StageRecord};
pub use html::{Column, Page};
pub use kinds::PRESENTERS;
pub use kinds::audit::audit_figure;
pub use measured::{figures_of_files, figures_of_measurements};
pub use page::{Layout, STAGE_HEIGHT, layout};
pub use presenter::{DrawFigure, Figures, Headline, Presenter, Results};
pub use research_object::{CrateFile, CrateStage, METADATA, ResearchObject};
pub use results::{RunResults, draw_figures, figure_files};
pub use rows::{RowColumn, RowSource, Rows, RowsError, pick};
pub use runs::{RemovedArtifacts, run_document};
pub use tables::{ResultTable, table};
pub use warned::warned_patterns;
pub use write_report::{COLUMNS, ReportFiles, write_report};

#[cfg(test)]
mod tests;
