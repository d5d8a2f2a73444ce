//! A correction as one fused operation: features, local law, forces and Green's function, image by image in reused
//! memory. Separate candle operations (`plain`, the reference in tests) allocate ten times the memory and make
//! training several times slower.

use std::cell::Cell;
use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp3, Device, Layout, Result, Shape, Tensor, bail};
use deaflow_fem::registers::dispatch;
use deaflow_linalg::Accum;

use super::cell::{FEATURES, MODES, add_forces, add_strain_forces, write_modes, write_strains, write_surroundings};
use super::gemm::{Matrix, multiply};
use super::green::{Green, GreenScratch};
use super::inner::add_inner_products;
use super::storage::values;
use crate::corners::inner_corners;
use deaflow_pattern::Raster;

/// The fixed operators of a device.
#[derive(Clone, Debug)]
pub(crate) struct DeviceOperator {
    /// Green's function.
    pub(crate) green: Green,
    /// Mask of the cells: 1 for membrane, 0 for frame and bodies, which have no law. `None` when all cells are
    /// membrane.
    pub(crate) cells: Option<Vec<f32>>,
}

impl DeviceOperator {
    fn raster(&self) -> Raster {
        self.green.raster()
    }

    /// Multiplies planes of cell values by the mask.
    pub(crate) fn mask(&self, values: &mut [f32]) {
        let Some(cells) = &self.cells else { return };
        for plane in values.chunks_exact_mut(cells.len()) {
            plane.iter_mut().zip(cells).for_each(|(value, cell)| *value *= cell);
        }
    }
}

/// The fixed factors of a correction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    /// Factor from the modes of the displacement to the features of the law.
    pub(crate) strain: f32,
    /// Factor from the output of Green's function to the displacement.
    pub(crate) length: f32,
}

/// A local law in all orientations; its matrices row by row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StressLaw<'a> {
    /// Maps from features to the factors of the products, (2 products, features): all first factors, then all second
    /// factors.
    pub(crate) factors: &'a [f32],
    /// Map from products and features to stresses, (modes, products + features).
    pub(crate) stresses: &'a [f32],
}

impl<'a> StressLaw<'a> {
    fn products(&self) -> usize {
        self.factors.len() / FEATURES / 2
    }

    /// Returns the maps from products and from features to stresses.
    fn parts(&self) -> [Matrix<'a>; 2] {
        let products = self.products();
        let both = Matrix::new(self.stresses, products + FEATURES);
        [both.columns(0, products), both.columns(products, FEATURES)]
    }
}

/// Memory for one image.
pub(crate) struct Workspace {
    raster: Raster,
    /// Products, then features: the inputs of the map to stresses.
    inputs: Vec<f32>,
    factors: Vec<f32>,
    products: usize,
    stresses: Vec<f32>,
    forces: Vec<f32>,
    moved: Vec<f32>,
    scratch: GreenScratch,
    gradients: Gradients,
}

/// Gradients with respect to features, factors and products of one image.
struct Gradients {
    features: Vec<f32>,
    factors: Vec<f32>,
    products: Vec<f32>,
}

thread_local! {
    /// The last workspace of the thread. To allocate half a megabyte for every few images would cost more time, in page
    /// faults, than the computation.
    static SPARE: Cell<Option<Workspace>> = const { Cell::new(None) };
}

impl Workspace {
    /// Calls `work` with the workspace of the thread, for laws with `products` products.
    pub(crate) fn with<R>(operator: &DeviceOperator, products: usize, work: impl FnOnce(&mut Self) -> R) -> R {
        let fits = |spare: &Self| spare.products == products && spare.raster == operator.raster();
        let mut workspace = match SPARE.take().filter(fits) {
            Some(spare) => spare,
            None => Self::new(operator, products),
        };
        workspace.scratch.fit(&operator.green);
        let result = work(&mut workspace);
        SPARE.set(Some(workspace));
        result
    }

    fn new(operator: &DeviceOperator, products: usize) -> Self {
        let raster = operator.raster();
        let (area, image) = (raster.cells(), 2 * inner_corners(raster));
        Self {
            raster,
            inputs: vec![0.0; (products + FEATURES) * area],
            factors: vec![0.0; 2 * products * area],
            products,
            stresses: vec![0.0; MODES * area],
            forces: vec![0.0; image],
            moved: vec![0.0; image],
            scratch: operator.green.scratch(),
            gradients: Gradients {
                features: vec![0.0; FEATURES * area],
                factors: vec![0.0; 2 * products * area],
                products: vec![0.0; products * area],
            },
        }
    }

