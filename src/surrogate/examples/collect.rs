//! From rows of datasets to the examples of a training: which part of it each belongs to, less those that nobody should learn
//! from.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use rayon::prelude::*;

use super::left_out::{LeftOut, Why};
use crate::example::{Example, Label, LabelError};
use crate::labels::implausible;
use deaflow_base::OrbitId;
use deaflow_dataset::Split;
use deaflow_pattern::{Pattern, Symmetries, Symmetry};

/// Names the split of solved samples. It is the same for all trainings, so that networks of other seeds and other training sets
/// are tested on patterns that none of them has seen.
pub const SPLIT_SEED: u64 = 0;

/// A row of a dataset.
#[derive(Clone, Debug)]
pub struct LabelledRow {
    /// Which input, from 0.
    pub input: usize,
    /// Which of its rows, from 0.
    pub row: usize,
    /// The pattern.
    pub pattern: Pattern,
    /// The family it was drawn from.
    pub family: String,
    /// What kind of dataset the row stands in.
    pub origin: Origin,
    /// Its label.
    pub label: Result<Label, LabelError>,
    /// Which sample of the input it says to be an image of, and by which symmetry.
    pub image: Option<(u64, Symmetry)>,
}

/// What kind of dataset a row stands in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// A balanced set, which says what part the row belongs to.
    Balanced(Split),
    /// Solved samples.
    Solved {
        /// Whether the simulation came to a field.
        converged: bool,
    },
    /// Verified designs.
    Verified,
}

/// What a training learns from.
#[derive(Debug)]
pub struct Examples {
    /// The examples, in the order of the inputs.
    pub examples: Vec<Example>,
    /// Samples without a stable solution, which have no label.
    pub unstable: u64,
    /// Labels that were left out.
    pub left_out: Vec<LeftOut>,
}

/// Nothing is left to learn from; why.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no label to learn from{why}")]
pub struct NoExamples {
    why: String,
    /// Whether it is only that no sample has a stable solution.
    pub all_unstable: bool,
}

/// Takes the rows of datasets, one input after the other.
///
/// The split of balanced rows is theirs; a solved sample has that of its orbit in the balanced inputs, or one drawn for its orbit.
/// All images of a pattern are in one part, whichever inputs they stand in. Verified designs are learnt from, each pattern once;
/// one that has an image in the other inputs that is held out is left out. So what is held out is the same with them and without.
#[derive(Debug)]
pub struct Collector {
    /// What maps the device to itself.
    symmetries: Symmetries,
    inputs: usize,
    rows: Vec<Row>,
    /// By input and sample, the first label of an image of the sample, and by which symmetry it is one.
    of_samples: HashMap<(usize, u64), (Label, Symmetry)>,
    unstable: u64,
    left_out: Vec<LeftOut>,
}

/// A row with a label.
#[derive(Debug)]
struct Row {
    place: SamplePosition,
    pattern: Pattern,
    label: Label,
    family: String,
    origin: Origin,
}

/// Where a row stands: input and row.
#[derive(Clone, Copy, Debug)]
struct SamplePosition(usize, usize);

impl SamplePosition {
    fn left_out(self, found_mm: f64, why: Why) -> LeftOut {
        let Self(input, row) = self;
        LeftOut {
            input,
            row,
            found_mm,
            why,
        }
    }
}

impl Collector {
    /// Nothing taken yet, of a device with these symmetries.
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

    /// Begins an input, in which so many samples have no stable solution.
    pub fn begin(&mut self, unstable: u64) {
        self.inputs += 1;
        self.unstable += unstable;
    }

    /// Takes a row. Verified patterns that are there already are not taken again, since every round verifies the intuitive
    /// designs.
    ///
    /// # Errors
    /// When the label has not as many values as a field.
    pub fn add(&mut self, row: LabelledRow) -> Result<(), LabelError> {
        let is_again = |other: &Row| other.origin == Origin::Verified && other.pattern == row.pattern;
        if row.origin == Origin::Verified && self.rows.iter().any(is_again) {
            return Ok(());
        }
        let place = SamplePosition(row.input, row.row);
        let (found_mm, why) = match (row.origin, row.label) {
            (Origin::Solved { converged: false }, _) => (0.0, Why::NotConverged),
            (_, Err(LabelError::Frame(found_mm))) => (found_mm, Why::Frame),
            (_, Err(LabelError::NotFinite(_))) => (0.0, Why::NotFinite),
            (_, Err(error @ LabelError::Shape { .. })) => return Err(error),
            (origin, Ok(label)) => {
                let label = match row.image {
                    Some((sample, symmetry)) => self.shared(label, (row.input, sample), symmetry),
                    None => label,
                };
                self.rows.push(Row {
                    place,
                    pattern: row.pattern,
                    label,
                    family: row.family,
                    origin,
                });
                return Ok(());
            }
        };
        self.left_out.push(place.left_out(found_mm, why));
        Ok(())
    }

    /// A label that is an image of a sample by a symmetry, in the memory of the first image of that sample.
    fn shared(&mut self, label: Label, sample: (usize, u64), symmetry: Symmetry) -> Label {
        match self.of_samples.entry(sample) {
            Entry::Occupied(known) => {
                let (first, of_first) = known.get();
                label.sharing(first, symmetry.compose(of_first.inverse()))
            }
            Entry::Vacant(place) => {
                place.insert((label.clone(), symmetry));
                label
            }
        }
    }

