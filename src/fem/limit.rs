//! The search for critical voltages on two meshes, and whether a pattern surely keeps a voltage.

use std::sync::OnceLock;

use deaflow_field::{Mesh, Order};
use deaflow_pattern::Pattern;
use deaflow_scene::{Effects, Scene};

use super::continuation::LoadingEnd;
use super::critical::{CriticalVoltage, MeshLimit};
use super::effects::{Model, Stability, WithMaterial};
use super::error::SetupError;
use super::krylov;
use super::material::Material;
use super::newton::{Workspace, probe};
use super::operator::{Activity, Operator};
use super::solver::{MembraneSolver, MeshSolution, SolveOptions};
use super::work::WorkLimit;

/// The smallest eigenvalue of the tangent against the Laplacian, on one biquadratic element per cell, above which no pattern was
/// found to be within a tenth of its critical voltage: 0.40 was the largest at it, 0.29 the smallest a tenth below it.
const CLEAR: f32 = 0.5;
/// The load in units of the critical one of a membrane that is active everywhere, below which no pattern is within a tenth of
/// its critical voltage: a single cell, which goes first, is lost at 0.30.
const FAR: f64 = 0.24;
/// The part of the usual work for a pattern that a look at whether a finer mesh could refuse it may take on each mesh.
const WATCHING: f64 = 0.25;
/// How far above a voltage the finer mesh must be stable for the voltage to be kept beyond doubt.
const ROOM: f64 = 1.08;

/// Finds critical voltages on two meshes.
pub struct CriticalSearch {
    coarse: MembraneSolver,
    /// Set up when it is first needed; `None` where it cannot be.
    fine: OnceLock<Option<MembraneSolver>>,
}

impl CriticalSearch {
    /// The search that belongs to a mesh: on that mesh where it is biquadratic and can be halved, or else on the nearest such, and on one
    /// of half the side.
    ///
    /// # Errors
    /// When an option is out of range.
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

    /// The solver on half the side.
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

