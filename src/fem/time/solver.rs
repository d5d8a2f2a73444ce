//! The solver of histories: on one mesh, or on the mesh that each pattern needs.

use rayon::prelude::*;

use super::accurate::AccurateHistory;
use super::history::{HistoryRequest, check_estimates};
use super::transient::StepEstimate;
use crate::accurate::AccurateSolver;
use crate::error::SetupError;
use crate::solver::{MembraneSolver, SolveOptions};
use deaflow_field::{Evaluator, Field, Mesh, Outcome, PredictError, Predictor};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// Options of history solvers.
#[derive(Clone, Debug, PartialEq)]
pub struct HistoryOptions {
    /// The mesh of all patterns; `None` if each pattern has the mesh that reaches the requested accuracy.
    pub mesh: Option<Mesh>,
    /// Relative residual of equilibria.
    pub tolerance: f64,
}

/// A solver of histories for the patterns of a scene.
pub struct HistorySolver {
    engine: Engine,
    request: HistoryRequest,
}

enum Engine {
    Fixed(Box<MembraneSolver>, Mesh),
    Accurate(Box<AccurateSolver>),
}

impl HistorySolver {
    /// Builds the solver of a scene with resolved effects.
    ///
    /// # Errors
    /// When it cannot be set up.
    pub fn new(scene: &Scene, options: &HistoryOptions, request: HistoryRequest) -> Result<Self, SetupError> {
        let HistoryOptions { mesh, tolerance } = *options;
        let engine = match mesh {
            None => {
                let accuracy = request.accuracy_mm.unwrap_or(f64::NAN);
                Engine::Accurate(Box::new(AccurateSolver::new(scene, accuracy, tolerance)?))
            }
            Some(mesh) => {
                let solver = MembraneSolver::new(scene, SolveOptions { mesh, tolerance })?;
                Engine::Fixed(Box::new(solver), mesh)
            }
        };
        Ok(Self { engine, request })
    }

    /// Returns the times of the requested fields in s.
    #[must_use]
    pub fn times(&self) -> &[f64] {
        &self.request.times
    }

    /// Simulates the history of a pattern.
    ///
    /// # Errors
    /// When a finer mesh cannot be set up, or as [`MembraneSolver::history`].
    pub fn follow(&self, pattern: &Pattern) -> Result<AccurateHistory, SetupError> {
        self.follow_for(pattern, &self.request)
    }

    /// Simulates the history without charges and energies, which take as long as the displacements of a creeping
    /// membrane.
    ///
    /// # Errors
    /// As [`HistorySolver::follow`].
    pub fn displace(&self, pattern: &Pattern) -> Result<AccurateHistory, SetupError> {
        let request = HistoryRequest {
            measures: false,
            ..self.request.clone()
        };
        self.follow_for(pattern, &request)
    }

    fn follow_for(&self, pattern: &Pattern, request: &HistoryRequest) -> Result<AccurateHistory, SetupError> {
        match &self.engine {
            Engine::Fixed(solver, mesh) => Ok(AccurateHistory {
                history: solver.history(pattern, request)?,
                mesh: *mesh,
                space_error_mm: None,
            }),
            Engine::Accurate(solver) => solver.history(pattern, request),
        }
    }
}

/// An evaluator that estimates the states at a time step by step.
pub struct StepEstimates {
    solver: HistorySolver,
    settings: String,
}

impl StepEstimates {
    /// Builds the evaluator for a time in s, on a mesh, in a scene with resolved effects; `settings` is its name as an
    /// evaluator.
    ///
    /// # Errors
    /// When the scene cannot be simulated.
    pub fn new(
        scene: &Scene,
        options: &HistoryOptions,
        how: StepEstimate,
        time_s: f64,
        settings: String,
    ) -> Result<Self, SetupError> {
        let request = HistoryRequest {
            estimate: Some(how),
            ..HistoryRequest::at(vec![time_s])
        };
        let solver = HistorySolver::new(scene, options, request)?;
        Ok(Self { solver, settings })
    }

    /// Checks whether the scene, with resolved effects, can be estimated step by step.
    ///
    /// # Errors
    /// When it cannot.
    pub fn check(scene: &Scene) -> Result<(), SetupError> {
        check_estimates(scene)
    }
}

