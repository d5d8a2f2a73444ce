//! The search of a front in the artifact of a design stage, whose rows are the points of the front.

use super::macros::arrays;
use super::part::LongTexts;

arrays! {
    /// The points of a front, and the course of its search.
    #[derive(Default)]
    pub struct Fronts, FrontsView {
        /// Limit of each requested point, ascending: of the area, or of the charge in nC.
        limit: Vec<f64> = array("limit", "1", [limit]),
        /// What became of it: `found`, the design that is at least as good, or why there is none.
        outcome: LongTexts = array("outcome", "", [limit]),
        /// What the objective of each design gains over the membrane at rest: the displacement along the directions, or
        /// by how much the targets are nearer.
        gain: Vec<f64> = array("gain", "mm", [row]),
        /// If the second objective is the charge, the charge on the electrodes of each design.
        charge: Option<Vec<f64>> = array("charge", "nC", [row]),
        /// Area of the reference of the hypervolume, or its charge in nC; its gain is 0.
        reference: Vec<f64> = array("reference", "1", [target]),
        /// Number of simulated patterns whenever the front grew.
        simulations: Vec<u64> = array("simulations", "1", [growth]),
        /// Hypervolume of the designs so far: gain times area fraction, or gain times charge in mm nC.
        hypervolume: Vec<f64> = array("hypervolume", "mm", [growth]),
    }
}
