//! `deaflow diff`: compares the parameters and results of two runs.

use std::collections::BTreeMap;
use std::path::Path;

use clap::Args;
use serde_json::{Value, json};

use super::arguments::{SetArguments, StoreArguments};
use super::log::{WIDTH, with_error, with_unit};
use super::snapshot::{self, ByPath, Snapshot, SnapshotReader};
use super::text::Text;
use super::{CliError, Exit, Output, csv, locate, table};
use deaflow_base::Canonical;
use deaflow_orchestrator::{is_filled, with_short_digest};

/// Compare the parameters and results of two runs
#[derive(Debug, Args)]
#[command(after_help = examples!(
    "deaflow diff",
    "deaflow diff @2 @1",
    "deaflow diff pipeline.yaml --set stages.design.generations=60",
))]
pub struct DiffArguments {
    /// A run (@1 is the last in `deaflow log`, @2 the one before it, PIPELINE.yaml@1 the last of a pipeline, or its
    /// digits),
    /// a pipeline, a lock file, or an artifact by its digits [default: compare the last two runs of the pipeline that
    /// was run last]
    #[arg(value_name = "A")]
    pub from: Option<String>,
    /// The other side; without it, a pipeline is compared with its last run, or with itself with the overrides of --set
    #[arg(value_name = "B")]
    pub to: Option<String>,
    #[command(flatten)]
    pub set: SetArguments,
    /// Print CSV: what, name, both values, and their errors
    #[arg(long, conflicts_with = "json")]
    pub csv: bool,
    #[command(flatten)]
    pub store: StoreArguments,
}

/// A value that differs between two snapshots.
pub struct Change<T> {
    pub name: String,
    pub from: Option<T>,
    pub to: Option<T>,
    /// The estimated errors of both values, if they are known.
    pub errors: [Option<f64>; 2],
}

pub fn execute(arguments: &DiffArguments, output: &Output) -> Result<Exit, CliError> {
    let [from, to] = [&arguments.from, &arguments.to].map(|named| named.as_deref().map(locate::pipeline_of_folder));
    let store = locate::existing_store(&arguments.store.folder_of_any(from.iter().chain(&to)))?;
    let reader = SnapshotReader::new(&store);
    let sets = arguments.set.overrides()?;
    let (from, to) = match (from.as_deref(), to.as_deref()) {
        (Some(from), Some(to)) => (reader.read(from, &[])?, reader.read(to, &sets)?),
        (Some(from), None) if !sets.is_empty() => (reader.read(from, &[])?, reader.read(from, &sets)?),
        (Some(pipeline), None) if locate::is_pipeline(Path::new(pipeline)) => {
            (reader.last_of(pipeline)?, reader.read(pipeline, &[])?)
        }
        (Some(_), None) => {
            return Err(CliError::bad_input("nothing to compare it with")
                .help("name two runs, as in `deaflow diff @2 @1`, or a pipeline and --set"));
        }
        (None, _) => {
            let [from, to] = reader.last_two()?;
            (from, to)
        }
    };
    if !sets.is_empty() && !to.can_be_set {
        return Err(
            CliError::bad_input(format!("--set needs a pipeline; {} is not a pipeline", to.title))
                .help("as in: deaflow diff @1 PIPELINE.yaml --set PATH=VALUE"),
        );
    }
    let both = [&from, &to];
    let parameters = changes(both, &snapshot::parameters(both));
    let results = results(&from, &to);
    if arguments.csv {
        output.plain(&rows(&parameters, &results)?)?;
        return Ok(Exit::Done);
    }
    output.result(
        || document(&from, &to, &parameters, &results),
        || text(&from, &to, &written_changes(both), &results),
    )
}

/// Returns the parameters that differ as written in a pipeline, by the paths of `--set`. Parameters of the scene that
/// are the same for all stages appear once.
fn written_changes(both: [&Snapshot; 2]) -> Vec<Change<Canonical>> {
    changes(both, &snapshot::written_parameters(both))
}

