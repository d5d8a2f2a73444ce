//! Electrode resistance: charge needs time to spread from the leads.

use deaflow_base::{Resistance, parameters};

parameters! {
    /// The electrodes have a resistance: histories follow their charging.
    pub struct ElectrodeResistance as "`electrode_resistance`" {
        /// Sheet resistance of one electrode; by default that of `properties`.
        pub sheet_resistance: Resistance [0.0..=1e15],
    }
}
