//! The kind `yield`: simulates devices of designs as they are made, under the tolerances of the scene.
//!
//! Devices are simulated in batches, each with its own key: more samples simulate only those that are new, and another
//! wanted displacement simulates none.

use std::ops::Range;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use super::results::of_targets;
use super::{design, drive_check, needed, patterns, scene};
use serde_json::json;

use deaflow_base::{Angle, Canonical, Declared, Fields, InputError, Length, Map, Node, Parameter, Seed, parameters};
use deaflow_content::{ArtifactKind, DesignDevices, Designs, DeviceBatches, Samples, Yields};
use deaflow_design::{Goal, Objective, PlannedDesign, ResponseKind, SINGLE_NAME};
use deaflow_fem::screening::resolved_states;
use deaflow_fem::{SolveOptions, WorkLimit};
use deaflow_field::{Field, Mesh, Order};
use deaflow_orchestrator::{Chunk, Input, Job, Kind, Needs, Plan, Stage, StageCheck, StageDeclaration, StageError};
use deaflow_pattern::{Pattern, Role};
use deaflow_scene::{Effects, Scene, Tolerances};
use deaflow_store::{Artifact, Object};
use deaflow_tolerance::{
    CONVERGED, Device, Failure, MOST_SAMPLES, Source, Study, ToleranceError, Wanted, Yield, check_tolerances,
};

/// Largest number of devices of one key.
const BATCH: u64 = 500;

/// The kind `yield`.
pub struct YieldKind;

parameters! {
    /// Simulates devices of designs and patterns as they are made.
    struct YieldParameters as "a yield stage" {
        /// Number of devices of each pattern.
        samples: u64 [2..=u64::from(MOST_SAMPLES)] = 1000,
        /// The displacement that a device has to reach, or a share of that of the pattern as drawn, such as `90 %`.
        wanted: Option<Wanted>,
        /// The point whose displacement counts, such as [25 mm, 25 mm]; by default the objective of each design counts.
        point: Option<[Length; 2]> [0.0..=1e4],
        /// The direction along which it counts, counterclockwise from the x axis.
        direction: Option<Angle> [-360.0..=360.0],
        /// What differs from one device to the next; by default the `tolerances` of the scene.
        tolerances: Option<Tolerances>,
        /// Elements along one side of a cell.
        elements_per_cell: usize [1..=8] = 1_usize,
        /// Polynomial order of the elements.
        order: u64 [1..=2] = 1_u64,
        /// Seed of the random numbers.
        seed: Seed,
    }
    rules(point_with_direction)
    check(YieldParameters::check)
}

fn point_with_direction(fields: Fields) -> Fields {
    fields.rule(json!({ "dependentRequired": { "point": ["direction"], "direction": ["point"] } }))
}

impl YieldParameters {
    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        let (given, missing) = match (&self.point, &self.direction) {
            (Some(_), None) => ("point", "direction"),
            (None, Some(_)) => ("direction", "point"),
            _ => return Ok(()),
        };
        let node = map.optional(given);
        let message = format!("`{given}` needs a `{missing}`");
        Err(node.map_or_else(|| map.error(message.clone()), |node| node.error(message.clone())))
    }

    /// Returns the displacement that counts in place of the objectives of designs.
    fn objective(&self) -> Option<Result<Objective, String>> {
        let ([x, y], direction) = self.point.as_ref().zip(self.direction.as_ref())?;
        Some(design::stored_objective(&format!(
            "{{ point: [{x}, {y}], direction: {direction} }}"
        )))
    }

    fn options(&self) -> SolveOptions {
        let order = match self.order {
            1 => Order::Bilinear,
            _ => Order::Biquadratic,
        };
        SolveOptions::on(Mesh::new(self.elements_per_cell, order))
    }
}

