//! A trained model, and its predictions.

use std::path::PathBuf;

use super::arrays::{Found, Groups, Keep, patterns};
use super::error::raised;
use super::scene::Unseen;
use super::work::run;
use deaflow::cli::{self, CliError};
use deaflow::scene::Scene as Device;
use pyo3::prelude::*;

/// A model that has been read.
#[pyclass(frozen, module = "deaflow._deaflow")]
pub struct Model {
    model: cli::Model,
}

#[pymethods]
impl Model {
    /// Reads a model as `deaflow predict` does.
    #[staticmethod]
    fn read(py: Python<'_>, name: &str, calibration: Option<String>, store: Option<PathBuf>) -> PyResult<Self> {
        let model = cli::Model::read(name, calibration, store);
        Ok(Self {
            model: model.map_err(|error| raised(py, &error))?,
        })
    }

    /// The scene that it was trained for, in YAML.
    #[getter]
    fn scene(&self) -> Option<&str> {
        self.model.scene()
    }

    /// The kind of the network.
    #[getter]
    fn network(&self) -> &str {
        self.model.network()
    }

    /// The numbers of rows and columns of cells.
    #[getter]
    fn shape(&self) -> (usize, usize) {
        let raster = self.model.form().raster;
        (raster.rows(), raster.columns())
    }

    /// Checks that it was trained for the scene of a text in YAML.
    fn check_scene(&self, py: Python<'_>, text: &str) -> PyResult<()> {
        let device = Device::from_text(text).map_err(CliError::from);
        let checked = device.and_then(|device| self.model.check_scene(&device));
        checked.map_err(|error| raised(py, &error))
    }

    /// Predicts the displacement of patterns; returns the arrays and attributes of the file of `deaflow predict`.
    fn predict<'py>(slf: &Bound<'py, Self>, groups: Groups<'py>, objectives: Vec<String>) -> PyResult<Found> {
        let py = slf.py();
        let patterns =
            patterns(slf.get().model.form(), &groups, None, Keep::Cut).map_err(|error| raised(py, &error))?;
        let of = slf.clone().unbind();
        let object = run(py, move || {
            let model = &of.get().model;
            let predictions = model.predict(&patterns, &objectives, &Unseen)?;
            Ok(model.content(&patterns, &predictions).object())
        })?;
        Ok(Found::new(object, Vec::new()))
    }
}
