//! Measured beside simulated displacements.

use crate::field::FieldImage;
use crate::field::motion::{Motion, Rigid};
use crate::fit::Outlier;

/// Residuals beyond this many standard deviations may be outliers.
const OUTLIER: f64 = 4.0;

/// The statistics of residuals r = measured − simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldStatistics {
    /// The number n of points.
    pub points: usize,
    /// The mean of r in mm.
    pub mean_mm: [f64; 2],
    /// The root mean square of all 2n components in mm.
    pub rms_mm: f64,
    /// The largest |r| in mm.
    pub largest_mm: f64,
    /// The image and the row, counted from 1, of the largest.
    pub largest_at: (String, usize),
    /// R² = 1 − Σ|r|²/Σ|m − m̄|² with the measured m; not a number if all m are equal.
    pub r_squared: f64,
    /// Σ|r|²/σ², if σ is stated.
    pub chi2: Option<f64>,
    /// χ²/(2n − k) with k fitted numbers, three of which are the motion of each image that was fitted.
    pub chi2_per_dof: Option<f64>,
    /// Points whose |r|/σ is beyond 4 and beyond what one of twenty such fields with normal noise reaches. σ is the
    /// root mean square if it is not stated.
    pub outliers: Vec<Outlier>,
}

/// An image beside its simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct ImageResult {
    /// The name of the image.
    pub name: String,
    /// The rows that were dropped.
    pub dropped: usize,
    /// The rotation in rad about the origin of the points, from the simulated to the measured ones.
    pub rotation: f64,
    /// The translation in mm after the rotation.
    pub translation_mm: [f64; 2],
    /// The simulated displacements with this motion in mm, by point.
    pub simulated_mm: Vec<[f64; 2]>,
    /// Measured − simulated in mm, by point.
    pub residual_mm: Vec<[f64; 2]>,
    /// The statistics.
    pub statistics: FieldStatistics,
}

impl ImageResult {
    /// Compares simulated displacements, one for each point.
    pub(crate) fn new(image: &FieldImage, simulated: &[[f64; 2]], motion: Motion, parameters: usize) -> Self {
        let rigid = Rigid::of(image, simulated, motion);
        let moved = image.points().iter().zip(simulated);
        let moved: Vec<[f64; 2]> = moved.map(|(point, u)| rigid.displacement(*point, *u)).collect();
        let pairs = image.measured().iter().zip(&moved);
        let residual: Vec<[f64; 2]> = pairs.map(|(m, s)| [m[0] - s[0], m[1] - s[1]]).collect();
        let statistics = FieldStatistics::new(&[(image, &residual)], motion, parameters);
        Self {
            name: image.name().to_owned(),
            dropped: image.dropped(),
            rotation: rigid.rotation,
            translation_mm: rigid.translation,
            simulated_mm: moved,
            residual_mm: residual,
            statistics,
        }
    }
}

/// Returns how many numbers of each image a motion fits.
pub(crate) fn fitted_numbers(motion: Motion) -> usize {
    match motion {
        Motion::Fitted => 3,
        Motion::None => 0,
    }
}

impl FieldStatistics {
    /// Returns the statistics of images with their residuals.
    pub(crate) fn new<'a>(images: &[(&'a FieldImage, &'a Vec<[f64; 2]>)], motion: Motion, parameters: usize) -> Self {
        let all = || {
            let of = |&(image, residual): &(&'a FieldImage, &'a Vec<[f64; 2]>)| {
                residual.iter().enumerate().map(move |(at, r)| (image, at, *r))
            };
            images.iter().flat_map(of)
        };
        let points = all().count();
        let n = points as f64;
        let square = |[x, y]: [f64; 2]| x * x + y * y;
        let sum = all().fold([0.0; 2], |sum, (_, _, r)| [sum[0] + r[0], sum[1] + r[1]]);
        let measured = all().fold([0.0; 2], |sum, (image, at, _)| {
            let m = image.measured()[at];
            [sum[0] + m[0] / n, sum[1] + m[1] / n]
        });
        let squares: f64 = all().map(|(.., r)| square(r)).sum();
        let spread: f64 = all()
            .map(|(image, at, _)| {
                let m = image.measured()[at];
                square([m[0] - measured[0], m[1] - measured[1]])
            })
            .sum();
        let rms = (squares / (2.0 * n)).sqrt();
        let stated = images.iter().all(|(image, _)| image.sigma().is_some());
        let chi2: f64 = all().map(|(image, at, r)| square(r) / image.scale(at).powi(2)).sum();
        let fitted = parameters + fitted_numbers(motion) * images.len();
        let dof = (2 * points).saturating_sub(fitted);
        let worst = all().max_by(|a, b| square(a.2).total_cmp(&square(b.2)));
        let limit = OUTLIER.max((2.0 * (20.0 * n).ln()).sqrt());
        let far = all().filter_map(|(image, at, r)| {
            let sigma = if stated { image.scale(at) } else { rms };
            let deviations = square(r).sqrt() / sigma;
            (deviations > limit).then(|| Outlier {
                curve: image.name().to_owned(),
                row: image.rows()[at],
                deviations,
            })
        });
        Self {
            points,
            mean_mm: sum.map(|sum| sum / n),
            rms_mm: rms,
            largest_mm: worst.map_or(0.0, |(.., r)| square(r).sqrt()),
            largest_at: worst.map_or_else(Default::default, |(image, at, _)| {
                (image.name().to_owned(), image.rows()[at])
            }),
            r_squared: 1.0 - squares / spread,
            chi2: stated.then_some(chi2),
            chi2_per_dof: (stated && dof > 0).then(|| chi2 / dof as f64),
            outliers: far.collect(),
        }
    }
}
