//! Results of simulations besides the displacement: those of effects, rigid bodies, and the chosen mesh.

use super::element::{Packed, PerBody, PerCell};
use super::macros::arrays;
use deaflow_field::{Charged, Field, Motion, Observation};
use deaflow_pattern::Raster;
use deaflow_scene::{Effects, Scene};

arrays! {
    /// Results of the effects that are on, and the motion of rigid bodies.
    #[derive(Default)]
    pub struct Observations, ObservationsView {
        /// Largest true field over the breakdown field, E/E_B; the membrane fails at 1.
        breakdown_ratio: Option<Vec<f64>> = array("breakdown_ratio", "1", [sample]),
        /// State of each cell: 0 taut, 1 wrinkled, 2 slack, 255 no stable solution.
        wrinkling: Option<Packed<PerCell<u8>>> = array("wrinkling", "1", [sample, y, x]),
        /// Fraction of the membrane whose cells are wrinkled or slack; NaN without a stable solution.
        wrinkled_fraction: Option<Vec<f64>> = array("wrinkled_fraction", "1", [sample]),
        /// Smallest eigenvalue of the tangent relative to the Laplacian; 0 at the loss of stability.
        smallest_eigenvalue: Option<Vec<f64>> = array("smallest_eigenvalue", "1", [sample]),
        /// Voltages between which stability is lost on the mesh of the solution (earlier on a finer one); 0, 0 if it is
        /// not lost up to 3 times the limit of a fully active membrane.
        critical_voltage: Option<Vec<[f64; 2]>> = array("critical_voltage", "V", [sample, bound]),
        /// Displacement of the centroid of each rigid body; NaN without a stable solution.
        body_translation: Option<Packed<PerBody<[f64; 2]>>> = array("body_translation", "mm", [sample, body, xy]),
        /// Rotation of each rigid body, from -180 to 180, counterclockwise; NaN without a stable solution.
        body_rotation: Option<Packed<PerBody<f64>>> = array("body_rotation", "deg", [sample, body]),
        /// Displacement of the middle of each bar, in the order left, right, bottom, top; NaN without a stable solution.
        bar_translation: Option<Packed<PerBody<[f64; 2]>>> = array("bar_translation", "mm", [sample, bar, xy]),
        /// Rotation of each bar, from -180 to 180, counterclockwise; NaN without a stable solution.
        bar_rotation: Option<Packed<PerBody<f64>>> = array("bar_rotation", "deg", [sample, bar]),
        /// Force of the left, right, lower and upper side on the membrane; 0 along components that a side does not hold,
        /// NaN without a stable solution. A corner that two sides hold counts half for each.
        reaction: Option<Packed<PerBody<[f64; 2]>>> = array("reaction", "N", [sample, side, xy]),
        /// Displacement at the cell corners at 0 V, with all loads; NaN without a stable solution.
        rest: Option<Packed<Field>> = array("rest", "mm", [sample, corner_y, corner_x, xy]),
        /// If the drive is a charge, the charge of the solution or of the last stable state; 0 without an electrode,
        /// NaN without a stable state.
        charge: Option<Vec<f64>> = array("charge", "C", [sample]),
        /// The voltage of conducting electrodes at this charge.
        voltage: Option<Vec<f64>> = array("voltage", "V", [sample]),
        /// Number of negative eigenvalues of the tangent at constant voltage: past a fold the membrane would snap
        /// through.
        negative_at_voltage: Option<Vec<u64>> = array("negative_at_voltage", "1", [sample]),
        /// Number of negative eigenvalues at constant charge.
        negative_at_charge: Option<Vec<u64>> = array("negative_at_charge", "1", [sample]),
    }
}

arrays! {
    /// The mesh that was chosen for each sample to reach an accuracy.
    #[derive(Default)]
    pub struct Meshes, MeshesView {
        /// Estimated largest error of the displacement over the corners; NaN if unknown.
        discretisation_error: Vec<f64> = array("discretisation_error", "mm", [sample]),
        /// Estimated largest difference of the displacement from that with the shapes of frame, bodies and electrodes,
        /// where elements follow cells instead; NaN if unknown.
        geometry_error: Option<Vec<f64>> = array("geometry_error", "mm", [sample]),
        /// Elements along one side of a cell.
        elements_per_cell: Vec<u64> = array("elements_per_cell", "1", [sample]),
        /// Polynomial order of the elements.
        order: Vec<u64> = array("order", "1", [sample]),
    }
}

/// The state of a cell without a stable solution.
pub const NO_STATE: u8 = 255;

