//! `deaflow predict`: predicts the fields of patterns with a trained model.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;

use super::arguments::{PatternArguments, StoreArguments};
use super::error::CliError;
use super::output::{Exit, Output};
use super::progress::Bar;
use super::simulate::{Answer, seconds_each};
use super::{model, solve};
use crate::base::Progress;
use crate::content::{Packed, SolveFile};
use crate::field::{Field, Predictor};
use crate::pattern::Pattern;
use crate::scene::Scene;
use crate::stage::direct;
use crate::surrogate::Surrogate;

/// Predict the fields of patterns with a trained model
#[derive(Debug, Args)]
pub struct PredictArguments {
    /// A digest or its beginning, a stage of the last run, PIPELINE.yaml:STAGE, or a file
    pub model: String,
    #[command(flatten)]
    pub patterns: PatternArguments,
    /// Refuse a model for another scene than this one, or than that of a pipeline; a YAML file
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    #[command(flatten)]
    pub store: StoreArguments,
}

pub fn execute(arguments: &PredictArguments, output: &Output) -> Result<Exit, CliError> {
    solve::check_output(&arguments.patterns, &arguments.model)?;
    let scene = arguments.scene.as_deref().map(direct::read_scene).transpose()?;
    let patterns = direct::patterns(&arguments.patterns.patterns)?;
    let weights = model::weights(&arguments.model, &arguments.store.folder())?;
    let (bar, start) = (Bar::new("predict", "patterns", patterns.len() as u64), Instant::now());
    let answer = predict(&weights, &patterns, scene.as_ref(), &bar)?;
    bar.finish("done");
    let parameters = format!("model {}", arguments.model);
    solve::conclude(&arguments.patterns, &answer, ("predict", parameters), start, output)
}

/// Predicts patterns with a model given as the bytes of a safetensors file, which must be one for the scene if that is given.
///
/// # Errors
/// When the bytes are no model or one for another scene, or it cannot be evaluated.
fn predict(
    weights: &[u8],
    patterns: &[Pattern],
    scene: Option<&Scene>,
    progress: &dyn Progress,
) -> Result<Answer, CliError> {
    let refused = |e: &dyn std::fmt::Display| CliError::bad_input(format!("cannot use the model: {e}"));
    let surrogate = Surrogate::load(weights).map_err(|e| refused(&e))?;
    if let Some(scene) = scene {
        surrogate.check_scene(scene).map_err(|e| refused(&e))?;
    }
    let threads = rayon::current_num_threads();
    let (mut fields, mut seconds) = (Vec::with_capacity(patterns.len()), Vec::with_capacity(patterns.len()));
    for batch in patterns.chunks(256) {
        let start = Instant::now();
        fields.extend(surrogate.predict(batch)?);
        seconds.extend(seconds_each(start, batch.len(), threads));
        progress.advance(batch.len() as u64);
    }
    let content = SolveFile {
        patterns: patterns.to_vec(),
        outcome: vec!["predicted".to_owned(); patterns.len()],
        max_displacement: fields.iter().map(Field::max_magnitude).collect(),
        displacement: Packed(fields.iter().flat_map(Field::values).copied().collect()),
        solve_seconds: seconds,
        scene: surrogate.scene().unwrap_or_default().to_owned(),
        network: Some(surrogate.kind().name().to_owned()),
        ..SolveFile::default()
    };
    Ok(Answer {
        content: content.object(),
        samples: patterns.len(),
        unstable: Vec::new(),
        missed: Vec::new(),
        warnings: Vec::new(),
        near_limit: Vec::new(),
        wrinkled: Vec::new(),
    })
}
