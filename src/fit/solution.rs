//! The search for the parameters of a model, and what its minimum says about each of them.

use crate::curve::FitError;
use crate::least_squares::{Bounds, Evaluation, Minimum, minimise};
use crate::profile::profile;
use crate::statistics::{Direction, Information, NORMAL_95, Uncertainty, student_t};
use deaflow_linalg::Mat;

/// A standard error above this, relative to the parameter, needs the profile of the likelihood.
const WIDE: f64 = 0.1;
/// Searches agree if their sums of squares differ by less than this.
const SAME_MINIMUM: f64 = 1e-6;
/// No measurement is more exact than this, relative to the root mean square of the data.
const EXACT: f64 = 1e-5;

/// Which parameters get a profile of the likelihood.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Profiles {
    /// None.
    Never,
    /// Those that are not determined, or whose standard error is above a tenth.
    #[default]
    Wide,
    /// All that are not at a bound.
    All,
}

/// A fitted parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// The name in scenes.
    pub name: String,
    /// The value; moduli in Pa, times in s.
    pub value: f64,
    /// Whether the standard error is that of the logarithm, as of all positive parameters.
    pub logarithmic: bool,
    /// The standard error; `None` if the data do not determine the parameter, or it is at a bound.
    pub standard_error: Option<f64>,
    /// The interval of 95 % from the standard error.
    pub interval: Option<(f64, f64)>,
    /// The interval of 95 % from the profile of the likelihood; infinite where it is open.
    pub profile: Option<(f64, f64)>,
    /// Whether the parameter is at a bound.
    pub at_bound: bool,
}

/// The parameters of a model that agree best with data, and how well the data determine them.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// The parameters.
    pub parameters: Vec<Parameter>,
    /// The covariance of the parameters, of the logarithms where they are logarithmic.
    pub covariance: Mat<f64>,
    /// Combinations of parameters, the least determined first.
    pub directions: Vec<Direction>,
    /// Whether the standard deviations of the data are stated: then the sum of squares is χ².
    pub stated: bool,
    /// χ², or the sum of the squares of the residuals.
    pub sum_of_squares: f64,
    /// The number of points, without those at stretch 1; of fields, two for each point.
    pub points: usize,
    /// Points less parameters, and less the motions of images that are fitted with them.
    pub degrees_of_freedom: usize,
    /// The information criteria.
    pub information: Information,
    /// The steps of the search that found the minimum.
    pub iterations: usize,
    /// Whether that search converged.
    pub converged: bool,
    /// How many searches were made, and how many found the minimum.
    pub searches: (usize, usize),
}

/// How a parameter enters the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Scale {
    /// By its logarithm: a positive parameter.
    Logarithm,
    /// As it is: an exponent, of which a change by 1 is a relative change of the stress.
    Exponent,
    /// As it is: a modulus of any sign.
    Modulus,
    /// As it is: a parameter of which a change by a unit counts as much as a relative change by 1 of a positive one.
    Linear {
        /// The unit.
        unit: f64,
    },
}

/// A parameter as the search sees it.
#[derive(Clone, Debug)]
pub(crate) struct Coordinate {
    pub name: String,
    pub scale: Scale,
    /// The bounds of the parameter.
    pub limits: (f64, f64),
}

impl Coordinate {
    pub fn coordinate(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Logarithm => value.ln(),
            Scale::Exponent | Scale::Modulus | Scale::Linear { .. } => value,
        }
    }

    /// Returns the value at a coordinate, at a bound exactly that.
    pub fn value(&self, coordinate: f64) -> f64 {
        let limits = [self.limits.0, self.limits.1];
        match (
            self.scale,
            limits.into_iter().find(|limit| self.coordinate(*limit) == coordinate),
        ) {
            (_, Some(limit)) => limit,
            (Scale::Logarithm, None) => coordinate.exp(),
            (Scale::Exponent | Scale::Modulus | Scale::Linear { .. }, None) => coordinate,
        }
    }

    /// Returns the derivative of the value with respect to the coordinate.
    fn slope(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Logarithm => value,
            Scale::Exponent | Scale::Modulus | Scale::Linear { .. } => 1.0,
        }
    }
}

/// A model with parameters.
pub(crate) trait Model {
    /// Returns the parameters.
    fn coordinates(&self) -> &[Coordinate];

