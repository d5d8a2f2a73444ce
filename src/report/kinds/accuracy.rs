//! Accuracy stages: what accuracy costs, the error of each method over its time.

use std::collections::BTreeMap;
use std::path::Path;

use crate::artifacts::{RunArtifacts, Source};
use crate::error::ReportError;
use crate::figures::{Cost, FamilyCosts, accuracy_charts, draw_accuracy};
use crate::html::Page;
use crate::presenter::{DrawFigure, Presenter};
use deaflow_content as content;

/// Shows accuracy stages.
pub struct Accuracy;

impl Presenter for Accuracy {
    fn kind(&self) -> &'static str {
        "accuracy"
    }

    fn figures(&self) -> &'static [(&'static str, DrawFigure)] {
        &[("accuracy", figure)]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let measured = run.each(self.kind(), |source| {
            let costs = costs(source)?;
            let charts = match moves(&costs) {
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

const ABOUT: &str = "Error of each method over the time of one core per pattern. Ringed and named: no other method is both faster \
                     and more accurate. 2² Q1 is 2 × 2 bilinear elements per cell, Q2 are biquadratic ones; a length is the \
                     accuracy that was asked for.";

fn figure(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    let costs = costs(source)?;
    match moves(&costs) {
        true => source.drawn(draw_accuracy(path, &costs)),
        false => Ok(()),
    }
}

/// Whether there is an error to draw: patterns that do not move have none.
fn moves(costs: &[FamilyCosts]) -> bool {
    costs
        .iter()
        .flat_map(|family| &family.costs)
        .any(|cost| cost.error > 0.0)
}

/// Error and time of the methods of an accuracy stage, by family. Times are no content: they stand in the provenance.
fn costs(source: &Source<'_>) -> Result<Vec<FamilyCosts>, ReportError> {
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
