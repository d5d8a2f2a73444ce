//! `deaflow solve --history`: the motion of patterns in time.

use clap::Args;
use serde_json::{Value, json};

use super::SolveArguments;
use super::simulation::{Computation, Form, PatternSolver, Simulation, States};
use crate::arguments::quantity;
use crate::job::{Attachments, JobResult, extend};
use crate::point::Probe;
use crate::side_results::SideResults;
use crate::text::Text;
use crate::{CliError, Exit, Output, csv, table};
use deaflow_base::{Dimension, Time, error_digits, four_digits, rounded_by};
use deaflow_content::{DrawnElectrodes, Histories, Lines, Packed, rotations, translations};
use deaflow_fem::screening::{ScreenedScene, TestPattern};
use deaflow_fem::{AccurateHistory, History, Instant, USUAL_TIME_ERROR};
use deaflow_field::{Field, Mesh, Motion};
use deaflow_pattern::Pattern;
use deaflow_report::figures::{self, histories_sheet};
use deaflow_scene::{Scene, Side};

/// The latest time, s.
const LATEST: f64 = 1e12;
/// The largest number of output times.
const MAX_TIMES: usize = 10_000;
/// An error in time is reported from this multiple of the usual one.
const REPORTED_ERROR: f64 = 1.5;

/// The heading of options about vibration and time.
pub const TIME: &str = "In time";

#[derive(Clone, Debug, Args)]
pub struct HistoryArguments {
    /// Simulate each pattern over the time of the drive; OUT.csv and OUT.png are written next to OUT.h5
    #[arg(long, conflicts_with_all = ["path", "cells"], help_heading = TIME)]
    pub history: bool,
    /// Output times, as in "0 s, 1 s, 10 min"; 0 s is just after the start of the drive [default: 25 times up to
    /// `drive.duration`]
    #[arg(long, value_name = "TIMES", requires = "history", value_parser = times, help_heading = TIME)]
    at: Option<Times>,
    /// Interval between output times, up to `drive.duration`
    #[arg(
        long,
        value_name = "TIME",
        requires = "history",
        conflicts_with = "at",
        value_parser = time,
        help_heading = TIME
    )]
    every: Option<Time>,
}

/// Times in s, in order.
#[derive(Clone, Debug, PartialEq)]
struct Times(Vec<f64>);

fn time(text: &str) -> Result<Time, String> {
    match Time::from_f64(quantity(text, Dimension::Time)?.value()) {
        Some(time) if (1e-12..=LATEST).contains(&time.value()) => Ok(time),
        _ => Err(format!("allowed: 1e-12 s to {LATEST:e} s")),
    }
}

fn times(text: &str) -> Result<Times, String> {
    let mut times = Vec::new();
    for part in text.split(',') {
        let time = quantity(part, Dimension::Time)?.value();
        if !(0.0..=LATEST).contains(&time) {
            return Err(format!("{part}: allowed: 0 s to {LATEST:e} s"));
        }
        times.push(time);
    }
    times.sort_by(f64::total_cmp);
    times.dedup();
    if times.len() > MAX_TIMES {
        return Err(format!("allowed: at most {MAX_TIMES} times"));
    }
    Ok(Times(times))
}

impl HistoryArguments {
    /// Returns the requested output times.
    fn times(&self) -> OutputTimes {
        OutputTimes {
            at: self.at.clone(),
            every: self.every,
        }
    }
}

/// The output times of a history: given ones, or multiples of an interval up to the end of the drive; by default 25
/// times up to the end.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OutputTimes {
    at: Option<Times>,
    every: Option<Time>,
}

impl OutputTimes {
    /// Returns given times, as in "0 s, 1 s, 10 min".
    ///
    /// # Errors
    /// When one is not a time, or out of range, or there are too many.
    pub fn at(text: &str) -> Result<Self, String> {
        Ok(Self {
            at: Some(times(text)?),
            every: None,
        })
    }