    /// The search that watches over solutions on a mesh: on at most two biquadratic elements per cell and four.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn beside(scene: &Scene, options: SolveOptions) -> Result<Self, SetupError> {
        let mesh = match options.mesh.order() {
            Order::Bilinear => options.mesh,
            Order::Biquadratic => Mesh::biquadratic(options.mesh.elements_per_cell().min(2)),
        };
        let search = Self::new(scene, SolveOptions { mesh, ..options })?;
        let limit = search.coarse.scaled(WorkLimit::default().part(WATCHING));
        Ok(search.within(limit))
    }

    /// Whether no pattern loses stability anywhere near the voltage of a scene: nothing need be solved to know that all keep it.
    ///
    /// # Errors
    /// When the effects of the scene cannot be simulated.
    pub fn is_far_from_any(scene: &Scene) -> Result<bool, SetupError> {
        Ok(scene.voltage_v() <= 0.0 || Model::new(scene)?.with(Load))
    }

    /// The same of patterns that do not wrinkle at the voltage of the scene: they are those of a membrane that cannot.
    ///
    /// # Errors
    /// When the effects of the scene cannot be simulated.
    pub fn is_far_from_any_taut(scene: &Scene) -> Result<bool, SetupError> {
        let effects = Effects {
            wrinkling: None,
            ..scene.effects.clone()
        };
        Self::is_far_from_any(&scene.with_effects(effects))
    }

    /// The critical voltage of a pattern that loses stability on the coarser mesh at a voltage in V.
    #[must_use]
    pub fn refine(&self, pattern: &Pattern, on_coarse: f64) -> CriticalVoltage {
        let coarse = MeshLimit {
            mesh: self.coarse.mesh(),
            voltage: on_coarse,
        };
        let fine = self.fine();
        CriticalVoltage::new(
            coarse,
            fine.and_then(|fine| fine.limit_between(pattern, around(on_coarse))),
        )
    }

    /// The same with another limit of work for a pattern on the coarser mesh, of which each search on the finer one may take half.
    #[must_use]
    pub fn within(self, limit: WorkLimit) -> Self {
        Self {
            coarse: self.coarse.within_iterations(limit),
            fine: OnceLock::new(),
        }
    }

    /// How far a pattern is stable up to the voltage of the scene by the coarser mesh alone.
    #[must_use]
    pub fn look(&self, pattern: &Pattern) -> Stability {
        self.coarse.solve(pattern).stability(self.coarse.mesh())
    }

    /// The critical voltage of a pattern that loses stability on some mesh at a voltage in V: another than the coarser one serves to
    /// look in the right place.
    #[must_use]
    pub fn from(&self, pattern: &Pattern, mesh: Mesh, voltage: f64) -> CriticalVoltage {
        if mesh == self.coarse.mesh() {
            return self.refine(pattern, voltage);
        }
        let found = MeshLimit { mesh, voltage };
        self.near(pattern, voltage)
            .unwrap_or_else(|| CriticalVoltage::new(found, None))
    }

    /// The critical voltage of a pattern that has no stable state on the coarser mesh at the voltage of the scene.
    #[must_use]
    pub fn below_scene(&self, pattern: &Pattern) -> Option<CriticalVoltage> {
        match self.look(pattern) {
            Stability::Lost(found) => Some(self.refine(pattern, found.voltage)),
            Stability::Never | Stability::UpTo(_) => None,
        }
    }

    /// Whether a pattern is stable at the voltage of the scene whatever the mesh: that voltage lies below the
    /// [interval](CriticalVoltage::interval) of its critical one. Far below it, this takes one solution on the coarser mesh.
    #[must_use]
    pub fn keeps(&self, pattern: &Pattern) -> bool {
        matches!(self.watch(pattern), Watched::Kept)
    }

    /// The critical voltage of a pattern that a finer mesh could refuse at the voltage of the scene, without one where it was not found;
    /// `None` where the pattern [keeps](CriticalSearch::keeps) that voltage.
    #[must_use]
    pub fn doubt(&self, pattern: &Pattern) -> Option<Option<CriticalVoltage>> {
        match self.watch(pattern) {
            Watched::Kept => None,
            Watched::OnCoarse(voltage) => Some(Some(self.refine(pattern, voltage))),
            Watched::OnFine(fine) => Some(Some(CriticalVoltage::new(fine, None))),
            Watched::OnBoth(found) => Some(Some(found)),
            Watched::Nothing => Some(None),
        }
    }

    fn watch(&self, pattern: &Pattern) -> Watched {
        let solution = self.coarse.solve(pattern);
        if !solution.outcome.is_converged() {
            return match solution.stability(self.coarse.mesh()) {
                Stability::Lost(found) => Watched::OnCoarse(found.voltage),
                Stability::Never | Stability::UpTo(_) => Watched::Nothing,
            };
        }
        if self.coarse.is_clear_of_loss(pattern, &solution) {
            return Watched::Kept;
        }
        let voltage = self.coarse.scene.voltage_v();
        match self.fine().map(|fine| fine.search(pattern, [voltage, ROOM * voltage])) {
            Some(LimitSearch::NoLoss) => Watched::Kept,
            Some(LimitSearch::Nothing) | None => Watched::Nothing,
            Some(LimitSearch::Limit(fine)) => {
                let Some(coarse) = self.coarse.limit_between(pattern, around(fine.voltage)) else {
                    return Watched::OnFine(fine);
                };
                let found = CriticalVoltage::new(coarse, Some(fine));
                match voltage < found.interval()[0] {
                    true => Watched::Kept,
                    false => Watched::OnBoth(found),
                }
            }
        }
    }

    /// The critical voltage of a pattern where it is expected near a voltage in V; `None` where it is not found within a fifth above.
    fn near(&self, pattern: &Pattern, expected: f64) -> Option<CriticalVoltage> {
        let coarse = self.near_on_coarse(pattern, expected)?;
        Some(self.refine(pattern, coarse.voltage))
    }

    /// The same by the coarser mesh alone.
    #[must_use]
    pub fn near_on_coarse(&self, pattern: &Pattern, expected: f64) -> Option<CriticalVoltage> {
        let coarse = self.coarse.limit_between(pattern, around(expected))?;
        Some(CriticalVoltage::new(coarse, None))
    }
}

