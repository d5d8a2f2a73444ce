//! Load paths: the equilibria of a membrane from rest to where stability is lost, and beyond.
//!
//! A solve at one voltage says whether the membrane survives it. A path says how it gets there and what ends it: a fold,
//! where the voltage has a maximum along the curve of equilibria and the membrane snaps; a bifurcation, where another
//! branch takes over below the fold; or a loss of ellipticity, beyond which the equations mean nothing.

pub(super) mod curve;
pub(super) mod trace;

use deaflow_field::Field;
use deaflow_pattern::Pattern;

use super::effects::WithMaterial;
use super::material::Material;
use super::operator::Activity;
use super::solver::MembraneSolver;

use curve::Curve;
use trace::{Mark, Trace, follow};

/// What happens on a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// The voltage has an extremum along the path. The first one is where the membrane snaps.
    Fold,
    /// An eigenvalue of the tangent changes sign while the voltage goes on rising or falling: another branch crosses.
    Bifurcation,
    /// Rank-one convexity is lost somewhere in the membrane.
    NotElliptic,
    /// A membrane that wrinkles has lost all tension somewhere.
    Slack,
}

impl EventKind {
    /// The word that stands in files: `fold`, `bifurcation`, `not-elliptic`, `slack`.
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
    /// A membrane that wrinkles has lost all tension somewhere.
    Slack,
    /// Some element is squeezed to nearly no area.
    Squeezed,
    /// Past a fold the branch became stable again, and was followed well beyond the first limit.
    Recovered,
    /// 50 times the critical voltage of a membrane that is active everywhere was reached without a limit.
    NoLimit,
    /// The path has very many points.
    Points,
    /// The curve was not found again.
    Lost,
}

impl PathEnd {
    /// The word that stands in files: `not-elliptic`, `slack`, `squeezed`, `recovered`, `no-limit`, `points`, `lost`.
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
    /// Largest displacement magnitude over the cell corners, in mm.
    pub max_displacement: f64,
    /// Displacement magnitude, in mm, at the corner of [`LoadPath::watched`].
    pub displacement: f64,
    /// The smallest eigenvalue μ of K v = μ L v, with the Laplacian L: near 1 at rest, zero where stability is lost.
    pub smallest_eigenvalue: f64,
    /// How many eigenvalues of the tangent are negative.
    pub negative_eigenvalues: usize,
    /// Whether a membrane can be found in this state: no negative eigenvalue, and elliptic everywhere.
    pub stable: bool,
}

/// Something that happens on a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathEvent {
    /// What.
    pub kind: EventKind,
    /// Where, in V, to one part in 10⁴ or better.
    pub voltage: f64,
    /// The point just before it.
    pub point: usize,
}

/// The path of one pattern.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadPath {
    /// From rest on, in the order of the path. The voltage falls past a fold.
    pub points: Vec<PathPoint>,
    /// What happens, in the order of the path; the first one ends the stable part.
    pub events: Vec<PathEvent>,
    /// Why it ends.
    pub end: PathEnd,
    /// The corner of the cells (column, row) that moves most at the limit, or at the end where there is no limit.
    pub watched: [usize; 2],
    /// The displacement there.
    pub limit_field: Field,
}

impl LoadPath {
    /// What ends the part that begins at rest: the voltage there is the highest that the membrane bears.
    #[must_use]
    pub fn limit(&self) -> Option<PathEvent> {
        self.events.first().copied()
    }
}

impl MembraneSolver {
    /// The path of one pattern. Whatever the voltage of the scene, it begins at rest. `None` where memory is short.
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
    /// The voltage at the full load.
    voltage: f64,
}

/// What is kept of a mark.
type Kept = (PathPoint, Field);

impl Follow<'_> {
    fn keep(&self, mark: Mark) -> Kept {
        let solver = self.solver;
        let field = solver.grid.sample(&mark.u);
        let point = PathPoint {
            voltage: mark.share.max(0.0).sqrt() * self.voltage,
            max_displacement: field.max_magnitude(),
            displacement: 0.0,
            smallest_eigenvalue: mark.eigenvalue,
            negative_eigenvalues: mark.negative,
            stable: mark.stable,
        };
        (point, field)
    }

    fn finish(&self, trace: Trace<Kept>) -> Option<LoadPath> {
        let event = |happening: &trace::Happening| PathEvent {
            kind: happening.kind,
            voltage: happening.share.max(0.0).sqrt() * self.voltage,
            point: happening.mark,
        };
        let events: Vec<PathEvent> = trace.happenings.iter().map(event).collect();
        let at = events
            .first()
            .map_or(trace.marks.len().checked_sub(1)?, |limit| limit.point);
        let limit_field = trace.marks.get(at)?.1.clone();
        let watched = furthest(&limit_field);
        let points = trace.marks.into_iter().map(|(point, field)| {
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
        let trace = follow(&curve, |mark| self.keep(mark));
        self.finish(trace)
    }
}

/// The corner that moves most.
fn furthest(field: &Field) -> [usize; 2] {
    let [columns, rows] = field.raster().corner_sides();
    let corners = (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y]));
    let size = |[x, y]: [usize; 2]| {
        let [a, b] = field.at_corner(x, y);
        a.hypot(b)
    };
    corners.max_by(|a, b| size(*a).total_cmp(&size(*b))).unwrap_or_default()
}
