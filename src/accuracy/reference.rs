//! Reference solutions on a fine mesh, and their remaining error.
//!
//! If halving the elements at least halves the error, the error of the finer of two solutions is at most their
//! difference. Displacements of electrodes with corners converge at a rate of at least about 1.5, so this holds with a
//! margin.

use std::path::Path;

use super::candidate::Candidate;
use super::error::AccuracyError;
use deaflow_base::{Document, InputError, Node, Progress};
use deaflow_fem::screening::resolve;
use deaflow_fem::{
    AccurateSimulation, AccurateSolver, GeometryError, GeometryErrors, Method, SetupError, SolverParameters,
    history_check,
};
use deaflow_field::{Field, Mesh, Order};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;

/// A reference: the settings of its solver.
pub struct Reference(SolverParameters);

impl Reference {
    /// Reads the settings in an artifact of a solve stage.
    ///
    /// # Errors
    /// When they are invalid, or cannot be those of a reference.
    pub fn from_text(text: &str) -> Result<Self, InputError> {
        Self::read(&Document::from_text(Path::new("solver"), text)?.root)
    }

    /// Reads the keys of a solve stage.
    ///
    /// # Errors
    /// When they are invalid, or cannot be those of a reference.
    pub fn read(node: &Node) -> Result<Self, InputError> {
        let map = node.fields("the reference", &SolverParameters::keys())?;
        let parameters = SolverParameters::read(&map, Mesh::bilinear(2))?;
        Self::new(parameters).map_err(|why| node.error(why.to_string()))
    }

    /// Builds a reference from solver parameters.
    ///
    /// # Errors
    /// When they cannot be those of a reference.
    pub fn new(parameters: SolverParameters) -> Result<Self, AccuracyError> {
        if parameters.method() != Method::Newton {
            return Err(AccuracyError::ReferenceMethod(parameters.method()));
        }
        if parameters.mesh() == Some(Mesh::bilinear(1)) {
            return Err(AccuracyError::CoarsestReference);
        }
        Ok(Self(parameters))
    }

    /// Checks whether the reference can measure the errors of methods.
    ///
    /// # Errors
    /// When a method is not coarser.
    pub fn check<'a>(&self, candidates: impl IntoIterator<Item = &'a Candidate>) -> Result<(), AccuracyError> {
        match candidates
            .into_iter()
            .find(|candidate| !candidate.is_coarser_than(&self.0))
        {
            None => Ok(()),
            Some(fine) => Err(AccuracyError::NotCoarser {
                settings: fine.settings(),
                reference: self.0.to_string(),
            }),
        }
    }

    /// Returns a warning if the accuracy of a method may need a finer mesh than that of the reference.
    #[must_use]
    pub fn warning<'a>(&self, candidates: impl IntoIterator<Item = &'a Candidate>) -> Option<String> {
        let mut candidates = candidates.into_iter();
        let finer = candidates.find(|candidate| candidate.may_be_finer_than(&self.0))?;
        Some(format!(
            "{{ {} }} may need a finer mesh than the reference {{ {} }}, whose error is then what is measured: use a \
             reference with {} elements per cell of order 2",
            finer.settings(),
            self.0,
            AccurateSolver::finest_mesh().elements_per_cell()
        ))
    }

    /// Checks whether the reference can be solved in a scene, without setting up the solver.
    ///
    /// # Errors
    /// When the history of the scene cannot be simulated.
    pub fn check_scene(&self, scene: &Scene) -> Result<(), AccuracyError> {
        match self.0.time() {
            Some(_) => Ok(history_check(&resolve(scene)?)?),
            None => Ok(()),
        }
    }

    /// Returns the settings.
    #[must_use]
    pub fn settings(&self) -> &SolverParameters {
        &self.0
    }

    /// Solves patterns on the reference's mesh: the displacements from rest, `None` where there is no stable solution,
    /// and the errors that they may still have in mm.
    ///
    /// # Errors
    /// When a solver cannot be set up.
    pub fn solve(
        &self,
        scene: &Scene,
        patterns: &[Pattern],
        progress: &dyn Progress,
    ) -> Result<(Vec<Option<Field>>, Vec<f64>), SetupError> {
        let solver = self.0.build(scene)?;
        let mut results = Vec::with_capacity(patterns.len());
        for batch in patterns.chunks(rayon::current_num_threads()) {
            results.extend(solver.simulate(batch)?);
            progress.advance(batch.len() as u64);
        }
        let estimates: Option<Vec<f64>> = results.iter().map(|result| result.discretisation_error).collect();
        let fields: Vec<Option<Field>> = results.iter().map(|result| result.simulation.stroke()).collect();
        let errors = match estimates {
            Some(estimates) => estimates,
            None => self.errors(scene, patterns, &fields)?,
        };
        Ok((fields, errors))
    }

    /// Returns the errors of geometry of patterns, which all methods have; `None` if elements follow all shapes.
    /// `drawings` are the patterns as drawn, where cells stand for shapes.
    ///
    /// # Errors
    /// When the solvers cannot be set up.
    pub fn geometry_errors(
        &self,
        scene: &Scene,
        patterns: &[Pattern],
        drawings: &[Pattern],
    ) -> Result<Option<Vec<GeometryError>>, SetupError> {
        let has_drawings = !drawings.is_empty() && drawings != patterns;
        let errors = GeometryErrors::new(scene, &self.0, has_drawings)?;
        errors.map(|errors| errors.estimates(patterns, drawings)).transpose()
    }

    /// Returns the error that each field may still have in mm: its difference from the next coarser mesh, or 0 if one
    /// of the two has no field. If an accuracy chose the meshes, its own estimates are used instead.
    ///
    /// # Errors
    /// When the coarser solver cannot be set up.
    pub fn errors(
        &self,
        scene: &Scene,
        patterns: &[Pattern],
        fields: &[Option<Field>],
    ) -> Result<Vec<f64>, SetupError> {
        let Some(coarser) = self.0.mesh().map(next_coarser) else {
            return Ok(vec![0.0; patterns.len()]);
        };
        let coarse = SolverParameters::new(Method::Newton, coarser);
        let coarse = match self.0.time() {
            Some(time) => coarse.up_to(time),
            None => coarse,
        };
        let coarse = coarse.build(scene)?.simulate(patterns)?;
        let error = |(coarse, fine): (&AccurateSimulation, &Option<Field>)| match (coarse.simulation.stroke(), fine) {
            (Some(coarse), Some(fine)) => coarse.max_difference(fine),
            _ => 0.0,
        };
        Ok(coarse.iter().zip(fields).map(error).collect())
    }
}

