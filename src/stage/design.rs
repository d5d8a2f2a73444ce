//! `kind: design` searches patterns that move points where they should go: by the genetic algorithm, judged by a network, an
//! estimate or Newton's method, whichever is the cheapest that is accurate enough unless one is named, and finished along the
//! gradient where that is asked for; or along the gradient alone, for how good a design can be.

mod content;
mod evaluators;
mod intervals;
mod planned;

use std::cell::Cell;
use std::sync::OnceLock;
use std::time::Instant;

use serde_json::json;

use super::results::of_targets;
use super::{drive_check, model, scene};
use deaflow_base::{
    Canonical, Declared, Fields, InputError, Map, Node, NodeValue, Parameter, Schema, Stopped, parameters,
};
use deaflow_content::Designs;
use deaflow_design::{
    ConstraintParameters, Elements, GenerationReport, Method, Moment, Progress, Search, SearchError, SearchOptions,
    SearchStep, StateError, Subject, Target, Targets, Watch,
};
use deaflow_fem::Method as Evaluation;
use deaflow_fem::screening::resolved_states;
use deaflow_fem::{
    GradientEvaluator, SafetyMargins, SetupError, Swing, ThreeSolves, at_peak, breakdown_strength, revision_of,
};
use deaflow_field::{Differentiable, Feasibility, InStates, PredictError, StateFields};
use deaflow_orchestrator::{Chunk, Input, Job, Kind, Needs, Plan, Stage, StageCheck, StageDeclaration, StageError};
use deaflow_pattern::{Part, Pattern, Symmetries};
use deaflow_scene::{MOST_STATES, Scene};
use deaflow_store::{Artifact, Object};
use deaflow_surrogate::Surrogate;

use content::Heading;
pub(super) use evaluators::swing_of;
use evaluators::{EvaluatorChoice, evaluators, of_swings};
use intervals::Calibrated;
pub(super) use planned::PlannedDesign;

/// The kind `design`.
pub struct DesignKind;

parameters! {
    /// Searches patterns that move points where they should go.
    struct DesignParameters as "a design stage" {
        /// A label for tables.
        case: Option<Case>,
        /// What judges patterns: the network, an estimate, Newton's method, or of these the cheapest that is accurate enough.
        evaluator: EvaluatorChoice = EvaluatorChoice::Auto,
    }
    include {
        /// What is designed.
        targets: Targets,
        /// How it is searched.
        options: SearchOptions,
    }
    rules(rules)
    check(DesignParameters::check)
}

/// Constraints are read for the membrane of the scene; a named network must be there.
fn rules(fields: Fields) -> Fields {
    let is = |key: &str, word: &str| json!({ "required": [key], "properties": { key: { "const": word } } });
    fields
        .optional("constraints", ConstraintParameters::schema())
        .rule(json!({ "if": is("evaluator", "surrogate"), "then": { "required": ["needs"] } }))
        .rule(json!({ "if": is("method", "adjoint"), "then": { "not": { "required": ["needs"] } } }))
}

impl DesignParameters {
    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        let network = map.optional("needs");
        if self.evaluator == EvaluatorChoice::Surrogate && network.is_none() {
            return Err(map
                .error("`evaluator: surrogate` needs a network: add a train stage to `needs`")
                .help("add `needs: [STAGE]` with a stage of kind `train`, or take another evaluator"));
        }
        match network.filter(|_| self.options.method == Method::Adjoint) {
            Some(node) => Err(node
                .error("`method: adjoint` uses finite elements only; remove the network from `needs`")
                .help("leave `needs` out")),
            None => Ok(()),
        }
    }
}

/// A label on one line.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Case(String);

impl Parameter for Case {
    type Limits = ();
    type Literal = &'static str;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let label = node.text(key)?;
        // Text in artifacts is as short as that in bytes.
        match label.len() {
            1..=60 if !label.contains('\n') && matches!(node.value(), NodeValue::Text(_)) => Ok(Self(label.to_owned())),
            _ => Err(node
                .error(format!("`{key}` is not a valid label"))
                .help("allowed: 1 to 60 letters on one line; a number in quotes")),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        Some(self.0.as_str().into())
    }

