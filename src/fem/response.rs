//! The linear response of a membrane to a pattern, with chord steps: the baseline for surrogates.
//!
//! The membrane is linearised once, about rest with every cell half active, so one operator serves all patterns. The
//! error of the linear response is a few per cent; each chord step, one more solution with the same operator, reduces
//! it to about a tenth. The result is not an equilibrium, and its stability is unknown.

use std::sync::Arc;

use rayon::prelude::*;

use deaflow_field::{Field, Mesh, Observation, Outcome, Simulation, Simulator, WithGradient};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

use super::adjoint;
use super::effects::{Model, WithMaterial};
use super::error::SetupError;
use super::material::Material;
use super::newton::{self, ChordSteps, Workspace};
use super::operator::{Activity, Operator};
use super::precondition::Laplacian;
use super::solver::checked;

/// Relative residual of a linear solution, reached in two or three iterations: the error of an estimate is then within
/// 1 % of that with exact solutions.
pub(super) const INNER: f64 = 3e-3;

/// Relative residual of the response to one cell: a sum over all cells is then exact in single precision.
const EXACT: f64 = 1e-9;

/// A margin larger than rounding in single precision.
const CLEAR: f64 = 1e-3;

/// Predicts displacements by the linearised membrane.
pub struct LinearResponse {
    model: Model,
    half_active: Activity,
    laplacian: Arc<Laplacian>,
    rest: Vec<f64>,
}

/// Refuses estimates of devices whose sides are not held: the state about which they are linearised is far from that of
/// a mount whose sides have relaxed.
///
/// # Errors
/// If sides are not held.
pub(crate) fn check_sides(scene: &Scene) -> Result<(), SetupError> {
    match scene.geometry.sides {
        None => Ok(()),
        Some(_) => Err(SetupError::Sides {
            with: "estimates (`method: linear`, `method: chord`)",
        }),
    }
}

impl LinearResponse {
    /// Computes the response of a scene on a mesh.
    ///
    /// # Errors
    /// If the mesh is out of range, or the half-active membrane is unstable at the voltage of the scene.
    pub fn new(scene: &Scene, mesh: Mesh) -> Result<Self, SetupError> {
        Self::with_unrelaxed(scene, 0.0, mesh)
    }

    /// Like [`LinearResponse::new`], with viscoelastic branches that have no time to relax, of a modulus γ in units of
    /// μλp².
    ///
    /// # Errors
    /// As [`LinearResponse::new`].
    pub(super) fn with_unrelaxed(scene: &Scene, gamma: f64, mesh: Mesh) -> Result<Self, SetupError> {
        check_sides(scene)?;
        let model = Model::new(scene)?.with_unrelaxed(gamma);
        let grid = model.grid(checked(mesh)?)?;
        let response = Self {
            half_active: model.add_unrelaxed(Activity::from_shares(&grid, |_, _| 0.5)),
            model,
            laplacian: Laplacian::shared(&grid)?,
            rest: vec![0.0; grid.layout().vector_len()],
        };
        if response.model.with(Ellipticity(&response)) > 0.0 {
            Ok(response)
        } else {
            Err(SetupError::Unstable)
        }
    }

    /// Estimates each pattern with this number of chord steps after the linear response, in order. The outcome is
    /// [`Outcome::Estimated`], or [`Outcome::NoEstimate`] if the steps fail.
    #[must_use]
    pub fn simulate(&self, patterns: &[Pattern], chord_steps: u32) -> Vec<Simulation> {
        let workspace = || (self.rest.clone(), Workspace::new(self.rest.len(), &self.laplacian));
        patterns
            .par_iter()
            .map_init(workspace, |(u, workspace), pattern| {
                let activity = self.model.activity(self.half_active.grid(), pattern);
                let estimate = self.model.with(Steps {
                    response: self,
                    activity: &activity,
                    steps: 1 + chord_steps,
                    u,
                    workspace,
                });
                self.simulation(&estimate, u)
            })
            .collect()
    }

    /// Returns only the fields; `None` if the steps fail.
    #[must_use]
    pub fn predict(&self, patterns: &[Pattern], chord_steps: u32) -> Vec<Option<Field>> {
        let results = self.simulate(patterns, chord_steps).into_iter();
        results.map(|result| result.field).collect()
    }

