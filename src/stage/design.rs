//! The kind `design`: searches patterns that move points and bodies to targets, by the genetic algorithm or by
//! gradient search.
//!
//! The genetic algorithm uses a network, an estimate or Newton's method, by default the cheapest of these that is
//! accurate enough; its designs can be refined by gradient search.

mod content;
mod elements;
mod evaluators;
mod follow;
mod intervals;
mod stoppable;

use std::collections::BTreeMap;
use std::sync::OnceLock;
use std::time::Instant;

use serde_json::json;

use super::results::{
    CHARGE, CHARGE_HYPERVOLUME, HYPERVOLUME, PREDICTED_REACTION, PREDICTED_VOLUME, ml_per_mm, of_targets,
};
use super::{drive_check, model, needed, scene};
use deaflow_base::{Canonical, Declared, Document, Fields, InputError, Map, Node, Parameter, Stopped, parameters};
use deaflow_content::{DesignRank, Designs, best_of_targets};
use deaflow_design::{
    CaseLabel, ConstraintParameters, DesignTask, Front, FrontObjective, Method, Objective, PlannedDesign, ResponseKind,
    SINGLE_NAME, Search, SearchError, SearchOptions, Target, Targets, UNITS,
};
use deaflow_fem::effects::breakdown_ratio_at_rest;
use deaflow_fem::{
    InflationSolver, Method as Evaluation, SetupError, Swing, ThreeSolves, check_covered_cells, no_pattern_limit,
    revision_of,
};
use deaflow_field::REACTION_UNIT;
use deaflow_orchestrator::{Chunk, Input, Job, Kind, Needs, Plan, Stage, StageCheck, StageDeclaration, StageError};
use deaflow_pattern::Symmetries;
use deaflow_scene::{MOST_STATES, Scene, Tolerances};
use deaflow_store::{Artifact, Object};
use deaflow_surrogate::Surrogate;

use content::Heading;
use elements::{ForTarget, TargetModels};
pub(super) use evaluators::amplitude_solver;
use evaluators::{EvaluatorChoice, evaluators, with_masks};
use follow::Follow;
use intervals::Calibrated;
use stoppable::is_stop;

/// The kind `design`.
pub struct DesignKind;

parameters! {
    /// Searches patterns that move points and bodies to targets.
    struct DesignParameters as "a design stage" {
        /// A label for tables.
        case: Option<CaseLabel>,
        /// Evaluator of patterns: the network, an estimate, Newton's method, or the cheapest of these that is accurate
        /// enough.
        evaluator: EvaluatorChoice = EvaluatorChoice::Auto,
    }
    include {
        /// The targets.
        targets: Targets,
        /// The search options.
        options: SearchOptions,
    }
    rules(rules)
    check(DesignParameters::check)
}

/// Constraints depend on the scene and are read separately. `evaluator: surrogate` needs a network.
fn rules(fields: Fields) -> Fields {
    let is = |key: &str, word: &str| json!({ "required": [key], "properties": { key: { "const": word } } });
    fields
        .optional("constraints", ConstraintParameters::schema())
        .rule(json!({ "if": is("evaluator", "surrogate"), "then": { "required": ["needs"] } }))
        .rule(json!({ "if": is("method", "adjoint"), "then": { "not": { "required": ["needs"] } } }))
        .rule(json!({ "if": FrontObjective::is_within_limits(), "then": { "not": { "required": ["needs"] } } }))
}

impl DesignParameters {
    /// Reads the parameters of a stage. The method of a front is that of `pareto`.
    fn of_stage(map: &Map<'_>) -> Result<Self, InputError> {
        let read = Self::read_map(map)?;
        Ok(match read.targets.is_front() {
            true => Self {
                options: read.options.of_front(read.targets.is_genetic_front()),
                ..read
            },
            false => read,
        })
    }

    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        let network = networks_of(map);
        if self.evaluator == EvaluatorChoice::Surrogate && network.is_none() {
            return Err(map
                .error("`evaluator: surrogate` needs a network: add a train stage to `needs`")
                .help("add `needs: [STAGE]` with a stage of kind `train`, or use another evaluator"));
        }
        if let Some(node) = network
            && self.targets.is_front()
            && !self.targets.is_genetic_front()
        {
            return Err(node
                .error("`method: epsilon` uses finite elements only; remove the network from `needs`")
                .help("remove `needs`, or use `pareto: { method: nsga2 }`"));
        }
        match network.filter(|_| self.options.method == Method::Adjoint) {
            Some(node) => Err(node
                .error("`method: adjoint` uses finite elements only; remove the network from `needs`")
                .help("remove `needs`")),
            None => Ok(()),
        }
    }
}

