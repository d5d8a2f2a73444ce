//! The scene: what was simulated, which effects, and what was left out although it matters.

use crate::base::Document;
use crate::content::StoredAttribute;
use crate::report::course::Course;
use crate::report::format::cut;
use crate::report::gather::{ReportError, Source, each};
use crate::report::html::{Column, Page};
use crate::report::warnings::warnings;
use crate::store::Store;

/// A scene with its effects as simulated, and the stages that have it.
struct Simulated {
    scene: String,
    effects: String,
    stages: Vec<String>,
}

/// Adds the scenes, the effects that were simulated, and the warnings.
pub fn section(page: &mut Page, store: &Store, course: &Course, others: &[String]) -> Result<(), ReportError> {
    let made = &course.made();
    let mut scenes: Vec<Simulated> = Vec::new();
    for kind in ["solve", "verify"] {
        for (stage, scene, effects) in each(store, made, kind, simulated)? {
            match scenes.iter_mut().find(|s| s.scene == scene && s.effects == effects) {
                Some(known) => known.stages.push(stage),
                None => scenes.push(Simulated {
                    scene,
                    effects,
                    stages: vec![stage],
                }),
            }
        }
    }
    let warnings: Vec<String> = course.neglected.iter().cloned().chain(warnings(store, made)?).collect();
    if scenes.is_empty() && warnings.is_empty() && others.is_empty() {
        return Ok(());
    }
    page.section("Scene, effects and warnings");
    for simulated in &scenes {
        page.line(&format!("Simulated in {}:", cut(&simulated.stages.join(", "), 300)));
        page.columns("The scene", &[("", Column::Key), ("", Column::Wide)], &rows(simulated));
    }
    match warnings.is_empty() && others.is_empty() {
        true => page.line(
            "No warnings: screening found no effect that matters and was left out, and no stage warned of anything.",
        ),
        false => {
            let warned = warnings.iter().map(|text| {
                vec![
                    "warning".to_owned(),
                    format!("model warning: {text}"),
                ]
            });
            let others = others.iter().map(|text| vec!["warning".to_owned(), text.clone()]);
            let rows: Vec<Vec<String>> = warned.chain(others).collect();
            page.columns("Warnings", &[("", Column::Key), ("what", Column::Wide)], &rows);
        }
    }
    Ok(())
}

/// Stage, scene and effects.
fn simulated(source: &Source<'_>) -> Result<(String, String, String), ReportError> {
    let text = |name| source.of(StoredAttribute::<String>::new(source.artifact, name).text());
    let (scene, effects) = (text("scene")?, text("effects")?);
    let owned = |text: Option<&str>| text.unwrap_or_default().to_owned();
    Ok((source.stage.stage.clone(), owned(scene), owned(effects)))
}

/// The parts of a scene, each on a line of its own; as it stands where it cannot be read.
fn rows(simulated: &Simulated) -> Vec<Vec<String>> {
    let row = |name: &str, value: &str| vec![name.to_owned(), value.to_owned()];
    let mut rows = Vec::new();
    let document = Document::from_text(std::path::Path::new("scene"), &simulated.scene);
    let parts = document
        .as_ref()
        .ok()
        .and_then(|d| d.root.entries("the scene").ok())
        .unwrap_or_default();
    let inner = simulated.scene.trim().trim_start_matches('{').trim_end_matches('}');
    for (key, _) in parts {
        let Ok(name) = key.text("key") else { continue };
        if name != "effects" {
            rows.push(row(name, &part(inner, name)));
        }
    }
    if rows.is_empty() {
        rows.push(row("scene", &simulated.scene));
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

/// The text of one part of a scene on one line: from its key to the brace that closes it.
fn part(scene: &str, name: &str) -> String {
    let key = format!("{name}: ");
    let Some(from) = scene.find(&key).map(|at| at + key.len()) else {
        return String::new();
    };
    let mut depth = 0;
    let end = scene[from..].char_indices().find(|(_, c)| {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        depth == 0 && matches!(c, '}' | ',')
    });
    let text = end.map_or(&scene[from..], |(at, _)| &scene[from..=from + at]);
    text.trim()
        .trim_start_matches('{')
        .trim_end_matches([',', '}'])
        .trim()
        .to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_is_told_part_by_part() {
        let scene = "{ geometry: { side: 50 mm, cells: 50 }, drive: {voltage: 5250 V}, effects: {}, properties: {law: {a: b}, c: d} }";
        let told = rows(&Simulated {
            scene: scene.into(),
            effects: "{}".into(),
            stages: Vec::new(),
        });
        let told: Vec<String> = told.iter().map(|row| row.join(" = ")).collect();
        assert_eq!(
            told,
            [
                "geometry = side: 50 mm, cells: 50",
                "drive = voltage: 5250 V",
                "properties = law: {a: b}, c: d",
                "effects simulated = none beyond the model"
            ]
        );
    }
}
