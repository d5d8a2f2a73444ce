//! What is solved again: suspects, some rows of each kind whatever they look like, rows that claim to have no field, and
//! rows that may stand on another mesh than most.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::diagnosis::Fault;
use super::error::AuditError;
use super::facts::{CheckedRow, Facts, claims_field};
use super::identify::TRIED;
use super::kinds::{Comparison, FEWEST, kinds, suspects, usual};
use super::labels::{Judge, LabelCheck, Solved};
use super::resimulate::is_wrong;
use super::rows::{Dataset, Discretisation};
use deaflow_base::Stream;
use deaflow_field::Mesh;

/// Suspects that are solved again in one round at the least, and as a part of all rows.
const ROUND: usize = 256;
const ROUND_PART: usize = 20;

/// Rounds go on where one row in so many of the last was what was looked for.
const WORTH: usize = 8;

/// Rows of each kind that are solved again although they do not stand out.
const SPOTS: usize = 5;

/// Rows that claim no field and are solved in one round.
const ABSENT_ROUND: usize = 64;

/// Nothing is declared, and a label agrees with the finest mesh to the accuracy: it is wrong all the same where its ratio to
/// that differs from its kind's by more than so much, and so many of the kind's deviations, while these are small.
const OUTLYING: f64 = 0.015;
const OUTLYING_DEVIATIONS: f64 = 5.0;
const ALIKE: f64 = 0.005;

/// Ratios of a label to the solution on another mesh that the mesh may explain.
const EXPLAINED: std::ops::Range<f64> = 0.7..1.4;

/// A dataset, and by what its labels are judged.
pub struct Recheck<'a> {
    /// The rows.
    pub dataset: &'a Dataset<'a>,
    /// The judge.
    pub judge: &'a Judge<'a>,
    /// Names the random choices.
    pub seed: u64,
}

