//! `deaflow solve --path`: load paths from rest past the critical voltage, load or displacement.

use serde_json::{Value, json};

use super::breakdown::{BreakdownPlace, FieldAlongPath};
use super::inflation::without_option;
use super::simulation::{Computation, Form, PatternSolver, Simulation, States};
use super::{SolveArguments, inflation_path};
use crate::job::{Attachments, JobResult, extend};
use crate::point::Probe;
use crate::results::{spoken, with_error};
use crate::text::Text;
use crate::{CliError, Exit, Output, csv, model_warnings, table};
use deaflow_base::four_digits;
use deaflow_content::{CoveredCells, DrawnElectrodes, LoadPaths, Packed, rotations, translations};
use deaflow_fem::screening::{observing_breakdown, resolve};
use deaflow_fem::{
    CriticalSearch, CriticalVoltage, LoadPath, MeshLimit, NoPath, Observe, PathEvent, PathParameter, PathPoint,
    PathSolver, SetupError, SideState,
};
use deaflow_field::{Field, Motion};
use deaflow_pattern::Pattern;
use deaflow_report::figures::{Branch, FirstFailure, Limit, PathAxes, paths_sheet};
use deaflow_scene::{Body, Edge, Scene, SideSupport, Sides};

/// A load path, with the critical voltage and its error.
struct PatternPath {
    path: LoadPath,
    critical: Option<CriticalVoltage>,
}

pub const FORM: Form = Form {
    name: "path",
    has_attachments: true,
    states: States::Drive,
    without_covered_cells: None,
    without_pressure: None,
};

/// Follows the load paths of patterns.
///
/// # Errors
/// When a file would be lost, the scene or a pattern cannot be used, memory is short, or a file cannot be written.
pub fn execute(arguments: &SolveArguments, parameter: PathParameter, output: &Output) -> Result<Exit, CliError> {
    let simulation = Simulation::read(arguments, &FORM)?;
    if simulation.scene.loads.is_some() {
        return inflation_path::execute(simulation, parameter, output);
    }
    if simulation.scene.is_in_space() {
        let help = "remove `--path`, or give two numbers for each `load` and `spring`";
        return Err(without_option(&simulation.scene, "`--path`", help));
    }
    let probe = arguments.point.on(&simulation.scene)?;
    let Paths {
        paths,
        controlled,
        content,
        warnings,
    } = Paths::follow(&simulation.computation(), parameter, probe)?;
    let branches: Vec<Branch> = paths.iter().enumerate().map(|one| controlled.branch(one)).collect();
    let axes = controlled.axes();
    let mut found = json!({
        "parameter": parameter.name(),
        "paths": paths.iter().map(|path| document(path, &controlled)).collect::<Vec<_>>(),
    });
    if let Some(probe) = &probe {
        found["along"] = probe.document();
    }
    let mut text = Text::of(overview(&paths, &controlled));
    let has_no_error = |path: &PatternPath| path.critical.is_some_and(|found| found.error.is_none());
    if paths.iter().any(has_no_error) {
        let finer = arguments.mesh().elements_per_cell() + 1;
        text.line(format!(
            "a voltage without an error is that of this mesh alone: compare it with --elements-per-cell {finer}"
        ));
    }
    if let Some(state) = simulation.state() {
        found["state"] = json!(state);
        text.line(format!("state: {state}"));
    }
    let result = JobResult {
        patterns: paths.len(),
        arrays: content.object(),
        parameters: simulation.described(&match parameter {
            PathParameter::Voltage => ", path".to_owned(),
            other => format!(", path of the {}", other.name()),
        }),
        attachments: Some(Attachments {
            title: "deaflow solve --path",
            table: points_table(&paths, &controlled)?,
            draw: Box::new(move |figure| paths_sheet(&branches, &axes)?.write_png(figure)),
        }),
        warnings,
        document: found,
        text,
        exit: Exit::Done,
    };
    simulation.finish(result, output)
}

