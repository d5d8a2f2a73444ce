//! Bias and leaky rectifier in one pass over memory. candle-nn's `leaky_relu` takes three, its gradient more.

use candle_core::{CpuStorage, CustomOp1, CustomOp2, Layout, Result, Shape, Tensor, bail};

use super::storage::values;

/// Adds `bias` (c) to `x` (n, h, w, c) and applies the leaky rectifier max(v, slope · v), slope below 1 (Maas, Hannun
/// & Ng, ICML 2013).
pub(super) fn bias_and_activate(x: &Tensor, bias: &Tensor, slope: f32) -> Result<Tensor> {
    x.apply_op2(bias, BiasActivate { slope })
}

struct BiasActivate {
    slope: f32,
}

/// dx from (y, dy). The sign of the output selects the slope.
struct ActivationGradient {
    slope: f32,
}

/// (…, c) → (c), summed over all other dimensions in order.
struct SumPerChannel;

impl CustomOp2 for BiasActivate {
    fn name(&self) -> &'static str {
        "bias-and-activate"
    }

    fn cpu_fwd(&self, x: &CpuStorage, lx: &Layout, b: &CpuStorage, lb: &Layout) -> Result<(CpuStorage, Shape)> {
        let (x, b) = (values(x, lx)?, values(b, lb)?);
        let mut y = Vec::with_capacity(x.len());
        for pixel in x.chunks_exact(b.len()) {
            y.extend(pixel.iter().zip(b).map(|(x, b)| (x + b).max((x + b) * self.slope)));
        }
        Ok((CpuStorage::F32(y), lx.shape().clone()))
    }

    fn bwd(&self, _: &Tensor, _: &Tensor, y: &Tensor, grad: &Tensor) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let dx = y.apply_op2_no_bwd(&grad.contiguous()?, &ActivationGradient { slope: self.slope })?;
        let db = dx.apply_op1_no_bwd(&SumPerChannel)?;
        Ok((Some(dx), Some(db)))
    }
}

impl CustomOp2 for ActivationGradient {
    fn name(&self) -> &'static str {
        "activation-slope"
    }

    fn cpu_fwd(&self, y: &CpuStorage, ly: &Layout, g: &CpuStorage, lg: &Layout) -> Result<(CpuStorage, Shape)> {
        let (y, g) = (values(y, ly)?, values(g, lg)?);
        let gradient = |(y, g): (&f32, &f32)| if *y > 0.0 { *g } else { *g * self.slope };
        let gradients = y.iter().zip(g).map(gradient).collect();
        Ok((CpuStorage::F32(gradients), ly.shape().clone()))
    }
}

impl CustomOp1 for SumPerChannel {
    fn name(&self) -> &'static str {
        "sum-per-channel"
    }

    fn cpu_fwd(&self, x: &CpuStorage, lx: &Layout) -> Result<(CpuStorage, Shape)> {
        let [_, .., channels] = lx.dims() else {
            bail!("expected images, found {:?}", lx.dims());
        };
        let mut sums = vec![0.0f32; *channels];
        for pixel in values(x, lx)?.chunks_exact(sums.len()) {
            sums.iter_mut().zip(pixel).for_each(|(sum, x)| *sum += x);
        }
        let count = sums.len();
        Ok((CpuStorage::F32(sums), count.into()))
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};

    use super::*;

    #[test]
    fn value_and_gradients_by_hand() {
        let x = Var::new(
            &[[[[1.0f32, 0.5], [-3.0, -0.25]]], [[[-1.0, 4.0], [2.0, 0.0]]]],
            &Device::Cpu,
        )
        .unwrap();
        let bias = Var::new(&[1.0f32, -0.5], &Device::Cpu).unwrap();
        let y = bias_and_activate(&x, &bias, 0.1).unwrap();
        let flat = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        assert_eq!(flat(&y), [2.0, 0.0, -0.2, -0.075, 0.0, 3.5, 3.0, -0.05]);
        let c = [[[[1.0f32, 4.0], [2.0, 8.0]]], [[[16.0, 64.0], [32.0, 128.0]]]];
        let c = Tensor::new(&c, &Device::Cpu).unwrap();
        let grads = (&y * &c).unwrap().sum_all().unwrap().backward().unwrap();
        let expected = [1.0, 0.4, 0.2, 0.8, 1.6, 64.0, 32.0, 12.8];
        assert_eq!(flat(grads.get(&x).unwrap()), expected);
        let close = |found: f32, expected: f32| assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        let found = flat(grads.get(&bias).unwrap());
        close(found[0], 1.0 + 0.2 + 1.6 + 32.0);
        close(found[1], 0.4 + 0.8 + 64.0 + 12.8);
    }

    #[test]
    fn it_equals_candle() {
        let x = Tensor::randn(0.0f32, 1.0, (2, 4, 4, 3), &Device::Cpu).unwrap();
        let bias = Tensor::new(&[0.3f32, -0.2, 0.0], &Device::Cpu).unwrap();
        let flat = |t: &Tensor| t.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        assert_eq!(
            flat(&bias_and_activate(&x, &bias, 0.1).unwrap()),
            flat(&candle_nn::ops::leaky_relu(&x.broadcast_add(&bias).unwrap(), 0.1).unwrap())
        );
    }
}
