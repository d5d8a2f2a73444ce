//! The order of an audit: one pass over all rows, then the suspects, then random rows on a finer mesh.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::error::AuditError;
use super::facts::{CheckedRow, Facts, claims_field};
use super::finding::{self, EXAMPLES};
use super::labels::{Judge, LabelCheck, Tolerance};
use super::recheck::{Recheck, row};
use super::report::{Report, Resimulation, Summary};
use super::resimulate::{Resimulated, is_wrong, resimulate};
use super::rows::{Columns, Dataset, Discretisation};
use super::spread::{Level, Spread};
use super::symmetric::Projections;
use super::{claims, identify, images, values, verdicts};
use deaflow_base::Stream;
use deaflow_field::{Mesh, Simulators};

/// Rows that are held in memory at a time.
const BATCH: usize = 256;

/// Rows by which an undeclared mesh is found out.
const PROBES: usize = 8;

/// Part of the largest displacement that a label may be off by, whatever the accuracy, where nothing is known of it; and
/// the same of rounding where its mesh was found out.
const ROUGH: f64 = 0.1;
const ROUNDED: f64 = 1e-2;

/// How to audit.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Random rows to simulate on a finer mesh; `None` for all.
    pub samples: Option<usize>,
    /// Names the random choice.
    pub seed: u64,
    /// The error that labels may have, mm, where that is asked for.
    pub accuracy: Option<f64>,
    /// The same where neither that nor the dataset says anything, mm.
    pub usual_accuracy: f64,
    /// How exactly a label comes out when it is solved again, relative to its largest displacement.
    pub tolerance: f64,
    /// The largest error in mm that a row may declare for itself; `None` where any may.
    pub most_declared: Option<f64>,
    /// What is taken for rounding where nothing is declared, mm.
    pub rounding: f64,
    /// What a balanced dataset says of its level.
    pub level: Option<Level>,
    /// Whether repeats are usual: those of solved samples are left out when these are balanced.
    pub repeats_are_usual: bool,
}

/// Audits a dataset. `advance` is told of finished rows.
///
/// # Errors
/// When rows cannot be read or a simulator cannot be set up; why.
pub fn audit(
    dataset: &Dataset<'_>,
    simulators: &dyn Simulators,
    options: &Options,
    advance: &dyn Fn(usize),
) -> Result<Report, AuditError> {
    if let Some(finding) = values::lengths(dataset) {
        return Ok(Report {
            findings: vec![finding],
            ..Report::default()
        });
    }
    let judge = judge(dataset, simulators, options)?;
    let (facts, mut labels) = pass(dataset, &judge, advance)?;
    let compared = labels
        .iter()
        .filter(|l| matches!(l, LabelCheck::Compared { .. }))
        .count();
    let recheck = Recheck {
        dataset,
        judge: &judge,
        seed: options.seed,
    };
    let (suspects, unsolved) = recheck.confirm(&facts, &mut labels)?;
    recheck.absent(&facts, &mut labels)?;
    let chosen = chosen(options, &facts);
    let is_unsure = |index: &&usize| matches!(labels[**index], LabelCheck::Compared { .. });
    let unsure: Vec<usize> = chosen.iter().filter(is_unsure).copied().collect();
    recheck.again(&unsure, &mut labels)?;
    let moved = recheck.elsewhere(&mut labels)?;
    let (judge, columns) = on_their_meshes(judge, dataset, &moved);
    let known = Dataset { columns, ..*dataset };
    let resimulated = on_finer_meshes(&known, &judge, options, &chosen)?;
    let rounding = if dataset.declared == Discretisation::Unknown {
        options.rounding
    } else {
        0.0
    };
    let mut findings = values::findings(&facts, dataset, rounding);
    findings.extend(claims::findings(&facts, dataset));
    findings.extend(images::findings(
        &facts,
        dataset.columns.split.as_deref(),
        options.repeats_are_usual,
    ));
    findings.extend(verdicts::of_labels(&labels));
    findings.extend(images::asymmetric(&facts, &labels, &judge, &known.columns));
    findings.extend(verdicts::of_accuracy(&resimulated, &labels));
    let peaks: Vec<f64> = facts.iter().map(|facts| facts.peak).collect();
    if let Some(level) = &options.level {
        findings.extend(level.findings(&peaks));
    }
    finding::sort(&mut findings);
    let faults = |row: &&Resimulated| row.exceeds() || row.is_unstable() || is_wrong(labels[row.index]);
    let faults = resimulated.iter().filter(faults).count();
    let usable = facts.iter().filter(|facts| facts.is_usable()).count();
    let again = labels.iter().filter(|l| {
        matches!(
            l,
            LabelCheck::Agrees | LabelCheck::Wrong(..) | LabelCheck::NoSolution | LabelCheck::Stable
        )
    });
    let summary = Summary {
        made_by: made_by(judge.declared, dataset.declared),
        solved_again: again.count(),
        compared,
        suspects,
        unsolved,
        resimulated: Resimulation::of(&resimulated, faults, usable),
        ..describe(dataset, &facts)
    };
    Ok(Report {
        findings,
        summary,
        labels,
        peaks,
        resimulated,
    })
}