/// The load paths of patterns.
pub struct Paths {
    paths: Vec<PatternPath>,
    controlled: Controlled,
    /// The arrays.
    pub content: LoadPaths,
    /// Warnings about the model, one line each.
    pub warnings: Vec<String>,
}

impl Paths {
    /// Follows the load path of each pattern; the displacement of a point is wanted too, if one is given.
    ///
    /// # Errors
    /// When a pattern cannot be simulated, or a path has no start.
    pub fn follow(
        computation: &Computation<'_>,
        parameter: PathParameter,
        probe: Option<Probe>,
    ) -> Result<Self, CliError> {
        let scene = resolve(computation.scene)?;
        let options = computation.options()?;
        let solvers = PatternSolver::new(&scene, |scene| {
            let solver = PathSolver::new(scene, options, parameter)?;
            Ok::<_, SetupError>((solver, CriticalSearch::new(scene, options)?))
        })?;
        let controlled = Controlled {
            probe,
            ..Controlled::new(&scene, parameter)
        };
        let at_point = probe.map(|probe| move |field: &Field| probe.of(field));
        let observe = at_point.as_ref().map(|at_point| at_point as Observe<'_>);
        let paths = computation.run_at_once(|[pattern, drawing]| {
            let (path, critical) = solvers.with(pattern, |(solver, search)| {
                let path = solver
                    .observed_path(pattern, observe)
                    .map_err(|reason| no_path(reason, parameter));
                let limit = path.as_ref().ok().and_then(LoadPath::limit);
                let limit = limit.filter(|_| parameter == PathParameter::Voltage);
                let both = [pattern, drawing];
                let critical = limit.map(|limit| search.from_drawn(both, solver.solver().mesh(), limit.voltage));
                (path, critical)
            })?;
            Ok(PatternPath { path: path?, critical })
        })?;
        let buckling = paths.iter().enumerate().filter_map(|path| controlled.buckling(path));
        let breakdown = paths.iter().enumerate();
        let breakdown: Vec<String> = breakdown
            .filter_map(|path| controlled.breakdown(&scene, path))
            .collect();
        // The field at the voltage of the scene is that of a point of the path.
        let (screened, note) = below_limit(&scene, &paths);
        let neglected = model_warnings::of_equilibria(&observing_breakdown(&screened), computation.patterns)?;
        let neglected = note.into_iter().chain(neglected);
        Ok(Self {
            warnings: neglected.chain(breakdown).chain(buckling).collect(),
            content: LoadPaths {
                point: probe.map(|probe| probe.described()),
                ..load_paths(computation.patterns, &paths, scene)
            },
            paths,
            controlled,
        })
    }
}

/// Beyond the lowest limit of paths of the voltage, neglected effects are judged at this share of it: some pattern has
/// no stable state at the voltage of the scene.
const BELOW_LIMIT: f64 = 0.8;

/// Returns the scene at a voltage at which each pattern is stable, as far as paths of the voltage tell, and a line if
/// that is not the voltage of the scene.
fn below_limit(scene: &Scene, paths: &[PatternPath]) -> (Scene, Option<String>) {
    let of_voltage = paths.iter().filter(|one| one.path.parameter == PathParameter::Voltage);
    let limits = of_voltage.filter_map(|one| Some(one.path.limit()?.voltage));
    let lowest = limits.fold(f64::INFINITY, f64::min);
    if scene.at_largest_voltages().voltage_v() <= lowest {
        return (scene.clone(), None);
    }
    let voltage = BELOW_LIMIT * lowest;
    let lower = scene.at_voltage(voltage).with_effects(scene.effects.clone());
    let note = format!(
        "neglected effects are judged at {} V, as stability is lost below the voltage of the scene",
        four_digits(voltage)
    );
    (lower, Some(note))
}

/// Help where a path of loads or displacements cannot start.
const START: &str = "the membrane may be slack, or unstable at this voltage: lower the voltage, hold it by another \
                     support, or mount it at another `prestretch`";

/// Returns why there is no path.
fn no_path(reason: NoPath, parameter: PathParameter) -> CliError {
    match (reason, parameter) {
        (NoPath::Memory, _) => CliError::failure("not enough memory for the factors of the tangent"),
        (NoPath::Start, PathParameter::Voltage) => {
            CliError::failure("the membrane has no stable state without voltage under its loads, where a path starts")
                .help("lower the `load` of its sides and bodies, or mount it at a smaller `prestretch`")
        }
        (NoPath::Start, _) => {
            let (missing, name) = ("at the voltage of the scene without its", parameter.name());
            CliError::failure(format!(
                "the membrane has no stable state {missing} {name}, where this path starts"
            ))
            .help(START)
        }
    }
}

/// What is changed along paths, and how it is described.
struct Controlled {
    parameter: PathParameter,
    /// The point whose displacement is wanted.
    probe: Option<Probe>,
    /// The bars in their order.
    bars: Vec<Edge>,
    /// Of a load or displacement: its name, its unit and its value at a share of 1, if it is the only one.
    full: Option<(String, &'static str, f64)>,
    /// The side and the direction of the reaction to a displacement.
    pulled: Option<(Edge, [f64; 2])>,
}

impl Controlled {
    fn new(scene: &Scene, parameter: PathParameter) -> Self {
        let sides = || scene.geometry.sides.iter().flat_map(Sides::iter);
        let size = |[x, y]: [f64; 2]| x.hypot(y);
        let given: Vec<(Edge, [f64; 2])> = sides()
            .filter_map(|(edge, side)| Some((edge, side.bar()?.displacement_mm()?)))
            .collect();
        let on_side = |(edge, side): (Edge, &SideSupport)| {
            let (force, _) = side.force()?;
            Some((format!("Load on the {} side", edge.name()), size(force)))
        };
        let bodies = scene.geometry.bodies.iter().flatten().enumerate();
        let on_body = |(body, one): (usize, &Body)| (format!("Load on body {body}"), size(one.load_n()));
        let loads = sides().filter_map(on_side).chain(bodies.map(on_body));
        let loads: Vec<(String, f64)> = loads.filter(|(_, newtons)| *newtons > 0.0).collect();
        Self {
            parameter,
            probe: None,
            bars: sides().filter_map(|(edge, side)| side.bar().map(|_| edge)).collect(),
            full: match (parameter, &loads[..], &given[..]) {
                (PathParameter::Load, [(name, newtons)], _) => Some((name.clone(), "N", *newtons)),
                (PathParameter::Displacement, _, [(edge, by)]) => Some((
                    format!("Displacement of the bar on the {} side", edge.name()),
                    "mm",
                    size(*by),
                )),
                _ => None,
            },
            pulled: match (parameter, &given[..]) {
                (PathParameter::Displacement, [(edge, by)]) => Some((*edge, by.map(|c| c / size(*by)))),
                _ => None,
            },
        }
    }

