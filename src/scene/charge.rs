//! A charge in place of a voltage.

use serde_json::json;

use deaflow_base::{Charge as Coulombs, Fields, InputError, Map, parameters};

/// Smallest and largest charge in C.
const CHARGES: std::ops::RangeInclusive<f64> = 0.0..=1e3;

parameters! {
    /// The charge that is put on the electrodes, which then are cut off: one of these.
    pub struct Charge as "`charge`" {
        /// On an electrode that conducts: it goes to where its energy is least, and all of the electrode has one voltage.
        pub total: Option<Coulombs> [CHARGES],
        /// Sprayed evenly over the electrode on the prestretched membrane, where it stays.
        pub immobile: Option<Coulombs> [CHARGES],
    }
    rules(one_of)
    check(check)
}

fn one_of(fields: Fields) -> Fields {
    fields.rule(json!({ "oneOf": [{ "required": ["total"] }, { "required": ["immobile"] }] }))
}

fn check(charge: &Charge, map: &Map<'_>) -> Result<(), InputError> {
    match charge.total.is_some() == charge.immobile.is_some() {
        true => Err(map
            .error("a charge is either `total` or `immobile`")
            .help("for example { total: 2.8 uC } or { immobile: 2.8 uC }")),
        false => Ok(()),
    }
}

impl Charge {
    /// In C.
    #[must_use]
    pub fn in_coulombs(&self) -> f64 {
        let one = self.total.as_ref().or(self.immobile.as_ref());
        one.map_or(0.0, |charge| charge.value())
    }
}