/// Returns the parameters of two snapshots that differ, by their paths.
pub fn changes([from, to]: [&Snapshot; 2], [before, after]: &[ByPath; 2]) -> Vec<Change<Canonical>> {
    let names = before
        .keys()
        .chain(after.keys().filter(|name| !before.contains_key(*name)));
    let mut changes: Vec<Change<Canonical>> = names
        .filter(|name| before.get(*name) != after.get(*name))
        // Unknown parameters are not differences; they are reported separately.
        .filter(|name| !from.is_unknown(name) && !to.is_unknown(name))
        // A parameter of the scene that is missing may belong to a stage with unknown parameters.
        .filter(|name| {
            let is_lacking = |side: &Snapshot, known: &ByPath| {
                !known.contains_key(*name) && side.without_parameters().next().is_some()
            };
            !(is_lacking(from, before) || is_lacking(to, after))
        })
        // What a run that failed early did not reach has not changed.
        .filter(|name| {
            let is_missing = |side: &Snapshot, known: &ByPath| side.is_incomplete && !known.contains_key(*name);
            !(is_missing(from, before) || is_missing(to, after))
        })
        .filter(|name| {
            let is_filled = |empty: &ByPath, other: &ByPath| {
                empty
                    .get(*name)
                    .is_some_and(|value| is_filled(name, value, other.keys()))
            };
            !is_filled(before, after) && !is_filled(after, before)
        })
        .map(|name| Change {
            name: name.clone(),
            from: before.get(name).cloned(),
            to: after.get(name).cloned(),
            errors: [None; 2],
        })
        .collect();
    changes.sort_by(|a, b| a.name.cmp(&b.name));
    changes
}

fn results(from: &Snapshot, to: &Snapshot) -> Vec<Change<f64>> {
    let names = from
        .results
        .keys()
        .chain(to.results.keys().filter(|name| !from.results.contains_key(*name)));
    let mut changes: Vec<Change<f64>> = names
        .map(|name| Change {
            name: name.clone(),
            from: known(from, name),
            to: known(to, name),
            errors: [from, to].map(|side| side.errors.get(name).copied()),
        })
        .filter(|change| change.from != change.to)
        .collect();
    changes.sort_by(|a, b| a.name.cmp(&b.name));
    changes
}

/// Returns a result of one side; NaN means unknown.
fn known(side: &Snapshot, name: &str) -> Option<f64> {
    side.results.get(name).copied().filter(|value| value.is_finite())
}

/// Returns the side that has a result.
fn side_of<'a>(change: &Change<f64>, from: &'a Snapshot, to: &'a Snapshot) -> &'a Snapshot {
    if change.from.is_some() { from } else { to }
}

fn document(from: &Snapshot, to: &Snapshot, parameters: &[Change<Canonical>], results: &[Change<f64>]) -> Value {
    let value = |value: &Option<Canonical>| value.as_ref().map(Canonical::to_json);
    let parameters = parameters
        .iter()
        .map(|change| json!({ "path": change.name, "from": value(&change.from), "to": value(&change.to) }));
    let results = results.iter().map(|change| {
        let [from_error, to_error] = change.errors;
        let mut result = json!({ "name": change.name, "from": change.from, "to": change.to });
        if change.errors != [None; 2] {
            (result["from_error"], result["to_error"]) = (json!(from_error), json!(to_error));
        }
        result
    });
    json!({
        "from": from.title,
        "to": to.title,
        "parameters": parameters.collect::<Vec<_>>(),
        "results": results.collect::<Vec<_>>(),
        "unknown": from.unknown.iter().chain(&to.unknown).collect::<Vec<_>>(),
    })
}

fn rows(parameters: &[Change<Canonical>], results: &[Change<f64>]) -> Result<String, CliError> {
    let header = ["what", "name", "from", "to", "from_error", "to_error"].map(str::to_owned);
    let shown = |value: &Option<Canonical>| value.as_ref().map_or_else(String::new, Canonical::to_string);
    let number = |value: Option<f64>| value.map_or_else(String::new, csv::number);
    let parameters = parameters.iter().map(|change| {
        vec![
            "parameter".to_owned(),
            change.name.clone(),
            shown(&change.from),
            shown(&change.to),
            String::new(),
            String::new(),
        ]
    });
    let results = results.iter().map(|change| {
        vec![
            "result".to_owned(),
            change.name.clone(),
            number(change.from),
            number(change.to),
            number(change.errors[0]),
            number(change.errors[1]),
        ]
    });
    csv::text(&header, parameters.chain(results))
}