    /// Sets the pattern (cells), ±½ per cell, of the next corrections.
    pub(crate) fn set_pattern(&mut self, pattern: &[f32]) {
        let features = &mut self.inputs[self.products * self.raster.cells()..];
        write_surroundings(self.raster, pattern, features);
    }

    /// Computes features, factors and products of a law at a displacement.
    fn set_inputs(&mut self, law: StressLaw<'_>, pattern: &[f32], displacement: &[f32], scale: Scale) {
        let area = self.raster.cells();
        let (products, features) = self.inputs.split_at_mut(self.products * area);
        write_strains(self.raster, pattern, displacement, scale.strain, features);
        let (factors, features) = (Matrix::new(law.factors, FEATURES), Matrix::new(features, area));
        multiply(&mut self.factors, Accum::Replace, factors, features);
        let (first, second) = self.factors.split_at(self.products * area);
        product(products, first, second);
    }

    /// Adds the correction of a law to the displacement (2, inner corners) of the pattern set by [`Self::set_pattern`].
    pub(crate) fn correct(
        &mut self,
        operator: &DeviceOperator,
        law: StressLaw<'_>,
        pattern: &[f32],
        displacement: &mut [f32],
        scale: Scale,
    ) {
        self.set_inputs(law, pattern, displacement, scale);
        let law = Matrix::new(law.stresses, self.products + FEATURES);
        let inputs = Matrix::new(&self.inputs, self.raster.cells());
        multiply(&mut self.stresses, Accum::Replace, law, inputs);
        operator.mask(&mut self.stresses);
        self.forces.fill(0.0);
        add_forces(self.raster, &self.stresses, &mut self.forces);
        operator.green.apply(&self.forces, &mut self.moved, &mut self.scratch);
        add_scaled(displacement, scale.length, &self.moved);
    }
}

/// Computes the elementwise product out = a · b.
fn product(out: &mut [f32], a: &[f32], b: &[f32]) {
    dispatch(
        #[inline(always)]
        || {
            let pairs = a.iter().zip(b);
            out.iter_mut().zip(pairs).for_each(|(out, (a, b))| *out = a * b)
        },
    );
}

/// Computes y += αx.
fn add_scaled(y: &mut [f32], alpha: f32, x: &[f32]) {
    dispatch(
        #[inline(always)]
        || y.iter_mut().zip(x).for_each(|(y, x)| *y += alpha * x),
    );
}

/// Adds the correction of a law to displacements (n, 2, rows − 1, columns − 1) of patterns (n, rows, columns), ±½ per
/// cell. The law is given by its factors and stresses, as in [`StressLaw`].
pub(crate) fn correct(
    operator: &Arc<DeviceOperator>,
    patterns: &Tensor,
    displacement: &Tensor,
    [factors, stresses]: [&Tensor; 2],
    scale: Scale,
) -> Result<Tensor> {
    let operation = Correct {
        operator: Arc::clone(operator),
        patterns: patterns.flatten_all()?.to_vec1()?,
        scale,
    };
    let displacement = displacement.contiguous()?;
    displacement.apply_op3(&factors.contiguous()?, &stresses.contiguous()?, operation)
}

struct Correct {
    operator: Arc<DeviceOperator>,
    patterns: Vec<f32>,
    scale: Scale,
}

