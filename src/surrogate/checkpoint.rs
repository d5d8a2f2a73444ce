//! A training under way as bytes: all that it needs to be gone on with as if it had never stopped.
//!
//! Every random number is drawn from a stream of its own, so no generator has a state to keep.

use serde::{Deserialize, Serialize};

use super::outcome::EpochReport;
use deaflow_base::{decode, encode};

/// A training after an epoch.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Checkpoint {
    /// What is small.
    pub(crate) history: History,
    /// The weights.
    pub(crate) weights: Vec<Vec<f32>>,
    /// The weights of the best epoch; none while there is no best epoch.
    pub(crate) best: Vec<Vec<f32>>,
    /// The running means of the optimiser.
    pub(crate) means: Vec<Vec<f32>>,
}

/// What a training has come to.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct History {
    /// One report per epoch.
    pub(crate) curves: Vec<EpochReport>,
    /// The validation error of the best epoch and its number.
    pub(crate) best: Option<(f64, u32)>,
    /// Steps of the optimiser.
    pub(crate) steps: u32,
}

/// Counts of numbers: of each tensor of the weights, of the best weights, and of the optimiser.
type Lengths = [Vec<u64>; 3];

impl Checkpoint {
    /// As bytes: the length of a header, the header, and the numbers.
    ///
    /// None where the header cannot be encoded, which takes more epochs than anybody has time for.
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

    /// From bytes; none where they are something else.
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
            judged_rmse_mm: 0.05,
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
    fn a_training_survives_the_way_to_bytes_and_back() {
        let checkpoint = checkpoint();
        let back = Checkpoint::from_bytes(&checkpoint.to_bytes().unwrap()).unwrap();
        assert_eq!(back, checkpoint);
        assert!(back.weights[0][1].is_sign_negative());
    }

    #[test]
    fn other_bytes_are_no_training() {
        let bytes = checkpoint().to_bytes().unwrap();
        for length in 0..bytes.len() {
            assert_eq!(Checkpoint::from_bytes(&bytes[..length]), None, "{length} bytes");
        }
        assert_eq!(Checkpoint::from_bytes(&[&bytes[..], &[0]].concat()), None);
        assert_eq!(Checkpoint::from_bytes(&[255; 64]), None);
    }
}
