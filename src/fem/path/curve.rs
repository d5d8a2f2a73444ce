//! The curve of equilibria in the space of displacement and load, and steps of a given arc length along it.
//!
//! Load control fails at a fold, where the load has an extremum along the curve; arc-length control of (u, load) does
//! not (Riks, J. Appl. Mech. 39 (1972) 1060; Keller's pseudo-arc length, in Applications of Bifurcation Theory, 1977,
//! 359). The bordered system is solved by block elimination with the factors of the tangent, which are kept as long as
//! they reduce the residual well: a factorisation costs as much as tens of back-substitutions.

use std::sync::Arc;

use crate::continuation::Problem;
use crate::direct::{Factorisation, Structure};
use crate::eigenvalue::{Eigenpair, dot, smallest};
use crate::material::Material;
use crate::newton::{Workspace, norm};
use crate::operator::Operator;
use crate::stability::LOOSE;

use super::PathParameter;

/// Factors are kept if an iteration reduces the residual by at least this factor.
const GOOD_REDUCTION: f64 = 0.25;
/// Maximum number of iterations of a corrector, and of factorisations in it.
const MAX_ITERATIONS: u32 = 30;
const MAX_FACTORISATIONS: u32 = 4;
/// Residual per unknown, in units of the load, that counts as rounding.
const ROUNDING: f64 = 1e-14;
/// Change of the load for its derivative, in units of the curve.
const LOAD_DIFFERENCE: f64 = 1e-3;

/// A direction along the curve, of unit length.
struct Tangent {
    u: Vec<f64>,
    share: f64,
}

/// An equilibrium on the curve, with its properties.
pub struct CurvePoint {
    /// Displacements.
    pub u: Vec<f64>,
    /// Share of what changes along the curve.
    pub share: f64,
    /// Negative eigenvalues of the tangent matrix.
    pub negative: usize,
    /// Smallest margin of ellipticity.
    pub ellipticity: f64,
    /// Smallest tension, negative only if the membrane can wrinkle and is slack at a point.
    pub tension: f64,
    /// Smallest det f.
    pub smallest_det: f64,
    factors: Factorisation,
    /// du/dshare.
    slope: Vec<f64>,
    tangent: Tangent,
}

impl CurvePoint {
    /// Returns whether the share rises along the curve.
    pub fn rises(&self) -> bool {
        self.tangent.share > 0.0
    }

    /// Returns whether a membrane that can wrinkle has lost all tension at a point.
    pub fn is_slack(&self) -> bool {
        self.tension < -LOOSE
    }

    /// Returns whether the equations are valid: elliptic and in tension everywhere.
    pub fn is_sound(&self) -> bool {
        self.ellipticity > 0.0 && !self.is_slack()
    }

    /// Returns whether the equilibrium is stable.
    pub fn is_stable(&self) -> bool {
        self.negative == 0 && self.is_sound()
    }
}

/// A step along the curve.
pub struct Step {
    /// The new state.
    pub to: CurvePoint,
    /// Cosine of the angle between the tangents at both ends.
    pub cosine: f64,
    /// Whether no further factorisation was needed.
    pub easy: bool,
}

/// The curve of equilibria of a problem.
pub struct Curve<'a, F> {
    problem: &'a Problem<'a, F>,
    structure: Arc<Structure>,
    /// What changes; the full load is proportional to V².
    parameter: PathParameter,
    /// The start, where that is not the voltage.
    start: Option<Vec<f64>>,
    /// The displacement of the nodes of bars with their full given motions, where these change.
    given: Vec<f64>,
    /// The unit of shares: of the voltage the share at which a fully active membrane loses stability.
    unit: f64,
    /// The unit of displacements: the norm of the linear response to one unit; zero if nothing moves.
    movement: f64,
    /// The norm of the residual at the start for one unit.
    reference: f64,
}

impl<'a, L: Material, F: Fn(f64) -> L> Curve<'a, F> {
    /// Creates the curve of rising voltage through rest; `None` if memory is short.
    pub fn new(problem: &'a Problem<'a, F>) -> Option<Self> {
        let material = (problem.material)(1.0);
        let unit = 0.5 * material.largest_load() / material.load();
        let structure = Structure::new(problem.activity.grid())?;
        let mut curve = Self {
            problem,
            structure,
            parameter: PathParameter::Voltage,
            start: None,
            given: Vec::new(),
            unit,
            movement: 0.0,
            reference: 0.0,
        };
        let rest = vec![0.0; problem.activity.grid().layout().vector_len()];
        let (force, _) = curve.residual(&rest, unit);
        let reference = norm(&force);
        if reference > ROUNDING * (force.len() as f64).sqrt() * material.load() * unit {
            let slope = curve.slope(&curve.factors(&rest, 0.0)?, &rest, 0.0);
            curve.movement = unit * norm(&slope);
            curve.reference = reference;
        }
        Some(curve)
    }

