//! The kind of an outcome, without its voltages or times: the word in files.

use serde::{Serialize, Serializer};

use deaflow_base::words;

words! {
    /// How the computation of a displacement field ended.
    pub enum OutcomeKind {
        /// A stable equilibrium was found.
        Converged = "converged",
        /// An estimate; its stability is unknown.
        Estimated = "estimated",
        /// A prediction of a surrogate; its stability is unknown.
        Predicted = "predicted",
        /// The estimate failed.
        NoEstimate = "no-estimate",
        /// There is no stable equilibrium under the pressure or at the volume.
        LimitPoint = "limit-point",
        /// The membrane snaps through.
        PullIn = "pull-in",
        /// Rank-one convexity is lost.
        NotElliptic = "not-elliptic",
        /// All tension is lost somewhere.
        Slack = "slack",
        /// The membrane snaps through after some time.
        DelayedPullIn = "delayed-pull-in",
        /// All tension is lost somewhere after some time.
        DelayedSlack = "delayed-slack",
        /// The limit of iterations was reached.
        IterationLimit = "iteration-limit",
        /// The limit of work was reached.
        WorkLimit = "work-limit",
    }
}

impl OutcomeKind {
    /// Whether there is a field.
    #[must_use]
    pub fn has_field(self) -> bool {
        matches!(self, Self::Converged | Self::Estimated | Self::Predicted)
    }
}

impl Serialize for OutcomeKind {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl std::fmt::Display for OutcomeKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}
