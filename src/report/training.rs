//! What the trainings of a run came to: a line each, and what they warn of.

use super::gather::{Made, ReportError, Source, each};
use crate::content::{ALL_FAMILIES, Training};
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
    each(store, made, "train", read)
}

fn read(source: &Source<'_>) -> Result<TrainingSummary, ReportError> {
    let stage = &source.stage.stage;
    let view = source.of(Training::open(source.artifact))?;
    let metrics = view.metrics();
    let (families, splits) = (source.of(metrics.family().read())?, source.of(metrics.split().read())?);
    let errors = source.of(metrics.rmse().read())?;
    let rows = families.iter().zip(&splits).zip(&errors);
    let of_all = rows.filter(|((family, _), _)| *family == ALL_FAMILIES);
    let errors: Vec<String> = of_all
        .map(|((_, split), rmse)| format!("{split} {rmse:.4} mm"))
        .collect();
    let epochs = source.of(view.curves().train_loss().len())?;
    let [kept] = source.of(view.best_epoch().read())?;
    let network = source.of(view.network().read())?;
    let warnings = source.of(view.warnings().read())?.unwrap_or_default().0;
    Ok(TrainingSummary {
        line: format!(
            "{stage}: {network}, epoch {kept} of {epochs} kept; RMSE of a component: {}",
            errors.join(", ")
        ),
        warnings: warnings.iter().map(|warning| format!("{stage}: {warning}")).collect(),
    })
}
