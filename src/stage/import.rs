//! `kind: import` reads patterns with displacement fields from files, as labels like those of a solve stage.
//!
//! The key depends on the numbers, not on the format of the file. The scene of the pipeline is recorded as their scene;
//! an audit checks whether that is right.

use std::ops::Range;
use std::sync::Arc;

use super::files::{self, FileName, NamedFile};
use super::{results, scene};
use deaflow_base::{Canonical, Declared, Digest, DigestWriter, Fields, InputError, Node, parameters};
use deaflow_content::{FROM_FILE, SampleRows, Solutions, Unstable};
use deaflow_dataset::Device;
use deaflow_dataset::import::{ImportError, ImportFile, MAX_ROWS, Rows};
use deaflow_field::{Field, OutcomeKind};
use deaflow_orchestrator::{Chunk, Input, Job, Kind, Plan, Stage, StageError};
use deaflow_pattern::Raster;
use deaflow_scene::{Difference, Scene};
use deaflow_store::{Artifact, Object};

/// Rows per chunk on the raster of the source paper: 44 MB.
const CHUNK: usize = 1000;

/// Returns the number of rows per chunk, smaller on larger rasters.
fn rows_of_chunk(raster: Raster) -> usize {
    (CHUNK * Raster::PAPER.corners() / raster.corners()).clamp(1, CHUNK)
}

/// The kind `import`.
pub struct ImportKind;

impl Kind for ImportKind {
    fn name(&self) -> &'static str {
        "import"
    }

    fn recipe(&self) -> u32 {
        1
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        results::of_solutions(artifact)
    }

    fn reads_scene(&self) -> bool {
        true
    }

    fn files(&self, stage: &Node) -> Vec<String> {
        files::named(stage)
    }

    fn schema(&self) -> Vec<Fields> {
        vec![scene::with_state(ImportParameters::fields())]
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        ImportParameters::read_with(stage, &["kind", scene::STATE])?;
        let scene = scene::read_in_state(stage, scene)?.simulated();
        let device = Arc::new(scene::device_of(&scene));
        let of_chunk = rows_of_chunk(device.raster());
        let (mut files, mut notes, mut rows) = (Vec::new(), Vec::new(), 0);
        for named in NamedFile::of_stage(stage)? {
            let file = open(&named, &scene, &device)?;
            rows += file.len();
            notes.extend(file.notes().iter().map(|note| format!("{}: {note}", named.name)));
            if rows > MAX_ROWS {
                let why = format!("it brings the stage to {rows} rows");
                return Err(named.refused(
                    &why,
                    &format!("allowed: at most {MAX_ROWS}; use another stage for the others"),
                ));
            }
            files.push((named, file));
        }
        let of_files = files.iter().map(|(_, file)| file);
        let mut digests = Vec::new();
        for start in (0..rows).step_by(of_chunk) {
            let range = start..rows.min(start + of_chunk);
            let read = read_rows(of_files.clone(), range.clone());
            let read = read.map_err(|(at, why)| files[at].0.refused(&why, &why.help(&device)))?;
            digests.push(read.digest());
        }
        Ok(Box::new(ImportStage {
            files: files.into_iter().map(|(_, file)| file).collect(),
            scene,
            of_chunk,
            digests,
            notes,
            rows,
        }))
    }
}

parameters! {
    /// Reads patterns with displacement fields from files, as labels.
    struct ImportParameters as "an import stage" {
        /// FILE.npz, FILE.h5 (also .mat, .nc) or FILE.csv, relative to the pipeline's file; their rows are
        /// concatenated.
        files: Vec<FileName> [((), 1..=1000)],
    }
}

/// Opens a file; refuses it if it names another scene.
fn open(named: &NamedFile<'_>, scene: &Scene, device: &Arc<Device>) -> Result<ImportFile, InputError> {
    if named.dataset.is_some() {
        return Err(named.refused(&"its arrays are found by name", "name the file only"));
    }
    let file = ImportFile::open(&named.path, device).map_err(|why| named.refused(&why, &why.help(device)))?;
    let Some(declared) = file.scene() else { return Ok(file) };
    let unreadable = |e| {
        named.refused(
            &format!("its scene cannot be read: {e}"),
            "remove the attribute `scene` from it",
        )
    };
    let declared = Scene::from_text(declared).map_err(unreadable)?.simulated();
    let differences = declared.differences(scene);
    if differences.is_empty() {
        return Ok(file);
    }
    let why = format!("it was made with another scene: {}", Difference::listed(&differences));
    Err(named.refused(&why, "use it in a pipeline with that scene"))
}