    /// Returns the multiples of an interval, as in "10 s".
    ///
    /// # Errors
    /// When it is not a time, or out of range.
    pub fn every(text: &str) -> Result<Self, String> {
        Ok(Self {
            at: None,
            every: Some(time(text)?),
        })
    }

    /// Returns the times for a scene in s, in order.
    ///
    /// # Errors
    /// When they depend on the duration of the drive, and it has none or they do not fit into it.
    fn of(&self, scene: &Scene) -> Result<Vec<f64>, CliError> {
        let duration = scene.drive.duration.as_ref();
        if let Some(Times(times)) = &self.at {
            let beyond = |duration: &&Time| times.last().is_some_and(|last| *last > duration.value() * (1.0 + 1e-9));
            if let Some(duration) = duration.filter(beyond) {
                let last = rounded(times.last().copied().unwrap_or_default());
                let message = format!("--at {last} s is after the end of the drive, whose `duration` is {duration}");
                return Err(CliError::bad_input(message).help(format!(
                    "give earlier times, or a longer one: --set drive.duration=\"{last} s\""
                )));
            }
            return Ok(times.clone());
        }
        let Some(duration) = duration.map(|duration| duration.value()) else {
            return Err(
                CliError::bad_input("a history needs an end time: the drive has no `duration`")
                    .help("give the times, as in --at \"0 s, 1 s, 10 s\", or add `duration` to the drive"),
            );
        };
        let Some(every) = &self.every else {
            return Ok(default_times(scene, duration));
        };
        if every.value() > duration {
            return Err(CliError::bad_input(format!(
                "--every {every} is longer than the duration of the drive, {duration} s"
            ))
            .help("use a shorter interval, or --at"));
        }
        let count = (duration / every.value() * (1.0 + 1e-12)).floor();
        if count >= MAX_TIMES as f64 {
            return Err(
                CliError::bad_input(format!("--every {every} results in {count:.0} times"))
                    .help(format!("at most {MAX_TIMES} are allowed; --at selects times")),
            );
        }
        let base = every.base();
        // Multiples, rounded: sums of rounded numbers would look odd.
        let multiple = |k: u64| (k as f64 * every.value() * 1e12).round() / 1e12;
        let exact = |k: u64| {
            if base.to_f64() >= 1e-9 {
                multiple(k)
            } else {
                k as f64 * every.value()
            }
        };
        let mut times: Vec<f64> = (0..=count as u64).map(exact).collect();
        // The end is always included.
        if times.last().is_some_and(|last| *last < duration * (1.0 - 1e-9)) {
            times.push(duration);
        }
        Ok(times)
    }
}

/// The default times: 25 up to the end, over three decades for a step of the voltage, otherwise evenly spaced.
fn default_times(scene: &Scene, duration: f64) -> Vec<f64> {
    const COUNT: i32 = 24;
    let fraction = |k: i32| f64::from(k) / f64::from(COUNT);
    let time = |k: i32| match (k, is_step(scene)) {
        (0, _) => 0.0,
        (_, true) => duration * 10f64.powf(3.0 * (fraction(k) - 1.0)),
        (_, false) => duration * fraction(k),
    };
    (0..=COUNT).map(time).collect()
}

fn is_step(scene: &Scene) -> bool {
    scene.waveform().step.is_some()
}

pub const FORM: Form = Form {
    name: "history",
    has_attachments: true,
    states: States::Chosen("a history"),
    without_covered_cells: Some("a history"),
    without_pressure: Some("`--history`"),
};

