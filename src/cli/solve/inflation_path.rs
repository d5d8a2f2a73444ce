//! `deaflow solve --path` of a scene with a pressure or a volume: curves of pressure, volume, height and voltage.

use serde_json::{Value, json};

use super::breakdown::{BreakdownPlace, FieldAlongPath};
use super::inflation::{at_mm, check, check_arguments, components, compressed, corner_mm, resolved, without_option};
use super::path::offsets;
use super::simulation::{Computation, PatternSolver, Simulation};
use crate::job::{Attachments, JobResult};
use crate::text::Text;
use crate::{CliError, Exit, Output, csv, model_warnings, table};
use deaflow_base::four_digits;
use deaflow_content::{CoveredCells, DrawnElectrodes, InflationPaths, Packed};
use deaflow_fem::{InflationPath, InflationPathSolver, InflationPoint, NoPath, PathEnd, PathParameter, SetupError};
use deaflow_pattern::Pattern;
use deaflow_report::figures::{Branch, Limit, PathAxes, paths_sheet};
use deaflow_scene::{Pressurised, Scene};

/// Follows the paths of patterns under pressure.
///
/// # Errors
/// When an option, the scene or a pattern cannot be used, or a file cannot be written.
pub fn execute(simulation: Simulation<'_>, parameter: PathParameter, output: &Output) -> Result<Exit, CliError> {
    check_arguments(&simulation)?;
    if simulation.arguments.point.is_given() {
        let help = "remove `--point`; the heights of all corners are in the file";
        return Err(without_option(&simulation.scene, "this option", help));
    }
    let InflatedPaths {
        scene,
        paths,
        content,
        warnings,
    } = InflatedPaths::follow(&simulation.computation(), parameter)?;
    let branches: Vec<Branch> = paths.iter().enumerate().map(branch).collect();
    let axes = axes(parameter, &paths, &scene);
    let mut found = json!({
        "parameter": parameter.name(),
        "paths": paths.iter().map(|path| document(path, &scene)).collect::<Vec<_>>(),
    });
    let mut text = Text::of(overview(&paths));
    if let Some(state) = simulation.state() {
        found["state"] = json!(state);
        text.line(format!("state: {state}"));
    }
    let result = JobResult {
        patterns: paths.len(),
        arrays: content.object(),
        parameters: simulation.described(&format!(", path of the {}", parameter.name())),
        attachments: Some(Attachments {
            title: "deaflow solve --path",
            table: points_table(&paths)?,
            draw: Box::new(move |figure| paths_sheet(&branches, &axes)?.write_png(figure)),
        }),
        warnings,
        document: found,
        text,
        exit: Exit::Done,
    };
    simulation.finish(result, output)
}

/// The paths of patterns under pressure.
pub struct InflatedPaths {
    scene: Scene,
    paths: Vec<InflationPath>,
    /// The arrays.
    pub content: InflationPaths,
    /// Warnings about the model, one line each.
    pub warnings: Vec<String>,
}

impl InflatedPaths {
    /// Follows the path of each pattern.
    ///
    /// # Errors
    /// When the scene or a pattern cannot be simulated in this way, or a path has no start.
    pub fn follow(computation: &Computation<'_>, parameter: PathParameter) -> Result<Self, CliError> {
        check(computation)?;
        let options = computation.options()?;
        let (scene, left_out) = resolved(computation.scene)?;
        let solvers = PatternSolver::new(&scene, |scene| InflationPathSolver::new(scene, options, parameter))
            .map_err(|error| refused(error, &scene))?;
        let paths = computation.run_at_once(|[pattern, _]| {
            let path = solvers.with(pattern, |solver: &InflationPathSolver| solver.path(pattern))?;
            path.map_err(|reason| no_path(reason, parameter))
        })?;
        Ok(Self {
            content: content(computation.patterns, &paths, &scene),
            warnings: left_out.into_iter().chain(warnings(&scene, &paths)?).collect(),
            scene,
            paths,
        })
    }
}

/// Adds what to do to the reason why a scene has no such path.
fn refused(error: SetupError, scene: &Scene) -> CliError {
    let help = match (&error, scene.pressurised()) {
        (SetupError::PathUnderPressure { parameter }, Some(load)) => {
            let own = match load {
                Pressurised::Pressure(_) => "pressure",
                Pressurised::Volume(_) => "volume",
            };
            Some(match *parameter {
                "voltage" => format!("the scene has no voltage; use `--path={own}`"),
                same if same == own => format!("the {own} of the scene is 0; give the last one of the path"),
                other @ ("pressure" | "volume") => {
                    let unit = if other == "volume" { "20 ml" } else { "500 Pa" };
                    format!("use `--path={own}`, or give `loads: {{ {other}: {unit} }}`")
                }
                _ => format!("use `--path={own}`, or `--path` for one of the voltage"),
            })
        }
        _ => None,
    };
    let error = CliError::from(error);
    match help {
        Some(help) => error.help(help),
        None => error,
    }
}