    /// Returns the title of the displacement of the requested point, from the first state of the path.
    fn title(&self) -> Option<String> {
        let probe = self.probe.as_ref()?;
        Some(match self.parameter {
            PathParameter::Voltage => probe.title_from_rest(),
            other => probe.title_from(&format!("the state without {}", other.name())),
        })
    }

    /// The value along the horizontal axis of a figure.
    fn along(&self, point: &PathPoint) -> f64 {
        self.along_at(point.voltage, point.share)
    }

    /// The same at a voltage, and a share of the load or displacement.
    fn along_at(&self, voltage: f64, share: f64) -> f64 {
        match (self.parameter, &self.full) {
            (PathParameter::Voltage, _) => 1e-3 * voltage,
            (_, Some((_, _, full))) => full * share,
            (_, None) => share,
        }
    }

    /// The value along the vertical axis: the displacement of the requested point, the force along a given
    /// displacement, or the displacement of a corner.
    fn across(&self, point: &PathPoint) -> f64 {
        if let Some(mm) = point.observed {
            return mm;
        }
        match (&self.pulled, &point.sides) {
            (Some((edge, [x, y])), Some(sides)) => {
                let [p, q] = sides.reactions[*edge as usize];
                x * p + y * q
            }
            _ => point.displacement,
        }
    }

