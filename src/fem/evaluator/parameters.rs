//! The parameters of a solver, shared by everything that simulates: method, mesh and tolerance.

use std::fmt;
use std::path::Path;

use serde_json::json;

use super::method::Method;
use super::solver::Solver;
use crate::error::SetupError;
use crate::time::{HistoryOptions, HistoryRequest, HistorySolver, refusal};
use crate::work::WorkLimit;
use deaflow_base::{
    Canonical, Decimal, Declared, Document, Fields, InputError, Length, Map, Quantity, Schema, Time, parameters,
};
use deaflow_field::{Mesh, Order};
use deaflow_scene::{Scene, Stiffening};

/// Where the unknowns stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshRequest {
    /// One mesh for all patterns.
    Fixed(Mesh),
    /// For each pattern the mesh on which the discretisation error is estimated below this length.
    Accuracy(Quantity),
}

impl From<Mesh> for MeshRequest {
    fn from(mesh: Mesh) -> Self {
        Self::Fixed(mesh)
    }
}

/// Method, mesh and tolerance as a stage states them, exactly.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SolverParameters {
    method: Method,
    mesh: MeshRequest,
    tolerance: Decimal,
    time_limit: Option<Time>,
    history: Option<HistoryKeys>,
}

impl SolverParameters {
    /// The keys that [`SolverParameters::read`] looks for.
    #[must_use]
    pub fn keys() -> Vec<&'static str> {
        SolverKeys::keys()
    }

    /// Adds the keys that [`SolverParameters::read`] looks for, with the mesh where nothing is said.
    #[must_use]
    pub fn schema(fields: Fields, usual: Mesh) -> Fields {
        let with_mesh = |key: &str, schema: Schema| match key {
            "elements_per_cell" => schema.default(usual.elements_per_cell()),
            "order" => schema.default(usual.order().degree()),
            _ => schema,
        };
        SolverKeys::add_to(fields).map_schemas(with_mesh)
    }

    /// A method on a mesh or to an accuracy, with the usual tolerance.
    #[must_use]
    pub fn new(method: Method, mesh: impl Into<MeshRequest>) -> Self {
        Self {
            method,
            mesh: mesh.into(),
            tolerance: usual_tolerance(),
            time_limit: None,
            history: None,
        }
    }

    /// The same with work for about so long on each pattern, where a time is given.
    #[must_use]
    pub fn with_time_limit(self, time_limit: Option<Time>) -> Self {
        Self { time_limit, ..self }
    }

    /// The same through the time of the drive, up to a time.
    #[must_use]
    pub fn up_to(self, time: Time) -> Self {
        Self {
            history: Some(HistoryKeys { at: vec![time] }),
            ..self
        }
    }

    /// The same with another relative residual; one that is not finite is left out.
    #[must_use]
    pub fn with_tolerance(self, tolerance: f64) -> Self {
        Self {
            tolerance: Decimal::from_f64(tolerance).unwrap_or(self.tolerance),
            ..self
        }
    }

    /// Reads `method`; `elements_per_cell` and `order`, or instead of them `accuracy`; and `tolerance`. Each is optional, and
    /// the mesh is `usual` where nothing is said.
    ///
    /// # Errors
    /// When one is out of range, `accuracy` stands beside a mesh, or a method takes no accuracy or tolerance.
    pub fn read(map: &Map<'_>, usual: Mesh) -> Result<Self, InputError> {
        let keys = SolverKeys::read_map(map)?;
        let order = match keys.order.unwrap_or(usual.order().degree()) {
            1 => Order::Bilinear,
            _ => Order::Biquadratic,
        };
        let elements = keys.elements_per_cell.unwrap_or(usual.elements_per_cell());
        Ok(Self {
            method: keys.method,
            mesh: match keys.accuracy {
                Some(accuracy) => MeshRequest::Accuracy(*accuracy),
                None => MeshRequest::Fixed(Mesh::new(elements, order)),
            },
            tolerance: keys.tolerance,
            time_limit: keys.time_limit,
            history: keys.history.map(HistoryKeys::in_order),
        })
    }

    /// Checks that what is asked for can be had in a scene; `map` is what this was read from.
    ///
    /// # Errors
    /// When histories are asked for of a scene that cannot be followed in time.
    pub fn check_scene(&self, map: &Map<'_>, scene: &Scene) -> Result<(), InputError> {
        match (map.optional("history"), refusal(scene)) {
            (Some(node), Some(why)) => Err(node.error(why.to_string())),
            _ => Ok(()),
        }
    }

    /// The canonical value, with further entries. What a method does not use is no part of it.
    #[must_use]
    pub fn canonical<const N: usize>(&self, more: [(&str, Canonical); N]) -> Canonical {
        let mut own = vec![("method", Canonical::from(self.method.to_string().as_str()))];
        if self.method == Method::Newton {
            own.push(("tolerance", self.tolerance.into()));
        }
        if let Some(time) = &self.time_limit {
            own.push(("time_limit", (&**time).into()));
        }
        if let Some(history) = &self.history {
            own.push(("history", history.to_canonical()));
        }
        match &self.mesh {
            MeshRequest::Fixed(mesh) => own.extend([
                ("elements_per_cell", mesh.elements_per_cell().into()),
                ("order", mesh.order().degree().into()),
            ]),
            MeshRequest::Accuracy(accuracy) => own.push(("accuracy", accuracy.into())),
        }
        Canonical::map(own.into_iter().chain(more))
    }

    /// Whether membranes are followed in the time of their drive.
    #[must_use]
    pub fn follows_time(&self) -> bool {
        self.history.is_some()
    }

    /// What is added to the RECIPE of a kind: histories are extrapolated from three passes, and were the last of four before; energies of
    /// membranes that stiffen, which histories alone tell, have logarithms; the error of an accurate equilibrium is told by a loose solution on
    /// the finer mesh; and [`revision_of`] the scene.
    #[must_use]
    pub fn revision(&self, scene: &Scene) -> u32 {
        let has_logarithms = !scene.auto && !has_powers(scene) && scene.effects.strain_stiffening.is_some();
        let in_time = u32::from(self.follows_time());
        let has_loose_errors = self.accuracy().is_some() && !self.follows_time() && scene.drive.charge.is_none();
        u32::from(has_loose_errors) + in_time * (1 + 2 * u32::from(has_logarithms)) + revision_of(scene)
    }

    /// The parts of a scene that decide about a result.
    #[must_use]
    pub fn decisive(&self, scene: &Scene) -> Scene {
        match self.history.as_ref().and_then(|history| history.at.last()) {
            Some(last) => scene.simulated_until(*last),
            None => scene.simulated(),
        }
    }

    /// The last time that is asked for.
    #[must_use]
    pub fn time(&self) -> Option<Time> {
        self.history.as_ref()?.at.last().copied()
    }

    /// The times that are asked for, in s, in order.
    #[must_use]
    pub fn times(&self) -> Option<Vec<f64>> {
        let history = self.history.as_ref()?;
        Some(history.at.iter().map(|time| time.value()).collect())
    }

    /// The solver of histories in a scene whose effects are decided, for fields at some times in s, in order.
    ///
    /// # Errors
    /// When it cannot be set up.
    pub fn history_solver(&self, scene: &Scene, times: Vec<f64>) -> Result<HistorySolver, SetupError> {
        HistorySolver::new(scene, &self.history_options(), self.request_at(times))
    }

    /// How histories are solved.
    #[must_use]
    pub fn history_options(&self) -> HistoryOptions {
        HistoryOptions {
            mesh: self.mesh(),
            tolerance: self.tolerance(),
        }
    }

    /// The settings of a way to find the state at a time that is called by a word: the word alone where the method is Newton's, and
    /// `WORD+chord:2` or `WORD+linear` where it is an estimate.
    #[must_use]
    pub fn settings_in_time(&self, word: &str) -> String {
        let text = self.to_string();
        match self.method {
            Method::Newton => text.replacen("method: newton", &format!("method: {word}"), 1),
            _ => text.replacen("method: ", &format!("method: {word}+"), 1),
        }
    }

    /// What is asked of a history, where one is.
    #[must_use]
    pub fn history_request(&self) -> Option<HistoryRequest> {
        Some(self.request_at(self.times()?))
    }

    fn request_at(&self, times: Vec<f64>) -> HistoryRequest {
        HistoryRequest {
            times,
            accuracy_mm: self.accuracy().map(|accuracy| accuracy.value()),
            limit: WorkLimit::of_history(self.time_limit.as_ref()),
            estimate: None,
            measures: true,
        }
    }

    /// The solver for a scene.
    ///
    /// # Errors
    /// When it cannot be set up.
    pub fn build(&self, scene: &Scene) -> Result<Solver, SetupError> {
        Solver::new(scene, self)
    }

    /// From the text that an artifact of a solve stage carries.
    ///
    /// # Errors
    /// When it is not understood.
    pub fn from_text(text: &str) -> Result<Self, InputError> {
        let document = Document::from_text(Path::new("solver"), text)?;
        Self::read(&document.root.fields("the solver", &Self::keys())?, Mesh::bilinear(2))
    }

    /// Relative residual at which Newton's method ends.
    #[must_use]
    pub fn tolerance(&self) -> f64 {
        self.tolerance.to_f64()
    }

    /// How much work a pattern may take.
    #[must_use]
    pub fn work_limit(&self) -> WorkLimit {
        WorkLimit::of_time(self.time_limit.as_ref())
    }

    /// The method.
    #[must_use]
    pub fn method(&self) -> Method {
        self.method
    }

    /// Where the unknowns stand.
    #[must_use]
    pub fn mesh_request(&self) -> MeshRequest {
        self.mesh
    }

    /// How much work a pattern is: the number of unknowns, of which biquadratic elements have four times as many and couple
    /// each to more.
    #[must_use]
    pub fn weight(&self) -> f64 {
        let mesh = self.mesh().unwrap_or(Mesh::bilinear(1));
        let factor = if mesh.order() == Order::Biquadratic { 6.0 } else { 1.0 };
        factor * (mesh.elements_per_cell() as f64).powi(2)
    }

    /// The mesh, where one serves all patterns.
    #[must_use]
    pub fn mesh(&self) -> Option<Mesh> {
        match self.mesh {
            MeshRequest::Fixed(mesh) => Some(mesh),
            MeshRequest::Accuracy(_) => None,
        }
    }

    /// The same on another mesh of comparable kind, by which the error of this one can be told: half as many elements per
    /// cell, lower order where there is but one, and two elements where that is of the lowest order too. `None` where the mesh
    /// follows from an accuracy.
    #[must_use]
    pub fn beside(&self) -> Option<Self> {
        let mesh = match self.mesh()? {
            mesh if mesh == Mesh::bilinear(1) => Mesh::bilinear(2),
            mesh if mesh.elements_per_cell() == 1 => Mesh::bilinear(1),
            mesh => Mesh::new(mesh.elements_per_cell() / 2, mesh.order()),
        };
        Some(Self {
            mesh: MeshRequest::Fixed(mesh),
            ..self.clone()
        })
    }

    /// The accuracy that was asked for instead of a mesh.
    #[must_use]
    pub fn accuracy(&self) -> Option<Quantity> {
        match self.mesh {
            MeshRequest::Accuracy(accuracy) => Some(accuracy),
            MeshRequest::Fixed(_) => None,
        }
    }
}

