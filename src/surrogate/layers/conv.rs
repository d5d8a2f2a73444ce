//! Convolution and transposed convolution with bias and leaky rectifier, for images with channels last.
//!
//! candle-nn has channels first, and on a CPU the gradients of its convolutions are several times slower than the
//! forward pass. The operations below are matrix products ([`Window`]). Tests compare them with candle-nn's layers.

use candle_core::{CpuStorage, CustomOp2, Layout, Module, Result, Shape, Tensor, bail};
use candle_nn::init::ZERO;
use candle_nn::{Conv2dConfig, Init, VarBuilder};
use deaflow_linalg::Accum;

use super::activate::bias_and_activate;
use super::gemm::{Matrix, multiply};
use super::storage::values;
use super::window::Window;

/// A convolution with zero padding, bias and leaky rectifier: (n, h, w, from) to (n, h′, w′, to) with
/// h′ = (h + 2 padding − kernel)/stride + 1, and w′ alike.
pub(crate) struct Conv2d {
    /// (to, kernel, kernel, from)
    pub(crate) weights: Tensor,
    pub(crate) bias: Tensor,
    /// Stride and padding.
    pub(crate) config: Conv2dConfig,
    /// Slope of the rectifier below zero.
    pub(crate) slope: f32,
}

impl Conv2d {
    /// Creates the layer from the tensors `weights`, initialised with the standard deviation `stdev`, and `bias`.
    pub(crate) fn new(
        [from, to]: [usize; 2],
        kernel: usize,
        config: Conv2dConfig,
        stdev: f64,
        slope: f32,
        builder: &VarBuilder<'_>,
    ) -> Result<Self> {
        Ok(Self {
            weights: builder.get_with_hints((to, kernel, kernel, from), "weights", Init::Randn { mean: 0.0, stdev })?,
            bias: builder.get_with_hints(to, "bias", ZERO)?,
            config,
            slope,
        })
    }
}

impl Module for Conv2d {
    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let window = Window {
            kernel: self.weights.dim(1)?,
            stride: self.config.stride,
            padding: self.config.padding,
        };
        let y = x.contiguous()?.apply_op2(&self.weights, Convolution { window })?;
        bias_and_activate(&y, &self.bias, self.slope)
    }
}

/// The transpose of a convolution with stride 2 and odd kernel, with bias: (n, h, w, from) to (n, 2h − 1, 2w − 1, to).
/// The outer outputs lie on the outer inputs, so the grids of 7, 13, 25 and 49 points share their points.
pub(crate) struct ConvTranspose2d {
    /// (from, kernel, kernel, to)
    pub(crate) weights: Tensor,
    pub(crate) bias: Tensor,
    /// Slope of the rectifier below zero; `None` for no rectifier.
    pub(crate) slope: Option<f32>,
}

impl ConvTranspose2d {
    /// Creates the layer from the tensors `weights`, initialised with the standard deviation `stdev`, and `bias`.
    pub(crate) fn new(
        [from, to]: [usize; 2],
        kernel: usize,
        stdev: f64,
        slope: Option<f32>,
        builder: &VarBuilder<'_>,
    ) -> Result<Self> {
        Ok(Self {
            weights: builder.get_with_hints((from, kernel, kernel, to), "weights", Init::Randn { mean: 0.0, stdev })?,
            bias: builder.get_with_hints(to, "bias", ZERO)?,
            slope,
        })
    }
}

impl Module for ConvTranspose2d {
    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let kernel = self.weights.dim(1)?;
        let sides = [2 * x.dim(1)? - 1, 2 * x.dim(2)? - 1];
        let window = Window {
            kernel,
            stride: 2,
            padding: (kernel - 1) / 2,
        };
        let y = x.contiguous()?.apply_op2(&self.weights, Transposed { window, sides })?;
        match self.slope {
            Some(slope) => bias_and_activate(&y, &self.bias, slope),
            None => y.broadcast_add(&self.bias),
        }
    }
}

/// y = unfold(x) · Wᵀ.
struct Convolution {
    window: Window,
}

/// x = fold(y · W), for images with `sides` rows and columns.
struct Transposed {
    window: Window,
    sides: [usize; 2],
}

/// W = yᵀ · unfold(x), summed over the images in order.
struct WeightGradient {
    window: Window,
}

/// Returns (rows and columns, channels) of a batch of images.
fn image_dims(layout: &Layout) -> Result<([usize; 2], usize)> {
    match layout.dims() {
        &[_, h, w, c] => Ok(([h, w], c)),
        dims => bail!("expected images, found {dims:?}"),
    }
}

