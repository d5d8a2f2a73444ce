//! What can be measured: finite elements, by Newton's method, as an estimate or to an accuracy, and networks.

use std::sync::Arc;

use super::error::AccuracyError;
use super::network::Network;
use crate::base::{Canonical, Dimension, Fields, InputError, Node, NodeValue, Parameter, Quantity, Schema};
use crate::fem::{MeshRequest, Method, SolverParameters};
use crate::field::{Evaluator, Mesh};
use crate::scene::Scene;

/// A method with its settings.
pub enum Candidate {
    /// Finite elements.
    Elements(SolverParameters),
    /// A trained network.
    Network(Network),
}

/// The keys of a solve stage that a method may have.
const KEYS: [&str; 4] = ["method", "elements_per_cell", "order", "accuracy"];

impl Candidate {
    /// Reads a list of methods: words (`linear`, `chord:2`, `newton`, with 2 bilinear elements per cell) or mappings with the
    /// keys of a solve stage (`{ method, elements_per_cell, order }`, `{ accuracy }`).
    ///
    /// # Errors
    /// When the list is empty, names a method twice, or has something else in it.
    pub fn read(node: &Node) -> Result<Vec<Self>, InputError> {
        read_items(node, node.list("methods")?.iter())
    }

    /// The same where `{ model: FILE.safetensors }` may stand in the list too, for a trained network. Those come last.
    ///
    /// # Errors
    /// As for a list without models, or when a file is no model.
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
        candidates.extend(Network::named(networks));
        Ok(candidates)
    }

    /// What [`Candidate::read`] accepts.
    #[must_use]
    pub fn schema() -> Schema {
        let settings = Fields::new("A method with its mesh, or an accuracy.");
        let settings = SolverParameters::schema(settings, Mesh::bilinear(2))
            .without("tolerance")
            .without("time_limit")
            .without("history");
        let list = Schema::list(Schema::any_of([Method::schema(&()), settings.into()]), 1, usize::MAX);
        list.distinct()
            .description("What is measured: words, or mappings with the keys of a solve stage.")
    }

    /// What is measured unless a list is given: estimates, Newton's method on meshes of both orders, and accuracies.
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
        // 0.03, 0.01 and 0.003 mm, as exact as if they were read.
        let accuracies = ["0.03", "0.01", "0.003"];
        let accurate = accuracies
            .iter()
            .filter_map(|mm| Quantity::parse(mm, Dimension::Length).ok())
            .map(|mm| SolverParameters::new(Method::Newton, MeshRequest::Accuracy(mm)));
        let estimates = estimates.into_iter().map(|(method, on)| mesh(method, on));
        let newton = meshes.map(|on| mesh(Method::Newton, on));
        estimates.chain(newton).chain(accurate.map(Self::Elements)).collect()
    }

    /// The settings as keys of a stage, on one line without braces, in at most 64 bytes.
    #[must_use]
    pub fn settings(&self) -> String {
        match self {
            Self::Elements(parameters) => parameters.to_string(),
            Self::Network(network) => network.settings(),
        }
    }

    /// The canonical value.
    #[must_use]
    pub fn canonical(&self) -> Canonical {
        match self {
            Self::Elements(parameters) => parameters.canonical([]),
            Self::Network(network) => network.canonical(),
        }
    }

    /// Whether its errors can be told by this reference, which must be finer.
    #[must_use]
    pub fn is_coarser_than(&self, reference: &SolverParameters) -> bool {
        let Self::Elements(parameters) = self else {
            return true;
        };
        match (parameters.mesh(), reference.mesh()) {
            (Some(own), Some(finest)) => {
                own.order() <= finest.order()
                    && (own.elements_per_cell() < finest.elements_per_cell() || own.order() < finest.order())
            }
            _ => true,
        }
    }

    /// Whether it may be used in a scene at all, as far as that is known without setting it up.
    ///
    /// # Errors
    /// When it may not.
    pub fn check_scene(&self, scene: &Scene) -> Result<(), AccuracyError> {
        match self {
            Self::Elements(_) => Ok(()),
            Self::Network(network) => {
                let checked = network.surrogate().check_scene(scene);
                checked.map_err(|e| AccuracyError::from(e).of(self.settings()))
            }
        }
    }

    /// The method, ready for patterns of a scene.
    ///
    /// # Errors
    /// When it does not work in this scene.
    pub(super) fn prepare(&self, scene: &Scene) -> Result<Arc<dyn Evaluator>, AccuracyError> {
        match self {
            Self::Elements(parameters) => Ok(Arc::new(parameters.build(scene)?)),
            Self::Network(network) => {
                network.surrogate().check_scene(scene)?;
                Ok(network.surrogate().clone())
            }
        }
    }
}

fn read_items<'a>(node: &Node, items: impl Iterator<Item = &'a Node>) -> Result<Vec<Candidate>, InputError> {
    let mut candidates: Vec<Candidate> = Vec::new();
    for item in items {
        let candidate = Candidate::Elements(read_elements(item)?);
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

fn read_elements(node: &Node) -> Result<SolverParameters, InputError> {
    let usual = Mesh::bilinear(2);
    match node.value() {
        NodeValue::Text(_) => Ok(SolverParameters::new(Method::read(node, "method", &())?, usual)),
        _ => SolverParameters::read(&node.fields("a method", &KEYS)?, usual),
    }
}
