//! One design out of an artifact of a `design` or `verify` stage, or out of a file of one pattern.

use std::path::Path;

use super::direct::{self, read_scene};
use deaflow_base::InputError;
use deaflow_content::{DesignRows, StoredAttribute, Verification, VerificationView};
use deaflow_design::{DesignFilter, DesignLabel, Merit};
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_store::{Artifact, StoreError};

/// A design with all that is needed to make or simulate it.
#[derive(Clone, Debug)]
pub struct Design {
    /// What it is called, where it comes from an artifact.
    pub label: Option<DesignLabel>,
    /// The same as a title.
    pub title: String,
    /// Where it comes from.
    pub source: String,
    /// Its electrode.
    pub pattern: Pattern,
    /// The scene that it was made for.
    pub scene: Scene,
    /// The state of its device that is meant, where it is one of several.
    pub state: Option<String>,
}

impl Design {
    /// Its cells `[y][x]`, 1 = electrode, and how many there are along a side.
    #[must_use]
    pub fn cells(&self) -> (&[u8], usize) {
        (self.pattern.cells(), self.pattern.raster().columns())
    }
}

/// The designs of an artifact.
pub struct Designs {
    labels: Vec<DesignLabel>,
    merits: Vec<Option<Merit>>,
    patterns: Vec<Pattern>,
    scene: Scene,
    source: String,
}

impl Designs {
    /// Reads all of them; `None` where the artifact is not one of a stage of kind `design` or `verify`.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn read(artifact: &Artifact) -> Result<Option<Self>, StoreError> {
        if !matches!(artifact.kind(), "design" | "verify") {
            return Ok(None);
        }
        let rows = DesignRows::open(artifact)?;
        let (case, name, role) = (rows.case().read()?, rows.name().read()?, rows.role().read()?);
        let (member, units) = (rows.member().read()?, rows.units().read()?);
        let label = |i: usize| DesignLabel {
            case: case[i].clone(),
            name: name[i].clone(),
            role: role[i],
            member: member[i],
            units: units[i],
        };
        let merits = match artifact.kind() {
            "verify" => merits(&Verification::open(artifact)?)?,
            _ => vec![None; case.len()],
        };
        Ok(Some(Self {
            labels: (0..case.len()).map(label).collect(),
            merits,
            patterns: rows.patterns().read()?,
            scene: StoredAttribute::new(artifact, "scene").read()?,
            source: format!("artifact {}", artifact.digest()),
        }))
    }

    /// The one that is wanted; see [`DesignFilter::choose`].
    ///
    /// # Errors
    /// When none is as wanted, or several targets or kinds of designs are: with a list of them.
    pub fn choose(&self, wanted: &DesignFilter<'_>) -> Result<Design, InputError> {
        let row = wanted.choose(&self.labels, &self.merits)?;
        Ok(Design {
            title: self.labels[row].to_string(),
            label: Some(self.labels[row].clone()),
            source: self.source.clone(),
            pattern: self.patterns[row].clone(),
            scene: self.scene.clone(),
            state: None,
        })
    }
}

/// How good the designs of a `verify` stage are; none of those without a field.
fn merits(view: &VerificationView<'_>) -> Result<Vec<Option<Merit>>, StoreError> {
    let (distance, along) = (
        view.component().distance().read()?,
        view.component().simulated().read()?,
    );
    let merit = |row: usize| {
        Some(Merit {
            distance_mm: *distance.get(row)?,
            along_mm: *along.get(row)?,
        })
    };
    Ok(view
        .simulated_rows()?
        .into_iter()
        .map(|row| row.and_then(merit))
        .collect())
}

/// The one pattern of a file, for the scene in another.
///
/// # Errors
/// When one cannot be read, or the file holds several patterns.
pub fn of_file(file: &str, scene: &Path) -> Result<Design, InputError> {
    let scene = read_scene(scene)?;
    let patterns = direct::patterns(&[file.to_owned()], scene.form())?;
    let [pattern] = patterns.as_slice() else {
        let message = format!(
            "{file} contains {} patterns; only one can be exported at a time",
            patterns.len()
        );
        return Err(InputError::new(message).help("write the one that is meant into a file of its own"));
    };
    let title = Path::new(file).file_stem().unwrap_or_default().to_string_lossy();
    Ok(Design {
        label: None,
        title: title.into_owned(),
        source: format!("file {file}"),
        pattern: pattern.clone(),
        scene,
        state: None,
    })
}
