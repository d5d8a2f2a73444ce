//! What judged the patterns of the design stages of a run, and what was known of the others.

use std::fmt;

use serde::Serialize;

use super::gather::{Made, ReportError, Source, each};
use crate::store::Store;

/// What judged the patterns of a design stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluators {
    /// Name of the stage.
    pub stage: String,
    /// Settings of the one that was used.
    pub used: String,
    /// Those that it was chosen from, the cheapest first; empty where it was named.
    pub candidates: Vec<Candidate>,
}

/// One that could have been used.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Candidate {
    /// Its settings.
    pub settings: String,
    /// Its root mean square error of a component in mm; none where nothing is known of it.
    pub rmse_mm: Option<f64>,
    /// Patterns on which it disagrees with the reference whether there is a field.
    pub disagree: u64,
}

/// The evaluators of all design stages of a run.
///
/// # Errors
/// When an artifact cannot be read or does not hold what its kind promises.
pub fn evaluators(store: &Store, made: &[Made]) -> Result<Vec<Evaluators>, ReportError> {
    each(store, made, "design", read)
}

fn read(source: &Source<'_>) -> Result<Evaluators, ReportError> {
    let artifact = source.artifact;
    let used = artifact
        .attribute("evaluator")
        .ok_or_else(|| source.wrong("no attribute `evaluator`"))?;
    let names = artifact.texts("evaluator/candidates")?.1;
    let (errors, known) = (source.reals("evaluator/rmse")?, artifact.u64s("evaluator/known")?.1);
    let disagree = artifact.u64s("evaluator/disagree")?.1;
    if [errors.len(), known.len(), disagree.len()] != [names.len(); 3] {
        return Err(source.wrong("its arrays of evaluators differ in length"));
    }
    let candidate = |(k, settings)| Candidate {
        settings,
        rmse_mm: (known[k] > 0).then_some(errors[k]),
        disagree: disagree[k],
    };
    Ok(Evaluators {
        stage: source.stage.stage.clone(),
        used: used.to_owned(),
        candidates: names.into_iter().enumerate().map(candidate).collect(),
    })
}

impl fmt::Display for Evaluators {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: patterns judged by {{ {} }}", self.stage, self.used)?;
        if self.candidates.is_empty() {
            return Ok(());
        }
        write!(f, ", the cheapest that is accurate enough")?;
        for candidate in &self.candidates {
            let error = candidate
                .rmse_mm
                .map_or("no field".to_owned(), |mm| format!("RMSE {mm:.4} mm"));
            write!(f, "\n  {:<48} {error}", candidate.settings)?;
            if candidate.disagree > 0 {
                write!(
                    f,
                    ", disagrees on {} patterns whether there is a field",
                    candidate.disagree
                )?;
            }
        }
        Ok(())
    }
}
