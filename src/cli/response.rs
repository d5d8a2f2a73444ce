//! `deaflow solve --response`: how patterns respond to a small alternating voltage about their equilibria.

use std::time::Instant;

use clap::Args;
use rayon::prelude::*;
use serde_json::{Value, json};

use super::error::CliError;
use super::history::TIME;
use super::modes::OUT_OF_PLANE;
use super::output::{Exit, Output};
use super::progress::Bar;
use super::simulate::seconds_each;
use super::solve::{SolveArguments, check_file, provenance};
use super::text::Text;
use super::{csv, table, write};
use deaflow_base::{Dimension, Progress, Quantity};
use deaflow_content::{FrequencyResponses, Lines, Packed};
use deaflow_fem::screening::resolve;
use deaflow_fem::{AtFrequency, FrequencyResponse, FrequencySolver, SetupError, at_bias};
use deaflow_field::Field;
use deaflow_pattern::Pattern;
use deaflow_report::figures::{self, draw_responses};
use deaflow_scene::Scene;
use deaflow_stage::direct;
use deaflow_store::write_file;

/// Frequencies in Hz that are allowed.
const LOWEST: f64 = 1e-9;
const HIGHEST: f64 = 1e9;
/// Frequencies that are asked for unless said otherwise, and at most.
const USUAL_POINTS: u64 = 100;
const MOST_POINTS: u64 = 10_000;
/// Bytes of responses at most.
const MOST_BYTES: f64 = (2u64 << 30) as f64;

#[derive(Clone, Debug, Args)]
pub struct ResponseArguments {
    /// Find how each pattern responds to a small alternating voltage about its equilibrium, at frequencies from A to B, as in
    /// "1Hz:1kHz"; OUT.csv and OUT.png are written beside OUT.h5
    #[arg(long, value_name = "A:B", value_parser = range, conflicts_with_all = ["path", "cells", "accuracy", "history", "modes", "lumped", "at", "every"], help_heading = TIME)]
    pub response: Option<Range>,
    /// So many frequencies, evenly spaced over their logarithm [default: 100]
    #[arg(long, value_name = "N", requires = "response", value_parser = clap::value_parser!(u64).range(2..=MOST_POINTS), help_heading = TIME)]
    points: Option<u64>,
}

/// The lowest and the highest frequency in Hz.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range([f64; 2]);

fn range(text: &str) -> Result<Range, String> {
    let Some((first, last)) = text.split_once(':') else {
        return Err("give the lowest and the highest frequency, as in 1Hz:1kHz".to_owned());
    };
    let frequency = |text: &str| {
        let quantity = Quantity::parse(text, Dimension::Frequency).map_err(|e| e.to_string())?;
        match (LOWEST..=HIGHEST).contains(&quantity.value()) {
            true => Ok(quantity.value()),
            false => Err(format!("{text}: allowed: {LOWEST:e} Hz to {HIGHEST:e} Hz")),
        }
    };
    let ends = [frequency(first)?, frequency(last)?];
    match ends[0] < ends[1] {
        true => Ok(Range(ends)),
        false => Err(format!("{first} is not below {last}")),
    }
}

impl Range {
    /// So many frequencies in Hz, evenly spaced over their logarithm, with both ends.
    fn frequencies(self, points: u64) -> Vec<f64> {
        let Self([first, last]) = self;
        // As people would write it: 10 Hz, not 9.999999999999998 Hz.
        let rounded = |value: f64| format!("{value:.12e}").parse().unwrap_or(value);
        let inner = (1..points - 1).map(|k| rounded(first * (last / first).powf(k as f64 / (points - 1) as f64)));
        std::iter::once(first).chain(inner).chain([last]).collect()
    }
}