/// Returns the parameters of a stage with its targets by name, those of a single one by the keys of the stage. A target
/// that `other` parameters lack is one value. `None` without targets.
fn targets_by_name(parameters: &Canonical, other: &Canonical) -> Option<Canonical> {
    let (own, other) = (named_targets(parameters)?, named_targets(other).unwrap_or_default());
    let Canonical::Map(mut all) = parameters.clone() else {
        return None;
    };
    all.remove("targets");
    let is_single = |targets: &[(&str, BTreeMap<String, Canonical>)]| matches!(targets, [(SINGLE_NAME, _)]);
    if is_single(&own) && is_single(&other) {
        all.extend(own.into_iter().flat_map(|(_, target)| target));
        return Some(Canonical::Map(all));
    }
    let by_name = own.into_iter().map(|(name, target)| {
        let (target, is_known) = (Canonical::Map(target), other.iter().any(|(known, _)| *known == name));
        match is_known {
            true => (name, target),
            false => (name, Canonical::Text(target.to_string())),
        }
    });
    all.insert("targets".to_owned(), Canonical::map(by_name));
    Some(Canonical::Map(all))
}

/// Returns the targets in the parameters of a stage: names, and everything else.
fn named_targets(parameters: &Canonical) -> Option<Vec<(&str, BTreeMap<String, Canonical>)>> {
    let Canonical::Map(all) = parameters else { return None };
    let Canonical::List(targets) = all.get("targets")? else {
        return None;
    };
    let named = targets.iter().map(|target| {
        let Canonical::Map(target) = target else { return None };
        let Canonical::Text(name) = target.get("name")? else {
            return None;
        };
        let others = target.iter().filter(|(key, _)| *key != "name");
        Some((
            name.as_str(),
            others.map(|(key, value)| (key.clone(), value.clone())).collect(),
        ))
    });
    named.collect()
}

