//! The figure of an audit, from what its artifact says.

use super::figures::{Audited, Counts};
use crate::store::{Data, Object};

/// The numbers of the figure; `None` where the audit ended before it had any.
#[must_use]
pub fn audited(object: &Object) -> Option<Audited> {
    let reals = |path: &str| match &object.datasets.get(path)?.data {
        Data::F64(values) => Some(values.as_slice()),
        _ => None,
    };
    let wholes = |path: &str| match &object.datasets.get(path)?.data {
        Data::U64(values) => Some(values.as_slice()),
        _ => None,
    };
    let counts = |name: &str| {
        Some(Counts {
            edges: reals(&format!("{name}/edges"))?.to_vec(),
            counts: wholes(&format!("{name}/counts"))?.to_vec(),
        })
    };
    let (peaks, rows) = (reals("max_displacement")?, wholes("resimulated/row")?);
    let by_peak = |path: &str| -> Option<Vec<(f64, f64)>> {
        let pairs = rows.iter().zip(reals(path)?);
        // What is not known is negative.
        let known = pairs.filter(|(_, value)| **value >= 0.0);
        known
            .map(|(row, value)| Some((*peaks.get(*row as usize)?, *value)))
            .collect()
    };
    let figure = Audited {
        area: counts("area")?,
        displacement: counts("displacement")?,
        errors: by_peak("resimulated/error")?,
        allowed: by_peak("resimulated/allowed")?,
    };
    (!figure.area.counts.is_empty()).then_some(figure)
}
