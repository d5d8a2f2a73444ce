//! `deaflow solve --history`: how patterns move in time.

use std::time::Instant as Clock;

use clap::Args;
use rayon::prelude::*;
use serde_json::{Value, json};

use super::error::CliError;
use super::output::{Exit, Output};
use super::progress::Bar;
use super::simulate::seconds_each;
use super::solve::{SolveArguments, check_file, provenance};
use super::text::Text;
use super::{csv, table, write};
use deaflow_base::{Dimension, Progress, Quantity, Time};
use deaflow_content::{Histories, Lines, Packed};
use deaflow_fem::screening::Screened;
use deaflow_fem::{AccurateHistory, History, HistorySolver, Instant, USUAL_TIME_ERROR, check_leads};
use deaflow_field::{Field, Mesh, Motion};
use deaflow_pattern::Pattern;
use deaflow_report::figures::{self, draw_histories};
use deaflow_scene::{Scene, Side};
use deaflow_stage::direct;
use deaflow_store::write_file;

/// Latest time in s.
const LATEST: f64 = 1e12;
/// Most times that are written.
const MOST_TIMES: usize = 10_000;
/// An error that is told, over the usual one.
const BEYOND: f64 = 1.5;

/// The heading of options about vibration and time.
pub const TIME: &str = "In time";

#[derive(Clone, Debug, Args)]
pub struct HistoryArguments {
    /// Follow each pattern in the time of the drive; OUT.csv and OUT.png are written beside OUT.h5
    #[arg(long, conflicts_with_all = ["path", "cells"], help_heading = TIME)]
    pub history: bool,
    /// The times that are written, as in "0 s, 1 s, 10 min"; 0 s is just after the drive has begun [default: 25 up to `drive.duration`]
    #[arg(long, value_name = "TIMES", requires = "history", value_parser = times, help_heading = TIME)]
    at: Option<Times>,
    /// The time between two that are written, up to `drive.duration`
    #[arg(long, value_name = "TIME", requires = "history", conflicts_with = "at", value_parser = time, help_heading = TIME)]
    every: Option<Time>,
}

/// Times in s, in order.
#[derive(Clone, Debug, PartialEq)]
struct Times(Vec<f64>);

fn time(text: &str) -> Result<Time, String> {
    let quantity = Quantity::parse(text, Dimension::Time).map_err(|e| e.to_string())?;
    match Time::from_f64(quantity.value()) {
        Some(time) if (1e-12..=LATEST).contains(&time.value()) => Ok(time),
        _ => Err(format!("allowed: 1e-12 s to {LATEST:e} s")),
    }
}

fn times(text: &str) -> Result<Times, String> {
    let mut times = Vec::new();
    for part in text.split(',') {
        let time = Quantity::parse(part, Dimension::Time)
            .map_err(|e| e.to_string())?
            .value();
        if !(0.0..=LATEST).contains(&time) {
            return Err(format!("{part}: allowed: 0 s to {LATEST:e} s"));
        }
        times.push(time);
    }
    times.sort_by(f64::total_cmp);
    times.dedup();
    if times.len() > MOST_TIMES {
        return Err(format!("allowed: at most {MOST_TIMES} times"));
    }
    Ok(Times(times))
}

impl HistoryArguments {
    /// The times that are asked for in a scene.
    fn times(&self, scene: &Scene) -> Result<Vec<f64>, CliError> {
        if let Some(Times(times)) = &self.at {
            return Ok(times.clone());
        }
        let Some(duration) = scene.drive.duration.as_ref().map(|duration| duration.value()) else {
            return Err(
                CliError::bad_input("a history needs an end: the drive has no `duration`")
                    .help("give the times, as in --at \"0 s, 1 s, 10 s\", or `duration` in the drive"),
            );
        };
        let Some(every) = &self.every else {
            return Ok(usual_times(scene, duration));
        };
        if every.value() > duration {
            return Err(CliError::bad_input(format!(
                "--every {every} is longer than the drive, which lasts {duration} s"
            ))
            .help("give a shorter time, or name times with --at"));
        }
        let count = (duration / every.value() * (1.0 + 1e-12)).floor();
        if count >= MOST_TIMES as f64 {
            return Err(
                CliError::bad_input(format!("--every {every} asks for {count:.0} times"))
                    .help(format!("at most {MOST_TIMES} are written; --at names some")),
            );
        }
        let base = every.base();
        // Each as people would write it: not the sum of rounded numbers.
        let multiple = |k: u64| (k as f64 * every.value() * 1e12).round() / 1e12;
        let exact = |k: u64| {
            if base.to_f64() >= 1e-9 {
                multiple(k)
            } else {
                k as f64 * every.value()
            }
        };
        let mut times: Vec<f64> = (0..=count as u64).map(exact).collect();
        // The end is asked for too.
        if times.last().is_some_and(|last| *last < duration * (1.0 - 1e-9)) {
            times.push(duration);
        }
        Ok(times)
    }
}

