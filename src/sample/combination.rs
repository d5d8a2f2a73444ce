//! Numbers the k-subsets of n items, and permutes the numbers by a seed.
//!
//! A large grid with few units has few patterns: independent draws would repeat some and miss others. Instead sample i
//! is pattern number π(i) with a pseudo-random permutation π, so that samples are distinct, reach all patterns, and do
//! not depend on each other. The numbering is the combinatorial number system (Knuth, The Art of Computer Programming
//! 4A, §7.2.1.3); the permutation a Feistel network with cycle walking (Black and Rogaway, CT-RSA 2002, doi
//! 10.1007/3-540-45760-7_9).

use deaflow_base::Stream;

/// Returns the number of k-subsets of n items; `None` beyond 64 bits.
pub(super) fn binomial(n: u64, k: u64) -> Option<u64> {
    if k > n {
        return Some(0);
    }
    let mut value = 1u128;
    for i in 0..k.min(n - k) {
        value = value * u128::from(n - i) / u128::from(i + 1);
        if value > u128::from(u64::MAX) {
            return None;
        }
    }
    u64::try_from(value).ok()
}

/// Returns subset number `rank` of the k-subsets of 0..n in lexicographic order: for each item whether it is chosen.
///
/// # Panics
/// When there are fewer subsets, or more than 64 bits can number.
pub(super) fn subset(n: usize, k: usize, mut rank: u64) -> Vec<bool> {
    let mut left = k as u64;
    let mut chosen = Vec::with_capacity(n);
    for item in 0..n {
        let rest = (n - item - 1) as u64;
        let with_item = match left {
            0 => 0,
            _ => binomial(rest, left - 1).expect("a part of a numbered set has fewer subsets"),
        };
        let take = rank < with_item;
        chosen.push(take);
        if take {
            left -= 1;
        } else {
            rank -= with_item;
        }
    }
    assert!(left == 0 && rank == 0, "the rank is beyond the last subset");
    chosen
}

/// Rounds of the Feistel network. Four make a strong pseudo-random permutation of large domains (Luby and Rackoff, SIAM
/// J. Comput. 17 (1988) 373); small ones need more.
const ROUNDS: u64 = 12;

/// Returns the image of `index` under a pseudo-random permutation of 0..size, which seed and purpose determine.
///
/// # Panics
/// When `index` is not below `size`.
pub(super) fn permuted(size: u64, seed: u64, purpose: &str, index: u64) -> u64 {
    assert!(index < size, "{index} is outside a permutation of {size}");
    let bits = u64::BITS - (size - 1).leading_zeros();
    let half = bits.div_ceil(2).max(1);
    let mask = (1u64 << half) - 1;
    let mut value = index;
    loop {
        let (mut left, mut right) = (value >> half, value & mask);
        for round in 0..ROUNDS {
            let noise = Stream::new(seed, &format!("{purpose}, round {round}"), right).next_u64();
            (left, right) = (right, left ^ (noise & mask));
        }
        value = left << half | right;
        if value < size {
            return value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn binomials_match_known_values() {
        assert_eq!(binomial(16, 8), Some(12_870));
        assert_eq!(binomial(64, 32), Some(1_832_624_140_942_590_534));
        assert_eq!(binomial(81, 40), None);
        assert_eq!(binomial(3, 4), Some(0));
        assert_eq!(binomial(9, 0), Some(1));
    }

    #[test]
    fn subsets_are_numbered_in_lexicographic_order() {
        let all: Vec<_> = (0..20).map(|rank| subset(6, 3, rank)).collect();
        assert_eq!(all[0], [true, true, true, false, false, false]);
        assert_eq!(all[19], [false, false, false, true, true, true]);
        assert!(all.windows(2).all(|pair| pair[0] > pair[1]));
        assert!(all.iter().all(|s| s.iter().filter(|&&taken| taken).count() == 3));
    }

    #[test]
    fn a_permutation_reaches_everything_once_and_depends_on_the_seed() {
        for size in [1, 2, 6, 252, 12_870] {
            let mut image: Vec<u64> = (0..size).map(|i| permuted(size, 3, "test", i)).collect();
            image.sort_unstable();
            assert!(image.iter().copied().eq(0..size), "size {size}");
        }
        let start = |seed| (0..8).map(|i| permuted(252, seed, "test", i)).collect::<Vec<_>>();
        assert_ne!(start(1), start(2));
    }

    #[test]
    fn the_first_image_is_uniform_over_seeds() {
        let mut counts = [0u32; 6];
        for seed in 0..6000 {
            counts[permuted(6, seed, "test", 0) as usize] += 1;
        }
        // Chi-square with 5 degrees of freedom: 20.5 is the 0.1 % quantile.
        let chi2: f64 = counts.iter().map(|&c| (f64::from(c) - 1000.0).powi(2) / 1000.0).sum();
        assert!(chi2 < 20.5, "chi-square {chi2}");
    }
}
