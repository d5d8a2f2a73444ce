//! The examples of a training: rows of balanced sets, of solved samples and of verified designs, less those that nobody should
//! learn from.

mod left_out;
mod verified;

pub use left_out::{LeftOut, Why};

use std::collections::HashMap;

use rayon::prelude::*;

use crate::base::OrbitId;
use crate::dataset::Split;
use crate::field::CORNERS;
use crate::orchestrator::StageError;
use crate::pattern::Pattern;
use crate::stage::{arrays, model};
use crate::store::{Artifact, RowFile};
use crate::surrogate::{Example, Label, LabelError, implausible};

/// Rows that are read together: some tens of megabytes.
const BLOCK: usize = 512;

/// Names the split of solved samples. It is the same for all trainings, so that networks of other seeds and other training sets
/// are tested on patterns that none of them has seen.
const SPLIT_SEED: u64 = 0;

/// What a training learns from.
pub struct Examples {
    /// The examples, in the order of the inputs.
    pub examples: Vec<Example>,
    /// Samples without a stable solution, which have no label.
    pub unstable: u64,
    /// Labels that were left out.
    pub left_out: Vec<LeftOut>,
}

/// Reads the examples of all inputs. The split of balanced rows is theirs; a solved sample has that of its orbit in the balanced
/// inputs, or one drawn for its orbit. All images of a pattern are in one part, whichever inputs they stand in.
///
/// Verified designs are learnt from, each pattern once, and shown `verified_weight` times in an epoch; one that has an image in the
/// other inputs that is held out is left out. So what is held out is the same with them and without.
///
/// # Errors
/// When an input lacks what is needed, its arrays do not fit together, or nothing is left.
pub fn read(inputs: &[Artifact], side_mm: f64, verified_weight: u32) -> Result<Examples, StageError> {
    let mut rows = Vec::new();
    let mut found = Examples {
        examples: Vec::new(),
        unstable: 0,
        left_out: Vec::new(),
    };
    let mut datasets = 0;
    for (input, artifact) in inputs.iter().enumerate() {
        if model::is_in(artifact) {
            continue;
        }
        datasets += 1;
        if artifact.kind() == "verify" {
            found.unstable += verified::read(artifact, input, &mut rows, &mut found.left_out)?;
            continue;
        }
        if !is_balanced(artifact) {
            found.unstable += artifact
                .content("unstable/outcome")?
                .shape
                .first()
                .copied()
                .unwrap_or_default() as u64;
        }
        let parts = if artifact.is_manifest() {
            artifact.chunks()?
        } else {
            std::slice::from_ref(artifact)
        };
        let mut first = 0;
        for part in parts {
            first += read_part(part, (input, first), &mut rows, &mut found.left_out)?;
        }
    }
    let splits = splits(&rows, datasets == 1);
    let mut places = Vec::with_capacity(rows.len());
    for (row, split) in rows.into_iter().zip(splits) {
        if row.verified && split != Split::Train {
            found.left_out.push(row.left_out(0.0, Why::HeldOut));
            continue;
        }
        places.push(row.place());
        found.examples.push(Example {
            pattern: row.pattern,
            label: row.label,
            family: row.family,
            split,
            repeats: if row.verified { verified_weight } else { 1 },
        });
    }
    leave_out_implausible(&mut found, &places, side_mm);
    found.left_out.sort_by_key(|left_out| (left_out.input, left_out.row));
    if found.examples.is_empty() {
        return Err(nothing(&found));
    }
    Ok(found)
}

/// A row with a label.
struct Row {
    input: usize,
    row: usize,
    pattern: Pattern,
    label: Label,
    family: String,
    /// Of a balanced row.
    split: Option<Split>,
    /// Whether it was verified.
    verified: bool,
}

/// Where a row stands.
#[derive(Clone, Copy)]
struct Place {
    input: usize,
    row: usize,
    verified: bool,
}

impl Row {
    fn place(&self) -> Place {
        Place {
            input: self.input,
            row: self.row,
            verified: self.verified,
        }
    }

    fn left_out(&self, found_mm: f64, why: Why) -> LeftOut {
        LeftOut {
            input: self.input,
            row: self.row,
            found_mm,
            why,
        }
    }
}

/// Solved samples have no split.
fn is_balanced(artifact: &Artifact) -> bool {
    artifact.kind() == "balance"
}

