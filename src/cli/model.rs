//! Finds a model: a stage of kind `train`, its artifact, or a file.

use std::path::Path;

use super::{CliError, locate};
use deaflow_base::read_bounded;
use deaflow_content::{ArtifactKind, Training};
use deaflow_store::{Artifact, RowFile};

/// The largest model, bytes. Larger files are not models.
const MAX_BYTES: u64 = 4 << 30;

/// Returns the bytes of the safetensors file, which an artifact of kind `train` contains as a dataset.
///
/// # Errors
/// When it does not exist, cannot be read, or is not a model.
pub fn weights(model: &str, store: &Path) -> Result<Vec<u8>, CliError> {
    if extension(model) == Some("safetensors") {
        return read(Path::new(model));
    }
    let artifact = of_kind(model, store, ArtifactKind::Train, "model")?;
    Ok(Training::unchecked(&artifact).weights().read()?)
}

/// Whether a reference names a file instead of an artifact of a store.
pub fn is_file(reference: &str) -> bool {
    matches!(extension(reference), Some("safetensors" | "h5"))
}

fn extension(reference: &str) -> Option<&str> {
    Path::new(reference).extension()?.to_str()
}

/// Opens an artifact of a kind, in a file or in the store; `what` describes it.
///
/// # Errors
/// When it does not exist, cannot be read, or is of another kind.
pub fn of_kind(reference: &str, store: &Path, kind: ArtifactKind, what: &str) -> Result<Artifact, CliError> {
    locate::check_stage_is_named(reference, Some(kind.name()))?;
    let path = Path::new(reference);
    let artifact = match extension(reference) {
        Some("h5") if path.is_file() => {
            refuse_displacements(path, kind, what)?;
            Artifact::open(path)?
        }
        Some("h5") => return Err(CliError::bad_input(format!("there is no file {}", path.display()))),
        _ => locate::artifact(&locate::existing_store(store)?, reference)?,
    };
    if kind.is_of(&artifact) {
        return Ok(artifact);
    }
    let (digest, found) = (artifact.digest().short(), artifact.kind());
    Err(
        CliError::bad_input(format!("artifact {digest} of kind `{found}` is not a {what}"))
            .help(format!("name a stage of kind `{}`", kind.name())),
    )
}

/// Whether a file is one of `deaflow solve` or `deaflow predict`, which is no artifact; as one it would be damaged.
/// What is no HDF5 file is left to the reader of artifacts.
pub fn is_displacements(path: &Path) -> bool {
    let has = |name| matches!(RowFile::open(path).and_then(|file| file.shape(name)), Ok(Some(_)));
    !Artifact::is_at(path) && has("displacement")
}

/// Refuses a file of displacements.
fn refuse_displacements(path: &Path, kind: ArtifactKind, what: &str) -> Result<(), CliError> {
    match is_displacements(path) {
        true => Err(
            CliError::bad_input(format!("{} is a file of displacements, not a {what}", path.display()))
                .help(format!("name a stage of kind `{}`, or a file of it", kind.name())),
        ),
        false => Ok(()),
    }
}

fn read(path: &Path) -> Result<Vec<u8>, CliError> {
    read_bounded(path, MAX_BYTES)
        .map_err(|error| CliError::bad_input(format!("cannot read {} as a model: {error}", path.display())))
}