/// The keys of a stage that solves so, on one line without braces; what has its usual value is left out, apart from the
/// mesh.
impl fmt::Display for SolverParameters {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "method: {}", self.method)?;
        match &self.mesh {
            MeshRequest::Fixed(mesh) => write!(f, ", {mesh}")?,
            MeshRequest::Accuracy(accuracy) => write!(f, ", accuracy: {accuracy}")?,
        }
        if self.method == Method::Newton && self.tolerance != usual_tolerance() {
            write!(f, ", tolerance: {:e}", self.tolerance.to_f64())?;
        }
        if let Some(time) = &self.time_limit {
            write!(f, ", time_limit: {}", **time)?;
        }
        if let Some(history) = &self.history {
            write!(f, ", history: {}", history.to_canonical())?;
        }
        Ok(())
    }
}

fn usual_tolerance() -> Decimal {
    Decimal::from(1).scaled(-8)
}

parameters! {
    /// How fields are found.
    struct SolverKeys as "the solver" {
        /// How fields are found: newton, or estimates by linear or chord:N, N from 1 to 50.
        method: Method = Method::Newton,
        /// Elements along one side of a cell.
        elements_per_cell: Option<usize> [1..=Mesh::MOST_ELEMENTS as u64],
        /// Polynomial order of the elements.
        order: Option<usize> [1..=2],
        /// Instead of a mesh: the mesh of each pattern is picked so that its displacement is this accurate.
        accuracy: Option<Length> [1e-9..=1e3],
        /// Relative residual at which an equilibrium is accepted.
        tolerance: Decimal [1e-12..=1e-3] = 1e-8,
        /// About how long a pattern may take before it ends as work-limit; 5 s unless said otherwise, 500 s for a history. Work is counted, not time.
        time_limit: Option<Time> [1e-3..=1e6],
        /// Membranes are followed in the time of the drive, and the displacement is that at the last time; without it they are in equilibrium.
        history: Option<HistoryKeys>,
    }
    rules(exclusive)
    check(SolverKeys::check)
}

