//! Differences between two scenes that affect their simulation.

use std::collections::BTreeMap;
use std::fmt;

use super::model::Scene;
use deaflow_base::Canonical;

/// A key with different values in two scenes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// The key, as in `drive.voltage`.
    pub key: String,
    /// Its value in the first scene, or `none`.
    pub first: String,
    /// Its value in the second scene, or `none`.
    pub second: String,
}

impl Difference {
    /// Formats several differences on one line.
    #[must_use]
    pub fn listed(differences: &[Self]) -> String {
        let list: Vec<String> = differences.iter().map(ToString::to_string).collect();
        list.join("; ")
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} is {} there and {} here", self.key, self.first, self.second)
    }
}

impl Scene {
    /// Returns every key with another value than in `other` that affects the simulation. Time course of the drive and
    /// properties only count if screening chooses the effects.
    #[must_use]
    pub fn differences(&self, other: &Self) -> Vec<Difference> {
        let decided = !self.auto && !other.auto;
        let [first, second] = [self, other].map(Scene::canonical);
        // A simulation in time is valid at its time only, an equilibrium at any time.
        let in_time = first.leaves().iter().any(|(key, _)| is_in_time(key));
        let leaves = |canonical| leaves(canonical, decided, in_time);
        let [first, second] = [leaves(&first), leaves(&second)];
        let keys = first
            .keys()
            .chain(second.keys().filter(|key| !first.contains_key(*key)));
        let value = |of: &BTreeMap<String, String>, key: &str| of.get(key).map_or("none", String::as_str).to_owned();
        let mut found: Vec<Difference> = keys
            .map(|key| Difference {
                key: key.clone(),
                first: value(&first, key),
                second: value(&second, key),
            })
            .filter(|difference| difference.first != difference.second)
            // The entries of a mapping show its difference from an empty one.
            .filter(|difference| {
                let has_entries = |of: &BTreeMap<String, String>| {
                    let below = format!("{}.", difference.key);
                    of.keys().any(|key| key.starts_with(&below))
                };
                let is_filled = |own: &str, other| own == EMPTY && has_entries(other);
                !is_filled(&difference.first, &second) && !is_filled(&difference.second, &first)
            })
            .collect();
        found.sort_by(|a, b| a.key.cmp(&b.key));
        found
    }
}

/// How an empty mapping is written.
const EMPTY: &str = "{}";

/// Returns whether a key describes the time course of the drive.
fn is_in_time(key: &str) -> bool {
    key.starts_with("drive.")
        && !["drive.voltage", "drive.charge", "drive.frequency"]
            .iter()
            .any(|of| key.starts_with(of))
}

/// Returns the values by key, without those that only screening uses if the effects are given.
fn leaves(canonical: &Canonical, decided: bool, in_time: bool) -> BTreeMap<String, String> {
    let is_for_screening =
        |key: &str| key.starts_with("properties") || key == "drive.frequency" || (is_in_time(key) && !in_time);
    let leaves = canonical.leaves().into_iter();
    leaves
        .filter(|(key, _)| !(decided && is_for_screening(key)))
        .map(|(key, value)| (key, value.to_string()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(drive: &str, effects: &str) -> Scene {
        let text = format!(
            "{{ geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: 50 }}, material: {{ \
             model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}, drive: {drive}, {effects} }}"
        );
        Scene::from_text(&text).unwrap()
    }

    fn said(a: &Scene, b: &Scene) -> Vec<String> {
        a.differences(b).iter().map(ToString::to_string).collect()
    }

    #[test]
    fn differences_are_named_with_both_values() {
        let [high, low] = ["{ voltage: 5.25 kV }", "{ voltage: 5 kV }"].map(|drive| scene(drive, "effects: {}"));
        assert_eq!(said(&high, &low), ["drive.voltage is 5250 V there and 5000 V here"]);
        assert!(high.differences(&high).is_empty());
        assert!(
            high.differences(&scene("{ voltage: 5250 }", "effects: {}")).is_empty(),
            "equal quantities are equal"
        );
        let stiff = scene(
            "{ voltage: 5250 }",
            "effects: { strain_stiffening: { model: gent, jm: 125 } }",
        );
        let found = said(&high, &stiff);
        assert!(
            !found.iter().any(|one| one.starts_with("effects is")),
            "the entries say it: {found:?}"
        );
        assert!(
            found.contains(&"effects.strain_stiffening.jm is none there and 125 here".to_owned()),
            "{found:?}"
        );
    }

    #[test]
    fn a_simulation_in_time_is_valid_at_its_time_only() {
        let plain = scene("{ voltage: 5250 }", "effects: {}");
        let [early, late] =
            ["10 s", "30 s"].map(|time| scene(&format!("{{ voltage: 5250, duration: {time} }}"), "effects: {}"));
        assert_eq!(said(&early, &late), ["drive.duration is 10 s there and 30 s here"]);
        assert_eq!(said(&early, &plain), ["drive.duration is 10 s there and none here"]);
        assert!(
            said(&plain, &early).is_empty(),
            "an equilibrium holds however long it lasts"
        );
    }

    #[test]
    fn data_for_screening_only_counts_if_screening_chooses_the_effects() {
        let plain = scene("{ voltage: 5250 }", "effects: {}");
        let alternating = "{ voltage: 5250, frequency: 2 Hz }";
        assert!(
            plain
                .differences(&scene(alternating, "effects: {}, properties: { density: 960 }"))
                .is_empty()
        );
        let auto = scene(alternating, "effects: auto");
        assert!(said(&plain, &auto).contains(&"drive.frequency is none there and 2 Hz here".to_owned()));
    }
}
