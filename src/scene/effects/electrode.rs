//! Electrode stiffness: a layer on the prestretched membrane, without stress in the undeflected membrane.

use deaflow_base::{Length, Stress, parameters};

parameters! {
    /// The electrodes resist stretching.
    pub struct Electrode as "`electrode_stiffness`" {
        /// Shear modulus of the electrodes.
        pub shear_modulus: Stress [0.0..=1e12],
        /// Thickness of both electrodes together, on the prestretched membrane.
        pub thickness: Length [0.0..=1e3],
    }
}
