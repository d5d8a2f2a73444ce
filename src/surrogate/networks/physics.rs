//! The network that starts from what is known of the membrane and learns what is left.
//!
//! Built in are: the frame does not move, and bodies move as one; the response that is linear in the pattern, exactly; the scale of everything
//! else with the voltage; and the symmetries of the device. What the linear response u misses is that stress is not linear in strain, and
//! that activity changes the stiffness. So each cell has a local law, which gives a stress from the cells around it and the
//! strain that u causes in it; the forces of all these stresses displace the membrane like forces on a homogeneous one, which adds to u.
//! A second such correction starts from the sum. That is the structure of a chord step, with a law that is learned: it takes in
//! what finer meshes know of electrode edges, which the law of a coarse element does not.
//!
//! The law multiplies two linear maps of the features of a cell: leading order and the next are polynomials of strain and activity.
//! Rectified units left a fifth more error, on small grids twice as much. Its weights are few. They are drawn for one orientation and carried to
//! the others by the symmetries of a cell, so that the law of a rotated cell is the rotated law: by the eight of the square, or by the four of a
//! rectangle where cells are not square or the prestretch is not equal.

use std::sync::Arc;

use candle_core::{Device, Module, Result, Tensor, bail};
use candle_nn::init::ZERO;
use candle_nn::{Init, VarBuilder};

use super::orientations::Orientations;
use super::response::Response;
use super::{Network, Output, names};
use crate::layers::{self, FEATURES, Green, Ground, MODES, Scale, Supports, Workspace, correct};
use crate::onnx::{Export, Graph, Value};
use crate::parameters::constant;
use deaflow_pattern::{Raster, Symmetries};

/// Corrections one after another. With one the error is twice as large, with three a fifth smaller.
const CORRECTIONS: usize = 2;
/// Products in a law, of all orientations. Sixteen left a tenth less error and took a tenth more time, 32 no less error than sixteen.
const PRODUCTS: usize = 8;

/// The network.
pub(super) struct Physics {
    raster: Raster,
    ground: Arc<Ground>,
    response: Response,
    laws: Vec<LocalLaw>,
    /// The laws in all orientations, where they are not trained.
    fixed: Option<Vec<FixedLaw>>,
}

/// The numbers of a law in all orientations.
struct FixedLaw {
    factors: Vec<f32>,
    stresses: Vec<f32>,
}

impl Physics {
    /// The network for patterns of these cells on the given weights and constants.
    pub(super) fn new(weights: &VarBuilder<'_>, raster: Raster) -> Result<Self> {
        if raster.sides().contains(&1) {
            bail!("nothing moves on {raster} cells");
        }
        let response = Response::new(weights, raster)?;
        let (group, ratio) = medium(weights)?;
        let ground = Arc::new(Ground {
            green: Green::new(raster, ratio, supports(weights, raster)?),
            cells: membrane(weights, raster)?,
        });
        let orientations = Orientations::new(group)?;
        let law = |number| LocalLaw::new(&orientations, &weights.pp(format!("law.{number}")));
        let laws: Vec<LocalLaw> = (1..=CORRECTIONS).map(law).collect::<Result<_>>()?;
        let fixed = match laws.iter().any(LocalLaw::is_trained) {
            true => None,
            false => Some(laws.iter().map(LocalLaw::fixed).collect::<Result<_>>()?),
        };
        Ok(Self {
            raster,
            ground,
            response,
            laws,
            fixed,
        })
    }

    /// L over the side of a square of a cell's area: 50 on the paper's membrane.
    fn cells_along_side(&self) -> f64 {
        (self.raster.cells() as f64).sqrt()
    }

    /// What displacements, counted in ε² L, are to a cell: strain in units of ε, and its own side.
    fn scale(&self) -> Scale {
        Scale {
            strain: (self.cells_along_side() * self.response.strain()) as f32,
            length: 1.0 / self.cells_along_side() as f32,
        }
    }

    /// Patterns with 0 where there is no membrane.
    fn masked(&self, mut cells: Vec<f32>) -> Vec<f32> {
        if let Some(membrane) = &self.ground.cells {
            for pattern in cells.chunks_exact_mut(membrane.len()) {
                pattern.iter_mut().zip(membrane).for_each(|(cell, own)| *cell *= own);
            }
        }
        cells
    }

