//! All declarations by kind of artifact or file, for the documentation.

use super::declared::Declared;
use super::{
    Accuracy, Audit, Balanced, Calibration, Designs, Evaluation, FrequencyResponses, Histories, LoadPaths, Samples,
    Solutions, SolveFile, Table, Training, Verification, Vibrations,
};

/// The content of a kind of artifact or file.
#[derive(Clone, Debug)]
pub struct ContentOfKind {
    /// The kind of stage, or the command that writes the file.
    pub name: &'static str,
    /// Its arrays.
    pub arrays: Vec<Declared>,
    /// Names and descriptions of its attributes.
    pub attributes: Vec<(&'static str, &'static str)>,
}

/// Returns the content of all kinds of artifacts and of the files of commands.
#[must_use]
pub fn catalogue() -> Vec<ContentOfKind> {
    macro_rules! kinds {
        ($($name:literal: $content:ty),* $(,)?) => {
            vec![$(ContentOfKind {
                name: $name,
                arrays: <$content>::declared(),
                attributes: <$content>::attributes(),
            }),*]
        };
    }
    kinds! {
        "sample": Samples,
        "patterns": Samples,
        "solve": Solutions,
        "import": Solutions,
        "balance": Balanced,
        "train": Training,
        "calibrate": Calibration,
        "evaluate": Evaluation,
        "design": Designs,
        "verify": Verification,
        "accuracy": Accuracy,
        "audit": Audit,
        "table": Table,
        "the file of `deaflow solve` and `deaflow predict`": SolveFile,
        "the file of `deaflow solve --path`": LoadPaths,
        "the file of `deaflow solve --history`": Histories,
        "the file of `deaflow solve --modes`": Vibrations,
        "the file of `deaflow solve --response`": FrequencyResponses,
    }
}
