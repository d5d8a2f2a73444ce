//! What was found for each pattern: listed one by one for few patterns, summarized for many.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use serde_json::{Value, json};

use super::job::extend;
use super::point::{FROM_MOUNT, Probe};
use super::side_results::SideResults;
use super::table::{self, Cell};
use super::text::Text;
use super::tone::Tone;
use deaflow_base::{error_digits, four_digits, measured, range_ends, rounded_by};
use deaflow_fem::{CriticalVoltage, GeometryError};
use deaflow_field::{Field, Mesh, Motion, OutcomeKind};
use deaflow_report::mm_measured;
use deaflow_scene::Breakdown;

/// Up to this many patterns are listed one by one.
pub const FEW: usize = 20;

/// A pattern, in one of the states of its scene.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SampleId {
    /// Position of the pattern.
    pub index: usize,
    /// The state, if the scene has states.
    pub state: Option<String>,
}

impl fmt::Display for SampleId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "pattern {}", self.index)?;
        self.state
            .as_ref()
            .map_or(Ok(()), |state| write!(f, " in state {state}"))
    }
}

/// The result for one pattern.
#[derive(Debug)]
pub struct SampleResult {
    /// The pattern.
    pub id: SampleId,
    /// The file that it was read from; empty if that is not known.
    pub file: String,
    /// The outcome.
    pub outcome: OutcomeKind,
    /// A description of the outcome, if there is no stable solution.
    pub failure: Option<String>,
    /// The largest displacement, if there is a solution.
    pub peak: Option<Peak>,
    /// The displacement at the requested point, mm.
    pub along_mm: Option<f64>,
    /// The same from rest, if not all sides are held.
    pub along_from_rest_mm: Option<f64>,
    /// The mesh that was chosen for a requested accuracy.
    pub accuracy: Option<AccuracyResult>,
    /// The fraction of the membrane that would wrinkle, if cells were evaluated.
    pub wrinkled_fraction: Option<f64>,
    /// Whether it was checked if a finer mesh could find no stable solution.
    pub is_checked: bool,
    /// Set if a finer mesh could find no stable solution: the critical voltage, if it was found.
    pub near_limit: Option<Option<CriticalVoltage>>,
    /// The critical voltage, if it was searched for.
    pub critical: Option<CriticalBracket>,
    /// The largest electric field relative to the breakdown field, if this effect is on.
    pub breakdown_ratio: Option<f64>,
    /// What the sides do, if not all are held.
    pub sides: Option<SideResults>,
    /// The motion of each rigid body, if there is a solution.
    pub bodies: Vec<Motion>,
}

/// The mesh that was chosen for a requested accuracy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AccuracyResult {
    /// The mesh.
    pub mesh: Mesh,
    /// The estimated largest error of the displacement on it, mm; none without a solution.
    pub mesh_error_mm: Option<f64>,
    /// The part of cells that stand for curves, if there are any.
    pub geometry_error: Option<GeometryError>,
    /// The requested accuracy, mm.
    pub accuracy_mm: f64,
}

impl AccuracyResult {
    /// The estimated largest error of mesh and geometry, mm, if both are known.
    fn error_mm(&self) -> Option<f64> {
        GeometryError::added_to(self.geometry_error, self.mesh_error_mm)
    }

    /// Whether the error is larger than requested, or not known, for a solution.
    fn is_missed(&self) -> bool {
        let is_above = |error: f64| error > self.accuracy_mm;
        self.mesh_error_mm.is_some() && self.error_mm().is_none_or(is_above)
    }

    /// Says why the requested accuracy is not reached.
    fn miss(&self) -> String {
        const ON_FINEST: &str = "the requested accuracy is not reached: estimated error";
        let with_curves = "use `curves: fitted` in the scene, and `--edges fitted` for drawings";
        match (self.geometry_error, self.error_mm()) {
            (Some(GeometryError::Estimated(geometry)), Some(error)) => format!(
                "{ON_FINEST} {} mm, of which {} mm because elements follow cells instead of curves: {with_curves}",
                error_digits(error),
                error_digits(geometry)
            ),
            (None, Some(error)) => format!("{ON_FINEST} {} mm on the finest mesh", error_digits(error)),
            _ => format!(
                "the error is not known: elements follow cells, and there is no solution on the curves for which these \
                 stand; {with_curves}"
            ),
        }
    }
}

