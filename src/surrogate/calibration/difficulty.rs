//! The median of the error by the features of a pattern, and the quantile of what is left among its neighbours.

use deaflow_linalg::{Mat, solve_definite};

use super::CalibrationError;
use super::features::DIFFICULTY;

/// Neighbours that make a quantile: few enough to be alike, many enough that ⌈0.95 (k + 1)⌉ of k is not the last.
const NEIGHBOURS: usize = 60;

/// Weight of the squares of the coefficients: without it a few hundred patterns would be fitted too well.
const RIDGE: f64 = 5.0;

/// Rounds of reweighting; the coefficients then no longer change in their third digit.
const ROUNDS: usize = 30;

/// Residuals of the regression below this weigh no more: the median has a kink there.
const KINK: f64 = 1e-2;

/// Terms of a quadratic in all features.
const TERMS: usize = 1 + DIFFICULTY + DIFFICULTY * (DIFFICULTY + 1) / 2;

/// The features of a pattern.
type Point = [f64; DIFFICULTY];

/// The arrays, as they stand in files.
#[derive(Clone, Debug, PartialEq)]
pub struct DifficultyParts {
    /// Mean of each feature, which is taken off.
    pub centre: Vec<f64>,
    /// Deviation of each feature, by which it is then divided.
    pub deviation: Vec<f64>,
    /// Smallest and largest logarithm of an error that the median was fitted to: it goes no farther.
    pub range: Vec<f64>,
    /// Coefficients of 1, the features, and their products.
    pub coefficients: Vec<f64>,
    /// Features of the calibration patterns, end to end.
    pub places: Vec<f64>,
    /// Logarithm of the largest error of each less its median.
    pub scores: Vec<f64>,
}

/// Where a pattern stands.
pub(super) struct Place {
    at: Point,
    /// Median of the largest error of a component in mm.
    pub(super) median: f64,
}

pub(super) struct Difficulty {
    centre: Point,
    deviation: Point,
    range: [f64; 2],
    coefficients: Vec<f64>,
    places: Vec<Point>,
    scores: Vec<f64>,
}

impl Difficulty {
    /// From features with the logarithm of the error: the first half makes the median, the second the scores.
    ///
    /// # Errors
    /// When a number is none.
    pub(super) fn fit(first: &[(Point, f64)], second: &[(Point, f64)]) -> Result<Self, CalibrationError> {
        let n = first.len() as f64;
        let centre: Point = std::array::from_fn(|k| first.iter().map(|(f, _)| f[k]).sum::<f64>() / n);
        let deviation = std::array::from_fn(|k| {
            let squares: f64 = first.iter().map(|(f, _)| (f[k] - centre[k]).powi(2)).sum();
            (squares / n).sqrt() + 1e-9
        });
        let logs: Vec<f64> = first.iter().map(|(_, log)| *log).collect();
        let mut fitted = Self {
            centre,
            deviation,
            range: logs
                .iter()
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &log| {
                    [low.min(log), high.max(log)]
                }),
            coefficients: Vec::new(),
            places: Vec::new(),
            scores: Vec::new(),
        };
        let rows: Vec<[f64; TERMS]> = first.iter().map(|(f, _)| terms(&fitted.scaled(f))).collect();
        fitted.coefficients = median_regression(&rows, &logs)?;
        for (features, log) in second {
            let place = fitted.place(features);
            fitted.scores.push(log - place.median.ln());
            fitted.places.push(place.at);
        }
        Ok(fitted)
    }

    fn scaled(&self, features: &Point) -> Point {
        std::array::from_fn(|k| (features[k] - self.centre[k]) / self.deviation[k])
    }

    fn median(&self, at: &Point) -> f64 {
        let log: f64 = terms(at).iter().zip(&self.coefficients).map(|(t, c)| t * c).sum();
        // Far from all calibration patterns a quadratic may say anything.
        log.max(self.range[0]).min(self.range[1]).exp()
    }

    /// Where a pattern with some features stands.
    pub(super) fn place(&self, features: &Point) -> Place {
        let at = self.scaled(features);
        Place {
            median: self.median(&at),
            at,
        }
    }

    /// Scores of the calibration patterns.
    pub(super) fn scores(&self) -> &[f64] {
        &self.scores
    }

    /// Medians of the largest error of the calibration patterns, mm.
    pub(super) fn medians(&self) -> impl Iterator<Item = f64> {
        self.places.iter().map(|at| self.median(at))
    }

    /// The conformal quantile of some scores, those of the first calibration patterns, among the nearest to a place.
    pub(super) fn quantile(&self, place: &Place, scores: &[f64], probability: f64) -> f64 {
        let distance = |at: &Point| at.iter().zip(&place.at).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        let mut near: Vec<(f64, f64)> = self.places.iter().map(distance).zip(scores.iter().copied()).collect();
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

    /// The arrays.
    pub(super) fn parts(&self) -> DifficultyParts {
        DifficultyParts {
            centre: self.centre.to_vec(),
            deviation: self.deviation.to_vec(),
            range: self.range.to_vec(),
            coefficients: self.coefficients.clone(),
            places: self.places.iter().flatten().copied().collect(),
            scores: self.scores.clone(),
        }
    }

    pub(super) fn from_parts(parts: DifficultyParts) -> Result<Self, CalibrationError> {
        let wrong = |_| CalibrationError::Parts("features");
        let places = parts.places.chunks_exact(DIFFICULTY);
        let whole = places.remainder().is_empty() && parts.coefficients.len() == TERMS;
        let places: Vec<Point> = places.map(|row| std::array::from_fn(|k| row[k])).collect();
        if !whole || places.is_empty() || places.len() != parts.scores.len() {
            return Err(CalibrationError::Parts("difficulties"));
        }
        Ok(Self {
            centre: parts.centre.try_into().map_err(wrong)?,
            deviation: parts.deviation.try_into().map_err(wrong)?,
            range: parts.range.try_into().map_err(wrong)?,
            coefficients: parts.coefficients,
            places,
            scores: parts.scores,
        })
    }
}

