//! The uniform level: the number of rows per bin that makes a balanced dataset as uniform as possible.
//!
//! Each bin gives the level, or all its rows where it has fewer. The level solves Σ min(capacity, level) = target. The
//! paper finds it by levelling, augmenting and levelling again.

/// The level and the rows of each bin.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Quotas {
    /// The level before rounding; the largest capacity when all rows together do not exceed the target.
    pub(super) level: f64,
    /// Rows of each bin: the level rounded down or up, or the capacity of the bin if it is less.
    pub(super) rows: Vec<u64>,
}

/// Computes the level at which the bins give `target` rows together, or all rows if there are fewer. Rows that remain
/// after rounding the level down go to the bins with the smallest `order`, one each.
pub(super) fn quotas(capacities: &[u64], target: u64, order: &[u64]) -> Quotas {
    if capacities.iter().sum::<u64>() <= target {
        return Quotas {
            level: capacities.iter().max().map_or(0.0, |&largest| largest as f64),
            rows: capacities.to_vec(),
        };
    }
    let mut sorted = capacities.to_vec();
    sorted.sort_unstable();
    let mut left = target;
    let mut bins_left = sorted.len() as u64;
    for &capacity in &sorted {
        if capacity * bins_left > left {
            break;
        }
        left -= capacity;
        bins_left -= 1;
    }
    let whole = left / bins_left;
    let mut rows: Vec<u64> = capacities.iter().map(|&c| c.min(whole)).collect();
    let mut fuller: Vec<usize> = (0..rows.len()).filter(|&bin| capacities[bin] > whole).collect();
    fuller.sort_by_key(|&bin| (order[bin], bin));
    for &bin in &fuller[..(left % bins_left) as usize] {
        rows[bin] += 1;
    }
    Quotas {
        level: left as f64 / bins_left as f64,
        rows,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn small_bins_give_all_rows_and_the_others_share_the_rest() {
        let quotas = quotas(&[100, 3, 0, 50, 40], 43, &[0; 5]);
        assert_eq!(quotas.rows, [14, 3, 0, 13, 13]);
        assert!((quotas.level - 40.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn fewer_rows_than_the_target_are_all_used() {
        let given = quotas(&[2, 0, 5], 100, &[0; 3]);
        assert_eq!((given.rows, given.level), (vec![2, 0, 5], 5.0));
        assert_eq!(quotas(&[], 5, &[]).rows, Vec::<u64>::new());
    }

    proptest! {
        #[test]
        fn the_target_is_reached_and_bins_are_level(
            capacities in prop::collection::vec(0u64..60, 1..40), target in 1u64..900, salt in any::<u64>()
        ) {
            let order: Vec<u64> = (0..capacities.len() as u64).map(|b| b.wrapping_mul(salt)).collect();
            let Quotas { rows, level } = quotas(&capacities, target, &order);
            prop_assert_eq!(rows.iter().sum::<u64>(), target.min(capacities.iter().sum()));
            for (&given, &capacity) in rows.iter().zip(&capacities) {
                prop_assert!(given <= capacity);
                let levelled = (capacity as f64).min(level);
                prop_assert!((given as f64 - levelled).abs() < 1.0);
            }
        }
    }
}
