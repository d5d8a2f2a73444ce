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

use candle_core::{Device, Result, Tensor};

use super::response::Response;
use super::{Network, Output};
use crate::pattern::{CELLS, Symmetry};
use crate::surrogate::layers::{
    self, FEATURES, MODES, NEIGHBOURS, Scale, Workspace, correct, features, forces, green, map_channels,
    multiply_halves,
};
use crate::surrogate::onnx::{Graph, Value};
use crate::surrogate::parameters::Parameters;

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
    orientations: Orientations,
    laws: Vec<Law>,
    /// The laws in all orientations, where they stay as they are.
    settled: Option<Vec<Settled>>,
}

/// The numbers of a law in all orientations.
struct Settled {
    factors: Vec<f32>,
    stresses: Vec<f32>,
}

impl Physics {
    /// The network on the given weights and constants.
    pub(super) fn new(p: &mut Parameters) -> Result<Self> {
        let response = Response::new(p)?;
        let laws: Vec<Law> = (1..=CORRECTIONS).map(|k| Law::new(p, k)).collect::<Result<_>>()?;
        let orientations = Orientations::new(p.device())?;
        let settled = match p.are_stored() && p.device().is_cpu() {
            true => Some(
                laws.iter()
                    .map(|law| law.settle(&orientations))
                    .collect::<Result<_>>()?,
            ),
            false => None,
        };
        Ok(Self {
            response,
            orientations,
            laws,
            settled,
        })
    }
}

impl Physics {
    /// What displacements, counted in ε² L, are to a cell of side L/50: strain in units of ε, and its own side.
    fn scale(&self) -> Scale {
        Scale {
            strain: (CELLS as f64 * self.response.strain()) as f32,
            length: 1.0 / CELLS as f32,
        }
    }

    /// A displacement with the correction of a law added.
    fn corrected(&self, law: &Law, patterns: &Tensor, displacement: &Tensor) -> Result<Tensor> {
        let (factors, stresses) = (law.factors(&self.orientations)?, law.stresses(&self.orientations)?);
        let scale = self.scale();
        if patterns.device().is_cpu() {
            return correct(patterns, displacement, &factors, &stresses, scale);
        }
        let seen = features(patterns, displacement, scale.strain.into())?;
        let products = multiply_halves(&map_channels(&seen, &factors)?)?;
        let stresses = map_channels(&Tensor::cat(&[products, seen], 1)?, &stresses)?;
        displacement + (green(&forces(&stresses)?)? * f64::from(scale.length))?
    }
}

impl Network for Physics {
    fn forward(&self, patterns: &Tensor, _auxiliary: bool) -> Result<Output> {
        let patterns = patterns.reshape(((), CELLS, CELLS))?;
        let mut displacement = self.response.forward(&patterns)?;
        for law in &self.laws {
            displacement = self.corrected(law, &patterns, &displacement)?;
        }
        Ok(Output {
            displacement: displacement.permute((0, 2, 3, 1))?.contiguous()?,
            half_resolution: None,
        })
    }

    fn export(&self, graph: &mut Graph, patterns: &Value) -> Result<Value> {
        let side = CELLS as i64;
        let patterns = graph.reshape(patterns, &[0, side, side]);
        let mut displacement = self.response.export(graph, &patterns)?;
        let cell = graph.number(1.0 / CELLS as f32);
        for law in &self.laws {
            let features = graph.features(&patterns, &displacement, CELLS as f64 * self.response.strain())?;
            let stresses = law.export(&self.orientations, graph, &features)?;
            let forces = graph.forces(&stresses)?;
            let correction = graph.green(&forces)?;
            let correction = graph.mul(&correction, &cell);
            displacement = graph.add(&displacement, &correction);
        }
        Ok(graph.transpose(&displacement, &[0, 2, 3, 1]))
    }

