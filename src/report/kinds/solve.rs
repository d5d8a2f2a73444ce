//! Solve and import stages: the largest displacements of samples, by family.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::drawing::{Background, DeformedMembrane, EMPTY, Sheet, extent};
use crate::error::ReportError;
use crate::figures::{FamilyDeformation, deformation_charts, deformation_sheet, membranes_charts};
use crate::format::{counted, mm};
use crate::html::Page;
use crate::presenter::{Figures, Headline, Presenter, Results};
use deaflow_base::range_ends;
use deaflow_content::Solutions;

/// Presents stages of a kind whose artifacts are samples with fields.
pub struct SolvePresenter(pub &'static str);

/// The stages whose fields are simulated in the run.
const SOLVE: &str = "solve";

/// What a solve stage found.
#[derive(Debug, Serialize)]
struct Solved {
    stage: String,
    /// Samples with a stable solution.
    samples: usize,
    /// Samples without one.
    unstable: usize,
    /// The range of the largest displacements of the samples in mm; `None` without any.
    least_displacement_mm: Option<f64>,
    max_displacement_mm: Option<f64>,
}

impl Solved {
    fn read(source: &ArtifactReader<'_>) -> Result<Self, ReportError> {
        let view = source.of(Solutions::open(source.artifact))?;
        let largest = source.of(view.max_displacement().read())?;
        Ok(Self {
            stage: source.stage.stage.clone(),
            samples: largest.len(),
            unstable: source.of(view.unstable().outcome().read())?.len(),
            least_displacement_mm: largest.iter().copied().reduce(f64::min),
            max_displacement_mm: largest.iter().copied().reduce(f64::max),
        })
    }
}

impl Presenter for SolvePresenter {
    fn kind(&self) -> &'static str {
        self.0
    }

    fn results(&self, run: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        // Fields of files are no results of the run.
        if self.0 != SOLVE {
            return Ok(Vec::new());
        }
        let solved = run.each(self.kind(), Solved::read)?;
        Ok(vec![Results::new("solved", &solved, None)])
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
        match self.0 {
            SOLVE => &[("deformation", solved)],
            _ => &[("deformation", deformation)],
        }
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let solved = run.each(self.kind(), |source| {
            let few = self.few(source)?;
            let families = match few.is_empty() {
                true => families(source)?,
                false => Vec::new(),
            };
            let charts = match families.is_empty() {
                true => Vec::new(),
                false => source.drawn(deformation_charts(&families))?,
            };
            Ok((few, (source.stage.stage.clone(), charts)))
        })?;
        let (few, solved): (Vec<_>, Vec<_>) = solved.into_iter().unzip();
        let few = few.concat();
        if !few.is_empty() {
            super::dataset(page);
            page.part("Deformed membranes");
            page.line(
                "Samples of stages with few of them, all with the same exaggeration of the displacements; the grey \
                 line is the electrode at rest.",
            );
            page.charts(&membranes_charts(&few[..few.len().min(MOST_DRAWN)]));
            if few.len() > MOST_DRAWN {
                page.note(&format!("and {} more", few.len() - MOST_DRAWN));
            }
        }
        for (stage, charts) in solved.iter().filter(|(_, charts)| !charts.is_empty()) {
            super::dataset(page);
            page.part(&format!("{stage}: samples by family"));
            page.charts(charts);
        }
        Ok(())
    }
}

/// Samples of a stage that are drawn one by one, and the most on a page.
const FEW: usize = 12;
const MOST_DRAWN: usize = 48;

impl SolvePresenter {
    /// Returns the deformed membranes of a solve stage with few samples, with their names; none of others.
    fn few(&self, source: &ArtifactReader<'_>) -> Result<Vec<(String, DeformedMembrane)>, ReportError> {
        match self.0 {
            SOLVE => membranes(source),
            _ => Ok(Vec::new()),
        }
    }
}

fn membranes(source: &ArtifactReader<'_>) -> Result<Vec<(String, DeformedMembrane)>, ReportError> {
    let view = source.of(Solutions::open(source.artifact))?;
    let count = source.of(view.max_displacement().rows())?;
    if !(1..=FEW).contains(&count) {
        return Ok(Vec::new());
    }
    let (rows, fields) = (view.rows(), source.of(view.displacement().read())?);
    let (patterns, numbers) = (source.of(rows.patterns().read())?, source.of(rows.index().read())?);
    let background = Background::of(&source.of(view.scene().read())?);
    let stage = &source.stage.stage;
    let each = patterns
        .iter()
        .zip(&fields)
        .zip(numbers)
        .map(|((pattern, field), number)| {
            let name = match count {
                1 => stage.clone(),
                _ => format!("{stage}: {number}"),
            };
            let drawn = DeformedMembrane::new(pattern.cells(), field.values(), background.clone(), Vec::new());
            Ok((name, source.drawn(drawn)?))
        });
    each.collect()
}

/// Draws the membranes of a stage with few samples, and histograms of others.
fn solved(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    let few = membranes(source)?;
    match few.is_empty() {
        true => deformation(source),
        false => Ok(Some(Sheet::charts(few.len().min(COLUMNS), &membranes_charts(&few)))),
    }
}

/// Membranes in a row of a figure.
const COLUMNS: usize = 3;

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
