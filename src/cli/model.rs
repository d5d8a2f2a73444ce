//! Finds the model that somebody means: a stage of kind `train`, its artifact, or a file.

use std::path::Path;

use super::{CliError, locate};
use deaflow_base::read_bounded;
use deaflow_content::Training;
use deaflow_store::Artifact;

/// A model is some hundred megabytes at most; more is another kind of file.
const MAX_BYTES: u64 = 4 << 30;

/// The bytes of the safetensors file, which an artifact of kind `train` holds as a dataset.
///
/// # Errors
/// When there is none of that name, it cannot be read, or it holds no model.
pub fn weights(model: &str, store: &Path) -> Result<Vec<u8>, CliError> {
    if extension(model) == Some("safetensors") {
        return read(Path::new(model));
    }
    let artifact = of_kind(model, store, "train", "model")?;
    Ok(Training::unchecked(&artifact).weights().read()?)
}

/// Whether a file is meant, and not what a store has.
pub fn is_file(reference: &str) -> bool {
    matches!(extension(reference), Some("safetensors" | "h5"))
}

fn extension(reference: &str) -> Option<&str> {
    Path::new(reference).extension()?.to_str()
}

/// The artifact of a kind in a file or in the store.
///
/// # Errors
/// When there is none of that name, it cannot be read, or it is of another kind.
pub fn of_kind(reference: &str, store: &Path, kind: &str, what: &str) -> Result<Artifact, CliError> {
    locate::check_stage_is_named(reference, Some(kind))?;
    let path = Path::new(reference);
    let artifact = match extension(reference) {
        Some("h5") if path.is_file() => Artifact::open(path)?,
        Some("h5") => return Err(CliError::bad_input(format!("no file {}", path.display()))),
        _ => locate::artifact(&locate::existing_store(store)?, reference)?,
    };
    if artifact.kind() == kind {
        return Ok(artifact);
    }
    let (digest, found) = (artifact.digest().short(), artifact.kind());
    Err(
        CliError::bad_input(format!("artifact {digest} is no {what}: it is of kind `{found}`"))
            .help(format!("a {what} is what a stage of kind `{kind}` makes")),
    )
}

fn read(path: &Path) -> Result<Vec<u8>, CliError> {
    read_bounded(path, MAX_BYTES)
        .map_err(|error| CliError::bad_input(format!("cannot read {} as a model: {error}", path.display())))
}
