//! What simulations say beside the displacement: the effects that are on, and the mesh where one was picked.

use super::element::{Packed, PerCell};
use super::macros::arrays;
use crate::field::Observation;
use crate::pattern::Raster;
use crate::scene::Effects;

arrays! {
    /// What effects say: an array for each effect that is on, none for those that are off.
    #[derive(Default)]
    pub struct Observations, ObservationsView {
        /// Largest true field over the breakdown field, E/E_B; the membrane fails at 1.
        breakdown_ratio: Option<Vec<f64>> = array("breakdown_ratio", "1", [sample]),
        /// How each cell bears its load: 0 taut, 1 wrinkled, 2 slack, 255 no stable solution.
        wrinkling: Option<Packed<PerCell<u8>>> = array("wrinkling", "1", [sample, y, x]),
        /// Part of the membrane whose cells are wrinkled or slack; NaN where there is no stable solution.
        wrinkled_fraction: Option<Vec<f64>> = array("wrinkled_fraction", "1", [sample]),
        /// Smallest eigenvalue of the tangent relative to the Laplacian; zero where stability is lost.
        smallest_eigenvalue: Option<Vec<f64>> = array("smallest_eigenvalue", "1", [sample]),
        /// Voltages between which stability is lost on the mesh of the solution, a finer one loses it earlier; 0, 0 where it is not lost up to 3 times the limit of a fully active membrane.
        critical_voltage: Option<Vec<[f64; 2]>> = array("critical_voltage", "V", [sample, bound]),
    }
}

arrays! {
    /// The mesh that was picked for each sample to reach an accuracy.
    #[derive(Default)]
    pub struct Meshes, MeshesView {
        /// Estimated largest error of the displacement over the corners; NaN where there is none.
        discretisation_error: Vec<f64> = array("discretisation_error", "mm", [sample]),
        /// Elements along one side of a cell.
        elements_per_cell: Vec<u64> = array("elements_per_cell", "1", [sample]),
        /// Polynomial order of the elements.
        order: Vec<u64> = array("order", "1", [sample]),
    }
}

/// The state of a cell where there is no stable solution.
pub const NO_STATE: u8 = 255;

impl Observations {
    /// What the effects of a scene say of some samples; NaN where a sample has no solution.
    #[must_use]
    pub fn of(effects: &Effects, raster: Raster, samples: &[Option<&Observation>]) -> Self {
        let floats = |value: &dyn Fn(&Observation) -> Option<f64>| -> Vec<f64> {
            let value = |sample: &Option<&Observation>| sample.and_then(value).unwrap_or(f64::NAN);
            samples.iter().map(value).collect()
        };
        let (wrinkling, stability) = (
            effects.wrinkling.is_some(),
            effects.electromechanical_stability.is_some(),
        );
        let breakdown = effects.dielectric_breakdown.is_some();
        Self {
            breakdown_ratio: breakdown.then(|| floats(&|o| o.breakdown_ratio)),
            wrinkling: wrinkling.then(|| states(samples, raster)),
            wrinkled_fraction: wrinkling.then(|| floats(&|o| Some(wrinkled_fraction(o.tension.as_ref()?)))),
            smallest_eigenvalue: stability.then(|| floats(&|o| o.smallest_eigenvalue)),
            critical_voltage: stability.then(|| {
                let bracket = |o: &Option<&Observation>| o.and_then(|o| o.critical_voltage).unwrap_or_default();
                samples.iter().map(bracket).collect()
            }),
        }
    }
}

fn wrinkled_fraction(tension: &[u8]) -> f64 {
    tension.iter().filter(|&&state| state > 0).count() as f64 / tension.len() as f64
}

fn states(samples: &[Option<&Observation>], raster: Raster) -> Packed<PerCell<u8>> {
    let mut states = Vec::with_capacity(samples.len() * raster.cells());
    for sample in samples {
        match sample.and_then(|o| o.tension.as_ref()) {
            Some(tension) => states.extend(tension),
            None => states.extend(std::iter::repeat_n(NO_STATE, raster.cells())),
        }
    }
    Packed(states)
}
