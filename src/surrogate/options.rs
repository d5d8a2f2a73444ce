//! How to train.

use super::networks::NetworkKind;
use super::outcome::TrainError;
use deaflow_base::words;
use deaflow_dataset::SymmetryGroup;
use deaflow_pattern::Symmetries;

words! {
    /// How weights follow gradients.
    pub enum OptimizerKind {
        /// All weights by AdamW.
        AdamW = "adamw",
        /// The kernels of convolutions by Muon, everything else by AdamW.
        Muon = "muon",
    }
}

/// Options of a training.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainOptions {
    /// Which network.
    pub network: NetworkKind,
    /// Passes over the training examples, at least 1; 30 by default.
    pub epochs: u32,
    /// Epochs without a smaller error on the validation examples (on the training examples where there are none) after which
    /// the training ends, at least 1; as many as there are by default.
    pub patience: Option<u32>,
    /// Examples per step, at least 1; 8 by default: with a thousand examples many small steps beat few large ones.
    pub batch: u32,
    /// The optimiser; Muon by default.
    pub optimizer: OptimizerKind,
    /// Largest learning rate, above 0; 0.002 by default, and 0.01 for the network `physics`, whose few weights bear it.
    pub learning_rate: f64,
    /// Pull of the weights towards zero, per unit of learning rate (Loshchilov & Hutter, "Decoupled weight decay
    /// regularization", ICLR 2019), at least 0; 0.0001 by default.
    pub weight_decay: f64,
    /// Largest norm of the gradient of all weights together, above 0: longer ones are shortened to it (Pascanu, Mikolov &
    /// Bengio, ICML 2013). By default none is shortened.
    pub gradient_norm: Option<f64>,
    /// By what each example of a step is turned, drawn anew in every epoch; by nothing by default.
    pub symmetry: SymmetryGroup,
    /// What maps the device to itself: of these `symmetry` turns examples; those of the square by default.
    pub symmetries: Symmetries,
    /// Of each group of electrodes the share of the largest load, which goes with the squared voltage; one group by default.
    pub loads: Vec<f64>,
    /// λ: weight of the largest absolute error of each field in the loss, at least 0; 0.1 by default.
    pub max_weight: f64,
    /// Weight of the auxiliary branch at half resolution in the loss, at least 0; 0.2 by default.
    pub auxiliary_weight: f64,
    /// Seed of the weights, of the order of the examples and of their symmetries; 0 by default.
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
            loads: vec![1.0],
            max_weight: 0.1,
            auxiliary_weight: 0.2,
            seed: 0,
        }
    }
}

impl TrainOptions {
    /// The defaults for a network.
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

    /// Whether every option is in its range.
    pub(crate) fn check(&self) -> Result<(), TrainError> {
        let positive = |value: f64| value.is_finite() && value > 0.0;
        let weight = |value: f64| value.is_finite() && value >= 0.0;
        let (patience, norm) = (self.patience.unwrap_or(1), self.gradient_norm.unwrap_or(1.0));
        let checks = [
            ("epochs", f64::from(self.epochs), self.epochs >= 1, "at least 1"),
            ("patience", f64::from(patience), patience >= 1, "at least 1"),
            ("batch", f64::from(self.batch), self.batch >= 1, "at least 1"),
            (
                "learning_rate",
                self.learning_rate,
                positive(self.learning_rate),
                "above 0",
            ),
            (
                "weight_decay",
                self.weight_decay,
                weight(self.weight_decay),
                "at least 0",
            ),
            ("gradient_norm", norm, positive(norm), "above 0"),
            ("max_weight", self.max_weight, weight(self.max_weight), "at least 0"),
            (
                "auxiliary_weight",
                self.auxiliary_weight,
                weight(self.auxiliary_weight),
                "at least 0",
            ),
        ];
        match checks.into_iter().find(|(_, _, valid, _)| !valid) {
            Some((name, value, _, allowed)) => Err(TrainError::Option { name, value, allowed }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_what_cannot_train() {
        assert!(TrainOptions::default().check().is_ok());
        let spoils: [fn(&mut TrainOptions); 10] = [
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
        for (k, spoil) in spoils.into_iter().enumerate() {
            let mut options = TrainOptions::default();
            spoil(&mut options);
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
