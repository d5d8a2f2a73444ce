//! Where stability is lost, with an error: the losses on two meshes, extrapolated.
//!
//! A mesh makes a membrane too stiff, and it loses stability too late: smooth displacements by next to nothing, those around
//! the corners of electrodes by some per cent, because a corner is singular and the error there falls hardly faster than the
//! side of an element. How much of the difference of two meshes is still to come therefore depends on the pattern, from a
//! hundredth to nearly all of it. The estimate takes a middle share of it away, and its error spans the rest; `docs/effects.md` has the
//! patterns that the shares were found with, on eight biquadratic elements per cell.

use crate::field::{Mesh, Order};
use crate::pattern::Pattern;
use crate::scene::Scene;

use super::effects::{Model, WithMaterial};
use super::energy::Material;
use super::error::SetupError;
use super::margin::SOME_VOLTAGE;
use super::newton::Workspace;
use super::operator::Activity;
use super::solver::{MembraneSolver, SolveOptions};

/// What a mesh of half the side takes away from the voltage of the finer mesh, in units of what it took from the coarser one:
/// the middle, and how far the truth may lie on either side of it.
const STILL_TO_COME: f64 = 0.45;
const EITHER_SIDE: f64 = 0.5;
/// The part of a voltage that the searches leave open.
const SEARCHED: f64 = 1e-3;
/// The part of a voltage by which the loss on a coarse mesh alone may lie too high.
const COARSE: f64 = 0.12;

/// The voltage at which stability is lost, and how sure it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CriticalVoltage {
    /// The estimate in V.
    pub voltage: f64,
    /// How far the truth may lie on either side, in V; `None` where no finer mesh says anything.
    pub error: Option<f64>,
    /// The loss on the coarser mesh, in V.
    pub coarse: MeshLimit,
    /// That on the finer one; `None` where it was not found.
    pub fine: Option<MeshLimit>,
}

/// The loss of stability on one mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshLimit {
    /// The mesh.
    pub mesh: Mesh,
    /// In V, the middle of the two voltages between which it lies.
    pub voltage: f64,
}

impl CriticalVoltage {
    fn new(coarse: MeshLimit, fine: Option<MeshLimit>) -> Self {
        let estimate = |fine: MeshLimit| {
            let fall = coarse.voltage - fine.voltage;
            let error = EITHER_SIDE * fall.abs() + SEARCHED * fine.voltage;
            (fine.voltage - STILL_TO_COME * fall, error)
        };
        let (voltage, error) = fine
            .map(estimate)
            .map_or((coarse.voltage, None), |(voltage, error)| (voltage, Some(error)));
        Self {
            voltage,
            error,
            coarse,
            fine,
        }
    }

    /// The voltages in V between which the truth is expected. Where the error is not known the lower one is that of the
    /// worst pattern that is known.
    #[must_use]
    pub fn interval(&self) -> [f64; 2] {
        match self.error {
            Some(error) => [self.voltage - error, self.voltage + error],
            None => [(1.0 - COARSE) * self.voltage, (1.0 + SEARCHED) * self.voltage],
        }
    }
}

/// Finds critical voltages on two meshes.
pub struct CriticalSearch {
    coarse: MembraneSolver,
    fine: MembraneSolver,
}

impl CriticalSearch {
    /// The search that belongs to a mesh: on that mesh where it is biquadratic and can be halved, or else on the nearest such, and on one
    /// of half the side.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(scene: &Scene, options: SolveOptions) -> Result<Self, SetupError> {
        let on = |mesh| MembraneSolver::new(scene, SolveOptions { mesh, ..options });
        let [coarse, fine] = meshes(options.mesh);
        Ok(Self {
            coarse: on(coarse)?,
            fine: on(fine)?,
        })
    }

    /// The mesh on which a loss is to be found before it can be refined.
    #[must_use]
    pub fn coarse_mesh(&self) -> Mesh {
        self.coarse.mesh()
    }

    /// The critical voltage of a pattern that loses stability on the coarser mesh at a voltage in V.
    #[must_use]
    pub fn refine(&self, pattern: &Pattern, on_coarse: f64) -> CriticalVoltage {
        let coarse = MeshLimit {
            mesh: self.coarse.mesh(),
            voltage: on_coarse,
        };
        CriticalVoltage::new(coarse, self.fine.limit_between(pattern, around(on_coarse)))
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
        let [stable, unstable] = self.coarse.solve(pattern).outcome.bracket()?;
        (stable > 0.0).then(|| self.refine(pattern, 0.5 * (stable + unstable)))
    }

    /// The critical voltage of a pattern where it is expected near a voltage in V; `None` where it is not found within a fifth above.
    #[must_use]
    pub fn near(&self, pattern: &Pattern, expected: f64) -> Option<CriticalVoltage> {
        let coarse = self.coarse.limit_between(pattern, around(expected))?;
        Some(self.refine(pattern, coarse.voltage))
    }
}

/// Where a loss is looked for on one mesh when another has it at a voltage.
fn around(voltage: f64) -> [f64; 2] {
    [0.9 * voltage, 1.2 * voltage]
}

/// The meshes of the search that belongs to a mesh.
fn meshes(mesh: Mesh) -> [Mesh; 2] {
    let side = match mesh.order() {
        Order::Bilinear => 1,
        Order::Biquadratic => mesh.elements_per_cell().min(Mesh::MOST_ELEMENTS / 2),
    };
    [side, 2 * side].map(Mesh::biquadratic)
}

impl MembraneSolver {
    /// The loss of stability on this mesh, where it is expected between two voltages in V, whatever the voltage of the scene. `None`
    /// where it is not lost up to the higher one, or nothing is known.
    #[must_use]
    pub fn limit_between(&self, pattern: &Pattern, expected: [f64; 2]) -> Option<MeshLimit> {
        let (model, voltage) = match self.scene.voltage_v() {
            0.0 => (Model::new(&self.scene.at_voltage(SOME_VOLTAGE)).ok()?, SOME_VOLTAGE),
            voltage => (self.model.clone(), voltage),
        };
        let shares: [f64; 2] = model.with(Between {
            solver: self,
            activity: &model.activity(self.mesh, pattern),
            expected: expected.map(|expected| (expected / voltage).powi(2)),
        })?;
        let [stable, unstable] = shares.map(|share| share.sqrt() * voltage);
        Some(MeshLimit {
            mesh: self.mesh,
            voltage: 0.5 * (stable + unstable),
        })
    }
}

struct Between<'a> {
    solver: &'a MembraneSolver,
    activity: &'a Activity,
    /// Shares of the full load.
    expected: [f64; 2],
}

impl WithMaterial for Between<'_> {
    type Output = Option<[f64; 2]>;

    fn run<L: Material, F: Fn(f64) -> L + Sync>(self, material: F) -> Self::Output {
        let mut u = vec![0.0; self.solver.mesh.vector_len()];
        let mut workspace = Workspace::new(u.len(), &self.solver.laplacian);
        let problem = self.solver.problem(self.activity, material);
        problem.loss_between(self.expected, &mut u, &mut workspace)
    }
}
