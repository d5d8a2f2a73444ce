//! The finite-element evaluator with gradients, for the local search of designs.

use super::{LinearResponse, MembraneSolver, SetupError, SolveOptions};
use deaflow_field::{Differentiable, Field, Mesh, PredictError, Predictor, Simulator, WithGradient};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// Returns the scene without wrinkling and fringe field, if it has one of them: with them the energy is not linear in
/// the activity of cells, so there is no adjoint. The gradient then only selects cells; their effect is simulated with
/// them.
pub(super) fn linear_in_cells(scene: &Scene) -> Option<Scene> {
    let mut effects = scene.effects.clone();
    let differs = effects.wrinkling.is_some() || effects.fringe_field.is_some();
    (effects.wrinkling, effects.fringe_field) = (None, None);
    differs.then(|| scene.with_effects(effects))
}

/// Returns the derivative with respect to the activity of each cell in each group, given that of a cell with the full
/// load. `loads` are the shares of the groups.
pub(super) fn of_groups(loads: &[f64], of_cells: &[f64]) -> Vec<f64> {
    let each = loads.iter();
    each.flat_map(|load| of_cells.iter().map(move |cell| load * cell))
        .collect()
}

/// Newton's method on a mesh, with the adjoint method.
pub struct GradientEvaluator {
    solver: MembraneSolver,
    /// The solver of the scene from [`linear_in_cells`].
    plain: Option<MembraneSolver>,
    /// Share of the load of each electrode group.
    loads: Vec<f64>,
    /// The scene and γ of its linear response.
    scene: Scene,
    gamma: f64,
}

impl GradientEvaluator {
    /// Creates an evaluator for a scene with decided effects.
    ///
    /// # Errors
    /// If the scene cannot be simulated.
    pub fn new(scene: &Scene) -> Result<Self, SetupError> {
        Self::with_unrelaxed(scene, 0.0)
    }

    /// Adds the charge on the electrodes to fields.
    #[must_use]
    pub fn measuring_charge(self) -> Self {
        Self {
            solver: self.solver.measuring_charge(),
            plain: self.plain.map(MembraneSolver::measuring_charge),
            ..self
        }
    }

    /// Like [`GradientEvaluator::new`], with viscoelastic branches that have no time to relax, of a modulus γ in units
    /// of μλp².
    ///
    /// # Errors
    /// As [`GradientEvaluator::new`].
    pub(super) fn with_unrelaxed(scene: &Scene, gamma: f64) -> Result<Self, SetupError> {
        // The error of one biquadratic element per cell is below 0.1 % of the displacement, accurate enough for the
        // sign of a gain.
        let options = SolveOptions::on(Mesh::biquadratic(1));
        let plain = linear_in_cells(scene).map(|plain| MembraneSolver::with_unrelaxed(&plain, gamma, options));
        Ok(Self {
            solver: MembraneSolver::with_unrelaxed(scene, gamma, options)?,
            plain: plain.transpose()?,
            loads: scene.group_loads(),
            scene: scene.clone(),
            gamma,
        })
    }
}

impl Predictor for GradientEvaluator {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        let results = self.solver.simulate(patterns).into_iter();
        Ok(results.map(|result| result.stroke()).collect())
    }
}

impl Differentiable for GradientEvaluator {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&Field) -> Field,
    ) -> Result<Option<WithGradient>, PredictError> {
        // The laminates of cut cells are those of the scene itself.
        if pattern.coverage().is_some() && self.plain.is_some() {
            let with = "a search of designs";
            return Err(PredictError::failed(SetupError::Coverage { with }));
        }
        let solver = self.plain.as_ref().unwrap_or(&self.solver);
        let solution = solver.solve(pattern);
        let Some(field) = solver.simulation(pattern, &solution).stroke() else {
            return Ok(None);
        };
        let Some(of_cells) = solver.gradient(pattern, &solution, &slope(&field)) else {
            return Ok(None);
        };
        Ok(Some((field, of_groups(&self.loads, &of_cells))))
    }

    fn predict_near(&self, base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        let start = self.solver.solve(base);
        Ok(self.solver.strokes_near(&start, patterns))
    }

    /// Uses one bilinear element per cell; `None` if the half-active membrane is unstable, the drive is a charge, or a
    /// side is not held.
    fn linear_response(&self, weights: &[Field]) -> Result<Option<Vec<WithGradient<f64>>>, PredictError> {
        if self.scene.drive.charge.is_some() || self.scene.geometry.sides.is_some() {
            return Ok(None);
        }
        let plain = linear_in_cells(&self.scene);
        let scene = plain.as_ref().unwrap_or(&self.scene);
        let response = match LinearResponse::with_unrelaxed(scene, self.gamma, Mesh::bilinear(1)) {
            Ok(response) => response,
            Err(SetupError::Unstable) => return Ok(None),
            Err(error) => return Err(PredictError::failed(error)),
        };
        let found = response.of_functionals(weights);
        let in_groups = |(value, of_cells): WithGradient<f64>| (value, of_groups(&self.loads, &of_cells));
        Ok(found.map(|found| found.into_iter().map(in_groups).collect()))
    }
}