/// By what the labels of a dataset are judged; where it does not say how they were found, that is looked for first.
fn judge<'a>(
    dataset: &Dataset<'a>,
    simulators: &'a dyn Simulators,
    options: &Options,
) -> Result<Judge<'a>, AuditError> {
    let found_out = Tolerance {
        relative: options.tolerance,
        absolute: options.rounding,
        part: ROUNDED,
    };
    let declared = declared(dataset, simulators, options, found_out)?;
    let accuracy = options.accuracy.unwrap_or(options.usual_accuracy);
    // The reference has an error of its own.
    let near = accuracy / 4.0;
    let tolerance = match (declared, dataset.declared) {
        (Discretisation::Unknown, _) => Tolerance {
            relative: 0.0,
            absolute: accuracy + near,
            part: ROUGH,
        },
        (_, Discretisation::Unknown) => found_out,
        _ => Tolerance {
            relative: options.tolerance,
            absolute: 0.0,
            part: 0.0,
        },
    };
    Ok(Judge {
        device: dataset.device,
        simulators,
        declared,
        tolerance,
        found_out: dataset.declared == Discretisation::Unknown && declared != Discretisation::Unknown,
    })
}

/// What is known once some rows have come out on other meshes than the one that was found out.
fn on_their_meshes<'a>(judge: Judge<'a>, dataset: &Dataset<'_>, moved: &BTreeMap<usize, Mesh>) -> (Judge<'a>, Columns) {
    let mut columns = dataset.columns.clone();
    let Discretisation::Mesh(usual) = judge.declared else {
        return (judge, columns);
    };
    if moved.is_empty() {
        return (judge, columns);
    }
    let mesh = |index| moved.get(&index).copied().unwrap_or(usual);
    columns.mesh = Some((0..dataset.len).map(mesh).collect());
    let declared = Discretisation::PerRow;
    (Judge { declared, ..judge }, columns)
}

/// What the dataset says, or what can be found out.
fn declared(
    dataset: &Dataset<'_>,
    simulators: &dyn Simulators,
    options: &Options,
    found_out: Tolerance,
) -> Result<Discretisation, AuditError> {
    if let (Discretisation::PerRow, Some([first, rest @ ..])) = (dataset.declared, dataset.columns.mesh.as_deref())
        && rest.iter().all(|mesh| mesh == first)
    {
        return Ok(Discretisation::Mesh(*first));
    }
    if dataset.declared != Discretisation::Unknown {
        return Ok(dataset.declared);
    }
    let mut order: Vec<usize> = (0..dataset.len).collect();
    Stream::new(options.seed, "audit probe", 0).shuffle(&mut order);
    let mut probes = Vec::new();
    // A dataset of which so many rows are of no use is not worth the search.
    for index in order.into_iter().take(4 * PROBES) {
        let row = row(dataset, index)?;
        if row.usable().is_some() && probes.len() < PROBES {
            probes.push(row);
        }
    }
    Ok(identify::mesh(simulators, &probes, found_out)?.map_or(Discretisation::Unknown, Discretisation::Mesh))
}

