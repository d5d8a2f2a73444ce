//! `deaflow solve --response`: the response of patterns to a small alternating voltage about their equilibria.

use clap::Args;
use serde_json::{Value, json};

use super::SolveArguments;
use super::history::TIME;
use super::simulation::{Computation, Form, PatternSolver, Simulation, States};
use crate::arguments::{integer, quantity};
use crate::job::{Attachments, JobResult};
use crate::text::Text;
use crate::{CliError, Exit, Output, csv, model_warnings, table};
use deaflow_base::{Dimension, four_digits, with_minus};
use deaflow_content::{DrawnElectrodes, FrequencyResponses, Lines, Packed};
use deaflow_fem::screening::resolve;
use deaflow_fem::{AtFrequency, FrequencyResponse, FrequencySolver, SetupError, at_bias};
use deaflow_field::Field;
use deaflow_pattern::Pattern;
use deaflow_report::figures::{self, responses_sheet};
use deaflow_scene::Scene;

/// The allowed frequencies, Hz.
const LOWEST: f64 = 1e-9;
const HIGHEST: f64 = 1e9;
/// The number of frequencies: default and maximum.
const DEFAULT_POINTS: u64 = 100;
const MAX_POINTS: u64 = 10_000;
/// The largest size of the responses in bytes.
const MAX_BYTES: f64 = (2u64 << 30) as f64;

#[derive(Clone, Debug, Args)]
pub struct ResponseArguments {
    /// Find the response of each pattern to a small alternating voltage about its equilibrium, at frequencies from A to
    /// B, as in "1Hz:1kHz"; OUT.csv and OUT.png are written next to OUT.h5
    #[arg(
        long,
        value_name = "A:B",
        value_parser = FrequencyRange::parse,
        conflicts_with_all = ["path", "cells", "accuracy", "history", "modes", "lumped", "at", "every"],
        help_heading = TIME
    )]
    pub response: Option<FrequencyRange>,
    /// Number of frequencies, logarithmically spaced [default: 100]
    #[arg(
        long,
        value_name = "N",
        requires = "response",
        value_parser = integer::<u64>(2..=MAX_POINTS),
        help_heading = TIME
    )]
    points: Option<u64>,
}

/// The lowest and the highest frequency in Hz.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrequencyRange([f64; 2]);

impl FrequencyRange {
    fn parse(text: &str) -> Result<Self, String> {
        let Some((first, last)) = text.split_once(':') else {
            return Err("expected the lowest and the highest frequency, as in 1Hz:1kHz".to_owned());
        };
        let frequency = |text: &str| allowed(quantity(text, Dimension::Frequency)?.value(), text);
        let ends = [frequency(first)?, frequency(last)?];
        match ends[0] < ends[1] {
            true => Ok(Self(ends)),
            false => Err(format!("{first} is not less than {last}")),
        }
    }

    /// Returns frequencies in Hz, logarithmically spaced, including both ends.
    fn frequencies(self, points: u64) -> Vec<f64> {
        let Self([first, last]) = self;
        // 10 Hz, not 9.999999999999998 Hz.
        let rounded = |value: f64| format!("{value:.12e}").parse().unwrap_or(value);
        let inner = (1..points - 1).map(|k| rounded(first * (last / first).powf(k as f64 / (points - 1) as f64)));
        std::iter::once(first).chain(inner).chain([last]).collect()
    }
}

/// Returns a frequency in Hz that is allowed.
fn allowed(frequency: f64, text: &str) -> Result<f64, String> {
    match (LOWEST..=HIGHEST).contains(&frequency) {
        true => Ok(frequency),
        false => Err(format!("{text}: allowed: {LOWEST:e} Hz to {HIGHEST:e} Hz")),
    }
}

/// The frequencies of responses in Hz.
#[derive(Clone, Debug, PartialEq)]
pub struct Frequencies(Vec<f64>);

