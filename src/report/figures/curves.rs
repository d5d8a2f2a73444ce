//! How training went, epoch by epoch.

use std::path::Path;

use super::axes::{Axis, line, panel};
use super::canvas::{FigureError, draw, palette};

/// One value per epoch of each curve.
#[derive(Clone, Debug)]
pub struct Training {
    /// Loss on the training samples.
    pub train_loss: Vec<f64>,
    /// Loss on the validation samples.
    pub validation_loss: Vec<f64>,
    /// Root mean square error on the validation samples, in mm.
    pub validation_rmse: Vec<f64>,
}

/// Draws the losses and the validation error over the epochs.
///
/// # Errors
/// When the curves are empty or differ in length, or the file cannot be written.
pub fn draw_training(path: &Path, data: &Training) -> Result<(), FigureError> {
    let epochs = data.train_loss.len();
    if epochs == 0 || data.validation_loss.len() != epochs || data.validation_rmse.len() != epochs {
        return Err(FigureError::Data(
            "training curves need one value per epoch each".into(),
        ));
    }
    draw(path, (1400, 620), |sheet| {
        let halves = sheet.split_evenly((1, 2));
        let x = || Axis::counting("Epoch", 0.5, epochs as f64 + 0.5);
        let y = Axis::logarithmic("Loss", data.train_loss.iter().chain(&data.validation_loss));
        let entries = [("training", palette::BLUE), ("validation", palette::VERMILLION)];
        let points = |values: &[f64], y: &Axis| {
            let placed = values.iter().enumerate();
            placed
                .filter(|(_, v)| y.shows(**v))
                .map(|(i, v)| ((i + 1) as f64, *v))
                .collect()
        };
        let mut left = panel(&halves[0], "Loss", &entries, &x(), &y)?;
        line(&mut left, palette::BLUE, points(&data.train_loss, &y))?;
        line(&mut left, palette::VERMILLION, points(&data.validation_loss, &y))?;

        let y = Axis::logarithmic("RMSE of a displacement component [mm]", &data.validation_rmse);
        let best = data.validation_rmse.iter().copied().fold(f64::INFINITY, f64::min);
        let title = format!("Validation error, {best:.4} mm at best");
        let mut right = panel(&halves[1], &title, &entries[1..], &x(), &y)?;
        line(&mut right, palette::VERMILLION, points(&data.validation_rmse, &y))
    })
}
