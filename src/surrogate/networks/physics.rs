//! The network `physics`: the linear response of the membrane with learned corrections.
//!
//! Built in are the fixed frame and rigid bodies, the exact linear response to the pattern, the scaling of corrections
//! with the voltage, and the symmetries of the device. The linear response u neglects that stress is nonlinear in
//! strain and that electrodes change the stiffness. Therefore each cell has a local law, a learned map from the
//! neighbouring cells and the strain of u to a stress. The forces of these stresses displace a homogeneous membrane,
//! and this displacement is added to u. A second correction starts from the sum. This is the structure of a chord step
//! with a learned law, which also represents the fields at electrode edges that a coarse element does not resolve.
//!
//! The law multiplies two linear maps of the features of a cell, because the leading orders are polynomials in strain
//! and activity. Rectified units left a fifth more error, on small grids twice as much. The weights are few. They are
//! trained for one orientation and transformed to the others by the symmetries of a cell, so that the law of a rotated
//! cell is the rotated law: the eight of the square, or the four of the rectangle for an anisotropic membrane.

use std::sync::Arc;

use candle_core::{Device, Module, Result, Tensor, bail};
use candle_nn::init::ZERO;
use candle_nn::{Init, VarBuilder};

use super::orientations::Orientations;
use super::response::Response;
use super::{Network, Output, names};
use crate::corners::{inner_corners, inner_sides};
use crate::layers::{DeviceOperator, FEATURES, Green, MODES, Scale, StressLaw, Supports, Workspace, correct};
use crate::onnx::{Export, Graph, Value};
use crate::parameters::constant;
use deaflow_pattern::{Raster, Symmetries};

/// Number of corrections. One doubles the error, three reduce it by a fifth.
const CORRECTIONS: usize = 2;
/// Number of products in a law, over all orientations. 16 reduced the error by a tenth and took a tenth more time; 32
/// did not reduce it further.
const PRODUCTS: usize = 8;

/// The network.
pub(super) struct Physics {
    raster: Raster,
    operator: Arc<DeviceOperator>,
    response: Response,
    laws: Vec<LocalLaw>,
    /// The laws in all orientations, if the network is not being trained.
    fixed: Option<Vec<FixedLaw>>,
}

/// The weights of a law in all orientations.
struct FixedLaw {
    factors: Vec<f32>,
    stresses: Vec<f32>,
}

impl Physics {
    /// Builds the network for patterns of these cells from the given weights and constants.
    pub(super) fn new(weights: &VarBuilder<'_>, raster: Raster) -> Result<Self> {
        if raster.sides().contains(&1) {
            bail!("nothing moves on {raster} cells");
        }
        let response = Response::new(weights, raster)?;
        let (group, ratio) = anisotropy(weights)?;
        let operator = Arc::new(DeviceOperator {
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
            operator,
            response,
            laws,
            fixed,
        })
    }

    /// Returns L over the side of a square of a cell's area: 50 on the paper's membrane.
    fn cells_along_side(&self) -> f64 {
        (self.raster.cells() as f64).sqrt()
    }

    /// Returns the factors from displacements in units of ε² L to strain in units of ε, and from cells to L.
    fn scale(&self) -> Scale {
        Scale {
            strain: (self.cells_along_side() * self.response.strain()) as f32,
            length: 1.0 / self.cells_along_side() as f32,
        }
    }

    /// Returns the cells of patterns, with 0 outside the membrane.
    fn masked(&self, patterns: &Tensor) -> Result<Vec<f32>> {
        let mut cells = patterns.flatten_all()?.to_vec1()?;
        self.operator.mask(&mut cells);
        Ok(cells)
    }

    /// Computes the displacement by differentiable operations, from the linear response where it is known.
    fn differentiable(&self, patterns: &Tensor, linear: Option<&[f32]>) -> Result<Tensor> {
        let [columns, rows] = self.raster.sides();
        let n = patterns.dim(0)?;
        let patterns = self.masked(patterns)?;
        let mut displacement = match linear {
            Some(linear) => self.response.tensor(linear.to_vec())?,
            None => self.response.tensor(self.response.evaluate(&patterns))?,
        };
        let patterns = Tensor::from_vec(patterns, (n, rows, columns), &Device::Cpu)?;
        for law in &self.laws {
            let (factors, stresses) = (law.factors()?, law.stresses()?);
            let law = [&factors, &stresses];
            displacement = correct(&self.operator, &patterns, &displacement, law, self.scale())?;
        }
        displacement.permute((0, 2, 3, 1))?.contiguous()
    }

