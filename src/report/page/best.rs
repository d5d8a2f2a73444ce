//! The best design at the top of the page: its pattern, the deformed membrane, what it gains, and what limits that.

use maud::{Markup, html};

use super::cards::{FOLDER, deformed, pattern, rest, simulated};
use super::sweep::{VoltageSweep, moving};
use crate::designs::{Design, OtherObjective, Place, Role, point_words, separate_electrodes, without_difference};
use crate::drawing::{DeformedMembrane, Sheet, exaggeration};
use crate::format::percents;
use deaflow_base::no_break_units;
use deaflow_content::best_design as best_of;
use deaflow_field::CHARGE_UNIT;

/// What a report begins with.
pub(crate) enum Best<'d> {
    /// The best design of the first target.
    Design(&'d Design),
    /// The points of a front in their order, at least two. None of them is better than another one.
    Front(Vec<&'d Design>),
}

impl<'d> Best<'d> {
    /// Finds it among the designs of a pipeline; `None` without a design of a search.
    pub fn of(designs: &'d [Design]) -> Option<Self> {
        let design = best_design(designs)?;
        let Some(place) = &design.front else {
            return Some(Self::Design(design));
        };
        let is_point = |other: &&Design| {
            let same = other.front.as_ref().is_some_and(|own| own.stage == place.stage);
            same && other.scene == design.scene
        };
        let points: Vec<&Design> = designs.iter().filter(is_point).collect();
        Some(match points.len() {
            0 | 1 => Self::Design(design),
            _ => Self::Front(points),
        })
    }

    /// The main result.
    pub fn sentence(&self) -> String {
        match self {
            Self::Design(design) => sentence(design),
            Self::Front(points) => front_sentence(points),
        }
    }

    /// What it is for, what it gains, and how sure it is. `all` are the designs of the pipeline.
    pub fn facts(&self, all: &[Design]) -> Vec<String> {
        match self {
            Self::Design(design) => {
                let has_others = all.iter().any(|other| !other.has_same_target(design));
                let mut facts = facts(design, has_others.then_some(all));
                let alike = all.iter().filter(|other| other.has_same_target(design));
                let places: Vec<Place> = alike.filter_map(Design::place).collect();
                facts.extend(without_difference(&places));
                facts
            }
            Self::Front(points) => front_facts(points, all),
        }
    }

    /// Draws the electrode of a design and the deformed membrane side by side, or the electrodes of both ends of a
    /// front; describes them, and says below them what they are.
    pub fn picture(&self) -> (Sheet, String, String) {
        match self {
            Self::Design(design) => {
                let scale = exaggeration(&design.membranes());
                let state = design.states.first();
                let moved = deformed(design, state, scale);
                let description = format!("Electrode of {} and the deformed membrane", design.name);
                let when = state.map_or("with voltage", |state| &state.name);
                let caption = format!("Electrode; {when}, {}", times(scale));
                (beside(design, &[pattern(design), moved]), description, caption)
            }
            Self::Front(points) => {
                let [first, last] = ends(points);
                let description = format!("Electrodes of {} and {}, the ends of a front", first.name, last.name);
                let caption = "Electrodes at both ends of the front".to_owned();
                (beside(first, &[pattern(first), pattern(last)]), description, caption)
            }
        }
    }
}

/// Returns the best design of a pipeline: of its first target. `None` without a design of a search.
#[must_use]
pub fn best_design(designs: &[Design]) -> Option<&Design> {
    let first = first_found(designs)?;
    let found = designs
        .iter()
        .filter(|design| design.role.is_found() && design.has_same_target(first));
    best_of(found.map(|design| (design.rank(), design)))
}

/// Returns the first design of a search, which has the first target.
fn first_found(designs: &[Design]) -> Option<&Design> {
    let first = designs
        .iter()
        .find(|design| design.role.is_found() && design.role != Role::Optimum);
    first.or_else(|| designs.iter().find(|design| design.role.is_found()))
}

/// Draws the best design of a pipeline, as it moves if there is a sweep of it, or the ends of its front; `None` without
/// a design of a search.
pub fn best(designs: &[Design], sweep: Option<&VoltageSweep>) -> Option<Markup> {
    let best = Best::of(designs)?;
    let label = match best {
        Best::Design(_) => "Best design",
        Best::Front(_) => "Front",
    };
    Some(html! {
        section.best aria-label=(label) {
            @match &best {
                Best::Design(design) => { (pair(design, sweep)) }
                Best::Front(points) => {
                    div.pair {
                        @for end in ends(points) {
                            figure { (pattern(end)) figcaption { (end.target) ": " (no_break_units(&point(end))) } }
                        }
                    }
                }
            }
            div {
                p.value { (no_break_units(&best.sentence())) }
                ul { @for line in best.facts(designs) { li { (no_break_units(&line)) } } }
                @if let Best::Design(design) = &best {
                    p.files {
                        @if let Some(mask) = design.mask_file() { a href={ (FOLDER) (mask) } { "mask (DXF)" } ", " }
                        a href={ (FOLDER) (design.pattern_file()) } { "pattern (CSV)" }
                    }
                }
            }
        }
    })
}

/// Says how large displacements are drawn.
fn times(scale: f64) -> String {
    match scale {
        1.0 => "true to scale".to_owned(),
        scale => format!("displacements drawn {scale} times as large"),
    }
}

/// Draws the electrode of a design, and the deformed membrane.
fn pair(design: &Design, sweep: Option<&VoltageSweep>) -> Markup {
    let membranes: Vec<DeformedMembrane> = design.membranes();
    let scale = exaggeration(&membranes);
    let times = times(scale);
    html! {
        div.pair {
            figure { (pattern(design)) figcaption { "Electrode" } }
            @match (design.states.first(), moving(design, sweep)) {
                (None, Some((moving, caption))) => {
                    figure.moving { (moving) figcaption { (caption) } }
                    // In print, and for readers who want no motion.
                    figure.still { (deformed(design, None, scale)) figcaption { "With voltage, " (times) } }
                }
                (Some(state), _) => {
                    figure { (deformed(design, Some(state), scale)) figcaption { (state.name) ", " (times) } }
                }
                (None, None) => { figure { (deformed(design, None, scale)) figcaption { "With voltage, " (times) } } }
            }
            @if let Some((side, caption)) = from_the_side(design) {
                figure { (side) figcaption { (caption) } }
            }
        }
    }
}

/// Draws how far a membrane moves out of its plane, and says how; `None` if it stays there.
fn from_the_side(design: &Design) -> Option<(Markup, String)> {
    let membrane = design.membrane(None)?;
    let scale = membrane.height_scale()?;
    let times = match scale {
        1.0 => "true to scale".to_owned(),
        scale => format!("drawn {scale} times as large"),
    };
    let (membrane, view) = membrane.from_the_side(scale);
    let view = view.map(|length| format!("{length:.0}")).join(" ");
    let drawn = html! {
        svg.membrane viewBox=(view) role="img" aria-label="The membrane from the side" {
            title { "The membrane from the side" }
            (membrane)
        }
    };
    Some((drawn, format!("From the side: heights by the voltage, {times}")))
}

/// Draws two membranes of the sides of a design side by side.
fn beside(design: &Design, [left, right]: &[Markup; 2]) -> Sheet {
    let [_, _, width, height] = design.background.view();
    // As in `drawing`: the longer side has 240 pixels.
    let [width, height] = [width, height].map(|side| (240.0 * side / width.max(height)).round());
    let beside = width + BETWEEN;
    let markup = html! {
        (rest())
        (left)
        g transform={ "translate(" (beside) " 0)" } { (right) }
    };
    Sheet {
        size: [beside + width, height],
        markup,
    }
}

/// Pixels between two drawings of a picture.
const BETWEEN: f64 = 12.0;

/// The first and the last point of a front.
fn ends<'d>(points: &[&'d Design]) -> [&'d Design; 2] {
    [points[0], points[points.len() - 1]]
}

