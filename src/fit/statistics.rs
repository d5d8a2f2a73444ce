//! What a fit says about its parameters: information criteria, covariance, and the directions that data determine.

use crate::least_squares::Evaluation;
use deaflow_linalg::{Mat, eigen};
use std::f64::consts::{FRAC_PI_2, PI};

/// The factor of the standard error in an interval of 95 % where σ is known.
pub(crate) const NORMAL_95: f64 = 1.959_963_984_540_054;
/// A singular value below this, relative to the largest, is zero.
const NULL: f64 = 1e-6;
/// A part in a direction below this is rounding.
const NEGLIGIBLE_PART: f64 = 1e-3;

/// Information criteria; smaller is better. Only differences between laws count: where σ is not stated, the numbers
/// depend on the unit of the residuals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Information {
    /// Akaike's criterion, corrected for few points (Hurvich and Tsai, Biometrika 76 (1989) 297); infinite with too
    /// few.
    pub aicc: f64,
    /// The Bayesian criterion (Schwarz, Ann. Statist. 6 (1978) 461).
    pub bic: f64,
}

impl Information {
    /// Returns the criteria: χ² + penalty where σ is stated, else n ln(rss/n) + penalty with σ as one more parameter.
    #[must_use]
    pub fn new(stated: bool, sum_of_squares: f64, points: usize, parameters: usize) -> Self {
        let n = points as f64;
        let k = (parameters + usize::from(!stated)) as f64;
        let misfit = if stated {
            sum_of_squares
        } else {
            n * (sum_of_squares / n).ln()
        };
        let correction = if n - k > 1.0 {
            2.0 * k * (k + 1.0) / (n - k - 1.0)
        } else {
            f64::INFINITY
        };
        Self {
            aicc: misfit + 2.0 * k + correction,
            bic: misfit + k * n.ln(),
        }
    }
}

/// Returns the t within which Student's distribution with ν degrees of freedom lies with a probability, on both sides;
/// infinite at ν = 0.
///
/// The probability is a finite sum in θ = atan(t/√ν) (Abramowitz and Stegun, 26.7.3 and 26.7.4).
#[must_use]
pub fn student_t(probability: f64, dof: usize) -> f64 {
    if dof == 0 {
        return f64::INFINITY;
    }
    let (mut low, mut high) = (0.0, FRAC_PI_2);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if student_probability(middle, dof) < probability {
            low = middle;
        } else {
            high = middle;
        }
    }
    f64::tan(0.5 * (low + high)) * (dof as f64).sqrt()
}

/// Returns the probability of |t| ≤ √ν tan θ.
fn student_probability(theta: f64, dof: usize) -> f64 {
    let (sine, cosine) = theta.sin_cos();
    let odd = dof % 2 == 1;
    let mut term = if odd { cosine } else { 1.0 };
    let mut sum = 0.0;
    let mut next = if odd { 3 } else { 2 };
    while next <= dof {
        sum += term;
        let n = next as f64;
        term *= cosine * cosine * (n - 1.0) / n;
        next += 2;
    }
    if odd {
        2.0 / PI * (theta + sine * sum)
    } else {
        sine * sum
    }
}

/// A combination of parameters, and how well the data determine it.
#[derive(Clone, Debug, PartialEq)]
pub struct Direction {
    /// The combination as a product of powers, such as `shear_modulus · jm^-0.35`.
    pub name: String,
    /// The standard error of its logarithm; infinite if the data do not depend on it.
    pub standard_error: f64,
    /// Whether the data determine it: its standard error is at most 1.
    pub determined: bool,
}

/// Standard errors and directions.
#[derive(Clone, Debug)]
pub struct Uncertainty {
    /// The standard error of each coordinate; `None` if a part of it lies in a direction that the data do not
    /// determine, or if it was not free.
    pub standard_errors: Vec<Option<f64>>,
    /// The covariance of the coordinates, without directions on which the data do not depend.
    pub covariance: Mat<f64>,
    /// The directions, the least determined first.
    pub directions: Vec<Direction>,
}

