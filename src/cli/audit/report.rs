//! The report of an audit: a table, JSON, and a page.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Value, json};

use crate::text::Text;
use crate::{CliError, Output, table, write};
use deaflow_base::{ArtifactId, error_digits};
use deaflow_content::{AttributeError, Audit};
use deaflow_report::figures::{Background, DeformedMembrane, membrane_sheet};
use deaflow_report::{Page, audit_figure, checks_in_words};
use deaflow_stage::audit::{Audited, Finding, Lineage, Severity, SourceRows, Summary, rows, sort};
use deaflow_store::Artifact;

/// The origins of a dataset.
#[derive(Debug, Serialize)]
struct Origins {
    /// Number of artifacts that it was made from, including chunks.
    artifacts: usize,
    /// The different seeds of its samples.
    seeds: Vec<String>,
    /// Whether any of it was imported from files.
    from_files: bool,
}

/// A finished audit.
pub struct AuditReport {
    dataset: String,
    /// The content of the artifact; none if nothing was checked.
    audit: Option<Audit>,
    /// The findings.
    pub findings: Vec<Finding>,
    summary: Summary,
    lineage: Option<Origins>,
    /// The artifact of the audit.
    pub digest: Option<ArtifactId>,
    /// Computing time, s.
    pub seconds: Option<f64>,
    /// The rows of the dataset, for figures.
    rows: Option<SourceRows>,
}

impl AuditReport {
    /// Reads the content of an audit.
    ///
    /// # Errors
    /// When an attribute is invalid.
    pub fn new(dataset: &str, audit: Audit) -> Result<Self, CliError> {
        let unreadable = |error: AttributeError| CliError::failure(format!("cannot read the audit: {error}"));
        Ok(Self {
            dataset: dataset.to_owned(),
            findings: audit.findings.value().map_err(unreadable)?,
            summary: audit.summary.value().map_err(unreadable)?,
            audit: Some(audit),
            lineage: None,
            digest: None,
            seconds: None,
            rows: None,
        })
    }

    /// Reads the artifact of an audit in a store, with the time that it took.
    ///
    /// # Errors
    /// When the artifact cannot be read, or an attribute is invalid.
    pub fn of(artifact: &Artifact, dataset: &str) -> Result<Self, CliError> {
        Ok(Self {
            seconds: artifact.measurements()?.first().map(|(_, seconds)| *seconds),
            digest: Some(artifact.digest()),
            ..Self::new(dataset, Audit::read(artifact)?)?
        })
    }

    /// The report of a finding that prevented all checks.
    pub fn only(dataset: &str, finding: Finding) -> Self {
        Self {
            dataset: dataset.to_owned(),
            audit: None,
            findings: vec![finding],
            summary: Summary::default(),
            lineage: None,
            digest: None,
            seconds: None,
            rows: None,
        }
    }

    /// Adds the rows for figures; unreadable rows are a finding already.
    pub fn with_rows_of(mut self, dataset: Audited<'_>) -> Self {
        self.rows = self.audit.as_ref().and_then(|audit| rows(dataset, audit).ok());
        self
    }

    /// Adds the origins of the dataset.
    pub fn add(&mut self, lineage: &Lineage) {
        let mut seeds: Vec<String> = lineage.seeds.values().cloned().collect();
        seeds.sort_unstable();
        seeds.dedup();
        self.lineage = Some(Origins {
            artifacts: lineage.artifacts,
            seeds,
            from_files: lineage.from_files,
        });
        self.findings.extend(lineage.findings.iter().cloned());
        sort(&mut self.findings);
    }

    /// Describes the audit for programs.
    pub fn document(&self, files: &[PathBuf]) -> Value {
        json!({
            "dataset": self.dataset,
            "findings": self.findings,
            "summary": self.summary,
            "provenance": self.lineage,
            "artifact": self.digest.map(|digest| digest.to_string()),
            "seconds": self.seconds,
            "files": files,
        })
    }

    /// Describes the audit for people.
    pub fn text(&self, files: &[PathBuf]) -> Text {
        let mut text = Text::new();
        if self.findings.is_empty() {
            text.line("no findings");
        } else {
            let mut table = table::table(&HEADER, &["count"]).flowing(&HEADER[3..]);
            self.findings.iter().for_each(|finding| {
                table.add_row(cells(finding));
            });
            text.table(table);
        }
        text.line("").line(self.lines().join("\n"));
        if !files.is_empty() {
            let files: Vec<String> = files.iter().map(|file| file.display().to_string()).collect();
            text.line("").line(format!("written:\n  {}", files.join("\n  ")));
        }
        text
    }

