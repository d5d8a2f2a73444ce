//! What can be measured: one file per kind of method. A list of methods is read here.

use super::elements::Elements;
use super::surrogate::{Network, named};
use crate::base::{Canonical, InputError, Node, Schema};
use crate::fem::SolverParameters;
use crate::field::Field;
use crate::pattern::Pattern;
use crate::scene::Scene;

/// A method with its settings.
pub trait Contender: Send + Sync {
    /// The settings as keys of a stage, on one line without braces, in at most 64 bytes.
    fn settings(&self) -> String;

    /// The canonical value.
    fn canonical(&self) -> Canonical;

    /// The error in mm that the method itself promises to stay below, if it does.
    fn promise_mm(&self) -> Option<f64>;

    /// Whether its fields are equilibria that are known to be stable.
    fn finds_equilibria(&self) -> bool;

    /// Whether its errors can be told by this reference, which must be finer.
    fn is_coarser_than(&self, reference: &SolverParameters) -> bool;

    /// Whether it may be used in a scene at all, as far as that is known without setting it up.
    ///
    /// # Errors
    /// When it may not; why.
    fn check_scene(&self, scene: &Scene) -> Result<(), String> {
        let _ = scene;
        Ok(())
    }

    /// The number of patterns whose time in one batch is measured too, for a method to which that makes a difference.
    fn batch(&self) -> Option<usize> {
        None
    }

    /// The method, ready for patterns of a scene.
    ///
    /// # Errors
    /// When it does not work in this scene; why.
    fn prepare(&self, scene: &Scene) -> Result<Box<dyn Ready>, String>;
}

/// A method that is ready.
pub trait Ready: Sync {
    /// The field of each pattern, in order; `None` where the method finds none.
    ///
    /// # Errors
    /// When the method fails as a whole; why.
    fn fields(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, String>;
}

/// Reads a list of methods: words (`linear`, `chord:2`, `newton`) or mappings (`{ method, elements_per_cell, order }`,
/// `{ accuracy }`).
///
/// # Errors
/// When the list is empty, names a method twice, or has something else in it.
pub fn read(node: &Node) -> Result<Vec<Box<dyn Contender>>, InputError> {
    read_items(node, node.list("methods")?.iter())
}

/// The same where `{ model: FILE.safetensors }` may stand in the list too, for a trained network. Those come last.
///
/// # Errors
/// As for a list without models, or when a file is no model.
pub fn read_with_models(node: &Node, more: Vec<Network>) -> Result<Vec<Box<dyn Contender>>, InputError> {
    let (models, methods): (Vec<&Node>, Vec<&Node>) = node
        .list("methods")?
        .iter()
        .partition(|item| item.peek("model").is_some());
    let mut networks = Vec::new();
    for item in models {
        networks.push(Network::read(
            item.fields("a model", &["model"])?.required("a model", "model")?,
        )?);
    }
    networks.extend(more);
    let mut contenders = match (methods.is_empty(), networks.is_empty()) {
        (true, false) => Vec::new(),
        _ => read_items(node, methods.into_iter())?,
    };
    contenders.extend(named(networks));
    Ok(contenders)
}

fn read_items<'a>(node: &Node, items: impl Iterator<Item = &'a Node>) -> Result<Vec<Box<dyn Contender>>, InputError> {
    let mut contenders: Vec<Box<dyn Contender>> = Vec::new();
    for item in items {
        let contender = Elements::read(item)?;
        let settings = contender.settings();
        if contenders.iter().any(|other| other.settings() == settings) {
            return Err(item.error(format!("`methods` names {{ {settings} }} twice")));
        }
        contenders.push(Box::new(contender));
    }
    if contenders.is_empty() {
        return Err(node
            .error("`methods` is empty")
            .help("for example [linear, chord:1, newton, { accuracy: 0.01 mm }]"));
    }
    Ok(contenders)
}

/// What [`read`] accepts.
pub fn schema() -> Schema {
    let list = Schema::list(Elements::schema(), 1, usize::MAX).distinct();
    list.says("What is measured: words, or mappings with the keys of a solve stage.")
}

/// Estimates, Newton's method on meshes of both orders, and meshes that the solver picks for an accuracy.
pub fn usual() -> Vec<Box<dyn Contender>> {
    Elements::usual()
        .into_iter()
        .map(|elements| Box::new(elements) as Box<dyn Contender>)
        .collect()
}
