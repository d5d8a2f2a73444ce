//! Audit stages: their findings, and the distribution of the rows.

use serde_json::Value;

use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::drawing::Sheet;
use crate::error::ReportError;
use crate::figures::{AuditFigure, Counts};
use crate::format::{counted, percents};
use crate::html::Page;
use crate::presenter::{Figures, Headline, Presenter, Results};
use deaflow_content as content;
use deaflow_content::{Json, StoredAttribute};

/// Presents audit stages.
pub struct AuditPresenter;

impl Presenter for AuditPresenter {
    fn kind(&self) -> &'static str {
        "audit"
    }

    fn results(&self, run: &RunArtifacts<'_>) -> Result<Vec<Results>, ReportError> {
        let lines = run.each(self.kind(), line)?;
        let text = (!lines.is_empty()).then(|| lines.join("\n"));
        Ok(vec![Results::new("audits", &lines, text)])
    }

    fn headlines(&self, run: &RunArtifacts<'_>) -> Result<Vec<Headline>, ReportError> {
        let lines = run.each(self.kind(), |source| Ok((line(source)?, has_errors(source)?)))?;
        let headline = |(text, has_errors)| match has_errors {
            true => Headline::bad(text),
            false => Headline::good(text),
        };
        Ok(lines.into_iter().map(headline).collect())
    }

    fn figures(&self) -> Figures {
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

/// An audit that ended before it read rows has no figure.
fn figure(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    let figure = audit_figure(&source.of(content::Audit::read(source.artifact))?);
    figure.map(|figure| source.drawn(figure.sheet())).transpose()
}

/// Returns the data of the figure; `None` if the audit ended before it had any.
#[must_use]
pub fn audit_figure(audit: &content::Audit) -> Option<AuditFigure> {
    let by_peak = |values: &[f64]| -> Option<Vec<(f64, f64)>> {
        let pairs = audit.resimulated.row.iter().zip(values);
        // Unknown values are negative.
        let known = pairs.filter(|(_, value)| **value >= 0.0);
        known
            .map(|(row, value)| Some((*audit.max_displacement.get(*row as usize)?, *value)))
            .collect()
    };
    let figure = AuditFigure {
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

/// Reads an attribute with results.
fn value(source: &ArtifactReader<'_>, attribute: StoredAttribute<'_, Json>) -> Result<Value, ReportError> {
    let json = source.of(attribute.read())?;
    json.value().map_err(|e| source.wrong(e.to_string()))
}

/// Whether some findings of an audit are errors.
fn has_errors(source: &ArtifactReader<'_>) -> Result<bool, ReportError> {
    let view = source.of(content::Audit::open(source.artifact))?;
    let findings = value(source, view.findings())?;
    let mut findings = findings.as_array().into_iter().flatten();
    Ok(findings.any(|finding| finding["severity"] == ERROR))
}

/// Describes the findings of an audit.
fn line(source: &ArtifactReader<'_>) -> Result<String, ReportError> {
    let view = source.of(content::Audit::open(source.artifact))?;
    let text = describe(&value(source, view.findings())?, &value(source, view.summary())?);
    Ok(format!("{}: {text}", source.stage.stage))
}

fn describe(findings: &Value, summary: &Value) -> String {
    let samples = &summary["samples"];
    let Some(findings) = findings.as_array() else {
        return "its findings are invalid".to_owned();
    };
    if findings.is_empty() {
        let of = &summary["resimulated"];
        let [checks, faults] = ["samples", "faults"].map(|key| of[key].as_u64().unwrap_or(0) as usize);
        let excluded = of["excluded_above"].as_f64().filter(|_| checks > 0);
        let checked = excluded.map_or_else(String::new, |excluded| {
            let rows = samples.as_u64().unwrap_or(0) as usize;
            format!(
                "; on a finer mesh {}",
                checks_in_words([checks, faults], excluded, rows)
            )
        });
        return format!("no findings in {samples} samples{checked}");
    }
    let of = |severity: &str| -> Vec<String> {
        let own = findings.iter().filter(|finding| finding["severity"] == severity);
        own.map(finding_words).collect()
    };
    let verdicts = [(ERROR, "errors"), ("warning", "warnings")].map(|(severity, name)| (name, of(severity)));
    let verdicts = verdicts.iter().filter(|(_, found)| !found.is_empty());
    let verdicts = verdicts.enumerate().map(|(at, (name, found))| {
        let samples = if at == 0 {
            format!(" in {samples} samples")
        } else {
            String::new()
        };
        format!("{name}{samples}: {}", found.join("; "))
    });
    verdicts.collect::<Vec<_>>().join("; ")
}

/// Describes random checks of labels on a finer mesh and the faults that they found: the share of labels that are wrong
/// there which they exclude, and how many checks it takes if they are too few. `rows` are all labels.
#[must_use]
pub fn checks_in_words([checks, faults]: [usize; 2], excluded_above: f64, rows: usize) -> String {
    /// The largest share of wrong labels that a user of a dataset would accept.
    const MOST: f64 = 0.05;
    /// So many checks without a fault exclude a share of 1 %, as 0.99^300 < 0.05.
    const FOR_ONE_PERCENT: usize = 300;
    let share = percents(excluded_above);
    let found = match faults {
        0 => "no fault".to_owned(),
        _ => counted(faults, "fault", "faults"),
    };
    if checks >= rows {
        return format!("{found} in all {rows}");
    }
    let found = format!("{found} in {}", counted(checks, "check", "checks"));
    if excluded_above <= MOST || faults > 0 {
        return format!("{found}: at 95 % confidence, at most {share} of all are wrong there");
    }
    let enough = match rows > FOR_ONE_PERCENT {
        true => format!("{FOR_ONE_PERCENT} checks without a fault would bound that at 1 %"),
        false => format!("check all {rows}"),
    };
    format!("{found}, which are too few: at 95 % confidence, up to {share} of all may still be wrong there; {enough}")
}

/// Describes a finding: the check, the number of rows, and the sentence that was found.
fn finding_words(finding: &Value) -> String {
    let text = |key: &str| finding[key].as_str().unwrap_or_default();
    // A finding about the whole dataset has no rows.
    let is_whole = finding["examples"].as_array().is_none_or(Vec::is_empty);
    let rows = match finding["count"].as_u64() {
        Some(count) if !is_whole => format!(", {}", counted(count as usize, "row", "rows")),
        _ => String::new(),
    };
    match text("message") {
        "" => format!("{}{rows}", text("check")),
        message => format!("{}{rows} ({message})", text("check")),
    }
}

/// The severity of a finding that is an error.
const ERROR: &str = "error";

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn findings_are_described_in_one_line() {
        let checked = |samples: usize, checks: usize, excluded: f64| {
            let of = json!({ "samples": checks, "faults": 0, "excluded_above": excluded });
            describe(&json!([]), &json!({ "samples": samples, "resimulated": of }))
        };
        for (text, expected) in [
            (
                checked(40, 8, 0.312),
                "no findings in 40 samples; on a finer mesh no fault in 8 checks, which are too few: at 95 % \
                 confidence, up to 31.2 % of all may still be wrong there; check all 40",
            ),
            (
                checked(4000, 6, 0.393),
                "no findings in 4000 samples; on a finer mesh no fault in 6 checks, which are too few: at 95 % \
                 confidence, up to 39.3 % of all may still be wrong there; 300 checks without a fault would bound \
                 that at 1 %",
            ),
            (
                checked(4000, 300, 0.0099),
                "no findings in 4000 samples; on a finer mesh no fault in 300 checks: at 95 % confidence, at most \
                 0.990 % of all are wrong there",
            ),
            (
                checks_in_words([20, 3], 0.34, 4000),
                "3 faults in 20 checks: at 95 % confidence, at most 34.0 % of all are wrong there",
            ),
            (checks_in_words([40, 2], 0.05, 40), "2 faults in all 40"),
        ] {
            assert_eq!(text, expected);
        }
        assert_eq!(
            describe(&json!([]), &json!({ "samples": 40 })),
            "no findings in 40 samples"
        );
        let findings = json!([
            { "check": "sign", "severity": "error", "count": 2, "examples": [3, 7], "message": "other sign" },
            { "check": "duplicate", "severity": "warning", "count": 1, "examples": [9], "message": "" },
            { "check": "no-test", "severity": "warning", "count": 1, "examples": [], "message": "no test set" },
        ]);
        assert_eq!(
            describe(&findings, &json!({ "samples": 40 })),
            "errors in 40 samples: sign, 2 rows (other sign); warnings: duplicate, 1 row; no-test (no test set)"
        );
        let warning = json!([{ "check": "duplicate", "severity": "warning", "count": 2, "examples": [9, 10] }]);
        assert_eq!(
            describe(&warning, &json!({ "samples": 40 })),
            "warnings in 40 samples: duplicate, 2 rows"
        );
    }
}
