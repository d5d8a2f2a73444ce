//! Every design of a target beside the others: its pattern, the deformed membrane, and its numbers.

use super::membrane::{deformed, pattern};
use super::words::{gain, mm, percent};
use crate::report::designs::{Design, Role, role_title};
use crate::report::html::escaped;

/// The cards of a target's designs.
pub fn cards(designs: &[&Design], scale: f64) -> String {
    let several = designs.iter().any(|design| design.member > 0);
    let cards: String = designs.iter().map(|design| card(design, several, scale)).collect();
    format!("<div class=\"cards\">\n{cards}</div>\n")
}

fn card(design: &Design, several: bool, scale: f64) -> String {
    let class = match design.role {
        Role::IntuitiveEqualArea => "intuitive",
        role => role.name(),
    };
    let title = match several && design.role.is_found() {
        true => format!("{} {}", role_title(design.role), design.member + 1),
        false => role_title(design.role).to_owned(),
    };
    let units = match design.role.is_found() {
        true => format!("{0} × {0} units", design.units),
        false => String::new(),
    };
    format!(
        "<article class=\"card {class}\" id=\"{}\"><h5>{title}<span>{units}</span></h5><div class=\"pair\">{}{}</div>\n{}{}</article>\n",
        escaped(&design.name),
        pattern(design),
        deformed(design, scale),
        numbers(design),
        remarks(design)
    )
}

/// The value that counts, then what it is compared with.
fn numbers(design: &Design) -> String {
    let ratio = design
        .compared
        .ratio
        .filter(|_| shows_optimum(design) && !design.wanted.is_met());
    let ratio = ratio.map_or_else(String::new, |ratio| {
        format!("<span>{} of the optimum</span>", percent(ratio, 2))
    });
    let value = match (simulated(design), design.predicted_mm) {
        (Some(simulated), _) => simulated,
        (None, Some(predicted)) => format!("{} mm predicted", mm(predicted)),
        (None, None) => "no value".to_owned(),
    };
    format!(
        "<p class=\"value\"><b>{}</b>{ratio}</p><dl>{}</dl>",
        escaped(&value),
        rows(design)
    )
}

/// An intuitive design at its own area may have more of it than the optimum was allowed.
fn shows_optimum(design: &Design) -> bool {
    !matches!(design.role, Role::Optimum | Role::Intuitive)
}

/// Lines of a name, a number in mm, and what this design has more or less than that.
fn rows(design: &Design) -> String {
    let compared = &design.compared;
    let found = design.role.is_found();
    let over = |other: f64| {
        let own = design.simulated_mm.filter(|_| found && other.abs() > 1e-9);
        own.map_or_else(String::new, |own| gain((own - other) / other.abs(), 1))
    };
    let other = |name: &'static str, value: Option<f64>, shown: bool| {
        let value = value.filter(|_| shown)?;
        Some((name, mm(value), over(value)))
    };
    let error = design
        .prediction_error()
        .map_or_else(String::new, |error| gain(error, 2));
    let predicted = design.predicted_mm.map(|value| ("predicted", mm(value), error));
    let wanted = design.wanted.value_mm.map(|value| {
        let off = design
            .simulated_mm
            .map_or_else(String::new, |own| format!("{:+.4}", own - value).replace('-', "−"));
        ("wanted", mm(value), off)
    });
    let rows = [
        predicted,
        wanted,
        Some(("area", percent(design.area, 2), String::new())),
        other("optimum", compared.optimum, shows_optimum(design)).map(|(name, value, _)| (name, value, String::new())),
        other("intuitive, own area", compared.intuitive_own, found),
        other("intuitive, equal area", compared.intuitive_equal_area, found),
    ];
    let row = |(name, value, more): (&str, String, String)| {
        format!("<dt>{name}</dt><dd>{}</dd><dd>{}</dd>", escaped(&value), escaped(&more))
    };
    rows.into_iter().flatten().map(row).collect()
}

/// The simulated value with its estimated error; none where nothing was simulated.
fn simulated(design: &Design) -> Option<String> {
    match (design.simulated_mm, &design.outcome, design.error_mm) {
        (Some(value), _, Some(error)) => Some(format!("{} ± {error:.4} mm", mm(value))),
        (Some(value), _, None) => Some(format!("{} mm", mm(value))),
        (None, Some(_), _) => Some("no stable solution".to_owned()),
        (None, None, _) => None,
    }
}

fn remarks(design: &Design) -> String {
    let mut out = String::new();
    let mut remark = |class: &str, text: &str| {
        out += &format!("<p class=\"status {class}\">{}</p>", escaped(text));
    };
    match (design.simulated_mm, design.outcome.as_deref()) {
        (None, Some(outcome)) => remark("warning", &format!("Simulation ended: {outcome}")),
        (None, None) => remark("note", "Not verified: the membrane is drawn as predicted"),
        (Some(_), Some("estimated")) => remark("note", "Estimated, no equilibrium"),
        (Some(_), _) => {}
    }
    match design.status.as_str() {
        "" => {}
        "met" if design.role.is_found() => remark("good", "Constraints met"),
        "met" => {}
        "no stable field" => remark("warning", "The evaluator finds no stable field"),
        // The intuitive designs were never asked to meet any.
        status if design.role.is_found() => remark("warning", &format!("Not met: {status}")),
        status => remark("note", &format!("Would not meet: {status}")),
    }
    out
}
