//! The displacement that forces on the corners cause in a membrane held at its frame, if each component obeyed Laplace's
//! equation: what the elastic tangent of a highly prestretched membrane is but for a term 1/λp⁴ as large.

use std::f64::consts::PI;
use std::sync::LazyLock;

use candle_core::{CpuStorage, CustomOp1, Device, Layout, Result, Shape, Tensor, bail};
use faer::Accum;
use pulp::Arch;

use super::gemm::{Matrix, multiply};
use super::storage::values;
use crate::pattern::CELLS;

/// Corners along a side without the frame, and sine waves.
const INNER: usize = CELLS - 1;
const PLANE: usize = INNER * INNER;

/// Displacements of forces, both (n, 2, 49, 49): the five-point Laplacian on the corners, a cell being the unit of length, is
/// inverted in its sine waves. The map is its own transpose.
pub(crate) fn green(forces: &Tensor) -> Result<Tensor> {
    if forces.device().is_cpu() {
        return forces.contiguous()?.apply_op1(Green);
    }
    let (sines, inverse) = green_tables(forces.device())?;
    let transformed = |x: &Tensor| sines.broadcast_matmul(&x.broadcast_matmul(&sines)?);
    transformed(&transformed(forces)?.broadcast_mul(&inverse)?)
}

/// The tables of the transform as tensors (49, 49): the sines, and one over the eigenvalues.
pub(crate) fn green_tables(device: &Device) -> Result<(Tensor, Tensor)> {
    let table = |values: &[f32]| Tensor::from_slice(values, (INNER, INNER), device);
    Ok((table(&TABLES.sines)?, table(&TABLES.inverse)?))
}

/// The tables of the transform, row by row.
pub(crate) struct Tables {
    /// sin(π (i+1)(k+1)/50) times √(2/50): symmetric and its own inverse.
    pub(crate) sines: Vec<f32>,
    /// One over the eigenvalue of each pair of waves.
    pub(crate) inverse: Vec<f32>,
}

/// The tables.
pub(crate) static TABLES: LazyLock<Tables> = LazyLock::new(|| {
    let each = |value: &dyn Fn(f64, f64) -> f64| -> Vec<f32> {
        let wave = |at: usize| value((at / INNER + 1) as f64, (at % INNER + 1) as f64) as f32;
        (0..PLANE).map(wave).collect()
    };
    let cells = CELLS as f64;
    let eigenvalue = |k: f64| 2.0 - 2.0 * (PI * k / cells).cos();
    Tables {
        sines: each(&|i, k| (2.0 / cells).sqrt() * (PI * i * k / cells).sin()),
        inverse: each(&|k, l| 1.0 / (eigenvalue(k) + eigenvalue(l))),
    }
});

/// The map on planes one after another; `scratch` is one plane.
pub(super) fn green_planes(forces: &[f32], displacements: &mut [f32], scratch: &mut [f32]) {
    let sines = Matrix::new(&TABLES.sines, INNER);
    for (f, u) in forces.chunks_exact(PLANE).zip(displacements.chunks_exact_mut(PLANE)) {
        multiply(scratch, Accum::Replace, Matrix::new(f, INNER), sines);
        multiply(u, Accum::Replace, sines, Matrix::new(scratch, INNER));
        Arch::new().dispatch(
            #[inline(always)]
            || u.iter_mut().zip(&TABLES.inverse).for_each(|(u, inverse)| *u *= inverse),
        );
        multiply(scratch, Accum::Replace, Matrix::new(u, INNER), sines);
        multiply(u, Accum::Replace, sines, Matrix::new(scratch, INNER));
    }
}

struct Green;

impl CustomOp1 for Green {
    fn name(&self) -> &'static str {
        "green"
    }

    fn cpu_fwd(&self, f: &CpuStorage, lf: &Layout) -> Result<(CpuStorage, Shape)> {
        if !matches!(lf.dims(), [_, 2, INNER, INNER]) {
            bail!("expected forces on the inner corners, found {:?}", lf.dims());
        }
        let f = values(f, lf)?;
        let (mut u, mut scratch) = (vec![0.0; f.len()], vec![0.0; PLANE]);
        green_planes(f, &mut u, &mut scratch);
        Ok((CpuStorage::F32(u), lf.shape().clone()))
    }

    fn bwd(&self, _: &Tensor, _: &Tensor, grad: &Tensor) -> Result<Option<Tensor>> {
        grad.contiguous()?.apply_op1_no_bwd(&Green).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use candle_core::Var;

    use super::*;

    fn numbers(salt: usize) -> Tensor {
        let value = |i: usize| ((i * 31 + salt) * 17 % 11) as f32 - 5.0;
        let values: Vec<f32> = (0..2 * PLANE).map(value).collect();
        Tensor::from_vec(values, (1, 2, INNER, INNER), &Device::Cpu).unwrap()
    }

    fn flat(x: &Tensor) -> Vec<f64> {
        let values: Vec<f32> = x.flatten_all().unwrap().to_vec1().unwrap();
        values.into_iter().map(f64::from).collect()
    }

    fn dot(a: &Tensor, b: &Tensor) -> f64 {
        flat(a).iter().zip(flat(b)).map(|(a, b)| a * b).sum()
    }

    #[test]
    fn the_five_point_laplacian_gives_the_forces_back() {
        let f = numbers(1);
        let (u, f) = (flat(&green(&f).unwrap()), flat(&f));
        let at = |plane: usize, y: usize, x: usize| {
            let inside = |i: usize| (1..=INNER).contains(&i);
            if inside(x) && inside(y) {
                u[plane * PLANE + (y - 1) * INNER + x - 1]
            } else {
                0.0
            }
        };
        for (i, force) in f.iter().enumerate() {
            let (plane, y, x) = (i / PLANE, i % PLANE / INNER + 1, i % INNER + 1);
            let around = at(plane, y - 1, x) + at(plane, y + 1, x) + at(plane, y, x - 1) + at(plane, y, x + 1);
            let found = 4.0 * at(plane, y, x) - around;
            assert!((found - force).abs() < 1e-3, "{i}: {found} {force}");
        }
    }

    #[test]
    fn the_gradient_is_the_map_itself() {
        let f = Var::from_tensor(&numbers(1)).unwrap();
        let (c, along) = (numbers(2), numbers(3));
        let grads = (green(&f).unwrap() * &c)
            .unwrap()
            .sum_all()
            .unwrap()
            .backward()
            .unwrap();
        let (found, expected) = (dot(grads.get(&f).unwrap(), &along), dot(&c, &green(&along).unwrap()));
        assert!((found / expected - 1.0).abs() < 1e-4, "{found} {expected}");
    }
}
