//! Labels that are excluded from training, and the reasons.

use std::fmt;

/// A label that is excluded from training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// Index of the input.
    pub input: usize,
    /// Index of the row.
    pub row: usize,
    /// The wrong displacement in mm; 0 if it is not a number.
    pub found_mm: f64,
    /// The reason.
    pub reason: LeftOutReason,
}

/// Reason for which a label is excluded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LeftOutReason {
    /// A value is not finite.
    NotFinite,
    /// The frame moves.
    Frame,
    /// A displacement exceeds the side of the membrane, mm.
    BeyondSide(f64),
    /// A displacement exceeds this limit for outliers, mm.
    Outlier(f64),
    /// The simulation did not converge.
    NotConverged,
    /// The row is a verified design whose pattern, or an image of it, is in the validation or test split.
    HeldOut,
}

impl LeftOutReason {
    /// Returns the word in artifacts.
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
        match self.reason {
            LeftOutReason::NotFinite => write!(f, "a displacement is not a number"),
            LeftOutReason::Frame => write!(f, "the frame moves by {found_mm:.3} mm"),
            LeftOutReason::BeyondSide(side) => {
                write!(
                    f,
                    "displacement {found_mm:.3} mm exceeds the side of the membrane, {side} mm"
                )
            }
            LeftOutReason::Outlier(limit) => {
                write!(
                    f,
                    "displacement {found_mm:.3} mm is an outlier: the limit is {limit:.3} mm"
                )
            }
            LeftOutReason::NotConverged => write!(f, "the simulation did not converge"),
            LeftOutReason::HeldOut => write!(f, "the pattern or an image of it is in the validation or test split"),
        }
    }
}
