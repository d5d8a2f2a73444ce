//! The search for critical voltages on two meshes, and the check whether a pattern is stable at a voltage on any mesh.

use std::sync::OnceLock;

use deaflow_field::{MESH_OVERESTIMATE, Mesh, Order};
use deaflow_pattern::Pattern;
use deaflow_scene::{Effects, Scene};

use super::continuation::{FIRST_STEP, LoadRange, LoadingEnd};
use super::critical::{CriticalVoltage, MeshLimit};
use super::effects::{Model, StableRange, WithMaterial};
use super::error::SetupError;
use super::geometry::{GeometryError, without_effects_of_cells};
use super::krylov;
use super::material::Material;
use super::newton::{Workspace, probe};
use super::operator::{Activity, Operator};
use super::solver::{MembraneSolver, MeshSolution, SolveOptions};
use super::work::WorkLimit;

/// Smallest eigenvalue of the tangent against the Laplacian, on one biquadratic element per cell, above which no
/// pattern was within a tenth of its critical voltage: 0.40 was the largest at the critical voltage, 0.29 the smallest
/// a tenth below it.
const CLEAR_EIGENVALUE: f32 = 0.5;
/// IsLoadFar, in units of the critical one of a fully active membrane, below which no pattern is within a tenth of its
/// critical voltage: the lowest one, of a single cell, is at 0.30.
const FAR_LOAD: f64 = 0.24;
/// Share of the default work limit for a check on each mesh.
const CHECK_SHARE: f64 = 0.25;
/// A finer mesh must be stable up to this multiple of a voltage to prove stability there.
const FINE_MARGIN: f64 = 1.08;

/// Finds critical voltages on two meshes.
pub struct CriticalSearch {
    coarse: MembraneSolver,
    /// Created on first use; `None` if that fails.
    fine: OnceLock<Option<MembraneSolver>>,
}

