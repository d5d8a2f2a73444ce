//! How training went, epoch by epoch.

use std::path::Path;

use plotters::prelude::*;

use super::axes::{Axis, Entry, line, panel};
use super::canvas::{Area, FigureError, draw, palette, px};

/// One value per epoch of each curve.
#[derive(Clone, Debug)]
pub struct Training {
    /// Loss on the training samples.
    pub train_loss: Vec<f64>,
    /// Loss on the validation samples.
    pub validation_loss: Vec<f64>,
    /// Root mean square error on the validation samples, in mm.
    pub validation_rmse: Vec<f64>,
    /// Learning rate at the end of each epoch.
    pub learning_rate: Vec<f64>,
    /// The epoch whose weights are kept, from 1.
    pub kept: u64,
}

/// A curve with its entry in the legend.
type Curve<'a> = (Entry<'a>, &'a [f64]);

/// What marks the kept epoch.
const KEPT: Entry<'static> = ("epoch that is kept", palette::GREY);

/// Draws the losses, the validation error and the learning rate over the epochs, all on logarithmic axes.
///
/// # Errors
/// When the curves are empty or differ in length, no epoch of theirs is kept, or the file cannot be written.
pub fn draw_training(path: &Path, data: &Training) -> Result<(), FigureError> {
    let epochs = data.train_loss.len();
    let others = [&data.validation_loss, &data.validation_rmse, &data.learning_rate];
    if epochs == 0 || others.iter().any(|curve| curve.len() != epochs) {
        return Err(FigureError::Data(
            "training curves need one value per epoch each".into(),
        ));
    }
    let kept = usize::try_from(data.kept).ok().and_then(|kept| kept.checked_sub(1));
    let Some(error) = kept.and_then(|kept| data.validation_rmse.get(kept)) else {
        return Err(FigureError::Data(format!("epoch {} is kept, of {epochs}", data.kept)));
    };
    draw(path, (2000, 620), |sheet| {
        let thirds = sheet.split_evenly((1, 3));
        let losses = [
            (("training", palette::BLUE), &data.train_loss[..]),
            (("validation", palette::VERMILLION), &data.validation_loss[..]),
        ];
        over_epochs(&thirds[0], "Loss", "Loss per sample", &losses, data.kept)?;
        let title = format!("Validation error, {error:.4} mm kept");
        let errors = [(("validation", palette::VERMILLION), &data.validation_rmse[..])];
        over_epochs(
            &thirds[1],
            &title,
            "RMSE of a displacement component [mm]",
            &errors,
            data.kept,
        )?;
        let rates = [(("at the end of the epoch", palette::GREEN), &data.learning_rate[..])];
        over_epochs(&thirds[2], "Learning rate", "Learning rate", &rates, data.kept)
    })
}

/// A panel of curves on a logarithmic axis, behind them a line at the kept epoch.
fn over_epochs(area: &Area<'_>, title: &str, label: &str, curves: &[Curve<'_>], kept: u64) -> Result<(), FigureError> {
    let epochs = curves.iter().map(|(_, values)| values.len()).max().unwrap_or_default();
    let x = Axis::counting("Epoch", 0.5, epochs as f64 + 0.5);
    let y = Axis::logarithmic(label, curves.iter().flat_map(|(_, values)| values.iter()));
    let entries: Vec<Entry<'_>> = curves.iter().map(|(entry, _)| *entry).chain([KEPT]).collect();
    let mut panel = panel(area, title, &entries, &x, &y)?;
    let ends = [y.range().start, y.range().end].map(|value| (kept as f64, value));
    panel.draw_series(LineSeries::new(ends, KEPT.1.stroke_width(px(3))))?;
    for ((_, colour), values) in curves {
        let points = (1..).zip(values.iter()).filter(|(_, value)| y.shows(**value));
        line(
            &mut panel,
            *colour,
            points.map(|(epoch, value)| (f64::from(epoch), *value)).collect(),
        )?;
    }
    Ok(())
}