impl Frequencies {
    /// Returns frequencies between two ends, as in "1Hz:1kHz", logarithmically spaced; 100 by default.
    ///
    /// # Errors
    /// When an end or the number is out of range.
    pub fn between(ends: &str, points: Option<u64>) -> Result<Self, String> {
        let points = points.unwrap_or(DEFAULT_POINTS);
        if !(2..=MAX_POINTS).contains(&points) {
            return Err(format!("{points} frequencies: allowed: 2 to {MAX_POINTS}"));
        }
        Ok(Self(FrequencyRange::parse(ends)?.frequencies(points)))
    }

    /// Returns given frequencies in Hz.
    ///
    /// # Errors
    /// When there are none or too many, or one is out of range.
    pub fn of(hertz: &[f64]) -> Result<Self, String> {
        if !(1..=MAX_POINTS as usize).contains(&hertz.len()) {
            return Err(format!("{} frequencies: allowed: 1 to {MAX_POINTS}", hertz.len()));
        }
        let each = hertz
            .iter()
            .map(|frequency| allowed(*frequency, &format!("{frequency} Hz")));
        Ok(Self(each.collect::<Result<_, _>>()?))
    }
}

/// The voltage drives a flat membrane in its plane only.
const OUT_OF_PLANE: &str = "the response is that in the plane; `--modes` lists natural frequencies out of the plane, \
                            which sound or a shaker excites";

pub const FORM: Form = Form {
    name: "response",
    has_attachments: true,
    states: States::Chosen("a frequency response"),
    without_covered_cells: Some("a frequency response"),
    without_pressure: Some("`--response`"),
};

/// Finds frequency responses.
///
/// # Errors
/// When a file would be lost, the scene or a pattern cannot be used, or a file cannot be written.
pub fn execute(arguments: &SolveArguments, range: FrequencyRange, output: &Output) -> Result<Exit, CliError> {
    let simulation = Simulation::read(arguments, &FORM)?;
    let frequencies = Frequencies(range.frequencies(arguments.response.points.unwrap_or(DEFAULT_POINTS)));
    let Responses {
        found,
        motions,
        content,
        warnings,
    } = Responses::find(&simulation.computation(), &frequencies)?;
    let Frequencies(frequencies) = frequencies;
    let documents = found.iter().zip(&motions).enumerate();
    let documents = documents.map(|(index, (one, motion))| document(index, one, motion, &frequencies));
    let unstable = found.iter().filter(|one| one.equilibrium.is_none()).count();
    let is_missing = motions.iter().flat_map(|motion| &motion.0).any(Option::is_none);
    let curves = curves(&motions, &frequencies);
    let bias = at_bias(&simulation.scene).voltage_v();
    let result = JobResult {
        patterns: found.len(),
        arrays: content.object(),
        parameters: simulation.described(&format!(", response at {} frequencies", frequencies.len())),
        attachments: Some(Attachments {
            title: "deaflow solve --response",
            table: rows(&found, &motions, &frequencies)?,
            draw: Box::new(move |figure| responses_sheet(&curves)?.write_png(figure)),
        }),
        warnings,
        document: json!({
            "bias": bias,
            "frequencies": frequencies,
            "responses": documents.collect::<Vec<_>>(),
            "unstable": unstable,
        }),
        text: overview(&found, &motions, &frequencies),
        exit: if is_missing { Exit::Unstable } else { Exit::Done },
    };
    simulation.finish(result, output)
}

/// The responses of patterns at some frequencies.
pub struct Responses {
    found: Vec<FrequencyResponse>,
    motions: Vec<WatchedMotion>,
    /// The arrays.
    pub content: FrequencyResponses,
    /// Warnings about the model, one line each.
    pub warnings: Vec<String>,
}