impl CriticalSearch {
    /// Creates the search that belongs to a mesh: on that mesh if it is biquadratic and can be halved, otherwise on the
    /// nearest such mesh, and on one of half the element size.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn new(scene: &Scene, options: SolveOptions) -> Result<Self, SetupError> {
        let side = match options.mesh.order() {
            Order::Bilinear => 1,
            Order::Biquadratic => options.mesh.elements_per_cell().min(Mesh::MOST_ELEMENTS / 2),
        };
        let mesh = Mesh::biquadratic(side);
        Ok(Self {
            coarse: MembraneSolver::new(scene, SolveOptions { mesh, ..options })?,
            fine: OnceLock::new(),
        })
    }

    /// Returns the solver on half the element size.
    fn fine(&self) -> Option<&MembraneSolver> {
        let set_up = || {
            let options = SolveOptions {
                mesh: Mesh::biquadratic(2 * self.coarse.mesh().elements_per_cell()),
                tolerance: self.coarse.tolerance,
            };
            let fine = MembraneSolver::new(&self.coarse.scene, options).ok()?;
            Some(fine.within_iterations(self.coarse.limit.part(0.5)))
        };
        self.fine.get_or_init(set_up).as_ref()
    }

    /// Creates the search that checks solutions on a mesh, unless every pattern is stable without one: with a charge, or
    /// [far below](Self::is_far_from_any) all critical voltages.
    ///
    /// # Errors
    /// If an option is out of range, or the effects of the scene cannot be simulated.
    pub fn if_in_question(scene: &Scene, options: SolveOptions) -> Result<Option<Self>, SetupError> {
        if scene.drive.charge.is_some() || Self::is_far_from_any(scene)? {
            return Ok(None);
        }
        Self::for_solutions_on(scene, options).map(Some)
    }

    /// Creates the search that checks solutions on a mesh: on at most two and four biquadratic elements per cell.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn for_solutions_on(scene: &Scene, options: SolveOptions) -> Result<Self, SetupError> {
        let mesh = match options.mesh.order() {
            Order::Bilinear => options.mesh,
            Order::Biquadratic => Mesh::biquadratic(options.mesh.elements_per_cell().min(2)),
        };
        let search = Self::new(scene, SolveOptions { mesh, ..options })?;
        let limit = search.coarse.scaled(WorkLimit::default().part(CHECK_SHARE));
        Ok(search.within(limit))
    }

    /// Returns whether the voltage of a scene is far below all critical voltages, so that every pattern is stable
    /// without a solution.
    ///
    /// # Errors
    /// If the effects of the scene cannot be simulated.
    pub fn is_far_from_any(scene: &Scene) -> Result<bool, SetupError> {
        if scene.geometry.sides.is_some() {
            // The state of rest is far from that of the mount.
            return Ok(scene.voltage_v() <= 0.0);
        }
        Ok(scene.voltage_v() <= 0.0 || Model::new(scene)?.with(IsLoadFar))
    }

    /// The same for patterns that do not wrinkle at the voltage of the scene, as on a membrane without wrinkling.
    ///
    /// # Errors
    /// If the effects of the scene cannot be simulated.
    pub fn is_far_from_any_taut(scene: &Scene) -> Result<bool, SetupError> {
        let effects = Effects {
            wrinkling: None,
            ..scene.effects.clone()
        };
        Self::is_far_from_any(&scene.with_effects(effects))
    }

    /// Returns the critical voltage of a pattern, given that on the coarser mesh in V.
    #[must_use]
    pub fn refine(&self, pattern: &Pattern, on_coarse: f64) -> CriticalVoltage {
        let coarse = MeshLimit {
            mesh: self.coarse.mesh(),
            voltage: on_coarse,
        };
        let fine = self.fine();
        CriticalVoltage::new(
            coarse,
            fine.and_then(|fine| fine.limit_between(pattern, search_range(on_coarse))),
        )
    }

    /// Sets the work limit of a pattern on the coarser mesh; each search on the finer one may take half.
    #[must_use]
    pub fn within(self, limit: WorkLimit) -> Self {
        Self {
            coarse: self.coarse.within_iterations(limit),
            fine: OnceLock::new(),
        }
    }

    /// Returns the stable range of a pattern up to the voltage of the scene on the coarser mesh.
    #[must_use]
    pub fn stable_range(&self, pattern: &Pattern) -> StableRange {
        self.coarse.solve(pattern).stable_range(self.coarse.mesh())
    }

    /// Returns the critical voltage of a pattern, given that on some mesh in V; for another than the coarser mesh it is
    /// a guess.
    #[must_use]
    pub fn from(&self, pattern: &Pattern, mesh: Mesh, voltage: f64) -> CriticalVoltage {
        self.from_drawn([pattern; 2], mesh, voltage)
    }

    /// Like [`CriticalSearch::from`], for a pattern on cells and as drawn: the error has that of the cells.
    #[must_use]
    pub fn from_drawn(&self, [pattern, drawing]: [&Pattern; 2], mesh: Mesh, voltage: f64) -> CriticalVoltage {
        let found = match mesh == self.coarse.mesh() {
            true => self.refine(pattern, voltage),
            false => self
                .near(pattern, voltage)
                .unwrap_or_else(|| CriticalVoltage::new(MeshLimit { mesh, voltage }, None)),
        };
        self.with_geometry([pattern, drawing], found)
    }

    /// Returns whether a pattern is stable at the voltage of the scene on any mesh: the voltage is below the
    /// [interval](CriticalVoltage::interval) of the critical one. Far below it, this takes one solution on the coarser
    /// mesh.
    #[must_use]
    pub fn is_certainly_stable(&self, pattern: &Pattern) -> bool {
        matches!(self.check(pattern, CoarseLimit::IfFineHasOne), StabilityCheck::Stable)
    }

    /// Returns the critical voltage of a pattern that may be unstable on a finer mesh at the voltage of the scene:
    /// `Some(None)` if it was not found, `None` if the pattern [is stable](CriticalSearch::is_certainly_stable).
    #[must_use]
    pub fn uncertain_limit(&self, pattern: &Pattern) -> Option<Option<CriticalVoltage>> {
        let found = match self.check(pattern, CoarseLimit::First) {
            StabilityCheck::Stable => return None,
            StabilityCheck::OnCoarse(voltage) => Some(self.refine(pattern, voltage)),
            StabilityCheck::OnFine(fine) => Some(CriticalVoltage::new(fine, None)),
            StabilityCheck::OnBoth(found) => Some(found),
            StabilityCheck::Unknown => None,
        };
        Some(found.map(|found| self.with_geometry([pattern; 2], found)))
    }

    /// Adds the error of geometry, if elements follow cells in place of shapes: the difference of critical voltages on
    /// one mesh. Without one on the shapes, the error is unknown.
    pub(super) fn with_geometry(&self, [pattern, drawing]: [&Pattern; 2], found: CriticalVoltage) -> CriticalVoltage {
        let own = &self.coarse.scene;
        let is_drawn = drawing.electrodes() != pattern.electrodes();
        let [on_cells, on_shapes] = match (GeometryError::scenes(own), is_drawn) {
            (Some(scenes), _) => scenes,
            (None, true) => [own, own].map(without_effects_of_cells),
            (None, false) => return found,
        };
        let MeshLimit { mesh, voltage } = found.coarse;
        let limit = |scene: &Scene, pattern: &Pattern| {
            let options = SolveOptions {
                mesh,
                tolerance: self.coarse.tolerance,
            };
            let solver = MembraneSolver::new(&scene.with_electrodes_of(pattern), options).ok()?;
            let solver = solver.within_iterations(self.coarse.limit);
            Some(solver.limit_between(pattern, search_range(voltage))?.voltage)
        };
        let on_cells = match on_cells.effects.fringe_field == own.effects.fringe_field {
            true => Some(voltage),
            false => limit(&on_cells, pattern),
        };
        let both = on_cells.zip(limit(&on_shapes, drawing));
        let on_one_mesh = both.map(|(on_cells, on_shapes)| GeometryError::between(on_cells, on_shapes));
        // Elements on cells resolve the steps of a drawn edge, which lower the limit, as long as they are refined: the
        // estimate from two meshes may be farther from the shapes than either mesh.
        let from_estimate = both
            .zip(found.error)
            .filter(|_| is_drawn)
            .map(|((on_cells, on_shapes), error)| {
                GeometryError::between(found.voltage, voltage + on_shapes - on_cells) - error
            });
        found.with_error(on_one_mesh.map(|error| error.max(from_estimate.unwrap_or(0.0))))
    }

    fn check(&self, pattern: &Pattern, order: CoarseLimit) -> StabilityCheck {
        let solution = self.coarse.solve(pattern);
        if !solution.outcome.is_converged() {
            return match solution.stable_range(self.coarse.mesh()) {
                StableRange::Lost(found) => StabilityCheck::OnCoarse(found.voltage),
                StableRange::Nowhere | StableRange::UpTo(_) => StabilityCheck::Unknown,
            };
        }
        if self.coarse.is_clear_of_loss(pattern, &solution) {
            return StabilityCheck::Stable;
        }
        let voltage = self.coarse.scene.voltage_v();
        let on_coarse = match order {
            CoarseLimit::IfFineHasOne => None,
            // No critical voltage is further below that of the coarser mesh.
            CoarseLimit::First => match self
                .coarse
                .search_from(pattern, &solution, voltage / (1.0 - MESH_OVERESTIMATE))
            {
                LimitSearch::NoLoss => return StabilityCheck::Stable,
                LimitSearch::Limit(found) => Some(found),
                LimitSearch::Nothing => None,
            },
        };
        match self
            .fine()
            .map(|fine| fine.search(pattern, [voltage, FINE_MARGIN * voltage]))
        {
            Some(LimitSearch::NoLoss) => StabilityCheck::Stable,
            Some(LimitSearch::Nothing) | None => StabilityCheck::Unknown,
            Some(LimitSearch::Limit(fine)) => {
                let search = || self.coarse.limit_between(pattern, search_range(fine.voltage));
                let Some(coarse) = on_coarse.or_else(search) else {
                    return StabilityCheck::OnFine(fine);
                };
                let found = CriticalVoltage::new(coarse, Some(fine));
                match voltage < found.interval()[0] {
                    true => StabilityCheck::Stable,
                    false => StabilityCheck::OnBoth(found),
                }
            }
        }
    }

    /// Returns the critical voltage of a pattern near an expected one in V; `None` if it is not found up to a fifth
    /// above it.
    fn near(&self, pattern: &Pattern, expected: f64) -> Option<CriticalVoltage> {
        let coarse = self.near_on_coarse(pattern, expected)?;
        Some(self.refine(pattern, coarse.voltage))
    }

    /// The same on the coarser mesh only.
    #[must_use]
    pub fn near_on_coarse(&self, pattern: &Pattern, expected: f64) -> Option<CriticalVoltage> {
        let coarse = self.coarse.limit_between(pattern, search_range(expected))?;
        Some(CriticalVoltage::new(coarse, None))
    }
}

