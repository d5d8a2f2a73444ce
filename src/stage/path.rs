//! `solve --path`: how patterns get from rest to the loss of stability, and what lies beyond.

use std::path::Path;

use rayon::prelude::*;

use super::arrays;
use super::direct::{DirectError, read_scene};
use crate::base::Progress;
pub use crate::fem::LoadPath;
use crate::fem::screening::resolve;
use crate::fem::{MembraneSolver, PathEvent, PathPoint, SetupError, SolveOptions};
use crate::field::Field;
use crate::pattern::Pattern;
use crate::store::{Data, Dataset, Object};

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
        content: describe(patterns, &paths).attribute("scene", scene.to_text()),
        paths,
    })
}

fn one(solver: &MembraneSolver, pattern: &Pattern, progress: &dyn Progress) -> Result<LoadPath, DirectError> {
    let path = solver.path(pattern);
    progress.advance(1);
    path.ok_or_else(|| DirectError::Failed("the factors of the tangent do not fit into memory".to_owned()))
}

/// Points and events of all paths stand one after the other; offsets say where each path begins.
fn describe(patterns: &[Pattern], paths: &[LoadPath]) -> Object {
    let shown = arrays::patterns(
        "electrode patterns [sample][y][x], origin lower left, 1 = electrode",
        patterns,
    );
    let point_offsets = offsets(paths.iter().map(|path| path.points.len()));
    let event_offsets = offsets(paths.iter().map(|path| path.events.len()));
    let begin = "the rows of path i are those from element i up to, but without, element i + 1";
    let mut content = Object::default()
        .with("patterns", shown)
        .with("point_offsets", arrays::wholes("1", begin, point_offsets.clone()))
        .with("event_offsets", arrays::wholes("1", begin, event_offsets));
    for (name, dataset) in points(paths)
        .into_iter()
        .chain(events(paths, &point_offsets))
        .chain(limits(paths))
    {
        content = content.with(name, dataset);
    }
    content
}

fn offsets(lengths: impl Iterator<Item = usize>) -> Vec<u64> {
    let sums = lengths.scan(0, |sum, length| {
        *sum += length as u64;
        Some(*sum)
    });
    std::iter::once(0).chain(sums).collect()
}

/// One row per point.
fn points(paths: &[LoadPath]) -> Vec<(&'static str, Dataset)> {
    let all = || paths.iter().flat_map(|path| &path.points);
    let reals = |units, note, value: fn(&PathPoint) -> f64| arrays::reals(units, note, all().map(value).collect());
    let stable: Vec<u8> = all().map(|p| u8::from(p.stable)).collect();
    vec![
        ("voltage", reals("V", "voltage; it falls past a fold", |p| p.voltage)),
        (
            "max_displacement",
            reals("mm", "largest displacement magnitude over the corners", |p| {
                p.max_displacement
            }),
        ),
        (
            "displacement",
            reals("mm", "displacement magnitude at the watched corner", |p| p.displacement),
        ),
        (
            "smallest_eigenvalue",
            reals("1", "smallest eigenvalue of the tangent against the Laplacian", |p| {
                p.smallest_eigenvalue
            }),
        ),
        (
            "negative_eigenvalues",
            arrays::wholes(
                "1",
                "negative eigenvalues of the tangent",
                all().map(|p| p.negative_eigenvalues as u64).collect(),
            ),
        ),
        (
            "stable",
            Dataset::new(
                "1",
                "1 where a membrane can be found in this state",
                &[stable.len()],
                Data::U8(stable),
            ),
        ),
    ]
}

/// One row per event.
fn events(paths: &[LoadPath], point_offsets: &[u64]) -> Vec<(&'static str, Dataset)> {
    let with_offset = |(path, offset): (&LoadPath, &u64)| {
        let offset = *offset;
        let moved = |event: &PathEvent| (*event, offset + event.point as u64);
        path.events.iter().map(moved).collect::<Vec<_>>()
    };
    let all: Vec<(PathEvent, u64)> = paths.iter().zip(point_offsets).flat_map(with_offset).collect();
    vec![
        (
            "event_kind",
            arrays::texts(
                "what happens: fold, bifurcation or not-elliptic",
                all.iter().map(|(event, _)| event.kind.name()),
            ),
        ),
        (
            "event_voltage",
            arrays::reals(
                "V",
                "where it happens",
                all.iter().map(|(event, _)| event.voltage).collect(),
            ),
        ),
        (
            "event_point",
            arrays::wholes(
                "1",
                "row of the point just before it",
                all.iter().map(|(_, row)| *row).collect(),
            ),
        ),
    ]
}

/// One row per pattern.
fn limits(paths: &[LoadPath]) -> Vec<(&'static str, Dataset)> {
    let n = paths.len();
    let kind = |path: &LoadPath| path.limit().map_or("none", |limit| limit.kind.name());
    let voltage = |path: &LoadPath| path.limit().map_or(f64::NAN, |limit| limit.voltage);
    let watched = paths.iter().flat_map(|path| path.watched).map(|corner| corner as u64);
    let fields: Vec<&Field> = paths.iter().map(|path| &path.limit_field).collect();
    vec![
        (
            "limit_kind",
            arrays::texts("what ends the stable part that begins at rest", paths.iter().map(kind)),
        ),
        (
            "limit_voltage",
            arrays::reals(
                "V",
                "highest voltage of that part; NaN where it has no end",
                paths.iter().map(voltage).collect(),
            ),
        ),
        (
            "limit_displacement",
            arrays::fields(
                "displacement at that limit, at the cell corners [sample][y][x][component]",
                fields.into_iter(),
            ),
        ),
        (
            "watched_corner",
            Dataset::new(
                "1",
                "column and row of the corner that moves most at that limit",
                &[n, 2],
                Data::U64(watched.collect()),
            ),
        ),
        (
            "end",
            arrays::texts("why the path ends", paths.iter().map(|path| path.end.name())),
        ),
    ]
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