impl Kind for YieldKind {
    fn name(&self) -> &'static str {
        "yield"
    }

    fn recipe(&self) -> u32 {
        3
    }

    fn separate_cost_parameters(&self) -> &'static [&'static str] {
        &["elements_per_cell", "order", "scene.effects"]
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let found = yields_of(artifact)?;
        // Of a target, the design that a search found.
        let is_found = |of: &DesignDevices| {
            let same = |one: &DesignDevices| (&one.case, &one.name) == (&of.case, &of.name);
            found.iter().any(|(one, _)| same(one) && one.role.is_found())
        };
        let counts = |one: &DesignDevices| one.role.is_found() || !is_found(one);
        let names: Vec<String> = found.iter().map(|(one, _)| result_name(one)).collect();
        let rows = found.iter().enumerate().filter(|(_, (one, _))| counts(one));
        let mut rows: Vec<(&str, usize)> = rows.map(|(row, _)| (names[row].as_str(), row)).collect();
        // The best design of a target is the last one, which counts.
        let rank = |row: usize| found[row].1.rank();
        rows.sort_by(|one, other| {
            rank(one.1)
                .partial_cmp(&rank(other.1))
                .unwrap_or(std::cmp::Ordering::Equal)
        });
        let all = |value: fn(&Yield) -> Option<f64>| -> Vec<f64> {
            let value = |(_, result): &(DesignDevices, Yield)| value(result).unwrap_or(f64::NAN);
            found.iter().map(value).collect()
        };
        let columns = [
            ("yield", all(|result| result.reached.map(|reached| reached.value))),
            ("mean", all(|result| result.mean.map(|mean| mean.value))),
            (
                "deviation",
                all(|result| result.deviation.map(|deviation| deviation.value)),
            ),
            (
                "failed",
                all(|result| Some(result.failed() as f64 / result.samples as f64)),
            ),
        ];
        let columns = columns.each_ref().map(|(name, values)| (*name, &values[..]));
        let mut results = of_targets(&rows, &columns);
        results.retain(|(_, value)| value.is_finite());
        Ok(results)
    }

    fn as_written(&self, both: [&Canonical; 2]) -> [Canonical; 2] {
        both.map(|parameters| {
            let mut written = parameters.clone();
            scene::in_percent(&mut written, &["wanted"]);
            scene::write_tolerances(&mut written, &["tolerances"]);
            written
        })
    }

    fn scene_parameters(&self, stage: &Node) -> Vec<String> {
        match stage.peek("tolerances") {
            None => vec!["tolerances".to_owned()],
            Some(_) => Vec::new(),
        }
    }

    fn needs(&self) -> Needs {
        Needs::new(&["design", patterns::NAME], 1, 1000)
    }

    fn reads_scene(&self) -> bool {
        true
    }

    fn schema(&self) -> Vec<Fields> {
        vec![YieldParameters::fields()]
    }

    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        needed::no_edges_within_cells(stage, needs)?;
        let own = needed::count(needs, &[patterns::NAME]);
        if own > 1 {
            let message = format!("`needs` names {own} stages of kind `patterns`, whose patterns have the same names");
            return Err(needed::wrong_number(
                stage,
                message,
                "name one of them; it may read several files",
            ));
        }
        let point = stage.node.peek("point");
        if own > 0 && point.is_none() {
            return Err(stage
                .node
                .error("a yield of patterns needs a `point`")
                .help("add the displacement that counts: `point: [25 mm, 25 mm], direction: 0 deg`"));
        }
        let designs = needs.iter().filter(|need| need.kind == "design").map(design::planned);
        let designs = designs.collect::<Result<Vec<_>, _>>()?.concat();
        if point.is_none() {
            for design in &designs {
                let why = format!("of the design `{}` of stage `{}`", design.target, design.stage);
                check_response(design.response, design.is_reaction, &why)
                    .map_err(|(message, help)| needed::named(stage, &design.stage).error(message).help(help))?;
            }
        }
        let node = stage.node.peek("needs").unwrap_or(stage.node);
        PlannedDesign::check_comparable(&designs, node)?;
        Ok(drive_check::check_simulations(stage))
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let parameters = YieldParameters::read_with(stage, &["kind", "needs"])?;
        let node = |key: &str| stage.peek(key).unwrap_or(stage);
        let of_scene = scene.map(Tolerances::of_scene).transpose()?.flatten();
        let tolerances = parameters.tolerances.clone().or(of_scene);
        let scene = scene::read_all_states(stage, scene)?.simulated();
        let tolerances = tolerances.ok_or_else(|| stage.error(ToleranceError::None.to_string()))?;
        for (_, state) in scene.in_states() {
            // What `effects: auto` turns on is not known yet.
            let checked = check_tolerances(&state, &tolerances);
            checked.map_err(|error| node("tolerances").error(error.to_string()))?;
        }
        if let Some(objective) = parameters.objective() {
            let goal = objective.and_then(|objective| goal(&objective, &scene));
            goal.map_err(|error| node("point").error(error))?;
        }
        let stage = YieldStage {
            parameters,
            tolerances,
            scene,
            batches: Vec::new(),
            ready: OnceLock::new(),
        };
        Ok(Box::new(YieldStage {
            batches: stage.planned(),
            ..stage
        }))
    }
}

