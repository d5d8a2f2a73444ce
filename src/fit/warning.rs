//! What in measured curves should be looked at although they can be fitted.

use crate::curve::{Curve, Points, Sigma};
use crate::fit::{LawModel, Options};
use crate::law::{Law, LawKind};
use crate::solution::Estimate;
use std::fmt;

/// A misfit that needs no explanation: χ² per degree of freedom, or the square of the root mean square relative to the
/// data where σ is not stated.
const STATED_MISFIT: f64 = 2.0;
const RELATIVE_MISFIT: f64 = 0.02 * 0.02;
/// A curve is suspected to be of true stress if division by the stretch lowers the sum of squares to this share or
/// less.
const LOWER: f64 = 0.1;
/// Curves up to this stretch are not suspected: both stresses differ by too little.
const SUSPECTED_FROM: f64 = 1.5;
/// The ratio of data and model grows as a power of the stretch that is 1 to this, if the data are true stresses.
const POWER: f64 = 0.15;

/// A warning about data.
#[derive(Clone, Debug, PartialEq)]
pub enum Warning {
    /// The curve seems to be one of true stress: divided by the stretch it agrees with the law, so that the ratio of
    /// data and law grows as a power of the stretch near 1.
    TrueStress {
        /// The name of the curve.
        curve: String,
        /// The power.
        power: f64,
        /// By which factor the sum of squares falls.
        gain: f64,
    },
    /// Rows in compression, where friction at the plates of a machine makes a specimen bulge.
    Compression {
        /// The name of the curve.
        curve: String,
        /// The rows, counted from 1.
        rows: Vec<usize>,
    },
    /// All rows have one stretch: they determine one number.
    OneStretch {
        /// The name of the curve.
        curve: String,
        /// The stretch.
        stretch: f64,
        /// The number of rows.
        rows: usize,
    },
    /// Rows of an image were dropped because they contain NaN.
    Dropped {
        /// The name of the image.
        image: String,
        /// The number of rows.
        rows: usize,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TrueStress { curve, power, .. } => write!(
                f,
                "{curve}: the stresses seem to be true ones, not nominal ones: data/law grows as stretch^{power:.2}"
            ),
            Self::Compression { curve, rows } => {
                let plural = if rows.len() == 1 { "row is" } else { "rows are" };
                let first = rows.first().copied().unwrap_or_default();
                write!(
                    f,
                    "{curve}: {} {plural} in compression, the first is row {first}",
                    rows.len()
                )
            }
            Self::OneStretch { curve, stretch, rows } => {
                write!(
                    f,
                    "{curve}: all {rows} rows have the stretch {stretch}, and determine one number"
                )
            }
            Self::Dropped { image, rows: 1 } => write!(f, "{image}: 1 row with NaN was dropped"),
            Self::Dropped { image, rows } => write!(f, "{image}: {rows} rows with NaN were dropped"),
        }
    }
}

/// Returns the warnings about curves to which a law was fitted.
pub(crate) fn warnings(curves: &[Curve], kind: LawKind, options: &Options, estimate: &Estimate) -> Vec<Warning> {
    let mut all: Vec<Warning> = curves.iter().flat_map(curve_warnings).collect();
    all.extend(true_stresses(curves, kind, options, estimate));
    all
}

/// Returns the warnings about the stretches of a curve.
pub(crate) fn curve_warnings(curve: &Curve) -> Vec<Warning> {
    let rows = || curve.stretch.iter().enumerate();
    let compressed: Vec<usize> = rows().filter(|(_, l)| **l < 1.0).map(|(at, _)| at + 1).collect();
    let mut counted = rows().map(|(_, l)| *l).filter(|l| *l != 1.0);
    let mut warnings = Vec::new();
    if !compressed.is_empty() {
        let (curve, rows) = (curve.name.clone(), compressed);
        warnings.push(Warning::Compression { curve, rows });
    }
    if let Some(stretch) = counted.next() {
        let others: Vec<f64> = counted.collect();
        if !others.is_empty() && others.iter().all(|l| *l == stretch) {
            let (curve, rows) = (curve.name.clone(), others.len() + 1);
            warnings.push(Warning::OneStretch { curve, stretch, rows });
        }
    }
    warnings
}

