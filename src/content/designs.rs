//! The artifacts of design and verify stages: a row for each pattern.

use super::element::{Packed, PerUnit};
use super::error::Fault;
use super::intervals::{DesignInterval, DesignIntervals};
use super::macros::arrays;
use super::part::LongTexts;
use super::solutions::SolvedHistories;
use deaflow_field::{Field, OutcomeKind};
use deaflow_pattern::{CELLS, Pattern, Role};
use deaflow_scene::{Effects, Scene};
use deaflow_store::StoreError;

/// Units along a side of the membrane that a genome of the genetic algorithm has.
pub const GENOME_UNITS: usize = 20;

arrays! {
    /// What is said of a design, verified or not.
    #[derive(Default)]
    pub struct DesignRows, DesignRowsView {
        /// Label of the stage that designed it.
        case: Vec<String> = array("case", "", [row]),
        /// Name of the target.
        name: Vec<String> = array("name", "", [row]),
        /// How the pattern came about: ga, refined along the gradient, optimum of gradients alone, intuitive, intuitive-equal-area, own.
        role: Vec<Role> = array("role", "", [row]),
        /// Wanted area fraction, or free.
        area_target: Vec<String> = array("area_target", "", [row]),
        /// What predicted the field.
        evaluator: Vec<String> = array("evaluator", "", [row]),
        /// Which of several designs of the target.
        member: Vec<u64> = array("member", "1", [row]),
        /// Units along a side by which it was searched.
        units: Vec<u64> = array("units", "1", [row]),
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [row, y, x]),
        /// Area fraction of the electrode.
        area: Vec<f64> = array("area", "1", [row]),
        /// Predicted displacement at the cell corners; one row for each pattern that is not `own`, in their order.
        predicted: Vec<Field> = array("predicted", "mm", [predicted_row, corner_y, corner_x, xy]),
        /// The objective in YAML.
        objective: LongTexts = array("objective", "", [row]),
        /// The constraints in YAML.
        constraints: LongTexts = array("constraints", "", [row]),
        /// `met`, or which constraints are not, as the search knew it.
        status: LongTexts = array("status", "", [row]),
        /// Where a calibrated network was asked, what it says of them.
        interval: Option<DesignIntervals> = group("interval"),
        /// Where the scene has several states, what is predicted in each; beside it stands what is predicted in the first.
        states: Option<PredictedStates> = group("states"),
    }
}

arrays! {
    /// Predictions in each state of a device.
    #[derive(Default)]
    pub struct PredictedStates, PredictedStatesView {
        /// Predicted displacement at the cell corners in each state, in the order of their names; one row for each pattern that is not `own`, in
        /// their order.
        predicted: Vec<Field> = array("predicted", "mm", [predicted_row, state, corner_y, corner_x, xy]),
    }
}

impl DesignRows {
    /// The predicted fields in the states of the device, by the place of the row among those that are predicted.
    #[must_use]
    pub fn predicted_in_states(&self, at: usize) -> &[Field] {
        match &self.states {
            None => &self.predicted[at..=at],
            Some(states) => {
                let each = states.predicted.len() / self.predicted.len();
                &states.predicted[at * each..][..each]
            }
        }
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.patterns.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.patterns.is_empty()
    }

    /// Adds one of the rows of a design stage, which all have a prediction.
    pub fn push(&mut self, others: &Self, row: usize) {
        if others.states.is_some() {
            let own = self.states.get_or_insert_default();
            own.predicted.extend_from_slice(others.predicted_in_states(row));
        }
        self.predicted.push(others.predicted[row].clone());
        self.role.push(others.role[row]);
        self.member.push(others.member[row]);
        self.units.push(others.units[row]);
        self.evaluator.push(others.evaluator[row].clone());
        self.status.0.push(others.status.0[row].clone());
        let interval = others.interval.as_ref().and_then(|intervals| intervals.of_row(row));
        self.push_common(others, row, &others.patterns[row], interval);
    }

    /// Adds a person's own pattern for the target of one of the rows of others. Nothing has predicted it.
    pub fn push_own(&mut self, (others, row): (&Self, usize), (member, pattern): (u64, &Pattern), status: String) {
        self.role.push(Role::Own);
        self.member.push(member);
        self.units.push(CELLS as u64);
        self.evaluator.push(String::new());
        self.status.0.push(status);
        self.push_common(others, row, pattern, None);
    }

