//! Collects the examples of a training from rows of datasets: assigns splits and excludes wrong labels.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use rayon::prelude::*;

use super::left_out::{LeftOut, LeftOutReason};
use crate::example::{Example, Label, LabelError};
use crate::plausibility::implausible;
use deaflow_base::OrbitId;
use deaflow_dataset::Split;
use deaflow_pattern::{Pattern, Symmetries, Symmetry};

/// Seed of the split of solved samples. It is the same for all trainings, so that networks with other seeds and other
/// training sets are tested on patterns that none of them was trained on.
pub const SPLIT_SEED: u64 = 0;

/// A row of a dataset.
#[derive(Clone, Debug)]
pub struct LabelledRow {
    /// Index of the input.
    pub input: usize,
    /// Index of the row in the input.
    pub row: usize,
    /// The pattern.
    pub pattern: Pattern,
    /// The family of the pattern.
    pub family: String,
    /// The kind of the row.
    pub kind: RowKind,
    /// The label.
    pub label: Result<Label, LabelError>,
    /// The sample of the input of which the row is an image, and the symmetry, as the dataset states.
    pub image: Option<(u64, Symmetry)>,
}

/// Kind of a row of a dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RowKind {
    /// A row of a balanced dataset, with its split.
    Balanced(Split),
    /// A solved sample.
    Solved {
        /// Whether the simulation converged.
        converged: bool,
    },
    /// A verified design.
    Verified,
}

/// The examples of a training.
#[derive(Debug)]
pub struct Examples {
    /// The examples, in the order of the inputs.
    pub examples: Vec<Example>,
    /// Number of samples without a stable solution, which have no label.
    pub unstable: u64,
    /// Excluded labels.
    pub left_out: Vec<LeftOut>,
}

/// All labels are excluded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there are no labels to train on{reasons}")]
pub struct NoExamples {
    reasons: String,
    /// Whether the only reason is that no sample has a stable solution.
    pub all_unstable: bool,
}

/// Collects the rows of datasets, input by input.
///
/// Balanced rows keep their split. A solved sample takes the split of its orbit in the balanced inputs, or a random
/// one per orbit. So all images of a pattern are in one split. Verified designs are training examples, each pattern
/// once, unless an image of the pattern is in the validation or test split of the other inputs. So verified designs do
/// not change these splits.
#[derive(Debug)]
pub struct Collector {
    /// Symmetries of the device.
    symmetries: Symmetries,
    inputs: usize,
    rows: Vec<Row>,
    /// By input and sample: the first label of an image of the sample, and its symmetry.
    of_samples: HashMap<(usize, u64), (Label, Symmetry)>,
    unstable: u64,
    left_out: Vec<LeftOut>,
}

/// A row with a valid label.
#[derive(Debug)]
struct Row {
    position: RowPosition,
    pattern: Pattern,
    label: Label,
    family: String,
    kind: RowKind,
}

/// Index of the input and of the row.
#[derive(Clone, Copy, Debug)]
struct RowPosition(usize, usize);

impl RowPosition {
    fn left_out(self, found_mm: f64, reason: LeftOutReason) -> LeftOut {
        let Self(input, row) = self;
        LeftOut {
            input,
            row,
            found_mm,
            reason,
        }
    }
}

impl Collector {
    /// Creates a collector for a device with these symmetries.
    #[must_use]
    pub fn new(symmetries: Symmetries) -> Self {
        Self {
            symmetries,
            inputs: 0,
            rows: Vec::new(),
            of_samples: HashMap::new(),
            unstable: 0,
            left_out: Vec::new(),
        }
    }

    /// Begins an input with `unstable` samples without a stable solution.
    pub fn begin_input(&mut self, unstable: u64) {
        self.inputs += 1;
        self.unstable += unstable;
    }

