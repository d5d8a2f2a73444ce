//! Load paths: equilibria of a membrane from rest to the loss of stability and beyond, with rising voltage, or at
//! constant voltage with rising loads or given motions of bars, or a rising pressure or volume below the membrane.
//!
//! A solution at one voltage shows whether the membrane is stable there. A path shows how it gets there and what ends
//! it: a fold, where the voltage has a maximum along the curve of equilibria and the membrane snaps; a bifurcation,
//! where another branch crosses below the fold; or a loss of ellipticity, beyond which the equations are not valid.

pub(super) mod curve;
mod flat_watch;
mod inflation;
pub(super) mod trace;

use deaflow_field::{Field, Motion};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

use super::cells::compressed_fraction;
use super::effects::{WithMaterial, breakdown_ratio, breakdown_strength_or_default};
use super::error::SetupError;
use super::gauge::check_resisted;
use super::layout::SIDES;
use super::material::Material;
use super::observable::States;
use super::operator::{Activity, Operator};
use super::out_of_plane::FlatStability;
use super::reactions::SideForces;
use super::solver::{MembraneSolver, SolveOptions};

use curve::Curve;
use flat_watch::{FlatLimit, FlatWatch};
pub use inflation::{InflationPath, InflationPathSolver, InflationPoint};
use trace::{PathState, Trace, follow};

/// What changes along a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathParameter {
    /// The voltage, from 0 and whatever that of the scene is, under the loads of the scene.
    Voltage,
    /// The forces on sides, bars and bodies, from 0 to those of the scene, at its voltage.
    Load,
    /// The given displacements of bars, from 0 to those of the scene, at its voltage.
    Displacement,
    /// The pressure below the membrane, from 0 to that of the scene or to the largest one.
    Pressure,
    /// The volume below the membrane, from 0 to that of the scene.
    Volume,
}

impl PathParameter {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Voltage,
        Self::Load,
        Self::Displacement,
        Self::Pressure,
        Self::Volume,
    ];

    /// Returns the word for it: `voltage`, `load`, `displacement`, `pressure`, `volume`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Voltage => "voltage",
            Self::Load => "load",
            Self::Displacement => "displacement",
            Self::Pressure => "pressure",
            Self::Volume => "volume",
        }
    }

    /// Returns the shares of the voltage, as V², and of the loads at a share of what changes.
    fn shares(self, share: f64) -> [f64; 2] {
        match self {
            Self::Voltage => [share, 1.0],
            Self::Load => [1.0, share],
            Self::Displacement | Self::Pressure | Self::Volume => [1.0; 2],
        }
    }

    /// Returns the scene at the start of a path; `None` if that differs from the scene only by the voltage.
    fn start(self, scene: &Scene) -> Result<Option<Scene>, SetupError> {
        if self != Self::Voltage && scene.drive.charge.is_some() {
            return Err(SetupError::ChargedPath);
        }
        match self {
            Self::Voltage => Ok(None),
            Self::Load => {
                let start = scene.without_loads().ok_or(SetupError::NoLoads)?;
                // What the loads resist is singular without them.
                if start.geometry.floating() != scene.geometry.floating() {
                    check_resisted(&start, "a path of the load")?;
                }
                Ok(Some(start))
            }
            Self::Displacement => scene
                .without_displacements()
                .map(Some)
                .ok_or(SetupError::NoDisplacements),
            Self::Pressure | Self::Volume => Err(SetupError::NoPressure),
        }
    }
}

/// Kind of an event on a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// The voltage has an extremum along the path. The membrane snaps at the first one.
    Fold,
    /// An eigenvalue of the tangent changes sign while the voltage keeps rising or falling: another branch crosses.
    Bifurcation,
    /// Rank-one convexity is lost at a point.
    NotElliptic,
    /// A membrane that can wrinkle has lost all tension at a point.
    Slack,
    /// The flat membrane is unstable against motions out of its plane: it wrinkles or buckles.
    OutOfPlane,
}

impl EventKind {
    /// Returns the word used in files: `fold`, `bifurcation`, `not-elliptic`, `slack`, `out-of-plane`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Fold => "fold",
            Self::Bifurcation => "bifurcation",
            Self::NotElliptic => "not-elliptic",
            Self::Slack => "slack",
            Self::OutOfPlane => "out-of-plane",
        }
    }
}

