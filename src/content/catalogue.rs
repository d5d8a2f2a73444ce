//! Everything that is declared, by kind of artifact or file: what the documentation shows.

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
    /// Its attributes: their names and what they are.
    pub attributes: Vec<(&'static str, &'static str)>,
}

/// All kinds of artifacts, and the files of commands.
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