    /// Adds a row. A verified pattern is added once, because every round verifies the reference designs again.
    ///
    /// # Errors
    /// When the number of values of the label is wrong.
    pub fn add(&mut self, row: LabelledRow) -> Result<(), LabelError> {
        let is_same = |other: &Row| other.kind == RowKind::Verified && other.pattern == row.pattern;
        if row.kind == RowKind::Verified && self.rows.iter().any(is_same) {
            return Ok(());
        }
        let position = RowPosition(row.input, row.row);
        let (found_mm, reason) = match (row.kind, row.label) {
            (RowKind::Solved { converged: false }, _) => (0.0, LeftOutReason::NotConverged),
            (_, Err(LabelError::Frame(found_mm))) => (found_mm, LeftOutReason::Frame),
            (_, Err(LabelError::NotFinite(_))) => (0.0, LeftOutReason::NotFinite),
            (_, Err(error @ LabelError::Shape { .. })) => return Err(error),
            (kind, Ok(label)) => {
                let label = match row.image {
                    Some((sample, symmetry)) => self.shared(label, (row.input, sample), symmetry),
                    None => label,
                };
                self.rows.push(Row {
                    position,
                    pattern: row.pattern,
                    label,
                    family: row.family,
                    kind,
                });
                return Ok(());
            }
        };
        self.left_out.push(position.left_out(found_mm, reason));
        Ok(())
    }

    /// Returns the label in the memory of the first image of its sample, if it is an image of that sample.
    fn shared(&mut self, label: Label, sample: (usize, u64), symmetry: Symmetry) -> Label {
        match self.of_samples.entry(sample) {
            Entry::Occupied(known) => {
                let (first, of_first) = known.get();
                label.sharing(first, symmetry.compose(of_first.inverse()))
            }
            Entry::Vacant(entry) => {
                entry.insert((label.clone(), symmetry));
                label
            }
        }
    }

    /// Returns the examples. `side_mm` is the longer side of the membrane. An epoch uses a verified design
    /// `verified_weight` times.
    ///
    /// # Errors
    /// When there are no examples.
    pub fn finish(mut self, side_mm: f64, verified_weight: u32) -> Result<Examples, NoExamples> {
        let splits = self.splits();
        let (mut examples, mut positions) = (Vec::with_capacity(splits.len()), Vec::with_capacity(splits.len()));
        for (row, split) in self.rows.into_iter().zip(splits) {
            let is_verified = row.kind == RowKind::Verified;
            if is_verified && split != Split::Train {
                self.left_out.push(row.position.left_out(0.0, LeftOutReason::HeldOut));
                continue;
            }
            positions.push((row.position, is_verified));
            examples.push(Example {
                pattern: row.pattern,
                label: row.label,
                family: row.family,
                split,
                repeats: if is_verified { verified_weight } else { 1 },
            });
        }
        remove_implausible(&mut examples, &positions, side_mm, &mut self.left_out);
        self.left_out.sort_by_key(|left_out| (left_out.input, left_out.row));
        if examples.is_empty() {
            return Err(no_examples(self.unstable, &self.left_out));
        }
        Ok(Examples {
            examples,
            unstable: self.unstable,
            left_out: self.left_out,
        })
    }

    /// Returns the split of each row. Where balanced inputs disagree about an orbit, the first decides. Verified rows
    /// follow the others; an orbit of verified rows only is in the training split.
    fn splits(&self) -> Vec<Split> {
        let of_row = |row: &Row| match row.kind {
            RowKind::Balanced(split) => Some(split),
            RowKind::Solved { .. } | RowKind::Verified => None,
        };
        let own: Option<Vec<Split>> = self.rows.iter().map(of_row).collect();
        if let (Some(own), 1) = (own, self.inputs) {
            return own;
        }
        let rows = self.rows.par_iter();
        let orbits: Vec<OrbitId> = rows.map(|row| row.pattern.orbit(self.symmetries)).collect();
        let mut known = HashMap::new();
        for (row, orbit) in self.rows.iter().zip(&orbits) {
            if let Some(split) = of_row(row) {
                known.entry(*orbit).or_insert(split);
            }
        }
        for (row, orbit) in self.rows.iter().zip(&orbits) {
            if row.kind != RowKind::Verified {
                known.entry(*orbit).or_insert_with(|| Split::of(orbit, SPLIT_SEED));
            }
        }
        let split = |orbit: &OrbitId| known.get(orbit).copied().unwrap_or(Split::Train);
        orbits.iter().map(split).collect()
    }
}

