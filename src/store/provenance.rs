//! Who made an artifact, when, how and from what: written beside the content, and no part of its identity.

use crate::base::Digest;

/// The circumstances in which an artifact was made.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Provenance {
    /// When, in UTC, RFC 3339.
    pub created: String,
    /// Name of the machine.
    pub host: String,
    /// Version of this crate.
    pub version: String,
    /// Architecture, operating system and processor.
    pub target: String,
    /// What the work took, s.
    pub seconds: f64,
    /// The action, if one made it.
    pub action: Option<Digest>,
    /// Kind of the stage.
    pub kind: String,
    /// RECIPE number of the kind.
    pub recipe: u32,
    /// Canonical parameters as text.
    pub parameters: String,
    /// Digests of the artifacts that were read.
    pub inputs: Vec<Digest>,
}

impl Provenance {
    /// The attributes of `/provenance`.
    #[must_use]
    pub fn entries(&self) -> Vec<(&'static str, String)> {
        let inputs: Vec<String> = self.inputs.iter().map(Digest::to_string).collect();
        vec![
            ("created", self.created.clone()),
            ("host", self.host.clone()),
            ("version", self.version.clone()),
            ("target", self.target.clone()),
            ("seconds", format!("{:.3}", self.seconds)),
            ("action", self.action.map_or_else(String::new, |key| key.to_string())),
            ("kind", self.kind.clone()),
            ("recipe", self.recipe.to_string()),
            ("parameters", self.parameters.clone()),
            ("inputs", inputs.join("\n")),
        ]
    }
}
