//! The kinds of artifacts.

use deaflow_base::words;
use deaflow_store::Artifact;

words! {
    /// The kind of an artifact: that of the stage that made it.
    pub enum ArtifactKind {
        /// Sampled patterns.
        Sample = "sample",
        /// Patterns from files.
        Patterns = "patterns",
        /// Solved samples.
        Solve = "solve",
        /// Solved samples from files.
        Import = "import",
        /// A balanced dataset.
        Balance = "balance",
        /// A trained network.
        Train = "train",
        /// A calibration of a network.
        Calibrate = "calibrate",
        /// An evaluation of networks.
        Evaluate = "evaluate",
        /// Measurements from files.
        Measure = "measure",
        /// A scene that was fitted to measurements.
        Fit = "fit",
        /// Measured beside simulated numbers.
        Compare = "compare",
        /// Designs.
        Design = "design",
        /// Simulated designs.
        Verify = "verify",
        /// Devices of designs under tolerances.
        Yield = "yield",
        /// Errors of methods.
        Accuracy = "accuracy",
        /// An audit of a dataset.
        Audit = "audit",
        /// A table of results.
        Table = "table",
    }
}

impl ArtifactKind {
    /// Returns the kind of an artifact; `None` if it is unknown.
    #[must_use]
    pub fn of(artifact: &Artifact) -> Option<Self> {
        Self::from_name(artifact.kind())
    }

    /// Whether an artifact is of this kind.
    #[must_use]
    pub fn is_of(self, artifact: &Artifact) -> bool {
        artifact.kind() == self.name()
    }
}
