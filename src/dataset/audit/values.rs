//! Checks of values: cells, displacements, the frame, and columns that must agree with patterns and fields.

use super::facts::Facts;
use super::finding::{Finding, Severity};
use super::rows::Dataset;

/// Relative tolerance of a stored maximum, and of the displacement of the frame.
const EXACT: f64 = 1e-6;

/// Returns a finding if the lengths of the columns differ. The dataset cannot be checked then.
#[must_use]
pub fn lengths(dataset: &Dataset<'_>) -> Option<Finding> {
    let lengths = dataset.columns.lengths().into_iter();
    let wrong: Vec<String> = lengths
        .filter(|(_, length)| *length != dataset.len)
        .map(|(name, length)| format!("`{name}` has {length}"))
        .collect();
    let message = || format!("there are {} patterns, and {}", dataset.len, wrong.join(", "));
    (!wrong.is_empty()).then(|| Finding::whole("shape", Severity::Error, message()))
}

/// Returns the findings about values. `rounding` is the allowed rounding error in mm.
#[must_use]
pub fn findings(facts: &[Facts], dataset: &Dataset<'_>, rounding: f64) -> Vec<Finding> {
    let columns = &dataset.columns;
    let no_pattern = match dataset.device.groups {
        1 => "a cell is neither 0 (bare) nor 1 (electrode)",
        _ => "a cell is neither 0 (bare) nor the number of a group of electrodes",
    };
    let rows = |wrong: &dyn Fn(usize, &Facts) -> bool| -> Vec<usize> {
        let all = facts.iter().enumerate();
        all.filter(|(i, facts)| wrong(*i, facts)).map(|(i, _)| i).collect()
    };
    let checks: [(&str, Severity, Vec<usize>, &str); 7] = [
        ("pattern", Severity::Error, rows(&|_, f| !f.is_pattern), no_pattern),
        (
            "finite",
            Severity::Error,
            rows(&|_, f| f.claims_field && !f.has_field),
            "the field holds a value that is no number",
        ),
        (
            "boundary",
            Severity::Error,
            rows(&|_, f| f.frame > EXACT * f.peak + rounding),
            "the field moves on the frame, where the membrane is clamped",
        ),
        (
            "derived",
            Severity::Error,
            rows(&|i, f| f.has_field && columns.peak.as_ref().is_some_and(|p| !near(p[i], f.peak, rounding))),
            "`max_displacement` is not that of the field",
        ),
        (
            "derived",
            Severity::Error,
            rows(&|i, f| {
                let stored = columns.orbit.as_ref().map(|orbits| &orbits[i]);
                let found = f.identity.as_ref().map(|(_, orbit)| orbit.to_string());
                stored.zip(found).is_some_and(|(stored, found)| *stored != found)
            }),
            "`orbit` is not that of the pattern",
        ),
        (
            "outcome",
            Severity::Error,
            rows(&|_, f| f.is_hidden),
            "the row has a field, and by its outcome it has none",
        ),
        (
            "not-converged",
            Severity::Warning,
            rows(&|_, f| !f.claims_field),
            "the sample has no stable solution, and no field",
        ),
    ];
    let found = checks.into_iter().filter(|(_, _, rows, _)| !rows.is_empty());
    found
        .map(|(check, severity, rows, message)| Finding::rows(check, severity, &rows, message))
        .collect()
}

fn near(stored: f64, found: f64, rounding: f64) -> bool {
    (stored - found).abs() <= EXACT * found + rounding + 1e-12
}
