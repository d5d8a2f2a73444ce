//! The evaluators of design stages, and their estimated errors.

use std::fmt;

use serde::Serialize;

use super::artifacts::ArtifactReader;
use super::error::ReportError;
use super::format::{percents, three};
use deaflow_content::Designs;

/// The evaluator of a target of a design stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluators {
    /// Name of the stage.
    pub stage: String,
    /// Name of the target.
    pub name: String,
    /// Settings of the evaluator.
    pub used: String,
    /// The required accuracy, a root mean square error as in the stage; `None` if the stage names an evaluator.
    pub enough: Option<String>,
    /// The candidates, the cheapest first and the reference last; empty if the stage names an evaluator.
    pub candidates: Vec<Candidate>,
}

/// A candidate.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Candidate {
    /// Its settings.
    pub settings: String,
    /// Its root mean square error of a component in mm; `None` if it is unknown.
    pub rmse_mm: Option<f64>,
    /// Patterns for which only one of it and the reference has a field.
    pub disagree: u64,
    /// Its largest error of the displacement along the target directions on design-like patterns, as a fraction.
    pub design_error: f64,
}

/// Reads the evaluators of a design stage.
///
/// # Errors
/// If the artifact does not have the content of its kind.
pub fn read(source: &ArtifactReader<'_>) -> Result<Vec<Evaluators>, ReportError> {
    let view = source.of(Designs::open(source.artifact))?;
    let (rows, used) = (
        source.of(view.rows().name().read())?,
        source.of(view.rows().evaluator().read())?,
    );
    let found = source.of(view.candidates().read())?;
    let names = found.name;
    let candidate = |k: usize| Candidate {
        settings: found.settings[k].clone(),
        rmse_mm: (found.known[k] > 0).then_some(found.rmse[k]),
        disagree: found.disagree[k],
        design_error: found.design_error[k],
    };
    let mut targets: Vec<(String, String)> = rows.into_iter().zip(used).collect();
    targets.dedup();
    let parameters = source.artifact.provenance()?.remove("parameters").unwrap_or_default();
    let of_target = |(name, used): (String, String)| Evaluators {
        stage: source.stage.stage.clone(),
        enough: enough(&parameters),
        candidates: (0..names.len()).filter(|&k| names[k] == name).map(candidate).collect(),
        name,
        used,
    };
    Ok(targets.into_iter().map(of_target).collect())
}

/// Reads the required accuracy from the parameters in the provenance.
fn enough(parameters: &str) -> Option<String> {
    let (_, rest) = parameters.split_once("evaluator_accuracy: ")?;
    let end = rest.find([',', '}']).unwrap_or(rest.len());
    Some(rest[..end].trim().to_owned())
}

impl fmt::Display for Evaluators {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // A single objective has the name of the stage kind.
        let name = match self.name.as_str() {
            "design" => String::new(),
            name => format!(" {name}"),
        };
        write!(f, "{}{name}: patterns evaluated by {{ {} }}", self.stage, self.used)?;
        if self.candidates.is_empty() {
            return Ok(());
        }
        write!(f, ", the cheapest one that is accurate enough")?;
        if let Some(enough) = &self.enough {
            write!(f, " (RMSE up to {enough}, and a small error at designs)")?;
        }
        let last = self.candidates.len() - 1;
        for (at, candidate) in self.candidates.iter().enumerate() {
            if at == last && candidate.rmse_mm == Some(0.0) {
                write!(f, "\n  {:<48} the reference of the others", candidate.settings)?;
                continue;
            }
            let error = candidate
                .rmse_mm
                .map_or("no field".to_owned(), |mm| format!("RMSE {} mm", three(mm)));
            let at_designs = percents(candidate.design_error);
            write!(f, "\n  {:<48} {error}, at designs {at_designs}", candidate.settings)?;
            if candidate.disagree > 0 {
                let count = candidate.disagree;
                write!(f, ", disagrees on whether there is a field for {count} patterns")?;
            }
        }
        Ok(())
    }
}