parameters! {
    /// Times in the course of a drive.
    struct HistoryKeys as "`history`" {
        /// When the displacement is kept; 0 s is just after the drive has begun.
        at: Vec<Time> [(0.0..=1e12, 1..=1000)],
    }
}

impl HistoryKeys {
    /// The same with each time once.
    fn in_order(mut self) -> Self {
        self.at.sort_by(|a, b| a.value().total_cmp(&b.value()));
        self.at.dedup();
        self
    }
}

/// An accuracy picks the mesh, and methods that look for no equilibrium have neither an accuracy nor a tolerance.
fn exclusive(fields: Fields) -> Fields {
    let estimates_lack = |key: &str| {
        json!({
            "if": { "required": ["method"], "properties": { "method": { "not": { "const": "newton" } } } },
            "then": { "not": { "required": [key] } },
        })
    };
    fields
        .mutually_exclusive("accuracy", "elements_per_cell")
        .mutually_exclusive("accuracy", "order")
        .rule(estimates_lack("accuracy"))
        .rule(estimates_lack("tolerance"))
        .rule(estimates_lack("time_limit"))
        .rule(estimates_lack("history"))
}

impl SolverKeys {
    fn check(&self, map: &Map<'_>) -> Result<(), InputError> {
        let method = self.method;
        if method.chord_steps().is_some() {
            if let Some(node) = map.optional("accuracy") {
                return Err(node
                    .error(format!(
                        "`accuracy` cannot stand beside `method: {method}`, whose error is not that of the mesh alone"
                    ))
                    .help("give a mesh by `elements_per_cell` and `order`, or `method: newton`"));
            }
            for key in ["tolerance", "time_limit", "history"] {
                let Some(node) = map.optional(key) else { continue };
                return Err(node
                    .error(format!(
                        "`{key}` means nothing beside `method: {method}`, which looks for no equilibrium"
                    ))
                    .help("leave it out, or take `method: newton`"));
            }
        }
        let mesh = self.elements_per_cell.is_some() || self.order.is_some();
        match map.optional("accuracy").filter(|_| mesh) {
            Some(node) => Err(node
                .error("`accuracy` picks the mesh, so `elements_per_cell` and `order` cannot stand beside it")
                .help("give either `accuracy` or a mesh; in `--set`, `elements_per_cell=null` takes one out that the file has")),
            None => Ok(()),
        }
    }
}

