//! The figure of an audit and a line of what it found, from what its artifact says.

use serde_json::Value;

use super::figures::{Audited, Counts};
use super::gather::{Made, ReportError};
use crate::store::{Data, Object, Store};

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

/// What the audits of a run found, one line for each.
///
/// # Errors
/// When an artifact cannot be read.
pub fn audits(store: &Store, made: &[Made]) -> Result<Vec<String>, ReportError> {
    let audits = made.iter().filter(|stage| stage.kind == "audit");
    let line = |stage: &Made| {
        let artifact = store.artifact(&stage.digest)?;
        let json =
            |name: &str| serde_json::from_str(artifact.attribute(name).unwrap_or_default()).unwrap_or(Value::Null);
        Ok(format!(
            "{}: {}",
            stage.stage,
            told(&json("findings"), &json("summary"))
        ))
    };
    audits.map(line).collect()
}

fn told(findings: &Value, summary: &Value) -> String {
    let samples = &summary["samples"];
    let Some(findings) = findings.as_array() else {
        return "what it found cannot be read".to_owned();
    };
    let excluded = summary["resimulated"]["excluded_above"].as_f64();
    let excluded = excluded.filter(|_| summary["resimulated"]["samples"].as_u64() > Some(0));
    let excluded = excluded.map_or_else(String::new, |rate| {
        format!(
            "; {} on a finer mesh exclude a rate of faults above {:.1} % at 95 %",
            summary["resimulated"]["samples"],
            100.0 * rate
        )
    });
    if findings.is_empty() {
        return format!("no findings in {samples} samples{excluded}");
    }
    let checks = findings.iter().map(|finding| {
        let text = |key: &str| finding[key].as_str().unwrap_or_default().to_owned();
        format!("{} {} ({})", text("severity"), text("check"), finding["count"])
    });
    let checks: Vec<String> = checks.collect();
    format!("in {samples} samples: {}", checks.join(", "))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn an_audit_is_told_in_one_line() {
        let summary = json!({ "samples": 40, "resimulated": { "samples": 8, "excluded_above": 0.312 } });
        assert_eq!(
            told(&json!([]), &summary),
            "no findings in 40 samples; 8 on a finer mesh exclude a rate of faults above 31.2 % at 95 %"
        );
        let findings = json!([
            { "check": "sign", "severity": "error", "count": 2 },
            { "check": "duplicate", "severity": "warning", "count": 1 },
        ]);
        assert_eq!(
            told(&findings, &json!({ "samples": 40 })),
            "in 40 samples: error sign (2), warning duplicate (1)"
        );
    }
}