/// The critical voltage of a pattern on one mesh.
#[derive(Clone, Debug)]
pub struct CriticalBracket {
    /// The mesh.
    pub mesh: Mesh,
    /// The mesh as text after a comma; empty if all patterns have the same.
    pub on: String,
    /// The voltages in V between which stability is lost, if these were found.
    pub between: Option<[f64; 2]>,
}

impl SampleResult {
    /// A result without further data.
    pub fn new(id: SampleId, outcome: OutcomeKind) -> Self {
        Self {
            id,
            file: String::new(),
            outcome,
            failure: None,
            peak: None,
            along_mm: None,
            along_from_rest_mm: None,
            accuracy: None,
            wrinkled_fraction: None,
            is_checked: true,
            near_limit: None,
            critical: None,
            breakdown_ratio: None,
            sides: None,
            bodies: Vec::new(),
        }
    }

    /// The estimated error in mm, for a requested accuracy.
    fn error_mm(&self) -> Option<f64> {
        self.accuracy?.error_mm()
    }

    /// The part of cells that stand for curves, mm.
    fn geometry_mm(&self) -> Option<f64> {
        self.accuracy?.geometry_error?.mm()
    }

    /// Rounds a displacement in mm by its estimated error, if that is known.
    fn rounded(&self, mm: f64) -> String {
        self.error_mm()
            .map_or_else(|| four_digits(mm), |error| rounded_by(mm, error))
    }

    /// The accuracy, if it was not reached.
    fn missed(&self) -> Option<AccuracyResult> {
        self.accuracy.filter(AccuracyResult::is_missed)
    }

    /// The outcome for people, with the doubt that a finer mesh leaves.
    fn outcome_text(&self) -> String {
        let name = spoken(self.outcome.name());
        match self.near_limit {
            Some(_) => format!("{name} (near the limit)"),
            None => name.to_owned(),
        }
    }

    fn outcome_tone(&self) -> Tone {
        match self.near_limit {
            Some(_) => Tone::Caution,
            None => Tone::of_solve(self.outcome),
        }
    }

    /// The fraction of the membrane that would wrinkle, if any.
    fn wrinkled(&self) -> Option<f64> {
        self.wrinkled_fraction.filter(|fraction| *fraction > 0.0)
    }
}

/// Returns the word of files for an outcome or the end of a path as people read it.
pub fn spoken(word: &str) -> &str {
    match word {
        "not-elliptic" => "loss of stability (not elliptic)",
        word => word,
    }
}

/// The largest displacement of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// Its magnitude, mm.
    pub mm: f64,
    /// Its place, mm from the lower left corner; none if the size of the membrane is not known.
    pub at_mm: Option<[f64; 2]>,
}

impl Peak {
    /// Finds the largest displacement of a field on cells with these sides in mm.
    pub fn of(field: &Field, cell_mm: Option<[f64; 2]>) -> Self {
        let ([x, y], mm) = field.largest();
        Self {
            mm,
            at_mm: cell_mm.map(|[width, height]| [x as f64 * width, y as f64 * height]),
        }
    }

    fn at(&self) -> String {
        let hundredths = |mm: f64| (100.0 * mm).round() / 100.0;
        match self.at_mm {
            // Without displacement there is no place of the largest.
            Some([x, y]) if self.mm > 0.0 => format!("{}, {} mm", hundredths(x), hundredths(y)),
            _ => "-".to_owned(),
        }
    }
}

/// Lists the results for people, or summarizes them; `file` contains all of them.
pub fn text(results: &[SampleResult], file: Option<&Path>, probe: Option<&Probe>) -> Text {
    match results.len() {
        0 => Text::new(),
        1..=FEW => {
            let mut text = Text::of(list(results, probe));
            if results.iter().any(|result| !result.bodies.is_empty()) {
                text.table(bodies(results));
            }
            if results.iter().any(|result| result.error_mm().is_some()) {
                text.line(format!(
                    "±: error of the mesh, estimated from two meshes{}; it does not include the error of the model",
                    with_geometry(results)
                ));
            }
            text
        }
        _ => summary(results, file),
    }
}

