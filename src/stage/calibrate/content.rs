//! Writes and reads the artifact of a calibrate stage.

use std::collections::{BTreeMap, BTreeSet};

use crate::without::Dropped;
use deaflow_content as content;
use deaflow_content::{ArtifactKind, Difficulty, Novelty, SingleField};
use deaflow_orchestrator::StageError;
use deaflow_pattern::Raster;
use deaflow_scene::Scene;
use deaflow_store::{Artifact, StoreError};
use deaflow_surrogate::{COVERAGE, Calibration, CalibrationParts, DifficultyParts, FALSE_ALARM, NoveltyParts};

/// Makes a struct from the fields of the same names of another.
macro_rules! copied {
    ($from:ident => $to:ident { $($field:ident),* } $(, $other:ident: $value:expr)*) => {
        $to { $($field: $from.$field,)* $($other: $value),* }
    };
}

/// The model and the patterns of a calibration.
pub(super) struct Origin<'a> {
    /// Family of each pattern.
    pub families: &'a [String],
    /// Families that the model was trained on.
    pub trained: &'a BTreeSet<String>,
    /// The artifact of the model.
    pub model: String,
    /// BLAKE3 of the bytes of the model.
    pub weights: String,
    /// The network.
    pub network: &'a str,
    /// The rows that were left out.
    pub dropped: &'a Dropped,
    /// The scene of the patterns.
    pub scene: Scene,
}

/// Returns the content of the artifact.
pub(super) fn content(calibration: &Calibration, origin: Origin<'_>) -> content::Calibration {
    let mut counts: BTreeMap<&String, u64> = BTreeMap::new();
    for family in origin.families {
        *counts.entry(family).or_default() += 1;
    }
    let CalibrationParts {
        raster,
        difficulty,
        residuals,
        novelty,
    } = calibration.parts();
    let (dropped, without) = origin.dropped.content();
    content::Calibration {
        dropped,
        without,
        families: counts.keys().map(|family| (*family).clone()).collect(),
        samples: counts.values().copied().collect(),
        familiar: counts
            .keys()
            .map(|family| u64::from(origin.trained.contains(*family)))
            .collect(),
        difficulty: copied!(
            difficulty => Difficulty { centre, deviation, range, coefficients, scores }, places: difficulty.points
        ),
        novelty: copied!(
            novelty => Novelty { centre, deviation, factor },
            places: novelty.points, spreads: novelty.distances, threshold: [novelty.threshold]
        ),
        residuals: residuals
            .chunks_exact(2 * raster.corners())
            .map(|values| SingleField {
                raster,
                values: values.to_vec(),
            })
            .collect(),
        coverage: COVERAGE.to_string(),
        false_alarm: FALSE_ALARM.to_string(),
        model: origin.model,
        weights: origin.weights,
        network: origin.network.to_owned(),
        scene: origin.scene,
    }
}

/// A calibration with its model and patterns.
pub struct CalibratedModel {
    /// The artifact of the model.
    pub model: String,
    /// BLAKE3 of the bytes of the model.
    pub weights: String,
    /// The families of the calibration patterns.
    pub families: Vec<CalibratedFamily>,
    /// The scene of the model and the patterns.
    pub scene: Scene,
    /// The calibration itself.
    pub calibration: Calibration,
}

/// The patterns of one family in a calibration.
pub struct CalibratedFamily {
    /// The family.
    pub name: String,
    /// Number of patterns.
    pub samples: u64,
    /// Whether the model was trained on the family.
    pub familiar: bool,
}

impl CalibratedModel {
    /// Lists the families of the calibration patterns with their numbers.
    #[must_use]
    pub fn basis(&self) -> String {
        let list = |familiar: bool| {
            let named = self.families.iter().filter(|family| family.familiar == familiar);
            let named = named.map(|family| format!("{} {}", family.name, family.samples));
            named.collect::<Vec<_>>().join(", ")
        };
        match (list(true), list(false)) {
            (learned, others) if others.is_empty() => format!("{learned} (families of its training)"),
            (learned, others) => format!("{learned} (families of its training), {others} (families outside it)"),
        }
    }
}

/// Reads the artifact of a calibrate stage; `None` if it is of another kind.
///
/// # Errors
/// If its arrays are missing or inconsistent.
pub fn read(artifact: &Artifact) -> Result<Option<CalibratedModel>, StageError> {
    if !ArtifactKind::Calibrate.is_of(artifact) {
        return Ok(None);
    }
    let view = content::Calibration::open(artifact)?;
    let (names, samples) = (view.families().read()?, view.samples().read()?);
    let families = names.into_iter().zip(samples).zip(view.familiar().read()?);
    let family = |((name, samples), familiar): ((String, u64), u64)| CalibratedFamily {
        name,
        samples,
        familiar: familiar == 1,
    };
    let wrong = |e| StageError::in_artifact(artifact, e);
    Ok(Some(CalibratedModel {
        model: view.model().read()?,
        weights: view.weights().read()?,
        families: families.map(family).collect(),
        scene: view.scene().read()?,
        calibration: Calibration::from_parts(parts(&view)?).map_err(wrong)?,
    }))
}

/// Reads the arrays of the calibration itself.
fn parts(view: &content::CalibrationView<'_>) -> Result<CalibrationParts, StoreError> {
    let (difficulty, novelty) = (view.difficulty().read()?, view.novelty().read()?);
    let [threshold] = novelty.threshold;
    let residuals = view.residuals().read()?;
    Ok(CalibrationParts {
        raster: residuals.first().map_or(Raster::PAPER, |field| field.raster),
        difficulty: copied!(
            difficulty => DifficultyParts { centre, deviation, range, coefficients, scores }, points: difficulty.places
        ),
        residuals: residuals.into_iter().flat_map(|field| field.values).collect(),
        novelty: copied!(
            novelty => NoveltyParts { centre, deviation, factor },
            points: novelty.places, distances: novelty.spreads, threshold: threshold
        ),
    })
}
