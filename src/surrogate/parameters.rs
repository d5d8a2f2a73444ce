//! The named weights of a network: freshly drawn, or read back.
//!
//! candle draws initial weights from the generator of the thread; here each tensor has a stream of its own, named after
//! it, so that weights depend on the seed alone.

use std::collections::{BTreeMap, BTreeSet};

use candle_core::{Device, Result, Tensor, Var, bail};

use crate::base::Stream;

/// Where the weights of a network come from, and which it asked for.
pub(crate) struct Parameters<'a> {
    source: Source<'a>,
    device: &'a Device,
    drawn: Vec<(String, Var)>,
    used: BTreeSet<String>,
}

enum Source<'a> {
    Seed(u64, BTreeMap<String, Tensor>),
    Stored(&'a BTreeMap<String, Tensor>),
}

impl<'a> Parameters<'a> {
    /// Weights to be trained, drawn under a seed, beside constants that are not trained.
    pub(crate) fn drawn(constants: BTreeMap<String, Tensor>, seed: u64, device: &'a Device) -> Self {
        Self {
            source: Source::Seed(seed, constants),
            device,
            drawn: Vec::new(),
            used: BTreeSet::new(),
        }
    }

    /// Weights read back.
    pub(crate) fn stored(tensors: &'a BTreeMap<String, Tensor>, device: &'a Device) -> Self {
        Self {
            source: Source::Stored(tensors),
            device,
            drawn: Vec::new(),
            used: BTreeSet::new(),
        }
    }

    /// The tensor of that name: normally distributed with the given standard deviation when drawn.
    pub(crate) fn tensor(&mut self, name: &str, dims: &[usize], deviation: f64) -> Result<Tensor> {
        self.used.insert(name.to_owned());
        match &self.source {
            Source::Stored(tensors) => shaped(tensors, name, dims)?.to_device(self.device),
            Source::Seed(seed, _) => {
                let mut stream = Stream::new(*seed, &format!("surrogate weights {name}"), 0);
                let count = dims.iter().product();
                let values: Vec<f32> = (0..count).map(|_| (stream.normal() * deviation) as f32).collect();
                let var = Var::from_vec(values, dims, self.device)?;
                let tensor = var.as_tensor().clone();
                self.drawn.push((name.to_owned(), var));
                Ok(tensor)
            }
        }
    }

    /// The tensor of that name that is not trained.
    pub(crate) fn constant(&mut self, name: &str, dims: &[usize]) -> Result<Tensor> {
        self.used.insert(name.to_owned());
        let tensors = match &self.source {
            Source::Stored(tensors) => tensors,
            Source::Seed(_, constants) => constants,
        };
        shaped(tensors, name, dims)?.to_device(self.device)
    }

    /// Whether the weights stay as they are.
    pub(crate) fn are_stored(&self) -> bool {
        matches!(self.source, Source::Stored(_))
    }

    /// Where the network runs.
    pub(crate) fn device(&self) -> &Device {
        self.device
    }

    /// The weights that were drawn, in the order in which the network asked.
    pub(crate) fn into_drawn(self) -> Vec<(String, Var)> {
        self.drawn
    }

    /// The tensors that the network asked for.
    pub(crate) fn used(&self) -> &BTreeSet<String> {
        &self.used
    }
}

/// The tensor of that name and shape.
fn shaped<'a>(tensors: &'a BTreeMap<String, Tensor>, name: &str, dims: &[usize]) -> Result<&'a Tensor> {
    match tensors.get(name) {
        Some(tensor) if tensor.dims() == dims => Ok(tensor),
        Some(tensor) => bail!("tensor {name} has shape {:?}, not {dims:?}", tensor.dims()),
        None => bail!("tensor {name} is missing"),
    }
}
