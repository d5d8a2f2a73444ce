//! Homogeneous tests of an incompressible sheet that is free of stress across its thickness.

/// How a specimen is stretched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Test {
    /// Along one direction, free across: λ₂ = λ₃ = λ^(−½).
    Uniaxial,
    /// Equally along two directions: λ₂ = λ.
    Equibiaxial,
    /// Along one direction, clamped across: λ₂ = 1.
    PureShear,
}

impl Test {
    /// All tests.
    pub const ALL: [Self; 3] = [Self::Uniaxial, Self::Equibiaxial, Self::PureShear];

    /// Returns the path of the test in the plane of ln λ₁ and ln λ₂: both are in proportion to ln λ.
    #[must_use]
    pub fn path(self) -> [f64; 2] {
        match self {
            Self::Uniaxial => [1.0, -0.5],
            Self::Equibiaxial => [1.0, 1.0],
            Self::PureShear => [1.0, 0.0],
        }
    }

    /// Returns the squares of λ₁, λ₂ and λ₃ at a stretch.
    #[must_use]
    pub fn squared_stretches(self, stretch: f64) -> [f64; 3] {
        let square = stretch * stretch;
        match self {
            Self::Uniaxial => [square, 1.0 / stretch, 1.0 / stretch],
            Self::Equibiaxial => [square, square, 1.0 / (square * square)],
            Self::PureShear => [square, 1.0, 1.0 / square],
        }
    }

    /// Returns λ₁ − λ₃²/λ₁, to which the stress of the neo-Hookean law is proportional.
    pub(crate) fn shear(self, stretch: f64) -> f64 {
        let [_, _, third] = self.squared_stretches(stretch);
        stretch - third / stretch
    }

    /// Returns the name of the test.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Uniaxial => "uniaxial",
            Self::Equibiaxial => "equibiaxial",
            Self::PureShear => "pure shear",
        }
    }
}