/// Refuses objectives that are not displacements of equilibria: a message and its help.
fn check_response(response: ResponseKind, is_reaction: bool, whose: &str) -> Result<(), (String, &'static str)> {
    let what = match response {
        ResponseKind::Equilibrium if !is_reaction => return Ok(()),
        ResponseKind::Equilibrium => "a force",
        ResponseKind::After(_) => "a displacement at a time",
        ResponseKind::Amplitude(_) => "an amplitude",
    };
    let message = format!("the objective {whose} is {what}, and yields are those of displacements of equilibria");
    Err((message, "give the yield stage a `point` and a `direction`"))
}

struct YieldStage {
    parameters: YieldParameters,
    tolerances: Tolerances,
    scene: Scene,
    /// The devices of each batch, and the parameters of its key.
    batches: Vec<(Range<u64>, Canonical)>,
    /// Set up by the first batch for all batches.
    ready: OnceLock<Ready>,
}

struct Ready {
    study: Study,
    /// The simulated effects.
    effects: Effects,
}

/// A pattern with its label and goal.
struct Case {
    case: String,
    name: String,
    role: Role,
    member: u64,
    units: u64,
    pattern: Pattern,
    objective: String,
    goal: Goal,
}

impl YieldStage {
    /// All that a batch depends on but its devices.
    fn common(&self) -> impl Iterator<Item = (&'static str, Canonical)> {
        let point = [
            ("point", self.parameters.point.canonical()),
            ("direction", self.parameters.direction.canonical()),
        ];
        let point = point.into_iter().filter_map(|(key, value)| Some((key, value?)));
        let always = [
            ("scene", self.scene.canonical()),
            ("tolerances", self.tolerances.to_canonical()),
            ("elements_per_cell", (self.parameters.elements_per_cell as u64).into()),
            ("order", self.parameters.order.into()),
            ("seed", self.parameters.seed.0.into()),
        ];
        always.into_iter().chain(point)
    }

    /// Returns the devices of each batch, and the parameters of its key.
    fn planned(&self) -> Vec<(Range<u64>, Canonical)> {
        let (samples, common) = (self.parameters.samples, self.common().collect::<Vec<_>>());
        let batch = |first: u64| {
            let batch = first..(first + BATCH).min(samples);
            let devices = [("first", first.into()), ("devices", (batch.end - first).into())];
            (batch, Canonical::map(common.iter().cloned().chain(devices)))
        };
        (0..samples).step_by(BATCH as usize).map(batch).collect()
    }

    fn ready(&self) -> Result<&Ready, StageError> {
        if let Some(ready) = self.ready.get() {
            return Ok(ready);
        }
        let states = resolved_states(&self.scene).map_err(StageError::failed)?;
        let effects = states
            .first()
            .map_or_else(Effects::default, |state| state.effects.clone());
        let (options, seed) = (self.parameters.options(), self.parameters.seed.0);
        let study = Study::new(states, self.tolerances.clone(), options, WorkLimit::default(), seed);
        let study = study.map_err(StageError::input)?;
        Ok(self.ready.get_or_init(|| Ready { study, effects }))
    }

