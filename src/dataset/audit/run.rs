//! The steps of an audit: a pass over all rows, suspects, and random rows on a finer mesh.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::distribution::{DeclaredBalance, Distribution};
use super::error::AuditError;
use super::facts::{CheckedRow, Facts, claims_field};
use super::finding::{self, EXAMPLES, Finding};
use super::labels::{LabelCheck, LabelChecker, Tolerance};
use super::recheck::{Recheck, row};
use super::report::{Report, Resimulation, Summary};
use super::resimulate::{Resimulated, is_wrong, resimulate};
use super::rows::{Columns, Dataset, Discretisation};
use super::symmetric::Projections;
use super::{claims, identify, images, values, verdicts};
use deaflow_base::Stream;
use deaflow_field::{Mesh, Simulators};

/// Rows in memory at a time.
const BATCH: usize = 256;

/// Number of rows that identify an undeclared mesh.
const PROBES: usize = 8;

/// Upper bounds of absolute tolerances, relative to the largest displacement: for an unknown mesh, and for rounding on
/// an identified mesh.
const UNKNOWN_MESH_PART: f64 = 0.1;
const ROUNDING_PART: f64 = 1e-2;

/// Options of an audit.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Number of random rows to simulate on a finer mesh; `None` for all.
    pub samples: Option<usize>,
    /// Seed of the random choice.
    pub seed: u64,
    /// Required accuracy of the labels, mm; `None` for the declared accuracy.
    pub accuracy: Option<f64>,
    /// Accuracy if neither the user nor the dataset states one, mm.
    pub default_accuracy: f64,
    /// Tolerance of labels that are solved again, relative to the largest displacement.
    pub tolerance: f64,
    /// Largest error in mm that a row may declare for itself; `None` for any.
    pub max_declared_error: Option<f64>,
    /// Rounding error of datasets that declare no mesh, mm.
    pub rounding: f64,
    /// The histograms of a balanced dataset.
    pub balance: Option<DeclaredBalance>,
    /// Whether repeats are usual. Balancing omits the repeats of solved samples.
    pub repeats_are_usual: bool,
}

/// How many rows of the first pass a row on a finer mesh counts in the progress.
const FINER: usize = 8;

/// The passes that solve rows again, each of which counts this part of the first pass: one in so many rows.
const PASSES: usize = 4;
const PASS_PART: usize = 8;

/// Returns the amount of work that an audit of `rows` rows reports as progress at most: rows that cannot be used are
/// not solved.
#[must_use]
pub fn work(rows: usize, options: &Options) -> usize {
    rows + PASSES * rows.div_ceil(PASS_PART) + FINER * options.samples.unwrap_or(rows).min(rows)
}