impl Predictor for StepEstimates {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        let each = patterns.par_iter().map(|pattern| {
            let mut history = self.solver.follow(pattern).map_err(PredictError::failed)?.history;
            let last = history.fields.pop();
            Ok(last.filter(|_| history.outcome == Outcome::Estimated))
        });
        each.collect()
    }
}

impl Evaluator for StepEstimates {
    fn settings(&self) -> String {
        self.settings.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::square_of_ten;
    use deaflow_pattern::Raster;

    fn scene(voltage: &str, more: &str, effects: &str) -> Scene {
        square_of_ten(&format!("voltage: {voltage}{more}"), effects, "")
    }

    const CREEP: &str =
        "viscoelasticity: { branches: [{ modulus: 60 kPa, time: 1 s }, { modulus: 30 kPa, time: 10 s }] }";

    fn options() -> HistoryOptions {
        HistoryOptions {
            mesh: Some(Mesh::bilinear(1)),
            tolerance: 1e-9,
        }
    }

    /// Returns the largest error at a time relative to the largest displacement.
    fn error(scene: &Scene, how: StepEstimate, time: f64) -> f64 {
        let pattern = Pattern::from_fn(Raster::new(10, 10).unwrap(), |x, y| (x * 7 + y * 3) % 5 < 2);
        let all = HistorySolver::new(scene, &options(), HistoryRequest::at(vec![time])).unwrap();
        let exact = all.follow(&pattern).unwrap().history.fields.remove(0);
        let estimates = StepEstimates::new(scene, &options(), how, time, "estimate".to_owned()).unwrap();
        let found = estimates.predict(&[pattern]).unwrap().remove(0);
        found.max_difference(&exact) / exact.max_magnitude()
    }

    #[test]
    fn chord_steps_in_time_are_near_all_steps_whatever_the_drive() {
        let drives = [
            "",
            ", waveform: { ramp: { time: 2 s } }",
            ", rest: 5 s",
            ", waveform: { sine: { frequency: 0.1 Hz, bias: 1 kV } }",
        ];
        for (drive, time) in drives.into_iter().flat_map(|drive| [(drive, 0.3), (drive, 4.0)]) {
            let scene = scene("4 kV", drive, CREEP);
            let [linear, one, three] = [StepEstimate::Linear, StepEstimate::Chord(1), StepEstimate::Chord(3)]
                .map(|how| error(&scene, how, time));
            assert!(
                one < 5e-3 && three < 1.5e-3 && three < linear && one < linear,
                "{drive} {time}: {linear:e} {one:e} {three:e}"
            );
            assert!(linear < 0.3, "{drive} {time}: {linear:e}");
        }
    }

    #[test]
    fn small_strains_creep_linearly() {
        let [strong, weak] = ["4 kV", "0.2 kV"].map(|volts| {
            let scene = scene(volts, "", CREEP);
            error(&scene, StepEstimate::Linear, 3.0)
        });
        assert!(weak < 2e-3 && weak < 0.1 * strong, "{weak:e} {strong:e}");
    }

    #[test]
    fn what_is_not_estimated_step_by_step_is_refused() {
        let finite = CREEP.replace("{ branches", "{ law: finite, branches");
        let cases = [
            (CREEP.to_owned() + ", inertia: { density: 960 kg/m3 }", "", "`inertia`"),
            (finite, "", "the viscous law must be linear"),
            (CREEP.to_owned(), ", source: { resistance: 1 GOhm }", "`source`"),
            (String::new(), "", "no `viscoelasticity`"),
        ];
        let pattern = [Pattern::from_fn(Raster::new(10, 10).unwrap(), |x, _| x < 5)];
        for (effects, drive, said) in cases {
            let scene = scene("4 kV", drive, &effects);
            let estimates = StepEstimates::new(&scene, &options(), StepEstimate::Chord(1), 1.0, String::new());
            let refused = estimates
                .and_then(|e| e.solver.follow(&pattern[0]).map(|_| ()))
                .unwrap_err();
            assert!(refused.to_string().contains(said), "{refused}");
        }
    }
}