/// Removes examples with implausible labels. `positions` holds for each example its position and whether it is a
/// verified design. Designs move farther than random patterns and their simulations are verified, so only the side
/// limits them.
fn remove_implausible(
    examples: &mut Vec<Example>,
    positions: &[(RowPosition, bool)],
    side_mm: f64,
    left_out: &mut Vec<LeftOut>,
) {
    let mut wrong = implausible(examples, side_mm);
    wrong.retain(|wrong| wrong.exceeds_side || !positions[wrong.index].1);
    let mut wrong = wrong.iter().peekable();
    let mut index = 0;
    examples.retain(|_| {
        let here = wrong.next_if(|wrong| wrong.index == index);
        if let Some(here) = here {
            let reason = match here.exceeds_side {
                true => LeftOutReason::BeyondSide(here.limit_mm),
                false => LeftOutReason::Outlier(here.limit_mm),
            };
            left_out.push(positions[index].0.left_out(here.found_mm, reason));
        }
        index += 1;
        here.is_none()
    });
}

fn no_examples(unstable: u64, left_out: &[LeftOut]) -> NoExamples {
    let mut reasons = String::new();
    if unstable > 0 {
        reasons += &format!("; {unstable} samples have no stable solution");
    }
    for left_out in left_out.iter().take(3) {
        reasons += &format!("; {left_out}");
    }
    NoExamples {
        reasons,
        all_unstable: unstable > 0 && left_out.is_empty(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    #[test]
    fn images_of_a_sample_share_memory_and_other_labels_do_not() {
        let raster = Raster::PAPER;
        let pattern = Pattern::from_fn(raster, |x, y| x + 2 * y < 40);
        let mut values = vec![0.0; 2 * raster.corners()];
        values[2 * (51 * 7 + 3)] = 0.25;
        let label = Label::from_values(raster, &values).unwrap();
        let mut collector = Collector::new(Symmetries::SQUARE);
        collector.begin_input(0);
        let mut expected = Vec::new();
        // Eight images of sample 4 and a label that is not an image of it; the same field as sample 5.
        let images = Symmetry::ALL.map(|g| (4, g, label.transformed(g)));
        let others = [
            (4, Symmetry::ALL[1], label.clone()),
            (5, Symmetry::IDENTITY, label.clone()),
        ];
        for (row, (sample, symmetry, label)) in images.into_iter().chain(others).enumerate() {
            let label = Label::from_values(raster, &of_field(&label)).unwrap();
            expected.push(label.clone());
            let row = LabelledRow {
                input: 0,
                row,
                pattern: pattern.transformed(symmetry),
                family: "grid".to_owned(),
                kind: RowKind::Balanced(Split::Train),
                label: Ok(label),
                image: Some((sample, symmetry)),
            };
            collector.add(row).unwrap();
        }
        let examples = collector.finish(50.0, 1).unwrap().examples;
        let found: Vec<Label> = examples.into_iter().map(|example| example.label).collect();
        assert_eq!(found, expected);
        let shared: Vec<bool> = found.iter().map(|label| label.shares_memory_with(&found[0])).collect();
        assert_eq!(shared, [true, true, true, true, true, true, true, true, false, false]);
    }

    /// The values of a field with a given label.
    fn of_field(label: &Label) -> Vec<f64> {
        let [columns, rows] = label.raster().sides();
        let mut values = vec![0.0; 2 * label.raster().corners()];
        for (at, u) in label.values().iter().enumerate() {
            let (x, y) = (at / 2 % (columns - 1) + 1, at / 2 / (columns - 1) + 1);
            assert!(y < rows);
            values[2 * (y * (columns + 1) + x) + at % 2] = f64::from(*u);
        }
        values
    }
}