impl Uncertainty {
    /// Returns the uncertainty from the singular values of J/`sigma`, with one column for each of the `free`
    /// coordinates in the `units` of a relative change. The singular values are the roots of the eigenvalues of JᵀJ;
    /// that loses half of the digits, which the threshold of zero allows.
    ///
    /// With `correlated` = JᵀRJ, where R is the correlation of the noise, the covariance is σ²(JᵀJ)⁻¹JᵀRJ(JᵀJ)⁻¹.
    #[must_use]
    pub fn new(
        evaluation: &Evaluation,
        sigma: f64,
        names: &[String],
        units: &[f64],
        free: &[usize],
        correlated: Option<&Mat<f64>>,
    ) -> Option<Self> {
        let count = units.len();
        let gram = evaluation.gram();
        let scaled = Mat::from_fn(free.len(), free.len(), |a, b| {
            gram[(free[a], free[b])] * units[free[a]] * units[free[b]] / (sigma * sigma)
        });
        let decomposed = eigen(&scaled)?;
        let largest = decomposed.values.last().copied().unwrap_or(0.0);
        let part = |a: usize, k: usize| decomposed.vectors[(a, k)];
        let null: Vec<bool> = decomposed.values.iter().map(|e| *e <= NULL * NULL * largest).collect();
        let known: Vec<usize> = (0..free.len()).filter(|&k| !null[k]).collect();
        // The covariance of the directions k and l.
        let between = correlated.map(|correlated| {
            Mat::from_fn(free.len(), free.len(), |k, l| {
                let unit = |a: usize| units[free[a]];
                let entry =
                    |a: usize, b: usize| part(a, k) * unit(a) * correlated[(free[a], free[b])] * unit(b) * part(b, l);
                let pairs = (0..free.len()).flat_map(|a| (0..free.len()).map(move |b| (a, b)));
                let sum: f64 = pairs.map(|(a, b)| entry(a, b)).sum();
                sum / (sigma * sigma * decomposed.values[k] * decomposed.values[l])
            })
        });
        let covariance = Mat::from_fn(count, count, |i, j| {
            let [a, b] = [i, j].map(|i| free.iter().position(|f| *f == i));
            let (Some(a), Some(b)) = (a, b) else { return 0.0 };
            let sum: f64 = match &between {
                None => known
                    .iter()
                    .map(|&k| part(a, k) * part(b, k) / decomposed.values[k])
                    .sum(),
                Some(between) => {
                    let pairs = known.iter().flat_map(|&k| known.iter().map(move |&l| (k, l)));
                    pairs.map(|(k, l)| part(a, k) * between[(k, l)] * part(b, l)).sum()
                }
            };
            units[i] * units[j] * sum
        });
        let standard_error = |i: usize| {
            let a = free.iter().position(|f| *f == i)?;
            let hidden = (0..free.len()).any(|k| null[k] && part(a, k).abs() > NEGLIGIBLE_PART);
            (!hidden).then(|| covariance[(i, i)].sqrt())
        };
        let directions = (0..free.len()).map(|k| {
            let parts: Vec<f64> = (0..free.len()).map(|a| part(a, k)).collect();
            let names: Vec<&str> = free.iter().map(|&i| names[i].as_str()).collect();
            let error = match &between {
                _ if null[k] => f64::INFINITY,
                None => decomposed.values[k].powf(-0.5),
                Some(between) => between[(k, k)].sqrt(),
            };
            Direction {
                name: product_of_powers(&names, &parts),
                standard_error: error,
                determined: error <= 1.0,
            }
        });
        Some(Self {
            standard_errors: (0..count).map(standard_error).collect(),
            directions: directions.collect(),
            covariance,
        })
    }
}

/// Writes a direction, scaled so that the largest power is 1; powers below 0.05 are left out.
fn product_of_powers(names: &[&str], parts: &[f64]) -> String {
    let largest = parts
        .iter()
        .copied()
        .fold(0.0, |a: f64, b| if b.abs() > a.abs() { b } else { a });
    let factors = names.iter().zip(parts).filter_map(|(name, part)| {
        let power = part / largest;
        if power.abs() < 0.05 {
            None
        } else if (power - 1.0).abs() < 5e-3 {
            Some((*name).to_owned())
        } else {
            Some(format!("{name}^{power:.2}"))
        }
    });
    factors.collect::<Vec<_>>().join(" · ")
}

#[cfg(test)]
mod tests {
    use super::{Information, Uncertainty, student_t};
    use crate::least_squares::Evaluation;
    use deaflow_linalg::Mat;

    /// From tables of the distribution; ν = 1 is tan(0.475 π), and ν → ∞ the normal distribution.
    #[test]
    fn quantiles_of_student() {
        let known = [
            (1, 12.706_204_736),
            (2, 4.302_652_730),
            (3, 3.182_446_305),
            (10, 2.228_138_852),
            (51, 2.007_583_770),
            (1_000_000, 1.959_966_4),
        ];
        for (dof, t) in known {
            assert!(
                (student_t(0.95, dof) / t - 1.0).abs() < 1e-7,
                "{dof}: {}",
                student_t(0.95, dof)
            );
        }
        assert_eq!(student_t(0.95, 0), f64::INFINITY);
    }

    #[test]
    fn few_points_have_no_corrected_criterion() {
        assert_eq!(Information::new(true, 1.0, 3, 2).aicc, f64::INFINITY);
    }

    /// Only the product of the first two parameters matters.
    #[test]
    fn a_product_is_determined_where_its_factors_are_not() {
        let evaluation = Evaluation {
            residual: vec![0.0; 3],
            jacobian: Mat::from_fn(3, 3, |row, column| {
                [[10.0, 10.0, 0.0], [20.0, 20.0, 0.0], [0.0, 0.0, 5.0]][row][column]
            }),
        };
        let names = ["a", "b", "c"].map(String::from);
        let known = Uncertainty::new(&evaluation, 1.0, &names, &[1.0; 3], &[0, 1, 2], None).unwrap();
        assert_eq!(known.standard_errors[..2], [None, None]);
        assert!((known.standard_errors[2].unwrap() - 0.2).abs() < 1e-14);
        assert!(
            known.directions.iter().any(|d| d.determined && d.name == "a · b"),
            "{known:?}"
        );
        let lost: Vec<_> = known.directions.iter().filter(|d| !d.determined).collect();
        assert!(lost.len() == 1 && lost[0].standard_error.is_infinite(), "{lost:?}");
    }
}