    /// Returns the residual of each point with its derivatives with respect to the values of the parameters; `None` if
    /// the model has no value at one of them.
    fn residuals(&self, values: &[f64]) -> Option<Vec<(f64, Vec<f64>)>>;

    /// Returns the sum of the squares of the data in units of the residuals.
    fn data(&self) -> f64;

    /// Returns whether the standard deviations of the data are stated.
    fn stated(&self) -> bool;

    /// Returns how many parameters precede the pairs whose order does not matter; they are sorted by their second
    /// number. `None` if there are no pairs.
    fn pairs_from(&self) -> Option<usize>;

    /// Returns how many numbers beside the parameters the model fits by itself; the derivatives have them projected
    /// out.
    fn nuisance(&self) -> usize {
        0
    }

    /// Returns the effect of correlated noise on residuals with these values and derivatives with respect to
    /// coordinates; `None` if the noise is independent.
    fn correlated(&self, _evaluation: &Evaluation) -> Option<Correlated> {
        None
    }
}

/// The effect of the correlation R of the noise.
#[derive(Clone, Debug)]
pub(crate) struct Correlated {
    /// JᵀRJ.
    pub gram: Mat<f64>,
    /// The trace of R in the directions of the numbers that the model fits by itself.
    pub nuisance: f64,
    /// The length of the correlation in each set of data.
    pub lengths: Vec<Option<f64>>,
}

/// Returns the residuals at coordinates.
fn evaluate(model: &dyn Model, q: &[f64]) -> Option<Evaluation> {
    let coordinates = model.coordinates();
    let values = values(coordinates, q);
    let rows = model.residuals(&values)?;
    Some(Evaluation {
        residual: rows.iter().map(|(residual, _)| *residual).collect(),
        jacobian: Mat::from_fn(rows.len(), q.len(), |row, i| {
            rows[row].1[i] * coordinates[i].slope(values[i])
        }),
    })
}

fn values(coordinates: &[Coordinate], q: &[f64]) -> Vec<f64> {
    coordinates.iter().zip(q).map(|(c, q)| c.value(*q)).collect()
}

/// The best minimum of several searches.
pub(crate) struct Solution<'a> {
    model: &'a dyn Model,
    bounds: Bounds,
    best: Minimum,
    searches: (usize, usize),
    correlated: Option<Correlated>,
}

impl<'a> Solution<'a> {
    /// Searches from each start; `None` if the model has a value at none of them.
    pub fn new(model: &'a dyn Model, starts: &[Vec<f64>]) -> Option<Self> {
        let coordinates = model.coordinates();
        let bounds = Bounds {
            lower: coordinates.iter().map(|c| c.coordinate(c.limits.0)).collect(),
            upper: coordinates.iter().map(|c| c.coordinate(c.limits.1)).collect(),
        };
        let residuals = |q: &[f64]| evaluate(model, q);
        let search = |start: &Vec<f64>| {
            let start: Vec<f64> = coordinates
                .iter()
                .zip(start)
                .map(|(c, value)| c.coordinate(*value))
                .collect();
            minimise(&residuals, &start, &bounds)
        };
        let minima: Vec<Minimum> = starts.iter().filter_map(search).collect();
        let mut best = minima
            .iter()
            .min_by(|a, b| a.sum_of_squares.total_cmp(&b.sum_of_squares))?
            .clone();
        let agrees = |m: &&Minimum| m.sum_of_squares <= best.sum_of_squares * (1.0 + SAME_MINIMUM);
        let searches = (minima.len(), minima.iter().filter(agrees).count());
        if let Some(first) = model.pairs_from() {
            let (before, pairs) = best.point.split_at(first);
            let mut pairs: Vec<&[f64]> = pairs.chunks_exact(2).collect();
            pairs.sort_by(|a, b| a[1].total_cmp(&b[1]));
            best.point = [before, &pairs.concat()].concat();
            best.evaluation = residuals(&best.point)?;
        }
        Some(Self {
            correlated: model.correlated(&best.evaluation),
            model,
            bounds,
            best,
            searches,
        })
    }