fn text(from: &Snapshot, to: &Snapshot, parameters: &[Change<Canonical>], results: &[Change<f64>]) -> Text {
    let mut text = Text::from(format!("from {}\nto   {}\n", from.title, to.title));
    // All parameters of the other side would differ.
    let parameters = match from.is_empty() || to.is_empty() {
        true => &[],
        false => parameters,
    };
    let is_common = |name: &String| known(from, name).is_some() && known(to, name).is_some();
    let has_common_results = from.results.keys().any(is_common);
    let is_comparable = !parameters.is_empty() || from.shares_stages(to) || has_common_results;
    if !is_comparable {
        text.line("nothing to compare: no stage was reached in both");
    } else if parameters.is_empty() {
        let mut unknown = from.without_parameters().chain(to.without_parameters());
        text.line(match unknown.next() {
            None => "parameters are identical",
            Some(_) => "shared parameters are identical; unknown ones are listed below",
        });
    } else {
        let mut table = table::table(&["parameter", "from", "to"], &[])
            .flowing(&["parameter", "from", "to"])
            .at_most(WIDTH);
        let shown = |value: &Option<Canonical>| value.as_ref().map_or_else(|| "–".to_owned(), with_short_digest);
        for (name, change) in together(parameters) {
            table.add_row([name, shown(&change.from), shown(&change.to)]);
        }
        text.table(table);
    }
    if is_comparable {
        text.line("");
    }
    let (both, one): (Vec<&Change<f64>>, Vec<&Change<f64>>) = results
        .iter()
        .partition(|change| change.from.is_some() && change.to.is_some());
    let shown = |change: &Change<f64>| {
        let (_, result) = side_of(change, from, to).stage_and_result(&change.name);
        let one = |value: Option<f64>, error: Option<f64>| match (value, error) {
            (Some(value), Some(error)) => with_error(result, value, error),
            (Some(value), None) => with_unit(result, value),
            (None, _) => "–".to_owned(),
        };
        [one(change.from, change.errors[0]), one(change.to, change.errors[1])]
    };
    let (both, alike): (Vec<&Change<f64>>, Vec<&Change<f64>>) = both.into_iter().partition(|change| {
        let [from, to] = shown(change);
        from != to
    });
    if both.is_empty() && alike.is_empty() {
        if is_comparable {
            text.line(match has_common_results {
                true => "shared results are identical",
                false => "no common results",
            });
        }
    } else if !both.is_empty() {
        let mut table =
            table::table(&["result", "from", "to", "change"], &["from", "to", "change"]).flowing(&["result"]);
        for change in both {
            let [from, to] = shown(change);
            table.add_row([change.name.clone(), from, to, relative(change.from, change.to)]);
        }
        text.table(table);
    }
    if !alike.is_empty() {
        text.line(format!(
            "{} by less than the displayed digits: --json and --csv list them",
            match alike.len() {
                1 => "1 result differs".to_owned(),
                n => format!("{n} results differ"),
            }
        ));
    }
    for (side, of) in [
        ("the first", one_sided(&one, from, |change| change.from)),
        ("the second", one_sided(&one, to, |change| change.to)),
    ] {
        if !of.is_empty() {
            text.line(format!("\nonly in {side}: {of}"));
        }
    }
    for (side, of) in [
        ("the first", from.not_reached(to)),
        ("the second", to.not_reached(from)),
    ] {
        if is_comparable && !of.is_empty() {
            text.line(format!("\nnot run in {side}: {}", of.join(", ")));
        }
    }
    let of_to = to.unknown.iter().filter(|why| !from.unknown.contains(why));
    let unknown = from.unknown.iter().chain(of_to);
    for why in unknown {
        text.line(format!("\nnot compared: {why}"));
    }
    text
}

