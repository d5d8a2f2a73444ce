//! Prediction intervals of designs by a calibrated network, for any evaluator of the search: the predicted
//! displacement along the target directions with its interval.

use crate::calibrate::{self, CalibratedModel};
use crate::model;
use deaflow_content::{DesignInterval, DesignIntervals};
use deaflow_design::Goal;
use deaflow_field::Predictor;
use deaflow_orchestrator::StageError;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_store::Artifact;
use deaflow_surrogate::{COVERAGE, Surrogate};

/// Why a calibration cannot be used.
pub const STATES: &str = "a calibration cannot be used for a device with several states";
pub const SEVERAL: &str = "a design stage can use only one calibration";

/// A network with its calibration.
pub struct Calibrated {
    surrogate: Surrogate,
    calibration: CalibratedModel,
}

impl Calibrated {
    /// Reads the calibration among the inputs with its network; `None` if there is none.
    ///
    /// # Errors
    /// If there are several, its network is not among the inputs or has another scene, or an artifact is damaged.
    pub fn of(inputs: &[Artifact], scene: &Scene) -> Result<Option<Self>, StageError> {
        let mut found = None;
        for input in inputs {
            let Some(calibration) = calibrate::read(input)? else {
                continue;
            };
            let own = |other: &&Artifact| other.digest().to_string() == calibration.model;
            let network = inputs.iter().find(own).ok_or_else(|| {
                StageError::input(format!(
                    "calibration {} belongs to model {:.12}, which is not in `needs`",
                    input.digest().short(),
                    calibration.model
                ))
            })?;
            if !scene.states.is_empty() {
                return Err(StageError::input(STATES));
            }
            if found.is_some() {
                return Err(StageError::input(SEVERAL));
            }
            found = Some(Self {
                surrogate: model::in_scene(network, scene)?,
                calibration,
            });
        }
        Ok(found)
    }

    /// Returns the intervals of patterns.
    ///
    /// # Errors
    /// If the network cannot be evaluated.
    pub fn intervals(&self, goal: &Goal, patterns: &[Pattern]) -> Result<DesignIntervals, StageError> {
        let fields = self.surrogate.predict(patterns);
        let fields = fields.map_err(StageError::failed)?;
        let calibration = &self.calibration.calibration;
        let half_widths = calibration.objective(&|field| goal.value_mm(std::slice::from_ref(field)));
        let basis = self.calibration.basis();
        let mut intervals = DesignIntervals::default();
        for (pattern, field) in patterns.iter().zip(&fields) {
            let value = goal.value_mm(std::slice::from_ref(field));
            let half_width = half_widths.half_width(pattern, field);
            let interval = calibration.interval(pattern, field);
            intervals.push(Some(DesignInterval {
                coverage: COVERAGE,
                predicted_mm: value,
                ends_mm: [value - half_width, value + half_width],
                novelty: interval.novelty,
                out_of_distribution: interval.out_of_distribution,
                basis: basis.clone(),
            }));
        }
        Ok(intervals)
    }
}