    /// Returns the linear responses to single active cells (column, row): the response to a pattern is the sum over its
    /// active cells, because at rest the forces are linear in the activity. Fringe fields are left out, because they
    /// reach into neighbouring cells; `None` if the linear system cannot be solved.
    #[must_use]
    pub fn to_cells(&self, cells: &[(usize, usize)]) -> Option<Vec<Field>> {
        let workspace = || Workspace::new(self.rest.len(), &self.laplacian);
        let fields = cells.par_iter().map_init(workspace, |workspace, &cell| {
            let one = |x: usize, y: usize| if (x, y) == cell { 1.0 } else { 0.0 };
            self.to_activity(one, 0.0, workspace)
        });
        fields.collect()
    }

    /// Returns the linear response to the forces on bodies, to be added to that of the electrodes; `None` if the linear
    /// system cannot be solved.
    #[must_use]
    pub fn to_loads(&self) -> Option<Field> {
        let workspace = &mut Workspace::new(self.rest.len(), &self.laplacian);
        self.to_activity(|_, _| 0.0, 1.0, workspace)
    }

    /// For functionals Σ weights · u over the cell corners, with u in mm, returns the value without electrodes under
    /// the forces on bodies, and the derivative with respect to the activity of each cell, `[y][x]`. `None` if a linear
    /// system cannot be solved.
    #[must_use]
    pub fn of_functionals(&self, weights: &[Field]) -> Option<Vec<WithGradient<f64>>> {
        let loaded = self.to_loads()?;
        let workspace = || Workspace::new(self.rest.len(), &self.laplacian);
        let of = |workspace: &mut Workspace, weights: &Field| {
            let gradient = self.model.with(adjoint::InMm {
                activity: &self.half_active,
                laplacian: &self.laplacian,
                u: &self.rest,
                weights,
                forces: None,
                charge_unit: 0.0,
                workspace,
            })?;
            let pairs = weights.values().iter().zip(loaded.values());
            Some((pairs.map(|(weight, u)| weight * u).sum(), gradient))
        };
        weights.par_iter().map_init(workspace, of).collect()
    }

    fn to_activity(
        &self,
        share: impl Fn(usize, usize) -> f64,
        body_load: f64,
        workspace: &mut Workspace,
    ) -> Option<Field> {
        let activity = self
            .model
            .add_unrelaxed(Activity::from_shares(self.half_active.grid(), share));
        self.model.with(ToActivity {
            response: self,
            activity: &activity,
            body_load,
            workspace,
        })
    }

    fn simulation(&self, estimate: &Estimate, u: &[f64]) -> Simulation {
        let outcome = if estimate.sound {
            Outcome::Estimated
        } else {
            Outcome::NoEstimate
        };
        Simulation {
            outcome,
            field: estimate.sound.then(|| self.half_active.grid().sample(u)),
            newton_iterations: estimate.steps,
            residual: estimate.residual,
            observation: Observation {
                bodies: estimate.sound.then(|| self.half_active.grid().motions(u)).flatten(),
                ..Observation::default()
            },
        }
    }
}

/// The linear response with chord steps, as a simulator.
pub struct Estimator {
    /// The linear response.
    pub response: LinearResponse,
    /// Number of chord steps after it.
    pub chord_steps: u32,
}

impl Simulator for Estimator {
    fn simulate(&self, patterns: &[Pattern]) -> Vec<Simulation> {
        self.response.simulate(patterns, self.chord_steps)
    }
}

/// Computes the smallest margin of ellipticity of the half-active membrane at rest.
struct Ellipticity<'a>(&'a LinearResponse);

impl WithMaterial for Ellipticity<'_> {
    type Output = f64;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> f64 {
        let response = self.0;
        let margins = Operator::new(&material(1.0), &response.half_active).margins(&response.rest);
        margins.ellipticity
    }
}

/// Computes the linear response of a pattern and chord steps.
struct Steps<'a> {
    response: &'a LinearResponse,
    activity: &'a Activity,
    steps: u32,
    u: &'a mut [f64],
    workspace: &'a mut Workspace,
}

/// The result of the steps.
struct Estimate {
    steps: u32,
    residual: f64,
    sound: bool,
}