/// 25 times up to the end: over three decades where the voltage is there at once, evenly where it changes.
fn usual_times(scene: &Scene, duration: f64) -> Vec<f64> {
    const COUNT: i32 = 24;
    let share = |k: i32| f64::from(k) / f64::from(COUNT);
    let place = |k: i32| match (k, is_step(scene)) {
        (0, _) => 0.0,
        (_, true) => duration * 10f64.powf(3.0 * (share(k) - 1.0)),
        (_, false) => duration * share(k),
    };
    (0..=COUNT).map(place).collect()
}

fn is_step(scene: &Scene) -> bool {
    scene.waveform().step.is_some()
}

/// Follows patterns in time and writes what they do as arrays, as a table and as a figure.
///
/// # Errors
/// When a file would be lost, the scene or a pattern cannot be used, or a file cannot be written.
pub fn execute(arguments: &SolveArguments, scene: &[&str], output: &Output) -> Result<Exit, CliError> {
    let file = &arguments.patterns.file()?.to_owned();
    let (values, figure) = (file.with_extension("csv"), file.with_extension("png"));
    if [&values, &figure].contains(&file) {
        return Err(
            CliError::bad_input(format!("{} would be written twice", file.display()))
                .help("-o names the HDF5 file, as in OUT.h5; OUT.csv and OUT.png are written beside it"),
        );
    }
    for beside in [&values, &figure] {
        check_file(beside, &arguments.patterns, scene)?;
    }
    let read = arguments.read_scene()?;
    if !read.states.is_empty() {
        return Err(
            CliError::bad_input("a history is that of one state of a device").help("name the state: --state NAME")
        );
    }
    let patterns = direct::patterns(&arguments.patterns.patterns, read.form())?;
    check_leads(read.leads.as_ref(), &patterns)?;
    let times = arguments.history.times(&read)?;
    let (bar, start) = (Bar::new("history", "patterns", patterns.len() as u64), Clock::now());
    let screened = Screened::for_patterns(&read, &patterns, arguments.time.work_limit())?;
    let scene = &screened.scene;
    let solver = arguments.parameters().history_solver(scene, times.clone())?;
    let (followed, displacement) = follow(&solver, &patterns, &bar)?;
    let missed = missed(
        &followed,
        arguments.parameters().accuracy().map(|accuracy| accuracy.value()),
    );
    let seconds = start.elapsed().as_secs_f64();
    let parameters = format!("{}, {}, history", arguments.described(), arguments.parameters());
    let content = histories(
        &patterns,
        scene,
        &times,
        (&followed, displacement),
        arguments.accuracy.is_some(),
    );
    let content = Histories {
        solver: format!("{{ {} }}", arguments.parameters()),
        effects: screened.effects(),
        warnings: Lines(screened.warnings_in_time.clone()),
        ..content
    };
    write_file(
        file,
        &content.object(),
        &provenance("solve", parameters.clone(), seconds),
    )?;
    let source = format!("{}; {parameters}", file.display());
    write::csv(
        &values,
        steps_table(&followed)?.as_bytes(),
        "deaflow solve --history",
        &source,
    )?;
    draw_histories(&figure, &motions(&followed), is_step(scene))?;
    bar.clear();
    let unstable = followed
        .iter()
        .filter(|one| !one.history.outcome.is_converged())
        .count();
    if output.is_json() {
        output.document(&json!({
            "file": file,
            "table": values,
            "figure": figure,
            "times": times,
            "histories": followed.iter().enumerate().map(document).collect::<Vec<_>>(),
            "unstable": unstable,
            "accuracy_missed": missed.iter().map(|(index, _)| index).collect::<Vec<_>>(),
            "warnings": screened.warnings_in_time,
            "seconds": seconds,
        }))?;
    } else {
        let mut text = Text::of(overview(&followed));
        for (_, line) in missed {
            text.line(line);
        }
        for warning in &screened.warnings_in_time {
            text.line(format!("model warning: {warning}"));
        }
        let files = [
            file.display().to_string(),
            write::with_metadata(&values),
            figure.display().to_string(),
        ];
        text.line(format!("{} in {}", files.join(", "), table::seconds(seconds)));
        output.text(text)?;
    }
    Ok(if unstable > 0 { Exit::Unstable } else { Exit::Done })
}

