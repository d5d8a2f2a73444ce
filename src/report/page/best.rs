//! The best design at the top of the page: its pattern, the deformed membrane, what it gains, and what limits that.

use maud::{Markup, html};

use super::cards::{FOLDER, deformed, pattern, rest, simulated};
use crate::designs::{Design, Role};
use crate::drawing::{DeformedMembrane, Sheet, exaggeration};
use crate::format::{change, mm, percents, three};
use crate::summary::best as best_of;
use deaflow_base::no_break_units;

/// Returns the best design of a pipeline: of its first target. `None` without a design of a search.
pub(crate) fn best_design(designs: &[Design]) -> Option<&Design> {
    let first = first_found(designs)?;
    let value = |design: &Design| design.simulated_mm.or(design.predicted_mm).unwrap_or(f64::NEG_INFINITY);
    let found = designs
        .iter()
        .filter(|design| design.role.is_found() && design.has_same_target(first));
    // The first of equal ones.
    let found: Vec<(&Design, f64)> = found.rev().map(|design| (design, value(design))).collect();
    best_of(&found, |design| (design.role, design.distance_mm)).map(|(design, _)| design)
}

/// Returns the first design of a search, which has the first target.
fn first_found(designs: &[Design]) -> Option<&Design> {
    let first = designs
        .iter()
        .find(|design| design.role.is_found() && design.role != Role::Optimum);
    first.or_else(|| designs.iter().find(|design| design.role.is_found()))
}

/// Whether there are designs of other targets.
pub(crate) fn has_others(designs: &[Design], best: &Design) -> bool {
    designs.iter().any(|design| !design.has_same_target(best))
}

/// Draws the best design of a pipeline; `None` without a design of a search.
pub fn best(designs: &[Design]) -> Option<Markup> {
    let design = best_design(designs)?;
    let several = has_others(designs, design);
    let membranes: Vec<DeformedMembrane> = design.membranes();
    let scale = exaggeration(&membranes);
    let times = match scale {
        1.0 => "true to scale".to_owned(),
        scale => format!("displacements drawn {scale} times as large"),
    };
    Some(html! {
        section.best aria-label="Best design" {
            div.pair {
                figure { (pattern(design)) figcaption { "Electrode" } }
                @match design.states.first() {
                    Some(state) => {
                        figure { (deformed(design, Some(state), scale)) figcaption { (state.name) ", " (times) } }
                    }
                    None => { figure { (deformed(design, None, scale)) figcaption { "With voltage, " (times) } } }
                }
            }
            div {
                p.value { (no_break_units(&sentence(design))) }
                ul { @for line in facts(design, several.then_some(designs)) { li { (no_break_units(&line)) } } }
                p.files {
                    @if let Some(mask) = design.mask_file() { a href={ (FOLDER) (mask) } { "mask (DXF)" } ", " }
                    a href={ (FOLDER) (design.pattern_file()) } { "pattern (CSV)" }
                }
            }
        }
    })
}

/// Draws the electrode of a design and the deformed membrane side by side, and describes them.
pub(crate) fn picture(design: &Design) -> (Sheet, String) {
    let scale = exaggeration(&design.membranes());
    let [_, _, width, height] = design.background.view();
    // As in `drawing`: the longer side has 240 pixels.
    let [width, height] = [width, height].map(|side| (240.0 * side / width.max(height)).round());
    let beside = width + BETWEEN;
    let markup = html! {
        (rest())
        (pattern(design))
        g transform={ "translate(" (beside) " 0)" } { (deformed(design, design.states.first(), scale)) }
    };
    let description = format!("Electrode of {} and the deformed membrane", design.name);
    let size = [beside + width, height];
    (Sheet { size, markup }, description)
}

/// Pixels between two drawings of a picture.
const BETWEEN: f64 = 12.0;

/// Says how far the design moves, and at which voltage.
pub(crate) fn sentence(design: &Design) -> String {
    let unit = design.objective.unit();
    let value = match (design.simulated_mm, design.predicted_mm, simulated(design)) {
        (Some(value), ..) => format!("{} {unit}", mm(value)),
        (None, _, Some(why)) => why,
        (None, Some(value), None) => format!("{} {unit} predicted", mm(value)),
        (None, None, None) => "no value".to_owned(),
    };
    let volts = design.scene.drive.voltages.in_volts();
    let at = match (&volts[..], design.states.is_empty(), &design.scene.drive.charge) {
        ([one], true, None) => format!(" at {} kV", one / 1000.0),
        _ => String::new(),
    };
    format!("{value}{at}")
}

/// What the design is for, what it gains, and how sure it is. `all` are the designs of all targets, if there are
/// several.
pub(crate) fn facts(design: &Design, all: Option<&[Design]>) -> Vec<String> {
    let mut facts = Vec::new();
    let quantity = design.objective.quantity();
    let described = design.objective.description();
    let of = match described.strip_prefix("the mean of ") {
        Some(several) => format!("mean {quantity} of {several}"),
        None => format!("{quantity} of {described}"),
    };
    facts.push(match all {
        None => of,
        Some(_) => format!("{}: {of}", design.target),
    });
    facts.push(format!("electrode on {} of the membrane", percents(design.area)));
    let gain = |other: Option<f64>, text: &str| {
        let gain = design.gain_over(other?)?;
        Some(format!("{} over the intuitive design {text}", change(gain)))
    };
    let compared = &design.compared;
    facts.extend(gain(compared.intuitive_equal_area, "of the same area"));
    facts.extend(gain(compared.intuitive_own, "at its own area"));
    if let (Some(ratio), Some(optimum)) = (compared.ratio, compared.optimum_is)
        && design.role != Role::Optimum
    {
        facts.push(format!("{} of {optimum}", percents(ratio)));
    }
    if design.simulated_mm.is_none() {
        facts.push("not verified by finite elements on two meshes".to_owned());
    } else if let Some(error) = design.error_mm {
        facts.push(format!(
            "± {} {} by the mesh; the error of the model is not included",
            three(error),
            design.objective.unit()
        ));
    }
    if !matches!(design.status.as_str(), "" | "met") {
        facts.push(format!("not met: {}", design.status));
    }
    if all.is_some() {
        facts.push("the designs of the other targets are below".to_owned());
    }
    facts
}
