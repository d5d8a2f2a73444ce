//! The best design of a report as the voltage rises.

use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::progress::{ProgressMode, show_count};
use crate::solve::field_along;
use deaflow_fem::screening::resolve;
use deaflow_fem::{LoadPath, MembraneSolver, PathParameter, PathSolver, SolveOptions};
use deaflow_field::{Field, Mesh};
use deaflow_orchestrator::Pipeline;
use deaflow_report::{Design, SweepEnd, VoltageLimits, VoltageSweep, best_design};
use deaflow_scene::{Breakdown, Scene};

/// Numbers of cells up to which elements are biquadratic, as those of `solve --path`, and bilinear; larger membranes
/// take too long for a picture.
const MOST_CELLS: [usize; 2] = [4_000, 16_000];

/// Shares of the last voltage that are drawn besides that of the scene: closer where the membrane moves faster.
const SHARES: [f64; 8] = [0.0, 0.3, 0.5, 0.65, 0.8, 0.9, 0.96, 1.0];

/// What happens beyond this multiple of the voltage of the scene is not drawn: the design would hardly move at its own.
const FARTHEST: f64 = 3.0;

/// Simulates the best design from rest until its electric field reaches the breakdown field or it loses stability, or
/// to the voltage of the scene if both are far or below it. `None` if there is no design of a search, if it has several
/// states, voltages or a charge, if it moves in time, out of the plane or at free sides, if it has too many cells, or
/// if it has no solution on a coarse mesh: it is drawn at rest and at its voltage then.
pub fn voltage_sweep(designs: &[Design], pipeline: &Pipeline) -> Option<VoltageSweep> {
    let design = best_design(designs)?;
    let rising = RisingVoltage::of(design, pipeline)?;
    let RisingVoltage {
        scene,
        options,
        volts,
        path,
    } = &rising;
    let limit = path.limit().map(|limit| (limit.voltage, SweepEnd::Limit));
    let ends = [rising.breakdown().map(|volts| (volts, SweepEnd::Breakdown)), limit]
        .into_iter()
        .flatten();
    let first = ends.min_by(|one, other| one.0.total_cmp(&other.0));
    let first = first.filter(|(end, _)| (*volts..=FARTHEST * volts).contains(end));
    let (last, end) = first.unwrap_or((*volts, SweepEnd::Scene));
    let mut voltages: Vec<f64> = SHARES.iter().map(|share| share * last).chain([*volts]).collect();
    voltages.sort_by(f64::total_cmp);
    voltages.retain(|voltage| *voltage <= last);
    voltages.dedup();
    let state = |voltage: f64| match (end, voltage == last) {
        (SweepEnd::Limit, true) => Some((voltage, path.limit_field.clone())),
        _ => Some((voltage, solve(&scene.at_voltage(voltage), *options, design)?)),
    };
    let states = voltages.into_iter().map(state).collect::<Option<_>>()?;
    Some(VoltageSweep {
        design: design.name.clone(),
        voltage: *volts,
        states,
        end,
    })
}

/// Finds the largest voltages of a design on the mesh of [`voltage_sweep`]; `None` for devices that it does not
/// simulate.
pub fn voltage_limits(design: &Design, pipeline: &Pipeline) -> Option<VoltageLimits> {
    let rising = RisingVoltage::of(design, pipeline)?;
    let field = field_along(&rising.path);
    let points = &rising.path.points[..field.0.len()];
    let breakdown_share = points.windows(2).zip(field.0.windows(2)).find_map(|(points, ratios)| {
        let [from, to] = [points[0].voltage, points[1].voltage];
        let part = (rising.volts - from) / (to - from);
        (0.0..=1.0)
            .contains(&part)
            .then(|| ratios[0] + part * (ratios[1] - ratios[0]))
    });
    Some(VoltageLimits {
        voltage: rising.volts,
        lost: rising.path.limit().map(|limit| limit.voltage),
        breakdown: rising.breakdown(),
        breakdown_share,
        is_breakdown_assumed: rising.scene.breakdown_strength().is_none(),
        reached: points.iter().map(|point| point.voltage).fold(0.0, f64::max),
    })
}

/// A design on its path from rest at rising voltage.
struct RisingVoltage {
    scene: Scene,
    options: SolveOptions,
    /// The voltage of the scene.
    volts: f64,
    path: LoadPath,
}

impl RisingVoltage {
    /// Follows a design on a coarse mesh; `None` for devices that [`voltage_sweep`] does not simulate.
    fn of(design: &Design, pipeline: &Pipeline) -> Option<Self> {
        let mut scene = resolve(&design.scene).ok()?;
        // Artifacts of simulations that do not need the breakdown field do not have it.
        scene.properties.dielectric_breakdown = breakdown_strength(design, pipeline);
        let [volts] = scene.drive.voltages.in_volts()[..] else {
            return None;
        };
        let drive = &scene.drive;
        let is_at_rest = design.objective.moment.is_none() && drive.waveform.is_none();
        let is_plain = is_at_rest && drive.charge.is_none() && design.states.is_empty();
        if !is_plain || scene.loads.is_some() || scene.is_in_space() || scene.geometry.sides.is_some() {
            return None;
        }
        let mesh = match design.pattern.raster().cells() {
            cells if cells <= MOST_CELLS[0] => Mesh::biquadratic(1),
            cells if cells <= MOST_CELLS[1] => Mesh::bilinear(1),
            _ => return None,
        };
        let options = SolveOptions {
            mesh,
            ..SolveOptions::default()
        };
        let points = Arc::new(AtomicU64::new(0));
        // A few seconds of work beside a report: lines elsewhere would only come between its messages.
        let mode = match std::io::stderr().is_terminal() {
            true => ProgressMode::Bars,
            false => ProgressMode::Warnings,
        };
        let shown = show_count(mode, ["voltage sweep", "states"], points.clone(), 0);
        let count = |_: &Field| points.fetch_add(1, Ordering::Relaxed) as f64;
        let path = PathSolver::new(&scene, options, PathParameter::Voltage).ok()?;
        let path = path.observed_path(&design.pattern, Some(&count)).ok()?;
        drop(shown);
        Some(Self {
            scene,
            options,
            volts,
            path,
        })
    }

    /// The voltage at which the electric field reaches the breakdown field on the stable part.
    fn breakdown(&self) -> Option<f64> {
        let place = field_along(&self.path).reached()?;
        Some(place.between(|at| self.path.points[at].voltage))
    }
}

/// Returns the breakdown strength in the scene of a design, as the pipeline has it.
fn breakdown_strength(design: &Design, pipeline: &Pipeline) -> Option<Breakdown> {
    let stage = pipeline.stages.iter().find(|stage| stage.name == design.made.stage)?;
    // The pipeline has been read with its scenes, so they are valid.
    let scene = pipeline.scene_of(stage)?;
    Scene::read(&scene).ok()?.breakdown_strength().cloned()
}

fn solve(scene: &Scene, options: SolveOptions, design: &Design) -> Option<Field> {
    let solver = MembraneSolver::new(scene, options).ok()?;
    let solution = solver.solve(&design.pattern);
    solution.outcome.has_field().then(|| solver.field(&solution))
}
