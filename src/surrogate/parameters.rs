//! The named weights of a network: freshly drawn, or read back.
//!
//! candle draws initial weights from the generator of the thread; here each tensor has a stream of its own, named after
//! it, so that weights depend on the seed alone.

use std::collections::BTreeMap;

use candle_core::{Device, Result, Tensor, Var, bail};

use crate::base::Stream;

/// Where the weights of a network come from, and which it asked for.
pub(crate) struct Parameters<'a> {
    source: Source<'a>,
    device: &'a Device,
    drawn: Vec<(String, Var)>,
    used: usize,
}

enum Source<'a> {
    Seed(u64),
    Stored(&'a BTreeMap<String, Tensor>),
}

impl<'a> Parameters<'a> {
    /// Weights to be trained, drawn under a seed.
    pub(crate) fn drawn(seed: u64, device: &'a Device) -> Self {
        Self {
            source: Source::Seed(seed),
            device,
            drawn: Vec::new(),
            used: 0,
        }
    }

    /// Weights read back.
    pub(crate) fn stored(tensors: &'a BTreeMap<String, Tensor>, device: &'a Device) -> Self {
        Self {
            source: Source::Stored(tensors),
            device,
            drawn: Vec::new(),
            used: 0,
        }
    }

    /// The tensor of that name: normally distributed with the given standard deviation when drawn.
    pub(crate) fn tensor(&mut self, name: &str, dims: &[usize], deviation: f64) -> Result<Tensor> {
        self.used += 1;
        match self.source {
            Source::Stored(tensors) => match tensors.get(name) {
                Some(tensor) if tensor.dims() == dims => tensor.to_device(self.device),
                Some(tensor) => bail!("tensor {name} has shape {:?}, not {dims:?}", tensor.dims()),
                None => bail!("tensor {name} is missing"),
            },
            Source::Seed(seed) => {
                let mut stream = Stream::new(seed, &format!("surrogate weights {name}"), 0);
                let count = dims.iter().product();
                let values: Vec<f32> = (0..count).map(|_| (stream.normal() * deviation) as f32).collect();
                let var = Var::from_vec(values, dims, self.device)?;
                let tensor = var.as_tensor().clone();
                self.drawn.push((name.to_owned(), var));
                Ok(tensor)
            }
        }
    }

    /// The weights that were drawn, in the order in which the network asked.
    pub(crate) fn into_drawn(self) -> Vec<(String, Var)> {
        self.drawn
    }

    /// How many tensors the network asked for.
    pub(crate) fn used(&self) -> usize {
        self.used
    }
}