impl Kind for DesignKind {
    fn name(&self) -> &'static str {
        "design"
    }

    fn recipe(&self) -> u32 {
        6
    }

    fn separate_cost_parameters(&self) -> &'static [&'static str] {
        &[
            "stage.method",
            "stage.evaluator",
            "stage.judged",
            "stage.refine",
            "stage.units",
            "stage.scene.effects",
        ]
    }

    fn as_written(&self, both: [&Canonical; 2]) -> [Canonical; 2] {
        let [now, then] = both;
        [(now, then), (then, now)].map(|(own, other)| targets_by_name(own, other).unwrap_or_else(|| own.clone()))
    }

    fn scene_parameters(&self, stage: &Node) -> Vec<String> {
        let map = stage.fields(DesignParameters::WHAT, &keys());
        let read = map.and_then(|map| DesignParameters::of_stage(&map));
        // A stage that cannot be read has been refused before.
        let targets = read.map(|read| read.targets).ok();
        let taken = targets.iter().flat_map(Targets::from_tolerances);
        taken.map(|[own, scene]| format!("{own}={scene}")).collect()
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let view = Designs::open(artifact)?;
        let rows = view.rows();
        let (names, roles) = (rows.name().read()?, rows.role().read()?);
        let (statuses, values) = (rows.status().read()?.0, view.value().read()?);
        let found = (0..names.len()).filter(|row| roles[*row].is_found());
        let found = best_of_targets(found.map(|row| {
            let rank = DesignRank::predicted(roles[row], &statuses[row], values[row]);
            (names[row].as_str(), rank, row)
        }));
        let value = match view.unit()? {
            REACTION_UNIT => PREDICTED_REACTION,
            _ => "predicted",
        };
        let mut results = of_targets(&found, &[(value, &values), ("area", &rows.area().read()?)]);
        let (objectives, scene) = (rows.objective().read()?.0, view.scene().read()?);
        let factors: Option<Vec<f64>> = objectives.iter().map(|text| ml_per_mm(text, &scene)).collect();
        if let Some(factors) = factors {
            let volumes: Vec<f64> = values.iter().zip(&factors).map(|(value, ml)| value * ml).collect();
            results.extend(of_targets(&found, &[(PREDICTED_VOLUME, &volumes)]));
        }
        if let Some(robust) = view.robust().read()? {
            results.extend(of_targets(&found, &[("robust", &robust)]));
        }
        if view.front().is_there()? {
            let charges = view.front().charge().read()?;
            results.extend(
                charges
                    .iter()
                    .flat_map(|charges| of_targets(&found, &[(CHARGE, charges)])),
            );
            let name = match view.hypervolume_unit()?.as_str() {
                "mm" => Some(HYPERVOLUME),
                "mm nC" => Some(CHARGE_HYPERVOLUME),
                // Results have one unit for each name.
                _ => None,
            };
            let grown = view.front().hypervolume().read()?;
            results.extend(
                name.zip(grown.last())
                    .map(|(name, reached)| (name.to_owned(), *reached)),
            );
        }
        Ok(results)
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &["train", "calibrate"],
            least: 0,
            most: MOST_STATES + 1,
        }
    }

    fn reads_scene(&self) -> bool {
        true
    }

    fn files(&self, stage: &Node) -> Vec<String> {
        let targets = stage.peek("targets").and_then(|targets| targets.list("targets").ok());
        let all = std::iter::once(stage).chain(targets.unwrap_or_default());
        let of_front = stage.peek("objectives").and_then(|both| both.list("objectives").ok());
        let objectives = all
            .filter_map(|of| of.peek("objective"))
            .chain(of_front.unwrap_or_default());
        let fields = objectives.filter_map(|objective| objective.peek("field")?.text("field").ok());
        fields.map(str::to_owned).collect()
    }

    fn schema(&self) -> Vec<Fields> {
        vec![DesignParameters::fields()]
    }

    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        let map = stage.node.fields(DesignParameters::WHAT, &keys())?;
        let parameters = DesignParameters::of_stage(&map)?;
        check_networks(&parameters, stage, needs)?;
        let (mut warnings, mut expectations) = (Vec::new(), Vec::new());
        warnings.extend(drive_check::stability_warning(stage));
        let evaluator = parameters.evaluator;
        if map.optional("evaluator_accuracy").is_some() && evaluator != EvaluatorChoice::Auto {
            let accuracy = &parameters.options.evaluator_accuracy;
            warnings.push(format!(
                "`evaluator_accuracy: {accuracy}` has no effect with `evaluator: {evaluator}`; `evaluator: auto` \
                 selects the cheapest evaluator with this accuracy"
            ));
            expectations = evaluator.expectations(accuracy.value(), needs);
        }
        Ok(StageCheck {
            warnings,
            expectations,
            ..StageCheck::default()
        })
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let here = (DesignParameters::WHAT, &keys()[..]);
        stage.refuse_misplaced(here, "constraints", &ConstraintParameters::keys())?;
        let map = stage.fields(DesignParameters::WHAT, &keys())?;
        let tolerances = tolerances_of(scene)?;
        let scene = scene::read_in_space(stage, scene)?;
        let DesignParameters {
            case,
            evaluator,
            targets,
            options,
        } = DesignParameters::of_stage(&map)?;
        let targets = targets.with_tolerances(tolerances.as_ref());
        let task = DesignTask::read((targets, &options), (&map, stage), &scene)?;
        task.check(&options, (&map, stage), &scene)?;
        check_breakdown_margin(&task, &scene.in_plane(), map.optional("constraints").unwrap_or(stage))?;
        check_pull_in_margin(&task, &scene.in_plane(), map.optional("constraints").unwrap_or(stage))?;
        if scene.is_in_space() {
            check_in_space(&task, &scene, evaluator, &map)?;
        }
        if task.front.as_ref().is_some_and(Front::has_charge) {
            check_charge(&task, &scene, map.optional("objectives").unwrap_or(stage))?;
            only_by_newton((&map, networks_of(&map)), evaluator, "the charge", "minimises it")?;
        }
        for target in &task.targets {
            let node = map.optional("objective").unwrap_or(stage);
            check_response(target, &scene, node)?;
            if let ResponseKind::Amplitude(_) = target.objective.response() {
                check_amplitude_evaluator(&map, evaluator)?;
            }
            if target.objective.is_reaction() {
                refuse_networks(&map)?;
            }
            if target.masks.is_some() {
                check_robust(&task, &scene, evaluator, &map)?;
            }
        }
        Ok(Box::new(DesignStage {
            case,
            options,
            evaluator,
            models: task.targets.iter().map(|_| OnceLock::new()).collect(),
            scene: task.relevant_scene(&scene),
            in_time: scene,
            task,
        }))
    }
}

