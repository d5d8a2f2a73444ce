//! The course of a training, epoch by epoch.

use crate::drawing::{Axis, Chart, Colour, FigureError, Mark, Series, Sheet};

/// One value per epoch of each curve.
#[derive(Clone, Debug)]
pub struct Training {
    /// Loss on the training samples.
    pub train_loss: Vec<f64>,
    /// Whether there are validation samples. Without them `validation_rmse` is the error on the training samples.
    pub is_validated: bool,
    /// Loss on the validation samples.
    pub validation_loss: Vec<f64>,
    /// Root mean square error on the validation samples, in mm.
    pub validation_rmse: Vec<f64>,
    /// Learning rate at the end of each epoch.
    pub learning_rate: Vec<f64>,
    /// The epoch whose weights are kept, from 1.
    pub kept: u64,
}

/// A curve with its name in the legend and its colour.
type Curve<'a> = (&'a str, Colour, &'a [f64]);

impl Training {
    /// Draws the losses, the validation error and the learning rate over the epochs, all on logarithmic axes.
    ///
    /// # Errors
    /// If the curves are empty or differ in length, or the kept epoch is not among them.
    pub fn charts(&self) -> Result<Vec<Chart>, FigureError> {
        let epochs = self.train_loss.len();
        let others = [&self.validation_loss, &self.validation_rmse, &self.learning_rate];
        if epochs == 0 || others.iter().any(|curve| curve.len() != epochs) {
            return Err(FigureError::Data("training curves need one value per epoch".into()));
        }
        let kept = usize::try_from(self.kept).ok().and_then(|kept| kept.checked_sub(1));
        let Some(error) = kept.and_then(|kept| self.validation_rmse.get(kept)) else {
            return Err(FigureError::Data(format!(
                "the kept epoch is {}, but there are {epochs} epochs",
                self.kept
            )));
        };
        // Without validation samples both curves of losses are of the training samples, once during an epoch and once
        // at its end.
        let (title, name, colour) = match self.is_validated {
            true => ("Validation error", "validation", Colour::Vermillion),
            false => ("Training error (no validation rows)", "training", Colour::Blue),
        };
        let mut losses: Vec<Curve<'_>> = vec![("training", Colour::Blue, &self.train_loss)];
        losses.extend(self.is_validated.then_some((name, colour, &*self.validation_loss)));
        let errors: [Curve<'_>; 1] = [(name, colour, &self.validation_rmse)];
        let rates: [Curve<'_>; 1] = [("at the end of the epoch", Colour::Green, &self.learning_rate)];
        Ok(vec![
            self.over_epochs("Loss", "Loss per sample", &losses),
            self.over_epochs(
                &format!("{title}, {error:.4} mm kept"),
                "RMSE of a displacement component [mm]",
                &errors,
            ),
            self.over_epochs("Learning rate", "Learning rate", &rates),
        ])
    }

    /// Draws curves on a logarithmic axis, with a line at the kept epoch.
    fn over_epochs(&self, title: &str, label: &str, curves: &[Curve<'_>]) -> Chart {
        let epochs = curves
            .iter()
            .map(|(_, _, values)| values.len())
            .max()
            .unwrap_or_default();
        let x = Axis::counting("Epoch", 0.5, epochs as f64 + 0.5);
        let y = Axis::logarithmic(label, curves.iter().flat_map(|(_, _, values)| values.iter()));
        let kept = y.ends().map(|value| (self.kept as f64, value)).to_vec();
        let kept = Series::new("kept epoch", Colour::Grey, Mark::Line, kept);
        let curve = |(name, colour, values): &Curve<'_>| {
            let points = (1..).map(f64::from).zip(values.iter().copied()).collect();
            Series::new(name, *colour, Mark::LineAndDots, points)
        };
        let series = std::iter::once(kept).chain(curves.iter().map(curve)).collect();
        Chart::new(title, [x, y], series)
    }

    /// Draws the charts on a sheet.
    ///
    /// # Errors
    /// As [`Self::charts`].
    pub fn sheet(&self) -> Result<Sheet, FigureError> {
        Ok(Sheet::charts(3, &self.charts()?))
    }
}