    /// Computes the displacement without gradients, in reused memory.
    fn evaluate(&self, laws: &[FixedLaw], patterns: &Tensor) -> Result<Tensor> {
        let (n, cells) = (patterns.dim(0)?, self.masked(patterns)?);
        let ([columns, rows], plane) = (inner_sides(self.raster), inner_corners(self.raster));
        let mut planes = self.response.evaluate(&cells);
        let patterns = cells.chunks_exact(self.raster.cells());
        let images = patterns.zip(planes.chunks_exact_mut(2 * plane));
        Workspace::with(&self.operator, PRODUCTS, |workspace| {
            for (pattern, displacement) in images {
                workspace.set_pattern(pattern);
                for FixedLaw { factors, stresses } in laws {
                    let law = StressLaw { factors, stresses };
                    workspace.correct(&self.operator, law, pattern, displacement, self.scale());
                }
            }
        });
        let mut displacement = vec![0.0; planes.len()];
        let images = planes.chunks_exact(2 * plane);
        for (image, to) in images.zip(displacement.chunks_exact_mut(2 * plane)) {
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
    fn frozen(&self, patterns: &Tensor) -> Result<Option<Vec<f32>>> {
        Ok(Some(self.response.evaluate(&self.masked(patterns)?)))
    }

    fn forward_for_training(&self, patterns: &Tensor, frozen: Option<&[f32]>) -> Result<Output> {
        Ok(Output {
            displacement: self.differentiable(patterns, frozen)?,
            half_resolution: None,
        })
    }

    fn patterns_per_thread(&self) -> usize {
        // All patterns share one pass over the matrix of the response.
        64
    }

    fn unit_mm(&self) -> Option<f64> {
        Some(self.response.unit_mm())
    }
}

impl Export for Physics {
    fn export(&self, graph: &mut Graph, patterns: &Value) -> Result<Value> {
        let [columns, rows] = self.raster.sides();
        let mut patterns = graph.reshape(patterns, &[0, rows as i64, columns as i64]);
        let cells = self.operator.cells.as_ref();
        let membrane = cells.map(|cells| Tensor::from_slice(cells, (rows, columns), &Device::Cpu));
        let membrane = membrane.transpose()?;
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
            let correction = graph.green(&self.operator.green, &forces)?;
            let correction = graph.mul(&correction, &cell);
            displacement = graph.add(&displacement, &correction);
        }
        Ok(graph.transpose(&displacement, &[0, 2, 3, 1]))
    }
}

/// Returns the symmetries of a cell, and its stiffness along x over the geometric mean of both directions.
fn anisotropy(weights: &VarBuilder<'_>) -> Result<(Symmetries, f64)> {
    if !weights.contains_tensor(names::RATIO) {
        return Ok((Symmetries::SQUARE, 1.0));
    }
    let ratio: Vec<f32> = constant(weights, names::RATIO, &[1])?.to_vec1()?;
    match ratio[..] {
        [ratio] if ratio > 0.0 => Ok((Symmetries::RECTANGLE, ratio.into())),
        _ => bail!("{} is {ratio:?}: it must be above 0", names::RATIO),
    }
}

/// Returns the corners at which the frame and the bodies touch the membrane.
fn supports(weights: &VarBuilder<'_>, raster: Raster) -> Result<Option<Supports>> {
    if !weights.contains_tensor(names::NODES) {
        return Ok(None);
    }
    let nodes: Vec<f32> = weights.get_unchecked(names::NODES)?.flatten_all()?.to_vec1()?;
    let corners = inner_corners(raster);
    let is_corner = |node: &f32| node.fract() == 0.0 && (0.0..corners as f32).contains(node);
    if let Some(other) = nodes.iter().find(|node| !is_corner(node)) {
        bail!(
            "{} contains {other}, but there are {corners} inner corners",
            names::NODES
        );
    }
    let forces = 2 * nodes.len();
    Ok(Some(Supports {
        nodes: nodes.into_iter().map(|node| node as usize).collect(),
        stiffness: flat(&constant(weights, names::STIFFNESS, &[forces, forces])?)?,
    }))
}

/// Returns the mask of membrane cells, if not all cells are membrane.
fn membrane(weights: &VarBuilder<'_>, raster: Raster) -> Result<Option<Vec<f32>>> {
    if !weights.contains_tensor(names::CELLS) {
        return Ok(None);
    }
    flat(&constant(weights, names::CELLS, &[raster.rows(), raster.columns()])?).map(Some)
}

fn flat(tensor: &Tensor) -> Result<Vec<f32>> {
    tensor.flatten_all()?.to_vec1()
}

/// A local law in one orientation: a map from the features of a cell to its stress.
struct LocalLaw {
    orientations: Orientations,
    /// Maps from features to the two factors of each product, (products, features).
    factors: [Tensor; 2],
    /// Map from products to stresses, (modes, products).
    products: Tensor,
    /// Map from features to stresses, (modes, features).
    linear: Tensor,
}

impl LocalLaw {
    fn new(orientations: &Orientations, weights: &VarBuilder<'_>) -> Result<Self> {
        let stdev = (1.0 / FEATURES as f64).sqrt();
        let products = PRODUCTS / orientations.count();
        let factor = |name| weights.get_with_hints((products, FEATURES), name, Init::Randn { mean: 0.0, stdev });
        // With zero stress the network is the linear response, from which training starts.
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

    /// Returns the maps to the factors in all orientations: all first factors, then all second factors.
    fn factors(&self) -> Result<Tensor> {
        let [first, second] = &self.factors;
        let (first, second) = (self.orientations.of_forms(first)?, self.orientations.of_forms(second)?);
        Tensor::cat(&[first, second], 0)
    }

    /// Returns the map from products in all orientations and features to stresses, (modes, products + features).
    fn stresses(&self) -> Result<Tensor> {
        let products = self.orientations.of_stresses(&self.products)?;
        Tensor::cat(&[products, self.orientations.average(&self.linear)?], 1)
    }

    /// Returns the weights of the law in all orientations.
    fn fixed(&self) -> Result<FixedLaw> {
        Ok(FixedLaw {
            factors: flat(&self.factors()?)?,
            stresses: flat(&self.stresses()?)?,
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
        let weights = graph.tensor(&self.orientations.of_stresses(&self.products)?)?;
        let from_products = graph.matmul(&weights, &products);
        let linear = graph.tensor(&self.orientations.average(&self.linear)?)?;
        let linear = graph.matmul(&linear, features);
        Ok(graph.add(&from_products, &linear))
    }
}

#[cfg(test)]
mod tests;
