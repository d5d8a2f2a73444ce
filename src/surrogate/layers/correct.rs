//! A correction as one operation: features, local law, forces and Green's function image by image, in memory that is taken
//! once. candle's operations one after another do the same (`plain`, which tests hold it to); they take and give back ten times
//! the memory, and a training with them lasts several times as long.

use std::cell::Cell;
use std::sync::Arc;

use candle_core::{CpuStorage, CustomOp3, Device, Layout, Result, Shape, Tensor, bail};
use deaflow_fem::registers::dispatch;
use deaflow_linalg::Accum;

use super::cell::{
    FEATURES, MODES, add_forces, add_strain_forces, inner_corners, write_modes, write_strains, write_surroundings,
};
use super::gemm::{Matrix, multiply};
use super::green::{Green, GreenScratch};
use super::inner::add_inner_products;
use super::storage::values;
use deaflow_pattern::Raster;

/// The device that corrections are made on.
#[derive(Clone, Debug)]
pub(crate) struct Ground {
    /// What forces make of it.
    pub(crate) green: Green,
    /// Of each cell 1 where it is membrane, and 0 where it is frame or body, which have no law; nothing where all are membrane.
    pub(crate) cells: Option<Vec<f32>>,
}

impl Ground {
    fn raster(&self) -> Raster {
        self.green.raster()
    }

    /// Takes the stresses of cells away that have none.
    fn clear(&self, stresses: &mut [f32]) {
        let Some(cells) = &self.cells else { return };
        for plane in stresses.chunks_exact_mut(cells.len()) {
            plane.iter_mut().zip(cells).for_each(|(stress, cell)| *stress *= cell);
        }
    }
}

/// The two numbers of a correction that are not learned.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scale {
    /// What the modes of a displacement are multiplied by before the law sees them.
    pub(crate) strain: f32,
    /// What the displacement that Green's function makes of the forces is multiplied by.
    pub(crate) length: f32,
}

/// A local law in all orientations, row by row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StressLaw<'a> {
    /// The two factors of all products, first those of the one, then those of the other, (2 products, features).
    pub(crate) factors: &'a [f32],
    /// From products and features to stresses, (modes, products + features).
    pub(crate) stresses: &'a [f32],
}

impl<'a> StressLaw<'a> {
    fn products(&self) -> usize {
        self.factors.len() / FEATURES / 2
    }

    /// The part of the stresses that products make, and that which features make.
    fn parts(&self) -> [Matrix<'a>; 2] {
        let products = self.products();
        let both = Matrix::new(self.stresses, products + FEATURES);
        [both.columns(0, products), both.columns(products, FEATURES)]
    }
}

/// Memory for one image.
pub(crate) struct Workspace {
    raster: Raster,
    /// Products, then features: what stresses are made from.
    seen: Vec<f32>,
    factors: Vec<f32>,
    products: usize,
    stresses: Vec<f32>,
    forces: Vec<f32>,
    moved: Vec<f32>,
    scratch: GreenScratch,
    gradients: Gradients,
}

/// Gradients with respect to what a law sees and makes of one image.
struct Gradients {
    features: Vec<f32>,
    factors: Vec<f32>,
    products: Vec<f32>,
}

thread_local! {
    /// The workspace that a thread used last. Half a megabyte that is taken and given back for every few images costs more in
    /// pages of the system than what is done with it.
    static SPARE: Cell<Option<Workspace>> = const { Cell::new(None) };
}

impl Workspace {
    /// Lends the workspace of the thread, for laws of so many products on a device.
    pub(crate) fn lend<R>(ground: &Ground, products: usize, work: impl FnOnce(&mut Self) -> R) -> R {
        let fits = |spare: &Self| spare.products == products && spare.raster == ground.raster();
        let mut workspace = match SPARE.take().filter(fits) {
            Some(spare) => spare,
            None => Self::new(ground, products),
        };
        workspace.scratch.fit(&ground.green);
        let result = work(&mut workspace);
        SPARE.set(Some(workspace));
        result
    }

    fn new(ground: &Ground, products: usize) -> Self {
        let raster = ground.raster();
        let (area, image) = (raster.cells(), 2 * inner_corners(raster));
        Self {
            raster,
            seen: vec![0.0; (products + FEATURES) * area],
            factors: vec![0.0; 2 * products * area],
            products,
            stresses: vec![0.0; MODES * area],
            forces: vec![0.0; image],
            moved: vec![0.0; image],
            scratch: ground.green.scratch(),
            gradients: Gradients {
                features: vec![0.0; FEATURES * area],
                factors: vec![0.0; 2 * products * area],
                products: vec![0.0; products * area],
            },
        }
    }