    /// Creates the curve along which this changes, through the equilibrium `u` at a share of 0; `None` if memory is
    /// short.
    pub fn through(problem: &'a Problem<'a, F>, parameter: PathParameter, u: Vec<f64>) -> Option<Self> {
        let grid = problem.activity.grid();
        let mut given = Vec::new();
        if let Some(supports) = grid.supports().filter(|_| parameter == PathParameter::Displacement) {
            given = vec![0.0; u.len()];
            supports.give_motions(1.0, &mut given);
        }
        let mut curve = Self {
            problem,
            structure: Structure::new(grid)?,
            parameter,
            start: None,
            given,
            unit: 1.0,
            movement: 0.0,
            reference: 0.0,
        };
        curve.reference = norm(&curve.force_per_share(&u, 0.0));
        curve.movement = norm(&curve.slope(&curve.factors(&u, 0.0)?, &u, 0.0));
        curve.start = Some(u);
        Some(curve)
    }

    /// Returns the unit of shares.
    pub fn unit(&self) -> f64 {
        self.unit
    }

    /// Returns the share at which the curve is complete; `None` of the voltage, which is followed as far as possible.
    pub fn last_share(&self) -> Option<f64> {
        (self.parameter != PathParameter::Voltage).then_some(1.0)
    }

    /// Returns whether there is no electrode, so that the voltage has no effect.
    pub fn is_bare(&self) -> bool {
        let is_voltage = self.parameter == PathParameter::Voltage;
        is_voltage && self.problem.activity.elements().iter().all(|&active| active == 0.0)
    }

    /// Returns the distance of a state from rest.
    pub fn distance(&self, at: &CurvePoint) -> f64 {
        self.product(&at.u, at.share, &at.u, at.share).sqrt()
    }

    /// Returns the first state, with the tangent in the direction of a rising share.
    pub fn first(&self) -> Option<CurvePoint> {
        if let Some(start) = &self.start {
            return self.station(start.clone(), 0.0, None);
        }
        let mut u = vec![0.0; self.problem.activity.grid().layout().vector_len()];
        let mut workspace = Workspace::new(u.len(), self.problem.laplacian);
        self.problem.rest(&mut u, &mut workspace).ok()?;
        self.station(u, 0.0, None)
    }

    /// Returns the smallest eigenvalue of a state, starting from that of a neighbour.
    pub fn eigenpair(&self, at: &CurvePoint, near: Option<&Eigenpair>) -> Option<Eigenpair> {
        self.with_operator(at.share, |operator| {
            smallest(operator, self.problem.laplacian, &at.u, near)
        })
    }

    /// Steps along the curve by an arc length; `None` if no equilibrium is found.
    pub fn step(&self, from: &CurvePoint, arc: f64) -> Option<Step> {
        let (u, share, easy) = self.correct(from, arc)?;
        let to = self.station(u, share, Some(&from.tangent))?;
        let (a, b) = (&from.tangent, &to.tangent);
        Some(Step {
            cosine: self.product(&a.u, a.share, &b.u, b.share),
            to,
            easy,
        })
    }

    /// Finds the equilibrium in the plane normal to the tangent of a state at an arc length; also returns whether no
    /// further factorisation was needed.
    fn correct(&self, from: &CurvePoint, arc: f64) -> Option<(Vec<f64>, f64, bool)> {
        let Tangent { u: along, share: rise } = &from.tangent;
        let mut u: Vec<f64> = from.u.iter().zip(along).map(|(u, t)| u + arc * t).collect();
        let mut share = from.share + arc * rise;
        self.settle(share, &mut u);
        let mut refreshed: Option<(Factorisation, Vec<f64>)> = None;
        let (mut last, mut renewals) = (f64::INFINITY, 0);
        for _ in 0..MAX_ITERATIONS {
            let (force, smallest_det) = self.residual(&u, share);
            let size = norm(&force);
            if smallest_det.is_nan() || smallest_det <= 0.0 || !size.is_finite() {
                return None;
            }
            if size <= self.goal(share) {
                return Some((u, share, renewals == 0));
            }
            if size > GOOD_REDUCTION * last {
                renewals += 1;
                if renewals > MAX_FACTORISATIONS {
                    return None;
                }
                let factors = self.factors(&u, share)?;
                let slope = self.slope(&factors, &u, share);
                refreshed = Some((factors, slope));
            }
            last = size;
            let (factors, slope) = refreshed
                .as_ref()
                .map_or((&from.factors, &from.slope), |(factors, slope)| (factors, slope));
            let back = factors.solve(&force);
            // The update stays in the plane.
            let shift = self.product(&back, 0.0, along, 0.0) / self.product(slope, 1.0, along, *rise);
            let changes = back.iter().zip(slope).map(|(b, s)| shift * s - b);
            u.iter_mut().zip(changes).for_each(|(u, change)| *u += change);
            share += shift;
            self.settle(share, &mut u);
        }
        None
    }