/// Why a path ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathEnd {
    /// Rank-one convexity is lost.
    NotElliptic,
    /// A membrane that can wrinkle has lost all tension at a point.
    Slack,
    /// An element has almost no area left.
    Squeezed,
    /// After a fold the branch became stable again, and was followed well beyond the first limit.
    Recovered,
    /// 50 times the critical voltage of a fully active membrane was reached without a limit.
    NoLimit,
    /// The full loads or displacements of the scene were reached, or its pressure, volume or voltage under these.
    Complete,
    /// The maximum number of points was reached.
    Points,
    /// The next point was not found.
    Lost,
    /// There is no stable state beyond, under a pressure or above a volume.
    LimitPoint,
}

impl PathEnd {
    /// Returns the word used in files: `not-elliptic`, `slack`, `squeezed`, `recovered`, `no-limit`, `complete`,
    /// `points`, `lost`, `limit-point`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::NotElliptic => "not-elliptic",
            Self::Slack => "slack",
            Self::Squeezed => "squeezed",
            Self::Recovered => "recovered",
            Self::NoLimit => "no-limit",
            Self::Complete => "complete",
            Self::Points => "points",
            Self::Lost => "lost",
            Self::LimitPoint => "limit-point",
        }
    }
}

/// An equilibrium on a path.
#[derive(Clone, Debug, PartialEq)]
pub struct PathPoint {
    /// Voltage in V.
    pub voltage: f64,
    /// Share of the loads or displacements of the scene; 1 where the voltage changes.
    pub share: f64,
    /// Largest displacement at a cell corner in mm: from the first point where sides are not held, else from the mount.
    pub max_displacement: f64,
    /// Such a displacement in mm at the corner of [`LoadPath::watched`].
    pub displacement: f64,
    /// What is observed of this displacement, if something is.
    pub observed: Option<f64>,
    /// What the sides do, if not all are held.
    pub sides: Option<SideState>,
    /// The smallest eigenvalue μ of K v = μ L v, with the Laplacian L: near 1 at rest, zero at the loss of stability.
    pub smallest_eigenvalue: f64,
    /// Number of negative eigenvalues of the tangent.
    pub negative_eigenvalues: usize,
    /// Whether the state is stable: no negative eigenvalue, and elliptic everywhere.
    pub stable: bool,
    /// Share of the membrane that is compressed and would wrinkle; `None` if wrinkling is simulated.
    pub compressed: Option<f64>,
    /// In how many motions out of the plane the flat membrane is unstable: it wrinkles or buckles.
    pub out_of_plane_unstable: usize,
    /// The largest electric field relative to the breakdown field, by Huang's law if the scene has none.
    pub breakdown_ratio: f64,
}

/// What sides do in a state.
#[derive(Clone, Debug, PartialEq)]
pub struct SideState {
    /// The motions of bars from the mount, in the order of `Edge`.
    pub bars: Vec<Motion>,
    /// The force of each side on the membrane in N, in the order of `Edge`.
    pub reactions: [[f64; 2]; SIDES],
}

/// An event on a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathEvent {
    /// Kind.
    pub kind: EventKind,
    /// Voltage in V, to one part in 10⁴ or better.
    pub voltage: f64,
    /// Share of the loads or displacements of the scene, as accurate; 1 where the voltage changes.
    pub share: f64,
    /// Index of the point just before it.
    pub point: usize,
}

/// The path of one pattern.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadPath {
    /// What changes along it.
    pub parameter: PathParameter,
    /// Points in order from rest. The voltage, or what else changes, falls after a fold.
    pub points: Vec<PathPoint>,
    /// Events in order; the first one ends the stable part.
    pub events: Vec<PathEvent>,
    /// Why it ends.
    pub end: PathEnd,
    /// The cell corner (column, row) that moves most at the limit, or at the end without a limit.
    pub watched: [usize; 2],
    /// Displacement there from the mount.
    pub limit_field: Field,
    /// Displacement of the first point from the mount, if not all sides are held.
    pub rest: Option<Field>,
    /// Where the flat membrane begins to wrinkle or buckle out of its plane on the stable part, if it does.
    pub flat_limit: Option<PathEvent>,
}

impl LoadPath {
    /// Returns the event that ends the stable part, at the highest stable voltage, load or displacement.
    #[must_use]
    pub fn limit(&self) -> Option<PathEvent> {
        self.events.first().copied()
    }
}

