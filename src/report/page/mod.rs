//! The report of a pipeline as one page: the results at the top, then their basis.

pub(super) mod best;
pub(super) mod cards;
mod costs;
mod dag;
mod designs;
mod layout;
pub(super) mod scene;
pub(super) mod sweep;
mod warnings;

use super::artifacts::RunArtifacts;
use super::designs::{Design, DesignStatistics, Extreme};
use super::error::ReportError;
use super::format::{bytes, change, counted, percents, seconds, set_options, shell_word};
use super::history::{PipelineHistory, StageRecord};
use super::html::Page;
use super::kinds::by_section;
use super::summary::TRUSTED;
use sweep::VoltageSweep;
use warnings::ReportWarnings;

pub use layout::{BOX as STAGE_HEIGHT, Layout, layout};

/// Writes the page of a pipeline, with the sweep of its best design if there is one.
///
/// # Errors
/// If an artifact cannot be read or does not have the content of its kind.
pub fn report_page(
    run: &RunArtifacts<'_>,
    history: &PipelineHistory,
    designs: &[Design],
    sweep: Option<&VoltageSweep>,
) -> Result<String, ReportError> {
    let mut page = Page::new(&history.pipeline);
    let warned = ReportWarnings::read(run, history)?;
    head(&mut page, history, (designs, sweep), &warned);
    designs::section(&mut page, designs, &mask_command(history, designs));
    designs::agreement(&mut page, designs);
    dag::section(&mut page, history);
    for presenter in by_section() {
        presenter.section(&mut page, run)?;
    }
    scene::section(&mut page, run, history, &warned)?;
    costs::section(&mut page, history);
    costs::provenance(&mut page, history);
    Ok(page.finish())
}

/// Returns the command that makes a mask of the best design of the first target.
fn mask_command(history: &PipelineHistory, designs: &[Design]) -> String {
    let built = history.stages.iter().filter(|stage| stage.digest.is_some());
    let of = |kind: &str| built.clone().rfind(|stage| stage.kind == kind);
    let stage = of("verify")
        .or_else(|| of("design"))
        .map_or("STAGE", |stage| &stage.name);
    let first = designs.iter().find(|design| design.role.is_found());
    let options = first.map_or_else(String::new, design_options);
    format!(
        "deaflow export design {}{options} -o mask.dxf",
        source_of(history, stage)
    )
}

/// Returns a stage of a pipeline as commands name it, with the overrides of the pipeline.
pub(super) fn source_of(history: &PipelineHistory, stage: &str) -> String {
    let source = shell_word(&format!("{}:{stage}", history.path));
    source + &set_options(&history.overrides)
}

/// Returns the options of commands that select the target and the role of a design, each after a space.
pub(super) fn design_options(design: &Design) -> String {
    let case = match design.case.as_str() {
        "" => String::new(),
        case => format!(" --case {}", shell_word(case)),
    };
    format!(
        "{case} --design {} --role {}",
        shell_word(&design.target),
        design.role.name()
    )
}

/// The beginning of the introduction of a page, before the name of the pipeline and a colon.
pub const ABOUT: &str = "Report of the pipeline ";

/// Adds title, missing stages, warnings and the main numbers.
fn head(
    page: &mut Page,
    history: &PipelineHistory,
    (designs, sweep): (&[Design], Option<&VoltageSweep>),
    warned: &ReportWarnings,
) {
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
    let named = |stage: &&StageRecord| match stage.why.as_deref().filter(|why| why.starts_with("removed")) {
        Some(why) => format!("{} ({why})", stage.name),
        None => stage.name.clone(),
    };
    let missing: Vec<String> = history.missing().iter().map(named).collect();
    if !missing.is_empty() {
        page.notice(&[
            format!(
                "This report is incomplete: {} of {} stages are not built.",
                missing.len(),
                history.stages.len()
            ),
            format!(
                "Missing: {}. To build them, run deaflow run {}{}",
                missing.join(", "),
                shell_word(&history.path),
                set_options(&history.overrides)
            ),
        ]);
    }
    if let Some(best) = best::best(designs, sweep) {
        page.top(best);
    }
    page.warnings("Model warnings", &warned.of_model);
    page.warnings("Warnings", &warned.of_stages);
    let found = DesignStatistics::of(designs);
    let wrong = found.prediction_error.as_ref().filter(|error| error.value > TRUSTED);
    if let Some(error) = wrong {
        page.notice(&[format!(
            "Predicted and simulated displacements differ by up to {} ({}): the predictions are not accurate there.",
            percents(error.value),
            error.design
        )]);
    }
    page.tiles(&of_designs(&found));
}

