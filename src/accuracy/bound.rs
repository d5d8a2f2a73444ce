//! An upper bound of the error on patterns that were not measured.
//!
//! A method may be nearly exact on most patterns of a family and not on a few, so the lower part of the errors does not
//! predict the upper. The upper half of their logarithms is modelled by a normal distribution about the median. The
//! bound is median + k s with the root mean square distance s of the upper half from the median, and k such that 99 %
//! of all patterns of the family stay below it with 95 % confidence. k is Natrella's one-sided tolerance factor
//! (Experimental Statistics, NBS Handbook 91 (1963), section 2-5.3; also NIST/SEMATECH e-Handbook, section 7.2.6.3) for
//! the (n + 1)/2 errors in s. For normal samples it is correct within 3 % from n = 10 on, and conservative below.

/// Standard normal deviate of the covered share of patterns, 99 %.
const COVERED: f64 = 2.326_347_874;

/// Standard normal deviate of the confidence, 95 %.
const CONFIDENCE: f64 = 1.644_853_627;

/// Errors below this in mm are rounding errors and are left out.
const ROUNDING: f64 = 1e-10;

/// The fewest errors for which a bound is computed.
const LEAST: usize = 5;

/// Returns Natrella's factor for n samples.
fn factor(n: f64) -> f64 {
    let a = 1.0 - CONFIDENCE.powi(2) / (2.0 * (n - 1.0));
    let b = COVERED.powi(2) - CONFIDENCE.powi(2) / n;
    (COVERED + (COVERED.powi(2) - a * b).sqrt()) / a
}

/// Returns the bound for some errors in mm, at least the largest of them. For fewer than [`LEAST`] errors it is the
/// largest.
pub fn upper_bound(errors: &[f64]) -> f64 {
    let largest = errors.iter().copied().fold(0.0, f64::max);
    let mut logs: Vec<f64> = errors.iter().filter(|e| **e > ROUNDING).map(|e| e.ln()).collect();
    let n = logs.len();
    if n < LEAST {
        return largest;
    }
    logs.sort_by(f64::total_cmp);
    let median = 0.5 * (logs[(n - 1) / 2] + logs[n / 2]);
    let upper = &logs[n.div_ceil(2)..];
    let squares: f64 = upper.iter().map(|log| (log - median).powi(2)).sum();
    let spread = (squares / upper.len() as f64).sqrt();
    largest.max((median + factor(0.5 * (n + 1) as f64) * spread).exp())
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_base::Stream;

    #[test]
    fn the_factor_is_that_of_the_tables() {
        // Odeh and Owen, Tables for Normal Tolerance Limits (1980): 99 % with 95 % confidence, one-sided.
        for (n, exact, within) in [
            (5, 5.741, 0.01),
            (12, 3.747, 0.012),
            (20, 3.295, 0.012),
            (50, 2.862, 0.005),
        ] {
            let found = factor(f64::from(n));
            assert!((found / exact - 1.0_f64).abs() < within, "{n}: {found}");
        }
        assert!(factor(3.0) > 10.55, "where it is rough it is on the safe side");
    }

    #[test]
    fn the_bound_has_its_confidence() {
        // In 95 of 100 draws the bound must be above the 99 % quantile of the distribution.
        let quantile = (-7.0 + COVERED * 0.6_f64).exp();
        let hits = |skewed: bool| {
            let covers = |draw: &u64| {
                let mut stream = Stream::new(*draw, "bound test", 0);
                let mut log = || match stream.normal() {
                    x if skewed && x < 0.0 => 8.0 * x,
                    x => 0.6 * x,
                };
                let errors: Vec<f64> = (0..12).map(|_| (log() - 7.0).exp()).collect();
                upper_bound(&errors) >= quantile
            };
            (0..1000).filter(covers).count()
        };
        assert!((935..=980).contains(&hits(false)), "{}", hits(false));
        assert!(
            (935..=1000).contains(&hits(true)),
            "a nearly exact half: {}",
            hits(true)
        );
    }

    #[test]
    fn few_or_zero_errors_have_a_bound() {
        assert_eq!(upper_bound(&[]), 0.0);
        assert_eq!(upper_bound(&[0.0, 3e-3]), 3e-3);
        assert_eq!(upper_bound(&[0.0, 1e-14, 2e-3, 1e-3]), 2e-3);
        let some = [1e-3, 1.1e-3, 0.9e-3, 1.05e-3, 0.95e-3, 1.0e-3];
        assert!((1.1e-3..2e-3).contains(&upper_bound(&some)));
        let exact = [&some[..], &[1e-8; 5]].concat();
        assert!(
            upper_bound(&exact) < 1.0,
            "a half that is nearly exact does not blow it up"
        );
    }
}
