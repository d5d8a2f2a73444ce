//! All declarations by kind of artifact or file, for the documentation.

use super::declared::Declared;
use super::{
    Accuracy, ArtifactKind, Audit, Balanced, Calibration, Comparison, Designs, Evaluation, FittedScene,
    FrequencyResponses, Histories, InflationPaths, Inflations, LoadPaths, Measurements, Samples, Solutions, SolveFile,
    Table, Training, Verification, Vibrations, Yields,
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
        ($($name:expr => $content:ty),* $(,)?) => {
            vec![$(ContentOfKind {
                name: $name,
                arrays: <$content>::declared(),
                attributes: <$content>::attributes(),
            }),*]
        };
    }
    kinds! {
        ArtifactKind::Sample.name() => Samples,
        ArtifactKind::Patterns.name() => Samples,
        ArtifactKind::Solve.name() => Solutions,
        ArtifactKind::Import.name() => Solutions,
        ArtifactKind::Balance.name() => Balanced,
        ArtifactKind::Train.name() => Training,
        ArtifactKind::Calibrate.name() => Calibration,
        ArtifactKind::Evaluate.name() => Evaluation,
        ArtifactKind::Measure.name() => Measurements,
        ArtifactKind::Fit.name() => FittedScene,
        ArtifactKind::Compare.name() => Comparison,
        ArtifactKind::Design.name() => Designs,
        ArtifactKind::Verify.name() => Verification,
        ArtifactKind::Yield.name() => Yields,
        ArtifactKind::Accuracy.name() => Accuracy,
        ArtifactKind::Audit.name() => Audit,
        ArtifactKind::Table.name() => Table,
        "the file of `deaflow solve` and `deaflow predict`" => SolveFile,
        "the file of `deaflow solve` in space" => Inflations,
        "the file of `deaflow solve --path`" => LoadPaths,
        "the file of `deaflow solve --path` under pressure" => InflationPaths,
        "the file of `deaflow solve --history`" => Histories,
        "the file of `deaflow solve --modes`" => Vibrations,
        "the file of `deaflow solve --response`" => FrequencyResponses,
    }
}
