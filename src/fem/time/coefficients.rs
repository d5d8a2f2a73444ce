//! The exponential trapezoid: Ȧ = (c⁻¹ − A)/τ, solved exactly for a c⁻¹ that is linear in time within a step.

/// The coefficients of a step of Δt for a branch: A ← `kept` · A + `before` · c₀⁻¹ + `now` · c₁⁻¹, from r = Δt/τ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficients {
    /// E = e^(−r).
    pub kept: f64,
    /// (1 − E)/r − E.
    pub before: f64,
    /// 1 − (1 − E)/r.
    pub now: f64,
}

/// Below it the differences would cancel; a series of four terms has full precision.
const SMALL: f64 = 1e-3;

impl Coefficients {
    /// Returns the coefficients of a step over `r` relaxation times.
    #[must_use]
    pub fn new(r: f64) -> Self {
        let kept = (-r).exp();
        if r < SMALL {
            return Self {
                kept,
                before: r * (0.5 - r * (1.0 / 3.0 - r * (0.125 - r / 30.0))),
                now: r * (0.5 - r * (1.0 / 6.0 - r * (1.0 / 24.0 - r / 120.0))),
            };
        }
        let mean = -(-r).exp_m1() / r;
        Self {
            kept,
            before: mean - kept,
            now: 1.0 - mean,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_add_up_to_one_and_pass_smoothly_from_the_series() {
        for r in [0.0, 1e-12, 9.9e-4, 1e-3, 0.1, 1.0, 30.0, 1e6] {
            let Coefficients { kept, before, now } = Coefficients::new(r);
            assert!((kept + before + now - 1.0).abs() < 1e-15, "{r}");
            assert!(before >= 0.0 && now >= 0.0);
        }
        let (below, above) = (Coefficients::new(SMALL * (1.0 - 1e-9)), Coefficients::new(SMALL));
        assert!((below.before / above.before - 1.0).abs() < 2e-9 && (below.now / above.now - 1.0).abs() < 2e-9);
    }

    #[test]
    fn what_is_linear_in_time_is_followed_exactly() {
        // Ȧ = (t − A)/τ from A = 0 at t = 0: A(t) = t − τ(1 − e^(−t/τ)).
        for tau in [1e-6, 0.3, 1.0, 1e4] {
            let (mut value, steps) = (0.0, 7);
            for step in 0..steps {
                let [start, end] = [step, step + 1].map(|at| f64::from(at) / f64::from(steps));
                let Coefficients { kept, before, now } = Coefficients::new((end - start) / tau);
                value = kept * value + before * start + now * end;
            }
            let exact = 1.0 + tau * (-1.0 / tau).exp_m1();
            assert!((value - exact).abs() < 1e-12 * (1.0 + tau), "{tau}: {value} {exact}");
        }
    }
}
