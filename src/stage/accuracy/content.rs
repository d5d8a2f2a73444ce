//! What the artifact of an accuracy stage says, and the file of the command: errors. Times are no content.

use super::compare::{FamilyError, Measured, PatternError, Reckoned};
use crate::stage::arrays;
use crate::store::{Data, Dataset, Object};

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

/// The object.
pub fn describe(reckoned: &Reckoned, measured: &[Measured]) -> Object {
    let families = reckoned.families.iter().map(String::as_str);
    let family = reckoned.family.iter().map(|&k| reckoned.families[k].as_str());
    let settings = measured.iter().map(|method| method.settings.as_str());
    let stable = reckoned.fields.iter().map(|field| u64::from(field.is_some()));
    let reference_errors = (0..reckoned.families.len()).map(|k| reckoned.reference_error(k));
    let object = Object::default()
        .with("methods", arrays::texts("settings of each method", settings))
        .with("families", arrays::texts("names of the families", families))
        .with(
            "patterns",
            arrays::patterns(
                "electrode patterns [pattern][y][x], origin lower left, 1 = electrode",
                &reckoned.patterns,
            ),
        )
        .with("family", arrays::texts("family of each pattern", family))
        .with(
            "reference/stable",
            arrays::wholes(
                "1",
                "1 where the reference has a stable solution, else 0",
                stable.collect(),
            ),
        )
        .with(
            "reference/pattern_error",
            arrays::reals(
                "mm",
                "error that the reference may have on each pattern; 0 where that is not known",
                reckoned.errors.clone(),
            ),
        )
        .with(
            "reference/error",
            arrays::reals("mm", "the largest of them in each family", reference_errors.collect()),
        )
        .attribute("scene", reckoned.scene.to_text())
        .attribute("reference", format!("{{ {} }}", reckoned.reference.settings()));
    with_patterns(with_families(object, reckoned, measured), reckoned, measured)
}

fn with_families(object: Object, reckoned: &Reckoned, measured: &[Measured]) -> Object {
    let shape = [measured.len(), reckoned.families.len()];
    let all = || measured.iter().flat_map(|method| &method.families);
    let reals = |note: &str, value: fn(&FamilyError) -> f64| {
        Dataset::new("mm", note, &shape, Data::F64(all().map(value).collect()))
    };
    let wholes = |note: &str, value: fn(&FamilyError) -> u64| {
        Dataset::new("1", note, &shape, Data::U64(all().map(value).collect()))
    };
    object
        .with(
            "error/rms",
            reals("root mean square error of a component [method][family]", |f| f.rms),
        )
        .with(
            "error/max",
            reals("largest displacement error over the corners [method][family]", |f| {
                f.max
            }),
        )
        .with(
            "error/bound",
            reals(
                "bound of that for patterns that were not measured [method][family]",
                |f| f.bound,
            ),
        )
        .with(
            "mismatch/missed",
            wholes("patterns with a field and no stable reference [method][family]", |f| {
                f.missed
            }),
        )
        .with(
            "mismatch/false_alarm",
            wholes(
                "patterns without a field and a stable reference [method][family]",
                |f| f.false_alarms,
            ),
        )
}

fn with_patterns(object: Object, reckoned: &Reckoned, measured: &[Measured]) -> Object {
    let shape = [measured.len(), reckoned.patterns.len()];
    let all = || measured.iter().flat_map(|method| &method.patterns);
    let reals = |note: &str, value: fn((f64, f64)) -> f64| {
        let numbers = all().map(|error| error.known().map_or(0.0, value)).collect();
        Dataset::new("mm", note, &shape, Data::F64(numbers))
    };
    let code = |error: &PatternError| match error {
        PatternError::Known { .. } => 0,
        PatternError::Missed => 1,
        PatternError::FalseAlarm => 2,
        PatternError::BothNone => 3,
    };
    let note = "0 both have a field, 1 the method alone, 2 the reference alone, 3 neither [method][pattern]";
    object
        .with(
            "pattern_error/rms",
            reals(
                "root mean square error of a component, 0 where `compared` is not [method][pattern]",
                |(rms, _)| rms,
            ),
        )
        .with(
            "pattern_error/max",
            reals(
                "largest displacement error, 0 where `compared` is not [method][pattern]",
                |(_, max)| max,
            ),
        )
        .with(
            "pattern_error/compared",
            Dataset::new("1", note, &shape, Data::U8(all().map(code).collect())),
        )
}