    fn push_common(&mut self, others: &Self, row: usize, pattern: &Pattern, interval: Option<DesignInterval>) {
        self.case.push(others.case[row].clone());
        self.name.push(others.name[row].clone());
        self.area_target.push(others.area_target[row].clone());
        self.area.push(pattern.area_fraction());
        self.patterns.push(pattern.clone());
        self.objective.0.push(others.objective.0[row].clone());
        self.constraints.0.push(others.constraints.0[row].clone());
        if interval.is_some() && self.interval.is_none() {
            self.interval = Some(DesignIntervals::none(self.len() - 1));
        }
        if let Some(intervals) = &mut self.interval {
            intervals.push(interval);
        }
    }
}

/// Of each row the one of the arrays of predictions that belongs to it; none where nothing was predicted.
#[must_use]
pub fn predicted_rows(roles: &[Role]) -> Vec<Option<usize>> {
    let mut next = 0;
    let row = |role: &Role| {
        let row = role.is_predicted().then_some(next);
        next += usize::from(row.is_some());
        row
    };
    roles.iter().map(row).collect()
}

arrays! {
    /// Designs and how they were searched.
    pub struct Designs, DesignsView {
        /// The patterns.
        rows: DesignRows = group(""),
        /// Predicted mean displacement along the wanted directions.
        value: Vec<f64> = array("value", "mm", [row]),
        /// Fitness, smaller is better.
        fitness: Vec<f64> = array("fitness", "1", [row]),
        /// The genetic algorithm.
        history: History = group("history"),
        /// The searches along the gradient.
        steps: GradientSteps = group("climb"),
        /// Patterns judged by the search of each target.
        evaluations: Vec<u64> = array("evaluations", "1", [target]),
        /// The evaluators that could have been used.
        candidates: Candidates = group("probe"),
        /// The scene that they are for.
        scene: Scene = attribute("scene"),
        /// How they were searched.
        method: String = attribute("method"),
    }
}

arrays! {
    /// The generations of the genetic algorithm.
    #[derive(Default)]
    pub struct History, HistoryView {
        /// Name of the target.
        name: Vec<String> = array("name", "", [generation]),
        /// Number of the generation.
        generation: Vec<u64> = array("generation", "1", [generation]),
        /// Fitness of the best individual of each generation, smaller is better.
        best: Vec<f64> = array("best", "1", [generation]),
        /// Mean fitness of each generation.
        mean: Vec<f64> = array("mean", "1", [generation]),
        /// Predicted displacement of the best along the wanted direction.
        value: Vec<f64> = array("value", "mm", [generation]),
        /// Area fraction of the best.
        area: Vec<f64> = array("area", "1", [generation]),
        /// Best genome of each generation.
        genomes: Packed<PerUnit<GENOME_UNITS>> = array("genomes", "1", [generation, unit_y, unit_x]),
    }
}

arrays! {
    /// The steps of the searches along the gradient.
    #[derive(Default)]
    pub struct GradientSteps, GradientStepsView {
        /// Name of the target.
        name: Vec<String> = array("name", "", [step]),
        /// Role of the result.
        role: Vec<Role> = array("role", "", [step]),
        /// Which of several designs.
        member: Vec<u64> = array("member", "1", [step]),
        /// Number of the step.
        step: Vec<u64> = array("step", "1", [step]),
        /// Displacement along the wanted directions by finite elements.
        value: Vec<f64> = array("value", "mm", [step]),
        /// Area fraction.
        area: Vec<f64> = array("area", "1", [step]),
        /// Patterns looked at up to this step; one counts each time, though it is simulated once.
        simulations: Vec<u64> = array("simulations", "1", [step]),
    }
}

arrays! {
    /// The evaluators that could have been used, and how they judged patterns of the search.
    #[derive(Default)]
    pub struct Candidates, CandidatesView {
        /// Name of the target.
        name: Vec<String> = array("name", "", [candidate]),
        /// Evaluators from the cheapest to the dearest, the reference last; none where one is named.
        settings: Vec<String> = array("candidates", "", [candidate]),
        /// Root mean square error of a component on patterns of the first generation.
        rmse: Vec<f64> = array("rmse", "mm", [candidate]),
        /// Largest error of the displacement along the wanted directions as a share of it, on patterns like designs.
        design_error: Vec<f64> = array("design_error", "1", [candidate]),
        /// Patterns that the error is over.
        known: Vec<u64> = array("known", "1", [candidate]),
        /// Patterns of which the reference has a field and it has none, or it has one alone.
        disagree: Vec<u64> = array("disagree", "1", [candidate]),
    }
}

