//! The parameters of a solver: method, mesh and tolerance.

use std::fmt;
use std::path::Path;

use serde_json::json;

use super::method::Method;
use crate::error::SetupError;
use crate::krylov::LARGE;
use crate::lanes::WIDEST;
use crate::out_of_plane::InflationSolver;
use crate::precondition::is_clustered;
use crate::precondition::is_large_or_long;
use crate::response::check_sides;
use crate::time::{HistoryOptions, HistoryRequest, HistorySolver, refusal};
use crate::work::WorkLimit;
use deaflow_base::{
    Canonical, Decimal, Declared, Document, Fields, InputError, Length, Map, Quantity, Schema, Time, parameters,
};
use deaflow_field::{Mesh, Order};
use deaflow_scene::{Scene, Stiffening};

/// The requested mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshRequest {
    /// One mesh for all patterns.
    Fixed(Mesh),
    /// For each pattern the mesh with an estimated discretisation error below this length.
    Accuracy(Quantity),
}

impl From<Mesh> for MeshRequest {
    fn from(mesh: Mesh) -> Self {
        Self::Fixed(mesh)
    }
}

/// Method, mesh and tolerance as declared by a stage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SolverParameters {
    method: Method,
    mesh: MeshRequest,
    tolerance: Decimal,
    time_limit: Option<Time>,
    history: Option<HistoryKeys>,
}

