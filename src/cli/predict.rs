//! `deaflow predict`: predicts the fields of patterns with a trained model.

use std::path::PathBuf;
use std::time::Instant;

use clap::Args;

use super::arguments::{PatternArguments, StoreArguments};
use super::error::CliError;
use super::output::{Exit, Output};
use super::progress::Bar;
use super::{model, solve};
use crate::stage::direct;

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
    let answer = direct::predict(&weights, &patterns, scene.as_ref(), &bar)?;
    bar.finish("done");
    let parameters = format!("model {}", arguments.model);
    solve::conclude(&arguments.patterns, &answer, ("predict", parameters), start, output)
}
