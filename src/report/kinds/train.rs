//! Train stages: the progress of each training, its network and its errors.

use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::error::ReportError;
use crate::figures::Training;
use crate::html::Page;
use crate::presenter::{Figures, Headline, Presenter, Results};
use deaflow_content as content;
use deaflow_content::ALL_FAMILIES;

/// The rows of a dataset by which epochs are judged.
const VALIDATION: &str = "validation";

/// Presents train stages.
pub struct TrainPresenter;

/// The description of a training.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrainingSummary {
    /// The network, the kept epoch, and the errors on each part of the dataset.
    pub line: String,
    /// Warnings, with the name of the stage.
    pub warnings: Vec<String>,
}

impl Presenter for TrainPresenter {
    fn kind(&self) -> &'static str {
        "train"
    }

    fn results(&self, run: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        let trainings = run.each(self.kind(), read)?;
        let lines: Vec<&str> = trainings.iter().map(|training| training.line.as_str()).collect();
        let warnings: Vec<String> = trainings.iter().flat_map(|t| t.warnings.clone()).collect();
        let mut text = Vec::new();
        text.extend((!lines.is_empty()).then(|| lines.join("\n")));
        text.extend((!warnings.is_empty()).then(|| format!("warnings:\n  {}", warnings.join("\n  "))));
        Ok(vec![Results::new("trainings", &lines, text).with_warnings(warnings)])
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        let trainings = run.each(self.kind(), read)?;
        Ok(trainings
            .into_iter()
            .map(|training| Headline::good(training.line))
            .collect())
    }

    fn figures(&self) -> Figures {
        &[("training", |source| source.drawn(curves(source)?.sheet()).map(Some))]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let trained = run.each(self.kind(), |source| {
            let charts = source.drawn(curves(source)?.charts())?;
            Ok((source.stage.stage.clone(), charts, read(source)?))
        })?;
        for (stage, charts, summary) in &trained {
            page.open("Training", "");
            page.part(stage);
            page.line(&summary.line);
            page.charts(charts);
        }
        Ok(())
    }
}

/// Reads the curves of a train stage.
fn curves(source: &ArtifactReader<'_>) -> Result<Training, ReportError> {
    let view = source.of(content::Training::open(source.artifact))?;
    let curves = source.of(view.curves().read())?;
    let [kept] = source.of(view.best_epoch().read())?;
    let splits = source.of(view.metrics().split().read())?;
    Ok(Training {
        is_validated: splits.iter().any(|split| split == VALIDATION),
        train_loss: curves.train_loss,
        validation_loss: curves.validation_loss,
        validation_rmse: curves.validation_rmse,
        learning_rate: curves.learning_rate,
        kept,
    })
}

/// Describes a training.
pub fn read(source: &ArtifactReader<'_>) -> Result<TrainingSummary, ReportError> {
    let stage = &source.stage.stage;
    let view = source.of(content::Training::open(source.artifact))?;
    let metrics = view.metrics();
    let (families, splits) = (source.of(metrics.family().read())?, source.of(metrics.split().read())?);
    let errors = source.of(metrics.rmse().read())?;
    let rows = families.iter().zip(&splits).zip(&errors);
    let of_all = rows.filter(|((family, _), _)| *family == ALL_FAMILIES);
    let errors: Vec<String> = of_all
        .map(|((_, split), rmse)| format!("{split} {rmse:.4} mm"))
        .collect();
    let epochs = source.of(view.curves().train_loss().rows())?;
    let [kept] = source.of(view.best_epoch().read())?;
    let network = source.of(view.network().read())?;
    let without = source.of(view.without().read())?.unwrap_or_default().0;
    let warnings = source.of(view.warnings().read())?.unwrap_or_default().0;
    Ok(TrainingSummary {
        line: format!(
            "{stage}: {network}, epoch {kept} of {epochs} kept; RMSE of a component: {}{}",
            errors.join(", "),
            match without.is_empty() {
                true => String::new(),
                false => format!("; {}", without.join("; ")),
            }
        ),
        warnings: warnings.iter().map(|warning| format!("{stage}: {warning}")).collect(),
    })
}