impl Responses {
    /// Finds the response of each pattern to a small alternating voltage about its equilibrium.
    ///
    /// # Errors
    /// When a pattern cannot be simulated, or the responses do not fit into memory.
    pub fn find(computation: &Computation<'_>, Frequencies(frequencies): &Frequencies) -> Result<Self, CliError> {
        check_size(computation.patterns, frequencies.len())?;
        let scene = resolve(&at_bias(computation.scene))?;
        let (options, limit) = (computation.options()?, computation.parameters.work_limit());
        let set_up = |scene: &Scene| FrequencySolver::new(scene, options, limit);
        let solver = PatternSolver::new(&scene, set_up).map_err(with_help)?;
        let (mut found, mut solve_seconds) = (Vec::new(), Vec::new());
        computation.run(
            |pattern| Ok(solver.with(pattern, |solver| solver.respond(pattern, frequencies))?),
            |response, seconds| {
                found.push(response);
                solve_seconds.push(seconds);
            },
        )?;
        let motion = |one| WatchedMotion::new(one, frequencies.len());
        let motions: Vec<WatchedMotion> = found.iter().map(motion).collect();
        let neglected = model_warnings::of_states_of_motion(&scene, computation.patterns)?;
        let warnings = [neglected, warnings(&scene)].concat();
        let content = FrequencyResponses {
            solve_seconds,
            warnings: Lines(warnings.clone()),
            ..content(computation, &scene, frequencies, &found, &motions)
        };
        Ok(Self {
            found,
            motions,
            content,
            warnings,
        })
    }
}

/// Adds what the scene needs to an error of the solver.
fn with_help(error: SetupError) -> CliError {
    let help = match error {
        SetupError::Charge => "give the drive a `voltage` instead of a `charge`",
        SetupError::NoBias => "give the drive a `voltage`, or a `bias` of its sine",
        SetupError::Density => "add `density` to `properties` or to the effect `inertia`",
        _ => return error.into(),
    };
    CliError::bad_input(error.to_string()).help(help)
}

/// Refuses responses that do not fit into memory, before they are computed.
fn check_size(patterns: &[Pattern], points: usize) -> Result<(), CliError> {
    let corners: usize = patterns.iter().map(|pattern| pattern.raster().corners()).sum();
    let bytes = (4 * size_of::<f64>() * points) as f64 * corners as f64;
    if bytes > MAX_BYTES {
        let message = format!(
            "the responses of {} patterns at {points} frequencies take {:.1} GiB",
            patterns.len(),
            bytes / (1u64 << 30) as f64
        );
        return Err(CliError::bad_input(message).help("the limit is 2 GiB: use fewer --points, or fewer patterns"));
    }
    Ok(())
}

fn warnings(scene: &Scene) -> Vec<String> {
    let effects = &scene.effects;
    let warnings = match (effects.viscoelasticity.is_some(), effects.inertia.is_some()) {
        (false, false) => {
            vec!["neither viscoelasticity nor inertia is simulated: the response is the same at all frequencies"]
        }
        (true, false) => vec!["inertia is not simulated: the response has no resonances"],
        (false, true) => vec![
            "viscoelasticity is not simulated: resonances are not damped",
            OUT_OF_PLANE,
        ],
        (true, true) => vec![OUT_OF_PLANE],
    };
    let drive = match (scene.drive.source.is_some(), effects.electrode_resistance.is_some()) {
        (true, _) => Some("the `source` is not simulated: electrodes follow the alternating voltage at once"),
        (_, true) => Some("`electrode_resistance` is not simulated: electrodes follow the alternating voltage at once"),
        _ => None,
    };
    warnings.into_iter().chain(drive).map(str::to_owned).collect()
}

/// Amplitude and phase of the watched corner at each frequency with a response.
struct WatchedMotion(Vec<Option<[f64; 2]>>);

impl WatchedMotion {
    fn new(one: &FrequencyResponse, points: usize) -> Self {
        let mut motion = one.watched_motion();
        motion.resize(points, None);
        Self(motion)
    }

    /// Returns the largest amplitude with its phase, and its frequency.
    fn largest(&self, frequencies: &[f64]) -> Option<([f64; 2], f64)> {
        let known = self
            .0
            .iter()
            .zip(frequencies)
            .filter_map(|(one, f)| Some(((*one)?, *f)));
        known.max_by(|([a, _], _), ([b, _], _)| a.total_cmp(b))
    }
}