/// Simulates patterns in time.
///
/// # Errors
/// When a file would be lost, the scene or a pattern cannot be used, or a file cannot be written.
pub fn execute(arguments: &SolveArguments, output: &Output) -> Result<Exit, CliError> {
    let simulation = Simulation::read(arguments, &FORM)?;
    let probe = arguments.point.on(&simulation.scene)?;
    let times = arguments.history.times();
    let SimulatedHistories { followed, content } =
        SimulatedHistories::follow(&simulation.computation(), &times, probe.as_ref())?;
    let accuracy = simulation.parameters.accuracy();
    let missed = missed(&followed, accuracy.map(|accuracy| accuracy.value()));
    let mut text = Text::of(overview(&followed, probe.as_ref()));
    for line in sides(&followed).iter().chain(missed.iter().map(|(_, line)| line)) {
        text.line(line);
    }
    let is_unstable = |one: &&PatternHistory| !one.history.outcome.is_converged();
    let unstable = followed.iter().filter(is_unstable).count();
    let (curves, is_step) = (curves(&followed, probe.as_ref()), is_step(&content.scene));
    let (times, warnings) = (content.time.clone(), content.warnings.0.clone());
    let mut found = json!({
        "times": times,
        "histories": followed.iter().enumerate().map(document).collect::<Vec<_>>(),
        "unstable": unstable,
        "accuracy_missed": missed.iter().map(|(index, _)| index).collect::<Vec<_>>(),
    });
    if let Some(probe) = &probe {
        found["along"] = probe.document();
    }
    let result = JobResult {
        patterns: followed.len(),
        arrays: content.object(),
        parameters: simulation.described(", history"),
        attachments: Some(Attachments {
            title: "deaflow solve --history",
            table: steps_table(&followed, probe.is_some())?,
            draw: Box::new(move |figure| histories_sheet(&curves, is_step)?.write_png(figure)),
        }),
        document: found,
        warnings,
        text,
        exit: if unstable > 0 { Exit::Unstable } else { Exit::Done },
    };
    simulation.finish(result, output)
}

/// The histories of patterns.
pub struct SimulatedHistories {
    followed: Vec<PatternHistory>,
    /// The arrays.
    pub content: Histories,
}

impl SimulatedHistories {
    /// Simulates the drive of each pattern in time; the displacement of a point is wanted too, if one is given.
    ///
    /// # Errors
    /// When the times do not fit the drive, a pattern cannot be simulated, or memory is short.
    pub fn follow(computation: &Computation<'_>, times: &OutputTimes, probe: Option<&Probe>) -> Result<Self, CliError> {
        let times = times.of(computation.scene)?;
        let parameters = computation.parameters;
        let tests = TestPattern::some_of(computation.patterns, "pattern");
        let mut screened = ScreenedScene::for_patterns(computation.scene, &tests, parameters.work_limit())?;
        screened.warnings_in_time.extend(screened.breakdown_warning.take());
        let set_up = |scene: &Scene| parameters.history_solver(scene, times.clone());
        let solver = PatternSolver::new(&screened.scene, set_up)?;
        let simulate = |pattern: &Pattern| Ok(solver.with(pattern, |solver| solver.follow(pattern))??);
        let (followed, displacement) = follow(computation, times.len(), probe, simulate)?;
        let content = histories(computation, screened, times, &followed, displacement);
        let at_point = followed.iter().flat_map(|one| {
            let known = one.at_point.iter().flatten().copied();
            known.chain(std::iter::repeat(f64::NAN)).take(content.time.len())
        });
        let at_point = probe.map(|_| Packed(at_point.collect()));
        Ok(Self {
            content: Histories {
                at_point,
                point: probe.map(Probe::described),
                ..content
            },
            followed,
        })
    }
}

/// A history without its fields: these are moved into one array, since there may be gigabytes of them.
struct PatternHistory {
    history: History,
    mesh: Mesh,
    space_error_mm: Option<f64>,
    /// The largest displacement magnitude from rest in mm at the output times that were reached.
    largest: Vec<f64>,
    /// The displacement of the requested point from rest in mm at these times.
    at_point: Option<Vec<f64>>,
    /// What the sides do at the end, if not all are held.
    sides: Option<SideResults>,
    /// Computing time, s.
    seconds: f64,
}

