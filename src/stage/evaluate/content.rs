//! What the artifact of an evaluate stage says.

use std::collections::BTreeSet;

use super::contestant::Contestant;
use super::covered::{Calibrated, Covered, OBJECTIVES};
use super::{Row, arrays};
use crate::store::{Data, Dataset, Object};
use crate::surrogate::{PatternScore, Score};

/// The name under which all families are measured together.
const ALL: &str = "all";

/// Bins of the area fraction between 0 and 1.
const BINS: f64 = 20.0;

/// The object.
pub fn describe(contestants: &[Contestant], calibrated: &[Calibrated], rows: &[Row]) -> Object {
    let known: BTreeSet<&str> = rows.iter().map(|row| row.family.as_str()).collect();
    let families: Vec<&str> = known.into_iter().chain([ALL]).collect();
    let object = Object::default()
        .with(
            "predictors",
            arrays::texts("network or method", contestants.iter().map(Contestant::name)),
        )
        .with(
            "predictor_digests",
            arrays::texts(
                "artifact of a model; empty for an estimate",
                contestants.iter().map(Contestant::digest),
            ),
        )
        .with(
            "families",
            arrays::texts(
                "families of the patterns, at last all together",
                families.iter().copied(),
            ),
        );
    let groups: Vec<Vec<&Row>> = families
        .iter()
        .map(|family| {
            rows.iter()
                .filter(|row| *family == ALL || row.family == *family)
                .collect()
        })
        .collect();
    let object = with_scores(object, "score", "family", contestants.len(), &groups);
    let object = with_areas(object, contestants.len(), rows);
    let object = with_patterns(object, contestants.len(), rows);
    match calibrated.is_empty() {
        true => object,
        false => with_coverage(object, contestants, calibrated, &groups),
    }
}

/// Scores of every contestant in every group. A group without any prediction, as an estimate may have, counts no samples.
fn with_scores(object: Object, prefix: &str, axis: &str, contestants: usize, groups: &[Vec<&Row>]) -> Object {
    let score = |k: usize, group: &[&Row]| Score::of(group.iter().filter_map(|row| row.scores[k].as_ref()));
    let scores: Vec<Option<Score>> = (0..contestants)
        .flat_map(|k| groups.iter().map(move |group| score(k, group)))
        .collect();
    let shape = [contestants, groups.len()];
    let order = format!("[predictor][{axis}]");
    let samples = scores.iter().map(|score| score.map_or(0, |s| s.samples)).collect();
    let reals = |units: &str, says: &str, value: fn(&Score) -> f64| {
        let values = scores.iter().map(|score| score.as_ref().map_or(0.0, value)).collect();
        Dataset::new(units, &format!("{says} {order}"), &shape, Data::F64(values))
    };
    object
        .with(
            &format!("{prefix}/samples"),
            Dataset::new(
                "1",
                &format!("patterns with a prediction {order}"),
                &shape,
                Data::U64(samples),
            ),
        )
        .with(
            &format!("{prefix}/rmse"),
            reals("mm", "root mean square error per component", |s| s.rmse_mm),
        )
        .with(
            &format!("{prefix}/r2"),
            reals("1", "coefficient of determination of the components", |s| s.r2),
        )
        .with(
            &format!("{prefix}/max_displacement_r2"),
            reals("1", "coefficient of determination of the largest displacement", |s| {
                s.max_r2
            }),
        )
        .with(
            &format!("{prefix}/max_error"),
            reals("mm", "largest absolute error of a component", |s| s.max_error_mm),
        )
        .with(
            &format!("{prefix}/max_displacement_error"),
            reals("mm", "largest magnitude of the error of a displacement", |s| {
                s.max_displacement_error_mm
            }),
        )
        .with(
            &format!("{prefix}/quantile95"),
            reals(
                "mm",
                "what the largest error of a pattern stays below on 95 % of them",
                |s| s.quantile95_mm,
            ),
        )
}

/// Scores by area fraction, of all families together: bins of 5 %, those that have patterns.
fn with_areas(object: Object, contestants: usize, rows: &[Row]) -> Object {
    let bin = |row: &Row| (row.area * BINS).round() as u64;
    let bins: BTreeSet<u64> = rows.iter().map(bin).collect();
    let groups: Vec<Vec<&Row>> = bins
        .iter()
        .map(|k| rows.iter().filter(|row| bin(row) == *k).collect())
        .collect();
    let centres = bins.iter().map(|&k| k as f64 / BINS).collect();
    let object = object.with(
        "area/centre",
        arrays::reals("1", "middle of each bin of the area fraction, 5 % wide", centres),
    );
    with_scores(object, "area", "bin", contestants, &groups)
}