impl SolverParameters {
    /// Returns the keys that [`SolverParameters::read`] reads.
    #[must_use]
    pub fn keys() -> Vec<&'static str> {
        SolverKeys::keys()
    }

    /// Adds these keys to a schema, with a default mesh.
    #[must_use]
    pub fn schema(fields: Fields, usual: Mesh) -> Fields {
        let with_mesh = |key: &str, schema: Schema| match key {
            "elements_per_cell" => schema.default(usual.elements_per_cell()),
            "order" => schema.default(usual.order().degree()),
            _ => schema,
        };
        SolverKeys::add_to(fields).map_schemas(with_mesh)
    }

    /// Creates parameters with the default tolerance.
    #[must_use]
    pub fn new(method: Method, mesh: impl Into<MeshRequest>) -> Self {
        Self {
            method,
            mesh: mesh.into(),
            tolerance: default_tolerance(),
            time_limit: None,
            history: None,
        }
    }

    /// Sets the time limit for each pattern, if given.
    #[must_use]
    pub fn with_time_limit(self, time_limit: Option<Time>) -> Self {
        Self { time_limit, ..self }
    }

    /// Simulates the drive in time up to a time.
    #[must_use]
    pub fn up_to(self, time: Time) -> Self {
        Self {
            history: Some(HistoryKeys { at: vec![time] }),
            ..self
        }
    }

    /// Sets the relative residual; ignores one that is not finite.
    #[must_use]
    pub fn with_tolerance(self, tolerance: f64) -> Self {
        Self {
            tolerance: Decimal::from_f64(tolerance).unwrap_or(self.tolerance),
            ..self
        }
    }

    /// Reads `method`, `tolerance`, and either `elements_per_cell` and `order` or `accuracy`. Each is optional; `usual`
    /// is the default mesh.
    ///
    /// # Errors
    /// If one is out of range, `accuracy` is combined with a mesh, or the method takes no accuracy or tolerance.
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

    /// Checks the parameters against a scene; `map` is their source.
    ///
    /// # Errors
    /// If they ask for a history and the scene cannot be simulated in time, or for an estimate that it does not allow.
    pub fn check_scene(&self, map: &Map<'_>, scene: &Scene) -> Result<(), InputError> {
        if scene.is_in_space() {
            let keys = ["method", "history", "accuracy"].into_iter();
            let node = keys.filter_map(|key| map.optional(key)).next();
            let refused = |error: SetupError| {
                let message = error.to_string();
                node.map_or_else(|| map.error(message.clone()), |node| node.error(message.clone()))
            };
            self.mesh_in_space(scene).map_err(refused)?;
            let mut states = scene.in_states().into_iter();
            return states.try_for_each(|(_, state)| InflationSolver::check(&state).map_err(refused));
        }
        if let (Some(node), Err(why)) = (map.optional("method"), self.check_method(scene)) {
            return Err(node.error(why.to_string()));
        }
        match (map.optional("history"), refusal(scene)) {
            (Some(node), Some(why)) => Err(node.error(why.to_string())),
            _ => Ok(()),
        }
    }

    /// Checks the method against a scene.
    ///
    /// # Errors
    /// If it is an estimate, and not all sides are held.
    pub fn check_method(&self, scene: &Scene) -> Result<(), SetupError> {
        match self.method {
            Method::Newton => Ok(()),
            Method::Linear | Method::Chord(_) => check_sides(scene),
        }
    }

    /// Returns the canonical value with further entries. It omits parameters that the method does not use.
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

    /// Returns whether the drive is simulated in time.
    #[must_use]
    pub fn follows_time(&self) -> bool {
        self.history.is_some()
    }

    /// Returns the revision to add to the RECIPE of a kind. Three passes are extrapolated in histories, where once the
    /// last of four was taken; errors of motions are those over all times, and steps may contain rows of a table, whose
    /// noise is averaged over steps; histories of membranes with sides that are not held count displacements from rest;
    /// energies of stiffening membranes, which only histories report, contain logarithms; the
    /// error of an accurate equilibrium comes from a solution with a loose tolerance on the finer mesh; [`revision_of`]
    /// covers the scene. Errors contain those of geometry.
    #[must_use]
    pub fn revision(&self, scene: &Scene) -> u32 {
        let has_logarithms = !scene.auto && !has_powers(scene) && scene.effects.strain_stiffening.is_some();
        let in_time = u32::from(self.follows_time());
        let has_loose_errors = self.accuracy().is_some() && !self.follows_time() && scene.drive.charge.is_none();
        let moves = scene.auto || scene.effects.inertia.is_some();
        let waveform = scene.drive.waveform.as_ref();
        let has_table = waveform.is_some_and(|waveform| waveform.table.is_some());
        let has_noise = waveform.is_some_and(|waveform| waveform.noise().is_some());
        let of_drive = 8 * u32::from(moves || has_table) + 16 * u32::from(has_noise);
        let of_sides = 32 * u32::from(scene.geometry.sides.is_some());
        u32::from(has_loose_errors)
            + in_time * (1 + 2 * u32::from(has_logarithms) + of_drive + of_sides)
            + self.accuracy().map_or(0, |_| geometry_revision(scene))
            + revision_on(scene, self.nodes_per_cell())
    }

    /// Returns the number of nodes along a cell, on the finest mesh for a requested accuracy.
    fn nodes_per_cell(&self) -> usize {
        match self.mesh_request() {
            MeshRequest::Fixed(mesh) => mesh.elements_per_cell() * mesh.order().degree(),
            MeshRequest::Accuracy(_) => NODES_PER_CELL,
        }
    }

    /// Returns the parts of a scene that affect a result.
    #[must_use]
    pub fn decisive(&self, scene: &Scene) -> Scene {
        match self.history.as_ref().and_then(|history| history.at.last()) {
            Some(last) => scene.simulated_until(*last),
            None => scene.simulated(),
        }
    }

    /// Returns the last requested time.
    #[must_use]
    pub fn time(&self) -> Option<Time> {
        self.history.as_ref()?.at.last().copied()
    }

    /// Returns the requested times in s in ascending order.
    #[must_use]
    pub fn times(&self) -> Option<Vec<f64>> {
        let history = self.history.as_ref()?;
        Some(history.at.iter().map(|time| time.value()).collect())
    }

    /// Creates the solver of histories for a scene with decided effects and ascending times in s.
    ///
    /// # Errors
    /// If it cannot be set up.
    pub fn history_solver(&self, scene: &Scene, times: Vec<f64>) -> Result<HistorySolver, SetupError> {
        HistorySolver::new(scene, &self.history_options(), self.request_at(times))
    }

    /// Returns the options of histories.
    #[must_use]
    pub fn history_options(&self) -> HistoryOptions {
        HistoryOptions {
            mesh: self.mesh(),
            tolerance: self.tolerance(),
        }
    }

    /// Returns the settings of a method for a state in time that has a name: the name alone with Newton's method,
    /// `NAME+chord:2` or `NAME+linear` with an estimate.
    #[must_use]
    pub fn settings_in_time(&self, word: &str) -> String {
        let text = self.to_string();
        match self.method {
            Method::Newton => text.replacen("method: newton", &format!("method: {word}"), 1),
            _ => text.replacen("method: ", &format!("method: {word}+"), 1),
        }
    }

    /// Returns the request of a history, if any.
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

    /// Parses the text in an artifact of a solve stage.
    ///
    /// # Errors
    /// If it is invalid.
    pub fn from_text(text: &str) -> Result<Self, InputError> {
        let document = Document::from_text(Path::new("solver"), text)?;
        Self::read(&document.root.fields("the solver", &Self::keys())?, Mesh::bilinear(2))
    }

    /// Checks that equilibria on one mesh are asked for, which alone are simulated where electrodes cover parts of
    /// cells.
    ///
    /// # Errors
    /// If something else is asked for.
    pub fn check_covered_cells(&self) -> Result<(), SetupError> {
        let with = match (self.follows_time(), self.mesh, self.method) {
            (true, ..) => "a history",
            // Its meshes refine the elements of a covered cell, not the cell.
            (false, MeshRequest::Accuracy(_), _) => "`accuracy`",
            (false, _, Method::Linear | Method::Chord(_)) => "`method: linear` and `method: chord`",
            (false, _, Method::Newton) => return Ok(()),
        };
        Err(SetupError::Coverage { with })
    }

    /// Returns the relative residual at which Newton's method ends.
    #[must_use]
    pub fn tolerance(&self) -> f64 {
        self.tolerance.to_f64()
    }

    /// Returns the work limit of a pattern.
    #[must_use]
    pub fn work_limit(&self) -> WorkLimit {
        WorkLimit::of_time(self.time_limit.as_ref())
    }

    /// Returns the method.
    #[must_use]
    pub fn method(&self) -> Method {
        self.method
    }

    /// Returns the requested mesh.
    #[must_use]
    pub fn mesh_request(&self) -> MeshRequest {
        self.mesh
    }

    /// Returns the relative work for a pattern; that of the coarsest mesh if the mesh depends on the pattern.
    #[must_use]
    pub fn weight(&self) -> f64 {
        self.mesh().unwrap_or(Mesh::bilinear(1)).weight()
    }

    /// Returns the mesh; `None` if it depends on the pattern.
    #[must_use]
    pub fn mesh(&self) -> Option<Mesh> {
        match self.mesh {
            MeshRequest::Fixed(mesh) => Some(mesh),
            MeshRequest::Accuracy(_) => None,
        }
    }

    /// Returns the same parameters on a coarser mesh, or a finer one if there is none, for estimating the error of the
    /// mesh: half as many elements per cell, else the lower order, else two elements. `None` if the mesh follows from
    /// an accuracy.
    #[must_use]
    pub fn with_comparison_mesh(&self) -> Option<Self> {
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

    /// Returns the mesh of equilibria in space.
    ///
    /// # Errors
    /// If the parameters ask for anything else.
    pub(super) fn mesh_in_space(&self, scene: &Scene) -> Result<Mesh, SetupError> {
        let refused = |with| Err(SetupError::not_in_space(scene, with));
        match (self.follows_time(), self.method, self.mesh) {
            (true, ..) => refused("a `history`"),
            (_, Method::Linear | Method::Chord(_), _) => refused("a `method` other than `newton`"),
            (.., MeshRequest::Accuracy(_)) => refused("`accuracy`: give `elements_per_cell` and `order`"),
            (false, Method::Newton, MeshRequest::Fixed(mesh)) => Ok(mesh),
        }
    }

    /// Returns the parameters of equilibria, or histories of these, on a mesh.
    #[must_use]
    pub(super) fn equilibria_on(&self, mesh: Mesh) -> Self {
        Self {
            method: Method::Newton,
            mesh: MeshRequest::Fixed(mesh),
            ..self.clone()
        }
    }

    /// Returns the requested accuracy; `None` with a fixed mesh.
    #[must_use]
    pub fn accuracy(&self) -> Option<Quantity> {
        match self.mesh {
            MeshRequest::Accuracy(accuracy) => Some(accuracy),
            MeshRequest::Fixed(_) => None,
        }
    }
}