fn list(results: &[SampleResult], probe: Option<&Probe>) -> table::Table {
    let has_states = results.iter().any(|result| result.id.state.is_some());
    let has_files = results.iter().any(|result| !result.file.is_empty());
    let has_rest = results.iter().any(|result| result.sides.is_some());
    let largest = format!("largest displacement{}", if has_rest { FROM_MOUNT } else { "" });
    // Predictions are from rest, and have no results of sides.
    let title = probe.map(|probe| match has_rest {
        true => probe.title_from_mount(),
        false => probe.title_from_rest(),
    });
    let from_rest = probe.filter(|_| has_rest).map(|_| "from rest");
    let mut header = vec!["pattern"];
    header.extend(has_files.then_some("file"));
    header.extend(has_states.then_some("state"));
    header.extend(["outcome", largest.as_str(), "at"]);
    header.extend(title.as_deref());
    header.extend(from_rest);
    let numbers: Vec<&str> = ["pattern", largest.as_str()]
        .into_iter()
        .chain(title.as_deref())
        .chain(from_rest)
        .collect();
    let mut table = table::table(&header, &numbers)
        .flowing(&["at"])
        .dispensable(&["pattern"]);
    for result in results {
        let mut row = vec![Cell::from(result.id.index)];
        row.extend(has_files.then(|| Cell::from(&result.file)));
        row.extend(has_states.then(|| Cell::from(result.id.state.as_deref().unwrap_or("-"))));
        row.push(Cell::toned(&result.outcome_text(), result.outcome_tone()));
        let peak = result
            .peak
            .map(|peak| format!("{} mm", mm_measured(peak.mm, result.error_mm())));
        row.push(Cell::from(peak.unwrap_or("-".to_owned())));
        // With a point it may be below the line, where a dash would take a line of its own.
        let nowhere = if probe.is_some() { "" } else { "-" };
        row.push(Cell::from(result.peak.map_or(nowhere.to_owned(), |peak| peak.at())));
        if probe.is_some() {
            let along = result.along_mm.map(|mm| format!("{} mm", result.rounded(mm)));
            row.push(Cell::from(along.unwrap_or("-".to_owned())));
        }
        if from_rest.is_some() {
            let along = result.along_from_rest_mm.map(|mm| format!("{} mm", result.rounded(mm)));
            row.push(Cell::from(along.unwrap_or("-".to_owned())));
        }
        table.add_row(row);
    }
    table
}

/// How the rigid bodies of the patterns move.
fn bodies(results: &[SampleResult]) -> table::Table {
    let has_states = results.iter().any(|result| result.id.state.is_some());
    let mut header = vec!["pattern"];
    header.extend(has_states.then_some("state"));
    header.extend(["body", "along x", "along y", "rotation"]);
    let mut table = table::table(&header, &["along x", "along y", "rotation"]);
    for result in results {
        for (body, motion) in result.bodies.iter().enumerate() {
            let mut row = vec![result.id.index.to_string()];
            row.extend(has_states.then(|| result.id.state.clone().unwrap_or_else(|| "-".to_owned())));
            row.push(body.to_string());
            row.extend(motion.translation.map(|mm| format!("{} mm", result.rounded(mm))));
            row.push(format!("{} deg", four_digits(motion.rotation)));
            table.add_row(row);
        }
    }
    table
}

