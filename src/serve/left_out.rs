//! Scenes that the sketchpad does not show: those whose membrane leaves its plane, and those that a sweep completes.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use deaflow_base::InputError;
use deaflow_scene::{Pressurised, Scene};
use deaflow_stage::direct;

/// A file whose scene is not shown.
pub struct LeftOut {
    path: PathBuf,
    reason: String,
    help: String,
}

impl LeftOut {
    /// Returns a file whose scene a sweep completes; `None` for another one.
    #[must_use]
    pub fn incomplete(path: &Path) -> Option<Self> {
        let axes = direct::axes_of_scene(path);
        let named: Vec<String> = axes.iter().map(|axis| format!("`${{{axis}}}`")).collect();
        (!axes.is_empty()).then(|| Self {
            path: path.to_owned(),
            reason: format!("the sweep of the pipeline sets {} of its scene", named.join(", ")),
            help: "save the scene with one value in a file of its own, and open it by `deaflow sketch`".to_owned(),
        })
    }

    /// Returns the error of a command that opens the file.
    #[must_use]
    pub fn error(self) -> InputError {
        let path = self.path.display();
        InputError::new(format!("{path}: {}", self.reason)).help(self.help)
    }

    /// Returns a file whose scene moves out of the plane; `None` for another one.
    #[must_use]
    pub fn in_space(path: &Path, scene: &Scene) -> Option<Self> {
        Some(Self {
            path: path.to_owned(),
            reason: out_of_plane(scene)?,
            help: advice(&path.display().to_string()),
        })
    }

    /// Returns path, reason and advice.
    #[must_use]
    pub fn document(&self) -> Value {
        json!({ "path": self.path, "reason": self.reason, "help": self.help })
    }
}

/// Refuses a scene whose membrane leaves its plane; `file` is what a command names it by.
///
/// # Errors
/// If it does.
pub fn check_in_plane(scene: &Scene, file: &str) -> Result<(), InputError> {
    match out_of_plane(scene) {
        Some(reason) => Err(InputError::new(reason).help(advice(file))),
        None => Ok(()),
    }
}

/// Says what moves a membrane out of its plane.
fn out_of_plane(scene: &Scene) -> Option<String> {
    let what = match scene.pressurised() {
        Some(Pressurised::Pressure(_)) => "has a pressure",
        Some(Pressurised::Volume(_)) => "encloses a volume",
        None if scene.is_in_space() => "has a body that moves out of the plane",
        None => return None,
    };
    Some(format!(
        "the sketchpad simulates membranes in the plane; this one {what}"
    ))
}

fn advice(file: &str) -> String {
    format!("`deaflow solve {file} PATTERN --figure out.png` simulates and draws it")
}