impl CustomOp2 for Convolution {
    fn name(&self) -> &'static str {
        "convolve"
    }

    fn cpu_fwd(&self, x: &CpuStorage, lx: &Layout, weights: &CpuStorage, lw: &Layout) -> Result<(CpuStorage, Shape)> {
        let (([h, w], c), o, n) = (image_dims(lx)?, lw.dims()[0], lx.dims()[0]);
        let (taps, [up, across]) = (c * self.window.kernel.pow(2), [h, w].map(|n| self.window.output(n)));
        let (x, weights) = (values(x, lx)?, Matrix::new(values(weights, lw)?, taps).transposed());
        let mut unfolded = vec![0.0; up * across * taps];
        let mut y = vec![0.0; n * up * across * o];
        for (image, out) in x.chunks_exact(h * w * c).zip(y.chunks_exact_mut(up * across * o)) {
            self.window.unfold(image, c, [h, w], &mut unfolded);
            multiply(out, Accum::Replace, Matrix::new(&unfolded, taps), weights);
        }
        Ok((CpuStorage::F32(y), (n, up, across, o).into()))
    }

    fn bwd(&self, x: &Tensor, w: &Tensor, _: &Tensor, grad: &Tensor) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let (window, grad) = (self.window, grad.contiguous()?);
        let sides = [x.dim(1)?, x.dim(2)?];
        // The input patterns need no gradient.
        let dx = x
            .track_op()
            .then(|| grad.apply_op2_no_bwd(w, &Transposed { window, sides }));
        let dw = x.apply_op2_no_bwd(&grad, &WeightGradient { window })?;
        Ok((dx.transpose()?, Some(dw)))
    }
}

impl CustomOp2 for Transposed {
    fn name(&self) -> &'static str {
        "convolve-transposed"
    }

    fn cpu_fwd(&self, y: &CpuStorage, ly: &Layout, weights: &CpuStorage, lw: &Layout) -> Result<(CpuStorage, Shape)> {
        let (([h, w], o), c, n) = (image_dims(ly)?, lw.dims()[3], ly.dims()[0]);
        let (taps, [up, across]) = (c * self.window.kernel.pow(2), self.sides);
        let (y, weights) = (values(y, ly)?, Matrix::new(values(weights, lw)?, taps));
        let mut unfolded = vec![0.0; h * w * taps];
        let mut x = vec![0.0; n * up * across * c];
        for (image, out) in y.chunks_exact(h * w * o).zip(x.chunks_exact_mut(up * across * c)) {
            multiply(&mut unfolded, Accum::Replace, Matrix::new(image, o), weights);
            self.window.fold(&unfolded, c, self.sides, out);
        }
        Ok((CpuStorage::F32(x), (n, up, across, c).into()))
    }

    fn bwd(&self, y: &Tensor, w: &Tensor, _: &Tensor, grad: &Tensor) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let (window, grad) = (self.window, grad.contiguous()?);
        let dy = grad.apply_op2_no_bwd(w, &Convolution { window })?;
        let dw = grad.apply_op2_no_bwd(y, &WeightGradient { window })?;
        Ok((Some(dy), Some(dw)))
    }
}

