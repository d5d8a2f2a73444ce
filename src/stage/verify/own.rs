//! A person's own patterns, beside the designs of each target.

use deaflow_base::Document;
use deaflow_content::{DesignRows, Samples};
use deaflow_design::ConstraintParameters;
use deaflow_orchestrator::StageError;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_store::Artifact;

/// Patterns from files, each once.
pub struct OwnPatterns(Vec<Pattern>);

/// One of them for one target: the row of the target's first design, and which pattern.
pub struct OwnCase {
    /// A row of a design of the target.
    pub target: usize,
    /// Which pattern.
    pub pattern: usize,
}

impl OwnPatterns {
    /// The patterns of some artifacts, end to end.
    ///
    /// # Errors
    /// When one cannot be read.
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

    /// Adds each pattern to each target of the rows, after all designs; gives what was added, in order.
    ///
    /// # Errors
    /// When the constraints of a target cannot be read.
    pub fn add_to(&self, rows: &mut DesignRows, scene: &Scene) -> Result<Vec<OwnCase>, StageError> {
        let designs = rows.clone();
        let is_first = |row: &usize| {
            let same = |other: usize| {
                (&designs.case[other], &designs.name[other]) == (&designs.case[*row], &designs.name[*row])
            };
            !(0..*row).any(same)
        };
        let mut added = Vec::new();
        for target in (0..designs.len()).filter(is_first) {
            for (number, pattern) in self.0.iter().enumerate() {
                let status = status(&designs, target, pattern, scene).map_err(StageError::input)?;
                rows.push_own((&designs, target), (number as u64, pattern), status);
                added.push(OwnCase {
                    target,
                    pattern: number,
                });
            }
        }
        Ok(added)
    }
}

/// `met`, or what of a target a pattern was not made for: its area and its constraints, as far as they can be told from the pattern.
fn status(designs: &DesignRows, target: usize, pattern: &Pattern, scene: &Scene) -> Result<String, String> {
    let document = Document::from_text(std::path::Path::new("constraints"), &designs.constraints.0[target]);
    let document = document.map_err(|e| e.to_string())?;
    let constraints = ConstraintParameters::read(&document.root, scene)
        .map_err(|e| e.to_string())?
        .constraints()
        .clone();
    let mut lines = Vec::new();
    let (area, wanted) = (pattern.area_fraction(), &designs.area_target[target]);
    let cell = 1.0 / pattern.raster().cells() as f64;
    if wanted
        .parse::<f64>()
        .is_ok_and(|wanted| (wanted - area).abs() > 0.5 * cell)
    {
        lines.push(format!("area {area:.4}, wanted {wanted}"));
    }
    lines.extend(constraints.violations(pattern).lines());
    if constraints.limits().has_margins() {
        lines.push("margins not looked at".to_owned());
    }
    Ok(match lines.is_empty() {
        true => "met".to_owned(),
        false => lines.join("; "),
    })
}