/// Returns the mesh with half as many elements along a side, rounded down, or the lower order for one element per cell.
fn next_coarser(mesh: Mesh) -> Mesh {
    match mesh.elements_per_cell() {
        0 | 1 => Mesh::new(1, Order::Bilinear),
        elements => Mesh::new(elements / 2, mesh.order()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::Raster;

    struct Silent;

    impl Progress for Silent {
        fn advance(&self, _steps: u64) {}
        fn note(&self, _text: &str) {}
    }

    #[test]
    fn the_next_coarser_mesh_is_half_as_fine() {
        for (mesh, coarser) in [
            (Mesh::biquadratic(8), Mesh::biquadratic(4)),
            (Mesh::bilinear(3), Mesh::bilinear(1)),
            (Mesh::biquadratic(1), Mesh::bilinear(1)),
            (Mesh::bilinear(2), Mesh::bilinear(1)),
        ] {
            assert_eq!(next_coarser(mesh), coarser);
        }
    }

    #[test]
    fn unsuitable_references_are_rejected() {
        for (text, said) in [
            ("{ method: linear }", "Newton's method"),
            ("{ method: newton, elements_per_cell: 1, order: 1 }", "too coarse"),
            ("{ metod: newton }", "unknown key"),
        ] {
            let refusal = Reference::from_text(text)
                .err()
                .map(|e| e.to_string())
                .unwrap_or_default();
            assert!(refusal.contains(said), "{text}: {refusal}");
        }
        assert!(Reference::from_text("{ method: newton, elements_per_cell: 8, order: 2 }").is_ok());
    }

    #[test]
    fn the_stated_error_covers_that_of_the_reference() {
        let patterns: Vec<Pattern> = [3, 5, 10]
            .map(|n| Pattern::from_fn(Raster::PAPER, |x, y| (x / n * 7 + y / n * 11) % 13 < 6))
            .into();
        let scene = Scene::vhb4910();
        let reference = Reference::new(SolverParameters::new(Method::Newton, Mesh::bilinear(2))).unwrap();
        let (fields, stated) = reference.solve(&scene, &patterns, &Silent).unwrap();
        let finer = Reference::new(SolverParameters::new(Method::Newton, Mesh::biquadratic(2))).unwrap();
        let (truth, _) = finer.solve(&scene, &patterns, &Silent).unwrap();
        for (i, stated) in stated.iter().enumerate() {
            let error = fields[i].as_ref().unwrap().max_difference(truth[i].as_ref().unwrap());
            assert!(error <= *stated && *stated < 6.0 * error, "{i}: {error:e} {stated:e}");
        }
    }
}
