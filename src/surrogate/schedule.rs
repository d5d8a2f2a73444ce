//! Learning rate schedule: linear warm-up and cosine decay.

/// Share of the steps during which the rate rises.
const WARMUP: f64 = 0.08;

/// Returns the learning rate at a step of `steps` relative to the largest: a linear rise, then half a cosine to zero
/// (Loshchilov & Hutter, SGDR, ICLR 2017, without restarts).
pub(crate) fn learning_rate_factor(step: u64, steps: u64) -> f64 {
    let progress = (step as f64 + 0.5) / steps as f64;
    if progress < WARMUP {
        progress / WARMUP
    } else {
        0.5 * (1.0 + (std::f64::consts::PI * (progress - WARMUP) / (1.0 - WARMUP)).cos())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rises_then_falls_to_zero() {
        let factors: Vec<f64> = (0..1000).map(|step| learning_rate_factor(step, 1000)).collect();
        let top = (WARMUP * 1000.0) as usize;
        assert!(factors[..top].is_sorted() && factors[top..].is_sorted_by(|a, b| a >= b));
        assert!(factors[0] < 0.01 && factors[top] > 0.999 && factors[999] < 1e-4 && factors[999] > 0.0);
    }

    #[test]
    fn a_single_step_has_a_positive_rate() {
        let factor = learning_rate_factor(0, 1);
        assert!(factor > 0.1 && factor <= 1.0);
    }
}
