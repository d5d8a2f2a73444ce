//! Images of displacements with a model of the caller.

use crate::curve::FitError;
use crate::elastomer::{Need, Number, Response};
use crate::field::FieldImage;
use crate::field::correlation::{Correlation, correlated_gram, length};
use crate::field::motion::{Motion, Rigid, nuisance};
use crate::field::statistics::{FieldStatistics, ImageResult, fitted_numbers};
use crate::simulation::{Simulated, Simulation, Simulator};
use deaflow_linalg::Mat;

/// Displacements at points of one or several images, and their simulation.
#[derive(Clone)]
pub struct FieldData<'a> {
    /// The name of the set.
    pub name: String,
    /// The images, such as those at several voltages.
    pub images: Vec<FieldImage>,
    /// Whether each image may have moved as a whole.
    pub motion: Motion,
    /// Whether the noise of neighbouring points is correlated.
    pub correlation: Correlation,
    /// The model. Its numbers are ux and uy in mm at each of [`FieldImage::points`] in turn, of all images one after
    /// the other.
    pub simulation: Simulation<'a>,
}

/// Images beside their simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldResult {
    /// The images.
    pub images: Vec<ImageResult>,
    /// The statistics of all of them together.
    pub statistics: FieldStatistics,
    /// The length ℓ of the correlation of the noise in mm; `None` if it is taken as independent.
    pub correlation_length_mm: Option<f64>,
}

/// The effect of noise that may be correlated.
pub(crate) struct CorrelatedNoise {
    /// JᵀRJ.
    pub gram: Mat<f64>,
    /// The trace of R in the directions of the motions.
    pub motion: f64,
    /// ℓ; `None` if the noise is independent.
    pub length: Option<f64>,
}

/// Images that have been checked.
pub(crate) struct FieldModel<'a> {
    data: &'a FieldData<'a>,
    simulator: Simulator<'a>,
    /// The orthonormal derivatives with respect to the motion of each image.
    nuisance: Vec<Vec<Vec<f64>>>,
}

impl<'a> FieldModel<'a> {
    /// Checks the images.
    ///
    /// # Errors
    /// When there are none, some state standard deviations and others do not, or a length is not positive.
    pub fn new(data: &'a FieldData<'a>, is_free: &dyn Fn(&str) -> bool) -> Result<Self, FitError> {
        let set = || data.name.clone();
        let Some(first) = data.images.first() else {
            return Err(FitError::NoPoints { set: set() });
        };
        let stated = first.sigma().is_some();
        if data.images.iter().any(|image| image.sigma().is_some() != stated) {
            return Err(FitError::MixedImages { set: set() });
        }
        let (what, value) = match data.correlation {
            Correlation::Independent => ("", 1.0),
            Correlation::Estimated { within_mm } => ("distance of correlated points", within_mm),
            Correlation::Known { length_mm } => ("length of correlation", length_mm),
        };
        if !(value.is_finite() && value > 0.0) {
            return Err(FitError::Setting {
                set: set(),
                what,
                value,
            });
        }
        let numbers = data.images.iter().map(|image| 2 * image.points().len()).sum();
        Ok(Self {
            simulator: Simulator::new(&data.name, &data.simulation, numbers, is_free),
            nuisance: data.images.iter().map(|image| nuisance(image, data.motion)).collect(),
            data,
        })
    }

    /// Returns whether the standard deviations are stated.
    pub fn stated(&self) -> bool {
        self.data.images.iter().all(|image| image.sigma().is_some())
    }

    /// Returns the number of components of all displacements.
    pub fn count(&self) -> usize {
        self.data.images.iter().map(|image| 2 * image.points().len()).sum()
    }

    /// Returns how many numbers the motions fit.
    pub fn motions(&self) -> usize {
        fitted_numbers(self.data.motion) * self.data.images.len()
    }

    /// Returns Σ|u|²/σ² of the measured displacements.
    pub fn squares(&self) -> f64 {
        let of = |image: &FieldImage| {
            let numbers = image.measured().iter().enumerate();
            numbers
                .map(|(at, u)| (u[0] * u[0] + u[1] * u[1]) / image.scale(at).powi(2))
                .sum::<f64>()
        };
        self.data.images.iter().map(of).sum()
    }

    /// Returns the range of the numbers of each image.
    fn ranges(&self) -> Vec<std::ops::Range<usize>> {
        let mut end = 0;
        let range = |image: &FieldImage| {
            let start = end;
            end += 2 * image.points().len();
            start..end
        };
        self.data.images.iter().map(range).collect()
    }

    /// Returns the residuals (model − data)/σ after the motions that fit best, and their derivatives with the motions
    /// projected out: J − QQᵀJ with the orthonormal derivatives Q with respect to the motions. So JᵀJ is the Schur
    /// complement of the motions, and Jᵀr the gradient.
    fn residuals(&self, simulated: &Simulated) -> Vec<Number> {
        let images = self.data.images.iter().zip(&self.nuisance).zip(self.ranges());
        images
            .flat_map(|((image, nuisance), range)| self.of_image(image, nuisance, simulated, range.start))
            .collect()
    }

