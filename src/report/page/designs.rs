//! The designs, case by case: a table, the curve over the area if targets differ only in it, and every pattern.

use maud::html;

use super::cards::{FOLDER, cards, shared};
use crate::designs::{Design, OtherObjective, Role, VOLUME_UNIT, is_swept, role_title};
use crate::drawing::{Axis, Chart, Colour, DeformedMembrane, LEGEND, Mark, Series, exaggeration};
use crate::format::{capitalised, change, number, percents, three};
use crate::html::{Column, Page};
use crate::intervals::verdict;
use deaflow_field::REACTION_UNIT;

/// Targets of different areas from which a curve is drawn.
const CURVE: usize = 3;

/// Roles with their colours.
const ROLES: [(Role, Colour); 6] = [
    (Role::Ga, Colour::Orange),
    (Role::Refined, Colour::Blue),
    (Role::Optimum, Colour::Green),
    (Role::IntuitiveEqualArea, Colour::Purple),
    (Role::Intuitive, Colour::Grey),
    (Role::Own, Colour::Vermillion),
];

/// Adds the section of the designs, with the command that makes a mask of one.
pub fn section(page: &mut Page, designs: &[Design], mask_command: &str) {
    if designs.is_empty() {
        return;
    }
    page.section("Designs");
    let membranes: Vec<DeformedMembrane> = designs.iter().flat_map(Design::membranes).collect();
    let scale = exaggeration(&membranes);
    let times = match scale {
        1.0 => "true to scale".to_owned(),
        scale => format!("{scale} times as large as they are"),
    };
    let has_optimum = designs.iter().any(|design| design.role == Role::Optimum);
    let optimum = match has_optimum {
        true => {
            " Gradient search is the best pattern that such searches from several starts found under its constraints, \
             such as the area; there may be a better one, and other constraints may allow more."
        }
        false => "",
    };
    page.lines(&[
        values_text(designs),
        format!("Displacements are drawn {times}; the faint grid is the membrane at rest.{optimum}"),
    ]);
    if designs.iter().any(|design| design.background.sides().is_some()) {
        page.line(&format!(
            "Displacements of membranes with sides that are not held count from rest, with all loads and without \
             voltage; they are drawn on the membrane as it is mounted. {LEGEND}"
        ));
    }
    page.add(html! {
        p {
            "All numbers: " a href={ (FOLDER) "designs.csv" } { "designs.csv" } ". Each pattern, and the mask of each \
            design at the size of the frame, is a file linked below its card. Masks of other sizes and formats: "
            code { (mask_command) }
        }
    });
    page.add(shared());
    for case in by(designs.iter(), |design| &design.case) {
        let Some(first) = case.first() else { continue };
        page.part(&match first.case.as_str() {
            "" => "All targets".to_owned(),
            name => format!("Case {name}"),
        });
        let compared = case.iter().filter(|design| design.role.is_compared());
        let mut rows: Vec<Vec<String>> = compared.map(|design| row(design, is_swept(designs, design))).collect();
        if case.iter().all(|design| design.target == first.target) {
            // The only target is named below.
            rows.iter_mut()
                .filter_map(|row| row.first_mut())
                .for_each(String::clear);
        }
        let mut columns = without_empty(&COLUMNS, &mut rows);
        if case.iter().all(|design| design.objective.shown_unit() != "mm") {
            // The cells have another unit.
            let titles = columns.iter_mut().map(|(title, _)| title);
            titles.for_each(|title| *title = title.strip_suffix(", mm").unwrap_or(title));
        }
        page.columns("Designs of the case", &columns, &rows);
        if let Some(curve) = curve(&case) {
            page.charts([&curve]);
        }
        for target in together(case.iter().copied(), Design::has_same_target) {
            let Some(first) = target.first() else { continue };
            page.title(&match is_swept(designs, first) && !first.setting.is_empty() {
                true => format!("{}, {}", first.target, first.setting),
                false => first.target.clone(),
            });
            let area = match first.area_target.as_str() {
                "free" => "any area".to_owned(),
                area => area.parse().map_or_else(
                    |_| format!("area {area}"),
                    |area: f64| format!("area {}", percents(area)),
                ),
            };
            let constraints = match first.constraints.trim() {
                "" | "{}" => String::new(),
                some => format!(", constraints {some}"),
            };
            let others = first.other_objectives().iter().zip(["second", "third"]);
            let others = others.map(|(other, number)| format!("; {number} objective: {}", other.description));
            page.note(&format!(
                "Objective: {}, {area}{constraints}{}",
                first.objective.words(),
                others.collect::<String>()
            ));
            page.add(cards(&target, scale));
        }
    }
}

