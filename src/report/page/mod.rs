//! The report of a pipeline as one page: what was found at the top, then everything that it stands on.

mod cards;
mod costs;
mod dag;
mod designs;
mod layout;
mod scene;
mod warned;

use super::artifacts::RunArtifacts;
use super::designs::{Design, Extreme, Found};
use super::error::ReportError;
use super::format::{bytes, change, counted, seconds, share};
use super::history::{History, StageFacts};
use super::html::Page;
use super::kinds::by_section;
use super::summary::TRUSTED;
use warned::Warned;

pub use layout::{BOX as STAGE_HEIGHT, Layout, layout};

/// The page of a pipeline.
///
/// # Errors
/// When an artifact cannot be read or does not hold what its kind promises.
pub fn report_page(run: &RunArtifacts<'_>, history: &History, designs: &[Design]) -> Result<String, ReportError> {
    let mut page = Page::new(&history.pipeline);
    let warned = Warned::read(run, history)?;
    head(&mut page, history, designs, &warned);
    dag::section(&mut page, history);
    designs::section(&mut page, designs, &mask_command(history, designs));
    designs::agreement(&mut page, designs);
    for presenter in by_section() {
        presenter.section(&mut page, run)?;
    }
    scene::section(&mut page, run, history, &warned)?;
    costs::section(&mut page, history);
    costs::provenance(&mut page, history);
    Ok(page.finish())
}

/// The command that makes a mask of the best of the designs like the first that was found.
fn mask_command(history: &History, designs: &[Design]) -> String {
    let built = history.stages.iter().filter(|stage| stage.digest.is_some());
    let of = |kind: &str| built.clone().rfind(|stage| stage.kind == kind);
    let stage = of("verify")
        .or_else(|| of("design"))
        .map_or("STAGE", |stage| &stage.name);
    let first = designs.iter().find(|design| design.role.is_found());
    let options = first.map_or_else(String::new, |design| {
        let case = match design.case.as_str() {
            "" => String::new(),
            case => format!(" --case {}", quoted(case)),
        };
        format!(
            "{case} --design {} --role {}",
            quoted(&design.target),
            design.role.name()
        )
    });
    let source = quoted(&format!("{}:{stage}", history.path));
    format!("deaflow export design {source}{options} -o mask.dxf")
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=@,".contains(c);
    match !word.is_empty() && word.chars().all(is_plain) {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}

/// The first words under the title of a page, before the name of its pipeline and a colon.
pub const ABOUT: &str = "Report of the pipeline ";

/// Title, what is missing, what the model leaves out, and the numbers that matter.
fn head(page: &mut Page, history: &History, designs: &[Design], warned: &Warned) {
    let took: f64 = history
        .stages
        .iter()
        .filter_map(|s| s.origin.as_ref())
        .map(costs::part)
        .sum();
    let size: u64 = history.stages.iter().map(|stage| stage.bytes).sum();
    page.lead(&format!(
        "{ABOUT}{}: {} from {}, built in {}, {} in the store.",
        history.pipeline,
        counted(history.stages.len(), "stage", "stages"),
        history.path,
        seconds(took),
        bytes(size)
    ));
    let named = |stage: &&StageFacts| match stage.why.as_deref().filter(|why| why.starts_with("removed")) {
        Some(why) => format!("{} ({why})", stage.name),
        None => stage.name.clone(),
    };
    let missing: Vec<String> = history.missing().iter().map(named).collect();
    if !missing.is_empty() {
        page.notice(&[
            format!(
                "This report is not complete: {} of {} stages are not built.",
                missing.len(),
                history.stages.len()
            ),
            format!(
                "Missing: {}. Build them: deaflow run {}",
                missing.join(", "),
                history.path
            ),
        ]);
    }
    page.warnings("Model warnings", &warned.of_model);
    page.warnings("Warnings", &warned.of_stages);
    let found = Found::of(designs);
    let wrong = found.prediction_error.as_ref().filter(|error| error.value > TRUSTED);
    if let Some(error) = wrong {
        page.notice(&[format!(
            "Predicted and simulated differ by up to {} ({}): do not trust the predictions there.",
            share(error.value),
            error.design
        )]);
    }
    page.tiles(&of_designs(&found));
}

fn of_designs(found: &Found) -> Vec<(String, String)> {
    if found.designs == 0 {
        return Vec::new();
    }
    let several = found.targets > 1;
    let patterns = match found.simulated == found.designs {
        true => format!("all {} patterns", found.designs),
        false => format!("{} of {} patterns", found.simulated, found.designs),
    };
    let mut tiles = vec![(
        found.targets.to_string(),
        format!(
            "{}; {patterns} simulated by finite elements",
            if several { "targets" } else { "target" }
        ),
    )];
    let ratio = |extreme: &Extreme, who: &str| {
        let least = match several {
            true => format!("; the least of all, {}", extreme.design),
            false => String::new(),
        };
        let what = format!("of the best pattern found by gradient search: {who}{least}");
        (share(extreme.value), what)
    };
    tiles.extend(found.refined_to_optimum.iter().map(|e| ratio(e, "refined design")));
    tiles.extend(found.ga_to_optimum.iter().map(|e| ratio(e, "genetic algorithm alone")));
    tiles.extend(found.prediction_error.iter().map(|e| {
        let what = format!("largest difference between predicted and simulated ({})", e.design);
        (share(e.value), what)
    }));
    let gained = |gain: &f64, area: &str| {
        let middle = if several { ", median of the targets" } else { "" };
        let what = format!("best design over the intuitive one {area}{middle}");
        (change(*gain), what)
    };
    tiles.extend(found.gain_own_area.iter().map(|gain| gained(gain, "at its own area")));
    tiles.extend(found.gain_equal_area.iter().map(|gain| gained(gain, "at equal area")));
    if found.not_met > 0 {
        let what = match found.not_met {
            1 => "design does not meet its constraints",
            _ => "designs do not meet their constraints",
        };
        tiles.push((found.not_met.to_string(), what.to_owned()));
    }
    tiles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_where_a_shell_would_split_them() {
        assert_eq!(quoted("pipelines/a.yaml:verified"), "pipelines/a.yaml:verified");
        assert_eq!(["", "a b", "it's"].map(quoted), ["''", "'a b'", "'it'\\''s'"]);
    }
}
