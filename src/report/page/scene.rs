//! The scene: what was simulated, which effects, and what was left out although it matters.

use super::warned::Warned;
use crate::artifacts::{RunArtifacts, Source};
use crate::error::ReportError;
use crate::format::cut;
use crate::history::History;
use crate::html::{Column, Page};
use deaflow_base::Canonical;
use deaflow_content::{Solutions, StoredAttribute, Verification};
use deaflow_scene::Scene;

/// A scene with its effects as simulated, and the stages that have it.
struct Simulated {
    scene: Scene,
    effects: String,
    stages: Vec<String>,
}

/// Adds the scenes and the effects that were simulated.
pub fn section(page: &mut Page, run: &RunArtifacts<'_>, history: &History, warned: &Warned) -> Result<(), ReportError> {
    let solved = run.each("solve", |source| {
        let view = source.of(Solutions::open(source.artifact))?;
        simulated(source, &view.scene(), source.of(view.effects().text())?)
    })?;
    let verified = run.each("verify", |source| {
        let view = source.of(Verification::open(source.artifact))?;
        simulated(source, &view.scene(), source.of(view.effects().text())?)
    })?;
    let mut scenes: Vec<Simulated> = Vec::new();
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
            &rows(simulated, written),
        );
    }
    page.line(match warned.is_empty() {
        true => {
            "No warnings: screening found no effect that matters and was left out, and no stage warned of anything."
        }
        false => "What is left out although it matters stands at the top of the page.",
    });
    Ok(())
}

fn simulated(
    source: &Source<'_>,
    scene: &StoredAttribute<'_, Scene>,
    effects: Option<String>,
) -> Result<Simulated, ReportError> {
    Ok(Simulated {
        scene: source.of(scene.read())?,
        effects: effects.ok_or_else(|| source.wrong("it does not say which effects were simulated"))?,
        stages: vec![source.stage.stage.clone()],
    })
}

/// The parts of a scene, each on a line of its own: as the pipeline has them, or where it is not known how, in the units of artifacts.
fn rows(simulated: &Simulated, written: &[(String, String)]) -> Vec<Vec<String>> {
    let row = |name: &str, value: &str| vec![name.to_owned(), value.to_owned()];
    let parts = match written {
        [] => canonical_parts(&simulated.scene),
        written => written.to_vec(),
    };
    let mut rows: Vec<Vec<String>> = parts
        .iter()
        .filter(|(name, _)| name != "effects")
        .map(|(name, text)| row(name, text))
        .collect();
    let none = matches!(simulated.effects.trim(), "" | "{}");
    rows.push(row(
        "effects simulated",
        if none {
            "none beyond the model"
        } else {
            &simulated.effects
        },
    ));
    rows
}

fn canonical_parts(scene: &Scene) -> Vec<(String, String)> {
    let Canonical::Map(parts) = scene.canonical() else {
        return Vec::new();
    };
    let part = |(name, part): (&String, &Canonical)| {
        let text = part.to_string();
        let inner = text.strip_prefix('{').and_then(|text| text.strip_suffix('}'));
        (name.clone(), inner.unwrap_or(&text).trim().to_owned())
    };
    parts.iter().map(part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_is_told_part_by_part() {
        let simulated = Simulated {
            scene: Scene::vhb4910(),
            effects: "{}".into(),
            stages: Vec::new(),
        };
        let told = rows(&simulated, &[]);
        let names: Vec<&str> = told.iter().map(|row| row[0].as_str()).collect();
        assert_eq!(names[..3], ["drive", "geometry", "material"]);
        assert!(
            told[1][1].contains("side: 50 mm") && !told[1][1].starts_with('{'),
            "{told:?}"
        );
        assert_eq!(told[told.len() - 1], ["effects simulated", "none beyond the model"]);

        let written = [("drive", "voltage: 5.25 kV"), ("effects", "")].map(|(a, b)| (a.to_owned(), b.to_owned()));
        let told = rows(&simulated, &written);
        assert_eq!(told[0], ["drive", "voltage: 5.25 kV"]);
        assert_eq!(told.len(), 2);
    }
}
