//! What the stages cost, and where everything comes from.

use super::dag::build_state;
use crate::format::{bytes, percent, seconds};
use crate::history::{History, Origin, StageFacts};
use crate::html::{Column, Page};
use deaflow_base::readable_time as time;

/// Adds the table of costs.
pub fn section(page: &mut Page, history: &History) {
    page.section("Costs");
    page.line(
        "Time is from the beginning to the end of the stage when it was built. Stages that do not need each other are built at once: part is the \
         stage's own of the time of the run, so that parts add up to that, and share is of all parts. Work is the sum over its chunks, several \
         of which run at a time.",
    );
    let of_all = |stage: &StageFacts| stage.origin.as_ref().map(part);
    let total: f64 = history.stages.iter().filter_map(of_all).sum();
    let row = |stage: &StageFacts| {
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

/// What building the stage took of the time of its run, s; where that is not known, its work.
pub fn part(origin: &Origin) -> f64 {
    origin.part.unwrap_or(origin.work)
}

/// The machines that built something, with the number of chunks where there were several.
fn builders(origin: &Origin) -> String {
    let builders = origin.builders.iter();
    let told = builders.map(|(host, chunks)| match origin.builders.len() {
        1 => host.clone(),
        _ => format!("{host} ({chunks})"),
    });
    told.collect::<Vec<_>>().join(", ")
}

/// Adds the table of artifacts, and the machines and versions that made them.
pub fn provenance(page: &mut Page, history: &History) {
    page.section("Provenance");
    let mut lines: Vec<String> = Vec::new();
    for origin in history.stages.iter().filter_map(|stage| stage.origin.as_ref()) {
        let line = format!(
            "Made by deaflow {} on {} ({}).",
            origin.version, origin.host, origin.target
        );
        if !lines.contains(&line) {
            lines.push(line);
        }
    }
    lines.push(format!("Pipeline file: {}", history.path));
    lines.push(
        "Artifacts are named by the BLAKE3 digest of their content; point at one for the whole of it.".to_owned(),
    );
    page.lines(&lines);
    let row = |stage: &StageFacts| {
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
        ("made", Column::Key),
        ("built by", Column::Key),
        ("kind and recipe", Column::Key),
        ("needs", Column::Wide),
    ];
    page.columns("Artifacts", &columns, &rows);
}
