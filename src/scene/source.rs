//! The electrical source that feeds the electrodes.

use deaflow_base::{Current, Fields, InputError, Map, Resistance, parameters};

parameters! {
    /// The source that feeds the electrodes: ideal with a series resistance, or with a limited current.
    pub struct Source as "`source`" {
        /// The resistance in series with the electrodes.
        pub resistance: Option<Resistance> [0.0..=1e18],
        /// The largest current into or out of the electrodes.
        pub current_limit: Option<Current> [1e-18..=1e6],
    }
    rules(one_or_both)
    check(check)
}

fn one_or_both(fields: Fields) -> Fields {
    fields.at_least_one(&["resistance", "current_limit"])
}

fn check(source: &Source, map: &Map<'_>) -> Result<(), InputError> {
    match (&source.resistance, &source.current_limit) {
        (None, None) => Err(map
            .error("a source needs a `resistance`, a `current_limit` or both")
            .help("for example { resistance: 10 MOhm } or { current_limit: 0.1 mA }")),
        _ => Ok(()),
    }
}