/// Returns the curves that agree far better with the law when they are divided by the stretch: one of them, or all.
fn true_stresses(curves: &[Curve], kind: LawKind, options: &Options, estimate: &Estimate) -> Vec<Warning> {
    if !is_misfit(curves, estimate) {
        return Vec::new();
    }
    let reaches = |curve: &Curve| curve.stretch.iter().any(|l| *l >= SUSPECTED_FROM);
    let suspected: Vec<usize> = (0..curves.len()).filter(|&i| reaches(&curves[i])).collect();
    let alone = suspected.iter().map(|&i| vec![i]);
    let together = (suspected.len() > 1).then(|| suspected.clone());
    let tried = alone.chain(together).filter_map(|chosen| {
        let (law, sum) = refitted(curves, &chosen, kind, options)?;
        Some((chosen, law, sum))
    });
    let best = tried.min_by(|a, b| a.2.total_cmp(&b.2));
    let Some((chosen, law, sum)) = best.filter(|(.., sum)| *sum <= LOWER * estimate.sum_of_squares) else {
        return Vec::new();
    };
    let gain = estimate.sum_of_squares / sum;
    let powers = chosen.iter().map(|&i| (&curves[i].name, power(&curves[i], &law)));
    let grows = powers.filter_map(|(name, power)| power.map(|power| (name, power)));
    grows
        .filter(|(_, power)| (power - 1.0).abs() <= POWER)
        .map(|(curve, power)| Warning::TrueStress {
            curve: curve.clone(),
            power,
            gain,
        })
        .collect()
}

/// Returns whether a fit is worse than noise explains.
fn is_misfit(curves: &[Curve], estimate: &Estimate) -> bool {
    let (sum, points) = (estimate.sum_of_squares, estimate.points as f64);
    match curves.first().map(|curve| &curve.sigma) {
        Some(Sigma::Stated(_) | Sigma::StatedFraction(_)) => sum > STATED_MISFIT * estimate.degrees_of_freedom as f64,
        Some(Sigma::UnstatedRelative) => sum > RELATIVE_MISFIT * points,
        Some(Sigma::UnstatedAbsolute) => {
            let stresses = curves.iter().flat_map(|curve| &curve.stress_pa);
            sum > RELATIVE_MISFIT * stresses.map(|stress| stress * stress).sum::<f64>()
        }
        None => false,
    }
}

/// Returns the law that fits when some curves are divided by the stretch, and its sum of squares.
fn refitted(curves: &[Curve], divided: &[usize], kind: LawKind, options: &Options) -> Option<(Law, f64)> {
    let mut curves = curves.to_vec();
    for &i in divided {
        let curve = &mut curves[i];
        curve
            .stress_pa
            .iter_mut()
            .zip(&curve.stretch)
            .for_each(|(stress, l)| *stress /= l);
        if let Sigma::Stated(sigma) = &mut curve.sigma {
            sigma.iter_mut().zip(&curve.stretch).for_each(|(sigma, l)| *sigma /= l);
        }
    }
    let points = Points::new(&curves).ok()?;
    let model = LawModel::new(&points, kind, options).ok()?;
    let solution = model.solve().ok()?;
    let sum = solution.residuals().iter().map(|r| r * r).sum();
    Some((model.law(&solution).ok()?, sum))
}

/// Returns the power of the stretch as which the ratio of data and law grows, by least squares in logarithms.
fn power(curve: &Curve, law: &Law) -> Option<f64> {
    let rows = curve.stretch.iter().zip(&curve.stress_pa).filter(|(l, _)| **l > 1.0);
    let pairs = rows.filter_map(|(l, stress)| {
        let ratio = stress / law.nominal_stress(curve.test, *l)?;
        (ratio > 0.0).then(|| (l.ln(), ratio.ln()))
    });
    let pairs: Vec<(f64, f64)> = pairs.collect();
    let count = pairs.len() as f64;
    let mean = pairs
        .iter()
        .fold((0.0, 0.0), |sum, (x, y)| (sum.0 + x / count, sum.1 + y / count));
    let [xx, xy] = pairs.iter().fold([0.0; 2], |[xx, xy], (x, y)| {
        let (x, y) = (x - mean.0, y - mean.1);
        [xx + x * x, xy + x * y]
    });
    (xx > 0.0).then(|| xy / xx)
}
