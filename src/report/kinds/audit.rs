//! Audit stages: a line of what each found, and what a dataset covers.

use std::path::Path;

use serde_json::{Value, json};

use crate::artifacts::{RunArtifacts, Source};
use crate::error::ReportError;
use crate::figures::{Audited, Counts, draw_audit};
use crate::headline::Headline;
use crate::html::Page;
use crate::presenter::{DrawFigure, Presenter, Results};
use deaflow_content as content;
use deaflow_content::{Json, StoredAttribute};

/// Shows audit stages.
pub struct Audit;

impl Presenter for Audit {
    fn kind(&self) -> &'static str {
        "audit"
    }

    fn results(&self, run: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        let lines = run.each(self.kind(), line)?;
        Ok(vec![Results {
            key: "audits".to_owned(),
            value: json!(lines),
            text: (!lines.is_empty()).then(|| lines.join("\n")).into_iter().collect(),
            warnings: Vec::new(),
        }])
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        Ok(run.each(self.kind(), line)?.into_iter().map(Headline::good).collect())
    }

    fn figures(&self) -> &'static [(&'static str, DrawFigure)] {
        &[("audit", figure)]
    }

    fn section(&self, page: &mut Page, run: &RunArtifacts<'_>) -> Result<(), ReportError> {
        for line in run.each(self.kind(), line)? {
            super::dataset(page);
            page.line(&format!("Audit {line}."));
        }
        Ok(())
    }
}

/// An audit that ended before it looked at rows has nothing to draw.
fn figure(path: &Path, source: &Source<'_>) -> Result<(), ReportError> {
    match audited(&source.of(content::Audit::read(source.artifact))?) {
        Some(figure) => source.drawn(draw_audit(path, &figure)),
        None => Ok(()),
    }
}

/// The numbers of the figure; `None` where the audit ended before it had any.
#[must_use]
pub fn audited(audit: &content::Audit) -> Option<Audited> {
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

/// What an audit found.
fn line(source: &Source<'_>) -> Result<String, ReportError> {
    let view = source.of(content::Audit::open(source.artifact))?;
    let value = |attribute: StoredAttribute<'_, Json>| -> Result<Value, ReportError> {
        let json = source.of(attribute.read())?;
        json.value().map_err(|e| source.wrong(e.to_string()))
    };
    let text = describe(&value(view.findings())?, &value(view.summary())?);
    Ok(format!("{}: {text}", source.stage.stage))
}

fn describe(findings: &Value, summary: &Value) -> String {
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
            describe(&json!([]), &summary),
            "no findings in 40 samples; 8 on a finer mesh exclude a rate of faults above 31.2 % at 95 %"
        );
        let findings = json!([
            { "check": "sign", "severity": "error", "count": 2 },
            { "check": "duplicate", "severity": "warning", "count": 1 },
        ]);
        assert_eq!(
            describe(&findings, &json!({ "samples": 40 })),
            "in 40 samples: error sign (2), warning duplicate (1)"
        );
    }
}
