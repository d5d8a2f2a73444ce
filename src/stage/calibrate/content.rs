//! What the artifact of a calibrate stage says, and how it is read.

use std::collections::{BTreeMap, BTreeSet};

use crate::content::{self, Difficulty, Novelty, Packed};
use crate::orchestrator::StageError;
use crate::scene::Scene;
use crate::store::Artifact;
use crate::surrogate::{COVERAGE, Calibration, CalibrationParts, DifficultyParts, FALSE_ALARM, NoveltyParts};

/// What a calibration is of.
pub struct Origin<'a> {
    /// Family of each pattern.
    pub families: &'a [String],
    /// Families that the model learned from.
    pub trained: &'a BTreeSet<String>,
    /// The artifact of the model.
    pub model: String,
    /// The network.
    pub network: &'a str,
    /// The scene of the patterns.
    pub scene: Scene,
}

/// The content of the artifact.
pub fn content(calibration: &Calibration, origin: Origin<'_>) -> content::Calibration {
    let mut counts: BTreeMap<&String, u64> = BTreeMap::new();
    for family in origin.families {
        *counts.entry(family).or_default() += 1;
    }
    let CalibrationParts {
        difficulty,
        residuals,
        novelty,
    } = calibration.parts();
    content::Calibration {
        families: counts.keys().map(|family| (*family).clone()).collect(),
        samples: counts.values().copied().collect(),
        familiar: counts
            .keys()
            .map(|family| u64::from(origin.trained.contains(*family)))
            .collect(),
        difficulty: Difficulty {
            centre: difficulty.centre,
            deviation: difficulty.deviation,
            range: difficulty.range,
            coefficients: difficulty.coefficients,
            places: difficulty.places,
            scores: difficulty.scores,
        },
        novelty: Novelty {
            centre: novelty.centre,
            deviation: novelty.deviation,
            factor: novelty.factor,
            places: novelty.places,
            spreads: novelty.spreads,
            threshold: [novelty.threshold],
        },
        residuals: Packed(residuals),
        coverage: COVERAGE.to_string(),
        false_alarm: FALSE_ALARM.to_string(),
        model: origin.model,
        network: origin.network.to_owned(),
        scene: origin.scene,
    }
}

/// The digest of the model that a calibration is of, and the calibration; none where the artifact is of another kind.
///
/// # Errors
/// When its arrays do not fit together.
pub fn read(artifact: &Artifact) -> Result<Option<(String, Calibration)>, StageError> {
    if artifact.kind() != "calibrate" {
        return Ok(None);
    }
    let view = content::Calibration::open(artifact)?;
    let (difficulty, novelty) = (view.difficulty().read()?, view.novelty().read()?);
    let [threshold] = novelty.threshold;
    let parts = CalibrationParts {
        difficulty: DifficultyParts {
            centre: difficulty.centre,
            deviation: difficulty.deviation,
            range: difficulty.range,
            coefficients: difficulty.coefficients,
            places: difficulty.places,
            scores: difficulty.scores,
        },
        residuals: view.residuals().read()?.0,
        novelty: NoveltyParts {
            centre: novelty.centre,
            deviation: novelty.deviation,
            factor: novelty.factor,
            places: novelty.places,
            spreads: novelty.spreads,
            threshold,
        },
    };
    let wrong = |e| StageError::Input(format!("artifact {}: {e}", artifact.digest().short()));
    let calibration = Calibration::from_parts(parts).map_err(wrong)?;
    Ok(Some((view.model().read()?, calibration)))
}
