//! Symmetries of the weights of a local law.
//!
//! Each symmetry permutes features and modes up to sign, so the images of a tensor are its entries in another order,
//! some with the opposite sign. A single selection computes all images; eight products of small matrices took longer
//! than the law itself.

use candle_core::{Device, Result, Tensor};

use crate::layers::{FEATURES, MODES, NEIGHBOURS};
use deaflow_pattern::{Symmetries, Symmetry};

/// The images of features and modes under a group.
#[derive(Clone, Debug)]
pub(super) struct Orientations {
    /// Number of symmetries.
    count: usize,
    features: Images,
    modes: Images,
    /// Images of maps from features to modes, row by row.
    maps: Images,
}

/// For each symmetry and entry of an image: the index of the original entry, and the sign.
#[derive(Clone, Debug)]
struct Images {
    from: Tensor,
    signs: Tensor,
}

impl Orientations {
    /// Computes the tables of a group.
    pub(super) fn new(group: Symmetries) -> Result<Self> {
        let features: Vec<_> = group.iter().map(on_features).collect();
        let modes: Vec<_> = group.iter().map(on_modes).collect();
        let maps = features.iter().zip(&modes).map(|(features, modes)| {
            let row = |&(mode, sign): &(usize, f32)| {
                let entry = move |&(feature, other): &(usize, f32)| (mode * FEATURES + feature, sign * other);
                features.iter().map(entry).collect::<Vec<_>>()
            };
            modes.iter().flat_map(row).collect::<Vec<_>>()
        });
        Ok(Self {
            count: group.count(),
            maps: Images::new(maps)?,
            features: Images::new(features.iter().cloned())?,
            modes: Images::new(modes.iter().cloned())?,
        })
    }

    /// Returns the number g of orientations.
    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// Returns linear forms on features in all orientations: (k, features) to (gk, features).
    pub(super) fn of_forms(&self, forms: &Tensor) -> Result<Tensor> {
        let k = forms.dim(0)?;
        let images = self.features.of(&forms.t()?.contiguous()?)?;
        images
            .reshape((self.count, FEATURES, k))?
            .transpose(1, 2)?
            .reshape((self.count * k, FEATURES))
    }

    /// Returns stresses in all orientations: (modes, k) to (modes, gk).
    pub(super) fn of_stresses(&self, stresses: &Tensor) -> Result<Tensor> {
        let k = stresses.dim(1)?;
        let images = self.modes.of(stresses)?;
        images
            .reshape((self.count, MODES, k))?
            .transpose(0, 1)?
            .reshape((MODES, self.count * k))
    }

    /// Returns the average of a map (modes, features) over the group, which commutes with its symmetries.
    pub(super) fn average(&self, map: &Tensor) -> Result<Tensor> {
        let images = self.maps.of(&map.reshape((MODES * FEATURES, 1))?)?;
        images.reshape((self.count, MODES, FEATURES))?.sum(0)? * (1.0 / self.count as f64)
    }
}

impl Images {
    fn new(each: impl Iterator<Item = Vec<(usize, f32)>>) -> Result<Self> {
        let (from, signs): (Vec<u32>, Vec<f32>) = each.flatten().map(|(from, sign)| (from as u32, sign)).unzip();
        let count = from.len();
        Ok(Self {
            from: Tensor::from_vec(from, count, &Device::Cpu)?,
            signs: Tensor::from_vec(signs, (count, 1), &Device::Cpu)?,
        })
    }

    /// Returns all images of the rows of a tensor: (rows, k) to (g rows, k).
    fn of(&self, rows: &Tensor) -> Result<Tensor> {
        rows.index_select(&self.from, 0)?.broadcast_mul(&self.signs)
    }
}