/// A history whose fields stand with those of all patterns: there may be gigabytes of them, and no room for two of each.
struct Followed {
    history: History,
    mesh: Mesh,
    space_error_mm: Option<f64>,
    /// The largest displacement magnitude in mm at the times that were asked for, as far as it got.
    largest: Vec<f64>,
    /// What it took.
    seconds: f64,
}

impl Followed {
    /// Moves the fields of a history to others, as so many numbers; times that it did not get to have none.
    fn of((found, seconds): (AccurateHistory, f64), numbers: usize, displacement: &mut Vec<f64>) -> Self {
        let AccurateHistory {
            mut history,
            mesh,
            space_error_mm,
        } = found;
        let fields = std::mem::take(&mut history.fields);
        let end = displacement.len() + numbers;
        for field in &fields {
            displacement.extend_from_slice(field.values());
        }
        displacement.resize(end, f64::NAN);
        Self {
            history,
            mesh,
            space_error_mm,
            largest: fields.iter().map(Field::max_magnitude).collect(),
            seconds,
        }
    }
}

/// The histories, and the displacement of all at all times.
fn follow(
    solver: &HistorySolver,
    patterns: &[Pattern],
    progress: &dyn Progress,
) -> Result<(Vec<Followed>, Vec<f64>), CliError> {
    let one = |pattern: &Pattern| -> Result<AccurateHistory, CliError> {
        let found = solver.follow(pattern)?;
        progress.advance(1);
        Ok(found)
    };
    let (threads, times) = (rayon::current_num_threads(), solver.times().len());
    let row = patterns.first().map_or(0, |pattern| 2 * pattern.raster().corners());
    let mut displacement: Vec<f64> = Vec::new();
    let all = patterns.len() * times * row;
    displacement.try_reserve_exact(all).map_err(|_| {
        let gigabytes = (all * size_of::<f64>()) as f64 / 1e9;
        CliError::failure(format!(
            "the displacement of {} patterns at {times} times takes {gigabytes:.1} GB of memory",
            patterns.len()
        ))
        .help("follow fewer patterns at a time, or a `solve` stage with a `history`: it writes them chunk by chunk")
    })?;
    let mut followed = Vec::with_capacity(patterns.len());
    for batch in patterns.chunks(threads) {
        let start = Clock::now();
        let found = batch.par_iter().map(one).collect::<Result<Vec<_>, _>>()?;
        let found = found.into_iter().zip(seconds_each(start, batch.len(), threads));
        followed.extend(found.map(|found| Followed::of(found, times * row, &mut displacement)));
    }
    Ok((followed, displacement))
}

