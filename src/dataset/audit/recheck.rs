//! Solves rows again: suspects, some rows of each kind, rows that claim to have no field, and rows that may have
//! another mesh than most.

use std::collections::BTreeMap;
use std::ops::Range;

use rayon::prelude::*;

use super::diagnosis::Fault;
use super::error::AuditError;
use super::facts::{CheckedRow, Facts, claims_field};
use super::identify::CANDIDATES;
use super::kinds::{Comparison, MIN_ROWS, kinds, median_and_deviation, suspects};
use super::labels::{LabelCheck, LabelChecker, SolvedLabel};
use super::resimulate::is_wrong;
use super::rows::{Dataset, Discretisation};
use deaflow_base::Stream;
use deaflow_field::Mesh;

/// Suspects per round: at least this number, and this fraction (one in so many) of all rows.
const ROUND: usize = 256;
const ROUND_PART: usize = 20;

/// Another round follows if at least one row in so many of the last round was wrong.
const YIELD: usize = 8;

/// Rows of each kind that are solved again although they are not suspects.
const SPOT_CHECKS: usize = 5;

/// Rows without a field per round.
const ABSENT_ROUND: usize = 64;

/// If no mesh is declared, a label that agrees with the reference mesh within the accuracy is still wrong if its ratio
/// to that solution is an outlier: if it differs from that of its kind by more than this value and this number of
/// deviations. The test applies only to kinds whose deviation is below the last value.
const OUTLYING: f64 = 0.015;
const OUTLYING_DEVIATIONS: f64 = 5.0;
const MAX_DEVIATION: f64 = 0.005;

/// Ratios of a label to the solution on another mesh that the mesh may explain.
const EXPLAINED: Range<f64> = 0.7..1.4;

/// Solves rows of a dataset again.
pub struct Recheck<'a> {
    /// The dataset.
    pub dataset: &'a Dataset<'a>,
    /// The checker of labels.
    pub checker: &'a LabelChecker<'a>,
    /// Seed of the random choices.
    pub seed: u64,
}