/// The place, among n values in order, of the conformal quantile: ⌈p (n + 1)⌉, from 1, or the last where that is beyond.
pub(super) fn rank(n: usize, probability: f64) -> usize {
    let rank = (probability * (n + 1) as f64 - 1e-9).ceil() as usize;
    rank.clamp(1, n) - 1
}

/// 1, the features, and their products.
fn terms(at: &Point) -> [f64; TERMS] {
    let mut terms = [1.0; TERMS];
    terms[1..=DIFFICULTY].copy_from_slice(at);
    let pairs = (0..DIFFICULTY).flat_map(|i| (i..DIFFICULTY).map(move |j| (i, j)));
    for (term, (i, j)) in terms[1 + DIFFICULTY..].iter_mut().zip(pairs) {
        *term = at[i] * at[j];
    }
    terms
}

/// Coefficients of the linear function of some terms that is the median of values: iteratively reweighted least squares
/// (Schlossmacher, J. Am. Stat. Assoc. 68 (1973) 857).
///
/// # Errors
/// When a number is none.
fn median_regression(rows: &[[f64; TERMS]], values: &[f64]) -> Result<Vec<f64>, CalibrationError> {
    let mut weights = vec![1.0; rows.len()];
    let mut coefficients = vec![0.0; TERMS];
    for _ in 0..ROUNDS {
        // The lower triangle, and that is all that is read of it.
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
        // A tenth of the values is far off, to one side: the mean would follow them, the median does not.
        let mut stream = Stream::new(5, "median test", 0);
        let sample = |stream: &mut Stream| {
            let at: Point = std::array::from_fn(|_| stream.normal());
            let noise = if stream.chance(0.1) {
                8.0
            } else {
                0.05 * stream.normal()
            };
            (at, 0.5 * at[0] - 0.2 * at[1] * at[2] - 3.0 + noise)
        };
        let samples: Vec<(Point, f64)> = (0..1500).map(|_| sample(&mut stream)).collect();
        let fitted = Difficulty::fit(&samples, &samples[..300]).unwrap();
        for (at, _) in &samples[..20] {
            let found = fitted.place(at).median.ln();
            let expected = 0.5 * at[0] - 0.2 * at[1] * at[2] - 3.0;
            assert!((found - expected).abs() < 0.12, "{found} {expected}");
        }
    }
}
