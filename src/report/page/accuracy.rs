//! What accuracy costs: the error of each method over its time.

use crate::report::figures::accuracy_charts;
use crate::report::gather::{Made, ReportError, costs, each, moves};
use crate::report::html::Page;
use crate::store::Store;

/// Adds a section where accuracy was measured.
pub fn section(page: &mut Page, store: &Store, made: &[Made]) -> Result<(), ReportError> {
    let measured = each(store, made, "accuracy", |source| {
        let costs = costs(source)?;
        let charts = match moves(&costs) {
            true => source.drawn(accuracy_charts(&costs))?,
            false => Vec::new(),
        };
        Ok((source.stage.stage.clone(), charts))
    })?;
    if measured.is_empty() {
        return Ok(());
    }
    page.section("Accuracy and time");
    page.line(
        "Error of each method over the time of one core per pattern. Ringed and named: no other method is both faster and more \
         accurate. 2² Q1 is 2 × 2 bilinear elements per cell, Q2 are biquadratic ones; a length is the accuracy that was asked \
         for.",
    );
    for (name, charts) in &measured {
        page.part(name);
        page.charts(charts);
    }
    Ok(())
}
