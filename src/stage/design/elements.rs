//! The finite element models of a design stage, created on first use.

use std::sync::{Arc, OnceLock};

use super::DesignStage;
use super::evaluators::{amplitude_parameters, amplitude_solver};
use super::stoppable::Stoppable;
use deaflow_design::{FiniteElements, Front, ResponseKind, SearchError, Target};
use deaflow_fem::screening::resolved_states;
use deaflow_fem::{GradientEvaluator, SafetyMargins, SetupError, SolveOptions, SpatialSolver, ThreeSolves, at_peak};
use deaflow_field::{Differentiable, Feasibility, InStates, Mesh, PredictError, StateFields};
use deaflow_orchestrator::Scratch;
use deaflow_pattern::Pattern;

/// The finite element models of one target of a stage.
pub struct ForTarget<'a> {
    /// The stage.
    pub stage: &'a DesignStage,
    /// The target.
    pub target: &'a Target,
    /// Knows whether the run was stopped.
    scratch: &'a Scratch<'a>,
    model: OnceLock<Stoppable<'a>>,
}

impl<'a> ForTarget<'a> {
    /// The models of a target of a stage, which fail once the run is stopped.
    pub fn new(stage: &'a DesignStage, target: &'a Target, scratch: &'a Scratch<'a>) -> Self {
        Self {
            stage,
            target,
            scratch,
            model: OnceLock::new(),
        }
    }
}

/// Models in each state of the device: for the gradient, and for the margins.
pub struct TargetModels {
    gradient: InStates<Arc<dyn Differentiable + Send>>,
    margins: Vec<SafetyMargins>,
}

impl Feasibility for TargetModels {
    /// Whether the margins are satisfied in all states.
    fn feasible(&self, patterns: &[Pattern]) -> Result<Vec<bool>, PredictError> {
        let mut verdicts = vec![true; patterns.len()];
        for margins in &self.margins {
            let own = margins.feasible(patterns)?;
            verdicts.iter_mut().zip(own).for_each(|(verdict, own)| *verdict &= own);
        }
        Ok(verdicts)
    }
}

impl DesignStage {
    /// The models of a target, shared with targets of the same response.
    fn models(&self, target: &Target) -> Result<&TargetModels, SearchError> {
        let response = target.objective.response();
        let has_same_models = |other: &Target| match response {
            ResponseKind::Amplitude(_) => other.objective == target.objective,
            ResponseKind::Equilibrium | ResponseKind::After(_) => {
                other.objective.response() == response && other.masks == target.masks
            }
        };
        let mut targets = self.task.targets.iter().zip(&self.models);
        let shared = targets.find(|(other, _)| has_same_models(other));
        let (_, shared) = shared.ok_or_else(|| SearchError::Setup("the stage has no such target".into()))?;
        if let Some(models) = shared.get() {
            return Ok(models);
        }
        let limits = self.task.constraints.constraints().limits();
        let models = || -> Result<TargetModels, SetupError> {
            let (mut gradient, mut margins) = (Vec::new(), Vec::new());
            for scene in resolved_states(&self.scene)? {
                gradient.push(match response {
                    ResponseKind::Equilibrium if scene.is_in_space() => {
                        let options = SolveOptions::on(Mesh::biquadratic(1));
                        Arc::new(SpatialSolver::new(&scene, options)?) as Arc<dyn Differentiable + Send>
                    }
                    ResponseKind::Equilibrium => {
                        let evaluator = GradientEvaluator::new(&scene)?;
                        Arc::new(match self.task.front.as_ref().is_some_and(Front::has_charge) {
                            true => evaluator.measuring_charge(),
                            false => evaluator,
                        }) as Arc<dyn Differentiable + Send>
                    }
                    ResponseKind::After(time) => Arc::new(ThreeSolves::new(&scene, time.value())?.gradient(&scene)?),
                    ResponseKind::Amplitude(frequency) => Arc::new(amplitude_solver(
                        &scene,
                        frequency,
                        &target.goal,
                        &amplitude_parameters(),
                    )?),
                });
                let strongest = match response {
                    ResponseKind::Amplitude(_) => at_peak(&scene),
                    ResponseKind::Equilibrium | ResponseKind::After(_) => scene,
                };
                margins.extend(SafetyMargins::new(
                    &strongest,
                    limits.pull_in_margin,
                    limits.breakdown_margin,
                )?);
            }
            if let Some(masks) = &target.masks {
                let over = masks.over(&gradient, &self.scene).into_iter();
                gradient = over
                    .map(|one| Arc::from(one as Box<dyn Differentiable + Send>))
                    .collect();
            }
            Ok(TargetModels {
                gradient: InStates::new(gradient),
                margins,
            })
        };
        let models = models().map_err(|e| SearchError::Setup(e.into()))?;
        Ok(shared.get_or_init(|| models))
    }
}

impl FiniteElements for ForTarget<'_> {
    fn gradient(&self) -> Result<&dyn Differentiable<StateFields>, SearchError> {
        let models = self.stage.models(self.target)?;
        Ok(self
            .model
            .get_or_init(|| Stoppable::new(&models.gradient, self.scratch)))
    }

    fn settings(&self) -> String {
        let method = match self.target.objective.response() {
            ResponseKind::Amplitude(_) => return amplitude_parameters().settings_in_time("response"),
            ResponseKind::Equilibrium => "newton",
            // The field at a time follows from three equilibria.
            ResponseKind::After(_) => "creep:3",
        };
        format!("method: {method}, elements_per_cell: 1, order: 2")
    }

    fn feasibility(&self) -> Result<Option<&dyn Feasibility>, SearchError> {
        let models = self.stage.models(self.target)?;
        Ok((!models.margins.is_empty()).then_some(models as &dyn Feasibility))
    }
}
