//! What the artifact of an audit stage says, and reads back.

use std::collections::BTreeMap;

use crate::dataset::audit::{Finding, Label, Report, Severity, Summary};
use crate::stage::arrays;
use crate::store::{Data, Dataset, Object};

/// The findings, one to a line within JSON.
const FINDINGS: &str = "findings";
const SUMMARY: &str = "summary";

/// The object.
///
/// # Errors
/// When it cannot be written as JSON; why.
pub fn describe(report: &Report) -> Result<Object, String> {
    let json = |e: serde_json::Error| e.to_string();
    let findings: Result<Vec<String>, _> = report.findings.iter().map(serde_json::to_string).collect();
    let findings = findings.map_err(json)?.join(",\n");
    let summary = serde_json::to_string(&report.summary).map_err(json)?;
    let (area, displacement) = (&report.summary.area, &report.summary.displacement);
    let resimulated = &report.resimulated;
    let reals = |units, note: &str, values: &[f64]| arrays::reals(units, note, values.to_vec());
    let wholes = |note: &str, values: &[u64]| arrays::wholes("1", note, values.to_vec());
    let errors: Vec<f64> = resimulated.iter().map(|row| row.error.unwrap_or(-1.0)).collect();
    let allowed: Vec<f64> = resimulated.iter().map(|row| row.allowed.unwrap_or(-1.0)).collect();
    let rows: Vec<u64> = resimulated.iter().map(|row| row.index as u64).collect();
    let object = Object::default()
        .attribute(FINDINGS, format!("[\n{findings}\n]"))
        .attribute(SUMMARY, summary)
        .with(
            "area/edges",
            reals("1", "edges of the bins of the active part", &area.edges),
        )
        .with("area/counts", wholes("rows in each", &area.counts))
        .with(
            "displacement/edges",
            reals(
                "mm",
                "edges of the bins of the largest displacement",
                &displacement.edges,
            ),
        )
        .with("displacement/counts", wholes("rows in each", &displacement.counts))
        .with(
            "max_displacement",
            reals(
                "mm",
                "largest displacement magnitude of each row; 0 without a field",
                &report.peaks,
            ),
        )
        .with(
            "resimulated/row",
            wholes("rows that were simulated on a finer mesh", &rows),
        )
        .with(
            "resimulated/error",
            reals(
                "mm",
                "largest difference from the finer mesh; -1 where that has no solution",
                &errors,
            ),
        )
        .with(
            "resimulated/allowed",
            reals("mm", "error that is declared; -1 where none is", &allowed),
        );
    Ok(with_labels(object, &report.labels))
}

fn with_labels(object: Object, labels: &[Label]) -> Object {
    let state = |label: &Label| match label {
        Label::Absent => 0,
        Label::Agrees => 1,
        Label::Compared { .. } => 2,
        Label::Wrong(..) => 3,
        Label::NoSolution => 4,
        Label::Stable => 5,
    };
    let states = labels.iter().map(state).collect();
    let note = "0 no field, 1 comes out the same when it is solved again, 2 compared with an estimate, 3 wrong, 4 has no \
                stable solution, 5 no field but a stable solution";
    let compared: Vec<f64> = labels
        .iter()
        .flat_map(|label| match label {
            Label::Compared { ratio, rest } => [*ratio, *rest],
            _ => [0.0, 0.0],
        })
        .collect();
    object
        .with(
            "label/state",
            Dataset::new("1", note, &[labels.len()], Data::U8(states)),
        )
        .with(
            "label/compared",
            Dataset::new(
                "1",
                "ratio to the estimate, and the part that no ratio explains; 0 where not compared",
                &[labels.len(), 2],
                Data::F64(compared),
            ),
        )
}

/// Findings and summary, from the attributes of an audit's artifact.
///
/// # Errors
/// When it is no audit's; why.
pub fn read(attributes: &BTreeMap<String, String>) -> Result<(Vec<Finding>, Summary), String> {
    let text = |name: &str| {
        let missing = || format!("this is no audit: it has no attribute `{name}`");
        attributes.get(name).ok_or_else(missing)
    };
    let json = |e: serde_json::Error| format!("this is no audit: {e}");
    Ok((
        serde_json::from_str(text(FINDINGS)?).map_err(json)?,
        serde_json::from_str(text(SUMMARY)?).map_err(json)?,
    ))
}

/// Why nothing may be made from a dataset with these findings, if nothing may.
#[must_use]
pub fn objection(findings: &[Finding]) -> Option<String> {
    let errors: Vec<String> = findings
        .iter()
        .filter(|finding| finding.severity == Severity::Error)
        .map(|finding| format!("{} ({})", finding.check, finding.count))
        .collect();
    (!errors.is_empty()).then(|| format!("the audit found errors: {}", errors.join(", ")))
}
