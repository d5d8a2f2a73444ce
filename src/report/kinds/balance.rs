//! Balance stages: how the dataset was levelled.

use crate::artifacts::{RunArtifacts, Source};
use crate::error::ReportError;
use crate::figures::{Histogram, draw_histogram};
use crate::html::Page;
use crate::presenter::{DrawFigure, Presenter};
use deaflow_content::Balanced;

/// Shows balance stages.
pub struct Balance;

impl Presenter for Balance {
    fn kind(&self) -> &'static str {
        "balance"
    }

    fn figures(&self) -> &'static [(&'static str, DrawFigure)] {
        &[("histogram", |path, source| {
            source.drawn(draw_histogram(path, &counts_by_bin(source)?))
        })]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let balanced = run.each(self.kind(), |source| {
            let data = counts_by_bin(source)?;
            Ok((source.stage.stage.clone(), source.drawn(data.charts())?, data.after))
        })?;
        for (stage, charts, after) in &balanced {
            super::dataset(page);
            page.part(&format!("{stage}: balance"));
            page.charts(charts);
            let empty = after.iter().filter(|count| **count == 0).count();
            page.note(&format!(
                "{empty} of {} bins are empty: no sample moves by as much as they stand for.",
                after.len()
            ));
        }
        Ok(())
    }
}

/// The histograms of a balance stage.
fn counts_by_bin(source: &Source<'_>) -> Result<Histogram, ReportError> {
    let view = source.of(Balanced::open(source.artifact))?;
    let histogram = view.histogram();
    let after = source.of(histogram.after().read())?;
    // Rows that are no images are samples as they were drawn.
    let mut levelled = vec![0; after.len()];
    let (bins, symmetries) = (source.of(view.bin().read())?, source.of(view.symmetry().read())?);
    let drawn = bins.into_iter().zip(symmetries).filter(|(_, symmetry)| *symmetry == 0);
    for (bin, _) in drawn {
        let count = usize::try_from(bin).ok().and_then(|bin| levelled.get_mut(bin));
        *count.ok_or_else(|| source.wrong(format!("it has no bin {bin}")))? += 1;
    }
    Ok(Histogram {
        edges: source.of(histogram.edges().read())?,
        before: source.of(histogram.before().read())?,
        augmented: source.of(histogram.augmented().read())?,
        levelled,
        after,
    })
}