impl PatternHistory {
    /// Moves the fields of a history to the end of `displacement`, filled up with NaN to so many `numbers`.
    fn new(
        (found, seconds): (AccurateHistory, f64),
        (scene, probe): (&Scene, Option<&Probe>),
        numbers: usize,
        displacement: &mut Vec<f64>,
    ) -> Self {
        let AccurateHistory {
            mut history,
            mesh,
            space_error_mm,
        } = found;
        let sides = SideResults::of(scene, &history.last_state());
        let strokes = history.strokes();
        let largest = strokes.iter().map(Field::max_magnitude).collect();
        let at_point = probe.map(|probe| strokes.iter().map(|field| probe.of(field)).collect());
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
            largest,
            at_point,
            sides,
            seconds,
        }
    }
}

/// Simulates the histories; returns them, and the displacement of all at all times.
fn follow(
    computation: &Computation<'_>,
    times: usize,
    probe: Option<&Probe>,
    history: impl Fn(&Pattern) -> Result<AccurateHistory, CliError> + Sync,
) -> Result<(Vec<PatternHistory>, Vec<f64>), CliError> {
    let patterns = computation.patterns.len();
    let numbers = times * 2 * computation.scene.membrane().raster.corners();
    let mut displacement: Vec<f64> = Vec::new();
    displacement.try_reserve_exact(patterns * numbers).map_err(|_| {
        let gigabytes = (patterns * numbers * size_of::<f64>()) as f64 / 1e9;
        CliError::failure(format!(
            "the displacement of {patterns} patterns at {times} times takes {gigabytes:.1} GB of memory"
        ))
        .help("simulate fewer patterns at once, or use a `solve` stage with a `history`, which writes them in chunks")
    })?;
    let mut followed = Vec::with_capacity(patterns);
    computation.run(history, |found, seconds| {
        followed.push(PatternHistory::new(
            (found, seconds),
            (computation.scene, probe),
            numbers,
            &mut displacement,
        ));
    })?;
    Ok((followed, displacement))
}