/// Audits a dataset. Calls `advance` with finished amounts of [`work`].
///
/// # Errors
/// When rows cannot be read or a simulator cannot be set up.
pub fn audit(
    dataset: &Dataset<'_>,
    simulators: &dyn Simulators,
    options: &Options,
    advance: &(dyn Fn(usize) + Sync),
) -> Result<Report, AuditError> {
    if let Some(finding) = values::lengths(dataset) {
        return Ok(Report {
            findings: vec![finding],
            ..Report::default()
        });
    }
    let checker = label_checker(dataset, simulators, options)?;
    let (facts, mut labels) = first_pass(dataset, &checker, advance)?;
    let is_compared = |label: &LabelCheck| matches!(label, LabelCheck::Compared { .. });
    let compared = labels.iter().filter(|label| is_compared(label)).count();
    let recheck = Recheck {
        dataset,
        checker: &checker,
        seed: options.seed,
    };
    let pass = || advance(dataset.len.div_ceil(PASS_PART));
    let (suspects, unsolved) = recheck.check_suspects(&facts, &mut labels)?;
    pass();
    recheck.check_absent(&facts, &mut labels)?;
    pass();
    let chosen = random_rows(options, &facts);
    let open = chosen.iter().copied().filter(|&index| is_compared(&labels[index]));
    recheck.solve_again(&open.collect::<Vec<_>>(), &mut labels)?;
    pass();
    let meshes = recheck.check_other_meshes(&mut labels)?;
    pass();
    let (checker, columns) = with_row_meshes(checker, dataset, &meshes);
    let dataset = &Dataset { columns, ..*dataset };
    let resimulated = on_finer_meshes(dataset, &checker, options, &chosen, advance)?;
    let peaks: Vec<f64> = facts.iter().map(|facts| facts.peak).collect();
    let faults = |row: &&Resimulated| row.exceeds() || row.is_unstable() || is_wrong(labels[row.index]);
    let faults = resimulated.iter().filter(faults).count();
    let usable = facts.iter().filter(|facts| facts.is_usable()).count();
    let is_solved = |label: &&LabelCheck| is_wrong(**label) || **label == LabelCheck::Agrees;
    let summary = Summary {
        made_by: made_by(checker.discretisation, dataset.declared),
        solved_again: labels.iter().filter(is_solved).count(),
        compared,
        suspects,
        unsolved,
        resimulated: Resimulation::of(&resimulated, faults, usable),
        ..describe(dataset, &facts)
    };
    Ok(Report {
        findings: findings(dataset, options, &facts, &labels, &checker, &resimulated),
        summary,
        labels,
        peaks,
        resimulated,
    })
}

/// Returns all findings, errors first.
fn findings(
    dataset: &Dataset<'_>,
    options: &Options,
    facts: &[Facts],
    labels: &[LabelCheck],
    checker: &LabelChecker<'_>,
    resimulated: &[Resimulated],
) -> Vec<Finding> {
    let columns = &dataset.columns;
    let is_undeclared = dataset.declared == Discretisation::Unknown;
    let rounding = if is_undeclared { options.rounding } else { 0.0 };
    let mut findings = values::findings(facts, dataset, rounding);
    findings.extend(claims::findings(facts, dataset));
    findings.extend(images::findings(
        facts,
        columns.split.as_deref(),
        options.repeats_are_usual,
    ));
    findings.extend(verdicts::of_labels(labels));
    findings.extend(images::asymmetric(facts, labels, checker, columns));
    findings.extend(verdicts::of_accuracy(resimulated, labels));
    if let Some(balance) = &options.balance {
        let peaks: Vec<f64> = facts.iter().map(|facts| facts.peak).collect();
        findings.extend(balance.findings(&peaks));
    }
    finding::sort(&mut findings);
    findings
}

/// Returns the checker of the labels. If the dataset declares no mesh, it is identified first.
fn label_checker<'a>(
    dataset: &Dataset<'a>,
    simulators: &'a dyn Simulators,
    options: &Options,
) -> Result<LabelChecker<'a>, AuditError> {
    let of_identified = Tolerance {
        relative: options.tolerance,
        absolute: options.rounding,
        part: ROUNDING_PART,
    };
    let discretisation = discretisation(dataset, simulators, options, of_identified)?;
    let accuracy = options.accuracy.unwrap_or(options.default_accuracy);
    // The reference has an error too.
    let of_reference = accuracy / 4.0;
    let tolerance = match (discretisation, dataset.declared) {
        (Discretisation::Unknown, _) => Tolerance {
            relative: 0.0,
            absolute: accuracy + of_reference,
            part: UNKNOWN_MESH_PART,
        },
        (_, Discretisation::Unknown) => of_identified,
        _ => Tolerance {
            relative: options.tolerance,
            absolute: 0.0,
            part: 0.0,
        },
    };
    let is_identified = dataset.declared == Discretisation::Unknown && discretisation != Discretisation::Unknown;
    Ok(LabelChecker {
        device: dataset.device,
        simulators,
        discretisation,
        tolerance,
        is_identified,
    })
}