    fn schema((): &()) -> Schema {
        Schema::matching("^[^\\n]{1,60}$")
    }

    fn literal(literal: &'static str) -> Self {
        Self(literal.to_owned())
    }
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

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let view = Designs::open(artifact)?;
        let rows = view.rows();
        let (names, roles) = (rows.name().read()?, rows.role().read()?);
        let found = names
            .iter()
            .zip(&roles)
            .enumerate()
            .filter(|(_, (_, role))| role.is_found());
        let found: Vec<(&str, usize)> = found.map(|(row, (name, _))| (name.as_str(), row)).collect();
        Ok(of_targets(
            &found,
            &[("predicted", &view.value().read()?), ("area", &rows.area().read()?)],
        ))
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
        let fields = all.filter_map(|of| of.peek("objective")?.peek("field")?.text("field").ok());
        fields.map(str::to_owned).collect()
    }

    fn schema(&self) -> Vec<Fields> {
        vec![DesignParameters::fields()]
    }

    fn check(&self, stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<StageCheck, InputError> {
        let map = stage.node.fields(DesignParameters::WHAT, &keys())?;
        let parameters = DesignParameters::read_map(&map)?;
        let (mut warnings, mut expectations) = (Vec::new(), Vec::new());
        warnings.extend(drive_check::stability_warning(stage));
        let asked = map.optional("evaluator_accuracy");
        let evaluator = parameters.evaluator;
        if asked.is_some() && evaluator != EvaluatorChoice::Auto {
            let accuracy = &parameters.options.evaluator_accuracy;
            warnings.push(format!(
                "`evaluator_accuracy: {accuracy}` is not looked at, since `evaluator: {evaluator}` is named, however much it errs; \
                 `evaluator: auto` takes the cheapest that keeps to it"
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
        let scene = scene::read_all_states(stage, scene)?;
        let DesignParameters {
            case,
            evaluator,
            targets,
            options,
        } = DesignParameters::read_map(&map)?;
        let constraints = constraints_of(&map, stage, &scene)?;
        let targets = targets.in_scene(&map, &scene, options.area_penalty.to_f64())?;
        for target in &targets {
            let node = map.optional("objective").unwrap_or(stage);
            refuse_held_points(target, &scene, node)?;
            refuse_moment(target, &scene, node)?;
            if let Moment::Swing(_) = target.objective.moment() {
                refuse_evaluator_of_swing(&map, evaluator)?;
            }
        }
        for area in targets.iter().filter_map(|target| target.area.fraction()) {
            let node = map.optional("area").or(map.optional("constraints")).unwrap_or(stage);
            constraints.check_area(node, area, options.area_tolerance.to_f64())?;
        }
        Ok(Box::new(DesignStage {
            case,
            options,
            evaluator,
            ready: targets.iter().map(|_| OnceLock::new()).collect(),
            scene: decisive(&scene, &targets, &constraints),
            targets,
            in_time: scene,
            constraints,
        }))
    }
}

/// The keys of a design stage.
fn keys() -> Vec<&'static str> {
    [&["kind", "needs", "constraints"][..], &DesignParameters::keys()].concat()
}

/// The designs that a stage is to search.
///
/// # Errors
/// When its mapping cannot be read.
pub(super) fn planned(stage: &StageDeclaration<'_>) -> Result<Vec<PlannedDesign>, InputError> {
    let map = stage.node.fields(DesignParameters::WHAT, &keys())?;
    let scene = scene::read_all_states(stage.node, stage.scene)?;
    let DesignParameters {
        case, targets, options, ..
    } = DesignParameters::read_map(&map)?;
    let constraints = constraints_of(&map, stage.node, &scene)?.to_text();
    let targets = targets.in_scene(&map, &scene, options.area_penalty.to_f64())?;
    let planned = targets.into_iter().map(|target| PlannedDesign {
        stage: stage.name.to_owned(),
        case: case.as_ref().map_or_else(String::new, |case| case.0.clone()),
        target: target.name,
        objective: target.objective.to_text(),
        moment: target.objective.moment(),
        area: target.area.to_string(),
        constraints: constraints.clone(),
        method: options.method,
        units: options.units,
    });
    Ok(planned.collect())
}

/// The constraints of a stage; none asked where it has none.
fn constraints_of(map: &Map<'_>, stage: &Node, scene: &Scene) -> Result<ConstraintParameters, InputError> {
    match map.optional("constraints") {
        Some(node) => read_constraints(node, scene),
        None => ConstraintParameters::none_in(scene).map_err(|e| stage.error(e.to_string())),
    }
}

/// Refuses a target with a point on a frame, where nothing moves.
fn refuse_held_points(target: &Target, scene: &Scene, node: &Node) -> Result<(), InputError> {
    let Some(parts) = scene.parts() else { return Ok(()) };
    let sides = parts.raster().sides();
    let cell = |point: [f64; 2]| [0, 1].map(|axis| (point[axis] as usize).min(sides[axis] - 1));
    let points = target.goal.aims().iter().filter(|aim| aim.subject == Subject::Point);
    let mut cells = points.map(|aim| cell(aim.point));
    match cells.find(|[x, y]| parts.at(*x, *y) == Part::Frame) {
        None => Ok(()),
        Some([x, y]) => Err(node.error(format!(
            "a point of `{}` is on the frame, in cell [{x}, {y}], which does not move",
            target.name
        ))),
    }
}

/// Refuses a target at a time in a scene that does not creep as three equilibria tell, or an amplitude where nothing swings.
fn refuse_moment(target: &Target, scene: &Scene, node: &Node) -> Result<(), InputError> {
    let name = &target.name;
    match target.objective.moment() {
        _ if scene.auto => Ok(()),
        Moment::Equilibrium => Ok(()),
        Moment::After(time) => ThreeSolves::new(scene, time.value())
            .map(|_| ())
            .map_err(|e| node.error(format!("`{name}` is meant after {time}: {e}"))),
        Moment::Swing(frequency) => {
            Swing::check(scene).map_err(|e| node.error(format!("`{name}` is meant at {frequency}: {e}")))
        }
    }
}

/// Refuses what judges no amplitudes: there is no estimate and no network of them.
fn refuse_evaluator_of_swing(map: &Map<'_>, evaluator: EvaluatorChoice) -> Result<(), InputError> {
    let network = map.optional("needs");
    let network = network.map(|node| (node, "a network knows no amplitudes".to_owned(), "leave `needs` out"));
    let other = match evaluator {
        EvaluatorChoice::Auto | EvaluatorChoice::Elements(Evaluation::Newton) => None,
        other => map.optional("evaluator").map(|node| {
            let message = format!("`evaluator: {other}` cannot predict amplitudes");
            (node, message, "allowed: auto, newton")
        }),
    };
    match network.or(other) {
        None => Ok(()),
        Some((node, message, help)) => Err(node
            .error(format!("{message}, and a target has a `frequency`"))
            .help(help)),
    }
}

/// The parts of the scene that decide about designs: a margin from breakdown needs a property that no simulation uses, and an amplitude the
/// voltage about which the drive swings.
fn decisive(scene: &Scene, targets: &[Target], constraints: &ConstraintParameters) -> Scene {
    let swings = |target: &Target| matches!(target.objective.moment(), Moment::Swing(_));
    let mut decisive = match targets.iter().any(swings) {
        true => scene.simulated_about_bias(),
        false => scene.simulated(),
    };
    if constraints.constraints().limits().breakdown_margin.is_some() {
        let strength = &scene.properties.dielectric_breakdown;
        decisive.properties.dielectric_breakdown.clone_from(strength);
    }
    decisive
}

/// Constraints on patterns of a scene, whose breakdown strength must be known where a margin from it is asked for.
fn read_constraints(node: &Node, scene: &Scene) -> Result<ConstraintParameters, InputError> {
    let constraints = ConstraintParameters::read(node, scene)?;
    let margin = constraints.constraints().limits().breakdown_margin;
    if margin.is_some() && breakdown_strength(scene).is_none() {
        let at = node.peek("breakdown_margin").unwrap_or(node);
        return Err(at
            .error(
                "`breakdown_margin` needs the breakdown strength of the elastomer: add it to `properties` of the scene",
            )
            .help("add `dielectric_breakdown` to the scene's `properties`"));
    }
    Ok(constraints)
}

struct DesignStage {
    case: Option<Case>,
    targets: Vec<Target>,
    constraints: ConstraintParameters,
    options: SearchOptions,
    evaluator: EvaluatorChoice,
    scene: Scene,
    /// The same with what its drive says of time.
    in_time: Scene,
    /// Of each target, set up where it is the first that needs it, for all at its time.
    ready: Vec<OnceLock<Ready>>,
}

/// The stage while it designs a target.
struct ForTarget<'a> {
    stage: &'a DesignStage,
    target: &'a Target,
}

/// Finite elements in each state of the device: for the gradient, and for margins where they are asked for.
struct Ready {
    gradient: InStates<Box<dyn Differentiable + Send>>,
    margins: Vec<SafetyMargins>,
}

impl Feasibility for Ready {
    /// Margins are kept in every state.
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
    /// Everything but the targets.
    fn common(&self) -> Canonical {
        let mut entries = self.options.used();
        if self.evaluator != EvaluatorChoice::Auto {
            entries.retain(|(key, _)| *key != "evaluator_accuracy");
        }
        if self.options.method == Method::Ga {
            entries.extend(self.evaluator.canonical().map(|evaluator| ("evaluator", evaluator)));
        }
        entries.extend(self.case.canonical().map(|case| ("case", case)));
        if self.constraints.constraints().limits().pull_in_margin.is_some() {
            // Kept on every mesh, which designs of one mesh alone did not promise.
            entries.push(("pull_in_meshes", 2_u64.into()));
        }
        let constraints = self.constraints.constraints();
        let is_square = self.scene.symmetries() == Symmetries::SQUARE && constraints.room().is_none();
        if !(is_square && constraints.is_free() && constraints.groups() == 1) {
            // Areas were given up that can be had, groups that do nothing were kept, and designs were told apart by the symmetries of the square.
            entries.push(("devices", 2_u64.into()));
        }
        entries.extend([
            ("constraints", self.constraints.canonical()),
            ("scene", self.scene.canonical()),
        ]);
        Canonical::map(entries)
    }

    /// The length of the progress bar of a target: the first generation is none of those that were asked for.
    fn steps(&self) -> u64 {
        let all = self.options.steps();
        match self.options.method {
            Method::Ga if self.options.generations > 0 => all - 1,
            _ => all,
        }
    }

    fn chunk(&self, target: &Target) -> Canonical {
        Canonical::map([("stage", self.common()), ("target", target.canonical())])
    }

    fn ready(&self, target: &Target) -> Result<&Ready, SearchError> {
        let moment = target.objective.moment();
        let is_alike = |other: &Target| match moment {
            Moment::Swing(_) => other.objective == target.objective,
            Moment::Equilibrium | Moment::After(_) => other.objective.moment() == moment,
        };
        let place = self.targets.iter().zip(&self.ready).find(|(of, _)| is_alike(of));
        let (_, place) = place.ok_or_else(|| SearchError::Setup("the stage has no such target".into()))?;
        if let Some(ready) = place.get() {
            return Ok(ready);
        }
        let limits = self.constraints.constraints().limits();
        let ready = || -> Result<Ready, SetupError> {
            let (mut gradient, mut margins) = (Vec::new(), Vec::new());
            for scene in resolved_states(&self.scene)? {
                gradient.push(match moment {
                    Moment::Equilibrium => Box::new(GradientEvaluator::new(&scene)?) as Box<dyn Differentiable + Send>,
                    Moment::After(time) => Box::new(ThreeSolves::new(&scene, time.value())?.gradient(&scene)?),
                    Moment::Swing(frequency) => Box::new(swing_of(&scene, frequency, &target.goal, &of_swings())?),
                });
                let strongest = match moment {
                    Moment::Swing(_) => at_peak(&scene),
                    Moment::Equilibrium | Moment::After(_) => scene,
                };
                margins.extend(SafetyMargins::new(
                    &strongest,
                    limits.pull_in_margin,
                    limits.breakdown_margin,
                )?);
            }
            Ok(Ready {
                gradient: InStates::new(gradient),
                margins,
            })
        };
        let ready = ready().map_err(|e| SearchError::Setup(e.into()))?;
        Ok(place.get_or_init(|| ready))
    }

    /// The scene that a target is designed in.
    fn scene_of(&self, target: &Target) -> Scene {
        match target.objective.moment() {
            Moment::Equilibrium | Moment::Swing(_) => self.scene.clone(),
            Moment::After(time) => self.in_time.simulated_until(time),
        }
    }

    /// The networks among the inputs, one for each state of the device; none where there are none.
    fn networks(&self, inputs: &[Artifact], scene: &Scene) -> Result<Option<Vec<Surrogate>>, StageError> {
        let models: Vec<&Artifact> = inputs.iter().filter(|input| model::is_in(input)).collect();
        match &models[..] {
            [] if self.evaluator == EvaluatorChoice::Surrogate => Err(StageError::input(
                "`evaluator: surrogate` judges by a network, and `needs` names no stage of kind `train`",
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
            constraints: self.constraints.to_text(),
        }
    }
}

impl Elements for ForTarget<'_> {
    fn gradient(&self) -> Result<&dyn Differentiable<StateFields>, SearchError> {
        Ok(&self.stage.ready(self.target)?.gradient)
    }

    fn settings(&self) -> String {
        let method = match self.target.objective.moment() {
            Moment::Swing(_) => return of_swings().settings_in_time("response"),
            Moment::Equilibrium => "newton",
            // A field at a time follows from three equilibria.
            Moment::After(_) => "creep:3",
        };
        format!("method: {method}, elements_per_cell: 1, order: 2")
    }

    fn feasibility(&self) -> Result<Option<&dyn Feasibility>, SearchError> {
        let ready = self.stage.ready(self.target)?;
        Ok((!ready.margins.is_empty()).then_some(ready as &dyn Feasibility))
    }
}

impl Stage for DesignStage {
    fn parameters(&self) -> Canonical {
        let targets = Canonical::List(self.targets.iter().map(Target::canonical).collect());
        Canonical::map([("stage", self.common()), ("targets", targets)])
    }

    fn weight(&self) -> f64 {
        self.options.weight()
    }

    fn revision(&self) -> u32 {
        revision_of(&self.scene)
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
        Plan::Chunks(self.targets.iter().map(chunk).collect())
    }

    fn pieces(&self, _inputs: u64) -> u64 {
        self.targets.len() as u64
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let wanted = job.chunk.map(|chunk| &chunk.parameters);
        let target = self.targets.iter().find(|target| Some(&self.chunk(target)) == wanted);
        let target = target.ok_or_else(|| StageError::failed("a chunk of a design stage has one target"))?;
        let start = Instant::now();
        let scene = self.scene_of(target);
        let moment = target.objective.moment();
        let networks = self.networks(job.inputs, &scene)?;
        let calibrated = Calibrated::of(job.inputs, &scene)?;
        let drivers: Vec<u8> = self
            .scene
            .in_states()
            .iter()
            .map(|(_, scene)| scene.strongest_group())
            .collect();
        let search = Search {
            target,
            constraints: self.constraints.constraints(),
            options: &self.options,
            drivers: &drivers,
            elements: &ForTarget { stage: self, target },
            progress: &Follow::new(job, self.options.generations),
        };
        let found = search.run(|| evaluators(self.evaluator, &scene, (moment, &target.goal), networks));
        let found = found.map_err(|error| match error {
            SearchError::Stopped(stopped) => stopped.into(),
            error if error.is_of_stability() => StageError::Advised {
                source: error.into(),
                help: drive_check::stability_advice(&scene),
            },
            error => StageError::failed(error),
        })?;
        job.measure(format!("search; {}", target.name), start.elapsed().as_secs_f64());
        let method = self.options.method.name();
        let mut designs = content::designs(self.heading(target), found, self.scene.clone(), method);
        if let Some(calibrated) = calibrated {
            let intervals = calibrated.intervals(&target.goal, &designs.rows.patterns)?;
            designs.rows.interval = Some(intervals);
        }
        Ok(designs.object())
    }

    fn attributes(&self) -> Vec<(String, String)> {
        vec![
            ("scene".to_owned(), self.scene.to_text()),
            ("method".to_owned(), self.options.method.name().to_owned()),
        ]
    }
}

/// Follows a search: reports its progress, and keeps the state from which it can be resumed.
struct Follow<'a> {
    job: &'a Job<'a>,
    /// Which part of its step the first generation is, which is none of those that were asked for: half of the one after it, if there is one.
    first: f64,
    /// Where the generation under way begins within its step, and which part of the step it is.
    generation: Cell<(f64, f64)>,
    /// Steps along the gradient in the local search under way, and in those that are over with how many these are.
    steps: Cell<u32>,
    over: Cell<(u32, u32)>,
}

/// Steps that a local search takes, before any is known.
const USUAL_STEPS: f64 = 20.0;

impl<'a> Follow<'a> {
    fn new(job: &'a Job<'a>, generations: usize) -> Self {
        let first = if generations == 0 { 1.0 } else { 0.5 };
        Self {
            job,
            first,
            generation: Cell::new((0.0, first)),
            steps: Cell::default(),
            over: Cell::default(),
        }
    }

    /// Which part of the local search under way is done, as far as others tell: nothing says when it ends.
    fn part(&self) -> f64 {
        let steps = f64::from(self.steps.get());
        let usual = match self.over.get() {
            (_, 0) => USUAL_STEPS,
            (steps, searches) => f64::from(steps) / f64::from(searches),
        };
        steps / (steps + usual.max(1.0))
    }
}

/// Under which the state of a search is kept.
const STATE: &str = "search";

impl Watch for Follow<'_> {
    fn generation(&self, report: &GenerationReport) {
        let (number, mm, area) = (report.generation, report.value_mm, report.area);
        let note = format!("generation {number}: best {mm:.4} mm at area {area:.3}");
        self.job.progress.note(&note);
        if number == 0 && self.first < 1.0 {
            self.generation.set((self.first, 1.0 - self.first));
            self.job.progress.part(self.first);
        } else {
            self.generation.set((0.0, 1.0));
            self.job.progress.advance(1);
        }
    }

    fn judged(&self, part: f64) {
        let (from, share) = self.generation.get();
        self.job.progress.part(from + share * part);
    }

    fn kept(&self) -> Option<Vec<u8>> {
        self.job.scratch.load(STATE)
    }

    fn keep(&self, state: &dyn Fn() -> Option<Vec<u8>>) -> Result<(), Stopped> {
        self.job.scratch.save(STATE, state)
    }

    fn resumed(&self, report: &GenerationReport) {
        if report.generation == 0 {
            self.generation.set((self.first, 1.0 - self.first));
        } else {
            self.generation.set((0.0, 1.0));
        }
        let is_one_of_none = report.generation == 0 && self.first >= 1.0;
        self.job
            .progress
            .resume(report.generation as u64 + u64::from(is_one_of_none));
    }

    fn unusable(&self, error: &StateError) {
        self.job.scratch.report_unused(&error.to_string());
    }
}

impl Progress for Follow<'_> {
    fn step(&self, step: &SearchStep) {
        let steps = self.steps.get() + 1;
        self.steps.set(steps);
        let note = format!(
            "gradient step {steps}: {:.4} mm at area {:.3}",
            step.value_mm, step.area
        );
        self.job.progress.note(&note);
        self.job.progress.part(self.part());
    }

    fn searched(&self) {
        let (steps, searches) = self.over.get();
        self.over.set((steps + self.steps.replace(0), searches + 1));
        self.job.progress.advance(1);
    }
}
