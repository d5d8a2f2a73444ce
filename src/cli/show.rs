//! `deaflow show`: the content of an artifact or a result file.

mod corners;
mod file;

use std::collections::BTreeMap;
use std::path::Path;

use clap::Args;
use serde::Serialize;

use super::arguments::{StoreArguments, has_hdf5_extension};
use super::audit::AuditReport;
use super::statistics::{self, Statistics};
use super::text::Text;
use super::{CliError, Exit, Output, csv, locate, table};
use deaflow_base::with_minus;
use deaflow_content::{ArtifactKind, Table};
use deaflow_pattern::has_patterns;
use deaflow_report::{ResultTable, Rows};
use deaflow_store::{Artifact, Content, Lookup, Store, StoreError};

/// Show the content of an artifact or a result file: datasets, statistics, provenance
#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow show solved",
    "deaflow show pipeline.yaml:design --csv",
    "deaflow show simulated.h5"
))]
pub struct ShowArguments {
    /// A stage of the last run, PIPELINE.yaml:STAGE, a digest or its first digits, at least 4; or an HDF5 file: an
    /// artifact,
    /// or the output of `solve` or `predict`
    #[arg(value_name = "STAGE|DIGEST|FILE.h5")]
    pub artifact: String,
    /// Print the values of each row as a CSV table
    #[arg(long)]
    pub csv: bool,
    /// Print the displacement of each corner of the cells as a CSV table, in the columns that an `import` stage reads
    #[arg(long, conflicts_with_all = ["csv", "along"])]
    pub corners: bool,
    /// The axis of the rows [default: the one that most arrays have]
    #[arg(long, value_name = "AXIS", requires = "csv")]
    pub along: Option<String>,
    #[command(flatten)]
    pub store: StoreArguments,
}

/// Up to this many different texts are listed with their counts.
const MAX_TEXTS: usize = 6;

/// Rows of a table stage that are shown.
const MAX_ROWS: usize = 20;

pub fn execute(arguments: &ShowArguments, output: &Output) -> Result<Exit, CliError> {
    let file = Path::new(&arguments.artifact);
    let (artifact, record) = if has_hdf5_extension(file) {
        check_exists(file)?;
        if !Artifact::is_at(file) {
            return file::execute(file, arguments, output);
        }
        (of_file(file)?, None)
    } else {
        refuse_pattern(file)?;
        let store = locate::existing_store(&arguments.store.folder_of_any([&arguments.artifact]))?;
        let artifact = locate::artifact(&store, &arguments.artifact)?;
        let record = record(&store, &artifact)?;
        (artifact, Some(record))
    };
    if arguments.corners && !output.is_json() {
        let scene = artifact.attributes().get("scene").map(String::as_str);
        return corners::print(&artifact, scene, output);
    }
    if arguments.csv && !output.is_json() {
        return show_rows(&artifact, arguments, output);
    }
    // Audits of earlier versions have other arrays: their attributes are shown as they are.
    let audit = ArtifactKind::Audit
        .is_of(&artifact)
        .then(|| AuditReport::of(&artifact, &arguments.artifact));
    let audit = audit.and_then(Result::ok);
    let summary = Summary {
        audit,
        ..Summary::of(&artifact, record)?
    };
    print(&summary, output)
}

/// Opens an artifact by its file. The chunks of an artifact are next to it only in a store.
fn of_file(file: &Path) -> Result<Artifact, CliError> {
    let artifact = Artifact::open(file)?;
    match artifact.chunks() {
        Err(StoreError::Missing { .. }) => {
            let (file, parts) = (file.display(), artifact.parts().len());
            let message = format!("{file} lists the {parts} chunks of an artifact, which are missing");
            Err(CliError::bad_input(message)
                .help("write a standalone file with: deaflow export artifact STAGE -o FILE.h5"))
        }
        Err(error) => Err(error.into()),
        Ok(_) => Ok(artifact),
    }
}

/// Refuses a pattern or a table.
fn refuse_pattern(file: &Path) -> Result<(), CliError> {
    let is_pattern = has_patterns(file) && !has_hdf5_extension(file);
    match is_pattern && file.is_file() {
        false => Ok(()),
        true => Err(
            CliError::bad_input(format!("{} is a pattern or a table, not an artifact", file.display()))
                .help("simulate a pattern with `deaflow solve SCENE.yaml PATTERN`"),
        ),
    }
}

