//! How patterns ended and how far they move: one by one where they are few, in numbers where they are many.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::{Value, json};

use super::point::Watched;
use super::simulate::Place;
use super::table::{self, Cell};
use super::text::Text;
use super::tone::Tone;
use deaflow_field::{Field, Mesh};
use deaflow_report::{error, uncertainty};

/// Patterns that are told one by one.
pub const FEW: usize = 20;

/// What became of a pattern.
#[derive(Debug)]
pub struct Ending {
    /// Which.
    pub place: Place,
    /// The name of its outcome.
    pub outcome: String,
    /// Where it moves most, if it has a field.
    pub peak: Option<Peak>,
    /// The file that it was read from; empty where that is not known.
    pub name: String,
    /// The displacement of the point that was asked about along its direction, mm.
    pub along_mm: Option<f64>,
    /// What an accuracy that was asked for came to; none without one.
    pub reached: Option<Reached>,
}

/// How accurate a solution is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reached {
    /// The mesh that was picked.
    pub mesh: Mesh,
    /// The estimated largest error of the displacement on it, mm; none where there is no solution.
    pub error_mm: Option<f64>,
}

impl Ending {
    /// The estimated error, mm, where an accuracy was asked for and reached or missed.
    fn error_mm(&self) -> Option<f64> {
        self.reached?.error_mm
    }
}

/// The largest displacement of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// Its magnitude, mm.
    pub mm: f64,
    /// The corner of cells where it is, mm from the lower left corner; none where the size of the membrane is not known.
    pub at_mm: Option<[f64; 2]>,
}

impl Peak {
    /// Of a field on cells of these sides in mm.
    pub fn of(field: &Field, cell_mm: Option<[f64; 2]>) -> Self {
        let ([x, y], mm) = field.largest();
        Self {
            mm,
            at_mm: cell_mm.map(|[width, height]| [x as f64 * width, y as f64 * height]),
        }
    }

    fn at(&self) -> String {
        match self.at_mm {
            // What does not move does so nowhere.
            Some([x, y]) if self.mm > 0.0 => format!("{}, {} mm", hundredths(x), hundredths(y)),
            _ => "-".to_owned(),
        }
    }
}

/// A place is as exact as people draw.
fn hundredths(mm: f64) -> f64 {
    (100.0 * mm).round() / 100.0
}

/// For people; `file` holds the rows of all.
pub fn text(endings: &[Ending], file: Option<&Path>, watched: Option<&Watched>) -> Text {
    match endings.len() {
        0 => Text::new(),
        1..=FEW => {
            let mut text = Text::of(one_by_one(endings, watched));
            if endings.iter().any(|ending| ending.error_mm().is_some()) {
                text.line("±: the error of the mesh, estimated from two; that of the model is no part of it");
            }
            text
        }
        _ => in_numbers(endings, file),
    }
}

fn one_by_one(endings: &[Ending], watched: Option<&Watched>) -> table::Table {
    let has_states = endings.iter().any(|ending| ending.place.state.is_some());
    let has_names = endings.iter().any(|ending| !ending.name.is_empty());
    let title = watched.map(Watched::title);
    let mut header = vec!["pattern"];
    header.extend(has_names.then_some("file"));
    header.extend(has_states.then_some("state"));
    header.extend(["outcome", "largest displacement", "at"]);
    header.extend(title.as_deref());
    let numbers = ["pattern", "largest displacement", title.as_deref().unwrap_or_default()];
    let mut table = table::table(&header, &numbers)
        .flowing(&["at"])
        .dispensable(&["pattern"]);
    for ending in endings {
        let Ending {
            place,
            outcome,
            peak,
            name,
            along_mm,
            ..
        } = ending;
        let error = ending
            .error_mm()
            .map_or_else(String::new, |mm| format!(" {}", uncertainty(mm)));
        let mut row = vec![Cell::from(place.index)];
        if has_names {
            row.push(Cell::from(name));
        }
        if has_states {
            row.push(Cell::from(place.state.as_deref().unwrap_or("-")));
        }
        row.push(Cell::toned(outcome, Tone::of_solve(outcome)));
        row.push(Cell::from(
            peak.map_or("-".to_owned(), |peak| format!("{:.4}{error} mm", peak.mm)),
        ));
        // Beside a point it may stand below the line, where a dash would be a line of its own.
        let nowhere = if watched.is_some() { "" } else { "-" };
        row.push(Cell::from(peak.map_or(nowhere.to_owned(), |peak| peak.at())));
        if watched.is_some() {
            row.push(Cell::from(along_mm.map_or("-".to_owned(), |mm| format!("{mm:.4} mm"))));
        }
        table.add_row(row);
    }
    table
}

