//! What the artifacts of a run warn of: samples that fail.

use super::gather::{Made, ReportError, each};
use crate::content::Solutions;
use crate::store::Store;

/// The warnings of all stages that simulate, after the name of the stage. Estimates and verified designs say nothing of breakdown.
///
/// # Errors
/// When an artifact cannot be read.
pub fn warnings(store: &Store, made: &[Made]) -> Result<Vec<String>, ReportError> {
    let warning = each(store, made, "solve", |source| {
        let view = source.of(Solutions::open(source.artifact))?;
        let ratios = source
            .of(view.observations().breakdown_ratio().read())?
            .unwrap_or_default();
        let (n, beyond) = (ratios.len(), ratios.iter().filter(|ratio| **ratio >= 1.0).count());
        let stage = &source.stage.stage;
        Ok((beyond > 0).then(|| format!("{stage}: {beyond} of {n} samples exceed the breakdown field")))
    })?;
    Ok(warning.into_iter().flatten().collect())
}
