//! The artifacts of design and verify stages: a row for each pattern.

use super::element::{Packed, PerCorner, PerUnit};
use super::error::Fault;
use super::fronts::Fronts;
use super::intervals::{DesignInterval, DesignIntervals};
use super::macros::arrays;
use super::part::LongTexts;
use super::solutions::SolvedHistories;
use deaflow_field::{CHARGE_UNIT, Field, OutcomeKind, REACTION_UNIT};
use deaflow_pattern::{CELLS, Pattern, Role};
use deaflow_scene::{Effects, Scene};
use deaflow_store::{Artifact, Object, StoreError};

/// The arrays of values of designs, which are forces in place of displacements if the objective is a `reaction`.
const VALUES: [&str; 4] = ["value", "history/value", "climb/value", "front/gain"];

/// The limits of a front, which are charges in place of areas if designs are those for each charge.
const LIMITS: [&str; 2] = ["front/limit", "front/reference"];

/// The hypervolume, in the product of the units of the objectives.
const HYPERVOLUME: &str = "front/hypervolume";

/// The same of verified designs.
const VERIFIED_VALUES: [&str; 3] = ["component/predicted", "component/simulated", "component/error"];

/// Sets the unit of arrays.
fn in_unit(mut object: Object, paths: &[&str], unit: &str) -> Object {
    for path in paths {
        if let Some(dataset) = object.datasets.get_mut(*path) {
            unit.clone_into(&mut dataset.units);
        }
    }
    object
}

/// Returns the unit of an array of values; mm without the array.
fn unit_of(artifact: &Artifact, path: &str) -> Result<&'static str, StoreError> {
    let mut values = artifact.contents()?.iter().filter(|content| content.path == path);
    let is_force = values.any(|content| content.units == REACTION_UNIT);
    Ok(if is_force { REACTION_UNIT } else { "mm" })
}

impl Designs {
    /// Like [`Self::object`], with values in a unit: mm for displacements, mN for forces of sides.
    #[must_use]
    pub fn object_in(self, unit: &str) -> Object {
        let has_charges = self.front.as_ref().is_some_and(|front| front.charge.is_some());
        let of_volume = self.front.as_ref().map(|front| front.hypervolume_unit(unit));
        let mut object = in_unit(self.object(), &VALUES, unit);
        if has_charges {
            object = in_unit(object, &LIMITS, CHARGE_UNIT);
        }
        match of_volume {
            Some(of_volume) => in_unit(object, &[HYPERVOLUME], &of_volume),
            None => object,
        }
    }
}

impl DesignsView<'_> {
    /// Returns the unit of the values.
    ///
    /// # Errors
    /// If a chunk is missing or damaged.
    pub fn unit(&self) -> Result<&'static str, StoreError> {
        unit_of(self.artifact(), VALUES[0])
    }

    /// Returns the unit of the hypervolume of a front; mm without a front.
    ///
    /// # Errors
    /// If a chunk is missing or damaged.
    pub fn hypervolume_unit(&self) -> Result<String, StoreError> {
        let mut contents = self.artifact().contents()?.iter();
        let found = contents.find(|content| content.path == HYPERVOLUME);
        Ok(found.map_or_else(|| "mm".to_owned(), |content| content.units.clone()))
    }
}

impl Verification {
    /// Like [`Self::object`], with values in a unit: mm for displacements, mN for forces of sides.
    #[must_use]
    pub fn object_in(self, unit: &str) -> Object {
        in_unit(self.object(), &VERIFIED_VALUES, unit)
    }
}

/// Units of a genome of the genetic algorithm along a side of the membrane.
pub const GENOME_UNITS: usize = 20;

arrays! {
    /// Designs, verified or not.
    #[derive(Default)]
    pub struct DesignRows, DesignRowsView {
        /// Label of the stage that designed it.
        case: Vec<String> = array("case", "", [row]),
        /// Name of the target.
        name: Vec<String> = array("name", "", [row]),
        /// Origin of the pattern: `ga` (genetic algorithm), `refined` (along the gradient), `optimum` (gradients only),
        /// `intuitive`, `intuitive-equal-area` or `own`.
        role: Vec<Role> = array("role", "", [row]),
        /// Target area, a share of the free membrane, or `free`.
        area_target: Vec<String> = array("area_target", "", [row]),
        /// The evaluator that predicted the field.
        evaluator: Vec<String> = array("evaluator", "", [row]),
        /// Number of the design of the target.
        member: Vec<u64> = array("member", "1", [row]),
        /// Units along a side in the search.
        units: Vec<u64> = array("units", "1", [row]),
        /// Electrode patterns, origin lower left, 1 = electrode.
        patterns: Vec<Pattern> = array("patterns", "1", [row, y, x]),
        /// Electrode area, a share of the free membrane.
        area: Vec<f64> = array("area", "1", [row]),
        /// Predicted displacement at the cell corners; a row for each pattern that is not `own`.
        predicted: Vec<Field> = array("predicted", "mm", [predicted_row, corner_y, corner_x, xy]),
        /// The objective in YAML.
        objective: LongTexts = array("objective", "", [row]),
        /// The constraints in YAML.
        constraints: LongTexts = array("constraints", "", [row]),
        /// `met`, or the violated constraints according to the search.
        status: LongTexts = array("status", "", [row]),
        /// Predictions of a calibrated network, if there is one.
        interval: Option<DesignIntervals> = group("interval"),
        /// If the scene has several states, the predictions in each; `predicted` is that in the first.
        states: Option<PredictedStates> = group("states"),
    }
}

