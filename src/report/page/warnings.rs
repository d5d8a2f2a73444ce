//! The warnings of a report: neglected effects and samples beyond the model, and warnings of the stages.

use crate::artifacts::RunArtifacts;
use crate::error::ReportError;
use crate::history::PipelineHistory;
use crate::kinds::PRESENTERS;
use crate::observed::observed_warnings;

/// The warnings of a pipeline.
pub struct ReportWarnings {
    /// Neglected effects, and samples beyond the range of the model.
    pub of_model: Vec<String>,
    /// Warnings of the stages about their results.
    pub of_stages: Vec<String>,
}

impl ReportWarnings {
    /// Reads the warnings of the stages that are built.
    ///
    /// # Errors
    /// If an artifact cannot be read or does not have the content of its kind.
    pub fn read(run: &RunArtifacts<'_>, history: &PipelineHistory) -> Result<Self, ReportError> {
        let all: Vec<String> = run.stages.iter().map(|made| made.stage.clone()).collect();
        let of_model = history
            .model_warnings
            .iter()
            .cloned()
            .chain(observed_warnings(run, &all)?);
        let mut of_stages = Vec::new();
        for presenter in PRESENTERS {
            of_stages.extend(presenter.results(run)?.into_iter().flat_map(|results| results.warnings));
        }
        Ok(Self {
            of_model: of_model.collect(),
            of_stages,
        })
    }

    /// Whether there are no warnings.
    pub fn is_empty(&self) -> bool {
        self.of_model.is_empty() && self.of_stages.is_empty()
    }
}