fn pass(
    dataset: &Dataset<'_>,
    judge: &Judge<'_>,
    advance: &dyn Fn(usize),
) -> Result<(Vec<Facts>, Vec<LabelCheck>), AuditError> {
    let projections = Projections::on(dataset.device.raster());
    let (mut facts, mut labels) = (Vec::with_capacity(dataset.len), Vec::with_capacity(dataset.len));
    for start in (0..dataset.len).step_by(BATCH) {
        let range = start..(start + BATCH).min(dataset.len);
        let count = range.len();
        let batch = dataset.rows.read(range)?;
        let read = |at| {
            let claims_field = claims_field(&dataset.columns, start + at);
            let row = CheckedRow::of(&batch, at, claims_field, dataset.device);
            let facts = Facts::of(&row, start + at, dataset, &projections);
            (row, facts)
        };
        let (rows, found): (Vec<CheckedRow>, Vec<Facts>) = (0..count).into_par_iter().map(read).unzip();
        labels.extend(judge.pass(&rows, start, &dataset.columns)?);
        facts.extend(found);
        advance(count);
    }
    Ok((facts, labels))
}

/// The random rows that are simulated on a finer mesh.
fn chosen(options: &Options, facts: &[Facts]) -> Vec<usize> {
    let usable: Vec<usize> = (0..facts.len()).filter(|&index| facts[index].is_usable()).collect();
    let count = options.samples.unwrap_or(usable.len()).min(usable.len());
    let mut stream = Stream::new(options.seed, "audit", 0);
    let mut chosen: Vec<usize> = stream
        .choose(usable.len(), count)
        .into_iter()
        .map(|at| usable[at])
        .collect();
    chosen.sort_unstable();
    chosen
}

fn on_finer_meshes(
    dataset: &Dataset<'_>,
    judge: &Judge<'_>,
    options: &Options,
    chosen: &[usize],
) -> Result<Vec<Resimulated>, AuditError> {
    let accuracy = match judge.declared {
        Discretisation::Unknown => Some(judge.tolerance.absolute),
        _ => options.accuracy,
    };
    let solved = |&index: &usize| {
        let mesh = judge.mesh(&dataset.columns, index);
        let allowed = accuracy.or_else(|| declared_error(&dataset.columns, index, options));
        resimulate(judge, (index, &row(dataset, index)?), mesh, allowed)
    };
    let found: Result<Vec<Option<Resimulated>>, AuditError> = chosen.par_iter().map(solved).collect();
    Ok(found?.into_iter().flatten().collect())
}

/// The error that a row declares, as far as it may; what is no length allows nothing.
fn declared_error(columns: &Columns, index: usize, options: &Options) -> Option<f64> {
    let declared = columns.error.as_ref()?[index];
    let declared = if declared >= 0.0 { declared } else { 0.0 };
    Some(options.most_declared.map_or(declared, |most| declared.min(most)))
}

fn made_by(found: Discretisation, said: Discretisation) -> String {
    match (found, said) {
        (Discretisation::Mesh(mesh), Discretisation::Unknown) => format!("{mesh} (found out)"),
        (Discretisation::Mesh(mesh), _) => mesh.to_string(),
        (Discretisation::Estimates(mesh), _) => format!("estimates, {mesh}"),
        (Discretisation::PerRow, Discretisation::Unknown) => "a mesh for each row (found out)".to_owned(),
        (Discretisation::PerRow, _) => "a mesh for each row".to_owned(),
        (Discretisation::Unknown, _) => "not known".to_owned(),
    }
}

fn describe(dataset: &Dataset<'_>, facts: &[Facts]) -> Summary {
    let peaks = || facts.iter().filter(|f| f.has_field).map(|f| f.peak);
    let areas = facts.iter().filter(|f| f.is_pattern).map(|f| f.area);
    let mut splits = BTreeMap::new();
    for split in dataset.columns.split.iter().flatten() {
        *splits.entry(split.clone()).or_default() += 1;
    }
    let absent = (0..facts.len()).filter(|&index| !facts[index].claims_field);
    Summary {
        samples: dataset.len,
        not_converged: absent.take(EXAMPLES).collect(),
        repeats: images::repeats(facts).len(),
        orbits: images::orbits(facts).len(),
        splits,
        area: Spread::of(areas, 1.0, 20),
        displacement: Spread::of(peaks(), peaks().fold(0.0, f64::max), 50),
        ..Summary::default()
    }
}
