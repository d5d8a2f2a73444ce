//! Equilibria in space as results of patterns: displacements with heights and volumes, counted from the state without
//! voltage, and their gradients.

use std::sync::OnceLock;

use rayon::prelude::*;

use super::inflation::{Found, Inflated, InflationOutcome, InflationSolver};
use crate::error::SetupError;
use crate::gradient_evaluator::{linear_in_cells, of_groups};
use crate::solver::SolveOptions;
use crate::work::WorkLimit;
use deaflow_field::{
    Differentiable, Field, Motion, Observation, Outcome, PredictError, Predictor, Simulation, Simulator, WithGradient,
};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// Simulates patterns under a pressure or a volume, or with bodies that move out of the plane.
pub struct SpatialSolver {
    own: FromRest,
    /// The solver of the scene without effects that have no gradient, if it has one.
    plain: Option<FromRest>,
    /// Share of the load of each electrode group.
    loads: Vec<f64>,
    observes_breakdown: bool,
    tolerance: f64,
}

/// A solver, and the state without voltage.
struct FromRest {
    solver: InflationSolver,
    /// That of the scene without voltage, if its states differ from pattern to pattern.
    unloaded: Option<InflationSolver>,
    common: OnceLock<Result<Field, Outcome>>,
}

impl SpatialSolver {
    /// Creates the solver of a scene with decided effects.
    ///
    /// # Errors
    /// As [`InflationSolver::new`].
    pub fn new(scene: &Scene, options: SolveOptions) -> Result<Self, SetupError> {
        let plain = linear_in_cells(scene).map(|plain| FromRest::new(&plain, options));
        Ok(Self {
            own: FromRest::new(scene, options)?,
            plain: plain.transpose()?,
            loads: scene.group_loads(),
            observes_breakdown: scene.effects.dielectric_breakdown.is_some(),
            tolerance: options.tolerance,
        })
    }

    /// Changes the limit of work of a pattern.
    #[must_use]
    pub fn within(self, limit: WorkLimit) -> Self {
        Self {
            own: self.own.within(limit),
            plain: self.plain.map(|plain| plain.within(limit)),
            ..self
        }
    }

    fn simulation(&self, pattern: &Pattern) -> Simulation {
        let found = self.own.solver.inflated(self.own.solver.find(pattern));
        let rest = match found.outcome {
            InflationOutcome::Converged => self.own.rest(pattern),
            other => Err(outcome(other)),
        };
        let breakdown_ratio = self.observes_breakdown.then_some(found.breakdown_ratio);
        let motions = found.bodies.iter().map(|body| Motion {
            translation: [body.translation[0], body.translation[1]],
            rotation: body.rotation,
        });
        let (bodies, newton_iterations) = (motions.collect::<Vec<Motion>>(), found.newton_iterations);
        let (outcome, field, observation) = match rest {
            Ok(rest) => {
                let observation = Observation {
                    breakdown_ratio,
                    bodies: (!bodies.is_empty()).then_some(bodies),
                    rest: Some(rest),
                    ..Observation::default()
                };
                (Outcome::Converged, Some(field(found)), observation)
            }
            Err(outcome) => (outcome, None, Observation::default()),
        };
        Simulation {
            outcome,
            field,
            newton_iterations,
            residual: self.tolerance,
            observation,
        }
    }
}

impl FromRest {
    fn new(scene: &Scene, options: SolveOptions) -> Result<Self, SetupError> {
        let has_stiff_electrodes = scene.effects.electrode_stiffness.is_some();
        let unloaded = || InflationSolver::new(&scene.at_voltage(0.0), options);
        Ok(Self {
            solver: InflationSolver::new(scene, options)?,
            unloaded: has_stiff_electrodes.then(unloaded).transpose()?,
            common: OnceLock::new(),
        })
    }

    fn within(self, limit: WorkLimit) -> Self {
        Self {
            solver: self.solver.within(limit),
            unloaded: self.unloaded.map(|unloaded| unloaded.within(limit)),
            ..self
        }
    }

    /// Returns the state without voltage of a pattern, or why there is none.
    fn rest(&self, pattern: &Pattern) -> Result<Field, Outcome> {
        match &self.unloaded {
            Some(unloaded) => stable(unloaded.solve(pattern)),
            None => {
                let bare = || Pattern::from_fn(pattern.raster(), |_, _| false);
                self.common.get_or_init(|| stable(self.solver.solve(&bare()))).clone()
            }
        }
    }

    /// Returns the displacement of an equilibrium from the state without voltage; `None` if one of them is missing.
    fn stroke(&self, pattern: &Pattern, found: Found) -> Option<Field> {
        let field = stable(self.solver.inflated(found)).ok()?;
        Some(field.plus(-1.0, &self.rest(pattern).ok()?))
    }

    /// Returns the derivative of the weighted displacement of an equilibrium from the state without voltage with
    /// respect to the activity of each cell.
    fn gradient(&self, pattern: &Pattern, at: &Found, weights: &Field) -> Option<Vec<f64>> {
        let mut gradient = self.solver.gradient(pattern, at, weights)?;
        if let Some(unloaded) = &self.unloaded {
            let of_rest = unloaded.gradient(pattern, &unloaded.find(pattern), weights)?;
            gradient.iter_mut().zip(of_rest).for_each(|(sum, own)| *sum -= own);
        }
        Some(gradient)
    }
}

fn stable(found: Inflated) -> Result<Field, Outcome> {
    match found.outcome {
        InflationOutcome::Converged => Ok(field(found)),
        other => Err(outcome(other)),
    }
}

fn field(found: Inflated) -> Field {
    let field = found.displacement.in_space(found.heights, found.volume);
    field.expect("an equilibrium is finite, with a height at each corner")
}

fn outcome(outcome: InflationOutcome) -> Outcome {
    match outcome {
        InflationOutcome::Converged => Outcome::Converged,
        InflationOutcome::Flat(outcome) => outcome,
        InflationOutcome::LimitPoint {
            last_stable,
            first_unstable,
        } => Outcome::LimitPoint {
            last_stable,
            first_unstable,
        },
        InflationOutcome::WorkLimit => Outcome::WorkLimit,
    }
}

impl Simulator for SpatialSolver {
    fn simulate(&self, patterns: &[Pattern]) -> Vec<Simulation> {
        let each = patterns.par_iter();
        each.map(|pattern| self.simulation(pattern)).collect()
    }
}

impl Predictor for SpatialSolver {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        let stroke = |pattern: &Pattern| self.own.stroke(pattern, self.own.solver.find(pattern));
        Ok(patterns.par_iter().map(stroke).collect())
    }
}

impl Differentiable for SpatialSolver {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&Field) -> Field,
    ) -> Result<Option<WithGradient>, PredictError> {
        let with = "a pressure or bodies in space";
        if pattern.coverage().is_some() {
            return Err(PredictError::failed(SetupError::Coverage { with }));
        }
        let from_rest = self.plain.as_ref().unwrap_or(&self.own);
        let found = from_rest.solver.find(pattern);
        let Some(stroke) = from_rest.stroke(pattern, found.clone()) else {
            return Ok(None);
        };
        let gradient = from_rest.gradient(pattern, &found, &slope(&stroke));
        Ok(gradient.map(|of_cells| (stroke, of_groups(&self.loads, &of_cells))))
    }

    fn predict_near(&self, base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        let solver = &self.own.solver;
        let start = solver.find(base);
        let stroke = |pattern: &Pattern| self.own.stroke(pattern, solver.find_near(pattern, &start));
        Ok(patterns.par_iter().map(stroke).collect())
    }
}
