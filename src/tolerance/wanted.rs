//! The displacement that a device has to reach: a length, or a share of the displacement of the pattern as drawn.

use std::fmt;

use deaflow_base::{Canonical, Decimal, InputError, Length, Node, NodeValue, Parameter, Schema, four_digits};

/// Limits of a length, mm.
const LENGTHS: std::ops::RangeInclusive<f64> = -1e6..=1e6;

/// Displacements as drawn up to this, mm, are rounding errors of the solver.
const LEAST_MM: f64 = 1e-6;

/// The longest text of a length as it is given; longer ones are those of computed numbers.
const LONGEST: usize = 12;

/// The displacement that a device has to reach.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// A length.
    Length(Length),
    /// A share of the displacement of the pattern as drawn, without tolerances.
    Share(Decimal),
}

impl Wanted {
    /// Reads a percentage, as in "90 %"; `None` for another text.
    ///
    /// # Errors
    /// When it is not from 0 % to 100 %: what is allowed.
    #[must_use]
    pub fn percentage(text: &str) -> Option<Result<Self, String>> {
        let percent = text.trim().strip_suffix('%')?;
        let share = percent.trim().parse().ok().map(|percent: Decimal| percent.scaled(-2));
        let share = share.filter(|share| (0.0..=1.0).contains(&share.to_f64()));
        let refused = || "a share of the displacement as drawn is from 0 % to 100 %".to_owned();
        Some(share.map(Self::Share).ok_or_else(refused))
    }

    /// Returns what an artifact has stored: a length in mm, or a share.
    #[must_use]
    pub fn of_stored(mm: Option<f64>, share: Option<f64>) -> Option<Self> {
        let length = mm.and_then(Length::from_f64).map(Self::Length);
        length.or_else(|| share.and_then(Decimal::from_f64).map(Self::Share))
    }

    /// Returns the length in mm, if it is one.
    #[must_use]
    pub fn length_mm(self) -> Option<f64> {
        match self {
            Self::Length(length) => Some(length.value()),
            Self::Share(_) => None,
        }
    }

    /// Returns the share, if it is one.
    #[must_use]
    pub fn share(self) -> Option<f64> {
        match self {
            Self::Length(_) => None,
            Self::Share(share) => Some(share.to_f64()),
        }
    }

    /// Returns the displacement in mm for a pattern that moves so far as drawn. A share needs a pattern that moves
    /// along the direction that counts.
    #[must_use]
    pub fn in_mm(self, as_drawn_mm: Option<f64>) -> Option<f64> {
        match self {
            Self::Length(length) => Some(length.value()),
            Self::Share(share) => Some(share.to_f64() * as_drawn_mm.filter(|mm| *mm > LEAST_MM)?),
        }
    }

    /// Describes it for a pattern that moves so far as drawn, mm: "2 mm", or "90 % of 2.155 mm = 1.939 mm".
    #[must_use]
    pub fn described(self, as_drawn_mm: Option<f64>) -> String {
        match (self, as_drawn_mm.zip(self.in_mm(as_drawn_mm))) {
            (Self::Share(_), Some((drawn, wanted))) => {
                format!("{self} of {} mm = {} mm", four_digits(drawn), four_digits(wanted))
            }
            (Self::Share(_), None) => format!("{self} of the displacement as drawn"),
            (Self::Length(_), _) => self.to_string(),
        }
    }
}

impl fmt::Display for Wanted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Length(length) if length.to_string().len() > LONGEST => {
                write!(f, "{} mm", four_digits(length.value()))
            }
            Self::Length(length) => length.fmt(f),
            Self::Share(share) => write!(f, "{} %", share.scaled(2)),
        }
    }
}

impl Parameter for Wanted {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let share = match node.value() {
            NodeValue::Text(text) => Self::percentage(text),
            _ => None,
        };
        match share {
            Some(share) => share.map_err(|why| node.error(format!("`{key}` is {}: {why}", node.found()))),
            None => Length::read(node, key, &LENGTHS).map(Self::Length),
        }
    }

    fn canonical(&self) -> Option<Canonical> {
        match self {
            Self::Length(length) => length.canonical(),
            Self::Share(share) => Some(Canonical::from(*share)),
        }
    }

    fn schema((): &()) -> Schema {
        Schema::any_of([Length::schema(&LENGTHS), Schema::percentage()])
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_is_one_of_the_displacement_as_drawn() {
        let share = Wanted::percentage(" 90 % ").unwrap().unwrap();
        assert_eq!(share.in_mm(Some(2.0)), Some(1.8));
        assert_eq!(share.described(Some(2.0)), "90 % of 2.000 mm = 1.800 mm");
        // Nothing is a share of a motion against the direction, or of a pattern without a stable state.
        for none in [Some(-2.0), Some(0.0), None] {
            assert_eq!(share.in_mm(none), None, "{none:?}");
        }
        assert_eq!((share.share(), share.length_mm()), (Some(0.9), None));
        let exact = Wanted::of_stored(Some(1.022_091_580_344_713_7), None).unwrap();
        assert_eq!(exact.to_string(), "1.022 mm");
        let length = Wanted::of_stored(Some(2.0), None).unwrap();
        assert_eq!(
            (length.described(None), length.in_mm(None)),
            ("2 mm".to_owned(), Some(2.0))
        );
        assert_eq!(Wanted::of_stored(None, Some(0.9)), Some(share));
        assert_eq!(Wanted::percentage("2 mm"), None);
        for refused in ["101 %", "-1 %", "x %", "%"] {
            assert!(Wanted::percentage(refused).unwrap().is_err(), "{refused}");
        }
    }
}
