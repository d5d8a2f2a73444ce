//! The note in the status of a design whose target has fewer designs than requested.

use std::fmt;

/// A target has fewer designs than requested. It is written into the status of its last design, and is no violation of
/// a constraint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shortage {
    /// The number of designs that were found.
    pub found: usize,
    /// The number of requested designs.
    pub requested: usize,
    /// The least share of the cells in which two designs differ, in percent.
    pub percent: f64,
}

/// What stands between the numbers. The text is part of artifact digests.
const OF: &str = " of ";
const NONE_BESIDE: &str = " designs: none beside differs from them in ";
const OF_CELLS: &str = " % of the cells";

impl fmt::Display for Shortage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            found,
            requested,
            percent,
        } = self;
        write!(f, "{found}{OF}{requested}{NONE_BESIDE}{percent}{OF_CELLS}")
    }
}

impl Shortage {
    /// Reads what [`Display`](fmt::Display) writes; `None` of any other text.
    #[must_use]
    pub fn read(text: &str) -> Option<Self> {
        let (counts, percent) = text.split_once(NONE_BESIDE)?;
        let (found, requested) = counts.split_once(OF)?;
        Some(Self {
            found: found.parse().ok()?,
            requested: requested.parse().ok()?,
            percent: percent.strip_suffix(OF_CELLS)?.parse().ok()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let shortage = Shortage {
            found: 2,
            requested: 3,
            percent: 7.5,
        };
        let text = shortage.to_string();
        assert_eq!(
            text,
            "2 of 3 designs: none beside differs from them in 7.5 % of the cells"
        );
        assert_eq!(Shortage::read(&text), Some(shortage));
        for other in [
            "met",
            "area 0.4, wanted 0.5",
            &format!("area 0.4; {text}"),
            &format!("{text}; x"),
        ] {
            assert_eq!(Shortage::read(other), None, "{other}");
        }
    }
}
