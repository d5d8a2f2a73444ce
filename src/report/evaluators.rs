//! What judged the patterns of the design stages of a run, and what was known of the others.

use std::fmt;

use serde::Serialize;

use super::artifacts::Source;
use super::error::ReportError;
use super::format::{share, three};
use deaflow_content::Designs;

/// What judged the patterns of a design stage.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluators {
    /// Name of the stage.
    pub stage: String,
    /// Name of the target.
    pub name: String,
    /// Settings of the one that was used.
    pub used: String,
    /// What is accurate enough, as the stage says it: a root mean square error; none where it was named.
    pub enough: Option<String>,
    /// Those that it was chosen from, the cheapest first and the reference last; empty where it was named.
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
    /// Its largest error of the displacement along the wanted directions on patterns like designs, as a share.
    pub design_error: f64,
}

/// The evaluators of a design stage.
///
/// # Errors
/// When the artifact does not hold what its kind promises.
pub fn read(source: &Source<'_>) -> Result<Vec<Evaluators>, ReportError> {
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

/// What is accurate enough by the parameters of a stage, as its provenance has them.
fn enough(parameters: &str) -> Option<String> {
    let (_, rest) = parameters.split_once("evaluator_accuracy: ")?;
    let end = rest.find([',', '}']).unwrap_or(rest.len());
    Some(rest[..end].trim().to_owned())
}

impl fmt::Display for Evaluators {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // An objective that stands by itself is named like its stage's kind.
        let name = match self.name.as_str() {
            "design" => String::new(),
            name => format!(" {name}"),
        };
        write!(f, "{}{name}: patterns judged by {{ {} }}", self.stage, self.used)?;
        if self.candidates.is_empty() {
            return Ok(());
        }
        write!(f, ", the cheapest that is accurate enough")?;
        if let Some(enough) = &self.enough {
            write!(f, " (RMSE up to {enough}, and little at designs)")?;
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
            let at_designs = share(candidate.design_error);
            write!(f, "\n  {:<48} {error}, at designs {at_designs}", candidate.settings)?;
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