/// Reads one file, whose rows begin at a place in an input; gives how many there are.
fn read_part(
    part: &Artifact,
    (input, first): (usize, usize),
    rows: &mut Vec<Row>,
    left_out: &mut Vec<LeftOut>,
) -> Result<usize, StageError> {
    let patterns = arrays::read_patterns(part, "patterns")?;
    let shape = &part.content("displacement")?.shape;
    let families = part.texts("family")?.1;
    let balanced = is_balanced(part);
    let words = part.texts(if balanced { "split" } else { "outcome" })?.1;
    let count = patterns.len();
    if [families.len(), words.len()] != [count; 2] || *shape != [count, CORNERS, CORNERS, 2] {
        return Err(wrong(part, "its arrays differ in length"));
    }
    // The file is an artifact's, whose bytes were verified when it was opened.
    let file = RowFile::open(part.path())?;
    let mut described = patterns.into_iter().zip(families).zip(words).enumerate();
    for block in (0..count).step_by(BLOCK) {
        let values = file.numbers("displacement", block..count.min(block + BLOCK))?;
        let labels: Vec<Result<Label, LabelError>> = values
            .par_chunks_exact(CORNERS * CORNERS * 2)
            .map(Label::from_values)
            .collect();
        for (label, (at, ((pattern, family), word))) in labels.into_iter().zip(described.by_ref()) {
            let row = first + at;
            match believed(label, &word, balanced) {
                Ok((label, split)) => rows.push(Row {
                    input,
                    row,
                    pattern,
                    label,
                    family,
                    split,
                    verified: false,
                }),
                Err(Refusal::Label(found_mm, why)) => left_out.push(LeftOut {
                    input,
                    row,
                    found_mm,
                    why,
                }),
                Err(Refusal::Artifact(reason)) => return Err(wrong(part, &reason)),
            }
        }
    }
    Ok(count)
}

/// Why a row is no example.
enum Refusal {
    /// Its label: the displacement that shows it, mm, and what is wrong.
    Label(f64, Why),
    /// The artifact is not what it should be.
    Artifact(String),
}

/// The label of a row and, where it is balanced, its split, by the word that stands beside it: its split or outcome.
fn believed(label: Result<Label, LabelError>, word: &str, balanced: bool) -> Result<(Label, Option<Split>), Refusal> {
    let split = match balanced {
        true => Some(Split::from_name(word).ok_or_else(|| Refusal::Artifact(format!("unknown split {word:?}")))?),
        false if has_label(word) => None,
        false => return Err(Refusal::Label(0.0, Why::NotConverged)),
    };
    match label {
        Ok(label) => Ok((label, split)),
        Err(LabelError::Frame(found_mm)) => Err(Refusal::Label(found_mm, Why::Frame)),
        Err(LabelError::NotFinite(_)) => Err(Refusal::Label(0.0, Why::NotFinite)),
        Err(error @ LabelError::Shape(_)) => Err(Refusal::Artifact(error.to_string())),
    }
}

/// Whether a sample that ended so has a field worth learning.
fn has_label(outcome: &str) -> bool {
    matches!(outcome, "converged" | "estimated")
}

/// The part of each row. Balanced inputs that disagree about an orbit are settled by the first. Verified rows follow the others; an
/// orbit that only they have is learnt from.
fn splits(rows: &[Row], alone: bool) -> Vec<Split> {
    let own: Option<Vec<Split>> = rows.iter().map(|row| row.split).collect();
    if let (Some(own), true) = (own, alone) {
        return own;
    }
    let orbits: Vec<OrbitId> = rows.par_iter().map(|row| row.pattern.orbit()).collect();
    let mut known = HashMap::new();
    for (row, orbit) in rows.iter().zip(&orbits) {
        if let Some(split) = row.split {
            known.entry(*orbit).or_insert(split);
        }
    }
    for (row, orbit) in rows.iter().zip(&orbits) {
        if !row.verified {
            known.entry(*orbit).or_insert_with(|| Split::of(orbit, SPLIT_SEED));
        }
    }
    let part = |orbit: &OrbitId| known.get(orbit).copied().unwrap_or(Split::Train);
    orbits.iter().map(part).collect()
}

/// A verified design was simulated with care, and designs move farther than patterns that are drawn: it need only lie within the
/// membrane.
fn leave_out_implausible(found: &mut Examples, places: &[Place], side_mm: f64) {
    let mut refused = implausible(&found.examples, side_mm);
    refused.retain(|refused| refused.physical || !places[refused.index].verified);
    let mut refused = refused.iter().peekable();
    let mut index = 0;
    let left_out = &mut found.left_out;
    found.examples.retain(|_| {
        let here = refused.next_if(|refused| refused.index == index);
        if let Some(here) = here {
            let Place { input, row, .. } = places[index];
            let why = if here.physical { Why::BeyondSide } else { Why::Outlier };
            left_out.push(LeftOut {
                input,
                row,
                found_mm: here.found_mm,
                why: why(here.limit_mm),
            });
        }
        index += 1;
        here.is_none()
    });
}

fn nothing(found: &Examples) -> StageError {
    let mut text = "there is no label to learn from".to_owned();
    if found.unstable > 0 {
        text += &format!("; {} samples have no stable solution", found.unstable);
    }
    for left_out in found.left_out.iter().take(3) {
        text += &format!("; {left_out}");
    }
    StageError::Input(text)
}

fn wrong(artifact: &Artifact, reason: &str) -> StageError {
    StageError::Input(format!("artifact {}: {reason}", artifact.digest().short()))
}

#[cfg(test)]
mod tests;
