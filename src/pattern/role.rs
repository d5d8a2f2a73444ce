//! The roles of the patterns of a design target.

use serde::Serialize;

/// How a pattern of a target was made, from the design to make to those for comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// The best pattern of the genetic algorithm, after local search along the gradient.
    Refined,
    /// The best pattern of the genetic algorithm.
    Ga,
    /// The best pattern of gradient searches from several starts: the reference.
    Optimum,
    /// An intuitive design: the region behind the line through the point, at its own area.
    Intuitive,
    /// An intuitive design with the line moved until the area is that of the design.
    IntuitiveEqualArea,
    /// The user's own pattern, from a file.
    Own,
}

impl Role {
    /// All roles, in order.
    pub const ALL: [Self; 6] = [
        Self::Refined,
        Self::Ga,
        Self::Optimum,
        Self::Intuitive,
        Self::IntuitiveEqualArea,
        Self::Own,
    ];

    /// Returns the name in files.
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

    /// Returns the role with a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|role| role.name() == name)
    }

    /// Returns whether a search found the pattern; others were drawn for comparison.
    #[must_use]
    pub fn is_found(self) -> bool {
        matches!(self, Self::Refined | Self::Ga | Self::Optimum)
    }

    /// Returns whether a person would draw the pattern.
    #[must_use]
    pub fn is_intuitive(self) -> bool {
        matches!(self, Self::Intuitive | Self::IntuitiveEqualArea)
    }

    /// Returns whether the pattern is compared with the optimum and the intuitive designs.
    #[must_use]
    pub fn is_compared(self) -> bool {
        self.is_found() || self == Self::Own
    }

    /// Returns whether the displacement was predicted before the simulation. That of the user's own pattern was not.
    #[must_use]
    pub fn is_predicted(self) -> bool {
        self != Self::Own
    }

    /// Returns whether predictions led the search to the pattern.
    #[must_use]
    pub fn is_searched(self) -> bool {
        matches!(self, Self::Ga | Self::Refined)
    }
}
