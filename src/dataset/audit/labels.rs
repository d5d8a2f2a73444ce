//! The full pass: every label is compared with a simulation.
//!
//! Where the mesh of a dataset is coarse, each label is solved again on that mesh and has to come out the same, which
//! leaves no room for a wrong one. Where that is too dear, each label is compared with Newton's solution on one
//! biquadratic element per cell. That differs by the discretisation error, which is much alike among patterns that are
//! alike: a label whose difference is an outlier among its like is a suspect, and solved again on its own mesh. So a
//! wrong label is found in either way, and what is found is never a false alarm.

use std::collections::BTreeMap;

use super::diagnosis::{Fault, diagnose, fit, inside};
use super::facts::{Facts, Row};
use super::rows::{Bench, Columns, Declared, Mesh, Wanted};
use super::symmetric::largest_difference;
use crate::field::Field;
use crate::pattern::Pattern;

/// What a solution of the full pass may cost, in solutions with one bilinear element per cell.
const CHEAP: u64 = 5;

/// The mesh of the full pass where the dataset's own is dearer.
pub const SCREEN: Mesh = Mesh::new(1, 2);

/// The mesh that has the last word where nothing is declared.
pub const REFERENCE: Mesh = Mesh::new(4, 2);

/// Displacements below this are rounding, in mm.
const ROUNDING: f64 = 1e-8;

/// How far a label may be from the solution that it should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Part of the largest displacement.
    pub relative: f64,
    /// In mm.
    pub absolute: f64,
}

impl Tolerance {
    /// In mm, for a field with this largest displacement.
    #[must_use]
    pub fn of(&self, peak: f64) -> f64 {
        self.relative * peak + self.absolute + ROUNDING
    }
}

/// What is known of a label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Label {
    /// Nothing: the row has no pattern or no field.
    Absent,
    /// It is what its own mesh gives.
    Agrees,
    /// It is not; by so many mm.
    Wrong(Fault, f64),
    /// Its own mesh gives no stable solution.
    NoSolution,
    /// How it compares with the estimate: its ratio to that, and the part of it that no ratio explains.
    Compared {
        /// Stored over estimated.
        ratio: f64,
        /// Relative to the stored field.
        rest: f64,
    },
}

/// By what labels are judged.
pub struct Judge<'a> {
    /// Simulators.
    pub bench: &'a dyn Bench,
    /// How the fields were found.
    pub declared: Declared,
    /// How exactly.
    pub tolerance: Tolerance,
}

impl Judge<'_> {
    /// The mesh of a row, where it is known.
    #[must_use]
    pub fn mesh(&self, columns: &Columns, index: usize) -> Option<Mesh> {
        match self.declared {
            Declared::Mesh(mesh) | Declared::Estimates(mesh) => Some(mesh),
            Declared::PerRow => columns.mesh.as_ref().map(|meshes| meshes[index]),
            Declared::Unknown => None,
        }
    }

    /// What a label is solved again by, so that it has to come out the same.
    #[must_use]
    pub fn own(&self, mesh: Option<Mesh>) -> Wanted {
        mesh.map_or(Wanted::Newton(REFERENCE), Wanted::Own)
    }

    fn in_full_pass(&self, mesh: Option<Mesh>) -> Wanted {
        let estimates = matches!(self.declared, Declared::Estimates(_));
        match mesh {
            Some(mesh) if estimates || mesh.cost() <= CHEAP => Wanted::Own(mesh),
            _ => Wanted::Newton(SCREEN),
        }
    }

    /// The full pass over some rows, the first of which is row `start` of the dataset.
    ///
    /// # Errors
    /// When a simulator cannot be set up.
    pub fn pass(&self, rows: &[Row], start: usize, columns: &Columns) -> Result<Vec<Label>, String> {
        let mut labels = vec![Label::Absent; rows.len()];
        let mut groups: BTreeMap<Option<Mesh>, Vec<usize>> = BTreeMap::new();
        for (at, _) in rows.iter().enumerate().filter(|(_, row)| row.usable().is_some()) {
            groups.entry(self.mesh(columns, start + at)).or_default().push(at);
        }
        for (mesh, members) in groups {
            let wanted = self.in_full_pass(mesh);
            let pairs: Vec<(&Pattern, &Field)> = members.iter().filter_map(|&at| rows[at].usable()).collect();
            let found = self.against(wanted, &pairs)?;
            for ((at, (_, stored)), truth) in members.into_iter().zip(pairs).zip(found) {
                labels[at] = match (wanted, truth) {
                    (Wanted::Newton(_), truth) => compared(stored, truth.as_ref()),
                    (_, truth) => self.verdict(stored, truth.as_ref()),
                };
            }
        }
        Ok(labels)
    }

    /// A label solved again as it was made, on this mesh.
    ///
    /// # Errors
    /// When a simulator cannot be set up.
    pub fn again(&self, row: &Row, mesh: Option<Mesh>) -> Result<Label, String> {
        let Some(pair) = row.usable() else {
            return Ok(Label::Absent);
        };
        let truth = self.against(self.own(mesh), &[pair])?.pop().flatten();
        Ok(self.verdict(pair.1, truth.as_ref()))
    }

    fn against(&self, wanted: Wanted, pairs: &[(&Pattern, &Field)]) -> Result<Vec<Option<Field>>, String> {
        let patterns: Vec<Pattern> = pairs.iter().map(|(pattern, _)| (*pattern).clone()).collect();
        let simulations = self.bench.simulator(wanted)?.simulate(&patterns);
        Ok(simulations.into_iter().map(|simulation| simulation.field).collect())
    }

    /// The frame has a check of its own, so it does not count here.
    fn verdict(&self, stored: &Field, truth: Option<&Field>) -> Label {
        let Some(truth) = truth else {
            return Label::NoSolution;
        };
        let stored = inside(stored);
        let off = largest_difference(&stored, &inside(truth));
        if off <= self.tolerance.of(truth.max_magnitude()) {
            return Label::Agrees;
        }
        Label::Wrong(diagnose(&stored, truth), off)
    }
}