    /// Returns the patterns of an input.
    fn cases(&self, input: &Artifact) -> Result<Vec<Case>, StageError> {
        let wrong = |why: String| StageError::in_artifact(input, why);
        match self.parameters.objective() {
            Some(objective) => {
                let objective = objective.map_err(StageError::input)?;
                let goal = goal(&objective, &self.scene).map_err(StageError::input)?;
                let text = objective.to_text();
                cases(input, |_| Ok((text.clone(), goal.clone())))
            }
            None => cases(input, |text| {
                let found = design::stored_objective(text).and_then(|objective| goal(&objective, &self.scene));
                Ok((text.to_owned(), found.map_err(wrong)?))
            }),
        }
    }
}

/// Returns the goal of an objective in all states of a scene.
fn goal(objective: &Objective, scene: &Scene) -> Result<Goal, String> {
    objective.goal(scene, None, 0.0).map_err(|error| error.to_string())
}

/// Reads the patterns of an input, each once for each target, with the goal that `goal` returns for its objective.
fn cases(input: &Artifact, goal: impl Fn(&str) -> Result<(String, Goal), StageError>) -> Result<Vec<Case>, StageError> {
    let mut found: Vec<Case> = Vec::new();
    if ArtifactKind::Design.is_of(input) {
        let rows = Designs::open(input)?.rows().read()?;
        for row in 0..rows.len() {
            let is_repeated = |one: &Case| {
                (&one.case, &one.name, one.role) == (&rows.case[row], &rows.name[row], rows.role[row])
                    && one.pattern == rows.patterns[row]
            };
            if found.iter().any(is_repeated) {
                continue;
            }
            let (objective, goal) = goal(&rows.objective.0[row])?;
            found.push(Case {
                case: rows.case[row].clone(),
                name: rows.name[row].clone(),
                role: rows.role[row],
                member: rows.member[row],
                units: rows.units[row],
                pattern: rows.patterns[row].clone(),
                objective,
                goal,
            });
        }
        return Ok(found);
    }
    let rows = Samples::open(input)?.rows().read()?;
    for (pattern, index) in rows.patterns.into_iter().zip(rows.index) {
        let (objective, goal) = goal("")?;
        found.push(Case {
            case: String::new(),
            name: (index + 1).to_string(),
            role: Role::Own,
            member: 0,
            units: 0,
            pattern,
            objective,
            goal,
        });
    }
    Ok(found)
}

impl Stage for YieldStage {
    fn parameters(&self) -> Canonical {
        let own = [("samples", self.parameters.samples.into())];
        let wanted = self.parameters.wanted.canonical().map(|wanted| ("wanted", wanted));
        Canonical::map(self.common().chain(own).chain(wanted))
    }

    fn weight(&self) -> f64 {
        self.parameters.options().mesh.weight()
    }

    fn revision(&self) -> u32 {
        self.scene.body_revision()
    }