    /// Sets the pattern (cells), ±½ per cell, that the next corrections are for.
    pub(crate) fn surround(&mut self, pattern: &[f32]) {
        write_surroundings(
            self.raster,
            pattern,
            &mut self.seen[self.products * self.raster.cells()..],
        );
    }

    /// Factors and products of a law at a displacement.
    fn look(&mut self, law: StressLaw<'_>, pattern: &[f32], displacement: &[f32], scale: Scale) {
        let area = self.raster.cells();
        let (products, features) = self.seen.split_at_mut(self.products * area);
        write_strains(self.raster, pattern, displacement, scale.strain, features);
        let (factors, features) = (Matrix::new(law.factors, FEATURES), Matrix::new(features, area));
        multiply(&mut self.factors, Accum::Replace, factors, features);
        let (first, second) = self.factors.split_at(self.products * area);
        product(products, first, second);
    }

    /// Adds the correction of a law to a displacement (2, inner corners) of the pattern that was set.
    pub(crate) fn correct(
        &mut self,
        ground: &Ground,
        law: StressLaw<'_>,
        pattern: &[f32],
        displacement: &mut [f32],
        scale: Scale,
    ) {
        self.look(law, pattern, displacement, scale);
        let law = Matrix::new(law.stresses, self.products + FEATURES);
        let seen = Matrix::new(&self.seen, self.raster.cells());
        multiply(&mut self.stresses, Accum::Replace, law, seen);
        ground.clear(&mut self.stresses);
        self.forces.fill(0.0);
        add_forces(self.raster, &self.stresses, &mut self.forces);
        ground.green.apply(&self.forces, &mut self.moved, &mut self.scratch);
        add_scaled(displacement, scale.length, &self.moved);
    }
}

/// out ← a · b, number by number.
fn product(out: &mut [f32], a: &[f32], b: &[f32]) {
    dispatch(
        #[inline(always)]
        || {
            out.iter_mut()
                .zip(a.iter().zip(b))
                .for_each(|(out, (a, b))| *out = a * b)
        },
    );
}

/// y ← y + αx.
fn add_scaled(y: &mut [f32], alpha: f32, x: &[f32]) {
    dispatch(
        #[inline(always)]
        || y.iter_mut().zip(x).for_each(|(y, x)| *y += alpha * x),
    );
}

/// Adds the correction of a law to displacements (n, 2, rows − 1, columns − 1) of patterns (n, rows, columns), ±½ per cell. Factors are
/// (2 products, features), stresses (modes, products + features), as in [`StressLaw`].
pub(crate) fn correct(
    ground: &Arc<Ground>,
    patterns: &Tensor,
    displacement: &Tensor,
    factors: &Tensor,
    stresses: &Tensor,
    scale: Scale,
) -> Result<Tensor> {
    let patterns = patterns.flatten_all()?.to_vec1()?;
    displacement.contiguous()?.apply_op3(
        &factors.contiguous()?,
        &stresses.contiguous()?,
        Correct {
            ground: Arc::clone(ground),
            patterns,
            scale,
        },
    )
}

struct Correct {
    ground: Arc<Ground>,
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
            bail!(
                "factors {:?} and stresses {:?} are of different laws",
                lf.dims(),
                ls.dims()
            );
        }
        let mut corrected = values(u, lu)?.to_vec();
        let (ground, raster) = (&*self.ground, self.ground.raster());
        let images = corrected.chunks_exact_mut(2 * inner_corners(raster));
        let images = self.patterns.chunks_exact(raster.cells()).zip(images);
        Workspace::lend(ground, law.products(), |workspace| {
            for (pattern, u) in images {
                workspace.surround(pattern);
                workspace.correct(ground, law, pattern, u, self.scale);
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
        let (ground, raster) = (&*self.ground, self.ground.raster());
        let mut back = Backward::new(ground, law, self.scale);
        let image = 2 * inner_corners(raster);
        let images = self
            .patterns
            .chunks_exact(raster.cells())
            .zip(displacements.chunks_exact(image));
        Workspace::lend(ground, law.products(), |workspace| {
            for ((pattern, u), gradient) in images.zip(gradient.chunks_exact_mut(image)) {
                back.image(workspace, pattern, u, gradient);
            }
        });
        let tensor = |values: Vec<f32>, like: &Tensor| Tensor::from_vec(values, like.shape(), &Device::Cpu).map(Some);
        let du = match u.track_op() {
            true => tensor(gradient, u)?,
            false => None,
        };
        Ok((
            du,
            tensor(back.by_factors, factors)?,
            tensor(back.by_stresses, stresses)?,
        ))
    }
}

/// Gradients of a correction with respect to its law, summed over images in order.
struct Backward<'a> {
    ground: &'a Ground,
    law: StressLaw<'a>,
    scale: Scale,
    by_factors: Vec<f32>,
    by_stresses: Vec<f32>,
}

