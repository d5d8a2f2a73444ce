//! Powers with real exponents in SIMD lanes, from roots, products and short series.
//!
//! Both functions keep their relative accuracy near 1, so xᵖ − 1 has as many correct digits as x − 1.

use super::lanes::Value;

/// 1/(n + 1)!
const INVERSE_FACTORIALS: [f64; 13] = {
    let mut inverse = [1.0; 13];
    let mut n = 1;
    while n < 13 {
        inverse[n] = inverse[n - 1] / (n + 1) as f64;
        n += 1;
    }
    inverse
};

/// Returns (1 + d)ᵖ − 1 for 1 + d > 0. In double precision the relative error is a few 1e-15 if |p ln(1 + d)| is below
/// 16 and 1 + d is between 1/100 and 100, and increases slowly outside.
#[inline(always)]
pub fn power_minus_one<V: Value>(d: V, exponent: f64) -> V {
    exponential_minus_one(d.constant(exponent) * logarithm_of_one_plus(d))
}

/// For smaller |d|, ln(1 + d) needs no root.
const NEAR_ONE: f64 = 0.25;
/// For smaller |z|, exp z needs no square.
const NEAR_ZERO: f64 = 0.4;

/// Returns ln(1 + d). With y = (1 + d)^(1/n), ln(1 + d) = 2n artanh((y − 1)/(y + 1)), where n is 16, or 1 if all lanes
/// are near 1; y − 1 is d over the other factors of yⁿ − 1, without cancellation.
#[inline(always)]
pub fn logarithm_of_one_plus<V: Value>(d: V) -> V {
    let one = d.constant(1.0);
    let (t, twice) = if is_within(d, NEAR_ONE) {
        (d * (d + one.constant(2.0)).recip(), 2.0)
    } else {
        let half = (one + d).sqrt();
        let quarter = half.sqrt();
        let eighth = quarter.sqrt();
        let next = eighth.sqrt() + one;
        let factors = (half + one) * (quarter + one) * ((eighth + one) * (next * next));
        (d * factors.recip(), 32.0)
    };
    // Two interleaved chains halve the latency.
    let square = t * t;
    let fourth = square * square;
    let (mut sum, mut other) = if V::SINGLE {
        (one.constant(1.0 / 9.0), one.constant(1.0 / 7.0))
    } else {
        let mut sum = one.constant(1.0 / 17.0).madd(fourth, one.constant(1.0 / 13.0));
        sum = sum.madd(fourth, one.constant(1.0 / 9.0));
        let other = one.constant(1.0 / 15.0).madd(fourth, one.constant(1.0 / 11.0));
        (sum, other.madd(fourth, one.constant(1.0 / 7.0)))
    };
    for odd in [5.0, 1.0] {
        sum = sum.madd(fourth, one.constant(1.0 / odd));
    }
    other = other.madd(fourth, one.constant(1.0 / 3.0));
    let sum = other.madd(square, sum);
    one.constant(twice) * t * sum
}

/// Returns exp z − 1: the series at z/32, squared five times in the form e ← e(e + 2), or at z if all lanes are near 0.
#[inline(always)]
pub fn exponential_minus_one<V: Value>(z: V) -> V {
    if is_within(z, NEAR_ZERO) {
        return short_exponential(z);
    }
    let mut e = short_exponential(z.constant(1.0 / 32.0) * z);
    for _ in 0..5 {
        e = e * (e + z.constant(2.0));
    }
    e
}

/// Returns exp z − 1 for |z| up to 0.4.
#[inline(always)]
fn short_exponential<V: Value>(z: V) -> V {
    let factor = |n: usize| z.constant(INVERSE_FACTORIALS[n]);
    let square = z * z;
    let last = if V::SINGLE { 6 } else { 12 };
    let (mut even, mut odd) = (factor(last), factor(last - 1));
    for pair in (0..last / 2).rev() {
        even = even.madd(square, factor(2 * pair));
        if pair > 0 {
            odd = odd.madd(square, factor(2 * pair - 1));
        }
    }
    z * odd.madd(z, even)
}

/// Returns whether all lanes are between ∓`limit`.
#[inline(always)]
fn is_within<V: Value>(x: V, limit: f64) -> bool {
    !x.madd(x, x.constant(-limit * limit)).any_positive()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_have_the_digits_of_the_standard_library() {
        for step in -200..=200 {
            let d = (0.023 * f64::from(step)).exp_m1();
            for exponent in [-3.0, -1.3, -0.5, 0.0, 0.17, 1.0, 1.5, 3.3] {
                let exact = (exponent * d.ln_1p()).exp_m1();
                let found = power_minus_one(d, exponent);
                assert!(
                    (found - exact).abs() <= 2e-14 * exact.abs(),
                    "{d} {exponent}: {found} {exact}"
                );
            }
        }
    }

    #[test]
    fn powers_near_one_keep_their_digits() {
        for d in [1e-3, -1e-6, 1e-9, -1e-12, 1e-15] {
            for exponent in [-2.5, 0.3, 1.7] {
                let exact = (exponent * f64::ln_1p(d)).exp_m1();
                assert!((power_minus_one(d, exponent) - exact).abs() <= 4e-15 * exact.abs());
            }
        }
    }
}