impl WithMaterial for Steps<'_> {
    type Output = Estimate;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Estimate {
        let Self {
            response, u, workspace, ..
        } = self;
        let material = material(1.0);
        let actual = Operator::new(&material, self.activity);
        let linear = Operator::new(&material, &response.half_active);
        u.fill(0.0);
        let ended = newton::chord(
            [&actual, &linear],
            &response.laplacian,
            ChordSteps {
                count: self.steps,
                inner: INNER,
                unit: 1.0,
            },
            &response.rest,
            u,
            workspace,
        );
        let (Ok(progress) | Err((_, progress))) = ended;
        // A state with a larger residual than at rest, or NaN, is worse than no estimate.
        let nearer = progress.residual < 1.0;
        let elliptic = actual.margins(workspace.single(u)).ellipticity > CLEAR || actual.margins(u).ellipticity > 0.0;
        Estimate {
            steps: progress.steps,
            residual: progress.residual,
            sound: ended.is_ok() && nearer && elliptic,
        }
    }
}

/// Computes the linear response to an activity exactly.
struct ToActivity<'a> {
    response: &'a LinearResponse,
    activity: &'a Activity,
    /// Share of the forces on bodies.
    body_load: f64,
    workspace: &'a mut Workspace,
}

impl WithMaterial for ToActivity<'_> {
    type Output = Option<Field>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Option<Field> {
        let Self { response, .. } = self;
        let material = material(1.0);
        let mut load = vec![0.0; response.rest.len()];
        let loaded = Operator {
            body_load: self.body_load,
            ..Operator::new(&material, self.activity)
        };
        loaded.residual(&response.rest, &mut load);
        load.iter_mut().for_each(|force| *force = -*force);
        let linear = Operator::new(&material, &response.half_active);
        let solution = newton::solve_tangent(
            &linear,
            &response.laplacian,
            EXACT,
            &response.rest,
            &load,
            self.workspace,
        );
        Some(response.half_active.grid().sample(&solution.ok()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{MembraneSolver, SolveOptions};
    use deaflow_base::Stream;
    use deaflow_pattern::Raster;

    #[test]
    fn chord_steps_approach_the_solution_from_a_few_per_cent() {
        // Component RMSE at κ = 0.0221, measured with a numpy prototype: linear 0.006 mm and one chord step 0.0006 mm
        // for random small grids, 0.024 and 0.0029 mm for a 4 × 4 grid.
        let scene = Scene::vhb4910().at_voltage(5250.0 * (0.0221_f64 / 0.025489).sqrt());
        let options = SolveOptions::default();
        let mut stream = Stream::new(2, "response test", 0);
        let bits: Vec<bool> = (0..2500).map(|_| stream.chance(0.5)).collect();
        let patterns = [
            Pattern::from_fn(Raster::PAPER, |x, y| bits[50 * y + x]),
            Pattern::from_fn(Raster::PAPER, |x, y| {
                [0x3, 0xa, 0x6, 0xc][y * 4 / 50] >> (x * 4 / 50) & 1 == 1
            }),
        ];
        let exact = MembraneSolver::new(&scene, options).unwrap().simulate(&patterns);
        let response = LinearResponse::new(&scene, options.mesh).unwrap();
        let errors = [0, 1, 2].map(|steps| {
            let fields = response.predict(&patterns, steps);
            [0, 1].map(|i: usize| {
                fields[i]
                    .as_ref()
                    .unwrap()
                    .rms_difference(exact[i].field.as_ref().unwrap())
            })
        });
        assert!(errors[0][0] > 2e-3 && errors[0][0] < 1.2e-2, "{errors:?}");
        assert!(errors[0][1] > 1e-2 && errors[0][1] < 5e-2, "{errors:?}");
        for i in 0..2 {
            assert!(
                errors[1][i] < 0.25 * errors[0][i] && errors[2][i] < 0.35 * errors[1][i],
                "{errors:?}"
            );
        }
    }

    #[test]
    fn the_response_to_a_pattern_is_the_sum_over_its_cells() {
        let pattern = Pattern::from_fn(Raster::PAPER, |x, y| {
            (3..7).contains(&x) && (40..44).contains(&y) && (x + y) % 3 > 0
        });
        let cells: Vec<(usize, usize)> = (0..2500)
            .map(|i| (i % 50, i / 50))
            .filter(|&(x, y)| pattern.is_active(x, y))
            .collect();
        let response = LinearResponse::new(&Scene::vhb4910(), Mesh::bilinear(2)).unwrap();
        let mut sum = vec![0.0; Field::zero(Raster::PAPER).values().len()];
        for field in response.to_cells(&cells).unwrap() {
            sum.iter_mut().zip(field.values()).for_each(|(sum, u)| *sum += u);
        }
        let sum = Field::from_values(Raster::PAPER, sum).unwrap();
        let whole = response.predict(&[pattern], 0).remove(0).unwrap();
        let size = whole.rms_difference(&Field::zero(Raster::PAPER));
        // `predict` solves its linear system to 3e-3 only.
        assert!(
            whole.rms_difference(&sum) < 3e-3 * size,
            "{}",
            whole.rms_difference(&sum) / size
        );
        assert!(size > 1e-3);
    }

    #[test]
    fn a_functional_of_a_pattern_is_the_sum_of_its_gradient_over_the_cells() {
        let pattern = Pattern::from_fn(Raster::PAPER, |x, y| x < 25 && (x / 5 + y / 5) % 2 == 0);
        let response = LinearResponse::new(&Scene::vhb4910(), Mesh::bilinear(1)).unwrap();
        let mut weights = Field::zero(Raster::PAPER).values().to_vec();
        for (place, weight) in [(2 * (51 * 25 + 25), 1.0), (2 * (51 * 12 + 30) + 1, -0.4)] {
            weights[place] = weight;
        }
        let weights = Field::from_values(Raster::PAPER, weights).unwrap();
        let whole = response.predict(std::slice::from_ref(&pattern), 0).remove(0).unwrap();
        let pairs = whole.values().iter().zip(weights.values());
        let expected: f64 = pairs.map(|(u, weight)| u * weight).sum();
        let (unloaded, gradient) = response.of_functionals(&[weights]).unwrap().remove(0);
        let cells = gradient.iter().zip(pattern.cells());
        let sum: f64 = cells.map(|(g, cell)| g * f64::from(*cell)).sum();
        assert!(unloaded == 0.0 && expected.abs() > 0.1);
        assert!((sum / expected - 1.0).abs() < 3e-3, "{sum} {expected}");
    }

    #[test]
    fn many_chord_steps_reach_the_equilibrium_and_its_residual() {
        let options = SolveOptions::default();
        let pattern = [Pattern::from_fn(Raster::PAPER, |x, y| (x / 10 + y / 10) % 2 == 0)];
        let exact = MembraneSolver::new(&Scene::vhb4910(), options)
            .unwrap()
            .simulate(&pattern);
        let response = LinearResponse::new(&Scene::vhb4910(), options.mesh).unwrap();
        let mut last = 1.0;
        for steps in [0, 2, 4, 20] {
            let estimate = response.simulate(&pattern, steps).remove(0);
            assert_eq!(
                (estimate.outcome, estimate.newton_iterations),
                (Outcome::Estimated, steps + 1)
            );
            assert!(estimate.residual < 0.5 * last, "{steps}: {}", estimate.residual);
            last = estimate.residual;
        }
        let limit = response.simulate(&pattern, 20).remove(0);
        let error = limit.field.unwrap().rms_difference(exact[0].field.as_ref().unwrap());
        assert!(limit.residual < 1e-8 && error < 1e-7, "{} {error}", limit.residual);
    }

    #[test]
    fn steps_that_lead_to_no_state_of_the_membrane_give_no_field() {
        let [half, bare] = [25, 0].map(|width| Pattern::from_fn(Raster::PAPER, |x, _| x < width));
        let response = LinearResponse::new(&Scene::vhb4910().at_voltage(10e3), Mesh::bilinear(2)).unwrap();
        let results = response.simulate(&[half, bare], 0);
        assert_eq!((results[0].outcome, &results[0].field), (Outcome::NoEstimate, &None));
        assert_eq!((results[1].outcome, results[1].residual), (Outcome::Estimated, 0.0));
        assert_eq!(results[1].field, Some(Field::zero(Raster::PAPER)));
    }

    #[test]
    fn a_membrane_that_is_not_stable_when_half_active_has_no_response() {
        let scene = Scene::vhb4910().at_voltage(20e3);
        assert_eq!(
            LinearResponse::new(&scene, Mesh::bilinear(2)).err(),
            Some(SetupError::Unstable)
        );
    }
}
