//! The methods to measure: finite elements (Newton's method, estimates, or to an accuracy) and networks.

use std::sync::Arc;

use super::error::AccuracyError;
use super::network::Network;
use deaflow_base::{Canonical, Dimension, Fields, InputError, Node, NodeValue, Parameter, Quantity, Schema, Time};
use deaflow_fem::screening::resolve;
use deaflow_fem::{
    AccurateSolver, MeshRequest, Method, SolverParameters, StepEstimate, StepEstimates, ThreeSolves, creep_settings,
    history_check,
};
use deaflow_field::{Evaluator, Mesh};
use deaflow_scene::Scene;

/// A method with its settings.
pub enum Candidate {
    /// Finite elements.
    Elements(SolverParameters),
    /// Finite elements with time steps up to the time of the reference.
    InTime(InTime, SolverParameters),
    /// A trained network.
    Network(Network),
}

/// How the state at a time is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InTime {
    /// By all time steps, or by the steps of one pass with an estimate at the end of each.
    Steps,
    /// From three equilibria, or estimates of them.
    ThreeSolves,
}

/// The names of these methods.
const STEPS: &str = "history";
const THREE_SOLVES: &str = "creep:3";

/// The keys of a solve stage that a method may have.
const KEYS: [&str; 4] = ["method", "elements_per_cell", "order", "accuracy"];

impl Candidate {
    /// Reads a list of methods: words (`linear`, `chord:2`, `newton`, with 2 bilinear elements per cell) or mappings
    /// with the keys of a solve stage (`{ method, elements_per_cell, order }`, `{ accuracy }`). If the reference is a
    /// state at a time, `history` computes all steps up to it, `history+linear` or `history+chord:2` estimates the
    /// state at the end of each, and `creep:3`, `creep:3+linear` or `creep:3+chord:2` computes it from three equilibria
    /// or estimates of them.
    ///
    /// # Errors
    /// When the list is empty, contains a method twice, or contains something else.
    pub fn read(node: &Node) -> Result<Vec<Self>, InputError> {
        read_items(node, node.list("methods")?.iter())
    }

    /// Reads a list that may also contain `{ model: FILE.safetensors }` for trained networks, which come last.
    ///
    /// # Errors
    /// As for [`Candidate::read`], or when a file is not a model.
    pub fn read_with_models(node: &Node, more: Vec<Network>) -> Result<Vec<Self>, InputError> {
        let (models, methods): (Vec<&Node>, Vec<&Node>) = node
            .list("methods")?
            .iter()
            .partition(|item| item.peek("model").is_some());
        let mut networks = Vec::new();
        for item in models {
            let map = item.fields("a model", &["model"])?;
            networks.push(Network::read(map.required("a model", "model")?)?);
        }
        networks.extend(more);
        let mut candidates = match (methods.is_empty(), networks.is_empty()) {
            (true, false) => Vec::new(),
            _ => read_items(node, methods.into_iter())?,
        };
        candidates.extend(Self::networks(networks));
        Ok(candidates)
    }

    /// Returns networks as candidates; the settings of equal names include the digest of the model.
    #[must_use]
    pub fn networks(mut networks: Vec<Network>) -> Vec<Self> {
        Network::distinguish(&mut networks);
        networks.into_iter().map(Self::Network).collect()
    }

    /// Returns the schema of [`Candidate::read`].
    #[must_use]
    pub fn schema() -> Schema {
        let settings = Fields::new("A method with its mesh, or an accuracy.");
        let settings = SolverParameters::schema(settings, Mesh::bilinear(2))
            .without("tolerance")
            .without("time_limit")
            .without("history");
        let words = || Schema::any_of([Method::schema(&()), Schema::matching(&in_time_pattern())]);
        let settings = settings.without("method").optional("method", words());
        let list = Schema::list(Schema::any_of([words(), settings.into()]), 1, usize::MAX);
        list.distinct()
            .description("What is measured: words, or mappings with the keys of a solve stage.")
    }

