//! Reads datasets for an audit: an artifact of a solve, import or balance stage, or a file from elsewhere in the layout
//! of `deaflow solve`.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::shapes::wrong_shapes;
use deaflow_base::Digest;
use deaflow_content::{ArtifactKind, BalancedView, Labelled, StoredAttribute, files};
use deaflow_dataset::Bins;
use deaflow_dataset::audit::{
    AuditError, Batch, Columns, DeclaredBalance, Discretisation, Finding, NO_NUMBER, RowSource, Severity, SourceSample,
};
use deaflow_fem::{Method, SceneSimulators, SetupError, SolverParameters};
use deaflow_field::{Mesh, OutcomeKind};
use deaflow_pattern::Raster;
use deaflow_scene::Scene;
use deaflow_store::{Artifact, RowFile, StoreError};

/// The array of the bin edges.
const EDGES: &str = "histogram/edges";

/// Arrays of patterns with edges within cells, with what they are.
const WITHIN_CELLS: [(&str, &str); 2] = [
    ("electrodes/polygons", "elements follow drawn electrodes"),
    ("covered/share", "electrodes cover parts of cells"),
];

/// The largest number of bins.
const MOST_BINS: usize = 100_000;

/// Patterns that are read at once.
const BATCH: usize = 1024;

/// Larger integers are not exact as floats.
const MAX_INTEGER: f64 = 9e15;

/// A dataset: the concatenated rows of one or more files.
pub struct Source {
    /// The raster of its patterns.
    raster: Raster,
    segments: Vec<Segment>,
    /// The columns of its rows.
    pub columns: Columns,
    /// The declared mesh and kind of its fields.
    pub declared: Discretisation,
    /// The declared solver.
    pub solver: Option<SolverParameters>,
    /// The histograms of a balanced dataset.
    pub balance: Option<DeclaredBalance>,
    /// The samples to which the column `source` refers, if available.
    pub source_samples: Option<Vec<SourceSample>>,
    /// The bins of the largest displacement, if known.
    pub bins: Option<Bins>,
    /// Problems found while reading.
    pub findings: Vec<Finding>,
    /// The declared scene.
    pub scene: Option<String>,
    /// The declared effects; with `effects: auto` those that were turned on.
    pub effects: Option<String>,
}

/// One file. It is opened only while it is read, because a process cannot hold many files open.
struct Segment {
    file: RowsOf,
    rows: Range<usize>,
}

/// A file with rows.
#[derive(Clone)]
enum RowsOf {
    File(PathBuf),
    Artifact(Artifact),
}

impl RowsOf {
    fn open(&self) -> Result<RowFile, StoreError> {
        match self {
            Self::File(path) => RowFile::open(path),
            Self::Artifact(artifact) => artifact.rows(),
        }
    }

    fn path(&self) -> &Path {
        match self {
            Self::File(path) => path,
            Self::Artifact(artifact) => artifact.path(),
        }
    }
}

impl RowSource for Source {
    fn read(&self, range: Range<usize>) -> Result<Batch, AuditError> {
        let mut batch = Batch {
            cells: Vec::new(),
            displacement: Vec::new(),
        };
        for segment in &self.segments {
            let (start, end) = (range.start.max(segment.rows.start), range.end.min(segment.rows.end));
            if start >= end {
                continue;
            }
            let own = start - segment.rows.start..end - segment.rows.start;
            let file = segment.file.open().map_err(AuditError::read)?;
            let read = |path: &str| file.numbers(path, own.clone()).map_err(AuditError::read);
            batch.cells.extend(read("patterns")?);
            batch.displacement.extend(read("displacement")?);
        }
        Ok(batch)
    }
}