fn check_exists(file: &Path) -> Result<(), CliError> {
    match file.is_file() {
        true => Ok(()),
        false => Err(CliError::bad_input(format!("there is no file {}", file.display()))
            .help("name an HDF5 file, a stage of the last run, PIPELINE.yaml:STAGE, or a digest")),
    }
}

fn print(summary: &Summary, output: &Output) -> Result<Exit, CliError> {
    output.result(|| summary, || summary.text())
}

fn show_rows(artifact: &Artifact, arguments: &ShowArguments, output: &Output) -> Result<Exit, CliError> {
    if ArtifactKind::Table.is_of(artifact) && arguments.along.is_none() {
        let table = Table::read(artifact)?;
        output.plain(&csv::of_table(&ResultTable::new(table))?)?;
        return Ok(Exit::Done);
    }
    print_rows(&Rows::of(artifact, arguments.along.as_deref())?, output)
}

fn print_rows(rows: &Rows, output: &Output) -> Result<Exit, CliError> {
    output.plain(&csv::text(&rows.header(), rows.texts())?)?;
    if !rows.left_out.is_empty() {
        let list = rows.left_out.join(", ");
        output.note(&format!("omitted, without the axis `{}`: {list}", rows.axis));
    }
    Ok(Exit::Done)
}

/// The description of an artifact or a result file.
#[derive(Serialize)]
struct Summary {
    /// None for a file that is not an artifact.
    digest: Option<String>,
    path: String,
    attributes: BTreeMap<String, String>,
    parts: Vec<String>,
    datasets: Vec<DatasetSummary>,
    provenance: BTreeMap<String, String>,
    /// The state of the record of the action that made it; none without a store.
    record: Option<String>,
    /// The first rows of the table of a table stage.
    #[serde(skip)]
    table: Option<String>,
    /// The findings of an audit, in place of the attributes that have them as JSON.
    #[serde(skip)]
    audit: Option<AuditReport>,
}

/// The attributes of an audit that have its results as JSON.
const AUDIT_JSON: [&str; 2] = ["findings", "summary"];

/// Describes the record of the action that made an artifact.
fn record(store: &Store, artifact: &Artifact) -> Result<String, CliError> {
    let provenance = artifact.provenance()?;
    let Some(key) = provenance.get("action").and_then(|key| key.parse().ok()) else {
        return Ok("not made by an action".to_owned());
    };
    Ok(match store.record(&key)? {
        Lookup::Absent => "missing".to_owned(),
        Lookup::Damaged(why) => format!("invalid: {why}"),
        Lookup::Found(record, _) if record.artifact == artifact.digest() => "valid".to_owned(),
        Lookup::Found(record, _) => format!("names another artifact: {}", record.artifact.short()),
    })
}

#[derive(Serialize)]
struct DatasetSummary {
    path: String,
    #[serde(rename = "type")]
    kind: &'static str,
    shape: Vec<usize>,
    units: String,
    description: String,
    statistics: Statistics,
}

impl Summary {
    fn of(artifact: &Artifact, record: Option<String>) -> Result<Self, CliError> {
        let dataset = |content: &Content| -> Result<DatasetSummary, CliError> {
            Ok(DatasetSummary {
                path: content.path.clone(),
                kind: content.kind.name(),
                shape: content.shape.clone(),
                units: content.units.clone(),
                description: content.description.clone(),
                statistics: statistics::of_dataset(artifact, &content.path)?,
            })
        };
        Ok(Self {
            digest: Some(artifact.digest().to_string()),
            path: artifact.path().display().to_string(),
            attributes: artifact.attributes().clone(),
            parts: artifact.parts().iter().map(ToString::to_string).collect(),
            datasets: artifact.contents()?.iter().map(dataset).collect::<Result<_, _>>()?,
            provenance: artifact.provenance()?,
            record,
            table: match ArtifactKind::Table.is_of(artifact) {
                true => Some(first_rows(&ResultTable::new(Table::read(artifact)?))),
                false => None,
            },
            audit: None,
        })
    }

