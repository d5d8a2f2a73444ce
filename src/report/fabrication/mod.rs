//! The fabrication sheet of a design: one page of A4 for the person who makes and measures it.

mod limits;
mod mask;
mod measurement;

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::artifacts::{ArtifactReader, RunArtifacts};
use super::designs::Design;
use super::drawing::DRAWING_STYLE;
use super::error::ReportError;
use super::format::{cut, number};
use super::history::PipelineHistory;
use super::html::prose;
use super::kinds::yields;
use super::page::best::{facts, sentence};
use super::page::cards::simulation_remarks;
use super::page::scene::scene_rows;
use super::summary::design_title;
use deaflow_base::{Canonical, no_break_units, printable, software};
use deaflow_content::Verification;
pub use limits::VoltageLimits;
use mask::{PrintedMask, Room};
use measurement::HandTable;

/// The style sheet of the page.
const STYLE: &str = include_str!("../html/fabrication.css");

/// The height of a page without its margins, of what always stands on it, and of a line of text, mm.
const PAGE: f64 = 281.0;
const TITLES: f64 = 44.0;
const TITLE: f64 = 6.5;
const LINE: f64 = 3.95;

/// The beginning of the line of the geometry.
const GEOMETRY: &str = "geometry: ";

/// Characters in a row of the title.
const TITLE_WIDTH: usize = 50;

/// What a fabrication sheet is made of.
pub struct FabricationSheet<'a> {
    /// The artifacts of the pipeline.
    pub run: &'a RunArtifacts<'a>,
    /// The pipeline.
    pub history: &'a PipelineHistory,
    /// The design.
    pub design: &'a Design,
    /// The effects that the simulation of the design neglects, a line each.
    pub neglected: &'a [String],
    /// The voltages up to which it can be driven; `None` if they were not computed, as of devices with several states.
    pub voltages: Option<VoltageLimits>,
    /// The file with the scene of the design; `None` if there is no such file.
    pub scene_file: Option<&'a str>,
}

