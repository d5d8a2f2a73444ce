//! Reads patterns that an argument of a command names.

use std::path::Path;

use super::part::{At, Part};
use super::samples::{CoveredCells, DrawnElectrodes};
use super::view::Stored;
use deaflow_base::InputError;
use deaflow_pattern::{DrawingOptions, Edges, FilePatterns, Pattern, PatternForm, read_patterns, split_array};
use deaflow_store::Artifact;

/// Reads the patterns that an argument names: a file of patterns, or a dataset of an artifact, which may be a manifest.
/// With fitted edges an artifact must have the shapes of the electrodes, by coverage the shares of cells.
/// Artifacts are read through the store, because HDF5 would show fill values for missing chunks of a manifest.
///
/// # Errors
/// If the file cannot be read, is damaged, or has no patterns at this path.
pub fn named_patterns(
    argument: &str,
    form: PatternForm,
    drawings: &DrawingOptions,
) -> Result<FilePatterns, InputError> {
    let named = split_array(argument).map(|(file, dataset)| (Path::new(file), dataset));
    let Some((path, dataset)) = named.filter(|(path, _)| Artifact::is_at(path)) else {
        return read_patterns(argument, form, drawings);
    };
    let refused = |why: String| InputError::new(format!("{argument}: {why}"));
    let artifact = Artifact::open(path).map_err(|e| refused(e.to_string()))?;
    let dataset = dataset.trim_start_matches('/');
    let at = At::default().array(dataset, "1", &["n", "y", "x"], "");
    let mut patterns: Vec<Pattern> = Stored::new(&artifact, at).read().map_err(|e| refused(e.to_string()))?;
    let group = dataset.rsplit_once('/').map_or("", |(group, _)| group);
    let at = |name: &str| At::default().group(group, &[]).group(name, &[]);
    if drawings.edges == Edges::Fitted {
        let at = at("electrodes");
        let drawn: Option<DrawnElectrodes> = Part::get(&at, &artifact).map_err(|e| refused(e.to_string()))?;
        let drawn = drawn
            .ok_or_else(|| refused("its electrodes are cells, not shapes that elements could follow".to_owned()))?;
        patterns = drawn.add_to(patterns).map_err(|e| refused(e.to_string()))?;
    }
    if drawings.edges == Edges::Coverage {
        let covered: Option<CoveredCells> = Part::get(&at("covered"), &artifact).map_err(|e| refused(e.to_string()))?;
        let covered = covered
            .ok_or_else(|| refused("its electrodes are whole cells, none of which is covered in part".to_owned()))?;
        patterns = covered.add_to(patterns).map_err(|e| refused(e.to_string()))?;
    }
    let PatternForm { raster, groups, .. } = form;
    let other = patterns
        .iter()
        .find(|pattern| pattern.raster() != raster || pattern.groups() > groups);
    match other {
        None => Ok(FilePatterns {
            patterns,
            ..FilePatterns::default()
        }),
        Some(other) if other.raster() != raster => Err(refused(format!(
            "its patterns have {} cells, but the membrane has {raster}",
            other.raster()
        ))),
        Some(other) => Err(refused(format!(
            "its patterns have {} groups of electrodes, but the scene has voltages for {groups}",
            other.groups()
        ))),
    }
}