    /// Returns the default list: estimates, Newton's method on meshes of both orders, and accuracies.
    #[must_use]
    pub fn usual() -> Vec<Self> {
        let mesh = |method, mesh: Mesh| Self::Elements(SolverParameters::new(method, mesh));
        let estimates = [
            (Method::Linear, Mesh::bilinear(1)),
            (Method::Linear, Mesh::bilinear(2)),
            (Method::Chord(1), Mesh::bilinear(1)),
            (Method::Chord(1), Mesh::bilinear(2)),
            (Method::Chord(2), Mesh::bilinear(2)),
            (Method::Chord(2), Mesh::biquadratic(1)),
            (Method::Chord(4), Mesh::biquadratic(1)),
        ];
        let bilinear = [1, 2, 4, 8].map(Mesh::bilinear);
        let meshes = bilinear.into_iter().chain([1, 2, 4].map(Mesh::biquadratic));
        // 0.03, 0.01 and 0.003 mm, exactly as if read from a file.
        let accuracies = ["0.03", "0.01", "0.003"];
        let accurate = accuracies
            .iter()
            .filter_map(|mm| Quantity::parse(mm, Dimension::Length).ok())
            .map(|mm| SolverParameters::new(Method::Newton, MeshRequest::Accuracy(mm)));
        let estimates = estimates.into_iter().map(|(method, on)| mesh(method, on));
        let newton = meshes.map(|on| mesh(Method::Newton, on));
        estimates.chain(newton).chain(accurate.map(Self::Elements)).collect()
    }

    /// Returns those of the default list that a scene allows; `time` is that of the reference, if it is a state at a
    /// time.
    #[must_use]
    pub fn usual_in(scene: &Scene, time: Option<Time>) -> Vec<Self> {
        let all = time.map_or_else(Self::usual, |_| Self::usual_in_time());
        let allowed = all.into_iter().filter(|method| method.check_scene(scene, time).is_ok());
        allowed.collect()
    }

    /// Returns the default list for a state at a time: three equilibria and estimates of them, all steps and estimates
    /// of them, and the end of creep.
    fn usual_in_time() -> Vec<Self> {
        let [one, two, square] = [Mesh::bilinear(1), Mesh::bilinear(2), Mesh::biquadratic(1)];
        let of = |how: InTime, method, mesh| Self::InTime(how, SolverParameters::new(method, mesh));
        let estimates = [
            (Method::Linear, one),
            (Method::Chord(1), two),
            (Method::Chord(2), two),
            (Method::Chord(2), square),
        ];
        let estimates = estimates.map(|(method, mesh)| of(InTime::ThreeSolves, method, mesh));
        let three = [one, two, square].map(|mesh| of(InTime::ThreeSolves, Method::Newton, mesh));
        let each_step = [(Method::Linear, one), (Method::Chord(1), one), (Method::Chord(1), two)];
        let each_step = each_step.map(|(method, mesh)| of(InTime::Steps, method, mesh));
        let steps = [one, two, square].map(|mesh| of(InTime::Steps, Method::Newton, mesh));
        let end = Self::Elements(SolverParameters::new(Method::Newton, two));
        let all = estimates.into_iter().chain(three).chain(each_step).chain(steps);
        all.chain([end]).collect()
    }

    /// Returns the settings as keys of a stage, on one line without braces, in at most 64 bytes.
    #[must_use]
    pub fn settings(&self) -> String {
        match self {
            Self::InTime(InTime::Steps, parameters) => parameters.settings_in_time(STEPS),
            Self::InTime(InTime::ThreeSolves, parameters) => creep_settings(parameters),
            Self::Elements(parameters) => parameters.to_string(),
            Self::Network(network) => network.settings(),
        }
    }

    /// Returns the canonical value.
    #[must_use]
    pub fn canonical(&self) -> Canonical {
        match self {
            Self::Elements(parameters) => parameters.canonical([]),
            Self::InTime(InTime::Steps, parameters) => parameters.canonical([("in_time", STEPS.into())]),
            Self::InTime(InTime::ThreeSolves, parameters) => parameters.canonical([("in_time", THREE_SOLVES.into())]),
            Self::Network(network) => network.canonical(),
        }
    }

