//! How to train.

use super::networks::NetworkKind;
use super::train::TrainError;

/// Options of a training.
#[derive(Clone, Debug, PartialEq)]
pub struct TrainOptions {
    /// Which network.
    pub network: NetworkKind,
    /// Passes over the training examples, at least 1; 30 by default.
    pub epochs: u32,
    /// Examples per step, at least 1; 8 by default: with a thousand examples many small steps beat few large ones.
    pub batch: u32,
    /// Largest learning rate, above 0; 0.002 by default.
    pub learning_rate: f64,
    /// λ: weight of the largest absolute error of each field in the loss, at least 0; 0.1 by default.
    pub max_weight: f64,
    /// Weight of the auxiliary branch at half resolution in the loss, at least 0; 0.2 by default.
    pub auxiliary_weight: f64,
    /// Seed of the weights and of the order of the examples; 0 by default.
    pub seed: u64,
}

impl Default for TrainOptions {
    fn default() -> Self {
        Self {
            network: NetworkKind::Qin2024,
            epochs: 30,
            batch: 8,
            learning_rate: 2e-3,
            max_weight: 0.1,
            auxiliary_weight: 0.2,
            seed: 0,
        }
    }
}

impl TrainOptions {
    /// Whether every option is in its range.
    pub(crate) fn check(&self) -> Result<(), TrainError> {
        let rate = self.learning_rate;
        let weight = |w: f64| w.is_finite() && w >= 0.0;
        let checks = [
            ("epochs", f64::from(self.epochs), self.epochs >= 1, "at least 1"),
            ("batch", f64::from(self.batch), self.batch >= 1, "at least 1"),
            ("learning_rate", rate, rate.is_finite() && rate > 0.0, "above 0"),
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
        let good = TrainOptions::default();
        assert!(good.check().is_ok());
        let bad = [
            TrainOptions {
                epochs: 0,
                ..good.clone()
            },
            TrainOptions {
                batch: 0,
                ..good.clone()
            },
            TrainOptions {
                learning_rate: 0.0,
                ..good.clone()
            },
            TrainOptions {
                learning_rate: f64::NAN,
                ..good.clone()
            },
            TrainOptions {
                max_weight: -0.1,
                ..good.clone()
            },
            TrainOptions {
                auxiliary_weight: f64::INFINITY,
                ..good
            },
        ];
        assert!(bad.iter().all(|options| options.check().is_err()));
    }
}
