//! The designs of a target side by side: the pattern, the deformed membrane, and the numbers of each.

use maud::{Markup, html};

use crate::designs::{Design, Role, StateField, TargetMotion, role_title, separate_electrodes};
use crate::drawing::{Background, direction};
use crate::format::{change, mm, percents, three};
use deaflow_base::no_break_units;
use deaflow_field::OutcomeKind;

/// The folder of the files of a report, relative to its page.
pub const FOLDER: &str = "data/";

/// Length of the arrow of a target direction, in thousandths of the side of the membrane.
pub(crate) const ARROW: f64 = 110.0;

/// Draws what all drawings of membranes share: the grid at rest.
pub fn shared() -> Markup {
    html! {
        svg width="0" height="0" style="position:absolute" aria-hidden="true" {
            (rest())
        }
    }
}

/// Defines the grid at rest.
pub(super) fn rest() -> Markup {
    html! { defs { g #rest .membrane { (Background::paper().grid()) } } }
}

/// Draws the designs of a target.
pub fn cards(designs: &[&Design], scale: f64) -> Markup {
    let several = |role: Role| {
        let alike = |other: &&&Design| other.role.is_found() == role.is_found();
        designs.iter().filter(alike).any(|design| design.member > 0)
    };
    html! { div.cards { @for design in designs { (card(design, several(design.role), scale)) "\n" } } }
}

fn card(design: &Design, several: bool, scale: f64) -> Markup {
    let class = match design.role {
        Role::IntuitiveEqualArea => "intuitive",
        role => role.name(),
    };
    let title = match several && design.role.is_compared() {
        true => format!("{} {}", role_title(design.role), design.member + 1),
        false => role_title(design.role).to_owned(),
    };
    html! {
        article class={ "card " (class) } id=(design.name) {
            h5 {
                (title)
                span {
                    @if design.role.is_found() { (design.units_text()) }
                }
            }
            div.pair {
                (pattern(design))
                @if design.states.is_empty() { (deformed(design, None, scale)) }
                @for state in &design.states {
                    figure { (deformed(design, Some(state), scale)) figcaption { (state.name) } }
                }
            }
            (numbers(design))
            @for (class, remark) in remarks(design) { p class={ "status " (class) } { (remark) } }
            p.files {
                @if let Some(mask) = design.mask_file() { a href={ (FOLDER) (mask) } { "mask (DXF)" } ", " }
                a href={ (FOLDER) (design.pattern_file()) } { "pattern (CSV)" }
            }
        }
    }
}

/// Draws the electrode at rest, with the points and directions of the objective.
pub(super) fn pattern(design: &Design) -> Markup {
    let description = format!(
        "Electrode pattern of {}: area {:.1} %",
        design.name,
        100.0 * design.area
    );
    let content = html! {
        (design.background.electrode_at_rest(&design.pattern))
        (design.background.draw_sides())
        @for target in design.objective.points() {
            @if let TargetMotion::Along(degrees) = target.motion {
                (direction(target.point, design.background.side(), degrees, ARROW))
            }
        }
    };
    drawing(design, &description, &content)
}

/// Draws the deformed electrode over the grid at rest, with the displacements of the points of the objective.
pub(super) fn deformed(design: &Design, state: Option<&StateField>, scale: f64) -> Markup {
    let how = if design.simulated.is_some() {
        "simulated"
    } else {
        "predicted"
    };
    let of_state = state.map_or(String::new(), |state| format!(" in state {}", state.name));
    let description = format!(
        "Deformed membrane of {}{of_state}, {how}, displacements drawn {scale} times as large",
        design.name
    );
    let content = html! {
        @if let Some(membrane) = design.membrane(state) {
            (membrane.electrode(scale)) (membrane.mesh(scale)) (membrane.sides(scale)) (membrane.arrows(scale))
        }
    };
    drawing(design, &description, &content)
}

fn drawing(design: &Design, description: &str, content: &Markup) -> Markup {
    drawing_with(design, description, content, 0.0)
}

/// Draws content on the membrane of a design, and below it, where it has so many thousandths of the longer side.
pub(super) fn drawing_with(design: &Design, description: &str, content: &Markup, below: f64) -> Markup {
    let [left, top, width, height] = design.background.view();
    let height = height + below;
    // The longer side has 240 pixels.
    let pixels = |length: f64| (240.0 * length / width.max(height)).round();
    let view = format!("{left} {top} {width} {height}");
    html! {
        @let (width, height) = (pixels(width), pixels(height));
        svg.membrane viewBox=(view) width=(width) height=(height) role="img" aria-label=(description) {
            title { (description) }
            (design.background.draw_frame())
            @if design.background.has_paper_grid() { use href="#rest" {} } @else { (design.background.grid()) }
            (content)
        }
    }
}

/// Writes the displacement, then what it is compared with.
fn numbers(design: &Design) -> Markup {
    let value = match (simulated(design), design.predicted_mm) {
        (Some(simulated), _) => simulated,
        (None, Some(predicted)) => {
            format!("{} predicted", design.objective.text(predicted))
        }
        (None, None) => "no value".to_owned(),
    };
    html! {
        p.value {
            b { (value) }
            @if let Some(share) = design.to_optimum() { span { (share) } }
        }
        dl { (rows(design)) }
    }
}

/// Whether a comparison with the optimum makes sense: an intuitive design at its own area may have a larger area.
fn shows_optimum(design: &Design) -> bool {
    !matches!(design.role, Role::Optimum | Role::Intuitive)
}

/// Writes rows of a name, a number in mm, and the difference of this design from it.
fn rows(design: &Design) -> Markup {
    let compared = &design.compared;
    let found = design.role.is_compared();
    let optimum = compared.optimum.filter(|_| shows_optimum(design));
    let optimum = optimum.map(|value| {
        (
            "best by gradient search".to_owned(),
            design.number(value),
            String::new(),
        )
    });
    let intuitive = |value: Option<f64>, at: usize| {
        let (value, over) = (value.filter(|_| found)?, compared.over[at]);
        let which = match (at, over) {
            (1, _) => ", equal area".to_owned(),
            (_, Some(over)) => format!(", area {}", percents(over.area)),
            (_, None) => ", own area".to_owned(),
        };
        let violates = match over {
            Some(over) if over.is_violating => ", violates constraints",
            _ => "",
        };
        let gain = over.map_or_else(String::new, |over| over.gain.text(&design.objective));
        Some((format!("intuitive{which}{violates}"), design.number(value), gain))
    };
    let named = |(name, value, more): (&str, String, String)| (name.to_owned(), value, more);
    let error = design.prediction_error().map_or_else(String::new, change);
    let predicted = design
        .predicted_mm
        .map(|value| ("predicted", design.number(value), error));
    let target = design.objective.value_mm.map(|value| {
        let off = design
            .simulated_mm
            .map_or_else(String::new, |own| format!("off by {}", three(own - value)));
        ("target", mm(value), off)
    });
    let distance = design
        .distance_mm
        .map(|off| ("from target", design.number(off), String::new()));
    let words = design.objective.robust.as_deref().unwrap_or_default();
    let robust = design
        .robust_mm
        .map(|value| (words, design.number(value), "predicted".to_owned()));
    let interval = design.interval.as_ref().map(|interval| {
        let name = match interval.out_of_distribution {
            true => "95 %, does not hold",
            false => "95 % interval",
        };
        (name, interval.ends(), String::new())
    });
    // The area has its own row.
    let others = design.other_objectives().iter();
    let others = others.zip(["second objective", "third objective"]);
    let others = others.filter(|(other, _)| !other.is_area());
    let others = others.map(|(other, name)| (name, other.value_text(), "predicted".to_owned()));
    let before = [
        predicted,
        robust,
        interval,
        target,
        distance,
        Some((
            "area",
            percents(design.area),
            format!("{} mm²", three(design.area_mm2())),
        )),
        separate_electrodes(&design.pattern).map(|n| ("electrodes", n.to_string(), "separate".to_owned())),
    ];
    let with_others = [
        optimum,
        intuitive(compared.intuitive_equal_area, 1),
        intuitive(compared.intuitive_own, 0),
    ];
    let rows = before.into_iter().map(|row| row.map(named)).chain(with_others);
    let rows = rows.flatten().chain(others.map(named));
    html! {
        @for (name, value, more) in rows {
            dt { (name) } dd { (no_break_units(&value)) } dd { (no_break_units(&more)) }
        }
    }
}

/// Writes the simulated value with its estimated error; `None` without a simulation.
pub(super) fn simulated(design: &Design) -> Option<String> {
    match (design.simulated_mm, &design.outcome, design.error_mm) {
        (Some(value), _, error) => Some(design.objective.text_measured(value, error)),
        (None, Some(outcome), _) => Some(format!("no stable solution found ({outcome})")),
        (None, None, _) => None,
    }
}

/// Returns the remarks on a design, with their classes.
fn remarks(design: &Design) -> Vec<(&'static str, String)> {
    let mut remarks = simulation_remarks(design);
    remarks.extend(
        design
            .small_islands()
            .filter(|_| design.role.is_found())
            .map(|text| ("note", text)),
    );
    match design.status.as_str() {
        "" => {}
        "met" if design.role.is_found() => remarks.push(("good", "Constraints met".to_owned())),
        "met" => {}
        "no stable field" => remarks.push(("warning", "The evaluator finds no stable field".to_owned())),
        // The other patterns were not required to meet constraints.
        status if design.role.is_found() => remarks.push(("warning", format!("Not met: {status}"))),
        status => remarks.push(("note", format!("Would not meet: {status}"))),
    }
    remarks
}

/// Returns the remarks on the simulation and the prediction of a design, with their classes.
pub(crate) fn simulation_remarks(design: &Design) -> Vec<(&'static str, String)> {
    let mut remarks = Vec::new();
    match (design.simulated_mm, design.outcome) {
        (None, Some(outcome)) => remarks.push(("warning", format!("Simulation ended: {outcome}"))),
        (None, None) => remarks.push(("note", "Not verified: the membrane is drawn as predicted".to_owned())),
        (Some(_), Some(OutcomeKind::Estimated)) => remarks.push(("note", "Estimated, not an equilibrium".to_owned())),
        (Some(_), _) => {}
    }
    if let Some(interval) = design.interval.as_ref().filter(|interval| interval.out_of_distribution) {
        let novelty = format!(
            "Out of the distribution of the training (novelty {:.1}): the interval does not hold",
            interval.novelty
        );
        remarks.push(("warning", novelty));
    }
    remarks
}