/// Adds a column of meshes if some rows have another mesh than the identified one.
fn with_row_meshes<'a>(
    checker: LabelChecker<'a>,
    dataset: &Dataset<'_>,
    meshes: &BTreeMap<usize, Mesh>,
) -> (LabelChecker<'a>, Columns) {
    let mut columns = dataset.columns.clone();
    let Discretisation::Mesh(usual) = checker.discretisation else {
        return (checker, columns);
    };
    if meshes.is_empty() {
        return (checker, columns);
    }
    let mesh = |index| meshes.get(&index).copied().unwrap_or(usual);
    columns.mesh = Some((0..dataset.len).map(mesh).collect());
    let discretisation = Discretisation::PerRow;
    let checker = LabelChecker {
        discretisation,
        ..checker
    };
    (checker, columns)
}

/// Returns the declared mesh and method, or an identified mesh.
fn discretisation(
    dataset: &Dataset<'_>,
    simulators: &dyn Simulators,
    options: &Options,
    tolerance: Tolerance,
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
    // The search ends early if most rows are unusable.
    for index in order.into_iter().take(4 * PROBES) {
        let row = row(dataset, index)?;
        if row.usable().is_some() && probes.len() < PROBES {
            probes.push(row);
        }
    }
    Ok(identify::mesh(simulators, &probes, tolerance)?.map_or(Discretisation::Unknown, Discretisation::Mesh))
}

/// Reads all rows, computes their properties and compares their labels with simulations.
fn first_pass(
    dataset: &Dataset<'_>,
    checker: &LabelChecker<'_>,
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
        labels.extend(checker.first_pass(&rows, start, &dataset.columns)?);
        facts.extend(found);
        advance(count);
    }
    Ok((facts, labels))
}

/// Chooses the random rows that are simulated on a finer mesh.
fn random_rows(options: &Options, facts: &[Facts]) -> Vec<usize> {
    let usable: Vec<usize> = (0..facts.len()).filter(|&index| facts[index].is_usable()).collect();
    let count = options.samples.unwrap_or(usable.len()).min(usable.len());
    let chosen = Stream::new(options.seed, "audit", 0).choose(usable.len(), count);
    let mut chosen: Vec<usize> = chosen.into_iter().map(|at| usable[at]).collect();
    chosen.sort_unstable();
    chosen
}

fn on_finer_meshes(
    dataset: &Dataset<'_>,
    checker: &LabelChecker<'_>,
    options: &Options,
    chosen: &[usize],
    advance: &(dyn Fn(usize) + Sync),
) -> Result<Vec<Resimulated>, AuditError> {
    let accuracy = match checker.discretisation {
        Discretisation::Unknown => Some(checker.tolerance.absolute),
        _ => options.accuracy,
    };
    let solve = |&index: &usize| {
        let mesh = checker.mesh(&dataset.columns, index);
        let allowed = accuracy.or_else(|| declared_error(&dataset.columns, index, options));
        let solved = resimulate(checker, (index, &row(dataset, index)?), mesh, allowed);
        advance(FINER);
        solved
    };
    let found: Vec<Option<Resimulated>> = chosen.par_iter().map(solve).collect::<Result<_, _>>()?;
    Ok(found.into_iter().flatten().collect())
}

/// Returns the error that a row declares, within the limit. An invalid error counts as 0.
fn declared_error(columns: &Columns, index: usize, options: &Options) -> Option<f64> {
    let declared = columns.error.as_ref()?[index];
    let declared = if declared >= 0.0 { declared } else { 0.0 };
    Some(options.max_declared_error.map_or(declared, |most| declared.min(most)))
}

fn made_by(found: Discretisation, declared: Discretisation) -> String {
    match (found, declared) {
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
        area: Distribution::of(areas, 1.0, 20),
        displacement: Distribution::of(peaks(), peaks().fold(0.0, f64::max), 50),
        ..Summary::default()
    }
}
