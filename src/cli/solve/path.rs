//! `deaflow solve --path`: load paths from rest past the critical voltage.

use rayon::prelude::*;
use serde_json::{Value, json};

use super::SolveArguments;
use super::simulation::{Form, PatternSolver, Simulation, States};
use crate::job::{Attachments, JobResult};
use crate::results::with_error;
use crate::text::Text;
use crate::{CliError, Exit, Output, csv, table};
use deaflow_base::{Progress, four_digits};
use deaflow_content::{CoveredCells, DrawnElectrodes, LoadPaths};
use deaflow_fem::screening::resolve;
use deaflow_fem::{CriticalSearch, CriticalVoltage, LoadPath, MembraneSolver, MeshLimit, PathEvent, SetupError};
use deaflow_pattern::Pattern;
use deaflow_report::figures::{Branch, Limit, paths_sheet};
use deaflow_scene::Scene;

/// A load path, with the critical voltage and its error.
struct PatternPath {
    path: LoadPath,
    critical: Option<CriticalVoltage>,
}

const FORM: Form = Form {
    name: "path",
    has_attachments: true,
    states: States::Drive,
    without_covered_cells: None,
};

/// Follows the load paths of patterns; the voltage of the scene is ignored.
///
/// # Errors
/// When a file would be lost, the scene or a pattern cannot be used, memory is short, or a file cannot be written.
pub fn execute(arguments: &SolveArguments, output: &Output) -> Result<Exit, CliError> {
    let simulation = Simulation::read(arguments, &FORM)?;
    let scene = resolve(&simulation.scene)?;
    let options = arguments.options();
    let solvers = PatternSolver::new(&scene, |scene| {
        let solver = MembraneSolver::new(scene, options)?;
        Ok::<_, SetupError>((solver, CriticalSearch::new(scene, options)?))
    })?;
    let follow = |pattern: &Pattern| -> Result<PatternPath, CliError> {
        let (path, critical) = solvers.with(pattern, |(solver, search)| {
            let path = solver.path(pattern).ok_or_else(|| no_path(solver.lacks_rest(pattern)));
            let limit = path.as_ref().ok().and_then(LoadPath::limit);
            let critical = limit.map(|limit| search.from(pattern, solver.mesh(), limit.voltage));
            (path, critical)
        })?;
        simulation.job.bar.advance(1);
        Ok(PatternPath { path: path?, critical })
    };
    // All at once: some paths take much longer than others.
    let paths = simulation
        .patterns
        .par_iter()
        .map(follow)
        .collect::<Result<Vec<_>, _>>()?;
    let branches: Vec<Branch> = paths.iter().enumerate().map(branch).collect();
    let result = JobResult {
        patterns: paths.len(),
        arrays: load_paths(&simulation.patterns, &paths, scene).object(),
        parameters: simulation.parameters(", path"),
        attachments: Some(Attachments {
            title: "deaflow solve --path",
            table: points_table(&paths)?,
            draw: Box::new(move |figure| paths_sheet(&branches)?.write_png(figure)),
        }),
        warnings: Vec::new(),
        document: json!({ "paths": paths.iter().map(document).collect::<Vec<_>>() }),
        text: Text::of(overview(&paths)),
        exit: Exit::Done,
    };
    simulation.finish(result, output)
}

/// Returns why there is no path.
fn no_path(lacks_rest: bool) -> CliError {
    match lacks_rest {
        true => {
            CliError::failure("the membrane has no stable state without voltage under its loads, where a path starts")
                .help("lower the `load` of its sides and bodies, or mount it at a smaller `prestretch`")
        }
        false => CliError::failure("not enough memory for the factors of the tangent"),
    }
}

/// Lists the patterns.
fn overview(paths: &[PatternPath]) -> table::Table {
    let header = ["pattern", "limit", "voltage", "on this mesh", "points", "end"];
    let mut table = table::table(&header, &["voltage", "on this mesh", "points"]).dispensable(&["points"]);
    for (index, PatternPath { path, critical }) in paths.iter().enumerate() {
        let limit = path.limit();
        // The displacement belongs to the voltage of this mesh, not to the one extrapolated from two meshes.
        let on_mesh = limit.and_then(|limit| {
            let mm = path.points.get(limit.point)?.max_displacement;
            Some(format!("{} mm at {} V", four_digits(mm), four_digits(limit.voltage)))
        });
        let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
        table.add_row([
            index.to_string(),
            limit.map_or("none", |limit| limit.kind.name()).to_owned(),
            or_dash(critical.map(|critical| with_error(&critical))),
            or_dash(on_mesh),
            path.points.len().to_string(),
            path.end.name().to_owned(),
        ]);
    }
    table
}

