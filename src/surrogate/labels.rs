//! Labels that nobody should learn from, although each is a field: one wrong number pulls a network, its unit of length and
//! every metric after it.

use super::example::Example;
use deaflow_dataset::Split;

/// How many times the ordinary largest displacement a label may reach. Patterns of one training set differ by an order of
/// magnitude (a fine grid moves 0.1 mm where a half plane moves 2 mm), so nothing closer can be told from a rare pattern.
const BEYOND: f64 = 20.0;

/// Which part of the training labels counts as ordinary.
const ORDINARY: f64 = 0.9;

/// A label that cannot be true.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Implausible {
    /// Its place among the examples.
    pub index: usize,
    /// Its largest displacement in mm.
    pub found_mm: f64,
    /// The largest displacement that is believed, in mm.
    pub limit_mm: f64,
    /// Whether that is the side of the membrane, which nothing inside it can move farther than; otherwise it is what the training
    /// labels say.
    pub physical: bool,
}

/// The examples whose labels cannot be true: displacements beyond the longer side of the membrane, and beyond twenty times the 90 %
/// quantile of the largest displacements of the training examples (a rank, so up to a tenth of them may be wrong).
#[must_use]
pub fn implausible(examples: &[Example], side_mm: f64) -> Vec<Implausible> {
    let peaks: Vec<f64> = examples.iter().map(|example| example.label.max_magnitude()).collect();
    let training = examples.iter().zip(&peaks).filter(|(e, _)| e.split == Split::Train);
    let mut ordinary: Vec<f64> = training
        .map(|(_, peak)| *peak)
        .filter(|peak| *peak <= side_mm)
        .collect();
    ordinary.sort_by(f64::total_cmp);
    let rank = (ORDINARY * ordinary.len() as f64).ceil() as usize;
    // Where hardly anything moves there is no ordinary motion to compare with.
    let usual = rank
        .checked_sub(1)
        .map(|at| BEYOND * ordinary[at])
        .filter(|limit| *limit > 0.0);
    let limit_mm = usual.unwrap_or(side_mm).min(side_mm);
    let beyond = peaks.iter().enumerate().filter(|(_, peak)| **peak > limit_mm);
    beyond
        .map(|(index, &found_mm)| {
            let physical = found_mm > side_mm;
            Implausible {
                index,
                found_mm,
                limit_mm: if physical { side_mm } else { limit_mm },
                physical,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Label;
    use deaflow_field::CORNERS;
    use deaflow_pattern::{Pattern, Raster};

    fn example(peak: f64, split: Split) -> Example {
        let mut values = vec![0.0; 2 * CORNERS * CORNERS];
        values[2 * (25 * CORNERS + 25)] = peak;
        Example {
            pattern: Pattern::from_fn(Raster::PAPER, |_, _| true),
            label: Label::from_values(Raster::PAPER, &values).unwrap(),
            family: "a".to_owned(),
            split,
            repeats: 1,
        }
    }

    fn found(peaks: &[f64], split: Split) -> Vec<(usize, bool)> {
        let ordinary = (0..20).map(|i| example(0.1 * f64::from(i % 10), Split::Train));
        let examples: Vec<Example> = ordinary.chain(peaks.iter().map(|peak| example(*peak, split))).collect();
        let found = implausible(&examples, 50.0);
        found.iter().map(|i| (i.index - 20, i.physical)).collect()
    }

    #[test]
    fn nothing_moves_farther_than_the_side_or_far_beyond_all_others() {
        // The 90 % quantile is 0.8 or 0.9 mm, so the limit is 16 or 18 mm.
        for split in Split::ALL {
            assert_eq!(found(&[2.5, 15.9], split), []);
            assert_eq!(found(&[30.0, 0.2, 100.0], split), [(0, false), (2, true)]);
        }
    }

    #[test]
    fn a_limit_needs_something_that_moves() {
        assert_eq!(implausible(&[], 50.0), []);
        let still: Vec<Example> = (0..9).map(|_| example(0.0, Split::Train)).collect();
        assert_eq!(implausible(&still, 50.0), []);
        // Of two there is no telling which is the ordinary one, but for what no membrane does.
        let two = |other| [example(0.1, Split::Train), example(other, Split::Train)];
        assert_eq!(implausible(&two(40.0), 50.0), []);
        let alone = implausible(&two(100.0), 50.0);
        let expected = Implausible {
            index: 1,
            found_mm: 100.0,
            limit_mm: 50.0,
            physical: true,
        };
        assert_eq!(alone, [expected]);
    }
}
