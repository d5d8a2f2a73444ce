//! A charge as the drive, instead of a voltage.

use deaflow_base::{Charge as Coulombs, Fields, InputError, Map, parameters};

/// Smallest and largest charge in C.
const CHARGES: std::ops::RangeInclusive<f64> = 0.0..=1e3;

parameters! {
    /// The charge of the electrodes, which are then disconnected: one of these.
    pub struct Charge as "`charge`" {
        /// On conducting electrodes: it moves to minimise the energy, so that all of the electrode has one voltage.
        pub total: Option<Coulombs> [CHARGES],
        /// Sprayed uniformly on the electrodes of the prestretched membrane, where it stays.
        pub immobile: Option<Coulombs> [CHARGES],
    }
    rules(one_of)
    check(check)
}

fn one_of(fields: Fields) -> Fields {
    fields.exactly_one(&["total", "immobile"])
}

fn check(charge: &Charge, map: &Map<'_>) -> Result<(), InputError> {
    match charge.total.is_some() == charge.immobile.is_some() {
        true => Err(map
            .error("a charge must be either `total` or `immobile`")
            .help("for example { total: 2.8 uC } or { immobile: 2.8 uC }")),
        false => Ok(()),
    }
}

impl Charge {
    /// Returns the charge in C.
    #[must_use]
    pub fn in_coulombs(&self) -> f64 {
        let given = self.total.as_ref().or(self.immobile.as_ref());
        given.map_or(0.0, |charge| charge.value())
    }
}
