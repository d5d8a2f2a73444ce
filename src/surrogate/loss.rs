//! The loss of Qin et al. (Soft Robotics 2024, doi 10.1089/soro.2024.0063): smooth L1 plus λ times the largest error,
//! plus the same smooth L1 for the auxiliary output at half resolution.

use candle_core::{Result, Tensor};
use candle_nn::loss::huber;

use super::encode::half_resolution;
use super::networks::Output;

/// Weights of the further terms.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LossWeights {
    /// λ, the weight of the largest absolute error of each field.
    pub(crate) maximum: f64,
    /// Weight of the auxiliary output at half resolution.
    pub(crate) auxiliary: f64,
}

/// Threshold of the smooth L1, which is Huber's loss: the loss is quadratic below it (Girshick, Fast R-CNN, ICCV 2015).
const THRESHOLD: f64 = 1.0;

/// Returns the loss summed over a batch, a scalar.
pub(crate) fn total_loss(output: &Output, target: &Tensor, weights: LossWeights) -> Result<Tensor> {
    let images = target.dim(0)? as f64;
    let largest = (&output.displacement - target)?
        .abs()?
        .flatten_from(1)?
        .max(1)?
        .sum_all()?;
    let mut loss = ((huber(&output.displacement, target, THRESHOLD)? * images)? + (largest * weights.maximum)?)?;
    if let Some(half) = &output.half_resolution {
        let auxiliary = huber(half, &half_resolution(target)?, THRESHOLD)?;
        loss = (loss + (auxiliary * (images * weights.auxiliary))?)?;
    }
    Ok(loss)
}

#[cfg(test)]
mod tests {
    use candle_core::Device;

    use super::*;
    use crate::encode::INNER;

    /// The loss of one image whose errors are 0 except for the given ones of the displacement and the auxiliary output.
    fn loss(errors: &[f32], auxiliary: &[f32], weights: LossWeights) -> f64 {
        let image = |errors: &[f32], channels: usize, side: usize| {
            let mut values = vec![0.0; channels * side * side];
            values[..errors.len()].copy_from_slice(errors);
            Tensor::from_vec(values, (1, side, side, channels), &Device::Cpu).unwrap()
        };
        let output = Output {
            displacement: image(errors, 2, INNER),
            half_resolution: Some(image(auxiliary, 1, 25)),
        };
        let target = image(&[], 2, INNER);
        f64::from(
            total_loss(&output, &target, weights)
                .unwrap()
                .to_scalar::<f32>()
                .unwrap(),
        )
    }

    #[test]
    fn each_term_by_hand() {
        let count = (2 * INNER * INNER) as f64;
        let close = |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}");
        let only = LossWeights {
            maximum: 0.0,
            auxiliary: 0.0,
        };
        // Below the threshold e²/2, above it |e| − ½.
        close(loss(&[0.5, -0.5, 3.0], &[9.0], only), (0.125 + 0.125 + 2.5) / count);
        let maximum = LossWeights {
            maximum: 0.1,
            auxiliary: 0.0,
        };
        close(loss(&[0.5, -3.0], &[9.0], maximum), (0.125 + 2.5) / count + 0.3);
        let auxiliary = LossWeights {
            maximum: 0.0,
            auxiliary: 2.0,
        };
        close(loss(&[0.5], &[2.0], auxiliary), 0.125 / count + 2.0 * 1.5 / 625.0);
    }
}