fn with_patterns(object: Object, contestants: usize, rows: &[Row]) -> Object {
    let shape = [contestants, rows.len()];
    let reals = |says: &str, value: fn(&PatternScore) -> f64| {
        let note = format!("{says} [predictor][pattern]; 0 where there is no prediction");
        let scores = (0..contestants).flat_map(|k| rows.iter().map(move |row| row.scores[k].as_ref()));
        let values = scores.map(|score| score.map_or(0.0, value)).collect();
        Dataset::new("mm", &note, &shape, Data::F64(values))
    };
    let predicted = (0..contestants).flat_map(|k| rows.iter().map(move |row| u8::from(row.scores[k].is_some())));
    let simulated = rows.iter().map(|row| {
        let mut known = row.scores.iter().flatten();
        known.next().map_or(0.0, |score| score.simulated_max_mm)
    });
    object
        .with(
            "pattern/family",
            arrays::texts("family of each pattern", rows.iter().map(|row| row.family.as_str())),
        )
        .with(
            "pattern/area",
            arrays::reals(
                "1",
                "area fraction of each pattern",
                rows.iter().map(|row| row.area).collect(),
            ),
        )
        .with(
            "pattern/simulated_max",
            arrays::reals(
                "mm",
                "largest simulated displacement of each pattern",
                simulated.collect(),
            ),
        )
        .with(
            "pattern/predicted",
            Dataset::new(
                "1",
                "1 where there is a prediction [predictor][pattern]",
                &shape,
                Data::U8(predicted.collect()),
            ),
        )
        .with(
            "pattern/predicted_max",
            reals("largest predicted displacement", |s| s.predicted_max_mm),
        )
        .with(
            "pattern/rms",
            reals("root mean square error of a component", |s| s.rms_mm),
        )
        .with(
            "pattern/max_error",
            reals("largest absolute error of a component", |s| s.max_error_mm),
        )
}

fn with_coverage(
    object: Object,
    contestants: &[Contestant],
    calibrated: &[Calibrated],
    groups: &[Vec<&Row>],
) -> Object {
    let (n, shape) = (OBJECTIVES.len(), [calibrated.len(), groups.len()]);
    let of_groups = |value: &dyn Fn(&[Covered]) -> f64| -> Vec<f64> {
        let each = (0..calibrated.len()).flat_map(|k| {
            groups.iter().map(move |group| {
                let covered: Vec<Covered> = group.iter().map(|row| row.covered[k]).collect();
                value(&covered)
            })
        });
        each.collect()
    };
    let reals = |units: &str, says: &str, value: &dyn Fn(&[Covered]) -> f64| {
        let note = format!("{says} [calibration][family]");
        Dataset::new(units, &note, &shape, Data::F64(of_groups(value)))
    };
    let share = |covered: &[Covered], of: &dyn Fn(&Covered) -> bool| {
        covered.iter().filter(|c| of(c)).count() as f64 / covered.len() as f64
    };
    let by_objective = |units: &str, says: &str, value: &dyn Fn(&[Covered], usize) -> f64| {
        let values = (0..n).flat_map(|o| of_groups(&|covered| value(covered, o)));
        let note = format!("{says} [objective][calibration][family]");
        Dataset::new(units, &note, &[n, shape[0], shape[1]], Data::F64(values.collect()))
    };
    let of = calibrated.iter().map(|c| contestants[c.contestant].digest());
    object
        .with(
            "coverage/calibrations",
            arrays::texts(
                "artifact of each calibration",
                calibrated.iter().map(|c| c.digest.as_str()),
            ),
        )
        .with("coverage/models", arrays::texts("artifact of its model", of))
        .with(
            "coverage/objectives",
            arrays::texts("points and directions", OBJECTIVES.iter().map(|(name, _, _)| *name)),
        )
        .with(
            "coverage/field",
            reals("1", "share of patterns whose whole field lies in its band", &|c| {
                share(c, &|c| c.field)
            }),
        )
        .with(
            "coverage/radius",
            reals("mm", "median radius of the band", &|c| {
                median(c.iter().map(|c| c.radius_mm))
            }),
        )
        .with(
            "coverage/unlike",
            reals("1", "share of patterns flagged as unlike the training", &|c| {
                share(c, &|c| c.unlike)
            }),
        )
        .with(
            "coverage/objective",
            by_objective(
                "1",
                "share of patterns whose objective lies in its interval",
                &|covered, o| share(covered, &|c| c.objectives[o]),
            ),
        )
        .with(
            "coverage/objective_half_width",
            by_objective(
                "mm",
                "median half-width of the interval of an objective",
                &|covered, o| median(covered.iter().map(|c| c.half_widths_mm[o])),
            ),
        )
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or_default()
}
