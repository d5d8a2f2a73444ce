//! The network that starts from what is known of the membrane and learns what is left.
//!
//! Built in are: the frame does not move; the response that is linear in the pattern, exactly; the scale of everything else with the
//! voltage; and the eight symmetries of the square. What the linear response u misses is that stress is not linear in strain, and
//! that activity changes the stiffness. So each cell has a local law, which gives a stress from the cells around it and the
//! strain that u causes in it; the forces of all these stresses displace the membrane like forces on a homogeneous one, which adds to u.
//! A second such correction starts from the sum. That is the structure of a chord step, with a law that is learned: it takes in
//! what finer meshes know of electrode edges, which the law of a coarse element does not.
//!
//! The law multiplies two linear maps of the features of a cell: leading order and the next are polynomials of strain and activity.
//! Rectified units left a fifth more error, on small grids twice as much. Its weights are few. They are drawn for one orientation and carried to
//! the other seven by the symmetries, so that the law of a rotated cell is the rotated law.

use candle_core::{Device, Module, Result, Tensor};
use candle_nn::init::ZERO;
use candle_nn::{Init, VarBuilder};

use super::Network;
use super::orientations::Orientations;
use super::response::Response;
use crate::pattern::CELLS;
use crate::surrogate::layers::{self, FEATURES, MODES, Scale, Workspace, correct};
use crate::surrogate::onnx::{Export, Graph, Value};

/// Corners along a side without the frame, and all of them.
const INNER: usize = CELLS - 1;
const PLANE: usize = INNER * INNER;
/// Corrections one after another. With one the error is twice as large, with three a fifth smaller.
const CORRECTIONS: usize = 2;
/// Products in a law for each orientation. Two left a tenth less error and took a tenth more time, four no less error than two.
const PRODUCTS: usize = 1;

/// The network.
pub(super) struct Physics {
    response: Response,
    laws: Vec<Law>,
    /// The laws in all orientations, where they are not trained.
    fixed: Option<Vec<FixedLaw>>,
}

/// The numbers of a law in all orientations.
struct FixedLaw {
    factors: Vec<f32>,
    stresses: Vec<f32>,
}

impl Physics {
    /// The network on the given weights and constants.
    pub(super) fn new(weights: &VarBuilder<'_>) -> Result<Self> {
        let response = Response::new(weights)?;
        let orientations = Orientations::new()?;
        let law = |number| Law::new(&orientations, &weights.pp(format!("law.{number}")));
        let laws: Vec<Law> = (1..=CORRECTIONS).map(law).collect::<Result<_>>()?;
        let fixed = match laws.iter().any(Law::is_trained) {
            true => None,
            false => Some(laws.iter().map(Law::fixed).collect::<Result<_>>()?),
        };
        Ok(Self { response, laws, fixed })
    }

    /// What displacements, counted in ε² L, are to a cell of side L/50: strain in units of ε, and its own side.
    fn scale(&self) -> Scale {
        Scale {
            strain: (CELLS as f64 * self.response.strain()) as f32,
            length: 1.0 / CELLS as f32,
        }
    }

    /// The displacement by operations that have a gradient.
    fn differentiable(&self, patterns: &Tensor) -> Result<Tensor> {
        let patterns = patterns.reshape(((), CELLS, CELLS))?;
        let mut displacement = self.response.forward(&patterns)?;
        for law in &self.laws {
            let (factors, stresses) = (law.factors()?, law.stresses()?);
            displacement = correct(&patterns, &displacement, &factors, &stresses, self.scale())?;
        }
        displacement.permute((0, 2, 3, 1))?.contiguous()
    }

    /// The same on plain numbers, in memory that is taken once.
    fn evaluate(&self, laws: &[FixedLaw], patterns: &Tensor) -> Result<Tensor> {
        let (n, cells) = (patterns.dim(0)?, patterns.flatten_all()?.to_vec1()?);
        let mut planes = self.response.evaluate(&cells);
        let images = cells
            .chunks_exact(CELLS * CELLS)
            .zip(planes.chunks_exact_mut(2 * PLANE));
        Workspace::lend(8 * PRODUCTS, |workspace| {
            for (pattern, displacement) in images {
                workspace.surround(pattern);
                for FixedLaw { factors, stresses } in laws {
                    workspace.correct(layers::Law { factors, stresses }, pattern, displacement, self.scale());
                }
            }
        });
        let mut displacement = vec![0.0; planes.len()];
        for (image, to) in planes
            .chunks_exact(2 * PLANE)
            .zip(displacement.chunks_exact_mut(2 * PLANE))
        {
            let (x, y) = image.split_at(PLANE);
            for (to, (x, y)) in to.chunks_exact_mut(2).zip(x.iter().zip(y)) {
                to.copy_from_slice(&[*x, *y]);
            }
        }
        Tensor::from_vec(displacement, (n, INNER, INNER, 2), &Device::Cpu)
    }
}

impl Module for Physics {
    fn forward(&self, patterns: &Tensor) -> Result<Tensor> {
        match &self.fixed {
            Some(laws) => self.evaluate(laws, patterns),
            None => self.differentiable(patterns),
        }
    }
}

impl Network for Physics {
    fn patterns_per_thread(&self) -> usize {
        // The matrix of the response is read once for all.
        64
    }

    fn unit_mm(&self) -> Option<f64> {
        Some(self.response.unit_mm())
    }
}

impl Export for Physics {
    fn export(&self, graph: &mut Graph, patterns: &Value) -> Result<Value> {
        let side = CELLS as i64;
        let patterns = graph.reshape(patterns, &[0, side, side]);
        let mut displacement = self.response.export(graph, &patterns)?;
        let cell = graph.number(1.0 / CELLS as f32);
        for law in &self.laws {
            let features = graph.features(&patterns, &displacement, CELLS as f64 * self.response.strain())?;
            let stresses = law.export(graph, &features)?;
            let forces = graph.forces(&stresses)?;
            let correction = graph.green(&forces)?;
            let correction = graph.mul(&correction, &cell);
            displacement = graph.add(&displacement, &correction);
        }
        Ok(graph.transpose(&displacement, &[0, 2, 3, 1]))
    }
}

/// A local law: what stress the features of a cell call for, in one orientation.
struct Law {
    orientations: Orientations,
    /// The two factors of each product, (products, features).
    factors: [Tensor; 2],
    /// From products to stresses, (modes, products).
    products: Tensor,
    /// From features to stresses, (modes, features).
    linear: Tensor,
}

impl Law {
    fn new(orientations: &Orientations, weights: &VarBuilder<'_>) -> Result<Self> {
        let stdev = (1.0 / FEATURES as f64).sqrt();
        let factor = |name| weights.get_with_hints((PRODUCTS, FEATURES), name, Init::Randn { mean: 0.0, stdev });
        // Without stress the network is the linear response: training starts there.
        Ok(Self {
            orientations: orientations.clone(),
            factors: [factor("first")?, factor("second")?],
            products: weights.get_with_hints((MODES, PRODUCTS), "products", ZERO)?,
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

impl Export for Law {
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
