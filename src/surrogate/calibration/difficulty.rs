//! Predicts the median of the error from the features of a pattern, and the quantile of the scores of its neighbours.

use deaflow_linalg::{Mat, solve_definite};

use super::error::CalibrationError;
use super::features::DIFFICULTY;

/// Probability that an interval covers the simulated value.
pub const COVERAGE: f64 = 0.95;

/// Number of neighbours for a quantile: few enough to be similar, enough that ⌈0.95 (k + 1)⌉ of k is not the last.
const NEIGHBOURS: usize = 60;

/// Weight of the squared coefficients. It prevents overfitting of a few hundred patterns.
const RIDGE: f64 = 5.0;

/// Rounds of reweighting. The third digit of the coefficients then no longer changes.
const ROUNDS: usize = 30;

/// Lower bound of residuals in the weights of the regression, where the absolute value has a kink.
const KINK: f64 = 1e-2;

/// Number of terms of a quadratic polynomial in all features.
const TERMS: usize = 1 + DIFFICULTY + DIFFICULTY * (DIFFICULTY + 1) / 2;

/// The features of a pattern.
type Point = [f64; DIFFICULTY];

/// The arrays in files.
#[derive(Clone, Debug, PartialEq)]
pub struct DifficultyParts {
    /// Mean of each feature.
    pub centre: Vec<f64>,
    /// Standard deviation of each feature.
    pub deviation: Vec<f64>,
    /// Smallest and largest logarithm of an error in the fit. They bound the median.
    pub range: Vec<f64>,
    /// Coefficients of 1, the scaled features, and their products.
    pub coefficients: Vec<f64>,
    /// Scaled features of the scored patterns, concatenated.
    pub points: Vec<f64>,
    /// Logarithm of the largest error of each scored pattern minus the logarithm of its median.
    pub scores: Vec<f64>,
}

/// The regression and the scored patterns.
pub(super) struct Difficulty {
    parts: DifficultyParts,
}

impl Difficulty {
    /// Fits features with the logarithms of errors: the first half gives the median, the second the scores.
    ///
    /// # Errors
    /// When a value is not a number.
    pub(super) fn fit(first: &[(Point, f64)], second: &[(Point, f64)]) -> Result<Self, CalibrationError> {
        let n = first.len() as f64;
        let mean = |k: usize| first.iter().map(|(f, _)| f[k]).sum::<f64>() / n;
        let centre: Vec<f64> = (0..DIFFICULTY).map(mean).collect();
        let deviation = |k: usize| {
            let squares: f64 = first.iter().map(|(f, _)| (f[k] - centre[k]).powi(2)).sum();
            (squares / n).sqrt() + 1e-9
        };
        let deviation = (0..DIFFICULTY).map(deviation).collect();
        let logs: Vec<f64> = first.iter().map(|(_, log)| *log).collect();
        let range = vec![
            logs.iter().copied().fold(f64::INFINITY, f64::min),
            logs.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        ];
        let mut fitted = Self {
            parts: DifficultyParts {
                centre,
                deviation,
                range,
                coefficients: Vec::new(),
                points: Vec::new(),
                scores: Vec::new(),
            },
        };
        let rows: Vec<[f64; TERMS]> = first.iter().map(|(f, _)| terms(&fitted.scaled(f))).collect();
        fitted.parts.coefficients = median_regression(&rows, &logs)?;
        for (features, log) in second {
            let point = fitted.scaled(features);
            fitted.parts.scores.push(log - fitted.median(&point).ln());
            fitted.parts.points.extend(point);
        }
        Ok(fitted)
    }

    fn scaled(&self, features: &Point) -> Point {
        std::array::from_fn(|k| (features[k] - self.parts.centre[k]) / self.parts.deviation[k])
    }

    fn median(&self, point: &Point) -> f64 {
        let log: f64 = terms(point)
            .iter()
            .zip(&self.parts.coefficients)
            .map(|(t, c)| t * c)
            .sum();
        // Far from the calibration patterns a quadratic polynomial may take any value.
        log.max(self.parts.range[0]).min(self.parts.range[1]).exp()
    }

    /// Returns the number of scored patterns.
    pub(super) fn len(&self) -> usize {
        self.parts.scores.len()
    }

    fn points(&self) -> &[Point] {
        self.parts.points.as_chunks().0
    }

    /// Returns the medians of the largest error of the scored patterns, mm.
    pub(super) fn medians(&self) -> impl Iterator<Item = f64> {
        self.points().iter().map(|point| self.median(point))
    }

    /// Returns the median of the largest error of a component in mm, and the conformal quantile of the scores of the
    /// nearest patterns. `scores` of the first scored patterns may replace the own scores.
    pub(super) fn median_and_quantile(&self, features: &Point, scores: Option<&[f64]>) -> (f64, f64) {
        let point = self.scaled(features);
        let scores = scores.unwrap_or(&self.parts.scores);
        (self.median(&point), self.quantile(&point, scores, COVERAGE))
    }