/// Returns the origin and the sign of each mode of an image. Derivatives transform as a tensor, hourglass modes as a
/// vector times the sign of x·y.
fn on_modes(g: Symmetry) -> Vec<(usize, f32)> {
    let m = g.matrix().map(|row| row.map(|entry| entry as f32));
    let twist = m[0][0] * m[1][1] + m[0][1] * m[1][0];
    let entry = |to: usize, from: usize| {
        let [(along, component), (from_along, from_component)] = [to, from].map(|mode| (mode / 2, mode % 2));
        let vector = m[component][from_component];
        match (along, from_along) {
            (2, 2) => twist * vector,
            (0 | 1, 0 | 1) => m[along][from_along] * vector,
            _ => 0.0,
        }
    };
    let entries = |to| (0..MODES).map(move |from| (from, entry(to, from)));
    let source = |to| entries(to).find(|(_, sign)| *sign != 0.0);
    (0..MODES).filter_map(source).collect()
}

/// Returns the origin and the sign of each feature of an image. Neighbour cells are permuted, modes transform, and the
/// constant stays.
fn on_features(g: Symmetry) -> Vec<(usize, f32)> {
    let mut sources = vec![(FEATURES - 1, 1.0); FEATURES];
    for (from, to) in g.permutation([3; 2]).enumerate() {
        sources[to] = (from, 1.0);
    }
    for first in [NEIGHBOURS, NEIGHBOURS + MODES] {
        for (source, (from, sign)) in sources[first..].iter_mut().zip(on_modes(g)) {
            *source = (first + from, sign);
        }
    }
    sources
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_base::Stream;

    /// Returns the matrix of a symmetry.
    fn matrix(sources: &[(usize, f32)]) -> Tensor {
        let side = sources.len();
        let mut values = vec![0.0f32; side * side];
        for (to, (from, sign)) in sources.iter().enumerate() {
            values[to * side + from] = *sign;
        }
        Tensor::from_vec(values, (side, side), &Device::Cpu).unwrap()
    }

    fn numbers(dims: (usize, usize)) -> Tensor {
        let mut stream = Stream::new(4, "orientations test", 0);
        let values: Vec<f32> = (0..dims.0 * dims.1).map(|_| stream.normal() as f32).collect();
        Tensor::from_vec(values, dims, &Device::Cpu).unwrap()
    }

    fn flat(x: &Tensor) -> Vec<f32> {
        x.flatten_all().unwrap().to_vec1().unwrap()
    }

    #[test]
    fn selections_equal_products_with_the_matrices_of_the_symmetries() {
        let orientations = Orientations::new(Symmetries::SQUARE).unwrap();
        let features = Symmetry::ALL.map(|g| matrix(&on_features(g)));
        let modes = Symmetry::ALL.map(|g| matrix(&on_modes(g)));
        let forms = numbers((3, FEATURES));
        let images = features.each_ref().map(|g| forms.matmul(&g.t().unwrap()).unwrap());
        let found = orientations.of_forms(&forms).unwrap();
        assert_eq!(flat(&found), flat(&Tensor::cat(&images, 0).unwrap()));
        let stresses = numbers((MODES, 2));
        let images = modes.each_ref().map(|g| g.matmul(&stresses).unwrap());
        let found = orientations.of_stresses(&stresses).unwrap();
        assert_eq!(flat(&found), flat(&Tensor::cat(&images, 1).unwrap()));
        let map = numbers((MODES, FEATURES));
        let sum = modes
            .iter()
            .zip(&features)
            .fold(map.zeros_like().unwrap(), |sum, (modes, features)| {
                (sum + modes.matmul(&map).unwrap().matmul(&features.t().unwrap()).unwrap()).unwrap()
            });
        let found = orientations.average(&map).unwrap();
        assert_eq!(flat(&found), flat(&(sum * 0.125).unwrap()));
    }

    #[test]
    fn symmetries_act_as_a_group() {
        for g in Symmetry::ALL {
            for h in Symmetry::ALL {
                let composed = g.compose(h);
                for on in [on_modes, on_features] {
                    let product = matrix(&on(g)).matmul(&matrix(&on(h))).unwrap();
                    assert_eq!(flat(&product), flat(&matrix(&on(composed))));
                }
            }
        }
    }
}