/// The arrays, without what is said of how they were found.
fn histories(
    patterns: &[Pattern],
    scene: &Scene,
    times: &[f64],
    (followed, displacement): (&[Followed], Vec<f64>),
    with_accuracy: bool,
) -> Histories {
    let each = |value: &dyn Fn(&History, usize) -> f64| {
        let of = |one: &Followed| -> Vec<f64> {
            let history = &one.history;
            let known = history.kept.iter().map(|&at| value(history, at));
            known.chain(std::iter::repeat(f64::NAN)).take(times.len()).collect()
        };
        Packed(followed.iter().flat_map(of).collect())
    };
    let largest = followed.iter().flat_map(|one| {
        let known = one.largest.iter().copied();
        known.chain(std::iter::repeat(f64::NAN)).take(times.len())
    });
    let of_instant = |value: fn(&Instant) -> f64| each(&|history: &History, at: usize| value(&history.instants[at]));
    let currents: Vec<Vec<f64>> = followed.iter().map(|one| one.history.current()).collect();
    let current = followed.iter().zip(&currents).flat_map(|(one, currents)| {
        let known = one.history.kept.iter().map(|&at| currents[at]);
        known.chain(std::iter::repeat(f64::NAN)).take(times.len())
    });
    let brackets = |bracket: fn(&History) -> Option<[f64; 2]>| {
        followed
            .iter()
            .map(|one| bracket(&one.history).unwrap_or_default())
            .collect()
    };
    let bodies = scene.geometry.bodies.as_ref().map_or(0, Vec::len);
    let motions: Vec<Motion> = followed
        .iter()
        .flat_map(|Followed { history, .. }| {
            let none = || Motion {
                translation: [f64::NAN; 2],
                rotation: f64::NAN,
            };
            let known = history
                .asked()
                .flat_map(|instant| instant.bodies.clone().unwrap_or_default());
            known.chain(std::iter::repeat_with(none)).take(times.len() * bodies)
        })
        .collect();
    Histories {
        patterns: patterns.to_vec(),
        time: times.to_vec(),
        // A charge has none.
        voltage: times
            .iter()
            .map(|time| match scene.drive.charge {
                Some(_) => f64::NAN,
                None => scene.waveform().voltage(scene.voltage_v(), *time, Side::After),
            })
            .collect(),
        electrode_voltage: (scene.drive.source.is_some()
            || scene.drive.charge.is_some()
            || scene.effects.electrode_resistance.is_some())
        .then(|| of_instant(|instant| instant.voltage)),
        displacement: Packed(displacement),
        max_displacement: Packed(largest.collect()),
        charge: of_instant(|instant| instant.charge),
        current: Packed(current.collect()),
        stored: of_instant(|instant| instant.stored),
        electric: of_instant(|instant| instant.electric),
        kinetic: of_instant(|instant| instant.kinetic),
        dissipated: of_instant(|instant| instant.dissipated),
        supplied: of_instant(|instant| instant.supplied),
        outcome: followed
            .iter()
            .map(|one| one.history.outcome.name().to_owned())
            .collect(),
        time_bracket: brackets(|history| history.outcome.time_bracket()),
        voltage_bracket: brackets(|history| history.outcome.bracket()),
        watched_corner: followed
            .iter()
            .map(|one| one.history.watched.map(|corner| corner as u64))
            .collect(),
        error_in_time: followed
            .iter()
            .map(|one| one.history.time_error_mm.unwrap_or(f64::NAN))
            .collect(),
        body_translation: (bodies > 0).then(|| Packed(motions.iter().flat_map(|motion| motion.translation).collect())),
        body_rotation: (bodies > 0).then(|| Packed(motions.iter().map(|motion| motion.rotation).collect())),
        error_in_space: with_accuracy.then(|| {
            followed
                .iter()
                .map(|found| found.space_error_mm.unwrap_or(f64::NAN))
                .collect()
        }),
        elements_per_cell: with_accuracy.then(|| {
            followed
                .iter()
                .map(|found| found.mesh.elements_per_cell() as u64)
                .collect()
        }),
        order: with_accuracy.then(|| {
            followed
                .iter()
                .map(|found| found.mesh.order().degree() as u64)
                .collect()
        }),
        steps: followed.iter().map(|one| one.history.instants.len() as u64).collect(),
        residual: followed.iter().map(|one| one.history.residual).collect(),
        solve_seconds: followed.iter().map(|one| one.seconds).collect(),
        scene: scene.clone(),
        solver: String::new(),
        effects: String::new(),
        warnings: Lines(Vec::new()),
    }
}

/// All steps of all patterns as comma-separated values with a header.
fn steps_table(followed: &[Followed]) -> Result<String, CliError> {
    let header = [
        "pattern",
        "time_s",
        "voltage_V",
        "max_displacement_mm",
        "watched_displacement_mm",
        "charge_C",
        "current_A",
        "stored_J",
        "electric_J",
        "kinetic_J",
        "dissipated_J",
        "supplied_J",
    ];
    let rows = followed
        .iter()
        .enumerate()
        .flat_map(|(pattern, Followed { history, .. })| {
            let current = history.current();
            let row = move |(at, instant): (usize, &Instant)| {
                let numbers = [
                    instant.time,
                    instant.voltage,
                    instant.largest,
                    instant.watched,
                    instant.charge,
                    current[at],
                    instant.stored,
                    instant.electric,
                    instant.kinetic,
                    instant.dissipated,
                    instant.supplied,
                ];
                let numbers = numbers.iter().map(ToString::to_string);
                std::iter::once(pattern.to_string()).chain(numbers).collect()
            };
            history
                .instants
                .iter()
                .enumerate()
                .map(row)
                .collect::<Vec<Vec<String>>>()
        });
    csv::text(&header.map(str::to_owned), rows)
}

fn motions(followed: &[Followed]) -> Vec<figures::Motion> {
    let motion = |(index, Followed { history, .. }): (usize, &Followed)| figures::Motion {
        name: format!("pattern {index}"),
        time: history.instants.iter().map(|instant| instant.time).collect(),
        displacement: history.instants.iter().map(|instant| instant.watched).collect(),
        end: (!history.outcome.is_converged()).then(|| history.outcome.name().to_owned()),
    };
    followed.iter().enumerate().map(motion).collect()
}

/// Rows that people are shown; of more than that each pattern has one, of its last time.
const MOST_ROWS: usize = 30;

