//! What a random sample without replacement says of the rest.
//!
//! With D faults among n rows, a sample of k holds X of them by the hypergeometric law. A number of faults is excluded at
//! 95 % where so few as were found come up in 5 % of the samples or less.

/// Probability at which a number of faults is excluded.
const DOUBT: f64 = 0.05;

/// The smallest rate of faults above which all rates are excluded at 95 %, for `found` faults among `k` random ones of `n`
/// rows. With none found it is about 1 − 0.05^(1/k).
#[must_use]
pub fn excluded_above(n: usize, k: usize, found: usize) -> f64 {
    if n == 0 || k == 0 {
        return 1.0;
    }
    // Faults that are there at least, and at most.
    let (mut possible, mut excluded) = (found, n - (k - found) + 1);
    while excluded - possible > 1 {
        let middle = possible + (excluded - possible) / 2;
        if at_most(n, middle, k, found) > DOUBT {
            possible = middle;
        } else {
            excluded = middle;
        }
    }
    possible as f64 / n as f64
}

/// The probability of at most `found` faults among `k` of `n` rows, `faults` of which are at fault.
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
    fn a_clean_sample_of_a_large_set_excludes_three_faults_in_as_many() {
        // 1 − 0.05^(1/k).
        for (k, rate) in [(32, 0.0894), (59, 0.0495), (300, 0.00994)] {
            assert!((excluded_above(1_000_000, k, 0) - rate).abs() < 1e-4, "{k}");
        }
    }

    #[test]
    fn a_finite_set_is_known_better_and_wholly_when_all_is_looked_at() {
        assert!(excluded_above(64, 32, 0) < 0.08);
        assert_eq!(excluded_above(40, 40, 0), 0.0);
        assert_eq!(excluded_above(40, 40, 3), 3.0 / 40.0);
        assert_eq!(excluded_above(0, 0, 0), 1.0);
    }

    #[test]
    fn faults_that_were_found_leave_room_for_more() {
        // Exact binomial bound for 1 of 30: 14.9 %; a large set comes close.
        assert!((excluded_above(1_000_000, 30, 1) - 0.1486).abs() < 2e-3);
        assert_eq!(excluded_above(10, 2, 2), 1.0);
    }
}
