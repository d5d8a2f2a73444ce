//! Maps of the channels of every cell, for images with their channels first: one matrix for all cells, and the product of
//! two halves.

use candle_core::{CpuStorage, CustomOp1, CustomOp2, Layout, Result, Shape, Tensor, bail};
use faer::Accum;

use super::gemm::{Matrix, multiply};
use super::storage::values;

/// `weights` (m, c) times `x` (n, c, cells) at every cell: (n, m, cells).
pub(crate) fn map_channels(x: &Tensor, weights: &Tensor) -> Result<Tensor> {
    if x.device().is_cpu() {
        x.apply_op2(&weights.contiguous()?, Map { transposed: false })
    } else {
        weights.unsqueeze(0)?.broadcast_matmul(x)
    }
}

/// The product of the first and the second half of the channels, (n, 2m, cells) to (n, m, cells): a gated unit whose gate is
/// linear (Dauphin et al., "Language modeling with gated convolutional networks", ICML 2017, there called bilinear).
pub(crate) fn multiply_halves(x: &Tensor) -> Result<Tensor> {
    if x.device().is_cpu() {
        return x.apply_op1(Halves);
    }
    let half = x.dim(1)? / 2;
    x.narrow(1, 0, half)? * x.narrow(1, half, half)?
}

/// y = W x or Wᵀ x.
struct Map {
    transposed: bool,
}

/// W = Σ y xᵀ over the images, in order.
struct MapGradient;

struct Halves;

/// The gradient of [`Halves`] from (x, dy).
struct HalvesGradient;

/// (channels, cells).
fn dims(layout: &Layout) -> Result<(usize, usize)> {
    match layout.dims() {
        &[_, channels, cells] => Ok((channels, cells)),
        dims => bail!("expected channels and cells, found {dims:?}"),
    }
}

impl CustomOp2 for Map {
    fn name(&self) -> &'static str {
        "map-channels"
    }

    fn cpu_fwd(&self, x: &CpuStorage, lx: &Layout, w: &CpuStorage, lw: &Layout) -> Result<(CpuStorage, Shape)> {
        let ((c, cells), n, columns) = (dims(lx)?, lx.dims()[0], lw.dims()[1]);
        let (x, w) = (values(x, lx)?, Matrix::new(values(w, lw)?, columns));
        let (w, out) = if self.transposed {
            (w.transposed(), columns)
        } else {
            (w, lw.dims()[0])
        };
        let mut y = vec![0.0; n * out * cells];
        for (x, y) in x.chunks_exact(c * cells).zip(y.chunks_exact_mut(out * cells)) {
            multiply(y, Accum::Replace, w, Matrix::new(x, cells));
        }
        Ok((CpuStorage::F32(y), (n, out, cells).into()))
    }

    fn bwd(&self, x: &Tensor, w: &Tensor, _: &Tensor, grad: &Tensor) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let grad = grad.contiguous()?;
        let dx = if x.track_op() {
            Some(grad.apply_op2_no_bwd(w, &Map { transposed: true })?)
        } else {
            None
        };
        Ok((dx, Some(x.apply_op2_no_bwd(&grad, &MapGradient)?)))
    }
}

impl CustomOp2 for MapGradient {
    fn name(&self) -> &'static str {
        "map-channels-gradient"
    }

    fn cpu_fwd(&self, x: &CpuStorage, lx: &Layout, y: &CpuStorage, ly: &Layout) -> Result<(CpuStorage, Shape)> {
        let ((c, cells), (m, _)) = (dims(lx)?, dims(ly)?);
        let (x, y) = (values(x, lx)?, values(y, ly)?);
        let mut w = vec![0.0; m * c];
        for (x, y) in x.chunks_exact(c * cells).zip(y.chunks_exact(m * cells)) {
            let x = Matrix::new(x, cells).transposed();
            multiply(&mut w, Accum::Add, Matrix::new(y, cells), x);
        }
        Ok((CpuStorage::F32(w), (m, c).into()))
    }
}