    /// Describes the axes of a figure.
    fn axes(&self) -> PathAxes {
        let (name, unit) = match (self.parameter, &self.full) {
            (PathParameter::Voltage, _) => ("Voltage".to_owned(), "kV"),
            (_, Some((name, unit, _))) => (name.clone(), *unit),
            (parameter, None) => (format!("Share of the {}s of the scene", parameter.name()), ""),
        };
        PathAxes {
            along: match unit {
                "" => name,
                _ => format!("{name} [{unit}]"),
            },
            unit: match unit {
                "" => format!("of the {}s", self.parameter.name()),
                _ => unit.to_owned(),
            },
            across: match (self.title(), &self.pulled) {
                (Some(title), _) => format!("Displacement {title} [mm]"),
                (None, Some(_)) => "Force of the bar along its displacement [N]".to_owned(),
                (None, None) => "Displacement of the point that moves most [mm]".to_owned(),
            },
        }
    }

    /// Describes a share of the load or displacement.
    fn text(&self, share: f64) -> String {
        match &self.full {
            Some((_, unit, full)) => format!("{} {unit}", four_digits(share * full)),
            None => format!("{} of the {}s", four_digits(share), self.parameter.name()),
        }
    }

    /// Warns of a flat membrane that would not stay flat on the stable part of a path.
    fn buckling(&self, (index, PatternPath { path, .. }): (usize, &PatternPath)) -> Option<String> {
        let limit = path.flat_limit?;
        let from = match self.parameter {
            PathParameter::Voltage => format!("{} V", four_digits(limit.voltage)),
            _ => self.text(limit.share),
        };
        let most = stable(path).filter_map(|point| point.compressed).fold(0.0, f64::max);
        let compressed = match most > 0.0 {
            true => format!(
                "; up to {:.0} % of it is compressed: simulate `wrinkling`",
                100.0 * most
            ),
            false => String::new(),
        };
        Some(format!(
            "pattern {index}: from {from} on the flat membrane wrinkles or buckles out of its plane{compressed}"
        ))
    }

    /// Warns of an electric field that is close to the breakdown field or exceeds it on the stable part of a path.
    fn breakdown(&self, scene: &Scene, (index, PatternPath { path, .. }): (usize, &PatternPath)) -> Option<String> {
        let points = &path.points;
        let at = |reached: &BreakdownPlace| match self.parameter {
            PathParameter::Voltage => format!("{} V", four_digits(reached.between(|at| points[at].voltage))),
            _ => self.text(reached.between(|at| points[at].share)),
        };
        field_along(path).warning(scene, index, at, path.limit().is_some())
    }

    /// Returns what fails before the limit on the stable part of a path: its name, and its place.
    fn first_failure(&self, PatternPath { path, critical }: &PatternPath) -> Option<FailurePlace> {
        let points = &path.points;
        let breakdown = field_along(path).reached().map(|reached| FailurePlace {
            name: "breakdown",
            voltage: reached.between(|at| points[at].voltage),
            share: reached.between(|at| points[at].share),
        });
        let flat = path.flat_limit.map(|limit| FailurePlace {
            name: "wrinkling or buckling",
            voltage: limit.voltage,
            share: limit.share,
        });
        let at = |one: &FailurePlace| match self.parameter {
            PathParameter::Voltage => one.voltage,
            _ => one.share,
        };
        let first = breakdown.into_iter().chain(flat);
        let first = first.min_by(|one, other| at(one).total_cmp(&at(other)))?;
        // The limit of two finer meshes may be lower than that of the path.
        let limit = path.limit().map(|limit| match self.parameter {
            PathParameter::Voltage => critical.map_or(limit.voltage, |critical| critical.voltage),
            _ => limit.share,
        });
        limit.is_none_or(|limit| at(&first) < limit).then_some(first)
    }