impl CustomOp3 for Correct {
    fn name(&self) -> &'static str {
        "correct"
    }

    fn cpu_fwd(
        &self,
        u: &CpuStorage,
        lu: &Layout,
        factors: &CpuStorage,
        lf: &Layout,
        stresses: &CpuStorage,
        ls: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let law = StressLaw {
            factors: values(factors, lf)?,
            stresses: values(stresses, ls)?,
        };
        if law.stresses.len() != MODES * (law.products() + FEATURES) {
            let (factors, stresses) = (lf.dims(), ls.dims());
            bail!("factors {factors:?} and stresses {stresses:?} belong to different laws");
        }
        let mut corrected = values(u, lu)?.to_vec();
        let (operator, raster) = (&*self.operator, self.operator.raster());
        let images = corrected.chunks_exact_mut(2 * inner_corners(raster));
        let images = self.patterns.chunks_exact(raster.cells()).zip(images);
        Workspace::with(operator, law.products(), |workspace| {
            for (pattern, u) in images {
                workspace.set_pattern(pattern);
                workspace.correct(operator, law, pattern, u, self.scale);
            }
        });
        Ok((CpuStorage::F32(corrected), lu.shape().clone()))
    }

    fn bwd(
        &self,
        u: &Tensor,
        factors: &Tensor,
        stresses: &Tensor,
        _: &Tensor,
        grad: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>, Option<Tensor>)> {
        let flat = |tensor: &Tensor| tensor.flatten_all()?.to_vec1::<f32>();
        let (displacements, mut gradient) = (flat(u)?, flat(grad)?);
        let (factor_values, stress_values) = (flat(factors)?, flat(stresses)?);
        let law = StressLaw {
            factors: &factor_values,
            stresses: &stress_values,
        };
        let (operator, raster) = (&*self.operator, self.operator.raster());
        let mut back = Backward::new(operator, law, self.scale);
        let image = 2 * inner_corners(raster);
        let patterns = self.patterns.chunks_exact(raster.cells());
        let images = patterns.zip(displacements.chunks_exact(image));
        Workspace::with(operator, law.products(), |workspace| {
            for ((pattern, u), gradient) in images.zip(gradient.chunks_exact_mut(image)) {
                back.image(workspace, pattern, u, gradient);
            }
        });
        let tensor = |values: Vec<f32>, like: &Tensor| Tensor::from_vec(values, like.shape(), &Device::Cpu);
        let du = u.track_op().then(|| tensor(gradient, u)).transpose()?;
        let (by_factors, by_stresses) = (tensor(back.by_factors, factors)?, tensor(back.by_stresses, stresses)?);
        Ok((du, Some(by_factors), Some(by_stresses)))
    }
}

/// Gradients of a correction with respect to its law, summed over images in order.
struct Backward<'a> {
    operator: &'a DeviceOperator,
    law: StressLaw<'a>,
    scale: Scale,
    by_factors: Vec<f32>,
    by_stresses: Vec<f32>,
}

impl<'a> Backward<'a> {
    fn new(operator: &'a DeviceOperator, law: StressLaw<'a>, scale: Scale) -> Self {
        Self {
            operator,
            law,
            scale,
            by_factors: vec![0.0; law.factors.len()],
            by_stresses: vec![0.0; law.stresses.len()],
        }
    }

    /// Adds the gradients of an image. `gradient` is with respect to the output, and becomes that with respect to the
    /// input.
    fn image(&mut self, w: &mut Workspace, pattern: &[f32], displacement: &[f32], gradient: &mut [f32]) {
        let (raster, area) = (self.operator.raster(), self.operator.raster().cells());
        let (law, half) = (self.law, self.law.products() * area);
        w.set_pattern(pattern);
        w.set_inputs(law, pattern, displacement, self.scale);
        // Green's function is symmetric, and forces are the transpose of modes.
        self.operator.green.apply(gradient, &mut w.moved, &mut w.scratch);
        write_modes(raster, &w.moved, self.scale.length, &mut w.stresses);
        self.operator.mask(&mut w.stresses);
        add_inner_products(&mut self.by_stresses, &w.stresses, &w.inputs, area);
        let stresses = Matrix::new(&w.stresses, area);
        let [from_products, from_features] = law.parts();
        let back = &mut w.gradients;
        multiply(&mut back.products, Accum::Replace, from_products.transposed(), stresses);
        let (first, second) = back.factors.split_at_mut(half);
        let (a, b) = w.factors.split_at(half);
        product(first, &back.products, b);
        product(second, &back.products, a);
        add_inner_products(&mut self.by_factors, &back.factors, &w.inputs[half..], area);
        let factors = Matrix::new(&back.factors, area);
        let to_features = Matrix::new(law.factors, FEATURES).transposed();
        multiply(&mut back.features, Accum::Replace, to_features, factors);
        multiply(&mut back.features, Accum::Add, from_features.transposed(), stresses);
        let strain = self.scale.strain;
        add_strain_forces(raster, pattern, &back.features, strain, &mut w.stresses, gradient);
    }
}

#[cfg(test)]
mod tests {
    use candle_core::Var;

    use super::*;
    use crate::layers::{Supports, plain};

    const SCALE: Scale = Scale {
        strain: 0.7,
        length: 0.02,
    };
    const PRODUCTS: usize = 3;

    fn numbers(dims: &[usize], salt: usize) -> Tensor {
        (plain::numbers(dims, salt) / 10.0).unwrap()
    }

    fn operator(raster: Raster, along: f64) -> Arc<DeviceOperator> {
        Arc::new(DeviceOperator {
            green: Green::new(raster, along, None),
            cells: None,
        })
    }