/// Finds responses and writes them as arrays, as a table and as a figure.
///
/// # Errors
/// When a file would be lost, the scene or a pattern cannot be used, or a file cannot be written.
pub fn execute(arguments: &SolveArguments, range: Range, scene: &[&str], output: &Output) -> Result<Exit, CliError> {
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
            CliError::bad_input("a frequency response is that of one state of a device")
                .help("name the state: --state NAME"),
        );
    }
    let patterns = direct::patterns(&arguments.patterns.patterns, read.form())?;
    let frequencies = range.frequencies(arguments.response.points.unwrap_or(USUAL_POINTS));
    check_size(&patterns, frequencies.len())?;
    let scene = resolve(&at_bias(&read))?;
    let solver = FrequencySolver::new(&scene, arguments.options(), arguments.time.work_limit()).map_err(explained)?;
    let (bar, start) = (Bar::new("response", "patterns", patterns.len() as u64), Instant::now());
    let threads = rayon::current_num_threads();
    let (mut found, mut each) = (Vec::with_capacity(patterns.len()), Vec::new());
    for batch in patterns.chunks(threads) {
        let begun = Instant::now();
        let one = |pattern: &Pattern| {
            let found = solver.respond(pattern, &frequencies);
            bar.advance(1);
            found
        };
        found.extend(batch.par_iter().map(one).collect::<Vec<_>>());
        each.extend(seconds_each(begun, batch.len(), threads));
    }
    bar.clear();
    let seconds = start.elapsed().as_secs_f64();
    let parameters = format!(
        "{}, {}, response at {} frequencies",
        arguments.described(),
        arguments.parameters(),
        frequencies.len()
    );
    let warnings = warnings(&scene);
    let motions: Vec<Motion> = found.iter().map(|one| Motion::new(one, frequencies.len())).collect();
    let table = rows(&found, &motions, &frequencies)?;
    let summary = match output.is_json() {
        true => None,
        false => Some(overview(&found, &motions, &frequencies)),
    };
    let documents: Vec<Value> = found
        .iter()
        .zip(&motions)
        .enumerate()
        .map(|(index, (one, motion))| document(index, one, motion, &frequencies))
        .collect();
    let unstable = found.iter().filter(|one| one.equilibrium.is_none()).count();
    let missing = motions.iter().flat_map(|motion| &motion.0).any(Option::is_none);
    let source = format!("{}; {parameters}", file.display());
    write::csv(&values, table.as_bytes(), "deaflow solve --response", &source)?;
    draw_responses(&figure, &curves(&motions, &frequencies))?;
    let content = FrequencyResponses {
        frequency: frequencies.clone(),
        solve_seconds: each,
        solver: format!("{{ {} }}", arguments.parameters()),
        scene: read.with_effects(scene.effects.clone()),
        warnings: Lines(warnings.clone()),
        ..content(patterns, &scene, found, &motions)
    };
    write_file(file, &content.object(), &provenance("solve", parameters, seconds))?;
    if let Some(mut summary) = summary {
        for warning in &warnings {
            summary.line(format!("model warning: {warning}"));
        }
        let files = [
            file.display().to_string(),
            write::with_metadata(&values),
            figure.display().to_string(),
        ];
        summary.line(format!("{} in {}", files.join(", "), table::seconds(seconds)));
        output.text(summary)?;
    } else {
        output.document(&json!({
            "file": file,
            "table": values,
            "figure": figure,
            "bias": scene.voltage_v(),
            "frequencies": frequencies,
            "responses": documents,
            "unstable": unstable,
            "warnings": warnings,
            "seconds": seconds,
        }))?;
    }
    Ok(if missing { Exit::Unstable } else { Exit::Done })
}

/// What a scene lacks is said in its words.
fn explained(error: SetupError) -> CliError {
    let help = match error {
        SetupError::Charge => "give the drive a `voltage` in place of the `charge`",
        SetupError::NoBias => "give the drive a `voltage`, or its sine a `bias`",
        SetupError::Density => "give `density` in `properties` or in the effect `inertia`",
        _ => return error.into(),
    };
    CliError::bad_input(error.to_string()).help(help)
}

/// Responses that would not fit into memory are refused before they are computed.
fn check_size(patterns: &[Pattern], points: usize) -> Result<(), CliError> {
    let corners: usize = patterns.iter().map(|pattern| pattern.raster().corners()).sum();
    let bytes = (4 * size_of::<f64>() * points) as f64 * corners as f64;
    if bytes > MOST_BYTES {
        let message = format!(
            "the responses of {} patterns at {points} frequencies take {:.1} GiB",
            patterns.len(),
            bytes / (1u64 << 30) as f64
        );
        return Err(CliError::bad_input(message)
            .help("at most 2 GiB are written: take fewer --points, or fewer patterns at once"));
    }
    Ok(())
}

fn warnings(scene: &Scene) -> Vec<String> {
    let effects = &scene.effects;
    let words = match (effects.viscoelasticity.is_some(), effects.inertia.is_some()) {
        (false, false) => {
            vec!["neither viscoelasticity nor inertia is simulated: the response is the same at all frequencies"]
        }
        (true, false) => vec!["inertia is not simulated: the response has no resonances"],
        (false, true) => vec![
            "viscoelasticity is not simulated: nothing damps the resonances",
            OUT_OF_PLANE,
        ],
        (true, true) => vec![OUT_OF_PLANE],
    };
    let drive = match (scene.drive.source.is_some(), effects.electrode_resistance.is_some()) {
        (true, _) => Some("the `source` is not simulated: the electrodes have the alternating voltage at once"),
        (_, true) => {
            Some("`electrode_resistance` is not simulated: the electrodes have the alternating voltage at once")
        }
        _ => None,
    };
    words.into_iter().chain(drive).map(str::to_owned).collect()
}

/// Amplitude and phase of the corner that is watched, at each frequency with a response.
struct Motion(Vec<Option<[f64; 2]>>);

impl Motion {
    fn new(one: &FrequencyResponse, points: usize) -> Self {
        let mut motion = one.watched_motion();
        motion.resize(points, None);
        Self(motion)
    }

    /// The largest amplitude with its phase and the frequency at which it is.
    fn largest(&self, frequencies: &[f64]) -> Option<([f64; 2], f64)> {
        let known = self
            .0
            .iter()
            .zip(frequencies)
            .filter_map(|(one, f)| Some(((*one)?, *f)));
        known.max_by(|([a, _], _), ([b, _], _)| a.total_cmp(b))
    }
}