impl<'a> Backward<'a> {
    fn new(ground: &'a Ground, law: StressLaw<'a>, scale: Scale) -> Self {
        Self {
            ground,
            law,
            scale,
            by_factors: vec![0.0; law.factors.len()],
            by_stresses: vec![0.0; law.stresses.len()],
        }
    }

    /// Takes in an image; the gradient with respect to what came out becomes that with respect to what went in.
    fn image(&mut self, w: &mut Workspace, pattern: &[f32], displacement: &[f32], gradient: &mut [f32]) {
        let (raster, area) = (self.ground.raster(), self.ground.raster().cells());
        let (law, half) = (self.law, self.law.products() * area);
        w.surround(pattern);
        w.look(law, pattern, displacement, self.scale);
        // Green's function is its own transpose, and forces are the transpose of modes.
        self.ground.green.apply(gradient, &mut w.moved, &mut w.scratch);
        write_modes(raster, &w.moved, self.scale.length, &mut w.stresses);
        self.ground.clear(&mut w.stresses);
        add_inner_products(&mut self.by_stresses, &w.stresses, &w.seen, area);
        let stresses = Matrix::new(&w.stresses, area);
        let [from_products, from_features] = law.parts();
        let back = &mut w.gradients;
        multiply(&mut back.products, Accum::Replace, from_products.transposed(), stresses);
        let (first, second) = back.factors.split_at_mut(half);
        let (a, b) = w.factors.split_at(half);
        product(first, &back.products, b);
        product(second, &back.products, a);
        add_inner_products(&mut self.by_factors, &back.factors, &w.seen[half..], area);
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

    fn ground(raster: Raster, along: f64) -> Arc<Ground> {
        Arc::new(Ground {
            green: Green::new(raster, along, None),
            cells: None,
        })
    }

    /// A device on which some cells have no law, and a few corners are held by springs.
    fn framed() -> Arc<Ground> {
        let raster = Raster::new(6, 9).unwrap();
        let (nodes, count) = (vec![3, 4, 17, 30], 8);
        let spring = |at: usize| {
            if at / count == at % count {
                0.5
            } else {
                0.01 * ((at / count + at % count) as f32)
            }
        };
        let supports = Supports {
            nodes,
            stiffness: (0..count * count).map(spring).collect(),
        };
        Arc::new(Ground {
            green: Green::new(raster, 1.2, Some(supports)),
            cells: Some(
                (0..raster.cells())
                    .map(|cell| f32::from(u8::from(cell % 7 != 2)))
                    .collect(),
            ),
        })
    }

    fn by_plain_operations(ground: &Ground, [p, u, factors, stresses]: [&Tensor; 4]) -> Result<Tensor> {
        let seen = plain::features(p, u, SCALE.strain.into())?;
        let mut stresses = plain::law(&seen, factors, stresses)?;
        if let Some(cells) = &ground.cells {
            stresses = stresses.broadcast_mul(&Tensor::from_slice(cells, cells.len(), &Device::Cpu)?)?;
        }
        let forces = plain::forces(ground.raster(), &stresses)?;
        let mut moved = plain::green(&ground.green, &forces)?;
        if let Some(Supports { nodes, stiffness }) = ground.green.supports() {
            let plane = inner_corners(ground.raster());
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
            moved = plain::green(&ground.green, &(forces + reaction)?)?;
        }
        u + (moved * f64::from(SCALE.length))?
    }

    #[test]
    fn values_and_gradients_are_those_of_plain_operations() {
        let other = Raster::new(8, 5).unwrap();
        for ground in [ground(Raster::PAPER, 1.0), ground(other, 0.7), framed()] {
            compare(&ground);
        }
    }

    fn compare(ground: &Arc<Ground>) {
        let [columns, rows] = ground.raster().sides();
        let p = numbers(&[2, rows, columns], 1);
        let vars = [
            numbers(&[2, 2, rows - 1, columns - 1], 2),
            numbers(&[2 * PRODUCTS, FEATURES], 3),
            numbers(&[MODES, PRODUCTS + FEATURES], 4),
        ];
        let [u, factors, stresses] = vars.map(|values| Var::from_tensor(&values).unwrap());
        let found = correct(ground, &p, &u, &factors, &stresses, SCALE).unwrap();
        let expected = by_plain_operations(ground, [&p, &u, &factors, &stresses]).unwrap();
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
        let ground = ground(Raster::new(8, 5).unwrap(), 1.0);
        assert!(correct(&ground, &p, &u, &factors, &stresses, SCALE).is_err());
    }
}