/// The name of the outcome at a frequency.
fn outcome_at(one: &FrequencyResponse, at: usize) -> &'static str {
    one.each.get(at).map_or(one.outcome.name(), AtFrequency::name)
}

/// The arrays of all responses. `scene` has the bias as its voltage.
fn content(
    computation: &Computation<'_>,
    scene: &Scene,
    frequencies: &[f64],
    found: &[FrequencyResponse],
    motions: &[WatchedMotion],
) -> FrequencyResponses {
    let row = 2 * scene.membrane().raster.corners();
    let add = |out: &mut Vec<f64>, field: Option<&Field>| match field {
        Some(field) => out.extend_from_slice(field.values()),
        None => out.extend(std::iter::repeat_n(f64::NAN, row)),
    };
    let [mut displacement, mut slope] = [(); 2].map(|()| Vec::new());
    let [mut real, mut imaginary] = [(); 2].map(|()| Vec::with_capacity(found.len() * frequencies.len() * row));
    for one in found {
        add(&mut displacement, one.equilibrium.as_ref());
        add(&mut slope, one.slope.as_ref());
        for at in 0..frequencies.len() {
            let parts = match one.each.get(at) {
                Some(AtFrequency::Response { real, imaginary }) => [Some(real), Some(imaginary.as_ref())],
                Some(AtFrequency::Resonance | AtFrequency::NotSolved) | None => [None, None],
            };
            add(&mut real, parts[0]);
            add(&mut imaginary, parts[1]);
        }
    }
    let of_watched = |part: usize| {
        let all = motions.iter().flat_map(|motion| &motion.0);
        Packed(all.map(|one| one.map_or(f64::NAN, |pair| pair[part])).collect())
    };
    let outcomes = |one| (0..frequencies.len()).map(move |at| outcome_at(one, at).to_owned());
    FrequencyResponses {
        patterns: computation.patterns.to_vec(),
        electrodes: DrawnElectrodes::of(computation.patterns),
        outcome: found.iter().map(|one| one.outcome.kind()).collect(),
        bias: vec![scene.voltage_v(); found.len()],
        displacement: Packed(displacement),
        slope: Packed(slope),
        frequency: frequencies.to_vec(),
        response_real: Packed(real),
        response_imaginary: Packed(imaginary),
        amplitude: of_watched(0),
        phase: of_watched(1),
        watched_corner: found
            .iter()
            .map(|one| one.watched.map(|corner| corner as u64))
            .collect(),
        frequency_outcome: Packed(found.iter().flat_map(outcomes).collect()),
        solve_seconds: Vec::new(),
        scene: computation.scene.with_effects(scene.effects.clone()),
        solver: computation.solver(),
        effects: scene.effects.clone(),
        warnings: Lines(Vec::new()),
    }
}

/// Returns amplitude and phase at all frequencies as comma-separated values with a header; empty without a response.
fn rows(found: &[FrequencyResponse], motions: &[WatchedMotion], frequencies: &[f64]) -> Result<String, CliError> {
    let header = ["pattern", "frequency_Hz", "amplitude_mm_per_V", "phase_deg", "outcome"];
    let rows = found
        .iter()
        .zip(motions)
        .enumerate()
        .flat_map(|(pattern, (one, motion))| {
            let row = move |(at, frequency): (usize, &f64)| {
                let numbers = [0, 1].map(|part| motion.0[at].map_or_else(String::new, |pair| pair[part].to_string()));
                let [amplitude, phase] = numbers;
                vec![
                    pattern.to_string(),
                    frequency.to_string(),
                    amplitude,
                    phase,
                    outcome_at(one, at).to_owned(),
                ]
            };
            frequencies.iter().enumerate().map(row)
        });
    csv::text(&header.map(str::to_owned), rows)
}