fn in_numbers(endings: &[Ending], file: Option<&Path>) -> Text {
    let counts = counts(endings);
    let counted: Vec<String> = counts.iter().map(|(outcome, n)| format!("{outcome} {n}")).collect();
    let tone = match counts.keys().any(|outcome| Tone::of_solve(outcome) == Tone::Bad) {
        true => Tone::Caution,
        false => Tone::Plain,
    };
    let mut text = Text::new();
    text.toned(tone, format!("outcomes: {}", counted.join(", ")));
    if let Some(Spread {
        smallest,
        median,
        largest,
    }) = Spread::of(endings)
    {
        let named = |ending: &Ending| {
            let peak = ending
                .peak
                .map_or_else(String::new, |peak| format!("{:.4} mm", peak.mm));
            format!("{peak} ({})", ending.place)
        };
        let at = largest.peak.map_or_else(String::new, |peak| peak.at());
        text.line(format!(
            "largest displacement of each: smallest {}, median {median:.4} mm, largest {} at {at}",
            named(smallest),
            named(largest)
        ));
    }
    let errors = endings.iter().filter_map(|ending| Some((ending.error_mm()?, ending)));
    if let Some((mm, ending)) = errors.max_by(|a, b| a.0.total_cmp(&b.0)) {
        text.line(format!(
            "estimated error of the mesh: at most {} mm ({}); that of the model is no part of it",
            error(mm),
            ending.place
        ));
    }
    text.line(match file {
        Some(file) => format!("each pattern: deaflow show {} --csv", file.display()),
        None => "each pattern: --json, or -o OUT.h5 and `deaflow show OUT.h5 --csv`".to_owned(),
    });
    text
}

/// How many ended how.
fn counts(endings: &[Ending]) -> BTreeMap<&str, usize> {
    let mut counts = BTreeMap::new();
    for ending in endings {
        *counts.entry(ending.outcome.as_str()).or_insert(0) += 1;
    }
    counts
}

/// How far the patterns with a field move.
struct Spread<'a> {
    smallest: &'a Ending,
    /// In mm; of an even number the mean of the two in the middle.
    median: f64,
    largest: &'a Ending,
}

impl<'a> Spread<'a> {
    /// None where no pattern has a field.
    fn of(endings: &'a [Ending]) -> Option<Self> {
        let mut moved: Vec<(f64, &Ending)> = endings
            .iter()
            .filter_map(|ending| Some((ending.peak?.mm, ending)))
            .collect();
        moved.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (smallest, largest) = (moved.first()?.1, moved.last()?.1);
        let middle = moved.len() / 2;
        let median = match moved.len() % 2 {
            1 => moved[middle].0,
            _ => f64::midpoint(moved[middle - 1].0, moved[middle].0),
        };
        Some(Self {
            smallest,
            median,
            largest,
        })
    }
}

