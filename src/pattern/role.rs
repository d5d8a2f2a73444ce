//! What a pattern is among those of a target.

use serde::Serialize;

/// How a pattern of a target came about, from the one that is to be made to those that it is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// The best of the genetic algorithm, improved along the gradient.
    Refined,
    /// The best of the genetic algorithm.
    Ga,
    /// The best that gradients find from several starts: the reference.
    Optimum,
    /// What a person would draw: the region behind the line through the point, at its own area.
    Intuitive,
    /// The same, its line moved until its area is that of the design.
    IntuitiveEqualArea,
    /// A person's own, from a file, at the area that it has.
    Own,
}

impl Role {
    /// Every role, in order.
    pub const ALL: [Self; 6] = [
        Self::Refined,
        Self::Ga,
        Self::Optimum,
        Self::Intuitive,
        Self::IntuitiveEqualArea,
        Self::Own,
    ];

    /// The word that stands in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Refined => "refined",
            Self::Ga => "ga",
            Self::Optimum => "optimum",
            Self::Intuitive => "intuitive",
            Self::IntuitiveEqualArea => "intuitive-equal-area",
            Self::Own => "own",
        }
    }

    /// The role of a word in a file.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|role| role.name() == name)
    }

    /// Whether a search found it, and nobody drew it for comparison.
    #[must_use]
    pub fn is_found(self) -> bool {
        matches!(self, Self::Refined | Self::Ga | Self::Optimum)
    }

    /// Whether it is measured against the optimum and the intuitive designs, which are there to be compared with.
    #[must_use]
    pub fn is_compared(self) -> bool {
        self.is_found() || self == Self::Own
    }

    /// Whether its displacement was predicted before it was simulated. Nobody predicted that of a person's own pattern.
    #[must_use]
    pub fn is_predicted(self) -> bool {
        self != Self::Own
    }

    /// Whether what predicts the displacement led the search to it.
    #[must_use]
    pub fn is_searched(self) -> bool {
        matches!(self, Self::Ga | Self::Refined)
    }
}