/// Describes a point of a front: its first objective as simulated or else as predicted, and the others.
fn point(design: &Design) -> String {
    let first = match (design.simulated_mm.or(design.predicted_mm), &design.outcome) {
        (_, Some(outcome)) if design.simulated_mm.is_none() => format!("no stable solution ({outcome})"),
        (Some(value), _) => design.objective.text(value),
        (None, _) => "no value".to_owned(),
    };
    let mut others = design.other_objectives().iter();
    let motions = others.clone().filter(|other| !other.is_cost());
    let motions: Vec<String> = motions.map(OtherObjective::value_text).collect();
    let charge = others.find(|other| other.unit == CHARGE_UNIT);
    point_words(&first, &motions, design.area, charge.map(|other| other.value))
}

/// Says how many points a front has, and what its ends are.
fn front_sentence(points: &[&Design]) -> String {
    let [first, last] = ends(points);
    let predicted = match points.iter().all(|point| point.outcome.is_some()) {
        true => "",
        false => ", predicted",
    };
    format!(
        "front of {} points{}{predicted}: {} to {}",
        points.len(),
        at_voltage(first),
        point(first),
        point(last)
    )
}

/// The objectives of a front, and how sure its points are.
fn front_facts(points: &[&Design], all: &[Design]) -> Vec<String> {
    let [first, _] = ends(points);
    let own = first.objective.words();
    let others = first.other_objectives();
    let words: Vec<String> = std::iter::once(own)
        .chain(others.iter().map(|other| other.description.clone()))
        .collect();
    let stage = first.front.as_ref().map_or("", |place| place.stage.as_str());
    let is_of_front = |design: &Design| points.iter().any(|point| point.has_same_target(design));
    let has_others = !all.iter().all(is_of_front);
    let mut facts = vec![match has_others {
        true => format!("{stage}: objectives: {}", words.join("; ")),
        false => format!("objectives: {}", words.join("; ")),
    }];
    facts.push("as the search predicts, no point is better than another one in all objectives".to_owned());
    if points.iter().any(|point| point.outcome.is_none()) {
        facts.push("not verified by finite elements on two meshes".to_owned());
    } else if others.iter().any(|other| !other.is_cost()) {
        facts.push("the objectives after the first are as predicted by the search".to_owned());
    }
    let unmet = points
        .iter()
        .filter(|point| !matches!(point.status.as_str(), "" | "met"));
    match unmet.count() {
        0 => {}
        1 => facts.push("1 point violates constraints".to_owned()),
        n => facts.push(format!("{n} points violate constraints")),
    }
    if has_others {
        facts.push("the designs of the other targets are below".to_owned());
    }
    facts
}