    /// The displacement by operations that have a gradient, from the linear response where that is known.
    fn differentiable(&self, patterns: &Tensor, linear: Option<&[f32]>) -> Result<Tensor> {
        let [columns, rows] = self.raster.sides();
        let n = patterns.dim(0)?;
        let patterns = self.masked(patterns.flatten_all()?.to_vec1()?);
        let mut displacement = match linear {
            Some(linear) => self.response.tensor(linear.to_vec())?,
            None => self.response.tensor(self.response.evaluate(&patterns))?,
        };
        let patterns = Tensor::from_vec(patterns, (n, rows, columns), &Device::Cpu)?;
        for law in &self.laws {
            let (factors, stresses) = (law.factors()?, law.stresses()?);
            displacement = correct(
                &self.ground,
                &patterns,
                &displacement,
                &factors,
                &stresses,
                self.scale(),
            )?;
        }
        displacement.permute((0, 2, 3, 1))?.contiguous()
    }

    /// The same on plain numbers, in memory that is taken once.
    fn evaluate(&self, laws: &[FixedLaw], patterns: &Tensor) -> Result<Tensor> {
        let (n, cells) = (patterns.dim(0)?, self.masked(patterns.flatten_all()?.to_vec1()?));
        let [columns, rows] = self.raster.sides().map(|side| side - 1);
        let plane = columns * rows;
        let mut planes = self.response.evaluate(&cells);
        let images = cells
            .chunks_exact(self.raster.cells())
            .zip(planes.chunks_exact_mut(2 * plane));
        Workspace::lend(&self.ground, PRODUCTS, |workspace| {
            for (pattern, displacement) in images {
                workspace.surround(pattern);
                for FixedLaw { factors, stresses } in laws {
                    let law = layers::StressLaw { factors, stresses };
                    workspace.correct(&self.ground, law, pattern, displacement, self.scale());
                }
            }
        });
        let mut displacement = vec![0.0; planes.len()];
        for (image, to) in planes
            .chunks_exact(2 * plane)
            .zip(displacement.chunks_exact_mut(2 * plane))
        {
            let (x, y) = image.split_at(plane);
            for (to, (x, y)) in to.chunks_exact_mut(2).zip(x.iter().zip(y)) {
                to.copy_from_slice(&[*x, *y]);
            }
        }
        Tensor::from_vec(displacement, (n, rows, columns, 2), &Device::Cpu)
    }
}

impl Module for Physics {
    fn forward(&self, patterns: &Tensor) -> Result<Tensor> {
        match &self.fixed {
            Some(laws) => self.evaluate(laws, patterns),
            None => self.differentiable(patterns, None),
        }
    }
}

impl Network for Physics {
    fn untrained(&self, patterns: &Tensor) -> Result<Option<Vec<f32>>> {
        let cells = self.masked(patterns.flatten_all()?.to_vec1()?);
        Ok(Some(self.response.evaluate(&cells)))
    }

    fn forward_for_training(&self, patterns: &Tensor, untrained: Option<&[f32]>) -> Result<Output> {
        Ok(Output {
            displacement: self.differentiable(patterns, untrained)?,
            half_resolution: None,
        })
    }

    fn patterns_per_thread(&self) -> usize {
        // The matrix of the response is read once for all.
        64
    }

    fn examples_per_part(&self) -> usize {
        // Its weights are so few that small batches are best, and these too are to keep threads busy.
        2
    }

    fn unit_mm(&self) -> Option<f64> {
        Some(self.response.unit_mm())
    }
}

impl Export for Physics {
    fn export(&self, graph: &mut Graph, patterns: &Value) -> Result<Value> {
        let [columns, rows] = self.raster.sides();
        let mut patterns = graph.reshape(patterns, &[0, rows as i64, columns as i64]);
        let membrane = match &self.ground.cells {
            Some(cells) => Some(Tensor::from_slice(cells, (rows, columns), &Device::Cpu)?),
            None => None,
        };
        if let Some(membrane) = &membrane {
            let membrane = graph.tensor(membrane)?;
            patterns = graph.mul(&patterns, &membrane);
        }
        let mut displacement = self.response.export(graph, &patterns)?;
        let scale = self.scale();
        let cell = graph.number(scale.length);
        for law in &self.laws {
            let strain = self.cells_along_side() * self.response.strain();
            let features = graph.features(self.raster, &patterns, &displacement, strain)?;
            let mut stresses = law.export(graph, &features)?;
            if let Some(membrane) = &membrane {
                let membrane = graph.tensor(&membrane.flatten_all()?)?;
                stresses = graph.mul(&stresses, &membrane);
            }
            let forces = graph.forces(self.raster, &stresses)?;
            let correction = graph.green(&self.ground.green, &forces)?;
            let correction = graph.mul(&correction, &cell);
            displacement = graph.add(&displacement, &correction);
        }
        Ok(graph.transpose(&displacement, &[0, 2, 3, 1]))
    }
}