/// The arrays of all histories.
fn histories(
    computation: &Computation<'_>,
    screened: ScreenedScene,
    times: Vec<f64>,
    followed: &[PatternHistory],
    displacement: Vec<f64>,
) -> Histories {
    let scene = &screened.scene;
    let padded = |known: &mut dyn Iterator<Item = f64>| -> Vec<f64> {
        known.chain(std::iter::repeat(f64::NAN)).take(times.len()).collect()
    };
    let at_times = |value: &dyn Fn(&History, usize) -> f64| {
        let of = |one: &PatternHistory| padded(&mut one.history.kept.iter().map(|&at| value(&one.history, at)));
        Packed(followed.iter().flat_map(of).collect())
    };
    let of_instant = |value: fn(&Instant) -> f64| at_times(&|history, at| value(&history.instants[at]));
    let current = followed.iter().flat_map(|one| {
        let current = one.history.current();
        padded(&mut one.history.kept.iter().map(|&at| current[at]))
    });
    let each = |value: &dyn Fn(&PatternHistory) -> f64| followed.iter().map(value).collect::<Vec<f64>>();
    let count = |value: &dyn Fn(&PatternHistory) -> usize| followed.iter().map(|one| value(one) as u64).collect();
    let bracket = |bracket: fn(&History) -> Option<[f64; 2]>| {
        let of = |one: &PatternHistory| bracket(&one.history).unwrap_or_default();
        followed.iter().map(of).collect()
    };
    let bodies = scene.geometry.bodies.as_ref().map_or(0, Vec::len);
    let bars = scene.geometry.sides.as_ref().map_or(0, |sides| sides.bars().count());
    let body_motions = motions(followed, times.len() * bodies, |instant| instant.bodies.as_ref());
    let bar_motions = motions(followed, times.len() * bars, |instant| instant.bars.as_ref());
    let with_accuracy = computation.parameters.accuracy().is_some();
    let has_electrode_voltage =
        scene.drive.source.is_some() || scene.drive.charge.is_some() || scene.effects.electrode_resistance.is_some();
    let drive_voltage = |time: &f64| match scene.drive.charge {
        Some(_) => f64::NAN,
        None => scene.waveform().voltage(scene.voltage_v(), *time, Side::After),
    };
    Histories {
        patterns: computation.patterns.to_vec(),
        electrodes: DrawnElectrodes::of(computation.patterns),
        voltage: times.iter().map(drive_voltage).collect(),
        electrode_voltage: has_electrode_voltage.then(|| of_instant(|instant| instant.voltage)),
        displacement: Packed(displacement),
        max_displacement: Packed(
            followed
                .iter()
                .flat_map(|one| padded(&mut one.largest.iter().copied()))
                .collect(),
        ),
        at_point: None,
        point: None,
        charge: of_instant(|instant| instant.charge),
        current: Packed(current.collect()),
        stored: of_instant(|instant| instant.stored),
        electric: of_instant(|instant| instant.electric),
        kinetic: of_instant(|instant| instant.kinetic),
        dissipated: of_instant(|instant| instant.dissipated),
        supplied: of_instant(|instant| instant.supplied),
        outcome: followed.iter().map(|one| one.history.outcome.kind()).collect(),
        time_bracket: bracket(|history| history.outcome.time_bracket()),
        voltage_bracket: bracket(|history| history.outcome.bracket()),
        watched_corner: followed
            .iter()
            .map(|one| one.history.watched.map(|corner| corner as u64))
            .collect(),
        error_in_time: each(&|one| one.history.time_error_mm.unwrap_or(f64::NAN)),
        body_translation: (bodies > 0).then(|| translations(&body_motions)),
        body_rotation: (bodies > 0).then(|| rotations(&body_motions)),
        bar_translation: (bars > 0).then(|| translations(&bar_motions)),
        bar_rotation: (bars > 0).then(|| rotations(&bar_motions)),
        rest: scene.geometry.sides.is_some().then(|| Packed(at_rest(scene, followed))),
        error_in_space: with_accuracy.then(|| each(&|one| one.space_error_mm.unwrap_or(f64::NAN))),
        elements_per_cell: with_accuracy.then(|| count(&|one| one.mesh.elements_per_cell())),
        order: with_accuracy.then(|| count(&|one| one.mesh.order().degree())),
        steps: count(&|one| one.history.instants.len()),
        residual: each(&|one| one.history.residual),
        solve_seconds: each(&|one| one.seconds),
        scene: scene.clone(),
        solver: computation.solver(),
        effects: scene.effects.clone(),
        warnings: Lines(screened.warnings_in_time),
        time: times,
    }
}

/// The displacements before the drive of all patterns, NaN where there is no stable state.
fn at_rest(scene: &Scene, followed: &[PatternHistory]) -> Vec<f64> {
    let numbers = 2 * scene.membrane().raster.corners();
    let of = |one: &PatternHistory| match &one.history.rest {
        Some(rest) => rest.values().to_vec(),
        None => vec![f64::NAN; numbers],
    };
    followed.iter().flat_map(of).collect()
}

/// The motions of the bodies or bars of all patterns, filled up with NaN to so many for each pattern.
fn motions(
    followed: &[PatternHistory],
    count: usize,
    of_instant: impl Fn(&Instant) -> Option<&Vec<Motion>>,
) -> Vec<Motion> {
    let missing = || Motion {
        translation: [f64::NAN; 2],
        rotation: f64::NAN,
    };
    let of = |PatternHistory { history, .. }: &PatternHistory| {
        let known = history
            .asked()
            .flat_map(|instant| of_instant(instant).cloned().unwrap_or_default());
        known
            .chain(std::iter::repeat_with(missing))
            .take(count)
            .collect::<Vec<_>>()
    };
    followed.iter().flat_map(of).collect()
}