/// Reads a range of the concatenated rows of several files. An error comes with the index of its file.
fn read_rows<'f>(
    files: impl Iterator<Item = &'f ImportFile>,
    range: Range<usize>,
) -> Result<Rows, (usize, ImportError)> {
    let (mut rows, mut first) = (Rows::default(), 0);
    for (at, file) in files.enumerate() {
        let (start, end) = (range.start.max(first), range.end.min(first + file.len()));
        if start < end {
            rows.append(file.rows(start - first..end - first).map_err(|why| (at, why))?);
        }
        first += file.len();
    }
    Ok(rows)
}

struct ImportStage {
    files: Vec<ImportFile>,
    scene: Scene,
    /// Rows per chunk.
    of_chunk: usize,
    /// Digest of the rows of each chunk.
    digests: Vec<Digest>,
    notes: Vec<String>,
    rows: usize,
}

impl ImportStage {
    fn range(&self, chunk: usize) -> Range<usize> {
        let start = chunk * self.of_chunk;
        start..self.rows.min(start + self.of_chunk)
    }

    fn chunk(&self, at: usize) -> Canonical {
        let range = self.range(at);
        Canonical::map([
            ("scene", self.scene.canonical()),
            ("rows", self.digests[at].to_string().as_str().into()),
            ("start", (range.start as u64).into()),
            ("count", (range.len() as u64).into()),
        ])
    }
}

impl Stage for ImportStage {
    fn parameters(&self) -> Canonical {
        let mut all = DigestWriter::new();
        for digest in &self.digests {
            all.bytes(digest.as_bytes());
        }
        Canonical::map([
            ("scene", self.scene.canonical()),
            ("rows", all.finish().to_string().as_str().into()),
            ("count", (self.rows as u64).into()),
        ])
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn unit(&self) -> &'static str {
        "patterns"
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        let chunk = |at| Chunk {
            parameters: self.chunk(at),
            inputs: Vec::new(),
            samples: self.range(at).len() as u64,
        };
        Plan::Chunks((0..self.digests.len()).map(chunk).collect())
    }

    fn pieces(&self, _inputs: u64) -> u64 {
        self.digests.len() as u64
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let own = |chunk: &Chunk| (0..self.digests.len()).find(|&at| self.chunk(at) == chunk.parameters);
        let at = job.chunk.and_then(own);
        let at = at.ok_or_else(|| StageError::failed("the chunk is not one of this stage's"))?;
        let range = self.range(at);
        let rows = read_rows(self.files.iter(), range.clone()).map_err(|(_, why)| changed(&format!(": {why}")))?;
        if rows.digest() != self.digests[at] {
            return Err(changed(""));
        }
        job.progress.advance(rows.len() as u64);
        Ok(solutions(rows, range, &self.scene).object())
    }

    fn attributes(&self) -> Vec<(String, String)> {
        vec![("scene".to_owned(), self.scene.to_text())]
    }
}

/// The error if rows have changed since they were first read.
fn changed(why: &str) -> StageError {
    StageError::input(format!("a file has changed since the run began{why}; run again"))
}

fn solutions(rows: Rows, range: Range<usize>, scene: &Scene) -> Solutions {
    let n = rows.len();
    Solutions {
        outcome: vec![OutcomeKind::Converged; n],
        max_displacement: rows.fields.iter().map(Field::max_magnitude).collect(),
        displacement: rows.fields,
        rows: SampleRows {
            patterns: rows.patterns,
            family: vec![FROM_FILE.to_owned(); n],
            index: range.map(|row| row as u64).collect(),
            units: vec![0; n],
            electrodes: None,
            covered: None,
        },
        newton_iterations: None,
        residual: None,
        observations: Default::default(),
        meshes: None,
        history: None,
        unstable: Unstable::default(),
        scene: scene.clone(),
        solver: None,
        effects: None,
    }
}
