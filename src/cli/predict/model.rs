//! A trained model, and its predictions as arrays: what `deaflow predict` writes, and what the Python package returns.

use std::path::PathBuf;
use std::time::Instant;

use super::calibration::{self, NamedCalibration};
use super::intervals::Intervals;
use crate::arguments::StoreArguments;
use crate::job::seconds_each;
use crate::{CliError, model};
use deaflow_base::{Digest, Progress};
use deaflow_content::{Packed, SolveFile};
use deaflow_field::{Field, OutcomeKind, Predictor};
use deaflow_pattern::{Pattern, PatternForm};
use deaflow_scene::Scene;
use deaflow_surrogate::{COVERAGE, Surrogate};

/// Patterns that are predicted between two reports of progress.
const BATCH: usize = 256;

/// A trained model.
pub struct Model {
    /// As it was named.
    name: String,
    /// As its calibration was named, if it was.
    calibration: Option<String>,
    surrogate: Surrogate,
    /// The digest of its safetensors file.
    weights: String,
    store: PathBuf,
}

/// The predictions of a model for some patterns.
pub struct Predictions {
    /// The predicted displacement of each pattern.
    pub fields: Vec<Field>,
    /// The computing time of each pattern, s.
    seconds: Vec<f64>,
    /// The intervals of the error, if the model has a calibration.
    pub(super) intervals: Option<Intervals>,
}

impl Model {
    /// Reads a model: a stage of the last run, `PIPELINE.yaml:STAGE`, a digest or its first digits, or a file. Its
    /// calibration is named in the same way; by default it is that of the last run. Without a `store` it is that of the
    /// command.
    ///
    /// # Errors
    /// When the model does not exist, cannot be read, or is not a model.
    pub fn read(name: &str, calibration: Option<String>, store: Option<PathBuf>) -> Result<Self, CliError> {
        let named = name.to_owned();
        let store = StoreArguments::of(store).folder_of_any([&named].into_iter().chain(&calibration));
        Self::read_from(name, calibration, store)
    }

    /// As [`Model::read`], from the folder of a store.
    pub(super) fn read_from(name: &str, calibration: Option<String>, store: PathBuf) -> Result<Self, CliError> {
        let weights = model::weights(name, &store)?;
        Ok(Self {
            name: name.to_owned(),
            calibration,
            surrogate: Surrogate::load(&weights).map_err(|why| refused(&why))?,
            weights: Digest::of(&weights).to_string(),
            store,
        })
    }

    /// Checks that the model was trained for a scene.
    ///
    /// # Errors
    /// When it was trained for another one.
    pub fn check_scene(&self, scene: &Scene) -> Result<(), CliError> {
        self.surrogate.check_scene(scene).map_err(|why| refused(&why))
    }

    /// Returns the form of its patterns.
    #[must_use]
    pub fn form(&self) -> PatternForm {
        self.surrogate.form()
    }

    /// Returns the scene that it was trained for, in YAML; `None` if the file does not say.
    #[must_use]
    pub fn scene(&self) -> Option<&str> {
        self.surrogate.scene()
    }

    /// Returns the kind of its network.
    #[must_use]
    pub fn network(&self) -> &'static str {
        self.surrogate.kind().name()
    }

    /// Returns the digest of its safetensors file.
    pub(super) fn weights(&self) -> &str {
        &self.weights
    }

    /// Returns the calibration for predictions with some objectives; `None` if the model has none.
    ///
    /// # Errors
    /// When the named artifact is not a calibration of this model, or objectives need a calibration and there is none.
    pub(super) fn calibration(&self, objectives: &[String]) -> Result<Option<NamedCalibration>, CliError> {
        let model = (self.name.as_str(), self.weights.as_str());
        let found = calibration::find(model, self.calibration.as_deref(), &self.store)?;
        match found.is_none() && !objectives.is_empty() {
            true => Err(
                CliError::bad_input("--objective needs a calibration, and this model has none")
                    .help("name the result of a stage of kind `calibrate` with --calibration"),
            ),
            false => Ok(found),
        }
    }

    /// Predicts the displacement of patterns, with intervals if the model has a calibration; also those of objectives
    /// in YAML.
    ///
    /// # Errors
    /// When a pattern is not one of the model, or the calibration or an objective cannot be used.
    pub fn predict(
        &self,
        patterns: &[Pattern],
        objectives: &[String],
        progress: &dyn Progress,
    ) -> Result<Predictions, CliError> {
        let calibration = self.calibration(objectives)?;
        self.predict_with(patterns, calibration, objectives, progress)
    }

    /// As [`Model::predict`], with a calibration that was found.
    pub(super) fn predict_with(
        &self,
        patterns: &[Pattern],
        calibration: Option<NamedCalibration>,
        objectives: &[String],
        progress: &dyn Progress,
    ) -> Result<Predictions, CliError> {
        let (mut fields, mut seconds) = (Vec::with_capacity(patterns.len()), Vec::with_capacity(patterns.len()));
        for batch in patterns.chunks(BATCH) {
            CliError::if_interrupted()?;
            let start = Instant::now();
            fields.extend(self.surrogate.predict(batch)?);
            seconds.extend(seconds_each(start, batch.len()));
            progress.advance(batch.len() as u64);
        }
        let of = |calibration| Intervals::of(calibration, objectives, patterns, &fields);
        let intervals = calibration.map(of).transpose()?;
        Ok(Predictions {
            fields,
            seconds,
            intervals,
        })
    }

    /// Returns the arrays of predictions for patterns.
    #[must_use]
    pub fn content(&self, patterns: &[Pattern], predictions: &Predictions) -> SolveFile {
        let Predictions {
            fields,
            seconds,
            intervals,
        } = predictions;
        let intervals = intervals.as_ref();
        SolveFile {
            patterns: patterns.to_vec(),
            outcome: vec![OutcomeKind::Predicted; patterns.len()],
            max_displacement: fields.iter().map(Field::max_magnitude).collect(),
            displacement: Packed(fields.iter().flat_map(Field::values).copied().collect()),
            solve_seconds: seconds.clone(),
            scene: self.scene().unwrap_or_default().to_owned(),
            network: Some(self.network().to_owned()),
            intervals: intervals.map(Intervals::content),
            coverage: intervals.map(|_| COVERAGE.to_string()),
            calibration: intervals.map(Intervals::digest),
            basis: intervals.map(Intervals::basis),
            ..SolveFile::default()
        }
    }
}

fn refused(why: &dyn std::fmt::Display) -> CliError {
    CliError::bad_input(format!("cannot use the model: {why}"))
}
