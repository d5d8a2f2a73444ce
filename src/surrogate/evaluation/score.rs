//! Errors of a predictor on labelled patterns: a score of each pattern, and the score of a group.
//!
//! The scores of patterns suffice to score any group, by family, area or otherwise, without reading fields again.

use deaflow_field::Field;

/// Errors and displacements of one pattern, in mm or mm².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatternScore {
    /// Root mean square error of a component.
    pub rms_mm: f64,
    /// Largest absolute error of a component.
    pub max_error_mm: f64,
    /// Largest magnitude of the displacement's error over the corners.
    pub max_displacement_error_mm: f64,
    /// Largest displacement magnitude, predicted.
    pub predicted_max_mm: f64,
    /// Largest displacement magnitude, simulated.
    pub simulated_max_mm: f64,
    /// Mean of the simulated components.
    pub mean_mm: f64,
    /// Mean square of the simulated components.
    pub mean_square_mm2: f64,
}

impl PatternScore {
    /// Compares a prediction with a simulation.
    #[must_use]
    pub fn of(predicted: &Field, simulated: &Field) -> Self {
        let n = simulated.values().len() as f64;
        let pairs = || predicted.values().iter().zip(simulated.values());
        Self {
            rms_mm: predicted.rms_difference(simulated),
            max_error_mm: pairs().map(|(p, s)| (p - s).abs()).fold(0.0, f64::max),
            max_displacement_error_mm: predicted.max_difference(simulated),
            predicted_max_mm: predicted.max_magnitude(),
            simulated_max_mm: simulated.max_magnitude(),
            mean_mm: simulated.values().iter().sum::<f64>() / n,
            mean_square_mm2: simulated.values().iter().map(|u| u * u).sum::<f64>() / n,
        }
    }
}

/// The score of a group of patterns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// Patterns in the group.
    pub samples: u64,
    /// Root mean square error of a component, mm.
    pub rmse_mm: f64,
    /// Coefficient of determination of the components: 1 − Σ error² / Σ (value − mean)². For constant values it is 1
    /// for exact predictions and 0 otherwise.
    pub r2: f64,
    /// Coefficient of determination of the largest displacement of each pattern.
    pub max_r2: f64,
    /// Largest absolute error of a component, mm.
    pub max_error_mm: f64,
    /// Largest magnitude of the displacement's error, mm.
    pub max_displacement_error_mm: f64,
    /// The 95 % quantile over the patterns of the largest error of a component, mm.
    pub quantile95_mm: f64,
}

impl Score {
    /// Returns the score of a group; `None` for an empty group.
    #[must_use]
    pub fn of<'a>(group: impl Iterator<Item = &'a PatternScore>) -> Option<Self> {
        let group: Vec<&PatternScore> = group.collect();
        if group.is_empty() {
            return None;
        }
        let mean =
            |value: &dyn Fn(&PatternScore) -> f64| group.iter().map(|s| value(s)).sum::<f64>() / group.len() as f64;
        let largest = |value: fn(&PatternScore) -> f64| group.iter().map(|s| value(s)).fold(0.0, f64::max);
        let error = mean(&|s| s.rms_mm.powi(2));
        let centre = mean(&|s| s.mean_mm);
        let variance = mean(&|s| s.mean_square_mm2) - centre * centre;
        let peak = mean(&|s| s.simulated_max_mm);
        let mut largest_errors: Vec<f64> = group.iter().map(|s| s.max_error_mm).collect();
        largest_errors.sort_by(f64::total_cmp);
        Some(Self {
            samples: group.len() as u64,
            rmse_mm: error.sqrt(),
            r2: determination(error, variance),
            max_r2: determination(
                mean(&|s| (s.predicted_max_mm - s.simulated_max_mm).powi(2)),
                mean(&|s| (s.simulated_max_mm - peak).powi(2)),
            ),
            max_error_mm: largest(|s| s.max_error_mm),
            max_displacement_error_mm: largest(|s| s.max_displacement_error_mm),
            quantile95_mm: largest_errors[(0.95 * group.len() as f64 - 1e-9).ceil() as usize - 1],
        })
    }
}

/// Returns 1 − error / variance. Values that differ by rounding only count as constant.
fn determination(error: f64, variance: f64) -> f64 {
    if variance > 1e-24 {
        1.0 - error / variance
    } else {
        f64::from(u8::from(error <= 1e-24))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_field::CORNERS;
    use deaflow_pattern::Raster;

    const N: usize = CORNERS * CORNERS * 2;

    /// A field that is zero except for the first components.
    fn field(first: &[f64]) -> Field {
        let mut values = vec![0.0; N];
        values[..first.len()].copy_from_slice(first);
        Field::from_values(Raster::PAPER, values).unwrap()
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-12 * b.abs().max(1.0)
    }

    #[test]
    fn by_hand() {
        let scores = [
            PatternScore::of(&field(&[1.0, 0.0]), &field(&[3.0, -1.0])),
            PatternScore::of(&field(&[0.0, 2.0]), &field(&[0.0, 1.0])),
        ];
        assert_eq!((scores[0].max_error_mm, scores[0].predicted_max_mm), (2.0, 1.0));
        assert!(close(scores[0].max_displacement_error_mm, 5f64.sqrt()));
        let score = Score::of(scores.iter()).unwrap();
        let n = 2.0 * N as f64;
        assert!(close(score.rmse_mm, (6.0 / n).sqrt()));
        let variation = 11.0 - 9.0 / n;
        assert!(close(score.r2, 1.0 - 6.0 / variation), "{}", score.r2);
        // Simulated √10 and 1, predicted 1 and 2.
        let (a, b) = (10f64.sqrt(), 1.0);
        let spread = 2.0 * (0.5 * (a - b)).powi(2);
        assert!(close(score.max_r2, 1.0 - ((a - 1.0).powi(2) + 1.0) / spread));
        assert_eq!((score.samples, score.max_error_mm, score.quantile95_mm), (2, 2.0, 2.0));
    }

    #[test]
    fn a_single_sample_and_zero_fields_have_scores() {
        let still = PatternScore::of(&field(&[]), &field(&[]));
        let score = Score::of(std::iter::once(&still)).unwrap();
        assert_eq!(
            (score.r2, score.max_r2, score.rmse_mm, score.quantile95_mm),
            (1.0, 1.0, 0.0, 0.0)
        );
        let wrong = PatternScore::of(&field(&[0.5]), &field(&[]));
        let score = Score::of(std::iter::once(&wrong)).unwrap();
        assert_eq!((score.r2, score.max_r2, score.samples), (0.0, 0.0, 1));
        assert_eq!(Score::of(std::iter::empty()), None);
    }

    #[test]
    fn the_quantile_leaves_out_one_in_twenty() {
        let score = |error: f64| PatternScore::of(&field(&[error]), &field(&[]));
        let scores: Vec<PatternScore> = (1..=40).map(|k| score(f64::from(k))).collect();
        let found = Score::of(scores.iter()).unwrap();
        assert_eq!((found.quantile95_mm, found.max_error_mm), (38.0, 40.0));
    }
}
