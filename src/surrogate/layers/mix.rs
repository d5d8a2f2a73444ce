//! Mixing over the whole image: every output position depends on every input position.
//!
//! The elastic response of a membrane is global (Green's function of the Laplacian decays like a logarithm), so small
//! windows are not enough.

use candle_core::{CpuStorage, CustomOp2, Layout, Module, Result, Shape, Tensor, bail};
use candle_nn::{Init, VarBuilder};
use deaflow_linalg::Accum;

use super::gemm::{Matrix, multiply, multiply_into};
use super::storage::values;

/// Multiplies the hw positions of an image (n, h, w, c) by a matrix for each of g groups of neighbouring channels. The
/// `weights` are (g, hw, hw), and g divides c.
pub(crate) struct Mixing {
    pub(crate) weights: Tensor,
    /// Number of channels c.
    pub(crate) width: usize,
    /// Rows and columns of the images.
    pub(crate) sides: [usize; 2],
}

impl Mixing {
    /// Creates the layer from the tensor `mixing`, for images with `sides` rows and columns and `width` channels.
    pub(crate) fn new(groups: usize, sides: [usize; 2], width: usize, builder: &VarBuilder<'_>) -> Result<Self> {
        let positions = sides[0] * sides[1];
        let stdev = (1.0 / positions as f64).sqrt();
        let (dims, init) = ((groups, positions, positions), Init::Randn { mean: 0.0, stdev });
        let weights = builder.get_with_hints(dims, "mixing", init)?;
        Ok(Self { weights, width, sides })
    }
}

impl Module for Mixing {
    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let (n, h, w, c) = x.dims4()?;
        let positions = x.reshape((n, h * w, c))?;
        let mixed = positions.apply_op2(&self.weights, Mix { transposed: false })?;
        mixed.reshape((n, h, w, c))
    }
}

/// `y[n][:, g] = W[g] · x[n][:, g]`, or `W[g]ᵀ · x[n][:, g]`.
struct Mix {
    transposed: bool,
}

/// `W[g] = Σ_n y[n][:, g] · x[n][:, g]ᵀ` for each group, summed in order.
struct MixGradient {
    groups: usize,
}

/// Returns (positions, channels).
fn dims(layout: &Layout) -> Result<(usize, usize)> {
    match layout.dims() {
        &[_, p, c] => Ok((p, c)),
        dims => bail!("expected positions and channels, found {dims:?}"),
    }
}

impl CustomOp2 for Mix {
    fn name(&self) -> &'static str {
        "mix"
    }

    fn cpu_fwd(&self, x: &CpuStorage, lx: &Layout, w: &CpuStorage, lw: &Layout) -> Result<(CpuStorage, Shape)> {
        let ((p, c), groups) = (dims(lx)?, lw.dims()[0]);
        let (x, w, width) = (values(x, lx)?, values(w, lw)?, c / groups);
        let mut y = vec![0.0; x.len()];
        for (x, y) in x.chunks_exact(p * c).zip(y.chunks_exact_mut(p * c)) {
            for (group, w) in w.chunks_exact(p * p).enumerate() {
                let (w, first) = (Matrix::new(w, p), group * width);
                let w = if self.transposed { w.transposed() } else { w };
                multiply_into(y, c, first, Accum::Replace, w, Matrix::new(x, c).columns(first, width));
            }
        }
        Ok((CpuStorage::F32(y), lx.shape().clone()))
    }

    fn bwd(&self, x: &Tensor, w: &Tensor, _: &Tensor, grad: &Tensor) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let (grad, groups) = (grad.contiguous()?, w.dim(0)?);
        let dx = grad.apply_op2_no_bwd(w, &Mix { transposed: true })?;
        Ok((Some(dx), Some(x.apply_op2_no_bwd(&grad, &MixGradient { groups })?)))
    }
}

