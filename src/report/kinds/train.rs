//! Train stages: how each training went, the network and its errors.

use std::path::Path;

use serde_json::json;

use crate::artifacts::{RunArtifacts, Source};
use crate::error::ReportError;
use crate::figures::{Training, draw_training};
use crate::headline::Headline;
use crate::html::Page;
use crate::presenter::{DrawFigure, Presenter, Results};
use deaflow_content as content;
use deaflow_content::ALL_FAMILIES;

/// Shows train stages.
pub struct Train;

/// A training in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrainingSummary {
    /// Which network, the epoch that is kept, and the errors of each part of the dataset.
    pub line: String,
    /// What a user should know, after the name of the stage.
    pub warnings: Vec<String>,
}

impl Presenter for Train {
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
        Ok(vec![Results {
            key: "trainings".to_owned(),
            value: json!(lines),
            text,
            warnings,
        }])
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        let trainings = run.each(self.kind(), read)?;
        Ok(trainings
            .into_iter()
            .map(|training| Headline::good(training.line))
            .collect())
    }

    fn figures(&self) -> &'static [(&'static str, DrawFigure)] {
        &[("training", training)]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let trained = run.each(self.kind(), |source| {
            let charts = source.drawn(curves(source)?.charts())?;
            Ok((source.stage.stage.clone(), charts, read(source)?))
        })?;
        for (stage, charts, told) in &trained {
            page.open("Training", "");
            page.part(stage);
            page.line(&told.line);
            page.charts(charts);
        }
        Ok(())
    }
}

fn training(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    source.drawn(draw_training(path, &curves(source)?))
}

/// The curves of a train stage.
fn curves(source: &Source<'_>) -> Result<Training, ReportError> {
    let view = source.of(content::Training::open(source.artifact))?;
    let curves = source.of(view.curves().read())?;
    let [kept] = source.of(view.best_epoch().read())?;
    Ok(Training {
        train_loss: curves.train_loss,
        validation_loss: curves.validation_loss,
        validation_rmse: curves.validation_rmse,
        learning_rate: curves.learning_rate,
        kept,
    })
}

/// A training in words.
pub fn read(source: &Source<'_>) -> Result<TrainingSummary, ReportError> {
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
    let warnings = source.of(view.warnings().read())?.unwrap_or_default().0;
    Ok(TrainingSummary {
        line: format!(
            "{stage}: {network}, epoch {kept} of {epochs} kept; RMSE of a component: {}",
            errors.join(", ")
        ),
        warnings: warnings.iter().map(|warning| format!("{stage}: {warning}")).collect(),
    })
}