/// For programs: `outcomes`, `max_displacement_mm` and `patterns`.
pub fn document(endings: &[Ending]) -> Value {
    let each = endings.iter().map(|ending| {
        let reached = |of: fn(Reached) -> Value| ending.reached.map_or(Value::Null, of);
        ending.place.document(json!({
            "discretisation_error": ending.error_mm(),
            "elements_per_cell": reached(|reached| json!(reached.mesh.elements_per_cell())),
            "order": reached(|reached| json!(reached.mesh.order().degree())),
            "outcome": ending.outcome,
            "max_displacement_mm": ending.peak.map(|peak| peak.mm),
            "at_mm": ending.peak.and_then(|peak| peak.at_mm),
            "file": Some(&ending.name).filter(|name| !name.is_empty()),
            "along_mm": ending.along_mm,
        }))
    });
    let mm = |ending: &Ending| ending.peak.map(|peak| peak.mm);
    let spread = Spread::of(endings).map(
        |spread| json!({ "smallest": mm(spread.smallest), "median": spread.median, "largest": mm(spread.largest) }),
    );
    json!({
        "outcomes": counts(endings),
        "max_displacement_mm": spread,
        "patterns": each.collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tone::Screen;

    fn ending(index: usize, mm: Option<f64>) -> Ending {
        Ending {
            place: Place { index, state: None },
            outcome: mm.map_or("pull-in", |_| "converged").to_owned(),
            peak: mm.map(|mm| Peak {
                mm,
                at_mm: Some([25.0, 1.004]),
            }),
            name: String::new(),
            along_mm: None,
            reached: None,
        }
    }

    #[test]
    fn an_accuracy_that_was_asked_for_is_told() {
        let reached = |error_mm| {
            let mesh = Mesh::biquadratic(2);
            Some(Reached { mesh, error_mm })
        };
        let accurate = |index, mm, error_mm| Ending {
            reached: reached(error_mm),
            ..ending(index, mm)
        };
        let few = [accurate(0, Some(2.15), Some(0.0032)), accurate(1, None, None)];
        let shown = text(&few, None, None).show(Screen::default());
        let lines: Vec<&str> = shown.lines().collect();
        assert_eq!(lines[3], "       0   converged     2.1500 ± 0.0032 mm   25, 1 mm");
        assert_eq!(lines[4], "       1   pull-in                        -   -");
        assert!(lines[6].starts_with("±: the error of the mesh"), "{shown}");
        let document = document(&few);
        let [first, lost] = [&document["patterns"][0], &document["patterns"][1]];
        assert_eq!(first["discretisation_error"], 0.0032);
        assert_eq!((&first["elements_per_cell"], &first["order"]), (&json!(2), &json!(2)));
        assert_eq!(lost["discretisation_error"], Value::Null);
        let many: Vec<Ending> = (0..23).map(|k| accurate(k, Some(1.0), Some(1e-4 * k as f64))).collect();
        let shown = text(&many, None, None).show(Screen::default());
        assert!(
            shown.contains("estimated error of the mesh: at most 0.0022 mm (pattern 22)"),
            "{shown}"
        );
    }

    #[test]
    fn few_are_told_one_by_one() {
        let shown = text(&[ending(0, Some(2.15)), ending(1, None)], None, None).show(Screen::default());
        let lines: Vec<&str> = shown.lines().collect();
        assert_eq!(lines[3], "       0   converged              2.1500 mm   25, 1 mm");
        assert_eq!(lines[4], "       1   pull-in                        -   -");
    }

    #[test]
    fn many_are_told_in_numbers() {
        let endings: Vec<Ending> = (0..23).map(|k| ending(k, (k > 2).then_some(k as f64))).collect();
        let shown = text(&endings, Some(Path::new("o.h5")), None).show(Screen::default());
        assert_eq!(
            shown,
            "outcomes: converged 20, pull-in 3\nlargest displacement of each: smallest 3.0000 mm (pattern 3), median 12.5000 mm, largest \
             22.0000 mm (pattern 22) at 25, 1 mm\neach pattern: deaflow show o.h5 --csv"
        );
        let document = document(&endings);
        assert_eq!(document["outcomes"], json!({ "converged": 20, "pull-in": 3 }));
        assert_eq!(document["max_displacement_mm"]["median"], 12.5);
        assert_eq!(document["patterns"][0]["max_displacement_mm"], Value::Null);
        assert_eq!(document["patterns"][22]["at_mm"], json!([25.0, 1.004]));
    }

    #[test]
    fn nothing_is_said_of_how_far_nothing_moves() {
        let endings: Vec<Ending> = (0..30).map(|k| ending(k, None)).collect();
        assert!(!text(&endings, None, None).show(Screen::default()).contains("largest"));
        assert_eq!(document(&endings)["max_displacement_mm"], Value::Null);
    }
}
