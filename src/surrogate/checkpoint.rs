//! Checkpoints: the state of a training after an epoch, as bytes. A resumed training gives the same bits.
//!
//! Random streams are created anew in each epoch, so a checkpoint holds no generator state.

use serde::{Deserialize, Serialize};

use super::outcome::EpochReport;
use deaflow_base::{decode, encode};

/// The state of a training after an epoch.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Checkpoint {
    /// History.
    pub(crate) history: History,
    /// Weights.
    pub(crate) weights: Vec<Vec<f32>>,
    /// Weights of the best epoch; empty before there is one.
    pub(crate) best: Vec<Vec<f32>>,
    /// Running means of the optimiser.
    pub(crate) means: Vec<Vec<f32>>,
}

/// The history of a training.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct History {
    /// One report per epoch.
    pub(crate) curves: Vec<EpochReport>,
    /// Selection error in mm and number of the best epoch.
    pub(crate) best: Option<(f64, u32)>,
    /// Finished steps of the optimiser.
    pub(crate) steps: u32,
}

/// Number of values in each tensor of the weights, the best weights and the optimiser.
type Lengths = [Vec<u64>; 3];

impl Checkpoint {
    /// Encodes the length of the header, the header and the values. `None` when the header is too long to encode.
    pub(crate) fn to_bytes(&self) -> Option<Vec<u8>> {
        let groups = [&self.weights, &self.best, &self.means];
        let lengths: Lengths = groups.map(|group| group.iter().map(|values| values.len() as u64).collect());
        let header = encode(&(&self.history, &lengths)).ok()?;
        let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
        bytes.extend(header);
        let values = groups.into_iter().flatten().flatten();
        bytes.extend(values.flat_map(|value| value.to_le_bytes()));
        Some(bytes)
    }

    /// Decodes a checkpoint; `None` when the bytes are not one.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (length, rest) = bytes.split_first_chunk::<8>()?;
        let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
        let (header, rest) = rest.split_at_checked(length)?;
        let (history, lengths): (History, Lengths) = decode(header).ok()?;
        let total = lengths.iter().flatten().try_fold(0u64, |sum, n| sum.checked_add(*n))?;
        if !rest.len().is_multiple_of(4) || total != (rest.len() / 4) as u64 {
            return None;
        }
        let mut values = rest.as_chunks::<4>().0.iter().map(|four| f32::from_le_bytes(*four));
        let [weights, best, means] = lengths.map(|group| {
            let tensor = |n: u64| values.by_ref().take(n as usize).collect();
            group.into_iter().map(tensor).collect()
        });
        Some(Self {
            history,
            weights,
            best,
            means,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checkpoint() -> Checkpoint {
        let report = EpochReport {
            epoch: 1,
            train_loss: 0.1 + 0.2,
            validation_loss: 1.0 / 3.0,
            validation_rmse_mm: 0.05,
            selection_rmse_mm: 0.05,
            learning_rate: 1e-3,
        };
        Checkpoint {
            history: History {
                curves: vec![report],
                best: Some((0.05, 1)),
                steps: 12,
            },
            weights: vec![vec![1.0, -0.0], vec![f32::MIN_POSITIVE]],
            best: vec![vec![2.0, 3.0], vec![4.0]],
            means: vec![vec![], vec![5.0]],
        }
    }

    #[test]
    fn checkpoints_survive_encoding_and_decoding() {
        let checkpoint = checkpoint();
        let back = Checkpoint::from_bytes(&checkpoint.to_bytes().unwrap()).unwrap();
        assert_eq!(back, checkpoint);
        assert!(back.weights[0][1].is_sign_negative());
    }

    #[test]
    fn other_bytes_are_refused() {
        let bytes = checkpoint().to_bytes().unwrap();
        for length in 0..bytes.len() {
            assert_eq!(Checkpoint::from_bytes(&bytes[..length]), None, "{length} bytes");
        }
        assert_eq!(Checkpoint::from_bytes(&[&bytes[..], &[0]].concat()), None);
        assert_eq!(Checkpoint::from_bytes(&[255; 64]), None);
    }
}
