//! What can be measured: one file per kind of method. A list of methods is read here.

use super::elements::Elements;
use crate::base::{Canonical, InputError, Node, Schema};
use crate::field::Field;
use crate::pattern::Pattern;
use crate::scene::Scene;
use crate::stage::solver::SolverParameters;

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
    let mut contenders: Vec<Box<dyn Contender>> = Vec::new();
    for item in node.list("methods")? {
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