/// Combines equal changes of several entries of a list into one.
pub fn together(changes: &[Change<Canonical>]) -> Vec<(String, &Change<Canonical>)> {
    /// The path before and after the number, the numbers, and the first change.
    type Combined<'a> = (Option<[&'a str; 2]>, Vec<&'a str>, &'a Change<Canonical>);
    let mut combined: Vec<Combined<'_>> = Vec::new();
    for change in changes {
        let parts = of_list(&change.name);
        let ends = parts.map(|[before, _, after]| [before, after]);
        let same = combined.iter_mut().find(|(known, _, first)| {
            ends.is_some() && *known == ends && (&first.from, &first.to) == (&change.from, &change.to)
        });
        match (same, parts) {
            (Some((_, numbers, _)), Some([_, number, _])) => numbers.push(number),
            (_, parts) => combined.push((ends, parts.iter().map(|[_, number, _]| *number).collect(), change)),
        }
    }
    let named = combined.into_iter().map(|(ends, numbers, change)| {
        let name = match (ends, numbers.as_slice()) {
            (Some([before, after]), [_, _, ..]) => format!("{before}.{{{}}}.{after}", numbers.join(",")),
            _ => change.name.clone(),
        };
        (name, change)
    });
    named.collect()
}

/// Splits a path at a number: the part before it, the number, and the part after it.
fn of_list(path: &str) -> Option<[&str; 3]> {
    let mut from = 0;
    for step in path.split('.') {
        let end = from + step.len();
        let is_within = from > 0 && end < path.len();
        if is_within && !step.is_empty() && step.bytes().all(|byte| byte.is_ascii_digit()) {
            return Some([&path[..from - 1], step, &path[end + 1..]]);
        }
        from = end + 1;
    }
    None
}

/// Counts the results of only one side, by stage: `21 results of verified`.
fn one_sided(changes: &[&Change<f64>], of: &Snapshot, side: impl Fn(&Change<f64>) -> Option<f64>) -> String {
    let mut counts: BTreeMap<&str, u64> = BTreeMap::new();
    for change in changes.iter().filter(|change| side(change).is_some()) {
        let (stage, _) = of.stage_and_result(&change.name);
        *counts.entry(stage).or_default() += 1;
    }
    let each = counts
        .into_iter()
        .map(|(stage, n)| format!("{} of {stage}", table::counted(n, "results")));
    each.collect::<Vec<_>>().join(", ")
}

