//! Backends of candle-nn's `VarBuilder`: random initial weights, and weights of a model file.
//!
//! candle-nn draws initial weights from a generator of the thread. Here each tensor has its own random stream, named
//! after the tensor, so that the weights depend on the seed only. Networks request constants, which are not trained,
//! through [`constant`].

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, MutexGuard, PoisonError};

use candle_core::{DType, Device, Result, Shape, Tensor, Var, bail};
use candle_nn::var_builder::SimpleBackend;
use candle_nn::{Init, VarBuilder, VarMap};

use deaflow_base::Stream;

/// Random initial weights, and constants.
pub(crate) struct RandomWeights<'a> {
    seed: u64,
    constants: &'a BTreeMap<String, Tensor>,
    variables: VarMap,
}

impl<'a> RandomWeights<'a> {
    /// Creates the backend of a seed.
    pub(crate) fn new(constants: &'a BTreeMap<String, Tensor>, seed: u64) -> Self {
        Self {
            seed,
            constants,
            variables: VarMap::new(),
        }
    }

    /// Returns a builder for a network.
    pub(crate) fn builder(&self) -> VarBuilder<'_> {
        VarBuilder::from_backend(Box::new(self), DType::F32, Device::Cpu)
    }

    /// Returns the weights drawn so far, in the order of their names.
    pub(crate) fn variables(&self) -> Vec<(String, Var)> {
        let variables: BTreeMap<String, Var> = locked(self.variables.data()).clone().into_iter().collect();
        variables.into_iter().collect()
    }
}

impl SimpleBackend for &RandomWeights<'_> {
    fn get(&self, shape: Shape, name: &str, init: Init, _: DType, device: &Device) -> Result<Tensor> {
        let mut stream = Stream::new(self.seed, &format!("surrogate weights {name}"), 0);
        let mut value = || match init {
            Init::Const(value) => Ok(value as f32),
            Init::Randn { mean, stdev } => Ok((mean + stream.normal() * stdev) as f32),
            other => bail!("unsupported initialisation {other:?}"),
        };
        let values: Vec<f32> = (0..shape.elem_count()).map(|_| value()).collect::<Result<_>>()?;
        let var = Var::from_vec(values, shape, device)?;
        let tensor = var.as_tensor().clone();
        locked(self.variables.data()).insert(name.to_owned(), var);
        Ok(tensor)
    }

    fn get_unchecked(&self, name: &str, _: DType, _: &Device) -> Result<Tensor> {
        named(self.constants, name)
    }

    fn contains_tensor(&self, name: &str) -> bool {
        self.constants.contains_key(name)
    }
}

/// Weights and constants of a model file.
pub(crate) struct StoredWeights<'a> {
    tensors: &'a BTreeMap<String, Tensor>,
    used: Mutex<BTreeSet<String>>,
}

impl<'a> StoredWeights<'a> {
    /// Creates the backend of the tensors of a model.
    pub(crate) fn new(tensors: &'a BTreeMap<String, Tensor>) -> Self {
        let used = Mutex::default();
        Self { tensors, used }
    }

    /// Returns a builder for a network.
    pub(crate) fn builder(&self) -> VarBuilder<'_> {
        VarBuilder::from_backend(Box::new(self), DType::F32, Device::Cpu)
    }

    /// Returns a tensor that no network has used, if there is one.
    pub(crate) fn unused(&self) -> Option<&str> {
        let used = locked(&self.used);
        let unused = self.tensors.keys().find(|name| !used.contains(*name));
        unused.map(String::as_str)
    }
}

impl SimpleBackend for &StoredWeights<'_> {
    fn get(&self, shape: Shape, name: &str, _: Init, dtype: DType, device: &Device) -> Result<Tensor> {
        shaped(self.get_unchecked(name, dtype, device)?, name, shape.dims())
    }

    fn get_unchecked(&self, name: &str, _: DType, _: &Device) -> Result<Tensor> {
        locked(&self.used).insert(name.to_owned());
        named(self.tensors, name)
    }

    fn contains_tensor(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }
}

/// Returns a constant of a network by name and shape.
pub(crate) fn constant(weights: &VarBuilder<'_>, name: &str, dims: &[usize]) -> Result<Tensor> {
    shaped(weights.get_unchecked(name)?, name, dims)
}

fn named(tensors: &BTreeMap<String, Tensor>, name: &str) -> Result<Tensor> {
    match tensors.get(name) {
        Some(tensor) => Ok(tensor.clone()),
        None => bail!("tensor {name} is missing"),
    }
}

fn shaped(tensor: Tensor, name: &str, dims: &[usize]) -> Result<Tensor> {
    match tensor.dims() == dims {
        true => Ok(tensor),
        false => bail!("tensor {name} has shape {:?}, not {dims:?}", tensor.dims()),
    }
}

/// Locks a mutex. After a panic the data is still valid, because every change is a single insertion.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use candle_nn::init::ZERO;

    use super::*;

    #[test]
    fn weights_depend_on_their_names_and_the_seed_alone() {
        let constants = BTreeMap::new();
        let normal = Init::Randn { mean: 0.0, stdev: 0.5 };
        let drawn = |seed, names: &[&str]| {
            let source = RandomWeights::new(&constants, seed);
            for name in names {
                let layer = source.builder().pp("layer");
                layer.get_with_hints((2, 3), name, normal).unwrap();
                layer.get_with_hints(4, &format!("{name}.bias"), ZERO).unwrap();
            }
            let values = |(name, var): (String, Var)| (name, var.flatten_all().unwrap().to_vec1::<f32>().unwrap());
            source.variables().into_iter().map(values).collect::<BTreeMap<_, _>>()
        };
        let (both, other) = (drawn(3, &["a", "b"]), drawn(4, &["a"]));
        assert!(both.keys().eq(["layer.a", "layer.a.bias", "layer.b", "layer.b.bias"]));
        assert_eq!(both["layer.b.bias"], [0.0; 4]);
        assert_eq!(both["layer.a"], drawn(3, &["b", "a"])["layer.a"]);
        assert_ne!(both["layer.a"], both["layer.b"]);
        assert_ne!(both["layer.a"], other["layer.a"]);
    }

    #[test]
    fn stored_tensors_are_found_by_name_and_shape() {
        let tensor = |count: usize| Tensor::zeros(count, DType::F32, &Device::Cpu).unwrap();
        let tensors = BTreeMap::from([("a".to_owned(), tensor(2)), ("b".to_owned(), tensor(3))]);
        let source = StoredWeights::new(&tensors);
        assert_eq!(source.unused(), Some("a"));
        assert!(source.builder().get(2, "a").is_ok() && source.unused() == Some("b"));
        assert!(constant(&source.builder(), "b", &[3]).is_ok() && source.unused().is_none());
        let error = |dims: usize, name: &str| source.builder().get(dims, name).err().unwrap().to_string();
        assert!(error(5, "a").contains("tensor a has shape [2], not [5]"));
        assert!(error(5, "c").contains("tensor c is missing"));
    }
}
