//! The patterns of a stage that model warnings are about: its best designs, or some of its samples.

use super::artifacts::ArtifactReader;
use super::error::ReportError;
use super::summary;
use deaflow_content::{ArtifactKind, Solutions, Verification, files};
use deaflow_pattern::{Pattern, Role};

/// Largest number of patterns of a stage.
const MAX_PATTERNS: usize = 4;

/// Returns patterns that a stage has simulated, with their names: of a verify stage the best design of each target, of
/// a solve stage samples from the beginning, the middle and the end, stable ones if there are any. At most four; none
/// of other kinds of stages.
///
/// # Errors
/// If the artifact cannot be read.
pub fn warned_patterns(source: &ArtifactReader<'_>) -> Result<Vec<(String, Pattern)>, ReportError> {
    match ArtifactKind::of(source.artifact) {
        Some(ArtifactKind::Verify) => best_designs(source),
        Some(ArtifactKind::Solve) => samples(source),
        _ => Ok(Vec::new()),
    }
}

/// Returns `MAX_PATTERNS` of so many positions, evenly spaced.
fn some_of(count: usize) -> impl Iterator<Item = usize> {
    let taken = count.min(MAX_PATTERNS);
    (0..taken).map(move |i| i * count / taken)
}

fn best_designs(source: &ArtifactReader<'_>) -> Result<Vec<(String, Pattern)>, ReportError> {
    let rows = summary::read(source)?.rows;
    let best = summary::best_rows(&rows, Role::is_found);
    let patterns = source.of(source.of(Verification::open(source.artifact))?.rows().patterns().read())?;
    let name = |at: usize| match best.len() {
        1 => "best design".to_owned(),
        _ => rows[at].title(),
    };
    let named = some_of(best.len()).map(|i| best[i]);
    Ok(named.map(|at| (name(at), patterns[at].clone())).collect())
}

fn samples(source: &ArtifactReader<'_>) -> Result<Vec<(String, Pattern)>, ReportError> {
    let (mut stable, mut unstable) = (Vec::new(), Vec::new());
    let files = source.of(files(source.artifact))?;
    // A chunk has more samples than are taken.
    for at in some_of(files.len()) {
        let view = source.of(Solutions::open(&files[at]))?;
        for (rows, found) in [(view.rows(), &mut stable), (view.unstable().rows(), &mut unstable)] {
            let (families, indices) = (source.of(rows.family().read())?, source.of(rows.index().read())?);
            let patterns = source.of(rows.patterns().read())?;
            let names = families
                .iter()
                .zip(indices)
                .map(|(family, index)| format!("{family} {index}"));
            found.extend(names.zip(patterns));
        }
    }
    let found = if stable.is_empty() { unstable } else { stable };
    Ok(some_of(found.len()).map(|at| found[at].clone()).collect())
}
