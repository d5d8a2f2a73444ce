//! Accuracy stages: the error of each method over its time.

use std::collections::BTreeMap;

use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::drawing::Sheet;
use crate::error::ReportError;
use crate::figures::{Cost, FamilyCosts, accuracy_charts, accuracy_sheet};
use crate::html::Page;
use crate::presenter::{Figures, Presenter};
use deaflow_content as content;

/// Presents accuracy stages.
pub struct AccuracyPresenter;

impl Presenter for AccuracyPresenter {
    fn kind(&self) -> &'static str {
        "accuracy"
    }

    fn figures(&self) -> Figures {
        &[("accuracy", figure)]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let measured = run.each(self.kind(), |source| {
            let costs = costs(source)?;
            let charts = match has_error(&costs) {
                true => source.drawn(accuracy_charts(&costs))?,
                false => Vec::new(),
            };
            Ok((source.stage.stage.clone(), charts))
        })?;
        for (stage, charts) in &measured {
            page.open("Accuracy and time", ABOUT);
            page.part(stage);
            page.charts(charts);
        }
        Ok(())
    }
}

const ABOUT: &str = "Error of each method over the time of one core per pattern. No other method is both faster and \
                     more accurate than the labelled ones. 2² Q1 means 2 × 2 bilinear elements per cell, Q2 \
                     biquadratic ones; a length is the requested accuracy.";

fn figure(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    let costs = costs(source)?;
    let sheet = has_error(&costs).then(|| accuracy_sheet(&costs));
    sheet.map(|sheet| source.drawn(sheet)).transpose()
}

/// Whether there is an error: patterns that do not move have none.
fn has_error(costs: &[FamilyCosts]) -> bool {
    costs
        .iter()
        .flat_map(|family| &family.costs)
        .any(|cost| cost.error > 0.0)
}

/// Reads error and time of the methods of an accuracy stage, by family. Times are measurements in the provenance.
fn costs(source: &ArtifactReader<'_>) -> Result<Vec<FamilyCosts>, ReportError> {
    let view = source.of(content::Accuracy::open(source.artifact))?;
    let (methods, families) = (source.of(view.methods().read())?, source.of(view.families().read())?);
    let errors = source.of(view.error().rms().read())?;
    let times: BTreeMap<String, f64> = source.artifact.measurements()?.into_iter().collect();
    let cost = |(m, settings): (usize, &String), f: usize| {
        Some(Cost {
            settings: settings.clone(),
            seconds: *times.get(&format!("{settings}; {}", families[f]))?,
            error: errors[m * families.len() + f],
        })
    };
    let of_family = |(f, family): (usize, &String)| FamilyCosts {
        family: family.clone(),
        costs: methods
            .iter()
            .enumerate()
            .filter_map(|method| cost(method, f))
            .collect(),
    };
    Ok(families.iter().enumerate().map(of_family).collect())
}
