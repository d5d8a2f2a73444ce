//! `kind: patterns` reads electrode patterns from files, or draws one of shapes.
//!
//! The key depends on the cells: the same patterns under another name or in another format give the same artifact. The
//! files are read once, so that the result is as planned even if a file changes in the meantime.

mod shapes;

use super::files::{self, FileName, NamedFile};
use super::results;
use super::sample::{CHUNK, room};
use deaflow_base::{Canonical, Declared, DigestWriter, Fields, InputError, Map, Node, parameters};
use deaflow_content::{CoveredCells, DrawnElectrodes, FROM_FILE, SampleRows, Samples};
use deaflow_orchestrator::{Chunk, Input, Job, Kind, Plan, Stage, StageError};
use deaflow_pattern::{Bits, DrawingOptions, Edges, Pattern, PatternForm, read_patterns_of};
use deaflow_scene::{Outline, scene_files};
use deaflow_store::{Artifact, Object};
use shapes::Drawn;

/// The name of the kind.
pub const NAME: &str = "patterns";

/// The largest number of patterns of a stage.
const MOST: usize = 20_000;

/// The kind `patterns`.
pub struct PatternsKind;

impl Kind for PatternsKind {
    fn name(&self) -> &'static str {
        NAME
    }

    fn recipe(&self) -> u32 {
        1
    }

    fn results(&self, artifact: &Artifact) -> Result<Vec<(String, f64)>, StageError> {
        results::of_samples(artifact)
    }

    fn files(&self, stage: &Node) -> Vec<String> {
        [files::named(stage), scene_files(stage)].concat()
    }

    fn schema(&self) -> Vec<Fields> {
        vec![PatternsParameters::fields()]
    }

    fn read(&self, stage: &Node, scene: Option<&Node>) -> Result<Box<dyn Stage>, InputError> {
        let form = scene
            .map(Outline::actual_form)
            .transpose()?
            .unwrap_or(PatternForm::PAPER);
        let parameters = PatternsParameters::read_with(stage, &["kind"])?;
        let (mut patterns, mut notes) = (Vec::new(), Vec::new());
        if let (Some(drawn), Some(node)) = (&parameters.shapes, stage.peek("shapes")) {
            let (pattern, told) = shapes::pattern(drawn, node, form, parameters.edges)?;
            patterns.push(pattern);
            notes.extend(told);
        }
        let drawings = DrawingOptions {
            edges: parameters.edges,
            ..DrawingOptions::default()
        };
        for file in NamedFile::of_stage(stage)? {
            let read = read_patterns_of(&file.path, file.dataset, form, &drawings);
            let read = read.map_err(|refusal| file.refused(&refusal, &refusal.advice(form)))?;
            patterns.extend(read.patterns);
            notes.extend(read.notes.iter().map(|note| format!("{}: {note}", file.name)));
            if patterns.len() > MOST {
                let why = format!("it brings the stage to {} patterns", patterns.len());
                return Err(file.refused(
                    &why,
                    &format!("allowed: at most {MOST}; use another stage for the others"),
                ));
            }
        }
        let free = scene.map(Outline::free_cells).transpose()?.flatten();
        // A frame that covers no cell changes nothing.
        let free = free.filter(|free| free.count() < free.raster().cells());
        Ok(Box::new(PatternsStage::new(patterns, parameters.edges, free, notes)))
    }
}

parameters! {
    /// Reads electrode patterns from files, or draws one of shapes.
    struct PatternsParameters as "a patterns stage" {
        /// FILE.npy, FILE.csv, FILE.png (also .jpg, .tif, .bmp), FILE.dxf, FILE.svg or FILE.h5:/dataset (also .mat, .nc,
        /// .npz), relative to the pipeline's file; their patterns are concatenated.
        files: Option<Vec<FileName>> [((), 1..=1000)],
        /// The shapes and drawings of one pattern, whose groups may not overlap.
        shapes: Option<Vec<Drawn>> [((), 1..=1000)],
        /// Whether elements follow the edges of shapes and drawings, a cell has the share of it that they cover, also by
        /// the greys of a picture, or a cell has an electrode if its centre is in one.
        edges: Edges = Edges::Cells,
    }
    rules(shapes::files_or_shapes)
    check(check_source)
}

fn check_source(_: &PatternsParameters, map: &Map<'_>) -> Result<(), InputError> {
    shapes::check_source(map)
}