fn summary(results: &[SampleResult], file: Option<&Path>) -> Text {
    let counts = counts(results.iter().map(SampleResult::outcome_text));
    let counted: Vec<String> = counts.iter().map(|(outcome, n)| format!("{outcome} {n}")).collect();
    let deserves_attention = |result: &SampleResult| !result.outcome.has_field() || result.near_limit.is_some();
    let tone = match results.iter().any(deserves_attention) {
        true => Tone::Caution,
        false => Tone::Plain,
    };
    let mut text = Text::new();
    text.toned(tone, format!("outcomes: {}", counted.join(", ")));
    if let Some([(smallest, least), (median, middle), (largest, most)]) = range(results) {
        text.line(format!(
            "largest displacement of each: smallest {} mm ({}), median {} mm, largest {} mm ({}) at {}",
            least.rounded(smallest),
            least.id,
            middle.rounded(median),
            most.rounded(largest),
            most.id,
            most.peak.map_or_else(String::new, |peak| peak.at())
        ));
    }
    let errors = results.iter().filter_map(|result| Some((result.error_mm()?, result)));
    if let Some((mm, result)) = errors.max_by(|a, b| a.0.total_cmp(&b.0)) {
        text.line(format!(
            "estimated error of the mesh{}: at most {} mm ({}); it does not include the error of the model",
            with_geometry(results),
            error_digits(mm),
            result.id
        ));
    }
    text.line(match file {
        Some(file) => format!("list all patterns: deaflow show {} --csv", file.display()),
        None => "list all patterns: --json, or -o OUT.h5 and `deaflow show OUT.h5 --csv`".to_owned(),
    });
    text
}

/// What an error contains besides that of the mesh.
fn with_geometry(results: &[SampleResult]) -> &'static str {
    match results.iter().any(|result| result.geometry_mm().is_some()) {
        true => " and of cells that stand for curves",
        false => "",
    }
}

/// Counts outcomes.
fn counts<O: Ord>(outcomes: impl Iterator<Item = O>) -> BTreeMap<O, usize> {
    let mut counts = BTreeMap::new();
    for outcome in outcomes {
        *counts.entry(outcome).or_insert(0) += 1;
    }
    counts
}

/// The smallest, the median and the largest of the peak displacements in mm, with their patterns; none without a
/// solution.
fn range(results: &[SampleResult]) -> Option<[(f64, &SampleResult); 3]> {
    let mut peaks: Vec<(f64, &SampleResult)> = results
        .iter()
        .filter_map(|result| Some((result.peak?.mm, result)))
        .collect();
    peaks.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (smallest, largest) = (*peaks.first()?, *peaks.last()?);
    let (low, high) = (peaks[(peaks.len() - 1) / 2], peaks[peaks.len() / 2]);
    Some([smallest, (f64::midpoint(low.0, high.0), low.1), largest])
}

/// Adds a line for each of the first few results that have one, and the number of the others.
fn add_lines(text: &mut Text, tone: Tone, results: &[SampleResult], line: impl Fn(&SampleResult) -> Option<String>) {
    let lines: Vec<String> = results
        .iter()
        .filter_map(|result| Some(format!("{}: {}", result.id, line(result)?)))
        .collect();
    for line in lines.iter().take(FEW) {
        text.toned(tone, line);
    }
    if lines.len() > FEW {
        text.toned(tone, format!("and {} more; --json lists all", lines.len() - FEW));
    }
}