fn curves(motions: &[WatchedMotion], frequencies: &[f64]) -> Vec<figures::Response> {
    let curve = |(index, motion): (usize, &WatchedMotion)| {
        let known = motion
            .0
            .iter()
            .zip(frequencies)
            .filter_map(|(one, f)| Some((*f, (*one)?)));
        let known: Vec<(f64, [f64; 2])> = known.collect();
        figures::Response {
            name: format!("pattern {index}"),
            frequency: known.iter().map(|(f, _)| *f).collect(),
            amplitude: known.iter().map(|(_, [amplitude, _])| *amplitude).collect(),
            phase: known.iter().map(|(_, [_, phase])| *phase).collect(),
        }
    };
    motions.iter().enumerate().map(curve).collect()
}

/// Lists the patterns, and the frequencies without a response.
fn overview(found: &[FrequencyResponse], motions: &[WatchedMotion], frequencies: &[f64]) -> Text {
    let header = ["pattern", "outcome", "corner", "first", "largest", "at", "phase"];
    let mut table = table::table(&header, &header[3..]).dispensable(&["phase", "first"]);
    let mut lines = Vec::new();
    for (index, (one, motion)) in found.iter().zip(motions).enumerate() {
        let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
        let amplitude = |value: f64| format!("{} mm/V", with_minus(&format!("{value:.3e}")));
        let largest = motion.largest(frequencies);
        let first = motion.0.first().copied().flatten();
        table.add_row([
            index.to_string(),
            one.outcome.to_string(),
            or_dash(largest.map(|_| format!("{}, {}", one.watched[0], one.watched[1]))),
            or_dash(first.map(|[value, _]| amplitude(value))),
            or_dash(largest.map(|([value, _], _)| amplitude(value))),
            or_dash(largest.map(|(_, at)| format!("{} Hz", four_digits(at)))),
            or_dash(largest.map(|([_, phase], _)| format!("{} deg", with_minus(&format!("{phase:.1}"))))),
        ]);
        let without = one.each.iter().zip(frequencies).filter_map(|(at, frequency)| match at {
            AtFrequency::Response { .. } => None,
            AtFrequency::Resonance | AtFrequency::NotSolved => {
                Some(format!("pattern {index}: no response at {frequency} Hz: {}", at.name()))
            }
        });
        lines.extend(without);
    }
    let mut text = Text::of(table);
    for line in lines {
        text.line(line);
    }
    text
}

fn document(index: usize, one: &FrequencyResponse, motion: &WatchedMotion, frequencies: &[f64]) -> Value {
    let part = |part: usize| {
        let each = motion.0.iter().map(|one| one.map(|pair| pair[part]));
        each.collect::<Vec<_>>()
    };
    let without = |name: AtFrequency| {
        let each = one.each.iter().zip(frequencies);
        each.filter(|(at, _)| **at == name).map(|(_, f)| *f).collect::<Vec<_>>()
    };
    json!({
        "index": index,
        "outcome": one.outcome.name(),
        "watched_corner": one.watched,
        "amplitude": part(0),
        "phase": part(1),
        "resonances": without(AtFrequency::Resonance),
        "not_solved": without(AtFrequency::NotSolved),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frequencies_are_spaced_evenly_over_their_logarithm() {
        let FrequencyRange(ends) = FrequencyRange::parse("1Hz:1 kHz").unwrap();
        assert_eq!(ends, [1.0, 1000.0]);
        let found = FrequencyRange(ends).frequencies(4);
        assert_eq!(found, [1.0, 10.0, 100.0, 1000.0]);
        assert_eq!(FrequencyRange(ends).frequencies(2), [1.0, 1000.0]);
        for refused in [
            "",
            "1 Hz",
            "1Hz:",
            "2Hz:1Hz",
            "1Hz:1Hz",
            "0Hz:1Hz",
            "-1Hz:1Hz",
            "1Hz:2e9Hz",
            "1 V:2 V",
            "1:2:3",
        ] {
            assert!(FrequencyRange::parse(refused).is_err(), "{refused}");
        }
    }
}
