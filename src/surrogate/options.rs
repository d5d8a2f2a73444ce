//! Options of a training.

use super::corners::HeldSides;
use super::networks::NetworkKind;
use super::outcome::TrainError;
use deaflow_base::words;
use deaflow_dataset::SymmetryGroup;
use deaflow_pattern::Symmetries;

words! {
    /// Optimiser.
    pub enum OptimizerKind {
        /// AdamW for all weights.
        AdamW = "adamw",
        /// Muon for convolution kernels, AdamW for all other weights.
        Muon = "muon",
    }
}

/// Options of a training.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainOptions {
    /// The network.
    pub network: NetworkKind,
    /// Passes over the training examples, at least 1. Default: 30.
    pub epochs: u32,
    /// Early stopping: training ends after this many epochs without a smaller validation error (training error where
    /// there are no validation examples), at least 1. Default: no early stopping.
    pub patience: Option<u32>,
    /// Examples per step, at least 1. Default: 8, because with a thousand examples many small steps beat few large
    /// ones.
    pub batch: u32,
    /// The optimiser. Default: Muon.
    pub optimizer: OptimizerKind,
    /// Largest learning rate, above 0. Default: 0.002; 0.01 for the network `physics`, which has few weights.
    pub learning_rate: f64,
    /// Weight decay per unit of learning rate (Loshchilov & Hutter, "Decoupled weight decay regularization", ICLR
    /// 2019), at least 0. Default: 0.0001.
    pub weight_decay: f64,
    /// Gradient clipping: largest norm of the gradient of all weights, above 0 (Pascanu, Mikolov & Bengio, ICML 2013).
    /// Default: no clipping.
    pub gradient_norm: Option<f64>,
    /// Data augmentation: each epoch transforms each example by a random symmetry. Default: none.
    pub symmetry: SymmetryGroup,
    /// Symmetries of the device, from which augmentation draws. Default: those of the square.
    pub symmetries: Symmetries,
    /// The components that the sides of the device hold; displacements then count from rest. Default: all sides are
    /// held.
    pub sides: Option<HeldSides>,
    /// Load of each electrode group relative to the largest. Load is proportional to voltage squared. Default: one
    /// group.
    pub loads: Vec<f64>,
    /// λ: weight of the largest absolute error of each field in the loss, at least 0. Default: 0.1.
    pub max_weight: f64,
    /// Weight of the auxiliary output at half resolution in the loss, at least 0. Default: 0.2.
    pub auxiliary_weight: f64,
    /// Seed of the initial weights, the order of the examples and their symmetries. Default: 0.
    pub seed: u64,
}

impl Default for TrainOptions {
    fn default() -> Self {
        Self {
            network: NetworkKind::Qin2024,
            epochs: 30,
            patience: None,
            batch: 8,
            optimizer: OptimizerKind::Muon,
            learning_rate: 2e-3,
            weight_decay: 1e-4,
            gradient_norm: None,
            symmetry: SymmetryGroup::None,
            symmetries: Symmetries::SQUARE,
            sides: None,
            loads: vec![1.0],
            max_weight: 0.1,
            auxiliary_weight: 0.2,
            seed: 0,
        }
    }
}

impl TrainOptions {
    /// Returns the defaults for a network.
    #[must_use]
    pub fn of(network: NetworkKind) -> Self {
        let defaults = Self::default();
        Self {
            network,
            learning_rate: match network {
                NetworkKind::Qin2024 => defaults.learning_rate,
                NetworkKind::Physics => 1e-2,
            },
            ..defaults
        }
    }

    /// Returns an error for the first option that is out of range.
    pub(crate) fn check(&self) -> Result<(), TrainError> {
        let check = |name, value: f64, in_range: bool, allowed| match value.is_finite() && in_range {
            true => Ok(()),
            false => Err(TrainError::Option { name, value, allowed }),
        };
        let (patience, norm) = (self.patience.unwrap_or(1), self.gradient_norm.unwrap_or(1.0));
        for (name, value) in [("epochs", self.epochs), ("patience", patience), ("batch", self.batch)] {
            check(name, value.into(), value >= 1, "at least 1")?;
        }
        for (name, value) in [("learning_rate", self.learning_rate), ("gradient_norm", norm)] {
            check(name, value, value > 0.0, "above 0")?;
        }
        let (weight_decay, max_weight, auxiliary) = (self.weight_decay, self.max_weight, self.auxiliary_weight);
        for (name, value) in [
            ("weight_decay", weight_decay),
            ("max_weight", max_weight),
            ("auxiliary_weight", auxiliary),
        ] {
            check(name, value, value >= 0.0, "at least 0")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_out_of_range_are_refused() {
        assert!(TrainOptions::default().check().is_ok());
        let changes: [fn(&mut TrainOptions); 10] = [
            |o| o.epochs = 0,
            |o| o.patience = Some(0),
            |o| o.batch = 0,
            |o| o.learning_rate = 0.0,
            |o| o.learning_rate = f64::NAN,
            |o| o.weight_decay = -1e-9,
            |o| o.gradient_norm = Some(0.0),
            |o| o.gradient_norm = Some(f64::INFINITY),
            |o| o.max_weight = -0.1,
            |o| o.auxiliary_weight = f64::INFINITY,
        ];
        for (k, change) in changes.into_iter().enumerate() {
            let mut options = TrainOptions::default();
            change(&mut options);
            assert!(options.check().is_err(), "case {k}");
        }
    }

    #[test]
    fn optimisers_are_found_by_their_names() {
        for kind in OptimizerKind::ALL {
            assert_eq!(OptimizerKind::from_name(kind.name()), Some(kind));
        }
        assert_eq!(OptimizerKind::from_name("sgd"), None);
    }
}