    fn unit(&self) -> &'static str {
        "devices"
    }

    fn plan(&self, inputs: &[Input]) -> Plan {
        let parts = inputs.iter().flat_map(|input| &input.parts);
        let chunks = |(digest, _): &(Option<_>, u64)| {
            let chunk = |(batch, parameters): &(Range<u64>, Canonical)| Chunk {
                parameters: parameters.clone(),
                inputs: vec![*digest],
                samples: batch.end - batch.start,
            };
            self.batches.iter().map(chunk).collect::<Vec<_>>()
        };
        Plan::Chunks(parts.flat_map(chunks).collect())
    }

    fn pieces(&self, inputs: u64) -> u64 {
        inputs * self.batches.len() as u64
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let own = |chunk: &Chunk| {
            self.batches
                .iter()
                .find(|(_, parameters)| *parameters == chunk.parameters)
        };
        let (batch, _) = job
            .chunk
            .and_then(own)
            .ok_or_else(|| StageError::failed("the batch is not one of this stage's"))?;
        let [input] = job.inputs else {
            return Err(StageError::failed(
                "a batch of a yield stage reads one part of an input",
            ));
        };
        let Ready { study, effects } = self.ready()?;
        let cases = self.cases(input)?;
        let range = batch.start as u32..batch.end as u32;
        let mut found = Yields {
            batches: DeviceBatches::default(),
            outcome: Vec::new(),
            displacement: Vec::new(),
            deviations: Vec::new(),
            scene: self.scene.clone(),
            effects: Some(effects.clone()),
            tolerances: self.tolerances.clone(),
            wanted: None,
            wanted_share: None,
        };
        // A step is a device of all patterns.
        let simulated = AtomicU64::new(0);
        let done = || {
            let simulated = simulated.fetch_add(1, Ordering::Relaxed) + 1;
            if simulated.is_multiple_of(cases.len() as u64) {
                job.progress.advance(1);
            }
        };
        for case in &cases {
            study.check(&case.pattern).map_err(StageError::input)?;
            let value = |fields: &[Field]| case.goal.value_mm(fields);
            let drawn = study.nominal(&case.pattern).map_err(StageError::failed)?;
            let drawn = drawn.map(|fields| value(&fields));
            let devices = study.devices(&case.pattern, range.clone(), value, done);
            let devices = devices.map_err(StageError::input)?;
            found.batches.case.push(case.case.clone());
            found.batches.name.push(case.name.clone());
            found.batches.role.push(case.role);
            found.batches.member.push(case.member);
            found.batches.units.push(case.units);
            found.batches.patterns.push(case.pattern.clone());
            found.batches.objective.0.push(case.objective.clone());
            found.batches.devices.push(devices.len() as u64);
            let word = drawn.map_or_else(Failure::name, |_| CONVERGED);
            found.batches.drawn_outcome.push(word.to_owned());
            found.batches.drawn.push(drawn.unwrap_or_default());
            for device in devices {
                found.outcome.push(device.outcome().to_owned());
                found.displacement.push(device.value.unwrap_or_default());
                found.deviations.push(device.deviations);
            }
        }
        Ok(found.object())
    }

    fn attributes(&self) -> Vec<(String, String)> {
        let wanted = self.parameters.wanted.map(|wanted| match wanted {
            Wanted::Length(length) => ("wanted_mm".to_owned(), length.value().to_string()),
            Wanted::Share(share) => ("wanted_share".to_owned(), share.to_f64().to_string()),
        });
        let always = [
            ("scene".to_owned(), self.scene.to_text()),
            ("tolerances".to_owned(), self.tolerances.to_text()),
        ];
        always.into_iter().chain(wanted).collect()
    }

    // Devices that fail are a result; a pattern that has no stable state as drawn is not one of a design.
    fn unstable(&self, artifact: &Artifact) -> Result<u64, StageError> {
        let found = Yields::open(artifact)?.designs()?;
        Ok(found.iter().filter(|one| one.drawn.is_none()).count() as u64)
    }
}

/// Returns the name of a target in results: that of the case, if a single objective has no name of its own.
fn result_name(design: &DesignDevices) -> String {
    match (design.case.as_str(), design.name.as_str()) {
        ("", name) => name.to_owned(),
        (case, SINGLE_NAME) => case.to_owned(),
        (case, name) => format!("{case} {name}"),
    }
}

/// Returns the designs of an artifact and what their devices do.
fn yields_of(artifact: &Artifact) -> Result<Vec<(DesignDevices, Yield)>, StageError> {
    let view = Yields::open(artifact)?;
    let varying = Source::varying(&view.tolerances().read()?);
    let wanted = Wanted::of_stored(view.wanted().read()?, view.wanted_share().read()?);
    let of_one = |design: DesignDevices| {
        let devices = Device::of_rows(&design.outcome, &design.displacement, &design.deviations);
        let devices = devices.ok_or_else(|| StageError::in_artifact(artifact, "its devices have unknown outcomes"))?;
        let wanted = wanted.and_then(|wanted| wanted.in_mm(design.drawn));
        let result = Yield::of(&devices, &varying, wanted);
        Ok((design, result))
    };
    view.designs()?.into_iter().map(of_one).collect()
}
