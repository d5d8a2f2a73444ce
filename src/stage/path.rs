//! `solve --path`: how patterns get from rest to the loss of stability, and what lies beyond.

use std::path::Path;

use rayon::prelude::*;

use super::direct::{DirectError, read_scene};
use crate::base::Progress;
use crate::content::LoadPaths;
pub use crate::fem::LoadPath;
use crate::fem::screening::resolve;
use crate::fem::{MembraneSolver, PathEvent, SetupError, SolveOptions};
use crate::pattern::Pattern;
use crate::scene::Scene;
use crate::store::Object;

/// The paths of some patterns.
#[derive(Debug)]
pub struct PathAnswer {
    /// The arrays. They may hold NaN: where a path has no limit.
    pub content: Object,
    /// One per pattern, in order.
    pub paths: Vec<LoadPath>,
}

/// Follows the paths of patterns in a scene read from `scene`: a scene, or a pipeline whose scene is used. Its voltage does
/// not matter.
///
/// # Errors
/// When the scene cannot be read, the solver cannot be set up, or memory is short.
pub fn paths(
    scene: &Path,
    patterns: &[Pattern],
    options: SolveOptions,
    progress: &dyn Progress,
) -> Result<PathAnswer, DirectError> {
    let failed = |e: SetupError| DirectError::Failed(e.to_string());
    let scene = resolve(&read_scene(scene)?).map_err(failed)?;
    let solver = MembraneSolver::new(&scene, options).map_err(failed)?;
    let follow = |pattern: &Pattern| one(&solver, pattern, progress);
    let paths = patterns.par_iter().map(follow).collect::<Result<Vec<_>, _>>()?;
    Ok(PathAnswer {
        content: load_paths(patterns, &paths, scene).object(),
        paths,
    })
}

fn one(solver: &MembraneSolver, pattern: &Pattern, progress: &dyn Progress) -> Result<LoadPath, DirectError> {
    let path = solver.path(pattern);
    progress.advance(1);
    path.ok_or_else(|| DirectError::Failed("the factors of the tangent do not fit into memory".to_owned()))
}

fn load_paths(patterns: &[Pattern], paths: &[LoadPath], scene: Scene) -> LoadPaths {
    let points = || paths.iter().flat_map(|path| &path.points);
    let point_offsets = offsets(paths.iter().map(|path| path.points.len()));
    let with_offset = |(path, &offset): (&LoadPath, &u64)| {
        let moved = |event: &PathEvent| (*event, offset + event.point as u64);
        path.events.iter().map(moved).collect::<Vec<_>>()
    };
    let events: Vec<(PathEvent, u64)> = paths.iter().zip(&point_offsets).flat_map(with_offset).collect();
    let limit = |path: &LoadPath| path.limit().map_or("none", |limit| limit.kind.name()).to_owned();
    let limit_voltage = |path: &LoadPath| path.limit().map_or(f64::NAN, |limit| limit.voltage);
    LoadPaths {
        patterns: patterns.to_vec(),
        event_offsets: offsets(paths.iter().map(|path| path.events.len())),
        point_offsets,
        voltage: points().map(|p| p.voltage).collect(),
        max_displacement: points().map(|p| p.max_displacement).collect(),
        displacement: points().map(|p| p.displacement).collect(),
        smallest_eigenvalue: points().map(|p| p.smallest_eigenvalue).collect(),
        negative_eigenvalues: points().map(|p| p.negative_eigenvalues as u64).collect(),
        stable: points().map(|p| u8::from(p.stable)).collect(),
        event_kind: events.iter().map(|(event, _)| event.kind.name().to_owned()).collect(),
        event_voltage: events.iter().map(|(event, _)| event.voltage).collect(),
        event_point: events.iter().map(|(_, row)| *row).collect(),
        limit_kind: paths.iter().map(limit).collect(),
        limit_voltage: paths.iter().map(limit_voltage).collect(),
        limit_displacement: paths.iter().map(|path| path.limit_field.clone()).collect(),
        watched_corner: paths
            .iter()
            .map(|path| path.watched.map(|corner| corner as u64))
            .collect(),
        end: paths.iter().map(|path| path.end.name().to_owned()).collect(),
        scene,
    }
}

fn offsets(lengths: impl Iterator<Item = usize>) -> Vec<u64> {
    let sums = lengths.scan(0, |sum, length| {
        *sum += length as u64;
        Some(*sum)
    });
    std::iter::once(0).chain(sums).collect()
}

/// All points as comma-separated values with a header.
#[must_use]
pub fn table(paths: &[LoadPath]) -> String {
    let header =
        "pattern,voltage_V,max_displacement_mm,displacement_mm,smallest_eigenvalue,negative_eigenvalues,stable,event";
    let mut text = format!("{header}\n");
    for (index, path) in paths.iter().enumerate() {
        for (row, p) in path.points.iter().enumerate() {
            let event = path.events.iter().find(|event| event.point == row);
            text += &format!(
                "{index},{},{},{},{},{},{},{}\n",
                p.voltage,
                p.max_displacement,
                p.displacement,
                p.smallest_eigenvalue,
                p.negative_eigenvalues,
                u8::from(p.stable),
                event.map_or("", |event| event.kind.name())
            );
        }
    }
    text
}
