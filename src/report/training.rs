//! What the trainings of a run came to: a line each, and what they warn of.

use super::gather::{Made, ReportError, Source};
use crate::store::Store;

/// A training in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrainingSummary {
    /// Which network, the epoch that is kept, and the errors of each part of the dataset.
    pub line: String,
    /// What a user should know, after the name of the stage.
    pub warnings: Vec<String>,
}

/// The trainings of a run, in the order of the stages.
///
/// # Errors
/// When an artifact cannot be read or does not hold what its kind promises.
pub fn trainings(store: &Store, made: &[Made]) -> Result<Vec<TrainingSummary>, ReportError> {
    let trained = made.iter().filter(|stage| stage.kind == "train");
    trained
        .map(|stage| {
            let artifact = &store.artifact(&stage.digest)?;
            read(&Source {
                stage,
                artifact,
                run: made,
            })
        })
        .collect()
}

fn read(source: &Source<'_>) -> Result<TrainingSummary, ReportError> {
    let (artifact, stage) = (source.artifact, &source.stage.stage);
    let (families, splits) = (artifact.texts("metrics/family")?.1, artifact.texts("metrics/split")?.1);
    let errors = source.reals("metrics/rmse")?;
    let rows = families.iter().zip(&splits).zip(&errors);
    let of_all = rows.filter(|((family, _), _)| *family == "all");
    let errors: Vec<String> = of_all
        .map(|((_, split), rmse)| format!("{split} {rmse:.4} mm"))
        .collect();
    let epochs = source.reals("curves/train_loss")?.len();
    let kept = artifact.u64s("best_epoch")?.1;
    let kept = kept
        .first()
        .ok_or_else(|| source.wrong("it does not say which epoch is kept"))?;
    let network = artifact.attribute("network").unwrap_or_default();
    let warnings = artifact.attribute("warnings").unwrap_or_default().lines();
    Ok(TrainingSummary {
        line: format!(
            "{stage}: {network}, epoch {kept} of {epochs} kept; RMSE of a component: {}",
            errors.join(", ")
        ),
        warnings: warnings.map(|warning| format!("{stage}: {warning}")).collect(),
    })
}
