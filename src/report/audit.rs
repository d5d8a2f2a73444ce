//! The figure of an audit and a line of what it found, from what its artifact says.

use serde_json::Value;

use super::figures::{Audited, Counts};
use super::gather::{Made, ReportError, each};
use crate::content::{Audit, Json, StoredAttribute};
use crate::store::Store;

/// The numbers of the figure; `None` where the audit ended before it had any.
#[must_use]
pub fn audited(audit: &Audit) -> Option<Audited> {
    let by_peak = |values: &[f64]| -> Option<Vec<(f64, f64)>> {
        let pairs = audit.resimulated.row.iter().zip(values);
        // What is not known is negative.
        let known = pairs.filter(|(_, value)| **value >= 0.0);
        known
            .map(|(row, value)| Some((*audit.max_displacement.get(*row as usize)?, *value)))
            .collect()
    };
    let figure = Audited {
        area: Counts {
            edges: audit.area.edges.clone(),
            counts: audit.area.counts.clone(),
        },
        displacement: Counts {
            edges: audit.displacement.edges.clone(),
            counts: audit.displacement.counts.clone(),
        },
        errors: by_peak(&audit.resimulated.error)?,
        allowed: by_peak(&audit.resimulated.allowed)?,
    };
    (!figure.area.counts.is_empty()).then_some(figure)
}

/// What the audits of a run found, one line for each.
///
/// # Errors
/// When an artifact cannot be read.
pub fn audits(store: &Store, made: &[Made]) -> Result<Vec<String>, ReportError> {
    each(store, made, "audit", |source| {
        let view = source.of(Audit::open(source.artifact))?;
        let value = |attribute: StoredAttribute<'_, Json>| -> Result<Value, ReportError> {
            let json = source.of(attribute.read())?;
            json.value().map_err(|e| source.wrong(e.to_string()))
        };
        let told = told(&value(view.findings())?, &value(view.summary())?);
        Ok(format!("{}: {told}", source.stage.stage))
    })
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
