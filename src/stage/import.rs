//! `kind: import` takes patterns with displacement fields that were made elsewhere, as labels like those of a solve stage.
//!
//! They are known by their numbers, whatever file they come from. A pipeline's scene is recorded as theirs: whether that is true is
//! what an audit finds out.

use std::ops::Range;
use std::sync::Arc;

use super::files::{FileName, NamedFile};
use super::results;
use deaflow_base::{Canonical, Declared, Digest, DigestWriter, Fields, InputError, Node, parameters};
use deaflow_content::{FROM_FILE, SampleRows, Solutions, Unstable};
use deaflow_dataset::Device;
use deaflow_dataset::import::{ImportError, ImportFile, MAX_ROWS, Rows};
use deaflow_field::{Field, Outcome};
use deaflow_orchestrator::{Chunk, Input, Job, Kind, Needs, Plan, Stage, StageError};
use deaflow_pattern::Raster;
use deaflow_scene::{Difference, Scene};
use deaflow_store::{Artifact, Object};

/// The name of the kind.
pub const NAME: &str = "import";

/// Rows in a chunk on the source paper's cells: 44 MB.
const CHUNK: usize = 1000;

/// Rows in a chunk: no more than these, and of more cells fewer.
fn rows_of_chunk(raster: Raster) -> usize {
    (CHUNK * Raster::PAPER.corners() / raster.corners()).clamp(1, CHUNK)
}

/// The kind `import`.
pub struct ImportKind;

impl Kind for ImportKind {
    fn name(&self) -> &'static str {
        NAME
    }

    fn recipe(&self) -> u32 {
        1
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        results::of_solutions(artifact)
    }

    fn needs(&self) -> Needs {
        Needs {
            kinds: &[],
            least: 0,
            most: 0,
        }
    }

    fn reads_scene(&self) -> bool {
        true
    }

    fn files(&self, stage: &Node) -> Vec<String> {
        super::files::named(stage)
    }

    fn schema(&self) -> Vec<Fields> {
        vec![super::with_state(ImportParameters::fields())]
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        ImportParameters::read_with(stage, &["kind", super::STATE])?;
        let scene = super::simulated_scene_of(stage, scene)?;
        let device = Arc::new(super::device_of(&scene));
        let of_chunk = rows_of_chunk(device.raster());
        let (mut files, mut rows) = (Vec::new(), 0);
        for named in NamedFile::of_stage(stage)? {
            let file = open(&named, &scene, &device)?;
            rows += file.len();
            if rows > MAX_ROWS {
                let why = format!("with it the stage has {rows} rows");
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
            let read = gather(of_files.clone(), range.clone());
            let read = read.map_err(|(at, why)| files[at].0.refused(&why, &why.help(&device)))?;
            digests.push(read.digest());
        }
        Ok(Box::new(ImportStage {
            files: files.into_iter().map(|(_, file)| file).collect(),
            scene,
            of_chunk,
            digests,
            rows,
        }))
    }
}

parameters! {
    /// Takes patterns with displacement fields that were made elsewhere, as labels.
    struct ImportParameters as "an import stage" {
        /// FILE.npz, FILE.h5 or FILE.csv, relative to the pipeline's file; their rows stand end to end.
        files: Vec<FileName> [((), 1..=1000)],
    }
}

/// Opens a file, unless it says that it was made with another scene.
fn open(named: &NamedFile<'_>, scene: &Scene, device: &Arc<Device>) -> Result<ImportFile, InputError> {
    if named.dataset.is_some() {
        return Err(named.refused(&"its arrays are found by their names", "name the file alone"));
    }
    let file = ImportFile::open(&named.path, device).map_err(|why| named.refused(&why, &why.help(device)))?;
    let Some(said) = file.scene() else { return Ok(file) };
    let unreadable = |e| {
        named.refused(
            &format!("its scene cannot be read: {e}"),
            "take the attribute `scene` out of it",
        )
    };
    let said = Scene::from_text(said).map_err(unreadable)?.simulated();
    let differences = said.differences(scene);
    if differences.is_empty() {
        return Ok(file);
    }
    let why = format!("it was made with another scene: {}", Difference::listed(&differences));
    Err(named.refused(&why, "use it in a pipeline of its own scene"))
}

/// Some rows of several files, end to end; or which of them is wrong, and why.
fn gather<'f>(files: impl Iterator<Item = &'f ImportFile>, range: Range<usize>) -> Result<Rows, (usize, ImportError)> {
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
    /// Rows of a chunk.
    of_chunk: usize,
    /// Of the rows of each chunk.
    digests: Vec<Digest>,
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
        let rows = gather(self.files.iter(), range.clone()).map_err(|(_, why)| changed(&format!(": {why}")))?;
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

/// Every row has been read before: that it is another now is what happened since.
fn changed(why: &str) -> StageError {
    StageError::input(format!("a file has changed since the run began{why}; run again"))
}

fn solutions(rows: Rows, range: Range<usize>, scene: &Scene) -> Solutions {
    let n = rows.len();
    Solutions {
        outcome: vec![Outcome::Converged.name().to_owned(); n],
        max_displacement: rows.fields.iter().map(Field::max_magnitude).collect(),
        displacement: rows.fields,
        rows: SampleRows {
            patterns: rows.patterns,
            family: vec![FROM_FILE.to_owned(); n],
            index: range.map(|row| row as u64).collect(),
            units: vec![0; n],
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