arrays! {
    /// Predictions in each state of a device.
    #[derive(Default)]
    pub struct PredictedStates, PredictedStatesView {
        /// Predicted displacement at the cell corners in each state, ordered by name; a row for each pattern that is
        /// not `own`.
        predicted: Vec<Field> = array("predicted", "mm", [predicted_row, state, corner_y, corner_x, xy]),
    }
}

impl DesignRows {
    /// Returns the predicted fields in the states of the device, by the index among the predicted rows.
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

    /// Returns the number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.patterns.len()
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.patterns.is_empty()
    }

    /// Adds a row of a design stage; all of these have a prediction.
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
        self.push_common(others, row, (&others.patterns[row], others.area[row]), interval);
    }

    /// Adds an own pattern of the user, with its area fraction, for the target of a row of others. It has no
    /// prediction.
    pub fn push_own(
        &mut self,
        (others, row): (&Self, usize),
        (member, pattern, area): (u64, &Pattern, f64),
        status: String,
    ) {
        self.role.push(Role::Own);
        self.member.push(member);
        self.units.push(CELLS as u64);
        self.evaluator.push(String::new());
        self.status.0.push(status);
        self.push_common(others, row, (pattern, area), None);
    }

    fn push_common(
        &mut self,
        others: &Self,
        row: usize,
        (pattern, area): (&Pattern, f64),
        interval: Option<DesignInterval>,
    ) {
        self.case.push(others.case[row].clone());
        self.name.push(others.name[row].clone());
        self.area_target.push(others.area_target[row].clone());
        self.area.push(area);
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

/// Returns for each row its index in the arrays of predictions; `None` without a prediction.
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
    /// Designs and their search.
    pub struct Designs, DesignsView {
        /// The patterns.
        rows: DesignRows = group(""),
        /// Predicted mean displacement along the target directions; in mN for a `reaction`, as in all values.
        value: Vec<f64> = array("value", "mm", [row]),
        /// Value of a `robust` objective: the worst, or the mean less some standard deviations, of the masks. Of other
        /// objectives `value`.
        robust: Option<Vec<f64>> = array("robust", "mm", [row]),
        /// Fitness, smaller is better.
        fitness: Vec<f64> = array("fitness", "1", [row]),
        /// The genetic algorithm.
        history: History = group("history"),
        /// The searches along the gradient.
        steps: GradientSteps = group("climb"),
        /// Number of patterns that the search of each target evaluated.
        evaluations: Vec<u64> = array("evaluations", "1", [target]),
        /// The available evaluators.
        candidates: Candidates = group("probe"),
        /// The search of a front, whose points are the rows.
        front: Option<Fronts> = group("front"),
        /// The scene.
        scene: Scene = attribute("scene"),
        /// The search method.
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
        /// Predicted displacement of the best along the target direction.
        value: Vec<f64> = array("value", "mm", [generation]),
        /// Electrode area of the best, a share of the free membrane.
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
        /// Number of the design.
        member: Vec<u64> = array("member", "1", [step]),
        /// Number of the step.
        step: Vec<u64> = array("step", "1", [step]),
        /// Displacement along the target directions by finite elements.
        value: Vec<f64> = array("value", "mm", [step]),
        /// Electrode area, a share of the free membrane.
        area: Vec<f64> = array("area", "1", [step]),
        /// Number of patterns evaluated up to this step; repeated patterns count each time.
        simulations: Vec<u64> = array("simulations", "1", [step]),
    }
}