    /// Corrects a displacement so that the motion of every body is rigid, and that of bars as given.
    fn settle(&self, share: f64, u: &mut [f64]) {
        let grid = self.problem.activity.grid();
        grid.settle(u);
        if let Some(supports) = grid.supports().filter(|_| !self.given.is_empty()) {
            supports.give_motions(share, u);
        }
    }

    /// Returns the norm of the residual to be reached.
    fn goal(&self, share: f64) -> f64 {
        if self.parameter != PathParameter::Voltage {
            return self.problem.tolerance * self.reference;
        }
        let relative = (share / self.unit).abs();
        let load = (self.problem.material)(1.0).load() * self.unit;
        let rounding = ROUNDING * (self.problem.activity.grid().layout().vector_len() as f64).sqrt() * load;
        (self.problem.tolerance * self.reference + rounding) * relative.max(1e-6)
    }

    fn station(&self, u: Vec<f64>, share: f64, before: Option<&Tangent>) -> Option<CurvePoint> {
        let factors = self.factors(&u, share)?;
        let slope = self.slope(&factors, &u, share);
        let along = before.map_or(1.0, |t| self.product(&slope, 1.0, &t.u, t.share));
        let length = self.product(&slope, 1.0, &slope, 1.0).sqrt().copysign(along);
        let (_, smallest_det) = self.residual(&u, share);
        let margins = self.with_operator(share, |operator| operator.margins(&u));
        Some(CurvePoint {
            negative: factors.negative_pivots(),
            ellipticity: margins.ellipticity,
            tension: margins.tension,
            smallest_det,
            tangent: Tangent {
                u: slope.iter().map(|s| s / length).collect(),
                share: 1.0 / length,
            },
            u,
            share,
            factors,
            slope,
        })
    }

    /// The inner product for arc lengths.
    fn product(&self, u: &[f64], share: f64, v: &[f64], other: f64) -> f64 {
        let movement = if self.movement > 0.0 {
            dot(u, v) / (self.movement * self.movement)
        } else {
            0.0
        };
        movement + share * other / (self.unit * self.unit)
    }

    fn with_operator<R>(&self, share: f64, work: impl FnOnce(&Operator<'_, L>) -> R) -> R {
        let [voltage, loads] = self.parameter.shares(share);
        let material = (self.problem.material)(voltage);
        work(&Operator {
            body_load: loads,
            ..Operator::new(&material, self.problem.activity)
        })
    }

    /// Returns the residual and the smallest det f.
    fn residual(&self, u: &[f64], share: f64) -> (Vec<f64>, f64) {
        let mut force = vec![0.0; u.len()];
        let smallest_det = self.with_operator(share, |operator| operator.residual(u, &mut force));
        (force, smallest_det)
    }

    fn factors(&self, u: &[f64], share: f64) -> Option<Factorisation> {
        self.with_operator(share, |operator| self.structure.factorise(operator, u))
    }

    /// du/dshare along the curve.
    fn slope(&self, factors: &Factorisation, u: &[f64], share: f64) -> Vec<f64> {
        let mut slope = factors.solve(&self.force_per_share(u, share));
        slope
            .iter_mut()
            .zip(&self.given)
            .for_each(|(slope, given)| *slope += given);
        slope
    }

    /// Returns the decrease of the residual with the share at constant displacement, but for given motions.
    fn force_per_share(&self, u: &[f64], share: f64) -> Vec<f64> {
        if !self.given.is_empty() {
            let mut force = vec![0.0; u.len()];
            self.with_operator(share, |operator| operator.tangent(u, &self.given, &mut force));
            force.iter_mut().for_each(|force| *force = -*force);
            return force;
        }
        let difference = LOAD_DIFFERENCE * self.unit;
        let (low, high) = ((share - difference).max(0.0), share + difference);
        let (below, above) = (self.residual(u, low).0, self.residual(u, high).0);
        below.iter().zip(above).map(|(b, a)| (b - a) / (high - low)).collect()
    }
}