impl Recheck<'_> {
    /// One row.
    ///
    /// # Errors
    /// When it cannot be read; why.
    pub fn row(&self, index: usize) -> Result<CheckedRow, AuditError> {
        row(self.dataset, index)
    }

    /// Solves rows again as they were made.
    ///
    /// # Errors
    /// When rows cannot be read or a simulator cannot be set up; why.
    pub fn again(&self, rows: &[usize], labels: &mut [LabelCheck]) -> Result<BTreeMap<usize, Solved>, AuditError> {
        let solved = |&index: &usize| -> Result<(usize, Solved), AuditError> {
            let mesh = self.judge.mesh(&self.dataset.columns, index);
            Ok((index, self.judge.again(&self.row(index)?, mesh)?))
        };
        let found: Result<BTreeMap<usize, Solved>, AuditError> = rows.par_iter().map(solved).collect();
        let found = found?;
        for (&index, solved) in &found {
            labels[index] = solved.label;
        }
        Ok(found)
    }

    /// The same in rounds, as long as enough of them are wrong; gives what was solved.
    fn rounds(
        &self,
        rows: &[usize],
        most: usize,
        labels: &mut [LabelCheck],
    ) -> Result<BTreeMap<usize, Solved>, AuditError> {
        let mut solved = BTreeMap::new();
        for round in rows.chunks(most) {
            solved.extend(self.again(round, labels)?);
            let wrong = round.iter().filter(|&&index| is_wrong(labels[index])).count();
            if WORTH * wrong < round.len() {
                break;
            }
        }
        Ok(solved)
    }

    /// Solves suspects again, and some rows of each kind: where one of these is wrong, the rest of the kind too. Gives how
    /// many suspects there were, and how many of them were not solved.
    ///
    /// # Errors
    /// As of [`Recheck::again`].
    pub fn confirm(&self, facts: &[Facts], labels: &mut [LabelCheck]) -> Result<(usize, usize), AuditError> {
        let most = ROUND.max(self.dataset.len / ROUND_PART);
        let kinds = kinds(labels, facts, self.dataset.columns.family.as_deref());
        let suspects = suspects(&kinds);
        let solved = self.rounds(&suspects, most, labels)?;
        for kind in &kinds {
            let others: Vec<usize> = kind.iter().map(|(index, _)| *index).collect();
            let others: Vec<usize> = self.shuffled(others.into_iter().filter(|index| is_open(labels[*index])));
            let (spots, rest) = others.split_at(SPOTS.min(others.len()));
            let found = self.again(spots, labels)?;
            if spots.iter().any(|&index| is_wrong(labels[index])) {
                self.rounds(rest, most, labels)?;
            }
            if self.judge.declared == Discretisation::Unknown && kind.len() >= FEWEST {
                mark_outliers(kind, &found, &solved, labels);
            }
        }
        let unsolved = suspects.iter().filter(|&&index| is_open(labels[index])).count();
        Ok((suspects.len(), unsolved))
    }

    /// Solves the patterns of rows that claim to have no field.
    ///
    /// # Errors
    /// As of [`Recheck::again`].
    pub fn absent(&self, facts: &[Facts], labels: &mut [LabelCheck]) -> Result<(), AuditError> {
        let absent = (0..facts.len()).filter(|&index| facts[index].is_pattern && !facts[index].claims_field);
        self.rounds(&self.shuffled(absent), ABSENT_ROUND, labels).map(drop)
    }

    /// Tries rows that are wrong on the mesh that was found out on the others: they are right if they come out on one. Gives
    /// the meshes of these.
    ///
    /// # Errors
    /// As of [`Recheck::again`].
    pub fn elsewhere(&self, labels: &mut [LabelCheck]) -> Result<BTreeMap<usize, Mesh>, AuditError> {
        let mut moved = BTreeMap::new();
        if !self.judge.found_out {
            return Ok(moved);
        }
        let explained = |&index: &usize| match labels[index] {
            LabelCheck::Wrong(Fault::Scale(ratio), _) => EXPLAINED.contains(&ratio),
            LabelCheck::Wrong(Fault::Other, _) | LabelCheck::NoSolution => true,
            _ => false,
        };
        let rows = self.shuffled((0..labels.len()).filter(explained));
        for round in rows.chunks(ROUND) {
            let found: Result<Vec<Option<(usize, Mesh)>>, AuditError> =
                round.par_iter().map(|&index| self.mesh_of(index)).collect();
            let found: Vec<(usize, Mesh)> = found?.into_iter().flatten().collect();
            for (index, mesh) in &found {
                labels[*index] = LabelCheck::Agrees;
                moved.insert(*index, *mesh);
            }
            if WORTH * found.len() < round.len() {
                break;
            }
        }
        Ok(moved)
    }

    fn mesh_of(&self, index: usize) -> Result<Option<(usize, Mesh)>, AuditError> {
        let row = self.row(index)?;
        let own = self.judge.mesh(&self.dataset.columns, index);
        for mesh in TRIED.into_iter().filter(|mesh| Some(*mesh) != own) {
            if self.judge.again(&row, Some(mesh))?.label == LabelCheck::Agrees {
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

/// One row of a dataset.
///
/// # Errors
/// When it cannot be read; why.
pub fn row(dataset: &Dataset<'_>, index: usize) -> Result<CheckedRow, AuditError> {
    let batch = dataset.rows.read(index..index + 1)?;
    Ok(CheckedRow::of(
        &batch,
        0,
        claims_field(&dataset.columns, index),
        dataset.device,
    ))
}

fn is_open(label: LabelCheck) -> bool {
    matches!(label, LabelCheck::Compared { .. })
}

/// Calls suspects wrong whose ratio to the finest mesh is not that of their kind, told by the rows in `spots`.
fn mark_outliers(
    kind: &[Comparison],
    spots: &BTreeMap<usize, Solved>,
    suspects: &BTreeMap<usize, Solved>,
    labels: &mut [LabelCheck],
) {
    let ratios = |solved: &Solved| solved.otherwise.map(|(ratio, _)| ratio);
    let estimated: Vec<f64> = kind.iter().map(|(_, numbers)| numbers[0]).collect();
    let fine: Vec<f64> = spots.values().filter_map(ratios).collect();
    let (Some((_, spread)), Some((middle, _))) = (usual(&estimated), usual(&fine)) else {
        return;
    };
    if spread > ALIKE || middle <= 0.0 {
        return;
    }
    for (index, _) in kind {
        let Some((ratio, wrong)) = suspects.get(index).and_then(|solved| solved.otherwise) else {
            continue;
        };
        if labels[*index] == LabelCheck::Agrees
            && (ratio / middle - 1.0).abs() > OUTLYING.max(OUTLYING_DEVIATIONS * spread)
        {
            labels[*index] = wrong;
        }
    }
}