    fn lines(&self) -> Vec<String> {
        let summary = &self.summary;
        if summary.samples == 0 {
            return vec!["nothing else was checked".to_owned()];
        }
        let mut lines = vec![self.labels_line(), self.resimulated_line()];
        let spread = &summary.displacement;
        lines.push(format!(
            "{} without symmetric images, {}; largest displacement up to {:.3} mm; {} in the {} bins of the histogram",
            table::counted(summary.orbits as u64, "patterns"),
            table::counted(summary.repeats as u64, "repeats"),
            spread.edges.last().copied().unwrap_or(0.0),
            table::counted(spread.gaps as u64, "gaps"),
            spread.counts.len()
        ));
        if !summary.splits.is_empty() {
            let parts: Vec<String> = summary.splits.iter().map(|(name, n)| format!("{name} {n}")).collect();
            lines.push(format!("parts: {}", parts.join(", ")));
        }
        if let Some(origins) = &self.lineage {
            let seeds = counted(origins.seeds.len(), "seeds");
            let source = match (origins.seeds.is_empty(), origins.from_files) {
                (true, true) => "files".to_owned(),
                (false, true) => format!("{seeds} of samples and files"),
                (_, false) => format!("{seeds} of samples"),
            };
            lines.push(format!("made from {} artifacts; sources: {source}", origins.artifacts));
        }
        lines
    }

    fn labels_line(&self) -> String {
        let summary = &self.summary;
        let took = self
            .seconds
            .map_or(String::new(), |s| format!(" in {}", table::seconds(s)));
        let mut line = format!(
            "{} checked{took}; mesh: {}; {} solved again on it",
            counted(summary.samples, "samples"),
            summary.made_by,
            summary.solved_again
        );
        if summary.compared > 0 {
            line += &format!(
                "; {} compared with one biquadratic element per cell, {} suspicious ones solved again",
                summary.compared,
                summary.suspects - summary.unsolved
            );
            if summary.unsolved > 0 {
                line += &format!(
                    "; {} more suspicious ones not, since few of the others were wrong",
                    summary.unsolved
                );
            }
        }
        line
    }

    fn resimulated_line(&self) -> String {
        let found = &self.summary.resimulated;
        if found.samples == 0 {
            return "no samples on a finer mesh: the error of the mesh was not checked".to_owned();
        }
        let mm = |value: Option<f64>| value.map_or("-".to_owned(), |mm| format!("{} mm", error_digits(mm)));
        let allowed = match found.allowed {
            Some(_) => format!("; allowed up to {}", mm(found.allowed)),
            None => "; no accuracy is declared".to_owned(),
        };
        format!(
            "{} on a finer mesh: largest error {}, mean error {}{allowed}; {}",
            counted(found.samples, "random samples"),
            mm(found.largest_error),
            mm(found.mean_error),
            checks_in_words(
                [found.samples, found.faults],
                found.excluded_above,
                self.summary.samples
            )
        )
    }

    /// Writes the page and its figures; returns their paths. It warns of files of figures that cannot be written.
    ///
    /// # Errors
    /// When the page cannot be written.
    pub fn write(&self, folder: &Path, output: &Output) -> Result<Vec<PathBuf>, CliError> {
        let mut page = Page::new(&format!("Audit of {}", self.dataset));
        let rows: Vec<Vec<String>> = self.findings.iter().map(|finding| cells(finding).to_vec()).collect();
        if rows.is_empty() {
            page.line("No findings.");
        } else {
            page.table(&HEADER, &rows);
        }
        page.lines(&self.lines());
        let mut files = Vec::new();
        if let Some(figure) = self.audit.as_ref().and_then(audit_figure) {
            let path = folder.join("audit.png");
            files.extend(write::drawn(path, |path| figure.sheet()?.write_png(path), output));
            page.charts(&figure.charts()?);
            page.note("Coverage of the dataset, and its errors compared with a finer mesh");
        }
        for finding in &self.findings {
            let Some((row, membrane)) = self.example(finding) else {
                continue;
            };
            let path = folder.join(format!("{}-{row}.png", finding.check));
            let title = format!("{}: row {row}, as stored", finding.check);
            let drawing = membrane_sheet(&title, &membrane);
            files.extend(write::drawn(path, |path| drawing.write_png(path), output));
            page.figure(&title, &drawing.svg(&title));
        }
        let path = folder.join("audit.html");
        write::file(&path, page.finish().as_bytes())?;
        files.insert(0, path);
        Ok(files)
    }

    /// Finds the first example that can be drawn.
    fn example(&self, finding: &Finding) -> Option<(u64, DeformedMembrane)> {
        let rows = self.rows.as_ref()?;
        // Rows that did not converge have no field.
        let examples = finding.examples.iter().filter(|_| finding.check != "not-converged");
        examples.copied().find_map(|row| {
            let (cells, displacement) = rows.row(usize::try_from(row).ok()?)?;
            let membrane = DeformedMembrane::new(&cells, &displacement, Background::of(&rows.scene), Vec::new());
            Some((row, membrane.ok()?))
        })
    }
}

const HEADER: [&str; 5] = ["severity", "check", "count", "rows", "what"];

fn cells(finding: &Finding) -> [String; 5] {
    const SHOWN: usize = 8;
    let mut rows: Vec<String> = finding.examples.iter().take(SHOWN).map(ToString::to_string).collect();
    if finding.count > rows.len() as u64 && !rows.is_empty() {
        rows.push("…".to_owned());
    }
    [
        Severity::name(finding.severity).to_owned(),
        finding.check.clone(),
        finding.count.to_string(),
        rows.join(" "),
        finding.message.clone(),
    ]
}

fn counted(n: usize, unit: &str) -> String {
    table::counted(n as u64, unit)
}
