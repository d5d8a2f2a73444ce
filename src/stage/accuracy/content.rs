//! The artifact of an accuracy stage, and the file of the command: errors. Times are not part of it.

use deaflow_accuracy::{Benchmark, Comparison, FamilyError, Measured};
use deaflow_content::{Accuracy, FamilyErrors, Mismatches, PatternErrors, ReferenceErrors};

/// Returns the content of the artifact.
pub fn content(benchmark: &Benchmark, measured: &[Measured]) -> Accuracy {
    let families = 0..benchmark.families.len();
    Accuracy {
        methods: measured.iter().map(|method| method.settings.clone()).collect(),
        families: benchmark.families.clone(),
        patterns: benchmark.patterns.clone(),
        family: benchmark
            .family
            .iter()
            .map(|&k| benchmark.families[k].clone())
            .collect(),
        reference: ReferenceErrors {
            stable: benchmark
                .fields
                .iter()
                .map(|field| u64::from(field.is_some()))
                .collect(),
            pattern_error: benchmark.errors.clone(),
            error: families.map(|k| benchmark.reference_error(k)).collect(),
            geometry_error: benchmark
                .geometry
                .as_ref()
                .map(|errors| errors.iter().map(|error| error.mm().unwrap_or(f64::NAN)).collect()),
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
                Comparison::Known { .. } => 0,
                Comparison::Missed => 1,
                Comparison::FalseAlarm => 2,
                Comparison::BothNone => 3,
            }),
        },
        scene: benchmark.scene.clone(),
        settings: format!("{{ {} }}", benchmark.reference.settings()),
    }
}

fn of_families<T>(measured: &[Measured], value: fn(&FamilyError) -> T) -> Vec<T> {
    measured.iter().flat_map(|method| &method.families).map(value).collect()
}

fn of_patterns<T>(measured: &[Measured], value: fn(&Comparison) -> T) -> Vec<T> {
    measured.iter().flat_map(|method| &method.patterns).map(value).collect()
}
