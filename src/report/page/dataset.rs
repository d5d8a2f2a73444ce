//! How far samples move, family by family, and how the dataset was levelled.

use crate::report::audit::audits;
use crate::report::drawing::Chart;
use crate::report::figures::deformation_charts;
use crate::report::gather::{Made, ReportError, Source, counts_by_bin, each, families};
use crate::report::html::Page;
use crate::store::Store;

/// Adds a section where there is a dataset.
pub fn section(page: &mut Page, store: &Store, made: &[Made]) -> Result<(), ReportError> {
    let solved: Vec<(String, Vec<Chart>)> = each(store, made, "solve", deformation)?
        .into_iter()
        .flatten()
        .collect();
    let balanced = each(store, made, "balance", |source| {
        let data = counts_by_bin(source)?;
        let charts = source.drawn(data.charts())?;
        let empty = data.after.iter().filter(|count| **count == 0).count();
        Ok((source.stage.stage.clone(), charts, [empty, data.after.len()]))
    })?;
    let audits = audits(store, made)?;
    if solved.is_empty() && balanced.is_empty() && audits.is_empty() {
        return Ok(());
    }
    page.section("Dataset");
    page.line("How far the membrane moves in each sample: the largest displacement of the pattern.");
    audits.iter().for_each(|line| page.line(&format!("Audit {line}.")));
    for (name, charts, [empty, bins]) in &balanced {
        page.part(&format!("{name}: balance"));
        page.charts(charts);
        page.note(&format!("{empty} of {bins} bins are empty: no sample moves so far."));
    }
    for (name, charts) in &solved {
        page.part(&format!("{name}: samples by family"));
        page.charts(charts);
    }
    Ok(())
}

/// The histograms of a solve stage; none where no sample has a field.
fn deformation(source: &Source<'_>) -> Result<Option<(String, Vec<Chart>)>, ReportError> {
    let families = families(source)?;
    if families.is_empty() {
        return Ok(None);
    }
    let charts = source.drawn(deformation_charts(&families))?;
    Ok(Some((source.stage.stage.clone(), charts)))
}