    fn quantile(&self, point: &Point, scores: &[f64], probability: f64) -> f64 {
        let distance = |other: &Point| other.iter().zip(point).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        let mut near: Vec<(f64, f64)> = self.points().iter().map(distance).zip(scores.iter().copied()).collect();
        let count = NEIGHBOURS.min(near.len());
        if count == 0 {
            return 0.0;
        }
        let order = |a: &(f64, f64), b: &(f64, f64)| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1));
        near.select_nth_unstable_by(count - 1, order);
        let mut nearest: Vec<f64> = near[..count].iter().map(|(_, score)| *score).collect();
        nearest.sort_by(f64::total_cmp);
        nearest[rank(count, probability)]
    }

    /// Returns the arrays.
    pub(super) fn parts(&self) -> DifficultyParts {
        self.parts.clone()
    }

    /// Checks the arrays.
    pub(super) fn from_parts(parts: DifficultyParts) -> Result<Self, CalibrationError> {
        if [&parts.centre, &parts.deviation]
            .iter()
            .any(|array| array.len() != DIFFICULTY)
            || parts.range.len() != 2
        {
            return Err(CalibrationError::Parts("features"));
        }
        let points = parts.points.len() == DIFFICULTY * parts.scores.len() && !parts.scores.is_empty();
        match points && parts.coefficients.len() == TERMS {
            true => Ok(Self { parts }),
            false => Err(CalibrationError::Parts("difficulty")),
        }
    }
}

/// Returns the index of the conformal quantile among n sorted values: ⌈p (n + 1)⌉ − 1, at most n − 1.
pub(super) fn rank(n: usize, probability: f64) -> usize {
    let rank = (probability * (n + 1) as f64 - 1e-9).ceil() as usize;
    rank.clamp(1, n) - 1
}

/// Returns 1, the features, and their products.
fn terms(point: &Point) -> [f64; TERMS] {
    let mut terms = [1.0; TERMS];
    terms[1..=DIFFICULTY].copy_from_slice(point);
    let pairs = (0..DIFFICULTY).flat_map(|i| (i..DIFFICULTY).map(move |j| (i, j)));
    for (term, (i, j)) in terms[1 + DIFFICULTY..].iter_mut().zip(pairs) {
        *term = point[i] * point[j];
    }
    terms
}

/// Fits the median of values as a linear function of terms by iteratively reweighted least squares (Schlossmacher, J.
/// Am. Stat. Assoc. 68 (1973) 857), and returns the coefficients.
///
/// # Errors
/// When a value is not a number.
fn median_regression(rows: &[[f64; TERMS]], values: &[f64]) -> Result<Vec<f64>, CalibrationError> {
    let mut weights = vec![1.0; rows.len()];
    let mut coefficients = vec![0.0; TERMS];
    for _ in 0..ROUNDS {
        // The lower triangle; the solver reads no more.
        let mut matrix = Mat::from_fn(TERMS, TERMS, |i, j| if i == j { RIDGE } else { 0.0 });
        let mut right = [0.0; TERMS];
        for ((row, value), weight) in rows.iter().zip(values).zip(&weights) {
            for j in 0..TERMS {
                let weighted = weight * row[j];
                right[j] += weighted * value;
                let column = matrix.col_as_slice_mut(j)[j..].iter_mut();
                column.zip(&row[j..]).for_each(|(m, r)| *m += weighted * r);
            }
        }
        coefficients = solve_definite(&matrix, &right).ok_or(CalibrationError::Singular)?;
        for ((row, value), weight) in rows.iter().zip(values).zip(&mut weights) {
            let fitted: f64 = row.iter().zip(&coefficients).map(|(r, c)| r * c).sum();
            *weight = 0.5 / (value - fitted).abs().max(KINK);
        }
    }
    Ok(coefficients)
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_base::Stream;

    #[test]
    fn ranks_are_those_of_the_conformal_quantile() {
        assert_eq!((rank(19, 0.95), rank(100, 0.95), rank(10, 0.95)), (18, 95, 9));
        assert_eq!((rank(99, 0.99), rank(98, 0.99), rank(1, 0.95)), (98, 97, 0));
    }

    #[test]
    fn the_median_is_found_among_outliers() {
        // A tenth of the values are outliers on one side. They shift the mean, but not the median.
        let mut stream = Stream::new(5, "median test", 0);
        let sample = |stream: &mut Stream| {
            let at: Point = std::array::from_fn(|_| stream.normal());
            let is_outlier = stream.chance(0.1);
            let noise = if is_outlier { 8.0 } else { 0.05 * stream.normal() };
            (at, 0.5 * at[0] - 0.2 * at[1] * at[2] - 3.0 + noise)
        };
        let samples: Vec<(Point, f64)> = (0..1500).map(|_| sample(&mut stream)).collect();
        let fitted = Difficulty::fit(&samples, &samples[..300]).unwrap();
        for (at, _) in &samples[..20] {
            let found = fitted.median(&fitted.scaled(at)).ln();
            let expected = 0.5 * at[0] - 0.2 * at[1] * at[2] - 3.0;
            assert!((found - expected).abs() < 0.12, "{found} {expected}");
        }
    }
}
