//! Balance stages: the distribution of the samples before and after balancing.

use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::error::ReportError;
use crate::figures::Histogram;
use crate::html::Page;
use crate::presenter::{Figures, Presenter};
use deaflow_content::Balanced;

/// Presents balance stages.
pub struct BalancePresenter;

impl Presenter for BalancePresenter {
    fn kind(&self) -> &'static str {
        "balance"
    }

    fn figures(&self) -> Figures {
        &[("histogram", |source| {
            source.drawn(counts_by_bin(source)?.sheet()).map(Some)
        })]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        let balanced = run.each(self.kind(), |source| {
            let data = counts_by_bin(source)?;
            let without = source.of(Balanced::open(source.artifact))?.without();
            let without = source.of(without.read())?.unwrap_or_default().0;
            Ok((
                source.stage.stage.clone(),
                source.drawn(data.charts())?,
                data.after,
                without,
            ))
        })?;
        for (stage, charts, after, without) in &balanced {
            super::dataset(page);
            page.part(&format!("{stage}: balance"));
            page.charts(charts);
            let empty = after.iter().filter(|count| **count == 0).count();
            let bins = after.len();
            page.note(&format!(
                "{empty} of {bins} bins are empty: no sample has such a displacement."
            ));
            if !without.is_empty() {
                page.note(&format!("{}.", without.join("; ")));
            }
        }
        Ok(())
    }
}

/// Reads the histograms of a balance stage.
fn counts_by_bin(source: &ArtifactReader<'_>) -> Result<Histogram, ReportError> {
    let view = source.of(Balanced::open(source.artifact))?;
    let histogram = view.histogram();
    let after = source.of(histogram.after().read())?;
    // Rows that are not images are samples as drawn.
    let mut levelled = vec![0; after.len()];
    let (bins, symmetries) = (source.of(view.bin().read())?, source.of(view.symmetry().read())?);
    let drawn = bins.into_iter().zip(symmetries).filter(|(_, symmetry)| *symmetry == 0);
    for (bin, _) in drawn {
        let count = usize::try_from(bin).ok().and_then(|bin| levelled.get_mut(bin));
        *count.ok_or_else(|| source.wrong(format!("there is no bin {bin}")))? += 1;
    }
    Ok(Histogram {
        edges: source.of(histogram.edges().read())?,
        before: source.of(histogram.before().read())?,
        augmented: source.of(histogram.augmented().read())?,
        levelled,
        after,
    })
}
