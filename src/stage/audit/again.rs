//! A row of a dataset simulated again, as an audit of it does.

use super::source::Source;
use deaflow_dataset::audit::{Discretisation, REFERENCE};
use deaflow_fem::{Method, SceneSimulators, SolveOptions, SolverParameters};
use deaflow_field::{Mesh, Simulation, SimulatorError, SimulatorKind, Simulators};
use deaflow_orchestrator::StageError;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_store::Artifact;

/// How a row of a dataset is simulated again.
pub struct Again {
    /// The mesh of its label; none where that is not known.
    pub mesh: Option<Mesh>,
    /// The mesh on which an audit looks at its error; none where that of the label is the finest.
    pub finer: Option<Mesh>,
    simulators: SceneSimulators,
}

impl Again {
    /// What the pattern does on the mesh of its label, by the method of its label; none where the mesh is not known.
    ///
    /// # Errors
    /// When the simulator cannot be set up.
    pub fn as_labelled(&self, pattern: &Pattern) -> Result<Option<Simulation>, SimulatorError> {
        let kind = self.mesh.map(SimulatorKind::AsDeclared);
        kind.map(|kind| self.simulate(kind, pattern)).transpose()
    }

    /// What the pattern does on the finer mesh; none where there is none.
    ///
    /// # Errors
    /// When the simulator cannot be set up.
    pub fn on_finer(&self, pattern: &Pattern) -> Result<Option<Simulation>, SimulatorError> {
        let kind = self.finer.map(SimulatorKind::Newton);
        kind.map(|kind| self.simulate(kind, pattern)).transpose()
    }

    fn simulate(&self, kind: SimulatorKind, pattern: &Pattern) -> Result<Simulation, SimulatorError> {
        let simulator = self.simulators.simulator(kind)?;
        Ok(simulator.simulate(std::slice::from_ref(pattern)).swap_remove(0))
    }
}

/// How a row of an artifact is simulated again in its scene, as an audit of it does; `made_by` is what such an audit has found out about the
/// mesh of an artifact that does not say it.
///
/// # Errors
/// When the artifact cannot be read, or its scene not be simulated.
pub fn again(artifact: &Artifact, scene: &Scene, row: usize, made_by: Option<&str>) -> Result<Again, StageError> {
    let source = Source::of_artifact(artifact, scene.membrane().raster)?;
    let found_out = made_by.and_then(mesh_in);
    let mesh = match source.declared {
        Discretisation::Mesh(mesh) | Discretisation::Estimates(mesh) => Some(mesh),
        Discretisation::PerRow => source.columns.mesh.as_ref().and_then(|meshes| meshes.get(row).copied()),
        Discretisation::Unknown => found_out,
    };
    let solver = source.solver.as_ref();
    let method = solver.map_or(Method::Newton, SolverParameters::method);
    let tolerance = solver.map_or(SolveOptions::default().tolerance, SolverParameters::tolerance);
    let failed = StageError::failed;
    let simulators = SceneSimulators::new(scene, method, tolerance).map_err(failed)?;
    Ok(Again {
        mesh,
        finer: mesh.map_or(Some(REFERENCE), Mesh::finer),
        simulators: match solver {
            Some(solver) => simulators.through(solver),
            None => simulators,
        },
    })
}

/// The mesh that a summary names: `elements_per_cell: 2, order: 1`.
fn mesh_in(words: &str) -> Option<Mesh> {
    let number = |key: &str| {
        let rest = words.split_once(key)?.1.trim_start();
        rest.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
    };
    Mesh::from_numbers(number("elements_per_cell:")?, number("order:")?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mesh_is_read_from_what_an_audit_has_found_out() {
        let mesh = |words| mesh_in(words);
        assert_eq!(
            mesh("elements_per_cell: 2, order: 1 (found out)"),
            Some(Mesh::bilinear(2))
        );
        assert_eq!(
            mesh("estimates, elements_per_cell: 1, order: 2"),
            Some(Mesh::biquadratic(1))
        );
        assert_eq!(mesh("a mesh for each row"), None);
        assert_eq!(mesh("elements_per_cell: 99, order: 1"), None);
    }
}
