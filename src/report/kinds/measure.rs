//! Measure stages: what was read from files of measurements.

use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::drawing::Sheet;
use crate::error::ReportError;
use crate::figures::{MeasuredFigure, measured_charts, measured_sheet};
use crate::html::Page;
use crate::measured::figures_of_measurements;
use crate::presenter::{Figures, Presenter};
use deaflow_content::Measurements;

/// Presents measure stages.
pub struct MeasurePresenter;

impl Presenter for MeasurePresenter {
    fn kind(&self) -> &'static str {
        "measure"
    }

    fn figures(&self) -> Figures {
        &[("read", figure)]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let found = run.each(self.kind(), |source| {
            let charts = source.drawn(measured_charts(&figures(source)?))?;
            Ok((source.stage.stage.clone(), charts))
        })?;
        for (stage, charts) in &found {
            page.open("Measurements", "What was read from files.");
            page.part(stage);
            page.charts(charts);
        }
        Ok(())
    }
}

fn figures(source: &ArtifactReader<'_>) -> Result<Vec<MeasuredFigure>, ReportError> {
    let measured = source.of(Measurements::read(source.artifact))?;
    Ok(figures_of_measurements(&measured))
}

fn figure(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    source.drawn(measured_sheet(&figures(source)?)).map(Some)
}
