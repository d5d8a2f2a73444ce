//! Upper confidence bound of the rate of faults from a random sample without replacement.
//!
//! If D of n rows are faulty, the number of faults in a sample of k rows has a hypergeometric distribution. A number D
//! is excluded at 95 % confidence if at most 5 % of the samples have as few faults as were found.

/// Probability at which a number of faults is excluded.
const SIGNIFICANCE: f64 = 0.05;

/// Returns the 95 % upper bound of the rate of faults, for `found` faults among `k` random rows of `n`. Without faults
/// it is about 1 − 0.05^(1/k).
#[must_use]
pub fn excluded_above(n: usize, k: usize, found: usize) -> f64 {
    if n == 0 || k == 0 {
        return 1.0;
    }
    // Bisection between a possible and an excluded number of faults.
    let (mut possible, mut excluded) = (found, n - (k - found) + 1);
    while excluded - possible > 1 {
        let middle = possible + (excluded - possible) / 2;
        if at_most(n, middle, k, found) > SIGNIFICANCE {
            possible = middle;
        } else {
            excluded = middle;
        }
    }
    possible as f64 / n as f64
}

/// Returns the probability of at most `found` faults among `k` of `n` rows, of which `faults` are faulty.
fn at_most(n: usize, faults: usize, k: usize, found: usize) -> f64 {
    let all = ln_choose(n, k);
    let least = (k + faults).saturating_sub(n);
    let most = found.min(faults).min(k);
    (least..=most)
        .map(|x| (ln_choose(faults, x) + ln_choose(n - faults, k - x) - all).exp())
        .sum()
}

fn ln_choose(n: usize, k: usize) -> f64 {
    let k = k.min(n - k);
    (0..k).map(|i| ((n - i) as f64).ln() - ((i + 1) as f64).ln()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_without_faults_of_a_large_dataset_has_the_binomial_bound() {
        // 1 − 0.05^(1/k).
        for (k, rate) in [(32, 0.0894), (59, 0.0495), (300, 0.00994)] {
            assert!((excluded_above(1_000_000, k, 0) - rate).abs() < 1e-4, "{k}");
        }
    }

    #[test]
    fn the_bound_of_a_finite_dataset_is_smaller_and_exact_for_a_full_sample() {
        assert!(excluded_above(64, 32, 0) < 0.08);
        assert_eq!(excluded_above(40, 40, 0), 0.0);
        assert_eq!(excluded_above(40, 40, 3), 3.0 / 40.0);
        assert_eq!(excluded_above(0, 0, 0), 1.0);
    }

    #[test]
    fn faults_in_the_sample_increase_the_bound() {
        // The exact binomial bound for 1 of 30 is 14.9 %.
        assert!((excluded_above(1_000_000, 30, 1) - 0.1486).abs() < 2e-3);
        assert_eq!(excluded_above(10, 2, 2), 1.0);
    }
}
