//! What the artifact of a calibrate stage says, and how it is read.

use std::collections::{BTreeMap, BTreeSet};

use super::arrays;
use crate::field::CORNERS;
use crate::orchestrator::StageError;
use crate::store::{Artifact, Data, Dataset, Object};
use crate::surrogate::{COVERAGE, Calibration, CalibrationParts, DifficultyParts, FALSE_ALARM, LikenessParts};

/// The dataset that no other kind of artifact has.
const MARK: &str = "difficulty/scores";

/// The object, without model and scene.
pub fn describe(calibration: &Calibration, families: &[String], trained: &BTreeSet<String>) -> Object {
    let mut counts: BTreeMap<&str, u64> = BTreeMap::new();
    for family in families {
        *counts.entry(family).or_default() += 1;
    }
    let familiar = counts
        .keys()
        .map(|family| u64::from(trained.contains(*family)))
        .collect();
    let object = Object::default()
        .attribute("coverage", COVERAGE.to_string())
        .attribute("false_alarm", FALSE_ALARM.to_string())
        .with(
            "families",
            arrays::texts("families of the calibration", counts.keys().copied()),
        )
        .with(
            "samples",
            arrays::wholes("1", "patterns of each", counts.values().copied().collect()),
        )
        .with(
            "familiar",
            arrays::wholes("1", "1 where the model learned from the family", familiar),
        );
    let parts = calibration.parts();
    with_difficulty(with_likeness(object, parts.likeness), parts.difficulty)
        .with("residuals", residuals(parts.residuals))
}

fn residuals(values: Vec<f32>) -> Dataset {
    let rows = values.len() / (CORNERS * CORNERS * 2);
    Dataset::new(
        "mm",
        "predicted less simulated displacement of the first patterns [pattern][y][x][component]",
        &[rows, CORNERS, CORNERS, 2],
        Data::F32(values),
    )
}

fn matrix(says: &str, rows: usize, values: Vec<f64>) -> Dataset {
    let columns = values.len().checked_div(rows).unwrap_or_default();
    Dataset::new("1", says, &[rows, columns], Data::F64(values))
}

fn with_difficulty(object: Object, parts: DifficultyParts) -> Object {
    let rows = parts.scores.len();
    object
        .with(
            "difficulty/centre",
            arrays::reals("1", "mean of each feature", parts.centre),
        )
        .with(
            "difficulty/deviation",
            arrays::reals("1", "deviation of each feature", parts.deviation),
        )
        .with(
            "difficulty/range",
            arrays::reals("1", "bounds of the logarithm of the median error", parts.range),
        )
        .with(
            "difficulty/coefficients",
            arrays::reals(
                "1",
                "of the median of ln(largest error in mm), a quadratic in the scaled features",
                parts.coefficients,
            ),
        )
        .with(
            "difficulty/places",
            matrix("scaled features [pattern][feature]", rows, parts.places),
        )
        .with(
            MARK,
            arrays::reals(
                "1",
                "ln(largest error in mm) less its median, of each pattern",
                parts.scores,
            ),
        )
}

fn with_likeness(object: Object, parts: LikenessParts) -> Object {
    let (m, rows) = (parts.centre.len(), parts.spreads.len());
    object
        .with(
            "likeness/centre",
            arrays::reals("1", "mean of each feature", parts.centre),
        )
        .with(
            "likeness/deviation",
            arrays::reals("1", "deviation of each feature", parts.deviation),
        )
        .with(
            "likeness/factor",
            matrix(
                "lower Cholesky factor of the covariance of the scaled features",
                m,
                parts.factor,
            ),
        )
        .with(
            "likeness/places",
            matrix(
                "uncorrelated features of familiar patterns [pattern][feature]",
                rows,
                parts.places,
            ),
        )
        .with(
            "likeness/spreads",
            arrays::reals(
                "1",
                "mean distance of each familiar pattern to its nearest",
                parts.spreads,
            ),
        )
        .with(
            "likeness/threshold",
            arrays::reals(
                "1",
                "relative distance above which a pattern is unlike",
                vec![parts.threshold],
            ),
        )
}

/// The digest of the model that a calibration is of.
///
/// # Errors
/// When the artifact does not say.
pub fn model_of(artifact: &Artifact) -> Result<&str, StageError> {
    let missing = || StageError::Input(format!("artifact {}: it names no model", artifact.digest().short()));
    artifact.attribute("model").ok_or_else(missing)
}

/// The calibration in an artifact; none where the artifact is of another kind.
///
/// # Errors
/// When its arrays do not fit together.
pub fn read(artifact: &Artifact) -> Result<Option<Calibration>, StageError> {
    if artifact.contents()?.iter().all(|content| content.path != MARK) {
        return Ok(None);
    }
    let reals = |name: &str| -> Result<Vec<f64>, StageError> { Ok(artifact.f64s(name)?.1) };
    let parts = CalibrationParts {
        difficulty: DifficultyParts {
            centre: reals("difficulty/centre")?,
            deviation: reals("difficulty/deviation")?,
            range: reals("difficulty/range")?,
            coefficients: reals("difficulty/coefficients")?,
            places: reals("difficulty/places")?,
            scores: reals(MARK)?,
        },
        residuals: artifact.f32s("residuals")?.1,
        likeness: LikenessParts {
            centre: reals("likeness/centre")?,
            deviation: reals("likeness/deviation")?,
            factor: reals("likeness/factor")?,
            places: reals("likeness/places")?,
            spreads: reals("likeness/spreads")?,
            threshold: reals("likeness/threshold")?.first().copied().unwrap_or_default(),
        },
    };
    let calibration = Calibration::from_parts(parts);
    let wrong = |e| StageError::Input(format!("artifact {}: {e}", artifact.digest().short()));
    calibration.map(Some).map_err(wrong)
}
