//! Solve and import stages: the largest displacements of samples, by family.

use std::collections::BTreeMap;

use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::drawing::{EMPTY, Sheet, extent};
use crate::error::ReportError;
use crate::figures::{FamilyDeformation, deformation_charts, deformation_sheet};
use crate::format::{counted, mm};
use crate::html::Page;
use crate::presenter::{Figures, Headline, Presenter};
use deaflow_base::range_ends;
use deaflow_content::Solutions;

/// Presents stages of a kind whose artifacts are samples with fields.
pub struct SolvePresenter(pub &'static str);

impl Presenter for SolvePresenter {
    fn kind(&self) -> &'static str {
        self.0
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        run.each(self.kind(), |source| {
            let peaks: Vec<f64> = families(source)?.into_iter().flat_map(|family| family.peaks).collect();
            let (least, most) = extent(&peaks, EMPTY);
            let (stage, lost) = (&source.stage.stage, lost(source)?);
            let range = match [least, most].map(mm) {
                [least, most] if least == most => format!("{most} mm"),
                [least, most] => format!("{least} to {most} mm"),
            };
            Ok(match (peaks.len(), lost) {
                (0, None) => Headline::bad(format!("{stage}: no sample has a field")),
                (0, Some(lost)) => Headline::bad(format!("{stage}: no sample has a field: {lost}")),
                (n, lost) => {
                    let with = counted(n, "sample with a field", "samples with a field");
                    let text = format!("{stage}: {with}, largest displacement {range}");
                    match lost {
                        None => Headline::good(text),
                        Some(lost) => Headline::bad(format!("{text}; {lost}")),
                    }
                }
            })
        })
    }

    fn figures(&self) -> Figures {
        &[("deformation", deformation)]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let solved = run.each(self.kind(), |source| {
            let families = families(source)?;
            let charts = match families.is_empty() {
                true => Vec::new(),
                false => source.drawn(deformation_charts(&families))?,
            };
            Ok((source.stage.stage.clone(), charts))
        })?;
        for (stage, charts) in solved.iter().filter(|(_, charts)| !charts.is_empty()) {
            super::dataset(page);
            page.part(&format!("{stage}: samples by family"));
            page.charts(charts);
        }
        Ok(())
    }
}

/// Without a field there is no figure; the run reports that.
fn deformation(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    let families = families(source)?;
    let sheet = (!families.is_empty()).then(|| deformation_sheet(&families));
    sheet.map(|sheet| source.drawn(sheet)).transpose()
}

/// Describes the outcomes of samples without a field, with their voltages; `None` if all have one.
fn lost(source: &ArtifactReader<'_>) -> Result<Option<String>, ReportError> {
    let view = source.of(Solutions::open(source.artifact))?;
    let outcomes = source.of(view.unstable().outcome().read())?;
    let brackets = source.of(view.unstable().voltage_bracket().read())?;
    let known: Vec<[f64; 2]> = brackets.into_iter().filter(|[_, lost]| *lost > 0.0).collect();
    let between = match known.as_slice() {
        [] => String::new(),
        many => {
            let least = many.iter().map(|[stable, _]| *stable).fold(f64::INFINITY, f64::min);
            let most = many.iter().map(|[_, lost]| *lost).fold(0.0, f64::max);
            let [least, most] = range_ends([least, most]);
            format!(" between {least} V and {most} V")
        }
    };
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for outcome in &outcomes {
        *counts.entry(outcome.name()).or_default() += 1;
    }
    let outcomes: Vec<String> = match (counts.len(), outcomes.len()) {
        (0, _) => return Ok(None),
        (1, 1) => vec![outcomes[0].to_string()],
        _ => counts
            .into_iter()
            .map(|(outcome, count)| format!("{count} {outcome}"))
            .collect(),
    };
    Ok(Some(format!("{}{between}", outcomes.join(", "))))
}

/// Reads the largest displacements of the samples of a solve stage, by family.
fn families(source: &ArtifactReader<'_>) -> Result<Vec<FamilyDeformation>, ReportError> {
    let view = source.of(Solutions::open(source.artifact))?;
    let names = source.of(view.rows().family().read())?;
    let mut families: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for (family, peak) in names.into_iter().zip(source.of(view.max_displacement().read())?) {
        families.entry(family).or_default().push(peak);
    }
    let family = |(family, peaks)| FamilyDeformation { family, peaks };
    Ok(families.into_iter().map(family).collect())
}
