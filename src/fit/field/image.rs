//! The displacements of one image.

use crate::curve::FitError;
use crate::field::motion::Motion;
use crate::field::statistics::ImageResult;

/// Displacements measured at points of one image. Rows with NaN, which correlation leaves where it fails, are dropped.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldImage {
    name: String,
    points: Vec<[f64; 2]>,
    measured: Vec<[f64; 2]>,
    sigma: Option<Vec<f64>>,
    rows: Vec<usize>,
    dropped: usize,
}

impl FieldImage {
    /// Creates an image from points X and displacements u in mm, and the standard deviations of each component in mm;
    /// `None` if they are not known, and equal at all points.
    ///
    /// # Errors
    /// When the columns have different lengths, a number is infinite, a standard deviation is not positive, or no row
    /// is left.
    pub fn new(
        name: impl Into<String>,
        points: &[[f64; 2]],
        measured: &[[f64; 2]],
        sigma: Option<&[f64]>,
    ) -> Result<Self, FitError> {
        let name = name.into();
        let mut columns = vec![(measured.len(), "displacements")];
        columns.extend(sigma.map(|sigma| (sigma.len(), "standard deviations")));
        if let Some(second) = columns.into_iter().find(|(count, _)| *count != points.len()) {
            let first = (points.len(), "points");
            return Err(FitError::Lengths {
                curve: name,
                first,
                second,
            });
        }
        let mut image = Self {
            name,
            points: Vec::new(),
            measured: Vec::new(),
            sigma: sigma.map(|_| Vec::new()),
            rows: Vec::new(),
            dropped: 0,
        };
        for (at, (point, moved)) in points.iter().zip(measured).enumerate() {
            image.push(at + 1, *point, *moved, sigma.map(|sigma| sigma[at]))?;
        }
        if image.points.is_empty() {
            return Err(FitError::NoPoints { set: image.name });
        }
        Ok(image)
    }

    /// Adds a row unless it has NaN.
    fn push(&mut self, row: usize, point: [f64; 2], moved: [f64; 2], sigma: Option<f64>) -> Result<(), FitError> {
        let numbers = || point.into_iter().chain(moved).chain(sigma);
        if numbers().any(f64::is_nan) {
            self.dropped += 1;
            return Ok(());
        }
        if numbers().any(f64::is_infinite) {
            let (curve, column) = (self.name.clone(), "point, displacement or standard deviation");
            return Err(FitError::NotFinite { curve, row, column });
        }
        if let Some(value) = sigma.filter(|sigma| *sigma <= 0.0) {
            let (set, column) = (self.name.clone(), "standard deviation");
            return Err(FitError::NotPositive {
                set,
                row,
                column,
                value,
            });
        }
        self.points.push(point);
        self.measured.push(moved);
        self.rows.push(row);
        if let (Some(all), Some(sigma)) = (&mut self.sigma, sigma) {
            all.push(sigma);
        }
        Ok(())
    }

    /// Returns the name, such as the file.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the points X in mm that are left: simulations are needed there.
    #[must_use]
    pub fn points(&self) -> &[[f64; 2]] {
        &self.points
    }

    /// Returns the measured displacements in mm.
    #[must_use]
    pub fn measured(&self) -> &[[f64; 2]] {
        &self.measured
    }

    /// Returns the standard deviations in mm, if they are stated.
    #[must_use]
    pub fn sigma(&self) -> Option<&[f64]> {
        self.sigma.as_deref()
    }

    /// Returns the row of each point, counted from 1.
    #[must_use]
    pub fn rows(&self) -> &[usize] {
        &self.rows
    }

    /// Returns the number of rows that were dropped.
    #[must_use]
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// Returns the standard deviation at a point, or 1 if it is not stated.
    pub(crate) fn scale(&self, at: usize) -> f64 {
        self.sigma.as_ref().map_or(1.0, |sigma| sigma[at])
    }

    /// Compares simulated displacements in mm at [`Self::points`] with the measured ones. `parameters` of the
    /// simulation were fitted to them; a rigid motion counts by itself.
    ///
    /// # Errors
    /// When there is another number of displacements, or one is not finite.
    pub fn compare(&self, simulated: &[[f64; 2]], motion: Motion, parameters: usize) -> Result<ImageResult, FitError> {
        if simulated.len() != self.points.len() {
            return Err(FitError::SimulationCount {
                set: self.name.clone(),
                what: "displacements",
                found: simulated.len(),
                expected: self.points.len(),
            });
        }
        if let Some(at) = simulated.iter().position(|u| !u.iter().all(|u| u.is_finite())) {
            return Err(FitError::NotFinite {
                curve: self.name.clone(),
                row: self.rows[at],
                column: "simulated displacement",
            });
        }
        Ok(ImageResult::new(self, simulated, motion, parameters))
    }
}
