//! The key `without` of stages that read datasets: rows that an audit found, or that a user has marked on the page, are
//! left out.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::audit;
use super::files::NamedFile;
use deaflow_base::{ArtifactId, Canonical, Digest, InputError, Node, Parameter, Schema, read_bounded};
use deaflow_content::{ArtifactKind, Audit, DroppedRows, Lines};
use deaflow_dataset::audit::Severity;
use deaflow_orchestrator::{StageDeclaration, StageError, WITHOUT, names_stage};
use deaflow_store::Artifact;

/// The kinds of stages that list rows to leave out.
pub const LISTING: &[&str] = &["audit"];

/// The first line of a list of marked rows, before the digest of the dataset.
const HEADER: &str = "# rows of ";

/// The largest list of marked rows, bytes.
const MOST_BYTES: u64 = 64 << 20;

/// The largest number of items of the key.
const MOST_ITEMS: usize = 1000;

/// The reason of a row that a user has marked.
const MARKED: &str = "marked";

/// The value of the key: lists of marked rows. The audits that it names are inputs of the stage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Without {
    lists: Vec<MarkedRows>,
}

/// Rows of a dataset that a user has marked.
#[derive(Clone, Debug)]
struct MarkedRows {
    /// The item that names the file.
    item: Node,
    /// Path of the file, with links resolved.
    path: PathBuf,
    dataset: ArtifactId,
    rows: BTreeSet<u64>,
}

/// The position of the item does not count.
impl PartialEq for MarkedRows {
    fn eq(&self, other: &Self) -> bool {
        self.path == other.path && self.dataset == other.dataset && self.rows == other.rows
    }
}

impl Eq for MarkedRows {}

impl MarkedRows {
    /// Reads the text of a list: the dataset in the first line, and then a row number on each line.
    fn parse(text: &str) -> Result<(ArtifactId, BTreeSet<u64>), String> {
        let mut lines = text.trim_start_matches('\u{feff}').lines();
        let dataset = lines.next().and_then(|first| first.strip_prefix(HEADER));
        let dataset = dataset.and_then(|digest| digest.trim().parse::<ArtifactId>().ok());
        let dataset = dataset.ok_or_else(|| format!("line 1 is not \"{HEADER}DIGEST\""))?;
        let mut rows = BTreeSet::new();
        for (line, number) in lines.zip(2..).map(|(text, line)| (line, text.trim())) {
            if number.is_empty() || number.starts_with('#') {
                continue;
            }
            let row = number.parse::<u64>();
            rows.insert(row.map_err(|_| format!("line {line}: \"{}\" is not a row number", number.escape_debug()))?);
        }
        Ok((dataset, rows))
    }

    fn read(node: &Node) -> Result<Self, InputError> {
        let file = NamedFile::find(node, node.file().parent().unwrap_or(Path::new("")))?;
        let advice = "the page writes such lists: \"Save the list of marked rows\" of a dataset or an audit";
        let bytes = read_bounded(&file.path, MOST_BYTES).map_err(|e| file.refused(&e, ""))?;
        let text = String::from_utf8(bytes).map_err(|_| file.refused(&"it is not a text", advice))?;
        let (dataset, rows) = Self::parse(&text).map_err(|why| file.refused(&why, advice))?;
        Ok(Self {
            item: node.clone(),
            path: file.path,
            dataset,
            rows,
        })
    }

    /// The error if the dataset of the list is not an input of the stage.
    fn of_another(&self, datasets: &[ArtifactId]) -> InputError {
        let file = self.item.text(WITHOUT).unwrap_or_default();
        let datasets: Vec<String> = datasets.iter().map(|digest| digest.short().to_string()).collect();
        let message = format!(
            "the file {file} lists rows of the dataset {}, which is not an input of this stage",
            self.dataset.short()
        );
        let help = format!("mark rows of an input anew: {}", datasets.join(", "));
        self.item.error(message).help(help)
    }

    /// Refuses the last row of the list if the dataset has fewer rows.
    fn check_row(&self, row: u64, rows: usize) -> Result<(), InputError> {
        if row < rows as u64 {
            return Ok(());
        }
        let file = self.item.text(WITHOUT).unwrap_or_default();
        let message = format!(
            "the file {file} lists row {row} of the dataset {}, which has {rows} rows",
            self.dataset.short()
        );
        let help = match rows {
            0 => "remove the file from `without`".to_owned(),
            rows => format!("allowed: rows 0 to {}", rows - 1),
        };
        Err(self.item.error(message).help(help))
    }