/// The keys of a stage on one line without braces; defaults are omitted, except the mesh.
impl fmt::Display for SolverParameters {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "method: {}", self.method)?;
        match &self.mesh {
            MeshRequest::Fixed(mesh) => write!(f, ", {mesh}")?,
            MeshRequest::Accuracy(accuracy) => write!(f, ", accuracy: {accuracy}")?,
        }
        if self.method == Method::Newton && self.tolerance != default_tolerance() {
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

fn default_tolerance() -> Decimal {
    Decimal::from(1).scaled(-8)
}

parameters! {
    /// The solver of a stage.
    struct SolverKeys as "the solver" {
        /// Solution method: newton, or the estimates linear and chord:N with N from 1 to 50.
        method: Method = Method::Newton,
        /// Elements along one side of a cell.
        elements_per_cell: Option<usize> [1..=Mesh::MOST_ELEMENTS as u64],
        /// Polynomial order of the elements.
        order: Option<usize> [1..=2],
        /// Accuracy of the displacement, instead of a mesh; the mesh of each pattern follows from it.
        accuracy: Option<Length> [1e-9..=1e3],
        /// Relative residual at which an equilibrium is accepted.
        tolerance: Decimal [1e-12..=1e-3] = 1e-8,
        /// Work for a pattern, as a time, before it ends as work-limit; default 5 s, for a history 500 s. Counted in
        /// iterations, not measured.
        time_limit: Option<Time> [1e-3..=1e6],
        /// Simulate the drive in time; the displacement is that at the last time. Without it, equilibria are solved.
        history: Option<HistoryKeys>,
    }
    rules(exclusive)
    check(SolverKeys::check)
}

parameters! {
    /// Times of a history.
    struct HistoryKeys as "`history`" {
        /// Times at which the displacement is kept; 0 s is just after the start of the drive.
        at: Vec<Time> [(0.0..=1e12, 1..=1000)],
    }
}

impl HistoryKeys {
    /// Sorts the times and removes duplicates.
    fn in_order(mut self) -> Self {
        self.at.sort_by(|a, b| a.value().total_cmp(&b.value()));
        self.at.dedup();
        self
    }
}

/// An accuracy replaces the mesh; estimates have no accuracy, tolerance, time limit or history.
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
                        "cannot combine `accuracy` with `method: {method}`, whose error is not only that of the mesh"
                    ))
                    .help("give a mesh by `elements_per_cell` and `order`, or `method: newton`"));
            }
            for key in ["tolerance", "time_limit", "history"] {
                let Some(node) = map.optional(key) else { continue };
                return Err(node
                    .error(format!(
                        "cannot combine `{key}` with `method: {method}`, which does not solve for an equilibrium"
                    ))
                    .help("remove it, or use `method: newton`"));
            }
        }
        let mesh = self.elements_per_cell.is_some() || self.order.is_some();
        match map.optional("accuracy").filter(|_| mesh) {
            Some(node) => Err(node
                .error("cannot combine `accuracy` with `elements_per_cell` or `order`")
                .help(
                    "give either an accuracy or a mesh; `--set` with `elements_per_cell=null` removes one from the \
                       file",
                )),
            None => Ok(()),
        }
    }
}

