//! Convolution and transposed convolution, differentiable, for square images with their channels last.
//!
//! candle's own convolutions serve other devices; on the CPU their gradients are several times slower than their value,
//! so there they are computed here.

use candle_core::{CpuStorage, CustomOp2, Layout, Result, Shape, Tensor, bail};
use faer::Accum;

use super::gemm::{Matrix, multiply};
use super::storage::values;
use super::window::Window;

/// Convolution of `x` (n, h, h, c) with `weights` (o, kernel, kernel, c), zeros around: (n, h′, h′, o) with
/// h′ = (h + 2 padding − kernel)/stride + 1.
pub(crate) fn convolve(x: &Tensor, weights: &Tensor, stride: usize, padding: usize) -> Result<Tensor> {
    let kernel = weights.dim(1)?;
    if x.device().is_cpu() {
        let window = Window {
            kernel,
            stride,
            padding,
        };
        x.contiguous()?.apply_op2(weights, Convolution { window })
    } else {
        composed(x, weights, stride, padding)
    }
}

/// The transpose of the convolution with stride 2 that maps side 2h − 1 to side h: `x` (n, h, h, c) with `weights`
/// (c, kernel, kernel, o), odd kernel, to (n, 2h − 1, 2h − 1, o). The outer outputs lie on the outer inputs, so the
/// chain 7, 13, 25, 49 shares its grid points.
pub(crate) fn convolve_transposed(x: &Tensor, weights: &Tensor) -> Result<Tensor> {
    let (kernel, side) = (weights.dim(1)?, 2 * x.dim(1)? - 1);
    if x.device().is_cpu() {
        let padding = (kernel - 1) / 2;
        let window = Window {
            kernel,
            stride: 2,
            padding,
        };
        x.contiguous()?.apply_op2(weights, Transposed { window, side })
    } else {
        composed_transposed(x, weights)
    }
}

const CHANNELS_FIRST: (usize, usize, usize, usize) = (0, 3, 1, 2);
const CHANNELS_LAST: (usize, usize, usize, usize) = (0, 2, 3, 1);

/// [`convolve`] from candle's operations, for devices other than the CPU.
fn composed(x: &Tensor, weights: &Tensor, stride: usize, padding: usize) -> Result<Tensor> {
    let (x, weights) = (x.permute(CHANNELS_FIRST)?, weights.permute(CHANNELS_FIRST)?);
    x.contiguous()?
        .conv2d(&weights.contiguous()?, padding, stride, 1, 1)?
        .permute(CHANNELS_LAST)
}

/// [`convolve_transposed`] from candle's operations, for devices other than the CPU.
fn composed_transposed(x: &Tensor, weights: &Tensor) -> Result<Tensor> {
    let padding = (weights.dim(1)? - 1) / 2;
    let (x, weights) = (x.permute(CHANNELS_FIRST)?, weights.permute(CHANNELS_FIRST)?);
    x.contiguous()?
        .conv_transpose2d(&weights.contiguous()?, padding, 0, 2, 1)?
        .permute(CHANNELS_LAST)
}

/// y = unfold(x) · Wᵀ.
struct Convolution {
    window: Window,
}

/// x = fold(y · W), for images of side `side`.
struct Transposed {
    window: Window,
    side: usize,
}

/// W = yᵀ · unfold(x), summed over the images in order.
struct WeightGradient {
    window: Window,
}

/// (side, channels) of a batch of square images.
fn square(layout: &Layout) -> Result<(usize, usize)> {
    match layout.dims() {
        &[_, h, w, c] if h == w => Ok((h, c)),
        dims => bail!("expected square images, found {dims:?}"),
    }
}

impl CustomOp2 for Convolution {
    fn name(&self) -> &'static str {
        "convolve"
    }

    fn cpu_fwd(&self, x: &CpuStorage, lx: &Layout, w: &CpuStorage, lw: &Layout) -> Result<(CpuStorage, Shape)> {
        let ((h, c), o, n) = (square(lx)?, lw.dims()[0], lx.dims()[0]);
        let (taps, side) = (c * self.window.kernel.pow(2), self.window.output(h));
        let (x, weights) = (values(x, lx)?, Matrix::new(values(w, lw)?, taps).transposed());
        let mut unfolded = vec![0.0; side * side * taps];
        let mut y = vec![0.0; n * side * side * o];
        for (image, out) in x.chunks_exact(h * h * c).zip(y.chunks_exact_mut(side * side * o)) {
            self.window.unfold(image, c, h, &mut unfolded);
            multiply(out, Accum::Replace, Matrix::new(&unfolded, taps), weights);
        }
        Ok((CpuStorage::F32(y), (n, side, side, o).into()))
    }

    fn bwd(&self, x: &Tensor, w: &Tensor, _: &Tensor, grad: &Tensor) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let (window, side, grad) = (self.window, x.dim(1)?, grad.contiguous()?);
        // The patterns themselves need no gradient.
        let dx = if x.track_op() {
            Some(grad.apply_op2_no_bwd(w, &Transposed { window, side })?)
        } else {
            None
        };
        let dw = x.apply_op2_no_bwd(&grad, &WeightGradient { window })?;
        Ok((dx, Some(dw)))
    }
}