/// Says what the values of designs are, and how these are drawn.
fn values_text(designs: &[Design]) -> String {
    let volumes = designs.iter().filter(|design| design.objective.ml_per_mm.is_some());
    let volumes = volumes.count();
    let sizes = designs
        .first()
        .map_or([0.0; 2], |design| design.scene.membrane().size_mm);
    let [width, height] = sizes.map(number);
    let in_files = format!(
        "Volumes are in ml; files have them as the mean height over the rectangle of {width} × {height} mm, in mm"
    );
    let displacements = "Values are the mean displacement along the target directions. Each design is shown at rest, \
                         with the point and direction of its objective, and deformed, with the displacement of the \
                         point. Numbers without a unit are in mm";
    let values = match volumes {
        0 => displacements.to_owned(),
        all if all == designs.len() => format!("Each design is shown at rest and deformed. {in_files}"),
        _ => format!("{displacements}. {in_files}"),
    };
    format!("{values}; gains are over the intuitive design at its own area and at the area of the design.")
}

/// Groups designs by a name, in the order of the names.
fn by<'d>(designs: impl Iterator<Item = &'d Design>, name: impl Fn(&Design) -> &String) -> Vec<Vec<&'d Design>> {
    together(designs, |one, other| name(one) == name(other))
}

/// Groups similar designs, in the order of the first of each group.
fn together<'d>(
    designs: impl Iterator<Item = &'d Design>,
    is_alike: impl Fn(&Design, &Design) -> bool,
) -> Vec<Vec<&'d Design>> {
    let mut groups: Vec<Vec<&Design>> = Vec::new();
    for design in designs {
        match groups.iter_mut().find(|group| is_alike(group[0], design)) {
            Some(group) => group.push(design),
            None => groups.push(vec![design]),
        }
    }
    groups
}

