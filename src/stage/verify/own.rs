//! The user's own patterns, which are compared with the designs of each target.

use deaflow_base::Document;
use deaflow_content::{DesignRows, Samples};
use deaflow_design::{ConstraintParameters, own_pattern_status};
use deaflow_orchestrator::StageError;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_store::Artifact;

/// Distinct patterns from files.
pub struct OwnPatterns(Vec<Pattern>);

/// A pattern for a target.
pub struct OwnCase {
    /// The row of the first design of the target.
    pub target: usize,
    /// The index of the pattern.
    pub pattern: usize,
}

impl OwnPatterns {
    /// Reads the patterns of artifacts.
    ///
    /// # Errors
    /// If one cannot be read.
    pub fn read(artifacts: &[&Artifact]) -> Result<Self, StageError> {
        let mut own: Vec<Pattern> = Vec::new();
        for artifact in artifacts {
            for pattern in Samples::open(artifact)?.rows().patterns().read()? {
                if !own.contains(&pattern) {
                    own.push(pattern);
                }
            }
        }
        Ok(Self(own))
    }

    /// The patterns.
    pub fn patterns(&self) -> &[Pattern] {
        &self.0
    }

    /// Adds each pattern to each target, after all designs. Returns the added cases in order.
    ///
    /// # Errors
    /// If the constraints of a target cannot be read.
    pub fn add_to(&self, rows: &mut DesignRows, scene: &Scene) -> Result<Vec<OwnCase>, StageError> {
        let designs = rows.clone();
        let is_first = |row: &usize| {
            let same = |other: usize| {
                (&designs.case[other], &designs.name[other]) == (&designs.case[*row], &designs.name[*row])
            };
            !(0..*row).any(same)
        };
        let areas: Vec<f64> = self.0.iter().map(|pattern| scene.area_fraction(pattern)).collect();
        let mut added = Vec::new();
        for target in (0..designs.len()).filter(is_first) {
            for (number, pattern) in self.0.iter().enumerate() {
                let status = status(&designs, target, pattern, scene).map_err(StageError::input)?;
                rows.push_own((&designs, target), (number as u64, pattern, areas[number]), status);
                added.push(OwnCase {
                    target,
                    pattern: number,
                });
            }
        }
        Ok(added)
    }
}

/// Returns the status of a pattern for the area and constraints of a target.
fn status(designs: &DesignRows, target: usize, pattern: &Pattern, scene: &Scene) -> Result<String, String> {
    let document = Document::from_text(std::path::Path::new("constraints"), &designs.constraints.0[target]);
    let document = document.map_err(|e| e.to_string())?;
    let read = ConstraintParameters::read(&document.root, scene).map_err(|e| e.to_string())?;
    let area = &designs.area_target[target];
    Ok(own_pattern_status(pattern, area, read.constraints()))
}
