//! Finds the model that somebody means: a stage of kind `train`, its artifact, or a file.

use std::path::Path;

use super::error::CliError;
use super::locate;
use crate::base::read_bounded;
use crate::content::Training;
use crate::store::Artifact;

/// A model is some hundred megabytes at most; more is another kind of file.
const MAX_BYTES: u64 = 4 << 30;

/// The bytes of the safetensors file, which an artifact of kind `train` holds as a dataset.
///
/// # Errors
/// When there is none of that name, it cannot be read, or it holds no model.
pub fn weights(model: &str, store: &Path) -> Result<Vec<u8>, CliError> {
    let path = Path::new(model);
    let artifact = match path.extension().and_then(|e| e.to_str()) {
        Some("safetensors") => return read(path),
        Some("h5") if path.is_file() => Artifact::open(path)?,
        Some("h5") => return Err(CliError::bad_input(format!("no file {}", path.display()))),
        _ => locate::artifact(&locate::existing_store(store)?, model)?,
    };
    if artifact.kind() != "train" {
        let (digest, kind) = (artifact.digest().short(), artifact.kind());
        return Err(
            CliError::bad_input(format!("artifact {digest} is no model: it is of kind `{kind}`"))
                .help("a model is what a stage of kind `train` makes"),
        );
    }
    Ok(Training::unchecked(&artifact).weights().read()?)
}

fn read(path: &Path) -> Result<Vec<u8>, CliError> {
    read_bounded(path, MAX_BYTES)
        .map_err(|error| CliError::bad_input(format!("cannot read {} as a model: {error}", path.display())))
}
