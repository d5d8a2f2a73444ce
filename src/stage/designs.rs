//! Reads one design from an artifact of a `design` or `verify` stage, or from a file with one pattern.

use std::path::Path;

use super::direct;
use deaflow_base::InputError;
use deaflow_content::{ArtifactKind, DesignRows, StoredAttribute, Verification, VerificationView};
use deaflow_design::{DesignFilter, DesignLabel, SimulatedScore};
use deaflow_pattern::{DrawingOptions, Pattern};
use deaflow_scene::Scene;
use deaflow_store::{Artifact, StoreError};

/// A design with the data to manufacture or simulate it.
#[derive(Clone, Debug)]
pub struct Design {
    /// Its label, if it comes from an artifact.
    pub label: Option<DesignLabel>,
    /// Its title.
    pub title: String,
    /// Its artifact or file.
    pub source: String,
    /// What it was searched for, in YAML; `None` for a pattern of a file.
    pub objective: Option<String>,
    /// Its electrode.
    pub pattern: Pattern,
    /// The scene that it was made for.
    pub scene: Scene,
    /// The state of the device, if it has several.
    pub state: Option<String>,
    /// What the reader of its file did that a user should know.
    pub notes: Vec<String>,
}

impl Design {
    /// Returns its cells `[y][x]`, 1 = electrode, and the number of columns.
    #[must_use]
    pub fn cells(&self) -> (&[u8], usize) {
        (self.pattern.cells(), self.pattern.raster().columns())
    }
}

/// The designs of an artifact.
pub struct Designs {
    labels: Vec<DesignLabel>,
    scores: Vec<Option<SimulatedScore>>,
    objectives: Vec<String>,
    patterns: Vec<Pattern>,
    scene: Scene,
    source: String,
}

impl Designs {
    /// Reads all designs; `None` if the artifact is not of the kind `design` or `verify`.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn read(artifact: &Artifact) -> Result<Option<Self>, StoreError> {
        let kind = ArtifactKind::of(artifact);
        if !matches!(kind, Some(ArtifactKind::Design | ArtifactKind::Verify)) {
            return Ok(None);
        }
        let rows = DesignRows::open(artifact)?;
        let (case, name, role) = (rows.case().read()?, rows.name().read()?, rows.role().read()?);
        let (member, units) = (rows.member().read()?, rows.units().read()?);
        let patterns = rows.patterns().read()?;
        let label = |i: usize| DesignLabel {
            case: case[i].clone(),
            name: name[i].clone(),
            role: role[i],
            member: member[i],
            units: units[i],
            raster: patterns[i].raster(),
        };
        let scores = match kind {
            Some(ArtifactKind::Verify) => scores(&Verification::open(artifact)?)?,
            _ => vec![None; case.len()],
        };
        Ok(Some(Self {
            labels: (0..case.len()).map(label).collect(),
            scores,
            objectives: rows.objective().read()?.0,
            patterns,
            scene: StoredAttribute::new(artifact, "scene").read()?,
            source: format!("artifact {}", artifact.digest()),
        }))
    }

    /// Returns the design that a filter selects; see [`DesignFilter::choose`].
    ///
    /// # Errors
    /// If no design matches, or those of several targets or roles do; the error lists them.
    pub fn choose(&self, filter: &DesignFilter<'_>) -> Result<Design, InputError> {
        let row = filter.choose(&self.labels, &self.scores)?;
        Ok(Design {
            title: self.labels[row].to_string(),
            label: Some(self.labels[row].clone()),
            source: self.source.clone(),
            objective: Some(self.objectives[row].clone()),
            pattern: self.patterns[row].clone(),
            scene: self.scene.clone(),
            state: None,
            notes: Vec::new(),
        })
    }
}

/// Returns the scores of the designs of a `verify` stage; `None` for those without a field.
fn scores(view: &VerificationView<'_>) -> Result<Vec<Option<SimulatedScore>>, StoreError> {
    let (distance, along) = (
        view.component().distance().read()?,
        view.component().simulated().read()?,
    );
    let score = |row: usize| {
        Some(SimulatedScore {
            distance_mm: *distance.get(row)?,
            along_mm: *along.get(row)?,
        })
    };
    Ok(view
        .simulated_rows()?
        .into_iter()
        .map(|row| row.and_then(score))
        .collect())
}

/// Reads the only pattern of a file, for a scene.
///
/// # Errors
/// If the file cannot be read, or has several patterns.
pub fn of_file(file: &str, scene: Scene, drawings: &DrawingOptions) -> Result<Design, InputError> {
    let direct::NamedPatterns { patterns, notes, .. } = direct::patterns(&[file.to_owned()], scene.form(), drawings)?;
    let [pattern] = patterns.as_slice() else {
        let message = format!(
            "{file} contains {} patterns; only one can be exported at a time",
            patterns.len()
        );
        return Err(InputError::new(message).help("save that pattern in its own file"));
    };
    let title = Path::new(file).file_stem().unwrap_or_default().to_string_lossy();
    Ok(Design {
        label: None,
        title: title.into_owned(),
        source: format!("file {file}"),
        objective: None,
        pattern: pattern.clone(),
        scene,
        state: None,
        notes,
    })
}
