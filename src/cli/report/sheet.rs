//! Makes the fabrication sheet of one design of a pipeline.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::ReportArguments;
use super::voltage_sweep::voltage_limits;
use crate::neglected::neglected_effects;
use crate::progress::ProgressMode;
use crate::{CliError, write};
use deaflow_design::{DesignLabel, SimulatedScore};
use deaflow_orchestrator::Pipeline;
use deaflow_report::{Design, FabricationSheet, PipelineHistory, RunArtifacts, designs};
use deaflow_stage::direct;

/// A sheet that is ready to be written.
pub struct PreparedSheet {
    file: PathBuf,
    html: String,
    title: String,
    /// The stage and the artifact of the design.
    stage: String,
    artifact: String,
    is_verified: bool,
}

impl PreparedSheet {
    /// Selects the design as `export design` does, and makes its sheet.
    ///
    /// # Errors
    /// If there is no such design, several match, or an artifact cannot be read.
    pub fn make(
        file: &Path,
        arguments: &ReportArguments,
        pipeline: &Pipeline,
        artifacts: &RunArtifacts<'_>,
        history: &PipelineHistory,
    ) -> Result<Self, CliError> {
        let all = designs(artifacts, &artifacts.superseded())?;
        let design = chosen(&all, arguments)?;
        let only = RunArtifacts {
            stages: std::slice::from_ref(&design.made),
            ..*artifacts
        };
        let neglected = neglected_effects(pipeline, &only, ProgressMode::Bars)?.all();
        let sheet = FabricationSheet {
            run: artifacts,
            history,
            design,
            neglected: &neglected,
            voltages: voltage_limits(design, pipeline),
            scene_file: has_scene_of(pipeline, design).then_some(history.path.as_str()),
        };
        Ok(Self {
            file: file.to_owned(),
            html: sheet.html()?,
            title: sheet.title(),
            stage: design.made.stage.clone(),
            artifact: design.made.digest.to_string(),
            is_verified: design.outcome.is_some(),
        })
    }

    /// Writes the file.
    ///
    /// # Errors
    /// If the system refuses.
    pub fn write(&self) -> Result<(), CliError> {
        write::file(&self.file, self.html.as_bytes())
    }

    /// Describes the sheet for programs.
    pub fn document(&self) -> Value {
        json!({
            "sheet": {
                "file": self.file,
                "design": self.title,
                "stage": self.stage,
                "artifact": self.artifact,
                "verified": self.is_verified,
            },
        })
    }

    /// Describes the sheet for people.
    pub fn text(&self) -> String {
        let verified = if self.is_verified { "" } else { ", not verified" };
        format!(
            "{}: fabrication sheet of {} ({}{verified})",
            self.file.display(),
            self.title,
            self.stage
        )
    }
}

/// Returns the design that the arguments select.
fn chosen<'d>(all: &'d [Design], arguments: &ReportArguments) -> Result<&'d Design, CliError> {
    if all.is_empty() {
        return Err(
            CliError::bad_input(format!("{} has no designs", arguments.pipeline.display()))
                .help("a fabrication sheet needs a stage of kind design or verify"),
        );
    }
    let mut labels: Vec<DesignLabel> = Vec::new();
    let mut scores = Vec::new();
    for design in all {
        let label = label(design);
        if !labels.contains(&label) {
            labels.push(label);
            scores.push(score(design));
        }
    }
    let chosen = &labels[arguments.which.filter().choose(&labels, &scores)?];
    let found: Vec<&Design> = all.iter().filter(|design| label(design) == *chosen).collect();
    // A search for another scene has its own row beside the verified one.
    let verified: Vec<&Design> = found
        .iter()
        .copied()
        .filter(|design| design.outcome.is_some())
        .collect();
    match (verified.as_slice(), found.as_slice()) {
        ([one], _) | ([], [one]) => Ok(one),
        (several, others) => {
            let several = if several.is_empty() { others } else { several };
            let stages: Vec<&str> = several.iter().map(|design| design.made.stage.as_str()).collect();
            Err(
                CliError::bad_input(format!("several stages have {chosen}")).help(format!(
                    "use --until with a stage that needs only one of: {}",
                    stages.join(", ")
                )),
            )
        }
    }
}

fn label(design: &Design) -> DesignLabel {
    DesignLabel {
        case: design.case.clone(),
        name: design.target.clone(),
        role: design.role,
        member: design.member,
        units: design.units,
        raster: design.pattern.raster(),
    }
}

fn score(design: &Design) -> Option<SimulatedScore> {
    Some(SimulatedScore {
        distance_mm: design.distance_mm.unwrap_or(0.0),
        along_mm: design.simulated_mm?,
    })
}

/// Whether a pipeline has the scene of a design, so that commands for one device can read it there, with the overrides
/// of the scene.
fn has_scene_of(pipeline: &Pipeline, design: &Design) -> bool {
    let overrides = pipeline.overrides.iter().map(|(path, value)| format!("{path}={value}"));
    let sets: Vec<String> = overrides.filter(|set| direct::is_of_scene(set)).collect();
    let changes = direct::Changes {
        sets: &sets,
        voltage: None,
    };
    let read = direct::read_scene_with(&pipeline.path, changes);
    read.is_ok_and(|read| read.scene.without_time().differences(&design.scene).is_empty())
}
