//! Rows of verified designs: the patterns of a verify stage with a field, which are simulated as finely as anything is.

use rayon::prelude::*;

use super::{BLOCK, LeftOut, Refusal, Row, believed, has_label, wrong};
use crate::field::CORNERS;
use crate::orchestrator::StageError;
use crate::stage::arrays;
use crate::store::{Artifact, RowFile};
use crate::surrogate::{Label, LabelError};

/// The family under which their metrics stand.
const FAMILY: &str = "verified";

/// Reads one input: patterns that are there already are not taken again, since every round verifies the intuitive designs. Gives how
/// many of its patterns have no field.
pub fn read(
    artifact: &Artifact,
    input: usize,
    rows: &mut Vec<Row>,
    left_out: &mut Vec<LeftOut>,
) -> Result<u64, StageError> {
    let patterns = arrays::read_patterns(artifact, "patterns")?;
    let outcomes = artifact.texts("outcome")?.1;
    if outcomes.len() != patterns.len() {
        return Err(wrong(artifact, "its arrays differ in length"));
    }
    let all = patterns.len();
    let described = patterns.into_iter().zip(outcomes).enumerate();
    // Fields stand in the order of the patterns that have one.
    let solved: Vec<_> = described.filter(|(_, (_, outcome))| has_label(outcome)).collect();
    if artifact.content("displacement")?.shape != [solved.len(), CORNERS, CORNERS, 2] {
        return Err(wrong(artifact, "its arrays differ in length"));
    }
    let without = (all - solved.len()) as u64;
    // The file is an artifact's, whose bytes were verified when it was opened.
    let file = RowFile::open(artifact.path())?;
    for (block, solved) in solved.chunks(BLOCK).enumerate() {
        let first = block * BLOCK;
        let values = file.numbers("displacement", first..first + solved.len())?;
        let labels: Vec<Result<Label, LabelError>> = values
            .par_chunks_exact(CORNERS * CORNERS * 2)
            .map(Label::from_values)
            .collect();
        for (label, (row, (pattern, outcome))) in labels.into_iter().zip(solved) {
            if rows.iter().any(|other| other.verified && other.pattern == *pattern) {
                continue;
            }
            match believed(label, outcome, false) {
                Ok((label, split)) => rows.push(Row {
                    input,
                    row: *row,
                    pattern: pattern.clone(),
                    label,
                    family: FAMILY.to_owned(),
                    split,
                    verified: true,
                }),
                Err(Refusal::Label(found_mm, why)) => left_out.push(LeftOut {
                    input,
                    row: *row,
                    found_mm,
                    why,
                }),
                Err(Refusal::Artifact(reason)) => return Err(wrong(artifact, &reason)),
            }
        }
    }
    Ok(without)
}