/// One line for each time of each pattern; where these are too many, one for each pattern.
fn overview(followed: &[Followed]) -> table::Table {
    let header = [
        "pattern",
        "outcome",
        "time",
        "displacement",
        "error in time",
        "error in space",
        "steps",
    ];
    let mut table = table::table(
        &header,
        &["time", "displacement", "error in time", "error in space", "steps"],
    )
    .dispensable(&["steps", "error in space", "error in time"]);
    let are_all = followed.iter().map(|one| one.largest.len()).sum::<usize>() <= MOST_ROWS;
    for (
        index,
        Followed {
            history,
            space_error_mm,
            largest,
            ..
        },
    ) in followed.iter().enumerate()
    {
        let each = || history.asked().zip(largest);
        let at = |time: f64| format!("{} s", rounded(time));
        let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
        let before = match are_all {
            true => largest.len().saturating_sub(1),
            false => 0,
        };
        for (instant, largest) in each().take(before) {
            let [none, more, others, steps] = [(); 4].map(|()| String::new());
            let moved = format!("{largest:.4} mm");
            table.add_row([index.to_string(), none, at(instant.time), moved, more, others, steps]);
        }
        let last = each().last();
        table.add_row([
            index.to_string(),
            history.outcome.to_string(),
            or_dash(last.map(|(instant, _)| at(instant.time))),
            or_dash(last.map(|(_, largest)| format!("{largest:.4} mm"))),
            or_dash(history.time_error_mm.map(|error| format!("{error:.1e} mm"))),
            or_dash(space_error_mm.map(|error| format!("{error:.1e} mm"))),
            history.instants.len().to_string(),
        ]);
    }
    table
}

/// The patterns whose errors are larger than was asked for, with what is said of them.
fn missed(followed: &[Followed], accuracy_mm: Option<f64>) -> Vec<(usize, String)> {
    let Some(accuracy) = accuracy_mm else {
        return imprecise(followed);
    };
    let line = |(index, found): (usize, &Followed)| {
        let [time, space] = [found.history.time_error_mm, found.space_error_mm]
            .map(|error| error.filter(|error| found.history.outcome.is_converged() && *error > accuracy));
        let said = [
            time.map(|error| format!("steps in time leave an estimated error of {error:.2e} mm")),
            space.map(|error| format!("the finest mesh leaves an estimated error of {error:.2e} mm")),
        ];
        let said: Vec<String> = said.into_iter().flatten().collect();
        let line = format!("pattern {index}: {}, more than was asked for", said.join(", "));
        (!said.is_empty()).then_some((index, line))
    };
    followed.iter().enumerate().filter_map(line).collect()
}

/// The patterns whose error in time is larger than is usual, where none was asked for.
fn imprecise(followed: &[Followed]) -> Vec<(usize, String)> {
    let line = |(index, found): (usize, &Followed)| {
        let history = &found.history;
        let largest = found.largest.iter().copied().fold(0.0, f64::max);
        let (error, usual) = (history.time_error_mm?, USUAL_TIME_ERROR * largest);
        let line = format!(
            "pattern {index}: steps in time leave an estimated error of {error:.1e} mm, more than the usual {usual:.1e} mm"
        );
        (history.outcome.is_converged() && error > BEYOND * usual).then_some((index, line))
    };
    followed.iter().enumerate().filter_map(line).collect()
}

/// A time with six digits.
fn rounded(time: f64) -> f64 {
    format!("{time:.5e}").parse().unwrap_or(time)
}

fn document((index, found): (usize, &Followed)) -> Value {
    let history = &found.history;
    json!({
        "index": index,
        "outcome": history.outcome.name(),
        "time_bracket": history.outcome.time_bracket(),
        "voltage_bracket": history.outcome.bracket(),
        "max_displacement": found.largest,
        "charge": history.asked().map(|instant| instant.charge).collect::<Vec<_>>(),
        "watched_corner": history.watched,
        "error_in_time": history.time_error_mm,
        "error_in_space": found.space_error_mm,
        "elements_per_cell": found.mesh.elements_per_cell(),
        "order": found.mesh.order().degree(),
        "steps": history.instants.len(),
        "newton_iterations": history.newton_steps,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_in_any_order_and_unit() {
        assert_eq!(times("10 s, 0 s,1 min, 0.5"), Ok(Times(vec![0.0, 0.5, 10.0, 60.0])));
        for refused in ["", "1 V", "-1 s", "1 s,,2 s", "2e12 s"] {
            assert!(times(refused).is_err(), "{refused}");
        }
    }
}