impl FabricationSheet<'_> {
    /// Writes the page. The same artifacts give the same bytes.
    ///
    /// # Errors
    /// If an artifact cannot be read or does not have the content of its kind.
    pub fn html(&self) -> Result<String, ReportError> {
        let design = self.design;
        let does = Lines::fitted(self.purpose(yields::devices_of(self.run, design)?), Lines::DOES);
        let limits = Lines::fitted(self.limits()?, Lines::LIMITS);
        let warnings = Lines::fitted(self.warnings(), Lines::ACROSS);
        let hand = HandTable::of(self.history, design, self.scene_file);
        // The mask has the rest of the page.
        let titles = TITLES + TITLE * (rows(&self.title(), TITLE_WIDTH, usize::MAX) - 1) as f64;
        let rest = PAGE - titles - warnings.height_mm() - hand.height_mm();
        let room = Room::of(rest, [does.height_mm(), limits.height_mm()]);
        let mask = PrintedMask::of(design, &self.title(), room);
        let parts = html! {
            section.does {
                h2 { "What it should do" }
                p.value { (no_break_units(&sentence(design))) }
                (does.list())
            }
            section.limits { h2 { "Limits" } (limits.list()) }
        };
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    link rel="icon" href="data:,";
                    title { "Fabrication sheet: " (self.title()) }
                    style { (PreEscaped(STYLE)) (PreEscaped(DRAWING_STYLE)) }
                }
                body {
                    main {
                        (self.head())
                        div.upper.beside[mask.leaves_room] {
                            (mask.figure)
                            div.parts { (parts) }
                        }
                        section.warnings { h2 { "Warnings" } (warnings.list()) }
                        section.measured { h2 { "Measured" } (hand.table()) }
                        section.files { (hand.files()) }
                    }
                }
            }
        };
        Ok(printable(&page.into_string()).into_owned())
    }

    /// Returns the title of the design.
    #[must_use]
    pub fn title(&self) -> String {
        let design = self.design;
        design_title(&design.case, &design.target, design.member, design.role)
    }

    fn head(&self) -> Markup {
        let (design, history) = (self.design, self.history);
        html! {
            header {
                h1 { (self.title()) }
                p {
                    "Fabrication sheet · pipeline " b { (history.pipeline) } " · stage " b { (design.made.stage) }
                    " · " (design.units_text()) " · " (software())
                }
                p.mono { "artifact " (design.made.digest) }
            }
        }
    }

    /// Lists what the design is for, what it gains and how sure it is.
    fn purpose(&self, devices: Vec<String>) -> Vec<String> {
        let design = self.design;
        let predicted = design.predicted_mm.map(|value| {
            format!(
                "predicted {} by the evaluator of the search",
                design.objective.text(value)
            )
        });
        facts(design, None)
            .into_iter()
            .chain(predicted)
            .chain(
                design
                    .distance_mm
                    .map(|off| format!("{} from the target", design.objective.text(off))),
            )
            .chain(voltages(design))
            .chain(devices)
            .collect()
    }

    /// Lists constraints, thickness, prestretch, scene and effects.
    fn limits(&self) -> Result<Vec<String>, ReportError> {
        let (design, scene) = (self.design, &self.design.scene);
        let inner = design
            .constraints
            .trim()
            .trim_start_matches('{')
            .trim_end_matches('}')
            .trim();
        let area = format!("area {}", design.area_target);
        let constraints = [area.as_str(), inner].into_iter().filter(|text| !text.is_empty());
        let constraints = constraints.collect::<Vec<_>>().join(", ");
        let status = match design.status.as_str() {
            "" => "not checked".to_owned(),
            "met" => "met".to_owned(),
            status => format!("not met: {status}"),
        };
        let [along, across] = scene.prestretch();
        let prestretch = match along == across {
            true => number(along),
            false => format!("{} along x, {} along y", number(along), number(across)),
        };
        let mut lines = vec![
            format!("constraints: {constraints}: {status}"),
            format!(
                "membrane {} mm thick, {} mm on the frame; prestretch {prestretch}",
                number(scene.thickness_mm()),
                number(scene.prestretched_thickness_mm())
            ),
        ];
        lines.extend(match &self.voltages {
            Some(limits) => limits.lines(),
            None => vec!["largest voltage: not computed for this device".to_owned()],
        });
        let stage = self.history.stages.iter().find(|stage| stage.name == design.made.stage);
        let written = stage.map_or(&[][..], |stage| &stage.scene);
        let rows = scene_rows(scene, &self.effects()?, written).into_iter();
        lines.extend(rows.map(|row| row.join(": ")));
        Ok(lines)
    }

    /// Returns the simulated effects, or those of the scene if the design was not simulated.
    fn effects(&self) -> Result<String, ReportError> {
        let made = &self.design.made;
        if made.kind == "verify" {
            let artifact = self.run.store.artifact(&made.digest)?;
            let source = ArtifactReader {
                stage: made,
                artifact: &artifact,
                run: self.run.stages,
            };
            let effects = source.of(source.of(Verification::open(&artifact))?.effects().text())?;
            return effects.ok_or_else(|| source.wrong("it does not list the simulated effects"));
        }
        Ok(match self.design.scene.canonical() {
            Canonical::Map(parts) => parts.get("effects").map(ToString::to_string).unwrap_or_default(),
            _ => String::new(),
        })
    }

    /// Lists neglected effects, and remarks on the simulation.
    fn warnings(&self) -> Vec<String> {
        let design = self.design;
        let is_simulated = design.outcome.is_some();
        let unverified = (!is_simulated).then(|| {
            "Not verified: no simulation on two meshes has checked the prediction, and neglected effects were not \
             examined."
                .to_owned()
        });
        let remarks = simulation_remarks(design).into_iter().map(|(_, text)| text);
        let remarks = remarks.filter(|text| is_simulated || !text.starts_with("Not verified"));
        let neglected = self.neglected.iter().cloned();
        let mut all: Vec<String> = unverified.into_iter().chain(neglected).chain(remarks).collect();
        if all.is_empty() {
            all.push("No significant effect was neglected.".to_owned());
        }
        all
    }
}