/// What was found at a frequency, in the words of files.
fn named(one: &FrequencyResponse, at: usize) -> &'static str {
    one.each.get(at).map_or(one.outcome.name(), AtFrequency::name)
}

/// The arrays, without what is said of how they were found.
fn content(
    patterns: Vec<Pattern>,
    scene: &Scene,
    found: Vec<FrequencyResponse>,
    motions: &[Motion],
) -> FrequencyResponses {
    let row = 2 * scene.membrane().raster.corners();
    let points = motions.first().map_or(0, |motion| motion.0.len());
    let of_watched = |part: usize| {
        let all = motions.iter().flat_map(|motion| &motion.0);
        Packed(all.map(|one| one.map_or(f64::NAN, |pair| pair[part])).collect())
    };
    let outcome = found.iter().map(|one| one.outcome.name().to_owned()).collect();
    let watched_corner = found
        .iter()
        .map(|one| one.watched.map(|corner| corner as u64))
        .collect();
    let frequency_outcome = found
        .iter()
        .flat_map(|one| (0..points).map(|at| named(one, at).to_owned()))
        .collect();
    let missing = |out: &mut Vec<f64>| out.extend(std::iter::repeat_n(f64::NAN, row));
    let or_missing = |out: &mut Vec<f64>, field: Option<Field>| match field {
        Some(field) => out.extend_from_slice(field.values()),
        None => missing(out),
    };
    let (mut displacement, mut slope) = (Vec::new(), Vec::new());
    let [mut real, mut imaginary] = [0; 2].map(|_| Vec::with_capacity(found.len() * points * row));
    for one in found {
        or_missing(&mut displacement, one.equilibrium);
        or_missing(&mut slope, one.slope);
        let mut each = one.each.into_iter();
        for _ in 0..points {
            let parts = match each.next() {
                Some(AtFrequency::Response { real, imaginary }) => [Some(real), Some(imaginary)],
                Some(AtFrequency::Resonance | AtFrequency::NotSolved) | None => [None, None],
            };
            for (out, part) in [&mut real, &mut imaginary].into_iter().zip(parts) {
                or_missing(out, part);
            }
        }
    }
    FrequencyResponses {
        outcome,
        bias: vec![scene.voltage_v(); patterns.len()],
        patterns,
        displacement: Packed(displacement),
        slope: Packed(slope),
        frequency: Vec::new(),
        response_real: Packed(real),
        response_imaginary: Packed(imaginary),
        amplitude: of_watched(0),
        phase: of_watched(1),
        watched_corner,
        frequency_outcome: Packed(frequency_outcome),
        solve_seconds: Vec::new(),
        scene: scene.clone(),
        solver: String::new(),
        effects: scene.effects.to_text(),
        warnings: Lines(Vec::new()),
    }
}

/// Amplitude and phase at all frequencies as comma-separated values with a header; empty where there is no response.
fn rows(found: &[FrequencyResponse], motions: &[Motion], frequencies: &[f64]) -> Result<String, CliError> {
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
                    named(one, at).to_owned(),
                ]
            };
            frequencies.iter().enumerate().map(row)
        });
    csv::text(&header.map(str::to_owned), rows)
}

fn curves(motions: &[Motion], frequencies: &[f64]) -> Vec<figures::Response> {
    let curve = |(index, motion): (usize, &Motion)| {
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

/// One line for each pattern, and one for each frequency without a response.
fn overview(found: &[FrequencyResponse], motions: &[Motion], frequencies: &[f64]) -> Text {
    let header = ["pattern", "outcome", "corner", "first", "largest", "at", "phase"];
    let mut table = table::table(&header, &header[3..]).dispensable(&["phase", "first"]);
    let mut lines = Vec::new();
    for (index, (one, motion)) in found.iter().zip(motions).enumerate() {
        let or_dash = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
        let amplitude = |value: f64| format!("{value:.4e} mm/V");
        let largest = motion.largest(frequencies);
        let first = motion.0.first().copied().flatten();
        table.add_row([
            index.to_string(),
            one.outcome.to_string(),
            or_dash(largest.map(|_| format!("{}, {}", one.watched[0], one.watched[1]))),
            or_dash(first.map(|[value, _]| amplitude(value))),
            or_dash(largest.map(|([value, _], _)| amplitude(value))),
            or_dash(largest.map(|(_, at)| format!("{at:.4} Hz"))),
            or_dash(largest.map(|([_, phase], _)| format!("{phase:.1} deg"))),
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

fn document(index: usize, one: &FrequencyResponse, motion: &Motion, frequencies: &[f64]) -> Value {
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
        let Range(ends) = range("1Hz:1 kHz").unwrap();
        assert_eq!(ends, [1.0, 1000.0]);
        let found = Range(ends).frequencies(4);
        assert_eq!(found, [1.0, 10.0, 100.0, 1000.0]);
        assert_eq!(Range(ends).frequencies(2), [1.0, 1000.0]);
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
            assert!(range(refused).is_err(), "{refused}");
        }
    }
}