/// The keys of a design stage.
fn keys() -> Vec<&'static str> {
    [&["kind", "needs", "constraints"][..], &DesignParameters::keys()].concat()
}

/// Reads the tolerances of the scene of a stage.
fn tolerances_of(scene: Option<&Node>) -> Result<Option<Tolerances>, InputError> {
    Ok(scene.map(Tolerances::of_scene).transpose()?.flatten())
}

/// The `needs` of a stage, if there are any.
fn networks_of<'m>(map: &Map<'m>) -> Option<&'m Node> {
    let needs = map.optional("needs");
    needs.filter(|needs| !needs.list("needs").is_ok_and(<[Node]>::is_empty))
}

/// Refuses a robust objective where cells that are covered in part are not simulated.
fn check_robust(task: &DesignTask, scene: &Scene, evaluator: EvaluatorChoice, map: &Map<'_>) -> Result<(), InputError> {
    only_by_newton(
        (map, networks_of(map)),
        evaluator,
        "cells that are covered in part",
        "is `robust`",
    )?;
    let keys = ["objective", "targets", "objectives"].into_iter();
    let objective = keys.filter_map(|key| map.optional(key)).next();
    let refused = |message: String, help: &str| {
        let error = objective.map_or_else(|| map.error(message.clone()), |node| node.error(message.clone()));
        Err(error.help(help.to_owned()))
    };
    if task.front.as_ref().is_some_and(Front::has_charge) {
        let message = "`robust` cannot be used with `charge: least`".to_owned();
        return refused(message, "use `area: least`");
    }
    scene.in_states().iter().try_for_each(|(_, state)| {
        check_covered_cells(state).or_else(|error| refused(error.to_string(), "remove `robust`, or the effect"))
    })
}

/// Refuses what is not simulated in space.
fn check_in_space(
    task: &DesignTask,
    scene: &Scene,
    evaluator: EvaluatorChoice,
    map: &Map<'_>,
) -> Result<(), InputError> {
    let why = "a membrane that leaves its plane";
    only_by_newton((map, networks_of(map)), evaluator, why, "is one")?;
    let refused = |with| {
        let message = SetupError::not_in_space(scene, with).to_string();
        Err(map
            .optional("objective")
            .map_or_else(|| map.error(message.clone()), |node| node.error(message.clone())))
    };
    if task.targets.iter().any(|target| target.masks.is_some()) {
        return refused("a `robust` objective");
    }
    if task.front.as_ref().is_some_and(Front::has_charge) {
        return refused("`charge: least`");
    }
    let is_equilibrium = |target: &Target| target.objective.response() == ResponseKind::Equilibrium;
    if !task.targets.iter().all(is_equilibrium) {
        return refused("a `time` or `frequency` of an objective");
    }
    for (_, state) in scene.in_states() {
        InflationSolver::check(&state).map_err(|error| map.error(error.to_string()))?;
    }
    Ok(())
}

/// Returns the designs that a stage will search.
///
/// # Errors
/// If its mapping is invalid.
pub(super) fn planned(stage: &StageDeclaration<'_>) -> Result<Vec<PlannedDesign>, InputError> {
    let map = stage.node.fields(DesignParameters::WHAT, &keys())?;
    let scene = scene::read_in_space(stage.node, stage.scene)?;
    let DesignParameters {
        case, targets, options, ..
    } = DesignParameters::of_stage(&map)?;
    let targets = targets.with_tolerances(tolerances_of(stage.scene)?.as_ref());
    let task = DesignTask::read((targets, &options), (&map, stage.node), &scene)?;
    Ok(task.planned(stage.name, case.as_ref(), &options))
}

/// Reads an objective as artifacts have it.
///
/// # Errors
/// If it is invalid.
pub(super) fn stored_objective(text: &str) -> Result<Objective, String> {
    let document = Document::from_text(std::path::Path::new("objective"), text).map_err(|error| error.to_string())?;
    Objective::read(&document.root).map_err(|error| error.to_string())
}

/// Refuses a target at a time in a scene whose creep does not follow from three equilibria, and an amplitude without a
/// suitable drive.
fn check_response(target: &Target, scene: &Scene, node: &Node) -> Result<(), InputError> {
    let name = &target.name;
    match target.objective.response() {
        _ if scene.auto => Ok(()),
        ResponseKind::Equilibrium => Ok(()),
        ResponseKind::After(time) => ThreeSolves::new(scene, time.value())
            .map(|_| ())
            .map_err(|e| node.error(format!("target `{name}` at {time}: {e}"))),
        ResponseKind::Amplitude(frequency) => {
            Swing::check(scene).map_err(|e| node.error(format!("target `{name}` at {frequency}: {e}")))
        }
    }
}

