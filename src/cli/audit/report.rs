//! What an audit says, as a table, as JSON and as a page.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::{Value, json};

use crate::error::CliError;
use crate::text::Text;
use crate::{table, write};
use deaflow_base::ArtifactId;
use deaflow_content::{AttributeError, Audit};
use deaflow_report::figures::{Ground, Membrane, draw_audit, membrane_drawing};
use deaflow_report::{Page, audited};
use deaflow_stage::audit::{Audited, Finding, Lineage, Severity, SourceRows, Summary, rows, sort};

/// What a dataset goes back to.
#[derive(Debug, Serialize)]
struct Origins {
    /// Artifacts that it was made from, chunks included.
    artifacts: usize,
    /// The seeds of its samples, each once.
    seeds: Vec<String>,
    /// Whether any of it was read from files of a person.
    from_files: bool,
}

/// An audit that has been carried out.
pub struct Answer {
    dataset: String,
    /// What the artifact says; none where nothing was looked at.
    audit: Option<Audit>,
    /// What is wrong.
    pub findings: Vec<Finding>,
    summary: Summary,
    lineage: Option<Origins>,
    /// The audit's artifact.
    pub digest: Option<ArtifactId>,
    /// What it took, s.
    pub seconds: Option<f64>,
    /// The rows of the dataset, for figures.
    rows: Option<SourceRows>,
}

impl Answer {
    /// From what the artifact of an audit says.
    pub fn of(dataset: &str, audit: Audit) -> Result<Self, AttributeError> {
        Ok(Self {
            dataset: dataset.to_owned(),
            findings: audit.findings.value()?,
            summary: audit.summary.value()?,
            audit: Some(audit),
            lineage: None,
            digest: None,
            seconds: None,
            rows: None,
        })
    }

    /// A finding because of which nothing else was looked at.
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

    /// Adds the rows, from which figures are drawn. Where they cannot be read, a finding says so and there is none.
    pub fn with_rows_of(mut self, dataset: Audited<'_>) -> Self {
        self.rows = self.audit.as_ref().and_then(|audit| rows(dataset, audit).ok());
        self
    }

    /// Adds where the dataset comes from.
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

    /// For programs.
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

    /// For people.
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
            return vec!["nothing else was looked at".to_owned()];
        }
        let mut lines = vec![self.labels_line(), self.resimulated_line()];
        let spread = &summary.displacement;
        lines.push(format!(
            "{} patterns different under the symmetries, {} repeats; largest displacement up to {:.3} mm; {} of {} bins are \
             empty although fuller ones lie on both sides",
            summary.orbits,
            summary.repeats,
            spread.edges.last().copied().unwrap_or(0.0),
            spread.gaps,
            spread.counts.len()
        ));
        if !summary.splits.is_empty() {
            let parts: Vec<String> = summary.splits.iter().map(|(name, n)| format!("{name} {n}")).collect();
            lines.push(format!("parts: {}", parts.join(", ")));
        }
        if let Some(origins) = &self.lineage {
            let seeds = counted(origins.seeds.len(), "seed");
            let back_to = match (origins.seeds.is_empty(), origins.from_files) {
                (true, true) => "files".to_owned(),
                (false, true) => format!("{seeds} of samples and to files"),
                (_, false) => format!("{seeds} of samples"),
            };
            lines.push(format!("made from {} artifacts, back to {back_to}", origins.artifacts));
        }
        lines
    }

    fn labels_line(&self) -> String {
        let summary = &self.summary;
        let took = self
            .seconds
            .map_or(String::new(), |s| format!(" in {}", table::seconds(s)));
        let mut line = format!(
            "{} audited{took}; mesh: {}; {} solved again on it",
            counted(summary.samples, "sample"),
            summary.made_by,
            summary.solved_again
        );
        if summary.compared > 0 {
            line += &format!(
                "; {} compared with one biquadratic element per cell, of which {} stood out and were solved again",
                summary.compared,
                summary.suspects - summary.unsolved
            );
            if summary.unsolved > 0 {
                line += &format!(
                    "; {} more that stood out were not, since few of the others were wrong",
                    summary.unsolved
                );
            }
        }
        line
    }

    fn resimulated_line(&self) -> String {
        let found = &self.summary.resimulated;
        if found.samples == 0 {
            return "no random sample on a finer mesh: the error of the mesh is not looked at".to_owned();
        }
        let mm = |value: Option<f64>| value.map_or("-".to_owned(), |mm| format!("{mm:.2e} mm"));
        let allowed = match found.allowed {
            Some(_) => format!("; allowed up to {}", mm(found.allowed)),
            None => "; nothing is declared".to_owned(),
        };
        format!(
            "{} on a finer mesh: error {} at the most, {} in the mean{allowed}; {} at fault: with 95 % confidence at most {:.2} % of \
             all labels are",
            counted(found.samples, "random sample"),
            mm(found.largest_error),
            mm(found.mean_error),
            found.faults,
            100.0 * found.excluded_above
        )
    }

    /// Writes the page and its figures; gives their paths.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, CliError> {
        let mut page = Page::new(&format!("Audit of {}", self.dataset));
        let rows: Vec<Vec<String>> = self.findings.iter().map(|finding| cells(finding).to_vec()).collect();
        if rows.is_empty() {
            page.line("No findings.");
        } else {
            page.table(&HEADER, &rows);
        }
        page.lines(&self.lines());
        let mut files = Vec::new();
        if let Some(figure) = self.audit.as_ref().and_then(audited) {
            let path = folder.join("audit.png");
            draw_audit(&path, &figure)?;
            page.charts(&figure.charts()?);
            page.note("What the dataset covers, and its errors against a finer mesh");
            files.push(path);
        }
        for finding in &self.findings {
            let Some((row, membrane)) = self.example(finding) else {
                continue;
            };
            let path = folder.join(format!("{}-{row}.png", finding.check));
            let title = format!("{}: row {row}, as stored", finding.check);
            let drawing = membrane_drawing(&title, &membrane);
            drawing.write_png(&path)?;
            page.figure(&title, &drawing.svg(&title));
            files.push(path);
        }
        let path = folder.join("audit.html");
        write::file(&path, page.finish().as_bytes())?;
        files.insert(0, path);
        Ok(files)
    }

    /// The first example that can be drawn.
    fn example(&self, finding: &Finding) -> Option<(u64, Membrane)> {
        let rows = self.rows.as_ref()?;
        // Rows without a field have none to draw.
        let examples = finding.examples.iter().filter(|_| finding.check != "not-converged");
        examples.copied().find_map(|row| {
            let (cells, displacement) = rows.row(usize::try_from(row).ok()?)?;
            let membrane = Membrane::new(&cells, &displacement, Ground::of(&rows.scene), Vec::new());
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
    format!("{n} {unit}{}", if n == 1 { "" } else { "s" })
}