    fn canonical(&self) -> Canonical {
        let rows: Vec<String> = self.rows.iter().map(u64::to_string).collect();
        Canonical::map([
            ("dataset", self.dataset.to_string().as_str().into()),
            (
                "rows",
                Digest::of(rows.join(",").as_bytes()).to_string().as_str().into(),
            ),
        ])
    }
}

impl Parameter for Without {
    type Limits = ();
    type Literal = Self;

    fn read(node: &Node, key: &str, (): &()) -> Result<Self, InputError> {
        let items = node.list(key)?;
        if items.is_empty() || items.len() > MOST_ITEMS {
            let message = format!("`{key}` has {} items", items.len());
            return Err(node.error(message).help(format!("allowed: 1 to {MOST_ITEMS}")));
        }
        let mut lists = Vec::new();
        for item in items {
            if names_stage(item.text(key)?) {
                continue;
            }
            let list = MarkedRows::read(item)?;
            if lists.iter().any(|other: &MarkedRows| other.path == list.path) {
                return Err(item.error(format!("the file {} is listed twice", item.text(key)?)));
            }
            lists.push(list);
        }
        Ok(Self { lists })
    }

    /// Audits are inputs, so only lists of marked rows are part of the parameters.
    fn canonical(&self) -> Option<Canonical> {
        (!self.lists.is_empty()).then(|| self.lists.iter().map(MarkedRows::canonical).collect())
    }

    fn schema((): &()) -> Schema {
        Schema::list(Schema::text(), 1, MOST_ITEMS).distinct()
    }

    fn literal(literal: Self) -> Self {
        literal
    }
}

impl Without {
    /// Checks that the dataset of each list is an input, once the digests of all datasets are known, and that it has
    /// the rows of the list, if the dataset can be opened.
    ///
    /// # Errors
    /// If one is not or has not, with the position of its name.
    pub fn check_inputs(
        &self,
        inputs: &[(&'static str, Option<ArtifactId>)],
        open: &dyn Fn(&ArtifactId) -> Option<Artifact>,
    ) -> Result<(), InputError> {
        let datasets = inputs.iter().filter(|(kind, _)| !["audit", "train"].contains(kind));
        let Some(datasets) = datasets.map(|(_, digest)| *digest).collect::<Option<Vec<ArtifactId>>>() else {
            return Ok(());
        };
        for list in &self.lists {
            if !datasets.contains(&list.dataset) {
                return Err(list.of_another(&datasets));
            }
            let dataset = open(&list.dataset);
            let rows = dataset.and_then(|dataset| rows(&dataset).ok());
            if let (Some(rows), Some(&row)) = (rows, list.rows.last()) {
                list.check_row(row, rows)?;
            }
        }
        Ok(())
    }
}

/// Checks that each audit that a stage names audits a dataset that the stage reads, and does not stop it.
///
/// # Errors
/// If one does not, with the position of its name.
pub fn check(stage: &StageDeclaration<'_>, needs: &[StageDeclaration<'_>]) -> Result<(), InputError> {
    let Some(items) = stage.node.peek(WITHOUT) else {
        return Ok(());
    };
    let datasets: Vec<&str> = needs
        .iter()
        .filter(|need| audit::AUDITED.contains(&need.kind))
        .map(|need| need.name)
        .collect();
    for item in items.list(WITHOUT)? {
        let name = item.text(WITHOUT)?;
        let Some(audit) = needs
            .iter()
            .find(|need| need.name == name && LISTING.contains(&need.kind))
        else {
            continue;
        };
        let audited: Vec<&str> = audit.needs().map(|need| need.name).collect();
        if !audited.iter().any(|name| datasets.contains(name)) {
            let message = format!(
                "`{name}` audits `{}`, which stage `{}` does not read: its rows are others",
                audited.join("`, `"),
                stage.name
            );
            let help = format!(
                "name an audit of {}, or use `{WITHOUT}` in the stage that reads {}",
                datasets.join(" or "),
                audited.join(", ")
            );
            return Err(item.error(message).help(help));
        }
        if !audit.node.peek("fail_on").is_some_and(|word| word.is_text("never")) {
            let message = format!("`{name}` stops the stages that need it when it finds errors, so no row is dropped");
            return Err(item.error(message).help(format!("add `fail_on: never` to `{name}`")));
        }
    }
    Ok(())
}

/// The rows that a stage leaves out.
#[derive(Debug, Default)]
pub struct Dropped {
    /// The reasons, by input and row.
    rows: BTreeMap<(usize, u64), BTreeSet<String>>,
    /// One line per audit or list.
    lines: Vec<String>,
}

impl Dropped {
    /// Collects the rows that audits among the inputs found, and those that lists name.
    ///
    /// # Errors
    /// If an audit or a list is of another dataset, a row does not exist, or an audit found an error of the dataset as
    /// a whole.
    pub fn of(inputs: &[Artifact], without: Option<&Without>) -> Result<Self, StageError> {
        let mut dropped = Self::default();
        for artifact in inputs.iter().filter(|input| ArtifactKind::Audit.is_of(input)) {
            dropped.add_audit(inputs, artifact)?;
        }
        for list in without.iter().flat_map(|without| &without.lists) {
            let dataset = list.dataset.to_string();
            let (input, rows) = position(inputs, &dataset, "the list of marked rows")?;
            for &row in &list.rows {
                dropped.add((input, rows), row, MARKED)?;
            }
            let line = format!("marked rows of {}: {}", list.dataset.short(), list.rows.len());
            dropped.lines.push(line);
        }
        Ok(dropped)
    }