/// Why there is no path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoPath {
    /// Sides, bars or bodies are loaded or released, and there is no stable state at the start.
    Start,
    /// Memory for the factors of the tangent is short.
    Memory,
}

/// A number that is observed of the displacement of each point of a path, in mm at the cell corners.
pub type Observe<'a> = &'a (dyn Fn(&Field) -> f64 + Sync);

/// Follows load paths of a scene.
pub struct PathSolver {
    parameter: PathParameter,
    solver: MembraneSolver,
    /// The solver of the first state, where that differs by more than the voltage.
    start: Option<MembraneSolver>,
}

impl PathSolver {
    /// Creates a solver of the paths along which something changes.
    ///
    /// # Errors
    /// If the scene has no loads or given displacements that could change, or an option is out of range.
    pub fn new(scene: &Scene, options: SolveOptions, parameter: PathParameter) -> Result<Self, SetupError> {
        let start = parameter.start(scene)?;
        Ok(Self {
            parameter,
            solver: MembraneSolver::new(scene, options)?,
            start: start.map(|start| MembraneSolver::new(&start, options)).transpose()?,
        })
    }

    /// Returns the solver of single states.
    #[must_use]
    pub fn solver(&self) -> &MembraneSolver {
        &self.solver
    }

    /// Follows the path of one pattern.
    ///
    /// # Errors
    /// If there is no stable first state, or memory is short.
    pub fn path(&self, pattern: &Pattern) -> Result<LoadPath, NoPath> {
        self.observed_path(pattern, None)
    }

    /// The same, with what is observed of the displacement of each point: from the first point where sides are not
    /// held, else from the mount.
    ///
    /// # Errors
    /// As for [`PathSolver::path`].
    pub fn observed_path(&self, pattern: &Pattern, observe: Option<Observe<'_>>) -> Result<LoadPath, NoPath> {
        let Some(start) = &self.start else {
            let is_known = !self.solver.lacks_rest(pattern);
            let path = is_known.then(|| self.solver.observed_path(pattern, observe));
            return path.ok_or(NoPath::Start)?.ok_or(NoPath::Memory);
        };
        let first = start.solve(pattern);
        if !first.outcome.is_converged() {
            return Err(NoPath::Start);
        }
        let path = self.solver.model.with(Follow {
            solver: &self.solver,
            pattern,
            activity: &self.solver.model.activity(&self.solver.grid, pattern),
            loads: self.solver.model.loads(),
            voltage: self.solver.scene.voltage_v(),
            parameter: self.parameter,
            start: Some(first.displacement),
            observe,
        });
        path.ok_or(NoPath::Memory)
    }
}

impl MembraneSolver {
    /// Follows the path of one pattern from rest, whatever the voltage of the scene. `None` if memory is short,
    /// or if there is no state at rest.
    #[must_use]
    pub fn path(&self, pattern: &Pattern) -> Option<LoadPath> {
        self.observed_path(pattern, None)
    }

    fn observed_path(&self, pattern: &Pattern, observe: Option<Observe<'_>>) -> Option<LoadPath> {
        let (model, voltage) = self.driven().ok()?;
        model.with(Follow {
            solver: self,
            pattern,
            activity: &model.activity(&self.grid, pattern),
            loads: model.loads(),
            voltage,
            parameter: PathParameter::Voltage,
            start: None,
            observe,
        })
    }
}

struct Follow<'a> {
    solver: &'a MembraneSolver,
    pattern: &'a Pattern,
    activity: &'a Activity,
    /// The loads of the groups relative to the largest one.
    loads: &'a [f64],
    /// Voltage at the full load.
    voltage: f64,
    parameter: PathParameter,
    /// The first state, where something else than the voltage changes.
    start: Option<Vec<f64>>,
    observe: Option<Observe<'a>>,
}

/// What is found of a state beside its stability in the plane.
struct Checks {
    reactions: Option<[[f64; 2]; SIDES]>,
    compressed: Option<f64>,
    out_of_plane: usize,
    breakdown_ratio: f64,
}

/// Data kept of a state: displacements of points are added when all are known.
type Kept = (PathPoint, Field);

