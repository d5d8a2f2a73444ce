//! Every design of a target beside the others: its pattern, the deformed membrane, and its numbers.

use super::membrane::{deformed, pattern};
use super::words::{gain, mm, percent};
use crate::report::designs::{Design, Role};
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
        true => format!("{} {}", design.role.title(), design.member + 1),
        false => design.role.title().to_owned(),
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

fn numbers(design: &Design) -> String {
    let compared = &design.compared;
    let beside = |other: Option<f64>| {
        let other = other?;
        let gained = design.simulated_mm.filter(|_| other.abs() > 1e-9);
        let gained = gained.map(|own| format!(" ({})", gain((own - other) / other.abs())));
        Some(mm(other) + &gained.unwrap_or_default())
    };
    let optimum = compared
        .optimum
        .filter(|_| design.role != Role::Optimum)
        .map(|optimum| {
            let ratio = compared.ratio.map(|ratio| format!(" (reaches {})", percent(ratio, 2)));
            mm(optimum) + &ratio.unwrap_or_default()
        });
    let found = design.role.is_found();
    let rows = [
        ("predicted", Some(predicted(design))),
        ("simulated", simulated(design)),
        ("area", Some(percent(design.area, 2))),
        ("optimum", optimum),
        ("intuitive, own area", beside(compared.intuitive_own).filter(|_| found)),
        (
            "intuitive, equal area",
            beside(compared.intuitive_equal_area).filter(|_| found),
        ),
    ];
    let rows = rows.into_iter().filter_map(|(name, text)| Some((name, text?)));
    let rows: String = rows
        .map(|(name, text)| format!("<dt>{name}</dt><dd>{}</dd>", escaped(&text)))
        .collect();
    format!("<dl>{rows}</dl>")
}

/// The predicted value with its difference from the simulated one.
pub fn predicted(design: &Design) -> String {
    let error = design.prediction_error();
    let error = error.map(|error| format!(" ({:+.2} %)", 100.0 * error));
    mm(design.predicted_mm) + &error.unwrap_or_default()
}

/// The simulated value with its estimated error; none where nothing was simulated.
pub fn simulated(design: &Design) -> Option<String> {
    match (design.simulated_mm, &design.outcome, design.error_mm) {
        (Some(value), _, Some(error)) => Some(format!("{:.4} ± {error:.4} mm", value + 0.0)),
        (Some(value), _, None) => Some(mm(value)),
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
        // The intuitive designs were never asked to meet any.
        status if design.role.is_found() => remark("warning", &format!("Not met: {status}")),
        status => remark("note", &format!("Would not meet: {status}")),
    }
    out
}