impl Source {
    /// The rows of some files, of patterns on these cells.
    fn open(raster: Raster, files: impl Iterator<Item = RowsOf>) -> Result<Self, StoreError> {
        let mut source = Self {
            raster,
            segments: Vec::new(),
            columns: Columns::default(),
            declared: Discretisation::Unknown,
            solver: None,
            balance: None,
            source_samples: None,
            bins: None,
            findings: Vec::new(),
            scene: None,
            effects: None,
        };
        let mut start = 0_usize;
        for rows_of in files {
            let file = rows_of.open()?;
            source.findings.extend(wrong_shapes(&file, raster, rows_of.path())?);
            for (array, what) in WITHIN_CELLS {
                if file.shape(array)?.is_some() {
                    let message = format!("{what}, but an audit knows the cells of patterns alone");
                    source.findings.push(Finding::whole("shape", Severity::Error, message));
                }
            }
            let len = file.shape("patterns")?.and_then(|shape| shape.first().copied());
            let rows = start..start.saturating_add(len.unwrap_or(0));
            start = rows.end;
            source.segments.push(Segment { file: rows_of, rows });
        }
        if source.is_readable() {
            source.columns = source.read_columns()?;
            source.findings.extend(invalid_meshes(&source)?);
        }
        Ok(source)
    }

    /// Opens a file from elsewhere with patterns on a raster.
    ///
    /// # Errors
    /// If it is not an HDF5 file, or a column cannot be read.
    pub fn of_file(path: &Path, raster: Raster) -> Result<Self, StoreError> {
        if Artifact::is_at(path) {
            return Self::of_artifact(&Artifact::open(path)?, raster);
        }
        let mut source = Self::open(raster, std::iter::once(RowsOf::File(path.to_owned())))?;
        let file = RowFile::open(path)?;
        if source.is_readable() {
            // Refuse arrays with missing or external data before any work.
            for name in ["patterns", "displacement"] {
                file.numbers(name, 0..0)?;
            }
        }
        source.scene = file.attribute("scene")?;
        source.effects = file.attribute("effects")?;
        source.set_solver(file.attribute("solver")?.as_deref());
        source.declared = source.declaration();
        if let Some([count]) = file.shape(EDGES)?.as_deref()
            && *count <= MOST_BINS
        {
            source.bins = bins(&file.numbers(EDGES, 0..*count)?);
        }
        Ok(source)
    }

    /// Opens an artifact of a solve, import or balance stage with patterns on a raster.
    ///
    /// # Errors
    /// If it or one of its chunks is missing or damaged, or a column cannot be read.
    pub fn of_artifact(artifact: &Artifact, raster: Raster) -> Result<Self, StoreError> {
        let files = files(artifact)?;
        // Verify every byte before the HDF5 library reads it.
        files.iter().try_for_each(|file| file.file_digest().map(drop))?;
        let mut source = Self::open(raster, files.iter().cloned().map(RowsOf::Artifact))?;
        let text = |name| StoredAttribute::<String>::new(artifact, name).text();
        source.scene = text("scene")?;
        source.effects = text("effects")?;
        source.set_solver(text("solver")?.as_deref());
        source.declared = source.declaration();
        match Labelled::open(artifact)? {
            Some(Labelled::Solved(view)) => {
                source.findings.extend(unstable(&view.unstable().outcome().read()?));
            }
            Some(Labelled::Balanced(view)) => {
                let histogram = view.histogram().read()?;
                let [level] = histogram.level;
                source.bins = bins(&histogram.edges);
                source.balance = Some(DeclaredBalance {
                    edges: histogram.edges,
                    available: histogram.augmented,
                    counts: histogram.after,
                    level,
                });
                source.inherit(&view)?;
            }
            _ => {}
        }
        Ok(source)
    }

    /// Parses the declared solver.
    fn set_solver(&mut self, text: Option<&str>) {
        match text.map(SolverParameters::from_text).transpose() {
            Ok(solver) => self.solver = solver,
            Err(error) => {
                let message = format!("what the file says of its solver cannot be read: {error}");
                self.findings
                    .push(Finding::whole("provenance", Severity::Error, message));
            }
        }
    }

    /// Returns simulators that solve its rows again, with the same history in time.
    ///
    /// # Errors
    /// If the scene cannot be simulated.
    pub fn simulators(&self, scene: &Scene, method: Method, residual: f64) -> Result<SceneSimulators, SetupError> {
        let simulators = SceneSimulators::new(scene, method, residual)?;
        Ok(match &self.solver {
            Some(solver) => simulators.through(solver),
            None => simulators,
        })
    }

    /// Returns the number of rows.
    pub fn len(&self) -> usize {
        self.segments.last().map_or(0, |segment| segment.rows.end)
    }