/// Lists the voltages where there are several groups or states, and a prescribed charge.
fn voltages(design: &Design) -> Vec<String> {
    let drive = &design.scene.drive;
    let listed = |volts: &[f64]| match volts {
        [one] => format!("{} kV", number(one / 1000.0)),
        several => (1..)
            .zip(several)
            .map(|(group, volts)| format!("group {group} {} kV", number(volts / 1000.0)))
            .collect::<Vec<_>>()
            .join(", "),
    };
    if drive.charge.is_some() {
        return vec!["driven by a charge: see the drive".to_owned()];
    }
    let volts = drive.voltages.in_volts();
    match design.scene.states.iter().len() {
        0 if volts.len() == 1 => Vec::new(),
        0 => vec![listed(&volts)],
        _ => {
            let states = design.scene.states.iter();
            states
                .map(|(name, voltages)| format!("state {name}: {}", listed(&voltages.in_volts())))
                .collect()
        }
    }
}

/// Lines of a list, shortened so that they have a limited height.
struct Lines {
    lines: Vec<String>,
    more: usize,
    width: usize,
}

impl Lines {
    /// The characters in a row, and the most rows, of the lists in half of the page and across it.
    const DOES: (usize, usize) = (58, 20);
    const LIMITS: (usize, usize) = (58, 15);
    const ACROSS: (usize, usize) = (118, 7);
    /// The lengths to which lines are shortened.
    const LENGTHS: [usize; 5] = [400, 230, 170, 110, 56];
    /// The length to which that of the geometry is shortened.
    const WHOLE: usize = 600;

    fn fitted(lines: Vec<String>, (width, most): (usize, usize)) -> Self {
        // Who makes the frame needs its whole size.
        let longest = |line: &str, length: usize| match line.starts_with(GEOMETRY) {
            true => Self::WHOLE,
            false => length,
        };
        let rows = |length: usize| {
            let each = lines.iter().map(|line| rows(line, width, longest(line, length)));
            each.sum::<usize>()
        };
        let fitting = Self::LENGTHS.into_iter().find(|length| rows(*length) <= most);
        let [.., least] = Self::LENGTHS;
        let shortened = |line: &String| cut(line, longest(line, fitting.unwrap_or(least)));
        let mut short: Vec<String> = lines.iter().map(shortened).collect();
        let more = match fitting {
            Some(_) => 0,
            None => (lines.len() + 1).saturating_sub(most),
        };
        short.truncate(lines.len() - more);
        Self {
            lines: short,
            more,
            width,
        }
    }

    fn height_mm(&self) -> f64 {
        let rows: usize = self.lines.iter().map(|line| rows(line, self.width, usize::MAX)).sum();
        LINE * (rows + usize::from(self.more > 0)) as f64
    }

    fn list(&self) -> Markup {
        html! {
            ul {
                @for line in &self.lines { li { (prose(line)) } }
                @if self.more > 0 { li { "and " (self.more) " more in the report" } }
            }
        }
    }
}

/// Returns the rows of a text of which at most `length` characters are written.
fn rows(text: &str, width: usize, length: usize) -> usize {
    text.chars().count().min(length).div_ceil(width).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lists_are_shortened_to_their_room() {
        let of = |count: usize, length: usize| Lines::fitted(vec!["x".repeat(length); count], Lines::LIMITS);
        let kept = of(15, 50);
        assert_eq!((kept.lines.len(), kept.more, kept.lines[0].len()), (15, 0, 50));
        let cut = of(3, 500);
        assert_eq!((cut.lines.len(), cut.more, cut.lines[0].chars().count()), (3, 0, 230));
        let many = of(40, 100);
        assert_eq!((many.lines.len(), many.more), (14, 26));
        let frame = format!("geometry: {}", "x".repeat(300));
        let texts: Vec<String> = std::iter::once(frame.clone()).chain(vec!["y".repeat(200); 8]).collect();
        let whole = Lines::fitted(texts, Lines::LIMITS);
        assert_eq!((&whole.lines[0], whole.lines[1].chars().count()), (&frame, 56));
        for lines in [kept, cut, many] {
            assert!(lines.height_mm() <= 15.0 * LINE);
        }
    }
}
