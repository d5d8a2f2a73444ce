//! Inertia: the membrane has a mass.

use deaflow_base::{Density, parameters};

parameters! {
    /// The membrane has a mass: histories are motions, not sequences of equilibria.
    pub struct Inertia as "`inertia`" {
        /// Density of the elastomer; by default that of `properties`.
        pub density: Density [1.0..=1e5],
    }
}
