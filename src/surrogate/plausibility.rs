//! Implausible labels. A single wrong value distorts the training, its unit of length and all metrics.

use super::example::Example;
use deaflow_dataset::Split;

/// A label is an outlier when its largest displacement exceeds the quantile by this factor. Patterns of one training
/// set differ by an order of magnitude (a fine grid moves 0.1 mm, a half plane 2 mm), so a smaller factor would
/// exclude rare patterns.
const OUTLIER_FACTOR: f64 = 20.0;

/// The quantile of the largest displacements of the training labels. Up to a tenth of them may be wrong.
const QUANTILE: f64 = 0.9;

/// A label that cannot be true.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Implausible {
    /// Index of the example.
    pub(crate) index: usize,
    /// Its largest displacement in mm.
    pub(crate) found_mm: f64,
    /// The limit that it exceeds, in mm.
    pub(crate) limit_mm: f64,
    /// Whether the limit is the side of the membrane rather than that of outliers.
    pub(crate) exceeds_side: bool,
}

/// Finds the labels whose largest displacement exceeds the longer side of the membrane or twenty times the 90 %
/// quantile of the training labels.
pub(crate) fn implausible(examples: &[Example], side_mm: f64) -> Vec<Implausible> {
    let peaks: Vec<f64> = examples.iter().map(|example| example.label.max_magnitude()).collect();
    let training = examples.iter().zip(&peaks).filter(|(e, _)| e.split == Split::Train);
    let training = training.map(|(_, peak)| *peak);
    let mut sorted: Vec<f64> = training.filter(|peak| *peak <= side_mm).collect();
    sorted.sort_by(f64::total_cmp);
    let rank = (QUANTILE * sorted.len() as f64).ceil() as usize;
    // A quantile of 0 gives no limit.
    let limit_mm = match rank.checked_sub(1).map(|at| OUTLIER_FACTOR * sorted[at]) {
        Some(limit) if limit > 0.0 => limit.min(side_mm),
        _ => side_mm,
    };
    let beyond = peaks.iter().enumerate().filter(|(_, peak)| **peak > limit_mm);
    let implausible = beyond.map(|(index, &found_mm)| {
        let exceeds_side = found_mm > side_mm;
        Implausible {
            index,
            found_mm,
            limit_mm: if exceeds_side { side_mm } else { limit_mm },
            exceeds_side,
        }
    });
    implausible.collect()
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
        found.iter().map(|i| (i.index - 20, i.exceeds_side)).collect()
    }

    #[test]
    fn displacements_beyond_the_side_and_outliers_are_implausible() {
        // The 90 % quantile is 0.8 or 0.9 mm, so the limit is 16 or 18 mm.
        for split in Split::ALL {
            assert_eq!(found(&[2.5, 15.9], split), []);
            assert_eq!(found(&[30.0, 0.2, 100.0], split), [(0, false), (2, true)]);
        }
    }

    #[test]
    fn without_motion_the_side_is_the_limit() {
        assert_eq!(implausible(&[], 50.0), []);
        let still: Vec<Example> = (0..9).map(|_| example(0.0, Split::Train)).collect();
        assert_eq!(implausible(&still, 50.0), []);
        // Of two labels either may be the outlier, so only the side limits them.
        let two = |other| [example(0.1, Split::Train), example(other, Split::Train)];
        assert_eq!(implausible(&two(40.0), 50.0), []);
        let alone = implausible(&two(100.0), 50.0);
        let expected = Implausible {
            index: 1,
            found_mm: 100.0,
            limit_mm: 50.0,
            exceeds_side: true,
        };
        assert_eq!(alone, [expected]);
    }
}