impl Follow<'_> {
    /// Returns the voltage and the share of loads or displacements at a share of what changes.
    fn at(&self, share: f64) -> (f64, f64) {
        match self.parameter {
            PathParameter::Voltage => (share.max(0.0).sqrt() * self.voltage, 1.0),
            _ => (self.voltage, share),
        }
    }

    fn keep(&self, state: PathState, checks: Checks) -> Kept {
        let grid = &self.solver.grid;
        let (voltage, share) = self.at(state.share);
        let point = PathPoint {
            voltage,
            share,
            max_displacement: 0.0,
            displacement: 0.0,
            observed: None,
            sides: checks.reactions.map(|reactions| SideState {
                bars: grid.bar_motions(&state.u).unwrap_or_default(),
                reactions,
            }),
            smallest_eigenvalue: state.eigenvalue,
            negative_eigenvalues: state.negative,
            stable: state.stable,
            compressed: checks.compressed,
            out_of_plane_unstable: checks.out_of_plane,
            breakdown_ratio: checks.breakdown_ratio,
        };
        (point, grid.sample(&state.u))
    }

    fn finish(&self, trace: Trace<Kept>, flat_limit: Option<FlatLimit>) -> Option<LoadPath> {
        let event = |event: &trace::TraceEvent| {
            let (voltage, share) = self.at(event.share);
            PathEvent {
                kind: event.kind,
                voltage,
                share,
                point: event.state,
            }
        };
        let events: Vec<PathEvent> = trace.events.iter().map(event).collect();
        let at = events
            .first()
            .map_or(trace.states.len().checked_sub(1)?, |limit| limit.point);
        let limit_field = trace.states.get(at)?.1.clone();
        let first = trace.states.first().map(|(_, field)| field.clone())?;
        let rest = self.solver.grid.boundary().is_some().then_some(first);
        let moved = |field: &Field| match &rest {
            Some(rest) => field.plus(-1.0, rest),
            None => field.clone(),
        };
        let watched = moved(&limit_field).most_moved();
        let points = trace.states.iter().map(|(point, field)| {
            let moved = moved(field);
            let [x, y] = moved.at_corner(watched[0], watched[1]);
            PathPoint {
                max_displacement: moved.max_magnitude(),
                displacement: x.hypot(y),
                observed: self.observe.map(|observe| observe(&moved)),
                ..point.clone()
            }
        });
        Some(LoadPath {
            parameter: self.parameter,
            points: points.collect(),
            events,
            end: trace.end,
            watched,
            limit_field,
            rest,
            flat_limit: flat_limit.map(|limit| {
                let (voltage, share) = self.at(limit.share);
                PathEvent {
                    kind: EventKind::OutOfPlane,
                    voltage,
                    share,
                    point: limit.state,
                }
            }),
        })
    }
}

impl WithMaterial for Follow<'_> {
    type Output = Option<LoadPath>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(mut self, material: F) -> Option<LoadPath> {
        let solver = self.solver;
        let forces = SideForces::new(solver, self.pattern);
        let flat = FlatStability::new(&solver.grid)?;
        let mut watch = FlatWatch::default();
        let strength = breakdown_strength_or_default(&solver.scene);
        let problem = solver.problem(self.activity, &material);
        let curve = match self.start.take() {
            Some(u) => Curve::through(&problem, self.parameter, u)?,
            None => Curve::new(&problem)?,
        };
        let trace = follow(&curve, |state| {
            let [voltage, load] = self.parameter.shares(state.share);
            let law = material(voltage);
            let states = States {
                scene: &solver.scene,
                pattern: self.pattern,
                loads: self.loads,
                activity: self.activity,
                voltage: self.voltage,
                share: voltage,
                u: &state.u,
            };
            let states = states.run(&material);
            let compressed = (!law.wrinkles()).then(|| compressed_fraction(&states, solver.scene.shear_modulus_pa()));
            let unstable = |u: &[f64], share: f64| {
                let [voltage, _] = self.parameter.shares(share);
                let law = material(voltage);
                // An exact zero is stable to rounding.
                flat.unstable(&Operator::new(&law, self.activity), u).unwrap_or(0)
            };
            let checks = Checks {
                reactions: forces.as_ref().map(|forces| forces.at(&law, load, &state.u)),
                compressed,
                out_of_plane: watch.add(&state, unstable),
                breakdown_ratio: breakdown_ratio(&strength, solver.scene.thickness_mm(), &states),
            };
            self.keep(state, checks)
        });
        self.finish(trace, watch.limit())
    }
}
