//! What the artifact of an accuracy stage says, and the file of the command: errors. Times are no content.

use super::compare::{FamilyError, Measured, PatternError, Reckoned};
use crate::content::{Accuracy, FamilyErrors, Mismatches, PatternErrors, ReferenceErrors};

/// The name under which the seconds per pattern of a method on a family are noted.
pub fn measurement(settings: &str, family: &str) -> String {
    format!("{settings}; {family}")
}

/// Every time that was measured, by name.
pub fn measurements(reckoned: &Reckoned, measured: &[Measured]) -> Vec<(String, f64)> {
    let of_method = |method: &Measured| {
        let pairs = reckoned.families.iter().zip(&method.seconds);
        let named = pairs.map(|(family, seconds)| (measurement(&method.settings, family), *seconds));
        let batch = method
            .batch
            .map(|(size, seconds)| (measurement(&method.settings, &format!("{size} patterns")), seconds));
        named.chain(batch).collect::<Vec<_>>()
    };
    measured.iter().flat_map(of_method).collect()
}

/// What is said of the methods.
pub fn content(reckoned: &Reckoned, measured: &[Measured]) -> Accuracy {
    let families = 0..reckoned.families.len();
    Accuracy {
        methods: measured.iter().map(|method| method.settings.clone()).collect(),
        families: reckoned.families.clone(),
        patterns: reckoned.patterns.clone(),
        family: reckoned.family.iter().map(|&k| reckoned.families[k].clone()).collect(),
        reference: ReferenceErrors {
            stable: reckoned.fields.iter().map(|field| u64::from(field.is_some())).collect(),
            pattern_error: reckoned.errors.clone(),
            error: families.map(|k| reckoned.reference_error(k)).collect(),
        },
        error: FamilyErrors {
            rms: of_families(measured, |f| f.rms),
            max: of_families(measured, |f| f.max),
            bound: of_families(measured, |f| f.bound),
        },
        mismatch: Mismatches {
            missed: of_families(measured, |f| f.missed),
            false_alarm: of_families(measured, |f| f.false_alarms),
        },
        pattern_error: PatternErrors {
            rms: of_patterns(measured, |error| error.known().map_or(0.0, |(rms, _)| rms)),
            max: of_patterns(measured, |error| error.known().map_or(0.0, |(_, max)| max)),
            compared: of_patterns(measured, |error| match error {
                PatternError::Known { .. } => 0,
                PatternError::Missed => 1,
                PatternError::FalseAlarm => 2,
                PatternError::BothNone => 3,
            }),
        },
        scene: reckoned.scene.clone(),
        settings: format!("{{ {} }}", reckoned.reference.settings()),
    }
}

fn of_families<T>(measured: &[Measured], value: fn(&FamilyError) -> T) -> Vec<T> {
    measured.iter().flat_map(|method| &method.families).map(value).collect()
}

fn of_patterns<T>(measured: &[Measured], value: fn(&PatternError) -> T) -> Vec<T> {
    measured.iter().flat_map(|method| &method.patterns).map(value).collect()
}
