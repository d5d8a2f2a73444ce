//! `deaflow predict`: predicts the fields of patterns with a trained model.

use std::path::Path;
use std::time::Instant;

use super::arguments::PredictArguments;
use super::error::CliError;
use super::output::{Exit, Output};
use super::progress::Bar;
use super::{locate, solve};
use crate::base::read_bounded;
use crate::stage::direct;
use crate::store::Artifact;

/// A model is some hundred megabytes at most; more is another kind of file.
const MAX_BYTES: u64 = 4 << 30;

pub fn execute(arguments: &PredictArguments, output: &Output) -> Result<Exit, CliError> {
    solve::check_output(&arguments.patterns, &arguments.model)?;
    let patterns = direct::patterns(&arguments.patterns.patterns)?;
    let weights = weights(arguments)?;
    let (bar, start) = (Bar::new("predict", "patterns", patterns.len() as u64), Instant::now());
    let answer = direct::predict(&weights, &patterns, &bar)?;
    bar.finish("done");
    let parameters = format!("model {}", arguments.model);
    solve::conclude(&arguments.patterns, &answer, ("predict", parameters), start, output)
}

/// The bytes of the safetensors file, which an artifact of kind `train` holds as its dataset `weights`.
fn weights(arguments: &PredictArguments) -> Result<Vec<u8>, CliError> {
    let path = Path::new(&arguments.model);
    let artifact = match path.extension().and_then(|e| e.to_str()) {
        Some("safetensors") => return read(path),
        Some("h5") if path.is_file() => Artifact::open(path)?,
        Some("h5") => return Err(CliError::bad_input(format!("no file {}", path.display()))),
        _ => locate::artifact(&locate::existing_store(&arguments.store.folder())?, &arguments.model)?,
    };
    if artifact.contents()?.iter().all(|content| content.path != "weights") {
        let digest = artifact.digest().short();
        return Err(
            CliError::bad_input(format!("artifact {digest} is no model: it has no dataset `weights`"))
                .help("a model is what a stage of kind `train` makes"),
        );
    }
    Ok(artifact.u8s("weights")?.1)
}

fn read(path: &Path) -> Result<Vec<u8>, CliError> {
    read_bounded(path, MAX_BYTES)
        .map_err(|error| CliError::bad_input(format!("cannot read {} as a model: {error}", path.display())))
}
