//! Writes and reads the artifact of an audit stage.

use deaflow_content::{AreaHistogram, AttributeError, Audit, DisplacementHistogram, Json, ResimulatedRows, WrongRows};
use deaflow_dataset::audit::{Finding, LabelCheck, Report, Severity};
use deaflow_orchestrator::StageError;
use deaflow_scene::Scene;
use deaflow_store::Artifact;

/// Returns the content of the artifact; `dataset` is the artifact that was audited, or `None` for a file.
///
/// # Errors
/// If it cannot be written as JSON.
pub fn content(report: Report, dataset: Option<String>, scene: Scene) -> Result<Audit, AttributeError> {
    let (findings, summary) = (Json::of_list(&report.findings)?, Json::of(&report.summary)?);
    let resimulated = &report.resimulated;
    // Unknown values are stored as negative numbers.
    let known = |value: Option<f64>| value.unwrap_or(-1.0);
    Ok(Audit {
        findings,
        resimulated: ResimulatedRows {
            row: resimulated.iter().map(|row| row.index as u64).collect(),
            error: resimulated.iter().map(|row| known(row.error)).collect(),
            allowed: resimulated.iter().map(|row| known(row.allowed)).collect(),
        },
        wrong: wrong_rows(&report.findings),
        label_state: report.labels.iter().map(state).collect(),
        label_compared: report.labels.iter().map(compared).collect(),
        max_displacement: report.peaks,
        area: AreaHistogram {
            edges: report.summary.area.edges,
            counts: report.summary.area.counts,
        },
        displacement: DisplacementHistogram {
            edges: report.summary.displacement.edges,
            counts: report.summary.displacement.counts,
        },
        summary,
        dataset,
        scene,
    })
}

/// Returns all rows of the findings that are errors.
fn wrong_rows(findings: &[Finding]) -> WrongRows {
    let errors = findings.iter().filter(|finding| finding.severity == Severity::Error);
    let rows = errors.flat_map(|finding| finding.all.iter().map(|&row| (row, finding.check.clone())));
    let (row, check) = rows.unzip();
    WrongRows { row, check }
}

fn state(label: &LabelCheck) -> u8 {
    match label {
        LabelCheck::Absent => 0,
        LabelCheck::Agrees => 1,
        LabelCheck::Compared { .. } => 2,
        LabelCheck::Wrong(..) => 3,
        LabelCheck::NoSolution => 4,
        LabelCheck::Stable => 5,
    }
}

fn compared(label: &LabelCheck) -> [f64; 2] {
    match label {
        LabelCheck::Compared { ratio, residual } => [*ratio, *residual],
        _ => [0.0, 0.0],
    }
}

/// Reads the findings of an audit.
///
/// # Errors
/// If the artifact cannot be read.
pub fn findings(artifact: &Artifact) -> Result<Vec<Finding>, StageError> {
    let findings = Audit::open(artifact)?.findings().read()?.value();
    findings.map_err(|e| StageError::in_artifact(artifact, e))
}

/// Returns why a dataset with these findings must not be used, if so.
#[must_use]
pub fn objection(findings: &[Finding]) -> Option<String> {
    let errors: Vec<String> = findings
        .iter()
        .filter(|finding| finding.severity == Severity::Error)
        .map(|finding| format!("{} ({})", finding.check, finding.count))
        .collect();
    (!errors.is_empty()).then(|| format!("the audit found errors: {}", errors.join(", ")))
}