    /// The examples, for a membrane of that longer side in mm. An epoch shows a verified design `verified_weight` times.
    ///
    /// # Errors
    /// When nothing is left.
    pub fn finish(mut self, side_mm: f64, verified_weight: u32) -> Result<Examples, NoExamples> {
        let splits = self.splits();
        let (mut examples, mut places) = (Vec::with_capacity(splits.len()), Vec::with_capacity(splits.len()));
        for (row, split) in self.rows.into_iter().zip(splits) {
            let is_verified = row.origin == Origin::Verified;
            if is_verified && split != Split::Train {
                self.left_out.push(row.place.left_out(0.0, Why::HeldOut));
                continue;
            }
            places.push((row.place, is_verified));
            examples.push(Example {
                pattern: row.pattern,
                label: row.label,
                family: row.family,
                split,
                repeats: if is_verified { verified_weight } else { 1 },
            });
        }
        leave_out_implausible(&mut examples, &places, side_mm, &mut self.left_out);
        self.left_out.sort_by_key(|left_out| (left_out.input, left_out.row));
        if examples.is_empty() {
            return Err(nothing(self.unstable, &self.left_out));
        }
        Ok(Examples {
            examples,
            unstable: self.unstable,
            left_out: self.left_out,
        })
    }

    /// The part of each row. Balanced inputs that disagree about an orbit are settled by the first. Verified rows follow the
    /// others; an orbit that only they have is learnt from.
    fn splits(&self) -> Vec<Split> {
        let of_row = |row: &Row| match row.origin {
            Origin::Balanced(split) => Some(split),
            Origin::Solved { .. } | Origin::Verified => None,
        };
        let own: Option<Vec<Split>> = self.rows.iter().map(of_row).collect();
        if let (Some(own), 1) = (own, self.inputs) {
            return own;
        }
        let orbits: Vec<OrbitId> = self
            .rows
            .par_iter()
            .map(|row| row.pattern.orbit(self.symmetries))
            .collect();
        let mut known = HashMap::new();
        for (row, orbit) in self.rows.iter().zip(&orbits) {
            if let Some(split) = of_row(row) {
                known.entry(*orbit).or_insert(split);
            }
        }
        for (row, orbit) in self.rows.iter().zip(&orbits) {
            if row.origin != Origin::Verified {
                known.entry(*orbit).or_insert_with(|| Split::of(orbit, SPLIT_SEED));
            }
        }
        let part = |orbit: &OrbitId| known.get(orbit).copied().unwrap_or(Split::Train);
        orbits.iter().map(part).collect()
    }
}

/// A verified design was simulated with care, and designs move farther than patterns that are drawn: it need only lie within the
/// membrane. `places` say of each example where it stands and whether it was verified.
fn leave_out_implausible(
    examples: &mut Vec<Example>,
    places: &[(SamplePosition, bool)],
    side_mm: f64,
    left_out: &mut Vec<LeftOut>,
) {
    let mut refused = implausible(examples, side_mm);
    refused.retain(|refused| refused.physical || !places[refused.index].1);
    let mut refused = refused.iter().peekable();
    let mut index = 0;
    examples.retain(|_| {
        let here = refused.next_if(|refused| refused.index == index);
        if let Some(here) = here {
            let why = if here.physical { Why::BeyondSide } else { Why::Outlier };
            left_out.push(places[index].0.left_out(here.found_mm, why(here.limit_mm)));
        }
        index += 1;
        here.is_none()
    });
}

fn nothing(unstable: u64, left_out: &[LeftOut]) -> NoExamples {
    let mut text = String::new();
    if unstable > 0 {
        text += &format!("; {unstable} samples have no stable solution");
    }
    for left_out in left_out.iter().take(3) {
        text += &format!("; {left_out}");
    }
    NoExamples {
        why: text,
        all_unstable: unstable > 0 && left_out.is_empty(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    #[test]
    fn images_of_a_sample_are_in_one_memory_and_labels_that_only_claim_to_be_are_not() {
        let raster = Raster::PAPER;
        let pattern = Pattern::from_fn(raster, |x, y| x + 2 * y < 40);
        let mut values = vec![0.0; 2 * raster.corners()];
        values[2 * (51 * 7 + 3)] = 0.25;
        let label = Label::from_values(raster, &values).unwrap();
        let mut collector = Collector::new(Symmetries::SQUARE);
        collector.begin(0);
        let mut expected = Vec::new();
        // Of sample 4 eight images and a label that is none of it; of sample 5 the same field again.
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
                origin: Origin::Balanced(Split::Train),
                label: Ok(label),
                image: Some((sample, symmetry)),
            };
            collector.add(row).unwrap();
        }
        let found: Vec<Label> = collector
            .finish(50.0, 1)
            .unwrap()
            .examples
            .into_iter()
            .map(|e| e.label)
            .collect();
        assert_eq!(found, expected);
        let shared: Vec<bool> = found.iter().map(|label| label.shares_memory_with(&found[0])).collect();
        assert_eq!(shared, [true, true, true, true, true, true, true, true, false, false]);
    }

    /// The numbers of a field whose inside is a label.
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
