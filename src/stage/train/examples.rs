//! Reads the examples of a training from its inputs: balanced sets, solved samples and verified designs.

use rayon::prelude::*;

use crate::without::{self, Dropped};
use crate::{drive_check, model};
use deaflow_content::{Labelled, VerificationView, files};
use deaflow_dataset::Split;
use deaflow_field::OutcomeKind;
use deaflow_orchestrator::StageError;
use deaflow_pattern::{Pattern, Raster, Symmetry};
use deaflow_scene::Scene;
use deaflow_store::Artifact;
use deaflow_surrogate::{Collector, Corners, Examples, Label, LabelError, LabelledRow, RowKind};

/// Rows that are read at once: some tens of megabytes.
const BLOCK: usize = 512;

/// The family of verified designs in the metrics.
const VERIFIED: &str = "verified";

/// Reads the examples of all inputs that are not dropped. An epoch repeats a verified design `verified_weight` times.
///
/// # Errors
/// If arrays of an input are missing or inconsistent, or no example is left.
pub fn read(
    inputs: &[Artifact],
    scene: &Scene,
    verified_weight: u32,
    dropped: &Dropped,
) -> Result<Examples, StageError> {
    let mut collector = Collector::new(scene.symmetries());
    let datasets = inputs[..without::datasets(inputs)]
        .iter()
        .enumerate()
        .filter(|(_, artifact)| !model::is_in(artifact));
    for (input, artifact) in datasets {
        if let Some(Labelled::Verified(view)) = Labelled::open(artifact)? {
            read_verified(&view, (input, scene), dropped, &mut collector)?;
            continue;
        }
        collector.begin_input(unstable(artifact)?);
        let mut first = 0;
        for file in files(artifact)? {
            first += read_file(file, (input, first, scene), dropped, &mut collector)?;
        }
    }
    let longer_side_mm = scene.membrane().size_mm.into_iter().fold(0.0, f64::max);
    collector
        .finish(longer_side_mm, verified_weight)
        .map_err(|none| match none.all_unstable {
            true => StageError::Advised {
                source: none.into(),
                help: drive_check::stability_advice(scene),
            },
            false => StageError::input(none),
        })
}

/// Returns the number of samples without a stable solution.
fn unstable(artifact: &Artifact) -> Result<u64, StageError> {
    match Labelled::open(artifact)? {
        Some(Labelled::Solved(view)) => Ok(view.unstable().outcome().rows()? as u64),
        _ => Ok(0),
    }
}

/// Reads one file, whose rows start at the row `first` of an input; returns their number.
fn read_file(
    file: &Artifact,
    (input, first, scene): (usize, usize, &Scene),
    dropped: &Dropped,
    collector: &mut Collector,
) -> Result<usize, StageError> {
    let labelled = Labelled::open(file)?.ok_or_else(|| wrong(file, "it has no labelled patterns"))?;
    let patterns = labelled.patterns()?;
    let (count, families) = (patterns.len(), labelled.families()?.unwrap_or_default());
    let kinds: Vec<RowKind> = match &labelled {
        Labelled::Balanced(view) => {
            let unknown = |word: &str| wrong(file, &format!("unknown split {word:?}"));
            let split = |word: String| {
                Split::from_name(&word)
                    .map(RowKind::Balanced)
                    .ok_or_else(|| unknown(&word))
            };
            view.split().read()?.into_iter().map(split).collect::<Result<_, _>>()?
        }
        Labelled::Solved(view) => {
            let kind = |outcome: OutcomeKind| RowKind::Solved {
                converged: outcome.has_field(),
            };
            view.outcome().read()?.into_iter().map(kind).collect()
        }
        Labelled::Verified(_) => Vec::new(),
    };
    let images = images(&labelled)?;
    let raster = patterns.first().map_or(Raster::PAPER, Pattern::raster);
    let mut described = patterns.into_iter().zip(families).zip(kinds).enumerate();
    for_each_label(&labelled, corners(scene, raster), |label| match described.next() {
        Some((at, _)) if dropped.has(input, first + at) => Ok(()),
        Some((at, ((pattern, family), kind))) => add(
            collector,
            file,
            LabelledRow {
                input,
                row: first + at,
                pattern,
                family,
                kind,
                label,
                image: images.get(at).copied(),
            },
        ),
        None => Ok(()),
    })?;
    Ok(count)
}

/// Returns the sample and the symmetry of which each row of a balanced set is an image; empty for other sets.
fn images(labelled: &Labelled<'_>) -> Result<Vec<(u64, Symmetry)>, StageError> {
    let Labelled::Balanced(view) = labelled else {
        return Ok(Vec::new());
    };
    let symmetry = |index: u64| usize::try_from(index).ok().and_then(|index| Symmetry::ALL.get(index));
    let unknown = |index: u64| wrong(view.artifact(), &format!("unknown symmetry {index}"));
    let rows = view.source().read()?.into_iter().zip(view.symmetry().read()?);
    rows.map(|(source, index)| Ok((source, *symmetry(index).ok_or_else(|| unknown(index))?)))
        .collect()
}

/// Reads the designs of a verify stage that have a field; the fields are in the order of these designs.
fn read_verified(
    view: &VerificationView<'_>,
    (input, scene): (usize, &Scene),
    dropped: &Dropped,
    collector: &mut Collector,
) -> Result<(), StageError> {
    let fields = view.simulated_rows()?;
    collector.begin_input(fields.iter().filter(|field| field.is_none()).count() as u64);
    let patterns = view.rows().patterns().read()?;
    let raster = patterns.first().map_or(Raster::PAPER, Pattern::raster);
    let patterns = patterns.into_iter().enumerate();
    let mut solved = patterns.filter(|(row, _)| fields[*row].is_some());
    for_each_label(
        &Labelled::Verified(view.clone()),
        corners(scene, raster),
        |label| match solved.next() {
            Some((row, _)) if dropped.has(input, row) => Ok(()),
            Some((row, pattern)) => add(
                collector,
                view.artifact(),
                LabelledRow {
                    input,
                    row,
                    pattern,
                    family: VERIFIED.to_owned(),
                    kind: RowKind::Verified,
                    label,
                    image: None,
                },
            ),
            None => Ok(()),
        },
    )
}

fn add(collector: &mut Collector, file: &Artifact, row: LabelledRow) -> Result<(), StageError> {
    collector.add(row).map_err(|e| wrong(file, &e.to_string()))
}

/// Returns the corners of labels of patterns of these cells in a scene.
fn corners(scene: &Scene, raster: Raster) -> Corners {
    match Corners::of(scene).held() {
        Some(held) => Corners::all(raster, held),
        None => Corners::inner(raster),
    }
}

/// Calls a function with the label of each field of a file, in order.
fn for_each_label(
    file: &Labelled<'_>,
    corners: Corners,
    mut each: impl FnMut(Result<Label, LabelError>) -> Result<(), StageError>,
) -> Result<(), StageError> {
    let count = file.fields()?;
    for first in (0..count).step_by(BLOCK) {
        let values = file.displacement(first..count.min(first + BLOCK))?;
        let labels: Vec<Result<Label, LabelError>> = values
            .par_chunks_exact(2 * corners.raster().corners())
            .map(|values| Label::at(corners, values))
            .collect();
        labels.into_iter().try_for_each(&mut each)?;
    }
    Ok(())
}

fn wrong(artifact: &Artifact, reason: &str) -> StageError {
    StageError::in_artifact(artifact, reason)
}

#[cfg(test)]
mod tests;
