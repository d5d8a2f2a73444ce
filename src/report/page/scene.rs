//! The scene: what was simulated, with which effects, and the warnings.

use super::warnings::ReportWarnings;
use crate::artifacts::{ArtifactReader, RunArtifacts};
use crate::error::ReportError;
use crate::format::cut;
use crate::history::PipelineHistory;
use crate::html::{Column, Page};
use deaflow_base::Canonical;
use deaflow_content::{Solutions, StoredAttribute, Verification};
use deaflow_scene::Scene;

/// A scene with the simulated effects, and its stages.
struct SimulatedScene {
    scene: Scene,
    effects: String,
    stages: Vec<String>,
}

/// Adds the scenes and the simulated effects.
pub fn section(
    page: &mut Page,
    run: &RunArtifacts<'_>,
    history: &PipelineHistory,
    warned: &ReportWarnings,
) -> Result<(), ReportError> {
    let solved = run.each("solve", |source| {
        let view = source.of(Solutions::open(source.artifact))?;
        simulated(source, &view.scene(), source.of(view.effects().text())?)
    })?;
    let verified = run.each("verify", |source| {
        let view = source.of(Verification::open(source.artifact))?;
        simulated(source, &view.scene(), source.of(view.effects().text())?)
    })?;
    let mut scenes: Vec<SimulatedScene> = Vec::new();
    for one in solved.into_iter().chain(verified) {
        match scenes
            .iter_mut()
            .find(|s| s.scene == one.scene && s.effects == one.effects)
        {
            Some(known) => known.stages.extend(one.stages),
            None => scenes.push(one),
        }
    }
    if scenes.is_empty() && warned.is_empty() {
        return Ok(());
    }
    page.section("Scene, effects and warnings");
    for simulated in &scenes {
        page.line(&format!("Simulated in {}:", cut(&simulated.stages.join(", "), 300)));
        let first = simulated.stages.first();
        let stage = history.stages.iter().find(|stage| Some(&stage.name) == first);
        let written = stage.map_or(&[][..], |stage| &stage.scene);
        page.columns(
            "The scene",
            &[("", Column::Key), ("", Column::Wide)],
            &scene_rows(&simulated.scene, &simulated.effects, written),
        );
    }
    page.line(match warned.is_empty() {
        true => "No warnings: no significant effect was neglected, and no stage has a warning.",
        false => "The warnings are at the top of the page.",
    });
    Ok(())
}

fn simulated(
    source: &ArtifactReader<'_>,
    scene: &StoredAttribute<'_, Scene>,
    effects: Option<String>,
) -> Result<SimulatedScene, ReportError> {
    Ok(SimulatedScene {
        scene: source.of(scene.read())?,
        effects: effects.ok_or_else(|| source.wrong("it does not list the simulated effects"))?,
        stages: vec![source.stage.stage.clone()],
    })
}

/// Lists the parts of a scene, as in the pipeline or else in canonical form, and the simulated effects.
pub(crate) fn scene_rows(scene: &Scene, effects: &str, written: &[(String, String)]) -> Vec<Vec<String>> {
    let row = |name: &str, value: &str| vec![name.to_owned(), value.to_owned()];
    let parts = match written {
        [] => canonical_parts(scene),
        written => written.to_vec(),
    };
    let mut rows: Vec<Vec<String>> = parts
        .iter()
        .filter(|(name, _)| name != "effects")
        .map(|(name, text)| row(name, text))
        .collect();
    let effects = match without_braces(effects) {
        "" => "none",
        effects => effects,
    };
    rows.push(row("effects simulated", effects));
    rows
}

fn canonical_parts(scene: &Scene) -> Vec<(String, String)> {
    let Canonical::Map(parts) = scene.canonical() else {
        return Vec::new();
    };
    let part = |(name, part): (&String, &Canonical)| (name.clone(), without_braces(&part.to_string()).to_owned());
    parts.iter().map(part).collect()
}

/// Returns the inside of a mapping; other texts as they are.
fn without_braces(text: &str) -> &str {
    let text = text.trim();
    let inner = text.strip_prefix('{').and_then(|text| text.strip_suffix('}'));
    inner.unwrap_or(text).trim()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_is_listed_part_by_part() {
        let scene = Scene::vhb4910();
        let parts = scene_rows(&scene, "{}", &[]);
        let names: Vec<&str> = parts.iter().map(|row| row[0].as_str()).collect();
        assert_eq!(names[..3], ["drive", "geometry", "material"]);
        assert!(
            parts[1][1].contains("side: 50 mm") && !parts[1][1].starts_with('{'),
            "{parts:?}"
        );
        assert_eq!(parts[parts.len() - 1], ["effects simulated", "none"]);
        let with_gent = scene_rows(&scene, "{strain_stiffening: {jm: 90, model: gent}}", &[]);
        let last = ["effects simulated", "strain_stiffening: {jm: 90, model: gent}"];
        assert_eq!(with_gent[with_gent.len() - 1], last);

        let written = [("drive", "voltage: 5.25 kV"), ("effects", "")].map(|(a, b)| (a.to_owned(), b.to_owned()));
        let parts = scene_rows(&scene, "{}", &written);
        assert_eq!(parts[0], ["drive", "voltage: 5.25 kV"]);
        assert_eq!(parts.len(), 2);
    }
}