/// Removes the columns that are empty in all rows.
fn without_empty(columns: &[(&'static str, Column)], rows: &mut [Vec<String>]) -> Vec<(&'static str, Column)> {
    let keeps = |at: usize| rows.iter().any(|row| row.get(at).is_some_and(|text| !text.is_empty()));
    let kept: Vec<bool> = (0..columns.len()).map(keeps).collect();
    for row in rows.iter_mut() {
        let mut each = kept.iter();
        row.retain(|_| *each.next().unwrap_or(&true));
    }
    let both = columns.iter().zip(&kept);
    both.filter(|(_, kept)| **kept).map(|(column, _)| *column).collect()
}

/// Columns of the table; empty ones are left out.
const COLUMNS: [(&str, Column); 18] = [
    ("target", Column::Key),
    ("sweep", Column::Key),
    ("design", Column::Key),
    ("units", Column::Number),
    ("area", Column::Number),
    ("area, mm²", Column::Number),
    ("predicted, mm", Column::Number),
    ("robust, predicted, mm", Column::Number),
    ("error", Column::Number),
    ("simulated, mm", Column::Number),
    ("network, 95 %, mm", Column::Number),
    ("of best by gradients", Column::Number),
    ("gain, own area", Column::Number),
    ("gain, equal area", Column::Number),
    ("from target, mm", Column::Number),
    ("second objective", Column::Number),
    ("third objective", Column::Number),
    ("status", Column::Key),
];

fn row(design: &Design, is_swept: bool) -> Vec<String> {
    let text = |known: Option<String>| known.unwrap_or_default();
    let [gain_own, gain_equal] = design.gain_texts();
    let number = match design.member {
        0 => String::new(),
        member => format!(" {}", member + 1),
    };
    let simulated = match (design.simulated_mm, design.error_mm, &design.outcome) {
        (Some(value), error, _) => design.number_measured(value, error),
        (None, _, Some(outcome)) => outcome.to_string(),
        (None, _, None) => "not verified".to_owned(),
    };
    // The area has its own column.
    let other = |at: usize| {
        let other = design.other_objectives().get(at).filter(|other| !other.is_area());
        text(other.map(OtherObjective::value_text))
    };
    let met = match design.status.as_str() {
        "met" | "" => design.status.clone(),
        // An own pattern has its own area, and no constraints.
        status if design.role == Role::Own => status.to_owned(),
        _ => "not met".to_owned(),
    };
    vec![
        design.target.clone(),
        if is_swept {
            design.setting.clone()
        } else {
            String::new()
        },
        format!("{}{number}", role_title(design.role)),
        match design.unit_sides() {
            [columns, rows] if columns == rows => columns.to_string(),
            [columns, rows] => format!("{columns} × {rows}"),
        },
        percents(design.area),
        three(design.area_mm2()),
        text(design.predicted_mm.map(|value| design.number(value))),
        text(design.robust_mm.map(|value| design.number(value))),
        text(design.prediction_error().map(change)),
        simulated,
        text(design.interval.as_ref().map(|interval| interval.ends())),
        text(design.compared.share_text(&design.objective)),
        text(gain_own),
        text(gain_equal),
        text(design.distance_mm.map(|off| design.number(off))),
        other(0),
        other(1),
        met,
    ]
}

/// Draws displacement over area, if at least three targets with the same objective differ only in it.
fn curve(case: &[&Design]) -> Option<Chart> {
    let first = case.first()?;
    let mut areas: Vec<f64> = case
        .iter()
        .filter_map(|design| design.area_target.parse().ok())
        .collect();
    areas.sort_by(f64::total_cmp);
    areas.dedup();
    if areas.len() < CURVE || case.iter().any(|design| !is_of_curve(design, first)) {
        return None;
    }
    let points = |role: Role| {
        let own = case.iter().filter(move |design| design.role == role);
        let mut points: Vec<(f64, f64)> = own
            .filter_map(|d| Some((100.0 * d.area, d.objective.shown(d.simulated_mm?))))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points.dedup();
        points
    };
    let series: Vec<Series> = ROLES
        .into_iter()
        .map(|(role, colour)| {
            // Where a design reaches the optimum, both curves stay visible.
            let mark = if role == Role::Optimum {
                Mark::Dashed
            } else {
                Mark::LineAndDots
            };
            Series::new(role_title(role), colour, mark, points(role))
        })
        .filter(|series| !series.points.is_empty())
        .collect();
    let values: Vec<f64> = series.iter().flat_map(|s| &s.points).map(|(_, mm)| *mm).collect();
    let what = first.objective.quantity();
    let axes = [
        Axis::linear("Area [%]", 0.0, 100.0),
        Axis::above(&format!("Simulated {what} [{}]", first.objective.shown_unit()), &values),
    ];
    let title = capitalised(&format!("{what} over electrode area"));
    let chart = Chart::new(&title, axes, series);
    (!values.is_empty()).then(|| chart.with_note(first.objective.description()))
}

/// Whether two designs differ only in their areas.
fn is_of_curve(design: &Design, first: &Design) -> bool {
    design.objective == first.objective && design.scene == first.scene
}

/// Adds the comparison of predictions and simulations.
pub fn agreement(page: &mut Page, designs: &[Design]) {
    let known = designs
        .iter()
        .filter(|d| d.simulated_mm.is_some() && d.predicted_mm.is_some());
    let known: Vec<&Design> = known.collect();
    if known.is_empty() {
        return;
    }
    page.section("Predicted against simulated");
    page.line("All verified designs: the prediction of the search against the simulation of the verify stage.");
    let with_interval = known.iter().filter(|design| design.role.is_found());
    let with_interval = with_interval.filter_map(|design| Some((design.interval.as_ref()?, design.simulated_mm)));
    if let Some(verdict) = verdict(with_interval) {
        page.line(&format!("Designs of the searches: {verdict}."));
    }
    let charts = ["mm", VOLUME_UNIT, REACTION_UNIT].map(|unit| {
        let own: Vec<&Design> = known
            .iter()
            .copied()
            .filter(|design| design.objective.shown_unit() == unit)
            .collect();
        errors_chart(&own, unit)
    });
    for chart in charts.into_iter().flatten() {
        page.charts([&chart]);
    }
}

/// Draws the errors of the predictions of designs whose values have this unit; `None` if there are none.
fn errors_chart(known: &[&Design], unit: &str) -> Option<Chart> {
    let shown = |design: &Design| Some(design.objective.shown(design.simulated_mm?));
    let simulated: Vec<f64> = known.iter().filter_map(|d| shown(d)).collect();
    let series = |of: &dyn Fn(&Design) -> Option<(f64, f64)>| {
        let one = |(role, colour): (Role, Colour)| {
            let own: Vec<&&Design> = known.iter().filter(|design| design.role == role).collect();
            let points: Vec<((f64, f64), String)> = own
                .iter()
                .filter_map(|design| Some((of(design)?, design.name.clone())))
                .collect();
            let (points, names) = points.into_iter().unzip();
            Series::new(role_title(role), colour, Mark::Dots, points).with_texts(names)
        };
        ROLES
            .into_iter()
            .map(one)
            .filter(|s| !s.points.is_empty())
            .collect::<Vec<_>>()
    };
    let error = |design: &Design| Some((shown(design)?, 100.0 * design.prediction_error()?));
    let errors: Vec<f64> = known.iter().filter_map(|d| Some(error(d)?.1)).collect();
    if errors.is_empty() {
        return None;
    }
    let x = Axis::between(&format!("Simulated [{unit}]"), &simulated);
    let zero = Series::new("", Colour::Grey, Mark::Dashed, x.ends().map(|end| (end, 0.0)).to_vec());
    let axes = [x, Axis::around("Predicted minus simulated [% of simulated]", &errors)];
    let differences = Chart::new("Error of the predictions", axes, [vec![zero], series(&error)].concat());
    Some(differences.with_note("above the dashed line, the prediction is too large"))
}