/// Returns all steps of all patterns as comma-separated values with a header. The displacement of a requested point is
/// known at the output times only.
fn steps_table(followed: &[PatternHistory], has_point: bool) -> Result<String, CliError> {
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
        .flat_map(|(pattern, PatternHistory { history, at_point, .. })| {
            let current = history.current();
            let of_point = move |step: usize| {
                let known = history.kept.iter().zip(at_point.iter().flatten());
                let mut known = known.filter(|(at, _)| **at == step);
                known.next().map_or_else(String::new, |(_, mm)| mm.to_string())
            };
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
                let point = has_point.then(|| of_point(at));
                std::iter::once(pattern.to_string())
                    .chain(numbers)
                    .chain(point)
                    .collect()
            };
            history
                .instants
                .iter()
                .enumerate()
                .map(row)
                .collect::<Vec<Vec<String>>>()
        });
    let header = header.into_iter().chain(has_point.then_some("point_displacement_mm"));
    csv::text(&header.map(str::to_owned).collect::<Vec<_>>(), rows)
}

/// Returns the curves of the points that move most, or those of the requested point.
fn curves(followed: &[PatternHistory], probe: Option<&Probe>) -> Vec<figures::Motion> {
    if let Some(probe) = probe {
        let motion = |(index, one): (usize, &PatternHistory)| figures::Motion {
            name: format!("pattern {index}"),
            place: Some(probe.title_from_rest()),
            time: one.history.asked().map(|instant| instant.time).collect(),
            displacement: one.at_point.clone().unwrap_or_default(),
            end: (!one.history.outcome.is_converged()).then(|| one.history.outcome.name().to_owned()),
        };
        return followed.iter().enumerate().map(motion).collect();
    }
    let motion = |(index, PatternHistory { history, .. }): (usize, &PatternHistory)| figures::Motion {
        name: format!("pattern {index}"),
        place: None,
        time: history.instants.iter().map(|instant| instant.time).collect(),
        displacement: history.instants.iter().map(|instant| instant.watched).collect(),
        end: (!history.outcome.is_converged()).then(|| history.outcome.name().to_owned()),
    };
    followed.iter().enumerate().map(motion).collect()
}

/// The most rows in the report; with more, each pattern has one row, for its last time.
const MAX_ROWS: usize = 30;

/// Lists the patterns with their output times, or with the last one only if these are too many.
fn overview(followed: &[PatternHistory], probe: Option<&Probe>) -> table::Table {
    let title = probe.map(Probe::title_from_rest);
    let mut header = vec!["pattern", "outcome", "time", "displacement"];
    header.extend(title.as_deref());
    header.extend(["error in time", "error in space", "steps"]);
    let mut table = table::table(&header, &header[2..]).dispensable(&["steps", "error in space", "error in time"]);
    let are_all = followed.iter().map(|one| one.largest.len()).sum::<usize>() <= MAX_ROWS;
    for (
        index,
        PatternHistory {
            history,
            space_error_mm,
            largest,
            at_point,
            ..
        },
    ) in followed.iter().enumerate()
    {
        let of_point = |at: usize| Some(at_point.as_ref()?.get(at).copied());
        let each = || history.asked().zip(largest).enumerate();
        let error = known_error_mm(history.time_error_mm, *space_error_mm);
        let displacement = |mm: f64| match error {
            Some(error) => format!("{} mm", rounded_by(mm, error)),
            None => format!("{} mm", four_digits(mm)),
        };
        let at = |time: f64| format!("{} s", rounded(time));
        let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
        let before = match are_all {
            true => largest.len().saturating_sub(1),
            false => 0,
        };
        let row = |outcome: String, place: Option<(usize, (&Instant, &f64))>| {
            let mut row = vec![
                index.to_string(),
                outcome,
                or_dash(place.map(|(_, (instant, _))| at(instant.time))),
                or_dash(place.map(|(_, (_, largest))| displacement(*largest))),
            ];
            let point = of_point(place.map_or(usize::MAX, |(at, _)| at));
            row.extend(point.map(|mm| or_dash(mm.map(displacement))));
            row
        };
        for place in each().take(before) {
            let mut row = row(String::new(), Some(place));
            row.extend([(); 3].map(|()| String::new()));
            table.add_row(row);
        }
        let mut row = row(history.outcome.to_string(), each().last());
        row.extend([
            or_dash(history.time_error_mm.map(|error| format!("{} mm", error_digits(error)))),
            or_dash(space_error_mm.map(|error| format!("{} mm", error_digits(error)))),
            history.instants.len().to_string(),
        ]);
        table.add_row(row);
    }
    table
}