/// Returns the revision to add to the RECIPE of kinds that simulate a scene. A fringe field is integrated within
/// bilinear elements, which were once split along it; powers of stretches are sums of fewer terms in single precision
/// and, for small stretches, no longer take roots; membranes of many cells, long ones, and those with many nodes along
/// frames and bodies have another preconditioner; more than a million unknowns have more iterations.
#[must_use]
pub fn revision_of(scene: &Scene) -> u32 {
    revision_on(scene, NODES_PER_CELL)
}

/// Returns a number to add to the RECIPE of kinds that state an error, which now contains that of the geometry.
#[must_use]
pub fn geometry_revision(scene: &Scene) -> u32 {
    64 * u32::from(scene.with_fitted_curves().is_some())
}

/// Nodes along a cell with four biquadratic elements, the finest mesh for a requested accuracy.
const NODES_PER_CELL: usize = 8;

/// The same on a mesh with so many nodes along a cell.
fn revision_on(scene: &Scene, nodes_per_cell: usize) -> u32 {
    // Effects that screening may turn on are unknown here.
    let of_effects = match scene.auto || has_powers(scene) {
        true => 4,
        false => 2 * u32::from(scene.effects.fringe_field.is_some()),
    };
    // Branches are relaxed in the released state, where once they were at the mount.
    let has_released_branches = scene.geometry.sides.is_some() && scene.effects.viscoelasticity.is_some();
    let sides = scene.membrane().raster.sides();
    let has_other_solver = is_large_or_long(sides)
        || may_be_large(sides.map(|cells| cells * nodes_per_cell))
        || is_clustered(edges_of_frames_and_bodies(scene) * nodes_per_cell);
    of_effects + 8 * u32::from(has_other_solver) + 16 * u32::from(has_released_branches)
}