/// Describes what deserves attention: failures, critical voltages, missed accuracies and wrinkles.
pub fn remarks(results: &[SampleResult], critical_note: Option<&str>) -> Text {
    let mut text = Text::new();
    let sides = results
        .iter()
        .take(FEW)
        .filter_map(|result| Some((result, result.sides.as_ref()?)));
    for (result, line) in sides.flat_map(|(result, sides)| sides.lines().into_iter().map(move |line| (result, line))) {
        text.line(format!("{}: {line}", result.id));
    }
    add_lines(&mut text, Tone::Bad, results, |result| {
        let failure = result.failure.as_ref()?;
        Some(match result.outcome {
            OutcomeKind::NoEstimate => "no estimate: the steps do not lead to a state of the membrane".to_owned(),
            OutcomeKind::WorkLimit => {
                "the work limit was reached, so the stability is not known: raise --time-limit".to_owned()
            }
            OutcomeKind::IterationLimit => "the iterations did not converge, so the stability is not known".to_owned(),
            _ => format!("no stable solution: {failure}"),
        })
    });
    add_lines(&mut text, Tone::Plain, results, |result| {
        let critical = result.critical.as_ref()?;
        // The outcome of a pattern without a solution tells this already. A critical voltage with its error follows, or
        // that it was not found.
        let is_told = match (result.near_limit, critical.between) {
            (Some(Some(_)), _) | (Some(None), None) => true,
            (Some(None), Some(_)) | (None, _) => result.peak.is_none(),
        };
        (!is_told).then(|| match critical.between {
            Some([stable, lost]) => {
                let [stable, lost] = range_ends([stable, lost]);
                format!("stability is lost between {stable} V and {lost} V{}", critical.on)
            }
            None => "the critical voltage was not found".to_owned(),
        })
    });
    if let Some(note) = critical_note {
        text.toned(Tone::Caution, note);
    }
    add_lines(&mut text, Tone::Caution, results, |result| {
        let near_limit = result.near_limit?;
        // On the mesh of the solution it may have been found.
        let is_told = near_limit.is_none() && result.critical.as_ref().is_some_and(|found| found.between.is_some());
        Some(match is_told {
            true => CLOSE_TO_INSTABILITY.to_owned(),
            false => close_to_instability(near_limit),
        })
    });
    add_lines(&mut text, Tone::Caution, results, |result| {
        breakdown(result.breakdown_ratio?)
    });
    add_lines(&mut text, Tone::Caution, results, |result| {
        Some(result.missed()?.miss())
    });
    add_lines(&mut text, Tone::Plain, results, |result| {
        Some(format!(
            "{:.1} % of the membrane would wrinkle",
            100.0 * result.wrinkled()?
        ))
    });
    text
}

/// Describes an electric field that is close to the breakdown field or exceeds it.
pub fn breakdown(ratio: f64) -> Option<String> {
    let is = match ratio {
        1.005.. => "exceeds",
        1.0.. => "is at",
        Breakdown::NEAR.. => "is close to",
        _ => return None,
    };
    // A field below the breakdown field is not rounded to it.
    let ratio = match ratio {
        0.995..1.0 => rounded_by(ratio, 1.0 - ratio),
        _ => format!("{ratio:.2}"),
    };
    Some(format!("the electric field {is} the breakdown field: E/E_B = {ratio}"))
}

/// What deserves attention in a stable solution that a finer mesh could reject.
const CLOSE_TO_INSTABILITY: &str = "close to instability: a finer mesh may find no stable solution";

/// Describes a stable solution that a finer mesh could reject, with the critical voltage, if it was found.
pub fn close_to_instability(critical: Option<CriticalVoltage>) -> String {
    let limit = critical.map_or("was not found".to_owned(), |found| format!("is {}", with_error(&found)));
    format!("{CLOSE_TO_INSTABILITY}; the critical voltage {limit}")
}

/// A critical voltage with its error, or why that is not known.
pub fn with_error(critical: &CriticalVoltage) -> String {
    let why = match (critical.error, critical.fine) {
        (Some(error), _) => return format!("{} V", measured(critical.voltage, error)),
        (None, None) => "no limit was found on a finer mesh",
        (None, Some(_)) => "no limit was found with the drawn shapes",
    };
    format!("{} V, error not known: {why}", four_digits(critical.voltage))
}

