//! Simulates a row of a dataset again, as an audit does.

use super::source::Source;
use deaflow_dataset::audit::{Discretisation, REFERENCE};
use deaflow_fem::{Method, SceneSimulators, SolveOptions, SolverParameters};
use deaflow_field::{Mesh, Simulation, SimulatorError, SimulatorKind, Simulators};
use deaflow_orchestrator::StageError;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_store::Artifact;

/// Simulates a row of a dataset again.
pub struct Resimulator {
    /// The mesh of its label, if known.
    pub mesh: Option<Mesh>,
    /// The finer mesh on which an audit determines its error; `None` if the label's is the finest.
    pub finer: Option<Mesh>,
    simulators: SceneSimulators,
}

impl Resimulator {
    /// For a row of an artifact in its scene; `made_by` is the summary of an audit that has found the mesh of a dataset
    /// without one.
    ///
    /// # Errors
    /// If the artifact cannot be read, or its scene cannot be simulated.
    pub fn new(artifact: &Artifact, scene: &Scene, row: usize, made_by: Option<&str>) -> Result<Self, StageError> {
        let source = Source::of_artifact(artifact, scene.membrane().raster)?;
        if !source.is_readable() {
            let finding = source.findings.iter().map(|finding| finding.message.clone()).next();
            return Err(StageError::input(finding.unwrap_or_default()));
        }
        let mesh = match source.declared {
            Discretisation::Mesh(mesh) | Discretisation::Estimates(mesh) => Some(mesh),
            Discretisation::PerRow => source.columns.mesh.as_ref().and_then(|meshes| meshes.get(row).copied()),
            Discretisation::Unknown => made_by.and_then(mesh_in),
        };
        let solver = source.solver.as_ref();
        let method = solver.map_or(Method::Newton, SolverParameters::method);
        let tolerance = solver.map_or(SolveOptions::default().tolerance, SolverParameters::tolerance);
        let simulators = source.simulators(scene, method, tolerance);
        Ok(Self {
            mesh,
            finer: mesh.map_or(Some(REFERENCE), Mesh::finer),
            simulators: simulators.map_err(StageError::failed)?,
        })
    }

    /// Simulates the pattern on the mesh of its label by the method of its label; `None` if the mesh is not known.
    ///
    /// # Errors
    /// If the simulator cannot be set up.
    pub fn as_labelled(&self, pattern: &Pattern) -> Result<Option<Simulation>, SimulatorError> {
        let kind = self.mesh.map(SimulatorKind::AsDeclared);
        kind.map(|kind| self.simulate(kind, pattern)).transpose()
    }

    /// Simulates the pattern on the finer mesh, if there is one.
    ///
    /// # Errors
    /// If the simulator cannot be set up.
    pub fn on_finer(&self, pattern: &Pattern) -> Result<Option<Simulation>, SimulatorError> {
        let kind = self.finer.map(SimulatorKind::Newton);
        kind.map(|kind| self.simulate(kind, pattern)).transpose()
    }

    fn simulate(&self, kind: SimulatorKind, pattern: &Pattern) -> Result<Simulation, SimulatorError> {
        let simulator = self.simulators.simulator(kind)?;
        Ok(simulator.simulate(std::slice::from_ref(pattern)).swap_remove(0))
    }
}

/// Parses the mesh in the summary of an audit: `elements_per_cell: 2, order: 1`.
fn mesh_in(summary: &str) -> Option<Mesh> {
    let number = |key: &str| {
        let rest = summary.split_once(key)?.1.trim_start();
        rest.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
    };
    Mesh::from_numbers(number("elements_per_cell:")?, number("order:")?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mesh_is_parsed_from_the_summary_of_an_audit() {
        assert_eq!(
            mesh_in("elements_per_cell: 2, order: 1 (found out)"),
            Some(Mesh::bilinear(2))
        );
        assert_eq!(
            mesh_in("estimates, elements_per_cell: 1, order: 2"),
            Some(Mesh::biquadratic(1))
        );
        assert_eq!(mesh_in("a mesh for each row"), None);
        assert_eq!(mesh_in("elements_per_cell: 99, order: 1"), None);
    }
}
