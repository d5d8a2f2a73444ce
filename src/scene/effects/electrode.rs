//! Electrode stiffness: a layer of electrode on the prestretched membrane, free of stress when the membrane is at rest.

use deaflow_base::{Length, Stress, parameters};

parameters! {
    /// The electrodes resist stretching.
    pub struct Electrode as "`electrode_stiffness`" {
        /// Shear modulus of the electrodes.
        pub shear_modulus: Stress [0.0..=1e12],
        /// Of both together, on the prestretched membrane.
        pub thickness: Length [0.0..=1e3],
    }
}
