//! `deaflow solve --modes`: natural frequencies of patterns about their equilibria.

use std::time::Instant;

use clap::Args;
use rayon::prelude::*;
use serde_json::{Value, json};

use super::error::CliError;
use super::history::TIME;
use super::output::{Exit, Output};
use super::progress::Bar;
use super::simulate::seconds_each;
use super::solve::{SolveArguments, provenance};
use super::table;
use super::text::Text;
use deaflow_base::Progress;
use deaflow_content::{Packed, Vibrations};
use deaflow_fem::screening::resolve;
use deaflow_fem::{MOST_MODES, MembraneSolver, Vibration, check_leads};
use deaflow_field::Field;
use deaflow_pattern::Pattern;
use deaflow_scene::Scene;
use deaflow_stage::direct;
use deaflow_store::write_file;

/// What is said where the lowest mode of the flat membrane out of its plane is about as low.
pub const OUT_OF_PLANE: &str =
    "a flat membrane also vibrates out of its plane, from about its lowest natural frequency on; that is not simulated";

#[derive(Clone, Debug, Args)]
pub struct ModesArguments {
    /// Find so many natural frequencies of each pattern about its equilibrium, with their modes; needs a density
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u64).range(1..=MOST_MODES as u64), conflicts_with_all = ["path", "cells", "accuracy", "history", "at", "every"], help_heading = TIME)]
    pub modes: Option<u64>,
    /// Put the mass of each node into the node
    #[arg(long, requires = "modes", help_heading = TIME)]
    lumped: bool,
}

/// Finds natural frequencies and writes them with their modes.
///
/// # Errors
/// When the scene or a pattern cannot be used, no density is known, or the file cannot be written.
pub fn execute(arguments: &SolveArguments, count: u64, output: &Output) -> Result<Exit, CliError> {
    let file = arguments.patterns.output.as_deref();
    let read = arguments.read_scene()?;
    if !read.states.is_empty() {
        return Err(
            CliError::bad_input("natural frequencies are those of one state of a device")
                .help("name the state: --state NAME"),
        );
    }
    let patterns = direct::patterns(&arguments.patterns.patterns, read.form())?;
    check_leads(read.leads.as_ref(), &patterns)?;
    let scene = resolve(&read)?;
    let solver = MembraneSolver::new(&scene, arguments.options())?.within(arguments.time.work_limit());
    let (bar, start) = (Bar::new("modes", "patterns", patterns.len() as u64), Instant::now());
    let threads = rayon::current_num_threads();
    let (mut found, mut each) = (Vec::with_capacity(patterns.len()), Vec::new());
    for batch in patterns.chunks(threads) {
        let begun = Instant::now();
        let one = |pattern: &Pattern| -> Result<Vibration, CliError> {
            let found = solver.vibration(pattern, count as usize, arguments.modes.lumped)?;
            bar.advance(1);
            Ok(found)
        };
        found.extend(batch.par_iter().map(one).collect::<Result<Vec<_>, _>>()?);
        each.extend(seconds_each(begun, batch.len(), threads));
    }
    bar.clear();
    let seconds = start.elapsed().as_secs_f64();
    let lumped = if arguments.modes.lumped { ", lumped mass" } else { "" };
    let parameters = format!(
        "{}, {}, {count} modes{lumped}",
        arguments.described(),
        arguments.parameters()
    );
    let content = vibrations(&patterns, &scene, count as usize, &found, each, arguments);
    if let Some(file) = file {
        write_file(file, &content.object(), &provenance("solve", parameters, seconds))?;
    }
    let unstable = found.iter().filter(|one| one.equilibrium.is_none()).count();
    if output.is_json() {
        output.document(&json!({
            "file": file,
            "vibrations": found.iter().enumerate().map(document).collect::<Vec<_>>(),
            "unstable": unstable,
            "warnings": warnings(&scene),
            "seconds": seconds,
        }))?;
    } else {
        let time = table::seconds(seconds);
        let mut text = Text::of(overview(&found, count as usize));
        for warning in warnings(&scene) {
            text.line(format!("model warning: {warning}"));
        }
        text.line(match file {
            Some(file) => format!("{} in {time}", file.display()),
            None => format!("{} in {time}", table::counted(patterns.len() as u64, "patterns")),
        });
        output.text(text)?;
    }
    Ok(if unstable > 0 { Exit::Unstable } else { Exit::Done })
}

fn warnings(scene: &Scene) -> Vec<&'static str> {
    let relaxed = scene.effects.viscoelasticity.as_ref().map(|_| {
        "modes are those of the relaxed membrane: branches whose relaxation takes longer than a period make it stiffer, as --response shows"
    });
    [OUT_OF_PLANE].into_iter().chain(relaxed).collect()
}

fn vibrations(
    patterns: &[Pattern],
    scene: &Scene,
    count: usize,
    found: &[Vibration],
    seconds: Vec<f64>,
    arguments: &SolveArguments,
) -> Vibrations {
    let row = 2 * scene.membrane().raster.corners();
    let missing = |rows: usize| std::iter::repeat_n(f64::NAN, rows * row);
    let (mut displacement, mut modes, mut frequencies) = (Vec::new(), Vec::new(), Vec::new());
    for one in found {
        match &one.equilibrium {
            Some(field) => displacement.extend_from_slice(field.values()),
            None => displacement.extend(missing(1)),
        }
        frequencies.extend(
            one.frequencies
                .iter()
                .copied()
                .chain(std::iter::repeat(f64::NAN))
                .take(count),
        );
        one.modes
            .iter()
            .for_each(|mode: &Field| modes.extend_from_slice(mode.values()));
        modes.extend(missing(count - one.modes.len()));
    }
    Vibrations {
        patterns: patterns.to_vec(),
        outcome: found.iter().map(|one| one.outcome.name().to_owned()).collect(),
        displacement: Packed(displacement),
        mode: (1..=count as u64).collect(),
        frequencies: Packed(frequencies),
        modes: Packed(modes),
        solve_seconds: seconds,
        scene: scene.clone(),
        solver: format!("{{ {} }}", arguments.parameters()),
        effects: scene.effects.to_text(),
    }
}

/// One line for each pattern.
fn overview(found: &[Vibration], count: usize) -> table::Table {
    const SHOWN: usize = 6;
    let shown = count.min(SHOWN);
    let names: Vec<String> = (1..=shown).map(|mode| format!("f{mode}")).collect();
    let header: Vec<&str> = ["pattern", "outcome"]
        .into_iter()
        .chain(names.iter().map(String::as_str))
        .collect();
    let last: Vec<&str> = header[2..].iter().rev().copied().collect();
    let mut table = table::table(&header, &header[2..]).dispensable(&last);
    for (index, one) in found.iter().enumerate() {
        let hertz = one.frequencies.iter().map(|hertz| format!("{hertz:.2} Hz"));
        let hertz = hertz.chain(std::iter::repeat("-".to_owned())).take(shown);
        let row = [index.to_string(), one.outcome.to_string()];
        table.add_row(row.into_iter().chain(hertz).collect::<Vec<_>>());
    }
    table
}

fn document((index, one): (usize, &Vibration)) -> Value {
    json!({ "index": index, "outcome": one.outcome.name(), "frequencies": one.frequencies })
}
