//! Load paths: equilibria of a membrane from rest to the loss of stability and beyond.
//!
//! A solution at one voltage shows whether the membrane is stable there. A path shows how it gets there and what ends
//! it: a fold, where the voltage has a maximum along the curve of equilibria and the membrane snaps; a bifurcation,
//! where another branch crosses below the fold; or a loss of ellipticity, beyond which the equations are not valid.

pub(super) mod curve;
pub(super) mod trace;

use deaflow_field::Field;
use deaflow_pattern::Pattern;

use super::effects::WithMaterial;
use super::material::Material;
use super::operator::Activity;
use super::solver::MembraneSolver;

use curve::Curve;
use trace::{PathState, Trace, follow};

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
}

impl EventKind {
    /// Returns the word used in files: `fold`, `bifurcation`, `not-elliptic`, `slack`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Fold => "fold",
            Self::Bifurcation => "bifurcation",
            Self::NotElliptic => "not-elliptic",
            Self::Slack => "slack",
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
    /// The maximum number of points was reached.
    Points,
    /// The next point was not found.
    Lost,
}

impl PathEnd {
    /// Returns the word used in files: `not-elliptic`, `slack`, `squeezed`, `recovered`, `no-limit`, `points`, `lost`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::NotElliptic => "not-elliptic",
            Self::Slack => "slack",
            Self::Squeezed => "squeezed",
            Self::Recovered => "recovered",
            Self::NoLimit => "no-limit",
            Self::Points => "points",
            Self::Lost => "lost",
        }
    }
}

/// An equilibrium on a path.
#[derive(Clone, Debug, PartialEq)]
pub struct PathPoint {
    /// Voltage in V.
    pub voltage: f64,
    /// Largest displacement at a cell corner in mm.
    pub max_displacement: f64,
    /// Displacement in mm at the corner of [`LoadPath::watched`].
    pub displacement: f64,
    /// The smallest eigenvalue μ of K v = μ L v, with the Laplacian L: near 1 at rest, zero at the loss of stability.
    pub smallest_eigenvalue: f64,
    /// Number of negative eigenvalues of the tangent.
    pub negative_eigenvalues: usize,
    /// Whether the state is stable: no negative eigenvalue, and elliptic everywhere.
    pub stable: bool,
}

/// An event on a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathEvent {
    /// Kind.
    pub kind: EventKind,
    /// Voltage in V, to one part in 10⁴ or better.
    pub voltage: f64,
    /// Index of the point just before it.
    pub point: usize,
}

/// The path of one pattern.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadPath {
    /// Points in order from rest. The voltage falls after a fold.
    pub points: Vec<PathPoint>,
    /// Events in order; the first one ends the stable part.
    pub events: Vec<PathEvent>,
    /// Why it ends.
    pub end: PathEnd,
    /// The cell corner (column, row) that moves most at the limit, or at the end without a limit.
    pub watched: [usize; 2],
    /// Displacement there.
    pub limit_field: Field,
}

impl LoadPath {
    /// Returns the event that ends the stable part from rest, at the highest stable voltage.
    #[must_use]
    pub fn limit(&self) -> Option<PathEvent> {
        self.events.first().copied()
    }
}

impl MembraneSolver {
    /// Follows the path of one pattern from rest, whatever the voltage of the scene. `None` if memory is short,
    /// or if there is no state at rest: see [`MembraneSolver::lacks_rest`].
    #[must_use]
    pub fn path(&self, pattern: &Pattern) -> Option<LoadPath> {
        let (model, voltage) = self.driven().ok()?;
        model.with(Follow {
            solver: self,
            activity: &model.activity(&self.grid, pattern),
            voltage,
        })
    }
}

struct Follow<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    /// Voltage at the full load.
    voltage: f64,
}

/// Data kept of a state.
type Kept = (PathPoint, Field);

impl Follow<'_> {
    fn keep(&self, state: PathState) -> Kept {
        let solver = self.solver;
        let field = solver.grid.sample(&state.u);
        let point = PathPoint {
            voltage: state.share.max(0.0).sqrt() * self.voltage,
            max_displacement: field.max_magnitude(),
            displacement: 0.0,
            smallest_eigenvalue: state.eigenvalue,
            negative_eigenvalues: state.negative,
            stable: state.stable,
        };
        (point, field)
    }

    fn finish(&self, trace: Trace<Kept>) -> Option<LoadPath> {
        let event = |event: &trace::TraceEvent| PathEvent {
            kind: event.kind,
            voltage: event.share.max(0.0).sqrt() * self.voltage,
            point: event.state,
        };
        let events: Vec<PathEvent> = trace.events.iter().map(event).collect();
        let at = events
            .first()
            .map_or(trace.states.len().checked_sub(1)?, |limit| limit.point);
        let limit_field = trace.states.get(at)?.1.clone();
        let watched = furthest(&limit_field);
        let points = trace.states.into_iter().map(|(point, field)| {
            let [x, y] = field.at_corner(watched[0], watched[1]);
            PathPoint {
                displacement: x.hypot(y),
                ..point
            }
        });
        Some(LoadPath {
            points: points.collect(),
            events,
            end: trace.end,
            watched,
            limit_field,
        })
    }
}

impl WithMaterial for Follow<'_> {
    type Output = Option<LoadPath>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Option<LoadPath> {
        let problem = self.solver.problem(self.activity, material);
        let curve = Curve::new(&problem)?;
        let trace = follow(&curve, |state| self.keep(state));
        self.finish(trace)
    }
}

/// Returns the corner that moves most.
fn furthest(field: &Field) -> [usize; 2] {
    let [columns, rows] = field.raster().corner_sides();
    let corners = (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y]));
    let size = |[x, y]: [usize; 2]| {
        let [a, b] = field.at_corner(x, y);
        a.hypot(b)
    };
    corners.max_by(|a, b| size(*a).total_cmp(&size(*b))).unwrap_or_default()
}
