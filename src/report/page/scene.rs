//! The scene: what was simulated, which effects, and what was left out although it matters.

use crate::base::Canonical;
use crate::content::{Solutions, StoredAttribute, Verification};
use crate::report::artifacts::{RunArtifacts, Source};
use crate::report::error::ReportError;
use crate::report::format::cut;
use crate::report::history::History;
use crate::report::html::{Column, Page};
use crate::report::kinds::PRESENTERS;
use crate::report::warnings::warnings;
use crate::scene::Scene;

/// A scene with its effects as simulated, and the stages that have it.
struct Simulated {
    scene: Scene,
    effects: String,
    stages: Vec<String>,
}

/// Adds the scenes, the effects that were simulated, and the warnings.
pub fn section(page: &mut Page, run: &RunArtifacts<'_>, history: &History) -> Result<(), ReportError> {
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
    let all: Vec<String> = run.made.iter().map(|made| made.stage.clone()).collect();
    let of_model = history.neglected.iter().cloned().chain(warnings(run, &all)?);
    let mut warned: Vec<String> = of_model.map(|text| format!("model warning: {text}")).collect();
    for presenter in PRESENTERS {
        warned.extend(presenter.results(run)?.into_iter().flat_map(|results| results.warnings));
    }
    if scenes.is_empty() && warned.is_empty() {
        return Ok(());
    }
    page.section("Scene, effects and warnings");
    for simulated in &scenes {
        page.line(&format!("Simulated in {}:", cut(&simulated.stages.join(", "), 300)));
        page.columns("The scene", &[("", Column::Key), ("", Column::Wide)], &rows(simulated));
    }
    if warned.is_empty() {
        page.line(
            "No warnings: screening found no effect that matters and was left out, and no stage warned of anything.",
        );
    } else {
        let row = |text| vec!["warning".to_owned(), text];
        let rows: Vec<Vec<String>> = warned.into_iter().map(row).collect();
        page.columns("Warnings", &[("", Column::Key), ("what", Column::Wide)], &rows);
    }
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

/// The parts of a scene, each on a line of its own.
fn rows(simulated: &Simulated) -> Vec<Vec<String>> {
    let row = |name: &str, value: &str| vec![name.to_owned(), value.to_owned()];
    let mut rows = Vec::new();
    if let Canonical::Map(sections) = simulated.scene.canonical() {
        for (name, section) in sections.iter().filter(|(name, _)| *name != "effects") {
            let text = section.to_string();
            let inner = text.strip_prefix('{').and_then(|text| text.strip_suffix('}'));
            rows.push(row(name, inner.unwrap_or(&text)));
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_is_told_part_by_part() {
        let told = rows(&Simulated {
            scene: Scene::vhb4910(),
            effects: "{}".into(),
            stages: Vec::new(),
        });
        let names: Vec<&str> = told.iter().map(|row| row[0].as_str()).collect();
        assert_eq!(names[..3], ["drive", "geometry", "material"]);
        assert!(
            told[1][1].contains("side: 50 mm") && !told[1][1].starts_with('{'),
            "{told:?}"
        );
        assert_eq!(told[told.len() - 1], ["effects simulated", "none beyond the model"]);
    }
}