/// Returns why there is no path.
fn no_path(reason: NoPath, parameter: PathParameter) -> CliError {
    match reason {
        NoPath::Memory => CliError::failure("not enough memory"),
        NoPath::Start => {
            let state = match parameter {
                PathParameter::Voltage => "under its `loads` without voltage",
                _ => "without `loads` at its voltage",
            };
            CliError::failure(format!(
                "the membrane has no stable state {state}, where this path starts"
            ))
            .help("lower the load or the voltage, or mount the membrane at another `prestretch`")
        }
    }
}

/// The value along the horizontal axis of a figure.
fn along(parameter: PathParameter, point: &InflationPoint) -> f64 {
    match parameter {
        PathParameter::Voltage => 1e-3 * point.voltage,
        PathParameter::Volume => point.volume,
        _ => point.pressure,
    }
}

/// The value along the vertical axis.
fn across(parameter: PathParameter, point: &InflationPoint) -> f64 {
    match parameter {
        PathParameter::Volume => point.pressure,
        _ => point.watched_height,
    }
}

fn axes(parameter: PathParameter, paths: &[InflationPath], scene: &Scene) -> PathAxes {
    let height = match paths {
        [one] => {
            let [x, y] = corner_mm(one.watched, scene).map(|mm| (100.0 * mm).round() / 100.0);
            format!("Height at ({x}, {y}) mm, the point that moves most at the end [mm]")
        }
        _ => "Height of the point that moves most at the end of each path [mm]".to_owned(),
    };
    let [along, unit, across] = match parameter {
        PathParameter::Voltage => ["Voltage [kV]", "kV", &height],
        PathParameter::Volume => ["Volume [ml]", "ml", "Pressure [Pa]"],
        _ => ["Pressure [Pa]", "Pa", &height],
    };
    PathAxes {
        along: along.to_owned(),
        unit: unit.to_owned(),
        across: across.to_owned(),
    }
}

/// Returns the point that ends the stable part, if one does.
fn limit(path: &InflationPath) -> Option<&InflationPoint> {
    path.points.last().filter(|_| path.end == PathEnd::LimitPoint)
}

fn largest(path: &InflationPath) -> Option<&InflationPoint> {
    path.points.get(path.largest_pressure?)
}

/// Returns the curve of a path in the figure.
fn branch((index, path): (usize, &InflationPath)) -> Branch {
    let parameter = path.parameter;
    let marked = limit(path).map(|point| (point, PathEnd::LimitPoint.name()));
    let marked = marked.or_else(|| largest(path).map(|point| (point, "largest pressure")));
    Branch {
        name: format!("pattern {index}"),
        along: path.points.iter().map(|point| along(parameter, point)).collect(),
        across: path.points.iter().map(|point| across(parameter, point)).collect(),
        stable: path.points.iter().map(|point| point.stable).collect(),
        limit: marked.map(|(point, name)| Limit {
            name: name.to_owned(),
            along: along(parameter, point),
            error: None,
            across: across(parameter, point),
        }),
        breakdown: field(path)
            .reached()
            .map(|reached| [along, across].map(|value| reached.between(|at| value(parameter, &path.points[at])))),
        first: None,
    }
}

fn warnings(scene: &Scene, paths: &[InflationPath]) -> Result<Vec<String>, SetupError> {
    let of_one = |(index, path): (usize, &InflationPath)| {
        let most = path.points.iter().map(|point| point.compressed).fold(0.0, f64::max);
        compressed(scene, &format!("pattern {index}"), most)
    };
    let compressed = paths.iter().enumerate().filter_map(of_one);
    let fields = paths.iter().enumerate().filter_map(|(index, path)| {
        let (value, unit) = changing(path.parameter);
        let at = |reached: &BreakdownPlace| {
            let value = reached.between(|at| value(&path.points[at]));
            format!("{} {unit}", four_digits(value))
        };
        field(path).warning(scene, index, at, limit(path).is_some())
    });
    let neglected = model_warnings::in_space(scene)?.into_iter();
    Ok(neglected.chain(fields).chain(compressed).collect())
}

/// Returns the electric field along a path.
fn field(path: &InflationPath) -> FieldAlongPath {
    let of_stable = |point: &InflationPoint| if point.stable { point.breakdown_ratio } else { 0.0 };
    FieldAlongPath(path.points.iter().map(of_stable).collect())
}

/// What changes along a path, and its unit.
fn changing(parameter: PathParameter) -> (fn(&InflationPoint) -> f64, &'static str) {
    match parameter {
        PathParameter::Voltage => (|point| point.voltage, "V"),
        PathParameter::Volume => (|point| point.volume, "ml"),
        _ => (|point| point.pressure, "Pa"),
    }
}

/// Describes a limit in what changes.
fn place(parameter: PathParameter, point: &InflationPoint) -> String {
    let (value, unit) = changing(parameter);
    format!("{} {unit}", four_digits(value(point)))
}