    fn add_audit(&mut self, inputs: &[Artifact], artifact: &Artifact) -> Result<(), StageError> {
        let findings = audit::findings(artifact)?;
        let is_whole = |finding: &&audit::Finding| finding.severity == Severity::Error && finding.examples.is_empty();
        if let Some(finding) = findings.iter().find(is_whole) {
            return Err(StageError::input(format!(
                "an error of the dataset as a whole cannot be dropped with rows: {}: {}",
                finding.check, finding.message
            )));
        }
        let view = Audit::open(artifact)?;
        let dataset = view.dataset().read()?.unwrap_or_default();
        let at = position(inputs, &dataset, &format!("the audit {}", artifact.digest().short()))?;
        let (rows, checks) = (view.wrong().row().read()?, view.wrong().check().read()?);
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        for (row, check) in rows.iter().zip(&checks) {
            self.add(at, *row, check)?;
            *counts.entry(check).or_default() += 1;
        }
        let counts: Vec<String> = counts.iter().map(|(check, count)| format!("{check} {count}")).collect();
        let counts = if counts.is_empty() {
            "none".to_owned()
        } else {
            counts.join(", ")
        };
        self.lines
            .push(format!("audit {}: {counts}", artifact.digest().short()));
        Ok(())
    }

    fn add(&mut self, (input, rows): (usize, usize), row: u64, why: &str) -> Result<(), StageError> {
        if row >= rows as u64 {
            return Err(StageError::input(format!(
                "row {row} of input {} does not exist: it has {rows} rows",
                input + 1
            )));
        }
        self.rows.entry((input, row)).or_default().insert(why.to_owned());
        Ok(())
    }

    /// Whether a row of an input is left out.
    pub fn has(&self, input: usize, row: usize) -> bool {
        self.rows.contains_key(&(input, row as u64))
    }

    /// Returns what the artifact says of it: the rows and their reasons, and a line per audit or list; nothing if the
    /// stage has no `without`.
    pub fn content(&self) -> (Option<DroppedRows>, Option<Lines>) {
        if self.lines.is_empty() {
            return (None, None);
        }
        let why = |reasons: &BTreeSet<String>| reasons.iter().cloned().collect::<Vec<_>>().join(", ");
        let rows = DroppedRows {
            input: self.rows.keys().map(|(input, _)| *input as u64).collect(),
            row: self.rows.keys().map(|(_, row)| *row).collect(),
            why: self.rows.values().map(why).collect(),
        };
        let count = self.rows.len();
        let total = format!("{count} {} dropped", if count == 1 { "row" } else { "rows" });
        let lines = std::iter::once(total).chain(self.lines.iter().cloned());
        (Some(rows), Some(Lines(lines.collect())))
    }
}

/// Returns the number of inputs before the audits, which are the last.
pub fn datasets(inputs: &[Artifact]) -> usize {
    let is_audit = |input: &Artifact| ArtifactKind::Audit.is_of(input);
    inputs.iter().position(is_audit).unwrap_or(inputs.len())
}

/// Returns the index of a dataset among the inputs, and its number of rows.
fn position(inputs: &[Artifact], dataset: &str, what: &str) -> Result<(usize, usize), StageError> {
    let found = inputs
        .iter()
        .enumerate()
        .find(|(_, input)| input.digest().to_string() == dataset);
    let Some((index, artifact)) = found else {
        let short: String = dataset.chars().take(12).collect();
        return Err(StageError::input(format!(
            "{what} is of the dataset {short}, which is not an input of this stage"
        )));
    };
    Ok((index, rows(artifact)?))
}

/// Returns the number of rows of a dataset.
fn rows(dataset: &Artifact) -> Result<usize, StageError> {
    let shape = &dataset.content("patterns")?.shape;
    Ok(shape.first().copied().unwrap_or(0))
}