fn document(PatternPath { path, critical }: &PatternPath) -> Value {
    let points = path.points.iter().map(|p| {
        json!({
            "voltage": p.voltage,
            "max_displacement": p.max_displacement,
            "displacement": p.displacement,
            "smallest_eigenvalue": p.smallest_eigenvalue,
            "negative_eigenvalues": p.negative_eigenvalues,
            "stable": p.stable,
        })
    });
    let events: Vec<Value> = path
        .events
        .iter()
        .map(|event| json!({ "kind": event.kind.name(), "voltage": event.voltage, "point": event.point }))
        .collect();
    let limit = path.limit().zip(*critical).map(|(limit, critical)| {
        let meshes: Vec<Value> = std::iter::once(critical.coarse)
            .chain(critical.fine)
            .map(on_mesh)
            .collect();
        json!({
            "kind": limit.kind.name(),
            "voltage": critical.voltage,
            "error": critical.error,
            "point": limit.point,
            "meshes": meshes,
        })
    });
    json!({
        "limit": limit,
        "watched_corner": path.watched,
        "points": points.collect::<Vec<_>>(),
        "events": events,
        "end": path.end.name(),
    })
}

fn on_mesh(limit: MeshLimit) -> Value {
    json!({
        "elements_per_cell": limit.mesh.elements_per_cell(),
        "order": limit.mesh.order().degree(),
        "voltage": limit.voltage,
    })
}

/// Returns the curve of a path in the figure.
fn branch((index, PatternPath { path, critical }): (usize, &PatternPath)) -> Branch {
    let limit = path.limit().zip(*critical).and_then(|(limit, critical)| {
        let at = path.points.get(limit.point)?;
        Some(Limit {
            name: limit.kind.name().to_owned(),
            voltage: critical.voltage,
            error: critical.error,
            displacement: at.displacement,
        })
    });
    Branch {
        name: format!("pattern {index}"),
        voltage: path.points.iter().map(|p| p.voltage).collect(),
        displacement: path.points.iter().map(|p| p.displacement).collect(),
        stable: path.points.iter().map(|p| p.stable).collect(),
        limit,
    }
}

fn load_paths(patterns: &[Pattern], followed: &[PatternPath], scene: Scene) -> LoadPaths {
    let paths: Vec<&LoadPath> = followed.iter().map(|one| &one.path).collect();
    let critical = |value: fn(&CriticalVoltage) -> Option<f64>| {
        let value = |one: &PatternPath| one.critical.as_ref().and_then(value).unwrap_or(f64::NAN);
        followed.iter().map(value).collect()
    };
    let points = || paths.iter().flat_map(|path| &path.points);
    let point_offsets = offsets(paths.iter().map(|path| path.points.len()));
    let with_offset = |(path, &offset): (&&LoadPath, &u64)| {
        let moved = |event: &PathEvent| (*event, offset + event.point as u64);
        path.events.iter().map(moved).collect::<Vec<_>>()
    };
    let events: Vec<(PathEvent, u64)> = paths.iter().zip(&point_offsets).flat_map(with_offset).collect();
    let limit = |path: &&LoadPath| path.limit().map_or("none", |limit| limit.kind.name()).to_owned();
    LoadPaths {
        patterns: patterns.to_vec(),
        electrodes: DrawnElectrodes::of(patterns),
        covered: CoveredCells::of(patterns),
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
        limit_voltage: critical(|found| Some(found.voltage)),
        limit_error: critical(|found| found.error),
        limit_coarse: critical(|found| Some(found.coarse.voltage)),
        limit_fine: critical(|found| Some(found.fine?.voltage)),
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

/// Returns all points as comma-separated values with a header.
fn points_table(paths: &[PatternPath]) -> Result<String, CliError> {
    let header = [
        "pattern",
        "voltage_V",
        "max_displacement_mm",
        "displacement_mm",
        "smallest_eigenvalue",
        "negative_eigenvalues",
        "stable",
        "event",
    ];
    let rows = paths.iter().enumerate().flat_map(|(index, PatternPath { path, .. })| {
        path.points.iter().enumerate().map(move |(row, point)| {
            let event = path.events.iter().find(|event| event.point == row);
            vec![
                index.to_string(),
                point.voltage.to_string(),
                point.max_displacement.to_string(),
                point.displacement.to_string(),
                point.smallest_eigenvalue.to_string(),
                point.negative_eigenvalues.to_string(),
                u8::from(point.stable).to_string(),
                event.map_or("", |event| event.kind.name()).to_owned(),
            ]
        })
    });
    csv::text(&header.map(str::to_owned), rows)
}