impl Recheck<'_> {
    /// Solves rows again on their own meshes, and updates their labels.
    ///
    /// # Errors
    /// When rows cannot be read or a simulator cannot be set up.
    pub fn solve_again(
        &self,
        rows: &[usize],
        labels: &mut [LabelCheck],
    ) -> Result<BTreeMap<usize, SolvedLabel>, AuditError> {
        let solve = |&index: &usize| -> Result<(usize, SolvedLabel), AuditError> {
            let mesh = self.checker.mesh(&self.dataset.columns, index);
            Ok((index, self.checker.solve_again(&row(self.dataset, index)?, mesh)?))
        };
        let solved: BTreeMap<usize, SolvedLabel> = rows.par_iter().map(solve).collect::<Result<_, _>>()?;
        for (&index, solved) in &solved {
            labels[index] = solved.label;
        }
        Ok(solved)
    }

    /// Solves rows again in rounds of `size` rows while enough of them are wrong.
    fn rounds(
        &self,
        rows: &[usize],
        size: usize,
        labels: &mut [LabelCheck],
    ) -> Result<BTreeMap<usize, SolvedLabel>, AuditError> {
        let mut solved = BTreeMap::new();
        for round in rows.chunks(size) {
            solved.extend(self.solve_again(round, labels)?);
            let wrong = round.iter().filter(|&&index| is_wrong(labels[index])).count();
            if YIELD * wrong < round.len() {
                break;
            }
        }
        Ok(solved)
    }

    /// Solves suspects again, and some rows of each kind. If one of these is wrong, it solves the rest of the kind.
    /// Returns the number of suspects, and the number of suspects that were not solved.
    ///
    /// # Errors
    /// As [`Recheck::solve_again`].
    pub fn check_suspects(&self, facts: &[Facts], labels: &mut [LabelCheck]) -> Result<(usize, usize), AuditError> {
        let size = ROUND.max(self.dataset.len / ROUND_PART);
        let kinds = kinds(labels, facts, self.dataset.columns.family.as_deref());
        let suspects = suspects(&kinds);
        let solved = self.rounds(&suspects, size, labels)?;
        for kind in &kinds {
            let open = kind.iter().map(|(index, _)| *index);
            let open = self.shuffled(open.filter(|index| is_open(labels[*index])));
            let (spots, rest) = open.split_at(SPOT_CHECKS.min(open.len()));
            let found = self.solve_again(spots, labels)?;
            if spots.iter().any(|&index| is_wrong(labels[index])) {
                self.rounds(rest, size, labels)?;
            }
            if self.checker.discretisation == Discretisation::Unknown && kind.len() >= MIN_ROWS {
                mark_outliers(kind, &found, &solved, labels);
            }
        }
        let unsolved = suspects.iter().filter(|&&index| is_open(labels[index])).count();
        Ok((suspects.len(), unsolved))
    }

    /// Solves the patterns of rows that claim to have no field.
    ///
    /// # Errors
    /// As [`Recheck::solve_again`].
    pub fn check_absent(&self, facts: &[Facts], labels: &mut [LabelCheck]) -> Result<(), AuditError> {
        let absent = (0..facts.len()).filter(|&index| facts[index].is_pattern && !facts[index].claims_field);
        self.rounds(&self.shuffled(absent), ABSENT_ROUND, labels).map(drop)
    }

    /// Tests rows that are wrong on the identified mesh on the other meshes. A row that agrees on one of them is right.
    /// Returns the meshes of these rows.
    ///
    /// # Errors
    /// As [`Recheck::solve_again`].
    pub fn check_other_meshes(&self, labels: &mut [LabelCheck]) -> Result<BTreeMap<usize, Mesh>, AuditError> {
        let mut meshes = BTreeMap::new();
        if !self.checker.is_identified {
            return Ok(meshes);
        }
        let may_be_explained = |&index: &usize| match labels[index] {
            LabelCheck::Wrong(Fault::Scale(ratio), _) => EXPLAINED.contains(&ratio),
            LabelCheck::Wrong(Fault::Other, _) | LabelCheck::NoSolution => true,
            _ => false,
        };
        let rows = self.shuffled((0..labels.len()).filter(may_be_explained));
        for round in rows.chunks(ROUND) {
            let found = round.par_iter().map(|&index| self.mesh_of(index));
            let found: Vec<Option<(usize, Mesh)>> = found.collect::<Result<_, _>>()?;
            let found: Vec<(usize, Mesh)> = found.into_iter().flatten().collect();
            for (index, mesh) in &found {
                labels[*index] = LabelCheck::Agrees;
                meshes.insert(*index, *mesh);
            }
            if YIELD * found.len() < round.len() {
                break;
            }
        }
        Ok(meshes)
    }

    /// Returns a mesh, other than its own, on which the label of a row agrees.
    fn mesh_of(&self, index: usize) -> Result<Option<(usize, Mesh)>, AuditError> {
        let row = row(self.dataset, index)?;
        let own = self.checker.mesh(&self.dataset.columns, index);
        for mesh in CANDIDATES.into_iter().filter(|mesh| Some(*mesh) != own) {
            if self.checker.solve_again(&row, Some(mesh))?.label == LabelCheck::Agrees {
                return Ok(Some((index, mesh)));
            }
        }
        Ok(None)
    }

    fn shuffled(&self, rows: impl Iterator<Item = usize>) -> Vec<usize> {
        let mut rows: Vec<usize> = rows.collect();
        Stream::new(self.seed, "audit again", 0).shuffle(&mut rows);
        rows
    }
}

/// Reads and checks a row of a dataset.
///
/// # Errors
/// When it cannot be read.
pub fn row(dataset: &Dataset<'_>, index: usize) -> Result<CheckedRow, AuditError> {
    let batch = dataset.rows.read(index..index + 1)?;
    let claims_field = claims_field(&dataset.columns, index);
    Ok(CheckedRow::of(&batch, 0, claims_field, dataset.device))
}

fn is_open(label: LabelCheck) -> bool {
    matches!(label, LabelCheck::Compared { .. })
}

/// Marks suspects as wrong whose ratio to the reference solution differs from the median of the spot checks of their
/// kind.
fn mark_outliers(
    kind: &[Comparison],
    spots: &BTreeMap<usize, SolvedLabel>,
    suspects: &BTreeMap<usize, SolvedLabel>,
    labels: &mut [LabelCheck],
) {
    let estimated: Vec<f64> = kind.iter().map(|(_, numbers)| numbers[0]).collect();
    let reference = spots.values().filter_map(|solved| solved.if_outlier);
    let reference: Vec<f64> = reference.map(|(ratio, _)| ratio).collect();
    let (Some((_, deviation)), Some((median, _))) =
        (median_and_deviation(&estimated), median_and_deviation(&reference))
    else {
        return;
    };
    if deviation > MAX_DEVIATION || median <= 0.0 {
        return;
    }
    let limit = OUTLYING.max(OUTLYING_DEVIATIONS * deviation);
    for (index, _) in kind {
        let Some((ratio, wrong)) = suspects.get(index).and_then(|solved| solved.if_outlier) else {
            continue;
        };
        if labels[*index] == LabelCheck::Agrees && (ratio / median - 1.0).abs() > limit {
            labels[*index] = wrong;
        }
    }
}
