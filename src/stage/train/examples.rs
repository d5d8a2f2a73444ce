//! Reads the examples of a training from its inputs: balanced sets, solved samples and verified designs.

use rayon::prelude::*;

use crate::content::files;
use crate::dataset::Split;
use crate::field::{CORNERS, Outcome};
use crate::orchestrator::StageError;
use crate::pattern::Pattern;
use crate::stage::{arrays, model};
use crate::store::{Artifact, RowFile};
use crate::surrogate::{Collector, Examples, Label, LabelError, LabelledRow, Origin};

/// Rows that are read together: some tens of megabytes.
const BLOCK: usize = 512;

/// The family under which metrics of verified designs stand.
const VERIFIED: &str = "verified";

/// The examples of all inputs, in a membrane of that side in mm. An epoch shows a verified design `verified_weight` times.
///
/// # Errors
/// When an input lacks what is needed, its arrays do not fit together, or nothing is left.
pub fn read(inputs: &[Artifact], side_mm: f64, verified_weight: u32) -> Result<Examples, StageError> {
    let mut collector = Collector::default();
    let datasets = inputs
        .iter()
        .enumerate()
        .filter(|(_, artifact)| !model::is_in(artifact));
    for (input, artifact) in datasets {
        if artifact.kind() == "verify" {
            read_verified(artifact, input, &mut collector)?;
            continue;
        }
        collector.begin(unstable(artifact)?);
        let mut first = 0;
        for file in files(artifact)? {
            first += read_file(file, (input, first), &mut collector)?;
        }
    }
    collector
        .finish(side_mm, verified_weight)
        .map_err(|e| StageError::Input(e.to_string()))
}

/// Solved samples have no split.
fn is_balanced(artifact: &Artifact) -> bool {
    artifact.kind() == "balance"
}

/// How many samples have no stable solution.
fn unstable(artifact: &Artifact) -> Result<u64, StageError> {
    match is_balanced(artifact) {
        true => Ok(0),
        false => Ok(artifact
            .content("unstable/outcome")?
            .shape
            .first()
            .copied()
            .unwrap_or_default() as u64),
    }
}

/// Reads one file, whose rows begin at a place in an input; gives how many there are.
fn read_file(file: &Artifact, (input, first): (usize, usize), collector: &mut Collector) -> Result<usize, StageError> {
    let patterns = arrays::read_patterns(file, "patterns")?;
    let families = file.texts("family")?.1;
    let balanced = is_balanced(file);
    let words = file.texts(if balanced { "split" } else { "outcome" })?.1;
    let count = patterns.len();
    if [families.len(), words.len()] != [count; 2] {
        return Err(wrong(file, LENGTHS));
    }
    let mut described = patterns.into_iter().zip(families).zip(words).enumerate();
    for_each_label(file, count, |label| {
        let Some((at, ((pattern, family), word))) = described.next() else {
            return Ok(());
        };
        let origin = match (balanced, Split::from_name(&word)) {
            (true, Some(split)) => Origin::Balanced(split),
            (true, None) => return Err(wrong(file, &format!("unknown split {word:?}"))),
            (false, _) => Origin::Solved {
                converged: Outcome::names_field(&word),
            },
        };
        add(collector, file, (input, first + at), (pattern, family), origin, label)
    })?;
    Ok(count)
}

/// Reads the designs of a verify stage that have a field; fields stand in the order of these.
fn read_verified(artifact: &Artifact, input: usize, collector: &mut Collector) -> Result<(), StageError> {
    let patterns = arrays::read_patterns(artifact, "patterns")?;
    let outcomes = artifact.texts("outcome")?.1;
    if outcomes.len() != patterns.len() {
        return Err(wrong(artifact, LENGTHS));
    }
    let all = patterns.len();
    let mut solved: Vec<(usize, Pattern)> = patterns.into_iter().enumerate().collect();
    solved.retain(|(row, _)| Outcome::names_field(&outcomes[*row]));
    let count = solved.len();
    collector.begin((all - count) as u64);
    let mut solved = solved.into_iter();
    for_each_label(artifact, count, |label| match solved.next() {
        Some((row, pattern)) => {
            let described = (pattern, VERIFIED.to_owned());
            add(collector, artifact, (input, row), described, Origin::Verified, label)
        }
        None => Ok(()),
    })
}

fn add(
    collector: &mut Collector,
    file: &Artifact,
    (input, row): (usize, usize),
    (pattern, family): (Pattern, String),
    origin: Origin,
    label: Result<Label, LabelError>,
) -> Result<(), StageError> {
    let row = LabelledRow {
        input,
        row,
        pattern,
        family,
        origin,
        label,
    };
    collector.add(row).map_err(|e| wrong(file, &e.to_string()))
}

/// Calls a function with the labels of a file, which has so many, in order.
fn for_each_label(
    file: &Artifact,
    count: usize,
    mut each: impl FnMut(Result<Label, LabelError>) -> Result<(), StageError>,
) -> Result<(), StageError> {
    if file.content("displacement")?.shape != [count, CORNERS, CORNERS, 2] {
        return Err(wrong(file, LENGTHS));
    }
    // The file is an artifact's, whose bytes were verified when it was opened.
    let rows = RowFile::open(file.path())?;
    for first in (0..count).step_by(BLOCK) {
        let values = rows.numbers("displacement", first..count.min(first + BLOCK))?;
        let labels: Vec<Result<Label, LabelError>> = values
            .par_chunks_exact(CORNERS * CORNERS * 2)
            .map(Label::from_values)
            .collect();
        labels.into_iter().try_for_each(&mut each)?;
    }
    Ok(())
}

const LENGTHS: &str = "its arrays differ in length";

fn wrong(artifact: &Artifact, reason: &str) -> StageError {
    StageError::Input(format!("artifact {}: {reason}", artifact.digest().short()))
}

#[cfg(test)]
mod tests;