/// The symmetries of a cell, and its stiffness along x over the geometric mean of both.
fn medium(weights: &VarBuilder<'_>) -> Result<(Symmetries, f64)> {
    if !weights.contains_tensor(names::RATIO) {
        return Ok((Symmetries::SQUARE, 1.0));
    }
    let ratio: Vec<f32> = constant(weights, names::RATIO, &[1])?.to_vec1()?;
    match ratio[..] {
        [ratio] if ratio > 0.0 => Ok((Symmetries::RECTANGLE, ratio.into())),
        _ => bail!("{} is {ratio:?}: it must be above 0", names::RATIO),
    }
}

/// Where frames and bodies meet the membrane.
fn supports(weights: &VarBuilder<'_>, raster: Raster) -> Result<Option<Supports>> {
    if !weights.contains_tensor(names::NODES) {
        return Ok(None);
    }
    let places: Vec<f32> = weights.get_unchecked(names::NODES)?.flatten_all()?.to_vec1()?;
    let inner: usize = raster.sides().map(|side| side - 1).into_iter().product();
    let is_place = |place: &f32| place.fract() == 0.0 && (0.0..inner as f32).contains(place);
    if let Some(other) = places.iter().find(|place| !is_place(place)) {
        bail!("{} has {other}, which is none of {inner} corners", names::NODES);
    }
    let forces = 2 * places.len();
    Ok(Some(Supports {
        nodes: places.into_iter().map(|place| place as usize).collect(),
        stiffness: constant(weights, names::STIFFNESS, &[forces, forces])?
            .flatten_all()?
            .to_vec1()?,
    }))
}

/// Which cells are membrane, where not all are.
fn membrane(weights: &VarBuilder<'_>, raster: Raster) -> Result<Option<Vec<f32>>> {
    match weights.contains_tensor(names::CELLS) {
        true => {
            let cells = constant(weights, names::CELLS, &[raster.rows(), raster.columns()])?;
            Ok(Some(cells.flatten_all()?.to_vec1()?))
        }
        false => Ok(None),
    }
}

/// A local law: what stress the features of a cell call for, in one orientation.
struct LocalLaw {
    orientations: Orientations,
    /// The two factors of each product, (products, features).
    factors: [Tensor; 2],
    /// From products to stresses, (modes, products).
    products: Tensor,
    /// From features to stresses, (modes, features).
    linear: Tensor,
}

impl LocalLaw {
    fn new(orientations: &Orientations, weights: &VarBuilder<'_>) -> Result<Self> {
        let stdev = (1.0 / FEATURES as f64).sqrt();
        let products = PRODUCTS / orientations.count();
        let factor = |name| weights.get_with_hints((products, FEATURES), name, Init::Randn { mean: 0.0, stdev });
        // Without stress the network is the linear response: training starts there.
        Ok(Self {
            orientations: orientations.clone(),
            factors: [factor("first")?, factor("second")?],
            products: weights.get_with_hints((MODES, products), "products", ZERO)?,
            linear: weights.get_with_hints((MODES, FEATURES), "linear", ZERO)?,
        })
    }

    fn is_trained(&self) -> bool {
        let [first, second] = &self.factors;
        [first, second, &self.products, &self.linear]
            .iter()
            .any(|tensor| tensor.track_op())
    }

    /// The factors of the products in all orientations: first those of the one, then those of the other.
    fn factors(&self) -> Result<Tensor> {
        let [first, second] = &self.factors;
        Tensor::cat(
            &[self.orientations.of_forms(first)?, self.orientations.of_forms(second)?],
            0,
        )
    }

    /// From products in all orientations and features to stresses, (modes, products + features).
    fn stresses(&self) -> Result<Tensor> {
        let turned = self.orientations.of_stresses(&self.products)?;
        Tensor::cat(&[turned, self.orientations.average(&self.linear)?], 1)
    }

    /// The numbers of the law in all orientations.
    fn fixed(&self) -> Result<FixedLaw> {
        let flat = |tensor: Tensor| tensor.flatten_all()?.to_vec1();
        Ok(FixedLaw {
            factors: flat(self.factors()?)?,
            stresses: flat(self.stresses()?)?,
        })
    }
}

impl Export for LocalLaw {
    fn export(&self, graph: &mut Graph, features: &Value) -> Result<Value> {
        let mut maps = Vec::with_capacity(2);
        for factor in &self.factors {
            let factor = graph.tensor(&self.orientations.of_forms(factor)?)?;
            maps.push(graph.matmul(&factor, features));
        }
        let products = graph.mul(&maps[0], &maps[1]);
        let turned = graph.tensor(&self.orientations.of_stresses(&self.products)?)?;
        let from_products = graph.matmul(&turned, &products);
        let linear = graph.tensor(&self.orientations.average(&self.linear)?)?;
        let linear = graph.matmul(&linear, features);
        Ok(graph.add(&from_products, &linear))
    }
}

#[cfg(test)]
mod tests;