/// Range of a search on one mesh, given the critical voltage on another.
fn search_range(voltage: f64) -> [f64; 2] {
    [0.9 * voltage, 1.2 * voltage]
}

impl MeshSolution {
    /// Returns the stable range of a pattern according to this solution.
    #[must_use]
    pub(super) fn stable_range(&self, mesh: Mesh) -> StableRange {
        match self.outcome.bracket() {
            None => StableRange::UpTo(self.last_stable),
            Some([stable, _]) if stable <= 0.0 => StableRange::Nowhere,
            Some([stable, unstable]) => {
                let voltage = 0.5 * (stable + unstable);
                StableRange::Lost(CriticalVoltage::new(MeshLimit { mesh, voltage }, None))
            }
        }
    }
}

impl MembraneSolver {
    /// Returns the critical voltage on this mesh, expected between two voltages in V, whatever the voltage of the
    /// scene. `None` if the pattern is stable up to the higher one, or nothing was found.
    #[must_use]
    pub fn limit_between(&self, pattern: &Pattern, expected: [f64; 2]) -> Option<MeshLimit> {
        match self.search(pattern, expected) {
            LimitSearch::Limit(limit) => Some(limit),
            LimitSearch::NoLoss | LimitSearch::Nothing => None,
        }
    }

    fn search(&self, pattern: &Pattern, expected: [f64; 2]) -> LimitSearch {
        let Ok((model, voltage)) = self.driven() else {
            return LimitSearch::Nothing;
        };
        let ending = model.with(SearchBetween {
            solver: self,
            activity: &model.activity(&self.grid, pattern),
            expected: expected.map(|expected| (expected / voltage).powi(2)),
        });
        self.found(ending, voltage)
    }