    /// Whether patterns and displacements have valid shapes.
    pub fn is_readable(&self) -> bool {
        self.findings.iter().all(|finding| finding.check != "shape")
    }

    fn declaration(&self) -> Discretisation {
        if self.columns.mesh.is_some() {
            return Discretisation::PerRow;
        }
        let Some((solver, mesh)) = self.solver.as_ref().and_then(|solver| Some((solver, solver.mesh()?))) else {
            return Discretisation::Unknown;
        };
        match solver.method().chord_steps() {
            None => Discretisation::Mesh(mesh),
            Some(_) => Discretisation::Estimates(mesh),
        }
    }

    /// Copies the meshes, errors and solver of the samples of a balanced dataset, which does not repeat them, from the
    /// store. If the samples are missing, the mesh is determined as for a file from elsewhere.
    fn inherit(&mut self, balanced: &BalancedView<'_>) -> Result<(), StoreError> {
        let from = balanced.source().read()?;
        let (mut meshes, mut errors) = (Vec::new(), Vec::new());
        let (mut estimates, mut solvers) = (Vec::new(), Vec::new());
        let mut source_samples = Vec::new();
        for solved in super::lineage::inputs(balanced.artifact())? {
            let Ok(solved) = solved else { return Ok(()) };
            if ArtifactKind::Audit.is_of(&solved) {
                // It names rows that were dropped.
                continue;
            }
            let solved = Self::of_artifact(&solved, self.raster)?;
            let n = solved.len();
            source_samples.extend(solved.as_source_samples()?);
            match (solved.declared, &solved.columns.mesh) {
                (Discretisation::Mesh(mesh), _) => meshes.extend(std::iter::repeat_n(mesh, n)),
                (Discretisation::PerRow, Some(own)) => meshes.extend(own),
                (Discretisation::Estimates(_), _) => estimates.push(solved.declared),
                _ => return Ok(()),
            }
            errors.extend(solved.columns.error.unwrap_or_default());
            solvers.push(solved.solver);
            self.effects = solved.effects;
        }
        self.source_samples = Some(source_samples);
        if solvers.windows(2).any(|pair| pair[0] != pair[1]) && !estimates.is_empty() {
            // Estimates by several methods have no common measure.
            return Ok(());
        }
        self.solver = solvers.pop().flatten();
        self.declared = estimates.pop().unwrap_or(Discretisation::Unknown);
        let of_rows = |len: usize| from.iter().all(|&row| (row as usize) < len);
        if self.declared == Discretisation::Unknown && of_rows(meshes.len()) {
            self.declared = Discretisation::PerRow;
            self.columns.mesh = Some(from.iter().map(|&row| meshes[row as usize]).collect());
        }
        if of_rows(errors.len()) && errors.len() == meshes.len() {
            self.columns.error = Some(from.iter().map(|&row| errors[row as usize]).collect());
        }
        Ok(())
    }

    /// Returns its rows as source samples of others.
    fn as_source_samples(&self) -> Result<Vec<SourceSample>, StoreError> {
        let mut source_samples = Vec::with_capacity(self.len());
        for segment in &self.segments {
            let file = segment.file.open()?;
            let families = self.columns.family.as_deref().unwrap_or_default();
            let families = families.get(segment.rows.clone()).unwrap_or_default();
            for start in (0..segment.rows.len()).step_by(BATCH) {
                let end = (start + BATCH).min(segment.rows.len());
                let cells = file.numbers("patterns", start..end)?;
                source_samples.extend(cells.chunks(self.raster.cells()).zip(start..).map(|(cells, row)| {
                    let cells: Vec<u8> = cells.iter().map(|&cell| cell as u8).collect();
                    SourceSample {
                        pattern: Digest::of(&cells),
                        family: families.get(row).cloned().unwrap_or_default(),
                    }
                }));
            }
        }
        Ok(source_samples)
    }