impl CustomOp2 for WeightGradient {
    fn name(&self) -> &'static str {
        "convolve-weight-gradient"
    }

    fn cpu_fwd(&self, x: &CpuStorage, lx: &Layout, y: &CpuStorage, ly: &Layout) -> Result<(CpuStorage, Shape)> {
        let (([h, w], c), ([up, across], o)) = (image_dims(lx)?, image_dims(ly)?);
        let taps = c * self.window.kernel.pow(2);
        let (x, y) = (values(x, lx)?, values(y, ly)?);
        let mut unfolded = vec![0.0; up * across * taps];
        let mut weights = vec![0.0; o * taps];
        for (image, out) in x.chunks_exact(h * w * c).zip(y.chunks_exact(up * across * o)) {
            self.window.unfold(image, c, [h, w], &mut unfolded);
            let out = Matrix::new(out, o).transposed();
            multiply(&mut weights, Accum::Add, out, Matrix::new(&unfolded, taps));
        }
        let kernel = self.window.kernel;
        Ok((CpuStorage::F32(weights), (o, kernel, kernel, c).into()))
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};
    use candle_nn::ops::leaky_relu;

    use super::*;

    const CHANNELS_FIRST: (usize, usize, usize, usize) = (0, 3, 1, 2);
    const CHANNELS_LAST: (usize, usize, usize, usize) = (0, 2, 3, 1);
    /// A power of two: products with it are exact.
    const SLOPE: f32 = 0.5;

    /// Small integers, so that every sum below is exact in f32.
    fn numbers(dims: &[usize], salt: usize) -> Tensor {
        let count = dims.iter().product();
        let values: Vec<f32> = (0..count).map(|i| ((i * 31 + salt) * 17 % 11) as f32 - 5.0).collect();
        Tensor::from_vec(values, dims, &Device::Cpu).unwrap()
    }

    fn flat(x: &Tensor) -> Vec<f32> {
        x.flatten_all().unwrap().to_vec1().unwrap()
    }

    /// Compares a layer with one of candle-nn with the same variables (input, weights, bias): value and gradients.
    fn assert_equal(vars: &[Var; 3], layer: &dyn Module, of_candle: &dyn Fn([&Tensor; 3]) -> Result<Tensor>) {
        let [x, weights, bias] = vars;
        let found = layer.forward(x).unwrap();
        let first = |t: &Tensor| t.permute(CHANNELS_FIRST).unwrap().contiguous().unwrap();
        let expected = of_candle([&first(x), &first(weights), bias]).unwrap();
        let expected = expected.permute(CHANNELS_LAST).unwrap();
        assert_eq!((found.dims(), flat(&found)), (expected.dims(), flat(&expected)));
        let c = numbers(found.dims(), 3);
        let gradients = |y: &Tensor| (y * &c).unwrap().sum_all().unwrap().backward().unwrap();
        let (found, expected) = (gradients(&found), gradients(&expected));
        for var in vars {
            assert_eq!(
                flat(found.get(var).unwrap()),
                flat(expected.get(var).unwrap()),
                "{:?}",
                var.dims()
            );
        }
    }

    fn vars(x: &[usize], weights: &[usize], outputs: usize) -> [Var; 3] {
        // With this bias no sum is zero, where the rectifier has no gradient.
        let bias = (numbers(&[outputs], 2) + 0.25).unwrap();
        [numbers(x, 0), numbers(weights, 1), bias].map(|values| Var::from_tensor(&values).unwrap())
    }

    #[test]
    fn convolutions_equal_candle() {
        for (side, kernel, stride, padding) in [(50, 10, 2, 4), (25, 7, 2, 3), (13, 5, 1, 2), (7, 1, 1, 0)] {
            let vars = vars(&[3, side, side + 2, 2], &[4, kernel, kernel, 2], 4);
            let config = Conv2dConfig {
                stride,
                padding,
                ..Conv2dConfig::default()
            };
            let layer = Conv2d {
                weights: vars[1].as_tensor().clone(),
                bias: vars[2].as_tensor().clone(),
                config,
                slope: SLOPE,
            };
            assert_equal(&vars, &layer, &|[x, weights, bias]| {
                let layer = candle_nn::Conv2d::new(weights.clone(), Some(bias.clone()), config);
                leaky_relu(&layer.forward(x)?, SLOPE.into())
            });
        }
    }

    #[test]
    fn transposed_convolutions_equal_candle() {
        for (side, kernel, slope) in [(13, 5, None), (25, 3, Some(SLOPE)), (4, 1, None)] {
            let vars = vars(&[3, side, side + 2, 2], &[2, kernel, kernel, 4], 4);
            let layer = ConvTranspose2d {
                weights: vars[1].as_tensor().clone(),
                bias: vars[2].as_tensor().clone(),
                slope,
            };
            let config = candle_nn::ConvTranspose2dConfig {
                stride: 2,
                padding: (kernel - 1) / 2,
                ..candle_nn::ConvTranspose2dConfig::default()
            };
            assert_equal(&vars, &layer, &|[x, weights, bias]| {
                let layer = candle_nn::ConvTranspose2d::new(weights.clone(), Some(bias.clone()), config);
                let y = layer.forward(x)?;
                slope.map_or(Ok(y.clone()), |slope| leaky_relu(&y, slope.into()))
            });
        }
    }

    /// The operation is linear in each argument, so the gradient g of ⟨c, f(x, w)⟩ obeys ⟨g, v⟩ = ⟨c, f(v, w)⟩ for
    /// every v.
    fn gradients_are_exact(dims: [&[usize]; 2], f: impl Fn(&Tensor, &Tensor) -> Result<Tensor>) {
        let [x, w] = [numbers(dims[0], 1), numbers(dims[1], 2)].map(|t| Var::from_tensor(&t).unwrap());
        let dot = |a: &Tensor, b: &Tensor| -> f32 { (a * b).unwrap().sum_all().unwrap().to_scalar().unwrap() };
        let y = f(&x, &w).unwrap();
        let c = numbers(y.dims(), 3);
        let grads = (&y * &c).unwrap().sum_all().unwrap().backward().unwrap();
        let (dx, dw) = (numbers(dims[0], 4), numbers(dims[1], 5));
        assert_eq!(dot(grads.get(&x).unwrap(), &dx), dot(&c, &f(&dx, &w).unwrap()));
        assert_eq!(dot(grads.get(&w).unwrap(), &dw), dot(&c, &f(&x, &dw).unwrap()));
    }

    #[test]
    fn gradients_are_those_of_a_bilinear_form() {
        for (side, kernel, stride, padding) in [(12, 4, 2, 1), (9, 5, 1, 2)] {
            let window = Window {
                kernel,
                stride,
                padding,
            };
            let dims: [&[usize]; 2] = [&[2, side, side + 3, 3], &[4, kernel, kernel, 3]];
            gradients_are_exact(dims, |x, w| x.apply_op2(w, Convolution { window }));
        }
        let window = Window {
            kernel: 5,
            stride: 2,
            padding: 2,
        };
        let sides = [13; 2];
        gradients_are_exact([&[2, 7, 7, 3], &[3, 5, 5, 4]], |x, w| {
            x.apply_op2(w, Transposed { window, sides })
        });
    }
}