    /// Returns whether the reference is finer, so that it can measure the errors of this method.
    #[must_use]
    pub fn is_coarser_than(&self, reference: &SolverParameters) -> bool {
        let (Self::Elements(parameters) | Self::InTime(_, parameters)) = self else {
            return true;
        };
        match (parameters.mesh(), reference.mesh()) {
            (Some(own), Some(finest)) => {
                own.order() <= finest.order()
                    && (own.elements_per_cell() < finest.elements_per_cell() || own.order() < finest.order())
            }
            _ => match (parameters.accuracy(), reference.accuracy()) {
                (Some(own), Some(finest)) => own.value() > finest.value(),
                _ => true,
            },
        }
    }

    /// Returns whether its accuracy may need a finer mesh than that of the reference. The error of the reference is
    /// known only once it has been solved.
    pub(super) fn may_be_finer_than(&self, reference: &SolverParameters) -> bool {
        let (Self::Elements(parameters) | Self::InTime(_, parameters)) = self else {
            return false;
        };
        let finest = AccurateSolver::finest_mesh();
        let is_coarser =
            |mesh: Mesh| mesh.order() < finest.order() || mesh.elements_per_cell() < finest.elements_per_cell();
        parameters.accuracy().is_some() && reference.mesh().is_some_and(is_coarser)
    }

    /// Checks whether the method can be used in a scene, without setting it up; `time` is that of the reference, if it
    /// is a state at a time.
    ///
    /// # Errors
    /// When it cannot be used.
    pub fn check_scene(&self, scene: &Scene, time: Option<Time>) -> Result<(), AccuracyError> {
        match self {
            Self::Elements(parameters) => parameters
                .check_method(scene)
                .map_err(|why| AccuracyError::from(why).of(self.settings())),
            Self::InTime(how, parameters) => {
                let checked = check_in_time(*how, parameters, scene, time);
                checked.map_err(|why| why.of(self.settings()))
            }
            Self::Network(network) => {
                let checked = network.surrogate().check_scene(scene);
                checked.map_err(|e| AccuracyError::from(e).of(self.settings()))
            }
        }
    }

    /// Prepares the method for patterns of a scene.
    ///
    /// # Errors
    /// When it does not work in this scene.
    pub(super) fn prepare(&self, scene: &Scene, time: Option<Time>) -> Result<Arc<dyn Evaluator>, AccuracyError> {
        match self {
            Self::InTime(how, parameters) => {
                let time = time.ok_or(AccuracyError::NoTime)?;
                let scene = resolve(scene)?;
                let each_step = |how: StepEstimate| -> Result<Arc<dyn Evaluator>, AccuracyError> {
                    let options = parameters.history_options();
                    let estimates = StepEstimates::new(&scene, &options, how, time.value(), self.settings())?;
                    Ok(Arc::new(estimates))
                };
                match (how, parameters.method()) {
                    (InTime::ThreeSolves, _) => {
                        let rule = ThreeSolves::new(&scene, time.value())?;
                        Ok(Arc::new(rule.evaluator(&scene, parameters)?))
                    }
                    (InTime::Steps, Method::Newton) => Ok(Arc::new(parameters.clone().up_to(time).build(&scene)?)),
                    (InTime::Steps, Method::Linear) => each_step(StepEstimate::Linear),
                    (InTime::Steps, Method::Chord(steps)) => each_step(StepEstimate::Chord(steps)),
                }
            }
            Self::Elements(parameters) => Ok(Arc::new(parameters.build(scene)?)),
            Self::Network(network) => {
                network.surrogate().check_scene(scene)?;
                Ok(network.surrogate().clone())
            }
        }
    }
}