/// Refuses a charge as an objective where it is not that of one equilibrium at one voltage.
fn check_charge(task: &DesignTask, scene: &Scene, node: &Node) -> Result<(), InputError> {
    let is_equilibrium = |target: &Target| target.objective.response() == ResponseKind::Equilibrium;
    let why = if scene.drive.charge.is_some() {
        "the drive is a charge"
    } else if !scene.states.is_empty() {
        "the device has several states"
    } else if scene.drive.voltages.in_volts().len() > 1 {
        "the device has several voltages"
    } else if !task.targets.iter().all(is_equilibrium) {
        "the other objective is not one of an equilibrium"
    } else {
        return Ok(());
    };
    Err(node
        .error(format!("`charge: least` is not possible here: {why}"))
        .help("use `area: least`"))
}

/// Refuses a design without the networks that it needs: one, or one for each state of the device.
fn check_networks(
    parameters: &DesignParameters,
    stage: &StageDeclaration<'_>,
    needs: &[StageDeclaration<'_>],
) -> Result<(), InputError> {
    let networks = needed::count(needs, &["train"]);
    let node = |key| stage.node.peek(key).unwrap_or(stage.node);
    if parameters.evaluator == EvaluatorChoice::Surrogate && networks == 0 {
        return Err(node("evaluator")
            .error("`evaluator: surrogate` needs a network, and `needs` names none")
            .help("add a stage of kind `train` to `needs`, or use another evaluator"));
    }
    let scene = scene::read_in_space(stage.node, stage.scene)?;
    let states: Vec<&str> = scene.states.iter().map(|(name, _)| name).collect();
    check_calibration(&states, stage, needs)?;
    let expected = states.len().max(1);
    if networks == 0 || networks == expected {
        return check_states(&states, stage, needs);
    }
    let (message, help) = match states.len() {
        0 => (
            format!("a design uses one network, and `needs` names {networks}"),
            "name one stage of kind `train`".to_owned(),
        ),
        count => (
            format!(
                "a design of a device with {count} states ({}) uses a network for each; `needs` names {networks}",
                states.join(", ")
            ),
            "name a stage of kind `train` for each state, or none".to_owned(),
        ),
    };
    Err(node("needs").error(message).help(help))
}

/// Refuses two networks of the same state of the device: another state has none.
fn check_states(
    states: &[&str],
    stage: &StageDeclaration<'_>,
    needs: &[StageDeclaration<'_>],
) -> Result<(), InputError> {
    let mut left: BTreeMap<&str, Option<&str>> = states.iter().map(|state| (*state, None)).collect();
    let mut repeated = None;
    for network in needs.iter().filter(|need| need.kind == "train") {
        let state = needed::state_of(network).unwrap_or_default();
        let Some(of) = left.get_mut(state.as_str()) else {
            continue;
        };
        match of {
            None => *of = Some(network.name),
            Some(other) => repeated = repeated.or(Some((*other, network.name, state))),
        }
    }
    let missing: Vec<&str> = left
        .iter()
        .filter(|(_, of)| of.is_none())
        .map(|(state, _)| *state)
        .collect();
    match repeated {
        None => Ok(()),
        Some((first, second, state)) => Err(needed::named(stage, second)
            .error(format!(
                "the networks `{first}` and `{second}` are both of state `{state}`"
            ))
            .help(format!(
                "name a network of state {} instead of one of them",
                missing.join(" or ")
            ))),
    }
}

/// Refuses calibrations that a design cannot use.
fn check_calibration(
    states: &[&str],
    stage: &StageDeclaration<'_>,
    needs: &[StageDeclaration<'_>],
) -> Result<(), InputError> {
    let mut calibrations = needs.iter().filter(|need| need.kind == "calibrate");
    let Some(first) = calibrations.next() else {
        return Ok(());
    };
    if !states.is_empty() {
        return Err(needed::named(stage, first.name)
            .error(intervals::STATES)
            .help(format!("remove `{}` from `needs`", first.name)));
    }
    if let Some(second) = calibrations.next() {
        return Err(needed::named(stage, second.name)
            .error(intervals::SEVERAL)
            .help(format!("remove `{}` or `{}` from `needs`", first.name, second.name)));
    }
    needed::own_calibrations(stage, needs)
}

/// Refuses a breakdown margin that no pattern that moves can reach. Electrodes expand under voltage, so the field in one
/// of their cells is at least that of the membrane at rest.
fn check_breakdown_margin(task: &DesignTask, scene: &Scene, node: &Node) -> Result<(), InputError> {
    let constraints = task.constraints.constraints();
    let (Some(margin), Some(strength)) = (constraints.limits().breakdown_margin, scene.breakdown_strength()) else {
        return Ok(());
    };
    if scene.drive.charge.is_some() || scene.geometry.has_forces() {
        return Ok(());
    }
    // A pattern may use only the group with the lowest voltage, which keeps the margin in all states. A group without
    // voltage moves nothing alone.
    let groups = scene.at_largest_voltages().drive.voltages.in_volts();
    let Some(volts) = groups.into_iter().filter(|volts| *volts > 0.0).reduce(f64::min) else {
        return Ok(());
    };
    let largest = 1.0 / breakdown_ratio_at_rest(strength, &scene.at_voltage(volts));
    if margin <= largest {
        return Ok(());
    }
    let at = node.peek("breakdown_margin").unwrap_or(node);
    Err(at
        .error(format!(
            "`breakdown_margin: {margin}` cannot be reached: at {:.4} kV the field of any electrode leaves at most \
             {largest:.3}",
            volts / 1e3
        ))
        .help("lower the margin or the voltage, or use a thicker membrane"))
}

/// Refuses a margin from pull-in that no pattern can reach.
fn check_pull_in_margin(task: &DesignTask, scene: &Scene, node: &Node) -> Result<(), InputError> {
    let Some(margin) = task.constraints.constraints().limits().pull_in_margin else {
        return Ok(());
    };
    if scene.drive.charge.is_some() {
        return Ok(());
    }
    // A pattern may use only the group with the lowest voltage.
    let states = scene.in_states();
    let all = states.iter().flat_map(|(_, scene)| scene.drive.voltages.in_volts());
    let Some(volts) = all.filter(|volts| *volts > 0.0).reduce(f64::min) else {
        return Ok(());
    };
    let Ok(Some(limit)) = no_pattern_limit(&scene.at_voltage(volts), margin) else {
        return Ok(());
    };
    let at = node.peek("pull_in_margin").unwrap_or(node);
    Err(at
        .error(format!(
            "`pull_in_margin: {margin}` cannot be reached: no pattern is stable at {:.4} kV, {:.3} times {:.4} kV",
            limit / 1e3,
            limit / volts,
            volts / 1e3
        ))
        .help("lower the margin or the voltage, or use a thicker or stiffer membrane"))
}

/// Refuses networks for forces of sides.
fn refuse_networks(map: &Map<'_>) -> Result<(), InputError> {
    match networks_of(map) {
        None => Ok(()),
        Some(node) => Err(node
            .error("networks cannot predict forces of sides, and a target has a `reaction`")
            .help("remove `needs`")),
    }
}

/// Help where no pattern satisfies area and constraints.
const CONTRADICTION: &str = "use another `area` (or `area: free`), or relax `constraints`: the strips that join pads \
                             and pieces take area, too";

/// Refuses networks and estimates: they cannot predict amplitudes.
fn check_amplitude_evaluator(map: &Map<'_>, evaluator: EvaluatorChoice) -> Result<(), InputError> {
    let needs = map.optional("needs");
    only_by_newton((map, needs), evaluator, "amplitudes", "has a `frequency`")
}

/// Refuses the networks that a stage needs and other evaluators than Newton's method, which cannot predict something.
fn only_by_newton(
    (map, needs): (&Map<'_>, Option<&Node>),
    evaluator: EvaluatorChoice,
    what: &str,
    target: &str,
) -> Result<(), InputError> {
    let network = needs.map(|node| (node, format!("networks cannot predict {what}"), "remove `needs`"));
    let other = match evaluator {
        EvaluatorChoice::Auto | EvaluatorChoice::Elements(Evaluation::Newton) => None,
        other => map.optional("evaluator").map(|node| {
            let message = format!("`evaluator: {other}` cannot predict {what}");
            (node, message, "allowed: auto, newton")
        }),
    };
    match network.or(other) {
        None => Ok(()),
        Some((node, message, help)) => Err(node.error(format!("{message}, and a target {target}")).help(help)),
    }
}

struct DesignStage {
    case: Option<CaseLabel>,
    task: DesignTask,
    options: SearchOptions,
    evaluator: EvaluatorChoice,
    /// The parts of the scene on which the designs depend.
    scene: Scene,
    /// The whole scene, with the time dependence of its drive.
    in_time: Scene,
    /// The models of each target; targets with equal models share those of the first.
    models: Vec<OnceLock<TargetModels>>,
}

impl DesignStage {
    /// All parameters but the targets.
    fn common(&self) -> Canonical {
        let mut entries = match self.task.front {
            Some(_) if self.options.method == Method::Ga => self.options.used_by_genetic_front(),
            _ => self.options.used(),
        };
        if self.evaluator != EvaluatorChoice::Auto {
            entries.retain(|(key, _)| *key != "evaluator_accuracy");
        }
        if self.options.method == Method::Ga {
            entries.extend(self.evaluator.canonical().map(|evaluator| ("evaluator", evaluator)));
        }
        entries.extend(self.case.canonical().map(|case| ("case", case)));
        let constraints = self.task.constraints.constraints();
        if constraints.limits().pull_in_margin.is_some() {
            // Changes the key: earlier versions checked the margin on one mesh only.
            entries.push(("pull_in_meshes", 2_u64.into()));
        }
        let is_square = self.scene.symmetries() == Symmetries::SQUARE && constraints.available().is_none();
        if !(is_square && constraints.allow_any_pattern() && constraints.groups() == 1) {
            // Changes the key: earlier versions missed possible areas, kept groups without effect, and compared
            // designs by the symmetries of the square.
            entries.push(("devices", 2_u64.into()));
        }
        let sides = self.scene.membrane().raster.sides();
        if self.options.method == Method::Ga && sides.into_iter().any(|cells| cells < UNITS) {
            // Changes the key: earlier versions lost units without a cell of their own.
            entries.push(("units_of_cells", 2_u64.into()));
        }
        if constraints.keep_out() {
            // Changes the key: earlier versions put intuitive designs into regions that are kept out.
            entries.push(("intuitive", 2_u64.into()));
        }
        if self.scene.geometry.sides.is_some() {
            // Changes the key: with earlier versions large strokes outweighed the area.
            entries.push(("area_scale", 2_u64.into()));
        }
        if self.in_time.leads.is_some() {
            // Changes the key: earlier versions ignored the leads of the scene.
            entries.push(("leads", 2_u64.into()));
        }
        entries.extend([
            ("constraints", self.task.constraints.canonical()),
            ("scene", self.scene.canonical()),
        ]);
        entries.extend(self.task.front.as_ref().map(|front| ("front", front.canonical())));
        Canonical::map(entries)
    }

    /// The length of the progress bar of a target; the first generation has no step of its own.
    fn steps(&self) -> u64 {
        let all = self.options.steps();
        match (self.options.method, &self.task.front) {
            (Method::Ga, _) if self.options.generations > 0 => all - 1,
            // The largest limit is that of the searches from several starts.
            (Method::Adjoint, Some(front)) => all + front.pareto.points as u64 - 1,
            (Method::Ga | Method::Adjoint, _) => all,
        }
    }

    fn chunk(&self, target: &Target) -> Canonical {
        Canonical::map([("stage", self.common()), ("target", target.canonical())])
    }

    /// Returns the scene of a target.
    fn scene_of(&self, target: &Target) -> Scene {
        match target.objective.response() {
            ResponseKind::Equilibrium | ResponseKind::Amplitude(_) => self.scene.clone(),
            ResponseKind::After(time) => self.in_time.simulated_until(time),
        }
    }

    /// Returns the networks among the inputs, one for each state of the device; `None` if there are none.
    fn networks(&self, inputs: &[Artifact], scene: &Scene) -> Result<Option<Vec<Surrogate>>, StageError> {
        let models: Vec<&Artifact> = inputs.iter().filter(|input| model::is_in(input)).collect();
        match &models[..] {
            [] if self.evaluator == EvaluatorChoice::Surrogate => Err(StageError::input(
                "`evaluator: surrogate` needs a network: add a train stage to `needs`",
            )),
            [] => Ok(None),
            models => model::in_states(models, scene).map(Some),
        }
    }

    fn heading(&self, target: &Target) -> Heading {
        Heading {
            case: self.case.as_ref().map_or(String::new(), |case| case.0.clone()),
            name: target.name.clone(),
            objective: target.objective.to_text(),
            area: target.area.to_string(),
            constraints: self.task.constraints.to_text(),
        }
    }
}

impl Stage for DesignStage {
    fn parameters(&self) -> Canonical {
        let targets = Canonical::List(self.task.targets.iter().map(Target::canonical).collect());
        Canonical::map([("stage", self.common()), ("targets", targets)])
    }

    fn weight(&self) -> f64 {
        let masks = self.task.targets.iter().filter_map(|target| target.masks.as_ref());
        let masks = masks.map(|masks| masks.offsets.len()).max().unwrap_or(1);
        self.options.weight() * masks as f64
    }

    fn revision(&self) -> u32 {
        let of_area = Scene::area_revision(self.scene.free_cells().as_ref());
        revision_of(&self.scene) + of_area + self.scene.body_revision()
    }

    fn unit(&self) -> &'static str {
        self.options.unit()
    }

    fn plan(&self, inputs: &[Input]) -> Plan {
        let chunk = |target: &Target| Chunk {
            parameters: self.chunk(target),
            inputs: inputs.iter().map(|input| input.digest).collect(),
            samples: self.steps(),
        };
        Plan::Chunks(self.task.targets.iter().map(chunk).collect())
    }

    fn pieces(&self, _inputs: u64) -> u64 {
        self.task.targets.len() as u64
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let requested = job.chunk.map(|chunk| &chunk.parameters);
        let target = self
            .task
            .targets
            .iter()
            .find(|target| Some(&self.chunk(target)) == requested);
        let target = target.ok_or_else(|| StageError::failed("a chunk of a design stage has one target"))?;
        let start = Instant::now();
        let scene = self.scene_of(target);
        let response = target.objective.response();
        let networks = self.networks(job.inputs, &scene)?;
        let calibrated = Calibrated::of(job.inputs, &scene)?;
        let drivers: Vec<u8> = self
            .scene
            .in_states()
            .iter()
            .map(|(_, scene)| scene.strongest_group())
            .collect();
        let help = |error: SearchError| match error {
            SearchError::Stopped(stopped) => stopped.into(),
            SearchError::Predict(error) if is_stop(&error) => Stopped.into(),
            error if error.is_instability() => StageError::Advised {
                source: error.into(),
                help: drive_check::stability_advice(&scene),
            },
            error if error.is_contradiction() => StageError::Advised {
                source: error.into(),
                help: CONTRADICTION.to_owned(),
            },
            error => StageError::failed(error),
        };
        let search = Search {
            target,
            constraints: self.task.constraints.constraints(),
            options: &self.options,
            drivers: &drivers,
            elements: &ForTarget::new(self, target, job.scratch),
            progress: &Follow::new(
                job,
                self.options.generations,
                match ml_per_mm(&target.objective.to_text(), &scene) {
                    Some(ml_per_mm) => (ml_per_mm, "ml"),
                    None => (1.0, target.goal.unit()),
                },
            ),
        };
        let (method, searched) = (self.options.method.name(), format!("search; {}", target.name));
        if let Some(front) = &self.task.front {
            let of_scene = || evaluators(self.evaluator, &scene, (response, &target.goal), networks);
            let found = search.front(front, of_scene).map_err(help)?;
            job.measure(searched, start.elapsed().as_secs_f64());
            let searched = (self.scene.clone(), method);
            let mut designs = content::front((self.heading(target), target), found, front, searched);
            if let Some(calibrated) = calibrated {
                let intervals = calibrated.intervals(&target.goal, &designs.rows.patterns)?;
                designs.rows.interval = Some(intervals);
            }
            return Ok(designs.object_in(target.goal.unit()));
        }
        let found = search.run(|| match &target.masks {
            Some(masks) => with_masks(&scene, masks),
            None => evaluators(self.evaluator, &scene, (response, &target.goal), networks),
        });
        let found = found.map_err(help)?;
        job.measure(searched, start.elapsed().as_secs_f64());
        let is_robust = self.task.targets.iter().any(|target| target.masks.is_some());
        let mut designs = content::designs(self.heading(target), found, is_robust, (self.scene.clone(), method));
        if let Some(calibrated) = calibrated {
            let intervals = calibrated.intervals(&target.goal, &designs.rows.patterns)?;
            designs.rows.interval = Some(intervals);
        }
        Ok(designs.object_in(target.goal.unit()))
    }

    fn attributes(&self) -> Vec<(String, String)> {
        vec![
            ("scene".to_owned(), self.scene.to_text()),
            ("method".to_owned(), self.options.method.name().to_owned()),
        ]
    }
}