    fn predict(&self, patterns: &Tensor) -> Result<Tensor> {
        let Some(laws) = &self.settled else {
            return Ok(self.forward(patterns, false)?.displacement);
        };
        let (n, cells) = (patterns.dim(0)?, patterns.flatten_all()?.to_vec1()?);
        let mut planes = self.response.evaluate(&cells);
        let images = cells
            .chunks_exact(CELLS * CELLS)
            .zip(planes.chunks_exact_mut(2 * PLANE));
        Workspace::lend(8 * PRODUCTS, |workspace| {
            for (pattern, displacement) in images {
                workspace.surround(pattern);
                for Settled { factors, stresses } in laws {
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

    fn together(&self) -> usize {
        // The matrix of the response is read once for all.
        64
    }

    fn unit_mm(&self) -> Option<f64> {
        Some(self.response.unit_mm())
    }
}

/// A local law: what stress the features of a cell call for, in one orientation.
struct Law {
    /// The two factors of each product, (products, features).
    factors: [Tensor; 2],
    /// From products to stresses, (modes, products).
    products: Tensor,
    /// From features to stresses, (modes, features).
    linear: Tensor,
}

impl Law {
    fn new(p: &mut Parameters, number: usize) -> Result<Self> {
        let deviation = (1.0 / FEATURES as f64).sqrt();
        let mut factor = |name: &str| p.tensor(&format!("law.{number}.{name}"), &[PRODUCTS, FEATURES], deviation);
        let factors = [factor("first")?, factor("second")?];
        // Without stress the network is the linear response: training starts there.
        Ok(Self {
            factors,
            products: p.tensor(&format!("law.{number}.products"), &[MODES, PRODUCTS], 0.0)?,
            linear: p.tensor(&format!("law.{number}.linear"), &[MODES, FEATURES], 0.0)?,
        })
    }

    /// The factors of the products in all orientations: first those of the one, then those of the other.
    fn factors(&self, orientations: &Orientations) -> Result<Tensor> {
        let [first, second] = &self.factors;
        Tensor::cat(&[orientations.carry(first)?, orientations.carry(second)?], 0)
    }

    /// From products in all orientations and features to stresses, (modes, products + features).
    fn stresses(&self, orientations: &Orientations) -> Result<Tensor> {
        let turned = orientations.turn(&self.products)?;
        Tensor::cat(&[turned, orientations.average(&self.linear)?], 1)
    }

    /// The numbers of the law in all orientations.
    fn settle(&self, orientations: &Orientations) -> Result<Settled> {
        let flat = |tensor: Tensor| tensor.flatten_all()?.to_vec1();
        Ok(Settled {
            factors: flat(self.factors(orientations)?)?,
            stresses: flat(self.stresses(orientations)?)?,
        })
    }

    fn export(&self, orientations: &Orientations, graph: &mut Graph, features: &Value) -> Result<Value> {
        let mut maps = Vec::with_capacity(2);
        for factor in &self.factors {
            let factor = graph.tensor(&orientations.carry(factor)?)?;
            maps.push(graph.matmul(&factor, features));
        }
        let products = graph.mul(&maps[0], &maps[1]);
        let turned = graph.tensor(&orientations.turn(&self.products)?)?;
        let from_products = graph.matmul(&turned, &products);
        let linear = graph.tensor(&orientations.average(&self.linear)?)?;
        let linear = graph.matmul(&linear, features);
        Ok(graph.add(&from_products, &linear))
    }
}

/// How the eight symmetries act on features and modes.
struct Orientations {
    features: Vec<Tensor>,
    modes: Vec<Tensor>,
}

impl Orientations {
    fn new(device: &Device) -> Result<Self> {
        let matrices = |matrix: fn(Symmetry) -> Vec<f32>, side: usize| -> Result<Vec<Tensor>> {
            let each = Symmetry::ALL.into_iter();
            each.map(|g| Tensor::from_vec(matrix(g), (side, side), device))
                .collect()
        };
        Ok(Self {
            features: matrices(on_features, FEATURES)?,
            modes: matrices(on_modes, MODES)?,
        })
    }

    /// A linear form on features in all orientations: (k, features) to (8k, features).
    fn carry(&self, forms: &Tensor) -> Result<Tensor> {
        let images: Result<Vec<Tensor>> = self.features.iter().map(|g| forms.matmul(&g.t()?)).collect();
        Tensor::cat(&images?, 0)
    }

    /// Stresses (modes, k) in all orientations: (modes, 8k).
    fn turn(&self, stresses: &Tensor) -> Result<Tensor> {
        let images: Result<Vec<Tensor>> = self.modes.iter().map(|g| g.matmul(stresses)).collect();
        Tensor::cat(&images?, 1)
    }

    /// The part of a map (modes, features) that commutes with the symmetries.
    fn average(&self, map: &Tensor) -> Result<Tensor> {
        let mut sum = map.zeros_like()?;
        for (features, modes) in self.features.iter().zip(&self.modes) {
            sum = (sum + modes.matmul(map)?.matmul(&features.t()?)?)?;
        }
        sum * 0.125
    }
}

/// The matrix of a symmetry on modes, row by row: derivatives of a vector turn as a tensor, hourglasses as a vector times
/// the sign of x·y.
fn on_modes(g: Symmetry) -> Vec<f32> {
    let m = g.matrix().map(|row| row.map(|entry| entry as f32));
    let twist = m[0][0] * m[1][1] + m[0][1] * m[1][0];
    let mut matrix = vec![0.0; MODES * MODES];
    for (to, row) in matrix.chunks_exact_mut(MODES).enumerate() {
        for (from, entry) in row.iter_mut().enumerate() {
            let [(along, component), (from_along, from_component)] = [to, from].map(|mode| (mode / 2, mode % 2));
            let vector = m[component][from_component];
            *entry = match (along, from_along) {
                (2, 2) => twist * vector,
                (0 | 1, 0 | 1) => m[along][from_along] * vector,
                _ => 0.0,
            };
        }
    }
    matrix
}

/// The matrix of a symmetry on features, row by row: places around a cell move, modes turn, and 1 stays.
fn on_features(g: Symmetry) -> Vec<f32> {
    let mut matrix = vec![0.0; FEATURES * FEATURES];
    for (from, to) in g.permutation(3).enumerate() {
        matrix[to * FEATURES + from] = 1.0;
    }
    let modes = on_modes(g);
    for first in [NEIGHBOURS, NEIGHBOURS + MODES] {
        for (at, value) in modes.iter().enumerate() {
            matrix[(first + at / MODES) * FEATURES + first + at % MODES] = *value;
        }
    }
    matrix[FEATURES * FEATURES - 1] = 1.0;
    matrix
}

#[cfg(test)]
mod tests;
