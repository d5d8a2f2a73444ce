//! What a reader should know before the numbers: what the model leaves out although it matters, and what stages warn of.

use crate::artifacts::RunArtifacts;
use crate::error::ReportError;
use crate::history::History;
use crate::kinds::PRESENTERS;
use crate::warnings::warnings;

/// The warnings of a pipeline.
pub struct Warned {
    /// Effects that are neglected, and samples beyond what the model holds for.
    pub of_model: Vec<String>,
    /// What the stages say of their own results.
    pub of_stages: Vec<String>,
}

impl Warned {
    /// Of what has been built.
    ///
    /// # Errors
    /// When an artifact cannot be read or does not hold what its kind promises.
    pub fn read(run: &RunArtifacts<'_>, history: &History) -> Result<Self, ReportError> {
        let all: Vec<String> = run.made.iter().map(|made| made.stage.clone()).collect();
        let of_model = history.neglected.iter().cloned().chain(warnings(run, &all)?);
        let mut of_stages = Vec::new();
        for presenter in PRESENTERS {
            of_stages.extend(presenter.results(run)?.into_iter().flat_map(|results| results.warnings));
        }
        Ok(Self {
            of_model: of_model.collect(),
            of_stages,
        })
    }

    /// Whether there is nothing to say.
    pub fn is_empty(&self) -> bool {
        self.of_model.is_empty() && self.of_stages.is_empty()
    }
}