/// What is added to the RECIPE of kinds that simulate a scene: a fringe field is integrated within bilinear elements, which were parted along
/// it before; powers of stretches are sums of fewer terms in single precision, and since then of small stretches take no roots.
#[must_use]
pub fn revision_of(scene: &Scene) -> u32 {
    // What screening may turn on is not known before it.
    match scene.auto || has_powers(scene) {
        true => 4,
        false => 2 * u32::from(scene.effects.fringe_field.is_some()),
    }
}

/// Whether stresses have powers of stretches.
fn has_powers(scene: &Scene) -> bool {
    let effects = &scene.effects;
    matches!(effects.strain_stiffening, Some(Stiffening::Ogden(_))) || effects.stretch_dependent_permittivity.is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<SolverParameters, InputError> {
        let document = Document::from_text(Path::new("t"), text).unwrap();
        SolverParameters::read(
            &document.root.fields("t", &SolverParameters::keys())?,
            Mesh::bilinear(2),
        )
    }

    #[test]
    fn parameters_survive_their_own_text() {
        for text in [
            "{ method: linear }",
            "{ method: chord:3, elements_per_cell: 1, order: 2 }",
            "{ accuracy: 10 um }",
            "{ elements_per_cell: 4, tolerance: 1e-6 }",
            "{ time_limit: 60 s }",
            "{ accuracy: 10 um, history: { at: [0 s, 1 s, 10 min] } }",
            "{}",
        ] {
            let parameters = read(text).unwrap();
            assert_eq!(
                read(&format!("{{ {parameters} }}")).unwrap(),
                parameters,
                "{parameters}"
            );
        }
        assert_eq!(
            read("{ method: newton, tolerance: 0.00000001 }").unwrap(),
            read("{}").unwrap()
        );
        assert_eq!(
            read("{}").unwrap(),
            SolverParameters::new(Method::Newton, Mesh::bilinear(2))
        );
    }

    #[test]
    fn what_a_method_does_not_take_is_refused() {
        for (text, said) in [
            (
                "{ method: linear, accuracy: 0.01 mm }",
                "`accuracy` cannot stand beside",
            ),
            ("{ method: chord:2, tolerance: 1e-6 }", "`tolerance` means nothing"),
            ("{ method: linear, time_limit: 9 s }", "`time_limit` means nothing"),
            ("{ method: chord:2, history: { at: [1 s] } }", "`history` means nothing"),
            ("{ accuracy: 0.01 mm, order: 2 }", "picks the mesh"),
        ] {
            assert!(read(text).unwrap_err().to_string().contains(said), "{text}");
        }
    }

    #[test]
    fn the_method_is_part_of_the_key_and_an_unused_tolerance_is_not() {
        let [newton, linear, chord] =
            ["{}", "{ method: linear }", "{ method: chord:1 }"].map(|text| read(text).unwrap().canonical([]));
        assert!(newton != linear && linear != chord);
        assert!(linear.leaves().iter().all(|(path, _)| path != "tolerance"));
        // The usual limit of work is in no key, so that what was simulated before it could be set keeps its own.
        let limited = read("{ time_limit: 60 s }").unwrap().canonical([]);
        assert!(newton != limited && newton.leaves().iter().all(|(path, _)| path != "time_limit"));
    }
}