/// Describes the results of `patterns` patterns for programs.
pub fn document(results: &[SampleResult], patterns: usize, probe: Option<&Probe>) -> Value {
    let each = |keys: &dyn Fn(&SampleResult) -> Option<Value>| -> Vec<Value> {
        let with_id = |result: &SampleResult| {
            let mut document = json!({ "index": result.id.index });
            if let Some(state) = &result.id.state {
                document["state"] = json!(state);
            }
            extend(&mut document, keys(result)?);
            Some(document)
        };
        results.iter().filter_map(with_id).collect()
    };
    let all = each(&|result| {
        let mut own = json!({
            "discretisation_error": result.accuracy.and_then(|accuracy| accuracy.mesh_error_mm),
            "geometry_error": result.geometry_mm(),
            "elements_per_cell": result.accuracy.map(|accuracy| accuracy.mesh.elements_per_cell()),
            "order": result.accuracy.map(|accuracy| accuracy.mesh.order().degree()),
            "outcome": result.outcome,
            "near_limit": (result.is_checked && result.outcome == OutcomeKind::Converged)
                .then_some(result.near_limit.is_some()),
            "max_displacement_mm": result.peak.map(|peak| peak.mm),
            "at_mm": result.peak.and_then(|peak| peak.at_mm),
            "file": Some(&result.file).filter(|file| !file.is_empty()),
            "along_mm": result.along_mm,
        });
        if let Some(mm) = result.along_from_rest_mm {
            own["along_from_rest_mm"] = json!(mm);
        }
        if let Some(sides) = &result.sides {
            extend(&mut own, sides.document());
        }
        if !result.bodies.is_empty() {
            let (translations, rotations): (Vec<[f64; 2]>, Vec<f64>) = result
                .bodies
                .iter()
                .map(|motion| (motion.translation, motion.rotation))
                .unzip();
            extend(
                &mut own,
                json!({ "body_translation_mm": translations, "body_rotation_deg": rotations }),
            );
        }
        Some(own)
    });
    let unstable = each(&|result| Some(json!({ "outcome": result.failure.as_ref()? })));
    let near_limit = each(&|result| {
        let found = result.near_limit?;
        Some(json!({
            "critical_voltage": found.map(|found| found.voltage),
            "error": found.and_then(|found| found.error),
        }))
    });
    let critical = each(&|result| {
        let critical = result.critical.as_ref()?;
        Some(json!({
            "between": critical.between,
            "elements_per_cell": critical.mesh.elements_per_cell(),
            "order": critical.mesh.order().degree(),
        }))
    });
    let range = range(results)
        .map(|[smallest, median, largest]| json!({ "smallest": smallest.0, "median": median.0, "largest": largest.0 }));
    let mut document = json!({
        "samples": patterns,
        "unstable": unstable.len(),
        "unstable_samples": unstable,
        "accuracy_missed": each(&|result| {
            let missed = result.missed()?;
            Some(json!({
                "discretisation_error": missed.mesh_error_mm,
                "geometry_error": missed.geometry_error.and_then(GeometryError::mm),
            }))
        }),
        "near_limit": near_limit,
        "critical_voltages": critical,
        "wrinkled": each(&|result| Some(json!({ "wrinkled_fraction": result.wrinkled()? }))),
        "breakdown": each(&|result| Some(json!({ "breakdown_ratio": result.breakdown_ratio? }))),
        "outcomes": counts(results.iter().map(|result| result.outcome.name())),
        "max_displacement_mm": range,
        "patterns": all,
    });
    if let Some(probe) = probe {
        document["along"] = probe.document();
    }
    document
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tone::Screen;

    fn result(index: usize, mm: Option<f64>) -> SampleResult {
        let outcome = mm.map_or(OutcomeKind::PullIn, |_| OutcomeKind::Converged);
        SampleResult {
            peak: mm.map(|mm| Peak {
                mm,
                at_mm: Some([25.0, 1.004]),
            }),
            ..SampleResult::new(SampleId { index, state: None }, outcome)
        }
    }

    #[test]
    fn a_requested_accuracy_is_reported() {
        let accurate = |index, mm, mesh_error_mm| SampleResult {
            accuracy: Some(AccuracyResult {
                mesh: Mesh::biquadratic(2),
                mesh_error_mm,
                geometry_error: None,
                accuracy_mm: 0.005,
            }),
            ..result(index, mm)
        };
        let few = [accurate(0, Some(2.15), Some(0.0032)), accurate(1, None, None)];
        let shown = text(&few, None, None).show(Screen::default());
        let lines: Vec<&str> = shown.lines().collect();
        assert_eq!(lines[3], "       0   converged     2.1500 ± 0.0032 mm   25, 1 mm");
        assert_eq!(lines[4], "       1   pull-in                        -   -");
        assert!(lines[6].starts_with("±: error of the mesh"), "{shown}");
        let document = document(&few, 2, None);
        let [first, lost] = [&document["patterns"][0], &document["patterns"][1]];
        assert_eq!(first["discretisation_error"], 0.0032);
        assert_eq!((&first["elements_per_cell"], &first["order"]), (&json!(2), &json!(2)));
        assert_eq!(lost["discretisation_error"], Value::Null);
        let many: Vec<SampleResult> = (0..23).map(|k| accurate(k, Some(1.0), Some(1e-4 * k as f64))).collect();
        let shown = text(&many, None, None).show(Screen::default());
        assert!(
            shown.contains("estimated error of the mesh: at most 0.0022 mm (pattern 22)"),
            "{shown}"
        );
    }

    #[test]
    fn an_error_contains_that_of_cells_in_place_of_curves() {
        let of_curves = |geometry_error| SampleResult {
            accuracy: Some(AccuracyResult {
                mesh: Mesh::biquadratic(1),
                mesh_error_mm: Some(0.002),
                geometry_error: Some(geometry_error),
                accuracy_mm: 0.01,
            }),
            ..result(0, Some(1.05))
        };
        let told = |result: SampleResult| {
            let all = [result];
            let shown = text(&all, None, None).show(Screen::default());
            (
                shown + &remarks(&all, None).show(Screen::default()),
                document(&all, 1, None),
            )
        };
        let (shown, found) = told(of_curves(GeometryError::Estimated(0.025)));
        for part in [
            "1.050 ± 0.027 mm",
            "estimated from two meshes and of cells that stand for curves",
            "estimated error 0.027 mm, of which 0.025 mm because elements follow cells instead of curves",
        ] {
            assert!(shown.contains(part), "{shown}");
        }
        assert_eq!(found["patterns"][0]["discretisation_error"], 0.002);
        assert_eq!(found["patterns"][0]["geometry_error"], 0.025);
        assert_eq!(found["accuracy_missed"][0]["geometry_error"], 0.025);
        let (shown, found) = told(of_curves(GeometryError::Estimated(0.005)));
        assert!(shown.contains("± 0.007") && !shown.contains("not reached"), "{shown}");
        assert_eq!(found["accuracy_missed"], json!([]));
        let (shown, found) = told(of_curves(GeometryError::Unknown));
        assert!(
            shown.contains("the error is not known") && !shown.contains('±'),
            "{shown}"
        );
        assert_eq!(found["accuracy_missed"][0]["geometry_error"], Value::Null);
    }

    #[test]
    fn each_quantity_is_told_once() {
        let limit = CriticalVoltage {
            voltage: 5900.0,
            error: Some(40.0),
            coarse: deaflow_fem::MeshLimit {
                mesh: Mesh::biquadratic(1),
                voltage: 6000.0,
            },
            fine: None,
        };
        let told_between = |between, near_limit, breakdown_ratio, mm| {
            let one = SampleResult {
                near_limit,
                breakdown_ratio,
                critical: Some(CriticalBracket {
                    mesh: Mesh::biquadratic(1),
                    on: String::new(),
                    between,
                }),
                ..result(0, mm)
            };
            remarks(&[one], None).show(Screen::default())
        };
        let told = |near_limit, ratio, mm| told_between(Some([6100.0, 6110.0]), near_limit, ratio, mm);
        let near = told(Some(Some(limit)), Some(0.5), Some(1.0));
        assert!(near.contains("5900 ± 40 V") && !near.contains("6100"), "{near}");
        let searched = told(None, Some(0.93), Some(1.0));
        assert!(
            searched.contains("between 6100 V and 6110 V")
                && searched.contains("close to the breakdown field: E/E_B = 0.93")
        );
        for (ratio, words) in [
            (1.04, "exceeds the breakdown field: E/E_B = 1.04"),
            (1.001, "is at the breakdown field: E/E_B = 1.00"),
            (0.9962, "is close to the breakdown field: E/E_B = 0.9962"),
            (0.994, "is close to the breakdown field: E/E_B = 0.99"),
        ] {
            assert!(told(None, Some(ratio), Some(1.0)).contains(words), "{ratio}");
        }
        // The limit of finer meshes was not found: that of this mesh is told, or once that there is none.
        let on_this_mesh = told(Some(None), None, Some(1.0));
        assert!(on_this_mesh.contains("6100 V") && on_this_mesh.contains("close to instability"));
        assert!(!on_this_mesh.contains("not found"), "{on_this_mesh}");
        let nowhere = told_between(None, Some(None), None, Some(1.0));
        assert_eq!(nowhere.matches("was not found").count(), 1, "{nowhere}");
        // At the work limit nothing is known of the stability.
        let stopped = SampleResult {
            failure: Some("work-limit: raise the time limit".to_owned()),
            ..SampleResult::new(SampleId::default(), OutcomeKind::WorkLimit)
        };
        let text = remarks(&[stopped], None).show(Screen::default());
        assert!(
            text.contains("the stability is not known") && !text.contains("no stable"),
            "{text}"
        );
    }

    #[test]
    fn few_are_listed() {
        let shown = text(&[result(0, Some(2.15)), result(1, None)], None, None).show(Screen::default());
        let lines: Vec<&str> = shown.lines().collect();
        assert_eq!(lines[3], "       0   converged               2.150 mm   25, 1 mm");
        assert_eq!(lines[4], "       1   pull-in                        -   -");
    }

    #[test]
    fn a_solution_near_the_limit_is_not_simply_converged() {
        let near = |index| SampleResult {
            near_limit: Some(None),
            ..result(index, Some(2.15))
        };
        let few = [near(0), result(1, Some(2.15)), result(2, None)];
        let table = list(&few, None);
        let shown = Text::of(table).show(Screen::default());
        let lines: Vec<&str> = shown.lines().collect();
        assert!(lines[3].contains("   converged (near the limit)   "), "{shown}");
        assert!(!lines[4].contains("limit") && !lines[5].contains("limit"), "{shown}");
        let document = document(&few, few.len(), None);
        let named = [0, 1, 2].map(|k| document["patterns"][k]["near_limit"].clone());
        assert_eq!(named, [json!(true), json!(false), Value::Null]);
        // The words of files and JSON stay.
        assert_eq!(document["patterns"][0]["outcome"], "converged");
        assert_eq!(document["outcomes"], json!({ "converged": 2, "pull-in": 1 }));
        let many: Vec<SampleResult> = (0..20)
            .map(|k| result(k, Some(1.0)))
            .chain([near(20), near(21)])
            .collect();
        let shown = text(&many, None, None).show(Screen::default());
        let counted = "outcomes: converged 20, converged (near the limit) 2\n";
        assert!(shown.contains(counted), "{shown}");
    }

    #[test]
    fn many_are_summarized() {
        let results: Vec<SampleResult> = (0..23).map(|k| result(k, (k > 2).then_some(k as f64))).collect();
        let shown = text(&results, Some(Path::new("o.h5")), None).show(Screen::default());
        for part in [
            "outcomes: converged 20, pull-in 3\n",
            "smallest 3.000 mm (pattern 3), median 12.50 mm, largest 22.00 mm (pattern 22) at 25, 1 mm\n",
            "deaflow show o.h5 --csv",
        ] {
            assert!(shown.contains(part), "{shown}");
        }
        let document = document(&results, results.len(), None);
        assert_eq!(document["outcomes"], json!({ "converged": 20, "pull-in": 3 }));
        assert_eq!(document["max_displacement_mm"]["median"], 12.5);
        assert_eq!(document["patterns"][0]["max_displacement_mm"], Value::Null);
        assert_eq!(document["patterns"][22]["at_mm"], json!([25.0, 1.004]));
    }

    #[test]
    fn without_solutions_there_is_no_range() {
        let results: Vec<SampleResult> = (0..30).map(|k| result(k, None)).collect();
        assert!(!text(&results, None, None).show(Screen::default()).contains("largest"));
        assert_eq!(
            document(&results, results.len(), None)["max_displacement_mm"],
            Value::Null
        );
    }
}
