//! Electrode resistance: charge takes its time to spread from the leads.

use deaflow_base::{Resistance, parameters};

parameters! {
    /// The electrodes resist the current from the leads: histories follow how they charge.
    pub struct ElectrodeResistance as "`electrode_resistance`" {
        /// Resistance of a square of one electrode; without it that of `properties`.
        pub sheet_resistance: Resistance [0.0..=1e15],
    }
}