    /// Returns the better of two minima, with the searches for both.
    pub fn or(self, other: Self) -> Self {
        let ((made, found), (others, others_found)) = (self.searches, other.searches);
        let (one, two) = (self.best.sum_of_squares, other.best.sum_of_squares);
        let (better, found) = if two * (1.0 + SAME_MINIMUM) < one {
            (other, others_found)
        } else if one * (1.0 + SAME_MINIMUM) < two {
            (self, found)
        } else {
            (if other.converged() { other } else { self }, found + others_found)
        };
        Self {
            searches: (made + others, found),
            ..better
        }
    }

    /// Returns whether the search that found the minimum converged.
    pub fn converged(&self) -> bool {
        let estimated = self.best.sum_of_squares / self.degrees_of_freedom().max(1) as f64;
        let least = match self.model.stated() {
            true => 1.0,
            false => EXACT * EXACT * self.model.data() / self.best.evaluation.residual.len().max(1) as f64,
        };
        self.best.converged(f64::max(estimated, least))
    }

    /// Returns the values of the parameters.
    pub fn values(&self) -> Vec<f64> {
        values(self.model.coordinates(), &self.best.point)
    }

    /// Returns the residuals.
    pub fn residuals(&self) -> &[f64] {
        &self.best.evaluation.residual
    }

    /// Returns the length of the correlation of the noise in each set of data; empty if all noise is independent.
    pub fn correlation_lengths(&self) -> &[Option<f64>] {
        self.correlated.as_ref().map_or(&[], |correlated| &correlated.lengths)
    }

    /// Returns the parameters and their statistics.
    pub fn estimate(&self, profiles: Profiles) -> Estimate {
        let (points, count) = (self.best.evaluation.residual.len(), self.best.point.len());
        let (stated, sum_of_squares) = (self.model.stated(), self.best.sum_of_squares);
        let uncertainty = self.uncertainty(self.correlated.as_ref());
        Estimate {
            parameters: self.parameters(&uncertainty, profiles),
            covariance: uncertainty.covariance,
            directions: uncertainty.directions,
            stated,
            sum_of_squares,
            points,
            degrees_of_freedom: self.degrees_of_freedom(),
            information: Information::new(stated, sum_of_squares, points, count + self.model.nuisance()),
            iterations: self.best.iterations,
            converged: self.converged(),
            searches: self.searches,
        }
    }

    /// Returns the standard errors that independent noise would have.
    pub fn independent_errors(&self) -> Vec<Option<f64>> {
        self.uncertainty(None).standard_errors
    }

    fn degrees_of_freedom(&self) -> usize {
        let fitted = self.best.point.len() + self.model.nuisance();
        self.best.evaluation.residual.len().saturating_sub(fitted)
    }

    /// Returns the standard deviation of the residuals: 1 where that of the data is stated.
    pub fn spread(&self) -> f64 {
        if self.model.stated() {
            return 1.0;
        }
        let Some(correlated) = &self.correlated else {
            return (self.best.sum_of_squares / self.degrees_of_freedom() as f64).sqrt();
        };
        // The expected sum of squares is s²(n − tr PR), where P projects on all that is fitted.
        let (units, names) = (self.units(), vec![String::new(); self.best.point.len()]);
        let own = Some(&correlated.gram);
        let gram = self.best.evaluation.gram();
        let fitted = Uncertainty::new(&self.best.evaluation, 1.0, &names, &units, &self.free(), own).map_or(0.0, |u| {
            let pairs = (0..units.len()).flat_map(|i| (0..units.len()).map(move |j| (i, j)));
            pairs.map(|(i, j)| u.covariance[(i, j)] * gram[(j, i)]).sum()
        });
        let remaining = self.best.evaluation.residual.len() as f64 - fitted - correlated.nuisance;
        (self.best.sum_of_squares / remaining.max(0.0)).sqrt()
    }

    /// Returns the coordinates that are not at a bound.
    fn free(&self) -> Vec<usize> {
        let inside =
            |&i: &usize| self.best.point[i] > self.bounds.lower[i] && self.best.point[i] < self.bounds.upper[i];
        (0..self.best.point.len()).filter(inside).collect()
    }

