//! Scenes and patterns that somebody names, outside a pipeline.

use std::path::Path;

use crate::base::{Document, InputError};
use crate::content::named_patterns;
use crate::orchestrator::splice_scene;
use crate::pattern::{Pattern, PatternForm};
use crate::scene::Scene;

/// Why there is no answer.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum DirectError {
    /// A scene or pattern that cannot be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Input(#[from] InputError),
    /// The numerical work failed.
    #[error("{0}")]
    Failed(String),
}

/// All patterns of a form that the arguments name, in order.
///
/// # Errors
/// When one cannot be read.
pub fn patterns(arguments: &[String], form: PatternForm) -> Result<Vec<Pattern>, InputError> {
    let mut all = Vec::new();
    for argument in arguments {
        all.extend(named_patterns(argument, form)?);
    }
    Ok(all)
}

/// The scene in a file: a scene, or a pipeline whose scene is meant.
///
/// # Errors
/// When it cannot be read.
pub fn read_scene(path: &Path) -> Result<Scene, InputError> {
    let mut root = Document::load(path)?.root;
    splice_scene(&mut root, path)?;
    super::checked_scene(root.peek("scene").unwrap_or(&root))
}