/// Where a loss is looked for on one mesh when another has it at a voltage.
fn around(voltage: f64) -> [f64; 2] {
    [0.9 * voltage, 1.2 * voltage]
}

impl MeshSolution {
    /// How far a pattern is stable by this solution of it.
    #[must_use]
    pub(super) fn stability(&self, mesh: Mesh) -> Stability {
        match self.outcome.bracket() {
            None => Stability::UpTo(self.last_stable),
            Some([stable, _]) if stable <= 0.0 => Stability::Never,
            Some([stable, unstable]) => {
                let voltage = 0.5 * (stable + unstable);
                Stability::Lost(CriticalVoltage::new(MeshLimit { mesh, voltage }, None))
            }
        }
    }
}

impl MembraneSolver {
    /// The loss of stability on this mesh, where it is expected between two voltages in V, whatever the voltage of the scene. `None`
    /// where it is not lost up to the higher one, or nothing is known.
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
        let ending = model.with(Between {
            solver: self,
            activity: &model.activity(&self.grid, pattern),
            expected: expected.map(|expected| (expected / voltage).powi(2)),
        });
        match ending {
            LoadingEnd::Stable => LimitSearch::NoLoss,
            LoadingEnd::Unknown { .. } | LoadingEnd::WorkLimit { .. } => LimitSearch::Nothing,
            LoadingEnd::Lost { stable, unstable, .. } => LimitSearch::Limit(MeshLimit {
                mesh: self.mesh(),
                voltage: 0.5 * voltage * (stable.sqrt() + unstable.sqrt()),
            }),
        }
    }

    /// Whether the tangent at a solution is positive definite by so much that no mesh comes near a loss of stability there.
    fn is_clear_of_loss(&self, pattern: &Pattern, solution: &MeshSolution) -> bool {
        self.model.with(Clear {
            solver: self,
            activity: &self.model.activity(&self.grid, pattern),
            u: &solution.displacement,
        })
    }
}

/// Whether the load at the scene's voltage is far below that of any loss.
struct Load;

impl WithMaterial for Load {
    type Output = bool;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> bool {
        let full = material(1.0);
        !full.wrinkles() && full.load() < FAR * 0.5 * full.largest_load()
    }
}

/// What is found of a pattern at the voltage of a scene.
enum Watched {
    /// It is stable there whatever the mesh.
    Kept,
    /// It is lost on the coarser mesh at this voltage in V.
    OnCoarse(f64),
    /// It is lost on the finer mesh alone, as far as is known.
    OnFine(MeshLimit),
    /// It is lost on both, too near to tell.
    OnBoth(CriticalVoltage),
    /// Nothing is known.
    Nothing,
}

/// What a search for a loss of stability ends with.
enum LimitSearch {
    Limit(MeshLimit),
    /// Stable up to the end.
    NoLoss,
    /// Nothing is known.
    Nothing,
}

struct Clear<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    u: &'a [f64],
}

impl WithMaterial for Clear<'_> {
    type Output = bool;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> bool {
        let operator = Operator {
            material: &material(1.0),
            activity: self.activity,
            pulled: 1.0,
        };
        let laplacian = &self.solver.laplacian;
        let mut workspace = Workspace::new(self.u.len(), laplacian);
        probe(&operator, laplacian, CLEAR, self.u, &mut workspace) == krylov::KrylovEnd::Converged
    }
}

struct Between<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    /// Shares of the full load.
    expected: [f64; 2],
}

impl WithMaterial for Between<'_> {
    type Output = LoadingEnd;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> LoadingEnd {
        let mut u = vec![0.0; self.solver.grid.layout().vector_len()];
        let mut workspace = Workspace::new(u.len(), &self.solver.laplacian);
        workspace.begin(self.solver.limit);
        let problem = self.solver.problem(self.activity, material);
        problem.load_through(self.expected, &mut u, &mut workspace)
    }
}