impl CustomOp1 for Halves {
    fn name(&self) -> &'static str {
        "multiply-halves"
    }

    fn cpu_fwd(&self, x: &CpuStorage, lx: &Layout) -> Result<(CpuStorage, Shape)> {
        let ((c, cells), x) = (dims(lx)?, values(x, lx)?);
        let mut y = Vec::with_capacity(x.len() / 2);
        for image in x.chunks_exact(c * cells) {
            let (a, b) = image.split_at(c / 2 * cells);
            y.extend(a.iter().zip(b).map(|(a, b)| a * b));
        }
        Ok((CpuStorage::F32(y), (lx.dims()[0], c / 2, cells).into()))
    }

    fn bwd(&self, x: &Tensor, _: &Tensor, grad: &Tensor) -> Result<Option<Tensor>> {
        x.apply_op2_no_bwd(&grad.contiguous()?, &HalvesGradient).map(Some)
    }
}

impl CustomOp2 for HalvesGradient {
    fn name(&self) -> &'static str {
        "multiply-halves-gradient"
    }

    fn cpu_fwd(&self, x: &CpuStorage, lx: &Layout, g: &CpuStorage, lg: &Layout) -> Result<(CpuStorage, Shape)> {
        let ((c, cells), (x, g)) = (dims(lx)?, (values(x, lx)?, values(g, lg)?));
        let mut dx = Vec::with_capacity(x.len());
        for (image, g) in x.chunks_exact(c * cells).zip(g.chunks_exact(c / 2 * cells)) {
            let (a, b) = image.split_at(c / 2 * cells);
            dx.extend(b.iter().zip(g).map(|(b, g)| b * g));
            dx.extend(a.iter().zip(g).map(|(a, g)| a * g));
        }
        Ok((CpuStorage::F32(dx), lx.shape().clone()))
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};

    use super::*;

    /// Small whole numbers, so that every sum below is exact in f32.
    fn numbers(dims: &[usize], salt: usize) -> Tensor {
        let count = dims.iter().product();
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
        let (x, w) = (numbers(&[3, 4, 7], 1), numbers(&[6, 4], 2));
        let expected = w.unsqueeze(0).unwrap().broadcast_matmul(&x).unwrap();
        let found = map_channels(&x, &w).unwrap();
        assert_eq!((found.dims(), flat(&found)), (&[3, 6, 7][..], flat(&expected)));
        let halves = (found.narrow(1, 0, 3).unwrap() * found.narrow(1, 3, 3).unwrap()).unwrap();
        assert_eq!(flat(&multiply_halves(&found).unwrap()), flat(&halves));
    }

    #[test]
    fn gradients_are_those_of_bilinear_forms() {
        let (x, w) = (numbers(&[2, 4, 5], 1), numbers(&[6, 4], 2));
        let (x, w) = (Var::from_tensor(&x).unwrap(), Var::from_tensor(&w).unwrap());
        let y = map_channels(&x, &w).unwrap();
        let c = numbers(y.dims(), 3);
        let grads = (&y * &c).unwrap().sum_all().unwrap().backward().unwrap();
        let (dx, dw) = (numbers(&[2, 4, 5], 4), numbers(&[6, 4], 5));
        assert_eq!(
            dot(grads.get(&x).unwrap(), &dx),
            dot(&c, &map_channels(&dx, &w).unwrap())
        );
        assert_eq!(
            dot(grads.get(&w).unwrap(), &dw),
            dot(&c, &map_channels(&x, &dw).unwrap())
        );

        // The product of halves is quadratic: q(x + dx) − q(x) − q(dx) is its gradient along dx.
        let y = multiply_halves(&x).unwrap();
        let c = numbers(y.dims(), 3);
        let grads = (&y * &c).unwrap().sum_all().unwrap().backward().unwrap();
        let moved = multiply_halves(&(x.as_tensor() + &dx).unwrap()).unwrap();
        let slope = ((moved - y).unwrap() - multiply_halves(&dx).unwrap()).unwrap();
        assert_eq!(dot(grads.get(&x).unwrap(), &dx), dot(&c, &slope));
    }
}