impl Observations {
    /// Collects the results of effects and bodies of some samples; NaN for a sample without a solution.
    #[must_use]
    pub fn of(effects: &Effects, scene: &Scene, samples: &[Option<&Observation>]) -> Self {
        let raster = scene.membrane().raster;
        let bodies = scene
            .geometry
            .bodies
            .as_ref()
            .map(|bodies| motions(samples, bodies.len(), |o| o.bodies.as_ref()));
        let sides = scene.geometry.sides.as_ref();
        let bars = sides.map_or(0, |sides| sides.bars().count());
        let bars = (bars > 0).then(|| motions(samples, bars, |o| o.bars.as_ref()));
        let floats = |value: &dyn Fn(&Observation) -> Option<f64>| -> Vec<f64> {
            let value = |sample: &Option<&Observation>| sample.and_then(value).unwrap_or(f64::NAN);
            samples.iter().map(value).collect()
        };
        let (wrinkling, stability) = (
            effects.wrinkling.is_some(),
            effects.electromechanical_stability.is_some(),
        );
        let breakdown = effects.dielectric_breakdown.is_some();
        let charged = scene.drive.charge.as_ref();
        let conducts = charged.is_some_and(|charge| charge.total.is_some());
        let counts = |value: &dyn Fn(&Charged) -> usize| {
            let of =
                |sample: &Option<&Observation>| sample.and_then(|o| o.charged.as_ref()).map_or(0, |c| value(c) as u64);
            samples.iter().map(of).collect()
        };
        Self {
            breakdown_ratio: breakdown.then(|| floats(&|o| o.breakdown_ratio)),
            wrinkling: wrinkling.then(|| states(samples, raster)),
            wrinkled_fraction: wrinkling.then(|| floats(&Observation::wrinkled_fraction)),
            smallest_eigenvalue: stability.then(|| floats(&|o| o.smallest_eigenvalue)),
            critical_voltage: stability.then(|| {
                let bracket = |o: &Option<&Observation>| o.and_then(|o| o.critical_voltage).unwrap_or_default();
                samples.iter().map(bracket).collect()
            }),
            body_translation: bodies.as_deref().map(translations),
            body_rotation: bodies.as_deref().map(rotations),
            bar_translation: bars.as_deref().map(translations),
            bar_rotation: bars.as_deref().map(rotations),
            reaction: sides.map(|_| {
                let of = |sample: &Option<&Observation>| sample.and_then(|o| o.reactions).unwrap_or([[f64::NAN; 2]; 4]);
                Packed(samples.iter().flat_map(of).flatten().collect())
            }),
            rest: sides.map(|_| Packed(at_rest(samples, raster))),
            charge: charged.is_some().then(|| floats(&|o| o.charged.map(|c| c.charge))),
            voltage: conducts.then(|| floats(&|o| o.charged.and_then(|c| c.voltage))),
            negative_at_voltage: conducts.then(|| counts(&|c| c.negative_at_voltage)),
            negative_at_charge: conducts.then(|| counts(&|c| c.negative_at_charge)),
        }
    }
}

/// Returns the motions of all bodies or bars, sample by sample.
fn motions(
    samples: &[Option<&Observation>],
    count: usize,
    own: impl Fn(&Observation) -> Option<&Vec<Motion>>,
) -> Vec<Motion> {
    let none = Motion {
        translation: [f64::NAN; 2],
        rotation: f64::NAN,
    };
    let of = |sample: &Option<&Observation>| sample.and_then(&own).cloned().unwrap_or_else(|| vec![none; count]);
    samples.iter().flat_map(of).collect()
}

/// Packs the translations of motions.
#[must_use]
pub fn translations(motions: &[Motion]) -> Packed<PerBody<[f64; 2]>> {
    Packed(motions.iter().flat_map(|motion| motion.translation).collect())
}

/// Packs the rotations of motions.
#[must_use]
pub fn rotations(motions: &[Motion]) -> Packed<PerBody<f64>> {
    Packed(motions.iter().map(|motion| motion.rotation).collect())
}

/// Returns the displacements without voltage, sample by sample.
fn at_rest(samples: &[Option<&Observation>], raster: Raster) -> Vec<f64> {
    let of = |sample: &Option<&Observation>| match sample.and_then(|o| o.rest.as_ref()) {
        Some(rest) => rest.values().to_vec(),
        None => vec![f64::NAN; 2 * raster.corners()],
    };
    samples.iter().flat_map(of).collect()
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