    /// A device on which some cells have no law and springs hold a few corners.
    fn framed() -> Arc<DeviceOperator> {
        let raster = Raster::new(6, 9).unwrap();
        let (nodes, count) = (vec![3, 4, 17, 30], 8);
        let spring = |at: usize| match at / count == at % count {
            true => 0.5,
            false => 0.01 * ((at / count + at % count) as f32),
        };
        let supports = Supports {
            nodes,
            stiffness: (0..count * count).map(spring).collect(),
        };
        let cells = (0..raster.cells()).map(|cell| f32::from(u8::from(cell % 7 != 2)));
        Arc::new(DeviceOperator {
            green: Green::new(raster, 1.2, Some(supports)),
            cells: Some(cells.collect()),
        })
    }

    fn by_plain_operations(operator: &DeviceOperator, [p, u, factors, stresses]: [&Tensor; 4]) -> Result<Tensor> {
        let features = plain::features(p, u, SCALE.strain.into())?;
        let mut stresses = plain::law(&features, factors, stresses)?;
        if let Some(cells) = &operator.cells {
            stresses = stresses.broadcast_mul(&Tensor::from_slice(cells, cells.len(), &Device::Cpu)?)?;
        }
        let forces = plain::forces(operator.raster(), &stresses)?;
        let mut moved = plain::green(&operator.green, &forces)?;
        if let Some(Supports { nodes, stiffness }) = operator.green.supports() {
            let plane = inner_corners(operator.raster());
            let places: Vec<u32> = (0..2)
                .flat_map(|k| nodes.iter().map(move |node| (k * plane + node) as u32))
                .collect();
            let count = places.len();
            let index = Tensor::new(places, &Device::Cpu)?;
            let n = forces.dim(0)?;
            let at_nodes = moved.reshape((n, 2 * plane))?.index_select(&index, 1)?;
            let stiffness = Tensor::from_slice(stiffness, (count, count), &Device::Cpu)?;
            let held = at_nodes.matmul(&stiffness)?.neg()?;
            let zero = Tensor::zeros((n, 2 * plane), forces.dtype(), &Device::Cpu)?;
            let reaction = zero.index_add(&index, &held, 1)?.reshape(forces.shape())?;
            moved = plain::green(&operator.green, &(forces + reaction)?)?;
        }
        u + (moved * f64::from(SCALE.length))?
    }

    #[test]
    fn values_and_gradients_equal_plain_operations() {
        let other = Raster::new(8, 5).unwrap();
        for operator in [operator(Raster::PAPER, 1.0), operator(other, 0.7), framed()] {
            compare(&operator);
        }
    }

    fn compare(operator: &Arc<DeviceOperator>) {
        let [columns, rows] = operator.raster().sides();
        let p = numbers(&[2, rows, columns], 1);
        let vars = [
            numbers(&[2, 2, rows - 1, columns - 1], 2),
            numbers(&[2 * PRODUCTS, FEATURES], 3),
            numbers(&[MODES, PRODUCTS + FEATURES], 4),
        ];
        let [u, factors, stresses] = vars.map(|values| Var::from_tensor(&values).unwrap());
        let found = correct(operator, &p, &u, [&factors, &stresses], SCALE).unwrap();
        let expected = by_plain_operations(operator, [&p, &u, &factors, &stresses]).unwrap();
        let flat = |x: &Tensor| x.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        let alike = |found: &Tensor, expected: &Tensor| {
            assert_eq!(found.dims(), expected.dims());
            let largest = flat(expected).into_iter().fold(0.0, |most: f32, v| most.max(v.abs()));
            let pairs = flat(found).into_iter().zip(flat(expected));
            let difference = pairs.fold(0.0, |most: f32, (a, b)| most.max((a - b).abs()));
            assert!(difference < 1e-4 * largest, "{difference} of {largest}");
        };
        alike(&found, &expected);
        let c = numbers(found.dims(), 5);
        let gradients = |y: &Tensor| (y * &c).unwrap().sum_all().unwrap().backward().unwrap();
        let (found, expected) = (gradients(&found), gradients(&expected));
        for var in [&u, &factors, &stresses] {
            alike(found.get(var).unwrap(), expected.get(var).unwrap());
        }
    }

    #[test]
    fn parts_of_different_laws_are_refused() {
        let (p, u) = (numbers(&[1, 5, 8], 1), numbers(&[1, 2, 4, 7], 2));
        let (factors, stresses) = (numbers(&[2, FEATURES], 3), numbers(&[MODES, 2 + FEATURES], 4));
        let operator = operator(Raster::new(8, 5).unwrap(), 1.0);
        assert!(correct(&operator, &p, &u, [&factors, &stresses], SCALE).is_err());
    }
}