    /// Returns the curve of a path in the figure.
    fn branch(&self, (index, one): (usize, &PatternPath)) -> Branch {
        let PatternPath { path, critical } = one;
        let limit = path.limit().and_then(|limit| {
            let at = path.points.get(limit.point)?;
            let critical = match self.parameter {
                PathParameter::Voltage => Some((*critical)?),
                _ => None,
            };
            Some(Limit {
                name: spoken(limit.kind.name()).to_owned(),
                along: critical.map_or_else(|| self.along(at), |critical| 1e-3 * critical.voltage),
                error: critical.and_then(|critical| Some(1e-3 * critical.error?)),
                across: self.across(at),
            })
        });
        Branch {
            name: format!("pattern {index}"),
            along: path.points.iter().map(|p| self.along(p)).collect(),
            across: path.points.iter().map(|p| self.across(p)).collect(),
            stable: path.points.iter().map(|p| p.stable).collect(),
            limit,
            breakdown: field_along(path).reached().map(|reached| {
                let values: [&dyn Fn(&PathPoint) -> f64; 2] = [&|p| self.along(p), &|p| self.across(p)];
                values.map(|value| reached.between(|at| value(&path.points[at])))
            }),
            first: self.first_failure(one).map(|first| FirstFailure {
                name: first.name,
                along: self.along_at(first.voltage, first.share),
            }),
        }
    }
}

/// What fails before the limit of a path, and where.
struct FailurePlace {
    name: &'static str,
    voltage: f64,
    share: f64,
}

/// The points of the stable part of a path.
fn stable(path: &LoadPath) -> impl Iterator<Item = &PathPoint> {
    path.points.iter().take_while(|point| point.stable)
}

/// Returns the electric field on the stable part of a path.
pub fn field_along(path: &LoadPath) -> FieldAlongPath {
    FieldAlongPath(stable(path).map(|point| point.breakdown_ratio).collect())
}

/// Lists the patterns.
fn overview(paths: &[PatternPath], controlled: &Controlled) -> table::Table {
    let parameter = controlled.parameter;
    let title = controlled.title();
    let mut header = vec!["pattern", "limit", parameter.name(), "on this mesh", "points", "end"];
    if let Some(title) = &title {
        header.insert(4, title);
    }
    if parameter != PathParameter::Voltage {
        // There is no search on a second mesh.
        header.remove(2);
    }
    // Where nothing fails before, the limit is what fails first.
    let first: Vec<Option<FailurePlace>> = paths.iter().map(|one| controlled.first_failure(one)).collect();
    let has_first = first.iter().any(Option::is_some);
    if has_first {
        header.insert(1, "fails first");
    }
    let numbers: Vec<&str> = [parameter.name(), "on this mesh", "points"]
        .into_iter()
        .chain(title.as_deref())
        .filter(|name| header.contains(name))
        .collect();
    let mut table = table::table(&header, &numbers).dispensable(&["points"]);
    for (index, PatternPath { path, critical }) in paths.iter().enumerate() {
        let limit = path.limit();
        // The displacement belongs to the voltage of this mesh, not to the one extrapolated from two meshes.
        let on_mesh = limit.and_then(|limit| {
            let mm = path.points.get(limit.point)?.max_displacement;
            let at = match parameter {
                PathParameter::Voltage => format!("{} V", four_digits(limit.voltage)),
                _ => controlled.text(limit.share),
            };
            Some(format!("{} mm at {at}", four_digits(mm)))
        });
        let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
        let mut row = vec![
            index.to_string(),
            limit.map_or("none", |limit| spoken(limit.kind.name())).to_owned(),
            or_dash(on_mesh),
            path.points.len().to_string(),
            spoken(path.end.name()).to_owned(),
        ];
        if title.is_some() {
            let last = limit.map_or(path.points.len().checked_sub(1), |limit| Some(limit.point));
            let mm = last.and_then(|at| path.points.get(at)?.observed);
            row.insert(3, or_dash(mm.map(|mm| format!("{} mm", four_digits(mm)))));
        }
        if parameter == PathParameter::Voltage {
            row.insert(2, or_dash(critical.map(|critical| with_error(&critical))));
        }
        if has_first {
            let failure = first[index].as_ref().map(|first| match parameter {
                PathParameter::Voltage => format!("{} at {} V", first.name, four_digits(first.voltage)),
                _ => format!("{} at {}", first.name, controlled.text(first.share)),
            });
            let limit = || limit.map_or("none", |_| "the limit").to_owned();
            row.insert(1, failure.unwrap_or_else(limit));
        }
        table.add_row(row);
    }
    table
}

fn document(PatternPath { path, critical }: &PatternPath, controlled: &Controlled) -> Value {
    let points = path.points.iter().map(|p| {
        let mut point = json!({
            "voltage": p.voltage,
            "max_displacement": p.max_displacement,
            "displacement": p.displacement,
            "smallest_eigenvalue": p.smallest_eigenvalue,
            "out_of_plane_unstable": p.out_of_plane_unstable,
            "breakdown_ratio": p.breakdown_ratio,
            "negative_eigenvalues": p.negative_eigenvalues,
            "stable": p.stable,
        });
        if let Some(mm) = p.observed {
            point["along_mm"] = json!(mm);
        }
        if controlled.parameter != PathParameter::Voltage {
            point["share"] = json!(p.share);
        }
        if let Some(fraction) = p.compressed {
            point["wrinkled_fraction"] = json!(fraction);
        }
        if let Some(sides) = &p.sides {
            extend(&mut point, of_sides(sides, controlled));
        }
        point
    });
    let events: Vec<Value> = path
        .events
        .iter()
        .map(|event| {
            let mut one = json!({ "kind": event.kind.name(), "voltage": event.voltage, "point": event.point });
            if controlled.parameter != PathParameter::Voltage {
                one["share"] = json!(event.share);
            }
            one
        })
        .collect();
    let on_this_mesh = |limit: &PathEvent| {
        (controlled.parameter != PathParameter::Voltage)
            .then(|| json!({ "kind": limit.kind.name(), "share": limit.share, "point": limit.point }))
    };
    let with_error = path.limit().zip(*critical).map(|(limit, critical)| {
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
    let out_of_plane = path
        .flat_limit
        .map(|limit| json!({ "voltage": limit.voltage, "share": limit.share, "point": limit.point }));
    json!({
        "out_of_plane": out_of_plane,
        "breakdown": field_along(path).reached().map(|reached| {
            let between = |value: fn(&PathPoint) -> f64| reached.between(|at| value(&path.points[at]));
            json!({ "voltage": between(|point| point.voltage), "share": between(|point| point.share) })
        }),
        "limit": with_error.or_else(|| path.limit().as_ref().and_then(on_this_mesh)),
        "watched_corner": path.watched,
        "points": points.collect::<Vec<_>>(),
        "events": events,
        "end": path.end.name(),
    })
}

/// Describes the motions of bars and the forces of sides.
fn of_sides(sides: &SideState, controlled: &Controlled) -> Value {
    let bars = controlled.bars.iter().zip(&sides.bars).map(|(edge, motion)| {
        let own = json!({ "translation_mm": motion.translation, "rotation_deg": motion.rotation });
        (edge.name().to_owned(), own)
    });
    let reactions = Edge::ALL
        .iter()
        .zip(sides.reactions)
        .map(|(edge, force)| (edge.name().to_owned(), json!(force)));
    json!({ "bars": Value::Object(bars.collect()), "reactions_n": Value::Object(reactions.collect()) })
}

fn on_mesh(limit: MeshLimit) -> Value {
    json!({
        "elements_per_cell": limit.mesh.elements_per_cell(),
        "order": limit.mesh.order().degree(),
        "voltage": limit.voltage,
    })
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
    let sides = || points().filter_map(|point| point.sides.as_ref());
    let bars: Vec<Motion> = sides().flat_map(|sides| sides.bars.clone()).collect();
    let has_sides = sides().next().is_some();
    let has_shares = paths.iter().any(|path| path.parameter != PathParameter::Voltage);
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
        share: has_shares.then(|| points().map(|p| p.share).collect()),
        event_share: has_shares.then(|| events.iter().map(|(event, _)| event.share).collect()),
        bar_translation: (!bars.is_empty()).then(|| translations(&bars)),
        bar_rotation: (!bars.is_empty()).then(|| rotations(&bars)),
        reaction: has_sides.then(|| Packed(sides().flat_map(|side| side.reactions).flatten().collect())),
        rest: paths.iter().map(|path| path.rest.clone()).collect(),
        wrinkled_fraction: points().map(|p| p.compressed).collect(),
        out_of_plane_unstable: points().map(|p| p.out_of_plane_unstable as u64).collect(),
        breakdown_ratio: points().map(|p| p.breakdown_ratio).collect(),
        at_point: points().map(|p| p.observed).collect(),
        point: None,
        scene,
    }
}

/// Returns the sums of lengths, from 0 on.
pub fn offsets(lengths: impl Iterator<Item = usize>) -> Vec<u64> {
    let sums = lengths.scan(0, |sum, length| {
        *sum += length as u64;
        Some(*sum)
    });
    std::iter::once(0).chain(sums).collect()
}

/// Returns all points as comma-separated values with a header.
fn points_table(paths: &[PatternPath], controlled: &Controlled) -> Result<String, CliError> {
    let mut header: Vec<String> = [
        "pattern",
        "voltage_V",
        "max_displacement_mm",
        "displacement_mm",
        "smallest_eigenvalue",
        "negative_eigenvalues",
        "stable",
        "event",
    ]
    .map(str::to_owned)
    .into();
    let has_sides = paths
        .iter()
        .flat_map(|one| &one.path.points)
        .any(|point| point.sides.is_some());
    if controlled.parameter != PathParameter::Voltage {
        header.push("share".to_owned());
    }
    if has_sides {
        for edge in &controlled.bars {
            header.extend(["x_mm", "y_mm", "turn_deg"].map(|what| format!("bar_{}_{what}", edge.name())));
        }
        header.extend(
            Edge::ALL
                .iter()
                .flat_map(|edge| ["x_N", "y_N"].map(|what| format!("reaction_{}_{what}", edge.name()))),
        );
    }
    let mut points = paths.iter().flat_map(|one| &one.path.points);
    if points.any(|point| point.compressed.is_some()) {
        header.push("wrinkled_fraction".to_owned());
    }
    header.extend(["out_of_plane_unstable", "breakdown_ratio"].map(str::to_owned));
    header.extend(controlled.probe.map(|_| "point_displacement_mm".to_owned()));
    let rows = paths.iter().enumerate().flat_map(|(index, PatternPath { path, .. })| {
        path.points.iter().enumerate().map(move |(row, point)| {
            let event = path.events.iter().find(|event| event.point == row);
            let mut row = vec![
                index.to_string(),
                point.voltage.to_string(),
                point.max_displacement.to_string(),
                point.displacement.to_string(),
                point.smallest_eigenvalue.to_string(),
                point.negative_eigenvalues.to_string(),
                u8::from(point.stable).to_string(),
                event.map_or("", |event| event.kind.name()).to_owned(),
            ];
            if controlled.parameter != PathParameter::Voltage {
                row.push(point.share.to_string());
            }
            if let Some(sides) = &point.sides {
                let bars = sides
                    .bars
                    .iter()
                    .flat_map(|bar| [bar.translation[0], bar.translation[1], bar.rotation]);
                let numbers = bars.chain(sides.reactions.into_iter().flatten());
                row.extend(numbers.map(|value| value.to_string()));
            }
            row.extend(point.compressed.map(|share| share.to_string()));
            row.push(point.out_of_plane_unstable.to_string());
            row.push(point.breakdown_ratio.to_string());
            row.extend(point.observed.map(|mm| mm.to_string()));
            row
        })
    });
    csv::text(&header, rows)
}