/// Says how far the design moves, and at which voltage.
pub(crate) fn sentence(design: &Design) -> String {
    let value = match (design.simulated_mm, design.predicted_mm, simulated(design)) {
        (Some(value), ..) => design.objective.text(value),
        (None, _, Some(why)) => why,
        (None, Some(value), None) => format!("{} predicted", design.objective.text(value)),
        (None, None, None) => "no value".to_owned(),
    };
    format!("{value}{}", at_voltage(design))
}

/// The voltage of a design, if it has a single one.
fn at_voltage(design: &Design) -> String {
    let volts = design.scene.drive.voltages.in_volts();
    match (&volts[..], design.states.is_empty(), &design.scene.drive.charge) {
        ([one], true, None) => format!(" at {} kV", one / 1000.0),
        _ => String::new(),
    }
}

/// What the design is for, what it gains, and how sure it is. `all` are the designs of all targets, if there are
/// several.
pub(crate) fn facts(design: &Design, all: Option<&[Design]>) -> Vec<String> {
    let mut facts = Vec::new();
    let of = design.objective.words();
    facts.push(match all {
        None => of,
        Some(_) => format!("{}: {of}", design.target),
    });
    let robust = design.objective.robust_text(design.robust_mm);
    facts.extend(robust.map(|text| format!("{text}, as predicted by the search")));
    facts.push(format!("electrode on {} of the membrane", percents(design.area)));
    let separate = separate_electrodes(&design.pattern);
    facts.extend(separate.map(|n| format!("{n} separate electrodes, each needs a lead")));
    let over = design.over_intuitive();
    let none = design.compared.without_intuitive().filter(|_| over.is_empty());
    facts.extend(over);
    facts.extend(none.map(str::to_owned));
    facts.extend(design.to_optimum());
    if design.simulated_mm.is_none() {
        facts.push("not verified by finite elements on two meshes".to_owned());
    } else if let Some(error) = design.error_mm {
        facts.push(format!(
            "± {} by the mesh; the error of the model is not included",
            design.objective.difference_text(error)
        ));
    }
    if !matches!(design.status.as_str(), "" | "met") {
        facts.push(format!("not met: {}", design.status));
    }
    facts.extend(design.small_islands());
    if all.is_some() {
        facts.push("the designs of the other targets are below".to_owned());
    }
    facts
}