    fn text(&self) -> Text {
        let mut text = Text::from(match &self.digest {
            Some(digest) => format!("artifact {digest}\n  {}", self.path),
            None => format!("file {}", self.path),
        });
        if !self.parts.is_empty() {
            text.line(format!(
                "  combined from {}",
                table::counted(self.parts.len() as u64, "chunks")
            ));
        }
        text.line("");
        let list = |title: &str, entries: &BTreeMap<String, String>| {
            let width = entries.keys().map(|k| k.chars().count()).max().unwrap_or(0);
            let lines = entries.iter().filter(|(_, value)| !value.is_empty());
            let lines: Vec<String> = lines
                .map(|(name, value)| {
                    format!(
                        "  {name:<width$}  {}",
                        value.replace('\n', &format!("\n  {:width$}  ", ""))
                    )
                })
                .collect();
            format!("{title}\n{}\n", lines.join("\n"))
        };
        let mut attributes = self.attributes.clone();
        if let Some(audit) = &self.audit {
            attributes.retain(|name, _| !AUDIT_JSON.contains(&name.as_str()));
            text.append(audit.text(&[]));
            text.line("");
        }
        if !attributes.is_empty() {
            text.line(list("attributes", &attributes));
        }
        if let Some(table) = &self.table {
            text.line(table);
            text.line("");
        }
        self.table(&mut text);
        text.line("");
        if !self.provenance.is_empty() {
            let mut provenance = self.provenance.clone();
            if let Some(seconds) = provenance.get_mut("seconds").filter(|_| !self.parts.is_empty()) {
                *seconds += " (sum over all chunks, which may have run in parallel)";
            }
            text.line(list("provenance", &provenance));
        }
        if let Some(record) = &self.record {
            text.line(format!("record: {record}"));
        }
        text
    }

    fn table(&self, text: &mut Text) {
        let mut table = table::table(
            &["dataset", "type", "shape", "unit", "min", "mean", "max"],
            &["min", "mean", "max"],
        )
        .dispensable(&["type", "mean"]);
        let mut counted = Vec::new();
        for dataset in &self.datasets {
            let shape: Vec<String> = dataset.shape.iter().map(ToString::to_string).collect();
            let statistics = match &dataset.statistics {
                // The columns of a table have different units.
                Statistics::Numbers { .. } if self.table.is_some() => ["-", "-", "-"].map(str::to_owned),
                Statistics::Numbers { min, mean, max } => [number(*min), number(*mean), number(*max)],
                Statistics::Texts { counts } => {
                    counted.push(counts_line(&dataset.path, counts));
                    ["-", "-", "-"].map(str::to_owned)
                }
                Statistics::None {} => ["-", "-", "-"].map(str::to_owned),
            };
            let cells = [
                dataset.path.clone(),
                dataset.kind.to_owned(),
                shape.join(" × "),
                dataset.units.clone(),
            ];
            table.add_row(cells.into_iter().chain(statistics));
        }
        text.table(table);
        for line in counted {
            text.line(line);
        }
    }
}

/// Writes the first rows of a table, with its columns and their units.
fn first_rows(table: &ResultTable) -> String {
    let rows = table.text(MAX_ROWS);
    match table.rows.len().saturating_sub(MAX_ROWS) {
        0 => rows,
        more => format!(
            "{rows}\nand {}: --csv prints all",
            table::counted(more as u64, "more rows")
        ),
    }
}

fn counts_line(path: &str, counts: &BTreeMap<String, u64>) -> String {
    if counts.len() > MAX_TEXTS {
        return format!("  {path}: {} different texts", counts.len());
    }
    let shown = |text: &String| match text.is_empty() {
        true => "(empty)".to_owned(),
        false => text.clone(),
    };
    let counts: Vec<String> = counts.iter().map(|(text, n)| format!("{} {n}", shown(text))).collect();
    format!("  {path}: {}", counts.join(", "))
}

/// Formats a number with five digits.
fn number(value: f64) -> String {
    let magnitude = value.abs();
    if value == 0.0 || (magnitude < 1e9 && value.fract() == 0.0) {
        return with_minus(&(value + 0.0).to_string());
    }
    if !(1e-3..1e6).contains(&magnitude) {
        return with_minus(&format!("{value:.3e}"));
    }
    let decimals = (4 - magnitude.log10().floor() as i32).clamp(0, 7) as usize;
    with_minus(&format!("{value:.decimals$}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        for (value, text) in [
            (0.0, "0"),
            (-0.0, "0"),
            (3.0, "3"),
            (2.123_456_7, "2.1235"),
            (1_234.567_8, "1234.6"),
            (-1e-9, "−1.000e−9"),
            (0.012_345_67, "0.012346"),
        ] {
            assert_eq!(number(value), text);
        }
    }
}
