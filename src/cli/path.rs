//! `deaflow solve --path`: how patterns get from rest to the loss of stability, and what lies beyond.

use std::time::Instant;

use rayon::prelude::*;
use serde_json::{Value, json};

use super::error::CliError;
use super::output::{Exit, Output};
use super::progress::Bar;
use super::solve::{SolveArguments, check_file, provenance};
use super::text::Text;
use super::{table, write};
use deaflow_base::Progress;
use deaflow_content::LoadPaths;
use deaflow_fem::screening::resolve;
use deaflow_fem::{
    CriticalSearch, CriticalVoltage, LoadPath, MembraneSolver, MeshLimit, PathEvent, SolveOptions, check_leads,
};
use deaflow_pattern::Pattern;
use deaflow_report::figures::{Branch, Limit, draw_paths};
use deaflow_scene::Scene;
use deaflow_stage::direct;
use deaflow_store::write_file;

/// A path, and where stability is lost once the error of its mesh is reckoned with.
struct Followed {
    path: LoadPath,
    critical: Option<CriticalVoltage>,
}

/// Follows the paths of patterns and writes them as arrays, as a table and as a figure.
///
/// # Errors
/// When a file would be lost, the scene or a pattern cannot be used, memory is short, or a file cannot be written.
pub fn execute(arguments: &SolveArguments, scene: &[&str], output: &Output) -> Result<Exit, CliError> {
    let file = &arguments.patterns.file()?.to_owned();
    let (values, figure) = (file.with_extension("csv"), file.with_extension("png"));
    if [&values, &figure].contains(&file) {
        return Err(
            CliError::bad_input(format!("{} would be written twice", file.display()))
                .help("-o names the HDF5 file, as in OUT.h5; OUT.csv and OUT.png are written beside it"),
        );
    }
    for beside in [&values, &figure] {
        check_file(beside, &arguments.patterns, scene)?;
    }
    let read = arguments.read_scene()?;
    let patterns = direct::patterns(&arguments.patterns.patterns, read.form())?;
    check_leads(read.leads.as_ref(), &patterns)?;
    let options = arguments.options();
    let (bar, start) = (Bar::new("path", "patterns", patterns.len() as u64), Instant::now());
    let (content, paths) = paths(&read, &patterns, options, &bar)?;
    bar.clear();
    let seconds = start.elapsed().as_secs_f64();
    let parameters = format!(
        "{}, {}, tolerance: {:e}, path",
        arguments.described(),
        options.mesh,
        options.tolerance
    );
    write_file(
        file,
        &content.object(),
        &provenance("solve", parameters.clone(), seconds),
    )?;
    let source = format!("{}; {parameters}", file.display());
    write::csv(
        &values,
        points_table(&paths).as_bytes(),
        "deaflow solve --path",
        &source,
    )?;
    let branches: Vec<Branch> = paths.iter().enumerate().map(branch).collect();
    draw_paths(&figure, &branches)?;
    if output.is_json() {
        output.document(&json!({
            "file": file,
            "table": values,
            "figure": figure,
            "paths": paths.iter().map(document).collect::<Vec<_>>(),
            "seconds": seconds,
        }))?;
    } else {
        let files = [
            file.display().to_string(),
            write::with_metadata(&values),
            figure.display().to_string(),
        ];
        let time = table::seconds(seconds);
        let mut text = Text::of(overview(&paths));
        text.line(format!("{} in {time}", files.join(", ")));
        output.text(text)?;
    }
    Ok(Exit::Done)
}

/// One line per pattern.
fn overview(paths: &[Followed]) -> table::Table {
    let header = ["pattern", "limit", "voltage", "on this mesh", "points", "end"];
    let mut table = table::table(&header, &["voltage", "on this mesh", "points"]).dispensable(&["points"]);
    for (index, Followed { path, critical }) in paths.iter().enumerate() {
        let limit = path.limit();
        // The displacement is that at the voltage of this mesh, not at the one that is extrapolated from two.
        let on_mesh = limit.and_then(|limit| {
            let mm = path.points.get(limit.point)?.max_displacement;
            Some(format!("{mm:.4} mm at {:.1} V", limit.voltage))
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

/// A voltage with its error, as people write it.
pub fn with_error(critical: &CriticalVoltage) -> String {
    match critical.error {
        Some(error) => format!("{:.1} ± {error:.1} V", critical.voltage),
        None => format!("{:.1} V, error not known", critical.voltage),
    }
}

fn document(Followed { path, critical }: &Followed) -> Value {
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

/// What the figure shows of a path.
fn branch((index, Followed { path, critical }): (usize, &Followed)) -> Branch {
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

/// Follows the paths of patterns in a scene read from `scene`: a scene, or a pipeline whose scene is used. Its voltage does
/// not matter.
///
/// # Errors
/// When the solver cannot be set up, or memory is short.
fn paths(
    scene: &Scene,
    patterns: &[Pattern],
    options: SolveOptions,
    progress: &dyn Progress,
) -> Result<(LoadPaths, Vec<Followed>), CliError> {
    let scene = resolve(scene)?;
    let solver = MembraneSolver::new(&scene, options)?;
    let search = CriticalSearch::new(&scene, options)?;
    let follow = |pattern: &Pattern| one(&solver, &search, pattern, progress);
    let paths = patterns.par_iter().map(follow).collect::<Result<Vec<_>, _>>()?;
    Ok((load_paths(patterns, &paths, scene), paths))
}

fn one(
    solver: &MembraneSolver,
    search: &CriticalSearch,
    pattern: &Pattern,
    progress: &dyn Progress,
) -> Result<Followed, CliError> {
    let path = solver.path(pattern);
    let limit = path.as_ref().and_then(LoadPath::limit);
    let critical = limit.map(|limit| search.from(pattern, solver.mesh(), limit.voltage));
    progress.advance(1);
    let path = path.ok_or_else(|| CliError::failure("the factors of the tangent do not fit into memory"))?;
    Ok(Followed { path, critical })
}

fn load_paths(patterns: &[Pattern], followed: &[Followed], scene: Scene) -> LoadPaths {
    let paths: Vec<&LoadPath> = followed.iter().map(|one| &one.path).collect();
    let critical = |value: fn(&CriticalVoltage) -> Option<f64>| {
        let value = |one: &Followed| one.critical.as_ref().and_then(value).unwrap_or(f64::NAN);
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

/// All points as comma-separated values with a header.
fn points_table(paths: &[Followed]) -> String {
    let header =
        "pattern,voltage_V,max_displacement_mm,displacement_mm,smallest_eigenvalue,negative_eigenvalues,stable,event";
    let mut text = format!("{header}\n");
    for (index, Followed { path, .. }) in paths.iter().enumerate() {
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