impl CustomOp2 for Transposed {
    fn name(&self) -> &'static str {
        "convolve-transposed"
    }

    fn cpu_fwd(&self, y: &CpuStorage, ly: &Layout, w: &CpuStorage, lw: &Layout) -> Result<(CpuStorage, Shape)> {
        let ((h, o), c, n) = (square(ly)?, lw.dims()[3], ly.dims()[0]);
        let (taps, side) = (c * self.window.kernel.pow(2), self.side);
        let (y, weights) = (values(y, ly)?, Matrix::new(values(w, lw)?, taps));
        let mut unfolded = vec![0.0; h * h * taps];
        let mut x = vec![0.0; n * side * side * c];
        for (image, out) in y.chunks_exact(h * h * o).zip(x.chunks_exact_mut(side * side * c)) {
            multiply(&mut unfolded, Accum::Replace, Matrix::new(image, o), weights);
            self.window.fold(&unfolded, c, side, out);
        }
        Ok((CpuStorage::F32(x), (n, side, side, c).into()))
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
        let ((h, c), (side, o)) = (square(lx)?, square(ly)?);
        let taps = c * self.window.kernel.pow(2);
        let (x, y) = (values(x, lx)?, values(y, ly)?);
        let mut unfolded = vec![0.0; side * side * taps];
        let mut w = vec![0.0; o * taps];
        for (image, out) in x.chunks_exact(h * h * c).zip(y.chunks_exact(side * side * o)) {
            self.window.unfold(image, c, h, &mut unfolded);
            multiply(
                &mut w,
                Accum::Add,
                Matrix::new(out, o).transposed(),
                Matrix::new(&unfolded, taps),
            );
        }
        let kernel = self.window.kernel;
        Ok((CpuStorage::F32(w), (o, kernel, kernel, c).into()))
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};

    use super::*;

    /// Small whole numbers, so that every sum below is exact in f32.
    fn numbers(dims: (usize, usize, usize, usize), salt: usize) -> Tensor {
        let count = dims.0 * dims.1 * dims.2 * dims.3;
        let values: Vec<f32> = (0..count).map(|i| ((i * 31 + salt) * 17 % 11) as f32 - 5.0).collect();
        Tensor::from_vec(values, dims, &Device::Cpu).unwrap()
    }

    fn dot(a: &Tensor, b: &Tensor) -> f32 {
        (a * b).unwrap().sum_all().unwrap().to_scalar().unwrap()
    }

    fn flat(x: &Tensor) -> Vec<f32> {
        x.flatten_all().unwrap().to_vec1().unwrap()
    }

    #[test]
    fn other_devices_would_compute_the_same() {
        for (side, kernel, stride, padding) in [(50, 10, 2, 4), (25, 7, 2, 3), (13, 5, 1, 2), (7, 1, 1, 0)] {
            let (x, w) = (numbers((3, side, side, 2), 1), numbers((4, kernel, kernel, 2), 2));
            let expected = composed(&x, &w, stride, padding).unwrap();
            let found = convolve(&x, &w, stride, padding).unwrap();
            assert_eq!((found.dims(), flat(&found)), (expected.dims(), flat(&expected)));
        }
        for (side, kernel) in [(13, 5), (25, 3), (4, 1)] {
            let (x, w) = (numbers((3, side, side, 2), 1), numbers((2, kernel, kernel, 4), 2));
            let expected = composed_transposed(&x, &w).unwrap();
            let found = convolve_transposed(&x, &w).unwrap();
            assert_eq!((found.dims(), flat(&found)), (expected.dims(), flat(&expected)));
        }
    }

    /// The operation is linear in each argument, so the gradient g of ⟨c, f(x, w)⟩ obeys ⟨g, v⟩ = ⟨c, f(v, w)⟩ for every v.
    fn gradients_are_exact(x: &Tensor, w: &Tensor, f: impl Fn(&Tensor, &Tensor) -> Result<Tensor>) {
        let (x, w) = (Var::from_tensor(x).unwrap(), Var::from_tensor(w).unwrap());
        let y = f(&x, &w).unwrap();
        let c = numbers(y.dims4().unwrap(), 3);
        let grads = (&y * &c).unwrap().sum_all().unwrap().backward().unwrap();
        let (dx, dw) = (numbers(x.dims4().unwrap(), 4), numbers(w.dims4().unwrap(), 5));
        assert_eq!(dot(grads.get(&x).unwrap(), &dx), dot(&c, &f(&dx, &w).unwrap()));
        assert_eq!(dot(grads.get(&w).unwrap(), &dw), dot(&c, &f(&x, &dw).unwrap()));
    }

    #[test]
    fn gradients_are_those_of_a_bilinear_form() {
        for (side, kernel, stride, padding) in [(12, 4, 2, 1), (9, 5, 1, 2)] {
            let (x, w) = (numbers((2, side, side, 3), 1), numbers((4, kernel, kernel, 3), 2));
            gradients_are_exact(&x, &w, |x, w| convolve(x, w, stride, padding));
        }
        let (x, w) = (numbers((2, 7, 7, 3), 1), numbers((3, 5, 5, 4), 2));
        gradients_are_exact(&x, &w, convolve_transposed);
    }
}
