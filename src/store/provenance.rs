//! Provenance: who made an artifact, when, how and from what. It is stored with the content but not part of its digest.

use std::collections::BTreeMap;

use super::record::Record;
use deaflow_base::{ActionKey, ArtifactId};

/// How an artifact was made.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Provenance {
    /// Time in UTC, RFC 3339.
    pub created: String,
    /// Host name of the machine.
    pub host: String,
    /// Version of the program.
    pub version: String,
    /// BLAKE3 digest of the sources, the Cargo lock file and the features of the program.
    pub build: String,
    /// Architecture, operating system and processor.
    pub target: String,
    /// Duration of the work, s.
    pub seconds: f64,
    /// Key of the action that made it, if any.
    pub action: Option<ActionKey>,
    /// Kind of the stage.
    pub kind: String,
    /// RECIPE number of the kind.
    pub recipe: u32,
    /// Canonical parameters as text.
    pub parameters: String,
    /// Digests of the input artifacts.
    pub inputs: Vec<ArtifactId>,
    /// Measured times by name, s. They differ between runs, so they cannot be content.
    pub measurements: Vec<(String, f64)>,
}

impl Provenance {
    /// Returns the provenance as far as a record has it.
    #[must_use]
    pub fn of_record(record: &Record) -> Self {
        let action = &record.action;
        Self {
            created: record.created.clone(),
            version: record.version.clone(),
            target: record.target.clone(),
            seconds: record.seconds,
            action: Some(record.key),
            kind: action.kind.clone(),
            recipe: action.recipe,
            parameters: action.parameters.to_string(),
            inputs: action.inputs.clone(),
            ..Self::default()
        }
    }

    /// Reads the attributes of `/provenance`; missing or invalid ones are left empty.
    #[must_use]
    pub fn of_entries(entries: &BTreeMap<String, String>) -> Self {
        let text = |name: &str| entries.get(name).cloned().unwrap_or_default();
        Self {
            created: text("created"),
            host: text("host"),
            version: text("version"),
            build: text("build"),
            target: text("target"),
            seconds: text("seconds").parse().unwrap_or_default(),
            action: text("action").parse().ok(),
            kind: text("kind"),
            recipe: text("recipe").parse().unwrap_or_default(),
            parameters: text("parameters"),
            inputs: text("inputs").lines().filter_map(|input| input.parse().ok()).collect(),
            measurements: measurements(entries),
        }
    }

    /// Returns the attributes of `/provenance`.
    #[must_use]
    pub fn entries(&self) -> Vec<(&'static str, String)> {
        let inputs: Vec<String> = self.inputs.iter().map(ArtifactId::to_string).collect();
        let mut entries = vec![
            ("created", self.created.clone()),
            ("host", self.host.clone()),
            ("version", self.version.clone()),
            ("build", self.build.clone()),
            ("target", self.target.clone()),
            ("seconds", format!("{:.3}", self.seconds)),
            ("action", self.action.map_or_else(String::new, |key| key.to_string())),
            ("kind", self.kind.clone()),
            ("recipe", self.recipe.to_string()),
            ("parameters", self.parameters.clone()),
            ("inputs", inputs.join("\n")),
        ];
        if !self.measurements.is_empty() {
            let lines = self
                .measurements
                .iter()
                .map(|(name, seconds)| format!("{name}: {seconds:e}"));
            entries.push((MEASUREMENTS, lines.collect::<Vec<_>>().join("\n")));
        }
        entries
    }
}

/// The attribute with the measurements, one `name: seconds` per line.
const MEASUREMENTS: &str = "measurements";

/// Reads the measurements from the attributes of `/provenance`.
pub(super) fn measurements(entries: &BTreeMap<String, String>) -> Vec<(String, f64)> {
    let lines = entries.get(MEASUREMENTS).map_or("", String::as_str).lines();
    let read = |line: &str| {
        let (name, seconds) = line.rsplit_once(": ")?;
        Some((name.to_owned(), seconds.parse().ok()?))
    };
    lines.filter_map(read).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again() {
        let provenance = Provenance {
            created: "2026-01-02T03:04:05Z".to_owned(),
            host: "a".to_owned(),
            version: "1".to_owned(),
            build: "b".to_owned(),
            target: "t".to_owned(),
            seconds: 1.25,
            action: Some(ActionKey::of(b"x")),
            kind: "solve".to_owned(),
            recipe: 3,
            parameters: "{a: 1}".to_owned(),
            inputs: vec![ArtifactId::of(b"1"), ArtifactId::of(b"2")],
            measurements: vec![("m".to_owned(), 2.0)],
        };
        let entries = |p: &Provenance| p.entries().into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
        assert_eq!(Provenance::of_entries(&entries(&provenance)), provenance);
        assert_eq!(Provenance::of_entries(&BTreeMap::new()), Provenance::default());
    }

    #[test]
    fn measurements_survive_their_attribute() {
        let measured = vec![
            ("method: linear, small-grid".to_owned(), 3.25e-4),
            ("b".to_owned(), 2.0),
        ];
        let provenance = Provenance {
            measurements: measured.clone(),
            ..Provenance::default()
        };
        let entries = |p: &Provenance| p.entries().into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
        assert_eq!(measurements(&entries(&provenance)), measured);
        let none: BTreeMap<String, String> = entries(&Provenance::default());
        assert!(measurements(&none).is_empty() && !none.contains_key(MEASUREMENTS));
    }
}