    fn of_image(&self, image: &FieldImage, nuisance: &[Vec<f64>], simulated: &Simulated, first: usize) -> Vec<Number> {
        let count = image.points().len();
        let pair = |numbers: &[f64], at: usize| [numbers[first + 2 * at], numbers[first + 2 * at + 1]];
        let u: Vec<[f64; 2]> = (0..count).map(|at| pair(&simulated.values, at)).collect();
        let rigid = Rigid::of(image, &u, self.data.motion);
        let residual = (0..count).flat_map(|at| {
            let (moved, measured) = (rigid.displacement(image.points()[at], u[at]), image.measured()[at]);
            [0, 1].map(|c| (moved[c] - measured[c]) / image.scale(at))
        });
        let columns: Vec<Vec<f64>> = simulated
            .by_parameter
            .iter()
            .map(|column| {
                let turned =
                    (0..count).flat_map(|at| rigid.turn(pair(column, at)).map(|number| number / image.scale(at)));
                without(turned.collect(), nuisance)
            })
            .collect();
        let of = |(row, residual): (usize, f64)| (residual, columns.iter().map(|column| column[row]).collect());
        residual.enumerate().map(of).collect()
    }

    /// Returns the effect of correlated noise for the residuals and derivatives of this set; `None` if there is none.
    pub fn noise(&self, residual: &[f64], jacobian: &Mat<f64>, first_row: usize) -> Option<CorrelatedNoise> {
        let ranges = self.ranges();
        let pairs = |range: &std::ops::Range<usize>| -> Vec<[f64; 2]> {
            residual[range.clone()]
                .chunks_exact(2)
                .map(|pair| [pair[0], pair[1]])
                .collect()
        };
        let length = match self.data.correlation {
            Correlation::Independent => return None,
            Correlation::Known { length_mm } => length_mm,
            Correlation::Estimated { within_mm } => {
                let images = self.data.images.iter().zip(&ranges);
                let images: Vec<_> = images.map(|(image, range)| (image.points(), pairs(range))).collect();
                length(&images, within_mm)?
            }
        };
        let count = jacobian.ncols();
        let mut noise = CorrelatedNoise {
            gram: Mat::zeros(count, count),
            motion: 0.0,
            length: Some(length),
        };
        for ((image, nuisance), range) in self.data.images.iter().zip(&self.nuisance).zip(ranges) {
            let numbers: Vec<Vec<f64>> = range
                .clone()
                .map(|row| {
                    let own = (0..count).map(|i| jacobian[(first_row + row, i)]);
                    own.chain(nuisance.iter().map(|column| column[row - range.start]))
                        .collect()
                })
                .collect();
            let gram = correlated_gram(image.points(), &numbers, count + nuisance.len(), length);
            noise.gram = Mat::from_fn(count, count, |i, j| noise.gram[(i, j)] + gram[(i, j)]);
            noise.motion += (0..nuisance.len()).map(|q| gram[(count + q, count + q)]).sum::<f64>();
        }
        Some(noise)
    }

    /// Returns the images beside their simulation.
    pub fn result(&self, values: &[f64], parameters: usize, length: Option<f64>) -> Option<FieldResult> {
        let simulated = self.simulator.simulate(values)?.values;
        let images = self.data.images.iter().zip(self.ranges());
        let result = |(image, range): (&FieldImage, std::ops::Range<usize>)| {
            let u: Vec<[f64; 2]> = simulated[range]
                .chunks_exact(2)
                .map(|pair| [pair[0], pair[1]])
                .collect();
            ImageResult::new(image, &u, self.data.motion, parameters)
        };
        let images: Vec<ImageResult> = images.map(result).collect();
        let pairs = self.data.images.iter().zip(&images);
        let pairs: Vec<_> = pairs.map(|(image, result)| (image, &result.residual_mm)).collect();
        Some(FieldResult {
            statistics: FieldStatistics::new(&pairs, self.data.motion, parameters),
            images,
            correlation_length_mm: length,
        })
    }
}

impl Response for FieldModel<'_> {
    fn needs(&self) -> Vec<Need> {
        self.simulator.needs()
    }

    fn respond(&self, values: &[f64]) -> Option<Vec<Number>> {
        Some(self.residuals(&self.simulator.simulate(values)?))
    }

    fn failure(&self) -> Option<FitError> {
        self.simulator.failure()
    }
}

/// Returns a column less its parts along orthonormal ones.
fn without(mut column: Vec<f64>, basis: &[Vec<f64>]) -> Vec<f64> {
    for direction in basis {
        let part: f64 = direction.iter().zip(&column).map(|(a, b)| a * b).sum();
        column
            .iter_mut()
            .zip(direction)
            .for_each(|(number, by)| *number -= part * by);
    }
    column
}