/// Returns the error by which displacements are rounded, in mm. Without an error of the mesh it is so large that there
/// are no more than four decimals.
fn known_error_mm(time: Option<f64>, space: Option<f64>) -> Option<f64> {
    const UNKNOWN_MM: f64 = 1e-3;
    match (time, space) {
        (time, Some(space)) => Some(time.unwrap_or(0.0) + space),
        (Some(time), None) => Some(time.max(UNKNOWN_MM)),
        (None, None) => None,
    }
}

/// Describes what sides that are not held do at the end.
fn sides(followed: &[PatternHistory]) -> Vec<String> {
    let of = |(index, one): (usize, &PatternHistory)| {
        let time = one.history.asked().last().map_or(0.0, |instant| rounded(instant.time));
        let lines = one.sides.iter().flat_map(SideResults::lines);
        lines
            .map(|line| format!("pattern {index} at {time} s: {line}"))
            .collect::<Vec<_>>()
    };
    followed.iter().enumerate().flat_map(of).collect()
}

/// Describes the patterns whose errors are larger than requested.
fn missed(followed: &[PatternHistory], accuracy_mm: Option<f64>) -> Vec<(usize, String)> {
    let Some(accuracy) = accuracy_mm else {
        return imprecise(followed);
    };
    let line = |(index, found): (usize, &PatternHistory)| {
        let [time, space] = [found.history.time_error_mm, found.space_error_mm]
            .map(|error| error.filter(|error| found.history.outcome.is_converged() && *error > accuracy));
        let errors = [
            time.map(|error| format!("estimated error of the time steps {} mm", error_digits(error))),
            space.map(|error| format!("estimated error of the finest mesh {} mm", error_digits(error))),
        ];
        let errors: Vec<String> = errors.into_iter().flatten().collect();
        let line = format!(
            "pattern {index}: the requested accuracy is not reached: {}",
            errors.join(", ")
        );
        (!errors.is_empty()).then_some((index, line))
    };
    followed.iter().enumerate().filter_map(line).collect()
}

/// Describes the patterns whose error in time is larger than usual.
fn imprecise(followed: &[PatternHistory]) -> Vec<(usize, String)> {
    let line = |(index, found): (usize, &PatternHistory)| {
        let history = &found.history;
        let largest = found.largest.iter().copied().fold(0.0, f64::max);
        let (error, usual) = (history.time_error_mm?, USUAL_TIME_ERROR * largest);
        let line = format!(
            "pattern {index}: the estimated error of the time steps, {} mm, exceeds the usual {} mm",
            error_digits(error),
            error_digits(usual)
        );
        (history.outcome.is_converged() && error > REPORTED_ERROR * usual).then_some((index, line))
    };
    followed.iter().enumerate().filter_map(line).collect()
}

/// Rounds a time to six digits.
fn rounded(time: f64) -> f64 {
    format!("{time:.5e}").parse().unwrap_or(time)
}

fn document((index, found): (usize, &PatternHistory)) -> Value {
    let history = &found.history;
    let mut own = json!({
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
    });
    if let Some(mm) = &found.at_point {
        own["along_mm"] = json!(mm);
    }
    if let Some(sides) = &found.sides {
        extend(&mut own, sides.document());
    }
    own
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