    fn read_columns(&self) -> Result<Columns, StoreError> {
        let texts = |path: &str| self.column(path, |file, _| file.texts(path));
        let words = |path: &str| self.column(path, |file, _| file.words(path));
        let numbers = |path: &str| self.column(path, |file, n| file.numbers(path, 0..n));
        let integers = |path: &str| {
            let exact =
                |number: f64| (number.fract() == 0.0 && (0.0..MAX_INTEGER).contains(&number)).then_some(number as u64);
            let all = numbers(path)?;
            Ok::<_, StoreError>(all.map(|all| all.into_iter().map(|n| exact(n).unwrap_or(NO_NUMBER)).collect()))
        };
        let outcomes = texts("outcome")?;
        let (elements, order) = (numbers("elements_per_cell")?, numbers("order")?);
        let mesh = |(elements, order): (&f64, &f64)| mesh(*elements, *order);
        let meshes = elements
            .zip(order)
            .and_then(|(elements, order)| elements.iter().zip(&order).map(mesh).collect());
        Ok(Columns {
            split: words("split")?,
            family: words("family")?,
            has_field: outcomes.map(|all| all.iter().map(|word| has_field(word)).collect()),
            peak: numbers("max_displacement")?,
            orbit: texts("orbit")?,
            mesh: meshes,
            error: numbers("discretisation_error")?,
            source: integers("source")?,
            symmetry: integers("symmetry")?,
            bin: integers("bin")?,
        })
    }

    /// Reads a column of all files; `None` unless all have it.
    fn column<T>(
        &self,
        path: &str,
        read: impl Fn(&RowFile, usize) -> Result<Vec<T>, StoreError>,
    ) -> Result<Option<Vec<T>>, StoreError> {
        let mut all = Vec::with_capacity(self.len());
        for segment in &self.segments {
            let file = segment.file.open()?;
            let Some(shape) = file.shape(path)? else {
                return Ok(None);
            };
            all.extend(read(&file, shape.first().copied().unwrap_or(0))?);
        }
        Ok(Some(all))
    }
}

/// Whether a row has a field. Unknown outcomes of other programs count as fields.
fn has_field(word: &str) -> bool {
    OutcomeKind::from_name(word).is_none_or(OutcomeKind::has_field)
}

/// Returns a finding if the mesh of a row is invalid.
fn invalid_meshes(source: &Source) -> Result<Option<Finding>, StoreError> {
    let numbers = |path: &str| source.column(path, |file, n| file.numbers(path, 0..n));
    let (Some(elements), Some(order)) = (numbers("elements_per_cell")?, numbers("order")?) else {
        return Ok(None);
    };
    let pairs = elements.iter().zip(&order).enumerate();
    let none = pairs.filter(|(_, (elements, order))| mesh(**elements, **order).is_none());
    let rows: Vec<usize> = none.map(|(row, _)| row).collect();
    let message = "`elements_per_cell` and `order` name no mesh";
    Ok((!rows.is_empty()).then(|| Finding::rows("derived", Severity::Error, &rows, message)))
}

fn mesh(elements: f64, order: f64) -> Option<Mesh> {
    let is_whole = elements.fract() == 0.0 && order.fract() == 0.0;
    is_whole
        .then(|| Mesh::from_numbers(elements as u64, order as u64))
        .flatten()
}

/// Returns the bins between edges; `None` unless they have equal widths.
fn bins(edges: &[f64]) -> Option<Bins> {
    let (first, last) = (*edges.first()?, *edges.last()?);
    let bins = Bins::new(first, last, edges.len() - 1).ok()?;
    let is_equal = |(at, edge): (usize, &f64)| (edge - bins.edge(at)).abs() <= 1e-9 * (last - first);
    edges.iter().enumerate().all(is_equal).then_some(bins)
}

/// Returns a finding for the unstable samples of a solve stage.
fn unstable(outcomes: &[OutcomeKind]) -> Option<Finding> {
    let rows: Vec<usize> = (0..outcomes.len()).collect();
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for outcome in outcomes {
        *counts.entry(outcome.name()).or_default() += 1;
    }
    let counts: Vec<String> = counts.iter().map(|(kind, count)| format!("{kind} {count}")).collect();
    let message = format!(
        "samples without a stable solution, by their rows under `unstable/`: {}",
        counts.join(", ")
    );
    (!rows.is_empty()).then(|| Finding::rows("not-converged", Severity::Warning, &rows, message))
}