impl CustomOp2 for MixGradient {
    fn name(&self) -> &'static str {
        "mix-gradient"
    }

    fn cpu_fwd(&self, x: &CpuStorage, lx: &Layout, y: &CpuStorage, ly: &Layout) -> Result<(CpuStorage, Shape)> {
        let (p, c) = dims(lx)?;
        let (x, y, width) = (values(x, lx)?, values(y, ly)?, c / self.groups);
        let mut w = vec![0.0; self.groups * p * p];
        for (x, y) in x.chunks_exact(p * c).zip(y.chunks_exact(p * c)) {
            for (group, w) in w.chunks_exact_mut(p * p).enumerate() {
                let columns = |values| Matrix::new(values, c).columns(group * width, width);
                multiply(w, Accum::Add, columns(y), columns(x).transposed());
            }
        }
        Ok((CpuStorage::F32(w), (self.groups, p, p).into()))
    }
}

#[cfg(test)]
mod tests {
    use candle_core::{Device, Var};

    use super::*;

    fn numbers(dims: &[usize], salt: usize) -> Tensor {
        let count = dims.iter().product();
        let values: Vec<f32> = (0..count).map(|i| ((i * 31 + salt) * 17 % 11) as f32 - 5.0).collect();
        Tensor::from_vec(values, dims, &Device::Cpu).unwrap()
    }

    fn dot(a: &Tensor, b: &Tensor) -> f32 {
        (a * b).unwrap().sum_all().unwrap().to_scalar().unwrap()
    }

    fn mix(x: &Tensor, weights: &Tensor) -> Result<Tensor> {
        let (_, rows, columns, width) = x.dims4()?;
        let (weights, sides) = (weights.clone(), [rows, columns]);
        Mixing { weights, width, sides }.forward(x)
    }

    #[test]
    fn it_equals_a_matrix_product() {
        let (x, w) = (numbers(&[3, 4, 4, 6], 1), numbers(&[2, 16, 16], 2));
        let groups = x.reshape((3, 16, 2, 3)).unwrap().transpose(1, 2).unwrap();
        let expected = w.unsqueeze(0).unwrap().broadcast_matmul(&groups.contiguous().unwrap());
        let found = mix(&x, &w).unwrap();
        assert_eq!(found.dims(), &[3, 4, 4, 6]);
        let flat = |x: &Tensor| x.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        assert_eq!(flat(&found), flat(&expected.unwrap().transpose(1, 2).unwrap()));
    }

    #[test]
    fn every_group_of_channels_has_its_matrix() {
        // Identity for the first group, zero for the second.
        let mut w = vec![0.0f32; 2 * 16];
        (0..4).for_each(|i| w[i * 5] = 1.0);
        let w = Tensor::from_vec(w, (2, 4, 4), &Device::Cpu).unwrap();
        let x = numbers(&[1, 2, 2, 6], 1);
        let y = mix(&x, &w).unwrap();
        let part = |t: &Tensor, first| {
            t.narrow(3, first, 3)
                .unwrap()
                .flatten_all()
                .unwrap()
                .to_vec1::<f32>()
                .unwrap()
        };
        assert_eq!(part(&y, 0), part(&x, 0));
        assert_eq!(part(&y, 3), [0.0; 12]);
    }

    #[test]
    fn gradients_are_those_of_a_bilinear_form() {
        let x = Var::from_tensor(&numbers(&[2, 3, 3, 4], 1)).unwrap();
        let w = Var::from_tensor(&numbers(&[2, 9, 9], 2)).unwrap();
        let y = mix(&x, &w).unwrap();
        let c = numbers(y.dims(), 3);
        let grads = (&y * &c).unwrap().sum_all().unwrap().backward().unwrap();
        let (dx, dw) = (numbers(x.dims(), 4), numbers(w.dims(), 5));
        assert_eq!(dot(grads.get(&x).unwrap(), &dx), dot(&c, &mix(&dx, &w).unwrap()));
        assert_eq!(dot(grads.get(&w).unwrap(), &dw), dot(&c, &mix(&x, &dw).unwrap()));
    }
}
