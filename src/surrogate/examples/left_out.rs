//! Labels that nobody should learn from, and why.

use std::fmt;

/// A label that was left out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// Which input, from 0.
    pub input: usize,
    /// Which of its rows, from 0.
    pub row: usize,
    /// The displacement that shows it, mm; 0 where it is not a number.
    pub found_mm: f64,
    /// What is wrong.
    pub why: Why,
}

/// What is wrong with a label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Why {
    /// A value is no number.
    NotFinite,
    /// The frame moves.
    Frame,
    /// A displacement beyond the side of the membrane, mm.
    BeyondSide(f64),
    /// A displacement beyond all that the training labels make believable, mm.
    Outlier(f64),
    /// The simulation did not converge.
    NotConverged,
    /// It was verified, and an image of the pattern is held out for validation or test.
    HeldOut,
}

impl Why {
    /// The word that stands in artifacts.
    pub fn name(self) -> &'static str {
        match self {
            Self::NotFinite => "not-finite",
            Self::Frame => "frame-moves",
            Self::BeyondSide(_) => "beyond-the-side",
            Self::Outlier(_) => "outlier",
            Self::NotConverged => "not-converged",
            Self::HeldOut => "held-out",
        }
    }
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            input, row, found_mm, ..
        } = self;
        write!(f, "row {row} of input {}: ", input + 1)?;
        match self.why {
            Why::NotFinite => write!(f, "a displacement is no number"),
            Why::Frame => write!(f, "the frame moves by {found_mm:.3} mm"),
            Why::BeyondSide(side) => write!(f, "{found_mm:.3} mm are more than the side of the membrane, {side} mm"),
            Why::Outlier(limit) => write!(
                f,
                "{found_mm:.3} mm are out of all proportion to the other labels, beyond {limit:.3} mm"
            ),
            Why::NotConverged => write!(f, "the simulation did not converge"),
            Why::HeldOut => write!(f, "an image of the pattern is held out for validation or test"),
        }
    }
}