arrays! {
    /// The available evaluators, and their errors on patterns of the search.
    #[derive(Default)]
    pub struct Candidates, CandidatesView {
        /// Name of the target.
        name: Vec<String> = array("name", "", [candidate]),
        /// Evaluators by increasing cost, the reference last; none if the pipeline names one.
        settings: Vec<String> = array("candidates", "", [candidate]),
        /// Root mean square error of a component on patterns of the first generation.
        rmse: Vec<f64> = array("rmse", "mm", [candidate]),
        /// Largest relative error of the displacement along the target directions, on patterns like designs.
        design_error: Vec<f64> = array("design_error", "1", [candidate]),
        /// Number of patterns of the error.
        known: Vec<u64> = array("known", "1", [candidate]),
        /// Number of patterns for which only one of evaluator and reference has a field.
        disagree: Vec<u64> = array("disagree", "1", [candidate]),
    }
}

arrays! {
    /// Simulated designs. Arrays of simulated numbers have a row for each pattern with a field, in order.
    pub struct Verification, VerificationView {
        /// The patterns.
        rows: DesignRows = group(""),
        /// How the simulation ended.
        outcome: Vec<OutcomeKind> = array("outcome", "", [row]),
        /// Simulated displacement at the cell corners; a row for each pattern with a field.
        displacement: Vec<Field> = array("displacement", "mm", [simulated_row, corner_y, corner_x, xy]),
        /// Predicted minus simulated displacement; a row for each pattern with a field that is not `own`.
        difference: Vec<Field> = array("difference", "mm", [compared_row, corner_y, corner_x, xy]),
        /// If the scene has several states, the displacement in each; `displacement` is that in the first. A pattern
        /// has a field if it has one in all states; otherwise its outcome is that of the first state without.
        states: Option<SimulatedStates> = group("states"),
        /// If the membrane leaves its plane, how far; with a row for each pattern with a field.
        space: Option<HeightChanges> = group("space"),
        /// If times were requested and the scene has one state, the motion in time of the patterns with a field;
        /// `displacement` is that at the time of the objective, or at the last time.
        history: Option<SolvedHistories> = group("history", [(sample, simulated_row)]),
        /// Displacements along the target directions.
        component: Components = group("component"),
        /// The scene of the simulations.
        scene: Scene = attribute("scene"),
        /// The solver in the keys of a solve stage.
        solver: String = attribute("solver"),
        /// The simulated effects.
        effects: Effects = attribute("effects"),
    }
}

arrays! {
    /// Displacements in each state of a device.
    #[derive(Default)]
    pub struct SimulatedStates, SimulatedStatesView {
        /// Simulated displacement at the cell corners in each state, ordered by name; a row for each pattern with a
        /// field in all states.
        displacement: Vec<Field> = array("displacement", "mm", [simulated_row, state, corner_y, corner_x, xy]),
    }
}

arrays! {
    /// Changes by the voltage out of the plane, in each state of the device, ordered by name, or in the only one.
    #[derive(Default)]
    pub struct HeightChanges, HeightChangesView {
        /// Change of the height of the cell corners by the voltage.
        height: Packed<PerCorner<f64>> = array("height", "mm", [simulated_row, state, corner_y, corner_x]),
        /// Change of the volume between the membrane and its plane by the voltage.
        volume: Packed<f64> = array("volume", "ml", [simulated_row, state]),
    }
}

arrays! {
    /// Displacements along the target directions.
    #[derive(Default)]
    pub struct Components, ComponentsView {
        /// Predicted mean displacement along the target directions; a row for each pattern that is not `own`.
        predicted: Vec<f64> = array("predicted", "mm", [predicted_row]),
        /// Simulated mean displacement along the target directions; a row for each pattern with a field.
        simulated: Vec<f64> = array("simulated", "mm", [simulated_row]),
        /// Difference from a mesh with half the elements per cell, or the estimated error if an accuracy was requested,
        /// and the error of cells in place of curves; 0 if unknown. A row for each pattern with a field.
        error: Vec<f64> = array("error", "mm", [simulated_row]),
        /// Whether the error is known, i.e. the other solutions have a field too. A row for each pattern with a field.
        error_known: Vec<u64> = array("error_known", "1", [simulated_row]),
        /// If times were requested, the simulated displacement along the target directions at each of them; a row for
        /// each pattern with a field.
        in_time: Option<Packed<f64>> = array("in_time", "mm", [simulated_row, time]),
        /// Root mean square distance from the target displacements; 0 for a target with only a direction. A row for
        /// each pattern with a field.
        distance: Vec<f64> = array("distance", "mm", [simulated_row]),
    }
}

impl VerificationView<'_> {
    /// Returns the unit of the values.
    ///
    /// # Errors
    /// If a chunk is missing or damaged.
    pub fn unit(&self) -> Result<&'static str, StoreError> {
        unit_of(self.artifact(), VERIFIED_VALUES[1])
    }

    /// Returns for each pattern its row in the simulated arrays; `None` without a field.
    ///
    /// # Errors
    /// If these arrays do not have a row for each pattern with a field.
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