    /// Searches from a stable solution at the voltage of the scene up to a higher one in V.
    fn search_from(&self, pattern: &Pattern, solution: &MeshSolution, highest: f64) -> LimitSearch {
        let voltage = self.scene.voltage_v();
        let ending = self.model.with(SearchFrom {
            solver: self,
            activity: &self.model.activity(&self.grid, pattern),
            start: &solution.displacement,
            highest: (highest / voltage).powi(2),
        });
        self.found(ending, voltage)
    }

    /// Converts the end of a search; `voltage` in V belongs to the full load.
    fn found(&self, ending: LoadingEnd, voltage: f64) -> LimitSearch {
        match ending {
            LoadingEnd::Stable => LimitSearch::NoLoss,
            LoadingEnd::Unknown { .. } | LoadingEnd::WorkLimit { .. } => LimitSearch::Nothing,
            LoadingEnd::Lost { stable, unstable, .. } => LimitSearch::Limit(MeshLimit {
                mesh: self.mesh(),
                voltage: 0.5 * voltage * (stable.sqrt() + unstable.sqrt()),
            }),
        }
    }

    /// Returns whether the smallest eigenvalue at a solution is so large that no mesh is near a loss of stability.
    fn is_clear_of_loss(&self, pattern: &Pattern, solution: &MeshSolution) -> bool {
        self.model.with(IsClear {
            solver: self,
            activity: &self.model.activity(&self.grid, pattern),
            u: &solution.displacement,
        })
    }
}

/// Checks whether the load at the voltage of the scene is far below all critical loads.
struct IsLoadFar;

impl WithMaterial for IsLoadFar {
    type Output = bool;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> bool {
        let full = material(1.0);
        !full.wrinkles() && full.load() < FAR_LOAD * 0.5 * full.largest_load()
    }
}

/// When a check searches for the critical voltage on the coarser mesh.
#[derive(Clone, Copy)]
enum CoarseLimit {
    /// Before it searches on the finer mesh, which takes several times as long and is not needed far above.
    First,
    /// Only if there is one on the finer mesh.
    IfFineHasOne,
}

/// Stability of a pattern at the voltage of a scene.
enum StabilityCheck {
    /// Stable on any mesh.
    Stable,
    /// Unstable on the coarser mesh from this voltage in V.
    OnCoarse(f64),
    /// Unstable on the finer mesh, with no result on the coarser one.
    OnFine(MeshLimit),
    /// Critical voltage on both meshes too close to decide.
    OnBoth(CriticalVoltage),
    /// Unknown.
    Unknown,
}

/// Result of a search for a loss of stability.
enum LimitSearch {
    Limit(MeshLimit),
    /// Stable up to the end.
    NoLoss,
    /// Unknown.
    Nothing,
}

struct IsClear<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    u: &'a [f64],
}

impl WithMaterial for IsClear<'_> {
    type Output = bool;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> bool {
        let material = material(1.0);
        let operator = Operator::new(&material, self.activity);
        let laplacian = &self.solver.laplacian;
        let mut workspace = Workspace::new(self.u.len(), laplacian);
        probe(&operator, laplacian, CLEAR_EIGENVALUE, self.u, &mut workspace) == krylov::KrylovEnd::Converged
    }
}

struct SearchFrom<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    /// The stable state at the full load.
    start: &'a [f64],
    /// Share of the full load at which the search ends.
    highest: f64,
}

impl WithMaterial for SearchFrom<'_> {
    type Output = LoadingEnd;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> LoadingEnd {
        let mut u = self.start.to_vec();
        let mut workspace = Workspace::new(u.len(), &self.solver.laplacian);
        workspace.begin(self.solver.limit);
        let range = LoadRange {
            from: 1.0,
            to: self.highest,
            step: FIRST_STEP * (self.highest - 1.0),
        };
        let problem = self.solver.problem(self.activity, material);
        problem.raise_load(range, &mut u, &mut workspace).ending
    }
}

struct SearchBetween<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    /// Shares of the full load.
    expected: [f64; 2],
}

impl WithMaterial for SearchBetween<'_> {
    type Output = LoadingEnd;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> LoadingEnd {
        let mut u = vec![0.0; self.solver.grid.layout().vector_len()];
        let mut workspace = Workspace::new(u.len(), &self.solver.laplacian);
        workspace.begin(self.solver.limit);
        let problem = self.solver.problem(self.activity, material);
        problem.load_through(self.expected, &mut u, &mut workspace)
    }
}