arrays! {
    /// Designs that were simulated. Arrays of numbers that a simulation gives have a row for each pattern with a field, in order.
    pub struct Verification, VerificationView {
        /// The patterns.
        rows: DesignRows = group(""),
        /// How the simulation ended.
        outcome: Vec<OutcomeKind> = array("outcome", "", [row]),
        /// Simulated displacement at the cell corners; one row for each pattern with a field, in their order.
        displacement: Vec<Field> = array("displacement", "mm", [simulated_row, corner_y, corner_x, xy]),
        /// Predicted minus simulated displacement; one row for each pattern with a field that is not `own`, in their order.
        difference: Vec<Field> = array("difference", "mm", [compared_row, corner_y, corner_x, xy]),
        /// Where the scene has several states, the displacement in each; beside it stands that in the first. A pattern has a field where it has one
        /// in all of them, and its outcome is otherwise that of the first state without.
        states: Option<SimulatedStates> = group("states"),
        /// Where times were asked for and the scene has one state, how the patterns with a field move in time; `displacement` is that at the time
        /// of the objective, or at the last of them.
        history: Option<SolvedHistories> = group("history", [(sample, simulated_row)]),
        /// Displacements along the wanted directions.
        component: Components = group("component"),
        /// The scene of the simulations.
        scene: Scene = attribute("scene"),
        /// How they were solved, in the keys of a solve stage.
        solver: String = attribute("solver"),
        /// The effects that were simulated.
        effects: Effects = attribute("effects"),
    }
}

arrays! {
    /// Displacements in each state of a device.
    #[derive(Default)]
    pub struct SimulatedStates, SimulatedStatesView {
        /// Simulated displacement at the cell corners in each state, in the order of their names; one row for each pattern with a field in all of
        /// them, in their order.
        displacement: Vec<Field> = array("displacement", "mm", [simulated_row, state, corner_y, corner_x, xy]),
    }
}

arrays! {
    /// Displacements along the wanted directions.
    #[derive(Default)]
    pub struct Components, ComponentsView {
        /// Predicted mean displacement along the wanted directions; one row for each pattern that is not `own`, in their order.
        predicted: Vec<f64> = array("predicted", "mm", [predicted_row]),
        /// Simulated mean displacement along the wanted directions; one row for each pattern with a field, in their order.
        simulated: Vec<f64> = array("simulated", "mm", [simulated_row]),
        /// What a mesh of half the elements per cell says otherwise, or the estimated error where an accuracy was asked for; 0 where
        /// it is not known. One row for each pattern with a field, in their order.
        error: Vec<f64> = array("error", "mm", [simulated_row]),
        /// Whether the error is known: the other mesh has a field too. One row for each pattern with a field, in their order.
        error_known: Vec<u64> = array("error_known", "1", [simulated_row]),
        /// Where times were asked for, the simulated displacement along the wanted directions at each of them; one row for each pattern with a
        /// field, in their order.
        in_time: Option<Packed<f64>> = array("in_time", "mm", [simulated_row, time]),
        /// Simulated distance from the wanted displacements, root mean square; 0 where nothing but a direction is wanted. One row for
        /// each pattern with a field, in their order.
        distance: Vec<f64> = array("distance", "mm", [simulated_row]),
    }
}

impl VerificationView<'_> {
    /// The row of the simulated arrays that belongs to each pattern; none where it has no field.
    ///
    /// # Errors
    /// When they do not have a row for each pattern with a field.
    pub fn simulated_rows(&self) -> Result<Vec<Option<usize>>, StoreError> {
        let mut next = 0;
        let row = |outcome: &OutcomeKind| {
            let row = outcome.has_field().then_some(next);
            next += usize::from(row.is_some());
            row
        };
        let rows = self.outcome().read()?.iter().map(row).collect();
        match self.component().simulated().rows()? == next {
            true => Ok(rows),
            false => Err(Fault::Simulated.of(self.artifact().digest())),
        }
    }
}
