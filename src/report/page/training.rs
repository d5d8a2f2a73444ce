//! The course of each training.

use crate::report::gather::{Made, ReportError, curves, each};
use crate::report::html::Page;
use crate::report::training::trainings;
use crate::store::Store;

/// Adds a section where something was trained.
pub fn section(page: &mut Page, store: &Store, made: &[Made]) -> Result<(), ReportError> {
    let trained = each(store, made, "train", |source| {
        let charts = source.drawn(curves(source)?.charts())?;
        Ok((source.stage.stage.clone(), charts))
    })?;
    if trained.is_empty() {
        return Ok(());
    }
    page.section("Training");
    for ((name, charts), told) in trained.iter().zip(trainings(store, made)?) {
        page.part(name);
        page.line(&told.line);
        page.charts(charts);
    }
    Ok(())
}