/// A field beside an estimate of it.
fn compared(stored: &Field, estimate: Option<&Field>) -> Label {
    let Some(estimate) = estimate else {
        return Label::Compared { ratio: 0.0, rest: 1.0 };
    };
    if stored.max_magnitude().max(estimate.max_magnitude()) <= ROUNDING {
        return Label::Agrees;
    }
    let (ratio, rest) = fit(&inside(stored), estimate);
    Label::Compared { ratio, rest }
}

/// Fewer rows of a kind than this say nothing of what is usual among them: all of them are suspects.
const FEWEST: usize = 12;

/// Deviations by which a row is an outlier: so many robust standard deviations, and so much more.
const DEVIATIONS: f64 = 4.0;
const MARGIN: f64 = 2e-3;

/// A row with its ratio and rest.
type Comparison = (usize, [f64; 2]);

/// The rows that compare with their estimates otherwise than their like, the most unlike first.
///
/// Rows are alike that are of one family or, where that is not known, whose patterns have as many edges but for a factor
/// of two.
#[must_use]
pub fn suspects(labels: &[Label], facts: &[Facts], families: Option<&[String]>) -> Vec<usize> {
    let mut kinds: BTreeMap<(&str, u32), Vec<Comparison>> = BTreeMap::new();
    for (index, label) in labels.iter().enumerate() {
        if let Label::Compared { ratio, rest } = label {
            let kind = match families {
                Some(families) => (families[index].as_str(), 0),
                None => ("", facts[index].edges.max(1).ilog2()),
            };
            kinds.entry(kind).or_default().push((index, [*ratio, *rest]));
        }
    }
    let mut found: Vec<(f64, usize)> = kinds.into_values().flat_map(outliers).collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    found.into_iter().map(|(_, index)| index).collect()
}

/// The outliers among rows of one kind, with how far out they are.
fn outliers(rows: Vec<Comparison>) -> Vec<(f64, usize)> {
    if rows.len() < FEWEST {
        return rows.into_iter().map(|(index, _)| (0.0, index)).collect();
    }
    let usual = [0, 1].map(|k: usize| {
        let values: Vec<f64> = rows.iter().map(|(_, numbers)| numbers[k]).collect();
        let middle = median(values.clone());
        let spread = 1.4826 * median(values.iter().map(|v| (v - middle).abs()).collect());
        (middle, DEVIATIONS * spread + MARGIN)
    });
    let out = |numbers: &[f64; 2]| {
        let ratio = (numbers[0] - usual[0].0).abs() / usual[0].1;
        // A label that is nearer to its estimate than usual is no worse for that.
        ratio.max((numbers[1] - usual[1].0) / usual[1].1)
    };
    let all = rows.iter().map(|(index, numbers)| (out(numbers), *index));
    all.filter(|(out, _)| *out > 1.0).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_are_told_from_the_spread_of_their_like() {
        let rows: Vec<Comparison> = (0..40)
            .map(|i| {
                let wave = 1e-3 * (i as f64).sin();
                (i, [0.96 + wave + if i == 7 { 0.029 } else { 0.0 }, 0.02 + wave])
            })
            .collect();
        let found: Vec<usize> = outliers(rows.clone()).iter().map(|(_, index)| *index).collect();
        assert_eq!(found, [7]);
        assert_eq!(outliers(rows[..5].to_vec()).len(), 5, "too few to say what is usual");
    }
}