struct PatternsStage {
    patterns: Vec<Pattern>,
    /// How edges are followed. By coverage the shares of cells are written even if all cells are whole: artifacts of
    /// stages that are solved together have the same arrays.
    edges: Edges,
    /// The cells that may carry electrodes, if there are frames or bodies.
    free: Option<Bits>,
    /// The parameters of each chunk.
    chunks: Vec<Canonical>,
    notes: Vec<String>,
}

impl PatternsStage {
    fn new(patterns: Vec<Pattern>, edges: Edges, free: Option<Bits>, notes: Vec<String>) -> Self {
        let starts = (0_u64..).step_by(CHUNK as usize);
        let chunk = |(patterns, start): (&[Pattern], u64)| {
            Canonical::map(described(patterns, edges, free.as_ref()).chain([("start", start.into())]))
        };
        Self {
            chunks: patterns.chunks(CHUNK as usize).zip(starts).map(chunk).collect(),
            patterns,
            edges,
            free,
            notes,
        }
    }
}

/// What patterns are known by. Their area fractions depend on the cells that may carry electrodes.
fn described(
    patterns: &[Pattern],
    edges: Edges,
    free: Option<&Bits>,
) -> impl Iterator<Item = (&'static str, Canonical)> {
    let mut digest = DigestWriter::new();
    for pattern in patterns {
        digest.bytes(pattern.cells());
    }
    let own = [
        ("patterns", digest.finish().to_string().as_str().into()),
        ("count", (patterns.len() as u64).into()),
    ];
    let is_drawn = patterns.iter().any(|pattern| pattern.electrodes().is_some());
    let drawn = is_drawn.then(|| {
        let mut digest = DigestWriter::new();
        for electrodes in patterns.iter().map(Pattern::electrodes) {
            let bytes = electrodes.map(|electrodes| electrodes.bytes()).unwrap_or_default();
            digest.bytes(&bytes);
        }
        ("electrodes", digest.finish().to_string().as_str().into())
    });
    let covered = (edges == Edges::Coverage).then(|| {
        let mut digest = DigestWriter::new();
        for coverage in patterns.iter().map(Pattern::coverage) {
            digest.bytes(&coverage.map(|coverage| coverage.bytes()).unwrap_or_default());
        }
        ("covered", digest.finish().to_string().as_str().into())
    });
    own.into_iter().chain(free.map(room)).chain(drawn).chain(covered)
}

impl Stage for PatternsStage {
    fn parameters(&self) -> Canonical {
        Canonical::map(described(&self.patterns, self.edges, self.free.as_ref()))
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn unit(&self) -> &'static str {
        "patterns"
    }

    fn plan(&self, _inputs: &[Input]) -> Plan {
        let chunk = |(parameters, patterns): (&Canonical, &[Pattern])| Chunk {
            parameters: parameters.clone(),
            inputs: Vec::new(),
            samples: patterns.len() as u64,
        };
        Plan::Chunks(
            self.chunks
                .iter()
                .zip(self.patterns.chunks(CHUNK as usize))
                .map(chunk)
                .collect(),
        )
    }

    fn pieces(&self, _inputs: u64) -> u64 {
        self.chunks.len() as u64
    }

    fn build(&self, job: &Job<'_>) -> Result<Object, StageError> {
        let own = |chunk: &Chunk| {
            self.chunks
                .iter()
                .position(|parameters| *parameters == chunk.parameters)
        };
        let index = job.chunk.and_then(own);
        let index = index.ok_or_else(|| StageError::failed("the chunk is not one of this stage's"))?;
        let first = index * CHUNK as usize;
        let patterns: Vec<Pattern> = self.patterns.iter().skip(first).take(CHUNK as usize).cloned().collect();
        job.progress.advance(patterns.len() as u64);
        let n = patterns.len();
        let samples = Samples {
            area: patterns
                .iter()
                .map(|pattern| pattern.area_fraction(self.free.as_ref()))
                .collect(),
            rows: SampleRows {
                family: vec![FROM_FILE.to_owned(); n],
                index: (first as u64..).take(n).collect(),
                units: vec![0; n],
                electrodes: DrawnElectrodes::of(&patterns),
                covered: (self.edges == Edges::Coverage).then(|| CoveredCells::of_all(&patterns)),
                patterns,
            },
        };
        Ok(samples.object())
    }
}
