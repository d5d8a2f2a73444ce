//! The costs of the stages, and the origin of their artifacts.

use super::dag::build_state;
use crate::format::{bytes, percent, seconds};
use crate::history::{Origin, PipelineHistory, StageRecord};
use crate::html::{Column, Page};
use deaflow_base::readable_time as time;

/// Adds the table of costs.
pub fn section(page: &mut Page, history: &PipelineHistory) {
    page.section("Costs");
    page.line(
        "Time is from the start of a stage to its end. Stages that do not depend on each other run at the same time: \
         part is the part of a stage in the time of the run, so that the parts add up to it, and share is in percent \
         of all parts. Work is the sum over the chunks, several of which run at the same time.",
    );
    let of_all = |stage: &StageRecord| stage.origin.as_ref().map(part);
    let total: f64 = history.stages.iter().filter_map(of_all).sum();
    let row = |stage: &StageRecord| {
        let origin = stage.origin.as_ref();
        let text = |of: &dyn Fn(&Origin) -> String| origin.map_or_else(String::new, of);
        let share = |origin: &Origin| percent(part(origin) / total.max(f64::MIN_POSITIVE), 1);
        let size = |_: &Origin| bytes(stage.bytes);
        vec![
            stage.name.clone(),
            stage.kind.clone(),
            build_state(stage),
            text(&|origin| origin.chunks.to_string()),
            text(&|origin| origin.elapsed.map_or_else(|| "-".to_owned(), seconds)),
            text(&|origin| origin.part.map_or_else(|| "-".to_owned(), seconds)),
            text(&|origin| seconds(origin.work)),
            text(&share),
            text(&size),
        ]
    };
    let mut rows: Vec<Vec<String>> = history.stages.iter().map(row).collect();
    let work: f64 = history
        .stages
        .iter()
        .filter_map(|s| Some(s.origin.as_ref()?.work))
        .sum();
    let size: u64 = history.stages.iter().map(|stage| stage.bytes).sum();
    let blank = String::new;
    rows.push(vec![
        "all".to_owned(),
        blank(),
        blank(),
        blank(),
        blank(),
        seconds(total),
        seconds(work),
        blank(),
        bytes(size),
    ]);
    let columns = [
        ("stage", Column::Key),
        ("kind", Column::Key),
        ("last run", Column::Key),
        ("chunks", Column::Number),
        ("time", Column::Number),
        ("part", Column::Number),
        ("work", Column::Number),
        ("share", Column::Number),
        ("size", Column::Number),
    ];
    page.columns("Costs of the stages", &columns, &rows);
}

/// Returns the part of a stage in the time of its run, s; its work if that is not known.
pub fn part(origin: &Origin) -> f64 {
    origin.part.unwrap_or(origin.work)
}

/// Lists the machines that built an artifact, with the number of chunks if there are several.
fn builders(origin: &Origin) -> String {
    let builders = origin.builders.iter();
    let texts = builders.map(|(host, chunks)| match origin.builders.len() {
        1 => host.clone(),
        _ => format!("{host} ({chunks})"),
    });
    texts.collect::<Vec<_>>().join(", ")
}

/// Adds the table of artifacts, with the machines and versions that built them.
pub fn provenance(page: &mut Page, history: &PipelineHistory) {
    page.section("Provenance");
    let mut lines: Vec<String> = Vec::new();
    for origin in history.stages.iter().filter_map(|stage| stage.origin.as_ref()) {
        let line = format!(
            "Built by deaflow {} on {} ({}).",
            origin.version, origin.host, origin.target
        );
        if !lines.contains(&line) {
            lines.push(line);
        }
    }
    lines.push(format!("Pipeline file: {}", history.path));
    lines.push(
        "Artifacts are named by the BLAKE3 digest of their content; a tooltip shows all of its digits.".to_owned(),
    );
    page.lines(&lines);
    let row = |stage: &StageRecord| {
        let origin = stage.origin.as_ref();
        let needs: Vec<&str> = stage.needs.iter().map(|k| history.stages[*k].name.as_str()).collect();
        vec![
            stage.name.clone(),
            stage
                .digest
                .map_or_else(|| "not built".to_owned(), |digest| digest.to_string()),
            origin.map_or_else(String::new, |origin| time(&origin.created)),
            origin.map_or_else(String::new, builders),
            origin.map_or_else(String::new, |origin| format!("{} {}", stage.kind, origin.recipe)),
            needs.join(", "),
        ]
    };
    let rows: Vec<Vec<String>> = history.stages.iter().map(row).collect();
    let columns = [
        ("stage", Column::Key),
        ("artifact", Column::Digest),
        ("built", Column::Key),
        ("host", Column::Key),
        ("kind and recipe", Column::Key),
        ("needs", Column::Wide),
    ];
    page.columns("Artifacts", &columns, &rows);
}
