//! A computation on patterns that writes an HDF5 file and reports: the part that `solve` in all its forms and `predict`
//! share.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::{Value, json};

use super::progress::Bar;
use super::text::Text;
use super::{CliError, Exit, Output, table, write};
use deaflow_orchestrator::Environment;
use deaflow_report::figures::FigureError;
use deaflow_store::{Object, Provenance, write_file};

/// A running computation.
pub struct Job<'a> {
    /// The command, for the provenance of the file.
    command: &'static str,
    /// The HDF5 file to write, if any.
    file: Option<&'a Path>,
    start: Instant,
    /// A figure that was drawn, if any.
    pub figure: Option<PathBuf>,
    /// Its progress bar.
    pub bar: Bar,
}

/// What a computation found, ready to be written and reported.
pub struct JobResult<'a> {
    /// Number of patterns.
    pub patterns: usize,
    /// The arrays. Unlike those of an artifact they may hold NaN, in rows without a solution.
    pub arrays: Object,
    /// How they were made, for the provenance.
    pub parameters: String,
    /// The table and the figure next to the file.
    pub attachments: Option<Attachments<'a>>,
    /// Warnings about the model, one line each.
    pub warnings: Vec<String>,
    /// The report for programs.
    pub document: Value,
    /// The report for people.
    pub text: Text,
    /// How the command ends.
    pub exit: Exit,
}

/// A table and a figure that are written next to an HDF5 file.
pub struct Attachments<'a> {
    /// The title of the table.
    pub title: &'static str,
    /// The table as comma-separated values.
    pub table: String,
    /// Draws the figure into a file.
    pub draw: DrawFigure<'a>,
}

/// Draws a figure into a file.
pub type DrawFigure<'a> = Box<dyn FnOnce(&Path) -> Result<(), FigureError> + 'a>;

/// The table and the figure that belong to an HDF5 file.
pub fn attached_files(file: &Path) -> [PathBuf; 2] {
    [file.with_extension("csv"), file.with_extension("png")]
}

impl<'a> Job<'a> {
    /// Starts a job of so many steps.
    pub fn start(command: &'static str, file: Option<&'a Path>, name: &str, steps: usize) -> Self {
        Self {
            command,
            file,
            start: Instant::now(),
            figure: None,
            bar: Bar::new(name, "patterns", steps as u64),
        }
    }

    /// Counts the time from an earlier start.
    pub fn since(self, start: Instant) -> Self {
        Self { start, ..self }
    }

    /// Writes the files and prints the report.
    ///
    /// # Errors
    /// When a file or the report cannot be written.
    pub fn finish(self, result: JobResult<'_>, output: &Output) -> Result<Exit, CliError> {
        self.bar.clear();
        let seconds = self.start.elapsed().as_secs_f64();
        let mut document = json!({ "file": self.file, "warnings": result.warnings, "seconds": seconds });
        let mut files = Vec::new();
        if let Some(file) = self.file {
            let provenance = provenance(self.command, result.parameters.clone(), seconds);
            write_file(file, &result.arrays, &provenance)?;
            files.push(file.display().to_string());
            if let Some(Attachments {
                title,
                table: rows,
                draw,
            }) = result.attachments
            {
                let [table, figure] = attached_files(file);
                let source = format!("{}; {}", file.display(), result.parameters);
                write::csv(&table, rows.as_bytes(), title, &source)?;
                files.push(write::with_metadata(&table));
                let figure = write::drawn(figure, draw, output);
                files.extend(figure.iter().map(|figure| figure.display().to_string()));
                extend(&mut document, json!({ "table": table, "figure": figure }));
            }
        }
        if let Some(figure) = self.figure {
            files.push(figure.display().to_string());
            extend(&mut document, json!({ "figure": figure }));
        }
        extend(&mut document, result.document);
        let text = || {
            let patterns = table::counted(result.patterns as u64, "patterns");
            let done = format!("{patterns} in {}", table::seconds(seconds));
            let mut text = Text::from(match files.is_empty() {
                true => done,
                false => format!("{}: {done}", files.join(", ")),
            });
            text.append(result.text);
            for warning in &result.warnings {
                text.line(format!("model warning: {warning}"));
            }
            text
        };
        output.result(|| document, text)?;
        Ok(result.exit)
    }
}

/// Adds the keys of one JSON object to another.
pub fn extend(document: &mut Value, other: Value) {
    if let (Value::Object(document), Value::Object(other)) = (document, other) {
        document.extend(other);
    }
}

/// Records who made a file, when and how.
pub fn provenance(kind: &str, parameters: String, seconds: f64) -> Provenance {
    let environment = Environment::system();
    Provenance {
        created: environment.now(),
        host: environment.host,
        version: environment.version,
        build: environment.build,
        target: environment.target,
        seconds,
        kind: kind.to_owned(),
        parameters,
        ..Provenance::default()
    }
}

/// The computing time of each of some patterns that were solved in parallel since `start`, in s.
pub fn seconds_each(start: Instant, patterns: usize) -> impl Iterator<Item = f64> {
    // Threads in excess of the patterns were idle.
    let busy = rayon::current_num_threads().min(patterns);
    std::iter::repeat_n(start.elapsed().as_secs_f64() * busy as f64 / patterns as f64, patterns)
}