fn overview(paths: &[InflationPath]) -> table::Table {
    let header = [
        "pattern",
        "limit",
        "largest pressure",
        "largest displacement",
        "points",
        "end",
    ];
    let mut table = table::table(&header, &["largest displacement", "points"]).dispensable(&["points"]);
    for (index, path) in paths.iter().enumerate() {
        let limit = limit(path).map(|point| format!("limit-point at {}", place(path.parameter, point)));
        let largest = largest(path).map(|point| {
            let [pascals, millilitres] = [point.pressure, point.volume].map(four_digits);
            format!("{pascals} Pa at {millilitres} ml")
        });
        let most = path.points.iter().map(|point| point.peak.mm).fold(0.0, f64::max);
        table.add_row([
            index.to_string(),
            limit.unwrap_or_else(|| "none".to_owned()),
            largest.unwrap_or_else(|| "-".to_owned()),
            format!("{} mm", four_digits(most)),
            path.points.len().to_string(),
            path.end.name().to_owned(),
        ]);
    }
    table
}

fn document(path: &InflationPath, scene: &Scene) -> Value {
    let points = path.points.iter().map(|point| {
        json!({
            "voltage": point.voltage,
            "pressure_pa": point.pressure,
            "volume_ml": point.volume,
            "largest_displacement_mm": point.peak.mm,
            "height_mm": point.peak.height,
            "at_mm": at_mm(&point.peak, scene),
            "watched_height_mm": point.watched_height,
            "stable": point.stable,
            "stable_at_pressure": point.stable_at_pressure,
            "wrinkled_fraction": point.compressed,
            "breakdown_ratio": point.breakdown_ratio,
        })
    });
    let last = path.points.len().saturating_sub(1);
    let limit = limit(path).map(|point| {
        json!({
            "kind": PathEnd::LimitPoint.name(),
            "voltage": point.voltage,
            "pressure_pa": point.pressure,
            "volume_ml": point.volume,
            "point": last,
        })
    });
    let largest = largest(path).map(
        |point| json!({ "pressure_pa": point.pressure, "volume_ml": point.volume, "point": path.largest_pressure }),
    );
    json!({
        "points": points.collect::<Vec<_>>(),
        "limit": limit,
        "largest_pressure": largest,
        "watched_corner": path.watched,
        "end": path.end.name(),
    })
}

fn content(patterns: &[Pattern], paths: &[InflationPath], scene: &Scene) -> InflationPaths {
    let each = |value: fn(&InflationPoint) -> f64| -> Vec<f64> {
        paths.iter().flat_map(|path| &path.points).map(value).collect()
    };
    let is = |value: fn(&InflationPoint) -> bool| -> Vec<u8> {
        let points = paths.iter().flat_map(|path| &path.points);
        points.map(|point| u8::from(value(point))).collect()
    };
    let of_largest = |value: fn(&InflationPoint) -> f64| -> Vec<f64> {
        paths.iter().map(|path| largest(path).map_or(f64::NAN, value)).collect()
    };
    let last = paths
        .iter()
        .flat_map(|path| components(&path.displacement, &path.heights).flatten());
    InflationPaths {
        patterns: patterns.to_vec(),
        electrodes: DrawnElectrodes::of(patterns),
        covered: CoveredCells::of(patterns),
        point_offsets: offsets(paths.iter().map(|path| path.points.len())),
        voltage: each(|point| point.voltage),
        pressure: each(|point| point.pressure),
        volume: each(|point| point.volume),
        max_displacement: each(|point| point.peak.mm),
        height: each(|point| point.peak.height),
        watched_height: each(|point| point.watched_height),
        stable: is(|point| point.stable),
        stable_at_pressure: is(|point| point.stable_at_pressure),
        wrinkled_fraction: each(|point| point.compressed),
        breakdown_ratio: each(|point| point.breakdown_ratio),
        largest_pressure: of_largest(|point| point.pressure),
        largest_pressure_volume: of_largest(|point| point.volume),
        watched_corner: paths
            .iter()
            .map(|path| path.watched.map(|corner| corner as u64))
            .collect(),
        end: paths.iter().map(|path| path.end.name().to_owned()).collect(),
        last_displacement: Packed(last.collect()),
        scene: scene.clone(),
        effects: scene.effects.clone(),
    }
}

/// Returns all points as comma-separated values with a header.
fn points_table(paths: &[InflationPath]) -> Result<String, CliError> {
    let header = [
        "pattern",
        "voltage_V",
        "pressure_Pa",
        "volume_ml",
        "max_displacement_mm",
        "height_mm",
        "stable",
        "stable_at_pressure",
        "wrinkled_fraction",
        "breakdown_ratio",
        "watched_height_mm",
    ]
    .map(str::to_owned);
    let rows = paths.iter().enumerate().flat_map(|(index, path)| {
        path.points.iter().map(move |point| {
            vec![
                index.to_string(),
                point.voltage.to_string(),
                point.pressure.to_string(),
                point.volume.to_string(),
                point.peak.mm.to_string(),
                point.peak.height.to_string(),
                u8::from(point.stable).to_string(),
                u8::from(point.stable_at_pressure).to_string(),
                point.compressed.to_string(),
                point.breakdown_ratio.to_string(),
                point.watched_height.to_string(),
            ]
        })
    });
    csv::text(&header, rows)
}