fn of_designs(found: &DesignStatistics) -> Vec<(String, String)> {
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
    // What a single target gains is beside its best design.
    let ratio = |extreme: &Extreme, role: &str| {
        let least = match (several, extreme.opposite) {
            (true, 0) => format!("; the lowest of all is {}", extreme.design),
            (true, n) => format!(
                "; the lowest of all is {}, without {} in the opposite direction",
                extreme.design,
                counted(n, "design", "designs")
            ),
            (false, _) => String::new(),
        };
        let what = format!(
            "of {}: {role}{least}",
            extreme.of.unwrap_or("the best pattern found by gradient search")
        );
        (percents(extreme.value), what)
    };
    tiles.extend(
        found
            .refined_to_optimum
            .iter()
            .filter(|_| several)
            .map(|e| ratio(e, "refined design")),
    );
    tiles.extend(
        found
            .ga_to_optimum
            .iter()
            .map(|e| ratio(e, "genetic algorithm without refinement")),
    );
    tiles.extend(found.prediction_error.iter().map(|e| {
        let what = format!("largest difference between predicted and simulated ({})", e.design);
        (percents(e.value), what)
    }));
    let gained = |gain: &f64, targets: usize, area: &str| {
        let of = match targets == found.targets {
            true => "the targets".to_owned(),
            false => format!("{targets} of {} targets", found.targets),
        };
        let what = format!("gain of the best design over the intuitive one {area}, median of {of}");
        (change(*gain), what)
    };
    tiles.extend(
        found
            .gain_own_area
            .iter()
            .filter(|_| several)
            .map(|gain| gained(gain, found.gain_own_area_targets, "at its own area")),
    );
    tiles.extend(
        found
            .gain_equal_area
            .iter()
            .filter(|_| several)
            .map(|gain| gained(gain, found.gain_equal_area_targets, "at equal area")),
    );
    if found.not_met > 0 {
        let what = match found.not_met {
            1 => "design violates its constraints",
            _ => "designs violate their constraints",
        };
        tiles.push((found.not_met.to_string(), what.to_owned()));
    }
    tiles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_and_lowest_shares_say_what_they_leave_out() {
        let found = DesignStatistics {
            targets: 6,
            designs: 12,
            simulated: 12,
            gain_own_area: Some(0.25),
            gain_own_area_targets: 3,
            gain_equal_area: Some(0.1),
            gain_equal_area_targets: 6,
            refined_to_optimum: Some(Extreme {
                value: 0.9,
                design: "a".to_owned(),
                of: None,
                opposite: 2,
            }),
            ..DesignStatistics::default()
        };
        let tiles = of_designs(&found);
        let tile = |value: &str| {
            tiles
                .iter()
                .find(|(own, _)| own == value)
                .map(|(_, text)| text.as_str())
        };
        let gain = "gain of the best design over the intuitive one";
        let own = format!("{gain} at its own area, median of 3 of 6 targets");
        assert_eq!(tile("+25.0 %"), Some(own.as_str()), "{tiles:?}");
        let equal = format!("{gain} at equal area, median of the targets");
        assert_eq!(tile("+10.0 %"), Some(equal.as_str()), "{tiles:?}");
        assert!(
            tile("90.0 %")
                .unwrap()
                .ends_with("the lowest of all is a, without 2 designs in the opposite direction"),
            "{tiles:?}"
        );
    }
}