    /// Returns the changes of the coordinates that are relative changes of the parameters. A modulus of any sign has no
    /// logarithm: its unit changes the stresses by as much as they are.
    fn units(&self) -> Vec<f64> {
        let jacobian = &self.best.evaluation.jacobian;
        let unit = |(i, coordinate): (usize, &Coordinate)| match coordinate.scale {
            Scale::Logarithm | Scale::Exponent => 1.0,
            Scale::Linear { unit } => unit,
            Scale::Modulus => {
                let column = (0..jacobian.nrows()).map(|row| jacobian[(row, i)].powi(2));
                (self.model.data() / column.sum::<f64>()).sqrt()
            }
        };
        self.model.coordinates().iter().enumerate().map(unit).collect()
    }

    /// Returns the standard errors and directions; without points to spare there are none.
    fn uncertainty(&self, correlated: Option<&Correlated>) -> Uncertainty {
        let (units, spread) = (self.units(), self.spread());
        let name = |(c, unit): (&Coordinate, &f64)| match c.scale {
            Scale::Logarithm => c.name.clone(),
            Scale::Exponent => format!("exp({})", c.name),
            Scale::Modulus => format!("exp({}/{unit:.3e} Pa)", c.name),
            Scale::Linear { .. } => format!("exp({}/{unit:.3e})", c.name),
        };
        let names: Vec<String> = self.model.coordinates().iter().zip(&units).map(name).collect();
        let known = spread.is_finite() && spread > 0.0;
        let (evaluation, gram) = (&self.best.evaluation, correlated.map(|correlated| &correlated.gram));
        let uncertainty = known.then(|| Uncertainty::new(evaluation, spread, &names, &units, &self.free(), gram));
        uncertainty.flatten().unwrap_or_else(|| Uncertainty {
            standard_errors: vec![None; units.len()],
            covariance: Mat::zeros(units.len(), units.len()),
            directions: Vec::new(),
        })
    }

    /// Returns the parameters with their intervals.
    fn parameters(&self, uncertainty: &Uncertainty, profiles: Profiles) -> Vec<Parameter> {
        let quantile = if self.model.stated() {
            NORMAL_95
        } else {
            student_t(0.95, self.degrees_of_freedom())
        };
        let (free, units) = (self.free(), self.units());
        let independent = match self.correlated {
            Some(_) => self.independent_errors(),
            None => uncertainty.standard_errors.clone(),
        };
        let parameter = |(i, coordinate): (usize, &Coordinate)| {
            let at = self.best.point[i];
            let standard_error = uncertainty.standard_errors[i];
            let range = |(low, high): (f64, f64)| (coordinate.value(low), coordinate.value(high));
            let wide = standard_error.is_none_or(|error| error > WIDE * units[i]);
            let wanted = match profiles {
                Profiles::Never => false,
                Profiles::Wide => wide,
                Profiles::All => true,
            };
            let is_free = free.contains(&i);
            let step = quantile * standard_error.unwrap_or(WIDE * units[i]).min(units[i]);
            // Correlated noise widens the likelihood as it does the standard error.
            let wider = match (standard_error, independent[i]) {
                (Some(error), Some(independent)) => error / independent,
                _ => 1.0,
            };
            let increase = (quantile * wider * self.spread()).powi(2);
            let profile = (wanted && is_free).then(|| self.profile(i, increase, step));
            Parameter {
                name: coordinate.name.clone(),
                value: coordinate.value(at),
                logarithmic: coordinate.scale == Scale::Logarithm,
                standard_error,
                interval: standard_error.map(|error| range((at - quantile * error, at + quantile * error))),
                profile: profile.flatten().map(range),
                at_bound: !is_free,
            }
        };
        self.model.coordinates().iter().enumerate().map(parameter).collect()
    }

    /// Returns the range of a coordinate within an increase of the sum of squares; `None` if that is not known.
    fn profile(&self, index: usize, increase: f64, first_step: f64) -> Option<(f64, f64)> {
        let residuals = |q: &[f64]| evaluate(self.model, q);
        let known = increase.is_finite() && increase > 0.0;
        known.then(|| profile(&residuals, &self.bounds, &self.best, index, increase, first_step))
    }
}

/// Returns the error of too few points.
///
/// # Errors
/// When there are fewer points than parameters.
pub(crate) fn check_points(points: usize, parameters: usize, law: &'static str) -> Result<(), FitError> {
    if points < parameters {
        return Err(FitError::TooFewPoints {
            points,
            parameters,
            law,
        });
    }
    Ok(())
}