/// Returns whether vectors with so many nodes along the sides may be so long, with their padding, that more iterations
/// are allowed than in earlier versions.
fn may_be_large([columns, rows]: [usize; 2]) -> bool {
    2 * (columns + 1 + 2 * WIDEST) * (rows + 1) > LARGE
}

/// Returns the number of edges between free cells and those of frames and bodies.
fn edges_of_frames_and_bodies(scene: &Scene) -> usize {
    let Some(free) = scene.free_cells() else {
        return 0;
    };
    let [columns, rows] = free.sides();
    let cells = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
    let edges = |(x, y): (usize, usize)| {
        let is_edge = |x, y, other| x < columns && y < rows && free.has(x, y) != other;
        let own = free.has(x, y);
        usize::from(is_edge(x + 1, y, own)) + usize::from(is_edge(x, y + 1, own))
    };
    cells.map(edges).sum()
}

/// Returns whether stresses contain powers of stretches.
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
        for (text, key) in [
            ("{ method: linear, accuracy: 0.01 mm }", "`accuracy`"),
            ("{ method: chord:2, tolerance: 1e-6 }", "`tolerance`"),
            ("{ method: linear, time_limit: 9 s }", "`time_limit`"),
            ("{ method: chord:2, history: { at: [1 s] } }", "`history`"),
            ("{ accuracy: 0.01 mm, order: 2 }", "`order`"),
        ] {
            assert!(read(text).unwrap_err().to_string().contains(key), "{text}");
        }
    }

    #[test]
    fn large_and_long_membranes_have_a_revision_of_their_own() {
        let revision = |cells: &str| {
            let text = format!(
                "{{ geometry: {{ size: [60 mm, 40 mm], thickness: 1 mm, prestretch: 3, cells: {cells} }}, material: {{ \
                 model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, drive: {{ voltage: 1 kV }}, \
                 effects: {{}} }}"
            );
            revision_of(&Scene::from_text(&text).unwrap())
        };
        let revisions = [
            "[100, 100]",
            "[60, 20]",
            "[20, 100]",
            "[101, 50]",
            "[20, 101]",
            "[61, 20]",
        ]
        .map(revision);
        // With 8 nodes along a cell, 100 × 100 cells have 1.3 million unknowns.
        assert_eq!(revisions, [8, 0, 0, 8, 8, 8]);
    }

    #[test]
    fn many_nodes_along_a_frame_have_a_revision_of_their_own() {
        let disc = |cells: usize| {
            let text = format!(
                "{{ geometry: {{ side: 60 mm, thickness: 1 mm, prestretch: 3, cells: {cells}, frame: {{ opening: {{ disc: \
                 {{ centre: [30 mm, 30 mm], radius: 30 mm }} }} }} }}, material: {{ model: neo-hookean, shear_modulus: \
                 45 kPa, relative_permittivity: 4.7 }}, drive: {{ voltage: 1 kV }}, effects: {{}} }}"
            );
            Scene::from_text(&text).unwrap()
        };
        // The disc has 304 edges of cells, and so up to 8 nodes along each.
        assert_eq!(edges_of_frames_and_bodies(&disc(90)), 304);
        assert_eq!([90, 40].map(|cells| revision_of(&disc(cells))), [8, 0]);
        for (text, revision) in [
            ("{ elements_per_cell: 4, order: 2 }", 8),
            ("{ elements_per_cell: 4, order: 1 }", 0),
            // The error contains that of the staircase.
            ("{ accuracy: 10 um }", 73),
        ] {
            assert_eq!(read(text).unwrap().revision(&disc(90)), revision, "{text}");
        }
    }

    #[test]
    fn the_method_is_part_of_the_key_and_an_unused_tolerance_is_not() {
        let [newton, linear, chord] =
            ["{}", "{ method: linear }", "{ method: chord:1 }"].map(|text| read(text).unwrap().canonical([]));
        assert!(newton != linear && linear != chord);
        assert!(linear.leaves().iter().all(|(path, _)| path != "tolerance"));
        // The default work limit is in no key, so that results from before the parameter existed keep theirs.
        let limited = read("{ time_limit: 60 s }").unwrap().canonical([]);
        assert!(newton != limited && newton.leaves().iter().all(|(path, _)| path != "time_limit"));
    }
}
