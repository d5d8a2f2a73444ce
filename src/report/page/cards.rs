//! Every design of a target beside the others: its pattern, the deformed membrane, and its numbers.

use maud::{Markup, html};

use crate::designs::{Design, LEAST_MM, Role, StateField, Way, role_title};
use crate::drawing::{Ground, direction};
use crate::format::{change, mm, share, three, uncertainty};
use deaflow_base::unbroken;
use deaflow_pattern::CELLS;

/// Where the files of a report are, seen from its page.
pub const FOLDER: &str = "data/";

/// Length of the arrow of a wanted direction, in thousandths of the membrane's side.
const ARROW: f64 = 110.0;

/// What all drawings of membranes have in common: the grid at rest.
pub fn shared() -> Markup {
    html! {
        svg width="0" height="0" style="position:absolute" aria-hidden="true" { defs { g #rest .membrane { (Ground::paper().grid()) } } }
    }
}

/// The cards of a target's designs.
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
            h5 { (title) span { @if design.role.is_found() && has_units(design) { (design.units) " × " (design.units) " units" } } }
            div.pair {
                (pattern(design))
                @if design.states.is_empty() { (deformed(design, None, scale)) }
                @for state in &design.states { figure { (deformed(design, Some(state), scale)) figcaption { (state.name) } } }
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

/// Whether its units are as many along both sides: searched cell by cell, a rectangle has others.
fn has_units(design: &Design) -> bool {
    design.units < CELLS as u64 || design.ground.has_paper_grid()
}

/// The electrode at rest, with the wanted points and directions.
fn pattern(design: &Design) -> Markup {
    let description = format!(
        "Electrode pattern of {}: {:.1} % active",
        design.name,
        100.0 * design.area
    );
    let aims = design.objective.points().iter();
    let content = html! {
        (design.ground.electrode_at_rest(&design.pattern))
        @for aim in aims {
            @if let Way::Along(degrees) = aim.way { (direction(aim.point, design.ground.side(), degrees, ARROW)) }
        }
    };
    drawing(design, &description, &content)
}

/// The electrode where it has moved to over the grid at rest, with the displacements of the wanted points.
fn deformed(design: &Design, state: Option<&StateField>, scale: f64) -> Markup {
    let how = if design.simulated.is_some() {
        "simulated"
    } else {
        "predicted"
    };
    let of_state = state.map_or(String::new(), |state| format!(" in state {}", state.name));
    let description = format!(
        "Deformed membrane of {}{of_state}, {how}, displacements drawn {scale} times",
        design.name
    );
    let content = html! {
        @if let Some(membrane) = design.membrane(state) {
            (membrane.electrode(scale)) (membrane.mesh(scale)) (membrane.arrows(scale))
        }
    };
    drawing(design, &description, &content)
}

fn drawing(design: &Design, description: &str, content: &Markup) -> Markup {
    let [left, top, width, height] = design.ground.view();
    // The longer side has 240 pixels.
    let pixels = |length: f64| (240.0 * length / width.max(height)).round();
    html! {
        svg.membrane viewBox=(format!("{left} {top} {width} {height}")) width=(pixels(width)) height=(pixels(height)) role="img" aria-label=(description) {
            title { (description) }
            (design.ground.frame())
            @if design.ground.has_paper_grid() { use href="#rest" {} } @else { (design.ground.grid()) }
            (content)
        }
    }
}

/// The value that counts, then what it is compared with.
fn numbers(design: &Design) -> Markup {
    let ratio = design.compared.ratio.filter(|_| shows_optimum(design));
    let value = match (simulated(design), design.predicted_mm) {
        (Some(simulated), _) => simulated,
        (None, Some(predicted)) => format!("{} mm predicted", mm(predicted)),
        (None, None) => "no value".to_owned(),
    };
    html! {
        p.value { b { (value) } @if let Some(ratio) = ratio { span { (share(ratio)) " of the best found by gradient search" } } }
        dl { (rows(design)) }
    }
}

/// An intuitive design at its own area may have more of it than the optimum was allowed.
fn shows_optimum(design: &Design) -> bool {
    !matches!(design.role, Role::Optimum | Role::Intuitive)
}

/// Lines of a name, a number in mm, and what this design has more or less than that.
fn rows(design: &Design) -> Markup {
    let compared = &design.compared;
    let found = design.role.is_compared();
    let over = |other: f64| {
        // Where a displacement is to be met, more of it is no gain.
        let shown = found && !design.objective.is_met && other.abs() > LEAST_MM;
        let own = design.simulated_mm.filter(|_| shown);
        own.map_or_else(String::new, |own| change((own - other) / other.abs()))
    };
    let other = |name: &'static str, value: Option<f64>, shown: bool| {
        let value = value.filter(|_| shown)?;
        Some((name, mm(value), over(value)))
    };
    let error = design.prediction_error().map_or_else(String::new, change);
    let predicted = design.predicted_mm.map(|value| ("predicted", mm(value), error));
    let wanted = design.objective.value_mm.map(|value| {
        let off = design
            .simulated_mm
            .map_or_else(String::new, |own| format!("off by {}", three(own - value)));
        ("wanted", mm(value), off)
    });
    let distance = design
        .distance_mm
        .map(|off| ("from what is wanted", mm(off), String::new()));
    let interval = design.interval.as_ref().map(|interval| {
        let name = if interval.out_of_distribution {
            "95 %, not to be relied on"
        } else {
            "95 % interval"
        };
        (name, interval.ends(), String::new())
    });
    let rows = [
        predicted,
        interval,
        wanted,
        distance,
        Some(("area", share(design.area), String::new())),
        other("best by gradient search", compared.optimum, shows_optimum(design))
            .map(|(name, value, _)| (name, value, String::new())),
        other("intuitive, own area", compared.intuitive_own, found),
        other("intuitive, equal area", compared.intuitive_equal_area, found),
    ];
    html! {
        @for (name, value, more) in rows.into_iter().flatten() {
            dt { (name) } dd { (unbroken(&value)) } dd { (unbroken(&more)) }
        }
    }
}

/// The simulated value with its estimated error; none where nothing was simulated.
fn simulated(design: &Design) -> Option<String> {
    match (design.simulated_mm, &design.outcome, design.error_mm) {
        (Some(value), _, Some(error)) => Some(format!("{} {} mm", mm(value), uncertainty(error))),
        (Some(value), _, None) => Some(format!("{} mm", mm(value))),
        (None, Some(outcome), _) => Some(format!("no stable solution found ({outcome})")),
        (None, None, _) => None,
    }
}

/// Classes and words of what should be known of a design beside its numbers.
fn remarks(design: &Design) -> Vec<(&'static str, String)> {
    let mut remarks = Vec::new();
    match (design.simulated_mm, design.outcome.as_deref()) {
        (None, Some(outcome)) => remarks.push(("warning", format!("Simulation ended: {outcome}"))),
        (None, None) => remarks.push(("note", "Not verified: the membrane is drawn as predicted".to_owned())),
        (Some(_), Some("estimated")) => remarks.push(("note", "Estimated, no equilibrium".to_owned())),
        (Some(_), _) => {}
    }
    if let Some(interval) = design.interval.as_ref().filter(|interval| interval.out_of_distribution) {
        let novelty = format!(
            "Out of the distribution of the training (novelty {:.1}): no interval is promised",
            interval.novelty
        );
        remarks.push(("warning", novelty));
    }
    match design.status.as_str() {
        "" => {}
        "met" if design.role.is_found() => remarks.push(("good", "Constraints met".to_owned())),
        "met" => {}
        "no stable field" => remarks.push(("warning", "The evaluator finds no stable field".to_owned())),
        // The intuitive designs and a person's own were never asked to meet any.
        status if design.role.is_found() => remarks.push(("warning", format!("Not met: {status}"))),
        status => remarks.push(("note", format!("Would not meet: {status}"))),
    }
    remarks
}
