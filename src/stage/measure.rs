//! `kind: measure` reads measurements from files: tests of specimens, and displacements of devices.
//!
//! The key depends on the numbers and on what is known about each file. The files are read once, so that the result is
//! as planned even if a file changes in the meantime.

use std::path::Path;

use super::files::NamedFile;
use super::measured::curve::Noise;
use super::measured::{MeasuredFile, MeasuredTable, Measurement, named_notes};
use super::results::named;
use deaflow_base::{Canonical, Declared, DigestWriter, Fields, InputError, Node, parameters};
use deaflow_content::Measurements;
use deaflow_orchestrator::{Input, Job, Kind, Plan, Stage, StageError};
use deaflow_pattern::{Pattern, PatternForm};
use deaflow_scene::Outline;
use deaflow_store::{Artifact, Object};

/// The name of the kind.
pub const NAME: &str = "measure";

/// The kind `measure`.
pub struct MeasureKind;

impl Kind for MeasureKind {
    fn name(&self) -> &'static str {
        NAME
    }

    fn recipe(&self) -> u32 {
        1
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        let view = Measurements::open(artifact)?;
        let (files, rows) = (view.files().test().rows()?, view.rows().file().rows()?);
        Ok(named([("files", files as f64), ("rows", rows as f64)]))
    }

    fn files(&self, stage: &Node) -> Vec<String> {
        let entries = stage.peek("files").and_then(|files| files.list("files").ok());
        let names = entries.unwrap_or_default().iter().flat_map(named_in);
        names
            .filter_map(|name| name.text("file").ok())
            .map(str::to_owned)
            .collect()
    }

    fn schema(&self) -> Vec<Fields> {
        vec![MeasureParameters::fields()]
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let parameters = MeasureParameters::read_with(stage, &["kind"])?;
        let folder = stage.file().parent().unwrap_or(Path::new(""));
        let Some(list) = stage.peek("files") else {
            return Err(stage.error("`files` is missing in a measure stage"));
        };
        for name in list.list("files")?.iter().flat_map(named_in) {
            NamedFile::find(name, folder)?;
        }
        let form = scene.map(Outline::actual_form).transpose()?;
        let usual = match parameters.absolute {
            true => Noise::Absolute,
            false => Noise::Relative,
        };
        let nodes = list.list("files")?.iter().cloned();
        let files: Vec<(MeasuredFile, Node)> = parameters.files.into_iter().zip(nodes).collect();
        let tables = MeasuredTable::read_all(&files, Some(form.unwrap_or(PatternForm::PAPER)), usual)?;
        Ok(Box::new(MeasureStage::new(&tables)?))
    }
}

/// Returns the files that an entry names.
fn named_in(entry: &Node) -> impl Iterator<Item = &Node> {
    ["file", "pattern"].into_iter().filter_map(|key| entry.peek(key))
}

parameters! {
    /// Reads measurements from files.
    struct MeasureParameters as "a measure stage" {
        /// The files, relative to the pipeline's file, with what is known about each.
        files: Vec<MeasuredFile> [((), 1..=1000)],
        /// Whether the noise of stresses is equal at all points if it is not stated, and not in proportion to them.
        absolute: bool = false,
    }
}

struct MeasureStage {
    content: Measurements,
    /// What the content is known by, computed once: a plan asks for it several times.
    parameters: Canonical,
    notes: Vec<String>,
}

impl MeasureStage {
    fn new(tables: &[MeasuredTable]) -> Result<Self, InputError> {
        let content = MeasuredTable::content(tables).map_err(|error| InputError::new(error.to_string()))?;
        Ok(Self {
            parameters: Self::described(&content),
            content,
            notes: tables
                .iter()
                .flat_map(|table| named_notes(&table.name, &table.notes))
                .collect(),
        })
    }

    fn described(content: &Measurements) -> Canonical {
        let Measurements {
            files, rows, patterns, ..
        } = content;
        // They have just been made from patterns.
        let drawn = content.drawn_patterns().unwrap_or_default();
        let of_file = |at: usize| {
            let mut digest = DigestWriter::new();
            let own = (0..rows.file.len()).filter(|row| rows.file[*row] == at as u64);
            for row in own {
                digest.bytes(&rows.number[row].to_le_bytes());
                let numbers = [
                    rows.time[row],
                    rows.voltage[row],
                    rows.stretch[row],
                    rows.stress[row],
                    rows.sigma[row],
                ];
                let vectors = rows.position[row].iter().chain(&rows.displacement[row]);
                let response = [&rows.frequency, &rows.phase]
                    .into_iter()
                    .flatten()
                    .map(|all| &all[row]);
                let response = response.filter(|_| files.test[at] == Measurement::FrequencyResponse.name());
                for number in numbers.iter().chain(vectors).chain(response) {
                    digest.bytes(&number.to_le_bytes());
                }
            }
            let pattern = patterns
                .iter()
                .flatten()
                .nth((files.pattern[at] as usize).wrapping_sub(1));
            let number = files.pattern[at] as usize;
            let pattern = pattern.map(|pattern: &Pattern| {
                let mut digest = DigestWriter::new();
                digest.bytes(pattern.cells());
                if let Some(drawn) = drawn.get(number.wrapping_sub(1)) {
                    add_edges(&mut digest, drawn);
                }
                ("pattern", digest.finish().to_string().as_str().into())
            });
            let own: [(&str, Canonical); 5] = [
                ("test", files.test[at].as_str().into()),
                ("settings", files.settings.0[at].as_str().into()),
                ("noise", files.noise[at].as_str().into()),
                ("share", files.share[at].to_string().as_str().into()),
                ("rows", digest.finish().to_string().as_str().into()),
            ];
            let name = format!("{}: {}", at + 1, files.name.0[at]);
            (name, Canonical::map(own.into_iter().chain(pattern)))
        };
        let each = (0..files.test.len()).map(of_file);
        Canonical::map([("files", Canonical::map(each))])
    }
}

/// Adds the drawn electrodes and the covered shares of the cells of a pattern, if it has any.
fn add_edges(digest: &mut DigestWriter, pattern: &Pattern) {
    for (group, region) in pattern.electrodes().iter().flat_map(|electrodes| electrodes.groups()) {
        for ring in region.rings() {
            digest.bytes(&[*group]);
            for number in ring.iter().flatten() {
                digest.bytes(&number.to_le_bytes());
            }
        }
    }
    if let Some(coverage) = pattern.coverage() {
        digest.bytes(&coverage.bytes());
    }
}

impl Stage for MeasureStage {
    fn parameters(&self) -> Canonical {
        self.parameters.clone()
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn unit(&self) -> &'static str {
        "files"
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        Plan::Whole {
            steps: self.content.files.test.len() as u64,
        }
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        job.progress.advance(self.content.files.test.len() as u64);
        Ok(self.content.clone().object())
    }
}

/// Returns the files of all inputs of kind `measure`.
///
/// # Errors
/// If an input cannot be read.
pub fn tables_of<'a>(inputs: impl Iterator<Item = &'a Artifact>) -> Result<Vec<MeasuredTable>, StageError> {
    let mut all = Vec::new();
    for input in inputs {
        let tables = MeasuredTable::of_content(&Measurements::read(input)?);
        all.extend(tables.map_err(|why| StageError::in_artifact(input, why))?);
    }
    Ok(all)
}