/// Formats a relative change in percent, or as a factor if it is large; empty without a first value.
fn relative(from: Option<f64>, to: Option<f64>) -> String {
    /// The largest ratio whose change is given in percent.
    const MOST: f64 = 100.0;
    match from.zip(to) {
        Some((from, to)) if from != 0.0 && (to / from).abs() > MOST => format!("× {}", table::number(to / from)),
        Some((from, to)) if from != 0.0 => {
            let percent = 100.0 * (to - from) / from.abs();
            let size = percent.abs();
            // Small changes keep their first digit.
            let decimals = if size >= 0.05 || size == 0.0 { 1 } else { 3 };
            match size > 0.0 && size < 5e-4 {
                true => format!("{}0.001 %", if percent < 0.0 { "> −" } else { "< " }),
                false => format!("{percent:+.decimals$} %").replace('-', "−"),
            }
        }
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tone::Screen;

    fn side(results: &[(&str, f64)]) -> Snapshot {
        let mut side = Snapshot::new("side".to_owned());
        side.results = results
            .iter()
            .map(|(name, value)| ((*name).to_owned(), *value))
            .collect();
        side
    }

    #[test]
    fn what_changes_alike_for_several_values_of_a_list_is_told_once() {
        let change = |name: &str, to: u64| Change {
            name: name.to_owned(),
            from: Some(Canonical::from(40_u64)),
            to: Some(Canonical::from(to)),
            errors: [None; 2],
        };
        let changes = [
            change("stages.b.list.0.x", 50),
            change("stages.b.list.1.x", 50),
            change("stages.b.list.2.x", 60),
            change("stages.c.count", 50),
        ];
        let names: Vec<String> = together(&changes).into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["stages.b.list.{0,1}.x", "stages.b.list.2.x", "stages.c.count"]);
    }

    #[test]
    fn changes_are_named_by_the_keys_of_the_pipeline() {
        let group = |units: u64, count: u64| {
            let own = [("units", units.into()), ("count", count.into())];
            (
                units.to_string(),
                Canonical::map(own.into_iter().chain([("family", "large-grid".into())])),
            )
        };
        let of_groups = |groups: &[(u64, u64)]| {
            let mut side = Snapshot::new("side".to_owned());
            let parameters = match groups {
                [(units, count)] => group(*units, *count).1,
                many => {
                    let groups = many.iter().map(|(units, count)| group(*units, *count));
                    Canonical::map([("units", Canonical::map(groups))])
                }
            };
            side.add_stage(["a", "sample"], Some(parameters), &["mask"; 0]);
            side
        };
        let told = |from: &[(u64, u64)], to: &[(u64, u64)]| -> Vec<String> {
            let changes = written_changes([&of_groups(from), &of_groups(to)]);
            let text = |value: &Option<Canonical>| value.as_ref().map_or_else(String::new, Canonical::to_string);
            let named = together(&changes).into_iter();
            named
                .map(|(name, change)| format!("{name}: {} to {}", text(&change.from), text(&change.to)))
                .collect()
        };
        let grids = [(2, 6), (4, 40), (10, 40)];
        assert_eq!(told(&grids, &grids[..2]), ["stages.a.units: [2, 4, 10] to [2, 4]"]);
        assert_eq!(told(&grids[..2], &grids[..1]), ["stages.a.units: [2, 4] to [2]"]);
        assert_eq!(
            told(&grids, &[(2, 6), (4, 50), (10, 50)]),
            ["stages.a.count_per_units: 40 to 50"]
        );
        let (from, to) = (of_groups(&grids), of_groups(&grids[..2]));
        let changes = changes([&from, &to], &snapshot::parameters([&from, &to]));
        assert!(changes.iter().any(|change| change.name == "stages.a.units.10.count"));
    }

    #[test]
    fn changed_inputs_and_files_are_named() {
        let side = |inputs: &[&[&str]], rows: &str| {
            let mut side = Snapshot::new("side".to_owned());
            let add = |side: &mut Snapshot, both: [&str; 2], parameters: Canonical| {
                side.add_stage(both, Some(parameters), &["mask"; 0]);
            };
            for both in [["a", "solve"], ["b", "solve"], ["checked", "audit"]] {
                add(&mut side, both, Canonical::map::<&str>([]));
            }
            add(&mut side, ["mine", "import"], Canonical::map([("rows", rows.into())]));
            add(&mut side, ["set", "balance"], Canonical::map::<&str>([]));
            let named = |names: &&[&str]| names.iter().map(|name| (*name).to_owned()).collect();
            side.set_inputs(inputs.iter().map(named).collect());
            side
        };
        let digests = ["1", "2"].map(|of| deaflow_base::Digest::of(of.as_bytes()).to_string());
        let told = |from: &Snapshot, to: &Snapshot| {
            let changes = written_changes([from, to]);
            text(from, to, &changes, &[]).show(Screen::default())
        };
        let first = side(&[&["a"], &["checked"]], &digests[0]);
        for (inputs, part) in [
            (&[&["b"][..], &["checked"]][..], "stages.set.needs"),
            (&[&["a"]], "stages.set.without"),
        ] {
            let told = told(&first, &side(inputs, &digests[0]));
            assert!(told.contains(part), "{told}");
            assert_eq!(told.matches("stages.").count(), 1, "{told}");
        }
        // Two stages made the same artifact.
        let same = told(&first, &side(&[&["b", "a"], &["checked"]], &digests[0]));
        assert!(same.contains("parameters are identical"), "{same}");
        let of_file = told(&first, &side(&[&["a"], &["checked"]], &digests[1]));
        let words = format!("digest {}", &digests[1][..12]);
        assert!(
            of_file.contains("stages.mine.files") && of_file.contains(&words),
            "{of_file}"
        );
    }

    #[test]
    fn stages_that_a_failed_run_did_not_reach_have_not_changed() {
        let parameters = |count: u64| Some(Canonical::map([("count", count.into())]));
        let mut whole = Snapshot::new("whole".to_owned());
        for name in ["a", "b", "c"] {
            whole.add_stage([name, "sample"], parameters(3), &["mask"; 0]);
        }
        let mut failed = Snapshot::new("failed".to_owned());
        failed.add_stage(["a", "sample"], parameters(3), &["mask"; 0]);
        let shown =
            |from: &Snapshot, to: &Snapshot| text(from, to, &written_changes([from, to]), &[]).show(Screen::default());
        // Stages of another pipeline are changes.
        assert!(shown(&failed, &whole).contains("stages.b.count"));
        failed.is_incomplete = true;
        let told = shown(&failed, &whole);
        assert!(
            told.contains("parameters are identical") && !told.contains("stages."),
            "{told}"
        );
        assert!(told.contains("not run in the first: b, c"), "{told}");
        assert!(shown(&whole, &failed).contains("not run in the second: b, c"));
    }

    #[test]
    fn a_run_that_reached_no_stage_is_not_identical_to_another() {
        let mut some = Snapshot::new("some".to_owned());
        let parameters = Canonical::map([("count", 3_u64.into())]);
        some.add_stage(["a", "sample"], Some(parameters), &["mask"; 0]);
        let none = Snapshot::new("none".to_owned());
        let shown = |from: &Snapshot, to: &Snapshot| {
            text(from, to, &written_changes([from, to]), &results(from, to)).show(Screen::default())
        };
        for (from, to) in [(&none, &none), (&none, &some), (&some, &none)] {
            let shown = shown(from, to);
            assert!(
                shown.ends_with("nothing to compare: no stage was reached in both"),
                "{shown}"
            );
        }
        assert!(shown(&some, &some).contains("parameters are identical"));
    }

    #[test]
    fn large_changes_are_factors() {
        assert_eq!(relative(Some(2.0), Some(1.0)), "−50.0 %");
        assert_eq!(relative(Some(2.0), Some(1.9996)), "−0.020 %");
        assert_eq!(relative(Some(2.0), Some(1.999_999)), "> −0.001 %");
        assert_eq!(relative(Some(1e-6), Some(1.2)), "× 1200000");
        assert_eq!(relative(None, Some(1.2)) + &relative(Some(0.0), Some(1.2)), "");
    }

    #[test]
    fn results_of_one_side_are_counted_and_unknown_ones_ignored() {
        let from = side(&[
            ("a.x", 1.0),
            ("a.y", f64::NAN),
            ("b.x", 3.0),
            ("b.y", 4.0),
            ("c.x", f64::NAN),
        ]);
        let to = side(&[("a.x", 2.0), ("a.y", f64::NAN), ("c.x", 5.0), ("c.y", f64::NAN)]);
        let found = results(&from, &to);
        let names: Vec<&str> = found.iter().map(|change| change.name.as_str()).collect();
        assert_eq!(names, ["a.x", "b.x", "b.y", "c.x"]);
        let shown = text(&from, &to, &[], &found).show(Screen::default());
        assert!(shown.contains("a.x") && !shown.contains("b.x"), "{shown}");
        assert!(shown.contains("only in the first: 2 results of b\n"), "{shown}");
        assert!(shown.ends_with("only in the second: 1 result of c"), "{shown}");
        // Values have their units, and results that only one side has are not identical.
        let moved = side(&[("a.max_displacement", 2.0), ("a.area", 0.5)]);
        let (before, after) = (
            side(&[("a.max_displacement", 1.0), ("a.area", 0.25)]),
            side(&[("b.x", 1.0)]),
        );
        let shown = |from: &Snapshot, to: &Snapshot| text(from, to, &[], &results(from, to)).show(Screen::default());
        let said = shown(&before, &moved);
        assert!(said.contains("1 mm   2 mm") && said.contains("25 %   50 %"), "{said}");
        let said = shown(&moved, &after);
        assert!(
            said.contains("nothing to compare") && !said.contains("identical"),
            "{said}"
        );
        assert!(shown(&moved, &moved).contains("shared results are identical"));
        // Errors are beside their results.
        let mut solved = side(&[("a.max_displacement", 2.0)]);
        solved.errors = BTreeMap::from([("a.max_displacement".to_owned(), 0.012)]);
        let (said, found) = (shown(&before, &solved), results(&before, &solved));
        assert!(said.contains("1 mm   2.000 ± 0.012 mm"), "{said}");
        let listed = rows(&[], &found).unwrap();
        assert!(listed.ends_with("result,a.max_displacement,1,2,,0.012\n"), "{listed}");
        let told = document(&before, &solved, &[], &found);
        assert_eq!(told["results"][1]["to_error"], 0.012);
        assert_eq!(told["results"][1]["from_error"], Value::Null);
        // Differences below the displayed digits are counted.
        let (from, to) = (side(&[("a.x", 2.154_700_1)]), side(&[("a.x", 2.154_700_2)]));
        let found = results(&from, &to);
        let shown = text(&from, &to, &[], &found).show(Screen::default());
        assert!(shown.contains("1 result differs") && !shown.contains("a.x"), "{shown}");
    }
}