/// Checks whether states at a time can be computed by this method in a scene.
fn check_in_time(
    how: InTime,
    parameters: &SolverParameters,
    scene: &Scene,
    time: Option<Time>,
) -> Result<(), AccuracyError> {
    let time = time.ok_or(AccuracyError::NoTime)?;
    let scene = resolve(scene)?;
    match (how, parameters.method()) {
        (InTime::ThreeSolves, _) => {
            parameters.check_method(&scene)?;
            ThreeSolves::new(&scene, time.value())?;
        }
        (InTime::Steps, Method::Newton) => history_check(&scene)?,
        (InTime::Steps, _) => StepEstimates::check(&scene)?,
    }
    Ok(())
}

fn read_items<'a>(node: &Node, items: impl Iterator<Item = &'a Node>) -> Result<Vec<Candidate>, InputError> {
    let mut candidates: Vec<Candidate> = Vec::new();
    for item in items {
        let candidate = match in_time(item)? {
            Some(candidate) => candidate,
            None => Candidate::Elements(read_elements(item)?),
        };
        let settings = candidate.settings();
        if candidates.iter().any(|other| other.settings() == settings) {
            return Err(item.error(format!("`methods` names {{ {settings} }} twice")));
        }
        candidates.push(candidate);
    }
    if candidates.is_empty() {
        return Err(node
            .error("`methods` is empty")
            .help("for example [linear, chord:1, newton, { accuracy: 0.01 mm }]"));
    }
    Ok(candidates)
}

/// Returns the pattern of methods in time; the estimate follows a `+`.
fn in_time_pattern() -> String {
    format!("^({STEPS}|{THREE_SOLVES})(\\+(linear|chord:\\+?0*([1-9]|[1-4][0-9]|50)))?$")
}

/// Reads a method in time; `None` for another method.
fn in_time(node: &Node) -> Result<Option<Candidate>, InputError> {
    let word = node.peek("method").unwrap_or(node);
    let NodeValue::Text(text) = word.value() else {
        return Ok(None);
    };
    let words = [(STEPS, InTime::Steps), (THREE_SOLVES, InTime::ThreeSolves)];
    let found = words
        .iter()
        .find_map(|(word, how)| Some((*how, text.strip_prefix(word)?)));
    let is_in_time = ["creep", STEPS]
        .iter()
        .any(|start| text.to_lowercase().starts_with(start));
    let is_estimate = |rest: &str| {
        let method = rest.strip_prefix('+').and_then(|method| method.parse().ok());
        method.is_some_and(|method: Method| method != Method::Newton)
    };
    let (how, method) = match found {
        Some((how, "")) => (how, "newton"),
        Some((how, rest)) if is_estimate(rest) => (how, &rest[1..]),
        None if !is_in_time => return Ok(None),
        _ => return Err(unknown_in_time(word, text)),
    };
    let method = word.with_value(NodeValue::Text(method.to_owned()));
    let plain = if std::ptr::eq(word, node) {
        method
    } else {
        let mut plain = node.clone();
        plain.put("method", method);
        plain
    };
    if let Some(accuracy) = node.peek("accuracy") {
        return Err(accuracy
            .error(format!(
                "`accuracy` is not allowed with `method: {text}`, since the mesh is not its only source of error"
            ))
            .help("give a mesh by `elements_per_cell` and `order`"));
    }
    Ok(Some(Candidate::InTime(how, read_elements(&plain)?)))
}

fn unknown_in_time(word: &Node, text: &str) -> InputError {
    word.error(format!("unknown method {text:?}")).help(format!(
        "allowed for a state at a time: {STEPS} and {THREE_SOLVES}, optionally with +linear or +chord:N, N from 1 to \
         50, as in {STEPS}+chord:1; newton, linear and chord:N compute the end of creep"
    ))
}

fn read_elements(node: &Node) -> Result<SolverParameters, InputError> {
    let usual = Mesh::bilinear(2);
    match node.value() {
        NodeValue::Text(_) => Ok(SolverParameters::new(Method::read(node, "method", &())?, usual)),
        _ => SolverParameters::read(&node.fields("a method", &KEYS)?, usual),
    }
}
